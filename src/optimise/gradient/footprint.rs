//! Which bricks the rays of a part of a picture can meet.

use crate::math::Affine;
use crate::scene::bricks::CELLS;
use crate::scene::camera::{Camera, Projection};
use glam::{DMat3, DVec2, DVec3, IVec3};

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
}

/// How a camera sees the bricks of a field: image coordinates and what they are to be divided by, all of them linear in
/// index coordinates.
#[derive(Debug, Clone, Copy)]
pub struct Lens {
    /// Of the bricks' lowest corners, by their coordinates.
    linear: DMat3,
    /// Of the lowest corner of brick (0, 0, 0).
    offset: DVec3,
    /// From a brick's lowest corner to all of them.
    corners: [DVec3; 8],
}

impl Lens {
    /// Of a camera, for a field with this transform.
    pub fn new(camera: &Camera, transform: &Affine) -> Self {
        let (to_world, pose) = (transform.matrix(), camera.camera_to_world);
        let Camera { focal, centre, .. } = *camera;
        // Right, up and forward: as Camera::project has them.
        let axes =
            DMat3::from_cols(pose.x_axis.truncate(), pose.y_axis.truncate(), -pose.z_axis.truncate()).transpose();
        let raster = match camera.projection {
            Projection::Perspective => DMat3::from_cols(DVec3::X * focal.x, DVec3::Y * -focal.y, centre.extend(1.0)),
            Projection::Orthographic => DMat3::from_cols(DVec3::X * focal.x, DVec3::Y * -focal.y, DVec3::ZERO),
        };
        let constant = if camera.projection == Projection::Orthographic { centre.extend(1.0) } else { DVec3::ZERO };
        let linear = raster * axes * DMat3::from_mat4(to_world) * DMat3::from_diagonal(DVec3::splat(CELLS as f64));
        let corner = |c: usize| linear * DVec3::from_array([c >> 2, c >> 1 & 1, c & 1].map(|bit| bit as f64));
        Self {
            linear,
            offset: raster * axes * (to_world.w_axis.truncate() - camera.position()) + constant,
            corners: std::array::from_fn(corner),
        }
    }

    /// Of a brick by its coordinates.
    pub fn footprint(&self, brick: IVec3) -> Footprint {
        let low = self.linear * brick.as_dvec3() + self.offset;
        let (mut bounds, mut behind, mut sum) = (Footprint::NOWHERE, 0, DVec2::ZERO);
        for corner in self.corners {
            let at = low + corner;
            behind += usize::from(at.z <= 0.0);
            let pixel = at.truncate() * (1.0 / at.z);
            sum += pixel;
            bounds = Footprint { low: bounds.low.min(pixel), high: bounds.high.max(pixel) };
        }
        match behind {
            0 if sum.is_finite() => Footprint { low: bounds.low - MARGIN, high: bounds.high + MARGIN },
            8 => Footprint::NOWHERE,
            // Beside the eye, or as good as: no corner bounds what is seen.
            _ => Footprint::EVERYWHERE,
        }
    }
}
