//! Noise of a frame, beside the residual that a denoiser leaves: sums over blocks of pixels.
//!
//! Three estimates are summed. The frames before and after show the same signal, and so the product of a pixel's
//! differences from both is on average the square of its noise ([`difference`]). Second differences in both directions
//! show it where the picture is smooth. The nearest in color of the four pixels around shows it beside edges, too,
//! since one of them lies on the same side; it holds for noise that is independent from pixel to pixel and takes many
//! values, and is calibrated by the first ([`Calibration`](super::signal::Calibration)).
//!
//! What the light changes is taken out of the differences ([`illumination`]). Where the frames do not show the same
//! signal for other reasons, because motion is wrong or missing or resampling loses texture, the squares of the
//! differences are not what noise explains of them. That excess is summed, too.

use super::blocks::{BLOCK, Grid, Planes};
use super::carried::{carry, to_planes};
use super::difference::{self, CHANNELS, Difference, Halved};
use super::estimate;
use super::frame::Frame;
use super::history::loaded;
use super::illumination;
use super::lanes::{LANES, Lanes, dot, each};
use super::layout::{MARGIN, line_of};
use super::reprojection::noise_gain;
use super::vectors::{Features, vectors};
use crate::arch::Arch;
use glam::Vec2;

/// Numbers of a block: sums over the pixels of this frame; sums over those of all frames that count, older ones by
/// less; and those of this frame that are added to them.
pub(crate) const SUMS: usize = 3 * LANES;
/// Sums of a block.
pub(crate) type Sums = [f32; SUMS];

/// Place of the noise's square by the product of two differences.
pub(crate) const NOISE: usize = 0;
/// Place of the noise's square by a difference's own.
pub(crate) const DIRECT: usize = 1;
/// Place of the residual's square.
pub(crate) const RESIDUAL: usize = 2;
/// Place of the square of each pixel's noise, from which the variance of the sum follows.
pub(crate) const CHANCE: usize = 3;
/// Place of the squares of the differences, less what the noise explains of them.
pub(crate) const EXCESS: usize = 4;
/// Places of the noise's square by the second differences around, by the nearest pixel, and of the residual's, of the
/// sum of the channels.
pub(crate) const LIGHT_NOISE: usize = 5;
pub(crate) const LIGHT_NEAREST: usize = 6;
pub(crate) const LIGHT: usize = 7;

/// First places of the sums of all frames, and of those of this frame that are added to them. Both have noise,
/// residual, chance and excess where the sums of this frame have them. The excess is that of pixels that are known on
/// both sides of time; the pixels of a last frame, known before alone, count in none.
pub(crate) const SINCE: usize = LANES;
pub(crate) const ADDED: usize = 2 * LANES;
/// Place among them of the square of each pixel's excess.
pub(crate) const EXCESS_CHANCE: usize = 1;
/// Places among them of the squares of noise and residual that are no shares of the colors, and of the count, over
/// pixels that are known on both sides of time.
pub(crate) const NOISE_POWER: usize = 5;
pub(crate) const RESIDUAL_POWER: usize = 6;
pub(crate) const PIXELS: usize = 7;

/// Distance in pixels of those around of which the second difference is taken: filters make noise of neighbours alike.
const STEP: usize = 2;
/// Sum of the squares of the kernel of second differences in both directions.
pub(crate) const KERNEL: f32 = 36.0;
/// Variance of Gaussian noise over the mean of the least square of the differences from four neighbours.
pub(crate) const NEAREST: f32 = 2.58;
/// Weight of pixels of which no difference is known: they count where no others are, and their residual counts as
/// noise.
const UNKNOWN: f32 = 1e-4;

/// A frame as the models predict it, and what it was predicted from.
#[derive(Debug, Clone, Copy)]
pub(super) struct Filtered<'d> {
    pub frame: &'d Frame<'d>,
    pub grid: Grid,
    /// Mean motions of the blocks.
    pub motions: &'d [Vec2],
    /// Degrees of freedom of the models of the blocks, as shares of the samples that they rest on: of their own noise
    /// denoised colors hold that much.
    pub own: &'d Planes,
    /// Filtered colors, row by row.
    pub colors: &'d [Features],
    /// Differences from the frame before, row by row.
    pub before: &'d [Halved],
    /// Changes of illumination, by block.
    pub illumination: &'d Planes,
    /// True if an alpha guided the denoised colors, which are means over more pixels then.
    pub guided: bool,
    /// Alpha of the frame, if it is exact.
    pub alpha: Option<&'d [f32]>,
    /// Added to the squares of colors before errors are taken as shares of them.
    pub floor: f32,
    /// Share of the sums that is kept.
    pub kept: f32,
    /// True where no other frame was learned from: the colors' own noise is in what was denoised then.
    pub alone: bool,
    /// True where the frames that follow have told the noise already: this one, known on one side alone, adds nothing.
    pub told: bool,
    /// True if maps of noise and error are wanted.
    pub mapped: bool,
}

