//! Where a transfer function jumps, so does the light of a segment's end. It lies at the length t of the ray at which
//! the density is that of the step, `d(t) = x`, and t moves with all that the density depends on, and with x:
//!
//! ```text
//! dt = (dx - ∂d) / d'(t)        dL = ± σ (c T - V) dt
//! ```
//! with `±` for the segment that ends there or begins there, σ and c its extinction and source at its end, T the
//! transmittance and V the radiance from beyond (Reynolds' transport theorem on a line). Where nothing jumps, both
//! sides of a knot cancel.
//!
//! The two knots of a step can part, and then a ramp lies between them: what a knot does by moving away from the other
//! is what its side has more than the mean of the ramp.

use super::segment_derivatives::SegmentDerivatives;
use crate::real::Real;
use crate::render::curve::Curve;
use crate::render::march::IndexRay;
use crate::render::segment::{End, Place};
use glam::DVec3;

/// The least that the density gains along a ray where it meets a step, as a share of its gradient. With less the ray
/// grazes the level: where it meets it moves without bound, while next to nothing depends on it.
const GRAZING: f64 = 1e-3;

/// An end of a segment at which the transfer function jumps. Of pairs, the first is the segment's side of the step, the
/// second what that has more than the mean of a ramp to the other side.
pub(super) struct Jump<R, const C: usize> {
    /// Where it lies.
    pub place: Place<R>,
    /// Gradient of the density, by index coordinate.
    pub slopes: DVec3,
    /// Change of the segment's length with the density of the step.
    pub longer: f64,
    /// Number of the knot on the segment's side.
    pub knot: usize,
    /// Extinction.
    pub extinction: [f64; 2],
    /// Extinction times source, by channel.
    pub lit: [[f64; C]; 2],
}

impl<R: Real, const C: usize> Jump<R, C> {
    /// At one end of a segment; `None` where there is no jump.
    #[inline(always)]
    pub fn find<S: SegmentDerivatives<R>>(
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
        let beyond = |number: u32| match upper {
            true => Some(number + 1).filter(|next| (*next as usize) < curve.len()),
            false => number.checked_sub(1),
        };
        let mut other = beyond(number)?;
        while curve.piece(other).is_step() {
            other = beyond(other)?;
        }
        let level = if upper { piece.high } else { piece.low };
        let [own, more] = piece.side(level).beside(&curve.piece(other).side(level));
        Some(Self {
            place,
            slopes,
            longer: if end == End::Far { 1.0 } else { -1.0 } / along,
            knot: if upper { number } else { number - 1 } as usize,
            extinction: [own.0, more.0],
            lit: [own.1, more.1],
        })
    }

    /// Change of the loss-weighted light with the density of the step, where so much is open and so much arrives from
    /// beyond.
    #[inline(always)]
    pub fn gains(&self, weights: &[f64; C], open: f64, beyond: f64) -> [f64; 2] {
        [0, 1].map(|k| {
            let lit: f64 = weights.iter().zip(&self.lit[k]).map(|(w, lit)| w * lit).sum();
            self.longer * (open * lit - beyond * self.extinction[k])
        })
    }
}
