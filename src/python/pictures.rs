//! Pictures of arrays, and their derivatives.

use crate::arrays::PyLattice;
use crate::errors::exception;
use crate::scene::{PyCameras, PyMedium};
use crate::work::done;
use cumulo::app::arrays::{Derivatives, Differentiate, Lattice, Tangents, Wanted};
use cumulo::cancel::Cancel;
use cumulo::differentiate::study::setting::Setting;
use cumulo::error::Error;
use cumulo::render::differentiable::ParameterGradient;
use cumulo::scene::camera::CameraGradient;
use glam::{DVec2, DVec3};
use numpy::{
    Element, IntoPyArray, PyArrayDyn, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Components of the derivative with respect to a camera: position, rotation, focal lengths, principal point.
const CAMERA: usize = 10;

/// A value of an array as numbers.
trait Numbers: Differentiate {
    /// Returns the numbers of values.
    fn numbers(values: Vec<Self>) -> Vec<Self::Real>;
    /// Returns the values of numbers.
    fn values(numbers: &[Self::Real]) -> Vec<Self>;
}

macro_rules! numbers {
    ($($real:ty)*) => {
        $(impl Numbers for $real {
            fn numbers(values: Vec<$real>) -> Vec<$real> {
                values
            }
            fn values(numbers: &[$real]) -> Vec<$real> {
                numbers.to_vec()
            }
        }
        impl Numbers for [$real; 4] {
            fn numbers(values: Vec<[$real; 4]>) -> Vec<$real> {
                values.into_flattened()
            }
            fn values(numbers: &[$real]) -> Vec<[$real; 4]> {
                by_four(numbers).to_vec()
            }
        })*
    };
}
numbers!(f32 f64);

/// What all functions here are given beside the values.
struct Given<'g> {
    lattice: &'g Lattice,
    setting: Setting,
    rays_per_edge: usize,
    shape: [usize; 3],
    threads: usize,
    pre_shaded: bool,
}

impl<'g> Given<'g> {
    fn new(
        lattice: &'g PyLattice,
        (cameras, medium): (&PyCameras, &PyMedium),
        (rays_per_edge, threads, pre_shaded): (usize, usize, bool),
    ) -> Self {
        let setting = medium.seen_by(cameras);
        let rays_per_edge = rays_per_edge.clamp(1, 64);
        Self { lattice: &lattice.0, setting, rays_per_edge, shape: cameras.shape(), threads, pre_shaded }
    }

    fn pictures(&self) -> [usize; 4] {
        let [views, height, width] = self.shape;
        [views, height, width, 4]
    }
}

/// Returns the numbers of an array that lies in memory in C order.
fn contiguous<'a, N: Element>(py: Python<'_>, array: &'a numpy::PyReadonlyArrayDyn<'_, N>) -> PyResult<&'a [N]> {
    array.as_slice().map_err(|_| {
        let error = Error::invalid("the array does not lie in memory in C order")
            .hint("give numpy.ascontiguousarray(array), which copies it");
        exception(py, &error)
    })
}

/// Groups numbers by four.
fn by_four<N: Copy>(numbers: &[N]) -> &[[N; 4]] {
    numbers.as_chunks().0
}

/// Calls `$run::<T>(values)` with the values of a NumPy array of either precision.
macro_rules! of_values {
    ($py:ident, $array:ident, $pre_shaded:expr, $run:ident) => {
        if let Ok(array) = $array.cast::<PyArrayDyn<f32>>() {
            let array = array.try_readonly()?;
            let numbers = contiguous($py, &array)?;
            if $pre_shaded { $run!([f32; 4], by_four(numbers)) } else { $run!(f32, numbers) }
        } else if let Ok(array) = $array.cast::<PyArrayDyn<f64>>() {
            let array = array.try_readonly()?;
            let numbers = contiguous($py, &array)?;
            if $pre_shaded { $run!([f64; 4], by_four(numbers)) } else { $run!(f64, numbers) }
        } else {
            let error = Error::invalid("values of another type").hint("give an array of float32 or float64");
            Err(exception($py, &error))
        }
    };
}

