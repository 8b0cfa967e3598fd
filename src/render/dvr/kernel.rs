//! Forward values: optical depth alone where the picture depends on nothing else, and front-to-back blending where the
//! source varies.

use super::Dvr;
use super::blend::{Blend, Entry};
use super::shade::{SegmentOptics, SegmentSource, Shade};
use crate::real::Lanes;
use crate::real::Real;
use crate::render::cell::Quartet;
use crate::render::curve::Curve;
use crate::render::integrator::Radiance;
use crate::render::march::{IndexRay, batches};
use crate::render::rule::{DepthRule, Rule};
use crate::scene::bricks::Topology;

/// Computes the optical depth along a ray. Inside a batch of bricks the sum runs in `R`, from batch to batch in `f64`.
/// The cells visited are appended to the tape; with `keep` false only those of the last batch remain.
#[inline(always)]
pub(super) fn depth<R: Real, Q: DepthRule<R>>(
    dvr: &Dvr<'_, R>,
    ray: &IndexRay,
    rule: Q,
    tape: &mut Vec<Quartet<R>>,
    keep: bool,
) -> Blend<0> {
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
                sum += cells.gather(values);
            }
            total += sum.sum().f64();
            last = spans[0].start;
            total < limit
        },
    );
    Blend { emitted: [], depth: dvr.medium.extinction * total, last }
}

/// Returns the radiance `L = c (1 - T)` of a grey source.
#[inline(always)]
pub(super) fn grey(depth: f64, color: [f32; 3]) -> Radiance {
    let opacity = -(-depth).exp_m1();
    Radiance { rgb: color.map(|c| f64::from(c) * opacity), depth }
}

/// Blends a ray's segments front to back. Optical depth and transmittance are carried in `f64`: differences of the
/// transmittance are the whole contribution of a source that does not vary. `record` receives each segment with its
/// optics and the transmittance before it, and `None` before the segments of each batch.
#[inline(always)]
pub(super) fn blend<R: Real, S: Shade<R>, Q: Rule<R, C, Segment = S>, const C: usize>(
    dvr: &Dvr<'_, R>,
    topology: &Topology,
    ray: &IndexRay,
    rule: Q,
    curve: &Curve<R, C>,
    segments: &mut Vec<S>,
    mut record: impl FnMut(Option<Entry<R, S>>),
) -> Blend<C> {
    let values = &dvr.field.values;
    let mut state = Blend { emitted: [0.0; C], depth: 0.0, last: ray.enter };
    let mut open = 1.0;
    batches(
        topology,
        ray,
        #[inline(always)]
        |spans| {
            segments.clear();
            rule.segments(curve, values, spans, segments);
            record(None);
            for segment in segments.iter() {
                let line = curve.piece(segment.piece());
                let light = segment.light(line);
                state.depth += light.depth.f64();
                let beyond = (-state.depth).exp();
                let (absorbed, varied) = (open - beyond, open * light.varied.f64());
                for c in 0..C {
                    let [at_base, slope] = line.source[c];
                    let mean = at_base + slope * (light.mean - line.base);
                    state.emitted[c] += mean.f64() * absorbed + slope.f64() * varied;
                }
                record(Some(Entry { segment: *segment, light, open }));
                open = beyond;
            }
            state.last = spans[0].start;
            state.depth < dvr.depth_limit
        },
    );
    state
}

/// Returns the loss-weighted light of one segment, as it arrives at the eye, from the transmittances before and behind
/// it.
#[inline(always)]
pub(super) fn arriving<R: Real>(glow: SegmentSource, light: &SegmentOptics<R>, before: f64, beyond: f64) -> f64 {
    glow.mean * (before - beyond) + glow.slope * before * light.varied.f64()
}
