//! How what pictures of a volume show moves from frame to frame.

mod tracing;

use crate::app::Context;
use crate::app::earlier::{Keys, Policy};
use crate::app::failed::Failed;
use crate::app::frame_loop::{FrameLoop, parted};
use crate::app::inputs;
use crate::app::outputs::{self, Content};
use crate::app::provenance::Provenance;
use crate::app::ranges;
use crate::app::scan::ScanSettings;
use crate::app::sequence;
use crate::app::transfer::TransferSettings;
use crate::app::use_case::{Report, Status, use_case};
use crate::error::{Error, Result};
use crate::formats::atomic::Batch;
use crate::formats::captures;
use crate::formats::exr;
use crate::formats::limits::Limits;
use crate::formats::protected;
use crate::formats::sequence::{Frames, Pattern, number_of};
use crate::render::film::Aov;
use crate::scene::capture::Capture;
use crate::scene::film::Film;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::{Path, PathBuf};
pub(crate) use tracing::SAMPLES;
pub use tracing::{Choices, Tracing};

/// Layout of motions in pictures, in pixels to the right and upwards.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MotionFormat {
    /// Layer `Vector` of Blender: X and Y are the place in the frame before minus that now, Z and W the place now minus
    /// that in the frame after.
    #[default]
    Blender,
    /// Layers `forward` and `backward` of Nuke: u and v are the place in the frame after, or before, minus that now.
    Nuke,
    /// Layer `Denoising Backward Motion`: X and Y are the place in the frame before minus that now, Z the length along
    /// the viewing axis in the frame before minus that now. Cycles 5.2 hands this to Open Image Denoise.
    Oidn,
}

impl MotionFormat {
    /// Returns the plane that holds all of it.
    fn plane(self) -> Aov {
        match self {
            Self::Blender | Self::Nuke => Aov::Motion,
            Self::Oidn => Aov::BackwardMotion,
        }
    }

    /// Gives traced planes the names and signs of the layout.
    fn arrange(self, film: &mut Film) {
        if self != Self::Nuke {
            return;
        }
        for plane in &mut film.planes {
            let (name, turned) = match plane.name.as_str() {
                "Vector.X" => ("backward.u", false),
                "Vector.Y" => ("backward.v", false),
                "Vector.Z" => ("forward.u", true),
                "Vector.W" => ("forward.v", true),
                _ => continue,
            };
            plane.name = name.to_owned();
            // Zero stays zero: it has no sign.
            plane.samples.iter_mut().filter(|_| turned).for_each(|v| *v = 0.0 - *v);
        }
    }
}

/// Settings of the motion of what pictures of a volume show, written as a layer that denoisers follow.
///
/// A pixel's motion is the mean over the first collisions of its rays with the volume, or over the surfaces that they
/// meet where more is seen of these.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct MotionSettings {
    /// VDB, NanoVDB or scan of all frames, or a pattern of one for each; or a scene file or USD stage.
    #[serde(with = "crate::app::paths")]
    pub input: PathBuf,
    /// Cameras of the frames, in a transforms.json whose pictures bear the frames' numbers; or the one of all.
    #[serde(with = "crate::app::paths")]
    pub cameras: PathBuf,
    /// Pattern of the pictures of the motion, numbered as the frames are.
    #[serde(with = "crate::app::paths")]
    pub output: PathBuf,
    /// Frames; none for those of the cameras, else of the volumes.
    pub frames: Option<Frames>,
    /// Name of the grid that pictures show; none for density, else the only scalar one.
    pub grid: Option<String>,
    /// Part of a scan that is read, and where its voxels lie.
    #[serde(flatten)]
    pub scan: ScanSettings,
    /// Extinction per world unit at a density of 1; none for that of the cameras' capture.
    pub density_scale: Option<f64>,
    /// Transfer function that the pictures show.
    #[serde(flatten)]
    pub transfer: TransferSettings,
    /// Name of the grid of the volume's velocities in world units per second.
    pub velocity: Option<String>,
    /// Frames per second; 1 for velocities in world units per frame.
    pub fps: f64,
    /// Layout of the motions.
    pub format: MotionFormat,
    /// True to replace pictures that other settings made.
    pub overwrite: bool,
    /// Rays per pixel, 1 to 65536.
    pub samples: u32,
    /// Memory that the work may take.
    #[serde(flatten)]
    pub limits: Limits,
}

impl Default for MotionSettings {
    fn default() -> Self {
        Self {
            input: PathBuf::new(),
            cameras: PathBuf::new(),
            output: PathBuf::new(),
            frames: None,
            grid: None,
            scan: ScanSettings::default(),
            density_scale: None,
            transfer: TransferSettings::default(),
            velocity: None,
            fps: 24.0,
            format: MotionFormat::default(),
            overwrite: false,
            samples: SAMPLES,
            limits: Limits::default(),
        }
    }
}

/// Settings on which frames do not depend, or which choose some of them.
const MANNER: [&str; 3] = ["overwrite", "frames", "max_memory"];

