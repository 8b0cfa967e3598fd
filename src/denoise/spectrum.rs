//! Power spectrum of residuals by neighbourhood, which bounds how much of them is noise.
//!
//! Noise that is independent from pixel to pixel has the same power at all frequencies. What a denoiser has lost
//! follows the picture, and has not. A residual's power is the sum of both, and so the least of it over all frequencies
//! is no less than the noise's: the bound that the smallest eigenvalue of the covariance of patches gives (Pyatykh,
//! Hesser & Zheng 2013), at a fraction of the cost. It needs no other frame. Pixel filters and some samplers make noise
//! that neighbours share. Where the frames around tell that residuals are noise, its spectrum is taken from these, and
//! powers are compared with it. Elsewhere noise may have come through a pixel filter, unless it is independent where
//! the picture has least detail ([`Floor`]).
//!
//! Of pixels that no other frame shows, as all of a single picture are, the denoiser knows no more than the mean of the
//! noise around, which it leaves. What it takes away has the spectrum of noise without its mean.
//!
//! Powers are those of patches of 3x3 pixels, `S(ω) = Σ w(k) ρ(k) cos(ω·k)` of the correlations ρ over lags k of up to
//! two pixels with triangular weights w (Bartlett 1950), at multiples of a quarter turn a pixel.

use super::blocks::{BLOCK, Planes, Pool};
use super::carried::to_planes;
use super::difference;
use super::history::loaded;
use super::lanes::{LANES, Lanes, dot, each};
use super::layout::{MARGIN, line_of};
use super::noise::Filtered;
use super::vectors::vectors;
use crate::arch::Arch;

/// Pixels along the side of a patch.
const PATCH: usize = 3;
/// Lags between the pixels of a patch, to the right and downwards; the opposite ones have the same correlation.
const LAGS: [[isize; 2]; 12] =
    [[1, 0], [2, 0], [-2, 1], [-1, 1], [0, 1], [1, 1], [2, 1], [-2, 2], [-1, 2], [0, 2], [1, 2], [2, 2]];
/// Frequencies in quarter turns a pixel, to the right and downwards; the opposite ones have the same power.
const FREQUENCIES: [[isize; 2]; 10] = [[0, 0], [1, 0], [2, 0], [-1, 1], [0, 1], [1, 1], [2, 1], [0, 2], [1, 2], [2, 2]];
/// Weights of the lags' correlations in the powers.
const WEIGHTS: [[f32; LAGS.len()]; FREQUENCIES.len()] = weights();

/// Place of the sum of the residuals' squares; those of the products over the lags follow.
const SQUARE: usize = 0;
/// Place of the sum over all lags of the products' squares, of which the variance of a product by chance follows.
const CHANCE: usize = 1 + LAGS.len();
/// Place of the sum of the squares of residuals of pixels that no other frame shows.
const ALONE: usize = CHANCE + 1;
/// Numbers of a block, up to whole vectors.
pub(crate) const SUMS: usize = (ALONE + 1).next_multiple_of(LANES);
/// Sums of a block.
pub(crate) type Sums = [f32; SUMS];

/// Standard deviations by chance that are added to powers: the least of ten of them is that much below their mean where
/// all are alike.
const DEVIATIONS: f32 = 3.0;
/// Shares of each neighbour in pixel filters that noise may have come through, of pixels that other frames show, and of
/// those that none shows: none, and that of a usual filter. The latter pixels lose detail sooner, and a narrower filter
/// leaves them more.
const FILTERS: [[f64; 2]; 2] = [[0.0, 0.0], [0.15, 0.1]];
/// Blocks of a neighbourhood that are its least.
const LEAST_BLOCKS: usize = 4;
/// Least power of these, as a share of that of independent noise, between which they come to hold such noise.
const INDEPENDENT: [f64; 2] = [0.6, 0.75];
/// Least power of noise, as a share of the mean.
const LEAST_POWER: f64 = 0.005;
/// Least sum, where there is none.
const LEAST: f32 = 1e-30;

