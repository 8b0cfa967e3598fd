//! Which bricks the rays of a part of a picture can meet.

use crate::math::{Aabb, Affine};
use crate::scene::bricks::CELLS;
use crate::scene::camera::Camera;
use glam::{DVec2, DVec3, IVec3};
use rayon::prelude::*;

/// A rectangle of pixels: its lowest corner, and one past its highest.
pub type Rectangle = [[usize; 2]; 2];

/// Pixels that rounding may put a brick's corners off by.
const MARGIN: f64 = 1.0;

/// Where bricks lie in a picture.
#[derive(Debug)]
pub struct Footprints(Vec<[DVec2; 2]>);

impl Footprints {
    /// Of bricks by their coordinates, for a field with this transform.
    pub fn new(camera: &Camera, transform: &Affine, bricks: &[IVec3]) -> Self {
        let edge = CELLS as f64;
        let of = |brick: &IVec3| {
            let low = edge * brick.as_dvec3();
            let corners = Aabb { min: low, max: low + DVec3::splat(edge) }.corners();
            let everywhere = [DVec2::NEG_INFINITY, DVec2::INFINITY];
            let mut bounds = [DVec2::INFINITY, DVec2::NEG_INFINITY];
            for corner in corners {
                // Beside the eye or behind it: no corner bounds what is seen.
                let Some((pixel, _)) = camera.project(transform.to_world(corner)) else { return everywhere };
                if !pixel.is_finite() {
                    return everywhere;
                }
                bounds = [bounds[0].min(pixel), bounds[1].max(pixel)];
            }
            [bounds[0] - MARGIN, bounds[1] + MARGIN]
        };
        Self(bricks.par_iter().map(of).collect())
    }

    /// True if rays through the rectangle can meet a brick, given by its number.
    pub fn meets(&self, brick: usize, [low, high]: Rectangle) -> bool {
        let corner = |[x, y]: [usize; 2]| DVec2::new(x as f64, y as f64);
        let [from, to] = self.0[brick];
        from.cmple(corner(high)).all() && corner(low).cmple(to).all()
    }
}
