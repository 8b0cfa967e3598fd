//! Free paths: where along a ray light collides with the medium for the first time.
//!
//! Collisions have the density `σ e^{-τ}` along the ray, τ the optical depth so far: they lie at optical depths with
//! the density `e^{-τ}`. Given that a ray of transmittance T has one, a number u in [0, 1) has it where
//! `τ = -ln(1 - u (1 - T))`. Exact quadrature knows the inverse of the optical depth.

use super::blend::{Blend, Entry};
use super::tape::Tape;
use super::{CompiledMedium, Dvr};
use crate::math::Ray;
use crate::real::{LANES, Lanes, Real};
use crate::render::cell::{Quartet, corners, gather, weights};
use crate::render::compositing;
use crate::render::differentiable::Adjoint;
use crate::render::gauss;
use crate::render::march::{IndexRay, Span, batches};
use crate::render::quadrature::ExactDepth;
use crate::render::segment::Chord;
use crate::scene::bricks::slot;

/// A ray through a medium, whose way a tape holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct TracedRay {
    /// Optical depth of the ray, or of the part of it that was walked.
    pub depth: f64,
    /// World length from the ray's origin to where its way begins.
    enter: f64,
}

impl TracedRay {
    /// A ray that meets nothing.
    const NOTHING: Self = Self { depth: 0.0, enter: 0.0 };

    /// Returns the optical depth of the collision that a number u in [0, 1) stands for among those of the ray; `None`
    /// if the ray has none.
    #[inline]
    pub(crate) fn collision(&self, u: f64) -> Option<f64> {
        (self.depth > 0.0).then(|| -(u * (-self.depth).exp_m1()).ln_1p())
    }
}

/// Walk along a ray, as the unit that is compiled for each instruction set.
struct Walk<'k, 'd> {
    dvr: &'k Dvr<'d, f32>,
    ray: &'k Ray,
    length: f64,
    limit: f64,
    tape: &'k mut Tape<f32>,
}

impl pulp::NullaryFnOnce for Walk<'_, '_> {
    type Output = TracedRay;

    #[inline(always)]
    fn call(self) -> TracedRay {
        let Self { dvr, ray, length, limit, tape } = self;
        let Some(enter) = dvr.index_ray(ray).map(|ray| ray.enter) else { return TracedRay::NOTHING };
        // From the entry on, single precision resolves positions however far the camera is.
        let inner = Ray::new(ray.at(enter), ray.direction);
        let Some(mut inner) = dvr.index_ray(&inner) else { return TracedRay::NOTHING };
        inner.leave = inner.leave.min(length - enter);
        let depth = match &dvr.compiled {
            CompiledMedium::Line(_) => dvr.walk_spans(&inner, limit, tape),
            CompiledMedium::Table(..) => dvr.walk_chords(&inner, limit, tape),
        };
        TracedRay { depth, enter }
    }
}

/// Search for a collision, as the unit that is compiled for each instruction set.
struct Locate<'k, 'd> {
    dvr: &'k Dvr<'d, f32>,
    depth: f64,
    tape: &'k mut Tape<f32>,
}

impl pulp::NullaryFnOnce for Locate<'_, '_> {
    type Output = Option<(f64, f32)>;

    #[inline(always)]
    fn call(self) -> Option<(f64, f32)> {
        let Self { dvr, depth, tape } = self;
        match &dvr.compiled {
            CompiledMedium::Line(_) => dvr.locate_in_spans(depth, tape),
            CompiledMedium::Table(..) => dvr.locate_in_chords(depth, tape),
        }
    }
}

