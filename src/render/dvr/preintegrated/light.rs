//! Front-to-back blending of four stretches at a time.
//!
//! With `x` a stretch's optical depth, `T` the transmittance before it, `e` the mean of `σ c` over its length h, and `d`
//! the change of the colour c from its begin to its end, it adds `T (e h A + d B)`, where `A = (1 - e^{-x}) / x` and
//! `B = A - (1 + e^{-x}) / 2`: this has no error where the colour is linear in the optical depth.

use super::nodes::{FOURS, Queue};
use super::table::{Cumulative, End, Stretches};
use crate::lanes::{LANES, Lanes};
use crate::real::Real;
use crate::render::curve::Curve;

/// The most parts that a stretch is cut into, in fours.
const MOST_FOURS: usize = 16;
/// Optical depth below which B is a sum of powers.
const THIN: f64 = 0.5;
/// Factors of the powers, from the second on: `(-1)^k (1/(k+1)! - 1/(2 k!))`; what is left out is below 1e-15.
const POWERS: [f64; 11] = [
    -1.0 / 12.0,
    1.0 / 24.0,
    -1.0 / 80.0,
    1.0 / 360.0,
    -1.0 / 2016.0,
    1.0 / 13440.0,
    -1.0 / 103_680.0,
    1.0 / 907_200.0,
    -1.0 / 8_870_400.0,
    1.0 / 95_800_320.0,
    -1.0 / 1_132_185_600.0,
];

/// Four stretches in a row with their light.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lit<R: Real> {
    pub stretches: Stretches<R>,
    /// World lengths.
    pub length: R::Lanes,
    /// Optical depths x.
    pub depth: R::Lanes,
    /// Transmittance before.
    pub before: R::Lanes,
    pub shares: Shares<R>,
}

/// A and B.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shares<R: Real> {
    /// `e^{-x}`.
    pub open: R::Lanes,
    pub mixed: R::Lanes,
    pub drift: R::Lanes,
}

impl<R: Real> Shares<R> {
    #[inline(always)]
    fn new(depth: R::Lanes, open: R::Lanes) -> Self {
        let all = |v: f64| R::Lanes::splat(R::of(v));
        let ends = all(0.5) * (all(1.0) + open);
        let thin = depth * depth * powers::<R>(depth, |_, factor| factor);
        // Never zero where it is divided by.
        let mixed = (all(1.0) - open) / depth.greater(all(THIN));
        let drift = depth.select_above(all(THIN), mixed - ends, thin);
        Self { open, mixed: depth.select_above(all(THIN), mixed, thin + ends), drift }
    }

    /// Derivatives of A and B with respect to x.
    #[inline(always)]
    pub fn slopes(&self, depth: R::Lanes) -> [R::Lanes; 2] {
        let all = |v: f64| R::Lanes::splat(R::of(v));
        let half = all(0.5) * self.open;
        let thin = depth * powers::<R>(depth, |power, factor| power * factor);
        let mixed = (self.open - self.mixed) / depth.greater(all(THIN));
        [depth.select_above(all(THIN), mixed, thin - half), depth.select_above(all(THIN), mixed + half, thin)]
    }
}

/// The sum of powers without the first two, each factor as told by its power.
#[inline(always)]
fn powers<R: Real>(x: R::Lanes, factor: impl Fn(f64, f64) -> f64) -> R::Lanes {
    // Single precision has enough of seven.
    let count = if R::EPSILON.f64() > 1e-10 { 7 } else { POWERS.len() };
    let of = |k: usize| R::Lanes::splat(R::of(factor((k + 2) as f64, POWERS[k])));
    let mut sum = of(count - 1);
    for k in (0..count - 1).rev() {
        sum = of(k) + x * sum;
    }
    sum
}

