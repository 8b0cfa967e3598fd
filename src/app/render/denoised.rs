//! Pictures that are rendered and denoised in one go, with the error that is left.
//!
//! Paths are rendered in two independent halves, which are denoised apart from each other: so the error of their mean
//! is known without a reference ([`HalvesEstimate`](crate::denoise::HalvesEstimate)). For a wanted error the number of
//! paths is fixed before the pictures begin, by two sequences of few paths that are thrown away.

use super::target::Target;
use super::{AccuracySettings, FramesReport, RenderSettings, ViewsReport};
use crate::app::Context;
use crate::app::denoise::{DenoiseReport, DenoiseSettings};
use crate::app::earlier::{self, Keys, Policy};
use crate::app::provenance::SETTINGS;
use crate::app::use_case::{Report, Status};
use crate::error::{Error, Result};
use crate::formats::atomic;
use crate::formats::exr;
use crate::formats::png;
use crate::formats::protected;
use crate::formats::registry::EXR;
use crate::formats::sequence::{Frames, Pattern};
use crate::formats::temporary::TemporaryFolder;
use crate::formats::transforms::FILE_NAME;
use crate::render::film::Aov;
use serde::Serialize;
use std::fmt;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Report of pictures that were rendered and denoised.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub struct DenoisedReport {
    /// Noisy picture of one view.
    #[serde(skip_serializing_if = "Option::is_none")]
    noisy_view: Option<ViewsReport>,
    /// Noisy frames of a sequence.
    #[serde(skip_serializing_if = "Option::is_none")]
    noisy_frames: Option<FramesReport>,
    denoised: DenoiseReport,
    /// How the number of paths was chosen, if an error was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    goal: Option<Goal>,
    seconds: f64,
}

/// A wanted error after denoising, and the paths that it takes.
#[derive(Debug, Clone, Serialize, schemars::JsonSchema)]
struct Goal {
    /// Root mean square error over all pixels and channels, by the scale of the pictures.
    target_error: f64,
    /// Errors of the pilots.
    pilots: Vec<Pilot>,
    /// Paths of a pixel that were chosen.
    samples: u32,
    /// Seconds that the pilots took.
    pilot_seconds: f64,
    /// Error that was reached; null where it is not known, since all frames were there.
    error: Option<f64>,
    /// True if the error that was reached is at most the wanted one.
    reached: bool,
}

/// Error of a sequence of few paths, denoised.
#[derive(Debug, Clone, Copy, Serialize, schemars::JsonSchema)]
struct Pilot {
    samples: u32,
    /// Error after denoising, by the scale, and the upper end of its 95 % interval.
    error: f64,
    error_high: f64,
    /// Noise of the pictures that were not denoised, by the scale.
    noise: f64,
}

/// Paths of a pixel of the two pilots.
const PILOTS: [u32; 2] = [2, 8];
/// Seed of the random numbers of pilots, added to that of the pictures.
const PILOT_SEED: u64 = 0x9E37_79B9_7F4A_7C15;
/// Frames of a pilot: as many as a frame learns most from.
const PILOT_FRAMES: usize = 12;
/// Exponents of the number of paths by which the error after denoising falls: 1.5 dB a doubling, and that of noise.
const EXPONENTS: [f64; 2] = [0.25, 0.5];
/// Error that is foreseen as a multiple of its estimate at most, however uncertain this is.
const UNCERTAIN: f64 = 1.25;
/// Most paths of a pixel.
const MOST: f64 = 65_536.0;

impl Pilot {
    /// Returns the paths of a pixel that this error takes, as pilots of ascending paths foresee it: an even number.
    fn samples(pilots: &[Self], target: f64) -> u32 {
        let ([first, .., last] | [first @ last]) = pilots else { return PILOTS[1] };
        let foreseen = last.error_high.min(UNCERTAIN * last.error);
        let [few, many] = [first, last].map(|pilot| f64::from(pilot.samples));
        let fall = (first.error / last.error).ln() / (many / few).ln();
        let exponent = if fall.is_finite() { fall.clamp(EXPONENTS[0], EXPONENTS[1]) } else { EXPONENTS[0] };
        // Denoising leaves no more than the noise.
        let [denoised, plain] = [(foreseen, exponent), (last.noise, 0.5)]
            .map(|(error, exponent)| many * (error / target).powf(exponent.recip()));
        let samples = denoised.min(plain).clamp(2.0, MOST);
        // Rounding makes no more of them.
        2 * (0.5 * samples - 1e-6).ceil() as u32
    }
}

