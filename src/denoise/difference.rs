//! Differences between a frame's colors and those of a neighbouring frame.
//!
//! Both frames show the same signal with noise of their own, and so the product of a pixel's differences from the frame before and
//! from the frame after is on average the square of its own noise (the "three-cornered hat" of clocks, Gray & Allan 1974).
//! Histories would have less noise and more blur; a single frame is resampled once, and by a cubic kernel (Keys 1981).

use super::frame::Frame;
use super::lanes::{LANES, Lanes, each};
use super::reprojection::Taps;
use glam::Vec2;

/// Differences of eight pixels by channel, and 1 where they are known.
pub type Difference = [Lanes; 4];

/// Channels of a color.
const CHANNELS: usize = 3;

/// Colors of a neighbouring frame.
#[derive(Debug, Clone, Default)]
pub struct Neighbour {
    size: [usize; 2],
    /// Channels pixel by pixel.
    colors: Vec<f32>,
}

impl Neighbour {
    /// Takes the colors of a frame.
    pub fn take(&mut self, frame: &Frame<'_>) {
        self.size = frame.size;
        self.colors.clear();
        self.colors.extend(frame.color.iter().flat_map(|color| color.to_array()));
    }

    /// Writes the differences between a row's colors and those of this frame, to which the frame's motion leads. They are not
    /// known where that shows nothing, or no numbers.
    #[inline(always)]
    pub fn differences(&self, frame: &Frame<'_>, y: usize, to: &mut [Difference]) {
        let [width, _] = frame.size;
        if self.size != frame.size {
            to.fill(Difference::default());
            return;
        }
        let row = y * width;
        let motion = frame.motion.map(|motion| &motion[row..][..width]);
        for (at, (colors, to)) in frame.color[row..][..width].chunks(LANES).zip(&mut *to).enumerate() {
            let left = at * LANES;
            *to = Difference::default();
            for (lane, color) in colors.iter().enumerate() {
                let x = left + lane;
                let motion = motion.map_or(Vec2::ZERO, |motion| motion[x]);
                let Some(other) = self.resampled([x, y], motion) else { continue };
                let apart: [f32; CHANNELS] = each(|c| color[c] - other[c]);
                let known = apart.iter().all(|apart| apart.is_finite());
                for (to, apart) in to.iter_mut().zip(apart) {
                    to.0[lane] = if known { apart } else { 0.0 };
                }
                to[CHANNELS].0[lane] = if known { 1.0 } else { 0.0 };
            }
        }
    }

    /// Returns the color at a pixel's place in this frame; `None` where that lies outside or at its border.
    #[inline(always)]
    fn resampled(&self, [x, y]: [usize; 2], motion: Vec2) -> Option<[f32; CHANNELS]> {
        let [width, _] = self.size;
        if motion == Vec2::ZERO {
            return self.colors.get(CHANNELS * (y * width + x)..)?.first_chunk().copied();
        }
        let Taps { first, columns, rows } = Taps::around(self.size, Vec2::new(x as f32, y as f32) + motion)?;
        let mut sum = [0.0; 4 * CHANNELS];
        for (row, share) in rows.into_iter().enumerate() {
            let from: &[f32; 4 * CHANNELS] = self.colors.get(CHANNELS * (first + row * width)..)?.first_chunk()?;
            sum = each(|i| sum[i] + from[i] * share);
        }
        let [p, q, r, s] = columns;
        Some(each(|c| (p * sum[c] + q * sum[3 + c]) + (r * sum[6 + c] + s * sum[9 + c])))
    }
}

/// Differences of eight pixels by channel in half the memory: the upper halves of their bits. Not a number where unknown.
pub type Halved = [[u16; LANES]; CHANNELS];

/// Returns differences in half the memory.
#[inline(always)]
pub fn halved(difference: &Difference) -> Halved {
    let mut to = Halved::default();
    for (to, channel) in to.iter_mut().zip(difference) {
        let channel = difference[CHANNELS].select(*channel, Lanes([f32::NAN; LANES]));
        for (to, number) in to.iter_mut().zip(channel.0) {
            *to = (number.to_bits().saturating_add(1 << 15) >> 16) as u16;
        }
    }
    to
}

/// Returns the differences.
#[inline(always)]
pub fn whole(halved: &Halved) -> Difference {
    let mut to = Difference::default();
    for (to, channel) in to.iter_mut().zip(halved) {
        *to = Lanes(each(|lane| f32::from_bits(u32::from(channel[lane]) << 16)));
    }
    for lane in 0..LANES {
        // Of numbers that are not finite the product is not a number.
        let zero = (to[0].0[lane] * 0.0 + to[1].0[lane] * 0.0) + to[2].0[lane] * 0.0;
        to[CHANNELS].0[lane] = if zero == 0.0 { 1.0 } else { 0.0 };
    }
    let known = to[CHANNELS];
    for channel in &mut to[..CHANNELS] {
        *channel = known.select(*channel, Lanes::ZERO);
    }
    to
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    /// Pixels that move as the motion says do not differ; those that come from outside are not known.
    #[test]
    fn what_moves_along_does_not_differ() {
        const SIZE: [usize; 2] = [19, 9];
        let at = |shift: [f32; 2]| -> Vec<Vec3> {
            let place = |i: usize| Vec2::new((i % SIZE[0]) as f32, (i / SIZE[0]) as f32) - Vec2::from(shift);
            (0..SIZE[0] * SIZE[1]).map(|i| place(i)).map(|p| Vec3::new(p.x, p.y * p.y, 0.1 * p.x * p.y)).collect()
        };
        for shift in [[0.0, 0.0], [2.0, 1.0], [0.5, -0.25]] {
            let (before, now) = (at([0.0; 2]), at(shift));
            let motion = vec![-Vec2::from(shift); now.len()];
            let mut neighbour = Neighbour::default();
            neighbour.take(&Frame { size: SIZE, color: &before, ..Frame::default() });
            let frame = Frame { size: SIZE, color: &now, motion: Some(&motion), ..Frame::default() };
            let mut found = [Difference::default(); SIZE[0].div_ceil(LANES)];
            for y in 0..SIZE[1] {
                neighbour.differences(&frame, y, &mut found);
                for x in 0..SIZE[0] {
                    let [r, g, b, known] = found[x / LANES].map(|channel| channel.0[x % LANES]);
                    let place = Vec2::new(x as f32, y as f32) - Vec2::from(shift);
                    let inside = shift == [0.0; 2] || Taps::around(SIZE, place).is_some();
                    assert_eq!(known, if inside { 1.0 } else { 0.0 }, "{shift:?}: {x} {y}");
                    assert!(r.abs().max(g.abs()).max(b.abs()) < 1e-4, "{shift:?}: {x} {y}");
                    assert_eq!(whole(&halved(&found[x / LANES]))[CHANNELS].0[x % LANES], known);
                }
            }
        }
    }

    /// Halves of numbers are near to them, and what is not known stays so.
    #[test]
    fn halves_are_near() {
        let number = |lane: usize| [0.0, 1.0, -1.003, 3.0e38, -1e-30, 7.77, f32::MAX, 5.0][lane];
        let known = Lanes([1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0]);
        let found = whole(&halved(&[Lanes(each(number)), Lanes::ZERO, Lanes::ZERO, known]));
        for lane in 0..6 {
            assert!((found[0].0[lane] - number(lane)).abs() <= number(lane).abs() / 256.0, "{lane}");
        }
        assert_eq!(found[CHANNELS].0, [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0]);
    }
}
