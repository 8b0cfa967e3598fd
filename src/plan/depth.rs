//! Upper bounds of the optical depth along any ray.

use crate::math::Affine;
use crate::real::Real;
use crate::render::majorant::{Majorants, bound_between};
use crate::scene::bricks::{BRICK, Bricks, NONE, slot};
use crate::scene::medium::Medium;
use glam::{DVec3, IVec3};
use rayon::prelude::*;

/// Most blocks that a field is divided into.
const MOST_BLOCKS: u64 = 1 << 22;
/// Cells along the edge of a brick.
const EDGE: usize = 8;

/// Returns an upper bound of the optical depth along any ray through a field.
///
/// The field is divided into blocks of 1, 2, 4 or 8 cells along each edge. A ray crosses layers of blocks along the
/// axis of index space in which it is steepest, and moves sideways by one block in each of them at most. The bound is
/// the greatest sum of the blocks' majorants over all such chains, bent ones among them, times the length that a ray
/// may have in a layer.
pub(crate) fn largest<R: Real>(field: &Bricks<R>, medium: &Medium) -> f64 {
    let (min, max) = field.topology.places().fold((IVec3::MAX, IVec3::MIN), |(a, b), (at, _)| (a.min(at), b.max(at)));
    if min.x > max.x {
        return 0.0;
    }
    let medium = &medium.clone().relative_to(field.reference);
    let all = Majorants::new(field, medium);
    if all.empty() > 0.0 {
        // The medium is not clear between the bricks: the box is all there is to go by.
        let diagonal = field.transform.box_to_world(field.domain).size().length();
        return f64::from(all.largest()) * diagonal;
    }
    let extent = (max - min + 1).as_i64vec3();
    let bricks = (extent.x * extent.y * extent.z) as u64;
    let fits = |per_edge: &usize| bricks * (per_edge * per_edge * per_edge) as u64 <= MOST_BLOCKS;
    let per_edge = [8, 4, 2].into_iter().find(fits).unwrap_or(1);
    let blocks = Blocks { per_edge, majorants: majorants(field, medium, per_edge), min, max };
    let along = |axis: usize| blocks.chains(field, axis) * layer(&field.transform, axis) / per_edge as f64;
    (0..3).into_par_iter().map(along).reduce(|| 0.0, f64::max)
}

/// Returns the bounds of the extinction in the blocks of each brick, z fastest.
fn majorants<R: Real>(field: &Bricks<R>, medium: &Medium, per_edge: usize) -> Vec<f32> {
    let cells = EDGE / per_edge;
    let of_block = move |values: &[R], block: usize| {
        let first = [block / (per_edge * per_edge), block / per_edge % per_edge, block % per_edge].map(|i| i * cells);
        let along = move |axis: usize| first[axis]..=first[axis] + cells;
        let voxels = along(0).flat_map(move |x| along(1).flat_map(move |y| along(2).map(move |z| [x, y, z])));
        let values = voxels.map(|[x, y, z]| values[slot(x, y, z)]);
        let extremes = values.map(|v| (v, v)).reduce(|a, b| (a.0.lesser(b.0), a.1.greater(b.1)));
        extremes.map_or(0.0, |(low, high)| bound_between(medium, [low, high]))
    };
    let of_brick = |values: &[R]| (0..per_edge.pow(3)).map(|block| of_block(values, block)).collect::<Vec<_>>();
    field.values.par_chunks(BRICK).flat_map_iter(of_brick).collect()
}

/// Returns the greatest world length of a ray within one layer of bricks across an axis, of rays that are steepest in
/// that axis.
fn layer(transform: &Affine, axis: usize) -> f64 {
    let corner = |signs: usize| {
        let sign = |bit: usize| if signs >> bit & 1 == 0 { 1.0 } else { -1.0 };
        let mut direction = DVec3::new(sign(0), sign(1), sign(2));
        direction[axis] = 1.0;
        // The length of a linear map is convex: it is greatest in a corner.
        transform.matrix().transform_vector3(direction).length()
    };
    EDGE as f64 * (0..8).map(corner).fold(0.0, f64::max)
}

/// Blocks of a field.
struct Blocks {
    /// Blocks along the edge of a brick.
    per_edge: usize,
    /// Bounds of the extinction, for each brick those of its blocks, z fastest.
    majorants: Vec<f32>,
    /// First and last brick.
    min: IVec3,
    max: IVec3,
}

