//! The one walk along a ray that values and gradients share.
//!
//! A ray crosses bricks in `f64` ([`spans`]); inside a brick it is rebased to the point of entry and
//! walked in the kernel's own precision, so that accuracy does not depend on how far the volume lies
//! from the origin. What comes out are [`Piece`]s: a cell, a length and interpolation weights, by
//! which the value gathers and the gradient scatters.

use crate::lanes::{LANES, Lanes};
use crate::math::{Affine, Ray};
use crate::real::{Number, Real};
use crate::scene::bricks::{BRICK, NONE, Topology, slot};
use glam::{DVec3, IVec3};

/// A ray in index space, clipped to the bricks; its parameter is world length.
#[derive(Debug, Clone, Copy)]
pub struct IndexRay {
    origin: DVec3,
    direction: DVec3,
    /// Where it enters the box of all bricks.
    pub enter: f64,
    /// Where it leaves it.
    pub leave: f64,
}

impl IndexRay {
    /// The same ray, ending at `leave`.
    #[must_use]
    pub fn until(self, leave: f64) -> Self {
        Self { leave, ..self }
    }

    /// Rebases a world ray (unit direction); `None` if it misses the bricks.
    #[inline]
    pub fn new(topology: &Topology, transform: &Affine, ray: &Ray) -> Option<Self> {
        let origin = transform.to_index(ray.origin);
        let direction = transform.vector_to_index(ray.direction);
        let (enter, leave) = topology.bounds().clip(&Ray { origin, direction })?;
        Some(Self { origin, direction, enter, leave })
    }
}

/// The part of a ray inside one brick.
#[derive(Debug, Clone, Copy)]
pub struct Span<R> {
    /// Offset of the brick's first value.
    pub base: usize,
    /// Brick-local coordinates (0..8) of the point of entry.
    pub entry: [R; 3],
    /// Local coordinates gained per unit of world length.
    pub direction: [R; 3],
    /// Its reciprocals.
    pub inverse: [R; 3],
    /// World length from the ray's origin to the entry.
    pub start: f64,
    /// World length from the ray's origin to the exit.
    pub end: f64,
    /// World length inside the brick.
    pub length: R,
}

impl<R: Real> Span<R> {
    const NOWHERE: Self = Self {
        base: 0,
        entry: [R::ZERO; 3],
        direction: [R::ZERO; 3],
        inverse: [R::ZERO; 3],
        start: 0.0,
        end: 0.0,
        length: R::ZERO,
    };
}

/// Visits the bricks along a ray, near to far or (`reverse`) far to near; `visit` returns false to
/// stop. Both orders see identical spans: every crossing is computed from its plane, not from the
/// crossing before it.
#[inline(always)]
pub fn spans<R: Real>(topology: &Topology, ray: &IndexRay, reverse: bool, mut visit: impl FnMut(Span<R>) -> bool) {
    // Reversal is the mirror image τ = -t.
    let sign = if reverse { -1.0 } else { 1.0 };
    let (mut now, end) = if reverse { (-ray.leave, -ray.enter) } else { (ray.enter, ray.leave) };
    let (o, d) = (ray.origin.to_array(), ray.direction.to_array());
    let start = ray.origin + (sign * now) * ray.direction;
    let mut brick = (start / 8.0).floor().as_ivec3().to_array();
    let mut next = [f64::INFINITY; 3];
    let mut step = [0; 3];
    let crossing = |a: usize, plane: i32| sign * ((8.0 * f64::from(plane) - o[a]) / d[a]);
    let direction = d.map(R::of);
    let inverse = direction.map(|d| R::ONE / d);
    for a in 0..3 {
        if d[a] == 0.0 {
            continue;
        }
        step[a] = if (d[a] > 0.0) == reverse { -1 } else { 1 };
        let ahead = i32::from(step[a] > 0);
        // The floor above may be off by one at a face; the planes decide.
        while crossing(a, brick[a] + ahead) <= now && crossing(a, brick[a] + ahead) < end {
            brick[a] += step[a];
        }
        while crossing(a, brick[a] + 1 - ahead) > now {
            brick[a] -= step[a];
        }
        next[a] = crossing(a, brick[a] + ahead);
    }
    loop {
        let nearest = next[0].min(next[1]).min(next[2]);
        let until = nearest.min(end);
        if until > now {
            let number = topology.find(IVec3::from_array(brick));
            if number != NONE {
                let (t0, t1) = if reverse { (-until, -now) } else { (now, until) };
                let local = |a: usize| R::of((o[a] + t0 * d[a] - 8.0 * f64::from(brick[a])).clamp(0.0, 8.0));
                let span = Span {
                    base: number as usize * BRICK,
                    entry: [local(0), local(1), local(2)],
                    direction,
                    inverse,
                    start: t0,
                    end: t1,
                    length: R::of(t1 - t0),
                };
                if !visit(span) {
                    return;
                }
            }
            now = until;
        }
        if nearest >= end {
            return;
        }
        for a in 0..3 {
            if next[a] == nearest {
                brick[a] += step[a];
                next[a] = crossing(a, brick[a] + i32::from(step[a] > 0));
            }
        }
    }
}

