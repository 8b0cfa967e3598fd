//! The viewpoints from which a volume shows most.

mod page;

use super::Context;
use crate::app::checks::values;
use crate::app::earlier::{self, InitialGuess};
use crate::app::inputs;
use crate::app::outputs::{self, Content};
use crate::app::pictures::DensityScale;
use crate::app::ranges;
use crate::app::render;
use crate::app::scan::ScanSettings;
use crate::app::task::Task;
use crate::app::transfer::TransferSettings;
use crate::app::up::{ChosenUp, UpChoice};
use crate::app::use_case::{Report, Status, use_case};
use crate::app::volume;
use crate::cancel::Cancel;
use crate::error::{Error, Result};
use crate::formats::atomic::Batch;
use crate::formats::limits::Limits;
use crate::formats::{captures, exr, protected, transforms};
use crate::inverse::viewpoint::{self, Outcome, Request};
use crate::render::composited::Composited;
use crate::render::dvr::Dvr;
use crate::render::film::{self, Sampling};
use crate::render::quadrature::Quadrature;
use crate::render::scale;
use crate::scene::bricks::Bricks;
use crate::scene::camera::Camera;
use crate::scene::capture::{Capture, Frame, Model};
use crate::scene::film::Film;
use crate::scene::medium::{Medium, Source};
use crate::scene::sphere::{self, Sphere};
use crate::scene::transfer::Transfer;
use crate::scene::up::Up;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use serde_json::{Map, json};
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Settings of a search for the viewpoints from which a volume shows most.
///
/// Cameras stand on a sphere around the volume and face its centre. Those from which the opacity entropy of the picture
/// is largest are written as a capture, the best first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ViewpointSettings {
    /// VDB, NanoVDB or scan to look at.
    #[serde(with = "crate::app::paths")]
    pub input: PathBuf,
    /// Capture (JSON) to write with the cameras.
    #[serde(with = "crate::app::paths")]
    pub output: PathBuf,
    /// Folder of pictures that the cameras see; none for cameras alone.
    #[serde(with = "crate::app::paths")]
    pub pictures: Option<PathBuf>,
    /// Whether to replace a capture that other settings wrote, and pictures in their folder that no earlier run wrote.
    pub overwrite: bool,
    /// Number of viewpoints to start from: the search begins at the best of each and a dozen about it, on small
    /// pictures.
    pub starts: u32,
    /// Evaluations from each start, at most, for each size of picture that the search goes through.
    pub iterations: u32,
    /// Whether cameras stand in the upper half of the sphere alone, about the up axis: never below the volume.
    pub hemisphere: bool,
    /// Number of viewpoints, evenly over the sphere, that are evaluated as well for comparison.
    pub samples: u32,
    /// Width and height of the pictures in pixels.
    pub size: [u32; 2],
    /// Angle of view in degrees that holds the volume's bounding sphere: it sets how far away the cameras stand.
    pub fov: f64,
    /// Axis that points upwards, with respect to which cameras stand upright.
    pub up: UpChoice,
    /// Extinction per world unit at a density of 1.
    pub density_scale: DensityScale,
    /// Radiance behind the volume in the pictures in R, G and B; none for white, black with a transfer function.
    pub background: Option<[f32; 3]>,
    /// Transfer function that makes extinctions and colors of densities.
    #[serde(flatten)]
    pub transfer: TransferSettings,
    /// Integration along rays; none for exact, and pre-integrated through functions of more than 32 points.
    pub quadrature: Option<Quadrature>,
    /// Grid to look at; none for density, else the only scalar one.
    pub grid: Option<String>,
    /// Part of a scan that is read, and where its voxels lie.
    #[serde(flatten)]
    pub scan: ScanSettings,
    /// Capture from whose viewpoints the search starts as well, whatever made it.
    #[serde(with = "crate::app::paths")]
    pub init: Option<PathBuf>,
    /// Whether to start from the viewpoints of the output as well, if an earlier run of the same settings has left it.
    pub resume: bool,
    /// Folder of a page that shows the search; none for no page.
    #[serde(with = "crate::app::paths")]
    pub report: Option<PathBuf>,
    /// Memory that the work may take.
    #[serde(flatten)]
    pub limits: Limits,
}

