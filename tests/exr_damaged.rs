//! Damaged OpenEXR files: every one is read or refused; none panics, hangs or takes memory that its
//! bytes cannot justify.

#![allow(clippy::unwrap_used)]

use cumulo::formats::exr;
use std::path::{Path, PathBuf};

fn fixtures() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/exr");
    let files = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path());
    let mut files: Vec<PathBuf> = files.filter(|p| p.extension().is_some_and(|e| e == "exr")).collect();
    files.sort();
    files
}

/// SplitMix64.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }
    fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }
}

#[test]
fn flipped_files_are_read_or_refused() {
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
                bytes[at] = match random.below(4) {
                    0 => 0xff,
                    1 => 0,
                    2 => bytes[at] ^ (1 << random.below(8)),
                    _ => random.next() as u8,
                };
            }
            std::fs::write(&path, &bytes).unwrap();
            let _ = exr::picture(&path, None);
            refused += usize::from(exr::read(&path).is_err());
            total += 1;
        }
    }
    assert!(refused > total / 10, "only {refused} of {total} damaged files were refused");
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
        }
        std::fs::write(&path, &whole[..needed - 1]).unwrap();
        assert!(exr::read(&path).is_err(), "{}", file.display());
    }
}
