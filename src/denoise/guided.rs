//! Regression on a reprojected history, pooled over neighbourhoods: a guided filter in space and time.
//!
//! The feature of a pixel is the history of its colors that was reprojected to it, smoothed over its neighbours; the color of
//! this frame is not part of it, so that the noise of both is independent. Two models of the color by the feature are learned
//! by recursive least squares: a steady one that forgets slowly, and a quick one that forgets soon, from a smoother feature and
//! over larger neighbourhoods. Their sums are pooled over blocks of pixels around ([`blocks`](super::blocks)), which takes
//! the place of a blend of neighbouring models.
//!
//! How far a pixel trusts the quick model follows from the innovations: with the predictions a and b of both *before* the
//! color I of this frame is learned, the error of `b + w (a - b)` is least for `w = Σ (I - b)(a - b) / Σ (a - b)²`, in which
//! the noise of I cancels on average. The weight shrinks towards 0 by what chance alone would give (James & Stein 1961).

use super::blocks::{BLOCK, COEFFICIENTS, Grid, Interpolated, Planes, Pool, TERMS, solve_row};
use super::frame::{Denoised, Frame, around};
use super::lanes::{LANES, Lanes, each};
use crate::arch::Arch;
use crate::error::Result;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Constants of a model.
struct Model {
    /// Share of what was learned that is kept from frame to frame.
    forgetting: f32,
    /// Greatest share of the history in its next state.
    history: f32,
    /// Pixels to each side over which the history is smoothed to the feature.
    smooth: usize,
    /// Blocks to each side over which sums are pooled.
    pool: usize,
}

/// The quick and the steady model.
const MODELS: [Model; 2] = [
    Model { forgetting: 0.6, history: 0.75, smooth: 1, pool: 2 },
    Model { forgetting: 0.9, history: 0.9, smooth: 2, pool: 1 },
];

/// Greatest number of pixels over which a feature is smoothed.
const HALO: usize = 2;

/// Numbers kept of a pixel: the history and the count of its frames, by model.
type Pixel = [f32; 8];

/// Planes of the innovations: `(a - b)²`, `(I - b)(a - b)`, `(I - b)²` and the count.
const INNOVATIONS: usize = 4;
/// Share of the innovations that is kept from frame to frame.
const REMEMBERED: f32 = 0.8;
/// Blocks to each side over which innovations are pooled.
const INNOVATIONS_POOL: usize = 1;
/// Number of standard errors, squared, that shrinks the weight of the quick model.
const CHANCE: f32 = 2.0;

/// Numbers kept of a block.
const STATE: usize = 2 * TERMS + INNOVATIONS;

/// Sums of a block.
type Sums = [f32; STATE];

/// Vectors of sums.
const VECTORS: usize = STATE / LANES;

/// Rows of pixels that a task takes.
const BAND: usize = 8 * BLOCK;

/// Multiple of the feature above which a color is cut before it enters the history. That biases the feature, which need not
/// be without bias.
const HISTORY_LIMIT: f32 = 8.0;

/// Multiple of the feature above which a color is cut before it is learned: a path of that brightness would outweigh all
/// that was learned.
const COLOR_LIMIT: f32 = 64.0;

/// Largest number taken from a picture, so that no product overflows.
const LARGEST: f32 = 1e12;

/// State of a sequence between frames.
#[derive(Debug, Clone, Default)]
pub struct Guided {
    size: [usize; 2],
    pixels: Vec<Pixel>,
    blocks: Vec<Sums>,
    /// Root mean square of the feature of the frame before.
    level: f32,
}

/// Memory that frames reuse.
#[derive(Debug, Default)]
struct Scratch {
    pixels: Vec<Pixel>,
    features: Vec<Features>,
    /// Sums of blocks that moved along, plane after plane.
    sums: Planes,
    /// Sums that moved along, block by block.
    blocks: Vec<Sums>,
    /// Sums of the frame.
    fresh: Vec<Sums>,
    coefficients: Planes,
    weights: Planes,
}

/// Denoiser with its scratch.
#[derive(Debug, Default)]
pub struct GuidedDenoiser {
    state: Guided,
    scratch: Scratch,
}

/// Vectors in a row of pixels.
fn vectors(width: usize) -> usize {
    width.div_ceil(LANES)
}

/// Features of eight pixels: three channels by model.
type Features = [Lanes; 6];

