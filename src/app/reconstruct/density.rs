//! Densities from pictures of absorption, or of emission and absorption.

use super::capture::LoadedCapture;
use super::confidence::{self, Fit};
pub use super::density_solver::Choice;
use super::density_solver::{DensitySolver, SETTLED};
use super::refinement::RefinementSettings;
use super::region::{Placed, RegionSettings};
use super::volume::{Pictures, Solved, VolumeTask};
use crate::app::Context;
use crate::app::checks::Emission;
use crate::app::earlier::InitialGuess;
use crate::app::inputs;
use crate::app::outputs::Content;
use crate::app::photos;
use crate::app::ranges;
use crate::app::run::{self, Run};
use crate::app::task::{Task, without_result};
use crate::app::transfer::TransferSettings;
use crate::app::use_case::use_case;
use crate::differentiate::loss::prior::{VolumePrior, Weighted};
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::formats::transfer;
use crate::formats::vdb::{Codec, File, write_grids};
use crate::inverse::checkpoint::Checkpoint;
use crate::inverse::density::{Outcome, Request};
use crate::inverse::observation::Observation;
use crate::inverse::observation::photo::Photo;
use crate::inverse::observation::transmittances::Channels;
use crate::inverse::through_transfer;
use crate::scene::bricks::Bricks;
use crate::scene::capture::{Capture, Model};
use crate::scene::grid::Grid;
use crate::scene::medium::Source;
use crate::scene::transfer::Transfer;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// Longest time between checkpoints, in seconds: years.
const MOST_SECONDS: f64 = 1e9;

/// Settings of a reconstruction of densities.
///
/// The pictures' density scale is divided out, so that the result stands beside the volume that was rendered.
///
/// ```
/// use cumulo::prelude::*;
/// # let folder = tempfile::tempdir()?;
/// # let (shots, found) = (folder.path().join("shots"), folder.path().join("found.vdb"));
/// # let pictures = PictureSettings { views: Some(6), size: Some([24, 24]), ..PictureSettings::default() };
/// # let pictures = PictureSettings { input: "fixtures/plume.vdb".into(), ..pictures };
/// # RenderSettings { output: shots.clone(), pictures, ..RenderSettings::default() }.run(&Context::default())?;
/// let settings = DensitySettings {
///     capture: shots,
///     output: found.clone(),
///     region: RegionSettings { resolution: Some(16), ..RegionSettings::default() },
///     ..DensitySettings::default()
/// };
/// let run = settings.run(&Context::default())?;
/// assert!(run.train_psnr_db > Some(30.0), "{run}");
/// let grid = Vdb::open(&found, Limits::default())?.read_fog(Some("density"))?;
/// # assert!(grid.active_box().size().min_element() > 0.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct DensitySettings {
    /// transforms.json of the pictures, a model of COLMAP, or the folder of either.
    #[serde(with = "crate::app::paths")]
    pub capture: PathBuf,
    /// VDB to write.
    #[serde(with = "crate::app::paths")]
    pub output: PathBuf,
    /// Lattice and bounds of the voxels.
    #[serde(flatten)]
    pub region: RegionSettings,
    /// Cameras that are only nearly known.
    #[serde(flatten)]
    pub refinement: RefinementSettings,
    /// Transfer function that the pictures show, in place of the capture's.
    #[serde(flatten)]
    pub transfer: TransferSettings,
    /// Volume to start from, whatever made it.
    #[serde(with = "crate::app::paths")]
    pub init: Option<PathBuf>,
    /// How the densities are found.
    pub solver: Choice,
    /// Number of views that are not fitted, but decide when to stop; none for one of 8 or more.
    pub held_out: Option<usize>,
    /// Iterations on the finest level, at most; none for 24, or 40 where the pictures have noise, and of descents 50
    /// epochs.
    pub iterations: Option<u32>,
    /// Blur passes of the smoothness prior, 0 to 64; none for as many as suit the held-out views, without these 1.
    pub smoothing: Option<u32>,
    /// Prior on neighbouring voxels of a descent, its weight in units of the range of densities; none for smooth=0.001,
    /// of [`Choice::Weiss2021`] smooth=0.5.
    pub prior: Option<Weighted<VolumePrior>>,
    /// Loss that conjugate gradients minimise.
    pub loss: Loss,
    /// Layer of the pictures; none for the beauty.
    pub layer: Option<String>,
    /// Name of the grid that is written.
    pub grid: String,
    /// Folder of a page that shows how it went; none for no page.
    #[serde(with = "crate::app::paths")]
    pub report: Option<PathBuf>,
    /// Whether to go on from the output, if an earlier run of the same settings has left it.
    pub resume: bool,
    /// Seconds between checkpoints: the densities so far, written to the output, from which a run goes on that is to
    /// [resume](Self::resume); none writes the result alone.
    pub checkpoint: Option<f64>,
    /// Memory that the work may take.
    #[serde(flatten)]
    pub limits: Limits,
}