/// Spans that are handled together. Work of one kind is done for all of them before work of the next:
/// the steps of one kind wait for each other (a crossing for the crossing before it, a load for its
/// address), those of different cells do not.
pub const BATCH: usize = 8;

/// Visits the bricks along a ray in batches, from near to far or (`reverse`) from far to near; inside
/// a batch spans are always ordered near to far. `visit` returns false to stop.
#[inline(always)]
pub fn batches<R: Real>(topology: &Topology, ray: &IndexRay, reverse: bool, mut visit: impl FnMut(&[Span<R>]) -> bool) {
    let mut batch = [Span::NOWHERE; BATCH];
    let (mut count, mut open) = (0, true);
    spans(
        topology,
        ray,
        reverse,
        #[inline(always)]
        |span| {
            batch[if reverse { BATCH - 1 - count } else { count }] = span;
            count += 1;
            if count == BATCH {
                open = visit(&batch);
                count = 0;
            }
            open
        },
    );
    if open && count > 0 {
        visit(if reverse { &batch[BATCH - count..] } else { &batch[..count] });
    }
}

/// True if a world ray crosses any brick.
pub fn meets(topology: &Topology, transform: &Affine, ray: &Ray) -> bool {
    let mut met = false;
    if let Some(ray) = IndexRay::new(topology, transform, ray) {
        spans::<f32>(
            topology,
            &ray,
            false,
            #[inline(always)]
            |_| {
                met = true;
                false
            },
        );
    }
    met
}

/// A stretch of a ray within one cell: `K` quadrature nodes, each a set of interpolation weights.
///
/// Corner `(x, y, z)` of the cell is `values[offset + slot(x, y, z)]` and has weight number `2 y + z`
/// of `nodes[k][x]`.
#[derive(Debug, Clone, Copy)]
pub struct Piece<R: Real, const K: usize> {
    /// Offset of the cell's lowest corner among the field's values.
    pub offset: usize,
    /// World length.
    pub length: R,
    /// Trilinear weights at each node.
    pub nodes: [[R::Lanes; 2]; K],
}

/// Four cells with the weights of their corners in the integral over their lengths of the ray: all that
/// an optical depth needs. What is left over of the four has weights of zero.
#[derive(Debug, Clone, Copy)]
pub struct Quartet<R: Real> {
    /// Offsets of the cells' lowest corners among the field's values.
    pub offset: [u32; LANES],
    /// Weights by cell and x of the corner, times the length: world length.
    pub weights: [[R::Lanes; 2]; LANES],
}

impl<R: Real> Quartet<R> {
    /// `Σ w v` over all cells, a share in each lane.
    #[inline(always)]
    pub fn gather(&self, values: &[R]) -> R::Lanes {
        let cell = |i: usize| {
            let (v, w) = (corners(values, self.offset[i] as usize), &self.weights[i]);
            w[0] * v[0] + w[1] * v[1]
        };
        (cell(0) + cell(1)) + (cell(2) + cell(3))
    }

