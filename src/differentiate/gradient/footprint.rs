//! Footprints of bricks in pictures: the bricks that the rays of a part of a picture can cross.

use crate::math::Affine;
use crate::scene::bricks::CELLS;
use crate::scene::camera::{Camera, Projection};
use glam::{DMat3, DVec2, DVec3, IVec3};

/// Pixels by which rounding may displace a brick's corners.
const MARGIN: f64 = 1.0;

/// A rectangle of a picture, in pixels: rays outside of it do not cross the brick.
#[derive(Debug, Clone, Copy)]
pub struct Footprint {
    /// Left and top edges.
    pub low: DVec2,
    /// Right and bottom edges; less than left and top for an empty rectangle.
    pub high: DVec2,
}

impl Footprint {
    /// Empty rectangle.
    pub(crate) const NOWHERE: Self = Self { low: DVec2::INFINITY, high: DVec2::NEG_INFINITY };
    /// Rectangle that covers the whole picture.
    pub(crate) const EVERYWHERE: Self = Self { low: DVec2::NEG_INFINITY, high: DVec2::INFINITY };
}

/// Projection of a field's bricks into a camera's picture: homogeneous image coordinates (x, y and their divisor),
/// linear in index coordinates.
#[derive(Debug, Clone, Copy)]
pub struct Lens {
    /// Linear map from a brick's coordinates to the image of its lowest corner.
    linear: DMat3,
    /// Image of the lowest corner of brick (0, 0, 0).
    offset: DVec3,
    /// Offsets from the image of a brick's lowest corner to those of all eight.
    corners: [DVec3; 8],
}

impl Lens {
    /// Creates the projection of a camera, for a field with this transform.
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

    /// Returns the footprint of a brick, by its coordinates.
    pub fn footprint(&self, brick: IVec3) -> Footprint {
        let low = self.linear * brick.as_dvec3() + self.offset;
        let (mut bounds, mut corners_behind, mut sum) = (Footprint::NOWHERE, 0, DVec2::ZERO);
        for corner in self.corners {
            let at = low + corner;
            corners_behind += usize::from(at.z <= 0.0);
            let pixel = at.truncate() * (1.0 / at.z);
            sum += pixel;
            bounds = Footprint { low: bounds.low.min(pixel), high: bounds.high.max(pixel) };
        }
        match corners_behind {
            0 if sum.is_finite() => Footprint { low: bounds.low - MARGIN, high: bounds.high + MARGIN },
            8 => Footprint::NOWHERE,
            // Beside the eye, or as good as: no corner bounds what is visible.
            _ => Footprint::EVERYWHERE,
        }
    }
}
