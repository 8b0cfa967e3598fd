//! Pre-integration (Engel, Kraus & Ertl 2001), cell by cell: what a transfer function adds between two
//! densities is the difference of cumulative tables, however many knots lie between.
//!
//! Along a stretch of a cell on which the density rises or falls from `d₀` to `d₁`, a share of the length falls
//! on each density: with `u = (d - d₀) / (d₁ - d₀)`, `dt = h (1 + c (2u - 1)) du`. The classical method takes
//! `c = 0`, a density that is linear; here c is such that the mean density is that of the cubic which the
//! density is. Extinctions that are linear in the density are integrated exactly, others with an error of
//! third order in the stretch. Within a stretch light is emitted as if its colour were mixed; stretches that
//! are too opaque for that, or too curved, are halved.

use super::Dvr;
use super::kernel::Blend;
use crate::lanes::{LANES, Lanes};
use crate::real::Real;
use crate::render::cubic;
use crate::render::curve::Curve;
use crate::render::gauss;
use crate::render::march::{IndexRay, batches};
use crate::render::rule::{Cell, cells};
use crate::scene::table::Table;

/// Extinction and the three channels' `σ c`.
const SUMS: usize = 4;

/// One piece of the table: sums up to its base, and the polynomials from there.
#[derive(Debug, Clone, Copy)]
struct Piece {
    base: f64,
    /// `∫ f dd` and `∫ f d dd` from the first knot to the base.
    below: [[f64; 2]; SUMS],
    /// Coefficients of f about the base.
    line: [[f64; 3]; SUMS],
    /// True if the colour varies with the density.
    colourful: bool,
}

/// Cumulative tables of a transfer function.
#[derive(Debug, Clone)]
pub(super) struct Cumulative(Vec<Piece>);

/// The sums at one density.
#[derive(Debug, Clone, Copy)]
struct At {
    density: f64,
    piece: u32,
    sums: [[f64; 2]; SUMS],
}

impl Cumulative {
    /// Of a table whose extinctions are multiplied by `scale`.
    pub fn new(table: &Table, scale: f64) -> Self {
        let mut below = [[0.0; 2]; SUMS];
        let count = table.knots().len() + 1;
        let pieces = (0..count).map(|p| {
            let ([low, high], [value, _]) = table.ends(p);
            let slope = table.slope_of(p);
            let (a, b) = (scale * value[3], scale * slope[3]);
            let lit = |c: usize| [a * value[c], a * slope[c] + b * value[c], b * slope[c]];
            let base = if p == 0 { high } else { low };
            let colourful = slope[..3] != [0.0; 3];
            let piece = Piece { base, below, line: [[a, b, 0.0], lit(0), lit(1), lit(2)], colourful };
            if p > 0 && high.is_finite() {
                below = piece.at(high);
            }
            piece
        });
        Self(pieces.collect())
    }

    #[inline(always)]
    fn at(&self, curve: &Curve<f32, 3>, density: f64) -> At {
        let piece = curve.find(density as f32);
        At { density, piece, sums: self.0[piece as usize].at(density) }
    }
}

impl Piece {
    #[inline(always)]
    fn at(&self, density: f64) -> [[f64; 2]; SUMS] {
        let d = density - self.base;
        std::array::from_fn(|k| {
            let [a, b, c] = self.line[k];
            let sum = d * (a + d * (b * (1.0 / 2.0) + d * (c * (1.0 / 3.0))));
            let moment = d * d * (a * (1.0 / 2.0) + d * (b * (1.0 / 3.0) + d * (c * (1.0 / 4.0))));
            [self.below[k][0] + sum, self.below[k][1] + self.base * sum + moment]
        })
    }
}

/// Optical depth above which a stretch of several colours is halved.
const THICK: f64 = 0.25;
/// Skew `c` above which a stretch of several knots is halved: towards a turn of the density the share of the
/// length grows faster than a line.
const SKEWED: f64 = 0.25;
/// The most halvings of a stretch, one within the other.
const MOST_HALVINGS: u32 = 5;

/// Front-to-back state.
struct Front<'a> {
    tables: &'a Cumulative,
    curve: &'a Curve<f32, 3>,
    emitted: [f64; 3],
    depth: f64,
    open: f64,
    /// The density at which the last stretch ended: most begin where it did.
    last: At,
}

