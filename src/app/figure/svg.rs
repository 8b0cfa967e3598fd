//! Figures as SVG: pictures embedded as PNG, texts as texts.

use super::drawing::{Anchor, Color, Drawing, Shape};
use super::font::FAMILIES;
use crate::error::Result;
use crate::formats::png;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use quick_xml::escape::escape;
use std::fmt::Write;

/// Millimetres of a point.
const MILLIMETRES: f64 = 25.4 / 72.0;

/// A number with at most three decimals.
fn short(value: f64) -> String {
    let text = format!("{value:.3}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".into() } else { text.into() }
}

fn hex([r, g, b]: Color) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

fn path(points: &[[f64; 2]]) -> String {
    points.iter().map(|[x, y]| format!("{},{}", short(*x), short(*y))).collect::<Vec<_>>().join(" ")
}

/// Text that XML can hold.
fn plain(text: &str) -> String {
    escape(text.replace(char::is_control, " ")).into_owned()
}

/// Writes a figure. `title` is its name for programs that read it aloud, and `metadata` the lines of where it comes
/// from.
///
/// # Errors
/// If a picture cannot be encoded.
pub(super) fn write(drawing: &Drawing, title: &str, metadata: &[String]) -> Result<Vec<u8>> {
    let [width, height] = drawing.size;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{}mm\" height=\"{}mm\" viewBox=\"0 0 {} {}\" \
         font-family=\"{FAMILIES}\">\n<title>{}</title>\n<metadata>\n",
        short(width * MILLIMETRES),
        short(height * MILLIMETRES),
        short(width),
        short(height),
        plain(title),
    );
    metadata.iter().for_each(|line| svg.extend([plain(line).as_str(), "\n"]));
    svg.push_str("</metadata>\n");
    if let Some(color) = drawing.background {
        let _ = writeln!(svg, "<rect width=\"100%\" height=\"100%\" fill=\"{}\"/>", hex(color));
    }
    for shape in &drawing.shapes {
        let element = match shape {
            Shape::Picture { raster, at, extent, name } => format!(
                "<image x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" preserveAspectRatio=\"none\" \
                 href=\"data:image/png;base64,{}\"><title>{}</title></image>",
                short(at[0]),
                short(at[1]),
                short(extent[0]),
                short(extent[1]),
                STANDARD.encode(png::encode_rgba8(raster.size, &raster.rgba, None, &[])?),
                plain(name),
            ),
            Shape::Area { outline, color } => {
                format!("<polygon points=\"{}\" fill=\"{}\"/>", path(outline), hex(*color))
            }
            Shape::Line { points, width, color } => format!(
                "<polyline points=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"{}\" stroke-linejoin=\"round\"/>",
                path(points),
                hex(*color),
                short(*width)
            ),
            Shape::Text { text, at, anchor, style } => {
                let anchor = match anchor {
                    Anchor::Start => "start",
                    Anchor::Middle => "middle",
                };
                let weight = if style.bold { " font-weight=\"bold\"" } else { "" };
                format!(
                    "<text x=\"{}\" y=\"{}\" font-size=\"{}\" text-anchor=\"{anchor}\"{weight} fill=\"{}\">{}</text>",
                    short(at[0]),
                    short(at[1]),
                    short(style.size),
                    hex(style.color),
                    plain(text),
                )
            }
        };
        svg.push_str(&element);
        svg.push('\n');
    }
    svg.push_str("</svg>\n");
    Ok(svg.into_bytes())
}