/// Powers at all frequencies, as shares of their mean.
pub(crate) type Powers<T> = [T; FREQUENCIES.len()];

const fn weights() -> [[f32; LAGS.len()]; FREQUENCIES.len()] {
    let mut to = [[0.0; LAGS.len()]; FREQUENCIES.len()];
    let mut of = 0;
    while of < FREQUENCIES.len() {
        let mut lag = 0;
        while lag < LAGS.len() {
            let [[right, down], [a, b]] = [LAGS[lag], FREQUENCIES[of]];
            let cosine = [1.0, 0.0, -1.0, 0.0][(a * right + b * down).rem_euclid(4) as usize];
            let pairs = (PATCH - right.unsigned_abs()) * (PATCH - down.unsigned_abs());
            // Both directions of the lag.
            to[of][lag] = 2.0 * cosine * pairs as f32 / (PATCH * PATCH) as f32;
            lag += 1;
        }
        of += 1;
    }
    to
}

/// Sums the products of a row of blocks.
pub(crate) struct Sum<'a> {
    pub filtered: &'a Filtered<'a>,
    pub row: usize,
    /// Residuals by channel, of the rows below, too.
    pub lines: &'a mut Vec<f32>,
    pub blocks: &'a mut Vec<Sums>,
    pub planes: &'a mut [f32],
}

impl pulp::NullaryFnOnce for Sum<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { filtered, row, lines, blocks, planes } = self;
        let Filtered { frame, grid, colors, before, floor, .. } = *filtered;
        let [width, height] = frame.size;
        let (groups, line, top) = (vectors(width), line_of(width), row * BLOCK);
        let (count, rows) = (BLOCK.min(height - top), (BLOCK + PATCH - 1).min(height - top));
        lines.clear();
        lines.resize(3 * (BLOCK + PATCH - 1) * line, 0.0);
        for (at, lines) in lines.chunks_exact_mut(3 * line).enumerate().take(rows) {
            let pixels = frame.color[(top + at) * width..][..width].chunks(LANES);
            for (group, pixels) in pixels.enumerate() {
                let (color, seen) = loaded(pixels);
                let found = &colors[(top + at) * groups + group];
                // In units of the picture's brightness, so that squares of squares stay numbers.
                let weight = seen * (1.0 / floor.sqrt());
                for (c, line) in lines.chunks_exact_mut(line).enumerate() {
                    let residual = (color[c] - found[c]) * weight;
                    residual.store(line, MARGIN + group * LANES);
                }
            }
        }
        let lines = &lines[..];
        blocks.resize(grid.columns, [0.0; SUMS]);
        for (group, blocks) in blocks.chunks_mut(LANES / BLOCK).enumerate() {
            let mut sums = [Lanes::ZERO; SUMS];
            let at = MARGIN + group * LANES;
            for row in 0..count {
                let own: [Lanes; 3] = each(|c| Lanes::load(lines, (3 * row + c) * line + at));
                let square = dot(&own, &own);
                sums[SQUARE] += square;
                let place = (top + row) * groups + group;
                let is_before = difference::is_known(&before[place]);
                let is_after = frame.ahead.map_or(Lanes::ZERO, |ahead| difference::is_known(&ahead.differences[place]));
                sums[ALONE] += is_before.max(is_after).select(Lanes::ZERO, square);
                for (sum, [right, down]) in (SQUARE + 1..).zip(LAGS) {
                    let from = at.wrapping_add_signed(right);
                    let other: [Lanes; 3] = each(|c| Lanes::load(lines, (3 * (row + down as usize) + c) * line + from));
                    let product = dot(&own, &other);
                    sums[sum] += product;
                    sums[CHANCE] = product.mul_add(product, sums[CHANCE]);
                }
            }
            for vector in 0..SUMS / LANES {
                let pixels = Arch::default().transposed(&each(|i| sums[vector * LANES + i].0));
                for (pixels, to) in pixels.chunks(BLOCK).zip(&mut *blocks) {
                    let sum = (Lanes(pixels[0]) + Lanes(pixels[1])) + (Lanes(pixels[2]) + Lanes(pixels[3]));
                    sum.store(to, vector * LANES);
                }
            }
        }
        to_planes(Arch::default(), blocks, planes, grid.stride());
    }
}

