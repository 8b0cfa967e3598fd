//! Bounds of the error in light and transmittance that nodes too far apart cause: the density is not linear between
//! them, nor the color in the optical depth.
//!
//! Between two nodes at a distance h the density along the ray differs from the line through them by at most
//!
//! ```text
//! e = m (u_x u_y + u_y u_z + u_z u_x) h² / 4  +  a ((u_x + u_y + u_z) h / 4 + h² / 8)
//! ```
//! with u the magnitudes of the ray's direction, m the largest mixed second difference of the voxels, which bounds the
//! curvature within a cell, and a the largest second difference along an axis, which bounds the change of slope from
//! cell to cell. Between nodes of one cell the density is a cubic, whose second derivative is linear in the length: its
//! larger magnitude at the two nodes, times h² / 8, is e, and where both have the same sign, the density lies on one
//! side of the line. [`Variation`](super::variation::Variation) turns e into bounds of the errors of a segment's
//! optical depth and color.
//!
//! If segments are exchanged one after the other, from the far end, for exact ones, each changes the pixel by at most
//! its own error times the transmittance in front of it: the sum over the segments bounds the error of the pixel, in
//! units of the brightest radiance of medium and background.

use super::batch::{ROOM, SegmentBatch};
use super::nodes::{ONE_CELL, Queue};
use super::table::Cumulative;
use super::variation::Variation;
use crate::real::{LANES, Lanes, Real};
use crate::render::cell::corners;
use glam::DVec3;

/// Share of the tolerance that segments may use in proportion to the light that they absorb; segments that absorb next
/// to nothing, as in front of and beside a surface, have the rest.
const BY_ABSORPTION: f64 = 0.6;
/// Share of what is left of that rest that one segment may use.
const OF_REST: f64 = 1.0 / 16.0;
/// Share of what a segment may use by its absorption up to which its error is bounded in the simplest way.
const SIMPLE: f64 = 0.25;
/// The most parts that a segment is divided into at a time.
pub(super) const MOST_PARTS: usize = 16;
/// How often a segment is divided before its error is accepted as it is.
const MOST_LEVELS: u8 = 3;

/// How far the density may lie below and above the line between two nodes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Deviation<R> {
    below: R,
    above: R,
}

impl<R: Real> Deviation<R> {
    /// Returns the distance between the two bounds.
    #[inline(always)]
    fn width(self) -> R {
        self.below + self.above
    }

    /// Returns the larger distance from the line.
    #[inline(always)]
    fn largest(self) -> R {
        self.below.greater(self.above)
    }
}

/// Distances along a ray, as far as they determine the density's deviation from a line between nodes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Deviations<R> {
    /// Index coordinates gained per world length.
    direction: [R; 3],
    /// Voxels per world length.
    voxels: R,
    /// A quarter of the products of the direction's components per voxel, of y and z, z and x, x and y; and the sum of
    /// their magnitudes, the factor of `m h²` in this module's header.
    products: [R; 3],
    mixed: R,
    /// Factors of `a h` and `a h²`.
    axis: [R; 2],
}

impl<R: Real> Deviations<R> {
    /// Creates the numbers of a ray, from its index coordinates gained per world length.
    pub fn new(direction: DVec3) -> Self {
        let voxels = direction.length();
        let u = direction / voxels;
        let products = [u.y * u.z, u.z * u.x, u.x * u.y].map(|p| 0.25 * p);
        let mixed = R::of(products.iter().map(|p| p.abs()).sum());
        let axis = [R::of(0.25 * u.abs().element_sum()), R::of(0.125)];
        let direction = direction.to_array().map(R::of);
        Self { direction, voxels: R::of(voxels), products: products.map(R::of), mixed, axis }
    }

    /// Returns a bound for the least favorable direction, at a distance of nodes in voxels.
    pub fn bound([axis, mixed]: [f64; 2], h: f64) -> f64 {
        0.25 * mixed * h * h + axis * (0.25 * 3.0_f64.sqrt() * h + 0.125 * h * h)
    }

