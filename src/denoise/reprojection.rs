//! Places of pixels in the frame before, and the mean of what lies around them there.

use super::lanes::{LANES, Lanes, each};
use glam::Vec2;

/// Least share of a pixel's surroundings in the frame before that must lie in the picture to be its history.
const LEAST_COVERED: f32 = 0.25;

/// Four items of a picture around a place, and the share of each.
#[derive(Debug, Clone, Copy)]
pub struct Around {
    /// Places in the picture.
    pub at: [usize; 4],
    /// Shares, 0 for places outside.
    pub share: [f32; 4],
    /// Sum of the shares.
    pub covered: f32,
}

/// Returns what lies around a place; `None` if (nearly) none of it is in a picture of `size`.
#[inline(always)]
pub fn around([width, height]: [usize; 2], place: Vec2) -> Option<Around> {
    let seen = place.x > -1.0 && place.y > -1.0 && place.x < width as f32 && place.y < height as f32;
    // Neither huge nor missing numbers pass.
    if !seen {
        return None;
    }
    if place.x >= 0.0 && place.y >= 0.0 && place.x < (width - 1) as f32 && place.y < (height - 1) as f32 {
        let (column, row) = (place.x as i32, place.y as i32);
        let (x, y) = (place.x - column as f32, place.y - row as f32);
        let (p, q) = (1.0 - x, 1.0 - y);
        let at = row as usize * width + column as usize;
        let share = [p * q, x * q, p * y, x * y];
        return Some(Around { at: [at, at + 1, at + width, at + width + 1], share, covered: 1.0 });
    }
    // Shifted by one, so that whole numbers are cut towards zero.
    let (column, row) = ((place.x + 1.0) as usize, (place.y + 1.0) as usize);
    let part = Vec2::new(place.x + 1.0 - column as f32, place.y + 1.0 - row as f32);
    let (left, right) = (column.saturating_sub(1), column.min(width - 1));
    let (above, below) = (row.saturating_sub(1), row.min(height - 1));
    let sides = [if column > 0 { 1.0 - part.x } else { 0.0 }, if column < width { part.x } else { 0.0 }];
    let ends = [if row > 0 { 1.0 - part.y } else { 0.0 }, if row < height { part.y } else { 0.0 }];
    let share = [sides[0] * ends[0], sides[1] * ends[0], sides[0] * ends[1], sides[1] * ends[1]];
    let covered = (share[0] + share[1]) + (share[2] + share[3]);
    let at = [above * width + left, above * width + right, below * width + left, below * width + right];
    (covered >= LEAST_COVERED).then_some(Around { at, share, covered })
}

impl Around {
    /// Returns the sum of the items around, each by its share.
    #[inline(always)]
    pub fn sum<const N: usize>(&self, items: &[[f32; N]]) -> [f32; N] {
        if self.share[0] == 1.0 {
            return items[self.at[0]];
        }
        let [i, j, k, l] = self.at;
        let (a, b, c, d) = (&items[i], &items[j], &items[k], &items[l]);
        let [p, q, r, s] = self.share;
        each(|i| (p * a[i] + q * b[i]) + (r * c[i] + s * d[i]))
    }
}

/// Places of eight pixels in a picture, each between four of its pixels.
#[derive(Debug, Clone, Copy)]
pub struct Eight {
    /// Place in the picture of the upper left one.
    at: [i32; LANES],
    /// Shares of the upper left, upper right, lower left and lower right one.
    share: [Lanes; 4],
}

impl Eight {
    /// Returns where eight pixels of a row, from `left` on, lie in the frame before; `None` if not all lie inside.
    #[inline(always)]
    pub fn inside([width, height]: [usize; 2], [left, y]: [usize; 2], motion: &[Vec2; LANES]) -> Option<Self> {
        let (mut x, mut y) = (Lanes([left as f32; LANES]), Lanes([y as f32; LANES]));
        let (across, down) = ((width as f32) - 1.0, (height as f32) - 1.0);
        let mut inside = true;
        for (lane, motion) in motion.iter().enumerate() {
            x.0[lane] += lane as f32 + motion.x;
            y.0[lane] += motion.y;
        }
        for lane in 0..LANES {
            inside &= x.0[lane] >= 0.0 && x.0[lane] < across && y.0[lane] >= 0.0 && y.0[lane] < down;
        }
        if !inside {
            return None;
        }
        let (mut at, mut p, mut q) = ([0; LANES], Lanes::ZERO, Lanes::ZERO);
        for lane in 0..LANES {
            let (column, row) = (x.0[lane] as i32, y.0[lane] as i32);
            p.0[lane] = x.0[lane] - column as f32;
            q.0[lane] = y.0[lane] - row as f32;
            at[lane] = row * width as i32 + column;
        }
        let one = Lanes([1.0; LANES]);
        let (r, s) = (one - p, one - q);
        Some(Self { at, share: [r * s, p * s, r * q, p * q] })
    }

    /// Returns the four pixels around a place in a picture of so many columns, and their shares.
    #[inline(always)]
    pub fn of(&self, lane: usize, width: usize) -> ([usize; 4], [f32; 4]) {
        let at = self.at[lane] as usize;
        ([at, at + 1, at + width, at + width + 1], each(|corner| self.share[corner].0[lane]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_mixed_from_what_lies_around() {
        let items: Vec<[f32; 2]> = (0..12).map(|i| [(i % 4) as f32, (i / 4) as f32]).collect();
        for place in [[0.0, 0.0], [1.25, 0.5], [3.0, 2.0], [2.5, 2.0], [2.999, 1.75]] {
            let found = around([4, 3], place.into()).map(|around| around.sum(&items));
            let near = found.is_some_and(|found| (Vec2::from(found) - Vec2::from(place)).abs().max_element() < 1e-5);
            assert!(near, "{place:?}: {found:?}");
        }
        for outside in [[-0.9, 0.0], [0.0, 2.9], [4.0, 1.0], [f32::NAN, 1.0], [1.0, f32::INFINITY], [-1e30, 0.0]] {
            assert!(around([4, 3], outside.into()).is_none(), "{outside:?}");
        }
        let edge = around([4, 3], Vec2::new(-0.5, 1.0));
        assert!(edge.is_some_and(|edge| edge.covered == 0.5 && edge.sum(&items) == [0.0, 0.5]));
    }
}
