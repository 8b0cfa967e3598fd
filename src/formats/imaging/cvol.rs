//! Volumes of the DiffDVR and fV-SRN renderers (`.cvol`), plain or packed by LZ4.
//!
//! A file has one unnamed volume (`cvol`), or several named features over one box (`CVOL`), of bytes, 16-bit integers
//! or floats. As these renderers do, integers are scaled to 0..1 (they are densities, and no labels), and the box is
//! centred on the world's origin with voxels that fill it.
//!
//! Source: the description of the format in fV-SRN's `volume.h` (Weiss et al.).

use super::image::{About, Header, Image, Slices, Values};
use super::input;
use super::options::Options;
use super::placement;
use super::stream::failed;
use crate::error::{Error, Result};
use crate::formats::input as files;
use crate::formats::sample::{Endian, Sample};
use glam::DVec3;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;

/// Unpacked bytes of a chunk of LZ4, and of what later chunks refer back to.
const CHUNK: usize = 64 << 10;
/// Most features of a file, and most bytes of a name.
const MOST: u32 = 4096;

fn wrong(what: impl Into<String>) -> Error {
    Error::invalid(what).hint("the file is damaged or incomplete: copy it, or write it, again")
}

/// True if a file begins as such volumes do.
pub(crate) fn is_cvol(start: &[u8]) -> bool {
    start.starts_with(b"cvol") || start.starts_with(b"CVOL") && start.get(4..8) == Some(&[1, 0, 0, 0])
}

/// A feature of the file.
struct Feature {
    name: Option<String>,
    size: [usize; 3],
    components: usize,
    sample: Sample,
}

impl Feature {
    fn new(name: Option<String>, size: [u64; 3], components: u32, kind: u32) -> Result<Self> {
        let sample = match kind {
            0 => Sample::U8,
            1 => Sample::U16,
            2 => Sample::F32,
            other => return Err(wrong(format!("values of type {other}; 0, 1 and 2 are expected"))),
        };
        let sizes = size.map(|n| usize::try_from(n).unwrap_or(0));
        if sizes.contains(&0) || components == 0 {
            return Err(wrong(format!("a volume of {size:?} voxels of {components} values")));
        }
        let feature = Self { name, size: sizes, components: components as usize, sample };
        feature.bytes().ok_or_else(|| wrong(format!("a volume of {size:?} voxels is too large to count")))?;
        Ok(feature)
    }

    fn bytes(&self) -> Option<u64> {
        input::byte_count(self.size, self.components, self.sample.bytes())
    }

    /// Note that integers are no labels or counts here.
    fn note(&self) -> Option<String> {
        let most = self.sample.is_integer().then(|| 1.0 / self.scale())?;
        Some(format!("integers from 0 to {most:.0} stand for 0 to 1 in this format, and are read as such"))
    }

    /// Factor of the stored numbers.
    fn scale(&self) -> f64 {
        match self.sample {
            Sample::U8 => 1.0 / 255.0,
            Sample::U16 => 1.0 / 65535.0,
            _ => 1.0,
        }
    }
}

/// Content behind the headers: plain, or chunks of LZ4 that each begin with their length and refer back to the bytes
/// before, across features.
enum Content {
    Plain(BufReader<std::fs::File>),
    Lz4 { file: BufReader<std::fs::File>, window: Vec<u8>, unpacked: Vec<u8>, at: usize },
}

impl Content {
    fn read_exact(&mut self, out: &mut [u8], done: u64) -> Result<()> {
        match self {
            Self::Plain(file) => file.read_exact(out).map_err(|e| failed(e, done)),
            Self::Lz4 { .. } => {
                let mut filled = 0;
                while filled < out.len() {
                    filled += self.unpacked(&mut out[filled..])?;
                }
                Ok(())
            }
        }
    }

    /// Copies what is unpacked, after the next chunk was unpacked if all was read.
    fn unpacked(&mut self, out: &mut [u8]) -> Result<usize> {
        let Self::Lz4 { file, window, unpacked, at } = self else { return Ok(0) };
        if *at == unpacked.len() {
            let keep = window.len().saturating_sub(CHUNK - unpacked.len().min(CHUNK));
            window.drain(..keep.min(window.len()));
            window.extend_from_slice(unpacked);
            *unpacked = chunk(file, window)?;
            *at = 0;
        }
        let count = out.len().min(unpacked.len() - *at);
        out[..count].copy_from_slice(&unpacked[*at..*at + count]);
        *at += count;
        Ok(count)
    }

