//! `cumulo usd author`: a stage of volumes, with their media, lights and cameras.

use crate::app::up::UpChoice;
use crate::app::usd::author::AuthorSettings;
use crate::cli::args::lights::Lights;
use crate::cli::args::read_as;
use crate::cli::args::single::Overwrite;
use crate::cli::memory::Memory;
use crate::cli::parse;
use crate::formats::sequence::Frames;
use crate::formats::usd::write::material::Renderer;
use std::path::PathBuf;

/// Write a stage of volumes, with their media, lights and cameras
///
/// The stage is text (.usda). Its paths are relative to it; a sequence has the numbers of its frames as time codes. The
/// medium stands at the volume as attributes `cumulo:…`, and as materials for other renderers in the variant set
/// `renderer`.
#[derive(Debug, clap::Args)]
struct AuthorArgs {
    /// VDB, sequence such as smoke.####.vdb, or scene file (`cumulo schema scene`)
    input: PathBuf,
    /// Stage to write, a .usda
    #[arg(long, short, value_name = "STAGE")]
    output: PathBuf,
    /// Frames of a sequence, such as 1-24 (default: those that exist)
    #[arg(long, value_name = "FRAMES")]
    frames: Option<Frames>,
    /// Frames per second
    #[arg(long, value_name = "F", default_value_t = 24.0, value_parser = parse::positive)]
    fps: f64,
    /// Grids that become fields (default: all)
    #[arg(long, value_name = "NAME")]
    grid: Vec<String>,
    /// Grid of densities, related as field:density (default: density, else the only scalar one)
    #[arg(long, value_name = "NAME")]
    density: Option<String>,
    /// Axis that points upwards; coordinates stay as they are
    #[arg(long, alias = "up-axis", value_enum, ignore_case = true, default_value_t)]
    up: UpChoice,
    /// Meters to a unit; coordinates stay as they are
    #[arg(long, value_name = "M", default_value_t = 1.0, value_parser = parse::positive)]
    meters_per_unit: f64,
    /// Cameras of a capture, one prim for each view
    #[arg(long, value_name = "CAPTURE")]
    camera: Option<PathBuf>,
    /// Make them one camera that is at view N at the time code N
    #[arg(long, requires = "camera")]
    camera_path: bool,
    /// Extinction per unit of density and length (default: 1)
    #[arg(long, value_name = "S", value_parser = parse::positive)]
    density_scale: Option<f64>,
    /// Share of the extinction that is scattered, one number or r,g,b from 0 to 1 (default: 0)
    #[arg(long, value_name = "A", value_parser = parse::albedo)]
    albedo: Option<[f32; 3]>,
    /// Mean cosine of the angle by which scattered light turns: -0.999 backward to 0.999 forward (default: 0)
    #[arg(long, value_name = "G", value_parser = parse::number, requires = "albedo", allow_negative_numbers = true)]
    anisotropy: Option<f64>,
    /// Factors of the extinction in red, green and blue (default: 1)
    #[arg(long, value_name = "R,G,B", value_parser = parse::color)]
    extinction_color: Option<[f32; 3]>,
    /// Radiance of the source; of it the share of the extinction that is not scattered is emitted
    #[arg(long, value_name = "R,G,B", value_parser = parse::color, conflicts_with = "tf")]
    emission: Option<[f32; 3]>,
    /// Transfer function from density to color and extinction
    #[arg(long, value_name = "FILE")]
    tf: Option<PathBuf>,
    #[command(flatten)]
    lights: Lights,
    /// Renderer whose material is bound; the others stay in the variant set `renderer`
    #[arg(long, value_enum, default_value_t = Renderer::None)]
    renderer: Renderer,
    #[command(flatten)]
    overwrite: Overwrite,
    #[command(flatten)]
    memory: Memory,
}

impl From<AuthorArgs> for AuthorSettings {
    fn from(args: AuthorArgs) -> Self {
        Self {
            input: args.input,
            output: args.output,
            frames: args.frames,
            fps: args.fps,
            grid: args.grid,
            density: args.density,
            up: args.up,
            meters_per_unit: args.meters_per_unit,
            camera: args.camera,
            camera_path: args.camera_path,
            density_scale: args.density_scale,
            albedo: args.albedo,
            anisotropy: args.anisotropy,
            extinction_color: args.extinction_color,
            emission: args.emission,
            tf: args.tf,
            sun: args.lights.sun(),
            sun_color: args.lights.sun_color,
            sun_angle: args.lights.sun_angle,
            sky: args.lights.sky,
            renderer: args.renderer,
            overwrite: args.overwrite.into(),
            limits: args.memory.limits(),
        }
    }
}

read_as!(AuthorSettings, AuthorArgs);
