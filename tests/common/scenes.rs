//! Random scenes.

use super::fields::{field, lumps, noise, odd, unit};
use cumulo::math::Affine;
use cumulo::scene::blur::Blur;
use cumulo::scene::camera::{Camera, Projection};
use cumulo::scene::emission::{self, Emission, Emitted};
use cumulo::scene::environment::{Environment, EnvironmentMap};
use cumulo::scene::film::Film;
use cumulo::scene::light::Light;
use cumulo::scene::medium::{Medium, Scattering, Source};
use cumulo::scene::phase::Phase;
use cumulo::scene::scene::Scene;
use cumulo::scene::table::Table;
use cumulo::scene::volume::Volume;
use glam::{DMat4, DQuat, DVec2, DVec3, Vec3};
use std::sync::Arc;

/// Pixels along the edges of pictures.
pub const EDGE: u32 = 6;

/// Numbers of one scene.
#[derive(Debug)]
pub struct Draw(pub u64);

impl Draw {
    /// Returns the next number in 0..1.
    pub fn number(&mut self) -> f64 {
        self.0 += 1;
        noise(self.0.wrapping_mul(7919))
    }

    /// True in one of `n` draws.
    pub fn once_in(&mut self, n: u32) -> bool {
        self.number() * f64::from(n) < 1.0
    }

    /// Returns a number between two, evenly in its logarithm.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low * (high / low).powf(self.number())
    }

    /// Returns a color, grey in half of the draws.
    pub fn color(&mut self, bright: f64) -> Vec3 {
        let tint = if self.once_in(2) { DVec3::ONE } else { DVec3::new(self.number(), self.number(), self.number()) };
        (bright * tint).as_vec3()
    }

    /// Returns a unit vector.
    pub fn direction(&mut self) -> DVec3 {
        (DVec3::new(self.number(), self.number(), self.number()) - 0.4999).normalize()
    }

    /// Returns a medium of moderate depth.
    pub fn medium(&mut self) -> Medium {
        let source = if self.once_in(3) {
            let bright = self.number();
            let color = |share: f64| [bright, 0.5 * bright, 0.2 * bright, share];
            let knots = vec![0.0, 0.2, 0.5, 1.0];
            Source::Transfer(Arc::new(Table::new(knots, [0.0, 0.5, 0.1, 1.0].map(color).to_vec()).unwrap()))
        } else if self.once_in(2) {
            let bright = self.between(1e-3, 1.0);
            Source::Grey(self.color(bright).to_array())
        } else {
            Source::Grey([0.0; 3])
        };
        let albedo = if self.once_in(6) { [0.0; 3] } else { self.color(0.95).to_array() };
        let phase = if self.once_in(2) { Phase::Isotropic } else { Phase::HenyeyGreenstein(1.6 * self.number() - 0.8) };
        let color = if self.once_in(5) { [1.0, self.number() as f32, self.number() as f32] } else { [1.0; 3] };
        let gradient_shading = self.once_in(4).then(|| self.between(0.01, 1.0));
        let scattering = Some(Scattering { gradient_shading, ..Scattering::new(albedo, phase) });
        Medium { scattering, color, ..Medium::new(self.between(0.005, 0.4), source) }
    }

    /// Returns a light outside of a box of that centre and diagonal.
    pub fn light(&mut self, centre: DVec3, size: f64) -> Light {
        let bright = self.between(1e-3, 3.0);
        let (radiance, away) = (self.color(bright), centre + self.between(0.8, 3.0) * size * self.direction());
        match (4.0 * self.number()) as u32 {
            0 => Light::Sun { direction: self.direction(), irradiance: radiance, angle: 0.3 * self.number() },
            1 => Light::Point { position: away, intensity: radiance * (size * size) as f32 },
            2 => Light::Sphere { centre: away, radius: 0.2 * size, radiance },
            _ => Light::Rectangle { corner: away, edges: [self.direction() * size, self.direction() * size], radiance },
        }
    }

    /// Returns a scene that takes little time.
    pub fn scene(&mut self) -> Scene {
        let transform = if self.once_in(2) { unit() } else { odd() };
        let count = if self.once_in(4) { 2 } else { 1 };
        let volume = |draw: &mut Self| Volume::Density(field(20, transform, lumps(20)), draw.medium());
        let volumes: Vec<Volume> = (0..count).map(|_| volume(self)).collect();
        let bounds = volumes[0].density().unwrap().0.world_bounds();
        let (centre, size) = (bounds.centre(), bounds.size().length());
        let lights = (0..(4.0 * self.number()) as usize).map(|_| self.light(centre, size)).collect();
        let map = self.once_in(4).then(|| {
            let pixels = (0..32).map(|i| if i == 9 { [3.0, 2.0, 1.0, 1.0] } else { [0.1, 0.1, 0.2, 1.0] }).collect();
            Arc::new(EnvironmentMap::new(&Film::of(8, 4, pixels), [0.3; 3]).unwrap())
        });
        let radiance = if self.once_in(2) { [0.0; 3] } else { [0.1, 0.2, self.number() as f32] };
        let camera = camera(centre + 1.2 * size * self.direction(), centre);
        Scene { volumes, lights, environment: Environment { radiance, map }, cameras: vec![camera], ..Scene::default() }
    }
}