    /// Skips bytes.
    fn skip(&mut self, mut count: u64) -> Result<()> {
        if let Self::Plain(file) = self {
            let forward = i64::try_from(count).map_err(|_| wrong("a feature too large to skip"))?;
            return file.seek_relative(forward).map_err(Error::system);
        }
        let mut sink = vec![0; CHUNK];
        while count > 0 {
            let part = count.min(CHUNK as u64) as usize;
            self.read_exact(&mut sink[..part], 0)?;
            count -= part as u64;
        }
        Ok(())
    }

    /// Reads bytes that are never packed: the headers of features.
    fn plain(&mut self, out: &mut [u8]) -> Result<()> {
        let (Self::Plain(file) | Self::Lz4 { file, .. }) = self;
        file.read_exact(out).map_err(|e| wrong(format!("the header of a feature cannot be read ({e})")))
    }
}

/// Unpacks the next chunk, which may refer back to `window`.
fn chunk(file: &mut BufReader<std::fs::File>, window: &[u8]) -> Result<Vec<u8>> {
    let mut length = [0; 4];
    file.read_exact(&mut length).map_err(|_| wrong("the packed values end before the last slice"))?;
    let length = u32::from_le_bytes(length) as usize;
    // LZ4 makes what cannot be packed larger by 1/255 and 16 bytes at most.
    if length == 0 || length > CHUNK + CHUNK / 255 + 16 {
        return Err(wrong(format!("a packed part of {length} bytes; 1 to {CHUNK} are expected")));
    }
    let mut packed = vec![0; length];
    file.read_exact(&mut packed).map_err(|_| wrong("the packed values end before the last slice"))?;
    let mut out = vec![0; CHUNK];
    let count = lz4_flex::block::decompress_into_with_dict(&packed, &mut out, window)
        .map_err(|e| wrong(format!("the packed values are damaged: {e}")))?;
    if count == 0 {
        return Err(wrong("a packed part without values"));
    }
    out.truncate(count);
    Ok(out)
}

/// Slices of a feature.
struct Voxels {
    content: Content,
    feature: Feature,
    bytes: Vec<u8>,
    done: u64,
}

impl Slices for Voxels {
    fn next_slice(&mut self, values: &mut [f64]) -> Result<()> {
        let size = self.feature.sample.bytes();
        let mut decoded = Vec::with_capacity(CHUNK);
        for part in values.chunks_mut(CHUNK) {
            self.bytes.resize(part.len() * size, 0);
            self.content.read_exact(&mut self.bytes, self.done)?;
            decoded.clear();
            self.feature.sample.decode(Endian::Little, &self.bytes, &mut decoded);
            let scale = self.feature.scale();
            part.iter_mut().zip(&decoded).for_each(|(to, from)| *to = from * scale);
            self.done += part.len() as u64;
        }
        Ok(())
    }
}

/// Fields of a header, one after another.
struct Fields<'a>(&'a [u8]);

impl Fields<'_> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N]> {
        let (field, rest) = self.0.split_first_chunk::<N>().ok_or_else(|| wrong("the header ends early"))?;
        self.0 = rest;
        Ok(*field)
    }
    fn u32(&mut self) -> Result<u32> {
        self.take().map(u32::from_le_bytes)
    }
    fn u64s(&mut self) -> Result<[u64; 3]> {
        Ok([
            self.take().map(u64::from_le_bytes)?,
            self.take().map(u64::from_le_bytes)?,
            self.take().map(u64::from_le_bytes)?,
        ])
    }
    fn f64s(&mut self) -> Result<DVec3> {
        Ok(DVec3::new(
            f64::from_le_bytes(self.take()?),
            f64::from_le_bytes(self.take()?),
            f64::from_le_bytes(self.take()?),
        ))
    }
    fn f32s(&mut self) -> Result<DVec3> {
        let mut one = || self.take().map(f32::from_le_bytes).map(f64::from);
        Ok(DVec3::new(one()?, one()?, one()?))
    }
}

fn content(path: &Path, from: u64, packed: bool) -> Result<Content> {
    let mut file = files::open(path)?;
    file.seek(SeekFrom::Start(from)).map_err(Error::system)?;
    let file = BufReader::new(file);
    Ok(if packed {
        Content::Lz4 { file, window: Vec::new(), unpacked: Vec::new(), at: 0 }
    } else {
        Content::Plain(file)
    })
}

