//! `cumulo reconstruct density`: a VDB from absorption or emission-absorption pictures.

use super::capture::LoadedCapture;
use super::confidence::{self, Fit};
use super::refinement::RefineCameras;
use super::region::{Placed, Region};
use super::volume::{Measurements, Pictures, Solved, VolumeTask};
use crate::app::checks::Emission;
use crate::app::outputs::Content;
use crate::app::photos;
use crate::app::run::{self, Solver};
use crate::app::transfer::TransferSettings;
use crate::cli::cancel;
use crate::cli::memory::Memory;
use crate::cli::output::Output;
use crate::cli::report;
use crate::differentiate::loss::prior::{VolumePrior, Weighted};
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::formats::protected;
use crate::formats::transfer;
use crate::formats::vdb::{Codec, File, write_grids};
use crate::inverse::cost::{Cost, Method};
use crate::inverse::density::{Outcome, Request};
use crate::inverse::density::{multilevel, weiss2021};
use crate::inverse::observation::Observation;
use crate::inverse::observation::photo::Photo;
use crate::inverse::observation::transmittances::Channels;
use crate::inverse::progress::Step;
use crate::inverse::through_transfer;
use crate::scene::bricks::Bricks;
use crate::scene::capture::{Capture, Model};
use crate::scene::grid::Grid;
use crate::scene::medium::Source;
use crate::scene::transfer::Transfer;
use std::borrow::Cow;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Reconstruct the density of a volume from pictures of it
///
/// The pictures' density scale is divided out, so that the result stands beside the volume that was rendered. Ctrl-C
/// writes what is there (exit code 130); --resume goes on from it.
#[derive(Debug, clap::Args)]
pub struct Density {
    /// transforms.json of the pictures, a model of COLMAP, or the folder of either
    capture: PathBuf,
    /// VDB to write
    #[arg(long, short, value_name = "OUT.vdb")]
    output: PathBuf,
    #[command(flatten)]
    region: Region,
    #[command(flatten)]
    refinement: RefineCameras,
    #[command(flatten)]
    transfer: TransferSettings,
    /// Start from this volume
    #[arg(long, value_name = "IN.vdb")]
    init: Option<PathBuf>,
    /// How the densities are found: auto is cg where the pictures depend on the optical depth alone, colors first
    /// where there is a transfer function, else weiss2021
    #[arg(long, value_enum, default_value_t = Choice::Auto)]
    solver: Choice,
    /// Number of views to hold out: these are not fitted, but decide when to stop (default: one of 8 or more)
    #[arg(long, value_name = "K")]
    held_out: Option<usize>,
    /// Iterations on the finest level, at most (default: 24, or 40 where the pictures have noise; with a transfer
    /// function, or weiss2021: 50 epochs)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    iterations: Option<u32>,
    /// Blur passes of the smoothness prior (default: as many as suit the held-out views, without these 1; where the
    /// pictures have noise, differences of neighbours are penalised instead, as suits these views)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=64))]
    smoothing: Option<u32>,
    /// Prior on neighbouring voxels of a descent (through a transfer function, or weiss2021): smooth=W, or tv=W for
    /// total variation, W the weight in units of the range of densities (default: smooth=0.001, weiss2021 smooth=0.5)
    #[arg(long, value_name = "NAME=W")]
    prior: Option<Weighted<VolumePrior>>,
    /// Loss that cg minimises: huber bounds the influence of outliers, l2 is plain least squares
    #[arg(long, value_enum, default_value_t = Loss::Huber)]
    loss: Loss,
    /// Layer of the pictures (default: the beauty)
    #[arg(long, value_name = "NAME")]
    layer: Option<String>,
    /// Name of the grid
    #[arg(long, value_name = "NAME", default_value = "density")]
    grid: String,
    /// Write a page that shows how it went
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    /// Start from the output, if it is there
    #[arg(long, conflicts_with = "init")]
    resume: bool,
    #[command(flatten)]
    pub(in crate::cli) memory: Memory,
}

