//! Values of options whose types live elsewhere: their names on the command line, with a line of help for each.

use crate::app::capture::{Masked, Target};
use crate::app::compare::Which;
use crate::app::convert::{Convention, Form, Repair, UpTarget};
use crate::app::denoise::{Cuts, Direction, Filter, Guide};
use crate::app::figure::{Background, Orientation};
use crate::app::gradient::{LossName, Wrt};
use crate::app::motion::MotionFormat;
use crate::app::reconstruct::refinement::Refined;
use crate::app::reconstruct::{density, transfer};
use crate::app::study::denoise::DenoiseKnob;
use crate::app::study::gradient::GradientKnob;
use crate::app::study::reconstruct::ReconstructKnob;
use crate::app::study::render::Knob;
use crate::app::up::UpChoice;
use crate::differentiate::study::ad_mode::Mode;
use crate::formats::imaging::options::Axes;
use crate::formats::imaging::volume::GridType;
use crate::formats::sample::Endian;
use crate::formats::usd::write::material::Renderer;
use crate::formats::vdb::{Codec, ResampleFilter};
use crate::render::differentiable::Adjoint;
use crate::render::film::Aov;
use crate::scene::aim::Side;
use crate::scene::albedo::TransferColor;
use crate::scene::capture::{EmissionModel, Model};
use crate::scene::holdout::DepthMeasure;
use crate::scene::orbit::Layout;
use clap::ValueEnum;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};

macro_rules! value_enum {
    ($names:ident for $kind:ty { $($variant:ident: $name:literal $(or $alias:literal)* $(, $help:literal)?;)* }) => {
        impl $names for $kind {
            fn value_variants<'a>() -> &'a [Self] {
                &[$(Self::$variant),*]
            }

            fn to_possible_value(&self) -> Option<PossibleValue> {
                Some(match self {
                    $(Self::$variant => PossibleValue::new($name)$(.alias($alias))*$(.help($help))?,)*
                })
            }
        }
    };
}

value_enum!(Choice for Model {
    Absorption: "absorption", "`T · background`";
    EmissionAbsorption: "emission-absorption", "`∫ T σ c dt + T · background`";
    PreShaded: "pre-shaded",
        "`∫ T e dt + T · background`, with a grid of emissions e per length beside that of extinctions";
    Scattering: "scattering", "Light that is scattered any number of times: see --albedo";
});

value_enum!(Choice for DepthMeasure {
    Axis: "axis", "Distance along the viewing axis";
    Ray: "ray", "Distance from the camera";
});

value_enum!(Choice for TransferColor {
    Emission: "emission", "Radiance of the source; the albedo is the same for all densities";
    Albedo: "albedo", "Albedo; nothing is emitted";
    Both: "both", "Albedo, and radiance of which the share that is not scattered is emitted";
});

value_enum!(Choice for EmissionModel {
    Grey: "grey", "The same everywhere";
    Linear: "linear", "Proportional to the density";
});

value_enum!(Choice for Aov {
    Variance: "variance", "Variance of the mean over a pixel's rays: variance.R, .G, .B and .A";
    OpticalDepth: "optical-depth", "Optical depth, the mean over a pixel's rays and the channels: optical_depth.V";
    Direct: "direct", "Light scattered once: Volume Direct.R, .G and .B (path tracing)";
    Indirect: "indirect", "Light scattered more often: Volume Indirect.R, .G and .B (path tracing)";
    Albedo: "albedo", "Albedo at first collisions, by their share: Denoising Albedo.R, .G and .B (path tracing)";
    Normal: "normal", "Mean direction in which the density falls: Denoising Normal.X, .Y and .Z (path tracing)";
    Position: "position", "Mean position of first collisions: Position.X, .Y and .Z (path tracing)";
    Depth: "depth", "Mean length along the viewing axis to first collisions: Depth.Z (path tracing)";
    Motion: "motion", "Pixels that first collisions move from and to the next frame: Vector.X, .Y, .Z and .W (path \
                       tracing)";
    BackwardMotion: "backward-motion", "Pixels and depth from the frame before, for temporal denoisers: Denoising \
                                        Backward Motion.X, .Y and .Z (path tracing)";
    Samples: "samples", "Number of paths: Debug Sample Count.X (path tracing)";
    Halves: "halves", "Radiance of two independent halves of the paths: half_a.R, …, half_b.B (path tracing)";
    Replicates: "replicates", "Sums over replicates, 31 channels, by which `cumulo merge` joins pictures of \
                               --target-error or --time";
});

