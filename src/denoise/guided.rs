//! Regression on a reprojected history, pooled over neighbourhoods: a guided filter in space and time.
//!
//! The feature of a pixel is the history of its colors over the frames before, and over those that follow where they
//! are known ([`Ahead`](super::Ahead)); the color of this frame is not part of it, so that the noise of both is
//! independent. A model of the color by the feature is learned by recursive least squares. Its sums are pooled over
//! blocks of pixels around ([`blocks`](super::blocks)), which takes the place of a blend of neighbouring models.

use super::blocks::{BLOCK, COEFFICIENTS, Grid, Interpolated, Planes, Pool, solve_row};
use super::carried::{self, carry, to_planes};
use super::detail;
use super::difference::Halved;
use super::frame::{Denoised, Frame};
use super::history::{Histories, Past};
use super::illumination::{Compared, Illumination};
use super::lanes::{LANES, Lanes};
use super::learning::{self, Lines, STATE, Sums};
use super::noise;
use super::outline::Outline;
use super::packed::{Coding, Packed};
use super::residual::Residuals;
use super::smoothing::{self, Rows, Smoothing};
use super::still;
use super::vectors::{Colors, Features, vectors};
use crate::arch::Arch;
use crate::error::Result;
use glam::Vec2;
use rayon::prelude::*;

/// Share of what was learned that is kept from frame to frame.
const FORGETTING: f32 = 0.88;

/// Share of what was learned that is kept where features begin or cease to rest on one side of time alone, as at both
/// ends of a sequence, or on alpha: such features lag or run ahead, or have other noise, and models of others do not
/// fit them.
const FORGETTING_AT_ENDS: f32 = 0.05;

/// Blocks to each side over which sums are pooled.
const POOL: usize = 1;

/// Planes of what predicts: the coefficients of the model, and the samples that it rests on.
const PREDICTING: usize = COEFFICIENTS + 1;

/// State of a sequence between frames.
#[derive(Debug, Clone, Default)]
struct State {
    size: [usize; 2],
    /// True where the features of the frame before rested on frames before, on frames that follow, and on alpha.
    bases: [bool; 3],
    past: Past,
    /// Coding of the histories that come.
    coding: Coding,
    blocks: Vec<Sums>,
    /// Sums of detail by block.
    details: Vec<detail::Sums>,
    /// Root mean square of the feature.
    level: f32,
}

/// Memory that frames reuse.
#[derive(Debug, Default)]
struct Scratch {
    /// Mean motions of the blocks.
    motions: Vec<Vec2>,
    /// The state that comes.
    pixels: Vec<Packed>,
    blocks: Vec<Sums>,
    features: Vec<Features>,
    /// Histories that the features were smoothed from.
    histories: Vec<detail::Histories>,
    colors: Vec<Colors>,
    /// Differences from the frame before.
    differences: Vec<Halved>,
    /// Sums of the blocks, plane after plane.
    sums: Planes,
    /// Totals of each row of blocks.
    rows: Vec<RowSums>,
    /// Models that predict the frame, and their degrees of freedom as shares of what they rest on.
    predicting: Planes,
    determined: Planes,
    /// Sums of detail that come, block by block and plane after plane, and the shares that follow from them.
    details: Vec<detail::Sums>,
    detail_sums: Planes,
    shares: Planes,
}

/// Denoiser with its scratch.
#[derive(Debug, Default)]
pub(crate) struct GuidedDenoiser {
    state: State,
    scratch: Scratch,
    illumination: Illumination,
    residuals: Residuals,
    /// True after it was rewound.
    rehearsed: bool,
    /// True if maps of noise and error are wanted.
    pub mapped: bool,
}

impl GuidedDenoiser {
    /// Forgets all, as at a cut, and frees the memory.
    pub(crate) fn reset(&mut self) {
        *self = Self { mapped: self.mapped, ..Self::default() };
    }

    /// Forgets all but what was learned of the noise.
    pub(crate) fn rewind(&mut self) {
        self.state = State::default();
        self.rehearsed = true;
    }

