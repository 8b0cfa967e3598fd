//! The page of a transfer function that was reconstructed.

use super::{ExtraRenders, extra};
use crate::app::photos;
use crate::app::reconstruct::transfer_run::TransferRun;
use crate::app::run;
use crate::cancel::Cancel;
use crate::error::{Code, Error, Result};
use crate::formats::limits::Limits;
use crate::formats::transfer::Options;
use crate::formats::vdb::File;
use crate::formats::{captures, transfer};
use crate::metrics;

use crate::render::dvr::Dvr;
use crate::render::film::{self, Sampling};
use crate::report::{Page, Plot, Series, ViewRow};
use crate::scene::bricks::Bricks;
use crate::scene::capture::Frame;
use crate::scene::medium::{Medium, Source};
use crate::scene::table::Table;
use crate::scene::transfer::Transfer;
use serde::Serialize;
use std::path::Path;
use std::sync::Arc;

/// Reads the volume with all of its box, since the function may absorb at the background.
///
/// # Errors
/// If the volume cannot be read, or all of its values are alike.
pub(crate) fn field(volume: &Path, grid: Option<&str>, limits: Limits) -> Result<Bricks<f32>> {
    let grid = File::open(volume, limits)?.read_fog(grid)?;
    let arrange = || {
        let mut field = Bricks::from_values(&grid, limits.max_memory)?;
        field.domain = grid.active_box();
        field.filled(limits.max_memory)
    };
    let field = arrange().map_err(|e| e.at(volume))?;
    let (low, high) = field.range();
    if low >= high {
        return Err(Error::invalid("the volume has one value everywhere")
            .coded(Code::EmptyGrid)
            .at(volume)
            .hint("choose another grid with ⟨grid⟩; `cumulo info` shows what is in them"));
    }
    Ok(field)
}

/// Returns the range of a function for all values of a field, from 0 on where that is not far from them.
pub(crate) fn domain(field: &Bricks<f32>) -> [f64; 2] {
    let [low, high] = field.seen_range();
    [if field.reference == 0.0 { low.min(0.0) } else { low }, high]
}

/// A view and its render with the reconstructed function.
#[derive(Debug)]
pub struct View {
    /// Number of the view in the capture.
    pub number: usize,
    /// Picture and render, as the page shows them.
    pub row: ViewRow,
    /// Mean squared difference of the colors.
    pub square: f64,
    /// Structural similarity of picture and render.
    pub ssim: f64,
}

/// Renders the views of a run with the given numbers again; once the work is to stop, those are left out that are not
/// rendered yet.
///
/// # Errors
/// If the pictures, the volume or the function cannot be read.
pub(crate) fn views(
    run: &TransferRun,
    numbers: &[usize],
    limits: Limits,
    beside: Option<&ExtraRenders>,
    cancel: &Cancel,
) -> Result<Vec<View>> {
    let capture = captures::load(&run.capture)?;
    let function = transfer::load(&run.output, &Options::default())?.transfer;
    let field = field(&run.volume, run.grid.as_deref(), limits)?;
    let source = Source::Transfer(Arc::new(function.table().map_err(|e| e.at(&run.output))?));
    let dvr = Dvr::new(&field, Medium::new(capture.density_scale, source))?
        .quadrature(run.quadrature)
        .over(capture.background);
    let sampling = Sampling::grid(run::rays_per_edge(capture.pixel_filter));
    let frames = numbers.iter().filter_map(|i| Some((*i, capture.frames.get(*i)?)));
    let view = |(i, frame): (usize, &Frame)| {
        let picture = photos::picture(&frame.picture, run.layer.as_deref(), &capture, limits)?;
        let Some(rendered) = film::render(&dvr, &frame.camera, sampling, &[], cancel) else { return Ok(None) };
        let render = rendered.film;
        let comparison = metrics::compare(&render, &picture).map_err(|e| e.at(&frame.picture))?;
        let row = ViewRow {
            name: frame.picture.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
            picture,
            render,
            extra: extra(beside, &frame.camera, limits)?,
            held_out: run.held_out.contains(&i),
            psnr_db: Some(comparison.psnr_db),
            note: String::new(),
        };
        Ok(Some(View { number: i, row, square: comparison.rms * comparison.rms, ssim: comparison.ssim }))
    };
    frames.take_while(|_| !cancel.requested()).map(view).filter_map(Result::transpose).collect()
}

/// Error of a reconstructed transfer function against a reference.
#[derive(Debug, Clone, Serialize, schemars::JsonSchema)]
pub struct FunctionError {
    /// Root mean square difference of the extinctions over the texels, relative to the reference's largest extinction.
    extinction_rms: f64,
    /// Root mean square difference of the colors over the texels, each weighted by its extinction in the reference: the
    /// color of a texel that does not absorb is invisible.
    color_rms: f64,
}

