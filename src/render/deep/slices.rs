//! The smooth part of what a pixel shows up to a depth: its rays are cut into slices, the finer the more they show.

use super::{DeepIntegrator, Slice, units};
use crate::math::Ray;
use crate::scene::camera::Camera;
use glam::{DVec3, DVec4};

/// Share of the error within which a slice shows nothing that is known closer.
pub(super) const SHARE: f64 = 0.25;
/// Most slices of a range that are not cut for what they show, so that samples begin and end where volumes do.
const COARSE: f64 = 32.0;
/// Share of what a pixel shows that is too little to look where it is.
const LITTLE: f64 = 1e-3;

/// A camera's ray by depths along the viewing axis.
#[derive(Debug, Clone, Copy)]
pub(super) struct DepthRay {
    pub ray: Ray,
    /// Depth of the origin.
    origin: f64,
    /// Depth gained per world length.
    slope: f64,
}

impl DepthRay {
    pub fn new(camera: &Camera, ray: Ray) -> Self {
        let axis = camera.forward();
        Self { ray, origin: (ray.origin - camera.position()).dot(axis), slope: ray.direction.dot(axis) }
    }

    /// Returns the depth at a distance along the ray.
    pub fn depth(&self, distance: f64) -> f64 {
        self.origin + distance * self.slope
    }

    /// Returns the slice of the ray between two depths.
    fn slice<I: DeepIntegrator>(&self, integrator: &I, depths: [f64; 2], scratch: &mut I::Scratch) -> Slice {
        let part = depths.map(|z| ((z - self.origin) / self.slope).max(0.0));
        if part[1] > part[0] { integrator.slice(&self.ray, part, scratch) } else { Slice::default() }
    }
}

/// What a pixel shows up to a depth.
pub(super) type Knot = (f64, DVec4);

/// Scratch memory: the rays of a pixel, and what they show as far as they were followed.
#[derive(Debug, Default)]
pub(super) struct Slices {
    pub rays: Vec<DepthRay>,
    range: [f64; 2],
    /// Color and transmittance of each ray so far.
    before: Vec<(DVec3, DVec3)>,
    knots: Vec<Knot>,
    /// Largest rise between two knots.
    rise: DVec4,
    /// Rise that is too little to look where it is.
    little: DVec4,
}

impl Slices {
    /// Begins a pixel.
    pub fn begin(&mut self, range: [f64; 2]) {
        self.range = range;
        self.rays.clear();
    }

    /// Returns what the pixel shows from depth to depth beside what was `drawn`, ascending, and the units of its
    /// errors.
    pub fn knots<I: DeepIntegrator>(
        &mut self,
        integrator: &I,
        (error, drawn): (f64, DVec4),
        scratch: &mut I::Scratch,
    ) -> (&[Knot], DVec4) {
        self.before.clear();
        self.before.resize(self.rays.len(), (DVec3::ZERO, DVec3::ONE));
        self.knots.clear();
        self.knots.push((self.range[0], DVec4::ZERO));
        let whole: Vec<Slice> = self.rays.iter().map(|ray| ray.slice(integrator, self.range, scratch)).collect();
        let shown = self.after(&whole);
        let unit = units(shown + drawn);
        self.rise = SHARE * error * unit;
        self.little = LITTLE * shown;
        self.cut(integrator, self.range, &whole, scratch);
        (&self.knots, unit)
    }

    /// Returns what the pixel shows up to the end of slices.
    fn after(&self, slices: &[Slice]) -> DVec4 {
        let sum: DVec4 = self
            .before
            .iter()
            .zip(slices)
            .map(|(&(color, transmittance), slice)| {
                let (color, transmittance) = through(color, transmittance, slice);
                color.extend(1.0 - transmittance.element_sum() / 3.0)
            })
            .sum();
        sum / self.rays.len().max(1) as f64
    }

    /// Cuts slices of all rays until they show little more than what is before them.
    fn cut<I: DeepIntegrator>(
        &mut self,
        integrator: &I,
        [from, to]: [f64; 2],
        slices: &[Slice],
        scratch: &mut I::Scratch,
    ) {
        let (last, after) = (self.knots.last().map_or(DVec4::ZERO, |knot| knot.1), self.after(slices));
        let middle = f64::from((0.5 * (from + to)) as f32);
        let rise = (after - last).abs();
        let short = to - from <= (self.range[1] - self.range[0]) / COARSE;
        let done = rise.cmple(self.rise).all() && (short || rise.cmple(self.little).all());
        // Depths of samples have single precision.
        if done || middle <= from || middle >= to {
            for (before, slice) in self.before.iter_mut().zip(slices) {
                *before = through(before.0, before.1, slice);
            }
            self.knots.push((to, after));
            return;
        }
        let mut half = |depths: [f64; 2], rays: &[DepthRay]| -> Vec<Slice> {
            let part = |(ray, whole): (&DepthRay, &Slice)| match *whole == Slice::default() {
                true => Slice::default(),
                false => ray.slice(integrator, depths, scratch),
            };
            rays.iter().zip(slices).map(part).collect()
        };
        let [front, back] = [[from, middle], [middle, to]].map(|depths| half(depths, &self.rays));
        self.cut(integrator, [from, middle], &front, scratch);
        self.cut(integrator, [middle, to], &back, scratch);
    }
}

/// Returns color and transmittance up to the end of a slice.
fn through(color: DVec3, transmittance: DVec3, slice: &Slice) -> (DVec3, DVec3) {
    (color + transmittance * slice.rgb, transmittance * (-slice.depth).map(f64::exp))
}