/// Report of the motion of frames.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub struct MotionReport {
    #[serde(serialize_with = "crate::app::paths::text")]
    output: PathBuf,
    frames: usize,
    failed: Vec<Failed>,
    /// Largest motion from the frame before, in pixels.
    largest: f32,
    /// Extinction per world unit at a density of 1; none for scene files and stages, which state their own.
    density_scale: Option<f64>,
    seconds: f64,
}

impl MotionReport {
    /// True if no frame failed.
    pub(crate) fn complete(&self) -> bool {
        self.failed.is_empty()
    }
}

impl fmt::Display for MotionReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { output, frames, failed, largest, density_scale, seconds } = self;
        write!(f, "{}: motion of {frames} frames in {seconds:.2} s, at most {largest:.2} pixels; ", output.display())?;
        density_scale.iter().try_for_each(|scale| write!(f, "density scale {scale}, "))?;
        write!(f, "{} that failed", failed.len())
    }
}

use_case!(MotionSettings => MotionReport, limits);

impl Report for MotionReport {
    fn status(&self) -> Result<Status> {
        Ok(Status::complete(self.complete()))
    }
}

impl MotionSettings {
    /// Paths that the motion is made from.
    pub(crate) fn inputs(&self) -> Vec<&Path> {
        [self.input.as_path(), &self.cameras].into_iter().chain(self.transfer.file()).collect()
    }

    /// Reads, traces and writes. Frames that fail are part of the report.
    ///
    /// # Errors
    /// If no frame can be begun.
    pub fn run(&self, context: &Context) -> Result<MotionReport> {
        let _inputs = inputs::protect(self.inputs(), self.limits);
        ranges::positive("density_scale", self.density_scale)?;
        ranges::positive("fps", self.fps)?;
        ranges::within("samples", self.samples, [1, 1 << 16])?;
        let cancel = &context.cancel();
        let mut provenance = Provenance::begin(context).of("motion", self, &MANNER);
        let limits = self.limits;
        let numbers = self.numbers(&captures::load_within(&self.cameras, limits)?)?;
        let choices = Choices {
            grid: self.grid.clone(),
            density_scale: self.density_scale,
            transfer: self.transfer.load(limits)?,
            velocity: self.velocity.clone().map(|name| (name, self.fps)),
            scan: self.scan.clone(),
            samples: Some(self.samples),
            plane: self.format.plane(),
        };
        let mut tracing = Tracing::new(&self.input, &self.cameras, &numbers, choices, limits)?;
        let density_scale = tracing.density_scale();
        let to = Pattern::parse(&self.output).ok_or_else(|| {
            Error::invalid(
                "this is the name of one file, and each frame becomes one: it needs a place for the frame's number",
            )
            .at(&self.output)
            .hint("give a name such as 'motion.####.exr', in quotes")
        })?;
        let pictures: Vec<PathBuf> = numbers.iter().map(|number| to.path(*number)).collect();
        let mut batch = Batch::new();
        if let Some(folder) = pictures.first().and_then(|p| p.parent()).filter(|p| !p.as_os_str().is_empty()) {
            batch.make_folder(folder)?;
        }
        pictures.first().map_or(Ok(()), |first| outputs::file(first, Content::Exr))?;
        pictures.iter().try_for_each(|path| protected::check(path))?;
        let policy = Policy { own: &provenance, keys: Keys::RENDERED, overwrite: self.overwrite, resume: false };
        pictures.iter().try_for_each(|path| policy.check(path))?;
        let attributes = provenance.attributes();
        let results = FrameLoop::steps(&numbers, "motion", context).telling().in_order(|place, number, _| {
            let mut film = tracing.film(number, cancel)?;
            // Both layouts begin with the motion from the frame before.
            let from_before = film.planes.iter().take(2).flat_map(|plane| &plane.samples);
            let most = from_before.fold(0.0_f32, |most, v| most.max(v.abs()));
            self.format.arrange(&mut film);
            exr::write_picture(&pictures[place], &film, &attributes, exr::Half::None)?;
            Ok(most)
        });
        let (done, failed) = parted(results?);
        let largest = done.iter().fold(0.0_f32, |largest, (_, most)| largest.max(*most));
        let frames = done.len();
        if frames > 0 {
            batch.commit()?;
        }
        let seconds = provenance.lap();
        Ok(MotionReport { output: self.output.clone(), frames, failed, largest, density_scale, seconds })
    }

    /// Returns the numbers of the frames.
    fn numbers(&self, capture: &Capture) -> Result<Vec<u32>> {
        if let Some(frames) = self.frames {
            return Ok(frames.numbers().collect());
        }
        let mut of_cameras: Vec<u32> = capture.frames.iter().filter_map(|frame| number_of(&frame.picture)).collect();
        match sequence::pattern(&self.input) {
            _ if capture.frames.len() > 1 && of_cameras.len() == capture.frames.len() => {
                of_cameras.sort_unstable();
                Ok(of_cameras)
            }
            Some(pattern) => pattern.all_numbers(),
            None => Err(Error::invalid("neither cameras nor volumes have the numbers of frames")
                .at(&self.cameras)
                .hint("give them with ⟨frames=A⟩-B")),
        }
    }
}
