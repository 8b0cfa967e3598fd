//! What camera rays meet, by the distances at which they meet it.

use super::{PathTracer, Primary, Scratch};
use crate::math::Ray;
use crate::render::deep::{DeepIntegrator, Event, Slice};
use crate::render::integrator::Integrator;
use crate::render::sampler::Sampler;
use glam::Vec3;

impl DeepIntegrator for PathTracer<'_> {
    const DRAWS: bool = true;

    fn slice(&self, ray: &Ray, [from, to]: [f64; 2], scratch: &mut Scratch) -> Slice {
        self.kernel.slice(&Ray { origin: ray.at(from), direction: ray.direction, far: to - from }, scratch)
    }

    fn draw(
        &self,
        ray: &Ray,
        primary: &Primary,
        sampler: &mut Sampler,
        scratch: &mut Scratch,
        events: &mut Vec<Event>,
    ) {
        // A ray that ends does not see the background, and slices have what a grid emits by itself.
        let (ray, primary) = (Ray { far: f64::MAX, ..*ray }, Primary { emitted: Vec3::ZERO, ..*primary });
        scratch.apart = Some(std::mem::take(events));
        let sample = self.li(&ray, &primary, sampler, scratch);
        *events = scratch.apart.take().unwrap_or_default();
        if let Some(first) = sample.first {
            let opacity = if self.kernel.draws_transmittance() { 1.0 } else { 0.0 };
            let scattered = sample.direct + sample.indirect;
            events.push(Event { distance: first.distance, unscattered: sample.unscattered, scattered, opacity });
        }
    }
}