    /// Denoises the next frame into `to`, whose memory is used again. A frame of another size begins anew.
    ///
    /// # Errors
    /// If the frame does not have as many colors, motions or alphas as pixels.
    pub(crate) fn denoise(&mut self, frame: &Frame<'_>, to: &mut Denoised) -> Result<()> {
        frame.check()?;
        let grid = Grid::over(frame.size);
        if self.state.size != frame.size {
            self.rehearsed &= self.residuals.are_over(grid);
            let blocks = grid.rows * grid.columns;
            let past = Past::before_first(frame);
            let coding = past.coding;
            self.state = State { size: frame.size, past, coding, ..State::default() };
            self.scratch = Scratch {
                motions: Vec::new(),
                pixels: vec![Packed::default(); frame.color.len()],
                blocks: vec![[0.0; STATE]; blocks],
                features: vec![Features::default(); frame.size[1] * vectors(frame.size[0])],
                histories: vec![Default::default(); frame.size[1] * vectors(frame.size[0])],
                colors: vec![Colors::default(); frame.size[1] * vectors(frame.size[0])],
                differences: vec![Halved::default(); frame.size[1] * vectors(frame.size[0])],
                sums: Planes::new(grid, STATE),
                rows: vec![RowSums::default(); grid.rows],
                predicting: Planes::new(grid, PREDICTING),
                determined: Planes::new(grid, 1),
                details: vec![[0.0; LANES]; blocks],
                detail_sums: Planes::new(grid, LANES),
                shares: Planes::new(grid, detail::SHARES),
            };
        }
        let outline = Outline::of(frame);
        carried::mean_motions(frame, grid, &mut self.scratch.motions);
        let (is_first, is_two_sided) = (self.state.past.is_fresh, self.state.bases[..2] == [true; 2]);
        let kept = self.learn(frame, grid, outline);
        let told = self.rehearsed && is_first;
        self.solve(grid);
        self.learn_detail(frame.size[0], grid, kept);
        self.predict(frame.size, grid, to);
        let floor = learning::error_floor(self.state.level);
        let alone = self.state.bases[..2] == [false; 2];
        let compared = Compared { frame, grid, before: &self.scratch.differences, floor, alone };
        self.illumination.follow(compared, &mut self.scratch.features);
        let colors = &self.scratch.features[..];
        let (before, motions) = (&self.scratch.differences[..], &self.scratch.motions[..]);
        // What one side of time told of the noise hardly counts once both are known.
        let kept_noise = if self.rehearsed || is_two_sided { FORGETTING } else { kept };
        let (guided, alpha, mapped) = (outline.alpha.is_some(), outline.exact, self.mapped);
        let own = &self.scratch.determined;
        let filtered = noise::Filtered {
            frame,
            grid,
            motions,
            own,
            colors,
            before,
            illumination: &self.illumination.changes,
            guided,
            alpha,
            floor,
            kept: kept_noise,
            alone,
            told,
            mapped,
        };
        self.residuals.give_back(&filtered, to);
        if alone {
            still::keep_detail(frame, floor.sqrt(), to);
        }
        Ok(())
    }

