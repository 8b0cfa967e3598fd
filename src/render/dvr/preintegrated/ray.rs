//! The gradient of pre-integration with respect to the ray: nodes move with the ray, and along it with the faces
//! between which they lie.
//!
//! A node at world length t from the origin `o` of a ray of direction `d` lies at `o + t d`. With `∂L/∂p` the
//! derivative with respect to its index coordinates, the derivatives with respect to the ray's shift and turn are
//! `∂L/∂p` and `t ∂L/∂p`, and that with respect to t is `d · ∂L/∂p`. In a brick or a cell that is entered at `t₀` and
//! left at `t₁`, a node lies at `t₀ + s (t₁ - t₀)` with a constant share s, and the segments' lengths have constant
//! shares as well: this gives the derivatives with respect to `t₀` and `t₁`, where the ray crosses faces that stand
//! still. Derivatives are those of the computed value, as long as the number of nodes does not change; where the ray
//! grazes faces, the terms of the faces are left out.

use super::deviation::Deviations;
use super::nodes::{BRICK_END, CELL_END, ROOM, Sites};
use super::visit::{BatchGradient, Visit};
use crate::math::Aabb;
use crate::real::Real;
use crate::real::{LANES, Lanes};
use crate::render::index_ray_gradient::IndexRayGradient;
use crate::render::march::{IndexRay, Span, spans};
use crate::render::segment::slopes;
use glam::DVec3;

/// Derivatives of the loss with respect to one node.
#[derive(Debug, Clone, Copy)]
pub(super) struct NodeCotangent {
    /// Derivatives of the density with respect to index coordinates.
    slopes: DVec3,
    /// Derivatives of the loss with respect to the node's index coordinates.
    by_place: DVec3,
    /// Derivative of the loss with respect to the logarithm of the length of the segment that ends at the node.
    by_length: f64,
    /// World length of the segment that ends at the node.
    length: f64,
    /// Position of the node in its interval, as [`Queue`](super::nodes::Queue) has it.
    share: f64,
}

/// Appends the cotangents of a visit's nodes, and adds to that of the last node before them.
#[inline(never)]
pub(super) fn note<R: Real>(
    cotangents: &mut Vec<NodeCotangent>,
    (values, deviations): (&[R], &Deviations<R>),
    visit: &Visit<R>,
    by: &BatchGradient<R>,
) {
    if let Some(last) = cotangents.last_mut() {
        last.by_place += by.density[0].f64() * last.slopes;
    }
    let shares = visit.nodes.shares(visit.batch.count);
    // Padding repeats the node before it.
    let mut places = [0; ROOM];
    for (n, nodes) in visit.nodes.first(visit.fours).enumerate() {
        let (corners, by_density) = (nodes.corners(values), &by.density[LANES * n + 1..]);
        let vector = |lanes: [[R; LANES]; 3], i: usize| DVec3::from_array(lanes.map(|lane| lane[i].f64()));
        let slopes = slopes(corners, nodes.at).map(Lanes::store);
        let [by_first, by_second] = deviations.cubic(&nodes).by_ends(&corners).map(|end| end.map(Lanes::store));
        let lengths = nodes.length.store();
        for i in 0..LANES {
            let (share, by_density) = (shares[LANES * n + i].f64(), by_density[i].f64());
            let (slopes, length) = (vector(slopes, i), lengths[i].f64());
            let by_deviation = by.deviation[LANES * n + i].f64();
            match cotangents.last_mut() {
                Some(last) if share < 0.0 => last.by_place += by_density * last.slopes,
                before => {
                    if let Some(before) = before {
                        before.by_place += by_deviation * vector(by_first, i);
                    }
                    let by_place = by_density * slopes + by_deviation * vector(by_second, i);
                    cotangents.push(NodeCotangent { slopes, by_place, by_length: 0.0, length, share });
                }
            }
            places[LANES * n + i] = cotangents.len() - 1;
        }
    }
    for (segment, by) in by.by_length(visit.batch.count).iter().enumerate() {
        cotangents[places[segment]].by_length += by.f64();
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
    let (mut left, mut reached) = (cotangents, f64::NEG_INFINITY);
    spans(sites.topology, ray, false, |span: Span<R>| {
        // Nothing lies before the first node of a brick that follows on none: its segment has no length.
        if span.start != reached
            && let Some((first, rest)) = left.split_first()
        {
            left = rest;
            let by = first.by_place;
            moved.shift += by;
            moved.turn += span.start * by;
            moved.add_face(ray.crossed(domain, span.start), span.start, by.dot(ray.direction()));
        }
        reached = span.end;
        let mut begin = span.start;
        while let Some(last) = left.iter().position(|node| node.share >= CELL_END) {
            let (nodes, rest) = left.split_at(last + 1);
            left = rest;
            let leaves = nodes[last].share >= BRICK_END;
            let end = if leaves { span.end } else { begin + nodes.iter().map(|node| node.length).sum::<f64>() };
            let (mut by_ends, length) = ([0.0; 2], end - begin);
            for node in nodes {
                let share = node.share.min(CELL_END);
                let (t, by) = (begin + share * length, node.by_place);
                moved.shift += by;
                moved.turn += t * by;
                let along = by.dot(ray.direction());
                // Of a cell that is touched at a corner nothing depends.
                let by_length = if length > 0.0 { node.by_length / length } else { 0.0 };
                by_ends[0] += (1.0 - share) * along - by_length;
                by_ends[1] += share * along + by_length;
            }
            for (t, by) in [begin, end].into_iter().zip(by_ends) {
                moved.add_face(ray.crossed(domain, t), t, by);
            }
            begin = end;
            if leaves {
                break;
            }
        }
        !left.is_empty()
    });
}
