//! Operations of the formats of regular grids: what opens their files to images, and what writes them.

use super::image::{Header, Image};
use super::options::{Options, ReadOption};
use super::write::Target;
use crate::error::{Code, Error, Result};
use crate::formats::limits::Limits;
use crate::formats::reading::Reading;
use std::path::Path;

/// How regular grids of a format are read and written.
#[derive(Debug)]
pub struct ImageFormat {
    /// Opens a file to one image for each of its arrays that can be read and is wanted; at least one.
    pub(crate) read: fn(&Path, &Options, Limits) -> Result<Vec<Image>>,
    /// Options that its reader heeds.
    pub(crate) options: &'static [ReadOption],
    /// Forms in which such files are written; none if they are only read.
    pub targets: &'static [Target],
}

impl ImageFormat {
    /// Opens a file of this format, to one image for each of its arrays that can be read and is wanted; at least one.
    ///
    /// # Errors
    /// If the file cannot be read, contradicts its format, holds what this program does not handle, or a slice of it
    /// would not fit into the limits. The error names the file.
    pub fn open(&self, path: &Path, options: &Options, limits: Limits) -> Result<Vec<Image>> {
        let _reading = Reading::begin(path);
        let images = (self.read)(path, options, limits).map_err(|e| e.at(path))?;
        images.iter().try_for_each(|image| check(&image.header, limits)).map_err(|e| e.at(path))?;
        Ok(images)
    }
}

/// Checks the size of an image before anything of its size is allocated.
fn check(header: &Header, limits: Limits) -> Result<()> {
    let [x, y, z] = header.size;
    if header.size.iter().any(|n| *n == 0 || *n >= i32::MAX as usize) || !matches!(header.components, 1 | 3) {
        return Err(Error::invalid(format!("an image of {x} x {y} x {z} voxels, {} values each", header.components))
            .hint("correct the sizes in the file's header, or write it again where it was made"));
    }
    let bytes = header.slice_len().and_then(|n| n.checked_mul(8)).map_or(u64::MAX, |n| n as u64);
    if bytes > limits.max_memory {
        return Err(Error::unsupported(format!(
            "a slice of {x} x {y} voxels needs {bytes} bytes, {} are allowed",
            limits.max_memory
        ))
        .coded(Code::MemoryLimit)
        .hint("raise ⟨max_memory⟩ if the file is to be trusted"));
    }
    Ok(())
}
