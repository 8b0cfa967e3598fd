//! The grid that says how much the pictures constrain each voxel.

use crate::error::Result;
use crate::formats::vdb::CONFIDENCE;
use crate::optimise::confidence::confidence;
use crate::optimise::density::Request;
use crate::optimise::fit::Scene;
use crate::optimise::observation::Photo;
use crate::optimise::pictures::Target;
use crate::render::quadrature::Quadrature;
use crate::scene::bricks::Bricks;
use crate::scene::grid::{Grid, GridClass};
use crate::scene::medium::Source;

/// Least error of a pixel that is reckoned with, relative to the peak of 1: half a step of eight bits.
const LEAST_NOISE: f64 = 1.0 / 512.0;
/// What the prior leaves open, relative to the range of densities.
const OPEN: f64 = 0.1;
/// Share of the densities that lie below what counts as their range, where no transfer function says it.
const TOP: usize = 99;

/// Confidence of the unknowns by all views but the held-out ones, whose pictures are met to within `psnr_db`.
///
/// # Errors
/// If the medium cannot be used.
pub fn grid(field: &Bricks<f32>, photos: &[Photo], request: &Request, psnr_db: f64, name: &str) -> Result<Grid> {
    let used = photos.iter().enumerate().filter(|(i, _)| !request.held_out.contains(i));
    let targets: Vec<Target> = used
        .map(|(_, p)| Target { camera: p.camera, rgba: p.film.rgba.clone(), rays_per_edge: request.rays_per_edge })
        .collect();
    let quadrature = match request.medium.source {
        Source::Transfer(_) => Quadrature::PREINTEGRATED,
        Source::Grey(_) | Source::Linear(_) => Quadrature::Exact,
    };
    let scene = Scene { medium: &request.medium, background: request.background, quadrature };
    let noise = LEAST_NOISE.max(10.0_f64.powf(-psnr_db / 20.0));
    let spread = OPEN * range(field, &request.medium.source);
    let known = confidence(field, &scene, &targets.iter().collect::<Vec<_>>(), noise, spread)?;
    let mut own = Bricks::zeros(field.topology.clone(), field.transform);
    own.topology.spread(&known, &mut own.values);
    Ok(Grid { class: GridClass::Unknown, ..own.to_grid(&format!("{name}{CONFIDENCE}")) })
}

fn range(field: &Bricks<f32>, source: &Source) -> f64 {
    if let Source::Transfer(table) = source {
        return table.knots()[table.knots().len() - 1].max(0.0);
    }
    let mut positive: Vec<f32> = field.owned().into_iter().filter(|v| *v > 0.0).collect();
    if positive.is_empty() {
        return 0.0;
    }
    let at = (positive.len() - 1) * TOP / 100;
    let (_, top, _) = positive.select_nth_unstable_by(at, f32::total_cmp);
    f64::from(*top)
}
