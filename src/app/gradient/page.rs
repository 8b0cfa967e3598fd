//! The page of derivatives: renders, slices of the derivatives by voxel, and every derivative listed.

use super::GradientSettings;
use super::report::GradientReport;
use crate::differentiate::loss::Rgba;
use crate::differentiate::study::subject::Subject;
use crate::differentiate::study::{Study, StudyGradient};
use crate::error::Result;
use crate::metrics;
use crate::report::{MOST_VIEWS, Page, ViewRow, choose};
use crate::scene::bricks::Bricks;
use crate::scene::film::Film;

impl GradientSettings {
    /// Makes the page, but for its provenance.
    pub(super) fn page<V: Subject>(
        &self,
        study: &Study<V>,
        gradient: &StudyGradient,
        report: &GradientReport,
    ) -> Result<Page> {
        let name = self.input.file_name().unwrap_or(self.input.as_os_str()).to_string_lossy();
        let mut page = Page::new(
            format!("{name}, derivatives of {}", report.loss),
            format!("Found by {}: {}.", report.ad_mode(), report.reason),
        );
        let mut figures = vec![
            ("Loss", format!("{:.3e}", report.value)),
            ("Parameters", report.parameters.to_string()),
            ("Views", report.views.to_string()),
            ("Precision", report.precision.to_owned()),
        ];
        if let Some(worst) = report.worst_relative_error {
            figures.push(("Off by at most", format!("{worst:.1e}")));
        }
        page.figures(&figures);
        self.pictures(study, &mut page)?;
        let channels = self.channels::<V>();
        for (at, channel) in channels.iter().enumerate() {
            let name = V::CHANNELS[*channel];
            let owned: Vec<f32> =
                gradient.by_voxel.iter().skip(at).step_by(channels.len()).map(|v| v.abs() as f32).collect();
            let mut field = Bricks::<f32>::zeros(study.field.topology.clone(), study.field.transform);
            field.topology.fill_apron(&owned, &mut field.values);
            page.slices(&format!("Derivative by {name}"), "magnitude", &field, None)?;
        }
        let mut columns = vec!["Parameter", "Value", "Derivative"];
        if self.check {
            columns.extend(["Difference quotient", "Relative error"]);
        }
        let rows: Vec<Vec<String>> = report
            .rows
            .iter()
            .map(|row| {
                let mut cells = vec![row.name.clone(), format!("{:.6e}", row.value), format!("{:.9e}", row.gradient)];
                cells.extend(row.difference.map(|v| format!("{v:.9e}")));
                cells.extend(row.relative_error.map(|v| format!("{v:.1e}")));
                cells
            })
            .collect();
        page.table("Derivatives", &columns, &rows);
        Ok(page)
    }

    /// Adds renders of the scene, beside the target's pictures if there is a target.
    fn pictures<V: Subject>(&self, study: &Study<V>, page: &mut Page) -> Result<()> {
        let (renderer, objective) = (V::renderer(&study.field, &study.setting)?, study.objective());
        let cameras = &study.setting.cameras;
        let film = |view: usize, rgba: &[Rgba]| {
            let (width, height) = (cameras[view].width as usize, cameras[view].height as usize);
            Film::of(width, height, rgba.iter().map(|p| p.map(|v| v as f32)).collect())
        };
        if study.targets.is_empty() {
            let render = film(0, &objective.picture(&renderer, 0));
            page.picture("Seen", &render, &format!("The first of {} views.", cameras.len()))?;
            return Ok(());
        }
        let row = |view: usize| {
            let (picture, render) = (film(view, &study.targets[view]), film(view, &objective.picture(&renderer, view)));
            Ok(ViewRow {
                name: format!("view {view}"),
                psnr_db: Some(metrics::compare(&render, &picture)?.psnr_db),
                picture,
                render,
                extra: None,
                held_out: false,
                note: String::new(),
            })
        };
        let shown = choose(&vec![false; cameras.len()], MOST_VIEWS);
        let rows = shown.into_iter().map(row).collect::<Result<Vec<_>>>()?;
        page.views("Views", &rows, cameras.len())?;
        Ok(())
    }
}
