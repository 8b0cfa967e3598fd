//! Floating-point types of the kernels: `f32` for work, `f64` for references and tests.

use bytemuck::Pod;
use std::fmt::Debug;
use std::iter::Sum;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

/// Arithmetic shared by single numbers, vectors of numbers and dual numbers.
pub trait Number: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Neg<Output = Self> {
    /// The multiplicative identity.
    fn one() -> Self;
}

/// A floating-point type that kernels are generic over: `f32` or `f64`.
pub trait Real:
    Number + Pod + Debug + Default + PartialOrd + Send + Sync + Div<Output = Self> + AddAssign + SubAssign + Sum
{
    /// Zero.
    const ZERO: Self;
    /// One.
    const ONE: Self;
    /// Difference between one and the next larger number.
    const EPSILON: Self;
    /// Converts a double, rounding to nearest.
    fn of(v: f64) -> Self;
    /// Converts a small integer exactly.
    fn int(v: i32) -> Self;
    /// Vector of four such numbers.
    type Lanes: Lanes<Self> + Debug + Send + Sync;
    /// A number so large that the spacing of floating-point numbers there is one. Adding it rounds to a whole number,
    /// which then stands in the low bits.
    const ONES: Self;
    /// The lowest 20 bits of the representation.
    fn low_bits(self) -> u32;
    /// Converts to double precision, exactly.
    fn f64(self) -> f64;
    /// The function `e^x - 1`, without cancellation near zero.
    fn exp_m1(self) -> Self;
    /// The exponential `e^x`.
    fn exp(self) -> Self;
    /// The shares of light that an optical depth x ≥ 0 lets through and absorbs, `e^{-x}` and `1 - e^{-x}`, the latter
    /// without cancellation near zero. In single precision x is limited to 87, so that neither is denormal but where x
    /// is.
    fn through_and_absorbed(self) -> [Self; 2];
    /// The lesser of two numbers, neither of which is NaN.
    #[inline(always)]
    fn lesser(self, o: Self) -> Self {
        if self < o { self } else { o }
    }
    /// The greater of two numbers, neither of which is NaN.
    #[inline(always)]
    fn greater(self, o: Self) -> Self {
        if self > o { self } else { o }
    }
}

/// Returns the least and the greatest of numbers, none of which is NaN; `None` without any. Runs of numbers are
/// compared side by side, as fast as memory gives them.
pub fn extremes<R: Real>(values: &[R]) -> Option<(R, R)> {
    const SIDE: usize = 4;
    let first = *values.first()?;
    let (fours, rest) = values.as_chunks::<LANES>();
    let (runs, more) = fours.as_chunks::<SIDE>();
    let mut low = [R::Lanes::splat(first); SIDE];
    let mut high = low;
    for run in runs {
        for (i, four) in run.iter().enumerate() {
            let four = R::Lanes::load(*four);
            (low[i], high[i]) = (low[i].lesser(four), high[i].greater(four));
        }
    }
    let single = more.as_flattened().iter().chain(rest);
    let lesser = |a: R, b: &R| b.lesser(a);
    let greater = |a: R, b: &R| b.greater(a);
    let low = low.map(Lanes::store);
    let high = high.map(Lanes::store);
    let least = low.as_flattened().iter().chain(single.clone()).fold(first, lesser);
    Some((least, high.as_flattened().iter().chain(single).fold(first, greater)))
}

macro_rules! real {
    ($t:ty, $lanes:ty, $shares:expr) => {
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
            fn through_and_absorbed(self) -> [Self; 2] {
                $shares(self)
            }
        }
    };
}
real!(f32, glam::Vec4, through_and_absorbed);
real!(f64, glam::DVec4, |x: f64| [(-x).exp(), -(-x).exp_m1()]);

/// The exponential `e^-x` for x ≥ 0 and its difference from 1, each to two units in the last place; beyond 87, where
/// the exponential would be denormal, its value at 87.
/// The function has no branch, so that compilers vectorise loops over it.
#[inline(always)]
fn through_and_absorbed(x: f32) -> [f32; 2] {
    let x = -x.lesser(87.0);
    // Range reduction x = n ln 2 + r, with ln 2 split in two parts so that the product with the first is exact.
    let shifted = x * std::f32::consts::LOG2_E + f32::ONES;
    let n = shifted - f32::ONES;
    let r = (x - n * 0.693_359_4) - n * -2.121_944_4e-4;
    // Polynomial of `expf` in Cephes.
    let p = 1.398_199_9e-3 + r * 1.987_569_1e-4;
    let p = 8.333_452e-3 + r * p;
    let p = 4.166_579_6e-2 + r * p;
    let p = 1.666_666_5e-1 + r * p;
    let p = 0.5 + r * p;
    // e^r - 1, which the absorbed share is made of: where n = 0 nothing cancels.
    let change = (r * r) * p + r;
    let power = f32::from_bits((shifted.to_bits() << 23).wrapping_add(127 << 23));
    [power * (change + 1.0), (1.0 - power) - power * change]
}

/// Number of elements of a [`Lanes`] vector.
pub(crate) const LANES: usize = 4;

/// A vector of four numbers with elementwise operators.
pub trait Lanes<R: Real>: Number + Pod + Default + AddAssign + Div<Output = Self> {
    /// The zero vector.
    const ZERO: Self;
    /// A vector whose four elements are `v`.
    fn splat(v: R) -> Self;
    /// A vector of the four elements of an array.
    fn load(from: [R; LANES]) -> Self;
    /// The four elements as an array.
    fn store(self) -> [R; LANES];
    /// Clamps each element to `[low, high]`.
    fn clamped(self, low: R, high: R) -> Self;
    /// Sum of the elements `[a, b, c, d]`, evaluated as `(a + c) + (b + d)`.
    fn sum(self) -> R;
    /// Elementwise minimum.
    fn lesser(self, o: Self) -> Self;
    /// Elementwise maximum.
    fn greater(self, o: Self) -> Self;
    /// True if every element is at least the corresponding one of `o`.
    fn reach(self, o: Self) -> bool;
    /// Adds `step` to each element that does not exceed `limit`, elementwise.
    fn advanced(self, limit: Self, step: Self) -> Self;
    /// Shifts `[a, b, c, d]` to `[first, a, b, c]`.
    fn after(self, first: R) -> Self;
    /// Shifts `[a, b, c, d]` to `[b, c, d, last]`.
    fn before(self, last: R) -> Self;
    /// Inclusive prefix product: `[a, ab, abc, abcd]`.
    fn running_product(self) -> Self;
    /// Elementwise absolute value.
    fn abs(self) -> Self;
    /// Elementwise exponential.
    fn exp(self) -> Self;
    /// Transpose of the 4 × 4 matrix with these columns.
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
// Evaluated element by element: in the reference the last bit matters more than speed.
lanes!(f64, glam::DVec4, glam::DMat4, glam::DVec4::exp);
