//! Pre-integration (Engel, Kraus & Ertl 2001): the contribution of a transfer function between two densities is the
//! difference of cumulative tables, however many knots lie between.
//!
//! The density is sampled at nodes, where a ray crosses the faces of bricks and at points between, and interpolated
//! linearly from one to the next. The distance of nodes depends on the brick, by an estimate; a bound of the error
//! that each segment causes then adds nodes where they are needed, so that the error of a pixel stays below the
//! tolerance ([`bound`]). Rays on which it does not are left to exact quadrature.

mod adjoint;
mod batch;
mod bound;
mod by_table;
mod deviation;
mod errors;
mod front;
mod nodes;
mod ray;
mod table;
mod tangent;
mod variation;
mod visit;

use super::Dvr;
use crate::real::{Lanes, Real};
use crate::render::curve::Curve;
use crate::render::emission_absorption::Radiance;
use crate::render::march::IndexRay;
use crate::scene::bricks::{BRICK, Bricks, CELLS, Topology};
use crate::scene::table::Table;
use batch::SegmentBatch;
use bound::ATTEMPTS;
use deviation::Deviations;
use front::Front;
use nodes::{Divided, Nodes, Queue, Sites, Spacing, nodes, roughness};
use ray::NodeCotangent;
use rayon::prelude::*;
use std::sync::Arc;
use table::Cumulative;
pub(super) use tangent::VoxelSeeds;
use visit::{BatchGradient, Visit};

/// Cumulative tables of a transfer function, and the spacing of nodes in each brick of a field.
#[derive(Debug, Clone)]
pub(super) struct Preintegrated<R: Real> {
    tables: Cumulative<R>,
    /// Bricks that rays visit; see [`Dvr::occupied`].
    occupied: Arc<Topology>,
    /// Spacing of nodes, by brick.
    spacing: Vec<Spacing<R>>,
    /// True if the medium absorbs at the background, so that gaps between bricks count.
    gaps: bool,
}

/// Least and greatest distance between nodes, in voxels, that divide the interval in a brick evenly.
const DISTANCE: [f64; 2] = [1.0, 16.0];
/// Share of a ray's tolerance that the nodes of one brick may use up, as far as can be foreseen.
const OF_BRICK: f64 = 1.0 / 8.0;
/// Distances between nodes, in voxels, at which derivatives with respect to single voxels are told apart, where a brick
/// has one value and where it has several.
const BY_VOXELS: [f64; 2] = [0.5, DISTANCE[0]];
/// Slope of a transfer function, in units of its steepest among a field's densities, up to which they need not be:
/// those of a few voxels in a row are one.
const NEGLIGIBLE: f64 = 1e-3;

