//! ParaView presets in JSON.

use super::color::Space;
use super::document::{Object, short, value};
use super::paraview::{self, Preset};
use super::{Loaded, Options, Source, entry_index};
use crate::error::{Error, Result};

/// Keys of which any identifies a preset.
const MARKS: [&str; 4] = ["RGBPoints", "IndexedColors", "Points", "ColorSpace"];

pub(super) fn is_preset(object: &Object) -> bool {
    MARKS.iter().any(|key| object.contains_key(*key))
}

pub(super) fn load(presets: Vec<Object>, options: &Options) -> Result<Loaded> {
    if presets.is_empty() {
        return Err(Error::invalid("the list of presets is empty")
            .hint("select a preset in ParaView's list before it is exported"));
    }
    let name = |(i, preset): (usize, &Object)| {
        let name = value(preset, "Name", "a text").map_err(|e| e.part(format!("preset {}", i + 1)))?;
        Ok(name.unwrap_or_else(|| format!("preset {}", i + 1)))
    };
    let names = presets.iter().enumerate().map(name).collect::<Result<Vec<String>>>()?;
    let index = entry_index(&names, options.preset.as_deref())?;
    let preset = preset(&presets[index]).map_err(|e| e.part(format!("preset '{}'", names[index])))?;
    paraview::loaded(preset, names, index, Source::ParaviewJson, options)
}

fn preset(object: &Object) -> Result<Preset> {
    let Some(colors) = fours(object, "RGBPoints", "density, red, green, blue")? else {
        return Err(if object.contains_key("IndexedColors") {
            Error::unsupported("the preset is for categories ('IndexedColors'), not for a range of densities")
                .hint("choose a preset with 'RGBPoints'")
        } else {
            Error::invalid("no key 'RGBPoints'").hint("it lists the colors: [density, red, green, blue, density, …]")
        });
    };
    if truth(object, "UseLogScale")? {
        return Err(Error::unsupported("the preset is for a logarithmic scale ('UseLogScale')")
            .hint("switch the logarithmic scale off in ParaView, and export the preset again"));
    }
    let space: Option<String> = value(object, "ColorSpace", "a text")?;
    let space = Space::named(space.as_deref().unwrap_or("RGB"), truth(object, "HSVWrap")?)?;
    let opacities = fours(object, "Points", "density, opacity, midpoint, sharpness")?;
    Ok(Preset { space, colors, opacities, diverging: false })
}

/// Value of a flag, which ParaView writes as a number.
fn truth(object: &Object, key: &str) -> Result<bool> {
    match value(object, key, "0 or 1")? {
        None => Ok(false),
        Some(serde_json::Value::Bool(flag)) => Ok(flag),
        Some(serde_json::Value::Number(n)) => Ok(n.as_f64() != Some(0.0)),
        Some(other) => Err(Error::invalid(format!("'{key}' is {}; 0 or 1 is expected", short(&other.to_string())))
            .hint(format!("correct '{key}', or leave it out: it is 0 then"))),
    }
}

/// Flat list of numbers in groups of four, one group per point.
fn fours(object: &Object, key: &str, four: &str) -> Result<Option<Vec<[f64; 4]>>> {
    let Some(numbers) = value::<Vec<f64>>(object, key, "a list of numbers")? else { return Ok(None) };
    let (fours, rest) = numbers.as_chunks::<4>();
    if fours.is_empty() || !rest.is_empty() {
        return Err(Error::invalid(format!(
            "'{key}' has {} numbers; four a point are expected: {four}",
            numbers.len()
        ))
        .hint("the list is cut off or has numbers too many: export the preset again from ParaView"));
    }
    Ok(Some(fours.to_vec()))
}
