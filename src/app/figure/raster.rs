//! Figures as pixels.

use super::drawing::{Anchor, Color, Drawing, Point, Raster, Shape, Style};
use super::font::Font;
use crate::error::{Code, Error, Result};
use tiny_skia::{
    ColorU8, FillRule, FilterQuality, IntSize, LineCap, LineJoin, Paint, Path, PathBuilder, Pixmap, PixmapPaint,
    Stroke, Transform,
};
use ttf_parser::OutlineBuilder;

/// Width of the line around letters that makes them bold, in font sizes.
pub(super) const BOLD: f64 = 0.05;

/// Builds the path of a glyph at a position in pixels.
struct Glyph<'p> {
    path: &'p mut PathBuilder,
    at: Point,
    scale: f64,
}

impl Glyph<'_> {
    fn map(&self, x: f32, y: f32) -> (f32, f32) {
        let [ox, oy] = self.at;
        ((ox + self.scale * f64::from(x)) as f32, (oy - self.scale * f64::from(y)) as f32)
    }
}

impl OutlineBuilder for Glyph<'_> {
    fn move_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.map(x, y);
        self.path.move_to(x, y);
    }

    fn line_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.map(x, y);
        self.path.line_to(x, y);
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        let ((x1, y1), (x, y)) = (self.map(x1, y1), self.map(x, y));
        self.path.quad_to(x1, y1, x, y);
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        let ((x1, y1), (x2, y2), (x, y)) = (self.map(x1, y1), self.map(x2, y2), self.map(x, y));
        self.path.cubic_to(x1, y1, x2, y2, x, y);
    }

    fn close(&mut self) {
        self.path.close();
    }
}

/// Size of a figure in pixels.
pub(super) fn size(drawing: &Drawing, per_point: f64) -> [u32; 2] {
    drawing.size.map(|side| (side * per_point).round().clamp(1.0, f64::from(u32::MAX)) as u32)
}

/// Draws a figure with `per_point` pixels to a point.
///
/// # Errors
/// If the figure has more pixels than `max_memory` holds.
pub(super) fn draw(drawing: &Drawing, font: &Font, per_point: f64, max_memory: u64) -> Result<Raster> {
    let [width, height] = size(drawing, per_point);
    let fits = 8 * u64::from(width) * u64::from(height) <= max_memory && width.max(height) <= 65_536;
    let Some(mut pixmap) = fits.then(|| Pixmap::new(width, height)).flatten() else {
        return Err(Error::unsupported(format!("a figure of {width}x{height} pixels"))
            .coded(Code::MemoryLimit)
            .hint("give a smaller ⟨width⟩, or raise ⟨max_memory⟩"));
    };
    if let Some([r, g, b]) = drawing.background {
        pixmap.fill(tiny_skia::Color::from_rgba8(r, g, b, 255));
    }
    for shape in &drawing.shapes {
        match shape {
            Shape::Picture { raster, at, extent, .. } => picture(&mut pixmap, raster, (*at, *extent), per_point),
            Shape::Area { outline, color } => fill(&mut pixmap, polygon(outline, per_point, true), *color),
            Shape::Line { points, width, color } => {
                stroke(&mut pixmap, polygon(points, per_point, false), width * per_point, *color);
            }
            Shape::Text { text, at, anchor, style } => {
                let path = outline(font, text, (*at, *anchor), *style, per_point);
                if style.bold {
                    stroke(&mut pixmap, path.clone(), BOLD * style.size * per_point, style.color);
                }
                fill(&mut pixmap, path, style.color);
            }
        }
    }
    Ok(Raster { size: [width as usize, height as usize], rgba: pixmap.take_demultiplied() })
}

fn paint([r, g, b]: Color) -> Paint<'static> {
    let mut paint = Paint::default();
    paint.set_color_rgba8(r, g, b, 255);
    paint
}

fn fill(pixmap: &mut Pixmap, path: Option<Path>, color: Color) {
    if let Some(path) = path {
        pixmap.fill_path(&path, &paint(color), FillRule::Winding, Transform::identity(), None);
    }
}

fn stroke(pixmap: &mut Pixmap, path: Option<Path>, width: f64, color: Color) {
    let stroke =
        Stroke { width: width as f32, line_join: LineJoin::Round, line_cap: LineCap::Butt, ..Stroke::default() };
    if let Some(path) = path {
        pixmap.stroke_path(&path, &paint(color), &stroke, Transform::identity(), None);
    }
}

fn polygon(points: &[Point], per_point: f64, closed: bool) -> Option<Path> {
    let mut path = PathBuilder::new();
    for (i, point) in points.iter().enumerate() {
        let [x, y] = point.map(|v| (v * per_point) as f32);
        if i == 0 { path.move_to(x, y) } else { path.line_to(x, y) }
    }
    if closed {
        path.close();
    }
    path.finish()
}

fn outline(font: &Font, text: &str, (at, anchor): (Point, Anchor), style: Style, per_point: f64) -> Option<Path> {
    let size = style.size * per_point;
    let mut path = PathBuilder::new();
    let mut x = at[0] * per_point - share(anchor) * font.width(text, size);
    for glyph in text.chars().map(|c| font.glyph(c)) {
        let mut builder = Glyph { path: &mut path, at: [x, at[1] * per_point], scale: size / font.units() };
        font.face().outline_glyph(glyph, &mut builder);
        x += size * font.advance(glyph);
    }
    path.finish()
}

