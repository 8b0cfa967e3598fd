//! What camera rays meet, by the distances at which they meet it.

use super::{PathTracer, Primary, Scratch};
use crate::math::Ray;
use crate::render::deep::{DeepIntegrator, Event, Slice};
use crate::render::dvr::TracedRay;
use crate::render::integrator::Integrator;
use crate::render::sampler::Sampler;
use glam::Vec3;

/// A camera's ray that was walked, and the last optical depth that was asked for.
#[derive(Debug)]
pub struct RayTraversal {
    walked: Option<TracedRay>,
    /// Length and optical depth that were asked for last.
    last: [f64; 2],
}

impl DeepIntegrator for PathTracer<'_> {
    const DRAWS: bool = true;
    type Traversal = RayTraversal;

    fn reach(&self, ray: &Ray) -> Ray {
        self.kernels[self.moment(ray)].reach(ray)
    }

    fn walk(&self, ray: &Ray, scratch: &mut Scratch) -> RayTraversal {
        RayTraversal { walked: self.kernels[self.moment(ray)].walk(ray, scratch), last: [0.0; 2] }
    }

    fn slice(&self, (ray, way): (&Ray, &mut RayTraversal), part: [f64; 2], scratch: &mut Scratch) -> Slice {
        let RayTraversal { walked, last } = way;
        self.kernels[self.moment(ray)].slice((ray, walked.as_ref().map(|walked| (walked, last))), part, scratch)
    }

    fn draw(
        &self,
        ray: &Ray,
        primary: &Primary,
        sampler: &mut Sampler,
        scratch: &mut Scratch,
        events: &mut Vec<Event>,
    ) {
        let kernel = &self.kernels[primary.moment];
        if kernel.misses(primary) {
            scratch.counts.paths += 1;
            return;
        }
        // A ray that ends does not see the background, and slices have what a grid emits by itself.
        let (ray, primary) = (Ray { far: f64::MAX, ..*ray }, Primary { emitted: Vec3::ZERO, ..*primary });
        scratch.apart = Some(std::mem::take(events));
        let sample = self.li(&ray, &primary, sampler, scratch);
        *events = scratch.apart.take().unwrap_or_default();
        if let Some(first) = sample.first {
            let opacity = if kernel.draws_transmittance() { 1.0 } else { 0.0 };
            let scattered = sample.direct + sample.indirect;
            events.push(Event { distance: first.distance, unscattered: sample.unscattered, scattered, opacity });
        }
    }
}
