//! Sums that do not depend on the order of their terms.

/// A sum in twice the digits of `f64`: `high + low`, without overlap.
///
/// The error of an addition is about 2⁻¹⁰⁴ of the sum, so that a mean in single precision is the same whatever parts it
/// was summed up from, but for one in 2⁷⁵. Additions are those of Knuth (1969, theorem 4.2.2 B) and Dekker (1971).
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Sum {
    high: f64,
    low: f64,
}

/// Returns the rounded sum of two numbers, and what it lacks.
#[inline(always)]
fn two_sum(a: f64, b: f64) -> [f64; 2] {
    let sum = a + b;
    let of_b = sum - a;
    [sum, (a - (sum - of_b)) + (b - of_b)]
}

/// Returns the rounded product of two numbers, and what it lacks.
#[inline(always)]
fn two_product(a: f64, b: f64) -> [f64; 2] {
    let product = a * b;
    [product, a.mul_add(b, -product)]
}

impl Sum {
    /// Creates the sum of terms in any order.
    pub fn of(terms: impl IntoIterator<Item = f64>) -> Self {
        terms.into_iter().fold(Self::default(), |sum, term| sum.plus(Self { high: term, low: 0.0 }))
    }

    /// Returns the product of two numbers without error.
    #[inline(always)]
    pub(super) fn product(a: f64, b: f64) -> Self {
        let [high, low] = two_product(a, b);
        Self { high, low }
    }

    /// Returns the sum of both.
    #[inline(always)]
    #[must_use]
    pub fn plus(self, other: Self) -> Self {
        let [high, rest] = two_sum(self.high, other.high);
        let [low, least] = two_sum(self.low, other.low);
        let [high, rest] = two_sum(high, rest + low);
        let [high, low] = two_sum(high, rest + least);
        Self { high, low }
    }

    /// Returns a multiple of the sum.
    #[must_use]
    pub(super) fn times(self, factor: f64) -> Self {
        let Self { high, low } = Self::product(self.high, factor);
        Self { high, low: 0.0 }.plus(Self { high: low + self.low * factor, low: 0.0 })
    }

    /// Returns the square of the sum.
    pub(super) fn squared(self) -> Self {
        let Self { high, low } = Self::product(self.high, self.high);
        Self { high, low: 0.0 }.plus(Self { high: low + 2.0 * self.high * self.low, low: 0.0 })
    }

    /// Returns the sum with the sign changed.
    pub(super) fn negated(self) -> Self {
        Self { high: -self.high, low: -self.low }
    }

    /// Returns the value, rounded once.
    #[inline(always)]
    pub fn value(self) -> f64 {
        self.high + self.low
    }

    /// Returns numbers in single precision whose sum this is, to 2⁻⁷² of it, from the largest on.
    pub fn parts(self) -> [f32; 3] {
        let mut rest = self;
        std::array::from_fn(|_| {
            let part = rest.value() as f32;
            rest = rest.plus(Self { high: -f64::from(part), low: 0.0 });
            part
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Terms that f64 cannot sum in one order as in another.
    #[test]
    fn order_does_not_matter() {
        let terms: Vec<f64> = (1..2000).map(|i| f64::from((1.0e6_f32 / i as f32).powi(1 + i % 3))).collect();
        let forward = Sum::of(terms.iter().copied());
        let backward = Sum::of(terms.iter().rev().copied());
        let halves = Sum::of(terms[1000..].iter().copied()).plus(Sum::of(terms[..1000].iter().copied()));
        assert_eq!((forward.value(), forward.value()), (backward.value(), halves.value()));
        assert_ne!(terms.iter().sum::<f64>(), terms.iter().rev().sum::<f64>());
    }

    #[test]
    fn parts_are_the_sum() {
        for v in [0.1 + 1e-20, 1.0 / 3.0, 1e30, 0.0, -7.25e-9] {
            let sum = Sum::of([v, v * 1e-17]);
            assert_eq!(Sum::of(sum.parts().map(f64::from)).value(), sum.value());
        }
    }

    /// The spread of equal numbers is exactly 0.
    #[test]
    fn equal_numbers_do_not_spread() {
        for (x, n) in [(0.1_f32, 3.0), (1.0e-7, 17.0), (12345.678, 1000.0)] {
            let x = f64::from(x);
            let (sum, square) = (Sum::product(n, x), Sum::product(n, x * x));
            let (sums, squares) = (0..9).fold(<(Sum, Sum)>::default(), |(a, b), _| (a.plus(sum), b.plus(square)));
            assert_eq!(squares.times(9.0 * n).plus(sums.squared().negated()).value(), 0.0);
        }
    }
}
