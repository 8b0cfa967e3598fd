//! `cumulo plan`: which effects of a scene are simulated, at what cost, and what is left out; or what a reconstruction
//! will take.

use super::args::density::DensityCost;
use super::args::read_as;
use super::args::single::Layer;
use crate::app::pictures::PictureSettings;
use crate::app::plan::PlanSettings;
use crate::app::reconstruct::{CapturePlanSettings, RegionSettings, ScalingSettings};
use crate::cli::parse;

/// Tell which effects `render` would simulate, what they cost, and how much radiance is left out at most; of a capture,
/// what `reconstruct density` would take
///
/// Takes the options of render. Effects that a scene does not call for are off and cost nothing; with --max-omitted,
/// more of them are left out as long as the sum of their bounds stays below that radiance, or of the limits of what
/// they contribute to the pictures, measured now on a few paths of each block of 8 x 8 pixels. Costs are those of small
/// pictures, rendered now.
///
/// Of a capture (a transforms.json, a model of COLMAP, or the folder of either) it tells the unknowns, the memory and
/// the time of its reconstruction on this machine and on several, by the headers of all pictures, the pixels of eight
/// and a short search with these. It takes the options of `reconstruct density` that decide the cost.
#[derive(Debug, clap::Args)]
struct PlanArgs {
    /// Frame of a sequence (default: the first)
    #[arg(long, value_name = "N")]
    frame: Option<u32>,
    #[command(flatten)]
    pictures: PictureSettings,
    #[command(flatten)]
    reconstruction: CapturePlanSettings,
}

// Options of the plan of a reconstruction.
#[derive(Debug, clap::Args)]
struct CapturePlanArgs {
    #[command(flatten)]
    region: RegionSettings,
    #[command(flatten)]
    cost: DensityCost,
    #[command(flatten)]
    layer: Layer,
    /// Numbers of machines like this one on which cumulo-mpi reconstructs a capture [default: 1,2,4 ... 1024]
    #[arg(long, value_name = "N,M", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(1..=65_536))]
    machines: Vec<u32>,
    /// Bandwidth of the network between machines, in Gbit/s
    #[arg(long = "bandwidth", value_name = "GBITS", default_value_t = 25.0, value_parser = parse::positive)]
    network_bandwidth: f64,
    /// Latency of the network between machines, in microseconds
    #[arg(long, value_name = "US", default_value_t = 20.0, value_parser = parse::not_negative)]
    latency: f64,
    /// Part of a machine's time between two exchanges that varies at random
    #[arg(long, value_name = "PART", default_value_t = 0.02, value_parser = parse::share)]
    delay: f64,
}

impl From<CapturePlanArgs> for CapturePlanSettings {
    fn from(args: CapturePlanArgs) -> Self {
        let CapturePlanArgs { machines, network_bandwidth: bandwidth, latency, delay, .. } = args;
        Self {
            region: args.region,
            solver: args.cost.solver,
            held_out: args.cost.held_out.into(),
            iterations: args.cost.iterations,
            smoothing: args.cost.smoothing,
            layer: args.layer.into(),
            scaling: ScalingSettings { machines, bandwidth, latency, delay },
        }
    }
}

read_as!(CapturePlanSettings, CapturePlanArgs);

impl From<PlanArgs> for PlanSettings {
    fn from(args: PlanArgs) -> Self {
        Self { frame: args.frame, pictures: args.pictures, reconstruction: args.reconstruction }
    }
}

read_as!(PlanSettings, PlanArgs);
