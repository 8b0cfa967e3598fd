//! `cumulo capture convert`: any capture to one that every command takes.

use crate::app::capture::{CaptureSettings, Masked, Placement, Target};
use crate::cli::args::read_as;
use crate::cli::args::single::Overwrite;
use crate::cli::memory::Memory;
use crate::cli::parse;
use crate::scene::color_space::ColorSpace;
use glam::DVec3;
use std::path::PathBuf;

/// Write a capture that every command takes: cameras without lens distortion and scene-linear EXRs
///
/// Pictures that a lens distorts are resampled, by bilinear interpolation of linear light, to a pinhole camera with the
/// same focal lengths, and cropped to the largest rectangle in which every pixel was seen. PNG and JPEG become EXRs by
/// their color space; straight alpha is composited over the background of the capture. EXRs in which nothing changes
/// stay where they are.
#[derive(Debug, clap::Args)]
struct ConvertArgs {
    /// transforms.json of instant-ngp, nerfstudio or Blender, a model of COLMAP, the folder of either, or a USD stage
    input: PathBuf,
    /// Camera of a USD stage, by its path (default: the only one)
    #[arg(long, value_name = "PRIM")]
    camera: Option<String>,
    /// Folder to write into
    #[arg(long, short, value_name = "DIR")]
    output: PathBuf,
    /// Take the pictures from this folder, by their names, or from a pattern such as renders/view_####.exr or from
    /// these files, in the order of the views; files may be videos, which ffmpeg decodes
    #[arg(long, value_name = "FOLDER|PATTERN|FILE", num_args = 1..)]
    pictures: Vec<PathBuf>,
    /// Frame of videos, counted from 0
    #[arg(long, value_name = "N", default_value_t = 0)]
    frame: u32,
    /// The pictures are photographs, or frames of videos, of a medium in a dark room or before an evenly lit
    /// background: model and background are measured and stated, and the color space of integer samples is sRGB unless
    /// stated
    #[arg(long)]
    photographs: bool,
    /// Description of the cameras
    #[arg(long, value_enum, default_value_t = Target::Transforms)]
    to: Target,
    /// Color space of PNG and JPEG pictures: sRGB, linear or 'gamma 2.2' (default: what capture or picture states)
    #[arg(long, value_name = "NAME")]
    color_space: Option<ColorSpace>,
    /// Radiance behind the volume, over which straight alpha is composited (default: that of the capture, else white)
    #[arg(long, value_name = "R,G,B", value_parser = parse::color)]
    background: Option<[f32; 3]>,
    /// Use of the pixels under a mask
    #[arg(long, value_enum)]
    masked: Option<Masked>,
    /// Layer of EXR pictures, written alone (default: pictures stay as they are)
    #[arg(long, value_name = "NAME")]
    layer: Option<String>,
    /// Factor of all lengths, before --offset
    #[arg(long, value_name = "S", value_parser = parse::positive)]
    scale: Option<f64>,
    /// Translation of the scaled world
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = parse::vector)]
    offset: Option<DVec3>,
    /// Move the point that all cameras look at, by least squares, to the origin; before --scale
    #[arg(long)]
    recenter: bool,
    #[command(flatten)]
    overwrite: Overwrite,
    #[command(flatten)]
    memory: Memory,
}

impl From<ConvertArgs> for CaptureSettings {
    fn from(args: ConvertArgs) -> Self {
        let ConvertArgs { scale, offset, recenter, .. } = args;
        Self {
            input: args.input,
            camera: args.camera,
            output: args.output,
            pictures: args.pictures,
            frame: args.frame,
            photographs: args.photographs,
            to: args.to,
            color_space: args.color_space,
            background: args.background,
            masked: args.masked,
            layer: args.layer,
            placement: Placement { scale, offset: offset.map(|offset| offset.to_array()), recenter },
            overwrite: args.overwrite.into(),
            limits: args.memory.limits(),
        }
    }
}

read_as!(CaptureSettings, ConvertArgs);
