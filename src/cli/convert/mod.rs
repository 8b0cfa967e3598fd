//! `cumulo convert`: volumes, images and pictures from one file format to another.
//!
//! [`Kind`] names the formats. A route from one to another is an arm of [`Convert::run`], and a file of its own here.

mod arrays;
mod converted;
mod edits;
mod export;
mod form;
mod frames;
mod grid_edit;
mod grids;
mod half;
mod images;
mod import;
mod names;
mod nano;
mod parts;
mod report;
mod sources;
mod turn;

use super::frames::FramesOption;
use super::memory::Memory;
use super::output::Output;
use super::parse::{corners, exposure, not_negative, positive};
use super::transfer::TransferOption;
use crate::error::{Error, Result};
use crate::formats::imaging::format::{self, Format as ImageFormat};
use crate::formats::imaging::write::Target;
use crate::formats::vdb::Codec;
use crate::formats::{Format, sniff};
use crate::math::Aabb;
use schemars::JsonSchema;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Report of a file, or of a sequence.
#[derive(JsonSchema)]
#[serde(untagged)]
#[allow(dead_code, clippy::large_enum_variant, reason = "it describes documents, and none is made of it")]
pub(in crate::cli) enum AnyReport {
    File(FileReport),
    Sequence(frames::Report),
}

/// Report of a VDB with edits, or of an image, an array or a NanoVDB.
#[derive(JsonSchema)]
#[serde(untagged)]
#[allow(dead_code, clippy::large_enum_variant, reason = "it describes documents, and none is made of it")]
pub(in crate::cli) enum FileReport {
    Grids(grids::Report),
    Image(report::Report),
}

/// Convert a VDB with edits, images of medicine and science to VDBs and back, and pictures to arrays and back
///
/// Inputs are told by their content, outputs by their ending. DICOM series (folders), NIfTI, NRRD, MetaImage, TIFF stacks (also
/// folders and patterns), OME-Zarr, MRC, .cvol, .vti, .vtk, .npy, .npz and raw numbers (--dims) become a VDB with a grid for
/// each array. A NanoVDB (.nvdb) becomes a VDB, and a VDB a NanoVDB. A grid of a VDB becomes a .nii,
/// .nii.gz, .nrrd, .mha, .mhd, .vti or .npy over the box of its active voxels. VDB to VDB takes edits. A layer of an EXR
/// becomes a .npy of [row, column, channel], row 0 at the top, and back; or a .png for display: radiance times two to the
/// power of --exposure, clipped to 0..1, encoded by sRGB's curve. The report has the places of voxels.
///
/// Several VDBs before the last one are joined: their grids become those of one file, at the places that they have. Files whose
/// metadata state different up axes, and grids of one name in two files, are refused.
///
/// Of a sequence, 'in.####.vdb' or a folder of numbered files, every frame is converted: to 'out.####.vdb', or to the same names
/// in another folder.
#[derive(Debug, Clone, clap::Args)]
pub struct Convert {
    /// File, folder or pattern of slices to read
    input: PathBuf,
    /// Other VDBs, whose grids are joined with those of the first one
    #[arg(value_name = "VDB")]
    more: Vec<PathBuf>,
    /// VDB, .nvdb, image, .npy, EXR or PNG to write
    output: PathBuf,
    #[command(flatten)]
    frames: FramesOption,
    /// Keep only this grid (repeatable); from an image: name of the grid
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
    /// EXR to .npy or .png: layer (default: the beauty)
    #[arg(long, value_name = "NAME")]
    layer: Option<String>,
    /// EXR to .png: exposure in stops (default: 0)
    #[arg(long, value_name = "EV", value_parser = exposure, allow_negative_numbers = true)]
    exposure: Option<f64>,
    #[command(flatten)]
    edits: edits::Edits,
    #[command(flatten)]
    values: images::ValueOptions,
    #[command(flatten)]
    images: images::Options,
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

/// Format of a file that is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Vdb,
    Nano,
    Exr,
    Image(ImageFormat),
}