impl Dvr<'_, f32> {
    /// Walks along a world ray of unit direction with exact quadrature, and keeps its way on the tape. A ray that ends
    /// early ([`Dvr::early_stop`]) has no collisions behind its end.
    pub(crate) fn walk(&self, ray: &Ray, tape: &mut Tape<f32>) -> TracedRay {
        self.arch.dispatch(Walk { dvr: self, ray, length: f64::INFINITY, limit: self.depth_limit, tape })
    }

    /// Returns the point at an optical depth along the ray whose way the tape holds, as the world length from the ray's
    /// origin and the density there; `None` if the ray meets nothing.
    pub(crate) fn locate(&self, walked: &TracedRay, depth: f64, tape: &mut Tape<f32>) -> Option<(f64, f32)> {
        if walked.depth <= 0.0 {
            return None;
        }
        let found = self.arch.dispatch(Locate { dvr: self, depth, tape })?;
        Some((walked.enter + found.0, found.1))
    }

    /// Returns the collision at an optical depth along the first `length` of a world ray of unit direction, as the
    /// world length from the ray's origin and the density there; `None` if the ray has less.
    pub(crate) fn collision_at(&self, ray: &Ray, depth: f64, length: f64, tape: &mut Tape<f32>) -> Option<(f64, f32)> {
        let walked = self.arch.dispatch(Walk { dvr: self, ray, length, limit: depth, tape });
        if depth < walked.depth { self.locate(&walked, depth, tape) } else { None }
    }

    /// Returns the optical depth of the first `length` of the world ray whose way the tape holds, where the extinction
    /// is proportional to the density; `None` where it is not.
    #[inline(always)]
    pub(crate) fn depth_before(&self, walked: &TracedRay, length: f64, tape: &Tape<f32>) -> Option<f64> {
        let CompiledMedium::Line(_) = &self.compiled else { return None };
        if walked.depth <= 0.0 {
            return Some(0.0);
        }
        let Tape { cells, spans, span_ends, integrals, .. } = tape;
        let length = length - walked.enter;
        let Some(number) = spans.partition_point(|span| span.start <= length).checked_sub(1) else { return Some(0.0) };
        let (span, values) = (&spans[number], &self.field.values[..]);
        let first = if number == 0 { 0 } else { span_ends[number - 1] };
        let before = if first == 0 { 0.0 } else { integrals[first - 1] };
        let (mut depth, mut from, mut quartet) = (before, 0.0, first);
        while quartet < span_ends[number] {
            let end = from + cells[quartet].length();
            if span.start + end > length {
                break;
            }
            (depth, from, quartet) = (integrals[quartet], end, quartet + 1);
        }
        for cell in 0..if quartet < span_ends[number] { LANES } else { 0 } {
            let [of_cell, within] = cells[quartet].cell(cell, values);
            let rest = length - span.start - from;
            if rest < of_cell {
                let densities = chord(values, span, cells[quartet].offset[cell], [from, rest]);
                depth += rest * Cubic::through(densities.map(f64::from)).integral(1.0);
                break;
            }
            (depth, from) = (depth + within, from + of_cell);
        }
        Some((self.medium.extinction * depth).min(walked.depth))
    }

    /// Extinction proportional to the density: keeps spans, their cells and the integrals, and returns the optical
    /// depth.
    #[inline(always)]
    fn walk_spans(&self, ray: &IndexRay, limit: f64, tape: &mut Tape<f32>) -> f64 {
        let Tape { cells, spans, span_ends, integrals, .. } = tape;
        cells.clear();
        spans.clear();
        span_ends.clear();
        integrals.clear();
        let (values, extinction) = (&self.field.values[..], self.medium.extinction);
        let (mut integral, limit) = (0.0, limit / extinction);
        batches(
            &self.field.topology,
            ray,
            #[inline(always)]
            |batch| {
                spans.extend_from_slice(batch);
                let from = cells.len();
                ExactDepth.cells_by_span(batch, cells, |end| span_ends.push(end));
                for quartet in &cells[from..] {
                    integral += f64::from(quartet.gather(values).sum());
                    integrals.push(integral);
                }
                integral <= limit
            },
        );
        extinction * integral
    }

    /// Extinction proportional to the density: finds the quartet of cells, the cell, and in it the length.
    #[inline(always)]
    fn locate_in_spans(&self, depth: f64, tape: &mut Tape<f32>) -> Option<(f64, f32)> {
        let Tape { cells, spans, span_ends, integrals, .. } = tape;
        let (values, extinction) = (&self.field.values[..], self.medium.extinction);
        let target = depth / extinction;
        let mut quartet = integrals.partition_point(|end| *end <= target).min(integrals.len().checked_sub(1)?);
        let before = |quartet: usize| if quartet == 0 { 0.0 } else { integrals[quartet - 1] };
        // By rounding, the depth may lie in cells that have none.
        while quartet > 0 && integrals[quartet] <= before(quartet) {
            quartet -= 1;
        }
        let number = span_ends.partition_point(|end| *end <= quartet);
        let span = spans.get(number)?;
        let first = if number == 0 { 0 } else { span_ends[number - 1] };
        let lengths = cells[first..quartet].iter().map(Quartet::length);
        let (cell, from, [length, within], rest) =
            cell_of(&cells[quartet], values, (target - before(quartet)).max(0.0));
        let from = lengths.sum::<f64>() + from;
        let densities = chord(values, span, cells[quartet].offset[cell], [from, length]);
        let cubic = Cubic::through(densities.map(f64::from));
        let precision = PRECISION * within.min(1.0 / extinction);
        let share = inverse(1.0, (within, precision), rest, |at| {
            (length * cubic.integral(at), (length * cubic.value(at)).max(0.0))
        });
        Some((span.start + from + share * length, cubic.value(share).max(0.0) as f32))
    }

    /// Any transfer function: records segments, and returns the optical depth.
    #[inline(always)]
    fn walk_chords(&self, ray: &IndexRay, limit: f64, tape: &mut Tape<f32>) -> f64 {
        let CompiledMedium::Table(compiled, _) = &self.compiled else { return 0.0 };
        let Tape { chords, chord_entries, .. } = tape;
        chord_entries.clear();
        let mut blend = Blend::new(self, compiled, self.exact_source(compiled, false), chords);
        blend.depth_limit = limit.next_up();
        compositing::record(&self.visible, ray, Adjoint::Tape, &mut blend, chord_entries);
        blend.depth
    }

    /// Any transfer function: finds the segment, on which the extinction is a cubic.
    #[inline(always)]
    fn locate_in_chords(&self, target: f64, tape: &mut Tape<f32>) -> Option<(f64, f32)> {
        let CompiledMedium::Table(compiled, _) = &self.compiled else { return None };
        let reached = (-target).exp();
        let (before, after) =
            tape.chord_entries.split_at(tape.chord_entries.partition_point(|entry| entry.transmittance >= reached));
        // By rounding, the depth may lie in a segment that has none.
        let thick = |entry: &&Entry<f32, Chord<f32>>| entry.optics.depth > 0.0;
        let entry = before.iter().rev().find(thick).or_else(|| after.iter().find(thick))?;
        let chord: &Chord<f32> = &entry.segment;
        let piece = compiled.curve.piece(chord.piece);
        let extinctions =
            chord.density.store().map(|d| f64::from(piece.extinction[0] + piece.extinction[1] * (d - piece.base)));
        let (length, whole) = (f64::from(chord.length), f64::from(entry.optics.depth));
        let rest = (target + entry.transmittance.ln()).clamp(0.0, whole);
        let cubic = Cubic::through(extinctions.map(|s| s * length));
        let share = inverse(1.0, (whole, PRECISION * whole.min(1.0)), rest, |at| {
            (cubic.integral(at), cubic.value(at).max(0.0))
        });
        let density = Cubic::through(chord.density.store().map(f64::from)).value(share) as f32;
        Some((f64::from(chord.start) + share * length, density))
    }
}

