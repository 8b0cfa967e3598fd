//! Pictures of arrays, and their derivatives.

use crate::arrays::PyLattice;
use crate::errors::exception;
use crate::scene::{PyCameras, PyMedium};
use crate::work::done;
use cumulo::app::arrays::{ArrayScene, Derivatives, Differentiate, Wanted};
use cumulo::cancel::Cancel;
use cumulo::error::Error;
use cumulo::render::differentiable::ParameterGradient;
use cumulo::scene::camera::CameraGradient;
use glam::{DVec2, DVec3};
use numpy::{
    Element, IntoPyArray, PyArrayDyn, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArrayDyn,
    PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::Arc;

/// Components of the derivative with respect to a camera: position, rotation, focal lengths, principal point.
const CAMERA: usize = 10;

/// A value of an array as numbers.
trait Numbers: Differentiate<Real: Element> {
    /// Returns the numbers of values.
    fn numbers(values: Vec<Self>) -> Vec<Self::Real>;
    /// Returns numbers as values.
    fn values(numbers: &[Self::Real]) -> &[Self];
}

macro_rules! numbers {
    ($($real:ty)*) => {
        $(impl Numbers for $real {
            fn numbers(values: Vec<$real>) -> Vec<$real> {
                values
            }
            fn values(numbers: &[$real]) -> &[$real] {
                numbers
            }
        }
        impl Numbers for [$real; 4] {
            fn numbers(values: Vec<[$real; 4]>) -> Vec<$real> {
                values.into_flattened()
            }
            fn values(numbers: &[$real]) -> &[[$real; 4]] {
                numbers.as_chunks().0
            }
        })*
    };
}
numbers!(f32 f64);

/// An array as it is seen, by the precision and the kind of its values.
enum Scene {
    Single(ArrayScene<f32>),
    Double(ArrayScene<f64>),
    FourSingle(ArrayScene<[f32; 4]>),
    FourDouble(ArrayScene<[f64; 4]>),
}

/// Calls `$run` with the scene of whatever kind.
macro_rules! of_kind {
    ($scene:expr, $one:ident => $run:expr) => {
        match $scene {
            Scene::Single($one) => $run,
            Scene::Double($one) => $run,
            Scene::FourSingle($one) => $run,
            Scene::FourDouble($one) => $run,
        }
    };
}

/// An array, arranged for rays, and how it is seen: its pictures and their derivatives.
#[pyclass(frozen, name = "Scene")]
pub(crate) struct PyScene {
    scene: Scene,
    /// Views, rows and columns.
    shape: [usize; 3],
    threads: usize,
}

#[pymethods]
impl PyScene {
    /// Arranges an array of float32 or float64 in C order: [x, y, z], of active voxels [voxels], and of a pre-shaded
    /// volume [x, y, z, 4].
    #[new]
    #[pyo3(signature = (lattice, values, cameras, medium, rays_per_edge=1, threads=0, pre_shaded=false))]
    fn new(
        py: Python<'_>,
        lattice: &PyLattice,
        values: &Bound<'_, PyAny>,
        cameras: &PyCameras,
        medium: &PyMedium,
        rays_per_edge: usize,
        threads: usize,
        pre_shaded: bool,
    ) -> PyResult<Self> {
        let (lattice, setting) = (Arc::clone(&lattice.0), medium.seen_by(cameras));
        if !(1..=64).contains(&rays_per_edge) {
            let error = Error::invalid(format!("{rays_per_edge} rays along each edge of a pixel"));
            return Err(exception(py, &error.hint("give 1 to 64 as ⟨supersample⟩")));
        }
        macro_rules! arranged {
            ($array:expr, $number:ty, $one:ident, $four:ident) => {{
                let array = $array.try_readonly()?;
                let numbers = contiguous(py, &array)?;
                let scene = move || match pre_shaded {
                    true => ArrayScene::new(lattice, <[$number; 4]>::values(numbers), setting, rays_per_edge)
                        .map(Scene::$four),
                    false => ArrayScene::new(lattice, numbers, setting, rays_per_edge).map(Scene::$one),
                };
                done(py, threads, &Cancel::NEVER, scene)?
            }};
        }
        let scene = if let Ok(array) = values.cast::<PyArrayDyn<f32>>() {
            arranged!(array, f32, Single, FourSingle)
        } else if let Ok(array) = values.cast::<PyArrayDyn<f64>>() {
            arranged!(array, f64, Double, FourDouble)
        } else {
            let error = Error::invalid("values of another type").hint("give an array of float32 or float64");
            return Err(exception(py, &error));
        };
        Ok(Self { scene, shape: cameras.shape(), threads })
    }

    /// Renders red, green, blue and alpha, [views, rows, columns, 4], in the array's precision.
    fn render<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let cancel = Cancel::new();
        of_kind!(&self.scene, scene => {
            let pixels = done(py, self.threads, &cancel, || scene.render(&cancel))?;
            Ok(pixels.into_flattened().into_pyarray(py).reshape(self.pictures())?.into_any())
        })
    }

    /// Returns the derivatives of a loss from those with respect to the pictures, `cotangents` [views, rows, columns,
    /// 4], of their precision.
    ///
    /// The result has `values` (flat, in the array's precision), `function` (float64, flat), `cameras` [views, 10]
    /// (position, rotation vector about world axes, focal lengths, principal point), `step`, `extinction`, `emission`
    /// and `background`.
    #[pyo3(signature = (cotangents, by_values=true, by_function=true, by_rays=true))]
    fn vjp<'py>(
        &self,
        py: Python<'py>,
        cotangents: &Bound<'py, PyAny>,
        by_values: bool,
        by_function: bool,
        by_rays: bool,
    ) -> PyResult<Bound<'py, PyDict>> {
        let wanted = Wanted { values: by_values, function: by_function, rays: by_rays };
        of_kind!(&self.scene, scene => self.vjp_of(py, scene, cotangents, wanted))
    }

    /// Returns the change of the pictures, float64, [views, rows, columns, 4], under changes of what they depend on: of
    /// the values (flat, in their precision), the function's parameters, the cameras [views, 10], the quadrature's
    /// step, extinction, emission and background; `None` is no change.
    #[pyo3(signature = (by_values=None, by_function=None, by_cameras=None, step=0.0, extinction=0.0,
                        emission=[0.0; 3], background=[0.0; 3]))]
    fn jvp<'py>(
        &self,
        py: Python<'py>,
        by_values: Option<&Bound<'py, PyAny>>,
        by_function: Option<PyReadonlyArray1<'py, f64>>,
        by_cameras: Option<PyReadonlyArray2<'py, f64>>,
        step: f64,
        extinction: f64,
        emission: [f64; 3],
        background: [f64; 3],
    ) -> PyResult<Bound<'py, PyAny>> {
        let function = by_function.map_or_else(Vec::new, |by| by.as_array().to_vec());
        let cameras = match &by_cameras {
            Some(by) => cameras(py, by, self.shape[0])?,
            None => Vec::new(),
        };
        let shared = ParameterGradient { extinction, color: emission, background };
        let rest = Derivatives { values: Vec::<()>::new(), function, cameras, step, shared };
        of_kind!(&self.scene, scene => self.jvp_of(py, scene, by_values, rest))
    }
}

