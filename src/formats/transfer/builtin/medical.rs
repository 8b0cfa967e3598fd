//! Presets for computed tomography, over Hounsfield units (HU), and for magnetic resonance.
//!
//! Ranges are published ones: lung above emphysema from -950 HU (Gevenois et al. 1996), fat from -190 to -30 HU (Kvist
//! et al. 1988), muscle from -29 to 150 HU (Aubrey et al. 2014), calcium and bone from 130 HU on (Agatston et al.
//! 1990), cortical bone from about 500 HU to 1900 HU, vessels with contrast medium from about 150 to 500 HU. Colors and
//! opacities are choices of this program; opacities are for a layer of one world unit, which in medical volumes is a
//! millimetre.
//!
//! Presets for CT run from -1024 to 3071 HU, the range of a scanner's twelve bits, and show volumes of these units as
//! they are. A volume that stores HU + 1024, so that air is 0, is mapped by the range 0 to 4095.

use super::Entry;
use crate::formats::transfer::color::Space;
use crate::formats::transfer::opacity::OpacityKnot;
use crate::formats::transfer::paraview::{ColorKnot, Preset};

/// Hounsfield units of twelve bits.
const LOW: f64 = -1024.0;
const HIGH: f64 = 3071.0;

/// The medical presets.
pub(super) static ENTRIES: [Entry; 5] = [
    Entry {
        name: "ct-bone",
        unit: "HU",
        colors: "brown, ivory, white",
        source: "bone from 130 HU (Agatston 1990), cortical bone from 500 HU",
        preset: || {
            preset(
                &[[LOW, 0.55, 0.3, 0.2], [150.0, 0.7, 0.42, 0.28], [400.0, 0.92, 0.82, 0.64], [1200.0, 1.0, 1.0, 0.97]],
                &[(130.0, 0.0), (300.0, 0.1), (700.0, 0.5), (1500.0, 0.9), (HIGH, 0.9)],
                HIGH,
            )
        },
    },
    Entry {
        name: "ct-lung",
        unit: "HU",
        colors: "blue air, rose tissue, white vessels",
        source: "aerated lung from -950 HU (Gevenois 1996) to -500 HU",
        preset: || {
            preset(
                &[[LOW, 0.25, 0.35, 0.6], [-900.0, 0.4, 0.55, 0.8], [-600.0, 0.85, 0.55, 0.5], [0.0, 1.0, 0.95, 0.9]],
                &[(-950.0, 0.0), (-850.0, 0.006), (-500.0, 0.012), (-300.0, 0.08), (50.0, 0.3), (HIGH, 0.3)],
                HIGH,
            )
        },
    },
    Entry {
        name: "ct-soft-tissue",
        unit: "HU",
        colors: "yellow fat, red muscle, ivory bone",
        source: "fat -190 to -30 HU (Kvist 1988), muscle -29 to 150 HU (Aubrey 2014)",
        preset: || {
            preset(
                &[
                    [LOW, 0.9, 0.75, 0.4],
                    [-60.0, 0.95, 0.8, 0.45],
                    [30.0, 0.72, 0.25, 0.2],
                    [150.0, 0.85, 0.5, 0.4],
                    [400.0, 0.96, 0.9, 0.78],
                ],
                &[(-190.0, 0.0), (-100.0, 0.01), (-30.0, 0.01), (30.0, 0.12), (150.0, 0.2), (400.0, 0.5), (HIGH, 0.7)],
                HIGH,
            )
        },
    },
    Entry {
        name: "ct-vessels",
        unit: "HU",
        colors: "dark red, red, ivory",
        source: "vessels with contrast medium, about 150 to 500 HU; calcium and bone shine through from 130 HU",
        preset: || {
            preset(
                &[
                    [LOW, 0.45, 0.05, 0.05],
                    [150.0, 0.6, 0.08, 0.06],
                    [350.0, 0.9, 0.25, 0.15],
                    [600.0, 0.96, 0.88, 0.74],
                ],
                &[(130.0, 0.0), (200.0, 0.15), (350.0, 0.6), (500.0, 0.6), (800.0, 0.15), (HIGH, 0.15)],
                HIGH,
            )
        },
    },
    Entry {
        name: "mr-default",
        unit: "",
        colors: "brown, rose, white",
        source: "signals have no absolute scale: map them with a range, such as 0 to the 99th percentile",
        preset: || {
            preset(
                &[[0.0, 0.2, 0.12, 0.1], [0.3, 0.7, 0.42, 0.36], [0.6, 0.92, 0.76, 0.66], [1.0, 1.0, 1.0, 1.0]],
                &[(0.0, 0.0), (0.12, 0.0), (0.3, 0.03), (0.6, 0.12), (1.0, 0.4)],
                1.0,
            )
        },
    },
];

/// A preset whose colors are constant from the last knot to `high`, with opacities joined by straight lines.
fn preset(colors: &[ColorKnot], opacities: &[(f64, f64)], high: f64) -> Preset {
    let mut colors = colors.to_vec();
    colors.extend(colors.last().copied().filter(|last| last[0] < high).map(|[_, r, g, b]| [high, r, g, b]));
    let knot = |(density, opacity): &(f64, f64)| -> OpacityKnot { [*density, *opacity, 0.5, 0.0] };
    Preset { space: Space::Rgb, colors, opacities: Some(opacities.iter().map(knot).collect()), diverging: false }
}
