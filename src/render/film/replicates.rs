//! A picture from replicates: parts of it with random numbers of their own, by which its error is known.
//!
//! Within a replicate the paths of a pixel cover it evenly, so that their spread does not tell the error of their mean.
//! Replicates are independent, and their means are draws of one distribution (randomized quasi-Monte Carlo; Owen 1997).

use super::aov::Aov;
use super::blocks::Blocks;
use super::pixel::Pixel;
use super::sum::Sum;
use super::{Film, Planes, Sampling, Shoot, View};
use crate::render::integrator::{Counts, Integrator};
use crate::render::tiles::{self, Watch};
use std::time::Instant;

/// Fewest replicates by which an error is stated.
pub const FEWEST: u32 = 8;

/// Sums over the replicates of a pixel, each weighted by its paths: red, green, blue and alpha.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PixelSums {
    /// Replicates.
    pub replicates: u32,
    /// Paths of all of them.
    pub paths: u64,
    /// Sum of the means of replicates times their paths.
    pub first: [Sum; 4],
    /// Sum of the squared means of replicates times their paths.
    pub second: [Sum; 4],
    /// Largest mean of a replicate.
    pub largest: [f32; 4],
}

impl PixelSums {
    /// Adds a replicate of this mean.
    pub(crate) fn add(&mut self, paths: u32, mean: [f32; 4]) {
        let n = f64::from(paths);
        let x = mean.map(f64::from);
        self.merge(&Self {
            replicates: 1,
            paths: paths.into(),
            first: x.map(|x| Sum::product(n, x)),
            second: x.map(|x| Sum::product(n, x * x)),
            largest: mean,
        });
    }

    /// Adds other replicates.
    pub fn merge(&mut self, other: &Self) {
        if other.replicates == 0 {
            return;
        }
        if self.replicates == 0 {
            *self = *other;
            return;
        }
        self.replicates += other.replicates;
        self.paths += other.paths;
        for c in 0..4 {
            self.first[c] = self.first[c].plus(other.first[c]);
            self.second[c] = self.second[c].plus(other.second[c]);
            self.largest[c] = self.largest[c].max(other.largest[c]);
        }
    }

    /// Returns the mean; 0 without a path.
    pub fn mean(&self) -> [f64; 4] {
        self.first.map(|sum| sum.value() / (self.paths.max(1) as f64))
    }

    /// Returns the unbiased variance of the mean, if that of a replicate falls with its paths; infinite with fewer than
    /// two replicates.
    pub fn variance(&self) -> [f64; 4] {
        if self.replicates < 2 {
            return [f64::INFINITY; 4];
        }
        let n = self.paths as f64;
        // n Σ nᵢ xᵢ² - (Σ nᵢ xᵢ)², whose digits cancel where the replicates are nearly equal.
        let spread = |c: usize| self.second[c].times(n).plus(self.first[c].squared().negated()).value();
        std::array::from_fn(|c| spread(c).max(0.0) / (n * n * f64::from(self.replicates - 1)))
    }

    /// Returns the part of [`PixelSums::variance`] that the largest replicate makes.
    pub fn by_largest(&self) -> [f64; 4] {
        let (mean, replicates) = (self.mean(), f64::from(self.replicates));
        let apart = |c: usize| f64::from(self.largest[c]) - mean[c];
        std::array::from_fn(|c| apart(c) * apart(c) / (replicates * (replicates - 1.0)))
    }
}

/// Pixel of one replicate.
#[derive(Debug, Clone, Copy, Default)]
struct Traced {
    mean: [f32; 4],
    paths: u32,
    seconds: f32,
}

/// Replicates of a picture, summed up.
#[derive(Debug, Clone)]
pub struct Replicates {
    size: [usize; 2],
    aovs: Vec<Aov>,
    sums: Vec<PixelSums>,
    /// What the requested planes need, row-major; empty without such planes.
    features: Vec<Pixel>,
    /// Thread seconds that the pixels of each block took.
    seconds: Vec<f64>,
    counts: Counts,
    /// Replicates that were added.
    added: u32,
}

impl Replicates {
    /// Begins a picture of this width and height with planes beside RGBA.
    pub fn new(size: [usize; 2], aovs: &[Aov]) -> Self {
        let pixels = size[0] * size[1];
        let planes = Planes::new(aovs, &Sampling::random(1, 0));
        Self {
            size,
            aovs: aovs.to_vec(),
            sums: vec![PixelSums::default(); pixels],
            features: vec![Pixel::default(); if planes.stride > 0 { pixels } else { 0 }],
            seconds: vec![0.0; Blocks::new(size).count()],
            counts: Counts::default(),
            added: 0,
        }
    }

