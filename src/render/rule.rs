//! Quadrature rules: what a ray's spans are cut into.

use crate::lanes::{LANES, Lanes};
use crate::real::Real;
use crate::render::cell::{Crossings, MOST, Quartet, chord_weights, corners, crossings, gather, low, offsets, weights};
use crate::render::gauss;
use crate::render::march::{BATCH, Span};
use crate::render::segment::{Chord, Sample};

/// Cuts spans into segments.
pub trait Rule<R: Real>: Copy + Sync {
    /// What it cuts them into.
    type Segment: Copy;
    /// Appends the segments of at most [`BATCH`] spans, near to far, with the densities in them.
    fn segments(&self, values: &[R], spans: &[Span<R>], segments: &mut Vec<Self::Segment>);
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

/// Crossings of a batch.
#[inline(always)]
fn all_crossings<R: Real>(spans: &[Span<R>]) -> [Crossings<R>; BATCH] {
    let mut at = [[R::ZERO; MOST + 1]; BATCH];
    for (spans, at) in spans.chunks(LANES).zip(at.as_chunks_mut().0) {
        let last = spans.len() - 1;
        crossings([0, 1, 2, 3].map(|i| &spans[last.min(i)]), at);
    }
    at
}

/// Cells, each cut until what four Gauss points lose of the light from a piece is below a stated error.
#[derive(Debug, Clone, Copy)]
pub struct ExactSource {
    /// Extinction per unit of density.
    pub extinction: f64,
    /// Error allowed per piece, as it arrives at the eye, over the radiance of the source per unit of
    /// density.
    pub tolerance: f64,
}

/// The most halvings in a cell. (An error falls 500 times when the length is halved, and behind an
/// optical depth of 20 none arrives: no cell that means anything has as many.)
const MOST_HALVINGS: usize = 256;

/// A cell that a ray crosses.
struct Cell<R: Real> {
    /// Offset of its lowest corner.
    offset: usize,
    /// Cell-local coordinates of the span's entry, the same in all lanes.
    entry: [R::Lanes; 3],
    /// Coordinates gained per world length.
    along: [R::Lanes; 3],
}

impl<R: Real> Cell<R> {
    #[inline(always)]
    fn chord(&self, values: &[R], start: R, length: R) -> Chord<R> {
        let all = <R::Lanes as Lanes<R>>::splat;
        let t = all(start) + all(length) * gauss::lanes::<R>(gauss::NODES);
        let ([x, y, z], [dx, dy, dz]) = (self.entry, self.along);
        let at = [x + t * dx, y + t * dy, z + t * dz];
        let density = Chord::<R>::interpolate(&corners(values, self.offset), at);
        Chord { offset: self.offset, length, at, density }
    }
}

impl ExactSource {
    /// Cuts a cell, `depth` behind the batch's beginning; returns the depth behind the cell.
    #[inline(never)]
    fn cut<R: Real>(
        &self,
        cell: &Cell<R>,
        values: &[R],
        mut start: R,
        end: R,
        mut depth: R,
        segments: &mut Vec<Chord<R>>,
    ) -> R {
        let all = <R::Lanes as Lanes<R>>::splat;
        let (extinction, tolerance) = (R::of(self.extinction), R::of(self.tolerance));
        let mut length = R::of(0.5) * (end - start);
        let mut halvings_left = MOST_HALVINGS;
        while length > R::ZERO {
            let chord = cell.chord(values, start, length);
            let density = chord.density.store().map(all);
            let x = all(extinction * length);
            if gauss::error::<R>(density, x).store()[0] > tolerance * depth.exp() && halvings_left > 0 {
                halvings_left -= 1;
                length = R::of(0.5) * length;
                continue;
            }
            segments.push(chord);
            depth += (x * gauss::integral::<R>(density)).store()[0];
            start += length;
            length = (length + length).lesser(end - start);
        }
        depth
    }
}

impl<R: Real> Rule<R> for ExactSource {
    type Segment = Chord<R>;

    #[inline(always)]
    fn segments(&self, values: &[R], spans: &[Span<R>], segments: &mut Vec<Chord<R>>) {
        let all = <R::Lanes as Lanes<R>>::splat;
        let (extinction, tolerance) = (R::of(self.extinction), R::of(self.tolerance));
        // Since the batch began: what is nearer makes the light from here only fainter.
        let mut depth = R::ZERO;
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
                    entry: [all(ex[i]), all(ey[i]), all(ez[i])],
                    along,
                };
                let whole = |i: usize| cell(i).chord(values, at[i], at[i + 1] - at[i]);
                let whole = [whole(0), whole(1), whole(2), whole(3)];
                let density = R::Lanes::transpose(whole.map(|chord| chord.density));
                let scale = all(extinction) * (until - from);
                let errors = gauss::error::<R>(density, scale).store();
                let depths = (scale * gauss::integral::<R>(density)).store();
                for i in 0..LANES {
                    if errors[i] <= tolerance || errors[i] <= tolerance * depth.exp() {
                        if whole[i].length > R::ZERO {
                            segments.push(whole[i]);
                        }
                        depth += depths[i];
                    } else {
                        depth = self.cut(&cell(i), values, at[i], at[i + 1], depth, segments);
                    }
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

impl Uniform {
    /// The samples on spans: offset of the cell, world length, interpolation weights.
    #[inline(always)]
    fn samples<R: Real>(&self, spans: &[Span<R>], mut visit: impl FnMut(usize, R, [R::Lanes; 2])) {
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
                visit(offset, R::of(length), weights(m));
            }
        }
    }
}

impl<R: Real> Rule<R> for Uniform {
    type Segment = Sample<R>;

    #[inline(always)]
    fn segments(&self, values: &[R], spans: &[Span<R>], segments: &mut Vec<Sample<R>>) {
        self.samples(spans, |offset, length, weights| {
            let density = gather(&weights, &corners(values, offset));
            segments.push(Sample { offset, length, weights, density });
        });
    }
}

impl<R: Real> DepthRule<R> for Uniform {
    #[inline(always)]
    fn cells(&self, spans: &[Span<R>], cells: &mut Vec<Quartet<R>>) {
        let empty = Quartet { offset: [0; LANES], weights: [[R::Lanes::splat(R::ZERO); 2]; LANES] };
        let (mut four, mut count) = (empty, 0);
        self.samples(spans, |offset, length, [near, far]| {
            let length = R::Lanes::splat(length);
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