impl FunctionError {
    fn new(reconstruction: &Table, reference: &Table) -> Self {
        let peak = reference.peak()[3].max(f64::MIN_POSITIVE);
        let (mut extinction, mut color, mut weight) = (0.0, 0.0, 0.0);
        for (knot, value) in reconstruction.knots().iter().zip(reconstruction.values()) {
            let other = reference.at(*knot);
            let share = other[3] / peak;
            extinction += ((value[3] - other[3]) / peak).powi(2);
            color += share * (0..3).map(|c| (value[c] - other[c]).powi(2) / 3.0).sum::<f64>();
            weight += share;
        }
        Self {
            extinction_rms: (extinction / reconstruction.knots().len() as f64).sqrt(),
            color_rms: (color / f64::max(weight, f64::MIN_POSITIVE)).sqrt(),
        }
    }
}

/// Makes the page of a transfer function: figures, the function, views beside re-renders, convergence, times,
/// provenance. With a reference the error of the function is returned, too.
///
/// # Errors
/// If the function cannot be read, or a plot cannot be drawn.
pub(crate) fn page(
    run: &TransferRun,
    views: Vec<View>,
    reference: Option<&Transfer>,
) -> Result<(Page, Option<FunctionError>)> {
    let table = transfer::load(&run.output, &Options::default())?.transfer.table().map_err(|e| e.at(&run.output))?;
    let reference = reference.map(Transfer::table).transpose()?;
    let error = reference.as_ref().map(|reference| FunctionError::new(&table, reference));
    let name = run.output.file_name().unwrap_or_default().to_string_lossy();
    let mut page = Page::new(
        format!("{name}, from {} pictures", run.views),
        format!(
            "{} texels of color and extinction that explain {} views of '{}'{}.",
            run.texels,
            run.views.saturating_sub(run.held_out.len()),
            run.volume.file_name().unwrap_or_default().to_string_lossy(),
            if run.stopped { "; stopped before the end" } else { "" }
        ),
    );
    let mut figures = Vec::new();
    if let Some(error) = &error {
        figures.push(("Extinction, RMS error", format!("{:.2} %", 100.0 * error.extinction_rms)));
        figures.push(("Color, RMS error", format!("{:.4}", error.color_rms)));
    }
    if let (Some(psnr), Some(ssim)) = (run.held_out_psnr_db, run.held_out_ssim) {
        figures.push(("Held-out views", format!("{psnr:.2} dB")));
        figures.push(("SSIM", format!("{ssim:.4}")));
    }
    figures.push(("Time", format!("{:.1} s", run.seconds)));
    figures.push(("Steps", format!("{} {}", run.iterations, run.solver.steps())));
    figures.push(("Smoothness", format!("{:.0e}", run.smooth)));
    page.figures(&figures);
    page.warnings(&run.warnings.iter().map(|w| (&w.what, &w.remedy)).collect::<Vec<_>>());

    let line = |label: &str, value: &dyn Fn(usize) -> f64| Series {
        label: label.into(),
        points: table.knots().iter().enumerate().map(|(i, k)| (*k, value(i))).collect(),
        dashed: false,
    };
    let plot = |y: &str, series: Vec<Series>| Plot { x: "density".into(), y: y.into(), series };
    let values = table.values();
    let mut extinctions = vec![line("extinction", &|i| values[i][3])];
    // In the order of the plot's colors, which begin with a blue, an orange and a green.
    let channels = [("blue", 2), ("red", 0), ("green", 1)];
    let mut colors: Vec<Series> = channels.map(|(label, c)| line(label, &move |i| values[i][c])).into();
    if let Some(reference) = &reference {
        let of = |label: &str, c: usize| Series {
            label: format!("{label}, reference"),
            points: table.knots().iter().map(|k| (*k, reference.at(*k)[c])).collect(),
            dashed: true,
        };
        extinctions.push(of("extinction", 3));
        colors.extend(channels.map(|(label, c)| of(label, c)));
    }
    page.plot("Extinction", &plot("per world unit", extinctions))?;
    page.plot("Color", &plot("radiance of the source", colors))?;
    if !run.confidence.is_empty() {
        let share = |c: usize| move |i: usize| run.confidence.get(i).map_or(0.0, |of| of[c]);
        let confidence = vec![line("extinction", &share(0)), line("color", &share(1))];
        page.plot("What the pictures say", &plot("share of the pictures, not of the prior", confidence))?;
    }
    let rows: Vec<ViewRow> = views.into_iter().map(|v| v.row).collect();
    page.views("Views", &rows, run.views)?;
    if run.held_out_psnr_db.is_some() {
        let steps = run.history.iter().map(|s| (s.seconds, s.held_out_psnr_db, 0));
        page.plot("Convergence", &Plot::convergence(steps))?;
    }
    page.stages(&run.stages.iter().map(|s| (s.name.as_str(), s.seconds)).collect::<Vec<_>>());
    page.provenance(&run.provenance.rows());
    Ok((page, error))
}
