//! Partition of rays among accumulators: each gets tiles of pictures of about equal cost, and the list of bricks that
//! their rays can cross.

use super::footprint::{Footprint, Lens};
use crate::render::order::Tiles;
use crate::scene::bricks::{Bricks, Voxel};
use crate::scene::camera::Camera;
use glam::DVec2;
use rayon::prelude::*;
use std::ops::Range;

/// A set of partitions, one bit each.
pub(crate) type Partitions = u32;

/// The largest number of partitions.
pub(super) const MOST_PARTITIONS: usize = 16;

/// Estimates how many bricks `rays` rays cross in all, as one and a half times the edge of a cube of the field's bricks
/// each.
pub(crate) fn bricks_crossed<V: Voxel>(field: &Bricks<V>, rays: usize) -> f64 {
    1.5 * rays as f64 * (field.topology.len() as f64).cbrt()
}

/// Returns the number of partitions for this many voxel lookups in a field, a power of two from 2 to 16: as many as pay
/// off (each accumulator is cleared and added, which must cost less than the rays do) and fit in memory. With `apart`,
/// partitions cross different parts of the field.
pub(crate) fn partitions<V: Voxel>(field: &Bricks<V>, lookups: f64, apart: bool) -> usize {
    let values = field.values.len().max(1);
    let pays = lookups / values as f64;
    // Together they see the field, and what lies between them twice: that grows with their borders.
    let pays = if apart { pays.max(3.0 * pays.sqrt()) } else { pays };
    let fits = (256 << 20) / (values * size_of::<V>());
    // A power of two: as many for each of two, four or eight threads.
    1 << (pays as usize).min(fits).clamp(2, MOST_PARTITIONS).ilog2()
}

/// A tile of a picture.
#[derive(Debug, Clone)]
pub struct Tile {
    /// The camera's number.
    pub picture: usize,
    /// The tile's.
    pub number: usize,
    /// Bricks that rays through it may look at, and those through earlier ones of the partition's do not.
    pub new: Vec<u32>,
}

/// Tiles and bricks of all partitions.
#[derive(Debug)]
pub struct Parts {
    /// Division into tiles, by camera.
    pub pictures: Vec<Tiles>,
    /// Tiles of each partition, in the order of work.
    pub tiles: Vec<Vec<Tile>>,
    /// Partitions whose rays can cross a brick, by brick.
    pub crossed_by: Vec<Partitions>,
}

/// Fixed cost of a ray, in units of a voxel lookup.
const RAY: f64 = 3.0;
/// Consecutive tiles that are dealt out together where no partition has a connected part of a picture.
const TOGETHER: usize = 8;

impl Parts {
    /// Divides the cameras' pictures among `partitions`. Each gets a part of a picture of its own, unless there are at
    /// least as many pictures or `apart` is false: then tiles are dealt out in turn, and all look at all bricks that
    /// any looks at.
    pub fn new<V: Voxel>(
        field: &Bricks<V>,
        lookups: &[f32],
        cameras: &[&Camera],
        partitions: usize,
        apart: bool,
    ) -> Self {
        let pictures: Vec<Tiles> = cameras.iter().map(|c| Tiles::new(c.width as usize, c.height as usize)).collect();
        let numbered = |(picture, tiles): (usize, &Tiles)| (0..tiles.count()).map(move |number| (picture, number));
        let all = pictures.iter().enumerate().flat_map(numbered);
        let mut parts =
            Self { pictures: Vec::new(), tiles: vec![Vec::new(); partitions], crossed_by: vec![0; lookups.len()] };
        if !apart || cameras.len() >= partitions {
            for (i, (picture, number)) in all.enumerate() {
                // Not from the same partition on in every round and picture: these may begin alike.
                let (turn, round) = (i / TOGETHER, i / (TOGETHER * partitions));
                parts.tiles[(turn + round + picture) % partitions].push(Tile { picture, number, new: Vec::new() });
            }
            let bricks = (0..lookups.len()).filter(|brick| lookups[*brick] > 0.0);
            bricks.for_each(|brick| (0..partitions).for_each(|partition| parts.record(brick, partition, 0)));
            return Self { pictures, ..parts };
        }
        let footprints: Vec<Vec<Footprint>> = cameras
            .par_iter()
            .map(|camera| {
                let (bricks, lens) = (field.topology.bricks().iter().zip(lookups), Lens::new(camera, &field.transform));
                let of = |brick| lens.footprint(brick);
                bricks.map(|(brick, lookups)| if *lookups > 0.0 { of(*brick) } else { Footprint::NOWHERE }).collect()
            })
            .collect();
        let costs: Vec<Vec<f64>> = pictures.par_iter().zip(&footprints).map(|(p, f)| costs(p, f, lookups)).collect();
        let total: f64 = costs.iter().flatten().sum();
        // By picture, and by row and column of its tiles: the partition, and what number it has there.
        let mut places: Vec<Vec<(usize, usize)>> = costs.iter().map(|costs| vec![(0, 0); costs.len()]).collect();
        let mut before = 0.0;
        for (picture, number) in all {
            let [column, row] = pictures[picture].place(number);
            let i = row * pictures[picture].columns + column;
            let partition = ((before + 0.5 * costs[picture][i]) / total * partitions as f64) as usize;
            let partition = partition.min(partitions - 1);
            before += costs[picture][i];
            places[picture][i] = (partition, parts.tiles[partition].len());
            parts.tiles[partition].push(Tile { picture, number, new: Vec::new() });
        }
        let mut first = vec![usize::MAX; partitions];
        for brick in 0..lookups.len() {
            first.fill(usize::MAX);
            for ((tiles, places), footprints) in pictures.iter().zip(&places).zip(&footprints) {
                Covered::new(tiles, &footprints[brick]).for_each(|i| {
                    let (partition, place) = places[i];
                    first[partition] = first[partition].min(place);
                });
            }
            let crossing = first.iter().enumerate().filter(|(_, place)| **place < usize::MAX);
            crossing.for_each(|(partition, place)| parts.record(brick, partition, *place));
        }
        Self { pictures, ..parts }
    }

