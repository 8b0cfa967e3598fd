//! Regular grids of medical and scientific files, which become grids of OpenVDB and are made of them.
//!
//! ```text
//! ImageFormat::open ──▶ image::Image ──▶ values ──▶ volume::build ──▶ a grid of OpenVDB
//!           a file  ◀── Target::write ◀── source::Source ◀──┘
//! ```
//! Each format is a module that gives [`image::Image`]s: a header and its slices in ascending order, so that a grid
//! larger than memory can pass through. Its row of the [registry](super::registry) tells it from the others.
//!
//! World coordinates are right-handed and Z-up. Medical files are brought to NIfTI's axes, right, anterior, superior
//! (RAS): those of DICOM, ITK and NRRD's `left-posterior-superior` have x and y negated. Units are the file's,
//! millimetres in most medical ones. The index coordinates of a voxel are those of its centre.

pub(crate) mod cvol;
pub(crate) mod dicom;
mod format;
pub mod image;
pub(crate) mod input;
pub(crate) mod meta_image;
pub(crate) mod mitsuba;
pub(crate) mod mrc;
pub(crate) mod nifti;
pub(crate) mod nrrd;
pub(crate) mod numpy;
pub mod options;
mod placement;
pub(crate) mod raw;
pub mod source;
mod stream;
mod text;
pub(crate) mod tiff;
pub mod values;
pub mod volume;
pub(crate) mod vtk;
pub mod write;
pub(crate) mod zarr;

pub use format::ImageFormat;