/// Renders an array: returns red, green, blue and alpha, [views, rows, columns, 4], in the array's precision.
///
/// `values` lie in C order: [x, y, z], of active voxels [voxels], and of a pre-shaded volume [x, y, z, 4].
#[pyfunction]
#[pyo3(signature = (lattice, values, cameras, medium, rays_per_edge=1, threads=0, pre_shaded=false))]
pub(crate) fn render<'py>(
    py: Python<'py>,
    lattice: &PyLattice,
    values: &Bound<'py, PyAny>,
    cameras: &PyCameras,
    medium: &PyMedium,
    rays_per_edge: usize,
    threads: usize,
    pre_shaded: bool,
) -> PyResult<Bound<'py, PyAny>> {
    let given = Given::new(lattice, (cameras, medium), (rays_per_edge, threads, pre_shaded));
    macro_rules! run {
        ($value:ty, $values:expr) => {{
            let cancel = Cancel::new();
            let values: &[$value] = $values;
            let work = || <$value>::render(given.lattice, values, &given.setting, given.rays_per_edge, &cancel);
            let pixels = done(py, given.threads, &cancel, work)?;
            Ok(pixels.into_flattened().into_pyarray(py).reshape(given.pictures())?.into_any())
        }};
    }
    of_values!(py, values, given.pre_shaded, run)
}

/// Returns the derivatives of a loss from those with respect to the pictures, `cotangents` [views, rows, columns, 4].
///
/// The result has `values` (flat, in the array's precision), `function` (float64, flat), `cameras` [views, 10]
/// (position, rotation vector about world axes, focal lengths, principal point), `step`, `extinction`, `emission` and
/// `background`.
#[pyfunction]
#[pyo3(signature = (lattice, values, cameras, medium, cotangents, by_values=true, by_function=true, by_rays=true,
                    rays_per_edge=1, threads=0, pre_shaded=false))]
pub(crate) fn vjp<'py>(
    py: Python<'py>,
    lattice: &PyLattice,
    values: &Bound<'py, PyAny>,
    cameras: &PyCameras,
    medium: &PyMedium,
    cotangents: &Bound<'py, PyAny>,
    by_values: bool,
    by_function: bool,
    by_rays: bool,
    rays_per_edge: usize,
    threads: usize,
    pre_shaded: bool,
) -> PyResult<Bound<'py, PyDict>> {
    let given = Given::new(lattice, (cameras, medium), (rays_per_edge, threads, pre_shaded));
    let wanted = Wanted { values: by_values, function: by_function, rays: by_rays };
    macro_rules! run {
        ($value:ty, $values:expr) => {{
            let cancel = Cancel::new();
            let values: &[$value] = $values;
            let cotangents = cotangents.cast::<PyArrayDyn<<$value as Differentiate>::Real>>()?.try_readonly()?;
            if cotangents.shape() != given.pictures() {
                let error = Error::invalid(format!(
                    "derivatives of shape {:?} for pictures of {:?}",
                    cotangents.shape(),
                    given.pictures()
                ));
                return Err(exception(py, &error.hint("give one number for each of the pictures'")));
            }
            let cotangents = by_four(contiguous(py, &cotangents)?);
            let work = || {
                let how = (wanted, given.rays_per_edge);
                let found = <$value>::vjp(given.lattice, values, &given.setting, cotangents, how, &cancel)?;
                let Derivatives { values, function, cameras, step, shared } = found;
                Ok((<$value>::numbers(values), function, cameras, step, shared))
            };
            let (values, function, cameras, step, shared) = done(py, given.threads, &cancel, work)?;
            let found = PyDict::new(py);
            found.set_item("values", values.into_pyarray(py))?;
            put(py, &found, function, &cameras, (step, &shared))?;
            Ok(found)
        }};
    }
    of_values!(py, values, given.pre_shaded, run)
}

