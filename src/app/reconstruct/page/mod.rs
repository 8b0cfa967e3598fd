//! Pages of reconstructions, and the records from which they are made again.

pub mod transfer;
pub mod volume;

use super::transfer_run::TransferRun;
use crate::app::outputs::RECORD;
use crate::app::photos;
use crate::app::run::Run;
use crate::cancel::Cancel;
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::formats::{atomic, input};
use crate::scene::camera::Camera;
use crate::scene::capture::{Capture, Frame};
use crate::scene::film::Film;
use serde::{Deserialize, Serialize};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Record of a reconstruction, kept in the report's folder so that the page can be made again.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(tag = "reconstructed", rename_all = "snake_case")]
pub enum Record {
    /// Record of a reconstruction of voxels.
    Volume(Run),
    /// Record of a reconstruction of a transfer function.
    Transfer(TransferRun),
}

impl Record {
    /// Reads the record of a run.
    ///
    /// # Errors
    /// If the file is none.
    pub(crate) fn read(path: &Path, limits: Limits) -> Result<Self> {
        let text = input::bytes(path, MAX_BYTES, "the record of a run").map_err(|e| match e.io_kind() {
            Some(ErrorKind::NotFound) => e.hint("the folder must be one that cumulo reconstruct ⟨report⟩ has written"),
            _ => e,
        })?;
        input::check_json_memory(&text, limits)?;
        serde_json::from_slice(&text).map_err(|e| {
            Error::invalid(format!("this is no record of a run: {e}"))
                .hint("the file is damaged or of another version; make the reconstruction again with ⟨report⟩")
        })
    }

    /// Returns the path of the pictures' transforms.json.
    pub(crate) fn capture(&self) -> &Path {
        match self {
            Self::Volume(run) => &run.capture,
            Self::Transfer(run) => &run.capture,
        }
    }
}

/// Name and capture of other renders to show beside the program's own.
pub type ExtraRenders = (String, Capture);

/// Largest size of a record in bytes; one of a hundred thousand iterations takes less.
const MAX_BYTES: u64 = 1 << 26;

/// Writes the page of a volume and its record, and returns the page's path. Once the work is to stop, views are left
/// out that are not rendered yet.
///
/// # Errors
/// If the volume or the pictures cannot be read, or the files cannot be written.
pub(crate) fn write(dir: &Path, run: &Run, limits: Limits, cancel: &Cancel) -> Result<PathBuf> {
    keep(dir, &Record::Volume(Run { capture: absolute(&run.capture), output: absolute(&run.output), ..run.clone() }))?;
    volume::page(run, limits, None, None, cancel)?.0.write(dir)
}

/// Writes the page of a transfer function, with views that were rendered already, and its record; returns the page's
/// path.
///
/// # Errors
/// If the function cannot be read, or the files cannot be written.
pub(crate) fn write_transfer(dir: &Path, run: &TransferRun, views: Vec<transfer::View>) -> Result<PathBuf> {
    keep(dir, &Record::Transfer(run.with_paths(absolute)))?;
    transfer::page(run, views, None)?.0.write(dir)
}

fn absolute(path: &Path) -> PathBuf {
    std::fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf())
}

fn keep(dir: &Path, record: &Record) -> Result<()> {
    let text = serde_json::to_vec_pretty(record).map_err(|e| Error::invalid(e.to_string()))?;
    let path = dir.join(RECORD);
    atomic::write_bytes(&path, &text)
}

/// Reads the picture of other renders whose camera stands where `camera` does, and returns it with their name; none if
/// there is none.
fn extra(beside: Option<&ExtraRenders>, camera: &Camera, limits: Limits) -> Result<Option<(String, Film)>> {
    let near = 1e-6 * (1.0 + camera.position().length());
    let Some((name, capture)) = beside else { return Ok(None) };
    let stands = |f: &&Frame| f.camera.camera_to_world.abs_diff_eq(camera.camera_to_world, near);
    let picture = |f: &Frame| photos::picture(&f.picture, None, capture, limits);
    let film = capture.frames.iter().find(stands).map(picture).transpose()?;
    Ok(film.map(|film| (name.clone(), film)))
}
