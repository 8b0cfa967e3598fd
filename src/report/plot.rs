//! Line plots as SVG in the page.

use super::number;
use crate::error::{Error, Result};
use maud::{Markup, PreEscaped, html};
use plotters::prelude::*;
use std::fmt::Write;
use std::ops::Range;

/// A plot's width and height, and its labels along x; the page scales it to its own width.
pub(super) struct Canvas {
    pub(super) size: (u32, u32),
    pub(super) labels: usize,
}

/// Canvas of windows as wide as a screen, and that of narrow ones, where text of the other would be too small to read.
pub(super) const WIDE: Canvas = Canvas { size: (900, 380), labels: 10 };
pub(super) const NARROW: Canvas = Canvas { size: (400, 320), labels: 5 };

/// Length of a dash of a dashed line, and of the gap behind it, in the units of the drawing.
pub(super) const DASH: (u32, u32) = (7, 5);

/// Colors of text and axes (`INK`) and of grid lines (`GRID`), on a light page and on a dark one.
pub(super) const INK: (RGBColor, &str) = (RGBColor(0x1B, 0x1E, 0x23), "#e6e8eb");
pub(super) const GRID: (RGBColor, &str) = (RGBColor(0xD9, 0xDC, 0xE1), "#3a3f47");

/// Colors of the series, on a light page and on a dark one. Each has a contrast of at least 3:1 against its page, and
/// neighbours differ in lightness too.
pub(crate) const PALETTE: [(RGBColor, &str); 8] = [
    (RGBColor(0x1F, 0x5F, 0xBF), "#7db2ff"),
    (RGBColor(0xC2, 0x55, 0x00), "#ffa45c"),
    (RGBColor(0x0B, 0x7A, 0x5E), "#4fd0a8"),
    (RGBColor(0xA0, 0x2B, 0x8C), "#f08be0"),
    (RGBColor(0x5B, 0x4B, 0xB5), "#b3a6ff"),
    (RGBColor(0x8A, 0x6A, 0x00), "#e0c050"),
    (RGBColor(0xB8, 0x1E, 0x3C), "#ff8296"),
    (RGBColor(0x3F, 0x6B, 0x7A), "#93c4d4"),
];

/// Color of text and lines in drawings of other modules; a dark page replaces it.
pub(crate) const INK_RGB: RGBColor = INK.0;

/// Largest absolute coordinate that is drawn. An axis spans at least [`LEAST_SPAN`] and [`LEAST_SHARE`] of its largest
/// coordinate. Beyond these limits plotters searches for ticks without end.
const FARTHEST: f64 = 1e12;
const LEAST_SPAN: f64 = 1e-9;
const LEAST_SHARE: f64 = 1e-6;

/// A line of a plot.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Name of the line in the legend.
    pub label: String,
    /// Points of the line, in the order in which they are joined. Points that are not finite or exceed 1e12 are left
    /// out.
    pub points: Vec<(f64, f64)>,
    /// True for a dashed line, such as that of a reference.
    pub dashed: bool,
}

/// A plot of lines over a common pair of axes.
#[derive(Debug, Clone, PartialEq)]
pub struct Plot {
    /// Label of the horizontal axis, with its unit.
    pub x: String,
    /// Label of the vertical axis, with its unit.
    pub y: String,
    /// Lines of the plot.
    pub series: Vec<Series>,
}

impl Plot {
    /// Plot of the PSNR of held-out views (dB) over time.
    /// `steps` are triples of seconds since the start, PSNR if it was measured, and level, in order. Each level is a
    /// separate line that begins where the previous one ended.
    pub fn convergence(steps: impl IntoIterator<Item = (f64, Option<f64>, u32)>) -> Self {
        let mut series: Vec<Series> = Vec::new();
        let mut last = None;
        for (seconds, psnr, level) in steps {
            let Some(psnr) = psnr.filter(|p| p.is_finite()) else { continue };
            match (series.last_mut(), last) {
                (Some(line), Some((before, _))) if before == level => line.points.push((seconds, psnr)),
                (_, last) => series.push(Series {
                    label: if level == 0 { "finest level".into() } else { format!("level {level}") },
                    points: last.map(|(_, point)| point).into_iter().chain([(seconds, psnr)]).collect(),
                    dashed: false,
                }),
            }
            last = Some((level, (seconds, psnr)));
        }
        Self { x: "seconds".into(), y: "PSNR of held-out views (dB)".into(), series }
    }

    /// Markup of the plot with its legend, which says where each line ends.
    pub(super) fn draw(&self) -> Result<Markup> {
        self.draw_with(true)
    }

