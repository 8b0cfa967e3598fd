//! DICOM series land where their headers say, in every coding of the elements, and damaged ones are refused.

use crate::common::images::{self, format_of};
use crate::common::refusal;
use cumulo::error::{Code, Result};
use cumulo::formats::imaging::image::{Header, Values};
use cumulo::formats::imaging::options::Options;
use cumulo::formats::imaging::values::Mapping;
use cumulo::formats::imaging::volume::{GridType, Settings, build};
use cumulo::formats::limits::Limits;
use cumulo::math::Affine;
use glam::DVec3;
use std::path::Path;

const LIMITS: Limits = Limits { max_memory: 64 << 20 };
const IMPLICIT: &str = "1.2.840.10008.1.2";
const EXPLICIT: &str = "1.2.840.10008.1.2.1";
const DEFLATED: &str = "1.2.840.10008.1.2.1.99";
const BIG: &str = "1.2.840.10008.1.2.2";
const RLE: &str = "1.2.840.10008.1.2.5";
const JPEG_2000: &str = "1.2.840.10008.1.2.4.90";

/// Lossless codestream of 4 x 3 signed 16-bit values, -700 and on in steps of 7, by OpenJPEG.
const CODESTREAM: [u8; 101] = [
    0xff, 0x4f, 0xff, 0x51, 0x00, 0x29, 0x00, 0x00, 0x00, 0x00, 0x00, 0x04, 0x00, 0x00, 0x00, 0x03, 0x00, 0x00, 0x00,
    0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x04, 0x00, 0x00, 0x00, 0x03, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00,
    0x00, 0x00, 0x00, 0x01, 0x8f, 0x01, 0x01, 0xff, 0x52, 0x00, 0x0c, 0x00, 0x00, 0x00, 0x01, 0x00, 0x00, 0x04, 0x04,
    0x00, 0x01, 0xff, 0x5c, 0x00, 0x04, 0x40, 0x80, 0xff, 0x90, 0x00, 0x0a, 0x00, 0x00, 0x00, 0x00, 0x00, 0x22, 0x00,
    0x01, 0xff, 0x93, 0xc0, 0x7e, 0xc2, 0x00, 0x08, 0xec, 0x93, 0xed, 0xe1, 0x9a, 0x85, 0x58, 0xc4, 0x3e, 0xd1, 0x20,
    0x68, 0x26, 0x2e, 0x7f, 0xff, 0xd9,
];

/// Writes elements in a transfer syntax.
struct Writer {
    bytes: Vec<u8>,
    explicit: bool,
    big: bool,
}

impl Writer {
    fn new(syntax: &str) -> Self {
        Self { bytes: Vec::new(), explicit: syntax != IMPLICIT, big: syntax == BIG }
    }
    fn u16(&self, v: u16) -> [u8; 2] {
        if self.big { v.to_be_bytes() } else { v.to_le_bytes() }
    }
    fn u32(&self, v: u32) -> [u8; 4] {
        if self.big { v.to_be_bytes() } else { v.to_le_bytes() }
    }
    fn head(&mut self, tag: u32, vr: &[u8; 2], length: u32) {
        let mut head = [self.u16((tag >> 16) as u16), self.u16(tag as u16)].concat();
        if !self.explicit || tag >> 16 == 0xfffe {
            head.extend(self.u32(length));
        } else if matches!(vr, b"OB" | b"OW" | b"SQ" | b"UN") {
            head.extend([vr[0], vr[1], 0, 0]);
            head.extend(self.u32(length));
        } else {
            head.extend(vr);
            head.extend(self.u16(length as u16));
        }
        self.bytes.extend(head);
    }
    fn raw(&mut self, tag: u32, vr: &[u8; 2], value: &[u8]) {
        self.head(tag, vr, value.len() as u32);
        self.bytes.extend(value);
    }
    fn text(&mut self, tag: u32, vr: &[u8; 2], text: &str) {
        let pad = if text.len() % 2 == 1 { " " } else { "" };
        self.raw(tag, vr, format!("{text}{pad}").as_bytes());
    }
    fn short(&mut self, tag: u32, v: u16) {
        self.raw(tag, b"US", &self.u16(v));
    }
    /// A sequence with an item of what `fill` writes; of undefined length if `open`.
    fn sequence(&mut self, tag: u32, open: bool, fill: impl Fn(&mut Self)) {
        let mut inner = Self { bytes: Vec::new(), explicit: self.explicit, big: self.big };
        fill(&mut inner);
        let length = inner.bytes.len() as u32;
        self.head(tag, b"SQ", if open { u32::MAX } else { length + 8 });
        self.head(0xfffe_e000, b"  ", if open { u32::MAX } else { length });
        self.bytes.extend(inner.bytes);
        if open {
            self.head(0xfffe_e00d, b"  ", 0);
            self.head(0xfffe_e0dd, b"  ", 0);
        }
    }
}

