//! Volumetric path tracing: light that media emit, absorb and scatter any number of times.
//!
//! A path begins at the camera, collides with a medium (`tracking`), sees there the light of one light source
//! (`direct`, `near`), turns by the phase function, and goes on until it escapes, is absorbed or has been scattered
//! often enough. Its mean is the radiance
//!
//! `L(x, ω) = ∫ T(t) (σ_a c + σ_s ∫ p(ω·ω') L(x + tω, ω') dω') dt + T(∞) · environment`
//!
//! without bias (Novák et al. 2018 survey the estimators). Small lights inside thin media are looked for at points near
//! them as well (`near`; Kulla & Fajardo 2012, Georgiev et al. 2013).
//!
//! [`PathTracer`] picks its kernel once for a scene: the kind of medium and its phase function are types inside the
//! loops.

mod chromatic;
mod deep;
mod direct;
mod emissive;
mod flames;
mod kernel;
mod labels;
mod meshes;
mod near;
mod near_lights;
mod optics;
mod phase;
mod record;
mod specular;
mod tracking;

use crate::arch::Arch;
use crate::error::Result;
use crate::math::{Aabb, Ray};
use crate::render::deep::{Event, Slice};
use crate::render::dvr::{Tape, TracedRay};
use crate::render::integrator::{Counts, First, Integrator, Interaction, Sample, mean};
use crate::render::preshaded;
use crate::render::sampler::Sampler;
use crate::scene::environment::Environment;
use crate::scene::light::Light;
use crate::scene::meshes::SurfacePoint;
use crate::scene::scene::Scene;
use crate::scene::volume::Volume;
use direct::Lighting;
use glam::{DVec3, Vec3};
use near::End;
use near_lights::NearLights;
use phase::PhaseFunction;
pub(crate) use record::PathEvent;
pub(crate) use specular::peak as specular_peak;
use tracking::{Collision, Media, Visible};

/// Scratch memory of a task, reused from path to path.
#[derive(Debug, Default)]
pub struct Scratch {
    tape: Tape<f32>,
    /// The way of the camera's ray that was walked last.
    camera: Tape<f32>,
    emission: preshaded::Tape<f32>,
    /// Light that camera rays meet elsewhere than at their first collisions, where it is kept apart.
    apart: Option<Vec<Event>>,
    /// Events of the path that was traced last, where they are asked for.
    record: Option<Vec<PathEvent>>,
    /// Events since the memory was made.
    pub counts: Counts,
}

impl Scratch {
    /// Creates memory that keeps the events of the path that was traced last. Specular lobes, and light that is looked
    /// for near lights, are none of them.
    pub(crate) fn recording() -> Self {
        Self { record: Some(Vec::new()), ..Self::default() }
    }

    /// Takes the events of the path that was traced last.
    pub(crate) fn events(&mut self) -> impl Iterator<Item = PathEvent> + '_ {
        self.record.iter_mut().flat_map(|record| record.drain(..))
    }

    #[inline(always)]
    fn note(&mut self, event: impl FnOnce() -> PathEvent) {
        if let Some(record) = &mut self.record {
            record.push(event());
        }
    }
}

/// State that all paths along one camera's ray share; the cells on its way are kept with the scratch memory.
#[derive(Debug, Clone, Copy, Default)]
pub struct Primary {
    walked: Option<TracedRay>,
    /// Optical depth by channel, where kernels ask for it.
    depths: DVec3,
    /// Radiance of the grid beside the media, where kernels ask for it.
    emitted: Vec3,
    /// Transmittance by channel to the end of a ray that was walked beyond it.
    to_end: Option<Vec3>,
    /// Surface that the ray meets.
    surface: Option<SurfacePoint>,
    /// Number of the moment at which the ray is drawn.
    moment: usize,
}

/// How far paths go.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Most scatterings along a path; light scattered more often is left out.
    pub max_bounces: u32,
}

impl Default for Limits {
    /// Paths without limit.
    fn default() -> Self {
        Self { max_bounces: u32::MAX }
    }
}

