//! Delta tracking (Woodcock et al. 1965): collisions with a medium at the density `σ e^{-∫σ}` along a ray.
//!
//! Tentative collisions are drawn with the brick's majorant in place of the extinction; of these, the share σ over the
//! majorant is real. Their chances not to be are the factors of ratio tracking (Novák et al. 2014). Bricks in which
//! nothing absorbs are skipped.

use super::optics::{Any, ByDensity, DensityMedium};
use super::phase::{PhaseFunction, Phases, Shaded};
use super::specular::Glossy;
use super::{Primary, Scratch};
use crate::error::{Error, Result};
use crate::math::Ray;
use crate::render::dvr::{self, Dvr, TracedRay};
use crate::render::gradient::gradient;
use crate::render::integrator::Counts;
use crate::render::march::{IndexRay, Span, spans};
use crate::render::sampler::Sampler;
use crate::scene::bricks::{BRICK, Bricks};
use crate::scene::medium::Medium;
use crate::scene::topology::CELLS;
use glam::{DVec3, Vec3};

/// A real collision of a path with a medium.
#[derive(Debug, Clone, Copy)]
pub(super) struct Collision {
    /// World length from the ray's origin.
    pub distance: f64,
    /// Density of the medium.
    pub density: f32,
    /// Number of the volume.
    pub volume: usize,
}

/// Light that a camera's ray meets: what comes from behind the media, and a collision with the weight of all of them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Visible {
    /// Transmittance, or an estimate of it, by channel.
    pub transmittance: Vec3,
    /// Collision and its weight, of the same mean as 1 - transmittance.
    pub collision: Option<(Collision, Vec3)>,
    /// A number in [0, 1) that is even over the samples of a pixel, for those whose weight is not 1.
    pub spare: f64,
}

/// The volumes of a scene as paths meet them.
pub(super) trait Media: Sync + Send {
    /// Phase function of the media.
    type Phase: PhaseFunction;
    /// False if no medium emits by its source.
    const EMITS: bool;
    /// True if the transmittance of camera rays is estimated by their collisions.
    const DRAWS: bool = false;
    /// True if a grid emits beside the media.
    const GLOWS: bool = false;
    /// Draws the next real collision along a world ray of unit direction that carries `weight`, and returns with it
    /// what the weight is to be multiplied by; `None` if the ray escapes, or comes to its end.
    fn collide(
        &self,
        ray: &Ray,
        weight: Vec3,
        sampler: &mut Sampler,
        scratch: &mut Scratch,
    ) -> Option<(Collision, Vec3)>;
    /// Returns what the weight of a ray is to be multiplied by that [`Media::collide`] let go on beyond a distance.
    fn survival(&self, ray: &Ray, distance: f64, weight: Vec3, scratch: &mut Scratch) -> Vec3;
    /// Walks along a camera's ray, before collisions are drawn on it.
    fn primary(&self, ray: &Ray, scratch: &mut Scratch) -> Primary;
    /// Returns the optical depth of a world ray of unit direction, by channel.
    fn optical_depth(&self, ray: &Ray, scratch: &mut Scratch) -> DVec3;
    /// Returns an estimate of the radiance of the grids beside the media along a world ray of unit direction, which may
    /// be a camera's ray that was walked before.
    fn emitted(&self, _: &Ray, _: Option<&Primary>, _: &mut Sampler, _: &mut Scratch) -> Vec3 {
        Vec3::ZERO
    }
    /// Walks along a camera's ray for [`Media::depth_before`]; `None` where parts of rays are better walked apart.
    fn walk(&self, _: &Ray, _: &mut Scratch) -> Option<TracedRay> {
        None
    }
    /// Returns the optical depth of the first `length` of the camera's ray that was walked last.
    fn depth_before(&self, _: &TracedRay, _length: f64, _: &Scratch) -> f64 {
        0.0
    }
    /// Returns the radiance of the grids beside the media along a part of a camera's ray, as far as no path draws it.
    fn glow(&self, _: &Ray, _: &mut Scratch) -> Vec3 {
        Vec3::ZERO
    }
    /// Draws the first collision along the camera's ray that was walked last.
    fn first(&self, ray: &Ray, primary: &Primary, sampler: &mut Sampler, scratch: &mut Scratch) -> Visible;
    /// Returns an estimate of the transmittance of the first `length` of a world ray of unit direction.
    fn transmittance(&self, ray: &Ray, length: f64, sampler: &mut Sampler, scratch: &mut Scratch) -> Vec3;
    /// Returns an estimate of the transmittance of the first `length` of a world ray of unit direction, which may be
    /// the camera's ray that was walked last.
    fn passed(
        &self,
        (ray, _): (&Ray, Option<&Primary>),
        length: f64,
        sampler: &mut Sampler,
        scratch: &mut Scratch,
    ) -> Vec3 {
        self.transmittance(ray, length, sampler, scratch)
    }
    /// Returns the part of a world ray of unit direction that is within the bounds of the media, wherever the ray ends.
    fn range(&self, ray: &Ray) -> Option<(f64, f64)>;
    /// Returns the extinction at a world position, the mean of the channels.
    fn extinction(&self, at: DVec3) -> f64;
    /// Returns the share of light per world length and steradian that is scattered at a world position, from direction
    /// `to` for a path that arrives in direction `from`.
    fn scattered(&self, at: DVec3, from: DVec3, to: DVec3) -> Vec3;
    /// Returns the share of the extinction that is scattered.
    fn albedo(&self, collision: &Collision) -> Vec3;
    /// Returns the radiance of the source, of which the share that is not scattered is emitted.
    fn source(&self, collision: &Collision) -> Vec3;
    /// Returns the phase function at the place of a collision.
    fn phase(&self, collision: &Collision, at: DVec3) -> Self::Phase;
    /// Returns the unit vector in which the density of a volume falls at a world position; 0 where it is constant.
    fn normal(&self, volume: usize, position: DVec3) -> DVec3;
}