/// Spectra of eight neighbourhoods.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Spectrum {
    /// Powers of the residuals; 1 where there are none.
    pub powers: Powers<Lanes>,
    /// Standard deviation of a correlation by chance, of independent noise.
    deviation: Lanes,
    /// Share of the residuals' power that lies where no other frame shows the pixels.
    pub alone: Lanes,
}

impl Spectrum {
    /// Returns the spectra of a row of neighbourhoods of so many blocks to each side.
    #[inline(always)]
    pub(crate) fn of_row(sums: &Planes, row: usize, radius: usize, pool: &mut Pool) -> Vec<Self> {
        let (vectors, found) = pool.sums(sums, row, (0..=ALONE).map(|plane| (plane, radius)));
        let mut to = Vec::with_capacity(vectors);
        for vector in 0..vectors {
            let inverse = Lanes([1.0; LANES]) / found[SQUARE * vectors + vector].max(Lanes([LEAST; LANES]));
            let correlations: [Lanes; LAGS.len()] = each(|lag| found[(SQUARE + 1 + lag) * vectors + vector] * inverse);
            let mut powers = [Lanes([1.0; LANES]); FREQUENCIES.len()];
            for (power, weights) in powers.iter_mut().zip(&WEIGHTS) {
                for (correlation, weight) in correlations.iter().zip(weights) {
                    *power = correlation.mul_add(Lanes([*weight; LANES]), *power);
                }
            }
            let chance = found[CHANCE * vectors + vector] * (1.0 / LAGS.len() as f32);
            let alone = found[ALONE * vectors + vector] * inverse;
            to.push(Self { powers, deviation: chance.sqrt() * inverse, alone });
        }
        to
    }

    /// Returns the share of the residuals that is noise at most, of whatever spectrum noise may have; not a number
    /// where they are too large to be squared.
    #[inline(always)]
    pub(crate) fn most_noise(&self, noise: &NoiseSpectra) -> Lanes {
        let mut most = Lanes::ZERO;
        for NoiseSpectrum { powers, alone, deviations } in &noise.0 {
            let mut least = Lanes([f32::INFINITY; LANES]);
            for ((power, of_noise), alone) in self.powers.iter().zip(powers).zip(alone) {
                let of_noise = Lanes([*of_noise; LANES]);
                least = least.min(*power / (of_noise + (Lanes([*alone; LANES]) - of_noise) * self.alone));
            }
            most = most.max(least + self.deviation * *deviations);
        }
        most
    }
}

/// Sums of the blocks of residuals that are the least of their neighbourhoods, as shares of these: they hold little but
/// noise wherever a picture has places without detail.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Floor {
    /// Sum of the squares, sums of the products over the lags, and sum of the squares of pixels that no other frame
    /// shows.
    square: f64,
    products: [f64; LAGS.len()],
    alone: f64,
}

