//! Headers of images: scans and fields of other formats than OpenVDB's.

use crate::error::Result;
use crate::formats::imaging::ImageFormat;
use crate::formats::imaging::image::{Header, Values};
use crate::formats::imaging::options::Options;
use crate::formats::limits::Limits;
use crate::text::printable;
use crate::wording::all_worded;
use serde::Serialize;
use std::fmt;
use std::path::Path;

/// Content of a file or folder of images, by its headers.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub(super) struct Summary {
    /// Name of the format.
    kind: &'static str,
    images: Vec<Entry>,
}

#[derive(Debug, Serialize, schemars::JsonSchema)]
struct Entry {
    /// Name of the quantity; none if the file has none.
    name: Option<String>,
    /// Number of voxels along x, y and z.
    size: [usize; 3],
    /// Number of values per voxel.
    components: usize,
    values: Values,
    /// Edges of a voxel in world units.
    voxel_size: [f64; 3],
    /// World position of the centre of the voxel (0, 0, 0).
    origin: [f64; 3],
    /// Assumptions and omissions of the reader.
    notes: Vec<String>,
}

/// Reads the headers of the images in a file or folder.
///
/// # Errors
/// If the file cannot be read, or its header is damaged or incomplete.
pub(crate) fn summary(path: &Path, kind: &'static str, reader: &ImageFormat, limits: Limits) -> Result<Summary> {
    let images = reader.open(path, &Options::default(), limits)?;
    let entry = |header: Header| Entry {
        name: header.name,
        size: header.size,
        components: header.components,
        values: header.values,
        voxel_size: header.index_to_world.voxel_size().to_array(),
        origin: header.index_to_world.to_world(glam::DVec3::ZERO).to_array(),
        notes: all_worded(header.notes),
    };
    Ok(Summary { kind, images: images.into_iter().map(|image| entry(image.header)).collect() })
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}; cumulo convert makes a .vdb of it", self.kind)?;
        for Entry {
            name,
            size: [nx, ny, nz],
            components,
            values,
            voxel_size: [dx, dy, dz],
            origin: [x, y, z],
            notes,
        } in &self.images
        {
            let name = name.as_ref().map_or_else(|| "image".to_owned(), |name| format!("image '{}'", printable(name)));
            let values = match values {
                Values::Real => "real values",
                Values::Integer => "integers",
            };
            writeln!(f, "{name}: {nx} x {ny} x {nz} voxels, {components} {values} each")?;
            writeln!(f, "  voxels of {dx} x {dy} x {dz} world units, the first one at ({x}, {y}, {z})")?;
            notes.iter().try_for_each(|note| writeln!(f, "  note: {}", printable(note)))?;
        }
        Ok(())
    }
}
