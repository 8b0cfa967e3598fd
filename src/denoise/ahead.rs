//! Histories of the pixels of a frame over the frames that follow it, as a [`Lookahead`](super::Lookahead) leaves them.

use super::blocks::BLOCK;
use super::difference::Halved;
use super::lanes::{LANES, Lanes, each};
use super::layout::{ALPHA, COUNT, MARGIN, PLANES};
use super::packed::{self, Coding, Packed};
use super::vectors::vectors;

/// Frames of a history at most, where it is weighed against another: older ones hardly count.
const MOST_FRAMES: f32 = 13.0;
/// Change of illumination from frame to frame from which on histories count as lagging behind.
const LAGGING: f32 = 0.002;

/// Histories of the pixels of a frame over the frames that follow it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Ahead {
    pub(super) size: [usize; 2],
    /// Number of frames that follow, as far as they were looked at.
    pub(super) frames: u32,
    /// Coding of the colors.
    pub(super) coding: Coding,
    /// Row by row, plane after plane: color, alpha and the count of frames.
    pub(super) data: Vec<Packed>,
    /// Differences between the pixels' colors and those of the next frame, row by row.
    pub(super) differences: Vec<Halved>,
}

impl Ahead {
    /// Returns the number of columns and rows.
    pub(crate) fn size(&self) -> [usize; 2] {
        self.size
    }

    /// Returns the number of frames that the histories are taken from.
    pub(crate) fn frames(&self) -> u32 {
        self.frames
    }

    /// Bytes of the histories of a pixel.
    pub const PIXEL_BYTES: usize = 2 * PLANES + size_of::<Halved>() / LANES;

    /// Writes the means of a row of these histories and those over the frames before. `before` holds lines of `line`
    /// numbers, plane after plane, and so does `to`. The last plane is the sum of the frames. `trend` is that of the
    /// illumination, by block.
    ///
    /// Weights as the frames have the least noise. Weights as the other's frames would have no lag, since a history
    /// lags in proportion to its frames: where the light changes, each is weighted by the square root of the other's.
    #[inline(always)]
    pub(crate) fn join(&self, y: usize, trend: &[f32], before: &[f32], line: usize, to: &mut [f32]) {
        let groups = vectors(self.size[0]);
        let row = &self.data[y * PLANES * groups..][..PLANES * groups];
        let (one, limit) = (Lanes([1.0; LANES]), Lanes([MOST_FRAMES; LANES]));
        for group in 0..groups {
            let at = MARGIN + group * LANES;
            let past = |plane: usize| Lanes::load(before, plane * line + at);
            let future = |plane: usize| packed::unpack(&row[plane * groups + group]);
            let (behind, ahead) = (past(COUNT).min(limit), future(COUNT).min(limit));
            let trend = Lanes(each(|lane| trend.get((group * LANES + lane) / BLOCK).copied().unwrap_or(0.0)));
            let lag = (trend.max(Lanes::ZERO - trend) * (1.0 / LAGGING)).min(one);
            let least_noise = ahead / (ahead + behind);
            let less_lag = one / (one + (ahead / behind).sqrt());
            let both = least_noise + (less_lag - least_noise) * lag;
            let share = ahead.select(behind.select(both, one), Lanes::ZERO);
            for plane in 0..COUNT {
                let found = if plane < ALPHA { self.coding.decode(future(plane)) } else { future(plane) };
                (past(plane) + (found - past(plane)) * share).store(to, plane * line + at);
            }
            (ahead + behind).store(to, COUNT * line + at);
        }
    }
}
