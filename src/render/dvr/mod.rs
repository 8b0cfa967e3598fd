//! Direct volume rendering: emission and absorption along straight rays, and its derivative.
//!
//! `L = ∫ T(t) σ(t) c(t) dt + T(end) · background`, `T(t) = exp(-∫σ)`
//! (Max 1995; Weiss & Westermann 2021, eq. 1).
//!
//! [`Dvr`] picks its kernel once a tile: the quadrature rule and the source are types
//! inside the loops, so what a scene does not call for costs nothing there.

mod adjoint;
mod inversion;
mod kernel;
mod light;

pub use adjoint::{Adjoint, ParameterGradient, Tape};

use crate::error::Result;
use crate::math::Ray;
use crate::real::Real;
use crate::render::march::IndexRay;
use crate::render::quadrature::Quadrature;
use crate::render::rule::{ExactDepth, ExactSource, Uniform};
use crate::scene::bricks::Bricks;
use crate::scene::medium::{Medium, Source};
use kernel::{blend, grey, over};
use light::Proportional;

/// What is seen along one ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Radiance<R> {
    /// Radiance of the three channels, the attenuated background included.
    pub rgb: [R; 3],
    /// Transmittance of the whole ray.
    pub transmittance: R,
}

impl<R: Real> Radiance<R> {
    /// Colour and alpha = 1 - transmittance.
    pub fn rgba(&self) -> [R; 4] {
        [self.rgb[0], self.rgb[1], self.rgb[2], R::ONE - self.transmittance]
    }
}

/// Direct volume renderer of a density field in precision `R`.
#[derive(Debug, Clone)]
pub struct Dvr<'a, R> {
    field: &'a Bricks<R>,
    medium: Medium,
    background: [f32; 3],
    quadrature: Quadrature,
    /// Optical depth at which a ray ends.
    depth_limit: f64,
    /// World length of one voxel along its shortest edge: the unit of the quadrature's steps.
    voxel: f64,
    /// Radiance error allowed per piece where the source varies.
    tolerance: f64,
}

impl<'a, R: Real> Dvr<'a, R> {
    /// A renderer with exact quadrature, a white background and rays that end when no more than
    /// 1e-6 of the light behind could reach the eye.
    ///
    /// # Errors
    /// If the medium's numbers are not usable.
    pub fn new(field: &'a Bricks<R>, medium: Medium) -> Result<Self> {
        let renderer = Self {
            field,
            medium: medium.checked()?,
            background: [1.0; 3],
            quadrature: Quadrature::Exact,
            depth_limit: f64::INFINITY,
            voxel: field.transform.voxel_size().min_element(),
            tolerance: 4e-7,
        };
        Ok(renderer.early_stop(1e-6))
    }

    /// Sets the radiance behind the volume.
    #[must_use]
    pub fn background(mut self, background: [f32; 3]) -> Self {
        self.background = background;
        self
    }

    /// Sets the quadrature rule.
    #[must_use]
    pub fn quadrature(mut self, quadrature: Quadrature) -> Self {
        self.quadrature = quadrature;
        self
    }

    /// Ends a ray once its transmittance is below `transmittance` (0: never). The radiance left out
    /// is at most `transmittance` times the brightest of background and source.
    #[must_use]
    pub fn early_stop(mut self, transmittance: f64) -> Self {
        self.depth_limit = -transmittance.ln();
        self
    }

    /// The field that is rendered.
    pub fn field(&self) -> &'a Bricks<R> {
        self.field
    }

    #[inline(always)]
    fn index_ray(&self, ray: &Ray) -> Option<IndexRay> {
        IndexRay::new(&self.field.topology, &self.field.transform, ray)
    }

    #[inline(always)]
    fn uniform(&self, step: f64, phase: f64, ray: &IndexRay) -> Uniform {
        Uniform { step: step * self.voxel, phase, enter: ray.enter, leave: ray.leave }
    }

    #[inline(always)]
    fn exact_source(&self, colour: [f32; 3]) -> ExactSource {
        let brightest = f64::from(colour.into_iter().fold(f32::MIN_POSITIVE, f32::max));
        ExactSource { extinction: self.medium.extinction, tolerance: self.tolerance / brightest }
    }

    /// Optical depth `∫σ` along a world ray of unit direction, summed in `f64`.
    pub fn optical_depth(&self, ray: &Ray) -> f64 {
        self.depth_with(ray, &mut Tape::default())
    }

    /// Radiance along a world ray of unit direction.
    pub fn radiance(&self, ray: &Ray) -> Radiance<R> {
        self.radiance_with(ray, &mut Tape::default())
    }

    #[inline(always)]
    fn depth_with(&self, ray: &Ray, tape: &mut Tape<R>) -> f64 {
        let Some(ray) = self.index_ray(ray) else { return 0.0 };
        tape.forget();
        let cells = &mut tape.cells;
        let blend = match self.quadrature {
            Quadrature::Exact => kernel::depth(self, &ray, ExactDepth, cells, false),
            Quadrature::Midpoint(h) => kernel::depth(self, &ray, self.uniform(h, 0.5, &ray), cells, false),
            Quadrature::Riemann(h) => kernel::depth(self, &ray, self.uniform(h, 0.0, &ray), cells, false),
        };
        blend.depth
    }

    /// [`Dvr::radiance`] for many rays: the scratch memory is kept.
    #[inline(always)]
    pub fn radiance_with(&self, ray: &Ray, tape: &mut Tape<R>) -> Radiance<R> {
        let colour = match self.medium.source {
            Source::Grey(colour) => return grey(self.depth_with(ray, tape), colour, self.background),
            Source::Linear(colour) => colour,
        };
        let Some(ray) = self.index_ray(ray) else { return grey(0.0, colour, self.background) };
        let Tape { samples, chords, .. } = tape;
        let seen = match self.quadrature {
            Quadrature::Exact => blend(self, &ray, self.exact_source(colour), Proportional, chords, |_| ()),
            Quadrature::Midpoint(h) => blend(self, &ray, self.uniform(h, 0.5, &ray), Proportional, samples, |_| ()),
            Quadrature::Riemann(h) => blend(self, &ray, self.uniform(h, 0.0, &ray), Proportional, samples, |_| ()),
        };
        over(seen.emitted, (-seen.depth).exp(), colour, self.background)
    }
}