/// Learns a row of blocks.
pub(crate) struct Learn<'a> {
    pub filtered: &'a Filtered<'a>,
    /// Sums after the frame before; empty at the first frame.
    pub before: &'a [Sums],
    pub row: usize,
    /// Sums of the channels, of the rows around, too.
    pub light: &'a mut Vec<f32>,
    pub blocks: &'a mut [Sums],
    pub planes: &'a mut [f32],
}

impl pulp::NullaryFnOnce for Learn<'_> {
    type Output = estimate::Row;

    #[inline(always)]
    fn call(self) -> estimate::Row {
        let Self { filtered, before, row, light, blocks, planes } = self;
        let Filtered { frame, grid, motions, kept, told, .. } = *filtered;
        let top = row * BLOCK;
        sums_of_channels(frame, top, light);
        carry(motions, grid, before, row, blocks);
        let of_row = add(filtered, top, light, blocks);
        for sums in &mut *blocks {
            let added = if told { Lanes::ZERO } else { Lanes::load(sums, ADDED) };
            (Lanes::load(sums, SINCE) * kept + added).store(sums, SINCE);
        }
        to_planes(Arch::default(), blocks, planes, grid.stride());
        of_row
    }
}

/// Writes the sums of the channels of the rows that a row of blocks and those around it have, line after line. What
/// lies outside is not a number.
#[inline(always)]
fn sums_of_channels(frame: &Frame<'_>, top: usize, lines: &mut Vec<f32>) {
    let [width, height] = frame.size;
    let line = line_of(width);
    lines.resize((BLOCK + 2 * STEP) * line, f32::NAN);
    for (at, to) in lines.chunks_exact_mut(line).enumerate() {
        to.fill(f32::NAN);
        let Some(y) = (top + at).checked_sub(STEP).filter(|y| *y < height) else { continue };
        for (to, color) in to[MARGIN..].iter_mut().zip(&frame.color[y * width..][..width]) {
            *to = (color.x + color.y) + color.z;
        }
    }
}

/// Writes the sums of the pixels of a row of blocks. Returns those of the row.
#[inline(always)]
fn add(filtered: &Filtered<'_>, top: usize, light: &[f32], blocks: &mut [Sums]) -> estimate::Row {
    let Filtered { frame, grid, motions, colors, before, illumination, floor, .. } = *filtered;
    let motions = motions.get(top / BLOCK * grid.columns..).unwrap_or_default();
    let [width, height] = frame.size;
    let (groups, line) = (vectors(width), line_of(width));
    let count = BLOCK.min(height - top);
    let mut of_row = estimate::Row::default();
    for (at, blocks) in blocks.chunks_mut(LANES / BLOCK).enumerate() {
        let gain = |of: usize| motions.get(at * (LANES / BLOCK) + of).map_or(1.0, |motion| noise_gain(*motion));
        let gains: [f32; LANES / BLOCK] = each(gain);
        let gains = Lanes(each(|lane| gains[lane / BLOCK]));
        let changes = [illumination::BEFORE, illumination::AFTER].map(|side| {
            let changes = &illumination.row(top / BLOCK, side)[at * (LANES / BLOCK)..];
            Lanes(each(|lane| changes[lane / BLOCK]))
        });
        let mut all = [[Lanes::ZERO; LANES]; 2];
        let [mut powers, mut apart] = [Lanes::ZERO; 2];
        let mut differences = [[Lanes::ZERO; 3]; 2];
        for row in 0..count {
            let pixels = &frame.color[(top + row) * width..][..width][at * LANES..];
            let (color, seen) = loaded(&pixels[..LANES.min(pixels.len())]);
            let found = &colors[(top + row) * groups + at];
            let before = difference::whole(&before[(top + row) * groups + at]);
            let after = match frame.ahead {
                Some(ahead) => difference::whole(&ahead.differences[(top + row) * groups + at]),
                None => Difference::default(),
            };
            // Light that changes is no noise.
            let [before, after] = [(before, changes[0]), (after, changes[1])]
                .map(|(side, change)| difference::without(&side, change * side[CHANNELS], found));
            let residual: [Lanes; 3] = each(|c| (color[c] - found[c]) * seen);
            let power = dot(found, found);
            let weight = seen / (power + Lanes([floor; LANES]));
            let (both, own) = (seen * before[3] * after[3], mean_square(&before, &after));
            let around = around(&light[row * line..], line, MARGIN + at * LANES);
            let terms = terms(&residual, [&before, &after], own, gains, weight, around);
            for (sums, terms) in all.iter_mut().zip(terms) {
                for (sum, term) in sums.iter_mut().zip(terms) {
                    *sum += term;
                }
            }
            powers += power * both;
            apart += own * both;
            for (sums, side) in differences.iter_mut().zip([&before, &after]) {
                for (sum, channel) in sums.iter_mut().zip(side) {
                    *sum += *channel * both;
                }
            }
        }
        of_row.power += f64::from(powers.0.iter().sum::<f32>());
        of_row.apart += f64::from(apart.0.iter().sum::<f32>());
        for (sums_of, to) in all.iter().zip([0, ADDED]) {
            let pixels = Arch::default().transposed(&sums_of.map(|sum| sum.0));
            for (block, sums) in pixels.chunks(BLOCK).zip(&mut *blocks) {
                let sum = (Lanes(block[0]) + Lanes(block[1])) + (Lanes(block[2]) + Lanes(block[3]));
                sum.store(sums, to);
            }
        }
        for of in 0..blocks.len() {
            let of_block = |lanes: &Lanes| lanes.0[of * BLOCK..][..BLOCK].iter().sum::<f32>();
            let squares = differences.iter().flatten().map(|sum| f64::from(of_block(sum)).powi(2));
            of_row.pooled += 0.5 * squares.sum::<f64>();
        }
    }
    of_row
}

