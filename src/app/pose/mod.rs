//! Cameras that agree with their pictures.

mod page;

use super::Context;
use crate::app::checks::{Emission, Warning, values};
use crate::app::earlier::InitialGuess;
use crate::app::inputs;
use crate::app::outputs::Content;
use crate::app::photos;
use crate::app::ranges;
use crate::app::scan::ScanSettings;
use crate::app::task::{Captured, Task};
use crate::app::transfer::TransferSettings;
use crate::app::use_case::{Report, Status, use_case};
use crate::app::{run, volume};
use crate::differentiate::gradient::pictures::Target;
use crate::error::{Code, Error, Result};
use crate::formats::limits::Limits;
use crate::formats::{captures, transforms};
use crate::inverse::observation::photo::Photo;
use crate::inverse::pose::colors::Colors;
use crate::inverse::pose::pyramid::levels;
use crate::inverse::pose::search::{PoseEstimate, Request, UNEXPLAINED, solve};
use crate::math::Aabb;
use crate::render::direct::DirectRenderer;
use crate::render::labels::not_differentiated;
use crate::render::quadrature::Quadrature;
use crate::scene::bricks::Bricks;
use crate::scene::camera::Camera;
use crate::scene::capture::{Capture, Frame, Model};
use crate::scene::scene::Scene;
use crate::scene::transfer::Transfer;
use crate::scene::volume::Grids;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use serde_json::{Map, json};
use std::fmt;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Settings of a search for where cameras stood, from their pictures and the volume in them.
///
/// The search begins with the cameras of the capture: a few degrees and a few percent of the distance off. Position and
/// rotation of each are moved until what it sees of the volume is its picture. A camera that finds no such place nearby
/// is named, and stays where it was if the search went far. Where the capture's model is pre-shaded, the volume needs a
/// grid `emission` beside its extinctions.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct PoseSettings {
    /// transforms.json of the pictures, a model of COLMAP, or the folder of either.
    #[serde(with = "crate::app::paths")]
    pub capture: PathBuf,
    /// VDB of the volume in the pictures.
    #[serde(with = "crate::app::paths")]
    pub volume: PathBuf,
    /// Capture (JSON) to write with the new cameras, and the same pictures.
    #[serde(with = "crate::app::paths")]
    pub output: PathBuf,
    /// Transfer function that the pictures show, in place of the capture's.
    #[serde(flatten)]
    pub transfer: TransferSettings,
    /// Whether to find the focal length, too: one factor for all cameras.
    pub solve_focal: bool,
    /// Steps on each size of pictures that the search goes through, at most.
    pub iterations: u32,
    /// Integration along rays; none for exact, and through functions of more than 32 points pre-integrated for the
    /// search and at its end exact for the pictures that are compared with.
    pub quadrature: Option<Quadrature>,
    /// Layer of the pictures; none for the beauty.
    pub layer: Option<String>,
    /// Grid of the volume; none for density, else the only scalar one.
    pub grid: Option<String>,
    /// Folder of a page that shows how it went; none for no page.
    #[serde(with = "crate::app::paths")]
    pub report: Option<PathBuf>,
    /// Capture of the same pictures, with whose cameras the search begins, whatever made it.
    #[serde(with = "crate::app::paths")]
    pub init: Option<PathBuf>,
    /// Whether to go on from the cameras of the output, if an earlier run of the same settings has left it.
    pub resume: bool,
    /// Memory that the work may take.
    #[serde(flatten)]
    pub limits: Limits,
}

impl Default for PoseSettings {
    fn default() -> Self {
        Self {
            capture: PathBuf::new(),
            volume: PathBuf::new(),
            output: PathBuf::new(),
            transfer: TransferSettings::default(),
            solve_focal: false,
            iterations: 40,
            quadrature: None,
            layer: None,
            grid: None,
            report: None,
            init: None,
            resume: false,
            limits: Limits::default(),
        }
    }
}

