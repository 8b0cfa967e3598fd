//! Faults of the composition of stages.

use crate::error::Error;
use crate::formats::problem::Problem;
use std::fmt;
use std::path::{Path, PathBuf};

/// Fault of the composition of a stage, in words.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fault {
    /// Layer that is at fault, where it is not the stage's root layer.
    pub layer: Option<PathBuf>,
    /// Path of the prim that is at fault.
    pub prim: Option<String>,
    /// Description of the fault: what was found, and what was expected.
    pub what: String,
    /// Advice to the user.
    pub remedy: String,
    /// True if a layer or a prim that the stage names is missing from it, so that pictures would lack what it holds.
    pub incomplete: bool,
}

impl Fault {
    /// Creates a fault of something that has no effect, without which the stage is whole.
    pub(super) fn remark(what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { layer: None, prim: None, what: what.into(), remedy: remedy.into(), incomplete: false }
    }

    /// Creates a fault of something that is missing from the stage.
    pub(super) fn missing(what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { incomplete: true, ..Self::remark(what, remedy) }
    }

    /// Names the prim.
    pub(super) fn of_prim(self, path: impl Into<String>) -> Self {
        Self { prim: Some(path.into()), ..self }
    }

    /// Returns the place in the stage: its layer and its prim; `None` if the fault concerns the stage as a whole.
    pub(crate) fn place(&self) -> Option<String> {
        let layer = self.layer.as_ref().map(|layer| format!("layer {}", layer.display()));
        let prim = self.prim.as_ref().map(|prim| format!("prim {prim}"));
        match (layer, prim) {
            (Some(layer), Some(prim)) => Some(format!("{layer}: {prim}")),
            (layer, prim) => layer.or(prim),
        }
    }

    /// Returns the fault as a problem of the stage.
    pub(super) fn problem(&self) -> Problem {
        Problem { part: self.place(), ..Problem::new(&self.what, &self.remedy) }
    }

    /// Returns the fault as an error that names the stage.
    pub(super) fn error(&self, stage: &Path) -> Error {
        let error = Error::invalid(&self.what).hint(&self.remedy).at(stage);
        match self.place() {
            Some(place) => error.part(place),
            None => error,
        }
    }
}

impl fmt::Display for Fault {
    /// Writes place and description on one line, without the remedy.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.place().iter().try_for_each(|place| write!(f, "{place}: "))?;
        f.write_str(&self.what)
    }
}
