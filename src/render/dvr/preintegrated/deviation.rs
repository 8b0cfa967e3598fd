//! How far the density along a ray lies from the line between two nodes.
//!
//! Between nodes at a distance h it lies at most
//!
//! ```text
//! e = m (u_x u_y + u_y u_z + u_z u_x) h² / 4  +  a ((u_x + u_y + u_z) h / 4 + h² / 8)
//! ```
//! away, with u the magnitudes of the ray's direction, m the largest mixed second difference of the voxels, which
//! bounds the curvature within a cell, and a the largest second difference along an axis, which bounds the change of
//! slope from cell to cell.
//!
//! Between nodes of one cell the density is a cubic. Its second derivative is linear in the length; with s and t that
//! derivative times h² at the two nodes, the density's distance from the line is `-v (1 - v) ((2 - v) s + (1 + v) t) /
//! 6` at a share v of the length. Its mean is `-(s + t) / 24`, its magnitude at most the larger one of s and t over 8,
//! and where both have the same sign the density lies on one side of the line.

use super::nodes::{Corners, Nodes};
use crate::real::{LANES, Lanes, Real};
use glam::DVec3;

/// Deviations of the density from the lines of four segments.
#[derive(Debug, Clone, Copy)]
pub(super) struct Deviation<R: Real> {
    /// How far the density may lie below and above the line.
    pub below: R::Lanes,
    pub above: R::Lanes,
    /// Mean deviation, of segments in one cell; else zero.
    pub mean: R::Lanes,
    /// 1 for segments in one cell, else 0.
    pub within: R::Lanes,
    /// Rounding of the interpolated densities: next to a large value there are no exact small ones.
    pub noise: R::Lanes,
}

/// Distances along a ray, as far as they determine deviations.
#[derive(Debug, Clone, Copy)]
pub(super) struct Deviations<R> {
    /// Index coordinates gained per world length.
    direction: [R; 3],
    /// Voxels per world length.
    voxels: R,
    /// Factor of `m h²` in this module's header.
    mixed: R,
    /// Factors of `a h` and `a h²`.
    axis: [R; 2],
}

impl<R: Real> Deviations<R> {
    /// Creates the numbers of a ray, from its index coordinates gained per world length.
    pub(crate) fn new(direction: DVec3) -> Self {
        let voxels = direction.length();
        let u = (direction / voxels).abs();
        let mixed = R::of(0.25 * (u.y * u.z + u.z * u.x + u.x * u.y));
        let axis = [R::of(0.25 * u.element_sum()), R::of(0.125)];
        Self { direction: direction.to_array().map(R::of), voxels: R::of(voxels), mixed, axis }
    }

    /// Returns a bound for the least favorable direction, at a distance of nodes in voxels.
    pub(crate) fn bound([axis, mixed]: [f64; 2], h: f64) -> f64 {
        0.25 * mixed * h * h + axis * (0.25 * 3.0_f64.sqrt() * h + 0.125 * h * h)
    }

    /// Returns the deviations of the segments that end at four nodes; `before` is the offset of the cell of the node
    /// before them.
    #[inline(always)]
    pub(crate) fn of(&self, nodes: &Nodes<R>, corners: &Corners<R>, before: u32) -> Deviation<R> {
        let all = <R::Lanes as Lanes<R>>::splat;
        let [a, b, c, d] = nodes.offset;
        let same = |here: u32, before: u32| if here == before { R::ONE } else { R::ZERO };
        let same = R::Lanes::load([same(a, before), same(b, a), same(c, b), same(d, c)]);
        let [axis, mixed] = nodes.roughness;
        // Segments in one cell are marked by -1 in place of the roughness along an axis.
        let within = same.greater(-axis);
        let axis = axis.greater(R::Lanes::ZERO);
        let h = nodes.length * all(self.voxels);
        let between = h * (all(self.mixed) * h * mixed + axis * (all(self.axis[0]) + h * all(self.axis[1])));
        let beyond = (all(R::ONE) - within) * between;
        let [begin, end] = self.cubic(nodes).second(corners);
        // Where the second derivative is positive the density lies below the line.
        let eighth = within * all(R::of(0.125));
        let side = |a: R::Lanes, b: R::Lanes| eighth * a.greater(b).greater(R::Lanes::ZERO) + beyond;
        let mean = within * Cubic::<R>::mean([begin, end]);
        let [near, far] = corners;
        let larger = |i: usize| near[i].abs().greater(far[i].abs());
        let noise = all(R::EPSILON) * larger(0).greater(larger(1)).greater(larger(2).greater(larger(3)));
        Deviation { below: side(begin, end), above: side(-begin, -end), mean, within, noise }
    }

