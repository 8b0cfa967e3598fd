//! Pre-integration (Engel, Kraus & Ertl 2001): the contribution of a transfer function between two densities is the
//! difference of cumulative tables, however many knots lie between.
//!
//! The density is sampled at nodes, where a ray crosses the faces of bricks and at points between, and interpolated
//! linearly from one to the next. The distance of nodes depends on the brick: it is chosen so that the interpolated
//! density errs by at most a small share of the range of the transfer function's knots.

mod adjoint;
mod batch;
mod by_table;
mod front;
mod nodes;
mod ray;
mod table;
mod tangent;
mod visit;

use super::Dvr;
use crate::real::Real;
use crate::render::curve::Curve;
use crate::render::integrator::Radiance;
use crate::render::march::IndexRay;
use crate::scene::bricks::{BRICK, CELLS, Topology};
use crate::scene::table::Table;
use batch::SegmentBatch;
use front::Front;
use nodes::{Nodes, Queue, Sites, nodes, roughness};
use ray::NodeCotangent;
use rayon::prelude::*;
use table::Cumulative;
pub(super) use tangent::VoxelSeeds;
use visit::{BatchGradient, Visit};

/// Cumulative tables of a transfer function, and the spacing of nodes in each brick of a field.
#[derive(Debug, Clone)]
pub(super) struct Preintegrated<R: Real> {
    tables: Cumulative<R>,
    /// Bricks that rays visit; elsewhere the density is zero, or nothing is absorbed.
    occupied: Topology,
    /// Nodes per voxel, by brick: reciprocals of the largest distances between nodes.
    density: Vec<R>,
    /// True if the medium absorbs at density zero, so that gaps between bricks count.
    gaps: bool,
}

/// Least and greatest distance between nodes, in voxels.
const DISTANCE: [f64; 2] = [0.5, 16.0];

impl<R: Real> Preintegrated<R> {
    /// Creates the tables of a transfer function whose extinctions are multiplied by `scale`, for a field of which the
    /// given bricks are visible; `tolerance` is the allowed error of the density between nodes, in units of the range
    /// of the knots.
    pub fn new(
        (table, scale): (&Table, f64),
        tolerance: f64,
        curve: &Curve<R, 3>,
        values: &[R],
        visible: &Topology,
    ) -> Self {
        let tables = Cumulative::new(table, scale, tolerance, curve);
        let gaps = table.at(0.0)[3] > 0.0;
        let bricks: Vec<(R, bool)> =
            values.par_chunks(BRICK).map(|v| (roughness(v), v.iter().any(|v| *v != R::ZERO))).collect();
        // Of a line between two points at a distance s of a curve whose second derivative is c: s² c / 8.
        let distance = |rough: f64| {
            let distance = (8.0 * tolerance * tables.range / rough.max(f64::MIN_POSITIVE)).sqrt();
            // Few different ones: a change of the density seldom changes the nodes.
            (2.0 * distance.clamp(DISTANCE[0], DISTANCE[1]).log2()).floor() * 0.5
        };
        let density = bricks.iter().map(|(rough, _)| R::of((-distance(rough.f64())).exp2())).collect();
        let occupied = visible.masked(|brick| !gaps || bricks[brick].1);
        Self { tables, occupied, density, gaps }
    }

    /// Returns the estimated number of nodes of a ray in a brick.
    pub fn lookups(&self, brick: usize) -> f32 {
        1.0 + (CELLS as f64 * self.density[brick].f64()) as f32
    }

    /// Returns the radiance along a ray.
    #[inline(always)]
    pub fn radiance(
        &self,
        dvr: &Dvr<'_, R>,
        curve: &Curve<R, 3>,
        ray: &IndexRay,
        scratch: &mut Scratch<R>,
    ) -> Radiance {
        let values = &dvr.field.values;
        let Scratch { queue, batch, .. } = scratch;
        let mut front = Front::new(&self.tables, curve);
        let sites = Sites { topology: &self.occupied, density: &self.density, gaps: self.gaps };
        let rest = nodes(
            sites,
            ray,
            queue,
            #[inline(always)]
            |queue, fours| {
                front.add(values, queue, fours, batch);
                front.depth < dvr.depth_limit
            },
        );
        if self.gaps && rest > 0.0 {
            front.add_gap(rest);
        }
        Radiance { rgb: front.emitted, depth: front.depth }
    }
}

/// Scratch memory of one thread.
#[derive(Debug, Clone, Default)]
pub(super) struct Scratch<R: Real> {
    queue: Box<Queue<R>>,
    batch: Box<SegmentBatch<R>>,
    gradient: Box<BatchGradient<R>>,
    tape: Vec<Visit<R>>,
    spare: Vec<Visit<R>>,
    cotangents: Vec<NodeCotangent>,
}