/// A slice of a series, of 4 columns and 3 rows.
#[derive(Clone)]
struct Slice {
    syntax: &'static str,
    series: &'static str,
    number: i32,
    position: DVec3,
    axes: [DVec3; 2],
    rescale: Option<(f64, f64)>,
    values: Vec<i16>,
}

fn numbers(all: &[f64]) -> String {
    // Sixteen characters are what a decimal string has room for.
    all.iter().map(|v| format!("{v:.10}").chars().take(16).collect::<String>()).collect::<Vec<_>>().join("\\")
}

/// Runs of one byte each: packed without any gain.
fn rle(values: &[i16]) -> Vec<u8> {
    let mut streams = Vec::new();
    for byte in [1, 0] {
        let plane: Vec<u8> = values.iter().map(|v| v.to_le_bytes()[byte]).collect();
        let mut stream = vec![plane.len() as u8 - 2];
        stream.extend(&plane[..plane.len() - 1]);
        // The last value as a run of two, of which one is left over.
        stream.extend([0xff, plane[plane.len() - 1]]);
        streams.push(stream);
    }
    let mut words = vec![2_u32, 64, 64 + streams[0].len() as u32];
    words.resize(16, 0);
    words.iter().flat_map(|w| w.to_le_bytes()).chain(streams.concat()).collect()
}

impl Slice {
    fn data_set(&self) -> Vec<u8> {
        let mut w = Writer::new(self.syntax);
        w.text(0x0008_0060, b"CS", "CT");
        w.text(0x0008_103e, b"LO", "thorax");
        w.text(0x0010_0010, b"PN", "A^B");
        w.text(0x0018_0050, b"DS", "1.5");
        w.text(0x0020_000e, b"UI", self.series);
        w.text(0x0020_0013, b"IS", &self.number.to_string());
        w.text(0x0020_0032, b"DS", &numbers(&self.position.to_array()));
        w.text(0x0020_0037, b"DS", &numbers(&self.axes.map(|a| a.to_array()).concat()));
        w.short(0x0028_0002, 1);
        w.text(0x0028_0004, b"CS", "MONOCHROME2");
        w.short(0x0028_0010, 3);
        w.short(0x0028_0011, 4);
        w.text(0x0028_0030, b"DS", "0.75\\0.5");
        for (tag, v) in [(0x0028_0100, 16), (0x0028_0101, 16), (0x0028_0102, 15), (0x0028_0103, 1)] {
            w.short(tag, v);
        }
        if let Some((slope, intercept)) = self.rescale {
            w.text(0x0028_1052, b"DS", &intercept.to_string());
            w.text(0x0028_1053, b"DS", &slope.to_string());
        }
        // Sequences that are passed over, with pixels of an icon inside.
        for open in [false, true] {
            w.sequence(0x0088_0200, open, |w| {
                w.short(0x0028_0010, 99);
                w.sequence(0x0040_a730, open, |w| w.text(0x0040_a160, b"LO", "inner"));
                w.raw(0x7fe0_0010, b"OW", &[1, 2]);
            });
        }
        if [RLE, JPEG_2000].contains(&self.syntax) {
            let packed = if self.syntax == RLE { rle(&self.values) } else { [&CODESTREAM[..], &[0]].concat() };
            w.head(0x7fe0_0010, b"OB", u32::MAX);
            w.raw(0xfffe_e000, b"  ", &[]);
            w.raw(0xfffe_e000, b"  ", &packed);
            w.head(0xfffe_e0dd, b"  ", 0);
        } else {
            let bytes: Vec<u8> = self.values.iter().flat_map(|v| w.u16(v.cast_unsigned())).collect();
            w.raw(0x7fe0_0010, b"OW", &bytes);
        }
        w.bytes
    }

    fn file(&self) -> Vec<u8> {
        let mut meta = Writer::new(EXPLICIT);
        meta.text(0x0002_0010, b"UI", self.syntax);
        let mut data = self.data_set();
        if self.syntax == DEFLATED {
            let mut packed = vec![0; data.len() + 100];
            let level = libdeflater::CompressionLvl::default();
            let n = libdeflater::Compressor::new(level).deflate_compress(&data, &mut packed).unwrap();
            data = packed[..n].to_vec();
        }
        [&[0; 128][..], b"DICM", &meta.bytes, &data].concat()
    }
}