value_enum!(ValueEnum for Knob {
    Quadrature: "quadrature", "Integration along straight rays";
    Step: "step", "Step of midpoint and riemann, in voxels";
    EarlyStop: "early-stop", "Transmittance at which straight rays end";
    Supersample: "supersample", "Straight rays along each edge of a pixel";
    Samples: "samples", "Paths per pixel";
    MaxBounces: "max-bounces", "Most scatterings along a path";
    Clamp: "clamp", "Most radiance that is scattered to a path";
});

value_enum!(ValueEnum for DenoiseKnob {
    Method: "method", "Way to denoise";
    Direction: "direction", "Frames that a frame learns from, of wrls2";
    Overlap: "overlap", "Frames after a frame that are read to learn from, of wrls2";
});

value_enum!(ValueEnum for GradientKnob {
    Adjoint: "adjoint", "How the backward pass gets at its samples";
    Precision: "precision", "Single and double precision";
    Quadrature: "quadrature", "Integration along rays";
    Step: "step", "Step of midpoint and riemann, in voxels";
});

value_enum!(ValueEnum for ReconstructKnob {
    Views: "views", "Number of views that are fitted";
    Resolution: "resolution", "Voxels along the longest edge of the region";
    Solver: "solver", "How the densities are found";
    Iterations: "iterations", "Iterations on the finest level, at most";
    Noise: "noise", "Noise that is added to the pictures";
});

value_enum!(Choice for Layout {
    Sphere: "sphere", "Over the whole sphere, by the golden angle: evenly, and no two along one line";
    Ring: "ring", "On the horizontal circle around the up axis";
});

value_enum!(Choice for Side {
    Anterior: "anterior", "Patient's front, +Y";
    Posterior: "posterior", "Patient's back, -Y";
    Left: "left", "Left of a patient, or of an object seen from the front, -X";
    Right: "right", "Right, +X";
    Superior: "superior", "Patient's head, +Z, with anterior at the top";
    Inferior: "inferior", "Patient's feet, -Z, with anterior at the top";
    Front: "front", "-Y with Z up, +Z with Y up";
    Back: "back", "Opposite of front";
    Top: "top", "From above, with the back at the top";
    Bottom: "bottom", "From below, with the front at the top";
    Iso: "iso", "Between front, right and top, all three axes equally long";
});

value_enum!(Choice for Background {
    White: "white", "White page";
    Black: "black", "Black page, with white letters";
    Transparent: "transparent", "No page";
});

value_enum!(Choice for Orientation {
    Anatomical: "anatomical", "Cube with the letters R, L, A, P, S and I of a scan's axes";
    Axes: "axes", "Axes X, Y and Z";
});

value_enum!(ValueEnum for ResampleFilter {
    Box: "box", "Mean over the new voxels' cells: the sum of value times volume is kept";
    Trilinear: "trilinear", "Trilinear interpolation at the new voxels' centres";
});

value_enum!(ValueEnum for Codec {
    Blosc: "blosc", "Blosc: fast, smaller";
    None: "none", "Active values as they are";
});

value_enum!(Choice for Mode {
    Auto: "auto", "By the number of parameters and the loss";
    Reverse: "reverse" or "adjoint", "Backward: all parameters at once";
    Forward: "forward" or "tangent", "Forward: dual numbers, a few parameters at a time";
});