/// `--solver`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Choice {
    Auto,
    /// Conjugate gradients in the smoothness prior's metric
    Cg,
    /// Adam as in Weiss & Westermann (2021)
    #[value(name = "weiss2021", alias = "paper")]
    Weiss2021,
}

/// Solver of densities, as `--solver` and the medium of the pictures choose it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum DensitySolver {
    Cg,
    Weiss2021,
    ThroughTransfer,
}

impl DensitySolver {
    /// Returns the largest number of iterations on the finest level, or of epochs, without `--iterations`.
    fn usual_iterations(self, noisy: bool) -> u32 {
        match self {
            Self::Cg if noisy => 40,
            Self::Cg => 24,
            Self::Weiss2021 | Self::ThroughTransfer => 50,
        }
    }

    /// Returns the largest number of steps that a run reports, over all levels.
    fn most_iterations(self, observation: &Observation, request: &Request, views: usize) -> u64 {
        let training = views - request.held_out.len();
        match self {
            Self::Cg => multilevel::most_iterations(observation, request),
            Self::Weiss2021 => weiss2021::most_iterations(request, training),
            Self::ThroughTransfer => through_transfer::most_iterations(observation, request, training),
        }
    }

    fn reconstruct(
        self,
        measurements: &Measurements,
        request: &Request,
        watch: impl FnMut(&Step) -> ControlFlow<()>,
    ) -> Result<Outcome> {
        let Pictures { photos, observation, .. } = &measurements.pictures;
        match self {
            Self::Cg => multilevel::reconstruct(observation, request, watch),
            Self::Weiss2021 => weiss2021::reconstruct(photos, observation, request, watch),
            Self::ThroughTransfer => through_transfer::reconstruct(photos, observation, request, watch),
        }
    }

    /// Returns the method that the solver's cost is estimated for.
    fn method(self) -> Method {
        match self {
            Self::Cg => Method::Cg,
            Self::Weiss2021 => Method::Descent,
            Self::ThroughTransfer => Method::ThroughTransfer,
        }
    }
}

impl From<DensitySolver> for Solver {
    fn from(solver: DensitySolver) -> Self {
        match solver {
            DensitySolver::Cg => Self::Cg,
            DensitySolver::Weiss2021 => Self::Weiss2021,
            DensitySolver::ThroughTransfer => Self::ThroughTransfer,
        }
    }
}

/// `--loss`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Loss {
    Huber,
    L2,
}

impl Density {
    /// Paths that the command reads.
    pub(super) fn inputs(&self) -> Vec<&Path> {
        let others = [&self.transfer.tf, &self.init].into_iter().flatten();
        others.chain([&self.capture]).map(PathBuf::as_path).collect()
    }

