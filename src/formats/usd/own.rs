//! Names of Cumulo's own attributes of meshes.

pub(super) const ALBEDO: &str = "cumulo:albedo";
pub(super) const EMISSION: &str = "cumulo:emission";
pub(super) const HOLDOUT: &str = "cumulo:holdout";
