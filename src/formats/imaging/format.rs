//! Formats of regular grids that can be read: found by content, opened to images.

use super::image::{Header, Image};
use super::options::Options;
use super::{cvol, dicom, input, meta_image, mrc, nifti, nrrd, numpy, raw, tiff, vtk, zarr};
use crate::error::{Code, Error, Result};
use crate::formats::limits::Limits;
use crate::formats::reading::Reading;
use std::path::Path;

/// Bytes by which a format is recognized.
const START: u64 = 1024;

/// A format that can be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, schemars::JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Format {
    /// NIfTI-1 or NIfTI-2, in one file or as a pair of header and values; also Analyze 7.5, to say that it is not read.
    Nifti,
    /// Nearly raw raster data, with or without values in the file.
    Nrrd,
    /// ITK's MetaImage.
    MetaImage,
    /// An array of NumPy.
    Npy,
    /// An archive of NumPy's arrays.
    Npz,
    /// A TIFF of one or more pages, a folder of TIFFs, or a pattern that names some.
    Tiff,
    /// VTK's image data in XML.
    VtkXml,
    /// VTK's legacy format.
    VtkLegacy,
    /// A DICOM series: a folder, or a file of it.
    Dicom,
    /// An MRC or CCP4 map.
    Mrc,
    /// An OME-Zarr image or a Zarr array: a folder.
    Zarr,
    /// A volume of the DiffDVR and fV-SRN renderers.
    Cvol,
    /// Numbers without a header.
    Raw,
}

impl Format {
    /// Name as reports and errors have it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Nifti => "NIfTI",
            Self::Nrrd => "NRRD",
            Self::MetaImage => "MetaImage",
            Self::Npy => ".npy",
            Self::Npz => ".npz",
            Self::Tiff => "TIFF",
            Self::VtkXml => ".vti",
            Self::VtkLegacy => "legacy VTK",
            Self::Dicom => "DICOM",
            Self::Mrc => "MRC",
            Self::Zarr => "Zarr",
            Self::Cvol => ".cvol",
            Self::Raw => "raw",
        }
    }

    /// True if such files do not state where their voxels lie, or not always.
    pub(crate) fn takes_placement(self) -> bool {
        matches!(self, Self::Npy | Self::Npz | Self::Tiff | Self::Dicom | Self::Zarr | Self::Raw)
    }

    /// True if such a file may hold several points in time, of which one is read.
    pub(crate) fn has_times(self) -> bool {
        matches!(self, Self::Nifti | Self::Nrrd | Self::Tiff | Self::Dicom | Self::Zarr)
    }

    /// True if such a file may hold several named arrays.
    pub(crate) fn has_arrays(self) -> bool {
        matches!(self, Self::Npz | Self::Tiff | Self::VtkXml | Self::VtkLegacy | Self::Cvol)
    }
}

/// Detects a format by the content of a file, a folder, or the files of a pattern; none if it is none of these.
///
/// # Errors
/// If the file is no regular file, or cannot be read.
pub fn sniff(path: &Path) -> Result<Option<Format>> {
    if zarr::is_zarr(path) {
        return Ok(Some(Format::Zarr));
    }
    if path.is_dir() || !path.exists() {
        let series = path.is_dir() && dicom::is_series(path);
        let stack = || tiff::is_stack(path).then_some(Format::Tiff);
        return Ok(if series { Some(Format::Dicom) } else { stack() });
    }
    let start = input::start(path, START)?;
    Ok(if dicom::is_dicom(&start) {
        // Before TIFF: the preamble of a DICOM file may be the header of one.
        Some(Format::Dicom)
    } else if start.starts_with(b"NRRD000") {
        Some(Format::Nrrd)
    } else if start.starts_with(b"\x93NUMPY") {
        Some(Format::Npy)
    } else if numpy::is_archive(&start) {
        Some(Format::Npz)
    } else if tiff::is_tiff(&start) {
        Some(Format::Tiff)
    } else if nifti::states_itself(&start) {
        // Before MRC, whose word may stand in the description of an image.
        Some(Format::Nifti)
    } else if mrc::is_mrc(&start) {
        Some(Format::Mrc)
    } else if cvol::is_cvol(&start) {
        Some(Format::Cvol)
    } else if start.starts_with(b"# vtk DataFile") {
        Some(Format::VtkLegacy)
    } else if vtk::is_xml(&start) {
        Some(Format::VtkXml)
    } else if nifti::is_nifti(path, &start) {
        Some(Format::Nifti)
    } else if meta_image::is_meta_image(&start) {
        Some(Format::MetaImage)
    } else if mrc::is_packed_mrc(path, &start)? {
        Some(Format::Mrc)
    } else {
        None
    })
}

/// Opens a file of a known format, to one image for each of its arrays that can be read and is wanted; at least one.
///
/// # Errors
/// If the file cannot be read, contradicts its format, holds what this program does not handle, or a slice of it would
/// not fit into the limits. The error names the file.
pub fn open(path: &Path, format: Format, options: &Options, limits: Limits) -> Result<Vec<Image>> {
    let _reading = Reading::begin(path);
    let images = match format {
        Format::Nifti => nifti::open(path, options),
        Format::Nrrd => nrrd::open(path, options),
        Format::MetaImage => meta_image::open(path),
        Format::Npy => numpy::open(path, options, limits),
        Format::Npz => numpy::open_archive(path, options, limits),
        Format::Tiff => tiff::open(path, options, limits),
        Format::VtkXml => vtk::open_xml(path, options, limits),
        Format::VtkLegacy => vtk::open_legacy(path, options),
        Format::Dicom => dicom::open(path, options, limits).map(|image| vec![image]),
        Format::Mrc => mrc::open(path).map(|image| vec![image]),
        Format::Zarr => zarr::open(path, options, limits).map(|image| vec![image]),
        Format::Cvol => cvol::open(path, options),
        Format::Raw => raw::open(path, options),
    };
    let images = images.map_err(|e| e.at(path))?;
    images.iter().try_for_each(|image| check(&image.header, limits)).map_err(|e| e.at(path))?;
    Ok(images)
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