/// Path tracer of a scene.
pub struct PathTracer<'a> {
    /// Kernels of the scene's moments, evenly spread over the time in which the shutter is open; one of a scene at
    /// rest.
    kernels: Vec<Box<dyn Kernel + 'a>>,
    lighting: Lighting,
    limits: Limits,
    /// True if media do not emit.
    dark: bool,
    arch: Arch,
}

/// A camera's ray that was walked, with the length and the optical depth before it that were asked for last.
type WalkedDepth<'a> = (&'a TracedRay, &'a mut [f64; 2]);

/// A path tracing kernel compiled for a kind of media.
trait Kernel: Sync + Send {
    /// Returns the unit vector in which the density of a volume falls; 0 where it is constant.
    fn normal(&self, first: &First) -> DVec3;
    /// Walks along a camera's ray.
    fn primary(&self, ray: &Ray, scratch: &mut Scratch) -> Primary;
    /// Returns the optical depth of a world ray, the mean of the channels.
    fn optical_depth(&self, ray: &Ray, scratch: &mut Scratch) -> f64;
    /// Returns the extinction at a world position, the mean of the channels.
    fn extinction(&self, at: DVec3) -> f64;
    /// Walks along a camera's ray before parts of it are asked for.
    fn walk(&self, ray: &Ray, scratch: &mut Scratch) -> Option<TracedRay>;
    /// Returns optical depth and emission of a part of the camera's ray that was walked last, as far as no path draws
    /// them.
    fn slice(&self, from: (&Ray, Option<WalkedDepth<'_>>), part: [f64; 2], scratch: &mut Scratch) -> Slice;
    /// Returns a camera's ray up to the surface that it meets.
    fn reach(&self, ray: &Ray) -> Ray;
    /// True if nothing is on the way of a camera's ray that was walked.
    fn misses(&self, primary: &Primary) -> bool;
    /// True if paths estimate the transmittance of camera rays by their collisions.
    fn draws_transmittance(&self) -> bool;
    /// Traces a path within limits from a camera's ray, which was walked last.
    fn trace(
        &self,
        tracer: &PathTracer<'_>,
        limits: Limits,
        from: (&Ray, &Primary),
        sampler: &mut Sampler,
        scratch: &mut Scratch,
    ) -> Sample;
}

impl<M: Media> Kernel for M {
    fn normal(&self, first: &First) -> DVec3 {
        match first.interaction {
            Interaction::Volume(volume) => Media::normal(self, volume, first.position),
            Interaction::Surface(normal) => normal,
        }
    }

    fn primary(&self, ray: &Ray, scratch: &mut Scratch) -> Primary {
        let mut primary = Media::primary(self, ray, scratch);
        if ray.ends() && primary.walked.is_some() {
            primary.to_end = Some((-Media::optical_depth(self, ray, scratch)).map(f64::exp).as_vec3());
        }
        primary
    }

    fn optical_depth(&self, ray: &Ray, scratch: &mut Scratch) -> f64 {
        Media::optical_depth(self, ray, scratch).element_sum() / 3.0
    }

    fn extinction(&self, at: DVec3) -> f64 {
        Media::extinction(self, at)
    }

    fn walk(&self, ray: &Ray, scratch: &mut Scratch) -> Option<TracedRay> {
        Media::walk(self, ray, scratch)
    }

    fn slice(&self, (ray, way): (&Ray, Option<WalkedDepth<'_>>), part: [f64; 2], scratch: &mut Scratch) -> Slice {
        let [from, to] = part;
        let own = Ray { origin: ray.at(from), far: to - from, ..*ray };
        let depth = match way {
            _ if M::DRAWS => DVec3::ZERO,
            Some((walked, last)) => {
                let before = if last[0] == from { last[1] } else { self.depth_before(walked, from, scratch) };
                *last = [to, self.depth_before(walked, to, scratch)];
                DVec3::splat((last[1] - before).max(0.0))
            }
            None => Media::optical_depth(self, &own, scratch),
        };
        Slice { rgb: self.glow(&own, scratch).as_dvec3(), depth }
    }

    fn reach(&self, ray: &Ray) -> Ray {
        *ray
    }

    fn misses(&self, primary: &Primary) -> bool {
        !M::GLOWS && primary.walked.is_some_and(|walked| walked.depth <= 0.0)
    }

    fn draws_transmittance(&self) -> bool {
        M::DRAWS
    }

    fn trace(
        &self,
        tracer: &PathTracer<'_>,
        limits: Limits,
        (ray, primary): (&Ray, &Primary),
        sampler: &mut Sampler,
        scratch: &mut Scratch,
    ) -> Sample {
        let PathTracer { lighting, dark, arch, .. } = tracer;
        let dark = *dark;
        if lighting.near.is_empty() {
            arch.dispatch(Path::<_, false> { media: self, lighting, limits, dark, ray, primary, sampler, scratch })
        } else {
            arch.dispatch(Path::<_, true> { media: self, lighting, limits, dark, ray, primary, sampler, scratch })
        }
    }
}

impl<'a> PathTracer<'a> {
    /// Creates the path tracer of a scene. The camera sees the environment behind the media.
    ///
    /// # Errors
    /// If a medium or a light cannot be used, or a volume is pre-shaded.
    pub fn new(scene: &'a Scene) -> Result<Self> {
        let kernels = match &scene.moments[..] {
            [] => vec![kernel::specialised(scene)?],
            moments => moments.iter().map(kernel::specialised).collect::<Result<_>>()?,
        };
        let near = |at| kernels[0].extinction(at);
        let scattering: Vec<_> =
            scene.volumes.iter().filter_map(Volume::density).filter(|(_, m)| m.scatters()).collect();
        let pay = scattering.iter().all(|(_, medium)| medium.scattering.as_ref().is_none_or(near_lights::pay));
        let bounds = if scene.meshes.is_none() && pay {
            scattering
                .iter()
                .map(|(field, _)| field.transform.box_to_world(field.domain))
                .fold(Aabb::EMPTY, Aabb::union)
        } else {
            Aabb::EMPTY
        };
        let lighting = Lighting::new(&scene.lights, scene.environment.clone(), (bounds, &near))?;
        Ok(Self { kernels, lighting, limits: Limits::default(), dark: false, arch: Arch::default() })
    }

    /// Uses the kernel that serves any number of volumes of one extinction for all channels, for comparison.
    ///
    /// # Errors
    /// As [`PathTracer::new`].
    pub fn generic(scene: &'a Scene) -> Result<Self> {
        let mut tracer = Self::new(scene)?;
        tracer.kernels = vec![kernel::generic(scene)?];
        Ok(tracer)
    }

    /// Sets how far paths go.
    #[must_use]
    pub fn limits(mut self, limits: Limits) -> Self {
        self.limits = limits;
        self
    }

    /// Sets what the camera sees behind the media in place of the environment.
    #[must_use]
    pub fn background(mut self, radiance: [f32; 3]) -> Self {
        self.lighting.background = Some(Vec3::from_array(radiance));
        self
    }

    /// Looks for light where paths collide alone, for comparison.
    #[must_use]
    pub fn at_collisions(mut self) -> Self {
        self.lighting.near = NearLights::default();
        self
    }

    /// Puts other light around the media, before black, which paths look for where they collide alone; `emits` tells
    /// whether media emit themselves. All first collisions of camera rays scatter light, so that thin media are seen as
    /// well as others.
    ///
    /// # Errors
    /// If a light cannot be used.
    pub(crate) fn relight(&mut self, lights: &[Light], environment: Environment, emits: bool) -> Result<()> {
        self.lighting = Lighting::new(lights, environment, (Aabb::EMPTY, &|_| 0.0))?;
        (self.lighting.often, self.lighting.background) = (f64::INFINITY, Some(Vec3::ZERO));
        self.dark = !emits;
        Ok(())
    }

    /// Returns an estimate as [`Integrator::li`] does, by a path that goes as far as these limits: it is the beginning
    /// of the path that the same random numbers make without them.
    pub(crate) fn li_within(
        &self,
        limits: Limits,
        (ray, primary): (&Ray, &Primary),
        sampler: &mut Sampler,
        scratch: &mut Scratch,
    ) -> Sample {
        scratch.counts.paths += 1;
        self.kernels[primary.moment].trace(self, limits, (ray, primary), sampler, scratch)
    }

    /// Returns the number of the moment at which a camera's ray is drawn.
    #[inline(always)]
    fn moment(&self, ray: &Ray) -> usize {
        let last = self.kernels.len() - 1;
        ((ray.time * self.kernels.len() as f64) as usize).min(last)
    }

    /// Sets the instruction set of the kernels.
    #[must_use]
    pub fn arch(mut self, arch: Arch) -> Self {
        self.arch = arch;
        self
    }
}

impl Integrator for PathTracer<'_> {
    type Primary = Primary;
    type Scratch = Scratch;

    fn primary(&self, ray: &Ray, scratch: &mut Scratch) -> Primary {
        let moment = self.moment(ray);
        Primary { moment, ..self.kernels[moment].primary(ray, scratch) }
    }

    fn li(&self, ray: &Ray, primary: &Primary, sampler: &mut Sampler, scratch: &mut Scratch) -> Sample {
        self.li_within(self.limits, (ray, primary), sampler, scratch)
    }

    /// Exact, whatever the paths estimate the transmittance by.
    fn optical_depth(&self, ray: &Ray, primary: &Primary, scratch: &mut Scratch) -> f64 {
        self.kernels[primary.moment].optical_depth(ray, scratch)
    }

    fn normal(&self, primary: &Primary, first: &First) -> DVec3 {
        self.kernels[primary.moment].normal(first)
    }

    fn take_counts(scratch: &mut Scratch) -> Counts {
        std::mem::take(&mut scratch.counts)
    }
}

/// One path, as the unit that is compiled for each instruction set, and for scenes with lights near to the media.
struct Path<'p, M, const NEAR: bool> {
    media: &'p M,
    lighting: &'p Lighting,
    limits: Limits,
    dark: bool,
    ray: &'p Ray,
    primary: &'p Primary,
    sampler: &'p mut Sampler,
    scratch: &'p mut Scratch,
}

impl<M: Media, const NEAR: bool> pulp::NullaryFnOnce for Path<'_, M, NEAR> {
    type Output = Sample;

