//! Dual numbers: a value with its derivatives along `P` directions, carried through arithmetic
//! (Weiss & Westermann 2021, sect. 4.2, eqs. 4 and 5).

use crate::real::{Number, Real};
use std::ops::{Add, Div, Mul, Neg, Sub};

/// A value, scalar or vector, with its derivatives along `P` directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dual<N, const P: usize> {
    /// Value of the number.
    pub value: N,
    /// Derivative of the value along each direction.
    pub tangent: [N; P],
}

impl<N: Number, const P: usize> Dual<N, P> {
    /// A dual number whose derivatives are all zero.
    #[inline(always)]
    pub(crate) fn constant(value: N) -> Self {
        Self { value, tangent: [N::one() - N::one(); P] }
    }

    /// Applies a linear function to the value and to every derivative.
    #[inline(always)]
    pub(crate) fn linear<M>(self, f: impl Fn(N) -> M) -> Dual<M, P> {
        Dual { value: f(self.value), tangent: self.tangent.map(f) }
    }

    /// Chain rule for a function whose value and derivative at this number are `value` and `slope`.
    #[inline(always)]
    pub(crate) fn function(self, value: N, slope: N) -> Self {
        Self { value, tangent: self.tangent.map(|t| slope * t) }
    }
}

impl<R: Real, const P: usize> Dual<R, P> {
    /// The exponential `e^x`.
    #[inline(always)]
    pub(crate) fn exp(self) -> Self {
        let value = self.value.exp();
        self.function(value, value)
    }

    /// Converts the value and the derivatives to double precision.
    #[inline(always)]
    pub(crate) fn f64(self) -> Dual<f64, P> {
        self.linear(Real::f64)
    }
}

impl<N: Number, const P: usize> Number for Dual<N, P> {
    #[inline(always)]
    fn one() -> Self {
        Self::constant(N::one())
    }
}

impl<N: Number, const P: usize> Add for Dual<N, P> {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        Self { value: self.value + o.value, tangent: std::array::from_fn(|p| self.tangent[p] + o.tangent[p]) }
    }
}

impl<N: Number, const P: usize> Sub for Dual<N, P> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        Self { value: self.value - o.value, tangent: std::array::from_fn(|p| self.tangent[p] - o.tangent[p]) }
    }
}

impl<N: Number, const P: usize> Mul for Dual<N, P> {
    type Output = Self;
    #[inline(always)]
    #[allow(clippy::suspicious_arithmetic_impl, reason = "the rule of the derivative")]
    fn mul(self, o: Self) -> Self {
        let tangent = std::array::from_fn(|p| self.tangent[p] * o.value + self.value * o.tangent[p]);
        Self { value: self.value * o.value, tangent }
    }
}

impl<N: Number, const P: usize> Neg for Dual<N, P> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.linear(|v| -v)
    }
}

impl<R: Real, const P: usize> Div for Dual<R, P> {
    type Output = Self;
    #[inline(always)]
    #[allow(clippy::suspicious_arithmetic_impl, reason = "the rule of the derivative")]
    fn div(self, o: Self) -> Self {
        let value = self.value / o.value;
        Self { value, tangent: std::array::from_fn(|p| (self.tangent[p] - value * o.tangent[p]) / o.value) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A function of two dual numbers that uses every operation.
    fn of<const P: usize>(x: Dual<f64, P>, y: Dual<f64, P>) -> Dual<f64, P> {
        let one = Dual::one();
        (x * y - one).exp() / (one + y * y) + (-x).exp() * y.linear(|v| 3.0 * v)
    }

    proptest! {
        #[test]
        fn derivatives_match_central_differences(x in -1.0..1.0_f64, y in -1.0..1.0_f64) {
            let seed = |value, p: usize| Dual { value, tangent: std::array::from_fn(|q| f64::from(u8::from(p == q))) };
            let found: Dual<f64, 2> = of(seed(x, 0), seed(y, 1));
            let at = |x, y| of::<0>(Dual::constant(x), Dual::constant(y)).value;
            prop_assert_eq!(found.value, at(x, y));
            let h = 1e-5;
            let expected = [(at(x + h, y) - at(x - h, y)) / (2.0 * h), (at(x, y + h) - at(x, y - h)) / (2.0 * h)];
            for p in 0..2 {
                // Central differences err by h² f''' / 6, with derivatives of order 10.
                prop_assert!((found.tangent[p] - expected[p]).abs() < 1e-8, "{:?} {:?}", found.tangent, expected);
            }
        }
    }
}
