//! Native module of the Python package `cumulo`: the use cases, and pictures of arrays with their derivatives.
//!
//! The package's modules in `python/cumulo` have the names, defaults and documentation that users see; here arrays are
//! taken and given, work is done without Python's lock, and errors become exceptions.

mod arrays;
mod command;
mod errors;
mod pictures;
mod scene;
mod work;

use pyo3::prelude::*;

/// Use cases of Cumulo, and pictures of arrays with their derivatives.
#[pymodule]
mod _native {
    #[pymodule_export]
    use crate::arrays::{PyLattice, read_volume};
    #[pymodule_export]
    use crate::command::{main, run, set_helper};
    #[pymodule_export]
    use crate::pictures::PyScene;
    #[pymodule_export]
    use crate::scene::{PyCameras, PyMedium};

    use super::{Bound, PyModule, PyModuleMethods, PyResult};

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        crate::errors::speak();
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
