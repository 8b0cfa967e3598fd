//! `cumulo transfer`: transfer functions in, `.tf.json` out.

use super::args::read_as;
use super::memory::Memory;
use super::parse::{ascending, positive};
use crate::app::function::FunctionSettings;
use std::path::PathBuf;

/// Show a transfer function, or convert it to .tf.json
///
/// Read are .tf.json, color map presets of ParaView (JSON and XML), and VDBs whose grids carry one; content tells
/// which. ParaView's display-referred colors become scene-linear, its opacities extinctions. Color maps and medical
/// presets are there by name: see --list.
#[derive(Debug, clap::Args)]
struct FunctionArgs {
    /// Transfer function to read: a file, or a name such as viridis or ct-bone
    #[arg(required_unless_present = "list")]
    input: Option<PathBuf>,
    /// List the transfer functions that are there by name, with their ranges
    #[arg(long, conflicts_with_all = ["input", "output", "preset", "range", "unit_distance", "extinction"])]
    list: bool,
    /// Write it to this .tf.json
    #[arg(long, short, value_name = "OUT")]
    output: Option<PathBuf>,
    /// Which of several: the preset of this name, in a VDB that of this grid (default: the first)
    #[arg(long, value_name = "NAME")]
    preset: Option<String>,
    /// Map its densities to this range
    #[arg(long, value_name = "LOW,HIGH", value_parser = ascending, allow_hyphen_values = true)]
    range: Option<[f64; 2]>,
    /// World length that the opacities of a preset are for (default: 1)
    #[arg(long, value_name = "U", value_parser = positive)]
    unit_distance: Option<f64>,
    /// Extinction per world unit at the upper end of a color map or preset without opacities (default: 1)
    #[arg(long, value_name = "S", value_parser = positive)]
    extinction: Option<f64>,
    #[command(flatten)]
    memory: Memory,
}

impl From<FunctionArgs> for FunctionSettings {
    fn from(args: FunctionArgs) -> Self {
        // Without an input all are listed.
        let FunctionArgs { input, list: _, output, preset, range, unit_distance, extinction, memory } = args;
        Self { input, output, preset, range, unit_distance, extinction, limits: memory.limits() }
    }
}

read_as!(FunctionSettings, FunctionArgs);
