//! The pictures that those of all settings are measured against.

use super::knobs::{Knob, SAMPLES};
use super::subject::Prepared;
use crate::app::pictures::PictureSettings;
use crate::app::study::Errors;
use crate::app::study::errors::scale;
use crate::app::study::reference::Reference;
use crate::app::study::words;
use crate::cancel::Cancel;
use crate::error::{Error, Result};
use crate::render::quadrature::Quadrature;
use crate::scene::camera::Camera;
use crate::scene::film::Film;

/// Independent pictures of paths, whose mean the reference is.
pub(super) const SEEDS: u32 = 16;
/// Distance of their seeds from those of the settings.
const APART: u64 = 1 << 32;
/// Rays along each edge of a pixel, and those of the run that tells the uncertainty.
pub(super) const EDGES: [u32; 2] = [16, 8];
/// Errors allowed to each piece of a cell, and those of the finer run that tells the uncertainty.
const TOLERANCES: [f64; 2] = [4e-7, 4e-8];
/// Uncertainty of pictures in single precision, of which a pixel is a sum of some tens of numbers.
const ROUNDING: f64 = 1e-6;

/// Pictures of the reference with what is known of them.
pub(super) struct Pictures {
    pub films: Vec<Film>,
    pub reference: Reference,
    /// Root mean square of the colors.
    pub scale: f64,
}

/// Renders the reference; `None` if it was stopped.
///
/// # Errors
/// If the pictures are black, or a medium or a light cannot be used.
pub(super) fn render(
    prepared: &Prepared,
    knobs: &[Knob],
    cameras: &[Camera],
    cancel: &Cancel,
) -> Result<Option<Pictures>> {
    match prepared.subject.scatters {
        true => of_paths(prepared, knobs, cameras, cancel),
        false => of_rays(prepared, knobs, cameras, cancel),
    }
}

/// Paths per pixel of each of the independent pictures: the most that are compared.
pub(super) fn samples(base: &PictureSettings, knobs: &[Knob]) -> u32 {
    if knobs.contains(&Knob::Samples) { SAMPLES[SAMPLES.len() - 1] } else { base.scattering.samples() }
}

fn of_paths(prepared: &Prepared, knobs: &[Knob], cameras: &[Camera], cancel: &Cancel) -> Result<Option<Pictures>> {
    let mut pictures = prepared.pictures.clone();
    let samples = samples(&pictures, knobs);
    pictures.scattering.samples = Some(samples);
    if knobs.contains(&Knob::MaxBounces) {
        pictures.scattering.max_bounces = None;
    }
    if knobs.contains(&Knob::Clamp) {
        pictures.scattering.clamp = None;
    }
    let first = pictures.scattering.seed.unwrap_or(0);
    let (mut runs, mut seconds) = (Vec::new(), 0.0);
    for number in 0..SEEDS {
        pictures.scattering.seed = Some(first.wrapping_add(APART).wrapping_add(number.into()));
        let Some((films, took)) = prepared.films(&pictures, cameras, None, cancel)? else { return Ok(None) };
        runs.push(films);
        seconds += took;
    }
    let (films, variance) = mean(&runs);
    let scale = scale(&films)?;
    let reference = Reference {
        options: words::option("samples", &(u64::from(samples) * u64::from(SEEDS)).into()).unwrap_or_default(),
        method: format!("standard error of the mean of {SEEDS} independent pictures of {samples} paths a pixel"),
        uncertainty: variance.sqrt() / scale,
        random: true,
        seconds,
    };
    Ok(Some(Pictures { films, reference, scale }))
}

/// Returns the means of independent pictures of the same views, and the mean of the variances of their colors.
fn mean(runs: &[Vec<Film>]) -> (Vec<Film>, f64) {
    let n = runs.len() as f64;
    let (mut square, mut count) = (0.0, 0.0);
    let views = runs.first().map_or(0, Vec::len);
    let view = |view: usize| {
        let first = &runs[0][view];
        let pixel = |at: usize| {
            std::array::from_fn(|c| {
                let values = || runs.iter().map(|films| f64::from(films[view].rgba[at][c]));
                let mean = values().sum::<f64>() / n;
                if c < 3 && mean.is_finite() {
                    square += values().map(|v| (v - mean).powi(2)).sum::<f64>() / (n * (n - 1.0));
                    count += 1.0;
                }
                mean as f32
            })
        };
        Film::of(first.width, first.height, (0..first.rgba.len()).map(pixel).collect())
    };
    let films = (0..views).map(view).collect();
    (films, square / f64::max(count, 1.0))
}

fn of_rays(prepared: &Prepared, knobs: &[Knob], cameras: &[Camera], cancel: &Cancel) -> Result<Option<Pictures>> {
    let exact = PictureSettings {
        quadrature: (!prepared.subject.pre_shaded).then_some(Quadrature::Exact),
        early_stop: 0.0,
        ..prepared.pictures.clone()
    };
    let varied = knobs.contains(&Knob::Supersample) || knobs.contains(&Knob::Samples);
    let rays = |per_edge: u32| {
        let mut pictures = exact.clone();
        match (varied, prepared.subject.paths) {
            (false, _) => {}
            (true, true) => pictures.scattering.samples = Some(per_edge.pow(2)),
            (true, false) => pictures.supersample = per_edge,
        }
        pictures
    };
    let best = rays(EDGES[0]);
    let [usual, fine] = TOLERANCES;
    let ((other, finer), method) = match varied {
        true => ((rays(EDGES[1]), usual), format!("difference from {0} x {0} rays a pixel", EDGES[1])),
        false if prepared.subject.pre_shaded => {
            ((best.clone(), fine), "rounding; the volume has a quadrature of its own".to_owned())
        }
        false => ((best.clone(), fine), "difference from a run of finer pieces, and rounding".to_owned()),
    };
    let Some((films, seconds)) = prepared.films(&best, cameras, Some(usual), cancel)? else { return Ok(None) };
    let Some((others, more)) = prepared.films(&other, cameras, Some(finer), cancel)? else { return Ok(None) };
    let scale = scale(&films)?;
    let reference = Reference {
        options: words::stated(&best, &prepared.pictures, &[]).join(" "),
        method,
        uncertainty: Errors::of_films(&others, &films, scale).rms.max(ROUNDING),
        random: false,
        seconds: seconds + more,
    };
    Ok(Some(Pictures { films, reference, scale }))
}

/// Returns the reference that an earlier study has left, from its pictures.
///
/// # Errors
/// If they are not those of these cameras.
pub(super) fn resumed(films: Vec<Film>, reference: Reference, cameras: &[Camera]) -> Result<Pictures> {
    let size = |camera: &Camera| (camera.width as usize, camera.height as usize);
    if films.iter().zip(cameras).any(|(film, camera)| (film.width, film.height) != size(camera)) {
        return Err(Error::invalid(
            "⟨resume⟩: the pictures of the reference have another size than those of the study",
        )
        .hint("run the study without ⟨resume⟩"));
    }
    let scale = scale(&films)?;
    Ok(Pictures { films, reference, scale })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_uncertainty_is_that_of_the_mean() {
        let film = |v: f32| vec![Film::of(1, 1, vec![[v, v, v, 1.0]])];
        let (films, variance) = mean(&[film(1.0), film(2.0), film(3.0)]);
        // Σ (x - x̄)² / (n (n - 1)) = 2 / 6.
        assert_eq!(films[0].rgba[0], [2.0, 2.0, 2.0, 1.0]);
        assert!((variance - 1.0 / 3.0).abs() < 1e-12);
    }
}
