//! Histories of the pixels: means of their colors and alphas over the frames before, which follow the motion.
//!
//! A history does not hold the color of the frame at hand, so that the noise of both is independent. Pixels are kept in
//! sixteen bits a number ([`packed`](super::packed)).

use super::difference::{self, Halved};
use super::frame::Frame;
use super::lanes::{LANES, Lanes, each};
use super::layout::{ALPHA, COUNT, LAST, MARGIN, PLANES, STORED, fill_margins, line_of};
use super::packed::{self, Coding, Packed};
use super::reprojection::{Taps, around};
use super::vectors::Colors;
use crate::arch::Arch;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Greatest share of the history of colors in its next state.
const HISTORY: f32 = 0.86;
/// Greatest share of the history of alpha in its next state.
const ALPHA_HISTORY: f32 = 0.5;

/// Multiple of what is around above which a color is cut before it enters the history. That biases the feature, which
/// need not be without bias.
const HISTORY_LIMIT: f32 = 8.0;

/// Multiple of the history itself up to which a color is not cut: a point that shines on is no bright path.
const OWN_LIMIT: f32 = 4.0;
/// Frames that such a history has at least.
const OWN_FRAMES: f32 = 3.5;
/// Multiple of the other pixels around up to which that holds.
const OWN_CONTRAST: f32 = 100.0;

/// Multiple of what is around above which a color is cut before it is learned: a path of that brightness would outweigh
/// all that was learned.
const COLOR_LIMIT: f32 = 64.0;

/// Largest number taken from a picture, so that no product overflows.
const LARGEST: f32 = 1e12;

/// Histories of all pixels after a frame.
#[derive(Debug, Clone, Default)]
pub(crate) struct Past {
    /// The history of each pixel's color and alpha, the count of its frames, and the color of the frame alone.
    pub pixels: Vec<Packed>,
    /// Coding of the colors.
    pub coding: Coding,
    /// True before the first frame: its own colors stand for the histories, over no frames.
    pub is_fresh: bool,
}

impl Past {
    /// Returns what stands for the histories before a first frame.
    pub(crate) fn before_first(frame: &Frame<'_>) -> Self {
        let [width, height] = frame.size;
        let of_row = |y: usize| (0..width).map(move |x| calm(frame, [x, y]));
        let colors: Vec<Vec3> = (0..height).into_par_iter().flat_map_iter(of_row).collect();
        let of =
            |[least, most]: [f32; 2], color: &Vec3| [least.min(color.min_element()), most.max(color.max_element())];
        // The least and the greatest of numbers do not depend on their order.
        let extremes =
            colors.par_iter().fold(|| [0.0; 2], of).reduce(|| [0.0; 2], |a, b| [a[0].min(b[0]), a[1].max(b[1])]);
        let coding = Coding::of(extremes);
        let alphas = |at: usize| frame.alpha.map_or(0.0, |alpha| alpha[at]);
        let pixels = colors.par_iter().enumerate().map(|(at, color)| fresh(coding, *color, alphas(at)));
        Self { pixels: pixels.map(packed::pack).collect(), coding, is_fresh: true }
    }
}

/// Returns a pixel that has no history yet.
fn fresh(coding: Coding, color: Vec3, alpha: f32) -> Lanes {
    let coded = coding.encode(Lanes([color.x, color.y, color.z, 0.0, 0.0, 0.0, 0.0, 0.0])).0;
    let alpha = if alpha.is_finite() { alpha.clamp(0.0, 1.0) } else { 0.0 };
    Lanes([coded[0], coded[1], coded[2], alpha, 0.0, 0.0, 0.0, 0.0])
}

/// Histories of the frame before, beside the frame that comes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Histories<'h> {
    /// Histories after the frame before.
    pub past: &'h Past,
    /// Coding of the colors of the histories after this frame.
    pub coding: Coding,
    /// Frame that comes.
    pub frame: &'h Frame<'h>,
    /// Instruction set.
    pub arch: Arch,
}

