//! Boundaries between the materials of a volume, by its gradients, and transfer functions that show them.
//!
//! Kindlmann and Durkin (Semi-automatic generation of transfer functions for direct volume rendering, 1998): where two
//! materials meet, a volume passes from the value of one to that of the other, and its gradient is largest halfway. The
//! mean gradient of all voxels of one value therefore has a maximum at each boundary, and its width tells how thick the
//! boundary is. Noise raises the gradients at all values alike; of the second derivatives along the gradient, which the
//! method takes besides, it shifts the means, since they depend on the voxel's own value, so they are left out.

mod curve;
mod functions;
mod samples;
#[cfg(test)]
#[allow(clippy::unwrap_used, clippy::panic, reason = "a panic is how a test fails")]
mod tests;

pub use functions::{COLORS, Candidate};

use crate::error::{Code, Error, Result};
use crate::scene::bricks::Bricks;
use curve::{BINS, Curve, Maximum};
use rayon::prelude::*;
use samples::{Sample, Voxels};
use serde::Serialize;

/// Shares of the cells whose values lie below and above the range that is looked at.
const BEYOND: f64 = 0.001;
/// Most boundaries that are told of.
pub const MOST_BOUNDARIES: usize = 4;
/// Deviations of the border's values from their median that still count as background.
const DEVIATIONS: f64 = 3.0;
/// Standard deviation of a normal distribution whose median absolute deviation is 1.
const NORMAL: f64 = 1.4826;

/// Two standard deviations of a normal distribution over the width at half of its height.
const DEVIATIONS_OF_HALF: f64 = 0.849_322;

/// A boundary between two materials.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Boundary {
    /// Value halfway between the materials.
    pub value: f64,
    /// Distance of the values on either side at which the mean gradient has fallen to half.
    pub half_width: f64,
    /// Thickness in voxels: twice the standard deviation of the blur that would make a step look like it.
    pub thickness: f64,
    /// Mean magnitude of the gradient at the boundary, per world unit.
    pub gradient: f64,
    /// Share of the voxels whose values lie within the half width.
    pub share: f64,
}

/// A material: the most frequent value between two boundaries.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Material {
    /// Most frequent value.
    pub value: f64,
    /// Share of the voxels between the boundaries.
    pub share: f64,
}

/// Materials of a volume and the boundaries between them, by its values and gradients.
#[derive(Debug, Clone)]
pub struct Analysis {
    /// Values between which all but the least and the greatest 0.1 % of the voxels lie.
    pub range: [f64; 2],
    /// Value of most of the border of the volume's box.
    pub background: f64,
    /// Distance from the background within which values are taken for it.
    pub spread: f64,
    /// Numbers of cells in 256 bins of equal width over the range.
    pub histogram: Vec<u64>,
    /// Boundaries, four at most, in ascending order of value.
    pub boundaries: Vec<Boundary>,
    /// Materials between the boundaries, in ascending order of value.
    pub materials: Vec<Material>,
    /// Number of cells between voxels, in whose middles values and gradients were taken.
    pub cells: usize,
    /// World length of an edge of a cube of the volume's size.
    edge: f64,
    /// Share of the volume's box in which voxels are.
    filled: f64,
}

impl Analysis {
    /// Looks at the cells between voxels of a field inside its domain: at two million of them at most, on a regular
    /// lattice.
    ///
    /// # Errors
    /// If there are no voxels, or all of them have one value.
    pub fn of(field: &Bricks<f32>) -> Result<Self> {
        let empty = || Error::invalid("the volume has no active voxels").coded(Code::EmptyGrid);
        if field.domain.is_empty() || field.topology.is_empty() {
            return Err(empty().hint("choose another grid with ⟨grid⟩"));
        }
        let voxels = Voxels::of(field);
        let samples = voxels.samples();
        let range = range(&samples).ok_or_else(empty)?;
        if (range[1] - range[0]) / BINS as f64 <= 0.0 {
            return Err(Error::invalid(format!("all voxels have the value {}, and no boundaries", range[0]))
                .hint("choose another grid with ⟨grid⟩"));
        }
        let border = voxels.border();
        let background = median(border.clone());
        let deviation = NORMAL * median(border.iter().map(|value| (value - background).abs()).collect());
        let curve = Curve::of(&samples, range);
        // Noise on the border is a part of the range at most.
        let spread = (DEVIATIONS * deviation).clamp(curve.width, 0.25 * (range[1] - range[0]));
        let boundaries = boundaries(&curve, [background, spread], (samples.len(), voxels.edge));
        Ok(Self {
            range,
            background,
            spread,
            histogram: curve.counts.iter().map(|count| *count as u64).collect(),
            materials: materials(&curve, &boundaries, range),
            boundaries,
            cells: samples.len(),
            edge: voxels.box_edge(),
            filled: voxels.filled(),
        })
    }
}

