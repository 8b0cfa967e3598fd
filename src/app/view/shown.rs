//! What a sheet shows, for the report.

use super::slices::Cut;
use crate::app::failed::{Failed, List};
use crate::app::failure::Failure;
use crate::report::sheet::Range;
use crate::report::short;
use crate::scene::statistics::Statistics;
use crate::text::printable;
use serde::Serialize;
use std::fmt;
use std::path::PathBuf;

/// Report on contact sheets.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub struct ViewReport {
    pub(super) sheets: Vec<FileSheet>,
    /// Files without a sheet.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) failed: Vec<NotShown>,
}

/// A file that could not be shown.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub(super) struct NotShown {
    #[serde(serialize_with = "crate::app::paths::text")]
    pub input: PathBuf,
    pub error: Failure,
}

/// A sheet of a file.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub(super) struct FileSheet {
    #[serde(serialize_with = "crate::app::paths::text")]
    pub input: PathBuf,
    /// PNG that was written; none if the sheet was only shown.
    #[serde(serialize_with = "crate::app::paths::text")]
    pub output: Option<PathBuf>,
    /// Width and height of the sheet in pixels.
    pub size: [usize; 2],
    #[serde(flatten)]
    pub content: Content,
}

/// Content of a sheet.
#[derive(Debug, Serialize, schemars::JsonSchema)]
#[serde(tag = "shows", rename_all = "lowercase")]
pub(super) enum Content {
    Volume(Box<Volume>),
    Picture(Picture),
    Capture(Capture),
    Sequence(Sequence),
}

/// A grid of a VDB.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub(super) struct Volume {
    pub grid: String,
    /// Names of all grids of the file.
    pub grids: Vec<String>,
    pub value_type: String,
    pub class: &'static str,
    /// Voxels along the index axes in the box of the active ones; 0 for an empty grid.
    pub dimensions: [u64; 3],
    /// Edges of a voxel in world units; none for transforms that are not affine.
    pub voxel_size: Option<[f64; 3]>,
    pub active_voxels: u64,
    /// Meaning of the density in the picture: magnitudes, distances from the background, or the inside of a level set.
    pub density: &'static str,
    /// Extinction per unit of density and length, with which the picture is made; none if there is no picture.
    pub density_scale: Option<f64>,
    /// Exposure of the picture in stops.
    pub exposure: f64,
    /// Slices with their places.
    pub slices: Vec<Cut>,
    /// Values that slices show in black and in white.
    pub range: Option<Range>,
    pub statistics: Statistics,
    /// Edges of the histogram's bins.
    pub edges: Vec<f64>,
}

/// A picture with its layers.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub(super) struct Picture {
    /// Width and height in pixels.
    pub resolution: [usize; 2],
    /// Exposure of colors in stops.
    pub exposure: f64,
    pub layers: Vec<Layer>,
    /// Number of layers and channels that the sheet has no room for.
    pub left_out: usize,
}

/// A layer, or a channel of one, as it is shown.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub(super) struct Layer {
    pub name: String,
    /// How it is shown: `colors` with the exposure, `vectors` around grey, or `numbers` from black to white.
    pub kind: &'static str,
    /// Exposure in stops, for colors: the common one, unless the layer would be white or black by it.
    pub exposure: Option<f64>,
    /// Numbers of the ends, for vectors and numbers.
    pub range: Option<Range>,
}

/// The views of a capture.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub(super) struct Capture {
    pub views: usize,
    /// Numbers of the views on the sheet.
    pub shown: Vec<usize>,
    /// Numbers of those whose pictures cannot be read.
    pub missing: Vec<usize>,
    pub exposure: f64,
}

/// The frames of a sequence.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub(super) struct Sequence {
    /// Number of frames that there are.
    pub count: usize,
    /// Numbers of the frames on the sheet.
    pub frames: Vec<u32>,
    /// Frames that are missing or cannot be read.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub failed: Vec<Failed>,
    /// Exposure of all frames in stops.
    pub exposure: Option<f64>,
    /// Density scale of all frames; none for pictures.
    pub density_scale: Option<f64>,
}

impl ViewReport {
    /// True if all files were shown, with all frames of sequences.
    pub(crate) fn complete(&self) -> bool {
        self.failed.is_empty() && self.sheets.iter().all(|shown| shown.content.failed().is_empty())
    }
}

impl fmt::Display for ViewReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.sheets.iter().try_for_each(|shown| {
            let place = shown.output.as_ref().unwrap_or(&shown.input);
            writeln!(f, "{}: {}", printable(&place.to_string_lossy()), shown.content)
        })?;
        self.failed.iter().enumerate().try_for_each(|(i, NotShown { input, error })| {
            let (line, error) = (if i > 0 { "\n" } else { "" }, error.to_string());
            let error = error.trim_end().replace('\n', "\n  ");
            write!(f, "{line}{}: {error}", printable(&input.to_string_lossy()))
        })
    }
}

impl Content {
    /// Returns the frames of a sequence that are not shown, since they are missing or cannot be read.
    pub(crate) fn failed(&self) -> &[Failed] {
        match self {
            Self::Sequence(sequence) => &sequence.failed,
            _ => &[],
        }
    }
}

impl fmt::Display for Content {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Volume(v) => {
                let [x, y, z] = v.dimensions;
                write!(f, "grid '{}', {x} x {y} x {z} voxels", printable(&v.grid))?;
                v.density_scale.map_or(Ok(()), |scale| write!(f, ", density scale {}", short(scale)))?;
                v.range
                    .map_or(Ok(()), |Range { low, high }| write!(f, ", slices from {} to {}", short(low), short(high)))
            }
            Self::Picture(p) => {
                let [w, h] = p.resolution;
                let left_out = if p.left_out > 0 { format!(" and {} more", p.left_out) } else { String::new() };
                write!(f, "{w}x{h}, {} tile(s){left_out}, exposure {:+.1} EV", p.layers.len(), p.exposure)
            }
            Self::Capture(c) => {
                write!(f, "{} of {} views, exposure {:+.1} EV", c.shown.len(), c.views, c.exposure)?;
                if c.missing.is_empty() { Ok(()) } else { write!(f, ", {} without a picture", c.missing.len()) }
            }
            Self::Sequence(s) => {
                write!(f, "{} of {} frames", s.frames.len(), s.count)?;
                s.exposure.map_or(Ok(()), |ev| write!(f, ", exposure {ev:+.1} EV"))?;
                s.density_scale.map_or(Ok(()), |scale| write!(f, ", density scale {}", short(scale)))?;
                write!(f, "{}", List(&s.failed))
            }
        }
    }
}