/// Image of a feature whose box has these edges; `content` stands at its first value.
fn image(content: Content, feature: Feature, edges: DVec3) -> Result<Image> {
    placement::edges("the edges of the volume's box", edges)?;
    let counts = DVec3::from_array(feature.size.map(|n| n as f64));
    let voxel = edges / counts;
    let columns = [DVec3::X * voxel.x, DVec3::Y * voxel.y, DVec3::Z * voxel.z];
    let index_to_world = placement::affine(columns, 0.5 * (voxel - edges))?;
    let header = Header {
        name: feature.name.clone(),
        size: feature.size,
        components: feature.components,
        values: Values::Real,
        index_to_world,
        about: About::default(),
        notes: feature.note().into_iter().collect(),
    };
    Ok(Image { header, slices: Box::new(Voxels { content, feature, bytes: Vec::new(), done: 0 }) })
}

/// Opens a file to an image for each of its features that is wanted and has one value or three per voxel.
///
/// # Errors
/// If the file cannot be read, its header is damaged, or no feature is wanted.
pub(crate) fn open(path: &Path, options: &Options) -> Result<Vec<Image>> {
    let start = input::start(path, 64)?;
    if start.starts_with(b"cvol") {
        let mut fields = Fields(&start[4..]);
        let (size, voxel, kind) = (fields.u64s()?, fields.f64s()?, fields.u32()?);
        let packed = fields.take::<1>()?[0] != 0;
        let feature = Feature::new(None, size, 1, kind)?;
        if !packed {
            input::has(path, 64, feature.bytes())?;
        }
        let edges = voxel * DVec3::from_array(feature.size.map(|n| n as f64));
        return Ok(vec![image(content(path, 64, packed)?, feature, edges)?]);
    }
    let mut fields = Fields(start.get(4..).unwrap_or_default());
    let (version, edges, count, flags) = (fields.u32()?, fields.f32s()?, fields.u32()?, fields.u32()?);
    if version != 1 || count > MOST {
        return Err(wrong(format!("version {version} with {count} features; version 1 is read")));
    }
    features(path, options, edges, count, flags & 1 == 1)
}

/// Images of the features of a file of several.
fn features(path: &Path, options: &Options, edges: DVec3, count: u32, packed: bool) -> Result<Vec<Image>> {
    let (mut images, mut names) = (Vec::new(), Vec::new());
    // Each image reads on its own from where its values begin, for which packed ones before have to be unpacked.
    for wanted in 0..count {
        let mut content = content(path, 32, packed)?;
        for number in 0..=wanted {
            let feature = feature(&mut content)?;
            if number < wanted {
                content.skip(feature.bytes().unwrap_or(u64::MAX))?;
                continue;
            }
            if let Content::Plain(file) = &mut content {
                input::has(path, file.stream_position().map_err(Error::system)?, feature.bytes())?;
            }
            let name = feature.name.clone().unwrap_or_default();
            if matches!(feature.components, 1 | 3) {
                names.push(name.clone());
                if options.wants(&name) {
                    images.push(image(content, feature, edges)?);
                }
            }
            break;
        }
    }
    if images.is_empty() { Err(options.no_array(&names)) } else { Ok(images) }
}

