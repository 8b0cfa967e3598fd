//! Changes of illumination between frames, by regression on the denoised picture.
//!
//! Where the light changes, the colors of a frame differ from those of its neighbours, and from the denoised ones, by
//! a multiple of themselves (the multiplier of Negahdaripour's generalized dynamic image model, 1998). A neighbourhood
//! has one multiplier for some hundred pixels, which takes hardly any of the noise, so that what is left of the
//! differences tells the noise as if the light had stayed.

use super::blocks::{BLOCK, Grid, Interpolated, Planes, Pool};
use super::carried::to_planes;
use super::difference::{self, CHANNELS, Difference, Halved};
use super::frame::Frame;
use super::history::loaded;
use super::lanes::{LANES, Lanes, dot, each};
use super::vectors::{Features, vectors};
use crate::arch::Arch;
use rayon::prelude::*;

/// Changes of a block, as shares of the denoised colors: those of the frame over the denoised colors, over the frame
/// before and over the frame that follows.
pub(crate) const CHANGES: usize = 3;
/// Places of the changes.
const DENOISED: usize = 0;
pub(crate) const BEFORE: usize = 1;
pub(crate) const AFTER: usize = 2;

/// Sums of each change: the products of differences and denoised colors, and the squares of these, by the weights of
/// the pixels and without weights; and the squares of the weighted products.
const TERMS: usize = 5;
/// Sums of a block: those of the changes, up to whole vectors.
const SUMS: usize = 2 * LANES;
/// Planes of what is found: the changes, and the trend, the mean change from frame to frame of the latest ones.
const FOUND: usize = CHANGES + 1;
const TREND: usize = CHANGES;
/// Shares in the sums of a trend of what they were, and of those of the changes over the frame before and over the one
/// that follows: the trend is half of their difference, and its chance goes with squares.
const OF_TREND: [[f32; 3]; TERMS] = {
    let (product, square) = ([0.8, 0.5, -0.5], [0.8, 0.5, 0.5]);
    [product, square, product, square, [0.64, 0.25, 0.25]]
};
/// Blocks to each side over which sums are pooled.
const POOL: usize = 2;
/// Squares of changes over their variance by chance between which they come to count.
const SIGNIFICANT: [f32; 2] = [9.0, 25.0];
/// Least factor of the denoised colors.
const LEAST_FACTOR: f32 = 0.01;
/// Least number that is divided by.
const LEAST: f32 = 1e-30;

/// A frame, and what it is compared with.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Compared<'c> {
    pub frame: &'c Frame<'c>,
    pub grid: Grid,
    /// Differences from the frame before, row by row.
    pub before: &'c [Halved],
    /// Added to the squares of the colors, of which the weights of the pixels are the inverse.
    pub floor: f32,
    /// True where no other frame was learned from: the denoised colors have the frame's own illumination then.
    pub alone: bool,
}

/// Changes of illumination of a frame.
#[derive(Debug, Default)]
pub(crate) struct Illumination {
    sums: Planes,
    trends: Planes,
    /// The changes by block, and their trend.
    pub changes: Planes,
}

impl Illumination {
    /// Returns the trend of a row of blocks up to the frame before; none where no frame was compared yet.
    pub(crate) fn trend(&self, row: usize) -> &[f32] {
        if row < self.changes.grid().rows { self.changes.row(row, TREND) } else { &[] }
    }

    /// Finds the changes, and gives the denoised colors, row by row, the illumination of the frame.
    pub(crate) fn follow(&mut self, compared: Compared<'_>, colors: &mut [Features]) {
        let Compared { frame, grid, .. } = compared;
        let groups = vectors(frame.size[0]);
        if self.sums.grid() != grid {
            let planes = |count: usize| Planes::new(grid, count);
            (self.sums, self.trends, self.changes) = (planes(SUMS), planes(TERMS), planes(FOUND));
        }
        let Self { sums, trends, changes } = self;
        let stride = grid.stride();
        let rows = sums.data.par_chunks_mut(SUMS * stride).zip(trends.data.par_chunks_mut(TERMS * stride));
        let rows = rows.zip(colors.par_chunks(BLOCK * groups)).enumerate();
        rows.with_min_len(2).for_each_init(Vec::new, |blocks, (row, ((planes, trends), colors))| {
            Arch::default().dispatch(Sum { compared, row, colors, blocks, planes, trends });
        });
        let (sums, trends) = (&*sums, &*trends);
        let rows = changes.data.par_chunks_mut(FOUND * stride).enumerate();
        rows.with_min_len(8).for_each_init(Pool::default, |pool, (row, to)| {
            Arch::default().dispatch(Solve { sums, trends, row, alone: compared.alone, pool, to });
        });
        let changes = &*changes;
        let rows = colors.par_chunks_mut(groups).enumerate();
        rows.with_min_len(8).for_each_init(Interpolated::default, |interpolated, (row, colors)| {
            Arch::default().dispatch(Illuminate { grid, changes, row, interpolated, colors });
        });
    }
}