impl Default for DensitySettings {
    fn default() -> Self {
        Self {
            capture: PathBuf::new(),
            output: PathBuf::new(),
            region: RegionSettings::default(),
            refinement: RefinementSettings::default(),
            transfer: TransferSettings::default(),
            init: None,
            solver: Choice::Auto,
            held_out: None,
            iterations: None,
            smoothing: None,
            prior: None,
            loss: Loss::Huber,
            layer: None,
            grid: "density".into(),
            report: None,
            resume: false,
            checkpoint: None,
            limits: Limits::default(),
        }
    }
}

/// Loss of the residuals of optical depths.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Loss {
    /// Huber's, which bounds the influence of outliers.
    #[default]
    Huber,
    /// Least squares.
    L2,
}

/// Choices that a search rests on, made before its pictures are read.
#[derive(Debug, Clone)]
pub(super) struct Search {
    pub solver: DensitySolver,
    /// Places of the views that are not fitted.
    pub held_out: Vec<usize>,
    /// Densities to start from.
    pub init: Option<Arc<Bricks<f32>>>,
}

use_case!(DensitySettings => Run, limits);

impl DensitySettings {
    /// Paths that the densities are made from.
    pub(crate) fn inputs(&self) -> Vec<&Path> {
        let others = [&self.transfer.tf, &self.init].into_iter().flatten();
        others.chain([&self.capture]).map(PathBuf::as_path).collect()
    }

    /// Reads, reconstructs and writes.
    ///
    /// # Errors
    /// If the pictures cannot be read or used, or the outputs cannot be written.
    pub fn run(&self, context: &Context) -> Result<Run> {
        let _inputs = inputs::protect(self.inputs(), self.limits);
        self.check()?;
        let mut task = Task::begin(&self.output, Content::Vdb, self.report.as_deref(), self.limits, context)?;
        let (init, resume, output) = (self.init.as_deref(), self.resume, &self.output);
        task.search("reconstruct density", self, InitialGuess { init, resume, output, overwrite: None })?;
        let input = self.input(task.limits)?;
        let solver = self.solver(&input.capture)?;
        let cameras = self.refinement.output(&self.output, self.report.as_deref(), &input.capture)?;
        if let (Some(_), Some(_)) = (self.checkpoint, &cameras) {
            return Err(Error::unsupported("⟨checkpoint⟩ keeps densities, and not the cameras of ⟨refine_cameras⟩")
                .hint(
                    "refine the cameras first, with few ⟨iterations⟩, and reconstruct from the capture that this \
                     writes",
                ));
        }
        let views = input.capture.frames.len();
        let held_out = photos::held_out(self.held_out, views, 8).map_err(|e| e.at(&self.capture))?;
        let mut search = Search { solver, held_out, init: None };

        let mut work = VolumeTask::new(task, input, (&self.output, self.report.as_deref()), self.layer.as_deref());
        if work.input.capture.model == Model::Scattering {
            context.note(
                "the pictures show scattered light: the densities are those that alpha tells, whatever the colors are",
            );
        }
        let channels = channels(&work.input.capture)?;
        work.forecast(&self.region, channels, |work, sample, placed| {
            let (task, capture) = (&work.task, &work.input.capture);
            let search = Search { init: self.initial_densities(task)?, ..search.clone() };
            let request = self.request((task, capture), &sample.observation, placed, &search)?;
            let measured = solver.measured(sample, capture, placed, &request)?;
            Ok((solver.cost(&sample.observation, placed, &request, capture, measured.as_ref()), measured))
        })?;
        let mut pictures = pictures(&mut work, channels, solver)?;
        // Whether it is of these pictures is known once they were read.
        search.init = self.initial_densities(&work.task)?;
        if let Some(path) = cameras {
            let search = Search { held_out: Vec::new(), ..search.clone() };
            let request = |work: &VolumeTask<'_>, observation: &Observation, placed: &Placed| {
                self.request((&work.task, &work.input.capture), observation, placed, &search)
            };
            let refined = self.refinement.refine(&mut work, path, &self.region, &mut pictures, request);
            refined.map_err(without_result)?;
        }
        let measurements = work.measure(&self.region, pictures)?;
        let (observation, placed) = (&measurements.pictures.observation, &measurements.unknowns.placed);
        let request = self.request((&work.task, &work.input.capture), observation, placed, &search);
        let request = request.map_err(|e| e.at(&work.input.json))?;
        let cost = solver.cost(observation, placed, &request, &work.input.capture, work.measured.as_ref());
        work.begin(&measurements.unknowns, cost)?;
        let steps = solver.most_iterations(&measurements.pictures.observation, &request, views);

