//! The visual hull: where the medium can be, judged by the pixels that saw nothing.
//!
//! A pixel without optical depth has met only zeros (densities are not negative), so every voxel in
//! its way is zero. A picture that shows something, but nothing at its border, shows the whole medium:
//! what lies outside of it is empty too, unless another picture shows something there. What lies outside any
//! other picture is not judged by it, but photographs leave out what most of them do not show.

use crate::cancel::Cancel;
use crate::error::{Code, Error, Result};
use crate::inverse::observation::Observation;
use crate::inverse::observation::depth_map::DepthMap;
use crate::math::{Aabb, Affine, Ray};
use crate::scene::bricks::Topology;
use crate::scene::camera::{Camera, Projection};
use crate::scene::grid::LEAF_VOXELS;
use glam::{DMat3, DVec2, DVec3, IVec3};
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// One view's silhouette as a summed-area table, so that any rectangle is judged at once.
struct Silhouette<'a> {
    camera: &'a Camera,
    width: i64,
    height: i64,
    /// `(width + 1) · (height + 1)` counts of non-empty pixels above and left.
    sums: Vec<u32>,
    /// Image box of the non-empty pixels.
    extent: Option<(DVec2, DVec2)>,
    /// True if the border is empty, and no other picture shows something beside this one.
    whole: bool,
}

impl<'a> Silhouette<'a> {
    fn new(map: &'a DepthMap) -> Self {
        let (w, h) = (map.width, map.height);
        let mut sums = vec![0_u32; (w + 1) * (h + 1)];
        let mut extent: Option<(DVec2, DVec2)> = None;
        for y in 0..h {
            let mut row = 0;
            for x in 0..w {
                let i = y * w + x;
                // A pixel that has measured nothing counts as shown: it must not carve.
                row += u32::from(map.shown[i]);
                if map.shows(i) {
                    let (low, high) = (DVec2::new(x as f64, y as f64), DVec2::new(x as f64 + 1.0, y as f64 + 1.0));
                    extent = Some(extent.map_or((low, high), |(a, b)| (a.min(low), b.max(high))));
                }
                sums[(y + 1) * (w + 1) + x + 1] = sums[y * (w + 1) + x + 1] + row;
            }
        }
        let inner = DVec2::new(w as f64, h as f64) - 1.0;
        let whole = extent.is_some_and(|(low, high)| low.cmpge(DVec2::ONE).all() && high.cmple(inner).all());
        Self { camera: &map.camera, width: w as i64, height: h as i64, sums, extent, whole }
    }

    /// True if there is nothing in the rectangle, of which the picture must show all unless it shows
    /// the whole medium. A pixel belongs to the rectangle if its centre lies inside.
    fn empty(&self, low: DVec2, high: DVec2) -> bool {
        let (mut x0, mut y0) = ((low.x - 0.5).ceil() as i64, (low.y - 0.5).ceil() as i64);
        let (mut x1, mut y1) = ((high.x - 0.5).floor() as i64 + 1, (high.y - 0.5).floor() as i64 + 1);
        if self.whole {
            (x0, x1) = (x0.clamp(0, self.width), x1.clamp(0, self.width));
            (y0, y1) = (y0.clamp(0, self.height), y1.clamp(0, self.height));
            if x0 >= x1 || y0 >= y1 {
                // Outside, or between the centres of two pixels.
                return x1 == 0 || y1 == 0 || x0 == self.width || y0 == self.height;
            }
        } else if x0 < 0 || y0 < 0 || x1 > self.width || y1 > self.height || x0 >= x1 || y0 >= y1 {
            return false;
        }
        let at = |x: i64, y: i64| self.sums[(y * (self.width + 1) + x) as usize];
        at(x1, y1) + at(x0, y0) == at(x0, y1) + at(x1, y0)
    }

    /// True if a ball around a world point shows nothing. The rectangle is at least a pixel wide.
    fn ball_is_empty(&self, centre: DVec3, radius: f64) -> bool {
        let Some((pixel, depth)) = self.camera.project(centre) else {
            let distance_behind = -self.camera.forward().dot(centre - self.camera.position());
            return self.whole && distance_behind > radius;
        };
        // Nothing is said about what lies before the near plane.
        if depth - radius < self.camera.near {
            return false;
        }
        self.reach(pixel, depth, radius).is_some_and(|reach| self.empty(pixel - reach, pixel + reach))
    }