/// Returns the mean square of the differences from the sides of time that are known.
#[inline(always)]
fn mean_square(before: &Difference, after: &Difference) -> Lanes {
    (dot(before, before) + dot(after, after)) / (before[3] + after[3]).max(Lanes([1.0; LANES]))
}

/// Returns what eight pixels add to the sums of a frame, and to those of all frames: by their residual, the differences
/// from both sides of time and the mean square of these, the share of noise that resampling leaves, their weight, 0
/// where they are not seen, and what is [`around`] them.
#[inline(always)]
fn terms(
    residual: &[Lanes; 3],
    [before, after]: [&Difference; 2],
    own: Lanes,
    gains: Lanes,
    weight: Lanes,
    [shown, is_shown, nearest]: [Lanes; 3],
) -> [[Lanes; LANES]; 2] {
    let (one, unknown) = (Lanes([1.0; LANES]), Lanes([UNKNOWN; LANES]));
    let squares = dot(residual, residual);
    let [noise, direct] = noise(residual, squares, before, after);
    let both = weight.select(before[3] * after[3], Lanes::ZERO);
    let is_known = before[3].max(after[3]);
    let known = weight * is_known.max(unknown);
    let (chance, square) = (noise * known, squares * known);
    let excess = (own - noise * (gains + 1.0)) * weight * is_known;
    // Of a last frame, the frames before tell more.
    let counts = both.max(one - before[3]);
    let sum = (residual[0] + residual[1]) + residual[2];
    let (light, light_weight) = (sum * sum, weight * is_shown.max(unknown));
    let [shown, nearest] = [shown, nearest].map(|noise| is_shown.select(noise, light) * light_weight);
    [
        [chance, direct * known, square, chance * chance, excess, shown, nearest, light * light_weight],
        [
            chance * counts,
            excess * excess * both,
            square * counts,
            chance * chance * counts,
            excess * both,
            noise * both,
            squares * both,
            both,
        ],
    ]
}

/// Returns the square of the noise of eight pixels: by the product of the differences from both sides of time, where
/// both are known; else by that of residual and difference, and by half of the difference's own square; else the
/// residual's square.
#[inline(always)]
fn noise(residual: &[Lanes; 3], squares: Lanes, before: &Difference, after: &Difference) -> [Lanes; 2] {
    let ([a @ .., is_before], [b @ .., is_after]) = (before, after);
    let both = *is_before * *is_after;
    // What is not known is 0.
    let other = Lanes([1.0; LANES]) - *is_before;
    let one: [Lanes; 3] = each(|c| a[c] + b[c] * other);
    let any = is_before.max(*is_after);
    let product = dot(a, b);
    let of = |single: Lanes| both.select(product, any.select(single, squares));
    [of(dot(residual, &one)), of(dot(&one, &one) * 0.5)]
}

/// Returns the square of the noise of eight pixels by second differences, 1 where these are known, and the square by
/// the nearest of the four pixels around, from lines of the sums of the channels that begin above them.
#[inline(always)]
fn around(lines: &[f32], line: usize, left: usize) -> [Lanes; 3] {
    let at = |row: usize, column: usize| Lanes::load(lines, row * line + left + column - STEP);
    let second = |row: usize| (at(row, 0) + at(row, 2 * STEP)) - at(row, STEP) * 2.0;
    let both = (second(0) + second(2 * STEP)) - second(STEP) * 2.0;
    let own = at(STEP, STEP);
    let near = [(STEP - 1, STEP), (STEP, STEP - 1), (STEP, STEP + 1), (STEP + 1, STEP)];
    let nearest = near.into_iter().fold(Lanes([f32::INFINITY; LANES]), |least, (row, column)| {
        let apart = own - at(row, column);
        // What is not a number loses every comparison.
        (apart * apart).min(least)
    });
    let (noise, nearest) = (both * both / Lanes([KERNEL; LANES]), nearest * NEAREST);
    let known = Lanes(each(|lane| if (noise.0[lane] + nearest.0[lane]).is_finite() { 1.0 } else { 0.0 }));
    [known.select(noise, Lanes::ZERO), known, known.select(nearest, Lanes::ZERO)]
}
