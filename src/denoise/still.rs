//! A single picture: how much of what the denoiser took away is noise.
//!
//! A picture has no other frames that would tell detail from noise. Noise shows in second differences along both
//! directions, which smooth shades and straight edges do not have (Immerkær 1996); detail shows in what was taken away
//! alone, and lines and edges in their [coherence](super::coherence).

use super::blocks::{BLOCK, Grid, Pool};
use super::coherence::Coherence;
use super::frame::{Denoised, Frame};
use super::lanes::{LANES, between};
use super::layout::MARGIN;
use super::reprojection::of_cells;
use glam::Vec3;
use rayon::prelude::*;
use std::ops::Range;

/// Edge in pixels of the cells over which noise is measured, and cells to each side over which that is pooled.
const CELL: usize = 16;
const RADIUS: usize = 1;
/// Share of the power of small detail that is coherent, between which it comes to be no noise. That of noise is seldom
/// above 0.05, and that of letters 0.1 and more.
const COHERENT: [f32; 2] = [0.05, 0.08];
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
/// Noise, as a share of the power that was taken away, from which on all of it counts as noise, where both are taken as
/// shares of the brightness.
const ALL_RELATIVE: f64 = 0.05;
/// Change, as a share of the brightest color, up to which a pixel counts as left alone.
const ALONE: f64 = 1e-6;

/// Share of the picture's mean brightness below which pixels are too dark to tell noise as a share of theirs.
const DARK: f64 = 0.1;

/// Gives back what was taken away of a picture where it is free of noise, or nearly so. Pixels that were filled in stay
/// as they are.
pub(crate) fn keep_detail(frame: &Frame<'_>, level: f32, denoised: &mut Denoised) {
    let [width, height] = frame.size;
    let cells = [width.div_ceil(CELL), height.div_ceil(CELL)];
    let (picture, coherent) = (Picture::new(frame, &denoised.color), coherent(frame, level, cells));
    // All pixels together tell the noise as a share of the brightness.
    let whole = picture.pixels([0..width, 0..height]);
    let all = noise_of(whole.filter_map(|pixel| Some(pixel.second * pixel.inverse_brightness?)));
    let of = |cell: usize| {
        let range = |cell: usize| cell.saturating_sub(RADIUS) * CELL..(cell + RADIUS + 1) * CELL;
        let pixels: Vec<Pixel> = picture.pixels([range(cell % cells[0]), range(cell / cells[0])]).collect();
        let noise = noise_of(pixels.iter().map(|pixel| pixel.second));
        let taken = mean_square(pixels.iter().map(|pixel| pixel.change));
        let relative = mean_square(pixels.iter().filter_map(|pixel| Some(pixel.change * pixel.inverse_brightness?)));
        let share = |noise: f64, taken: f64| if taken > 0.0 { (noise / taken).min(1.0) } else { 1.0 };
        let noise = share(noise, ALL * taken).min(share(all, ALL_RELATIVE * relative));
        [(noise * (1.0 - f64::from(coherent[cell]))) as f32]
    };
    let shares: Vec<[f32; 1]> = (0..cells[0] * cells[1]).into_par_iter().map(of).collect();
    if shares.iter().all(|[share]| *share >= 1.0) {
        return;
    }
    denoised.color.par_chunks_mut(width).zip(frame.color.par_chunks(width)).enumerate().for_each(|(y, (to, from))| {
        for (x, (to, from)) in to.iter_mut().zip(from).enumerate().filter(|(_, (_, from))| from.is_finite()) {
            *to = *from + (*to - *from) * of_cells(&shares, cells, CELL, [x, y]);
        }
    });
}

