//! The page of a volume that was reconstructed.

use super::{ExtraRenders, extra};
use crate::app::photos;
use crate::app::run::{self, Run, Solver};
use crate::app::volume as volumes;
use crate::cancel::Cancel;
use crate::error::Result;
use crate::formats::limits::Limits;
use crate::formats::vdb::{CONFIDENCE, File, shaded};
use crate::formats::{captures, transfer};
use crate::metrics;
use crate::metrics::volume::{self, Difference, Multiple};
use crate::ordered;
use crate::render::direct::DirectRenderer;
use crate::render::dvr::Dvr;
use crate::render::film::Sampling;
use crate::render::preshaded::Preshaded;
use crate::render::quadrature::Quadrature;
use crate::report::{CompanionVolume as Quantity, MOST_THUMBNAILS, Page, Plot, Series, Thumbnail, ViewRow, choose};
use crate::scene::bricks::Bricks;
use crate::scene::capture::{Capture, Model};
use crate::scene::grid::Grid;
use glam::Vec4;
use rayon::prelude::*;
use serde::Serialize;
use std::path::Path;

/// Error of a reconstructed volume against a reference.
#[derive(Debug, Clone, Serialize, schemars::JsonSchema)]
pub struct VolumeError {
    /// PSNR in dB with the reference's largest value as peak; none if the volumes are identical or the reference
    /// is zero.
    psnr_db: Option<f64>,
    /// Multiple of the reference that explains most of the error: a density scale that one of the volumes holds.
    #[serde(skip_serializing_if = "Option::is_none")]
    multiple: Option<Multiple>,
    /// RMS error over the voxels whose confidence is a half or more, which the pictures decide more than the prior.
    known_rms: Option<f64>,
    /// RMS error over the voxels whose confidence is below a half.
    unknown_rms: Option<f64>,
    /// True if the volumes are identical.
    #[serde(skip)]
    identical: bool,
}

/// Makes the page of a volume: figures, views beside re-renders, slices, convergence, times, provenance. With a
/// reference its error is returned, too.
///
/// # Errors
/// If the volume or the pictures cannot be read, or a plot cannot be drawn.
pub(crate) fn page(
    run: &Run,
    limits: Limits,
    reference: Option<&Grid>,
    beside: Option<&ExtraRenders>,
    cancel: &Cancel,
) -> Result<(Page, Option<VolumeError>)> {
    let volume = Reconstruction::read(run, limits)?;
    let rows = rows(run, &volume, beside, limits, cancel)?;
    let difference = reference.map(|reference| volume.difference(reference)).transpose()?;
    let confidence = confidence(run, &run.grid, limits)?;
    let reference = reference.map(|r| bricks(r, Path::new(&r.name), limits)).transpose()?;
    let error = difference.zip(reference.as_ref()).map(|(difference, reference)| {
        let rms = |confidence| volume::rms_apart(reference, &volume.field, confidence);
        let [known_rms, unknown_rms] = confidence.as_ref().map_or([None; 2], rms);
        let (multiple, identical) = (difference.explained(), difference.rms == 0.0);
        VolumeError { psnr_db: difference.psnr_db, multiple, known_rms, unknown_rms, identical }
    });

    let mut page = Page::new(title(run), volume.subtitle(run));
    page.figures(&figures(run, error.as_ref()));
    page.warnings(&run.warnings.iter().map(|w| (&w.what, &w.remedy)).collect::<Vec<_>>());
    page.views("Views", &rows, run.views)?;
    page.slices("Slices", "density", &volume.field, reference.as_ref())?;
    let beside = confidence.iter().map(|volume| Quantity { label: CONFIDENCE_LABEL, volume, top: Some(1.0) });
    let heading = if confidence.is_some() { "Slice by slice, with what the pictures say" } else { "Slice by slice" };
    page.browse(heading, "density", &volume.field, reference.as_ref(), &beside.collect::<Vec<_>>())?;
    page.histogram("Histogram of densities", "density", &volume.field, reference.as_ref())?;
    if volume.shaded.is_some()
        && let Some(confidence) = self::confidence(run, shaded::EMISSION, limits)?
    {
        page.slices("What they say of emissions", CONFIDENCE_LABEL, &confidence, None)?;
    }
    let thumbnails = thumbnails(run, &volume.capture, limits, cancel)?;
    page.thumbnails("Cameras", &thumbnails, run.views)?;
    plots(&mut page, run)?;
    page.stages(&run.stages.iter().map(|s| (s.name.as_str(), s.seconds)).collect::<Vec<_>>());
    page.provenance(&run.provenance.rows());
    Ok((page, error))
}

