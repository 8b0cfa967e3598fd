//! Options of what pictures show, and from where.

use super::planning::PlanningOptions;
use super::scattering::ScatteringOptions;
use crate::cli::memory::Memory;
use crate::cli::parse::{self, DensityScale};
use crate::cli::transfer::TransferOption;
use crate::cli::up::UpChoice;
use crate::formats::sequence::Frames;
use crate::render::quadrature::{Quadrature, rules};
use crate::scene::camera::Window;
use crate::scene::capture::{EmissionModel, Model};
use crate::scene::orbit::Layout;
use std::path::{Path, PathBuf};

/// Options that pictures are made by: subject, cameras, media and light.
#[derive(Debug, Clone, clap::Args)]
pub struct PictureOptions {
    /// VDB, USD stage, or scene file in JSON (`cumulo schema scene`), to render; smoke.####.vdb, smoke.%04d.vdb,
    /// smoke.$F4.vdb, smoke.0001-0100.vdb and folders of numbered VDBs are sequences
    pub(in crate::cli) input: PathBuf,
    /// Number of the frame, where a sequence is rendered.
    #[arg(skip)]
    pub(in crate::cli) frame: Option<u32>,
    /// Place this many cameras around the volume
    #[arg(long, value_name = "N", conflicts_with = "cameras", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub(in crate::cli) views: Option<u32>,
    /// Axis that points upwards, about which --views are placed
    #[arg(long, value_enum, value_name = "AXIS", default_value_t = UpChoice::Auto, conflicts_with = "cameras")]
    pub(in crate::cli) up: UpChoice,
    /// Render these of the views alone, counted from 0: numbers and ranges such as 0,4-7
    #[arg(long, value_name = "N,M-K", value_delimiter = ',')]
    pub(in crate::cli) view: Vec<Frames>,
    /// How --views are placed: over the whole sphere, or on the horizontal circle
    #[arg(long, value_enum, default_value_t = Layout::Sphere, conflicts_with = "cameras")]
    pub(in crate::cli) layout: Layout,
    /// Size of the pictures in pixels. Focal lengths of a capture's cameras scale along; in other proportions the whole
    /// picture stays in view, and more is shown beside it (default: 256x256; that of a capture's pictures; of a stage's
    /// camera 256 wide, in the proportions of its aperture)
    #[arg(long, value_name = "WxH", value_parser = parse::size)]
    pub(in crate::cli) size: Option<[u32; 2]>,
    /// Angle of view in degrees that holds the volume's bounding sphere: it sets how far away the cameras of --views stand;
    /// the volume fills the pictures whatever it is
    #[arg(long, value_name = "DEGREES", default_value_t = 40.0, value_parser = parse::angle, conflicts_with = "cameras")]
    pub(in crate::cli) fov: f64,
    /// Render a part of each picture: x0,y0,x1,y1 in pixels, x1 and y1 not included, or column, row and size
    #[arg(long, value_name = "X0,Y0,X1,Y1|X,Y,WxH", value_parser = parse::window)]
    pub(in crate::cli) crop: Option<Window>,
    /// Take the cameras from a transforms.json, a model of COLMAP or a USD stage (default: those of the stage that is
    /// rendered). A transforms.json also gives the model, density scale, background, emission and transfer function that
    /// no option gives; with --albedo, the density scale and transfer function alone. Albedo and lights are not taken. It
    /// stays as it is: pictures go to another folder
    #[arg(long, value_name = "CAPTURE|STAGE")]
    pub(in crate::cli) cameras: Option<PathBuf>,
    /// Camera of the USD stage, by its path (default: the only one)
    #[arg(long, value_name = "PRIM", conflicts_with = "views")]
    pub(in crate::cli) camera: Option<String>,
    /// Model of the pictures (default: that of --cameras, emission-absorption with a transfer function, else absorption)
    #[arg(long, value_enum, conflicts_with = "tf")]
    pub(in crate::cli) model: Option<Model>,
    /// Extinction per world unit at a density of 1 (per millimeter in a volume whose voxels are measured in mm); auto makes
    /// the 99th percentile of the optical depth 3 (default: that of --cameras, else 1)
    #[arg(long, value_name = "S|auto")]
    pub(in crate::cli) density_scale: Option<DensityScale>,
    /// Radiance behind the volume, r,g,b (default: that of --cameras, else white for absorption, black for
    /// emission-absorption)
    #[arg(long, value_name = "R,G,B", value_parser = parse::color)]
    pub(in crate::cli) background: Option<[f32; 3]>,
    /// Radiance of the source, r,g,b (default: that of --cameras, else white)
    #[arg(long, value_name = "R,G,B", value_parser = parse::color, conflicts_with = "tf")]
    pub(in crate::cli) emission: Option<[f32; 3]>,
    /// How that radiance follows the density (default: that of --cameras, else grey: not at all)
    #[arg(long, value_enum, conflicts_with = "tf")]
    pub(in crate::cli) emission_model: Option<EmissionModel>,
    #[command(flatten)]
    pub(in crate::cli) transfer: TransferOption,
    #[arg(
        long,
        value_name = "Q",
        help = concat!(
            "Integration along rays: ",
            rules!(),
            "; by default exact, and preintegrated through functions of more than 32 points",
        )
    )]
    pub(in crate::cli) quadrature: Option<Quadrature>,
    /// Transmittance at which rays end (0: never); the report says how far that may be off
    #[arg(long, value_name = "T", default_value_t = 1e-6, value_parser = parse::share)]
    pub(in crate::cli) early_stop: f64,
    /// Rays along each edge of a pixel; more than one make it the mean over its square
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=64))]
    pub(in crate::cli) supersample: u32,
    /// Grid to render (default: density, else the only scalar one)
    #[arg(long, value_name = "NAME")]
    pub(in crate::cli) grid: Option<String>,
    #[command(flatten)]
    pub(in crate::cli) scattering: ScatteringOptions,
    #[command(flatten)]
    pub(in crate::cli) planning: PlanningOptions,
    #[command(flatten)]
    pub(in crate::cli) memory: Memory,
}

impl PictureOptions {
    /// Paths that the pictures are made from.
    pub(in crate::cli) fn inputs(&self) -> Vec<&Path> {
        let others = [self.transfer.file(), self.scattering.sky_file(), self.cameras.as_deref()];
        std::iter::once(self.input.as_path()).chain(others.into_iter().flatten()).collect()
    }
}
