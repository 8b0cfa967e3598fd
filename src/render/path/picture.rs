//! Pictures by path tracing: means over the paths of each pixel, and further planes.

use super::halves::{self, Half, Paths};
use super::{Counts, First, PathSample, PathTracer, Scratch};
use crate::render::aov::Aov;
use crate::render::sampler::Sampler;
use crate::render::tiles::{self, Watch};
use crate::scene::camera::Camera;
use crate::scene::film::{Film, Moments, Plane};
use crate::scene::velocity::Velocity;
use glam::{DVec2, DVec3, Vec2, Vec3};

/// Which paths a picture is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sampling {
    /// Paths per pixel, at least one.
    pub samples: u32,
    /// Seed of the random numbers; pictures of different seeds are independent.
    pub seed: u64,
    /// Column and row of the picture's first pixel in the picture that it is a part of, whose random numbers it has.
    pub origin: [u32; 2],
    /// Most radiance that is scattered to a path, in each channel: less noise for a picture that is too dark. `None`
    /// for all of it.
    pub clamp: Option<f32>,
}

impl Sampling {
    /// Creates the paths of a whole picture.
    pub fn new(samples: u32, seed: u64) -> Self {
        Self { samples, seed, origin: [0; 2], clamp: None }
    }
}

/// A camera, and where it stands in the frames before and after.
#[derive(Debug, Clone, Copy)]
pub struct View<'c> {
    /// Camera.
    pub camera: &'c Camera,
    /// Camera of the frame before, if there is one.
    pub before: Option<&'c Camera>,
    /// Camera of the frame after, if there is one.
    pub after: Option<&'c Camera>,
    /// Velocities of volumes, by the volume's number; others are at rest.
    pub velocities: &'c [(usize, Velocity)],
}

impl<'c> From<&'c Camera> for View<'c> {
    /// Creates the view of a picture that stands alone.
    fn from(camera: &'c Camera) -> Self {
        Self { camera, before: None, after: None, velocities: &[] }
    }
}

impl View<'_> {
    /// Returns how a collision that is seen at `now` moves in the picture with its volume: its place in the frame
    /// before minus that now, and its place now minus that in the frame after, in pixels to the right and upwards.
    fn motion(&self, first: &First, now: DVec2) -> [DVec2; 2] {
        let velocity = self.velocities.iter().find(|(volume, _)| *volume == first.volume);
        let goes = velocity.map_or(DVec3::ZERO, |(_, velocity)| velocity.per_frame(first.position));
        let from_now = |camera: Option<&Camera>, world: DVec3| {
            let place = camera.unwrap_or(self.camera).project(world).map_or(now, |(place, _)| place);
            DVec2::new(place.x - now.x, now.y - place.y)
        };
        [from_now(self.before, first.position - goes), -from_now(self.after, first.position + goes)]
    }
}

/// A picture with the number of events that it took.
#[derive(Debug, Clone)]
pub struct PathFilm {
    /// Picture.
    pub film: Film,
    /// Events.
    pub counts: Counts,
}

/// Bytes of memory per pixel while a picture is traced.
pub(crate) const PIXEL_BYTES: u64 = size_of::<Pixel>() as u64;

/// Length along the viewing axis where nothing is met, as Blender writes it.
const NOWHERE: f32 = 1e10;

/// Rays after which a pixel looks whether it is to stop.
const RAYS_BETWEEN_LOOKS: u32 = 128;

/// Most paths that begin with one camera ray.
const MOST_PER_RAY: u32 = 16;

/// Returns how many of a pixel's paths begin with one camera ray, whose way is computed once: as many as there are
/// rays, or fewer, and each ray has as many.
fn per_ray(paths: u32) -> u32 {
    (1..=MOST_PER_RAY).filter(|n| paths.is_multiple_of(*n) && n * n <= paths).max().unwrap_or(1)
}