    /// Returns bounds between nodes of one cell at a world length from one another, the second of them at these
    /// cell-local coordinates.
    #[inline(always)]
    fn in_cell(&self, length: R, values: &[R], (offset, at): (u32, [R; 3])) -> Deviation<R> {
        let [near, far] = corners(values, offset as usize).map(Lanes::store);
        // Mixed differences on the lower faces of the cell, and the difference from these to the upper ones, of which
        // there is only one.
        let across = |v: [R; LANES]| v[0] - v[1] - v[2] + v[3];
        let [yz, twist] = [across(near), across(far) - across(near)];
        let [zx, xy] = [1, 2].map(|b| (far[b] - far[0]) - (near[b] - near[0]));
        let [p, q, r] = self.products;
        let second = |[x, y, z]: [R; 3]| p * (yz + x * twist) + q * (zx + y * twist) + r * (xy + z * twist);
        let before = [0, 1, 2].map(|a| at[a] - length * self.direction[a]);
        let h = length * self.voxels;
        let [begin, end] = [before, at].map(|at| h * h * second(at));
        // Where the second derivative is positive the density lies below the line.
        let side = |a: R, b: R| a.greater(b).greater(R::ZERO);
        Deviation { below: side(begin, end), above: side(-begin, -end) }
    }

    /// Returns bounds between nodes at a world length from one another; `roughness` holds the largest second
    /// differences along an axis and mixed.
    #[inline(always)]
    fn between(&self, length: R, [axis, mixed]: [R; 2]) -> Deviation<R> {
        let h = length * self.voxels;
        let deviation = h * (self.mixed * h * mixed + axis * (self.axis[0] + h * self.axis[1]));
        Deviation { below: deviation, above: deviation }
    }
}

/// The error that a ray's nodes may cause, and what of it is used up.
#[derive(Debug, Clone, Copy)]
pub(super) struct Budget<R> {
    deviations: Deviations<R>,
    /// Offset of the cell of the last node.
    last: u32,
    /// Bound of the error so far, in units of the brightest radiance.
    pub used: f64,
    /// Part of it in segments that absorb too little for it.
    rest: f64,
}

impl<R: Real> Budget<R> {
    pub fn new(direction: DVec3) -> Self {
        Self { deviations: Deviations::new(direction), last: u32::MAX, used: 0.0, rest: 0.0 }
    }

    /// Charges the segments of a batch, the first of which has `transmittance` in front of it. If some need nodes in
    /// between, nothing is charged, their numbers of parts are left in `parts`, and the result is false; segments that
    /// were divided `level` times before may be too many to be divided again.
    #[inline(always)]
    pub fn charge(
        &mut self,
        values: &[R],
        (batch, queue): (&SegmentBatch<R>, &Queue<R>),
        (tables, transmittance): (&Cumulative<R>, R),
        parts: &mut [u8; ROOM],
    ) -> bool {
        let count = batch.count.min(ROOM);
        let tolerance = tables.tolerance;
        let (mut before, mut last) = (transmittance, self.last);
        let (mut used, mut rest, mut whole) = (self.used, self.rest, true);
        for (i, (offset, at, roughness)) in queue.cells(count).enumerate() {
            let in_one_cell = offset == last || roughness[0] == R::of(ONE_CELL);
            last = offset;
            let length = batch.length[i];
            let deviation = match in_one_cell {
                true => self.deviations.in_cell(length, values, (offset, at)),
                false => self.deviations.between(length, roughness),
            };
            let through = batch.transmittance[i];
            let by_absorption = BY_ABSORPTION * tolerance * (before * (R::ONE - through)).f64();
            let simple = before * batch.simple_error(i, &tables.variation, deviation);
            let error = match simple.f64() <= SIMPLE * by_absorption {
                true => simple.f64(),
                false => (before * batch.deviation_error(i, tables, deviation)).f64(),
            };
            before = before * through;
            parts[i] = 1;
            if error > by_absorption {
                let allowed = (OF_REST * ((1.0 - BY_ABSORPTION) * tolerance - rest)).max(by_absorption);
                rest += error.min(allowed);
                if error > allowed && queue.level < MOST_LEVELS {
                    // The error falls with the square of the number of parts.
                    let wanted = 1.1 * (error / allowed.max(f64::MIN_POSITIVE)).sqrt();
                    parts[i] = (wanted as usize + 1).clamp(2, MOST_PARTS) as u8;
                    whole = false;
                }
            }
            used += error;
        }
        if whole {
            *self = Self { last, used, rest, ..*self };
        }
        whole
    }
}

