//! The backward pass of Weiss & Westermann (2021, sect. 4.3): the state of the front-to-back blend is
//! recovered by inverting it, `α = (α' - a) / (1 - a)`. Kept in the kernel's own precision, as
//! published, so that its error can be shown beside the recursion's: it is 0/0 behind an opaque
//! sample, and drifts with the optical depth.

use super::adjoint::{Entry, Pass, Weighted};
use super::kernel::{Emission, escape};
use crate::real::Real;

/// Blends the tape forward in `R`, then walks it backward by inversion.
#[inline(always)]
pub(super) fn backward<R: Real, E: Emission, const K: usize>(
    pass: &mut Pass<'_, '_, R>,
    tape: &[Entry<R, K>],
    weighted: Weighted,
) {
    let extinction = R::of(pass.dvr.medium.extinction);
    let segment = |entry: &Entry<R, K>| {
        let x = extinction * entry.moments.first;
        let alpha = -(-x).exp_m1();
        (x, alpha, extinction * E::integral(&entry.moments) * escape(x))
    };
    let mut opacity = R::ZERO;
    for entry in tape {
        let (_, alpha, _) = segment(entry);
        opacity += (R::ONE - opacity) * alpha;
    }
    let by_emitted = R::of(weighted.colour);
    let mut by_opacity = R::of(-weighted.background);
    for entry in tape.iter().rev() {
        let (x, alpha, emitted) = segment(entry);
        opacity = (opacity - alpha) / (R::ONE - alpha);
        let open = R::ONE - opacity;
        // emitted' = emitted + open · e(x, S),  opacity' = opacity + open · α(x)
        let by_alpha = open * by_opacity;
        let by_piece = open * by_emitted;
        by_opacity = by_opacity * (R::ONE - alpha) - by_emitted * emitted;
        let escape = escape(x);
        // e = S φ(x), φ' = (e^{-x} - φ) / x.
        let slope = if x > R::ZERO { ((R::ONE - alpha) - escape) / x } else { -R::of(0.5) };
        let source = extinction * E::integral(&entry.moments);
        let by_depth = by_alpha * (R::ONE - alpha) + by_piece * source * slope;
        pass.deposit::<E, K>(&entry.piece, &entry.moments, by_depth.f64(), (by_piece * escape).f64());
    }
}
