//! MRC and CCP4 maps of electron microscopy and crystallography, plain or in gzip.
//!
//! Units are ångströms. The three file axes (columns, rows, sections) stay the index axes x, y and z of the image; what
//! the header says of the axes of the cell that they run along (MAPC, MAPR, MAPS) goes into the map to the world. The
//! voxel of index 0 lies at ORIGIN where that is not 0, else at the start that NXSTART, NYSTART and NZSTART count in
//! voxels.
//!
//! Source: [MRC2014](https://www.ccpem.ac.uk/mrc_format/mrc2014.php), and the CCP4 map format it continues.

use super::image::{About, Header, Image, Values};
use super::input::{self, Packing};
use super::placement;
use super::stream::Binary;
use crate::error::{Error, Result};
use crate::formats::sample::{Endian, Sample};
use crate::math::Affine;
use glam::DVec3;
use std::io::Read;
use std::path::Path;

/// Bytes of the header.
const HEADER: usize = 1024;
/// Place of the word `MAP `.
const MAP: usize = 208;

/// True if a file, or what it unpacks to, begins as a map does.
pub(crate) fn is_mrc(start: &[u8]) -> bool {
    start.get(MAP..MAP + 4) == Some(b"MAP ")
}

/// True if a file is gzip and unpacks to a map.
///
/// # Errors
/// If the file cannot be opened.
pub(crate) fn is_packed_mrc(path: &Path, start: &[u8]) -> Result<bool> {
    if !input::is_gzip(start) {
        return Ok(false);
    }
    let mut head = Vec::new();
    let unpacked = input::values(path, 0, Packing::Gzip, 0)?;
    // What is no sound stream of gzip is no map, whatever the error.
    let read = unpacked.take(HEADER as u64).read_to_end(&mut head);
    Ok(read.is_ok() && is_mrc(&head))
}

/// The header's words.
struct Words<'a> {
    bytes: &'a [u8; HEADER],
    endian: Endian,
}

impl Words<'_> {
    fn four(&self, number: usize) -> [u8; 4] {
        let mut four: [u8; 4] = std::array::from_fn(|i| self.bytes[4 * number + i]);
        if self.endian == Endian::Big {
            four.reverse();
        }
        four
    }
    fn integer(&self, number: usize) -> i32 {
        i32::from_le_bytes(self.four(number))
    }
    fn real(&self, number: usize) -> f64 {
        f32::from_le_bytes(self.four(number)).into()
    }
    fn integers(&self, number: usize) -> [i32; 3] {
        [0, 1, 2].map(|i| self.integer(number + i))
    }
    fn reals(&self, number: usize) -> [f64; 3] {
        [0, 1, 2].map(|i| self.real(number + i))
    }
}

fn wrong(what: impl Into<String>) -> Error {
    Error::invalid(what).hint("correct the header, or write the map again where it was made")
}

/// Byte order of a header: that of the machine stamp, else the one in which the mode and the axes make sense.
fn endian(bytes: &[u8; HEADER]) -> Endian {
    match bytes[212] {
        0x44 | 0x41 => Endian::Little,
        0x11 => Endian::Big,
        _ => {
            let words = Words { bytes, endian: Endian::Little };
            let sensible = (0..=101).contains(&words.integer(3)) && (1..=3).contains(&words.integer(16));
            if sensible { Endian::Little } else { Endian::Big }
        }
    }
}

/// Type of the values of a mode.
fn sample(mode: i32) -> Result<Sample> {
    match mode {
        0 => Ok(Sample::I8),
        1 => Ok(Sample::I16),
        2 => Ok(Sample::F32),
        6 => Ok(Sample::U16),
        12 => Ok(Sample::F16),
        3 | 4 => Err(Error::unsupported(format!("mode {mode}, complex numbers (a transform), is not read"))
            .hint("transform the map back to real space first")),
        _ => Err(Error::unsupported(format!("mode {mode} is not read; 0, 1, 2, 6 and 12 are"))
            .hint("convert the map to mode 2 (32-bit floats) where it was made")),
    }
}