impl Default for ViewpointSettings {
    fn default() -> Self {
        Self {
            input: PathBuf::new(),
            output: PathBuf::new(),
            pictures: None,
            overwrite: false,
            starts: 8,
            iterations: 8,
            hemisphere: false,
            samples: 0,
            size: [256, 256],
            fov: 40.0,
            up: UpChoice::Auto,
            density_scale: DensityScale::Given(1.0),
            background: None,
            transfer: TransferSettings::default(),
            quadrature: None,
            grid: None,
            scan: ScanSettings::default(),
            init: None,
            resume: false,
            report: None,
            limits: Limits::default(),
        }
    }
}

/// A local search, from its start to its end.
#[derive(Debug, Serialize, schemars::JsonSchema)]
struct Start {
    /// Unit vector from the sphere's centre to the camera at the start.
    start: [f64; 3],
    /// Unit vector from the sphere's centre to the camera at the end.
    end: [f64; 3],
    /// Opacity entropy of the picture at the end.
    entropy: f64,
    /// Number of evaluations.
    iterations: u32,
    /// Number of the view that the search from this start has reached.
    view: usize,
}

/// Report of a search for viewpoints.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub struct ViewpointReport {
    #[serde(serialize_with = "crate::app::paths::text")]
    output: PathBuf,
    /// Folder of the pictures; none if only cameras were asked for.
    #[serde(serialize_with = "crate::app::paths::text", skip_serializing_if = "Option::is_none")]
    pictures: Option<PathBuf>,
    views: usize,
    /// Opacity entropy of the best view.
    entropy: f64,
    sampled_best_entropy: Option<f64>,
    starts: Vec<Start>,
    /// True if the pictures are blank, so that all viewpoints are alike.
    blank: bool,
    /// True if the search was stopped before its end.
    pub stopped: bool,
    density_scale: f64,
    /// Axis with respect to which the cameras stand upright.
    up: ChosenUp,
    /// Wall time of the search.
    seconds: f64,
    /// Wall time of the samples; none without `samples`.
    sampled_seconds: Option<f64>,
    /// Wall time of one picture without derivatives.
    render_seconds: f64,
    /// Wall time of the search divided by that of one picture without derivatives.
    equivalent_renders: f64,
    #[serde(serialize_with = "crate::app::paths::text")]
    report: Option<PathBuf>,
}

impl fmt::Display for ViewpointReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}: {} view(s), the best of entropy {:.6}", self.output.display(), self.views, self.entropy)?;
        if let Some(best) = self.sampled_best_entropy {
            writeln!(f, "  best sampled   {best:.6}")?;
        }
        write!(f, "  {} start(s) in {:.2} s", self.starts.len(), self.seconds)?;
        writeln!(f, ", the time of {:.0} pictures", self.equivalent_renders)?;
        if let Some(seconds) = self.sampled_seconds {
            writeln!(f, "  samples in     {seconds:.2} s")?;
        }
        if let Some(page) = &self.report {
            writeln!(f, "  report         {}", page.display())?;
        }
        Ok(())
    }
}

/// Opacity entropies by direction, and the wall time in seconds that they took.
type Samples = (Vec<(DVec3, f64)>, f64);

use_case!(ViewpointSettings => ViewpointReport, limits);

impl Report for ViewpointReport {
    fn status(&self) -> Result<Status> {
        Ok(Status::stopped(self.stopped))
    }
}

impl ViewpointSettings {
    /// Paths that the viewpoints are found from.
    pub(crate) fn inputs(&self) -> Vec<&Path> {
        let others = [&self.transfer.tf, &self.init].into_iter().flatten();
        [&self.input].into_iter().chain(others).map(PathBuf::as_path).collect()
    }

