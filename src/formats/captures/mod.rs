//! Captures of any kind: a `transforms.json`, a sparse model of COLMAP, or the cameras of a USD stage.

mod problems;
mod summary;

pub use problems::problems;
pub(crate) use problems::problems_within;
pub(crate) use summary::CaptureSummary;
pub use summary::{summary, summary_within};

use crate::error::{Error, Result};
use crate::formats::format::FileKind;
use crate::formats::limits::Limits;
use crate::formats::usd::{Stage, Views};
use crate::formats::views::{LensAndMask, StatedCapture};
use crate::formats::{colmap, registry, transforms};
use crate::scene::capture::Capture;
use std::path::{Path, PathBuf};

/// Name of the file with the training views of a NeRF-synthetic data set, whose folder has no `transforms.json`.
const TRAINING: &str = "transforms_train.json";

/// Returns the file that holds the cameras of the capture that a path names, itself or by its folder: the JSON, or the
/// images of COLMAP's model. In a folder a `transforms.json` goes first, then a `transforms_train.json`, then a model.
pub fn file(path: &Path) -> PathBuf {
    let json = transforms::json_path(path);
    if !path.is_dir() {
        return colmap::find(path).unwrap_or(json);
    }
    let training = path.join(TRAINING);
    match () {
        () if json.exists() => json,
        () if training.exists() => training,
        () => colmap::find(path).unwrap_or(json),
    }
}

/// Returns all files of a capture but its pictures, the one that [`file()`] returns first.
pub fn files(path: &Path) -> Vec<PathBuf> {
    let first = file(path);
    let cameras = first.extension().map(|suffix| first.with_file_name("cameras").with_extension(suffix));
    let cameras = cameras.filter(|_| colmap::is_model_file(&first));
    std::iter::once(first).chain(cameras).collect()
}

/// Reads a capture whose pictures can be used as they are. Pictures are not read, except for their headers where the
/// size is not stated.
///
/// # Errors
/// If the file cannot be read or used, or pictures are distorted by a lens or covered by masks. The error names the
/// file and the frame.
pub fn load(path: &Path) -> Result<Capture> {
    load_within(path, Limits::default())
}

/// Reads a capture as [`load`] does; its values must fit into `limits`.
///
/// # Errors
/// The conditions are those of [`load`], with these limits.
pub fn load_within(path: &Path, limits: Limits) -> Result<Capture> {
    stated_within(path, limits)?.direct().map_err(|e| e.at(file(path)))
}

/// Reads a capture with the lenses and masks of its views.
///
/// # Errors
/// If the file cannot be read or used, or its values do not fit into `limits`.
pub fn stated_within(path: &Path, limits: Limits) -> Result<StatedCapture> {
    let place = file(path);
    if registry::sniff(&place).is_ok_and(|format| matches!(format.kind, FileKind::Usd)) {
        let capture = Stage::open(&place, limits)?.capture(&Views::default())?;
        let optics = vec![LensAndMask::default(); capture.frames.len()];
        return Ok(StatedCapture { capture, optics });
    }
    if colmap::is_model_file(&place) {
        if colmap::find(&place).is_none() {
            return Err(Error::invalid("the folder does not hold both files of COLMAP's model: cameras and images")
                .at(place.parent().unwrap_or(&place))
                .hint("give the folder that holds cameras.txt and images.txt, or cameras.bin and images.bin"));
        }
        return colmap::load_within(&place, limits);
    }
    if path.is_dir() && !place.exists() {
        return Err(Error::invalid(
            "the folder holds neither a transforms.json nor COLMAP's cameras and images (in it, or in sparse/0)",
        )
        .at(path)
        .hint("a capture is a transforms.json or the folder that holds one, or a model of COLMAP"));
    }
    let mut stated = transforms::stated_within(&place, limits)?;
    if place.file_name().is_some_and(|name| name == TRAINING) && path.is_dir() {
        let remark =
            format!("{TRAINING} is read; the views of transforms_val.json and transforms_test.json are not used");
        stated.capture.remarks.push(remark);
    }
    Ok(stated)
}
