//! The one walk along a ray that values and gradients share.
//!
//! A ray crosses bricks in `f64` ([`spans`]); inside a brick it is rebased to the point of entry and
//! walked in the kernel's own precision, so that accuracy does not depend on how far the volume lies
//! from the origin. [`batches`] hands several bricks at once to a quadrature rule
//! ([`crate::render::rule`]), which makes cells of them ([`crate::render::cell`]).

use crate::math::{Aabb, Affine, Ray};
use crate::real::Real;
use crate::scene::bricks::{BRICK, NONE, Topology};
use glam::{DVec3, IVec3};

/// A ray in index space, clipped to a domain; its parameter is world length.
#[derive(Debug, Clone, Copy)]
pub struct IndexRay {
    origin: DVec3,
    direction: DVec3,
    /// Where it enters the field's domain.
    pub enter: f64,
    /// Where it leaves it.
    pub leave: f64,
}

impl IndexRay {
    /// Rebases a world ray (unit direction); `None` if it misses the domain.
    #[inline]
    pub fn new(domain: &Aabb, transform: &Affine, ray: &Ray) -> Option<Self> {
        let origin = transform.to_index(ray.origin);
        let direction = transform.vector_to_index(ray.direction);
        let (enter, leave) = domain.clip(&Ray { origin, direction })?;
        Some(Self { origin, direction, enter, leave })
    }

    /// Index coordinates gained per unit of world length.
    pub fn direction(&self) -> DVec3 {
        self.direction
    }

    /// Index coordinates at world length `t`.
    pub fn at(&self, t: f64) -> DVec3 {
        self.origin + t * self.direction
    }

    /// The axis of the domain's face through which the ray goes at world length `t`, its entry or exit,
    /// and the coordinate gained along it; `None` where the ray begins inside.
    pub fn face(&self, domain: &Aabb, t: f64) -> Option<(usize, f64)> {
        if t <= 0.0 {
            return None;
        }
        let off = |axis: usize| {
            let p = self.at(t)[axis];
            (p - domain.min[axis]).abs().min((p - domain.max[axis]).abs())
        };
        let axis = (0..3).filter(|a| self.direction[*a] != 0.0).min_by(|a, b| off(*a).total_cmp(&off(*b)))?;
        Some((axis, self.direction[axis]))
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

/// Visits the bricks along a ray in batches, near to far; `visit` returns false to stop.
#[inline(always)]
pub fn batches<R: Real>(topology: &Topology, ray: &IndexRay, mut visit: impl FnMut(&[Span<R>]) -> bool) {
    let mut batch = [Span::NOWHERE; BATCH];
    let (mut count, mut open) = (0, true);
    spans(
        topology,
        ray,
        false,
        #[inline(always)]
        |span| {
            batch[count] = span;
            count += 1;
            if count == BATCH {
                open = visit(&batch);
                count = 0;
            }
            open
        },
    );
    if open && count > 0 {
        visit(&batch[..count]);
    }
}

/// Visits the batches of [`batches`] that come before the one that begins at world length `last`, far to
/// near; inside a batch spans are ordered near to far all the same.
#[inline(always)]
pub fn batches_before<R: Real>(topology: &Topology, ray: &IndexRay, last: f64, mut visit: impl FnMut(&[Span<R>])) {
    if last <= ray.enter {
        return;
    }
    let mut batch = [Span::NOWHERE; BATCH];
    let mut count = BATCH;
    spans(
        topology,
        &IndexRay { leave: last, ..*ray },
        true,
        #[inline(always)]
        |span| {
            count -= 1;
            batch[count] = span;
            if count == 0 {
                visit(&batch);
                count = BATCH;
            }
            true
        },
    );
    if count < BATCH {
        visit(&batch[count..]);
    }
}
