//! NIfTI-1 and NIfTI-2 in either byte order: `.nii`, `.nii.gz`, and pairs of `.hdr` and `.img`, packed or not.
//!
//! Layout and meaning of the fields: `nifti1.h` and `nifti2.h` of the NIfTI data format working group. The sform is
//! taken where there is one, else the qform, else the voxel sizes alone (methods 3, 2 and 1 of the standard).

use super::image::{About, Header, Image, Slices, Values};
use super::input::{self, Packing};
use super::options::Options;
use super::placement;
use super::stream::{Binary, Planar};
use crate::error::{Error, Result};
use crate::formats::sample::{Endian, Sample};
use crate::math::Affine;
use flate2::read::MultiGzDecoder;
use glam::{DMat3, DMat4, DQuat, DVec3, DVec4};
use std::ffi::OsStr;
use std::io::Read;
use std::path::{Path, PathBuf};

const AGAIN: &str = "the header is damaged: copy the file, or write it, again";
const CORRECT: &str = "correct the field in the file's header, or write the file again where it was made";

/// Bytes of a header, which are those of NIfTI-1 or of NIfTI-2.
struct Fields {
    bytes: Vec<u8>,
    endian: Endian,
    second: bool,
}

impl Fields {
    /// Recognizes a header by its size, in either byte order.
    fn of(bytes: &[u8]) -> Option<Self> {
        let size: [u8; 4] = bytes.first_chunk().copied()?;
        let found = [(348, false), (540, true)].into_iter().find_map(|(length, second): (u32, bool)| {
            let endian = match size {
                size if size == length.to_le_bytes() => Endian::Little,
                size if size == length.to_be_bytes() => Endian::Big,
                _ => return None,
            };
            (bytes.len() >= length as usize).then_some((length as usize, endian, second))
        });
        let (length, endian, second) = found?;
        Some(Self { bytes: bytes[..length].to_vec(), endian, second })
    }

    /// Text that says what the file is: `n+1` in one file, `ni1` in two, 2 for 1 in NIfTI-2.
    fn magic(&self) -> &[u8] {
        if self.second { &self.bytes[4..8] } else { &self.bytes[344..348] }
    }

    fn is_nifti(&self) -> bool {
        let expected: [&[u8]; 2] = if self.second { [b"n+2\0", b"ni2\0"] } else { [b"n+1\0", b"ni1\0"] };
        expected.contains(&self.magic())
    }

    /// Number at the place that it has in NIfTI-1, or at that in NIfTI-2, with the types it has there.
    fn number(&self, first: (usize, Sample), second: (usize, Sample)) -> f64 {
        let (at, sample) = if self.second { second } else { first };
        let mut out = Vec::with_capacity(1);
        sample.decode(self.endian, self.bytes.get(at..at + sample.bytes()).unwrap_or_default(), &mut out);
        out.first().copied().unwrap_or(0.0)
    }

    /// Number that is a float in NIfTI-1 and a double in NIfTI-2.
    fn real(&self, first: usize, second: usize) -> f64 {
        self.number((first, Sample::F32), (second, Sample::F64))
    }

    fn dim(&self, i: usize) -> f64 {
        self.number((40 + 2 * i, Sample::I16), (16 + 8 * i, Sample::I64))
    }

    fn pixdim(&self, i: usize) -> f64 {
        self.real(76 + 4 * i, 104 + 8 * i)
    }

    /// Unit of length, where it is stated and no millimetre. The upper bits are the unit of time.
    fn unit(&self) -> Option<&'static str> {
        match self.number((123, Sample::U8), (500, Sample::I32)) as i64 & 7 {
            1 => Some("metre"),
            3 => Some("micrometre"),
            _ => None,
        }
    }
}

/// Says whether a file begins with a header that names NIfTI itself.
pub(crate) fn states_itself(start: &[u8]) -> bool {
    Fields::of(start).is_some_and(|fields| fields.is_nifti())
}

