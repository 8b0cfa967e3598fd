//! `cumulo convert`: volumes and pictures from one file format to another.
//!
//! [`Kind`] names the formats. A route from one to another is an arm of [`Convert::run`], and a file of its own here.

mod arrays;
mod edits;
mod form;
mod frames;
mod grids;
mod names;
mod sources;
mod turn;

use super::frames::FramesOption;
use super::memory::Memory;
use super::output::Output;
use super::parse::{corners, not_negative, positive};
use super::transfer::TransferOption;
use crate::error::{Error, Result};
use crate::formats::vdb::Codec;
use crate::formats::{Format, npy, sniff};
use crate::math::Aabb;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Copy a VDB, choosing, cropping, resampling, repairing or repacking its grids; or turn grids and pictures into arrays
///
/// The names tell the formats: VDB to VDB with edits; VDB to .npy, a grid over the box of its active voxels, array[x, y, z]
/// (of vectors array[x, y, z, component]); .npy to VDB; EXR to .npy, a layer as array[row, column, channel], row 0 at the
/// top; .npy to EXR. Arrays are single precision, the last axis fastest; the report has the places of voxels.
///
/// Of a sequence, 'in.####.vdb' or a folder of numbered files, every frame is converted: to 'out.####.vdb', or to the same names
/// in another folder.
#[derive(Debug, Clone, clap::Args)]
pub struct Convert {
    /// VDB, EXR or .npy to read
    input: PathBuf,
    /// VDB, .npy or EXR to write
    output: PathBuf,
    #[command(flatten)]
    frames: FramesOption,
    /// Keep only this grid (repeatable)
    #[arg(long, value_name = "NAME")]
    grid: Vec<String>,
    /// Rename a grid (repeatable)
    #[arg(long, value_name = "OLD=NEW", value_parser = renaming)]
    rename: Vec<(String, String)>,
    /// Store real values as 16-bit floats
    #[arg(long)]
    half: bool,
    /// How values are packed
    #[arg(long, value_enum, default_value_t)]
    codec: Codec,
    /// Keep only what lies in this world-space box
    #[arg(long, value_name = "X0,Y0,Z0,X1,Y1,Z1", value_parser = corners, allow_hyphen_values = true)]
    crop: Option<Aabb>,
    /// Resample to cubic voxels of this edge length in world units
    #[arg(long, value_name = "VOXEL", value_parser = positive)]
    resample: Option<f64>,
    /// Make blocks whose values agree within TOL constant
    #[arg(long, value_name = "TOL", value_parser = not_negative)]
    prune: Option<f64>,
    /// Set NaN and infinite values, and negative densities, to zero; auto: fog volumes hold densities, other grids do not
    #[arg(long, value_enum, value_name = "WHAT", num_args = 0..=1, require_equals = true, default_missing_value = "auto")]
    repair: Option<Repair>,
    #[command(flatten)]
    edits: edits::Edits,
    #[command(flatten)]
    arrays: arrays::Options,
    #[command(flatten)]
    transfer: TransferOption,
    #[command(flatten)]
    pub(in crate::cli) memory: Memory,
}

/// Kind of a grid's values, which tells which of them are faults.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Repair {
    /// Fog volumes hold densities, other grids any values.
    Auto,
    /// All grids hold densities.
    Density,
}

fn renaming(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((old, new)) if !old.is_empty() && !new.is_empty() => Ok((old.into(), new.into())),
        _ => Err(format!("'{text}' is not OLD=NEW")),
    }
}

/// Format of a file that is converted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Vdb,
    Exr,
    Npy,
}

impl Kind {
    /// Detects the format of an input by its first bytes. What is neither picture nor array goes to the reader of VDBs,
    /// which says what it is.
    fn of_input(path: &Path) -> Result<Self> {
        if npy::is_npy(path)? {
            return Ok(Self::Npy);
        }
        Ok(if sniff(path)? == Format::Exr { Self::Exr } else { Self::Vdb })
    }

    /// Format that an output's name asks for; that of VDBs checks the others.
    fn of_output(path: &Path) -> Self {
        let ending = path.extension().and_then(OsStr::to_str).unwrap_or_default().to_ascii_lowercase();
        match ending.as_str() {
            "npy" => Self::Npy,
            "exr" => Self::Exr,
            _ => Self::Vdb,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Vdb => "VDB",
            Self::Exr => "EXR",
            Self::Npy => ".npy",
        }
    }
}

impl Convert {
    /// Reads, edits, writes and reports.
    ///
    /// # Errors
    /// If the input cannot be read, a grid is not there or cannot be edited so, no route leads from the input's format to
    /// the output's, an option belongs to another route, or the output cannot be written; the output is untouched then.
    pub fn run(&self, output: &Output) -> Result<ExitCode> {
        if let Some((sequence, to)) = self.sequences()? {
            return self.convert_frames(&sequence, &to, output);
        }
        let route = if self.input.is_dir() {
            (Kind::Vdb, Kind::of_output(&self.output))
        } else {
            (Kind::of_input(&self.input)?, Kind::of_output(&self.output))
        };
        self.check_options(route)?;
        match route {
            (Kind::Vdb, Kind::Vdb) => self.grids(output),
            (Kind::Vdb, Kind::Npy) => self.grid_to_array(output),
            (Kind::Npy, Kind::Vdb) => self.array_to_grid(output),
            (Kind::Exr, Kind::Npy) => self.layer_to_array(output),
            (Kind::Npy, Kind::Exr) => self.array_to_picture(output),
            (from, to) => Err(Error::unsupported(format!("no conversion from {} to {}", from.name(), to.name()))
                .at(&self.input)
                .hint("a .vdb becomes a .vdb or .npy, an .exr becomes a .npy, and a .npy becomes a .vdb or .exr")),
        }
    }

    /// Refuses options that a route would ignore.
    fn check_options(&self, (from, to): (Kind, Kind)) -> Result<()> {
        use Kind::{Exr, Npy, Vdb};
        let edits = from == Vdb && to == Vdb;
        let arrays = &self.arrays;
        let options = [
            ("--grid", !self.grid.is_empty(), from == Vdb || to == Vdb),
            ("--rename", !self.rename.is_empty(), edits),
            ("--crop", self.crop.is_some(), edits),
            ("--resample", self.resample.is_some(), edits),
            ("--prune", self.prune.is_some(), edits),
            ("--repair", self.repair.is_some(), edits),
            ("--tf", self.transfer.tf.is_some(), edits),
            ("--half", self.half, to != Npy),
            ("--codec", self.codec != Codec::default(), to == Vdb),
            ("--layer", arrays.layer.is_some(), from == Exr),
            ("--voxel-size", arrays.voxel_size.is_some(), from == Npy && to == Vdb),
            ("--origin", arrays.origin.is_some(), from == Npy && to == Vdb),
            ("--transform", arrays.transform.is_some(), from == Npy && to == Vdb),
        ];
        let of_edits = self.edits.given().map(|(name, given)| (name, given, edits));
        match options.iter().chain(&of_edits).find(|(_, given, applies)| *given && !applies) {
            Some((name, ..)) => {
                Err(Error::invalid(format!("{name} has no effect from {} to {}", from.name(), to.name()))
                    .hint("leave it out, or convert in two steps: edit VDBs first, then turn their grids into arrays"))
            }
            None => Ok(()),
        }
    }
}
