//! The residual, what a frame's colors have over the denoised ones, and the share of it that is signal and comes back.
//!
//! The residual's square is on average the sum of the noise's and of the denoiser's error, since both are independent.
//! So the noise that the frames before and after show ([`difference`]) tells the error, whatever caused it: detail that
//! was smoothed away, histories of another shot or another light, motion that is wrong. The share that comes back, one
//! less noise over residual, leaves the least error (James & Stein 1961). It is 1 without noise, and 0 where the
//! denoiser leaves nothing.

use super::blocks::{BLOCK, Grid, Interpolated, Planes, Pool};
use super::carried::{carry, to_planes};
use super::difference::{self, Difference, Halved};
use super::estimate::{self, Estimate};
use super::frame::{self, Frame};
use super::history::loaded;
use super::lanes::{LANES, Lanes, each};
use super::layout::{MARGIN, line_of};
use super::vectors::{Features, vectors};
use crate::arch::Arch;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Sums of a block: those of this frame, and behind them those of all frames, older ones by less, and counts.
type Sums = [f32; 2 * LANES];

/// Place of the noise's square by the product of two differences.
const NOISE: usize = 0;
/// Place of the noise's square by a difference's own.
const DIRECT: usize = 1;
/// Place of the residual's square.
const RESIDUAL: usize = 2;
/// Place of the square of each pixel's noise, from which the variance of the sum follows.
const CHANCE: usize = 3;
/// Places of the square of the noise that the pixels around show, and of the residual's, of the sum of the channels.
const LIGHT_NOISE: usize = 4;
const LIGHT: usize = 5;
/// Places of the squares of noise and residual that are no shares of the colors, where both sides of time are known.
const NOISE_POWER: usize = 6;
const RESIDUAL_POWER: usize = 7;
/// Place of the sums of all frames.
const ALL: usize = LANES;
/// Places that have sums of all frames.
const SUMMED: [usize; 5] = [NOISE, RESIDUAL, CHANCE, NOISE_POWER, RESIDUAL_POWER];
/// Place of the count of pixels that both sides of time are known of, over all frames.
const PIXELS_SINCE: usize = ALL + 1;
/// Place of the same count in this frame.
const PIXELS: usize = ALL + 4;

/// Blocks to each side over which sums are pooled.
const POOL: usize = 2;
/// Standard deviations of the noise's square that are added to it, so that chance seldom takes noise for signal: of a
/// frame alone, which tells sudden errors, and of all.
const DEVIATIONS: [f32; 2] = [1.25, 0.75];
/// Shares of noise in the residual, by a difference's own square, between which the other estimate takes over where one
/// side of time is known.
const ONE_SIDED: [f32; 2] = [0.25, 0.45];
/// Distance in pixels of those around of which the second difference is taken: filters make noise of neighbours alike.
const STEP: usize = 2;
/// Sum of the squares of the kernel of second differences in both directions.
const KERNEL: f32 = 36.0;
/// Noise that pixels around show, as a multiple: texture is more often taken for noise than noise for texture.
const AROUND: f32 = 1.25;
/// Weight of pixels of which no difference is known: they count where no others are, and their residual counts as
/// noise.
const UNKNOWN: f32 = 1e-4;
/// Least residual, where there is none.
const LEAST: f32 = 1e-30;

/// Residuals of a sequence.
#[derive(Debug, Default)]
pub struct Residuals {
    blocks: Vec<Sums>,
    next: Vec<Sums>,
    sums: Planes,
    shares: Planes,
    /// Sums over rows of blocks.
    rows: Vec<estimate::Row>,
    /// Estimate of all frames, older ones by less.
    since: Estimate,
    /// Maps of noise and error, where they are wanted.
    maps: Planes,
}

