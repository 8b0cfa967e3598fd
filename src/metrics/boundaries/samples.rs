//! Cells between the voxels of a volume: the values in their middle, and the gradients there.
//!
//! They are those of the interpolated volume, as rays see it: between voxels on either side of a step there is a value
//! halfway.

use crate::math::Aabb;
use crate::scene::bricks::{BRICK, Bricks, CELLS, NONE, slot};
use glam::{DMat3, DVec3, IVec3};
use rayon::prelude::*;

/// Most cells that are looked at; of more a regular lattice is.
const MOST: usize = 2_000_000;
/// Most points along each edge of a face of the volume's box.
const FACE: i32 = 64;

/// A cell between eight voxels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    /// Value in the middle.
    pub value: f64,
    /// Magnitude of the gradient, per world unit.
    pub gradient: f32,
}

/// A field whose voxels are looked up by their indices.
pub(super) struct Voxels<'a> {
    field: &'a Bricks<f32>,
    first: IVec3,
    last: IVec3,
    /// Maps derivatives by index to those by world position.
    to_world: DMat3,
    /// Geometric mean of a voxel's edges, in world units.
    pub edge: f64,
}

impl<'a> Voxels<'a> {
    /// Returns the voxels of a field's domain, which must not be empty.
    pub(super) fn of(field: &'a Bricks<f32>) -> Self {
        let Aabb { min, max } = field.domain;
        Self {
            field,
            first: min.round().as_ivec3(),
            last: max.round().as_ivec3(),
            to_world: DMat3::from_mat4(field.transform.inverse_matrix()).transpose(),
            edge: DMat3::from_mat4(field.transform.matrix()).determinant().abs().cbrt(),
        }
    }

    /// Returns the world length of an edge of the cube that has the volume of the box.
    pub(super) fn box_edge(&self) -> f64 {
        self.edge * (self.last - self.first + 1).as_dvec3().element_product().cbrt()
    }

    /// Returns the share of the box that lies in bricks; the rest has the background's value.
    pub(super) fn filled(&self) -> f64 {
        let stored = self.field.topology.places().count() as f64 * CELLS.pow(3) as f64;
        (stored / (self.last - self.first + 1).as_dvec3().element_product()).min(1.0)
    }

    fn value(&self, at: IVec3) -> f64 {
        let number = self.field.topology.find(at >> 3);
        let stored = if number == NONE {
            self.field.background
        } else {
            let [x, y, z] = (at & 7).to_array().map(|c| c as usize);
            self.field.values[number as usize * BRICK + slot(x, y, z)]
        };
        self.field.reference + f64::from(stored)
    }

    /// Returns the cells inside the box, or at most two million of them on a regular lattice, in the order of their
    /// bricks. Of bricks that lie in several places one place counts.
    pub(super) fn samples(&self) -> Vec<Sample> {
        let bricks = self.field.topology.bricks();
        let fits = |stride: &usize| bricks.len() * CELLS.pow(3) / stride.pow(3) <= MOST;
        let stride = (1..).find(fits).unwrap_or(1) as i32;
        // An axis of one voxel has one cell.
        let last = (self.last - 1).max(self.first);
        let of_brick = |brick: &IVec3| {
            let origin = 8 * *brick;
            let along = |axis: usize| {
                (origin[axis].max(self.first[axis])..=(origin[axis] + 7).min(last[axis]))
                    .filter(move |c| c.rem_euclid(stride) == 0)
            };
            let columns = along(0).flat_map(|x| along(1).map(move |y| (x, y)));
            let places = columns.flat_map(|(x, y)| along(2).map(move |z| IVec3::new(x, y, z)));
            places.map(|at| self.sample(at)).collect::<Vec<_>>()
        };
        bricks.par_iter().map(of_brick).collect::<Vec<_>>().concat()
    }

    /// The cell whose lowest voxel is given.
    fn sample(&self, at: IVec3) -> Sample {
        let (mut value, mut slopes) = (0.0, DVec3::ZERO);
        for corner in 0..8 {
            let high = IVec3::new(corner & 1, corner >> 1 & 1, corner >> 2);
            let own = self.value((at + high).min(self.last));
            value += 0.125 * own;
            slopes += 0.25 * own * (2 * high - 1).as_dvec3();
        }
        Sample { value, gradient: (self.to_world * slopes).length() as f32 }
    }

    /// Returns the values on the faces of the box.
    pub(super) fn border(&self) -> Vec<f64> {
        let size = self.last - self.first;
        let steps = |axis: usize| {
            let length = size[axis];
            let count = length.clamp(1, FACE - 1);
            (0..=count).map(move |i| (i64::from(length) * i64::from(i) / i64::from(count)) as i32)
        };
        let of_face = |axis: usize| {
            let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
            let points = steps(b).flat_map(move |u| steps(c).map(move |v| (u, v)));
            points.flat_map(move |(u, v)| {
                [0, size[axis]].map(|end| {
                    let mut at = IVec3::ZERO;
                    (at[axis], at[b], at[c]) = (end, u, v);
                    self.value(self.first + at)
                })
            })
        };
        (0..3).flat_map(of_face).collect()
    }
}