impl Histories<'_> {
    /// Reprojects a row of pixels to lines of `line` numbers, plane after plane. Their margins repeat the outermost
    /// pixels.
    #[inline(always)]
    pub(crate) fn warp(&self, y: usize, lines: &mut [f32], line: usize) {
        let [width, _] = self.frame.size;
        let motion = self.frame.motion.filter(|_| !self.past.is_fresh).map(|motion| &motion[y * width..][..width]);
        let row = &self.past.pixels[y * width..][..width];
        let coding = self.past.coding;
        for left in (0..width).step_by(LANES) {
            let mut found = [[0.0; LANES]; LANES];
            if let Some(motion) = motion.map(|motion| &motion[left..]) {
                let of = |axis: usize| Lanes(each(|lane| motion.get(lane).map_or(0.0, |motion| motion[axis])));
                let places = [Lanes(each(|lane| (left + lane) as f32)) + of(0), Lanes([y as f32; LANES]) + of(1)];
                let taps = Taps::around(self.frame.size, places);
                for ((lane, motion), found) in motion.iter().enumerate().zip(&mut found) {
                    *found = self.before([left + lane, y], *motion, &taps, lane).0;
                }
            } else {
                for (pixel, found) in row[left..].iter().zip(&mut found) {
                    *found = packed::unpack(pixel).0;
                }
            }
            let planes = self.arch.transposed(&found);
            for (plane, numbers) in planes.into_iter().enumerate() {
                let is_color = plane != ALPHA && plane != COUNT;
                let numbers = if is_color { coding.decode(Lanes(numbers)) } else { Lanes(numbers) };
                numbers.store(lines, plane * line + MARGIN + left);
            }
        }
        for line in lines.chunks_mut(line).take(PLANES) {
            fill_margins(line, width);
        }
    }

    /// Returns a pixel as it was in the frame before, or as it is now if it was not seen.
    #[inline(always)]
    fn before(&self, [x, y]: [usize; 2], motion: Vec2, taps: &Taps, lane: usize) -> Lanes {
        let (pixels, size) = (&self.past.pixels[..], self.frame.size);
        if motion == Vec2::ZERO {
            return packed::unpack(&pixels[y * size[0] + x]);
        }
        if let Some(first) = taps.first(lane, size[0]) {
            return packed::resampled(pixels, size[0], first, taps.shares(0, lane), taps.shares(1, lane));
        }
        match around(size, Vec2::new(x as f32, y as f32) + motion) {
            Some(found) => {
                let shares = found.share.map(|share| share / found.covered);
                packed::mean(found.at.map(|place| &pixels[place]), shares)
            }
            None => {
                let alpha = self.frame.alpha.map_or(0.0, |alpha| alpha[y * size[0] + x]);
                fresh(self.past.coding, calm(self.frame, [x, y]), alpha)
            }
        }
    }

    /// Returns the alphas of eight pixels of a row from `left` on.
    #[inline(always)]
    pub(crate) fn alphas(&self, y: usize, left: usize) -> Lanes {
        let [width, _] = self.frame.size;
        let row = self.frame.alpha.map_or(&[][..], |alpha| &alpha[y * width..][..width]);
        let mut alphas = Lanes::load(row, left);
        if left + LANES > row.len() {
            alphas = Lanes(each(|lane| row.get(left + lane).copied().unwrap_or(0.0)));
        }
        // Clamped, so that NaN becomes 0.
        alphas.max(Lanes::ZERO).min(Lanes([1.0; LANES]))
    }

    /// Takes a row's colors to planes, cut where they are far above the mean of so many pixels around, and writes the
    /// next state of its histories, and the differences from the frame before. The fourth plane is 1 where there is a
    /// color. Returns the least and the greatest colors of the next state, in some order.
    #[inline(always)]
    pub(crate) fn follow(
        &self,
        y: usize,
        lines: &[f32],
        (around, count_around): (&[Lanes], f32),
        colors: &mut [Colors],
        (pixels, differences): (&mut [Packed], &mut [Halved]),
    ) -> [Lanes; 2] {
        let mut extremes = [Lanes::ZERO; 2];
        let [width, _] = self.frame.size;
        let line = line_of(width);
        let row = &self.frame.color[y * width..][..width];
        let one = Lanes([1.0; LANES]);
        let groups =
            row.chunks(LANES).zip(pixels.chunks_mut(LANES)).zip(around.iter().zip(colors)).zip(differences).enumerate();
        for (at, (((row, pixels), (around, colors)), differences)) in groups {
            let (color, seen) = loaded(row);
            // A dark spike would widen the coding of all colors as a bright one would.
            let [r, g, b]: [Lanes; 3] = each(|c| color[c].max(Lanes::ZERO - color[c]));
            let most = r.max(g).max(b).max(Lanes([1e-30; LANES]));
            let share = *around / most;
            let cut = |limit: f32| share.select((share * limit).min(one), one);
            let learned = cut(COLOR_LIMIT);
            *colors = [color[0] * learned, color[1] * learned, color[2] * learned, seen];
            let mut before = [Lanes::ZERO; STORED];
            for (before, line) in before.iter_mut().zip(lines.chunks_exact(line)) {
                *before = Lanes::load(line, MARGIN + at * LANES);
            }
            let [r, g, b]: [Lanes; 3] = each(|c| before[c].max(Lanes::ZERO - before[c]));
            let count = before[COUNT];
            let own = r.max(g).max(b);
            let others = (*around * count_around - own).max(Lanes::ZERO) * (1.0 / (count_around - 1.0));
            let is_long = (count - Lanes([OWN_FRAMES; LANES])).select(one, Lanes::ZERO);
            let own = (own * OWN_LIMIT).min(others * OWN_CONTRAST) / most * is_long;
            let followed = share.select((share * HISTORY_LIMIT).max(own).min(one), one);
            let keep = (count / (count + 1.0)).min(Lanes([HISTORY; LANES]));
            let mut next = [[0.0; LANES]; LANES];
            for c in 0..3 {
                let color = seen.select(before[c] * keep + color[c] * followed * (one - keep), before[c]);
                extremes = [extremes[0].min(color), extremes[1].max(color)];
                next[c] = self.coding.encode(color).0;
            }
            let known = count.select(seen, Lanes::ZERO);
            let apart = each(|c| color[c] - before[LAST + c]);
            *differences = difference::halved(&apart, known);
            for c in 0..3 {
                let alone = seen.select(color[c], before[c]);
                next[LAST + c] = self.coding.encode(alone).0;
            }
            next[ALPHA] = with_alpha(before[ALPHA], count, self.alphas(y, at * LANES)).0;
            next[COUNT] = (count + seen).min(Lanes([64.0; LANES])).0;
            for (pixel, next) in pixels.iter_mut().zip(self.arch.transposed(&next)) {
                *pixel = packed::pack(Lanes(next));
            }
        }
        extremes
    }
}

