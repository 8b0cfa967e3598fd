//! Front-to-back compositing of a ray's segments, and the way back: one driver for every kind of segment.
//!
//! A [`Compositing`] adds the segments of one batch of bricks behind all before. The functions of this module walk a
//! ray with it: [`value`] for the result alone, [`each`] with a look at every segment, [`record`] with a tape for the
//! backward pass. A [`Backward`] then takes the tape far to near in [`backward`]; with [`Adjoint::Replay`] the tape
//! holds the last batch alone, and the batches before it are computed a second time.
//!
//! Pre-integration has a driver of its own: its segments share their ends and cross the borders of batches.

use crate::real::Real;
use crate::render::differentiable::Adjoint;
use crate::render::march::{IndexRay, Span, batches, batches_before};
use crate::scene::bricks::Topology;

/// State of front-to-back compositing along one ray.
pub(super) trait Compositing<R: Real> {
    /// A segment with all that the backward pass needs of it.
    type Entry;

    /// Composites the segments of a batch of spans behind those before, and with `KEEP` appends them to the tape, near
    /// to far; without, the tape is scratch memory. Returns false if the ray ends here.
    fn composite<const KEEP: bool>(&mut self, spans: &[Span<R>], tape: &mut Vec<Self::Entry>) -> bool;
}

/// State of the backward pass along one ray.
pub(super) trait Backward<R: Real> {
    /// A segment with all that the backward pass needs of it.
    type Entry;

    /// Adds the derivatives of segments that lie in front of those added before; they are given near to far.
    fn add(&mut self, tape: &[Self::Entry]);

    /// Computes the segments of a batch of spans a second time and adds their derivatives; `tape` is scratch memory.
    fn replay(&mut self, spans: &[Span<R>], tape: &mut Vec<Self::Entry>);
}

/// Composites a whole ray; `scratch` is left with any content.
#[inline(always)]
pub(super) fn value<R: Real, K: Compositing<R>>(
    topology: &Topology,
    ray: &IndexRay,
    front: &mut K,
    scratch: &mut Vec<K::Entry>,
) {
    batches(
        topology,
        ray,
        #[inline(always)]
        |spans| {
            scratch.clear();
            front.composite::<false>(spans, scratch)
        },
    );
}

/// Composites a whole ray, and visits its segments near to far; `scratch` is left with any content.
#[inline(always)]
pub(super) fn each<R: Real, K: Compositing<R>>(
    topology: &Topology,
    ray: &IndexRay,
    front: &mut K,
    scratch: &mut Vec<K::Entry>,
    mut visit: impl FnMut(&K::Entry),
) {
    batches(
        topology,
        ray,
        #[inline(always)]
        |spans| {
            scratch.clear();
            let more = front.composite::<true>(spans, scratch);
            scratch.iter().for_each(&mut visit);
            more
        },
    );
}

/// Composites a whole ray and appends its segments to the tape: all of them, or with [`Adjoint::Replay`] those of the
/// last batch alone. Returns the world length from the ray's origin at which the last batch begins.
#[inline(always)]
pub(super) fn record<R: Real, K: Compositing<R>>(
    topology: &Topology,
    ray: &IndexRay,
    adjoint: Adjoint,
    front: &mut K,
    tape: &mut Vec<K::Entry>,
) -> f64 {
    let mut last = ray.enter;
    batches(
        topology,
        ray,
        #[inline(always)]
        |spans| {
            if adjoint == Adjoint::Replay {
                tape.clear();
            }
            last = spans[0].start;
            front.composite::<true>(spans, tape)
        },
    );
    last
}

/// Runs the backward pass over the tape of [`record`], whose last batch begins at world length `last`, and clears the
/// tape.
#[inline(always)]
pub(super) fn backward<R: Real, B: Backward<R>>(
    topology: &Topology,
    ray: &IndexRay,
    (adjoint, last): (Adjoint, f64),
    back: &mut B,
    tape: &mut Vec<B::Entry>,
) {
    back.add(tape);
    if adjoint == Adjoint::Replay {
        batches_before(
            topology,
            ray,
            last,
            #[inline(always)]
            |spans| {
                tape.clear();
                back.replay(spans, tape);
            },
        );
    }
    tape.clear();
}
