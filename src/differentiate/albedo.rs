//! Derivatives of path-traced pictures by the albedo: that of the medium, and its color by density.
//!
//! Radiance is a mean over paths, and what a path brings along is a product over its collisions, of the albedo
//! `ϖ(d) = A c(d)` at each of their densities: transmittances, phase functions and lights do not depend on it. The
//! derivative of the product is a sum over collisions of products of all others, which is estimated along the same
//! paths without bias. (Khungurn et al. 2015 differentiate fibers so, Zhang et al. 2019 all of a volume.)
//!
//! Paths end where the albedo is 0, and a color of 0 in the true medium would have no derivative. So paths are traced
//! in a medium whose albedo is at least [`LEAST`] everywhere, and each collision is weighted by the ratio of the two.

use crate::cancel::Cancel;
use crate::error::{Error, Result};
use crate::render::integrator::Integrator;
use crate::render::path::{Limits, PathEvent, PathTracer, Scratch};
use crate::render::sampler::Sampler;
use crate::render::tiles;
use crate::scene::albedo::AlbedoFunction;
use crate::scene::medium::{Medium, Scattering};
use crate::scene::scene::Scene;
use crate::scene::volume::Volume;
use glam::DVec3;
use std::sync::Arc;

/// Least albedo, and least color by density, of the medium that paths are traced in.
const LEAST: f64 = 0.1;
/// Independent estimates of which the mean and its standard error are stated.
pub const REPLICATES: usize = 8;

/// Estimate of a derivative.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Estimate {
    /// Derivative.
    pub value: f64,
    /// Standard error of the estimate.
    pub error: f64,
}

/// Derivatives of a loss in red, green and blue.
#[derive(Debug, Clone, PartialEq)]
pub struct AlbedoGradient {
    /// Derivatives by the albedo of the medium.
    pub medium: [Estimate; 3],
    /// Derivatives by the color of each point of its albedo by density; empty if there is none.
    pub points: Vec<[Estimate; 3]>,
}

/// Paths by which derivatives are estimated.
#[derive(Debug, Clone, Copy)]
pub struct Paths {
    /// Paths of a pixel in all, at least one for each of eight replicates.
    pub samples: u32,
    /// Seed of the random numbers.
    pub seed: u64,
    /// How far paths go.
    pub limits: Limits,
}

