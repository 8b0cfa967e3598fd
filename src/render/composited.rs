//! The medium composited over its background: the one place where the two are combined.
//!
//! `L = emitted + T · background`, `alpha = 1 - T`: value, and derivatives in reverse and in forward mode.

use super::deep::{DeepIntegrator, Slice};
use super::differentiable::{Accumulators, Adjoint, Cotangent, Differentiable, Forward, ParameterGradient};
use super::differentiable::{RayGradient, Seeds, TangentRadiance};
use super::emission_absorption::{EmissionAbsorption, Radiance};
use super::film::Subpixels;
use super::integrator::{Counts, First, Integrator, Sample};
use super::sampler::Sampler;
use crate::dual::Dual;
use crate::math::Ray;
use crate::real::Real;
use crate::scene::camera::Camera;
use glam::DVec3;

/// Radiance of a medium over its background, as stored in a pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pixel<R> {
    /// Radiance in red, green and blue, the attenuated background included.
    pub rgb: [R; 3],
    /// Transmittance of the whole ray.
    pub transmittance: R,
    /// Optical depth of the whole ray.
    pub depth: f64,
}

impl<R: Real> Pixel<R> {
    /// Returns color and alpha = 1 - transmittance.
    pub fn rgba(&self) -> [R; 4] {
        [self.rgb[0], self.rgb[1], self.rgb[2], R::ONE - self.transmittance]
    }
}

/// A [`Pixel`] with its derivatives along `P` directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TangentPixel<R, const P: usize> {
    /// Radiance in red, green and blue, the attenuated background included.
    pub rgb: [Dual<R, P>; 3],
    /// Transmittance of the whole ray.
    pub transmittance: Dual<R, P>,
    /// Optical depth of the whole ray.
    pub depth: Dual<f64, P>,
}

impl<R: Real, const P: usize> TangentPixel<R, P> {
    /// Returns the pixel without its derivatives.
    pub fn pixel(&self) -> Pixel<R> {
        Pixel { rgb: self.rgb.map(|c| c.value), transmittance: self.transmittance.value, depth: self.depth.value }
    }

    /// Returns color and alpha = 1 - transmittance, with their derivatives.
    pub fn rgba(&self) -> [Dual<R, P>; 4] {
        [self.rgb[0], self.rgb[1], self.rgb[2], Dual::constant(R::ONE) - self.transmittance]
    }
}

/// Maps a pixel to the derivatives of a loss with respect to red, green, blue and alpha.
pub(crate) type PixelLoss<'l, R> = &'l mut dyn FnMut(&Pixel<R>) -> [R; 4];

/// A medium that emits and absorbs, and the constant radiance behind it.
#[derive(Debug, Clone)]
pub struct Composited<I> {
    /// Medium along straight rays.
    pub medium: I,
    /// Radiance behind the medium, in red, green and blue.
    pub background: [f32; 3],
}

impl<I: EmissionAbsorption> Composited<I> {
    /// Composites a radiance of the medium over the background.
    #[inline(always)]
    pub(crate) fn composite(&self, light: &Radiance) -> Pixel<I::Real> {
        self.attenuated(light, light.transmittance())
    }

    /// Computes [`Composited::composite`] from a transmittance that is known already.
    #[inline(always)]
    fn attenuated(&self, light: &Radiance, transmittance: f64) -> Pixel<I::Real> {
        let channel = |c: usize| I::Real::of(light.rgb[c] + f64::from(self.background[c]) * transmittance);
        Pixel {
            rgb: [channel(0), channel(1), channel(2)],
            transmittance: I::Real::of(transmittance),
            depth: light.depth,
        }
    }

    /// Replaces the medium by `change` of it, over the same background.
    #[must_use]
    pub fn with(self, change: impl FnOnce(I) -> I) -> Self {
        Self { medium: change(self.medium), ..self }
    }

    /// Returns the largest channel of the background.
    pub(crate) fn brightest_background(&self) -> f64 {
        self.background.into_iter().fold(0.0, |m: f64, v| m.max(v.into()))
    }

    /// Returns the pixel of a world ray of unit direction.
    pub fn pixel(&self, ray: &Ray) -> Pixel<I::Real> {
        self.pixel_on(ray, &mut I::Scratch::default())
    }

    /// Returns the pixel of a world ray of unit direction, with scratch memory that is reused from ray to ray.
    #[inline(always)]
    pub fn pixel_on(&self, ray: &Ray, scratch: &mut I::Scratch) -> Pixel<I::Real> {
        let light = self.medium.integrate(ray, scratch);
        let pixel = self.composite(&light);
        // What stands in the way hides the background.
        if ray.ends() { Pixel { rgb: light.rgb.map(I::Real::of), ..pixel } } else { pixel }
    }
}

impl<I: EmissionAbsorption<Real = f32>> Composited<I> {
    /// Returns RGBA of one pixel, the mean over its rays.
    pub fn mean(&self, camera: &Camera, rays: Subpixels, at: [usize; 2], scratch: &mut I::Scratch) -> [f32; 4] {
        let (mut mean, share) = ([0.0; 4], 1.0 / rays.count() as f32);
        for [x, y] in rays.positions(at) {
            let rgba = self.pixel_on(&camera.ray(x, y), scratch).rgba();
            mean.iter_mut().zip(rgba).for_each(|(mean, v)| *mean += share * v);
        }
        mean
    }
}

