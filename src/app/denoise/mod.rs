//! Noisy pictures, of sequences in time, denoised.

mod frames;
mod held;
mod job;
mod motion;
pub(in crate::app) mod names;
mod plan;
mod reading;
mod shot;
mod view_denoiser;

pub use motion::Motion;

use crate::app::Context;
use crate::app::earlier::{Earlier, Keys, Policy};
use crate::app::failed::Failed;
use crate::app::inputs;
use crate::app::outputs;
use crate::app::provenance::Provenance;
use crate::app::ranges;
use crate::app::renewed::{self, Renewed};
use crate::app::use_case::{Report, Status, use_case};
use crate::denoise::{Estimate, HalvesEstimate, Method, Settings};
use crate::error::{Code, Error, Result};
use crate::formats::atomic::Batch;
use crate::formats::exr;
use crate::formats::limits::Limits;
use crate::formats::protected;
use crate::formats::sequence::Frames;
use crate::report::number::short;
use crate::text::ranges;
use names::Names;
use plan::Plan;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::{Path, PathBuf};

/// Settings of the denoising of a sequence of pictures in time, or of a single picture.
///
/// Colors are compared along the motion of what they show, over the frames before and, with [`Filter::Wrls2`], after; a
/// single picture is denoised by its own pixels alone. All that is not denoised passes through as it is.
///
/// ```
/// use cumulo::prelude::*;
/// # let folder = tempfile::tempdir()?;
/// # let scattering = ScatteringSettings { albedo: Some([0.9; 3]), samples: Some(2), ..ScatteringSettings::default() };
/// # let (input, views, size) = ("fixtures/plume.vdb".into(), Some(1), Some([24, 24]));
/// # let pictures = PictureSettings { input, views, size, scattering, ..PictureSettings::default() };
/// # let frames: Option<Frames> = Some("1-3".parse()?);
/// # let output = folder.path().to_path_buf();
/// # RenderSettings { output, frames, pictures, ..RenderSettings::default() }.run(&Context::default())?;
/// let settings = DenoiseSettings {
///     input: folder.path().join("frame.####.exr"),
///     output: folder.path().join("clean.####.exr"),
///     ..DenoiseSettings::default()
/// };
/// let report = settings.run(&Context::default())?;
/// assert_eq!(report.status()?, Status::Success);
/// assert!(folder.path().join("clean.0003.exr").exists());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct DenoiseSettings {
    /// Pattern of the noisy frames, or one picture.
    #[serde(with = "crate::app::paths")]
    pub input: PathBuf,
    /// Pattern of the denoised frames, numbered as those that go in; of one picture one name.
    #[serde(with = "crate::app::paths")]
    pub output: PathBuf,
    /// Frames to write, learning from those around them; none for all.
    pub frames: Option<Frames>,
    /// Filter.
    pub method: Filter,
    /// Where motion comes from.
    pub motion: Motion,
    /// Layers of color to denoise, in all views; none for the beauty.
    pub layers: Vec<String>,
    /// Guide to the outlines that must stay sharp, for [`Filter::Wrls2`].
    pub guide: Guide,
    /// True to denoise the layers `half_a` and `half_b`, independent halves of the paths, apart from each other, and to
    /// write their mean as the beauty. Its error is known without assumptions on motion and noise then.
    pub halves: bool,
    /// True to denoise the alpha of these layers, too.
    pub alpha: bool,
    /// True to add the layer `confidence`: the number of samples that each pixel rests on.
    pub confidence: bool,
    /// True to add the layers `noise` and `error`, in the units of the colors, for [`Filter::Wrls2`].
    pub error: bool,
    /// Frames that a frame learns from, for [`Filter::Wrls2`].
    pub direction: Direction,
    /// Length in frames of chunks that do not depend on each other; none for one chunk.
    pub chunk: Option<u32>,
    /// Frames before and after a chunk, or after a frame, that are read to learn from.
    pub overlap: u32,
    /// True to skip frames that are there, made by the same settings, unless the picture or its motion has changed
    /// since.
    pub resume: bool,
    /// True to replace pictures that other settings made.
    pub overwrite: bool,
    /// Frames at which another shot begins.
    pub cuts: Cuts,
    /// Parameters of the published filters.
    #[serde(flatten)]
    pub published: Settings,
    /// Memory that the work may take.
    #[serde(flatten)]
    pub limits: Limits,
}