/// Where noisy pictures lie that are denoised.
struct Places {
    /// Folder, or file of one picture.
    noisy: PathBuf,
    /// Names of the noisy and of the denoised pictures.
    names: [PathBuf; 2],
    /// Captures of the noisy and of the denoised pictures.
    captures: Option<[PathBuf; 2]>,
}

/// Names of the frames in a folder.
const FRAMES: &str = "frame.####.exr";

impl Places {
    /// Returns the places of pictures at an output, a folder for a sequence.
    fn of(output: &Path, is_sequence: bool) -> Result<Self> {
        match Target::of(output)? {
            Target::File(path) if !EXR.has_name(path) => {
                Err(Error::invalid("denoised pictures are written as OpenEXR")
                    .at(path)
                    .hint("give a name that ends in .exr, and ⟨png⟩ for a PNG beside it"))
            }
            Target::File(path) => {
                let noisy = path.with_extension("noisy.exr");
                Ok(Self { names: [noisy.clone(), path.to_owned()], noisy, captures: None })
            }
            Target::Folder(folder) if is_sequence => {
                let noisy = folder.join("noisy");
                let both = |name: &str| [noisy.join(name), folder.join(name)];
                Ok(Self { names: both(FRAMES), captures: Some(both(FILE_NAME)), noisy })
            }
            Target::Folder(folder) => Err(Error::invalid("one view is denoised to one picture")
                .at(folder)
                .hint("give the name of a picture that ends in .exr, or ⟨frames⟩ to render a sequence")),
        }
    }
}

impl RenderSettings {
    /// Renders pictures in halves, and denoises them.
    ///
    /// # Errors
    /// Those of rendering and denoising.
    pub(super) fn run_denoised(&self, context: &Context) -> Result<DenoisedReport> {
        let begun = Instant::now();
        self.check_denoised()?;
        let places = Places::of(&self.output, self.is_sequence())?;
        let mut goal = self.accuracy.target_error.map(|error| self.goal(error, &places, context)).transpose()?;
        let samples = goal.as_ref().map(|goal| goal.samples).or(self.pictures.scattering.samples);
        let noisy = self.noisy(&places.noisy, samples);
        self.refuse_overwrite(&noisy, &places, context)?;
        let target = Target::of(&places.noisy)?;
        let (noisy_view, noisy_frames) = match self.is_sequence() {
            true => (None, Some(noisy.run_frames(target, begun, context)?)),
            false => (Some(noisy.run_views(target, begun, context)?), None),
        };
        let denoised = self.denoised(&places, context)?;
        if let Some([from, to]) = places.captures.as_ref().filter(|[from, _]| from.exists()) {
            // Runs of other frames add to the capture of the noisy ones: the last copy has all of them.
            let _lock = to.parent().map(atomic::lock_folder);
            let text = std::fs::read(from).map_err(|e| Error::io(from, e))?;
            atomic::write_bytes(to, &text)?;
        }
        self.pngs(&places)?.iter().try_for_each(|(picture, png)| self.write_png(picture, png))?;
        if let Some(goal) = &mut goal {
            goal.error = denoised.error_by_scale().map(|[error, _]| error);
            goal.reached = goal.error.is_none_or(|error| error <= goal.target_error);
        }
        Ok(DenoisedReport { noisy_view, noisy_frames, denoised, goal, seconds: begun.elapsed().as_secs_f64() })
    }

    /// Refuses settings that denoised pictures do not have.
    fn check_denoised(&self) -> Result<()> {
        let AccuracySettings { time, replicates, confidence, .. } = self.accuracy;
        if time.is_some() || replicates.is_some() || confidence != AccuracySettings::default().confidence {
            return Err(Error::invalid("⟨denoise⟩ goes with a number of ⟨samples⟩ or a ⟨target_error⟩ alone").hint(
                "leave out ⟨time⟩, ⟨replicates⟩ and ⟨confidence⟩, or denoise the pictures with `cumulo denoise`",
            ));
        }
        if !self.compression.is_lossless() {
            return Err(Error::invalid(
                "⟨compression⟩: halves and motions that are denoised by need all of their digits",
            )
            .hint("leave it out: denoised pictures are written without loss"));
        }
        if self.pictures.scattering.samples == Some(1) {
            return Err(Error::invalid("⟨denoise⟩: ⟨samples=1⟩ has no two halves").hint("give ⟨samples=2⟩ or more"));
        }
        if !self.is_sequence() && self.pictures.views.is_some_and(|views| views > 1) && self.pictures.view.is_empty() {
            return Err(Error::invalid("⟨denoise⟩: views from all around are no sequence in time")
                .hint("render frames along the cameras with ⟨cameras⟩ and ⟨frames⟩, or one view"));
        }
        Ok(())
    }