/// Sums over a row of blocks.
struct Sum<'a> {
    compared: Compared<'a>,
    row: usize,
    /// Denoised colors of the row.
    colors: &'a [Features],
    /// Scratch.
    blocks: &'a mut Vec<[f32; SUMS]>,
    planes: &'a mut [f32],
    /// Sums of the trend, plane after plane.
    trends: &'a mut [f32],
}

impl pulp::NullaryFnOnce for Sum<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { compared, row, colors, blocks, planes, trends } = self;
        let Compared { frame, grid, before, floor, .. } = compared;
        let width = frame.size[0];
        let groups = vectors(width);
        blocks.resize(grid.columns, [0.0; SUMS]);
        for (at, blocks) in blocks.chunks_mut(LANES / BLOCK).enumerate() {
            let mut sums = [[Lanes::ZERO; TERMS]; CHANGES];
            for (y, colors) in (row * BLOCK..).zip(colors.chunks(groups)) {
                let pixels = &frame.color[y * width..][..width][at * LANES..];
                let (color, seen) = loaded(&pixels[..LANES.min(pixels.len())]);
                let found = &colors[at];
                let after = match frame.ahead {
                    Some(ahead) => difference::whole(&ahead.differences[y * groups + at]),
                    None => Difference::default(),
                };
                let [r, g, b]: [Lanes; CHANNELS] = each(|c| (color[c] - found[c]) * seen);
                let sides = [[r, g, b, seen], difference::whole(&before[y * groups + at]), after];
                let power = dot(found, found);
                let weight = seen / (power + Lanes([floor; LANES]));
                for (sums, side) in sums.iter_mut().zip(&sides) {
                    let (product, square) = (dot(side, found) * seen, power * side[CHANNELS] * seen);
                    let weighted = product * weight;
                    let terms = [weighted, square * weight, product, square, weighted * weighted];
                    for (sum, term) in sums.iter_mut().zip(terms) {
                        *sum += term;
                    }
                }
            }
            let all: [Lanes; SUMS] = each(|i| sums.as_flattened().get(i).copied().unwrap_or(Lanes::ZERO));
            for (vector, sums) in all.as_chunks::<LANES>().0.iter().enumerate() {
                let pixels = Arch::default().transposed(&sums.map(|sum| sum.0));
                for (pixels, to) in pixels.chunks(BLOCK).zip(&mut *blocks) {
                    let sum = (Lanes(pixels[0]) + Lanes(pixels[1])) + (Lanes(pixels[2]) + Lanes(pixels[3]));
                    sum.store(to, vector * LANES);
                }
            }
        }
        to_planes(Arch::default(), blocks, planes, grid.stride());
        // What both sides have in common, as noise of the frame, is no trend.
        let stride = grid.stride();
        let of = |place: usize| planes[place * TERMS * stride..][..TERMS * stride].chunks_exact(stride);
        let sides = of(BEFORE).zip(of(AFTER));
        for ((trend, (before, after)), [kept, by_before, by_after]) in
            trends.chunks_exact_mut(stride).zip(sides).zip(OF_TREND)
        {
            for ((trend, before), after) in trend.iter_mut().zip(before).zip(after) {
                *trend = *trend * kept + (before * by_before + after * by_after);
            }
        }
    }
}

/// Solves for the changes of a row of blocks.
struct Solve<'a> {
    sums: &'a Planes,
    trends: &'a Planes,
    row: usize,
    alone: bool,
    pool: &'a mut Pool,
    to: &'a mut [f32],
}

impl pulp::NullaryFnOnce for Solve<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { sums, trends, row, alone, pool, to } = self;
        let (vectors, pooled) = pool.sums(trends, row, (0..TERMS).map(|plane| (plane, POOL)));
        for vector in 0..vectors {
            let trend = change(each(|term| pooled[term * vectors + vector]));
            trend.store(to, (TREND * vectors + vector) * LANES);
        }
        let (vectors, pooled) = pool.sums(sums, row, (0..CHANGES * TERMS).map(|plane| (plane, POOL)));
        for vector in 0..vectors {
            let of = |place: usize| change(each(|term| pooled[(place * TERMS + term) * vectors + vector]));
            let least = Lanes([LEAST_FACTOR - 1.0; LANES]);
            let of_denoised = if alone { Lanes::ZERO } else { of(DENOISED).max(least) };
            // The others are shares of the colors as they come out.
            let factor = of_denoised + 1.0;
            let found = [of_denoised, of(BEFORE) / factor, of(AFTER) / factor];
            for (place, found) in found.into_iter().enumerate() {
                found.store(to, (place * vectors + vector) * LANES);
            }
        }
    }
}

