//! Blocks of pixels, whose means errors are stated of.

use std::ops::Range;

/// Edge of a block in pixels.
pub const EDGE: usize = 8;

/// Blocks of 8 x 8 pixels of a picture, row by row from its top left; those at its right and lower edge may be smaller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Blocks {
    width: usize,
    height: usize,
}

impl Blocks {
    /// Creates the blocks of a picture of this width and height.
    pub fn new([width, height]: [usize; 2]) -> Self {
        Self { width, height }
    }

    /// Returns the number of blocks from left to right, and from top to bottom.
    pub fn grid(&self) -> [usize; 2] {
        [self.width.div_ceil(EDGE), self.height.div_ceil(EDGE)]
    }

    /// Returns the number of blocks.
    pub fn count(&self) -> usize {
        let [across, down] = self.grid();
        across * down
    }

    /// Returns the number of the block that holds a pixel.
    #[inline(always)]
    pub fn of(&self, [x, y]: [usize; 2]) -> usize {
        y / EDGE * self.width.div_ceil(EDGE) + x / EDGE
    }

    /// Returns the columns and rows of a block.
    pub fn extent(&self, block: usize) -> [Range<usize>; 2] {
        let [across, _] = self.grid();
        let side = |at: usize, end: usize| at * EDGE..end.min((at + 1) * EDGE);
        [side(block % across, self.width), side(block / across, self.height)]
    }

    /// Returns the row-major numbers of a block's pixels.
    pub fn pixels(&self, block: usize) -> impl Iterator<Item = usize> + use<> {
        let ([columns, rows], width) = (self.extent(block), self.width);
        rows.flat_map(move |y| columns.clone().map(move |x| y * width + x))
    }

    /// Returns the blocks around one, and itself.
    pub fn around(&self, block: usize) -> impl Iterator<Item = usize> + use<> {
        let [across, down] = self.grid();
        let near = |at: usize, end: usize| at.saturating_sub(1)..(at + 2).min(end);
        let columns = near(block % across, across);
        near(block / across, down).flat_map(move |y| columns.clone().map(move |x| y * across + x))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pixel_is_in_one_block() {
        for size in [[1, 1], [8, 8], [9, 17], [40, 23]] {
            let blocks = Blocks::new(size);
            let mut seen = vec![0; size[0] * size[1]];
            for block in 0..blocks.count() {
                for pixel in blocks.pixels(block) {
                    seen[pixel] += 1;
                    assert_eq!(blocks.of([pixel % size[0], pixel / size[0]]), block);
                }
            }
            assert!(seen.iter().all(|n| *n == 1), "{size:?}");
        }
        assert_eq!(Blocks::new([40, 23]).around(0).collect::<Vec<_>>(), [0, 1, 5, 6]);
        assert_eq!(Blocks::new([24, 24]).around(4).count(), 9);
    }
}
