//! The residual, what a frame's colors have over the denoised ones, and the share of it that is signal and comes back.
//!
//! The residual's square is on average the sum of the noise's and of the denoiser's error, since both are independent.
//! So the [`noise`](super::noise) that the frames before and after show tells the error, whatever caused it: detail
//! that was smoothed away, histories of another shot or another light, motion that is wrong. The share that comes back,
//! one less noise over residual, leaves the least error (James & Stein 1961). It is 1 without noise, and 0 where the
//! denoiser leaves nothing.
//!
//! Of what is taken away all the same, lines and edges come back by their [`coherence`](super::coherence).

use super::blocks::{Grid, Interpolated, Planes, Pool};
use super::coherence::Coherence;
use super::difference::{self, CHANNELS, Difference};
use super::estimate::{self, Estimate};
use super::frame;
use super::history::loaded;
use super::lanes::{LANES, Lanes, between, dot, each};
use super::layout::MARGIN;
use super::minimum::Minimum;
use super::noise::{ADDED, Filtered, Learn, NOISE_POWER, PIXELS, RESIDUAL_POWER, SINCE, SUMS, Sums};
use super::signal::{Calibrate, Calibration, POOL, SOLVED, Solve};
use super::spectrum;
use super::vectors::vectors;
use crate::arch::Arch;
use glam::Vec3;
use rayon::prelude::*;

/// Squares of a residual, as multiples of the mean square of the noise, between which it comes to be signal, ...
const BRIGHT: [f32; 2] = [9.0, 25.0];
/// ... if they are so many times those of the differences from the frames before and after. Of noise neither is seldom,
/// and both are.
const STEADY: [f32; 2] = [4.0, 16.0];
/// Least square that is divided by.
const LEAST: f32 = 1e-30;

/// Residuals of a sequence.
#[derive(Debug, Default)]
pub(crate) struct Residuals {
    blocks: Vec<Sums>,
    next: Vec<Sums>,
    sums: Planes,
    /// Sums of the residual's spectrum.
    spectra: Planes,
    coherence: Coherence,
    calibration: Calibration,
    minimum: Minimum,
    shares: Planes,
    /// Sums over rows of blocks.
    rows: Vec<estimate::Row>,
    /// Estimate of all frames, older ones by less.
    since: Estimate,
    /// Maps of noise and error, where they are wanted.
    maps: Planes,
}

impl Residuals {
    /// True if they are of frames over this grid.
    pub(crate) fn are_over(&self, grid: Grid) -> bool {
        self.sums.grid() == grid
    }

    /// Writes the filtered colors with the signal that their residuals hold, and the estimate of what is left.
    pub(crate) fn give_back(&mut self, filtered: &Filtered<'_>, to: &mut frame::Denoised) {
        if !self.are_over(filtered.grid) {
            *self = Self::new(filtered);
        }
        self.learn(filtered);
        self.calibrate(filtered);
        self.solve(filtered);
        self.add_signal(filtered, to);
        self.estimate(filtered, to);
        if filtered.mapped {
            self.map(filtered, to);
        }
        std::mem::swap(&mut self.blocks, &mut self.next);
        self.next.resize(self.blocks.len(), [0.0; SUMS]);
    }

    fn new(filtered: &Filtered<'_>) -> Self {
        let Filtered { frame, grid, mapped, .. } = *filtered;
        Self {
            next: vec![[0.0; SUMS]; grid.rows * grid.columns],
            sums: Planes::new(grid, SUMS),
            spectra: Planes::new(grid, spectrum::SUMS),
            coherence: Coherence::new(frame.size),
            minimum: Minimum::new(grid),
            shares: Planes::new(grid, SOLVED),
            rows: vec![estimate::Row::default(); grid.rows],
            maps: Planes::new(if mapped { grid } else { Grid::default() }, estimate::MAPPED),
            ..Self::default()
        }
    }