/// One volume with its medium.
pub(super) struct One<'a, O, P> {
    /// Computes transmittances; its medium does not scatter.
    pub dvr: Dvr<'a, f32>,
    pub optics: O,
    /// Albedo, which the optics may multiply by a color at the density.
    pub albedo: Vec3,
    pub phases: P,
    pub shadows: Shadows,
}

/// How the transmittance of rays to lights is estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Shadows {
    /// Exact quadrature, without noise down to 5 %.
    Quadrature,
    /// Ratio tracking, which is faster where functions cut cells and where the medium is dense, and noisier.
    Ratio,
}

impl Shadows {
    /// Optical depth of bricks, by their majorants, from which ratio tracking takes less time to equal variance.
    const DENSE_BRICK: f64 = 0.35;

    /// Picks the cheaper one for a medium.
    fn cheaper(dvr: &Dvr<'_, f32>, optics: &Any) -> Self {
        let bounds = dvr.majorants().bricks().iter().filter(|bound| **bound > 0.0);
        let (sum, count) = bounds.fold((0.0, 0_u32), |(sum, count), bound| (sum + f64::from(*bound), count + 1));
        let edge = CELLS as f64 * dvr.field().transform.voxel_size().element_sum() / 3.0;
        let dense = sum * edge > Self::DENSE_BRICK * f64::from(count);
        if dense || matches!(optics, Any::Transfer(_)) { Self::Ratio } else { Self::Quadrature }
    }
}

/// Tentative collisions to be expected in a brick above which a ray goes on by exact quadrature: a bound that one voxel
/// sets tells nothing of the others.
const DENSE: f32 = 256.0;
/// Transmittance below which cameras' rays end.
pub(super) const LEAST_TRANSMITTANCE: f64 = 1e-9;
/// Optical depth from which transmittances are drawn: that of 5 %.
pub(super) const EXACT_DEPTH: f64 = 3.0;
/// Transmittance below which estimates by ratio tracking are drawn.
const LEAST_RATIO: f32 = 0.05;

