//! Paths among surfaces: they are scattered by the media and by the meshes that stand in them.
//!
//! The camera sees the media before a surface, and the surface through them: two paths, one that collides before the
//! surface and one that reaches it, with the transmittance to it for its weight.

use super::direct::{Lighting, heuristic};
use super::phase::PhaseFunction;
use super::tracking::{Collision, Media, Visible};
use super::{Kernel, Limits, PathTracer, Primary, Scratch, WalkedDepth, survives};
use crate::math::Ray;
use crate::render::deep::{Event, Slice};
use crate::render::dvr::TracedRay;
use crate::render::integrator::{First, Interaction, Sample, mean};
use crate::render::sampler::Sampler;
use crate::scene::directions::around;
use crate::scene::meshes::{Material, Meshes, SurfacePoint};
use glam::{DVec3, Vec3};
use std::f64::consts::FRAC_1_PI;

/// Scatterings after which a path is given up: between surfaces that absorb nothing, and let nothing out, none ends.
const MOST_BOUNCES: u32 = 4096;

/// Media, and meshes among them.
pub(super) struct AmongMeshes<'a, M> {
    pub media: M,
    pub meshes: &'a Meshes,
}

impl<M> AmongMeshes<'_, M> {
    /// Returns a camera's ray up to the surface that it meets, and that.
    fn end(&self, ray: &Ray) -> (Ray, Option<SurfacePoint>) {
        let surface = self.meshes.meet(ray);
        (surface.map_or(*ray, |point| Ray { far: point.distance, ..*ray }), surface)
    }
}

impl<M: Media> Kernel for AmongMeshes<'_, M> {
    fn normal(&self, first: &First) -> DVec3 {
        Kernel::normal(&self.media, first)
    }

    fn primary(&self, ray: &Ray, scratch: &mut Scratch) -> Primary {
        let (ray, surface) = self.end(ray);
        Primary { surface, ..Kernel::primary(&self.media, &ray, scratch) }
    }

    fn optical_depth(&self, ray: &Ray, scratch: &mut Scratch) -> f64 {
        Kernel::optical_depth(&self.media, &self.end(ray).0, scratch)
    }

    fn extinction(&self, at: DVec3) -> f64 {
        Kernel::extinction(&self.media, at)
    }

    fn walk(&self, ray: &Ray, scratch: &mut Scratch) -> Option<TracedRay> {
        Kernel::walk(&self.media, ray, scratch)
    }

    fn slice(&self, from: (&Ray, Option<WalkedDepth<'_>>), part: [f64; 2], scratch: &mut Scratch) -> Slice {
        Kernel::slice(&self.media, from, part, scratch)
    }

    fn reach(&self, ray: &Ray) -> Ray {
        self.end(ray).0
    }

    fn misses(&self, primary: &Primary) -> bool {
        primary.surface.is_none() && Kernel::misses(&self.media, primary)
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
        let Self { media, meshes } = self;
        let ray = primary.surface.map_or(*ray, |point| Ray { far: point.distance, ..*ray });
        let PathTracer { lighting, dark, arch, .. } = tracer;
        let walk = Walk { media, meshes, lighting, limits, dark: *dark, scratch };
        arch.dispatch(CameraPath { walk, ray, primary, sampler })
    }
}

/// All that a camera's ray sees, as the unit that is compiled for each instruction set.
struct CameraPath<'p, M> {
    walk: Walk<'p, M>,
    ray: Ray,
    primary: &'p Primary,
    sampler: &'p mut Sampler,
}