/// Values between which most voxels lie; all of them, if most have one value. `None` without voxels.
fn range(samples: &[Sample]) -> Option<[f64; 2]> {
    let mut values: Vec<f64> = samples.iter().map(|sample| sample.value).collect();
    values.par_sort_unstable_by(f64::total_cmp);
    let last = values.len().checked_sub(1)?;
    let at = |share: f64| values[(share * last as f64).round() as usize];
    let robust = [at(BEYOND), at(1.0 - BEYOND)];
    Some(if robust[0] < robust[1] { robust } else { [values[0], values[last]] })
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or_default()
}

/// Returns the most prominent boundaries outside of the background, in ascending order of value.
fn boundaries(curve: &Curve, [background, spread]: [f64; 2], (cells, edge): (usize, f64)) -> Vec<Boundary> {
    let mut maxima = curve.maxima();
    maxima.sort_by(|a, b| b.prominence.total_cmp(&a.prominence).then(a.bin.cmp(&b.bin)));
    let outside = |m: &Maximum| (curve.value(m.bin as f64 + 0.5) - background).abs() > spread;
    let mut kept: Vec<Maximum> = maxima.into_iter().filter(outside).take(MOST_BOUNDARIES).collect();
    kept.sort_by_key(|m| m.bin);
    let of = |(i, maximum): (usize, &Maximum)| {
        let before = i.checked_sub(1).map_or(0, |j| curve.valley(kept[j].bin, maximum.bin));
        let after = kept.get(i + 1).map_or(BINS - 1, |next| curve.valley(maximum.bin, next.bin));
        let [(low, falls), (high, falls_too)] = curve.half_fall(*maximum, [before, after]);
        let middle = if falls && falls_too { 0.5 * (low + high) } else { maximum.bin as f64 + 0.5 };
        let half_width = (0.5 * (high - low)).max(1.0) * curve.width;
        let value = curve.value(middle);
        let gradient = curve.gradients[maximum.bin];
        let thickness = DEVIATIONS_OF_HALF * curve.length(low, high);
        let share = curve.count(value - half_width, value + half_width) / cells as f64;
        Boundary { value, half_width, thickness: thickness / edge, gradient, share }
    };
    kept.iter().enumerate().map(of).collect()
}

/// Returns the most frequent values between the boundaries.
fn materials(curve: &Curve, boundaries: &[Boundary], [low, high]: [f64; 2]) -> Vec<Material> {
    let inner = boundaries.iter().map(|boundary| boundary.value);
    let ends: Vec<f64> = [low].into_iter().chain(inner).chain([high]).collect();
    let all = curve.count(low, high);
    let of = |pair: &[f64]| {
        let centre = |bin: &usize| curve.value(*bin as f64 + 0.5);
        let bins = (0..BINS).filter(|bin| centre(bin) >= pair[0] && centre(bin) <= pair[1]);
        // Of equal counts the last: a constant material at the top of the range.
        let bin = bins.max_by(|a, b| curve.counts[*a].total_cmp(&curve.counts[*b]))?;
        let share = curve.count(pair[0], pair[1]) / all;
        (curve.counts[bin] > 0.0).then(|| Material { value: curve.values[bin], share })
    };
    ends.windows(2).filter_map(of).collect()
}
