//! Lines of numbers of the rows around the one at work, and means over them.

use super::lanes::{LANES, Lanes};
use super::layout::MARGIN;

/// Greatest number of pixels to each side over which means are taken.
pub(crate) const HALO: usize = 4;
/// Rows that are held at a time.
const RING: usize = 2 * HALO;

/// Lines with margins, plane after plane, of the last rows.
#[derive(Debug, Default)]
pub(crate) struct Ring {
    planes: usize,
    line: usize,
    data: Vec<f32>,
}

impl Ring {
    /// Prepares for rows of so many planes, each a line of so many numbers.
    pub(crate) fn resize(&mut self, planes: usize, line: usize) {
        (self.planes, self.line) = (planes, line);
        self.data.resize(RING * planes * line, 0.0);
    }

    /// Returns the lines of a row.
    #[inline(always)]
    pub(crate) fn row(&self, row: usize) -> &[f32] {
        let len = self.planes * self.line;
        &self.data[row % RING * len..][..len]
    }

    /// Returns the lines of a row to be written; those of the row so many before are lost.
    #[inline(always)]
    pub(crate) fn row_mut(&mut self, row: usize) -> &mut [f32] {
        let len = self.planes * self.line;
        &mut self.data[row % RING * len..][..len]
    }
}

/// Writes the sums of three lines.
#[inline(always)]
pub(crate) fn add(parts: [&[f32]; 3], to: &mut [f32]) {
    let [a, b, c] = parts.map(|part| part.as_chunks::<LANES>().0);
    for (((a, b), c), to) in a.iter().zip(b).zip(c).zip(to.as_chunks_mut::<LANES>().0) {
        *to = ((Lanes(*a) + Lanes(*b)) + Lanes(*c)).0;
    }
}

/// Returns the number of pixels of a neighbourhood of so many to each side.
pub(crate) fn count_of(radius: usize) -> f32 {
    (2 * radius + 1).pow(2) as f32
}

/// Returns the means over the neighbourhoods of eight pixels from `left` on, from the sums of its columns.
#[inline(always)]
pub(crate) fn mean_of<const RADIUS: usize>(sums: &[f32], left: usize) -> Lanes {
    let side = 2 * RADIUS + 1;
    let window: &[f32; LANES + 2 * HALO] =
        sums[MARGIN + left - HALO..].first_chunk().unwrap_or(&[0.0; LANES + 2 * HALO]);
    let mut sum = Lanes::ZERO;
    for step in 0..side {
        for lane in 0..LANES {
            sum.0[lane] += window[HALO - RADIUS + step + lane];
        }
    }
    sum * (1.0 / (side * side) as f32)
}
