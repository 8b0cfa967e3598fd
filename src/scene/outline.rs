//! Points around what is to be seen of a field.
//!
//! A field may hold millions of voxels, and cameras are placed around few points: those that lie farthest out in
//! directions all around. What lies between them and the field's true convex hull is less than a pixel of a picture.

use crate::math::Aabb;
use crate::real::Real;
use crate::scene::bricks::{BRICK, Bricks, EDGE, NONE};
use crate::scene::orbit::{Layout, direction};
use glam::{DVec3, IVec3};
use rayon::prelude::*;

/// Number of places above which those of a large instanced field are taken together, row by row.
const MANY: usize = 1 << 17;
/// Directions in which points are looked for: fewer for many bricks.
const DIRECTIONS: std::ops::RangeInclusive<usize> = 300..=2048;
/// Bounds of bricks that are compared for all directions together.
const COMPARED: usize = 200_000_000;

/// Bricks that have the same values and follow one another along z.
struct Run {
    /// Index-space box of the cells that visible voxels reach into.
    bounds: Aabb,
    /// Number of the bricks' values.
    number: u32,
    /// Index coordinates of the first voxel of the first and of the last brick.
    ends: [DVec3; 2],
}

impl<R: Real> Bricks<R> {
    /// World-space points around the voxels that differ from the background and the cells they reach into. Empty for
    /// an empty field.
    pub fn outline(&self) -> Vec<DVec3> {
        self.outline_of(|value| value != self.background)
    }

    /// World-space points around the voxels with a visible stored value and the cells they reach into; empty if there
    /// are none.
    pub fn outline_of(&self, visible: impl Fn(R) -> bool + Sync) -> Vec<DVec3> {
        let runs = self.runs(&visible);
        if runs.is_empty() {
            return Vec::new();
        }
        let count = (COMPARED / runs.len()).clamp(*DIRECTIONS.start(), *DIRECTIONS.end());
        let axes = DVec3::AXES.into_iter().flat_map(|axis| [axis, -axis]);
        let directions: Vec<DVec3> = axes.chain((0..count).map(|i| direction(i, count, Layout::Sphere))).collect();
        let farthest = |direction: &DVec3| self.transform.to_world(self.farthest(&runs, *direction, &visible));
        let mut points: Vec<DVec3> = directions.par_iter().map(farthest).collect();
        points.dedup();
        points
    }

    fn runs(&self, visible: &(impl Fn(R) -> bool + Sync)) -> Vec<Run> {
        let local = |stored: &[R]| {
            let shown = (0..BRICK).filter(|i| visible(stored[*i]));
            shown.fold(Aabb::EMPTY, |bounds, i| bounds.including(place(i)))
        };
        let boxes: Vec<Aabb> = self.values.par_chunks(BRICK).map(local).collect();
        let run = |number: u32, first: IVec3, last: IVec3| {
            let (own, ends) = (boxes[number as usize], [first, last].map(|brick| 8.0 * brick.as_dvec3()));
            let bounds = Aabb { min: own.min + ends[0] - 1.0, max: own.max + ends[1] + 1.0 };
            (!own.is_empty()).then_some(Run { bounds, number, ends })
        };
        let topology = &self.topology;
        if !topology.is_instanced() || topology.places().nth(MANY).is_none() {
            return topology.places().filter_map(|(brick, number)| run(number, brick, brick)).collect();
        }
        let mut runs = Vec::new();
        for (start, numbers) in topology.rows() {
            let mut z = 0;
            for equal in numbers.chunk_by(|a, b| a == b) {
                let [first, last] = [z, z + equal.len() as i32 - 1].map(|z| start + IVec3::new(0, 0, z));
                runs.extend((equal[0] != NONE).then(|| run(equal[0], first, last)).flatten());
                z += equal.len() as i32;
            }
        }
        runs
    }

    /// The point of all visible voxels' cells that lies farthest in a direction, in index space.
    fn farthest(&self, runs: &[Run], direction: DVec3, visible: &impl Fn(R) -> bool) -> DVec3 {
        let reach = |run: &Run| {
            let Aabb { min, max } = run.bounds;
            (min * direction).max(max * direction).element_sum()
        };
        let exact = |run: &Run| {
            let stored = &self.values[run.number as usize * BRICK..][..BRICK];
            let from = if direction.z > 0.0 { run.ends[1] } else { run.ends[0] };
            let shown = (0..BRICK).filter(|i| visible(stored[*i])).map(place);
            let farthest = shown.max_by(|a, b| a.dot(direction).total_cmp(&b.dot(direction)));
            let point = from + farthest.unwrap_or_default() + direction.signum();
            (point.dot(direction), point)
        };
        let Some(first) = runs.iter().max_by(|a, b| reach(a).total_cmp(&reach(b))) else { return DVec3::ZERO };
        let farther = |best: (f64, DVec3), run: &Run| {
            if reach(run) <= best.0 {
                return best;
            }
            let own = exact(run);
            if own.0 > best.0 { own } else { best }
        };
        runs.iter().fold(exact(first), farther).1
    }
}

/// Index coordinates of a stored voxel from the first voxel of its brick.
#[inline]
fn place(i: usize) -> DVec3 {
    DVec3::from_array([i / EDGE / EDGE, i / EDGE % EDGE, i % EDGE].map(|v| v as f64))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use crate::math::Affine;
    use crate::scene::bricks::Topology;
    use std::sync::Arc;

    /// A ball of voxels over several bricks, in part negative: each point lies on the surface of the cells around it,
    /// and no voxel's cells lie far outside of the planes through the points.
    #[test]
    fn points_lie_around_the_voxels_that_differ_from_the_background() {
        let bricks = (0..4 * 4 * 5).map(|i| IVec3::new(i % 4 - 2, i / 4 % 4 - 2, i / 16 - 2));
        let topology = Arc::new(Topology::new(bricks).unwrap());
        let mut field: Bricks<f32> = Bricks::zeros(topology.clone(), Affine::uniform(0.5, DVec3::ZERO).unwrap());
        field.background = -1000.0;
        let voxels: Vec<DVec3> = topology
            .bricks()
            .iter()
            .flat_map(|brick| (0..512).map(move |i| (8 * *brick + IVec3::new(i >> 6, i >> 3 & 7, i & 7)).as_dvec3()))
            .collect();
        let inside = |voxel: &DVec3| voxel.distance(DVec3::new(1.0, -2.0, 0.5)) < 10.0;
        let value = |voxel: &DVec3| match inside(voxel) {
            true if voxel.x > 0.0 => -999.0,
            true => -1001.0,
            false => -1000.0,
        };
        topology.fill_apron(&voxels.iter().map(value).collect::<Vec<f32>>(), &mut field.values);
        // What lies outside of the box is no brick.
        field.values.iter_mut().filter(|value| **value == 0.0).for_each(|value| *value = -1000.0);
        let points = field.outline();
        let reach = |direction: DVec3, points: &mut dyn Iterator<Item = DVec3>| {
            points.map(|point| point.dot(direction)).fold(f64::NEG_INFINITY, f64::max)
        };
        for i in 0..100 {
            let direction = direction(i, 100, Layout::Sphere);
            let own = reach(direction, &mut points.iter().copied());
            let corners = direction.abs().element_sum();
            let true_reach = 0.5 * (reach(direction, &mut voxels.iter().copied().filter(inside)) + corners);
            assert!(own <= true_reach + 1e-9 && own > true_reach - 0.05, "{own} {true_reach}");
        }
        field.values.fill(-1000.0);
        assert!(field.outline().is_empty());
    }
}
