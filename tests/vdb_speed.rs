//! How long a 256³ noise takes, read into our memory and written (goal B10).

#![allow(clippy::unwrap_used, reason = "a panic is how a test fails")]

mod common;

use common::fog;
use cumulo::formats::vdb::{Codec, File, Limits, write_grids};
use std::collections::BTreeMap;
use std::time::Instant;

#[test]
#[ignore = "prints times; run it alone with --nocapture"]
fn noise_of_32768_leaves() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.vdb");
    let grid = fog("density", 32, 1);
    for _ in 0..5 {
        let start = Instant::now();
        write_grids(&path, &[&grid], &BTreeMap::new(), Codec::Blosc, false).unwrap();
        let written = start.elapsed();
        let start = Instant::now();
        let file = File::open(&path, Limits::default()).unwrap();
        let opened = start.elapsed();
        let native = file.read("density").unwrap();
        let read = start.elapsed();
        let back = native.to_grid().unwrap();
        let total = start.elapsed();
        assert_eq!(back.leaves.len(), grid.leaves.len());
        eprintln!("write {written:?}; preflight and open {opened:?}, with OpenVDB {read:?}, with copy {total:?}");
    }
}
