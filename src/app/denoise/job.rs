//! Parts of the work of denoising that a job does apart from each other.

use super::DenoiseSettings;
use super::names::Names;
use crate::app::Context;
use crate::app::job::{Divisible, Work};
use crate::error::Result;
use crate::formats::sequence::Frames;
use std::path::Path;

impl Divisible for DenoiseSettings {
    /// Chunks of a length that is given do not depend on each other. Without one each frame learns from all those
    /// before it, and one task denoises them all.
    fn work(&self, _: &Context) -> Result<Work> {
        let input = Names::of(&self.input)?;
        input.check_frames(self.frames.is_some())?;
        let Some(chunk) = self.chunk.filter(|_| !input.is_still()) else { return Ok(Work::Whole) };
        let present = input.all_numbers()?;
        let wanted: Vec<u32> = self.frames.map_or_else(|| present.clone(), |frames| frames.numbers().collect());
        let mut all: Vec<u32> = present.into_iter().chain(wanted.iter().copied()).collect();
        all.sort_unstable();
        all.dedup();
        let chunks = all.chunks(chunk as usize);
        Ok(Work::Ranges(chunks.filter_map(|chunk| range_of(chunk, &wanted)).collect()))
    }

    fn inputs(&self) -> Vec<&Path> {
        Self::inputs(self)
    }
}

/// Returns the range from the first to the last of the numbers that are wanted.
fn range_of(numbers: &[u32], wanted: &[u32]) -> Option<Frames> {
    let own: Vec<u32> = numbers.iter().copied().filter(|number| wanted.binary_search(number).is_ok()).collect();
    let step = own.windows(2).map(|pair| pair[1] - pair[0]).min().unwrap_or(1);
    own.first().zip(own.last()).map(|(first, last)| Frames { first: *first, last: *last, step })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_those_of_chunks() {
        let of = |numbers: &[u32]| range_of(numbers, &[1, 2, 3, 5, 7, 9]).map(|range| range.to_string());
        assert_eq!(of(&[1, 2, 3]).as_deref(), Some("1-3"));
        assert_eq!(of(&[4, 5, 6, 7, 8, 9]).as_deref(), Some("5-9x2"));
        assert_eq!(of(&[10, 11]), None);
    }
}
