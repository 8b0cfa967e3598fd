//! Pictures inside the page: reduced to display size, encoded as PNG and embedded as `data:` addresses.

use crate::error::Result;
use crate::formats::png;
use crate::metrics::heatmap;
use crate::scene::film::Film;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use maud::{Markup, html};

/// Longest side of an embedded picture in pixels.
pub(crate) const MOST_PIXELS: usize = 512;

/// Pictures whose longest side is shorter are shown with square pixels when the page enlarges them.
const COARSE: usize = 256;

/// Image element of the pixels `rgb[3 * (y * width + x) + channel]`. `aspect` is the displayed width over the height.
///
/// # Errors
/// If the picture has no pixels.
pub(crate) fn rgb8(width: usize, height: usize, rgb: &[u8], aspect: f64, alt: &str) -> Result<Markup> {
    moving(width, height, &[rgb], 0, aspect, alt)
}

/// Image element of pictures `rgb[3 * (y * width + x) + channel]` that follow each other at `rate` a second, without
/// end. `aspect` is the displayed width over the height.
///
/// # Errors
/// If there is no picture, or one has no pixels.
pub(crate) fn moving(
    width: usize,
    height: usize,
    frames: &[&[u8]],
    rate: u16,
    aspect: f64,
    alt: &str,
) -> Result<Markup> {
    let bytes = png::encode_frames(width, height, frames, rate)?;
    let address = format!("data:image/png;base64,{}", STANDARD.encode(bytes));
    let class = (width.max(height) < COARSE).then_some("coarse");
    let style = format!("aspect-ratio:{aspect:.4}");
    Ok(html! { img class=[class] src=(address) width=(width) height=(height) style=(style) alt=(alt); })
}

/// Image element of a film, converted for display.
///
/// # Errors
/// If the film has no pixels.
pub(crate) fn film(film: &Film, alt: &str) -> Result<Markup> {
    let small = reduced(film, MOST_PIXELS);
    rgb8(small.width, small.height, &png::display_rgb8(&small), aspect(film.width, film.height), alt)
}

/// Film of the means over square blocks of pixels, so large that no side exceeds `most` pixels.
pub(crate) fn reduced(film: &Film, most: usize) -> Film {
    let pool = Pool::of(film.width, film.height, most);
    let mean = |pixels: &mut dyn Iterator<Item = [f32; 4]>| {
        let (sum, n) = pixels.fold(([0.0; 4], 0.0), |(s, n), p| (std::array::from_fn(|c| s[c] + p[c]), n + 1.0_f32));
        sum.map(|v: f32| v / n)
    };
    Film::of(pool.width, pool.height, pool.apply(&film.rgba, mean))
}

/// The largest of the values (`values[y * width + x]`) in each of the blocks of [`reduced`].
pub(crate) fn largest(width: usize, height: usize, values: &[f64], most: usize) -> Vec<f64> {
    let pool = Pool::of(width, height, most);
    pool.apply(values, |pixels: &mut dyn Iterator<Item = f64>| pixels.fold(0.0, f64::max))
}

/// Image element of differences (`values[y * width + x]`) in false colors. A pixel that stands for several shows the
/// largest of them.
///
/// # Errors
/// If there are no pixels.
pub(crate) fn differences(width: usize, height: usize, values: &[f64], scale: f64, alt: &str) -> Result<Markup> {
    let pool = Pool::of(width, height, MOST_PIXELS);
    let small = largest(width, height, values, MOST_PIXELS);
    rgb8(pool.width, pool.height, &heatmap::shade_rgb8(&small, scale), aspect(width, height), alt)
}

/// Color bar between labels for its two ends; `paint` converts values in 0..1 to colors.
///
/// # Errors
/// If the bar cannot be encoded.
pub(crate) fn bar(paint: impl Fn(&[f64]) -> Vec<u8>, low: &str, high: &str) -> Result<Markup> {
    let ramp: Vec<f64> = (0..256).map(|i| f64::from(i) / 255.0).collect();
    let picture = rgb8(ramp.len(), 1, &paint(&ramp), 16.0, &format!("color bar from {low} to {high}"))?;
    Ok(html! { span.bar { span { (low) } (picture) span { (high) } } })
}

fn aspect(width: usize, height: usize) -> f64 {
    width as f64 / height.max(1) as f64
}

/// Reduction of square blocks of pixels to one pixel each.
struct Pool {
    block: usize,
    from: [usize; 2],
    width: usize,
    height: usize,
}

impl Pool {
    fn of(width: usize, height: usize, most: usize) -> Self {
        let block = width.max(height).div_ceil(most).max(1);
        Self { block, from: [width, height], width: width.div_ceil(block), height: height.div_ceil(block) }
    }

    fn apply<T: Copy>(&self, pixels: &[T], one: impl Fn(&mut dyn Iterator<Item = T>) -> T) -> Vec<T> {
        let [w, h] = self.from;
        let span = |i: usize, end: usize| i * self.block..((i + 1) * self.block).min(end);
        let block = |x: usize, y: usize| span(y, h).flat_map(move |v| span(x, w).map(move |u| pixels[v * w + u]));
        (0..self.height)
            .flat_map(|y| (0..self.width).map(move |x| (x, y)))
            .map(|(x, y)| one(&mut block(x, y)))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_at_the_border_are_smaller() {
        let pool = Pool::of(1025, 2, MOST_PIXELS);
        assert_eq!((pool.block, pool.width, pool.height), (3, 342, 1));
        let ones = vec![1; 1025 * 2];
        let sizes = pool.apply(&ones, |p| p.sum::<i32>());
        assert_eq!((sizes[0], sizes[341]), (6, 4));
        assert_eq!(Pool::of(512, 7, MOST_PIXELS).block, 1);
    }
}
