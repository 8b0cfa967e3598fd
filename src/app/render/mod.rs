//! Pictures of a volume from many sides as a capture, one picture, or the frames of a sequence.

mod accuracy;
mod folder;
mod frames;
mod sequence;
mod target;
mod visibility;

pub use accuracy::AccuracySettings;
pub use frames::FramesReport;
pub(crate) use frames::between;

use crate::app::Context;
use crate::app::context::Picture;
use crate::app::earlier::{self, Keys, Policy};
use crate::app::inputs;
use crate::app::pictures::renderer::{Chosen, LeftOut, SceneRenderer};
use crate::app::pictures::scales::DensityScales;
use crate::app::pictures::scattering::{Paths, ScatteringSettings};
use crate::app::pictures::subject::Subject;
use crate::app::pictures::{Cameras, PictureSettings};
use crate::app::provenance::Provenance;
use crate::app::ranges;
use crate::app::up::ChosenUp;
use crate::app::use_case::{Report, Status, use_case};
use crate::cancel::Cancel;
use crate::error::{Code, Error, Result};
use crate::formats::atomic::{self, Batch};
use crate::formats::png::ToneMapping;
use crate::formats::protected;
use crate::formats::sequence::Frames;
use crate::formats::transforms::{self, FILE_NAME};
use crate::ordered;
use crate::plan::Plan;
use crate::render::film::{Aov, Rendered, View, bytes_per_pixel};
use crate::render::integrator::Counts;
use crate::render::renderer::Renderer;
use crate::render::tiles::Watch;
use crate::scene::camera::Camera;
use crate::scene::capture::{Capture, Frame, Model};
use crate::scene::scene::Scene;
use crate::wording::all_worded;
use accuracy::{AccuracyReport, Deadline, Measured, PictureError, Turn};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use std::fmt;
use std::path::{Path, PathBuf};
use std::time::Instant;
use target::Target;
use visibility::Visibility;

/// Settings of pictures that are rendered: 32-bit float, scene-linear, alpha = 1 - transmittance.
///
/// Absorption shows the background through the volume; emission-absorption adds the light of a source that is part of
/// it; with an albedo light is scattered, and pictures are made by path tracing.
///
/// ```
/// use cumulo::prelude::*;
/// # let folder = tempfile::tempdir()?;
/// # let shots = folder.path().join("shots");
/// let pictures = PictureSettings {
///     input: "fixtures/plume.vdb".into(),
///     views: Some(2),
///     size: Some([32, 32]),
///     ..PictureSettings::default()
/// };
/// let settings = RenderSettings { output: shots.clone(), pictures, ..RenderSettings::default() };
/// let report = settings.run(&Context::default())?;
/// println!("{report}");
/// assert!(shots.join("transforms.json").exists() && shots.join("view_001.exr").exists());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct RenderSettings {
    /// Folder for transforms.json and the pictures; or, for one view or frame, the file of the picture: name.exr,
    /// name.png.
    #[serde(with = "crate::app::paths")]
    pub output: PathBuf,
    /// True to replace a capture in the folder, whoever made it; one of the same settings is replaced anyway.
    pub overwrite: bool,
    /// True to write a PNG beside each EXR: radiance times 2^exposure, clipped to 0..1, sRGB.
    pub png: bool,
    /// Exposure of PNGs in stops, from -60 to 60; none for 0.
    pub exposure: Option<f64>,
    /// Frames to render, frame.####.exr for each number; none for all files of an input that is a sequence, else for
    /// views.
    pub frames: Option<Frames>,
    /// True to skip frames that are there, made by the same settings, unless an input has changed since.
    pub resume: bool,
    /// Planes to write beside RGBA.
    pub aov: Vec<Aov>,
    /// Name of the grid of the volume's velocities in world units per second, for [`Aov::Motion`].
    pub velocity: Option<String>,
    /// Frames per second; 1 for velocities in world units per frame.
    pub fps: f64,
    /// Error or time of path-traced pictures.
    #[serde(flatten)]
    pub accuracy: AccuracySettings,
    /// Subject, cameras, media and light of the pictures.
    #[serde(flatten)]
    pub pictures: PictureSettings,
}

