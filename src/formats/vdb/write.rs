//! Writing of VDB files, which appear whole or not at all.

use super::ffi;
use super::file::File;
use super::meta::Meta;
use super::native::NativeGrid;
use super::preflight;
use crate::error::{Error, Result};
use crate::formats::atomic::Draft;
use crate::formats::limits::Limits;
use crate::scene::grid::{Grid, MetaValue};
use crate::scratch;
use std::collections::BTreeMap;
use std::os::fd::AsRawFd;
use std::path::Path;
use std::ptr::null;

/// Compression of the values. `ZIP` is left out, because OpenVDB drops it silently for the classes written here.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Codec {
    /// Blosc compression: fast, with smaller files.
    #[default]
    Blosc,
    /// No compression: active values as they are.
    None,
}

/// Writes native grids. Names that repeat get OpenVDB's suffixes. The file's metadata is that of `source`, if given,
/// overridden by `metadata`. The written file is checked before it replaces an older one.
///
/// # Errors
/// If OpenVDB or the operating system reports an error, or the written file does not read back. The error has the path
/// and, where space is short, the length needed. Nothing is left behind then, and an older file stays.
pub fn write_native(
    path: &Path,
    grids: &[&NativeGrid],
    source: Option<&File>,
    metadata: &BTreeMap<String, MetaValue>,
    codec: Codec,
) -> Result<()> {
    write(path, (grids, None), source, metadata, codec)
}

/// Writes native grids as [`write_native`] does; where `values` are given, they are those of the leaves of each grid,
/// which have none.
fn write(
    path: &Path,
    (grids, values): (&[&NativeGrid], Option<&[&Grid]>),
    source: Option<&File>,
    metadata: &BTreeMap<String, MetaValue>,
    codec: Codec,
) -> Result<()> {
    let mut meta = match source {
        Some(file) => file.native_metadata()?,
        None => Meta::new()?,
    };
    for (name, value) in metadata {
        meta.set(name, value)?;
    }
    let handles: Vec<*const ffi::RawGrid> = grids.iter().map(|g| g.as_ptr().cast_const()).collect();
    let of_grid = |grid: &&Grid| grid.leaves.iter().map(|leaf| leaf.values.as_ptr()).collect::<Vec<_>>();
    let values: Option<Vec<Vec<*const f32>>> = values.map(|grids| grids.iter().map(of_grid).collect());
    let values: Option<Vec<_>> = values.as_ref().map(|grids| grids.iter().map(Vec::as_ptr).collect());
    let values = values.as_ref().map_or(null(), Vec::as_ptr);
    let codec = i32::from(codec == Codec::Blosc);
    let mut draft = Draft::begin(path)?;
    let (fd, mut length) = (draft.file().as_raw_fd(), 0);
    // SAFETY: the descriptor is open, `length` a valid place, all handles outlive the call, and so do the values, of
    // which each grid has as many as leaves.
    let written = ffi::call(|s| unsafe {
        ffi::write(fd, handles.as_ptr(), values, handles.len(), meta.as_ptr(), codec, &mut length, s)
    });
    written.map_err(|e| match e.os_error() {
        Some(number) => draft.unwritten(std::io::Error::from_raw_os_error(number), length),
        None => e.at(path),
    })?;
    verify(&draft, grids.len()).map_err(|e| {
        Error::native(format!("what was written does not read back: {}", e.what()))
            .at(path)
            .hint("nothing was changed; check the disk and its free space, then try again")
    })?;
    draft.commit()
}

/// Checks the written file as any file that is read, before it replaces an older one.
fn verify(draft: &Draft, grids: usize) -> Result<()> {
    let found = preflight::check(draft.path(), &Limits { max_memory: u64::MAX })?.entries.len();
    if found == grids { Ok(()) } else { Err(Error::native(format!("{found} of {grids} grids are there"))) }
}

