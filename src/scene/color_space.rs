//! Transfer curves of pictures with integer samples: how a stored value becomes scene-linear light.

use crate::text::serde_as_text;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use std::borrow::Cow;
use std::fmt;
use std::str::FromStr;

/// Color space of integer samples. The primaries are those of Rec.709 in each, so that spaces differ in their curve
/// alone. Names are those of Blender's OpenColorIO configuration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ColorSpace {
    /// sRGB with its piecewise curve (IEC 61966-2-1).
    Srgb,
    /// Scene-linear: samples are proportional to radiance.
    Linear,
    /// The pure power 2.2.
    Gamma22,
}

impl ColorSpace {
    /// Returns the name that captures state.
    pub fn name(self) -> &'static str {
        match self {
            Self::Srgb => "sRGB",
            Self::Linear => "Linear Rec.709",
            Self::Gamma22 => "Gamma 2.2 Encoded Rec.709",
        }
    }

    /// Returns the scene-linear value of an encoded one from 0 to 1.
    pub fn decode(self, encoded: f64) -> f64 {
        match self {
            Self::Srgb if encoded <= 0.04045 => encoded / 12.92,
            Self::Srgb => ((encoded + 0.055) / 1.055).powf(2.4),
            Self::Linear => encoded,
            Self::Gamma22 => encoded.powf(2.2),
        }
    }

    /// Returns the scene-linear values of all samples of `bits` bits, 1 to 16: `table[sample]`.
    pub fn table(self, bits: u8) -> Vec<f32> {
        let most = (1_u32 << bits.clamp(1, 16)) - 1;
        (0..=most).map(|sample| self.decode(f64::from(sample) / f64::from(most)) as f32).collect()
    }

    /// Returns the difference of radiance between the two largest samples of `bits` bits, relative to the largest.
    pub fn largest_step(self, bits: u8) -> f64 {
        let most = f64::from((1_u32 << bits.clamp(1, 16)) - 1);
        1.0 - self.decode((most - 1.0) / most)
    }
}

impl fmt::Display for ColorSpace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl JsonSchema for ColorSpace {
    fn schema_name() -> Cow<'static, str> {
        "ColorSpace".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "type": "string", "enum": [Self::Srgb.name(), Self::Linear.name(), Self::Gamma22.name()] })
    }
}

impl FromStr for ColorSpace {
    type Err = String;

    /// Reads a name in any case: Blender's, those of the Color Interop Forum (`srgb_rec709_scene`, `lin_rec709_scene`,
    /// `g22_rec709_scene`), or the short `linear` and `gamma 2.2`.
    fn from_str(text: &str) -> Result<Self, String> {
        match text.to_ascii_lowercase().as_str() {
            "srgb" | "srgb_rec709_scene" | "srgb_texture" => Ok(Self::Srgb),
            "linear" | "linear rec.709" | "lin_rec709_scene" | "lin_rec709" | "raw" | "non-color" => Ok(Self::Linear),
            "gamma 2.2" | "gamma 2.2 encoded rec.709" | "g22_rec709_scene" | "g22_rec709" => Ok(Self::Gamma22),
            _ => Err("sRGB, linear or 'gamma 2.2' is expected".into()),
        }
    }
}

serde_as_text!(ColorSpace);

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use crate::scene::display;

    #[test]
    fn srgb_is_that_of_the_standard() {
        let close = |encoded: f64, linear: f64| {
            let found = ColorSpace::Srgb.decode(encoded);
            assert!((found - linear).abs() < 5e-9, "{encoded}: {found} for {linear}");
        };
        // IEC 61966-2-1: V / 12.92 up to 0.04045, ((V + 0.055) / 1.055) ^ 2.4 above; values to nine digits.
        for (encoded, linear) in [
            (0.0, 0.0),
            (10.0 / 255.0, 0.003_035_270),
            (11.0 / 255.0, 0.003_346_536),
            (0.5, 0.214_041_140),
            (128.0 / 255.0, 0.215_860_500),
            (188.0 / 255.0, 0.502_886_458),
            (1.0, 1.0),
        ] {
            close(encoded, linear);
        }
        // Display encoding and this decoding are inverse to each other; the display's are 32-bit floats.
        for sample in 0..=255_u32 {
            let encoded = f64::from(sample) / 255.0;
            let back = f64::from(display::value(ColorSpace::Srgb.decode(encoded) as f32));
            assert!((back - encoded).abs() < 2e-6, "{sample}: {back}");
        }
    }

    #[test]
    fn tables_have_every_sample() {
        let table = ColorSpace::Gamma22.table(16);
        assert_eq!((table.len(), table[0], table[65535]), (65536, 0.0, 1.0));
        assert_eq!(ColorSpace::Linear.table(1), [0.0, 1.0]);
        // The slope of the sRGB curve at 1 is 2.4 / 1.055; the curve bends by half its second derivative over one step.
        assert!((ColorSpace::Srgb.largest_step(8) - 2.4 / 1.055 / 255.0).abs() < 3e-5);
    }

    #[test]
    fn names_are_read_in_any_case_and_written_as_blender_has_them() {
        for space in [ColorSpace::Srgb, ColorSpace::Linear, ColorSpace::Gamma22] {
            assert_eq!(space.name().to_uppercase().parse(), Ok(space));
        }
        assert_eq!("lin_rec709_scene".parse(), Ok(ColorSpace::Linear));
        assert!("Filmic".parse::<ColorSpace>().unwrap_err().contains("sRGB"));
    }
}
