//! Share of independent noisy halves that denoised ones take back, so that their mean is no farther from the truth than
//! what came in.
//!
//! With the terms of [`halves`](super::halves), let M be the mean of the denoised halves and N that of the noisy ones.
//! Where a share s of N is taken back, the square of the error is
//!
//! `E |M + s (N - M) - T|² = (1 - s)² E + 2 s (1 - s) C + s² V`
//!
//! with the error E of M, the variance V of N and their covariance C. It is least at `s = (E - C) / E |N - M|²`. All
//! of this is known without a reference: since D(A) and B are independent, the covariance of D(A) with its own noise is
//! `E [|D(A) - B|² - |D(A) - A|²] / 2`, and C is a quarter of the sum of both halves'.

use super::blocks::{BLOCK, Grid};
use super::halves::Halves;
use super::reprojection::of_cells;
use glam::Vec3;
use rayon::prelude::*;

/// Blocks to each side over which the share is estimated.
const RADIUS: usize = 2;
/// Standard deviations by which the denoised halves must be worse than chance before anything is taken back.
const DEVIATIONS: f32 = 2.0;
/// Share of the picture's mean square that is added to the square of a color before errors are taken as shares of it.
const FLOOR: f32 = 0.01;

/// Fewest pixels along a side of a picture of which halves tell anything; smaller ones stay noisy.
const FEWEST: usize = 8;

/// Sums over the pixels of a block: of what error and covariance leave, `E - C`, of its variance, and of `|N - M|²`.
///
/// Of a bias β and noise of the variance σ² in each channel of a half, the variance of `E - C` is that of
/// `β² - β·(a + b) + a·b`, `2 σ² |β|² + 3 σ⁴`, which is the mean of `4/3 |N - M|² |A - B|² / 4`.
type Sums = [f32; 3];

/// Errors as they are, and as shares of the colors: the share that is taken back is the greater one, so that the mean
/// is no worse than the noisy picture by either.
const KINDS: usize = 2;

/// Takes back of the noisy halves, row by row from the top, what is due to the denoised ones. Pixels that are not
/// finite stay as they are.
pub fn take_back(size: [usize; 2], noisy: [&[Vec3]; 2], denoised: [&mut [Vec3]; 2]) {
    let [a, b] = denoised;
    let halves = Halves { size, noisy, denoised: [&*a, &*b] };
    let grid = Grid::over(size);
    let shares =
        if size[0].min(size[1]) < FEWEST { vec![[1.0]; grid.rows * grid.columns] } else { shares(&halves, grid) };
    for (denoised, noisy) in [a, b].into_iter().zip(noisy) {
        let rows = denoised.par_chunks_mut(size[0]).zip(noisy.par_chunks(size[0])).enumerate();
        rows.for_each(|(y, (denoised, noisy))| {
            for (x, (to, from)) in denoised.iter_mut().zip(noisy).enumerate() {
                let share = of_cells(&shares, [grid.columns, grid.rows], BLOCK, [x, y]);
                if share > 0.0 && from.is_finite() {
                    *to += (*from - *to) * share;
                }
            }
        });
    }
}

/// Returns the share of each block, row by row.
fn shares(halves: &Halves<'_>, grid: Grid) -> Vec<[f32; 1]> {
    let (sum, count) = halves
        .denoised
        .iter()
        .flat_map(|colors| *colors)
        .filter(|c| c.is_finite())
        .fold((0.0_f64, 0.0_f64), |(sum, count), color| (sum + f64::from(color.length_squared()), count + 1.0));
    let floor = (FLOOR * (sum / count.max(1.0)) as f32).max(f32::MIN_POSITIVE);
    let blocks: Vec<[Sums; KINDS]> = (0..grid.rows * grid.columns)
        .into_par_iter()
        .map(|block| sums(halves, [block % grid.columns, block / grid.columns], floor))
        .collect();
    let pooled = |block: usize| {
        let [column, row] = [block % grid.columns, block / grid.columns];
        let mut all = [[0.0_f32; 3]; KINDS];
        for y in row.saturating_sub(RADIUS)..(row + RADIUS + 1).min(grid.rows) {
            for x in column.saturating_sub(RADIUS)..(column + RADIUS + 1).min(grid.columns) {
                let of_block = blocks[y * grid.columns + x].iter().flatten();
                all.iter_mut().flatten().zip(of_block).for_each(|(all, v)| *all += v);
            }
        }
        let due = all.map(|[excess, variance, apart]| {
            let due = excess - DEVIATIONS * variance.sqrt();
            if due > 0.0 && apart > 0.0 { (due / apart).min(1.0) } else { 0.0 }
        });
        [due[0].max(due[1])]
    };
    (0..blocks.len()).into_par_iter().map(pooled).collect()
}