    #[inline(always)]
    fn call(self) -> Sample {
        let Self { media, lighting, limits, dark, ray, primary, sampler, scratch } = self;
        let Visible { mut transmittance, mut collision, spare } = media.first(ray, primary, sampler, scratch);
        let mut unscattered = transmittance * lighting.background(ray.direction);
        if ray.ends() {
            // Collisions beyond the end are drawn and count for nothing, so that all others are those of the whole ray.
            transmittance = primary.to_end.unwrap_or(transmittance);
            collision = collision.filter(|(collision, _)| collision.distance <= ray.far);
            unscattered = Vec3::ZERO;
        }
        let mut out = Sample { unscattered, transmittance: mean(transmittance), ..Sample::default() };
        if M::GLOWS && !dark {
            out.unscattered += media.emitted(ray, Some(primary), sampler, scratch);
        }
        if NEAR
            && limits.max_bounces > 0
            && let Some((distance, light)) = lighting.along(media, (ray, primary), sampler, scratch)
        {
            match &mut scratch.apart {
                Some(apart) => apart.push(Event { distance, scattered: light, ..Event::default() }),
                None if distance <= ray.far => out.direct += light,
                None => {}
            }
        }
        let Some((mut collision, mut weight)) = collision else { return out };
        let (mut ray, mut bounces, mut drawn) = (*ray, 0, None);
        loop {
            scratch.counts.collisions += 1;
            let albedo = media.albedo(&collision);
            let at = ray.at(collision.distance);
            let colored = M::Phase::COLORED;
            let known = colored.then(|| media.phase(&collision, at));
            let total = known.map_or(albedo, |phase| phase.total(albedo, ray.direction));
            if M::EMITS && !dark {
                let light = weight * media.source(&collision);
                scratch.note(|| PathEvent::Emitted { density: collision.density, light });
                let emitted = light * (Vec3::ONE - total);
                *if bounces == 0 { &mut out.unscattered } else { &mut out.indirect } += emitted;
            }
            if bounces == 0 {
                let Collision { distance, volume, .. } = collision;
                let share = mean(weight);
                out.first =
                    Some(First { distance, position: at, albedo, interaction: Interaction::Volume(volume), share });
                let chance = (lighting.often * f64::from(share)).min(1.0);
                if spare >= chance {
                    break;
                }
                weight /= chance as f32;
            }
            weight *= total;
            scratch.note(|| PathEvent::Scattered { density: collision.density });
            if bounces == limits.max_bounces || !survives(&mut weight, bounces, sampler) {
                break;
            }
            bounces += 1;
            let phase = known.unwrap_or_else(|| media.phase(&collision, at));
            let [u, v, of_lights, of_light] = sampler.stratified();
            let end = End { media, lighting, ray, distance: collision.distance, drawn };
            let arriving = lighting.sample(at, [of_lights, of_light]).and_then(|(light, arrival)| {
                let counts = if NEAR { end.thinned(light, &arrival, sampler) } else { 1.0 };
                (!NEAR || counts > 0.0).then_some((arrival, counts))
            });
            if let Some((arrival, counts)) = arriving {
                let toward = Ray::new(at, arrival.direction);
                let scattered = phase.value(ray.direction, arrival.direction);
                scratch.counts.shadow_rays += 1;
                let transmittance = media.transmittance(&toward, arrival.distance, sampler, scratch);
                let seen = weight * lighting.weighted(&arrival, scattered) * transmittance;
                let seen = if NEAR { seen * counts } else { seen };
                let tint = |to| phase.tint(albedo, ray.direction, to);
                let seen = if colored { seen * tint(arrival.direction) } else { seen };
                scratch.note(|| PathEvent::Arrived(seen));
                *if bounces == 1 { &mut out.direct } else { &mut out.indirect } += seen;
            }
            if NEAR && bounces < limits.max_bounces {
                out.indirect += weight * lighting.around(media, (at, ray.direction, phase, albedo), sampler, scratch);
            }
            let (direction, density) = phase.sample(ray.direction, [u, v]);
            scratch.counts.impossible += u64::from(density.is_nan() || density <= 0.0);
            if colored {
                weight *= phase.tint(albedo, ray.direction, direction);
            }
            (ray, drawn) = (Ray::new(at, direction), Some(density));
            if M::GLOWS && !dark {
                let glow = weight * media.emitted(&ray, None, sampler, scratch);
                scratch.note(|| PathEvent::Arrived(glow));
                out.indirect += glow;
            }
            let next = media.collide(&ray, weight, sampler, scratch);
            let reach = next.map_or(f64::INFINITY, |(collision, _)| collision.distance);
            let survival = |distance| media.survival(&ray, distance, weight, scratch);
            let counts = |light, arrival: &_| if NEAR { end.left(light, arrival) } else { 1.0 };
            let met = lighting.hit_radiance(&ray, reach, density, survival, counts);
            scratch.note(|| PathEvent::Arrived(weight * met));
            *if bounces == 1 { &mut out.direct } else { &mut out.indirect } += weight * met;
            let Some((next, factor)) = next else { return out };
            (collision, weight) = (next, weight * factor);
        }
        out
    }
}

/// Scatterings before the first roulette, and the weight below which it is played.
const BEFORE_ROULETTE: u32 = 3;
const ROULETTE: f32 = 0.25;

/// Ends paths that carry little with a probability, and raises the weight of the others so that the mean stays (Russian
/// roulette; Arvo & Kirk 1990). Returns false if the path ends.
#[inline(always)]
fn survives(weight: &mut Vec3, bounces: u32, sampler: &mut Sampler) -> bool {
    let most = weight.max_element();
    if most <= 0.0 {
        return false;
    }
    if bounces < BEFORE_ROULETTE || most >= ROULETTE {
        return true;
    }
    let share = most / ROULETTE;
    *weight /= share;
    sampler.uniform() < f64::from(share)
}
