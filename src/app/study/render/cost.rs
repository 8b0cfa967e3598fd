//! What runs take, from small ones, and the size of pictures that the time allows.

use super::knobs::{Knob, Variant};
use super::reference::{EDGES, SEEDS, samples};
use super::subject::Prepared;
use crate::app::study::rounds::USUAL_ROUNDS;
use crate::cancel::Cancel;
use crate::error::Result;
use crate::render::quadrature::Quadrature;
use crate::scene::camera::Camera;

/// Longest edge of the pictures that the costs are found by, in pixels.
const PILOT: f64 = 48.0;
/// Longest edge of the smallest pictures that are measured.
const LEAST: f64 = 24.0;
/// Share of the time that the usual rounds of runs and the reference are planned to take.
const PLANNED: f64 = 0.6;
/// Paths per pixel of the small runs.
const PATHS: u32 = 4;

/// Seconds a pixel of all views.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Cost {
    /// Of a round of runs.
    pub round: f64,
    /// Of the reference.
    pub reference: f64,
}

impl Cost {
    /// Finds the costs; `None` if it was stopped.
    ///
    /// # Errors
    /// If a medium or a light cannot be used.
    pub(super) fn find(
        prepared: &Prepared,
        variants: &[Variant],
        knobs: &[Knob],
        cancel: &Cancel,
    ) -> Result<Option<Self>> {
        let cameras = prepared.cameras((PILOT / longest(&prepared.scene.cameras)).min(1.0));
        let count = pixels(&cameras);
        let paths = prepared.subject.paths;
        let seconds = |quadrature: Option<Quadrature>| {
            let mut pictures = prepared.pictures.clone();
            pictures.quadrature = quadrature;
            pictures.supersample = 1;
            pictures.scattering.samples = paths.then_some(PATHS);
            let rays = if paths { f64::from(PATHS) } else { 1.0 };
            // The first run may find caches cold.
            let mut best = f64::INFINITY;
            for _ in 0..2 {
                match prepared.films(&pictures, &cameras, None, cancel)? {
                    Some((_, seconds)) => best = best.min(seconds / rays),
                    None => return Ok(None),
                }
            }
            Ok(Some(best / count))
        };
        let mut known: Vec<(Option<Quadrature>, f64)> = Vec::new();
        let mut round = 0.0;
        for Variant { pictures, .. } in variants {
            let each = match known.iter().find(|(rule, _)| *rule == pictures.quadrature) {
                Some((_, each)) => *each,
                None => {
                    let Some(each) = seconds(pictures.quadrature)? else { return Ok(None) };
                    known.push((pictures.quadrature, each));
                    each
                }
            };
            round += each
                * if paths { pictures.scattering.samples().into() } else { f64::from(pictures.supersample).powi(2) };
        }
        let rule =
            if paths || prepared.subject.pre_shaded { prepared.pictures.quadrature } else { Some(Quadrature::Exact) };
        let Some(each) = seconds(rule)? else { return Ok(None) };
        let varied = knobs.contains(&Knob::Supersample) || knobs.contains(&Knob::Samples);
        let rays = match (prepared.subject.scatters, varied) {
            (true, _) => f64::from(SEEDS) * f64::from(samples(&prepared.pictures, knobs)),
            (false, true) => EDGES.map(|n| f64::from(n).powi(2)).into_iter().sum(),
            (false, false) => 2.0 * f64::from(prepared.pictures.supersample).powi(2),
        };
        Ok(Some(Self { round, reference: rays * each }))
    }

    /// Returns by how much the edges of the pictures are multiplied, so that the usual rounds and the reference take
    /// most of `budget` seconds: 1 at most.
    pub(super) fn share(self, budget: f64, cameras: &[Camera]) -> f64 {
        let each = f64::from(USUAL_ROUNDS) * self.round + self.reference;
        let share = (PLANNED * budget / (each * pixels(cameras))).sqrt();
        share.max(LEAST / longest(cameras)).min(1.0)
    }
}

/// Number of the pixels of all pictures.
pub(super) fn pixels(cameras: &[Camera]) -> f64 {
    cameras.iter().map(|camera| f64::from(camera.width) * f64::from(camera.height)).sum()
}

fn longest(cameras: &[Camera]) -> f64 {
    cameras.iter().map(|camera| camera.width.max(camera.height)).max().unwrap_or(1).into()
}