    /// `values += g w`: the transpose of [`Quartet::gather`].
    #[inline(always)]
    pub fn scatter(&self, values: &mut [R], g: R) {
        for (offset, w) in self.offset.iter().zip(&self.weights) {
            scatter(values, *offset as usize, g, w);
        }
    }
}

/// Offsets of a cell's corners in the order of a piece's weights, for x = 0 and x = 1.
const CORNERS: [[usize; LANES]; 2] = [
    [slot(0, 0, 0), slot(0, 0, 1), slot(0, 1, 0), slot(0, 1, 1)],
    [slot(1, 0, 0), slot(1, 0, 1), slot(1, 1, 0), slot(1, 1, 1)],
];
/// From a cell's lowest corner to one past its highest.
const REACH: usize = slot(1, 1, 1) + 1;

/// The values at a cell's corners, in the order of a piece's weights.
#[inline(always)]
pub fn corners<R: Real>(values: &[R], offset: usize) -> [R::Lanes; 2] {
    let v = &values[offset..offset + REACH];
    let load = |[a, b, c, d]: [usize; LANES]| R::Lanes::load([v[a], v[b], v[c], v[d]]);
    [load(CORNERS[0]), load(CORNERS[1])]
}

/// `Σ w v`: the interpolated value.
#[inline(always)]
pub fn gather<R: Real>(w: &[R::Lanes; 2], v: &[R::Lanes; 2]) -> R {
    (w[0] * v[0] + w[1] * v[1]).sum()
}

/// `values += g w`: the transpose of [`gather`].
#[inline(always)]
pub fn scatter<R: Real>(values: &mut [R], offset: usize, g: R, w: &[R::Lanes; 2]) {
    let v = &mut values[offset..offset + REACH];
    for (corners, w) in CORNERS.iter().zip(w) {
        for (corner, add) in corners.iter().zip((R::Lanes::splat(g) * *w).store()) {
            v[*corner] += add;
        }
    }
}

/// Trilinear weights at cell-local coordinates `m`.
#[inline(always)]
pub fn weights<R: Real>(m: [R; 3]) -> [R::Lanes; 2] {
    let n = [R::ONE - m[0], R::ONE - m[1], R::ONE - m[2]];
    let yz = R::Lanes::load([n[1] * n[2], n[1] * m[2], m[1] * n[2], m[1] * m[2]]);
    let far = yz * R::Lanes::splat(m[0]);
    [yz - far, far]
}

/// Mean of the trilinear weights at `m ± h`, without evaluating both, times a length: for `h` = half
/// the chord / √3 this is the two-point Gauss rule, exact for the cubic that the field is along the chord.
#[inline(always)]
fn chord_weights<N: Number>(m: [N; 3], h: [N; 3], length: N) -> ([N; 4], [N; 4]) {
    let n = [N::one() - m[0], N::one() - m[1], N::one() - m[2]];
    let (my, ny) = (length * m[1], length * n[1]);
    let (hx, hy) = (length * h[0], length * h[1]);
    let (hxy, hxz, hyz) = (hx * h[1], hx * h[2], hy * h[2]);
    let yz = [ny * n[2] + hyz, ny * m[2] - hyz, my * n[2] - hyz, my * m[2] + hyz];
    let cross = [-(n[1] * hxz + n[2] * hxy), n[1] * hxz - m[2] * hxy, n[2] * hxy - m[1] * hxz, m[1] * hxz + m[2] * hxy];
    let far = [yz[0] * m[0] + cross[0], yz[1] * m[0] + cross[1], yz[2] * m[0] + cross[2], yz[3] * m[0] + cross[3]];
    ([yz[0] - far[0], yz[1] - far[1], yz[2] - far[2], yz[3] - far[3]], far)
}

