//! Densities whose transfer function reproduces the colors of a pre-shaded volume.
//!
//! A function that is not monotonic has several densities for a color, and where it is flat or clear infinitely many.
//! Weiss & Westermann (2021, eq. 13) draw 256 random densities a voxel, and add the squared differences from the six
//! neighbours. A density is one number, so here all of the function is searched. Between two neighbours, moreover, the
//! density passes through all values between theirs: the function's average over that range (its pre-integral) must
//! match the volume between the voxels, so that no voxel jumps over a peak that the volume does not show. The two
//! halves of a chequerboard take turns (a voxel's neighbours are all in the other half), from coarse voxels to fine
//! ones, each starting at the lowest density that its color allows: regions that are clear and connected to the outside
//! are empty.

use crate::cancel::Cancel;
use crate::error::Result;
use crate::inverse::region::lattice;
use crate::scene::bricks::{Bricks, Topology};
use crate::scene::grid::LEAF_VOXELS;
use crate::scene::neighbours::Neighbours;
use crate::scene::table::Table;
use glam::{IVec3, Vec4};
use rayon::prelude::*;
use std::sync::Arc;

/// Points searched in addition to the function's knots.
const POINTS: usize = 128;
/// Error of emissions and extinctions, relative to the function's largest: the unit of differences.
const COLOR_ERROR: f32 = 0.03;
/// Difference between neighbours, relative to the range of densities, that costs as much as one such error.
const ROUGHNESS: f32 = 0.3;
/// Weight of the mismatch between two neighbours, relative to the mismatch of a voxel's own color.
const EDGE: f32 = 0.5;
/// Cost above the minimum that an initial density may have.
const ALLOWED: f32 = 1.0;
/// Rounds on each level, twice: between them, small groups on another branch of the function than their surroundings
/// are removed.
const ROUNDS: u32 = 8;
/// Coarsest level: at least this many voxels along the longest edge.
const COARSEST: f64 = 8.0;

/// Transfer function sampled at the densities that are searched, in units of the error.
struct Samples {
    density: Vec<f32>,
    /// Emission in R, G and B, and extinction.
    value: [Vec<f32>; 4],
    /// Integrals of emission and extinction over the density.
    integral: [Vec<f32>; 4],
    unit: Vec4,
    /// Weight of squared differences from neighbours.
    tie: f32,
    /// Index of the sampled density nearest to 0.
    empty: u16,
}

/// A neighbour: the target between it and the voxel, and the index of its density.
type Neighbour = (Vec4, u16);

fn range(table: &Table) -> f64 {
    table.knots()[table.knots().len() - 1].max(f64::MIN_POSITIVE)
}

/// Returns the densities from 0 to the function's last knot at which it is looked at: `points` of equal distance, and
/// the knots.
pub(crate) fn sampled(table: &Table, points: usize) -> Vec<f64> {
    let range = range(table);
    let mut density: Vec<f64> = (0..=points).map(|i| range * i as f64 / points as f64).collect();
    density.extend(table.knots().iter().filter(|k| **k > 0.0));
    density.sort_by(f64::total_cmp);
    density.dedup_by(|a, b| (*a - *b).abs() < 1e-4 * range);
    density
}

/// Returns emission (R, G, B) and extinction at each density, and by what they are to be multiplied so that differences
/// are in units of [`COLOR_ERROR`].
pub(crate) fn shaded(table: &Table, scale: f64, density: &[f64]) -> (Vec<[f64; 4]>, [f64; 4]) {
    let of = |d: &f64| {
        let [r, g, b, extinction] = table.at(*d);
        [r, g, b, 1.0].map(|c| scale * extinction * c)
    };
    let all: Vec<[f64; 4]> = density.iter().map(of).collect();
    let largest = |c: usize| all.iter().fold(f64::MIN_POSITIVE, |a, v| a.max(v[c]));
    // Light is light: one unit for all its channels.
    let brightest = largest(0).max(largest(1)).max(largest(2));
    let unit = [brightest, brightest, brightest, largest(3)].map(|v| 1.0 / (f64::from(COLOR_ERROR) * v));
    (all, unit)
}

