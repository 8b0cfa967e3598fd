//! What goes into a VDB comes out of it, for every kind of grid, seen by us and by OpenVDB's tools.

#![allow(clippy::unwrap_used)]

mod common;

use common::fog;
use cumulo::formats::vdb::{Codec, File, Limits, write_grids};
use cumulo::scene::grid::Grid;
use std::collections::BTreeMap;

fn round_trip(grid: &Grid, codec: Codec, half: bool) -> Grid {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.vdb");
    write_grids(&path, &[grid], &BTreeMap::new(), codec, half).unwrap();
    File::open(&path, Limits::default()).unwrap().read_grid(&grid.name).unwrap()
}

fn assert_same(a: &Grid, b: &Grid) {
    assert_eq!((&a.name, a.class, a.background), (&b.name, b.class, b.background));
    assert_eq!(a.leaves, b.leaves);
    assert_eq!(a.tiles, b.tiles);
}

#[test]
fn float_grids_come_back_bit_for_bit_with_both_codecs() {
    let grid = fog("density", 4, 1);
    for codec in [Codec::Blosc, Codec::None] {
        let back = round_trip(&grid, codec, false);
        assert_same(&grid, &back);
        // Scale and translation are stored as such: no rounding.
        assert_eq!(back.transform.matrix(), grid.transform.matrix());
    }
}