/// Returns the volume for kernels that serve any medium, in its channel of most extinction.
pub(super) fn any<'a>(field: &'a Bricks<f32>, medium: &Medium) -> Result<One<'a, Any, Shaded>> {
    let medium = medium.clone().checked()?;
    let albedo = medium.scattering.map_or([0.0; 3], |scattering| scattering.albedo);
    let phases = Shaded::new(medium.scattering);
    let dvr = Dvr::new(field, medium.densest_channel())?.early_stop(LEAST_TRANSMITTANCE);
    let optics = Any::new(&medium.relative_to(field.reference));
    let largest = dvr.majorants().largest();
    if !largest.is_finite() {
        return Err(Error::invalid("the extinction is too large for single precision")
            .hint("give a smaller density scale, or correct the densities"));
    }
    let shadows = Shadows::cheaper(&dvr, &optics);
    Ok(One { dvr, optics, albedo: Vec3::from_array(albedo), phases, shadows })
}

/// Returns the volume for kernels that serve any medium whose albedo depends on the density.
pub(super) fn any_by_density<'a>(field: &'a Bricks<f32>, medium: &Medium) -> Result<One<'a, ByDensity<Any>, Shaded>> {
    Ok(any(field, medium)?.with(|optics| ByDensity::new(optics, medium, field.reference)))
}

/// Returns the volume for kernels that serve any medium at all, with surfaces that reflect.
pub(super) fn any_glossy<'a>(field: &'a Bricks<f32>, medium: &Medium) -> Result<One<'a, ByDensity<Any>, Glossy>> {
    let One { dvr, optics, albedo, phases, shadows } = any_by_density(field, medium)?;
    Ok(One { dvr, optics, albedo, phases: Glossy::new(phases, medium.scattering), shadows })
}

impl<'a, O, P> One<'a, O, P> {
    /// Returns the volume with other optics, made from its own.
    pub(super) fn with<Q>(self, optics: impl FnOnce(O) -> Q) -> One<'a, Q, P> {
        let Self { dvr, optics: own, albedo, phases, shadows } = self;
        One { dvr, optics: optics(own), albedo, phases, shadows }
    }
}