/// Directions of columns and rows that no axis is parallel to.
fn oblique() -> [DVec3; 2] {
    let row = DVec3::new(2.0, 3.0, 6.0) / 7.0;
    [row, DVec3::new(-6.0, -2.0, 3.0) / 7.0]
}

/// Five slices 2.5 mm apart; values are unlike in every voxel.
fn series(syntax: &'static str) -> Vec<Slice> {
    let axes = oblique();
    let normal = axes[0].cross(axes[1]);
    let slice = |k: i32| Slice {
        syntax,
        series: "1.2.3",
        number: k,
        position: DVec3::new(-100.0, 20.0, 5.5) + normal * (2.5 * f64::from(k)),
        axes,
        rescale: Some((2.0, -1024.0)),
        values: (0..12).map(|i| (k * 1000 - 700 + i * 7) as i16).collect(),
    };
    (0..5).map(slice).collect()
}

/// Writes slices under names that say nothing of their order.
fn write(folder: &Path, slices: &[Slice]) {
    for (n, slice) in slices.iter().enumerate() {
        std::fs::write(folder.join(format!("{:02}.dcm", (n * 3 + 1) % slices.len())), slice.file()).unwrap();
    }
    std::fs::write(folder.join("notes.txt"), "no image").unwrap();
}

fn read(path: &Path, options: &Options) -> Result<(Header, Vec<f64>)> {
    let mut image = format_of("DICOM").open(path, options, LIMITS)?.remove(0);
    let mut values = Vec::new();
    let mut slice = vec![0.0; image.header.slice_len().unwrap()];
    for _ in 0..image.header.size[2] {
        image.slices.next_slice(&mut slice)?;
        values.extend_from_slice(&slice);
    }
    Ok((image.header, values))
}

fn read_slices(slices: &[Slice]) -> Result<(Header, Vec<f64>)> {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), slices);
    assert_eq!(images::found(folder.path()), Some("DICOM"));
    read(folder.path(), &Options::default())
}

#[test]
fn corners_land_where_the_headers_say_in_every_coding() {
    for syntax in [IMPLICIT, EXPLICIT, DEFLATED, BIG, RLE] {
        let slices = series(syntax);
        let (header, values) = read_slices(&slices).unwrap();
        assert_eq!((header.size, header.values), ([4, 3, 5], Values::Real), "{syntax}");
        let stored: Vec<f64> = slices.iter().flat_map(|s| &s.values).map(|v| f64::from(*v) * 2.0 - 1024.0).collect();
        assert_eq!(values, stored, "{syntax}");
        let [row, column] = oblique();
        for corner in [[0, 0, 0], [3, 0, 0], [0, 2, 0], [3, 2, 0], [0, 0, 4], [3, 0, 4], [0, 2, 4], [3, 2, 4]] {
            let [i, j, k] = corner.map(f64::from);
            // Columns are 0.5 apart and rows 0.75; DICOM's x and y point left and to the back.
            let lps = slices[0].position + row * (0.5 * i) + column * (0.75 * j) + row.cross(column) * (2.5 * k);
            let found = header.index_to_world.to_world(DVec3::new(i, j, k));
            // Positions and directions are written with 10 decimals, the directions count up to 3 voxels of 0.75.
            assert!((found - lps * DVec3::new(-1.0, -1.0, 1.0)).length() < 2e-9, "{syntax} {corner:?}: {found}");
        }
    }
}

#[test]
fn jpeg_2000_is_unpacked() {
    let slice = series(JPEG_2000).remove(0);
    let (_, values) = read_slices(std::slice::from_ref(&slice)).unwrap();
    let stored: Vec<f64> = slice.values.iter().map(|v| f64::from(*v) * 2.0 - 1024.0).collect();
    assert_eq!(values, stored);
    let folder = tempfile::tempdir().unwrap();
    let start = slice.file().windows(4).position(|bytes| bytes == &CODESTREAM[..4]).unwrap();
    // The first byte of the codestream, the width, and the depth of the values.
    for (at, byte, words) in [(0, 0, "no codestream"), (11, 5, "5 x 3 pixels in a file of 4 x 3"), (42, 0x90, "17-bit")]
    {
        let mut damaged = slice.file();
        damaged[start + at] = byte;
        std::fs::write(folder.path().join("a.dcm"), damaged).unwrap();
        let error = read(&folder.path().join("a.dcm"), &Options::default()).unwrap_err();
        assert!(error.to_string().contains(words) && error.remedy().is_some(), "{error}");
    }
}

