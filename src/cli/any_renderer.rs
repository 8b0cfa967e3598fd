//! Either kind of renderer that a command may need.

use crate::render;
use crate::render::aov::{self, Aov};
use crate::render::composited::Composited;
use crate::render::dvr::Dvr;
use crate::render::preshaded::Preshaded;
use crate::scene::camera::Camera;
use crate::scene::film::Film;
use std::sync::atomic::AtomicBool;

/// A renderer of densities or of a pre-shaded volume, over a background.
#[derive(Debug)]
pub enum AnyRenderer<'a> {
    /// Renderer of a density with its medium.
    Density(Composited<Dvr<'a, f32>>),
    /// Renderer of a pre-shaded volume.
    PreShaded(Composited<Preshaded<'a, f32>>),
}

impl AnyRenderer<'_> {
    /// Has rays end once their transmittance is below the given one.
    #[must_use]
    pub fn early_stop(self, transmittance: f64) -> Self {
        match self {
            Self::Density(dvr) => Self::Density(dvr.with(|dvr| dvr.early_stop(transmittance))),
            Self::PreShaded(volume) => Self::PreShaded(volume.with(|volume| volume.early_stop(transmittance))),
        }
    }

    /// Returns the bound of the error in any channel of a pixel that the early end of rays makes.
    pub fn left_out(&self) -> f64 {
        match self {
            Self::Density(dvr) => dvr.left_out(),
            Self::PreShaded(volume) => volume.left_out(),
        }
    }

    /// Renders a picture as [`aov::picture_with`] does.
    pub fn picture_with(
        &self,
        camera: &Camera,
        rays_per_edge: usize,
        aovs: &[Aov],
        cancel: &AtomicBool,
    ) -> Option<Film> {
        match self {
            Self::Density(dvr) => aov::picture_with(dvr, camera, rays_per_edge, aovs, cancel),
            Self::PreShaded(volume) => aov::picture_with(volume, camera, rays_per_edge, aovs, cancel),
        }
    }

    /// Renders a picture as [`render::picture`] does.
    pub fn picture(&self, camera: &Camera, rays_per_edge: usize, cancel: &AtomicBool) -> Option<Film> {
        match self {
            Self::Density(dvr) => render::picture(dvr, camera, rays_per_edge, cancel),
            Self::PreShaded(volume) => render::picture(volume, camera, rays_per_edge, cancel),
        }
    }
}
