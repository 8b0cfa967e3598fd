//! Rays, boxes and affine maps in `f64`.
//! Positions may lie far from the origin; kernels in single precision therefore receive index-space coordinates
//! computed here.

use crate::error::{Error, Result};
use glam::{DMat3, DMat4, DVec3};

/// A half line, or the beginning of one; `direction` need not have unit length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Start of the ray.
    pub origin: DVec3,
    /// Direction of travel; a parameter step of 1 moves by this vector.
    pub direction: DVec3,
    /// Parameter beyond which nothing counts; infinite unless something stands in the way.
    pub far: f64,
    /// Time from 0, as the shutter of a camera opens, to 1, as it closes; 0 where nothing moves.
    pub time: f64,
}

impl Ray {
    /// Creates a ray without end.
    #[inline(always)]
    pub const fn new(origin: DVec3, direction: DVec3) -> Self {
        Self { origin, direction, far: f64::INFINITY, time: 0.0 }
    }

    /// True if something stands in the way, and what is behind it does not count.
    #[inline(always)]
    pub(crate) fn ends(&self) -> bool {
        self.far < f64::INFINITY
    }

    /// Position at parameter `t`.
    pub fn at(&self, t: f64) -> DVec3 {
        self.origin + t * self.direction
    }
}

/// Axis-aligned box; `min ≤ max` in every component unless the box is empty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aabb {
    /// Lower corner.
    pub min: DVec3,
    /// Upper corner.
    pub max: DVec3,
}

impl Aabb {
    /// The empty box.
    pub const EMPTY: Self = Self { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };

    /// True if the box contains no point.
    pub fn is_empty(&self) -> bool {
        !self.min.cmple(self.max).all()
    }
    /// Smallest box that contains this one and the point.
    #[must_use]
    pub fn including(self, p: DVec3) -> Self {
        Self { min: self.min.min(p), max: self.max.max(p) }
    }
    /// Smallest box that contains both boxes.
    #[must_use]
    pub fn union(self, o: Self) -> Self {
        Self { min: self.min.min(o.min), max: self.max.max(o.max) }
    }
    /// Edge lengths of the box along x, y and z.
    pub fn size(&self) -> DVec3 {
        self.max - self.min
    }
    /// Centre of the box.
    pub fn centre(&self) -> DVec3 {
        0.5 * (self.min + self.max)
    }
    /// Corners of the box of half the size around the same centre.
    pub fn inner_corners(&self) -> [DVec3; 8] {
        self.corners().map(|corner| corner.midpoint(self.centre()))
    }
    /// The eight corners; bits 0, 1 and 2 of the index choose the upper end along x, y and z.
    pub fn corners(&self) -> [DVec3; 8] {
        std::array::from_fn(|i| {
            let pick = |bit: usize, lo: f64, hi: f64| if i >> bit & 1 == 1 { hi } else { lo };
            DVec3::new(
                pick(0, self.min.x, self.max.x),
                pick(1, self.min.y, self.max.y),
                pick(2, self.min.z, self.max.z),
            )
        })
    }
    /// Parameter interval of `ray` inside the box, restricted to `t ≥ 0`; `None` if the ray misses.
    /// A direction component of zero is decided by the position alone, which avoids `0·∞`.
    pub fn clip(&self, ray: &Ray) -> Option<(f64, f64)> {
        // An empty box has infinite corners, so its slabs would be crossed from -∞ to ∞.
        if self.is_empty() {
            return None;
        }
        let (mut t0, mut t1) = (0.0_f64, f64::INFINITY);
        for a in 0..3 {
            let (o, d) = (ray.origin[a], ray.direction[a]);
            if d == 0.0 {
                if o < self.min[a] || o > self.max[a] {
                    return None;
                }
            } else {
                // The arithmetic is that of brick face crossings, so that both agree to the last bit.
                let per = 1.0 / d;
                let (u, v) = ((self.min[a] - o) * per, (self.max[a] - o) * per);
                t0 = t0.max(u.min(v));
                t1 = t1.min(u.max(v));
            }
        }
        (t0 < t1).then_some((t0, t1))
    }
}

/// Invertible affine map from index space to world space, in `f64` with column vectors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Affine {
    forward: DMat4,
    inverse: DMat4,
}

