//! Comparison of two grids.

use super::DiffSettings;
use super::turn::{self, Turned};
use crate::app::Context;
use crate::error::{Code, Error, Result};
use crate::formats::limits::Limits;
use crate::formats::vdb::{File, GridInfo, NativeGrid, RawGrid};
use crate::math::Affine;
use crate::metrics::volume::{Difference, Field, compare_within};
use crate::text::bytes as human;
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
        let mut budget = Budget { held: 0, limit: limits.max_memory };
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

/// Memory of the grids of a comparison together, in bytes.
struct Budget {
    held: u64,
    limit: u64,
}

impl Budget {
    /// Reserves `bytes`, and refuses them if they exceed the limit.
    fn take(&mut self, bytes: u64) -> Result<()> {
        self.held = self.held.saturating_add(bytes);
        if self.held <= self.limit {
            return Ok(());
        }
        let (needed, allowed) = (human(self.held), human(self.limit));
        Err(Error::unsupported(format!("comparing the grids needs {needed}, {allowed} are allowed"))
            .coded(Code::MemoryLimit)
            .hint("raise ⟨max_memory⟩, or compare parts of them: cumulo convert ⟨crop⟩"))
    }
}

/// A grid that was read.
pub(super) struct Loaded {
    /// The grid itself, kept if its values are wider than `f32`.
    wide: Option<NativeGrid>,
    pub(super) info: GridInfo,
    pub(super) raw: RawGrid,
}

fn load(file: &File, name: &str, budget: &mut Budget) -> Result<Loaded> {
    let place = |e: Error| e.at(file.path()).part(format!("grid '{name}'"));
    let in_file = file.find(name)?.topology.map_or(0, |t| t.memory);
    budget.take(in_file).map_err(place)?;
    let native = file.read(name)?;
    let info = native.info().map_err(place)?;
    info.affine().map_err(place)?;
    // A leaf's values, its mask, and its places in the lists and tables of the comparison.
    let leaf = 2048 * info.components as u64 + 256;
    budget.take(info.memory.saturating_sub(in_file) + info.leaf_count * leaf).map_err(place)?;
    let raw = native.to_raw().map_err(|e| place(e).hint("compare a grid with values: name it with ⟨grid⟩"))?;
    let wide = ["double", "vec3d", "int32", "int64", "vec3i"].contains(&info.value_type.as_str());
    if !wide {
        budget.held = budget.held.saturating_sub(info.memory.max(in_file));
    }
    Ok(Loaded { wide: wide.then_some(native), info, raw })
}

impl Loaded {
    pub(super) fn field(&self) -> Result<Field<'_>> {
        Ok(self.field_at(self.info.affine()?))
    }

    /// The volume as it lies by another transform.
    pub(super) fn field_at(&self, transform: Affine) -> Field<'_> {
        let mut background = [0.0; 3];
        background.iter_mut().zip(&self.info.background).for_each(|(to, from)| *to = *from as f32);
        let mut field = Field::new(self.raw.components, background, transform, self.info.index_box);
        self.raw.leaves.iter().for_each(|l| field.add_leaf(l.origin, &l.values, &l.active));
        self.raw.tiles.iter().for_each(|t| field.add_tile(t.origin, t.dim, t.value, t.active));
        field
    }
}
