//! `cumulo reconstruct tf`: the transfer function that a known volume was rendered with.

use crate::cli::memory::Memory;
use crate::cli::output::Output;
use crate::cli::provenance::Provenance;
use crate::cli::{cancel, parse, photos, run};
use crate::error::{Error, Result};
use crate::formats::transfer::{self, Options};
use crate::formats::vdb::{File, Limits};
use crate::formats::{atomic, transforms};
use crate::metrics;
use crate::optimise::density::Stage;
use crate::optimise::observation::Photo;
use crate::optimise::transfer::{Outcome, Request, Step, reconstruct};
use crate::render;
use crate::render::dvr::Dvr;
use crate::render::quadrature::Quadrature;
use crate::report::{MOST_VIEWS, Page, Plot, Series, ViewRow, choose};
use crate::scene::bricks::Bricks;
use crate::scene::capture::{Capture, Model};
use crate::scene::medium::{Medium, Source};
use crate::scene::transfer::Transfer;
use serde::Serialize;
use std::fmt;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// Reconstruct the transfer function of a known volume from pictures of it
///
/// The pictures' density scale is divided out. How smooth the function is, the held-out view decides, unless --smooth
/// says so. Ctrl-C writes what is there (exit code 1); --resume goes on from it.
#[derive(Debug, clap::Args)]
pub struct Tf {
    /// transforms.json of the pictures, or its folder
    capture: PathBuf,
    /// The volume in the pictures
    #[arg(long, value_name = "V.vdb")]
    volume: PathBuf,
    /// Transfer function to write
    #[arg(long, short, value_name = "OUT.tf.json")]
    output: PathBuf,
    /// Texels of the function
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u32).range(2..=1024))]
    texels: u32,
    /// Densities that the texels cover (default: those of the volume, from 0)
    #[arg(long, value_name = "LOW,HIGH", value_parser = parse::ascending, allow_hyphen_values = true)]
    domain: Option<[f64; 2]>,
    /// Weight of the smoothness prior beside the pictures (default: the best for the held-out view)
    #[arg(long, value_name = "W", value_parser = parse::positive)]
    smooth: Option<f64>,
    /// Views that are not used but compared with (default: 1 if there are 3 or more)
    #[arg(long, value_name = "N")]
    held_out: Option<usize>,
    /// Pixels drawn from the pictures
    #[arg(long, value_name = "N", default_value_t = 32_768, value_parser = clap::value_parser!(u32).range(64..=16_777_216))]
    rays: u32,
    /// Most refinements
    #[arg(long, value_name = "N", default_value_t = 14, value_parser = clap::value_parser!(u32).range(1..=1000))]
    iterations: u32,
    /// Integration along rays: exact, midpoint:STEP or riemann:STEP, steps in voxels
    #[arg(long, value_name = "Q", default_value = "midpoint:0.5")]
    quadrature: Quadrature,
    /// Transfer function to begin with
    #[arg(long, value_name = "FILE")]
    init: Option<PathBuf>,
    /// Begin with the output of an earlier run
    #[arg(long)]
    resume: bool,
    /// Grid of the volume (default: density, else the only scalar one)
    #[arg(long, value_name = "NAME")]
    grid: Option<String>,
    /// Layer of the pictures (default: the only one)
    #[arg(long, value_name = "NAME")]
    layer: Option<String>,
    /// Write an HTML page with the result to this folder
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    #[command(flatten)]
    memory: Memory,
}

#[derive(Debug, Serialize)]
struct Report {
    capture: PathBuf,
    volume: PathBuf,
    output: PathBuf,
    texels: u32,
    domain: [f64; 2],
    smooth: f64,
    iterations: usize,
    seconds: f64,
    /// Over the rays that were used.
    train_rms: Option<f64>,
    held_out: Vec<usize>,
    held_out_psnr_db: Option<f64>,
    held_out_ssim: Option<f64>,
    quadrature: String,
    peak_memory_mb: Option<f64>,
    stopped: bool,
    report: Option<PathBuf>,
    confidence: Vec<[f64; 2]>,
    stages: Vec<Stage>,
    history: Vec<Step>,
    provenance: Provenance,
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [low, high] = self.domain;
        writeln!(f, "{}: {} texels over densities {low} to {high}", self.output.display(), self.texels)?;
        writeln!(f, "  {} refinements in {:.2} s, smoothness {:.0e}", self.iterations, self.seconds, self.smooth)?;
        if let (Some(psnr), Some(ssim)) = (self.held_out_psnr_db, self.held_out_ssim) {
            writeln!(f, "  held-out views {psnr:.2} dB, SSIM {ssim:.4} ({})", self.held_out.len())?;
        }
        let unseen = self.confidence.iter().filter(|c| c[0] < 0.5).count();
        if unseen > 0 {
            writeln!(f, "  {unseen} texels are the prior's more than the pictures'")?;
        }
        if let Some(page) = &self.report {
            writeln!(f, "  report         {}", page.display())?;
        }
        Ok(())
    }
}

