//! Features: histories smoothed over the pixels around.
//!
//! Where alpha is known, which has much less noise than colors, the feature follows it: within the pixels smoothed
//! over, the history is taken as linear in the history of alpha, a guided filter (He, Sun & Tang 2013). So outlines
//! stay sharp that smoothing alone would blur.

use super::ahead::Ahead;
use super::blocks::BLOCK;
use super::detail;
use super::difference::Halved;
use super::history::{Histories, with_alpha};
use super::illumination::Illumination;
use super::lanes::{LANES, Lanes};
use super::layout::{ALPHA, COUNT, MARGIN, PLANES, STORED, fill_margins, line_of};
use super::outline::Outline;
use super::packed::Packed;
use super::ring::{HALO, Ring, add, count_of, mean_of};
use super::vectors::{Colors, Features, vectors};

/// Planes that are smoothed: color, alpha, color times alpha, and alpha squared. Without alpha it is color alone.
const SMOOTHED: usize = 8;
/// Planes of products with alpha.
const PRODUCTS: usize = 4;

/// Pixels to each side over which histories are smoothed: without alpha, and with it.
const RADII: [usize; 2] = [1, 4];
/// Variance of alpha up to which features hardly follow it.
const LEAST_VARIANCE: f32 = 1e-8;

/// Scratch of [`Smoothing::band`].
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    /// Reprojected pixels; the means of both histories, if there are two; products with alpha.
    planes: Ring,
    /// Sums over three rows.
    triples: Ring,
    /// Sums over all rows of a neighbourhood.
    sums: Vec<f32>,
    /// Largest color around the pixels of a row.
    around: Vec<Lanes>,
}

/// Rows of a picture that are written: the next state of the histories, the features, and the colors to be learned.
#[derive(Debug)]
pub(crate) struct Rows<'r> {
    pub pixels: &'r mut [Packed],
    pub features: &'r mut [Features],
    /// Means of the histories over few pixels, and the histories themselves.
    pub histories: &'r mut [detail::Histories],
    pub colors: &'r mut [Colors],
    /// Differences from the frame before.
    pub differences: &'r mut [Halved],
}

/// Features of a row, and the histories behind them, as smoothing writes them.
struct Taken<'g> {
    features: &'g mut [Features],
    histories: &'g mut [detail::Histories],
    /// Largest color around the pixels.
    around: &'g mut [Lanes],
}

/// Histories to be smoothed, and what guides that.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Smoothing<'s> {
    pub histories: Histories<'s>,
    /// Histories over the frames that follow.
    pub ahead: Option<&'s Ahead>,
    pub outline: Outline<'s>,
    /// Illumination up to the frame before.
    pub illumination: &'s Illumination,
}

