//! Damaged images of every format: each is read or refused with an error that names the file and says what to do; none
//! crashes or takes memory that its bytes cannot justify.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a panic is how a test fails")]

mod images;

use cumulo::error::Result;
use cumulo::formats::imaging::format::{self, Format};
use cumulo::formats::imaging::options::{Options, RawLayout};
use cumulo::formats::imaging::values::Mapping;
use cumulo::formats::imaging::volume::{GridType, Settings, build};
use cumulo::formats::limits::Limits;
use cumulo::formats::sample::{Endian, Sample};
use cumulo::math::Affine;
use rlimit::Resource;
use std::collections::BTreeMap;
use std::path::Path;

/// What reading may take in memory.
const LIMITS: Limits = Limits { max_memory: 64 << 20 };
/// Memory of the whole process: that, the test's own, and a page of a TIFF beside it.
const DATA: u64 = 512 << 20;

/// Reads a file to its end.
fn read(path: &Path, sample: &images::Sample) -> Result<()> {
    let map = Affine::new(sample.map)?;
    let raw = RawLayout { size: images::SIZE, sample: Sample::U16, endian: Endian::Big, skip: 7 };
    let raw = (sample.name == "raw").then_some(raw);
    let options = Options { transform: Some(map), raw, ..Options::default() };
    let found = if raw.is_some() { Some(Format::Raw) } else { format::sniff(path)? };
    // What is no longer told as an image is for others to refuse.
    let Some(format) = found else { return Err(cumulo::formats::unknown(path)) };
    for mut image in format::open(path, format, &options, LIMITS)? {
        let settings = Settings { name: "g", grid_type: GridType::Float, mapping: Mapping::default(), limits: LIMITS };
        build(&mut image, &settings, |_, _| {}).map_err(|e| e.at(path))?;
    }
    Ok(())
}

/// SplitMix64.
struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % n as u64) as usize
    }
}

/// Sizes that go wrong, as text.
const WORDS: [&str; 8] = ["0", "-1", "1e9", "2147483647", "18446744073709551615", "99999", "nan", "%s"];

/// A copy with a number of its text replaced, if it has one in its first 900 bytes.
fn reworded(bytes: &[u8], random: &mut Random) -> Vec<u8> {
    let head = &bytes[..bytes.len().min(900)];
    let starts: Vec<usize> =
        (1..head.len()).filter(|i| head[*i].is_ascii_digit() && !head[i - 1].is_ascii_digit()).collect();
    if starts.is_empty() {
        return bytes.to_vec();
    }
    let from = starts[random.below(starts.len())];
    let length = bytes[from..].iter().take_while(|b| b.is_ascii_digit()).count();
    [&bytes[..from], WORDS[random.below(WORDS.len())].as_bytes(), &bytes[from + length..]].concat()
}

/// Damage of a kind, of which there are four: cut, bytes turned over, numbers put in, words put in.
fn damaged(bytes: &[u8], kind: usize, random: &mut Random) -> Vec<u8> {
    const NUMBERS: [i64; 8] = [-1, 0, 1, 255, 65_536, i32::MAX as i64, i64::MAX, i64::MIN];
    let mut copy = bytes.to_vec();
    if bytes.is_empty() {
        return copy;
    }
    let reach = if random.below(3) > 0 { bytes.len().min(600) } else { bytes.len() };
    match kind {
        0 => copy.truncate(random.below(bytes.len())),
        1 => (0..1 + random.below(4)).for_each(|_| copy[random.below(reach)] ^= 1 << random.below(8)),
        2 => {
            let at = random.below(reach);
            let width = [2, 4, 8][random.below(3)].min(copy.len() - at);
            copy[at..at + width].copy_from_slice(&NUMBERS[random.below(NUMBERS.len())].to_le_bytes()[..width]);
        }
        _ => copy = reworded(bytes, random),
    }
    copy
}

#[test]
fn damaged_images_are_read_or_refused() {
    let (_, most) = Resource::DATA.get().unwrap();
    Resource::DATA.set(DATA.min(most), most).unwrap();
    // More rounds, as were run while this was written: CUMULO_FUZZ_ROUNDS=4000.
    let rounds: usize = std::env::var("CUMULO_FUZZ_ROUNDS").ok().and_then(|v| v.parse().ok()).unwrap_or(120);
    let dir = tempfile::tempdir().unwrap();
    let mut random = Random(20_261_125);
    let mut refused: BTreeMap<&str, usize> = BTreeMap::new();
    for sample in images::samples() {
        let path = sample.write(dir.path());
        read(&path, &sample).unwrap_or_else(|e| panic!("{}: {e}", sample.name));
        for round in 0..rounds {
            let (name, bytes) = &sample.files[round % sample.files.len()];
            let spoiled = damaged(bytes, round / 2 % 4, &mut random);
            std::fs::write(dir.path().join(name), &spoiled).unwrap();
            if let Err(error) = read(&path, &sample) {
                let text = error.to_string();
                let named =
                    sample.files.iter().any(|(n, _)| text.contains(n)) || text.contains(dir.path().to_str().unwrap());
                assert!(
                    named && error.remedy().is_some() && text.lines().count() == 2 && text.len() < 2000,
                    "{}, round {round}: {text}",
                    sample.name
                );
                *refused.entry(sample.name).or_default() += 1;
            }
            std::fs::write(dir.path().join(name), bytes).unwrap();
        }
    }
    // Damage that nothing notices would test nothing: a quarter is cut, and most cuts are seen.
    assert!(refused.values().all(|n| n * 6 > rounds) && refused.len() == images::samples().len(), "{refused:?}");
}

/// Every file that ends too early is refused, whatever the format: at every length of the header, and of the values.
#[test]
fn files_that_end_early_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    for sample in images::samples() {
        let path = sample.write(dir.path());
        let (name, bytes) = sample.files.last().unwrap();
        let mut count = 0;
        // What follows the values may be missing: blanks, tags and the directories of archives aside, a byte of a checksum.
        let needed = if name.ends_with("vti") || name.ends_with("vtk") {
            bytes.len().saturating_sub(140)
        } else {
            bytes.len() - 9
        };
        for length in (0..needed).step_by((needed / 120).max(1)) {
            std::fs::write(dir.path().join(name), &bytes[..length]).unwrap();
            let error = read(&path, &sample)
                .err()
                .unwrap_or_else(|| panic!("{}: {length} of {} bytes are read", sample.name, bytes.len()));
            assert!(error.remedy().is_some(), "{}: {error}", sample.name);
            count += 1;
        }
        assert!(count >= 40 || bytes.len() < 60, "{}: {count}", sample.name);
        std::fs::write(dir.path().join(name), bytes).unwrap();
    }
}