/// The most cells that a span may have, rounded up: eight planes along each axis, three at the entry.
const MOST: usize = 28;
/// Lengths from a span's entry to where it crosses the faces of its cells: ascending from zero to the
/// span's length, which fills the last four.
type Crossings<R> = [R; MOST + 1];

/// Crossings of four spans of one ray in lockstep. (One by one, each would wait for its own chain of
/// comparisons, and its end could not be foreseen.)
#[inline(always)]
fn crossings<R: Real>(spans: [&Span<R>; LANES], at: &mut [Crossings<R>; LANES]) {
    let [a, b, c, d] = spans;
    let all = <R::Lanes as Lanes<R>>::splat;
    // Along each axis: the length to the next plane, and from plane to plane.
    let axis = |k: usize| {
        let (up, inverse) = (a.direction[k] > R::ZERO, a.inverse[k]);
        if !inverse.f64().is_finite() {
            return (all(R::of(f64::MAX)), all(R::ZERO));
        }
        let entry = R::Lanes::load([a.entry[k], b.entry[k], c.entry[k], d.entry[k]]);
        let plane = if up { low(entry) + all(R::ONE) } else { low(entry) };
        ((plane - entry) * all(inverse), all(if up { inverse } else { -inverse }))
    };
    let [(mut x, dx), (mut y, dy), (mut z, dz)] = [axis(0), axis(1), axis(2)];
    let length = R::Lanes::load([a.length, b.length, c.length, d.length]);
    let mut advance = || {
        let nearest = x.lesser(y).lesser(z);
        (x, y, z) = (x.advanced(nearest, dx), y.advanced(nearest, dy), z.advanced(nearest, dz));
        nearest.lesser(length)
    };
    let mut first = all(R::ZERO);
    for k in (0..MOST).step_by(LANES) {
        let second = advance();
        let third = advance();
        let fourth = advance();
        let rows = R::Lanes::transpose([first, second, third, fourth]);
        for (at, row) in at.iter_mut().zip(rows) {
            at[k..k + LANES].copy_from_slice(&row.store());
        }
        first = advance();
        if first.reach(length) || k == MOST - LANES {
            for (at, length) in at.iter_mut().zip(length.store()) {
                at[k + LANES] = length;
            }
            return;
        }
    }
}

/// Lowest corners, along one axis, of the cells of a brick that hold these coordinates. On a face it
/// may be either cell; what rounds past the brick's faces stays in the outermost cells.
#[inline(always)]
fn low<R: Real, L: Lanes<R>>(coordinate: L) -> L {
    // Adding rounds to the nearest whole number: down, half a cell lower.
    let ones = L::splat(R::ONES);
    (coordinate.clamped(R::ZERO, R::of(7.75)) - L::splat(R::of(0.5)) + ones) - ones
}

/// Offsets in a brick of the cells with these lowest corners.
#[inline(always)]
fn offsets<R: Real, L: Lanes<R>>(low: [L; 3]) -> [u32; LANES] {
    let all = |v: usize| L::splat(R::int(v as i32));
    let sum = low[0] * all(slot(1, 0, 0)) + low[1] * all(slot(0, 1, 0)) + low[2];
    let [a, b, c, d] = (sum + L::splat(R::ONES)).store();
    [a.low_bits(), b.low_bits(), c.low_bits(), d.low_bits()]
}

/// Turns spans into pieces with `K` nodes each.
pub trait Rule<R: Real, const K: usize>: Copy + Sync {
    /// Appends the pieces of at most [`BATCH`] spans, near to far. `values` are the field's, for rules
    /// that place their nodes by them.
    fn pieces(&self, values: &[R], spans: &[Span<R>], pieces: &mut Vec<Piece<R, K>>);
}

/// What optical depths alone are made of.
pub trait DepthRule<R: Real>: Copy + Sync {
    /// Appends the cells of at most [`BATCH`] spans of one ray.
    fn cells(&self, spans: &[Span<R>], cells: &mut Vec<Quartet<R>>);
}

/// Optical depth without discretisation error: one averaged node a cell.
#[derive(Debug, Clone, Copy)]
pub struct ExactDepth;

