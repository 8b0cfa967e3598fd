//! Regression on a reprojected history, pooled over neighbourhoods: a guided filter in space and time.
//!
//! The feature of a pixel is the history of its colors ([`history`](super::history)); the color of this frame is not part of
//! it, so that the noise of both is independent. Two models of the color by the feature are learned by recursive least
//! squares: a steady one that forgets slowly, and a quick one that forgets soon, over larger neighbourhoods. Their sums are
//! pooled over blocks of pixels around ([`blocks`](super::blocks)), which takes the place of a blend of neighbouring models.
//!
//! How far a pixel trusts the quick model follows from the innovations: with the predictions a and b of both *before* the
//! color I of this frame is learned, the error of `b + w (a - b)` is least for `w = Σ (I - b)(a - b) / Σ (a - b)²`, in which
//! the noise of I cancels on average. The weight shrinks towards 0 by what chance alone would give (James & Stein 1961).

use super::blocks::{BLOCK, COEFFICIENTS, Grid, Interpolated, Planes, Pool, TERMS, solve_row};
use super::detail::Noise;
use super::frame::{Denoised, Frame, around};
use super::history::{BandScratch, Histories, Pixel, Rows};
use super::lanes::{LANES, Lanes, each};
use super::learning::{self, Before, Fresh, INNOVATIONS, Lines};
use super::vectors::{Colors, Features, vectors};
use crate::arch::Arch;
use crate::error::Result;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Constants of a model.
struct Model {
    /// Share of what was learned that is kept from frame to frame.
    forgetting: f32,
    /// Blocks to each side over which sums are pooled.
    pool: usize,
}

/// The quick and the steady model.
const MODELS: [Model; 2] = [Model { forgetting: 0.6, pool: 2 }, Model { forgetting: 0.9, pool: 1 }];

/// Share of the innovations that is kept from frame to frame.
const REMEMBERED: f32 = 0.8;
/// Blocks to each side over which innovations are pooled.
const INNOVATIONS_POOL: usize = 1;
/// Number of standard errors, squared, that shrinks the weight of the quick model.
const CHANCE: f32 = 2.0;

/// Numbers kept of a block: the sums of both models, and the innovations.
const STATE: usize = 2 * TERMS + INNOVATIONS;

/// Sums of a block.
type Sums = [f32; STATE];

/// Vectors of sums.
const VECTORS: usize = STATE / LANES;

/// Rows of pixels that a task takes.
const BAND: usize = 10 * BLOCK;

/// Planes of what predicts: the coefficients of both models as one, and the samples that they rest on.
const PREDICTING: usize = COEFFICIENTS + 1;

/// State of a sequence between frames.
#[derive(Debug, Clone, Default)]
struct State {
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
    fresh: Vec<Fresh>,
    /// Coefficients of both models before the frame is learned.
    coefficients: Planes,
    /// Models that predict the frame.
    predicting: Planes,
}

/// Denoiser with its scratch.
#[derive(Debug, Default)]
pub struct GuidedDenoiser {
    state: State,
    scratch: Scratch,
}

