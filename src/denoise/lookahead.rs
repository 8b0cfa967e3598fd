//! Histories of the frames that follow a frame, found by going through a sequence backwards.
//!
//! A sequence on disk has a future. What it shows of a pixel is as good as its past, and where the light changes
//! steadily the past lags behind by as much as the future runs ahead: the mean of both does neither. Only histories are
//! followed backwards, and no model is learned, so that the look ahead costs a fraction of the denoising.

use super::ahead::Ahead;
use super::difference::Halved;
use super::frame::Frame;
use super::history::{Histories, Past};
use super::lanes::{LANES, Lanes};
use super::layout::{ALPHA, MARGIN, PLANES, STORED, line_of};
use super::packed::{self, Coding, Packed};
use super::ring::{Ring, add, count_of, mean_of};
use super::vectors::{Colors, vectors};
use crate::arch::Arch;
use crate::error::Result;
use rayon::prelude::*;

/// Pixels to each side over which the mean is taken that colors are compared with.
const RADIUS: usize = 1;

/// Histories that are followed backwards through a sequence.
#[derive(Debug, Default)]
pub struct Lookahead {
    size: [usize; 2],
    frames: u32,
    past: Past,
    next: Vec<Packed>,
    /// Coding of the histories that come.
    coding: Coding,
}

impl Lookahead {
    /// Forgets all, as at a cut, and frees the memory.
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    /// Writes to `ahead`, whose memory is used again, what the frames looked at so far show of the frame that lies
    /// before them, and looks at it. Its motion is that to the frame looked at last. A frame of another size begins
    /// anew.
    ///
    /// # Errors
    /// If the frame does not have as many colors, motions or alphas as pixels.
    pub fn observe(&mut self, frame: &Frame<'_>, ahead: &mut Ahead) -> Result<()> {
        frame.check()?;
        let [width, height] = frame.size;
        if self.size != frame.size {
            let past = Past::before_first(frame);
            let next = vec![Packed::default(); width * height];
            *self = Self { size: frame.size, frames: 0, coding: past.coding, past, next };
        }
        let arch = Arch::default();
        let histories = Histories { past: &self.past, coding: self.coding, frame, arch };
        let len = PLANES * vectors(width);
        ahead.data.resize(height * len, Packed::default());
        ahead.differences.resize(height * vectors(width), Halved::default());
        (ahead.size, ahead.frames, ahead.coding) = (frame.size, self.frames, self.past.coding);
        self.frames += 1;
        let band = super::band_rows(height);
        let differences = ahead.differences.par_chunks_mut(band * vectors(width));
        let bands = ahead.data.par_chunks_mut(band * len).zip(self.next.par_chunks_mut(band * width)).zip(differences);
        let extremes = bands.enumerate().map_init(Scratch::default, |scratch, (at, ((data, pixels), differences))| {
            arch.dispatch(ObserveBand { histories, top: at * band, scratch, data, pixels, differences })
        });
        // The least and the largest of numbers do not depend on their order.
        let extremes = extremes.reduce(|| [0.0; 2], |a, b| [a[0].min(b[0]), a[1].max(b[1])]);
        std::mem::swap(&mut self.past.pixels, &mut self.next);
        (self.past.coding, self.coding) = (self.coding, Coding::of(extremes));
        self.past.is_fresh = false;
        Ok(())
    }
}

/// Memory that bands reuse.
#[derive(Debug, Default)]
struct Scratch {
    warped: Ring,
    sums: Vec<f32>,
    around: Vec<Lanes>,
    colors: Vec<Colors>,
}

/// Looks at a band of rows.
struct ObserveBand<'a> {
    histories: Histories<'a>,
    top: usize,
    scratch: &'a mut Scratch,
    data: &'a mut [Packed],
    pixels: &'a mut [Packed],
    /// Differences from the frame that follows.
    differences: &'a mut [Halved],
}

impl pulp::NullaryFnOnce for ObserveBand<'_> {
    /// Least and largest color of the next state.
    type Output = [f32; 2];

    #[inline(always)]
    fn call(self) -> [f32; 2] {
        let Self { histories, top, scratch, data, pixels, differences } = self;
        let Scratch { warped, sums, around, colors } = scratch;
        let [width, height] = histories.frame.size;
        let (line, groups) = (line_of(width), vectors(width));
        let coding = histories.past.coding;
        warped.resize(STORED, line);
        sums.resize(3 * line, 0.0);
        around.resize(groups, Lanes::ZERO);
        colors.resize(groups, Colors::default());
        let count = pixels.len() / width;
        let mut extremes = [Lanes::ZERO; 2];
        for step in 0..count + 2 {
            let y = (top + step).saturating_sub(1).min(height - 1);
            histories.warp(y, warped.row_mut(step), line);
            let Some(at) = step.checked_sub(2) else { continue };
            let parts = [step - 2, step - 1, step].map(|row| &warped.row(row)[..3 * line]);
            add(parts, sums);
            for (group, around) in around.iter_mut().enumerate() {
                let mut sums = sums.chunks_exact(line).map(|sums| mean_of::<RADIUS>(sums, group * LANES));
                *around = [sums.next(), sums.next(), sums.next()].into_iter().flatten().fold(Lanes::ZERO, Lanes::max);
            }
            let lines = warped.row(step - 1);
            let pixels = &mut pixels[at * width..][..width];
            let differences = &mut differences[at * groups..][..groups];
            let [least, most] =
                histories.follow(top + at, lines, (around, count_of(RADIUS)), colors, (pixels, differences));
            extremes = [extremes[0].min(least), extremes[1].max(most)];
            let data = data[at * PLANES * groups..].chunks_exact_mut(groups);
            for (plane, (to, line)) in data.zip(lines.chunks_exact(line)).enumerate() {
                for (to, from) in to.iter_mut().zip(line[MARGIN..].as_chunks().0) {
                    let numbers = Lanes(*from);
                    *to = packed::pack(if plane < ALPHA { coding.encode(numbers) } else { numbers });
                }
            }
        }
        [extremes[0].0.into_iter().fold(0.0, f32::min), extremes[1].0.into_iter().fold(0.0, f32::max)]
    }
}
