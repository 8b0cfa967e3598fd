//! The grids that say how much the pictures constrain each voxel.

use crate::error::Result;
use crate::formats::vdb::{CONFIDENCE, shaded};
use crate::optimise::density::Request;
use crate::optimise::density::confidence::confidence;
use crate::optimise::density::descent::ForwardModel;
use crate::optimise::gradient::pictures::Target;
use crate::optimise::plausibility::Warning;
use crate::optimise::plausibility::residuals::Residuals;
use crate::optimise::projection::observation::Photo;
use crate::render::composited::Composited;
use crate::render::differentiable::Differentiable;
use crate::render::preshaded::Preshaded;
use crate::render::quadrature::Quadrature;
use crate::scene::bricks::{Bricks, Voxel};
use crate::scene::grid::{Grid, GridClass};
use crate::scene::medium::Source;
use glam::Vec4;

/// Least error of a pixel that is reckoned with, relative to the peak of 1: half a step of eight bits.
const LEAST_NOISE: f64 = 1.0 / 512.0;
/// What the prior leaves open, relative to the range of values.
const OPEN: f64 = 0.1;
/// Share of the positive values that lie below what counts as their range, where no transfer function says it.
const TOP: usize = 99;

/// Confidence of the densities by all views but the held-out ones, whose pictures are met to within `psnr_db`, and what
/// their residuals say of the model. None once the work is to stop.
///
/// # Errors
/// If the medium cannot be used.
pub fn grid(
    field: &Bricks<f32>,
    photos: &[Photo],
    request: &Request,
    psnr_db: f64,
    name: &str,
    tick: impl FnMut(usize, usize),
) -> Result<(Option<Grid>, Vec<Warning>)> {
    let quadrature = Quadrature::usual(matches!(request.medium.source, Source::Transfer(_)));
    let scene = ForwardModel { medium: &request.medium, background: request.background, quadrature };
    let light = scene.renderer(field)?;
    let targets = targets(photos, request);
    let open = OPEN * range(field, &request.medium.source);
    let views: Vec<&Target> = targets.iter().collect();
    let warnings = examined(&light, photos, request);
    let known = confidence(&light, &views, noise(psnr_db), &[(&[0], open)], request.cancel, tick);
    Ok((known.map(|known| as_grid(field, known.concat(), name)), warnings))
}

/// The same of extinctions and of emissions: of all their colors, which are seen through the same voxels.
pub fn grids(
    volume: &Bricks<Vec4>,
    photos: &[Photo],
    request: &Request,
    psnr_db: f64,
    tick: impl FnMut(usize, usize),
) -> (Vec<Grid>, Vec<Warning>) {
    let open = |c: usize| OPEN * top(volume.owned().into_iter().map(|v| v[c]));
    let emission = (0..3).map(open).fold(0.0, f64::max);
    let targets = targets(photos, request);
    let light = Preshaded::new(volume).over(request.background);
    let views: Vec<&Target> = targets.iter().collect();
    let warnings = examined(&light, photos, request);
    let groups: [(&[usize], f64); 2] = [(&[3], open(3)), (&[0, 1, 2], emission)];
    let known = confidence(&light, &views, noise(psnr_db), &groups, request.cancel, tick).unwrap_or_default();
    let names = [shaded::EXTINCTION, shaded::EMISSION];
    (known.into_iter().zip(names).map(|(known, name)| as_grid(volume, known, name)).collect(), warnings)
}

fn examined<I: Differentiable<Real = f32>>(light: &Composited<I>, photos: &[Photo], request: &Request) -> Vec<Warning> {
    let residuals = Residuals::new(light, photos, &request.held_out, request.rays_per_edge, request.cancel);
    residuals.map(|r| r.warnings()).unwrap_or_default()
}

/// The views that are used.
fn targets(photos: &[Photo], request: &Request) -> Vec<Target> {
    let used = photos.iter().enumerate().filter(|(i, _)| !request.held_out.contains(i));
    used.map(|(_, p)| Target { camera: p.camera, rgba: p.film.rgba.clone(), rays_per_edge: request.rays_per_edge })
        .collect()
}

fn noise(psnr_db: f64) -> f64 {
    // What was not measured after a stop counts as the least.
    LEAST_NOISE.max(10.0_f64.powf(-psnr_db / 20.0))
}

fn as_grid<V: Voxel>(field: &Bricks<V>, known: Vec<f32>, name: &str) -> Grid {
    let mut own = Bricks::zeros(field.topology.clone(), field.transform);
    own.topology.fill_apron(&known, &mut own.values);
    Grid { class: GridClass::Unknown, ..own.to_grid(&format!("{name}{CONFIDENCE}")) }
}

fn range(field: &Bricks<f32>, source: &Source) -> f64 {
    match source {
        Source::Transfer(table) => table.knots()[table.knots().len() - 1].max(0.0),
        Source::Grey(_) | Source::Linear(_) => top(field.owned().into_iter()),
    }
}

/// What most of the positive values lie below.
fn top(values: impl Iterator<Item = f32>) -> f64 {
    let mut positive: Vec<f32> = values.filter(|v| *v > 0.0).collect();
    if positive.is_empty() {
        return 0.0;
    }
    let at = (positive.len() - 1) * TOP / 100;
    let (_, top, _) = positive.select_nth_unstable_by(at, f32::total_cmp);
    f64::from(*top)
}
