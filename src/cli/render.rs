//! `cumulo render`: pictures of a volume from many sides, as a capture.

use super::args::read_as;
use super::args::single::Overwrite;
use super::args::velocity::Velocity;
use super::parse;
use super::values::choice;
use crate::app::pictures::PictureSettings;
use crate::app::render::{AccuracySettings, BlurSettings, HoldoutSettings, RenderSettings};
use crate::formats::exr::Packing;
use crate::formats::sequence::Frames;
use crate::render::film::Aov;
use std::path::PathBuf;

/// Render a volume from many sides: a capture of EXR pictures and transforms.json; or one picture, EXR or PNG
///
/// Pictures are 32-bit float (16-bit with --half), scene-linear, alpha = 1 - transmittance. Absorption shows the
/// background through the volume; emission-absorption adds the light of a source that is part of it; with --albedo
/// light is scattered, and pictures are made by path tracing.
#[derive(Debug, clap::Args)]
struct RenderArgs {
    /// Folder for transforms.json and the pictures; or, for one view or frame, the file of the picture: name.exr,
    /// name.png. Runs of the same settings with other --frames add to one folder, at once or one after the other
    #[arg(long, short, value_name = "DIR|FILE")]
    output: PathBuf,
    #[command(flatten)]
    overwrite: Overwrite,
    /// Write a PNG beside each EXR: radiance times 2^EXPOSURE, clipped to 0..1, sRGB
    #[arg(long)]
    png: bool,
    /// Write colors and alpha of EXRs in 16 bits, and the planes of --aov in 32; a color beyond 65504 leaves all in
    /// 32. With --resume a picture that was stopped begins anew
    #[arg(long)]
    half: bool,
    /// How EXRs are packed: zip without loss, or dwaa or dwab, which lose digits of colors by a level of 45 unless
    /// another is given, as in dwaa:20; alpha and planes that are no colors keep theirs. A color beyond 65504 leaves
    /// all without loss. Not with --denoise
    #[arg(long, value_name = "zip|dwaa|dwab", default_value_t)]
    compression: Packing,
    /// Exposure of PNGs in stops (default: 0)
    #[arg(long, value_name = "EV", value_parser = parse::exposure, allow_negative_numbers = true)]
    exposure: Option<f64>,
    /// Render a sequence, frame.####.exr for each number: A, A-B or A-BxSTEP (default with an input such as
    /// smoke.####.vdb or a folder: all files that there are)
    #[arg(long, value_name = "A-B")]
    frames: Option<Frames>,
    /// Add this to the number of a frame for that of its camera: with -1 frame 1 takes the camera of view_000
    #[arg(long, value_name = "N", default_value_t = 0, allow_negative_numbers = true, requires = "cameras")]
    camera_offset: i32,
    /// Turn the camera about the up axis, once in N frames: frame F is seen from view F of --views N --layout ring
    #[arg(
        long,
        value_name = "N",
        value_parser = clap::value_parser!(u32).range(1..=100_000),
        conflicts_with_all = ["views", "aim", "layout", "cameras", "camera", "view"],
    )]
    orbit: Option<u32>,
    /// Skip frames that are there, made by the same settings, unless a volume, the cameras or another input has changed
    /// since; go on from a frame or a single view that was stopped before its error, time or replicates were reached
    #[arg(long, conflicts_with = "overwrite")]
    resume: bool,
    /// Denoise the frames of a sequence, or one view, and state the error that is left; the noisy pictures stay in
    /// DIR/noisy or FILE.noisy.exr. With --target-error E as many paths are traced as make the root mean square error
    /// after denoising E times the picture's scale
    #[arg(long, conflicts_with_all = ["time_limit", "replicates"])]
    denoise: bool,
    /// Planes to write beside RGBA, one or more
    #[arg(long, value_parser = choice::<Aov>(), value_name = "NAME,...", value_delimiter = ',')]
    aov: Vec<Aov>,
    #[command(flatten)]
    velocity: Velocity,
    #[command(flatten)]
    blur: BlurSettings,
    /// Write deep EXRs, whose pixels keep at which depths their light comes from, for compositing with other elements:
    /// as few samples as err by at most E, from 1e-4 to 0.5, in color and alpha before any depth; 0.01 is hardly seen.
    /// Colors are measured by 1, or by the pixel's brightest channel. The background is left out. Not with --aov,
    /// --png, --half, --compression, --denoise, --holdout and options that state an error
    #[arg(long, value_name = "E", value_parser = parse::positive)]
    deep: Option<f64>,
    #[command(flatten)]
    holdout: HoldoutSettings,
    #[command(flatten)]
    accuracy: AccuracySettings,
    #[command(flatten)]
    pictures: PictureSettings,
}

impl From<RenderArgs> for RenderSettings {
    fn from(args: RenderArgs) -> Self {
        Self {
            output: args.output,
            overwrite: args.overwrite.into(),
            png: args.png,
            half: args.half,
            compression: args.compression,
            exposure: args.exposure,
            frames: args.frames,
            camera_offset: args.camera_offset,
            orbit: args.orbit,
            resume: args.resume,
            denoise: args.denoise,
            aov: args.aov,
            velocity: args.velocity.velocity,
            fps: args.velocity.fps,
            blur: args.blur,
            deep: args.deep,
            holdout: args.holdout,
            accuracy: args.accuracy,
            pictures: args.pictures,
        }
    }
}

read_as!(RenderSettings, RenderArgs);
