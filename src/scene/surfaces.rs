//! Surfaces of triangles that rays meet.

use crate::error::{Error, Result};
use crate::math::{Aabb, Ray};
use glam::{DVec3, Vec3A};
use obvhs::aabb::Aabb as Bounds;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2;
use obvhs::ray::{Ray as TreeRay, RayHit};
use obvhs::{Boundable, BvhBuildParams};
use std::fmt;

/// Bytes of a triangle with its part of the tree, while it is built.
pub const TRIANGLE_BYTES: u64 = 400;

/// Triangles in world space, seen from both sides.
pub struct Surfaces {
    /// A corner and the edges from it, in the order of the tree.
    triangles: Vec<[DVec3; 3]>,
    tree: Bvh2,
    bounds: Aabb,
    /// World length of a unit of the tree's coordinates, whose origin is the middle of the bounds.
    unit: f64,
}

impl fmt::Debug for Surfaces {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Surfaces").field("triangles", &self.triangles.len()).field("bounds", &self.bounds).finish()
    }
}

/// Slack of boxes in the tree's coordinates, for what single precision rounds.
const SLACK: f32 = 1e-5;

struct Boxed(Bounds);

impl Boundable for Boxed {
    fn aabb(&self) -> Bounds {
        self.0
    }
}

impl Surfaces {
    /// Creates surfaces from the corners of triangles.
    ///
    /// # Errors
    /// If there are no triangles, or more than 2³¹, or a coordinate is not finite or so large that differences are not.
    pub fn new(triangles: &[[DVec3; 3]]) -> Result<Self> {
        let bounds = triangles.iter().flatten().fold(Aabb::EMPTY, |bounds, corner| bounds.including(*corner));
        let sound = |at: &DVec3| at.is_finite() && at.abs().max_element() < 1e150;
        if triangles.is_empty() || triangles.len() > 1 << 31 || !triangles.iter().flatten().all(sound) {
            return Err(Error::invalid(format!("{} triangles are no surface that rays can meet", triangles.len()))
                .hint("give a mesh of triangles whose coordinates are finite"));
        }
        let unit = Some(0.5 * bounds.size().max_element()).filter(|unit| *unit > 0.0).unwrap_or(1.0);
        let middle = bounds.centre();
        let boxed = |triangle: &[DVec3; 3]| {
            let corners = triangle.map(|corner| Vec3A::from(((corner - middle) / unit).as_vec3()));
            let Bounds { min, max, .. } = Bounds::from_points(&corners);
            Boxed(Bounds::new(min - SLACK, max + SLACK))
        };
        let boxes: Vec<Boxed> = triangles.iter().map(boxed).collect();
        let tree = build_bvh2(&boxes, BvhBuildParams::fast_build(), &mut std::time::Duration::default());
        let edges = |number: &u32| {
            let [a, b, c] = triangles[*number as usize];
            [a, b - a, c - a]
        };
        let triangles = tree.primitive_indices.iter().map(edges).collect();
        Ok(Self { triangles, tree, bounds, unit })
    }

    /// Returns the parameter at which a ray meets the nearest triangle, before its far end; `None` if it meets none.
    pub fn nearest(&self, ray: &Ray) -> Option<f64> {
        self.hit(ray).map(|hit| hit.distance)
    }

    /// Returns where a ray meets the nearest triangle, before its far end; `None` if it meets none but one that it
    /// begins on.
    pub fn hit(&self, ray: &Ray) -> Option<Hit> {
        let (tree_ray, single) = self.in_tree(ray)?;
        let mut nearest: Option<Hit> = None;
        // A ray that begins on a surface does not meet it there.
        let least = self.margin(0.0) / ray.direction.length();
        self.tree.ray_traverse(tree_ray, &mut RayHit::none(), |_, number| {
            match intersection(ray, &self.triangles[number]).filter(|distance| *distance > least) {
                Some(distance) => {
                    let nearer = nearest.is_none_or(|hit| distance < hit.distance) && distance <= ray.far;
                    if nearer {
                        nearest = Some(Hit { distance, triangle: number });
                    }
                    // What is nearer by less than single precision resolves is looked at, too.
                    single(distance) + 10.0 * SLACK
                }
                None => f32::INFINITY,
            }
        });
        nearest
    }