/// A camera before and after the search.
#[derive(Debug, Serialize, schemars::JsonSchema)]
struct CameraReport {
    picture: String,
    /// RMS difference of the colors between picture and render, with the camera that the search began with.
    rms_before: f64,
    /// RMS difference of the colors between picture and render, with the camera that the search ended with.
    rms_after: f64,
    /// Angle in degrees between the camera's axes before and after.
    rotated_degrees: f64,
    /// Distance between the positions before and after, in percent of the distance to the volume's centre.
    moved_percent: f64,
    iterations: u32,
    /// Number of the camera's six directions of motion that the picture does not determine: along them it stays.
    undetermined: usize,
    /// Share of the picture's variance that the search left unexplained, white noise apart; none if it was stopped.
    unexplained_variance: Option<f64>,
    note: Option<String>,
}

/// Report of a search for cameras.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub struct PoseReport {
    #[serde(serialize_with = "crate::app::paths::text")]
    output: PathBuf,
    cameras: Vec<CameraReport>,
    /// RMS difference of the colors over all cameras before the search.
    rms_before: f64,
    /// RMS difference of the colors over all cameras after the search.
    rms_after: f64,
    iterations: u32,
    /// Focal length divided by that of the capture; none without `solve_focal`.
    focal_factor: Option<f64>,
    seconds: f64,
    /// True if the search was stopped before its end.
    pub stopped: bool,
    /// Contradictions between the pictures and the model.
    warnings: Vec<Warning>,
    #[serde(serialize_with = "crate::app::paths::text")]
    report: Option<PathBuf>,
}

impl fmt::Display for PoseReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}: {} camera(s) in {:.2} s", self.output.display(), self.cameras.len(), self.seconds)?;
        writeln!(f, "  rms {:.3e}, before {:.3e}", self.rms_after, self.rms_before)?;
        if let Some(factor) = self.focal_factor {
            writeln!(f, "  focal length times {factor:.6}")?;
        }
        for camera in &self.cameras {
            write!(f, "  {}: rms {:.3e}, before {:.3e}", camera.picture, camera.rms_after, camera.rms_before)?;
            writeln!(f, "; moved by {:.3} degrees, {:.3} %", camera.rotated_degrees, camera.moved_percent)?;
            if let Some(note) = &camera.note {
                writeln!(f, "    {note}")?;
            }
        }
        if let Some(page) = &self.report {
            writeln!(f, "  report {}", page.display())?;
        }
        run::write_warnings(f, &self.warnings)
    }
}

/// Result of the search for all cameras.
struct Search {
    /// Pose of each camera, in the order of the capture's frames.
    poses: Vec<PoseEstimate>,
    /// Wall time in seconds.
    seconds: f64,
}

use_case!(PoseSettings => PoseReport, limits);

impl Report for PoseReport {
    fn status(&self) -> Result<Status> {
        Ok(Status::stopped(self.stopped))
    }
}

impl PoseSettings {
    /// Paths that the cameras are found from.
    pub(crate) fn inputs(&self) -> Vec<&Path> {
        let others = [&self.transfer.tf, &self.init].into_iter().flatten();
        [&self.capture, &self.volume].into_iter().chain(others).map(PathBuf::as_path).collect()
    }

