//! Coherence of small detail, which tells lines and edges from noise.
//!
//! A pixel on a line or beside an edge differs from the mean around it as its neighbours do along the line. Of noise
//! five pixels in a row seldom differ in the same way, along whatever direction, and whether its channels and its
//! neighbours are alike or not.

use super::frame::Frame;
use glam::Vec3;
use rayon::prelude::*;

/// Edge in pixels of the cells over which detail is summed, and cells to each side over which the sums are pooled.
pub(super) const CELL: usize = 16;
pub(super) const RADIUS: usize = 1;

/// Directions along which lines and edges run: to the right, downwards, and along both diagonals.
const DIRECTIONS: [[isize; 2]; 4] = [[1, 0], [0, 1], [1, 1], [-1, 1]];
/// Neighbours to each side along a direction.
const REACH: usize = 2;
/// Standard deviations by chance that are taken from sums of coherent detail.
const DEVIATIONS: f64 = 1.0;
/// Share of the power of small detail that is coherent, between which it comes to be no noise. That of noise is 0.01 to
/// 0.04 behind usual filters, whether its channels are independent or not, and that of letters, hair and grass 0.12 and
/// more.
const COHERENT: [f64; 2] = [0.05, 0.08];

/// Power of small detail, by cell.
pub(super) struct Coherence {
    cells: [usize; 2],
    /// Sums over pixels: of the least product with the four nearest along the direction where that is greatest, of the
    /// squares of those, and of the detail's squares.
    sums: Vec<[f64; 3]>,
}

impl Coherence {
    /// Sums over the pixels of so many columns and rows of cells.
    pub(super) fn new(frame: &Frame<'_>, cells: [usize; 2]) -> Self {
        let [width, height] = frame.size;
        let detail: Vec<Vec3> = (0..width * height).into_par_iter().map(|at| detail(frame, at)).collect();
        let of_cell = |cell: usize| {
            let range = |cell: usize, size: usize| {
                (cell * CELL).max(REACH)..((cell + 1) * CELL).min(size.saturating_sub(REACH))
            };
            let mut sums = [0.0; 3];
            for y in range(cell / cells[0], height) {
                for at in range(cell % cells[0], width).map(|x| y * width + x) {
                    let own = detail[at];
                    let best = DIRECTIONS.iter().fold(0.0_f32, |best, [x, y]| {
                        let step = y * width as isize + x;
                        let near = [-2, -1, 1, 2].map(|i| own.dot(detail[at.wrapping_add_signed(i * step)]));
                        best.max(near.into_iter().fold(f32::INFINITY, f32::min))
                    });
                    sums[0] += f64::from(best);
                    sums[1] += f64::from(best).powi(2);
                    sums[2] += f64::from(own.length_squared());
                }
            }
            sums
        };
        Self { cells, sums: (0..cells[0] * cells[1]).into_par_iter().map(of_cell).collect() }
    }

    /// Returns 1 where the small detail around a cell is no noise, and 0 where it may be.
    pub(super) fn detail(&self, cell: usize) -> f64 {
        let [columns, rows] = self.cells;
        let range = |cell: usize, count: usize| cell.saturating_sub(RADIUS)..(cell + RADIUS + 1).min(count);
        let around = range(cell / columns, rows)
            .flat_map(|row| range(cell % columns, columns).map(move |column| row * columns + column));
        let [coherent, squares, all] = around.fold([0.0; 3], |all, cell| {
            let of = self.sums[cell];
            [all[0] + of[0], all[1] + of[1], all[2] + of[2]]
        });
        // Of few bright paths five in a row may be so by chance.
        let coherent = coherent - DEVIATIONS * squares.sqrt();
        let [from, to] = COHERENT;
        // Of nothing, or of too much, it is not a number.
        let share = (coherent / all - from) / (to - from);
        if share > 0.0 { share.min(1.0) } else { 0.0 }
    }
}

/// Returns what the color of a pixel differs by from the mean of 3x3 pixels; 0 if one of them is not finite.
fn detail(frame: &Frame<'_>, at: usize) -> Vec3 {
    let [width, height] = frame.size;
    let (x, y) = (at % width, at / width);
    let (mut sum, mut count) = (Vec3::ZERO, 0.0);
    for row in y.saturating_sub(1)..(y + 2).min(height) {
        for color in &frame.color[row * width..][x.saturating_sub(1)..(x + 2).min(width)] {
            sum += *color;
            count += 1.0;
        }
    }
    let detail = frame.color[at] - sum / count;
    if detail.is_finite() { detail } else { Vec3::ZERO }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [usize; 2] = [64, 48];

    fn random(i: usize) -> f32 {
        let h = (i as u32 ^ 0x9E37_79B9).wrapping_mul(0x85EB_CA6B);
        let h = (h ^ (h >> 16)).wrapping_mul(0x21F0_AAAD);
        let h = (h ^ (h >> 15)).wrapping_mul(0x735A_2D97);
        ((h ^ (h >> 15)) >> 8) as f32 / (1 << 24) as f32
    }

    /// Letters are coherent under noise, and no noise is: neither that of each channel alone nor that of all, nor that of
    /// few paths, nor such as neighbours share.
    #[test]
    fn lines_are_told_from_noise() {
        let letters = |i: usize| {
            let [x, y] = [i % SIZE[0], i / SIZE[0]];
            Vec3::splat(if y % 8 < 6 && (x % 5 == 1 || y % 8 == x / 5 % 3 * 2) { 0.1 } else { 0.9 })
        };
        let independent = |i: usize| Vec3::from_array([0, 1, 2].map(|c| random(3 * i + c) - 0.5));
        let shared = |i: usize| Vec3::splat(random(i) - 0.5);
        let paths = |i: usize| Vec3::splat(random(i).powi(8));
        let filtered = |i: usize| shared(i) * 0.7 + (shared(i + 1) + shared(i + SIZE[0])) * 0.15;
        let coherent = |of: &dyn Fn(usize) -> Vec3| {
            let color: Vec<Vec3> = (0..SIZE[0] * SIZE[1]).map(of).collect();
            let cells = SIZE.map(|size| size.div_ceil(CELL));
            let found = Coherence::new(&Frame { size: SIZE, color: &color, ..Frame::default() }, cells);
            (0..cells[0] * cells[1])
                .map(|cell| found.detail(cell))
                .fold([1.0_f64, 0.0], |[least, most], of| [least.min(of), most.max(of)])
        };
        for (name, of) in [
            ("independent", &independent as &dyn Fn(usize) -> Vec3),
            ("shared", &shared),
            ("paths", &paths),
            ("filtered", &filtered),
            ("none", &|_| Vec3::ONE),
            ("too much", &|i| 1e30 * independent(i)),
        ] {
            assert_eq!(coherent(of), [0.0; 2], "{name}");
        }
        for amount in [0.0, 0.05, 0.2] {
            let of = |i: usize| letters(i) + amount * independent(i);
            assert_eq!(coherent(&of), [1.0; 2], "{amount}");
        }
    }
}
