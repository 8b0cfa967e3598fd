//! The floating-point type a kernel runs in: `f32` for work, `f64` for references and tests.

use crate::lanes::Lanes;
use std::fmt::Debug;
use std::iter::Sum;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

/// What formulas need that are written once for a number and for several at once.
pub trait Number: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Neg<Output = Self> {
    /// One.
    fn one() -> Self;
}

/// `f32` or `f64`.
pub trait Real:
    Number + Debug + Default + PartialOrd + Send + Sync + 'static + Div<Output = Self> + AddAssign + SubAssign + Sum
{
    /// Zero.
    const ZERO: Self;
    /// One.
    const ONE: Self;
    /// From one to the next number.
    const EPSILON: Self;
    /// Rounds a double.
    fn of(v: f64) -> Self;
    /// Converts a small integer, exactly.
    fn int(v: i32) -> Self;
    /// Four at once.
    type Lanes: Lanes<Self> + Debug + Send + Sync;
    /// A number so large that its neighbours are one apart: adding it rounds, and leaves the whole
    /// number in the low bits.
    const ONES: Self;
    /// The low bits.
    fn low_bits(self) -> u32;
    /// Widens to a double, exactly.
    fn f64(self) -> f64;
    /// `e^x - 1` without cancellation near zero.
    fn exp_m1(self) -> Self;
    /// `e^x`.
    fn exp(self) -> Self;
    /// `e^{-x}` for x ≥ 0; where that is below 1e-37, no less.
    fn fall(self) -> Self;
    /// Lesser of two numbers (neither NaN).
    #[inline(always)]
    fn lesser(self, o: Self) -> Self {
        if self < o { self } else { o }
    }
    /// Greater of two numbers (neither NaN).
    #[inline(always)]
    fn greater(self, o: Self) -> Self {
        if self > o { self } else { o }
    }
}

macro_rules! real {
    ($t:ty, $lanes:ty, $fall:expr) => {
        impl Number for $t {
            #[inline(always)]
            fn one() -> Self {
                1.0
            }
        }
        impl Real for $t {
            const ZERO: Self = 0.0;
            const ONE: Self = 1.0;
            const EPSILON: Self = <$t>::EPSILON;
            #[inline(always)]
            fn of(v: f64) -> Self {
                v as $t
            }
            #[inline(always)]
            fn int(v: i32) -> Self {
                v as $t
            }
            type Lanes = $lanes;
            const ONES: $t = 1.5 * (1_u64 << (<$t>::MANTISSA_DIGITS - 1)) as $t;
            #[inline(always)]
            fn low_bits(self) -> u32 {
                self.to_bits() as u32 & 0xf_ffff
            }
            #[inline(always)]
            fn f64(self) -> f64 {
                f64::from(self)
            }
            #[inline(always)]
            fn exp_m1(self) -> Self {
                <$t>::exp_m1(self)
            }
            #[inline(always)]
            fn exp(self) -> Self {
                <$t>::exp(self)
            }
            #[inline(always)]
            fn fall(self) -> Self {
                $fall(self)
            }
        }
    };
}
real!(f32, glam::Vec4, fall);
real!(f64, glam::DVec4, |x: f64| (-x).exp());

/// `e^-x` for x ≥ 0, to two units of the last place; beyond 87, where it would be denormal, that of 87. Without a branch:
/// loops of it are compiled to vectors.
#[inline(always)]
fn fall(x: f32) -> f32 {
    let x = -x.lesser(87.0);
    // x = n ln 2 + r, ln 2 in two parts: the product with the first is exact.
    let shifted = x * std::f32::consts::LOG2_E + f32::ONES;
    let n = shifted - f32::ONES;
    let r = (x - n * 0.693_359_4) - n * -2.121_944_4e-4;
    // Cephes, expf.
    let p = 1.398_199_9e-3 + r * 1.987_569_1e-4;
    let p = 8.333_452e-3 + r * p;
    let p = 4.166_579_6e-2 + r * p;
    let p = 1.666_666_5e-1 + r * p;
    let p = 0.5 + r * p;
    let power = (r * r) * p + r + 1.0;
    power * f32::from_bits((shifted.to_bits() << 23).wrapping_add(127 << 23))
}
