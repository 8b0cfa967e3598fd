//! Coherence of small detail, which tells lines and edges from noise.
//!
//! A pixel on a line or beside an edge differs from the mean around it as its neighbours do along the line. Of noise
//! five pixels in a row seldom differ in the same way, along whatever direction, and whether its channels and its
//! neighbours are alike or not.

use super::blocks::{BLOCK, Grid, Interpolated, Planes, Pool};
use super::frame::Frame;
use super::lanes::{LANES, Lanes, between, each};
use super::layout::{MARGIN, line_of};
use super::vectors::vectors;
use crate::arch::Arch;
use glam::Vec3;
use rayon::prelude::*;

/// Blocks to each side over which detail is pooled.
const POOL: usize = 6;
/// Rows of blocks that are summed together.
const BAND: usize = 4;
/// Directions along which lines and edges run: to the right, downwards, and along both diagonals.
const DIRECTIONS: [[isize; 2]; 4] = [[1, 0], [0, 1], [1, 1], [-1, 1]];
/// Neighbours to each side along a direction.
const REACH: usize = 2;
/// Standard deviations by chance that are taken from sums of coherent detail.
const DEVIATIONS: f32 = 1.0;
/// Share of what was taken away of a frame that is coherent, between which it comes to be no noise. That of noise is up
/// to 0.08 behind pixel filters as renderers have them.
const COHERENT: [f32; 2] = [0.08, 0.1];

/// Planes: sums over the pixels of a block of the least product with the four nearest along the direction where that is
/// greatest, of the squares of those, and of the detail's squares.
const SUMS: usize = 3;

/// Coherence of the small detail of a picture, by block.
#[derive(Debug, Default)]
pub(crate) struct Coherence {
    size: [usize; 2],
    /// Brightness, line by line, with margins; not a number where there is none.
    light: Vec<f32>,
    sums: Planes,
    /// Shares of what was taken away that come back.
    shares: Planes,
}

impl Coherence {
    /// Creates sums over pictures of so many columns and rows.
    pub(crate) fn new(size: [usize; 2]) -> Self {
        let grid = Grid::over(size);
        let light = vec![f32::NAN; size[1] * line_of(size[0])];
        Self { size, light, sums: Planes::new(grid, SUMS), shares: Planes::new(grid, 1) }
    }

    /// Returns the lines of brightness, whose pixels begin behind a margin.
    pub(crate) fn lines(&mut self) -> impl IndexedParallelIterator<Item = &mut [f32]> {
        self.light.par_chunks_exact_mut(line_of(self.size[0]))
    }

    /// Sums the small detail of the brightness, or adds it to what was summed.
    pub(crate) fn sum(&mut self, adds: bool) {
        let Self { size, light, sums, .. } = self;
        let stride = sums.grid().stride();
        let rows = sums.data.par_chunks_mut(BAND * SUMS * stride).enumerate();
        rows.for_each_init(Vec::new, |detail, (band, planes)| {
            let top = band * BAND * BLOCK;
            Arch::default().dispatch(Sum { size: *size, light, top, adds, detail, planes });
        });
    }

    /// Returns the shares of the power of small detail that are coherent, of a row of neighbourhoods. They are no
    /// numbers where there is no detail, or too much to be squared.
    pub(crate) fn of_row(&self, row: usize, pool: &mut Pool) -> Vec<Lanes> {
        let (vectors, found) = pool.sums(&self.sums, row, (0..SUMS).map(|plane| (plane, POOL)));
        let mut to = Vec::with_capacity(vectors);
        for vector in 0..vectors {
            let [coherent, squares, all]: [Lanes; SUMS] = each(|plane| found[plane * vectors + vector]);
            // Of few bright paths five in a row may be so by chance.
            to.push((coherent - squares.sqrt() * DEVIATIONS) / all);
        }
        to
    }