#[test]
fn a_file_stands_for_its_series_and_integers_stay() {
    let folder = tempfile::tempdir().unwrap();
    let mut slices = series(EXPLICIT);
    slices.iter_mut().for_each(|s| s.rescale = None);
    let mut other = slices[..2].to_vec();
    other.iter_mut().for_each(|s| s.series = "1.2.4");
    slices.extend(other);
    write(folder.path(), &slices);
    let error = read(folder.path(), &Options::default()).unwrap_err();
    refusal::is(&error, Code::Invalid, &["1.2.3 (CT, thorax, 5 files)", "1.2.4", "`series"]);
    let choice = Options { series: Some("1.2.4".into()), ..Options::default() };
    assert_eq!(read(folder.path(), &choice).unwrap().0.size, [4, 3, 2]);
    let of_first = folder.path().join("01.dcm");
    let (header, _) = read(&of_first, &Options::default()).unwrap();
    assert_eq!((header.size, header.values), ([4, 3, 5], Values::Integer));
    let wrong = Options { series: Some("9".into()), ..Options::default() };
    refusal::is(&read(folder.path(), &wrong).unwrap_err(), Code::Invalid, &["series 9", "1.2.3", "1.2.4"]);
}

/// A change to a slice.
type Change<'a> = &'a dyn Fn(&mut Slice);

#[test]
fn uneven_missing_doubled_and_turned_slices_are_named() {
    let all = series(EXPLICIT);
    let without =
        |k: usize| all.iter().enumerate().filter(|(i, _)| *i != k).map(|(_, s)| s.clone()).collect::<Vec<_>>();
    refusal::is(&read_slices(&without(2)).unwrap_err(), Code::Invalid, &["5.000 mm", "1 were missing"]);
    let changed = |change: &dyn Fn(&mut Slice)| {
        let mut slices = all.clone();
        change(&mut slices[2]);
        read_slices(&slices).unwrap_err()
    };
    let normal = oblique()[0].cross(oblique()[1]);
    let cases: [(Change, &str); 4] = [
        (&|s| s.position += normal * 0.4, "mm apart"),
        (&|s| s.position += normal * 2.5, "2 slices"),
        (&|s| s.position += oblique()[0] * 9.0, "in line"),
        (&|s| s.axes.swap(0, 1), "orientation"),
    ];
    for (change, words) in cases {
        refusal::is(&changed(change), Code::Invalid, &[words]);
    }
    // A gantry's tilt moves every slice along its rows: a shear, not a fault.
    let mut tilted = all.clone();
    (0..5).for_each(|k| tilted[k].position += oblique()[1] * (0.3 * k as f64));
    let step = read_slices(&tilted).unwrap().0.index_to_world.matrix().z_axis.truncate();
    let expected = normal * 2.5 + oblique()[1] * 0.3;
    assert!((step - expected * DVec3::new(-1.0, -1.0, 1.0)).length() < 1e-9);
    // Two points in time: as many slices at each position.
    let mut twice = all.clone();
    twice.extend(all.iter().map(|s| Slice {
        number: s.number + 100,
        values: s.values.iter().map(|v| v + 1).collect(),
        ..s.clone()
    }));
    let (header, values) = read_slices(&twice).unwrap();
    assert!(header.size == [4, 3, 5] && header.notes.iter().any(|n| n.contains("⟨time_point")), "{header:?}");
    assert_eq!(values[0], f64::from(all[0].values[0]) * 2.0 - 1024.0);
}

#[test]
fn a_slice_that_is_lost_is_named() {
    let whole = series(EXPLICIT);
    let lost = |change: &dyn Fn(&Path), words: &[&str]| {
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), &whole);
        change(folder.path());
        for path in [folder.path().to_path_buf(), folder.path().join("01.dcm")] {
            let error = read(&path, &Options::default()).unwrap_err();
            refusal::is(&error, Code::Invalid, words);
            assert!(error.remedy().is_some(), "{error}");
        }
    };
    let length = whole[0].file().len();
    let put = |folder: &Path, bytes: &[u8]| std::fs::write(folder.join("03.dcm"), bytes).unwrap();
    // What disks and copies leave: zeros, nothing, a part of the header, or all but the pixels.
    lost(&|folder| put(folder, &vec![0; length]), &["03.dcm", "name of a slice"]);
    lost(&|folder| put(folder, &[]), &["03.dcm", "name of a slice"]);
    let file = whole[1].file();
    lost(&|folder| put(folder, &file[..200]), &["03.dcm", "may be one of the series"]);
    let pixels = file.windows(4).rposition(|w| w == [0xe0, 0x7f, 0x10, 0]).unwrap();
    lost(&|folder| put(folder, &file[..pixels]), &["03.dcm", "no pixels"]);
    lost(&|folder| put(folder, &[&file[..300], &vec![0; length - 300]].concat()), &["03.dcm"]);
    // Names that differ in their numbers alone are those of slices, too.
    let folder = tempfile::tempdir().unwrap();
    whole.iter().enumerate().for_each(|(n, s)| std::fs::write(folder.path().join(format!("I{n}")), s.file()).unwrap());
    std::fs::write(folder.path().join("I17"), [0; 500]).unwrap();
    refusal::is(&read(folder.path(), &Options::default()).unwrap_err(), Code::Invalid, &["I17"]);
    std::fs::remove_file(folder.path().join("I17")).unwrap();
    assert_eq!(read(folder.path(), &Options::default()).unwrap().0.size, [4, 3, 5]);
}