    /// Reads, searches, renders and writes.
    ///
    /// # Errors
    /// If the volume cannot be read or has nothing in it, or the outputs cannot be written.
    pub fn run(&self, context: &Context) -> Result<ViewpointReport> {
        let _inputs = inputs::protect(self.inputs(), self.limits);
        self.check()?;
        if let Some(folder) = &self.pictures {
            outputs::folder(folder)?;
            self.spare_other_capture(folder)?;
        }
        let mut task = Task::begin(&self.output, Content::Capture, self.report.as_deref(), self.limits, context)?;
        let (init, resume, output) = (self.init.as_deref(), self.resume, &self.output);
        task.search("viewpoint", self, InitialGuess { init, resume, output, overwrite: Some(self.overwrite) })?;
        let (limits, cancel) = (task.limits, &task.stop());
        let (field, transfer) = self.field(&mut task)?;
        let unmet = transfer.as_ref().and_then(|transfer| values::unmet(&field, transfer, self.transfer.unit()));
        context.warn(unmet.as_slice());
        let up = self.up.of(&self.input, limits)?;
        context.note(&up);
        let around = Sphere::around(&field.outline(), self.size, self.fov, up.axis)
            .map_err(|e| e.at(&self.input).hint("choose another grid with ⟨grid⟩"))?;
        let mut request = Request {
            sphere: around,
            starts: self.first_directions(up.axis),
            exact_starts: Vec::new(),
            iterations: self.iterations,
            hemisphere: self.hemisphere,
        };
        let mut capture = self.capture(&field, transfer, &request)?;
        // Earlier viewpoints have no say in the density scale: it would be another one in each run.
        request.exact_starts = task.read_initial_guess(|path| self.viewpoints(path, &around))?.unwrap_or_default();
        render::fits(&capture, 0, limits.max_memory)?;
        self.refuse_overwrite(&capture, &task)?;

        let medium = opaque(capture.medium()?)?;
        let quadrature = self.quadrature.unwrap_or_else(|| Quadrature::usual(&medium.source));
        let dvr = Dvr::new(&field, medium)?.quadrature(quadrature).over([1.0; 3]);
        task.work_begins();
        let bar = context.steps(viewpoint::ticks(&request) as u64 + u64::from(self.samples), "viewpoint");
        let mut outcome = viewpoint::search(&dvr, &request, cancel, &|| bar.inc(1));
        let samples = self.sample(&dvr, &request, cancel, &|| bar.inc(1));
        drop(bar);
        outcome.stopped = task.flow().is_break();
        let blank = outcome.views.iter().all(|view| view.entropy.blank);
        if blank {
            context.note(format!(
                "{}: the pictures are blank, so that all viewpoints are alike; try ⟨density_scale=auto⟩, or another \
                 transfer function",
                self.input.display()
            ));
        }

        let best = {
            let _stage = context.stage("pictures");
            self.write(&field, &mut capture, &around, &outcome, &mut task)?
        };
        if best.is_none() && self.pictures.is_some() {
            context.note(format!(
                "{}: not all pictures are there; `cumulo render {} ⟨cameras={}⟩` makes them",
                self.output.display(),
                self.input.display(),
                self.output.display()
            ));
        }
        let mut report = self.summary(&outcome, samples.as_ref(), blank, (capture.density_scale, up));
        if let Some(dir) = &self.report {
            let samples = samples.as_ref().map(|(all, _)| all.as_slice()).unwrap_or_default();
            let page = page::page(&self.input, &report, &outcome, samples, best, &task.provenance)?;
            report.report = Some(page.write(dir)?);
        }
        task.tell_stopped(outcome.stopped);
        Ok(report)
    }

    /// Refuses values out of their ranges.
    fn check(&self) -> Result<()> {
        ranges::within("starts", self.starts, [1, 10_000])?;
        ranges::within("iterations", self.iterations, [1, 100_000])?;
        ranges::within("samples", self.samples, [0, 1_000_000])?;
        ranges::size("size", self.size)?;
        ranges::fov("fov", self.fov)?;
        if let DensityScale::Given(scale) = self.density_scale {
            ranges::positive("density_scale", scale)?;
        }
        ranges::radiance("background", self.background)
    }

    /// Reads the volume, arranged for rays, and its transfer function.
    fn field(&self, task: &mut Task) -> Result<(Bricks<f32>, Option<Transfer>)> {
        let _stage = task.context.stage("reading the volume");
        let (grid, transfer) =
            volume::read(&self.input, self.grid.as_deref(), (&self.scan, &self.transfer), task.limits)?;
        let field = volume::arrange(&grid, transfer.as_ref(), task.limits).map_err(|e| e.at(&self.input))?;
        let files = volume::files(&self.input, &self.scan, task.limits);
        task.provenance.files(files.iter().map(PathBuf::as_path))?;
        if let Some(tf) = self.transfer.file() {
            task.provenance.input(tf, [tf])?;
        }
        Ok((field, transfer))
    }