impl<O: DensityMedium, P> One<'_, O, P> {
    /// Calls `visit` with the distance, density, extinction and majorant at each tentative collision before `limit`,
    /// until it returns false. Returns, where a brick's bound is too loose for this, the place from which the ray goes
    /// on by exact quadrature, and the optical depth that is left to the next tentative collision.
    #[inline(always)]
    fn tentative(
        &self,
        ray: &Ray,
        limit: f64,
        sampler: &mut Sampler,
        counts: &mut Counts,
        mut visit: impl FnMut(&mut Sampler, f64, f32, f32, f32) -> bool,
    ) -> Option<(f64, f32)> {
        let field = self.dvr.field();
        let mut ray = IndexRay::new(&field.domain, &field.transform, ray)?;
        ray.leave = ray.leave.min(limit);
        let (bounds, values) = (self.dvr.majorants().bricks(), &field.values[..]);
        let (mut depth, mut dense) = (sampler.exponential(), None);
        spans(
            self.dvr.visible(),
            &ray,
            false,
            #[inline(always)]
            |span: Span<f32>| {
                let majorant = bounds[span.base / BRICK];
                if majorant * span.length > DENSE {
                    dense = Some((span.start, depth));
                    return false;
                }
                // Less than this is lost in the sum.
                let least = span.length * f32::EPSILON;
                let mut at = 0.0_f32;
                loop {
                    let step = (depth / majorant).max(least);
                    if at + step >= span.length {
                        depth = (depth - (span.length - at) * majorant).max(0.0);
                        return true;
                    }
                    at += step;
                    let density = dvr::density(values, &span, at);
                    let extinction = self.optics.extinction(density);
                    counts.lookups += 1;
                    counts.violations += u64::from(extinction > majorant * (1.0 + 4.0 * f32::EPSILON));
                    if !visit(sampler, span.start + f64::from(at), density, extinction, majorant) {
                        return false;
                    }
                    depth = sampler.exponential();
                }
            },
        );
        dense
    }

    /// Returns the density and the extinction at a world position; `None` where nothing is.
    #[inline(always)]
    pub(super) fn extinction_at(&self, at: DVec3) -> Option<(f32, f32)> {
        let field = self.dvr.field();
        let index = field.transform.to_index(at);
        if !(index.cmpge(field.domain.min) & index.cmple(field.domain.max)).all() {
            return None;
        }
        let corners = field.corners(index)?;
        let density = corners.iter().map(|(voxel, weight)| *weight as f32 * field.values[*voxel]).sum();
        let extinction = self.optics.extinction(density);
        (extinction > 0.0).then_some((density, extinction))
    }

    /// Draws the collision with this volume before `limit`.
    #[inline(always)]
    fn collision(&self, ray: &Ray, limit: f64, sampler: &mut Sampler, scratch: &mut Scratch) -> Option<(f64, f32)> {
        let mut found = None;
        let dense = self.tentative(
            ray,
            limit,
            sampler,
            &mut scratch.counts,
            #[inline(always)]
            |sampler, distance, density, extinction, majorant| {
                let real = (sampler.uniform() as f32) * majorant < extinction;
                if real {
                    found = Some((distance, density));
                }
                !real
            },
        );
        let Some((start, depth)) = dense else { return found };
        let rest = Ray::new(ray.at(start), ray.direction);
        let found = self.dvr.collision_at(&rest, depth.into(), limit - start, &mut scratch.tape);
        found.map(|(distance, density)| (start + distance, density))
    }

    /// Returns an estimate of the transmittance of the first `length` of a ray by exact quadrature: the exact one down
    /// to 5 %, and below that 5 % or 0.
    #[inline(always)]
    fn quadrature(&self, ray: &Ray, length: f64, sampler: &mut Sampler, scratch: &mut Scratch) -> f32 {
        // Beyond, the ray survives with the probability of what is left: the mean stays, and the walk ends soon.
        let limit = EXACT_DEPTH + f64::from(sampler.exponential());
        let depth = self.dvr.optical_depth_within(ray, length, limit, &mut scratch.tape);
        if depth < limit { (-depth.min(EXACT_DEPTH)).exp() as f32 } else { 0.0 }
    }

    /// Returns an estimate of the transmittance of the first `length` of a ray by ratio tracking (Novák et al. 2014):
    /// the product of the chances that no tentative collision is a real one, and below 5 % roulette.
    #[inline(always)]
    fn ratio(&self, ray: &Ray, length: f64, sampler: &mut Sampler, scratch: &mut Scratch) -> f32 {
        let mut product = 1.0_f32;
        let dense = self.tentative(
            ray,
            length,
            sampler,
            &mut scratch.counts,
            #[inline(always)]
            |sampler, _, _, extinction, majorant| {
                product *= 1.0 - (extinction / majorant).min(1.0);
                if product < LEAST_RATIO {
                    let survives = (sampler.uniform() as f32) * LEAST_RATIO < product;
                    product = if survives { LEAST_RATIO } else { 0.0 };
                }
                product > 0.0
            },
        );
        let Some((start, _)) = dense else { return product };
        let rest = Ray::new(ray.at(start), ray.direction);
        product * self.quadrature(&rest, length - start, sampler, scratch)
    }
}

