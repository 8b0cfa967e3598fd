//! Lattice and bounds of the voxels that a reconstruction determines.

use super::read_as;
use crate::app::reconstruct::RegionSettings;
use crate::cli::parse;

/// Options for the lattice and the bounds of the unknown voxels.
#[derive(Debug, clap::Args)]
struct RegionArgs {
    /// Edge of the voxels in world units (default: the capture's lattice, else a pixel's size in the volume)
    #[arg(long, value_name = "S", value_parser = parse::positive)]
    voxel_size: Option<f64>,
    /// Voxels along the longest edge of the region instead
    #[arg(
        long,
        value_name = "N",
        conflicts_with = "voxel_size",
        value_parser = clap::value_parser!(u32).range(1..=65_536),
    )]
    resolution: Option<u32>,
    /// Region in world space, x0,y0,z0,x1,y1,z1; auto: where no picture shows that there is nothing
    #[arg(long, value_name = "auto|BOX", default_value = "auto", allow_hyphen_values = true, value_parser = bounds)]
    bounds: Bounds,
}

/// `--bounds`.
#[derive(Debug, Clone, Copy)]
enum Bounds {
    Auto,
    Given([[f64; 3]; 2]),
}

fn bounds(text: &str) -> Result<Bounds, String> {
    if text == "auto" {
        return Ok(Bounds::Auto);
    }
    parse::corners(text).map(|given| Bounds::Given([given.min.to_array(), given.max.to_array()]))
}

impl From<RegionArgs> for RegionSettings {
    fn from(args: RegionArgs) -> Self {
        let bounds = match args.bounds {
            Bounds::Auto => None,
            Bounds::Given(corners) => Some(corners),
        };
        Self { voxel_size: args.voxel_size, resolution: args.resolution, bounds }
    }
}

read_as!(RegionSettings, RegionArgs);
