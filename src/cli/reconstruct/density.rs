//! `cumulo reconstruct density`: a VDB from absorption or emission-absorption pictures.

use super::confidence;
use super::region::{Chosen, Region};
use crate::cli::memory::Memory;
use crate::cli::output::Output;
use crate::cli::outputs::{self, Content};
use crate::cli::photos;
use crate::cli::run::{self, Run, Solver};
use crate::cli::task::{Task, ended};
use crate::cli::transfer::TransferOption;
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::formats::vdb::{Codec, File, write_grids};
use crate::formats::{transfer, transforms};
use crate::optimise::density::{self, through_transfer, weiss2021};
use crate::optimise::density::{Outcome, Request, Stage, Step};
use crate::optimise::loss::prior::{VolumePrior, Weighted};
use crate::optimise::plausibility::cost::{Cost, Method};
use crate::optimise::plausibility::residuals;
use crate::optimise::projection::observation::{Observation, Photo};
use crate::report::{MOST_VIEWS, choose};
use crate::scene::bricks::Bricks;
use crate::scene::capture::{Capture, Model};
use crate::scene::grid::Grid;
use crate::scene::medium::Source;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

/// Reconstruct the density of a volume from pictures of it
///
/// The pictures' density scale is divided out, so that the result stands beside the volume that was rendered. Ctrl-C
/// writes what is there (exit code 1); --resume goes on from it.
#[derive(Debug, clap::Args)]
pub struct Density {
    /// transforms.json of the pictures, or its folder
    capture: PathBuf,
    /// VDB to write
    #[arg(long, short, value_name = "OUT.vdb")]
    output: PathBuf,
    #[command(flatten)]
    region: Region,
    #[command(flatten)]
    transfer: TransferOption,
    /// Start from this volume
    #[arg(long, value_name = "IN.vdb")]
    init: Option<PathBuf>,
    /// How the densities are found: auto is cg where the pictures depend on the optical depth alone, colors first
    /// where there is a transfer function, else weiss2021
    #[arg(long, value_enum, default_value_t = Choice::Auto)]
    solver: Choice,
    /// Views that are not used, only looked at to know when to stop (default: one of 8 or more)
    #[arg(long, value_name = "K")]
    held_out: Option<usize>,
    /// Iterations on the finest level, at most (default: 24; with a transfer function, or weiss2021: 50 epochs)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    iterations: Option<u32>,
    /// Blur passes of the smoothness prior (default: as many as suit the held-out views; without these 1, or 2 where the pictures are noisy)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=64))]
    smoothing: Option<u32>,
    /// What a descent (behind a transfer function, or weiss2021) asks of neighbouring voxels: smooth=W, or tv=W for total
    /// variation, W the weight in units of the range of densities (default: smooth=0.001, weiss2021 smooth=0.5)
    #[arg(long, value_name = "NAME=W")]
    prior: Option<Weighted<VolumePrior>>,
    /// What cg makes small: huber bounds the influence of outliers, l2 is plain least squares
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

/// The solver that suits the pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Way {
    Cg,
    Weiss2021,
    ThroughTransfer,
}

