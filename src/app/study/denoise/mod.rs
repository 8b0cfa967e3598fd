//! Error against time of denoising: filters, directions, overlaps, and sequences of more or fewer samples.

mod frames;
mod knobs;

pub use knobs::DenoiseKnob;

use super::candidate::Candidate;
use super::errors::Errors;
use super::options::StudyOptions;
use super::page::{self, Gallery};
use super::report::StudyReport;
use super::rounds::USUAL_ROUNDS;
use super::run::Run;
use super::session::Session;
use super::words;
use crate::app::Context;
use crate::app::denoise::names::Names;
use crate::app::denoise::{DenoiseSettings, Filter, Motion};
use crate::app::inputs;
use crate::app::use_case::use_case;
use crate::cancel::Cancel;
use crate::error::{Error, Kind, Result};
use crate::formats::limits::Limits;
use crate::formats::sequence::Frames as Range;
use crate::text::shell_quoted;
use frames::{Frames, Truth};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::PathBuf;

/// Settings of a study of denoising.
///
/// Several noisy sequences of the same frames, of more and fewer samples, are compared with one reference.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct DenoiseStudySettings {
    /// Settings that all studies have.
    #[serde(flatten)]
    pub study: StudyOptions,
    /// Patterns of the noisy frames, or single pictures; one at least.
    #[serde(with = "crate::app::paths")]
    pub inputs: Vec<PathBuf>,
    /// Pattern of the frames without noise, numbered as the noisy ones.
    #[serde(with = "crate::app::paths")]
    pub reference: PathBuf,
    /// Settings that are varied; none for all.
    pub knobs: Vec<DenoiseKnob>,
    /// Frames to denoise; none for as many around the middle as the time allows.
    pub frames: Option<Range>,
    /// Where motion comes from.
    pub motion: Motion,
    /// Memory that the work may take.
    #[serde(flatten)]
    pub limits: Limits,
}

impl Default for DenoiseStudySettings {
    fn default() -> Self {
        Self {
            study: StudyOptions::default(),
            inputs: Vec::new(),
            reference: PathBuf::new(),
            knobs: Vec::new(),
            frames: None,
            motion: Motion::Auto,
            limits: Limits::default(),
        }
    }
}

use_case!(DenoiseStudySettings => StudyReport, limits);

/// Frames by which the time of one is found.
const PILOT: usize = 4;
/// Fewest frames that are measured, where as many are there.
const LEAST: usize = 6;
/// Share of the time that the usual rounds of runs are planned to take.
const PLANNED: f64 = 0.6;

/// A noisy sequence by the settings that it is denoised with.
struct Variant {
    /// Number of the sequence.
    input: usize,
    settings: DenoiseSettings,
}

impl DenoiseStudySettings {
    /// Reads, denoises, measures and writes the page.
    ///
    /// # Errors
    /// If frames cannot be read or denoised, the reference has others, or the page cannot be written.
    pub fn run(&self, context: &Context) -> Result<StudyReport> {
        let read = self.inputs.iter().chain([&self.reference]).map(PathBuf::as_path).chain(self.motion.paths());
        let _inputs = inputs::protect(read, self.limits);
        let Some(first) = self.inputs.first() else {
            return Err(Error::invalid("no noisy frames").hint("give the pattern of a sequence: 'noisy.####.exr'"));
        };
        let mut session = Session::begin("denoise", first, &self.study, self, context)?;
        let sequences = self.inputs.iter().map(|input| Names::of(input)).collect::<Result<Vec<_>>>()?;
        let variants = self.variants();
        let (numbers, each) = self.frames(&sequences, variants.len(), &session, context)?;
        let truth = Names::of(&self.reference)?;
        let files = sequences.iter().chain([&truth]).flat_map(|names| numbers.iter().map(|number| names.path(*number)));
        session.provenance.files(files.collect::<Vec<_>>().iter().map(PathBuf::as_path))?;
        session.check_inputs()?;
        let folders = sequences.iter().map(|names| Frames::of(names, &numbers)).collect::<Result<Vec<_>>>()?;
        let truth = {
            let _stage = context.stage("reading the reference");
            Truth::read(&truth, &sequences, &numbers, self.limits)?
        };
        let candidates: Vec<_> = variants.iter().map(|v| self.candidate(v, &folders, &truth, context)).collect();
        let size = truth.films.first().map(|film| [film.width as u32, film.height as u32]);
        let round = each * (numbers.len() * variants.len()) as f64;
        let report = session.measure(&candidates, truth.reference.clone(), size, round)?;
        drop(candidates);
        let gallery = gallery(&report, &variants, &folders, truth, context)?;
        session.finish(report, Some(&gallery))
    }

    fn variants(&self) -> Vec<Variant> {
        let base = DenoiseSettings { motion: self.motion.clone(), limits: self.limits, ..DenoiseSettings::default() };
        let all =
            |input| knobs::variants(&base, &self.knobs).into_iter().map(move |settings| Variant { input, settings });
        (0..self.inputs.len()).flat_map(all).collect()
    }

