//! What pixels derive from texels, and the sums over all of them.

use super::normal::{Normal, Row, Sums, bounded};
use super::rays::Rays;
use crate::cancel::Cancel;
use crate::render::composited::Composited;
use crate::render::dvr::{ByKnot, Dvr, TableJacobian, Tape};
use crate::render::tiles;
use glam::DVec4;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use std::ops::Range;

/// Parts that sums are split into, whatever the number of threads.
pub(super) const PARTITIONS: usize = 16;

/// The most pixels whose products are summed up in single precision.
const MOST_PIXELS: usize = 4096;
/// Pixels that are added to the sums together.
const BATCH: usize = 16;
/// Pixels whose lengths are found in one go.
const RUN: usize = 64;

/// Scratch memory of one partition.
#[derive(Clone)]
struct Scratch {
    tape: Tape<f32>,
    jacobian: TableJacobian,
}

impl Scratch {
    fn new(texels: usize) -> Self {
        Self { tape: Tape::default(), jacobian: TableJacobian::zeros(texels) }
    }

    /// A pixel, and its derivatives by texel.
    fn derive(&mut self, dvr: &Composited<Dvr<'_, f32>>, rays: &Rays, pixel: usize) -> [f64; 4] {
        self.jacobian.forget();
        let share = 1.0 / rays.per_pixel as f64;
        let mut rendered = [0.0; 4];
        for ray in rays.of_pixel(pixel) {
            let rgba = dvr.table_jacobian(ray, share, &mut self.jacobian, &mut self.tape).rgba();
            for c in 0..4 {
                rendered[c] += share * f64::from(rgba[c]);
            }
        }
        rendered
    }

    /// The texels that the pixel depends on.
    fn texels(&self) -> impl Iterator<Item = (u32, &ByKnot)> {
        (0..).zip(self.jacobian.by_knot()).filter(|(_, by)| !by.is_none())
    }
}

/// Row of a sparse matrix: texels and values.
pub(super) type Lengths = Vec<(u32, f32)>;

/// Length of each pixel's rays in each texel (times the factor of the extinctions): derivatives of alpha where
/// nothing absorbs.
pub(super) fn lengths(non_absorbing: &Composited<Dvr<'_, f32>>, rays: &Rays, texels: usize) -> Vec<Lengths> {
    let of_run = |scratch: &mut Scratch, run: &Range<usize>| {
        let of_pixel = |pixel| {
            scratch.derive(non_absorbing, rays, pixel);
            scratch.texels().map(|(j, by)| (j, by.extinction[3] as f32)).collect()
        };
        run.clone().map(of_pixel).collect::<Vec<Lengths>>()
    };
    let runs = tiles::map(&tiles::runs(rays.len(), RUN), &rays.cancel, || Scratch::new(texels), of_run);
    // Nobody reads the rows once the work is to stop.
    runs.map_or_else(|| vec![Lengths::new(); rays.len()], |runs| runs.concat())
}

/// Extinctions whose `1 - e^{-H s}` are the alphas: at most twelve steps of Gauss and Newton with a smoothness prior of
/// `smooth` times the mean of the diagonal.
pub(super) fn extinctions(lengths: &[Lengths], rays: &Rays, texels: usize, smooth: f64) -> Vec<f64> {
    let longest = lengths.iter().map(|l| l.iter().map(|e| f64::from(e.1)).sum::<f64>()).fold(0.0_f64, f64::max);
    // A start at which no ray is opaque.
    let mut s = DVector::from_element(texels, if longest > 0.0 { 0.5 / longest } else { 0.0 });
    for _ in 0..12 {
        if rays.cancel.requested() {
            break;
        }
        let part = lengths.len().div_ceil(PARTITIONS).max(1);
        let sums: Vec<(Vec<f64>, DVector<f64>)> = lengths
            .par_chunks(part)
            .enumerate()
            .map(|(partition, rows)| {
                // Row by row, on and above the diagonal.
                let (mut matrix, mut gradient) = (vec![0.0; texels * texels], DVector::zeros(texels));
                for (i, entries) in rows.iter().enumerate() {
                    let depth: f64 = entries.iter().map(|(j, v)| f64::from(*v) * s[*j as usize]).sum();
                    let transmittance = (-depth).exp();
                    let residual = transmittance - (1.0 - f64::from(rays.targets[partition * part + i][3]));
                    for (first, (j, v)) in entries.iter().enumerate() {
                        let by = transmittance * f64::from(*v);
                        gradient[*j as usize] -= by * residual;
                        let matrix_row = &mut matrix[*j as usize * texels..][..texels];
                        let factor = by * transmittance;
                        for (k, w) in &entries[first..] {
                            matrix_row[*k as usize] += factor * f64::from(*w);
                        }
                    }
                }
                (matrix, gradient)
            })
            .collect();
        let mut gradient: DVector<f64> = sums.iter().map(|s| &s.1).sum();
        let sum = |i: usize, j: usize| sums.iter().map(|s| s.0[i.min(j) * texels + i.max(j)]).sum::<f64>();
        let mut matrix = DMatrix::from_fn(texels, texels, sum);
        let level = matrix.trace() / texels as f64;
        if level <= 0.0 {
            break;
        }
        let weight = smooth * level;
        for i in 0..texels - 1 {
            let prior_derivative = weight * (s[i + 1] - s[i]);
            gradient[i] -= prior_derivative;
            gradient[i + 1] += prior_derivative;
            matrix[(i, i)] += weight;
            matrix[(i + 1, i + 1)] += weight;
            matrix[(i, i + 1)] -= weight;
            matrix[(i + 1, i)] -= weight;
        }
        for i in 0..texels {
            matrix[(i, i)] *= 1.0 + 1e-3;
            matrix[(i, i)] += 1e-9 * level;
        }
        let Some(next) = bounded(&matrix, &gradient, &s) else { break };
        let change = (&next - &s).amax();
        s = next;
        if change <= 1e-3 * s.amax() {
            break;
        }
    }
    s.iter().copied().collect()
}

