//! Optics of a ray's segment: value and derivative.
//!
//! Within a segment extinction and source are linear in the density d, `σ = a + b d`, `c = c̄ + s (d - d̄)` with d̄ the
//! mean density. With `x` the segment's optical depth, `T` the transmittance before it and `q = ∫ σ (d - d̄) e^{-τ}`,
//! it adds `T (c̄ (1 - e^{-x}) + s q)`: a source that is constant needs no quadrature, and all channels share one.

use crate::dual::Dual;
use crate::real::Lanes;
use crate::real::Real;
use crate::render::curve::Piece;
use crate::render::gauss;
use crate::render::segment::{Chord, Sample};

/// Optical properties of a segment.
#[derive(Debug, Clone, Copy)]
pub(super) struct SegmentOptics<R: Real> {
    /// Optical depth x.
    pub depth: R,
    /// Mean density d̄.
    pub mean: R,
    /// Integral `q`, the part of the light that follows the density within the segment.
    pub varied: R,
    /// Transmittance from each quadrature point to the near end.
    transmittance: R::Lanes,
}

/// Source along a segment, of one channel or loss-weighted over all: its value at the mean density, and its slope with
/// the density.
#[derive(Debug, Clone, Copy)]
pub(super) struct SegmentSource {
    pub mean: f64,
    pub slope: f64,
}

impl SegmentSource {
    /// Computes the weighted sum of the channels' sources at mean density `mean`.
    #[inline(always)]
    pub(crate) fn new<R: Real, const C: usize>(piece: &Piece<R, C>, mean: R, weights: &[f64; C]) -> Self {
        let offset = (mean - piece.base).f64();
        let mut source = Self { mean: 0.0, slope: 0.0 };
        for (weight, [at_base, slope]) in weights.iter().zip(piece.source) {
            source.mean += weight * (at_base.f64() + slope.f64() * offset);
            source.slope += weight * slope.f64();
        }
        source
    }
}

/// Derivatives of a loss with respect to a segment's optics: its optical depth (which acts on the light that it lets
/// through and on its own emission), its source at the mean density, and `q` of a unit slope.
#[derive(Debug, Clone, Copy)]
pub(super) struct SegmentCotangent<R> {
    pub depth: R,
    pub mean: R,
    pub varied: R,
}

/// Derivatives of a loss with respect to a segment's densities, extinctions and length, at each of its points; a sample
/// has one point, in the first lane.
pub(super) struct SegmentGradient<R: Real> {
    /// Derivatives with respect to the densities.
    pub density: R::Lanes,
    /// Derivatives with respect to the extinctions.
    pub extinction: R::Lanes,
    /// Derivative with respect to the world length.
    pub length: R,
}

/// A segment of a ray with absorption and emission.
pub(super) trait Shade<R: Real>: Copy {
    /// Returns the number of the curve's piece that the segment lies in.
    fn piece(&self) -> u32;
    /// Returns the optics of the segment.
    fn segment_optics<const C: usize>(&self, piece: &Piece<R, C>) -> SegmentOptics<R>;
    /// Returns the derivatives of a loss; `slope` is that of the loss-weighted source with the density.
    fn vjp<const C: usize>(
        &self,
        piece: &Piece<R, C>,
        optics: &SegmentOptics<R>,
        slope: R,
        by: SegmentCotangent<R>,
    ) -> SegmentGradient<R>;
    /// Returns the densities at the segment's points.
    fn densities(&self) -> R::Lanes;
    /// Returns optical depth, mean density and `q` with their derivatives, from the densities at the segment's points,
    /// and the extinctions there times the segment's length.
    fn jvp<const P: usize>(&self, density: Dual<R::Lanes, P>, depths: Dual<R::Lanes, P>) -> [Dual<R, P>; 3];
}

/// `x = σ l`, `q = 0`.
impl<R: Real> Shade<R> for Sample<R> {
    #[inline(always)]
    fn piece(&self) -> u32 {
        self.piece
    }

    #[inline(always)]
    fn segment_optics<const C: usize>(&self, piece: &Piece<R, C>) -> SegmentOptics<R> {
        let extinction = piece.extinction[0] + piece.extinction[1] * (self.density - piece.base);
        let zero = R::Lanes::splat(R::ZERO);
        SegmentOptics { depth: extinction * self.length, mean: self.density, varied: R::ZERO, transmittance: zero }
    }

