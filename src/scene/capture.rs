//! A multi-view capture: cameras, the pictures they took and what is known of how they were made.

use crate::error::{Error, Result};
use crate::scene::camera::Camera;
use crate::scene::medium::{Medium, Source};
use crate::scene::transfer::Transfer;
use glam::DMat4;
use std::path::PathBuf;
use std::sync::Arc;

/// Which light model the pictures show.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Model {
    /// `T · background`.
    Absorption,
    /// `∫ T σ c dt + T · background`.
    EmissionAbsorption,
    /// `∫ T e dt + T · background`, with a grid of emissions e per length beside that of extinctions.
    PreShaded,
}

/// How the source's radiance follows the density.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum EmissionModel {
    /// The same everywhere.
    Grey,
    /// Proportional to the density.
    Linear,
}

/// What a pixel's value is of the radiance that falls on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PixelFilter {
    /// Radiance along the ray through the pixel's centre.
    Point,
    /// Mean over the pixel's square (Cycles with its box filter).
    Box,
}

/// One view.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Where it was taken from.
    pub camera: Camera,
    /// Picture file, resolved against the capture's folder.
    pub picture: PathBuf,
}

/// A set of views of one volume.
#[derive(Debug, Clone, PartialEq)]
pub struct Capture {
    /// Views in file order.
    pub frames: Vec<Frame>,
    /// Light model; absorption unless stated.
    pub model: Model,
    /// Radiance behind the volume; white unless stated.
    pub background: [f32; 3],
    /// Point samples unless stated.
    pub pixel_filter: PixelFilter,
    /// Extinction per unit of density and world length that the pictures were made with; 1 unless
    /// stated. A reconstruction divides it out.
    pub density_scale: f64,
    /// Radiance of the source per channel (emission-absorption only); white unless stated.
    pub emission: [f32; 3],
    /// How that radiance follows the density; constant unless stated.
    pub emission_model: EmissionModel,
    /// Color and extinction by density (emission-absorption only), which then stands in the place of the
    /// source's radiance; `density_scale` multiplies its extinction.
    pub transfer: Option<Transfer>,
    /// Voxel lattice of the volume in the pictures, index to world, where its maker knew it.
    pub lattice: Option<DMat4>,
}

impl Capture {
    /// The medium that the pictures show.
    ///
    /// # Errors
    /// If the transfer function cannot be used, or what is emitted is no function of the density.
    pub fn medium(&self) -> Result<Medium> {
        let source = match (self.model, &self.transfer, self.emission_model) {
            (Model::Absorption, ..) => Source::Grey([0.0; 3]),
            (Model::PreShaded, ..) => {
                return Err(Error::unsupported("the pictures show a pre-shaded volume, whose colors no density tells")
                    .hint("`cumulo reconstruct color` finds such volumes"));
            }
            (_, Some(transfer), _) => Source::Transfer(Arc::new(transfer.table()?)),
            (_, None, EmissionModel::Grey) => Source::Grey(self.emission),
            (_, None, EmissionModel::Linear) => Source::Linear(self.emission),
        };
        Ok(Medium::new(self.density_scale, source))
    }
}
