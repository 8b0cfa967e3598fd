//! From and to grids of OpenVDB.

use super::layout::Kind;
use super::volume::{IntegerLeaf, IntegerTile, Tree, Volume};
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::formats::vdb::{DenseBox, NativeGrid, RawGrid, ValueKind};
use crate::scene::grid::{Grid, LEAF_VOXELS, Leaf, Tile};
use std::collections::BTreeMap;

/// Steps between the voxels of a leaf, z fastest.
const STRIDES: [i64; 3] = [64, 8, 1];

/// True if voxel `i` of a leaf is active.
fn is_active(active: &[u64; 8], i: usize) -> bool {
    active[i >> 6] >> (i & 63) & 1 == 1
}

impl Volume {
    /// Makes a grid of OpenVDB of the same values. Integers keep their values where they are active and not 0; such
    /// grids have background 0, so that others become floats.
    ///
    /// # Errors
    /// If OpenVDB cannot hold the grid; see [`NativeGrid::from_grid`].
    pub fn into_native(mut self) -> Result<(NativeGrid, Vec<String>)> {
        let mut notes = std::mem::take(&mut self.notes);
        let native = match self.tree {
            Tree::Scalars { background, leaves, tiles } => NativeGrid::from_grid(&Grid {
                name: self.name,
                class: self.class,
                transform: self.transform,
                background,
                leaves,
                tiles,
                metadata: BTreeMap::new(),
            })?,
            Tree::Vectors { background, leaves, tiles } => {
                let raw = RawGrid { components: 3, leaves, tiles };
                NativeGrid::from_raw(&self.name, self.class, &self.transform, background, &raw)?
            }
            Tree::Integers { background: 0, ref leaves, ref tiles } => {
                let zeros =
                    leaves.iter().any(|l| (0..LEAF_VOXELS).any(|i| l.values[i] == 0 && is_active(&l.active, i)));
                if zeros {
                    notes.push("voxels of value 0 become inactive".into());
                }
                let hidden = |l: &IntegerLeaf| (0..LEAF_VOXELS).any(|i| l.values[i] != 0 && !is_active(&l.active, i));
                if leaves.iter().any(hidden) || tiles.iter().any(|t| t.value != 0 && !t.active) {
                    notes.push("values of inactive voxels become 0".into());
                }
                self.integers(leaves, tiles)?
            }
            Tree::Integers { background, leaves, tiles } => {
                notes.push(format!("integers become floats, as their background is {background} and not 0"));
                let leaf = |l: IntegerLeaf| {
                    let values = std::array::from_fn(|i| l.values[i] as f32);
                    Leaf { origin: l.origin, values, active: l.active }
                };
                let tile =
                    |t: IntegerTile| Tile { origin: t.origin, dim: t.dim, value: t.value as f32, active: t.active };
                NativeGrid::from_grid(&Grid {
                    name: self.name,
                    class: self.class,
                    transform: self.transform,
                    background: background as f32,
                    leaves: leaves.into_iter().map(leaf).collect(),
                    tiles: tiles.into_iter().map(tile).collect(),
                    metadata: BTreeMap::new(),
                })?
            }
        };
        Ok((native, notes))
    }

    fn integers(&self, leaves: &[IntegerLeaf], tiles: &[IntegerTile]) -> Result<NativeGrid> {
        let mut native = NativeGrid::empty(ValueKind::Int32, &self.name, self.class, &self.transform)?;
        for tile in tiles.iter().filter(|t| t.active && t.value != 0) {
            native.add_tile(tile.origin, tile.dim, tile.value.into())?;
        }
        let mut values = [0.0; LEAF_VOXELS];
        for leaf in leaves {
            for (i, value) in values.iter_mut().enumerate() {
                *value = if is_active(&leaf.active, i) { leaf.values[i].into() } else { 0.0 };
            }
            let place = DenseBox { low: leaf.origin, high: leaf.origin.map(|c| c + 7), strides: STRIDES };
            native.write_box(&place, &values, u64::MAX)?;
        }
        Ok(native)
    }

    /// Copies a grid of OpenVDB: float, vec3s and int32 as they are, other scalars as floats and other vectors as
    /// vec3s.
    ///
    /// # Errors
    /// If the grid holds points or its transform is not affine, or it and its copy do not fit into the limits.
    pub fn of_native(grid: &NativeGrid, limits: Limits) -> Result<Self> {
        let info = grid.info()?;
        let transform = info.affine()?;
        let needed = info.memory.saturating_add(info.leaf_count.saturating_mul(info.leaf_bytes()));
        if needed > limits.max_memory {
            return Err(limits.exceeded(needed, info.leaf_count));
        }
        let mut notes = Vec::new();
        let (kind, tree) = match (info.components, info.value_type.as_str()) {
            (1, "int32") => (Kind::Int32, integers_of(grid, info.background[0] as i32)?),
            (1, of) => {
                if of != "float" {
                    notes.push(format!("grid '{}': {of} values are written as floats", info.name));
                }
                let copy = grid.to_grid_within(limits.max_memory)?;
                let Grid { background, leaves, tiles, .. } = copy;
                (Kind::Float, Tree::Scalars { background, leaves, tiles })
            }
            (3, of) => {
                if of != "vec3s" {
                    notes.push(format!("grid '{}': {of} values are written as vec3f", info.name));
                }
                let RawGrid { leaves, tiles, .. } = grid.to_raw()?;
                let background = std::array::from_fn(|c| info.background[c] as f32);
                (Kind::Vec3f, Tree::Vectors { background, leaves, tiles })
            }
            (_, of) => {
                return Err(Error::unsupported(format!("grids of {of} are not written as NanoVDB"))
                    .part(format!("grid '{}'", info.name))
                    .hint("name the other grids with ⟨grid⟩"));
            }
        };
        Ok(Self { name: info.name, class: info.class, transform, kind, tree, texts: BTreeMap::new(), notes })
    }
}

/// Leaves and tiles of a grid of 32-bit integers, exactly.
fn integers_of(grid: &NativeGrid, background: i32) -> Result<Tree> {
    let mut leaves = Vec::new();
    grid.for_each_leaf(|leaf| {
        leaves.push(IntegerLeaf { origin: leaf.origin, values: Box::new([0; LEAF_VOXELS]), active: leaf.active });
        true
    })?;
    let mut values = [0.0; LEAF_VOXELS];
    for leaf in &mut leaves {
        let place = DenseBox { low: leaf.origin, high: leaf.origin.map(|c| c + 7), strides: STRIDES };
        grid.read_box(&place, &mut values)?;
        leaf.values.iter_mut().zip(values).for_each(|(to, from)| *to = from as i32);
    }
    let mut tiles = Vec::new();
    for tile in grid.tiles()? {
        let mut value = [0.0];
        grid.read_box(&DenseBox { low: tile.origin, high: tile.origin, strides: [1; 3] }, &mut value)?;
        tiles.push(IntegerTile { origin: tile.origin, dim: tile.dim, value: value[0] as i32, active: tile.active });
    }
    Ok(Tree::Integers { background, leaves, tiles })
}
