//! Volumes in NumPy's arrays: `.npy`, and each array of an `.npz`.
//!
//! `array[x, y, z]` or `array[z, y, x]`, with a last axis of three components for vectors. Arrays whose x axis is the
//! fastest pass slice by slice; of others all bytes are held.

use super::image::{About, Header, Image, Slices, Values};
use super::input::{self, Packing};
use super::options::{Axes, Options};
use super::stream::{Binary, failed};
use super::text::excerpt;
use crate::error::{Code, Error, Result};
use crate::formats;
use crate::formats::limits::Limits;
use crate::formats::npy;
use crate::formats::sample::{Endian, Sample};
use flate2::Crc;
use flate2::read::DeflateDecoder;
use std::io::{BufReader, ErrorKind, Read, Seek, SeekFrom};
use std::path::Path;
use zip::{CompressionMethod, ZipArchive};

/// Largest number of arrays of an archive.
const MOST_ARRAYS: usize = 256;

/// Says whether a file begins as an archive of arrays: a ZIP whose first member is one.
pub(crate) fn is_archive(start: &[u8]) -> bool {
    let length = |at: usize| start.get(at..at + 2).map(|b| usize::from(b[0]) | usize::from(b[1]) << 8);
    let name = length(26).and_then(|n| start.get(30..30 + n));
    start.starts_with(b"PK\x03\x04") && name.is_some_and(|n| n.ends_with(b".npy"))
}

/// Opens an array.
///
/// # Errors
/// If it is damaged, no volume, of another type than numbers, its voxels' size is not stated, or it does not fit.
pub(crate) fn open(path: &Path, options: &Options, limits: Limits) -> Result<Vec<Image>> {
    let mut file = formats::input::open(path)?;
    let length = file.metadata().map_err(|e| Error::io(path, e))?.len();
    let (header, start) = npy::Header::read(&mut file)?;
    let count = header.count()?;
    let expected = (count as u64).checked_mul(header.sample.bytes() as u64).and_then(|n| n.checked_add(start));
    if expected != Some(length) {
        return Err(Error::invalid(format!(
            "{length} bytes, and an array of shape {:?} of {} has {}",
            header.shape,
            header.sample.name(),
            expected.map_or_else(|| "more than 2⁶⁴".to_owned(), |n| n.to_string())
        ))
        .hint("the file is damaged or incomplete: write it again with numpy.save"));
    }
    let reader = input::values(path, start, Packing::Plain, 0)?;
    image(&header, reader, None, options, limits).map(|image| vec![image])
}

/// Size and steps of an array's axes, in numbers.
struct Layout {
    size: [usize; 3],
    components: usize,
    /// Steps along x, y, z and from one component to the next.
    strides: [usize; 4],
}

impl Layout {
    fn of(header: &npy::Header, axes: Axes) -> Option<Self> {
        let (first, components) = match header.shape[..] {
            [a, b, c] => ([a, b, c], 1),
            [a, b, c, 3] => ([a, b, c], 3),
            _ => return None,
        };
        let [a, b, c] = first;
        let steps =
            if header.fortran { [1, a, a * b, a * b * c] } else { [b * c * components, c * components, components, 1] };
        let turned = |list: [usize; 3]| if axes == Axes::Xyz { list } else { [list[2], list[1], list[0]] };
        let [x, y, z] = turned([steps[0], steps[1], steps[2]]);
        Some(Self { size: turned(first), components, strides: [x, y, z, steps[3]] })
    }

    /// True if the numbers lie in the order in which slices have them.
    fn is_in_order(&self) -> bool {
        let [x, y, _] = self.size;
        let n = self.components;
        self.strides == [n, n * x, n * x * y, 1] || (n == 1 && self.strides[..3] == [1, x, x * y])
    }
}

