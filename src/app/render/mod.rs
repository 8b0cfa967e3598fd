//! Pictures of a volume from many sides as a capture, one picture, or the frames of a sequence.

mod accuracy;
mod begun;
mod blur;
mod deep;
mod denoised;
mod folder;
mod frames;
mod holdout;
mod job;
mod joined;
mod merge;
mod merge_deep;
mod sequence;
mod straight;
mod target;
mod turntable;
mod views;
mod visibility;

pub use accuracy::AccuracySettings;
pub use blur::BlurSettings;
pub use denoised::DenoisedReport;
pub use frames::FramesReport;
pub use holdout::HoldoutSettings;
pub use merge::{MergeReport, MergeSettings};
pub use views::ViewsReport;

use crate::app::Context;

use crate::app::context::Picture;
use crate::app::inputs;
use crate::app::job::Divisible;
use crate::app::pictures::PictureSettings;
use crate::app::pictures::renderer::SceneRenderer;
use crate::app::pictures::scattering::{Paths, ScatteringSettings};
use crate::app::provenance::Provenance;
use crate::app::ranges;
use crate::app::use_case::{Report, Status, use_case};
use crate::cancel::Cancel;
use crate::error::{Code, Error, Result};
use crate::formats::exr::Packing;
use crate::formats::sequence::Frames;
use crate::plan::Plan;
use crate::render::film::{Aov, Rendered, View, bytes_per_pixel};
use crate::render::integrator::Counts;
use crate::render::renderer::Renderer;
use crate::render::tiles::Watch;
use crate::scene::camera::Camera;
use crate::scene::capture::{Capture, Frame};
use crate::scene::scene::Scene;
use accuracy::{Made, Measured, PictureError, Turn};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::PathBuf;
use std::time::Instant;
use target::Target;

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
    /// True to write colors and alpha of EXRs in 16 bits, other planes in 32; a color beyond 65504 leaves all in 32.
    /// A picture that is stopped begins anew.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub half: bool,
    /// How EXRs are packed.
    pub compression: Packing,
    /// Exposure of PNGs in stops, from -60 to 60; none for 0.
    pub exposure: Option<f64>,
    /// Frames to render, frame.####.exr for each number; none for all files of an input that is a sequence, else for
    /// views.
    pub frames: Option<Frames>,
    /// Number that is added to that of a frame to give that of its camera in `cameras`.
    pub camera_offset: i32,
    /// Frames of one turn of the camera about the up axis: frame F is seen from the angle 360 F / N degrees, 0 being
    /// the front; none for cameras that `cameras` states, or one at rest.
    pub orbit: Option<u32>,
    /// True to skip frames that are there, made by the same settings, unless an input has changed since, and to go on
    /// from a frame or a single view that was stopped before its error, time or replicates were reached.
    pub resume: bool,
    /// True to denoise the pictures: a sequence in time, or one view. The noisy ones stay, in the folder `noisy` or as
    /// name.noisy.exr; a target is that of the error after denoising.
    pub denoise: bool,
    /// Planes to write beside RGBA.
    pub aov: Vec<Aov>,
    /// Name of the grid of the volume's velocities in world units per second, for [`Aov::Motion`].
    pub velocity: Option<String>,
    /// Frames per second; 1 for velocities in world units per frame.
    pub fps: f64,
    /// Blur by the aperture of the camera and by its motion.
    #[serde(flatten)]
    pub blur: BlurSettings,
    /// Largest error of color and opacity before any depth of deep EXRs, whose pixels keep at which depths their light
    /// comes from: from 1e-4 to 0.5, for colors in units of 1, or of the pixel's brightest channel if that is brighter;
    /// none for flat pictures. Deep pictures have no background.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub deep: Option<f64>,
    /// Objects that hide what is behind them.
    #[serde(flatten)]
    pub holdout: HoldoutSettings,
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
            half: false,
            compression: Packing::default(),
            exposure: None,
            frames: None,
            camera_offset: 0,
            orbit: None,
            resume: false,
            denoise: false,
            aov: Vec::new(),
            velocity: None,
            fps: 24.0,
            blur: BlurSettings::default(),
            deep: None,
            holdout: HoldoutSettings::default(),
            accuracy: AccuracySettings::default(),
            pictures: PictureSettings::default(),
        }
    }
}

/// Settings on which pictures do not depend, or which choose some of them.
const MANNER: [&str; 5] = ["output", "overwrite", "frames", "resume", "max_memory"];

/// Settings of views in a folder that do not change what a view shows: some views are chosen by their numbers.
const MANNER_OF_VIEWS: [&str; 6] = ["output", "overwrite", "frames", "resume", "max_memory", "view"];

/// Report of views, or of the frames of a sequence.
#[derive(Debug, Serialize, schemars::JsonSchema)]
#[serde(untagged)]
pub enum RenderReport {
    /// Report of views.
    Views(ViewsReport),
    /// Report of the frames of a sequence.
    Frames(FramesReport),
    /// Report of pictures that were denoised, too.
    Denoised(Box<DenoisedReport>),
}