impl<M: Media> pulp::NullaryFnOnce for CameraPath<'_, M> {
    type Output = Sample;

    #[inline(always)]
    fn call(self) -> Sample {
        let Self { mut walk, ray, primary, sampler } = self;
        let Walk { media, lighting, dark, .. } = walk;
        let beyond = primary.surface.map(|point| (point, sampler.second()));
        let Visible { transmittance, collision, spare } = media.first(&ray, primary, sampler, walk.scratch);
        let through = if ray.ends() { primary.to_end.unwrap_or(transmittance) } else { transmittance };
        let unscattered = if ray.ends() { Vec3::ZERO } else { through * lighting.background(ray.direction) };
        let mut out = Sample { unscattered, transmittance: mean(through), ..Sample::default() };
        if M::GLOWS && !dark {
            out.unscattered += media.emitted(&ray, Some(primary), sampler, walk.scratch);
        }
        if let Some((collision, mut weight)) = collision.filter(|(collision, _)| collision.distance <= ray.far) {
            let (vertex, emitted) = walk.collide(&collision, &ray);
            let (share, Vertex::Collision { position, albedo, .. }) = (mean(weight), vertex) else { return out };
            let interaction = Interaction::Volume(collision.volume);
            out.first = Some(First { distance: collision.distance, position, albedo, interaction, share });
            out.unscattered += weight * emitted;
            // Where little is met, little is followed.
            let chance = (lighting.often * f64::from(share)).min(1.0);
            if spare < chance {
                weight /= chance as f32;
                walk.follow(vertex, (ray.direction, weight), &mut out, sampler);
            }
        }
        if let Some((point, mut sampler)) = beyond
            && !point.material.holdout
        {
            let SurfacePoint { distance, position, normal, material: Material { albedo, emission, .. }, .. } = point;
            let (opacity, mut seen) = (mean(through), Sample::default());
            if !dark {
                seen.unscattered = through * emission;
            }
            walk.follow(Vertex::Surface(point), (ray.direction, through), &mut seen, &mut sampler);
            if let Some(apart) = &mut walk.scratch.apart {
                let (unscattered, scattered) = (seen.unscattered, seen.direct + seen.indirect);
                apart.push(Event { distance, unscattered, scattered, opacity });
                return out;
            }
            out.unscattered += seen.unscattered;
            out.direct += seen.direct;
            out.indirect += seen.indirect;
            out.transmittance = 0.0;
            out.surface =
                Some(First { distance, position, albedo, interaction: Interaction::Surface(normal), share: opacity });
        }
        out
    }
}

/// A point at which a path is scattered.
#[derive(Clone, Copy)]
enum Vertex<P> {
    /// A collision with a medium.
    Collision {
        /// Position in world space.
        position: DVec3,
        /// Phase function there.
        phase: P,
        /// Albedo of the medium.
        albedo: Vec3,
        /// Share of the light that is scattered.
        total: Vec3,
    },
    /// A point of a surface.
    Surface(SurfacePoint),
}

impl<P: PhaseFunction> Vertex<P> {
    /// Returns the share of the light that is scattered.
    #[inline(always)]
    fn total(&self) -> Vec3 {
        match self {
            Self::Collision { total, .. } => *total,
            Self::Surface(point) => point.material.albedo,
        }
    }

    /// Returns the origin of rays that leave.
    #[inline(always)]
    fn origin(&self) -> DVec3 {
        match self {
            Self::Collision { position, .. } => *position,
            Self::Surface(point) => point.above(),
        }
    }

    /// Returns the density per steradian with which [`Self::sample`] draws a direction, by which light is scattered, as
    /// well.
    #[inline(always)]
    fn value(&self, from: DVec3, to: DVec3) -> f64 {
        match self {
            Self::Collision { phase, .. } => phase.value(from, to),
            Self::Surface(point) => FRAC_1_PI * point.normal.dot(to).max(0.0),
        }
    }

    /// Draws a direction by two numbers in [0, 1), and returns its density with it.
    #[inline(always)]
    fn sample(&self, from: DVec3, [u, v]: [f64; 2]) -> (DVec3, f64) {
        match self {
            Self::Collision { phase, .. } => phase.sample(from, [u, v]),
            Self::Surface(point) => {
                let cosine = (1.0 - u).sqrt();
                (around(point.normal, cosine, u.sqrt(), v), FRAC_1_PI * cosine)
            }
        }
    }

    /// Returns the color of the light that is scattered from a direction, over [`Self::total`] and [`Self::value`].
    #[inline(always)]
    fn tint(&self, from: DVec3, to: DVec3) -> Vec3 {
        match self {
            Self::Collision { phase, albedo, .. } if P::COLORED => phase.tint(*albedo, from, to),
            _ => Vec3::ONE,
        }
    }
}

/// Scene and scratch memory that a path needs on its way.
struct Walk<'p, M> {
    media: &'p M,
    meshes: &'p Meshes,
    lighting: &'p Lighting,
    limits: Limits,
    dark: bool,
    scratch: &'p mut Scratch,
}