    /// Records that a partition's tile, if there is one, is the first to cross a brick.
    fn record(&mut self, brick: usize, partition: usize, tile: usize) {
        if let Some(tile) = self.tiles[partition].get_mut(tile) {
            tile.new.push(brick as u32);
            self.crossed_by[brick] |= 1 << partition;
        }
    }
}

/// Estimates the cost of tiles in voxel lookups, by row and column.
fn costs(tiles: &Tiles, footprints: &[Footprint], lookups: &[f32]) -> Vec<f64> {
    let mut costs = vec![0.0; tiles.count()];
    let mut add = |footprint: &Footprint, each: f64| {
        let covered = Covered::new(tiles, footprint);
        // Those at its border as much as others: what one brick has too much there its neighbour has not.
        let share = each * covered.area / covered.count().max(1) as f64;
        covered.for_each(|i| costs[i] += share);
    };
    add(&Footprint::EVERYWHERE, RAY);
    // What may be anywhere says nothing about where it is.
    for (footprint, lookups) in footprints.iter().zip(lookups).filter(|(f, _)| f.low.is_finite()) {
        // Of a cube's surroundings about half is its own, and a way through it is two thirds of an edge long.
        add(footprint, f64::from(lookups / 3.0));
    }
    costs
}

/// Range of tiles that a footprint overlaps.
struct Covered {
    columns: Range<usize>,
    rows: Range<usize>,
    /// Area of the footprint within the picture, in square pixels.
    area: f64,
    /// Number of tiles in a row of the picture.
    across: usize,
}

impl Covered {
    #[inline]
    fn new(tiles: &Tiles, footprint: &Footprint) -> Self {
        let low = footprint.low.max(DVec2::ZERO);
        let high = footprint.high.min(DVec2::new(tiles.width as f64, tiles.height as f64));
        // Edges are powers of two: no rounding.
        let inverse = 1.0 / tiles.edge as f64;
        let along =
            |low: f64, high: f64, count: usize| (low * inverse) as usize..((high * inverse).ceil() as usize).min(count);
        let size = (high - low).max(DVec2::ZERO);
        Self {
            columns: along(low.x, high.x, tiles.columns),
            rows: along(low.y, high.y, tiles.rows),
            area: size.x * size.y,
            across: tiles.columns,
        }
    }

    fn count(&self) -> usize {
        self.columns.len() * self.rows.len()
    }

    /// Visits the tiles by their row-major index.
    #[inline]
    fn for_each(&self, mut visit: impl FnMut(usize)) {
        for row in self.rows.clone() {
            self.columns.clone().for_each(|column| visit(row * self.across + column));
        }
    }
}