/// Colors of eight pixels, and their weights: 1 where there is a color.
type Colors = [Lanes; 4];

impl GuidedDenoiser {
    /// Forgets all, as at a cut, and frees the memory.
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    /// Denoises the next frame. A frame of another size begins anew.
    ///
    /// # Errors
    /// If the frame does not have as many colors, or motions, as pixels.
    pub fn denoise(&mut self, frame: &Frame<'_>) -> Result<Denoised> {
        frame.check()?;
        let grid = Grid::over(frame.size);
        if self.state.size != frame.size {
            self.state = Guided { size: frame.size, ..Guided::default() };
            self.scratch = Scratch {
                pixels: vec![[0.0; 8]; frame.color.len()],
                features: vec![Features::default(); frame.size[1] * vectors(frame.size[0])],
                sums: Planes::new(grid, STATE),
                blocks: vec![[0.0; STATE]; grid.rows * grid.columns],
                fresh: vec![[0.0; STATE]; grid.rows * grid.columns],
                coefficients: Planes::new(grid, 2 * COEFFICIENTS),
                weights: Planes::new(grid, 2),
            };
        }
        self.carry(frame, grid);
        self.solve(grid);
        self.learn(frame, grid);
        self.update(grid);
        self.solve(grid);
        Ok(self.predict(frame.size, grid))
    }

    /// Moves the sums of the frame before along with the motion.
    fn carry(&mut self, frame: &Frame<'_>, grid: Grid) {
        let blocks = &self.state.blocks;
        let Scratch { sums, blocks: moved, .. } = &mut self.scratch;
        if blocks.is_empty() {
            sums.data.fill(0.0);
            moved.fill([0.0; STATE]);
            return;
        }
        let arch = Arch::default();
        let rows = sums.data.par_chunks_mut(STATE * grid.stride()).zip(moved.par_chunks_mut(grid.columns)).enumerate();
        rows.for_each(|(row, (planes, moved))| arch.dispatch(Carry { frame, grid, blocks, row, moved, planes, arch }));
    }

    /// Solves for the coefficients of all blocks, and finds the weights of the quick model.
    fn solve(&mut self, grid: Grid) {
        let Scratch { sums, coefficients, weights, .. } = &mut self.scratch;
        let sums = &*sums;
        let stride = grid.stride();
        let rows = coefficients.data.par_chunks_mut(2 * COEFFICIENTS * stride);
        let rows = rows.zip(weights.data.par_chunks_mut(2 * stride)).enumerate();
        rows.for_each_init(
            || (Pool::default(), [vec![0.0; stride], vec![0.0; stride]]),
            |(pool, counts), (row, (coefficients, weights))| {
                Arch::default().dispatch(Solve { sums, row, pool, counts, coefficients, weights });
            },
        );
    }

    /// Follows the histories, takes the features from them, and sums what is to be learned of the frame.
    fn learn(&mut self, frame: &Frame<'_>, grid: Grid) {
        let [width, _] = frame.size;
        let Scratch { pixels, features, fresh, coefficients, .. } = &mut self.scratch;
        let known = Known { state: &self.state, frame, grid, coefficients, arch: Arch::default() };
        let rows = pixels.par_chunks_mut(BAND * width);
        let rows = rows.zip(features.par_chunks_mut(BAND * vectors(width)));
        let rows = rows.zip(fresh.par_chunks_mut(BAND / BLOCK * grid.columns)).enumerate();
        rows.for_each_init(BandScratch::default, |scratch, (band, ((pixels, features), fresh))| {
            Arch::default().dispatch(Learn { known: &known, top: band * BAND, pixels, features, fresh, scratch });
        });
        std::mem::swap(&mut self.state.pixels, &mut self.scratch.pixels);
        // The next frame of a fresh state has swapped in an empty one.
        self.scratch.pixels.resize(self.state.pixels.len(), [0.0; 8]);
    }

