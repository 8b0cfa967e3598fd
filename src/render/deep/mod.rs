//! Deep pictures: of each pixel not only what it shows, but from which depths that comes, so that other elements can be
//! put into the volume afterwards.
//!
//! Color and opacity of a pixel before a depth `z` are those that it has if its rays end there:
//! `F(z) = 1/N Σ (L(0, z), 1 - T(z))`, without what is behind the volume. Along straight rays, and for the
//! transmittance that paths do not draw, `F` is known by slices (`slices`); what paths draw are steps of `F` at the
//! places of their collisions and of surfaces. Few homogeneous samples keep to `F` at every depth (`segments`).

mod curve;
mod segments;
mod slices;

use crate::cancel::Cancel;
use crate::math::Ray;
use crate::render::film::{Sampling, View};
use crate::render::integrator::{Counts, Integrator, Sample};
use crate::render::sampler::Sampler;
use crate::render::tiles::{self, Watch};
use crate::scene::deep::DeepLine;
use crate::scene::scene::Scene;
use curve::Curve;
use glam::{DVec3, DVec4, Vec3};
use slices::{DepthRay, Slices};
use std::ops::Range;

/// Radiance and optical depth of a part of a ray.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Slice {
    /// Radiance in red, green and blue that the part emits towards its beginning.
    pub rgb: DVec3,
    /// Optical depth, by channel.
    pub depth: DVec3,
}

/// Light and opacity that a path adds to a pixel at a distance along its camera's ray.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Event {
    /// World length from the ray's origin.
    pub distance: f64,
    /// Radiance that was not scattered.
    pub unscattered: Vec3,
    /// Radiance that was scattered.
    pub scattered: Vec3,
    /// Opacity, of paths that estimate the transmittance by their collisions.
    pub opacity: f32,
}

/// An integrator that tells at which depths the light comes from.
pub trait DeepIntegrator: Integrator {
    /// False if slices tell all, and nothing is drawn.
    const DRAWS: bool;
    /// State that all parts of a ray share.
    type Traversal;

    /// Returns a camera's ray up to the surface that it meets, beyond which no part is asked for.
    fn reach(&self, ray: &Ray) -> Ray {
        *ray
    }

    /// Walks along a camera's ray before parts of it are asked for.
    fn walk(&self, ray: &Ray, scratch: &mut Self::Scratch) -> Self::Traversal;

    /// Returns radiance and optical depth of the part between two world lengths of the camera's ray that was walked
    /// last, as far as no path draws them.
    fn slice(&self, from: (&Ray, &mut Self::Traversal), part: [f64; 2], scratch: &mut Self::Scratch) -> Slice;

    /// Draws what a path adds to the ray that was walked last, the background left out; `events` are empty.
    fn draw(&self, _: &Ray, _: &Self::Primary, _: &mut Sampler, _: &mut Self::Scratch, _: &mut Vec<Event>) {}
}

/// Rows of a deep picture, with what they show.
#[derive(Debug, Clone, PartialEq)]
pub struct DeepRows {
    /// Samples, row by row from the top.
    pub lines: Vec<DeepLine>,
    /// Color and opacity of the samples together, pixel by pixel.
    pub rgba: Vec<[f32; 4]>,
    /// Events.
    pub counts: Counts,
}

/// A deep picture that is to be rendered.
#[derive(Debug)]
pub struct Deep<'v> {
    /// Camera of the picture, with its blur. Holdouts have no effect.
    pub view: View<'v>,
    /// Rays of its pixels.
    pub sampling: Sampling,
    /// Largest error of a pixel before any depth, in each channel: of opacity, and of color in units of 1, or of the
    /// pixel's brightest channel if that is brighter.
    pub error: f64,
    /// Depths along the viewing axis between which there are volumes; none if there is nothing before the camera.
    range: Option<[f64; 2]>,
}