impl PyScene {
    /// Shape of the pictures.
    fn pictures(&self) -> [usize; 4] {
        let [views, height, width] = self.shape;
        [views, height, width, 4]
    }

    fn vjp_of<'py, T: Numbers>(
        &self,
        py: Python<'py>,
        scene: &ArrayScene<T>,
        cotangents: &Bound<'py, PyAny>,
        wanted: Wanted,
    ) -> PyResult<Bound<'py, PyDict>> {
        let cotangents = cotangents.cast::<PyArrayDyn<T::Real>>()?.try_readonly()?;
        if cotangents.shape() != self.pictures() {
            let (found, expected) = (cotangents.shape(), self.pictures());
            let error = Error::invalid(format!("derivatives of shape {found:?} for pictures of {expected:?}"));
            return Err(exception(py, &error.hint("give one number for each of the pictures'")));
        }
        let pixels: &[[T::Real; 4]] = contiguous(py, &cotangents)?.as_chunks().0;
        let cancel = Cancel::new();
        let by = done(py, self.threads, &cancel, || scene.vjp(pixels, wanted, &cancel))?;
        let found = PyDict::new(py);
        found.set_item("values", T::numbers(by.values).into_pyarray(py))?;
        found.set_item("function", by.function.into_pyarray(py))?;
        let of = |c: &CameraGradient| {
            [&c.position.to_array()[..], &c.rotation.to_array(), &c.focal.to_array(), &c.centre.to_array()].concat()
        };
        let all: Vec<f64> = by.cameras.iter().flat_map(of).collect();
        found.set_item("cameras", all.into_pyarray(py).reshape([by.cameras.len(), CAMERA])?)?;
        found.set_item("step", by.step)?;
        found.set_item("extinction", by.shared.extinction)?;
        found.set_item("emission", by.shared.color)?;
        found.set_item("background", by.shared.background)?;
        Ok(found)
    }

    fn jvp_of<'py, T: Numbers>(
        &self,
        py: Python<'py>,
        scene: &ArrayScene<T>,
        by_values: Option<&Bound<'py, PyAny>>,
        rest: Derivatives<()>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let values = match by_values {
            Some(array) => {
                let array = array.cast::<PyArrayDyn<T::Real>>()?.try_readonly()?;
                T::values(contiguous(py, &array)?).to_vec()
            }
            None => Vec::new(),
        };
        let Derivatives { function, cameras, step, shared, .. } = rest;
        let by = Derivatives { values, function, cameras, step, shared };
        let cancel = Cancel::new();
        let pixels = done(py, self.threads, &cancel, || scene.jvp(&by, &cancel))?;
        Ok(pixels.into_flattened().into_pyarray(py).reshape(self.pictures())?.into_any())
    }
}

/// Returns the numbers of an array that lies in memory in C order.
fn contiguous<'a, N: Element>(py: Python<'_>, array: &'a PyReadonlyArrayDyn<'_, N>) -> PyResult<&'a [N]> {
    array.as_slice().map_err(|_| {
        let error = Error::invalid("the array does not lie in memory in C order")
            .hint("give numpy.ascontiguousarray(array), which copies it");
        exception(py, &error)
    })
}

/// Returns changes of cameras.
fn cameras(py: Python<'_>, by: &PyReadonlyArray2<'_, f64>, views: usize) -> PyResult<Vec<CameraGradient>> {
    if by.shape() != [views, CAMERA] {
        let error = Error::invalid(format!("changes of cameras of shape {:?}", by.shape()));
        return Err(exception(py, &error.hint(format!("give {views} rows of {CAMERA}"))));
    }
    let by = by.as_array();
    let three = |view: usize, at: usize| DVec3::new(by[[view, at]], by[[view, at + 1]], by[[view, at + 2]]);
    let two = |view: usize, at: usize| DVec2::new(by[[view, at]], by[[view, at + 1]]);
    let one = |view: usize| CameraGradient {
        position: three(view, 0),
        rotation: three(view, 3),
        focal: two(view, 6),
        centre: two(view, 8),
    };
    Ok((0..views).map(one).collect())
}