impl<R: Real> DepthRule<R> for ExactDepth {
    #[inline(always)]
    fn cells(&self, spans: &[Span<R>], cells: &mut Vec<Quartet<R>>) {
        let mut at = [[R::ZERO; MOST + 1]; BATCH];
        for (spans, at) in spans.chunks(LANES).zip(at.as_chunks_mut().0) {
            let last = spans.len() - 1;
            crossings([0, 1, 2, 3].map(|i| &spans[last.min(i)]), at);
        }
        let all = <R::Lanes as Lanes<R>>::splat;
        let (half, third) = (all(R::of(0.5)), all(R::of(0.5 / 3.0_f64.sqrt())));
        for (span, at) in spans.iter().zip(&at) {
            let ([x, y, z], [dx, dy, dz]) = (span.entry, span.direction);
            let (entry, along) = ([all(x), all(y), all(z)], [all(dx), all(dy), all(dz)]);
            for at in at.windows(LANES + 1).step_by(LANES) {
                if at[0] >= span.length {
                    break;
                }
                let from = R::Lanes::load([at[0], at[1], at[2], at[3]]);
                let until = R::Lanes::load([at[1], at[2], at[3], at[4]]);
                let (middle, length) = (half * (from + until), until - from);
                let reach = third * length;
                let [x, y, z] =
                    [entry[0] + middle * along[0], entry[1] + middle * along[1], entry[2] + middle * along[2]];
                let low = [low(x), low(y), low(z)];
                let m = [x - low[0], y - low[1], z - low[2]];
                let (near, far) = chord_weights(m, [reach * along[0], reach * along[1], reach * along[2]], length);
                let (near, far) = (R::Lanes::transpose(near), R::Lanes::transpose(far));
                let [a, b, c, d] = offsets(low);
                let base = span.base as u32;
                cells.push(Quartet {
                    offset: [base + a, base + b, base + c, base + d],
                    weights: [[near[0], far[0]], [near[1], far[1]], [near[2], far[2]], [near[3], far[3]]],
                });
            }
        }
    }
}

/// Four-point Gauss-Legendre nodes and weights on 0..1: exact to degree 7.
pub const GAUSS4: [(f64, f64); 4] = [
    (0.069_431_844_202_973_71, 0.173_927_422_568_726_93),
    (0.330_009_478_207_571_87, 0.326_072_577_431_273_07),
    (0.669_990_521_792_428_1, 0.326_072_577_431_273_07),
    (0.930_568_155_797_026_3, 0.173_927_422_568_726_93),
];

/// Cells with four Gauss nodes, split until the source's variation under absorption inside a piece
/// costs less than a stated error.
///
/// With optical depth x and a source that varies by Δc over the piece, taking the mean source costs
/// at most `x² Δc / 12` (the covariance of two linear functions); n parts divide it by n².
#[derive(Debug, Clone, Copy)]
pub struct ExactSource {
    /// Extinction per unit of density.
    pub extinction: f64,
    /// Radiance of the source per unit of density, brightest channel.
    pub colour: f64,
    /// Radiance error allowed per piece.
    pub tolerance: f64,
}

