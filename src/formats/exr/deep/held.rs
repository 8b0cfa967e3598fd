//! What holds a deep picture out: another deep picture, or the depths of opaque objects.

use super::{DeepPicture, DeepSample, TidyPixel};
use crate::error::{Error, Result};
use crate::formats::exr::Window;

/// Holdout of a deep picture of the same size.
#[derive(Debug)]
pub(crate) enum HeldOut {
    /// Samples of another deep picture.
    Deep(DeepPicture),
    /// Depths of opaque objects along the viewing axis, over the display window, row by row from the top.
    Depths([usize; 2], Vec<f32>),
}

impl HeldOut {
    /// Refuses depths that are not numbers.
    ///
    /// # Errors
    /// If there are such depths; the error tells the row of the first.
    pub(crate) fn defined(&self) -> Result<()> {
        let row = match self {
            Self::Deep(deep) => {
                let unknown = |sample: &DeepSample| sample.z.is_nan() || sample.z_back.is_nan();
                deep.lines.iter().position(|line| line.samples.iter().any(unknown))
            }
            Self::Depths([width, _], depths) => depths.iter().position(|z| z.is_nan()).map(|place| place / width),
        };
        row.map_or(Ok(()), |row| Err(super::flatten::undefined(row)))
    }

    /// Refuses what is of another size than the display window of the picture.
    pub(super) fn check(&self, display: Window) -> Result<()> {
        let size = match self {
            Self::Deep(deep) => deep.display_window.size,
            Self::Depths(size, _) => *size,
        };
        if size == display.size {
            return Ok(());
        }
        let [[a, b], [c, d]] = [size, display.size];
        Err(Error::invalid(format!("a holdout of {a}x{b} pixels for a picture of {c}x{d}"))
            .hint("render it with the same camera, in the size of the deep picture"))
    }

    /// Returns what stands in a row of the display window.
    pub(super) fn row(&self, y: i64) -> HeldRow<'_> {
        match self {
            Self::Deep(deep) => {
                let from =
                    |axis: usize| i64::from(deep.data_window.min[axis]) - i64::from(deep.display_window.min[axis]);
                let line = usize::try_from(y - from(1)).ok().and_then(|y| deep.lines.get(y));
                HeldRow::Deep(from(0), line.map_or_else(Vec::new, |line| line.pixels().collect()))
            }
            Self::Depths([width, _], depths) => {
                let row = usize::try_from(y).ok().and_then(|y| depths.chunks_exact(*width).nth(y));
                HeldRow::Depths(row.unwrap_or_default())
            }
        }
    }
}

/// Row of a holdout.
pub(super) enum HeldRow<'h> {
    /// Column of the first pixel, and the samples of all.
    Deep(i64, Vec<&'h [DeepSample]>),
    Depths(&'h [f32]),
}

impl HeldRow<'_> {
    /// Returns the holdout of a pixel by its column in the display window. All depths are numbers.
    pub(super) fn pixel(&self, x: i64) -> TidyPixel {
        match self {
            Self::Deep(from, pixels) => {
                let samples = usize::try_from(x - from).ok().and_then(|x| pixels.get(x)).copied().unwrap_or_default();
                TidyPixel::new(samples)
            }
            Self::Depths(depths) => {
                let z = usize::try_from(x).ok().and_then(|x| depths.get(x)).copied().unwrap_or(f32::INFINITY);
                TidyPixel::new(&[DeepSample { z, z_back: z, rgba: [0.0, 0.0, 0.0, 1.0] }])
            }
        }
    }
}
