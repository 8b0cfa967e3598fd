//! `cumulo viewpoint`: the viewpoints from which a volume shows most.

use super::args::read_as;
use super::args::single::{Integration, Overwrite, PageFolder, Resume, ScalarGrid};
use super::memory::Memory;
use super::parse;
use crate::app::pictures::DensityScale;
use crate::app::scan::ScanSettings;
use crate::app::transfer::TransferSettings;
use crate::app::up::UpChoice;
use crate::app::viewpoint::ViewpointSettings;
use std::path::PathBuf;

/// Find the viewpoints from which a volume shows most
///
/// Cameras stand on a sphere around the volume and face its centre. Those from which the opacity entropy of the
/// picture is largest are written as a capture, the best first; --pictures renders them, too. Ctrl-C writes what is
/// there (exit code 130); --resume goes on from it.
#[derive(Debug, clap::Args)]
struct ViewpointArgs {
    /// VDB, NanoVDB or scan to look at
    input: PathBuf,
    /// Capture (JSON) for the cameras
    #[arg(long, short, value_name = "OUT.json")]
    output: PathBuf,
    /// Render the cameras' pictures into this folder (default: cameras alone)
    #[arg(long, value_name = "DIR")]
    pictures: Option<PathBuf>,
    #[command(flatten)]
    overwrite: Overwrite,
    /// Number of viewpoints to start from: the search begins at the best of each and a dozen about it, on small
    /// pictures
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    starts: u32,
    /// Evaluations from each start, at most, for each size of picture that the search goes through
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    iterations: u32,
    /// Let cameras stand in the upper half of the sphere alone, about the up axis: never below the volume
    #[arg(long)]
    hemisphere: bool,
    /// Number of viewpoints, spread evenly over the sphere, to evaluate as well for comparison
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=1_000_000))]
    samples: u32,
    /// Size of the pictures in pixels
    #[arg(long, value_name = "WxH", default_value = "256x256", value_parser = parse::size)]
    size: [u32; 2],
    /// Angle of view in degrees that holds the volume's bounding sphere: it sets how far away the cameras stand
    #[arg(long, value_name = "DEGREES", default_value_t = 40.0, value_parser = parse::angle)]
    fov: f64,
    /// Axis that points upwards, with respect to which cameras stand upright
    #[arg(long, value_enum, value_name = "AXIS", default_value_t = UpChoice::Auto)]
    up: UpChoice,
    /// Extinction per world unit at a density of 1; auto makes the 99th percentile of the optical depth 3
    #[arg(long, value_name = "S|auto", default_value = "1")]
    density_scale: DensityScale,
    /// Radiance behind the volume in the pictures, r,g,b (default: white, black with a transfer function)
    #[arg(long, value_name = "R,G,B", value_parser = parse::color)]
    background: Option<[f32; 3]>,
    #[command(flatten)]
    transfer: TransferSettings,
    #[command(flatten)]
    quadrature: Integration,
    #[command(flatten)]
    grid: ScalarGrid,
    #[command(flatten)]
    scan: ScanSettings,
    /// Start from the viewpoints of this capture as well, whatever made it
    #[arg(long, value_name = "IN.json")]
    init: Option<PathBuf>,
    #[command(flatten)]
    resume: Resume,
    #[command(flatten)]
    report: PageFolder,
    #[command(flatten)]
    memory: Memory,
}

impl From<ViewpointArgs> for ViewpointSettings {
    fn from(args: ViewpointArgs) -> Self {
        Self {
            input: args.input,
            output: args.output,
            pictures: args.pictures,
            overwrite: args.overwrite.into(),
            starts: args.starts,
            iterations: args.iterations,
            hemisphere: args.hemisphere,
            samples: args.samples,
            size: args.size,
            fov: args.fov,
            up: args.up,
            density_scale: args.density_scale,
            background: args.background,
            transfer: args.transfer,
            quadrature: args.quadrature.into(),
            grid: args.grid.into(),
            scan: args.scan,
            init: args.init,
            resume: args.resume.into(),
            report: args.report.into(),
            limits: args.memory.limits(),
        }
    }
}

read_as!(ViewpointSettings, ViewpointArgs);