/// A denoised frame, and what it was denoised from.
#[derive(Debug, Clone, Copy)]
pub struct Denoised<'d> {
    pub frame: &'d Frame<'d>,
    pub grid: Grid,
    /// Mean motions of the blocks.
    pub motions: &'d [Vec2],
    /// Degrees of freedom of the models of the blocks, as shares of the samples that they rest on: of their own noise
    /// denoised colors hold that much.
    pub own: &'d Planes,
    /// Denoised colors, row by row.
    pub colors: &'d [Features],
    /// Differences from the frame before, row by row.
    pub before: &'d [Halved],
    /// Alpha of the frame, if it counts.
    pub alpha: Option<&'d [f32]>,
    /// Added to the squares of colors before errors are taken as shares of them.
    pub floor: f32,
    /// Share of the sums that is kept.
    pub kept: f32,
    /// True where no other frame was learned from: the colors' own noise is in what was denoised then, and nothing
    /// comes back.
    pub alone: bool,
    /// True if maps of noise and error are wanted.
    pub mapped: bool,
}

impl Residuals {
    /// Writes the denoised colors with the signal that their residuals hold, and the estimate of what is left.
    pub fn give_back(&mut self, denoised: &Denoised<'_>, to: &mut frame::Denoised) {
        let Denoised { frame, grid, mapped, .. } = *denoised;
        if self.sums.row_len() != 2 * LANES * grid.stride() || self.next.len() != grid.rows * grid.columns {
            self.next = vec![[0.0; 2 * LANES]; grid.rows * grid.columns];
            self.sums = Planes::new(grid, 2 * LANES);
            self.shares = Planes::new(grid, 1);
            self.rows = vec![estimate::Row::default(); grid.rows];
            self.maps = Planes::new(if mapped { grid } else { Grid::default() }, estimate::MAPPED);
        }
        let Self { blocks, next, sums, shares, rows: of_rows, since, maps } = self;
        let before = &blocks[..];
        let planes = sums.data.par_chunks_mut(2 * LANES * grid.stride());
        let rows = next.par_chunks_mut(grid.columns).zip(planes).zip(of_rows.par_iter_mut()).enumerate();
        rows.with_min_len(2).for_each_init(Vec::new, |light, (row, ((blocks, planes), of_row))| {
            *of_row = Arch::default().dispatch(Learn { denoised, before, row, light, blocks, planes });
        });
        let sums = &*sums;
        let rows = shares.data.par_chunks_mut(grid.stride()).enumerate();
        rows.with_min_len(8).for_each_init(Pool::default, |pool, (row, shares)| {
            Arch::default().dispatch(Solve { sums, row, pool, shares });
        });
        if denoised.alone {
            shares.data.fill(0.0);
        }
        let shares = &*shares;
        let of_row = |row: usize| {
            let plane = |plane: usize| &sums.row(row, plane)[..grid.columns];
            let blocks = estimate::Blocks {
                pixels: plane(PIXELS),
                noise: plane(NOISE_POWER),
                residual: plane(RESIDUAL_POWER),
                shares: shares.row(row, 0),
                own: denoised.own.row(row, 0),
                motions: denoised.motions.get(row * grid.columns..).unwrap_or_default(),
            };
            Estimate::of_row(blocks, of_rows[row])
        };
        let estimates: Vec<Estimate> = (0..grid.rows).into_par_iter().map(of_row).collect();
        // In order, so that the sum is the same for any number of threads.
        let found = estimates.into_iter().fold(Estimate::default(), Estimate::plus);
        *since = since.plus_share(f64::from(denoised.kept), found);
        to.estimate = Some(found).filter(|found| found.pixels > 0.0);
        to.color.resize(frame.color.len(), Vec3::ZERO);
        let rows = to.color.par_chunks_mut(frame.size[0]).enumerate();
        rows.with_min_len(8).for_each_init(Interpolated::default, |interpolated, (row, to)| {
            Arch::default().dispatch(GiveBack { denoised, shares, row, interpolated, to });
        });
        if mapped {
            let planes = maps.data.par_chunks_mut(estimate::MAPPED * grid.stride()).enumerate();
            planes.for_each_init(Pool::default, |pool, (row, to)| {
                let which = [PIXELS_SINCE, ALL + NOISE_POWER, ALL + RESIDUAL_POWER].map(|plane| (plane, POOL));
                let (vectors, pooled) = pool.sums(sums, row, which.into_iter());
                let planes = [0, 1, 2].map(|plane| &pooled[plane * vectors..][..vectors]);
                estimate::map_row(planes, shares.row(row, 0), since.fits(), to);
            });
            let maps = &*maps;
            to.map.resize(frame.color.len(), [0.0; estimate::MAPPED]);
            let rows = to.map.par_chunks_mut(frame.size[0]).enumerate();
            rows.with_min_len(8).for_each_init(Interpolated::default, |interpolated, (row, to)| {
                interpolated.take(grid, row, maps);
                for (at, to) in to.chunks_mut(LANES).enumerate() {
                    let found: [Lanes; estimate::MAPPED] = [interpolated.at(0, at), interpolated.at(1, at)];
                    for (lane, to) in to.iter_mut().enumerate() {
                        *to = found.map(|plane| plane.0[lane]);
                    }
                }
            });
        }
        std::mem::swap(blocks, next);
        next.resize(blocks.len(), [0.0; 2 * LANES]);
    }
}

