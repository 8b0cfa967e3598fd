//! The legend of a function of densities: a bar of its colors over their range, with its extinction.

use super::drawing::{Anchor, Color, Drawing, Point, Raster, Shape, Style};
use super::ticks::{number, ticks};
use crate::error::{Error, Result};
use crate::formats::png::ToneMapping;
use crate::scene::film::Film;
use crate::scene::transfer::Transfer;

/// Colors along the bar.
const COLORS: usize = 512;
/// Number of ticks that is wished for.
const TICKS: usize = 5;

/// Colors and extinction over a range of densities.
pub(super) struct Bar {
    /// Densities at the ends of the bar.
    pub range: [f64; 2],
    /// Densities of the ticks.
    pub ticks: Vec<f64>,
    /// Largest extinction per world unit.
    pub peak: f64,
    colors: Raster,
    /// Extinctions relative to the largest one, evenly spaced from end to end.
    curve: Vec<f64>,
    /// Text below the ticks.
    caption: Option<String>,
    /// Text above the curve.
    extinction: String,
}

/// Heights of the parts in font sizes, from the top: text of the extinction, its curve, colors, ticks, numbers,
/// caption.
const PARTS: [f64; 6] = [1.1, 2.2, 1.1, 0.35, 1.2, 1.5];
/// Margin at both sides for the numbers at the ends, in font sizes.
const MARGIN: f64 = 2.2;

impl Bar {
    /// Makes the bar of a function. `caption` stands below it, and `length_unit` is a unit of world lengths.
    ///
    /// # Errors
    /// If the function has one density alone.
    pub(super) fn new(
        transfer: &Transfer,
        tone: ToneMapping,
        caption: Option<String>,
        length_unit: Option<&str>,
    ) -> Result<Self> {
        let table = transfer.table()?;
        let range = match transfer {
            Transfer::Texture { domain, .. }
            | Transfer::Gaussians { domain, .. }
            | Transfer::Identity { domain, .. } => *domain,
            Transfer::Piecewise { .. } | Transfer::Labels { .. } => {
                [0, table.knots().len() - 1].map(|i| table.knots().get(i).copied().unwrap_or_default())
            }
        };
        let span = range[1] - range[0];
        if span.is_nan() || span <= 0.0 {
            return Err(Error::invalid(format!("the transfer function has one density alone, {}", range[0]))
                .hint("give one with two points, or map it to a range with ⟨tf_range=LOW,HIGH⟩"));
        }
        let at = |share: f64| table.at(range[0] + share * span);
        let centres = (0..COLORS).map(|i| at((i as f64 + 0.5) / COLORS as f64));
        let film = Film::of(COLORS, 1, centres.map(|[r, g, b, _]| [r as f32, g as f32, b as f32, 1.0]).collect());
        let rgba = tone.rgb8(&film).chunks_exact(3).flat_map(|c| [c[0], c[1], c[2], 255]).collect();
        let extinctions: Vec<f64> = (0..=COLORS).map(|i| at(i as f64 / COLORS as f64)[3]).collect();
        let peak = extinctions.iter().copied().fold(0.0, f64::max);
        let curve = extinctions.iter().map(|v| if peak > 0.0 { v / peak } else { 0.0 }).collect();
        let per = length_unit.map_or(String::new(), |unit| format!(" per {unit}"));
        Ok(Self {
            range,
            ticks: ticks(range, TICKS),
            peak,
            colors: Raster { size: [COLORS, 1], rgba },
            curve,
            caption,
            extinction: format!("Extinction, up to {}{per}", number(peak)),
        })
    }

    /// Height in points at a font size in points.
    pub(super) fn height(&self, size: f64) -> f64 {
        let parts = if self.caption.is_some() { &PARTS[..] } else { &PARTS[..5] };
        size * parts.iter().sum::<f64>()
    }

    /// Draws the bar at a position, within a width.
    pub(super) fn draw(&self, drawing: &mut Drawing, [x, y]: Point, width: f64, size: f64, [ink, fill]: [Color; 2]) {
        let [text, curve, bar, tick, numbers, caption] = PARTS.map(|part| part * size);
        let (x, width) = (x + MARGIN * size, width - 2.0 * MARGIN * size);
        let thin = 0.06 * size;
        let small = Style { size: 0.85 * size, bold: false, color: ink };
        drawing.text_within(&self.extinction, [x, y + 0.7 * size], Anchor::Start, small, width);
        let foot = y + text + curve;
        let steps = (self.curve.len() - 1).max(1) as f64;
        let point = |(i, v): (usize, &f64)| [x + width * i as f64 / steps, foot - 0.95 * curve * v];
        let line: Vec<Point> = self.curve.iter().enumerate().map(point).collect();
        let area = [vec![[x, foot]], line.clone(), vec![[x + width, foot]]].concat();
        drawing.area(area, fill);
        drawing.line(line, 0.09 * size, ink);
        let (at, extent) = ([x, foot], [width, bar]);
        let name = "colors of the transfer function".to_owned();
        drawing.shapes.push(Shape::Picture { raster: self.colors.clone(), at, extent, name });
        let frame = vec![[x, foot], [x + width, foot], [x + width, foot + bar], [x, foot + bar], [x, foot]];
        drawing.line(frame, thin, ink);
        let below = foot + bar;
        let apart = self.ticks.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min);
        let between = 0.9 * width * apart / (self.range[1] - self.range[0]);
        for value in &self.ticks {
            let at = x + width * (value - self.range[0]) / (self.range[1] - self.range[0]);
            drawing.line(vec![[at, below], [at, below + tick]], thin, ink);
            let style = Style { size, bold: false, color: ink };
            let to_edge = MARGIN * size + (at - x).min(x + width - at);
            let room = between.min(2.0 * to_edge);
            drawing.text_within(&number(*value), [at, below + tick + 0.95 * size], Anchor::Middle, style, room);
        }
        if let Some(text) = &self.caption {
            let at = [x + 0.5 * width, below + tick + numbers + 0.7 * caption];
            let style = Style { size, bold: false, color: ink };
            drawing.text_within(text, at, Anchor::Middle, style, width + 2.0 * MARGIN * size);
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    #[test]
    fn colors_and_extinctions_are_those_of_the_function() {
        let points = vec![[-100.0, 0.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0, 4.0], [100.0, 1.0, 1.0, 1.0, 2.0]];
        let function = Transfer::Piecewise { points };
        let bar = Bar::new(&function, ToneMapping { exposure: 0.0 }, None, Some("mm")).unwrap();
        assert_eq!((bar.range, bar.peak), ([-100.0, 100.0], 4.0));
        assert_eq!(bar.ticks, [-100.0, -50.0, 0.0, 50.0, 100.0]);
        assert_eq!((bar.curve[0], bar.curve[COLORS / 2], bar.curve[COLORS]), (0.0, 1.0, 0.5));
        assert_eq!(bar.extinction, "Extinction, up to 4 per mm");
        let last = &bar.colors.rgba[4 * (COLORS - 1)..];
        assert!(last[0] == 255 && last[1] > 250 && last[3] == 255, "{last:?}");
        let single = Transfer::Piecewise { points: vec![[3.0, 1.0, 1.0, 1.0, 1.0]] };
        assert!(Bar::new(&single, ToneMapping { exposure: 0.0 }, None, None).is_err());
    }
}
