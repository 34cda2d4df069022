//! Arrays to meshes and back.

use std::path::PathBuf;

use nalgebra::{Point3, Vector3};
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray2, PyReadonlyArray2, PyUntypedArrayMethods};
use pliant::{Topology, TriangleMesh};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::refused;

/// Points as an array of shape (n, 3).
pub(crate) fn array<'py>(py: Python<'py>, points: &[Point3<f64>]) -> Bound<'py, PyArray2<f64>> {
    let flat: Vec<f64> = points.iter().flat_map(|p| [p.x, p.y, p.z]).collect();
    shaped(flat, points.len()).into_pyarray(py)
}

/// Vectors as an array of shape (n, 3).
pub(crate) fn vectors<'py>(py: Python<'py>, all: &[Vector3<f64>]) -> Bound<'py, PyArray2<f64>> {
    let flat: Vec<f64> = all.iter().flat_map(|p| [p.x, p.y, p.z]).collect();
    shaped(flat, all.len()).into_pyarray(py)
}

fn shaped<T: Clone + Default>(flat: Vec<T>, rows: usize) -> Array2<T> {
    // The number of values is three times that of rows by construction.
    Array2::from_shape_vec((rows, 3), flat).unwrap_or_default()
}

/// Triangles as an array of shape (m, 3).
pub(crate) fn corners<'py>(py: Python<'py>, triangles: &[[u32; 3]]) -> Bound<'py, PyArray2<u32>> {
    let flat: Vec<u32> = triangles.iter().flatten().copied().collect();
    shaped(flat, triangles.len()).into_pyarray(py)
}

/// The points of an array of shape (n, 3); read in place.
pub(crate) fn points(given: &PyReadonlyArray2<'_, f64>) -> PyResult<Vec<Point3<f64>>> {
    if given.shape().get(1) != Some(&3) {
        let shape = given.shape();
        return Err(refused(
            format!("positions have the shape {shape:?} instead of (n, 3)"),
            None,
            None,
        ));
    }
    let array = given.as_array();
    let rows = array
        .rows()
        .into_iter()
        .map(|row| Point3::new(row[0], row[1], row[2]));
    let all: Vec<Point3<f64>> = rows.collect();
    match all.iter().position(|p| !p.iter().all(|c| c.is_finite())) {
        Some(row) => Err(refused(
            format!("row {row} of the positions is not finite"),
            None,
            None,
        )),
        None => Ok(all),
    }
}

/// A mesh of arrays of shape (n, 3) and (m, 3).
fn mesh(
    positions: &PyReadonlyArray2<'_, f64>,
    triangles: &PyReadonlyArray2<'_, u32>,
) -> PyResult<TriangleMesh> {
    let vertices = points(positions)?;
    if triangles.shape().get(1) != Some(&3) {
        let shape = triangles.shape();
        return Err(refused(
            format!("triangles have the shape {shape:?} instead of (m, 3)"),
            None,
            None,
        ));
    }
    let rows = triangles.as_array();
    let triangles: Vec<[u32; 3]> = rows
        .rows()
        .into_iter()
        .map(|r| [r[0], r[1], r[2]])
        .collect();
    let wrong = triangles
        .iter()
        .position(|t| t.iter().any(|v| *v as usize >= vertices.len()));
    match wrong {
        Some(row) => Err(refused(
            format!(
                "row {row} of the triangles names a vertex beyond the {} that there are",
                vertices.len()
            ),
            Some("E020"),
            None,
        )),
        None => Ok(TriangleMesh {
            vertices,
            triangles,
        }),
    }
}

/// Reads a mesh file: vertices (n, 3) in the unit of the file, and triangles (m, 3).
#[pyfunction]
#[allow(clippy::type_complexity)] // The types of arrays are those of numpy.
pub(crate) fn read_mesh(
    py: Python<'_>,
    path: PathBuf,
) -> PyResult<(Bound<'_, PyArray2<f64>>, Bound<'_, PyArray2<u32>>)> {
    let file = py.detach(|| pliant::io::read(&path)).map_err(|error| {
        let place = match &error {
            pliant::ReadError::Content {
                place: pliant::io::FilePlace::Line(line),
                column,
                ..
            } => Some((*line, column.map_or(0, |c| c as usize))),
            _ => None,
        };
        refused(error.terse(), Some(error.code()), place)
    })?;
    Ok((
        array(py, &file.mesh.vertices),
        corners(py, &file.mesh.triangles),
    ))
}

/// Measures of a surface.
#[pyfunction]
pub(crate) fn mesh_health<'py>(
    py: Python<'py>,
    positions: PyReadonlyArray2<'py, f64>,
    triangles: PyReadonlyArray2<'py, u32>,
) -> PyResult<Bound<'py, PyDict>> {
    let mesh = mesh(&positions, &triangles)?;
    let (topology, area, volume) = py.detach(|| (Topology::new(&mesh), mesh.area(), mesh.volume()));
    let report = PyDict::new(py);
    report.set_item("vertices", mesh.vertices.len())?;
    report.set_item("triangles", mesh.triangles.len())?;
    report.set_item("closed", topology.is_closed())?;
    report.set_item("area", area)?;
    report.set_item("volume", volume)?;
    Ok(report)
}