fn image(
    header: &npy::Header,
    reader: Box<dyn Read>,
    name: Option<String>,
    options: &Options,
    limits: Limits,
) -> Result<Image> {
    let layout = Layout::of(header, options.axes).ok_or_else(|| {
        Error::invalid(format!("an array of shape {:?} is no volume", header.shape))
            .hint("[x, y, z] makes a grid of scalars, [x, y, z, 3] one of vectors; ⟨axes=zyx⟩ reads [z, y, x]")
    })?;
    let index_to_world = options.placement()?.ok_or_else(|| {
        Error::invalid("an array does not say how large its voxels are")
            .hint("give ⟨voxel_size⟩, and ⟨origin⟩ if voxel [0, 0, 0] is not at the world's origin")
    })?;
    let binary = Binary::new(reader, header.sample, header.endian);
    let slices: Box<dyn Slices> = if layout.is_in_order() {
        Box::new(binary)
    } else {
        Box::new(Strided::new(binary.into_reader(), header, &layout, limits)?)
    };
    let values = if header.sample.is_integer() { Values::Integer } else { Values::Real };
    let about = About { sample: Some(header.sample), ..About::default() };
    let (size, components, notes) = (layout.size, layout.components, Vec::new());
    let header = Header { name, size, components, values, index_to_world, about, notes };
    Ok(Image { header, slices })
}

/// Slices out of an array that is held whole, from the first slice on to the last.
struct Strided {
    /// The array before it is held.
    reader: Option<Box<dyn Read>>,
    /// Number of the array's bytes.
    length: u64,
    bytes: Vec<u8>,
    sample: Sample,
    endian: Endian,
    size: [usize; 3],
    components: usize,
    strides: [usize; 4],
    z: usize,
}

impl Strided {
    /// Prepares to read the array, of which nothing is held yet: archives have several.
    fn new(reader: Box<dyn Read>, header: &npy::Header, layout: &Layout, limits: Limits) -> Result<Self> {
        let needed = (header.count()? as u64).saturating_mul(header.sample.bytes() as u64);
        if needed > limits.max_memory {
            let what =
                format!("an array of shape {:?} takes {needed} bytes, {} are allowed", header.shape, limits.max_memory);
            return Err(Error::unsupported(what).coded(Code::MemoryLimit).hint(
                "raise ⟨max_memory⟩ if the file is to be trusted; an array whose x axis is the fastest passes in \
                       slices",
            ));
        }
        let Layout { size, components, strides } = *layout;
        let (sample, endian) = (header.sample, header.endian);
        let (reader, bytes) = (Some(reader), Vec::new());
        Ok(Self { reader, length: needed, bytes, sample, endian, size, components, strides, z: 0 })
    }

    /// Reads the array, unless it is held.
    fn hold(&mut self) -> Result<()> {
        let Some(reader) = self.reader.take() else { return Ok(()) };
        // The vector grows with what is there: a damaged archive has less than it says.
        reader.take(self.length).read_to_end(&mut self.bytes).map_err(|e| failed(e, 0))?;
        if self.bytes.len() as u64 != self.length {
            let done = self.bytes.len() / self.sample.bytes();
            return Err(failed(ErrorKind::UnexpectedEof.into(), done as u64));
        }
        Ok(())
    }
}

impl Slices for Strided {
    fn next_slice(&mut self, values: &mut [f64]) -> Result<()> {
        self.hold()?;
        let bytes = self.sample.bytes();
        let mut number = Vec::with_capacity(1);
        let [sx, sy, sz, sc] = self.strides;
        for (i, value) in values.iter_mut().enumerate() {
            let (c, voxel) = (i % self.components, i / self.components);
            let (x, y) = (voxel % self.size[0], voxel / self.size[0]);
            let at = (x * sx + y * sy + self.z * sz + c * sc) * bytes;
            number.clear();
            self.sample.decode(self.endian, self.bytes.get(at..at + bytes).unwrap_or_default(), &mut number);
            *value = number.first().copied().unwrap_or(f64::NAN);
        }
        self.z += 1;
        Ok(())
    }

    fn working_bytes(&self) -> u64 {
        self.length
    }
}

