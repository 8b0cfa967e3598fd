//! The order in which pixels are handled.

use std::ops::Range;

/// Row-major indices of a picture's pixels along a Morton curve: what follows each other lies close
/// together at every scale, so that rays find their bricks in every cache.
pub fn morton(width: usize, height: usize) -> impl Iterator<Item = usize> {
    stretch(width, height, 0..length(width, height))
}

/// Length of the curve, gaps beyond the picture included.
pub fn length(width: usize, height: usize) -> usize {
    let edge = edge(width, height);
    width.div_ceil(edge) * height.div_ceil(edge) * edge * edge
}

/// The pixels of a stretch of the curve.
pub fn stretch(width: usize, height: usize, stretch: Range<usize>) -> impl Iterator<Item = usize> {
    let edge = edge(width, height);
    let across = width.div_ceil(edge);
    stretch.filter_map(move |i| {
        let [x, y] = place(i, edge, across);
        (x < width && y < height).then_some(y * width + x)
    })
}

/// A rectangle that holds all pixels of a stretch: its lowest corner, and one past its highest.
pub fn bounds(width: usize, height: usize, stretch: Range<usize>) -> [[usize; 2]; 2] {
    let edge = edge(width, height);
    let (mut low, mut high, mut at) = ([usize::MAX; 2], [0; 2], stretch.start);
    while at < stretch.end {
        // The largest block that begins here: a square, or two of them side by side.
        let bits = at.trailing_zeros().min((stretch.end - at).ilog2()).min(2 * edge.ilog2());
        let [x, y] = place(at, edge, width.div_ceil(edge));
        low = [low[0].min(x), low[1].min(y)];
        high = [high[0].max(x + (1 << bits.div_ceil(2))), high[1].max(y + (1 << (bits / 2)))];
        at += 1 << bits;
    }
    [low, high]
}

/// Column and row of a point of the curve, by the edge of its squares and how many of these lie side by side.
fn place(i: usize, edge: usize, across: usize) -> [usize; 2] {
    let square = 2 * edge.ilog2();
    let (number, code) = (i >> square, i & ((1 << square) - 1));
    [number % across * edge + even_bits(code), number / across * edge + even_bits(code >> 1)]
}

/// Of the squares that a curve fills: as high as the shorter side, for the curve of a strip's longer side would be all
/// gaps.
fn edge(width: usize, height: usize) -> usize {
    width.min(height).next_power_of_two()
}

/// The bits at even places, moved together: pairs, then fours, eights and sixteens close ranks.
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
    use super::{bounds, even_bits, length, morton, stretch};

    #[test]
    fn every_pixel_comes_once_and_neighbours_come_together() {
        let order: Vec<usize> = morton(5, 3).collect();
        assert_eq!(order[..4], [0, 1, 5, 6]);
        let parts = (0..length(5, 3)).step_by(3).flat_map(|from| stretch(5, 3, from..(from + 3).min(length(5, 3))));
        assert!(parts.eq(order.iter().copied()), "stretches make up the whole");
        for (width, height) in [(5, 3), (3, 70), (64, 64), (1, 1)] {
            for (from, to) in [(0, 1), (3, 9), (5, 60), (17, 4096), (0, 200)] {
                let part = from..length(width, height).min(to);
                let [low, high] = bounds(width, height, part.clone());
                let (mut least, mut most) = ([usize::MAX; 2], [0; 2]);
                for i in stretch(width, height, part) {
                    let at = [i % width, i / width];
                    (least, most) = ([0, 1].map(|a| least[a].min(at[a])), [0, 1].map(|a| most[a].max(at[a] + 1)));
                }
                let holds = (0..2).all(|a| low[a] <= least[a] && most[a] <= high[a]);
                assert!(holds, "{width} x {height}, {from}..{to}: {low:?} {high:?} hold {least:?} {most:?}");
            }
        }
        assert_eq!(bounds(64, 64, 512..1024), [[0, 16], [32, 32]], "and no more");
        let mut sorted = order;
        sorted.sort_unstable();
        assert_eq!(sorted, (0..15).collect::<Vec<_>>());
        let (x, y) = (even_bits(0xffff_ffff_5555_5557), even_bits(0xffff_ffff_5555_5557 >> 1));
        assert_eq!((x, y), (0xffff_ffff, 0xffff_0001));
        assert_eq!(morton(1 << 20, 1).count() + morton(1, 1 << 20).count(), 2 << 20);
        assert_eq!(morton(0, 3).count() + morton(3, 0).count(), 0);
    }
}
