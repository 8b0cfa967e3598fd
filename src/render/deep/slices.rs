//! The smooth part of what a pixel shows up to a depth: its rays are cut into slices, the finer the more they show.

use super::{DeepIntegrator, Slice, units};
use crate::math::Ray;
use crate::scene::camera::Camera;
use glam::{DVec3, DVec4};

/// Share of the error that a slice shows at most, inside of which nothing is known closer.
const SHARE: f64 = 0.5;
/// Most parts that a slice is cut into at once.
const PARTS: f64 = 16.0;
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
    pub(super) fn new(camera: &Camera, ray: Ray) -> Self {
        let axis = camera.forward();
        Self { ray, origin: (ray.origin - camera.position()).dot(axis), slope: ray.direction.dot(axis) }
    }

    /// Returns the depth at a distance along the ray.
    pub(super) fn depth(&self, distance: f64) -> f64 {
        self.origin + distance * self.slope
    }

    /// Returns the slice of the ray, which was walked last, between two depths; the first one, at `start`, begins
    /// with the ray, whose origin a moving camera may put before it.
    fn slice<I: DeepIntegrator>(
        &self,
        integrator: &I,
        way: &mut I::Traversal,
        (depths, start): ([f64; 2], f64),
        scratch: &mut I::Scratch,
    ) -> SliceOptics {
        let mut part = depths.map(|z| ((z - self.origin) / self.slope).max(0.0).min(self.ray.far));
        if depths[0] == start {
            part[0] = 0.0;
        }
        match part[1] > part[0] {
            true => integrator.slice((&self.ray, way), part, scratch).into(),
            false => SliceOptics::NOTHING,
        }
    }
}

/// A depth, and color and opacity of a pixel before it.
pub(super) type Knot = (f64, DVec4);

/// A slice as it is seen.
#[derive(Debug, Clone, Copy, PartialEq)]
struct SliceOptics {
    color: DVec3,
    transmittance: DVec3,
}

impl SliceOptics {
    const NOTHING: Self = Self { color: DVec3::ZERO, transmittance: DVec3::ONE };

    /// Returns both as one.
    fn before(self, behind: &Self) -> Self {
        Self {
            color: self.color + self.transmittance * behind.color,
            transmittance: self.transmittance * behind.transmittance,
        }
    }

    /// Returns color and opacity.
    fn value(&self) -> DVec4 {
        self.color.extend(1.0 - self.transmittance.element_sum() / 3.0)
    }
}

impl From<Slice> for SliceOptics {
    fn from(Slice { rgb, depth }: Slice) -> Self {
        let grey = depth.x == depth.y && depth.y == depth.z;
        let transmittance = if grey { DVec3::splat((-depth.x).exp()) } else { (-depth).map(f64::exp) };
        Self { color: rgb, transmittance }
    }
}

/// Scratch memory: the rays of a pixel, and what they show slice by slice.
#[derive(Debug, Default)]
pub(super) struct Slices {
    pub rays: Vec<DepthRay>,
    /// Depths between slices, ascending.
    places: Vec<f64>,
    /// For each slice, what each ray shows in it.
    seen: Vec<SliceOptics>,
    /// For each slice, true if it is not to be cut.
    whole: Vec<bool>,
    knots: Vec<Knot>,
    /// Color and transmittance of each ray before a depth.
    before: Vec<SliceOptics>,
    next: Cut,
}

/// Slices that others are cut into.
#[derive(Debug, Default)]
struct Cut {
    places: Vec<f64>,
    seen: Vec<SliceOptics>,
    whole: Vec<bool>,
    /// Numbers of the slices that are new, and of those that they are parts of.
    parts: Vec<[usize; 2]>,
}

