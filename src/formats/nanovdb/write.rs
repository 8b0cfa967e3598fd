//! Writing of files.

use super::encode::{Encoded, VERSION, class, world_box};
use super::memory::Memory;
use super::nodes::{LeafRef, Nodes, TileRef, Value};
use super::volume::{Tree, Volume};
use crate::error::{Error, Result};
use crate::formats::atomic;
use crate::formats::limits::Limits;
use crate::scene::grid::LEAF_VOXELS;
use std::path::Path;

/// Largest difference of a cube's edges, relative to them.
const CUBE: f64 = 1e-6;

/// Lays out the leaves and tiles of one type of value.
fn laid_out<'v, V: Value, L, T>(
    volume: &Volume,
    background: V,
    leaves: &'v [L],
    tiles: &'v [T],
    limits: Limits,
) -> Result<Encoded>
where
    LeafRef<'v, V>: From<&'v L>,
    TileRef<V>: From<&'v T>,
{
    let tiles: Vec<_> = tiles.iter().map(TileRef::from).collect();
    Nodes::new(background, leaves.iter().map(LeafRef::from).collect(), &tiles)?.encode(volume, limits)
}

fn encoded(volume: &Volume, limits: Limits) -> Result<Encoded> {
    match &volume.tree {
        Tree::Scalars { background, leaves, tiles } => laid_out(volume, *background, leaves, tiles, limits),
        Tree::Integers { background, leaves, tiles } => laid_out(volume, *background, leaves, tiles, limits),
        Tree::Vectors { background, leaves, tiles } => {
            if let Some(leaf) = leaves.iter().find(|l| l.values.len() != 3 * LEAF_VOXELS) {
                return Err(Error::invalid(format!("a leaf of {} numbers; 1536 are expected", leaf.values.len()))
                    .hint("write the grid again where it was made"));
            }
            laid_out(volume, *background, leaves, tiles, limits)
        }
    }
}

/// Hash by which NanoVDB finds a grid of a name.
fn name_key(name: &str) -> u64 {
    name.bytes().fold(0_u64, |hash, byte| {
        let overflow = hash >> 56;
        hash.wrapping_mul(67).wrapping_add(u64::from(byte) + overflow)
    })
}

/// Entry of the file's directory.
fn metadata(volume: &Volume, encoded: &Encoded) -> Vec<u8> {
    let mut entry = Memory(vec![0; 176]);
    let size = encoded.memory.len() as u64;
    [size, size, name_key(&volume.name), encoded.voxels].iter().enumerate().for_each(|(i, v)| entry.u64(8 * i, *v));
    entry.u32(32, encoded.kind as u32);
    entry.u32(36, class(volume.class));
    entry.f64s(40, &world_box(volume, encoded.bounds));
    let empty = Some(([i32::MAX; 3], [i32::MIN; 3]));
    entry.bounds(88, encoded.bounds.or(empty), [0; 3]);
    entry.f64s(112, &volume.transform.voxel_size().to_array());
    entry.u32(136, volume.name.len() as u32 + 1);
    let nodes = encoded.nodes.iter().chain(&[1]).chain(&encoded.tiles);
    nodes.enumerate().for_each(|(i, n)| entry.u32(140 + 4 * i, *n));
    entry.u32(172, VERSION);
    entry.0.extend(volume.name.as_bytes());
    entry.0.push(0);
    entry.0
}

/// Lays out a file of one segment, not compressed.
///
/// # Errors
/// If there are no grids or more than 65535, two parts of a tree claim one place, or the memory of a grid exceeds the
/// limits.
pub fn encode(volumes: &[Volume], limits: Limits) -> Result<Vec<Vec<u8>>> {
    let count = u16::try_from(volumes.len()).ok().filter(|n| *n > 0).ok_or_else(|| {
        Error::invalid(format!("{} grids; a segment has 1 to 65535", volumes.len())).hint("choose some with ⟨grid⟩")
    })?;
    let mut head = b"NanoVDB0".to_vec();
    head.extend(VERSION.to_le_bytes());
    head.extend(count.to_le_bytes());
    head.extend([0; 2]);
    let mut parts = vec![Vec::new()];
    let mut held = 0;
    for volume in volumes {
        let left = Limits { max_memory: limits.max_memory.saturating_sub(held) };
        let encoded = encoded(volume, left).map_err(|e| e.part(format!("grid '{}'", volume.name)))?;
        head.extend(metadata(volume, &encoded));
        held += encoded.memory.len() as u64;
        parts.push(encoded.memory);
    }
    parts[0] = head;
    Ok(parts)
}

/// Writes grids to a file, whole or not at all, and returns what a user should know, one sentence each.
///
/// # Errors
/// If [`encode`] fails, or the operating system reports an error.
pub fn write(path: &Path, volumes: &[Volume], limits: Limits) -> Result<Vec<String>> {
    let parts = encode(volumes, limits).map_err(|e| e.at(path))?;
    atomic::write(path, |draft| parts.iter().try_for_each(|part| draft.write(part)))?;
    let oblong = volumes.iter().filter(|v| {
        let size = v.transform.voxel_size();
        size.max_element() - size.min_element() > CUBE * size.max_element()
    });
    Ok(oblong
        .map(|v| format!("grid '{}' has voxels that are no cubes, which some programs take for cubes", v.name))
        .collect())
}