/// Sums over a pixel's paths.
#[derive(Debug, Clone, Default)]
struct Pixel {
    /// Red, green, blue and alpha, the means over the paths of each ray.
    rgba: [Moments; 4],
    optical_depth: f64,
    direct: DVec3,
    indirect: DVec3,
    /// Rays of even and of odd number.
    halves: [Half; 2],
    /// Over first collisions: their weight, and weighted by it the albedo, the normal, the position, the length along
    /// the viewing axis.
    collided: f64,
    albedo: DVec3,
    normal: DVec3,
    position: DVec3,
    depth: f64,
    /// Motion as [`View::motion`] gives it.
    motion: [DVec2; 2],
    counts: Counts,
}

impl Pixel {
    fn add(&mut self, camera: &Camera, sample: &PathSample) {
        self.optical_depth -= f64::from(sample.transmittance.max(f32::MIN_POSITIVE)).ln();
        self.direct += sample.direct.as_dvec3();
        self.indirect += sample.indirect.as_dvec3();
        if let Some(first) = sample.first {
            let share = f64::from(first.share);
            self.collided += share;
            self.albedo += share * first.albedo.as_dvec3();
            self.position += share * first.position;
            self.depth += share * (first.position - camera.position()).dot(camera.forward());
        }
    }

    /// Returns the mean over first collisions; 0 without any.
    fn mean(&self, sum: DVec3) -> Vec3 {
        if self.collided > 0.0 { (sum / self.collided).as_vec3() } else { Vec3::ZERO }
    }
}

