//! Histories of the pixels, which follow the motion, and the features that come of them.
//!
//! A feature is the history of colors smoothed over the pixels around, without the color of this frame, so that the noise of
//! both is independent. Where alpha is known, which has much less noise than colors, the feature follows it: within the
//! pixels smoothed over, the history is taken as linear in the history of alpha, a guided filter (He, Sun & Tang 2013). So
//! outlines stay sharp that smoothing alone would blur.

use super::detail::{self, Noise};
use super::frame::{Frame, around};
use super::lanes::{LANES, Lanes, each};
use super::outline::Outline;
use super::vectors::{Colors, Features, vectors};
use crate::arch::Arch;
use glam::{Vec2, Vec3};

/// Numbers kept of a pixel: the history of its color and alpha, the count of its frames, and zeros up to a whole vector.
pub type Pixel = [f32; 8];

/// Numbers of a pixel that are not padding.
const PLANES: usize = 5;
const ALPHA: usize = 3;
const COUNT: usize = 4;

/// Planes that are smoothed: color, alpha, color times alpha, and alpha squared.
const SMOOTHED: usize = 8;

/// Greatest share of the history of colors in its next state.
const HISTORY: f32 = 0.8;
/// Greatest share of the history of alpha in its next state.
const ALPHA_HISTORY: f32 = 0.5;

/// Pixels to each side over which the history is smoothed: without alpha, and with it.
const RADII: [usize; 2] = [1, 4];
/// Rows above and below a row that its features depend on.
const HALO: usize = 4;
/// Rows of pixels that are held at a time.
const RING: usize = 2 * HALO;
/// Variance of alpha up to which features hardly follow it.
const LEAST_VARIANCE: f32 = 1e-8;

/// Numbers before and after the pixels of a line.
const MARGIN: usize = LANES;

/// Multiple of what is around above which a color is cut before it enters the history. That biases the feature, which need
/// not be without bias.
const HISTORY_LIMIT: f32 = 8.0;

/// Multiple of what is around above which a color is cut before it is learned: a path of that brightness would outweigh all
/// that was learned.
const COLOR_LIMIT: f32 = 64.0;

/// Largest number taken from a picture, so that no product overflows.
const LARGEST: f32 = 1e12;

/// Lines of numbers with margins, plane after plane, of the rows around the one at work.
#[derive(Debug, Default)]
struct Ring {
    planes: usize,
    line: usize,
    data: Vec<f32>,
}

impl Ring {
    fn resize(&mut self, planes: usize, line: usize) {
        (self.planes, self.line) = (planes, line);
        self.data.resize(RING * planes * line, 0.0);
    }

    /// Returns the lines of a row.
    #[inline(always)]
    fn row(&self, row: usize) -> &[f32] {
        let len = self.planes * self.line;
        &self.data[row % RING * len..][..len]
    }

    #[inline(always)]
    fn row_mut(&mut self, row: usize) -> &mut [f32] {
        let len = self.planes * self.line;
        &mut self.data[row % RING * len..][..len]
    }
}

/// Scratch of [`Histories::band`].
#[derive(Debug, Default)]
pub struct BandScratch {
    /// Reprojected pixels, and what is smoothed besides.
    warped: Ring,
    /// Sums over three rows.
    triples: Ring,
    /// Sums over all rows of a neighbourhood.
    sums: Vec<f32>,
    /// Largest color around the pixels of a row.
    around: Vec<Lanes>,
    /// Means over few pixels, how opaque all around is, and sums of both.
    near: Vec<Features>,
    opaque: Vec<Lanes>,
    apart: Vec<[f32; 2]>,
}

/// Rows of a picture that are written: the next state of the histories, the features, and the colors to be learned.
#[derive(Debug)]
pub struct Rows<'r> {
    pub pixels: &'r mut [Pixel],
    pub features: &'r mut [Features],
    pub colors: &'r mut [Colors],
}

/// Features of a row that alpha guides, and what they are mixed from.
struct Guided<'g> {
    features: &'g mut [Features],
    /// Largest color around the pixels.
    around: &'g mut [Lanes],
    /// Means over small neighbourhoods.
    near: &'g mut [Features],
    /// Share of the small neighbourhoods that counts, by how opaque the large ones are.
    opaque: &'g mut [Lanes],
}

