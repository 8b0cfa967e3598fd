//! Grids as dense arrays, over the box of their active voxels.

use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::formats::vdb::{NativeGrid, RawLeaf};
use crate::math::Affine;
use crate::scene::grid::{Grid, GridClass, LEAF_DIM, LEAF_VOXELS, Leaf};
use std::collections::BTreeMap;

/// Values of all voxels of a box.
#[derive(Debug, Clone, PartialEq)]
pub struct Dense {
    /// Index coordinates of the first voxel.
    pub origin: [i32; 3],
    /// Number of voxels along x, y and z.
    pub size: [usize; 3],
    /// Number of values per voxel, 1 or 3.
    pub components: usize,
    /// Values `values[((x * size[1] + y) * size[2] + z) * components + component]`.
    pub values: Vec<f32>,
}

impl Dense {
    /// Sets the voxels of a cube at `origin` (index coordinates) to what `value` gives for their offset in the cube, as far
    /// as they are in the box.
    fn fill<'v>(&mut self, origin: [i32; 3], edge: i32, value: impl Fn([usize; 3]) -> &'v [f32]) {
        // Differences are taken in 64 bits, for the coordinates of damaged grids.
        let range = |axis: usize| {
            let start = i64::from(origin[axis]) - i64::from(self.origin[axis]);
            let end = (start + i64::from(edge)).clamp(0, self.size[axis] as i64);
            (start, start.clamp(0, end) as usize..end as usize)
        };
        let [(x0, xs), (y0, ys), (z0, zs)] = [range(0), range(1), range(2)];
        let components = self.components;
        for x in xs {
            for y in ys.clone() {
                for z in zs.clone() {
                    let at = ((x * self.size[1] + y) * self.size[2] + z) * components;
                    let offset = [(x as i64 - x0) as usize, (y as i64 - y0) as usize, (z as i64 - z0) as usize];
                    self.values[at..at + components].copy_from_slice(value(offset));
                }
            }
        }
    }
}

/// Copies a grid of scalars or vectors over the box of its active voxels. Inactive voxels in the box have their own values.
///
/// # Errors
/// If the grid has other values or no active voxels, or it and its copy do not fit into the limits.
pub fn from_native(grid: &NativeGrid, limits: Limits) -> Result<Dense> {
    let info = grid.info()?;
    if info.components == 0 {
        return Err(Error::unsupported(format!("the grid holds {} values, which make no array", info.value_type))
            .hint("name a grid of scalars or vectors with --grid; cumulo info lists them"));
    }
    let Some((low, high)) = info.index_box else {
        return Err(
            Error::invalid("the grid has no active voxels, and so no box").hint("name another grid with --grid")
        );
    };
    let length = |axis: usize| (i64::from(high[axis]) - i64::from(low[axis]) + 1) as u64;
    let size = [length(0), length(1), length(2)];
    let count = size.iter().fold(info.components as u64, |product, n| product.saturating_mul(*n));
    let needed = count.saturating_mul(4).saturating_add(info.memory);
    if needed > limits.max_memory {
        let [x, y, z] = size;
        let what =
            format!("an array of {x} x {y} x {z} voxels needs {needed} bytes, {} are allowed", limits.max_memory);
        return Err(Error::unsupported(what)
            .hint("raise --max-memory, or take a part or coarser voxels first: cumulo convert --crop, --resample"));
    }
    let background: Vec<f32> = info.background.iter().map(|v| *v as f32).collect();
    let values = background.iter().copied().cycle().take(count as usize).collect();
    let mut dense = Dense { origin: low, size: size.map(|n| n as usize), components: info.components, values };
    for tile in grid.tiles()? {
        dense.fill(tile.origin, tile.dim, |_| &tile.value[..info.components]);
    }
    let components = info.components;
    grid.for_each_leaf(|leaf| {
        dense.fill(leaf.origin, LEAF_DIM, |[x, y, z]| {
            let at = (x << 6 | y << 3 | z) * components;
            &leaf.values[at..at + components]
        });
        true
    })?;
    Ok(dense)
}

