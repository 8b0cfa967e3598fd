//! Nodes at which the density is sampled: the faces of bricks and, where the density is smooth, points that divide the
//! interval in a brick evenly, else the faces of all cells; with further ones between two of them where the error would
//! be too large. Between two nodes the density is taken as linear in the length.

use crate::real::Real;
use crate::real::{LANES, Lanes};
use crate::render::cell::{corners, low, offsets, placed, scatter};
use crate::render::march::{IndexRay, Span, spans};
use crate::scene::bricks::{BRICK, CELLS, EDGE, Topology, slot};
use glam::DVec3;

/// Values at the corners of four cells: by x of the corner, by corner as in [`crate::render::cell`], in lanes by cell.
pub(super) type Corners<R> = [[<R as Real>::Lanes; LANES]; 2];

/// Four nodes of a batch.
#[derive(Debug, Clone, Copy)]
pub(super) struct Nodes<R: Real> {
    /// Offsets of the nodes' cells among the field's values.
    pub offset: [u32; LANES],
    /// Coordinates of the nodes in their cells, each from 0 to 1.
    pub at: [R::Lanes; 3],
    /// World lengths of the segments that end at the nodes.
    pub length: R::Lanes,
    /// Roughness of the segments, see [`Queue::roughness`].
    pub roughness: [R::Lanes; 2],
}

impl<R: Real> Nodes<R> {
    /// Returns the values at the corners of the nodes' cells.
    #[inline(always)]
    pub(crate) fn corners(&self, values: &[R]) -> Corners<R> {
        // No `map`: it is not always inlined.
        let [a, b, c, d] = self.offset;
        let ([e, f], [g, h]) = (corners(values, a as usize), corners(values, b as usize));
        let ([k, l], [m, n]) = (corners(values, c as usize), corners(values, d as usize));
        [R::Lanes::transpose([e, g, k, m]), R::Lanes::transpose([f, h, l, n])]
    }

    /// Returns the densities at the nodes, from the values at the corners of their cells.
    #[inline(always)]
    pub(crate) fn densities(&self, [near, far]: &Corners<R>) -> R::Lanes {
        let [x, y, z] = self.at;
        let along = |i: usize| near[i] + x * (far[i] - near[i]);
        let (a, b, c, d) = (along(0), along(1), along(2), along(3));
        let (low, high) = (a + z * (b - a), c + z * (d - c));
        low + y * (high - low)
    }

    /// Adds the derivatives with respect to voxels, from those with respect to densities and to the corners themselves:
    /// the transpose of [`Nodes::densities`] and of the corners' values.
    #[inline(always)]
    pub(crate) fn scatter(&self, values: &mut [R], by_density: R::Lanes, by_corners: &Corners<R>) {
        let [x, y, z] = self.at;
        let high = by_density * y;
        let low = by_density - high;
        let (b, d) = (low * z, high * z);
        let columns = [low - b, b, high - d, d];
        let far = columns.map(|column| x * column);
        let near = [0, 1, 2, 3].map(|i| columns[i] - far[i] + by_corners[0][i]);
        let far = [0, 1, 2, 3].map(|i| far[i] + by_corners[1][i]);
        let [near, far] = [near, far].map(R::Lanes::transpose);
        let some = by_corners.iter().flatten().fold(by_density.abs(), |sum, by| sum + by.abs()).store();
        for i in 0..LANES {
            if some[i] != R::ZERO {
                scatter(values, self.offset[i] as usize, R::ONE, &[near[i], far[i]]);
            }
        }
    }
}

/// The most parts that a ray's segment in a brick is divided into.
const MOST_PARTS: usize = 32;
/// Least number of nodes that are visited together while there are more: the nodes of one group of four depend on each
/// other's latency, groups do not.
const ENOUGH: usize = 32;
/// Divisor of the number of nodes that are visited together, the lanes of the widest vectors: no remainder is left for
/// slower loops.
pub(super) const WIDE: usize = 8;
/// Capacity of a queue in nodes, and of a batch in segments: nearly a visit, a gap's node, a brick's nodes, and padding
/// that is written past them.
pub(super) const ROOM: usize = (ENOUGH + 1 + MOST_PARTS + LANES).next_multiple_of(WIDE);
/// Mark of a segment in one cell, in [`Queue::roughness`].
pub(super) const ONE_CELL: f64 = -1.0;
/// Marks of nodes in [`Queue::share`].
pub(super) const CELL_END: f64 = 1.0;
pub(super) const BRICK_END: f64 = 2.0;
pub(super) const PADDING: f64 = -1.0;
/// The most nodes of divided segments that are visited together.
const CHUNK: usize = ROOM / WIDE * WIDE;
/// The most groups of four nodes that are visited together.
pub(super) const FOURS: usize = ROOM / LANES;