impl Samples {
    fn new(table: &Table, scale: f64) -> Self {
        let range = range(table);
        let density = sampled(table, POINTS);
        let (all, unit) = shaded(table, scale, &density);
        let integral = |c: usize| {
            let mut sum = 0.0;
            let steps = density.windows(2).zip(all.windows(2));
            let steps = steps.map(|(d, v)| {
                sum += 0.5 * unit[c] * (d[1] - d[0]) * (v[0][c] + v[1][c]);
                sum as f32
            });
            std::iter::once(0.0).chain(steps).collect()
        };
        let integral = std::array::from_fn(integral);
        let empty = density.iter().enumerate().min_by(|a, b| a.1.abs().total_cmp(&b.1.abs())).map_or(0, |(i, _)| i);
        Self {
            value: std::array::from_fn(|c| all.iter().map(|v| (unit[c] * v[c]) as f32).collect()),
            integral,
            density: density.iter().map(|d| *d as f32).collect(),
            unit: Vec4::from_array(unit.map(|v| v as f32)),
            tie: (1.0 / (f64::from(ROUGHNESS) * range).powi(2)) as f32,
            empty: empty as u16,
        }
    }

    /// Writes the cost of each sampled density: its difference from `target`, and the mismatch with its neighbours.
    fn costs(&self, target: Vec4, beside: &[Neighbour], cost: &mut Vec<f32>) {
        let count = self.density.len();
        cost.clear();
        cost.resize(count, 0.0);
        for (c, value) in self.value.iter().enumerate() {
            for (cost, v) in cost.iter_mut().zip(value) {
                *cost += (v - target[c]) * (v - target[c]);
            }
        }
        for (between, other) in beside {
            let other = *other as usize;
            let (d, own) = (self.density[other], self.value.each_ref().map(|v| v[other]));
            let from = self.integral.each_ref().map(|v| v[other]);
            let [r, g, b, s] = &self.integral;
            let [r, g, b, s] = [&r[..count], &g[..count], &b[..count], &s[..count]];
            let cost = &mut cost[..count];
            for k in 0..count {
                let step = self.density[k] - d;
                let inverse = 1.0 / step;
                let mean = |to: f32, c: usize| if k == other { own[c] } else { (to - from[c]) * inverse };
                let off = [
                    mean(r[k], 0) - between.x,
                    mean(g[k], 1) - between.y,
                    mean(b[k], 2) - between.z,
                    mean(s[k], 3) - between.w,
                ];
                let square = off[0] * off[0] + off[1] * off[1] + off[2] * off[2] + off[3] * off[3];
                cost[k] += EDGE * square + self.tie * step * step;
            }
        }
    }

    /// Returns the index of the density with the least cost; on a tie, of the lowest one.
    fn best(&self, target: Vec4, beside: &[Neighbour], cost: &mut Vec<f32>) -> u16 {
        self.costs(target, beside, cost);
        let least = cost.iter().fold(f32::INFINITY, |a, c| a.min(*c));
        cost.iter().position(|c| *c <= least).unwrap_or(0) as u16
    }

    /// Returns the index of the lowest density whose difference from `target` is allowed; negative densities only if no
    /// other is.
    fn lowest(&self, target: Vec4, cost: &mut Vec<f32>) -> u16 {
        self.costs(target, &[], cost);
        let least = cost.iter().fold(f32::INFINITY, |a, c| a.min(*c));
        let allowed = |k: &usize| cost[*k] <= least + ALLOWED;
        (self.empty as usize..cost.len()).find(allowed).or_else(|| (0..cost.len()).find(allowed)).unwrap_or(0) as u16
    }

    /// Returns the index of the sampled density nearest to `density`.
    fn nearest(&self, density: f32) -> u16 {
        let after = self.density.partition_point(|d| *d < density).min(self.density.len() - 1);
        let before = after.saturating_sub(1);
        let nearer = density - self.density[before] < self.density[after] - density;
        (if nearer { before } else { after }) as u16
    }
}

