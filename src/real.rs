//! The floating-point type a kernel runs in: `f32` for work, `f64` for references and tests.

use std::fmt::Debug;
use std::iter::Sum;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

/// `f32` or `f64`.
pub trait Real:
    Copy
    + Debug
    + Default
    + PartialOrd
    + Send
    + Sync
    + 'static
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
    + Sum
{
    /// Zero.
    const ZERO: Self;
    /// One.
    const ONE: Self;
    /// Rounds a double.
    fn of(v: f64) -> Self;
    /// Converts a small integer, exactly.
    fn int(v: i32) -> Self;
    /// Integer part, towards zero.
    fn trunc(self) -> i32;
    /// Widens to a double, exactly.
    fn f64(self) -> f64;
    /// `e^x - 1` without cancellation near zero.
    fn exp_m1(self) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
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
    ($t:ty) => {
        impl Real for $t {
            const ZERO: Self = 0.0;
            const ONE: Self = 1.0;
            #[inline(always)]
            fn of(v: f64) -> Self {
                v as $t
            }
            #[inline(always)]
            fn int(v: i32) -> Self {
                v as $t
            }
            #[inline(always)]
            fn trunc(self) -> i32 {
                self as i32
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
            fn sqrt(self) -> Self {
                <$t>::sqrt(self)
            }
        }
    };
}
real!(f32);
real!(f64);