impl<O: DensityMedium, P: Phases> Media for One<'_, O, P> {
    type Phase = P::At;
    const EMITS: bool = O::EMITS;

    #[inline(always)]
    fn collide(&self, ray: &Ray, _: Vec3, sampler: &mut Sampler, scratch: &mut Scratch) -> Option<(Collision, Vec3)> {
        let (distance, density) = self.collision(ray, ray.far, sampler, scratch)?;
        Some((Collision { distance, density, volume: 0 }, Vec3::ONE))
    }

    #[inline(always)]
    fn survival(&self, _: &Ray, _: f64, _: Vec3, _: &mut Scratch) -> Vec3 {
        Vec3::ONE
    }

    #[inline(always)]
    fn primary(&self, ray: &Ray, scratch: &mut Scratch) -> Primary {
        Primary { walked: Some(self.dvr.walk(ray, &mut scratch.camera)), ..Primary::default() }
    }

    fn walk(&self, ray: &Ray, scratch: &mut Scratch) -> Option<TracedRay> {
        let walked = self.dvr.walk(ray, &mut scratch.camera);
        self.dvr.depth_before(&walked, 0.0, &scratch.camera).map(|_| walked)
    }

    fn depth_before(&self, walked: &TracedRay, length: f64, scratch: &Scratch) -> f64 {
        self.dvr.depth_before(walked, length, &scratch.camera).unwrap_or_default()
    }

    fn optical_depth(&self, ray: &Ray, scratch: &mut Scratch) -> DVec3 {
        DVec3::splat(self.dvr.optical_depth_within(ray, f64::INFINITY, f64::INFINITY, &mut scratch.tape))
    }

    /// The transmittance is exact, and every ray that meets the medium collides with it.
    #[inline(always)]
    fn first(&self, _: &Ray, primary: &Primary, sampler: &mut Sampler, scratch: &mut Scratch) -> Visible {
        let [u, spare, ..] = sampler.stratified();
        let Some(walked) = &primary.walked else {
            return Visible { transmittance: Vec3::ONE, collision: None, spare };
        };
        let transmittance = (-walked.depth).exp();
        let share = -(-walked.depth).exp_m1();
        let found = walked.collision(u).and_then(|depth| self.dvr.locate(walked, depth, &mut scratch.camera));
        let weight = Vec3::splat(share as f32);
        let collision = found.map(|(distance, density)| (Collision { distance, density, volume: 0 }, weight));
        Visible { transmittance: Vec3::splat(transmittance as f32), collision, spare }
    }

    #[inline(always)]
    fn transmittance(&self, ray: &Ray, length: f64, sampler: &mut Sampler, scratch: &mut Scratch) -> Vec3 {
        Vec3::splat(match self.shadows {
            Shadows::Quadrature => self.quadrature(ray, length, sampler, scratch),
            Shadows::Ratio => self.ratio(ray, length, sampler, scratch),
        })
    }

    #[inline(always)]
    fn passed(
        &self,
        (ray, primary): (&Ray, Option<&Primary>),
        length: f64,
        sampler: &mut Sampler,
        scratch: &mut Scratch,
    ) -> Vec3 {
        let walked = primary.and_then(|primary| primary.walked.as_ref());
        let depth = walked.and_then(|walked| self.dvr.depth_before(walked, length, &scratch.camera));
        depth.map_or_else(
            || self.transmittance(ray, length, sampler, scratch),
            |depth| Vec3::splat((-depth).exp() as f32),
        )
    }

    #[inline(always)]
    fn range(&self, ray: &Ray) -> Option<(f64, f64)> {
        let (field, whole) = (self.dvr.field(), Ray::new(ray.origin, ray.direction));
        IndexRay::new(&field.domain, &field.transform, &whole).map(|ray| (ray.enter, ray.leave))
    }

    #[inline(always)]
    fn extinction(&self, at: DVec3) -> f64 {
        self.extinction_at(at).map_or(0.0, |(_, extinction)| extinction.into())
    }

    #[inline(always)]
    fn scattered(&self, at: DVec3, from: DVec3, to: DVec3) -> Vec3 {
        let Some((density, extinction)) = self.extinction_at(at) else { return Vec3::ZERO };
        let phase = self.phases.at(self.dvr.field(), at);
        let albedo = self.optics.albedo(density, self.albedo);
        if P::At::COLORED {
            return phase.color(albedo, from, to) * extinction;
        }
        albedo * extinction * phase.value(from, to) as f32
    }

    #[inline(always)]
    fn albedo(&self, collision: &Collision) -> Vec3 {
        self.optics.albedo(collision.density, self.albedo)
    }

    #[inline(always)]
    fn source(&self, collision: &Collision) -> Vec3 {
        self.optics.source(collision.density)
    }

    #[inline(always)]
    fn phase(&self, _: &Collision, at: DVec3) -> P::At {
        self.phases.at(self.dvr.field(), at)
    }

    fn normal(&self, _: usize, position: DVec3) -> DVec3 {
        let field = self.dvr.field();
        -gradient(field, field.transform.to_index(position), 0.0).normalize_or_zero()
    }
}

