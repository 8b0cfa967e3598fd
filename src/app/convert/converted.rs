//! Report of a converted grid.

use super::form::Formed;
use crate::formats::imaging::values::Tally;
use crate::formats::vdb::ResampleFilter;
use serde::Serialize;

/// Report of a grid.
#[derive(Debug, Default, Serialize, schemars::JsonSchema)]
pub(super) struct ConvertedGrid {
    pub name: String,
    pub from: String,
    pub active_voxels: u64,
    /// Filter of `resample`.
    pub filter: Option<ResampleFilter>,
    /// Form that `to` gave the grid; none where it stays as it was.
    pub formed: Option<Formed>,
    /// True if `up` turned the vectors that the grid holds; none for other grids.
    pub vectors_turned: Option<bool>,
    /// Number of values that `repair` set to zero.
    pub repaired: Option<u64>,
    /// Number of finite values that become infinite as 16-bit floats; none without `half`.
    pub half_overflow: Option<u64>,
    /// Number of values other than zero that become zero as 16-bit floats; none without `half`.
    pub half_underflow: Option<u64>,
    /// True if the transfer function of `tf` was attached to the grid.
    pub transfer: bool,
    /// Values after `scale`, `offset`, `map` and `threshold`; none without these.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub values: Option<Tally>,
}
