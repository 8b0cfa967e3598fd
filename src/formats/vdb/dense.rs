//! Boxes of a grid's voxels as dense arrays of `f64`, in and out, which hold the values of every type exactly.

use super::ffi;
use super::native::NativeGrid;
use crate::error::{Error, Result};
use crate::math::Affine;
use crate::scene::grid::GridClass;
use std::ptr::null_mut;

/// Type of the values of a grid that is made from arrays.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ValueKind {
    /// 32-bit floats.
    Float,
    /// 64-bit floats.
    Double,
    /// 32-bit integers.
    Int32,
    /// Vectors of three 32-bit floats.
    Vec3,
}

impl ValueKind {
    /// Number of values per voxel.
    pub fn components(self) -> usize {
        if self == Self::Vec3 { 3 } else { 1 }
    }

    /// Name of the type of trees of such values.
    pub(super) fn tree_type(self) -> &'static str {
        match self {
            Self::Float => "Tree_float_5_4_3",
            Self::Double => "Tree_double_5_4_3",
            Self::Int32 => "Tree_int32_5_4_3",
            Self::Vec3 => "Tree_vec3s_5_4_3",
        }
    }

    /// Bytes of memory that a leaf of 8³ voxels takes, the allocator's share included.
    pub(crate) fn leaf_bytes(self) -> u64 {
        let value = match self {
            Self::Float | Self::Int32 => 4,
            Self::Double => 8,
            Self::Vec3 => 12,
        };
        512 * value + 160
    }
}

/// An inclusive box of voxels, with the places of its voxels in an array.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DenseBox {
    /// Index coordinates of the first voxel.
    pub low: [i32; 3],
    /// Index coordinates of the last voxel.
    pub high: [i32; 3],
    /// Steps in the array from a voxel to its neighbor along x, y and z, in numbers; at least the number of components.
    pub strides: [i64; 3],
}

impl NativeGrid {
    /// Makes an empty grid with background 0 and no leaves.
    ///
    /// # Errors
    /// If the name holds a NUL byte, or OpenVDB cannot write a grid with this transform (see [`super::writable`]).
    pub fn empty(kind: ValueKind, name: &str, class: GridClass, transform: &Affine) -> Result<Self> {
        let code = match kind {
            ValueKind::Float => 0,
            ValueKind::Double => 1,
            ValueKind::Int32 => 2,
            ValueKind::Vec3 => 3,
        };
        let mut raw = null_mut();
        // SAFETY: `raw` is a valid place for the handle.
        ffi::call(|s| unsafe { ffi::grid_empty(code, &mut raw, s) })?;
        // SAFETY: fresh from the shim.
        let mut native = unsafe { Self::own(raw, name.to_owned()) }?;
        native.set_name(name)?;
        native.set_class(class)?;
        native.set_transform(transform)?;
        Ok(native)
    }

    /// Copies the values of all voxels of a box, active or not; component `c` of voxel `low + i` comes to
    /// `out[Σ strides[a] · i[a] + c]`.
    ///
    /// # Errors
    /// If the grid has no values (points), the box is empty, or `out` is too short for it.
    pub fn read_box(&self, place: &DenseBox, out: &mut [f64]) -> Result<()> {
        let DenseBox { low, high, strides } = place;
        // SAFETY: the grid is alive, the corners and strides have three entries, and `out` is as long as told.
        ffi::call(|s| unsafe {
            let (low, high, strides) = (low.as_ptr(), high.as_ptr(), strides.as_ptr());
            ffi::grid_read_box(self.as_ptr(), low, high, strides, out.as_mut_ptr(), out.len(), s)
        })
        .map_err(|e| e.part(format!("grid '{}'", self.name())))
    }