    /// Follows the histories, takes the features from them, moves the sums along, and adds what is learned of the
    /// frame. Returns the share of what was learned before that is kept.
    fn learn(&mut self, frame: &Frame<'_>, grid: Grid, outline: Outline<'_>) -> f32 {
        let [width, height] = frame.size;
        let groups = vectors(width);
        let Scratch { motions, pixels, blocks, features, histories: own, colors, differences, sums, rows, .. } =
            &mut self.scratch;
        let arch = Arch::default();
        let State { past, coding, .. } = &self.state;
        let histories = Histories { past, coding: *coding, frame, arch };
        let illumination = &self.illumination;
        let smoothing = Smoothing { histories, ahead: frame.ahead, outline, illumination };
        let is_ahead = frame.ahead.is_some_and(|ahead| ahead.frames() > 0);
        let bases = [!past.is_fresh, is_ahead, outline.alpha.is_some()];
        let kept = if bases == self.state.bases { FORGETTING } else { FORGETTING_AT_ENDS };
        let known = LearningInputs { smoothing, motions, blocks: &self.state.blocks, kept, grid };
        let band = super::band_rows(height);
        let taken = features.par_chunks_mut(band * groups).zip(own.par_chunks_mut(band * groups));
        let learned = colors.par_chunks_mut(band * groups).zip(differences.par_chunks_mut(band * groups));
        let of_pixels = pixels.par_chunks_mut(band * width).zip(taken.zip(learned));
        let band_blocks = band / BLOCK;
        let of_blocks = blocks
            .par_chunks_mut(band_blocks * grid.columns)
            .zip(sums.data.par_chunks_mut(band_blocks * STATE * grid.stride()))
            .zip(rows.par_chunks_mut(band_blocks));
        of_pixels.zip(of_blocks).enumerate().for_each_init(
            smoothing::Scratch::default,
            |scratch, (at, ((pixels, ((features, histories), (colors, differences))), ((blocks, planes), of_rows)))| {
                let rows = Rows { pixels, features, histories, colors, differences };
                arch.dispatch(Learn { known: &known, top: at * band, rows, blocks, planes, of_rows, scratch });
            },
        );
        // In order, so that the sum is the same for any number of threads.
        let all = rows.iter().fold(RowSums::default(), |all, row| all.plus(row));
        if all.count > 0.0 {
            self.state.level = (all.power / all.count).sqrt() as f32;
        }
        self.state.bases = bases;
        std::mem::swap(&mut self.state.past.pixels, &mut self.scratch.pixels);
        self.state.past.is_fresh = false;
        (self.state.past.coding, self.state.coding) = (self.state.coding, Coding::of(all.extremes));
        std::mem::swap(&mut self.state.blocks, &mut self.scratch.blocks);
        // The next frame of a fresh state has swapped in empty ones.
        self.scratch.blocks.resize(self.state.blocks.len(), [0.0; STATE]);
        kept
    }

    /// Puts what the models predict in the place of the features, learns which detail of the histories is signal, and
    /// solves for its shares.
    fn learn_detail(&mut self, width: usize, grid: Grid, kept: f32) {
        let groups = vectors(width);
        let State { level, details: before, .. } = &self.state;
        let Scratch {
            motions, features, histories, colors, predicting, determined, details, detail_sums, shares, ..
        } = &mut self.scratch;
        let floor = learning::error_floor(*level);
        let known = Predicting { width, grid, motions, predicting, details: before, floor, kept };
        let of_pixels = features
            .par_chunks_mut(BLOCK * groups)
            .zip(histories.par_chunks(BLOCK * groups))
            .zip(colors.par_chunks(BLOCK * groups));
        let of_blocks =
            details.par_chunks_mut(grid.columns).zip(detail_sums.data.par_chunks_mut(LANES * grid.stride()));
        let rows = of_pixels.zip(of_blocks).enumerate().with_min_len(2);
        rows.for_each_init(
            Interpolated::default,
            |models, (row, (((features, histories), colors), (blocks, planes)))| {
                let lines = DetailLines { features, histories, colors };
                Arch::default().dispatch(LearnDetail { known: &known, row, lines, models, blocks, planes });
            },
        );
        let sums = &*detail_sums;
        let rows = shares.data.par_chunks_mut(detail::SHARES * grid.stride());
        let rows = rows.zip(determined.data.par_chunks_mut(grid.stride())).enumerate();
        rows.with_min_len(8).for_each_init(Pool::default, |pool, (row, (shares, determined))| {
            Arch::default().dispatch(SolveDetail { sums, row, pool, shares, determined });
        });
        std::mem::swap(&mut self.state.details, &mut self.scratch.details);
        self.scratch.details.resize(self.state.details.len(), [0.0; LANES]);
    }

    /// Solves for the models.
    fn solve(&mut self, grid: Grid) {
        let Scratch { sums, predicting, determined, .. } = &mut self.scratch;
        let (sums, stride) = (&*sums, grid.stride());
        let planes = predicting.data.par_chunks_mut(PREDICTING * stride).zip(determined.data.par_chunks_mut(stride));
        planes.enumerate().with_min_len(8).for_each_init(Pool::default, |pool, (row, (predicting, determined))| {
            Arch::default().dispatch(Solve { sums, row, pool, predicting, determined });
        });
    }