    /// Forgets a part of the sums and adds those of the frame.
    fn update(&mut self, grid: Grid) {
        let Scratch { sums, blocks, fresh, .. } = &mut self.scratch;
        let arch = Arch::default();
        let rows = sums.data.par_chunks_mut(STATE * grid.stride()).zip(fresh.par_chunks(grid.columns));
        rows.zip(blocks.par_chunks_mut(grid.columns))
            .for_each(|((planes, fresh), blocks)| arch.dispatch(Update { planes, fresh, blocks, arch }));
        // In order, so that the sum is the same for any number of threads.
        let [mut power, mut count] = [0.0_f64; 2];
        for sums in &*fresh {
            let steady = &sums[TERMS..];
            power += f64::from(steady[4] + steady[7] + steady[9]);
            count += f64::from(steady[0]);
        }
        if count > 0.0 {
            self.state.level = (power / count).sqrt() as f32;
        }
        std::mem::swap(&mut self.state.blocks, blocks);
        blocks.resize(grid.rows * grid.columns, [0.0; STATE]);
    }

    /// Returns the colors that the models predict.
    fn predict(&self, [width, height]: [usize; 2], grid: Grid) -> Denoised {
        let scratch = &self.scratch;
        let mut color = vec![Vec3::ZERO; width * height];
        let mut confidence = vec![0.0; width * height];
        let rows = color.par_chunks_mut(width).zip(confidence.par_chunks_mut(width)).enumerate();
        rows.with_min_len(8).for_each_init(
            || (Interpolated::default(), Interpolated::default()),
            |(models, trust), (row, (color, confidence))| {
                Arch::default().dispatch(Predict { scratch, grid, row, models, trust, color, confidence });
            },
        );
        Denoised { color, confidence }
    }
}

/// Moves the sums of a row of blocks along.
struct Carry<'a> {
    frame: &'a Frame<'a>,
    grid: Grid,
    blocks: &'a [Sums],
    row: usize,
    moved: &'a mut [Sums],
    planes: &'a mut [f32],
    arch: Arch,
}

impl pulp::NullaryFnOnce for Carry<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { frame, grid, blocks, row, moved, planes, arch } = self;
        for (column, moved) in moved.iter_mut().enumerate() {
            let motion = match frame.motion {
                Some(motion) => mean_motion(motion, frame.size, [column, row]),
                None => Some(Vec2::ZERO),
            };
            *moved = [0.0; STATE];
            if let Some(motion) = motion {
                let place = Vec2::new(column as f32, row as f32) + motion / BLOCK as f32;
                if let Some(found) = around([grid.columns, grid.rows], place) {
                    *moved = found.sum(blocks);
                }
            }
        }
        to_planes(arch, moved, planes, grid.stride());
    }
}

/// Writes the sums of a row of blocks plane after plane.
#[inline(always)]
fn to_planes(arch: Arch, blocks: &[Sums], planes: &mut [f32], stride: usize) {
    for (at, blocks) in blocks.chunks(LANES).enumerate() {
        for vector in 0..VECTORS {
            let mut rows = [[0.0; LANES]; LANES];
            for (row, block) in rows.iter_mut().zip(blocks) {
                *row = block.as_chunks().0[vector];
            }
            for (i, values) in arch.transposed(&rows).into_iter().enumerate() {
                Lanes(values).store(planes, (vector * LANES + i) * stride + at * LANES);
            }
        }
    }
}

/// Solves for a row of blocks.
struct Solve<'a> {
    sums: &'a Planes,
    row: usize,
    pool: &'a mut Pool,
    counts: &'a mut [Vec<f32>; 2],
    coefficients: &'a mut [f32],
    weights: &'a mut [f32],
}

impl pulp::NullaryFnOnce for Solve<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { sums, row, pool, counts, coefficients, weights } = self;
        let [quick, steady] = counts;
        let (first, second) = coefficients.split_at_mut(coefficients.len() / 2);
        for (i, (coefficients, counts)) in [(first, &mut *quick), (second, &mut *steady)].into_iter().enumerate() {
            solve_row(sums, row, i * TERMS, MODELS[i].pool, pool, coefficients, counts);
        }
        weigh(sums, row, pool, [quick, steady], weights);
    }
}

/// Learns a band of rows.
struct Learn<'a> {
    known: &'a Known<'a>,
    top: usize,
    pixels: &'a mut [Pixel],
    features: &'a mut [Features],
    fresh: &'a mut [Sums],
    scratch: &'a mut BandScratch,
}

impl pulp::NullaryFnOnce for Learn<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        self.known.learn_band(self.top, self.pixels, self.features, self.fresh, self.scratch);
    }
}

/// Shares of the sums of a block that are kept from frame to frame.
const KEPT: Sums = {
    let mut kept = [REMEMBERED; STATE];
    let mut at = 0;
    while at < 2 * TERMS {
        kept[at] = MODELS[at / TERMS].forgetting;
        at += 1;
    }
    kept
};