impl From<Way> for Solver {
    fn from(way: Way) -> Self {
        match way {
            Way::Cg => Self::Cg,
            Way::Weiss2021 => Self::Weiss2021,
            Way::ThroughTransfer => Self::ThroughTransfer,
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
    /// Reads, reconstructs, writes and reports.
    ///
    /// # Errors
    /// If the pictures cannot be read or used, or the outputs cannot be written.
    pub(super) fn run(&self, output: &Output) -> Result<ExitCode> {
        let mut task = Task::begin(&self.output, Content::Vdb, self.report.as_deref(), &self.memory)?;
        let limits = task.limits;
        let json = transforms::json_path(&self.capture);
        let mut capture = transforms::load_within(&json, limits)?;
        let inputs = outputs::of_capture(&json, &capture);
        let others = [&self.transfer.tf, &self.init].into_iter().flatten();
        outputs::spare([self.output.as_path()], inputs.iter().chain(others).map(PathBuf::as_path))?;
        if let Some(transfer) = self.transfer.load(limits)? {
            (capture.transfer, capture.model) = (Some(transfer), Model::EmissionAbsorption);
        }
        let way = self.way(&capture)?;
        if way == Way::Cg && self.prior.is_some() {
            return Err(Error::invalid("--prior is for descents, and conjugate gradients have a prior of their own")
                .hint("use --smoothing, or --solver weiss2021"));
        }
        let held_out = photos::held_out(self.held_out, capture.frames.len(), 8).map_err(|e| e.at(&self.capture))?;

        let begun = Instant::now();
        let (photos, mut warnings) = task.photos(&json, &capture, self.layer.as_deref(), output)?;
        let observation = observe(&photos, &capture).map_err(|e| e.at(&json))?;
        let mut chosen = self.region.choose(&capture, &observation, output).map_err(|e| e.at(&json))?;
        output.warn(&chosen.warnings);
        warnings.append(&mut chosen.warnings);
        let request = self.request(&capture, &chosen, way, held_out, &task).map_err(|e| e.at(&json))?;
        let mut stages = vec![Stage { name: "read pictures".into(), seconds: begun.elapsed().as_secs_f64() }];

        let used = photos.len() - request.held_out.len();
        let length = match way {
            Way::Weiss2021 => weiss2021::most_iterations(&request, used),
            Way::ThroughTransfer => through_transfer::most_iterations(&request, used),
            Way::Cg => density::most_iterations(&request),
        };
        let method = match way {
            Way::Cg => Method::Cg,
            Way::Weiss2021 => Method::Descent,
            Way::ThroughTransfer => Method::ThroughTransfer,
        };
        let pixels = photos.iter().map(|p| p.film.rgba.len() as u64).sum();
        let expected = Cost::new(method, &chosen.survey, &request, pixels, length);
        expected.fits(limits.max_memory).map_err(|e| e.at(&json))?;
        chosen.writable(&self.output)?;
        output.note(format!("expected: {expected}"));
        task.work_begins();
        let bar = output.progress(length, "density");
        let watch = |step: &Step| {
            run::show(&bar, step);
            task.flow()
        };
        let outcome = match way {
            Way::Weiss2021 => weiss2021::reconstruct(&photos, &observation, &request, watch),
            Way::ThroughTransfer => through_transfer::reconstruct(&photos, &observation, &request, watch),
            Way::Cg => density::reconstruct(&observation, &request, watch),
        };
        bar.finish_and_clear();
        // What is wrong with the function is wrong with its file.
        let function = |e: &Error| self.transfer.tf.as_ref().filter(|_| e.place() == Some(through_transfer::FUNCTION));
        let placed = outcome.map_err(|e| {
            let file = function(&e).unwrap_or(&json).clone();
            e.at(file)
        });
        let Outcome { field, history, stages: solved, train_psnr_db, held_out_psnr_db, unknowns, stopped } =
            match ended(placed)? {
                Ok(outcome) => outcome,
                Err(code) => return Ok(code),
            };
        stages.extend(solved);
        drop(observation);
        let begun = Instant::now();
        let mut grid = field.to_grid(&self.grid);
        let (known, found) = {
            let stage = output.stage("confidence");
            confidence::grid(&field, &photos, &request, train_psnr_db, &self.grid, |done, of| stage.at(done, of))?
        };
        let mut found = found;
        found.extend(residuals::held_out(train_psnr_db, held_out_psnr_db));
        found.extend(residuals::unexplained(train_psnr_db));
        if !stopped {
            warnings.append(&mut found);
        }
        let stopped = stopped || known.is_none();
        stages.push(Stage { name: "confidence".into(), seconds: begun.elapsed().as_secs_f64() });
        drop((photos, field));

        let begun = Instant::now();
        let seconds = task.provenance.lap();
        if let Some(transfer) = capture.transfer.as_ref().filter(|_| capture.model == Model::EmissionAbsorption) {
            grid.metadata.insert(transfer::METADATA_KEY.into(), transfer::to_metadata(transfer));
        }
        let grids: Vec<&Grid> = std::iter::once(&grid).chain(&known).collect();
        write_grids(&self.output, &grids, &task.provenance.metadata(), Codec::default(), false)?;
        stages.push(Stage { name: "write".into(), seconds: begun.elapsed().as_secs_f64() });
        let views = capture.frames.len();
        let run = Run {
            capture: json,
            output: self.output.clone(),
            grid: self.grid.clone(),
            solver: way.into(),
            layer: self.layer.clone(),
            iterations: history.len() as u32,
            seconds,
            train_psnr_db: Some(train_psnr_db).filter(|v| v.is_finite()),
            held_out_psnr_db: held_out_psnr_db.filter(|v| v.is_finite()),
            peak_memory_mb: run::peak_memory_mb(),
            stopped,
            views,
            shown: choose(&(0..views).map(|i| request.held_out.contains(&i)).collect::<Vec<_>>(), MOST_VIEWS),
            held_out: request.held_out,
            voxel_size: grid.transform.voxel_size().to_array(),
            unknowns,
            expected: Some(expected),
            warnings,
            report: None,
            stages,
            history,
            provenance: task.provenance.clone(),
        };
        task.finish(run, output)
    }

    fn way(&self, capture: &Capture) -> Result<Way> {
        let source = capture.medium()?.source;
        match (self.solver, source) {
            (Choice::Auto | Choice::Cg, Source::Grey(_)) => Ok(Way::Cg),
            (Choice::Cg, _) => {
                Err(Error::unsupported("--solver cg needs pictures that depend on the optical depth alone")
                    .at(&self.capture)
                    .hint("these show emission that follows the density: leave it out, or use --solver weiss2021"))
            }
            (Choice::Auto, Source::Transfer(_)) => Ok(Way::ThroughTransfer),
            (Choice::Weiss2021, _) | (Choice::Auto, Source::Linear(_)) => Ok(Way::Weiss2021),
        }
    }

    fn request(
        &self,
        capture: &Capture,
        chosen: &Chosen,
        way: Way,
        held_out: Vec<usize>,
        task: &Task<'_>,
    ) -> Result<Request> {
        let limits = task.limits;
        let previous = (self.resume && self.output.exists()).then_some(&self.output);
        let init = self.init.as_ref().or(previous).map(|path| volume(path, limits)).transpose()?;
        Ok(Request {
            lattice: chosen.lattice,
            bounds: chosen.bounds,
            medium: capture.medium()?,
            background: capture.background,
            rays_per_edge: run::rays_per_edge(capture.pixel_filter),
            smoothing: self.smoothing,
            prior: self.prior,
            robust: self.loss == Loss::Huber,
            held_out,
            iterations: self.iterations.unwrap_or(if way == Way::Cg { 24 } else { 50 }),
            init,
            max_memory: limits.max_memory,
            cancel: task.stop(),
            closing: task.closing(),
        })
    }
}

fn volume(path: &Path, limits: Limits) -> Result<Bricks<f32>> {
    let grid = File::open(path, limits)?.read_fog(None)?;
    Bricks::from_grid(&grid, limits.max_memory).map_err(|e| e.at(path))
}

fn observe(photos: &[Photo], capture: &Capture) -> Result<Observation> {
    match capture.medium()?.source {
        Source::Grey(color) => Observation::new(photos, capture.background, color),
        // Where the source varies, colors do not tell the optical depth: alpha does.
        Source::Linear(_) | Source::Transfer(_) => Observation::new(photos, capture.background, capture.background),
    }
}
