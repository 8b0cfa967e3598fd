//! Volumes: grids by their role, and the medium that they describe.

use crate::error::{Error, Result};
use crate::math::Aabb;
use crate::scene::bricks::Bricks;
use crate::scene::capture::Capture;
use crate::scene::emission::Emitted;
use crate::scene::medium::{Medium, Source};
use crate::scene::table::Table;
use glam::{DVec3, Vec4};
use rayon::prelude::*;
use std::borrow::Cow;

/// The grids of a volume, by their role.
#[derive(Debug, Clone)]
pub enum Grids {
    /// A density, of which extinction and emission are functions.
    Density(Bricks<f32>),
    /// The radiance emitted per world length, in red, green and blue, and the extinction per world length: a pre-shaded
    /// volume.
    EmissionExtinction(Bricks<Vec4>),
}

impl Grids {
    /// Returns the grid that the optical depth is proportional to, or a function of: the density or the extinction.
    pub fn density_or_extinction(&self) -> Cow<'_, Bricks<f32>> {
        match self {
            Self::Density(field) => Cow::Borrowed(field),
            Self::EmissionExtinction(volume) => Cow::Owned(volume.channel(3)),
        }
    }

    /// Returns the volume that the pictures of a capture show. The capture's density scale multiplies extinctions and
    /// emissions of a pre-shaded volume: colors stay.
    ///
    /// # Errors
    /// If the capture's medium or density scale cannot be used.
    pub(crate) fn shown_by(self, capture: &Capture) -> Result<Volume> {
        Ok(match self {
            Self::Density(field) => Volume::Density(field, capture.medium()?),
            Self::EmissionExtinction(mut volume) => {
                scale(&mut volume, capture.density_scale)?;
                Volume::PreShaded(volume)
            }
        })
    }
}

/// A volume.
#[derive(Debug, Clone)]
pub enum Volume {
    /// A density in a medium.
    Density(Bricks<f32>, Medium),
    /// A pre-shaded volume; its grids are all that is to be known of its medium.
    PreShaded(Bricks<Vec4>),
    /// A density in a medium, beside which a grid emits.
    Emissive {
        /// Density.
        density: Bricks<f32>,
        /// Medium of the density.
        medium: Medium,
        /// Emission by the grid.
        emission: Box<Emitted>,
    },
}

impl Volume {
    /// Returns the density and its medium; `None` for a pre-shaded volume.
    pub fn density(&self) -> Option<(&Bricks<f32>, &Medium)> {
        match self {
            Self::Density(field, medium) => Some((field, medium)),
            Self::Emissive { density, medium, .. } => Some((density, medium)),
            Self::PreShaded(_) => None,
        }
    }

    /// Returns the world-space box around the volume.
    pub fn world_bounds(&self) -> Aabb {
        match self {
            Self::Density(field, _) => field.world_bounds(),
            Self::PreShaded(volume) => volume.world_bounds(),
            Self::Emissive { density, emission, .. } => density.world_bounds().union(emission.grid().world_bounds()),
        }
    }

    /// Returns world points around all that may be seen of the volume.
    pub fn outline(&self) -> Vec<DVec3> {
        match self {
            Self::Density(field, Medium { source: Source::Transfer(table), .. }) => outline_through(field, table),
            Self::Density(field, _) | Self::Emissive { density: field, .. } => field.outline(),
            Self::PreShaded(volume) => volume.channel(3).outline(),
        }
    }

    /// Returns the volume without a grid that emits beside its medium.
    #[must_use]
    pub(crate) fn without_emission(self) -> Self {
        match self {
            Self::Emissive { density, medium, .. } => Self::Density(density, medium),
            volume => volume,
        }
    }

    /// Returns the emission by a grid beside the medium.
    pub fn emission(&self) -> Option<&Emitted> {
        match self {
            Self::Emissive { emission, .. } => Some(emission.as_ref()),
            Self::Density(..) | Self::PreShaded(_) => None,
        }
    }
}

/// Returns world points around all that a transfer function shows of a density.
pub fn outline_through(field: &Bricks<f32>, table: &Table) -> Vec<DVec3> {
    let shown = field.outline_of(|value| table.at(field.reference + f64::from(value))[3] > 0.0);
    // What a function shows between two voxels alone lies among them all.
    let points = if shown.is_empty() { field.outline() } else { shown };
    let background = field.reference + f64::from(field.background);
    if table.at(background)[3] == 0.0 || field.domain.is_empty() {
        return points;
    }
    // Bricks of the background, which the function shows, reach beyond the volume's end.
    let Aabb { min, max } = field.domain;
    // A box without a volume has no middle that a camera could look at.
    if (max - min).min_element() <= 0.0 {
        return points;
    }
    let within = |point: DVec3| field.transform.to_world(field.transform.to_index(point).clamp(min, max));
    points.into_iter().map(within).collect()
}

/// Multiplies emissions and extinctions.
///
/// # Errors
/// If they become too large.
pub fn scale(volume: &mut Bricks<Vec4>, by: f64) -> Result<()> {
    volume.values.par_iter_mut().for_each(|v| *v *= by as f32);
    if volume.values.par_iter().all(|v| v.is_finite()) {
        return Ok(());
    }
    Err(Error::invalid(format!("density scale {by:e} makes emissions or extinctions too large for single precision"))
        .hint("give a smaller ⟨density_scale⟩, or correct the capture's density_scale"))
}
