//! Damaged images of every format: each is read or refused with an error that names the file and says what to do; none
//! crashes or takes memory that its bytes cannot justify.

use crate::alone::alone;
use crate::common::images;
use crate::common::random::Random;
use cumulo::error::Result;
use cumulo::formats::format::FileKind;
use cumulo::formats::imaging::options::{Options, RawLayout};
use cumulo::formats::imaging::values::Mapping;
use cumulo::formats::imaging::volume::{GridType, Settings, build};
use cumulo::formats::limits::Limits;
use cumulo::formats::registry;
use cumulo::formats::sample::{Endian, Sample};
use cumulo::math::Affine;
use rlimit::Resource;
use std::collections::BTreeMap;
use std::io::Read;
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
    let format = if raw.is_some() { &registry::RAW } else { registry::sniff(path)? };
    // What is no longer told as an image is for others to refuse.
    let FileKind::Image(reader) = format.kind else { return Err(registry::unread(format, path)) };
    for mut image in reader.open(path, &options, LIMITS)? {
        let settings = Settings { name: "g", grid_type: GridType::Float, mapping: Mapping::default(), limits: LIMITS };
        build(&mut image, &settings, |_, _| {}).map_err(|e| e.at(path))?;
    }
    Ok(())
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
    // The limit is the whole process's.
    if !alone("imaging_damaged::damaged_images_are_read_or_refused") {
        return;
    }
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

/// Opens a file of these bytes; the error, or the notes of its images.
fn opened(name: &str, bytes: &[u8]) -> Result<String> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    let format = images::found(&path).unwrap_or_else(|| panic!("{name} is no image"));
    let images = images::format_of(format).open(&path, &Options::default(), LIMITS)?;
    Ok(images.iter().flat_map(|image| image.header.notes.clone()).collect::<Vec<_>>().join("; "))
}

/// Asserts that a file is refused with a remedy, in words that name it.
fn refused(name: &str, bytes: &[u8], words: &str) {
    let text = match opened(name, bytes) {
        Ok(notes) => panic!("{name} is read ({notes}); '{words}' is expected"),
        Err(error) => {
            assert!(error.remedy().is_some(), "{error}");
            error.to_string()
        }
    };
    assert!(text.contains(name) && text.contains(words), "{text} lacks '{words}'");
}

#[test]
fn numbers_without_a_meaning_are_refused() {
    let samples = images::samples();
    let sample = samples.iter().find(|s| s.name == "NIfTI-1, big endian, qform").unwrap();
    let (name, whole) = &sample.files[0];
    let with = |changes: &[(usize, f32)]| {
        let mut bytes = whole.clone();
        changes.iter().for_each(|(at, v)| bytes[*at..at + 4].copy_from_slice(&v.to_be_bytes()));
        bytes
    };
    for value in [f32::NAN, f32::INFINITY, 0.0, -1.0] {
        for axis in 1..4 {
            refused(name, &with(&[(76 + 4 * axis, value)]), &format!("(pixdim[{axis}]) is {value}"));
        }
    }
    refused(name, &with(&[(76, f32::NAN)]), "pixdim[0]");
    refused(name, &with(&[(112, f32::NAN)]), "(scl_slope) of the values is NaN");
    refused(name, &with(&[(112, f32::INFINITY), (116, 0.0)]), "scl_slope");
    refused(name, &with(&[(112, 2.0), (116, f32::NAN)]), "scl_inter");
    // The standard: a slope of 0 says that there is no scale.
    assert_eq!(opened(name, &with(&[(112, 0.0)])).unwrap(), "");
    assert!(opened(name, &with(&[(112, 0.0), (116, 5.0)])).unwrap().contains("intercept of 5 is not applied"));

    let meta = |more: &str, data: &str| {
        let head = "ObjectType = Image\nNDims = 3\nDimSize = 1 1 1\n";
        [format!("{head}{more}ElementType = MET_UCHAR\nElementDataFile = {data}\n").as_bytes(), b"\x01"].concat()
    };
    for edge in ["0", "-1", "nan", "inf"] {
        refused("a.mha", &meta(&format!("ElementSpacing = 1 {edge} 1\n"), "LOCAL"), "ElementSpacing");
    }
    assert!(opened("a.mha", &meta("", "LOCAL")).unwrap().contains("1 is taken"));
    let nrrd = |more: &str| {
        let head = "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 1 1 1\nencoding: raw\n";
        [format!("{head}{more}\n\n").as_bytes(), b"\x01"].concat()
    };
    refused("a.nrrd", &nrrd("spacings: 1 inf 1"), "spacings");
    refused("a.nrrd", &nrrd("spacings: 1 0 1"), "placement");
    assert!(opened("a.nrrd", &nrrd("spacings: 1 nan 1")).unwrap().contains("second; 1 is taken"));
    assert_eq!(opened("a.nrrd", &nrrd("spacings: 1 2 1")).unwrap(), "");
    let vtk = |spacing: &str| {
        format!(
            "# vtk DataFile Version 3.0\nt\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 1 1 1\nSPACING {spacing}\nORIGIN 0 0 0\n\
             POINT_DATA 1\nSCALARS a float\nLOOKUP_TABLE default\n1\n"
        )
    };
    for spacing in ["1 0 1", "1 -2 1"] {
        refused("a.vtk", vtk(spacing).as_bytes(), "SPACING");
    }
    refused("a.vtk", vtk("1 nan 1").as_bytes(), "SPACING");

    // Files elsewhere are none of the header's.
    for data in ["../a.raw", "/etc/hostname", "b/../../a.raw"] {
        refused("a.mhd", &meta("", data), "does not lie in the header's folder");
        refused("a.nhdr", &nrrd(&format!("data file: {data}")), "does not lie in the header's folder");
    }
    refused("a.mhd", &meta("", "../s%d.raw 1 1 1"), "does not lie in the header's folder");
}

