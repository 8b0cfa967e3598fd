//! Surfaces of a density along straight rays, shaded by a light at the camera.

use super::composited::Composited;
use super::curve::Curve;
use super::dvr::{self, Dvr};
use super::emission_absorption::{EmissionAbsorption, Radiance};
use super::gradient::gradient;
use super::march::{IndexRay, Span, spans};
use crate::error::{Error, Result};
use crate::math::Ray;
use crate::scene::bricks::Bricks;
use crate::scene::medium::{Medium, Source};
use crate::scene::scene::Scene;
use crate::scene::shading::Shading;
use crate::scene::volume::Volume;
use glam::DVec3;

/// A density through a transfer function whose surfaces are shaded ([`Shading`]), sampled in the middle of steps of
/// constant length.
///
/// Shading varies with the direction of the gradient, which no table holds: no bound of its error is stated.
#[derive(Debug)]
pub struct Shaded<'a> {
    dvr: Dvr<'a, f32>,
    curve: Curve<f32, 3>,
    shading: Shading,
    /// Standard deviation in voxels of the filter that gradients are taken through.
    gradient_scale: f64,
    /// World length of a step.
    step: f64,
}

impl<'a> Shaded<'a> {
    /// Creates the integrator of a medium with a transfer function; `step` is in voxels of the shortest edge.
    ///
    /// # Errors
    /// If the medium has no transfer function, or a number cannot be used.
    pub fn new(
        field: &'a Bricks<f32>,
        medium: Medium,
        (shading, gradient_scale): (Shading, f64),
        step: f64,
    ) -> Result<Self> {
        let Source::Transfer(table) = &medium.source else {
            return Err(Error::unsupported("shading needs a transfer function: without one there are no surfaces")
                .hint("give ⟨tf⟩, or leave out ⟨shade⟩"));
        };
        let curve = Curve::new(table, medium.extinction);
        let step = step * field.transform.voxel_size().min_element();
        Ok(Self { dvr: Dvr::new(field, medium)?, curve, shading: shading.checked()?, gradient_scale, step })
    }

    /// Creates the integrator of the one volume of a scene, over its background.
    ///
    /// # Errors
    /// If the scene has not one density, or as [`Shaded::new`].
    pub fn of_scene(scene: &'a Scene, shading: (Shading, f64), step: f64) -> Result<Composited<Self>> {
        match &scene.volumes[..] {
            [Volume::Density(field, medium)] => {
                let medium = Self::new(field, medium.simplified(f32::EPSILON.into()), shading, step)?;
                Ok(Composited { medium, background: scene.environment.radiance })
            }
            _ => Err(Error::unsupported("shading needs one volume with a density and a transfer function")
                .hint("leave out ⟨shade⟩, or give one density and ⟨tf⟩")),
        }
    }

    /// Ends a ray once its transmittance falls below this.
    #[must_use]
    pub fn early_stop(self, transmittance: f64) -> Self {
        Self { dvr: self.dvr.early_stop(transmittance), ..self }
    }

    /// Returns color and extinction at a density.
    #[inline(always)]
    fn at(&self, density: f32) -> ([f32; 3], f32) {
        let piece = self.curve.piece(self.curve.find(density));
        let from = density - piece.base;
        (piece.source.map(|[value, slope]| value + slope * from), piece.extinction[0] + piece.extinction[1] * from)
    }

    /// Returns the radiance of a source at an index position, seen along a world direction.
    #[inline(always)]
    fn shade(&self, source: [f32; 3], index: DVec3, direction: DVec3) -> DVec3 {
        let slope = gradient(self.dvr.field(), index, self.gradient_scale);
        let length = slope.length();
        let cosine = (length > 0.0).then(|| (slope.dot(direction) / length).abs().min(1.0));
        let [factor, highlight] = self.shading.factors(cosine);
        DVec3::from_array(source.map(f64::from)) * factor + highlight
    }
}

