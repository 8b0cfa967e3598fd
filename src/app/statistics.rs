//! Statistics of the values of grids in files.

use crate::error::Result;
use crate::formats::vdb::NativeGrid;
use crate::scene::statistics::{self, Statistics};

/// Computes statistics of a grid's active voxels and tiles, of vectors by their lengths. Leaves are decoded one by one.
///
/// # Errors
/// If the grid has no values (points).
pub(crate) fn statistics_of(native: &NativeGrid) -> Result<Statistics> {
    let magnitude = |v: &[f32]| match v {
        [one] => *one,
        many => many.iter().map(|c| c * c).sum::<f32>().sqrt(),
    };
    let (components, tiles) = (native.info()?.components, native.tiles()?);
    statistics::of(|count| {
        native.for_each_leaf(|leaf| {
            for i in (0..512).filter(|i| leaf.active[i >> 6] >> (i & 63) & 1 == 1) {
                count(magnitude(&leaf.values[i * components..][..components]), 1);
            }
            true
        })?;
        for tile in tiles.iter().filter(|t| t.active) {
            count(magnitude(&tile.value[..components]), (tile.dim as u64).pow(3));
        }
        Ok(())
    })
}