/// Histories of the frame before, beside the frame that comes.
#[derive(Debug, Clone, Copy)]
pub struct Histories<'h> {
    /// Empty before the first frame.
    pixels: &'h [Pixel],
    pub frame: &'h Frame<'h>,
    outline: Outline<'h>,
    noise: Option<Noise<'h>>,
    pub arch: Arch,
}

impl<'h> Histories<'h> {
    /// Places a frame beside the histories of the one before and the noise that is known of it.
    pub fn new(pixels: &'h [Pixel], frame: &'h Frame<'h>, noise: Option<Noise<'h>>, arch: Arch) -> Self {
        Self { pixels, frame, outline: Outline::of(frame), noise, arch }
    }

    /// Follows the histories of a band of rows from `top` on.
    #[inline(always)]
    pub fn band(&self, top: usize, rows: Rows<'_>, scratch: &mut BandScratch) {
        let [width, height] = self.frame.size;
        let groups = vectors(width);
        let line = groups * LANES + 2 * MARGIN;
        let guided = self.outline.alpha.is_some();
        let smoothed = if guided { SMOOTHED } else { 3 };
        let BandScratch { warped, triples, sums, around, near, opaque, apart } = scratch;
        // Color times alpha and alpha squared follow the numbers of the pixels.
        warped.resize(PLANES + SMOOTHED - 4, line);
        triples.resize(SMOOTHED, line);
        sums.resize(SMOOTHED * line, 0.0);
        around.resize(groups, Lanes::ZERO);
        near.resize(groups, Features::default());
        opaque.resize(groups, Lanes::ZERO);
        let count = rows.pixels.len() / width;
        for step in 0..count + 2 * HALO {
            let y = (top + step).saturating_sub(HALO).min(height - 1);
            self.warp(y, warped.row_mut(step), line, guided);
            if step < 2 {
                continue;
            }
            let parts = [step - 2, step - 1, step].map(|row| warped.row(row));
            for plane in 0..smoothed {
                let from = plane_of(plane) * line;
                let to = &mut triples.row_mut(step - 1)[plane * line..][..line];
                add(parts.map(|part| &part[from..][..line]), to);
            }
            let Some(row) = step.checked_sub(2 * HALO) else { continue };
            let centre = step - HALO;
            let parts = [centre - 3, centre, centre + 3].map(|row| triples.row(row));
            for plane in 0..smoothed {
                let [above, here, below] = parts.map(|part| &part[plane * line..][..line]);
                let to = &mut sums[plane * line..][..line];
                if guided { add([above, here, below], to) } else { to.copy_from_slice(here) }
            }
            let features = &mut rows.features[row * groups..][..groups];
            let pixels = warped.row(centre);
            match guided {
                true => {
                    let few = triples.row(centre);
                    let to = Guided { features, around, near, opaque };
                    let any = self.guided(top + row, pixels, [few, sums], to);
                    if let Some(noise) = self.noise.filter(|_| any) {
                        detail::mix(top + row, features, near, opaque, noise, apart);
                    }
                }
                false => smoothed_alone(sums, line, features, around),
            }
            let colors = &mut rows.colors[row * groups..][..groups];
            self.follow(top + row, pixels, around, colors, &mut rows.pixels[row * width..][..width]);
        }
    }

    /// Reprojects a row of pixels to lines, with the outermost ones repeated in their margins.
    #[inline(always)]
    fn warp(&self, y: usize, lines: &mut [f32], line: usize, guided: bool) {
        let [width, _] = self.frame.size;
        let motion = self.frame.motion.map(|motion| &motion[y * width..][..width]);
        for left in (0..width).step_by(LANES) {
            let mut found = [[0.0; LANES]; LANES];
            for (x, found) in (left..width).zip(&mut found) {
                *found = self.before([x, y], motion.map_or(Vec2::ZERO, |motion| motion[x]));
            }
            let planes = self.arch.transposed(&found);
            for plane in 0..PLANES {
                Lanes(planes[plane]).store(lines, plane * line + MARGIN + left);
            }
            if guided {
                for c in 0..4 {
                    let product = Lanes(planes[c]) * Lanes(planes[ALPHA]);
                    product.store(lines, (PLANES + c) * line + MARGIN + left);
                }
            }
        }
        for line in lines.chunks_mut(line) {
            let [first, last] = [line[MARGIN], line[MARGIN + width - 1]];
            line[..MARGIN].fill(first);
            line[MARGIN + width..].fill(last);
        }
    }

