//! `cumulo motion`: how what pictures of a volume show moves from frame to frame.

use super::cancel;
use super::failed::{self, Failed};
use super::memory::Memory;
use super::output::Output;
use super::outputs::{self, Content};
use super::parse;
use super::provenance::Provenance;
use super::render::between;
use super::volume;
use crate::error::{Error, Kind, Result};
use crate::formats::atomic::Batch;
use crate::formats::captures;
use crate::formats::exr;
use crate::formats::limits::Limits;
use crate::formats::protected;
use crate::formats::sequence::{Frames, Pattern, number_of};
use crate::formats::vdb::{File, velocity};
use crate::render::aov::Aov;
use crate::render::path::{PathTracer, Sampling, View};
use crate::scene::camera::Camera;
use crate::scene::capture::Capture;
use crate::scene::film::Film;
use crate::scene::medium::{Medium, Scattering};
use crate::scene::phase::Phase;
use crate::scene::scene::Scene;
use crate::scene::volume::Volume;
use serde::Serialize;
use std::fmt;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::AtomicBool;

/// Write the motion of what pictures of a volume show, as a layer that denoisers follow
///
/// A pixel's motion is the mean over the first collisions of its rays with the volume. The layer `Vector` holds X and Y, the
/// place in the frame before minus that now, and Z and W, the place now minus that in the frame after, in pixels to the
/// right and upwards. `cumulo denoise --motion files:'motion.####.exr'` takes it.
#[derive(Debug, clap::Args)]
pub struct MotionCommand {
    /// VDB of all frames, or of each: 'smoke.####.vdb'
    input: PathBuf,
    /// Cameras of the frames, in a transforms.json whose pictures bear the frames' numbers; or the one of all
    #[arg(long, value_name = "CAPTURE")]
    cameras: PathBuf,
    /// Pictures of the motion, numbered as the frames are
    #[arg(long, short, value_name = "OUT.####.exr")]
    output: PathBuf,
    /// Frames: A, A-B or A-BxSTEP (default: those of the cameras, else of the volumes)
    #[arg(long, value_name = "A-B")]
    frames: Option<Frames>,
    /// Grid that pictures show (default: density, else the only scalar one)
    #[arg(long, value_name = "NAME")]
    grid: Option<String>,
    /// Extinction per world unit at a density of 1 (default: that of the cameras' capture)
    #[arg(long, value_name = "S", value_parser = parse::positive)]
    density_scale: Option<f64>,
    /// Grid of the volume's velocities in world units per second
    #[arg(long, value_name = "GRID")]
    velocity: Option<String>,
    /// Frames per second; 1 for velocities in world units per frame
    #[arg(long, value_name = "F", default_value_t = 24.0, value_parser = parse::positive, requires = "velocity")]
    fps: f64,
    /// Replace pictures that another command made
    #[arg(long)]
    overwrite: bool,
    /// Rays per pixel
    #[arg(long, value_name = "N", default_value_t = SAMPLES, value_parser = clap::value_parser!(u32).range(1..=1 << 16))]
    samples: u32,
    #[command(flatten)]
    pub(in crate::cli) memory: Memory,
}

#[derive(Debug, Serialize, schemars::JsonSchema)]
pub(in crate::cli) struct Report {
    #[serde(serialize_with = "crate::cli::paths::text")]
    output: PathBuf,
    frames: usize,
    failed: Vec<Failed>,
    /// Largest motion from the frame before, in pixels.
    largest: f32,
    density_scale: f64,
    seconds: f64,
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { output, frames, failed, largest, density_scale, seconds } = self;
        write!(f, "{}: motion of {frames} frames in {seconds:.2} s, at most {largest:.2} pixels; ", output.display())?;
        write!(f, "density scale {density_scale}, {} that failed", failed.len())
    }
}

/// Volume of a frame.
struct Shown {
    path: PathBuf,
    scene: Scene,
}

/// Choices of a tracing beside its volumes and cameras.
struct Choices {
    grid: Option<String>,
    /// Extinction per unit of density and length; `None` for that of the capture.
    density_scale: Option<f64>,
    /// Grid of velocities, and frames per second.
    velocity: Option<(String, f64)>,
    samples: u32,
}

/// Rays per pixel unless another number is asked for.
const SAMPLES: u32 = 16;

/// Motions traced from volumes and cameras, frame by frame.
pub struct Tracing {
    input: PathBuf,
    volumes: Option<Pattern>,
    numbers: Vec<u32>,
    /// Cameras of the frames, or of all of them, each between those before and after.
    cameras: Vec<[Camera; 3]>,
    density_scale: f64,
    choices: Choices,
    limits: Limits,
    /// Volume that was read last.
    shown: Option<Shown>,
}

impl Tracing {
    /// Prepares the motion of frames with these numbers, which show a volume, or one for each, to the cameras of a capture.
    ///
    /// # Errors
    /// If the capture cannot be read, or does not fit the frames.
    pub fn new(input: &Path, cameras: &Path, numbers: &[u32], limits: Limits) -> Result<Self> {
        let choices = Choices { grid: None, density_scale: None, velocity: None, samples: SAMPLES };
        Self::of(input, &captures::load(cameras)?, cameras, numbers, choices, limits)
    }

    fn of(
        input: &Path,
        capture: &Capture,
        path: &Path,
        numbers: &[u32],
        choices: Choices,
        limits: Limits,
    ) -> Result<Self> {
        Ok(Self {
            input: input.to_owned(),
            volumes: Pattern::parse(input),
            numbers: numbers.to_vec(),
            cameras: between(capture, path, numbers)?,
            density_scale: choices.density_scale.unwrap_or(capture.density_scale),
            choices,
            limits,
            shown: None,
        })
    }

