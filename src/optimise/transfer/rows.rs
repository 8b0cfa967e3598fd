//! What pixels derive from texels, and the sums over all of them.

use super::normal::{Normal, Row, bounded};
use super::rays::Rays;
use crate::render::dvr::{Adjoint, Dvr, ParameterGradient, Sinks, Tape};
use crate::scene::table::TableGradient;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// Parts that sums are split into, whatever the number of threads.
pub(super) const LANES: usize = 16;

/// Scratch memory of one lane.
pub(super) struct Scratch {
    tape: Tape<f32>,
    table: TableGradient,
    shared: ParameterGradient,
}

impl Scratch {
    pub fn new(texels: usize) -> Self {
        let table = TableGradient { pieces: vec![[[0.0; 4]; 2]; texels + 1] };
        Self { tape: Tape::default(), table, shared: ParameterGradient::default() }
    }

    /// Forgets all derivatives.
    fn forget(&mut self) {
        self.table.pieces.fill([[0.0; 4]; 2]);
    }

    /// Adds the derivatives of a loss on one pixel, whose own are `loss`; returns the pixel.
    pub fn walk(&mut self, dvr: &Dvr<'_, f32>, rays: &Rays, pixel: usize, loss: [f32; 4]) -> [f64; 4] {
        let share = 1.0 / rays.per_pixel as f32;
        let mut seen = [0.0; 4];
        for ray in rays.of(pixel) {
            let sinks = Sinks { voxels: None, table: Some(&mut self.table), ray: None, shared: &mut self.shared };
            let slope = loss.map(|g| g * share);
            let found = dvr.gradient(ray, &mut |_| slope, Adjoint::Tape, sinks, &mut self.tape).rgba();
            for c in 0..4 {
                seen[c] += f64::from(share * found[c]);
            }
        }
        seen
    }

    /// A pixel.
    pub fn see(&mut self, dvr: &Dvr<'_, f32>, rays: &Rays, pixel: usize) -> [f64; 4] {
        see(dvr, rays, pixel, &mut self.tape)
    }

    /// The derivative with respect to a texel's channel.
    pub fn by(&self, texel: usize, channel: usize) -> f64 {
        self.table.pieces[texel][1][channel] + self.table.pieces[texel + 1][0][channel]
    }
}

/// A line of a sparse matrix: texel and value.
pub(super) type Lengths = Vec<(u32, f32)>;

/// Length of each pixel's rays in each texel (times the factor of the extinctions): derivatives of alpha where
/// nothing absorbs.
pub(super) fn lengths(clear: &Dvr<'_, f32>, rays: &Rays, texels: usize) -> Vec<Lengths> {
    let mut all = vec![Lengths::new(); rays.len()];
    let part = all.len().div_ceil(LANES).max(1);
    all.par_chunks_mut(part).enumerate().for_each(|(lane, lines)| {
        let mut scratch = Scratch::new(texels);
        for (i, line) in lines.iter_mut().enumerate() {
            scratch.forget();
            scratch.walk(clear, rays, lane * part + i, [0.0, 0.0, 0.0, 1.0]);
            let entry = |j: usize| (j as u32, scratch.by(j, 3) as f32);
            *line = (0..texels).map(entry).filter(|(_, v)| *v != 0.0).collect();
        }
    });
    all
}

/// Extinctions whose `1 - e^{-H s}` are the alphas: at most twelve steps of Gauss and Newton with a smoothness prior of
/// `smooth` times the mean of the diagonal.
pub(super) fn extinctions(lengths: &[Lengths], rays: &Rays, texels: usize, smooth: f64) -> Vec<f64> {
    let longest = lengths.iter().map(|l| l.iter().map(|e| f64::from(e.1)).sum::<f64>()).fold(0.0_f64, f64::max);
    // A start at which no ray is opaque.
    let mut s = DVector::from_element(texels, if longest > 0.0 { 0.5 / longest } else { 0.0 });
    for _ in 0..12 {
        let part = lengths.len().div_ceil(LANES).max(1);
        let sums: Vec<(Vec<f64>, DVector<f64>)> = lengths
            .par_chunks(part)
            .enumerate()
            .map(|(lane, lines)| {
                // Row by row, on and above the diagonal.
                let (mut matrix, mut slope) = (vec![0.0; texels * texels], DVector::zeros(texels));
                for (i, line) in lines.iter().enumerate() {
                    let depth: f64 = line.iter().map(|(j, v)| f64::from(*v) * s[*j as usize]).sum();
                    let open = (-depth).exp();
                    let residual = open - (1.0 - f64::from(rays.wanted[lane * part + i][3]));
                    for (first, (j, v)) in line.iter().enumerate() {
                        let by = open * f64::from(*v);
                        slope[*j as usize] -= by * residual;
                        let row = &mut matrix[*j as usize * texels..][..texels];
                        let factor = by * open;
                        for (k, w) in &line[first..] {
                            row[*k as usize] += factor * f64::from(*w);
                        }
                    }
                }
                (matrix, slope)
            })
            .collect();
        let mut slope: DVector<f64> = sums.iter().map(|s| &s.1).sum();
        let sum = |i: usize, j: usize| sums.iter().map(|s| s.0[i.min(j) * texels + i.max(j)]).sum::<f64>();
        let mut matrix = DMatrix::from_fn(texels, texels, sum);
        let level = matrix.trace() / texels as f64;
        if level <= 0.0 {
            break;
        }
        let weight = smooth * level;
        for i in 0..texels - 1 {
            let pull = weight * (s[i + 1] - s[i]);
            slope[i] -= pull;
            slope[i + 1] += pull;
            matrix[(i, i)] += weight;
            matrix[(i + 1, i + 1)] += weight;
            matrix[(i, i + 1)] -= weight;
            matrix[(i + 1, i)] -= weight;
        }
        for i in 0..texels {
            matrix[(i, i)] *= 1.0 + 1e-3;
            matrix[(i, i)] += 1e-9 * level;
        }
        let Some(next) = bounded(&matrix, &slope, &s) else { break };
        let moved = (&next - &s).amax();
        s = next;
        if moved <= 1e-6 * s.amax() {
            break;
        }
    }
    s.iter().copied().collect()
}