    /// Reads, reconstructs, writes and reports.
    ///
    /// # Errors
    /// If the pictures cannot be read or used, or the outputs cannot be written.
    pub(super) fn run(&self, output: &Output) -> Result<ExitCode> {
        let task = report::begin(&self.output, Content::Vdb, self.report.as_deref(), (self.memory, output))?;
        let input = self.input(task.limits)?;
        let solver = self.solver(&input.capture)?;
        let cameras = self.refinement.output(&self.output, self.report.as_deref(), &input.capture)?;
        let views = input.capture.frames.len();
        let held_out = photos::held_out(self.held_out, views, 8).map_err(|e| e.at(&self.capture))?;

        let mut work =
            VolumeTask::new(task, input, (&self.output, self.report.as_deref()), self.layer.as_deref(), output);
        if work.input.capture.model == Model::Scattering {
            output.note(
                "the pictures show scattered light: the densities are those that alpha tells, whatever the colors are",
            );
        }
        let scattered = work.input.capture.model == Model::Scattering;
        let channels = channels(&work.input.capture)?;
        let pixels = work.input.capture.pixels();
        work.forecast(&self.region, channels, |observation, placed| {
            let request = self.request(&work, observation, placed, solver, held_out.clone())?;
            let steps = solver.most_iterations(observation, &request, views);
            Ok(Cost::new(solver.method(), &placed.survey, &request, pixels, steps))
        })?;
        let shown = |photo: Photo| match scattered {
            true => Photo { film: photo.film.by_alpha(), ..photo },
            false => photo,
        };
        let mut pictures = work.read(Emission::Stated, channels, solver != DensitySolver::Cg, shown)?;
        if scattered {
            work.input.capture = explained(&work.input.capture).into_owned();
        }
        if let Some([least, most]) = pictures.observation.noise() {
            let percent = |noise: f64| format!("{:.2} %", 100.0 * noise);
            let (least, most) = (percent(least), percent(most));
            output.note(format!(
                "noise of the transmittances, of all channels together: {least} in the clearest picture, {most} in the \
                 noisiest"
            ));
        }
        if let Some(path) = cameras {
            let request = |work: &VolumeTask<'_>, observation: &Observation, placed: &Placed| {
                self.request(work, observation, placed, solver, Vec::new())
            };
            let refined = self.refinement.refine(&mut work, path, &self.region, &mut pictures, request);
            if let Err(code) = cancel::ended(refined)? {
                return Ok(code);
            }
        }
        let measurements = work.measure(&self.region, pictures)?;
        let request =
            self.request(&work, &measurements.pictures.observation, &measurements.unknowns.placed, solver, held_out);
        let request = request.map_err(|e| e.at(&work.input.json))?;
        let steps = solver.most_iterations(&measurements.pictures.observation, &request, views);
        work.plan(&measurements, &request, solver.method(), steps)?;

        let outcome = work.solve("density", steps, |watch| solver.reconstruct(&measurements, &request, watch));
        let Outcome { field, history, stages, train_psnr_db, held_out_psnr_db, unknowns, stopped } =
            match cancel::ended(outcome.map_err(|e| self.located(e, &work.input.json)))? {
                Ok(outcome) => outcome,
                Err(code) => return Ok(code),
            };
        work.solved(stages);
        let Pictures { excerpts, photos, observation } = measurements.pictures;
        drop((photos, observation));
        // A volume that is not settled yet does not tell about its cameras.
        let finest = history.iter().filter(|step| step.level == 0).count();
        let settled = solver == DensitySolver::Cg && finest >= SETTLED;
        let mut solved = Solved { history, train_psnr_db, held_out_psnr_db, unknowns, stopped };
        let mut grid = field.to_grid(&self.grid);
        let fit = Fit { excerpts: &excerpts, request: &request, train_psnr_db };
        let confidence = work.confidence(&mut solved, |tick| {
            let (grids, mut warnings) = confidence::of_densities(&field, &self.grid, fit, tick)?;
            warnings.extend(if settled { confidence::of_cameras(&field, fit)? } else { None });
            Ok((grids, warnings))
        })?;
        drop(field);