/// True if bytes are unsigned: files of IMOD state whether they are signed, in flags behind a stamp.
fn has_unsigned_bytes(words: &Words) -> bool {
    const STAMP: i32 = 1_146_047_817;
    words.integer(3) == 0 && words.integer(38) == STAMP && words.integer(39) & 1 == 0
}

/// Columns of the cell's axes a, b and c, with a along x and b in the plane of x and y.
fn cell(lengths: [f64; 3], angles: [f64; 3], notes: &mut Vec<String>) -> Result<[DVec3; 3]> {
    let [a, b, c] = lengths;
    if angles.iter().all(|angle| *angle == 0.0) {
        notes.push("the header states no angles of the cell; right angles are taken".into());
    }
    let right = |angle: f64| angle == 90.0 || angle == 0.0;
    if angles.into_iter().all(right) {
        return Ok([DVec3::X * a, DVec3::Y * b, DVec3::Z * c]);
    }
    let [alpha, beta, gamma] = angles.map(f64::to_radians);
    let x = beta.cos();
    let y = (alpha.cos() - beta.cos() * gamma.cos()) / gamma.sin();
    let z = (1.0 - x * x - y * y).sqrt();
    if !(z > 0.0 && angles.iter().all(|a| (0.0..180.0).contains(a))) {
        return Err(wrong(format!("the angles {angles:?} span no cell")));
    }
    Ok([DVec3::X * a, DVec3::new(gamma.cos(), gamma.sin(), 0.0) * b, DVec3::new(x, y, z) * c])
}

/// Map from file indices to the world.
fn placed(words: &Words, size: [usize; 3], notes: &mut Vec<String>) -> Result<Affine> {
    let axes = words.integers(16);
    let mut sorted = axes;
    sorted.sort_unstable();
    // Files of old programs leave the axes out.
    let axes = match sorted {
        [1, 2, 3] => axes.map(|a| (a - 1) as usize),
        [0, 0, 0] => [0, 1, 2],
        _ => return Err(wrong(format!("MAPC, MAPR and MAPS are {axes:?}; an order of 1, 2 and 3 is expected"))),
    };
    let mut intervals = words.integers(7).map(f64::from);
    let mut lengths = words.reals(10);
    if intervals.iter().any(|n| *n <= 0.0) {
        notes.push("the header states no sampling of the cell; that of the map is taken".into());
        axes.iter().zip(size).for_each(|(axis, n)| intervals[*axis] = n as f64);
    }
    if lengths.iter().all(|l| *l == 0.0) {
        notes.push("the header states no size of the cell; voxels of 1 ångström are taken".into());
        lengths = intervals;
    }
    for (length, axis) in lengths.iter().zip(["a", "b", "c"]) {
        placement::edge(&format!("the cell's edge {axis}"), *length)?;
    }
    let mut cell = cell(lengths, words.reals(13), notes)?;
    cell.iter_mut().zip(intervals).for_each(|(axis, n)| *axis /= n);
    let origin = DVec3::from_array(words.reals(49));
    let starts = words.integers(4);
    let start: DVec3 = axes.iter().zip(starts).map(|(axis, n)| cell[*axis] * f64::from(n)).sum();
    let first = if origin == DVec3::ZERO { start } else { origin };
    if origin != DVec3::ZERO && start != DVec3::ZERO && (origin - start).length() > 1e-3 * cell[0].length() {
        notes.push("the header states both an origin and a start in voxels; the origin is taken".into());
    }
    placement::affine(axes.map(|axis| cell[axis]), first)
}

