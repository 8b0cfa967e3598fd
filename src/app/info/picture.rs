//! Headers of pictures of integer samples.

use crate::error::Result;
use crate::formats::raster::{Header, PictureFormat};
use crate::scene::color_space::ColorSpace;
use serde::Serialize;
use std::fmt;
use std::path::Path;

/// Content of a picture, by its header.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub(super) struct Summary {
    /// Name of the format.
    kind: &'static str,
    /// Width and height in pixels.
    size: [usize; 2],
    /// Bits of each sample.
    bits: Option<u8>,
    /// Color space that the file itself states; none if it states none.
    color_space: Option<ColorSpace>,
}

/// Reads the header of a picture.
///
/// # Errors
/// If the file cannot be read, or its header is damaged.
pub(crate) fn summary(path: &Path, kind: &'static str, reader: &PictureFormat) -> Result<Summary> {
    let Header { size, bits, color_space } = (reader.header)(path).map_err(|e| e.at(path))?;
    Ok(Summary { kind, size, bits, color_space })
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [width, height] = self.size;
        write!(f, "{}, {width} x {height} pixels", self.kind)?;
        if let Some(bits) = self.bits {
            write!(f, ", {bits} bits")?;
        }
        match self.color_space {
            Some(space) => writeln!(f, ", {space}"),
            None => writeln!(f),
        }
    }
}
