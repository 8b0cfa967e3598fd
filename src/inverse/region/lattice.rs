//! The voxel lattice of a reconstruction.

use crate::error::{Error, Result};
use crate::math::{Aabb, Affine};
use crate::scene::camera::Camera;
use glam::{DMat3, DMat4, DVec3};

/// Returns a lattice along the axes of `existing` (else the world's) with voxels of edge `voxel_size`; with
/// `existing` and no size, or its own, it is that lattice.
///
/// # Errors
/// If `existing` is no usable map.
pub fn choose(existing: Option<DMat4>, voxel_size: Option<f64>) -> Result<Affine> {
    let (existing, size) = match (existing, voxel_size) {
        (Some(existing), None) => return Affine::new(existing),
        (Some(existing), Some(size)) => (Affine::new(existing)?, size),
        // Voxel centres lie on multiples of the size.
        (None, size) => return Affine::uniform(size.unwrap_or(1.0), DVec3::ZERO),
    };
    let own = existing.voxel_size();
    if own.to_array().iter().all(|s| (s / size - 1.0).abs() < 1e-6) {
        return Ok(existing);
    }
    let m = existing.matrix();
    let axes = DMat3::from_mat4(m) * DMat3::from_diagonal(size / own);
    Affine::new(DMat4::from_mat3_translation(axes, m.w_axis.truncate()))
}

/// Returns the lattice of a level: voxels 2^`level` times as large, the first one at the same place.
///
/// # Errors
/// If the voxels become too large for their numbers.
pub fn coarser(lattice: &Affine, level: u32) -> Result<Affine> {
    Affine::new(lattice.matrix() * DMat4::from_scale(DVec3::splat(f64::from(1_u32 << level))))
}

/// Returns the number of levels above the finest, each of half the resolution, if the coarsest has at least `least`
/// voxels along the longest edge.
pub(crate) fn coarser_levels(lattice: &Affine, bounds: &Aabb, least: f64) -> u32 {
    let longest = (bounds.size() / lattice.voxel_size()).max_element();
    (1..8).take_while(|l| longest / f64::from(1_u32 << l) >= least).count() as u32
}

/// Returns the number of levels that lead up to the finest: those of [`coarser_levels`], or, from a start
/// on, as many as its voxels are coarser.
pub(crate) fn levels_from(start: Option<&Affine>, lattice: &Affine, bounds: &Aabb, least: f64) -> u32 {
    let Some(start) = start else { return coarser_levels(lattice, bounds, least) };
    let ratio = (start.voxel_size() / lattice.voxel_size()).max_element();
    ratio.log2().round().clamp(0.0, 7.0) as u32
}

/// World length of a pixel at the centre of the region: the median over all views, by the finer of
/// the picture's two directions. Voxels much smaller than that cannot be told apart.
pub fn footprint<'c>(cameras: impl Iterator<Item = &'c Camera>, bounds: &Aabb) -> Option<f64> {
    let mut sizes: Vec<f64> = cameras
        .filter_map(|camera| camera.pixel_size_at(bounds.centre()))
        .filter(|size| size.is_finite() && *size > 0.0)
        .collect();
    if sizes.is_empty() {
        return None;
    }
    let middle = sizes.len() / 2;
    let (_, median, _) = sizes.select_nth_unstable_by(middle, f64::total_cmp);
    Some(*median)
}

/// Voxel size by which the longest edge of the region has `count` voxels.
///
/// # Errors
/// If the region has no extent.
pub fn divided(bounds: &Aabb, count: u32) -> Result<f64> {
    let size = bounds.size().max_element() / f64::from(count.max(1));
    if size > 0.0 && size.is_finite() {
        Ok(size)
    } else {
        Err(Error::invalid("the region has no extent").hint("give it with ⟨bounds⟩ x0,y0,z0,x1,y1,z1"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_known_lattice_is_kept_or_scaled_along_its_axes() {
        let existing = DMat4::from_translation(DVec3::new(1.0, 2.0, 3.0))
            * DMat4::from_rotation_z(0.3)
            * DMat4::from_scale(DVec3::new(0.5, 0.5, 0.25));
        assert_eq!(choose(Some(existing), None).unwrap().matrix(), existing);
        let scaled = choose(Some(existing), Some(0.1)).unwrap();
        assert!((scaled.voxel_size() - 0.1).abs().max_element() < 1e-12);
        assert!(scaled.matrix().x_axis.truncate().cross(existing.x_axis.truncate()).length() < 1e-12);
        assert_eq!(scaled.matrix().w_axis, existing.w_axis);
        let uniform = DMat4::from_scale(DVec3::splat(0.25));
        assert_eq!(choose(Some(uniform), Some(0.25 * (1.0 + 1e-9))).unwrap().matrix(), uniform);
        assert_eq!(choose(None, Some(0.5)).unwrap().to_world(DVec3::ONE), DVec3::splat(0.5));
    }
}
