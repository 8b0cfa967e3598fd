//! Path tracing: bounds between voxels, probabilities of 0 and 1, depths that estimates do not reach, narrow lights.

use super::fixtures::{SLAB, along_x, field, lumps, noise, rays, slab, unit};
use super::{Area, Case, Formula, Naive, off, worse};
use crate::error::Result;
use crate::math::Ray;
use crate::render::dvr::{Dvr, Tape};
use crate::render::integrator::Integrator;
use crate::render::majorant::Majorants;
use crate::render::path::{Limits, PathTracer, Scratch};
use crate::render::sampler::Sampler;
use crate::scene::bricks::Bricks;
use crate::scene::environment::Environment;
use crate::scene::film::Moments;
use crate::scene::light::Light;
use crate::scene::medium::{Medium, Scattering, Source};
use crate::scene::phase::Phase;
use crate::scene::scene::Scene;
use crate::scene::table::Table;
use crate::scene::volume::Volume;
use glam::{DVec3, Vec3};
use std::sync::Arc;

pub(super) const CASES: &[Case] = &[
    Case {
        name: "majorants-between-voxels",
        area: Area::PathTracing,
        hazard: "extinction between voxels above the bound by which collisions are drawn: bias",
        remedy: "bound of the function over the range of all voxels that interpolation uses",
        naive_formula: "largest extinction at the voxels of the brick",
        figure: "largest excess over the bound, relative to the largest extinction",
        bound: 1e-7,
        naive: Naive::Fails(0.1),
        measured: majorants,
    },
    Case {
        name: "certain-collisions",
        area: Area::PathTracing,
        hazard: "a constant medium, in which every tentative collision is real: null collisions of probability 0",
        remedy: "collisions accepted or not, never divided by their probability",
        naive_formula: "both weights over their probabilities, one of them multiplied by 0",
        figure: "share of paths without a finite radiance, or of probability 0",
        bound: 0.0,
        naive: Naive::Fails(0.9),
        measured: certain_collisions,
    },
    Case {
        name: "deep-transmittance",
        area: Area::PathTracing,
        hazard: "transmittance of cameras' rays of optical depth 1 to 20",
        remedy: "exact quadrature of every cell",
        naive_formula: "mean of 4096 ratio-tracking estimates with twice the extinction as the bound",
        figure: "relative error of the transmittance",
        bound: 1.5e-7,
        naive: Naive::Fails(0.1),
        measured: deep_transmittance,
    },
    Case {
        name: "white-furnace",
        area: Area::PathTracing,
        hazard: "light scattered hundreds of times in a volume that absorbs nothing, which must be invisible",
        remedy: "paths without limit, weights that no roulette changes",
        naive_formula: "paths of 16 scatterings at most",
        figure: "relative error of the radiance",
        bound: 4e-6,
        naive: Naive::Fails(1e-2),
        measured: white_furnace,
    },
    Case {
        name: "flat-phase-function",
        area: Area::PathTracing,
        hazard: "angles drawn by Henyey and Greenstein for an anisotropy of 0 to 1e-4",
        remedy: "inverse of the distribution in which g cancels",
        naive_formula: "inverse that divides by 2 g, in single precision",
        figure: "error of the share of angles below the drawn one",
        bound: 2e-15,
        naive: Naive::Fails(1e-3),
        measured: |formula| angles(formula, &[0.0, 1e-9, -1e-9, 1e-6, 1e-4]),
    },
    Case {
        name: "peaked-phase-function",
        area: Area::PathTracing,
        hazard: "angles drawn for an anisotropy of 0.9 to 0.999, and anisotropies of 1, which scatter nothing",
        remedy: "inverse of the distribution in double precision; refusal beyond 0.999",
        naive_formula: "inverse that divides by 2 g, in single precision",
        figure: "error of the share of angles below the drawn one",
        bound: 1e-9,
        naive: Naive::Fails(1e-6),
        measured: peaked_angles,
    },
    Case {
        name: "thin-free-paths",
        area: Area::PathTracing,
        hazard: "place of a collision in a medium of optical depth 1e-12 to 1e-3",
        remedy: "-log1p(u expm1(-x))",
        naive_formula: "-ln(1 - u (1 - exp(-x))) in single precision",
        figure: "relative error of the optical depth before the collision",
        bound: 2e-10,
        naive: Naive::Fails(1e-2),
        measured: thin_free_paths,
    },
    Case {
        name: "narrow-lights",
        area: Area::PathTracing,
        hazard: "irradiance by suns 0.01 to 1e-30 radians wide, and by spheres that look as small",
        remedy: "solid angle by the sine of half the angle; no extent below 1e-12",
        naive_formula: "2π (1 - cos θ) in single precision",
        figure: "relative error of radiance times solid angle",
        bound: 2e-7,
        naive: Naive::Fails(0.1),
        measured: narrow_lights,
    },
    Case {
        name: "variance-of-bright-pixels",
        area: Area::PathTracing,
        hazard: "variance of a pixel whose samples differ by one part in a billion",
        remedy: "running mean and squared differences (Welford 1962)",
        naive_formula: "mean of squares minus square of the mean",
        figure: "relative error of the variance",
        bound: 1e-12,
        naive: Naive::Fails(0.1),
        measured: variance,
    },
];

