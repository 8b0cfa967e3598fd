//! Front-to-back blending of four stretches at a time.
//!
//! With `x` a stretch's optical depth, `T` the transmittance before it and `e` the mean of `σ c` over its length
//! h, it adds `T e h (1 - e^{-x}) / x`: colours count as mixed over a stretch.

use super::nodes::{FOURS, Queue};
use super::table::{Cumulative, End, Stretches};
use crate::lanes::{LANES, Lanes};
use crate::real::Real;
use crate::render::curve::Curve;

/// Optical depth above which a stretch is cut, unless there is but one colour.
const THICK: f64 = 0.5;
/// The most parts that a stretch is cut into, in fours.
const MOST_FOURS: usize = 16;
/// Optical depth below which `(1 - e^{-x}) / x` is a sum of seven terms: what is left out is below 1e-14.
const THIN: f64 = 0.05;

/// Four stretches in a row with their light.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lit<R: Real> {
    pub stretches: Stretches<R>,
    /// World lengths.
    pub length: R::Lanes,
    /// Optical depths x.
    pub depth: R::Lanes,
    /// Transmittance before and after.
    pub before: R::Lanes,
    pub beyond: R::Lanes,
    /// `T (1 - e^{-x}) / x`.
    pub share: R::Lanes,
}

impl<R: Real> Lit<R> {
    /// Derivative of [`Lit::share`] with respect to the stretch's own optical depth, at a fixed T.
    #[inline(always)]
    pub fn share_slope(&self) -> R::Lanes {
        let x = self.depth;
        let series = polynomial::<R>(x, [-1.0 / 2.0, 1.0 / 3.0, -1.0 / 8.0, 1.0 / 30.0, -1.0 / 144.0, 1.0 / 840.0]);
        x.select_above(R::Lanes::splat(R::of(THIN)), (self.beyond - self.share) / x, self.before * series)
    }
}

#[inline(always)]
fn polynomial<R: Real>(x: R::Lanes, [a, b, c, d, e, f]: [f64; 6]) -> R::Lanes {
    let all = |v: f64| R::Lanes::splat(R::of(v));
    all(a) + x * (all(b) + x * (all(c) + x * (all(d) + x * (all(e) + x * all(f)))))
}

/// State of the blend.
#[derive(Debug)]
pub(super) struct Front<'a, R: Real> {
    tables: &'a Cumulative<R>,
    curve: &'a Curve<R, 3>,
    last: End<R>,
    /// Optical depth so far.
    pub depth: f64,
    /// Transmittance so far, in the last lane.
    open: R::Lanes,
    /// Light so far, by channel.
    pub emitted: [f64; 3],
    /// Light of the stretches at hand, a share in each lane.
    adding: [R::Lanes; 3],
    stretches: &'a mut Row<R>,
}

/// Stretches that are made together.
#[derive(Debug, Clone)]
pub(super) struct Row<R: Real>([Stretches<R>; FOURS]);

impl<R: Real> Default for Row<R> {
    fn default() -> Self {
        Self([Stretches::NONE; FOURS])
    }
}

impl<'a, R: Real> Front<'a, R> {
    /// Where nothing has been met, at density zero.
    #[inline(always)]
    pub fn new(tables: &'a Cumulative<R>, curve: &'a Curve<R, 3>, stretches: &'a mut Row<R>) -> Self {
        let (open, adding) = (R::Lanes::splat(R::ONE), [R::Lanes::ZERO; 3]);
        Self { tables, curve, last: tables.zero, depth: 0.0, open, emitted: [0.0; 3], adding, stretches }
    }

    /// Moves what was added to the sums.
    #[inline(always)]
    fn settle(&mut self) {
        for (sum, adding) in self.emitted.iter_mut().zip(&mut self.adding) {
            *sum += std::mem::replace(adding, R::Lanes::ZERO).sum().f64();
        }
    }