impl Kind {
    /// Detects the format of an input by its content. What is neither picture nor image goes to the reader of VDBs, which says
    /// what it is.
    fn of_input(path: &Path) -> Result<Self> {
        if let Some(format) = format::sniff(path)? {
            return Ok(Self::Image(format));
        }
        if path.is_dir() {
            return Ok(Self::Vdb);
        }
        Ok(match sniff(path)? {
            Format::Exr => Self::Exr,
            Format::NanoVdb => Self::Nano,
            _ => Self::Vdb,
        })
    }

    fn name(self) -> &'static str {
        match self {
            Self::Vdb => "VDB",
            Self::Nano => "NanoVDB",
            Self::Exr => "EXR",
            Self::Image(format) => format.name(),
        }
    }
}

/// Format of a file that is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Written {
    Vdb,
    Nano,
    Exr,
    Png,
    Image(Target),
}

impl Written {
    /// Format that an output's name asks for; that of VDBs checks names of other endings.
    fn of(path: &Path) -> Self {
        match Target::of(path) {
            Some(target) => Self::Image(target),
            None => match path.extension().and_then(OsStr::to_str).unwrap_or_default().to_ascii_lowercase().as_str() {
                "exr" => Self::Exr,
                "png" => Self::Png,
                "nvdb" => Self::Nano,
                _ => Self::Vdb,
            },
        }
    }

    fn name(self) -> String {
        match self {
            Self::Vdb => "VDB".into(),
            Self::Nano => ".nvdb".into(),
            Self::Exr => "EXR".into(),
            Self::Png => "PNG".into(),
            Self::Image(target) => format!(".{}", target.ending()),
        }
    }
}

impl Convert {
    /// Paths that the command reads.
    pub(in crate::cli) fn inputs(&self) -> Vec<&Path> {
        [&self.input].into_iter().chain(&self.transfer.tf).map(PathBuf::as_path).collect()
    }

    /// Reads, edits, writes and reports.
    ///
    /// # Errors
    /// If the input cannot be read, a grid is not there or cannot be edited so, no route leads from the input's format to
    /// the output's, an option belongs to another route, or the output cannot be written; the output is untouched then.
    pub fn run(&self, output: &Output) -> Result<ExitCode> {
        if let Some((sequence, to)) = self.sequences()? {
            return self.convert_frames(&sequence, &to, output);
        }
        let from =
            if self.images.dims.is_some() { Kind::Image(ImageFormat::Raw) } else { Kind::of_input(&self.input)? };
        let to = Written::of(&self.output);
        // What is no VDB after all is told by the reader of VDBs; its options do not matter then.
        let told =
            from != Kind::Vdb || self.input.is_dir() || matches!(sniff(&self.input)?, Format::Vdb | Format::NanoVdb);
        if told {
            self.check_options(from, to)?;
        }
        self.check_join(from, to)?;
        match (from, to) {
            (Kind::Vdb, Written::Vdb) => self.grids(output),
            (Kind::Vdb, Written::Nano) => self.grids_to_nano(output),
            (Kind::Nano, Written::Vdb) => self.nano_to_grids(output),
            (Kind::Vdb, Written::Image(target)) => self.grid_to_image(target, output),
            (Kind::Image(format), Written::Vdb) => self.image_to_grids(format, output),
            (Kind::Exr, Written::Image(Target::Npy)) => self.layer_to_array(output),
            (Kind::Exr, Written::Png) => self.layer_to_png(output),
            (Kind::Image(ImageFormat::Npy), Written::Exr) => self.array_to_picture(output),
            (from, to) => {
                // A name of no known ending is taken for that of a VDB.
                let ending = self.output.extension().and_then(OsStr::to_str).filter(|_| to == Written::Vdb);
                let ending = ending.filter(|ending| !ending.eq_ignore_ascii_case("vdb"));
                let to = ending.map_or_else(|| to.name(), |ending| format!(".{ending}"));
                Err(Error::unsupported(format!("no conversion from {} to {to}", from.name())).at(&self.input).hint(
                    "a .vdb becomes a .vdb, .nvdb, .npy, .nii, .nii.gz, .nrrd, .mha, .mhd or .vti; an .exr becomes a .npy or \
                     .png, a .npy an .exr or .vdb, and .nvdb and other images a .vdb",
                ))
            }
        }
    }

