//! Effects that a scene may call for, by their names.

use crate::text::serde_as_text;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use std::borrow::Cow;
use std::fmt;
use std::str::FromStr;

/// An effect of light in a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Effect {
    /// Light that media emit.
    Emission,
    /// Light that media scatter, once or more often.
    Scattering,
    /// Light that is scattered more than once.
    MultipleScattering,
    /// Scattering that prefers some directions.
    Anisotropy,
    /// Scattering as by surfaces where the density changes much.
    GradientShading,
    /// Light from all around.
    Environment,
    /// A light, by its number.
    Light(usize),
    /// Extinction that differs between color channels.
    ChromaticExtinction,
    /// Extinction and emission by a function of the density.
    TransferFunction,
    /// Several volumes, which may overlap.
    Overlap,
    /// Meshes that reflect and emit light, and stop it.
    Surfaces,
}

/// Names without a number.
const NAMES: [(&str, Effect); 10] = [
    ("emission", Effect::Emission),
    ("scattering", Effect::Scattering),
    ("multiple-scattering", Effect::MultipleScattering),
    ("anisotropy", Effect::Anisotropy),
    ("gradient-shading", Effect::GradientShading),
    ("environment", Effect::Environment),
    ("chromatic-extinction", Effect::ChromaticExtinction),
    ("transfer-function", Effect::TransferFunction),
    ("overlap", Effect::Overlap),
    ("surfaces", Effect::Surfaces),
];

/// Name of a light before its number.
const LIGHT: &str = "light-";

impl fmt::Display for Effect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Light(number) => write!(f, "{LIGHT}{number}"),
            effect => f.write_str(NAMES.iter().find(|(_, of)| of == effect).map_or("", |(name, _)| name)),
        }
    }
}

serde_as_text!(Effect);

impl JsonSchema for Effect {
    fn schema_name() -> Cow<'static, str> {
        "Effect".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "type": "string",
            "description": "Name of an effect: such as `emission`, or `light-0` for a light by its number in the scene."
        })
    }
}

impl FromStr for Effect {
    type Err = String;

    /// Reads an effect that can be left out, and so be kept by force.
    fn from_str(text: &str) -> Result<Self, String> {
        let light = || text.strip_prefix(LIGHT)?.parse().ok().map(Self::Light);
        let named = NAMES.iter().find(|(name, _)| *name == text).map(|(_, effect)| *effect);
        match named.or_else(light) {
            Some(
                Self::Anisotropy
                | Self::GradientShading
                | Self::ChromaticExtinction
                | Self::TransferFunction
                | Self::Overlap
                | Self::Surfaces,
            ) => Err(format!("{text} is never left out where a scene calls for it")),
            Some(effect) => Ok(effect),
            None => Err("emission, scattering, multiple-scattering, environment or light-N is expected".into()),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_as_they_are_written() {
        for effect in [Effect::Emission, Effect::MultipleScattering, Effect::Environment, Effect::Light(12)] {
            assert_eq!(effect.to_string().parse(), Ok(effect));
        }
        for bad in ["", "light-", "light-x", "light--1", "sun", "overlap", "surfaces"] {
            assert!(bad.parse::<Effect>().is_err(), "{bad}");
        }
    }
}
