//! A raster of 8-bit sRGB pixels to draw on.

use super::font::{self, Font};

/// An sRGB color.
pub(crate) type Color = [u8; 3];

/// A raster of pixels, row by row from the top left.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Canvas {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Samples `rgb[3 * (y * width + x) + channel]`.
    pub rgb: Vec<u8>,
}

impl Canvas {
    /// A canvas of one color.
    pub(crate) fn new(width: usize, height: usize, color: Color) -> Self {
        Self { width, height, rgb: color.repeat(width * height) }
    }

    /// A canvas of the given samples, of which missing ones are black.
    pub(crate) fn of(width: usize, height: usize, mut rgb: Vec<u8>) -> Self {
        rgb.resize(3 * width * height, 0);
        Self { width, height, rgb }
    }

    /// Color of a pixel; black outside.
    pub(crate) fn pixel(&self, x: usize, y: usize) -> Color {
        let at = 3 * (y * self.width + x);
        match self.rgb.get(at..at + 3) {
            Some([r, g, b]) if x < self.width => [*r, *g, *b],
            _ => [0; 3],
        }
    }

    /// Sets a pixel, if it lies on the canvas.
    pub(crate) fn set(&mut self, x: i64, y: i64, color: Color) {
        if let (Ok(x), Ok(y)) = (usize::try_from(x), usize::try_from(y))
            && x < self.width
            && y < self.height
        {
            self.rgb[3 * (y * self.width + x)..][..3].copy_from_slice(&color);
        }
    }

    /// Fills a rectangle, as far as it lies on the canvas.
    pub(crate) fn fill(&mut self, [x, y]: [usize; 2], [width, height]: [usize; 2], color: Color) {
        let columns = x.min(self.width)..(x + width).min(self.width);
        for row in y.min(self.height)..(y + height).min(self.height) {
            let from = 3 * (row * self.width + columns.start);
            self.rgb[from..from + 3 * columns.len()].copy_from_slice(&color.repeat(columns.len()));
        }
    }

    /// Puts another canvas on this one, as far as it lies on it.
    pub(crate) fn put(&mut self, other: &Self, [x, y]: [usize; 2]) {
        let columns = other.width.min(self.width.saturating_sub(x));
        for row in 0..other.height.min(self.height.saturating_sub(y)) {
            let to = 3 * ((y + row) * self.width + x);
            let from = 3 * row * other.width;
            self.rgb[to..to + 3 * columns].copy_from_slice(&other.rgb[from..from + 3 * columns]);
        }
    }

    /// Draws a line of `thickness` pixels between two points.
    pub(crate) fn line(&mut self, from: [f64; 2], to: [f64; 2], thickness: i64, color: Color) {
        let by = [to[0] - from[0], to[1] - from[1]];
        let steps = by[0].abs().max(by[1].abs()).ceil().clamp(1.0, 1e5);
        for i in 0..=steps as usize {
            let t = i as f64 / steps;
            let [x, y] = [0, 1].map(|a| (from[a] + t * by[a]).round() as i64 - (thickness - 1) / 2);
            (0..thickness * thickness).for_each(|k| self.set(x + k % thickness, y + k / thickness, color));
        }
    }

    /// Draws a text whose upper left corner lies at a point. What lies beyond the canvas is cut.
    pub(crate) fn text(&mut self, [x, y]: [usize; 2], text: &str, font: Font, color: Color) {
        font::draw(text, font, |[column, row]| self.set((x + column) as i64, (y + row) as i64, color));
    }

    /// The picture with sides of `width` and `height` pixels, each the mean over the area that it stands for.
    #[must_use]
    pub(crate) fn resampled(&self, width: usize, height: usize) -> Self {
        let spans = |to: usize, from: usize| {
            (0..to).map(move |i| {
                let start = (i * from / to).min(from.saturating_sub(1));
                start..((i + 1) * from).div_ceil(to).clamp(start + 1, from.max(start + 1))
            })
        };
        let columns: Vec<_> = spans(width, self.width).collect();
        let mut rgb = Vec::with_capacity(3 * width * height);
        for rows in spans(height, self.height) {
            for columns in &columns {
                let (mut sum, mut count) = ([0_u32; 3], 0);
                for (x, y) in rows.clone().flat_map(|y| columns.clone().map(move |x| (x, y))) {
                    let pixel = self.pixel(x, y);
                    (0..3).for_each(|c| sum[c] += u32::from(pixel[c]));
                    count += 1;
                }
                rgb.extend(sum.map(|sum| (sum / count) as u8));
            }
        }
        Self::of(width, height, rgb)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drawing_beyond_the_canvas_is_cut() {
        let mut canvas = Canvas::new(4, 3, [9; 3]);
        canvas.fill([3, 1], [9, 9], [1, 2, 3]);
        canvas.put(&Canvas::new(3, 3, [7; 3]), [2, 2]);
        canvas.line([-5.0, 0.0], [9.0, 0.0], 1, [5; 3]);
        canvas.text([3, 2], "Wide text", Font::Small, [8; 3]);
        assert_eq!(canvas.rgb.len(), 36);
        assert_eq!((canvas.pixel(0, 0), canvas.pixel(3, 1), canvas.pixel(2, 2)), ([5; 3], [1, 2, 3], [7; 3]));
        assert_eq!((canvas.pixel(0, 1), canvas.pixel(4, 0)), ([9; 3], [0; 3]));
    }

    #[test]
    fn resampling_takes_means_and_repeats() {
        let canvas = Canvas::of(2, 2, vec![0, 0, 0, 100, 100, 100, 200, 200, 200, 100, 100, 100]);
        assert_eq!(canvas.resampled(1, 1).rgb, [100; 3]);
        assert_eq!(canvas.resampled(4, 2).pixel(3, 0), [100; 3]);
        assert_eq!(canvas.resampled(4, 2).pixel(1, 1), [200; 3]);
    }
}