impl<R: Real> Rule<R, 4> for ExactSource {
    #[inline(always)]
    fn pieces(&self, values: &[R], spans: &[Span<R>], pieces: &mut Vec<Piece<R, 4>>) {
        for span in spans {
            let [dx, dy, dz] = span.direction;
            let mut at = [[R::ZERO; MOST + 1]; LANES];
            crossings([span; LANES], &mut at);
            for pair in at[0].windows(2) {
                let (a, b) = (pair[0], pair[1]);
                if a >= span.length {
                    break;
                }
                let middle = R::of(0.5) * (a + b);
                let low = [0, 1, 2].map(|k| low(R::Lanes::splat(span.entry[k] + middle * span.direction[k])));
                let offset = span.base + offsets(low)[0] as usize;
                let low = low.map(|l| l.store()[0]);
                let v = corners(values, offset);
                let v = v.map(R::Lanes::store);
                let (least, most) =
                    v.iter().flatten().fold((v[0][0], v[0][0]), |(l, m), v| (l.lesser(*v), m.greater(*v)));
                let x = self.extinction * (most * (b - a)).f64();
                let parts = (x * x * self.colour * (most - least).f64() / (12.0 * self.tolerance)).sqrt();
                // Past 64 parts the piece is opaque many times over and its own weight is gone.
                let parts = (parts.ceil() as u32).clamp(1, 64);
                let length = (b - a) * R::of(1.0 / f64::from(parts));
                for part in 0..parts {
                    let start = a + length * R::int(part as i32);
                    let nodes = GAUSS4.map(|(position, _)| {
                        let t = start + length * R::of(position);
                        weights([
                            span.entry[0] + t * dx - low[0],
                            span.entry[1] + t * dy - low[1],
                            span.entry[2] + t * dz - low[2],
                        ])
                    });
                    pieces.push(Piece { offset, length, nodes });
                }
            }
        }
    }
}

/// Steps of constant world length from where the ray enters the bricks' box.
#[derive(Debug, Clone, Copy)]
pub struct Uniform {
    /// World length of a step.
    pub step: f64,
    /// Position of the sample within its step: 0 left, 0.5 middle.
    pub phase: f64,
    /// Where the first step begins, as world length from the ray's origin.
    pub enter: f64,
    /// Where the last step is cut.
    pub leave: f64,
}

impl Uniform {
    fn steps(&self) -> u64 {
        ((self.leave - self.enter) / self.step).ceil().max(1.0) as u64
    }

    /// Start, length and sample position of step `k`; the last step is cut at the exit.
    #[inline(always)]
    fn step(&self, k: u64) -> (f64, f64) {
        let begin = self.enter + k as f64 * self.step;
        let length = self.step.min(self.leave - begin);
        (begin + self.phase * length, length)
    }

    /// How many steps have their sample before `t`.
    #[inline(always)]
    fn before(&self, t: f64) -> u64 {
        let last = self.steps() - 1;
        let whole = ((t - self.enter) / self.step - self.phase).ceil().max(0.0) as u64;
        if whole < last { whole } else { last + u64::from(self.step(last).0 < t) }
    }
}

impl<R: Real> Rule<R, 1> for Uniform {
    #[inline(always)]
    fn pieces(&self, _: &[R], spans: &[Span<R>], pieces: &mut Vec<Piece<R, 1>>) {
        for span in spans {
            let [dx, dy, dz] = span.direction;
            // Half-open spans: each sample belongs to exactly one.
            for k in self.before(span.start)..self.before(span.end) {
                let (position, length) = self.step(k);
                let t = R::of(position - span.start);
                let p = [span.entry[0] + t * dx, span.entry[1] + t * dy, span.entry[2] + t * dz];
                let low = p.map(|c| low(R::Lanes::splat(c)));
                let offset = span.base + offsets(low)[0] as usize;
                let m = std::array::from_fn(|a| p[a] - low[a].store()[0]);
                pieces.push(Piece { offset, length: R::of(length), nodes: [weights(m)] });
            }
        }
    }
}

impl<R: Real> DepthRule<R> for Uniform {
    #[inline(always)]
    fn cells(&self, spans: &[Span<R>], cells: &mut Vec<Quartet<R>>) {
        let mut pieces = Vec::new();
        Rule::<R, 1>::pieces(self, &[], spans, &mut pieces);
        for four in pieces.chunks(LANES) {
            let mut cell = Quartet { offset: [0; LANES], weights: [[R::Lanes::splat(R::ZERO); 2]; LANES] };
            for (i, piece) in four.iter().enumerate() {
                let ([near, far], length) = (piece.nodes[0], R::Lanes::splat(piece.length));
                cell.offset[i] = piece.offset as u32;
                cell.weights[i] = [near * length, far * length];
            }
            cells.push(cell);
        }
    }
}
