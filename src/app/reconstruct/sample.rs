//! A few pictures of a capture, read whole, and how long this machine takes with them.

use super::confidence::{self, Fit};
use super::region::Placed;
use crate::app::Context;
use crate::app::checks::Emission;
use crate::app::checks::excerpt::Excerpt;
use crate::app::checks::pictures::PictureFacts;
use crate::app::photos;
use crate::app::provenance::Provenance;
use crate::cancel::Cancel;
use crate::error::Result;
use crate::formats::limits::Limits;
use crate::inverse::cost::effort::{Rates, coarser_bricks};
use crate::inverse::cost::scaling::Pass;
use crate::inverse::density::Request;
use crate::inverse::density::confidence::{MeasuredView, confidence as probed, probes};
use crate::inverse::density::descent::ForwardModel;
use crate::inverse::density::timing::LevelTimes;
use crate::inverse::observation::Observation;
use crate::inverse::observation::photo::Photo;
use crate::inverse::observation::transmittances::{Channels, Transmittances};
use crate::render::composited::Composited;
use crate::render::dvr::Dvr;
use crate::render::quadrature::Quadrature;
use crate::scene::bricks::BRICK;
use crate::scene::camera::Camera;
use crate::scene::capture::{Capture, Model};
use std::time::Instant;

/// Number of pictures that are read: four may bound a region far too large.
const FEW: usize = 8;
/// Blocks of 8³ voxels of the level that is timed, at most.
const BRICKS: f64 = 4096.0;
/// Pixels of the pictures of a probe that is timed, at most (or one picture's), and probes, of which the last counts.
const PROBED: usize = 1 << 22;
const PROBES: usize = 3;
/// Seconds to write a block of voxels and of confidences.
const WRITTEN: f64 = 2.5e-5;

/// A few pictures of a capture.
pub(super) struct Sample {
    /// Optical depths of the pictures.
    pub observation: Observation,
    /// Wall time of reading all pictures of the capture.
    pub reading: f64,
    excerpts: Vec<Excerpt>,
}

/// Rates of this machine, and the times of what does not depend on iterations.
#[derive(Debug, Clone)]
pub(super) struct Measured {
    /// Level that was timed.
    pub level: u32,
    /// Rates of the search.
    pub rates: Rates,
    /// Share of the pixels whose rays cross unknowns.
    pub crossing: f64,
    /// Probes of the confidence, on the finest level and all pictures.
    pub probes: Pass,
    /// Comparing the result with excerpts of the pictures.
    pub compared: f64,
}

impl Sample {
    /// Returns true if a capture has more pictures than are read.
    pub(super) fn is_less_than(capture: &Capture) -> bool {
        capture.frames.len() > FEW
    }

    /// Reads eight evenly spaced pictures of a capture; all but one where there are fewer.
    ///
    /// # Errors
    /// If a picture cannot be read or used.
    pub(super) fn read(
        capture: &Capture,
        layer: Option<&str>,
        channels: Channels,
        limits: Limits,
        context: &Context,
    ) -> Result<Self> {
        let all = capture.frames.len();
        let few = FEW.min(all.saturating_sub(1)).max(1);
        let numbers: Vec<usize> = (0..few).map(|i| (2 * i + 1) * all / (2 * few)).collect();
        let scattered = capture.model == Model::Scattering;
        let take = |photo: Photo| {
            // As a reconstruction does, for the time that it takes.
            let _facts = PictureFacts::new(&photo, capture, Emission::Stated);
            let photo = if scattered { Photo { film: photo.film.by_alpha(), ..photo } } else { photo };
            (Excerpt::new(&photo, few), Transmittances::new(&photo, channels))
        };
        let begun = Instant::now();
        let read = photos::some(capture, &numbers, layer, limits, &|| {}, take)?;
        let decoded = begun.elapsed().as_secs_f64();
        let begun = Instant::now();
        let pictures = numbers.iter().map(|i| capture.frames[*i].picture.as_path());
        Provenance::begin(context).input(capture.frames[numbers[0]].picture.as_path(), pictures)?;
        let hashed = begun.elapsed().as_secs_f64();

        let threads = rayon::current_num_threads();
        let pixels = |i: &usize| {
            let camera = &capture.frames[*i].camera;
            f64::from(camera.width) * f64::from(camera.height)
        };
        let more = capture.pixels() as f64 / numbers.iter().map(pixels).sum::<f64>().max(1.0);
        let at_once = |pictures: usize| pictures.min(threads) as f64;
        let reading = more * (decoded * at_once(few) / at_once(all) + hashed);
        let (excerpts, transmittances) = read.into_iter().unzip();
        Ok(Self { observation: Observation::gather(transmittances, channels)?, reading, excerpts })
    }

