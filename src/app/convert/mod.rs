//! Volumes, images and pictures from one file format to another.
//!
//! A route from one kind to another is an arm of `ConvertSettings::convert_file`, and a file of its own here.

mod arrays;
mod computed;
mod converted;
mod edits;
mod export;
mod expression;
mod flatten;
mod form;
mod frames;
mod grid_edit;
mod grids;
mod half;
mod images;
mod import;
mod meshes;
mod names;
mod nano;
mod parts;
mod report;
mod sources;
mod turn;

pub use computed::Computed;
pub use edits::{Edits, UpTarget};
pub use expression::Expression;
pub use form::Form;
pub use frames::Frames;
pub use grids::Grids;
pub use images::{ImageSettings, ValueSettings};
pub use meshes::{MeshReport, MeshSettings};
pub use names::Convention;
pub use report::Image;
pub use sources::Merge;

use crate::app::Context;
use crate::app::inputs;
use crate::app::sequence::FrameSelection;
use crate::app::transfer::TransferSettings;
use crate::app::use_case::{Report, Status, use_case};
use crate::error::{Error, Result};
use crate::formats::ending::ends_in;
use crate::formats::format::{FileKind, Format};
use crate::formats::imaging::options::ReadOption;
use crate::formats::imaging::write::Target;
use crate::formats::limits::Limits;
use crate::formats::mesh::MeshFormat;
use crate::formats::raster::PictureFormat;
use crate::formats::registry::{self, FORMATS, NPY, RAW, VDB};
use crate::formats::vdb::Codec;
use crate::text::listed;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::ffi::OsStr;
use std::fmt;
use std::path::{Path, PathBuf};

/// Report of a file, or of a sequence.
#[derive(Debug, Serialize, JsonSchema)]
#[serde(untagged)]
pub enum ConvertReport {
    /// Report of a file.
    File(FileReport),
    /// Report of a sequence.
    Sequence(Frames),
}

impl ConvertReport {
    /// True if no frame failed.
    pub fn complete(&self) -> bool {
        match self {
            Self::File(_) => true,
            Self::Sequence(frames) => frames.complete(),
        }
    }
}

impl fmt::Display for ConvertReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File(file) => file.fmt(f),
            Self::Sequence(frames) => frames.fmt(f),
        }
    }
}

/// Report of a VDB with edits, of a mesh, or of an image, an array or a NanoVDB.
#[derive(Debug, Serialize, JsonSchema)]
#[serde(untagged)]
pub enum FileReport {
    /// Report of a VDB with edits.
    Grids(Box<Grids>),
    /// Report of a mesh.
    Mesh(Box<MeshReport>),
    /// Report of an image, an array or a NanoVDB.
    Image(Box<Image>),
}

impl fmt::Display for FileReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Grids(grids) => grids.fmt(f),
            Self::Mesh(mesh) => mesh.fmt(f),
            Self::Image(image) => image.fmt(f),
        }
    }
}