impl Front<'_> {
    /// A stretch on which the density is monotone: `cubic` from `v0` to `v1`; `half` is half the world length
    /// of -1..1.
    #[inline(always)]
    fn stretch(&mut self, cubic: [f64; 4], [v0, v1]: [f64; 2], half: f64, halvings: u32) {
        let (d0, d1) = (cubic::at(cubic, v0), cubic::at(cubic, v1));
        let length = half * (v1 - v0);
        let from = if (self.last.density - d0).abs() <= 1e-7 * (1.0 + d0.abs()) {
            self.last
        } else {
            self.tables.at(self.curve, d0)
        };
        let to = self.tables.at(self.curve, d1);
        let mean = cubic::mean(cubic, v0, v1);
        let width = to.density - from.density;
        let Piece { base, line, colourful, .. } = &self.tables.0[to.piece as usize];
        let mut sums = [0.0; SUMS];
        let mut mixed = *colourful;
        if from.piece == to.piece || width.abs() < 1e-9 * (1.0 + d0.abs()) {
            // One line: the mean density tells the depth; colour times extinction asks for its variance too,
            // here that of the same distribution of lengths.
            let d = mean - base;
            let skewed = 6.0 * (mean - from.density) - 3.0 * width;
            let variance = (width * width * (1.0 / 12.0) - skewed * skewed * (1.0 / 36.0)).max(0.0);
            for (sum, [a, b, c]) in sums.iter_mut().zip(line) {
                *sum = length * (a + d * (b + d * c) + variance * c);
            }
        } else {
            mixed = true;
            let inverse = 1.0 / width;
            let skew = 6.0 * (mean - from.density) * inverse - 3.0;
            if skew.abs() > SKEWED && halvings > 0 {
                self.halves(cubic, [v0, v1], half, halvings - 1);
                return;
            }
            let skew = skew.clamp(-1.0, 1.0);
            for (k, sum) in sums.iter_mut().enumerate() {
                let plain = to.sums[k][0] - from.sums[k][0];
                let moment = (to.sums[k][1] - from.sums[k][1]) - from.density * plain;
                *sum = length * inverse * ((1.0 - skew) * plain + 2.0 * skew * inverse * moment);
            }
        }
        if mixed && sums[0] > THICK && halvings > 0 {
            self.halves(cubic, [v0, v1], half, halvings - 1);
            return;
        }
        self.last = to;
        let depth = sums[0].max(0.0);
        if depth == 0.0 {
            return;
        }
        self.depth += depth;
        let beyond = (-self.depth).exp();
        let share = (self.open - beyond) / depth;
        for c in 0..3 {
            self.emitted[c] += sums[1 + c] * share;
        }
        self.open = beyond;
    }

    #[inline(never)]
    fn halves(&mut self, cubic: [f64; 4], [v0, v1]: [f64; 2], half: f64, halvings: u32) {
        let middle = 0.5 * (v0 + v1);
        self.stretch(cubic, [v0, middle], half, halvings);
        self.stretch(cubic, [middle, v1], half, halvings);
    }

    #[inline(never)]
    fn halved(&mut self, cubic: [f64; 4], ends: [f64; 2], half: f64, halvings: u32) {
        self.stretch(cubic, ends, half, halvings);
    }
}

/// Light along a ray.
#[inline(always)]
pub(super) fn blend<R: Real>(dvr: &Dvr<'_, R>, tables: &Cumulative, curve: &Curve<f32, 3>, ray: &IndexRay) -> Blend<3> {
    let values = &dvr.field.values;
    let start = tables.at(curve, 0.0);
    let mut front = Front { tables, curve, emitted: [0.0; 3], depth: 0.0, open: 1.0, last: start };
    let mut last = ray.enter;
    batches(
        &dvr.visible,
        ray,
        #[inline(always)]
        |spans| {
            cells(
                spans,
                #[inline(always)]
                |four: [Cell<R>; LANES], from: R::Lanes, until: R::Lanes| {
                    let (at, length) = (from.store(), (until - from).store());
                    let density = |i: usize| four[i].densities(values, at[i], length[i]);
                    let density = R::Lanes::transpose([density(0), density(1), density(2), density(3)]);
                    let cubics = gauss::coefficients::<R>(density);
                    let c = cubics.map(Lanes::store);
                    for i in 0..LANES {
                        if length[i] <= R::ZERO {
                            continue;
                        }
                        let cubic = [c[0][i].f64(), c[1][i].f64(), c[2][i].f64(), c[3][i].f64()];
                        let half = 0.5 * length[i].f64();
                        if cubic[1].abs() >= 2.0 * cubic[2].abs() + 3.0 * cubic[3].abs() {
                            front.stretch(cubic, [-1.0, 1.0], half, MOST_HALVINGS);
                        } else {
                            for ends in cubic::turns(cubic).windows(2).filter(|ends| ends[1] > ends[0]) {
                                front.halved(cubic, [ends[0], ends[1]], half, MOST_HALVINGS);
                            }
                        }
                    }
                },
            );
            last = spans[0].start;
            front.depth < dvr.depth_limit
        },
    );
    Blend { emitted: front.emitted, depth: front.depth, last }
}
