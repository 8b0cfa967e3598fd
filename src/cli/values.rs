//! Values of options whose types live elsewhere: their names on the command line, with a line of help for each.

use crate::formats::vdb::{Codec, ResampleFilter};
use crate::optimise::study::ad_mode::Mode;
use crate::render::aov::Aov;
use crate::scene::capture::{EmissionModel, Model};
use crate::scene::orbit::Layout;
use clap::ValueEnum;
use clap::builder::PossibleValue;

macro_rules! value_enum {
    ($kind:ty { $($variant:ident: $name:literal $(or $alias:literal)*, $help:literal;)* }) => {
        impl ValueEnum for $kind {
            fn value_variants<'a>() -> &'a [Self] {
                &[$(Self::$variant),*]
            }

            fn to_possible_value(&self) -> Option<PossibleValue> {
                Some(match self {
                    $(Self::$variant => PossibleValue::new($name)$(.alias($alias))*.help($help),)*
                })
            }
        }
    };
}

value_enum!(Model {
    Absorption: "absorption", "`T · background`";
    EmissionAbsorption: "emission-absorption", "`∫ T σ c dt + T · background`";
    PreShaded: "pre-shaded",
        "`∫ T e dt + T · background`, with a grid of emissions e per length beside that of extinctions";
    Scattering: "scattering", "Light that is scattered any number of times: see --albedo";
});

value_enum!(EmissionModel {
    Grey: "grey", "The same everywhere";
    Linear: "linear", "Proportional to the density";
});

value_enum!(Aov {
    Variance: "variance", "Variance of the mean over a pixel's rays: variance.R, .G, .B and .A";
    OpticalDepth: "optical-depth", "Optical depth, the mean over a pixel's rays: optical_depth.V";
    Direct: "direct", "Light scattered once: Volume Direct.R, .G and .B (path tracing)";
    Indirect: "indirect", "Light scattered more often: Volume Indirect.R, .G and .B (path tracing)";
    Albedo: "albedo", "Albedo at first collisions, by their share: Denoising Albedo.R, .G and .B (path tracing)";
    Normal: "normal", "Mean direction in which the density falls: Denoising Normal.X, .Y and .Z (path tracing)";
    Position: "position", "Mean position of first collisions: Position.X, .Y and .Z (path tracing)";
    Depth: "depth", "Mean length along the viewing axis to first collisions: Depth.Z (path tracing)";
    Motion: "motion", "Pixels that first collisions move from and to the next frame: Vector.X, .Y, .Z and .W (path tracing)";
    Samples: "samples", "Number of paths: Debug Sample Count.X (path tracing)";
    Halves: "halves", "Radiance of two independent halves of the paths: half_a.R, …, half_b.B (path tracing)";
});

value_enum!(Layout {
    Sphere: "sphere", "Over the whole sphere, by the golden angle: evenly, and no two along one line";
    Ring: "ring", "On the horizontal circle around the up axis";
});

value_enum!(ResampleFilter {
    Box: "box", "Mean over the new voxels' cells: the sum of value times volume is kept";
    Trilinear: "trilinear", "Trilinear interpolation at the new voxels' centres";
});

value_enum!(Codec {
    Blosc: "blosc", "Blosc: fast, smaller";
    None: "none", "Active values as they are";
});

value_enum!(Mode {
    Auto: "auto", "By the number of parameters and the loss";
    Reverse: "reverse" or "adjoint", "Backward: all parameters at once";
    Forward: "forward" or "tangent", "Forward: dual numbers, a few parameters at a time";
});
