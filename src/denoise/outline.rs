//! Alpha as a guide: whether it shows outlines better than noisy colors do.

use super::frame::Frame;
use super::noise::{KERNEL, NEAREST};
use glam::Vec3;
use rayon::prelude::*;

/// Rows of which one is looked at.
const LOOK: usize = 8;
/// Alpha from which on a pixel counts as opaque.
const OPAQUE: f32 = 0.999;
/// Share of the looked-at pixels that must be empty for the background to be judged.
const LEAST_EMPTY: f32 = 1.0 / 256.0;
/// Weight of the prior that colors are proportional to alpha: where something shows behind, and where all is black.
const PROPORTIONAL: [f32; 2] = [0.1, 10.0];
/// Alphas between which a pixel and all around it lie for its noise to be told from an outline.
const PARTIAL: [f32; 2] = [0.02, 0.98];
/// Variance of the noise as a share of `α (1 - α)`, which is that of one path that ends in the volume or does not,
/// above which few paths sampled alpha: where alpha is partial all around, and in the whole picture. This is by second
/// differences, to which the finest outlines are noise.
const NOISY: [f64; 2] = [0.01, 0.15];
/// Variance of the noise as a share of `α (1 - α)`, above which few paths sampled alpha: where alpha is partial all
/// around, and in the whole picture. This is by the lesser estimate, to which outlines are no noise.
const SAMPLED: [f64; 2] = [0.005, 0.12];
/// Relative variance of alpha's noise, as a share of that of the colors, up to which alpha guides all the same.
const CLEANER: f64 = 0.35;

/// Guide that a frame has.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Outline<'f> {
    /// Alpha, if it tells anything: not if it is opaque everywhere, or noisy. The finest outlines count as noise, since
    /// features that follow alpha are smoothed over more pixels.
    pub alpha: Option<&'f [f32]>,
    /// Alpha, if it is exact: not sampled by few paths, whatever its outlines are.
    pub exact: Option<&'f [f32]>,
    /// Weight of the prior that colors are proportional to alpha.
    pub proportional: f32,
}

impl<'f> Outline<'f> {
    /// Returns the guide of a frame.
    pub(crate) fn of(frame: &Frame<'f>) -> Self {
        let [width, _] = frame.size;
        let alphas = frame.alpha.unwrap_or_default();
        let rows = alphas.par_chunks(width).zip(frame.color.par_chunks(width)).step_by(LOOK);
        let counts = rows.map(|(alphas, colors)| {
            alphas.iter().zip(colors).fold([0_u32; 4], |[empty, lit, clear, all], (alpha, color)| {
                let is_empty = *alpha == 0.0;
                let is_lit = is_empty && *color != Vec3::ZERO;
                [empty + u32::from(is_empty), lit + u32::from(is_lit), clear + u32::from(*alpha < OPAQUE), all + 1]
            })
        });
        let [empty, lit, clear, all] = counts.reduce(|| [0; 4], |a, b| std::array::from_fn(|i| a[i] + b[i]));
        let black = lit == 0 && empty as f32 > LEAST_EMPTY * all as f32;
        let alpha = frame.alpha.filter(|_| clear > 0);
        let [is_noisy, is_sampled] = alpha.map_or([false; 2], |alpha| noisy(alpha, frame.color, width));
        Self {
            alpha: alpha.filter(|_| !is_noisy),
            exact: alpha.filter(|_| !is_sampled),
            proportional: PROPORTIONAL[usize::from(black)],
        }
    }
}

/// Sums over pixels of the noise of alpha by both estimates, and of `α (1 - α)`.
type Sampled = [f64; 3];

/// Sums over pixels.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    /// Where alpha is partial all around, and everywhere.
    partial: Sampled,
    whole: Sampled,
    /// Noise and square, of alpha and of the colors.
    alpha: [f64; 2],
    color: [f64; 2],
}

impl Sums {
    fn plus(self, other: Self) -> Self {
        Self {
            partial: plus(self.partial, other.partial),
            whole: plus(self.whole, other.whole),
            alpha: plus(self.alpha, other.alpha),
            color: plus(self.color, other.color),
        }
    }
}

fn plus<const N: usize>(a: [f64; N], b: [f64; N]) -> [f64; N] {
    std::array::from_fn(|i| a[i] + b[i])
}

/// Returns the variance of noise at a place of a picture of `width`, by two estimates: by second differences in both
/// directions (Immerkær 1996), which smooth shades do not have; and by the lesser of that and of what the nearest of
/// four neighbours shows, one of which lies on the same side of any outline.
fn noise(of: impl Fn(usize) -> f32, at: usize, width: usize) -> [f32; 2] {
    let second = |at: usize| (of(at - 1) + of(at + 1)) - 2.0 * of(at);
    let smooth = ((second(at - width) + second(at + width)) - 2.0 * second(at)).powi(2) / KERNEL;
    let apart = |near: usize| (of(at) - of(near)).powi(2);
    let nearest = apart(at - 1).min(apart(at + 1)).min(apart(at - width)).min(apart(at + width));
    [smooth, smooth.min(NEAREST * nearest)]
}