    /// Returns the settings of the noisy pictures.
    fn noisy(&self, output: &Path, samples: Option<u32>) -> Self {
        let mut noisy = Self { output: output.into(), denoise: false, png: false, exposure: None, ..self.clone() };
        noisy.accuracy = AccuracySettings::default();
        noisy.pictures.scattering.samples = samples;
        let motion = self.is_sequence().then_some(Aov::Motion);
        noisy.aov.extend(std::iter::once(Aov::Halves).chain(motion).filter(|aov| !self.aov.contains(aov)));
        noisy
    }

    /// Returns the settings of the denoiser.
    fn denoiser(&self, [input, output]: &[PathBuf; 2], frames: Option<Frames>) -> DenoiseSettings {
        let Self { resume, overwrite, .. } = *self;
        let [input, output] = [input.clone(), output.clone()];
        let limits = self.pictures.limits;
        DenoiseSettings { input, output, frames, halves: true, resume, overwrite, limits, ..DenoiseSettings::default() }
    }

    /// Denoises the noisy pictures. Those of other settings that an earlier run has left beside them are no frames of
    /// the sequence.
    fn denoised(&self, places: &Places, context: &Context) -> Result<DenoiseReport> {
        let settings = |picture: &Path| earlier::attributes(picture).remove(SETTINGS);
        let first = self.frame_numbers()?.and_then(|numbers| numbers.first().copied());
        let own = first.zip(Pattern::parse(&places.names[0])).and_then(|(first, noisy)| settings(&noisy.path(first)));
        let is_foreign = |picture: &Path| settings(picture).is_some_and(|found| Some(found) != own);
        self.denoiser(&places.names, self.frames).run_without(context, is_foreign)
    }

    /// Chooses the number of paths for a wanted error by pilots, and says what it is expected to take.
    fn goal(&self, target_error: f64, places: &Places, context: &Context) -> Result<Goal> {
        let begun = Instant::now();
        let stage = context.steps(PILOTS.len() as u64, "pilot");
        // Where the pictures go, as far as it is there.
        let folder = places.noisy.ancestors().skip(1).find(|folder| folder.is_dir()).unwrap_or(Path::new("."));
        let (frames, count) = self.pilot_frames()?;
        let mut pilots = Vec::new();
        let mut rate = 0.0;
        for samples in PILOTS {
            let temporary = TemporaryFolder::new(folder)?;
            let is_sequence = self.is_sequence();
            let output = if is_sequence { temporary.path().to_owned() } else { temporary.path().join("still.exr") };
            let at = Places::of(&output, is_sequence)?;
            let mut noisy = self.noisy(&at.noisy, Some(samples));
            (noisy.frames, noisy.resume) = (frames, false);
            let seed = &mut noisy.pictures.scattering.seed;
            *seed = Some(seed.unwrap_or(0) ^ PILOT_SEED);
            let rendering = Instant::now();
            noisy.run(&context.silent())?;
            let pictures = frames.map_or(1, |frames| frames.numbers().count());
            rate = rendering.elapsed().as_secs_f64() / (pictures as f64 * f64::from(samples));
            let mut denoiser = self.denoiser(&at.names, frames);
            denoiser.resume = false;
            let report = denoiser.run(&context.silent())?;
            report.check()?;
            let known = report.error_by_scale().zip(report.noise_by_scale());
            pilots.extend(known.map(|([error, error_high], noise)| Pilot { samples, error, error_high, noise }));
            stage.inc(1);
        }
        let samples = Pilot::samples(&pilots, target_error);
        let (percent, seconds) = (100.0 * target_error, rate * count as f64 * f64::from(samples));
        context.note(format!(
            "an error of {percent:.3} % after denoising is expected to take {samples} paths a pixel, {seconds:.1} s"
        ));
        let pilot_seconds = begun.elapsed().as_secs_f64();
        Ok(Goal { target_error, pilots, samples, pilot_seconds, error: None, reached: false })
    }

    /// Returns the numbers of the frames of a sequence; `None` for one view.
    fn frame_numbers(&self) -> Result<Option<Vec<u32>>> {
        Ok(match (self.frames, Pattern::parse(&self.pictures.input)) {
            (Some(frames), _) => Some(frames.numbers().collect()),
            (None, Some(pattern)) => Some(pattern.numbers()?),
            (None, None) => None,
        })
    }

