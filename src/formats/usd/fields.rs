//! Grids of OpenVDB files as fields of UsdVol.

use crate::error::Result;
use crate::formats::limits::Limits;
use crate::formats::vdb::{File, GridInfo, Transform};
use crate::math::Aabb;
use crate::scene::grid::GridClass;
use std::path::Path;

/// A grid in the words of UsdVol's schema `OpenVDBAsset`.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct GridField {
    /// Name of the grid, which `fieldName` holds; several grids of a file may share it.
    pub name: String,
    /// Place among the grids of this name, which `fieldIndex` holds.
    pub index: usize,
    /// Type of the values, which `fieldDataType` holds; `None` where the schema has no word for it.
    pub data_type: Option<&'static str>,
    /// Class of the grid, which `fieldClass` holds.
    pub class: &'static str,
    /// True if real values are stored as 16-bit floats.
    pub half: bool,
    /// Longest edge of a voxel in world units; `None` for a transform that is not affine.
    pub voxel: Option<f64>,
    /// World-space box around the active voxels' cells; `None` without active voxels or with a transform that is not
    /// affine.
    pub bounds: Option<Aabb>,
}

impl GridField {
    /// True if a grid's name in its file is `name`: grids of one name are told apart by their places, such as
    /// `density[1]`.
    pub(crate) fn is_called(&self, name: &str) -> bool {
        (self.index == 0 && self.name == name)
            || name.strip_prefix(&self.name).is_some_and(|number| number == format!("[{}]", self.index))
    }
}

/// Reads all grids of a file as fields, in file order. Points are left out, since no field holds them.
///
/// # Errors
/// If the file or one of its grids cannot be read, or does not fit into `limits`.
pub(crate) fn read(path: &Path, limits: Limits) -> Result<Vec<GridField>> {
    let file = File::open(path, limits)?;
    let mut fields: Vec<GridField> = Vec::new();
    for entry in file.entries() {
        let info = file.read(&entry.name)?.info().map_err(|e| e.at(path))?;
        if info.value_type.starts_with("ptdataidx") {
            continue;
        }
        let index = fields.iter().filter(|field| field.name == entry.base_name).count();
        fields.push(GridField {
            name: entry.base_name.clone(),
            index,
            data_type: data_type(&info.value_type),
            class: class(info.class),
            half: info.half,
            voxel: match &info.transform {
                Transform::Affine(map) => Some(map.voxel_size().max_element()),
                Transform::Other(_) => None,
            },
            bounds: GridInfo::world_box(&info),
        });
    }
    Ok(fields)
}

/// Returns the schema's word for the type of a grid's values.
fn data_type(value_type: &str) -> Option<&'static str> {
    Some(match value_type {
        "half" => "half",
        "float" => "float",
        "double" => "double",
        "int32" => "int",
        "int64" => "int64",
        "bool" => "bool",
        "mask" => "mask",
        "string" => "string",
        "vec2i" => "int2",
        "vec2s" => "float2",
        "vec2d" => "double2",
        "vec3i" => "int3",
        "vec3s" => "float3",
        "vec3d" => "double3",
        _ => return None,
    })
}

/// Returns the schema's word for a class of grids.
fn class(class: GridClass) -> &'static str {
    match class {
        GridClass::FogVolume => "fogVolume",
        GridClass::LevelSet => "levelSet",
        GridClass::Staggered => "staggered",
        GridClass::Unknown => "unknown",
    }
}
