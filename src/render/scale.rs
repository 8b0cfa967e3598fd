//! A density scale at which a volume's pictures neither vanish nor go black.

use crate::cancel::Cancel;
use crate::error::Result;
use crate::render::dvr::Dvr;
use crate::render::emission_absorption::EmissionAbsorption;
use crate::render::labels::Labels;
use crate::render::tiles;
use crate::scene::bricks::Bricks;
use crate::scene::camera::Camera;
use crate::scene::medium::{Medium, Source};

/// Share of the pixels that meet the medium whose optical depth stays below [`DEPTH`].
const SHARE: f64 = 0.99;
/// Optical depth at that share: a transmittance of 5 %.
const DEPTH: f64 = 3.0;
/// Approximate number of pixels sampled along the shorter edge of a picture.
const PIXELS: u32 = 64;

/// Returns the extinction per unit of density (or factor of the transfer function's) at which the 99th percentile of
/// the optical depth, over the pixels of all cameras that meet any density, is 3. About 64 pixels along the shorter
/// edge of each picture are sampled. `None` if no pixel meets anything.
pub fn density_scale(field: &Bricks<f32>, source: &Source, cameras: &[Camera]) -> Option<f64> {
    let depths = depths(field, Medium::new(1.0, source.clone()), cameras).ok()?;
    let depth = depths.get((depths.len().saturating_sub(1) as f64 * SHARE).round() as usize)?;
    let scale = DEPTH / *depth;
    scale.is_finite().then_some(scale)
}

/// Returns the optical depths that the pixels of all cameras see where they see any, in ascending order. About 64
/// pixels along the shorter edge of each picture are sampled.
///
/// # Errors
/// If the medium cannot be used.
pub(crate) fn depths(field: &Bricks<f32>, medium: Medium, cameras: &[Camera]) -> Result<Vec<f64>> {
    Ok(match medium.labels() {
        Some(_) => depths_along(&Labels::new(field, &medium)?.early_stop(0.0), cameras),
        None => depths_along(&Dvr::new(field, medium)?.early_stop(0.0), cameras),
    })
}

fn depths_along<I: EmissionAbsorption>(integrator: &I, cameras: &[Camera]) -> Vec<f64> {
    let of_camera = |scratch: &mut I::Scratch, camera: &Camera| {
        let stride = (camera.width.min(camera.height) / PIXELS).max(1);
        let rows = (stride / 2..camera.height).step_by(stride as usize);
        let pixels = rows.flat_map(|y| (stride / 2..camera.width).step_by(stride as usize).map(move |x| (x, y)));
        let ray = |(x, y)| camera.ray(f64::from(x) + 0.5, f64::from(y) + 0.5);
        pixels.map(|pixel| integrator.integrate(&ray(pixel), scratch).depth).filter(|d| *d > 0.0).collect::<Vec<_>>()
    };
    let mut depths = tiles::map(cameras, &Cancel::NEVER, I::Scratch::default, of_camera).unwrap_or_default().concat();
    depths.sort_by(f64::total_cmp);
    depths
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Affine;
    use crate::scene::bricks::Topology;
    use crate::scene::orbit::{self, Layout};
    use crate::scene::up::Up;
    use glam::{DVec3, IVec3};
    use std::sync::Arc;

    #[test]
    fn the_thickest_paths_come_to_three() {
        let topology = Arc::new(Topology::new([IVec3::ZERO]).unwrap());
        let mut field = Bricks::zeros(topology, Affine::uniform(1.0, DVec3::ZERO).unwrap());
        let cameras = orbit::cameras(&field.world_bounds().corners(), 4, Layout::Ring, 40, 30, 30.0, Up::Z);
        assert_eq!(density_scale(&field, &Source::Grey([0.0; 3]), &cameras), None);
        field.values.fill(0.25);
        let scale = density_scale(&field, &Source::Grey([0.0; 3]), &cameras).unwrap();
        // A cube of 8 units of density 1/4: 2 straight through, 2√2 along the diagonal of a face.
        assert!((3.0 / 2.84..3.0 / 2.0).contains(&scale), "{scale}");
    }
}