/// Returns a camera that looks from a point to another.
pub fn camera(eye: DVec3, centre: DVec3) -> Camera {
    Camera {
        camera_to_world: Camera::look_at(eye, centre, DVec3::new(0.1, 0.2, 0.97)),
        focal: DVec2::splat(1.4 * f64::from(EDGE)),
        centre: DVec2::splat(0.5 * f64::from(EDGE)),
        width: EDGE,
        height: EDGE,
        near: 0.0,
        blur: Blur::default(),
        projection: Projection::Perspective,
    }
}

impl Draw {
    /// Returns a scene of any hardness: faint and opaque media, sharp phases, albedo 1, voxels of any size, lights and cameras
    /// anywhere, inside of media and on their faces too.
    pub fn hard_scene(&mut self) -> Scene {
        let mut scene = self.scene();
        let scale = self.between(1e-6, 1e6);
        let shift = if self.once_in(3) { 1e4 * scale * self.direction() } else { DVec3::ZERO };
        let linear = odd().matrix();
        let place = DMat4::from_scale_rotation_translation(DVec3::splat(scale), DQuat::IDENTITY, shift);
        let transform = Affine::new(if self.once_in(2) { place } else { place * linear }).unwrap();
        for volume in &mut scene.volumes {
            let edge = if self.once_in(3) { 9 } else { 20 };
            let values: fn(DVec3) -> f64 = match (4.0 * self.number()) as u32 {
                // One voxel that dwarfs the others, a step, a checkerboard.
                0 => |p| if p == DVec3::splat(7.0) { 1e4 } else { 1e-3 },
                1 => |p| if p.x < 8.0 { 1.0 } else { 0.0 },
                2 => |p| f64::from((p.x + p.y + p.z) as i32 % 2),
                _ => |p| (0.5 + 0.5 * (0.7 * p.x).sin() * (0.9 * p.y).cos() * (0.5 * p.z).sin()).powi(3),
            };
            let Volume::Density(old, medium) = volume else { continue };
            *old = field(edge, transform, values);
            medium.extinction = self.between(1e-5, 1e3) / scale;
            let scattering = medium.scattering.as_mut().unwrap();
            // Of opaque media that absorb nothing light never comes out, and paths never end.
            if medium.extinction * scale < 3.0 && self.once_in(3) {
                scattering.albedo = [1.0; 3];
            }
            scattering.gradient_shading = self.once_in(3).then(|| self.between(1e-6, 1e6) / scale);
            if self.once_in(3) {
                scattering.phase = Phase::HenyeyGreenstein(if self.once_in(2) { 0.999 } else { -0.999 });
            }
            if self.once_in(4) {
                medium.source = Source::Grey([0.0; 3]);
                let color = self.color(1.0) / scale as f32;
                let grid = emission::volume(old, medium.extinction, &[(old.clone(), Emission::Linear(color))]);
                let (density, medium) = (old.clone(), medium.clone());
                *volume = Volume::Emissive { density, medium, emission: Box::new(Emitted::new(grid.unwrap())) };
            }
        }
        let bounds = scene.volumes[0].density().unwrap().0.world_bounds();
        let (centre, size) = (bounds.centre(), bounds.size().length());
        scene.lights = (0..(4.0 * self.number()) as usize).map(|_| self.light(centre, size)).collect();
        if self.once_in(4) {
            let position = if self.once_in(2) { centre } else { bounds.min };
            scene.lights.push(Light::Point { position, intensity: Vec3::splat((size * size) as f32) });
        }
        if self.once_in(4) {
            scene.lights.push(Light::Sphere { centre, radius: 0.1 * size, radiance: Vec3::ONE });
        }
        let eye = match (4.0 * self.number()) as u32 {
            0 => centre + 1e-3 * size * self.direction(),
            // Along an axis, on a face.
            1 => DVec3::new(bounds.min.x, centre.y, centre.z),
            2 => DVec3::new(centre.x, centre.y, bounds.max.z + 1e3 * size),
            _ => centre + 1.2 * size * self.direction(),
        };
        scene.cameras = vec![camera(eye, centre + 1e-3 * size * DVec3::X)];
        scene
    }
}