/// Builds a grid of background 0 from a box; voxels other than 0 are active. Scalars make a fog volume.
///
/// # Errors
/// If the box has more voxels along an axis than indices, the values do not fill the box, memory does not suffice, or
/// OpenVDB cannot hold the grid.
pub fn to_native(dense: &Dense, name: &str, transform: &Affine, limits: Limits) -> Result<NativeGrid> {
    let components = dense.components;
    let voxels = dense.size.iter().try_fold(components, |product, n| product.checked_mul(*n));
    let fits = dense.size.iter().zip(dense.origin).all(|(n, o)| i64::from(o) + (*n as i64) < i64::from(i32::MAX));
    if voxels != Some(dense.values.len()) || !matches!(components, 1 | 3) || !fits {
        let what = format!("{} values do not fill a grid of {:?} voxels", dense.values.len(), dense.size);
        return Err(Error::invalid(what).hint("give an array [x, y, z] or [x, y, z, 3]"));
    }
    // Each leaf is held twice for a while: here and by OpenVDB.
    let leaf_bytes = 2 * (4 * LEAF_VOXELS * components + 160) as u64;
    let mut held = 4 * dense.values.len() as u64;
    let mut leaves = Vec::new();
    let starts = |axis: usize| {
        let low = dense.origin[axis];
        (low.div_euclid(LEAF_DIM) * LEAF_DIM..low + dense.size[axis] as i32).step_by(LEAF_DIM as usize)
    };
    for x in starts(0) {
        for y in starts(1) {
            for z in starts(2) {
                let leaf = leaf(dense, [x, y, z]);
                if leaf.active == [0; 8] {
                    continue;
                }
                held += leaf_bytes;
                if held > limits.max_memory {
                    return Err(limits.exceeded(held, leaves.len() as u64));
                }
                leaves.push(leaf);
            }
        }
    }
    if components == 3 {
        return NativeGrid::from_vectors(name, GridClass::Unknown, transform, &leaves);
    }
    let scalar = |leaf: RawLeaf| {
        let mut values = Box::new([0.0; LEAF_VOXELS]);
        values.copy_from_slice(&leaf.values);
        Leaf { origin: leaf.origin, values, active: leaf.active }
    };
    NativeGrid::from_grid(&Grid {
        name: name.to_owned(),
        class: GridClass::FogVolume,
        transform: *transform,
        background: 0.0,
        leaves: leaves.into_iter().map(scalar).collect(),
        tiles: Vec::new(),
        metadata: BTreeMap::new(),
    })
}

/// Leaf at `origin` (index coordinates); voxels outside the box are 0.
fn leaf(dense: &Dense, origin: [i32; 3]) -> RawLeaf {
    let components = dense.components;
    let mut values = vec![0.0; LEAF_VOXELS * components];
    let mut active = [0_u64; 8];
    for voxel in 0..LEAF_VOXELS {
        let local = [voxel >> 6, voxel >> 3 & 7, voxel & 7];
        let at: [i64; 3] = std::array::from_fn(|a| i64::from(origin[a]) + local[a] as i64 - i64::from(dense.origin[a]));
        if at.iter().zip(dense.size).any(|(i, n)| *i < 0 || *i >= n as i64) {
            continue;
        }
        let [x, y, z] = at.map(|i| i as usize);
        let from = ((x * dense.size[1] + y) * dense.size[2] + z) * components;
        let value = &dense.values[from..from + components];
        values[voxel * components..(voxel + 1) * components].copy_from_slice(value);
        if value.iter().any(|v| *v != 0.0) {
            active[voxel >> 6] |= 1 << (voxel & 63);
        }
    }
    RawLeaf { origin, values, active }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use glam::DVec3;

    fn dense(origin: [i32; 3], size: [usize; 3], components: usize) -> Dense {
        let count = size.iter().product::<usize>() * components;
        // No value is 0, so that the box of active voxels is the whole.
        let values = (0..count).map(|i| (i * 7 % 31) as f32 - 40.0).collect();
        Dense { origin, size, components, values }
    }

    #[test]
    fn grids_and_arrays_are_the_same() {
        let transform = Affine::uniform(0.25, DVec3::new(1.0, -2.0, 3.0)).unwrap();
        for (origin, size, components) in
            [([0; 3], [3, 20, 9], 1), ([-5, 7, -8], [17, 1, 8], 1), ([-1, -1, 0], [9, 2, 3], 3)]
        {
            let given = dense(origin, size, components);
            let native = to_native(&given, "a", &transform, Limits::default()).unwrap();
            assert_eq!(from_native(&native, Limits::default()).unwrap(), given);
            assert_eq!(native.info().unwrap().affine().unwrap(), transform);
        }
    }

    #[test]
    fn memory_is_bounded_and_emptiness_named() {
        let transform = Affine::uniform(1.0, DVec3::ZERO).unwrap();
        let given = dense([0; 3], [16, 16, 16], 1);
        let few = Limits { max_memory: 20_000 };
        assert!(to_native(&given, "a", &transform, few).unwrap_err().to_string().contains("--max-memory"));
        let native = to_native(&given, "a", &transform, Limits::default()).unwrap();
        assert!(from_native(&native, few).unwrap_err().to_string().contains("16 x 16 x 16"));
        let nothing = Dense { values: vec![0.0; 4096], ..given };
        let native = to_native(&nothing, "a", &transform, Limits::default()).unwrap();
        assert!(from_native(&native, few).unwrap_err().to_string().contains("no active voxels"));
        let short = Dense { values: vec![0.0; 7], ..nothing };
        assert!(to_native(&short, "a", &transform, few).is_err());
    }

    #[test]
    fn tiles_fill_their_part_of_the_box() {
        let mut native = to_native(
            &dense([0; 3], [16, 8, 8], 1),
            "a",
            &Affine::uniform(1.0, DVec3::ZERO).unwrap(),
            Limits::default(),
        )
        .unwrap();
        let before = from_native(&native, Limits::default()).unwrap();
        // Everything within 100 of a value becomes constant: the leaves turn into tiles.
        native.prune(100.0).unwrap();
        assert!(native.info().unwrap().active_tiles > 0);
        let after = from_native(&native, Limits::default()).unwrap();
        assert_eq!((before.size, before.origin), (after.size, after.origin));
        assert!(after.values[..512].iter().all(|v| *v == after.values[0]));
    }
}
