//! A study from its beginning to its page.

use super::candidate::Candidate;
use super::measurement::Measurement;
use super::options::{MANNER, StudyOptions};
use super::page::{self, Gallery};
use super::recommendation::Recommendation;
use super::reference::Reference;
use super::report::StudyReport;
use super::rounds::{Rounds, USUAL_ROUNDS};
use super::{folder, front, table};
use crate::app::Context;
use crate::app::provenance::Provenance;
use crate::error::{Code, Error, Result};
use crate::formats::atomic;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// A study that has begun.
pub(super) struct Session<'s> {
    study: &'static str,
    input: &'s Path,
    options: &'s StudyOptions,
    context: &'s Context,
    /// Provenance of the study, to which inputs are added.
    pub provenance: Provenance,
    /// Record of an earlier run that this one goes on from.
    pub earlier: Option<StudyReport>,
    begun: Instant,
}

impl<'s> Session<'s> {
    /// Begins a study of `settings`, which are known by their hash.
    ///
    /// # Errors
    /// If options are out of their ranges, or those of [`folder::open`].
    pub(super) fn begin(
        study: &'static str,
        input: &'s Path,
        options: &'s StudyOptions,
        settings: &impl Serialize,
        context: &'s Context,
    ) -> Result<Self> {
        options.check()?;
        let provenance = Provenance::begin(context).of(&format!("study {study}"), settings, &MANNER);
        let earlier = folder::open(options, &provenance)?;
        Ok(Self { study, input, options, context, provenance, earlier, begun: Instant::now() })
    }

    /// Makes sure that the inputs, once they are known, are those of the record that this study goes on from.
    ///
    /// # Errors
    /// If one has changed; the error names it.
    pub(super) fn check_inputs(&self) -> Result<()> {
        match &self.earlier {
            Some(earlier) if earlier.provenance.inputs != self.provenance.inputs => {
                Err(Error::invalid("⟨resume⟩: the inputs have changed since the study that lies here")
                    .coded(Code::OutputExists)
                    .at(self.options.output.join(folder::RECORD))
                    .hint("run the study without ⟨resume⟩"))
            }
            _ => Ok(()),
        }
    }

    /// True if an earlier run has measured all.
    pub(super) fn is_complete(&self) -> bool {
        self.earlier.as_ref().is_some_and(|earlier| earlier.complete)
    }

    /// Returns the path of the picture of a view of the reference.
    pub(super) fn reference(&self, view: usize) -> PathBuf {
        folder::reference(&self.options.output, view)
    }

    /// Measures what is missing. `size` is that of the first picture, and `round` the seconds of a round of runs as far
    /// as they are known. A study that is stopped returns what was measured by then.
    ///
    /// # Errors
    /// Those of the work, and an error if the record cannot be written.
    pub(super) fn measure(
        &self,
        candidates: &[Candidate<'_>],
        reference: Reference,
        size: Option<[u32; 2]>,
        round: f64,
    ) -> Result<StudyReport> {
        let earlier = self.earlier.as_ref();
        let before = earlier.map_or(&[][..], |earlier| &earlier.measurements);
        let mut measurements: Vec<_> = candidates.iter().map(|c| Measurement::new(c, before)).collect();
        let mut report = StudyReport {
            study: self.study.to_owned(),
            input: self.input.to_path_buf(),
            page: self.options.output.join(crate::report::FILE_NAME),
            complete: self.is_complete(),
            size,
            reference,
            recommended: Recommendation::of_error(self.options.wanted_error, &[]),
            recommendations: Vec::new(),
            measurements: measurements.clone(),
            seconds: 0.0,
            provenance: self.provenance.clone(),
        };
        if !report.complete {
            let lacks = |m: &Measurement| u64::from(self.options.repeats.saturating_sub(m.runs.len() as u32));
            let missing = measurements.iter().map(lacks).sum();
            self.tell(&measurements, missing, round);
            self.context.work_begins();
            let bar = self.context.steps(missing, "measuring");
            let (options, cancel) = (self.options, self.context.cancel());
            let rounds = Rounds { options, begun: self.begun, cancel, bar: &bar };
            report.complete = rounds.run(candidates, &mut measurements, |measured| {
                // A study that is killed goes on from here.
                let report = StudyReport { measurements: measured.to_vec(), complete: false, ..report.clone() };
                folder::save(&self.options.output, &report)
            })?;
        }
        measurements.iter_mut().for_each(|m| m.summarise(&report.reference));
        front::mark(&mut measurements);
        report.measurements = measurements;
        report.seconds = earlier.map_or(0.0, |earlier| earlier.seconds) + self.begun.elapsed().as_secs_f64();
        self.recommend(&mut report);
        Ok(report)
    }

    /// Says how long the runs that are missing take.
    fn tell(&self, measurements: &[Measurement], missing: u64, round: f64) {
        let (count, repeats) = (measurements.len(), self.options.repeats);
        let share = missing as f64 / (count as f64 * f64::from(repeats)).max(1.0);
        let most = share * f64::from(repeats) * round;
        let left = (self.options.budget - self.begun.elapsed().as_secs_f64()).max(share.min(1.0) * round);
        let least = repeats.min(USUAL_ROUNDS);
        let runs = if least < repeats { format!("{least} to {repeats}") } else { repeats.to_string() };
        self.context.note(format!(
            "{count} settings, {runs} runs each, {missing} of them to measure: about {:.0} s{}",
            most.min(left).ceil(),
            if most > left { ", where ⟨budget⟩ ends the runs" } else { "" },
        ));
    }

    fn recommend(&self, report: &mut StudyReport) {
        let all = &report.measurements;
        report.recommended = match self.options.wanted_seconds {
            Some(seconds) => Recommendation::of_seconds(seconds, all),
            None => Recommendation::of_error(self.options.wanted_error, all),
        };
        let errors = [1e-1, 1e-2, 1e-3, 1e-4].map(|error| Recommendation::of_error(error, all));
        let front = front::of(all);
        let [first, last] = [front.first(), front.last()].map(|m| m.and_then(|m| m.seconds).unwrap_or(1.0).log10());
        let times = (first.ceil() as i32..=last.ceil() as i32).map(|p| 10_f64.powi(p));
        report.recommendations = errors.into_iter().chain(times.map(|t| Recommendation::of_seconds(t, all))).collect();
    }

    /// Writes the page, the table and the record.
    ///
    /// # Errors
    /// If one of them cannot be made or written.
    pub(super) fn finish(mut self, mut report: StudyReport, gallery: Option<&Gallery>) -> Result<StudyReport> {
        self.provenance.lap();
        report.provenance = self.provenance;
        let dir = &self.options.output;
        page::of(&report, gallery)?.write(dir)?;
        atomic::write_bytes(&dir.join(folder::TABLE), table::csv(&report.measurements).as_bytes())?;
        folder::save(dir, &report)?;
        if !report.complete {
            self.context.note("stopped; what was measured by then is written, and ⟨resume⟩ goes on from it");
        }
        Ok(report)
    }
}