impl Floor {
    /// Returns the sums of a row of neighbourhoods of so many blocks to each side. No block lies in two of them.
    pub(crate) fn of_row(sums: &Planes, row: usize, radius: usize) -> Self {
        let grid = sums.grid();
        let rows = row.saturating_sub(radius)..(row + radius + 1).min(grid.rows);
        let mut found = Self::default();
        let mut blocks = Vec::new();
        for first in (0..grid.columns).step_by(2 * radius + 1) {
            blocks.clear();
            let columns = first..(first + 2 * radius + 1).min(grid.columns);
            for row in rows.clone() {
                let squares = &sums.row(row, SQUARE)[columns.clone()];
                blocks.extend(squares.iter().zip(columns.clone()).map(|(square, column)| (*square, row, column)));
            }
            blocks.retain(|(square, ..)| *square > 0.0);
            let all: f64 = blocks.iter().map(|(square, ..)| f64::from(*square)).sum();
            if !all.is_finite() {
                continue;
            }
            blocks.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
            for (square, row, column) in blocks.iter().take(LEAST_BLOCKS) {
                let of = |plane: usize| f64::from(sums.row(*row, plane)[*column]) / all;
                found.square += f64::from(*square) / all;
                found.products = each(|lag| found.products[lag] + of(SQUARE + 1 + lag));
                found.alone += of(ALONE);
            }
        }
        found
    }

    /// Returns a share of these and others together.
    pub(crate) fn plus_share(&self, share: f64, other: &Self) -> Self {
        Self {
            square: share * self.square + other.square,
            products: each(|lag| share * self.products[lag] + other.products[lag]),
            alone: share * self.alone + other.alone,
        }
    }

    /// Returns 0 where the blocks hold noise that is independent from pixel to pixel, and 1 where they do not. `less`
    /// is the share of the mean around that the denoiser leaves of pixels that no other frame shows.
    pub(crate) fn shared(&self, less: f64) -> f64 {
        let (powers, expected) = (powers_of(self.products.map(|sum| sum / self.square)), powers_behind(0.0, less));
        let alone = self.alone / self.square;
        let share = powers.iter().zip(expected).map(|(power, expected)| power / (1.0 + (expected - 1.0) * alone));
        let least = share.fold(f64::INFINITY, f64::min);
        let [from, to] = INDEPENDENT;
        // Of nothing it is infinite, since comparisons with what is not a number are lost.
        if least.is_finite() { ((to - least) / (to - from)).clamp(0.0, 1.0) } else { 1.0 }
    }
}

/// Spectrum that noise may have.
#[derive(Debug, Clone, Copy, PartialEq)]
struct NoiseSpectrum {
    /// Powers, and those of pixels that no other frame shows.
    powers: Powers<f32>,
    alone: Powers<f32>,
    /// Deviations of independent noise that are added: noise that neighbours share has fewer independent pixels, by the
    /// mean square of its powers (Bartlett 1946).
    deviations: f32,
}

/// Spectra that noise may have.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct NoiseSpectra([NoiseSpectrum; FILTERS.len()]);

impl NoiseSpectra {
    /// Creates the spectra from powers of which so much is known: all of it at 1, and nothing at 0, where noise may be
    /// independent from pixel to pixel or, where `shared` is 1, have come through a pixel filter. `less` is the share
    /// of the mean around that the denoiser leaves of pixels that no other frame shows.
    pub(crate) fn new(powers: Powers<f64>, known: f64, shared: f64, less: f64) -> Self {
        let powers = if known > 0.0 { powers.map(|power| power.max(LEAST_POWER)) } else { [1.0; FREQUENCIES.len()] };
        // Not a number is nothing.
        let known = known.max(0.0);
        Self(FILTERS.map(|[share, alone]| {
            let of = |share: f64, less: f64| -> Powers<f64> {
                let [filtered, whole] = [less, 0.0].map(|less| powers_behind(share * shared, less));
                let found: Powers<f64> = each(|i| filtered[i] * (powers[i] / whole[i]).powf(known));
                let scale = mean(found).recip();
                found.map(|power| scale * power)
            };
            let [powers, alone] = [of(share, 0.0), of(alone, less)];
            let deviations = DEVIATIONS * mean(powers.map(|power| power * power)).sqrt() as f32;
            NoiseSpectrum {
                powers: powers.map(|power| power as f32),
                alone: alone.map(|power| power as f32),
                deviations,
            }
        }))
    }
}