    /// Sums noise, residuals and their spectra.
    fn learn(&mut self, filtered: &Filtered<'_>) {
        let Self { blocks, next, sums, spectra, rows: of_rows, .. } = self;
        let (grid, before) = (filtered.grid, &blocks[..]);
        let planes = sums.data.par_chunks_mut(SUMS * grid.stride());
        let rows = next.par_chunks_mut(grid.columns).zip(planes).zip(of_rows.par_iter_mut()).enumerate();
        rows.with_min_len(2).for_each_init(Vec::new, |light, (row, ((blocks, planes), of_row))| {
            *of_row = Arch::default().dispatch(Learn { filtered, before, row, light, blocks, planes });
        });
        let rows = spectra.data.par_chunks_mut(spectrum::SUMS * grid.stride()).enumerate();
        rows.with_min_len(2).for_each_init(Default::default, |(lines, blocks), (row, planes)| {
            Arch::default().dispatch(spectrum::Sum { filtered, row, lines, blocks, planes });
        });
    }

    /// Adds what the whole frame tells of the noise.
    fn calibrate(&mut self, filtered: &Filtered<'_>) {
        let Self { sums, spectra, .. } = &*self;
        let (grid, motions) = (filtered.grid, filtered.motions);
        let of_row =
            |pool: &mut Pool, row: usize| Arch::default().dispatch(Calibrate { sums, spectra, motions, row, pool });
        let rows = (POOL..grid.rows).into_par_iter().step_by(Calibrate::STEP);
        let found: Vec<Calibration> = rows.map_init(Pool::default, of_row).collect();
        // In order, so that the sum is the same for any number of threads.
        let found = found.into_iter().fold(Calibration::default(), |all, row| all.plus_share(1.0, row));
        self.calibration = self.calibration.plus_share(f64::from(filtered.kept), found);
    }

    /// Solves for the shares of the residuals that are signal.
    fn solve(&mut self, filtered: &Filtered<'_>) {
        let Self { sums, spectra, calibration, minimum, shares, .. } = self;
        let (sums, spectra, calibration, motions) = (&*sums, &*spectra, *calibration, filtered.motions);
        let noise = calibration.noise_spectra(filtered.guided);
        let stride = filtered.grid.stride();
        let (before, now) = minimum.advance();
        let rows = shares.data.par_chunks_mut(SOLVED * stride).zip(now.data.par_chunks_mut(stride));
        rows.enumerate().with_min_len(8).for_each_init(Pool::default, |pool, (row, (to, minima))| {
            Arch::default().dispatch(Solve {
                sums,
                spectra,
                motions,
                row,
                pool,
                calibration,
                noise,
                before,
                minima,
                to,
            });
        });
    }

    /// Adds the signal to the filtered colors.
    fn add_signal(&mut self, filtered: &Filtered<'_>, to: &mut frame::Denoised) {
        let Self { coherence, shares, .. } = self;
        let frame = filtered.frame;
        to.color.resize(frame.color.len(), Vec3::ZERO);
        let rows = to.color.par_chunks_mut(frame.size[0]).zip(coherence.lines()).enumerate();
        rows.with_min_len(8).for_each_init(Interpolated::default, |interpolated, (row, (to, taken))| {
            Arch::default().dispatch(GiveBack { filtered, shares, row, interpolated, to, taken });
        });
        if !filtered.alone {
            coherence.give_back(frame, shares, &mut to.color);
        }
    }

    /// Estimates the noise of the frame, and the error that is left.
    fn estimate(&mut self, filtered: &Filtered<'_>, to: &mut frame::Denoised) {
        let Self { sums, shares, rows: of_rows, .. } = &*self;
        let grid = filtered.grid;
        let of_row = |row: usize| {
            let plane = |plane: usize| &sums.row(row, plane)[..grid.columns];
            let blocks = estimate::Blocks {
                pixels: plane(ADDED + PIXELS),
                noise: plane(ADDED + NOISE_POWER),
                residual: plane(ADDED + RESIDUAL_POWER),
                shares: shares.row(row, 0),
                own: filtered.own.row(row, 0),
                motions: filtered.motions.get(row * grid.columns..).unwrap_or_default(),
            };
            Estimate::of_row(blocks, of_rows[row])
        };
        let estimates: Vec<Estimate> = (0..grid.rows).into_par_iter().map(of_row).collect();
        // In order, so that the sum is the same for any number of threads.
        let found = estimates.into_iter().fold(Estimate::default(), Estimate::plus);
        self.since = self.since.plus_share(f64::from(filtered.kept), found);
        to.estimate = Some(found).filter(|found| found.pixels > 0.0);
    }