    /// Puts the colors that models and detail predict in the place of the features.
    fn predict(&mut self, [width, height]: [usize; 2], grid: Grid, to: &mut Denoised) {
        to.confidence.resize(width * height, 0.0);
        let groups = vectors(width);
        let Scratch { features, histories, predicting, shares, .. } = &mut self.scratch;
        let predicted = Predicted { grid, predicting, shares, least: self.state.coding.least() };
        let rows = features.par_chunks_mut(groups).zip(histories.par_chunks(groups));
        let rows = rows.zip(to.confidence.par_chunks_mut(width)).enumerate();
        rows.with_min_len(8).for_each_init(Default::default, |models, (row, ((features, histories), confidence))| {
            Arch::default().dispatch(Predict { predicted, row, models, features, histories, confidence });
        });
    }
}

/// Totals of a row of blocks.
#[derive(Debug, Clone, Copy, Default)]
struct RowSums {
    /// Sum of the features' squares, and their count.
    power: f64,
    count: f64,
    /// Least and largest color of the histories of its band.
    extremes: [f32; 2],
}

impl RowSums {
    fn plus(self, other: &Self) -> Self {
        let (power, count) = (self.power + other.power, self.count + other.count);
        let [a, b] = [self.extremes, other.extremes];
        Self { power, count, extremes: [a[0].min(b[0]), a[1].max(b[1])] }
    }
}

/// State and inputs when a frame is learned.
struct LearningInputs<'k> {
    smoothing: Smoothing<'k>,
    /// Mean motions of the blocks.
    motions: &'k [Vec2],
    /// Sums after the frame before; empty at the first frame.
    blocks: &'k [Sums],
    /// Share of the sums that is kept.
    kept: f32,
    grid: Grid,
}

/// Learns a band of rows.
struct Learn<'a> {
    known: &'a LearningInputs<'a>,
    top: usize,
    rows: Rows<'a>,
    /// Sums after this frame, block by block and plane after plane.
    blocks: &'a mut [Sums],
    planes: &'a mut [f32],
    of_rows: &'a mut [RowSums],
    scratch: &'a mut smoothing::Scratch,
}

impl pulp::NullaryFnOnce for Learn<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { known, top, rows, blocks, planes, of_rows, scratch } = self;
        let Rows { pixels, features, histories, colors, differences } = rows;
        let LearningInputs { smoothing, motions, grid, kept, .. } = *known;
        let Histories { frame, arch, .. } = smoothing.histories;
        let groups = vectors(frame.size[0]);
        for (row, blocks) in blocks.chunks_mut(grid.columns).enumerate() {
            carry(motions, grid, known.blocks, top / BLOCK + row, blocks);
        }
        let extremes = smoothing.band(top, Rows { pixels, features, histories, colors, differences }, scratch);
        let lines = features.chunks(BLOCK * groups).zip(colors.chunks(BLOCK * groups));
        let of_blocks = blocks.chunks_mut(grid.columns).zip(planes.chunks_mut(STATE * grid.stride())).zip(of_rows);
        for ((features, colors), ((blocks, planes), of_row)) in lines.zip(of_blocks) {
            learning::add(Lines { features, colors, groups }, kept, arch, blocks);
            to_planes(arch, blocks, planes, grid.stride());
            let row = RowSums { extremes, ..RowSums::default() };
            *of_row = blocks.iter().fold(row, |row, sums| RowSums {
                power: row.power + f64::from(sums[4] + sums[7] + sums[9]),
                count: row.count + f64::from(sums[0]),
                ..row
            });
        }
    }
}

/// Solves for the models of a row of blocks.
struct Solve<'a> {
    sums: &'a Planes,
    row: usize,
    pool: &'a mut Pool,
    predicting: &'a mut [f32],
    determined: &'a mut [f32],
}

impl pulp::NullaryFnOnce for Solve<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { sums, row, pool, predicting, determined } = self;
        let (coefficients, counts) = predicting.split_at_mut(predicting.len() / PREDICTING * COEFFICIENTS);
        solve_row(sums, row, POOL, pool, coefficients, counts, determined);
    }
}

/// Models, and sums of detail before, when the detail of a frame is learned.
struct Predicting<'k> {
    /// Columns of pixels.
    width: usize,
    grid: Grid,
    /// Mean motions of the blocks.
    motions: &'k [Vec2],
    /// Models that predict the frame.
    predicting: &'k Planes,
    /// Sums of detail after the frame before; empty at the first frame.
    details: &'k [detail::Sums],
    floor: f32,
    /// Share of the sums that is kept.
    kept: f32,
}

