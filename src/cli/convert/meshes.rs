//! Options of meshes.

use crate::app::convert::MeshSettings;
use crate::cli::args::read_as;
use crate::cli::parse::number;

/// Options of meshes.
#[derive(Debug, clap::Args)]
struct MeshArgs {
    /// Mesh to VDB: width of the narrow band to each side of the surface in voxels, 1 to 1000 (default: 3)
    #[arg(long, value_name = "VOXELS", value_parser = half_width)]
    half_width: Option<f64>,
    /// VDB to mesh: how much polygons of nearly one plane are merged, from 0 to 1, where corners go as well (default:
    /// 0)
    #[arg(long, value_name = "SHARE", value_parser = adaptivity)]
    adaptivity: Option<f64>,
}

impl From<MeshArgs> for MeshSettings {
    fn from(args: MeshArgs) -> Self {
        Self { half_width: args.half_width, adaptivity: args.adaptivity }
    }
}

read_as!(MeshSettings, MeshArgs);

fn within(text: &str, low: f64, high: f64) -> Result<f64, String> {
    let within =
        |v| (low..=high).contains(&v).then_some(v).ok_or_else(|| format!("'{text}' must be from {low} to {high}"));
    number(text).and_then(within)
}

fn half_width(text: &str) -> Result<f64, String> {
    within(text, 1.0, 1000.0)
}

fn adaptivity(text: &str) -> Result<f64, String> {
    within(text, 0.0, 1.0)
}
