//! Quadrature rules: how a ray's spans are cut into segments.

use crate::real::Real;
use crate::real::{LANES, Lanes};
use crate::render::cell::{Crossings, MOST, Quartet, chord_weights, corners, crossings, gather, low, offsets, weights};
use crate::render::cubic;
use crate::render::curve::{Curve, Piece};
use crate::render::gauss;
use crate::render::march::{BATCH, Span};
use crate::render::segment::{Chord, Sample};

/// Cuts spans into segments.
pub trait Rule<R: Real, const C: usize>: Copy + Sync {
    /// Type of the segments.
    type Segment: Copy;
    /// Appends the segments of at most [`BATCH`] spans, near to far, with the densities in them.
    fn segments(&self, curve: &Curve<R, C>, values: &[R], spans: &[Span<R>], segments: &mut Vec<Self::Segment>);
    /// True if the segments partition [entry, exit]; only then are boundary terms the derivatives with respect to its
    /// ends. Else [`Rule::moved`] returns them.
    const BOUNDED: bool;
    /// Returns the derivatives with respect to entry, exit and step (world lengths), from those with respect to a
    /// segment's length and position.
    fn moved(&self, segment: &Self::Segment, by_length: f64, by_position: f64) -> [f64; 3];
    /// Returns the change of a segment's length and position for changes of entry, exit and step: the transpose of
    /// [`Rule::moved`].
    fn carried(&self, segment: &Self::Segment, by: [f64; 3]) -> [f64; 2];
}

/// Cuts spans into cells with weights, for optical depths alone.
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
        let at = all_crossings(spans);
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

/// Returns the crossings of a batch of spans.
#[inline(always)]
fn all_crossings<R: Real>(spans: &[Span<R>]) -> [Crossings<R>; BATCH] {
    let mut at = [[R::ZERO; MOST + 1]; BATCH];
    for (spans, at) in spans.chunks(LANES).zip(at.as_chunks_mut().0) {
        let last = spans.len() - 1;
        crossings([0, 1, 2, 3].map(|i| &spans[last.min(i)]), at);
    }
    at
}

/// Exact quadrature where the source varies: cells are cut where the density crosses a knot of the curve, and further
/// until four Gauss points err by less than a tolerance in the light of a piece.
#[derive(Debug, Clone, Copy)]
pub struct ExactSource {
    /// Radiance error allowed per piece, as it arrives at the eye, in units of the curve's source.
    pub tolerance: f64,
    /// True to keep pieces in which nothing is absorbed, for derivatives with respect to the transfer function.
    pub keep_clear: bool,
}

/// The most halvings of a piece. (An error falls 500 times when the length is halved, and behind an optical depth of 20
/// no light arrives: no piece that matters needs as many.)
const MOST_HALVINGS: usize = 256;

/// A cell that a ray crosses.
#[derive(Debug, Clone, Copy)]
pub struct Cell<R: Real> {
    /// Offset of the cell's lowest corner among the field's values.
    offset: usize,
    /// World length from the ray's origin to the span's entry.
    begin: f64,
    /// Cell-local coordinates of the span's entry, the same in all lanes.
    entry: [R::Lanes; 3],
    /// Cell-local coordinates gained per world length.
    along: [R::Lanes; 3],
}

/// Visits the cells of at most [`BATCH`] spans of one ray, near to far, four at a time, with the world lengths from the
/// span's entry at which they are entered and left. Padding cells have no length.
#[inline(always)]
pub fn cells<R: Real>(spans: &[Span<R>], mut visit: impl FnMut([Cell<R>; LANES], R::Lanes, R::Lanes)) {
    let all = <R::Lanes as Lanes<R>>::splat;
    for (span, at) in spans.iter().zip(&all_crossings(spans)) {
        let ([x, y, z], [dx, dy, dz]) = (span.entry, span.direction);
        let along = [all(dx), all(dy), all(dz)];
        for at in at.windows(LANES + 1).step_by(LANES) {
            if at[0] >= span.length {
                break;
            }
            let from = R::Lanes::load([at[0], at[1], at[2], at[3]]);
            let until = R::Lanes::load([at[1], at[2], at[3], at[4]]);
            let middle = all(R::of(0.5)) * (from + until);
            let low =
                [low(all(x) + middle * along[0]), low(all(y) + middle * along[1]), low(all(z) + middle * along[2])];
            let offset = offsets(low);
            let [ex, ey, ez] = [(all(x) - low[0]).store(), (all(y) - low[1]).store(), (all(z) - low[2]).store()];
            let cell = |i: usize| Cell {
                offset: span.base + offset[i] as usize,
                begin: span.start,
                entry: [all(ex[i]), all(ey[i]), all(ez[i])],
                along,
            };
            visit([cell(0), cell(1), cell(2), cell(3)], from, until);
        }
    }
}

impl<R: Real> Cell<R> {
    /// Returns the world length from the ray's origin to a length from the span's entry.
    #[inline(always)]
    pub fn reached(&self, from: R) -> f64 {
        self.begin + from.f64()
    }

    /// Returns the densities at the four points of [`gauss`] on a segment.
    #[inline(always)]
    pub fn densities(&self, values: &[R], start: R, length: R) -> R::Lanes {
        Chord::<R>::interpolate(&corners(values, self.offset), self.at(start, length))
    }

