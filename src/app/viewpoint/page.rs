//! The page of a search for viewpoints.

use super::ViewpointReport;
use crate::app::provenance::Provenance;
use crate::error::Result;
use crate::inverse::viewpoint::Outcome;
use crate::report::{Page, SphereMap, Walk};
use crate::scene::film::Film;
use glam::DVec3;
use std::path::Path;

/// Makes the page of a search: best view, entropies and paths over the sphere, and a table of the starts.
pub(crate) fn page(
    input: &Path,
    report: &ViewpointReport,
    outcome: &Outcome,
    samples: &[(DVec3, f64)],
    best: Option<Film>,
    provenance: &Provenance,
) -> Result<Page> {
    let name = input.file_name().unwrap_or(input.as_os_str()).to_string_lossy();
    let stopped = if report.stopped { "; stopped before the end" } else { "" };
    let mut page = Page::new(
        format!("{name}, where it shows most"),
        format!(
            "Viewpoints of largest opacity entropy, from {} starts{}{stopped}.",
            report.starts.len(),
            if report.blank { "; the pictures are blank, so that all are alike" } else { "" },
        ),
    );
    let mut figures = vec![("Entropy", format!("{:.5}", report.entropy))];
    if let Some(sampled) = report.sampled_best_entropy {
        figures.push(("Best sampled", format!("{sampled:.5}")));
    }
    figures.push(("Viewpoints", report.views.to_string()));
    figures.push(("Time", format!("{:.2} s", report.seconds)));
    figures.push(("In pictures", format!("{:.1}", report.equivalent_renders)));
    if let Some(seconds) = report.sampled_seconds {
        figures.push(("Time of samples", format!("{seconds:.2} s")));
    }
    page.figures(&figures);
    if let Some(best) = best {
        page.picture("Best view", &best, "The best view as the capture's first picture shows it.")?;
    }
    let walks = outcome.paths.iter().enumerate().map(|(i, path)| Walk {
        label: format!("start {i}, to {:.5}", outcome.views[path.view].entropy.value),
        directions: path.directions.clone(),
    });
    page.sphere(
        "Search",
        &SphereMap {
            quantity: "Opacity entropy".into(),
            samples: samples.to_vec(),
            walks: walks.collect(),
            best: outcome.views.first().map(|view| view.axes.z_axis),
        },
    )?;
    let rows: Vec<Vec<String>> = report
        .starts
        .iter()
        .enumerate()
        .map(|(i, start)| {
            vec![
                format!("start {i}"),
                direction(start.start),
                direction(start.end),
                format!("{:.6}", start.entropy),
                start.view.to_string(),
                start.iterations.to_string(),
            ]
        })
        .collect();
    page.table("Starts", &["Start", "From", "To", "Entropy", "View", "Evaluations"], &rows);
    page.provenance(&provenance.rows());
    Ok(page)
}

fn direction([x, y, z]: [f64; 3]) -> String {
    format!("{x:.3}, {y:.3}, {z:.3}")
}
