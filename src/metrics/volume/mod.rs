//! Differences of two volumes: PSNR, RMS, largest difference and overlap of their topologies.
//!
//! The domain is the union of the two boxes of active voxels, on the first volume's lattice. Where the lattices differ,
//! the second volume is sampled trilinearly at the first one's voxel centres.

mod effort;
mod field;
mod pair;
mod partial;

pub use effort::{Effort, OnStep};
pub use field::Field;

use crate::error::{Error, Result};
use crate::math::Aabb;
use crate::scene::bricks::Bricks;
use crate::scene::grid::LEAF_VOXELS;
use glam::{DVec3, IVec3};
use pair::Pair;
use partial::Partial;
use rayon::prelude::*;
use serde::Serialize;

/// Difference of a volume B from a reference A.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Difference {
    /// PSNR in dB, `20 log10(peak / rms)` with `peak = max |A|` over active voxels; `None` if `rms` or the peak is 0.
    pub psnr_db: Option<f64>,
    /// Root mean square difference over all voxels and components of the domain.
    pub rms: f64,
    /// Largest absolute difference of a value.
    pub max_abs: f64,
    /// Intersection over union of the topologies: voxels active in both over voxels active in either; 1 if none is
    /// active.
    pub topology_iou: f64,
    /// Largest distance in world units between the positions of a corner of the domain under the two transforms; 0 if
    /// equal.
    pub transform_difference: f64,
    /// Number of voxels of the domain.
    pub voxels: u64,
    /// Number of these voxels that were compared: all of them, or the part that `Effort` allows.
    pub compared: u64,
    /// True if figures are estimates from a part of the voxels. `max_abs` is the largest difference of that part.
    pub sampled: bool,
    /// Number of values of which one is finite and the other is not, or whose kinds of infinity differ. They are left
    /// out of `rms` and `max_abs`.
    pub incomparable: u64,
    /// The multiple of A that B is nearest to; `None` if either is 0 everywhere, or they are equal.
    pub multiple: Option<Multiple>,
}

/// The multiple of A that B is nearest to, by least squares.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Multiple {
    /// Factor of A.
    pub factor: f64,
    /// PSNR in dB of B divided by the factor, with the peak of A; `None` if nothing is left.
    pub psnr_db: Option<f64>,
}

impl Multiple {
    /// Fits B to A from the sums of squares of A, of B and of their difference over a number of values. Nothing is left
    /// where the rest is within the rounding of these sums.
    fn fit([a, b]: [f64; 2], difference: f64, values: f64, peak: f64) -> Option<Self> {
        let product = 0.5 * (a + b - difference);
        if !(a > 0.0 && product > 0.0 && difference > 0.0) {
            return None;
        }
        let factor = product / a;
        let left = b - factor * product;
        let rms = (left.max(0.0) / values).sqrt() / factor;
        Some(Self { factor, psnr_db: (left > 1e-12 * b && peak > 0.0).then(|| 20.0 * (peak / rms).log10()) })
    }
}

impl Difference {
    /// True if no value differs by more than `max_abs`, all values are comparable and the transforms are equal. With a
    /// `max_abs` of 0 the topologies must be equal too.
    pub fn within(&self, max_abs: f64) -> bool {
        self.max_abs <= max_abs
            && self.incomparable == 0
            && self.transform_difference == 0.0
            && (max_abs > 0.0 || self.topology_iou == 1.0)
    }

    /// Returns the multiple if it explains most of the difference: a factor apart from 1 by a percent or more, after
    /// which less than a tenth of the power of the difference is left.
    pub fn explained(&self) -> Option<Multiple> {
        const GAIN_DB: f64 = 10.0;
        let multiple = self.multiple.filter(|multiple| (multiple.factor - 1.0).abs() >= 0.01)?;
        let gain = |before: f64| multiple.psnr_db.is_none_or(|after| after >= before + GAIN_DB);
        self.psnr_db.is_some_and(gain).then_some(multiple)
    }
}

/// Compares all of `b` with the reference `a`, as `compare_within` does.
///
/// # Errors
/// The conditions are those of `compare_within`.
pub fn compare(a: &Field<'_>, b: &Field<'_>) -> Result<Difference> {
    compare_within(a, b, Effort::ALL, &|_, _| {})
}

