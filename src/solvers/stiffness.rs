//! Stiffness of edges and hinges from material constants.

use nalgebra::Point3;

use crate::constraints::bending::{self, Bending};
use crate::constraints::distance::Distance;
use crate::mesh::TriangleMesh;
use crate::mesh::topology::Topology;

/// Edges of a mesh at rest with their stiffness [N/m]: k = E sum A / l^2 over the triangles of the
/// edge \[vangelder1998\], where E is the in-plane stiffness [N/m]. Exact for plane stress with
/// Poisson's ratio 1/3 under dilation; in shear a network is not exactly a membrane (erratum B02).
pub fn edges(mesh: &TriangleMesh, topology: &Topology, membrane: f64) -> (Vec<Distance>, Vec<f64>) {
    let areas = crate::mesh::measures::triangle_areas(&mesh.vertices, &mesh.triangles);
    let lengths = topology.edge_lengths(mesh);
    let distances = topology
        .edges
        .iter()
        .zip(&lengths)
        .map(|(&points, &rest)| Distance { points, rest })
        .collect();
    let stiffness = (0..topology.edges.len())
        .map(|e| {
            let area: f64 = topology
                .triangles_of_edge(e)
                .iter()
                .map(|&t| areas[t as usize])
                .sum();
            membrane * area / (lengths[e] * lengths[e])
        })
        .collect();
    (distances, stiffness)
}

/// Hinges of a mesh at rest with their stiffness [N m]: energy B 3|e|^2/A (theta - theta0)^2 / 2,
/// where A is the sum of both areas and B the bending stiffness [N m] \[grinspun2003\]. The weight
/// makes the energy independent of the mesh. A plate of equilateral triangles has the flexural
/// rigidity 3 B and Poisson's ratio -1/3 (`docs/verification.md`).
pub fn hinges(mesh: &TriangleMesh, topology: &Topology, bending: f64) -> (Vec<Bending>, Vec<f64>) {
    let at = |p: u32| mesh.vertices[p as usize];
    topology
        .hinges
        .iter()
        .map(|&points| {
            let x = points.map(at);
            let area = |c: Point3<f64>| (x[1] - x[0]).cross(&(c - x[0])).norm() / 2.0;
            let both = area(x[2]) + area(x[3]);
            let weight = 3.0 * (x[1] - x[0]).norm_squared() / both;
            (
                Bending::new(points, bending::dihedral(&x)),
                bending * weight,
            )
        })
        // A hinge without area has no angle; every sweep would skip it.
        .filter(|(hinge, stiffness)| hinge.rest.is_finite() && stiffness.is_finite())
        .unzip()
}

/// Stiffness of a bond of two surfaces for each area [N/m^3]: k = E1 E2 / ((E1 + E2) l^2) with their
/// in-plane stiffnesses E1 and E2 [N/m]. A shear between the surfaces then decays over the length
/// `l` \[m\] along them: sqrt(E1 E2 / ((E1 + E2) k)) = l for two long strips.
pub fn bond([one, other]: [f64; 2], length: f64) -> f64 {
    one * other / ((one + other).max(f64::MIN_POSITIVE) * length * length)
}

/// Compliance [m/N] or [1/(N m)] of a stiffness.
pub fn compliance(stiffness: &[f64]) -> Vec<f64> {
    stiffness.iter().map(|k| 1.0 / k).collect()
}
