//! The page of a search for cameras.

use super::PoseReport;
use crate::app::provenance::Provenance;
use crate::cancel::Cancel;
use crate::differentiate::gradient::pictures::Target;
use crate::error::Result;
use crate::metrics;
use crate::render::direct::DirectRenderer;
use crate::render::film::Sampling;
use crate::report::{MOST_VIEWS, Page, ViewRow, choose};
use crate::scene::capture::Capture;
use crate::scene::film::Film;

/// Makes the page: how far each camera was moved, and its picture beside a render from where it stands now. Once the
/// work is to stop, views are left out that are not rendered yet.
pub(crate) fn page(
    report: &PoseReport,
    solved: &Capture,
    targets: &[Target],
    renderer: &DirectRenderer<'_>,
    provenance: &Provenance,
    cancel: &Cancel,
) -> Result<Page> {
    let name = report.output.file_name().unwrap_or(report.output.as_os_str()).to_string_lossy();
    let mut page = Page::new(
        format!("{name}, {} cameras", report.cameras.len()),
        format!(
            "Cameras moved until what they see is their pictures{}.",
            if report.stopped { "; stopped before the end" } else { "" }
        ),
    );
    let mut figures = vec![
        ("RMS", format!("{:.3e}", report.rms_after)),
        ("RMS before", format!("{:.3e}", report.rms_before)),
        ("Time", format!("{:.2} s", report.seconds)),
    ];
    if let Some(factor) = report.focal_factor {
        figures.push(("Focal length times", format!("{factor:.6}")));
    }
    page.figures(&figures);
    page.warnings(&report.warnings.iter().map(|w| (&w.what, &w.remedy)).collect::<Vec<_>>());
    let rows: Vec<Vec<String>> = report
        .cameras
        .iter()
        .map(|c| {
            vec![
                c.picture.clone(),
                format!("{:.3e}", c.rms_before),
                format!("{:.3e}", c.rms_after),
                format!("{:.4}°", c.rotated_degrees),
                format!("{:.4} %", c.moved_percent),
                c.iterations.to_string(),
                (6 - c.undetermined).to_string(),
            ]
        })
        .collect();
    let columns = ["Picture", "RMS before", "RMS after", "Rotated", "Moved, of distance", "Steps", "Directions of six"];
    page.table("Cameras", &columns, &rows);
    let views = choose(&vec![false; targets.len()], MOST_VIEWS)
        .into_iter()
        .take_while(|_| !cancel.requested())
        .map(|i| {
            let (frame, target) = (&solved.frames[i], &targets[i]);
            let sampling = Sampling::grid(target.rays_per_edge);
            let Some(rendered) = renderer.render(&frame.camera, sampling, &[], cancel) else { return Ok(None) };
            let render = rendered.film;
            let picture = Film::of(render.width, render.height, target.rgba.clone());
            let comparison = metrics::compare(&render, &picture).map_err(|e| e.at(&frame.picture))?;
            Ok(Some(ViewRow {
                name: frame.picture.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
                picture,
                render,
                extra: None,
                held_out: false,
                psnr_db: Some(comparison.psnr_db),
                note: report.cameras[i].note.clone().unwrap_or_default(),
            }))
        })
        .filter_map(Result::transpose)
        .collect::<Result<Vec<_>>>()?;
    page.views("Views from the new cameras", &views, targets.len())?;
    page.provenance(&provenance.rows());
    Ok(page)
}
