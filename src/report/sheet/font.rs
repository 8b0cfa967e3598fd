//! Text in pictures, by the bitmap fonts 8x13 and 10x20 of the X Window System (public domain).

use embedded_graphics::Drawable;
use embedded_graphics::Pixel;
use embedded_graphics::draw_target::DrawTarget;
use embedded_graphics::geometry::{Dimensions, Point, Size};
use embedded_graphics::mono_font::iso_8859_1::{FONT_8X13, FONT_10X20};
use embedded_graphics::mono_font::{MonoFont, MonoTextStyle};
use embedded_graphics::pixelcolor::BinaryColor;
use embedded_graphics::primitives::Rectangle;
use embedded_graphics::text::{Baseline, Text};
use std::convert::Infallible;

/// A monospaced font.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Font {
    /// Characters of 8 x 13 pixels.
    Small,
    /// Characters of 10 x 20 pixels.
    Large,
}

impl Font {
    /// Width of a character and height of a line in pixels.
    pub(crate) const fn size(self) -> [usize; 2] {
        match self {
            Self::Small => [8, 16],
            Self::Large => [10, 24],
        }
    }

    /// Number of characters that fit into a width in pixels; one at least.
    pub(crate) fn fitting(self, width: usize) -> usize {
        (width / self.size()[0]).max(1)
    }

    /// Width of a text in pixels.
    pub(crate) fn width(self, text: &str) -> usize {
        text.chars().count() * self.size()[0]
    }

    fn glyphs(self) -> &'static MonoFont<'static> {
        match self {
            Self::Small => &FONT_8X13,
            Self::Large => &FONT_10X20,
        }
    }
}

/// A target without limits, that calls a function with column and row of every pixel of a text.
struct Pixels<F>(F);

impl<F> Dimensions for Pixels<F> {
    fn bounding_box(&self) -> Rectangle {
        Rectangle::new(Point::zero(), Size::new_equal(1 << 20))
    }
}

impl<F: FnMut([usize; 2])> DrawTarget for Pixels<F> {
    type Color = BinaryColor;
    type Error = Infallible;

    fn draw_iter<I: IntoIterator<Item = Pixel<BinaryColor>>>(&mut self, pixels: I) -> Result<(), Infallible> {
        for Pixel(Point { x, y }, _) in pixels.into_iter().filter(|Pixel(_, color)| color.is_on()) {
            if let (Ok(x), Ok(y)) = (usize::try_from(x), usize::try_from(y)) {
                (self.0)([x, y]);
            }
        }
        Ok(())
    }
}

/// Calls `set` with column and row of every pixel of a text on one line. Characters that the font does not have become
/// `?`.
pub(super) fn draw(text: &str, font: Font, set: impl FnMut([usize; 2])) {
    // Line feeds would begin a new line.
    let text: String = text.chars().map(|c| if c.is_control() { '?' } else { c }).collect();
    let style = MonoTextStyle::new(font.glyphs(), BinaryColor::On);
    // A target that cannot fail has no error to pass on.
    let _ = Text::with_baseline(&text, Point::zero(), style, Baseline::Top).draw(&mut Pixels(set));
}

/// Breaks a text into lines of at most `most` characters, between words where there are any.
pub(super) fn wrapped(text: &str, most: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split(' ') {
        let mut rest: Vec<char> = word.chars().collect();
        loop {
            let last = lines.last().map_or(0, |line| line.chars().count());
            let gap = usize::from(last > 0);
            let Some(line) = lines.last_mut() else { break };
            if last + gap + rest.len() <= most {
                line.extend(std::iter::repeat_n(' ', gap));
                line.extend(&rest);
                break;
            }
            if last == 0 {
                // A word that is longer than a line is cut.
                line.extend(rest.drain(..most.min(rest.len())));
            }
            lines.push(String::new());
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_have_pixels_within_their_cells() {
        for font in [Font::Small, Font::Large] {
            let mut pixels = Vec::new();
            draw("A bé", font, |at| pixels.push(at));
            let [w, h] = font.size();
            assert!(pixels.iter().all(|[x, y]| *x < 4 * w && *y < h));
            let inked = |cell: usize| pixels.iter().any(|[x, _]| x / w == cell);
            assert!(inked(0) && !inked(1) && inked(2) && inked(3), "{font:?}");
            let count = |text: &str| {
                let mut count = 0;
                draw(text, font, |_| count += 1);
                count
            };
            assert_eq!((count("\u{1f32b}"), count("\n")), (count("?"), count("?")));
        }
    }

    #[test]
    fn lines_break_between_words() {
        assert_eq!(wrapped("one two three", 7), ["one two", "three"]);
        assert_eq!(wrapped("abcdefgh ij", 3), ["abc", "def", "gh", "ij"]);
        assert_eq!(wrapped("", 5), [""]);
    }
}