/// Notes of a folder once all of its slices are read.
fn notes_of(folder: &Path) -> Vec<String> {
    let mut image = format_of("DICOM").open(folder, &Options::default(), LIMITS).unwrap().remove(0);
    let limits = Limits { max_memory: 1 << 30 };
    let settings = Settings { name: "g", grid_type: GridType::Float, mapping: Mapping::default(), limits };
    build(&mut image, &settings, |_, _| {}).unwrap();
    image.header.notes
}

#[test]
fn slices_of_zeros_are_noted() {
    let whole = series(EXPLICIT);
    let notes = |change: &dyn Fn(&mut [Slice])| {
        let mut slices = whole.clone();
        change(&mut slices);
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), &slices);
        notes_of(folder.path())
    };
    assert_eq!(notes(&|_| {}), Vec::<String>::new());
    let empty = notes(&|slices| slices[2].values.fill(0));
    assert!(empty.len() == 1 && empty[0].contains("every pixel of slice 3 of 5 (02.dcm)"), "{empty:?}");
    let two = notes(&|slices| slices[3..].iter_mut().for_each(|s| s.values.fill(0)));
    assert!(two.len() == 1 && two[0].contains("2 slices, the first of them slice 4 of 5"), "{two:?}");
    let cut = notes(&|slices| slices[2].values[4..].fill(0));
    assert!(cut.len() == 1 && cut[0].contains("the last 2 rows of slice 3 of 5 (02.dcm)"), "{cut:?}");
    let last = notes(&|slices| slices[4].values[3..].fill(0));
    assert!(last.len() == 1 && last[0].contains("the last 2 rows of slice 5 of 5"), "{last:?}");
    // Air, a row of it, and a series of nothing else are no loss.
    assert_eq!(notes(&|slices| slices.iter_mut().for_each(|s| s.values[4..].fill(0))), Vec::<String>::new());
    assert_eq!(notes(&|slices| slices[2].values[8..].fill(0)), Vec::<String>::new());
    assert_eq!(notes(&|slices| slices.iter_mut().for_each(|s| s.values.fill(0))), Vec::<String>::new());
}

#[test]
fn slices_that_hold_other_numbers_are_told() {
    let whole = series(EXPLICIT);
    // A slope of 0 leaves nothing of a slice.
    let mut slices = whole.clone();
    slices[2].rescale = Some((0.0, -1024.0));
    let error = read_slices(&slices).unwrap_err();
    refusal::is(&error, Code::Invalid, &["02.dcm", "(0028,1053)"]);
    assert!(error.remedy().is_some(), "{error}");
    // One without a scale is taken as it is stored.
    slices[2].rescale = None;
    let (header, values) = read_slices(&slices).unwrap();
    assert!(header.notes.iter().any(|n| n.contains("1 of 5 slices, the first of them 02.dcm")), "{header:?}");
    assert_eq!(values[24], f64::from(slices[2].values[0]));
    assert_eq!(values[36], f64::from(slices[3].values[0]) * 2.0 - 1024.0);
    // Other slopes alone are usual in PET.
    slices[2].rescale = Some((3.0, -1024.0));
    assert_eq!(read_slices(&slices).unwrap().0.notes, Vec::<String>::new());

    let folder = tempfile::tempdir().unwrap();
    let one = |from: &[u8], to: &[u8]| {
        write(folder.path(), &whole);
        std::fs::write(folder.path().join("02.dcm"), patched(whole[2].file(), from, to)).unwrap();
    };
    // Without signs: each slice is decoded by its own header, and this is said.
    one(&[0x28, 0, 3, 1, b'U', b'S', 2, 0, 1, 0], &[0x28, 0, 3, 1, b'U', b'S', 2, 0, 0, 0]);
    let (header, values) = read(folder.path(), &Options::default()).unwrap();
    let told = |n: &String| n.contains("02.dcm holds unsigned integers") && n.contains("signed integers of 16 bits");
    assert!(header.notes.iter().any(told), "{header:?}");
    let stored: Vec<f64> = whole[2].values.iter().map(|v| f64::from(v.cast_unsigned()) * 2.0 - 1024.0).collect();
    assert_eq!(values[24..36], stored);
    // The intercept alone: the slope's element has another name.
    one(&[0x28, 0, 0x53, 0x10, b'D', b'S'], &[0x28, 0, 0x55, 0x10, b'D', b'S']);
    let (header, values) = read(folder.path(), &Options::default()).unwrap();
    assert!(header.notes.iter().any(|n| n.contains("first of them 02.dcm, lack a rescale slope")), "{header:?}");
    assert_eq!(values[24], f64::from(whole[2].values[0]) - 1024.0);
    one(b"MONOCHROME2", b"MONOCHROME1");
    let error = read(folder.path(), &Options::default()).unwrap_err();
    refusal::is(&error, Code::Invalid, &["02.dcm", "MONOCHROME1"]);
    assert!(error.remedy().is_some(), "{error}");
}