/// Finds densities on the lattice of `volume`. `scale` multiplies the function's extinction; `unknown` marks the voxels
/// (512 a brick of `topology`) to find: the others have the density nearest to 0 of those searched. Once the work is
/// cancelled, voxels keep their current density.
///
/// # Errors
/// If the lattice cannot be made coarser.
pub(crate) fn densities(
    volume: &Bricks<Vec4>,
    table: &Table,
    scale: f64,
    topology: &Arc<Topology>,
    unknown: &[bool],
    cancel: &Cancel,
) -> Result<Bricks<f32>> {
    let samples = Samples::new(table, scale);
    let extent = volume.topology.bounds().size().max_element();
    let coarser = (0..).take_while(|l| extent / f64::from(2_u32 << l) >= COARSEST).count() as u32;
    let finest = Level {
        targets: resampled(volume, topology, &volume.transform).into_iter().map(|v| v * samples.unit).collect(),
        unknown: unknown.to_vec(),
        densities: Bricks::zeros(topology.clone(), volume.transform),
    };
    let mut levels = vec![finest];
    for level in 1..=coarser {
        levels.push(levels[level as usize - 1].coarser()?);
    }
    let mut densities: Option<Bricks<f32>> = None;
    for mut level in levels.into_iter().rev() {
        let start = densities.map(|f: Bricks<f32>| f.resampled(&level.densities.topology, &level.densities.transform));
        densities = Some(level.relax(&samples, start, cancel));
    }
    Ok(densities.unwrap_or_else(|| Bricks::zeros(topology.clone(), volume.transform)))
}

/// Resamples the volume to the voxels of `topology`, as targets.
fn resampled(volume: &Bricks<Vec4>, topology: &Topology, lattice: &crate::math::Affine) -> Vec<Vec4> {
    let channels = [0, 1, 2, 3].map(|c| volume.channel(c).resampled(topology, lattice));
    (0..channels[0].len()).map(|i| Vec4::new(channels[0][i], channels[1][i], channels[2][i], channels[3][i])).collect()
}

/// The problem on one lattice.
struct Level {
    targets: Vec<Vec4>,
    unknown: Vec<bool>,
    densities: Bricks<f32>,
}

impl Level {
    /// Returns the problem on voxels twice as large, with means over the unknown ones among eight.
    fn coarser(&self) -> Result<Self> {
        let topology = &self.densities.topology;
        let lattice = lattice::coarser(&self.densities.transform, 1)?;
        let coarse = Arc::new(Topology::new(topology.bricks().iter().map(|b| b.map(|v| v >> 1)))?);
        let mut targets = vec![Vec4::ZERO; coarse.len() * LEAF_VOXELS];
        let mut count = vec![0.0_f32; targets.len()];
        for (voxel, target) in self.targets.iter().enumerate().filter(|(v, _)| self.unknown[*v]) {
            let local = voxel % LEAF_VOXELS;
            let local = IVec3::new((local >> 6) as i32, (local >> 3 & 7) as i32, (local & 7) as i32);
            let at = (8 * topology.bricks()[voxel / LEAF_VOXELS] + local).map(|v| v >> 1);
            let own = at & IVec3::splat(7);
            let parent =
                coarse.find(at.map(|v| v >> 3)) as usize * LEAF_VOXELS + (own.x << 6 | own.y << 3 | own.z) as usize;
            targets[parent] += *target;
            count[parent] += 1.0;
        }
        targets.iter_mut().zip(&count).for_each(|(t, c)| *t /= c.max(1.0));
        Ok(Self {
            targets,
            unknown: count.iter().map(|c| *c > 0.0).collect(),
            densities: Bricks::zeros(coarse, lattice),
        })
    }

