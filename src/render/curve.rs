//! Extinction and source as kernels need them: piecewise linear in the density, in the kernel's own precision, with a
//! lookup by density.

use crate::real::Real;
use crate::real::{LANES, Lanes};
use crate::scene::table::Table;

/// One linear piece of a [`Curve`]. It begins where the previous one ends; the outermost pieces extend to infinity.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Piece<R, const C: usize> {
    /// Density at the lower end.
    pub low: R,
    /// Density at the upper end.
    pub high: R,
    /// Density at which the linear functions have their constant terms.
    pub base: R,
    /// Extinction at `base`, and its slope with the density.
    pub extinction: [R; 2],
    /// Radiance of the source at `base`, and its slope with the density, by channel.
    pub source: [[R; 2]; C],
    /// The largest magnitude of the source's slopes.
    pub steepest: R,
    /// Reciprocal of the piece's width in density; zero for the outermost pieces.
    inverse_width: R,
    /// Share of the upper end in the value at `base`.
    upper: R,
    /// True where the function jumps: at the lower end, at the upper end.
    pub jumps: [bool; 2],
}

impl<R: Real, const C: usize> Piece<R, C> {
    /// Returns the weight of the upper end's value in the value at a density; the lower end has the rest.
    #[inline(always)]
    pub(crate) fn fraction(&self, density: R) -> R {
        self.upper + (density - self.base) * self.inverse_width
    }

    /// Returns the derivative of [`Piece::fraction`] with respect to the density.
    #[inline(always)]
    pub(crate) fn fraction_slope(&self) -> R {
        self.inverse_width
    }

    /// Returns extinction and source at a density, extrapolated from this piece.
    pub(crate) fn side(&self, density: R) -> Side<C> {
        let at = |[at_base, slope]: [R; 2]| at_base.f64() + slope.f64() * (density - self.base).f64();
        Side { extinction: at(self.extinction), source: self.source.map(at) }
    }

    /// True if the piece has no width: it lies between the two coincident knots of a step.
    pub(crate) fn is_step(&self) -> bool {
        self.low == self.high
    }

    /// True if the piece neither absorbs nor emits anywhere.
    #[inline(always)]
    pub(crate) fn is_clear(&self) -> bool {
        self.extinction[0] == R::ZERO && self.extinction[1] == R::ZERO
    }
}

/// Extinction and source at one side of a step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Side<const C: usize> {
    /// Extinction.
    pub extinction: f64,
    /// Radiance of the source.
    pub source: [f64; C],
}

impl<const C: usize> Side<C> {
    /// Returns extinction, and extinction times source by channel, on this side of a step; then the same quantities
    /// minus their means over a linear ramp to the other side.
    pub(crate) fn sides(&self, other: &Self) -> [(f64, [f64; C]); 2] {
        let (a, b) = (self, other);
        let emitted = std::array::from_fn(|c| a.extinction * a.source[c]);
        // The mean of a product of two linear functions.
        let mean = |c: usize| {
            let (near, far) = (a.extinction * (2.0 * a.source[c] + b.source[c]), a.source[c] + 2.0 * b.source[c]);
            (near + b.extinction * far) / 6.0
        };
        let more = std::array::from_fn(|c| a.extinction * a.source[c] - mean(c));
        [(a.extinction, emitted), (0.5 * (a.extinction - b.extinction), more)]
    }
}

/// One linear piece as four lanes: red, green, blue and extinction.
#[derive(Debug, Clone, Copy)]
struct Line<R: Real> {
    /// Values at `base`.
    value: R::Lanes,
    /// Slopes with the density.
    slope: R::Lanes,
    base: R,
}

impl<R: Real> Line<R> {
    fn new(piece: &Piece<R, 3>) -> Self {
        let of = |i: usize| {
            R::Lanes::load([piece.source[0][i], piece.source[1][i], piece.source[2][i], piece.extinction[i]])
        };
        Self { value: of(0), slope: of(1), base: piece.base }
    }

    /// Returns red, green, blue and extinction at a density.
    #[inline(always)]
    fn at(&self, density: R) -> R::Lanes {
        self.value + R::Lanes::splat(density - self.base) * self.slope
    }
}

/// A piecewise linear function of the density with `C` channels of source.
#[derive(Debug, Clone)]
pub(crate) struct Curve<R: Real, const C: usize> {
    pieces: Vec<Piece<R, C>>,
    /// The pieces again, of a transfer function.
    lines: Vec<Line<R>>,
    /// Buckets, which divide the range of the knots evenly.
    buckets: Vec<Bucket<R>>,
    first: R,
    buckets_per_density: R,
    /// True if each bucket is a piece, because the knots are evenly spaced.
    regular: bool,
    /// True if a bucket has several densities with knots, so that its piece has to be searched.
    crowded: bool,
}

/// A part of the range of a [`Curve`]'s knots. Densities next to its ends may be looked up in the next bucket, by
/// rounding.
#[derive(Debug, Clone, Copy)]
struct Bucket<R> {
    /// Density of the first knot in the bucket; the greatest number if there is none.
    knot: R,
    /// Pieces at the bucket's ends.
    pieces: [u32; 2],
}

