//! `--tf` of the commands that take a transfer function.

use super::read_as;
use crate::app::transfer::TransferSettings;
use crate::cli::parse::{ascending, positive};
use std::path::PathBuf;

/// The transfer function that a command uses.
#[derive(Debug, clap::Args)]
struct TransferArgs {
    /// Transfer function: a .tf.json, a color map preset of ParaView (JSON, XML), a VDB that carries one, or a name
    /// such as viridis, diverging or ct-bone (`cumulo transfer --list` shows all). Values are taken as they are, in its
    /// unit: signed ones, such as Hounsfield units, and any background
    #[arg(long = "tf", value_name = "FILE|NAME")]
    tf: Option<PathBuf>,
    /// Which of several in --tf: the preset of this name, in a VDB that of this grid (default: the first)
    #[arg(long, value_name = "NAME", requires = "tf")]
    tf_preset: Option<String>,
    /// Map the densities of --tf to this range
    #[arg(long, value_name = "LOW,HIGH", value_parser = ascending, allow_hyphen_values = true, requires = "tf")]
    tf_range: Option<[f64; 2]>,
    /// World length that the opacities of a preset are for (default: 1)
    #[arg(long, value_name = "U", value_parser = positive, requires = "tf")]
    tf_unit_distance: Option<f64>,
    /// Extinction per world unit (per millimeter in a volume whose voxels are measured in mm) at the upper end of a
    /// color map or preset without opacities (default: 1)
    #[arg(long, value_name = "S", value_parser = positive, requires = "tf")]
    tf_extinction: Option<f64>,
}

impl From<TransferArgs> for TransferSettings {
    fn from(args: TransferArgs) -> Self {
        let TransferArgs { tf, tf_preset, tf_range, tf_unit_distance, tf_extinction } = args;
        Self { tf, tf_preset, tf_range, tf_unit_distance, tf_extinction }
    }
}

read_as!(TransferSettings, TransferArgs);