/// Returns the powers of patches whose pixels have such correlations over the lags.
fn powers_of(correlations: [f64; LAGS.len()]) -> Powers<f64> {
    WEIGHTS.map(|weights| 1.0 + weights.iter().zip(correlations).map(|(weight, c)| f64::from(*weight) * c).sum::<f64>())
}

/// Returns the powers of independent noise behind a filter that gives each neighbour such a share, less so much of its
/// mean over 3x3 pixels.
fn powers_behind(share: f64, less: f64) -> Powers<f64> {
    let filter = [share, 1.0 - 2.0 * share, share];
    let mut kernel = [[0.0; 5]; 5];
    for (y, row) in kernel.iter_mut().enumerate() {
        for (x, to) in row.iter_mut().enumerate() {
            let moved = |at: usize, by: usize| at.checked_sub(by).and_then(|i| filter.get(i)).copied().unwrap_or(0.0);
            let mean = |at: usize| (0..3).map(|by| moved(at, by)).sum::<f64>() / 3.0;
            *to = moved(y, 1) * moved(x, 1) - less * mean(y) * mean(x);
        }
    }
    let product = |right: isize, down: isize| -> f64 {
        let of = |x: usize, y: usize| {
            let (x, y) = (x.checked_add_signed(right)?, y.checked_add_signed(down)?);
            kernel.get(y)?.get(x).copied()
        };
        (0..25).map(|i| kernel[i / 5][i % 5] * of(i % 5, i / 5).unwrap_or(0.0)).sum()
    };
    let square = product(0, 0);
    powers_of(LAGS.map(|[right, down]| product(right, down) / square))
}

