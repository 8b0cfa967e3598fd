//! Velocities from grids of vectors.

use super::File;
use crate::error::{Error, Result};
use crate::scene::bricks::too_large;
use crate::scene::grid::{GridClass, LEAF_VOXELS};
use crate::scene::velocity::Velocity;
use glam::{DVec3, Vec3};

/// Reads a grid of velocities in world units per second, staggered or not; `fps` are the frames per second.
///
/// # Errors
/// If [`File::read`] fails, the grid holds no vectors, its transform is not affine, a value is not finite, or grid and
/// copy do not fit into `max_memory` bytes.
pub(crate) fn read(file: &File, name: &str, fps: f64, max_memory: u64) -> Result<Velocity> {
    let place = |e: Error| e.part(format!("grid '{name}'")).at(file.path());
    let native = file.read(name)?;
    let info = native.info().map_err(place)?;
    if info.components != 3 {
        return Err(place(
            Error::unsupported(format!("the grid holds {} values, vec3s are needed for velocities", info.value_type))
                .hint("name the velocity grid, often 'vel' or 'v'; `cumulo info` lists what the file has"),
        ));
    }
    let bytes = info.memory.saturating_add(info.leaf_count * (12 * LEAF_VOXELS as u64 + 160));
    if bytes > max_memory {
        return Err(place(too_large(bytes, max_memory)));
    }
    let transform = info.affine().map_err(|e| e.at(file.path()))?;
    let background = DVec3::from_slice(&info.background).as_vec3();
    let staggered = info.class == GridClass::Staggered;
    let raw = native.to_raw().map_err(place)?;
    drop(native);
    let mut velocity = Velocity::new(transform, background, staggered, fps).map_err(place)?;
    for leaf in raw.leaves {
        velocity = velocity.leaf(leaf.origin, leaf.values).map_err(place)?;
    }
    for tile in raw.tiles {
        velocity = velocity.tile(tile.origin, tile.dim, Vec3::from_array(tile.value)).map_err(place)?;
    }
    Ok(velocity)
}
