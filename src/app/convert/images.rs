//! Images: which part of a file is read, where its voxels lie, and what becomes of its values.

use super::report::GridPlace;
use crate::app::scan::ScanSettings;
use crate::error::{Error, Result};
use crate::formats::imaging::options::{Options as ReadOptions, RawLayout};
use crate::formats::imaging::values::{Mapping, Tally};
use crate::formats::sample::{Endian, Sample};
use crate::text::printable;
use serde::{Deserialize, Serialize};

/// Part of an image that is read, and where its voxels lie.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ImageSettings {
    /// Part that is read, and where its voxels lie; of several points in time or channels the first one is read unless
    /// another is chosen.
    #[serde(flatten)]
    pub scan: ScanSettings,
    /// Voxels along x (the fastest), y and z of numbers without a header.
    pub dims: Option<[usize; 3]>,
    /// Type of the numbers of a raw file.
    #[serde(rename = "type")]
    pub sample: Option<Sample>,
    /// Order of the bytes of a raw file's numbers; none for the least significant first.
    pub endian: Option<Endian>,
    /// Bytes before the first number of a raw file; none for 0.
    pub skip: Option<u64>,
}

/// Steps that values take, in the order in which they stand here.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ValueSettings {
    /// Factor of every value, not 0.
    pub scale: Option<f64>,
    /// Number that is added to every value.
    pub offset: Option<f64>,
    /// Values, ascending, that become 0 and 1; those beyond are clamped.
    pub map: Option<[f64; 2]>,
    /// Value up to which values become background.
    pub threshold: Option<f64>,
}

impl ImageSettings {
    /// Settings as the readers take them.
    ///
    /// # Errors
    /// If the transform is singular.
    pub(crate) fn reading(&self) -> Result<ReadOptions> {
        let raw = self.dims.zip(self.sample).map(|(size, sample)| RawLayout {
            size,
            sample,
            endian: self.endian.unwrap_or_default(),
            skip: self.skip.unwrap_or(0),
        });
        Ok(ReadOptions { raw, ..self.scan.reading()? })
    }
}

impl ValueSettings {
    /// Steps as the readers take them.
    pub(crate) fn mapping(&self) -> Mapping {
        Mapping {
            scale: self.scale.unwrap_or(1.0),
            offset: self.offset.unwrap_or(0.0),
            range: self.map,
            threshold: self.threshold,
        }
    }

    /// True if there is a step.
    pub(crate) fn any(&self) -> bool {
        self.scale.is_some() || self.offset.is_some() || self.map.is_some() || self.threshold.is_some()
    }
}

/// Sentences about a grid that was made of an image and may not be what the user expects.
pub(crate) fn remarks(grid: &GridPlace) -> Vec<String> {
    let (name, values) = (printable(&grid.name), &grid.values);
    let mut remarks = Vec::new();
    if grid.active_voxels == 0 && values.vanished == 0 {
        remarks.push(format!("grid '{name}': every value is 0, so that no voxel is active"));
    }
    if values.non_finite > 0 {
        let count = values.non_finite;
        remarks.push(format!("grid '{name}': {count} values are NaN or infinite; ⟨convert.repair⟩ sets them to 0"));
    }
    remarks.extend(losses(&name, values, grid.background.len()));
    if grid.value_type == "int32" {
        remarks.push(format!("grid '{name}' holds integers; ⟨as=float⟩ makes floats, and ⟨map=LOW,HIGH⟩ densities"));
    } else if values.least.is_some_and(|l| l < 0.0) {
        remarks.push(format!(
            "grid '{name}' has negative values: a transfer function in their unit shows them as they are, ⟨render.tf⟩; \
             ⟨map=LOW,HIGH⟩ makes densities"
        ));
    }
    remarks
}

/// Sentences about values that a grid of 32-bit floats does not hold.
pub(crate) fn losses(name: &str, values: &Tally, components: usize) -> Vec<String> {
    // Vectors have no other type.
    let remedy = if components == 1 { "; ⟨as=double⟩ keeps them" } else { "" };
    let sentences = [
        (values.rounded, "whole numbers beyond 16777216 are rounded to 32-bit floats"),
        (values.overflowed, "values are too large for 32-bit floats and became infinite"),
        (values.vanished, "values are too small for 32-bit floats and became 0"),
    ];
    let told = sentences.into_iter().filter(|(count, _)| *count > 0);
    told.map(|(count, what)| format!("grid '{name}': {count} {what}{remedy}")).collect()
}

/// Error that nothing is left of a grid.
pub(crate) fn empty(name: &str) -> Error {
    Error::invalid("no value differs from the background, 0, so that no voxel is active")
        .part(format!("grid '{name}'"))
        .hint("choose another ⟨threshold⟩ or ⟨map⟩, or another array")
}