/// Returns the derivatives by the albedo of a loss on the pictures of the scene's cameras. Its derivatives by the
/// colors of each camera's pixels, row by row from the top, are given for each of [`REPLICATES`] estimates: where they
/// are estimates themselves, those of one replicate must be independent of those of the others, and of the random
/// numbers of these paths.
///
/// # Errors
/// If the scene is not one volume that scatters light without specular reflection, or the work is cancelled.
pub fn by_albedo(
    mut scene: Scene,
    by_pixel: &[Vec<Vec<[f64; 3]>>; REPLICATES],
    paths: Paths,
    cancel: &Cancel,
) -> Result<AlbedoGradient> {
    let cameras = std::mem::take(&mut scene.cameras);
    let ([Volume::Density(field, medium)], None) = (&mut scene.volumes[..], &scene.meshes) else {
        return Err(Error::unsupported("derivatives by the albedo are those of one volume, without meshes and fire")
            .hint("leave the others out"));
    };
    let Some(scattering) = medium.scattering.filter(|scattering| scattering.specular.is_none()) else {
        return Err(Error::unsupported("derivatives by the albedo are those of a medium without specular reflection")
            .hint("leave ⟨specular⟩ out"));
    };
    let albedos = raise(medium, scattering, field.reference)?;
    let tracer = PathTracer::new(&scene)?.limits(paths.limits).at_collisions();
    let rows: Vec<(usize, usize)> =
        (0..cameras.len()).flat_map(|view| (0..cameras[view].height as usize).map(move |row| (view, row))).collect();
    let count = paths.samples.div_ceil(REPLICATES as u32);
    let mut sums = vec![[DVec3::ZERO; 2]; albedos.parameters()];
    for (replicate, by_pixel) in (1_u64..).zip(by_pixel) {
        let of_row = |scratch: &mut Scratch, (view, row): &(usize, usize)| {
            let camera = &cameras[*view];
            let seed = paths.seed ^ (*view as u64) << 32 ^ replicate.wrapping_mul(0x9E37_79B9_7F4A_7C15);
            let mut replay = Replay::new(&albedos);
            for x in 0..camera.width as usize {
                let share = DVec3::from_array(by_pixel[*view][row * camera.width as usize + x]) / f64::from(count);
                for number in 0..count {
                    let mut sampler = Sampler::new(seed, [x, *row], number);
                    let [u, v, ..] = sampler.stratified();
                    let ray = camera.ray(x as f64 + u, *row as f64 + v);
                    let primary = tracer.primary(&ray, scratch);
                    tracer.li(&ray, &primary, &mut sampler, scratch);
                    replay.path(scratch.events(), share);
                }
            }
            replay.gradient
        };
        let rows = tiles::map(&rows, cancel, Scratch::recording, of_row).ok_or_else(Error::cancelled)?;
        for (parameter, [sum, squares]) in sums.iter_mut().enumerate() {
            let value: DVec3 = rows.iter().map(|gradient| gradient[parameter]).sum();
            *sum += value;
            *squares += value * value;
        }
    }
    let n = REPLICATES as f64;
    let estimates = sums.into_iter().map(|[sum, squares]| {
        let mean = sum / n;
        let variance = (squares / n - mean * mean).max(DVec3::ZERO) / (n - 1.0);
        std::array::from_fn(|c| Estimate { value: mean[c], error: variance[c].sqrt() })
    });
    let mut estimates = estimates.collect::<Vec<[Estimate; 3]>>().into_iter();
    Ok(AlbedoGradient { medium: estimates.next().unwrap_or_default(), points: estimates.collect() })
}

/// Raises the albedo of a medium to [`LEAST`] at least, and returns both albedos, of densities that are stored as
/// differences to a reference.
fn raise(medium: &mut Medium, scattering: Scattering, reference: f64) -> Result<Albedos> {
    let least = |v: f64| v.max(LEAST);
    let raised = scattering.albedo.map(|v| least(v.into()) as f32);
    let mut points = medium.albedo_function.as_ref().map(|function| function.points()).unwrap_or_default();
    if !points.is_empty() {
        let raised: Vec<_> = points.iter().map(|[d, r, g, b]| [*d, least(*r), least(*g), least(*b)]).collect();
        medium.albedo_function = Some(Arc::new(AlbedoFunction::new(&raised)?));
    }
    medium.scattering = Some(Scattering { albedo: raised, ..scattering });
    points.iter_mut().for_each(|point| point[0] -= reference);
    let [volume, raised] = [scattering.albedo, raised].map(|albedo| DVec3::from_array(albedo.map(f64::from)));
    Ok(Albedos { volume, raised, points })
}

/// Albedo of a medium, and that of the one that paths are traced in.
struct Albedos {
    volume: DVec3,
    raised: DVec3,
    /// Density, then red, green and blue; none for 1 at every density.
    points: Vec<[f64; 4]>,
}

/// Albedo at a density.
struct At {
    /// Color, the factor of the medium's albedo.
    color: DVec3,
    /// Albedo of the medium that paths are traced in.
    raised: DVec3,
    /// Points of the color, and their weights.
    weights: [(usize, f64); 2],
}

impl Albedos {
    /// Number of the parameters: the albedo of the medium, and the color of each point.
    fn parameters(&self) -> usize {
        1 + self.points.len()
    }