/// Nodes that are not yet visited.
#[derive(Debug, Clone)]
pub(super) struct Queue<R: Real> {
    /// Offsets of the nodes' cells.
    offset: [u32; ROOM],
    /// Coordinates of the nodes in their cells.
    at: [[R; ROOM]; 3],
    length: [R; ROOM],
    /// Largest second differences of the nodes' bricks, along an axis and mixed; the first is [`ONE_CELL`] for a
    /// segment in one cell.
    roughness: [[R; ROOM]; 2],
    /// Positions of the nodes in intervals (all of a brick, or a cell) that the ray enters at 0 and leaves at
    /// [`CELL_END`], or [`BRICK_END`] if it leaves the brick there; [`PADDING`] for padding.
    share: [R; ROOM],
    count: usize,
    /// How often the segments that end at the nodes were divided.
    pub level: u8,
}

impl<R: Real> Default for Queue<R> {
    fn default() -> Self {
        let zero = [R::ZERO; ROOM];
        Self { offset: [0; ROOM], at: [zero; 3], length: zero, roughness: [zero; 2], share: zero, count: 0, level: 0 }
    }
}

impl<R: Real> Queue<R> {
    /// Appends nodes at these lengths from the span's entry; all four are written, the first `count` count.
    #[inline(always)]
    fn push(&mut self, (span, roughness): (&Span<R>, [R; 2]), t: R::Lanes, share: R::Lanes, length: R, count: usize) {
        let all = <R::Lanes as Lanes<R>>::splat;
        let n = self.count.min(ROOM - LANES);
        let at = [0, 1, 2].map(|a| all(span.entry[a]) + t * all(span.direction[a]));
        let low = at.map(low);
        let base = span.base as u32;
        self.offset[n..n + LANES].copy_from_slice(&offsets(low).map(|offset| base + offset));
        for a in 0..3 {
            self.at[a][n..n + LANES].copy_from_slice(&(at[a] - low[a]).store());
        }
        self.length[n..n + LANES].copy_from_slice(&[length; LANES]);
        self.share[n..n + LANES].copy_from_slice(&share.store());
        for (own, roughness) in self.roughness.iter_mut().zip(roughness) {
            own[n..n + LANES].copy_from_slice(&[roughness; LANES]);
        }
        self.count += count;
    }

    /// Appends nodes where the ray leaves the cells of a brick.
    #[inline(always)]
    fn push_cells(&mut self, span: &Span<R>, mixed: R) {
        // Lengths to where the ray crosses the faces, ascending, from the entry on.
        let mut crossings = [R::ZERO; MOST_PARTS + 1];
        let never = R::of(f64::MAX);
        let axis = |a: usize| {
            let (entry, inverse) = (span.entry[a], span.inverse[a]);
            if !inverse.f64().is_finite() {
                return (never, R::ZERO);
            }
            let low = R::int((entry.f64() as usize).min(CELLS - 1) as i32);
            match span.direction[a] > R::ZERO {
                true => ((low + R::ONE - entry) * inverse, inverse),
                false => ((low - entry) * inverse, -inverse),
            }
        };
        let [(mut x, dx), (mut y, dy), (mut z, dz)] = [axis(0), axis(1), axis(2)];
        let (mut count, mut reached) = (1, R::ZERO);
        loop {
            let nearest = x.lesser(y).lesser(z);
            if nearest >= span.length || count >= MOST_PARTS {
                break;
            }
            crossings[count] = nearest;
            // Where it crosses several at once, the last of them counts.
            count += usize::from(nearest > reached);
            reached = nearest;
            x += if x <= nearest { dx } else { R::ZERO };
            y += if y <= nearest { dy } else { R::ZERO };
            z += if z <= nearest { dz } else { R::ZERO };
        }
        crossings[count] = span.length;
        let n = self.count.min(ROOM - MOST_PARTS);
        let end = n + count.next_multiple_of(WIDE);
        let [x, y, z] = &mut self.at;
        let places = self.offset[n..end].iter_mut().zip(&mut x[n..end]).zip(&mut y[n..end]).zip(&mut z[n..end]);
        let ends = crossings[..end - n].iter().zip(&crossings[1..=end - n]);
        for (((((offset, x), y), z), length), (before, here)) in places.zip(&mut self.length[n..end]).zip(ends) {
            let middle = R::of(0.5) * (*before + *here);
            let at = |t: R, a: usize| span.entry[a] + t * span.direction[a];
            let (cell, within) = placed([at(middle, 0), at(middle, 1), at(middle, 2)]);
            let half = *here - middle;
            let end = |a: usize| (within[a] + half * span.direction[a]).greater(R::ZERO).lesser(R::ONE);
            *offset = span.base as u32 + cell;
            (*x, *y, *z) = (end(0), end(1), end(2));
            *length = *here - *before;
        }
        self.share[n..end].fill(R::of(CELL_END));
        self.roughness[0][n..end].fill(R::of(ONE_CELL));
        self.roughness[1][n..end].fill(mixed);
        self.count += count;
        self.share[self.count - 1] = R::of(BRICK_END);
    }

