//! Report of a conversion from or to an image or an array.

use crate::error::{Error, Result};
use crate::formats::imaging::values::Tally;
use crate::formats::png::ToneMapping;
use crate::formats::vdb::GridInfo;
use crate::math::Affine;
use crate::text::bytes as human;
use crate::text::printable;
use crate::wording::worded;
use glam::{DMat4, DVec3};
use serde::Serialize;
use std::fmt;
use std::path::{Path, PathBuf};

/// Report of a conversion: paths, format, lengths of axes, grids or a layer, and notes.
#[derive(Debug, Default, Serialize, schemars::JsonSchema)]
pub struct Image {
    /// Path that was read.
    #[serde(serialize_with = "crate::app::paths::text")]
    pub input: PathBuf,
    /// Path that was written.
    #[serde(serialize_with = "crate::app::paths::text")]
    pub output: PathBuf,
    /// Length of what was written.
    pub bytes: u64,
    /// Format that was read, or that was written.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub format: Option<&'static str>,
    /// Lengths of the array's axes; empty for several arrays.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub shape: Vec<usize>,
    /// Names of the array's axes.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub axes: Vec<&'static str>,
    /// Grid that was read or written, if there is one alone.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub grid: Option<GridPlace>,
    /// Grids that were written.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub grids: Vec<GridPlace>,
    /// Layer that was read, with its channels in the array's order.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub layer: Option<LayerPlace>,
    /// How radiance became the samples of a PNG.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tone_mapping: Option<ToneMapping>,
    /// Assumptions of the reader, and losses of the writer.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
}

/// Where a grid's voxels lie, and what its values are.
#[derive(Debug, Clone, Serialize, schemars::JsonSchema)]
pub struct GridPlace {
    pub name: String,
    pub class: &'static str,
    /// OpenVDB's name for the type of the values.
    pub value_type: String,
    /// Number of voxels along x, y and z.
    pub shape: [usize; 3],
    /// Index coordinates of the array's voxel [0, 0, 0].
    pub index_origin: [i32; 3],
    /// Matrix from the array's indices to the world, row by row, acting on columns; indices are those of centres.
    pub transform: [[f64; 4]; 4],
    /// Value outside.
    pub background: Vec<f64>,
    pub active_voxels: u64,
    #[serde(flatten)]
    pub values: Tally,
}

impl GridPlace {
    pub fn new(
        info: GridInfo,
        shape: [usize; 3],
        index_origin: [i32; 3],
        transform: [[f64; 4]; 4],
        values: Tally,
    ) -> Self {
        Self {
            name: info.name,
            class: info.class.name(),
            value_type: info.value_type,
            shape,
            index_origin,
            transform,
            background: info.background,
            active_voxels: info.active_voxels,
            values,
        }
    }
}

/// Layer of a picture that became an array.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub struct LayerPlace {
    pub name: String,
    pub channels: Vec<String>,
}

/// Matrix from the indices of an array, whose first voxel has index coordinates `origin`, to the world.
pub(crate) fn array_to_world(grid: &Affine, origin: [i32; 3]) -> [[f64; 4]; 4] {
    let matrix = grid.matrix() * DMat4::from_translation(DVec3::from_array(origin.map(f64::from)));
    std::array::from_fn(|r| matrix.row(r).to_array())
}

impl Image {
    /// Report of what was written, without details.
    ///
    /// # Errors
    /// If the output is not there.
    pub(crate) fn of(input: &Path, output: &Path) -> Result<Self> {
        let bytes = std::fs::metadata(output).map_err(|e| Error::io(output, e))?.len();
        Ok(Self { input: input.to_path_buf(), output: output.to_path_buf(), bytes, ..Self::default() })
    }
}

impl fmt::Display for GridPlace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z] = self.shape;
        let name = printable(&self.name);
        writeln!(
            f,
            "  grid '{name}', {}, {}, {} active voxels of {x} x {y} x {z}",
            self.class, self.value_type, self.active_voxels
        )?;
        if let (Some(least), Some(greatest)) = (self.values.least, self.values.greatest) {
            writeln!(f, "  values from {least} to {greatest}")?;
        }
        if let Some(greatest) = self.values.removed_greatest {
            let (count, share) = (self.values.removed, 100.0 * self.values.removed_share);
            let threshold = worded("⟨threshold⟩");
            writeln!(f, "  {threshold} removed {count} values up to {greatest}, {share:.4} % of the sum")?;
        }
        let rows: Vec<String> = self.transform[..3].iter().flatten().map(|v| format!("{v}")).collect();
        writeln!(f, "  {}={}", worded("⟨transform⟩"), rows.join(","))
    }
}

impl fmt::Display for Image {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let axes: Vec<String> = self.axes.iter().zip(&self.shape).map(|(axis, n)| format!("{axis} {n}")).collect();
        let what = if axes.is_empty() { format!("{} grids", self.grids.len()) } else { axes.join(" x ") };
        writeln!(f, "{}: {what}, {}", self.output.display(), human(self.bytes))?;
        match &self.grid {
            Some(grid) => write!(f, "{grid}")?,
            None => self.grids.iter().try_for_each(|grid| write!(f, "{grid}"))?,
        }
        if let Some(layer) = &self.layer {
            writeln!(f, "  layer '{}', channels {}", printable(&layer.name), printable(&layer.channels.join(", ")))?;
        }
        self.tone_mapping.iter().try_for_each(|tone| writeln!(f, "  PNG: {tone}"))?;
        Ok(())
    }
}