    /// Returns the albedo at a density, linear between the points around it.
    fn at(&self, density: f64) -> At {
        let Some(last) = self.points.len().checked_sub(1) else {
            return At { color: DVec3::ONE, raised: self.raised, weights: [(0, 0.0); 2] };
        };
        let above = self.points.partition_point(|point| point[0] <= density);
        let ends = [above.saturating_sub(1), above.min(last)];
        let [low, high] = ends.map(|point| self.points[point][0]);
        let share = if high > low { ((density - low) / (high - low)).clamp(0.0, 1.0) } else { 0.0 };
        let [a, b] = ends.map(|point| DVec3::from_slice(&self.points[point][1..]));
        let least = DVec3::splat(LEAST);
        let raised = self.raised * a.max(least).lerp(b.max(least), share);
        At { color: a.lerp(b, share), raised, weights: [(ends[0], 1.0 - share), (ends[1], share)] }
    }
}

/// Derivatives along paths.
struct Replay<'a> {
    albedos: &'a Albedos,
    /// Product over the collisions so far of the true albedo over that of the paths' medium.
    product: DVec3,
    /// Derivatives of the product by the parameters.
    by: Vec<DVec3>,
    /// Derivatives of the loss so far.
    gradient: Vec<DVec3>,
}

impl<'a> Replay<'a> {
    fn new(albedos: &'a Albedos) -> Self {
        let zeros = vec![DVec3::ZERO; albedos.parameters()];
        Self { albedos, product: DVec3::ONE, by: zeros.clone(), gradient: zeros }
    }

    /// Adds the derivatives of a path, of whose light the loss has this derivative.
    fn path(&mut self, events: impl Iterator<Item = PathEvent>, loss: DVec3) {
        self.product = DVec3::ONE;
        self.by.fill(DVec3::ZERO);
        for event in events {
            match event {
                PathEvent::Scattered { density } => self.scattered(density.into()),
                PathEvent::Arrived(light) => {
                    let by_product = loss * light.as_dvec3();
                    self.gradient.iter_mut().zip(&self.by).for_each(|(sum, by)| *sum += by_product * *by);
                }
                PathEvent::Emitted { density, light } => self.emitted(density.into(), loss * light.as_dvec3()),
            }
        }
    }

    fn scattered(&mut self, density: f64) {
        let At { color, raised, weights } = self.albedos.at(density);
        let volume = self.albedos.volume;
        let ratio = volume * color / raised;
        self.by.iter_mut().for_each(|by| *by *= ratio);
        let before = self.product / raised;
        self.by[0] += before * color;
        for (point, weight) in weights {
            if weight > 0.0 {
                self.by[1 + point] += before * volume * weight;
            }
        }
        self.product *= ratio;
    }

