//! Traversal of bricks along a ray, shared by values and gradients.
//!
//! A ray crosses bricks in `f64` ([`spans`]); inside a brick it is rebased to the point of entry and walked in the
//! kernel's own precision, so that accuracy does not depend on how far the volume lies from the origin. [`batches`]
//! hands several bricks at once to a quadrature rule ([`crate::render::quadrature`]), which cuts them into cells
//! ([`crate::render::cell`]).

use crate::math::{Aabb, Affine, Ray};
use crate::real::Real;
use crate::scene::bricks::{BRICK, Topology};
use glam::{DVec3, IVec3};

/// The least coordinate gain across a face for the ray to count as crossing it, as a share of the gain along its
/// fastest axis. With less it grazes the face: the crossing moves without bound, while next to nothing depends on it.
const GRAZING: f64 = 1e-3;

/// A ray in index space, clipped to a domain; its parameter is world length.
#[derive(Debug, Clone, Copy)]
pub(crate) struct IndexRay {
    origin: DVec3,
    direction: DVec3,
    /// World length at which the ray enters the domain.
    pub enter: f64,
    /// World length at which the ray leaves the domain.
    pub leave: f64,
}

impl IndexRay {
    /// Transforms a world ray (unit direction) to index space; `None` if it misses the domain.
    #[inline]
    pub(crate) fn new(domain: &Aabb, transform: &Affine, ray: &Ray) -> Option<Self> {
        let origin = transform.to_index(ray.origin);
        // What has no reciprocal gains nothing along the axis.
        let direction = transform.vector_to_index(ray.direction).map(|d| if d.recip().is_finite() { d } else { 0.0 });
        let (enter, leave) = domain.clip(&Ray::new(origin, direction))?;
        let leave = leave.lesser(ray.far);
        (enter <= leave).then_some(Self { origin, direction, enter, leave })
    }

    /// Returns the index coordinates gained per unit of world length.
    pub(crate) fn direction(&self) -> DVec3 {
        self.direction
    }

    /// Returns the index coordinates at world length `t`.
    pub(crate) fn at(&self, t: f64) -> DVec3 {
        self.origin + t * self.direction
    }

    /// Returns the axis of the domain's face through which the ray goes at world length `t`, its entry or exit, and the
    /// coordinate gained along that axis per world length; `None` where the ray begins inside or grazes the face.
    pub(crate) fn face(&self, domain: &Aabb, t: f64) -> Option<(usize, f64)> {
        if t <= 0.0 {
            return None;
        }
        let off = |axis: usize| {
            let p = self.at(t)[axis];
            (p - domain.min[axis]).abs().min((p - domain.max[axis]).abs())
        };
        let axis = (0..3).filter(|a| self.direction[*a] != 0.0).min_by(|a, b| off(*a).total_cmp(&off(*b)))?;
        self.unless_grazing(axis)
    }

    /// Returns the axis of the face, of a cell or of the domain, that the ray crosses near world length `t`, and the
    /// coordinate gained along that axis per world length; `None` at the ray's origin and where it grazes the
    /// face.
    #[inline(always)]
    pub(crate) fn crossed(&self, domain: &Aabb, t: f64) -> Option<(usize, f64)> {
        if t <= 0.0 {
            return None;
        }
        let (at, d) = (self.at(t), self.direction);
        let off = (at - at.round()).abs().min((at - domain.min).abs()).min((at - domain.max).abs()) / d.abs();
        let off = |axis: usize| if d[axis] == 0.0 { f64::INFINITY } else { off[axis] };
        let axis = (1..3).fold(0, |nearest, axis| if off(axis) < off(nearest) { axis } else { nearest });
        self.unless_grazing(axis)
    }

    /// Returns an axis with the coordinate gained along it per world length; `None` if the ray grazes its planes.
    #[inline(always)]
    fn unless_grazing(&self, axis: usize) -> Option<(usize, f64)> {
        let d = self.direction;
        (d[axis].abs() > GRAZING * d.abs().max_element()).then_some((axis, d[axis]))
    }
}

/// The part of a ray inside one brick.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Span<R> {
    /// Offset of the brick's first value.
    pub base: usize,
    /// Brick-local coordinates (0..8) of the point of entry.
    pub entry: [R; 3],
    /// Brick-local coordinates gained per unit of world length.
    pub direction: [R; 3],
    /// Reciprocals of `direction`.
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

/// A walk from brick to brick (Amanatides & Woo 1987) along τ, which is the world length t from the ray's origin, or
/// its mirror image τ = -t for a walk far to near.
struct BrickWalk {
    origin: [f64; 3],
    direction: [f64; 3],
    /// 1 for τ = t, -1 for τ = -t.
    sign: f64,
    /// τ from which the ray is in the current brick, and at which it ends.
    now: f64,
    end: f64,
    /// Coordinates of the current brick.
    brick: [i32; 3],
    /// Change of the brick's coordinate from one to the next along each axis; 0 where the ray runs across.
    step: [i32; 3],
    /// 1 along axes on which the next plane is the upper face of a brick, else 0.
    ahead: [i32; 3],
    /// A plane at coordinate p is crossed at `τ = (p - from) · per`.
    from: [f64; 3],
    per: [f64; 3],
    /// The next plane along each axis, and the τ at which it is crossed.
    plane: [f64; 3],
    next: [f64; 3],
}