/// Compares `b` with the reference `a`, with no more work than `effort` allows. Regions in which both are constant are
/// compared as a whole. `step` is called again and again.
///
/// # Errors
/// If the components differ, or too many voxels would have to be compared.
pub fn compare_within(a: &Field<'_>, b: &Field<'_>, effort: Effort, step: OnStep<'_>) -> Result<Difference> {
    if a.components != b.components {
        return Err(Error::invalid(format!(
            "one grid has {} values a voxel, the other {}",
            a.components, b.components
        ))
        .hint("compare grids of one kind: name them with ⟨grid⟩"));
    }
    let same = a.transform == b.transform;
    let b_box = b.active_box.map(|(min, max)| if same { (min, max) } else { on_lattice(min, max, b, a) });
    let Some((min, max)) = union(a.active_box, b_box) else {
        return Ok(Difference {
            psnr_db: None,
            rms: 0.0,
            max_abs: 0.0,
            topology_iou: 1.0,
            transform_difference: transform_difference(a, b, [0; 3], [0; 3]),
            voxels: 0,
            compared: 0,
            sampled: false,
            incomparable: 0,
            multiple: None,
        });
    };
    let along_axes = !same && {
        let turn = b.transform.inverse_matrix() * a.transform.matrix();
        let columns = [turn.x_axis, turn.y_axis, turn.z_axis].map(|c| c.truncate().to_array());
        (0..3).all(|i| (0..3).all(|j| i == j || columns[i][j].abs() <= 1e-12 * columns[i][i].abs()))
    };
    let mut pair = Pair {
        a,
        b,
        same,
        min,
        max,
        along_axes,
        blocks: Vec::new(),
        interpolated: Vec::new(),
        constant: Partial::default(),
    };
    pair.divide()?;
    let (sum, left_out) = pair.sum(effort, step);
    let voxels: i128 = (0..3).map(|i| i128::from(max[i]) - i128::from(min[i]) + 1).product();
    let values = voxels as f64 * a.components as f64;
    let rms = (sum.squares / values).sqrt();
    let peak = a.peak();
    Ok(Difference {
        psnr_db: (rms > 0.0 && peak > 0.0).then(|| 20.0 * (peak / rms).log10()),
        rms,
        max_abs: sum.max,
        topology_iou: if sum.either == 0 { 1.0 } else { sum.both as f64 / sum.either as f64 },
        transform_difference: transform_difference(a, b, min, max),
        voxels: voxels.min(u64::MAX.into()) as u64,
        compared: (voxels - i128::from(left_out.unwrap_or(0))).min(u64::MAX.into()) as u64,
        sampled: left_out.is_some(),
        incomparable: sum.incomparable,
        multiple: Multiple::fit(sum.energies, sum.squares, values, peak),
    })
}

fn corner(c: [i32; 3]) -> DVec3 {
    DVec3::from_array(c.map(f64::from))
}

/// Box of the voxels of `from` on the lattice of `onto`, rounded outwards.
fn on_lattice(min: [i32; 3], max: [i32; 3], from: &Field<'_>, onto: &Field<'_>) -> ([i32; 3], [i32; 3]) {
    let world = Aabb { min: corner(min), max: corner(max) }.corners().map(|c| from.transform.to_world(c));
    let index = world.into_iter().fold(Aabb::EMPTY, |b, w| b.including(onto.transform.to_index(w)));
    // A rounding error below a millionth of a voxel must not add a layer.
    ((index.min + 1e-6).floor().as_ivec3().to_array(), (index.max - 1e-6).ceil().as_ivec3().to_array())
}

type IndexBox = ([i32; 3], [i32; 3]);

fn union(a: Option<IndexBox>, b: Option<IndexBox>) -> Option<IndexBox> {
    match (a, b) {
        (Some((a0, a1)), Some((b0, b1))) => {
            Some((std::array::from_fn(|i| a0[i].min(b0[i])), std::array::from_fn(|i| a1[i].max(b1[i]))))
        }
        (one, other) => one.or(other),
    }
}

fn transform_difference(a: &Field<'_>, b: &Field<'_>, min: [i32; 3], max: [i32; 3]) -> f64 {
    let corners = Aabb { min: corner(min), max: corner(max) }.corners();
    corners.map(|c| a.transform.to_world(c).distance(b.transform.to_world(c))).into_iter().fold(0.0, f64::max)
}
/// Root mean square differences at the voxels of `a` where `a` or `b` is not zero, in two parts: where a third field
/// `known` is at least one half, and elsewhere. `None` stands for a part without voxels.
pub fn rms_apart(a: &Bricks<f32>, b: &Bricks<f32>, known: &Bricks<f32>) -> [Option<f64>; 2] {
    let brick = |(brick, voxels): (&IVec3, &[f32])| {
        let mut sums = [[0.0_f64; 2]; 2];
        for (i, own) in voxels.iter().enumerate() {
            let local = IVec3::new((i >> 6) as i32, (i >> 3 & 7) as i32, (i & 7) as i32);
            let world = a.transform.to_world((8 * *brick + local).as_dvec3());
            let other = b.sample(b.transform.to_index(world));
            if *own != 0.0 || other != 0.0 {
                let part = &mut sums[usize::from(known.sample(known.transform.to_index(world)) < 0.5)];
                *part = [part[0] + f64::from(own - other).powi(2), part[1] + 1.0];
            }
        }
        sums
    };
    let owned = a.owned();
    let bricks = a.topology.bricks().par_iter().zip(owned.par_chunks(LEAF_VOXELS));
    let all: Vec<_> = bricks.map(brick).collect();
    [0, 1].map(|part| {
        let [square, count] = all.iter().fold([0.0; 2], |t, s| [t[0] + s[part][0], t[1] + s[part][1]]);
        (count > 0.0).then(|| (square / count).sqrt())
    })
}
