//! The sheet of functions that suit a volume: a picture through each, and the histogram with the boundaries.

use super::pictures::{Effect, Picture};
use crate::formats::png::ToneMapping;
use crate::metrics::boundaries::{Analysis, Boundary, COLORS, Candidate};
use crate::report::sheet::{Canvas, Histogram, Sheet, Tile};
use crate::report::short;
use std::path::Path;

/// Width and height of the histogram in pixels, and its number of bins.
const HISTOGRAM: [usize; 2] = [320, 240];
const BINS: usize = 32;
/// Color of the background's mark.
const BACKGROUND: [u8; 3] = [130, 130, 130];
/// Most pictures side by side.
const COLUMNS: usize = 4;

/// Draws the sheet.
pub(super) fn draw(
    analysis: &Analysis,
    (path, grid): (&Path, &str),
    candidates: &[Candidate],
    pictures: &[Picture],
) -> Canvas {
    let [low, high] = analysis.range.map(short);
    let lines = vec![
        format!("grid '{grid}', values {low} to {high}, background {}", short(analysis.background)),
        "by emission and absorption, exposure 0 EV, clipped, sRGB".into(),
    ];
    let pictured = candidates.iter().zip(pictures).enumerate();
    let mut tiles: Vec<Tile> = pictured.map(|(i, (candidate, picture))| tile(i + 1, candidate, picture)).collect();
    tiles.push(histogram(analysis));
    let title = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
    Sheet { title, lines, lead: None, columns: COLUMNS.min(tiles.len()), tiles }.draw()
}

fn tile(number: usize, candidate: &Candidate, Picture { film, effect, .. }: &Picture) -> Tile {
    let caption = match effect {
        Effect::Shown => Vec::new(),
        Effect::Nothing => vec!["shows nothing".into()],
        Effect::SolidBlock => vec!["one solid block".into()],
    };
    let picture = Canvas::of(film.width, film.height, ToneMapping { exposure: 0.0 }.rgb8(film));
    Tile { title: format!("{number}: {}", candidate.name), picture, caption }
}

/// The histogram, with a line at each boundary in its color, and one at the background.
fn histogram(analysis: &Analysis) -> Tile {
    let counts: Vec<u64> = analysis.histogram.chunks(analysis.histogram.len() / BINS).map(|c| c.iter().sum()).collect();
    let [width, height] = HISTOGRAM;
    let mut picture = Histogram { counts, range: analysis.range }.draw(width, height);
    let [low, high] = analysis.range;
    let mut mark = |value: f64, color| {
        let place = ((value - low) / (high - low)).clamp(0.0, 1.0) * (width - 2) as f64;
        picture.fill([place.round() as usize, 20], [2, height - 44], color);
    };
    mark(analysis.background, BACKGROUND);
    for (Boundary { value, .. }, color) in analysis.boundaries.iter().zip(COLORS) {
        mark(*value, color);
    }
    let of = |(i, boundary): (usize, &Boundary)| format!("boundary {}: {}", i + 1, short(boundary.value));
    let caption = [format!("grey: background {}", short(analysis.background))].into_iter();
    let caption = caption.chain(analysis.boundaries.iter().enumerate().map(of)).collect();
    Tile { title: "histogram".into(), picture, caption }
}
