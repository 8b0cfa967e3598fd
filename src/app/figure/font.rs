//! The font of figures: DejaVu Sans with the letters of Latin, Greek and Cyrillic, which the program carries, since a
//! machine may have none.

use crate::error::{Error, Result};
use std::collections::BTreeSet;
use ttf_parser::{Face, GlyphId};

/// Bytes of the font as TrueType; its license lies beside it.
pub(super) const BYTES: &[u8] = include_bytes!("font/DejaVuSans.ttf");
/// Names of fonts for programs that have their own, in the order of preference.
pub(super) const FAMILIES: &str = "DejaVu Sans, Verdana, Helvetica, Arial, sans-serif";

/// The font with its measures.
pub(super) struct Font(Face<'static>);

impl Font {
    /// Reads the font.
    ///
    /// # Errors
    /// If the program is damaged.
    pub(super) fn new() -> Result<Self> {
        let fault = |e| Error::invalid(format!("the font of figures: {e}")).hint("install the program again");
        Face::parse(BYTES, 0).map(Self).map_err(fault)
    }

    pub(super) fn face(&self) -> &Face<'static> {
        &self.0
    }

    /// Glyph of a character; the one of a missing character where there is none.
    pub(super) fn glyph(&self, character: char) -> GlyphId {
        self.0.glyph_index(character).unwrap_or_default()
    }

    /// Font units of a size of one.
    pub(super) fn units(&self) -> f64 {
        f64::from(self.0.units_per_em())
    }

    /// Advance of a glyph at a size of one.
    pub(super) fn advance(&self, glyph: GlyphId) -> f64 {
        f64::from(self.0.glyph_hor_advance(glyph).unwrap_or_default()) / self.units()
    }

    /// Width of a text in points at a font size in points.
    pub(super) fn width(&self, text: &str, size: f64) -> f64 {
        size * text.chars().map(|c| self.advance(self.glyph(c))).sum::<f64>()
    }

    /// Characters that the font does not have.
    pub(super) fn missing<'t>(&self, texts: impl IntoIterator<Item = &'t str>) -> BTreeSet<char> {
        texts.into_iter().flat_map(str::chars).filter(|c| self.0.glyph_index(*c).is_none()).collect()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    #[test]
    fn the_font_has_what_figures_say() {
        let font = Font::new().unwrap();
        let missing = font.missing(["Density (HU), 1.5 × 10⁻³ cm³ −200 µm Å σ ∞ é Ж"]);
        assert!(missing.is_empty(), "{missing:?}");
        assert_eq!(font.missing(["脑"]).len(), 1);
        // Digits are equally wide, as in every font for tables.
        assert_eq!(font.width("0123", 8.0), 4.0 * font.width("7", 8.0));
        assert!((font.width("0", 10.0) - 6.36).abs() < 0.01);
    }
}