impl<R: Real> SegmentBatch<R> {
    /// Returns a bound of the same error as [`SegmentBatch::deviation_error`] from the function's steepest slopes alone.
    #[inline(always)]
    fn simple_error(&self, i: usize, variation: &Variation<R>, deviation: Deviation<R>) -> R {
        let (width, depth) = (self.density[i + 1] - self.density[i], self.depth[i]);
        let reach = width.greater(-width) + deviation.width();
        let error = self.length[i] * deviation.largest() * variation.steepest;
        let mixed = R::of(0.25) * depth * depth * reach * variation.steepest_color;
        if error <= R::of(0.5) { error + mixed } else { R::of(f64::MAX) }
    }

    /// Returns a bound of the change of the light that arrives at a segment's beginning, in units of the brightest
    /// radiance, from a density between its ends that is off by at most `deviation`, and from a color that is taken as
    /// linear in the optical depth.
    #[inline(always)]
    fn deviation_error(&self, i: usize, tables: &Cumulative<R>, deviation: Deviation<R>) -> R {
        if self.length[i] <= R::ZERO {
            return R::ZERO;
        }
        let (a, b) = (self.density[i], self.density[i + 1]);
        let (low, high) = (a.lesser(b), a.greater(b));
        let width = deviation.width();
        let share = if width > R::ZERO { width / width.greater(high - low) } else { R::ZERO };
        let [depth, shift, color, _] = tables.variation.between(low - deviation.below, high + deviation.above).store();
        let through = self.transmittance[i];
        // Of optical depths x and y, `|e^-x - e^-y| ≤ e^-x (e^|x - y| - 1)`; the series is an upper bound up to 3.
        let off = self.length[i] * depth * share;
        let half = R::of(0.5) * off;
        let growth = off * (R::ONE + half * (R::ONE + R::of(4.0 / 3.0) * off));
        let lost = if off < R::of(3.0) { (through * growth).lesser(R::ONE) } else { R::ONE };
        if tables.per_brightest == R::ZERO {
            return lost;
        }
        let absorbed = (R::ONE - through + through * off).lesser(R::ONE);
        let moved = self.length[i] * shift * share + off.lesser(R::ONE) * color;
        // A color that differs from one linear in the optical depth by at most its variation, on average by nothing.
        let mixed = match self.piece[i] == self.piece[i + 1] {
            true => self.color_error(i) * tables.per_brightest,
            false => absorbed * color * (R::of(0.25) * self.depth[i]).lesser(R::ONE),
        };
        lost + moved.lesser(absorbed * color) + mixed
    }
}

#[cfg(test)]
mod tests {
    use super::super::nodes::roughness;
    use super::*;
    use crate::render::cell::{corners, gather, placed, weights};
    use crate::scene::bricks::BRICK;
    use proptest::prelude::*;

    proptest! {
        /// The bound holds for rough and for smooth bricks, from node to node across cells and within one.
        #[test]
        fn densities_deviate_by_no_more_than_the_bound(
            noise in prop::collection::vec(-1.0..1.0_f64, BRICK), rough in 0.0..1.0_f64,
            wave in prop::array::uniform3(-0.9..0.9_f64),
            from in prop::array::uniform3(0.0..8.0_f64), to in prop::array::uniform3(0.0..8.0_f64), short in 0.05..1.0_f64,
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
            let (deviations, length) = (Deviations::new(2.0 * direction), 0.5 * (to - from).length());
            let mut bound = deviations.between(length, roughness);
            let most = Deviations::<f64>::bound(roughness, (to - from).length());
            prop_assert!(bound.largest() <= most + 1e-12);
            if begin.0 == end.0 {
                let in_cell = deviations.in_cell(length, &values, (end.0, end.2));
                prop_assert!(in_cell.largest() <= bound.largest() + 1e-12);
                bound = in_cell;
            }
            for k in 1..40 {
                let share = f64::from(k) / 40.0;
                let line = begin.1 + share * (end.1 - begin.1);
                let off = at(share).1 - line;
                prop_assert!((-bound.below - 1e-9..=bound.above + 1e-9).contains(&off), "{} {:?}", off, bound);
            }
        }
    }
}
