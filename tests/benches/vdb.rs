//! B10: reading and writing a VDB, ours against a C++ program over OpenVDB, process by process in turn.
//!
//! Both sides run in a fresh process each round and report medians of their own repeats, so that
//! neither finds a heap the other had to ask the kernel for.

use super::row::Row;
use super::turns::{ROUNDS, median, ratio};
use cumulo::formats::limits::Limits;
use cumulo::formats::vdb::{Codec, File, NativeGrid, write_native};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;
use std::time::Instant;

/// Reads and writes in one process.
const REPEATS: usize = 5;
/// The argument by which this program runs itself for our side.
pub const OWN_SIDE: &str = "--own-side-of-vdb";

/// Medians of one process in milliseconds; the C++ program prints the first three.
#[derive(Debug, Default, Serialize, Deserialize)]
struct Times {
    read_and_copy_ms: f64,
    write_ms: f64,
    leaves: usize,
    /// Where our time goes.
    #[serde(flatten)]
    parts: Option<Parts>,
}

/// Check in Rust, reading by OpenVDB, copy to our memory; copy to OpenVDB's, writing and syncing.
#[derive(Debug, Default, Serialize, Deserialize)]
struct Parts {
    check_ms: f64,
    read_ms: f64,
    copy_ms: f64,
    build_ms: f64,
    store_ms: f64,
}

/// Our side: opens with all checks, reads the grid into memory, writes it whole or not at all.
pub fn own_side(input: &Path, output: &Path) {
    let mut laps = [const { Vec::new() }; 5];
    let mut leaves = 0;
    for _ in 0..REPEATS {
        let mut last = Instant::now();
        let mut lap = |part: usize| {
            laps[part].push(1e3 * last.elapsed().as_secs_f64());
            last = Instant::now();
        };
        let file = File::open(input, Limits::default()).unwrap();
        lap(0);
        let native = file.read("density").unwrap();
        lap(1);
        let grid = native.to_grid().unwrap();
        drop((file, native));
        lap(2);
        // As `write_grids` does it.
        let native = NativeGrid::from_grid(&grid).unwrap();
        lap(3);
        write_native(output, &[&native], None, &BTreeMap::new(), Codec::Blosc).unwrap();
        drop(native);
        lap(4);
        leaves = grid.leaves.len();
    }
    let sum = |parts: std::ops::Range<usize>| {
        let total = |i: usize| parts.clone().map(|p| laps[p][i]).sum();
        median(&(0..REPEATS).map(total).collect::<Vec<f64>>())
    };
    let [check_ms, read_ms, copy_ms, build_ms, store_ms] = std::array::from_fn(|p| median(&laps[p]));
    let parts = Some(Parts { check_ms, read_ms, copy_ms, build_ms, store_ms });
    let times = Times { read_and_copy_ms: sum(0..3), write_ms: sum(3..5), leaves, parts };
    println!("{}", serde_json::to_string(&times).unwrap());
}

fn run(command: &mut Command) -> Times {
    let out = command.output().unwrap();
    assert!(out.status.success(), "{command:?}: {}", String::from_utf8_lossy(&out.stderr));
    serde_json::from_slice(&out.stdout).unwrap()
}

/// `input` is the volume, `peer` the C++ program; outputs go to `folder`.
pub fn rows(input: &Path, peer: &Path, folder: &Path) -> Vec<Row> {
    let own = std::env::current_exe().unwrap();
    let (mut ours, mut theirs) = (Vec::new(), Vec::new());
    for _ in 0..ROUNDS {
        theirs.push(run(Command::new(peer).arg(input).arg(folder.join("b10_peer.vdb")).arg(REPEATS.to_string())));
        ours.push(run(Command::new(&own).arg(OWN_SIDE).arg(input).arg(folder.join("b10_ours.vdb"))));
        assert_eq!(ours.last().map(|t| t.leaves), theirs.last().map(|t| t.leaves), "both read the same volume");
    }
    let row = |what: &str, pick: fn(&Times) -> f64| {
        let [a, b] = [&ours, &theirs].map(|side| side.iter().map(pick).collect::<Vec<_>>());
        let work = format!("{what} 256³ noise, {} leaves", ours[0].leaves);
        Row::at_most("B10", work, format!("{:.0} ms", median(&a)), ratio(&a, &b), 1.0)
            .against(format!("OpenVDB in C++, 1 thread: {:.0} ms", median(&b)))
            .with("ours", 1e-3 * median(&a))
            .with("peer", 1e-3 * median(&b))
    };
    vec![row("read", |t| t.read_and_copy_ms), row("write", |t| t.write_ms)]
}