/// Headers of Mitsuba's grids that announce what is not there, or what is not read.
#[test]
fn headers_of_mitsuba_are_held_against_the_file() {
    let whole = images::mitsuba(1, &images::values());
    assert_eq!(opened("a.vol", &whole).unwrap(), "");
    let with = |changes: &[(usize, i32)]| {
        let mut bytes = whole.clone();
        changes.iter().for_each(|(at, v)| bytes[*at..at + 4].copy_from_slice(&v.to_le_bytes()));
        bytes
    };
    // 2^31 - 1 voxels along one axis, along all, and so many slices that a slice fits.
    for sizes in [&[(8, i32::MAX)][..], &[(8, i32::MAX), (12, i32::MAX), (16, i32::MAX)], &[(16, 1 << 30)]] {
        refused("a.vol", &with(sizes), "the file has 288 bytes; by its header its values end at byte");
    }
    for (at, value, words) in [
        (8, 0, "0 x 4 x 3"),
        (12, i32::MIN, "-2147483648"),
        (20, 6, "6 channels"),
        (20, -1, "-1 channels"),
        (4, 0, "encoding 0"),
        (4, 4, "quantized directions"),
        (0, i32::from_le_bytes(*b"VOL\x04"), "version 4"),
    ] {
        refused("a.vol", &with(&[(at, value)]), words);
    }
    // Corners: not a number, infinite, no extent, the wrong way round.
    for value in [f32::NAN, f32::INFINITY, 10.25, 9.0] {
        refused("a.vol", &with(&[(36, value.to_bits() as i32)]), "the box of the grid");
    }
    refused("a.vol", &whole[..47], "47 bytes");
    refused("a.vol", &whole[..whole.len() - 1], "287 bytes");
    let empty: Vec<(usize, i32)> = (24..48).step_by(4).map(|at| (at, 0)).collect();
    assert!(opened("a.vol", &with(&empty)).unwrap().contains("the unit cube is taken"));
    // A whole file of a slice that is too large for the limits.
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("large.vol");
    std::fs::write(&path, with(&[(8, 1 << 14), (12, 1 << 14), (16, 1)])).unwrap();
    std::fs::OpenOptions::new().write(true).open(&path).unwrap().set_len(48 + (4 << 28)).unwrap();
    let error = images::format_of(".vol").open(&path, &Options::default(), LIMITS).unwrap_err();
    assert!(error.to_string().contains("slice of 16384 x 16384") && error.remedy().is_some(), "{error}");
}

