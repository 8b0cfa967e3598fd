//! The reconstruction of voxels: the steps from pictures to report that densities and pre-shaded volumes share.

use super::capture::LoadedCapture;
use super::forecast::Forecast;
use super::page;
use super::region::{Placed, RegionSettings, Unknowns};
use super::sample::{Measured, Sample};
use super::stages::StageClock;
use crate::app::checks::excerpt::Excerpt;
use crate::app::checks::residuals;
use crate::app::checks::{Emission, Warning};
use crate::app::photos;
use crate::app::run::{self, RefinedCameras, Run, Solver};
use crate::app::task::{Captured, Task};
use crate::error::Result;
use crate::inverse::cost::Cost;
use crate::inverse::observation::Observation;
use crate::inverse::observation::photo::Photo;
use crate::inverse::observation::transmittances::{Channels, Transmittances};
use crate::inverse::progress::{Stage, Step};
use crate::scene::grid::{Grid, MetaValue};
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::Path;

/// The reconstruction of a volume, from the reading of its pictures to its report.
#[derive(Debug)]
pub(super) struct VolumeTask<'t> {
    /// Limits, interruption and provenance of the work.
    pub task: Task,
    /// Folder of the page; none where no page is asked for.
    page: Option<&'t Path>,
    /// The capture of the pictures.
    pub input: LoadedCapture,
    /// Path of the VDB to write.
    vdb: &'t Path,
    layer: Option<&'t str>,
    clock: StageClock,
    warnings: Vec<Warning>,
    expected: Option<Cost>,
    /// Rates of the search on a few of the pictures; none where that was not timed.
    pub measured: Option<Measured>,
    refined: Option<RefinedCameras>,
}

/// Optical depths of pictures, and what else is kept of these.
#[derive(Debug)]
pub(super) struct Pictures {
    /// The pictures, in the order of the capture's frames; none if depths are all that is needed.
    pub photos: Vec<Photo>,
    /// An excerpt of each picture.
    pub excerpts: Vec<Excerpt>,
    /// Optical depths of the pictures' pixels.
    pub observation: Observation,
}

/// Pictures, and the voxels that they are to determine.
#[derive(Debug)]
pub(super) struct Measurements {
    /// The pictures.
    pub pictures: Pictures,
    /// Lattice and bounds of the unknown voxels.
    pub unknowns: Unknowns,
}

/// The course and the quality of a solver's run; the voxels themselves are kept apart.
#[derive(Debug)]
pub(super) struct Solved {
    /// Every iteration.
    pub history: Vec<Step>,
    /// PSNR of the training views in dB, peak 1; NaN if the work was stopped before it was measured.
    pub train_psnr_db: f64,
    /// PSNR of the held-out views in dB, peak 1; none without such views.
    pub held_out_psnr_db: Option<f64>,
    /// Number of unknown voxels on the finest level.
    pub unknowns: usize,
    /// True if the user stopped the work.
    pub stopped: bool,
}

impl<'t> VolumeTask<'t> {
    /// Begins with a capture that was loaded, for a VDB and the folder of a page; the clock of the first stage, which
    /// reads the pictures, starts here.
    pub(super) fn new(
        task: Task,
        input: LoadedCapture,
        (vdb, page): (&'t Path, Option<&'t Path>),
        layer: Option<&'t str>,
    ) -> Self {
        Self {
            task,
            page,
            input,
            vdb,
            layer,
            clock: StageClock::start(),
            warnings: Vec::new(),
            expected: None,
            measured: None,
            refined: None,
        }
    }

    /// Tells what the reconstruction will cost, by `cost` of the unknowns and of a few of the pictures, before all are
    /// read.
    ///
    /// # Errors
    /// If a picture cannot be read.
    pub(crate) fn forecast(
        &mut self,
        region: &RegionSettings,
        channels: Channels,
        cost: impl FnOnce(&Self, &Sample, &Placed) -> Result<(Cost, Option<Measured>)>,
    ) -> Result<()> {
        let LoadedCapture { json, capture, .. } = &self.input;
        let forecast = Forecast { capture, layer: self.layer, limits: self.task.limits, channels };
        let told = forecast.tell(region, &self.task.context, |sample, placed| cost(self, sample, placed));
        self.measured = told.map_err(|e| e.at(json))?.flatten();
        Ok(())
    }