    /// Appends nodes that divide the interval in a brick evenly.
    #[inline(always)]
    fn push_evenly(&mut self, span: &Span<R>, parts: usize, roughness: [R; 2]) {
        let all = <R::Lanes as Lanes<R>>::splat;
        let part = R::ONE / R::int(parts as i32);
        let length = span.length / R::int(parts as i32);
        let mut number = R::Lanes::load([R::ONE, R::of(2.0), R::of(3.0), R::of(4.0)]);
        let mut left = parts;
        loop {
            self.push((span, roughness), number * all(length), number * all(part), length, left.min(LANES));
            if left <= LANES {
                break;
            }
            left -= LANES;
            number += all(R::of(LANES as f64));
        }
        self.share[self.count - 1] = R::of(BRICK_END);
    }

    /// Repeats the last node, without a length, until the number of nodes is a multiple of [`WIDE`].
    #[inline(always)]
    fn pad(&mut self) {
        for n in self.count..self.count.next_multiple_of(WIDE) {
            self.offset[n] = self.offset[n - 1];
            self.length[n] = R::ZERO;
            self.share[n] = R::of(PADDING);
            self.at.iter_mut().for_each(|at| at[n] = at[n - 1]);
        }
        self.count = self.count.next_multiple_of(WIDE);
    }

    /// Returns the number of groups of four nodes.
    pub(crate) fn fours(&self) -> usize {
        self.count / LANES
    }

    /// Returns the positions of the first nodes, see [`Queue::share`].
    pub(crate) fn shares(&self, count: usize) -> &[R] {
        &self.share[..count.min(ROOM)]
    }

    /// Returns the first `fours` groups of four nodes.
    #[inline(always)]
    pub(crate) fn first(&self, fours: usize) -> impl DoubleEndedIterator<Item = Nodes<R>> {
        fn some<T>(all: &[T; ROOM], fours: usize) -> &[[T; LANES]] {
            &all.as_chunks().0[..fours.min(FOURS)]
        }
        let [x, y, z] = self.at.each_ref().map(|at| some(at, fours));
        let [axis, mixed] = self.roughness.each_ref().map(|roughness| some(roughness, fours));
        let (offset, length) = (some(&self.offset, fours), some(&self.length, fours));
        let all = offset.iter().zip(x).zip(y).zip(z).zip(length).zip(axis).zip(mixed);
        all.map(
            #[inline(always)]
            |((((((offset, x), y), z), length), axis), mixed)| Nodes {
                offset: *offset,
                at: [x, y, z].map(|at| R::Lanes::load(*at)),
                length: R::Lanes::load(*length),
                roughness: [axis, mixed].map(|roughness| R::Lanes::load(*roughness)),
            },
        )
    }

    /// Copies the nodes of `other` that come after its first `fours` groups, which were visited, so that `other` can be
    /// kept and this queue used in its place.
    #[inline(always)]
    pub(crate) fn succeed(&mut self, other: &Self, fours: usize) {
        let n = (fours * LANES).min(ROOM - WIDE);
        self.offset[n..n + WIDE].copy_from_slice(&other.offset[n..n + WIDE]);
        self.length[n..n + WIDE].copy_from_slice(&other.length[n..n + WIDE]);
        self.share[n..n + WIDE].copy_from_slice(&other.share[n..n + WIDE]);
        for (own, other) in self.at.iter_mut().zip(&other.at).chain(self.roughness.iter_mut().zip(&other.roughness)) {
            own[n..n + WIDE].copy_from_slice(&other[n..n + WIDE]);
        }
        self.count = other.count;
        self.level = other.level;
    }