    /// Refuses several inputs that do not become one VDB, and edits that are of one file.
    fn check_join(&self, from: Kind, to: Written) -> Result<()> {
        let Some(second) = self.more.first() else { return Ok(()) };
        for path in &self.more {
            let kind = Kind::of_input(path)?;
            if (from, kind, to) != (Kind::Vdb, Kind::Vdb, Written::Vdb) {
                let (of, to) = (if from == Kind::Vdb { kind } else { from }, to.name());
                return Err(Error::unsupported(format!(
                    "several files become one VDB if all are VDBs, not from {} to {to}",
                    of.name()
                ))
                .at(path)
                .hint("the last name is the output; convert the others to VDBs first, one by one"));
            }
        }
        let of_one = ["--split", "--merge", "--up", "--up-from"];
        match self.edits.given().iter().find(|(name, given)| *given && of_one.contains(name)) {
            Some((name, _)) => {
                Err(Error::invalid(format!("{name} edits the grids of one file, and there are several"))
                    .at(second)
                    .hint("edit the files one by one first, then join them"))
            }
            None => Ok(()),
        }
    }

    /// Refuses options that a route would ignore.
    fn check_options(&self, from: Kind, to: Written) -> Result<()> {
        let edits = from == Kind::Vdb && to == Written::Vdb;
        let imports = matches!(from, Kind::Image(_)) && to == Written::Vdb;
        let exports = from == Kind::Vdb && matches!(to, Written::Image(_));
        let array = matches!(from, Kind::Image(ImageFormat::Npy | ImageFormat::Npz)) && imports
            || exports && to == Written::Image(Target::Npy);
        let of_image = |has: fn(ImageFormat) -> bool| imports && matches!(from, Kind::Image(format) if has(format));
        let placed = of_image(ImageFormat::takes_placement);
        let (images, values) = (&self.images, &self.values);
        let nano = from == Kind::Nano && to == Written::Vdb || from == Kind::Vdb && to == Written::Nano;
        let grids = edits || imports || exports;
        let of = |format: ImageFormat| imports && from == Kind::Image(format);
        let options = [
            ("--grid", !self.grid.is_empty(), grids || nano),
            ("--rename", !self.rename.is_empty(), edits),
            ("--crop", self.crop.is_some(), edits),
            ("--resample", self.resample.is_some(), edits),
            ("--prune", self.prune.is_some(), edits),
            ("--repair", self.repair.is_some(), edits),
            ("--tf", self.transfer.tf.is_some(), edits),
            ("--half", self.half, !matches!(to, Written::Image(_) | Written::Nano | Written::Png)),
            ("--codec", self.codec != Codec::default(), to == Written::Vdb),
            ("--layer", self.layer.is_some(), from == Kind::Exr),
            ("--exposure", self.exposure.is_some(), to == Written::Png),
            ("--scale", values.scale.is_some(), grids),
            ("--offset", values.offset.is_some(), grids),
            ("--map", values.map.is_some(), grids),
            ("--threshold", values.threshold.is_some(), grids),
            ("--time", images.time.is_some(), of_image(ImageFormat::has_times)),
            ("--channel", images.channel.is_some(), of(ImageFormat::Zarr)),
            ("--level", images.level.is_some(), of(ImageFormat::Zarr)),
            ("--series", images.series.is_some(), of(ImageFormat::Dicom)),
            ("--array", images.array.is_some(), of_image(ImageFormat::has_arrays)),
            ("--as", images.grid_type.is_some(), grids),
            ("--axes", images.axes.is_some(), array),
            ("--voxel-size", images.voxel_size.is_some(), placed),
            ("--spacing", images.spacing.is_some(), placed),
            ("--origin", images.origin.is_some(), placed),
            ("--transform", images.transform.is_some(), placed),
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