/// Forgets a part of the sums of a row of blocks, and adds others.
struct Update<'a> {
    planes: &'a mut [f32],
    fresh: &'a [Sums],
    blocks: &'a mut [Sums],
    arch: Arch,
}

impl pulp::NullaryFnOnce for Update<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        for (block, fresh) in self.blocks.iter_mut().zip(self.fresh) {
            for at in 0..STATE {
                block[at] = KEPT[at] * block[at] + fresh[at];
            }
        }
        let stride = self.planes.len() / STATE;
        to_planes(self.arch, self.blocks, self.planes, stride);
    }
}

/// Predicts a row of pixels.
struct Predict<'a> {
    scratch: &'a Scratch,
    grid: Grid,
    row: usize,
    models: &'a mut Interpolated,
    trust: &'a mut Interpolated,
    color: &'a mut [Vec3],
    confidence: &'a mut [f32],
}

impl pulp::NullaryFnOnce for Predict<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { scratch, grid, row, models, trust, color, confidence } = self;
        let Scratch { features, coefficients, weights, .. } = scratch;
        models.take(grid, row, coefficients);
        trust.take(grid, row, weights);
        let features = &features[row * vectors(color.len())..][..vectors(color.len())];
        let groups = color.chunks_mut(LANES).zip(confidence.chunks_mut(LANES)).zip(features).enumerate();
        for (at, ((color, confidence), [p, q, r, u, v, w])) in groups {
            let quick = prediction(models, 0, at, [*p, *q, *r]);
            let steady = prediction(models, 1, at, [*u, *v, *w]);
            let (weight, counts) = (trust.at(0, at), trust.at(1, at));
            let mut mixed = steady;
            for c in 0..3 {
                mixed[c] = (steady[c] + (quick[c] - steady[c]) * weight).max(Lanes::ZERO);
            }
            for (lane, (color, confidence)) in color.iter_mut().zip(confidence).enumerate() {
                *color = Vec3::new(mixed[0].0[lane], mixed[1].0[lane], mixed[2].0[lane]);
                *confidence = counts.0[lane];
            }
        }
    }
}

/// Returns the mean motion of the pixels of a block that have one; `None` if none does.
#[inline(always)]
fn mean_motion(motion: &[Vec2], [width, height]: [usize; 2], [column, row]: [usize; 2]) -> Option<Vec2> {
    let (mut sum, mut count) = (Vec2::ZERO, 0.0);
    for y in row * BLOCK..(row * BLOCK + BLOCK).min(height) {
        for motion in &motion[y * width..][column * BLOCK..(column * BLOCK + BLOCK).min(width)] {
            if motion.is_finite() {
                sum += *motion;
                count += 1.0;
            }
        }
    }
    (count > 0.0).then(|| sum / count)
}

/// Returns the color of eight pixels by a model's interpolated coefficients.
#[inline(always)]
fn prediction(models: &Interpolated, model: usize, at: usize, z: [Lanes; 3]) -> [Lanes; 3] {
    let mut color = [Lanes::ZERO; 3];
    for c in 0..3 {
        let first = model * COEFFICIENTS + c;
        let (a, b) = (models.at(first, at), models.at(first + 3, at) * z[0]);
        let (e, d) = (models.at(first + 6, at) * z[1], models.at(first + 9, at) * z[2]);
        color[c] = (a + b) + (e + d);
    }
    color
}

/// Finds the weight of the quick model in a row of blocks, and the samples that both rest on.
#[inline(always)]
fn weigh(sums: &Planes, row: usize, pool: &mut Pool, counts: [&[f32]; 2], weights: &mut [f32]) {
    let stride = counts[0].len();
    let (vectors, pooled) = pool.sums(sums, row, (2 * TERMS..STATE).map(|plane| (plane, INNOVATIONS_POOL)));
    for vector in 0..vectors {
        let [apart, along, error, count] = each(|i| pooled[i * vectors + vector]);
        let tiny = Lanes([1e-30; LANES]);
        let best = along / (apart + tiny);
        let chance = (apart * error) * CHANCE / (count * along * along + tiny);
        let shrunk = best * (Lanes([1.0; LANES]) - chance).max(Lanes::ZERO);
        let weight = shrunk.max(Lanes::ZERO).min(Lanes([1.0; LANES]));
        weight.store(weights, vector * LANES);
        let (quick, steady) = (Lanes::load(counts[0], vector * LANES), Lanes::load(counts[1], vector * LANES));
        (steady + (quick - steady) * weight).store(weights, stride + vector * LANES);
    }
}

