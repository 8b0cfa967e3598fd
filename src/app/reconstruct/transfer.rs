//! The transfer function that a known volume was rendered with.

use super::capture::LoadedCapture;
use super::page;
use super::page::transfer::{self as transfer_page, View};
use super::stages::StageClock;
use super::transfer_run::TransferRun;
use crate::app::Context;
use crate::app::checks::excerpt::Excerpt;
use crate::app::checks::residuals::{self, Residuals};
use crate::app::checks::{Emission, Warning};
use crate::app::earlier::InitialGuess;
use crate::app::inputs;
use crate::app::outputs::Content;
use crate::app::ranges;
use crate::app::task::{Captured, Task, without_result};
use crate::app::use_case::{Report, Status, use_case};
use crate::app::{photos, run};
use crate::cancel::Cancel;
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::formats::transfer::{self, Options};
use crate::inverse::cost::Cost;
use crate::inverse::observation::photo::Photo;
use crate::inverse::progress::Stage;
use crate::inverse::transfer::reconstruct::reconstruct;
use crate::inverse::transfer::{Outcome, Request, Solver};
use crate::metrics::error::unit_psnr_db;
use crate::render::dvr::Dvr;
use crate::render::labels::not_differentiated;
use crate::render::quadrature::Quadrature;
use crate::scene::bricks::Bricks;
use crate::scene::capture::{Capture, Model};
use crate::scene::medium::{Medium, Source};
use crate::scene::transfer::Transfer;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Settings of a reconstruction of the transfer function of a known volume.
///
/// The pictures' density scale is divided out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct TransferFunctionSettings {
    /// transforms.json of the pictures, a model of COLMAP, or the folder of either.
    #[serde(with = "crate::app::paths")]
    pub capture: PathBuf,
    /// VDB of the volume in the pictures.
    #[serde(with = "crate::app::paths")]
    pub volume: PathBuf,
    /// Transfer function (JSON) to write.
    #[serde(with = "crate::app::paths")]
    pub output: PathBuf,
    /// Number of texels, 2 to 1024.
    pub texels: u32,
    /// Densities that the texels cover; none for those of the volume, from 0.
    pub domain: Option<[f64; 2]>,
    /// How the function is found.
    pub solver: Choice,
    /// Weight of the smoothness prior beside the pictures; none for the best for the held-out view, and 0.4 for
    /// [`Choice::Weiss2021`].
    pub smooth: Option<f64>,
    /// Number of views that are not fitted, but compared with; none for one of 3 or more.
    pub held_out: Option<usize>,
    /// Number of pixels that are drawn from the pictures, 64 to 16777216.
    pub rays: u32,
    /// Most refinements; none for 14, or one for each of the 7 weights that held-out views choose from, and for
    /// [`Choice::Weiss2021`] 200 epochs.
    pub iterations: Option<u32>,
    /// Integration along rays.
    pub quadrature: Quadrature,
    /// Transfer function to start from, whatever made it.
    #[serde(with = "crate::app::paths")]
    pub init: Option<PathBuf>,
    /// Whether to go on from the output, if an earlier run of the same settings has left it.
    pub resume: bool,
    /// Grid of the volume; none for density, else the only scalar one.
    pub grid: Option<String>,
    /// Layer of the pictures; none for the only one.
    pub layer: Option<String>,
    /// Folder of a page that shows the result; none for no page.
    #[serde(with = "crate::app::paths")]
    pub report: Option<PathBuf>,
    /// Memory that the work may take.
    #[serde(flatten)]
    pub limits: Limits,
}

impl Default for TransferFunctionSettings {
    fn default() -> Self {
        Self {
            capture: PathBuf::new(),
            volume: PathBuf::new(),
            output: PathBuf::new(),
            texels: 64,
            domain: None,
            solver: Choice::Auto,
            smooth: None,
            held_out: None,
            rays: 32_768,
            iterations: None,
            quadrature: Quadrature::Midpoint(0.5),
            init: None,
            resume: false,
            grid: None,
            layer: None,
            report: None,
            limits: Limits::default(),
        }
    }
}

/// How a transfer function is to be found.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Choice {
    /// Gauss and Newton's least squares.
    #[default]
    Auto,
    /// Adam as in Weiss & Westermann (2021); colors lie between 0 and 1.
    Weiss2021,
}

use_case!(TransferFunctionSettings => TransferRun, limits);

impl Report for TransferRun {
    fn status(&self) -> Result<Status> {
        Ok(Status::stopped(self.stopped))
    }
}

