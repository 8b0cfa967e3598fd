//! NumPy's arrays, which do not say where their voxels lie: the report does.

use super::values;
use crate::error::Result;
use crate::formats::atomic;
use crate::formats::imaging::options::Axes;
use crate::formats::imaging::source::Source;
use crate::formats::npy;
use std::path::Path;

/// Writes `array[x, y, z]` or `array[z, y, x]`, the last axis fastest; a last axis of three has the components of
/// vectors.
pub(crate) fn write(path: &Path, source: &Source, axes: Axes) -> Result<Vec<String>> {
    source.count()?;
    let [x, y, z] = source.size;
    let mut shape = if axes == Axes::Xyz { vec![x, y, z] } else { vec![z, y, x] };
    shape.extend((source.components > 1).then_some(source.components));
    atomic::write(path, |draft| {
        draft.write(&npy::written(source.sample, &shape))?;
        if axes == Axes::Zyx {
            return values(source, |bytes| draft.write(bytes));
        }
        let (mut slab, mut bytes) = (Vec::new(), Vec::new());
        for at in 0..x {
            source.slab(at, &mut slab)?;
            bytes.clear();
            source.sample.encode(&slab, &mut bytes);
            draft.write(&bytes)?;
        }
        Ok(())
    })?;
    Ok(Vec::new())
}
