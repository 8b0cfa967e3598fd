//! Derivatives of a loss on pictures, parameter by parameter, for checking and teaching.

mod albedo;
mod check;
mod derivatives;
mod page;
mod report;
pub(in crate::app) mod scene;
mod settings;
mod voxels;

pub use report::GradientReport;
pub use settings::{GradientSettings, LossName, Wrt};

use crate::app::Context;
use crate::app::checks::Warning;
use crate::app::inputs;
use crate::app::outputs::{self, Content};
use crate::app::provenance::Provenance;
use crate::app::use_case::{Report, Status, use_case};
use crate::app::volume;
use crate::differentiate::study::subject::Subject;
use crate::differentiate::study::{Study, StudyGradient};
use crate::error::Result;
use crate::formats::captures;
use crate::formats::vdb::{Codec, write_grids};
use crate::report::Page;
use crate::scene::grid::Grid;
use crate::scene::volume::Grids;
use scene::in_double;
use std::path::PathBuf;

/// Results that are written once all is computed.
struct Results {
    report: GradientReport,
    /// Derivatives by voxel, one grid a channel; empty if none are to be written.
    grids: Vec<Grid>,
    /// Page, still without provenance.
    page: Option<Page>,
}

use_case!(GradientSettings => GradientReport, limits);

impl Report for GradientReport {
    fn status(&self) -> Result<Status> {
        Ok(Status::of_check(true, !self.agrees()))
    }
}

impl GradientSettings {
    /// Reads, plans, differentiates, checks and writes.
    ///
    /// # Errors
    /// If the volume or the pictures cannot be used, or a parameter does not exist.
    pub fn run(&self, context: &Context) -> Result<GradientReport> {
        let _inputs = inputs::protect(self.inputs(), self.limits);
        let mut provenance = Provenance::begin(context);
        self.fits_together()?;
        self.check_albedo()?;
        if self.is_by_albedo() {
            let files = volume::files(&self.input, &self.scan, self.limits);
            let others = self.target.as_deref().map(captures::file);
            let others = [others.as_deref(), self.transfer.file()].into_iter().flatten();
            provenance.files(files.iter().map(PathBuf::as_path).chain(others))?;
            let report = self.by_albedo(context)?;
            return Ok(GradientReport { seconds: provenance.lap(), provenance: Some(provenance), ..report });
        }
        if let Some(path) = &self.output {
            outputs::file(path, Content::Vdb)?;
        }
        if let Some(dir) = &self.report {
            outputs::report_folder(dir)?;
        }
        let (grids, setup) = {
            let _stage = context.stage("reading the volume");
            self.scene()?
        };
        let up = setup.up.clone();
        up.iter().for_each(|up| context.note(up));
        let target = self.target.as_deref().map(captures::file);
        let volume_files = volume::files(&self.input, &self.scan, self.limits);
        let others = [target.as_deref(), self.transfer.file()].into_iter().flatten();
        provenance.files(volume_files.iter().map(PathBuf::as_path).chain(others))?;
        let Results { mut report, grids, page } = match grids {
            Grids::Density(field) => self.evaluate(self.study(field, setup, context)?, context)?,
            Grids::EmissionExtinction(volume) => self.evaluate(self.study(volume, setup, context)?, context)?,
        };
        if let Some(path) = &self.output {
            provenance.lap();
            let grids: Vec<&Grid> = grids.iter().collect();
            write_grids(path, &grids, &provenance.metadata(), Codec::default(), false)?;
        }
        if let (Some(dir), Some(mut page)) = (&self.report, page) {
            provenance.lap();
            page.provenance(&provenance.rows());
            report.report = Some(page.write(dir)?);
        }
        Ok(GradientReport { seconds: provenance.lap(), provenance: Some(provenance), up, ..report })
    }

    /// Differentiates, and checks the derivatives if the settings say so.
    fn evaluate<V: Subject>(&self, (study, warnings): (Study<V>, Vec<Warning>), context: &Context) -> Result<Results> {
        if !self.check {
            let (gradient, report) = self.differentiate(&study, context)?;
            return self.results(&study, &gradient, GradientReport { warnings, ..report });
        }
        let mut study = in_double(study);
        let (gradient, report) = self.differentiate(&study, context)?;
        let mut report = GradientReport { warnings, ..report };
        self.compare(&mut study, &mut report, context)?;
        self.results(&study, &gradient, report)
    }

    fn results<V: Subject>(
        &self,
        study: &Study<V>,
        gradient: &StudyGradient,
        report: GradientReport,
    ) -> Result<Results> {
        let page = self.report.as_ref().map(|_| self.page(study, gradient, &report)).transpose()?;
        Ok(Results { grids: self.as_grids(study, gradient), page, report })
    }
}