    /// Returns the cubics along the segments that end at four nodes, each in the cell of its node.
    #[inline(always)]
    pub(crate) fn cubic(&self, nodes: &Nodes<R>) -> Cubic<R> {
        // No `map`, here and below: it is not always inlined.
        let gain = |a: usize| nodes.length * R::Lanes::splat(self.direction[a]);
        Cubic::new(nodes.at, [gain(0), gain(1), gain(2)])
    }
}

/// The density along four segments, each of which lies in one cell.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cubic<R: Real> {
    /// Sums of the cell-local coordinates of the two ends.
    ends: [R::Lanes; 3],
    /// Cell-local coordinates of the second end.
    at: [R::Lanes; 3],
    /// Coordinates gained along the segments.
    gain: [R::Lanes; 3],
}

impl<R: Real> Cubic<R> {
    /// Creates segments from the cell-local coordinates of their second ends, and the coordinates gained along them.
    #[inline(always)]
    fn new(at: [R::Lanes; 3], gain: [R::Lanes; 3]) -> Self {
        let ends = |a: usize| at[a] + at[a] - gain[a];
        Self { ends: [ends(0), ends(1), ends(2)], at, gain }
    }

    /// Returns the products of gains along y and z, z and x, x and y.
    #[inline(always)]
    fn products(&self) -> [R::Lanes; 3] {
        let [x, y, z] = self.gain;
        [y * z, z * x, x * y]
    }

    /// Returns the mixed differences of the values along y and z, z and x, x and y, on the lower faces of the cells,
    /// and the difference from these to the upper faces, of which there is only one.
    #[inline(always)]
    fn differences([near, far]: &Corners<R>) -> ([R::Lanes; 3], R::Lanes) {
        let across = |v: &[R::Lanes; LANES]| v[0] - v[1] - v[2] + v[3];
        let yz = across(near);
        let with_x = |b: usize| (far[b] - far[0]) - (near[b] - near[0]);
        ([yz, with_x(1), with_x(2)], across(far) - yz)
    }

    /// Returns the second derivatives at the two ends, times the squares of the lengths.
    #[inline(always)]
    fn second(&self, corners: &Corners<R>) -> [R::Lanes; 2] {
        let ([yz, zx, xy], twist) = Self::differences(corners);
        let [p, q, r] = self.products();
        let [x, y, z] = self.at;
        let end = p * (yz + x * twist) + q * (zx + y * twist) + r * (xy + z * twist);
        let half = end - R::Lanes::splat(R::of(3.0)) * (p * self.gain[0] * twist);
        [half + half, end + end]
    }

    /// Returns the mean deviations from the lines, by the second derivatives at the two ends.
    #[inline(always)]
    fn mean([begin, end]: [R::Lanes; 2]) -> R::Lanes {
        R::Lanes::splat(R::of(-1.0 / 24.0)) * (begin + end)
    }

    /// Returns the mean deviations from the lines.
    #[inline(always)]
    pub(crate) fn deviation(&self, corners: &Corners<R>) -> R::Lanes {
        Self::mean(self.second(corners))
    }

    /// Returns the derivatives of [`Cubic::deviation`], times a factor, with respect to the values at the corners.
    #[inline(always)]
    pub(crate) fn by_corners(&self, factor: R::Lanes) -> Corners<R> {
        let factor = factor * R::Lanes::splat(R::of(-1.0 / 12.0));
        let [p, q, r] = self.products();
        let (p, q, r) = (factor * p, factor * q, factor * r);
        let far = p * self.ends[0] + q * self.ends[1] + r * self.ends[2];
        let (yz, zx, xy) = (p + p - far, q + q, r + r);
        [[yz + zx + xy, -(yz + zx), -(yz + xy), yz], [far - zx - xy, zx - far, xy - far, far]]
    }

    /// Returns the derivatives of [`Cubic::deviation`] with respect to the coordinates of the first and the second
    /// ends.
    #[inline(always)]
    pub(crate) fn by_ends(&self, corners: &Corners<R>) -> [[R::Lanes; 3]; 2] {
        let (mixed, twist) = Self::differences(corners);
        let products = self.products();
        let twelfth = R::Lanes::splat(R::of(-1.0 / 12.0));
        // By the gain, and by the sum of the ends' coordinates.
        let both = [0, 1, 2].map(|a| {
            let (b, c) = ((a + 1) % 3, (a + 2) % 3);
            // The product of a with b has its differences at c, and the other way around.
            let term = |b: usize, c: usize| self.gain[b] * (mixed[c] + mixed[c] + twist * self.ends[c]);
            (twelfth * (term(b, c) + term(c, b)), twelfth * (twist * products[a]))
        });
        [both.map(|(gain, sum)| sum - gain), both.map(|(gain, sum)| sum + gain)]
    }
}

#[cfg(test)]
mod tests {
    use super::super::nodes::{ONE_CELL, roughness};
    use super::*;
    use crate::render::cell::{corners, gather, placed, weights};
    use crate::scene::bricks::BRICK;
    use glam::DVec4;
    use proptest::prelude::*;

