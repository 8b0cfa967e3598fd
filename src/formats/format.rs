//! File formats: their names, how their files are told from others, and what can be done with them.

use super::ending::ends_in;
use super::imaging::ImageFormat;
use super::imaging::options::ReadOption;
use super::mesh::MeshFormat;
use super::raster::PictureFormat;
use crate::error::Result;
use serde::{Serialize, Serializer};
use std::borrow::Cow;
use std::path::Path;

/// A file format: a row of the [registry](super::registry).
#[derive(Debug)]
pub struct Format {
    /// Name in reports and errors, such as `NIfTI`. No two formats share one.
    pub name: &'static str,
    /// Phrase for a file of it, such as `an OpenVDB file`.
    pub phrase: &'static str,
    /// Endings of its files' names in lower case, without the dot.
    pub endings: &'static [&'static str],
    /// True if numbered files are the frames of a sequence, and not the slices of a volume or the views of a capture.
    pub frames: bool,
    /// Tells a file of this format by its path and its first bytes, 1024 at most; folders and patterns have none.
    pub(crate) recognizes: fn(&Path, &[u8]) -> Result<bool>,
    /// Kind of the content, with the operations of the formats of that kind.
    pub kind: FileKind,
}

/// Kind of a file's content, on which use cases dispatch.
#[derive(Debug, Clone, Copy)]
pub enum FileKind {
    /// Sparse grids of OpenVDB.
    Vdb,
    /// Sparse grids of NanoVDB.
    NanoVdb,
    /// Layers of scene-linear pictures.
    Exr,
    /// Pictures of any number of samples a pixel, each with a depth.
    DeepExr,
    /// A picture of integer samples.
    Picture(&'static PictureFormat),
    /// Regular grids.
    Image(&'static ImageFormat),
    /// A multi-view capture, or what is told from one by its reader alone: a scene file, a transfer function, a folder.
    Capture,
    /// A stage of Universal Scene Description.
    Usd,
    /// A mesh of polygons.
    Mesh(&'static MeshFormat),
    /// Content of no known format.
    Unknown,
}

impl Format {
    /// True if a path has the ending of this format's files.
    pub(crate) fn has_name(&self, path: &Path) -> bool {
        self.endings.iter().any(|ending| ends_in(path, ending))
    }
}

impl PartialEq for Format {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

impl FileKind {
    /// Words for the kinds in JSON, in the order of [`Self::word`].
    const WORDS: [&str; 10] =
        ["vdb", "nanovdb", "exr", "deepexr", "picture", "image", "capture", "usd", "mesh", "unknown"];

    /// Returns the word for the kind in JSON.
    fn word(self) -> &'static str {
        Self::WORDS[match self {
            Self::Vdb => 0,
            Self::NanoVdb => 1,
            Self::Exr => 2,
            Self::DeepExr => 3,
            Self::Picture(_) => 4,
            Self::Image(_) => 5,
            Self::Capture => 6,
            Self::Usd => 7,
            Self::Mesh(_) => 8,
            Self::Unknown => 9,
        }]
    }

    /// True for pictures of any kind.
    pub(crate) fn is_picture(self) -> bool {
        matches!(self, Self::Exr | Self::DeepExr | Self::Picture(_))
    }

    /// True if an option means something to the reader of such images.
    pub(crate) fn heeds(self, option: ReadOption) -> bool {
        matches!(self, Self::Image(image) if image.options.contains(&option))
    }
}

impl Serialize for FileKind {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        self.word().serialize(serializer)
    }
}

impl schemars::JsonSchema for FileKind {
    fn schema_name() -> Cow<'static, str> {
        "FileKind".into()
    }

    fn json_schema(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
        schemars::json_schema!({ "type": "string", "enum": Self::WORDS })
    }
}
