//! Quadrature rules: what a ray's spans are cut into.

use crate::lanes::{LANES, Lanes};
use crate::real::Real;
use crate::render::cell::{MOST, Piece, Quartet, chord_weights, corners, crossings, low, offsets, weights};
use crate::render::march::{BATCH, Span};

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

impl Uniform {
    /// The samples on spans, as pieces.
    #[inline(always)]
    fn samples<R: Real>(&self, spans: &[Span<R>], mut visit: impl FnMut(Piece<R, 1>)) {
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
                visit(Piece { offset, length: R::of(length), nodes: [weights(m)] });
            }
        }
    }
}

impl<R: Real> Rule<R, 1> for Uniform {
    #[inline(always)]
    fn pieces(&self, _: &[R], spans: &[Span<R>], pieces: &mut Vec<Piece<R, 1>>) {
        self.samples(spans, |piece| pieces.push(piece));
    }
}

impl<R: Real> DepthRule<R> for Uniform {
    #[inline(always)]
    fn cells(&self, spans: &[Span<R>], cells: &mut Vec<Quartet<R>>) {
        let empty = Quartet { offset: [0; LANES], weights: [[R::Lanes::splat(R::ZERO); 2]; LANES] };
        let (mut four, mut count) = (empty, 0);
        self.samples(spans, |piece| {
            let ([near, far], length) = (piece.nodes[0], R::Lanes::splat(piece.length));
            four.offset[count] = piece.offset as u32;
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