/// Opens a map.
///
/// # Errors
/// If the file cannot be read, is shorter than its header says, or holds complex numbers or others that are not read.
pub(crate) fn open(path: &Path) -> Result<Image> {
    let packing = if input::is_gzip(&input::start(path, 2)?) { Packing::Gzip } else { Packing::Plain };
    let mut head = [0; HEADER];
    let mut reader = input::values(path, 0, packing, 0)?;
    reader
        .read_exact(&mut head)
        .map_err(|e| wrong(format!("the header of {HEADER} bytes cannot be read ({e})")).at(path))?;
    drop(reader);
    let place = |e: Error| e.at(path);
    let mut notes = Vec::new();
    let words = Words { bytes: &head, endian: endian(&head) };
    let mut sample = sample(words.integer(3)).map_err(place)?;
    if has_unsigned_bytes(&words) {
        notes.push("the bytes are unsigned, as IMOD's flags in the header say".into());
        sample = Sample::U8;
    }
    let size = words.integers(0).map(|n| usize::try_from(n).unwrap_or(0));
    if size.contains(&0) {
        return Err(place(wrong(format!("a map of {:?} columns, rows and sections", words.integers(0)))));
    }
    let extended =
        u64::try_from(words.integer(23)).map_err(|_| place(wrong("the extended header has less than 0 bytes")))?;
    let from = HEADER as u64 + extended;
    if packing == Packing::Plain {
        input::has(path, from, input::byte_count(size, 1, sample.bytes()))?;
    }
    match words.integer(22) {
        0 if size[2] > 1 => notes.push("the header says that this is a stack of pictures, not a volume".into()),
        401.. => notes.push("the header says that this is a stack of volumes; they are read as one".into()),
        _ => {}
    }
    let index_to_world = placed(&words, size, &mut notes).map_err(place)?;
    let reader = match packing {
        Packing::Plain => input::values(path, from, packing, 0)?,
        _ => {
            let bytes = input::byte_count(size, 1, sample.bytes()).unwrap_or(u64::MAX);
            input::whole(input::values(path, 0, packing, from)?, packing, bytes)
        }
    };
    let values = if sample.is_integer() { Values::Integer } else { Values::Real };
    let header = Header { name: None, size, components: 1, values, index_to_world, about: About::default(), notes };
    Ok(Image { header, slices: Box::new(Binary::new(reader, sample, words.endian)) })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use std::io::Write;

    /// A map of 4 x 3 x 2 whose values count from 0, of a mode and byte order, with the word `number` set as `change`
    /// says.
    fn map(mode: i32, big: bool, change: &[(usize, [u8; 4])]) -> Vec<u8> {
        let mut words = vec![[0_u8; 4]; HEADER / 4];
        let mut set = |at: usize, values: &[i32]| {
            values.iter().enumerate().for_each(|(i, v)| words[at + i] = v.to_le_bytes());
        };
        set(0, &[4, 3, 2, mode]);
        set(4, &[0, 0, 0, 4, 3, 2]);
        set(16, &[1, 2, 3]);
        set(22, &[1, 8]);
        let reals = [(10, 8.0_f32), (11, 9.0), (12, 1.0), (13, 90.0), (14, 90.0), (15, 90.0)];
        reals.iter().for_each(|(at, v)| words[*at] = v.to_le_bytes());
        change.iter().for_each(|(at, v)| words[*at] = *v);
        let mut file: Vec<u8> = words.iter().flat_map(|w| if big { [w[3], w[2], w[1], w[0]] } else { *w }).collect();
        file[MAP..MAP + 4].copy_from_slice(b"MAP ");
        file[212] = if big { 0x11 } else { 0x44 };
        // The extended header.
        file.extend([0xee; 8]);
        let sample = sample(mode).unwrap_or(Sample::F32);
        for i in 0..24 {
            let mut bytes = Vec::new();
            sample.encode(&[f64::from(i)], &mut bytes);
            if big {
                bytes.reverse();
            }
            file.extend(bytes);
        }
        file
    }

    fn read(bytes: &[u8]) -> Result<(Header, Vec<f64>)> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), bytes).unwrap();
        let mut image = open(file.path())?;
        let mut all = Vec::new();
        let mut slice = vec![0.0; image.header.slice_len().unwrap().min(1 << 12)];
        for _ in 0..image.header.size[2].min(1 << 10) {
            image.slices.next_slice(&mut slice)?;
            all.extend_from_slice(&slice);
        }
        Ok((image.header, all))
    }

    #[test]
    fn modes_and_byte_orders_are_read() {
        let counted: Vec<f64> = (0..24).map(f64::from).collect();
        for mode in [0, 1, 2, 6, 12] {
            for big in [false, true] {
                let (header, values) = read(&map(mode, big, &[])).unwrap();
                assert_eq!((header.size, &values), ([4, 3, 2], &counted), "{mode} {big}");
                assert_eq!(header.index_to_world.voxel_size(), DVec3::new(2.0, 3.0, 0.5));
                assert_eq!(header.values == Values::Integer, matches!(mode, 0 | 1 | 6));
            }
        }
        // IMOD's stamp, without and with the flag of signed bytes.
        for (flags, last) in [(0_i32, 200.0), (1, -56.0)] {
            let imod = [(38, 1_146_047_817_i32.to_le_bytes()), (39, flags.to_le_bytes())];
            let mut file = map(0, false, &imod);
            file.pop();
            file.push(200);
            assert_eq!(read(&file).unwrap().1[23], last);
        }
        let mut packer = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        packer.write_all(&map(2, false, &[])).unwrap();
        let packed = packer.finish().unwrap();
        assert_eq!(read(&packed).unwrap().1, counted);
        assert!(read(&packed[..packed.len() / 2]).is_err());
    }

    #[test]
    fn axes_origins_and_cells_place_the_voxels() {
        let integer = |v: i32| v.to_le_bytes();
        let real = |v: f32| v.to_le_bytes();
        // Columns along z, rows along x, sections along y; 5 columns from the cell's origin.
        let turned = [(16, integer(3)), (17, integer(1)), (18, integer(2)), (4, integer(5))];
        let (header, _) = read(&map(2, false, &turned)).unwrap();
        let map_of = |h: &Header| h.index_to_world;
        // Voxels of 8/4, 9/3 and 1/2 along x, y and z.
        assert_eq!(map_of(&header).to_world(DVec3::ZERO), DVec3::new(0.0, 0.0, 2.5));
        assert_eq!(map_of(&header).to_world(DVec3::new(1.0, 2.0, 3.0)), DVec3::new(4.0, 9.0, 3.0));
        let origin = [(4, integer(5)), (49, real(-7.0)), (51, real(4.0))];
        let (header, _) = read(&map(2, true, &origin)).unwrap();
        assert_eq!(map_of(&header).to_world(DVec3::ZERO), DVec3::new(-7.0, 0.0, 4.0));
        assert!(header.notes.iter().any(|n| n.contains("origin is taken")), "{:?}", header.notes);
        // A hexagonal cell: b is turned by 120 degrees from a.
        let (header, _) = read(&map(2, false, &[(15, real(120.0))])).unwrap();
        let b = map_of(&header).matrix().y_axis.truncate();
        // cos and sin of 120 degrees are correct to a few 2^-53.
        assert!((b - DVec3::new(-1.5, 3.0 * 0.75_f64.sqrt(), 0.0)).length() < 1e-15, "{b}");
    }

    #[test]
    fn damage_is_named_and_never_panics() {
        let whole = map(2, false, &[]);
        for n in (0..whole.len()).step_by(7) {
            assert!(read(&whole[..n]).unwrap_err().remedy().is_some(), "{n}");
        }
        for at in 0..256 {
            let mut damaged = whole.clone();
            damaged[at] = [0, 0x7f, 0x80, 0xff][at % 4];
            if let Err(error) = read(&damaged) {
                assert!(error.remedy().is_some(), "{error}");
            }
        }
        let cases = [(3, 4, "complex"), (3, 77, "mode 77"), (16, 2, "MAPC"), (0, 0, "columns"), (23, -1, "extended")];
        for (at, value, words) in cases {
            let error = read(&map(2, false, &[(at, i32::to_le_bytes(value))])).unwrap_err().to_string();
            assert!(error.contains(words), "{error} lacks {words}");
        }
        let angles = [(13, 10.0_f32.to_le_bytes()), (14, 10.0_f32.to_le_bytes()), (15, 120.0_f32.to_le_bytes())];
        assert!(read(&map(2, false, &angles)).unwrap_err().to_string().contains("span no cell"));
    }
}
