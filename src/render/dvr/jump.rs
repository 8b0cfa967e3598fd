//! Boundary terms where a transfer function jumps. A segment's end there lies at the length t of the ray at which the
//! density is that of the step, `d(t) = x`; t moves with all that the density depends on, and with x:
//!
//! ```text
//! dt = (dx - ∂d) / d'(t)        dL = ± σ (c T - V) dt
//! ```
//! with `±` for the segment that ends there or begins there, σ and c its extinction and source at its end, T the
//! transmittance and V the radiance that arrives from behind (Reynolds' transport theorem on a line). Where nothing
//! jumps, the terms of both sides of a knot cancel.
//!
//! At a step two knots coincide. The derivatives given are those of separating them, with a ramp in between: the
//! derivative with respect to one knot is its one-sided value minus the mean over the ramp.

use super::segment_derivatives::SegmentDerivatives;
use crate::real::Real;
use crate::render::curve::Curve;
use crate::render::march::IndexRay;
use crate::render::segment::{End, Place};
use glam::DVec3;

/// The least change of the density along a ray at a step, as a share of its gradient. With less, the ray grazes the
/// level set: the crossing moves without bound, while next to nothing depends on it.
const GRAZING: f64 = 1e-3;

/// An end of a segment at which the transfer function jumps. Of pairs, the first is the value on the segment's side of
/// the step, the second that value minus the mean over a ramp to the other side.
pub(super) struct Jump<R, const C: usize> {
    /// Position of the end on the ray.
    pub place: Place<R>,
    /// Gradient of the density with respect to index coordinates.
    pub slopes: DVec3,
    /// Derivative of the segment's world length with respect to the density of the step.
    pub longer: f64,
    /// Number of the knot on the segment's side.
    pub knot: usize,
    /// Extinction.
    pub extinction: [f64; 2],
    /// Extinction times source, by channel.
    pub emitted: [[f64; C]; 2],
}

impl<R: Real, const C: usize> Jump<R, C> {
    /// Returns the jump at one end of a segment; `None` where there is none.
    #[inline(always)]
    pub(crate) fn find<S: SegmentDerivatives<R>>(
        curve: &Curve<R, C>,
        values: &[R],
        ray: &IndexRay,
        segment: &S,
        end: End,
    ) -> Option<Self> {
        let place = segment.jump(end)?;
        Self::at(curve, segment.piece(), place, values, ray.direction(), end)
    }

    #[inline(never)]
    fn at(curve: &Curve<R, C>, number: u32, place: Place<R>, values: &[R], direction: DVec3, end: End) -> Option<Self> {
        let slopes = place.slopes(values);
        let along = slopes.dot(direction);
        if along.abs() <= GRAZING * slopes.length() * direction.length() {
            return None;
        }
        let piece = curve.piece(number);
        // A segment that the density rises along ends at the upper end of its piece.
        let upper = (along > 0.0) == (end == End::Far);
        // What rounding has turned round has no jump there.
        if !piece.jumps[usize::from(upper)] {
            return None;
        }
        let next = |number: u32| match upper {
            true => Some(number + 1).filter(|next| (*next as usize) < curve.len()),
            false => number.checked_sub(1),
        };
        let mut other = next(number)?;
        while curve.piece(other).is_step() {
            other = next(other)?;
        }
        let level = if upper { piece.high } else { piece.low };
        let [own, more] = piece.side(level).sides(&curve.piece(other).side(level));
        Some(Self {
            place,
            slopes,
            longer: if end == End::Far { 1.0 } else { -1.0 } / along,
            knot: if upper { number } else { number - 1 } as usize,
            extinction: [own.0, more.0],
            emitted: [own.1, more.1],
        })
    }

    /// Returns the derivatives of the loss-weighted light with respect to the density of the step, given the
    /// transmittance there and the loss-weighted radiance `incoming` that arrives from behind it.
    #[inline(always)]
    pub(crate) fn gains(&self, weights: &[f64; C], transmittance: f64, incoming: f64) -> [f64; 2] {
        [0, 1].map(|k| {
            let emitted: f64 = weights.iter().zip(&self.emitted[k]).map(|(w, emitted)| w * emitted).sum();
            self.longer * (transmittance * emitted - incoming * self.extinction[k])
        })
    }
}
