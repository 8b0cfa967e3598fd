//! The scene of a study of pictures, and its pictures by one setting or another.

use super::RenderStudySettings;
use crate::app::Context;
use crate::app::pictures::{Cameras, PictureSettings};
use crate::app::provenance::Provenance;
use crate::app::sequence;
use crate::cancel::Cancel;
use crate::error::{Error, Result};
use crate::plan::{Integrator, Plan};
use crate::render::renderer::Renderer;
use crate::scene::camera::Camera;
use crate::scene::film::Film;
use crate::scene::medium::Source;
use crate::scene::scene::Scene;
use crate::scene::volume::Volume;
use std::path::PathBuf;
use std::time::Instant;

/// Kind of the pictures of a scene, on which it depends what may be varied.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Subject {
    /// True if paths are asked for.
    pub paths: bool,
    /// True if light is scattered.
    pub scatters: bool,
    /// True for volumes that have a quadrature of their own.
    pub pre_shaded: bool,
    /// True if a transfer function makes the colors.
    pub by_function: bool,
    /// True for straight rays whose light depends on the optical depth alone.
    pub by_depth: bool,
}

/// A scene that is ready to be rendered by one setting or another.
pub(super) struct Prepared {
    /// Settings of the pictures, with the frame and the views of the command that is recommended.
    pub pictures: PictureSettings,
    pub subject: Subject,
    /// Numbers of the views.
    pub numbers: Vec<usize>,
    pub scene: Scene,
    plan: Option<Plan>,
}

impl RenderStudySettings {
    /// Reads the scene.
    ///
    /// # Errors
    /// If the volume or the cameras cannot be used.
    pub(super) fn prepare(&self, provenance: &mut Provenance, context: &Context) -> Result<Prepared> {
        let _stage = context.stage("reading the scene");
        let mut pictures = self.pictures.clone();
        pictures.frame = self.frame;
        if pictures.shade.is_some() {
            return Err(Error::unsupported("⟨shade⟩: shaded surfaces are not studied").hint("leave ⟨shade⟩ out"));
        }
        if let Some(input) = pictures.sequence_of_folder()? {
            pictures.input = input;
        }
        if let Some(pattern) = sequence::pattern(&pictures.input) {
            pictures.frame = self.frame.or(pattern.numbers()?.first().copied());
            pictures.input = pattern.path(pictures.frame.unwrap_or_default());
        }
        let template = pictures.template(None, provenance)?;
        let (subject, transfer) = pictures.subject(template.as_ref(), pictures.limits, provenance)?;
        let paths = pictures.scattering.on() || subject.is_scene();
        pictures.scattering.check(paths)?;
        let up = pictures.chosen_up(template.as_ref())?;
        up.iter().for_each(|up| context.note(up));
        let cameras = Cameras::around(up.as_ref());
        let name = |name: &str| PathBuf::from(name);
        let capture = pictures.capture(name, &subject, transfer, template.as_ref(), cameras)?;
        let stated = template.as_ref().map_or(pictures.placed().unwrap_or(1) as usize, |capture| capture.frames.len());
        let numbers = pictures.chosen(stated)?;
        if template.is_none() && pictures.placed().is_none() {
            pictures.views.get_or_insert(1);
        }
        let scene = pictures.scene(&capture, subject).map_err(|e| e.at(&pictures.input))?;
        if scene.cameras.is_empty() {
            return Err(Error::invalid("no cameras").hint("give ⟨views⟩ or ⟨cameras⟩"));
        }
        let plan =
            (paths || pictures.leaves_out()).then(|| pictures.plan(&scene, false, &context.cancel())).transpose()?;
        let scene = match &plan {
            Some(plan) => plan.simplify(scene)?,
            None => scene,
        };
        let subject = Subject {
            paths,
            scatters: plan.as_ref().is_some_and(|plan| plan.integrator == Integrator::PathTracing),
            pre_shaded: scene.has_labels() || !matches!(&scene.volumes[..], [Volume::Density(..)]),
            by_function: source(&scene).is_some_and(|source| matches!(source, Source::Transfer(_))),
            by_depth: !paths && source(&scene).is_some_and(|source| matches!(source, Source::Grey(_))),
        };
        Ok(Prepared { pictures, subject, numbers, scene, plan })
    }
}

/// Returns the source of the only volume, if it is one of densities.
fn source(scene: &Scene) -> Option<&Source> {
    match &scene.volumes[..] {
        [Volume::Density(_, medium)] => Some(&medium.source),
        _ => None,
    }
}

impl Prepared {
    /// Returns the cameras with the pixels of their pictures multiplied by `share`.
    pub(super) fn cameras(&self, share: f64) -> Vec<Camera> {
        let edge = |n: u32| (f64::from(n) * share).round().max(1.0) as u32;
        self.scene.cameras.iter().map(|camera| camera.resized([camera.width, camera.height].map(edge))).collect()
    }

    /// Renders all views by these settings, and returns the pictures with the seconds that it took, the preparation of
    /// the renderer included; `None` if it was stopped. `tolerance` is that of exact quadrature, none for the usual
    /// one.
    ///
    /// # Errors
    /// If a medium or a light cannot be used.
    pub(super) fn films(
        &self,
        pictures: &PictureSettings,
        cameras: &[Camera],
        tolerance: Option<f64>,
        cancel: &Cancel,
    ) -> Result<Option<(Vec<Film>, f64)>> {
        let most = pictures.scattering.limits().max_bounces;
        let plan = self.plan.clone().map(|mut plan| {
            plan.limits.max_bounces = plan.limits.max_bounces.min(most);
            plan
        });
        let begun = Instant::now();
        let mut renderer = pictures.renderer(plan.as_ref(), &self.scene, self.subject.paths)?;
        if let Some(tolerance) = tolerance
            && let Renderer::Direct(direct) = renderer.renderer
        {
            renderer.renderer = Renderer::Direct(direct.tolerance(tolerance));
        }
        let mut films = Vec::new();
        for (number, camera) in self.numbers.iter().zip(cameras) {
            let sampling = pictures.sampling(&renderer, *number);
            match renderer.renderer.render(camera, sampling, &[], cancel) {
                Some(rendered) => films.push(rendered.film),
                None => return Ok(None),
            }
        }
        Ok(Some((films, begun.elapsed().as_secs_f64())))
    }
}