/// Name of confidences on the page.
const CONFIDENCE_LABEL: &str = "confidence, 0 to 1";

/// Reads the pictures of all cameras, or as many as a page shows, evenly spaced, and reduces them.
fn thumbnails(run: &Run, capture: &Capture, limits: Limits, cancel: &Cancel) -> Result<Vec<Thumbnail>> {
    let views = capture.frames.len();
    let chosen = choose(&vec![false; views], MOST_THUMBNAILS);
    let thumbnail = |i: usize| {
        if cancel.requested() {
            return Ok(None);
        }
        let path = &capture.frames[i].picture;
        let film = photos::picture(path, run.layer.as_deref(), capture, limits)?;
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        Ok(Some(Thumbnail::new(name, &film, run.held_out.contains(&i))))
    };
    Ok(ordered::try_map(chosen.into_par_iter(), thumbnail)?.into_iter().flatten().collect())
}

/// A reconstructed volume, read again with the capture of its pictures.
struct Reconstruction {
    /// The capture, with the transfer function that the grid carries, or of what alpha alone tells.
    capture: Capture,
    /// True if the densities explain alpha alone, for the medium scatters light.
    by_alpha: bool,
    /// Grid of the densities or extinctions.
    grid: Grid,
    /// Values of the grid, arranged for rays.
    field: Bricks<f32>,
    /// Emissions in R, G and B, and extinctions, if the volume is pre-shaded.
    shaded: Option<Bricks<Vec4>>,
}

impl Reconstruction {
    fn read(run: &Run, limits: Limits) -> Result<Self> {
        let mut capture = captures::load(&run.capture)?;
        let by_alpha = capture.model == Model::Scattering && run.solver != Solver::Color;
        if by_alpha {
            capture = capture.by_alpha();
        }
        let grid = File::open(&run.output, limits)?.read_fog(Some(&run.grid))?;
        let transfer = transfer::from_metadata(&grid.metadata).map_err(|e| e.at(&run.output))?;
        let field = volumes::arrange_by_voxel(&grid, transfer.as_ref(), limits).map_err(|e| e.at(&run.output))?;
        if let Some(transfer) = transfer {
            (capture.transfer, capture.model) = (Some(transfer), Model::EmissionAbsorption);
        }
        let shaded = match run.solver {
            Solver::Color => Some(shaded::read(&File::open(&run.output, limits)?, Some(&run.grid), limits.max_memory)?),
            Solver::Cg | Solver::Weiss2021 | Solver::ThroughTransfer => None,
        };
        let by_alpha = by_alpha && capture.transfer.is_none();
        Ok(Self { capture, by_alpha, grid, field, shaded })
    }

    fn renderer(&self) -> Result<DirectRenderer<'_>> {
        let background = self.capture.background;
        if let Some(volume) = &self.shaded {
            return Ok(DirectRenderer::PreShaded(Preshaded::new(volume).over(background)));
        }
        let medium = self.capture.medium()?;
        let quadrature = Quadrature::usual(&medium.source);
        let dvr = Dvr::new(&self.field, medium)?.quadrature(quadrature);
        Ok(DirectRenderer::Density(dvr.over(background)))
    }

    fn difference(&self, reference: &Grid) -> Result<Difference> {
        volume::compare(&volume::Field::from_grid(reference), &volume::Field::from_grid(&self.grid))
    }

    fn subtitle(&self, run: &Run) -> String {
        format!(
            "{} of grid '{}' that explain {}{} views of '{}'{}.",
            if self.shaded.is_some() { "Emissions, with the extinctions" } else { "Densities" },
            run.grid,
            if self.by_alpha { "alpha in " } else { "" },
            run.views.saturating_sub(run.held_out.len()),
            run.capture.parent().and_then(Path::file_name).unwrap_or(run.capture.as_os_str()).to_string_lossy(),
            if run.stopped { "; stopped before the end" } else { "" }
        )
    }
}

