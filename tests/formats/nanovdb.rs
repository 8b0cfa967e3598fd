//! NanoVDB files: what is written is read, by this program and by NanoVDB's own; damaged files are refused.

use cumulo::formats::limits::Limits;
use cumulo::formats::nanovdb::{Codec, File, IntegerLeaf, IntegerTile, Kind, Tree, Volume, encode, write};
use cumulo::formats::vdb::{RawLeaf, RawTile};
use cumulo::math::Affine;
use cumulo::scene::grid::{GridClass, LEAF_VOXELS, Leaf, Tile};
use glam::{DMat4, DVec3};
use std::collections::BTreeMap;
use std::path::Path;

const LIMITS: Limits = Limits { max_memory: 64 << 20 };

fn sheared() -> Affine {
    let columns = [DVec3::new(0.5, 0.1, 0.0), DVec3::new(0.0, 0.25, -0.2), DVec3::new(0.3, 0.0, 2.0)];
    let [x, y, z] = columns.map(|c| c.extend(0.0));
    Affine::new(DMat4::from_cols(x, y, z, DVec3::new(10.0, -20.0, 30.0).extend(1.0))).unwrap()
}

/// Number of a voxel that differs from leaf to leaf.
fn number(origin: [i32; 3], i: usize) -> i32 {
    origin[0] * 3 + origin[1] * 5 + origin[2] * 7 + i as i32 * 11 - 2000
}

/// Leaves on both sides of 0 and in several nodes of each level, in ascending order.
const ORIGINS: [[i32; 3]; 6] = [[-4104, 8, 0], [-8, -8, -8], [0, 0, 0], [0, 0, 8], [128, 0, 0], [8192, 4096, -4096]];

fn mask(origin: [i32; 3]) -> [u64; 8] {
    std::array::from_fn(|word| (number(origin, word) as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15))
}

fn volume(name: &str, kind: Kind, tree: Tree) -> Volume {
    Volume {
        name: name.into(),
        class: GridClass::FogVolume,
        transform: sheared(),
        kind,
        tree,
        texts: BTreeMap::new(),
        notes: Vec::new(),
    }
}

/// Tiles of each level, active and not, in ascending order.
const TILES: [([i32; 3], i32, bool); 4] =
    [([-12_288, 0, 0], 4096, true), ([0, 128, 0], 128, true), ([8, 0, 0], 8, false), ([256, 0, 0], 128, false)];

fn scalars() -> Volume {
    let leaf = |origin: [i32; 3]| {
        let values = std::array::from_fn(|i| number(origin, i) as f32 / 8.0);
        Leaf { origin, values, active: mask(origin) }
    };
    let tile = |(origin, dim, active)| Tile { origin, dim, value: 3.5, active };
    let leaves = ORIGINS.map(leaf).to_vec();
    volume("density", Kind::Float, Tree::Scalars { background: 0.25, leaves, tiles: TILES.map(tile).to_vec() })
}

fn vectors() -> Volume {
    let leaf = |origin: [i32; 3]| RawLeaf {
        origin,
        values: (0..3 * LEAF_VOXELS).map(|i| number(origin, i) as f32 / 4.0).collect(),
        active: mask(origin),
    };
    let tile = |(origin, dim, active)| RawTile { origin, dim, value: [1.0, -2.0, 3.0], active };
    let tree = Tree::Vectors {
        background: [0.5, 0.0, -0.5],
        leaves: ORIGINS.map(leaf).to_vec(),
        tiles: TILES.map(tile).to_vec(),
    };
    volume("velocity", Kind::Vec3f, tree)
}

fn integers() -> Volume {
    let leaf = |origin: [i32; 3]| IntegerLeaf {
        origin,
        // Beyond 2^24, where floats have gaps.
        values: Box::new(std::array::from_fn(|i| number(origin, i) * 100_003)),
        active: mask(origin),
    };
    let tile = |(origin, dim, active)| IntegerTile { origin, dim, value: -77_777_777, active };
    let tree = Tree::Integers { background: 5, leaves: ORIGINS.map(leaf).to_vec(), tiles: TILES.map(tile).to_vec() };
    volume("labels", Kind::Int32, tree)
}

fn read_all(path: &Path, limits: Limits) -> cumulo::Result<Vec<Volume>> {
    let mut file = File::open(path, limits)?;
    (0..file.entries().len()).map(|i| file.read(i)).collect()
}

#[test]
fn what_is_written_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.nvdb");
    let all = [scalars(), vectors(), integers()];
    let notes = write(&path, &all, LIMITS).unwrap();
    assert!(notes.len() == 3 && notes[0].contains("no cubes"), "{notes:?}");
    assert_eq!(read_all(&path, LIMITS).unwrap(), all);
    let file = File::open(&path, LIMITS).unwrap();
    let kinds: Vec<_> = file.entries().iter().map(|e| (e.name.as_str(), e.kind_name(), e.codec)).collect();
    let plain = Codec::None;
    assert_eq!(kinds, [("density", "float", plain), ("velocity", "vec3f", plain), ("labels", "int32", plain)]);
    let Tree::Scalars { leaves, .. } = &all[0].tree else { panic!() };
    let voxels: u64 = leaves.iter().flat_map(|l| l.active).map(|w| u64::from(w.count_ones())).sum();
    assert_eq!(file.entries()[0].active_voxels, voxels + 4096_u64.pow(3) + 128_u64.pow(3));
}