/// Damage of the checksum or the length at the end of a stream, which the values alone do not show.
#[test]
fn values_that_disagree_with_their_checksum_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let samples = images::samples();
    let of = |name: &str| samples.iter().find(|s| s.name == name).unwrap();
    let refused = |sample: &images::Sample, file: &str, bytes: &[u8]| {
        let path = sample.write(dir.path());
        std::fs::write(dir.path().join(file), bytes).unwrap();
        let error = read(&path, sample).err().unwrap_or_else(|| panic!("{}: damage is read", sample.name));
        let text = error.to_string();
        assert!(text.contains("checksum") && text.contains("damaged") && error.remedy().is_some(), "{text}");
        assert!(text.contains(sample.files[0].0), "{text}");
    };
    // Places from the end of the file: of gzip's length and checksum, and of zlib's checksum.
    let cases: [(&str, &[usize]); 3] =
        [("NIfTI-1, packed", &[1, 4, 5, 8]), ("NRRD, detached", &[1, 8]), ("MetaImage, apart", &[1, 4])];
    for (name, places) in cases {
        let sample = of(name);
        let (file, whole) = sample.files.last().unwrap();
        for place in places {
            let mut bytes = whole.clone();
            bytes[whole.len() - place] ^= 0x10;
            refused(sample, file, &bytes);
        }
        refused(sample, file, &whole[..whole.len() - 2]);
        // Zeros behind the stream are no damage.
        std::fs::write(dir.path().join(file), [&whole[..], &[0; 64]].concat()).unwrap();
        read(&dir.path().join(sample.files[0].0), sample).unwrap();
    }

    // Several members of gzip are one stream, and each has its checksum.
    let sample = of("NIfTI-1, packed");
    let (file, whole) = &sample.files[0];
    let mut plain = Vec::new();
    flate2::read::GzDecoder::new(&whole[..]).read_to_end(&mut plain).unwrap();
    let [first, second] = [&plain[..400], &plain[400..]].map(images::gzip);
    let both = [&first[..], &second].concat();
    std::fs::write(dir.path().join(file), &both).unwrap();
    read(&dir.path().join(file), sample).unwrap();
    for at in [first.len() - 8, both.len() - 8] {
        let mut bytes = both.clone();
        bytes[at] ^= 1;
        refused(sample, file, &bytes);
    }

    // The checksum of an archive's first array stands in its directory.
    let sample = of("NumPy's archive");
    let (file, whole) = &sample.files[0];
    let entry = whole.windows(4).position(|w| w == b"PK\x01\x02").unwrap();
    let mut bytes = whole.clone();
    bytes[entry + 16] ^= 1;
    refused(sample, file, &bytes);
}

/// Strips that a TIFF leaves out, or that are shorter than their pixels, are no zeros.
#[test]
fn strips_that_are_not_there_are_refused() {
    let samples = images::samples();
    let sample = samples.iter().find(|s| s.files[0].0.ends_with(".tif")).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("strips.tif");
    let description = "ImageJ=1.53t\nimages=2\nslices=2\nunit=mm\nspacing=1\n";
    let whole = images::tiff(&[vec![7; 20], vec![9; 20]], 5, 4, description, [3, 3]);
    std::fs::write(&path, &whole).unwrap();
    read(&path, sample).unwrap();
    // An entry of a directory: its tag, its type (16 or 32 bits), a count of 1, and the value.
    let is_entry = |at: usize, tag: u16| {
        whole[at..at + 2] == tag.to_le_bytes() && matches!(whole[at + 2..at + 8], [3 | 4, 0, 1, 0, 0, 0])
    };
    let cases =
        [(273, 0_u32, "not in the file"), (279, 0, "not in the file"), (279, 7, "7 bytes of values, 40 are needed")];
    for (tag, value, words) in cases {
        let at = (0..whole.len() - 11).rev().find(|at| is_entry(*at, tag)).unwrap();
        let mut bytes = whole.clone();
        bytes[at + 8..at + 12].copy_from_slice(&value.to_le_bytes());
        std::fs::write(&path, bytes).unwrap();
        let error = read(&path, sample).unwrap_err();
        assert!(error.to_string().contains(words) && error.remedy().is_some(), "{error}");
    }
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
