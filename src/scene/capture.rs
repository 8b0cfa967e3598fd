//! A multi-view capture: cameras, their pictures, and the known parameters of the image formation.

use crate::error::{Error, Result};
use crate::scene::camera::Camera;
use crate::scene::color_space::ColorSpace;
use crate::scene::medium::{Medium, Source};
use crate::scene::transfer::Transfer;
use glam::DMat4;
use std::path::PathBuf;
use std::sync::Arc;

/// Light model of a capture's pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Model {
    /// Absorption alone: `L = T · background`.
    Absorption,
    /// Emission and absorption: `L = ∫ T σ c dt + T · background`.
    EmissionAbsorption,
    /// Pre-shaded volume: `L = ∫ T e dt + T · background`, with a grid of emitted radiance e per length beside that of
    /// extinction.
    PreShaded,
    /// Emission, absorption and scattering, by path tracing. Of such pictures reconstructions take the densities from
    /// alpha alone.
    Scattering,
}

/// Dependence of the source's radiance on the density.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum EmissionModel {
    /// Constant radiance, independent of the density.
    Grey,
    /// Radiance proportional to the density.
    Linear,
}

/// Reconstruction filter: how a pixel's value derives from the radiance over its area.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum PixelFilter {
    /// Radiance along the ray through the pixel's centre.
    Point,
    /// Mean over the pixel's square (Cycles with its box filter).
    Box,
}

/// Origin of the pictures of a capture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Pictures {
    /// Renders: the background is the stated one, and the light is that of the model.
    Renders,
    /// Photographs, and frames of videos, of a real medium: black is what the camera made of it, and the light of the
    /// medium follows the model about.
    Photographs,
}

/// One view of a capture.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Camera of the view.
    pub camera: Camera,
    /// Picture file, with its path resolved against the capture's folder.
    pub picture: PathBuf,
}

/// A set of views of one volume.
#[derive(Debug, Clone, PartialEq)]
pub struct Capture {
    /// Views in file order.
    pub frames: Vec<Frame>,
    /// Light model of the pictures; absorption unless stated.
    pub model: Model,
    /// Radiance behind the volume; white unless stated.
    pub background: [f32; 3],
    /// Pixel filter of the pictures; point samples unless stated.
    pub pixel_filter: PixelFilter,
    /// Extinction per unit of density and world length with which the pictures were made; 1 unless stated. A
    /// reconstruction divides by it.
    pub density_scale: f64,
    /// Radiance of the source per color channel (emission-absorption only); white unless stated.
    pub emission: [f32; 3],
    /// Dependence of `emission` on the density; constant unless stated.
    pub emission_model: EmissionModel,
    /// Transfer function from density to color and extinction (emission-absorption only). It replaces `emission`;
    /// `density_scale` multiplies its extinction.
    pub transfer: Option<Transfer>,
    /// Index-to-world map of the voxel lattice of the pictured volume, where the capture states it.
    pub lattice: Option<DMat4>,
    /// Color space of pictures with integer samples; `None` where it is not stated. Pictures with floating-point
    /// samples are scene-linear.
    pub color_space: Option<ColorSpace>,
    /// Origin of the pictures; they count as renders unless it is stated.
    pub pictures: Option<Pictures>,
    /// Remarks about what the capture's file states and has no effect here; empty for captures from elsewhere.
    pub remarks: Vec<String>,
}

impl Capture {
    /// A capture that states nothing but its views: pictures of an absorber before white.
    pub fn of_frames(frames: Vec<Frame>) -> Self {
        Self {
            frames,
            model: Model::Absorption,
            background: [1.0; 3],
            pixel_filter: PixelFilter::Point,
            density_scale: 1.0,
            emission: [1.0; 3],
            emission_model: EmissionModel::Grey,
            transfer: None,
            lattice: None,
            color_space: None,
            pictures: None,
            remarks: Vec::new(),
        }
    }

    /// Returns the capture of what alpha alone tells of the medium, as [`Film::by_alpha`] shows it.
    ///
    /// [`Film::by_alpha`]: crate::scene::film::Film::by_alpha
    #[must_use]
    pub fn by_alpha(&self) -> Self {
        Self { model: Model::Absorption, background: [1.0; 3], transfer: None, ..self.clone() }
    }

    /// Number of pixels of all pictures.
    pub fn pixels(&self) -> u64 {
        self.frames.iter().map(|frame| u64::from(frame.camera.width) * u64::from(frame.camera.height)).sum()
    }

    /// Medium that the pictures show.
    ///
    /// # Errors
    /// If the transfer function cannot be used, or the volume is pre-shaded, so that its emission is no function of the
    /// density, or the medium scatters.
    pub fn medium(&self) -> Result<Medium> {
        let source = match (self.model, &self.transfer, self.emission_model) {
            (Model::Absorption, ..) => Source::Grey([0.0; 3]),
            (Model::PreShaded, ..) => {
                return Err(Error::unsupported("the pictures show a pre-shaded volume, whose colors no density tells")
                    .hint("`cumulo reconstruct color` finds such volumes"));
            }
            (Model::Scattering, ..) => {
                return Err(Error::unsupported("the pictures show a medium that scatters light").hint(
                    "give pictures of absorption and emission; of these, `cumulo reconstruct density` finds the \
                         densities by alpha, and `cumulo reconstruct color` the light as emission",
                ));
            }
            (_, Some(transfer), _) => Source::Transfer(Arc::new(transfer.table()?)),
            (_, None, EmissionModel::Grey) => Source::Grey(self.emission),
            (_, None, EmissionModel::Linear) => Source::Linear(self.emission),
        };
        Ok(Medium::new(self.density_scale, source))
    }
}
