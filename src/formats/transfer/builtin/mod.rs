//! Transfer functions by name: color maps, and presets for medical volumes.
//!
//! [`load`](super::load()) takes one of these names where it takes the path of a file, unless a file of that name is
//! there. Colors and opacities follow the rules of ParaView's presets: opacities are those of a layer one unit distance
//! thick, and without opacities extinction rises linearly from 0 to [`Options::extinction`], in diverging maps from the
//! middle of the range to both ends.

mod labels;
mod maps;
mod medical;

use super::paraview::{self, Preset};
use super::{Loaded, Options, Source};
use crate::error::{Error, Result};
use serde::Serialize;

/// Description of a transfer function that is chosen by name.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub(crate) struct Builtin {
    /// Name, as `tf` takes it.
    pub name: &'static str,
    /// Densities at its two ends.
    pub range: [f64; 2],
    /// Unit of the densities: `HU` for Hounsfield units, or empty.
    pub unit: &'static str,
    /// Colors from the low end to the high one, in words.
    pub colors: &'static str,
    /// How opacity or extinction depends on the density, in words.
    pub opacity: String,
    /// Origin of colors and ranges.
    pub source: &'static str,
}

/// A transfer function with what is known of it before it is built.
struct Entry {
    name: &'static str,
    unit: &'static str,
    colors: &'static str,
    source: &'static str,
    preset: fn() -> Preset,
}

/// Name of the function of labels.
const LABELS: &str = "labels";

/// Largest number of changes of a character between a mistyped name and a suggestion.
const NEAR: usize = 3;

fn entries() -> impl Iterator<Item = &'static Entry> {
    maps::ENTRIES.iter().chain(&medical::ENTRIES)
}

/// Returns the descriptions of all transfer functions by name: color maps, medical presets, and that of labels.
pub(crate) fn builtins() -> Vec<Builtin> {
    let labels = Builtin {
        name: LABELS,
        range: [1.0, f64::from(labels::LAST)],
        unit: "",
        colors: "another color for each label",
        opacity: "extinction 1, label 0 clear; looked up at the nearest voxel".into(),
        source: "hues by the golden ratio",
    };
    entries().map(Entry::described).chain([labels]).collect()
}

/// Returns true if a transfer function of this name is built in.
pub(crate) fn is_builtin(name: &str) -> bool {
    name == LABELS || entries().any(|entry| entry.name == name)
}

/// Returns the unit of the densities of the function of this name.
pub(super) fn unit(name: &str) -> Option<&'static str> {
    entries().find(|entry| entry.name == name).map(|entry| entry.unit)
}

/// Returns the names that a mistyped one may mean, the nearest first.
pub(super) fn nearest(name: &str) -> Vec<&'static str> {
    let typed = name.to_lowercase().replace('_', "-").replace("gray", "grey");
    let distance = |name: &str| match name.starts_with(&typed) || name.ends_with(&typed) {
        true if typed.len() > 1 => 0,
        _ => strsim::damerau_levenshtein(&typed, name),
    };
    let names = entries().map(|entry| entry.name).chain([LABELS]);
    let mut near: Vec<_> = names.map(|name| (distance(name), name)).filter(|(d, _)| *d <= NEAR).collect();
    near.sort();
    let most = near.first().map_or(0, |(best, _)| best + 1);
    near.retain(|(distance, _)| *distance <= most);
    near.into_iter().map(|(_, name)| name).collect()
}

/// Builds the transfer function of a name; `None` if there is none of that name.
pub(super) fn load(name: &str, options: &Options) -> Option<Result<Loaded>> {
    let entry = entries().find(|entry| entry.name == name);
    if entry.is_none() && name != LABELS {
        return None;
    }
    if let Some(preset) = &options.preset {
        let error = Error::invalid(format!("'{preset}' of several was asked for, but '{name}' is one function"));
        return Some(Err(error.hint("leave the name of the preset out")));
    }
    let Some(entry) = entry else { return Some(labels::loaded(name, options)) };
    Some(paraview::loaded((entry.preset)(), vec![name.to_owned()], 0, Source::Builtin, options))
}

