//! Scratch memory of rays.

use super::Dvr;
use super::blend::Entry;
use super::preintegrated::Scratch;
use super::sampled::SampleBatch;
use crate::real::Real;
use crate::render::cell::Quartet;
use crate::render::march::Span;
use crate::render::segment::{Chord, Sample};
use crate::scene::table::TableGradient;

/// Scratch memory of one thread, reused from ray to ray.
#[derive(Debug, Clone, Default)]
pub struct Tape<R: Real> {
    /// Cells of rays of which only the depth matters.
    pub(super) cells: Vec<Quartet<R>>,
    /// Spans of a ray whose way is kept, how many quartets of `cells` there are up to the end of each, and the
    /// integrals of the density up to the end of each quartet.
    pub(super) spans: Vec<Span<R>>,
    pub(super) span_ends: Vec<usize>,
    pub(super) integrals: Vec<f64>,
    /// Segments of one batch: `samples` of quadratures with a step, `chords` of exact quadrature.
    pub(super) samples: Vec<Sample<R>>,
    pub(super) chords: Vec<Chord<R>>,
    /// Segments of a ray with their optics, of quadratures with a step and of exact quadrature.
    pub(super) sample_entries: Vec<Entry<R, Sample<R>>>,
    pub(super) chord_entries: Vec<Entry<R, Chord<R>>>,
    pub(super) preintegrated: Scratch<R>,
    pub(super) batch: Box<SampleBatch<R>>,
    /// Derivatives of one channel with respect to a transfer function.
    pub(super) by_table: TableGradient,
}

impl<R: Real> Tape<R> {
    /// Adds `by_depth · extinction` times the interpolation weights of all traced rays to `gradient`, by stored value,
    /// and forgets the rays.
    #[inline(always)]
    pub fn accumulate(&mut self, by_depth: f64, dvr: &Dvr<'_, R>, gradient: &mut [R]) {
        let g = R::of(dvr.medium.extinction * by_depth);
        if g != R::ZERO {
            for cells in &self.cells {
                cells.scatter(gradient, g);
            }
        }
        self.forget();
    }

    /// Forgets the rays.
    pub(crate) fn forget(&mut self) {
        self.cells.clear();
    }
}
