//! `cumulo motion`: how what pictures of a volume show moves from frame to frame.

mod tracing;

use super::cancel;
use super::failed::{self, Failed};
use super::memory::Memory;
use super::output::Output;
use super::outputs::{self, Content};
use super::parse;
use super::provenance::Provenance;
use super::transfer::TransferOption;
use crate::error::{Error, Kind, Result};
use crate::formats::atomic::Batch;
use crate::formats::captures;
use crate::formats::exr;
use crate::formats::protected;
use crate::formats::sequence::{Frames, Pattern, number_of};
use crate::scene::capture::Capture;
use serde::Serialize;
use std::fmt;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use tracing::SAMPLES;
pub use tracing::{Choices, Tracing};

/// Write the motion of what pictures of a volume show, as a layer that denoisers follow
///
/// A pixel's motion is the mean over the first collisions of its rays with the volume. The layer `Vector` holds X and Y, the
/// place in the frame before minus that now, and Z and W, the place now minus that in the frame after, in pixels to the
/// right and upwards. `cumulo denoise --motion files:'motion.####.exr'` takes it, and the alpha that is with it: give the
/// transfer function and the density scale that the pictures show.
#[derive(Debug, clap::Args)]
pub struct MotionCommand {
    /// VDB of all frames, or of each: 'smoke.####.vdb'; or a scene file or USD stage
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
    #[command(flatten)]
    transfer: TransferOption,
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
    /// Extinction per world unit at a density of 1; none for scene files and stages, which state their own.
    density_scale: Option<f64>,
    seconds: f64,
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { output, frames, failed, largest, density_scale, seconds } = self;
        write!(f, "{}: motion of {frames} frames in {seconds:.2} s, at most {largest:.2} pixels; ", output.display())?;
        density_scale.iter().try_for_each(|scale| write!(f, "density scale {scale}, "))?;
        write!(f, "{} that failed", failed.len())
    }
}

impl MotionCommand {
    /// Paths that the command reads.
    pub(in crate::cli) fn inputs(&self) -> Vec<&Path> {
        [self.input.as_path(), &self.cameras].into_iter().chain(self.transfer.file()).collect()
    }

    /// Reads, traces, writes and reports. Exit code 2 if a frame failed.
    ///
    /// # Errors
    /// If no frame can be begun.
    pub fn run(&self, output: &Output) -> Result<ExitCode> {
        let cancel = cancel::listen();
        let mut provenance = Provenance::begin();
        let limits = self.memory.limits();
        let numbers = self.numbers(&captures::load_within(&self.cameras, limits)?)?;
        let choices = Choices {
            grid: self.grid.clone(),
            density_scale: self.density_scale,
            transfer: self.transfer.load(limits)?,
            velocity: self.velocity.clone().map(|name| (name, self.fps)),
            samples: Some(self.samples),
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