fn put(
    py: Python<'_>,
    found: &Bound<'_, PyDict>,
    function: Vec<f64>,
    cameras: &[CameraGradient],
    (step, shared): (f64, &ParameterGradient),
) -> PyResult<()> {
    found.set_item("function", function.into_pyarray(py))?;
    let of = |c: &CameraGradient| {
        let parts = [&c.position.to_array()[..], &c.rotation.to_array(), &c.focal.to_array(), &c.centre.to_array()];
        parts.concat()
    };
    let all: Vec<f64> = cameras.iter().flat_map(of).collect();
    found.set_item("cameras", all.into_pyarray(py).reshape([cameras.len(), CAMERA])?)?;
    found.set_item("step", step)?;
    found.set_item("extinction", shared.extinction)?;
    found.set_item("emission", shared.color)?;
    found.set_item("background", shared.background)
}

/// Returns the change of the pictures, float64, [views, rows, columns, 4], under changes of what they depend on: of
/// the values (flat, in their precision), the function's parameters, the cameras [views, 10], the quadrature's step,
/// extinction, emission and background; `None` is no change.
#[pyfunction]
#[pyo3(signature = (lattice, values, cameras, medium, by_values=None, by_function=None, by_cameras=None, step=0.0,
                    extinction=0.0, emission=[0.0; 3], background=[0.0; 3], rays_per_edge=1, threads=0,
                    pre_shaded=false))]
pub(crate) fn jvp<'py>(
    py: Python<'py>,
    lattice: &PyLattice,
    values: &Bound<'py, PyAny>,
    cameras: &PyCameras,
    medium: &PyMedium,
    by_values: Option<&Bound<'py, PyAny>>,
    by_function: Option<PyReadonlyArray1<'py, f64>>,
    by_cameras: Option<PyReadonlyArray2<'py, f64>>,
    step: f64,
    extinction: f64,
    emission: [f64; 3],
    background: [f64; 3],
    rays_per_edge: usize,
    threads: usize,
    pre_shaded: bool,
) -> PyResult<Bound<'py, PyAny>> {
    let given = Given::new(lattice, (cameras, medium), (rays_per_edge, threads, pre_shaded));
    let function = by_function.map_or_else(Vec::new, |by| by.as_array().to_vec());
    let cameras = match &by_cameras {
        Some(by) if by.shape() == [given.shape[0], CAMERA] => {
            let by = by.as_array();
            let three = |view: usize, at: usize| DVec3::new(by[[view, at]], by[[view, at + 1]], by[[view, at + 2]]);
            let two = |view: usize, at: usize| DVec2::new(by[[view, at]], by[[view, at + 1]]);
            let one = |view: usize| CameraGradient {
                position: three(view, 0),
                rotation: three(view, 3),
                focal: two(view, 6),
                centre: two(view, 8),
            };
            (0..given.shape[0]).map(one).collect()
        }
        Some(by) => {
            let error = Error::invalid(format!("changes of cameras of shape {:?}", by.shape()));
            return Err(exception(py, &error.hint(format!("give {} rows of {CAMERA}", given.shape[0]))));
        }
        None => Vec::new(),
    };
    let shared = ParameterGradient { extinction, color: emission, background };
    macro_rules! run {
        ($value:ty, $values:expr) => {{
            let cancel = Cancel::new();
            let values: &[$value] = $values;
            let changed = match by_values {
                Some(array) => Some(array.cast::<PyArrayDyn<<$value as Differentiate>::Real>>()?.try_readonly()?),
                None => None,
            };
            let changed = match &changed {
                Some(array) => <$value as Numbers>::values(contiguous(py, array)?),
                None => Vec::new(),
            };
            let tangents = Tangents { values: changed, function, cameras, step, shared };
            let work = || tangents.push(given.lattice, values, &given.setting, given.rays_per_edge, &cancel);
            let pixels = done(py, given.threads, &cancel, work)?;
            Ok(pixels.into_flattened().into_pyarray(py).reshape(given.pictures())?.into_any())
        }};
    }
    of_values!(py, values, given.pre_shaded, run)
}
