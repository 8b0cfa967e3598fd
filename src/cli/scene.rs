//! Either kind of volume that a command may be given.

use super::any_renderer::AnyRenderer;
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::formats::vdb::{File, shaded};
use crate::render::dvr::Dvr;
use crate::render::preshaded::Preshaded;
use crate::render::quadrature::Quadrature;
use crate::scene::bricks::Bricks;
use crate::scene::capture::Capture;
use glam::Vec4;
use rayon::prelude::*;
use std::borrow::Cow;
use std::path::Path;

/// A volume to render.
#[derive(Debug)]
pub enum Scene {
    /// Densities, whose extinction and source follow from the capture's medium.
    Density(Bricks<f32>),
    /// Emissions in R, G and B, and extinctions, of a pre-shaded volume.
    PreShaded(Bricks<Vec4>),
}

impl Scene {
    /// Reads a pre-shaded volume; `name` is the name of the grid of extinctions.
    ///
    /// # Errors
    /// If it cannot be read or used.
    pub fn pre_shaded(path: &Path, name: Option<&str>, limits: Limits) -> Result<Self> {
        Ok(Self::PreShaded(shaded::read(&File::open(path, limits)?, name, limits.max_memory)?))
    }

    /// Returns the field that the optical depth integrates: densities, or the extinctions of a pre-shaded volume.
    pub fn extinctions(&self) -> Cow<'_, Bricks<f32>> {
        match self {
            Self::Density(field) => Cow::Borrowed(field),
            Self::PreShaded(volume) => Cow::Owned(volume.channel(3)),
        }
    }

    /// Returns a renderer of the volume with the medium and background of a capture. Extinctions and emissions of a
    /// pre-shaded volume are scaled in place.
    ///
    /// # Errors
    /// If the capture's medium or density scale cannot be used.
    pub fn renderer(&mut self, capture: &Capture, quadrature: Quadrature) -> Result<AnyRenderer<'_>> {
        Ok(match self {
            Self::Density(field) => AnyRenderer::Density(
                Dvr::new(field, capture.medium()?)?.quadrature(quadrature).over(capture.background),
            ),
            Self::PreShaded(volume) => {
                scale(volume, capture.density_scale)?;
                AnyRenderer::PreShaded(Preshaded::new(volume).over(capture.background))
            }
        })
    }
}

/// Scales the extinctions of a pre-shaded volume, and its emissions with them, so that their ratios, the colors, stay.
///
/// # Errors
/// If they become too large.
pub fn scale(volume: &mut Bricks<Vec4>, factor: f64) -> Result<()> {
    volume.values.par_iter_mut().for_each(|v| *v *= factor as f32);
    if volume.values.par_iter().all(|v| v.is_finite()) {
        return Ok(());
    }
    Err(Error::invalid(format!(
        "density scale {factor:e} makes emissions or extinctions too large for single precision"
    ))
    .hint("give a smaller --density-scale, or correct the capture's density_scale"))
}