/// Adds all pixels to the normal equations; derivatives by extinction are taken in units of `scale`.
pub(super) fn accumulate(dvr: &Dvr<'_, f32>, rays: &Rays, scale: f64, normal: &mut Normal) {
    let texels = normal.texels();
    let parts: Vec<Normal> = (0..LANES)
        .into_par_iter()
        .map(|lane| {
            let (mut scratch, mut row, mut own) = (Scratch::new(texels), Row::default(), Normal::zeros(texels));
            for pixel in (lane..rays.len()).step_by(LANES) {
                derive(dvr, rays, pixel, scale, &mut scratch, &mut row);
                own.add(&row);
            }
            own
        })
        .collect();
    parts.iter().for_each(|part| normal.merge(part));
}

/// The derivatives of one pixel: of each channel in turn.
fn derive(dvr: &Dvr<'_, f32>, rays: &Rays, pixel: usize, scale: f64, scratch: &mut Scratch, row: &mut Row) {
    let texels = scratch.table.pieces.len() - 1;
    for channel in 0..4 {
        let mut loss = [0.0; 4];
        loss[channel] = 1.0;
        scratch.forget();
        let seen = scratch.walk(dvr, rays, pixel, loss);
        let by = &mut row.by_extinction[channel];
        by.clear();
        by.extend((0..texels).map(|j| scale * scratch.by(j, 3)));
        if channel == 0 {
            row.by_colour.clear();
            row.by_colour.extend((0..texels).map(|j| scratch.by(j, 0)));
            for c in 0..4 {
                row.residual[c] = seen[c] - f64::from(rays.wanted[pixel][c]);
            }
        }
    }
    row.compact();
}

fn see(dvr: &Dvr<'_, f32>, rays: &Rays, pixel: usize, tape: &mut Tape<f32>) -> [f64; 4] {
    let mut seen = [0.0; 4];
    for ray in rays.of(pixel) {
        let found = dvr.radiance_on(ray, tape).rgba();
        for c in 0..4 {
            seen[c] += f64::from(found[c]) / rays.per_pixel as f64;
        }
    }
    seen
}

/// Sum over all pixels of what `square` makes of seen less wanted.
fn sum(dvr: &Dvr<'_, f32>, rays: &Rays, square: impl Fn([f64; 4]) -> f64 + Sync) -> f64 {
    let part = rays.len().div_ceil(LANES).max(1);
    let sums: Vec<f64> = rays
        .wanted
        .par_chunks(part)
        .enumerate()
        .map(|(lane, wanted)| {
            let mut tape = Tape::default();
            let of = |(i, wanted): (usize, &[f32; 4])| {
                let seen = see(dvr, rays, lane * part + i, &mut tape);
                square(std::array::from_fn(|c| seen[c] - f64::from(wanted[c])))
            };
            wanted.iter().enumerate().map(of).sum::<f64>()
        })
        .collect();
    sums.iter().sum()
}

/// `Σ` of all four channels' squared differences.
pub(super) fn cost(dvr: &Dvr<'_, f32>, rays: &Rays) -> f64 {
    sum(dvr, rays, |d| d.iter().map(|v| v * v).sum())
}

/// The same of the colours alone.
pub(super) fn colour_cost(dvr: &Dvr<'_, f32>, rays: &Rays) -> f64 {
    sum(dvr, rays, |d| d[..3].iter().map(|v| v * v).sum())
}