impl<'v> Deep<'v> {
    /// Creates the deep picture of a view of a scene.
    pub fn new(view: impl Into<View<'v>>, sampling: Sampling, error: f64, scene: &Scene) -> Self {
        let view = view.into();
        let (eye, axis) = (view.camera.position(), view.camera.forward());
        let volumes = std::iter::once(scene).chain(&scene.moments).flat_map(|scene| &scene.volumes);
        let corners = volumes.map(|volume| volume.world_bounds()).filter(|bounds| !bounds.is_empty());
        let depths = corners.flat_map(|bounds| bounds.corners()).map(|corner| (corner - eye).dot(axis));
        let whole = depths.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], z| [a.min(z), b.max(z)]);
        // Depths of samples have single precision.
        let margin = 1e-3 * (whole[1] - whole[0]);
        let range = [(whole[0] - margin).max(0.0), whole[1] + margin].map(|z| f64::from(z.min(f32::MAX.into()) as f32));
        // Surfaces are steps, which may stand anywhere.
        let nowhere = scene.meshes.is_some().then_some([0.0, 1.0]);
        Self { view, sampling, error, range: (range[1] > range[0]).then_some(range).or(nowhere) }
    }

    /// Renders some rows of the picture. Returns `None` if the watch stopped it.
    pub fn rows<'w, I: DeepIntegrator>(
        &self,
        integrator: &I,
        rows: Range<usize>,
        watch: impl Into<Watch<'w>>,
    ) -> Option<DeepRows> {
        let watch = watch.into();
        let width = self.view.camera.width as usize;
        let units: Vec<[usize; 2]> = rows.clone().flat_map(|y| (0..width).step_by(RUN).map(move |x| [x, y])).collect();
        let run = |scratch: &mut (I::Scratch, Slices), &[x, y]: &[usize; 2]| {
            let mut line = DeepLine::default();
            let across = x..width.min(x + RUN);
            let mut clamped = Counts::default();
            let pixel = |x| self.pixel(integrator, [x, y], scratch, (&mut line, &mut clamped), watch.cancel);
            let rgba: Vec<_> = across.clone().map(pixel).collect();
            if let Some(done) = watch.done {
                done(across.len() as u64);
            }
            (line, rgba, I::take_counts(&mut scratch.0).plus(clamped))
        };
        let runs = tiles::map(&units, watch.cancel, Default::default, run)?;
        let mut all = DeepRows { lines: Vec::with_capacity(rows.len()), rgba: Vec::new(), counts: Counts::default() };
        for row in runs.chunks(width.div_ceil(RUN).max(1)) {
            let mut line = DeepLine::default();
            for (part, rgba, counts) in row {
                line.counts.extend(&part.counts);
                line.samples.extend(&part.samples);
                all.rgba.extend(rgba);
                all.counts = all.counts.plus(*counts);
            }
            all.lines.push(line);
        }
        (!watch.cancel.requested()).then_some(all)
    }

    /// Appends the samples of a pixel, and returns what they show together.
    fn pixel<I: DeepIntegrator>(
        &self,
        integrator: &I,
        at: [usize; 2],
        (scratch, slices): &mut (I::Scratch, Slices),
        (line, clamped): (&mut DeepLine, &mut Counts),
        cancel: &Cancel,
    ) -> [f32; 4] {
        let Some(range) = self.range.filter(|_| !cancel.requested()) else {
            line.push(&[]);
            return [0.0; 4];
        };
        let mut curve = Curve::default();
        slices.rays.clear();
        let paths = f64::from(self.sampling.samples());
        let mut events = Vec::new();
        for number in 0..self.sampling.samples() / self.sampling.per_ray() {
            let shot = self.sampling.shot(at, number, false);
            let ray = DepthRay::new(self.view.camera, integrator.reach(&shot.ray(self.view.camera)));
            slices.rays.push(ray);
            if !I::DRAWS {
                continue;
            }
            let primary = integrator.primary(&Ray { far: f64::MAX, ..ray.ray }, scratch);
            for path in shot.paths {
                let mut sampler = Sampler::new(shot.seed, shot.pixel, path);
                // The first set of numbers is that of the ray's place.
                sampler.skip_stratified();
                events.clear();
                integrator.draw(&ray.ray, &primary, &mut sampler, scratch, &mut events);
                events.sort_by(|a, b| a.distance.total_cmp(&b.distance));
                let (mut sum, mut seen, mut counts) = (Vec3::ZERO, Vec3::ZERO, Counts::default());
                for event in &events {
                    sum += event.scattered;
                    let mut sample = Sample { direct: sum, ..Sample::default() };
                    counts = Counts::default();
                    if let Some(most) = self.sampling.clamp {
                        sample.clamp(most, &mut counts);
                    }
                    let color = event.unscattered + sample.direct - seen;
                    seen = sample.direct;
                    let step = color.extend(event.opacity).as_dvec4() / paths;
                    curve.step(ray.depth(event.distance), step);
                }
                *clamped = clamped.plus(counts);
            }
        }
        let drawn = curve.drawn();
        let (knots, unit) = slices.knots(integrator, range, (self.error, drawn), scratch);
        segments::append(curve.entries(knots), self.error * unit, line)
    }
}

/// Number of pixels of a row that are one unit of work.
const RUN: usize = 16;

/// Returns the units in which errors of a pixel's channels are counted, by what it shows.
fn units(whole: DVec4) -> DVec4 {
    let brightest = whole.truncate().max_element().max(1.0);
    DVec3::splat(brightest).extend(1.0)
}
