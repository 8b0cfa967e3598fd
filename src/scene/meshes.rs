//! The meshes of a scene: surfaces that reflect and emit light, and stop it.

use crate::error::{Error, Result};
use crate::math::Ray;
use crate::scene::light::Arrival;
use crate::scene::surfaces::Surfaces;
use glam::{DMat4, DVec3, Vec3};

/// Reflection and emission of surfaces, the same on both sides.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Material {
    /// Share of the light that is reflected, evenly to all sides (Lambert), in red, green and blue: 0 to 1.
    pub albedo: Vec3,
    /// Radiance that leaves the surface by itself.
    pub emission: Vec3,
    /// True of surfaces that the camera does not see: they hide what is behind them, and leave a hole.
    pub holdout: bool,
}

impl Default for Material {
    /// Light grey.
    fn default() -> Self {
        Self { albedo: Vec3::splat(0.8), emission: Vec3::ZERO, holdout: false }
    }
}

impl Material {
    /// Returns the material if its numbers can be used.
    ///
    /// # Errors
    /// If an albedo is not from 0 to 1, or an emission negative or not finite.
    pub fn checked(self) -> Result<Self> {
        let Self { albedo, emission, .. } = self;
        if !(albedo.cmpge(Vec3::ZERO) & albedo.cmple(Vec3::ONE)).all() {
            return Err(Error::invalid(format!("an albedo of {albedo} is none that a surface can have"))
                .hint("give shares from 0 to 1"));
        }
        if !(emission.is_finite() && emission.min_element() >= 0.0) {
            return Err(Error::invalid(format!("a surface cannot emit {emission}"))
                .hint("give finite radiances that are not negative"));
        }
        Ok(self)
    }
}

/// Meshes, all in one tree.
#[derive(Debug)]
pub struct Meshes {
    surfaces: Surfaces,
    /// Materials of the meshes.
    materials: Vec<Material>,
    /// Numbers of the meshes of the triangles, in the order of the tree.
    material_of: Vec<u32>,
    /// Triangles that emit, in the order in which they were given, with the power of all up to each: areas times the
    /// mean of the channels.
    emitting: Vec<(usize, f64)>,
}

/// A point of a surface that a ray meets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePoint {
    /// Length from the ray's origin.
    pub distance: f64,
    /// Position in world space.
    pub position: DVec3,
    /// Unit normal on the side from which the ray comes.
    pub normal: DVec3,
    /// Material.
    pub material: Material,
    /// Length above the surface from which rays begin that leave it.
    margin: f64,
}

impl SurfacePoint {
    /// Returns the origin of rays that leave the point, which do not meet its surface again.
    #[inline(always)]
    pub(crate) fn above(&self) -> DVec3 {
        self.position + self.margin * self.normal
    }
}

/// Bytes of a triangle with its part of the tree, while it is built.
pub use super::surfaces::TRIANGLE_BYTES;

impl Meshes {
    /// Creates the meshes of a scene from the triangles of each, corners in world space, and its material.
    ///
    /// # Errors
    /// If there are no triangles, or more than 2³¹, a coordinate is not finite, or a material cannot be used.
    pub fn new(meshes: &[(Vec<[DVec3; 3]>, Material)]) -> Result<Self> {
        let triangles: Vec<_> = meshes.iter().flat_map(|(triangles, _)| triangles).copied().collect();
        let surfaces = Surfaces::new(&triangles)?;
        let materials = meshes.iter().map(|(_, material)| material.checked()).collect::<Result<Vec<_>>>()?;
        let owners = meshes.iter().zip(0..).flat_map(|((triangles, _), owner)| triangles.iter().map(move |_| owner));
        let owners: Vec<u32> = owners.collect();
        let material_of: Vec<u32> = surfaces.numbers().iter().map(|number| owners[*number as usize]).collect();
        let mut places: Vec<usize> =
            (0..triangles.len()).filter(|place| emits(&materials, material_of[*place])).collect();
        places.sort_unstable_by_key(|place| surfaces.numbers()[*place]);
        let mut power = 0.0;
        let up_to = |place: usize| {
            power += strength(&materials[material_of[place] as usize]) * area(surfaces.triangle(place));
            (place, power)
        };
        let emitting = places.into_iter().map(up_to).collect::<Vec<_>>();
        // Triangles without area have no power together.
        let emitting = if emitting.last().is_some_and(|(_, power)| *power > 0.0) { emitting } else { Vec::new() };
        Ok(Self { surfaces, materials, material_of, emitting })
    }