impl<R: Real> Bucket<R> {
    fn between<const C: usize>(pieces: &[Piece<R, C>], ends: [f64; 2]) -> Self {
        let [below, above] =
            ends.map(|end| pieces.partition_point(|p| p.high <= R::of(end)).min(pieces.len().saturating_sub(1)));
        let knot = if below < above { pieces[below].high } else { R::of(f64::MAX) };
        Self { knot, pieces: [below as u32, above as u32] }
    }

    /// True if knots lie at several densities.
    fn is_crowded<const C: usize>(&self, pieces: &[Piece<R, C>]) -> bool {
        let [below, above] = self.pieces;
        below < above && pieces[above as usize].low > self.knot
    }
}

/// Buckets per knot: with four, most buckets hold no knot, so that the search in one ends at once.
const BUCKETS: usize = 4;
/// The largest number of buckets.
const MOST_BUCKETS: usize = 1 << 18;

impl<R: Real> Curve<R, 1> {
    /// Creates a curve of one piece: extinction proportional to the density, and one channel of source, `source[0] +
    /// source[1] · density`.
    pub(crate) fn line(extinction: f64, source: [f64; 2]) -> Self {
        let (least, most) = (R::of(f64::MIN), R::of(f64::MAX));
        let piece = Piece {
            low: least,
            high: most,
            base: R::ZERO,
            extinction: [R::ZERO, R::of(extinction)],
            source: [source.map(R::of)],
            steepest: R::of(source[1]),
            inverse_width: R::ZERO,
            upper: R::ZERO,
            jumps: [false; 2],
        };
        Self {
            pieces: vec![piece],
            lines: Vec::new(),
            buckets: vec![Bucket { knot: most, pieces: [0; 2] }],
            first: R::ZERO,
            buckets_per_density: R::ZERO,
            regular: false,
            crowded: false,
        }
    }
}

impl<R: Real> Curve<R, 3> {
    /// Creates the curve of a transfer function's table, its extinction times `scale`.
    pub(crate) fn new(table: &Table, scale: f64) -> Self {
        let last = table.knots().len();
        let piece = |p: usize| {
            let ([low, high], [value, _]) = table.ends(p);
            let slope = table.slope_between(p, |v| R::of(v).f64());
            let width = high - low;
            let inner = width.is_finite() && width > 0.0;
            let line = |c: usize, scale: f64| [R::of(scale * value[c]), R::of(scale * slope[c])];
            Piece {
                low: R::of(low),
                high: R::of(high),
                base: R::of(if p == 0 { high } else { low }),
                extinction: line(3, scale),
                source: [line(0, 1.0), line(1, 1.0), line(2, 1.0)],
                steepest: slope[..3].iter().fold(R::ZERO, |m, s| m.greater(R::of(s.abs()))),
                inverse_width: if inner { R::of(1.0 / width) } else { R::ZERO },
                upper: if p == 0 { R::ONE } else { R::ZERO },
                jumps: [false; 2],
            }
        };
        let mut pieces: Vec<Piece<R, 3>> = (0..=last).map(piece).collect();
        // Rounded knots may coincide: no density lies between them then.
        for p in 1..pieces.len() {
            pieces[p].low = pieces[p - 1].high;
        }
        for p in 1..pieces.len() {
            let [before, here] = [pieces[p - 1], pieces[p]].map(|piece| piece.is_step());
            pieces[p].jumps[0] = before;
            pieces[p - 1].jumps[1] = here;
        }
        let (first, range) = (table.knots()[0], table.knots()[last - 1] - table.knots()[0]);
        // Knots at equal distances are buckets themselves.
        let spacing = range / (last - 1).max(1) as f64;
        let even = |i: usize| (table.knots()[i] - first - i as f64 * spacing).abs() <= 1e-6 * spacing;
        let regular = range > 0.0 && last <= MOST_BUCKETS && (0..last).all(even);
        let count = match range > 0.0 {
            true if regular => last - 1,
            true => (BUCKETS * last).min(MOST_BUCKETS),
            false => 1,
        };
        let width = range / count as f64;
        // Densities are rounded, and the numbers of buckets that are computed from them.
        let largest = table.knots()[0].abs().max(table.knots()[last - 1].abs());
        let margin = 1e-3 + R::EPSILON.f64() * (4.0 * count as f64 + 2.0 * largest / width);
        let bucket = |b: usize| {
            if regular {
                return Bucket { knot: R::of(f64::MAX), pieces: [b as u32 + 1; 2] };
            }
            let below = if b == 0 { f64::MIN } else { first + (b as f64 - margin) * width };
            let above = if b + 1 == count { f64::MAX } else { first + ((b + 1) as f64 + margin) * width };
            Bucket::between(&pieces, [below, above])
        };
        let buckets: Vec<Bucket<R>> = (0..count).map(bucket).collect();
        let crowded = buckets.iter().any(|bucket| bucket.is_crowded(&pieces));
        let buckets_per_density = if range > 0.0 { R::of(count as f64 / range) } else { R::ZERO };
        let lines = pieces.iter().map(Line::new).collect();
        Self { pieces, lines, buckets, first: R::of(first), buckets_per_density, regular, crowded }
    }
}

