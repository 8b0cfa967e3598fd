//! Damaged files are refused: no crash, no hang, no memory beyond the cap.

use crate::common::grids::fog;
use crate::common::work::python;
use cumulo::error::Kind;
use cumulo::formats::limits::Limits;
use cumulo::formats::vdb::{Codec, File, preflight, write_grids};
use std::collections::BTreeMap;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::process::Command;

const LIMITS: Limits = Limits { max_memory: 256 << 20 };

fn samples(dir: &Path) -> Vec<PathBuf> {
    let path = |name: &str| dir.join(name);
    let grids = (fog("density", 2, 1), fog("density", 1, 2));
    let all = [&grids.0, &grids.1];
    write_grids(&path("blosc.vdb"), &all, &BTreeMap::new(), Codec::Blosc, false).unwrap();
    write_grids(&path("none.vdb"), &all, &BTreeMap::new(), Codec::None, false).unwrap();
    write_grids(&path("half.vdb"), &all, &BTreeMap::new(), Codec::Blosc, true).unwrap();
    python(&format!(
        "import pyopenvdb as v\n\
         b, w = v.BoolGrid(), v.Vec3SGrid()\n\
         for g, x in ((b, True), (w, (1.0, 2.0, 3.0))): g.fill((0, 0, 0), (20, 9, 9), x)\n\
         v.write({:?}, [b, w])\n",
        path("types.vdb").to_str().unwrap()
    ));
    let points = ["-sphere", "dim=16", "-scatter", "count=40", "-points2vdb", "-write"];
    let made = Command::new("vdb_tool").args(points).arg(path("points.vdb")).output().unwrap();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    ["blosc.vdb", "none.vdb", "half.vdb", "types.vdb", "points.vdb"].map(path).to_vec()
}

#[test]
fn every_truncation_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let cut = dir.path().join("cut.vdb");
    for sample in samples(dir.path()) {
        let whole = std::fs::read(&sample).unwrap();
        preflight::check(&sample, &LIMITS).unwrap();
        let n = whole.len();
        let steps = (0..n).step_by(n / 80);
        for length in (0..200).chain(steps).chain(n - 64..n) {
            std::fs::write(&cut, &whole[..length]).unwrap();
            let error = preflight::check(&cut, &LIMITS).unwrap_err().to_string();
            assert!(error.contains("cut.vdb"), "{error}");
        }
        // A longer file is no sound one either.
        std::fs::write(&cut, [whole.as_slice(), b"x"].concat()).unwrap();
        assert!(File::open(&cut, LIMITS).is_err());
    }
}

/// Deterministic and small: a multiplicative generator is random enough to place damage.
struct Dice(u64);

impl Dice {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        ((self.0 >> 33) as usize) % n
    }
}

fn damage(bytes: &mut [u8], dice: &mut Dice) {
    for _ in 0..[1, 1, 2, 16][dice.below(4)] {
        // Much of the damage goes to the header with its lengths and offsets, and to the end, where
        // point attributes have theirs.
        let end = bytes.len() - 8;
        let at = match dice.below(4) {
            0 | 1 => dice.below(end.min(1500)),
            2 => end - dice.below(end.min(800)),
            _ => dice.below(end),
        };
        match dice.below(3) {
            0 => bytes[at] ^= 1 << dice.below(8),
            1 => bytes[at] = dice.below(256) as u8,
            _ => {
                let hostile = [0, 1, u32::MAX, i32::MAX as u32, 1 << 31, 1 << 20][dice.below(6)];
                bytes[at..at + 4].copy_from_slice(&hostile.to_le_bytes());
            }
        }
    }
}

#[test]
fn five_hundred_damaged_files_crash_nothing_and_stay_below_the_cap() {
    let dir = tempfile::tempdir().unwrap();
    let mut dice = Dice(20_240_607);
    let mut refused = 0;
    for sample in samples(dir.path()) {
        let whole = std::fs::read(&sample).unwrap();
        for batch in 0..5 {
            let files: Vec<PathBuf> = (0..20)
                .map(|i| {
                    let mut bytes = whole.clone();
                    damage(&mut bytes, &mut dice);
                    let path = dir.path().join(format!("damaged-{batch}-{i}.vdb"));
                    std::fs::write(&path, bytes).unwrap();
                    path
                })
                .collect();
            // 256 MiB may be the tree's; the copy for statistics, code and threads take the rest.
            let out = Command::new("/bin/bash")
                .args(["-c", "ulimit -d 1048576; exec timeout 30 \"$0\" validate --json --max-memory 256M \"$@\""])
                .arg(env!("CARGO_BIN_EXE_cumulo"))
                .args(&files)
                .output()
                .unwrap();
            let stderr = String::from_utf8_lossy(&out.stderr).into_owned();
            assert!(matches!(out.status.code(), Some(0 | 1)), "{}: {:?} {stderr}", sample.display(), out.status);
            let report: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
            let listed = report["files"].as_array().unwrap();
            assert_eq!(listed.len(), 20);
            refused += listed.iter().filter(|f| f["valid"] == false).count();
        }
    }
    // Damage to a name, to padding or to a stored value can leave a sound file; most must not.
    assert!(refused > 250, "only {refused} of 500 damaged files were found out");
}

