//! Comparison of two grids.

use super::DiffSettings;
use super::loaded::{Budget, load};
use super::turn::{self, Turned};
use crate::app::Context;
use crate::error::Result;
use crate::formats::limits::Limits;
use crate::formats::vdb::File;
use crate::metrics::volume::{Difference, compare_within};
use schemars::JsonSchema;
use serde::Serialize;

/// A grid that was compared.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct Compared {
    pub(super) name: String,
    /// Name of the grid in the second file, if it differs from the name in the first.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) name_in_b: Option<String>,
    #[serde(flatten)]
    pub(super) difference: Difference,
    /// Turn of the second grid after which it agrees with the first; none if it agrees as it lies, or after no turn.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) agrees_after_turn: Option<Turned>,
    /// True if the values are equal as 32-bit floats, in which differences are measured, but not in the grids' wider
    /// type.
    pub(super) differs_beyond_f32: bool,
}

impl DiffSettings {
    /// Compares two grids, each given by its file and name.
    pub(super) fn grids(
        &self,
        [(a, in_a), (b, in_b)]: [(&File, &String); 2],
        limits: Limits,
        context: &Context,
    ) -> Result<Compared> {
        let mut budget = Budget::new(limits);
        let [left, right] = {
            let _stage = context.stage("reading");
            [load(a, in_a, &mut budget)?, load(b, in_b, &mut budget)?]
        };
        let bar = context.steps(0, "comparing");
        let show = |done: u64, of: u64| {
            bar.set(done, of, "");
        };
        let effort = self.voxels.effort();
        let difference = compare_within(&left.field()?, &right.field()?, effort, &show)
            .map_err(|e| e.at(b.path()).part(format!("grid '{in_b}'")))?;
        // `same_values` is stricter than wanted where nodes differ and voxels do not.
        let differs_beyond_f32 = match (&left.wide, &right.wide) {
            (Some(a), Some(b)) if left.info.value_type == right.info.value_type => {
                difference.within(0.0) && difference.topology_iou == 1.0 && !a.same_values(b)?
            }
            _ => false,
        };
        let name_in_b = (in_a != in_b).then(|| in_b.clone());
        let agrees_after_turn = match difference.within(self.tolerance) {
            true => None,
            false => turn::turned(&left, &right, &difference, effort)?,
        };
        Ok(Compared { name: in_a.clone(), name_in_b, difference, agrees_after_turn, differs_beyond_f32 })
    }
}
