//! Regular grids of medical and scientific files, which become grids of OpenVDB and are made of them.
//!
//! Each format is a module that gives an [`image::Image`]: a header and its slices in ascending order, so that a grid larger
//! than memory can pass through.
//!
//! World coordinates are right-handed and Z-up. Medical files are brought to NIfTI's axes, right, anterior, superior (RAS):
//! those of DICOM, ITK and NRRD's `left-posterior-superior` have x and y negated. Units are the file's, millimetres in most
//! medical ones. The index coordinates of a voxel are those of its centre.

pub mod image;