/// A function of peaks and a step.
fn peaks() -> Result<Table> {
    let value = |s: f64| [0.8 * s, 0.3 + 0.1 * s, 0.2, s];
    Table::new(vec![0.05, 0.2, 0.3, 0.6, 0.6, 0.9], [0.0, 3.0, 0.2, 0.0, 1.0, 0.5].map(value).to_vec())
}

fn majorants(formula: Formula) -> Result<f64> {
    let rough = |p: DVec3| noise((p.x + 100.0 * p.y + 1e4 * p.z) as u64) * noise(7 + (p.x / 8.0) as u64);
    let field: Bricks<f32> = field(24, unit()?, rough)?;
    let table = Arc::new(peaks()?);
    let medium = Medium::new(0.7, Source::Transfer(table.clone()));
    let extinction = |density: f32| 0.7 * table.at(density.into())[3];
    let majorants = Majorants::new(&field, &medium);
    let mut most = 0.0;
    for (number, brick) in field.topology.bricks().iter().enumerate() {
        let corner = (8 * *brick).as_dvec3();
        let bound = match formula {
            Formula::Cumulo => f64::from(majorants.bricks()[number]),
            Formula::Naive => {
                let voxel = |i: i32| corner + DVec3::new((i % 8).into(), (i / 8 % 8).into(), (i / 64).into());
                (0..512).map(|i| extinction(field.sample(voxel(i)))).fold(0.0, f64::max)
            }
        };
        for i in 0..17_i32.pow(3) {
            let at = DVec3::new((i % 17).into(), (i / 17 % 17).into(), (i / 289).into()) * 0.5;
            let found = extinction(field.sample(corner + at.min(DVec3::splat(7.999_999))));
            if found > bound {
                most = worse(most, (found - bound) / extinction(0.2));
            }
        }
    }
    Ok(most)
}

fn scene(field: Bricks<f32>, extinction: f64, albedo: f32, g: f64, sky: f32) -> Scene {
    let scattering = Some(Scattering::new([albedo; 3], Phase::of_anisotropy(g)));
    let medium = Medium { scattering, ..Medium::absorbing(extinction) };
    let lights = vec![Light::Sun { direction: DVec3::Z, irradiance: Vec3::ONE, angle: 0.01 }];
    let volumes = vec![Volume::Density(field, medium)];
    Scene { volumes, environment: Environment::constant([sky; 3]), lights, ..Scene::default() }
}

fn certain_collisions(formula: Formula) -> Result<f64> {
    const PATHS: u32 = 2000;
    let mut bad = 0;
    for extinction in [1e-8, 0.1, 10.0, 1e4] {
        let scene = scene(slab(1.0)?, extinction, 0.9, 0.5, 1.0);
        let (tracer, mut scratch) = (PathTracer::new(&scene)?, Scratch::default());
        let majorant = extinction;
        for path in 0..PATHS {
            let mut sampler = Sampler::new(5, [1, 2], path);
            bad += match formula {
                Formula::Cumulo => {
                    let primary = tracer.primary(&along_x(), &mut scratch);
                    let seen = tracer.li(&along_x(), &primary, &mut sampler, &mut scratch).radiance();
                    u32::from(!(seen.is_finite() && seen.min_element() >= 0.0))
                }
                Formula::Naive => {
                    // Both kinds of collisions have their coefficient over their probability; one is selected.
                    let coefficients = [extinction / majorant, 1.0 - extinction / majorant];
                    let probabilities = coefficients;
                    let real = f64::from(u8::from(sampler.uniform() < probabilities[0]));
                    let [of_real, of_null] = [0, 1].map(|kind| coefficients[kind] / probabilities[kind]);
                    let weight = real * of_real + (1.0 - real) * of_null;
                    u32::from(!weight.is_finite())
                }
            };
        }
        bad += (scratch.counts.violations + scratch.counts.impossible) as u32;
    }
    Ok(f64::from(bad) / f64::from(4 * PATHS))
}

