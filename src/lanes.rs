//! Four numbers that are computed together, in one vector register where the machine has them.

use crate::real::{Number, Real};
use std::ops::{AddAssign, Div};

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