/// Returns whether alpha was sampled by few paths, and is not much cleaner than the colors: where the finest outlines
/// count as noise, and where they do not.
fn noisy(alpha: &[f32], color: &[Vec3], width: usize) -> [bool; 2] {
    let height = alpha.len() / width;
    let looked = || (1..height.saturating_sub(1)).step_by(LOOK);
    let light = |at: usize| Some(color[at].element_sum().abs()).filter(|light| light.is_finite()).unwrap_or(0.0);
    let (sum, count) = looked()
        .flat_map(|y| y * width..(y + 1) * width)
        .fold((0.0_f64, 0.0_f64), |(sum, count), at| (sum + f64::from(light(at)), count + 1.0));
    // Compressed, so that a few bright pixels are not all of the noise.
    let mean = (sum / count.max(1.0)) as f32 + f32::MIN_POSITIVE;
    let shown = |at: usize| light(at) / (light(at) + mean);
    let of_row = |y: usize| {
        let mut sums = Sums::default();
        let top = (y - 1) * width;
        let lines: Vec<f32> = (top..top + 3 * width).map(shown).collect();
        for at in y * width + 1..(y + 1) * width - 1 {
            let (own, [apart, least]) = (alpha[at], noise(|at| alpha[at], at, width));
            if !(own + apart).is_finite() {
                continue;
            }
            let rows = [at - width, at, at + width];
            let all = rows.into_iter().flat_map(|at| &alpha[at - 1..at + 2]);
            let [low, high] = all.fold([1.0_f32, 0.0], |[low, high], v| [low.min(*v), high.max(*v)]);
            let inside = if low > PARTIAL[0] && high < PARTIAL[1] { 1.0 } else { 0.0 };
            let sampled = [apart, least, own * (1.0 - own)];
            add(&mut sums.partial, sampled.map(|term| inside * term));
            add(&mut sums.whole, sampled);
            add(&mut sums.alpha, [apart, own * own]);
            add(&mut sums.color, [noise(|at| lines[at], at - top, width)[0], lines[at - top].powi(2)]);
        }
        sums
    };
    let rows: Vec<usize> = looked().collect();
    let sums: Vec<Sums> = rows.into_par_iter().map(of_row).collect();
    // In order, so that the sum is the same for any number of threads.
    let sums = sums.into_iter().fold(Sums::default(), Sums::plus);
    let [[alpha, alphas], [color, colors]] = [sums.alpha, sums.color];
    let is_no_cleaner = alpha * colors > CLEANER * color * alphas;
    let exceeds = |sums: Sampled, estimate: usize, share: f64| sums[estimate] > share * sums[2];
    let is_sampled = |estimate: usize, [partial, whole]: [f64; 2]| {
        exceeds(sums.partial, estimate, partial) || exceeds(sums.whole, estimate, whole)
    };
    [is_no_cleaner && is_sampled(0, NOISY), is_no_cleaner && is_sampled(1, SAMPLED)]
}

fn add<const N: usize>(sums: &mut [f64; N], terms: [f32; N]) {
    for (sum, term) in sums.iter_mut().zip(terms) {
        *sum += f64::from(term);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [usize; 2] = [64, 48];

    /// A ball with a soft outline, of which each pixel is `paths` paths' share if that is not 0.
    fn ball(paths: u32) -> Vec<f32> {
        let at = |i: usize| {
            let (x, y) = ((i % SIZE[0]) as f32 - 32.0, (i / SIZE[0]) as f32 - 24.0);
            let alpha = (0.5 - 0.08 * (x.hypot(y) - 14.0)).clamp(0.0, 1.0);
            let hit = |path: u32| {
                let h = ((i as u32 * 64 + path) ^ 0x9E37_79B9).wrapping_mul(0x85EB_CA6B);
                let h = (h ^ (h >> 13)).wrapping_mul(0xC2B2_AE35);
                ((h ^ (h >> 16)) as f32) < alpha * u32::MAX as f32
            };
            if paths == 0 { alpha } else { (0..paths).filter(|path| hit(*path)).count() as f32 / paths as f32 }
        };
        (0..SIZE[0] * SIZE[1]).map(at).collect()
    }

    fn outline<'f>(alpha: &'f [f32], color: &'f [Vec3]) -> Outline<'f> {
        Outline::of(&Frame { size: SIZE, color, motion: None, alpha: Some(alpha), ahead: None })
    }

    #[test]
    fn clean_alpha_guides_and_noisy_or_opaque_alpha_does_not() {
        let clean = ball(0);
        let colors: Vec<Vec3> = clean.iter().map(|alpha| Vec3::splat(*alpha)).collect();
        assert!(outline(&clean, &colors).alpha.is_some());
        for paths in [1, 2, 4, 8, 16] {
            let alpha = ball(paths);
            let found = outline(&alpha, &colors);
            assert!(found.alpha.is_none() && found.exact.is_none(), "{paths}");
        }
        // Not so far as colors are much noisier.
        let spikes: Vec<Vec3> =
            colors.iter().enumerate().map(|(i, c)| *c * if i % 7 == 0 { 7.0 } else { 0.0 }).collect();
        assert!(outline(&ball(16), &spikes).alpha.is_some());
        // A sharp outline is no noise.
        let sharp: Vec<f32> = clean.iter().map(|alpha| ((alpha - 0.5) * 8.0 + 0.5).clamp(0.0, 1.0)).collect();
        assert!(outline(&sharp, &colors).alpha.is_some());
        // Nor is one of no pixel's width, but it is no guide.
        let hard: Vec<f32> = clean.iter().map(|alpha| if *alpha > 0.5 { 1.0 } else { 0.0 }).collect();
        assert!(outline(&hard, &colors).alpha.is_none() && outline(&hard, &colors).exact.is_some());
        assert!(outline(&vec![1.0; colors.len()], &colors).alpha.is_none());
        assert!(outline(&vec![f32::NAN; colors.len()], &colors).alpha.is_none());
    }

    #[test]
    fn a_background_that_shows_is_no_share_of_alpha() {
        let alpha = ball(0);
        let over = |background: f32| -> f32 {
            let color = |alpha: &f32| Vec3::splat(*alpha + (1.0 - alpha) * background);
            outline(&alpha, &alpha.iter().map(color).collect::<Vec<_>>()).proportional
        };
        assert_eq!([over(0.2), over(0.0)], PROPORTIONAL);
    }
}
