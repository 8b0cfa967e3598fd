//! The gradient of pre-integration with respect to the ray: nodes move with the ray, and along it with the faces
//! between which they lie.
//!
//! A node at world length t from the origin `o` of a ray of direction `d` lies at `o + t d`. With `∂L/∂p` the
//! derivative with respect to its index coordinates, the derivatives with respect to the ray's shift and turn are
//! `∂L/∂p` and `t ∂L/∂p`, and that with respect to t is `d · ∂L/∂p`. In a brick that is entered at `t₀` and left at
//! `t₁`, node j of n lies at `t₀ + (t₁ - t₀) j / n`, and all n segments have the same length: this gives the
//! derivatives with respect to `t₀` and `t₁`, where the ray crosses faces that stand still. Derivatives are those of
//! the computed value, as long as the number of nodes does not change; where the ray grazes faces, the terms of the
//! faces are left out.

use super::nodes::{Sites, parts};
use super::visit::{BatchGradient, Visit};
use crate::math::Aabb;
use crate::real::Real;
use crate::real::{LANES, Lanes};
use crate::render::index_ray_gradient::IndexRayGradient;
use crate::render::march::{IndexRay, spans};
use glam::DVec3;

/// Derivatives of the loss with respect to one node.
#[derive(Debug, Clone, Copy)]
pub(super) struct NodeCotangent {
    /// Derivatives of the density with respect to index coordinates.
    slopes: DVec3,
    /// Derivative of the loss with respect to the density.
    by_density: f64,
    /// Derivative of the loss with respect to the logarithm of the length of the segment that ends at the node.
    by_length: f64,
}

/// Appends the cotangents of a visit's nodes, and adds to that of the last node before them.
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

/// Adds the nodes' derivatives to those with respect to the ray, near to far.
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