    /// Returns the numbers of the frames that are measured, with the seconds that denoising takes one of them: those of
    /// an earlier run, those that the settings state, or as many around the middle as the time allows.
    fn frames(
        &self,
        sequences: &[Names],
        variants: usize,
        session: &Session<'_>,
        context: &Context,
    ) -> Result<(Vec<u32>, f64)> {
        let truth = Names::of(&self.reference)?;
        let stated = |number: &u32| self.frames.is_none_or(|frames| frames.numbers().any(|n| n == *number));
        let is_there = |number: &u32| sequences.iter().chain([&truth]).all(|names| names.path(*number).exists());
        sequences[0].check_frames(self.frames.is_some())?;
        let mut numbers = sequences[0].all_numbers()?;
        numbers.retain(|number| stated(number) && is_there(number));
        if let Some(earlier) = &session.earlier {
            let known = &earlier.provenance.inputs;
            numbers.retain(|number| known.contains_key(&sequences[0].path(*number).display().to_string()));
        }
        if numbers.is_empty() {
            return Err(Error::invalid("no frame is there in the noisy sequences and in the reference")
                .at(&self.reference)
                .hint("give sequences whose frames have the same numbers"));
        }
        if session.is_complete() {
            return Ok((numbers, 0.0));
        }
        let _stage = context.stage("timing some frames");
        let pilot = middle(&numbers, PILOT);
        let base = DenoiseSettings { motion: self.motion.clone(), limits: self.limits, ..DenoiseSettings::default() };
        let (_, seconds) = Frames::of(&sequences[0], pilot)?.denoise(&base, context)?;
        let each = seconds / pilot.len() as f64;
        if self.frames.is_some() || session.earlier.is_some() {
            return Ok((numbers, each));
        }
        let most = PLANNED * self.study.budget / (f64::from(USUAL_ROUNDS) * variants as f64 * each);
        Ok((middle(&numbers, (most as usize).max(LEAST)).to_vec(), each))
    }

    /// Returns a variant as a candidate.
    fn candidate<'w>(
        &self,
        variant: &'w Variant,
        folders: &'w [Frames],
        truth: &'w Truth,
        context: &'w Context,
    ) -> Candidate<'w> {
        let Variant { input, settings } = variant;
        let run = move |_: u32, _: &Cancel| match folders[*input].denoise(settings, context) {
            Ok((films, seconds)) => {
                Ok(Some(Run { seconds, errors: Errors::of_films(&films, &truth.films, truth.scale) }))
            }
            Err(error) if error.kind() == Kind::Cancelled => Ok(None),
            Err(error) => Err(error),
        };
        let path = self.inputs[*input].to_string_lossy();
        let name = shell_quoted(&path).into_owned();
        let several = self.inputs.len() > 1;
        let mut own = vec![words::option("method", &json!(settings.method)).unwrap_or_default()];
        if settings.method == Filter::Wrls2 {
            own.extend(words::option("direction", &json!(settings.direction)));
            own.extend(words::option("overlap", &json!(settings.overlap)));
        }
        let still = Names::of(&self.inputs[*input]).is_ok_and(|names| names.is_still());
        let output = if still { "denoised.exr" } else { "denoised.####.exr" };
        let mut command = vec!["cumulo denoise".to_owned(), name.clone()];
        command.extend(words::stated(settings, &DenoiseSettings::default(), &[]));
        command.extend(words::option("output", &json!(output)));
        let options = several.then_some(name).into_iter().chain(own).collect::<Vec<_>>().join(" ");
        let method = settings.method.name();
        Candidate {
            options,
            group: if several { format!("{path}, {method}") } else { method.to_owned() },
            command: command.join(" "),
            random: false,
            run: Box::new(run),
        }
    }
}

/// Returns `count` numbers around the middle, or all of them.
fn middle(numbers: &[u32], count: usize) -> &[u32] {
    let count = count.min(numbers.len());
    &numbers[(numbers.len() - count) / 2..][..count]
}

/// Denoises the middle frame again for the pictures that the page shows; fewer of them if it was stopped.
fn gallery(
    report: &StudyReport,
    variants: &[Variant],
    folders: &[Frames],
    mut truth: Truth,
    context: &Context,
) -> Result<Gallery> {
    let at = truth.films.len() / 2;
    let mut films = Vec::new();
    for number in page::pictured(report).into_iter().filter(|_| report.complete) {
        let Variant { input, settings } = &variants[number];
        match folders[*input].denoise(settings, context) {
            Ok((mut all, _)) => films.push((number, all.swap_remove(at))),
            Err(error) if error.kind() == Kind::Cancelled => break,
            Err(error) => return Err(error),
        }
    }
    Ok(Gallery { reference: truth.films.swap_remove(at), films })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_lie_around_the_middle() {
        assert_eq!((middle(&[1, 2, 3, 4, 5], 3), middle(&[1, 2], 7)), (&[2, 3, 4][..], &[1, 2][..]));
    }
}
