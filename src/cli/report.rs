//! `cumulo report`: the page of a reconstruction, made again with more beside it.

use super::light::Light;
use super::memory::Memory;
use super::output::Output;
use super::run::{self, Run, Solver};
use crate::error::{Error, Result};
use crate::formats::vdb::{CONFIDENCE, File, Limits, shaded};
use crate::formats::{atomic, exr, transfer, transforms};
use crate::metrics::{self, volume};
use crate::render::dvr::Dvr;
use crate::render::preshaded::Preshaded;
use crate::report::{Page, Plot, Series, ViewRow};
use crate::scene::bricks::Bricks;
use crate::scene::camera::Camera;
use crate::scene::capture::{Capture, Model};
use crate::scene::grid::Grid;
use serde::Serialize;
use std::fmt;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::AtomicBool;

/// Name of the run's record in the report's folder.
const RECORD: &str = "run.json";

/// Make the page of a reconstruction again, with the true volume or other renders beside it
#[derive(Debug, clap::Args)]
pub struct Report {
    /// Folder that `reconstruct --report` wrote
    folder: PathBuf,
    /// Volume to compare with
    #[arg(long, value_name = "IN.vdb")]
    reference: Option<PathBuf>,
    /// Renders of the result from the same cameras, shown beside ours: their name and their capture
    #[arg(long, value_name = "NAME=CAPTURE", value_parser = named)]
    beside: Option<(String, PathBuf)>,
    #[command(flatten)]
    memory: Memory,
}

fn named(text: &str) -> Result<(String, PathBuf), String> {
    match text.split_once('=') {
        Some((name, path)) if !name.is_empty() && !path.is_empty() => Ok((name.into(), path.into())),
        _ => Err(format!("'{text}' is not NAME=CAPTURE")),
    }
}

#[derive(Debug, Serialize)]
struct Written {
    report: PathBuf,
    /// Of the volume against `--reference`.
    volume: Option<VolumeError>,
}

/// How far the volume is from another one.
#[derive(Debug, Clone, Serialize)]
struct VolumeError {
    psnr_db: Option<f64>,
    /// Over voxels of which the pictures say more than the prior (confidence of a half or more).
    known_rms: Option<f64>,
    /// Over the others.
    unknown_rms: Option<f64>,
}

impl fmt::Display for Written {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.report.display())
    }
}

impl Report {
    /// Reads the record, renders, writes the page and says where it is.
    ///
    /// # Errors
    /// If the record, the volumes or the pictures cannot be read, or the page cannot be written.
    pub fn run(&self, output: &Output) -> Result<ExitCode> {
        let limits = self.memory.limits();
        let path = self.folder.join(RECORD);
        let text = std::fs::read(&path).map_err(|e| {
            Error::io(&path, e).hint("the folder must be one that cumulo reconstruct --report has written")
        })?;
        let run: Run = serde_json::from_slice(&text)
            .map_err(|e| Error::invalid(format!("this is no record of a run: {e}")).at(&path))?;
        let reference = self.reference.as_deref().map(|path| reference(path, limits)).transpose()?;
        let beside = match &self.beside {
            Some((name, path)) => Some((name.as_str(), transforms::load(path)?)),
            None => None,
        };
        let (page, volume) = page(&run, limits, reference.as_ref(), beside.as_ref())?;
        output.report(&Written { report: page.write(&self.folder)?, volume })?;
        Ok(ExitCode::SUCCESS)
    }
}

fn reference(path: &Path, limits: Limits) -> Result<Grid> {
    File::open(path, limits)?.read_fog(None)
}

/// Makes the folder, before the work that it is to show.
///
/// # Errors
/// The operating system's, with the path.
pub fn prepare(dir: &Path) -> Result<()> {
    std::fs::create_dir_all(dir)
        .map_err(|e| Error::io(dir, e).hint("the report needs a folder that can be written to"))?;
    atomic::probe(&dir.join(RECORD))
}

/// Writes the page of a run and its record; the page's path.
///
/// # Errors
/// As [`Report::run`].
pub fn write(dir: &Path, run: &Run, limits: Limits) -> Result<PathBuf> {
    let absolute = |path: &Path| std::fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf());
    let record = Run { capture: absolute(&run.capture), output: absolute(&run.output), ..run.clone() };
    let text = serde_json::to_vec_pretty(&record).map_err(|e| Error::invalid(e.to_string()))?;
    let path = dir.join(RECORD);
    atomic::write(&path, |p| std::fs::write(p, &text).map_err(|e| Error::io(&path, e)))?;
    page(run, limits, None, None)?.0.write(dir)
}

