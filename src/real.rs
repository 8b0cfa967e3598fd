//! The floating-point type a kernel runs in: `f32` for work, `f64` for references and tests.

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
    fn exp_neg(self) -> Self;
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
    ($t:ty, $lanes:ty, $exp_neg:expr) => {
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
            fn exp_neg(self) -> Self {
                $exp_neg(self)
            }
        }
    };
}
real!(f32, glam::Vec4, exp_neg);
real!(f64, glam::DVec4, |x: f64| (-x).exp());

/// `e^-x` for x ≥ 0, to two units of the last place; beyond 87, where it would be denormal, that of 87. Without a branch:
/// loops of it are compiled to vectors.
#[inline(always)]
fn exp_neg(x: f32) -> f32 {
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

/// How many numbers there are in a [`Lanes`].
pub const LANES: usize = 4;

/// Four numbers; operators work on each.
pub trait Lanes<R: Real>: Number + Default + AddAssign + Div<Output = Self> {
    /// Zeros.
    const ZERO: Self;
    /// The same number four times.
    fn splat(v: R) -> Self;
    /// Four numbers from an array.
    fn load(from: [R; LANES]) -> Self;
    /// The numbers.
    fn store(self) -> [R; LANES];
    /// Each no less than `low` and no more than `high`.
    fn clamped(self, low: R, high: R) -> Self;
    /// Their sum, first and third, second and fourth first.
    fn sum(self) -> R;
    /// The lesser of each two.
    fn lesser(self, o: Self) -> Self;
    /// The greater of each two.
    fn greater(self, o: Self) -> Self;
    /// True if each is at least the other.
    fn reach(self, o: Self) -> bool;
    /// Adds `step` to each number that is no greater than `limit`.
    fn advanced(self, limit: Self, step: Self) -> Self;
    /// Each in the place of the next, with `first` before them; the last is dropped.
    fn after(self, first: R) -> Self;
    /// Each in the place of the one before, with `last` behind them; the first is dropped.
    fn before(self, last: R) -> Self;
    /// Each with all before it multiplied.
    fn running_product(self) -> Self;
    /// Their magnitudes.
    fn abs(self) -> Self;
    /// `e` to the power of each.
    fn exp(self) -> Self;
    /// Rows for columns.
    fn transpose(columns: [Self; LANES]) -> [Self; LANES];
}

macro_rules! lanes {
    ($real:ty, $vector:ty, $matrix:ty, $exp:expr) => {
        impl Number for $vector {
            #[inline(always)]
            fn one() -> Self {
                Self::ONE
            }
        }
        impl Lanes<$real> for $vector {
            const ZERO: Self = Self::ZERO;
            #[inline(always)]
            fn splat(v: $real) -> Self {
                Self::splat(v)
            }
            #[inline(always)]
            fn load(from: [$real; LANES]) -> Self {
                Self::from_array(from)
            }
            #[inline(always)]
            fn store(self) -> [$real; LANES] {
                self.to_array()
            }
            #[inline(always)]
            fn clamped(self, low: $real, high: $real) -> Self {
                self.max(Self::splat(low)).min(Self::splat(high))
            }
            #[inline(always)]
            fn sum(self) -> $real {
                let [a, b, c, d] = self.to_array();
                (a + c) + (b + d)
            }
            #[inline(always)]
            fn lesser(self, o: Self) -> Self {
                self.min(o)
            }
            #[inline(always)]
            fn greater(self, o: Self) -> Self {
                self.max(o)
            }
            #[inline(always)]
            fn reach(self, o: Self) -> bool {
                self.cmpge(o).all()
            }
            #[inline(always)]
            fn advanced(self, limit: Self, step: Self) -> Self {
                self + Self::select(self.cmple(limit), step, Self::ZERO)
            }
            #[inline(always)]
            fn after(self, first: $real) -> Self {
                let [a, b, c, _] = self.to_array();
                Self::from_array([first, a, b, c])
            }
            #[inline(always)]
            fn before(self, last: $real) -> Self {
                let [_, b, c, d] = self.to_array();
                Self::from_array([b, c, d, last])
            }
            #[inline(always)]
            fn running_product(self) -> Self {
                let [a, b, c, _] = self.to_array();
                let pairs = self * Self::from_array([1.0, a, b, c]);
                let [a, b, ..] = pairs.to_array();
                pairs * Self::from_array([1.0, 1.0, a, b])
            }
            #[inline(always)]
            fn abs(self) -> Self {
                Self::abs(self)
            }
            #[inline(always)]
            fn exp(self) -> Self {
                $exp(self)
            }
            #[inline(always)]
            fn transpose([x, y, z, w]: [Self; LANES]) -> [Self; LANES] {
                let m = <$matrix>::from_cols(x, y, z, w).transpose();
                [m.x_axis, m.y_axis, m.z_axis, m.w_axis]
            }
        }
    };
}
lanes!(f32, glam::Vec4, glam::Mat4, |v: glam::Vec4| wide::f32x4::new(v.to_array()).exp().to_array().into());
// One by one: the reference's last bit counts for more than its speed.
lanes!(f64, glam::DVec4, glam::DMat4, glam::DVec4::exp);