    /// Returns a pixel as it was in the frame before, or as it is now if it was not seen.
    #[inline(always)]
    fn before(&self, [x, y]: [usize; 2], motion: Vec2) -> Pixel {
        if !self.pixels.is_empty() {
            if motion == Vec2::ZERO {
                return self.pixels[y * self.frame.size[0] + x];
            }
            if let Some(found) = around(self.frame.size, Vec2::new(x as f32, y as f32) + motion) {
                let pixel = found.sum(self.pixels);
                return if found.covered == 1.0 { pixel } else { each(|i| pixel[i] / found.covered) };
            }
        }
        let [r, g, b] = self.calm([x, y]).to_array();
        let alpha = self.outline.alpha.map_or(0.0, |alpha| alpha[y * self.frame.size[0] + x]);
        [r, g, b, if alpha.is_finite() { alpha.clamp(0.0, 1.0) } else { 0.0 }, 0.0, 0.0, 0.0, 0.0]
    }

    /// Returns the color of a pixel, cut where it is far above those around: what a history begins with.
    fn calm(&self, [x, y]: [usize; 2]) -> Vec3 {
        let [width, height] = self.frame.size;
        let (mut sum, mut count) = (Vec3::ZERO, 0.0);
        for row in y.saturating_sub(1)..(y + 2).min(height) {
            for column in x.saturating_sub(1)..(x + 2).min(width) {
                let color = within(self.frame.color[row * width + column]);
                if let Some(color) = color.filter(|_| [column, row] != [x, y]) {
                    sum += color;
                    count += 1.0;
                }
            }
        }
        let around = sum / f32::max(count, 1.0);
        let own = within(self.frame.color[y * width + x]).unwrap_or(around);
        let most = HISTORY_LIMIT * around.max_element();
        own * (most / own.max_element().max(1e-30)).clamp(0.0, 1.0)
    }

    /// Returns the alphas of eight pixels of a row from `left` on.
    #[inline(always)]
    fn alphas(&self, y: usize, left: usize) -> Lanes {
        let [width, _] = self.frame.size;
        let row = self.outline.alpha.map_or(&[][..], |alpha| &alpha[y * width..][..width]);
        let mut alphas = Lanes::load(row, left);
        if left + LANES > row.len() {
            alphas = Lanes(each(|lane| row.get(left + lane).copied().unwrap_or(0.0)));
        }
        // Clamped, so that NaN becomes 0.
        alphas.max(Lanes::ZERO).min(Lanes([1.0; LANES]))
    }

    /// Writes the features of a row from the sums over small and large neighbourhoods. Returns true if any is opaque.
    #[inline(always)]
    fn guided(&self, y: usize, pixels: &[f32], [few, many]: [&[f32]; 2], to: Guided<'_>) -> bool {
        let Guided { features, around, near, opaque } = to;
        let line = pixels.len() / (PLANES + SMOOTHED - 4);
        let proportional = self.outline.proportional;
        let mut most = Lanes::ZERO;
        let rows = features.iter_mut().zip(around).zip(near.iter_mut().zip(opaque)).enumerate();
        for (at, ((features, around), (near, opaque))) in rows {
            let left = at * LANES;
            let mut means = [Lanes::ZERO; SMOOTHED];
            for (mean, sums) in means.iter_mut().zip(many.chunks_exact(line)) {
                *mean = mean_of::<{ RADII[1] }>(sums, left);
            }
            let mut small = [Lanes::ZERO; 4];
            for (mean, sums) in small.iter_mut().zip(few.chunks_exact(line)) {
                *mean = mean_of::<{ RADII[0] }>(sums, left);
            }
            let [r, g, b, a, .., aa] = means;
            let before = Lanes::load(pixels, ALPHA * line + MARGIN + left);
            let count = Lanes::load(pixels, COUNT * line + MARGIN + left);
            let alpha = mixed(before, count, self.alphas(y, left));
            // The slope of colors on alpha; as far as alpha varies little, colors count as proportional to it.
            let variance = (aa - a * a).max(Lanes::ZERO) + a * a * proportional + LEAST_VARIANCE;
            for c in 0..3 {
                let slope = (means[4 + c] - means[c] * a * (1.0 - proportional)) / variance;
                features[c] = means[c] + slope * (alpha - a);
                near[c] = small[c] + slope * (alpha - small[ALPHA]);
            }
            *opaque = detail::opaqueness(a);
            most = most.max(*opaque);
            *around = r.max(g).max(b).max(features[0].max(features[1]).max(features[2]));
        }
        most != Lanes::ZERO
    }

