//! Error of frames that are denoised in two independent halves, told by these without a reference.
//!
//! Let the halves of a frame's paths be A = T + a and B = T + b, of a truth T and of independent noise, and let D
//! denoise. D(A) and B are independent, so that `E |D(A) - B|² = E |D(A) - T|² + Var B`, whatever D does, and
//! `Var A = Var B = E |A - B|² / 2`. The frame is the mean M of D(A) and D(B). For any T the square of its error is the
//! mean of the halves' squares less a quarter of the square of their difference, so that
//!
//! `E |M - T|² = E [|D(A) - B|² + |D(B) - A|² - |A - B|²] / 2 - E |D(A) - D(B)|² / 4`
//!
//! The last term alone is the variance of M: what is left of the noise. It is known far better than the rest, which is
//! the bias, and is the least that the error is stated as.

use crate::error::{Error, Result};
use crate::render::accuracy::interval;
use crate::render::film::Blocks;
use glam::Vec3;

/// Standard deviations of the estimate that [`HalvesEstimate::error_high`] adds to it: a one-sided interval of 97.5 %.
const DEVIATIONS: f64 = 1.96;
/// Channels of a pixel.
const CHANNELS: f64 = 3.0;

/// Two independent halves of a frame, row by row from the top.
#[derive(Debug, Clone, Copy)]
pub struct Halves<'h> {
    /// Columns and rows.
    pub size: [usize; 2],
    /// Noisy colors.
    pub noisy: [&'h [Vec3]; 2],
    /// Denoised colors.
    pub denoised: [&'h [Vec3]; 2],
}

/// Mean squares of noise and error, over pixels and channels, of the means of denoised halves of one or several frames.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct HalvesEstimate {
    pixels: f64,
    /// Sums of the squares of the noise of the halves' mean, of the error, and of what is left of the noise in it.
    noise: f64,
    error: f64,
    variance: f64,
    /// Sum of the squares of what blocks add to the error.
    chance: f64,
    /// Sum of the squares of the denoised colors.
    power: f64,
    /// Mean radiance of blocks.
    radiance: Vec<f64>,
}

impl HalvesEstimate {
    /// Estimates noise and error of the mean of denoised halves. Pixels that are not finite do not count.
    ///
    /// # Errors
    /// If there are not as many colors as pixels.
    pub fn of(halves: Halves<'_>) -> Result<Self> {
        let Halves { size, noisy, denoised } = halves;
        let lengths = [noisy[0].len(), noisy[1].len(), denoised[0].len(), denoised[1].len()];
        if lengths != [size[0] * size[1]; 4] {
            return Err(Error::invalid(format!("halves have {lengths:?} colors, and there are {size:?} pixels")));
        }
        let grid = Blocks::new(size);
        let mut found = Self::default();
        for block in 0..grid.count() {
            let (mut error, mut radiance, mut count) = (0.0, 0.0, 0.0);
            for pixel in grid.pixels(block) {
                let [a, b] = noisy.map(|colors| colors[pixel].as_dvec3());
                let [da, db] = denoised.map(|colors| colors[pixel].as_dvec3());
                if !(a + b + da + db).is_finite() {
                    continue;
                }
                let (noise, variance) = (0.25 * (a - b).length_squared(), 0.25 * (da - db).length_squared());
                let apart = 0.5 * ((da - b).length_squared() + (db - a).length_squared());
                let mean = 0.5 * (da + db);
                error += apart - 2.0 * noise - variance;
                count += 1.0;
                radiance += mean.element_sum() / CHANNELS;
                found.noise += noise;
                found.variance += variance;
                found.power += mean.length_squared();
            }
            found.pixels += count;
            found.error += error;
            found.chance += error * error;
            found.radiance.push(radiance / f64::max(count, 1.0));
        }
        Ok(found)
    }

    /// Adds another frame.
    pub fn add(&mut self, other: Self) {
        self.pixels += other.pixels;
        self.noise += other.noise;
        self.error += other.error;
        self.variance += other.variance;
        self.chance += other.chance;
        self.power += other.power;
        self.radiance.extend(other.radiance);
    }

    /// True if there are pixels of which halves tell something.
    pub fn is_known(&self) -> bool {
        self.pixels > 0.0
    }

    fn root(&self, sum: f64) -> f64 {
        (sum.max(0.0) / (CHANNELS * self.pixels).max(1.0)).sqrt()
    }

    /// Returns the root mean square of the noise that came in.
    pub fn noise(&self) -> f64 {
        self.root(self.noise)
    }

    /// Returns the root mean square of the error that is left.
    pub fn error(&self) -> f64 {
        self.root(self.error.max(self.variance))
    }

    /// Returns the upper end of the 95 % interval of the root mean square error.
    pub fn error_high(&self) -> f64 {
        self.root(self.error.max(self.variance) + DEVIATIONS * self.chance.sqrt())
    }

    /// Returns the root mean square of the denoised colors.
    pub fn level(&self) -> f64 {
        self.root(self.power)
    }