/// Returns 1 where the small detail around a cell is no noise, and 0 where it may be.
fn coherent(frame: &Frame<'_>, level: f32, cells: [usize; 2]) -> Vec<f32> {
    let (grid, mut coherence) = (Grid::over(frame.size), Coherence::new(frame.size));
    // Edges may show in any channel.
    for channel in 0..3 {
        coherence.lines().zip(frame.color.par_chunks(frame.size[0])).for_each(|(line, colors)| {
            for (to, color) in line[MARGIN..].iter_mut().zip(colors) {
                *to = if color.is_finite() { color[channel] / level } else { f32::NAN };
            }
        });
        coherence.sum(channel > 0);
    }
    let centre = |cell: usize| (cell * CELL + CELL / 2) / BLOCK;
    let of_row = |pool: &mut Pool, row: usize| {
        let found = coherence.of_row(centre(row).min(grid.rows - 1), pool);
        let of = |column: usize| {
            let block = centre(column).min(grid.columns - 1);
            between(found[block / LANES], COHERENT).0[block % LANES]
        };
        (0..cells[0]).map(of).collect::<Vec<f32>>()
    };
    (0..cells[1]).into_par_iter().map_init(Pool::default, of_row).collect::<Vec<_>>().concat()
}

/// A picture, and what was made of it.
struct Picture<'p> {
    frame: &'p Frame<'p>,
    color: &'p [Vec3],
    /// Greatest and mean brightness.
    most: f64,
    mean: f64,
}

impl<'p> Picture<'p> {
    fn new(frame: &'p Frame<'p>, color: &'p [Vec3]) -> Self {
        let finite = || frame.color.iter().filter(|c| c.is_finite());
        let most = finite().fold(0.0_f32, |most, c| most.max(c.abs().max_element()));
        let sum: f64 = finite().map(|c| f64::from(c.abs().element_sum())).sum();
        Self { frame, color, most: f64::from(most), mean: sum / finite().count().max(1) as f64 }
    }

    /// Returns the pixels of columns and rows but for those around which all is even.
    fn pixels(&self, [columns, rows]: [Range<usize>; 2]) -> impl Iterator<Item = Pixel> {
        let [width, height] = self.frame.size;
        // Second differences are known of pixels that have others on all sides.
        let inner = |range: Range<usize>, size: usize| range.start.max(1)..range.end.min(size.saturating_sub(1));
        let columns = inner(columns, width);
        let places = inner(rows, height).flat_map(move |y| columns.clone().map(move |x| y * width + x));
        places.filter_map(|at| self.pixel(at))
    }

    fn pixel(&self, at: usize) -> Option<Pixel> {
        let width = self.frame.size[0];
        let light = |at: usize| f64::from(self.frame.color[at].element_sum());
        let along = |at: usize| light(at - 1) + light(at + 1) - 2.0 * light(at);
        let second = along(at - width) + along(at + width) - 2.0 * along(at);
        let change = f64::from(self.color[at].element_sum()) - light(at);
        let is_even = second == 0.0 && change.abs() <= ALONE * self.most;
        let brightness = f64::from(self.color[at].abs().element_sum());
        let inverse_brightness = (brightness > DARK * self.mean).then_some(1.0 / brightness);
        (second.is_finite() && !is_even).then_some(Pixel { second, change, inverse_brightness })
    }
}

/// A pixel of the sums of the channels.
struct Pixel {
    /// Second difference along both directions.
    second: f64,
    /// Brightness that was added; negative where it was taken away.
    change: f64,
    /// Inverse of the brightness, if that is not too dark.
    inverse_brightness: Option<f64>,
}

/// Returns the mean square of the noise that second differences show; 0 if there are none.
fn noise_of(second: impl Iterator<Item = f64>) -> f64 {
    let mut magnitudes: Vec<f64> = second.map(f64::abs).collect();
    if magnitudes.is_empty() {
        return 0.0;
    }
    let at = ((1.0 - OUTLINES) * (magnitudes.len() - 1) as f64) as usize;
    let (_, quantile, _) = magnitudes.select_nth_unstable_by(at, f64::total_cmp);
    GAUSSIAN * quantile.powi(2) / KERNEL
}