/// Learns a row of blocks.
struct Learn<'a> {
    denoised: &'a Denoised<'a>,
    /// Sums after the frame before; empty at the first frame.
    before: &'a [Sums],
    row: usize,
    /// Second differences along rows of the sums of the channels, of the rows around, too.
    light: &'a mut Vec<f32>,
    blocks: &'a mut [Sums],
    planes: &'a mut [f32],
}

impl pulp::NullaryFnOnce for Learn<'_> {
    type Output = estimate::Row;

    #[inline(always)]
    fn call(self) -> estimate::Row {
        let Self { denoised, before, row, light, blocks, planes } = self;
        let Denoised { frame, grid, motions, kept, .. } = *denoised;
        let top = row * BLOCK;
        second_differences(frame, top, light);
        carry(motions, grid, before, row, blocks);
        let of_row = add(denoised, top, &light[line_of(frame.size[0])..], blocks);
        for sums in &mut *blocks {
            for place in SUMMED {
                sums[ALL + place] = sums[ALL + place] * kept + sums[place];
            }
            sums[PIXELS_SINCE] = sums[PIXELS_SINCE] * kept + sums[PIXELS];
        }
        to_planes(Arch::default(), blocks, planes, grid.stride());
        of_row
    }
}

/// Writes the second differences along rows of the sums of the channels, of the rows that those in both directions
/// take, line after line. What lies outside is not a number.
#[inline(always)]
fn second_differences(frame: &Frame<'_>, top: usize, lines: &mut Vec<f32>) {
    let [width, height] = frame.size;
    let line = line_of(width);
    // A line more, for the sums themselves.
    lines.resize((BLOCK + 2 * STEP + 1) * line, f32::NAN);
    let (sums, lines) = lines.split_at_mut(line);
    sums.fill(f32::NAN);
    for (at, to) in lines.chunks_exact_mut(line).enumerate() {
        let Some(y) = (top + at).checked_sub(STEP).filter(|y| *y < height) else {
            to.fill(f32::NAN);
            continue;
        };
        for (to, color) in sums[MARGIN..].iter_mut().zip(&frame.color[y * width..][..width]) {
            *to = (color.x + color.y) + color.z;
        }
        for left in (MARGIN..MARGIN + width).step_by(LANES) {
            let at = |x: usize| Lanes::load(sums, x);
            ((at(left - STEP) + at(left + STEP)) - at(left) * 2.0).store(to, left);
        }
    }
}