#[test]
fn files_that_are_no_slices_are_passed_over() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), &series(EXPLICIT));
    // The directory of a medium, a report of another series, and what systems hide.
    let mut meta = Writer::new(EXPLICIT);
    meta.text(0x0002_0002, b"UI", "1.2.840.10008.1.3.10");
    meta.text(0x0002_0010, b"UI", EXPLICIT);
    std::fs::write(folder.path().join("DICOMDIR"), [&[0; 128][..], b"DICM", &meta.bytes].concat()).unwrap();
    let report = Slice { series: "1.2.9", ..series(EXPLICIT).remove(0) }.file();
    let pixels = report.windows(4).rposition(|w| w == [0xe0, 0x7f, 0x10, 0]).unwrap();
    std::fs::write(folder.path().join("report.dcm"), &report[..pixels]).unwrap();
    std::fs::write(folder.path().join("._01.dcm"), "hidden").unwrap();
    let (header, _) = read(folder.path(), &Options::default()).unwrap();
    assert_eq!(header.size, [4, 3, 5]);
    assert!(header.notes.iter().any(|n| n.starts_with("2 DICOM file(s)") && n.contains("DICOMDIR")), "{header:?}");
}

#[test]
fn slices_between_which_others_are_missing_are_refused() {
    let every_other: Vec<Slice> = series(EXPLICIT).into_iter().step_by(2).collect();
    // Slices are 1.5 thick, and here as far apart.
    let apart = |slices: &[Slice], distance: f64| {
        let mut slices = slices.to_vec();
        let normal = oblique()[0].cross(oblique()[1]);
        slices.iter_mut().for_each(|s| s.position = normal * (distance * f64::from(s.number)));
        let folder = tempfile::tempdir().unwrap();
        slices.iter().for_each(|s| std::fs::write(folder.path().join(format!("{}.dcm", s.number)), s.file()).unwrap());
        read(folder.path(), &Options::default())
    };
    for slices in [&every_other[..2], &every_other[..]] {
        refusal::is(&apart(slices, 1.5).unwrap_err(), Code::Invalid, &["3.000 mm", "1 were missing"]);
        // Numbers alone are no proof.
        let (header, _) = apart(slices, 2.5).unwrap();
        assert!(header.notes.iter().any(|n| n.contains("may be missing")), "{header:?}");
    }
    assert!(apart(&series(EXPLICIT), 1.5).unwrap().0.notes.iter().all(|n| !n.contains("missing")));
}

#[test]
fn the_file_that_is_named_is_the_one_that_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let slice = series(EXPLICIT).remove(0);
    for (name, value) in [("a.dcm", 7), ("b.dcm", 99)] {
        std::fs::write(folder.path().join(name), Slice { values: vec![value; 12], ..slice.clone() }.file()).unwrap();
    }
    for (name, value) in [("a.dcm", 7.0), ("b.dcm", 99.0)] {
        let (header, values) = read(&folder.path().join(name), &Options::default()).unwrap();
        assert_eq!(values, [value * 2.0 - 1024.0; 12], "{name}");
        assert!(header.notes.iter().any(|n| n.contains("of 2 in time")), "{header:?}");
    }
    let path = folder.path().join("b.dcm");
    let error = read(&path, &Options { time: Some(0), ..Options::default() }).unwrap_err();
    refusal::is(&error, Code::Invalid, &["b.dcm", "point 1 in time", "not of 0"]);
    assert!(error.remedy().is_some(), "{error}");
    assert!(read(&path, &Options { time: Some(1), ..Options::default() }).is_ok());
    let error = read(&path, &Options { series: Some("9.9".into()), ..Options::default() }).unwrap_err();
    refusal::is(&error, Code::Invalid, &["1.2.3", "9.9"]);
}