/// Reads the header of a feature.
fn feature(content: &mut Content) -> Result<Feature> {
    let mut length = [0; 4];
    content.plain(&mut length)?;
    let length = u32::from_le_bytes(length);
    if length > MOST {
        return Err(wrong(format!("the name of a feature has {length} bytes")));
    }
    let mut name = vec![0; length as usize];
    content.plain(&mut name)?;
    let mut rest = [0; 32];
    content.plain(&mut rest)?;
    let mut fields = Fields(&rest);
    let (size, components, kind) = (fields.u64s()?, fields.u32()?, fields.u32()?);
    Feature::new(Some(String::from_utf8_lossy(&name).into_owned()), size, components, kind)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    /// Values as the authors' program packs them: chunks that refer back to the 64 KiB before.
    fn packed(bytes: &[u8], window: &mut Vec<u8>) -> Vec<u8> {
        let mut out = Vec::new();
        for chunk in bytes.chunks(CHUNK) {
            let block = lz4_flex::block::compress_with_dict(chunk, window);
            out.extend((block.len() as u32).to_le_bytes());
            out.extend(block);
            window.extend_from_slice(chunk);
            window.drain(..window.len().saturating_sub(CHUNK));
        }
        out
    }

    fn legacy(size: [u64; 3], kind: u32, bytes: &[u8], lz4: bool) -> Vec<u8> {
        let mut file = b"cvol".to_vec();
        size.iter().for_each(|n| file.extend(n.to_le_bytes()));
        [0.5_f64, 0.25, 2.0].iter().for_each(|v| file.extend(v.to_le_bytes()));
        file.extend(kind.to_le_bytes());
        file.extend([u8::from(lz4), 0, 0, 0, 0, 0, 0, 0]);
        file.extend(if lz4 { packed(bytes, &mut Vec::new()) } else { bytes.to_vec() });
        file
    }

    fn several(lz4: bool) -> Vec<u8> {
        let mut file = b"CVOL\x01\0\0\0".to_vec();
        [4.0_f32, 2.0, 1.0].iter().for_each(|v| file.extend(v.to_le_bytes()));
        file.extend(3_u32.to_le_bytes());
        file.extend(u32::from(lz4).to_le_bytes());
        file.extend([0; 4]);
        let mut window = Vec::new();
        for (name, components, kind) in [("density", 1_u32, 0_u32), ("velocity", 3, 2), ("color", 4, 0)] {
            file.extend((name.len() as u32).to_le_bytes());
            file.extend(name.as_bytes());
            [2_u64, 2, 2].iter().for_each(|n| file.extend(n.to_le_bytes()));
            file.extend(components.to_le_bytes());
            file.extend(kind.to_le_bytes());
            let count = 8 * components as usize;
            let bytes: Vec<u8> = match kind {
                0 => (0..count).map(|i| i as u8 * 5).collect(),
                _ => (0..count).flat_map(|i| (i as f32 / 2.0).to_le_bytes()).collect(),
            };
            file.extend(if lz4 { packed(&bytes, &mut window) } else { bytes });
        }
        file
    }

    fn read(bytes: &[u8], array: Option<&str>) -> Result<Vec<(Header, Vec<f64>)>> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), bytes).unwrap();
        let options = Options { array: array.map(str::to_owned), ..Options::default() };
        let mut all = Vec::new();
        for mut image in open(file.path(), &options)? {
            let mut values = Vec::new();
            let mut slice = vec![0.0; image.header.slice_len().unwrap_or(0).min(1 << 12)];
            for _ in 0..image.header.size[2].min(1 << 10) {
                image.slices.next_slice(&mut slice)?;
                values.extend_from_slice(&slice);
            }
            all.push((image.header, values));
        }
        Ok(all)
    }

    #[test]
    fn plain_and_packed_volumes_are_the_same() {
        // 240 000 bytes: four chunks, which refer back to each other.
        let values: Vec<f32> = (0..50 * 40 * 30).map(|i| (i / 7 % 100) as f32).collect();
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        for lz4 in [false, true] {
            let (header, found) = read(&legacy([50, 40, 30], 2, &bytes, lz4), None).unwrap().remove(0);
            assert_eq!(found, values.iter().map(|v| f64::from(*v)).collect::<Vec<_>>());
            assert_eq!(header.size, [50, 40, 30]);
            // The box is centred: half of 50, 40 and 30 voxels of these edges, less half a voxel.
            assert_eq!(header.index_to_world.to_world(DVec3::ZERO), DVec3::new(-12.25, -4.875, -29.0));
            assert_eq!(header.index_to_world.voxel_size(), DVec3::new(0.5, 0.25, 2.0));
        }
        let (_, found) = read(&legacy([2, 1, 1], 1, &[0xff, 0xff, 0, 0], false), None).unwrap().remove(0);
        assert_eq!(found, [1.0, 0.0]);
    }

    #[test]
    fn features_are_images_by_name() {
        for lz4 in [false, true] {
            let found = read(&several(lz4), None).unwrap();
            let names: Vec<_> = found.iter().map(|(h, _)| h.name.clone().unwrap()).collect();
            assert_eq!(names, ["density", "velocity"]);
            assert_eq!((found[0].1[7], found[1].1[23]), (35.0 / 255.0, 11.5));
            assert_eq!(found[1].0.index_to_world.to_world(DVec3::ONE), DVec3::new(1.0, 0.5, 0.25));
            assert_eq!(read(&several(lz4), Some("velocity")).unwrap().len(), 1);
            let error = read(&several(lz4), Some("color")).unwrap_err().to_string();
            assert!(error.contains("density, velocity"), "{error}");
        }
    }

    #[test]
    fn damage_is_named_and_never_panics() {
        for whole in
            [several(false), several(true), legacy([4, 2, 2], 0, &[9; 16], true), legacy([4, 2, 2], 0, &[9; 16], false)]
        {
            for n in 0..whole.len() - 1 {
                if let Err(error) = read(&whole[..n], None) {
                    assert!(error.remedy().is_some(), "{n}: {error}");
                }
            }
            assert!(read(&whole[..40], None).is_err() && read(&whole[..70], None).is_err());
            for at in 0..whole.len() {
                let mut damaged = whole.clone();
                damaged[at] = [0, 0x7f, 0xff][at % 3];
                if let Err(error) = read(&damaged, None) {
                    assert!(error.remedy().is_some(), "{at}: {error}");
                }
            }
        }
    }
}
