//! Places of pixels in the frame before, and the mean of what lies around them there.

use super::lanes::{LANES, Lanes, each};
use glam::Vec2;

/// Least share of a pixel's surroundings in the frame before that must lie in the picture to be its history.
const LEAST_COVERED: f32 = 0.25;

/// Four items of a picture around a place, and the share of each.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Around {
    /// Places in the picture.
    pub at: [usize; 4],
    /// Shares, 0 for places outside.
    pub share: [f32; 4],
    /// Sum of the shares.
    pub covered: f32,
}

/// Returns what lies around a place; `None` if (nearly) none of it is in a picture of `size`.
#[inline(always)]
pub(crate) fn around([width, height]: [usize; 2], place: Vec2) -> Option<Around> {
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

/// Returns the value of cells of so many pixels along each edge at a pixel, linear between the cells' centres.
#[inline(always)]
pub(crate) fn of_cells(values: &[[f32; 1]], [columns, rows]: [usize; 2], edge: usize, pixel: [usize; 2]) -> f32 {
    let place = (Vec2::from(pixel.map(|at| at as f32)) + 0.5) / edge as f32 - 0.5;
    let last = Vec2::new((columns - 1) as f32, (rows - 1) as f32);
    // Between the first and the last there is always one.
    let [value] = around([columns, rows], place.max(Vec2::ZERO).min(last)).map_or([0.0], |around| around.sum(values));
    value
}

impl Around {
    /// Returns the sum of the items around, each by its share.
    #[inline(always)]
    pub(crate) fn sum<const N: usize>(&self, items: &[[f32; N]]) -> [f32; N] {
        if self.share[0] == 1.0 {
            return items[self.at[0]];
        }
        let [i, j, k, l] = self.at;
        let (a, b, c, d) = (&items[i], &items[j], &items[k], &items[l]);
        let [p, q, r, s] = self.share;
        each(|i| (p * a[i] + q * b[i]) + (r * c[i] + s * d[i]))
    }
}

/// Sixteen pixels of a picture around each of eight places, four in each of four rows, and the shares of columns and
/// rows by cubic convolution (Keys 1981), which keeps detail that the mean of four pixels blurs.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Taps {
    /// 1 where all pixels are in the picture.
    inside: Lanes,
    /// Columns and rows of the pixels that lie before the places, where all are inside.
    before: [[i32; LANES]; 2],
    /// Shares of the four columns, and of the four rows.
    shares: [[Lanes; 4]; 2],
}

impl Taps {
    /// Returns the pixels around places in a picture of `size`.
    #[inline(always)]
    pub(crate) fn around(size: [usize; 2], places: [Lanes; 2]) -> Self {
        let mut taps = Self { inside: Lanes([1.0; LANES]), before: Default::default(), shares: Default::default() };
        for (axis, place) in places.into_iter().enumerate() {
            let most = size[axis] as f32 - 3.0;
            let whole = place.max(Lanes([1.0; LANES])).min(Lanes([most; LANES]));
            taps.before[axis] = each(|lane| whole.0[lane] as i32);
            // Neither huge nor missing numbers pass.
            let inside = each(|lane| if place.0[lane] >= 1.0 && place.0[lane] < most + 1.0 { 1.0 } else { 0.0 });
            taps.inside = taps.inside * Lanes(inside);
            taps.shares[axis] = cubic(place - Lanes(each(|lane| taps.before[axis][lane] as f32)));
        }
        taps
    }

    /// Returns the place of the upper left pixel around one of the places in a picture of `width`; `None` if not all
    /// pixels are in the picture.
    #[inline(always)]
    pub(crate) fn first(&self, lane: usize, width: usize) -> Option<usize> {
        let (column, row) = (self.before[0][lane] as usize, self.before[1][lane] as usize);
        if self.inside.0[lane] > 0.0 { Some((row - 1) * width + column - 1) } else { None }
    }

    /// Returns the shares of the four columns (axis 0) or rows (axis 1) around one of the places.
    #[inline(always)]
    pub(crate) fn shares(&self, axis: usize, lane: usize) -> [f32; 4] {
        each(|at| self.shares[axis][at].0[lane])
    }
}

/// Returns the shares of four pixels in a row at a part of the way from the second to the third.
#[inline(always)]
fn cubic(part: Lanes) -> [Lanes; 4] {
    let rest = Lanes([1.0; LANES]) - part;
    let half = part * rest * 0.5;
    // The inner ones have their linear shares, and what the outer ones lack.
    let outer = |inner: Lanes| Lanes::ZERO - half * inner;
    [outer(rest), rest + half * (rest * 2.0 - part), part + half * (part * 2.0 - rest), outer(part)]
}

/// Returns the share of the variance of independent noise that is left where a picture is resampled by a motion; all of
/// it where the motion is not a number.
pub(crate) fn noise_gain(motion: Vec2) -> f32 {
    let of =
        |place: f32| cubic(Lanes([place - place.floor(); LANES])).iter().map(|share| share.0[0].powi(2)).sum::<f32>();
    let gain = of(motion.x) * of(motion.y);
    if gain.is_finite() { gain } else { 1.0 }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    /// Shares add to 1, and keep any parabola.
    #[test]
    fn parabolas_stay() {
        let found = |size: [usize; 2], place: [f32; 2]| {
            let taps = Taps::around(size, place.map(|place| Lanes([place; LANES])));
            taps.first(5, size[0]).map(|first| (first, [0, 1].map(|axis| taps.shares(axis, 5))))
        };
        for place in [[1.0, 1.0], [1.25, 2.5], [2.999, 1.0]] {
            let (first, shares) = found([6, 5], place).unwrap();
            for power in 0..3 {
                let of = |x: f32| x.powi(power);
                for (axis, first) in [first % 6, first / 6].into_iter().enumerate() {
                    let terms = shares[axis].iter().enumerate().map(|(i, share)| share * of((first + i) as f32));
                    let sum: f32 = terms.sum();
                    assert!((sum - of(place[axis])).abs() < 1e-4, "{place:?} {power}");
                }
            }
        }
        for outside in [[0.9, 1.0], [4.0, 1.0], [1.0, 3.0], [f32::NAN, 1.0], [1e30, 1.0]] {
            assert!(found([6, 5], outside).is_none(), "{outside:?}");
        }
        assert!(found([3, 3], [1.0, 1.0]).is_none());
    }

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