    /// Returns the planes `Vector.X` to `Vector.W` of a frame, and alpha. A volume that was read for the frame before is used
    /// again.
    ///
    /// # Errors
    /// If the volume cannot be read, or the work is interrupted.
    pub fn film(&mut self, number: u32, cancel: &AtomicBool) -> Result<Film> {
        let at = self.numbers.binary_search(&number).unwrap_or(0).min(self.cameras.len() - 1);
        let input = self.volumes.as_ref().map_or_else(|| self.input.clone(), |pattern| pattern.path(number));
        let Shown { scene, .. } = match self.shown.take().filter(|shown| shown.path == input) {
            Some(same) => self.shown.insert(same),
            None => {
                let scene = self.scene(&input)?;
                self.shown.insert(Shown { path: input, scene })
            }
        };
        let [before, camera, after] = &self.cameras[at];
        let tracer = PathTracer::new(scene)?.background([0.0; 3]);
        let view = View { camera, before: Some(before), after: Some(after), velocities: &scene.velocities };
        let sampling = Sampling::new(self.choices.samples, number.into());
        let picture = tracer.picture(view, sampling, &[Aov::Motion], cancel).ok_or_else(Error::cancelled)?;
        Ok(picture.film)
    }

    /// Returns a scene in which nothing shines: rays end where they first meet the volume.
    fn scene(&self, input: &Path) -> Result<Scene> {
        let file = File::open(input, self.limits)?;
        let grid = file.read_fog(self.choices.grid.as_deref())?;
        let field = volume::arrange(&grid, None, self.limits)?;
        let scattering = Some(Scattering::new([0.0; 3], Phase::HenyeyGreenstein(0.0)));
        let medium = Medium { scattering, ..Medium::absorbing(self.density_scale) };
        let velocity = self.choices.velocity.as_ref();
        let velocity =
            velocity.map(|(name, fps)| velocity::read(&file, name, *fps, self.limits.max_memory)).transpose()?;
        Ok(Scene {
            volumes: vec![Volume::Density(field, medium)],
            velocities: velocity.map(|velocity| (0, velocity)).into_iter().collect(),
            ..Scene::default()
        })
    }
}

impl MotionCommand {
    /// Paths that the command reads.
    pub(in crate::cli) fn inputs(&self) -> Vec<&Path> {
        vec![&self.input, &self.cameras]
    }

    /// Reads, traces, writes and reports. Exit code 2 if a frame failed.
    ///
    /// # Errors
    /// If no frame can be begun.
    pub fn run(&self, output: &Output) -> Result<ExitCode> {
        let cancel = cancel::listen();
        let mut provenance = Provenance::begin();
        let capture = captures::load(&self.cameras)?;
        let numbers = self.numbers(&capture)?;
        let choices = Choices {
            grid: self.grid.clone(),
            density_scale: self.density_scale,
            velocity: self.velocity.clone().map(|name| (name, self.fps)),
            samples: self.samples,
        };
        let limits = self.memory.limits();
        let mut tracing = Tracing::of(&self.input, &capture, &self.cameras, &numbers, choices, limits)?;
        let density_scale = tracing.density_scale;
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
        for path in &pictures {
            outputs::is_own_picture(path, "cumulo:command", &provenance.command, self.overwrite)?;
        }
        let attributes = provenance.attributes();
        let bar = output.progress(numbers.len() as u64, "motion");
        let (mut failed, mut largest) = (Vec::new(), 0.0_f32);
        for (number, path) in numbers.iter().zip(&pictures) {
            let result = tracing.film(*number, cancel).and_then(|film| {
                let planes = film.planes.iter().filter(|plane| ["Vector.X", "Vector.Y"].contains(&plane.name.as_str()));
                let most = planes.flat_map(|plane| &plane.samples).fold(0.0_f32, |most, v| most.max(v.abs()));
                exr::write_picture(path, &film, &attributes, false)?;
                Ok(most)
            });
            match result {
                Ok(most) => largest = largest.max(most),
                Err(e) if e.kind() == Kind::Cancelled => return Err(e),
                Err(e) => {
                    failed.push(Failed::new(*number, &e));
                    failed::tell(&failed[failed.len() - 1..]);
                }
            }
            bar.inc(1);
        }
        bar.finish_and_clear();
        let frames = numbers.len() - failed.len();
        if frames > 0 {
            batch.commit()?;
        }
        let code = if failed.is_empty() { ExitCode::SUCCESS } else { ExitCode::from(2) };
        let seconds = provenance.lap();
        output.report(&Report { output: self.output.clone(), frames, failed, largest, density_scale, seconds })?;
        Ok(code)
    }

    /// Returns the numbers of the frames.
    fn numbers(&self, capture: &Capture) -> Result<Vec<u32>> {
        if let Some(frames) = self.frames {
            return Ok(frames.numbers().collect());
        }
        let mut of_cameras: Vec<u32> = capture.frames.iter().filter_map(|frame| number_of(&frame.picture)).collect();
        match Pattern::parse(&self.input) {
            _ if capture.frames.len() > 1 && of_cameras.len() == capture.frames.len() => {
                of_cameras.sort_unstable();
                Ok(of_cameras)
            }
            Some(pattern) => pattern.all_numbers(),
            None => Err(Error::invalid("neither cameras nor volumes have the numbers of frames")
                .at(&self.cameras)
                .hint("give them with --frames A-B")),
        }
    }
}