    /// Sets the voxels of a box whose values are not 0, and makes them active. Returns the number of leaves that were
    /// made, or `most + 1` if more than `most` were needed; the box is written in part then.
    ///
    /// # Errors
    /// If the grid is none that [`NativeGrid::empty`] makes, the box is empty, or `values` is too short for it.
    pub fn write_box(&mut self, place: &DenseBox, values: &[f64], most: u64) -> Result<u64> {
        let DenseBox { low, high, strides } = place;
        let mut made = 0;
        // SAFETY: the grid is alive, the corners and strides have three entries, and `values` is as long as told.
        ffi::call(|s| unsafe {
            let (low, high, strides) = (low.as_ptr(), high.as_ptr(), strides.as_ptr());
            ffi::grid_write_box(
                self.as_ptr(),
                low,
                high,
                strides,
                values.as_ptr(),
                values.len(),
                most.min(u64::MAX - 1),
                &mut made,
                s,
            )
        })
        .map_err(|e| e.part(format!("grid '{}'", self.name())))?;
        Ok(made)
    }

    /// Makes a block of 8, 128 or 4096 voxels' edge active with one value, in a grid of scalars.
    ///
    /// # Errors
    /// If the edge is another, or the grid is none of scalars that [`NativeGrid::empty`] makes.
    pub(crate) fn add_tile(&mut self, origin: [i32; 3], dim: i32, value: f64) -> Result<()> {
        if !matches!(dim, 8 | 128 | 4096) || origin.iter().any(|c| c.rem_euclid(dim) != 0) {
            return Err(Error::native(format!("a tile of {dim} voxels at {origin:?} fits no tree")));
        }
        // SAFETY: the grid is alive and the origin has three entries.
        ffi::call(|s| unsafe { ffi::grid_add_tile(self.as_ptr(), origin.as_ptr(), dim, value, s) })
            .map_err(|e| e.part(format!("grid '{}'", self.name())))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use glam::DVec3;

    fn grid(kind: ValueKind) -> NativeGrid {
        NativeGrid::empty(kind, "g", GridClass::Unknown, &Affine::uniform(0.5, DVec3::ZERO).unwrap()).unwrap()
    }

    #[test]
    fn boxes_of_every_type_and_order_come_back() {
        let size = [9_usize, 4, 17];
        for kind in [ValueKind::Float, ValueKind::Double, ValueKind::Int32, ValueKind::Vec3] {
            let n = kind.components();
            // Beyond 2²⁴, where single precision has gaps; 0 among them.
            let step = if kind == ValueKind::Int32 { 20_000_001.0 } else { 0.5 };
            let values: Vec<f64> = (0..9 * 4 * 17 * n).map(|i| (i % 101) as f64 * step - step).collect();
            let x_fastest = [n, n * size[0], n * size[0] * size[1]].map(|s| s as i64);
            let place = DenseBox { low: [-5, 2, -9], high: [3, 5, 7], strides: x_fastest };
            let mut native = grid(kind);
            let made = native.write_box(&place, &values, u64::MAX).unwrap();
            assert_eq!(made, native.info().unwrap().leaf_count);
            assert_eq!(made, 2 * 3);
            let mut found = vec![f64::NAN; values.len()];
            native.read_box(&place, &mut found).unwrap();
            assert_eq!(found, values, "{kind:?}");
            let z_fastest = [n * size[1] * size[2], n * size[2], n].map(|s| s as i64);
            native.read_box(&DenseBox { strides: z_fastest, ..place }, &mut found).unwrap();
            assert_eq!(found[2 * n], values[2 * 9 * 4 * n]);
            let voxels = values.chunks(n).filter(|v| v.iter().any(|v| *v != 0.0)).count() as u64;
            assert_eq!(native.info().unwrap().active_voxels, voxels);
            assert_eq!(grid(kind).write_box(&place, &values, 5).unwrap(), 6);
            assert!(native.read_box(&place, &mut found[1..]).is_err());
            assert!(native.write_box(&DenseBox { strides: [0, 9, 36], ..place }, &values, 9).is_err());
        }
    }

    #[test]
    fn tiles_are_read_where_there_is_no_leaf() {
        let mut native = grid(ValueKind::Int32);
        native.add_tile([8, 0, 0], 8, 7.0).unwrap();
        let place = DenseBox { low: [6, 0, 0], high: [9, 0, 0], strides: [1, 4, 4] };
        let mut found = [0.0; 4];
        native.read_box(&place, &mut found).unwrap();
        assert_eq!(found, [0.0, 0.0, 7.0, 7.0]);
        assert!(native.add_tile([1, 0, 0], 8, 7.0).is_err() && native.add_tile([0; 3], 9, 7.0).is_err());
    }
}