/// Opens the volumes of an archive; other arrays are left out with a note.
///
/// # Errors
/// If the archive is damaged, no array in it is a volume, or one that is wanted is damaged.
pub(crate) fn open_archive(path: &Path, options: &Options, limits: Limits) -> Result<Vec<Image>> {
    let damaged = |e: zip::result::ZipError| {
        Error::invalid(format!("the archive is damaged: {e}")).hint("copy the file, or write it again with numpy.savez")
    };
    let mut archive = ZipArchive::new(BufReader::new(formats::input::open(path)?)).map_err(damaged)?;
    if archive.len() > MOST_ARRAYS {
        return Err(Error::unsupported(format!(
            "{} arrays in one archive, at most {MOST_ARRAYS} are read",
            archive.len()
        ))
        .hint("write those that are wanted to a file of their own"));
    }
    let (mut images, mut names, mut left_out) = (Vec::new(), Vec::new(), Vec::new());
    for index in 0..archive.len() {
        let member = archive.by_index_raw(index).map_err(damaged)?;
        let name = member.name().trim_end_matches(".npy").to_owned();
        let (method, start, length) = (member.compression(), member.data_start(), member.compressed_size());
        let (size, checksum) = (member.size(), member.crc32());
        drop(member);
        if !options.wants(&name) {
            names.push(name);
            continue;
        }
        let place = |e: Error| e.part(format!("array '{}'", excerpt(&name)));
        let start = start.ok_or_else(|| place(Error::invalid("its place is unknown").hint("copy the file again")))?;
        let packed = unpacked(path, start, length, method).map_err(place)?;
        let mut reader: Box<dyn Read> = Box::new(Checked { reader: packed, sum: Crc::new(), left: size, checksum });
        let (header, begin) = npy::Header::read(&mut reader).map_err(place)?;
        let count = header.count().map_err(place)?;
        if options.array.is_none() && Layout::of(&header, options.axes).is_none() {
            left_out.push(format!(
                "array '{}' of shape {:?} is no volume and was left out",
                excerpt(&name),
                header.shape
            ));
        } else {
            let expected = (count as u64).checked_mul(header.sample.bytes() as u64).and_then(|n| n.checked_add(begin));
            // What is read ends with the member's last byte, so that its checksum is compared.
            if expected != Some(size) {
                let what = format!("{size} bytes, which are not those of an array of shape {:?}", header.shape);
                return Err(place(Error::invalid(what).hint("the file is damaged: copy it, or write it, again")));
            }
            images.push(image(&header, reader, Some(name.clone()), options, limits).map_err(place)?);
        }
        names.push(name);
    }
    match images.first_mut() {
        Some(first) => first.header.notes.extend(left_out),
        None => return Err(options.no_array(&names)),
    }
    Ok(images)
}

/// Content of a member of an archive, which is compared with its checksum when its last byte is read.
struct Checked {
    reader: Box<dyn Read>,
    sum: Crc,
    /// Bytes that are not read yet.
    left: u64,
    checksum: u32,
}

impl Read for Checked {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        let most = usize::try_from(self.left).unwrap_or(usize::MAX).min(out.len());
        let n = self.reader.read(&mut out[..most])?;
        self.sum.update(&out[..n]);
        self.left -= n as u64;
        if n > 0 && self.left == 0 && self.sum.sum() != self.checksum {
            let what = "the bytes disagree with their checksum in the archive";
            return Err(std::io::Error::new(ErrorKind::InvalidData, what));
        }
        Ok(n)
    }
}

/// Content of a member of an archive.
fn unpacked(path: &Path, start: u64, length: u64, method: CompressionMethod) -> Result<Box<dyn Read>> {
    let mut file = formats::input::open(path)?;
    file.seek(SeekFrom::Start(start)).map_err(|e| Error::io(path, e))?;
    let packed = BufReader::new(file.take(length));
    match method {
        CompressionMethod::Stored => Ok(Box::new(packed)),
        CompressionMethod::Deflated => Ok(Box::new(DeflateDecoder::new(packed))),
        other => Err(Error::unsupported(format!("the archive is packed with {other}"))
            .hint("write it again with numpy.savez or numpy.savez_compressed")),
    }
}