impl EmissionAbsorption for Shaded<'_> {
    type Real = f32;
    type Scratch = ();

    fn integrate(&self, ray: &Ray, scratch: &mut ()) -> Radiance {
        self.integrate_part(ray, [0.0, ray.far], scratch)
    }

    fn integrate_part(&self, ray: &Ray, [from, to]: [f64; 2], (): &mut ()) -> Radiance {
        let field = self.dvr.field();
        let whole = Ray::new(ray.origin, ray.direction);
        let Some(whole) = IndexRay::new(&field.domain, &field.transform, &whole) else { return Radiance::default() };
        let length = whole.leave - whole.enter;
        if !(length > 0.0 && length.is_finite()) {
            return Radiance::default();
        }
        // Steps fill the whole way from entry to exit, so that parts make up the whole.
        let step = length / (length / self.step).ceil();
        let mut index = whole;
        if from > whole.enter {
            index.enter = whole.enter + step * ((from - whole.enter) / step).floor();
        }
        if to < whole.leave {
            index.leave = (whole.enter + step * ((to - whole.enter) / step).ceil()).min(whole.leave);
        }
        if index.enter >= index.leave {
            return Radiance::default();
        }
        let limit = -self.dvr.least_transmittance().ln();
        let (mut rgb, mut depth) = (DVec3::ZERO, 0.0_f64);
        spans(
            self.dvr.visible(),
            &index,
            false,
            #[inline(always)]
            |span: Span<f32>| {
                let mut number = ((span.start - whole.enter) / step - 0.5).ceil();
                loop {
                    let t = whole.enter + (number + 0.5) * step;
                    if t >= span.end {
                        return depth < limit;
                    }
                    number += 1.0;
                    let (source, extinction) = self.at(dvr::density(&field.values, &span, (t - span.start) as f32));
                    if extinction > 0.0 {
                        let [begin, end] = [t - 0.5 * step, t + 0.5 * step];
                        let is_cut = begin < from || end > to;
                        let length = if is_cut { (end.min(to) - begin.max(from)).max(0.0) } else { step };
                        let own = f64::from(extinction) * length;
                        let weight = (-depth).exp() * -(-own).exp_m1();
                        rgb += weight * self.shade(source, index.at(t), ray.direction);
                        depth += own;
                    }
                }
            },
        );
        Radiance { rgb: rgb.to_array(), depth }
    }
}

impl Composited<Shaded<'_>> {
    /// Returns a bound of the change that ending rays early makes in any channel of a pixel, alpha included.
    pub fn left_out(&self) -> f64 {
        let medium = self.medium.shading.brightest(self.medium.dvr.brightest());
        self.medium.dvr.least_transmittance() * medium.max(self.brightest_background()).max(1.0)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use crate::math::Affine;
    use crate::render::quadrature::Quadrature;
    use crate::scene::bricks::Topology;
    use crate::scene::table::Table;
    use glam::IVec3;
    use std::sync::Arc;

    /// A density that rises evenly along x, from 0 to 1 over 24 voxels.
    fn ramp() -> Bricks<f32> {
        let all = (0..27).map(|i| IVec3::new(i / 9, i / 3 % 3, i % 3));
        let topology = Arc::new(Topology::new(all).unwrap());
        let mut field = Bricks::<f32>::zeros(topology.clone(), Affine::uniform(0.5, DVec3::ZERO).unwrap());
        let of_brick = |brick: usize| {
            let x = 8 * topology.bricks()[brick].x;
            (0..729).map(move |i| (x + i / 81) as f32 / 24.0)
        };
        field.values = (0..topology.len()).flat_map(of_brick).collect();
        field
    }

    /// All surfaces of a ramp face along x: radiance is that without shading, times the factor of the angle, and the
    /// highlight where the ray is opaque, but for an error that goes away with the step.
    #[test]
    fn shading_of_a_ramp_is_a_factor() {
        let field = ramp();
        let table = Table::new(
            vec![0.0, 0.3, 0.6, 0.9],
            vec![[0.1, 0.2, 0.3, 0.0], [0.9, 0.5, 0.1, 0.4], [0.3, 0.9, 0.2, 1.5], [1.0, 1.0, 1.0, 0.2]],
        )
        .unwrap();
        // So dense that nothing is seen of the end of the bricks, across which differences are others.
        let medium = Medium::new(8.0, Source::Transfer(Arc::new(table)));
        let exact = Dvr::new(&field, medium.clone()).unwrap().quadrature(Quadrature::Exact);
        let shading = Shading { ambient: 0.3, diffuse: 0.6, specular: 0.4, exponent: 8.0 };
        for direction in [DVec3::X, DVec3::new(1.0, 0.5, -0.3).normalize(), DVec3::new(-0.4, 0.2, 0.9).normalize()] {
            // From inside, so that differences to both sides are those of the ramp.
            let ray = Ray::new(DVec3::splat(6.0) - 3.0 * direction, direction);
            let plain = exact.integrate(&ray, &mut Default::default());
            let cosine = direction.x.abs();
            let [factor, highlight] = shading.factors(Some(cosine));
            let opacity = -(-plain.depth).exp_m1();
            let error = |step: f64, scale: f64| {
                let shaded = Shaded::new(&field, medium.clone(), (shading, scale), step).unwrap();
                let found = shaded.integrate(&ray, &mut ());
                let wanted = plain.rgb.map(|v| v * factor + highlight * opacity);
                let transmittance = (found.transmittance() - plain.transmittance()).abs();
                (0..3).map(|c| (found.rgb[c] - wanted[c]).abs()).fold(transmittance, f64::max)
            };
            for scale in [0.0, 1.0] {
                let errors = [0.4, 0.1, 0.025].map(|step| error(step, scale));
                assert!(errors[2] < 1e-3 && errors[2] < 0.2 * errors[0], "{scale}: {errors:?}");
            }
        }
    }

    #[test]
    fn media_without_a_function_are_refused() {
        let field = ramp();
        let refused = Shaded::new(&field, Medium::absorbing(1.0), (Shading::default(), 0.0), 0.5);
        assert!(refused.unwrap_err().to_string().contains("transfer function"));
    }
}
