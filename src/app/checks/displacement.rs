//! Cameras that do not suit their pictures, told by the volume that was reconstructed from them.
//!
//! The step of a camera that brings its picture nearest to the render displaces that picture. The volume has adapted to
//! the wrong cameras, so that the step is less than their error; but where all are right there is none.

use super::Warning;
use super::excerpt::{Excerpt, stride};
use crate::cancel::Cancel;
use crate::differentiate::gradient::camera_jacobian::Rows;
use crate::inverse::pose::colors::{Colors, linearised};
use crate::inverse::pose::normal::{Frame, steps};
use crate::render::composited::Composited;
use crate::render::differentiable::Differentiable;
use glam::DVec3;
use rayon::prelude::*;

/// Damping of the step, as a share of the largest eigenvalue.
const DAMPING: f64 = 1e-3;
/// Displacement in pixels, and share of the error that it explains, from which on most pictures count as displaced.
/// With exact cameras, noise of 5 % or six views leave medians of less than 0.04 pixels.
const DISPLACED: f64 = 0.1;
const EXPLAINED: f64 = 0.05;
/// Displacement in pixels, and share of the error that it explains, from which on one picture alone counts as
/// displaced.
const ONE_DISPLACED: f64 = 0.5;
const ONE_EXPLAINED: f64 = 0.2;
/// Growth of the least displacement that counts, for every pixel by which a voxel is wider than one: what voxels do not
/// resolve displaces pictures, too. With exact cameras medians were 0.17, 0.64 and 1.2 pixels where voxels were 1.7,
/// 3.5 and 5.2 pixels wide.
const COARSE: f64 = 0.3;

/// Displacement of a picture by the step of its camera that brings it nearest to the render.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Displacement {
    /// Root mean square in pixels, over the points.
    pub pixels: f64,
    /// Share of the squared differences between picture and render that the step takes away, to first order.
    pub explained: f64,
    /// Displacement in pixels that the volume's voxels alone may cause, beyond that of voxels of a pixel.
    pub coarse: f64,
}

/// Returns the displacement of each picture, by the projections of `points`; of one that says nothing about its camera
/// it is zero. Pictures are compared at one pixel in so many, tens of thousands in all.
pub(crate) fn displacements<I: Differentiable<Real = f32>>(
    renderer: &Composited<I>,
    excerpts: &[Excerpt],
    colors: &Colors,
    points: &[DVec3],
    rays_per_edge: usize,
    cancel: &Cancel,
) -> Vec<Displacement> {
    let centre = points.iter().sum::<DVec3>() / points.len().max(1) as f64;
    let voxel = renderer.medium.field().transform.voxel_size().max_element();
    let of_view = |excerpt: &Excerpt| {
        let camera = &excerpt.camera;
        let frame = Frame::new(camera, camera.position().distance(centre).max(f64::MIN_POSITIVE));
        let cancel = &cancel;
        let rows = Rows { renderer, reference: None, camera, rays_per_edge, cancel };
        let stride = stride(rows.pixels(), excerpts.len());
        let normal = linearised(&rows, &frame, &|i| excerpt.pixel(i), colors, stride);
        let spectrum = normal.spectrum();
        let (poses, _, predicted) = steps(&[(normal, spectrum)], DAMPING * spectrum.largest(), false);
        let pixels = camera.displacement(&frame.moved(camera, &poses[0], 0.0), points).unwrap_or(0.0);
        let coarse = COARSE * camera.pixel_size_at(centre).map_or(0.0, |pixel| (voxel / pixel - 1.0).max(0.0));
        Displacement { pixels, explained: predicted / normal.error.max(f64::MIN_POSITIVE), coarse }
    };
    excerpts.par_iter().map(of_view).collect()
}

/// Warns if most pictures are displaced, or some of them are by far.
pub(crate) fn warning(displacements: &[Displacement], excerpts: &[Excerpt]) -> Option<Warning> {
    let median = |of: fn(&Displacement) -> f64| {
        let mut all: Vec<f64> = displacements.iter().map(of).collect();
        all.sort_by(f64::total_cmp);
        all.get(all.len() / 2).copied().unwrap_or(0.0)
    };
    let [pixels, explained, coarse] = [median(|d| d.pixels), median(|d| d.explained), median(|d| d.coarse)];
    let all = pixels >= DISPLACED + coarse && explained >= EXPLAINED;
    let counts = |d: &Displacement| all || d.pixels >= ONE_DISPLACED + d.coarse && d.explained >= ONE_EXPLAINED;
    let displaced: Vec<(&Displacement, &Excerpt)> =
        displacements.iter().zip(excerpts).filter(|(d, _)| counts(d)).collect();
    let (Displacement { pixels: most, .. }, Excerpt { name, .. }) =
        displaced.iter().max_by(|a, b| a.0.pixels.total_cmp(&b.0.pixels))?;
    let what = if all {
        format!(
            "the pictures are displaced by {pixels:.2} pixels (median) from what their cameras see of the volume, \
             {name} by {most:.2}"
        )
    } else {
        format!(
            "{} of {} pictures are displaced from what their cameras see of the volume, {name} by {most:.2} pixels",
            displaced.len(),
            excerpts.len()
        )
    };
    let remedy = "the cameras do not suit one another: add ⟨refine_cameras⟩; if they were refined already, look for a \
                  picture that does not belong to the others, bounds that cut the volume, a lens that distorts, or a \
                  volume that moved between the pictures";
    Some(Warning::new(what, remedy))
}
