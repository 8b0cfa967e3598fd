//! The gradient of pre-integration by the ray: nodes move with it, and along it with the faces between which they lie.
//!
//! A node at world length t from the origin `o` of a ray of direction `d` lies at `o + t d`. With `∂L/∂p` the derivative by
//! its index coordinates, the ray has `∂L/∂p` by its own shift and `t ∂L/∂p` by its turn, and t has `d · ∂L/∂p`. Of a brick
//! that is entered at `t₀` and left at `t₁`, node j of n lies at `t₀ + (t₁ - t₀) j / n`, and all n segments are as long:
//! that is what is cotangents of its faces, which stand still. Derivatives are those of what is computed, as long as no ray has
//! more or fewer nodes; where it grazes faces these are left out.

use super::nodes::{Sites, parts};
use super::visit::{BatchGradient, Visit};
use crate::math::Aabb;
use crate::real::Real;
use crate::real::{LANES, Lanes};
use crate::render::index_ray_gradient::IndexRayGradient;
use crate::render::march::{IndexRay, spans};
use glam::DVec3;

/// What the loss asks of a node.
#[derive(Debug, Clone, Copy)]
pub(super) struct NodeCotangent {
    /// Derivatives of the density with respect to index coordinates.
    slopes: DVec3,
    /// Derivative of the loss by the density.
    by_density: f64,
    /// The same by the logarithm of the length of the segment that ends here.
    by_length: f64,
}

/// Notes what is cotangents of a visit's nodes, and of the last one before them.
#[inline(never)]
pub(super) fn note<R: Real>(
    cotangents: &mut Vec<NodeCotangent>,
    values: &[R],
    visit: &Visit<R>,
    by: &BatchGradient<R>,
) {
    if let Some(last) = cotangents.last_mut() {
        last.by_density += by.density[0].f64();
    }
    let first = cotangents.len();
    for (nodes, by_density) in visit.nodes.first(visit.fours).zip(by.density[1..].as_chunks::<LANES>().0) {
        let slopes = nodes.slopes(values).map(Lanes::store);
        cotangents.extend((0..LANES).map(|i| NodeCotangent {
            slopes: DVec3::from_array(slopes.map(|s| s[i].f64())),
            by_density: by_density[i].f64(),
            by_length: 0.0,
        }));
    }
    for (segment, by) in by.by_length(visit.batch.count).iter().enumerate() {
        cotangents[first + visit.batch.node(segment)].by_length += by.f64();
    }
}

/// Adds what nodes ask of the ray, near to far.
#[inline(never)]
pub(super) fn follow<R: Real>(
    sites: Sites<'_, R>,
    ray: &IndexRay,
    domain: &Aabb,
    cotangents: &[NodeCotangent],
    moved: &mut IndexRayGradient,
) {
    let voxels = R::of(ray.direction().length());
    let (mut left, mut reached) = (cotangents.iter(), f64::NEG_INFINITY);
    spans(sites.topology, ray, false, |span| {
        let ends = [span.start, span.end];
        let (mut by_ends, length) = ([0.0; 2], span.end - span.start);
        let mut add = |cotangents: &NodeCotangent, share: f64| {
            let (t, by) = (span.start + share * length, cotangents.by_density * cotangents.slopes);
            moved.shift += by;
            moved.turn += t * by;
            let along = by.dot(ray.direction());
            by_ends[0] += (1.0 - share) * along - cotangents.by_length / length;
            by_ends[1] += share * along + cotangents.by_length / length;
        };
        // Nothing lies before the first node of a brick that follows on none: its segment has no length.
        if span.start != reached
            && let Some(first) = left.next()
        {
            add(&NodeCotangent { by_length: 0.0, ..*first }, 0.0);
        }
        let parts = parts(&span, voxels, sites.density);
        for (number, cotangents) in (1..=parts).zip(left.by_ref()) {
            add(cotangents, number as f64 / parts as f64);
        }
        for (t, by) in ends.into_iter().zip(by_ends) {
            moved.add_face(ray.crossed(domain, t), t, by);
        }
        reached = span.end;
        !left.as_slice().is_empty()
    });
}
