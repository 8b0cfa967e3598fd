//! Sums over blocks of pixels, and the linear models that follow from them.
//!
//! Models of a guided filter (He, Sun & Tang 2013) are pooled over neighbourhoods much larger than a pixel, so that a
//! coarse grid holds them without loss ("fast guided filter", He & Sun 2015): sums are kept for blocks of [`BLOCK`]²
//! pixels, and coefficients are interpolated between the blocks' centres.

use super::lanes::{LANES, Lanes};
use std::ops::Range;

/// Pixels along the side of a block.
pub(crate) const BLOCK: usize = 4;

/// Sums of a model: the count, the feature z, the products of its channels, the color c, and the products of both:
/// `1, z₀..z₂, z₀z₀, z₀z₁, z₀z₂, z₁z₁, z₁z₂, z₂z₂, c₀..c₂, z₀c₀..z₂c₂`.
pub(crate) const TERMS: usize = 22;

/// Coefficients of a model: three colors for the constant and each channel of the feature.
pub(crate) const COEFFICIENTS: usize = 12;

/// Places of the diagonal of the information matrix among the sums.
const DIAGONAL: [usize; 4] = [0, 4, 7, 9];

/// Ridge as a share of the information's diagonal. It draws coefficients to those that predict the feature.
const RIDGE: f32 = 1e-4;

/// Least pivot, for blocks of which nothing is known.
const LEAST_PIVOT: f32 = 1e-30;

/// Extent of the grid of blocks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Grid {
    /// Blocks across.
    pub columns: usize,
    /// Blocks from top to bottom.
    pub rows: usize,
}

impl Grid {
    /// Returns the grid that covers a picture of so many columns and rows of pixels.
    pub(crate) fn over([width, height]: [usize; 2]) -> Self {
        Self { columns: width.div_ceil(BLOCK), rows: height.div_ceil(BLOCK) }
    }

    /// Numbers in a row of a plane: the columns, and zeros up to a whole vector.
    pub(crate) fn stride(&self) -> usize {
        self.columns.next_multiple_of(LANES)
    }
}

/// Planes of numbers by block, row by row of blocks: within a row, plane after plane.
#[derive(Debug, Clone, Default)]
pub(crate) struct Planes {
    grid: Grid,
    planes: usize,
    /// The numbers.
    pub data: Vec<f32>,
}

impl Planes {
    /// Creates planes of zeros.
    pub(crate) fn new(grid: Grid, planes: usize) -> Self {
        Self { grid, planes, data: vec![0.0; grid.rows * planes * grid.stride()] }
    }

    /// Blocks that the planes are over.
    pub(crate) fn grid(&self) -> Grid {
        self.grid
    }

    /// Numbers in a row of blocks, all planes together.
    pub(crate) fn row_len(&self) -> usize {
        self.planes * self.grid.stride()
    }

    /// Returns a row of blocks of a plane.
    #[inline(always)]
    pub(crate) fn row(&self, row: usize, plane: usize) -> &[f32] {
        let stride = self.grid.stride();
        &self.data[row * self.row_len() + plane * stride..][..stride]
    }

    /// Returns the sums of a plane over the blocks within `radius` of those of a row, in vectors. `line` is scratch.
    #[inline(always)]
    pub(crate) fn pooled(&self, row: usize, plane: usize, radius: usize, line: &mut Vec<f32>, into: &mut [Lanes]) {
        let stride = self.grid.stride();
        // Zeros on both sides stand for what lies beyond.
        line.resize(stride + 2 * LANES, 0.0);
        let rows: Range<usize> = row.saturating_sub(radius)..(row + radius + 1).min(self.grid.rows);
        for at in (0..stride).step_by(LANES) {
            let mut sum = Lanes::ZERO;
            for row in rows.clone() {
                sum += Lanes::load(self.row(row, plane), at);
            }
            sum.store(line, LANES + at);
        }
        for (at, sum) in into.iter_mut().enumerate() {
            let centre = LANES + at * LANES;
            *sum = Lanes::ZERO;
            for place in centre - radius..centre + radius + 1 {
                *sum += Lanes::load(line, place);
            }
        }
    }
}

/// Scratch of [`solve_row`].
#[derive(Debug, Default)]
pub(crate) struct Pool {
    line: Vec<f32>,
    sums: Vec<Lanes>,
}

impl Pool {
    /// Returns the sums of some planes over the blocks within `radius` of those of a row, plane after plane.
    #[inline(always)]
    pub(crate) fn sums(
        &mut self,
        planes: &Planes,
        row: usize,
        which: impl Iterator<Item = (usize, usize)>,
    ) -> (usize, &[Lanes]) {
        let vectors = planes.grid.stride() / LANES;
        for (count, (plane, radius)) in which.enumerate() {
            self.sums.resize(self.sums.len().max((count + 1) * vectors), Lanes::ZERO);
            planes.pooled(row, plane, radius, &mut self.line, &mut self.sums[count * vectors..][..vectors]);
        }
        (vectors, &self.sums)
    }
}

