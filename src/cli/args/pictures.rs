//! Options of what pictures show, and from where.

use super::read_as;
use super::single::{Integration, ScalarGrid};
use crate::app::pictures::scattering::ScatteringSettings;
use crate::app::pictures::{AimSettings, DensityScale, PictureSettings, PlanningSettings};
use crate::app::scan::ScanSettings;
use crate::app::transfer::TransferSettings;
use crate::app::up::UpChoice;
use crate::cli::memory::Memory;
use crate::cli::parse;
use crate::cli::values::choice;
use crate::formats::sequence::Frames;
use crate::plan::Effect;
use crate::scene::camera::Window;
use crate::scene::capture::{EmissionModel, Model};
use crate::scene::orbit::Layout;
use crate::scene::shading::Shading;
use std::path::PathBuf;
use std::str::FromStr;

/// Options that pictures are made by: subject, cameras, media and light.
#[derive(Debug, clap::Args)]
struct PictureArgs {
    /// VDB, NanoVDB, scan, USD stage, or scene file in JSON (`cumulo schema scene`), to render; smoke.####.vdb,
    /// smoke.%04d.vdb, smoke.$F4.vdb, smoke.0001-0100.vdb and folders of numbered VDBs are sequences
    input: PathBuf,
    /// Place this many cameras around the volume
    #[arg(
        long,
        value_name = "N",
        conflicts_with = "cameras",
        value_parser = clap::value_parser!(u32).range(1..=100_000),
    )]
    views: Option<u32>,
    #[command(flatten)]
    aim: AimSettings,
    /// Axis that points upwards, about which cameras are placed
    #[arg(long, value_enum, value_name = "AXIS", default_value_t = UpChoice::Auto, conflicts_with = "cameras")]
    up: UpChoice,
    /// Render these of the views alone, counted from 0: numbers and ranges such as 0,4-7
    #[arg(long, value_name = "N,M-K", value_delimiter = ',')]
    view: Vec<Frames>,
    /// How --views are placed: over the whole sphere, or on the horizontal circle
    #[arg(long, value_parser = choice::<Layout>(), default_value = "sphere", conflicts_with = "cameras")]
    layout: Layout,
    /// Size of the pictures in pixels. Focal lengths of a capture's cameras scale along; in other proportions the whole
    /// picture stays in view, and more is shown beside it (default: 256x256; that of a capture's pictures; of a stage's
    /// camera 256 wide, in the proportions of its aperture)
    #[arg(long, value_name = "WxH", value_parser = parse::size)]
    size: Option<[u32; 2]>,
    /// Angle of view in degrees that holds the volume's bounding sphere: it sets how far away the cameras of --views
    /// stand; the volume fills the pictures whatever it is. With --distance or --eye, the angle across the shorter side
    /// of the picture
    #[arg(
        long,
        value_name = "DEGREES",
        default_value_t = 40.0,
        value_parser = parse::angle,
        conflicts_with = "cameras",
    )]
    fov: f64,
    /// Render a part of each picture: x0,y0,x1,y1 in pixels, x1 and y1 not included, or column, row and size
    #[arg(long, value_name = "X0,Y0,X1,Y1|X,Y,WxH", value_parser = parse::window)]
    crop: Option<Window>,
    /// Take the cameras from a transforms.json, a model of COLMAP or a USD stage (default: those of the stage that is
    /// rendered). A transforms.json also gives the model, density scale, background, emission and transfer function
    /// that no option gives; with --albedo, the density scale and transfer function alone. Albedo and lights are not
    /// taken. It stays as it is: pictures go to another folder
    #[arg(long, value_name = "CAPTURE|STAGE")]
    cameras: Option<PathBuf>,
    /// Camera of the USD stage, by its path (default: the only one)
    #[arg(long, value_name = "PRIM", conflicts_with = "views")]
    camera: Option<String>,
    /// Model of the pictures (default: that of --cameras, emission-absorption with a transfer function, else
    /// absorption)
    #[arg(long, value_parser = choice::<Model>(), conflicts_with = "tf")]
    model: Option<Model>,
    /// Extinction per world unit at a density of 1 (per millimeter in a volume whose voxels are measured in mm); auto
    /// makes the 99th percentile of the optical depth 3 (default: that of --cameras, else 1)
    #[arg(long, value_name = "S|auto")]
    density_scale: Option<DensityScale>,
    /// Radiance behind the volume, r,g,b (default: that of --cameras, else white for absorption, black for
    /// emission-absorption)
    #[arg(long, value_name = "R,G,B", value_parser = parse::color)]
    background: Option<[f32; 3]>,
    /// Radiance of the source, r,g,b (default: that of --cameras, else white)
    #[arg(long, value_name = "R,G,B", value_parser = parse::color, conflicts_with = "tf")]
    emission: Option<[f32; 3]>,
    /// How that radiance follows the density (default: that of --cameras, else grey: not at all)
    #[arg(long, value_parser = choice::<EmissionModel>(), conflicts_with = "tf")]
    emission_model: Option<EmissionModel>,
    #[command(flatten)]
    transfer: TransferSettings,
    #[command(flatten)]
    quadrature: Integration,
    /// Shade the surfaces that the transfer function shows by a light at the camera (Blinn-Phong across the gradient of
    /// the density): shares of the color in all directions and facing the camera, highlight and its exponent
    /// [default of what is left out: 0.2,0.8,0.15,20]
    #[arg(
        long,
        value_name = "AMBIENT,DIFFUSE,SPECULAR,EXPONENT",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "0.2,0.8,0.15,20",
        conflicts_with = "albedo",
    )]
    shade: Option<Shading>,
    /// Transmittance at which rays end (0: never); the report says how far that may be off
    #[arg(long, value_name = "T", default_value_t = 1e-6, value_parser = parse::share)]
    early_stop: f64,
    /// Rays along each edge of a pixel; more than one make it the mean over its square
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=64))]
    supersample: u32,
    #[command(flatten)]
    grid: ScalarGrid,
    #[command(flatten)]
    scan: ScanSettings,
    #[command(flatten)]
    scattering: ScatteringSettings,
    #[command(flatten)]
    planning: PlanningSettings,
    #[command(flatten)]
    memory: Memory,
}

