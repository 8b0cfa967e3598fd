//! One number a pixel: its means and its noise.
//!
//! A mask that smooth pictures hardly respond to tells the standard deviation of white noise (Immerkær 1996). Noise
//! responds half as much in a picture of half the size, detail several times as much: what both responses share is no
//! noise.

/// One number a pixel, row by row.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Plane<'p> {
    /// Pixels in a row.
    pub width: usize,
    /// Values; those that are not finite say nothing.
    pub values: &'p [f32],
}

impl Plane<'_> {
    /// Number of rows.
    pub(crate) fn height(&self) -> usize {
        self.values.len() / self.width.max(1)
    }

    /// The values, none larger than the largest beside it: one hot pixel shows nothing.
    pub(crate) fn bounded(&self) -> Vec<f32> {
        let (width, height) = (self.width, self.height());
        let bounded = |i: usize| {
            let (x, y) = (i % width, i / width);
            let rows = y.saturating_sub(1)..(y + 2).min(height);
            let beside = rows.flat_map(|v| (x.saturating_sub(1)..(x + 2).min(width)).map(move |u| v * width + u));
            let values = beside.filter(|k| *k != i).map(|k| self.values[k]).filter(|v| v.is_finite());
            let most = values.fold(f32::NEG_INFINITY, f32::max);
            if self.values[i] > most && most.is_finite() { most } else { self.values[i] }
        };
        (0..self.values.len()).map(bounded).collect()
    }

    /// Medians over squares of five pixels: specks of noise are gone, as video coding leaves them.
    pub(crate) fn medians(&self) -> Vec<f32> {
        const REACH: usize = 2;
        let (width, height) = (self.width, self.height());
        let row = |y: usize| {
            let rows = y.saturating_sub(REACH)..(y + REACH + 1).min(height);
            let mut values: Vec<f32> = Vec::new();
            let median = move |x: usize| {
                let columns = x.saturating_sub(REACH)..(x + REACH + 1).min(width);
                values.clear();
                values.extend(rows.clone().flat_map(|v| &self.values[v * width..][columns.clone()]));
                let middle = values.len() / 2;
                *values.select_nth_unstable_by(middle, f32::total_cmp).1
            };
            (0..width).map(median)
        };
        (0..height).flat_map(row).collect()
    }

    /// Means of four pixels; an odd last row or column is left out.
    fn halved(&self) -> (usize, Vec<f32>) {
        let (width, height) = (self.width / 2, self.height() / 2);
        let mean = |i: usize| {
            let corner = 2 * (i / width.max(1)) * self.width + 2 * (i % width.max(1));
            [0, 1, self.width, self.width + 1].iter().map(|k| 0.25 * self.values[corner + k]).sum()
        };
        (width, (0..width * height).map(mean).collect())
    }

    /// Standard deviation of white noise that the median response to the mask would be of; `None` where fewer than
    /// [`FEWEST`] pixels say something.
    fn response(&self, counts: impl Fn(f32) -> bool) -> Option<f64> {
        const MASK: [f32; 9] = [1.0, -2.0, 1.0, -2.0, 4.0, -2.0, 1.0, -2.0, 1.0];
        let at = |x: usize, y: usize| self.values[y * self.width + x];
        let response = |(x, y): (usize, usize)| {
            let sum: f32 = (0..9).map(|k| MASK[k] * at(x + k % 3 - 1, y + k / 3 - 1)).sum();
            sum.abs()
        };
        let (inner, rows) = (self.width.saturating_sub(1), self.height().saturating_sub(1));
        // Rows spread evenly over a large picture say as much as all.
        let step = (inner * rows / MOST).max(1);
        let pixels = (1..rows).step_by(step).flat_map(|y| (1..inner).map(move |x| (x, y)));
        let mut responses: Vec<f32> =
            pixels.filter(|(x, y)| counts(at(*x, *y))).map(response).filter(|r| r.is_finite()).collect();
        if responses.len() < FEWEST {
            return None;
        }
        let middle = responses.len() / 2;
        let (_, median, _) = responses.select_nth_unstable_by(middle, f32::total_cmp);
        // The squares of the mask's weights sum up to 36; half of a normal distribution lies within 0.6745 σ.
        Some(f64::from(*median) / (6.0 * 0.6745))
    }

    /// Standard deviation of the noise in the pixels whose values `counts` accepts; `None` where too few do.
    pub(crate) fn deviation(&self, counts: impl Fn(f32) -> bool + Copy) -> Option<f64> {
        let fine = self.response(counts)?;
        let (width, values) = self.halved();
        let coarse = Plane { width, values: &values }.response(counts).unwrap_or(0.0);
        // Of white noise the difference leaves all but a sixteenth.
        Some(((fine * fine - 0.25 * coarse * coarse) * 16.0 / 15.0).max(0.0).sqrt())
    }
}

/// A summed-area table of a plane, and of how many pixels say something.
#[derive(Debug)]
pub(crate) struct SummedAreaTable {
    width: usize,
    height: usize,
    sums: Vec<f64>,
    counts: Vec<u32>,
}

impl SummedAreaTable {
    /// Sums all values that are finite.
    pub(crate) fn new(plane: &Plane<'_>) -> Self {
        let (width, height) = (plane.width, plane.height());
        let entries = (width + 1) * (height + 1);
        let mut table = Self { width, height, sums: vec![0.0; entries], counts: vec![0; entries] };
        for y in 0..height {
            let (mut sum, mut count) = (0.0, 0);
            for x in 0..width {
                let value = plane.values[y * width + x];
                if value.is_finite() {
                    sum += f64::from(value);
                    count += 1;
                }
                let (above, here) = (y * (width + 1) + x + 1, (y + 1) * (width + 1) + x + 1);
                table.sums[here] = table.sums[above] + sum;
                table.counts[here] = table.counts[above] + count;
            }
        }
        table
    }

    /// Returns the mean over the square of `2 reach + 1` pixels around a pixel, and the share of these that lie in the
    /// picture and say something.
    pub(crate) fn mean(&self, pixel: usize, reach: usize) -> (f64, f64) {
        let (x, y) = (pixel % self.width, pixel / self.width);
        let (x0, y0) = (x.saturating_sub(reach), y.saturating_sub(reach));
        let (x1, y1) = ((x + reach + 1).min(self.width), (y + reach + 1).min(self.height));
        let stride = self.width + 1;
        let corners = [y1 * stride + x1, y0 * stride + x0, y0 * stride + x1, y1 * stride + x0];
        let [s, t, u, v] = corners.map(|i| self.sums[i]);
        let [a, b, c, d] = corners.map(|i| self.counts[i]);
        let count = f64::from(a + b - c - d);
        let edge = (2 * reach + 1) as f64;
        ((s + t - u - v) / count.max(1.0), count / (edge * edge))
    }
}

/// Fewest pixels that tell a noise, and about the most that are looked at.
const FEWEST: usize = 64;
const MOST: usize = 1 << 16;