impl GuidedDenoiser {
    /// Forgets all, as at a cut, and frees the memory.
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    /// Denoises the next frame. A frame of another size begins anew.
    ///
    /// # Errors
    /// If the frame does not have as many colors, motions or alphas as pixels.
    pub fn denoise(&mut self, frame: &Frame<'_>) -> Result<Denoised> {
        frame.check()?;
        let grid = Grid::over(frame.size);
        if self.state.size != frame.size {
            let blocks = grid.rows * grid.columns;
            self.state = State { size: frame.size, ..State::default() };
            self.scratch = Scratch {
                pixels: vec![Pixel::default(); frame.color.len()],
                features: vec![Features::default(); frame.size[1] * vectors(frame.size[0])],
                sums: Planes::new(grid, STATE),
                blocks: vec![[0.0; STATE]; blocks],
                fresh: vec![Fresh::default(); blocks],
                coefficients: Planes::new(grid, 2 * COEFFICIENTS),
                predicting: Planes::new(grid, PREDICTING),
            };
        }
        self.carry(frame, grid);
        self.solve(grid);
        self.learn(frame, grid);
        self.update(grid);
        self.resolve(grid);
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

    /// Solves for the coefficients of both models before the frame is learned. Before the first frame there are none.
    fn solve(&mut self, grid: Grid) {
        if self.state.blocks.is_empty() {
            return;
        }
        let Scratch { sums, coefficients, .. } = &mut self.scratch;
        let (sums, stride) = (&*sums, grid.stride());
        let rows = coefficients.data.par_chunks_mut(2 * COEFFICIENTS * stride).enumerate();
        rows.for_each_init(
            || (Pool::default(), [vec![0.0; stride], vec![0.0; stride]]),
            |(pool, counts), (row, coefficients)| {
                Arch::default().dispatch(Solve { sums, row, pool, counts, coefficients });
            },
        );
    }

    /// Follows the histories, takes the features from them, and sums what is to be learned of the frame.
    fn learn(&mut self, frame: &Frame<'_>, grid: Grid) {
        let [width, _] = frame.size;
        let groups = vectors(width);
        let Scratch { pixels, features, fresh, coefficients, sums, .. } = &mut self.scratch;
        let arch = Arch::default();
        let noise = Noise { sums, plane: 2 * TERMS + 2, level: self.state.level };
        let noise = Some(noise).filter(|_| !self.state.blocks.is_empty());
        let known = Known {
            histories: Histories::new(&self.state.pixels, frame, noise, arch),
            before: Before {
                coefficients: Some(&*coefficients).filter(|_| !self.state.blocks.is_empty()),
                level: self.state.level,
            },
            columns: grid.columns,
        };
        let rows = pixels.par_chunks_mut(BAND * width).zip(features.par_chunks_mut(BAND * groups));
        let rows = rows.zip(fresh.par_chunks_mut(BAND / BLOCK * grid.columns)).enumerate();
        rows.for_each_init(
            || (BandScratch::default(), vec![Colors::default(); BAND * groups]),
            |(scratch, colors), (band, ((pixels, features), fresh))| {
                let rows = Rows { pixels, features, colors };
                arch.dispatch(Learn { known: &known, top: band * BAND, rows, fresh, scratch });
            },
        );
        std::mem::swap(&mut self.state.pixels, &mut self.scratch.pixels);
        // The next frame of a fresh state has swapped in an empty one.
        self.scratch.pixels.resize(self.state.pixels.len(), Pixel::default());
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
            power += f64::from(sums[4] + sums[7] + sums[9]);
            count += f64::from(sums[0]);
        }
        if count > 0.0 {
            self.state.level = (power / count).sqrt() as f32;
        }
        std::mem::swap(&mut self.state.blocks, blocks);
        blocks.resize(grid.rows * grid.columns, [0.0; STATE]);
    }

    /// Solves for both models after the frame was learned, and mixes them.
    fn resolve(&mut self, grid: Grid) {
        let Scratch { sums, predicting, .. } = &mut self.scratch;
        let (sums, stride) = (&*sums, grid.stride());
        let rows = predicting.data.par_chunks_mut(PREDICTING * stride).enumerate();
        rows.for_each_init(
            || (Pool::default(), [vec![0.0; stride], vec![0.0; stride]], vec![0.0; 2 * COEFFICIENTS * stride]),
            |(pool, counts, coefficients), (row, predicting)| {
                let arch = Arch::default();
                arch.dispatch(Solve { sums, row, pool, counts, coefficients });
                arch.dispatch(Mix { sums, row, pool, counts, coefficients, predicting });
            },
        );
    }

    /// Returns the colors that the models predict.
    fn predict(&self, [width, height]: [usize; 2], grid: Grid) -> Denoised {
        let scratch = &self.scratch;
        let mut color = vec![Vec3::ZERO; width * height];
        let mut confidence = vec![0.0; width * height];
        let rows = color.par_chunks_mut(width).zip(confidence.par_chunks_mut(width)).enumerate();
        rows.with_min_len(8).for_each_init(Interpolated::default, |models, (row, (color, confidence))| {
            Arch::default().dispatch(Predict { scratch, grid, row, models, color, confidence });
        });
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

/// Solves for both models of a row of blocks.
struct Solve<'a> {
    sums: &'a Planes,
    row: usize,
    pool: &'a mut Pool,
    counts: &'a mut [Vec<f32>; 2],
    coefficients: &'a mut [f32],
}

impl pulp::NullaryFnOnce for Solve<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { sums, row, pool, counts, coefficients } = self;
        let (first, second) = coefficients.split_at_mut(coefficients.len() / 2);
        for (i, (coefficients, counts)) in [first, second].into_iter().zip(counts).enumerate() {
            solve_row(sums, row, i * TERMS, MODELS[i].pool, pool, coefficients, counts);
        }
    }
}

