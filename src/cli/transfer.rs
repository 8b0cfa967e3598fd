//! `cumulo transfer`: transfer functions, or volumes that want one, in, `.tf.json` out.

use super::args::read_as;
use super::args::single::ScalarGrid;
use super::memory::Memory;
use super::parse::{ascending, positive};
use crate::app::function::FunctionSettings;
use crate::app::scan::ScanSettings;
use std::path::PathBuf;

/// Show a transfer function, convert it to .tf.json, or suggest one for a volume
///
/// Read are .tf.json, color map presets of ParaView (JSON and XML), and VDBs whose grids carry one; content tells
/// which. ParaView's display-referred colors become scene-linear, its opacities extinctions. Color maps and medical
/// presets are there by name: see --list. --suggest finds the boundaries between a volume's materials by its histogram
/// and gradients (Kindlmann and Durkin), and makes functions that show them, in the data's own units.
#[derive(Debug, clap::Args)]
#[command(group = clap::ArgGroup::new("suggested").args(["grid"]).requires("suggest"))]
struct FunctionArgs {
    /// Transfer function to read: a file, or a name such as viridis or ct-bone
    #[arg(required_unless_present_any = ["list", "suggest"])]
    input: Option<PathBuf>,
    /// List the transfer functions that are there by name, with their ranges
    #[arg(long, conflicts_with_all = ["input", "output", "preset", "range", "unit_distance", "extinction"])]
    list: bool,
    /// Suggest functions that suit this VDB, NanoVDB or scan
    #[arg(
        long,
        value_name = "V",
        conflicts_with_all = ["input", "list", "preset", "range", "unit_distance", "extinction"],
    )]
    suggest: Option<PathBuf>,
    /// Which suggested function to write, from 1 (default: all boundaries together)
    #[arg(long, value_name = "N", requires = "suggest", value_parser = clap::value_parser!(u32).range(1..))]
    candidate: Option<u32>,
    /// Draw a sheet of all suggested functions to this PNG
    #[arg(long, value_name = "PNG", requires = "suggest")]
    sheet: Option<PathBuf>,
    #[command(flatten)]
    grid: ScalarGrid,
    #[command(flatten)]
    scan: ScanSettings,
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
        Self {
            input: args.input,
            suggest: args.suggest,
            candidate: args.candidate,
            sheet: args.sheet,
            grid: args.grid.into(),
            scan: args.scan,
            output: args.output,
            preset: args.preset,
            range: args.range,
            unit_distance: args.unit_distance,
            extinction: args.extinction,
            limits: args.memory.limits(),
        }
    }
}

read_as!(FunctionSettings, FunctionArgs);
