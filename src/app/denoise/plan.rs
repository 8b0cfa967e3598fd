//! The order in which frames are read, denoised and written.

use crate::denoise::Ahead;
use std::ops::Range;

/// Step of the work on a sequence.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Step {
    /// A piece of work begins that depends on no earlier one.
    Begin,
    /// The frames after the next ones come, the last one first.
    Backward,
    /// Look at the frame from those after it; keep what they show of it if it will be denoised.
    Look { frame: usize, keep: bool },
    /// Denoise the frame, by those before it and what was kept of those after it; write it if it is wanted. With
    /// `again`, it is denoised once more later.
    Denoise { frame: usize, write: bool, again: bool },
    /// Begin again at the first frame, with what was learned of the noise.
    Rewind,
}

/// Frame to be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Read {
    pub frame: usize,
    /// False where the frame is looked at from those after it.
    pub forward: bool,
    pub write: bool,
    /// True if it is read once more later.
    pub again: bool,
}

/// Steps of a sequence.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Plan {
    pub steps: Vec<Step>,
}

/// Frames at the beginning of a sequence that are denoised twice: those behind the first one tell its noise.
const REHEARSED: usize = 6;

/// Bytes that what is kept of the backward direction may take.
const KEPT_BYTES: usize = 320 << 20;

/// Returns how many frames of so many pixels, of all layers together, are looked at backwards before they are denoised:
/// more take more memory and less time.
pub(crate) fn frames_in_memory(pixels: usize) -> usize {
    (KEPT_BYTES / Ahead::PIXEL_BYTES / pixels.max(1)).clamp(4, 32)
}

impl Plan {
    /// Plans the frames, of which those with `write` are wanted. Runs of wanted frames, cut into chunks of `chunk` if
    /// that is given, are denoised on their own, after `overlap` frames that come before. With `two_way`, frames are
    /// looked at backwards first, `kept` of them at a time, from `overlap` frames behind, and the first ones are
    /// denoised twice where none come before.
    pub(super) fn new(write: &[bool], two_way: bool, chunk: Option<u32>, overlap: usize, kept: usize) -> Self {
        let mut steps = Vec::new();
        for run in runs(write, chunk) {
            steps.push(Step::Begin);
            let mut from = run.start.saturating_sub(overlap);
            while from < run.end {
                // Frames that are only learned from are denoised as the others are, and so kept, too.
                let end = (from + kept).max(run.start + 1).min(run.end);
                if two_way {
                    steps.push(Step::Backward);
                    let last = (end + overlap).min(write.len());
                    let rehearsed = if from == run.start { (from + REHEARSED.min(kept)).min(last) } else { from };
                    let kept = end.max(rehearsed);
                    steps.extend((from..last).rev().map(|frame| Step::Look { frame, keep: frame < kept }));
                    if rehearsed > from + 1 {
                        let again = |frame| Step::Denoise { frame, write: false, again: true };
                        steps.extend((from..rehearsed).map(again));
                        steps.push(Step::Rewind);
                    }
                }
                let once = |frame| Step::Denoise { frame, write: frame >= run.start, again: false };
                steps.extend((from..end).map(once));
                from = end;
            }
        }
        Self { steps }
    }

    /// Returns the frames in the order in which they are read.
    pub(crate) fn reads(&self) -> impl Iterator<Item = Read> {
        self.steps.iter().filter_map(|step| match *step {
            Step::Look { frame, .. } => Some(Read { frame, forward: false, write: false, again: true }),
            Step::Denoise { frame, write, again } => Some(Read { frame, forward: true, write, again }),
            Step::Begin | Step::Backward | Step::Rewind => None,
        })
    }
}

/// Returns the runs of wanted frames, cut into chunks that begin at multiples of their length.
fn runs(write: &[bool], chunk: Option<u32>) -> Vec<Range<usize>> {
    let mut runs: Vec<Range<usize>> = Vec::new();
    for frame in (0..write.len()).filter(|frame| write[*frame]) {
        let cut = chunk.is_some_and(|chunk| frame.is_multiple_of(chunk as usize));
        match runs.last_mut() {
            Some(run) if run.end == frame && !cut => run.end += 1,
            _ => runs.push(frame..frame + 1),
        }
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_end_at_gaps_and_chunks() {
        assert_eq!(runs(&[true, true, false, true, true, true], None), [0..2, 3..6]);
        assert_eq!(runs(&[true; 5], Some(2)), [0..2, 2..4, 4..5]);
        assert!(runs(&[false; 3], None).is_empty());
    }

    #[test]
    fn frames_around_are_read_and_only_wanted_ones_written() {
        let plan = Plan::new(&[false, false, true, true, false, false], true, None, 1, 8);
        use Step::*;
        let steps = [
            Begin,
            Backward,
            Look { frame: 4, keep: false },
            Look { frame: 3, keep: true },
            Look { frame: 2, keep: true },
            Look { frame: 1, keep: true },
            Denoise { frame: 1, write: false, again: false },
            Denoise { frame: 2, write: true, again: false },
            Denoise { frame: 3, write: true, again: false },
        ];
        assert_eq!(plan.steps, steps);
        let first = Plan::new(&[true, false, false], true, None, 16, 8);
        let steps = [
            Begin,
            Backward,
            Look { frame: 2, keep: true },
            Look { frame: 1, keep: true },
            Look { frame: 0, keep: true },
            Denoise { frame: 0, write: false, again: true },
            Denoise { frame: 1, write: false, again: true },
            Denoise { frame: 2, write: false, again: true },
            Rewind,
            Denoise { frame: 0, write: true, again: false },
        ];
        assert_eq!(first.steps, steps);
        let one_way = Plan::new(&[true; 3], false, None, 16, 8);
        let reads = [0, 1, 2].map(|frame| Read { frame, forward: true, write: true, again: false });
        assert_eq!(one_way.reads().collect::<Vec<_>>(), reads);
    }
}