    /// Improves all voxels' densities in turn, and returns them.
    fn relax(&mut self, samples: &Samples, start: Option<Vec<f32>>, cancel: &Cancel) -> Bricks<f32> {
        let neighbours = Neighbours::new(&self.densities.topology);
        let (targets, unknown) = (&self.targets, &self.unknown);
        let begin = |cost: &mut Vec<f32>, voxel: usize| match &start {
            _ if !unknown[voxel] => samples.empty,
            Some(start) => samples.nearest(start[voxel]),
            None if cancel.requested() => samples.empty,
            None => samples.lowest(targets[voxel], cost),
        };
        let all = 0..targets.len();
        let mut indices: Vec<u16> = all.clone().into_par_iter().map_init(Vec::new, begin).collect();
        let medians = |indices: &[u16]| -> Vec<u16> {
            let median = |voxel: usize| {
                if !unknown[voxel] {
                    return indices[voxel];
                }
                let mut all = [indices[voxel]; 7];
                let near = neighbours.of_voxel(voxel);
                all.iter_mut()
                    .zip(near)
                    .for_each(|(v, neighbour)| *v = neighbour.map_or(*v, |neighbour| indices[neighbour]));
                all.sort_unstable();
                all[3]
            };
            all.clone().into_par_iter().map(median).collect()
        };
        // A voxel whose neighbours stay has nothing to reconsider.
        let mut changed = vec![true; indices.len()];
        for round in 0..4 * ROUNDS {
            if cancel.requested() {
                break;
            }
            if round == 2 * ROUNDS {
                indices = medians(&medians(&indices));
            }
            if round <= 1 || (2 * ROUNDS..=2 * ROUNDS + 1).contains(&round) {
                changed.fill(true);
            }
            let (before, unsettled) = (&indices, &changed);
            let update = |(cost, beside): &mut (Vec<f32>, Vec<Neighbour>), voxel: usize| {
                let i = voxel % LEAF_VOXELS;
                let half = ((i >> 6) + (i >> 3) + i) & 1;
                if !unknown[voxel] || half != (round & 1) as usize || cancel.requested() {
                    return before[voxel];
                }
                let own = targets[voxel];
                let near = neighbours.of_voxel(voxel);
                if !near.iter().flatten().any(|neighbour| unsettled[*neighbour]) {
                    return before[voxel];
                }
                beside.clear();
                beside.extend(
                    near.iter().flatten().map(|neighbour| (0.5 * (own + targets[*neighbour]), before[*neighbour])),
                );
                samples.best(own, beside, cost)
            };
            let after: Vec<u16> = all.clone().into_par_iter().map_init(Default::default, update).collect();
            changed = after.par_iter().zip(&indices).map(|(a, b)| a != b).collect();
            indices = after;
        }
        let densities: Vec<f32> = indices.iter().map(|k| samples.density[*k as usize]).collect();
        let field = &mut self.densities;
        field.topology.fill_apron(&densities, &mut field.values);
        field.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Affine;
    use glam::DVec3;

    /// Index coordinates of an owned voxel of two bricks in a row.
    fn place(voxel: usize) -> [usize; 3] {
        let i = voxel % LEAF_VOXELS;
        [8 * (voxel / LEAF_VOXELS) + (i >> 6), i >> 3 & 7, i & 7]
    }

    #[test]
    fn coarser_voxels_are_the_means_of_the_unknown_ones() {
        let topology = Arc::new(Topology::new([IVec3::ZERO, IVec3::X]).unwrap());
        let target = |v: usize| Vec4::new(v as f32, (v % 7) as f32, 2.0, 0.5);
        let unknown = |v: usize| !v.is_multiple_of(3) && place(v)[1] < 6;
        let level = Level {
            targets: (0..2 * LEAF_VOXELS).map(target).collect(),
            unknown: (0..2 * LEAF_VOXELS).map(unknown).collect(),
            densities: Bricks::zeros(topology, Affine::uniform(1.0, DVec3::ZERO).unwrap()),
        };
        let coarse = level.coarser().unwrap();
        assert_eq!(coarse.targets.len(), LEAF_VOXELS);
        for (voxel, coarse_target) in coarse.targets.iter().enumerate() {
            let fine = (0..2 * LEAF_VOXELS).filter(|v| unknown(*v) && place(*v).map(|c| c / 2) == place(voxel));
            let (sum, count) = fine.fold((Vec4::ZERO, 0), |(sum, count), v| (sum + target(v), count + 1));
            assert_eq!(coarse.unknown[voxel], count > 0, "{voxel}");
            assert!(
                (*coarse_target - sum / count.max(1) as f32).abs().max_element() < 1e-3,
                "{voxel}: {coarse_target} {sum} {count}"
            );
        }
    }
}
