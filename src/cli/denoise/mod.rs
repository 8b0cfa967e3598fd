//! `cumulo denoise`: noisy pictures, of sequences in time.

mod frames;
mod held;
mod motion;
mod names;
mod passes;
mod plan;
mod reading;
mod shot;

use super::failed::{self, Failed};
use super::memory::Memory;
use super::output::Output;
use super::outputs;
use super::provenance::Provenance;
use super::renewed::{self, Earlier, Renewed};
use crate::cli::cancel;
use crate::denoise::{Estimate, Method, Settings};
use crate::error::{Error, Result};
use crate::formats::atomic::Batch;
use crate::formats::exr;
use crate::formats::protected;
use crate::formats::sequence::Frames;
use crate::report::number::short;
use crate::text::ranges;
use clap::ValueEnum;
use motion::Motion;
use names::Names;
use plan::Plan;
use serde::Serialize;
use std::fmt;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Denoise a sequence of pictures in time, or a single picture
///
/// Colors are compared along the motion of what they show, over the frames before and, with wrls2, after; a single
/// picture is denoised by its own pixels alone. Each view of a stereo picture is denoised. All that is not denoised
/// passes through as it is, attributes included. A frame that cannot be read, or has no finite pixel, is named, and
/// the others go on.
#[derive(Debug, clap::Args)]
pub struct Denoise {
    /// Noisy frames, 'in.####.exr' or in.%04d.exr, or one picture
    input: PathBuf,
    /// Denoised frames, numbered as those that go in: 'out.####.exr'; of one picture one name
    #[arg(long, short, value_name = "OUT.####.exr")]
    output: PathBuf,
    /// Frames to write: A, A-B or A-BxSTEP (default: all that there are); those around are read to learn from
    #[arg(long, value_name = "A-B")]
    frames: Option<Frames>,
    /// Way to denoise
    #[arg(long, value_enum, default_value_t = Way::Wrls2)]
    method: Way,
    /// Where motion comes from: auto takes the layer Vector if there is one; layer:NAME; files:'motion.####.exr' of
    /// `cumulo motion`; vdb:V.vdb,CAPTURE computes as `cumulo motion` does, from a volume, or vdb:V.####.vdb,CAPTURE, and
    /// the capture with its cameras; none for pictures at rest
    #[arg(long, value_name = "FROM", default_value = "auto")]
    motion: Motion,
    /// Layers of color to denoise, comma-separated, in all views (default: the beauty)
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    layers: Vec<String>,
    /// Guide to the outlines that must stay sharp, for wrls2
    #[arg(long, value_enum, default_value_t = Guide::Alpha)]
    guide: Guide,
    /// Denoise the alpha of these layers, too
    #[arg(long)]
    alpha: bool,
    /// Add the layer `confidence`: the number of samples that each pixel rests on
    #[arg(long)]
    confidence: bool,
    /// Add the layers `noise` and `error`, for wrls2: the root mean square of the noise that came in and of the error
    /// that is left around each pixel, in the units of the colors, as the frames before and after tell them; -1 where
    /// unknown
    #[arg(long)]
    error: bool,
    /// Frames that a frame learns from, for wrls2
    #[arg(long, value_enum, default_value_t = Direction::Both)]
    direction: Direction,
    /// Work in chunks of N frames that do not depend on each other
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    chunk: Option<u32>,
    /// Frames before and after a chunk, or after a frame, that are read to learn from
    #[arg(long, value_name = "M", default_value_t = 12)]
    overlap: u32,
    /// Skip frames that are there, made by the same command, unless the picture or its motion has changed since;
    /// changes of the frames around, of which a frame learns, do not count
    #[arg(long)]
    resume: bool,
    /// Replace pictures that another command made
    #[arg(long)]
    overwrite: bool,
    /// Frames at which another shot begins: auto finds them, none has none
    #[arg(long, value_enum, default_value_t = Cuts::Auto)]
    cuts: Cuts,
    /// Share of the history in the feature, for wrls, rls and ema
    #[arg(long, value_name = "ALPHA", default_value_t = Settings::default().history)]
    history: f32,
    /// Bandwidth of the distance between color and feature above which colors are outliers, for wrls
    #[arg(long, value_name = "H", default_value_t = Settings::default().bandwidth)]
    bandwidth: f32,
    /// Share of what was learned that is kept from frame to frame, for wrls and rls
    #[arg(long, value_name = "LAMBDA", default_value_t = Settings::default().forgetting)]
    forgetting: f32,
    /// Standard deviation in pixels of the weights of the models around a pixel, for wrls and rls
    #[arg(long, value_name = "PIXELS", default_value_t = Settings::default().spread)]
    spread: f32,
    /// Bandwidth of the distance between the features of neighbours, for wrls and rls
    #[arg(long, value_name = "H", default_value_t = Settings::default().likeness)]
    likeness: f32,
    #[command(flatten)]
    pub(in crate::cli) memory: Memory,
}