        let outcome = work.solve("density", steps, |watch| solver.reconstruct(&measurements, &request, watch));
        let Outcome { field, history, stages, train_psnr_db, held_out_psnr_db, unknowns, stopped } =
            outcome.map_err(|e| without_result(self.located(e, &work.input.json)))?;
        work.solved(stages);
        let Pictures { excerpts, photos, observation } = measurements.pictures;
        drop((photos, observation));
        // A volume that is not settled yet does not tell about its cameras.
        let finest = history.iter().filter(|step| step.level == 0).count();
        let settled = solver == DensitySolver::Cg && finest >= SETTLED;
        let mut solved = Solved { history, train_psnr_db, held_out_psnr_db, unknowns, stopped };
        let grid = field.to_grid(&self.grid);
        let fit = Fit { excerpts: &excerpts, request: &request, train_psnr_db };
        let confidence = work.confidence(&mut solved, |tick| {
            let (grids, mut warnings) = confidence::of_densities(&field, &self.grid, fit, tick)?;
            warnings.extend(if settled { confidence::of_cameras(&field, fit)? } else { None });
            Ok((grids, warnings))
        })?;
        drop(field);

        let grid = with_function(grid, transfer_of(&work.input.capture));
        let grids: Vec<&Grid> = std::iter::once(&grid).chain(&confidence).collect();
        work.write(|metadata| write_grids(&self.output, &grids, metadata, Codec::default(), false))?;
        let voxel_size = grid.transform.voxel_size().to_array();
        work.finish(solver.into(), self.grid.clone(), voxel_size, solved, request.held_out)
    }

    /// Refuses values out of their ranges.
    pub(super) fn check(&self) -> Result<()> {
        self.region.check()?;
        ranges::within("iterations", self.iterations, [1, 100_000])?;
        ranges::within("smoothing", self.smoothing, [0, 64])
    }

    /// Loads the capture, and refuses pictures that do not tell the densities; the transfer function of the
    /// settings takes the place of its own.
    pub(super) fn input(&self, limits: Limits) -> Result<LoadedCapture> {
        let mut input = LoadedCapture::load(&self.capture, limits)?;
        if let Some(transfer) = self.transfer.load(limits)? {
            input.suits_function()?;
            (input.capture.transfer, input.capture.model) = (Some(transfer), Model::EmissionAbsorption);
        }
        input.suits_alpha(limits)?;
        Ok(input)
    }

    pub(super) fn solver(&self, capture: &Capture) -> Result<DensitySolver> {
        let solver = DensitySolver::of(self.solver, &explained(capture).medium()?).map_err(|e| e.at(&self.capture))?;
        if solver == DensitySolver::Cg && self.prior.is_some() {
            return Err(Error::invalid("⟨prior⟩ is for descents, and conjugate gradients have a prior of their own")
                .hint("use ⟨smoothing⟩, or ⟨solver=weiss2021⟩"));
        }
        Ok(solver)
    }

    /// Reads the densities to start from; none where the search starts from nothing.
    ///
    /// # Errors
    /// If their file cannot be read, or they do not fit in memory.
    pub(super) fn initial_densities(&self, task: &Task) -> Result<Option<Arc<Bricks<f32>>>> {
        // The output has grids of confidences beside its own.
        let name = self.resume.then_some(self.grid.as_str());
        let limits = task.limits;
        let found = task.read_initial_guess(|path| {
            let grid = File::open(path, limits)?.read_fog(name)?;
            Bricks::from_grid(&grid, limits.max_memory).map_err(|e| e.at(path))
        })?;
        Ok(found.map(Arc::new))
    }

    pub(super) fn request(
        &self,
        (task, capture): (&Task, &Capture),
        observation: &Observation,
        placed: &Placed,
        search: &Search,
    ) -> Result<Request> {
        Ok(Request {
            lattice: placed.lattice,
            bounds: placed.bounds,
            medium: explained(capture).medium()?,
            background: capture.background,
            rays_per_edge: run::rays_per_edge(capture.pixel_filter),
            smoothing: self.smoothing,
            prior: self.prior,
            robust: self.loss == Loss::Huber,
            held_out: search.held_out.clone(),
            iterations: self.iterations.unwrap_or(search.solver.usual_iterations(observation.noisy())),
            init: search.init.clone(),
            max_memory: task.limits.max_memory,
            checkpoint: self.checkpoint.map(|seconds| self.checkpoint(seconds, task, capture)),
            cancel: task.stop(),
            closing: task.closing(),
        })
    }

    /// Returns what writes the densities so far to the output, each time after so many seconds.
    fn checkpoint(&self, seconds: f64, task: &Task, capture: &Capture) -> Checkpoint {
        let (output, name, context) = (self.output.clone(), self.grid.clone(), task.context.clone());
        let (mut provenance, transfer) = (task.provenance.clone(), transfer_of(capture).cloned());
        provenance.lap();
        let metadata = provenance.metadata();
        Checkpoint::new(Duration::from_secs_f64(seconds.min(MOST_SECONDS)), move |field| {
            let grid = with_function(field.to_grid(&name), transfer.as_ref());
            if let Err(error) = write_grids(&output, &[&grid], &metadata, Codec::default(), false) {
                context.note(format!("no checkpoint is written: {error}"));
            }
        })
    }

    /// Names the file of a solver's error: that of the settings for an error of the function, else the capture.
    fn located(&self, error: Error, json: &Path) -> Error {
        let function = self.transfer.tf.as_deref().filter(|_| error.place() == Some(through_transfer::FUNCTION));
        error.at(function.unwrap_or(json))
    }
}