/// Share of a text's width that lies before its position.
pub(super) fn share(anchor: Anchor) -> f64 {
    match anchor {
        Anchor::Start => 0.0,
        Anchor::Middle => 0.5,
    }
}

/// Draws a picture on whole pixels: where it becomes smaller, by means over the area of a pixel.
fn picture(pixmap: &mut Pixmap, raster: &Raster, (at, extent): (Point, Point), per_point: f64) {
    let low = at.map(|v| (v * per_point).round());
    let high = [0, 1].map(|a| ((at[a] + extent[a]) * per_point).round());
    let target = [0, 1].map(|a| (high[a] - low[a]).max(1.0) as usize);
    let small = [0, 1].map(|a| raster.size[a].min(target[a]));
    let Some(source) = premultiplied(&reduced(raster, small)) else { return };
    let scale = [0, 1].map(|a| (target[a] as f64 / small[a] as f64) as f32);
    let transform = Transform::from_row(scale[0], 0.0, 0.0, scale[1], low[0] as f32, low[1] as f32);
    let quality = if small == target { FilterQuality::Nearest } else { FilterQuality::Bilinear };
    let paint = PixmapPaint { quality, ..PixmapPaint::default() };
    pixmap.draw_pixmap(0, 0, source.as_ref(), &paint, transform, None);
}

fn premultiplied(raster: &Raster) -> Option<Pixmap> {
    let pixels = raster.rgba.chunks_exact(4).map(|p| ColorU8::from_rgba(p[0], p[1], p[2], p[3]).premultiply());
    let bytes = pixels.flat_map(|p| [p.red(), p.green(), p.blue(), p.alpha()]).collect();
    let [width, height] = raster.size.map(|side| side as u32);
    Pixmap::from_vec(bytes, IntSize::from_wh(width, height)?)
}

/// Returns a picture with fewer pixels, each the mean over the area that it stands for.
fn reduced(raster: &Raster, size: [usize; 2]) -> Raster {
    if raster.size == size {
        return raster.clone();
    }
    let spans = |axis: usize| {
        let (from, to) = (raster.size[axis], size[axis]);
        (0..to).map(move |i| i * from / to..((i + 1) * from).div_ceil(to)).collect::<Vec<_>>()
    };
    let columns = spans(0);
    let mut rgba = Vec::with_capacity(4 * size[0] * size[1]);
    for rows in spans(1) {
        for columns in &columns {
            let mut sum = [0_u64; 4];
            let count = (rows.len() * columns.len()) as u64;
            for pixel in rows.clone().flat_map(|y| columns.clone().map(move |x| y * raster.size[0] + x)) {
                let pixel = &raster.rgba[4 * pixel..4 * pixel + 4];
                let alpha = u64::from(pixel[3]);
                (0..3).for_each(|c| sum[c] += u64::from(pixel[c]) * alpha);
                sum[3] += alpha;
            }
            let alpha = sum[3].max(1);
            rgba.extend([0, 1, 2].map(|c| ((sum[c] + alpha / 2) / alpha) as u8));
            rgba.push(((sum[3] + count / 2) / count) as u8);
        }
    }
    Raster { size, rgba }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    fn pixel(raster: &Raster, x: usize, y: usize) -> [u8; 4] {
        raster.rgba[4 * (y * raster.size[0] + x)..][..4].try_into().unwrap()
    }

    #[test]
    fn shapes_are_where_they_belong() {
        let font = Font::new().unwrap();
        let mut drawing = Drawing { size: [20.0, 10.0], background: None, shapes: Vec::new() };
        let rgba = [[255, 0, 0, 255], [0, 0, 255, 255]].concat();
        let raster = Raster { size: [2, 1], rgba };
        drawing.shapes.push(Shape::Picture { raster, at: [2.0, 2.0], extent: [2.0, 1.0], name: String::new() });
        drawing.rectangle([10.0, 0.0], [5.0, 10.0], [1, 2, 3]);
        let style = Style { size: 10.0, bold: false, color: [9; 3] };
        drawing.text("I", [17.5, 9.0], Anchor::Middle, style);
        let out = draw(&drawing, &font, 1.0, 1 << 30).unwrap();
        assert_eq!(out.size, [20, 10]);
        assert_eq!([pixel(&out, 2, 2), pixel(&out, 3, 2)], [[255, 0, 0, 255], [0, 0, 255, 255]]);
        assert_eq!([pixel(&out, 12, 5), pixel(&out, 5, 5)], [[1, 2, 3, 255], [0; 4]]);
        assert!(pixel(&out, 17, 5)[3] > 100 && pixel(&out, 19, 5)[3] == 0, "{:?}", pixel(&out, 17, 5));
        assert!(draw(&drawing, &font, 1e4, 1 << 20).is_err());
    }

    #[test]
    fn smaller_pictures_are_means() {
        let raster =
            Raster { size: [4, 1], rgba: [[200, 0, 0, 255], [100, 0, 0, 255], [8, 8, 8, 0], [50, 0, 0, 255]].concat() };
        let half = reduced(&raster, [2, 1]);
        assert_eq!(half.rgba, [150, 0, 0, 255, 50, 0, 0, 128]);
    }
}
