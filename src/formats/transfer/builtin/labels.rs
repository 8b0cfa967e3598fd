//! The function of labels: another color for each of them.

use super::super::{Loaded, Options, Source, color};
use crate::error::{Error, Result};
use crate::scene::transfer::{Class, Transfer};

/// Greatest label, that of signed numbers of 16 bits.
pub(super) const LAST: i32 = i16::MAX as i32;

/// Turns of the hue from a label to the next: the golden ratio keeps those of any labels in a row apart.
const GOLDEN: f64 = 0.618_033_988_749_894_9;
/// Saturation and value of labels in turn, which tell near hues apart.
const TONES: [[f64; 2]; 3] = [[0.75, 0.95], [0.55, 0.8], [0.9, 0.75]];

/// Returns the scene-linear color of a label.
fn color_of(label: i32) -> [f64; 3] {
    let hue = (f64::from(label - 1) * GOLDEN).rem_euclid(1.0);
    let [saturation, value] = TONES[label.unsigned_abs() as usize % TONES.len()];
    color::rgb_of_hsv([hue, saturation, value]).map(color::linear)
}

/// Returns the function, with the extinction of the options.
///
/// # Errors
/// If opacities per unit distance are asked for, or the extinction cannot be used.
pub(super) fn loaded(name: &str, options: &Options) -> Result<Loaded> {
    if options.unit_distance.is_some() {
        return Err(Error::invalid(format!("a unit distance was given, but '{name}' states extinctions"))
            .hint("leave it out, or give an extinction"));
    }
    let extinction = options.extinction.unwrap_or(1.0);
    let class = |label: i32| {
        let [r, g, b] = color_of(label);
        Class { label, name: String::new(), rgbs: [r, g, b, extinction] }
    };
    let transfer = Transfer::Labels { classes: (1..=LAST).map(class).collect() }.checked()?;
    let presets = vec![name.to_owned()];
    Ok(Loaded {
        transfer,
        albedo: None,
        source: Source::Builtin,
        name: Some(name.to_owned()),
        presets,
        notes: Vec::new(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Labels in a row have colors that are told apart.
    #[test]
    fn colors_differ() {
        for first in [1, 100, 5000] {
            for (a, b) in (0..12).flat_map(|a| (0..a).map(move |b| (first + a, first + b))) {
                let [a, b] = [a, b].map(color_of);
                let apart: f64 = a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum();
                assert!(apart > 0.08, "{a:?} {b:?}");
            }
        }
    }
}