    /// Distances in pixels that a ball around a point reaches in the picture, at least; `None` for one around the eye.
    fn reach(&self, pixel: DVec2, depth: f64, radius: f64) -> Option<DVec2> {
        let scale = match self.camera.projection {
            Projection::Orthographic => DVec2::ONE,
            Projection::Perspective if depth <= 2.0 * radius => return None,
            // |(x + δx)/(z + δz) - x/z| ≤ |δ| √(1 + (x/z)²) / (z - |δ|)
            Projection::Perspective => {
                let tangent = (pixel - self.camera.centre) / self.camera.focal;
                (1.0 + tangent * tangent).map(f64::sqrt) / (depth - radius)
            }
        };
        Some((radius * scale * self.camera.focal).max(DVec2::splat(0.75)))
    }

    /// True if no part of a ball lies in the picture.
    fn ball_is_unseen(&self, centre: DVec3, radius: f64) -> bool {
        let Some((pixel, depth)) = self.camera.project(centre) else {
            return -self.camera.forward().dot(centre - self.camera.position()) > radius;
        };
        let size = DVec2::new(self.width as f64, self.height as f64);
        let beside = |reach: DVec2| (pixel + reach).cmplt(DVec2::ZERO).any() || (pixel - reach).cmpgt(size).any();
        self.reach(pixel, depth, radius).is_some_and(beside)
    }
}

/// The silhouettes of all views.
pub struct Hull<'a> {
    views: Vec<Silhouette<'a>>,
    /// True if what most of the pictures do not show is left out.
    photographs: bool,
    cancel: Cancel,
}

impl<'a> Hull<'a> {
    /// Prepares the silhouettes.
    pub fn new(observation: &'a Observation) -> Self {
        let mut views: Vec<Silhouette> = observation.maps.par_iter().map(Silhouette::new).collect();
        // A picture of a part of the medium can have an empty border, too. Others tell: they see
        // something beside its frustum.
        let occupied: Vec<Ray> = observation.maps.par_iter().flat_map_iter(occupied_rays).collect();
        views.par_iter_mut().filter(|v| v.whole).for_each(|v| {
            let frustum = frustum(v.camera);
            v.whole = occupied.iter().all(|ray| crosses(ray, &frustum));
        });
        Self { views, photographs: observation.photographs(), cancel: Cancel::NEVER }
    }

    /// Stops with an error once that is requested.
    #[must_use]
    pub fn cancel(self, cancel: Cancel) -> Self {
        Self { cancel, ..self }
    }

    /// True if some view shows that there is nothing in the ball. What most photographs do not show is no part of what
    /// they were taken of, even if it reaches their borders.
    fn carved(&self, centre: DVec3, radius: f64) -> bool {
        let unseen = || self.views.iter().filter(|v| v.ball_is_unseen(centre, radius)).count();
        self.views.iter().any(|v| v.ball_is_empty(centre, radius))
            || (self.photographs && 2 * unseen() > self.views.len())
    }

    /// World box of the hull, found coarse to fine.
    ///
    /// # Errors
    /// If every picture is empty, or the views do not bound a region.
    pub fn bounds(&self) -> Result<Aabb> {
        if self.views.iter().all(|v| v.extent.is_none()) {
            return Err(Error::invalid("every picture is empty: there is nothing to reconstruct")
                .hint("check that 'background' in transforms.json is the color of the empty pixels"));
        }
        let (centre, radius) = self.ball()?;
        let mut bounds = Aabb { min: centre - radius, max: centre + radius };
        const CELLS: i32 = 32;
        for round in 0..12 {
            let cell = bounds.size() / f64::from(CELLS);
            let kept = (0..CELLS * CELLS * CELLS)
                .into_par_iter()
                .filter_map(|i| {
                    let p = IVec3::new(i / (CELLS * CELLS), i / CELLS % CELLS, i % CELLS).as_dvec3();
                    let centre = bounds.min + (p + 0.5) * cell;
                    (!self.cancel.requested() && !self.carved(centre, 0.5 * cell.length()))
                        .then(|| Aabb { min: centre - 0.5 * cell, max: centre + 0.5 * cell })
                })
                .reduce(|| Aabb::EMPTY, Aabb::union);
            if self.cancel.requested() {
                return Err(Error::cancelled());
            }
            if kept.is_empty() {
                return Err(Error::invalid(
                    "the pictures contradict one another: each point in space lies where at least one of them is empty",
                )
                .hint("check the cameras (camera-to-world, looking down -Z, y up) and the background color"));
            }
            let touches = (kept.min - bounds.min).min_element() <= 0.0 || (bounds.max - kept.max).min_element() <= 0.0;
            if touches && round < 2 && kept.size().max_element() > 0.9 * bounds.size().max_element() {
                let grow = bounds.size();
                bounds = Aabb { min: bounds.min - 0.5 * grow, max: bounds.max + 0.5 * grow };
                continue;
            }
            let shrunk = kept.size().max_element() < 0.9 * bounds.size().max_element();
            bounds = kept;
            if !shrunk {
                break;
            }
        }
        Ok(bounds)
    }

