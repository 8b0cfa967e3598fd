//! A figure as shapes in points of 1/72 inch, x to the right and y downwards from the top left corner.

use super::font::Font;

/// Position or extent in points.
pub(super) type Point = [f64; 2];
/// An sRGB color.
pub(super) type Color = [u8; 3];

pub(super) const BLACK: Color = [0; 3];
pub(super) const WHITE: Color = [255; 3];

/// A picture of 8-bit sRGB pixels with straight alpha, row by row from the top left.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Raster {
    /// Width and height in pixels.
    pub size: [usize; 2],
    /// Samples `rgba[4 * (y * width + x) + channel]`.
    pub rgba: Vec<u8>,
}

impl Raster {
    /// True if no pixel lets anything through.
    pub(super) fn opaque(&self) -> bool {
        self.rgba.chunks_exact(4).all(|pixel| pixel[3] == 255)
    }

    /// Returns the colors without alpha, and the alphas.
    pub(super) fn parted(&self) -> (Vec<u8>, Vec<u8>) {
        let pixels = || self.rgba.chunks_exact(4);
        (pixels().flat_map(|p| [p[0], p[1], p[2]]).collect(), pixels().map(|p| p[3]).collect())
    }
}

/// Part of a text that lies at its position.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Anchor {
    Start,
    Middle,
}

/// Width of bold letters over that of regular ones.
const BOLD: f64 = 1.12;

/// Font size, weight and color of a text.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Style {
    /// Font size in points.
    pub size: f64,
    pub bold: bool,
    pub color: Color,
}

/// A shape of a figure.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Shape {
    /// A picture that fills a rectangle.
    Picture { raster: Raster, at: Point, extent: Point, name: String },
    /// A filled polygon.
    Area { outline: Vec<Point>, color: Color },
    /// A line through points.
    Line { points: Vec<Point>, width: f64, color: Color },
    /// A text on one line; the position is on its baseline.
    Text { text: String, at: Point, anchor: Anchor, style: Style },
}

/// A figure.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Drawing {
    /// Width and height in points.
    pub size: Point,
    /// Color behind all; none for nothing.
    pub background: Option<Color>,
    /// Shapes, from the back to the front.
    pub shapes: Vec<Shape>,
}

impl Drawing {
    /// Adds a filled rectangle.
    pub(super) fn rectangle(&mut self, [x, y]: Point, [w, h]: Point, color: Color) {
        let outline = vec![[x, y], [x + w, y], [x + w, y + h], [x, y + h]];
        self.area(outline, color);
    }

    /// Adds a filled polygon.
    pub(super) fn area(&mut self, outline: Vec<Point>, color: Color) {
        self.shapes.push(Shape::Area { outline, color });
    }

    /// Adds a line.
    pub(super) fn line(&mut self, points: Vec<Point>, width: f64, color: Color) {
        self.shapes.push(Shape::Line { points, width, color });
    }

    /// Adds a text that is no wider than `room`: in smaller letters where it would be.
    pub(super) fn text_within(&mut self, text: &str, at: Point, anchor: Anchor, style: Style, room: f64) {
        let width = Font::new().map_or(0.0, |font| font.width(text, style.size)) * if style.bold { BOLD } else { 1.0 };
        let size = if width > room { style.size * (room / width).max(0.0) } else { style.size };
        self.text(text, at, anchor, Style { size, ..style });
    }

    /// Adds a text.
    pub(super) fn text(&mut self, text: impl Into<String>, at: Point, anchor: Anchor, style: Style) {
        self.shapes.push(Shape::Text { text: text.into(), at, anchor, style });
    }

    /// Texts of the figure.
    pub(super) fn texts(&self) -> impl Iterator<Item = &str> {
        self.shapes.iter().filter_map(|shape| match shape {
            Shape::Text { text, .. } => Some(text.as_str()),
            _ => None,
        })
    }
}
