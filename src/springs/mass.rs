//! Masses of points from the geometry of a body.

use nalgebra::Point3;

use crate::mesh::TriangleMesh;
use crate::mesh::measures::triangle_areas;
use crate::mesh::sum::{tree_sum, tree_sum_by};

/// Error of a distribution of masses.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum MassError {
    /// The body has no area or no volume.
    #[error("the body has no {measure}, {value}: no masses follow from it")]
    Nothing {
        /// Name of the measure.
        measure: &'static str,
        /// Value of the measure [m2 or m3].
        value: f64,
    },
    /// Signed volumes give points a mass that is not positive.
    #[error("{points} points get no positive mass, the least {least} kg; take masses by area")]
    NotPositive {
        /// Number of such points.
        points: usize,
        /// The least mass [kg].
        least: f64,
    },
    /// A tetrahedron refers to a point that does not exist.
    #[error("tetrahedron {tetrahedron} names point {point}, but there are {count} points")]
    OutOfRange {
        /// Index of the tetrahedron.
        tetrahedron: usize,
        /// Index of the point.
        point: u32,
        /// Number of points.
        count: usize,
    },
}

/// `m_i = M sum a_t/(3 A)` over the triangles of a point: each triangle gives a third of its area
/// to each corner. The masses are positive on a mesh without unused vertices; their sum is `total`
/// [kg].
///
/// # Errors
/// A mesh without area, or a vertex without area.
pub fn by_area(mesh: &TriangleMesh, total: f64) -> Result<Vec<f64>, MassError> {
    let areas = mesh.vertex_areas();
    let area = tree_sum(&triangle_areas(&mesh.vertices, &mesh.triangles));
    if !(area > 0.0) {
        return Err(MassError::Nothing {
            measure: "area",
            value: area,
        });
    }
    positive(areas.into_iter().map(|a| total * a / area).collect())
}

/// Masses [kg] of a sheet of `density` [kg/m3] and `thickness` [m]: [`by_area`] with the total mass
/// (errata M17).
///
/// # Errors
/// Those of [`by_area`].
pub fn of_sheet(mesh: &TriangleMesh, density: f64, thickness: f64) -> Result<Vec<f64>, MassError> {
    by_area(mesh, density * thickness * mesh.area())
}

/// `m_i = M sum v_t/(3 V)` over the fan of tetrahedra from `centre`, which is no point of the
/// system, to the triangles of a closed surface: each gives a third of its signed volume to each
/// corner (errata B01).
///
/// # Errors
/// A surface without volume, or a mass that is not positive, as for surfaces that are not
/// star-shaped about the centre.
pub fn by_fan(mesh: &TriangleMesh, centre: Point3<f64>, total: f64) -> Result<Vec<f64>, MassError> {
    let six = |t: usize| {
        let [a, b, c] = mesh.corners(t).map(|p| p - centre);
        a.dot(&b.cross(&c))
    };
    let volume = tree_sum_by(mesh.triangles.len(), six) / 6.0;
    if !(volume > 0.0) {
        return Err(MassError::Nothing {
            measure: "volume",
            value: volume,
        });
    }
    let mut masses = vec![0.0; mesh.vertices.len()];
    for (t, corners) in mesh.triangles.iter().enumerate() {
        let share = total * six(t) / (18.0 * volume);
        corners.iter().for_each(|&v| masses[v as usize] += share);
    }
    positive(masses)
}

/// `m_i = M sum v_t/(4 V)` over the tetrahedra of a point, in any orientation: each gives a quarter
/// to each corner (errata B01).
///
/// # Errors
/// A point out of range, tetrahedra without volume, or a point without volume.
pub fn by_tetrahedra(
    x: &[Point3<f64>],
    tetrahedra: &[[u32; 4]],
    total: f64,
) -> Result<Vec<f64>, MassError> {
    let count = x.len();
    for (tetrahedron, corners) in tetrahedra.iter().enumerate() {
        if let Some(&point) = corners.iter().find(|&&p| p as usize >= count) {
            return Err(MassError::OutOfRange {
                tetrahedron,
                point,
                count,
            });
        }
    }
    let size = |t: usize| {
        let [a, b, c, d] = tetrahedra[t].map(|p| x[p as usize]);
        ((b - a).dot(&(c - a).cross(&(d - a))) / 6.0).abs()
    };
    let volume = tree_sum_by(tetrahedra.len(), size);
    if !(volume > 0.0) {
        return Err(MassError::Nothing {
            measure: "volume",
            value: volume,
        });
    }
    let mut masses = vec![0.0; count];
    for (t, corners) in tetrahedra.iter().enumerate() {
        let share = total * size(t) / (4.0 * volume);
        corners.iter().for_each(|&p| masses[p as usize] += share);
    }
    positive(masses)
}

fn positive(masses: Vec<f64>) -> Result<Vec<f64>, MassError> {
    let points = masses.iter().filter(|m| !(**m > 0.0)).count();
    if points == 0 {
        return Ok(masses);
    }
    let least = masses.iter().copied().fold(f64::INFINITY, f64::min);
    Err(MassError::NotPositive { points, least })
}
