//! Damaged OpenEXR files: every one is read or refused; none panics, hangs or takes memory that its
//! bytes cannot justify.

use crate::alone::alone;
use crate::common::random::Random;
use cumulo::formats::exr;
use std::path::{Path, PathBuf};

fn fixtures() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/exr");
    let files = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path());
    let mut files: Vec<PathBuf> = files.filter(|p| p.extension().is_some_and(|e| e == "exr")).collect();
    files.sort();
    files
}

/// Sizes and offsets that tend to go wrong.
const NUMBERS: [i32; 10] = [-1, 0, 1, 2, 31, 64, 255, 65_536, i32::MAX, i32::MIN];

#[test]
fn flipped_files_are_read_or_refused() {
    // The peak of memory below is the whole process's.
    if !alone("exr_damaged::flipped_files_are_read_or_refused") {
        return;
    }
    // More rounds, as were run while this was written: CUMULO_FUZZ_ROUNDS=6000.
    let rounds: usize = std::env::var("CUMULO_FUZZ_ROUNDS").ok().and_then(|v| v.parse().ok()).unwrap_or(30);
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("damaged.exr");
    let mut random = Random(20_261);
    let (mut refused, mut total) = (0, 0);
    for file in fixtures() {
        let whole = std::fs::read(&file).unwrap();
        for round in 0..rounds {
            let mut bytes = whole.clone();
            // Odd rounds damage the header and the chunk table, even ones the whole file.
            let reach = if round % 2 == 1 { bytes.len().min(600) } else { bytes.len() };
            for _ in 0..1 + random.below(4) {
                let at = random.below(reach);
                let number = NUMBERS[random.below(NUMBERS.len())].to_le_bytes();
                let end = (at + 4).min(bytes.len());
                match random.below(5) {
                    0 => bytes[at] = 0xff,
                    1 => bytes[at] = 0,
                    2 => bytes[at] ^= 1 << random.below(8),
                    3 => bytes[at..end].copy_from_slice(&number[..end - at]),
                    _ => bytes[at] = random.next() as u8,
                }
            }
            std::fs::write(&path, &bytes).unwrap();
            let _ = exr::picture(&path, None);
            let sound = exr::read(&path).is_ok();
            // Damage is never taken for a fault of the operating system, and what is refused is a problem.
            let problems = exr::problems(&path).unwrap();
            assert!(sound || !problems.is_empty(), "{}, round {round}", file.display());
            refused += usize::from(!sound);
            total += 1;
        }
    }
    assert!(total >= 200);
    assert!(refused > total / 10, "only {refused} of {total} damaged files were refused");
    // The fixtures hold less than 40000 pixels; 512 MiB are the program, its threads and slack.
    #[cfg(target_os = "linux")]
    assert!(peak_memory_kib() < 512 << 10, "{} KiB at peak", peak_memory_kib());
}

#[cfg(target_os = "linux")]
fn peak_memory_kib() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:")).unwrap();
    line.trim().trim_end_matches(" kB").parse().unwrap()
}

/// Windows of a billion pixels in a file of a few kilobytes, and counters of petabytes.
#[test]
fn sizes_that_the_file_cannot_hold_are_refused_before_memory_is_asked_for() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("damaged.exr");
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/exr");
    let refused = |name: &str, change: &dyn Fn(&mut Vec<u8>), word: &str| {
        let mut bytes = std::fs::read(folder.join(name)).unwrap();
        change(&mut bytes);
        std::fs::write(&path, &bytes).unwrap();
        let message = exr::read_picture(&path, None).unwrap_err().to_string();
        assert!(message.contains(word) && message.contains("damaged.exr"), "{name}: {message}");
    };
    let find = |bytes: &[u8], what: &[u8]| bytes.windows(what.len()).position(|w| w == what).unwrap() + what.len();
    for (window, x, y) in [("dataWindow", 1_000_000_i32, 39_i32), ("displayWindow", 1 << 28, 1 << 28)] {
        let change = |bytes: &mut Vec<u8>| {
            // Name, type, size, x and y of the first pixel, then those of the last.
            let at = find(bytes, format!("{window}\0box2i\0\x10\0\0\0").as_bytes()) + 8;
            bytes[at..at + 4].copy_from_slice(&x.to_le_bytes());
            bytes[at + 4..at + 8].copy_from_slice(&y.to_le_bytes());
        };
        refused("zip.exr", &change, if window == "dataWindow" { "hold" } else { "pixels" });
    }
    // The first chunk of the DWA file follows the table of two: row, size, then the counters.
    let change = |bytes: &mut Vec<u8>| {
        let table = bytes.windows(8).position(|w| w == b"scanline").unwrap() + "scanlineimage".len() + 1;
        let chunk = u64::from_le_bytes(bytes[table..table + 8].try_into().unwrap()) as usize;
        bytes[chunk + 8 + 8 * 8 + 6] = 0x55;
    };
    refused("dwaa.exr", &change, "DWA");
}

#[test]
fn truncated_files_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("damaged.exr");
    let mut random = Random(7);
    for file in fixtures() {
        let whole = std::fs::read(&file).unwrap();
        // The mip levels at the end of this one are never read.
        let needed = if file.ends_with("mipmap.exr") { whole.len() / 4 } else { whole.len() };
        for _ in 0..8 {
            std::fs::write(&path, &whole[..random.below(needed)]).unwrap();
            assert!(exr::read(&path).is_err(), "{}", file.display());
            assert_eq!(exr::problems(&path).unwrap().len(), 1, "{}", file.display());
        }
        std::fs::write(&path, &whole[..needed - 1]).unwrap();
        assert!(exr::read(&path).is_err(), "{}", file.display());
    }
}
