//! Eight numbers side by side, which compilers turn into vectors of whatever width a machine has.

use std::ops::{Add, AddAssign, Div, Mul, Sub};

/// Numbers in a vector.
pub(crate) const LANES: usize = 8;

/// Eight numbers.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[repr(align(32))]
pub(crate) struct Lanes(pub [f32; LANES]);

macro_rules! elementwise {
    ($($op:ident $name:ident $sign:tt),*) => {$(
        impl $op for Lanes {
            type Output = Self;
            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                let mut to = self.0;
                for i in 0..LANES {
                    to[i] = self.0[i] $sign other.0[i];
                }
                Self(to)
            }
        }
        impl $op<f32> for Lanes {
            type Output = Self;
            #[inline(always)]
            fn $name(self, other: f32) -> Self {
                self $sign Self([other; LANES])
            }
        }
    )*};
}

elementwise!(Add add +, Sub sub -, Mul mul *, Div div /);

impl AddAssign for Lanes {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl Lanes {
    /// Zeros.
    pub(crate) const ZERO: Self = Self([0.0; LANES]);

    /// Returns the eight numbers of a row from `at` on; zeros where it ends before.
    #[inline(always)]
    pub(crate) fn load(row: &[f32], at: usize) -> Self {
        Self(row.get(at..).and_then(<[f32]>::first_chunk).copied().unwrap_or([0.0; LANES]))
    }

    /// Writes the numbers to a row from `at` on, if it is that long.
    #[inline(always)]
    pub(crate) fn store(self, row: &mut [f32], at: usize) {
        if let Some(to) = row.get_mut(at..).and_then(<[f32]>::first_chunk_mut) {
            *to = self.0;
        }
    }

    /// Returns the products with other numbers, added to more, each rounded once.
    #[inline(always)]
    pub(crate) fn mul_add(self, by: Self, more: Self) -> Self {
        let mut to = self.0;
        for i in 0..LANES {
            to[i] = self.0[i].mul_add(by.0[i], more.0[i]);
        }
        Self(to)
    }

    /// Returns the greater of each pair.
    #[inline(always)]
    pub(crate) fn max(self, other: Self) -> Self {
        let mut to = self.0;
        for i in 0..LANES {
            to[i] = if self.0[i] > other.0[i] { self.0[i] } else { other.0[i] };
        }
        Self(to)
    }

    /// Returns the lesser of each pair.
    #[inline(always)]
    pub(crate) fn min(self, other: Self) -> Self {
        let mut to = self.0;
        for i in 0..LANES {
            to[i] = if self.0[i] < other.0[i] { self.0[i] } else { other.0[i] };
        }
        Self(to)
    }

    /// Returns the square roots.
    #[inline(always)]
    pub(crate) fn sqrt(self) -> Self {
        let mut to = self.0;
        for to in &mut to {
            *to = to.sqrt();
        }
        Self(to)
    }

    /// Returns `then` where this is above 0, and `other` elsewhere.
    #[inline(always)]
    pub(crate) fn select(self, then: Self, other: Self) -> Self {
        let mut to = self.0;
        for i in 0..LANES {
            to[i] = if self.0[i] > 0.0 { then.0[i] } else { other.0[i] };
        }
        Self(to)
    }
}

/// Returns an array of what `of` returns for each place. (`std::array::from_fn` is not always inlined, and then
/// compiled for the baseline.)
#[inline(always)]
pub(crate) fn each<T: Copy + Default, const N: usize>(mut of: impl FnMut(usize) -> T) -> [T; N] {
    let mut to = [T::default(); N];
    for (i, to) in to.iter_mut().enumerate() {
        *to = of(i);
    }
    to
}

/// Returns the sum over channels of the products of two colors.
#[inline(always)]
pub(crate) fn dot(a: &[Lanes], b: &[Lanes]) -> Lanes {
    (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]
}

/// Returns 0 where numbers are below the first of two limits or none, 1 above the second, and a linear ramp between.
#[inline(always)]
pub(crate) fn between(numbers: Lanes, [from, to]: [f32; 2]) -> Lanes {
    ((numbers - Lanes([from; LANES])) / Lanes([to - from; LANES])).max(Lanes::ZERO).min(Lanes([1.0; LANES]))
}