impl TransferFunctionSettings {
    /// Paths that the function is made from.
    pub(crate) fn inputs(&self) -> Vec<&Path> {
        [&self.capture, &self.volume].into_iter().chain(&self.init).map(PathBuf::as_path).collect()
    }

    /// Reads, reconstructs and writes.
    ///
    /// # Errors
    /// If the pictures or the volume cannot be read or used, or the outputs cannot be written.
    pub fn run(&self, context: &Context) -> Result<TransferRun> {
        let _inputs = inputs::protect(self.inputs(), self.limits);
        ranges::within("texels", self.texels, [2, 1024])?;
        ranges::within("rays", self.rays, [64, 1 << 24])?;
        ranges::within("iterations", self.iterations, [1, 100_000])?;
        ranges::positive("smooth", self.smooth)?;
        if let Some([low, high]) = self.domain {
            ranges::require("domain", [low, high], low < high && (high - low).is_finite(), "two ascending numbers")?;
        }
        let (page, limits) = (self.report.as_deref(), self.limits);
        let mut task = Task::begin(&self.output, Content::TransferFunction, page, limits, context)?;
        let (init, resume, output) = (self.init.as_deref(), self.resume, &self.output);
        task.search("reconstruct tf", self, InitialGuess { init, resume, output, overwrite: None })?;
        let mut clock = StageClock::start();
        let LoadedCapture { json, capture, .. } = self.input(limits)?;
        let held_out = photos::held_out(self.held_out, capture.frames.len(), 3).map_err(|e| e.at(&json))?;
        let captured =
            Captured { json: &json, capture: &capture, emission: Emission::Sought, layer: self.layer.as_deref() };
        let (photos, mut warnings) = task.pictures(captured, photos::WHOLE, |photo| photo)?;
        let field = self.field(&mut task)?;
        let request = self.request(&capture, &field, held_out, &task)?;
        let expected = cost(&request, &field, &photos);
        expected.fits(limits.max_memory).map_err(|e| e.at(&json))?;
        context.note(format!("expected: {expected}"));
        task.work_begins();
        clock.end("read");

        let outcome = solve(&field, &photos, &request, &task).map_err(|e| without_result(e.at(&json)))?;
        if !outcome.stopped {
            warnings.extend(residual_warnings(&outcome, &field, &photos, &request)?);
        }
        clock.append(outcome.stages);
        self.write(&outcome.transfer, &mut task)?;
        let views = photos.len();
        let mut run = TransferRun {
            capture: json,
            volume: self.volume.clone(),
            grid: self.grid.clone(),
            output: self.output.clone(),
            solver: request.solver,
            layer: self.layer.clone(),
            texels: self.texels,
            domain: request.domain,
            smooth: outcome.smooth,
            iterations: outcome.history.len(),
            seconds: task.provenance.seconds,
            train_rms: outcome.history.last().map(|s| s.rms),
            views,
            shown: photos::report_views(views, &request.held_out),
            held_out: request.held_out,
            held_out_psnr_db: None,
            held_out_ssim: None,
            quadrature: request.quadrature,
            peak_memory_mb: run::peak_memory_mb(),
            stopped: outcome.stopped,
            expected: Some(expected),
            warnings,
            report: None,
            confidence: outcome.confidence,
            stages: clock.into_stages(),
            history: outcome.history,
            provenance: task.provenance.clone(),
        };
        drop((photos, field));
        {
            let _stage = context.stage("views");
            self.compare_views(&mut run, limits, &task.closing())?;
        }
        task.tell_stopped(run.stopped);
        Ok(run)
    }

    /// Loads the capture, and refuses pictures without colors.
    fn input(&self, limits: Limits) -> Result<LoadedCapture> {
        let input = LoadedCapture::load(&self.capture, limits)?;
        if input.capture.model == Model::Absorption {
            return Err(Error::unsupported("the pictures show absorption alone, which has no colors")
                .at(&input.json)
                .hint(
                    "a transfer function needs pictures of emission and absorption: \"model\": \"emission-absorption\"",
                ));
        }
        input.suits_function()?;
        Ok(input)
    }

    /// Reads the volume in the pictures.
    fn field(&self, task: &mut Task) -> Result<Bricks<f32>> {
        let field = {
            let _stage = task.context.stage("reading the volume");
            transfer_page::field(&self.volume, self.grid.as_deref(), task.limits)?
        };
        task.provenance.input(&self.volume, [self.volume.as_path()])?;
        Ok(field)
    }

    /// Writes the transfer function with its provenance.
    fn write(&self, transfer: &Transfer, task: &mut Task) -> Result<()> {
        task.provenance.lap();
        let origin = serde_json::to_value(&task.provenance).map_err(|e| Error::invalid(e.to_string()))?;
        transfer::save(&self.output, transfer, None, Some(&origin))
    }

