//! Which bricks the rays of a part of a picture can meet.

use crate::math::{Aabb, Affine};
use crate::scene::bricks::CELLS;
use crate::scene::camera::Camera;
use glam::{DVec2, DVec3, IVec3};

/// Pixels that rounding may put a brick's corners off by.
const MARGIN: f64 = 1.0;

/// A rectangle of a picture, in pixels: rays through other places do not meet the brick.
#[derive(Debug, Clone, Copy)]
pub struct Footprint {
    /// Left and top.
    pub low: DVec2,
    /// Right and bottom; less than left and top if there is nothing.
    pub high: DVec2,
}

impl Footprint {
    /// Nothing.
    pub const NOWHERE: Self = Self { low: DVec2::INFINITY, high: DVec2::NEG_INFINITY };
    /// The whole picture.
    pub const EVERYWHERE: Self = Self { low: DVec2::NEG_INFINITY, high: DVec2::INFINITY };

    /// Of a brick by its coordinates, in a field with this transform.
    pub fn new(camera: &Camera, transform: &Affine, brick: IVec3) -> Self {
        let edge = CELLS as f64;
        let low = edge * brick.as_dvec3();
        let corners = Aabb { min: low, max: low + DVec3::splat(edge) }.corners();
        let (mut bounds, mut behind) = (Self::NOWHERE, 0);
        for corner in corners {
            match camera.project(transform.to_world(corner)) {
                Some((pixel, _)) if pixel.is_finite() => {
                    bounds = Self { low: bounds.low.min(pixel), high: bounds.high.max(pixel) };
                }
                Some(_) => return Self::EVERYWHERE,
                None => behind += 1,
            }
        }
        match behind {
            0 => Self { low: bounds.low - MARGIN, high: bounds.high + MARGIN },
            // Beside the eye: no corner bounds what is seen.
            1..8 => Self::EVERYWHERE,
            _ => Self::NOWHERE,
        }
    }
}
