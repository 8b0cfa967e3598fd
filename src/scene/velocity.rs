//! Velocities of volumes, from which motion between frames follows.

use crate::error::{Error, Result};
use crate::math::Affine;
use crate::scene::grid::{LEAF_VOXELS, voxel_offset};
use glam::{DMat3, DMat4, DVec3, IVec3, Vec3};
use std::collections::HashMap;

/// Edges of the tiles of OpenVDB's standard tree, in voxels.
const TILE_EDGES: [i32; 3] = [8, 128, 4096];

/// A sparse grid of velocities in world units per second, and the frames per second.
#[derive(Debug, Clone)]
pub struct Velocity {
    /// Map from index space to world space.
    transform: Affine,
    /// Values of the blocks of 8³ voxels, x, y and z of each voxel in the order of [`voxel_offset`], by their first
    /// voxel over 8.
    leaves: HashMap<IVec3, Vec<f32>>,
    /// Constant blocks by their edge, and their first voxel over it.
    tiles: HashMap<(i32, IVec3), Vec3>,
    /// Velocity elsewhere.
    background: Vec3,
    /// True if components lie on the lower faces of voxels, not in their centres.
    staggered: bool,
    /// Frames per second.
    fps: f64,
    /// Map from the grid's vectors to those of world space.
    turned: DMat3,
}

impl Velocity {
    /// Creates velocities, `background` everywhere.
    ///
    /// # Errors
    /// If the background is not finite, or `fps`, the frames per second, are not positive and finite.
    pub fn new(transform: Affine, background: Vec3, staggered: bool, fps: f64) -> Result<Self> {
        if !(fps > 0.0 && fps.is_finite()) {
            return Err(Error::invalid(format!("{fps} frames per second must be positive and finite"))
                .hint("give 24 or the like, or 1 for a grid of world units per frame"));
        }
        let grid = Self {
            transform,
            leaves: HashMap::new(),
            tiles: HashMap::new(),
            background,
            staggered,
            fps,
            turned: DMat3::IDENTITY,
        };
        grid.finite(background)
    }

    /// Adds a block of 8³ voxels, three values for each.
    ///
    /// # Errors
    /// If a value is not finite, or the number of values is another.
    pub fn leaf(mut self, origin: [i32; 3], values: Vec<f32>) -> Result<Self> {
        if values.len() != 3 * LEAF_VOXELS || values.iter().any(|v| !v.is_finite()) {
            return Err(not_finite());
        }
        self.leaves.insert(IVec3::from_array(origin) >> 3, values);
        Ok(self)
    }

    /// Adds a constant block.
    ///
    /// # Errors
    /// If the value is not finite, or the edge is not 8, 128 or 4096 voxels.
    pub fn tile(mut self, origin: [i32; 3], edge: i32, value: Vec3) -> Result<Self> {
        if !TILE_EDGES.contains(&edge) {
            return Err(Error::invalid(format!("a tile of {edge}³ voxels at {origin:?} fits no VDB tree"))
                .hint("tiles have edges of 8, 128 or 4096 voxels"));
        }
        self.tiles.insert((edge, IVec3::from_array(origin).div_euclid(IVec3::splat(edge))), value);
        self.finite(value)
    }

    /// Returns the velocities of a volume that is placed in the world by a map of column vectors, which turns and
    /// scales them too.
    ///
    /// # Errors
    /// If the map is singular or not affine.
    pub fn placed(self, map: DMat4) -> Result<Self> {
        let transform = Affine::new(map * self.transform.matrix())?;
        Ok(Self { transform, turned: DMat3::from_mat4(map) * self.turned, ..self })
    }

    fn finite(self, value: Vec3) -> Result<Self> {
        if value.is_finite() { Ok(self) } else { Err(not_finite()) }
    }

    /// Returns the way in world units that the medium at a world position goes in one frame.
    pub(crate) fn per_frame(&self, world: DVec3) -> DVec3 {
        let index = self.transform.to_index(world);
        let component = |axis: usize| {
            let shift = if self.staggered { 0.5 * DVec3::AXES[axis] } else { DVec3::ZERO };
            self.sample(index + shift, axis)
        };
        self.turned * DVec3::new(component(0), component(1), component(2)) / self.fps
    }

