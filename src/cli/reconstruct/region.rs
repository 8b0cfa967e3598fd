//! Where the unknown voxels of a reconstruction lie.

use crate::cli::parse;
use crate::error::Result;
use crate::math::{Aabb, Affine};
use crate::optimise::hull::Hull;
use crate::optimise::lattice;
use crate::optimise::observation::Observation;
use crate::scene::capture::Capture;

/// Options for the voxels.
#[derive(Debug, clap::Args)]
pub(super) struct Region {
    /// Edge of the voxels in world units (default: the capture's lattice, else a pixel's size in the volume)
    #[arg(long, value_name = "S", value_parser = parse::positive)]
    voxel_size: Option<f64>,
    /// Voxels along the longest edge of the region instead
    #[arg(long, value_name = "N", conflicts_with = "voxel_size", value_parser = clap::value_parser!(u32).range(1..=65_536))]
    resolution: Option<u32>,
    /// Region in world space, x0,y0,z0,x1,y1,z1; auto: where no picture shows that there is nothing
    #[arg(long, value_name = "auto|BOX", default_value = "auto", allow_hyphen_values = true, value_parser = bounds)]
    bounds: Bounds,
}

/// `--bounds`.
#[derive(Debug, Clone, Copy)]
enum Bounds {
    Auto,
    Given(Aabb),
}

fn bounds(text: &str) -> Result<Bounds, String> {
    if text == "auto" { Ok(Bounds::Auto) } else { parse::corners(text).map(Bounds::Given) }
}

impl Region {
    /// The lattice, index to world, and the world box of the unknowns.
    ///
    /// # Errors
    /// If the pictures leave nothing, or the lattice is not usable.
    pub fn choose(&self, capture: &Capture, observation: &Observation) -> Result<(Affine, Aabb)> {
        let bounds = match self.bounds {
            Bounds::Given(bounds) => bounds,
            Bounds::Auto => Hull::new(observation).bounds()?,
        };
        let voxel_size = match (self.voxel_size, self.resolution) {
            (Some(size), _) => Some(size),
            (None, Some(count)) => Some(lattice::divided(&bounds, count)?),
            (None, None) if capture.lattice.is_some() => None,
            (None, None) => lattice::footprint(&observation.maps, &bounds),
        };
        Ok((lattice::choose(capture.lattice, voxel_size)?, bounds))
    }
}
