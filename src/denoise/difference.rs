//! Differences between a frame's colors and those of a neighbouring frame.
//!
//! Both frames show the same signal with noise of their own, and so the product of a pixel's differences from the frame
//! before and from the frame after is on average the square of its own noise (the "three-cornered hat" of clocks, Gray
//! & Allan 1974). Histories would have less noise and more blur; a single frame is resampled once, and by a cubic
//! kernel (Keys 1981).

use super::lanes::{LANES, Lanes, each};

/// Differences of eight pixels by channel, and 1 where they are known.
pub(crate) type Difference = [Lanes; 4];

/// Channels of a color; the place of the flag behind them.
pub(crate) const CHANNELS: usize = 3;

/// Returns 1 where all channels are finite, and 0 elsewhere.
#[inline(always)]
fn finite(channels: &[Lanes; CHANNELS]) -> Lanes {
    // Of numbers that are not finite the product is not a number.
    let zero = (channels[0] * 0.0 + channels[1] * 0.0) + channels[2] * 0.0;
    Lanes(each(|lane| if zero.0[lane] == 0.0 { 1.0 } else { 0.0 }))
}

/// Differences of eight pixels by channel in half the memory: the upper halves of their bits. Not a number where
/// unknown.
pub(crate) type Halved = [[u16; LANES]; CHANNELS];

/// Returns differences in half the memory.
#[inline(always)]
pub(crate) fn halved(apart: &[Lanes; CHANNELS], known: Lanes) -> Halved {
    let mut to = Halved::default();
    for (to, channel) in to.iter_mut().zip(apart) {
        let channel = known.select(*channel, Lanes([f32::NAN; LANES]));
        for (to, number) in to.iter_mut().zip(channel.0) {
            *to = (number.to_bits().saturating_add(1 << 15) >> 16) as u16;
        }
    }
    to
}

/// Returns 1 where differences in half the memory are known, and 0 elsewhere.
#[inline(always)]
pub(crate) fn is_known(halved: &Halved) -> Lanes {
    Lanes(each(|lane| if halved[0][lane] & 0x7F80 == 0x7F80 { 0.0 } else { 1.0 }))
}

/// Returns the differences.
#[inline(always)]
pub(crate) fn whole(halved: &Halved) -> Difference {
    let mut to = Difference::default();
    for (to, channel) in to.iter_mut().zip(halved) {
        *to = Lanes(each(|lane| f32::from_bits(u32::from(channel[lane]) << 16)));
    }
    let known = finite(&[to[0], to[1], to[2]]);
    let of = |channel: Lanes| known.select(channel, Lanes::ZERO);
    [of(to[0]), of(to[1]), of(to[2]), known]
}

/// Returns differences less a share of the colors.
#[inline(always)]
pub(crate) fn without([r, g, b, known]: &Difference, share: Lanes, colors: &[Lanes; CHANNELS]) -> Difference {
    [*r - colors[0] * share, *g - colors[1] * share, *b - colors[2] * share, *known]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Halves of numbers are near to them, and what is not known stays so.
    #[test]
    fn halves_are_near() {
        let number = |lane: usize| [0.0, 1.0, -1.003, 3.0e38, -1e-30, 7.77, f32::MAX, 5.0][lane];
        let known = Lanes([1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0]);
        let found = whole(&halved(&[Lanes(each(number)), Lanes::ZERO, Lanes::ZERO], known));
        for lane in 0..6 {
            assert!((found[0].0[lane] - number(lane)).abs() <= number(lane).abs() / 256.0, "{lane}");
        }
        assert_eq!(found[CHANNELS].0, [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0]);
    }
}