fn title(run: &Run) -> String {
    let name = run.output.file_name().unwrap_or(run.output.as_os_str()).to_string_lossy();
    format!("{name}, from {} pictures", run.views)
}

/// Labels and values of the figures at the top of the page.
fn figures(run: &Run, error: Option<&VolumeError>) -> Vec<(&'static str, String)> {
    let mut figures = Vec::new();
    if let Some(error) = error {
        let none = if error.identical { "identical" } else { "undefined: the reference is zero" };
        figures.push(("Volume PSNR", error.psnr_db.map_or_else(|| none.to_owned(), |p| format!("{p:.2} dB"))));
        if let Some(Multiple { factor, psnr_db }) = error.multiple {
            let psnr = psnr_db.map_or_else(|| "equal".to_owned(), |db| format!("{db:.2} dB"));
            figures.push(("But for a factor", format!("{psnr}, {factor:.3} times the reference")));
        }
        let parts = [("RMS where pictures decide", error.known_rms), ("RMS elsewhere", error.unknown_rms)];
        figures.extend(parts.iter().filter_map(|(name, rms)| Some((*name, format!("{:.2e}", (*rms)?)))));
    }
    if let Some(psnr) = run.held_out_psnr_db {
        figures.push(("Held-out views", format!("{psnr:.2} dB")));
    }
    if let Some(psnr) = run.train_psnr_db {
        figures.push(("Used views", format!("{psnr:.2} dB")));
    }
    if let Some(cameras) = &run.cameras {
        figures.push(("Cameras moved by", format!("{:.2} pixels", cameras.displaced_pixels())));
    }
    figures.push(("Time", format!("{:.1} s", run.seconds)));
    figures.push(("Iterations", run.iterations.to_string()));
    figures.push(("Unknown voxels", run.unknowns.to_string()));
    if let Some(mb) = run.peak_memory_mb {
        figures.push(("Peak memory", format!("{mb:.0} MB")));
    }
    figures
}

/// Plots the convergence, if views were held out, and the loss.
fn plots(page: &mut Page, run: &Run) -> Result<()> {
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
            series: vec![Series { label: "loss".into(), points, dashed: false }],
        },
    )?;
    Ok(())
}

/// Reads the confidences, 0 to 1, that the run wrote beside one of its grids; none if it did not.
fn confidence(run: &Run, grid: &str, limits: Limits) -> Result<Option<Bricks<f32>>> {
    let file = File::open(&run.output, limits)?;
    let name = format!("{grid}{CONFIDENCE}");
    if !file.entries().iter().any(|e| e.base_name == name) {
        return Ok(None);
    }
    bricks(&file.read_grid(&name)?, &run.output, limits).map(Some)
}

fn bricks(grid: &Grid, path: &Path, limits: Limits) -> Result<Bricks<f32>> {
    Bricks::from_grid(grid, limits.max_memory).map_err(|e| e.at(path))
}

/// Renders the views that the page shows again, and compares them with their pictures.
fn rows(
    run: &Run,
    volume: &Reconstruction,
    beside: Option<&ExtraRenders>,
    limits: Limits,
    cancel: &Cancel,
) -> Result<Vec<ViewRow>> {
    let (capture, renderer) = (&volume.capture, volume.renderer()?);
    let sampling = Sampling::grid(run::rays_per_edge(capture.pixel_filter));
    let shown = run.shown.iter().filter_map(|i| Some((*i, capture.frames.get(*i)?)));
    shown
        .take_while(|_| !cancel.requested())
        .map(|(i, frame)| {
            let picture = photos::picture(&frame.picture, run.layer.as_deref(), capture, limits)?;
            let picture = if volume.by_alpha { picture.by_alpha() } else { picture };
            let Some(rendered) = renderer.render(&frame.camera, sampling, &[], cancel) else { return Ok(None) };
            let render = rendered.film;
            let comparison = metrics::compare(&render, &picture).map_err(|e| e.at(&frame.picture))?;
            let extra = extra(beside, &frame.camera, limits)?;
            Ok(Some(ViewRow {
                name: frame.picture.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
                picture,
                render,
                extra,
                held_out: run.held_out.contains(&i),
                psnr_db: Some(comparison.psnr_db),
                note: String::new(),
            }))
        })
        .filter_map(Result::transpose)
        .collect()
}