#[test]
fn integers_say_what_their_grid_cannot_hold() {
    let notes = |values: [i32; LEAF_VOXELS], active: [u64; 8]| {
        let leaves = vec![IntegerLeaf { origin: [0; 3], values: Box::new(values), active }];
        let tree = Tree::Integers { background: 0, leaves, tiles: Vec::new() };
        volume("labels", Kind::Int32, tree).into_native().unwrap().1.join("; ")
    };
    assert_eq!(notes([3; LEAF_VOXELS], [u64::MAX; 8]), "");
    assert_eq!(notes([3; LEAF_VOXELS], [1; 8]), "values of inactive voxels become 0");
    assert_eq!(notes([0; LEAF_VOXELS], [1; 8]), "voxels of value 0 become inactive");
}

#[test]
fn bare_grids_and_empty_ones_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bare.nvdb");
    let empty = volume("none", Kind::Float, Tree::Scalars { background: 1.5, leaves: Vec::new(), tiles: Vec::new() });
    let all = [scalars(), empty];
    let parts = encode(&all, LIMITS).unwrap();
    std::fs::write(&path, parts[1..].concat()).unwrap();
    assert_eq!(read_all(&path, LIMITS).unwrap(), all);
    // Since 32.6 a bare grid begins with another digit, and so does a segment.
    let mut newer = parts[1].clone();
    newer[7] = b'1';
    std::fs::write(&path, newer).unwrap();
    assert_eq!(read_all(&path, LIMITS).unwrap(), all[..1]);
    let mut segment = parts.concat();
    segment[7] = b'2';
    std::fs::write(&path, segment).unwrap();
    assert_eq!(read_all(&path, LIMITS).unwrap(), all);
}

#[test]
fn zipped_grids_are_read() {
    let all = [scalars()];
    let parts = encode(&all, LIMITS).unwrap();
    let level = libdeflater::CompressionLvl::default();
    let mut packed = vec![0; parts[1].len()];
    let n = libdeflater::Compressor::new(level).zlib_compress(&parts[1], &mut packed).unwrap();
    let mut head = parts[0].clone();
    head[14] = 1;
    head[16 + 8..16 + 16].copy_from_slice(&(n as u64 + 8).to_le_bytes());
    let file = tempfile::NamedTempFile::new().unwrap();
    let bytes = [&head[..], &(n as u64).to_le_bytes(), &packed[..n]].concat();
    std::fs::write(file.path(), &bytes).unwrap();
    assert_eq!(read_all(file.path(), LIMITS).unwrap(), all);
    std::fs::write(file.path(), &bytes[..bytes.len() - 1]).unwrap();
    assert!(read_all(file.path(), LIMITS).is_err());
    // A size that no stream of this length unpacks to is refused before it is allocated.
    let mut bomb = bytes;
    bomb[16..24].copy_from_slice(&(1_u64 << 40).to_le_bytes());
    std::fs::write(file.path(), &bomb).unwrap();
    let limits = Limits { max_memory: u64::MAX };
    assert!(read_all(file.path(), limits).unwrap_err().to_string().contains("bytes in the file"), "{bomb:?}");
}

#[test]
fn what_clashes_or_is_too_large_is_not_written() {
    let mut twice = scalars();
    if let Tree::Scalars { tiles, .. } = &mut twice.tree {
        tiles.push(Tile { origin: [0, 0, 0], dim: 8, value: 1.0, active: true });
    }
    assert!(encode(&[twice], LIMITS).unwrap_err().to_string().contains("claim the voxels"));
    let mut odd = scalars();
    if let Tree::Scalars { tiles, .. } = &mut odd.tree {
        tiles[0].dim = 16;
    }
    assert!(encode(&[odd], LIMITS).unwrap_err().to_string().contains("16 voxels"));
    let few = Limits { max_memory: 1 << 20 };
    assert!(encode(&[scalars()], few).unwrap_err().to_string().contains("`max_memory`"));
    assert!(encode(&[], LIMITS).is_err());
}

