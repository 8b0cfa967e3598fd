//! Figures as PDF: one page of the figure's size, with the font embedded.

use super::drawing::{Anchor, Color, Drawing, Point, Raster, Shape, Style};
use super::font::{BYTES, Font};
use super::raster::{BOLD, share};
use crate::app::provenance::SETTINGS;
use crate::error::{Error, Result};
use flate2::Compression;
use flate2::write::ZlibEncoder;
use pdf_writer::types::{CidFontType, FontFlags, LineJoinStyle, SystemInfo, TextRenderingMode, UnicodeCmap};
use pdf_writer::{Content, Filter, Finish, Name, Pdf, Rect, Ref, Str, TextStr};
use std::collections::BTreeMap;
use std::io::Write;

/// Name of the font in the file; the prefix says that it holds some of the letters.
const FONT_NAME: Name<'static> = Name(b"CUMULO+DejaVuSans");
const SYSTEM: SystemInfo<'static> = SystemInfo { registry: Str(b"Adobe"), ordering: Str(b"Identity"), supplement: 0 };

/// Numbers of the objects of a file; those of pictures and their masks follow.
struct Numbers {
    catalog: Ref,
    pages: Ref,
    page: Ref,
    content: Ref,
    info: Ref,
    font: Ref,
    cid_font: Ref,
    descriptor: Ref,
    program: Ref,
    characters: Ref,
}

impl Numbers {
    fn new() -> Self {
        let [catalog, pages, page, content, info, font, cid_font, descriptor, program, characters] =
            std::array::from_fn(|i| Ref::new(i as i32 + 1));
        Self { catalog, pages, page, content, info, font, cid_font, descriptor, program, characters }
    }

    /// Numbers of a picture and its mask.
    fn picture(index: usize) -> [Ref; 2] {
        [0, 1].map(|i| Ref::new(11 + 2 * index as i32 + i))
    }
}

fn deflated(bytes: &[u8]) -> Result<Vec<u8>> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(bytes).and_then(|()| encoder.finish()).map_err(Error::system)
}

/// Writes a figure. `metadata` are the lines of where it comes from.
///
/// # Errors
/// If the content cannot be compressed.
pub(super) fn write(drawing: &Drawing, font: &Font, title: &str, metadata: &[String]) -> Result<Vec<u8>> {
    let numbers = Numbers::new();
    let mut pdf = Pdf::new();
    pdf.catalog(numbers.catalog).pages(numbers.pages);
    pdf.pages(numbers.pages).kids([numbers.page]).count(1);
    let [width, height] = drawing.size.map(|side| side as f32);
    let pictures: Vec<&Raster> = drawing.shapes.iter().filter_map(raster).collect();
    let mut page = pdf.page(numbers.page);
    page.media_box(Rect::new(0.0, 0.0, width, height));
    page.parent(numbers.pages);
    page.contents(numbers.content);
    let mut resources = page.resources();
    resources.fonts().pair(Name(b"F"), numbers.font);
    let mut objects = resources.x_objects();
    for index in 0..pictures.len() {
        objects.pair(Name(picture_name(index).as_bytes()), Numbers::picture(index)[0]);
    }
    objects.finish();
    resources.finish();
    page.finish();
    let content = deflated(&content(drawing, font))?;
    pdf.stream(numbers.content, &content).filter(Filter::FlateDecode);
    for (index, picture) in pictures.iter().enumerate() {
        embed(&mut pdf, picture, Numbers::picture(index))?;
    }
    embed_font(&mut pdf, font, &numbers, drawing)?;
    let mut info = pdf.document_info(numbers.info);
    info.title(TextStr(title));
    info.creator(TextStr(concat!("cumulo ", env!("CARGO_PKG_VERSION"))));
    // Texts of printable ASCII alone stand in the file as they are, where an earlier figure's settings are looked for.
    let (settings, others): (Vec<&String>, Vec<&String>) = metadata.iter().partition(|line| line.starts_with(SETTINGS));
    for line in settings {
        info.keywords(TextStr(line));
    }
    info.subject(TextStr(&others.into_iter().map(String::as_str).collect::<Vec<_>>().join("; ")));
    info.finish();
    Ok(pdf.finish())
}

fn raster(shape: &Shape) -> Option<&Raster> {
    match shape {
        Shape::Picture { raster, .. } => Some(raster),
        _ => None,
    }
}

fn picture_name(index: usize) -> String {
    format!("P{index}")
}

/// Writes a picture, with its alpha as a mask where it has one.
fn embed(pdf: &mut Pdf, raster: &Raster, [number, mask]: [Ref; 2]) -> Result<()> {
    let (colors, alphas) = raster.parted();
    let sides = raster.size.map(|side| side as i32);
    let bytes = deflated(&colors)?;
    let mut image = pdf.image_xobject(number, &bytes);
    image.filter(Filter::FlateDecode);
    image.width(sides[0]).height(sides[1]).bits_per_component(8);
    image.color_space().device_rgb();
    if raster.opaque() {
        return Ok(());
    }
    image.s_mask(mask);
    image.finish();
    let bytes = deflated(&alphas)?;
    let mut image = pdf.image_xobject(mask, &bytes);
    image.filter(Filter::FlateDecode);
    image.width(sides[0]).height(sides[1]).bits_per_component(8);
    image.color_space().device_gray();
    Ok(())
}

