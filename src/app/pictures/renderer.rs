//! The plan that follows from options, and the renderer that follows from the plan.

use super::settings::PictureSettings;
use crate::cancel::Cancel;
use crate::error::{Error, Result};
use crate::plan::{Effect, Integrator, Plan, Planned, Request, State};
use crate::render::direct::DirectRenderer;
use crate::render::film::Sampling;
use crate::render::path::PathTracer;
use crate::render::quadrature::Quadrature;
use crate::render::renderer::Renderer;
use crate::render::shaded::Shaded;
use crate::scene::scene::Scene;
use std::fmt;

/// Step in voxels of samples along rays whose surfaces are shaded.
const SHADED_STEP: f64 = 0.25;

/// The renderer of a scene, with the rays of its pictures.
pub(in crate::app) struct SceneRenderer<'a> {
    /// Renderer.
    pub renderer: Renderer<'a>,
    /// Quadrature along straight rays, and the transmittance at which they end.
    pub quadrature: Quadrature,
    pub early_stop: f64,
    /// Straight rays along each edge of a pixel.
    rays_per_edge: usize,
}

impl PictureSettings {
    /// Plans the rendering of a scene. `paths` tells whether anything needs paths besides scattering. If effects may be
    /// left out, what bounds do not leave out is measured.
    ///
    /// # Errors
    /// If a medium or a light cannot be used, an effect is kept by force that the scene does not have, or `cancel` was
    /// set.
    pub(crate) fn plan(&self, scene: &Scene, paths: bool, cancel: &Cancel) -> Result<Plan> {
        let request = self.request(paths);
        match self.planning.max_omitted > 0.0 {
            true => Plan::measured(scene, &scene.cameras, &request, cancel),
            false => Plan::new(scene, &scene.cameras, &request),
        }
        .map_err(|e| e.at(&self.input))
    }

    /// Returns the freedom of a plan.
    pub(in crate::app) fn request(&self, paths: bool) -> Request {
        let mut force = self.planning.force.clone();
        if paths {
            force.push(Effect::Scattering);
        }
        Request {
            max_omitted: self.planning.max_omitted,
            force,
            limits: self.scattering.limits(),
            background: self.background,
        }
    }

    /// True if effects may be left out that the scene calls for.
    pub(crate) fn leaves_out(&self) -> bool {
        self.planning.max_omitted > 0.0 || !self.planning.force.is_empty()
    }