/// Returns the mean of numbers over all frequencies: those that are not their own opposites stand for two.
fn mean(of: Powers<f64>) -> f64 {
    let count = |[right, down]: [isize; 2]| if right % 2 == 0 && down % 2 == 0 { 1.0 } else { 2.0 };
    let [sum, counts] = of.into_iter().zip(FREQUENCIES).fold([0.0; 2], |[sum, counts], (number, frequency)| {
        [sum + count(frequency) * number, counts + count(frequency)]
    });
    sum / counts
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::denoise::blocks::Grid;
    use crate::denoise::frame::Frame;
    use glam::Vec3;

    const SIZE: [usize; 2] = [93, 64];
    const RADIUS: usize = 2;

    /// A random number from -1 to 1 by a place and a channel.
    fn random(x: usize, y: usize, channel: usize) -> f32 {
        let h = (x as u32).wrapping_mul(0x9E37_79B9) ^ (y as u32).wrapping_mul(0x85EB_CA6B) ^ (channel as u32) << 7;
        let h = (h ^ (h >> 15)).wrapping_mul(0x2C1B_3C6D);
        let h = (h ^ (h >> 12)).wrapping_mul(0x297A_2D39);
        ((h ^ (h >> 15)) >> 8) as f32 / (1 << 23) as f32 - 1.0
    }

    /// Sums over the pixel, which counts so many times, and its neighbours, as a pixel filter takes them.
    fn filtered(x: usize, y: usize, channel: usize, own: f32) -> f32 {
        let of_row = |y: usize| random(x, y, channel) + own * random(x + 1, y, channel) + random(x + 2, y, channel);
        of_row(y) + own * of_row(y + 1) + of_row(y + 2)
    }

    /// Sums of a picture of residuals, of which other frames show all pixels or none.
    fn sums(residual: impl Fn(usize, usize, usize) -> f32, is_known: bool) -> Planes {
        let grid = Grid::over(SIZE);
        let color: Vec<Vec3> = (0..SIZE[0] * SIZE[1])
            .map(|i| Vec3::from_array([0, 1, 2].map(|c| residual(i % SIZE[0], i / SIZE[0], c))))
            .collect();
        let colors = vec![[Lanes::ZERO; 3]; vectors(SIZE[0]) * SIZE[1]];
        let frame = Frame { size: SIZE, color: &color, ..Frame::default() };
        let known = Lanes([if is_known { 1.0 } else { 0.0 }; LANES]);
        let filtered = Filtered {
            frame: &frame,
            grid,
            motions: &[],
            own: &Planes::new(grid, 1),
            colors: &colors,
            before: &vec![difference::halved(&[Lanes::ZERO; 3], known); colors.len()],
            illumination: &Planes::new(grid, 1),
            guided: false,
            alpha: None,
            floor: 0.01,
            kept: 0.0,
            alone: false,
            told: false,
            mapped: false,
        };
        let mut sums = Planes::new(grid, SUMS);
        for (row, planes) in sums.data.chunks_mut(SUMS * grid.stride()).enumerate() {
            let (lines, blocks) = (&mut Vec::new(), &mut Vec::new());
            pulp::NullaryFnOnce::call(Sum { filtered: &filtered, row, lines, blocks, planes });
        }
        sums
    }

    /// Spectra of the neighbourhoods that lie inside of a picture.
    fn inside(sums: &Planes) -> Vec<Spectrum> {
        let rows = RADIUS..sums.grid().rows - RADIUS;
        rows.flat_map(|row| Spectrum::of_row(sums, row, RADIUS, &mut Pool::default()).into_iter().take(2)).collect()
    }

    fn spectra(residual: impl Fn(usize, usize, usize) -> f32) -> Vec<Spectrum> {
        inside(&sums(residual, true))
    }

    /// Spectra that noise of which nothing is known may have.
    fn unknown() -> NoiseSpectra {
        NoiseSpectra::new(Powers::default(), 0.0, 1.0, 1.0)
    }

    /// Mean and least of the shares of noise at most.
    fn most(spectra: &[Spectrum], noise: &NoiseSpectra) -> [f32; 2] {
        let of: Vec<f32> = spectra.iter().flat_map(|spectrum| spectrum.most_noise(noise).0).collect();
        [of.iter().sum::<f32>() / of.len() as f32, of.iter().copied().fold(f32::INFINITY, f32::min)]
    }

    /// Noise may be noise, whole, and texture may not; of both together the bound is near to the noise's share.
    #[test]
    fn independent_noise_is_told_from_texture() {
        let unknown = unknown();
        let [mean, least] = most(&spectra(random), &unknown);
        assert!((0.95..1.1).contains(&mean) && least > 0.75, "{mean} {least}");
        let wave = |x: usize, y: usize, _| (1.9 * x as f32 + 0.7 * y as f32).sin();
        let [mean, _] = most(&spectra(wave), &unknown);
        assert!(mean < 0.3, "{mean}");
        // Of an equal power each: the mean square of random numbers is a third, and that of waves a half.
        let both = |x: usize, y: usize, c: usize| random(x, y, c) + (2.0_f32 / 3.0).sqrt() * wave(x, y, c);
        let [mean, least] = most(&spectra(both), &unknown);
        assert!((0.5..0.75).contains(&mean) && least > 0.35, "{mean} {least}");
    }

    /// Noise that neighbours share may be noise as far as usual filters make it, and beyond that if its spectrum is
    /// known.
    #[test]
    fn noise_that_neighbours_share_has_a_spectrum_of_its_own() {
        let unknown = unknown();
        let [mean, least] = most(&spectra(|x, y, c| filtered(x, y, c, 8.0)), &unknown);
        assert!(mean > 0.8 && least > 0.4, "{mean} {least}");
        let found = spectra(|x, y, c| filtered(x, y, c, 2.0));
        let [mean, _] = most(&found, &unknown);
        assert!(mean < 0.7, "{mean}");
        let count = (LANES * found.len()) as f64;
        let power =
            |of: usize| found.iter().map(|spectrum| f64::from(spectrum.powers[of].0.iter().sum::<f32>())).sum::<f64>();
        let powers = each(|of| power(of) / count);
        let [mean, least] = most(&found, &NoiseSpectra::new(powers, 1.0, 1.0, 1.0));
        assert!(mean > 0.8 && least > 0.4, "{mean} {least}");
    }

    /// Noise that the denoiser takes away of a single picture counts as noise, and detail does not.
    #[test]
    fn pictures_alone_have_the_spectrum_of_noise_without_its_mean() {
        let less_mean = |of: &dyn Fn(usize, usize, usize) -> f32, x: usize, y: usize, c: usize| {
            let around = (0..9).map(|i| of(x + i % 3, y + i / 3, c)).sum::<f32>();
            of(x + 1, y + 1, c) - around / 9.0
        };
        let of = |picture: &dyn Fn(usize, usize, usize) -> f32, is_known| {
            most(&inside(&sums(|x, y, c| less_mean(picture, x, y, c), is_known)), &unknown())
        };
        let [[mean, least], [known, _]] = [of(&random, false), of(&random, true)];
        assert!((0.9..1.1).contains(&mean) && least > 0.7 && known < 0.8, "{mean} {least}, known {known}");
        let [mean, _] = of(&|x, y, _| (1.9 * x as f32 + 0.7 * y as f32).sin(), false);
        assert!(mean < 0.4, "{mean}");
    }

    /// Noise is seen to be independent wherever a part of the picture has no detail; noise that neighbours share, and
    /// pictures without noise, are not.
    #[test]
    fn blocks_without_detail_show_whether_noise_is_independent() {
        let shared = |residual: &dyn Fn(usize, usize, usize) -> f32, less: f64| {
            let sums = sums(residual, less == 0.0);
            let rows = (RADIUS..sums.grid().rows).step_by(2 * RADIUS + 1);
            let of = |row| Floor::of_row(&sums, row, RADIUS);
            rows.map(of).fold(Floor::default(), |all, row| all.plus_share(1.0, &row)).shared(less)
        };
        let wave = |x: usize, y: usize| (1.9 * x as f32 + 0.7 * y as f32).sin();
        let beside = |x: usize, y: usize, c: usize| {
            random(x, y, c) + if (x / 8).is_multiple_of(2) { 4.0 * wave(x, y) } else { 0.0 }
        };
        assert_eq!([shared(&random, 0.0), shared(&beside, 0.0)], [0.0; 2]);
        assert_eq!(shared(&|x, y, _| wave(x, y), 0.0), 1.0);
        assert!(shared(&|x, y, c| filtered(x, y, c, 8.0), 0.0) > 0.8);
        let alone = |x: usize, y: usize, c: usize| {
            random(x + 1, y + 1, c) - (0..9).map(|i| random(x + i % 3, y + i / 3, c)).sum::<f32>() / 9.0
        };
        assert_eq!([shared(&alone, 1.0), shared(&|_, _, _| 0.0, 0.0), shared(&|_, _, _| 1e30, 0.0)], [0.0, 1.0, 1.0]);
    }

    /// Numbers too large to be squared bound nothing, and pixels that are not numbers are left out.
    #[test]
    fn what_is_no_number_is_left_out() {
        let unknown = unknown();
        let holes = |x: usize, y: usize, c: usize| if x % 7 == y % 5 { f32::NAN } else { random(x, y, c) };
        let [mean, least] = most(&spectra(holes), &unknown);
        assert!((0.95..1.1).contains(&mean) && least > 0.7, "{mean} {least}");
        let [mean, least] = most(&spectra(|_, _, _| 0.0), &unknown);
        assert_eq!([mean, least], [1.0, 1.0]);
        let huge = spectra(|x, y, c| 1e12 * random(x, y, c));
        assert!(
            huge.iter().flat_map(|spectrum| spectrum.most_noise(&unknown).0).all(|most| most.is_nan() || most >= 1.0)
        );
    }
}
