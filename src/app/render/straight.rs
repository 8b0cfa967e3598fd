//! Pictures along straight rays within a wanted error, by bounds of what the quadrature and the early stop leave out.

use super::RenderSettings;
use crate::app::pictures::PictureSettings;
use crate::app::pictures::renderer::SceneRenderer;
use crate::cancel::Cancel;
use crate::error::{Error, Result};
use crate::formats::exr::Attributes;
use crate::plan::Plan;
use crate::render::accuracy::interval::scale_of;
use crate::render::direct::DirectRenderer;
use crate::render::film::Sampling;
use crate::render::quadrature::Quadrature;
use crate::render::renderer::Renderer;
use crate::scene::camera::Camera;
use crate::scene::film::Film;
use crate::scene::scene::Scene;

/// Pixels along the longer edge of the pictures that tell the scale.
const PILOT: u32 = 128;
/// Share of the scale that a smaller picture tells which the bounds are chosen for.
const SAFE: f64 = 0.8;
/// Largest and smallest tolerance of pre-integration.
const TOLERANCES: [f64; 2] = [1e-6, 0.1];
/// Largest transmittance at which rays end.
const MOST_LEFT: f64 = 0.5;

impl RenderSettings {
    /// Returns the renderer of a scene, whose straight rays keep to the wanted error in the pictures of all cameras, if
    /// one is given.
    ///
    /// # Errors
    /// If a medium or a light cannot be used, or the work is stopped.
    pub(super) fn renderer<'a>(
        &self,
        pictures: &PictureSettings,
        plan: Option<&Plan>,
        (scene, paths): (&'a Scene, bool),
        cameras: &[Camera],
        cancel: &Cancel,
    ) -> Result<SceneRenderer<'a>> {
        let usual = pictures.renderer(plan, scene, paths)?;
        let (Some(error), Renderer::Direct(direct)) = (self.accuracy.target_error, &usual.renderer) else {
            return Ok(usual);
        };
        if cameras.iter().any(|camera| !camera.blur.is_none()) {
            return Err(Error::invalid(
                "⟨target_error⟩: no bound is known of the error of straight rays that are blurred",
            )
            .hint("give ⟨aperture=0⟩ and ⟨shutter=0⟩ for sharp pictures, or ⟨supersample⟩ in place of an error"));
        }
        let mut scale = f64::INFINITY;
        for camera in cameras {
            let factor = (f64::from(PILOT) / f64::from(camera.width.max(camera.height))).min(1.0);
            let size = [camera.width, camera.height].map(|side| ((f64::from(side) * factor).round() as u32).max(1));
            let small = direct.render(&camera.resized(size), Sampling::grid(1), &[], cancel);
            scale = scale.min(scale_of(&small.ok_or_else(Error::cancelled)?.film));
        }
        // Of a black picture nothing is left out.
        let allowed = SAFE * error * scale / direct.unit();
        let (quadrature, early_stop) = match DirectRenderer::usual_quadrature(scene) {
            Quadrature::Preintegrated(_) if allowed / 2.0 >= TOLERANCES[0] => {
                (Quadrature::Preintegrated((allowed / 2.0).min(TOLERANCES[1])), allowed / 2.0)
            }
            _ => (Quadrature::Exact, allowed),
        };
        let pictures =
            PictureSettings { quadrature: Some(quadrature), early_stop: early_stop.min(MOST_LEFT), ..pictures.clone() };
        pictures.renderer(plan, scene, paths)
    }
}

/// Returns a bound of the error of pictures along straight rays in any channel of a pixel, beside rounding.
pub(super) fn error_bound(direct: &DirectRenderer<'_>) -> f64 {
    direct.left_out() + direct.quadrature_error().unwrap_or(0.0)
}

/// Returns the bound of a picture's error by the picture's scale; 0 for a black picture.
pub(super) fn relative_bound(direct: &DirectRenderer<'_>, film: &Film) -> f64 {
    let scale = scale_of(film);
    if scale > 0.0 { error_bound(direct) / scale } else { 0.0 }
}

/// Adds how a picture was integrated to its attributes, with the bound of its error: absolute, and by the picture's
/// scale if an error is `wanted`.
pub(super) fn describe(renderer: &SceneRenderer<'_>, film: &Film, wanted: bool, attributes: &mut Attributes) {
    let mut add = |name: &str, value: String| attributes.insert(format!("cumulo:{name}"), value);
    let direct = match &renderer.renderer {
        Renderer::Direct(direct) => Some(direct),
        Renderer::Shaded(_) => None,
        Renderer::Paths(_) => return,
    };
    add("quadrature", renderer.quadrature.to_string());
    add("early_stop", renderer.early_stop.to_string());
    // Samples at steps state no error.
    let bound = direct.filter(|_| renderer.quadrature.step().is_none()).map(error_bound);
    add("error_bound", bound.map_or("unknown".into(), |bound| bound.to_string()));
    if let Some(direct) = direct.filter(|_| wanted) {
        add("error", relative_bound(direct, film).to_string());
        add("scale", scale_of(film).to_string());
    }
}
