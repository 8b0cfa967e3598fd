//! A single picture: how much of what the denoiser took away is noise.
//!
//! A picture has no other frames that would tell detail from noise. Noise shows in second differences along both
//! directions, which smooth shades and straight edges do not have (Immerkær 1996); detail shows in what was taken away
//! alone.

use super::frame::{Denoised, Frame};
use glam::Vec3;

/// Share of the pixels whose second difference may be larger than that by which noise is measured: outlines are noise
/// to it.
const OUTLINES: f64 = 0.25;
/// Mean square of Gaussian noise over the square of the three-quarter quantile of its magnitude, 1 / 1.1503².
const GAUSSIAN: f64 = 0.756;
/// Sum of the squares of the kernel of second differences in both directions.
const KERNEL: f64 = 36.0;
/// Noise, as a share of the power that was taken away, from which on all of it counts as noise. Renders of 1 to 512
/// paths a pixel have 0.2 and more, pictures without noise 0.02 and less.
const ALL: f64 = 0.1;
/// Change, as a share of the brightest color, up to which a pixel counts as left alone.
const ALONE: f32 = 1e-6;

/// Gives back what was taken away of a picture that is free of noise, or nearly so. Pixels that were filled in stay as
/// they are.
pub fn keep_detail(frame: &Frame<'_>, denoised: &mut Denoised) {
    let share = noise_of(frame, &denoised.color) as f32;
    if share >= 1.0 {
        return;
    }
    for (to, from) in denoised.color.iter_mut().zip(frame.color).filter(|(_, from)| from.is_finite()) {
        *to = *from + (*to - *from) * share;
    }
}

/// Returns the share of what was taken away that is noise.
fn noise_of(frame: &Frame<'_>, color: &[Vec3]) -> f64 {
    let [width, height] = frame.size;
    let light = |at: usize| frame.color[at].element_sum();
    let most = frame.color.iter().filter(|c| c.is_finite()).fold(0.0_f32, |most, c| most.max(c.abs().max_element()));
    let (mut magnitudes, mut taken) = (Vec::new(), 0.0_f64);
    for y in 1..height.saturating_sub(1) {
        for at in y * width + 1..((y + 1) * width).saturating_sub(1) {
            let change = color[at].element_sum() - light(at);
            let second = |at: usize| f64::from(light(at - 1)) + f64::from(light(at + 1)) - 2.0 * f64::from(light(at));
            let both = second(at - width) + second(at + width) - 2.0 * second(at);
            if change.abs() > ALONE * most && both.is_finite() {
                magnitudes.push(both.abs());
                taken += f64::from(change).powi(2);
            }
        }
    }
    if magnitudes.is_empty() {
        return 1.0;
    }
    taken /= magnitudes.len() as f64;
    let at = ((1.0 - OUTLINES) * (magnitudes.len() - 1) as f64) as usize;
    let (_, quantile, _) = magnitudes.select_nth_unstable_by(at, f64::total_cmp);
    let noise = GAUSSIAN * quantile.powi(2) / KERNEL;
    (noise / (ALL * taken)).min(1.0)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use crate::denoise::{Denoiser, Method, Settings};

    const SIZE: [usize; 2] = [64, 48];

    fn random(i: usize) -> f32 {
        let h = (i as u32 ^ 0x9E37_79B9).wrapping_mul(0x85EB_CA6B);
        let h = (h ^ (h >> 13)).wrapping_mul(0xC2B2_AE35);
        ((h ^ (h >> 16)) >> 8) as f32 / (1 << 24) as f32
    }

    /// A lit disk with a sharp outline before a dark ramp.
    fn truth() -> Vec<Vec3> {
        let at = |i: usize| {
            let (x, y) = ((i % SIZE[0]) as f32, (i / SIZE[0]) as f32);
            let inside = (x - 30.0).hypot(y - 24.0) < 15.0;
            Vec3::new(if inside { 0.8 - 0.01 * x } else { 0.002 * x }, 0.3 * (0.1 * y).sin().abs(), 0.1)
        };
        (0..SIZE[0] * SIZE[1]).map(at).collect()
    }

    fn rms(a: &[Vec3], b: &[Vec3]) -> f32 {
        (a.iter().zip(b).map(|(a, b)| (*a - *b).length_squared()).sum::<f32>() / a.len() as f32).sqrt()
    }

    fn denoised(color: &[Vec3]) -> [Denoised; 2] {
        let frame = Frame { size: SIZE, color, ..Frame::default() };
        let before = Denoiser::new(Method::Wrls2, Settings::default()).unwrap().denoise(&frame).unwrap();
        let mut after = before.clone();
        keep_detail(&frame, &mut after);
        [before, after]
    }

    #[test]
    fn a_picture_without_noise_stays_nearly_as_it_is() {
        let clean = truth();
        let [before, after] = denoised(&clean);
        let errors = [&before, &after].map(|found| rms(&found.color, &clean));
        assert!(errors[0] > 5e-3 && errors[1] < 0.03 * errors[0], "{errors:?}");
    }

    #[test]
    fn noise_is_taken_away_as_before() {
        let clean = truth();
        for power in [1, 8] {
            // Of mean 1; the larger the power, the fewer pixels have most of the light.
            let path = |i: usize| (power + 1) as f32 * random(i).powi(power);
            let noisy: Vec<Vec3> = clean.iter().enumerate().map(|(i, color)| *color * path(i)).collect();
            let [before, after] = denoised(&noisy);
            assert_eq!(before, after, "{power}");
            assert!(rms(&after.color, &clean) < 0.6 * rms(&noisy, &clean), "{power}");
        }
    }

    #[test]
    fn tiny_pictures_and_missing_pixels_do_no_harm() {
        for size in [[1, 1], [2, 9], [9, 2], [3, 3]] {
            let color = vec![Vec3::NAN; size[0] * size[1]];
            let mut found = Denoised { color: vec![Vec3::ONE; color.len()], ..Denoised::default() };
            keep_detail(&Frame { size, color: &color, ..Frame::default() }, &mut found);
            assert!(found.color.iter().all(|color| *color == Vec3::ONE), "{size:?}");
        }
    }
}