    /// Returns a component by trilinear interpolation at index coordinates.
    fn sample(&self, index: DVec3, axis: usize) -> f64 {
        let base = index.floor();
        let f = index - base;
        let mut sum = 0.0;
        for corner in 0..8 {
            let offset = IVec3::new(corner >> 2 & 1, corner >> 1 & 1, corner & 1);
            let weight = DVec3::select(offset.cmpeq(IVec3::ONE), f, 1.0 - f).element_product();
            sum += weight * f64::from(self.voxel(base.as_ivec3() + offset)[axis]);
        }
        sum
    }

    fn voxel(&self, voxel: IVec3) -> Vec3 {
        if let Some(values) = self.leaves.get(&(voxel >> 3)) {
            let at = 3 * voxel_offset((voxel & 7).to_array().map(|i| i as usize));
            return Vec3::from_slice(&values[at..at + 3]);
        }
        let tile = |edge: &i32| self.tiles.get(&(*edge, voxel.div_euclid(IVec3::splat(*edge))));
        TILE_EDGES.iter().find_map(tile).copied().unwrap_or(self.background)
    }
}

fn not_finite() -> Error {
    Error::invalid("velocities are NaN or infinite")
        .hint("⟨convert.repair⟩ sets such values to 0, or export the grid again")
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    /// Velocities that rise linearly, across blocks, tiles and the border; staggered ones are half a voxel aside.
    #[test]
    fn velocities_are_interpolated_between_voxels() {
        let value = |voxel: IVec3| voxel.as_vec3() * Vec3::new(1.0, 2.0, -1.0);
        for staggered in [false, true] {
            let transform = Affine::uniform(0.5, DVec3::new(1.0, 0.0, 0.0)).unwrap();
            let mut velocity = Velocity::new(transform, Vec3::Z, staggered, 24.0).unwrap();
            for origin in [IVec3::ZERO, IVec3::new(-8, 0, 0)] {
                let voxels = (0..512).flat_map(|i| value(origin + IVec3::new(i >> 6, i >> 3 & 7, i & 7)).to_array());
                velocity = velocity.leaf(origin.to_array(), voxels.collect()).unwrap();
            }
            velocity = velocity.tile([-128, -128, -128], 128, Vec3::X).unwrap();
            let index = DVec3::new(-0.7, 2.2, 3.4);
            let shift = if staggered { 0.5 } else { 0.0 };
            let expected = (index + shift) * DVec3::new(1.0, 2.0, -1.0) / 24.0;
            let found = velocity.per_frame(transform.to_world(index));
            assert!(found.abs_diff_eq(expected, 1e-9), "{found} {expected}");
            let at = |index: DVec3| 24.0 * velocity.per_frame(transform.to_world(index));
            assert_eq!(at(DVec3::splat(-60.5)), DVec3::X);
            assert_eq!(at(DVec3::splat(300.0)), DVec3::Z);
        }
    }

    /// A quarter turn around z, doubled and shifted: velocities turn and grow along.
    #[test]
    fn velocities_move_with_their_volume() {
        let unit = Affine::uniform(0.5, DVec3::ONE).unwrap();
        let values = (0..LEAF_VOXELS).flat_map(|i| [i as f32, 1.0, -2.0]).collect();
        let still = Velocity::new(unit, Vec3::ZERO, false, 4.0).unwrap().leaf([0; 3], values).unwrap();
        let turn =
            DMat4::from_cols_array(&[0.0, 2.0, 0.0, 0.0, -2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0, 0.0, 5.0, 6.0, 7.0, 1.0]);
        let moved = still.clone().placed(turn).unwrap();
        for at in [DVec3::new(1.3, 1.9, 2.2), DVec3::new(3.0, 4.1, 1.5)] {
            let expected = turn.transform_vector3(still.per_frame(at));
            assert!(expected.length() > 1.0);
            let found = moved.per_frame(turn.transform_point3(at));
            assert!((found - expected).length() < 1e-9 * expected.length(), "{found} {expected}");
        }
    }

    #[test]
    fn what_is_not_finite_is_refused() {
        let unit = Affine::uniform(1.0, DVec3::ZERO).unwrap();
        for (background, fps) in [(Vec3::NAN, 24.0), (Vec3::ZERO, 0.0), (Vec3::ZERO, f64::NAN)] {
            assert!(Velocity::new(unit, background, false, fps).is_err());
        }
        let still = Velocity::new(unit, Vec3::ZERO, false, 1.0).unwrap();
        assert!(still.clone().leaf([0; 3], vec![f32::INFINITY; 1536]).is_err());
        assert!(still.clone().leaf([0; 3], vec![0.0; 512]).is_err());
        assert!(still.tile([0; 3], 16, Vec3::ZERO).is_err());
    }
}
