//! The legend of a function of labels: the color of each class beside its name.

use super::drawing::{Anchor, Color, Drawing, Point, Style};
use crate::error::{Error, Result};
use crate::formats::png::ToneMapping;
use crate::scene::film::Film;
use crate::scene::transfer::Class;

/// Most classes of a legend.
const MOST: usize = 60;
/// Least width of a column, height of a row, and side of a color, in font sizes.
const COLUMN: f64 = 9.0;
const ROW: f64 = 1.4;
const SIDE: f64 = 0.9;

/// Colors and names of classes, in the order of their labels.
pub(super) struct Swatches(Vec<(Color, String)>);

impl Swatches {
    /// Makes the legend of the classes that are not clear.
    ///
    /// # Errors
    /// If there are none, or too many.
    pub(super) fn new(classes: &[Class], tone: ToneMapping) -> Result<Self> {
        let shown: Vec<&Class> = classes.iter().filter(|class| class.rgbs[3] > 0.0).collect();
        if !(1..=MOST).contains(&shown.len()) {
            let error = format!("the function shows {} labels: a legend has 1 to {MOST}", shown.len());
            return Err(Error::invalid(error)
                .hint("give the function of the classes that matter, or the ⟨camera⟩ of pictures with fewer"));
        }
        let rgba = shown.iter().map(|class| [class.rgbs[0], class.rgbs[1], class.rgbs[2], 1.0].map(|v| v as f32));
        let film = Film::of(shown.len(), 1, rgba.collect());
        let colors = tone.rgb8(&film);
        let name = |class: &Class| if class.name.is_empty() { class.label.to_string() } else { class.name.clone() };
        let swatch = |(class, color): (&&Class, &[u8])| ([color[0], color[1], color[2]], name(class));
        Ok(Self(shown.iter().zip(colors.chunks_exact(3)).map(swatch).collect()))
    }

    /// Returns columns and rows within a width in points, at a font size in points.
    fn grid(&self, size: f64, width: f64) -> [usize; 2] {
        let columns = ((width / (COLUMN * size)) as usize).clamp(1, self.0.len());
        [columns, self.0.len().div_ceil(columns)]
    }

    /// Height in points within a width.
    pub(super) fn height(&self, size: f64, width: f64) -> f64 {
        self.grid(size, width)[1] as f64 * ROW * size
    }

    /// Draws the classes at a position, column by column.
    pub(super) fn draw(&self, drawing: &mut Drawing, [x, y]: Point, width: f64, size: f64, ink: Color) {
        let [columns, rows] = self.grid(size, width);
        let (column, side) = (width / columns as f64, SIDE * size);
        for (i, (color, name)) in self.0.iter().enumerate() {
            let at = [x + (i / rows) as f64 * column, y + (i % rows) as f64 * ROW * size];
            drawing.rectangle(at, [side, side], *color);
            let style = Style { size, bold: false, color: ink };
            let place = [at[0] + 1.3 * size, at[1] + 0.8 * size];
            drawing.text_within(name, place, Anchor::Start, style, column - 1.8 * size);
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
        let swatches = Swatches::new(&[class(2, 1.0), class(5, 0.0), liver], tone).unwrap();
        let mut drawing = Drawing { size: [200.0, 100.0], background: None, shapes: Vec::new() };
        swatches.draw(&mut drawing, [10.0, 20.0], 150.0, 10.0, [0; 3]);
        assert_eq!(drawing.texts().collect::<Vec<_>>(), ["2", "liver"]);
        assert_eq!((swatches.0[0].0, swatches.height(10.0, 150.0)), ([255, 0, 0], 28.0));
        assert_eq!(swatches.height(10.0, 300.0), 14.0);
        let many: Vec<Class> = (1..100).map(|label| class(label, 1.0)).collect();
        assert!(Swatches::new(&many, tone).is_err() && Swatches::new(&[class(1, 0.0)], tone).is_err());
    }
}
