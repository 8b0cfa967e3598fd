//! A single picture: how much of what the denoiser took away is noise.
//!
//! A picture has no other frames that would tell detail from noise. Noise shows in second differences along both
//! directions, which smooth shades and straight edges do not have (Immerkær 1996); detail shows in what was taken away
//! alone.

use super::frame::{Denoised, Frame};
use super::reprojection::around;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

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

/// Edge in pixels of the cells whose shares are found, and cells to each side over which they are.
const CELL: usize = 16;
const RADIUS: usize = 1;

/// Gives back what was taken away of a picture where it is free of noise, or nearly so. Pixels that were filled in stay
/// as they are.
pub(crate) fn keep_detail(frame: &Frame<'_>, denoised: &mut Denoised) {
    let [width, height] = frame.size;
    let cells = [width.div_ceil(CELL), height.div_ceil(CELL)];
    let most = frame.color.iter().filter(|c| c.is_finite()).fold(0.0_f32, |most, c| most.max(c.abs().max_element()));
    let color = &denoised.color[..];
    let of = |cell: usize| [noise_of(frame, color, most, [cell % cells[0], cell / cells[0]]) as f32];
    let shares: Vec<[f32; 1]> = (0..cells[0] * cells[1]).into_par_iter().map(of).collect();
    if shares.iter().all(|[share]| *share >= 1.0) {
        return;
    }
    let last = Vec2::new((cells[0] - 1) as f32, (cells[1] - 1) as f32);
    denoised.color.par_chunks_mut(width).zip(frame.color.par_chunks(width)).enumerate().for_each(|(y, (to, from))| {
        for (x, (to, from)) in to.iter_mut().zip(from).enumerate().filter(|(_, (_, from))| from.is_finite()) {
            let place = (Vec2::new(x as f32, y as f32) + 0.5) / CELL as f32 - 0.5;
            let [share] = around(cells, place.max(Vec2::ZERO).min(last)).map_or([1.0], |around| around.sum(&shares));
            *to = *from + (*to - *from) * share;
        }
    });
}

/// Returns the share of what was taken away around a cell that is noise. `most` is the brightest color of the picture.
fn noise_of(frame: &Frame<'_>, color: &[Vec3], most: f32, [column, row]: [usize; 2]) -> f64 {
    let [width, height] = frame.size;
    let light = |at: usize| frame.color[at].element_sum();
    let (mut magnitudes, mut taken) = (Vec::new(), 0.0_f64);
    // Second differences are known of pixels that have others on all sides.
    let inner = |cell: usize, size: usize| {
        (cell.saturating_sub(RADIUS) * CELL).max(1)..((cell + RADIUS + 1) * CELL).min(size.saturating_sub(1))
    };
    for y in inner(row, height) {
        for at in inner(column, width).map(|x| y * width + x) {
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

    /// Means over 3x3 pixels, as they are and with what is kept.
    fn denoised(color: &[Vec3]) -> [Denoised; 2] {
        let mean = |i: usize| {
            let [x, y] = [i % SIZE[0], i / SIZE[0]].map(|at| at.saturating_sub(1)..at + 2);
            let around = y.filter(|y| *y < SIZE[1]).flat_map(|y| x.clone().map(move |x| (x, y)));
            let (sum, count) = around
                .filter(|(x, _)| *x < SIZE[0])
                .fold((Vec3::ZERO, 0.0), |(sum, count), (x, y)| (sum + color[y * SIZE[0] + x], count + 1.0));
            sum / count
        };
        let before = Denoised { color: (0..color.len()).map(mean).collect(), ..Denoised::default() };
        let mut after = before.clone();
        keep_detail(&Frame { size: SIZE, color, ..Frame::default() }, &mut after);
        [before, after]
    }

    /// Where one part of a picture has noise and the other has none, each comes out as it would alone.
    #[test]
    fn parts_do_not_disturb_each_other() {
        let (clean, left) = (truth(), |i: usize| i % SIZE[0] < SIZE[0] / 2);
        let given: Vec<Vec3> =
            clean.iter().enumerate().map(|(i, c)| *c * if left(i) { 2.0 * random(i) } else { 1.0 }).collect();
        let [before, after] = denoised(&given);
        // Shares are found over 24 pixels and more to each side.
        let error = |found: &Denoised, of: &dyn Fn(usize) -> bool| {
            let squares = |i: usize| (found.color[i] - clean[i]).length_squared();
            (0..clean.len()).filter(|i| of(i % SIZE[0])).map(squares).sum::<f32>().sqrt()
        };
        assert_eq!(error(&before, &|x| x < 8), error(&after, &|x| x < 8));
        let [lost, kept] = [&before, &after].map(|found| error(found, &|x| x > 56));
        assert!(kept < 0.05 * lost, "{kept} of {lost}");
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