impl Smoothing<'_> {
    /// Place of the planes of the history that is smoothed among a row's planes.
    #[inline(always)]
    fn history(&self) -> usize {
        if self.ahead.is_some() { STORED } else { 0 }
    }

    /// Returns the line of a plane that is smoothed.
    #[inline(always)]
    fn plane(&self, smoothed: usize) -> usize {
        // Products lie behind what is stored, of which neither the count nor the color alone is smoothed.
        self.history() + if smoothed > ALPHA { smoothed + STORED - ALPHA - 1 } else { smoothed }
    }

    /// Follows the histories of a band of rows from `top` on, and takes the features from them. Returns the least and
    /// the largest color of the histories.
    #[inline(always)]
    pub(crate) fn band(&self, top: usize, rows: Rows<'_>, scratch: &mut Scratch) -> [f32; 2] {
        let [width, height] = self.histories.frame.size;
        let (groups, line) = (vectors(width), line_of(width));
        let guided = self.outline.alpha.is_some();
        let smoothed = if guided { SMOOTHED } else { 3 };
        let Scratch { planes, triples, sums, around } = scratch;
        planes.resize(self.history() + STORED + PRODUCTS, line);
        triples.resize(SMOOTHED, line);
        sums.resize(SMOOTHED * line, 0.0);
        around.resize(groups, Lanes::ZERO);
        let count = rows.pixels.len() / width;
        let mut extremes = [Lanes::ZERO; 2];
        for step in 0..count + 2 * HALO {
            let y = (top + step).saturating_sub(HALO).min(height - 1);
            self.prepare(y, planes.row_mut(step));
            if step < 2 {
                continue;
            }
            let parts = [step - 2, step - 1, step].map(|row| planes.row(row));
            for plane in 0..smoothed {
                let from = self.plane(plane) * line;
                let to = &mut triples.row_mut(step - 1)[plane * line..][..line];
                add(parts.map(|part| &part[from..][..line]), to);
            }
            let Some(row) = step.checked_sub(2 * HALO) else { continue };
            let centre = step - HALO;
            let parts = [centre - 3, centre, centre + 3].map(|row| triples.row(row));
            if guided {
                add(parts.map(|part| &part[..SMOOTHED * line]), sums);
            }
            let features = &mut rows.features[row * groups..][..groups];
            let histories = &mut rows.histories[row * groups..][..groups];
            let to = Taken { features, histories, around };
            let pixels = planes.row(centre);
            let few = triples.row(centre);
            if guided {
                self.guided(top + row, pixels, [few, sums], to);
            } else {
                self.alone(pixels, few, to);
            }
            let colors = &mut rows.colors[row * groups..][..groups];
            let next = &mut rows.pixels[row * width..][..width];
            let differences = &mut rows.differences[row * groups..][..groups];
            let around = (&around[..], count_of(RADII[usize::from(guided)]));
            let [least, most] = self.histories.follow(top + row, pixels, around, colors, (next, differences));
            extremes = [extremes[0].min(least), extremes[1].max(most)];
        }
        [extremes[0].0.into_iter().fold(0.0, f32::min), extremes[1].0.into_iter().fold(0.0, f32::max)]
    }

    /// Writes the planes of a row: histories, and products with alpha.
    #[inline(always)]
    fn prepare(&self, y: usize, planes: &mut [f32]) {
        let [width, _] = self.histories.frame.size;
        let line = line_of(width);
        self.histories.warp(y, planes, line);
        if let Some(ahead) = self.ahead {
            let (before, joined) = planes.split_at_mut(STORED * line);
            ahead.join(y, self.illumination.trend(y / BLOCK), before, line, joined);
            for line in joined.chunks_mut(line).take(PLANES) {
                fill_margins(line, width);
            }
        }
        if self.outline.alpha.is_some() {
            let (history, products) = planes[self.history() * line..].split_at_mut(STORED * line);
            let alpha = history[ALPHA * line..].as_chunks::<LANES>().0;
            for (history, to) in history.chunks_exact(line).zip(products.chunks_exact_mut(line)) {
                let numbers = history.as_chunks::<LANES>().0.iter().zip(alpha);
                for (to, (number, alpha)) in to.as_chunks_mut::<LANES>().0.iter_mut().zip(numbers) {
                    *to = (Lanes(*number) * Lanes(*alpha)).0;
                }
            }
        }
    }

    /// Takes the features of a row from the sums over small and large neighbourhoods.
    #[inline(always)]
    fn guided(&self, y: usize, pixels: &[f32], [few, many]: [&[f32]; 2], to: Taken<'_>) {
        let Taken { features, histories, around } = to;
        let line = line_of(self.histories.frame.size[0]);
        let history = &pixels[self.history() * line..][..PLANES * line];
        let proportional = self.outline.proportional;
        for (at, ((features, histories), around)) in features.iter_mut().zip(histories).zip(around).enumerate() {
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
            let own = |plane: usize| Lanes::load(history, plane * line + MARGIN + left);
            let before = own(ALPHA);
            let alpha = with_alpha(before, own(COUNT), self.histories.alphas(y, left));
            // The slope of colors on alpha; as far as alpha varies little, colors count as proportional to it.
            let variance = (aa - a * a).max(Lanes::ZERO) + a * a * proportional + LEAST_VARIANCE;
            let inverse = Lanes([1.0; LANES]) / variance;
            for c in 0..3 {
                let slope = (means[4 + c] - means[c] * a * (1.0 - proportional)) * inverse;
                features[c] = means[c] + slope * (alpha - a);
                histories.near[c] = small[c] + slope * (alpha - small[ALPHA]);
                histories.own[c] = own(c) + slope * (alpha - before);
            }
            histories.known = own(COUNT).select(Lanes([1.0; LANES]), Lanes::ZERO);
            *around = r.max(g).max(b).max(features[0].max(features[1]).max(features[2]));
        }
    }

    /// Takes the features of a row that no alpha guides.
    #[inline(always)]
    fn alone(&self, pixels: &[f32], sums: &[f32], to: Taken<'_>) {
        let Taken { features, histories, around } = to;
        let line = line_of(self.histories.frame.size[0]);
        let history = &pixels[self.history() * line..][..PLANES * line];
        for (at, ((features, histories), around)) in features.iter_mut().zip(histories).zip(around).enumerate() {
            for (c, sums) in sums.chunks_exact(line).enumerate().take(3) {
                features[c] = mean_of::<{ RADII[0] }>(sums, at * LANES);
                histories.near[c] = features[c];
                histories.own[c] = Lanes::load(history, c * line + MARGIN + at * LANES);
            }
            let count = Lanes::load(history, COUNT * line + MARGIN + at * LANES);
            histories.known = count.select(Lanes([1.0; LANES]), Lanes::ZERO);
            *around = features[0].max(features[1]).max(features[2]);
        }
    }
}