/// Solves for the models of a row of blocks from their sums, pooled over the blocks within `radius`. Writes the
/// coefficients plane after plane, the pooled counts, and the coefficients that the colors determine as shares of the
/// counts.
#[inline(always)]
pub(crate) fn solve_row(
    sums: &Planes,
    row: usize,
    radius: usize,
    pool: &mut Pool,
    coefficients: &mut [f32],
    counts: &mut [f32],
    determined: &mut [f32],
) {
    let stride = sums.grid.stride();
    let own = (0..TERMS).map(|plane| (plane, radius));
    let wide = DIAGONAL.into_iter().map(|place| (place, radius + 1));
    let (vectors, pooled) = pool.sums(sums, row, own.chain(wide));
    for vector in 0..vectors {
        let mut terms = [Lanes::ZERO; TERMS];
        for (plane, term) in terms.iter_mut().enumerate() {
            *term = pooled[plane * vectors + vector];
        }
        let mut wide = [Lanes::ZERO; 4];
        for (plane, wide) in wide.iter_mut().enumerate() {
            *wide = pooled[(TERMS + plane) * vectors + vector];
        }
        let (found, freedom) = solve(&terms, &wide);
        for (plane, lanes) in found.into_iter().enumerate() {
            lanes.store(coefficients, plane * stride + vector * LANES);
        }
        (freedom / (terms[0] + Lanes([LEAST_PIVOT; LANES]))).store(determined, vector * LANES);
    }
    for vector in 0..vectors {
        pooled[vector].store(counts, vector * LANES);
    }
}

/// Returns the coefficients of eight models from their sums, and their degrees of freedom by channel: four less what
/// the ridge determines.
///
/// The equations `(R + ridge) (β - β₀) = m - R β₀`, where β₀ predicts the feature, are solved by `L D Lᵀ`. The ridge is
/// a share of the diagonal of R, here and over a wider neighbourhood (`wide`): where a dark block lies beside bright
/// ones, its coefficients meet their features. It keeps every pivot above what rounding takes from it, for colors of
/// any brightness.
#[inline(always)]
fn solve(terms: &[Lanes; TERMS], wide: &[Lanes; 4]) -> ([Lanes; COEFFICIENTS], Lanes) {
    let [n, z0, z1, z2, z00, z01, z02, z11, z12, z22, ..] = *terms;
    let color = |channel: usize| terms[10 + channel];
    let product = |z: usize, channel: usize| terms[13 + 3 * z + channel];
    // As many pixels as in the neighbourhood itself.
    let share = n / (wide[0] + LEAST_PIVOT);
    let ridge = |d: Lanes, wide: Lanes| (d + wide * share) * RIDGE + LEAST_PIVOT;
    let pivot = |d: Lanes, wide: Lanes| d + ridge(d, wide);
    let one = Lanes([1.0; LANES]);
    let inverse = |d: Lanes| one / d.max(Lanes([LEAST_PIVOT; LANES]));
    let i0 = inverse(pivot(n, wide[0]));
    let (l10, l20, l30) = (z0 * i0, z1 * i0, z2 * i0);
    let i1 = inverse(pivot(z00, wide[1]) - l10 * z0);
    let (a21, a31) = (z01 - l20 * z0, z02 - l30 * z0);
    let (l21, l31) = (a21 * i1, a31 * i1);
    let i2 = inverse(pivot(z11, wide[2]) - l20 * z1 - l21 * a21);
    let a32 = z12 - l30 * z1 - l31 * a21;
    let l32 = a32 * i2;
    let i3 = inverse(pivot(z22, wide[3]) - l30 * z2 - l31 * a31 - l32 * a32);
    let mut found = [Lanes::ZERO; COEFFICIENTS];
    let feature = [[z0, z1, z2], [z00, z01, z02], [z01, z11, z12], [z02, z12, z22]];
    for channel in 0..3 {
        let right = |row: usize| {
            let moment = if row == 0 { color(channel) } else { product(row - 1, channel) };
            moment - feature[row][channel]
        };
        let y0 = right(0);
        let y1 = right(1) - l10 * y0;
        let y2 = right(2) - l20 * y0 - l21 * y1;
        let y3 = right(3) - l30 * y0 - l31 * y1 - l32 * y2;
        let x3 = y3 * i3;
        let x2 = y2 * i2 - l32 * x3;
        let x1 = y1 * i1 - l21 * x2 - l31 * x3;
        let x0 = y0 * i0 - l10 * x1 - l20 * x2 - l30 * x3;
        for (row, x) in [x0, x1, x2, x3].into_iter().enumerate() {
            let prior = if row == channel + 1 { 1.0 } else { 0.0 };
            found[3 * row + channel] = x + prior;
        }
    }
    // The trace of (R + ridge)⁻¹ R, by the diagonal of the inverse, which is that of L⁻ᵀ D⁻¹ L⁻¹.
    let (m20, m31) = (l21 * l10 - l20, l32 * l21 - l31);
    let m30 = Lanes::ZERO - l30 - l31 * (Lanes::ZERO - l10) - l32 * m20;
    let diagonal = [
        ((i0 + l10 * l10 * i1) + m20 * m20 * i2) + m30 * m30 * i3,
        (i1 + l21 * l21 * i2) + m31 * m31 * i3,
        i2 + l32 * l32 * i3,
        i3,
    ];
    let mut freedom = Lanes([4.0; LANES]);
    for (row, own) in [n, z00, z11, z22].into_iter().enumerate() {
        freedom = freedom - ridge(own, wide[row]) * diagonal[row];
    }
    (found, freedom.max(Lanes::ZERO))
}

