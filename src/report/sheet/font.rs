//! Text in pictures, by the bitmap fonts Spleen (Frederic Cambus, BSD-2-Clause).

use spleen_font::{FONT_8X16, FONT_12X24, PSF2Font};

/// A monospaced font.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Font {
    /// Characters of 8 x 16 pixels.
    Small,
    /// Characters of 12 x 24 pixels.
    Large,
}

impl Font {
    /// Width and height of a character in pixels.
    pub const fn size(self) -> [usize; 2] {
        match self {
            Self::Small => [8, 16],
            Self::Large => [12, 24],
        }
    }

    /// Number of characters that fit into a width in pixels; one at least.
    pub fn fitting(self, width: usize) -> usize {
        (width / self.size()[0]).max(1)
    }

    /// Width of a text in pixels.
    pub fn width(self, text: &str) -> usize {
        text.chars().count() * self.size()[0]
    }
}

/// Calls `set` with column and row of every pixel of a text. Characters that the font does not have become `?`.
pub(super) fn draw(text: &str, font: Font, mut set: impl FnMut([usize; 2])) {
    let bytes = match font {
        Font::Small => FONT_8X16,
        Font::Large => FONT_12X24,
    };
    let Ok(mut glyphs) = PSF2Font::new(bytes) else { return };
    for (place, c) in text.chars().enumerate() {
        let mut buffer = [0; 4];
        let known = glyphs.glyph_for_utf8(c.encode_utf8(&mut buffer).as_bytes()).is_some();
        let name = if known { c } else { '?' };
        let Some(glyph) = glyphs.glyph_for_utf8(name.encode_utf8(&mut buffer).as_bytes()) else { continue };
        for (row, pixels) in glyph.enumerate() {
            for (column, _) in pixels.enumerate().filter(|(_, on)| *on) {
                set([place * font.size()[0] + column, row]);
            }
        }
    }
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
            draw("A b°×", font, |at| pixels.push(at));
            let [w, h] = font.size();
            assert!(pixels.iter().all(|[x, y]| *x < 5 * w && *y < h));
            let inked = |cell: usize| pixels.iter().any(|[x, _]| x / w == cell);
            assert!(inked(0) && !inked(1) && inked(2) && inked(3) && inked(4), "{font:?}");
            let strange = |text: &str| {
                let mut count = 0;
                draw(text, font, |_| count += 1);
                count
            };
            assert_eq!(strange("\u{1f32b}"), strange("?"));
        }
    }

    #[test]
    fn lines_break_between_words() {
        assert_eq!(wrapped("one two three", 7), ["one two", "three"]);
        assert_eq!(wrapped("abcdefgh ij", 3), ["abc", "def", "gh", "ij"]);
        assert_eq!(wrapped("", 5), [""]);
    }
}
