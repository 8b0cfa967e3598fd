//! NIfTI-1, and NIfTI-2 for long axes: an sform with the whole map, and a qform where there is no shear.

use super::{packed, values};
use crate::error::{Error, Result};
use crate::formats::atomic::{self, Draft};
use crate::formats::imaging::source::Source;
use crate::formats::sample::Sample;
use glam::{DMat3, DMat4, DQuat};
use std::path::Path;

/// Cosine of two axes from which on they count as not orthogonal: single precision, which the qform has, rounds by
/// 6e-8.
const SHEAR: f64 = 1e-6;

/// Qform of a map: sizes, whether the third axis is mirrored, and the quaternion's imaginary parts.
struct Qform {
    pixdim: [f64; 3],
    mirrored: f64,
    quaternion: [f64; 3],
    exists: bool,
}

impl Qform {
    fn of(map: DMat4) -> Self {
        let linear = DMat3::from_mat4(map);
        let pixdim = [linear.x_axis, linear.y_axis, linear.z_axis].map(|c| c.length());
        let mut turn =
            DMat3::from_cols(linear.x_axis / pixdim[0], linear.y_axis / pixdim[1], linear.z_axis / pixdim[2]);
        let pairs = [(turn.x_axis, turn.y_axis), (turn.y_axis, turn.z_axis), (turn.x_axis, turn.z_axis)];
        let exists = pairs.iter().all(|(a, b)| a.dot(*b).abs() < SHEAR);
        let mirrored = if turn.determinant() < 0.0 { -1.0 } else { 1.0 };
        turn.z_axis *= mirrored;
        let q = if exists { DQuat::from_mat3(&turn).normalize() } else { DQuat::IDENTITY };
        let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
        Self { pixdim, mirrored, quaternion: [q.x, q.y, q.z].map(|v| v * sign), exists }
    }
}

fn code(sample: Sample) -> i16 {
    match sample {
        Sample::U8 => 2,
        Sample::I16 => 4,
        Sample::I32 => 8,
        Sample::F32 => 16,
        Sample::F64 => 64,
        Sample::I8 => 256,
        Sample::U16 => 512,
        Sample::U32 => 768,
        Sample::I64 => 1024,
        Sample::U64 => 1280,
        // No grid has halves.
        Sample::F16 => 16,
    }
}

/// Header up to the first value, and what it cannot hold.
fn header(source: &Source) -> Result<(Vec<u8>, Vec<String>)> {
    let map = source.index_to_world.matrix();
    let qform = Qform::of(map);
    let mut notes = Vec::new();
    if !qform.exists {
        notes.push("the voxels are sheared: the placement is in the sform alone, as no qform can hold it".into());
    }
    let second = source.size.iter().any(|n| *n > i16::MAX as usize);
    if second {
        notes.push("an axis has more than 32767 voxels: the file is NIfTI-2".into());
    }
    let exact = map.to_cols_array().iter().all(|v| f64::from(*v as f32) == *v);
    if !second && !exact {
        notes.push("NIfTI-1 holds the placement in single precision; .nrrd, .mha and .vti hold it exactly".into());
    }
    if map.to_cols_array().iter().any(|v| !second && !(*v as f32).is_finite()) {
        return Err(Error::unsupported("the placement is too large for single precision").hint("write .nrrd or .mha"));
    }
    let vectors = source.components == 3;
    let [x, y, z] = source.size;
    let dims = [if vectors { 5 } else { 3 }, x, y, z, 1, source.components, 1, 1];
    let rows: Vec<f64> = (0..3).flat_map(|r| map.row(r).to_array()).collect();
    let origin = map.w_axis.truncate().to_array();
    let pixdim = [qform.mirrored, qform.pixdim[0], qform.pixdim[1], qform.pixdim[2], 1.0, 1.0, 1.0, 1.0];
    let fields = Fields {
        dims,
        code: code(source.sample),
        bits: 8 * source.sample.bytes() as i16,
        vectors,
        pixdim,
        rows,
        origin,
    };
    Ok((if second { fields.second(&qform) } else { fields.first(&qform) }, notes))
}