/// Writes scalar grids as 32-bit floats, or as 16-bit floats if `half` is set. Where arrays lie in scratch files,
/// OpenVDB is given the leaves one by one, since all of them may not fit in memory.
///
/// # Errors
/// The conditions are those of [`NativeGrid::from_grid`] and [`write_native`].
pub fn write_grids(
    path: &Path,
    grids: &[&Grid],
    metadata: &BTreeMap<String, MetaValue>,
    codec: Codec,
    half: bool,
) -> Result<()> {
    write_some(path, grids, metadata, (codec, half), scratch::is_used())
}

/// Writes grids as [`write_grids`] does, leaf by leaf or not.
fn write_some(
    path: &Path,
    grids: &[&Grid],
    metadata: &BTreeMap<String, MetaValue>,
    (codec, half): (Codec, bool),
    by_leaf: bool,
) -> Result<()> {
    let mut native = Vec::with_capacity(grids.len());
    for grid in grids {
        let mut n = NativeGrid::of_grid(grid, !by_leaf)?;
        n.set_half(half)?;
        native.push(n);
    }
    write(path, (&native.iter().collect::<Vec<_>>(), by_leaf.then_some(grids)), None, metadata, codec)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use crate::math::Affine;
    use crate::scene::grid::{GridClass, Leaf, Tile};
    use glam::DVec3;

    /// Files that are written leaf by leaf hold what others do: grids with their metadata, values of all voxels, tiles.
    #[test]
    fn a_file_written_leaf_by_leaf_is_that_of_the_library() {
        let folder = tempfile::tempdir().unwrap();
        let leaf = |i: i32| Leaf {
            origin: [i / 25, i / 5 % 5, i % 5].map(|c| 8 * c - 24),
            values: std::array::from_fn(|v| (v as f32 * 0.37 + i as f32).sin().max(0.0)),
            active: std::array::from_fn(|word| 0x5555_1234_ffff_0000_u64.rotate_left(word as u32 + i as u32)),
        };
        let first = Grid {
            name: "density".into(),
            class: GridClass::FogVolume,
            transform: Affine::uniform(0.25, DVec3::new(1.0, 2.0, 3.0)).unwrap(),
            background: 0.0,
            leaves: (0..125).map(leaf).collect(),
            tiles: vec![Tile { origin: [128, -128, 0], dim: 128, value: 0.5, active: true }],
            metadata: BTreeMap::from([("made by".into(), MetaValue::Text("a test".into()))]),
        };
        let mut second = first.clone();
        second.leaves.truncate(3);
        let metadata = BTreeMap::from([("creator".into(), MetaValue::Text("me".into()))]);
        for (codec, half) in [(Codec::Blosc, false), (Codec::Blosc, true), (Codec::None, false)] {
            let path = |name: &str| folder.path().join(name);
            let grids = [&first, &second, &first];
            write_some(&path("whole.vdb"), &grids, &metadata, (codec, half), false).unwrap();
            write_some(&path("leaves.vdb"), &grids, &metadata, (codec, half), true).unwrap();
            let [whole, leaves] =
                ["whole.vdb", "leaves.vdb"].map(|name| File::open(path(name), Limits::default()).unwrap());
            assert_eq!(whole.metadata().unwrap(), leaves.metadata().unwrap());
            assert_eq!(whole.entries().len(), 3);
            for (a, b) in whole.entries().iter().zip(leaves.entries()) {
                assert_eq!((&a.name, &a.grid_type, a.half), (&b.name, &b.grid_type, b.half));
                let (a, b) = (whole.read(&a.name).unwrap(), leaves.read(&b.name).unwrap());
                assert!(a.same_values(&b).unwrap());
                let without = |grid: &NativeGrid| {
                    let mut metadata = grid.metadata().unwrap();
                    metadata.remove("file_delayed_load");
                    metadata
                };
                assert_eq!(without(&a), without(&b));
                assert_eq!(a.info().unwrap().affine().unwrap(), b.info().unwrap().affine().unwrap());
            }
            assert_eq!(whole.read_grid("density[1]").unwrap(), leaves.read_grid("density[1]").unwrap());
        }
    }
}
