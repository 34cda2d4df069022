//! The native part of the Python package: simulations step by step, arrays, own constraints, and
//! the command line. `pliant/__init__.py` has what users see.

// PyO3 writes the glue to the interpreter.
#![allow(missing_docs)]

mod callables;
mod meshes;
mod simulation;

use std::ffi::OsString;

use pyo3::create_exception;
use pyo3::exceptions::PyException;
use pyo3::prelude::*;

create_exception!(
    pliant,
    PliantError,
    PyException,
    "Input that Pliant cannot use. `code`, `line` and `column` tell where; they are None where there is no place."
);

/// An error with a code and a place.
pub(crate) fn refused(message: String, code: Option<&str>, place: Option<(usize, usize)>) -> PyErr {
    Python::attach(|py| {
        let error = PliantError::new_err(message);
        let value = error.value(py);
        // Setting attributes of a new exception cannot fail.
        let _ = value.setattr("code", code);
        let _ = value.setattr("line", place.map(|p| p.0));
        let _ = value.setattr("column", place.map(|p| p.1));
        error
    })
}

/// Runs the command line `pliant` with these arguments, the first of which is its name, and returns
/// the exit code.
#[pyfunction]
fn command(py: Python<'_>, arguments: Vec<OsString>) -> u8 {
    py.detach(|| pliant_cli::main_with(arguments))
}

#[pymodule]
fn _pliant(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("DIGEST", pliant::DIGEST)?;
    module.add("PliantError", module.py().get_type::<PliantError>())?;
    module.add_class::<simulation::Simulation>()?;
    module.add_class::<callables::Dual>()?;
    module.add_function(wrap_pyfunction!(command, module)?)?;
    module.add_function(wrap_pyfunction!(simulation::load, module)?)?;
    module.add_function(wrap_pyfunction!(meshes::read_mesh, module)?)?;
    module.add_function(wrap_pyfunction!(meshes::mesh_health, module)?)?;
    module.add_function(wrap_pyfunction!(callables::check_constraint, module)?)?;
    module.add_function(wrap_pyfunction!(callables::project, module)?)?;
    module.add_function(wrap_pyfunction!(callables::minimise, module)?)?;
    Ok(())
}
