//! Grids as images over the box of their active voxels, slice by slice.

use super::placement;
use crate::error::{Code, Error, Result};
use crate::formats::limits::Limits;
use crate::formats::sample::Sample;
use crate::formats::vdb::{DenseBox, NativeGrid};
use crate::math::Affine;
use glam::DVec3;

/// A grid over the box of its active voxels, read in parts.
#[derive(Debug)]
pub struct Source<'g> {
    grid: &'g NativeGrid,
    /// Index coordinates of the first voxel.
    pub low: [i32; 3],
    /// Number of voxels along x, y and z.
    pub size: [usize; 3],
    /// Number of values per voxel, 1 or 3.
    pub components: usize,
    /// Type of the values.
    pub sample: Sample,
    /// Map to the world from indices that begin at 0.
    pub index_to_world: Affine,
}

impl<'g> Source<'g> {
    /// Prepares a grid for reading. A slice must fit into the limits.
    ///
    /// # Errors
    /// If the grid holds points or has no active voxels, its transform is not affine, or a slice does not fit.
    pub fn new(grid: &'g NativeGrid, limits: Limits) -> Result<Self> {
        let info = grid.info()?;
        let sample = match info.value_type.as_str() {
            "float" | "vec3s" => Sample::F32,
            "double" | "vec3d" => Sample::F64,
            "int32" | "vec3i" => Sample::I32,
            "int64" => Sample::I64,
            "bool" | "mask" => Sample::U8,
            other => {
                return Err(Error::unsupported(format!("the grid holds {other} values, which make no array"))
                    .hint("name a grid of scalars or vectors with ⟨grid⟩; cumulo info lists them"));
            }
        };
        let (low, high) = info.index_box.ok_or_else(|| {
            Error::invalid("the grid has no active voxels, and so no box").hint("name another grid with ⟨grid⟩")
        })?;
        let size: [u64; 3] = std::array::from_fn(|a| (i64::from(high[a]) - i64::from(low[a]) + 1) as u64);
        let [x, y, z] = size;
        // Slices along z, or along x for arrays whose last axis is z.
        let slice = x.saturating_mul(y).max(y.saturating_mul(z)).saturating_mul(8 * info.components as u64);
        let needed = slice.saturating_add(slice / 2).saturating_add(info.memory);
        if needed > limits.max_memory {
            let what =
                format!("an array of {x} x {y} x {z} voxels needs {needed} bytes, {} are allowed", limits.max_memory);
            return Err(Error::unsupported(what).coded(Code::MemoryLimit).hint(
                "raise ⟨max_memory⟩, or take a part or coarser voxels first: ⟨convert.crop⟩, ⟨convert.resample⟩",
            ));
        }
        let shift = DVec3::from_array(low.map(f64::from));
        let index_to_world = placement::shifted(&info.affine()?, shift)?;
        Ok(Self { grid, low, size: size.map(|n| n as usize), components: info.components, sample, index_to_world })
    }

    /// Number of values.
    ///
    /// # Errors
    /// If they are more than a file can have.
    pub fn count(&self) -> Result<u64> {
        let count = self.size.iter().try_fold(self.components as u64, |p, n| p.checked_mul(*n as u64));
        count.filter(|n| *n < u64::MAX / 8).ok_or_else(|| {
            Error::unsupported(format!("{:?} voxels are too many for a file", self.size))
                .hint("take a part first: ⟨convert.crop⟩")
        })
    }

    /// Reads the slice of this third index: `values[(y * size[0] + x) * components + component]`.
    ///
    /// # Errors
    /// If OpenVDB reports an error.
    pub fn slice(&self, z: usize, values: &mut Vec<f64>) -> Result<()> {
        let [x, y, _] = self.size;
        let n = self.components;
        self.part(2, z, [n, n * x, n * x * y], x * y * n, values)
    }

    /// Reads the voxels of this first index: `values[(y * size[2] + z) * components + component]`.
    ///
    /// # Errors
    /// If OpenVDB reports an error.
    pub fn slab(&self, x: usize, values: &mut Vec<f64>) -> Result<()> {
        let [_, y, z] = self.size;
        let n = self.components;
        self.part(0, x, [n * y * z, n * z, n], y * z * n, values)
    }

    fn part(&self, axis: usize, at: usize, strides: [usize; 3], length: usize, values: &mut Vec<f64>) -> Result<()> {
        let mut low = self.low;
        let mut high: [i32; 3] = std::array::from_fn(|a| self.low[a] + (self.size[a] - 1) as i32);
        low[axis] += at as i32;
        high[axis] = low[axis];
        values.resize(length, 0.0);
        self.grid.read_box(&DenseBox { low, high, strides: strides.map(|s| s as i64) }, values)
    }
}