    /// Creates the renderer of a scene that a plan has simplified, or that is to be rendered along straight rays.
    /// `paths` tells whether paths were asked for.
    ///
    /// # Errors
    /// If a medium or a light cannot be used.
    pub(in crate::app) fn renderer<'a>(
        &self,
        plan: Option<&Plan>,
        scene: &'a Scene,
        paths: bool,
    ) -> Result<SceneRenderer<'a>> {
        let renderer = match plan.filter(|plan| plan.integrator == Integrator::PathTracing) {
            Some(plan) => {
                let tracer = PathTracer::new(scene)?.limits(plan.limits);
                Renderer::Paths(match plan.background {
                    Some(background) => tracer.background(background),
                    None => tracer,
                })
            }
            None => {
                let (quadrature, early_stop) = (self.quadrature(scene), self.early_stop);
                if quadrature != Quadrature::Exact && scene.has_labels() {
                    return Err(Error::invalid("⟨quadrature⟩ has no effect: the light of labels has a closed form")
                        .hint("leave it out"));
                }
                match self.shade {
                    Some(shading) => {
                        let (shading, step) = ((shading, self.scattering.gradient_scale), quadrature.step());
                        if scene.has_labels() {
                            let labels = DirectRenderer::new(scene, quadrature)?.shaded_labels(shading)?;
                            Renderer::Direct(labels.early_stop(early_stop))
                        } else {
                            let shaded = Shaded::of_scene(scene, shading, step.unwrap_or(SHADED_STEP))?;
                            Renderer::Shaded(shaded.with(|shaded| shaded.early_stop(early_stop)))
                        }
                    }
                    None => Renderer::Direct(DirectRenderer::new(scene, quadrature)?.early_stop(early_stop)),
                }
            }
        };
        let (quadrature, early_stop) = (self.quadrature(scene), self.early_stop);
        Ok(SceneRenderer { renderer, quadrature, early_stop, rays_per_edge: self.rays_per_edge(paths) })
    }

    /// Returns the rays of a picture, a view or a frame, by its number.
    pub(in crate::app) fn sampling(&self, renderer: &SceneRenderer<'_>, number: usize) -> Sampling {
        match renderer.renderer {
            Renderer::Direct(_) | Renderer::Shaded(_) => Sampling::grid(renderer.rays_per_edge),
            Renderer::Paths(_) => self.scattering.sampling(number).within(self.origin()),
        }
    }

    /// Returns that many paths of a picture, whose random numbers are those of a stream of their own.
    pub(in crate::app) fn replicate(&self, number: usize, paths: u32, stream: u64) -> Sampling {
        self.scattering.replicate(number, paths, stream).within(self.origin())
    }

    /// Returns column and row of the first pixel in the whole picture.
    fn origin(&self) -> [u32; 2] {
        self.crop.map_or([0; 2], |window| window.origin)
    }

    /// Returns the quadrature along straight rays.
    pub(crate) fn quadrature(&self, scene: &Scene) -> Quadrature {
        self.quadrature.unwrap_or_else(|| match self.shade {
            Some(_) if !scene.has_labels() => Quadrature::Midpoint(SHADED_STEP),
            _ => DirectRenderer::usual_quadrature(scene),
        })
    }

    /// Returns the rays along each edge of a pixel. A picture that was to be made of paths, of which none is called
    /// for, has as many rays as paths were asked for, or more.
    pub(crate) fn rays_per_edge(&self, paths: bool) -> usize {
        match paths {
            true => f64::from(self.scattering.samples()).sqrt().ceil() as usize,
            false => self.supersample as usize,
        }
    }
}

/// A line of text that tells what a plan simulates, and how.
pub(in crate::app) struct Chosen<'p>(pub &'p Plan);

impl fmt::Display for Chosen<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = |state| {
            let of = self.0.effects.iter().filter(|planned| planned.state == state);
            of.map(|planned| planned.name.to_string()).collect::<Vec<_>>().join(", ")
        };
        let integrator = match self.0.integrator {
            Integrator::DirectVolumeRendering => "direct volume rendering",
            Integrator::PathTracing => "path tracing",
        };
        write!(f, "plan: {integrator}")?;
        let words = [
            (State::On, "on"),
            (State::Bounded, "in part"),
            (State::Measured, "left out by measurement"),
            (State::Off, "off"),
        ];
        for (state, word) in words {
            let names = names(state);
            if !names.is_empty() {
                write!(f, "; {word}: {names}")?;
            }
        }
        Ok(())
    }
}

/// A line of text that tells what a plan leaves out.
pub(in crate::app) struct LeftOut<'p>(pub &'p Plan);

impl fmt::Display for LeftOut<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some(omitted) = self.0.omitted else { return write!(f, "no bound of what is left out is known") };
        if omitted == 0.0 {
            return write!(f, "nothing is left out");
        }
        let Plan { effects, confidence, .. } = self.0;
        write!(f, "at most {omitted:.2e} of radiance is missing in any channel of ")?;
        if *confidence < 1.0 {
            write!(f, "a block of 8 x 8 pixels, with a confidence of {} %:", 100.0 * confidence)?;
        } else {
            write!(f, "a pixel:")?;
        }
        let there = |effect: &Planned| effect.state == State::Measured || effect.bound.is_some_and(|bound| bound > 0.0);
        let missing = effects.iter().filter(|effect| effect.state != State::On && there(effect));
        for (i, effect) in missing.enumerate() {
            write!(f, "{} {} ({})", if i == 0 { "" } else { "," }, effect.name, effect.reason)?;
        }
        Ok(())
    }
}