    /// Adds stretches that end at so many fours of nodes; `see` gets them with their light, four by four: as they
    /// are, or, where one is too thick, each cut into so many times four.
    #[inline(always)]
    pub fn add(&mut self, values: &[R], queue: &Queue<R>, fours: usize, mut see: impl FnMut(usize, Lit<R>, usize)) {
        // Work of one kind for all of them, before work of the next: in each the fours do not wait for one another.
        let fours = fours.min(FOURS);
        let zero = R::Lanes::splat(R::ZERO);
        let mut density = [zero; FOURS];
        for (i, density) in density.iter_mut().enumerate().take(fours) {
            *density = self.tables.within(queue.four(i).densities(values));
        }
        let mut last = self.last;
        for i in 0..fours {
            self.stretches.0[i] = Stretches::new(self.tables, self.curve, &mut last, density[i]);
        }
        self.last = last;
        let thick = R::Lanes::splat(R::of(THICK));
        for i in 0..fours {
            let (stretches, length) = (self.stretches.0[i], queue.four(i).length);
            let depth = length * stretches.mean[3];
            if !self.tables.colourful || thick.reach(depth) {
                see(i, self.blend(&stretches, length), 0);
            } else {
                self.cut(&stretches, length, depth, |lit, fours| see(i, lit, fours));
            }
        }
        self.settle();
    }

    /// Adds a stretch of density zero.
    pub fn add_gap(&mut self, length: R) {
        let zero = R::Lanes::splat(R::ZERO);
        let stretches = Stretches::new(self.tables, self.curve, &mut self.last, zero);
        self.blend(&stretches, zero.after(length));
        self.settle();
    }

    /// Adds four stretches, each cut into so many times four that none is thick.
    #[inline(always)]
    fn cut(&mut self, whole: &Stretches<R>, length: R::Lanes, depth: R::Lanes, mut see: impl FnMut(Lit<R>, usize)) {
        let all = <R::Lanes as Lanes<R>>::splat;
        let thickest = depth.store().into_iter().fold(R::ZERO, Real::greater).f64();
        let fours = ((thickest / (LANES as f64 * THICK)).ceil() as usize).clamp(1, MOST_FOURS);
        let part = R::of(1.0 / (LANES * fours) as f64);
        let (begin, end, length) = (whole.ends[0].store(), whole.ends[1].store(), length.store());
        let mut last = whole.begin(self.tables);
        for i in 0..LANES {
            for four in 0..fours {
                let mut at = all(begin[i]) + all(end[i] - begin[i]) * shares::<R>(four, fours);
                if four + 1 == fours {
                    // The next one begins where this one ends, to the last bit.
                    let [a, b, c, _] = at.store();
                    at = R::Lanes::load([a, b, c, end[i]]);
                }
                let stretches = Stretches::new(self.tables, self.curve, &mut last, at);
                see(self.blend(&stretches, all(part * length[i])), fours);
            }
        }
    }

    #[inline(always)]
    fn blend(&mut self, stretches: &Stretches<R>, length: R::Lanes) -> Lit<R> {
        let all = <R::Lanes as Lanes<R>>::splat;
        let depth = (length * stretches.mean[3]).greater(all(R::ZERO));
        let running = depth.running();
        let beyond = (all(R::of(self.depth)) + running).fall();
        let before = beyond.after(self.open.store()[LANES - 1]);
        let series = polynomial::<R>(depth, [1.0, -1.0 / 2.0, 1.0 / 6.0, -1.0 / 24.0, 1.0 / 120.0, -1.0 / 720.0]);
        let share = depth.select_above(all(R::of(THIN)), (before - beyond) / depth, before * series);
        let weight = share * length;
        for c in 0..3 {
            self.adding[c] += weight * stretches.mean[c];
        }
        self.depth += running.store()[LANES - 1].f64();
        self.open = beyond;
        Lit { stretches: *stretches, length, depth, before, beyond, share }
    }
}

/// Shares of a stretch that lie before the ends of one four of its parts.
#[inline(always)]
pub(super) fn shares<R: Real>(four: usize, fours: usize) -> R::Lanes {
    let part = 1.0 / (LANES * fours) as f64;
    let at = |i: usize| R::of((LANES * four + i) as f64 * part);
    R::Lanes::load([at(1), at(2), at(3), at(4)])
}