/// Rows of planes by block, interpolated to a row of pixels.
#[derive(Debug, Default)]
pub(crate) struct Interpolated {
    stride: usize,
    data: Vec<f32>,
}

impl Interpolated {
    /// Takes the planes of a row of pixels.
    #[inline(always)]
    pub(crate) fn take(&mut self, grid: Grid, row: usize, planes: &Planes) {
        let place = (row as f32 + 0.5) / BLOCK as f32 - 0.5;
        let place = place.clamp(0.0, (grid.rows - 1) as f32);
        let above = place as usize;
        let part = place - above as f32;
        let (count, len) = (planes.planes, planes.row_len());
        let below = &planes.data[(above + 1).min(grid.rows - 1) * len..][..len];
        let above = &planes.data[above * len..][..len];
        let stride = grid.stride();
        // One number before the first, and some after the last, repeat them.
        self.stride = stride + 2 * LANES;
        self.data.resize(count * self.stride, 0.0);
        for plane in 0..count {
            let line = &mut self.data[plane * self.stride..][..self.stride];
            for at in (0..stride).step_by(LANES) {
                let a = Lanes::load(above, plane * stride + at);
                let b = Lanes::load(below, plane * stride + at);
                (a + (b - a) * part).store(line, 1 + at);
            }
            line[0] = line[1];
            let last = line[grid.columns];
            line[grid.columns + 1..].fill(last);
        }
    }

    /// Returns a plane's numbers of eight pixels, `vector` of the row.
    #[inline(always)]
    pub(crate) fn at(&self, plane: usize, vector: usize) -> Lanes {
        let blocks = LANES / BLOCK;
        let around = self.data[plane * self.stride + vector * blocks..].first_chunk().copied().unwrap_or([0.0; 4]);
        interpolate(around)
    }
}

/// Returns the numbers of eight pixels in two blocks from those of the blocks and the ones to both sides.
#[inline(always)]
fn interpolate([a, b, c, d]: [f32; 4]) -> Lanes {
    // Pixels lie at 1/8, 3/8, 5/8 and 7/8 of their block.
    const PARTS: Lanes = Lanes([0.625, 0.875, 0.125, 0.375, 0.625, 0.875, 0.125, 0.375]);
    let (left, right) = (Lanes([a, a, b, b, b, b, c, c]), Lanes([b, b, c, c, c, c, d, d]));
    left + (right - left) * PARTS
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use nalgebra::Matrix4;

    /// Degrees of freedom are the trace of (R + ridge)⁻¹ R: nearly four where features differ, and fewer where the
    /// ridge decides.
    #[test]
    fn degrees_of_freedom_are_a_trace() {
        for spread in [1.0_f64, 0.03, 0.01] {
            let mut information = Matrix4::<f64>::zeros();
            for i in 0..200 {
                let wave = |k: f64| (f64::from(i) * k).sin();
                let z = [0.8 + 0.3 * spread * wave(0.7), 0.5 + spread * wave(1.3), 0.4 + spread * wave(2.9)];
                let row = nalgebra::Vector4::new(1.0, z[0], z[1], z[2]);
                information += row * row.transpose();
            }
            let mut terms = [Lanes::ZERO; TERMS];
            let places = (0..4).flat_map(|row| (row..4).map(move |column| (row, column)));
            for (term, place) in terms.iter_mut().zip(places) {
                *term = Lanes([information[place] as f32; LANES]);
            }
            // The wider neighbourhood is three times as large, and brighter.
            let wide: [Lanes; 4] = std::array::from_fn(|i| terms[DIAGONAL[i]] * if i == 0 { 3.0 } else { 6.0 });
            let ridge = Matrix4::from_diagonal(&nalgebra::Vector4::from_fn(|i, _| {
                information[(i, i)] * f64::from(RIDGE) * if i == 0 { 2.0 } else { 3.0 }
            }));
            let wanted = ((information + ridge).try_inverse().unwrap() * information).trace();
            let found = f64::from(solve(&terms, &wide).1.0[3]);
            println!("{spread}: {found} of {wanted}");
            assert!((found - wanted).abs() < 0.02, "{spread}: {found}, {wanted}");
        }
    }
}