impl Default for DenoiseSettings {
    fn default() -> Self {
        Self {
            input: PathBuf::new(),
            output: PathBuf::new(),
            frames: None,
            method: Filter::default(),
            motion: Motion::Auto,
            layers: Vec::new(),
            halves: false,
            guide: Guide::default(),
            alpha: false,
            confidence: false,
            error: false,
            direction: Direction::default(),
            chunk: None,
            overlap: 12,
            resume: false,
            overwrite: false,
            cuts: Cuts::default(),
            published: Settings::default(),
            limits: Limits::default(),
        }
    }
}

/// Settings on which frames do not depend, or which choose some of them.
const MANNER: [&str; 4] = ["overwrite", "frames", "resume", "max_memory"];

/// Filter against noise.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Filter {
    /// Guided filter in space and time, of the frames before and after.
    #[default]
    Wrls2,
    /// Weighted recursive least squares as published by Iglesias-Guitian et al. 2020.
    Wrls,
    /// Recursive least squares without weights against outliers.
    Rls,
    /// Spatiotemporal variance-guided filtering, Schied et al. 2017.
    Svgf,
    /// Exponential moving average, clamped to the colors around.
    Ema,
}

impl Filter {
    /// Name of the filter in settings, such as `wrls2`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Wrls2 => "wrls2",
            Self::Wrls => "wrls",
            Self::Rls => "rls",
            Self::Svgf => "svgf",
            Self::Ema => "ema",
        }
    }

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

/// Frames that a frame learns from.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Direction {
    /// Frames before and after the frame.
    #[default]
    Both,
    /// Frames before the frame alone, in two thirds of the time.
    Forward,
}

/// Guide to the outlines that must stay sharp.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Guide {
    /// Alpha: of the files of the motion, else of the layer, else of the beauty; it does not count where it is noisy.
    #[default]
    Alpha,
    /// The colors alone.
    None,
}

/// Frames at which another shot begins.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Cuts {
    /// They are found by how much the picture changes.
    #[default]
    Auto,
    /// The sequence is one shot.
    None,
}

/// Report of a denoised sequence.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub struct DenoiseReport {
    /// Frames that went in.
    #[serde(skip)]
    input: PathBuf,
    #[serde(serialize_with = "crate::app::paths::text")]
    output: PathBuf,
    method: Filter,
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
    /// Source of the estimate.
    told_by: ToldBy,
    /// Number of frames that it is estimated from: those that have halves, or frames on both sides.
    frames: usize,
    noise: f64,
    error: f64,
    /// Upper end of the 95 % interval of the error, as far as the estimate errs by chance.
    error_high: f64,
    /// Decibels by which the error is below the noise.
    gain_db: f64,
    /// Error over the root mean square of the denoised colors.
    relative_error: f64,
    /// Error over the scale of the radiance: the mean of the square roots of radiance, weighted by itself, and squared.
    /// Halves tell it.
    #[serde(skip_serializing_if = "Option::is_none")]
    error_by_scale: Option<f64>,
    /// Upper end of its 95 % interval.
    #[serde(skip_serializing_if = "Option::is_none")]
    error_by_scale_high: Option<f64>,
    /// Noise that came in over the scale.
    #[serde(skip_serializing_if = "Option::is_none")]
    noise_by_scale: Option<f64>,
    /// Share of the picture, as far as it is not empty, that is much as it was: it has no noise, or the frames around
    /// do not show it.
    as_it_was: f64,
}

/// Source of the estimate of noise and error.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, schemars::JsonSchema)]
#[serde(rename_all = "lowercase")]
enum ToldBy {
    /// Two independent halves of the paths of each frame: the layers `half_a` and `half_b`.
    Halves,
    /// The frames before and after.
    Frames,
}

