//! Surfaces that reflect: energy, a closed form, and the agreement of kernels.

use crate::common::fields::{field, unit};
use crate::path_tracing::{assert_agree, estimate, exact, lumpy, scene, through};
use cumulo::math::Ray;
use cumulo::render::path::{Limits, PathTracer};
use cumulo::scene::albedo::AlbedoFunction;
use cumulo::scene::environment::Environment;
use cumulo::scene::light::Light;
use cumulo::scene::medium::{Medium, Scattering, Source, Specular};
use cumulo::scene::phase::Phase;
use cumulo::scene::scene::Scene;
use cumulo::scene::volume::Volume;
use glam::{DVec3, Vec3};
use std::f64::consts::PI;
use std::sync::Arc;

fn shiny(extinction: f64, albedo: [f32; 3], half: f64, specular: Specular) -> Medium {
    let scattering = Scattering {
        gradient_shading: Some(half),
        specular: Some(specular),
        ..Scattering::new(albedo, Phase::HenyeyGreenstein(0.3))
    };
    Medium { scattering: Some(scattering), ..Medium::absorbing(extinction) }
}

/// With albedo 1 all light is scattered, whatever surfaces reflect: in a sky that is the same from all around nothing
/// is seen, alone, beside another volume and with extinctions of several colors.
#[test]
fn white_surfaces_vanish_in_a_white_sky() {
    let (field, sky) = (lumpy(unit()), [0.7, 1.0, 2.0]);
    for (reflectance, roughness) in [(0.04, 0.2), (0.5, 0.1), (1.0, 0.5)] {
        let medium = shiny(0.2, [1.0; 3], 0.05, Specular { reflectance, roughness });
        let one = scene(&field, medium.clone(), vec![], sky);
        let chromatic = scene(&field, Medium { color: [1.0, 0.5, 0.25], ..medium.clone() }, vec![], sky);
        let mut two = one.clone();
        two.volumes.push(Volume::Density(field.clone(), medium));
        for scene in [one, chromatic, two] {
            let tracer = PathTracer::new(&scene).unwrap();
            let found: Vec<_> = through(&field, 3).iter().map(|ray| estimate(&tracer, ray, 48)).collect();
            assert_agree(&format!("{reflectance} {roughness}"), &found, &exact(vec![[0.7, 1.0, 2.0]; found.len()]));
        }
    }
}

/// What a medium of surfaces emits and scatters is no more than its source's radiance, in light of that radiance.
#[test]
fn surfaces_in_equilibrium_are_as_bright_as_their_source() {
    let (field, radiance) = (lumpy(unit()), [0.7, 1.0, 2.0]);
    let specular = Specular { reflectance: 0.3, roughness: 0.3 };
    let medium = Medium { source: Source::Grey(radiance), ..shiny(0.2, [0.8, 0.4, 0.0], 0.05, specular) };
    let scene = scene(&field, medium, vec![], radiance);
    let tracer = PathTracer::new(&scene).unwrap();
    let found: Vec<_> = through(&field, 4).iter().map(|ray| estimate(&tracer, ray, 48)).collect();
    assert_agree("equilibrium", &found, &exact(vec![[0.7, 1.0, 2.0]; found.len()]));
}

/// A half space of surfaces, seen along its normal and lit from there: light of irradiance E is scattered once as the
/// radiance `f E / 2` (the light passes the densities twice), where f at normal incidence is `R / (4 π α²)` of the
/// specular lobe alone.
#[test]
fn a_black_wall_has_the_closed_form_of_its_reflection() {
    let field = field::<f32>(33, unit(), |p| p.z);
    let ray = Ray::new(DVec3::new(16.2, 15.7, -5.0), DVec3::Z);
    let sun = Light::Sun { direction: -DVec3::Z, irradiance: Vec3::ONE, angle: 0.0 };
    for (reflectance, roughness) in [(0.04, 0.2), (0.5, 0.4)] {
        let medium = shiny(0.2, [0.0; 3], 1e-4, Specular { reflectance, roughness });
        let lit = scene(&field, medium, vec![sun], [0.0; 3]);
        let tracer = PathTracer::new(&lit).unwrap().limits(Limits { max_bounces: 1 });
        let expected = reflectance / (4.0 * PI * roughness * roughness) / 2.0;
        assert_agree("wall", &[estimate(&tracer, &ray, 32)], &exact([[expected; 3]]));
    }
}

/// Lights inside the media and beside them, of which points are drawn by angle, are what collisions alone find, and the
/// kernels of one and of several volumes find the same; with an albedo by density, too.
#[test]
fn estimators_agree() {
    let field = lumpy(unit());
    let centre = DVec3::new(9.0, 9.0, 11.0);
    let lights = vec![
        Light::Sphere { centre, radius: 0.5, radiance: Vec3::new(3.0, 2.0, 1.0) },
        Light::Sun { direction: DVec3::new(0.2, 0.4, 1.0), irradiance: Vec3::ONE, angle: 0.3 },
    ];
    let points = [[0.2, 0.9, 0.1, 0.0], [0.8, 0.1, 0.2, 0.9]];
    let medium = Medium {
        albedo_function: Some(Arc::new(AlbedoFunction::new(&points).unwrap())),
        ..shiny(0.06, [1.0; 3], 0.05, Specular { reflectance: 0.2, roughness: 0.4 })
    };
    let lit = Scene { environment: Environment::constant([0.1; 3]), ..scene(&field, medium, lights, [0.1; 3]) };
    let rays = through(&field, 3);
    let of = |tracer: PathTracer<'_>| -> Vec<_> { rays.iter().map(|ray| estimate(&tracer, ray, 128)).collect() };
    let expected = of(PathTracer::new(&lit).unwrap());
    assert_agree("collisions", &of(PathTracer::new(&lit).unwrap().at_collisions()), &expected);
    assert_agree("generic", &of(PathTracer::generic(&lit).unwrap()), &expected);
}