    /// Returns the frames of pilots, in the middle of a sequence, and the number of all frames.
    fn pilot_frames(&self) -> Result<(Option<Frames>, usize)> {
        let Some(numbers) = self.frame_numbers()? else { return Ok((None, 1)) };
        let length = numbers.len().min(PILOT_FRAMES);
        let middle = &numbers[(numbers.len() - length) / 2..][..length];
        let step = self.frames.map_or(1, |frames| frames.step);
        let frames = middle.first().zip(middle.last()).map(|(first, last)| Frames { first: *first, last: *last, step });
        Ok((frames, numbers.len()))
    }

    /// Makes sure that the capture and the PNGs beside denoised pictures, which the denoiser does not write, replace
    /// neither inputs nor files that other settings made.
    fn refuse_overwrite(&self, noisy: &Self, places: &Places, context: &Context) -> Result<()> {
        let own = noisy.provenance(context);
        let Self { overwrite, resume, .. } = *self;
        if let Some([_, json]) = &places.captures {
            protected::check(json)?;
            if !overwrite {
                earlier::spare_captures(json, &[], &own)?;
            }
        }
        let policy = Policy { own: &own, keys: Keys::RENDERED, overwrite, resume };
        self.pngs(places)?.iter().try_for_each(|(_, png)| {
            protected::check(png)?;
            policy.check(png)
        })
    }

    /// Returns the denoised pictures with the PNGs beside them; none unless PNGs are asked for.
    fn pngs(&self, places: &Places) -> Result<Vec<(PathBuf, PathBuf)>> {
        let names = &places.names[1];
        let pictures = match (self.png, Pattern::parse(names), self.frame_numbers()?) {
            (false, ..) => Vec::new(),
            (true, Some(pattern), Some(numbers)) => numbers.into_iter().map(|number| pattern.path(number)).collect(),
            _ => vec![names.clone()],
        };
        let beside = |picture: PathBuf| {
            let png = picture.with_extension("png");
            (picture, png)
        };
        Ok(pictures.into_iter().map(beside).collect())
    }

    /// Writes the PNG of a denoised picture; one that failed has none.
    fn write_png(&self, picture: &Path, png: &Path) -> Result<()> {
        if !picture.exists() {
            return Ok(());
        }
        let film = exr::read_film_within(picture, None, self.pictures.limits)?;
        png::write_film(png, &film, self.tone_mapping(), &exr::header(picture)?.attributes())
    }
}

impl DenoisedReport {
    /// Tells whether all frames are there.
    ///
    /// # Errors
    /// If frames were not denoised.
    pub(super) fn status(&self) -> Result<Status> {
        self.denoised.status()?;
        Ok(Status::complete(self.noisy_frames.as_ref().is_none_or(FramesReport::complete)))
    }
}

impl fmt::Display for DenoisedReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.noisy_view.iter().try_for_each(|views| writeln!(f, "{views}"))?;
        self.noisy_frames.iter().try_for_each(|frames| writeln!(f, "{frames}"))?;
        write!(f, "{}", self.denoised)?;
        let Some(Goal { target_error, samples, error: Some(error), reached, .. }) = &self.goal else { return Ok(()) };
        let [error, target] = [error, target_error].map(|error| 100.0 * error);
        let not = if *reached { "" } else { ": above" };
        write!(f, "\n  error {error:.3} % of the scale with {samples} paths a pixel{not}; {target:.3} % was wanted")
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    #[test]
    fn paths_follow_from_how_the_error_falls() {
        let pilot = |samples, error| Pilot { samples, error, error_high: 1.1 * error, noise: 10.0 * error };
        // 2 dB a doubling, which is an exponent of a third.
        let third = [pilot(2, 0.02), pilot(8, 0.02 * 4.0_f64.powf(-1.0 / 3.0))];
        let error = 1.1 * third[1].error;
        assert_eq!(Pilot::samples(&third, error), 8);
        assert_eq!(Pilot::samples(&third, error / 2.0), 64);
        assert_eq!(Pilot::samples(&third, 1.0), 2);
        // Errors that chance makes rise are taken to fall slowly, and never to take more than without denoising.
        let rising = [pilot(2, 0.01), pilot(8, 0.02)];
        assert_eq!(Pilot::samples(&rising, 0.011), 8 * 16);
        let noisy = [pilot(8, 0.02)].map(|pilot| Pilot { noise: 0.022, ..pilot });
        assert_eq!(Pilot::samples(&noisy, 0.011), 32);
        assert_eq!(Pilot::samples(&third, 1e-9), 65_536);
        assert_eq!(Pilot::samples(&[], 0.01), 8);
    }
}