    /// Reads, solves and writes.
    ///
    /// # Errors
    /// If capture, pictures or volume cannot be read or used, or the outputs cannot be written.
    pub fn run(&self, context: &Context) -> Result<PoseReport> {
        let _inputs = inputs::protect(self.inputs(), self.limits);
        ranges::within("iterations", self.iterations, [1, 100_000])?;
        let mut task = Task::begin(&self.output, Content::Capture, self.report.as_deref(), self.limits, context)?;
        let (init, resume, output) = (self.init.as_deref(), self.resume, &self.output);
        task.search("pose", self, InitialGuess { init, resume, output, overwrite: None })?;
        let limits = task.limits;
        let json = captures::file(&self.capture);
        let capture = captures::load_within(&json, limits)?;
        transforms::check_names(&self.output, &capture)?;
        let (grids, shown) = {
            let _stage = context.stage("reading the volume");
            self.grids(&capture, limits)?
        };
        let captured =
            Captured { json: &json, capture: &shown, emission: Emission::Stated, layer: self.layer.as_deref() };
        let (photos, mut warnings) = task.pictures(captured, photos::WHOLE, |photo| photo)?;
        if let (Grids::Density(field), Some(transfer)) = (&grids, &shown.transfer) {
            let unmet = values::unmet(field, transfer, self.transfer.unit());
            context.warn(unmet.as_slice());
            warnings.extend(unmet);
        }
        task.provenance.input(&self.volume, [self.volume.as_path()])?;
        if let Some(tf) = self.transfer.file() {
            task.provenance.input(tf, [tf])?;
        }

        let centre = self.centre(&grids.density_or_extinction())?;
        let targets = self.targets(photos, &shown, &task)?;
        let scene = Scene::shown_by(&shown, grids).map_err(|e| e.at(&self.volume))?;
        let quadrature = self.quadrature.unwrap_or_else(|| DirectRenderer::usual_quadrature(&scene));
        let renderer = DirectRenderer::new(&scene, quadrature).map_err(|e| e.at(&self.volume))?;
        let Search { poses, seconds } = self.search(&renderer, &shown, &targets, centre, &task)?;
        let stopped = task.flow().is_break();
        task.provenance.lap();

        if !stopped {
            warnings.extend(unexplained(&poses));
        }
        let mut report = PoseReport { warnings, ..self.summary(&shown, &poses, centre, seconds, stopped) };
        // Notes of what was overridden for this run do not belong into the capture: only its cameras change.
        let mut solved = Capture { transfer: shown.transfer.clone(), model: shown.model, ..capture };
        solved.frames.iter_mut().zip(&poses).for_each(|(frame, pose)| frame.camera = pose.camera);
        let mut extra = Map::new();
        extra.insert("provenance".into(), json!(task.provenance));
        transforms::save(&self.output, &solved, &extra)?;
        if let Some(dir) = &self.report {
            let _stage = context.stage("report");
            let page = page::page(&report, &solved, &targets, &renderer, &task.provenance, &task.closing())?;
            report.report = Some(page.write(dir)?);
        }
        for camera in &report.cameras {
            if let Some(note) = &camera.note {
                context.note(format!("{}: {note}", camera.picture));
            }
        }
        task.tell_stopped(stopped);
        Ok(report)
    }

    /// Combines the pictures with the cameras that the search begins with.
    fn targets(&self, photos: Vec<Photo>, shown: &Capture, task: &Task) -> Result<Vec<Target>> {
        let rays_per_edge = run::rays_per_edge(shown.pixel_filter);
        let cameras = task
            .read_initial_guess(|path| self.cameras(path, shown))?
            .unwrap_or_else(|| shown.frames.iter().map(|f| f.camera).collect());
        let target = |(photo, camera): (Photo, Camera)| Target { camera, rgba: photo.film.rgba, rays_per_edge };
        Ok(photos.into_iter().zip(cameras).map(target).collect())
    }