fn deep_transmittance(formula: Formula) -> Result<f64> {
    const ESTIMATES: u32 = 4096;
    let mut most = 0.0;
    for depth in [1.0, 5.0, 10.0, 20.0] {
        let extinction = depth / SLAB;
        let found = match formula {
            Formula::Cumulo => {
                let scene = scene(slab(1.0)?, extinction, 0.9, 0.5, 1.0);
                let (tracer, mut scratch) = (PathTracer::new(&scene)?, Scratch::default());
                let primary = tracer.primary(&along_x(), &mut scratch);
                let mut sampler = Sampler::new(5, [1, 2], 0);
                f64::from(tracer.li(&along_x(), &primary, &mut sampler, &mut scratch).transmittance)
            }
            Formula::Naive => {
                let estimate = |path| {
                    let (mut sampler, mut left, mut weight) = (Sampler::new(5, [1, 2], path), 2.0 * depth, 1.0);
                    loop {
                        left += sampler.uniform().ln();
                        if left < 0.0 {
                            return weight;
                        }
                        weight *= 0.5;
                    }
                };
                (0..ESTIMATES).map(estimate).sum::<f64>() / f64::from(ESTIMATES)
            }
        };
        most = worse(most, off(found, (-depth).exp()));
    }
    Ok(most)
}

fn white_furnace(formula: Formula) -> Result<f64> {
    const PATHS: u32 = 200;
    let volume: Bricks<f32> = field(20, unit()?, lumps(20))?;
    let dvr = Dvr::new(&volume, Medium::absorbing(1.0))?;
    // Rays with some of the volume in front of them.
    let mut thick = rays(volume.world_bounds(), 200, 11);
    thick.retain(|ray| dvr.optical_depth(ray) > 0.1);
    thick.truncate(4);
    let mut most = 0.0;
    for (g, extinction) in [(-0.9, 1.0), (0.0, 10.0), (0.9, 10.0)] {
        let mut scene = scene(volume.clone(), extinction, 1.0, g, 1.0);
        scene.lights.clear();
        let tracer = PathTracer::new(&scene)?;
        let tracer = match formula {
            Formula::Cumulo => tracer,
            Formula::Naive => tracer.limits(Limits { max_bounces: 16 }),
        };
        let mut scratch = Scratch::default();
        for (k, ray) in thick.iter().enumerate() {
            let mut sum = Vec3::ZERO;
            for path in 0..PATHS {
                let mut sampler = Sampler::new(1, [k, 0], path);
                let primary = tracer.primary(ray, &mut scratch);
                sum += tracer.li(ray, &primary, &mut sampler, &mut scratch).radiance() / PATHS as f32;
            }
            most = sum.to_array().into_iter().map(|found| off(found.into(), 1.0)).fold(most, worse);
        }
        if scratch.counts.violations + scratch.counts.impossible > 0 {
            return Ok(f64::INFINITY);
        }
    }
    Ok(most)
}

/// The error of the share of angles that are drawn below one, which is the number that it was drawn by.
fn angles(formula: Formula, anisotropies: &[f64]) -> Result<f64> {
    let mut most = 0.0;
    for g in anisotropies.iter().copied() {
        let phase = Phase::HenyeyGreenstein(g);
        phase.check()?;
        // ∫ from -1 to c of the phase function, in closed form.
        let below = |c: f64| {
            let root = |c: f64| (1.0 + g * g - 2.0 * g * c).sqrt();
            // The difference of reciprocals, multiplied out: g cancels.
            (1.0 - g * g) * (c + 1.0) / (root(c) * (1.0 + g) * (root(c) + 1.0 + g))
        };
        for u in (0..=100).map(|i| f64::from(i) / 100.0) {
            let cosine = match formula {
                Formula::Cumulo => phase.sample(u),
                Formula::Naive => {
                    let (g, u) = (g as f32, u as f32);
                    let inner = (1.0 - g * g) / (1.0 - g + 2.0 * g * u);
                    f64::from((1.0 + g * g - inner * inner) / (2.0 * g))
                }
            };
            most = worse(most, (below(cosine) - u).abs());
        }
    }
    Ok(most)
}