struct Fields {
    dims: [usize; 8],
    code: i16,
    bits: i16,
    vectors: bool,
    pixdim: [f64; 8],
    rows: Vec<f64>,
    origin: [f64; 3],
}

/// Code of vectors among NIfTI's intents.
const VECTOR: i16 = 1007;

impl Fields {
    /// Header of NIfTI-1 with its four bytes that say that no extension follows.
    fn first(&self, qform: &Qform) -> Vec<u8> {
        let mut bytes = vec![0; 352];
        let mut put = |at: usize, new: &[u8]| bytes[at..at + new.len()].copy_from_slice(new);
        put(0, &348_i32.to_le_bytes());
        put(38, b"r");
        self.dims.iter().enumerate().for_each(|(i, n)| put(40 + 2 * i, &(*n as i16).to_le_bytes()));
        put(68, &(if self.vectors { VECTOR } else { 0 }).to_le_bytes());
        put(70, &self.code.to_le_bytes());
        put(72, &self.bits.to_le_bytes());
        let mut reals = |at: usize, values: &[f64]| {
            values.iter().enumerate().for_each(|(i, v)| put(at + 4 * i, &(*v as f32).to_le_bytes()));
        };
        reals(76, &self.pixdim);
        reals(108, &[352.0, 1.0]);
        reals(256, &qform.quaternion);
        reals(268, &self.origin);
        reals(280, &self.rows);
        put(252, &i16::from(qform.exists).to_le_bytes());
        put(254, &1_i16.to_le_bytes());
        put(344, b"n+1\0");
        bytes
    }

    /// Header of NIfTI-2 with its four bytes that say that no extension follows.
    fn second(&self, qform: &Qform) -> Vec<u8> {
        let mut bytes = vec![0; 544];
        let mut put = |at: usize, new: &[u8]| bytes[at..at + new.len()].copy_from_slice(new);
        put(0, &540_i32.to_le_bytes());
        put(4, b"n+2\0\r\n\x1a\n");
        put(12, &self.code.to_le_bytes());
        put(14, &self.bits.to_le_bytes());
        self.dims.iter().enumerate().for_each(|(i, n)| put(16 + 8 * i, &(*n as i64).to_le_bytes()));
        put(168, &544_i64.to_le_bytes());
        let mut reals = |at: usize, values: &[f64]| {
            values.iter().enumerate().for_each(|(i, v)| put(at + 8 * i, &v.to_le_bytes()));
        };
        reals(104, &self.pixdim);
        reals(176, &[1.0]);
        reals(352, &qform.quaternion);
        reals(376, &self.origin);
        reals(400, &self.rows);
        put(344, &i32::from(qform.exists).to_le_bytes());
        put(348, &1_i32.to_le_bytes());
        put(504, &i32::from(if self.vectors { VECTOR } else { 0 }).to_le_bytes());
        bytes
    }
}

/// Writes a file, packed by gzip or not.
pub(crate) fn write(path: &Path, source: &Source, gzip: bool) -> Result<Vec<String>> {
    source.count()?;
    let (header, notes) = header(source)?;
    atomic::write(path, |draft: &mut Draft| {
        if gzip {
            return packed(draft, |put| {
                put(&header)?;
                planes(source, put)
            });
        }
        draft.write(&header)?;
        planes(source, &mut |bytes| draft.write(bytes))
    })?;
    Ok(notes)
}

/// Writes the values, one component after the other.
fn planes(source: &Source, put: &mut dyn FnMut(&[u8]) -> Result<()>) -> Result<()> {
    if source.components == 1 {
        return values(source, put);
    }
    let (mut slice, mut plane, mut bytes) = (Vec::new(), Vec::new(), Vec::new());
    for component in 0..source.components {
        for z in 0..source.size[2] {
            source.slice(z, &mut slice)?;
            plane.clear();
            plane.extend(slice.iter().skip(component).step_by(source.components));
            bytes.clear();
            source.sample.encode(&plane, &mut bytes);
            put(&bytes)?;
        }
    }
    Ok(())
}