impl Accuracy {
    /// Returns what halves tell, where frames have them; `estimate` tells the rest.
    fn of_halves((by_halves, frames): &(HalvesEstimate, usize), estimate: &Estimate) -> Option<Self> {
        let (noise, error, scale) = (by_halves.noise(), by_halves.error(), by_halves.scale());
        let scaled = |error: f64| Some(error / scale).filter(|error| error.is_finite());
        (by_halves.is_known() && error > 0.0).then(|| Self {
            told_by: ToldBy::Halves,
            frames: *frames,
            noise,
            error,
            error_high: by_halves.error_high(),
            gain_db: 20.0 * (noise / error).log10(),
            relative_error: error / by_halves.level().max(f64::MIN_POSITIVE),
            error_by_scale: scaled(error),
            error_by_scale_high: scaled(by_halves.error_high()),
            noise_by_scale: scaled(noise),
            as_it_was: estimate.as_it_was(),
        })
    }

    /// Returns what an estimate tells, unless its frames do not show the same signal.
    fn of((estimate, frames): (Estimate, usize)) -> Option<Self> {
        let (noise, error) = (estimate.noise(), estimate.error());
        let found = Self {
            told_by: ToldBy::Frames,
            frames,
            noise,
            error,
            error_high: estimate.error_high(),
            gain_db: 20.0 * (noise / error).log10(),
            relative_error: error / estimate.level().max(f64::MIN_POSITIVE),
            error_by_scale: None,
            error_by_scale_high: None,
            noise_by_scale: None,
            as_it_was: estimate.as_it_was(),
        };
        estimate.fits().then_some(found)
    }
}

impl fmt::Display for Accuracy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { told_by, frames, noise, error, error_high, gain_db, error_by_scale, as_it_was, .. } = self;
        let [noise, error, error_high] = [*noise, *error, *error_high].map(short);
        let (s, by) = (if *frames == 1 { "" } else { "s" }, if *told_by == ToldBy::Halves { "halves of " } else { "" });
        write!(f, "estimated from {by}{frames} frame{s}: noise {noise} in, error {error} out, {gain_db:.1} dB less ")?;
        write!(f, "(up to {error_high} at 95 % confidence)")?;
        if let Some(scaled) = error_by_scale {
            write!(f, "; {:.2} % of the scale", 100.0 * scaled)?;
        }
        if *as_it_was > 0.01 {
            write!(f, "; {:.0} % of the picture is much as it was", 100.0 * as_it_was)?;
        }
        Ok(())
    }
}

impl DenoiseReport {
    /// Returns the error that is left by the scale, and the upper end of its interval, where halves tell it.
    pub(in crate::app) fn error_by_scale(&self) -> Option<[f64; 2]> {
        let estimate = self.estimate.as_ref()?;
        Some([estimate.error_by_scale?, estimate.error_by_scale_high?])
    }

    /// Returns the noise that came in by the scale, where halves tell it.
    pub(in crate::app) fn noise_by_scale(&self) -> Option<f64> {
        self.estimate.as_ref()?.noise_by_scale
    }

    /// Refuses work of which a frame failed.
    ///
    /// # Errors
    /// If a frame failed; the error lists them.
    pub(crate) fn check(&self) -> Result<()> {
        let [first, ..] = &self.failed[..] else { return Ok(()) };
        let (failed, all) = (self.failed.len(), self.failed.len() + self.denoised);
        let list: Vec<String> = self.failed.iter().map(|failed| failed.frame.to_string()).collect();
        let why = first.error.lines().next().unwrap_or_default();
        Err(Error::invalid(format!("{failed} of {all} frames were not denoised: {} ({why})", list.join(", ")))
            .coded(Code::FramesFailed)
            .at(&self.input)
            .hint("render the frames above again, then repeat the command with ⟨resume⟩"))
    }
}

