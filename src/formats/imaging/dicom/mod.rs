//! DICOM series: the files of a folder that belong together, or one file of many frames.
//!
//! Slices are sorted by their positions along the normal of the image plane, and the step from one to the next comes
//! from these positions, so that the tilt of a gantry becomes a shear. DICOM's axes, left, posterior, superior, are
//! brought to right, anterior, superior; units are millimetres. Rescale slope and intercept are applied, so that CT
//! comes in Hounsfield units; windows are for displays and are not applied.
//!
//! Elements are read by code of this crate, which bounds what a damaged length can make it allocate, and nested items
//! make it recurse.
//!
//! Source: [DICOM](https://www.dicomstandard.org/current), parts 3 (C.7.6), 5 and 10.

mod agreement;
mod element;
mod fields;
mod file;
mod jpeg2000;
mod packing;
mod pixels;
mod placement;
mod series;
mod syntax;
mod tags;

use super::image::{About, Header, Image, Values};
use super::options::Options;
use crate::error::Result;
use crate::formats::limits::Limits;
use pixels::Planes;
use std::path::Path;

/// Extensions of the files of a series; most have none.
pub(crate) const ENDINGS: &[&str] = &["dcm", "dicom", "dic", "ima"];

/// True if a file begins as DICOM files do: `DICM` behind a preamble of 128 bytes.
pub(crate) fn is_dicom(start: &[u8]) -> bool {
    start.get(128..132) == Some(b"DICM")
}

/// Returns the statements of the files of a series on their values.
fn about(files: &[file::File], planes: &[placement::Plane]) -> About {
    let scale = |plane: &placement::Plane| files[plane.file].frame(plane.frame).rescale;
    let first = planes.first().map(scale).filter(|first| planes.iter().all(|plane| scale(plane) == *first));
    About {
        sample: files.first().map(|file| file.pixels.sample()),
        unit: files.first().and_then(|file| file.unit.clone()),
        rescale: first.filter(|scale| *scale != (1.0, 0.0)),
        anatomical: true,
    }
}

/// True if a folder holds a DICOM file.
pub(crate) fn is_series(folder: &Path) -> bool {
    series::paths(folder).is_ok_and(|paths| paths.iter().any(|path| series::begins_as_dicom(path)))
}

/// Opens a series: that of a file, or of a folder.
///
/// # Errors
/// If no file is DICOM, there are several series and the options choose none, a file of the series cannot be read,
/// slices are missing, doubled or differ in size, orientation or in whether low values are shown bright, or pixels are
/// packed in a way that is not read.
pub(crate) fn open(path: &Path, options: &Options, limits: Limits) -> Result<Image> {
    let mut notes = Vec::new();
    let series = series::gather(path, options.series.as_deref(), limits, &mut notes)?;
    let stack = placement::stack(&series, options, &mut notes).map_err(|e| e.at(path))?;
    agreement::check(&series.files, &stack.planes, &mut notes).map_err(|e| e.at(path))?;
    let files = series.files;
    let first = &files[stack.planes[0].file];
    let rescaled = stack.planes.iter().any(|plane| files[plane.file].frame(plane.frame).rescale != (1.0, 0.0));
    let whole = stack.planes.iter().all(|plane| files[plane.file].pixels.is_integer()) && !rescaled;
    if files.iter().any(|file| file.inverted) {
        notes.push("displays show low values of this series bright (MONOCHROME1); values are kept as stored".into());
    }
    if files.iter().any(|file| file.even) {
        notes.push(
            "the frames do not say where they lie; they are taken for slices in even steps of their thickness".into(),
        );
    }
    if files.iter().any(|file| file.table) {
        notes.push("a table of the file makes quantities of stored values (Modality LUT); it is not applied".into());
    }
    if let Some(padding) = first.padding {
        notes.push(format!("stored values of {padding} mark pixels outside the image; they are kept"));
    }
    let header = Header {
        name: None,
        size: [first.columns, first.rows, stack.planes.len()],
        components: 1,
        values: if whole { Values::Integer } else { Values::Real },
        index_to_world: stack.index_to_world,
        about: about(&files, &stack.planes),
        notes,
    };
    Ok(Image { header, slices: Box::new(Planes::new(files, stack.planes)) })
}