    /// A first guess: the point nearest to all views' central rays, and how far the silhouettes
    /// reach around it.
    fn ball(&self) -> Result<(DVec3, f64)> {
        let (mut a, mut b, mut sum, mut count) = (DMat3::ZERO, DVec3::ZERO, DVec3::ZERO, 0.0);
        for v in &self.views {
            let Some((low, high)) = v.extent else { continue };
            let middle = 0.5 * (low + high);
            let ray = v.camera.ray(middle.x, middle.y);
            let d = ray.direction;
            let across = DMat3::IDENTITY - DMat3::from_cols(d * d.x, d * d.y, d * d.z);
            a += across;
            b += across * ray.origin;
            sum += ray.origin;
            count += 1.0;
        }
        if a.determinant().abs() < 1e-6 * f64::powi(count, 3) {
            return Err(Error::invalid("the views do not bound a region: their directions are (nearly) all the same")
                .hint("give the region with ⟨bounds⟩ x0,y0,z0,x1,y1,z1"));
        }
        let centre = a.inverse() * b;
        let radius = self
            .views
            .iter()
            .filter_map(|v| {
                let (low, high) = v.extent?;
                let (pixel, depth) = v.camera.project(centre)?;
                let reach = ((high - pixel).max(pixel - low) / v.camera.focal).max_element();
                Some(match v.camera.projection {
                    Projection::Orthographic => reach,
                    Projection::Perspective => reach * depth,
                })
            })
            .fold(0.0, f64::max);
        if !(radius > 0.0 && centre.is_finite()) {
            return Err(Error::invalid("the views look away from one another: no common region")
                .hint("check the cameras, or give the region with ⟨bounds⟩ x0,y0,z0,x1,y1,z1"));
        }
        Ok((centre, 1.05 * radius))
    }