    /// Times the search and the confidence of its result with these pictures, on the finest level of a size that takes
    /// a moment. `request` is that of all pictures, `settled` tells whether the cameras are judged by the result.
    ///
    /// # Errors
    /// If the pictures leave no unknown.
    pub(super) fn measure(
        &self,
        capture: &Capture,
        placed: &Placed,
        request: &Request,
        settled: bool,
    ) -> Result<Measured> {
        // A block takes the accumulators of two operators, and half as much again.
        let fits = (request.max_memory as f64 / (16.0 * (BRICK * 16) as f64)).min(BRICKS);
        let coarser = |level: u32| f64::from(1_u32 << level);
        let is_small = |level: &u32| coarser_bricks(placed.survey.bricks, coarser(*level)) <= fits;
        let level = (0..12).find(is_small).unwrap_or(12);
        let times = LevelTimes::measure(&self.observation, request, level)?;
        let longest = placed.survey.longest / coarser(level);
        let rates = Rates::new(&times, longest, self.observation.maps.len());

        let model = ForwardModel {
            medium: &request.medium,
            background: request.background,
            quadrature: Quadrature::usual(&request.medium.source),
        };
        let renderer = model.renderer(&times.field)?;
        let begun = Instant::now();
        let fit = Fit { excerpts: &self.excerpts, request, train_psnr_db: f64::NAN };
        confidence::compared(&renderer, fit);
        if settled {
            confidence::of_cameras(&times.field, fit)?;
        }
        let compared = begun.elapsed().as_secs_f64();
        let probes = Self::probes(capture, request, &renderer, times.partitions);
        // Rays that are walked on the finest level are longer than those that were timed.
        let probes = Pass { rays: probes.rays * coarser(level), ..probes };
        Ok(Measured { level, rates, crossing: times.crossing, probes, compared })
    }

    /// Times probes of the confidence with the cameras of the capture.
    fn probes(capture: &Capture, request: &Request, renderer: &Composited<Dvr<'_, f32>>, partitions: usize) -> Pass {
        let cameras: Vec<_> = capture.frames.iter().map(|frame| frame.camera).collect();
        let pixels = capture.pixels() as f64;
        let step = (pixels / PROBED as f64).ceil().max(1.0) as usize;
        let measured = |_: usize| true;
        let view = |camera: &Camera| MeasuredView {
            camera: *camera,
            rays_per_edge: request.rays_per_edge,
            measured: &measured,
        };
        let views: Vec<MeasuredView<'_>> = cameras.iter().step_by(step).map(view).collect();
        let some: f64 = views.iter().map(|view| f64::from(view.camera.width) * f64::from(view.camera.height)).sum();
        let (stop, mut laps) = (Cancel::new(), vec![Instant::now()]);
        probed(renderer, &views, 1.0, &[(&[0], 1.0)], &stop, |done, _| {
            laps.push(Instant::now());
            if done >= PROBES {
                stop.request();
            }
        });
        let seconds = laps.windows(2).last().map_or(0.0, |lap| (lap[1] - lap[0]).as_secs_f64());
        let threads = rayon::current_num_threads();
        Pass {
            count: probes(capture.frames.len()) as f64,
            rays: seconds * pixels / some.max(1.0) * partitions.min(threads) as f64,
            sums: 0.0,
            alone: 0.0,
            partitions,
            bytes: renderer.medium.field().values.len() as f64 * 4.0,
        }
    }
}

/// Returns the seconds that writing so many blocks of 8³ voxels with their confidences takes.
pub(super) fn writing(bricks: f64) -> f64 {
    WRITTEN * bricks
}