impl fmt::Display for RenderReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Views(views) => views.fmt(f),
            Self::Frames(frames) => frames.fmt(f),
            Self::Denoised(denoised) => denoised.fmt(f),
        }
    }
}

use_case!(RenderSettings => RenderReport, pictures.limits);

impl Report for RenderReport {
    fn status(&self) -> Result<Status> {
        Ok(match self {
            Self::Views(views) => Status::stopped(views.stopped()),
            Self::Frames(frames) => Status::complete(frames.complete()),
            Self::Denoised(denoised) => denoised.status()?,
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
        let _inputs = inputs::protect(Divisible::inputs(self), self.pictures.limits);
        self.pictures.check()?;
        ranges::positive("fps", self.fps)?;
        self.blur.check(self.is_sequence(), self.orbit)?;
        self.holdout.check()?;
        self.check_deep()?;
        self.accuracy.check(&self.pictures)?;
        if let Some(input) = self.pictures.sequence_of_folder()? {
            let pictures = PictureSettings { input, ..self.pictures.clone() };
            return Self { pictures, ..self.clone() }.begun_at(begun, context);
        }
        let target = Target::of(&self.output)?;
        self.check_exposure()?;
        self.check_cameras_of_frames()?;
        if self.denoise {
            return self.run_denoised(context).map(|report| RenderReport::Denoised(Box::new(report)));
        }
        if self.is_sequence() {
            return self.run_frames(target, begun, context).map(RenderReport::Frames);
        }
        self.run_views(target, begun, context).map(RenderReport::Views)
    }

    /// Begins the record of where the pictures come from.
    fn provenance(&self, context: &Context) -> Provenance {
        // Defaults that depend on no input are as good as stated.
        let mut settings = self.clone();
        settings.exposure.get_or_insert(0.0);
        let ScatteringSettings { samples, seed, .. } = &mut settings.pictures.scattering;
        samples.get_or_insert(self.pictures.scattering.samples());
        seed.get_or_insert(0);
        let in_folder = || matches!(Target::of(&self.output), Ok(Target::Folder(_)));
        let manner = if !self.is_sequence() && in_folder() { &MANNER_OF_VIEWS[..] } else { &MANNER };
        Provenance::begin(context).of("render", &settings, manner)
    }

    /// Refuses an exposure that no picture would have.
    fn check_exposure(&self) -> Result<()> {
        if self.exposure.is_some() && self.tone_mapping_used().is_none() {
            return Err(Error::invalid("⟨exposure⟩: no PNG is written, and EXRs are scene-linear")
                .hint("add ⟨png⟩, or let the name of the output end in .png"));
        }
        Ok(())
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
        earlier: Option<Made>,
        (cancel, progress): (&Cancel, &Picture<'_>),
        context: &Context,
    ) -> Result<(Rendered, Option<PictureError>)> {
        match &renderer.renderer {
            Renderer::Paths(tracer) if self.accuracy.on() => {
                let measured = self.measured(tracer, (number, view, earlier), turn, (cancel, progress), context);
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
        let of_frames = self.aov.iter().find(|aov| aov.of_frames());
        if let Some(aov) = of_frames.filter(|_| !self.is_sequence()) {
            return Err(Error::invalid(format!("⟨aov={}⟩: views are no frames", aov.name()))
                .hint("give ⟨frames⟩ to render a sequence, by the cameras of ⟨cameras⟩"));
        }
        if self.velocity.is_some() && of_frames.is_none() {
            return Err(Error::invalid("⟨velocity⟩: no plane shows it").hint("add ⟨aov=motion⟩"));
        }
        if self.aov.contains(&Aov::Replicates) && !self.accuracy.on() {
            return Err(Error::invalid("⟨aov=replicates⟩: a picture of ⟨samples⟩ paths is one replicate")
                .hint("leave it out: `cumulo merge` joins such pictures of different seeds as they are"));
        }
        let with_sums = self.accuracy.replicates.is_some() || self.aov.contains(&Aov::Replicates);
        for (name, loses) in [("⟨half⟩", self.half), ("⟨compression⟩", !self.compression.is_lossless())] {
            if loses && with_sums {
                return Err(Error::invalid(format!("{name}: sums over replicates need all of their digits"))
                    .hint(format!("leave {name} out, and convert what `cumulo merge` makes of the pictures")));
            }
        }
        if let Some(aov) = self.aov.iter().find(|aov| !self.compression.is_lossless() && !aov.survives_loss()) {
            return Err(Error::invalid(format!(
                "⟨compression={}⟩: the plane {} needs all of its digits, and DWA takes channels named R, G, B and Y \
                 for colors",
                self.compression,
                aov.name()
            ))
            .hint("write such planes without loss, as pictures of their own"));
        }
        if self.accuracy.replicates.is_some() && !self.sums_tell_all() {
            return Err(Error::invalid("⟨replicates⟩: only the planes variance, samples and replicates can be joined")
                .hint("render the other planes as a picture of their own"));
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