    /// True if a ray meets a triangle before its far end.
    pub fn block(&self, ray: &Ray) -> bool {
        let Some((tree_ray, _)) = self.in_tree(ray) else { return false };
        let least = self.margin(0.0) / ray.direction.length();
        let meets = |number| {
            let distance = intersection(ray, &self.triangles[number]);
            distance.is_some_and(|distance| distance > least && distance <= ray.far)
        };
        !self.tree.ray_traverse_miss(tree_ray, |_, number| if meets(number) { 0.0 } else { f32::INFINITY })
    }

    /// Returns a ray in the tree's coordinates, and what turns its parameters into lengths there; `None` if it misses
    /// the bounds.
    fn in_tree(&self, ray: &Ray) -> Option<(TreeRay, impl Fn(f64) -> f32)> {
        let slack = DVec3::splat(f64::from(SLACK) * self.unit);
        let around = Aabb { min: self.bounds.min - slack, max: self.bounds.max + slack };
        let (enter, leave) = around.clip(ray)?;
        if enter > ray.far {
            return None;
        }
        // From the bounds on, single precision resolves positions however far the ray begins.
        let origin = ((ray.at(enter) - self.bounds.centre()) / self.unit).as_vec3();
        let speed = ray.direction.length() / self.unit;
        let direction = (ray.direction / (speed * self.unit)).as_vec3();
        let single = move |t: f64| ((t - enter) * speed) as f32;
        let most = single(leave.min(ray.far)) + 10.0 * SLACK;
        Some((TreeRay::new(origin.into(), direction.into(), 0.0, most), single))
    }

    /// Returns a corner of a triangle and the edges from it.
    pub(super) fn triangle(&self, number: usize) -> &[DVec3; 3] {
        &self.triangles[number]
    }

    /// Returns the numbers that triangles had when the surfaces were made.
    pub(super) fn numbers(&self) -> &[u32] {
        &self.tree.primitive_indices
    }

    /// Returns the length that rays which leave a surface, which was met at a distance, begin before it, so that they
    /// do not meet it again.
    pub(super) fn margin(&self, distance: f64) -> f64 {
        let largest = self.bounds.min.abs().max(self.bounds.max.abs()).max_element();
        MARGIN * (largest + distance)
    }
}

/// Share of coordinates and distances by which rounding moves the points at which surfaces are met, at most.
const MARGIN: f64 = 1e-10;

/// A triangle that a ray meets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Parameter of the ray.
    pub distance: f64,
    /// Number of the triangle in the order of the tree.
    pub(super) triangle: usize,
}

