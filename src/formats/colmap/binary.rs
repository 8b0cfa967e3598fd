//! COLMAP's binary files. Every count is held against the bytes that are left before anything is reserved.

use super::Image;
use super::model::{self, Calibration};
use crate::error::{Code, Error, Result};
use crate::formats::limits::Limits;
use glam::{DQuat, DVec3};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read};

/// Longest name of a picture in bytes.
const MAX_NAME: usize = 4096;
/// Least bytes of a camera in a file (with three parameters), and of an image (without points, named by one byte).
const CAMERA: u64 = 4 + 4 + 16 + 3 * 8;
const IMAGE: u64 = 4 + 7 * 8 + 4 + 2 + 8;
/// Bytes of a point of an image: x, y, and the identifier of a point in space.
const POINT: u64 = 24;

/// Reads the file of the cameras.
///
/// # Errors
/// If it is damaged, or a camera cannot be used.
pub(super) fn cameras(file: File, limits: Limits) -> Result<BTreeMap<u32, Calibration>> {
    let mut bytes = Bytes::new(file)?;
    let count = bytes.count(CAMERA, limits, "cameras")?;
    let mut cameras = BTreeMap::new();
    for i in 0..count {
        let named = |e: Error| e.part(format!("camera {i}"));
        let id = bytes.u32().map_err(named)?;
        let (model, parameters) = model::by_id(bytes.u32().map_err(named)? as i32).map_err(named)?;
        let size = [bytes.u64().map_err(named)?, bytes.u64().map_err(named)?];
        let parameters = (0..parameters).map(|_| bytes.f64()).collect::<Result<Vec<_>>>().map_err(named)?;
        cameras.insert(id, Calibration::new(model, size, &parameters).map_err(named)?);
    }
    bytes.end()?;
    Ok(cameras)
}

/// Reads the file of the images; the points that they see are skipped.
///
/// # Errors
/// If it is damaged.
pub(super) fn images(file: File, limits: Limits) -> Result<Vec<Image>> {
    let mut bytes = Bytes::new(file)?;
    let count = bytes.count(IMAGE, limits, "images")?;
    let mut images = Vec::new();
    for i in 0..count {
        images.push(image(&mut bytes).map_err(|e| e.part(format!("image {i}")))?);
    }
    bytes.end()?;
    Ok(images)
}

fn image(bytes: &mut Bytes) -> Result<Image> {
    let _id = bytes.u32()?;
    let [w, x, y, z] = [bytes.f64()?, bytes.f64()?, bytes.f64()?, bytes.f64()?];
    let translation = DVec3::new(bytes.f64()?, bytes.f64()?, bytes.f64()?);
    let camera = bytes.u32()?;
    let mut name = Vec::new();
    loop {
        match bytes.take::<1>()? {
            [0] => break,
            [byte] if name.len() < MAX_NAME => name.push(byte),
            _ => return Err(damaged(format!("a name of more than {MAX_NAME} bytes"))),
        }
    }
    let name = String::from_utf8(name).map_err(|_| damaged("a name that is not UTF-8"))?;
    if name.is_empty() {
        return Err(damaged("an image without a name"));
    }
    let points = bytes.u64()?;
    bytes.skip(points.checked_mul(POINT), points)?;
    Ok(Image { rotation: DQuat::from_xyzw(x, y, z, w), translation, camera, name })
}

/// A file that knows how many bytes are left of it.
struct Bytes {
    file: BufReader<File>,
    left: u64,
}

impl Bytes {
    fn new(file: File) -> Result<Self> {
        let left = file.metadata().map_err(Error::system)?.len();
        Ok(Self { file: BufReader::new(file), left })
    }

    fn take<const N: usize>(&mut self) -> Result<[u8; N]> {
        let mut bytes = [0; N];
        if self.left < N as u64 {
            return Err(damaged(format!("it ends {} bytes too early", N as u64 - self.left)));
        }
        self.file.read_exact(&mut bytes).map_err(Error::system)?;
        self.left -= N as u64;
        Ok(bytes)
    }

    fn u32(&mut self) -> Result<u32> {
        self.take().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Result<u64> {
        self.take().map(u64::from_le_bytes)
    }

    fn f64(&mut self) -> Result<f64> {
        self.take().map(f64::from_le_bytes)
    }

    /// Reads a count of records of at least `least` bytes each.
    fn count(&mut self, least: u64, limits: Limits, what: &str) -> Result<u64> {
        let count = self.u64()?;
        if count.checked_mul(least).is_none_or(|needed| needed > self.left) {
            return Err(damaged(format!("{count} {what} are stated, and {} bytes follow", self.left)));
        }
        // A record in memory takes less than four times its bytes in the file.
        if count * least * 4 > limits.max_memory {
            return Err(Error::unsupported(format!("{count} {what} do not fit into memory"))
                .coded(Code::MemoryLimit)
                .hint("raise ⟨max_memory⟩ if the file is to be trusted"));
        }
        Ok(count)
    }

    fn skip(&mut self, bytes: Option<u64>, points: u64) -> Result<()> {
        let Some(bytes) = bytes.filter(|bytes| *bytes <= self.left) else {
            return Err(damaged(format!("{points} points are stated, and {} bytes follow", self.left)));
        };
        let offset = i64::try_from(bytes).map_err(|_| damaged("too many points"))?;
        self.file.seek_relative(offset).map_err(Error::system)?;
        self.left -= bytes;
        Ok(())
    }

    /// Checks that nothing is left.
    fn end(&self) -> Result<()> {
        if self.left == 0 { Ok(()) } else { Err(damaged(format!("{} bytes follow the last record", self.left))) }
    }
}

fn damaged(what: impl Into<String>) -> Error {
    Error::invalid(what).hint("the file is incomplete or no binary model of COLMAP: export the model again")
}