    /// Maps noise and error, pixel by pixel.
    fn map(&mut self, filtered: &Filtered<'_>, to: &mut frame::Denoised) {
        let Self { sums, shares, since, maps, .. } = self;
        let (grid, frame) = (filtered.grid, filtered.frame);
        // What others told of the noise of a first frame does not tell its error.
        let fits = since.fits() && !filtered.told;
        let planes = maps.data.par_chunks_mut(estimate::MAPPED * grid.stride()).enumerate();
        planes.for_each_init(Pool::default, |pool, (row, to)| {
            let which = [PIXELS, NOISE_POWER, RESIDUAL_POWER].map(|place| (SINCE + place, POOL));
            let (vectors, pooled) = pool.sums(sums, row, which.into_iter());
            let planes = [0, 1, 2].map(|plane| &pooled[plane * vectors..][..vectors]);
            estimate::map_row(planes, shares.row(row, 0), fits, to);
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
}

/// Gives the signal back to a row of pixels.
struct GiveBack<'a> {
    filtered: &'a Filtered<'a>,
    shares: &'a Planes,
    row: usize,
    interpolated: &'a mut Interpolated,
    to: &'a mut [Vec3],
    /// Where the brightness goes that is taken away.
    taken: &'a mut [f32],
}

impl pulp::NullaryFnOnce for GiveBack<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { filtered, shares, row, interpolated, to, taken } = self;
        let Filtered { frame, grid, colors, before, alpha, floor, .. } = *filtered;
        // In units of the picture's brightness, so that squares of products stay numbers.
        let unit = 1.0 / floor.sqrt();
        let width = to.len();
        let (one, groups) = (Lanes([1.0; LANES]), row * vectors(width));
        interpolated.take(grid, row, shares);
        let pixels = frame.color[row * width..][..width].chunks(LANES);
        let (colors, before) = (&colors[groups..], &before[groups..]);
        let after = frame.ahead.map(|ahead| &ahead.differences[groups..]);
        // A single picture is compared with what comes out of it: how much changes tells noise from detail.
        let alphas = alpha.filter(|_| !filtered.alone).map(|alpha| &alpha[row * width..][..width]);
        for (at, ((to, pixels), found)) in to.chunks_mut(LANES).zip(pixels).zip(colors).enumerate() {
            let (color, seen) = loaded(pixels);
            let residual: [Lanes; CHANNELS] = each(|c| color[c] - found[c]);
            let noise = interpolated.at(1, at);
            let bright = ramp(dot(&residual, &residual), noise, BRIGHT);
            // Few pixels are, and differences are not read where none is.
            let steady = if bright.0 == [0.0; LANES] {
                bright
            } else {
                let after = after.map_or(Difference::default(), |after| difference::whole(&after[at]));
                bright * steady(&residual, [&difference::whole(&before[at]), &after])
            };
            let share = interpolated.at(0, at).max(steady) * seen;
            let rest = one - share;
            let alpha =
                alphas.map_or(one, |alphas| Lanes(each(|lane| alphas.get(at * LANES + lane).copied().unwrap_or(0.0))));
            // 0 where color and alpha are so, and elsewhere 1.
            let is_there = Lanes(each(|lane| {
                let [r, g, b]: [f32; 3] = each(|c| color[c].0[lane]);
                if seen.0[lane] > 0.0 && alpha.0[lane] == 0.0 && [r, g, b] == [0.0; 3] { 0.0 } else { 1.0 }
            }));
            let mixed: [Lanes; 3] = each(|c| is_there.select(found[c] * rest + color[c] * share, Lanes::ZERO));
            let of = |c: usize| color[c] - mixed[c];
            let light = ((of(0) + of(1)) + of(2)) * unit;
            seen.select(light, Lanes([f32::NAN; LANES])).store(taken, MARGIN + at * LANES);
            for (lane, to) in to.iter_mut().enumerate() {
                *to = Vec3::new(mixed[0].0[lane], mixed[1].0[lane], mixed[2].0[lane]);
            }
        }
    }
}

