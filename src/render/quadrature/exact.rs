//! Exact quadrature: cell by cell between voxel centres, where the trilinear field along a ray is a cubic.

use super::cells::{Cell, cells, crossings};
use super::{DepthRule, Rule};
use crate::real::{LANES, Lanes, Real};
use crate::render::cell::{Quartet, chord_weights, low, offsets};
use crate::render::cubic;
use crate::render::curve::{Curve, Piece};
use crate::render::gauss;
use crate::render::march::Span;
use crate::render::segment::Chord;

/// Optical depth without discretisation error: one averaged node a cell.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ExactDepth;

impl<R: Real> DepthRule<R> for ExactDepth {
    #[inline(always)]
    fn cells(&self, spans: &[Span<R>], cells: &mut Vec<Quartet<R>>) {
        self.cells_by_span(spans, cells, |_| {});
    }
}

impl ExactDepth {
    /// Appends the cells of at most [`BATCH`](crate::render::march::BATCH) spans of one ray, and tells after each span
    /// how many quartets there are.
    #[inline(always)]
    pub(crate) fn cells_by_span<R: Real>(
        &self,
        spans: &[Span<R>],
        cells: &mut Vec<Quartet<R>>,
        mut ended: impl FnMut(usize),
    ) {
        let at = crossings(spans);
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
            ended(cells.len());
        }
    }
}

/// Exact quadrature where the source varies: cells are cut where the density crosses a knot of the curve, and further
/// until four Gauss points err by less than a tolerance in the light of a piece.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ExactSource {
    /// Radiance error allowed per piece, as it arrives at the eye, in units of the curve's source.
    pub tolerance: f64,
    /// True to keep pieces in which nothing is absorbed, for derivatives with respect to the transfer function.
    pub keep_clear: bool,
}

/// The most halvings of a piece. (An error falls 500 times when the length is halved, and behind an optical depth of 20
/// no light arrives: no piece that matters needs as many.)
const MOST_HALVINGS: usize = 256;

/// State of cutting a batch's cells into chords, which are appended to `segments`.
struct Cutter<'a, R: Real, const C: usize> {
    rule: &'a ExactSource,
    curve: &'a Curve<R, C>,
    values: &'a [R],
    segments: &'a mut Vec<Chord<R>>,
    /// Optical depth since the batch began, which attenuates the light from here, and with it the error.
    depth: R,
}

impl<R: Real, const C: usize> Cutter<'_, R, C> {
    /// Cuts a cell at the knots that the density crosses; `cubic` is the density, its argument running from -1 at
    /// `from` to 1 at `until`.
    #[inline(never)]
    fn split(&mut self, cell: &Cell<R>, from: R, until: R, cubic: [f64; LANES]) {
        let (mut start, mut jumped) = (from, false);
        // `knot`: the end of the piece at which the density leaves it.
        let mut emit = |cutter: &mut Self, v: f64, piece: u32, knot: Option<usize>| {
            let end = if v >= 1.0 { until } else { R::of(from.f64() + 0.5 * (v + 1.0) * (until - from).f64()) };
            let jumps = knot.is_some_and(|knot| cutter.curve.piece(piece).jumps[knot]);
            if end > start {
                cutter.cut(cell, start, end, piece, [jumped, jumps]);
                (start, jumped) = (end, false);
            }
            jumped |= jumps;
        };
        let turns = cubic::turns(cubic);
        for ends in turns.windows(2) {
            let (mut v, last) = (ends[0], ends[1]);
            let (begin, end) = (cubic::at(cubic, v), cubic::at(cubic, last));
            let rising = end > begin;
            let mut piece = self.curve.find(R::of(begin));
            while !rising && piece > 0 && self.curve.piece(piece).low.f64() >= begin {
                piece -= 1;
            }
            loop {
                let Piece { low, high, .. } = self.curve.piece(piece);
                let knot = if rising { high.f64() } else { low.f64() };
                // Not `knot >= end`: densities that overflow are NaN here, and cross nothing.
                let crossed = if rising { knot < end } else { knot > end };
                if !crossed {
                    emit(self, last, piece, None);
                    break;
                }
                v = cubic::crossing(cubic, knot, v, last);
                emit(self, v, piece, Some(rising.into()));
                piece = if rising { piece + 1 } else { piece - 1 };
                while self.curve.piece(piece).is_step() {
                    piece = if rising { piece + 1 } else { piece - 1 };
                }
            }
        }
    }

    /// Cuts a piece until its error is within the tolerance.
    #[inline(never)]
    fn cut(&mut self, cell: &Cell<R>, mut start: R, end: R, piece: u32, [mut near, far]: [bool; 2]) {
        let all = <R::Lanes as Lanes<R>>::splat;
        let line = self.curve.piece(piece);
        if line.is_clear() && !self.rule.keep_clear {
            return;
        }
        let mut length = end - start;
        let mut halvings_left = MOST_HALVINGS;
        while length > R::ZERO {
            let mut chord = cell.chord(self.values, start, length, piece);
            // What rounding puts beyond the piece would be extrapolated, along lines that may be as steep as a
            // needle's.
            chord.density = chord.density.clamped(line.low, line.high);
            let measure = Measure::new(chord.density.store().map(all), all(length), [line; LANES]);
            let error = measure.error.store()[0];
            if error > R::of(self.rule.tolerance) * self.depth.exp() && halvings_left > 0 {
                halvings_left -= 1;
                length = R::of(0.5) * length;
                continue;
            }
            start += length;
            chord.jumps = [std::mem::take(&mut near), far && start >= end];
            self.segments.push(chord);
            self.depth += measure.depth.store()[0];
            length = (length + length).lesser(end - start);
        }
    }
}

