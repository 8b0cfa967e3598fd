//! The order in which frames are read, denoised and written.

use std::ops::Range;

/// Step of the work on a sequence.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// A piece of work begins that depends on no earlier one.
    Begin,
    /// The frames after the next ones come, the last one first.
    Backward,
    /// Denoise the frame by those after it; keep the result if it will be written.
    Look { frame: usize, keep: bool },
    /// Denoise the frame by those before it; write it, fused with what was kept.
    Denoise { frame: usize, write: bool },
}

/// Frame to be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Read {
    pub frame: usize,
    /// False where the frame is denoised by those after it.
    pub forward: bool,
    pub write: bool,
}

/// Steps of a sequence.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Plan {
    pub steps: Vec<Step>,
}

/// Bytes that the kept results of the backward direction may take.
const KEPT_BYTES: usize = 256 << 20;
/// Bytes of a pixel of a result: its color and confidence.
const PIXEL_BYTES: usize = 16;

/// Returns how many frames of so many pixels, of all layers together, are denoised backwards before they are forwards: more take
/// more memory and less time.
pub fn kept(pixels: usize) -> usize {
    (KEPT_BYTES / PIXEL_BYTES / pixels.max(1)).clamp(4, 24)
}

impl Plan {
    /// Plans the frames, of which those with `write` are wanted. Runs of wanted frames, cut into chunks of `chunk` if
    /// that is given, are denoised on their own, after `overlap` frames that come before. With `two_way`, frames are also
    /// denoised backwards, `kept` of them at a time, from `overlap` frames behind.
    pub fn new(write: &[bool], two_way: bool, chunk: Option<u32>, overlap: usize, kept: usize) -> Self {
        let mut steps = Vec::new();
        for run in runs(write, chunk) {
            steps.push(Step::Begin);
            let mut from = run.start.saturating_sub(overlap);
            for start in run.clone().step_by(kept) {
                let end = (start + kept).min(run.end);
                if two_way {
                    steps.push(Step::Backward);
                    let last = (end + overlap).min(write.len());
                    let look = (start..last).rev().map(|frame| Step::Look { frame, keep: frame < end });
                    steps.extend(look);
                }
                steps.extend((from..end).map(|frame| Step::Denoise { frame, write: frame >= run.start }));
                from = end;
            }
        }
        Self { steps }
    }

    /// Returns the frames in the order in which they are read.
    pub fn reads(&self) -> impl Iterator<Item = Read> {
        self.steps.iter().filter_map(|step| match *step {
            Step::Look { frame, .. } => Some(Read { frame, forward: false, write: false }),
            Step::Denoise { frame, write } => Some(Read { frame, forward: true, write }),
            Step::Begin | Step::Backward => None,
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
            Denoise { frame: 1, write: false },
            Denoise { frame: 2, write: true },
            Denoise { frame: 3, write: true },
        ];
        assert_eq!(plan.steps, steps);
        let one_way = Plan::new(&[true; 3], false, None, 16, 8);
        let reads = [0, 1, 2].map(|frame| Read { frame, forward: true, write: true });
        assert_eq!(one_way.reads().collect::<Vec<_>>(), reads);
    }
}