        if let Some(transfer) = transfer_of(&work.input.capture) {
            grid.metadata.insert(transfer::METADATA_KEY.into(), transfer::to_metadata(transfer));
        }
        let grids: Vec<&Grid> = std::iter::once(&grid).chain(&confidence).collect();
        work.write(|metadata| write_grids(&self.output, &grids, metadata, Codec::default(), false))?;
        let voxel_size = grid.transform.voxel_size().to_array();
        work.finish(solver.into(), self.grid.clone(), voxel_size, solved, request.held_out)
    }

    /// Loads the capture, and refuses pictures that do not tell the densities; the transfer function of `--tf` takes
    /// the place of its own.
    fn input(&self, limits: Limits) -> Result<LoadedCapture> {
        let mut input = LoadedCapture::load(&self.capture, limits)?;
        if let Some(transfer) = self.transfer.load(limits)? {
            input.suits_function()?;
            (input.capture.transfer, input.capture.model) = (Some(transfer), Model::EmissionAbsorption);
        }
        input.suits_alpha(limits)?;
        Ok(input)
    }

    fn solver(&self, capture: &Capture) -> Result<DensitySolver> {
        let source = explained(capture).medium()?.source;
        let solver = match (self.solver, source) {
            (Choice::Auto | Choice::Cg, Source::Grey(_)) => DensitySolver::Cg,
            (Choice::Cg, _) => {
                return Err(Error::unsupported("--solver cg needs pictures that depend on the optical depth alone")
                    .at(&self.capture)
                    .hint("these show emission that follows the density: leave it out, or use --solver weiss2021"));
            }
            (Choice::Auto, Source::Transfer(_)) => DensitySolver::ThroughTransfer,
            (Choice::Weiss2021, _) | (Choice::Auto, Source::Linear(_)) => DensitySolver::Weiss2021,
        };
        if solver == DensitySolver::Cg && self.prior.is_some() {
            return Err(Error::invalid("--prior is for descents, and conjugate gradients have a prior of their own")
                .hint("use --smoothing, or --solver weiss2021"));
        }
        Ok(solver)
    }

    fn request(
        &self,
        work: &VolumeTask<'_>,
        observation: &Observation,
        placed: &Placed,
        solver: DensitySolver,
        held_out: Vec<usize>,
    ) -> Result<Request> {
        let (task, capture) = (&work.task, &work.input.capture);
        let previous = (self.resume && self.output.exists()).then_some(&self.output);
        let init = self.init.as_ref().or(previous);
        let init = init.map(|path| protected::unprotected(path, || volume(path, task.limits))).transpose()?;
        Ok(Request {
            lattice: placed.lattice,
            bounds: placed.bounds,
            medium: explained(capture).medium()?,
            background: capture.background,
            rays_per_edge: run::rays_per_edge(capture.pixel_filter),
            smoothing: self.smoothing,
            prior: self.prior,
            robust: self.loss == Loss::Huber,
            held_out,
            iterations: self.iterations.unwrap_or(solver.usual_iterations(observation.noisy())),
            init,
            max_memory: task.limits.max_memory,
            cancel: task.stop(),
            closing: task.closing(),
        })
    }

    /// Names the file of a solver's error: that of `--tf` for an error of the function, else the capture.
    fn located(&self, error: Error, json: &Path) -> Error {
        let function = self.transfer.tf.as_deref().filter(|_| error.place() == Some(through_transfer::FUNCTION));
        error.at(function.unwrap_or(json))
    }
}

/// Returns the transfer function of emission-absorption pictures; none for other models.
fn transfer_of(capture: &Capture) -> Option<&Transfer> {
    capture.transfer.as_ref().filter(|_| capture.model == Model::EmissionAbsorption)
}

/// Iterations on the finest level from which on a volume suits its cameras, if they suit one another.
const SETTLED: usize = 8;

fn volume(path: &Path, limits: Limits) -> Result<Bricks<f32>> {
    let grid = File::open(path, limits)?.read_fog(None)?;
    Bricks::from_grid(&grid, limits.max_memory).map_err(|e| e.at(path))
}

/// Returns the capture whose pictures the densities explain: of a medium that scatters light, alpha takes the place of
/// the colors.
fn explained(capture: &Capture) -> Cow<'_, Capture> {
    if capture.model == Model::Scattering { Cow::Owned(capture.by_alpha()) } else { Cow::Borrowed(capture) }
}

/// Returns the channels of the pictures that tell the optical depths.
fn channels(capture: &Capture) -> Result<Channels> {
    if capture.model == Model::Scattering {
        return Ok(Channels::Alpha);
    }
    Ok(match capture.medium()?.source {
        Source::Grey(source) => Channels::Colors { background: capture.background, source },
        // Where the source varies, colors do not tell the optical depth: alpha does.
        Source::Linear(_) | Source::Transfer(_) => Channels::Alpha,
    })
}
