//! Pre-shaded volumes from pictures of emission and absorption.

use super::capture::LoadedCapture;
use super::confidence::{self, Fit};
use super::region::{Placed, RegionSettings};
use super::volume::{Measurements, Pictures, Solved, VolumeTask};
use crate::app::Context;
use crate::app::checks::Emission;
use crate::app::earlier::InitialGuess;
use crate::app::inputs;
use crate::app::outputs::Content;
use crate::app::photos;
use crate::app::ranges;
use crate::app::run::{self, Run, Solver};
use crate::app::task::{Task, without_result};
use crate::app::use_case::use_case;
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::formats::vdb::{File, shaded};
use crate::inverse::color::{self, Shaded};
use crate::inverse::cost::effort::{self, Rates};
use crate::inverse::cost::{Cost, Method, PictureSizes};
use crate::inverse::density::Request;
use crate::inverse::observation::Observation;
use crate::inverse::observation::transmittances::Channels;
use crate::scene::capture::{Capture, Model};
use crate::scene::grid::Grid;
use crate::scene::medium::Medium;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Settings of a reconstruction of a pre-shaded volume: extinction and emitted color by voxel.
///
/// Alpha tells the extinctions (grid `density`, per world length), the colors then tell what is emitted (grid
/// `emission`, radiance per world length); grids of confidences, 0 to 1, say how much the pictures tell of either in
/// each voxel.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ColorSettings {
    /// transforms.json of the pictures, a model of COLMAP, or the folder of either.
    #[serde(with = "crate::app::paths")]
    pub capture: PathBuf,
    /// VDB to write.
    #[serde(with = "crate::app::paths")]
    pub output: PathBuf,
    /// Lattice and bounds of the voxels.
    #[serde(flatten)]
    pub region: RegionSettings,
    /// Number of views that are not fitted, but decide when to stop; none for one of 8 or more.
    pub held_out: Option<usize>,
    /// Iterations of the extinctions on the finest level, at most.
    pub iterations: u32,
    /// Blur passes of the smoothness prior, 0 to 64; none for as many as suit the held-out views and the pictures'
    /// noise.
    pub smoothing: Option<u32>,
    /// Layer of the pictures; none for the beauty.
    pub layer: Option<String>,
    /// Folder of a page that shows how it went; none for no page.
    #[serde(with = "crate::app::paths")]
    pub report: Option<PathBuf>,
    /// Pre-shaded volume to start from, whatever made it.
    #[serde(with = "crate::app::paths")]
    pub init: Option<PathBuf>,
    /// Whether to go on from the output, if an earlier run of the same settings has left it.
    pub resume: bool,
    /// Memory that the work may take.
    #[serde(flatten)]
    pub limits: Limits,
}

impl Default for ColorSettings {
    fn default() -> Self {
        Self {
            capture: PathBuf::new(),
            output: PathBuf::new(),
            region: RegionSettings::default(),
            held_out: None,
            iterations: 24,
            smoothing: None,
            layer: None,
            report: None,
            init: None,
            resume: false,
            limits: Limits::default(),
        }
    }
}

use_case!(ColorSettings => Run, limits);

impl ColorSettings {
    /// Paths that the volume is made from.
    pub(crate) fn inputs(&self) -> Vec<&Path> {
        [&self.capture].into_iter().chain(&self.init).map(PathBuf::as_path).collect()
    }