    /// Adds what a collision emits: the share that is not scattered.
    fn emitted(&mut self, density: f64, loss: DVec3) {
        let At { color, weights, .. } = self.albedos.at(density);
        let volume = self.albedos.volume;
        let left = DVec3::ONE - volume * color;
        self.gradient.iter_mut().zip(&self.by).for_each(|(sum, by)| *sum += loss * left * *by);
        let by_albedo = loss * self.product;
        self.gradient[0] -= by_albedo * color;
        for (point, weight) in weights {
            if weight > 0.0 {
                self.gradient[1 + point] -= by_albedo * volume * weight;
            }
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use crate::math::Affine;
    use crate::render::film::{self, Sampling};
    use crate::scene::bricks::{Bricks, Topology};
    use crate::scene::camera::Camera;
    use crate::scene::environment::Environment;
    use crate::scene::light::Light;
    use crate::scene::medium::Source;
    use crate::scene::orbit::{self, Layout};
    use crate::scene::phase::Phase;
    use crate::scene::table::Table;
    use crate::scene::up::Up;
    use glam::{IVec3, Vec3};

    /// A ball whose density falls from 1 at its middle to 0.
    fn ball() -> Bricks<f32> {
        let topology = Arc::new(Topology::new((0..8).map(|i| IVec3::new(i / 4, i / 2 % 2, i % 2))).unwrap());
        let at = |brick: IVec3, i: i32| (8 * brick + IVec3::new(i >> 6, (i >> 3) & 7, i & 7)).as_dvec3();
        let value = |p: DVec3| (1.0 - p.distance(DVec3::splat(7.5)) / 7.0).max(0.0) as f32;
        let owned: Vec<f32> =
            topology.bricks().iter().flat_map(|brick| (0..512).map(move |i| value(at(*brick, i)))).collect();
        let mut field = Bricks::zeros(topology.clone(), Affine::uniform(0.2, DVec3::ZERO).unwrap());
        topology.fill_apron(&owned, &mut field.values);
        field
    }

    /// A scene with an albedo of two or no points, some of which are 0, with emission or without.
    fn scene(volume: [f32; 3], points: Option<[[f64; 4]; 3]>, emission: f64) -> Scene {
        let table = Table::new(
            vec![0.0, 0.5, 1.0],
            vec![[emission, 0.5 * emission, 0.0, 0.0], [0.2 * emission, emission, 0.1, 2.0], [0.1, 0.0, emission, 4.0]],
        );
        let source = Source::Transfer(Arc::new(table.unwrap()));
        let scattering = Scattering::new(volume, Phase::HenyeyGreenstein(0.3));
        let albedo_function = points.map(|points| Arc::new(AlbedoFunction::new(&points).unwrap()));
        let medium = Medium { scattering: Some(scattering), albedo_function, ..Medium::new(1.0, source) };
        Scene {
            volumes: vec![Volume::Density(ball(), medium)],
            environment: Environment::constant([0.2, 0.3, 0.4]),
            lights: vec![Light::Sun { direction: DVec3::new(1.0, 0.5, 0.3), irradiance: Vec3::splat(3.0), angle: 0.1 }],
            ..Scene::default()
        }
    }

    const SIZE: usize = 6;

    /// The radiance, weighted by pixel and channel, of pictures of several seeds.
    fn losses(scene: &Scene, cameras: &[Camera], weights: &[f64]) -> Vec<f64> {
        let tracer = PathTracer::new(scene).unwrap();
        let of = |seed: u64| {
            let sampling = Sampling::random(1024, seed);
            let film = film::render(&tracer, &cameras[0], sampling, &[], &Cancel::NEVER).unwrap().film;
            let pixels = film.rgba.iter().flat_map(|p| [p[0], p[1], p[2]]);
            pixels.zip(weights).map(|(v, w)| f64::from(v) * w).sum::<f64>()
        };
        (0..6).map(of).collect()
    }

    /// Derivatives are the difference quotients of pictures, by the albedo of the medium and by the color of each
    /// point, at colors of 0 and 1 too, with what the medium emits and without.
    #[test]
    fn derivatives_are_difference_quotients_of_pictures() {
        let points = [[0.1, 0.9, 0.0, 0.4], [0.5, 0.2, 0.7, 0.0], [0.9, 0.5, 0.5, 1.0]];
        let cases = [([0.9, 0.5, 0.0], None, 0.0), ([0.9, 0.8, 1.0], Some(points), 0.0), ([0.8; 3], Some(points), 2.0)];
        for (volume, points, emission) in cases {
            let corners = ball().world_bounds().corners();
            let cameras = orbit::cameras(&corners, 1, Layout::Ring, SIZE as u32, SIZE as u32, 30.0, Up::Z);
            let weights: Vec<f64> = (0..3 * SIZE * SIZE).map(|i| (0.7 * i as f64).sin() + 0.5).collect();
            let by_pixel = vec![weights.chunks(3).map(|w| [w[0], w[1], w[2]]).collect::<Vec<_>>()];
            let paths = Paths { samples: 4096, seed: 99, limits: Limits::default() };
            let at = Scene { cameras: cameras.clone(), ..scene(volume, points, emission) };
            let found = by_albedo(at, &std::array::from_fn(|_| by_pixel.clone()), paths, &Cancel::NEVER).unwrap();
            assert_eq!(found.points.len(), points.map_or(0, |points| points.len()));
            for (parameter, channel) in (0..=found.points.len()).flat_map(|p| (0..3).map(move |c| (p, c))) {
                let value = match (parameter, points) {
                    (point @ 1.., Some(points)) => points[point - 1][1 + channel],
                    _ => f64::from(volume[channel]),
                };
                let changed = |to: f64| {
                    let (mut volume, mut points) = (volume, points);
                    match (parameter, &mut points) {
                        (point @ 1.., Some(points)) => points[point - 1][1 + channel] = to,
                        _ => volume[channel] = to as f32,
                    }
                    losses(&scene(volume, points, emission), &cameras, &weights)
                };
                let ends = [value - 0.03, value + 0.03].map(|v| v.clamp(0.0, 1.0));
                let [low, high] = ends.map(changed);
                // Of the same random numbers.
                let quotients: Vec<f64> = low.iter().zip(high).map(|(a, b)| (b - a) / (ends[1] - ends[0])).collect();
                let quotient = quotients.iter().sum::<f64>() / 6.0;
                let chance = (quotients.iter().map(|v| (v - quotient).powi(2)).sum::<f64>() / 30.0).sqrt();
                let Estimate { value, error } = match parameter {
                    0 => found.medium[channel],
                    point => found.points[point - 1][channel],
                };
                let allowed = 5.0 * error.hypot(chance) + 0.03 * quotient.abs() + 5e-4;
                println!("{emission} {parameter} {channel}: {value:.4} ± {error:.4}, {quotient:.4} ± {chance:.4}");
                assert!((value - quotient).abs() < allowed, "{parameter} {channel}: {value} {quotient} {allowed}");
                assert!(error < 0.05 * value.abs() + 0.02, "{parameter} {channel}");
            }
        }
    }

    /// Densities that are stored as differences to a reference have the same derivatives.
    #[test]
    fn stored_differences_change_nothing() {
        let points = [[0.1, 0.9, 0.0, 0.4], [0.5, 0.2, 0.7, 0.0], [0.9, 0.5, 0.5, 1.0]];
        let of = |reference: f64| {
            let moved = points.map(|[d, r, g, b]| [d + reference, r, g, b]);
            let mut at = scene([0.9, 0.8, 0.7], Some(moved), 0.0);
            if let [Volume::Density(field, Medium { source: Source::Transfer(table), .. })] = &mut at.volumes[..] {
                *table = Arc::new(table.relative_to(-reference));
                field.reference = reference;
            }
            at.cameras = orbit::cameras(&ball().world_bounds().corners(), 1, Layout::Ring, 4, 4, 30.0, Up::Z);
            let paths = Paths { samples: 64, seed: 3, limits: Limits::default() };
            by_albedo(at, &std::array::from_fn(|_| vec![vec![[1.0; 3]; 16]]), paths, &Cancel::NEVER).unwrap()
        };
        // A power of two, which moves points exactly.
        let [a, b] = [0.0, 1024.0].map(of);
        for (a, b) in a.points.iter().chain([&a.medium]).flatten().zip(b.points.iter().chain([&b.medium]).flatten()) {
            assert!((a.value - b.value).abs() < 1e-6 * (1.0 + a.value.abs()), "{a:?} {b:?}");
        }
        assert!(a.points[1][0].value > 0.0);
    }

    #[test]
    fn what_has_no_derivative_is_refused() {
        let paths = Paths { samples: 8, seed: 0, limits: Limits::default() };
        let refused = |scene| by_albedo(scene, &Default::default(), paths, &Cancel::NEVER).is_err();
        assert!(!refused(scene([0.5; 3], None, 0.0)) && refused(Scene::default()));
        let cancel = Cancel::new();
        cancel.request();
        let cameras = orbit::cameras(&ball().world_bounds().corners(), 1, Layout::Ring, 2, 2, 30.0, Up::Z);
        let at = Scene { cameras, ..scene([0.5; 3], None, 0.0) };
        assert!(by_albedo(at, &std::array::from_fn(|_| vec![vec![[1.0; 3]; 4]]), paths, &cancel).is_err());
    }
}