    /// Returns the [scale](interval::scale) of the denoised radiance, over the blocks of all frames.
    pub fn scale(&self) -> f64 {
        interval::scale(self.radiance.iter().copied())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    const SIZE: [usize; 2] = [512, 384];

    /// Numbers of a linear congruential generator.
    struct Random(u64);

    impl Random {
        fn uniform(&mut self) -> f64 {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((self.0 >> 11) as f64 + 0.5) / (1_u64 << 53) as f64
        }

        /// Returns a normal number (Box & Muller 1958).
        fn normal(&mut self) -> f32 {
            let (u, v) = (self.uniform(), self.uniform());
            ((-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()) as f32
        }

        /// Returns a number of mean and variance 0 and 1 that is rarely far above and never far below.
        fn rare(&mut self) -> f32 {
            if self.uniform() < 0.1 { 3.0 } else { -1.0 / 3.0 }
        }
    }

    /// Mean over the pixels around, of a picture that repeats itself.
    fn blurred(colors: &[Vec3]) -> Vec<Vec3> {
        let [width, height] = SIZE;
        let mean = |i: usize| {
            let (x, y) = (i % width + width - 1, i / width + height - 1);
            let around = (0..9).map(|k| colors[(y + k / 3) % height * width + (x + k % 3) % width]);
            around.sum::<Vec3>() / 9.0
        };
        (0..colors.len()).map(mean).collect()
    }

    /// Keeps what stands out, and blurs the rest: it follows large noise wholly, and small noise in part.
    fn keeping(colors: &[Vec3]) -> Vec<Vec3> {
        let blurred = blurred(colors);
        let keep = |(blurred, color): (&Vec3, &Vec3)| if blurred.distance(*color) > 0.2 { *color } else { *blurred };
        blurred.iter().zip(colors).map(keep).collect()
    }

    /// The estimate is the true error of filters that follow none, some and all of the noise, with bias and without,
    /// linear and not.
    #[test]
    fn halves_tell_the_error_of_any_filter() {
        let truth = |i: usize| Vec3::splat(0.5 + 0.3 * ((i % SIZE[0]) as f32 * 0.1).sin()) * Vec3::new(1.0, 0.7, 0.4);
        let truth: Vec<Vec3> = (0..SIZE[0] * SIZE[1]).map(truth).collect();
        let error = |found: &[Vec3]| {
            let sum: f64 = found.iter().zip(&truth).map(|(f, t)| f64::from((*f - *t).length_squared())).sum();
            (sum / (CHANNELS * found.len() as f64)).sqrt()
        };
        let mean = |a: &[Vec3], b: &[Vec3]| -> Vec<Vec3> { a.iter().zip(b).map(|(a, b)| (*a + *b) * 0.5).collect() };
        type Filter = fn(&[Vec3]) -> Vec<Vec3>;
        let filters: [(&str, Filter); 4] = [
            ("none", |_| vec![Vec3::splat(0.4); SIZE[0] * SIZE[1]]),
            ("blur", blurred),
            ("keeping", keeping),
            ("all", <[Vec3]>::to_vec),
        ];
        for (kind, number) in [("normal", Random::normal as fn(&mut Random) -> f32), ("rare", Random::rare)] {
            let mut random = Random(1);
            let mut noisy = || -> Vec<Vec3> {
                truth.iter().map(|color| *color + Vec3::from_array([0; 3].map(|_| number(&mut random))) * 0.1).collect()
            };
            let [a, b] = [noisy(), noisy()];
            let frame = mean(&a, &b);
            for (name, filter) in filters {
                let [da, db] = [filter(&a), filter(&b)];
                let wanted = error(&mean(&da, &db));
                let found = HalvesEstimate::of(Halves { size: SIZE, noisy: [&a, &b], denoised: [&da, &db] }).unwrap();
                let decibels = 20.0 * (found.error() / wanted).log10();
                assert!(decibels.abs() < 0.2, "{kind} {name}: {} {wanted}", found.error());
                assert!(found.error_high() > wanted && found.error_high() < 1.15 * wanted, "{kind} {name}");
                assert!((found.noise() / error(&frame) - 1.0).abs() < 0.01, "{kind} {name}");
                let mut both = found.clone();
                both.add(found.clone());
                assert!((both.error() - found.error()).abs() < 1e-12 && both.error_high() < found.error_high());
            }
        }
    }

    #[test]
    fn gaps_do_not_count_and_sizes_must_fit() {
        let mut colors = vec![Vec3::ONE; 100];
        colors[7] = Vec3::NAN;
        let (ones, size) = (vec![Vec3::ONE; 100], [10, 10]);
        let found = HalvesEstimate::of(Halves { size, noisy: [&colors, &ones], denoised: [&ones; 2] }).unwrap();
        assert!(found.is_known() && found.pixels == 99.0 && found.error() == 0.0 && found.noise() == 0.0);
        assert!((found.scale() - 1.0).abs() < 1e-6);
        assert!(HalvesEstimate::of(Halves { size, noisy: [&ones, &ones[1..]], denoised: [&ones; 2] }).is_err());
    }
}