    /// Compares renders with the held-out views, and writes the page if there is to be one.
    fn compare_views(&self, run: &mut TransferRun, limits: Limits, closing: &Cancel) -> Result<()> {
        let begun = Instant::now();
        let mut which = run.held_out.clone();
        if self.report.is_some() {
            which.extend(run.shown.iter().filter(|i| !run.held_out.contains(i)));
        }
        let mut views = transfer_page::views(run, &which, limits, None, closing)?;
        let of_held_out = |value: fn(&View) -> f64| {
            let values: Vec<f64> = views.iter().filter(|v| v.row.held_out).map(value).collect();
            (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
        };
        run.held_out_psnr_db = of_held_out(|v| v.square).map(unit_psnr_db);
        run.held_out_ssim = of_held_out(|v| v.ssim);
        let train_psnr_db = run.train_rms.map_or(f64::NAN, |rms| unit_psnr_db(rms * rms));
        if !run.stopped {
            run.warnings.extend(residuals::held_out(train_psnr_db, run.held_out_psnr_db));
            run.warnings.extend(residuals::unexplained(train_psnr_db));
        }
        run.stages.push(Stage { name: "views".into(), seconds: begun.elapsed().as_secs_f64() });
        if let Some(dir) = &self.report {
            let place = |view: &View| run.shown.iter().position(|i| *i == view.number);
            views.retain(|view| place(view).is_some());
            views.sort_by_key(place);
            run.report = Some(page::write_transfer(dir, run, views)?);
        }
        Ok(())
    }

    fn request(&self, capture: &Capture, field: &Bricks<f32>, held_out: Vec<usize>, task: &Task) -> Result<Request> {
        let load = |path: &Path| transfer::load(path, &Options::default()).map(|loaded| loaded.transfer);
        let init = task.read_initial_guess(load)?;
        if [&capture.transfer, &init].into_iter().flatten().any(Transfer::is_of_labels) {
            return Err(not_differentiated().at(&self.capture));
        }
        let (solver, usual) = match self.solver {
            Choice::Auto => (Solver::Newton, 14),
            Choice::Weiss2021 => (Solver::Weiss2021, 200),
        };
        let request = Request {
            solver,
            extinction: capture.density_scale,
            background: capture.background,
            quadrature: self.quadrature,
            domain: self.domain.unwrap_or_else(|| transfer_page::domain(field)),
            texels: self.texels as usize,
            smooth: self.smooth,
            held_out,
            rays: self.rays as usize,
            rays_per_edge: run::rays_per_edge(capture.pixel_filter),
            iterations: self.iterations.unwrap_or(usual),
            init,
            cancel: task.stop(),
        };
        Ok(request)
    }
}

fn solve(field: &Bricks<f32>, photos: &[Photo], request: &Request, task: &Task) -> Result<Outcome> {
    let bar = task.context.steps(u64::from(request.most_steps()), "transfer function");
    let outcome = reconstruct(field, photos, request, |step| {
        let psnr = step.held_out_psnr_db.map(|p| format!(", held-out {p:.2} dB")).unwrap_or_default();
        bar.reach(step.iteration.into(), format!("smoothness {:.0e}, rms {:.2e}{psnr}", step.smooth, step.rms));
        task.flow()
    });
    drop(bar);
    outcome
}

/// Returns the warnings of the residuals between pictures and renders with the reconstructed function.
fn residual_warnings(
    outcome: &Outcome,
    field: &Bricks<f32>,
    photos: &[Photo],
    request: &Request,
) -> Result<Vec<Warning>> {
    let source = Source::Transfer(Arc::new(outcome.transfer.table()?));
    let dvr = Dvr::new(field, Medium::new(request.extinction, source))?
        .quadrature(request.quadrature)
        .over(request.background);
    let excerpts = Excerpt::all(photos);
    let residuals = Residuals::new(&dvr, &excerpts, &request.held_out, request.rays_per_edge, &request.cancel);
    Ok(residuals.map(|r| r.warnings()).unwrap_or_default())
}

/// Estimates the cost of the search; the volume is in memory already.
fn cost(request: &Request, field: &Bricks<f32>, photos: &[Photo]) -> Cost {
    let pixels: usize = photos.iter().map(|p| p.film.rgba.len()).sum();
    let edge = (field.values.len() as f64).cbrt();
    Cost::of_function(
        request.texels,
        field.values.len(),
        pixels,
        (request.rays * request.rays_per_edge.pow(2)) as f64 * edge,
        request.most_steps(),
    )
}
