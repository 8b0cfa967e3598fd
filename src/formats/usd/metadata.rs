//! Metadata of stages.

use super::value::Value;
use crate::scene::up::Up;

/// Axis that points upwards.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, schemars::JsonSchema)]
#[serde(rename_all = "UPPERCASE")]
pub enum UpAxis {
    /// +Y is up, which holds where a stage states nothing.
    Y,
    /// +Z is up.
    Z,
}

impl From<Up> for UpAxis {
    fn from(up: Up) -> Self {
        match up {
            Up::Y => Self::Y,
            Up::Z => Self::Z,
        }
    }
}

impl From<UpAxis> for Up {
    fn from(axis: UpAxis) -> Self {
        match axis {
            UpAxis::Y => Self::Y,
            UpAxis::Z => Self::Z,
        }
    }
}

/// Metadata of a stage.
#[derive(Debug, Clone, PartialEq)]
pub struct StageMetadata {
    /// Path of the default prim.
    pub default_prim: Option<String>,
    /// Axis that points upwards, if it is stated.
    pub up_axis: Option<UpAxis>,
    /// Length of a unit in meters, if it is stated; OpenUSD takes 0.01 otherwise.
    pub meters_per_unit: Option<f64>,
    /// Time codes per second, if they are stated; OpenUSD takes the frames per second or 24 otherwise.
    pub time_codes_per_second: Option<f64>,
    /// Frames per second, if they are stated.
    pub frames_per_second: Option<f64>,
    /// First time code, if it is stated.
    pub start: Option<f64>,
    /// Last time code, if it is stated.
    pub end: Option<f64>,
    /// Documentation of the root layer, where Blender states its version.
    pub documentation: Option<String>,
    /// Custom data of the root layer: a dictionary, if there is one.
    pub custom_data: Option<Value>,
}
