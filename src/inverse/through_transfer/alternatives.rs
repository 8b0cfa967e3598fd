//! Densities that a transfer function shows alike.
//!
//! Pictures tell emission and extinction, and these tell a density only where the function has them once. On both
//! flanks of a peak of one color they are the same; and since the densities of a whole region can be mirrored at the
//! peak without a step at its edge, neighbours do not tell the flanks apart either. On a plateau all densities are the
//! same, and only those of neighbours, which pictures see in between, change. How near a voxel's density is known
//! locally says nothing of that. What looks like density 0, from the outside on, is taken for empty.

use crate::inverse::density::confidence::lowered;
use crate::inverse::through_transfer::matching::{sampled, shaded};
use crate::scene::bricks::Bricks;
use crate::scene::neighbours::Neighbours;
use crate::scene::table::Table;

/// Points at which the function is looked at, in addition to its knots.
const POINTS: usize = 512;

/// Squared difference, in errors of a volume of colors, up to which a part of the function has no slope.
const LEVEL: f64 = 1e-3;

/// How far from each density another one lies that the function shows alike.
#[derive(Debug, Clone, PartialEq)]
pub struct Alternatives {
    densities: Vec<f64>,
    /// Squared distance, times how much alike they are: 1 the same, `exp(-n² / 2)` where emissions and extinctions
    /// differ by n times the error that they have in a volume of colors.
    squares: Vec<f64>,
    /// Densities from 0 to this one are shown like 0.
    clear: f64,
    /// Densities from 0 to this one are shown as 0 is, without any slope.
    level: f64,
}

impl Alternatives {
    /// Looks for them from density 0 to the function's last knot.
    pub fn new(table: &Table) -> Self {
        let densities = sampled(table, POINTS);
        let (values, unit) = shaded(table, 1.0, &densities);
        let apart =
            |i: usize, k: usize| -> f64 { (0..4).map(|c| (unit[c] * (values[i][c] - values[k][c])).powi(2)).sum() };
        let farthest = |i: usize| {
            let branch = |towards: &mut dyn Iterator<Item = usize>| {
                // What differs ever more is the same branch, which the pictures' derivatives tell, but for a plateau,
                // which has none: an alternative is shown more alike again than what lies between.
                let mut most = 0.0_f64;
                let returned = towards.map(|k| (k, apart(i, k))).filter(|(_, square)| {
                    most = most.max(*square);
                    *square <= most - 1.0 || most <= LEVEL
                });
                let weighted =
                    returned.map(|(k, square)| (-0.5 * square).exp() * (densities[k] - densities[i]).powi(2));
                weighted.fold(0.0, f64::max)
            };
            branch(&mut (0..i).rev()).max(branch(&mut (i + 1..densities.len())))
        };
        let squares = (0..densities.len()).map(farthest).collect();
        let within = |most: f64| (0..densities.len()).take_while(|k| apart(0, *k) <= most).last();
        let [clear, level] = [1.0, LEVEL].map(|most| within(most).map_or(0.0, |k| densities[k]));
        Self { densities, squares, clear, level }
    }

    /// Returns the squared distance at a density: of the two points around it the larger.
    pub(crate) fn square(&self, density: f32) -> f64 {
        let last = self.densities.len() - 1;
        let after = self.densities.partition_point(|d| *d < f64::from(density)).min(last);
        self.squares[after].max(self.squares[after.saturating_sub(1)])
    }

    /// Lowers the confidence of densities (512 a brick) by their alternatives, where `deviation` is that of the prior:
    /// with variance v a confidence is p² / (p² + v), and the alternatives add to the variance. Returns the share of
    /// the voxels of a confidence above a half that lose it. Those that are empty are not counted among them, and have
    /// no alternatives but the densities from 0 on that the function does not show either.
    pub fn lower(&self, field: &Bricks<f32>, confidence: &mut [f32], deviation: f64) -> f64 {
        let densities = field.owned();
        let empty = self.empty(&densities, &Neighbours::new(&field.topology));
        let (mut known, mut lost) = (0_usize, 0_usize);
        for (voxel, confidence) in confidence.iter_mut().enumerate() {
            let within = *confidence;
            if empty[voxel] {
                *confidence = lowered(within, self.level * self.level, deviation);
                continue;
            }
            *confidence = lowered(within, self.square(densities[voxel]), deviation);
            known += usize::from(within > 0.5);
            lost += usize::from(within > 0.5 && *confidence <= 0.5);
        }
        lost as f64 / known.max(1) as f64
    }