impl BrickWalk {
    /// Begins where a ray enters the bricks; `None` if it misses them.
    #[inline(always)]
    fn new(topology: &Topology, ray: &IndexRay, reverse: bool) -> Option<Self> {
        let (enter, leave) = topology.reach().clip(&Ray::new(ray.origin, ray.direction))?;
        let (enter, leave) = (enter.greater(ray.enter), leave.lesser(ray.leave));
        let sign = if reverse { -1.0 } else { 1.0 };
        let (now, end) = if reverse { (-leave, -enter) } else { (enter, leave) };
        if now >= end {
            return None;
        }
        let (origin, direction) = (ray.origin.to_array(), ray.direction.to_array());
        let start = ray.origin + (sign * now) * ray.direction;
        let brick = (start / 8.0).floor().as_ivec3().to_array();
        // Where nothing is gained along an axis its next plane is never reached.
        let (mut step, mut from, mut per) = ([0; 3], origin, [1.0; 3]);
        for a in 0..3 {
            if direction[a] == 0.0 {
                from[a] = 0.0;
            } else {
                step[a] = if (direction[a] > 0.0) == reverse { -1 } else { 1 };
                per[a] = sign * (1.0 / direction[a]);
            }
        }
        let ahead = step.map(|s| i32::from(s > 0));
        let never = [f64::INFINITY; 3];
        let mut walk =
            Self { origin, direction, sign, now, end, brick, step, ahead, from, per, plane: never, next: never };
        for a in 0..3 {
            if step[a] != 0 {
                walk.enter(a, walk.brick[a]);
            }
        }
        Some(walk)
    }

    #[inline(always)]
    fn crossing(&self, axis: usize, plane: i32) -> f64 {
        (8.0 * f64::from(plane) - self.from[axis]) * self.per[axis]
    }

    /// Sets the brick, along one axis, in which the ray is from `now` on, and its next plane. `brick` is a guess from a
    /// rounded position and may be one off; the crossings of its planes decide.
    #[inline(always)]
    fn enter(&mut self, a: usize, mut brick: i32) {
        while self.crossing(a, brick + self.ahead[a]) <= self.now && self.crossing(a, brick + self.ahead[a]) < self.end
        {
            brick += self.step[a];
        }
        while self.crossing(a, brick + 1 - self.ahead[a]) > self.now {
            brick -= self.step[a];
        }
        self.brick[a] = brick;
        self.plane[a] = 8.0 * f64::from(brick + self.ahead[a]);
        self.next[a] = self.crossing(a, brick + self.ahead[a]);
    }

    /// Passes all bricks within a distance, in bricks, of the current one.
    #[inline(always)]
    fn pass(&mut self, distance: i32) {
        let leave = |a: usize| match self.step[a] {
            0 => f64::INFINITY,
            step => self.crossing(a, self.brick[a] + self.ahead[a] + distance * step),
        };
        self.now = leave(0).lesser(leave(1)).lesser(leave(2));
        if self.now >= self.end {
            return;
        }
        for a in 0..3 {
            if self.step[a] != 0 {
                let position = self.origin[a] + self.sign * self.now * self.direction[a];
                self.enter(a, (position * 0.125).floor() as i32);
            }
        }
    }

    /// Goes on to the next brick, which begins at `nearest`.
    #[inline(always)]
    fn advance(&mut self, nearest: f64) {
        // Without branches: which axis it is cannot be foreseen.
        for a in 0..3 {
            let by = if self.next[a] == nearest { self.step[a] } else { 0 };
            self.brick[a] += by;
            self.plane[a] += 8.0 * f64::from(by);
            self.next[a] = (self.plane[a] - self.from[a]) * self.per[a];
        }
    }
}