impl Default for RenderSettings {
    fn default() -> Self {
        Self {
            output: PathBuf::new(),
            overwrite: false,
            png: false,
            exposure: None,
            frames: None,
            resume: false,
            aov: Vec::new(),
            velocity: None,
            fps: 24.0,
            accuracy: AccuracySettings::default(),
            pictures: PictureSettings::default(),
        }
    }
}

/// Settings on which pictures do not depend, or which choose some of them.
const MANNER: [&str; 4] = ["overwrite", "frames", "resume", "max_memory"];

/// Report of views, or of the frames of a sequence.
#[derive(Debug, Serialize, schemars::JsonSchema)]
#[serde(untagged)]
pub enum RenderReport {
    /// Report of views.
    Views(ViewsReport),
    /// Report of the frames of a sequence.
    Frames(FramesReport),
}

impl fmt::Display for RenderReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Views(views) => views.fmt(f),
            Self::Frames(frames) => frames.fmt(f),
        }
    }
}

/// Report of views.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub struct ViewsReport {
    #[serde(serialize_with = "crate::app::paths::text")]
    output: PathBuf,
    views: usize,
    model: Model,
    #[serde(flatten)]
    scales: DensityScales,
    #[serde(flatten)]
    way: Integration,
    /// Errors of the pictures, if a target or a time was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    accuracy: Option<AccuracyReport>,
    /// Plan of a scene that may scatter, or out of which something may be left.
    plan: Option<Plan>,
    /// Up axis about which cameras were placed; none where they were given.
    up: Option<ChosenUp>,
    /// How radiance became the samples of PNGs; none if none were written.
    #[serde(skip_serializing_if = "Option::is_none")]
    tone_mapping: Option<ToneMapping>,
    /// Remarks on statements of a USD stage that have no effect, and on what is assumed.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    remarks: Vec<String>,
    seconds: f64,
}

/// How light was integrated.
#[derive(Debug, Serialize, schemars::JsonSchema)]
#[serde(untagged)]
enum Integration {
    /// Along straight rays.
    Dvr {
        quadrature: String,
        /// Bound of the error that the quadrature makes in any channel of a pixel, in the channel's units; null where
        /// no bound is known.
        quadrature_error_bound: Option<f64>,
        early_stop: EarlyStop,
    },
    /// Along paths.
    Paths { paths: Paths },
}

/// Transmittance at which rays end, and the error that this makes.
#[derive(Debug, Clone, Copy, Serialize, schemars::JsonSchema)]
struct EarlyStop {
    /// Transmittance below which rays end; 0 for never.
    transmittance: f64,
    /// Bound of the error in any channel of a pixel, in the channel's units.
    error_bound: f64,
}

impl Integration {
    /// Adds what a capture records of how its pictures were made.
    fn record(&self, scattering: Option<&ScatteringSettings>, extra: &mut Map<String, Value>) {
        if let Self::Dvr { quadrature, early_stop, .. } = self {
            extra.insert("quadrature".into(), json!(quadrature));
            extra.insert("early_stop".into(), json!(early_stop));
        }
        extra.extend(scattering.map(|scattering| ("scattering".to_owned(), scattering.record())));
    }
}

impl fmt::Display for ViewsReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { output, views, seconds, scales, way, accuracy, plan, tone_mapping, .. } = self;
        let json = output.join(FILE_NAME);
        let file = if json.exists() { &json } else { output };
        let s = if *views == 1 { "" } else { "s" };
        writeln!(f, "{}: {views} view{s} in {seconds:.2} s, {scales}", file.display())?;
        tone_mapping.iter().try_for_each(|tone| writeln!(f, "  PNG: {tone}"))?;
        match way {
            Integration::Dvr {
                quadrature,
                quadrature_error_bound,
                early_stop: EarlyStop { transmittance, error_bound },
            } => {
                let quadrature_error = match quadrature_error_bound {
                    Some(bound) => format!("integrates within {bound:.1e}"),
                    None if quadrature == "exact" => "integrates each piece of a cell within 4e-7".to_owned(),
                    None => "states no error".to_owned(),
                };
                write!(
                    f,
                    "  quadrature {quadrature} {quadrature_error}; the early stop at transmittance {transmittance:e} \
                     leaves out at most {error_bound:.1e}"
                )?;
            }
            Integration::Paths { paths } => write!(f, "{paths}")?,
        }
        accuracy.iter().try_for_each(|accuracy| write!(f, "\n{accuracy}"))?;
        match plan {
            Some(plan) if plan.omitted != Some(0.0) => write!(f, "\n  {}", LeftOut(plan)),
            _ => Ok(()),
        }
    }
}