impl From<PictureArgs> for PictureSettings {
    fn from(args: PictureArgs) -> Self {
        Self {
            frame: None,
            limits: args.memory.limits(),
            input: args.input,
            views: args.views,
            aim: args.aim,
            up: args.up,
            view: args.view,
            layout: args.layout,
            size: args.size,
            fov: args.fov,
            crop: args.crop,
            cameras: args.cameras,
            camera: args.camera,
            model: args.model,
            density_scale: args.density_scale,
            background: args.background,
            emission: args.emission,
            emission_model: args.emission_model,
            transfer: args.transfer,
            quadrature: args.quadrature.into(),
            shade: args.shade,
            early_stop: args.early_stop,
            supersample: args.supersample,
            grid: args.grid.into(),
            scan: args.scan,
            scattering: args.scattering,
            planning: args.planning,
        }
    }
}

read_as!(PictureSettings, PictureArgs);

/// Options of what may be left out of pictures.
#[derive(Debug, clap::Args)]
struct PlanningArgs {
    /// Leave out effects as long as no channel misses more radiance than this: of a pixel, where bounds prove it, else
    /// of a block of 8 x 8 pixels, as measured with a confidence of 95 %. It is a radiance, whatever the brightness of
    /// the pictures
    #[arg(long, value_name = "E", default_value_t = 0.0, value_parser = parse::not_negative)]
    max_omitted: f64,
    /// Keep effects whatever they add: emission, scattering, multiple-scattering, environment or light-N
    #[arg(long, value_name = "EFFECT,...", value_delimiter = ',')]
    force: Vec<Effect>,
}

impl From<PlanningArgs> for PlanningSettings {
    fn from(args: PlanningArgs) -> Self {
        Self { max_omitted: args.max_omitted, force: args.force }
    }
}

read_as!(PlanningSettings, PlanningArgs);

impl FromStr for DensityScale {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "auto" { Ok(Self::Auto) } else { parse::positive(text).map(Self::Given) }
    }
}