/// Writes the sums of the pixels of a row of blocks. Returns those of the row.
#[inline(always)]
fn add(denoised: &Denoised<'_>, top: usize, light: &[f32], blocks: &mut [Sums]) -> estimate::Row {
    let Denoised { frame, colors, before, floor, .. } = *denoised;
    let [width, height] = frame.size;
    let (groups, line) = (vectors(width), line_of(width));
    let count = BLOCK.min(height - top);
    let mut of_row = estimate::Row::default();
    for (at, blocks) in blocks.chunks_mut(LANES / BLOCK).enumerate() {
        let mut sums = [Lanes::ZERO; LANES];
        let [mut pixels_of, mut powers, mut apart] = [Lanes::ZERO; 3];
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
            let residual: [Lanes; 3] = each(|c| (color[c] - found[c]) * seen);
            let squares = dot(&residual, &residual);
            let [noise, direct] = noise(&residual, squares, &before, &after);
            let power = dot(found, found);
            let weight = seen / (power + Lanes([floor; LANES]));
            let sum = (residual[0] + residual[1]) + residual[2];
            let (left, square) = (MARGIN + at * LANES, sum * sum);
            let [shown, is_shown] = around(&light[row * line..], line, left);
            let shown = is_shown.select(shown, square);
            let unknown = Lanes([UNKNOWN; LANES]);
            let known = weight * before[3].max(after[3]).max(unknown);
            let is_shown = weight * is_shown.max(unknown);
            let chance = noise * known;
            let both = seen * before[3] * after[3];
            let terms = [
                chance,
                direct * known,
                squares * known,
                chance * chance,
                shown * is_shown,
                square * is_shown,
                noise * both,
                squares * both,
            ];
            for (sum, term) in sums.iter_mut().zip(terms) {
                *sum += term;
            }
            pixels_of += both;
            powers += power * both;
            apart += (dot(&before, &before) + dot(&after, &after)) * 0.5 * both;
            for (sums, side) in differences.iter_mut().zip([&before, &after]) {
                for (sum, channel) in sums.iter_mut().zip(side) {
                    *sum += *channel * both;
                }
            }
        }
        of_row.power += f64::from(powers.0.iter().sum::<f32>());
        of_row.apart += f64::from(apart.0.iter().sum::<f32>());
        let pixels = Arch::default().transposed(&sums.map(|sum| sum.0));
        for (at, (block, sums)) in pixels.chunks(BLOCK).zip(&mut *blocks).enumerate() {
            let sum = (Lanes(block[0]) + Lanes(block[1])) + (Lanes(block[2]) + Lanes(block[3]));
            sum.store(sums, 0);
            let of_block = |lanes: &Lanes| lanes.0[at * BLOCK..][..BLOCK].iter().sum::<f32>();
            sums[PIXELS] = of_block(&pixels_of);
            let squares = differences.iter().flatten().map(|sum| f64::from(of_block(sum)).powi(2));
            of_row.pooled += 0.5 * squares.sum::<f64>();
        }
    }
    of_row
}

#[inline(always)]
fn dot(a: &[Lanes], b: &[Lanes]) -> Lanes {
    (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]
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

/// Returns the square of the noise of eight pixels by what is around them, from lines of second differences that begin
/// above them, and 1 where that is known.
#[inline(always)]
fn around(lines: &[f32], line: usize, left: usize) -> [Lanes; 2] {
    let second = |row: usize| Lanes::load(lines, row * line + left);
    let both = (second(0) + second(2 * STEP)) - second(STEP) * 2.0;
    let noise = both * both / Lanes([KERNEL; LANES]);
    let known = Lanes(each(|lane| if noise.0[lane].is_finite() { 1.0 } else { 0.0 }));
    [known.select(noise, Lanes::ZERO), known]
}

/// Solves for the shares of a row of blocks.
struct Solve<'a> {
    sums: &'a Planes,
    row: usize,
    pool: &'a mut Pool,
    shares: &'a mut [f32],
}

impl pulp::NullaryFnOnce for Solve<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { sums, row, pool, shares } = self;
        const NOW: [usize; 6] = [NOISE, DIRECT, RESIDUAL, CHANCE, LIGHT_NOISE, LIGHT];
        const SINCE: [usize; 3] = [ALL + NOISE, ALL + RESIDUAL, ALL + CHANCE];
        let (vectors, pooled) = pool.sums(sums, row, NOW.into_iter().chain(SINCE).map(|plane| (plane, POOL)));
        for vector in 0..vectors {
            let sums: [Lanes; 9] = each(|plane| pooled[plane * vectors + vector]);
            share(&sums).store(shares, vector * LANES);
        }
    }
}