/// Says whether a file is NIfTI's by its first bytes, and for values without a header by the header beside them.
pub(crate) fn is_nifti(path: &Path, start: &[u8]) -> bool {
    if input::is_gzip(start) {
        let mut inside = Vec::new();
        // Only the beginning is there: the stream ends early, after the bytes that count.
        let _ = MultiGzDecoder::new(start).take(540).read_to_end(&mut inside);
        return Fields::of(&inside).is_some() || header_beside(path).is_some();
    }
    Fields::of(start).is_some() || header_beside(path).is_some()
}

/// Path with another ending before `.gz`, or without `.gz`; the first that exists.
fn sibling(path: &Path, ending: &str) -> Option<PathBuf> {
    let packed = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("gz"));
    let bare = if packed { path.with_extension("") } else { path.to_path_buf() };
    let upper = ending.to_ascii_uppercase();
    [ending.to_owned(), format!("{ending}.gz"), upper.clone(), format!("{upper}.GZ")]
        .iter()
        .map(|e| bare.with_extension(e))
        .find(|p| p.is_file())
}

/// Header of a file of values, whose name ends in `.img`.
fn header_beside(path: &Path) -> Option<PathBuf> {
    let name = path.file_name().and_then(OsStr::to_str)?.to_ascii_lowercase();
    if !(name.ends_with(".img") || name.ends_with(".img.gz")) {
        return None;
    }
    let header = sibling(path, "hdr")?;
    let fields = read_header(&header).ok()?;
    Fields::of(&fields.0).map(|_| header)
}

/// First 540 bytes of a header, unpacked, and whether it was packed.
fn read_header(path: &Path) -> Result<(Vec<u8>, bool)> {
    let packed = input::is_gzip(&input::start(path, 2)?);
    let packing = if packed { Packing::Gzip } else { Packing::Plain };
    let mut bytes = Vec::new();
    let read = input::values(path, 0, packing, 0)?.take(540).read_to_end(&mut bytes);
    match read {
        Ok(_) => Ok((bytes, packed)),
        Err(e) if packed => Err(super::stream::failed(e, 0)),
        Err(e) => Err(Error::io(path, e)),
    }
}

/// Opens a file, one of a pair, or its header.
///
/// # Errors
/// If it is no NIfTI, contradicts the format, or holds numbers of another kind than integers, reals and colors.
pub(crate) fn open(path: &Path, options: &Options) -> Result<Vec<Image>> {
    let header = header_beside(path).unwrap_or_else(|| path.to_path_buf());
    let (bytes, packed) = read_header(&header)?;
    let fields = Fields::of(&bytes).ok_or_else(|| Error::invalid("this is no header of NIfTI").hint(AGAIN))?;
    if !fields.is_nifti() {
        return Err(Error::unsupported("this is a header of Analyze 7.5, or a damaged one of NIfTI")
            .hint("Analyze files do not say which side is left: convert it to NIfTI with the program that made it")
            .at(&header));
    }
    let apart = fields.magic().starts_with(b"ni");
    let (data, packing) = if apart {
        let data = sibling(&header, "img").ok_or_else(|| {
            Error::invalid("the file with the values, whose name ends in .img, is not there")
                .hint("copy both files into one folder")
                .at(&header)
        })?;
        let packed = input::is_gzip(&input::start(&data, 2)?);
        (data, if packed { Packing::Gzip } else { Packing::Plain })
    } else {
        (header.clone(), if packed { Packing::Gzip } else { Packing::Plain })
    };
    image(&fields, &data, packing, options, apart).map(|image| vec![image]).map_err(|e| e.at(&header))
}