impl<R: Real> Preintegrated<R> {
    /// Creates the tables of a transfer function whose extinctions are multiplied by `scale`, for a field with the
    /// least and greatest values of its bricks, and those that rays visit ([`Dvr::occupied`]), with whether gaps
    /// between these count; `tolerance` is the error allowed along a ray, in units of the brightest color. With
    /// `by_voxels` rays have a node a voxel, or two, wherever the light depends on voxels.
    pub(crate) fn new(
        (table, scale): (&Table, f64),
        tolerance: f64,
        curve: &Curve<R, 3>,
        (field, ranges, by_voxels): (&Bricks<R>, &[[R; 2]], bool),
        (occupied, gaps): (Arc<Topology>, bool),
    ) -> Self {
        let background = field.background;
        let both = |[a, b]: [R; 2], [low, high]: &[R; 2]| [a.lesser(*low), b.greater(*high)];
        let range = ranges.iter().fold([background; 2], both).map(Real::f64);
        let tables = Cumulative::new((table, scale), tolerance, curve, range, background);
        let voxel = field.transform.voxel_size().max_element();
        let brightest = table.peak()[..3].iter().fold(f64::MIN_POSITIVE, |a, b| a.max(*b));
        let steepest = table.steepest(range[0], table.above(range[1]), brightest);
        let least = if steepest.is_finite() { NEGLIGIBLE * steepest } else { 0.0 };
        let depends = |low: R, high: R| table.steepest(low.f64(), table.above(high.f64()), brightest) > least;
        let spacing = |(values, [low, high]): (&[R], &[R; 2])| {
            let (low, high) = (*low, *high);
            // Many bricks of a sparse volume are empty.
            let roughness = if low == high { [R::ZERO; 2] } else { roughness(values) };
            let varied = tables.variation.between(R::Lanes::splat(low), R::Lanes::splat(high));
            let [depth, shift] = [varied.extinction, varied.shift].map(|lanes| lanes.store()[0].f64());
            let error = |h: f64| {
                let both = 2.0 * Deviations::<R>::bound(roughness.map(Real::f64), h);
                let share = both / both.max((high - low).f64()).max(f64::MIN_POSITIVE);
                CELLS as f64 * voxel * (depth + shift) * share
            };
            // Few different distances: a change of the density seldom changes the nodes.
            let halves = (DISTANCE[1] / DISTANCE[0]).log2() as i32 * 2 + 1;
            let distances = (0..halves).map(|k| DISTANCE[1] * (-0.5 * f64::from(k)).exp2());
            let distance = distances.into_iter().find(|h| error(*h) <= OF_BRICK * tolerance);
            let nearest = BY_VOXELS[usize::from(low < high)];
            let narrow = |h: f64| by_voxels && h > nearest && depends(low, high);
            let distance = distance.map(|h| if narrow(h) { nearest } else { h });
            Spacing { density: R::of(distance.map_or(0.0, f64::recip)), roughness }
        };
        let spacing = field.values.par_chunks(BRICK).zip(ranges).map(spacing).collect();
        Self { tables, occupied, spacing, gaps }
    }

    /// Returns the estimated number of nodes of a ray in a brick.
    pub(crate) fn lookups(&self, brick: usize) -> f32 {
        // Of an average direction, which crosses 1.5 faces a voxel.
        let density = self.spacing[brick].density.f64();
        1.0 + (CELLS as f64 * if density > 0.0 { density } else { 1.5 }) as f32
    }

    /// Returns the radiance along a ray; `None` if its error may exceed the tolerance.
    #[inline(always)]
    pub(crate) fn radiance(
        &self,
        dvr: &Dvr<'_, R>,
        curve: &Curve<R, 3>,
        ray: &IndexRay,
        scratch: &mut Scratch<R>,
    ) -> Option<Radiance> {
        let values = &dvr.field.values;
        let Scratch { queue, divided, batch, .. } = scratch;
        let sites = Sites { topology: &self.occupied, spacing: &self.spacing, gaps: self.gaps };
        for attempt in 0..ATTEMPTS {
            let mut front = Front::new(&self.tables, curve, (ray, dvr.depth_limit), attempt);
            let rest = nodes(
                sites,
                ray,
                queue,
                #[inline(always)]
                |queue, fours| {
                    front.add(values, (queue, fours), divided, batch, |_, _, _, _| ());
                    front.goes_on() && front.is_accurate()
                },
            );
            if front.is_accurate() {
                if self.gaps && rest > 0.0 {
                    front.add_gap(rest);
                }
                return Some(Radiance { rgb: front.emitted, depth: front.depth });
            }
        }
        None
    }
}

/// Scratch memory of one thread.
#[derive(Debug, Clone, Default)]
pub(super) struct Scratch<R: Real> {
    queue: Box<Queue<R>>,
    divided: Divided<R>,
    batch: Box<SegmentBatch<R>>,
    gradient: Box<BatchGradient<R>>,
    tape: Vec<Visit<R>>,
    spare: Vec<Visit<R>>,
    cotangents: Vec<NodeCotangent>,
}
