//! Images: which part of a file is read, where its voxels lie, and what becomes of its values.

use super::report::GridPlace;
use crate::error::{Error, Result};
use crate::formats::imaging::options::{Axes, Options as ReadOptions, RawLayout};
use crate::formats::imaging::values::{Mapping, Tally};
use crate::formats::imaging::volume::GridType;
use crate::formats::sample::{Endian, Sample};
use crate::math::Affine;
use crate::text::printable;
use glam::{DMat4, DVec3, DVec4};
use serde::{Deserialize, Serialize};

/// Part of an image that is read, and where its voxels lie.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ImageSettings {
    /// Number of the point in time, from 0; none for the first one.
    pub time: Option<usize>,
    /// OME-Zarr: number of the channel, from 0; none for the first one.
    pub channel: Option<usize>,
    /// OME-Zarr: number of the resolution, 0 for the finest; none for the finest that fits into memory.
    pub level: Option<usize>,
    /// DICOM: UID of the series, of a folder with several.
    pub series: Option<String>,
    /// Name of the array, of a file with several; none for all.
    pub array: Option<String>,
    /// Type of the grid's values; none for integers of images of integers, except NumPy's, else floats.
    #[serde(rename = "as")]
    pub grid_type: Option<GridType>,
    /// Order of the axes of NumPy's arrays, the slowest first; none for xyz.
    pub axes: Option<Axes>,
    /// Edge of a voxel in world units, for arrays, stacks and raw files.
    pub voxel_size: Option<f64>,
    /// Edges of a voxel along x, y and z in world units, in the place of `voxel_size`.
    pub spacing: Option<[f64; 3]>,
    /// World position of the centre of the first voxel, for arrays, stacks and raw files; none for the origin.
    pub origin: Option<[f64; 3]>,
    /// First three rows of the matrix from indices to the world, acting on columns, in the place of the three above.
    pub transform: Option<[[f64; 4]; 3]>,
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
        Ok(ReadOptions {
            time: self.time,
            channel: self.channel,
            level: self.level,
            series: self.series.clone(),
            array: self.array.clone(),
            spacing: self.spacing.map(DVec3::from_array).or(self.voxel_size.map(DVec3::splat)),
            origin: self.origin.map(DVec3::from_array),
            transform: self.transform.map(|rows| Affine::new(matrix(rows))).transpose()?,
            axes: self.axes(),
            raw,
        })
    }

    /// Order of the axes of an array.
    pub(crate) fn axes(&self) -> Axes {
        self.axes.unwrap_or_default()
    }

    /// Type of the grid; arrays of NumPy make floats unless told otherwise.
    pub(crate) fn grid_type(&self, array: bool) -> GridType {
        match self.grid_type {
            Some(stated) => stated,
            None if array => GridType::Float,
            None => GridType::Auto,
        }
    }
}

/// Returns the matrix with these first three rows.
fn matrix(rows: [[f64; 4]; 3]) -> DMat4 {
    let [x, y, z] = rows.map(DVec4::from_array);
    DMat4::from_cols(x, y, z, DVec4::W).transpose()
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