/// Returns the mean of the squares of numbers; 0 if there are none.
fn mean_square(numbers: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = numbers.fold((0.0, 0.0_f64), |(sum, count), number| (sum + number.powi(2), count + 1.0));
    sum / count.max(1.0)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    const SIZE: [usize; 2] = [64, 48];

    fn random(i: usize) -> f32 {
        let h = (i as u32 ^ 0x9E37_79B9).wrapping_mul(0x85EB_CA6B);
        let h = (h ^ (h >> 16)).wrapping_mul(0x21F0_AAAD);
        let h = (h ^ (h >> 15)).wrapping_mul(0x735A_2D97);
        ((h ^ (h >> 15)) >> 8) as f32 / (1 << 24) as f32
    }

    /// A dark ramp, and before it a lit disk of this radius with a sharp outline.
    fn truth(radius: f32) -> Vec<Vec3> {
        let at = |i: usize| {
            let (x, y) = ((i % SIZE[0]) as f32, (i / SIZE[0]) as f32);
            let inside = (x - 30.0).hypot(y - 24.0) < radius;
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
        keep_detail(&Frame { size: SIZE, color, ..Frame::default() }, 0.1, &mut after);
        [before, after]
    }

    /// Where one part of a picture has noise and the other has none, each comes out as it would alone.
    #[test]
    fn parts_do_not_disturb_each_other() {
        let (clean, left) = (truth(0.0), |i: usize| i % SIZE[0] < SIZE[0] / 2);
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
        let clean = truth(15.0);
        let [before, after] = denoised(&clean);
        let errors = [&before, &after].map(|found| rms(&found.color, &clean));
        assert!(errors[0] > 5e-3 && errors[1] < 0.03 * errors[0], "{errors:?}");
    }

    /// Of a part that looks like noise the rest of the picture tells whether it is: in light without noise it is none,
    /// and in the dark nothing tells.
    #[test]
    fn the_rest_of_a_picture_tells_its_noise() {
        let inside = |i: usize| (24..44).contains(&(i % SIZE[0])) && (16..36).contains(&(i / SIZE[0]));
        let given = |around: f32| -> Vec<Vec3> {
            let at =
                |i: usize| if inside(i) { random(i) } else { around * (1.0 + 0.003 * ((i % SIZE[0]) as f32).powi(2)) };
            (0..SIZE[0] * SIZE[1]).map(|i| Vec3::splat(at(i))).collect()
        };
        let kept = |around: f32| {
            let given = given(around);
            let [before, after] = denoised(&given);
            rms(&after.color, &given) / rms(&before.color, &given)
        };
        let [light, dark] = [0.3, 1e-4].map(kept);
        assert!(light < 0.05 && dark > 0.8, "{light} {dark}");
    }

    #[test]
    fn noise_is_taken_away_as_before() {
        let clean = truth(0.0);
        for power in [1, 8] {
            // Of mean 1; the larger the power, the fewer pixels have most of the light.
            let path = |i: usize| (power + 1) as f32 * random(i).powi(power);
            let noisy: Vec<Vec3> = clean.iter().enumerate().map(|(i, color)| *color * path(i)).collect();
            let [before, after] = denoised(&noisy);
            let kept = rms(&before.color, &after.color) / rms(&before.color, &noisy);
            assert!(kept < if power == 1 { 1e-9 } else { 0.1 }, "{power}: {kept}");
            assert!(rms(&after.color, &clean) < 0.6 * rms(&noisy, &clean), "{power}");
        }
    }

    #[test]
    fn tiny_pictures_and_missing_pixels_do_no_harm() {
        for size in [[1, 1], [2, 9], [9, 2], [3, 3]] {
            let color = vec![Vec3::NAN; size[0] * size[1]];
            let mut found = Denoised { color: vec![Vec3::ONE; color.len()], ..Denoised::default() };
            keep_detail(&Frame { size, color: &color, ..Frame::default() }, 0.1, &mut found);
            assert!(found.color.iter().all(|color| *color == Vec3::ONE), "{size:?}");
        }
    }
}
