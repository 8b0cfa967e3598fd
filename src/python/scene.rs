//! Cameras and media from Python.

use crate::errors::exception;

use cumulo::app::arrays::usual_quadrature;
use cumulo::differentiate::study::setting::Setting;
use cumulo::error::{Error, Result};
use cumulo::render::quadrature::Quadrature;
use cumulo::scene::blur::Blur;
use cumulo::scene::camera::{Camera, Projection};
use cumulo::scene::medium::Source;
use cumulo::scene::transfer::{Lobe, Transfer};
use glam::{DMat4, DVec2};
use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;

/// Cameras whose pictures have one size.
#[pyclass(frozen, name = "Cameras")]
pub(crate) struct PyCameras(Vec<Camera>);

#[pymethods]
impl PyCameras {
    /// Creates cameras: `camera_to_world` [views, 4, 4] (column vectors, looking down -Z, +Y up), `focal` [views, 2]
    /// and `centre` [views, 2] in pixels (of orthographic cameras: focal in pixels per world unit), all float64.
    #[new]
    #[pyo3(signature = (camera_to_world, focal, centre, width, height, orthographic=false, near=0.0))]
    fn new(
        py: Python<'_>,
        camera_to_world: PyReadonlyArray3<'_, f64>,
        focal: PyReadonlyArray2<'_, f64>,
        centre: PyReadonlyArray2<'_, f64>,
        width: u32,
        height: u32,
        orthographic: bool,
        near: f64,
    ) -> PyResult<Self> {
        let (matrices, focal, centre) = (camera_to_world.as_array(), focal.as_array(), centre.as_array());
        let views = matrices.shape()[0];
        let made = || -> Result<Self> {
            let shapes = (matrices.shape(), focal.shape(), centre.shape());
            if matrices.shape() != [views, 4, 4] || focal.shape() != [views, 2] || centre.shape() != [views, 2] {
                return Err(Error::invalid(format!("cameras of shapes {shapes:?}"))
                    .hint("give matrices [views, 4, 4], focal lengths [views, 2] and principal points [views, 2]"));
            }
            let projection = if orthographic { Projection::Orthographic } else { Projection::Perspective };
            let camera = |view: usize| {
                let column = |c: usize| std::array::from_fn(|r| matrices[[view, r, c]]);
                let pair = |of: &numpy::ndarray::ArrayView2<'_, f64>| DVec2::new(of[[view, 0]], of[[view, 1]]);
                let camera_to_world = DMat4::from_cols_array_2d(&[column(0), column(1), column(2), column(3)]);
                let camera = Camera {
                    camera_to_world,
                    projection,
                    focal: pair(&focal),
                    centre: pair(&centre),
                    width,
                    height,
                    near,
                    blur: Blur::default(),
                };
                camera.checked().map_err(|e| e.part(format!("camera {view}")))
            };
            (0..views).map(camera).collect::<Result<_>>().map(Self)
        };
        made().map_err(|e| exception(py, &e))
    }

    /// Number of cameras.
    fn __len__(&self) -> usize {
        self.0.len()
    }
}

impl PyCameras {
    /// Returns the number of cameras, and rows and columns of their pictures.
    pub(crate) fn shape(&self) -> [usize; 3] {
        let size = self.0.first().map_or([0; 2], |camera| [camera.height as usize, camera.width as usize]);
        [self.0.len(), size[0], size[1]]
    }
}

/// Medium of densities, and the radiance behind it.
#[pyclass(frozen, name = "Medium")]
pub(crate) struct PyMedium(Setting);

#[pymethods]
impl PyMedium {
    /// Creates a medium. `function` is a pair of its kind ("texture", "piecewise", "gaussians") and its parameters
    /// (float64, flat, in the order of `cumulo gradient --wrt tf`), with `domain` for kinds that have one; without it
    /// the source has the radiance `emission` (times the density if `linear`). `step` replaces that of a quadrature.
    #[new]
    #[pyo3(signature = (extinction=1.0, emission=[0.0; 3], linear=false, function=None, domain=[0.0, 1.0],
                        background=[0.0; 3], quadrature=None, step=None))]
    fn new(
        py: Python<'_>,
        extinction: f64,
        emission: [f32; 3],
        linear: bool,
        function: Option<(String, PyReadonlyArray1<'_, f64>)>,
        domain: [f64; 2],
        background: [f32; 3],
        quadrature: Option<String>,
        step: Option<f64>,
    ) -> PyResult<Self> {
        let made = || -> Result<Self> {
            let transfer = match &function {
                Some((kind, parameters)) => Some(transfer(kind, parameters.as_array().to_vec(), domain)?),
                None => None,
            };
            let mut setting = Setting {
                cameras: Vec::new(),
                extinction,
                source: if linear { Source::Linear(emission) } else { Source::Grey(emission) },
                transfer,
                background,
                quadrature: Quadrature::Exact,
            };
            if background.iter().any(|v| !v.is_finite()) {
                return Err(Error::invalid(format!("background {background:?}: finite numbers are needed")));
            }
            setting.quadrature = match (quadrature, step) {
                (None, None) => usual_quadrature(&setting)?,
                (None, Some(_)) => {
                    return Err(Error::invalid("a `step` without a ⟨quadrature⟩ that has one")
                        .hint("give ⟨quadrature=midpoint⟩, or leave the step out"));
                }
                (Some(name), None) => name.parse()?,
                (Some(name), Some(step)) => match name.split(':').next() {
                    Some("midpoint") => Quadrature::Midpoint(step),
                    Some("riemann") => Quadrature::Riemann(step),
                    _ => {
                        return Err(Error::invalid(format!("quadrature '{name}' has no `step`"))
                            .hint("give ⟨quadrature=midpoint⟩ or ⟨quadrature=riemann⟩, or leave the step out"));
                    }
                },
            };
            if setting.quadrature.step().is_some_and(|step| !(1e-3..=1e3).contains(&step)) {
                return Err(Error::invalid("the `step` must lie in 0.001 to 1000 voxels"));
            }
            Ok(Self(setting))
        };
        made().map_err(|e| exception(py, &e))
    }
}

impl PyMedium {
    /// Returns the setting of the pictures of cameras.
    pub(crate) fn seen_by(&self, cameras: &PyCameras) -> Setting {
        Setting { cameras: cameras.0.clone(), ..self.0.clone() }
    }
}

/// Makes a transfer function of its parameters.
fn transfer(kind: &str, parameters: Vec<f64>, domain: [f64; 2]) -> Result<Transfer> {
    let rows = |n: usize| {
        if parameters.is_empty() || !parameters.len().is_multiple_of(n) {
            return Err(Error::invalid(format!("{} parameters of a {kind} function", parameters.len()))
                .hint(format!("give {n} an entry, and at least one entry")));
        }
        Ok(parameters.chunks_exact(n))
    };
    let four = |row: &[f64]| [row[0], row[1], row[2], row[3]];
    match kind {
        "texture" => Transfer::Texture { domain, texels: rows(4)?.map(four).collect() },
        "piecewise" => Transfer::Piecewise { points: rows(5)?.map(|p| [p[0], p[1], p[2], p[3], p[4]]).collect() },
        "gaussians" => {
            let lobe = |p: &[f64]| Lobe { mean: p[0], ln_width: p[1], rgbs: four(&p[2..]) };
            Transfer::Gaussians { domain, lobes: rows(6)?.map(lobe).collect() }
        }
        other => {
            return Err(Error::invalid(format!("a function of kind '{other}'"))
                .hint("give \"texture\", \"piecewise\" or \"gaussians\""));
        }
    }
    .checked()
    .map_err(|e| e.part("function"))
}
