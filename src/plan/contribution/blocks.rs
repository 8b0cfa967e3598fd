//! Blocks of the pictures of all cameras.

use crate::math::Aabb;
use crate::render::film::Blocks;
use crate::scene::camera::Camera;
use glam::{DVec2, DVec3};
use std::ops::Range;

/// A block of 8 x 8 pixels of a picture; smaller at its right and lower edge.
#[derive(Debug, Clone)]
pub(super) struct Block {
    /// Number of the camera.
    pub camera: usize,
    /// Column and row among the picture's blocks.
    pub place: [usize; 2],
    /// Columns and rows of its pixels.
    extent: [Range<usize>; 2],
}

impl Block {
    /// Returns the number of pixels.
    pub(super) fn pixels(&self) -> f64 {
        (self.extent[0].len() * self.extent[1].len()) as f64
    }

    /// Returns the image position of a point, given by shares of the block's width and height, in pixels.
    pub(super) fn at(&self, shares: [f64; 2]) -> [f64; 2] {
        std::array::from_fn(|axis| self.extent[axis].start as f64 + shares[axis] * self.extent[axis].len() as f64)
    }
}

/// Returns the blocks of all cameras' pictures; if all that they show lies in a box, those that it may be seen in.
pub(super) fn of(cameras: &[Camera], within: Option<Aabb>) -> Vec<Block> {
    let of_camera = |(number, camera): (usize, &Camera)| {
        let seen = within.and_then(|within| outline(camera, within));
        let grid = Blocks::new([camera.width as usize, camera.height as usize]);
        let [across, _] = grid.grid();
        let block = move |block: usize| {
            let extent = grid.extent(block);
            Block { camera: number, place: [block % across, block / across], extent }
        };
        let shows = move |block: &Block| {
            seen.is_none_or(|[min, max]| {
                (0..2).all(|axis| {
                    let Range { start, end } = block.extent[axis];
                    end as f64 > min[axis] && (start as f64) < max[axis]
                })
            })
        };
        (0..grid.count()).map(block).filter(shows).collect::<Vec<_>>()
    };
    cameras.iter().enumerate().flat_map(of_camera).collect()
}

/// Width in pixels that covers rounding.
const MARGIN: f64 = 0.01;

/// Returns the lower and upper image coordinates between which a box is seen; `None` where it reaches behind the
/// camera.
fn outline(camera: &Camera, within: Aabb) -> Option<[DVec2; 2]> {
    let corner = |number: usize| {
        let [x, y, z] = [0, 1, 2].map(|axis| if number >> axis & 1 == 0 { within.min[axis] } else { within.max[axis] });
        camera.project(DVec3::new(x, y, z)).map(|(place, _)| place)
    };
    // A box in front of a camera lies between the projections of its corners.
    let corners = (0..8).map(corner).collect::<Option<Vec<_>>>()?;
    let ends = |least: DVec2, most: DVec2| [least - MARGIN, most + MARGIN];
    let (min, max) = (corners.iter().copied().reduce(DVec2::min)?, corners.iter().copied().reduce(DVec2::max)?);
    (min.is_finite() && max.is_finite()).then(|| ends(min, max))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::blur::Blur;
    use glam::DMat4;

    #[test]
    fn blocks_that_show_nothing_are_left_out() {
        let camera = Camera {
            camera_to_world: DMat4::IDENTITY,
            focal: DVec2::splat(20.0),
            centre: DVec2::splat(20.0),
            width: 40,
            height: 39,
            near: 0.0,
            blur: Blur::default(),
            projection: crate::scene::camera::Projection::Perspective,
        };
        let seen = |min: DVec3, max: DVec3| {
            let blocks = of(&[camera], Some(Aabb { min, max }));
            blocks.iter().map(|block| block.place).collect::<Vec<_>>()
        };
        let (one, two) = (DVec3::new(0.1, 0.1, -2.0), DVec3::new(0.3, 0.3, -1.0));
        assert_eq!(seen(one, two), [[2, 1], [3, 1], [2, 2], [3, 2]]);
        // A box around the camera is everywhere.
        assert_eq!(seen(DVec3::splat(-1.0), DVec3::splat(1.0)).len(), 25);
        let last = of(&[camera], None).pop();
        assert_eq!(last.map(|block| (block.pixels(), block.at([0.5, 1.0]))), Some((56.0, [36.0, 39.0])));
    }
}
