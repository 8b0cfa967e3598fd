//! Color maps over densities from 0 to 1, and diverging ones over values from -1 to 1.
//!
//! viridis, magma, inferno and plasma are by Stéfan van der Walt, Nathaniel Smith and Eric Firing (CC0), cividis by
//! Nuñez, Anderton and Renslow, "Optimizing colormaps with consideration for color vision deficiency" (PLOS ONE 2018),
//! turbo by Anton Mikhailov (Google, 2019); the crate `colorous` states them at 8 bits, the last two by polynomials.
//! cool-warm is computed: Moreland, "Diverging Color Maps for Scientific Visualization" (ISVC 2009), which runs through
//! white in polar CIELAB (Msh), and so are diverging, of the same colors, and diverging-purple-orange, of that paper's
//! ones. grey and black-body are straight lines in CIELAB, so that lightness rises evenly.

use super::Entry;
use crate::formats::transfer::color::Space;
use crate::formats::transfer::paraview::{ColorKnot, Preset};
use colorous::Gradient;

/// Number of colors that a map is stated by.
const COLORS: u32 = 256;

const VAN_DER_WALT: &str = "van der Walt, Smith, Firing 2015 (CC0)";

const fn map(name: &'static str, colors: &'static str, source: &'static str, preset: fn() -> Preset) -> Entry {
    Entry { name, unit: "", colors, source, preset }
}

/// The color maps.
pub(super) static ENTRIES: [Entry; 11] = [
    map("viridis", "violet, teal, yellow", VAN_DER_WALT, || sampled(colorous::VIRIDIS)),
    map("magma", "black, magenta, pale yellow", VAN_DER_WALT, || sampled(colorous::MAGMA)),
    map("inferno", "black, red, yellow", VAN_DER_WALT, || sampled(colorous::INFERNO)),
    map("plasma", "blue, magenta, yellow", VAN_DER_WALT, || sampled(colorous::PLASMA)),
    map("cividis", "blue, grey, yellow", "Nuñez, Anderton, Renslow 2018", || sampled(colorous::CIVIDIS)),
    map("turbo", "rainbow: blue, green, red", "Mikhailov 2019 (Apache-2.0)", || sampled(colorous::TURBO)),
    map("grey", "black, grey, white", "CIE lightness rises evenly", || line(&[[0.0; 4], [1.0; 4]], Space::Lab)),
    map("cool-warm", "blue, white, red", "Moreland 2009, in Msh", || line(&COOL_WARM, Space::Diverging)),
    map("black-body", "black, red, yellow, white", "straight lines in CIELAB", || line(&BLACK_BODY, Space::Lab)),
    map("diverging", "blue below 0, white, red above", "Moreland 2009, in Msh", || diverging(&COOL_WARM)),
    map("diverging-purple-orange", "purple below 0, white, orange above", "Moreland 2009, in Msh", || {
        diverging(&PURPLE_ORANGE)
    }),
];

/// Ends of Moreland's map, at levels of 255.
const COOL_WARM: [ColorKnot; 2] =
    [[0.0, 59.0 / 255.0, 76.0 / 255.0, 192.0 / 255.0], [1.0, 180.0 / 255.0, 4.0 / 255.0, 38.0 / 255.0]];

/// Ends of Moreland's map from purple to orange.
const PURPLE_ORANGE: [ColorKnot; 2] = [[0.0, 0.436, 0.308, 0.631], [1.0, 0.759, 0.334, 0.046]];

/// Colors of a glowing body as it heats up, at places that make lightness rise at an even pace (CIE lightness 0, 49, 88
/// and 100).
const BLACK_BODY: [ColorKnot; 4] = [[0.0; 4], [0.49, 0.9, 0.0, 0.0], [0.88, 0.9, 0.9, 0.0], [1.0; 4]];

fn line(colors: &[ColorKnot], space: Space) -> Preset {
    Preset { space, colors: colors.to_vec(), opacities: None, diverging: false }
}

/// A map over values from -1 to 1, of which 0 is clear.
fn diverging(ends: &[ColorKnot; 2]) -> Preset {
    let colors = ends.iter().map(|[at, r, g, b]| [2.0 * at - 1.0, *r, *g, *b]).collect();
    Preset { space: Space::Diverging, colors, opacities: None, diverging: true }
}

fn sampled(gradient: Gradient) -> Preset {
    let knot = |i: u32| {
        let at = f64::from(i) / f64::from(COLORS - 1);
        let color = gradient.eval_continuous(at);
        let [r, g, b] = [color.r, color.g, color.b].map(|level| f64::from(level) / 255.0);
        [at, r, g, b]
    };
    Preset { space: Space::Rgb, colors: (0..COLORS).map(knot).collect(), opacities: None, diverging: false }
}
