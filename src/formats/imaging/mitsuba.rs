//! Grids of Mitsuba (`.vol`), which its plugin `gridvolume` reads.
//!
//! A header of 48 bytes states the encoding, the size, the number of channels and a box; the values follow, x fastest,
//! the channels of a voxel together. All numbers are little endian. The faces of the box are those of the outermost
//! voxels, as in Mitsuba 3, so that the centre of the first voxel lies half a voxel inside. A box that is all zero is
//! no statement, and stands for the unit cube that Mitsuba takes then; any other box without a volume is refused unless
//! the options state the placement.
//!
//! Mitsuba 3 has 32-bit floats alone; half floats and bytes, which stand for 0 to 1, are encodings of Mitsuba 0.6. That
//! version stretches the box from the centre of the first voxel to that of the last one, which the header does not
//! tell; the reader says so where the encoding does.
//!
//! Source: the description of the format in the documentation of Mitsuba 0.6 (section `gridvolume`), and files that
//! Mitsuba 3 writes.

use super::image::{About, Header, Image, Values};
use super::input::{self, Packing};
use super::options::Options;
use super::placement;
use super::stream::Binary;
use crate::error::{Error, Result};
use crate::formats::ending::ends_in;
use crate::formats::sample::{Endian, Sample};
use crate::math::Affine;
use glam::DVec3;
use std::path::Path;

/// Bytes before the values.
pub(crate) const HEADER: usize = 48;
/// First bytes of a file, the last of which is the version.
pub(crate) const MAGIC: [u8; 4] = *b"VOL\x03";
/// Encoding of 32-bit floats.
pub(crate) const FLOAT: i32 = 1;

/// True if a file begins as such grids do. Other versions are told by their names as well, so that the reader can say
/// what is wrong with them.
pub(crate) fn is_vol(path: &Path, start: &[u8]) -> bool {
    start.starts_with(&MAGIC) || start.starts_with(&MAGIC[..3]) && ends_in(path, "vol")
}

fn wrong(what: impl Into<String>) -> Error {
    Error::invalid(what).hint("correct the header, or write the grid again where it was made")
}

/// Box of a grid, of which every voxel takes an equal part.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct GridBox {
    /// Smallest world coordinates along x, y and z.
    pub min: [f32; 3],
    /// Largest world coordinates.
    pub max: [f32; 3],
}

impl GridBox {
    /// Map from indices to the world of a grid with this number of voxels along x, y and z.
    ///
    /// # Errors
    /// If the box has no volume, or a coordinate is not finite.
    pub(crate) fn index_to_world(&self, size: [usize; 3]) -> Result<Affine> {
        let [min, max] = [self.min, self.max].map(|corner| DVec3::from_array(corner.map(f64::from)));
        let edges = max - min;
        if !(edges.is_finite() && edges.min_element() > 0.0) {
            let ([x0, y0, z0], [x1, y1, z1]) = (self.min, self.max);
            return Err(Error::invalid(format!(
                "the box of the grid reaches from ({x0}, {y0}, {z0}) to ({x1}, {y1}, {z1}); finite numbers that \
                 ascend along each axis are expected"
            ))
            .hint("give ⟨voxel_size⟩ or ⟨spacing⟩, and ⟨origin⟩, in its place, or correct the box in the header"));
        }
        let voxel = edges / DVec3::from_array(size.map(|n| n as f64));
        placement::affine([DVec3::X * voxel.x, DVec3::Y * voxel.y, DVec3::Z * voxel.z], min + 0.5 * voxel)
    }
}

/// Type of the values of an encoding.
fn sample(encoding: i32) -> Result<Sample> {
    match encoding {
        FLOAT => Ok(Sample::F32),
        2 => Ok(Sample::F16),
        3 => Ok(Sample::U8),
        4 => Err(Error::unsupported("quantized directions (encoding 4) are not read; encodings 1, 2 and 3 are")
            .hint("write the directions as vectors of 32-bit floats where they were made")),
        _ => Err(Error::unsupported(format!(
            "encoding {encoding} is not known; 32-bit floats (1), half floats (2) and bytes (3) are read"
        ))
        .hint("write the grid with 32-bit floats where it was made, as mitsuba.VolumeGrid does")),
    }
}