/// Another program writes into the file between the check and the reading: OpenVDB decodes what was checked, or nothing.
#[test]
fn a_file_that_changes_after_its_check_misleads_nobody() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("changes.vdb");
    for codec in [Codec::Blosc, Codec::None] {
        write_grids(&path, &[&fog("density", 2, 1)], &BTreeMap::new(), codec, false).unwrap();
        let whole = std::fs::read(&path).unwrap();
        let open = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
        let (mut told, mut read) = (0, 0);
        // A length of less than 0 stands for values that are not packed: OpenVDB reads so many into the place of a leaf.
        let word = |at: usize| u32::from_le_bytes(whole[at..at + 4].try_into().unwrap());
        let is_length = |at: &usize| word(at + 4) == 0 && word(*at) >= 16 && word(at + 20) == word(*at);
        let lengths = (0..whole.len() - 24).filter(is_length).step_by(if codec == Codec::Blosc { 2 } else { 1 });
        for at in (0..whole.len() - 8).step_by(whole.len() / 150).chain(lengths.take(100)) {
            let file = File::open(&path, LIMITS).unwrap();
            open.write_all_at(&(-20_000_i64).to_le_bytes(), at as u64).unwrap();
            match file.read("density").and_then(|_| file.metadata()) {
                Ok(_) => read += 1,
                Err(error) => {
                    let text = error.to_string();
                    let changed = text.contains("changed while it was read") || error.kind() == Kind::Native;
                    assert!(changed && text.contains("changes.vdb"), "{codec:?}, byte {at}: {text}");
                    told += 1;
                }
            }
            open.write_all_at(&whole[at..at + 8], at as u64).unwrap();
        }
        // Without lengths, in a file that is not packed, nearly all that changes are values.
        let least = if codec == Codec::Blosc { 30 } else { 1 };
        assert!(told >= least && read > 5, "{codec:?}: {told} told, {read} read");
        let file = File::open(&path, LIMITS).unwrap();
        open.set_len(whole.len() as u64 / 2).unwrap();
        let error = file.read("density").unwrap_err().to_string();
        assert!(error.contains("became shorter") && error.contains("try again"), "{error}");
    }
}

#[test]
fn a_tree_above_the_cap_is_refused_before_it_is_read() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.vdb");
    write_grids(&path, &[&fog("density", 4, 3)], &BTreeMap::new(), Codec::Blosc, false).unwrap();
    let text = File::open(&path, Limits { max_memory: 100_000 }).unwrap_err().to_string();
    assert!(text.contains("`max_memory`") && text.contains("100000"), "{text}");
}

#[test]
fn newer_versions_and_other_formats_are_refused_with_what_to_do() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.vdb");
    write_grids(&path, &[&fog("density", 1, 4)], &BTreeMap::new(), Codec::Blosc, false).unwrap();
    let mut bytes = std::fs::read(&path).unwrap();
    bytes[8] = 225;
    std::fs::write(&path, &bytes).unwrap();
    let newer = File::open(&path, LIMITS).unwrap_err().to_string();
    assert!(newer.contains("225") && newer.contains("OpenVDB 12 or older"), "{newer}");
    std::fs::write(&path, b"NanoVDB0rest of the header").unwrap();
    let nano = File::open(&path, LIMITS).unwrap_err().to_string();
    assert!(nano.contains("a NanoVDB file") && nano.contains("cumulo convert"), "{nano}");
    std::fs::write(&path, b"{\"not\": \"a volume\"}").unwrap();
    assert!(File::open(&path, LIMITS).unwrap_err().to_string().contains("no OpenVDB file"));
}

/// The name in a grid's metadata is damaged: what is written has the name in the file's directory, and reads back.
#[test]
fn a_damaged_name_is_mended() {
    let dir = tempfile::tempdir().unwrap();
    let (path, out) = (dir.path().join("name.vdb"), dir.path().join("out.vdb"));
    write_grids(&path, &[&fog("density", 1, 1)], &BTreeMap::new(), Codec::Blosc, false).unwrap();
    let mut bytes = std::fs::read(&path).unwrap();
    let entry = b"name\x06\0\0\0string\x07\0\0\0density";
    let at = bytes.windows(entry.len()).position(|w| w == entry).unwrap() + entry.len() - 4;
    bytes[at..at + 2].copy_from_slice(&[0, 7]);
    std::fs::write(&path, bytes).unwrap();
    let grid = File::open(&path, LIMITS).unwrap().read("density").unwrap();
    cumulo::formats::vdb::write_native(&out, &[&grid], None, &BTreeMap::new(), Codec::Blosc).unwrap();
    let names: Vec<String> = File::open(&out, LIMITS).unwrap().entries().iter().map(|e| e.name.clone()).collect();
    assert_eq!(names, ["density"]);
}
