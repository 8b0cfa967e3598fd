//! All that pictures depend on beside the voxels, as a study of gradients changes it.

use crate::error::Result;
use crate::render::quadrature::Quadrature;
use crate::scene::camera::Camera;
use crate::scene::medium::{Medium, Source};
use crate::scene::transfer::Transfer;
use std::sync::Arc;

/// Parameters of pictures besides the voxels. Pictures of a pre-shaded volume depend on cameras and background alone.
#[derive(Debug, Clone)]
pub struct Setting {
    /// Cameras of the pictures.
    pub cameras: Vec<Camera>,
    /// Extinction per unit of density.
    pub extinction: f64,
    /// Radiance of the source where there is no transfer function.
    pub source: Source,
    /// Color and extinction by density.
    pub transfer: Option<Transfer>,
    /// Radiance behind the volume.
    pub background: [f32; 3],
    /// Integration along rays.
    pub quadrature: Quadrature,
}

impl Setting {
    /// Returns the medium of the densities.
    ///
    /// # Errors
    /// As [`Transfer::table`].
    pub fn medium(&self) -> Result<Medium> {
        let source = match &self.transfer {
            Some(transfer) => Source::Transfer(Arc::new(transfer.table()?)),
            None => self.source.clone(),
        };
        Ok(Medium::new(self.extinction, source))
    }
}

/// Units of priors, which stay when voxels and functions change.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Units {
    /// The density that stands for 1.
    pub density: f64,
    /// The extinction that does.
    pub extinction: f64,
}
