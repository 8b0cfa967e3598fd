//! The order in which pixels are handled.

/// Row-major indices of a picture's pixels along a Morton curve: what follows each other lies close
/// together at every scale, so that rays find their bricks in every cache.
pub fn morton(width: usize, height: usize) -> impl Iterator<Item = usize> {
    // Squares as high as the shorter side: the curve of a strip's longer side would be all gaps.
    let edge = width.min(height).next_power_of_two();
    let (across, down) = (width.div_ceil(edge), height.div_ceil(edge));
    (0..across * down * edge * edge).filter_map(move |i| {
        let (square, code) = (i / (edge * edge), i % (edge * edge));
        let x = square % across * edge + even_bits(code);
        let y = square / across * edge + even_bits(code >> 1);
        (x < width && y < height).then_some(y * width + x)
    })
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
    use super::{even_bits, morton};

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
}