    /// Removes the first `fours` groups of four nodes.
    #[inline(always)]
    fn drop_front(&mut self, fours: usize) {
        let n = (fours * LANES).min(ROOM - WIDE);
        self.offset.copy_within(n..n + WIDE, 0);
        self.length.copy_within(n..n + WIDE, 0);
        self.share.copy_within(n..n + WIDE, 0);
        self.at.iter_mut().chain(&mut self.roughness).for_each(|own| own.copy_within(n..n + WIDE, 0));
        self.count -= n;
    }
}

/// Nodes of divided segments, to be visited before those of the queue that they come from.
#[derive(Debug, Clone, Default)]
pub(super) struct Divided<R: Real> {
    /// The last one is the nearest.
    pending: Vec<Box<Queue<R>>>,
    spare: Vec<Box<Queue<R>>>,
}

impl<R: Real> Divided<R> {
    /// Returns the nearest nodes, which are placed.
    #[inline(always)]
    pub(crate) fn next(&mut self) -> Option<Box<Queue<R>>> {
        self.pending.pop()
    }

    /// Takes nodes back that were visited or divided.
    #[inline(always)]
    pub(crate) fn reuse(&mut self, queue: Box<Queue<R>>) {
        self.spare.push(queue);
    }

    /// Forgets all nodes.
    pub(crate) fn reset(&mut self) {
        self.spare.append(&mut self.pending);
    }

    /// Divides the segments that end at the first `fours` groups of four nodes, which are placed, into so many parts
    /// each. `direction` is the gain of index coordinates per world length, `before` the last node before them as
    /// [`Queue::share`] has it.
    #[inline(never)]
    pub(crate) fn divide(
        &mut self,
        queue: &Queue<R>,
        fours: usize,
        parts: &[u8; ROOM],
        (direction, mut before): (DVec3, R),
    ) {
        let direction = direction.to_array().map(R::of);
        let first = self.pending.len();
        let mut chunk = self.spare.pop().unwrap_or_default();
        let mut flush = |chunk: &mut Box<Queue<R>>| {
            chunk.pad();
            chunk.level = queue.level + 1;
            let next = self.spare.pop().unwrap_or_default();
            self.pending.push(std::mem::replace(chunk, next));
            chunk.count = 0;
        };
        chunk.count = 0;
        for j in (0..(fours * LANES).min(ROOM)).filter(|j| queue.share[*j] >= R::ZERO) {
            let (cell, share) = (queue.offset[j] as usize % BRICK, queue.share[j]);
            let corner = [cell / (EDGE * EDGE), cell / EDGE % EDGE, cell % EDGE].map(|c| R::int(c as i32));
            // The node before lies in the same interval, or where the ray enters this one.
            let begin = if before < share.lesser(R::of(CELL_END)) { before } else { R::ZERO };
            let width = share.lesser(R::of(CELL_END)) - begin;
            before = share;
            let in_one_cell = queue.roughness[0][j] == R::of(ONE_CELL);
            // A gap between bricks, which ends where the ray enters one, has the background all along.
            let count = if share > R::ZERO { i32::from(parts[j]) } else { 1 };
            let part = R::ONE / R::int(count);
            for k in 1..=count {
                let n = chunk.count;
                let back = queue.length[j] * (R::int(count - k) * part);
                let at: [R; 3] = std::array::from_fn(|a| queue.at[a][j] - back * direction[a]);
                let (offset, at) = match in_one_cell {
                    true => (cell as u32, at.map(|at| at.greater(R::ZERO).lesser(R::ONE))),
                    false => placed(std::array::from_fn(|a| corner[a] + at[a])),
                };
                chunk.offset[n] = queue.offset[j] - cell as u32 + offset;
                (0..3).for_each(|a| chunk.at[a][n] = at[a]);
                chunk.length[n] = queue.length[j] * part;
                chunk.share[n] = if k == count { share } else { begin + width * (R::int(k) * part) };
                for (own, roughness) in chunk.roughness.iter_mut().zip(&queue.roughness) {
                    own[n] = roughness[j];
                }
                chunk.count += 1;
                if chunk.count == CHUNK {
                    flush(&mut chunk);
                }
            }
        }
        if chunk.count > 0 {
            flush(&mut chunk);
        }
        self.spare.push(chunk);
        self.pending[first..].reverse();
    }
}

/// Spacing of nodes in a brick.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spacing<R> {
    /// Nodes per voxel: the reciprocal of the largest distance between nodes; 0 for nodes on the faces of cells.
    pub density: R,
    /// Largest second differences of the voxels, along an axis and mixed.
    pub roughness: [R; 2],
}