/// Returns 0 where squares are below the first multiple of others, 1 above the second, and a linear ramp between.
#[inline(always)]
fn ramp(square: Lanes, of: Lanes, limits: [f32; 2]) -> Lanes {
    between(square / of.max(Lanes([LEAST; LANES])), limits)
}

/// Returns the share of the residuals of eight pixels that is signal because the frames before and after, as far as
/// they show the pixels, show the same. So a point of light that shines on is told from a bright path.
#[inline(always)]
fn steady(residual: &[Lanes; CHANNELS], [before, after]: [&Difference; 2]) -> Lanes {
    // Differences that are not known are 0.
    ramp(dot(residual, residual), dot(before, before).max(dot(after, after)), STEADY)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use crate::denoise::Frame;
    use crate::denoise::ahead::Ahead;
    use crate::denoise::difference::{Halved, halved};
    use crate::denoise::illumination;
    use crate::denoise::vectors::Features;

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
            let filtered = |i: usize| truth(i) + Vec3::splat(error(i));
            let colors = lanes(filtered);
            let apart = |k: u32, known: bool| -> Vec<Halved> {
                let known = Lanes([if known { 1.0 } else { 0.0 }; LANES]);
                lanes(|i| color[i] - seen(k, i)).iter().map(|apart| halved(apart, known)).collect()
            };
            let (before, after) = (apart(1, sides > 0), apart(2, sides > 1));
            let ahead = Ahead { size: SIZE, frames: 1, differences: after, ..Ahead::default() };
            let frame = Frame { size: SIZE, color: &color, ahead: Some(&ahead), ..Frame::default() };
            let grid = Grid::over(SIZE);
            let given = Filtered {
                frame: &frame,
                grid,
                motions: &[],
                own: &Planes::new(grid, 1),
                colors: &colors,
                before: &before,
                illumination: &Planes::new(grid, illumination::CHANGES),
                guided: false,
                alpha: None,
                floor: 0.01,
                kept: 0.88,
                alone: false,
                told: false,
                mapped: true,
            };
            let mut to = frame::Denoised::default();
            residuals.give_back(&given, &mut to);
            for (i, to) in to.color.iter().enumerate() {
                let errors = [color[i] - truth(i), filtered(i) - truth(i), *to - truth(i)];
                sums = each(|k| sums[k] + errors[k].length_squared() / (3 * color.len()) as f32);
            }
        }
        sums
    }

    /// A point that shines on comes back, on whatever side of time it is seen, and where no other frame shows it; a
    /// bright path does not, and nothing does that may be noise.
    #[test]
    fn points_that_shine_on_come_back() {
        let residual = [Lanes([0.8; LANES]); CHANNELS];
        let share = |apart: [Option<f32>; 2]| {
            let [before, after] = apart.map(|apart| -> Difference {
                let known = if apart.is_some() { 1.0 } else { 0.0 };
                each(|i| Lanes([if i < CHANNELS { apart.unwrap_or(0.0) } else { known }; LANES]))
            });
            steady(&residual, [&before, &after]).0[0]
        };
        for apart in [[Some(0.01), Some(-0.01)], [None, Some(0.01)], [None, None]] {
            assert_eq!(share(apart), 1.0);
        }
        for apart in [[Some(0.8), Some(0.79)], [Some(0.01), Some(0.8)], [None, Some(0.8)]] {
            assert_eq!(share(apart), 0.0);
        }
        let bright = |residual: f32, noise: f32| ramp(Lanes([residual; LANES]), Lanes([noise; LANES]), BRIGHT).0[0];
        assert_eq!([bright(0.64, 1e-4), bright(4e-4, 1e-4), bright(0.64, 1e30)], [1.0, 0.0, 0.0]);
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
            // Of pixels that no other frame shows, what is left of the noise has no mean, which this has.
            let most = if sides == 0 { 0.02 } else { 1e-3 };
            assert!(after < most * noise, "{sides}: {after} of {noise}");
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