/// Returns the share of the residuals of eight blocks that is signal, from their sums: those of the frame, and the
/// noise, the residual and the chance of all frames.
#[inline(always)]
fn share(&[noise, direct, residual, chance, light_noise, light, noises, residuals, chances]: &[Lanes; 9]) -> Lanes {
    let (one, least) = (Lanes([1.0; LANES]), Lanes([LEAST; LANES]));
    let ratio = |noise: Lanes, chance: Lanes, residual: Lanes| (noise + chance) / residual.max(least);
    let chance = chance.sqrt() * DEVIATIONS[0];
    let product = ratio(noise, chance, residual);
    // A difference's own square holds half of the noise of a single bright pixel, but less of what resampling misses.
    let square = ratio(direct, (chance * 0.25).min(direct), residual).min(product);
    let [from, to] = ONE_SIDED;
    let part = ((square - Lanes([from; LANES])) / Lanes([to - from; LANES])).max(Lanes::ZERO).min(one);
    let now = square + (product - square) * part;
    let since = ratio(noises, chances.sqrt() * DEVIATIONS[1], residuals);
    let around = light_noise * AROUND / light.max(least);
    // Numbers that are none lose every comparison.
    let signal = (one - now.min(since).min(around)).max(Lanes::ZERO).min(one);
    // Small shares are more often chance than signal.
    signal * signal * (Lanes([3.0; LANES]) - signal * 2.0)
}

/// Gives the signal back to a row of pixels.
struct GiveBack<'a> {
    denoised: &'a Denoised<'a>,
    shares: &'a Planes,
    row: usize,
    interpolated: &'a mut Interpolated,
    to: &'a mut [Vec3],
}

