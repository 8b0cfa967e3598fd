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
    let (across, square) = (width.div_ceil(edge), 2 * edge.ilog2());
    stretch.filter_map(move |i| {
        let (number, code) = (i >> square, i & ((1 << square) - 1));
        let x = number % across * edge + even_bits(code);
        let y = number / across * edge + even_bits(code >> 1);
        (x < width && y < height).then_some(y * width + x)
    })
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
    use super::{even_bits, length, morton, stretch};

    #[test]
    fn every_pixel_comes_once_and_neighbours_come_together() {
        let order: Vec<usize> = morton(5, 3).collect();
        assert_eq!(order[..4], [0, 1, 5, 6]);
        let parts = (0..length(5, 3)).step_by(3).flat_map(|from| stretch(5, 3, from..(from + 3).min(length(5, 3))));
        assert!(parts.eq(order.iter().copied()), "stretches make up the whole");
        let mut sorted = order;
        sorted.sort_unstable();
        assert_eq!(sorted, (0..15).collect::<Vec<_>>());
        let (x, y) = (even_bits(0xffff_ffff_5555_5557), even_bits(0xffff_ffff_5555_5557 >> 1));
        assert_eq!((x, y), (0xffff_ffff, 0xffff_0001));
        assert_eq!(morton(1 << 20, 1).count() + morton(1, 1 << 20).count(), 2 << 20);
        assert_eq!(morton(0, 3).count() + morton(3, 0).count(), 0);
    }
}