use_case!(RenderSettings => RenderReport, pictures.limits);

impl Report for RenderReport {
    fn status(&self) -> Result<Status> {
        Ok(match self {
            Self::Views(views) => Status::stopped(views.accuracy.as_ref().is_some_and(AccuracyReport::stopped)),
            Self::Frames(frames) => Status::complete(frames.complete()),
        })
    }
}

impl RenderSettings {
    /// Reads, renders and writes. Frames that fail are part of the report.
    ///
    /// # Errors
    /// If the volume or the cameras cannot be used, or the folder cannot be written to; an earlier capture in the
    /// folder is untouched then.
    pub fn run(&self, context: &Context) -> Result<RenderReport> {
        self.begun_at(Instant::now(), context)
    }

    fn begun_at(&self, begun: Instant, context: &Context) -> Result<RenderReport> {
        let _inputs = inputs::protect(self.pictures.inputs(), self.pictures.limits);
        self.pictures.check()?;
        ranges::positive("fps", self.fps)?;
        self.accuracy.check(self.pictures.scattering.samples)?;
        if let Some(input) = self.pictures.sequence_of_folder()? {
            let pictures = PictureSettings { input, ..self.pictures.clone() };
            return Self { pictures, ..self.clone() }.begun_at(begun, context);
        }
        let target = Target::of(&self.output)?;
        self.check_exposure()?;
        if self.is_sequence() {
            return self.run_frames(target, begun, context).map(RenderReport::Frames);
        }
        self.run_views(target, begun, context).map(RenderReport::Views)
    }

    /// Renders views and writes them.
    fn run_views(&self, target: Target<'_>, begun: Instant, context: &Context) -> Result<ViewsReport> {
        if self.resume {
            return Err(Error::invalid("⟨resume⟩: views appear together, when all are there")
                .hint("give ⟨frames⟩ to render a sequence, picture by picture"));
        }
        // From here on the work ends in order if it is stopped.
        let cancel = context.cancel();
        let mut provenance = self.provenance(context);
        let pictures = &self.pictures;
        let limits = pictures.limits;
        let template = pictures.template(None, &mut provenance)?;
        pictures.check_cameras(template.as_ref())?;
        let stated = template.as_ref().map_or(pictures.views.unwrap_or(1) as usize, |capture| capture.frames.len());
        let numbers = pictures.chosen(stated)?;
        target.holds(numbers.len(), "views", "⟨view=N⟩")?;
        let (subject, transfer) = pictures.subject(template.as_ref(), limits, &mut provenance)?;
        let mut remarks = remarks(pictures, &subject, template.as_ref());
        remarks.iter().for_each(|remark| context.note(format!("remark: {remark}")));
        let paths = pictures.scattering.on() || subject.is_scene();
        let up = pictures.chosen_up(template.as_ref())?;
        up.iter().for_each(|up| context.note(up));
        let place = |name: &str| target.picture(name);
        let capture = pictures.capture(place, &subject, transfer, template.as_ref(), Cameras::around(up.as_ref()))?;
        fits(&capture, self.plane_bytes(), limits.max_memory)?;
        self.check_aovs(paths)?;
        pictures.scattering.check(paths)?;
        self.refuse_overwrite(target, &capture, &provenance)?;
        // Pictures wait until all are there: an interrupted run must not mix its pictures with those of an earlier one.
        let mut batch = Batch::new();
        if let Target::Folder(folder) = target {
            batch.make_folder(folder)?;
        }
        let waiting = capture.frames.iter().map(|f| self.files_of(&f.picture).iter().map(|p| batch.add(p)).collect());
        let waiting = waiting.collect::<Result<Vec<Vec<PathBuf>>>>()?;
        let waiting_json = target.json().map(|json| Ok((batch.add(&json)?, json))).transpose()?;
        let scales = DensityScales::of(&subject, capture.density_scale);
        let scene = pictures.scene(&capture, subject).map_err(|e| e.at(&pictures.input))?;
        let (scene, plan) = self.planned(pictures, scene, paths, context)?;
        plan.iter().for_each(|plan| context.detail(Chosen(plan)));
        let renderer = pictures.renderer(plan.as_ref(), &scene, paths).map_err(|e| e.at(&pictures.input))?;
        let whole = pictures.whole(target, template.as_ref().and_then(|c| c.frames.get(numbers[0])));
        let views: Vec<_> = numbers.iter().zip(&scene.cameras).zip(&waiting).collect();
        let visibility = Visibility::default();
        self.accuracy.check_paths(matches!(renderer.renderer, Renderer::Paths(_)))?;
        let end = Deadline::new(begun, &self.accuracy, views.len());
        let (counts, errors) =
            self.views(&renderer, &views, (whole, &cancel, end), &provenance, &visibility, context)?;
        for remark in visibility.remarks(capture.transfer.is_some(), plan.as_ref()) {
            context.note(format!("remark: {remark}"));
            remarks.push(remark);
        }
        let seconds = provenance.lap();
        let way = self.integration(&renderer, &scene, (counts, &errors));
        if let Some((waiting, json)) = &waiting_json {
            let mut extra = record(&provenance, plan.as_ref());
            way.record(paths.then_some(&pictures.scattering), &mut extra);
            transforms::save_for(json, waiting, &capture, &extra)?;
        }
        // Another run may have ended in the folder meanwhile.
        let _lock = target.json().as_deref().and_then(Path::parent).map(atomic::lock_folder);
        self.refuse_overwrite(target, &capture, &provenance)?;
        batch.commit()?;
        Ok(ViewsReport {
            output: self.output.clone(),
            views: capture.frames.len(),
            model: capture.model,
            scales,
            way,
            accuracy: AccuracyReport::of(&self.accuracy, errors),
            plan,
            up,
            tone_mapping: self.tone_mapping_used(),
            remarks: all_worded(remarks),
            seconds,
        })
    }