impl Entry {
    fn described(&self) -> Builtin {
        let preset = (self.preset)();
        let ends = |knots: &[[f64; 4]]| [knots.first(), knots.last()].map(|knot| knot.map_or(0.0, |k| k[0]));
        let opacity = match &preset.opacities {
            Some(knots) => {
                let steps: Vec<_> = knots.iter().map(|k| format!("{} at {}", k[1], k[0])).collect();
                format!("opacity {}", steps.join(", "))
            }
            None if preset.diverging => "extinction 0 in the middle, rising to 1 at both ends".into(),
            None => "extinction 0 at the low end, rising to 1 at the high end".into(),
        };
        Builtin {
            name: self.name,
            range: ends(&preset.colors),
            unit: self.unit,
            colors: self.colors,
            opacity,
            source: self.source,
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use crate::scene::table::Rgbs;

    fn at(name: &str, density: f64) -> Rgbs {
        load(name, &Options::default()).unwrap().unwrap().transfer.table().unwrap().at(density)
    }

    /// The display value of a scene-linear one, from 0 to 255.
    fn shown(linear: f64) -> f64 {
        255.0 * f64::from(crate::scene::display::value(linear as f32))
    }

    #[test]
    fn every_name_can_be_loaded_and_says_its_range() {
        let all = builtins();
        assert!(all.len() >= 14);
        for b in &all {
            let loaded = load(b.name, &Options::default()).unwrap().unwrap();
            assert_eq!(super::super::rescale::range(&loaded.transfer), b.range, "{}", b.name);
            assert_eq!(all.iter().filter(|o| o.name == b.name).count(), 1);
        }
        assert!(load("viridi", &Options::default()).is_none());
    }

    /// The published colors of the maps' ends and middles, in levels of 255.
    #[test]
    fn colors_are_the_published_ones() {
        for (name, density, expected) in [
            ("viridis", 0.0, [68.0, 1.0, 84.0]),
            ("viridis", 1.0, [253.0, 231.0, 37.0]),
            ("magma", 1.0, [252.0, 253.0, 191.0]),
            ("inferno", 1.0, [252.0, 255.0, 164.0]),
            ("plasma", 0.0, [13.0, 8.0, 135.0]),
            ("grey", 0.5, [118.9, 118.9, 118.9]),
            // Moreland 2009, table 1 of the cool-warm map: blue 59 76 192, white 221 221 221, red 180 4 38.
            ("cool-warm", 0.0, [59.0, 76.0, 192.0]),
            ("cool-warm", 0.5, [221.0, 221.0, 221.0]),
            ("cool-warm", 1.0, [180.0, 4.0, 38.0]),
        ] {
            let got = at(name, density);
            // Tables hold whole levels, and so do the published numbers; the grey is CIE lightness 50.
            (0..3).for_each(|c| assert!((shown(got[c]) - expected[c]).abs() < 1.0, "{name} {density}: {got:?}"));
        }
    }

    #[test]
    fn diverging_maps_are_clear_in_the_middle_and_rise_to_both_ends() {
        for name in ["diverging", "diverging-purple-orange"] {
            for (density, extinction) in [(-3.0, 1.0), (-1.0, 1.0), (-0.25, 0.25), (0.0, 0.0), (0.5, 0.5), (2.0, 1.0)] {
                assert!((at(name, density)[3] - extinction).abs() < 1e-12, "{name} {density}");
            }
            // Paler towards the middle, of another hue on each side.
            let spread = |[r, g, b, _]: Rgbs| r.max(g).max(b) - r.min(g).min(b);
            assert!(spread(at(name, 0.0)) < 0.01 && spread(at(name, -1.0)) > 0.1 && spread(at(name, 1.0)) > 0.1);
            assert!(at(name, -1.0)[2] > at(name, -1.0)[0] && at(name, 1.0)[0] > at(name, 1.0)[2]);
            let options = Options { range: Some([-20.0, 40.0]), extinction: Some(3.0), ..Options::default() };
            let moved = super::super::load(std::path::Path::new(name), &options).unwrap().transfer.table().unwrap();
            assert_eq!((moved.at(10.0)[3], moved.at(40.0)[3]), (0.0, 3.0), "{name}");
        }
    }

    #[test]
    fn medical_presets_are_empty_where_they_say() {
        for (name, empty, seen) in [
            ("ct-bone", 100.0, 700.0),
            ("ct-lung", -1000.0, -750.0),
            ("ct-soft-tissue", -400.0, 50.0),
            ("ct-vessels", 90.0, 300.0),
            ("mr-default", 0.02, 0.5),
        ] {
            assert_eq!(at(name, empty)[3], 0.0, "{name}");
            assert!(at(name, seen)[3] > 0.0, "{name}");
        }
    }

    #[test]
    fn mistyped_names_find_the_nearest() {
        assert_eq!(nearest("virdis"), ["viridis"]);
        assert_eq!(nearest("coolwarm"), ["cool-warm"]);
        assert_eq!(nearest("gray"), ["grey"]);
        assert_eq!(nearest("ct-bones"), ["ct-bone"]);
        assert!(nearest("vessels").contains(&"ct-vessels") && nearest("ct").len() == 4);
        assert!(nearest("something-else.json").is_empty());
    }
}