value_enum!(ValueEnum for Wrt {
    Step: "step", "The quadrature's step, in voxels";
    Camera: "camera", "Position, rotation, focal lengths and principal point of each view";
    Tf: "tf", "The transfer function's parameters";
    Density: "density", "Every voxel's density, or extinction of a pre-shaded volume";
    Emission: "emission", "Every voxel's emission in red, green and blue, of a pre-shaded volume";
    Background: "background", "Radiance behind the volume";
    Extinction: "extinction", "Extinction per unit of density";
    Albedo: "albedo", "Albedo of the medium, and its color at each point of the function, in the pictures of scattered \
                       light of --target, whose lights are taken";
});

value_enum!(ValueEnum for LossName {
    L1: "l1", "|c - c'|";
    L2: "l2", "(c - c')²";
    Huber: "huber", "Quadratic for small differences, linear for large ones";
    LogTransmittance: "log-transmittance", "(ln T - ln T')² of the transmittances";
    Ssim: "ssim", "1 - SSIM of the colors";
    OpacityEntropy: "opacity-entropy", "Entropy of the alphas, 1 where all are equal";
    Mean: "mean", "The colors themselves";
});

value_enum!(Choice for Adjoint {
    Tape: "tape", "A tape of one ray";
    Replay: "replay", "Walk the ray twice";
    Inversion: "inversion", "Weiss & Westermann's inversion of the blend";
});

value_enum!(ValueEnum for UpChoice {
    Auto: "auto", "Axis that the metadata of the VDB or of the scene's VDBs (Houdini and Maya: y, Blender: z) or the \
                   stage's upAxis state, else z";
    Y: "y", "+Y, as in Houdini and Maya";
    Z: "z", "+Z, as in Blender";
});

value_enum!(ValueEnum for Filter {
    Wrls2: "wrls2", "Guided filter in space and time, of the frames before and after";
    Wrls: "wrls", "Weighted recursive least squares as published by Iglesias-Guitian et al. 2020";
    Rls: "rls", "Recursive least squares without weights against outliers";
    Svgf: "svgf", "Spatiotemporal variance-guided filtering, Schied et al. 2017";
    Ema: "ema", "Exponential moving average, clamped to the colors around";
});

value_enum!(ValueEnum for Direction {
    Both: "both", "Frames before and after the frame";
    Forward: "forward", "Frames before the frame alone, in two thirds of the time";
});

value_enum!(ValueEnum for Guide {
    Alpha: "alpha", "Alpha: of the files of the motion, else of the layer, else of the beauty; it does not count where \
                     it is noisy";
    None: "none", "The colors alone";
});

value_enum!(ValueEnum for MotionFormat {
    Blender: "blender", "Vector.X and .Y, the place in the frame before minus that now, and .Z and .W, the place now \
                         minus that in the frame after";
    Nuke: "nuke", "forward.u and .v, the place in the frame after minus that now; backward.u and .v, the place in the \
                   frame before minus that now";
    Oidn: "oidn", "Denoising Backward Motion.X and .Y, the place in the frame before minus that now, and .Z, the \
                   length along the viewing axis in the frame before minus that now: what Cycles 5.2 hands to the \
                   denoiser";
});

value_enum!(ValueEnum for Cuts {
    Auto: "auto", "Find them by how much the picture changes";
    None: "none", "The sequence is one shot";
});

value_enum!(ValueEnum for Form {
    Fog: "fog", "Densities: 0 outside, 1 inside, with a ramp across the inner half of the narrow band";
    LevelSet: "level-set", "Distances to the surface of one density, negative inside";
});

value_enum!(ValueEnum for density::Choice {
    Auto: "auto";
    Cg: "cg", "Conjugate gradients in the smoothness prior's metric";
    Weiss2021: "weiss2021" or "paper", "Adam as in Weiss & Westermann (2021)";
});

value_enum!(ValueEnum for density::Loss {
    Huber: "huber";
    L2: "l2";
});