    /// Bricks of `lattice` inside the world box that hold unknowns, and which of their voxels are
    /// unknown (512 a brick): those whose own half of the way to the neighbours is not seen empty.
    ///
    /// # Errors
    /// If the lattice would have more than `limit` bricks, or no voxel is unknown; if the work is to stop.
    pub fn unknowns(&self, lattice: &Affine, bounds: &Aabb, limit: usize) -> Result<(Topology, Vec<bool>)> {
        let inside = Aabb {
            min: bounds.corners().iter().map(|c| lattice.to_index(*c)).fold(DVec3::INFINITY, DVec3::min),
            max: bounds.corners().iter().map(|c| lattice.to_index(*c)).fold(DVec3::NEG_INFINITY, DVec3::max),
        };
        let voxel = lattice.voxel_size();
        let (low, high) = ((inside.min / 8.0).floor(), (inside.max / 8.0).floor());
        let extent = high - low + 1.0;
        if low.abs().max(high.abs()).max_element() > 1e8 {
            return Err(Error::unsupported(format!(
                "the region lies {:.3e} voxels from the lattice's origin; at most 8e8 can be numbered",
                8.0 * low.abs().max(high.abs()).max_element()
            ))
            .hint("move cameras and volume towards the origin, or choose a larger ⟨voxel_size⟩"));
        }
        if extent.x * extent.y * extent.z > MOST_BRICKS {
            return Err(too_fine(extent * 8.0));
        }
        let (low, extent) = (low.as_ivec3(), extent.as_ivec3());
        let half_brick = 0.5 * (voxel * 8.0).length();
        let brick_at = |i: i32| low + IVec3::new(i / (extent.y * extent.z), i / extent.z % extent.y, i % extent.z);
        let margin = 0.5 * voxel.max_element();
        // What is too much is not gathered first.
        let count = AtomicUsize::new(0);
        let candidates: Vec<(IVec3, Vec<bool>)> = (0..extent.element_product())
            .into_par_iter()
            .filter_map(|i| {
                if self.cancel.requested() || count.load(Ordering::Relaxed) > limit {
                    return None;
                }
                let brick = brick_at(i);
                let origin = 8 * brick;
                if self.carved(lattice.to_world(origin.as_dvec3() + 3.5), half_brick) {
                    return None;
                }
                let unknown: Vec<bool> = (0..LEAF_VOXELS as i32)
                    .map(|v| {
                        let p = (origin + IVec3::new(v >> 6, v >> 3 & 7, v & 7)).as_dvec3();
                        let within = p.cmpge(inside.min - 0.5).all() && p.cmple(inside.max + 0.5).all();
                        within && !self.carved(lattice.to_world(p), margin)
                    })
                    .collect();
                unknown.contains(&true).then(|| {
                    count.fetch_add(1, Ordering::Relaxed);
                    (brick, unknown)
                })
            })
            .collect();
        if self.cancel.requested() {
            return Err(Error::cancelled());
        }
        if candidates.len() > limit {
            return Err(too_fine(extent.as_dvec3() * 8.0));
        }
        if candidates.is_empty() {
            return Err(Error::invalid("the pictures leave no voxel that could hold anything")
                .hint("check the cameras and the background color, or give the region with ⟨bounds⟩"));
        }
        let topology = Topology::new(candidates.iter().flat_map(|(brick, own)| reached(*brick, own)))?;
        let mut unknown = vec![false; topology.len() * LEAF_VOXELS];
        for (brick, own) in candidates {
            let at = topology.find(brick) as usize * LEAF_VOXELS;
            unknown[at..at + LEAF_VOXELS].copy_from_slice(&own);
        }
        Ok((topology, unknown))
    }
}

/// Estimate of the number of unknowns of a lattice.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Survey {
    /// Blocks of 8³ voxels, with those that only cells of unknowns reach into.
    pub bricks: f64,
    /// Unknown voxels.
    pub unknowns: f64,
    /// Voxels along the longest edge of the region.
    pub longest: f64,
}

/// Blocks that are looked at for an estimate, and those of them whose voxels are.
const SURVEYED: f64 = 2e5;
const SURVEYED_VOXELS: usize = 512;

impl Hull<'_> {
    /// Estimates what [`Hull::unknowns`] would give, from evenly spaced blocks, without gathering them.
    ///
    /// # Errors
    /// If the work is to stop.
    pub fn survey(&self, lattice: &Affine, bounds: &Aabb) -> Result<Survey> {
        let corners = bounds.corners().map(|c| lattice.to_index(c));
        let min = corners.iter().copied().fold(DVec3::INFINITY, DVec3::min);
        let max = corners.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
        let voxel = lattice.voxel_size();
        let (low, high) = ((min / 8.0).floor(), (max / 8.0).floor());
        let extent = high - low + 1.0;
        // A stride along each axis: every place of the region has its turn alike.
        let stride = (extent.element_product() / SURVEYED).cbrt().ceil().max(1.0);
        let count = (extent / stride).ceil().as_i64vec3();
        let half_brick = 0.5 * (voxel * 8.0).length();
        let kept: Vec<DVec3> = (0..count.element_product())
            .into_par_iter()
            .filter_map(|i| {
                let at = [i / (count.y * count.z), i / count.z % count.y, i % count.z].map(|v| v as f64);
                let brick = low + (stride * (DVec3::from_array(at) + 0.5)).floor().min(extent - 1.0);
                let origin = 8.0 * brick;
                (!self.cancel.requested() && !self.carved(lattice.to_world(origin + 3.5), half_brick)).then_some(origin)
            })
            .collect();
        let margin = 0.5 * voxel.max_element();
        let step = kept.len().div_ceil(SURVEYED_VOXELS).max(1);
        let of_brick = |origin: &DVec3| {
            let unknown = |v: i32| {
                let p = *origin + IVec3::new(v >> 6, v >> 3 & 7, v & 7).as_dvec3();
                p.cmpge(min - 0.5).all() && p.cmple(max + 0.5).all() && !self.carved(lattice.to_world(p), margin)
            };
            (0..LEAF_VOXELS as i32).filter(|v| unknown(*v)).count()
        };
        let counts: Vec<usize> = kept.par_iter().step_by(step).map(of_brick).collect();
        if self.cancel.requested() {
            return Err(Error::cancelled());
        }
        // Blocks that were looked at stand for others.
        let each = extent.element_product() / count.as_dvec3().element_product();
        let total = each * kept.len() as f64;
        let voxels: usize = counts.iter().sum();
        let some = counts.iter().filter(|n| **n > 0).count() as f64 / counts.len().max(1) as f64;
        let own = total * some;
        Ok(Survey {
            bricks: (own.cbrt() + 1.0).powi(3).min((extent + 1.0).element_product()),
            unknowns: total * voxels as f64 / counts.len().max(1) as f64,
            longest: (bounds.size() / voxel).max_element(),
        })
    }
}