/// Returns the changes of eight neighbourhoods from their sums; 0 where chance explains them. The lesser of the
/// weighted and the unweighted change counts, and none where they differ in sign: what makes bright and dark pixels
/// differ is something else than light.
#[inline(always)]
fn change([product, square, even_product, even_square, chance]: [Lanes; TERMS]) -> Lanes {
    let least = Lanes([LEAST; LANES]);
    let [from, to] = SIGNIFICANT;
    let ratio = product * product / chance.max(least);
    let certain =
        ((ratio - Lanes([from; LANES])) / Lanes([to - from; LANES])).max(Lanes::ZERO).min(Lanes([1.0; LANES]));
    let [weighted, even] = [product / square.max(least), even_product / even_square.max(least)];
    let lesser =
        weighted.max(Lanes::ZERO).min(even.max(Lanes::ZERO)) + weighted.min(Lanes::ZERO).max(even.min(Lanes::ZERO));
    lesser * certain
}

/// Gives a row of denoised colors the illumination of the frame.
struct Illuminate<'a> {
    grid: Grid,
    changes: &'a Planes,
    row: usize,
    interpolated: &'a mut Interpolated,
    colors: &'a mut [Features],
}

impl pulp::NullaryFnOnce for Illuminate<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { grid, changes, row, interpolated, colors } = self;
        interpolated.take(grid, row, changes);
        for (at, color) in colors.iter_mut().enumerate() {
            let change = interpolated.at(DENOISED, at);
            // Most pictures have none.
            if change == Lanes::ZERO {
                continue;
            }
            let factor = change + 1.0;
            for channel in color {
                *channel = *channel * factor;
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
    use glam::Vec3;
    use rand_pcg::Pcg64;
    use rand_pcg::rand_core::{Rng, SeedableRng};

    const SIZE: [usize; 2] = [67, 50];

    /// A picture, row by row in vectors.
    fn lanes(of: impl Fn(usize) -> Vec3) -> Vec<Features> {
        let groups = vectors(SIZE[0]);
        let place = |i: usize, lane: usize| Some((i % groups) * LANES + lane).filter(|x| *x < SIZE[0]);
        let color = |i: usize, lane: usize| place(i, lane).map_or(Vec3::ZERO, |x| of(i / groups * SIZE[0] + x));
        (0..groups * SIZE[1]).map(|i| each(|c| Lanes(each(|lane| color(i, lane)[c])))).collect()
    }

    /// Changes in the middle of a picture of noise, and the root mean square by which the denoised colors are off the
    /// truth before and after. The frame and its two neighbours are told by pixel and place in time, and so is the
    /// denoised picture, in last place.
    fn found(noise: f32, picture: impl Fn(usize, usize, usize) -> Vec3) -> ([f32; CHANGES], [f32; 2]) {
        let mut random = Pcg64::seed_from_u64(5);
        let mut uniform = || random.next_u32() as f32 / u32::MAX as f32 - 0.5;
        let truth = |k: usize, i: usize| picture(i % SIZE[0], i / SIZE[0], k);
        let pixels = SIZE[0] * SIZE[1];
        let frames: [Vec<Vec3>; 3] = std::array::from_fn(|k| {
            (0..pixels)
                .map(|i| truth(k, i) + noise * 12_f32.sqrt() * Vec3::new(uniform(), uniform(), uniform()))
                .collect()
        });
        let apart = |k: usize| -> Vec<Halved> {
            lanes(|i| frames[0][i] - frames[k][i]).iter().map(|apart| halved(apart, Lanes([1.0; LANES]))).collect()
        };
        let (before, differences) = (apart(1), apart(2));
        let ahead = Ahead { size: SIZE, frames: 1, differences, ..Ahead::default() };
        let frame = Frame { size: SIZE, color: &frames[0], ahead: Some(&ahead), ..Frame::default() };
        let grid = Grid::over(SIZE);
        let mut colors = lanes(|i| truth(3, i));
        let wanted = lanes(|i| truth(0, i));
        let off = |colors: &[Features]| {
            let squares = colors.iter().flatten().zip(wanted.iter().flatten()).flat_map(|(a, b)| (*a - *b).0);
            (squares.map(|apart| apart * apart).sum::<f32>() / pixels as f32).sqrt()
        };
        let at_first = off(&colors);
        let mut illumination = Illumination::default();
        illumination.follow(Compared { frame: &frame, grid, before: &before, floor: 1e-3, alone: false }, &mut colors);
        let of = |place: usize| illumination.changes.row(6, place)[8];
        ([of(0), of(1), of(2)], [at_first, off(&colors)])
    }

    fn texture(x: usize, y: usize) -> Vec3 {
        Vec3::new(1.0, 0.8, 0.6) * if (x * 7 + y * 3) % 11 < 5 { 0.2 } else { 0.9 }
    }

    /// Light that changes is found by all three comparisons, with noise and without, and the denoised colors follow it.
    #[test]
    fn light_that_changes_is_followed() {
        for (noise, within) in [(0.0, 4e-3), (0.02, 0.01), (0.1, 0.03)] {
            let light = [1.3, 0.9, 1.1, 1.0];
            let (found, [before, after]) = found(noise, |x, y, k| light[k] * texture(x, y));
            for (found, wanted) in found.into_iter().zip([0.3, 0.4 / 1.3, 0.2 / 1.3]) {
                assert!((found - wanted).abs() < within, "{noise}: {found}, {wanted}");
            }
            assert!(after < 0.25 * before, "{noise}: {after} of {before}");
        }
    }

    /// The trend of light that grows by a share from frame to frame, and changes up and down by another, where the
    /// denoised colors hold a share of the noise of the frames around.
    fn trend(growth: f32, alternating: f32, noise: f32, share: f32) -> f32 {
        let mut random = Pcg64::seed_from_u64(9);
        let grid = Grid::over(SIZE);
        let mut illumination = Illumination::default();
        let mut frame = |k: usize| -> Vec<Vec3> {
            let light =
                (1.0 + growth).powi(k as i32) * (1.0 + if k.is_multiple_of(2) { alternating } else { -alternating });
            let mut uniform = || 12_f32.sqrt() * (random.next_u32() as f32 / u32::MAX as f32 - 0.5);
            (0..SIZE[0] * SIZE[1])
                .map(|i| {
                    light * texture(i % SIZE[0], i / SIZE[0]) + noise * Vec3::from_array([0; 3].map(|_| uniform()))
                })
                .collect()
        };
        let frames: Vec<Vec<Vec3>> = (0..14).map(&mut frame).collect();
        for k in 1..13 {
            let apart = |other: usize| -> Vec<Halved> {
                let apart = lanes(|i| frames[k][i] - frames[other][i]);
                apart.iter().map(|apart| halved(apart, Lanes([1.0; LANES]))).collect()
            };
            let (before, differences) = (apart(k - 1), apart(k + 1));
            let ahead = Ahead { size: SIZE, frames: 1, differences, ..Ahead::default() };
            let frame = Frame { size: SIZE, color: &frames[k], ahead: Some(&ahead), ..Frame::default() };
            let mean = |i: usize| (frames[k - 1][i] + frames[k + 1][i]) * 0.5;
            let clean = |i: usize| (1.0 + growth).powi(k as i32) * texture(i % SIZE[0], i / SIZE[0]);
            let mut colors = lanes(|i| clean(i).lerp(mean(i), share));
            let compared = Compared { frame: &frame, grid, before: &before, floor: 1e-3, alone: false };
            illumination.follow(compared, &mut colors);
        }
        illumination.trend(6)[8]
    }

    /// Light that grows has a trend, found in noise, and light that comes and goes has none.
    /// Noise that denoised colors share with the frames around is no trend, as it is in the change over one of them.
    #[test]
    fn growing_light_has_a_trend() {
        for (noise, within) in [(0.0, 1e-3), (0.1, 5e-3), (0.2, 0.01)] {
            let found = trend(0.04, 0.0, noise, 0.2);
            assert!((found - 0.04).abs() < within, "{noise}: {found}");
        }
        for (alternating, noise) in [(0.1, 0.0), (0.1, 0.05), (0.0, 0.3), (0.0, 1.0)] {
            let found = trend(0.0, alternating, noise, 0.2);
            assert!(found.abs() < 2e-3, "{alternating}, {noise}: {found}");
        }
    }

    /// Noise is no change of the light, nor is a picture that loses its contrast or is another one.
    #[test]
    fn what_is_no_light_is_left() {
        let (of_noise, [before, after]) = found(0.3, |x, y, _| texture(x, y));
        assert!(before == 0.0 && after < 0.01, "{after}");
        assert!(of_noise.iter().all(|change| change.abs() < 0.05), "{of_noise:?}");
        let contrast = [1.0, 1.0, 1.0, 0.6];
        let mean = texture(0, 0).lerp(texture(1, 0), 0.5);
        let (faded, [before, after]) = found(0.0, |x, y, k| mean + contrast[k] * (texture(x, y) - mean));
        assert!(faded[DENOISED] == 0.0 && after == before, "{faded:?}");
    }
}
