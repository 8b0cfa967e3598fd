//! Layout of histories in memory: the numbers of a pixel, and lines of them with margins.

use super::lanes::LANES;

/// Numbers of a pixel that are not padding.
pub(crate) const PLANES: usize = 5;
/// Plane of alpha.
pub(crate) const ALPHA: usize = 3;
/// Plane of the count of frames.
pub(crate) const COUNT: usize = 4;

/// Numbers of a pixel of the frame before: its history, and behind that its color alone.
pub(crate) const STORED: usize = 8;
/// First plane of the color alone.
pub(crate) const LAST: usize = PLANES;

/// Numbers before and after the pixels of a line.
pub(crate) const MARGIN: usize = LANES;

/// Returns the numbers of a line of so many pixels, with its margins.
pub(crate) fn line_of(width: usize) -> usize {
    width.next_multiple_of(LANES) + 2 * MARGIN
}

/// Repeats the outermost of a line's pixels in its margins.
#[inline(always)]
pub(crate) fn fill_margins(line: &mut [f32], width: usize) {
    let [first, last] = [line[MARGIN], line[MARGIN + width - 1]];
    line[..MARGIN].fill(first);
    line[MARGIN + width..].fill(last);
}