/// Optical depths and error bounds of four chords, by which they are accepted or cut.
struct Measure<R: Real> {
    /// Coefficients of the densities' cubics, from the constant up.
    cubic: [R::Lanes; LANES],
    /// Optical depths.
    depth: R::Lanes,
    /// Bounds of the error in the light emitted.
    error: R::Lanes,
}

impl<R: Real> Measure<R> {
    /// Measures four chords, from densities by point, lengths, and the pieces of the curve.
    #[inline(always)]
    fn new<const C: usize>(density: [R::Lanes; LANES], length: R::Lanes, lines: [&Piece<R, C>; LANES]) -> Self {
        let of = |f: fn(&Piece<R, C>) -> R| R::Lanes::load(lines.map(f));
        let cubic = gauss::coefficients::<R>(density);
        let mean = gauss::integral::<R>(density);
        let slope = length * of(|p| p.extinction[1]);
        let middle = length * of(|p| p.extinction[0]) + slope * (cubic[0] - of(|p| p.base));
        let error = of(|p| p.steepest) * gauss::error::<R>(cubic, mean, middle, slope);
        Self { cubic, depth: middle + slope * (mean - cubic[0]), error }
    }
}

impl<R: Real, const C: usize> Rule<R, C> for ExactSource {
    type Segment = Chord<R>;

    const BOUNDED: bool = true;

    /// Returns zeros: the integral does not depend on where it is cut.
    #[inline(always)]
    fn vjp(&self, _: &Chord<R>, _: f64, _: f64) -> [f64; 3] {
        [0.0; 3]
    }

    #[inline(always)]
    fn jvp(&self, _: &Chord<R>, _: [f64; 3]) -> [f64; 2] {
        [0.0; 2]
    }

    #[inline(always)]
    fn segments(&self, curve: &Curve<R, C>, values: &[R], spans: &[Span<R>], segments: &mut Vec<Chord<R>>) {
        let all = <R::Lanes as Lanes<R>>::splat;
        let tolerance = R::of(self.tolerance);
        let mut cutter = Cutter { rule: self, curve, values, segments, depth: R::ZERO };
        cells(
            spans,
            #[inline(always)]
            |four, from, until| {
                let (at, end, length) = (from.store(), until.store(), (until - from).store());
                let whole = |i: usize| four[i].chord(values, at[i], length[i], 0);
                let mut whole = [whole(0), whole(1), whole(2), whole(3)];
                let density = R::Lanes::transpose(whole.map(|chord| chord.density));
                let (mut lines, mut fits) = ([curve.piece(0); LANES], [true; LANES]);
                if curve.len() > 1 {
                    let cubic = gauss::coefficients::<R>(density);
                    let (least, most) = gauss::hull::<R>(cubic);
                    // What rounding adds to the hull is no crossing.
                    let slack = all(R::of(8.0) * R::EPSILON) * least.abs().greater(most.abs());
                    let (least, most) = ((least + slack).store(), (most - slack).store());
                    for (i, middle) in cubic[0].store().into_iter().enumerate() {
                        whole[i].piece = curve.find(middle);
                        lines[i] = curve.piece(whole[i].piece);
                        fits[i] = lines[i].low <= least[i] && most[i] <= lines[i].high;
                    }
                }
                let measure = Measure::new(density, until - from, lines);
                let (errors, depths) = (measure.error.store(), measure.depth.store());
                for i in 0..LANES {
                    if !fits[i] {
                        let cubic = measure.cubic.map(|c| c.store()[i].f64());
                        cutter.split(&four[i], at[i], end[i], cubic);
                    } else if lines[i].is_clear() && !self.keep_clear {
                        continue;
                    } else if errors[i] <= tolerance || errors[i] <= tolerance * cutter.depth.exp() {
                        if whole[i].length > R::ZERO {
                            cutter.segments.push(whole[i]);
                        }
                        cutter.depth += depths[i];
                    } else {
                        cutter.cut(&four[i], at[i], end[i], whole[i].piece, [false; 2]);
                    }
                }
            },
        );
    }
}