/// Type of the numbers, and how many belong together.
fn sample(code: i64) -> Result<(Sample, usize)> {
    let what = match code {
        2 => return Ok((Sample::U8, 1)),
        4 => return Ok((Sample::I16, 1)),
        8 => return Ok((Sample::I32, 1)),
        16 => return Ok((Sample::F32, 1)),
        64 => return Ok((Sample::F64, 1)),
        128 => return Ok((Sample::U8, 3)),
        256 => return Ok((Sample::I8, 1)),
        512 => return Ok((Sample::U16, 1)),
        768 => return Ok((Sample::U32, 1)),
        1024 => return Ok((Sample::I64, 1)),
        1280 => return Ok((Sample::U64, 1)),
        1 => "bits",
        32 | 1792 | 2048 => "complex numbers",
        1536 => "numbers of 128 bits",
        2304 => "colors with alpha",
        _ => return Err(Error::invalid(format!("data type {code} is none of NIfTI's")).hint(AGAIN)),
    };
    Err(Error::unsupported(format!("the values are {what}; integers, reals and RGB colors are read"))
        .hint("convert them where the file was made: to their magnitude, for instance, as 32-bit floats"))
}

/// Numbers of voxels, of points in time and of components that have planes of their own.
fn sizes(fields: &Fields) -> Result<([usize; 3], usize, usize)> {
    let rank = fields.dim(0);
    if !(1.0..=7.0).contains(&rank) {
        return Err(Error::invalid(format!("{rank} dimensions; 1 to 7 are expected")).hint(AGAIN));
    }
    let mut dims = [1_usize; 8];
    for (i, dim) in dims.iter_mut().enumerate().skip(1).take(rank as usize) {
        let n = fields.dim(i);
        if !(1.0..=f64::from(i32::MAX)).contains(&n) {
            return Err(Error::invalid(format!("dimension {i} has {n} entries")).hint(AGAIN));
        }
        *dim = n as usize;
    }
    if !matches!(dims[5], 1 | 3) || dims[6] != 1 || dims[7] != 1 {
        return Err(Error::unsupported(format!(
            "{} x {} x {} values a voxel; 1 or 3 are read",
            dims[5], dims[6], dims[7]
        ))
        .hint("write one of them, or a vector of three, to a file of its own first"));
    }
    Ok(([dims[1], dims[2], dims[3]], dims[4], dims[5]))
}

fn image(fields: &Fields, data: &Path, packing: Packing, options: &Options, apart: bool) -> Result<Image> {
    let mut notes = Vec::new();
    let (size, times, planes) = sizes(fields)?;
    let code = fields.number((70, Sample::I16), (12, Sample::I16)) as i64;
    let (sample, together) = sample(code)?;
    if planes > 1 && together > 1 {
        return Err(Error::unsupported("vectors of colors are not read").hint("write one of them first"));
    }
    let time = options.choose_time(times, &mut notes)?;
    let offset = fields.number((108, Sample::F32), (168, Sample::I64));
    let least = if apart { 0.0 } else { fields.bytes.len() as f64 };
    if !(least..1e15).contains(&offset) || offset.fract() != 0.0 {
        return Err(Error::invalid(format!("the values begin at byte {offset}")).hint(AGAIN));
    }
    let volume = input::byte_count(size, together, sample.bytes());
    let all = volume.and_then(|n| n.checked_mul(times as u64)?.checked_mul(planes as u64));
    if packing == Packing::Plain {
        input::has(data, offset as u64, all)?;
    }
    let (Some(volume), Some(_)) = (volume, all) else {
        return Err(Error::invalid(format!("{size:?} voxels are too many")).hint(AGAIN));
    };
    // Colors have no scale.
    let scale = if together == 1 { scale(fields, &mut notes)? } else { None };
    let part = |plane: usize| {
        let before = (plane * times + time) as u64 * volume;
        let reader = input::whole(input::values(data, 0, packing, offset as u64 + before)?, packing, volume);
        Ok(Box::new(Binary::new(reader, sample, fields.endian).scaled(scale)) as Box<dyn Slices>)
    };
    let parts = (0..planes).map(part).collect::<Result<Vec<_>>>()?;
    let slices = if planes > 1 { Box::new(Planar::new(parts)) } else { single(parts)? };
    let index_to_world = placement(fields, &mut notes)?;
    if let Some(unit) = fields.unit() {
        notes.push(format!("a unit of length is one {unit}"));
    }
    let values = if sample.is_integer() && scale.is_none() { Values::Integer } else { Values::Real };
    let components = planes * together;
    let about = About { sample: Some(sample), rescale: scale, unit: None, anatomical: true };
    Ok(Image { header: Header { name: None, size, components, values, index_to_world, about, notes }, slices })
}