/// Returns the sums of a block.
fn sums(halves: &Halves<'_>, [column, row]: [usize; 2], floor: f32) -> [Sums; KINDS] {
    let Halves { size: [width, height], noisy, denoised } = *halves;
    let mut sums = [[0.0; 3]; KINDS];
    for y in row * BLOCK..((row + 1) * BLOCK).min(height) {
        for at in y * width + column * BLOCK..y * width + ((column + 1) * BLOCK).min(width) {
            let [[a, b], [da, db]] = [noisy, denoised].map(|colors| colors.map(|colors| colors[at]));
            let across = (da - b).length_squared() + (db - a).length_squared();
            let own = (da - a).length_squared() + (db - b).length_squared();
            let error = 0.5 * (across - (a - b).length_squared()) - 0.25 * (da - db).length_squared();
            let mean = 0.5 * (da + db);
            for (sums, weight) in sums.iter_mut().zip([1.0 / floor, 1.0 / (mean.length_squared() + floor)]) {
                let excess = weight * (error - 0.125 * (across - own));
                let apart = weight * (0.5 * (a + b) - mean).length_squared();
                let noise = weight * 0.25 * (a - b).length_squared();
                if (excess + apart + noise).is_finite() {
                    *sums = [sums[0] + excess, sums[1] + 4.0 / 3.0 * apart * noise, sums[2] + apart];
                }
            }
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [usize; 2] = [96, 72];

    /// A normal number by a place and a seed.
    fn normal(at: usize, seed: u32) -> f32 {
        let hash = |salt: u32| {
            let h = (at as u32).wrapping_mul(0x9E37_79B9) ^ seed.wrapping_mul(0x85EB_CA6B) ^ salt;
            let h = (h ^ (h >> 15)).wrapping_mul(0x2C1B_3C6D);
            let h = (h ^ (h >> 12)).wrapping_mul(0x297A_2D39);
            (((h ^ (h >> 15)) >> 8) as f32 + 0.5) / (1 << 24) as f32
        };
        (-2.0 * hash(1).ln()).sqrt() * (std::f32::consts::TAU * hash(2)).cos()
    }

    /// A smooth left half, and a right one of stripes a few pixels wide.
    fn truth() -> Vec<Vec3> {
        let at = |i: usize| {
            let (x, y) = (i % SIZE[0], i / SIZE[0]);
            let smooth = 0.5 + 0.3 * (0.03 * (x + y) as f32).sin();
            Vec3::new(1.0, 0.8, 0.6) * if x < SIZE[0] / 2 || (x / 3) % 2 == 0 { smooth } else { 0.1 }
        };
        (0..SIZE[0] * SIZE[1]).map(at).collect()
    }

    /// Means over 7x7 pixels.
    fn blurred(colors: &[Vec3]) -> Vec<Vec3> {
        let [width, height] = SIZE;
        let mean = |i: usize| {
            let (x, y) = (i % width, i / width);
            let (mut sum, mut count) = (Vec3::ZERO, 0.0);
            for row in y.saturating_sub(3)..(y + 4).min(height) {
                for column in x.saturating_sub(3)..(x + 4).min(width) {
                    sum += colors[row * width + column];
                    count += 1.0;
                }
            }
            sum / count
        };
        (0..colors.len()).map(mean).collect()
    }

    /// Where a filter errs by more than the noise, the noisy picture comes back; where it does good, what it found
    /// stays.
    #[test]
    fn what_comes_out_is_no_worse_than_what_went_in() {
        let truth = truth();
        let mean = |a: &[Vec3], b: &[Vec3]| -> Vec<Vec3> { a.iter().zip(b).map(|(a, b)| (*a + *b) * 0.5).collect() };
        let error = |found: &[Vec3], columns: std::ops::Range<usize>| {
            let pixels = (0..truth.len()).filter(|i| columns.contains(&(i % SIZE[0])));
            pixels.map(|i| f64::from((found[i] - truth[i]).length_squared())).sum::<f64>().sqrt()
        };
        // Of the noise, filters keep next to nothing, or half.
        for (deviation, kept) in [0.0, 0.002, 0.02, 0.1, 0.5].map(|d| [(d, 0.0), (d, 0.5)]).concat() {
            let noisy = |seed: u32| -> Vec<Vec3> {
                let at = |(i, color): (usize, &Vec3)| {
                    *color + Vec3::from_array([0, 1, 2].map(|c| deviation * normal(i, 3 * seed + c)))
                };
                truth.iter().enumerate().map(at).collect()
            };
            let [a, b] = [noisy(1), noisy(2)];
            let filtered = |colors: &[Vec3]| -> Vec<Vec3> {
                blurred(colors).iter().zip(colors).map(|(blurred, color)| blurred.lerp(*color, kept)).collect()
            };
            let [mut da, mut db] = [filtered(&a), filtered(&b)];
            let (before, input) = (mean(&da, &db), mean(&a, &b));
            take_back(SIZE, [&a, &b], [&mut da, &mut db]);
            let after = mean(&da, &db);
            // The blur reaches 3 pixels across the border, and shares 12.
            for (name, columns) in [("smooth", 0..33), ("stripes", 63..96)] {
                let [input, before, after] = [&input, &before, &after].map(|film| error(film, columns.clone()));
                println!("{deviation} {kept} {name}: in {input:.4}, denoised {before:.4}, out {after:.4}");
                assert!(
                    after <= 1.02 * input.min(before) + 1e-4,
                    "{deviation} {kept} {name}: {input} {before} {after}"
                );
            }
        }
    }

    #[test]
    fn gaps_and_tiny_pictures_do_no_harm() {
        for size in [[1, 1], [3, 2], [5, 9], [9, 5]] {
            let (noisy, mut a, mut b) = ([Vec3::NAN; 45], [Vec3::ONE; 45], [Vec3::ONE; 45]);
            let count = size[0] * size[1];
            let noisy = [&noisy[..count]; 2];
            take_back(size, noisy, [&mut a[..count], &mut b[..count]]);
            assert!(a.iter().chain(&b).all(|color| *color == Vec3::ONE));
        }
    }
}
