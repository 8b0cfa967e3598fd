//! Orders in which pixels are processed.

/// Returns the row-major indices of a picture's pixels along Morton curves: neighbours in the sequence lie close
/// together at every scale, so that rays find their bricks in every cache.
pub(crate) fn morton(width: usize, height: usize) -> impl Iterator<Item = usize> {
    let edge = square(width, height);
    let across = width.div_ceil(edge);
    (0..across * height.div_ceil(edge)).flat_map(move |number| {
        let [left, top] = [number % across * edge, number / across * edge];
        within([left, top], edge, [width, height]).map(move |[x, y]| y * width + x)
    })
}

/// Returns the edge, in pixels, of the squares that curves fill one by one. It is at least the shorter side; a curve
/// over the longer side of a strip would be mostly gaps.
fn square(width: usize, height: usize) -> usize {
    width.min(height).next_power_of_two()
}

/// Returns columns and rows of the pixels of a square with this lowest corner, along a Morton curve.
fn within([left, top]: [usize; 2], edge: usize, [width, height]: [usize; 2]) -> impl Iterator<Item = [usize; 2]> {
    (0..edge * edge).filter_map(move |code| {
        let [x, y] = [left + even_bits(code), top + even_bits(code >> 1)];
        (x < width && y < height).then_some([x, y])
    })
}

/// Least edge of a tile in pixels, and largest number of tiles along an edge of the curve's squares.
const TILE: usize = 8;
const MOST_TILES: usize = 64;

/// A picture cut into square tiles, numbered along Hilbert curves: any interval of one curve is connected and has a
/// short border.
#[derive(Debug, Clone)]
pub struct Tiles {
    /// Width of the picture, in pixels.
    pub width: usize,
    /// Height of the picture, in pixels.
    pub height: usize,
    /// Edge of a tile, in pixels.
    pub edge: usize,
    /// Number of tiles from left to right; those outside the picture have no pixels.
    pub columns: usize,
    /// Number of tiles from top to bottom.
    pub rows: usize,
    /// Binary logarithm of the number of tiles along an edge of the squares that curves fill.
    order: u8,
    /// Columns and rows of a tile's pixels within the tile.
    inside: Vec<[usize; 2]>,
}

impl Tiles {
    /// Cuts a picture of this size, in pixels.
    pub fn new(width: usize, height: usize) -> Self {
        let square = square(width, height);
        let edge = (square / MOST_TILES).max(TILE).min(square);
        let along = |size: usize| size.div_ceil(square) * (square / edge);
        let order = (square / edge).ilog2() as u8;
        let inside = within([0, 0], edge, [edge, edge]).collect();
        Self { width, height, edge, columns: along(width), rows: along(height), order, inside }
    }

    /// Returns the number of tiles.
    pub fn count(&self) -> usize {
        self.columns * self.rows
    }

    /// Returns column and row of a tile, by its number along the curves.
    pub fn place(&self, tile: usize) -> [usize; 2] {
        let (number, along) = (tile >> (2 * self.order), tile & ((1 << (2 * self.order)) - 1));
        let across = self.columns >> self.order;
        let (x, y) = fast_hilbert::h2xy::<u32>(along as u64, self.order);
        let place = |square: usize, within: u32| (square << self.order) + within as usize;
        [place(number % across, x), place(number / across, y)]
    }

    /// Returns column and row of a tile's first pixel.
    pub fn corner(&self, tile: usize) -> [usize; 2] {
        self.place(tile).map(|n| n * self.edge)
    }

    /// Returns columns and rows of a tile's pixels, along a Morton curve.
    pub fn pixels(&self, tile: usize) -> impl Iterator<Item = [usize; 2]> {
        let [left, top] = self.corner(tile);
        let all = self.inside.iter().map(move |[right, down]| [left + right, top + down]);
        all.filter(|[x, y]| *x < self.width && *y < self.height)
    }
}

/// Returns the bits at even places, compacted: pairs, then fours, eights and sixteens move together.
fn even_bits(code: usize) -> usize {
    let spread = [0x5555_5555_5555_5555, 0x3333_3333_3333_3333, 0x0f0f_0f0f_0f0f_0f0f, 0x00ff_00ff_00ff_00ff]
        .into_iter()
        .zip([0, 1, 2, 4])
        .fold(code as u64, |bits, (mask, by)| (bits | bits >> by) & mask);
    let bits = (spread | spread >> 8) & 0x0000_ffff_0000_ffff;
    ((bits | bits >> 16) & 0xffff_ffff) as usize
}

#[cfg(test)]
mod tests {
    use super::{Tiles, even_bits, morton};

    #[test]
    fn every_pixel_comes_once_and_neighbours_come_together() {
        let order: Vec<usize> = morton(5, 3).collect();
        assert_eq!(order[..4], [0, 1, 5, 6]);
        let mut sorted = order;
        sorted.sort_unstable();
        assert_eq!(sorted, (0..15).collect::<Vec<_>>());
        let (x, y) = (even_bits(0xffff_ffff_5555_5557), even_bits(0xffff_ffff_5555_5557 >> 1));
        assert_eq!((x, y), (0xffff_ffff, 0xffff_0001));
        assert_eq!(morton(1 << 20, 1).count() + morton(1, 1 << 20).count(), 2 << 20);
        assert_eq!(morton(0, 3).count() + morton(3, 0).count(), 0);
    }

    #[test]
    fn tiles_hold_their_pixels() {
        for (width, height) in [(5, 3), (3, 70), (64, 64), (1, 1), (1000, 700), (0, 4)] {
            let tiles = Tiles::new(width, height);
            let mut seen = vec![false; width * height];
            for tile in 0..tiles.count() {
                let [column, row] = tiles.place(tile);
                assert!(column < tiles.columns && row < tiles.rows);
                for [x, y] in tiles.pixels(tile) {
                    assert_eq!([x / tiles.edge, y / tiles.edge], [column, row], "{width} x {height}");
                    assert!(!std::mem::replace(&mut seen[y * width + x], true), "{width} x {height}: {x} {y} again");
                }
            }
            assert!(seen.iter().all(|seen| *seen), "{width} x {height}");
        }
        assert_eq!(
            [Tiles::new(64, 64), Tiles::new(1000, 700)].map(|t| (t.edge, t.columns, t.rows)),
            [(8, 8, 8), (16, 64, 64)]
        );
    }
}