/// Settings of a conversion: a VDB with edits, images of medicine and science to VDBs and back, meshes to VDBs and
/// back, pictures to arrays and back.
///
/// Inputs are told by their content, outputs by their ending. Several VDBs are joined: their grids become those of one
/// file, at the places that they have. Of a sequence every frame is converted.
///
/// ```
/// use cumulo::prelude::*;
/// # let folder = tempfile::tempdir()?;
/// # let output = folder.path().join("head.vdb");
/// let settings = ConvertSettings {
///     input: "fixtures/head.nii.gz".into(),
///     output: output.clone(),
///     values: ValueSettings { map: Some([0.0, 255.0]), ..ValueSettings::default() },
///     ..ConvertSettings::default()
/// };
/// println!("{}", settings.run(&Context::default())?);
/// assert!(output.exists());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ConvertSettings {
    /// File, folder or pattern of slices to read.
    #[serde(with = "crate::app::paths")]
    pub input: PathBuf,
    /// Other VDBs, whose grids are joined with those of the first one.
    #[serde(with = "crate::app::paths")]
    pub more: Vec<PathBuf>,
    /// VDB, .nvdb, image, mesh, .npy, EXR or PNG to write.
    #[serde(with = "crate::app::paths")]
    pub output: PathBuf,
    /// Frames of sequences to convert.
    pub frames: FrameSelection,
    /// Names of the grids to keep, none for all; from an image: names of the grids that are made.
    pub grid: Vec<String>,
    /// Names of grids, old and new.
    pub rename: Vec<(String, String)>,
    /// True to store real values as 16-bit floats.
    pub half: bool,
    /// How values are packed.
    pub codec: Codec,
    /// Lower and upper corner of the world-space box to keep; none for all.
    pub crop: Option<[[f64; 3]; 2]>,
    /// Edge length in world units of the cubic voxels to resample to; none to leave the lattice.
    pub resample: Option<f64>,
    /// Tolerance by which the values of blocks that become constant may differ; none to leave them.
    pub prune: Option<f64>,
    /// Grids whose NaN and infinite values, and negative densities, are set to zero.
    pub repair: Option<Repair>,
    /// Layer of an EXR; none for the beauty.
    pub layer: Option<String>,
    /// Exposure of a PNG in stops, from -60 to 60; none for 0.
    pub exposure: Option<f64>,
    /// True to composite the samples of a deep EXR, which becomes a flat one or a PNG.
    pub flatten: bool,
    /// EXR of what holds a deep EXR out that is flattened: another deep one, or depths along the viewing axis of opaque
    /// objects; of frames, such as prop.####.exr. None if nothing does.
    #[serde(skip_serializing_if = "Option::is_none", with = "crate::app::paths")]
    pub holdout: Option<PathBuf>,
    /// Edits from VDB to VDB.
    #[serde(flatten)]
    pub edits: Edits,
    /// Steps that values take.
    #[serde(flatten)]
    pub values: ValueSettings,
    /// Part of an image that is read, and where its voxels lie.
    #[serde(flatten)]
    pub images: ImageSettings,
    /// How surfaces become meshes, and meshes volumes.
    #[serde(flatten)]
    pub meshes: MeshSettings,
    /// Transfer function that is attached to the grids.
    #[serde(flatten)]
    pub transfer: TransferSettings,
    /// Memory that the work may take.
    #[serde(flatten)]
    pub limits: Limits,
}

/// Kind of a grid's values, which tells which of them are faults.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Repair {
    /// Fog volumes hold densities, other grids any values.
    Auto,
    /// All grids hold densities.
    Density,
}

/// Returns the format of an input by its content; none of what is neither volume nor picture.
fn format_of_input(path: &Path) -> Result<Option<&'static Format>> {
    registry::find(path, |kind| !matches!(kind, FileKind::Capture | FileKind::Usd))
}

/// Format of a file that is written.
#[derive(Debug, Clone, Copy)]
struct Output {
    format: &'static Format,
    /// Form of an image.
    target: Option<&'static Target>,
}

impl Output {
    /// Returns what an output's name asks for; names of other endings are checked where VDBs are written.
    fn named(path: &Path) -> Self {
        let output = |format: &'static Format| match format.kind {
            FileKind::Image(image) => {
                let target = image.targets.iter().find(|target| ends_in(path, target.ending))?;
                Some(Self { format, target: Some(target) })
            }
            FileKind::NanoVdb
            | FileKind::Exr
            | FileKind::Mesh(MeshFormat { write: Some(_), .. })
            | FileKind::Picture(PictureFormat { write: Some(_), .. }) => {
                format.has_name(path).then_some(Self { format, target: None })
            }
            _ => None,
        };
        FORMATS.iter().find_map(|format| output(format)).unwrap_or(Self { format: &VDB, target: None })
    }

    /// Name in errors.
    fn name(self) -> Cow<'static, str> {
        match (self.target, self.format.kind) {
            (Some(target), _) => format!(".{}", target.ending).into(),
            (None, FileKind::NanoVdb) => ".nvdb".into(),
            (None, _) => self.format.name.into(),
        }
    }
}

