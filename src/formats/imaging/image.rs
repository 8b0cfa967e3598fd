//! A regular grid with its placement, read slice by slice.

use crate::error::Result;
use crate::formats::sample::Sample;
use crate::math::Affine;
use std::fmt;

/// Kind of the values of an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, schemars::JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Values {
    /// Real quantities, stored as floats or scaled integers.
    Real,
    /// Integers without a scale: labels, counts or grey values. Integers of 64 bits come here, too, exact up to 2⁵³.
    Integer,
}

/// Size, placement and kind of values of an image, which it states before the values.
#[derive(Debug, Clone, PartialEq)]
pub struct Header {
    /// Name of the quantity, where the file has one.
    pub name: Option<String>,
    /// Number of voxels along the first, second and third index axis; none is 0.
    pub size: [usize; 3],
    /// Number of values per voxel, 1 or 3.
    pub components: usize,
    /// Kind of the values.
    pub values: Values,
    /// Maps indices of voxel centres to the world (see the module's conventions).
    pub index_to_world: Affine,
    /// Further statements of the file on its values and its space.
    pub about: About,
    /// Assumptions and omissions of the reader, one sentence each, for the user.
    pub notes: Vec<String>,
}

/// Statements of a file on its values and its space, beyond what a grid is made of.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct About {
    /// Type of the stored numbers, where the reader knows it.
    pub sample: Option<Sample>,
    /// Unit of the values, where the file states one, such as `HU` for Hounsfield units.
    pub unit: Option<String>,
    /// Slope and intercept that make values of stored numbers; none where they are the same, or differ by slice.
    pub rescale: Option<(f64, f64)>,
    /// True if the axes of the world are right, anterior and superior.
    pub anatomical: bool,
}

impl Header {
    /// Number of values in a slice, all components of all voxels with the same third index; `None` if it overflows.
    pub fn slice_len(&self) -> Option<usize> {
        self.size[0].checked_mul(self.size[1])?.checked_mul(self.components)
    }
}

/// Source of an image's slices.
pub trait Slices {
    /// Reads the next slice in ascending order of the third index: `values[(y * size[0] + x) * components +
    /// component]`. Scale and offset of the file are applied.
    ///
    /// # Errors
    /// If the file ends early, is damaged, or cannot be read.
    fn next_slice(&mut self, values: &mut [f64]) -> Result<()>;

    /// Returns remarks on the slices read so far, one sentence each; they are complete once the last slice is read.
    fn notes(&self) -> Vec<String> {
        Vec::new()
    }

    /// Bytes of memory that reading takes beside the slice: of an array that is held whole, or of chunks. Buffers of a
    /// fixed size do not count.
    fn working_bytes(&self) -> u64 {
        0
    }
}

/// An image that is being read.
pub struct Image {
    /// Size, placement and kind of values.
    pub header: Header,
    /// The slices, of which none has been read.
    pub slices: Box<dyn Slices>,
}

impl fmt::Debug for Image {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Image").field("header", &self.header).finish_non_exhaustive()
    }
}