value_enum!(ValueEnum for transfer::Choice {
    Auto: "auto";
    Weiss2021: "weiss2021" or "paper", "Adam as in Weiss & Westermann (2021); colors lie between 0 and 1";
});

value_enum!(ValueEnum for Refined {
    Pose: "pose", "Position and rotation of each camera";
    Focal: "focal", "These, and a factor of the focal length that all cameras share";
});

value_enum!(ValueEnum for Convention {
    Blender: "blender", "Blender: density, temperature, flame, color, velocity";
    Houdini: "houdini", "Houdini: density, temperature, flame, Cd, vel";
    Arnold: "arnold", "Arnold: density, temperature; it has no names of its own for the others";
    Karma: "karma", "Karma: density, temperature, flame, Cd, vel";
});

value_enum!(ValueEnum for UpTarget {
    Auto: "auto", "The world lies as it did: nothing is turned";
    Y: "y", "+Y, as in Houdini and Maya";
    Z: "z", "+Z, as in Blender";
});

value_enum!(ValueEnum for Repair {
    Auto: "auto", "Fog volumes hold densities, other grids any values";
    Density: "density", "All grids hold densities";
});

value_enum!(ValueEnum for Which {
    A: "a", "The first picture";
    B: "b", "The second picture";
});

value_enum!(ValueEnum for GridType {
    Auto: "auto", "32-bit integers for images of integers that stay so, else 32-bit floats";
    Float: "float", "32-bit floats";
    Double: "double", "64-bit floats";
    Int: "int", "32-bit integers";
});

value_enum!(ValueEnum for Axes {
    Xyz: "xyz", "array[x, y, z]";
    Zyx: "zyx", "array[z, y, x]";
});

value_enum!(ValueEnum for Endian {
    Little: "little", "Least significant first";
    Big: "big", "Most significant first";
});

value_enum!(ValueEnum for Target {
    Transforms: "transforms", "A transforms.json";
    Colmap: "colmap", "A text model of COLMAP in sparse/0, with the pictures in images";
});

value_enum!(ValueEnum for Masked {
    Used: "used", "They are used as if there were no mask";
    Background: "background", "They become the background of the capture, as if nothing were before it";
});

value_enum!(ValueEnum for Renderer {
    None: "none", "None: each shows densities as it does by default";
    Arnold: "arnold", "Arnold";
    Cycles: "cycles", "Cycles as a Hydra delegate";
    MaterialX: "materialx", "Renderers of MaterialX volumes, such as Karma";
});

/// A type of the kernels' crate with names on the command line, as clap's `ValueEnum` is one of this crate.
pub(super) trait Choice: Clone + Send + Sync + 'static {
    /// Returns all values.
    fn value_variants<'a>() -> &'a [Self];
    /// Returns the name of the value with its help.
    fn to_possible_value(&self) -> Option<PossibleValue>;
}

/// Returns the parser of a type by its names.
pub(super) fn choice<T: Choice>() -> impl TypedValueParser<Value = T> {
    let possible = T::value_variants().iter().filter_map(T::to_possible_value);
    PossibleValuesParser::new(possible).try_map(|name| {
        let named = |value: &&T| value.to_possible_value().is_some_and(|possible| possible.matches(&name, false));
        T::value_variants().iter().find(named).cloned().ok_or("no such value")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Errors name settings' values as the command line takes them.
    #[test]
    fn values_have_one_name() {
        let named = |value: PossibleValue| value.get_name().to_owned();
        for aov in Aov::value_variants() {
            assert_eq!(aov.to_possible_value().map(named).as_deref(), Some(aov.name()));
        }
        for loss in LossName::value_variants() {
            assert_eq!(loss.to_possible_value().map(named).as_deref(), Some(loss.name()));
        }
        for filter in Filter::value_variants() {
            assert_eq!(filter.to_possible_value().map(named).as_deref(), Some(filter.name()));
        }
    }
}