#[test]
fn a_preamble_may_be_the_header_of_a_tiff() {
    let folder = tempfile::tempdir().unwrap();
    let mut file = series(EXPLICIT).remove(0).file();
    file[..8].copy_from_slice(b"II*\0\x08\0\0\0");
    let path = folder.path().join("ct.dcm");
    std::fs::write(&path, file).unwrap();
    assert_eq!(images::found(&path), Some("DICOM"));
    assert_eq!(read(&path, &Options::default()).unwrap().0.size, [4, 3, 1]);
}

/// Replaces a text in the bytes of a file by one of the same length.
fn patched(mut bytes: Vec<u8>, from: &[u8], to: &[u8]) -> Vec<u8> {
    let at = bytes.windows(from.len()).position(|w| w == from).unwrap();
    bytes[at..at + to.len()].copy_from_slice(to);
    bytes
}

#[test]
fn options_that_the_series_contradicts_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), &series(EXPLICIT));
    let three = DVec3::new(1.0, 2.0, 3.0);
    let cases = [
        (Options { spacing: Some(three), ..Options::default() }, "`spacing`"),
        (Options { origin: Some(three), ..Options::default() }, "`origin`"),
        (Options { transform: Some(Affine::uniform(1.0, DVec3::ZERO).unwrap()), ..Options::default() }, "`transform`"),
    ];
    for (options, words) in cases {
        let error = read(folder.path(), &options).unwrap_err();
        refusal::is(&error, Code::Invalid, &[words]);
        assert!(error.remedy().is_some(), "{error}");
    }
    // One file of larger pixels.
    let file = patched(series(EXPLICIT)[2].file(), b"0.75\\0.5", b"0.85\\0.5");
    std::fs::write(folder.path().join("02.dcm"), file).unwrap();
    let error = read(folder.path(), &Options::default()).unwrap_err();
    refusal::is(&error, Code::Invalid, &["02.dcm", "pixels of another size"]);
}

#[test]
fn slices_without_positions_lie_where_the_options_say() {
    let folder = tempfile::tempdir().unwrap();
    // An element of another name: the position is not there.
    for (n, slice) in series(EXPLICIT).iter().enumerate() {
        let file = patched(slice.file(), &[0x20, 0, 0x32, 0, b'D', b'S'], &[0x20, 0, 0x33, 0, b'D', b'S']);
        std::fs::write(folder.path().join(format!("{n}.dcm")), file).unwrap();
    }
    // Either all say so or none.
    let one = tempfile::tempdir().unwrap();
    write(one.path(), &series(EXPLICIT));
    std::fs::copy(folder.path().join("0.dcm"), one.path().join("03.dcm")).unwrap();
    refusal::is(&read(one.path(), &Options::default()).unwrap_err(), Code::Invalid, &["03.dcm", "where it lies"]);
    let origin = DVec3::new(5.0, 6.0, 7.0);
    let (header, _) = read(folder.path(), &Options { origin: Some(origin), ..Options::default() }).unwrap();
    assert_eq!(header.index_to_world.to_world(DVec3::ZERO), origin);
    // Rows run to the left, columns to the back; slices are 1.5 thick.
    assert_eq!(header.index_to_world.to_world(DVec3::ONE) - origin, DVec3::new(-0.5, -0.75, 1.5));
    let map = Affine::new(glam::DMat4::from_scale(DVec3::new(2.0, 3.0, 4.0))).unwrap();
    let (header, _) = read(folder.path(), &Options { transform: Some(map), ..Options::default() }).unwrap();
    assert_eq!(header.index_to_world, map);
}

#[test]
fn slices_of_micrometres_are_no_points_in_time() {
    let normal = oblique()[0].cross(oblique()[1]);
    let mut slices = series(EXPLICIT);
    for (k, slice) in slices.iter_mut().enumerate() {
        slice.position = normal * (0.001 * k as f64);
    }
    let folder = tempfile::tempdir().unwrap();
    for (n, slice) in slices.iter().enumerate() {
        let file = patched(slice.file(), b"0.75\\0.5", b"1e-3\\.01");
        std::fs::write(folder.path().join(format!("{n}.dcm")), file).unwrap();
    }
    let (header, _) = read(folder.path(), &Options::default()).unwrap();
    assert_eq!(header.size, [4, 3, 5]);
    // Positions have ten decimals.
    assert!((header.index_to_world.matrix().z_axis.length() - 0.001).abs() < 1e-9);
}