/// Returns the number of the cell of a quartet in which the integral of the density reaches `rest`, its world length
/// from the quartet's entry, its own length and integral, and what is left of `rest` there.
#[inline(always)]
fn cell_of(quartet: &Quartet<f32>, values: &[f32], mut rest: f64) -> (usize, f64, [f64; 2], f64) {
    let (mut from, mut found) = (0.0, (0, 0.0, [0.0; 2], 0.0));
    for cell in 0..LANES {
        let [length, within] = quartet.cell(cell, values);
        if within > 0.0 {
            found = (cell, from, [length, within], rest.clamp(0.0, within));
            if rest < within {
                break;
            }
        }
        rest -= within;
        from += length;
    }
    found
}

/// Returns the densities at the points of [`gauss::NODES`] of a chord through the cell of this offset; the chord's
/// beginning and length are world lengths, from the span's entry.
#[inline(always)]
fn chord(values: &[f32], span: &Span<f32>, offset: u32, [from, length]: [f64; 2]) -> [f32; LANES] {
    let within = offset as usize - span.base;
    let corner = [within / slot(1, 0, 0), within % slot(1, 0, 0) / slot(0, 1, 0), within % slot(0, 1, 0)];
    let corners = corners(values, offset as usize);
    gauss::NODES.map(|node| {
        let at = (from + node * length) as f32;
        let local = |a: usize| (span.entry[a] + at * span.direction[a] - corner[a] as f32).clamp(0.0, 1.0);
        gather(&weights([local(0), local(1), local(2)]), &corners)
    })
}