    /// Takes a row's colors to planes, cut where they are far above what is around, and writes the next state of its
    /// histories. The fourth plane is 1 where there is a color.
    #[inline(always)]
    fn follow(&self, y: usize, lines: &[f32], around: &[Lanes], colors: &mut [Colors], pixels: &mut [Pixel]) {
        let [width, _] = self.frame.size;
        let line = lines.len() / (PLANES + SMOOTHED - 4);
        let row = &self.frame.color[y * width..][..width];
        let one = Lanes([1.0; LANES]);
        let groups = row.chunks(LANES).zip(pixels.chunks_mut(LANES)).zip(around.iter().zip(colors)).enumerate();
        for (at, ((row, pixels), (around, colors))) in groups {
            let (color, seen) = loaded(row);
            let most = color[0].max(color[1]).max(color[2]).max(Lanes([1e-30; LANES]));
            let cut = |limit: f32| (*around * limit).select((*around * limit / most).min(one), one);
            let learned = cut(COLOR_LIMIT);
            *colors = [color[0] * learned, color[1] * learned, color[2] * learned, seen];
            let followed = cut(HISTORY_LIMIT);
            let mut before = [Lanes::ZERO; PLANES];
            for (before, line) in before.iter_mut().zip(lines.chunks_exact(line)) {
                *before = Lanes::load(line, MARGIN + at * LANES);
            }
            let count = before[COUNT];
            let keep = (count / (count + 1.0)).min(Lanes([HISTORY; LANES]));
            let mut next = [[0.0; LANES]; LANES];
            for c in 0..3 {
                next[c] = seen.select(before[c] * keep + color[c] * followed * (one - keep), before[c]).0;
            }
            next[ALPHA] = mixed(before[ALPHA], count, self.alphas(y, at * LANES)).0;
            next[COUNT] = (count + seen).min(Lanes([64.0; LANES])).0;
            for (pixel, next) in pixels.iter_mut().zip(self.arch.transposed(&next)) {
                *pixel = next;
            }
        }
    }
}

/// Returns the line of the warped pixels that a smoothed plane is of.
#[inline(always)]
fn plane_of(smoothed: usize) -> usize {
    // The count of frames is not smoothed.
    if smoothed > ALPHA { smoothed + 1 } else { smoothed }
}

/// Returns the history of alpha with the alpha of the frame.
#[inline(always)]
fn mixed(before: Lanes, count: Lanes, now: Lanes) -> Lanes {
    let keep = (count / (count + 1.0)).min(Lanes([ALPHA_HISTORY; LANES]));
    now + (before - now) * keep
}

/// Returns the channels of up to eight colors whose numbers are small enough to be multiplied, and 1 where they are finite;
/// 0 elsewhere.
#[inline(always)]
fn loaded(row: &[Vec3]) -> ([Lanes; 3], Lanes) {
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

/// Writes the sums of three lines.
#[inline(always)]
fn add(parts: [&[f32]; 3], to: &mut [f32]) {
    let [a, b, c] = parts.map(|part| part.as_chunks::<LANES>().0);
    for (((a, b), c), to) in a.iter().zip(b).zip(c).zip(to.as_chunks_mut::<LANES>().0) {
        *to = ((Lanes(*a) + Lanes(*b)) + Lanes(*c)).0;
    }
}

/// Returns the means over the neighbourhoods of eight pixels from `left` on, from the sums of its columns.
#[inline(always)]
fn mean_of<const RADIUS: usize>(sums: &[f32], left: usize) -> Lanes {
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

/// Writes features that no alpha guides.
#[inline(always)]
fn smoothed_alone(sums: &[f32], line: usize, features: &mut [Features], around: &mut [Lanes]) {
    for (at, (features, around)) in features.iter_mut().zip(around).enumerate() {
        for (feature, sums) in features.iter_mut().zip(sums.chunks_exact(line)) {
            *feature = mean_of::<{ RADII[0] }>(sums, at * LANES);
        }
        *around = features[0].max(features[1]).max(features[2]);
    }
}
