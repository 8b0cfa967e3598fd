//! Integrators: estimates of the light that arrives along a camera's ray.

use super::sampler::Sampler;
use crate::math::Ray;
use glam::{DVec3, Vec3};

/// One estimate of the light along a camera's ray.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Sample {
    /// Radiance that was not scattered: emitted towards the camera, and from behind the media.
    pub unscattered: Vec3,
    /// Radiance of lights and environment that was scattered once.
    pub direct: Vec3,
    /// Radiance that was scattered more often, and emission that was scattered.
    pub indirect: Vec3,
    /// Transmittance of the ray, the mean of the channels.
    pub transmittance: f32,
    /// First collision along the ray.
    pub first: Option<First>,
    /// Surface that the ray meets, as far as it is seen through the media.
    pub surface: Option<First>,
}

impl Sample {
    /// Returns the radiance in all.
    #[inline(always)]
    pub fn radiance(&self) -> Vec3 {
        self.unscattered + self.direct + self.indirect
    }

    /// Returns color and alpha = 1 - transmittance.
    #[inline(always)]
    pub(crate) fn rgba(&self) -> [f32; 4] {
        self.radiance().extend(1.0 - self.transmittance).to_array()
    }

    /// Scales the scattered radiance down to at most `most` in each channel, and counts what is lost.
    pub(crate) fn clamp(&mut self, most: f32, counts: &mut Counts) {
        let scattered = self.direct + self.indirect;
        let share = most / scattered.max_element();
        if share < 1.0 {
            self.direct *= share;
            self.indirect *= share;
            counts.clamped += 1;
            counts.lost += f64::from(mean(scattered) * (1.0 - share));
        }
    }
}

/// Returns the mean of the channels, exactly that of equal ones.
#[inline(always)]
pub(crate) fn mean(color: Vec3) -> f32 {
    if color.x == color.y && color.y == color.z { color.x } else { color.element_sum() / 3.0 }
}

/// First interaction of a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct First {
    /// World length from the ray's origin.
    pub distance: f64,
    /// Position in world space.
    pub position: DVec3,
    /// Share of the light that is scattered, by channel.
    pub albedo: Vec3,
    /// Kind of the interaction.
    pub interaction: Interaction,
    /// Weight of the collision, the opacity of the camera's ray, or of the surface, the transmittance to it; or an
    /// estimate of it.
    pub share: f32,
}

/// Interaction of a path with the scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Interaction {
    /// A volume, by its number.
    Volume(usize),
    /// A surface with this unit normal on the side of the ray.
    Surface(DVec3),
}

/// Number of events while paths were traced.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Counts {
    /// Paths.
    pub paths: u64,
    /// Real collisions with a medium.
    pub collisions: u64,
    /// Densities looked up on the way to collisions.
    pub lookups: u64,
    /// Rays to lights whose transmittance was computed.
    pub shadow_rays: u64,
    /// Extinctions above their majorant. Any of them biases the picture.
    pub violations: u64,
    /// Directions drawn whose probability density was 0 or not a number. Any of them biases the picture.
    pub impossible: u64,
    /// Paths that were given up before they ended. Any of them biases the picture.
    pub unfinished: u64,
    /// Paths whose scattered radiance was clamped.
    pub clamped: u64,
    /// Radiance that they lost, the mean of the channels.
    pub lost: f64,
}

impl Counts {
    /// Returns the sums of both.
    #[must_use]
    pub fn plus(self, o: Self) -> Self {
        Self {
            paths: self.paths + o.paths,
            collisions: self.collisions + o.collisions,
            lookups: self.lookups + o.lookups,
            shadow_rays: self.shadow_rays + o.shadow_rays,
            violations: self.violations + o.violations,
            impossible: self.impossible + o.impossible,
            unfinished: self.unfinished + o.unfinished,
            clamped: self.clamped + o.clamped,
            lost: self.lost + o.lost,
        }
    }
}

/// Estimates the light along cameras' rays.
pub trait Integrator: Sync {
    /// State that all estimates along one ray share.
    type Primary: Copy;
    /// Scratch memory of a task, reused from ray to ray.
    type Scratch: Default + Send;

    /// Walks along a camera's ray of unit direction, in world space.
    fn primary(&self, ray: &Ray, scratch: &mut Self::Scratch) -> Self::Primary;

    /// Returns an estimate of the light along the ray that was walked last with this scratch memory.
    fn li(&self, ray: &Ray, primary: &Self::Primary, sampler: &mut Sampler, scratch: &mut Self::Scratch) -> Sample;

    /// Returns the optical depth of the ray that was walked last, the mean of the channels.
    fn optical_depth(&self, ray: &Ray, primary: &Self::Primary, scratch: &mut Self::Scratch) -> f64;

    /// Returns the normal of a surface that the ray which was walked last met, or the unit vector in which the density
    /// falls at its collision; 0 where it is constant.
    fn normal(&self, primary: &Self::Primary, first: &First) -> DVec3;

    /// Returns the number of events since the last call.
    fn take_counts(scratch: &mut Self::Scratch) -> Counts;
}