impl<M: Media> Walk<'_, M> {
    /// Returns the vertex of a collision along a ray, and the radiance that the medium emits there.
    #[inline(always)]
    fn collide(&mut self, collision: &Collision, ray: &Ray) -> (Vertex<M::Phase>, Vec3) {
        self.scratch.counts.collisions += 1;
        let position = ray.at(collision.distance);
        let albedo = self.media.albedo(collision);
        let phase = self.media.phase(collision, position);
        let total = phase.total(albedo, ray.direction);
        let emits = M::EMITS && !self.dark;
        let emitted = if emits { (Vec3::ONE - total) * self.media.source(collision) } else { Vec3::ZERO };
        (Vertex::Collision { position, phase, albedo, total }, emitted)
    }

    /// Adds the light that a vertex, reached in a direction with a weight, scatters from lights and from surfaces that
    /// emit, one drawn of each by two numbers in [0, 1) and more of the sampler.
    #[inline(always)]
    fn light(
        &mut self,
        vertex: &Vertex<M::Phase>,
        (from, weight): (DVec3, Vec3),
        numbers: [f64; 2],
        sum: &mut Vec3,
        sampler: &mut Sampler,
    ) {
        let Self { media, meshes, lighting, dark, .. } = *self;
        let origin = vertex.origin();
        let drawn = lighting.sample(origin, numbers).map(|(_, arrival)| (arrival, None));
        let of_meshes = if meshes.emit() && !dark {
            let [choice, u, v, _] = sampler.stratified();
            meshes.sample(origin, [choice, u, v]).map(|(arrival, triangle)| (arrival, Some(triangle)))
        } else {
            None
        };
        for (arrival, triangle) in [drawn, of_meshes].into_iter().flatten() {
            let scattered = vertex.value(from, arrival.direction);
            if scattered <= 0.0 {
                continue;
            }
            let toward = Ray::new(origin, arrival.direction);
            let seen = match triangle {
                // Of faces that coincide, one is met, by whichever way.
                Some(triangle) => meshes.see(&toward, arrival.distance, triangle),
                None => !meshes.block(&toward, arrival.distance),
            };
            if !seen {
                continue;
            }
            self.scratch.counts.shadow_rays += 1;
            let transmittance = media.transmittance(&toward, arrival.distance, sampler, self.scratch);
            let tint = vertex.tint(from, arrival.direction);
            *sum += weight * lighting.weighted(&arrival, scattered) * transmittance * tint;
        }
    }

    /// Follows a path from a vertex that it reached in a direction with a weight, and adds the light that it finds.
    #[inline(always)]
    fn follow(
        &mut self,
        mut vertex: Vertex<M::Phase>,
        (mut from, mut weight): (DVec3, Vec3),
        out: &mut Sample,
        sampler: &mut Sampler,
    ) {
        let Self { media, meshes, lighting, limits, dark, .. } = *self;
        let mut bounces = 0;
        loop {
            weight *= vertex.total();
            if bounces == limits.max_bounces || !survives(&mut weight, bounces, sampler) {
                return;
            }
            if bounces == MOST_BOUNCES {
                self.scratch.counts.unfinished += 1;
                return;
            }
            bounces += 1;
            let once = bounces == 1;
            let [u, v, of_lights, of_light] = sampler.stratified();
            let sum = if once { &mut out.direct } else { &mut out.indirect };
            self.light(&vertex, (from, weight), [of_lights, of_light], sum, sampler);
            let origin = vertex.origin();
            let (direction, density) = vertex.sample(from, [u, v]);
            self.scratch.counts.impossible += u64::from(density.is_nan() || density <= 0.0);
            weight *= vertex.tint(from, direction);
            let ray = Ray::new(origin, direction);
            let point = meshes.meet(&ray);
            let ray = Ray { far: point.map_or(f64::INFINITY, |point| point.distance), ..ray };
            if M::GLOWS && !dark {
                out.indirect += weight * media.emitted(&ray, None, sampler, self.scratch);
            }
            let next = media.collide(&ray, weight, sampler, self.scratch);
            // A light in the plane of a surface is before it.
            let reach = next.map_or_else(|| meshes.reach(ray.far), |(collision, _)| collision.distance);
            let survival = |distance| media.survival(&ray, distance, weight, self.scratch);
            let met = lighting.hit_radiance(&ray, reach, density, survival, |_, _| 1.0);
            *if once { &mut out.direct } else { &mut out.indirect } += weight * met;
            from = direction;
            vertex = match (next, point) {
                (Some((collision, factor)), _) => {
                    weight *= factor;
                    let (vertex, emitted) = self.collide(&collision, &ray);
                    out.indirect += weight * emitted;
                    vertex
                }
                (None, Some(point)) => {
                    weight *= media.survival(&ray, point.distance, weight, self.scratch);
                    if meshes.emit() && !dark {
                        let share = heuristic(density, meshes.density_towards(&ray, &point));
                        let met = weight * point.material.emission * share as f32;
                        *if once { &mut out.direct } else { &mut out.indirect } += met;
                    }
                    Vertex::Surface(point)
                }
                (None, None) => return,
            };
        }
    }
}
