//! The value: optical depth alone where the picture depends on nothing else, and front-to-back
//! blending where the source varies.

use super::{Dvr, Radiance};
use crate::lanes::Lanes;
use crate::real::Real;
use crate::render::cell::{Piece, Quartet, corners, gather};
use crate::render::march::{IndexRay, batches};
use crate::render::rule::{DepthRule, GAUSS4, Rule};

/// What a medium emits: the integral of `c / colour` against extinction, and its derivative.
pub(super) trait Emission: Copy {
    /// `∫ d c dt / colour` from the moments of a piece.
    fn integral<R: Real, const K: usize>(m: &Moments<R, K>) -> R;
    /// Derivative of `d c / colour` with respect to the density.
    fn slope<R: Real>(density: R) -> R;
}

/// `c = colour`.
#[derive(Clone, Copy)]
pub(super) struct Constant;

impl Emission for Constant {
    #[inline(always)]
    fn integral<R: Real, const K: usize>(m: &Moments<R, K>) -> R {
        m.first
    }
    #[inline(always)]
    fn slope<R: Real>(_: R) -> R {
        R::ONE
    }
}

/// `c = colour · d`.
#[derive(Clone, Copy)]
pub(super) struct Proportional;

impl Emission for Proportional {
    #[inline(always)]
    fn integral<R: Real, const K: usize>(m: &Moments<R, K>) -> R {
        m.second
    }
    #[inline(always)]
    fn slope<R: Real>(density: R) -> R {
        density + density
    }
}

/// `∫ d dt` over a piece and `∫ d² dt`, with the node densities for the derivative.
#[derive(Debug, Clone, Copy)]
pub(super) struct Moments<R, const K: usize> {
    /// `∫ d dt`.
    pub first: R,
    /// `∫ d² dt`.
    pub second: R,
    /// Density at each node.
    pub density: [R; K],
}

/// Quadrature weight of node `k` of `K` on a unit interval.
#[inline(always)]
pub(super) fn node_weight<R: Real, const K: usize>(k: usize) -> R {
    R::of(if K == 1 { 1.0 } else { GAUSS4[k].1 })
}

impl<R: Real, const K: usize> Moments<R, K> {
    #[inline(always)]
    pub(super) fn of(values: &[R], piece: &Piece<R, K>) -> Self {
        let v = corners(values, piece.offset);
        let density: [R; K] = std::array::from_fn(|k| gather(&piece.nodes[k], &v));
        let (mut first, mut second) = (R::ZERO, R::ZERO);
        for (k, d) in density.iter().enumerate() {
            let w = piece.length * node_weight::<R, K>(k);
            first += w * *d;
            second += w * *d * *d;
        }
        Self { first, second, density }
    }
}

/// `(1 - e^{-x}) / x`: how much of a segment's source gets out of it. Finite at zero.
#[inline(always)]
pub(super) fn escape<R: Real>(x: R) -> R {
    if x > R::ZERO { -(-x).exp_m1() / x } else { R::ONE }
}

/// Optical depth along a ray. Inside a batch of bricks the sum runs in `R`, from batch to batch in
/// `f64`. Cells are appended to `tape`, which `after` sees at the end of each batch.
#[inline(always)]
pub(super) fn depth<R: Real, Q: DepthRule<R>>(
    dvr: &Dvr<'_, R>,
    ray: &IndexRay,
    rule: Q,
    tape: &mut Vec<Quartet<R>>,
    mut after: impl FnMut(&mut Vec<Quartet<R>>),
) -> f64 {
    let values = &dvr.field.values;
    let limit = dvr.depth_limit / dvr.medium.extinction;
    let mut total = 0.0;
    batches(
        &dvr.field.topology,
        ray,
        false,
        #[inline(always)]
        |spans| {
            let first = tape.len();
            rule.cells(spans, tape);
            let mut sum = R::Lanes::splat(R::ZERO);
            for cells in &tape[first..] {
                sum = sum + cells.gather(values);
            }
            total += sum.sum().f64();
            after(tape);
            total < limit
        },
    );
    dvr.medium.extinction * total
}

/// `L = c (1 - T) + T · background`.
#[inline(always)]
pub(super) fn grey<R: Real>(depth: f64, colour: [f32; 3], background: [f32; 3]) -> Radiance<R> {
    over(-(-depth).exp_m1(), (-depth).exp(), colour, background)
}

/// `L = colour · emitted + T · background`.
#[inline(always)]
pub(super) fn over<R: Real>(emitted: f64, transmittance: f64, colour: [f32; 3], background: [f32; 3]) -> Radiance<R> {
    let channel = |c: usize| R::of(f64::from(colour[c]) * emitted + f64::from(background[c]) * transmittance);
    Radiance { rgb: std::array::from_fn(channel), transmittance: R::of(transmittance) }
}

/// The state of front-to-back blending at the end of a ray.
#[derive(Debug, Clone, Copy)]
pub(super) struct Blend {
    /// `∫ T σ c dt / colour`.
    pub emitted: f64,
    /// Optical depth.
    pub depth: f64,
    /// Where the ray ended: its exit, or the brick in which it became opaque.
    pub end: f64,
}

/// Front-to-back blending; the optical depth is carried in `f64`. `record` sees every piece with its
/// moments.
#[inline(always)]
pub(super) fn blend<R: Real, E: Emission, const K: usize, Q: Rule<R, K>>(
    dvr: &Dvr<'_, R>,
    ray: &IndexRay,
    rule: Q,
    _: E,
    pieces: &mut Vec<Piece<R, K>>,
    mut record: impl FnMut(&Piece<R, K>, &Moments<R, K>),
) -> Blend {
    let values = &dvr.field.values;
    let extinction = R::of(dvr.medium.extinction);
    let mut state = Blend { emitted: 0.0, depth: 0.0, end: ray.leave };
    batches(
        &dvr.field.topology,
        ray,
        false,
        #[inline(always)]
        |spans| {
            pieces.clear();
            rule.pieces(values, spans, pieces);
            for piece in pieces.iter() {
                let m = Moments::of(values, piece);
                let x = extinction * m.first;
                state.emitted += (-state.depth).exp() * (extinction * E::integral(&m) * escape(x)).f64();
                state.depth += x.f64();
                record(piece, &m);
            }
            let open = state.depth < dvr.depth_limit;
            if let (false, Some(last)) = (open, spans.last()) {
                state.end = last.end;
            }
            open
        },
    );
    state
}