/// Mixes the models of a row of blocks.
struct Mix<'a> {
    sums: &'a Planes,
    row: usize,
    pool: &'a mut Pool,
    counts: &'a [Vec<f32>; 2],
    coefficients: &'a [f32],
    predicting: &'a mut [f32],
}

impl pulp::NullaryFnOnce for Mix<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { sums, row, pool, counts: [quick, steady], coefficients, predicting } = self;
        let stride = quick.len();
        let (vectors, pooled) = pool.sums(sums, row, (2 * TERMS..STATE).map(|plane| (plane, INNOVATIONS_POOL)));
        for vector in 0..vectors {
            let at = vector * LANES;
            let weight = weight(each(|i| pooled[i * vectors + vector]));
            let mut mix =
                |a: Lanes, b: Lanes, plane: usize| (b + (a - b) * weight).store(predicting, plane * stride + at);
            for plane in 0..COEFFICIENTS {
                let [a, b] = [plane, COEFFICIENTS + plane].map(|plane| Lanes::load(coefficients, plane * stride + at));
                mix(a, b, plane);
            }
            mix(Lanes::load(quick, at), Lanes::load(steady, at), COEFFICIENTS);
        }
    }
}

/// Returns the weight of the quick model that follows from the innovations.
#[inline(always)]
fn weight([apart, along, error, count]: [Lanes; INNOVATIONS]) -> Lanes {
    let (one, tiny) = (Lanes([1.0; LANES]), 1e-30);
    let best = along / (apart + tiny);
    let chance = (apart * error) * CHANCE / (count * along * along + tiny);
    let shrunk = best * (one - chance).max(Lanes::ZERO);
    shrunk.max(Lanes::ZERO).min(one)
}

/// State and inputs when a frame is learned.
struct Known<'k> {
    histories: Histories<'k>,
    before: Before<'k>,
    /// Blocks in a row.
    columns: usize,
}

/// Learns a band of rows.
struct Learn<'a> {
    known: &'a Known<'a>,
    top: usize,
    rows: Rows<'a>,
    fresh: &'a mut [Fresh],
    scratch: &'a mut BandScratch,
}

impl pulp::NullaryFnOnce for Learn<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { known, top, rows: Rows { pixels, features, colors }, fresh, scratch } = self;
        let Known { histories, before, columns } = *known;
        let groups = vectors(histories.frame.size[0]);
        histories.band(top, Rows { pixels, features, colors }, scratch);
        let blocks = features.chunks(BLOCK * groups).zip(colors.chunks(BLOCK * groups));
        for (row, ((features, colors), fresh)) in blocks.zip(fresh.chunks_mut(columns)).enumerate() {
            let row = top / BLOCK + row;
            learning::sum(row, Lines { features, colors, groups }, before, histories.arch, fresh);
        }
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
    fresh: &'a [Fresh],
    blocks: &'a mut [Sums],
    arch: Arch,
}

impl pulp::NullaryFnOnce for Update<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        for (block, fresh) in self.blocks.iter_mut().zip(self.fresh) {
            // Both models learn the same.
            for at in 0..TERMS {
                block[at] = KEPT[at] * block[at] + fresh[at];
            }
            for at in TERMS..STATE {
                block[at] = KEPT[at] * block[at] + fresh[at - TERMS];
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
    color: &'a mut [Vec3],
    confidence: &'a mut [f32],
}

impl pulp::NullaryFnOnce for Predict<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { scratch, grid, row, models, color, confidence } = self;
        let Scratch { features, predicting, .. } = scratch;
        models.take(grid, row, predicting);
        let features = &features[row * vectors(color.len())..][..vectors(color.len())];
        let groups = color.chunks_mut(LANES).zip(confidence.chunks_mut(LANES)).zip(features).enumerate();
        for (at, ((color, confidence), z)) in groups {
            let mut predicted = [Lanes::ZERO; 3];
            for c in 0..3 {
                let (a, b) = (models.at(c, at), models.at(3 + c, at) * z[0]);
                let (d, e) = (models.at(6 + c, at) * z[1], models.at(9 + c, at) * z[2]);
                predicted[c] = ((a + b) + (d + e)).max(Lanes::ZERO);
            }
            let counts = models.at(COEFFICIENTS, at);
            for (lane, (color, confidence)) in color.iter_mut().zip(confidence).enumerate() {
                *color = Vec3::new(predicted[0].0[lane], predicted[1].0[lane], predicted[2].0[lane]);
                *confidence = counts.0[lane];
            }
        }
    }
}
