//! Pilots: small pictures that tell what a plan will cost.

use super::{Effect, Integrator, Plan};
use crate::cancel::Cancel;
use crate::error::Result;
use crate::render::direct::DirectRenderer;
use crate::render::film::{self, Sampling};
use crate::render::path::{Limits, PathTracer};
use crate::render::quadrature::Quadrature;
use crate::scene::camera::Camera;
use crate::scene::scene::Scene;
use std::time::Instant;

/// Pixels along the longer edge of a pilot picture.
const PIXELS: f64 = 48.0;
/// Seconds that the paths of one kind are traced at least.
const SECONDS: f64 = 0.05;
/// Rounds, of which the fastest counts.
const ROUNDS: usize = 3;

/// Cost of a plan.
#[derive(Debug, Clone, Copy, serde::Serialize, schemars::JsonSchema)]
pub struct Cost {
    /// Seconds for each ray or path, on as many threads as there are.
    pub seconds_per_path: f64,
    /// Rays or paths of a picture.
    pub paths: u64,
    /// Seconds for each picture.
    pub seconds: f64,
}

/// A camera of the same view with fewer pixels.
fn small(camera: &Camera) -> Camera {
    let factor = (PIXELS / f64::from(camera.width.max(camera.height))).min(1.0);
    let size = |pixels: u32| ((f64::from(pixels) * factor).round() as u32).max(1);
    let (width, height) = (size(camera.width), size(camera.height));
    let scale =
        glam::DVec2::new(f64::from(width) / f64::from(camera.width), f64::from(height) / f64::from(camera.height));
    Camera { width, height, focal: camera.focal * scale, centre: camera.centre * scale, ..*camera }
}

/// Traces paths of a scene that the plan has simplified, enters the cost of each effect into the plan, and returns the
/// cost of a picture of `camera` with `samples` paths a pixel. `None` if `cancel` was set.
///
/// # Errors
/// If a medium or a light cannot be used.
pub fn run(
    plan: &mut Plan,
    simplified: &Scene,
    camera: &Camera,
    samples: u32,
    quadrature: Quadrature,
    cancel: &Cancel,
) -> Result<Option<Cost>> {
    let view = small(camera);
    let pixels = u64::from(view.width) * u64::from(view.height);
    let paths = u64::from(camera.width) * u64::from(camera.height) * u64::from(samples);
    let cost = |each: f64| Cost { seconds_per_path: each, paths, seconds: each * paths as f64 };
    // Seconds per path of a picture of n² paths a pixel, with n doubled until time can be told.
    let timed = |picture: &dyn Fn(u32) -> Option<()>| {
        let mut per_edge = 1;
        loop {
            let start = Instant::now();
            picture(per_edge)?;
            let seconds = start.elapsed().as_secs_f64();
            if seconds >= SECONDS || per_edge >= 1 << 8 {
                return Some(seconds / (pixels * u64::from(per_edge * per_edge)) as f64);
            }
            per_edge *= 2;
        }
    };
    let rounds = |picture: &dyn Fn(u32) -> Option<()>| {
        (0..ROUNDS).map(|_| timed(picture)).try_fold(f64::INFINITY, |least, seconds| Some(least.min(seconds?)))
    };
    if plan.integrator == Integrator::DirectVolumeRendering {
        let renderer = DirectRenderer::new(simplified, quadrature)?;
        let sampling = |per_edge| Sampling::grid(per_edge as usize);
        let each = rounds(&|per_edge| renderer.render(&view, sampling(per_edge), &[], cancel).map(|_| ()));
        return Ok(each.map(cost));
    }
    let traced = |max_bounces: u32| {
        let tracer = PathTracer::new(simplified)?.limits(Limits { max_bounces });
        let sampling = |per_edge| Sampling::random(per_edge * per_edge, 0);
        Ok(rounds(&|per_edge| film::render(&tracer, &view, sampling(per_edge), &[], cancel).map(|_| ())))
    };
    let most = plan.limits.max_bounces;
    let (Some(none), Some(one), Some(all)) = (traced(0)?, traced(most.min(1))?, traced(most)?) else { return Ok(None) };
    let all = all.max(one);
    for (effect, seconds) in [(Effect::Scattering, (all - none).max(0.0)), (Effect::MultipleScattering, all - one)] {
        let on = plan.simulates(effect);
        for planned in plan.effects.iter_mut().filter(|planned| on && planned.name == effect) {
            planned.cost = Some(seconds * paths as f64);
        }
    }
    Ok(Some(cost(all)))
}