/// Visits the bricks along a ray, near to far or (`reverse`) far to near; `visit` returns false to stop. Both orders
/// produce identical spans: every crossing is computed from its plane, not from the crossing before it.
#[inline(always)]
pub(crate) fn spans<R: Real>(
    topology: &Topology,
    ray: &IndexRay,
    reverse: bool,
    mut visit: impl FnMut(Span<R>) -> bool,
) {
    let Some(mut walk) = BrickWalk::new(topology, ray, reverse) else { return };
    let direction = walk.direction.map(R::of);
    let inverse = direction.map(|d| R::ONE / d);
    loop {
        let nearest = walk.next[0].lesser(walk.next[1]).lesser(walk.next[2]);
        let until = nearest.lesser(walk.end);
        if until > walk.now {
            match topology.lookup(IVec3::from_array(walk.brick)) {
                Ok(number) => {
                    let (start, end) = if reverse { (-until, -walk.now) } else { (walk.now, until) };
                    let local = |a: usize| {
                        let position = walk.origin[a] + start * walk.direction[a];
                        R::of((position - 8.0 * f64::from(walk.brick[a])).clamp(0.0, 8.0))
                    };
                    let span = Span {
                        base: number as usize * BRICK,
                        entry: [local(0), local(1), local(2)],
                        direction,
                        inverse,
                        start,
                        end,
                        length: R::of(end - start),
                    };
                    if !visit(span) {
                        return;
                    }
                }
                Err(distance) if distance > 0 => {
                    walk.pass(distance);
                    if walk.now >= walk.end {
                        return;
                    }
                    continue;
                }
                Err(_) => (),
            }
            walk.now = until;
        }
        if nearest >= walk.end {
            return;
        }
        walk.advance(nearest);
    }
}

/// Spans that are processed together, one kind of work for all of them before the next kind: steps of one kind depend
/// on each other within a span (a crossing on the crossing before it, a load on its address), but not across spans.
pub(crate) const BATCH: usize = 8;

/// Visits the bricks along a ray in batches, near to far; `visit` returns false to stop.
#[inline(always)]
pub(crate) fn batches<R: Real>(topology: &Topology, ray: &IndexRay, mut visit: impl FnMut(&[Span<R>]) -> bool) {
    let mut batch = [Span::NOWHERE; BATCH];
    let (mut count, mut more) = (0, true);
    spans(
        topology,
        ray,
        false,
        #[inline(always)]
        |span| {
            batch[count] = span;
            count += 1;
            if count == BATCH {
                more = visit(&batch);
                count = 0;
            }
            more
        },
    );
    if more && count > 0 {
        visit(&batch[..count]);
    }
}

/// Visits the batches of [`batches`] that come before the one that begins at world length `last`, far to near; inside a
/// batch spans are still ordered near to far.
#[inline(always)]
pub(crate) fn batches_before<R: Real>(
    topology: &Topology,
    ray: &IndexRay,
    last: f64,
    mut visit: impl FnMut(&[Span<R>]),
) {
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

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn walked(topology: &Topology, ray: &IndexRay, reverse: bool) -> Vec<(usize, [f64; 3], f64, f64)> {
        let mut found = Vec::new();
        spans::<f64>(topology, ray, reverse, |s| {
            found.push((s.base, s.entry, s.start, s.end));
            true
        });
        found
    }

    proptest! {
        /// Near to far, far to near, and with what is clear passed at once: the same spans. Some rays go along axes
        /// and through corners.
        #[test]
        fn every_walk_sees_the_same_spans(
            origin in prop::array::uniform3(-30..30_i32), target in prop::array::uniform3(0..48_i32),
            straight in prop::array::uniform3(any::<bool>()), kept in prop::collection::vec(0..5_u8, 216),
        ) {
            let all = (0..216).map(|i| IVec3::new(i / 36, i / 6 % 6, i % 6));
            let whole = Topology::new(all).unwrap();
            let masked = whole.masked(|brick| kept[brick] == 0);
            let unmasked = masked.bricks().iter().enumerate().filter(|(i, _)| kept[*i] == 0).map(|(_, b)| *b);
            let plain = Topology::new(unmasked).unwrap();
            let target = IVec3::from_array(target).as_dvec3() + 0.5;
            let away = |a: usize| if straight[a] { 0.0 } else { f64::from(origin[a]) - 40.5 };
            let away = DVec3::from_array(std::array::from_fn(away));
            prop_assume!(away != DVec3::ZERO);
            let ray = Ray::new(target + away, (-away).normalize());
            let map = Affine::uniform(1.0, DVec3::ZERO).unwrap();
            let ray = IndexRay::new(&whole.bounds(), &map, &ray).unwrap();
            let near = walked(&masked, &ray, false);
            let mut far = walked(&masked, &ray, true);
            far.reverse();
            prop_assert_eq!(&near, &far);
            let ends: Vec<_> = near.iter().map(|s| (s.2, s.3)).collect();
            let alone: Vec<_> = walked(&plain, &ray, false).iter().map(|s| (s.2, s.3)).collect();
            prop_assert_eq!(ends, alone);
            // What is left out is clear.
            let seen: f64 = near.iter().map(|s| s.3 - s.2).sum();
            let n = 2000;
            let step = (ray.leave - ray.enter) / f64::from(n);
            let at = |i: i32| (ray.at(ray.enter + (f64::from(i) + 0.5) * step) / 8.0).floor().as_ivec3();
            let sampled = (0..n).filter(|i| masked.lookup(at(*i)).is_ok()).count() as f64 * step;
            prop_assert!((seen - sampled).abs() < 1e-9 + 2.0 * step * (near.len() + 1) as f64, "{} {}", seen, sampled);
        }
    }
}