    /// Moves the cameras of the targets until what they see is their pictures, or the user stops the search.
    fn search(
        &self,
        renderer: &DirectRenderer<'_>,
        shown: &Capture,
        targets: &[Target],
        centre: DVec3,
        task: &Task,
    ) -> Result<Search> {
        let (colors, reference) = match renderer {
            // Pictures are what has no error, until somebody says something else.
            DirectRenderer::Density(dvr) => {
                let has_reference = self.quadrature.is_none() && shown.transfer.is_some();
                let exact = || dvr.clone().with(|dvr| dvr.quadrature(Quadrature::Exact));
                (Colors::from_medium(&shown.medium()?, shown.background), has_reference.then(exact))
            }
            DirectRenderer::Labels(_) => return Err(not_differentiated()),
            DirectRenderer::PreShaded(_) => (Colors::apart(), None),
        };
        let request = Request { colors: &colors, centre, iterations: self.iterations, solve_focal: self.solve_focal };
        let searches = |t: &Target| (levels(&t.camera) + 1 + usize::from(reference.is_some())) as u64;
        task.work_begins();
        let bar = task.context.steps(targets.iter().map(searches).sum(), "pose");
        let begun = Instant::now();
        let tick = || bar.inc(1);
        let poses = match renderer {
            DirectRenderer::Density(dvr) => solve(dvr, reference.as_ref(), targets, &request, &task.stop(), &tick),
            DirectRenderer::Labels(_) => return Err(not_differentiated()),
            DirectRenderer::PreShaded(volume) => solve(volume, None, targets, &request, &task.stop(), &tick),
        };
        let seconds = begun.elapsed().as_secs_f64();
        drop(bar);
        Ok(Search { poses, seconds })
    }

    /// Reads the volume's grids, and returns them with the capture as its pictures are to be understood.
    fn grids(&self, capture: &Capture, limits: Limits) -> Result<(Grids, Capture)> {
        let scan = ScanSettings::default();
        if capture.model == Model::PreShaded && self.transfer.tf.is_none() {
            return Ok((volume::read_pre_shaded(&self.volume, self.grid.as_deref(), &scan, limits)?, capture.clone()));
        }
        let (grid, carried) = volume::read(&self.volume, self.grid.as_deref(), (&scan, &self.transfer), limits)?;
        let shown = self.interpreted(capture, carried);
        let field = volume::arrange(&grid, shown.transfer.as_ref(), limits).map_err(|e| e.at(&self.volume))?;
        Ok((Grids::Density(field), shown))
    }

    /// Returns the capture as its pictures are to be understood: with the transfer function of the settings, if there
    /// is one.
    fn interpreted(&self, capture: &Capture, transfer: Option<Transfer>) -> Capture {
        match transfer.filter(|_| self.transfer.tf.is_some()) {
            Some(transfer) => Capture { transfer: Some(transfer), model: Model::EmissionAbsorption, ..capture.clone() },
            // A function that the pictures do not show would cut the volume's edge.
            None if capture.model == Model::Absorption => Capture { transfer: None, ..capture.clone() },
            None => capture.clone(),
        }
    }

    /// Reads the cameras that the search begins with, from a capture of the same pictures.
    fn cameras(&self, path: &Path, shown: &Capture) -> Result<Vec<Camera>> {
        let previous = captures::load_within(path, self.limits)?.frames;
        let same = |(a, b): (&Frame, &Frame)| {
            let size = |f: &Frame| (f.camera.width, f.camera.height, f.camera.projection);
            a.picture.file_name() == b.picture.file_name() && size(a) == size(b)
        };
        if previous.len() != shown.frames.len() || !previous.iter().zip(&shown.frames).all(same) {
            let option = if self.resume { "⟨resume⟩" } else { "⟨init⟩" };
            return Err(Error::invalid(format!("{option}: these are not the cameras of the capture's pictures"))
                .at(path)
                .hint(format!("leave {option} out, or give the output of an earlier run with the same capture")));
        }
        Ok(previous.into_iter().map(|f| f.camera).collect())
    }

    /// Returns the centre of the world-space box around the voxels that are not zero.
    fn centre(&self, field: &Bricks<f32>) -> Result<DVec3> {
        let outline = field.outline();
        if outline.is_empty() {
            return Err(Error::invalid("the grid is empty: no picture says anything about a camera")
                .coded(Code::EmptyGrid)
                .at(&self.volume)
                .hint("choose another grid with ⟨grid⟩"));
        }
        Ok(outline.into_iter().fold(Aabb::EMPTY, |b, p| b.including(p)).centre())
    }