impl Slices {
    /// Returns what the pixel shows from depth to depth in a range beside what was `drawn`, ascending, and the units of
    /// its errors.
    pub(super) fn knots<I: DeepIntegrator>(
        &mut self,
        integrator: &I,
        range: [f64; 2],
        (error, drawn): (f64, DVec4),
        scratch: &mut I::Scratch,
    ) -> (&[Knot], DVec4) {
        self.places = range.to_vec();
        self.whole = vec![false];
        self.seen.clear();
        for ray in &self.rays {
            let mut way = integrator.walk(&ray.ray, scratch);
            self.seen.push(ray.slice(integrator, &mut way, (range, range[0]), scratch));
        }
        self.sum_up();
        let shown = self.knots.last().map_or(DVec4::ZERO, |knot| knot.1);
        let unit = units(shown + drawn);
        while self.cut(SHARE * error * unit, LITTLE * shown) {
            self.fill(integrator, scratch);
            self.sum_up();
        }
        (&self.knots, unit)
    }

    /// Sums up what the pixel shows up to the end of each slice.
    fn sum_up(&mut self) {
        let count = self.rays.len().max(1);
        self.before.clear();
        self.before.resize(count, SliceOptics::NOTHING);
        self.knots.clear();
        self.knots.push((self.places[0], DVec4::ZERO));
        for (place, seen) in self.places[1..].iter().zip(self.seen.chunks(count)) {
            let mut sum = DVec4::ZERO;
            for (before, seen) in self.before.iter_mut().zip(seen) {
                *before = before.before(seen);
                sum += before.value();
            }
            self.knots.push((*place, sum / count as f64));
        }
    }

    /// Cuts the slices that show more than a rise, or anything but `little` of it in a long part of the range. Returns
    /// false if none is left.
    fn cut(&mut self, most: DVec4, little: DVec4) -> bool {
        let count = self.rays.len().max(1);
        let coarse = (self.places[self.places.len() - 1] - self.places[0]) / COARSE;
        let Cut { places, seen, whole, parts } = &mut self.next;
        places.clear();
        seen.clear();
        whole.clear();
        parts.clear();
        places.push(self.places[0]);
        for (slice, pair) in self.places.windows(2).enumerate() {
            let [from, to] = [pair[0], pair[1]];
            let rise = (self.knots[slice + 1].1 - self.knots[slice].1).abs();
            let enough = rise.cmple(most).all() && (to - from <= coarse || rise.cmple(little).all());
            let first = places.len();
            if !(self.whole[slice] || enough) {
                let number = (rise / most).max_element().ceil().clamp(2.0, PARTS);
                let place = |k: usize| f64::from((from + (to - from) * k as f64 / number) as f32);
                // Depths of samples have single precision.
                for inner in (1..number as usize).map(place) {
                    if inner > places[places.len() - 1] && inner < to {
                        places.push(inner);
                    }
                }
            }
            let is_cut = places.len() > first;
            places.push(to);
            if is_cut {
                parts.extend((first..places.len()).map(|place| [place - 1, slice]));
                seen.resize((places.len() - 1) * count, SliceOptics::NOTHING);
                whole.resize(places.len() - 1, false);
            } else {
                seen.extend(&self.seen[slice * count..][..count]);
                whole.push(true);
            }
        }
        !parts.is_empty()
    }

    /// Looks at what was cut.
    fn fill<I: DeepIntegrator>(&mut self, integrator: &I, scratch: &mut I::Scratch) {
        let count = self.rays.len();
        let Cut { places, seen, parts, .. } = &mut self.next;
        for (number, ray) in self.rays.iter().enumerate() {
            let mut way = None;
            for [part, of] in parts.iter().copied() {
                if self.seen[of * count + number] != SliceOptics::NOTHING {
                    let way = way.get_or_insert_with(|| integrator.walk(&ray.ray, scratch));
                    let depths = [places[part], places[part + 1]];
                    seen[part * count + number] = ray.slice(integrator, way, (depths, places[0]), scratch);
                }
            }
        }
        std::mem::swap(&mut self.places, &mut self.next.places);
        std::mem::swap(&mut self.seen, &mut self.next.seen);
        std::mem::swap(&mut self.whole, &mut self.next.whole);
    }
}