impl pulp::NullaryFnOnce for GiveBack<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { denoised, shares, row, interpolated, to } = self;
        let Denoised { frame, grid, colors, alpha, .. } = *denoised;
        let width = to.len();
        interpolated.take(grid, row, shares);
        let pixels = frame.color[row * width..][..width].chunks(LANES);
        let colors = &colors[row * vectors(width)..];
        // A single picture is compared with what comes out of it: how much changes tells noise from detail.
        let alphas = alpha.filter(|_| !denoised.alone).map(|alpha| &alpha[row * width..][..width]);
        for (at, ((to, pixels), found)) in to.chunks_mut(LANES).zip(pixels).zip(colors).enumerate() {
            let (color, seen) = loaded(pixels);
            let share = interpolated.at(0, at) * seen;
            let rest = Lanes([1.0; LANES]) - share;
            let alpha = alphas.map_or(Lanes([1.0; LANES]), |alphas| {
                Lanes(each(|lane| alphas.get(at * LANES + lane).copied().unwrap_or(0.0)))
            });
            // 0 where color and alpha are so, and elsewhere 1.
            let is_there = Lanes(each(|lane| {
                let [r, g, b]: [f32; 3] = each(|c| color[c].0[lane]);
                if seen.0[lane] > 0.0 && alpha.0[lane] == 0.0 && [r, g, b] == [0.0; 3] { 0.0 } else { 1.0 }
            }));
            let mixed: [Lanes; 3] = each(|c| is_there.select(found[c] * rest + color[c] * share, Lanes::ZERO));
            for (lane, to) in to.iter_mut().enumerate() {
                *to = Vec3::new(mixed[0].0[lane], mixed[1].0[lane], mixed[2].0[lane]);
            }
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use crate::denoise::ahead::Ahead;
    use crate::denoise::difference::halved;

    const SIZE: [usize; 2] = [67, 50];

    fn noise(seed: u32) -> f32 {
        let h = (seed ^ 0x9E37_79B9).wrapping_mul(0x85EB_CA6B);
        let h = (h ^ (h >> 13)).wrapping_mul(0xC2B2_AE35);
        ((h ^ (h >> 16)) >> 8) as f32 / (1 << 24) as f32 - 0.5
    }

    /// Rows of eight pixels.
    fn lanes(of: impl Fn(usize) -> Vec3) -> Vec<Features> {
        let groups = vectors(SIZE[0]);
        let at = |i: usize, lane: usize| [(i % groups) * LANES + lane, i / groups];
        let pixel =
            |i: usize, lane: usize| Some(at(i, lane)).filter(|[x, _]| *x < SIZE[0]).map(|[x, y]| of(y * SIZE[0] + x));
        let channel = |i: usize, c: usize| Lanes(each(|lane| pixel(i, lane).map_or(0.0, |color| color[c])));
        (0..groups * SIZE[1]).map(|i| each(|c| channel(i, c))).collect()
    }

    /// Mean squares of the errors that go in as noise, that the denoiser leaves, and that come out of three frames of
    /// noise, where denoised colors have an error, and differences are known on no side of time or on up to two.
    fn errors(amount: f32, error: fn(usize) -> f32, sides: usize) -> [f32; 3] {
        let truth = |i: usize| Vec3::new(1.0, 0.8, 0.6) * (1.0 + 0.3 * (0.1 * (i % SIZE[0]) as f32).sin());
        let mut residuals = Residuals::default();
        let mut sums = [0.0; 3];
        for frame in 0..3_u32 {
            let seen =
                |k: u32, i: usize| truth(i) + Vec3::splat(amount * noise(i as u32 * 31 + (frame * 3 + k) * 7_919));
            let color: Vec<Vec3> = (0..SIZE[0] * SIZE[1]).map(|i| seen(0, i)).collect();
            let denoised = |i: usize| truth(i) + Vec3::splat(error(i));
            let colors = lanes(denoised);
            let apart = |k: u32, known: bool| -> Vec<Halved> {
                let known = Lanes([if known { 1.0 } else { 0.0 }; LANES]);
                lanes(|i| color[i] - seen(k, i)).iter().map(|apart| halved(apart, known)).collect()
            };
            let (before, after) = (apart(1, sides > 0), apart(2, sides > 1));
            let ahead = Ahead { size: SIZE, frames: 1, differences: after, ..Ahead::default() };
            let frame = Frame { size: SIZE, color: &color, ahead: Some(&ahead), ..Frame::default() };
            let grid = Grid::over(SIZE);
            let given = Denoised {
                frame: &frame,
                grid,
                motions: &[],
                own: &Planes::new(grid, 1),
                colors: &colors,
                before: &before,
                alpha: None,
                floor: 0.01,
                kept: 0.88,
                alone: false,
                mapped: true,
            };
            let mut to = frame::Denoised::default();
            residuals.give_back(&given, &mut to);
            for (i, to) in to.color.iter().enumerate() {
                let errors = [color[i] - truth(i), denoised(i) - truth(i), *to - truth(i)];
                sums = each(|k| sums[k] + errors[k].length_squared() / (3 * color.len()) as f32);
            }
        }
        sums
    }

    /// Without noise colors come back whole; of noise nothing does; and what comes out is never worse than the better
    /// of both by much.
    #[test]
    fn signal_comes_back_and_noise_does_not() {
        let texture = |i: usize| if (i % SIZE[0]) / 3 % 2 == i / SIZE[0] / 3 % 2 { 0.1 } else { -0.1 };
        for sides in 0..3 {
            let [_, before, after] = errors(0.0, texture, sides);
            assert!(sides == 0 || after < 1e-6 * before, "{sides}: {after} of {before}");
            let [noise, _, after] = errors(0.4, |_| 0.0, sides);
            assert!(after < 1e-3 * noise, "{sides}: {after} of {noise}");
        }
        for amount in [0.01, 0.1, 0.3, 1.0] {
            let [noise, before, after] = errors(amount, texture, 2);
            assert!(after < 1.25 * noise.min(before), "{amount}: {after}, of {noise} and {before}");
        }
    }

    /// A smooth error shows in one frame alone.
    #[test]
    fn smooth_errors_show_around() {
        let [noise, before, after] = errors(0.05, |i| 0.2 * (0.06 * (i % SIZE[0]) as f32).cos(), 0);
        assert!(after < 1.3 * noise && after < 0.2 * before, "{after}, of {noise} and {before}");
    }
}