/// The normal equations of all pixels; derivatives by extinction are taken in units of `scale`.
pub(super) fn normal(dvr: &Composited<Dvr<'_, f32>>, rays: &Rays, scale: f64, texels: usize) -> Normal {
    let mut normal = Normal::zeros(texels);
    for first in (0..rays.len()).step_by(PARTITIONS * MOST_PIXELS) {
        let pixels = first..rays.len().min(first + PARTITIONS * MOST_PIXELS);
        // In order, whatever the number of threads.
        sums(dvr, rays, scale, texels, pixels).iter().for_each(|part| normal.merge(part));
    }
    normal
}

/// Sums over the pixels, partition by partition.
fn sums(dvr: &Composited<Dvr<'_, f32>>, rays: &Rays, scale: f64, texels: usize, pixels: Range<usize>) -> Vec<Sums> {
    let part = pixels.len().div_ceil(PARTITIONS);
    let of_partition = |partition: usize| {
        let begin = pixels.start + partition * part;
        let own = begin..pixels.end.min(begin + part);
        own.clone().step_by(BATCH).map(move |first| first..own.end.min(first + BATCH))
    };
    tiles::partitions(
        &mut vec![(Scratch::new(texels), vec![Row::default(); BATCH]); PARTITIONS],
        &rays.cancel,
        of_partition,
        |_| Sums::zeros(texels),
        |(scratch, rows), sums, pixels| {
            for (row, pixel) in rows.iter_mut().zip(pixels.clone()) {
                let rendered = scratch.derive(dvr, rays, pixel);
                row.residual = std::array::from_fn(|c| rendered[c] - f64::from(rays.targets[pixel][c]));
                row.texels.clear();
                row.by_extinction.clear();
                row.by_color.clear();
                for (j, by) in scratch.texels() {
                    row.texels.push(j);
                    row.by_extinction.push((scale * DVec4::from_array(by.extinction)).as_vec4());
                    row.by_color.push(by.color as f32);
                }
            }
            sums.add(&rows[..pixels.len()]);
        },
    )
}

/// A pixel.
pub(super) fn render_pixel(
    dvr: &Composited<Dvr<'_, f32>>,
    rays: &Rays,
    pixel: usize,
    tape: &mut Tape<f32>,
) -> [f64; 4] {
    let mut rendered = [0.0; 4];
    for ray in rays.of_pixel(pixel) {
        let rgba = dvr.pixel_on(ray, tape).rgba();
        for c in 0..4 {
            rendered[c] += f64::from(rgba[c]) / rays.per_pixel as f64;
        }
    }
    rendered
}

/// Sum over all pixels of `square` of the rendered less the target values.
fn sum(dvr: &Composited<Dvr<'_, f32>>, rays: &Rays, square: impl Fn([f64; 4]) -> f64 + Sync) -> f64 {
    let part = rays.len().div_ceil(PARTITIONS).max(1);
    let of_part = |tape: &mut Tape<f32>, part: &Range<usize>| {
        let of = |pixel: usize| {
            let rendered = render_pixel(dvr, rays, pixel, tape);
            square(std::array::from_fn(|c| rendered[c] - f64::from(rays.targets[pixel][c])))
        };
        part.clone().take_while(|_| !rays.cancel.requested()).map(of).sum::<f64>()
    };
    tiles::map(&tiles::runs(rays.len(), part), &Cancel::NEVER, Tape::default, of_part).into_iter().flatten().sum()
}

/// Returns the sum of all four channels' squared differences over all pixels.
pub(super) fn cost(dvr: &Composited<Dvr<'_, f32>>, rays: &Rays) -> f64 {
    sum(dvr, rays, |d| d.iter().map(|v| v * v).sum())
}

/// Returns the sum of the three colors' squared differences over all pixels.
pub(super) fn color_cost(dvr: &Composited<Dvr<'_, f32>>, rays: &Rays) -> f64 {
    sum(dvr, rays, |d| d[..3].iter().map(|v| v * v).sum())
}
