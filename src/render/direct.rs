//! Direct volume rendering of a scene, whose kind of volume is known while the program runs.

use crate::error::{Error, Result};
use crate::render::composited::Composited;
use crate::render::dvr::Dvr;
use crate::render::film::{self, Aov, Rendered, Sampling, View};
use crate::render::labels::Labels;
use crate::render::preshaded::Preshaded;
use crate::render::quadrature::Quadrature;
use crate::render::tiles::Watch;
use crate::scene::scene::Scene;
use crate::scene::shading::Shading;
use crate::scene::volume::Volume;

/// A direct volume renderer over the scene's environment.
#[derive(Debug)]
#[allow(clippy::large_enum_variant, reason = "there is one at a time")]
pub enum DirectRenderer<'a> {
    /// Renderer of a density.
    Density(Composited<Dvr<'a, f32>>),
    /// Renderer of a volume of labels.
    Labels(Composited<Labels<'a>>),
    /// Renderer of a pre-shaded volume.
    PreShaded(Composited<Preshaded<'a, f32>>),
}

impl<'a> DirectRenderer<'a> {
    /// Creates the renderer of a scene; pre-shaded volumes have a quadrature of their own, and labels need none.
    ///
    /// # Errors
    /// If the scene has not one volume, or its medium cannot be rendered.
    pub fn new(scene: &'a Scene, quadrature: Quadrature) -> Result<Self> {
        let background = scene.environment.radiance;
        match &scene.volumes[..] {
            [Volume::Density(field, medium)] if medium.labels().is_some() => {
                if medium.scatters() {
                    return Err(Error::unsupported("along straight rays labels absorb and emit, the medium scatters")
                        .hint("set its albedo to 0"));
                }
                Ok(Self::Labels(Labels::new(field, medium)?.over(background)))
            }
            [Volume::Density(field, medium)] => {
                let medium = medium.simplified(f32::EPSILON.into());
                Ok(Self::Density(Dvr::new(field, medium)?.quadrature(quadrature).over(background)))
            }
            [Volume::PreShaded(volume)] => Ok(Self::PreShaded(Preshaded::new(volume).over(background))),
            // All that its medium absorbs is part of the grid.
            [Volume::Emissive { emission, .. }] => {
                Ok(Self::PreShaded(Preshaded::new(emission.grid()).over(background)))
            }
            volumes => Err(Error::unsupported(format!("the scene has {} volumes, one can be rendered", volumes.len()))
                .hint("render them one by one")),
        }
    }

    /// Returns the default quadrature of a scene.
    pub fn usual_quadrature(scene: &Scene) -> Quadrature {
        match &scene.volumes[..] {
            [Volume::Density(_, medium)] if medium.labels().is_none() => Quadrature::usual(&medium.source),
            _ => Quadrature::Exact,
        }
    }

    /// Shades the surfaces of labels as [`Labels::shaded`] does; other renderers stay as they are.
    ///
    /// # Errors
    /// If a number of the shading cannot be used.
    pub fn shaded_labels(self, shading: (Shading, f64)) -> Result<Self> {
        match self {
            Self::Labels(Composited { medium, background }) => {
                Ok(Self::Labels(Composited { medium: medium.shaded(shading)?, background }))
            }
            other => Ok(other),
        }
    }

    /// Ends rays once their transmittance is below this.
    #[must_use]
    pub fn early_stop(self, transmittance: f64) -> Self {
        match self {
            Self::Density(light) => Self::Density(light.with(|dvr| dvr.early_stop(transmittance))),
            Self::Labels(light) => Self::Labels(light.with(|labels| labels.early_stop(transmittance))),
            Self::PreShaded(light) => Self::PreShaded(light.with(|volume| volume.early_stop(transmittance))),
        }
    }

    /// Allows exact quadrature this radiance error a piece, in units of the brightest color; the quadrature of
    /// pre-shaded volumes stays as it is.
    #[must_use]
    pub fn tolerance(self, tolerance: f64) -> Self {
        match self {
            Self::Density(light) => Self::Density(light.with(|dvr| dvr.tolerance(tolerance))),
            Self::Labels(_) | Self::PreShaded(_) => self,
        }
    }

    /// Returns a bound of the change that ending rays early makes in any channel of a pixel.
    pub fn left_out(&self) -> f64 {
        match self {
            Self::Density(dvr) => dvr.left_out(),
            Self::Labels(labels) => labels.left_out(),
            Self::PreShaded(volume) => volume.left_out(),
        }
    }

    /// Returns the radiance that the errors of pre-integration and of the early stop are fractions of: the brightest of
    /// medium and background, at least the 1 of alpha.
    pub fn unit(&self) -> f64 {
        match self {
            Self::Density(dvr) => dvr.unit(),
            Self::Labels(labels) => labels.unit(),
            Self::PreShaded(volume) => volume.unit(),
        }
    }

    /// Returns a bound of the error that the quadrature makes in any channel of a pixel; `None` where none is stated.
    pub fn quadrature_error(&self) -> Option<f64> {
        match self {
            Self::Density(dvr) => dvr.quadrature_error(),
            // Their light has a closed form.
            Self::Labels(_) => Some(0.0),
            Self::PreShaded(_) => None,
        }
    }

    /// Renders a picture as [`film::render`] does.
    pub fn render<'c, 'w>(
        &self,
        view: impl Into<View<'c>>,
        sampling: Sampling,
        aovs: &[Aov],
        watch: impl Into<Watch<'w>>,
    ) -> Option<Rendered> {
        match self {
            Self::Density(dvr) => film::render(dvr, view, sampling, aovs, watch),
            Self::Labels(labels) => film::render(labels, view, sampling, aovs, watch),
            Self::PreShaded(volume) => film::render(volume, view, sampling, aovs, watch),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use crate::math::Affine;
    use crate::scene::bricks::{Bricks, Topology};
    use crate::scene::medium::{Medium, Scattering};
    use crate::scene::phase::Phase;
    use glam::{DVec3, IVec3};
    use std::sync::Arc;

    #[test]
    fn what_cannot_be_rendered_is_refused_with_words() {
        let topology = Arc::new(Topology::new([IVec3::ZERO]).unwrap());
        let field = Bricks::zeros(topology, Affine::uniform(1.0, DVec3::ZERO).unwrap());
        let volume = |medium: Medium| Volume::Density(field.clone(), medium);
        let refused = |volumes: Vec<Volume>| {
            let scene = Scene { volumes, ..Scene::default() };
            DirectRenderer::new(&scene, Quadrature::Exact).map(|_| ()).map_err(|e| e.to_string())
        };
        let dark = || volume(Medium::absorbing(1.0));
        assert_eq!(refused(vec![dark()]), Ok(()));
        assert!(refused(vec![]).unwrap_err().contains("0 volumes"));
        assert!(refused(vec![dark(), dark()]).unwrap_err().contains("2 volumes"));
        let scattering = Some(Scattering::new([0.0, 0.5, 0.0], Phase::HenyeyGreenstein(0.3)));
        assert!(
            refused(vec![volume(Medium { scattering, ..Medium::absorbing(1.0) })]).unwrap_err().contains("scatters")
        );
    }
}
