//! Two halves of a pixel's paths that are independent, and the variance of the pixel's mean by them.
//!
//! Paths of one scrambled sequence cover a pixel evenly, so that they are no independent draws: the variance among them
//! overstates that of their mean, two times and more, and means over parts of them correlate. The halves have sequences
//! of their own (randomized quasi-Monte Carlo in two replicates; Owen 1997).

use crate::scene::film::Moments;
use glam::DVec4;

/// Pixels to each side over which the factor between both variances is pooled.
const RADIUS: usize = 8;

/// Bytes of memory per pixel that [`variances`] takes: both variances twice, their sums along rows, and their sums.
pub(super) const VARIANCE_BYTES: u64 = 7 * size_of::<DVec4>() as u64;

/// Sums over one half of a pixel's rays.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Half {
    /// Red, green, blue and alpha.
    sum: DVec4,
    rays: u32,
}

impl Half {
    /// Adds a ray's mean.
    pub(crate) fn add(&mut self, rgba: [f64; 4]) {
        self.sum += DVec4::from_array(rgba);
        self.rays += 1;
    }

    /// Adds the rays of another.
    pub(super) fn merge(&mut self, other: &Self) {
        self.sum += other.sum;
        self.rays += other.rays;
    }

    /// Returns the mean over the rays; 0 without any.
    pub(crate) fn mean(&self) -> DVec4 {
        self.sum / f64::from(self.rays.max(1))
    }
}

/// Returns the variance of the mean over both halves by their difference: unbiased, of one degree of freedom.
fn by_difference([a, b]: &[Half; 2]) -> DVec4 {
    let rays = f64::from(a.rays + b.rays);
    let apart = a.mean() - b.mean();
    f64::from(a.rays) * f64::from(b.rays) / (rays * rays) * apart * apart
}

/// Returns the variance of the mean over a pixel's rays among them, and that by its halves, which has the right level;
/// red, green, blue and alpha. Rays that are not in halves have the former twice.
pub(super) fn both(rgba: &[Moments; 4], halves: &[Half; 2], in_halves: bool) -> [DVec4; 2] {
    let among = DVec4::from_array(rgba.map(|m| m.variance_of_mean()));
    [among, if in_halves { by_difference(halves) } else { among }]
}

/// Returns the variances of the means of pixels over their rays, red, green, blue and alpha, from [`both`] of each in
/// row-major order.
///
/// The variance among a pixel's rays tells pixels apart, and the difference of its halves has the right level. The
/// former is multiplied by the ratio of both over the 17 x 17 pixels around. Infinite for pixels of one ray.
pub(super) fn variances<'p>(width: usize, pixels: impl Iterator<Item = &'p [DVec4; 2]>) -> Vec<[f32; 4]> {
    let (among, level): (Vec<DVec4>, Vec<DVec4>) = pixels.map(|[among, level]| (*among, *level)).unzip();
    if among.iter().any(|v| !v.is_finite()) {
        return among.iter().map(|v| v.as_vec4().to_array()).collect();
    }
    let around = [&among, &level].map(|values| pooled(width, values));
    let scaled = |i: usize| {
        let ratio = around[1][i] / around[0][i];
        let known = around[0][i].cmpgt(DVec4::ZERO);
        DVec4::select(known, among[i] * ratio, DVec4::ZERO).as_vec4().to_array()
    };
    (0..among.len()).map(scaled).collect()
}

/// Returns the sums over the pixels around each.
fn pooled(width: usize, values: &[DVec4]) -> Vec<DVec4> {
    let height = values.len() / width.max(1);
    let across: Vec<DVec4> = values.chunks(width.max(1)).flat_map(windows).collect();
    let mut sums = vec![DVec4::ZERO; values.len()];
    for x in 0..width {
        let column: Vec<DVec4> = (0..height).map(|y| across[y * width + x]).collect();
        windows(&column).enumerate().for_each(|(y, sum)| sums[y * width + x] = sum);
    }
    sums
}

/// Returns the sums over windows of a line. Each is summed alone: differences of running sums would lose what is dark
/// beside what is bright.
fn windows(line: &[DVec4]) -> impl Iterator<Item = DVec4> + '_ {
    (0..line.len()).map(|at| line[at.saturating_sub(RADIUS)..(at + RADIUS + 1).min(line.len())].iter().sum())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_end_at_the_picture() {
        let ones = pooled(3, &[DVec4::ONE; 6]);
        assert_eq!(ones, [DVec4::splat(6.0); 6]);
        let line: Vec<DVec4> = (0..40).map(|i| DVec4::splat(f64::from(i))).collect();
        let long: Vec<DVec4> = windows(&line).collect();
        assert_eq!((long[0].x, long[20].x, long[39].x), (36.0, 17.0 * 20.0, (31..40).sum::<i32>().into()));
    }

    /// Pixels of two rays have the variance of both.
    #[test]
    fn two_rays_are_two_halves() {
        let (mut rgba, mut halves) = <([Moments; 4], [Half; 2])>::default();
        let none = both(&rgba, &halves, true);
        assert_eq!(variances(1, [none].iter())[0][0], f32::INFINITY);
        for (half, v) in [(0, 1.0), (1, 4.0)] {
            rgba.iter_mut().for_each(|m| m.add(v));
            halves[half].add([v; 4]);
        }
        for in_halves in [true, false] {
            assert_eq!(variances(1, [both(&rgba, &halves, in_halves)].iter()), [[2.25; 4]]);
        }
    }
}