/// Bricks in which rays have nodes, and the spacing of nodes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sites<'a, R> {
    /// Bricks that rays visit.
    pub topology: &'a Topology,
    /// Spacing of nodes, by brick.
    pub spacing: &'a [Spacing<R>],
    /// True if the gaps between bricks count as segments of density zero.
    pub gaps: bool,
}

/// Returns the number of parts that a ray's segment in a brick is divided into; `voxels` is the ray's length in voxels
/// per unit of world length.
#[inline(always)]
fn parts<R: Real>(span: &Span<R>, voxels: R, spacing: &Spacing<R>) -> usize {
    let (most, half) = (R::int(MOST_PARTS as i32 - 1), R::of(0.5));
    // Adding rounds to the nearest whole number: up, half of one higher.
    let parts = (span.length * voxels * spacing.density).lesser(most) + half;
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
    (queue.count, queue.level) = (0, 0);
    let voxels = R::of(ray.direction().length());
    let (mut reached, mut more) = (f64::NEG_INFINITY, true);
    spans(
        sites.topology,
        ray,
        false,
        #[inline(always)]
        |span| {
            if span.start != reached {
                let gap = if sites.gaps { R::of(span.start - reached.max(ray.enter)) } else { R::ZERO };
                // Between missing bricks the density is zero: nothing deviates from it.
                queue.push((&span, [R::ZERO; 2]), R::Lanes::ZERO, R::Lanes::ZERO, gap, 1);
            }
            reached = span.end;
            let spacing = &sites.spacing[span.base / BRICK];
            if spacing.density == R::ZERO {
                queue.push_cells(&span, spacing.roughness[1]);
            } else {
                queue.push_evenly(&span, parts(&span, voxels, spacing), spacing.roughness);
            }
            if queue.count >= ENOUGH {
                let fours = queue.count / WIDE * (WIDE / LANES);
                more = visit(queue, fours);
                queue.drop_front(fours);
            }
            more
        },
    );
    if more && queue.count > 0 {
        queue.pad();
        let fours = queue.count / LANES;
        more = visit(queue, fours);
    }
    if more { ray.leave - reached.max(ray.enter) } else { 0.0 }
}

/// Returns the largest magnitudes of second differences of a brick's values, along an axis and mixed over two.
pub(super) fn roughness<R: Real>(values: &[R]) -> [R; 2] {
    // Row by row along z, four entries side by side; those of a row's end overlap with others.
    let row = |x: usize, y: usize| -> &[R] { &values[slot(x, y, 0)..][..EDGE] };
    let four = |row: &[R], z: usize| R::Lanes::load([row[z], row[z + 1], row[z + 2], row[z + 3]]);
    let mut most = [R::Lanes::ZERO; 2];
    let mut note = |kind: usize, v: R::Lanes| most[kind] = most[kind].greater(v.abs());
    for x in 0..EDGE {
        for y in 0..EDGE {
            let here = row(x, y);
            for z in [1, CELLS - 4] {
                note(0, (four(here, z + 1) - four(here, z)) - (four(here, z) - four(here, z - 1)));
            }
            let inner = (1..CELLS).contains(&x).then(|| [row(x + 1, y), row(x - 1, y)]);
            for [above, below] in
                inner.into_iter().chain((1..CELLS).contains(&y).then(|| [row(x, y + 1), row(x, y - 1)]))
            {
                for z in [0, 4, EDGE - 4] {
                    note(0, (four(above, z) - four(here, z)) - (four(here, z) - four(below, z)));
                }
            }
            if x < CELLS && y < CELLS {
                let (across, along, both) = (row(x + 1, y), row(x, y + 1), row(x + 1, y + 1));
                for z in [0, 4, EDGE - 4] {
                    note(1, four(both, z) - four(along, z) - (four(across, z) - four(here, z)));
                }
            }
            if y < CELLS {
                let along = row(x, y + 1);
                for z in [0, 4] {
                    note(1, four(along, z + 1) - four(here, z + 1) - (four(along, z) - four(here, z)));
                }
            }
            if x < CELLS {
                let across = row(x + 1, y);
                for z in [0, 4] {
                    note(1, four(across, z + 1) - four(across, z) - (four(here, z + 1) - four(here, z)));
                }
            }
        }
    }
    most.map(|most| most.store().into_iter().fold(R::ZERO, R::greater))
}