    /// Markup of the plot with its legend; `ends` adds to the legend where each line ends.
    pub(super) fn draw_with(&self, ends: bool) -> Result<Markup> {
        let drawn = |p: &&(f64, f64)| p.0.abs() <= FARTHEST && p.1.abs() <= FARTHEST;
        let lines: Vec<Vec<(f64, f64)>> =
            self.series.iter().map(|s| s.points.iter().filter(drawn).copied().collect()).collect();
        let Some((x, y)) = ranges(lines.iter().flatten()) else {
            return Ok(html! { p { "There are no points to plot." } });
        };
        let svg = |canvas: &Canvas| {
            let mut svg = String::new();
            self.paint(&lines, (x.clone(), y.clone()), canvas, &mut svg)
                .map_err(|e| Error::invalid(format!("the plot of {} cannot be drawn: {e}", self.y)))?;
            // SVG files need the namespace, HTML does not; the page is to hold no address at all.
            Ok::<_, Error>(svg.replacen(" xmlns=\"http://www.w3.org/2000/svg\"", "", 1))
        };
        let label = format!("{} over {}", self.y, self.x);
        let canvases = [("wide-only", svg(&WIDE)?), ("narrow-only", svg(&NARROW)?)];
        let last = |i: usize| lines[i].last().map(|p| number::short(p.1));
        Ok(html! {
            figure.plot {
                @for (class, svg) in canvases {
                    div class=(class) role="img" aria-label=(label) { (PreEscaped(svg)) }
                }
                figcaption {
                    @for (i, series) in self.series.iter().enumerate() {
                        @if let Some(last) = last(i) {
                            span.key {
                                span class={ "swatch c" (i % PALETTE.len()) @if series.dashed { " dashed" } } {}
                                (series.label)
                                @if ends { " " span.caption { "ends at " (last) } }
                            }
                        }
                    }
                }
            }
        })
    }

    fn paint(
        &self,
        lines: &[Vec<(f64, f64)>],
        (x, y): (Range<f64>, Range<f64>),
        canvas: &Canvas,
        svg: &mut String,
    ) -> std::result::Result<(), Box<dyn std::error::Error>> {
        let area = SVGBackend::with_string(svg, canvas.size).into_drawing_area();
        let mut chart = ChartBuilder::on(&area)
            .margin(12)
            .margin_right(24)
            .x_label_area_size(46)
            .y_label_area_size(64)
            .build_cartesian_2d(x, y)?;
        let text = ("sans-serif", 14).into_font().color(&INK.0);
        chart
            .configure_mesh()
            .x_labels(canvas.labels)
            .x_desc(&self.x)
            .y_desc(&self.y)
            .label_style(text.clone())
            .axis_desc_style(text)
            .axis_style(INK.0)
            .bold_line_style(GRID.0)
            .light_line_style(TRANSPARENT)
            .draw()?;
        for (i, line) in lines.iter().enumerate() {
            let color = PALETTE[i % PALETTE.len()].0;
            if self.series[i].dashed {
                let (dash, gap) = DASH;
                let style = color.stroke_width(2);
                chart.draw_series(DashedLineSeries::new(line.iter().copied(), dash, gap, style))?;
                continue;
            }
            chart.draw_series(LineSeries::new(line.iter().copied(), color.stroke_width(2)))?;
            // A level of one step has no line, and few points should be visible as such.
            if line.len() <= 60 {
                chart.draw_series(line.iter().map(|p| Circle::new(*p, 3, color.filled())))?;
            }
        }
        area.present()?;
        Ok(())
    }
}

/// Ranges of both axes with a margin; `None` if there are no points.
fn ranges<'a>(points: impl Iterator<Item = &'a (f64, f64)>) -> Option<(Range<f64>, Range<f64>)> {
    let mut all: Option<[f64; 4]> = None;
    for (x, y) in points {
        let [a, b, c, d] = all.unwrap_or([*x, *x, *y, *y]);
        all = Some([a.min(*x), b.max(*x), c.min(*y), d.max(*y)]);
    }
    let [x0, x1, y0, y1] = all?;
    let widen = |low: f64, high: f64, share: f64| {
        let span = high - low;
        let least = LEAST_SPAN.max(LEAST_SHARE * low.abs().max(high.abs()));
        let room = match span {
            // A single value is centred in a range in which it reads well.
            0.0 if low == 0.0 => 0.5,
            0.0 => (0.5 * low.abs()).max(least),
            _ => (share * span).max(least),
        };
        low - room..high + room
    };
    // Times begin at 0; numbers of frames that lie far from it would leave the plot empty.
    let x = if x0 >= 0.0 && x0 <= 0.5 * x1 { 0.0..widen(0.0, x1, 0.02).end } else { widen(x0, x1, 0.02) };
    Some((x, widen(y0, y1, 0.06)))
}

/// Hexadecimal color as SVG has it, in the one spelling that the style sheet of a dark page matches.
pub(crate) fn hex(c: RGBColor) -> String {
    format!("#{:02X}{:02X}{:02X}", c.0, c.1, c.2)
}

/// Style sheet of the colors. Plots carry the colors of a light page; a dark page replaces them.
pub(crate) fn style() -> String {
    let mut css = String::new();
    let mut dark = String::new();
    for (i, (light, other)) in PALETTE.iter().enumerate() {
        let _ = write!(css, ".c{i}{{background:{}}}", hex(*light));
        let _ = write!(dark, ".c{i}{{background:{other}}}");
    }
    for (light, other) in PALETTE.iter().chain([&INK, &GRID]) {
        let light = hex(*light);
        let _ = write!(dark, ".plot [fill=\"{light}\"]{{fill:{other}}}.plot [stroke=\"{light}\"]{{stroke:{other}}}");
    }
    format!("{css}@media screen and (prefers-color-scheme:dark){{{dark}}}")
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    /// A small value that does not change is not a line at zero.
    #[test]
    fn a_single_value_is_shown_in_its_own_range() {
        let range = |y: f64| ranges([(1.0, y), (2.0, y)].iter()).unwrap().1;
        assert_eq!((range(0.0), range(6e-4)), (-0.5..0.5, 3e-4..9e-4));
        assert_eq!((range(40.0), range(-2.0)), (20.0..60.0, -3.0..-1.0));
        let tiny = range(1e-300);
        assert!(tiny.end - tiny.start >= LEAST_SPAN, "{tiny:?}");
    }
}