impl fmt::Display for DenoiseReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { output, method, denoised, skipped, renewed, failed, cuts, filled, filled_frames, .. } = self;
        let Self { estimate, compared, seconds, seconds_denoising, .. } = self;
        let way = method.name();
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

use_case!(DenoiseSettings => DenoiseReport, limits);

impl Report for DenoiseReport {
    /// # Errors
    /// An error that lists the frames that failed; the others are there then.
    fn status(&self) -> Result<Status> {
        self.check().map(|()| Status::Success)
    }
}

/// Frames by number that are made again, each with the input that has changed.
type Changed = Vec<(u32, PathBuf)>;

impl DenoiseSettings {
    /// Paths that the pictures are made from.
    pub fn inputs(&self) -> Vec<&Path> {
        std::iter::once(self.input.as_path()).chain(self.motion.paths()).collect()
    }

    /// Reads, denoises and writes. Frames that fail are part of the report.
    ///
    /// # Errors
    /// If the sequence cannot be begun, or the one picture cannot be read or written.
    pub fn run(&self, context: &Context) -> Result<DenoiseReport> {
        self.run_without(context, |_| false)
    }

    /// Does the same, but learns nothing from frames that `is_foreign` tells to be of another sequence, unless they are
    /// asked for.
    ///
    /// # Errors
    /// As [`Self::run`].
    pub(crate) fn run_without(&self, context: &Context, is_foreign: impl Fn(&Path) -> bool) -> Result<DenoiseReport> {
        let _inputs = inputs::protect(self.inputs(), self.limits);
        ranges::within("chunk", self.chunk, [1, u32::MAX])?;
        let provenance = Provenance::begin(context).of("denoise", self, &MANNER);
        let settings = self.published.checked()?;
        let two_way = self.method.method().looks_ahead() && self.direction == Direction::Both;
        self.check(two_way)?;
        let input = Names::of(&self.input)?;
        let to = input.alike(&self.output, "the noisy frames")?;
        input.check_frames(self.frames.is_some())?;
        let present = input.all_numbers()?;
        let wanted: Vec<u32> = match self.frames {
            Some(frames) => frames.numbers().collect(),
            None => present.clone(),
        };
        let present = without_foreign(present, &wanted, context, |number| is_foreign(&input.path(number)));
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
        let (write, renewed) = self.to_write(&is_wanted, [&inputs, &outputs], &numbers, &provenance)?;
        let skipped = is_wanted.iter().zip(&write).filter(|(wanted, write)| **wanted && !**write).count();
        let pixels = self.pixels(&inputs);
        let plan = Plan::new(&write, two_way, self.chunk, self.overlap as usize, plan::frames_in_memory(pixels));
        let sequence =
            frames::Sequence { numbers: &numbers, inputs: &inputs, outputs: &outputs, pixels, settings: self };
        let mut done = sequence.run(&plan, settings, &provenance, &context.cancel(), context)?;
        if input.is_still()
            && let Some((_, error)) = done.failed.pop()
        {
            return Err(error);
        }
        let failed: Vec<Failed> = done.failed.iter().map(|(frame, error)| Failed::new(*frame, error)).collect();
        context.failed(&failed);
        self.remark(&done, context);
        if done.denoised > 0 {
            batch.commit()?;
        }
        let seconds = provenance.clone().lap();
        Ok(DenoiseReport {
            input: self.input.clone(),
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
            estimate: Accuracy::of_halves(&done.by_halves, &done.estimate.0).or_else(|| Accuracy::of(done.estimate)),
            compared: done.estimate.1,
            seconds,
            seconds_denoising: done.seconds,
            still: input.is_still(),
        })
    }

    /// Refuses settings that contradict each other.
    fn check(&self, two_way: bool) -> Result<()> {
        if self.error && !two_way {
            return Err(Error::invalid("⟨error⟩ needs ⟨method=wrls2⟩ and ⟨direction=both⟩")
                .hint("noise and error are told by the frames before and after; give neither option, or no ⟨error⟩"));
        }
        if self.halves && (self.error || self.confidence || self.alpha || !self.layers.is_empty()) {
            return Err(Error::invalid("⟨halves⟩ denoises the layers half_a and half_b, and no others")
                .hint("leave out ⟨layers⟩, ⟨alpha⟩, ⟨confidence⟩ and ⟨error⟩, or ⟨halves⟩"));
        }
        Ok(())
    }