    /// Begins the record of where the pictures come from.
    fn provenance(&self, context: &Context) -> Provenance {
        // Defaults that depend on no input are as good as stated.
        let mut settings = self.clone();
        settings.exposure.get_or_insert(0.0);
        let ScatteringSettings { samples, seed, .. } = &mut settings.pictures.scattering;
        samples.get_or_insert(self.pictures.scattering.samples());
        seed.get_or_insert(0);
        Provenance::begin(context).of("render", &settings, &MANNER)
    }

    /// Refuses an exposure that no picture would have.
    fn check_exposure(&self) -> Result<()> {
        if self.exposure.is_some() && self.tone_mapping_used().is_none() {
            return Err(Error::invalid("⟨exposure⟩: no PNG is written, and EXRs are scene-linear")
                .hint("add ⟨png⟩, or let the name of the output end in .png"));
        }
        Ok(())
    }

    /// Renders views, given with their numbers and the files that each is written to. Those whose error is stated come
    /// one after the other, since each has its time.
    fn views(
        &self,
        renderer: &SceneRenderer<'_>,
        views: &[((&usize, &Camera), &Vec<PathBuf>)],
        (whole, cancel, mut deadline): (Option<[usize; 2]>, &Cancel, Deadline),
        provenance: &Provenance,
        visibility: &Visibility,
        context: &Context,
    ) -> Result<(Counts, Vec<PictureError>)> {
        let bar = context.pictures(views.len() as u64, "render");
        let attributes = provenance.attributes();
        let view = |((number, camera), files): &((&usize, &Camera), &Vec<PathBuf>), turn: Turn| {
            let picture = bar.picture();
            let view = (**number, (*camera).into(), turn);
            let (rendered, error) = self.picture(renderer, view, (cancel, &picture), context)?;
            // One picture that was stopped is shown as it is. Of several, which appear together, some are missing.
            if views.len() > 1 && error.as_ref().is_some_and(PictureError::is_stopped) {
                return Err(Error::cancelled());
            }
            let Rendered { film, counts } = rendered;
            visibility.add(&film);
            let mut attributes = attributes.clone();
            error.iter().for_each(|error| error.describe(&self.accuracy, &mut attributes));
            files.iter().try_for_each(|file| self.write_picture(file, &film, &attributes, whole))?;
            Ok((counts, error))
        };
        let results: Vec<(Counts, Option<PictureError>)> = match self.accuracy.on() {
            true => views.iter().map(|one| view(one, deadline.next())).collect::<Result<_>>()?,
            false => ordered::try_map(views.par_iter(), |one| view(one, Turn::default()))?,
        };
        drop(bar);
        let counts = results.iter().fold(Counts::default(), |sum, (counts, _)| sum.plus(*counts));
        Ok((counts, results.into_iter().filter_map(|(_, error)| error).collect()))
    }

