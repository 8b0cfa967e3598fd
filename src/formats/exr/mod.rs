//! OpenEXR pictures, read and written with the `exr` crate.
//!
//! Supported are single and multi-part files, any layers, half, float and uint samples, scan lines and tiles (of mip
//! and rip maps the full size). Subsampled channels and HTJ2K compression are refused by name. Deep pictures are those
//! of [`deep`]; readers of flat ones refuse them.
//!
//! # Windows
//! Pictures cover the **display window**. Where a part's data window does not reach, samples are 0
//! (transparent black); where it reaches further (overscan), it is cropped.
//!
//! # Layers
//! A channel `ViewLayer.Combined.R` is component `R` of layer `ViewLayer.Combined`. A channel without
//! a dot belongs to its part's name in a file of several parts and to the unnamed layer `""` in a file
//! of one. Blender, Houdini (`C.r`), Nuke (`rgba.red`) and OpenEXR's own tools all fit this rule.

mod attributes;
mod decode;
pub mod deep;
mod document;
mod dwa;
mod encode;
mod fault;
mod header;
mod layer;
mod picture;
mod problems;
mod read;
mod summary;
mod views;
mod write;

pub(crate) use decode::is_whole;
pub use document::Document;
pub use header::{Header, SampleType, header};
pub(crate) use header::{LayerInfo, is_damaged};
pub(crate) use layer::layer_within;
pub use picture::{Picture, picture, picture_within, read_film_within, read_picture};
pub(crate) use picture::{read_part_within, read_picture_within};
pub use problems::problems;
pub(crate) use problems::problems_within;
pub use read::{Channel, Image, Layer, read, read_within};
pub(crate) use summary::ExrSummary;
pub use summary::{summary, summary_within};
pub use write::{Attributes, Half, Packing, Storage, write_picture};
pub(crate) use write::{Placement, write_like, write_part};

use serde::Serialize;

/// A rectangle of pixels, with x to the right and y downwards.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, schemars::JsonSchema)]
pub struct Window {
    /// Coordinates of the first pixel, inclusive.
    pub min: [i32; 2],
    /// Width and height in pixels.
    pub size: [usize; 2],
}

impl Window {
    /// Number of pixels in the window.
    pub fn pixels(&self) -> u64 {
        self.size[0] as u64 * self.size[1] as u64
    }

    /// Coordinate one past the last pixel on `axis` (0: x, 1: y).
    fn end(&self, axis: usize) -> i64 {
        i64::from(self.min[axis]) + self.size[axis] as i64
    }

    /// Smallest window around both windows.
    pub(crate) fn union(&self, other: &Self) -> Self {
        let min = [self.min[0].min(other.min[0]), self.min[1].min(other.min[1])];
        let size = std::array::from_fn(|a| (self.end(a).max(other.end(a)) - i64::from(min[a])) as usize);
        Self { min, size }
    }
}

impl std::fmt::Display for Window {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}x{} at ({}, {})", self.size[0], self.size[1], self.min[0], self.min[1])
    }
}
