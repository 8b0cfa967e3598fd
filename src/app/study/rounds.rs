//! The runs of all settings, in rounds of a shuffled order.

use super::candidate::Candidate;
use super::measurement::Measurement;
use super::options::StudyOptions;
use crate::app::context::Stage;
use crate::cancel::Cancel;
use crate::error::Result;
use sha2::{Digest, Sha256};
use std::time::Instant;

/// Rounds that are run even where they take longer than the study may.
const LEAST_ROUNDS: u32 = 1;

/// Runs that each setting is to have where the time allows it.
pub(super) const USUAL_ROUNDS: u32 = 3;

/// Rounds of runs: each setting runs once in each of them.
pub(super) struct Rounds<'r> {
    pub options: &'r StudyOptions,
    pub begun: Instant,
    pub cancel: Cancel,
    pub bar: &'r Stage,
}

impl Rounds<'_> {
    /// Runs the settings, and calls `save` after each round. Returns false if it was stopped before the end.
    ///
    /// # Errors
    /// Those of the work, and of `save`.
    pub(super) fn run(
        &self,
        candidates: &[Candidate<'_>],
        measurements: &mut [Measurement],
        mut save: impl FnMut(&[Measurement]) -> Result<()>,
    ) -> Result<bool> {
        for round in 0..self.options.repeats {
            let over = || round >= LEAST_ROUNDS && self.begun.elapsed().as_secs_f64() > self.options.budget;
            for at in shuffled(candidates, round) {
                if self.cancel.requested() {
                    return Ok(false);
                }
                let measurement = &mut measurements[at];
                if measurement.runs.len() > round as usize {
                    continue;
                }
                if over() {
                    break;
                }
                self.bar.message(&measurement.options);
                let Some(run) = (candidates[at].run)(round, &self.cancel)? else { return Ok(false) };
                measurement.runs.push(run);
                self.bar.inc(1);
            }
            save(measurements)?;
            if over() {
                break;
            }
        }
        Ok(true)
    }
}

/// Returns the order of the settings in a round: shuffled, so that a drift of the machine's speed is no difference of
/// settings, and the same whenever the round is run.
fn shuffled(candidates: &[Candidate<'_>], round: u32) -> Vec<usize> {
    let mut order: Vec<usize> = (0..candidates.len()).collect();
    order.sort_by_cached_key(|at| Sha256::digest(format!("{round} {}", candidates[*at].options)).to_vec());
    order
}