fn peaked_angles(formula: Formula) -> Result<f64> {
    let refused = [1.0, -1.0, f64::NAN, f64::INFINITY].map(|g| Phase::HenyeyGreenstein(g).check().is_err());
    let error = angles(formula, &[0.9, -0.9, 0.99, 0.999, -0.999])?;
    Ok(if formula == Formula::Naive || refused == [true; 4] { error } else { f64::INFINITY })
}

fn thin_free_paths(formula: Formula) -> Result<f64> {
    let field: Bricks<f32> = slab(1.0)?;
    let mut most = 0.0;
    for depth in [1e-12, 1e-8, 1e-5, 1e-3] {
        let dvr = Dvr::new(&field, Medium::absorbing(depth / SLAB))?;
        let mut tape = Tape::default();
        let walked = dvr.walk(&along_x(), &mut tape);
        for u in [0.01, 0.3, 0.5, 0.99] {
            let found = match formula {
                Formula::Cumulo => walked.collision(u).unwrap_or(f64::NAN),
                Formula::Naive => {
                    let (u, depth) = (u as f32, depth as f32);
                    f64::from(-(1.0 - u * (1.0 - (-depth).exp())).ln())
                }
            };
            // -ln(1 - u (1 - e^{-x})) by its series, to the third order.
            let x = depth;
            let expected = u * x * (1.0 - 0.5 * x * (1.0 - u) + x * x * (1.0 - u) * (1.0 - 2.0 * u) / 6.0);
            most = worse(most, off(found, expected));
            if formula == Formula::Cumulo {
                // Where it lies: the share of the slab.
                let at = dvr.locate(&walked, found, &mut tape).map_or(f64::NAN, |(distance, _)| distance);
                most = worse(most, off(at - 6.0, SLAB * expected / depth));
            }
        }
    }
    Ok(most)
}

fn narrow_lights(formula: Formula) -> Result<f64> {
    let mut most = 0.0;
    for angle in [1e-2, 1e-4, 1e-6, 1e-9, 1e-20, 1e-30] {
        // A sphere at the distance from which it has the sun's width, whose radiance it has: that of irradiance 1.
        let (distance, radiance) = (2.0 / angle, std::f64::consts::PI * (0.5 * angle) * (0.5 * angle));
        let sun = Light::Sun { direction: DVec3::Z, irradiance: Vec3::ONE, angle };
        let sphere = Light::Sphere { centre: distance * DVec3::Z, radius: 1.0, radiance: Vec3::ONE };
        // Directions in double precision do not resolve spheres that look smaller.
        let lights = [(sun, 1.0), (sphere, radiance)];
        for (light, expected) in &lights[..if angle < 1e-12 { 1 } else { 2 }] {
            let light = light.checked()?;
            let Some(arrival) = light.sample(DVec3::ZERO, [0.3, 0.6]) else { return Ok(f64::INFINITY) };
            let met = light.hit(&Ray::new(DVec3::ZERO, arrival.direction));
            let found = match formula {
                Formula::Cumulo if arrival.density.is_infinite() && met.is_none() => arrival.radiance.x.into(),
                // What is drawn is met.
                Formula::Cumulo if met.is_some_and(|met| met.density == arrival.density) => {
                    f64::from(arrival.radiance.x) / arrival.density
                }
                Formula::Cumulo => f64::NAN,
                Formula::Naive => {
                    let solid_angle = std::f32::consts::TAU * (1.0 - (0.5 * angle as f32).cos());
                    f64::from(arrival.radiance.x) * f64::from(solid_angle)
                }
            };
            // The cosine over the light's disc is less than 1 by an eighth of the squared angle at most.
            most = worse(most, off(found, *expected) - 0.125 * angle * angle);
        }
    }
    Ok(most)
}

fn variance(formula: Formula) -> Result<f64> {
    let samples = [4.0, 7.0, 13.0, 16.0].map(|v| 1e9 + v);
    let found = match formula {
        Formula::Cumulo => {
            let mut moments = Moments::default();
            samples.iter().for_each(|v| moments.add(*v));
            moments.variance_of_mean()
        }
        Formula::Naive => {
            let mean = |of: fn(f64) -> f64| samples.iter().map(|v| of(*v)).sum::<f64>() / 4.0;
            (mean(|v| v * v) - mean(|v| v).powi(2)) / 3.0
        }
    };
    // Σ (x - x̄)² = 90.
    Ok(off(found, 90.0 / 12.0))
}
