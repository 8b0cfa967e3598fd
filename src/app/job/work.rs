//! Parts into which the work of a command is cut.

use crate::app::Context;
use crate::app::use_case::UseCase;
use crate::error::Result;
use crate::formats::sequence::Frames;
use std::path::{Path, PathBuf};

/// Use case whose work a job can do.
pub(crate) trait Divisible: UseCase {
    /// Returns the parts that tasks can do apart from each other, with the same results as one process.
    ///
    /// # Errors
    /// If the inputs do not tell the parts, or contradict the settings.
    fn work(&self, context: &Context) -> Result<Work>;

    /// Paths that the results are made from.
    fn inputs(&self) -> Vec<&Path>;

    /// True if the work goes on from what it has left when it was stopped, with `resume`.
    fn resumes(&self) -> bool {
        true
    }

    /// Returns the memory in bytes that was set as the limit of the process; none where none was.
    fn memory(&self) -> Option<u64> {
        let most = self.limits().max_memory;
        (most != crate::formats::limits::Limits::default().max_memory).then_some(most)
    }

    /// Returns the seconds that a frame or a view is expected to take, as far as that can be told soon.
    fn seconds(&self, _context: &Context) -> Option<f64> {
        None
    }
}

/// Parts of the work of a command.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Work {
    /// One task does all of it.
    Whole,
    /// Frames of a sequence, by number.
    Frames(Vec<u32>),
    /// Views, by number.
    Views(Vec<u32>),
    /// Frames of a sequence, by number, all of which are denoised afterwards by one task: it learns from each of them.
    Denoised {
        numbers: Vec<u32>,
        /// Planes beside those that the command asks for, which the denoiser needs.
        planes: String,
    },
    /// Frames of a sequence in ranges that do not depend on each other.
    Ranges(Vec<Frames>),
    /// Replicates of a picture, by number, which are merged afterwards to the picture.
    Replicates {
        numbers: [u32; 2],
        /// Picture that they make.
        picture: PathBuf,
    },
}

/// Returns numbers in ascending order as a range expression of Open Job Description, such as `1-10:3,20-30`.
pub(super) fn range_of(numbers: &[u32]) -> String {
    let mut parts = Vec::new();
    let mut rest = numbers;
    while let [first, after @ ..] = rest {
        let step = after.first().map_or(1, |second| second - first);
        let length = 1 + after.iter().zip(1..).take_while(|(number, n)| **number == first + n * step).count();
        let last = first + (length as u32 - 1) * step;
        match (length, step) {
            (1, _) => parts.push(first.to_string()),
            (2, 2..) => parts.extend([first.to_string(), last.to_string()]),
            (_, 1) => parts.push(format!("{first}-{last}")),
            (_, step) => parts.push(format!("{first}-{last}:{step}")),
        }
        rest = &rest[length..];
    }
    parts.join(",")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_ranges() {
        let of = |numbers: &[u32]| range_of(numbers);
        assert_eq!(of(&[1, 2, 3, 4]), "1-4");
        assert_eq!(of(&[7]), "7");
        assert_eq!(of(&[1, 4, 7, 10, 20, 21]), "1-10:3,20-21");
        assert_eq!(of(&[0, 2]), "0,2");
        assert_eq!(of(&[]), "");
    }
}