/// Returns the smallest part of a ray that contains two others.
#[inline(always)]
pub(super) fn joined(a: (f64, f64), b: (f64, f64)) -> (f64, f64) {
    (a.0.min(b.0), a.1.max(b.1))
}

/// Several volumes, which may overlap: their extinctions add.
impl<O: DensityMedium, P: Phases> Media for Vec<One<'_, O, P>> {
    type Phase = P::At;
    const EMITS: bool = true;
    const DRAWS: bool = true;

    /// Collisions with each volume are independent, and the nearest of them is the first.
    #[inline(always)]
    fn collide(&self, ray: &Ray, _: Vec3, sampler: &mut Sampler, scratch: &mut Scratch) -> Option<(Collision, Vec3)> {
        let mut nearest: Option<Collision> = None;
        for (volume, one) in self.iter().enumerate() {
            let limit = nearest.map_or(ray.far, |c| c.distance);
            if let Some((distance, density)) = one.collision(ray, limit, sampler, scratch) {
                nearest = Some(Collision { distance, density, volume });
            }
        }
        nearest.map(|collision| (collision, Vec3::ONE))
    }

    #[inline(always)]
    fn survival(&self, _: &Ray, _: f64, _: Vec3, _: &mut Scratch) -> Vec3 {
        Vec3::ONE
    }

    /// Collisions are drawn by tracking: there is nothing to be prepared.
    #[inline(always)]
    fn primary(&self, _: &Ray, _: &mut Scratch) -> Primary {
        Primary::default()
    }

    fn optical_depth(&self, ray: &Ray, scratch: &mut Scratch) -> DVec3 {
        self.iter().map(|one| one.optical_depth(ray, scratch)).sum()
    }

    #[inline(always)]
    fn first(&self, ray: &Ray, _: &Primary, sampler: &mut Sampler, scratch: &mut Scratch) -> Visible {
        // What is beyond the end is drawn and counts for nothing, so that all else is that of the whole ray.
        let collision = self.collide(&Ray::new(ray.origin, ray.direction), Vec3::ONE, sampler, scratch);
        let collision = collision.filter(|(collision, _)| collision.distance <= ray.far);
        let transmittance = if collision.is_some() { Vec3::ZERO } else { Vec3::ONE };
        Visible { transmittance, collision, spare: 0.0 }
    }

    #[inline(always)]
    fn transmittance(&self, ray: &Ray, length: f64, sampler: &mut Sampler, scratch: &mut Scratch) -> Vec3 {
        self.iter().map(|one| one.transmittance(ray, length, sampler, scratch)).product()
    }

    #[inline(always)]
    fn range(&self, ray: &Ray) -> Option<(f64, f64)> {
        self.iter().filter_map(|one| one.range(ray)).reduce(joined)
    }

    #[inline(always)]
    fn extinction(&self, at: DVec3) -> f64 {
        self.iter().map(|one| one.extinction(at)).sum()
    }

    #[inline(always)]
    fn scattered(&self, at: DVec3, from: DVec3, to: DVec3) -> Vec3 {
        self.iter().map(|one| one.scattered(at, from, to)).sum()
    }

    #[inline(always)]
    fn albedo(&self, collision: &Collision) -> Vec3 {
        self[collision.volume].albedo(collision)
    }

    #[inline(always)]
    fn source(&self, collision: &Collision) -> Vec3 {
        self[collision.volume].source(collision)
    }

    #[inline(always)]
    fn phase(&self, collision: &Collision, at: DVec3) -> P::At {
        self[collision.volume].phase(collision, at)
    }

    fn normal(&self, volume: usize, position: DVec3) -> DVec3 {
        self[volume].normal(0, position)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use crate::math::Affine;
    use crate::scene::medium::Source;
    use crate::scene::table::Table;
    use crate::scene::topology::Topology;
    use glam::IVec3;
    use std::sync::Arc;

    /// A plume of three bricks, smooth but for one voxel that is `spike`.
    fn plume(spike: f32) -> Bricks<f32> {
        let topology = Arc::new(Topology::new((0..3).map(|x| IVec3::new(x, 0, 0))).unwrap());
        let value = |p: IVec3| match p {
            IVec3 { x: 11, y: 4, z: 4 } => spike,
            _ => 0.5 + 0.5 * (0.4 * p.as_vec3()).dot(Vec3::new(1.0, 0.7, -0.3)).sin(),
        };
        let owned = topology
            .bricks()
            .iter()
            .flat_map(|brick| (0..512).map(move |i| value(*brick * 8 + IVec3::new(i >> 6, (i >> 3) & 7, i & 7))));
        let owned: Vec<f32> = owned.collect();
        let mut field = Bricks::zeros(topology.clone(), Affine::uniform(1.0, DVec3::ZERO).unwrap());
        topology.fill_apron(&owned, &mut field.values);
        field
    }

    /// Ratio tracking has the mean of exact quadrature: in thin and dense media, through a function, and where a bound
    /// is so loose that the rest of the ray goes by quadrature.
    #[test]
    fn ratio_tracking_is_unbiased() {
        let points = [0.0, 3.0, 0.2, 0.0, 1.0, 0.5].map(|sigma| [0.0, 0.0, 0.0, sigma]);
        let function =
            Source::Transfer(Arc::new(Table::new(vec![0.05, 0.2, 0.3, 0.6, 0.6, 0.9], points.into()).unwrap()));
        let cases = [
            (Medium::absorbing(0.01), 0.3),
            (Medium::absorbing(0.2), 0.3),
            (Medium::absorbing(0.2), 1e6),
            (Medium::new(0.1, function), 0.3),
        ];
        let oblique = Ray::new(DVec3::new(-2.0, 1.0, 6.5), DVec3::new(1.0, 0.2, -0.15).normalize());
        for (medium, spike) in cases {
            let field = plume(spike);
            let one = any(&field, &medium).unwrap();
            let mut scratch = Scratch::default();
            for length in [9.0, f64::INFINITY] {
                let depth = one.dvr.optical_depth_within(&oblique, length, f64::INFINITY, &mut scratch.tape);
                let (mut sum, mut squares) = (0.0, 0.0);
                let draws = 20_000;
                for number in 0..draws {
                    let mut sampler = Sampler::new(3, [0, 0], number);
                    let found = f64::from(one.ratio(&oblique, length, &mut sampler, &mut scratch));
                    sum += found;
                    squares += found * found;
                }
                let mean = sum / f64::from(draws);
                let error = ((squares / f64::from(draws) - mean * mean) / f64::from(draws)).sqrt();
                assert!(
                    (mean - (-depth).exp()).abs() < 4.0 * error + 1e-6,
                    "{medium:?} {length}: {mean} ± {error}, {depth}"
                );
            }
            assert_eq!(scratch.counts.violations, 0);
        }
    }
}