/// Reads the pictures, of a medium that scatters light by their alpha alone, and tells their noise.
fn pictures(work: &mut VolumeTask<'_>, channels: Channels, solver: DensitySolver) -> Result<Pictures> {
    let scattered = work.input.capture.model == Model::Scattering;
    let shown = |photo: Photo| match scattered {
        true => Photo { film: photo.film.by_alpha(), ..photo },
        false => photo,
    };
    let pictures = work.read(Emission::Stated, channels, solver != DensitySolver::Cg, shown)?;
    if scattered {
        work.input.capture = explained(&work.input.capture).into_owned();
    }
    if let Some([least, most]) = pictures.observation.noise() {
        let percent = |noise: f64| format!("{:.2} %", 100.0 * noise);
        let (least, most) = (percent(least), percent(most));
        work.task.context.note(format!(
            "noise of the transmittances, of all channels together: {least} in the clearest picture, {most} in the \
             noisiest"
        ));
    }
    Ok(pictures)
}

/// Returns the transfer function of emission-absorption pictures; none for other models.
fn transfer_of(capture: &Capture) -> Option<&Transfer> {
    capture.transfer.as_ref().filter(|_| capture.model == Model::EmissionAbsorption)
}

/// Returns a grid with the transfer function of its pictures.
fn with_function(mut grid: Grid, transfer: Option<&Transfer>) -> Grid {
    if let Some(transfer) = transfer {
        grid.metadata.insert(transfer::METADATA_KEY.into(), transfer::to_metadata(&transfer.clone().into()));
    }
    grid
}

/// Returns the capture whose pictures the densities explain: of a medium that scatters light, alpha takes the place of
/// the colors.
fn explained(capture: &Capture) -> Cow<'_, Capture> {
    if capture.model == Model::Scattering { Cow::Owned(capture.by_alpha()) } else { Cow::Borrowed(capture) }
}

/// Returns the channels of the pictures that tell the optical depths.
pub(super) fn channels(capture: &Capture) -> Result<Channels> {
    if capture.model == Model::Scattering {
        return Ok(Channels::Alpha);
    }
    Ok(match capture.medium()?.source {
        Source::Grey(source) => Channels::Colors { background: capture.background, source },
        // Where the source varies, colors do not tell the optical depth: alpha does.
        Source::Linear(_) | Source::Transfer(_) => Channels::Alpha,
    })
}
