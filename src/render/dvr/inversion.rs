//! The backward pass of Weiss & Westermann (2021, sect. 4.3): the state of the front-to-back blend is
//! recovered by inverting it, `α = (α' - a) / (1 - a)`. Kept in the kernel's own precision, as
//! published, so that its error can be shown beside the recursion's: it is 0/0 behind an opaque
//! sample, and drifts with the optical depth.

use super::adjoint::{Pass, Weighted};
use super::blend::Entry;
use super::segment_derivatives::SegmentDerivatives;
use super::shade::{SegmentCotangent, SegmentSource};
use crate::real::Real;
use crate::render::curve::Curve;
use crate::render::rule::Rule;
use crate::render::segment::End;

/// Blends the tape forward in `R`, then walks it backward by inversion, adding the gradient to the accumulators.
#[inline(always)]
pub(super) fn backward<R: Real, S: SegmentDerivatives<R>, Q: Rule<R, C, Segment = S>, const C: usize>(
    pass: &mut Pass<'_, '_, R>,
    curve: &Curve<R, C>,
    rule: Q,
    tape: &[Entry<R, S>],
    weighted: &Weighted<C>,
) {
    let alpha = |entry: &Entry<R, S>| -(-entry.light.depth).exp_m1();
    let mut opacity = R::ZERO;
    for entry in tape {
        opacity += (R::ONE - opacity) * alpha(entry);
    }
    let mut by_opacity = R::of(-weighted.transmittance);
    for entry in tape.iter().rev() {
        let (segment, light) = (&entry.segment, &entry.light);
        let line = curve.piece(segment.piece());
        let glow = SegmentSource::new(line, light.mean, &weighted.color);
        let (mean, slope) = (R::of(glow.mean), R::of(glow.slope));
        // More opacity takes away what arrives from beyond.
        let arriving = |open: R, by_opacity: R| [open.f64(), -(open * by_opacity).f64()];
        pass.jump(curve, (segment, End::Far), arriving(R::ONE - opacity, by_opacity), weighted);
        let alpha = alpha(entry);
        opacity = (opacity - alpha) / (R::ONE - alpha);
        let open = R::ONE - opacity;
        // emitted' = emitted + open · e,  opacity' = opacity + open · α,  e = c̄ α + s q
        let by_depth = open * (by_opacity + mean) * (R::ONE - alpha);
        by_opacity = by_opacity * (R::ONE - alpha) - (mean * alpha + slope * light.varied);
        let by = SegmentCotangent { depth: by_depth, mean: open * alpha, varied: open };
        pass.deposit(rule, line, (segment, light), slope, by, weighted);
        pass.jump(curve, (segment, End::Near), arriving(open, by_opacity), weighted);
    }
}
