//! The backward pass of Weiss & Westermann (2021, sect. 4.3): the state of the front-to-back blend is
//! recovered by inverting it, `α = (α' - a) / (1 - a)`. Kept in the kernel's own precision, as
//! published, so that its error can be shown beside the recursion's: it is 0/0 behind an opaque
//! sample, and drifts with the optical depth.

use super::adjoint::{Entry, Pass, Weighted};
use super::light::{Emission, Lit};
use crate::real::Real;

/// Blends the tape forward in `R`, then walks it backward by inversion.
#[inline(always)]
pub(super) fn backward<R: Real, E: Emission, S: Lit<R>>(
    pass: &mut Pass<'_, '_, R>,
    tape: &[Entry<R, S>],
    weighted: Weighted,
) {
    let alpha = |entry: &Entry<R, S>| -(-entry.light.depth).exp_m1();
    let mut opacity = R::ZERO;
    for entry in tape {
        opacity += (R::ONE - opacity) * alpha(entry);
    }
    let by_emitted = R::of(weighted.colour);
    let mut by_opacity = R::of(-weighted.background);
    for entry in tape.iter().rev() {
        let alpha = alpha(entry);
        opacity = (opacity - alpha) / (R::ONE - alpha);
        let open = R::ONE - opacity;
        // emitted' = emitted + open · e,  opacity' = opacity + open · α
        let by_depth = open * by_opacity * (R::ONE - alpha);
        let by_light = open * by_emitted;
        by_opacity = by_opacity * (R::ONE - alpha) - by_emitted * entry.light.emitted;
        pass.deposit::<E, S>(&entry.segment, &entry.light, by_depth.f64(), by_light.f64());
    }
}