    /// Returns the offset of the lowest corner, and cell-local coordinates, of the points at two lengths from the
    /// span's entry.
    #[inline(always)]
    pub fn places(&self, [near, far]: [R; 2]) -> (usize, [[R; 3]; 2]) {
        let t = R::Lanes::load([near, far, R::ZERO, R::ZERO]);
        let [x, y, z] = [0, 1, 2].map(|a| (self.entry[a] + t * self.along[a]).store());
        (self.offset, [[x[0], y[0], z[0]], [x[1], y[1], z[1]]])
    }

    /// Returns the cell-local coordinates of the four points of [`gauss`] on a segment.
    #[inline(always)]
    fn at(&self, start: R, length: R) -> [R::Lanes; 3] {
        let all = <R::Lanes as Lanes<R>>::splat;
        let t = all(start) + all(length) * gauss::lanes::<R>(gauss::NODES);
        let ([x, y, z], [dx, dy, dz]) = (self.entry, self.along);
        [x + t * dx, y + t * dy, z + t * dz]
    }

    #[inline(always)]
    fn chord(&self, values: &[R], start: R, length: R, piece: u32) -> Chord<R> {
        let at = self.at(start, length);
        let density = Chord::<R>::interpolate(&corners(values, self.offset), at);
        Chord { offset: self.offset, piece, length, start: R::of(self.reached(start)), at, density, jumps: [false; 2] }
    }
}

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
    fn moved(&self, _: &Chord<R>, _: f64, _: f64) -> [f64; 3] {
        [0.0; 3]
    }

    #[inline(always)]
    fn carried(&self, _: &Chord<R>, _: [f64; 3]) -> [f64; 2] {
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

/// Steps of constant world length from the ray's entry into the field's box.
#[derive(Debug, Clone, Copy)]
pub struct Uniform {
    /// World length of a step.
    pub step: f64,
    /// Position of the sample within its step: 0 at the start, 0.5 in the middle.
    pub phase: f64,
    /// World length from the ray's origin at which the first step begins.
    pub enter: f64,
    /// World length from the ray's origin at which the last step is cut.
    pub leave: f64,
}

impl Uniform {
    fn steps(&self) -> u64 {
        ((self.leave - self.enter) / self.step).ceil().max(1.0) as u64
    }

    /// Returns sample position and length of step `k`; the last step is cut at the exit.
    #[inline(always)]
    fn step(&self, k: u64) -> (f64, f64) {
        let begin = self.enter + k as f64 * self.step;
        let length = self.step.min(self.leave - begin);
        (begin + self.phase * length, length)
    }

    /// Returns the number of steps whose sample lies before `t`.
    #[inline(always)]
    fn before(&self, t: f64) -> u64 {
        let last = self.steps() - 1;
        let whole = ((t - self.enter) / self.step - self.phase).ceil().max(0.0) as u64;
        if whole < last { whole } else { last + u64::from(self.step(last).0 < t) }
    }
}

impl Uniform {
    /// Visits the samples on spans: number of the step and world length from the ray's origin to its sample, offset of
    /// the cell, world length of the step, cell-local coordinates.
    #[inline(always)]
    fn samples<R: Real>(&self, spans: &[Span<R>], mut visit: impl FnMut((u64, f64), usize, R, [R; 3])) {
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
                visit((k, position), offset, R::of(length), m);
            }
        }
    }
}

impl<R: Real, const C: usize> Rule<R, C> for Uniform {
    type Segment = Sample<R>;

    #[inline(always)]
    fn segments(&self, curve: &Curve<R, C>, values: &[R], spans: &[Span<R>], segments: &mut Vec<Sample<R>>) {
        self.samples(spans, |(number, position), offset, length, at| {
            let density = gather(&weights(at), &corners(values, offset));
            segments.push(Sample { offset, piece: curve.find(density), length, at, density, number, position });
        });
    }

    const BOUNDED: bool = false;

    #[inline(always)]
    fn moved(&self, sample: &Sample<R>, by_length: f64, by_position: f64) -> [f64; 3] {
        let number = sample.number as f64;
        if sample.number + 1 < self.steps() {
            return [by_position, 0.0, (number + self.phase) * by_position + by_length];
        }
        let begin = (1.0 - self.phase) * by_position - by_length;
        [begin, self.phase * by_position + by_length, number * begin]
    }

    #[inline(always)]
    fn carried(&self, sample: &Sample<R>, [enter, leave, step]: [f64; 3]) -> [f64; 2] {
        let number = sample.number as f64;
        let begin = enter + number * step;
        let length = if sample.number + 1 < self.steps() { step } else { leave - begin };
        [length, begin + self.phase * length]
    }
}

impl<R: Real> DepthRule<R> for Uniform {
    #[inline(always)]
    fn cells(&self, spans: &[Span<R>], cells: &mut Vec<Quartet<R>>) {
        let empty = Quartet { offset: [0; LANES], weights: [[R::Lanes::splat(R::ZERO); 2]; LANES] };
        let (mut four, mut count) = (empty, 0);
        self.samples(spans, |_, offset, length, at| {
            let ([near, far], length) = (weights(at), R::Lanes::splat(length));
            four.offset[count] = offset as u32;
            four.weights[count] = [near * length, far * length];
            count += 1;
            if count == LANES {
                cells.push(four);
                (four, count) = (empty, 0);
            }
        });
        if count > 0 {
            cells.push(four);
        }
    }
}