    /// Tells which of the frames that are wanted are to be written, and those that are there by the input that has
    /// changed since.
    ///
    /// # Errors
    /// If a picture that other settings made would be replaced, or without `resume` one that is damaged.
    fn to_write(
        &self,
        is_wanted: &[bool],
        [inputs, outputs]: [&[PathBuf]; 2],
        numbers: &[u32],
        provenance: &Provenance,
    ) -> Result<(Vec<bool>, Changed)> {
        let policy = Policy { own: provenance, keys: KEYS, overwrite: self.overwrite, resume: self.resume };
        let (mut write, mut renewed) = (is_wanted.to_vec(), Vec::new());
        for at in (0..numbers.len()).filter(|at| is_wanted[*at]) {
            policy.check(&outputs[at])?;
            match policy.left(&outputs[at..=at], &self.files_of(numbers[at], &inputs[at])) {
                Earlier::None => {}
                Earlier::Outdated(changed) => renewed.push((numbers[at], changed)),
                Earlier::Whole => write[at] = false,
            }
        }
        Ok((write, renewed))
    }

    /// Remarks on motion that the frames lack, or that contradicts them.
    fn remark(&self, done: &frames::Done, context: &Context) {
        if done.at_rest && self.motion == Motion::Auto && done.denoised > 1 {
            context.note(
                "the frames have no motion layer, or it is 0 everywhere: the picture counts as at rest\n  if the \
                 camera or the volume moves, compute the motion with `cumulo motion` and give \
                 ⟨motion=files:'motion.####.exr'⟩",
            );
        }
        if let Some((frame, apart)) = done.contradiction {
            context.note(format!(
                "the alpha that comes with the motion is not that of the pictures, by {apart:.2} in frame {frame}: \
                 that of the pictures is the guide\n  compute the motion with the density scale and the transfer \
                 function that the pictures show (⟨motion.tf⟩), else it may follow what they do not show",
            ));
        }
    }

    /// Returns the pixels of a frame, of all layers and views together; 0 if no header can be read.
    fn pixels(&self, inputs: &[PathBuf]) -> usize {
        let header = inputs.iter().find_map(|input| exr::header(input).ok());
        let layers = self.layers.len().max(if self.halves { 2 } else { 1 }) * if self.alpha { 2 } else { 1 };
        header.map_or(0, |header| header.display_window.pixels() as usize * layers * header.views().len().max(1))
    }

    /// Returns the files that a frame is made from: the noisy picture, and what its motion is read from. Those of the
    /// frames around, of which it learns, do not count.
    fn files_of(&self, number: u32, input: &Path) -> Vec<PathBuf> {
        std::iter::once(input.to_path_buf()).chain(self.motion.files(number)).collect()
    }
}

/// Returns the frames that are there but for foreign ones that nobody asked for, and notes these.
fn without_foreign(present: Vec<u32>, wanted: &[u32], context: &Context, is_foreign: impl Fn(u32) -> bool) -> Vec<u32> {
    let is_own = |number: &u32| wanted.binary_search(number).is_ok() || !is_foreign(*number);
    let (own, foreign): (Vec<u32>, Vec<u32>) = present.into_iter().partition(is_own);
    if !foreign.is_empty() {
        let which = ranges(foreign.iter().copied());
        context.note(format!("frames {which} were made by other settings: nothing is learned from them"));
    }
    own
}

/// Attribute of a denoised picture that holds the command that made it.
const COMMAND: &str = "cumulo:denoise";
/// Attributes of a denoised picture that state what it was made by: those of the noisy one stay.
const KEYS: Keys = Keys { settings: "cumulo:denoise-settings", inputs: "cumulo:denoise-input" };
