//! Numbers from 0 to 10⁵ in sixteen bits: five of an exponent and eleven of a fraction, without a sign.
//!
//! Histories are noisy by far more than the 2⁻¹² that rounding to these numbers adds, and half the memory is half the
//! time where pixels are gathered. A code is the upper bits of a single-precision number that was scaled down so far
//! that the other bits of its exponent are 0. So a shift gives the number back, and a mean of several is scaled once.

use super::lanes::{LANES, Lanes, each};

/// Eight numbers in sixteen bits each.
pub(crate) type Packed = [u16; LANES];

/// How colors of either sign become numbers that can be packed: over a power of two, and so much more.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Coding {
    scale: f32,
    offset: f32,
}

/// Number that the largest color is scaled to, or up to half of it: what comes next may be brighter.
const SCALED: f32 = 4096.0;
/// Offset as a multiple of the least color: what comes next may be less.
const ROOM: f32 = 2.0;

impl Default for Coding {
    fn default() -> Self {
        Self { scale: 1.0, offset: 0.0 }
    }
}

impl Coding {
    /// Returns the coding of colors from `least`, which is not above 0, up to `most`.
    pub(crate) fn of([least, most]: [f32; 2]) -> Self {
        let exponent = (most.max(-least) / SCALED).log2().ceil();
        let scale = if exponent.is_finite() { exponent.clamp(-100.0, 100.0).exp2() } else { 1.0 };
        Self { scale, offset: -least / scale * ROOM }
    }

    /// Returns the least color that has a number, which is not above 0.
    pub(crate) fn least(self) -> f32 {
        -self.offset * self.scale
    }

    /// Returns the numbers of colors.
    #[inline(always)]
    pub(crate) fn encode(self, colors: Lanes) -> Lanes {
        colors * self.scale.recip() + Lanes([self.offset; LANES])
    }

    /// Returns the colors of numbers.
    #[inline(always)]
    pub(crate) fn decode(self, numbers: Lanes) -> Lanes {
        (numbers - Lanes([self.offset; LANES])) * self.scale
    }
}

/// Largest number.
pub(crate) const LARGEST: f32 = 1e5;

/// Scale of numbers before their bits are taken, a power of two: the largest has five bits of exponent then.
const DOWN: f32 = f32::from_bits((127 - SHIFT) << 23);
/// Scale by which numbers come back from their bits.
const UP: f32 = f32::from_bits((127 + SHIFT) << 23);
/// Exponent of both scales.
const SHIFT: u32 = 112;
/// Bits of a fraction that are dropped.
const DROPPED: u32 = 12;

/// Returns the nearest packed numbers; those below 0 are 0, and those above [`LARGEST`] that.
#[inline(always)]
pub(crate) fn pack(numbers: Lanes) -> Packed {
    let mut to = [0; LANES];
    let numbers = numbers.max(Lanes::ZERO).min(Lanes([LARGEST; LANES])) * DOWN;
    for (to, number) in to.iter_mut().zip(numbers.0) {
        *to = ((number.to_bits() + (1 << (DROPPED - 1))) >> DROPPED) as u16;
    }
    to
}

/// Returns the numbers.
#[inline(always)]
pub(crate) fn unpack(packed: &Packed) -> Lanes {
    scaled(packed) * UP
}

/// Returns the sum of four times eight numbers, each by its share.
#[inline(always)]
pub(crate) fn mean(packed: [&Packed; 4], [p, q, r, s]: [f32; 4]) -> Lanes {
    let [a, b, c, d]: [Lanes; 4] = each(|at| scaled(packed[at]));
    ((a * p + b * q) + (c * r + d * s)) * UP
}

/// Returns the sum of sixteen times eight numbers, from `first` on four in each of four rows of `width`, each by the
/// shares of its column and its row. Sums below 0 are 0.
#[inline(always)]
pub(crate) fn resampled(packed: &[Packed], width: usize, first: usize, columns: [f32; 4], rows: [f32; 4]) -> Lanes {
    let mut sum = Lanes::ZERO;
    for (row, share) in rows.into_iter().enumerate() {
        let Some(row) = packed.get(first + row * width..).and_then(<[Packed]>::first_chunk::<4>) else { continue };
        let mut of_row = Lanes::ZERO;
        for (packed, share) in row.iter().zip(columns) {
            of_row = scaled(packed).mul_add(Lanes([share; LANES]), of_row);
        }
        sum = of_row.mul_add(Lanes([share * UP; LANES]), sum);
    }
    sum.max(Lanes::ZERO)
}

/// Returns the numbers, scaled down.
#[inline(always)]
fn scaled(packed: &Packed) -> Lanes {
    let mut to = Lanes::ZERO;
    for (to, code) in to.0.iter_mut().zip(packed) {
        *to = f32::from_bits(u32::from(*code) << DROPPED);
    }
    to
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Least number whose fraction has all of its bits.
    const LEAST: f32 = 1.0 / 16_384.0;

    /// Relative errors are half a unit of the last of eleven bits, down to the least exponent's; 0 stays 0.
    #[test]
    fn numbers_come_back_to_eleven_bits() {
        for exponent in -20..17 {
            for part in 0..100 {
                let number = (1.0 + part as f32 / 100.0) * (exponent as f32).exp2();
                let found = unpack(&pack(Lanes([number; LANES]))).0[3];
                let limit = number.max(LEAST) / 4096.0;
                assert!(number > LARGEST || (found - number).abs() <= 1.001 * limit, "{number}: {found}");
            }
        }
        for (number, expected) in [(0.0, 0.0), (-3.0, 0.0), (f32::NAN, 0.0), (f32::INFINITY, LARGEST), (1.0, 1.0)] {
            let found = unpack(&pack(Lanes([number; LANES]))).0[0];
            assert!((found - expected).abs() <= expected / 4096.0, "{number}: {found}");
        }
    }

    #[test]
    fn means_are_those_of_the_numbers() {
        let packed = [0.0, 1.0, 5.0, 100.0].map(|number| pack(Lanes([number; LANES])));
        let found = mean(packed.each_ref(), [0.5, 0.25, 0.125, 0.125]).0[7];
        assert!((found - 13.375).abs() < 13.375 / 2048.0, "{found}");
        assert_eq!(mean([&packed[0]; 4], [0.25; 4]), Lanes::ZERO);
    }
}
