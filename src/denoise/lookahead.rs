//! Histories of the frames that follow a frame, found by going through a sequence backwards.
//!
//! A sequence on disk has a future. What it shows of a pixel is as good as its past, and where the light changes steadily
//! the past lags behind by as much as the future runs ahead: the mean of both does neither. Only histories are followed
//! backwards, and no model is learned, so that the look ahead costs a fraction of the denoising.

use super::ahead::Ahead;
use super::difference::{self, Difference, Halved, Neighbour};
use super::frame::Frame;
use super::history::{Histories, Past, scale_of, scale_of_first};
use super::lanes::{LANES, Lanes};
use super::layout::{ALPHA, MARGIN, PLANES, line_of};
use super::packed::{self, Packed};
use super::ring::{Ring, add, mean_of};
use super::vectors::{Colors, vectors};
use crate::arch::Arch;
use crate::error::Result;
use rayon::prelude::*;

/// Histories that are followed backwards through a sequence.
#[derive(Debug, Default)]
pub struct Lookahead {
    size: [usize; 2],
    frames: u32,
    past: Past,
    next: Vec<Packed>,
    /// Factor of the histories that come.
    scale: f32,
    /// The frame looked at last.
    last: Neighbour,
}

impl Lookahead {
    /// Forgets all, as at a cut, and frees the memory.
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    /// Writes to `ahead`, whose memory is used again, what the frames looked at so far show of the frame that lies before them,
    /// and looks at it. Its motion is that to the frame looked at last. A frame of another size begins anew.
    ///
    /// # Errors
    /// If the frame does not have as many colors, motions or alphas as pixels.
    pub fn look(&mut self, frame: &Frame<'_>, ahead: &mut Ahead) -> Result<()> {
        frame.check()?;
        let [width, height] = frame.size;
        if self.size != frame.size {
            let scale = scale_of_first(frame.color);
            let next = vec![Packed::default(); width * height];
            *self = Self { size: frame.size, frames: 0, past: Past { scale, ..Past::default() }, next, scale, last: Neighbour::default() };
        }
        let arch = Arch::default();
        let histories = Histories { past: &self.past, scale: self.scale, frame, alpha: frame.alpha, arch };
        let len = PLANES * vectors(width);
        ahead.data.resize(height * len, Packed::default());
        ahead.differences.resize(height * vectors(width), Halved::default());
        (ahead.size, ahead.frames, ahead.scale) = (frame.size, self.frames, self.past.scale);
        self.frames += 1;
        let band = super::band_rows(height);
        let differences = ahead.differences.par_chunks_mut(band * vectors(width));
        let bands = ahead.data.par_chunks_mut(band * len).zip(self.next.par_chunks_mut(band * width)).zip(differences);
        let last = &self.last;
        let most = bands.enumerate().map_init(Scratch::default, |scratch, (at, ((data, pixels), differences))| {
            arch.dispatch(Look { histories, last, top: at * band, scratch, data, pixels, differences })
        });
        // The largest of numbers does not depend on their order.
        let most = most.reduce(|| 0.0, f32::max);
        self.last.take(frame);
        std::mem::swap(&mut self.past.pixels, &mut self.next);
        (self.past.scale, self.scale) = (self.scale, scale_of(most));
        // The next frame of a fresh state has swapped in an empty one.
        self.next.resize(self.past.pixels.len(), Packed::default());
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
    differences: Vec<Difference>,
}

/// Looks at a band of rows.
struct Look<'a> {
    histories: Histories<'a>,
    /// The frame that follows.
    last: &'a Neighbour,
    top: usize,
    scratch: &'a mut Scratch,
    data: &'a mut [Packed],
    pixels: &'a mut [Packed],
    differences: &'a mut [Halved],
}

impl pulp::NullaryFnOnce for Look<'_> {
    /// Largest color of the next state.
    type Output = f32;

    #[inline(always)]
    fn call(self) -> f32 {
        let Self { histories, last, top, scratch, data, pixels, differences: halves } = self;
        let Scratch { warped, sums, around, colors, differences } = scratch;
        let [width, height] = histories.frame.size;
        let (line, groups) = (line_of(width), vectors(width));
        let shrunk = histories.past.scale.recip();
        warped.resize(PLANES, line);
        sums.resize(3 * line, 0.0);
        around.resize(groups, Lanes::ZERO);
        colors.resize(groups, Colors::default());
        differences.resize(groups, Difference::default());
        let count = pixels.len() / width;
        let mut most = Lanes::ZERO;
        for step in 0..count + 2 {
            let y = (top + step).saturating_sub(1).min(height - 1);
            histories.warp(y, warped.row_mut(step), line);
            let Some(at) = step.checked_sub(2) else { continue };
            let parts = [step - 2, step - 1, step].map(|row| &warped.row(row)[..3 * line]);
            add(parts, sums);
            for (group, around) in around.iter_mut().enumerate() {
                let mut sums = sums.chunks_exact(line).map(|sums| mean_of::<1>(sums, group * LANES));
                *around = [sums.next(), sums.next(), sums.next()].into_iter().flatten().fold(Lanes::ZERO, Lanes::max);
            }
            let lines = warped.row(step - 1);
            let pixels = &mut pixels[at * width..][..width];
            most = most.max(histories.follow(top + at, lines, around, colors, pixels));
            let data = data[at * PLANES * groups..].chunks_exact_mut(groups);
            for (plane, (to, line)) in data.zip(lines.chunks_exact(line)).enumerate() {
                let factor = if plane < ALPHA { shrunk } else { 1.0 };
                for (to, from) in to.iter_mut().zip(line[MARGIN..].as_chunks().0) {
                    *to = packed::pack(Lanes(*from) * factor);
                }
            }
            last.differences(histories.frame, top + at, differences);
            for (to, difference) in halves[at * groups..].iter_mut().zip(&*differences) {
                *to = difference::halved(difference);
            }
        }
        most.0.into_iter().fold(0.0, f32::max)
    }
}