    /// Renders a replicate and adds it. `sampling` are the rays of each block's pixels, random ones, or `None` for
    /// none. Returns false, and adds nothing, if the watch stopped it.
    pub fn add<'c, 'w, I: Integrator>(
        &mut self,
        integrator: &I,
        view: impl Into<View<'c>>,
        sampling: &[Option<Sampling>],
        watch: impl Into<Watch<'w>>,
    ) -> bool {
        let (view, watch) = (view.into(), watch.into());
        let blocks = Blocks::new(self.size);
        let planes = Planes::new(&self.aovs, &Sampling::random(1, 0));
        let features = planes.stride > 0;
        let pixel = |scratch: &mut I::Scratch, at, (band, index): (&mut (Vec<Pixel>, Counts), usize)| {
            let Some(sampling) = &sampling[blocks.of(at)] else { return Traced::default() };
            let begun = Instant::now();
            let shoot = Shoot { integrator, view: &view, sampling, planes: &planes, cancel: watch.cancel };
            let pixel = shoot.pixel(scratch, at, &mut band.1);
            let traced =
                Traced { mean: pixel.rgba(), paths: sampling.samples(), seconds: begun.elapsed().as_secs_f32() };
            if features {
                band.0[index] = pixel;
            }
            traced
        };
        let begin = |pixels| (vec![Pixel::default(); if features { pixels } else { 0 }], Counts::default());
        let Some((traced, bands)) = tiles::pixels(self.size, watch, I::Scratch::default, begin, pixel) else {
            return false;
        };
        for (i, Traced { mean, paths, seconds }) in traced.into_iter().enumerate() {
            if paths > 0 {
                self.sums[i].add(paths, mean);
                self.seconds[blocks.of([i % self.size[0], i / self.size[0]])] += f64::from(seconds);
            }
        }
        // Every other replicate of a pixel, which is not in all of them, belongs to one half.
        let rays = bands.iter().flat_map(|(pixels, _)| pixels);
        for ((sum, sums), pixel) in self.features.iter_mut().zip(&self.sums).zip(rays) {
            sum.merge(pixel, (sums.replicates % 2) as usize);
        }
        self.counts = bands.iter().fold(self.counts, |sum, (_, counts)| sum.plus(*counts));
        self.added += 1;
        true
    }

    /// Returns the number of replicates.
    pub fn count(&self) -> u32 {
        self.added
    }

    /// Returns width and height of the picture.
    pub fn size(&self) -> [usize; 2] {
        self.size
    }

    /// Returns the sums of each pixel, row-major.
    pub fn sums(&self) -> &[PixelSums] {
        &self.sums
    }

    /// Returns the thread seconds that the pixels of each block took.
    pub fn seconds(&self) -> &[f64] {
        &self.seconds
    }

    /// True if there is no noise: replicates of a pixel are all the same.
    pub fn are_alike(&self) -> bool {
        self.added >= FEWEST && self.sums.iter().all(|sums| sums.variance() == [0.0; 4])
    }

    /// Returns the number of events.
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// Returns the picture with the requested planes.
    pub fn film(&self) -> Film {
        let mut planes = Planes::new(&self.aovs, &Sampling::random(1, 0));
        planes.in_halves = true;
        let band = planes.filled(&self.features, &self.sums);
        let rgba = self.sums.iter().map(|sums| sums.mean().map(|v| v as f32)).collect();
        let first = self.sums.first().map_or(0, |sums| sums.paths);
        let same = self.sums.iter().all(|sums| sums.paths == first);
        let samples = if same { u32::try_from(first).unwrap_or(0) } else { 0 };
        Film { samples, planes: planes.collect(self.size[0], &[band]), ..Film::of(self.size[0], self.size[1], rgba) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Means of replicates of four and of two paths.
    const MEANS: [(u32, f32); 5] = [(4, 1.0), (4, 3.0), (2, 0.25), (4, 1.5), (2, 9.0)];

    fn sums(means: &[(u32, f32)]) -> PixelSums {
        let mut sums = PixelSums::default();
        means.iter().for_each(|(paths, mean)| sums.add(*paths, [*mean; 4]));
        sums
    }

    /// Σ nᵢ (xᵢ - x̄)² / (n (r - 1)), the unbiased variance of the weighted mean.
    #[test]
    fn the_variance_is_that_of_a_weighted_mean() {
        let all = sums(&MEANS);
        let n: f64 = MEANS.iter().map(|(n, _)| f64::from(*n)).sum();
        let mean = MEANS.iter().map(|(n, x)| f64::from(*n) * f64::from(*x)).sum::<f64>() / n;
        let spread: f64 = MEANS.iter().map(|(n, x)| f64::from(*n) * (f64::from(*x) - mean).powi(2)).sum();
        assert_eq!(all.mean(), [mean; 4]);
        assert!((all.variance()[0] / (spread / (n * 4.0)) - 1.0).abs() < 1e-14);
        assert!((all.by_largest()[0] - (9.0 - mean).powi(2) / 20.0).abs() < 1e-12);
        assert_eq!(sums(&MEANS[..1]).variance(), [f64::INFINITY; 4]);
        assert_eq!((sums(&[]).mean(), sums(&[(3, 0.1); 9]).variance()), ([0.0; 4], [0.0; 4]));
    }

    #[test]
    fn parts_are_merged_in_any_order() {
        let all = sums(&MEANS);
        for cut in 0..=MEANS.len() {
            let (left, right) = (sums(&MEANS[..cut]), sums(&MEANS[cut..]));
            for (mut first, second) in [(left, right), (right, left)] {
                first.merge(&second);
                assert_eq!((first.mean(), first.variance()), (all.mean(), all.variance()), "{cut}");
            }
        }
    }
}