/// Scratch of a band of rows.
#[derive(Debug, Default)]
struct BandScratch {
    /// Reprojected pixels of the band's rows and a halo, plane after plane within a row; each line has a margin.
    warped: Vec<f32>,
    /// Sums of rows.
    line: Vec<f32>,
    /// Colors of the band.
    colors: Vec<Colors>,
}

/// State and inputs when a frame is learned.
struct Known<'k> {
    state: &'k Guided,
    frame: &'k Frame<'k>,
    grid: Grid,
    /// Coefficients before the frame is learned.
    coefficients: &'k Planes,
    arch: Arch,
}

/// Numbers before and after the pixels of a line.
const MARGIN: usize = LANES;

impl Known<'_> {
    /// Learns a band of rows from `top` on.
    #[inline(always)]
    fn learn_band(
        &self,
        top: usize,
        pixels: &mut [Pixel],
        features: &mut [Features],
        fresh: &mut [Sums],
        scratch: &mut BandScratch,
    ) {
        let [width, height] = self.frame.size;
        let rows = pixels.len() / width;
        let groups = vectors(width);
        let line = groups * LANES + 2 * MARGIN;
        scratch.colors.resize(BAND * groups, Colors::default());
        scratch.warped.resize((BAND + 2 * HALO) * 8 * line, 0.0);
        for row in 0..rows + 2 * HALO {
            let y = (top + row).saturating_sub(HALO).min(height - 1);
            self.warp(y, &mut scratch.warped[row * 8 * line..][..8 * line]);
        }
        for row in 0..rows {
            let features = &mut features[row * groups..][..groups];
            for (i, model) in MODELS.iter().enumerate() {
                for c in 0..3 {
                    let (warped, sums) = (&scratch.warped, &mut scratch.line);
                    match model.smooth {
                        1 => smooth::<1>(warped, row + HALO, 4 * i + c, line, sums, features, 3 * i + c),
                        _ => smooth::<HALO>(warped, row + HALO, 4 * i + c, line, sums, features, 3 * i + c),
                    }
                }
            }
            let warped = &scratch.warped[(row + HALO) * 8 * line..][..8 * line];
            let colors = &mut scratch.colors[row * groups..][..groups];
            self.follow(top + row, warped, features, colors, &mut pixels[row * width..][..width]);
        }
        let blocks = features.chunks(BLOCK * groups).zip(scratch.colors.chunks(BLOCK * groups));
        let blocks = blocks.zip(fresh.chunks_mut(self.grid.columns)).enumerate();
        for (row, ((features, colors), fresh)) in blocks {
            self.sum(top / BLOCK + row, features, colors, fresh);
        }
    }

    /// Reprojects a row of pixels to the lines of eight planes, with the outermost ones repeated in their margins.
    #[inline(always)]
    fn warp(&self, y: usize, lines: &mut [f32]) {
        let [width, _] = self.frame.size;
        let line = lines.len() / 8;
        let motion = self.frame.motion.map(|motion| &motion[y * width..][..width]);
        for left in (0..width).step_by(LANES) {
            let mut found = [[0.0; LANES]; LANES];
            for (x, found) in (left..width).zip(&mut found) {
                *found = self.before([x, y], motion.map_or(Vec2::ZERO, |motion| motion[x]));
            }
            for (plane, values) in self.arch.transposed(&found).into_iter().enumerate() {
                Lanes(values).store(lines, plane * line + MARGIN + left);
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
        let pixels = &self.state.pixels;
        if !pixels.is_empty()
            && let Some(found) = around(self.frame.size, Vec2::new(x as f32, y as f32) + motion)
        {
            let pixel = found.sum(pixels);
            return if found.covered == 1.0 { pixel } else { each(|i| pixel[i] / found.covered) };
        }
        let [r, g, b] = self.calm([x, y]).to_array();
        [r, g, b, 0.0, r, g, b, 0.0]
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

    /// Takes a row's colors to planes, cut where they are far above their features, and writes the next state of its
    /// histories. The fourth plane is 1 where there is a color.
    #[inline(always)]
    fn follow(&self, y: usize, warped: &[f32], features: &[Features], colors: &mut [Colors], pixels: &mut [Pixel]) {
        let [width, _] = self.frame.size;
        let line = warped.len() / 8;
        let row = &self.frame.color[y * width..][..width];
        let one = Lanes([1.0; LANES]);
        let mut planes: [&[[f32; LANES]]; 8] = [&[]; 8];
        for (plane, lines) in planes.iter_mut().zip(warped.chunks(line)) {
            *plane = &lines[MARGIN..].as_chunks().0[..features.len()];
        }
        let groups = row.chunks(LANES).zip(pixels.chunks_mut(LANES)).zip(features.iter().zip(colors)).enumerate();
        for (at, ((row, pixels), (features, colors))) in groups {
            let mut color = [Lanes::ZERO; 3];
            let mut seen = Lanes::ZERO;
            for (lane, found) in row.iter().enumerate() {
                if let Some(found) = within(*found) {
                    seen.0[lane] = 1.0;
                    for c in 0..3 {
                        color[c].0[lane] = found[c];
                    }
                }
            }
            let around = features[0].max(features[1]).max(features[2]);
            let most = color[0].max(color[1]).max(color[2]).max(Lanes([1e-30; LANES]));
            let cut = |limit: f32| (around * limit).select((around * limit / most).min(one), one);
            let learned = cut(COLOR_LIMIT);
            *colors = [color[0] * learned, color[1] * learned, color[2] * learned, seen];
            let followed = cut(HISTORY_LIMIT);
            let mut next = [[0.0; LANES]; LANES];
            for (i, model) in MODELS.iter().enumerate() {
                let count = Lanes::of(&planes[4 * i + 3][at]);
                let keep = (count / (count + one)).min(Lanes([model.history; LANES]));
                for c in 0..3 {
                    let before = Lanes::of(&planes[4 * i + c][at]);
                    next[4 * i + c] = seen.select(before * keep + color[c] * followed * (one - keep), before).0;
                }
                next[4 * i + 3] = (count + seen).min(Lanes([64.0; LANES])).0;
            }
            for (pixel, next) in pixels.iter_mut().zip(self.arch.transposed(&next)) {
                *pixel = next;
            }
        }
    }

    /// Sums what is to be learned over the blocks of a row.
    #[inline(always)]
    fn sum(&self, row: usize, features: &[Features], colors: &[Colors], fresh: &mut [Sums]) {
        let groups = vectors(self.frame.size[0]);
        let rows = features.len() / groups;
        for (at, fresh) in fresh.chunks_mut(LANES / BLOCK).enumerate() {
            let mut sums = [Lanes::ZERO; STATE];
            for model in 0..2 {
                let (mut inputs, mut moments) = ([Lanes::ZERO; 10], [Lanes::ZERO; 12]);
                for row in 0..rows {
                    let features = &features[row * groups + at];
                    let z = [features[3 * model], features[3 * model + 1], features[3 * model + 2]];
                    add_products(&mut inputs, z, colors[row * groups + at][3]);
                }
                for row in 0..rows {
                    let features = &features[row * groups + at];
                    let z = [features[3 * model], features[3 * model + 1], features[3 * model + 2]];
                    add_moments(&mut moments, z, &colors[row * groups + at]);
                }
                sums[model * TERMS..][..10].copy_from_slice(&inputs);
                sums[model * TERMS + 10..][..12].copy_from_slice(&moments);
            }
            if !self.state.blocks.is_empty() {
                sums[2 * TERMS..].copy_from_slice(&self.innovations(row, features, colors, groups, at));
            }
            for vector in 0..VECTORS {
                let mut rows = [[0.0; LANES]; LANES];
                for (row, sum) in rows.iter_mut().zip(&sums[vector * LANES..]) {
                    *row = sum.0;
                }
                let pixels = self.arch.transposed(&rows);
                for (block, fresh) in pixels.chunks(BLOCK).zip(&mut *fresh) {
                    let sum = (Lanes(block[0]) + Lanes(block[1])) + (Lanes(block[2]) + Lanes(block[3]));
                    sum.store(fresh, vector * LANES);
                }
            }
        }
    }

    /// Returns the sums of the innovations of eight columns of a row of blocks. The coefficients are those of the blocks,
    /// without interpolation.
    #[inline(always)]
    fn innovations(
        &self,
        row: usize,
        features: &[Features],
        colors: &[Colors],
        groups: usize,
        at: usize,
    ) -> [Lanes; INNOVATIONS] {
        let mut beta = [Lanes::ZERO; 2 * COEFFICIENTS];
        for (plane, beta) in beta.iter_mut().enumerate() {
            let [a, b] = self.coefficients.row(row, plane).as_chunks().0[at];
            *beta = Lanes::halves(a, b);
        }
        let floor = Lanes([(1e-2 * self.state.level).powi(2) + 1e-30; LANES]);
        let mut sums = [Lanes::ZERO; INNOVATIONS];
        for row in 0..features.len() / groups {
            let ([p, q, r, u, v, w], color) = (features[row * groups + at], colors[row * groups + at]);
            let [mut apart, mut along, mut error] = [Lanes::ZERO; 3];
            for c in 0..3 {
                let a = (beta[c] + beta[3 + c] * p) + (beta[6 + c] * q + beta[9 + c] * r);
                let b = (beta[12 + c] + beta[15 + c] * u) + (beta[18 + c] * v + beta[21 + c] * w);
                let (d, e) = (a - b, color[c] - b);
                apart += d * d;
                along += d * e;
                error += e * e;
            }
            let share = color[3] / (p * p + q * q + r * r + floor);
            sums[0] += apart * share;
            sums[1] += along * share;
            sums[2] += error * share;
            sums[3] += color[3];
        }
        sums
    }
}

/// Returns a color whose numbers are small enough to be multiplied; `None` if it is not finite.
#[inline(always)]
fn within(color: Vec3) -> Option<Vec3> {
    color.is_finite().then(|| color.clamp(Vec3::splat(-LARGEST), Vec3::splat(LARGEST)))
}

/// Adds the count, the features and their products of eight pixels to sums.
#[inline(always)]
fn add_products(sums: &mut [Lanes; 10], z: [Lanes; 3], weight: Lanes) {
    let [a, b, c] = [z[0] * weight, z[1] * weight, z[2] * weight];
    let terms = [weight, a, b, c, a * z[0], a * z[1], a * z[2], b * z[1], b * z[2], c * z[2]];
    for (sum, term) in sums.iter_mut().zip(terms) {
        *sum += term;
    }
}

/// Adds the colors of eight pixels and their products with the features to sums.
#[inline(always)]
fn add_moments(sums: &mut [Lanes; 12], z: [Lanes; 3], color: &Colors) {
    for c in 0..3 {
        sums[c] += color[c];
        for i in 0..3 {
            sums[3 + 3 * i + c] += z[i] * color[c];
        }
    }
}

/// Returns the means of a plane's lines over the pixels within `RADIUS` of those of a row.
#[inline(always)]
fn smooth<const RADIUS: usize>(
    warped: &[f32],
    row: usize,
    plane: usize,
    line: usize,
    sums: &mut Vec<f32>,
    into: &mut [Features],
    channel: usize,
) {
    sums.resize(line, 0.0);
    let rows: [&[[f32; LANES]]; 2 * HALO + 1] =
        each_line(warped, line, |i| (row + i.min(2 * RADIUS) - RADIUS) * 8 + plane);
    let (to, _) = sums.as_chunks_mut::<LANES>();
    for (at, to) in to.iter_mut().enumerate() {
        let mut sum = Lanes::of(&rows[0][at]);
        for row in &rows[1..2 * RADIUS + 1] {
            sum += Lanes::of(&row[at]);
        }
        *to = sum.0;
    }
    let side = 2 * RADIUS + 1;
    let share = 1.0 / (side * side) as f32;
    for (at, into) in into.iter_mut().enumerate() {
        let around = &sums[MARGIN + at * LANES - RADIUS..][..LANES + 2 * RADIUS];
        let mut sum = Lanes::load(around, 0);
        for step in 1..side {
            sum += Lanes::load(around, step);
        }
        into[channel] = sum * share;
    }
}

/// Returns some lines in vectors.
#[inline(always)]
fn each_line<const N: usize>(numbers: &[f32], line: usize, which: impl Fn(usize) -> usize) -> [&[[f32; LANES]]; N] {
    let mut lines: [&[[f32; LANES]]; N] = [&[]; N];
    for (i, to) in lines.iter_mut().enumerate() {
        *to = numbers[which(i) * line..][..line].as_chunks().0;
    }
    lines
}