/// Blocks of 8³ voxels of a region that are looked at one by one.
const MOST_BRICKS: f64 = 1e8;

/// Some of the rays of a picture that meet something.
const OCCUPIED_RAYS: usize = 1024;

fn occupied_rays(map: &DepthMap) -> impl Iterator<Item = Ray> {
    let pixels: Vec<usize> = (0..map.transmittance.len()).filter(|i| map.shows(*i)).collect();
    let step = pixels.len().div_ceil(OCCUPIED_RAYS).max(1);
    pixels.into_iter().step_by(step).map(|i| map.camera.ray((i % map.width) as f64 + 0.5, (i / map.width) as f64 + 0.5))
}

/// Planes at the sides of what a camera sees: points on them and normals inward.
fn frustum(camera: &Camera) -> [(DVec3, DVec3); 4] {
    let (w, h) = (f64::from(camera.width), f64::from(camera.height));
    let corners = [(0.0, 0.0), (w, 0.0), (w, h), (0.0, h)].map(|(x, y)| camera.ray(x, y));
    let middle = camera.ray(0.5 * w, 0.5 * h);
    let inside = middle.origin + middle.direction;
    std::array::from_fn(|i| {
        let (a, b) = (&corners[i], &corners[(i + 1) % 4]);
        let normal = a.direction.cross(b.origin + b.direction - a.origin);
        (a.origin, normal * (inside - a.origin).dot(normal).signum())
    })
}

/// True if a ray has points on the inner side of all planes.
fn crosses(ray: &Ray, planes: &[(DVec3, DVec3)]) -> bool {
    let (mut from, mut until) = (0.0_f64, f64::INFINITY);
    for (point, normal) in planes {
        let (height, slope) = ((ray.origin - *point).dot(*normal), ray.direction.dot(*normal));
        if slope > 0.0 {
            from = from.max(-height / slope);
        } else if slope < 0.0 {
            until = until.min(-height / slope);
        } else if height < 0.0 {
            return false;
        }
    }
    from <= until
}

/// Bricks with cells that the unknowns of a brick are corners of: itself, and those below it where an
/// unknown lies on the low faces.
fn reached(brick: IVec3, unknown: &[bool]) -> impl Iterator<Item = IVec3> {
    let mut steps = [false; 8];
    for v in (0..LEAF_VOXELS).filter(|v| unknown[*v]) {
        // Bits of the faces that the voxel lies on, x first.
        let faces = usize::from(v >> 6 == 0) << 2 | usize::from(v >> 3 & 7 == 0) << 1 | usize::from(v & 7 == 0);
        (0..8).filter(|step| step & !faces == 0).for_each(|step| steps[step] = true);
    }
    let below = |step: usize| IVec3::new(step as i32 >> 2, step as i32 >> 1 & 1, step as i32 & 1);
    (0..8).filter(move |step| steps[*step]).map(move |step| brick - below(step))
}

fn too_fine(voxels: DVec3) -> Error {
    Error::unsupported(format!("{:.0} x {:.0} x {:.0} voxels do not fit in memory", voxels.x, voxels.y, voxels.z))
        .coded(Code::MemoryLimit)
        .hint("choose a larger ⟨voxel_size⟩ or a smaller ⟨resolution⟩, give ⟨bounds⟩, or raise ⟨max_memory⟩")
}