/// Returns the color of a pixel, cut where it is far above those around: what a history begins with.
fn calm(frame: &Frame<'_>, [x, y]: [usize; 2]) -> Vec3 {
    let [width, height] = frame.size;
    let (mut sum, mut size, mut count) = (Vec3::ZERO, Vec3::ZERO, 0.0);
    for row in y.saturating_sub(1)..(y + 2).min(height) {
        for column in x.saturating_sub(1)..(x + 2).min(width) {
            let color = within(frame.color[row * width + column]);
            if let Some(color) = color.filter(|_| [column, row] != [x, y]) {
                sum += color;
                size += color.abs();
                count += 1.0;
            }
        }
    }
    let [around, size] = [sum, size].map(|sum| sum / f32::max(count, 1.0));
    let own = within(frame.color[y * width + x]).unwrap_or(around);
    let most = HISTORY_LIMIT * size.max_element();
    own * (most / own.abs().max_element().max(1e-30)).clamp(0.0, 1.0)
}

/// Returns the history of alpha over so many frames with the alpha of the frame at hand.
#[inline(always)]
pub(crate) fn with_alpha(before: Lanes, count: Lanes, now: Lanes) -> Lanes {
    let keep = (count / (count + 1.0)).min(Lanes([ALPHA_HISTORY; LANES]));
    now + (before - now) * keep
}

/// Returns the channels of up to eight colors whose numbers are small enough to be multiplied, and 1 where they are
/// finite; 0 elsewhere.
#[inline(always)]
pub(crate) fn loaded(row: &[Vec3]) -> ([Lanes; 3], Lanes) {
    let mut all = [Vec3::NAN; LANES];
    let row = row.first_chunk().unwrap_or_else(|| {
        all[..row.len()].copy_from_slice(row);
        &all
    });
    let mut color: [Lanes; 3] = each(|c| Lanes(each(|lane| row[lane][c])));
    let mut seen = Lanes::ZERO;
    for lane in 0..LANES {
        // Of numbers that are not finite the product is not a number.
        let zero = (color[0].0[lane] * 0.0 + color[1].0[lane] * 0.0) + color[2].0[lane] * 0.0;
        seen.0[lane] = if zero == 0.0 { 1.0 } else { 0.0 };
    }
    let (most, least) = (Lanes([LARGEST; LANES]), Lanes([-LARGEST; LANES]));
    for color in &mut color {
        *color = seen.select(color.min(most).max(least), Lanes::ZERO);
    }
    (color, seen)
}

/// Returns a color whose numbers are small enough to be multiplied; `None` if it is not finite.
#[inline(always)]
fn within(color: Vec3) -> Option<Vec3> {
    color.is_finite().then(|| color.clamp(Vec3::splat(-LARGEST), Vec3::splat(LARGEST)))
}