/// Returns the argument between 0 and `end` at which an ascending function, which is 0 at 0 and `whole` at the end,
/// has the value `rest` but for `precision`; `value` returns the function and its derivative. Newton's method between
/// bounds.
#[inline(always)]
fn inverse(end: f64, (whole, precision): (f64, f64), rest: f64, mut value: impl FnMut(f64) -> (f64, f64)) -> f64 {
    let (mut low, mut high) = (0.0, end);
    let mut at = end * (rest / whole);
    for _ in 0..STEPS {
        let (reached, slope) = value(at);
        let missing = rest - reached;
        if missing.abs() <= precision {
            break;
        }
        if missing > 0.0 {
            low = at
        } else {
            high = at
        }
        let next = at + missing / slope;
        // A slope of 0 gives no number, or none within.
        at = if next > low && next < high { next } else { 0.5 * (low + high) };
    }
    at
}

/// Error of the optical depth of a collision, as a share of that of its span or segment if it is less than 1, and the
/// most steps to get there.
const PRECISION: f64 = 1e-5;
const STEPS: usize = 40;

/// A polynomial of degree 3 on 0..1.
struct Cubic([f64; LANES]);

impl Cubic {
    /// Creates the cubic with these values at the points of [`gauss::NODES`].
    fn through(values: [f64; LANES]) -> Self {
        let all = <f64 as Real>::Lanes::splat;
        Self(gauss::coefficients::<f64>(values.map(all)).map(|c| c.store()[0]))
    }

    fn value(&self, at: f64) -> f64 {
        let [a, b, c, d] = self.0;
        let x = 2.0 * at - 1.0;
        a + x * (b + x * (c + x * d))
    }

    /// Returns the integral from 0.
    fn integral(&self, at: f64) -> f64 {
        let [a, b, c, d] = self.0;
        let up_to = |x: f64| x * (a + x * (b / 2.0 + x * (c / 3.0 + x * d / 4.0)));
        0.5 * (up_to(2.0 * at - 1.0) - up_to(-1.0))
    }
}

