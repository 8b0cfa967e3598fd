//! Frames of sequences side by side, with their differences, as a moving picture.

use super::{number, picture};
use crate::error::Result;
use crate::formats::png;
use crate::metrics::heatmap;
use crate::scene::film::Film;
use maud::{Markup, html};

/// Longest side of a picture of the strip, in pixels.
const MOST_PIXELS: usize = 320;

/// Black columns between pictures.
const GAP: usize = 4;

/// Share of the pixels that the scale of the differences covers: a few bright outliers must not leave the others black.
const COVERED: f64 = 0.999;

/// Pictures of a frame from several sequences and how far one of them is from another, reduced for display.
#[derive(Debug, Clone)]
pub(crate) struct StripFrame {
    pictures: Vec<Film>,
    differences: Vec<f64>,
}

impl StripFrame {
    /// Reduces films of equal size, of which `differs` is held against the last. Pixels of the differences show the
    /// largest that they stand for.
    pub(crate) fn new(films: &[&Film], differs: usize) -> Self {
        let (film, reference) = (films[differs], films[films.len() - 1]);
        let all = heatmap::differences(film, reference);
        Self {
            pictures: films.iter().map(|film| picture::reduced(film, MOST_PIXELS)).collect(),
            differences: picture::largest(film.width, film.height, &all, MOST_PIXELS),
        }
    }

    /// Columns and rows of each picture.
    pub(crate) fn size(&self) -> [usize; 2] {
        [self.pictures[0].width, self.pictures[0].height]
    }

    /// Pictures in the order in which they were given, reduced.
    pub(crate) fn pictures(&self) -> &[Film] {
        &self.pictures
    }

    /// All side by side, the differences last: width, height, three bytes a pixel.
    fn side_by_side(&self, scale: f64) -> (usize, usize, Vec<u8>) {
        let [width, height] = self.size();
        let mut parts: Vec<Vec<u8>> = self.pictures.iter().map(png::display_rgb8).collect();
        parts.push(heatmap::shade_rgb8(&self.differences, scale));
        let mut rgb = Vec::new();
        for y in 0..height {
            for (at, part) in parts.iter().enumerate() {
                rgb.extend(std::iter::repeat_n(0, if at > 0 { 3 * GAP } else { 0 }));
                rgb.extend_from_slice(&part[3 * y * width..3 * (y + 1) * width]);
            }
        }
        (parts.len() * (width + GAP) - GAP, height, rgb)
    }
}

/// Moving picture of frames of equal size, at `rate` frames a second. `labels` name the pictures of each frame.
///
/// # Errors
/// If there is no frame, or a picture has no pixels.
pub(crate) fn draw(labels: &[&str], frames: &[StripFrame], rate: u16) -> Result<Markup> {
    let scale = scale(frames);
    let drawn: Vec<(usize, usize, Vec<u8>)> = frames.iter().map(|frame| frame.side_by_side(scale)).collect();
    let (width, height) = drawn.first().map_or((0, 0), |(width, height, _)| (*width, *height));
    let pictures: Vec<&[u8]> = drawn.iter().map(|(.., rgb)| &rgb[..]).collect();
    let alt = format!("{} and the difference, side by side", labels.join(", "));
    let moving = picture::moving(width, height, &pictures, rate, width as f64 / height.max(1) as f64, &alt)?;
    let bar = picture::bar(|t| heatmap::shade_rgb8(t, 1.0), "0", &format!("{} and above", number::short(scale)))?;
    Ok(html! {
        figure.strip {
            div.heads { @for label in labels { span { (label) } } span { "Difference" } }
            (moving)
            figcaption.caption { "Largest difference of the three colors from the reference, scene-linear: " (bar) }
        }
    })
}

/// Difference that the brightest color stands for.
fn scale(frames: &[StripFrame]) -> f64 {
    let all = frames.iter().flat_map(|frame| frame.differences.iter().copied());
    let mut all: Vec<f64> = all.filter(|d| d.is_finite()).collect();
    all.sort_unstable_by(f64::total_cmp);
    let covered = all.get((all.len().saturating_sub(1) as f64 * COVERED) as usize).copied().unwrap_or(0.0);
    if covered > 0.0 { covered } else { all.last().copied().unwrap_or(0.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_stand_side_by_side() {
        let grey = |v: f32| Film::of(8, 4, vec![[v, v, v, 1.0]; 32]);
        let (dark, bright) = (grey(0.0), grey(1.0));
        let frame = StripFrame::new(&[&dark, &bright], 0);
        let (width, height, rgb) = frame.side_by_side(1.0);
        assert_eq!((width, height, rgb.len()), (3 * 8 + 2 * GAP, 4, 3 * 4 * (24 + 2 * GAP)));
        assert_eq!((rgb[0], rgb[3 * (8 + GAP)], rgb[3 * (16 + 2 * GAP)]), (0, 255, 254));
        let page = draw(&["a", "b"], &[frame.clone(), frame], 12).unwrap().into_string();
        assert!(page.contains("data:image/png") && page.contains("Difference"));
        assert!(draw(&["a", "b"], &[], 12).is_err());
    }
}
