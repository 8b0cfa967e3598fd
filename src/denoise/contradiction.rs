//! Two alphas of one picture that contradict each other.

/// Edge of the blocks over which alphas are compared, in pixels: noise and other pixel filters average out.
const BLOCK: usize = 8;
/// Root mean square difference over blocks from which on alphas contradict each other.
const LEAST: f64 = 0.03;
/// Squares of block means over what noise explains of them, from which on alphas contradict each other.
const BEYOND_NOISE: f64 = 4.0;

/// Returns the root mean square over blocks by which two alphas of `width` columns differ beyond their noise; `None` if
/// they agree, or one of them is opaque everywhere, so that it shows nothing.
pub fn contradiction(a: &[f32], b: &[f32], width: usize) -> Option<f32> {
    let shows = |alpha: &[f32]| alpha.iter().any(|v| *v < 1.0);
    if width == 0 || a.len() != b.len() || !shows(a) || !shows(b) {
        return None;
    }
    let (mut apart, mut noise, mut blocks) = (0.0, 0.0, 0.0);
    for (a, b) in a.chunks(BLOCK * width).zip(b.chunks(BLOCK * width)) {
        for x in (0..width).step_by(BLOCK) {
            let (mut count, mut sum, mut squares, mut covered) = (0.0, 0.0, 0.0, false);
            for (a, b) in a.chunks(width).zip(b.chunks(width)) {
                let columns = x..(x + BLOCK).min(width);
                for (a, b) in a[columns.clone()].iter().zip(&b[columns]) {
                    let difference = f64::from(a - b);
                    if difference.is_finite() {
                        count += 1.0;
                        sum += difference;
                        squares += difference * difference;
                        covered |= *a > 0.0 || *b > 0.0;
                    }
                }
            }
            if covered && count > 1.0 {
                let mean = sum / count;
                apart += mean * mean;
                noise += (squares - sum * mean).max(0.0) / (count * (count - 1.0));
                blocks += 1.0;
            }
        }
    }
    let beyond = ((apart - noise).max(0.0) / f64::max(blocks, 1.0)).sqrt();
    (beyond > LEAST && apart > BEYOND_NOISE * noise).then_some(beyond as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Noise is no contradiction, another density is one.
    #[test]
    fn densities_are_told_from_noise() {
        let width = 61;
        let alpha = |scale: f32, paths: u32, seed: u32| -> Vec<f32> {
            let pixel = |i: usize| {
                let (x, y) = ((i % width) as f32 - 30.0, (i / width) as f32 - 20.0);
                let alpha = 1.0 - (-scale * (-(x * x + y * y) / 150.0).exp()).exp();
                if paths == 0 {
                    return alpha;
                }
                let hits = (0..paths).filter(|path| {
                    let mut v = (i as u32).wrapping_mul(0x9E37_79B9)
                        ^ seed.wrapping_mul(0x85EB_CA6B)
                        ^ path.wrapping_mul(0xC2B2_AE35);
                    v = (v ^ (v >> 15)).wrapping_mul(0x2C1B_3C6D);
                    v = (v ^ (v >> 12)).wrapping_mul(0x297A_2D39);
                    ((v ^ (v >> 15)) >> 8) as f32 / 16_777_216.0 < alpha
                });
                hits.count() as f32 / paths as f32
            };
            (0..61 * 41).map(pixel).collect()
        };
        let truth = alpha(1.5, 0, 0);
        for paths in [1, 4, 64] {
            assert_eq!(contradiction(&truth, &alpha(1.5, paths, 7), width), None, "{paths}");
            let found = contradiction(&alpha(0.5, 0, 0), &alpha(1.5, paths, 7), width);
            assert!(found.is_some_and(|v| (0.1..0.4).contains(&v)), "{paths}: {found:?}");
        }
        assert_eq!(contradiction(&truth, &vec![1.0; truth.len()], width), None);
    }
}