impl<R: Real> Curve<R, 3> {
    /// Returns red, green, blue and extinction at four densities; of a density less than 1e-4 of a piece below a knot,
    /// on the line of the piece above it.
    #[inline(always)]
    pub(crate) fn source_and_extinction(&self, density: R::Lanes) -> [R::Lanes; 4] {
        let (found, density) = (self.find_all(density), density.store());
        let at = |i: usize| self.lines[found[i] as usize].at(density[i]);
        R::Lanes::transpose([at(0), at(1), at(2), at(3)])
    }
}

impl<R: Real, const C: usize> Curve<R, C> {
    /// Returns the number of the piece with `low <= density < high`.
    #[inline(always)]
    pub(crate) fn find(&self, density: R) -> u32 {
        let scaled = (density - self.first) * self.buckets_per_density;
        self.search(density, scaled.f64() as usize)
    }

    /// Returns the numbers of the pieces of four densities. Where knots are evenly spaced, a density less than 1e-4 of
    /// a piece below a knot may be given the piece above it.
    #[inline(always)]
    pub(crate) fn find_all(&self, density: R::Lanes) -> [u32; LANES] {
        let all = <R::Lanes as Lanes<R>>::splat;
        // A little more, so that knots belong to the piece above them.
        let half = R::of(0.5 + 1.0 / 16384.0);
        let scaled = (density - all(self.first)) * all(self.buckets_per_density);
        // Adding rounds to the nearest whole number: up, half a bucket higher.
        let last = R::int(self.buckets.len() as i32);
        let above = (scaled.clamped(-half, last + half) + all(half) + all(R::ONES)).store().map(R::low_bits);
        if self.regular {
            return above;
        }
        let density = density.store();
        let below = above.map(|above| above.saturating_sub(1) as usize);
        if self.crowded {
            let find = |i: usize| self.search(density[i], below[i]);
            return [find(0), find(1), find(2), find(3)];
        }
        let find = |i: usize| {
            let bucket = &self.buckets[below[i].min(self.buckets.len() - 1)];
            if density[i] >= bucket.knot { bucket.pieces[1] } else { bucket.pieces[0] }
        };
        [find(0), find(1), find(2), find(3)]
    }

    /// Returns the piece of a density, searching from a bucket that it lies in or next to.
    #[inline(always)]
    fn search(&self, density: R, bucket: usize) -> u32 {
        let mut piece = self.buckets[bucket.min(self.buckets.len() - 1)].pieces[0];
        while density >= self.pieces[piece as usize].high && (piece as usize) < self.pieces.len() - 1 {
            piece += 1;
        }
        // What rounding has put a bucket too far.
        while density < self.pieces[piece as usize].low && piece > 0 {
            piece -= 1;
        }
        piece
    }

    /// Returns a piece by its number.
    #[inline(always)]
    pub(crate) fn piece(&self, number: u32) -> &Piece<R, C> {
        &self.pieces[number as usize]
    }

    /// Returns the number of pieces.
    #[inline(always)]
    pub(crate) fn len(&self) -> usize {
        self.pieces.len()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_density_finds_its_piece(
            mut knots in prop::collection::vec(-2.0..3.0_f64, 1..60), step in any::<bool>(), density in -3.0..4.0_f64,
        ) {
            knots.sort_by(f64::total_cmp);
            if step && knots.len() > 1 {
                knots[1] = knots[0];
            }
            prop_assume!(knots.windows(3).all(|k| k[0] < k[2]));
            let values = knots.iter().map(|k| [k.abs(), 0.0, 1.0, k * k]).collect();
            let table = Table::new(knots.clone(), values).unwrap();
            let (wide, narrow) = (Curve::<f64, 3>::new(&table, 2.0), Curve::<f32, 3>::new(&table, 2.0));
            for d in knots.into_iter().chain([density]) {
                let number = wide.find(d);
                prop_assert_eq!(number as usize, table.piece(d));
                let p = wide.piece(number);
                let extinction = p.extinction[0] + p.extinction[1] * (d - p.base);
                prop_assert!((extinction - 2.0 * table.at(d)[3]).abs() < 1e-9 * (1.0 + extinction));
                let p = narrow.piece(narrow.find(d as f32));
                prop_assert!(p.low <= d as f32 && (d as f32) < p.high);
                let all = [d as f32, density as f32, 0.0, 1.0];
                for (d, found) in all.into_iter().zip(narrow.find_all(all.into())) {
                    let p = narrow.piece(found);
                    let slack = 2e-4 * (p.high - p.low).min(1.0) + 1e-6;
                    prop_assert!(p.low - slack <= d && d <= p.high + 1e-6, "{d} {p:?}");
                }
            }
        }
    }
}