    /// A node repeated four times.
    fn node(offset: u32, at: [f64; 3], length: f64, [axis, mixed]: [f64; 2]) -> Nodes<f64> {
        let all = DVec4::splat;
        Nodes { offset: [offset; LANES], at: at.map(all), length: all(length), roughness: [all(axis), all(mixed)] }
    }

    proptest! {
        /// Bounds and mean hold for rough and for smooth bricks, from node to node across cells and within one.
        #[test]
        fn densities_deviate_by_no_more_than_the_bound(
            noise in prop::collection::vec(-1.0..1.0_f64, BRICK), rough in 0.0..1.0_f64,
            wave in prop::array::uniform3(-0.9..0.9_f64),
            from in prop::array::uniform3(0.0..8.0_f64), to in prop::array::uniform3(0.0..8.0_f64),
            short in 0.05..1.0_f64,
        ) {
            let values: Vec<f64> = (0..BRICK).map(|i| {
                let p = DVec3::new((i / 81) as f64, (i / 9 % 9) as f64, (i % 9) as f64);
                rough * noise[i] + p.dot(wave.into()).sin()
            }).collect();
            let (from, to) = (DVec3::from(from), DVec3::from(to));
            let to = from + short * short * (to - from);
            prop_assume!((to - from).length() > 1e-3);
            let at = |share: f64| {
                let (offset, at) = placed((from + share * (to - from)).to_array());
                (offset, gather::<f64>(&weights(at), &corners(&values, offset as usize)), at)
            };
            let (begin, end) = (at(0.0), at(1.0));
            let roughness = roughness(&values);
            let direction = (to - from).normalize();
            let (deviations, length) = (Deviations::<f64>::new(2.0 * direction), 0.5 * (to - from).length());
            let nodes = node(end.0, end.2, length, roughness);
            let found = deviations.of(&nodes, &nodes.corners(&values), u32::MAX);
            let most = Deviations::<f64>::bound(roughness, (to - from).length());
            prop_assert!(found.below.x <= most + 1e-12 && found.mean.x == 0.0);
            let mut bounds = [found.below.x, found.above.x];
            if begin.0 == end.0 {
                let before = found.below.x;
                let nodes = node(end.0, end.2, length, [ONE_CELL, 0.0]);
                let found = deviations.of(&nodes, &nodes.corners(&values), u32::MAX);
                prop_assert!(found.below.x.max(found.above.x) <= before + 1e-12);
                bounds = [found.below.x, found.above.x];
                // Simpson's rule has no error.
                let middle = at(0.5).1 - 0.5 * (begin.1 + end.1);
                prop_assert!((found.mean.x - middle * 4.0 / 6.0).abs() < 1e-9);
            }
            for k in 1..40 {
                let share = f64::from(k) / 40.0;
                let line = begin.1 + share * (end.1 - begin.1);
                let off = at(share).1 - line;
                prop_assert!((-bounds[0] - 1e-9..=bounds[1] + 1e-9).contains(&off), "{} {:?}", off, bounds);
            }
        }

        /// Derivatives of the mean deviation are its finite differences: it is linear in the values, and the ends of a
        /// segment may be moved.
        #[test]
        fn derivatives_of_the_mean_are_differences(
            values in prop::collection::vec(-1.0..1.0_f64, BRICK), at in prop::array::uniform3(0.0..1.0_f64),
            from in prop::array::uniform3(0.0..1.0_f64), factor in -2.0..2.0_f64,
        ) {
            let along = |from: [f64; 3], at: [f64; 3]| {
                let four = at.map(DVec4::splat);
                Cubic::<f64>::new(four, [0, 1, 2].map(|a| DVec4::splat(at[a] - from[a])))
            };
            let corners = node(0, at, 1.0, [0.0; 2]).corners(&values);
            let cubic = along(from, at);
            let by = cubic.by_corners(DVec4::splat(factor));
            let sum: f64 = by.iter().flatten().zip(corners.iter().flatten()).map(|(by, corner)| by.x * corner.x).sum();
            let mean = |from, at| along(from, at).deviation(&corners).x;
            prop_assert!((sum - factor * mean(from, at)).abs() < 1e-12);
            let [by_first, by_second] = cubic.by_ends(&corners);
            for a in 0..3 {
                let moved = |p: [f64; 3], by: f64| std::array::from_fn(|b| p[b] + if b == a { by } else { 0.0 });
                let first = (mean(moved(from, 1e-5), at) - mean(moved(from, -1e-5), at)) / 2e-5;
                let second = (mean(from, moved(at, 1e-5)) - mean(from, moved(at, -1e-5))) / 2e-5;
                prop_assert!((by_first[a].x - first).abs() < 1e-8, "{} {}", by_first[a].x, first);
                prop_assert!((by_second[a].x - second).abs() < 1e-8, "{} {}", by_second[a].x, second);
            }
        }
    }
}
