//! Arrays: the places of their values, and volumes read from files.

use crate::errors::exception;
use crate::work::done;
use cumulo::app::arrays::{Lattice, volume};
use cumulo::cancel::Cancel;
use cumulo::error::Result;
use cumulo::formats::limits::Limits;
use cumulo::math::Affine;
use glam::DMat4;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayDyn, PyArrayMethods};
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::Arc;

/// Places of the values of an array: all voxels of a box, or the active voxels of a grid.
#[pyclass(frozen, name = "Lattice")]
pub(crate) struct PyLattice(pub Arc<Lattice>);

#[pymethods]
impl PyLattice {
    /// Creates the places of an array of a shape (x, y, z), whose entry [0, 0, 0] is a voxel's centre; `transform`
    /// (4 rows of 4) maps indices to the world.
    #[staticmethod]
    #[pyo3(signature = (shape, transform, max_memory=None))]
    fn of_box(py: Python<'_>, shape: [usize; 3], transform: [[f64; 4]; 4], max_memory: Option<u64>) -> PyResult<Self> {
        let made = || -> Result<Lattice> {
            let transform = Affine::new(DMat4::from_cols_array_2d(&transform).transpose())?;
            Lattice::of_box(shape, transform, limits(max_memory))
        };
        made().map(|lattice| Self(Arc::new(lattice))).map_err(|e| exception(py, &e))
    }

    /// Reads the grid whose active voxels have values; returns the places and the grid's values, float32.
    #[staticmethod]
    #[pyo3(signature = (path, grid=None, max_memory=None))]
    fn of_grid<'py>(
        py: Python<'py>,
        path: PathBuf,
        grid: Option<String>,
        max_memory: Option<u64>,
    ) -> PyResult<(Self, Bound<'py, PyArray1<f32>>)> {
        let read = || {
            let lattice = Lattice::of_grid(&path, grid.as_deref(), limits(max_memory))?;
            let values = lattice.active()?.values();
            Ok((lattice, values))
        };
        let (lattice, values) = done(py, 0, &Cancel::new(), read)?;
        Ok((Self(Arc::new(lattice)), values.into_pyarray(py)))
    }

    /// Shape of the array, without the channels of a voxel.
    #[getter]
    fn shape(&self, py: Python<'_>) -> PyResult<Vec<usize>> {
        self.0.shape().map_err(|e| exception(py, &e))
    }

    /// Map from indices to the world: 4 rows of 4.
    #[getter]
    fn transform(&self) -> [[f64; 4]; 4] {
        self.0.transform().matrix().transpose().to_cols_array_2d()
    }

    /// Index coordinates of the active voxels, int32, [voxels, 3].
    fn coordinates<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<i32>>> {
        let active = self.0.active().map_err(|e| exception(py, &e))?;
        let all: Vec<i32> = active.coordinates().into_iter().flatten().collect();
        all.into_pyarray(py).reshape([active.len(), 3])
    }
}

/// Returns the limits of memory: those given, else the default.
fn limits(max_memory: Option<u64>) -> Limits {
    max_memory.map_or_else(Limits::default, |max_memory| Limits { max_memory })
}

/// A volume as [`read_volume`] returns it: values, transform, name, index coordinates of the first voxel, background.
type Read<'py> = (Bound<'py, PyArrayDyn<f32>>, [[f64; 4]; 4], String, [i32; 3], Vec<f64>);

/// Reads a grid of a VDB, a NanoVDB or a scan as an array over the box of its active voxels: float32, [x, y, z] or
/// [x, y, z, component]. Returns it with the map from its indices to the world (4 rows of 4), the grid's name, the
/// index coordinates of the first voxel, and the value of the other voxels.
#[pyfunction]
#[pyo3(signature = (path, grid=None, max_memory=None))]
pub(crate) fn read_volume<'py>(
    py: Python<'py>,
    path: PathBuf,
    grid: Option<String>,
    max_memory: Option<u64>,
) -> PyResult<Read<'py>> {
    let read = || volume(&path, grid.as_deref(), limits(max_memory));
    let found = done(py, 0, &Cancel::new(), read)?;
    let mut shape = found.shape.to_vec();
    if found.components > 1 {
        shape.push(found.components);
    }
    let rows = found.transform.transpose().to_cols_array_2d();
    Ok((found.values.into_pyarray(py).reshape(shape)?, rows, found.name, found.low, found.background))
}
