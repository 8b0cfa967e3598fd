//! How rays are shared out: to each lane tiles of pictures that take about as long as another's, and the bricks that
//! the rays through them can meet.

use super::footprint::Footprint;
use crate::render::order::Tiles;
use crate::scene::bricks::Bricks;
use crate::scene::camera::Camera;
use glam::DVec2;
use rayon::prelude::*;

/// A bit for each lane.
pub type Lanes = u32;

/// The parts of all lanes.
#[derive(Debug)]
pub struct Parts {
    /// By lane: the camera's number and the tile's.
    pub tiles: Vec<Vec<(usize, usize)>>,
    /// By brick: the lanes whose rays can look at it.
    pub seen_by: Vec<Lanes>,
}

/// What a ray costs beyond looking up densities, each of which costs 1.
const RAY: f64 = 3.0;
/// Tiles that follow one another where no lane has a part of a picture of its own.
const TOGETHER: usize = 8;

impl Parts {
    /// Of the cameras' pictures, for so many lanes. Each has a part of a picture of its own, unless there are at least as
    /// many pictures or `apart` is false: then tiles are dealt out in turn, and all look at all bricks that any looks at.
    pub fn new(field: &Bricks<f32>, lookups: &[f32], cameras: &[&Camera], lanes: usize, apart: bool) -> Self {
        let pictures: Vec<Tiles> = cameras.iter().map(|c| Tiles::new(c.width as usize, c.height as usize)).collect();
        let numbered = |(number, tiles): (usize, &Tiles)| (0..tiles.count()).map(move |tile| (number, tile));
        let tiles = pictures.iter().enumerate().flat_map(numbered);
        let mut parts = Self { tiles: vec![Vec::new(); lanes], seen_by: vec![0; lookups.len()] };
        if !apart || cameras.len() >= lanes {
            for (i, (number, tile)) in tiles.enumerate() {
                // Not from the same lane on in every round and picture: these may begin alike.
                let (turn, round) = (i / TOGETHER, i / (TOGETHER * lanes));
                parts.tiles[(turn + round + number) % lanes].push((number, tile));
            }
            parts.see(|brick| if lookups[brick] > 0.0 { !0 } else { 0 });
            return parts;
        }
        let footprints: Vec<Vec<Footprint>> = cameras
            .iter()
            .map(|camera| {
                let bricks = field.topology.bricks().par_iter().zip(lookups);
                let of = |brick| Footprint::new(camera, &field.transform, brick);
                bricks.map(|(brick, lookups)| if *lookups > 0.0 { of(*brick) } else { Footprint::NOWHERE }).collect()
            })
            .collect();
        let costs: Vec<Vec<f64>> = pictures.par_iter().zip(&footprints).map(|(p, f)| costs(p, f, lookups)).collect();
        let total: f64 = costs.iter().flatten().sum();
        // By picture, and by row and column of its tiles.
        let mut owners: Vec<Vec<Lanes>> = costs.iter().map(|costs| vec![0; costs.len()]).collect();
        let mut before = 0.0;
        for (number, tile) in tiles {
            let [column, row] = pictures[number].place(tile);
            let i = row * pictures[number].columns + column;
            let lane = ((before + 0.5 * costs[number][i]) / total * lanes as f64) as usize;
            let lane = lane.min(lanes - 1);
            before += costs[number][i];
            owners[number][i] = 1 << lane;
            parts.tiles[lane].push((number, tile));
        }
        parts.see(|brick| {
            let by_picture = pictures.iter().zip(&owners).zip(&footprints);
            let seen_by =
                by_picture.map(|((tiles, owners), f)| covered(tiles, &f[brick]).fold(0, |s, (i, _)| s | owners[i]));
            seen_by.fold(0, |all, some| all | some)
        });
        parts
    }

    fn see(&mut self, by: impl Fn(usize) -> Lanes + Sync) {
        self.seen_by.par_iter_mut().enumerate().with_min_len(64).for_each(|(brick, seen_by)| *seen_by = by(brick));
    }
}

/// What tiles cost, by row and column.
fn costs(tiles: &Tiles, footprints: &[Footprint], lookups: &[f32]) -> Vec<f64> {
    let mut costs = vec![0.0; tiles.count()];
    covered(tiles, &Footprint::EVERYWHERE).for_each(|(i, area)| costs[i] = RAY * area);
    // What may be anywhere says nothing about where it is.
    for (footprint, lookups) in footprints.iter().zip(lookups).filter(|(f, _)| f.low.is_finite()) {
        // Of a cube's surroundings about half is its own, and a way through it is two thirds of an edge long.
        let each = f64::from(lookups / 3.0);
        covered(tiles, footprint).for_each(|(i, area)| costs[i] += each * area);
    }
    costs
}

/// Tiles that a footprint covers some of, by row and column, and the area in pixels.
fn covered(tiles: &Tiles, footprint: &Footprint) -> impl Iterator<Item = (usize, f64)> + use<> {
    let Tiles { edge, columns, rows, .. } = *tiles;
    let size = edge as f64;
    let low = footprint.low.max(DVec2::ZERO);
    let high = footprint.high.min(DVec2::new(tiles.width as f64, tiles.height as f64));
    let along = |low: f64, high: f64, count: usize| (low / size) as usize..((high / size).ceil() as usize).min(count);
    let shared = move |low: f64, high: f64, i: usize| high.min((i + 1) as f64 * size) - low.max(i as f64 * size);
    let across = along(low.x, high.x, columns);
    along(low.y, high.y, rows).flat_map(move |row| {
        let height = shared(low.y, high.y, row);
        across.clone().map(move |column| (row * columns + column, height * shared(low.x, high.x, column)))
    })
}
