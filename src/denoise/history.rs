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
const HISTORY: f32 = 0.85;
/// Greatest share of the history of alpha in its next state.
const ALPHA_HISTORY: f32 = 0.5;

/// Multiple of what is around above which a color is cut before it enters the history. That biases the feature, which
/// need not be without bias.
const HISTORY_LIMIT: f32 = 8.0;

/// Multiple of what is around above which a color is cut before it is learned: a path of that brightness would outweigh
/// all that was learned.
const COLOR_LIMIT: f32 = 64.0;

/// Largest number taken from a picture, so that no product overflows.
const LARGEST: f32 = 1e12;

/// Histories of all pixels after a frame.
#[derive(Debug, Clone, Default)]
pub struct Past {
    /// The history of each pixel's color and alpha, the count of its frames, and the color of the frame alone. Empty
    /// before the first frame.
    pub pixels: Vec<Packed>,
    /// Coding of the colors.
    pub coding: Coding,
}

/// Returns the coding of the histories that begin with a frame.
pub fn coding_of_first(frame: &Frame<'_>) -> Coding {
    let [width, height] = frame.size;
    let of = |[least, most]: [f32; 2], color: Vec3| [least.min(color.min_element()), most.max(color.max_element())];
    let row = |y: usize| (0..width).map(|x| calm(frame, [x, y])).fold([0.0; 2], of);
    // The least and the greatest of numbers do not depend on their order.
    Coding::of((0..height).into_par_iter().map(row).reduce(|| [0.0; 2], |a, b| [a[0].min(b[0]), a[1].max(b[1])]))
}

/// Histories of the frame before, beside the frame that comes.
#[derive(Debug, Clone, Copy)]
pub struct Histories<'h> {
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
    pub fn warp(&self, y: usize, lines: &mut [f32], line: usize) {
        let [width, _] = self.frame.size;
        let motion = self.frame.motion.map(|motion| &motion[y * width..][..width]);
        let coding = self.past.coding;
        for left in (0..width).step_by(LANES) {
            let mut found = [[0.0; LANES]; LANES];
            for (x, found) in (left..width).zip(&mut found) {
                *found = self.before([x, y], motion.map_or(Vec2::ZERO, |motion| motion[x]));
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
    fn before(&self, [x, y]: [usize; 2], motion: Vec2) -> [f32; LANES] {
        let Past { pixels, coding } = self.past;
        let own = y * self.frame.size[0] + x;
        if !pixels.is_empty() {
            if motion == Vec2::ZERO {
                return packed::unpack(&pixels[own]).0;
            }
            let place = Vec2::new(x as f32, y as f32) + motion;
            if let Some(taps) = Taps::around(self.frame.size, place) {
                return packed::resampled(pixels, self.frame.size[0], &taps).0;
            }
            if let Some(found) = around(self.frame.size, place) {
                let shares = found.share.map(|share| share / found.covered);
                return packed::mean(found.at.map(|place| &pixels[place]), shares).0;
            }
        }
        let [r, g, b] = calm(self.frame, [x, y]).to_array();
        let coded = coding.encode(Lanes([r, g, b, 0.0, 0.0, 0.0, 0.0, 0.0])).0;
        let alpha = self.frame.alpha.map_or(0.0, |alpha| alpha[own]);
        let alpha = if alpha.is_finite() { alpha.clamp(0.0, 1.0) } else { 0.0 };
        [coded[0], coded[1], coded[2], alpha, 0.0, 0.0, 0.0, 0.0]
    }

    /// Returns the alphas of eight pixels of a row from `left` on.
    #[inline(always)]
    pub fn alphas(&self, y: usize, left: usize) -> Lanes {
        let [width, _] = self.frame.size;
        let row = self.frame.alpha.map_or(&[][..], |alpha| &alpha[y * width..][..width]);
        let mut alphas = Lanes::load(row, left);
        if left + LANES > row.len() {
            alphas = Lanes(each(|lane| row.get(left + lane).copied().unwrap_or(0.0)));
        }
        // Clamped, so that NaN becomes 0.
        alphas.max(Lanes::ZERO).min(Lanes([1.0; LANES]))
    }

    /// Takes a row's colors to planes, cut where they are far above what is around, and writes the next state of its
    /// histories, and the differences from the frame before. The fourth plane is 1 where there is a color. Returns the
    /// least and the greatest colors of the next state, in some order.
    #[inline(always)]
    pub fn follow(
        &self,
        y: usize,
        lines: &[f32],
        around: &[Lanes],
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
            let followed = cut(HISTORY_LIMIT);
            let mut before = [Lanes::ZERO; STORED];
            for (before, line) in before.iter_mut().zip(lines.chunks_exact(line)) {
                *before = Lanes::load(line, MARGIN + at * LANES);
            }
            let count = before[COUNT];
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
pub fn with_alpha(before: Lanes, count: Lanes, now: Lanes) -> Lanes {
    let keep = (count / (count + 1.0)).min(Lanes([ALPHA_HISTORY; LANES]));
    now + (before - now) * keep
}

/// Returns the channels of up to eight colors whose numbers are small enough to be multiplied, and 1 where they are
/// finite; 0 elsewhere.
#[inline(always)]
pub fn loaded(row: &[Vec3]) -> ([Lanes; 3], Lanes) {
    let mut color = [Lanes([f32::NAN; LANES]); 3];
    for (lane, found) in row.iter().enumerate().take(LANES) {
        color[0].0[lane] = found.x;
        color[1].0[lane] = found.y;
        color[2].0[lane] = found.z;
    }
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
