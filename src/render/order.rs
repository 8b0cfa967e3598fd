//! The order in which pixels are handled.

/// Row-major indices of a picture's pixels along a Morton curve: what follows each other lies close
/// together at every scale, so that rays find their bricks in every cache.
pub fn morton(width: usize, height: usize) -> impl Iterator<Item = usize> {
    let edge = width.max(height).next_power_of_two();
    (0..edge * edge).filter_map(move |code| {
        let (x, y) = (even_bits(code), even_bits(code >> 1));
        (x < width && y < height).then_some(y * width + x)
    })
}

fn even_bits(code: usize) -> usize {
    (0..usize::BITS / 2).map(|bit| (code >> (2 * bit) & 1) << bit).sum()
}

#[cfg(test)]
mod tests {
    use super::morton;

    #[test]
    fn every_pixel_comes_once_and_neighbours_come_together() {
        let order: Vec<usize> = morton(5, 3).collect();
        assert_eq!(order[..4], [0, 1, 5, 6]);
        let mut sorted = order;
        sorted.sort_unstable();
        assert_eq!(sorted, (0..15).collect::<Vec<_>>());
        assert_eq!(morton(0, 3).count() + morton(3, 0).count(), 0);
    }
}
