//! The one walk along a ray that values and gradients share.
//!
//! A ray crosses bricks in `f64` ([`spans`]); inside a brick it is rebased to the point of entry and
//! walked in the kernel's own precision, so that accuracy does not depend on how far the volume lies
//! from the origin. What comes out are [`Piece`]s: a cell, a length and interpolation weights, by
//! which the value gathers and the gradient scatters.

use crate::math::{Affine, Ray};
use crate::real::Real;
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
    /// World length from the ray's origin to the entry.
    pub start: f64,
    /// World length from the ray's origin to the exit.
    pub end: f64,
    /// World length inside the brick.
    pub length: R,
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
                    direction: [R::of(d[0]), R::of(d[1]), R::of(d[2])],
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
/// Corner `(x, y, z)` of the cell is `values[offset + slot(x, y, z)]` and has weight
/// `nodes[k][x][2 y + z]`.
#[derive(Debug, Clone, Copy)]
pub struct Piece<R, const K: usize> {
    /// Offset of the cell's lowest corner among the field's values.
    pub offset: usize,
    /// World length.
    pub length: R,
    /// Trilinear weights at each node.
    pub nodes: [[[R; 4]; 2]; K],
}

/// Offsets of a cell's corners in the order of a piece's weights, for x = 0 and x = 1.
const CORNERS: [[usize; 4]; 2] = [
    [slot(0, 0, 0), slot(0, 0, 1), slot(0, 1, 0), slot(0, 1, 1)],
    [slot(1, 0, 0), slot(1, 0, 1), slot(1, 1, 0), slot(1, 1, 1)],
];
/// From a cell's lowest corner to one past its highest.
const REACH: usize = slot(1, 1, 1) + 1;

/// The values at a cell's corners, in the order of a piece's weights.
#[inline(always)]
pub fn corners<R: Real>(values: &[R], offset: usize) -> [[R; 4]; 2] {
    let v = &values[offset..offset + REACH];
    [
        [v[CORNERS[0][0]], v[CORNERS[0][1]], v[CORNERS[0][2]], v[CORNERS[0][3]]],
        [v[CORNERS[1][0]], v[CORNERS[1][1]], v[CORNERS[1][2]], v[CORNERS[1][3]]],
    ]
}

/// `Σ w v`: the interpolated value.
#[inline(always)]
pub fn gather<R: Real>(w: &[[R; 4]; 2], v: &[[R; 4]; 2]) -> R {
    let s: [R; 4] = std::array::from_fn(|i| w[0][i] * v[0][i] + w[1][i] * v[1][i]);
    (s[0] + s[1]) + (s[2] + s[3])
}

/// `values += g w`: the transpose of [`gather`].
#[inline(always)]
pub fn scatter<R: Real>(values: &mut [R], offset: usize, g: R, w: &[[R; 4]; 2]) {
    let v = &mut values[offset..offset + REACH];
    for x in 0..2 {
        for i in 0..4 {
            v[CORNERS[x][i]] += g * w[x][i];
        }
    }
}

/// Trilinear weights at cell-local coordinates `m`.
#[inline(always)]
pub fn weights<R: Real>(m: [R; 3]) -> [[R; 4]; 2] {
    let n = [R::ONE - m[0], R::ONE - m[1], R::ONE - m[2]];
    let yz = [n[1] * n[2], n[1] * m[2], m[1] * n[2], m[1] * m[2]];
    let far = yz.map(|w| w * m[0]);
    [std::array::from_fn(|i| yz[i] - far[i]), far]
}

/// Mean of the trilinear weights at `m ± h`, without evaluating both: for `h` = half the chord / √3
/// this is the two-point Gauss rule, exact for the cubic that the field is along the chord.
#[inline(always)]
fn chord_weights<R: Real>(m: [R; 3], h: [R; 3]) -> [[R; 4]; 2] {
    let n = [R::ONE - m[0], R::ONE - m[1], R::ONE - m[2]];
    let hyz = h[1] * h[2];
    let yz = [n[1] * n[2] + hyz, n[1] * m[2] - hyz, m[1] * n[2] - hyz, m[1] * m[2] + hyz];
    let (hy, hz) = (h[0] * h[1], h[0] * h[2]);
    let cross = [-(n[1] * hz + n[2] * hy), n[1] * hz - m[2] * hy, n[2] * hy - m[1] * hz, m[1] * hz + m[2] * hy];
    let far: [R; 4] = std::array::from_fn(|i| yz[i] * m[0] + cross[i]);
    [std::array::from_fn(|i| yz[i] - far[i]), far]
}

/// Along one axis: the cell of the entry, the step from cell to cell, the length to the first plane and
/// from plane to plane.
#[inline(always)]
fn planes<R: Real>(entry: R, direction: R) -> (i32, i32, R, R) {
    let cell = entry.trunc().clamp(0, 7);
    if direction == R::ZERO {
        return (cell, 0, R::of(f64::MAX), R::ZERO);
    }
    let inverse = R::ONE / direction;
    let up = direction > R::ZERO;
    let first = (R::int(cell + i32::from(up)) - entry) * inverse;
    (cell, if up { 1 } else { -1 }, first, if up { inverse } else { -inverse })
}