impl Blocks {
    /// Returns the greatest sum of majorants over chains of blocks across the layers of an axis.
    fn chains<R: Real>(&self, field: &Bricks<R>, axis: usize) -> f64 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let extent = (self.max - self.min + 1) * self.per_edge as i32;
        // A margin of one block, from which rays enter and into which they leave.
        let (width, height) = (extent[u] as usize + 2, extent[v] as usize + 2);
        let inside = |x: usize, y: usize| x > 0 && y > 0 && x + 1 < width && y + 1 < height;
        let [mut sums, mut next, mut bounds] = [(); 3].map(|()| vec![0.0_f64; width * height]);
        let mut most = 0.0_f64;
        for layer in 0..extent[axis] {
            for y in 1..height - 1 {
                for x in 1..width - 1 {
                    let mut block = IVec3::ZERO;
                    (block[axis], block[u], block[v]) = (layer, x as i32 - 1, y as i32 - 1);
                    bounds[y * width + x] = self.majorant(field, block);
                }
            }
            for y in 0..height {
                for x in 0..width {
                    let mut sum = 0.0_f64;
                    for from_y in y.saturating_sub(1)..=(y + 1).min(height - 1) {
                        for from_x in x.saturating_sub(1)..=(x + 1).min(width - 1) {
                            // On its way sideways a ray may pass each block of the rectangle.
                            let row = |y: usize| bounds[y * width + x].max(bounds[y * width + from_x]);
                            sum = sum.max(sums[from_y * width + from_x] + row(y).max(row(from_y)));
                        }
                    }
                    most = most.max(sum);
                    // Who has left a box does not come back.
                    next[y * width + x] = if inside(x, y) { sum } else { 0.0 };
                }
            }
            std::mem::swap(&mut sums, &mut next);
        }
        most
    }

    /// Returns the majorant of a block, by its place from the first of all.
    fn majorant<R: Real>(&self, field: &Bricks<R>, block: IVec3) -> f64 {
        let per_edge = self.per_edge as i32;
        let within = block % per_edge;
        match field.topology.find(self.min + block / per_edge) {
            NONE => 0.0,
            number => {
                let place = (within.x * per_edge + within.y) * per_edge + within.z;
                self.majorants[number as usize * self.per_edge.pow(3) + place as usize].into()
            }
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use crate::math::Ray;
    use crate::render::dvr::Dvr;
    use crate::scene::bricks::Topology;
    use glam::{DMat3, DMat4};
    use std::sync::Arc;

    /// Rays through a sparse field of uneven bricks, under a shear and a mirror: none is deeper than the bound, which
    /// is not far above the deepest.
    #[test]
    fn no_ray_is_deeper_than_the_bound() {
        let skewed = DMat3::from_cols(DVec3::new(-0.7, 0.1, 0.0), DVec3::new(0.2, 1.3, 0.0), DVec3::new(0.0, 0.3, 0.5));
        for linear in [DMat3::IDENTITY, skewed] {
            let transform = Affine::new(DMat4::from_mat3(linear)).unwrap();
            let all = (0..5 * 4 * 6).map(|i| IVec3::new(i % 5 - 2, i / 5 % 4 - 1, i / 20));
            let topology = Arc::new(Topology::new(all.filter(|b| (b.x * b.y + b.z) % 3 != 0)).unwrap());
            let mut field: Bricks<f32> = Bricks::zeros(topology.clone(), transform);
            let value =
                |i: usize| (1.0 + (0.37 * (i / 512) as f32).sin()) * if i.is_multiple_of(3) { 0.8 } else { 1.0 };
            let owned: Vec<f32> = (0..topology.len() * 512).map(value).collect();
            topology.fill_apron(&owned, &mut field.values);
            let dvr = Dvr::new(&field, Medium::absorbing(0.1)).unwrap().early_stop(0.0);
            let bound = largest(&field, &Medium::absorbing(0.1));
            let (bounds, mut deepest) = (field.world_bounds(), 0.0_f64);
            let golden = DVec3::new(0.754_877_666, 0.569_840_29, 0.438_579_02);
            for i in 0..4000 {
                let share = |k: f64| (golden * k).fract();
                let through = bounds.min + bounds.size() * share(f64::from(i) + 1.0);
                let direction = (share(f64::from(i) * 7.0 + 3.0) - 0.5).normalize();
                let ray = Ray::new(through - 100.0 * direction, direction);
                deepest = deepest.max(dvr.optical_depth(&ray));
            }
            assert!(deepest <= bound && bound < 3.0 * deepest, "{deepest} {bound}");
        }
    }

    #[test]
    fn nothing_has_no_depth() {
        let topology = Arc::new(Topology::new([]).unwrap());
        let field: Bricks<f32> = Bricks::zeros(topology, Affine::uniform(1.0, DVec3::ZERO).unwrap());
        assert_eq!(largest(&field, &Medium::absorbing(1.0)), 0.0);
    }
}