/// The header's fields.
struct Fields {
    encoding: i32,
    size: [i32; 3],
    channels: i32,
    bounds: GridBox,
}

impl Fields {
    /// Reads the fields of a file that begins with `start`.
    fn new(start: &[u8]) -> Result<Self> {
        if let Some(version) = start.get(3).filter(|version| **version != MAGIC[3]) {
            return Err(Error::unsupported(format!("version {version} of the format; version 3 is read"))
                .hint("write the grid by a current Mitsuba; if it is no grid of Mitsuba, give it another name"));
        }
        let Some(bytes) = start.first_chunk::<HEADER>() else {
            return Err(wrong(format!("the file has {} bytes; the header alone has {HEADER}", start.len())));
        };
        let four = |at: usize| -> [u8; 4] { std::array::from_fn(|i| bytes[at + i]) };
        let integer = |at: usize| i32::from_le_bytes(four(at));
        let reals = |at: usize| [0, 4, 8].map(|i| f32::from_le_bytes(four(at + i)));
        Ok(Self {
            encoding: integer(4),
            size: [8, 12, 16].map(integer),
            channels: integer(20),
            bounds: GridBox { min: reals(24), max: reals(36) },
        })
    }

    /// Map from indices to the world: what the caller states, else what the box says.
    fn placed(&self, size: [usize; 3], options: &Options, notes: &mut Vec<String>) -> Result<Affine> {
        if let Some(map) = options.placement()? {
            return Ok(map);
        }
        let stated = self.bounds != GridBox { min: [0.0; 3], max: [0.0; 3] };
        let bounds = if stated { self.bounds } else { GridBox { min: [0.0; 3], max: [1.0; 3] } };
        if !stated {
            notes.push("the box of the grid is all zero; the unit cube is taken, as Mitsuba does without a box".into());
        }
        if stated && self.encoding != FLOAT {
            notes.push(
                "the faces of the box are taken for those of the voxels, as in Mitsuba 3; in Mitsuba 0.6, whose \
                 encoding this is, the centres of the outermost voxels lie on them"
                    .into(),
            );
        }
        options.moved(&bounds.index_to_world(size)?)
    }
}

