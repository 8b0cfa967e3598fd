//! Regular grids of medical and scientific files, which become grids of OpenVDB and are made of them.
//!
//! ```text
//! format::sniff ──▶ format::open ──▶ image::Image ──▶ values ──▶ volume::build ──▶ a grid of OpenVDB
//!                                    a file  ◀── write::write ◀── source::Source ◀──┘
//! ```
//! Each format is a module that gives [`image::Image`]s: a header and its slices in ascending order, so that a grid
//! larger than memory can pass through.
//!
//! World coordinates are right-handed and Z-up. Medical files are brought to NIfTI's axes, right, anterior, superior
//! (RAS): those of DICOM, ITK and NRRD's `left-posterior-superior` have x and y negated. Units are the file's,
//! millimetres in most medical ones. The index coordinates of a voxel are those of its centre.

mod cvol;
mod dicom;
pub mod format;
pub mod image;
mod input;
mod meta_image;
mod mrc;
mod nifti;
mod nrrd;
mod numpy;
pub mod options;
mod placement;
mod raw;
pub mod source;
mod stream;
mod text;
mod tiff;
pub mod values;
pub mod volume;
mod vtk;
pub mod write;
mod zarr;
