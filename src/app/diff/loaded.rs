//! Grids that are read to be compared.

use crate::error::{Code, Error, Result};
use crate::formats::limits::Limits;
use crate::formats::vdb::{File, GridInfo, NativeGrid, RawGrid};
use crate::math::Affine;
use crate::metrics::volume::Field;
use crate::text::bytes as human;

/// Memory of the grids of a comparison together, in bytes.
pub(super) struct Budget {
    held: u64,
    limit: u64,
}

impl Budget {
    /// Creates a budget of which nothing is used.
    pub(super) fn new(limits: Limits) -> Self {
        Self { held: 0, limit: limits.max_memory }
    }

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
    pub(super) wide: Option<NativeGrid>,
    pub(super) info: GridInfo,
    pub(super) raw: RawGrid,
}

/// Reads a grid within the budget.
pub(super) fn load(file: &File, name: &str, budget: &mut Budget) -> Result<Loaded> {
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
