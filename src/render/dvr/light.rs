//! What a segment of a ray does to light: value and derivative.

use crate::lanes::Lanes;
use crate::real::{Number, Real};
use crate::render::gauss;
use crate::render::segment::{Chord, Sample};

/// What a medium emits: radiance of its source over `colour`, as a function of the density.
pub(super) trait Emission: Copy {
    /// `c / colour`.
    fn source<N: Number>(density: N) -> N;
    /// Its derivative.
    fn slope<N: Number>(density: N) -> N;
}

/// `c = colour`.
#[derive(Clone, Copy)]
pub(super) struct Constant;

impl Emission for Constant {
    #[inline(always)]
    fn source<N: Number>(_: N) -> N {
        N::one()
    }
    #[inline(always)]
    fn slope<N: Number>(_: N) -> N {
        N::one() - N::one()
    }
}

/// `c = colour · d`.
#[derive(Clone, Copy)]
pub(super) struct Proportional;

impl Emission for Proportional {
    #[inline(always)]
    fn source<N: Number>(density: N) -> N {
        density
    }
    #[inline(always)]
    fn slope<N: Number>(_: N) -> N {
        N::one()
    }
}

/// Light of a segment.
#[derive(Debug, Clone, Copy)]
pub(super) struct Light<R: Real> {
    /// Optical depth.
    pub depth: R,
    /// Radiance that leaves it towards the eye, over `colour`.
    pub emitted: R,
    /// Transmittance from each point to the near end; from the far end for a sample.
    open: R::Lanes,
}

/// Derivatives of a loss.
pub(super) struct Slopes<R: Real> {
    /// With respect to the densities of the cell's corners, by x.
    pub corners: [R::Lanes; 2],
    /// With respect to the extinction, times the extinction.
    pub extinction: R,
}

/// A segment that light goes through.
pub(super) trait Lit<R: Real>: Copy {
    /// Offset of its cell.
    fn offset(&self) -> usize;
    /// Its light.
    fn light<E: Emission>(&self, extinction: R) -> Light<R>;
    /// The derivatives of a loss, from those with respect to depth and emitted radiance.
    fn slopes<E: Emission>(&self, extinction: R, light: &Light<R>, by_depth: R, by_emitted: R) -> Slopes<R>;
}

/// `x = σ l`, `e = c (1 - e^{-x})`.
impl<R: Real> Lit<R> for Sample<R> {
    #[inline(always)]
    fn offset(&self) -> usize {
        self.offset
    }

    #[inline(always)]
    fn light<E: Emission>(&self, extinction: R) -> Light<R> {
        let depth = extinction * self.length * self.density;
        let emitted = -(-depth).exp_m1() * E::source(self.density);
        Light { depth, emitted, open: R::Lanes::splat((-depth).exp()) }
    }

    #[inline(always)]
    fn slopes<E: Emission>(&self, extinction: R, light: &Light<R>, by_depth: R, by_emitted: R) -> Slopes<R> {
        let by_depth = by_depth + by_emitted * E::source(self.density) * light.open.store()[0];
        let by_source = by_emitted * -(-light.depth).exp_m1();
        let by_density = R::Lanes::splat(by_depth * extinction * self.length + by_source * E::slope(self.density));
        let corners = [by_density * self.weights[0], by_density * self.weights[1]];
        Slopes { corners, extinction: by_depth * light.depth }
    }
}

/// `x = Σ w_k x_k`, `e = Σ w_k x_k c_k e^{-τ_k}` with `x_k = σ_k l` and `τ_k = Σ_j a_kj x_j`: depths are
/// exact, and the error of `e` is bounded by [`gauss::error`].
impl<R: Real> Lit<R> for Chord<R> {
    #[inline(always)]
    fn offset(&self) -> usize {
        self.offset
    }

    #[inline(always)]
    fn light<E: Emission>(&self, extinction: R) -> Light<R> {
        let x = R::Lanes::splat(extinction * self.length) * self.density;
        let open = (-gauss::integrals_up_to::<R>(x)).exp();
        let shares = gauss::lanes::<R>(gauss::WEIGHTS) * x;
        Light { depth: shares.sum(), emitted: (shares * E::source(self.density) * open).sum(), open }
    }

    #[inline(always)]
    fn slopes<E: Emission>(&self, extinction: R, light: &Light<R>, by_depth: R, by_emitted: R) -> Slopes<R> {
        let (by_depth, by_emitted) = (R::Lanes::splat(by_depth), R::Lanes::splat(by_emitted));
        let length = R::Lanes::splat(extinction * self.length);
        let x = length * self.density;
        let weights = gauss::lanes::<R>(gauss::WEIGHTS);
        let arriving = by_emitted * light.open;
        let shares = weights * x * arriving;
        let source = E::source(self.density);
        let by_x = weights * (by_depth + arriving * source) - gauss::integrals_up_to_transposed::<R>(shares * source);
        let by_density = by_x * length + shares * E::slope(self.density);
        Slopes { corners: self.spread(by_density), extinction: (by_x * x).sum() }
    }
}