    /// Marks the voxels that are shown like density 0 and connected through such voxels with the outside.
    fn empty(&self, densities: &[f32], neighbours: &Neighbours) -> Vec<bool> {
        let clear = |voxel: usize| f64::from(densities[voxel]) <= self.clear;
        let outermost = |voxel: &usize| clear(*voxel) && neighbours.of_voxel(*voxel).iter().any(Option::is_none);
        let mut reached: Vec<usize> = (0..densities.len()).filter(outermost).collect();
        let mut empty = vec![false; densities.len()];
        reached.iter().for_each(|voxel| empty[*voxel] = true);
        while let Some(voxel) = reached.pop() {
            for near in neighbours.of_voxel(voxel).into_iter().flatten() {
                if !empty[near] && clear(near) {
                    empty[near] = true;
                    reached.push(near);
                }
            }
        }
        empty
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use crate::math::Affine;
    use crate::scene::bricks::Topology;
    use glam::{DVec3, IVec3};
    use std::sync::Arc;

    fn table(points: &[(f64, [f64; 3], f64)]) -> Table {
        let values = points.iter().map(|(_, [r, g, b], extinction)| [*r, *g, *b, *extinction]).collect();
        Table::new(points.iter().map(|(d, ..)| *d).collect(), values).unwrap()
    }

    #[test]
    fn flanks_of_one_color_mirror_each_other() {
        let white = [1.0; 3];
        let bump =
            Alternatives::new(&table(&[(0.0, white, 0.0), (0.4, white, 5.0), (0.8, white, 0.0), (1.0, white, 0.0)]));
        for density in [0.1_f32, 0.2, 0.3, 0.5, 0.6, 0.7] {
            let distance = 2.0 * (f64::from(density) - 0.4).abs();
            let found = bump.square(density).sqrt();
            assert!((found - distance).abs() < 0.02, "{density}: {found} {distance}");
        }
        assert!(bump.square(0.4) < 1e-4);
        // Where the other flank lies a tenth away, that counts as much as the prior.
        let half = lowered(1.0, bump.square(0.35), 0.1);
        assert!((half - 0.5).abs() < 0.06, "{half}");
        assert_eq!(lowered(0.0, bump.square(0.2), 0.1), 0.0);
    }

    /// A step of one color tells that a density lies on it, and no more; ramps on both sides do.
    #[test]
    fn a_plateau_tells_no_density() {
        let (red, blue) = ([1.0, 0.0, 0.0], [0.0, 0.0, 1.0]);
        let points = [(0.0, red, 0.0), (0.2, red, 5.0), (0.5, red, 5.0), (0.6, blue, 5.0), (1.0, blue, 9.0)];
        let step = Alternatives::new(&table(&points));
        for (density, farthest) in [(0.1, 0.0), (0.25, 0.25), (0.35, 0.15), (0.4, 0.2), (0.55, 0.0), (0.8, 0.0)] {
            let found = step.square(density).sqrt();
            assert!((found - farthest).abs() < 0.02, "{density}: {found} {farthest}");
        }
    }

    /// A shell around a clear cavity: the outside is empty, the cavity may be dense.
    #[test]
    fn what_is_clear_outside_is_empty() {
        let white = [1.0; 3];
        let bump =
            Alternatives::new(&table(&[(0.0, white, 0.0), (0.4, white, 5.0), (0.8, white, 0.0), (1.0, white, 0.0)]));
        let topology = Arc::new(Topology::new((0..8).map(|i| IVec3::new(i >> 2, i >> 1 & 1, i & 1))).unwrap());
        let place = |voxel: usize| {
            let (brick, i) = (topology.bricks()[voxel / 512], (voxel % 512) as i32);
            (8 * brick + IVec3::new(i >> 6, i >> 3 & 7, i & 7)).as_dvec3() - 7.5
        };
        let shell = |voxel: &usize| (4.0..6.0).contains(&place(*voxel).length());
        let owned: Vec<f32> = (0..8 * 512).map(|voxel| if shell(&voxel) { 0.4 } else { 0.0 }).collect();
        let mut field = Bricks::zeros(topology.clone(), Affine::uniform(1.0, DVec3::ZERO).unwrap());
        topology.fill_apron(&owned, &mut field.values);
        let mut confidence = vec![0.9; owned.len()];
        let share = bump.lower(&field, &mut confidence, 0.1);
        for (voxel, confidence) in confidence.iter().enumerate() {
            assert_eq!(*confidence > 0.5, place(voxel).length() >= 4.0, "{} {confidence}", place(voxel));
        }
        assert!((0.2..0.5).contains(&share), "{share}");
    }

    #[test]
    fn colors_that_differ_and_ramps_leave_no_alternative() {
        let (red, blue) = ([1.0, 0.0, 0.0], [0.0, 0.0, 1.0]);
        let bump = [(0.0, red, 0.0), (0.39, red, 5.0), (0.41, blue, 5.0), (0.8, blue, 0.0)];
        let ramp = [(0.0, red, 0.0), (0.3, red, 0.2), (1.0, blue, 4.0)];
        for (points, densities) in [(&bump[..], 0.1..0.7), (&ramp[..], 0.0..1.0)] {
            let alternatives = Alternatives::new(&table(points));
            for i in 0..=100 {
                let density = densities.start + (densities.end - densities.start) * f64::from(i) / 100.0;
                assert!(alternatives.square(density as f32).sqrt() < 0.01, "{density}");
            }
        }
    }
}