/// The page: figures, views beside re-renders, slices, convergence, times, provenance.
fn page(
    run: &Run,
    limits: Limits,
    reference: Option<&Grid>,
    beside: Option<&(&str, Capture)>,
) -> Result<(Page, Option<VolumeError>)> {
    let mut capture = transforms::load(&run.capture)?;
    let grid = File::open(&run.output, limits)?.read_fog(Some(&run.grid))?;
    let transfer = transfer::from_metadata(&grid.metadata).map_err(|e| e.at(&run.output))?;
    let field = super::volume::arrange(&grid, transfer.as_ref(), limits).map_err(|e| e.at(&run.output))?;
    if let Some(transfer) = transfer {
        (capture.transfer, capture.model) = (Some(transfer), Model::EmissionAbsorption);
    }
    let shaded = match run.solver {
        Solver::Colour => Some(shaded::read(&File::open(&run.output, limits)?, Some(&run.grid), limits.max_memory)?),
        Solver::Cg | Solver::Paper | Solver::Behind => None,
    };
    let light = match &shaded {
        Some(volume) => Light::PreShaded(Preshaded::new(volume, capture.background)),
        None => Light::Density(Dvr::new(&field, capture.medium()?)?.background(capture.background)),
    };
    let rows = rows(run, &capture, &light, beside)?;
    let difference = reference
        .map(|r| volume::compare(&volume::Field::from_grid(r), &volume::Field::from_grid(&grid)))
        .transpose()?;

    let name = run.output.file_name().unwrap_or(run.output.as_os_str()).to_string_lossy();
    let mut page = Page::new(
        format!("{name}, from {} pictures", run.views),
        format!(
            "{} of grid '{}' that explain {} views of '{}'{}.",
            if shaded.is_some() { "Emissions, with the extinctions" } else { "Densities" },
            run.grid,
            run.views - run.held_out.len(),
            run.capture.parent().and_then(Path::file_name).unwrap_or(run.capture.as_os_str()).to_string_lossy(),
            if run.stopped { "; stopped before the end" } else { "" }
        ),
    );
    let known = confidence(run, limits)?;
    let other = reference.map(|r| bricks(r, Path::new(&r.name), limits)).transpose()?;
    let mut figures = Vec::new();
    let mut error = None;
    if let (Some(d), Some(other)) = (&difference, &other) {
        figures.push(("Volume PSNR", d.psnr_db.map_or("identical".to_owned(), |p| format!("{p:.2} dB"))));
        let [known_rms, unknown_rms] =
            known.as_ref().map_or([None; 2], |known| volume::rms_apart(other, &field, known));
        let parts = [("RMS where pictures decide", known_rms), ("RMS elsewhere", unknown_rms)];
        figures.extend(parts.iter().filter_map(|(name, rms)| Some((*name, format!("{:.2e}", (*rms)?)))));
        error = Some(VolumeError { psnr_db: d.psnr_db, known_rms, unknown_rms });
    }
    if let Some(psnr) = run.held_out_psnr_db {
        figures.push(("Held-out views", format!("{psnr:.2} dB")));
    }
    figures.push(("Used views", format!("{:.2} dB", run.train_psnr_db)));
    figures.push(("Time", format!("{:.1} s", run.seconds)));
    figures.push(("Iterations", run.iterations.to_string()));
    figures.push(("Unknown voxels", run.unknowns.to_string()));
    if let Some(mb) = run.peak_memory_mb {
        figures.push(("Peak memory", format!("{mb:.0} MB")));
    }
    page.figures(&figures);
    page.views("Views", &rows, run.views)?;
    page.slices("Slices", "density", &field, other.as_ref())?;
    if let Some(known) = &known {
        page.slices("What the pictures say", "confidence, 0 to 1", known, None)?;
    }
    if run.held_out_psnr_db.is_some() {
        let steps = run.history.iter().map(|s| (s.seconds, s.held_out_psnr_db, s.level));
        page.plot("Convergence", &Plot::convergence(steps))?;
    }
    let points = run.history.iter().filter(|s| s.loss > 0.0).map(|s| (s.seconds, s.loss.log10())).collect();
    page.plot(
        "Loss",
        &Plot {
            x: "seconds".into(),
            y: "log10 of the loss".into(),
            series: vec![Series { label: "loss".into(), points }],
        },
    )?;
    page.stages(&run.stages.iter().map(|s| (s.name.as_str(), s.seconds)).collect::<Vec<_>>());
    page.provenance(&run.provenance.rows());
    Ok((page, error))
}

/// The grid of confidences beside the run's, if it wrote one.
fn confidence(run: &Run, limits: Limits) -> Result<Option<Bricks<f32>>> {
    let file = File::open(&run.output, limits)?;
    let name = format!("{}{}", run.grid, CONFIDENCE);
    if !file.entries().iter().any(|e| e.base_name == name) {
        return Ok(None);
    }
    bricks(&file.read_grid(&name)?, &run.output, limits).map(Some)
}

fn bricks(grid: &Grid, path: &Path, limits: Limits) -> Result<Bricks<f32>> {
    Bricks::from_grid(grid, limits.max_memory).map_err(|e| e.at(path))
}

/// The views that are shown, rendered again.
fn rows(run: &Run, capture: &Capture, light: &Light<'_>, beside: Option<&(&str, Capture)>) -> Result<Vec<ViewRow>> {
    let rays = run::rays_per_edge(capture.pixel_filter);
    let never = AtomicBool::new(false);
    let shown = run.shown.iter().filter_map(|i| Some((*i, capture.frames.get(*i)?)));
    shown
        .map(|(i, frame)| {
            let picture = exr::read_picture(&frame.picture, run.layer.as_deref())?;
            let render = light.picture(&frame.camera, rays, &never).ok_or_else(Error::cancelled)?;
            let comparison = metrics::compare(&render, &picture).map_err(|e| e.at(&frame.picture))?;
            let extra = match beside.and_then(|(name, c)| Some((*name, same_place(c, &frame.camera)?))) {
                Some((name, path)) => Some((name.to_owned(), exr::read_picture(path, None)?)),
                None => None,
            };
            Ok(ViewRow {
                name: frame.picture.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
                picture,
                render,
                extra,
                held_out: run.held_out.contains(&i),
                psnr_db: Some(comparison.psnr_db),
                note: String::new(),
            })
        })
        .collect()
}

/// The picture of a capture that was taken from where `camera` stands.
fn same_place<'a>(capture: &'a Capture, camera: &Camera) -> Option<&'a Path> {
    let near = 1e-6 * (1.0 + camera.position().length());
    capture
        .frames
        .iter()
        .find(|f| f.camera.camera_to_world.abs_diff_eq(camera.camera_to_world, near))
        .map(|f| f.picture.as_path())
}
