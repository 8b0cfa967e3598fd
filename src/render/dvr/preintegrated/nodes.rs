//! Nodes at which the density is sampled: the faces of bricks, and points that divide the segment in a brick evenly.
//! Between two nodes the density is linear in the length.

use super::batch::WIDE;
use crate::real::Real;
use crate::real::{LANES, Lanes};
use crate::render::cell::{corners, placed, scatter};
use crate::render::march::{IndexRay, Span, spans};
use crate::render::segment::slopes;
use crate::scene::bricks::{BRICK, CELLS, EDGE, Topology, slot};

/// Four nodes of a batch.
#[derive(Debug, Clone, Copy)]
pub(super) struct Nodes<R: Real> {
    /// Offsets of the nodes' cells among the field's values.
    pub offset: [u32; LANES],
    /// Coordinates of the nodes in their cells, each from 0 to 1.
    pub at: [R::Lanes; 3],
    /// World lengths of the segments that end at the nodes.
    pub length: R::Lanes,
}

impl<R: Real> Nodes<R> {
    /// Returns the densities at the nodes.
    #[inline(always)]
    pub fn densities(&self, values: &[R]) -> R::Lanes {
        let [x, y, z] = self.at;
        let along = x.store();
        let column = |i: usize| {
            let [near, far] = corners(values, self.offset[i] as usize);
            near + R::Lanes::splat(along[i]) * (far - near)
        };
        let [a, b, c, d] = R::Lanes::transpose([column(0), column(1), column(2), column(3)]);
        let (low, high) = (a + z * (b - a), c + z * (d - c));
        low + y * (high - low)
    }

    /// Returns the derivatives of the densities with respect to index coordinates.
    pub fn slopes(&self, values: &[R]) -> [R::Lanes; 3] {
        let [x, y, z] = self.at;
        let faces = self.offset.map(|offset| corners(values, offset as usize));
        let [near, far] = [0, 1].map(|side| R::Lanes::transpose(faces.map(|face| face[side])));
        slopes([near, far], [x, y, z])
    }

    /// Adds the derivatives with respect to voxels, from those with respect to densities: the transpose of
    /// [`Nodes::densities`].
    #[inline(always)]
    pub fn scatter(&self, values: &mut [R], by_density: R::Lanes) {
        let [x, y, z] = self.at;
        let high = by_density * y;
        let low = by_density - high;
        let (b, d) = (low * z, high * z);
        let columns = R::Lanes::transpose([low - b, b, high - d, d]);
        let (along, some) = (x.store(), by_density.store());
        for i in 0..LANES {
            if some[i] != R::ZERO {
                let far = columns[i] * R::Lanes::splat(along[i]);
                scatter(values, self.offset[i] as usize, R::ONE, &[columns[i] - far, far]);
            }
        }
    }
}

/// The most parts that a ray's segment in a brick is divided into.
const MOST_PARTS: usize = 32;
/// Least number of nodes that are visited together while there are more: the nodes of one group of four depend on each
/// other's latency, groups do not.
const ENOUGH: usize = 32;
/// Capacity of a queue in nodes: nearly a visit, a gap's node, a brick's nodes, and padding that is written past them.
const ROOM: usize = (ENOUGH + 1 + MOST_PARTS + LANES).next_multiple_of(WIDE);
/// The most groups of four nodes that are visited together.
pub(super) const FOURS: usize = ROOM / LANES;

/// Nodes that are not yet visited.
#[derive(Debug, Clone)]
pub(super) struct Queue<R: Real> {
    /// Offsets of the nodes' bricks; once they are placed, of their cells.
    offset: [u32; ROOM],
    /// Coordinates of the nodes in their bricks; once they are placed, in their cells.
    at: [[R; ROOM]; 3],
    length: [R; ROOM],
    count: usize,
}

impl<R: Real> Default for Queue<R> {
    fn default() -> Self {
        Self { offset: [0; ROOM], at: [[R::ZERO; ROOM]; 3], length: [R::ZERO; ROOM], count: 0 }
    }
}

impl<R: Real> Queue<R> {
    /// Appends nodes at these lengths from the span's entry; all four are written, the first `count` count.
    #[inline(always)]
    fn push(&mut self, span: &Span<R>, t: R::Lanes, length: R, count: usize) {
        let all = <R::Lanes as Lanes<R>>::splat;
        let n = self.count.min(ROOM - LANES);
        self.offset[n..n + LANES].copy_from_slice(&[span.base as u32; LANES]);
        for a in 0..3 {
            let at = all(span.entry[a]) + t * all(span.direction[a]);
            self.at[a][n..n + LANES].copy_from_slice(&at.store());
        }
        self.length[n..n + LANES].copy_from_slice(&[length; LANES]);
        self.count += count;
    }

    /// Replaces brick by cell offsets and coordinates, for the first `fours` groups of four nodes.
    #[inline(always)]
    fn place(&mut self, fours: usize) {
        let [x, y, z] = &mut self.at;
        for i in 0..(fours * LANES).min(ROOM) {
            let (offset, at) = placed([x[i], y[i], z[i]]);
            self.offset[i] += offset;
            [x[i], y[i], z[i]] = at;
        }
    }

    /// Returns the first `fours` groups of four nodes.
    #[inline(always)]
    pub fn first(&self, fours: usize) -> impl DoubleEndedIterator<Item = Nodes<R>> {
        fn some<T>(all: &[T; ROOM], fours: usize) -> &[[T; LANES]] {
            &all.as_chunks().0[..fours.min(FOURS)]
        }
        let [x, y, z] = self.at.each_ref().map(|at| some(at, fours));
        let (offset, length) = (some(&self.offset, fours), some(&self.length, fours));
        let all = offset.iter().zip(x).zip(y).zip(z).zip(length);
        all.map(
            #[inline(always)]
            |((((offset, x), y), z), length)| Nodes {
                offset: *offset,
                at: [x, y, z].map(|at| R::Lanes::load(*at)),
                length: R::Lanes::load(*length),
            },
        )
    }