/// Way to denoise.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize, schemars::JsonSchema)]
#[serde(rename_all = "lowercase")]
enum Way {
    /// Guided filter in space and time, of the frames before and after
    Wrls2,
    /// Weighted recursive least squares as published by Iglesias-Guitian et al. 2020
    Wrls,
    /// Recursive least squares without weights against outliers
    Rls,
    /// Spatiotemporal variance-guided filtering, Schied et al. 2017
    Svgf,
    /// Exponential moving average, clamped to the colors around
    Ema,
}

impl Way {
    fn method(self) -> Method {
        match self {
            Self::Wrls2 => Method::Wrls2,
            Self::Wrls => Method::Wrls,
            Self::Rls => Method::Rls,
            Self::Svgf => Method::Svgf,
            Self::Ema => Method::Ema,
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Direction {
    /// Frames before and after the frame
    Both,
    /// Frames before the frame alone, in two thirds of the time
    Forward,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Guide {
    /// Alpha: of the files of the motion, else of the layer, else of the beauty; it does not count where it is noisy
    Alpha,
    /// The colors alone
    None,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Cuts {
    /// Find them by how much the picture changes
    Auto,
    /// The sequence is one shot
    None,
}

#[derive(Debug, Serialize, schemars::JsonSchema)]
pub(in crate::cli) struct Report {
    #[serde(serialize_with = "crate::cli::paths::text")]
    output: PathBuf,
    method: Way,
    denoised: usize,
    skipped: usize,
    /// Frames that were there and were denoised again, by the input that has changed.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    renewed: Vec<Renewed>,
    failed: Vec<Failed>,
    /// First frames of the shots after the first.
    cuts: Vec<u32>,
    /// Number of pixels whose color or alpha was not finite and has been filled in.
    filled: usize,
    /// Frames that have such pixels.
    filled_frames: Vec<u32>,
    /// True if no frame had a motion other than 0.
    at_rest: bool,
    /// True if the alpha that comes with the motion contradicts that of the pictures, which is used in its place then.
    alpha_contradicts: bool,
    /// Estimate of the noise that came in and of the error that is left; none where frames do not tell it.
    estimate: Option<Accuracy>,
    /// Number of frames that were compared with those on both sides for the estimate.
    #[serde(skip)]
    compared: usize,
    seconds: f64,
    /// Seconds of the denoising alone.
    seconds_denoising: f64,
    /// True for one picture, of which there is less to tell.
    #[serde(skip)]
    still: bool,
}

/// Noise that came in and error that is left, of the first layer, as the frames themselves tell them without a
/// reference: root mean squares over pixels and channels, in the units of the colors.
#[derive(Debug, Clone, Copy, Serialize, schemars::JsonSchema)]
struct Accuracy {
    /// Number of frames that it is estimated from: those that have frames on both sides.
    frames: usize,
    noise: f64,
    error: f64,
    /// Upper end of the 95 % interval of the error, as far as the estimate errs by chance.
    error_high: f64,
    /// Decibels by which the error is below the noise.
    gain_db: f64,
    /// Error over the root mean square of the denoised colors.
    relative_error: f64,
    /// Share of the picture, as far as it is not empty, that is much as it was: it has no noise, or the frames around
    /// do not show it.
    as_it_was: f64,
}

impl Accuracy {
    /// Returns what an estimate tells, unless its frames do not show the same signal.
    fn of((estimate, frames): (Estimate, usize)) -> Option<Self> {
        let (noise, error) = (estimate.noise(), estimate.error());
        let found = Self {
            frames,
            noise,
            error,
            error_high: estimate.error_high(),
            gain_db: 20.0 * (noise / error).log10(),
            relative_error: error / estimate.level().max(f64::MIN_POSITIVE),
            as_it_was: estimate.as_it_was(),
        };
        estimate.fits().then_some(found)
    }
}

impl fmt::Display for Accuracy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { frames, noise, error, error_high, gain_db, as_it_was, .. } = self;
        let [noise, error, error_high] = [*noise, *error, *error_high].map(short);
        write!(f, "estimated from {frames} frames: noise {noise} in, error {error} out, {gain_db:.1} dB less ")?;
        write!(f, "(up to {error_high} at 95 % confidence)")?;
        if *as_it_was > 0.01 {
            write!(f, "; {:.0} % of the picture is much as it was", 100.0 * as_it_was)?;
        }
        Ok(())
    }
}

impl Report {
    /// Returns the exit code.
    ///
    /// # Errors
    /// If a frame failed; the error lists them.
    fn outcome(&self, input: &Path) -> Result<ExitCode> {
        let [first, ..] = &self.failed[..] else { return Ok(ExitCode::SUCCESS) };
        let (failed, all) = (self.failed.len(), self.failed.len() + self.denoised);
        let list: Vec<String> = self.failed.iter().map(|failed| failed.frame.to_string()).collect();
        let why = first.error.lines().next().unwrap_or_default();
        Err(Error::invalid(format!("{failed} of {all} frames were not denoised: {} ({why})", list.join(", ")))
            .at(input)
            .hint("render the frames above again, then repeat the command with --resume"))
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { output, method, denoised, skipped, renewed, failed, cuts, filled, filled_frames, .. } = self;
        let Self { estimate, compared, seconds, seconds_denoising, .. } = self;
        let way = method.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned());
        let output = output.display();
        match (self.still, denoised) {
            (true, 0) => write!(f, "{output}: it was there, made by the same command")?,
            (true, _) => write!(f, "{output}: denoised by {way} in {seconds:.2} s")?,
            (false, _) => {
                write!(f, "{output}: {denoised} frames denoised by {way} in {seconds:.2} s ")?;
                write!(f, "({seconds_denoising:.2} s of it denoising), {skipped} were there, {} failed", failed.len())?;
            }
        }
        write!(f, "{}", renewed::List(renewed))?;
        if !cuts.is_empty() {
            let list: Vec<String> = cuts.iter().map(u32::to_string).collect();
            write!(f, "\n  shots begin at {}", list.join(", "))?;
        }
        if *filled > 0 {
            let frames = match (self.still, &filled_frames[..]) {
                (true, _) | (_, []) => String::new(),
                (_, [frame]) => format!(" of frame {frame}"),
                (_, frames) => format!(" of frames {}", ranges(frames.iter().copied())),
            };
            write!(f, "\n  {filled} pixels{frames} were NaN or infinite, and were filled in from those around")?;
        }
        match (estimate, compared) {
            (Some(estimate), _) => write!(f, "\n  {estimate}")?,
            (None, 0) => {}
            (None, _) => write!(
                f,
                "\n  noise and error cannot be told from these frames: the error is too small for so few pixels, \
                 something moves or flickers that the motion does not tell, texture is as fine as pixels, or the noise \
                 of pixels is not independent"
            )?,
        }
        Ok(())
    }
}

impl Denoise {
    /// Paths that the command reads.
    pub(in crate::cli) fn inputs(&self) -> Vec<&Path> {
        std::iter::once(self.input.as_path()).chain(self.motion.paths()).collect()
    }

    /// Reads, denoises, writes and reports.
    ///
    /// # Errors
    /// If the sequence cannot be begun, or a frame cannot be read or written; the others are there then.
    pub fn run(&self, output: &Output) -> Result<ExitCode> {
        let provenance = Provenance::begin();
        let settings = self.settings()?;
        let two_way = self.method.method().looks_ahead() && self.direction == Direction::Both;
        if self.error && !two_way {
            return Err(Error::invalid("--error needs --method wrls2 and --direction both")
                .hint("noise and error are told by the frames before and after; give neither option, or no --error"));
        }
        let input = Names::of(&self.input)?;
        let to = input.alike(&self.output, "the noisy frames")?;
        input.check_frames(self.frames.is_some())?;
        let present = input.all_numbers()?;
        let wanted: Vec<u32> = match self.frames {
            Some(frames) => frames.numbers().collect(),
            None => present.clone(),
        };
        let first = wanted.first().copied().unwrap_or(1);
        // A folder that stays empty is removed again.
        let mut batch = Batch::new();
        if let Some(folder) = to.path(first).parent().filter(|folder| !folder.as_os_str().is_empty()) {
            batch.make_folder(folder)?;
        }
        outputs::file(&to.path(first), outputs::Content::Exr)?;
        // Frames that were asked for and are missing fail by name.
        let mut numbers: Vec<u32> = present.into_iter().chain(wanted.iter().copied()).collect();
        numbers.sort_unstable();
        numbers.dedup();
        let inputs: Vec<PathBuf> = numbers.iter().map(|number| input.path(*number)).collect();
        let outputs: Vec<PathBuf> = numbers.iter().map(|number| to.path(*number)).collect();
        outputs.iter().try_for_each(|path| protected::check(path))?;
        let is_wanted: Vec<bool> = numbers.iter().map(|number| wanted.binary_search(number).is_ok()).collect();
        let mut write = is_wanted.clone();
        let mut renewed = Vec::new();
        for at in (0..numbers.len()).filter(|at| is_wanted[*at]) {
            match self.earlier(numbers[at], &inputs[at], &outputs[at], &provenance)? {
                Earlier::None => {}
                Earlier::Outdated(changed) => renewed.push((numbers[at], changed)),
                Earlier::Whole => write[at] = false,
            }
        }
        let skipped = is_wanted.iter().zip(&write).filter(|(wanted, write)| **wanted && !**write).count();
        let pixels = self.pixels(&inputs);
        let kept = plan::kept(pixels);
        let plan = Plan::new(&write, two_way, self.chunk, self.overlap as usize, kept);
        let sequence =
            frames::Sequence { numbers: &numbers, inputs: &inputs, outputs: &outputs, pixels, command: self };
        let mut done = sequence.run(&plan, settings, &provenance, cancel::listen(), output)?;
        if input.is_still()
            && let Some((_, error)) = done.failed.pop()
        {
            return Err(error);
        }
        let failed: Vec<Failed> = done.failed.iter().map(|(frame, error)| Failed::new(*frame, error)).collect();
        failed::tell(&failed);
        if done.at_rest && self.motion == Motion::Auto && done.denoised > 1 {
            output.note(
                "the frames have no motion layer, or it is 0 everywhere: the picture counts as at rest\n  if the camera \
                 or the volume moves, compute the motion with `cumulo motion` and give --motion files:'motion.####.exr'",
            );
        }
        if let Some((frame, apart)) = done.contradiction {
            output.note(format!(
                "the alpha that comes with the motion is not that of the pictures, by {apart:.2} in frame {frame}: that of the pictures \
                 is the guide\n  compute the motion with the density scale and the transfer function that the pictures show (cumulo \
                 motion --tf), else it may follow what they do not show",
            ));
        }
        if done.denoised > 0 {
            batch.commit()?;
        }
        let seconds = provenance.clone().lap();
        let report = Report {
            output: self.output.clone(),
            method: self.method,
            denoised: done.denoised,
            skipped,
            renewed: renewed::by_input(renewed),
            failed,
            cuts: done.cuts,
            filled: done.filled,
            filled_frames: done.filled_frames,
            at_rest: done.at_rest,
            alpha_contradicts: done.contradiction.is_some(),
            estimate: Accuracy::of(done.estimate),
            compared: done.estimate.1,
            seconds,
            seconds_denoising: done.seconds,
            still: input.is_still(),
        };
        output.report(&report)?;
        report.outcome(&self.input)
    }

    /// Returns the pixels of a frame, of all layers and views together; 0 if no header can be read.
    fn pixels(&self, inputs: &[PathBuf]) -> usize {
        let header = inputs.iter().find_map(|input| exr::header(input).ok());
        let layers = self.layers.len().max(1) * if self.alpha { 2 } else { 1 };
        header.map_or(0, |header| header.display_window.pixels() as usize * layers * header.views().len().max(1))
    }

    fn settings(&self) -> Result<Settings> {
        let Self { history, bandwidth, forgetting, spread, likeness, .. } = *self;
        Settings { history, bandwidth, forgetting, spread, likeness }.checked()
    }

    /// Returns what an earlier run has left of a frame.
    ///
    /// # Errors
    /// If a picture that another command made would be replaced, or without `--resume` one that is damaged.
    fn earlier(&self, number: u32, input: &Path, output: &Path, provenance: &Provenance) -> Result<Earlier> {
        let replace = self.overwrite || self.resume && outputs::is_damaged(output);
        let same = outputs::is_own_picture(output, COMMAND, &provenance.command, replace)?;
        if !(self.resume && same) {
            return Ok(Earlier::None);
        }
        Ok(Earlier::of(&[output.to_path_buf()], INPUTS, &self.files_of(number, input)))
    }

    /// Returns the files that a frame is made from: the noisy picture, and what its motion is read from. Those of the frames
    /// around, of which it learns, do not count.
    fn files_of(&self, number: u32, input: &Path) -> Vec<PathBuf> {
        std::iter::once(input.to_path_buf()).chain(self.motion.files(number)).collect()
    }
}

/// Attribute of a denoised picture that holds the command that made it.
const COMMAND: &str = "cumulo:denoise";
/// Attribute of a denoised picture that holds the hashes of what it was made from.
const INPUTS: &str = "cumulo:denoise-input";
