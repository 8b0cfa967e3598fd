//! `cumulo reconstruct color`: a pre-shaded volume from emission-absorption pictures.

use super::confidence;
use super::region::{Chosen, Region};
use crate::cli::memory::Memory;
use crate::cli::output::Output;
use crate::cli::outputs::{self, Content};
use crate::cli::photos;
use crate::cli::run::{self, Run, Solver};
use crate::cli::task::{Task, ended};
use crate::error::{Error, Result};
use crate::formats::transforms;
use crate::formats::vdb::{File, shaded};
use crate::optimise::color::{self, Shaded};
use crate::optimise::density::{Request, Stage, Step};
use crate::optimise::plausibility::cost::{Cost, Method};
use crate::optimise::plausibility::residuals;
use crate::optimise::projection::observation::Observation;
use crate::report::{MOST_VIEWS, choose};
use crate::scene::capture::{Capture, Model};
use crate::scene::grid::Grid;
use crate::scene::medium::Medium;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

/// Reconstruct a pre-shaded volume from emission-absorption pictures: extinction and emitted color by voxel
///
/// Alpha tells the extinctions (grid 'density', per world length), the colors then tell what is emitted (grid
/// 'emission', vec3s, radiance per world length); grids of confidences, 0 to 1, say how much the pictures tell of either
/// in each voxel. `cumulo render --model pre-shaded` renders the result. Ctrl-C
/// writes what is there (exit code 1); --resume goes on from it.
#[derive(Debug, clap::Args)]
pub struct Color {
    /// transforms.json of the pictures, or its folder
    capture: PathBuf,
    /// VDB to write
    #[arg(long, short, value_name = "OUT.vdb")]
    output: PathBuf,
    #[command(flatten)]
    region: Region,
    /// Views that are not used, only looked at to know when to stop (default: one of 8 or more)
    #[arg(long, value_name = "K")]
    held_out: Option<usize>,
    /// Iterations of the extinctions on the finest level, at most
    #[arg(long, value_name = "N", default_value_t = 24, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    iterations: u32,
    /// Blur passes of the smoothness prior (default: as many as suit the held-out views and the pictures' noise)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=64))]
    smoothing: Option<u32>,
    /// Layer of the pictures (default: the beauty)
    #[arg(long, value_name = "NAME")]
    layer: Option<String>,
    /// Write a page that shows how it went
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    /// Start from the output, if it is there
    #[arg(long)]
    resume: bool,
    #[command(flatten)]
    pub(in crate::cli) memory: Memory,
}

impl Color {
    /// Reads, reconstructs, writes and reports.
    ///
    /// # Errors
    /// If the pictures cannot be read or used, or the outputs cannot be written.
    pub(super) fn run(&self, output: &Output) -> Result<ExitCode> {
        let mut task = Task::begin(&self.output, Content::Vdb, self.report.as_deref(), &self.memory)?;
        let limits = task.limits;
        let json = transforms::json_path(&self.capture);
        let capture = transforms::load_within(&json, limits)?;
        let inputs = outputs::of_capture(&json, &capture);
        outputs::spare([self.output.as_path()], inputs.iter().map(PathBuf::as_path))?;
        if capture.model == Model::Absorption {
            return Err(Error::unsupported("the pictures show absorption alone, which has no colors of its own")
                .at(&json)
                .hint("use `cumulo reconstruct density`, or state \"model\": \"emission-absorption\""));
        }
        let held_out = photos::held_out(self.held_out, capture.frames.len(), 8).map_err(|e| e.at(&self.capture))?;

        let begun = Instant::now();
        let (photos, mut warnings) = task.photos(&json, &capture, self.layer.as_deref(), output)?;
        // With the background's own color as source, alpha tells the optical depth.
        let observation = Observation::new(&photos, capture.background, capture.background).map_err(|e| e.at(&json))?;
        let mut chosen = self.region.choose(&capture, &observation, output).map_err(|e| e.at(&json))?;
        output.warn(&chosen.warnings);
        warnings.append(&mut chosen.warnings);
        let request = self.request(&capture, &chosen, held_out, &task);
        let previous = self.resume && self.output.exists();
        let init = previous.then(|| shaded::read(&File::open(&self.output, limits)?, None, limits.max_memory));
        let init = init.transpose()?;
        let mut stages = vec![Stage { name: "read pictures".into(), seconds: begun.elapsed().as_secs_f64() }];

        let pixels = photos.iter().map(|p| p.film.rgba.len() as u64).sum();
        let steps = color::most_iterations(&request);
        let expected = Cost::new(Method::Color, &chosen.survey, &request, pixels, steps);
        expected.fits(limits.max_memory).map_err(|e| e.at(&json))?;
        chosen.writable(&self.output)?;
        output.note(format!("expected: {expected}"));
        task.work_begins();
        let bar = output.progress(steps, "color");
        let outcome = color::reconstruct(&photos, &observation, &request, init, |step: &Step| {
            run::show(&bar, step);
            task.flow()
        });
        bar.finish_and_clear();
        let Shaded { volume, history, stages: solved, train_psnr_db, held_out_psnr_db, voxels, stopped } =
            match ended(outcome.map_err(|e| e.at(&json)))? {
                Ok(outcome) => outcome,
                Err(code) => return Ok(code),
            };
        stages.extend(solved);
        drop(observation);
        let begun = Instant::now();
        let (known, mut found) = {
            let stage = output.stage("confidence");
            confidence::grids(&volume, &photos, &request, train_psnr_db, |done, of| stage.at(done, of))
        };
        found.extend(residuals::held_out(train_psnr_db, held_out_psnr_db));
        found.extend(residuals::unexplained(train_psnr_db));
        if !stopped {
            warnings.append(&mut found);
        }
        let stopped = stopped || known.is_empty();
        stages.push(Stage { name: "confidence".into(), seconds: begun.elapsed().as_secs_f64() });
        drop(photos);

        let begun = Instant::now();
        let seconds = task.provenance.lap();
        let known: Vec<&Grid> = known.iter().collect();
        shaded::write(&self.output, &volume, &known, &task.provenance.metadata())?;
        stages.push(Stage { name: "write".into(), seconds: begun.elapsed().as_secs_f64() });
        let views = capture.frames.len();
        let run = Run {
            capture: json,
            output: self.output.clone(),
            grid: shaded::EXTINCTION.into(),
            solver: Solver::Color,
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
            voxel_size: volume.transform.voxel_size().to_array(),
            unknowns: voxels,
            expected: Some(expected),
            warnings,
            report: None,
            stages,
            history,
            provenance: task.provenance.clone(),
        };
        task.finish(run, output)
    }

    fn request(&self, capture: &Capture, chosen: &Chosen, held_out: Vec<usize>, task: &Task<'_>) -> Request {
        Request {
            lattice: chosen.lattice,
            bounds: chosen.bounds,
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
            closing: task.closing(),
        }
    }
}
