//! Alpha as a guide: whether it shows outlines better than noisy colors do.

use super::frame::Frame;
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
/// Variance of the noise as a share of `α (1 - α)`, which is that of one path that ends in the volume or does not, above which
/// few paths sampled alpha: where alpha is partial all around, and in the whole picture, whose outlines count as noise.
const SAMPLED: [f64; 2] = [0.01, 0.15];
/// Relative variance of alpha's noise, as a share of that of the colors, up to which alpha guides all the same.
const CLEANER: f64 = 0.35;
/// Sum of the squares of the kernel that noise is measured by.
const KERNEL: f32 = 36.0;

/// Guide that a frame has.
#[derive(Debug, Clone, Copy)]
pub struct Outline<'f> {
    /// Alpha, if it tells anything: not if it is opaque everywhere, or noisy.
    pub alpha: Option<&'f [f32]>,
    /// Weight of the prior that colors are proportional to alpha.
    pub proportional: f32,
}

impl<'f> Outline<'f> {
    /// Returns the guide of a frame.
    pub fn of(frame: &Frame<'f>) -> Self {
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
        let alpha = frame.alpha.filter(|alpha| clear > 0 && !is_noisy(alpha, frame.color, width));
        Self { alpha, proportional: PROPORTIONAL[usize::from(black)] }
    }
}

/// Sums over pixels.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    /// Noise of alpha and `α (1 - α)`, where alpha is partial all around, and everywhere.
    partial: [f64; 2],
    whole: [f64; 2],
    /// Noise and square, of alpha and of the colors.
    alpha: [f64; 2],
    color: [f64; 2],
}

impl Sums {
    fn plus(self, other: Self) -> Self {
        let plus = |a: [f64; 2], b: [f64; 2]| [a[0] + b[0], a[1] + b[1]];
        Self {
            partial: plus(self.partial, other.partial),
            whole: plus(self.whole, other.whole),
            alpha: plus(self.alpha, other.alpha),
            color: plus(self.color, other.color),
        }
    }
}

/// True if alpha was sampled by few paths, and is not much cleaner than the colors. Noise is measured by second differences in
/// both directions (Immerkær 1996).
fn is_noisy(alpha: &[f32], color: &[Vec3], width: usize) -> bool {
    let height = alpha.len() / width;
    let looked = || (1..height.saturating_sub(1)).step_by(LOOK);
    let light = |at: usize| Some(color[at].element_sum().abs()).filter(|light| light.is_finite()).unwrap_or(0.0);
    let (sum, count) = looked()
        .flat_map(|y| y * width..(y + 1) * width)
        .fold((0.0_f64, 0.0_f64), |(sum, count), at| (sum + f64::from(light(at)), count + 1.0));
    // Compressed, so that a few bright pixels are not all of the noise.
    let mean = (sum / count.max(1.0)) as f32 + f32::MIN_POSITIVE;
    let shown = |at: usize| light(at) / (light(at) + mean);
    let noise = |of: &dyn Fn(usize) -> f32, at: usize| {
        let second = |at: usize| (of(at - 1) + of(at + 1)) - 2.0 * of(at);
        ((second(at - width) + second(at + width)) - 2.0 * second(at)).powi(2) / KERNEL
    };
    let of_row = |y: usize| {
        let mut sums = Sums::default();
        for at in y * width + 1..(y + 1) * width - 1 {
            let (own, apart) = (alpha[at], noise(&|at| alpha[at], at));
            if !(own + apart).is_finite() {
                continue;
            }
            let rows = [at - width, at, at + width];
            let all = rows.into_iter().flat_map(|at| &alpha[at - 1..at + 2]);
            let [low, high] = all.fold([1.0_f32, 0.0], |[low, high], v| [low.min(*v), high.max(*v)]);
            let inside = if low > PARTIAL[0] && high < PARTIAL[1] { 1.0 } else { 0.0 };
            let most = own * (1.0 - own);
            add(&mut sums.partial, [inside * apart, inside * most]);
            add(&mut sums.whole, [apart, most]);
            add(&mut sums.alpha, [apart, own * own]);
            add(&mut sums.color, [noise(&shown, at), shown(at).powi(2)]);
        }
        sums
    };
    let rows: Vec<usize> = looked().collect();
    let sums: Vec<Sums> = rows.into_par_iter().map(of_row).collect();
    // In order, so that the sum is the same for any number of threads.
    let sums = sums.into_iter().fold(Sums::default(), Sums::plus);
    let exceeds = |[noise, all]: [f64; 2], share: f64| noise > share * all;
    let is_sampled = exceeds(sums.partial, SAMPLED[0]) || exceeds(sums.whole, SAMPLED[1]);
    let [[alpha, alphas], [color, colors]] = [sums.alpha, sums.color];
    is_sampled && alpha * colors > CLEANER * color * alphas
}

fn add(sums: &mut [f64; 2], terms: [f32; 2]) {
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
            assert!(outline(&ball(paths), &colors).alpha.is_none(), "{paths}");
        }
        // Not so far as colors are much noisier.
        let spikes: Vec<Vec3> =
            colors.iter().enumerate().map(|(i, c)| *c * if i % 7 == 0 { 7.0 } else { 0.0 }).collect();
        assert!(outline(&ball(16), &spikes).alpha.is_some());
        // A sharp outline is no noise.
        let sharp: Vec<f32> = clean.iter().map(|alpha| ((alpha - 0.5) * 8.0 + 0.5).clamp(0.0, 1.0)).collect();
        assert!(outline(&sharp, &colors).alpha.is_some());
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