#[test]
fn any_positions_have_an_order() {
    // Closer to the next one than what counts as rounding, in no order of their numbers: neighbors are alike, others are not.
    let normal = oblique()[0].cross(oblique()[1]);
    let one = series(EXPLICIT).remove(0);
    let slices: Vec<Slice> = (0..200)
        .map(|k| Slice {
            number: (k * 37) % 200,
            position: normal * (0.00015 * f64::from((k * 7919) % 200)),
            values: vec![k as i16; 12],
            ..one.clone()
        })
        .collect();
    let (header, _) = read_slices(&slices).unwrap();
    assert!(header.notes.iter().any(|n| n.contains("first of 200")), "{header:?}");
}

#[test]
fn frames_that_are_not_there_take_no_memory() {
    let folder = tempfile::tempdir().unwrap();
    for (syntax, code, facts) in [
        (EXPLICIT, Code::Invalid, &["24 bytes", "999999999 frames"][..]),
        (RLE, Code::MemoryLimit, &["999999999 frames", "`max_memory`"]),
    ] {
        let bytes = series(syntax).remove(0).file();
        let mut w = Writer::new(syntax);
        w.text(0x0028_0008, b"IS", "999999999");
        let at = bytes.windows(4).position(|w| w == [0x28, 0, 0x10, 0]).unwrap();
        let many = [&bytes[..at], &w.bytes, &bytes[at..]].concat();
        std::fs::write(folder.path().join("a.dcm"), many).unwrap();
        let error = read(&folder.path().join("a.dcm"), &Options::default()).unwrap_err();
        refusal::is(&error, code, facts);
        assert!(error.remedy().is_some(), "{error}");
    }
}

#[test]
fn what_is_not_read_says_what_to_do() {
    for (syntax, words) in
        [("1.2.840.10008.1.2.4.201", "HTJ2K"), ("1.2.840.10008.1.2.4.80", "JPEG-LS"), ("1.2.3", "unknown")]
    {
        let slice = Slice { syntax, ..series(EXPLICIT).remove(0) };
        refusal::is(&read_slices(&[slice]).unwrap_err(), Code::Unsupported, &[words, "gdcmconv --raw"]);
    }
}

/// Reads a folder whose first file is damaged; what comes out may be an error or an image, but no panic.
fn trial(folder: &Path, bytes: &[u8], options: &Options) -> bool {
    std::fs::write(folder.join("a.dcm"), bytes).unwrap();
    match read(&folder.join("a.dcm"), options) {
        Ok(_) => false,
        Err(error) => {
            let text = error.to_string();
            assert!(error.remedy().is_some() && text.contains("a.dcm"), "{text}");
            true
        }
    }
}

#[test]
fn damaged_files_are_errors_and_take_no_memory() {
    let folder = tempfile::tempdir().unwrap();
    let options = Options::default();
    for syntax in [IMPLICIT, EXPLICIT, BIG, RLE, DEFLATED, JPEG_2000] {
        let whole = series(syntax).remove(0).file();
        assert!(!trial(folder.path(), &whole, &options), "{syntax}");
        for n in (0..whole.len() - 8).step_by(9) {
            assert!(trial(folder.path(), &whole[..n], &options), "{syntax}: cut at {n}");
        }
        let mut refused = 0;
        for at in (128..whole.len()).step_by(4) {
            let mut damaged = whole.clone();
            damaged[at] = [0, 0x7f, 0xff][at / 4 % 3];
            refused += usize::from(trial(folder.path(), &damaged, &options));
        }
        assert!(refused > 20, "{syntax}: {refused}");
    }
    // A length of 4 GB is refused before it is allocated: the process would otherwise grow by that.
    let mut whole = series(IMPLICIT).remove(0).file();
    let at = whole.windows(4).position(|w| w == [0x20, 0, 0x0e, 0]).unwrap() + 4;
    whole[at..at + 4].copy_from_slice(&[0xf0, 0xff, 0xff, 0xff]);
    std::fs::write(folder.path().join("a.dcm"), &whole).unwrap();
    let error = read(&folder.path().join("a.dcm"), &options).unwrap_err();
    refusal::is(&error, Code::Invalid, &["a.dcm", "(0020,000e)"]);
}