impl Affine {
    /// True if no entry of the maps differs by more than 1e-9 of the largest.
    pub fn is_close(&self, other: &Self) -> bool {
        let most = self.forward.to_cols_array().iter().fold(0.0, |a: f64, v| a.max(v.abs()));
        self.forward.abs_diff_eq(other.forward, 1e-9 * most)
    }

    /// Uniform scaling by `voxel_size`, followed by a translation to `origin`.
    ///
    /// # Errors
    /// If the map is not finite or not invertible; see [`Affine::new`].
    pub fn uniform(voxel_size: f64, origin: DVec3) -> Result<Self> {
        Self::new(DMat4::from_translation(origin) * DMat4::from_scale(DVec3::splat(voxel_size)))
    }

    /// An affine map after a check that the matrix is affine, finite and invertible.
    ///
    /// # Errors
    /// If an entry is not finite, the last row is not `0 0 0 1`, or the condition number of the linear part is 1e12 or
    /// more.
    pub fn new(forward: DMat4) -> Result<Self> {
        if !forward.is_finite() {
            return Err(Error::invalid("transform has entries that are not finite")
                .hint("write the grid, or the matrix, again where it was made"));
        }
        if forward.row(3) != glam::DVec4::W {
            return Err(Error::unsupported("transform has a perspective part; an affine map is needed")
                .hint("resample the grid onto a linear transform first (frustum grids come from camera-shaped fog)"));
        }
        let linear = DMat3::from_mat4(forward);
        // The Frobenius condition number bounds the spectral one from above and is cheap. The matrix is scaled first so
        // that tiny voxels neither underflow the determinant nor look singular.
        let scale = linear.to_cols_array().iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        let unit = if scale > 0.0 { linear * (1.0 / scale) } else { linear };
        let norm = |m: DMat3| m.to_cols_array().iter().map(|v| v * v).sum::<f64>().sqrt();
        let condition = norm(unit) * norm(unit.inverse());
        if !(scale > 0.0 && unit.determinant() != 0.0 && condition < 1e12) {
            return Err(Error::invalid(format!(
                "transform is singular or close to it (condition number {condition:.3e}, at most 1e12 expected)"
            ))
            .hint(
                "write the grid, or the matrix, again where it was made, with axes that are not parallel and not 0",
            ));
        }
        let inverse_linear = unit.inverse() * (1.0 / scale);
        let translation = forward.col(3).truncate();
        let inverse = DMat4::from_mat3_translation(inverse_linear, -(inverse_linear * translation));
        Ok(Self { forward, inverse })
    }

    /// Composes this map with `outer`, which maps its world further.
    ///
    /// # Errors
    /// If the composition is not finite or not invertible; see [`Affine::new`].
    pub fn then(&self, outer: &Self) -> Result<Self> {
        Self::new(outer.forward * self.forward)
    }

    /// Index-to-world matrix (column vectors).
    pub fn matrix(&self) -> DMat4 {
        self.forward
    }
    /// World-to-index matrix (column vectors).
    pub fn inverse_matrix(&self) -> DMat4 {
        self.inverse
    }
    /// World position of index coordinates.
    pub fn to_world(&self, index: DVec3) -> DVec3 {
        self.forward.transform_point3(index)
    }
    /// Index coordinates of a world position.
    /// The translation is subtracted first, so that a volume far from the origin loses no digits beyond those already
    /// lost in its coordinates.
    pub fn to_index(&self, world: DVec3) -> DVec3 {
        self.inverse.transform_vector3(world - self.forward.col(3).truncate())
    }
    /// Index-space direction of a world-space one; the length changes with the scale.
    pub fn vector_to_index(&self, world: DVec3) -> DVec3 {
        self.inverse.transform_vector3(world)
    }
    /// Lengths of the three columns: the voxel size along each index axis, in world units.
    pub fn voxel_size(&self) -> DVec3 {
        let m = &self.forward;
        DVec3::new(m.x_axis.length(), m.y_axis.length(), m.z_axis.length())
    }
    /// World-space bounding box of an index-space box.
    pub fn box_to_world(&self, index: Aabb) -> Aabb {
        if index.is_empty() {
            return Aabb::EMPTY;
        }
        index.corners().into_iter().fold(Aabb::EMPTY, |b, c| b.including(self.to_world(c)))
    }
}