/// Rows of pixels of a row of blocks.
struct DetailLines<'l> {
    /// Features, which become what their models predict.
    features: &'l mut [Features],
    histories: &'l [detail::Histories],
    colors: &'l [Colors],
}

/// Learns the detail of a row of blocks.
struct LearnDetail<'a> {
    known: &'a Predicting<'a>,
    row: usize,
    lines: DetailLines<'a>,
    models: &'a mut Interpolated,
    blocks: &'a mut [detail::Sums],
    planes: &'a mut [f32],
}

impl pulp::NullaryFnOnce for LearnDetail<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { known, row, lines: DetailLines { features, histories, colors }, models, blocks, planes } = self;
        let Predicting { width, grid, motions, predicting, details, floor, kept } = *known;
        let (groups, arch) = (vectors(width), Arch::default());
        for (at, features) in features.chunks_mut(groups).enumerate() {
            models.take(grid, row * BLOCK + at, predicting);
            for (at, z) in features.iter_mut().enumerate() {
                *z = predicted(models, at, *z);
            }
        }
        carry(motions, grid, details, row, blocks);
        detail::add(&detail::Lines { predicted: features, histories, colors, groups }, floor, kept, arch, blocks);
        to_planes(arch, blocks, planes, grid.stride());
    }
}

/// Returns what the models of eight pixels predict from their features.
#[inline(always)]
fn predicted(models: &Interpolated, at: usize, z: Features) -> Features {
    let mut predicted = Features::default();
    for (c, predicted) in predicted.iter_mut().enumerate() {
        let (a, b) = (models.at(c, at), models.at(3 + c, at) * z[0]);
        let (d, e) = (models.at(6 + c, at) * z[1], models.at(9 + c, at) * z[2]);
        *predicted = (a + b) + (d + e);
    }
    predicted
}

/// Solves for the shares of detail of a row of blocks.
struct SolveDetail<'a> {
    sums: &'a Planes,
    row: usize,
    pool: &'a mut Pool,
    shares: &'a mut [f32],
    /// Degrees of freedom of the models, which become those of what is predicted with the detail.
    determined: &'a mut [f32],
}

impl pulp::NullaryFnOnce for SolveDetail<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { sums, row, pool, shares, determined } = self;
        detail::solve_row(sums, row, POOL, pool, shares);
        // Where the histories take its place, a model leaves none of the colors' own noise.
        for (determined, share) in determined.iter_mut().zip(&*shares) {
            *determined *= 1.0 - share;
        }
    }
}

/// Models and shares of detail.
#[derive(Debug, Clone, Copy)]
struct Predicted<'p> {
    grid: Grid,
    predicting: &'p Planes,
    shares: &'p Planes,
    /// Colors below are none.
    least: f32,
}

/// Predicts a row of pixels.
struct Predict<'a> {
    predicted: Predicted<'a>,
    row: usize,
    /// Models interpolated to the row, and shares of detail interpolated to it.
    models: &'a mut [Interpolated; 2],
    features: &'a mut [Features],
    histories: &'a [detail::Histories],
    confidence: &'a mut [f32],
}

impl pulp::NullaryFnOnce for Predict<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { predicted, row, models: [models, shares], features, histories, confidence } = self;
        models.take(predicted.grid, row, predicted.predicting);
        shares.take(predicted.grid, row, predicted.shares);
        let least = Lanes([predicted.least; LANES]);
        let groups = features.iter_mut().zip(histories).zip(confidence.chunks_mut(LANES)).enumerate();
        for (at, ((color, histories), confidence)) in groups {
            let by_band: [Lanes; detail::SHARES] = [shares.at(0, at), shares.at(1, at)];
            for (c, color) in color.iter_mut().enumerate() {
                let [coarse, fine] = detail::bands(*color, histories, c);
                *color = (*color + (coarse * by_band[0] + fine * by_band[1])).max(least);
            }
            let counts = models.at(COEFFICIENTS, at);
            for (confidence, count) in confidence.iter_mut().zip(counts.0) {
                *confidence = count;
            }
        }
    }
}
