//! Deep OpenEXR pictures: any number of samples a pixel, each with a depth, so that other elements can be put between.
//!
//! Read are parts of deep scan lines and of deep tiles (of mip and rip maps the full size), uncompressed or with RLE or
//! ZIPS compression, whose channels Z, ZBack, R, G, B and A are half, float or uint; of a file of several parts the
//! first deep one. Written are scan lines.
//!
//! The `exr` crate reads and writes headers. Chunks are read here: it bounds their size by that of flat pictures, and
//! does not unpack them. Nothing is unpacked before its size is known to be plausible and within the
//! [limits](crate::formats::limits::Limits).
//!
//! # Samples
//! Colors are premultiplied. A sample without ZBack, or with one that is not behind Z, is a *point* at Z; all others
//! are *volumes*, homogeneous from Z to ZBack. What a pixel shows is defined by F. Kainz, "Interpreting OpenEXR Deep
//! Pixels" (OpenEXR's documentation); see [`TidyPixel`].

mod chunk;
mod flatten;
mod header;
mod held;
mod lines;
mod picture;
mod problems;
mod running_sum;
mod summary;
mod tidy;
mod unpack;
mod write;

pub(crate) use flatten::{Flattened, flattened, flattened_picture, image_or_flattened, picture_or_flattened};
pub(super) use header::header;
pub use header::is_deep;
pub(in crate::formats) use header::states_deep;
pub(crate) use held::HeldOut;
pub(super) use lines::is_whole;
pub use picture::{DeepPicture, read, read_within};
pub(crate) use problems::{Finding, findings_within};
pub(crate) use summary::DeepSummary;
pub use summary::summary_within;
pub use tidy::{Interval, TidyPixel};
pub use write::{Compression, Encoding, Layout, LineWriter, write};

pub use crate::scene::deep::{DeepLine, DeepSample};

use super::fault;
use crate::error::{Error, Result};
use std::path::Path;

/// Returns the error that a picture is deep where a flat one is needed, with what to do.
pub(crate) fn refusal(path: &Path) -> Error {
    fault::deep().at(path)
}

/// Refuses deep pictures where only flat ones are of use.
///
/// # Errors
/// If the picture is deep.
pub(crate) fn refuse(path: &Path) -> Result<()> {
    if is_deep(path) { Err(refusal(path)) } else { Ok(()) }
}