impl Tf {
    /// Reads, reconstructs, writes and reports.
    ///
    /// # Errors
    /// If the pictures or the volume cannot be read or used, or the outputs cannot be written.
    pub(super) fn run(&self, output: &Output) -> Result<ExitCode> {
        let cancel = cancel::listen();
        let mut provenance = Provenance::begin();
        let limits = self.memory.limits();
        atomic::probe(&self.output)?;
        if let Some(dir) = &self.report {
            std::fs::create_dir_all(dir).map_err(|e| Error::io(dir, e))?;
        }
        let begun = Instant::now();
        let capture = transforms::load(&self.capture)?;
        let json = transforms::json_path(&self.capture);
        if capture.model == Model::Absorption {
            return Err(Error::unsupported("the pictures show absorption alone, which has no colours").at(&json).hint(
                "a transfer function needs pictures of emission and absorption: \"model\": \"emission-absorption\"",
            ));
        }
        let held_out = photos::held_out(self.held_out, capture.frames.len(), 3).map_err(|e| e.at(&json))?;
        let photos = photos::read(&capture, self.layer.as_deref(), limits)?;
        let pictures = capture.frames.iter().map(|f| f.picture.as_path());
        provenance.input(&json, std::iter::once(json.as_path()).chain(pictures))?;
        let field = self.field(limits)?;
        provenance.input(&self.volume, [self.volume.as_path()])?;
        let request = self.request(&capture, &field, held_out)?;
        let mut stages = vec![Stage { name: "read".into(), seconds: begun.elapsed().as_secs_f64() }];

        let bar = output.progress(u64::from(self.iterations), "transfer function");
        let outcome = reconstruct(&field, &photos, &request, |step| {
            bar.set_position(u64::from(step.iteration));
            let psnr = step.held_out_psnr_db.map(|p| format!(", held-out {p:.2} dB")).unwrap_or_default();
            bar.set_message(format!("smoothness {:.0e}, rms {:.2e}{psnr}", step.smooth, step.rms));
            if cancel.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        bar.finish_and_clear();
        let outcome = outcome.map_err(|e| e.at(&json))?;
        stages.extend(outcome.stages.iter().cloned());
        let seconds = provenance.lap();
        let origin = serde_json::to_value(&provenance).map_err(|e| Error::invalid(e.to_string()))?;
        transfer::save(&self.output, &outcome.transfer, None, Some(&origin))?;
        if outcome.stopped {
            output.note("stopped; what was there by then is written, and --resume goes on from it");
        }

        let begun = Instant::now();
        let shown = choose(&(0..photos.len()).map(|i| request.held_out.contains(&i)).collect::<Vec<_>>(), MOST_VIEWS);
        let looked_at = if self.report.is_some() { shown } else { request.held_out.clone() };
        let rows = views(&field, &photos, &request, &outcome.transfer, &looked_at)?;
        stages.push(Stage { name: "views".into(), seconds: begun.elapsed().as_secs_f64() });
        let of_held_out = |value: fn(&View) -> f64| {
            let values: Vec<f64> = rows.iter().filter(|r| r.row.held_out).map(value).collect();
            (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
        };
        let mut report = Report {
            capture: json,
            volume: self.volume.clone(),
            output: self.output.clone(),
            texels: self.texels,
            domain: request.domain,
            smooth: outcome.smooth,
            iterations: outcome.history.len(),
            seconds,
            train_rms: outcome.history.last().map(|s| s.rms),
            held_out: request.held_out.clone(),
            held_out_psnr_db: of_held_out(|v| v.square).map(|square| -10.0 * square.max(1e-20).log10()),
            held_out_ssim: of_held_out(|v| v.ssim),
            quadrature: request.quadrature.to_string(),
            peak_memory_mb: run::peak_memory_mb(),
            stopped: outcome.stopped,
            report: None,
            confidence: outcome.confidence.clone(),
            stages,
            history: outcome.history.clone(),
            provenance,
        };
        if let Some(dir) = &self.report {
            report.report = Some(page(&report, &outcome, rows, photos.len())?.write(dir)?);
        }
        output.report(&report)?;
        Ok(if outcome.stopped { ExitCode::from(1) } else { ExitCode::SUCCESS })
    }

    /// The volume, with all of its box: the function may absorb where the density is zero.
    fn field(&self, limits: Limits) -> Result<Bricks<f32>> {
        let grid = File::open(&self.volume, limits)?.read_fog(self.grid.as_deref())?;
        let arrange = || {
            let mut field = Bricks::from_grid(&grid, limits.max_memory)?;
            field.domain = grid.active_box();
            field.filled(limits.max_memory)
        };
        let field = arrange().map_err(|e| e.at(&self.volume))?;
        if field.range().1 <= 0.0 {
            return Err(Error::invalid("the volume has no density above zero").at(&self.volume));
        }
        Ok(field)
    }

    fn request(&self, capture: &Capture, field: &Bricks<f32>, held_out: Vec<usize>) -> Result<Request> {
        let previous = (self.resume && self.output.exists()).then_some(&self.output);
        let load = |path: &PathBuf| transfer::load(path, &Options::default()).map(|loaded| loaded.transfer);
        Ok(Request {
            extinction: capture.density_scale,
            background: capture.background,
            quadrature: self.quadrature,
            domain: self.domain.unwrap_or([0.0, f64::from(field.range().1)]),
            texels: self.texels as usize,
            smooth: self.smooth,
            held_out,
            rays: self.rays as usize,
            rays_per_edge: run::rays_per_edge(capture.pixel_filter),
            iterations: self.iterations,
            init: self.init.as_ref().or(previous).map(load).transpose()?,
        })
    }
}

/// A view beside its render by the function that was found.
struct View {
    row: ViewRow,
    /// Mean squared difference of the colours.
    square: f64,
    ssim: f64,
}

fn views(
    field: &Bricks<f32>,
    photos: &[Photo],
    request: &Request,
    transfer: &Transfer,
    shown: &[usize],
) -> Result<Vec<View>> {
    let source = Source::Transfer(Arc::new(transfer.table()?));
    let dvr = Dvr::new(field, Medium { extinction: request.extinction, source })?
        .background(request.background)
        .quadrature(request.quadrature);
    let never = AtomicBool::new(false);
    let of = |&i: &usize| {
        let photo = &photos[i];
        let render =
            render::picture(&dvr, &photo.camera, request.rays_per_edge, &never).ok_or_else(Error::cancelled)?;
        let comparison = metrics::compare(&render, &photo.film).map_err(|e| e.at(Path::new(&photo.name)))?;
        let name = Path::new(&photo.name).file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let row = ViewRow {
            name,
            picture: photo.film.clone(),
            render,
            extra: None,
            held_out: request.held_out.contains(&i),
            psnr_db: Some(comparison.psnr_db),
            note: String::new(),
        };
        Ok(View { row, square: comparison.rms * comparison.rms, ssim: comparison.ssim })
    };
    shown.iter().map(of).collect()
}

/// The page: figures, the function, views beside re-renders, convergence, times, provenance.
fn page(report: &Report, outcome: &Outcome, views: Vec<View>, total: usize) -> Result<Page> {
    let name = report.output.file_name().unwrap_or_default().to_string_lossy();
    let mut page = Page::new(
        format!("{name}, from {total} pictures"),
        format!(
            "{} texels of colour and extinction that explain {} views of '{}'{}.",
            report.texels,
            total - report.held_out.len(),
            report.volume.file_name().unwrap_or_default().to_string_lossy(),
            if report.stopped { "; stopped before the end" } else { "" }
        ),
    );
    let mut figures = Vec::new();
    if let (Some(psnr), Some(ssim)) = (report.held_out_psnr_db, report.held_out_ssim) {
        figures.push(("Held-out views", format!("{psnr:.2} dB")));
        figures.push(("SSIM", format!("{ssim:.4}")));
    }
    figures.push(("Time", format!("{:.1} s", report.seconds)));
    figures.push(("Refinements", report.iterations.to_string()));
    figures.push(("Smoothness", format!("{:.0e}", report.smooth)));
    page.figures(&figures);
    let table = outcome.transfer.table()?;
    let line = |label: &str, value: &dyn Fn(usize) -> f64| Series {
        label: label.into(),
        points: table.knots().iter().enumerate().map(|(i, k)| (*k, value(i))).collect(),
    };
    let plot = |y: &str, series: Vec<Series>| Plot { x: "density".into(), y: y.into(), series };
    let values = table.values();
    page.plot("Extinction", &plot("per world unit", vec![line("extinction", &|i| values[i][3])]))?;
    // In the order of the plot's colours, which begin with a blue, an orange and a green.
    let colours = [("blue", 2), ("red", 0), ("green", 1)].map(|(label, c)| line(label, &move |i| values[i][c]));
    page.plot("Colour", &plot("radiance of the source", colours.into()))?;
    let known = [("extinction", 0), ("colour", 1)].map(|(label, c)| line(label, &|i| outcome.confidence[i][c]));
    page.plot("What the pictures say", &plot("share of the pictures, not of the prior", known.into()))?;
    let rows: Vec<ViewRow> = views.into_iter().map(|v| v.row).collect();
    page.views("Views", &rows, total)?;
    if report.held_out_psnr_db.is_some() {
        let steps = report.history.iter().map(|s| (s.seconds, s.held_out_psnr_db, 0));
        page.plot("Convergence", &Plot::convergence(steps))?;
    }
    page.stages(&report.stages.iter().map(|s| (s.name.as_str(), s.seconds)).collect::<Vec<_>>());
    page.provenance(&report.provenance.rows());
    Ok(page)
}