/// Opens a grid.
///
/// # Errors
/// If the file cannot be read, its header is damaged, it is shorter than its header says, or it has an encoding or a
/// number of channels that is not read.
pub(crate) fn open(path: &Path, options: &Options) -> Result<Image> {
    let fields = Fields::new(&input::start(path, HEADER as u64)?)?;
    let sample = sample(fields.encoding)?;
    let size = fields.size.map(|n| usize::try_from(n).unwrap_or(0));
    if size.contains(&0) {
        let [x, y, z] = fields.size;
        return Err(wrong(format!("a grid of {x} x {y} x {z} voxels")));
    }
    let components = match fields.channels {
        1 => 1,
        3 => 3,
        other => {
            return Err(Error::unsupported(format!("{other} channels; 1 or 3 are read"))
                .hint("write one channel, or a vector of three, to a file of its own first"));
        }
    };
    input::has(path, HEADER as u64, input::byte_count(size, components, sample.bytes()))?;
    let mut notes = Vec::new();
    let rescale = (sample == Sample::U8).then_some((1.0 / 255.0, 0.0));
    if rescale.is_some() {
        notes.push("integers from 0 to 255 stand for 0 to 1 in this format, and are read as such".into());
    }
    let index_to_world = fields.placed(size, options, &mut notes)?;
    let reader = input::values(path, HEADER as u64, Packing::Plain, 0)?;
    let about = About { sample: Some(sample), rescale, ..About::default() };
    let header = Header { name: None, size, components, values: Values::Real, index_to_world, about, notes };
    Ok(Image { header, slices: Box::new(Binary::new(reader, sample, Endian::Little).scaled(rescale)) })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    /// A grid of 2 x 1 x 1 voxels of an encoding and number of channels, in a box.
    fn grid(encoding: i32, channels: i32, bounds: [f32; 6], values: &[u8]) -> Vec<u8> {
        let mut file = MAGIC.to_vec();
        [encoding, 2, 1, 1, channels].iter().for_each(|n| file.extend(n.to_le_bytes()));
        bounds.iter().for_each(|v| file.extend(v.to_le_bytes()));
        file.extend(values);
        file
    }

    fn read(bytes: &[u8], options: &Options) -> Result<(Header, Vec<f64>)> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), bytes).unwrap();
        let mut image = open(file.path(), options)?;
        let mut values = vec![0.0; image.header.slice_len().unwrap()];
        image.slices.next_slice(&mut values)?;
        Ok((image.header, values))
    }

    const CUBE: [f32; 6] = [0.0, 0.0, 0.0, 1.0, 1.0, 1.0];

    #[test]
    fn encodings_are_read() {
        let floats: Vec<u8> = [-1.5_f32, 7.0].iter().flat_map(|v| v.to_le_bytes()).collect();
        assert_eq!(read(&grid(1, 1, CUBE, &floats), &Options::default()).unwrap().1, [-1.5, 7.0]);
        // 1 and -2 as half floats.
        let (header, values) = read(&grid(2, 1, CUBE, &[0, 0x3c, 0, 0xc0]), &Options::default()).unwrap();
        assert_eq!((values, header.notes.len()), (vec![1.0, -2.0], 1));
        let (header, values) = read(&grid(3, 3, CUBE, &[0, 51, 255, 255, 0, 102]), &Options::default()).unwrap();
        // 1/255 and the product round once each: to two units in the last place below 1.
        let expected = [0.0, 0.2, 1.0, 1.0, 0.0, 0.4];
        assert!(values.iter().zip(expected).all(|(v, e)| (v - e).abs() <= f64::EPSILON), "{values:?}");
        assert_eq!((values[2], header.components, header.notes.len()), (1.0, 3, 2));
    }

    #[test]
    fn boxes_place_voxels_unless_the_options_do() {
        let floats = [0; 8];
        let bounds = [-1.0, 2.0, 3.0, 3.0, 2.5, 7.0];
        let (header, _) = read(&grid(1, 1, bounds, &floats), &Options::default()).unwrap();
        assert_eq!(header.index_to_world.voxel_size(), DVec3::new(2.0, 0.5, 4.0));
        assert_eq!(header.index_to_world.to_world(DVec3::ZERO), DVec3::new(0.0, 2.25, 5.0));
        let moved = Options { origin: Some(DVec3::ONE), ..Options::default() };
        let (header, _) = read(&grid(1, 1, bounds, &floats), &moved).unwrap();
        assert_eq!(header.index_to_world.to_world(DVec3::X), DVec3::new(3.0, 1.0, 1.0));
        let (header, _) = read(&grid(1, 1, [0.0; 6], &floats), &Options::default()).unwrap();
        assert_eq!(header.index_to_world.to_world(DVec3::ZERO), DVec3::new(0.25, 0.5, 0.5));
        assert!(header.notes[0].contains("unit cube"), "{:?}", header.notes);
        for (at, value) in [(3, f32::NAN), (0, f32::NEG_INFINITY), (4, 2.0), (5, 2.0)] {
            let mut spoiled = bounds;
            spoiled[at] = value;
            let spoiled = grid(1, 1, spoiled, &floats);
            let error = read(&spoiled, &Options::default()).unwrap_err();
            assert!(error.to_string().contains("the box of the grid") && error.remedy().is_some(), "{error}");
            let spaced = Options { spacing: Some(DVec3::ONE), ..Options::default() };
            assert_eq!(read(&spoiled, &spaced).unwrap().0.index_to_world.voxel_size(), DVec3::ONE);
        }
    }

    #[test]
    fn damage_is_named() {
        let whole = grid(1, 1, CUBE, &[0; 8]);
        for n in 0..whole.len() {
            assert!(read(&whole[..n], &Options::default()).unwrap_err().remedy().is_some(), "{n}");
        }
        let with = |at: usize, value: i32| {
            let mut bytes = whole.clone();
            bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
            read(&bytes, &Options::default()).unwrap_err().to_string()
        };
        let cases = [
            (0, i32::from_le_bytes(*b"VOL\x02"), "version 2"),
            (4, 4, "quantized directions"),
            (4, 9, "encoding 9"),
            (8, -1, "-1 x 1 x 1"),
            (12, 0, "2 x 0 x 1"),
            (16, i32::MAX, "56 bytes"),
            (20, 6, "6 channels"),
        ];
        for (at, value, words) in cases {
            let error = with(at, value);
            assert!(error.contains(words), "{error} lacks {words}");
        }
    }
}