/// Returns the interpolated density at a world length from the entry into a brick.
#[inline(always)]
pub(crate) fn density(values: &[f32], span: &Span<f32>, at: f32) -> f32 {
    let (mut cell, mut local) = ([0; 3], [0.0; 3]);
    for a in 0..3 {
        let p = (span.entry[a] + at * span.direction[a]).clamp(0.0, 8.0);
        let low = p.min(7.0).floor();
        (cell[a], local[a]) = (low as usize, p - low);
    }
    let offset = span.base + slot(cell[0], cell[1], cell[2]);
    gather(&weights(local), &corners(values, offset))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Affine;
    use crate::scene::bricks::Bricks;
    use crate::scene::medium::{Medium, Source};
    use crate::scene::table::Table;
    use crate::scene::topology::Topology;
    use glam::{DVec3, IVec3};
    use std::sync::Arc;

    fn field() -> Bricks<f32> {
        let topology = Arc::new(Topology::new((0..27).map(|i| IVec3::new(i % 3, i / 3 % 3, i / 9))).unwrap());
        let owned: Vec<f32> =
            (0..27 * 512).map(|i: u32| (i.wrapping_mul(2_654_435_761) >> 8) as f32 / 16_777_216.0).collect();
        let mut field = Bricks::zeros(topology.clone(), Affine::uniform(0.25, DVec3::new(1e3, -2.0, 3.0)).unwrap());
        topology.fill_apron(&owned, &mut field.values);
        field
    }

    /// Rays that leave through clear stretches have their last collision before: no number is lost to rounding.
    #[test]
    fn collisions_lie_where_something_is() {
        let mut field = field();
        let value = |s: f64| [1.0, 1.0, 1.0, s];
        let peak = Table::new(vec![0.4, 0.5, 0.6], vec![value(0.0), value(1.0), value(0.0)]).unwrap();
        let brick = |i: usize| (i / crate::scene::bricks::BRICK) % 3;
        field.values.iter_mut().enumerate().for_each(|(i, v)| *v = if brick(i) == 1 { *v } else { 0.39 });
        for (source, extinction) in [(Source::Grey([0.0; 3]), 0.3), (Source::Transfer(Arc::new(peak)), 0.3)] {
            let dvr = Dvr::new(&field, Medium::new(extinction, source)).unwrap();
            let mut tape = Tape::default();
            for k in 0..2000 {
                let turn = f64::from(k) * 2.4;
                let from = DVec3::new(turn.cos(), turn.sin(), (0.7 * turn).sin()).normalize();
                let ray = Ray::new(field.transform.to_world(DVec3::splat(12.0)), from);
                for u in [0.0, 1e-12, 0.5, 1.0 - 1e-9, 1.0 - f64::EPSILON, 1.0] {
                    let walked = dvr.walk(&ray, &mut tape);
                    let found = walked.collision(u).and_then(|depth| dvr.locate(&walked, depth, &mut tape));
                    assert!(found.is_none_or(|(t, d)| t.is_finite() && d.is_finite()), "{k} {u}: {found:?}");
                }
                let whole = dvr.optical_depth_within(&ray, f64::INFINITY, f64::INFINITY, &mut tape);
                for depth in [whole.next_down(), whole * (1.0 - 1e-7), 0.0] {
                    let found = dvr.collision_at(&ray, depth, f64::INFINITY, &mut tape);
                    assert!(found.is_none_or(|(t, d)| t.is_finite() && d.is_finite()), "{k} {depth}: {found:?}");
                }
            }
        }
    }

    /// The optical depth up to the collision is the one that was asked for, on rays of all depths, through a line and
    /// through a function with a step.
    #[test]
    fn the_collision_lies_at_its_optical_depth() {
        let field = field();
        let value = |s: f64| [1.0, 1.0, 1.0, s];
        let steps = Table::new(vec![0.1, 0.4, 0.4, 0.7], vec![value(0.0), value(2.0), value(0.0), value(1.0)]).unwrap();
        for source in [Source::Grey([0.0; 3]), Source::Transfer(Arc::new(steps))] {
            for extinction in [1e-6, 0.1, 1.0, 100.0] {
                let medium = Medium::new(extinction, source.clone());
                let dvr = Dvr::new(&field, medium).unwrap().early_stop(1e-9);
                let mut tape = Tape::default();
                for k in 0..300 {
                    let turn = f64::from(k) * 2.4;
                    let from = DVec3::new(turn.cos(), turn.sin(), (0.7 * turn).sin());
                    let centre = field.transform.to_world(DVec3::splat(12.0));
                    let ray = Ray::new(centre + 10.0 * from, -(from + 0.1 * DVec3::Y).normalize());
                    let u = (f64::from(k) + 0.5) / 300.0;
                    let walked = dvr.walk(&ray, &mut tape);
                    let collision = walked.collision(u).and_then(|depth| dvr.locate(&walked, depth, &mut tape));
                    let whole = dvr.optical_depth_within(&ray, f64::INFINITY, f64::INFINITY, &mut tape);
                    let off = (-walked.depth).exp() - (-whole).exp();
                    assert!(off.abs() < 1e-6, "{k}: {walked:?}, depth {whole}");
                    let Some((distance, density)) = collision else {
                        assert_eq!(whole, 0.0);
                        continue;
                    };
                    let depth = dvr.optical_depth_within(&ray, distance, f64::INFINITY, &mut tape);
                    let share = -(-depth).exp_m1() / -(-whole).exp_m1();
                    assert!((share - u).abs() < 2e-4, "{k}: {share} instead of {u} of {whole}");
                    let again = dvr.collision_at(&ray, depth, f64::INFINITY, &mut tape).unwrap();
                    assert!((again.0 - distance).abs() < 1e-3, "{k}: {again:?} {distance}");
                    assert_eq!(dvr.collision_at(&ray, depth, 0.5 * distance, &mut tape), None);
                    assert_eq!(dvr.collision_at(&ray, whole + 1e-3, f64::INFINITY, &mut tape), None);
                    let sampled = field.sample(field.transform.to_index(ray.at(distance)));
                    assert!((density - sampled).abs() < 1e-3, "{k}: {density} {sampled}");
                }
            }
        }
    }
}