    /// Reads, reconstructs and writes.
    ///
    /// # Errors
    /// If the pictures cannot be read or used, or the outputs cannot be written.
    pub fn run(&self, context: &Context) -> Result<Run> {
        let _inputs = inputs::protect(self.inputs(), self.limits);
        self.region.check()?;
        ranges::within("iterations", self.iterations, [1, 100_000])?;
        ranges::within("smoothing", self.smoothing, [0, 64])?;
        let mut task = Task::begin(&self.output, Content::Vdb, self.report.as_deref(), self.limits, context)?;
        let (init, resume, output) = (self.init.as_deref(), self.resume, &self.output);
        task.search("reconstruct color", self, InitialGuess { init, resume, output, overwrite: None })?;
        let limits = task.limits;
        let input = LoadedCapture::load(&self.capture, limits)?;
        if input.capture.model == Model::Absorption {
            return Err(Error::unsupported("the pictures show absorption alone, which has no colors of its own")
                .at(&input.json)
                .hint("use `cumulo reconstruct density`, or state \"model\": \"emission-absorption\""));
        }
        input.suits_alpha(limits)?;
        let views = input.capture.frames.len();
        let held_out = photos::held_out(self.held_out, views, 8).map_err(|e| e.at(&self.capture))?;

        let mut work = VolumeTask::new(task, input, (&self.output, self.report.as_deref()), self.layer.as_deref());
        if work.input.capture.model == Model::Scattering {
            context.note(
                "the pictures show scattered light: the volume emits what these lights made of it, the same in all \
                 directions",
            );
        }
        work.forecast(&self.region, Channels::Alpha, |work, sample, placed| {
            let request = self.request(work, placed, held_out.clone());
            Ok((cost(&work.input.capture, &sample.observation, placed, &request), None))
        })?;
        let pictures = work.read(Emission::Sought, Channels::Alpha, true, |photo| photo)?;
        let measurements = work.measure(&self.region, pictures)?;
        let request = self.request(&work, &measurements.unknowns.placed, held_out);
        let init =
            work.task.read_initial_guess(|path| shaded::read(&File::open(path, limits)?, None, limits.max_memory))?;
        let Measurements { pictures: Pictures { photos, excerpts, observation }, unknowns } = measurements;
        work.begin(&unknowns, cost(&work.input.capture, &observation, &unknowns.placed, &request))?;
        let steps = color::most_iterations(&observation, &request);
        let outcome =
            work.solve("color", steps, |watch| color::reconstruct(&photos, &observation, &request, init, watch));
        let Shaded { volume, history, stages, train_psnr_db, held_out_psnr_db, voxels, stopped } =
            outcome.map_err(|e| without_result(e.at(&work.input.json)))?;
        work.solved(stages);
        drop((photos, observation));
        let mut solved = Solved { history, train_psnr_db, held_out_psnr_db, unknowns: voxels, stopped };
        let fit = Fit { excerpts: &excerpts, request: &request, train_psnr_db };
        let confidence = work.confidence(&mut solved, |tick| Ok(confidence::of_pre_shaded(&volume, fit, tick)))?;

        let confidence: Vec<&Grid> = confidence.iter().collect();
        work.write(|metadata| shaded::write(&self.output, &volume, &confidence, metadata))?;
        let voxel_size = volume.transform.voxel_size().to_array();
        work.finish(Solver::Color, shaded::EXTINCTION.into(), voxel_size, solved, request.held_out)
    }

    fn request(&self, work: &VolumeTask<'_>, placed: &Placed, held_out: Vec<usize>) -> Request {
        let (task, capture) = (&work.task, &work.input.capture);
        Request {
            lattice: placed.lattice,
            bounds: placed.bounds,
            medium: Medium::absorbing(1.0),
            background: capture.background,
            rays_per_edge: run::rays_per_edge(capture.pixel_filter),
            smoothing: self.smoothing,
            prior: None,
            robust: true,
            held_out,
            iterations: self.iterations,
            init: None,
            max_memory: task.limits.max_memory,
            cancel: task.stop(),
            checkpoint: None,
            closing: task.closing(),
        }
    }
}

/// Returns the expected cost by all pictures or a few of them.
fn cost(capture: &Capture, observation: &Observation, placed: &Placed, request: &Request) -> Cost {
    let (pictures, survey) = (PictureSizes::of(capture), &placed.survey);
    let steps = color::most_iterations(observation, request);
    let seconds = effort::of_steps(Method::Color, survey, request, pictures.pixels, steps, &Rates::USUAL);
    Cost::new(Method::Color, survey, pictures, seconds)
}