    #[inline(always)]
    fn vjp<const C: usize>(
        &self,
        piece: &Piece<R, C>,
        _: &SegmentOptics<R>,
        slope: R,
        by: SegmentCotangent<R>,
    ) -> SegmentGradient<R> {
        let extinction = piece.extinction[0] + piece.extinction[1] * (self.density - piece.base);
        let by_extinction = by.depth * self.length;
        let by_density = by_extinction * piece.extinction[1] + by.mean * slope;
        let first = |v: R| R::Lanes::load([v, R::ZERO, R::ZERO, R::ZERO]);
        SegmentGradient { density: first(by_density), extinction: first(by_extinction), length: by.depth * extinction }
    }

    #[inline(always)]
    fn densities(&self) -> R::Lanes {
        R::Lanes::splat(self.density)
    }

    #[inline(always)]
    fn jvp<const P: usize>(&self, density: Dual<R::Lanes, P>, depths: Dual<R::Lanes, P>) -> [Dual<R, P>; 3] {
        let first = |v: Dual<R::Lanes, P>| v.linear(|v| v.store()[0]);
        [first(depths), first(density), Dual::constant(R::ZERO)]
    }
}

/// `x = Σ w_k x_k`, `q = Σ w_k x_k (d_k - d̄) e^{-τ_k}` with `x_k = σ_k l`, `τ_k = Σ_j a_kj x_j` and
/// `d̄ = Σ w_k d_k`: depths are exact, and the error of `q` is bounded by [`gauss::error`].
impl<R: Real> Shade<R> for Chord<R> {
    #[inline(always)]
    fn piece(&self) -> u32 {
        self.piece
    }

    #[inline(always)]
    fn segment_optics<const C: usize>(&self, piece: &Piece<R, C>) -> SegmentOptics<R> {
        let all = <R::Lanes as Lanes<R>>::splat;
        let weights = gauss::lanes::<R>(gauss::WEIGHTS);
        let x = self.depths(piece);
        let transmittance = (-gauss::integrals_up_to::<R>(x)).exp();
        let shares = weights * x;
        let mean = (weights * self.density).sum();
        SegmentOptics {
            depth: shares.sum(),
            mean,
            varied: (shares * (self.density - all(mean)) * transmittance).sum(),
            transmittance,
        }
    }

    #[inline(always)]
    fn vjp<const C: usize>(
        &self,
        piece: &Piece<R, C>,
        optics: &SegmentOptics<R>,
        slope: R,
        by: SegmentCotangent<R>,
    ) -> SegmentGradient<R> {
        let all = <R::Lanes as Lanes<R>>::splat;
        let weights = gauss::lanes::<R>(gauss::WEIGHTS);
        let x = self.depths(piece);
        let arriving = all(by.varied * slope) * optics.transmittance;
        let shares = weights * x * arriving;
        let offset = self.density - all(optics.mean);
        let by_x =
            weights * (all(by.depth) + arriving * offset) - gauss::integrals_up_to_transposed::<R>(shares * offset);
        // The mean density is where the source is taken, and what q measures from.
        let by_mean = all(by.mean * slope - shares.sum()) * weights;
        let length = all(self.length);
        let density = by_x * (length * all(piece.extinction[1])) + shares + by_mean;
        let inverse = R::ONE / self.length;
        SegmentGradient { density, extinction: by_x * length, length: (by_x * x).sum() * inverse }
    }

    #[inline(always)]
    fn densities(&self) -> R::Lanes {
        self.density
    }

    #[inline(always)]
    fn jvp<const P: usize>(&self, density: Dual<R::Lanes, P>, depths: Dual<R::Lanes, P>) -> [Dual<R, P>; 3] {
        let weights = gauss::lanes::<R>(gauss::WEIGHTS);
        let sum = |v: Dual<R::Lanes, P>| v.linear(Lanes::sum);
        let closed = -depths.linear(gauss::integrals_up_to::<R>);
        let transmittance = closed.value.exp();
        let transmittance = closed.function(transmittance, transmittance);
        let shares = depths.linear(|x| weights * x);
        let mean = sum(density.linear(|d| weights * d));
        [sum(shares), mean, sum(shares * (density - mean.linear(R::Lanes::splat)) * transmittance)]
    }
}

impl<R: Real> Chord<R> {
    /// Extinction times the length, at each point.
    #[inline(always)]
    fn depths<const C: usize>(&self, piece: &Piece<R, C>) -> R::Lanes {
        let all = <R::Lanes as Lanes<R>>::splat;
        let [at_base, slope] = piece.extinction;
        all(self.length) * (all(at_base) + all(slope) * (self.density - all(piece.base)))
    }
}
