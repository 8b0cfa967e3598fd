//! Reconstructions as the one task of a job: each step of the search needs all pictures.

use super::{ColorSettings, DensitySettings, TransferFunctionSettings};
use crate::app::Context;
use crate::app::job::{Divisible, Work};
use crate::error::Result;
use std::path::Path;

impl Divisible for DensitySettings {
    fn work(&self, _: &Context) -> Result<Work> {
        Ok(Work::Whole)
    }

    fn inputs(&self) -> Vec<&Path> {
        Self::inputs(self)
    }

    fn resumes(&self) -> bool {
        self.init.is_none() && self.refinement.refine_cameras.is_none()
    }
}

impl Divisible for ColorSettings {
    fn work(&self, _: &Context) -> Result<Work> {
        Ok(Work::Whole)
    }

    fn inputs(&self) -> Vec<&Path> {
        Self::inputs(self)
    }

    fn resumes(&self) -> bool {
        self.init.is_none()
    }
}

impl Divisible for TransferFunctionSettings {
    fn work(&self, _: &Context) -> Result<Work> {
        Ok(Work::Whole)
    }

    fn inputs(&self) -> Vec<&Path> {
        Self::inputs(self)
    }

    fn resumes(&self) -> bool {
        self.init.is_none()
    }
}
