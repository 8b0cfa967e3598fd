//! Majorants: upper bounds of the extinction, brick by brick.
//!
//! A brick stores the voxels of the apron on its far sides, and so holds every value that trilinear interpolation in it
//! uses. The interpolated density lies between the least and the greatest of them and takes every value in between, so
//! that the greatest extinction of the medium over this range is the least upper bound.
//!
//! Rays skip bricks whose majorant is 0.

use crate::real::Real;
use crate::scene::bricks::Bricks;
use crate::scene::medium::{Medium, Source};
use rayon::prelude::*;

/// Upper bounds of the extinction per world length.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Majorants {
    bricks: Vec<f32>,
    /// Bound where there are no bricks: the extinction at the background.
    empty: f32,
}

impl Majorants {
    /// Computes the bounds of a field in a medium whose densities are those that the field stores.
    pub(crate) fn new<R: Real>(field: &Bricks<R>, medium: &Medium) -> Self {
        Self::of_ranges(&field.ranges(), field.background, medium)
    }

    /// Computes the bounds of a field from the least and the greatest value of each brick, and its background.
    pub(crate) fn of_ranges<R: Real>(ranges: &[[R; 2]], background: R, medium: &Medium) -> Self {
        let bricks = ranges.par_iter().map(|range| bound_between(medium, *range)).collect();
        Self { bricks, empty: bound_between(medium, [background; 2]) }
    }

    /// Returns the bound of each brick, in the order of the field's topology.
    pub(crate) fn bricks(&self) -> &[f32] {
        &self.bricks
    }

    /// Returns the bound where there are no bricks.
    pub(crate) fn empty(&self) -> f32 {
        self.empty
    }

    /// Returns the bound of the whole field.
    pub(crate) fn largest(&self) -> f32 {
        self.bricks.iter().fold(self.empty, |most, bound| most.max(*bound))
    }
}

/// Returns the greatest extinction of a medium where densities lie between two.
pub(crate) fn bound_between<R: Real>(medium: &Medium, [low, high]: [R; 2]) -> f32 {
    rounded_up(match &medium.source {
        Source::Transfer(table) => medium.extinction * table.bounds(low.f64(), high.f64()).1[3],
        Source::Grey(_) | Source::Linear(_) => medium.extinction * high.f64().max(0.0),
    })
}

/// Returns the nearest `f32` that is not less than `v`.
fn rounded_up(v: f64) -> f32 {
    let nearest = v as f32;
    if f64::from(nearest) < v { nearest.next_up() } else { nearest }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use crate::math::Affine;
    use crate::scene::table::Table;
    use crate::scene::topology::Topology;
    use glam::{DVec3, IVec3};
    use std::sync::Arc;

    /// A cheap hash to 0..1.
    fn noise(seed: u64) -> f32 {
        let h = (seed ^ 0x9E37_79B9).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        ((h ^ (h >> 31)).wrapping_mul(0x94D0_49BB_1331_11EB) >> 40) as f32 / (1 << 24) as f32
    }

    /// Bricks on both sides of the origin, with gaps; densities from 0 to 1, rough.
    fn field() -> Bricks<f32> {
        let all = (0..5 * 4 * 3).map(|i| IVec3::new(i % 5 - 2, i / 5 % 4 - 1, i / 20));
        let topology = Arc::new(Topology::new(all.filter(|b| (b.x + 2 * b.y + b.z) % 3 != 0)).unwrap());
        let mut owned = vec![0.0; topology.len() * 512];
        for (i, v) in owned.iter_mut().enumerate() {
            // Bricks of their own brightness.
            *v = noise(i as u64) * noise(7 * (i / 512) as u64 + 1);
        }
        let mut field = Bricks::zeros(topology.clone(), Affine::uniform(1.0, DVec3::ZERO).unwrap());
        topology.fill_apron(&owned, &mut field.values);
        field
    }

    fn peaks() -> Table {
        let value = |s: f64| [0.5, 0.5, 0.5, s];
        let knots = vec![0.1, 0.2, 0.3, 0.6, 0.6, 0.9];
        Table::new(knots, [0.0, 3.0, 0.0, 0.0, 1.0, 0.5].map(value).to_vec()).unwrap()
    }

    /// Interpolation between voxels, on a fine lattice in every cell of every brick: no extinction is above the bound,
    /// and in bricks where the medium is monotonic the bound is reached.
    #[test]
    fn bounds_hold_between_voxels_and_are_met() {
        let field = field();
        let table = Arc::new(peaks());
        for (source, monotonic) in [(Source::Grey([0.0; 3]), true), (Source::Transfer(table.clone()), false)] {
            let medium = Medium::new(0.7, source);
            let extinction = |d: f64| 0.7 * if monotonic { d } else { table.at(d)[3] };
            let majorants = Majorants::new(&field, &medium);
            for (number, brick) in field.topology.bricks().iter().enumerate() {
                let (bound, mut most) = (f64::from(majorants.bricks()[number]), 0.0_f64);
                for i in 0..17_i32.pow(3) {
                    let at = DVec3::new((i % 17).into(), (i / 17 % 17).into(), (i / 289).into()) * 0.5;
                    let density = f64::from(field.sample((8 * *brick).as_dvec3() + at.min(DVec3::splat(7.999_999))));
                    most = most.max(extinction(density));
                }
                // Half a unit in the last place of a weighted sum of eight.
                assert!(most <= bound * (1.0 + 1e-6), "brick {number}: {most} > {bound}");
                assert!(!monotonic || most > 0.999 * bound, "brick {number}: {most} of {bound}");
            }
        }
    }

    #[test]
    fn a_function_with_a_gap_has_bricks_without_extinction() {
        let mut field = field();
        field.values.iter_mut().for_each(|v| *v = 0.35 + 0.2 * *v);
        let medium = Medium::new(2.0, Source::Transfer(Arc::new(peaks())));
        assert!(Majorants::new(&field, &medium).bricks().iter().all(|bound| *bound == 0.0));
        // A peak narrower than the steps between voxels is seen all the same.
        field.values.iter_mut().enumerate().for_each(|(i, v)| *v = if i % 2 == 0 { 0.05 } else { 0.35 });
        let found = Majorants::new(&field, &medium);
        assert!(found.bricks().iter().all(|bound| *bound == 6.0), "{:?}", found.bricks());
    }
}
