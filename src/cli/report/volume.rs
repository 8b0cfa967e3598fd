//! The page of a volume that was reconstructed.

use super::{Beside, extra};
use crate::cancel::Cancel;
use crate::cli::run::{self, Run, Solver};
use crate::cli::volume as volumes;
use crate::error::Result;
use crate::formats::limits::Limits;
use crate::formats::vdb::{CONFIDENCE, File, shaded};
use crate::formats::{exr, transfer, transforms};
use crate::metrics::{self, volume};
use crate::render::any_renderer::AnyRenderer;
use crate::render::dvr::Dvr;
use crate::render::preshaded::Preshaded;
use crate::render::quadrature::Quadrature;
use crate::report::{Page, Plot, Series, ViewRow};
use crate::scene::bricks::Bricks;
use crate::scene::capture::{Capture, Model};
use crate::scene::grid::Grid;
use serde::Serialize;
use std::path::Path;
use std::sync::atomic::AtomicBool;

/// How far the volume is from another one.
#[derive(Debug, Clone, Serialize)]
pub(super) struct VolumeError {
    psnr_db: Option<f64>,
    /// Over voxels of which the pictures say more than the prior (confidence of a half or more).
    known_rms: Option<f64>,
    /// Over the others.
    unknown_rms: Option<f64>,
}

/// The page: figures, views beside re-renders, slices, convergence, times, provenance.
pub(super) fn page(
    run: &Run,
    limits: Limits,
    reference: Option<&Grid>,
    beside: Option<&Beside>,
    cancel: Cancel,
) -> Result<(Page, Option<VolumeError>)> {
    let mut capture = transforms::load(&run.capture)?;
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
    let light = match &shaded {
        Some(volume) => AnyRenderer::PreShaded(Preshaded::new(volume).over(capture.background)),
        None => {
            let quadrature = Quadrature::usual(capture.transfer.is_some());
            AnyRenderer::Density(Dvr::new(&field, capture.medium()?)?.quadrature(quadrature).over(capture.background))
        }
    };
    let rows = rows(run, &capture, &light, beside, cancel)?;
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
            run.views.saturating_sub(run.held_out.len()),
            run.capture.parent().and_then(Path::file_name).unwrap_or(run.capture.as_os_str()).to_string_lossy(),
            if run.stopped { "; stopped before the end" } else { "" }
        ),
    );
    let known = confidence(run, &run.grid, limits)?;
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
    if let Some(psnr) = run.train_psnr_db {
        figures.push(("Used views", format!("{psnr:.2} dB")));
    }
    figures.push(("Time", format!("{:.1} s", run.seconds)));
    figures.push(("Iterations", run.iterations.to_string()));
    figures.push(("Unknown voxels", run.unknowns.to_string()));
    if let Some(mb) = run.peak_memory_mb {
        figures.push(("Peak memory", format!("{mb:.0} MB")));
    }
    page.figures(&figures);
    page.warnings(&run.warnings.iter().map(|w| (&w.what, &w.remedy)).collect::<Vec<_>>());
    page.views("Views", &rows, run.views)?;
    page.slices("Slices", "density", &field, other.as_ref())?;
    if let Some(known) = &known {
        page.slices("What the pictures say", "confidence, 0 to 1", known, None)?;
    }
    if shaded.is_some()
        && let Some(known) = confidence(run, shaded::EMISSION, limits)?
    {
        page.slices("What they say of emissions", "confidence, 0 to 1", &known, None)?;
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

/// The confidences of one of the run's grids, if it wrote them.
fn confidence(run: &Run, of: &str, limits: Limits) -> Result<Option<Bricks<f32>>> {
    let file = File::open(&run.output, limits)?;
    let name = format!("{of}{CONFIDENCE}");
    if !file.entries().iter().any(|e| e.base_name == name) {
        return Ok(None);
    }
    bricks(&file.read_grid(&name)?, &run.output, limits).map(Some)
}

fn bricks(grid: &Grid, path: &Path, limits: Limits) -> Result<Bricks<f32>> {
    Bricks::from_grid(grid, limits.max_memory).map_err(|e| e.at(path))
}

/// The views that are shown, rendered again.
fn rows(
    run: &Run,
    capture: &Capture,
    light: &AnyRenderer<'_>,
    beside: Option<&Beside>,
    cancel: Cancel,
) -> Result<Vec<ViewRow>> {
    let rays = run::rays_per_edge(capture.pixel_filter);
    let never = AtomicBool::new(false);
    let shown = run.shown.iter().filter_map(|i| Some((*i, capture.frames.get(*i)?)));
    shown
        .take_while(|_| !cancel.requested())
        .map(|(i, frame)| {
            let picture = exr::read_picture(&frame.picture, run.layer.as_deref())?;
            let flag = cancel.flag().unwrap_or(&never);
            let Some(render) = light.picture(&frame.camera, rays, flag) else { return Ok(None) };
            let comparison = metrics::compare(&render, &picture).map_err(|e| e.at(&frame.picture))?;
            let extra = extra(beside, &frame.camera)?;
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