    fn summary(
        &self,
        capture: &Capture,
        poses: &[PoseEstimate],
        centre: DVec3,
        seconds: f64,
        stopped: bool,
    ) -> PoseReport {
        let cameras: Vec<CameraReport> = capture
            .frames
            .iter()
            .zip(poses)
            .map(|(frame, pose)| {
                let (degrees, percent) = apart(&frame.camera, &pose.camera, centre);
                let note = note(pose, degrees);
                CameraReport {
                    picture: frame.picture.file_name().unwrap_or(frame.picture.as_os_str()).to_string_lossy().into(),
                    rms_before: pose.rms[0],
                    rms_after: pose.rms[1],
                    rotated_degrees: degrees,
                    moved_percent: percent,
                    iterations: pose.iterations,
                    undetermined: pose.undetermined,
                    unexplained_variance: Some(pose.unexplained_variance).filter(|v| v.is_finite()),
                    note,
                }
            })
            .collect();
        let mean = |of: usize| {
            let sums = poses.iter().fold((0.0, 0), |(s, n), f| (s + f.rms[of].powi(2) * f.count as f64, n + f.count));
            (sums.0 / sums.1.max(1) as f64).sqrt()
        };
        let factor = capture.frames.first().zip(poses.first()).map(|(a, b)| b.camera.focal.x / a.camera.focal.x);
        PoseReport {
            output: self.output.clone(),
            cameras,
            rms_before: mean(0),
            rms_after: mean(1),
            iterations: poses.iter().map(|f| f.iterations).max().unwrap_or(0),
            focal_factor: factor.filter(|_| self.solve_focal),
            seconds,
            stopped,
            warnings: Vec::new(),
            report: None,
        }
    }
}

/// Returns what there is to say about how a search ended whose camera was turned by `degrees`.
fn note(pose: &PoseEstimate, degrees: f64) -> Option<String> {
    let share = 100.0 * pose.unexplained_variance;
    let unexplained = pose.unexplained_variance > UNEXPLAINED;
    match pose.undetermined {
        _ if unexplained && pose.far => Some(format!(
            "no pose was found near the given one, where the camera stays: the best leaves {share:.1} % of the \
             picture's variance unexplained"
        )),
        _ if unexplained => Some(format!(
            "{share:.1} % of the picture's variance is unexplained: the pose is not certain, or the volume is not that \
             of the picture"
        )),
        _ if pose.far => Some(format!(
            "the camera moved far, by {degrees:.1} degrees: check it, for a volume may look alike from several places"
        )),
        0 => None,
        6 => Some("the picture says nothing about the camera, which stays where it was".to_owned()),
        n => Some(format!(
            "the picture says nothing about {n} of the camera's six directions of motion, along which it stays where \
             it was"
        )),
    }
}

/// Warns if pictures differ from what their cameras see.
fn unexplained(poses: &[PoseEstimate]) -> Option<Warning> {
    let of = |poor: &&PoseEstimate| poor.unexplained_variance > UNEXPLAINED;
    let (poor, lost) = (poses.iter().filter(of).count(), poses.iter().filter(of).filter(|pose| pose.far).count());
    (poor > 0).then(|| {
        Warning::new(
            format!(
                "{poor} of {} pictures are not what their cameras see: more than {} % of the variance is unexplained; \
                 {lost} of these cameras stay where they were",
                poses.len(),
                100.0 * UNEXPLAINED
            ),
            "check that the volume, ⟨tf⟩, density_scale, model and background are those of the pictures, and that the \
             search began within a few degrees",
        )
    })
}

/// Returns the angle in degrees between two cameras' axes, and the distance between them in percent of the distance of
/// the first one to `centre`.
fn apart(a: &Camera, b: &Camera, centre: DVec3) -> (f64, f64) {
    let degrees = a.rotation_to(b).length().to_degrees();
    let distance = a.position().distance(centre).max(f64::MIN_POSITIVE);
    (degrees, 100.0 * a.position().distance(b.position()) / distance)
}