/// Embeds the font, with the characters of the glyphs that are used.
fn embed_font(pdf: &mut Pdf, font: &Font, numbers: &Numbers, drawing: &Drawing) -> Result<()> {
    let used: BTreeMap<u16, char> = drawing.texts().flat_map(str::chars).map(|c| (font.glyph(c).0, c)).collect();
    let units = |value: i16| (1000.0 * f64::from(value) / font.units()) as f32;
    pdf.type0_font(numbers.font)
        .base_font(FONT_NAME)
        .encoding_predefined(Name(b"Identity-H"))
        .descendant_font(numbers.cid_font)
        .to_unicode(numbers.characters);
    let mut cid = pdf.cid_font(numbers.cid_font);
    cid.subtype(CidFontType::Type2).base_font(FONT_NAME).system_info(SYSTEM).font_descriptor(numbers.descriptor);
    cid.cid_to_gid_map_predefined(Name(b"Identity"));
    let mut widths = cid.widths();
    for glyph in used.keys() {
        widths.consecutive(*glyph, [(1000.0 * font.advance(ttf_parser::GlyphId(*glyph))) as f32]);
    }
    widths.finish();
    cid.finish();
    let face = font.face();
    let bounds = face.global_bounding_box();
    pdf.font_descriptor(numbers.descriptor)
        .name(FONT_NAME)
        .flags(FontFlags::SYMBOLIC)
        .bbox(Rect::new(units(bounds.x_min), units(bounds.y_min), units(bounds.x_max), units(bounds.y_max)))
        .italic_angle(0.0)
        .ascent(units(face.ascender()))
        .descent(units(face.descender()))
        .cap_height(units(face.capital_height().unwrap_or_else(|| face.ascender())))
        .stem_v(80.0)
        .font_file2(numbers.program);
    let program = deflated(BYTES)?;
    let mut stream = pdf.stream(numbers.program, &program);
    stream.filter(Filter::FlateDecode).pair(Name(b"Length1"), BYTES.len() as i32);
    stream.finish();
    let mut map = UnicodeCmap::<u16>::new(Name(b"Characters"), SYSTEM);
    used.iter().for_each(|(glyph, character)| map.pair(*glyph, *character));
    let map = map.finish();
    pdf.cmap(numbers.characters, map.as_slice()).system_info(SYSTEM).name(Name(b"Characters"));
    Ok(())
}

/// Draws the shapes; y runs upwards in PDF.
fn content(drawing: &Drawing, font: &Font) -> Vec<u8> {
    let height = drawing.size[1];
    let place = |[x, y]: Point| [x as f32, (height - y) as f32];
    let mut content = Content::new();
    if let Some(color) = drawing.background {
        fill_color(&mut content, color);
        content.rect(0.0, 0.0, drawing.size[0] as f32, height as f32).fill_nonzero();
    }
    let mut pictures = 0;
    for shape in &drawing.shapes {
        match shape {
            Shape::Picture { at, extent, .. } => {
                let [x, y] = place([at[0], at[1] + extent[1]]);
                let [w, h] = extent.map(|side| side as f32);
                content.save_state().transform([w, 0.0, 0.0, h, x, y]);
                content.x_object(Name(picture_name(pictures).as_bytes())).restore_state();
                pictures += 1;
            }
            Shape::Area { outline, color } => {
                fill_color(&mut content, *color);
                line(&mut content, outline, &place);
                content.close_path().fill_nonzero();
            }
            Shape::Line { points, width, color } => {
                stroke_color(&mut content, *color);
                content.set_line_width(*width as f32).set_line_join(LineJoinStyle::RoundJoin);
                line(&mut content, points, &place);
                content.stroke();
            }
            Shape::Text { text, at, anchor, style } => {
                write_text(&mut content, font, text, place(*at), (*anchor, *style))
            }
        }
    }
    content.finish().to_vec()
}

fn line(content: &mut Content, points: &[Point], place: &dyn Fn(Point) -> [f32; 2]) {
    for (i, point) in points.iter().enumerate() {
        let [x, y] = place(*point);
        if i == 0 {
            content.move_to(x, y)
        } else {
            content.line_to(x, y)
        };
    }
}

fn write_text(content: &mut Content, font: &Font, text: &str, [x, y]: [f32; 2], (anchor, style): (Anchor, Style)) {
    let x = x - (share(anchor) * font.width(text, style.size)) as f32;
    let glyphs: Vec<u8> = text.chars().flat_map(|c| font.glyph(c).0.to_be_bytes()).collect();
    fill_color(content, style.color);
    content.begin_text().set_font(Name(b"F"), style.size as f32);
    if style.bold {
        stroke_color(content, style.color);
        content.set_line_width((BOLD * style.size) as f32).set_line_join(LineJoinStyle::RoundJoin);
        content.set_text_rendering_mode(TextRenderingMode::FillStroke);
    } else {
        content.set_text_rendering_mode(TextRenderingMode::Fill);
    }
    content.set_text_matrix([1.0, 0.0, 0.0, 1.0, x, y]).show(Str(&glyphs)).end_text();
}

fn fill_color(content: &mut Content, color: Color) {
    let [r, g, b] = color.map(|v| f32::from(v) / 255.0);
    content.set_fill_rgb(r, g, b);
}

fn stroke_color(content: &mut Content, color: Color) {
    let [r, g, b] = color.map(|v| f32::from(v) / 255.0);
    content.set_stroke_rgb(r, g, b);
}