    /// Reads the unit vectors to the viewpoints of a capture.
    fn viewpoints(&self, path: &Path, around: &Sphere) -> Result<Vec<DVec3>> {
        let capture = captures::load_within(path, self.limits)?;
        let directions = capture.frames.iter().filter_map(|f| (f.camera.position() - around.centre).try_normalize());
        Ok(directions.filter(|d| !self.hemisphere || d.dot(around.up.vector()) >= 0.0).collect())
    }

    /// Returns the unit vectors to the viewpoints that the search starts about.
    fn first_directions(&self, up: Up) -> Vec<DVec3> {
        let count = self.starts as usize;
        if self.hemisphere { viewpoint::upper(count, up) } else { sphere::starts(count, up) }
    }

    /// Refuses a folder for the pictures in which another capture lies.
    fn spare_other_capture(&self, folder: &Path) -> Result<()> {
        let json = folder.join(transforms::FILE_NAME);
        let same = |a: &Path, b: &Path| matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b);
        if json.exists() && !same(&json, &self.output) {
            return Err(Error::invalid("another capture lies here, and its pictures might be replaced")
                .at(&json)
                .hint("give another folder with ⟨pictures⟩"));
        }
        Ok(())
    }

    /// Makes sure that the outputs replace neither inputs nor a capture of another command, nor pictures that no
    /// earlier run wrote. A search replaces the output that it goes on from.
    fn refuse_overwrite(&self, capture: &Capture, task: &Task) -> Result<()> {
        let written = capture.frames.iter().filter(|_| self.pictures.is_some());
        let pictures: Vec<PathBuf> = written.map(|f| f.picture.clone()).collect();
        pictures.iter().chain([&self.output]).try_for_each(|path| protected::check(path))?;
        let goes_on = task.initial_guess.as_ref().is_some_and(|beginning| beginning.file == self.output);
        if self.overwrite || goes_on {
            Ok(())
        } else {
            earlier::spare_captures(&self.output, &pictures, &task.provenance)
        }
    }

    /// Returns the folder that the capture names for its pictures: where they are not rendered, one beside the capture
    /// that bears its name, so that no other capture's pictures are taken for its own.
    fn folder(&self) -> PathBuf {
        let stem = self.output.file_stem().unwrap_or_default();
        self.pictures.clone().unwrap_or_else(|| self.output.with_file_name(stem))
    }

    /// Plans the capture to render, with the cameras of the starts.
    fn capture(&self, field: &Bricks<f32>, transfer: Option<Transfer>, request: &Request) -> Result<Capture> {
        let camera = |d: &DVec3| request.sphere.camera(&sphere::upright(*d, request.sphere.up));
        let cameras: Vec<Camera> = request.starts.iter().map(camera).collect();
        let source = match &transfer {
            Some(transfer) => Source::Transfer(Arc::new(transfer.table()?)),
            None => Source::Grey([0.0; 3]),
        };
        let density_scale = match self.density_scale {
            DensityScale::Given(scale) => scale,
            DensityScale::Auto => scale::density_scale(field, &source, &cameras).ok_or_else(|| {
                Error::invalid("no pixel meets any density, so that no scale can be found")
                    .at(&self.input)
                    .hint("check the grid and the transfer function, or give the scale as a number")
            })?,
        };
        let emits = transfer.is_some();
        Ok(Capture {
            model: if emits { Model::EmissionAbsorption } else { Model::Absorption },
            background: self.background.unwrap_or(if emits { [0.0; 3] } else { [1.0; 3] }),
            density_scale,
            transfer,
            lattice: Some(field.transform.matrix()),
            ..Capture::of_frames(self.frames(cameras))
        })
    }

    fn frames(&self, cameras: Vec<Camera>) -> Vec<Frame> {
        let folder = self.folder();
        let frame = |(i, camera)| Frame { camera, picture: folder.join(format!("view_{i:03}.exr")) };
        cameras.into_iter().enumerate().map(frame).collect()
    }

    fn sample(
        &self,
        dvr: &Composited<Dvr<'_, f32>>,
        request: &Request,
        cancel: &Cancel,
        tick: &(dyn Fn() + Sync),
    ) -> Option<Samples> {
        let begun = Instant::now();
        let count = Some(self.samples as usize).filter(|n| *n > 0)?;
        let all = viewpoint::sample(dvr, request, count, cancel, tick)?;
        Some((all, begun.elapsed().as_secs_f64()))
    }

    /// Writes the capture, and where they are asked for its pictures together with it, and returns the best view's
    /// picture where it is rendered. After a search that was stopped, only the pictures rendered within a second are
    /// written; no picture is returned if some are missing.
    fn write(
        &self,
        field: &Bricks<f32>,
        capture: &mut Capture,
        around: &Sphere,
        outcome: &Outcome,
        task: &mut Task,
    ) -> Result<Option<Film>> {
        capture.frames = self.frames(outcome.views.iter().map(|view| around.camera(&view.axes)).collect());
        let mut batch = Batch::new();
        if let Some(folder) = &self.pictures {
            batch.make_folder(folder)?;
        }
        // The page shows the best view even where no pictures are written.
        let rendered = match (&self.pictures, &self.report) {
            (Some(_), _) => capture.frames.len(),
            (None, report) => usize::from(report.is_some()),
        };
        let medium = capture.medium()?;
        let quadrature = self.quadrature.unwrap_or_else(|| Quadrature::usual(&medium.source));
        let dvr = Dvr::new(field, medium)?.quadrature(quadrature).over(capture.background);
        // The views are worth their pictures even if the search was stopped.
        let (closing, provenance) = (task.closing(), &mut task.provenance);
        let attributes = provenance.attributes();
        let (mut best, mut whole) = (None, true);
        for frame in &capture.frames[..rendered.min(capture.frames.len())] {
            let Some(rendered) = film::render(&dvr, &frame.camera, Sampling::grid(1), &[], &closing) else {
                whole = false;
                break;
            };
            let film = rendered.film;
            if self.pictures.is_some() {
                exr::write_picture(&batch.add(&frame.picture)?, &film, &attributes, exr::Half::None)?;
            }
            best.get_or_insert(film);
        }
        provenance.lap();
        let mut extra = Map::new();
        let entropies: Vec<f64> = outcome.views.iter().map(|view| view.entropy.value).collect();
        extra.insert("opacity_entropy".into(), json!(entropies));
        extra.insert("provenance".into(), json!(provenance));
        transforms::save_for(&self.output, &batch.add(&self.output)?, capture, &extra)?;
        batch.commit()?;
        Ok(best.filter(|_| whole))
    }

    fn summary(
        &self,
        outcome: &Outcome,
        samples: Option<&Samples>,
        blank: bool,
        (density_scale, up): (f64, ChosenUp),
    ) -> ViewpointReport {
        let starts = outcome.paths.iter().map(|path| {
            let view = &outcome.views[path.view];
            let start = path.directions.first().map_or([0.0; 3], DVec3::to_array);
            let (end, entropy) = (view.axes.z_axis.to_array(), view.entropy.value);
            Start { start, end, entropy, iterations: path.iterations, view: path.view }
        });
        ViewpointReport {
            output: self.output.clone(),
            pictures: self.pictures.clone(),
            views: outcome.views.len(),
            entropy: outcome.views.first().map_or(0.0, |view| view.entropy.value),
            sampled_best_entropy: samples.map(|(all, _)| all.iter().map(|s| s.1).fold(0.0, f64::max)),
            starts: starts.collect(),
            blank,
            stopped: outcome.stopped,
            density_scale,
            up,
            seconds: outcome.seconds,
            sampled_seconds: samples.map(|(_, seconds)| *seconds),
            render_seconds: outcome.render_seconds,
            equivalent_renders: outcome.seconds / outcome.render_seconds,
            report: None,
        }
    }
}

/// Returns a medium of the same opacity with less to compute: the colors of a transfer function do not matter, and
/// points that only they need are left out.
fn opaque(medium: Medium) -> Result<Medium> {
    let source = match &medium.source {
        Source::Grey(_) | Source::Linear(_) => Source::Grey([0.0; 3]),
        Source::Transfer(table) => {
            let values = table.values().iter().map(|v| [1.0, 1.0, 1.0, v[3]]).collect();
            Source::Transfer(Arc::new(table.with_values(values)?.simplified(0.0)))
        }
    };
    Ok(Medium { source, ..medium })
}
