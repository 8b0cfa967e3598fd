//! Rows of pixels as vectors of eight.

use super::lanes::{LANES, Lanes};

/// Features of eight pixels by channel.
pub(crate) type Features = [Lanes; 3];

/// Colors of eight pixels, and their weights: 1 where there is a color.
pub(crate) type Colors = [Lanes; 4];

/// Vectors in a row of pixels.
pub(crate) fn vectors(width: usize) -> usize {
    width.div_ceil(LANES)
}