/// The cells along a span, near to far: offset among the field's values, lowest corner, and the
/// interval of length from the entry.
#[inline(always)]
fn cells<R: Real>(span: &Span<R>, mut visit: impl FnMut(usize, [R; 3], R, R)) {
    let far = R::of(f64::MAX);
    let [ex, ey, ez] = span.entry;
    let [dx, dy, dz] = span.direction;
    let (mut ix, sx, mut nx, jx) = planes(ex, dx);
    let (mut iy, sy, mut ny, jy) = planes(ey, dy);
    let (mut iz, sz, mut nz, jz) = planes(ez, dz);
    let mut t = R::ZERO;
    loop {
        let nearest = nx.lesser(ny).lesser(nz);
        let until = nearest.lesser(span.length);
        if until > t {
            let offset = span.base + slot(ix as usize, iy as usize, iz as usize);
            visit(offset, [R::int(ix), R::int(iy), R::int(iz)], t, until);
            t = until;
        }
        if nearest >= span.length {
            return;
        }
        let (cx, cy, cz) = (nx <= nearest, ny <= nearest, nz <= nearest);
        ix += if cx { sx } else { 0 };
        iy += if cy { sy } else { 0 };
        iz += if cz { sz } else { 0 };
        nx += if cx { jx } else { R::ZERO };
        ny += if cy { jy } else { R::ZERO };
        nz += if cz { jz } else { R::ZERO };
        // The span ends at the brick's face. A ray that creeps along a face may round onto it early:
        // it stays in the outermost cells.
        if (ix | iy | iz) & !7 != 0 {
            for (i, n) in [(&mut ix, &mut nx), (&mut iy, &mut ny), (&mut iz, &mut nz)] {
                if *i & !7 != 0 {
                    *i = (*i).clamp(0, 7);
                    *n = far;
                }
            }
        }
    }
}

/// Turns a span into pieces with `K` nodes each.
pub trait Rule<R: Real, const K: usize>: Copy + Sync {
    /// Visits the pieces of a span near to far. `values` are the field's, for rules that place
    /// their nodes by them.
    fn pieces(&self, values: &[R], span: &Span<R>, visit: impl FnMut(&Piece<R, K>));
}

/// Optical depth without discretisation error: one averaged node a cell.
#[derive(Debug, Clone, Copy)]
pub struct ExactDepth;

impl<R: Real> Rule<R, 1> for ExactDepth {
    #[inline(always)]
    fn pieces(&self, _: &[R], span: &Span<R>, mut visit: impl FnMut(&Piece<R, 1>)) {
        let (half, inv_sqrt3) = (R::of(0.5), R::of(1.0 / 3.0_f64.sqrt()));
        let [dx, dy, dz] = span.direction;
        cells(
            span,
            #[inline(always)]
            |offset, low, a, b| {
                let (mid, reach) = (half * (a + b), half * (b - a) * inv_sqrt3);
                let m = [
                    span.entry[0] + mid * dx - low[0],
                    span.entry[1] + mid * dy - low[1],
                    span.entry[2] + mid * dz - low[2],
                ];
                let h = [reach * dx, reach * dy, reach * dz];
                visit(&Piece { offset, length: b - a, nodes: [chord_weights(m, h)] });
            },
        );
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
    fn pieces(&self, values: &[R], span: &Span<R>, mut visit: impl FnMut(&Piece<R, 4>)) {
        let [dx, dy, dz] = span.direction;
        cells(
            span,
            #[inline(always)]
            |offset, low, a, b| {
                let v = corners(values, offset);
                let flat = [v[0][0], v[0][1], v[0][2], v[0][3], v[1][0], v[1][1], v[1][2], v[1][3]];
                let (least, most) = flat.iter().fold((flat[0], flat[0]), |(l, m), v| (l.lesser(*v), m.greater(*v)));
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
                    visit(&Piece { offset, length, nodes });
                }
            },
        );
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
    fn pieces(&self, _: &[R], span: &Span<R>, mut visit: impl FnMut(&Piece<R, 1>)) {
        let [dx, dy, dz] = span.direction;
        // Half-open spans: each sample belongs to exactly one.
        for k in self.before(span.start)..self.before(span.end) {
            let (position, length) = self.step(k);
            let t = R::of(position - span.start);
            let p = [span.entry[0] + t * dx, span.entry[1] + t * dy, span.entry[2] + t * dz];
            let low = p.map(|c| c.trunc().clamp(0, 7));
            let m: [R; 3] = std::array::from_fn(|a| p[a] - R::int(low[a]));
            visit(&Piece {
                offset: span.base + slot(low[0] as usize, low[1] as usize, low[2] as usize),
                length: R::of(length),
                nodes: [weights(m)],
            });
        }
    }
}
