//! The transfer function that a use case works with.

use crate::error::Result;
use crate::formats::limits::Limits;
use crate::formats::transfer::{self, Function, Options};
use crate::scene::transfer::Transfer;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// A transfer function, and how it is read.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct TransferSettings {
    /// A .tf.json, a color map preset of ParaView (JSON, XML), a VDB that carries one, or a name such as viridis,
    /// cool-warm or ct-bone; none for that of the volume or of the capture.
    #[serde(with = "crate::app::paths")]
    pub tf: Option<PathBuf>,
    /// Which of several: the preset of this name, in a VDB that of this grid; none for the first.
    pub tf_preset: Option<String>,
    /// Range that its densities are mapped to; none to leave them.
    pub tf_range: Option<[f64; 2]>,
    /// World length that the opacities of a preset are for; none for 1.
    pub tf_unit_distance: Option<f64>,
    /// Extinction per world unit at the upper end of a color map or preset without opacities; none for 1.
    pub tf_extinction: Option<f64>,
}

impl TransferSettings {
    /// Returns the file of the function; `None` if there is none, or it has a name that no file holds.
    pub(crate) fn file(&self) -> Option<&Path> {
        self.tf.as_deref().and_then(transfer::file)
    }

    /// Loads the transfer function, if one is stated.
    ///
    /// # Errors
    /// Those of [`transfer::load`].
    pub(crate) fn load(&self, limits: Limits) -> Result<Option<Transfer>> {
        self.function(limits).map(|function| function.map(|function| function.transfer))
    }

    /// Loads the transfer function, with the albedo that it may have, if one is stated.
    ///
    /// # Errors
    /// Those of [`transfer::load`].
    pub(crate) fn function(&self, limits: Limits) -> Result<Option<Function>> {
        let Some(path) = &self.tf else { return Ok(None) };
        transfer::load(path, &self.options(limits)).map(|loaded| Some(loaded.function()))
    }

    /// Returns the unit of the function's densities, such as `HU`; empty where it is not known.
    pub(crate) fn unit(&self) -> &'static str {
        let name = self.tf.as_deref().filter(|path| self.tf_range.is_none() && transfer::file(path).is_none());
        name.and_then(transfer::unit).unwrap_or_default()
    }

    /// Returns the options that the function is read with.
    pub(crate) fn options(&self, limits: Limits) -> Options {
        Options {
            preset: self.tf_preset.clone(),
            range: self.tf_range,
            unit_distance: self.tf_unit_distance,
            extinction: self.tf_extinction,
            limits,
        }
    }
}