/// Returns which inputs become which outputs, as advice.
fn routes() -> String {
    let (mut images, mut pictures, mut meshes) = (Vec::new(), Vec::new(), Vec::new());
    for format in FORMATS {
        match format.kind {
            FileKind::Image(image) => images.extend(image.targets.iter().map(|target| format!(".{}", target.ending))),
            FileKind::Picture(PictureFormat { write: Some(_), .. }) => {
                pictures.extend(format.endings.iter().map(|ending| format!(".{ending}")));
            }
            FileKind::Mesh(MeshFormat { write: Some(_), .. }) => {
                meshes.extend(format.endings.iter().map(|ending| format!(".{ending}")))
            }
            _ => {}
        }
    }
    images.append(&mut meshes);
    format!(
        "a .vdb becomes a .vdb, .nvdb, {}; an .exr becomes a .npy or {}, a .npy an .exr or .vdb, and .nvdb, meshes and \
         other images a .vdb; a deep .exr becomes a flat one or a .png with ⟨flatten⟩",
        listed(&images, "or"),
        listed(&pictures, "or")
    )
}

use_case!(ConvertSettings => ConvertReport, limits);

impl Report for ConvertReport {
    fn status(&self) -> Result<Status> {
        Ok(Status::complete(self.complete()))
    }
}

impl ConvertSettings {
    /// Paths that the output is made from.
    pub fn inputs(&self) -> Vec<&Path> {
        [&self.input].into_iter().chain(&self.transfer.tf).chain(&self.holdout).map(PathBuf::as_path).collect()
    }

    /// Reads, edits and writes.
    ///
    /// # Errors
    /// If the input cannot be read, a grid is not there or cannot be edited so, no route leads from the input's format
    /// to the output's, a setting belongs to another route, or the output cannot be written; the output is untouched
    /// then.
    pub fn run(&self, context: &Context) -> Result<ConvertReport> {
        let _inputs = inputs::protect(self.inputs(), self.limits);
        if let Some((sequence, to)) = self.sequences()? {
            return self.convert_frames(&sequence, &to, context).map(ConvertReport::Sequence);
        }
        self.convert_file(context).map(ConvertReport::File)
    }

    /// Converts one file, or several that are joined.
    fn convert_file(&self, context: &Context) -> Result<FileReport> {
        let found = if self.images.dims.is_some() { Some(&RAW) } else { format_of_input(&self.input)? };
        // The reader of VDBs says what others are; options do not matter then.
        let (from, to) = (found.unwrap_or(&VDB), Output::named(&self.output));
        if found.is_some() || self.input.is_dir() {
            self.check_options(from, to)?;
        }
        self.check_join(from, to)?;
        match (from.kind, to.format.kind, to.target) {
            (FileKind::Vdb, FileKind::Vdb, _) => self.grids(context),
            (FileKind::Vdb, FileKind::NanoVdb, _) => self.grids_to_nano(context),
            (FileKind::NanoVdb, FileKind::Vdb, _) => self.nano_to_grids(context),
            (FileKind::Vdb, FileKind::Mesh(writer), _) => self.grid_to_mesh(to.format, writer, context),
            (FileKind::Mesh(reader), FileKind::Vdb, _) => self.mesh_to_grid(from, reader, context),
            (FileKind::Vdb, kind, Some(target)) => self.grid_to_image(kind, target, context),
            (FileKind::Image(reader), FileKind::Vdb, _) => self.image_to_grids(from, reader, context),
            (FileKind::Exr, _, Some(_)) if *to.format == NPY => self.layer_to_array(context),
            (FileKind::Exr, FileKind::Picture(PictureFormat { write: Some(write), .. }), _) => {
                self.layer_to_picture(*write, context)
            }
            (FileKind::Image(_), FileKind::Exr, _) if *from == NPY => self.array_to_picture(context),
            (FileKind::DeepExr, FileKind::Exr, _) if self.flatten => self.flatten_to_exr(context),
            (FileKind::DeepExr, FileKind::Picture(PictureFormat { write: Some(write), .. }), _) if self.flatten => {
                self.flatten_to_picture(*write, context)
            }
            (FileKind::DeepExr, ..) if !self.flatten => Err(Error::unsupported(
                "a deep OpenEXR picture is converted by compositing its samples alone, which is not asked for",
            )
            .at(&self.input)
            .hint("give ⟨flatten⟩: the output is a flat .exr or a .png")),
            _ => {
                // A name of no known ending is taken for that of a VDB.
                let ending = self.output.extension().and_then(OsStr::to_str).filter(|_| *to.format == VDB);
                let ending = ending.filter(|ending| !ending.eq_ignore_ascii_case("vdb"));
                let to = ending.map_or_else(|| to.name(), |ending| format!(".{ending}").into());
                Err(Error::unsupported(format!("no conversion from {} to {to}", from.name))
                    .at(&self.input)
                    .hint(routes()))
            }
        }
    }