    /// Reads the pictures, whose `channels` tell the optical depths, and keeps them whole where `whole` says so. The
    /// reconstruction is to explain what `shown` makes of a picture.
    ///
    /// # Errors
    /// If the pictures cannot be read or used.
    pub(crate) fn read(
        &mut self,
        emission: Emission,
        channels: Channels,
        whole: bool,
        shown: impl Fn(Photo) -> Photo + Sync + Send,
    ) -> Result<Pictures> {
        let LoadedCapture { json, capture, .. } = &self.input;
        let count = capture.frames.len();
        let take = |photo: Photo| {
            let photo = shown(photo);
            let excerpt = Excerpt::new(&photo, count);
            (excerpt, Transmittances::new(&photo, channels), whole.then_some(photo))
        };
        let captured = Captured { json, capture, emission, layer: self.layer };
        let bytes = if whole { photos::WHOLE } else { photos::DEPTHS };
        let (taken, mut warnings) = self.task.pictures(captured, bytes, take)?;
        self.warnings.append(&mut warnings);
        let (mut excerpts, mut transmittances, mut photos) = (Vec::new(), Vec::new(), Vec::new());
        for (excerpt, of_picture, photo) in taken {
            excerpts.push(excerpt);
            transmittances.push(of_picture);
            photos.extend(photo);
        }
        let observation = Observation::gather(transmittances, channels).map_err(|e| e.at(json.as_path()))?;
        Ok(Pictures { photos, excerpts, observation })
    }

    /// Ends the stage that read the pictures, and keeps how their cameras moved since, with the warnings about that.
    pub(crate) fn refined(&mut self, refined: RefinedCameras, mut warnings: Vec<Warning>) {
        self.clock.end("read pictures and refine cameras");
        self.refined = Some(refined);
        self.warnings.append(&mut warnings);
    }

    /// Chooses the unknown voxels of the pictures that were read.
    ///
    /// # Errors
    /// If the pictures leave no region for the voxels.
    pub(crate) fn measure(&mut self, region: &RegionSettings, pictures: Pictures) -> Result<Measurements> {
        let LoadedCapture { json, capture, .. } = &self.input;
        let mut unknowns = region.choose(capture, &pictures.observation, &self.task.context).map_err(|e| e.at(json))?;
        self.task.context.warn(&unknowns.warnings);
        self.warnings.append(&mut unknowns.warnings);
        Ok(Measurements { pictures, unknowns })
    }

    /// Ends the stage that read the pictures and begins the search, once memory and VDB are known to hold its result.
    ///
    /// # Errors
    /// If the unknowns do not fit in memory, or no VDB can hold their lattice.
    pub(crate) fn begin(&mut self, unknowns: &Unknowns, expected: Cost) -> Result<()> {
        self.clock.end(if self.refined.is_some() { "choose the region" } else { "read pictures" });
        expected.fits(self.task.limits.max_memory).map_err(|e| e.at(&self.input.json))?;
        unknowns.writable(self.vdb)?;
        self.task.context.note(format!("expected: {expected}"));
        self.task.work_begins();
        self.expected = Some(expected);
        Ok(())
    }

    /// Runs a solver under a progress bar of that many steps, until it ends or the user stops it.
    ///
    /// # Errors
    /// Those of the solver.
    pub(crate) fn solve<T>(
        &self,
        what: &'static str,
        steps: u64,
        solver: impl FnOnce(&mut dyn FnMut(&Step) -> ControlFlow<()>) -> Result<T>,
    ) -> Result<T> {
        let bar = self.task.context.steps(steps, what);
        let outcome = solver(&mut |step| {
            run::show(&bar, step);
            self.task.flow()
        });
        drop(bar);
        outcome
    }