/// State of the blend.
#[derive(Debug)]
pub(super) struct Front<'a, R: Real> {
    tables: &'a Cumulative<R>,
    curve: &'a Curve<R, 3>,
    last: End<R>,
    /// Optical depth so far.
    pub depth: f64,
    /// Transmittance so far.
    open: R,
    /// Light so far, by channel.
    pub emitted: [f64; 3],
    /// Light of the stretches at hand, a share in each lane.
    adding: [R::Lanes; 3],
}

impl<'a, R: Real> Front<'a, R> {
    /// Where nothing has been met, at density zero.
    #[inline(always)]
    pub fn new(tables: &'a Cumulative<R>, curve: &'a Curve<R, 3>) -> Self {
        let (open, adding) = (R::ONE, [R::Lanes::ZERO; 3]);
        Self { tables, curve, last: tables.zero, depth: 0.0, open, emitted: [0.0; 3], adding }
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
        for (i, density) in density.iter().enumerate().take(fours) {
            let stretches = Stretches::new(self.tables, self.curve, &mut self.last, *density);
            let length = queue.four(i).length;
            let depth = (length * stretches.mean[3]).greater(zero);
            let shares = Shares::new(depth, depth.fall());
            let off = Lanes::<R>::abs(shares.drift * length) * stretches.bent();
            let allowed = R::Lanes::splat(self.tables.limit) * depth;
            if allowed.reach(off) {
                see(i, self.blend(&stretches, length, depth, shares), 0);
            } else {
                self.cut(&stretches, length, off / allowed.greater(R::Lanes::splat(R::EPSILON)), |lit, fours| {
                    see(i, lit, fours);
                });
            }
        }
        self.settle();
    }

    /// Adds a stretch of density zero.
    pub fn add_gap(&mut self, length: R) {
        let zero = R::Lanes::splat(R::ZERO);
        let stretches = Stretches::new(self.tables, self.curve, &mut self.last, zero);
        let length = zero.after(length);
        let depth = length * stretches.mean[3];
        self.blend(&stretches, length, depth, Shares::new(depth, depth.fall()));
        self.settle();
    }

    /// Adds four stretches, each cut into so many times four that none is off by more than is allowed; they are
    /// `times` that, and that falls with the square of the number of parts.
    #[inline(never)]
    fn cut(&mut self, whole: &Stretches<R>, length: R::Lanes, times: R::Lanes, mut see: impl FnMut(Lit<R>, usize)) {
        let all = <R::Lanes as Lanes<R>>::splat;
        let worst = times.store().into_iter().fold(R::ZERO, Real::greater).f64();
        let fours = ((worst.sqrt() / LANES as f64).ceil() as usize).clamp(1, MOST_FOURS);
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
                let length = all(part * length[i]);
                let depth = (length * stretches.mean[3]).greater(all(R::ZERO));
                see(self.blend(&stretches, length, depth, Shares::new(depth, depth.fall())), fours);
            }
        }
    }

    #[inline(always)]
    fn blend(&mut self, stretches: &Stretches<R>, length: R::Lanes, depth: R::Lanes, shares: Shares<R>) -> Lit<R> {
        let beyond = shares.open.running_product();
        let before = R::Lanes::splat(self.open) * beyond.after(R::ONE);
        let (mixed, drift) = (before * shares.mixed * length, before * shares.drift);
        let change = stretches.drift();
        for c in 0..3 {
            self.adding[c] += mixed * stretches.mean[c] + drift * change[c];
        }
        self.depth += depth.sum().f64();
        self.open = self.open * beyond.store()[LANES - 1];
        Lit { stretches: *stretches, length, depth, before, shares }
    }
}

/// Shares of a stretch that lie before the ends of one four of its parts.
#[inline(always)]
pub(super) fn shares<R: Real>(four: usize, fours: usize) -> R::Lanes {
    let part = 1.0 / (LANES * fours) as f64;
    let at = |i: usize| R::of((LANES * four + i) as f64 * part);
    R::Lanes::load([at(1), at(2), at(3), at(4)])
}