/// Returns where a ray meets a triangle, which is given by a corner and the edges from it (Möller & Trumbore 1997).
/// Edges belong to both triangles that they separate, so that no ray slips between.
fn intersection(ray: &Ray, [corner, u, v]: &[DVec3; 3]) -> Option<f64> {
    const EDGE: f64 = 1e-12;
    let across = ray.direction.cross(*v);
    let determinant = u.dot(across);
    // Of triangles without area, and of rays along them, rounding alone would tell.
    if determinant.powi(2) <= (EDGE * EDGE) * u.length_squared() * across.length_squared() {
        return None;
    }
    let from = ray.origin - corner;
    let first = from.dot(across) / determinant;
    let other = from.cross(*u);
    let second = ray.direction.dot(other) / determinant;
    let inside = first >= -EDGE && second >= -EDGE && first + second <= 1.0 + EDGE;
    let t = v.dot(other) / determinant;
    (inside && t >= 0.0 && t.is_finite()).then_some(t)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    /// A sphere of triangles about a place.
    fn sphere(centre: DVec3, radius: f64, rows: u32) -> Vec<[DVec3; 3]> {
        let at = |row: u32, column: u32| {
            let (polar, turn) = (f64::from(row) / f64::from(rows), f64::from(column) / f64::from(2 * rows));
            let (sine, cosine) = (std::f64::consts::PI * polar).sin_cos();
            let (y, x) = (std::f64::consts::TAU * turn).sin_cos();
            centre + radius * DVec3::new(sine * x, sine * y, cosine)
        };
        let quad = |(row, column): (u32, u32)| {
            let [a, b, c, d] = [[0, 0], [1, 0], [1, 1], [0, 1]].map(|[i, j]| at(row + i, column + j));
            [[a, b, c], [a, c, d]]
        };
        (0..rows).flat_map(|row| (0..2 * rows).map(move |column| (row, column))).flat_map(quad).collect()
    }

    /// The tree finds what all triangles one by one tell, from near and far, for small and large triangles, along axes
    /// as well.
    #[test]
    fn the_nearest_of_all_triangles_is_met() {
        for (centre, radius, away) in [
            (DVec3::ZERO, 1.0, 3.0),
            (DVec3::new(1e6, -3e5, 7.0), 0.01, 1.0),
            (DVec3::ONE, 1e-9, 1e-8),
            (DVec3::X, 1.0, 1e7),
        ] {
            let triangles = sphere(centre, radius, 12);
            let surfaces = Surfaces::new(&triangles).unwrap();
            let all: Vec<_> = triangles.iter().map(|[a, b, c]| [*a, *b - a, *c - a]).collect();
            let mut hits = 0;
            for i in 0..800 {
                let turn = 0.7 * f64::from(i);
                let mut from = DVec3::new(turn.cos(), turn.sin(), (0.37 * turn).sin()).normalize();
                if i % 10 == 0 {
                    from = DVec3::AXES[i as usize / 10 % 3];
                }
                let aim = 1.2 * radius * DVec3::new((1.3 * turn).sin(), (2.1 * turn).cos(), (0.9 * turn).sin());
                let aim = if i % 10 == 0 { 0.4 * radius * from.cross(DVec3::ONE) } else { aim };
                let origin = centre + away * from + aim * f64::from(i % 2);
                let direction = if i % 10 == 0 { -from } else { (centre + aim - origin).normalize() };
                for ray in
                    [Ray::new(origin, direction), Ray { far: away - 0.5 * radius, ..Ray::new(origin, direction) }]
                {
                    let expected =
                        all.iter().filter_map(|triangle| intersection(&ray, triangle)).fold(f64::INFINITY, f64::min);
                    let expected = (expected <= ray.far && expected.is_finite()).then_some(expected);
                    assert_eq!(surfaces.nearest(&ray), expected, "{centre} {radius} {i}");
                    hits += u32::from(expected.is_some());
                }
            }
            assert!(hits > 300, "{hits}");
            // From inside no ray slips between two triangles, nor through a corner.
            for i in 0..2000 {
                let turn = 0.7 * f64::from(i);
                let direction = DVec3::new(turn.cos(), turn.sin(), (0.37 * turn).sin()).normalize();
                assert!(surfaces.nearest(&Ray::new(centre, direction)).is_some(), "{i}");
            }
            let corners = triangles.iter().flatten();
            assert!(corners.map(|at| Ray::new(centre, *at - centre)).all(|ray| surfaces.nearest(&ray).is_some()));
        }
    }

    #[test]
    fn what_no_ray_can_meet_is_refused() {
        assert!(Surfaces::new(&[]).is_err());
        assert!(Surfaces::new(&[[DVec3::ZERO, DVec3::X, DVec3::NAN]]).is_err());
        assert!(Surfaces::new(&[[DVec3::ZERO, DVec3::X, DVec3::splat(1e300)]]).is_err());
        // Triangles without area are met by no ray, and do no harm.
        let flat = Surfaces::new(&[[DVec3::ONE; 3]]).unwrap();
        assert_eq!(flat.nearest(&Ray::new(DVec3::ZERO, DVec3::ONE.normalize())), None);
    }
}