    /// Refuses several inputs that do not become one VDB, and edits that are of one file.
    fn check_join(&self, from: &Format, to: Output) -> Result<()> {
        let Some(second) = self.more.first() else { return Ok(()) };
        for path in &self.more {
            let other = format_of_input(path)?.unwrap_or(&VDB);
            if [from, other, to.format].iter().any(|format| **format != VDB) {
                let (of, to) = (if *from == VDB { other } else { from }, to.name());
                return Err(Error::unsupported(format!(
                    "several files become one VDB if all are VDBs, not from {} to {to}",
                    of.name
                ))
                .at(path)
                .hint("the last name is the output; convert the others to VDBs first, one by one"));
            }
        }
        let of_one = ["⟨split⟩", "⟨merge⟩", "⟨eval⟩", "⟨up⟩", "⟨up_from⟩"];
        match self.edits.stated().iter().find(|(name, given)| *given && of_one.contains(name)) {
            Some((name, _)) => {
                Err(Error::invalid(format!("{name} edits the grids of one file, and there are several"))
                    .at(second)
                    .hint("edit the files one by one first, then join them"))
            }
            None => Ok(()),
        }
    }

    /// Refuses settings that a route would ignore.
    fn check_options(&self, from: &Format, to: Output) -> Result<()> {
        let (read, written) = (from.kind, to.format.kind);
        let edits = matches!((read, written), (FileKind::Vdb, FileKind::Vdb));
        let imports = matches!((read, written), (FileKind::Image(_), FileKind::Vdb));
        let exports = matches!((read, written), (FileKind::Vdb, FileKind::Image(_)));
        let nano = matches!((read, written), (FileKind::NanoVdb, FileKind::Vdb) | (FileKind::Vdb, FileKind::NanoVdb));
        let to_mesh = matches!((read, written), (FileKind::Vdb, FileKind::Mesh(_)));
        let of_mesh = matches!((read, written), (FileKind::Mesh(_), FileKind::Vdb));
        let grids = edits || imports || exports;
        let heeds = |option| imports && read.heeds(option);
        let placed = heeds(ReadOption::Placement);
        let array = heeds(ReadOption::Axes) || exports && written.heeds(ReadOption::Axes);
        let (images, values) = (&self.images, &self.values);
        let options = [
            ("⟨grid⟩", !self.grid.is_empty(), grids || nano || to_mesh || of_mesh),
            ("⟨rename⟩", !self.rename.is_empty(), edits),
            ("⟨crop⟩", self.crop.is_some(), edits),
            ("⟨resample⟩", self.resample.is_some(), edits),
            ("⟨prune⟩", self.prune.is_some(), edits),
            ("⟨repair⟩", self.repair.is_some(), edits),
            ("⟨tf⟩", self.transfer.tf.is_some(), edits),
            ("⟨half⟩", self.half, matches!(written, FileKind::Vdb | FileKind::Exr)),
            ("⟨codec⟩", self.codec != Codec::default(), matches!(written, FileKind::Vdb)),
            ("⟨layer⟩", self.layer.is_some(), matches!(read, FileKind::Exr)),
            ("⟨flatten⟩", self.flatten, matches!(read, FileKind::DeepExr)),
            ("⟨holdout⟩", self.holdout.is_some(), matches!(read, FileKind::DeepExr) && self.flatten),
            ("⟨exposure⟩", self.exposure.is_some(), matches!(written, FileKind::Picture(_))),
            ("⟨scale⟩", values.scale.is_some(), grids),
            ("⟨offset⟩", values.offset.is_some(), grids),
            ("⟨map⟩", values.map.is_some(), grids),
            ("⟨threshold⟩", values.threshold.is_some(), grids),
            ("⟨time_point⟩", images.scan.time_point.is_some(), heeds(ReadOption::Time)),
            ("⟨channel⟩", images.scan.channel.is_some(), heeds(ReadOption::Channel)),
            ("⟨level⟩", images.scan.level.is_some(), heeds(ReadOption::Level)),
            ("⟨series⟩", images.scan.series.is_some(), heeds(ReadOption::Series)),
            ("⟨array⟩", images.scan.array.is_some(), heeds(ReadOption::Array)),
            ("⟨as⟩", images.scan.grid_type.is_some(), grids),
            ("⟨axes⟩", images.scan.axes.is_some(), array),
            ("⟨voxel_size⟩", images.scan.voxel_size.is_some(), placed || of_mesh),
            ("⟨spacing⟩", images.scan.spacing.is_some(), placed),
            ("⟨origin⟩", images.scan.origin.is_some(), placed),
            ("⟨transform⟩", images.scan.transform.is_some(), placed),
            ("⟨half_width⟩", self.meshes.half_width.is_some(), of_mesh),
            ("⟨adaptivity⟩", self.meshes.adaptivity.is_some(), to_mesh),
        ];
        if self.flatten && matches!(read, FileKind::Exr) {
            return Err(Error::invalid("⟨flatten⟩: this is a flat OpenEXR picture already")
                .at(&self.input)
                .hint("use it as it is; only deep pictures have samples to composite"));
        }
        let of_edits = self.edits.stated().map(|(name, given)| {
            let besides = name == "⟨to⟩" && of_mesh || name == "⟨iso⟩" && to_mesh;
            (name, given, edits || besides)
        });
        match options.iter().chain(&of_edits).find(|(_, given, applies)| *given && !applies) {
            Some((name, ..)) => Err(Error::invalid(format!(
                "{name} has no effect from {} to {}",
                from.name,
                to.name()
            ))
            .hint(
                "leave it out, or convert in two steps: edit VDBs first, then turn their grids into arrays or meshes",
            )),
            None if edits && self.edits.iso.is_some() && self.edits.to.is_none() => {
                Err(Error::invalid("⟨iso⟩ has no effect from VDB to VDB without ⟨to⟩")
                    .hint("give ⟨to=level-set⟩ as well, or the name of a mesh, such as surface.ply, to write"))
            }
            None => Ok(()),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    #[test]
    fn endings_name_outputs() {
        for (path, name) in [
            ("a/b.NII.gz", ".nii.gz"),
            ("b.nii", ".nii"),
            ("b.npy", ".npy"),
            ("b.nvdb", ".nvdb"),
            ("b.exr", "OpenEXR"),
            ("b.PNG", "PNG"),
            ("b.ply", "PLY"),
            ("b.OBJ", "OBJ"),
            ("b.jpg", "VDB"),
            ("b.gz", "VDB"),
            ("b", "VDB"),
        ] {
            assert_eq!(Output::named(Path::new(path)).name(), name, "{path}");
        }
        let header = Path::new("x/b.mhd");
        assert_eq!(Output::named(header).target.unwrap().companion(header), Some("x/b.raw".into()));
        let advice = "a .vdb, .nvdb, .npy, .nii, .nii.gz, .nrrd, .mha, .mhd, .vti, .vol, .ply or .obj; an .exr becomes a .npy or .png,";
        assert!(routes().contains(advice), "{}", routes());
    }
}
