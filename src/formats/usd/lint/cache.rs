//! Files of fields, each read once.

use crate::error::Error;
use crate::formats::limits::Limits;
use crate::formats::usd::fields::{self, GridField};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Grids of files that were read, or the error that kept one from being read.
pub(super) struct Files {
    limits: Limits,
    read: BTreeMap<PathBuf, Result<Vec<GridField>, Error>>,
}

impl Files {
    pub(super) fn new(limits: Limits) -> Self {
        Self { limits, read: BTreeMap::new() }
    }

    /// Returns the grids of a file.
    pub(super) fn fields(&mut self, path: &Path) -> &Result<Vec<GridField>, Error> {
        let limits = self.limits;
        self.read.entry(path.to_path_buf()).or_insert_with(|| fields::read(path, limits))
    }
}
