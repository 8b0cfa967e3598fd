//! `cumulo try-grid`: reads a grid and drops it, in a process of its own; see [`crate::formats::vdb::helper`].

use super::output::Output;
use super::run::Run;
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::formats::vdb;
use std::io::{Read, Write};

/// Read a grid on standard input and drop it
#[derive(Debug, clap::Args)]
pub(crate) struct TryGrid {
    max_memory: u64,
}

impl Run for TryGrid {
    fn max_memory(&self) -> Result<u64> {
        Ok(self.max_memory)
    }

    /// Reads the grid, and prints an error on standard error without the file's name, which the calling process knows.
    fn run(&self, _: &Output) -> Result<u8> {
        let _ = rustix::process::setrlimit(
            rustix::process::Resource::Core,
            rustix::process::Rlimit { current: Some(0), maximum: Some(0) },
        );
        let limits = Limits { max_memory: self.max_memory };
        let mut bytes = Vec::new();
        let read = std::io::stdin().lock().take(self.max_memory).read_to_end(&mut bytes).map_err(Error::system);
        Ok(match read.and_then(|_| vdb::try_grid(bytes, limits)) {
            Ok(()) => 0,
            Err(error) => {
                let _ = write!(std::io::stderr(), "{}", error.what());
                2
            }
        })
    }
}