    /// Returns the meshes, some of which, by their numbers, are moved by maps.
    ///
    /// # Errors
    /// If a coordinate is not finite then.
    pub(crate) fn moved(&self, maps: &[(usize, DMat4)]) -> Result<Self> {
        let mut all: Vec<(Vec<[DVec3; 3]>, Material)> =
            self.materials.iter().map(|material| (Vec::new(), *material)).collect();
        // Each mesh has a material of its own, and its triangles keep their order.
        let mut places: Vec<usize> = (0..self.count()).collect();
        places.sort_unstable_by_key(|place| self.surfaces.numbers()[*place]);
        for place in places {
            let mesh = self.material_of[place] as usize;
            let [corner, u, v] = *self.surfaces.triangle(place);
            let corners = [corner, corner + u, corner + v];
            let map = maps.iter().find(|(number, _)| *number == mesh);
            all[mesh].0.push(map.map_or(corners, |(_, map)| corners.map(|at| map.transform_point3(at))));
        }
        Self::new(&all)
    }

    /// Returns the point at which a ray of unit direction meets the nearest surface, before its far end.
    pub(crate) fn meet(&self, ray: &Ray) -> Option<SurfacePoint> {
        let hit = self.surfaces.hit(ray)?;
        let [_, u, v] = self.surfaces.triangle(hit.triangle);
        let normal = u.cross(*v).normalize_or_zero();
        Some(SurfacePoint {
            distance: hit.distance,
            position: ray.at(hit.distance),
            normal: if normal.dot(ray.direction) > 0.0 { -normal } else { normal },
            material: self.materials[self.material_of[hit.triangle] as usize],
            margin: self.surfaces.margin(hit.distance),
        })
    }

    /// True if a surface stands in the way of a ray to a light at a distance; one at the light itself does not.
    pub(crate) fn block(&self, ray: &Ray, distance: f64) -> bool {
        let margin = if distance.is_finite() { self.surfaces.margin(distance) } else { 0.0 };
        self.surfaces.block(&Ray { far: distance - margin, ..*ray })
    }

    /// True if the first triangle that a ray meets is that one, which is at a distance.
    pub(crate) fn see(&self, ray: &Ray, distance: f64, triangle: usize) -> bool {
        let far = distance + self.surfaces.margin(distance);
        self.surfaces.hit(&Ray { far, ..*ray }).is_some_and(|hit| hit.triangle == triangle)
    }

    /// Returns the length up to which lights are met before a surface at a distance.
    pub(crate) fn reach(&self, distance: f64) -> f64 {
        if distance.is_finite() { distance + self.surfaces.margin(distance) } else { distance }
    }

    /// Returns the number of triangles.
    pub fn count(&self) -> usize {
        self.material_of.len()
    }

    /// Returns light that arrives at a point from the surfaces that emit, drawn evenly by their power with three
    /// numbers in [0, 1), and the triangle; `None` if none emits, or it is seen from its edge.
    pub(crate) fn sample(&self, from: DVec3, [choice, u, v]: [f64; 3]) -> Option<(Arrival, usize)> {
        let power = self.emitting.last()?.1;
        let place = self.emitting.partition_point(|(_, up_to)| *up_to <= choice * power);
        let (triangle, _) = self.emitting.get(place).or(self.emitting.last())?;
        let [corner, a, b] = self.surfaces.triangle(*triangle);
        // Half of the parallelogram is folded onto the other.
        let [u, v] = if u + v > 1.0 { [1.0 - u, 1.0 - v] } else { [u, v] };
        let to = *corner + u * *a + v * *b - from;
        let distance = to.length();
        let direction = to / distance;
        let normal = a.cross(*b).normalize_or_zero();
        let material = &self.materials[self.material_of[*triangle] as usize];
        let density = self.density(material, distance, normal.dot(direction));
        if !(density > 0.0 && density.is_finite()) {
            return None;
        }
        Some((Arrival { direction, distance, radiance: material.emission, density }, *triangle))
    }

    /// Returns the density per steradian with which [`Self::sample`] draws the direction of a ray that meets a surface.
    pub(crate) fn density_towards(&self, ray: &Ray, point: &SurfacePoint) -> f64 {
        self.density(&point.material, point.distance, point.normal.dot(ray.direction))
    }

    fn density(&self, material: &Material, distance: f64, cosine: f64) -> f64 {
        let power = self.emitting.last().map_or(f64::INFINITY, |(_, power)| *power);
        strength(material) / power * distance * distance / cosine.abs()
    }

    /// True if a surface emits.
    pub(crate) fn emit(&self) -> bool {
        !self.emitting.is_empty()
    }
}

fn emits(materials: &[Material], number: u32) -> bool {
    strength(&materials[number as usize]) > 0.0
}

/// Returns the mean of the channels of a material's emission.
fn strength(material: &Material) -> f64 {
    f64::from(material.emission.element_sum()) / 3.0
}

fn area([_, u, v]: &[DVec3; 3]) -> f64 {
    0.5 * u.cross(*v).length()
}