    /// Gives back to the colors `to` what was taken away of a frame, whose brightness this holds, where it is coherent;
    /// and adds that to the shares of the blocks.
    pub(crate) fn give_back(&mut self, frame: &Frame<'_>, shares: &mut Planes, to: &mut [Vec3]) {
        self.sum(false);
        let (grid, planes, width) = (self.sums.grid(), shares.row_len(), self.size[0]);
        let mut coherent = std::mem::take(&mut self.shares);
        let rows = coherent.data.par_chunks_mut(grid.stride()).zip(shares.data.par_chunks_mut(planes)).enumerate();
        rows.with_min_len(8).for_each_init(Pool::default, |pool, (row, (coherent, shares))| {
            for (vector, share) in self.of_row(row, pool).into_iter().enumerate() {
                let (one, share) = (Lanes([1.0; LANES]), between(share, COHERENT));
                share.store(coherent, vector * LANES);
                let before = Lanes::load(shares, vector * LANES);
                (before + (one - before) * share).store(shares, vector * LANES);
            }
        });
        self.shares = coherent;
        let shares = &self.shares;
        // Seldom is any.
        let is_any = |row: usize| shares.data[row * grid.stride()..][..grid.columns].iter().any(|share| *share > 0.0);
        let rows = to.par_chunks_mut(width).zip(frame.color.par_chunks(width)).enumerate();
        rows.with_min_len(8).for_each_init(Interpolated::default, |interpolated, (row, (to, from))| {
            let block = row / BLOCK;
            if (block.saturating_sub(1)..(block + 2).min(grid.rows)).any(is_any) {
                interpolated.take(grid, row, shares);
                for (at, (to, from)) in to.iter_mut().zip(from).enumerate().filter(|(_, (_, from))| from.is_finite()) {
                    *to += (*from - *to) * interpolated.at(0, at / LANES).0[at % LANES];
                }
            }
        });
    }
}

/// Sums the detail of rows of blocks.
struct Sum<'a> {
    size: [usize; 2],
    light: &'a [f32],
    top: usize,
    adds: bool,
    /// Lines of differences from the mean around.
    detail: &'a mut Vec<f32>,
    planes: &'a mut [f32],
}

impl pulp::NullaryFnOnce for Sum<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { size: [width, height], light, top, adds, detail, planes } = self;
        let (groups, line, stride) = (vectors(width), line_of(width), Grid::over([width, height]).stride());
        let rows = planes.len() / (SUMS * stride) * BLOCK;
        detail.clear();
        detail.resize((rows + 2 * REACH) * line, 0.0);
        for (at, detail) in detail.chunks_exact_mut(line).enumerate() {
            let row = (top + at).wrapping_sub(REACH);
            // At the border of a picture is no detail.
            if !(1..height.max(1) - 1).contains(&row) {
                continue;
            }
            for at in (0..groups).map(|group| MARGIN + group * LANES) {
                let mut mean = Lanes::ZERO;
                for row in row - 1..row + 2 {
                    for column in at - 1..at + 2 {
                        mean += Lanes::load(light, row * line + column);
                    }
                }
                numbers(Lanes::load(light, row * line + at) - mean * (1.0 / 9.0)).store(detail, at);
            }
        }
        for (of_band, planes) in planes.chunks_exact_mut(SUMS * stride).enumerate() {
            for group in 0..groups {
                let mut sums = [Lanes::ZERO; SUMS];
                for row in 0..BLOCK {
                    let place = (of_band * BLOCK + row + REACH) * line + MARGIN + group * LANES;
                    let own = Lanes::load(detail, place);
                    let best = coherent(detail, place, line, own);
                    sums = [sums[0] + best, best.mul_add(best, sums[1]), own.mul_add(own, sums[2])];
                }
                for (plane, sums) in planes.chunks_exact_mut(stride).zip(sums) {
                    let blocks = sums.0.as_chunks::<BLOCK>().0;
                    for (to, of) in plane[group * (LANES / BLOCK)..].iter_mut().zip(blocks) {
                        // Times 0 what is not finite would stay so.
                        *to = if adds { *to } else { 0.0 } + ((of[0] + of[1]) + (of[2] + of[3]));
                    }
                }
            }
        }
    }
}

/// Returns the least product of details with the four nearest along the direction where that is greatest; 0 where
/// there is none above.
#[inline(always)]
fn coherent(detail: &[f32], place: usize, line: usize, own: Lanes) -> Lanes {
    let (mut least, mut most) = (Lanes([f32::NEG_INFINITY; LANES]), Lanes([f32::INFINITY; LANES]));
    for [right, down] in DIRECTIONS {
        let step = down * line as isize + right;
        let near: [Lanes; 4] = each(|i| Lanes::load(detail, place.wrapping_add_signed([-2, -1, 1, 2][i] * step)));
        least = least.max(near[0].min(near[1]).min(near[2].min(near[3])));
        most = most.min(near[0].max(near[1]).max(near[2].max(near[3])));
    }
    (own * own.select(least, most)).max(Lanes::ZERO)
}

