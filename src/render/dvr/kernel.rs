//! The value: optical depth alone where the picture depends on nothing else, and front-to-back
//! blending where the source varies.

use super::light::{Emission, Light, Lit};
use super::{Dvr, Radiance};
use crate::lanes::Lanes;
use crate::real::Real;
use crate::render::cell::Quartet;
use crate::render::march::{IndexRay, batches};
use crate::render::rule::{DepthRule, Rule};

/// What is found along a ray.
#[derive(Debug, Clone, Copy)]
pub(super) struct Blend {
    /// `∫ T σ c dt / colour`; zero where only the depth is asked for.
    pub emitted: f64,
    /// Optical depth.
    pub depth: f64,
    /// Where the last batch of bricks begins.
    pub last: f64,
}

/// Optical depth along a ray. Inside a batch of bricks the sum runs in `R`, from batch to batch in
/// `f64`. The cells stay on the tape, all that are appended to it or (`keep` false) the last batch's.
#[inline(always)]
pub(super) fn depth<R: Real, Q: DepthRule<R>>(
    dvr: &Dvr<'_, R>,
    ray: &IndexRay,
    rule: Q,
    tape: &mut Vec<Quartet<R>>,
    keep: bool,
) -> Blend {
    let values = &dvr.field.values;
    let limit = dvr.depth_limit / dvr.medium.extinction;
    let (mut total, mut last) = (0.0, ray.enter);
    batches(
        &dvr.field.topology,
        ray,
        #[inline(always)]
        |spans| {
            if !keep {
                tape.clear();
            }
            let first = tape.len();
            rule.cells(spans, tape);
            let mut sum = R::Lanes::splat(R::ZERO);
            for cells in &tape[first..] {
                sum = sum + cells.gather(values);
            }
            total += sum.sum().f64();
            last = spans[0].start;
            total < limit
        },
    );
    Blend { emitted: 0.0, depth: dvr.medium.extinction * total, last }
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

/// Front-to-back blending; the optical depth is carried in `f64`. `record` sees every segment with its
/// light, and `None` before those of a batch.
#[inline(always)]
pub(super) fn blend<R: Real, E: Emission, S: Lit<R>, Q: Rule<R, Segment = S>>(
    dvr: &Dvr<'_, R>,
    ray: &IndexRay,
    rule: Q,
    _: E,
    segments: &mut Vec<S>,
    mut record: impl FnMut(Option<(&S, &Light<R>)>),
) -> Blend {
    let values = &dvr.field.values;
    let extinction = R::of(dvr.medium.extinction);
    let mut state = Blend { emitted: 0.0, depth: 0.0, last: ray.enter };
    batches(
        &dvr.field.topology,
        ray,
        #[inline(always)]
        |spans| {
            segments.clear();
            rule.segments(values, spans, segments);
            record(None);
            for segment in segments.iter() {
                let light = segment.light::<E>(extinction);
                state.emitted += (-state.depth).exp() * light.emitted.f64();
                state.depth += light.depth.f64();
                record(Some((segment, &light)));
            }
            state.last = spans[0].start;
            state.depth < dvr.depth_limit
        },
    );
    state
}