/// Every value of a real file, against those that NanoVDB's headers (`util/NanoToOpenVDB.h`, OpenVDB 10.0.1) give for it:
/// the bytes of origins, masks and values of all leaves, then of origins, edges, values and states of all tiles, in
/// ascending order.
#[test]
#[ignore = "needs rocks.nvdb, whose path CUMULO_ROCKS_NVDB gives"]
fn a_real_level_set_has_its_values() {
    let path = std::env::var_os("CUMULO_ROCKS_NVDB").unwrap();
    let rocks = read_all(path.as_ref(), LIMITS).unwrap().remove(0);
    assert_eq!((rocks.name.as_str(), rocks.class, rocks.notes.len()), ("surface", GridClass::LevelSet, 0));
    assert_eq!(rocks.transform.voxel_size(), DVec3::splat(f64::from(0.2_f32)));
    let Tree::Scalars { background, leaves, tiles } = rocks.tree else { panic!() };
    assert_eq!((background, leaves.len(), tiles.len()), (0.6, 1493, 329));
    let mut bytes = Vec::new();
    for leaf in &leaves {
        bytes.extend(leaf.origin.iter().flat_map(|c| c.to_le_bytes()));
        bytes.extend(leaf.active.iter().flat_map(|w| w.to_le_bytes()));
        bytes.extend(leaf.values.iter().flat_map(|v| v.to_le_bytes()));
    }
    for tile in &tiles {
        bytes.extend(tile.origin.iter().flat_map(|c| c.to_le_bytes()));
        bytes.extend(tile.dim.to_le_bytes());
        bytes.extend(tile.value.to_le_bytes());
        bytes.push(tile.active.into());
    }
    assert_eq!((bytes.len(), libdeflater::crc32(&bytes)), (3_178_041, CRC));
}

/// Checksum of those bytes, as NanoVDB's headers give them.
const CRC: u32 = 2_168_899_656;

/// Places of a small file at which damage is tried: bytes of its headers, and many of the bytes behind them.
fn places(length: usize, headers: usize) -> impl Iterator<Item = usize> {
    (0..headers).step_by(7).chain((headers..length).step_by(19_973))
}

#[test]
fn damaged_files_are_refused_or_read_and_never_crash() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.nvdb");
    let mut small = scalars();
    if let Tree::Scalars { leaves, tiles, .. } = &mut small.tree {
        leaves.truncate(1);
        tiles.truncate(1);
    }
    let whole = encode(&[small], LIMITS).unwrap().concat();
    // The segment's header, the metadata, the grid, the tree and the root with two tiles.
    let headers = 16 + 176 + 8 + 672 + 64 + 64 + 64;
    let mut refused = 0;
    let mut trial = |bytes: &[u8], must: bool| {
        std::fs::write(&path, bytes).unwrap();
        match read_all(&path, LIMITS) {
            Ok(_) => assert!(!must),
            Err(error) => {
                refused += 1;
                assert!(error.remedy().is_some() && error.to_string().contains("a.nvdb"), "{error}");
            }
        }
    };
    for n in places(whole.len(), headers) {
        trial(&whole[..n], true);
    }
    for at in places(whole.len(), headers) {
        let mut damaged = whole.clone();
        damaged[at] = [0, 0x7f, 0x80, 0xff][at % 4];
        trial(&damaged, false);
    }
    // Offsets of children: of the root's tile, of the upper node's and of the lower node's only entry.
    let grid = 16 + 176 + 8;
    let mut children = vec![grid + 672 + 64 + 64 + 8, grid + 672 + 64 + 64 + 32 + 8];
    let nodes = whole[headers..].as_chunks::<8>().0.iter().enumerate();
    let is_offset = |bytes: &[u8; 8]| (64..400_000).contains(&u64::from_le_bytes(*bytes));
    children.extend(nodes.filter(|(_, b)| is_offset(b)).map(|(i, _)| headers + 8 * i).take(8));
    for at in children {
        for offset in [i64::MIN, -1, 1, 8, i64::MAX, 1 << 32, -(1 << 20)] {
            let mut damaged = whole.clone();
            damaged[at..at + 8].copy_from_slice(&offset.to_le_bytes());
            trial(&damaged, false);
        }
    }
    assert!(refused > 150, "{refused}");
}

/// A tree whose entries all lead to one node would make millions of leaves of a small file, and take as many steps where the
/// leaves are not counted.
#[test]
fn nodes_that_are_met_again_are_refused() {
    let mut small = scalars();
    if let Tree::Scalars { leaves, tiles, .. } = &mut small.tree {
        leaves.truncate(1);
        tiles.clear();
    }
    let mut parts = encode(&[small], LIMITS).unwrap();
    let memory = &mut parts[1];
    let word = |memory: &[u8], at: usize| u64::from_le_bytes(memory[at..at + 8].try_into().unwrap());
    // Lower and upper nodes: the number of entries, and where the mask of children and the table lie.
    for (level, entries, children, table) in [(1, 4096, 32 + 512, 1088), (2, 32_768, 32 + 4096, 8256)] {
        let node = 672 + word(memory, 672 + 8 * level) as usize;
        let is_child = |i: &usize| memory[node + children + i / 8] >> (i % 8) & 1 == 1;
        let first = (0..entries).find(is_child).unwrap();
        let child = word(memory, node + table + 8 * first).to_le_bytes();
        memory[node + children..node + children + entries / 8].fill(0xff);
        memory[node + table..node + table + 8 * entries].copy_from_slice(&child.repeat(entries));
    }
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), parts.concat()).unwrap();
    let error = read_all(file.path(), Limits { max_memory: 32 << 20 }).unwrap_err();
    assert!(error.to_string().contains("lead to one node") && error.remedy().is_some(), "{error}");
}