/// Returns 0 in place of what is not finite.
#[inline(always)]
fn numbers(of: Lanes) -> Lanes {
    let mut to = of.0;
    for to in &mut to {
        *to = if *to * 0.0 == 0.0 { *to } else { 0.0 };
    }
    Lanes(to)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [usize; 2] = [130, 49];

    fn random(i: usize) -> f32 {
        let h = (i as u32 ^ 0x9E37_79B9).wrapping_mul(0x85EB_CA6B);
        let h = (h ^ (h >> 16)).wrapping_mul(0x21F0_AAAD);
        let h = (h ^ (h >> 15)).wrapping_mul(0x735A_2D97);
        ((h ^ (h >> 15)) >> 8) as f32 / (1 << 24) as f32
    }

    /// Writes the brightness of a picture.
    fn fill(coherence: &mut Coherence, of: impl Fn(usize) -> f32 + Sync) {
        coherence.lines().enumerate().for_each(|(y, line)| {
            (0..SIZE[0]).for_each(|x| line[MARGIN + x] = of(y * SIZE[0] + x));
        });
    }

    /// Letters that were taken away come back where they are, and noise does not.
    #[test]
    fn lines_come_back() {
        let letters = |i: usize| i % SIZE[0] >= SIZE[0] / 2;
        let taken = |i: usize| if letters(i) { 0.3 * letter(i) } else { 0.3 * (random(i) - 0.5) };
        let color: Vec<Vec3> =
            (0..SIZE[0] * SIZE[1]).map(|i| Vec3::splat(if i == 5 { f32::NAN } else { 1.0 })).collect();
        let mut to: Vec<Vec3> = (0..color.len()).map(|i| color[i] - taken(i)).collect();
        let before = to.clone();
        let (grid, mut coherence) = (Grid::over(SIZE), Coherence::new(SIZE));
        let mut shares = Planes::new(grid, 2);
        shares.data.fill(0.5);
        // A frame too bright to be squared leaves nothing behind.
        fill(&mut coherence, |i| 1e30 * taken(i));
        coherence.give_back(&Frame { size: SIZE, color: &color, ..Frame::default() }, &mut shares, &mut before.clone());
        assert!(shares.data.iter().all(|share| *share == 0.5));
        fill(&mut coherence, |i| if i == 5 { f32::NAN } else { 3.0 * taken(i) });
        coherence.give_back(&Frame { size: SIZE, color: &color, ..Frame::default() }, &mut shares, &mut to);
        for i in 0..color.len() {
            match i % SIZE[0] {
                0..8 if i != 5 => assert_eq!(to[i], before[i], "{i}"),
                120.. => assert!((to[i] - color[i]).length() < 1e-6, "{i}"),
                _ => {}
            }
        }
        let row = shares.row(grid.rows / 2, 0);
        assert_eq!([row[0], row[grid.columns - 1]], [0.5, 1.0]);
        assert_eq!(shares.row(0, 1), [0.5; 40]);
    }

    fn letter(i: usize) -> f32 {
        let [x, y] = [i % SIZE[0], i / SIZE[0]];
        if y % 8 < 6 && (x % 5 == 1 || y % 8 == x / 5 % 3 * 2) { 1.0 } else { 0.0 }
    }

    /// Letters are coherent under noise, and no noise is: neither that of each channel alone nor that of all, nor that of
    /// few paths, nor such as neighbours share.
    #[test]
    fn lines_are_told_from_noise() {
        let letters = |i: usize| Vec3::splat(0.9 - 0.8 * letter(i));
        let independent = |i: usize| Vec3::from_array([0, 1, 2].map(|c| random(3 * i + c) - 0.5));
        let shared = |i: usize| Vec3::splat(random(i) - 0.5);
        let paths = |i: usize| Vec3::splat(random(i).powi(8));
        let filtered = |i: usize| shared(i) * 0.7 + (shared(i + 1) + shared(i + SIZE[0])) * 0.15;
        // Least and greatest share of a picture.
        let coherent = |of: &(dyn Fn(usize) -> Vec3 + Sync)| {
            let mut coherence = Coherence::new(SIZE);
            for channel in 0..3 {
                fill(&mut coherence, |i| of(i)[channel]);
                coherence.sum(channel > 0);
            }
            let grid = Grid::over(SIZE);
            let rows = (0..grid.rows).map(|row| coherence.of_row(row, &mut Pool::default()));
            rows.fold([f32::INFINITY, f32::NEG_INFINITY], |all, row| {
                let shares = row.iter().flat_map(|lanes| lanes.0).take(grid.columns);
                shares.fold(all, |[least, most], share| [least.min(share), most.max(share)])
            })
        };
        for (name, of) in [
            ("independent", &independent as &(dyn Fn(usize) -> Vec3 + Sync)),
            ("shared", &shared),
            ("paths", &paths),
            ("filtered", &filtered),
            ("none", &|_| Vec3::ONE),
            ("too much", &|i| 1e30 * independent(i)),
        ] {
            let [_, most] = coherent(of);
            // Of none, and of too much, it is not a number.
            assert!(most < 0.06, "{name}: {most}");
        }
        for amount in [0.0, 0.05, 0.2] {
            let of = |i: usize| letters(i) + amount * independent(i);
            let [least, _] = coherent(&of);
            assert!(least > 0.1, "{amount}: {least}");
        }
    }
}
