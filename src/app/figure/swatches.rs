//! The legend of a function of labels: the color of each class beside its name.

use super::drawing::{Anchor, Color, Drawing, Point, Style};
use super::font::Font;
use crate::error::{Error, Result};
use crate::formats::png::ToneMapping;
use crate::scene::film::Film;
use crate::scene::transfer::Class;

/// Most classes of a legend.
const MOST: usize = 60;
/// Height of a row, side of a color, place of the name behind its left edge, and room behind the widest name, in font
/// sizes.
const ROW: f64 = 1.4;
const SIDE: f64 = 0.9;
const INDENT: f64 = 1.3;
const GAP: f64 = 1.5;
/// Height of the caption in font sizes.
const CAPTION: f64 = 1.5;

/// Colors and names of classes, in the order of their labels.
pub(super) struct Swatches {
    classes: Vec<(Color, String)>,
    /// Width of the widest name at a font size of 1.
    widest: f64,
    /// Text below the classes.
    caption: Option<String>,
    /// First and last label.
    pub range: [f64; 2],
    /// Largest extinction per world unit.
    pub peak: f64,
}

impl Swatches {
    /// Makes the legend of the classes that are not clear.
    ///
    /// # Errors
    /// If there are none, or too many.
    pub(super) fn new(classes: &[Class], tone: ToneMapping, caption: Option<String>) -> Result<Self> {
        let shown: Vec<&Class> = classes.iter().filter(|class| class.rgbs[3] > 0.0).collect();
        let ([first, .., last] | [first @ last]) = &shown[..] else {
            return Err(Error::invalid("the function shows no labels").hint("give some of them an extinction"));
        };
        if shown.len() > MOST {
            let error = format!("the function shows {} labels, and a legend has {MOST} at most", shown.len());
            return Err(Error::invalid(error)
                .hint("give the function of the classes that matter, or the ⟨camera⟩ of pictures with fewer"));
        }
        let range = [first, last].map(|class| class.label.into());
        let rgba = shown.iter().map(|class| [class.rgbs[0], class.rgbs[1], class.rgbs[2], 1.0].map(|v| v as f32));
        let colors = tone.rgb8(&Film::of(shown.len(), 1, rgba.collect()));
        let name = |class: &Class| if class.name.is_empty() { class.label.to_string() } else { class.name.clone() };
        let swatch = |(class, color): (&&Class, &[u8])| ([color[0], color[1], color[2]], name(class));
        let classes: Vec<(Color, String)> = shown.iter().zip(colors.chunks_exact(3)).map(swatch).collect();
        let font = Font::new()?;
        let widest = classes.iter().map(|(_, name)| font.width(name, 1.0)).fold(0.0, f64::max);
        let peak = shown.iter().map(|class| class.rgbs[3]).fold(0.0, f64::max);
        Ok(Self { classes, widest, caption, range, peak })
    }

    /// Number of the classes.
    pub(super) fn len(&self) -> usize {
        self.classes.len()
    }

    /// Returns columns and rows within a width in points, at a font size in points.
    fn grid(&self, size: f64, width: f64) -> [usize; 2] {
        let column = (INDENT + self.widest + GAP) * size;
        let columns = ((width / column) as usize).clamp(1, self.len());
        [columns, self.len().div_ceil(columns)]
    }

    /// Height in points within a width.
    pub(super) fn height(&self, size: f64, width: f64) -> f64 {
        let caption = if self.caption.is_some() { CAPTION } else { 0.0 };
        (self.grid(size, width)[1] as f64 * ROW + caption) * size
    }

    /// Draws the classes at a position, column by column in the middle of a width.
    pub(super) fn draw(&self, drawing: &mut Drawing, [x, y]: Point, width: f64, size: f64, ink: Color) {
        let [columns, rows] = self.grid(size, width);
        let style = Style { size, bold: false, color: ink };
        let column = ((INDENT + self.widest + GAP) * size).min(width / columns as f64);
        let left = x + 0.5 * (width - column * self.len().div_ceil(rows) as f64 + GAP * size).max(0.0);
        for (i, (color, name)) in self.classes.iter().enumerate() {
            let at = [left + (i / rows) as f64 * column, y + (i % rows) as f64 * ROW * size];
            drawing.rectangle(at, [SIDE * size; 2], *color);
            let place = [at[0] + INDENT * size, at[1] + 0.8 * size];
            drawing.text_within(name, place, Anchor::Start, style, column - INDENT * size);
        }
        if let Some(text) = &self.caption {
            let below = y + (rows as f64 * ROW + 0.7 * CAPTION) * size;
            drawing.text_within(text, [x + 0.5 * width, below], Anchor::Middle, style, width);
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    #[test]
    fn classes_have_their_colors_and_names() {
        let class =
            |label: i32, extinction: f64| Class { label, name: String::new(), rgbs: [1.0, 0.0, 0.0, extinction] };
        let tone = ToneMapping { exposure: 0.0 };
        let liver = Class { name: "liver".into(), ..class(9, 2.0) };
        let swatches = Swatches::new(&[class(2, 1.0), class(5, 0.0), liver], tone, Some("organs".into())).unwrap();
        let mut drawing = Drawing { size: [200.0, 100.0], background: None, shapes: Vec::new() };
        swatches.draw(&mut drawing, [10.0, 20.0], 150.0, 10.0, [0; 3]);
        assert_eq!(drawing.texts().collect::<Vec<_>>(), ["2", "liver", "organs"]);
        assert_eq!((swatches.classes[0].0, swatches.range, swatches.peak), ([255, 0, 0], [2.0, 9.0], 2.0));
        // In two columns, and in one.
        assert_eq!([150.0, 60.0].map(|width| swatches.height(10.0, width)), [29.0, 43.0]);
        let many: Vec<Class> = (1..100).map(|label| class(label, 1.0)).collect();
        let refused = |classes: &[Class]| Swatches::new(classes, tone, None).is_err();
        assert!(refused(&many) && refused(&[class(1, 0.0)]) && !refused(&many[..1]));
    }
}
