//! Least noise that a neighbourhood has shown over time.
//!
//! Texture that resampling loses counts as noise in frames where its edges lie between pixels, and not in those where
//! they lie on them. Noise of a sequence changes slowly, so that the least of some frames is near to it ("minimum
//! statistics", Martin 2001).

use super::blocks::{BLOCK, Grid, Planes};
use super::lanes::{LANES, Lanes, each};
use glam::Vec2;

/// Factor by which the minimum grows from frame to frame, so that it is one of the latest dozen of frames.
const GROWTH: f32 = 1.1;

/// Minima of the frames before and of those with the frame, by neighbourhood: mean squares of the noise, in units of
/// the weighted sums; infinite where unknown.
#[derive(Debug, Default)]
pub(crate) struct Minimum {
    before: Planes,
    now: Planes,
}

impl Minimum {
    /// Creates minima of no frames.
    pub(crate) fn new(grid: Grid) -> Self {
        let mut now = Planes::new(grid, 1);
        now.data.fill(f32::INFINITY);
        Self { before: now.clone(), now }
    }

    /// Goes on to the next frame. Returns the minima of the frames before, and where those with the frame go.
    pub(crate) fn advance(&mut self) -> (&Planes, &mut Planes) {
        std::mem::swap(&mut self.before, &mut self.now);
        (&self.before, &mut self.now)
    }
}

/// Returns the minima of eight neighbourhoods where these have come from by the mean motions of blocks; infinite where
/// they come from outside.
#[inline(always)]
pub(crate) fn moved(minima: &Planes, motions: &[Vec2], row: usize, vector: usize) -> Lanes {
    let Grid { columns, rows } = minima.grid();
    Lanes(each(|lane| {
        let column = vector * LANES + lane;
        let motion = motions.get(row * columns + column).copied().unwrap_or_default();
        let place = (Vec2::new(column as f32, row as f32) + motion / BLOCK as f32).round();
        let is_inside =
            column < columns && (0.0..columns as f32).contains(&place.x) && (0.0..rows as f32).contains(&place.y);
        if is_inside { minima.row(place.y as usize, 0)[place.x as usize] } else { f32::INFINITY }
    }))
}

/// Returns the minima of eight neighbourhoods from those before and what the frame shows.
#[inline(always)]
pub(crate) fn next(before: Lanes, shown: Lanes) -> Lanes {
    (before * GROWTH).min(shown)
}

/// Returns the numbers of pixels of eight neighbourhoods of so many blocks to each side.
#[inline(always)]
pub(crate) fn pixels(grid: Grid, radius: usize, row: usize, vector: usize) -> Lanes {
    let blocks = |at: usize, count: usize| (at + radius + 1).min(count).saturating_sub(at.saturating_sub(radius));
    let columns: [f32; LANES] = each(|lane| blocks(vector * LANES + lane, grid.columns) as f32);
    Lanes(columns) * (blocks(row, grid.rows) * BLOCK * BLOCK) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Minima follow the motion, are kept for some frames, and rise to what is shown for long.
    #[test]
    fn minima_follow_the_motion_and_rise() {
        let grid = Grid { columns: 10, rows: 7 };
        let mut minimum = Minimum::new(grid);
        let (before, _) = minimum.advance();
        assert_eq!(moved(before, &[], 3, 0), Lanes([f32::INFINITY; LANES]));
        for (column, to) in minimum.now.data.iter_mut().enumerate() {
            *to = column as f32;
        }
        let (before, _) = minimum.advance();
        let motions = vec![Vec2::new(4.0 * BLOCK as f32, -1.4 * BLOCK as f32); 70];
        let at = |row: usize, column: usize| moved(before, &motions, row, 0).0[column];
        assert_eq!([at(1, 2), at(0, 2), at(1, 6)], [6.0, f32::INFINITY, f32::INFINITY]);
        let rise = |frames: usize| (0..frames).fold(Lanes([1.0; LANES]), |now, _| next(now, Lanes([2.0; LANES]))).0[0];
        assert!(rise(5) < 1.7 && rise(9) == 2.0);
        assert_eq!(pixels(grid, 2, 0, 0).0[..3], [144.0, 192.0, 240.0]);
        assert_eq!(pixels(grid, 2, 3, 1).0[..2], [320.0, 240.0]);
    }
}