/// The channels of a layer and a pixel's value of each.
type Layer = (&'static str, &'static [&'static str], fn(&Pixel, u32) -> [f32; 4]);

/// Returns the layers of a plane, named as Blender names its passes where it has them.
fn layers(aov: Aov) -> Vec<Layer> {
    const RGB: &[&str] = &["R", "G", "B"];
    const XYZ: &[&str] = &["X", "Y", "Z"];
    fn of(v: Vec3) -> [f32; 4] {
        v.extend(0.0).to_array()
    }
    fn mean(sum: DVec3, samples: u32) -> [f32; 4] {
        of((sum / f64::from(samples.max(1))).as_vec3())
    }
    match aov {
        // Of pixels together.
        Aov::Variance => Vec::new(),
        Aov::OpticalDepth => {
            vec![("optical_depth", &["V"], |p, n| [(p.optical_depth / f64::from(n)) as f32, 0.0, 0.0, 0.0])]
        }
        Aov::Direct => vec![("Volume Direct", RGB, |p, n| mean(p.direct, n))],
        Aov::Indirect => vec![("Volume Indirect", RGB, |p, n| mean(p.indirect, n))],
        Aov::Albedo => vec![("Denoising Albedo", RGB, |p, n| mean(p.albedo, n))],
        Aov::Normal => vec![("Denoising Normal", XYZ, |p, _| of(p.mean(p.normal)))],
        Aov::Position => vec![("Position", XYZ, |p, _| of(p.mean(p.position)))],
        Aov::Depth => vec![("Depth", &["Z"], |p, _| {
            let depth = if p.collided > 0.0 { (p.depth / p.collided) as f32 } else { NOWHERE };
            [depth, 0.0, 0.0, 0.0]
        })],
        Aov::Motion => vec![("Vector", &["X", "Y", "Z", "W"], |p, _| {
            let mean = |sum: DVec2| if p.collided > 0.0 { (sum / p.collided).as_vec2() } else { Vec2::ZERO };
            let [before, after] = p.motion.map(mean);
            [before.x, before.y, after.x, after.y]
        })],
        Aov::Samples => vec![("Debug Sample Count", &["X"], |_, n| [n as f32, 0.0, 0.0, 0.0])],
        Aov::Halves => vec![
            ("half_a", RGB, |p, _| p.halves[0].mean().as_vec4().to_array()),
            ("half_b", RGB, |p, _| p.halves[1].mean().as_vec4().to_array()),
        ],
    }
}

impl PathTracer<'_> {
    /// Renders a picture, the mean over the paths of each pixel through points of its square, with the requested planes
    /// beside RGBA. With the planes [`Aov::Variance`] or [`Aov::Halves`] the paths are drawn in two independent halves,
    /// which cover a pixel a little less evenly: the picture has other noise, and somewhat more of it. Returns `None`
    /// if the watch stopped it.
    pub fn picture<'c, 'w>(
        &self,
        view: impl Into<View<'c>>,
        sampling: Sampling,
        aovs: &[Aov],
        watch: impl Into<Watch<'w>>,
    ) -> Option<PathFilm> {
        let (view, watch) = (view.into(), watch.into());
        let camera = view.camera;
        let size = [camera.width as usize, camera.height as usize];
        let count = sampling.samples.max(1);
        let each = per_ray(count);
        // Slopes and places in other frames are looked up for these planes alone.
        let [normals, motion] = [Aov::Normal, Aov::Motion].map(|aov| aovs.contains(&aov));
        let paths = match aovs.iter().any(|aov| matches!(aov, Aov::Variance | Aov::Halves)) {
            true => Paths::Halves,
            false => Paths::Whole,
        };
        let pixel = |scratch: &mut Scratch, at: [usize; 2]| {
            let mut pixel = Pixel::default();
            let in_whole = [0, 1].map(|axis| at[axis] + sampling.origin[axis] as usize);
            scratch.counts = Counts::default();
            for number in 0..count / each {
                // A pixel of many paths must not keep an interrupted program waiting.
                if number % RAYS_BETWEEN_LOOKS == 0 && watch.cancel.requested() {
                    break;
                }
                let (half, seed) = paths.of_ray(number, sampling.seed);
                let ray_place = paths.place(number);
                let [dx, dy, ..] = Sampler::new(seed, in_whole, ray_place).stratified();
                let place = DVec2::new(at[0] as f64 + dx, at[1] as f64 + dy);
                let ray = camera.ray(place.x, place.y);
                let mut of_ray = [0.0; 4];
                for path in ray_place * each..(ray_place + 1) * each {
                    let mut sampler = Sampler::new(seed, in_whole, path);
                    // The first set of numbers is that of the ray's place.
                    sampler.stratified();
                    let mut sample = match path % each {
                        0 => self.sample(&ray, &mut sampler, scratch),
                        _ => self.sample_again(&ray, &mut sampler, scratch),
                    };
                    if let Some(most) = sampling.clamp {
                        sample.clamp(most, &mut scratch.counts);
                    }
                    let radiance = sample.radiance();
                    let channels = [radiance.x, radiance.y, radiance.z, 1.0 - sample.transmittance];
                    of_ray.iter_mut().zip(channels).for_each(|(sum, v)| *sum += f64::from(v) / f64::from(each));
                    pixel.add(camera, &sample);
                    if let (true, Some(first)) = (normals, &sample.first) {
                        pixel.normal += f64::from(first.share) * self.kernel.normal(first);
                    }
                    if let (true, Some(first)) = (motion, &sample.first) {
                        let moved = view.motion(first, place);
                        pixel.motion.iter_mut().zip(moved).for_each(|(sum, v)| *sum += f64::from(first.share) * v);
                    }
                }
                pixel.rgba.iter_mut().zip(of_ray).for_each(|(moments, v)| moments.add(v));
                pixel.halves[half].add(of_ray);
            }
            pixel.counts = scratch.counts;
            pixel
        };
        let pixels = tiles::pixels(size, Some(watch), Scratch::default, pixel)?;
        let mut film = Film::of(size[0], size[1], pixels.iter().map(|p| p.rgba.map(|m| m.mean() as f32)).collect());
        film.samples = count;
        for aov in aovs {
            for (layer, channels, value) in layers(*aov) {
                film.planes.extend(channels.iter().enumerate().map(|(c, channel)| Plane {
                    name: format!("{layer}.{channel}"),
                    samples: pixels.iter().map(|p| value(p, count)[c]).collect(),
                }));
            }
            if *aov == Aov::Variance {
                let variances = halves::variances(size[0], pixels.iter().map(|p| (&p.rgba, &p.halves)));
                film.planes.extend(["R", "G", "B", "A"].iter().enumerate().map(|(c, channel)| Plane {
                    name: format!("variance.{channel}"),
                    samples: variances.iter().map(|v| v[c]).collect(),
                }));
            }
        }
        let counts = pixels.iter().fold(Counts::default(), |sum, p| sum.plus(p.counts));
        Some(PathFilm { film, counts })
    }
}