/// Slope and intercept of the values; none where they are not scaled, which a slope of 0 says.
fn scale(fields: &Fields, notes: &mut Vec<String>) -> Result<Option<(f64, f64)>> {
    let (slope, intercept) = (fields.real(112, 176), fields.real(116, 184));
    let finite = |name: &str, value: f64| {
        let what = format!("the {name} of the values is {value}; a finite number is expected");
        if value.is_finite() { Ok(()) } else { Err(Error::invalid(what).hint(CORRECT)) }
    };
    finite("slope (scl_slope)", slope)?;
    if slope == 0.0 {
        if intercept != 0.0 {
            notes.push(format!(
                "a slope of 0 says that values are not scaled; the intercept of {intercept} is not applied"
            ));
        }
        return Ok(None);
    }
    finite("intercept (scl_inter)", intercept)?;
    Ok(Some((slope, intercept)).filter(|scale| *scale != (1.0, 0.0)))
}

fn single(parts: Vec<Box<dyn Slices>>) -> Result<Box<dyn Slices>> {
    parts.into_iter().next().ok_or_else(|| Error::invalid("there are no values").hint(AGAIN))
}

/// Map from indices to right, anterior, superior.
fn placement(fields: &Fields, notes: &mut Vec<String>) -> Result<Affine> {
    let code = |first, second| fields.number((first, Sample::I16), (second, Sample::I32)) > 0.0;
    if code(254, 348) {
        let row =
            |r: usize| DVec4::from_array([0, 1, 2, 3].map(|c| fields.real(280 + 16 * r + 4 * c, 400 + 32 * r + 8 * c)));
        let rows = DMat4::from_cols(row(0), row(1), row(2), DVec4::W);
        return placement::checked(rows.transpose());
    }
    let size = |i: usize| {
        let one = fields.dim(0) < i as f64 || fields.dim(i) == 1.0;
        // A size of 0 stands for an axis of one voxel.
        if one && fields.pixdim(i) == 0.0 {
            return Ok(1.0);
        }
        placement::edge(&format!("the voxels' size along axis {i} (pixdim[{i}])"), fields.pixdim(i))
    };
    let pixdim = DVec3::new(size(1)?, size(2)?, size(3)?);
    if code(252, 344) {
        let quaternion = [0, 1, 2].map(|i| fields.real(256 + 4 * i, 352 + 8 * i));
        let origin = DVec3::from_array([0, 1, 2].map(|i| fields.real(268 + 4 * i, 376 + 8 * i)));
        let side = fields.pixdim(0);
        if !side.is_finite() {
            return Err(Error::invalid(format!(
                "the side of the third axis (pixdim[0]) is {side}; 1 or -1 is expected"
            ))
            .hint(CORRECT));
        }
        let mirrored = if side < 0.0 { -1.0 } else { 1.0 };
        let turn = rotation(quaternion);
        return placement::affine(
            [turn.x_axis * pixdim.x, turn.y_axis * pixdim.y, turn.z_axis * (pixdim.z * mirrored)],
            origin,
        );
    }
    notes.push("the file states the voxels' sizes only; the first voxel was put at the origin, along the axes".into());
    placement::affine([DVec3::X * pixdim.x, DVec3::Y * pixdim.y, DVec3::Z * pixdim.z], DVec3::ZERO)
}

/// Rotation of a unit quaternion whose real part is not stored, because it is not negative.
fn rotation([b, c, d]: [f64; 3]) -> DMat3 {
    let rest = 1.0 - (b * b + c * c + d * d);
    // Rounding to single precision can leave less than nothing for the real part: the others are normalized then.
    let quaternion =
        if rest < 1e-7 { DQuat::from_xyzw(b, c, d, 0.0).normalize() } else { DQuat::from_xyzw(b, c, d, rest.sqrt()) };
    DMat3::from_quat(quaternion)
}