/// Without random numbers: all estimates along a ray are alike.
impl<I: EmissionAbsorption<Real = f32>> Integrator for Composited<I> {
    type Primary = Pixel<f32>;
    type Scratch = I::Scratch;

    #[inline(always)]
    fn primary(&self, ray: &Ray, scratch: &mut I::Scratch) -> Pixel<f32> {
        self.pixel_on(ray, scratch)
    }

    #[inline(always)]
    fn li(&self, _: &Ray, pixel: &Pixel<f32>, _: &mut Sampler, _: &mut I::Scratch) -> Sample {
        let Pixel { rgb, transmittance, .. } = *pixel;
        Sample { unscattered: rgb.into(), transmittance, ..Sample::default() }
    }

    fn optical_depth(&self, _: &Ray, pixel: &Pixel<f32>, _: &mut I::Scratch) -> f64 {
        pixel.depth
    }

    fn normal(&self, _: &Self::Primary, _: &First) -> DVec3 {
        DVec3::ZERO
    }

    fn take_counts(_: &mut I::Scratch) -> Counts {
        Counts::default()
    }
}

/// Slices tell all.
impl<I: EmissionAbsorption<Real = f32>> DeepIntegrator for Composited<I> {
    const DRAWS: bool = false;
    type Traversal = ();

    fn walk(&self, _: &Ray, _: &mut I::Scratch) {}

    #[inline(always)]
    fn slice(&self, (ray, ()): (&Ray, &mut ()), part: [f64; 2], scratch: &mut I::Scratch) -> Slice {
        let Radiance { rgb, depth } = self.medium.integrate_part(ray, part, scratch);
        Slice { rgb: rgb.into(), depth: DVec3::splat(depth) }
    }
}

impl<I: Differentiable> Composited<I> {
    /// Returns the pixel of a world ray of unit direction; adds the gradient of a loss on it to the accumulators
    /// (vector-Jacobian product).
    pub fn vjp(
        &self,
        ray: &Ray,
        loss: PixelLoss<'_, I::Real>,
        adjoint: Adjoint,
        to: Accumulators<'_, I::Voxel>,
        scratch: &mut I::Scratch,
    ) -> Pixel<I::Real> {
        let (mut by_background, mut pixel) = ([0.0; 3], None);
        let Accumulators { voxels, table, ray: by_ray, shared } = to;
        let mut composited = |light: &Radiance| {
            let transmittance = light.transmittance();
            let [r, g, b, alpha] = loss(pixel.insert(self.attenuated(light, transmittance)));
            let rgb = [r, g, b];
            let mut by_transmittance = -alpha.f64();
            for (c, by) in rgb.into_iter().enumerate() {
                by_background[c] = by.f64() * transmittance;
                by_transmittance += by.f64() * f64::from(self.background[c]);
            }
            Cotangent { rgb, transmittance: by_transmittance }
        };
        let inner = Accumulators { voxels, table, ray: by_ray, shared: &mut *shared };
        let light = self.medium.vjp(ray, &mut composited, adjoint, inner, scratch);
        shared.background.iter_mut().zip(by_background).for_each(|(sum, by)| *sum += by);
        // Every medium asks the loss once.
        pixel.unwrap_or_else(|| self.composite(&light))
    }

    /// Returns the pixel of a world ray of unit direction; adds to `to` the gradient with respect to the ray of a loss,
    /// which is given by its derivatives with respect to red, green, blue and alpha.
    pub fn ray_vjp(
        &self,
        ray: &Ray,
        loss: [I::Real; 4],
        to: &mut RayGradient,
        scratch: &mut I::Scratch,
    ) -> Pixel<I::Real> {
        let mut shared = ParameterGradient::default();
        let to = Accumulators { voxels: None, table: None, ray: Some(to), shared: &mut shared };
        self.vjp(ray, &mut |_| loss, Adjoint::Tape, to, scratch)
    }

    /// Returns the pixel of a world ray of unit direction with its derivatives along `P` directions (Jacobian-vector
    /// products).
    pub fn jvp<const P: usize>(
        &self,
        ray: &Ray,
        seeds: &Seeds<'_, I::Voxel, P>,
        scratch: &mut I::Scratch,
    ) -> TangentPixel<I::Real, P>
    where
        I: Forward<P>,
    {
        let TangentRadiance { rgb, depth } = self.medium.jvp(ray, seeds, scratch);
        let light = Radiance { rgb: rgb.map(|c| c.value), depth: depth.value };
        let pixel = self.composite(&light);
        let transmittance = light.transmittance();
        let by_transmittance = depth.tangent.map(|d| -transmittance * d);
        let channel = |c: usize, p: usize| {
            let background =
                seeds.shared[p].background[c] * transmittance + f64::from(self.background[c]) * by_transmittance[p];
            I::Real::of(background + rgb[c].tangent[p])
        };
        let with = |value, tangent| Dual { value, tangent };
        TangentPixel {
            rgb: std::array::from_fn(|c| with(pixel.rgb[c], std::array::from_fn(|p| channel(c, p)))),
            transmittance: with(pixel.transmittance, by_transmittance.map(I::Real::of)),
            depth,
        }
    }
}