    /// Adds the stages that the solver has measured.
    pub(crate) fn solved(&mut self, stages: Vec<Stage>) {
        self.clock.append(stages);
    }

    /// Measures the confidence of the voxels, and adds warnings about a result that does not explain its pictures. A
    /// run that is stopped meanwhile has no confidences and counts as stopped.
    ///
    /// # Errors
    /// Those of `measure`.
    pub(crate) fn confidence(
        &mut self,
        solved: &mut Solved,
        measure: impl FnOnce(&dyn Fn(usize, usize)) -> Result<(Vec<Grid>, Vec<Warning>)>,
    ) -> Result<Vec<Grid>> {
        let (grids, mut warnings) = {
            let stage = self.task.context.stage("confidence");
            measure(&|done, of| stage.at(done, of))?
        };
        warnings.extend(residuals::held_out(solved.train_psnr_db, solved.held_out_psnr_db));
        warnings.extend(residuals::unexplained(solved.train_psnr_db));
        if !solved.stopped {
            self.warnings.append(&mut warnings);
        }
        solved.stopped = solved.stopped || grids.is_empty();
        self.clock.end("confidence");
        Ok(grids)
    }

    /// Writes the VDB with `write`, which is given the provenance as metadata, and the capture with refined cameras.
    ///
    /// # Errors
    /// Those of `write`, or if that capture cannot be written.
    pub(crate) fn write(&mut self, write: impl FnOnce(&BTreeMap<String, MetaValue>) -> Result<()>) -> Result<()> {
        self.task.provenance.lap();
        write(&self.task.provenance.metadata())?;
        if let Some(refined) = &self.refined {
            self.input.save_cameras(&refined.capture, &self.task.provenance)?;
        }
        self.clock.end("write");
        Ok(())
    }

    /// Returns the report of the run: `grid` is the name of the written grid, `voxel_size` the edge lengths of its
    /// voxels in world units.
    ///
    /// # Errors
    /// If the page cannot be made.
    pub(crate) fn finish(
        self,
        solver: Solver,
        grid: String,
        voxel_size: [f64; 3],
        solved: Solved,
        held_out: Vec<usize>,
    ) -> Result<Run> {
        let views = self.input.capture.frames.len();
        let mut run = Run {
            capture: self.refined.as_ref().map_or(self.input.json, |refined| refined.capture.clone()),
            output: self.vdb.to_path_buf(),
            grid,
            solver,
            layer: self.layer.map(str::to_owned),
            iterations: solved.history.len() as u32,
            seconds: self.task.provenance.seconds,
            train_psnr_db: Some(solved.train_psnr_db).filter(|v| v.is_finite()),
            held_out_psnr_db: solved.held_out_psnr_db.filter(|v| v.is_finite()),
            peak_memory_mb: run::peak_memory_mb(),
            stopped: solved.stopped,
            views,
            shown: photos::report_views(views, &held_out),
            held_out,
            voxel_size,
            unknowns: solved.unknowns,
            expected: self.expected,
            cameras: self.refined,
            warnings: self.warnings,
            report: None,
            stages: self.clock.into_stages(),
            history: solved.history,
            provenance: self.task.provenance.clone(),
        };
        if let Some(dir) = self.page {
            let _stage = self.task.context.stage("report");
            run.report = Some(page::write(dir, &run, self.task.limits, &self.task.closing())?);
        }
        match &run.cameras {
            Some(refined) if run.stopped => self.task.context.note(format!(
                "stopped; what was there by then is written: to go on from it, give {} in place of the capture, {} as \
                 ⟨init⟩, another output, and no ⟨refine_cameras⟩",
                refined.capture.display(),
                run.output.display()
            )),
            _ => self.task.tell_stopped(run.stopped),
        }
        Ok(run)
    }
}