    /// Copies the nodes of `other` that come after its first `fours` groups, which were visited, so that `other` can be
    /// kept and this queue used in its place.
    #[inline(always)]
    pub fn succeed(&mut self, other: &Self, fours: usize) {
        let n = (fours * LANES).min(ROOM - WIDE);
        self.offset[n..n + WIDE].copy_from_slice(&other.offset[n..n + WIDE]);
        self.length[n..n + WIDE].copy_from_slice(&other.length[n..n + WIDE]);
        for (own, at) in self.at.iter_mut().zip(&other.at) {
            own[n..n + WIDE].copy_from_slice(&at[n..n + WIDE]);
        }
        self.count = other.count;
    }

    /// Removes the first `fours` groups of four nodes.
    #[inline(always)]
    fn drop_front(&mut self, fours: usize) {
        let n = (fours * LANES).min(ROOM - WIDE);
        self.offset.copy_within(n..n + WIDE, 0);
        self.length.copy_within(n..n + WIDE, 0);
        self.at.iter_mut().for_each(|at| at.copy_within(n..n + WIDE, 0));
        self.count -= n;
    }
}

/// Bricks in which rays have nodes, and the spacing of nodes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sites<'a, R> {
    /// Bricks that rays visit.
    pub topology: &'a Topology,
    /// Nodes per voxel, by brick: reciprocals of the largest distances between nodes.
    pub density: &'a [R],
    /// True if the gaps between bricks count as segments of density zero.
    pub gaps: bool,
}

/// Returns the number of parts that a ray's segment in a brick is divided into; `voxels` is the ray's length in voxels
/// per unit of world length.
#[inline(always)]
pub(super) fn parts<R: Real>(span: &Span<R>, voxels: R, density: &[R]) -> usize {
    let (most, half) = (R::int(MOST_PARTS as i32 - 1), R::of(0.5));
    // Adding rounds to the nearest whole number: up, half of one higher.
    let parts = (span.length * voxels * density[span.base / BRICK]).lesser(most) + half;
    (parts + R::ONES).low_bits().clamp(1, MOST_PARTS as u32) as usize
}

/// Visits the nodes along a ray, near to far, `fours` groups of four at a time; `visit` returns false to stop, and may
/// put another queue that [succeeds](Queue::succeed) this one in its place. Where bricks are missing the next node's
/// segment has no length, unless gaps count. Padding repeats the last node with no length. Returns the world length
/// from the last brick to the ray's exit.
#[inline(always)]
pub(super) fn nodes<R: Real>(
    sites: Sites<'_, R>,
    ray: &IndexRay,
    queue: &mut Box<Queue<R>>,
    mut visit: impl FnMut(&mut Box<Queue<R>>, usize) -> bool,
) -> f64 {
    queue.count = 0;
    let all = <R::Lanes as Lanes<R>>::splat;
    let voxels = R::of(ray.direction().length());
    let numbers = R::Lanes::load([R::ONE, R::of(2.0), R::of(3.0), R::of(4.0)]);
    let (mut reached, mut more) = (f64::NEG_INFINITY, true);
    spans(
        sites.topology,
        ray,
        false,
        #[inline(always)]
        |span| {
            if span.start != reached {
                let gap = if sites.gaps { R::of(span.start - reached.max(ray.enter)) } else { R::ZERO };
                queue.push(&span, R::Lanes::ZERO, gap, 1);
            }
            reached = span.end;
            let parts = parts(&span, voxels, sites.density);
            let length = span.length / R::int(parts as i32);
            let mut number = numbers;
            let mut left = parts;
            loop {
                queue.push(&span, number * all(length), length, left.min(LANES));
                if left <= LANES {
                    break;
                }
                left -= LANES;
                number += all(R::of(LANES as f64));
            }
            if queue.count >= ENOUGH {
                let fours = queue.count / WIDE * (WIDE / LANES);
                queue.place(fours);
                more = visit(queue, fours);
                queue.drop_front(fours);
            }
            more
        },
    );
    if more && queue.count > 0 {
        for n in queue.count..queue.count.next_multiple_of(WIDE) {
            queue.offset[n] = queue.offset[n - 1];
            queue.length[n] = R::ZERO;
            queue.at.iter_mut().for_each(|at| at[n] = at[n - 1]);
        }
        let fours = queue.count.next_multiple_of(WIDE) / LANES;
        queue.place(fours);
        more = visit(queue, fours);
    }
    if more { ray.leave - reached.max(ray.enter) } else { 0.0 }
}

/// Returns the largest magnitude of a second difference of a brick's values, along an axis or mixed over two.
pub(super) fn roughness<R: Real>(values: &[R]) -> R {
    let steps = [slot(1, 0, 0), slot(0, 1, 0), slot(0, 0, 1)];
    let mut most = R::ZERO;
    let mut note = |v: R| most = most.greater(v.greater(-v));
    for x in 0..EDGE {
        for y in 0..EDGE {
            for z in 0..EDGE {
                let i = slot(x, y, z);
                let at = [x, y, z];
                for a in 0..3 {
                    if at[a] == CELLS {
                        continue;
                    }
                    let (step, next) = (steps[a], values[i + steps[a]] - values[i]);
                    if at[a] > 0 {
                        note(next - (values[i] - values[i - step]));
                    }
                    let b = (a + 1) % 3;
                    if at[b] < CELLS {
                        note(values[i + step + steps[b]] - values[i + steps[b]] - next);
                    }
                }
            }
        }
    }
    most
}
