//! `cumulo try-grid`: reads a grid and drops it, in a process of its own; see [`crate::formats::vdb::helper`].

use crate::error::Error;
use crate::formats::limits::Limits;
use crate::formats::vdb::File;
use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

/// Read a grid and drop it
#[derive(Debug, clap::Args)]
pub struct TryGrid {
    file: PathBuf,
    grid: String,
    pub(super) max_memory: u64,
}

impl TryGrid {
    /// Reads the grid, and prints an error on standard error without the file's name, which the calling process knows.
    pub(super) fn run(&self) -> ExitCode {
        let _ = rustix::process::setrlimit(
            rustix::process::Resource::Core,
            rustix::process::Rlimit { current: Some(0), maximum: Some(0) },
        );
        let what = |error: Error| error.what().to_owned();
        let limits = Limits { max_memory: self.max_memory };
        match File::open(&self.file, limits).and_then(|file| file.try_grid(&self.grid)).map_err(what) {
            Ok(()) => ExitCode::SUCCESS,
            Err(what) => {
                let _ = write!(std::io::stderr(), "{what}");
                ExitCode::from(2)
            }
        }
    }
}