    /// Renders a view, or a frame, of that number: as its sampling says, or until its error is as asked for or the time
    /// is up.
    ///
    /// # Errors
    /// If the work is stopped before anything is there.
    fn picture(
        &self,
        renderer: &SceneRenderer<'_>,
        (number, view, turn): (usize, View<'_>, Turn),
        (cancel, progress): (&Cancel, &Picture<'_>),
        context: &Context,
    ) -> Result<(Rendered, Option<PictureError>)> {
        match &renderer.renderer {
            Renderer::Paths(tracer) if self.accuracy.on() => {
                let measured = self.measured(tracer, (number, view), turn, (cancel, progress), context);
                let Measured { rendered, error } = measured.ok_or_else(Error::cancelled)?;
                Ok((rendered, Some(error)))
            }
            _ => {
                let rendered = self.film(renderer, number, view, cancel, progress);
                Ok((rendered.ok_or_else(Error::cancelled)?, None))
            }
        }
    }

    /// Returns the bytes of memory per pixel that planes take, and sums by which errors are known.
    fn plane_bytes(&self) -> u64 {
        let planes = bytes_per_pixel(&self.aov);
        match self.accuracy.on() {
            true if self.aov.is_empty() => planes + accuracy::BYTES,
            true => planes + accuracy::BYTES + accuracy::FEATURE_BYTES,
            false => planes,
        }
    }

    /// Plans a scene and takes out of it what the plan leaves out. Rays without paths are not planned unless something
    /// may be left out: their model says what is on.
    fn planned(
        &self,
        pictures: &PictureSettings,
        scene: Scene,
        paths: bool,
        context: &Context,
    ) -> Result<(Scene, Option<Plan>)> {
        if !(paths || pictures.leaves_out()) {
            return Ok((scene, None));
        }
        let _stage = pictures.leaves_out().then(|| context.stage("planning"));
        let plan = pictures.plan(&scene, self.aov.iter().any(|aov| aov.of_paths()), &context.cancel())?;
        Ok((plan.simplify(scene)?, Some(plan)))
    }

    /// Returns how light was integrated, with the events that were counted.
    fn integration(
        &self,
        renderer: &SceneRenderer<'_>,
        scene: &Scene,
        (counts, errors): (Counts, &[PictureError]),
    ) -> Integration {
        match &renderer.renderer {
            Renderer::Direct(dvr) => Integration::Dvr {
                quadrature: self.pictures.quadrature(scene).to_string(),
                quadrature_error_bound: dvr.quadrature_error(),
                early_stop: EarlyStop { transmittance: self.pictures.early_stop, error_bound: dvr.left_out() },
            },
            Renderer::Paths(_) => Integration::Paths { paths: self.paths(counts, errors) },
        }
    }

    /// Returns the summary of the events while pictures were traced.
    fn paths(&self, counts: Counts, errors: &[PictureError]) -> Paths {
        let scattering = &self.pictures.scattering;
        let mean = errors.iter().map(PictureError::mean_paths).sum::<f64>() / errors.len().max(1) as f64;
        scattering.paths(if errors.is_empty() { scattering.samples() } else { mean.round() as u32 }, counts)
    }

    /// Refuses planes that the renderer does not have.
    fn check_aovs(&self, paths: bool) -> Result<()> {
        if let Some(aov) = self.aov.iter().find(|aov| aov.of_paths() && !paths) {
            return Err(Error::invalid(format!("⟨aov={}⟩: nothing is scattered", aov.name()))
                .hint("planes of scattered light need path tracing: give ⟨albedo⟩"));
        }
        if self.aov.contains(&Aov::Motion) && !self.is_sequence() {
            return Err(Error::invalid("⟨aov=motion⟩: views are no frames")
                .hint("give ⟨frames⟩ to render a sequence, by the cameras of ⟨cameras⟩"));
        }
        if self.velocity.is_some() && !self.aov.contains(&Aov::Motion) {
            return Err(Error::invalid("⟨velocity⟩: no plane shows it").hint("add ⟨aov=motion⟩"));
        }
        let (rays, option) = match paths {
            true => (self.pictures.scattering.samples(), "⟨samples=16⟩"),
            false => (self.pictures.supersample, "⟨supersample=4⟩"),
        };
        if rays < 2
            && let Some(aov) = self.aov.iter().find(|aov| matches!(aov, Aov::Variance | Aov::Halves))
        {
            return Err(Error::invalid(format!("⟨aov={}⟩: one ray a pixel has no variance", aov.name()))
                .hint(format!("give each pixel more of them: {option}")));
        }
        Ok(())
    }

    /// Renders a view, or a frame, of that number, and counts its pixels. Returns `None` if `cancel` was set.
    fn film(
        &self,
        renderer: &SceneRenderer<'_>,
        number: usize,
        view: View<'_>,
        cancel: &Cancel,
        progress: &Picture<'_>,
    ) -> Option<Rendered> {
        let all = u64::from(view.camera.width) * u64::from(view.camera.height);
        let done = |pixels| progress.add(pixels, all);
        let watch = Watch { cancel, done: Some(&done) };
        let sampling = self.pictures.sampling(renderer, number);
        renderer.renderer.render(view, sampling, &self.aov, watch)
    }

    /// Makes sure that the outputs replace neither inputs nor files that other settings wrote.
    fn refuse_overwrite(&self, target: Target<'_>, capture: &Capture, provenance: &Provenance) -> Result<()> {
        let json = target.json();
        let pictures: Vec<PathBuf> = capture.frames.iter().flat_map(|f| self.files_of(&f.picture)).collect();
        pictures.iter().chain(&json).try_for_each(|path| protected::check(path))?;
        match json {
            _ if self.overwrite => Ok(()),
            Some(json) => earlier::spare_captures(&json, &pictures, provenance),
            None => {
                let policy = Policy { own: provenance, keys: Keys::RENDERED, overwrite: false, resume: false };
                pictures.iter().try_for_each(|picture| policy.check(picture))
            }
        }
    }
}

/// Begins the keys that a capture has beside those of cameras and medium: where it comes from, and how it was planned.
fn record(provenance: &Provenance, plan: Option<&Plan>) -> Map<String, Value> {
    let mut extra = Map::new();
    extra.insert("provenance".into(), json!(provenance));
    extra.extend(plan.map(|plan| ("plan".to_owned(), json!(plan))));
    extra
}

/// Returns the remarks on a subject, its cameras and its lights.
pub(in crate::app) fn remarks(
    pictures: &PictureSettings,
    subject: &Subject,
    template: Option<&Capture>,
) -> Vec<String> {
    let cameras = template.filter(|_| subject.is_scene()).map_or(&[][..], |capture| &capture.remarks);
    let lights = if subject.is_scene() { None } else { pictures.other_light() };
    subject.remarks().iter().chain(cameras).cloned().chain(lights).collect()
}

/// Refuses pictures that do not fit in memory, one for each thread: pixels, samples and bytes of the file, and
/// `plane_bytes` a pixel for further planes.
pub fn fits(capture: &Capture, plane_bytes: u64, max_memory: u64) -> Result<()> {
    let at_once = rayon::current_num_threads().min(capture.frames.len()) as u64;
    let pixels = |f: &Frame| u64::from(f.camera.width) * u64::from(f.camera.height);
    match capture.frames.iter().max_by_key(|f| pixels(f)) {
        Some(f) if pixels(f) * (48 + plane_bytes) * at_once > max_memory => {
            let Camera { width, height, .. } = f.camera;
            Err(Error::unsupported(format!("{at_once} pictures of {width}x{height} pixels do not fit in memory"))
                .at(&f.picture)
                .coded(Code::MemoryLimit)
                .hint("choose a smaller ⟨size⟩, fewer ⟨threads⟩, or raise ⟨max_memory⟩"))
        }
        _ => Ok(()),
    }
}
