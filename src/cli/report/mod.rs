//! `cumulo report`: the page of a reconstruction, made again with more beside it.

pub mod transfer;
mod volume;

use super::memory::Memory;
use super::output::Output;
use crate::app::Context;
use crate::app::outputs::Content;
pub use crate::app::outputs::{RECORD, report_folder as prepare};
use crate::app::photos;
use crate::app::run::Run;
use crate::app::task::Task;
use crate::cancel::Cancel;
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::formats::transfer::Options;
use crate::formats::vdb::File;
use crate::formats::{self, atomic, captures, input};
use crate::scene::camera::Camera;
use crate::scene::capture::{Capture, Frame};
use crate::scene::film::Film;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use transfer::{FunctionError, TransferRun};
use volume::VolumeError;

/// Make the page of a reconstruction again, with what is true or other renders beside it
#[derive(Debug, clap::Args)]
pub struct Report {
    /// Folder that `reconstruct --report` wrote
    folder: PathBuf,
    /// Volume, or transfer function, to compare with
    #[arg(long, value_name = "IN.vdb|TF")]
    reference: Option<PathBuf>,
    /// Renders of the result from the same cameras, shown beside the program's own: a name for them and their capture
    #[arg(long, value_name = "NAME=CAPTURE", value_parser = named)]
    beside: Option<(String, PathBuf)>,
    #[command(flatten)]
    pub(in crate::cli) memory: Memory,
}

fn named(text: &str) -> Result<(String, PathBuf), String> {
    match text.split_once('=') {
        Some((name, path)) if !name.is_empty() && !path.is_empty() => Ok((name.into(), path.into())),
        _ => Err(format!("'{text}' is not NAME=CAPTURE")),
    }
}

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
    /// Returns the path of the pictures' transforms.json.
    fn capture(&self) -> &Path {
        match self {
            Self::Volume(run) => &run.capture,
            Self::Transfer(run) => &run.capture,
        }
    }
}

#[derive(Debug, Serialize, schemars::JsonSchema)]
pub(in crate::cli) struct Written {
    #[serde(serialize_with = "crate::app::paths::text")]
    report: PathBuf,
    /// Error of the volume against `--reference`.
    #[serde(skip_serializing_if = "Option::is_none")]
    volume: Option<VolumeError>,
    /// Error of the transfer function against `--reference`.
    #[serde(skip_serializing_if = "Option::is_none")]
    transfer: Option<FunctionError>,
}

impl fmt::Display for Written {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.report.display())
    }
}

/// Name and capture of other renders to show beside the program's own.
type Beside = (String, Capture);

/// Begins a long task, once its output and the folder of its page are known to have fitting names and to be writable.
///
/// # Errors
/// Those of [`Task::begin`] and [`prepare`].
pub fn begin(
    output: &Path,
    content: Content,
    page: Option<&Path>,
    (memory, context): (Memory, &Context),
) -> Result<Task> {
    let task = Task::begin(output, content, memory.limits(), context)?;
    page.map_or(Ok(()), prepare)?;
    Ok(task)
}

impl Report {
    /// Paths that the command reads.
    pub(in crate::cli) fn inputs(&self) -> Vec<&Path> {
        self.named_files().collect()
    }

    /// Reads the record, renders, writes the page and says where it is.
    ///
    /// # Errors
    /// If the record, the volumes or the pictures cannot be read, or the page cannot be written.
    pub fn run(&self, output: &Output) -> Result<ExitCode> {
        let limits = self.memory.limits();
        let _stage = output.stage("report");
        let path = self.folder.join(RECORD);
        let record = read_record(&path, limits).map_err(|e| e.at(&path))?;
        let beside = match &self.beside {
            Some((name, path)) => Some((name.clone(), captures::load_within(path, limits)?)),
            None => None,
        };
        // What the record names may be elsewhere by now, or never have been there.
        let folder = record.capture().parent().map(Path::to_path_buf);
        let named = |e: Error| {
            let within = |folder: &Path| e.path().is_some_and(|path| path.starts_with(folder));
            match self.named_files().any(within) && !folder.as_deref().is_some_and(within) {
                true => e,
                false => e.inside(format!("named in {}", path.display())),
            }
        };
        let written = match &record {
            Record::Volume(run) => {
                let reference = self.reference.as_deref().map(|path| File::open(path, limits)?.read_fog(None));
                let (page, volume) =
                    volume::page(run, limits, reference.transpose()?.as_ref(), beside.as_ref(), Cancel::NEVER)
                        .map_err(named)?;
                Written { report: page.write(&self.folder)?, volume, transfer: None }
            }
            Record::Transfer(run) => {
                let options = Options { limits, ..Options::default() };
                let reference = self.reference.as_deref().map(|path| formats::transfer::load(path, &options));
                let reference = reference.transpose()?.map(|loaded| loaded.transfer);
                let views = transfer::views(run, &run.shown, limits, beside.as_ref(), Cancel::NEVER).map_err(named)?;
                let (page, function) = transfer::page(run, views, reference.as_ref())?;
                Written { report: page.write(&self.folder)?, volume: None, transfer: function }
            }
        };
        output.report(&written)?;
        Ok(ExitCode::SUCCESS)
    }
}

impl Report {
    /// Returns the files that the command line names beside the record's folder.
    fn named_files(&self) -> impl Iterator<Item = &Path> {
        let beside = self.beside.as_ref().map(|(_, path)| path.as_path());
        self.reference.as_deref().into_iter().chain(beside)
    }
}

/// Largest size of a record in bytes; one of a hundred thousand iterations takes less.
const MAX_BYTES: u64 = 1 << 26;

/// Reads the record of a run.
fn read_record(path: &Path, limits: Limits) -> Result<Record> {
    let text = input::bytes(path, MAX_BYTES, "the record of a run").map_err(|e| match e.io_kind() {
        Some(ErrorKind::NotFound) => e.hint("the folder must be one that cumulo reconstruct --report has written"),
        _ => e,
    })?;
    input::check_json_memory(&text, limits)?;
    serde_json::from_slice(&text).map_err(|e| {
        Error::invalid(format!("this is no record of a run: {e}"))
            .hint("the file is damaged or of another version; make the reconstruction again with --report")
    })
}

/// Writes the page of a volume and its record, and returns the page's path. Once the work is to stop, views are left
/// out that are not rendered yet.
///
/// # Errors
/// If the volume or the pictures cannot be read, or the files cannot be written.
pub fn write(dir: &Path, run: &Run, limits: Limits, cancel: Cancel) -> Result<PathBuf> {
    keep(dir, &Record::Volume(Run { capture: absolute(&run.capture), output: absolute(&run.output), ..run.clone() }))?;
    volume::page(run, limits, None, None, cancel)?.0.write(dir)
}

/// Writes the page of a transfer function, with views that were rendered already, and its record; returns the page's
/// path.
///
/// # Errors
/// If the function cannot be read, or the files cannot be written.
pub fn write_transfer(dir: &Path, run: &TransferRun, views: Vec<transfer::View>) -> Result<PathBuf> {
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
fn extra(beside: Option<&Beside>, camera: &Camera, limits: Limits) -> Result<Option<(String, Film)>> {
    let near = 1e-6 * (1.0 + camera.position().length());
    let Some((name, capture)) = beside else { return Ok(None) };
    let stands = |f: &&Frame| f.camera.camera_to_world.abs_diff_eq(camera.camera_to_world, near);
    let picture = |f: &Frame| photos::picture(&f.picture, None, capture, limits);
    let film = capture.frames.iter().find(stands).map(picture).transpose()?;
    Ok(film.map(|film| (name.clone(), film)))
}
