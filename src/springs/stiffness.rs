//! Stiffness of springs along the edges of a triangle mesh from material constants.

use super::hooke::{Hooke, Springs};
use super::spring_set::PairError;
use crate::mesh::TriangleMesh;
use crate::mesh::measures::triangle_areas;
use crate::mesh::topology::Topology;

/// Treatment of negative stiffness, which the formula gives opposite angles that are far from
/// acute.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Negative {
    /// Negative values become 0.
    #[default]
    Clamp,
    /// Negative values stay: the sum over the mesh is right, but a mode can have no stiffness.
    Keep,
}

/// Stiffness of the edges of a mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct EdgeStiffness {
    /// Stiffness of each edge of the topology [N/m].
    pub stiffness: Vec<f64>,
    /// Edges with negative stiffness, and the value [N/m].
    pub negative: Vec<(u32, f64)>,
}

/// The stiffness of the side of length c in a triangle with sides a, b, c and area A
/// \[vangelder1998\], corrected (errata B02):
/// `E2/(1 + nu) A/c^2 + E2 nu/(1 - nu^2) (a^2 + b^2 - c^2)/(8 A)` [N/m], where `E2` [N/m] is
/// Young's modulus times thickness, and nu Poisson's ratio.
///
/// The energy of a uniform strain is that of plane stress for the equilateral triangle at nu = 1/3.
/// For dilation of any triangle it is `(3 - nu)/(2 (1 + nu))` times that. Not finite for a triangle
/// without area.
pub fn of_side([a, b, c]: [f64; 3], area: f64, e2: f64, nu: f64) -> f64 {
    e2 / (1.0 + nu) * area / (c * c)
        + e2 * nu / (1.0 - nu * nu) * (a * a + b * b - c * c) / (8.0 * area)
}

/// The sum of [`of_side`] over the triangles of each edge; triangles without area are left out.
pub fn membrane(
    mesh: &TriangleMesh,
    topology: &Topology,
    e2: f64,
    nu: f64,
    negative: Negative,
) -> EdgeStiffness {
    let areas = triangle_areas(&mesh.vertices, &mesh.triangles);
    let lengths = topology.edge_lengths(mesh);
    let mut stiffness = vec![0.0; topology.edges.len()];
    for (edges, area) in topology
        .triangle_edges
        .iter()
        .zip(&areas)
        .filter(|(_, area)| **area > 0.0)
    {
        let sides = edges.map(|e| lengths[e as usize]);
        for k in 0..3 {
            let turned = [sides[(k + 1) % 3], sides[(k + 2) % 3], sides[k]];
            stiffness[edges[k] as usize] += of_side(turned, *area, e2, nu);
        }
    }
    let below = |(e, k): (usize, &f64)| (*k < 0.0).then_some((e as u32, *k));
    let found: Vec<(u32, f64)> = stiffness.iter().enumerate().filter_map(below).collect();
    if negative == Negative::Clamp {
        found.iter().for_each(|&(e, _)| stiffness[e as usize] = 0.0);
    }
    EdgeStiffness {
        stiffness,
        negative: found,
    }
}

/// `E2 sum A/L^2` over the triangles of each edge [N/m] (errata M17): never negative, and
/// independent of Poisson's ratio.
pub fn area_over_length(mesh: &TriangleMesh, topology: &Topology, e2: f64) -> Vec<f64> {
    let areas = triangle_areas(&mesh.vertices, &mesh.triangles);
    let lengths = topology.edge_lengths(mesh);
    let mut stiffness = vec![0.0; lengths.len()];
    for (edges, area) in topology.triangle_edges.iter().zip(&areas) {
        for &e in edges {
            let length = lengths[e as usize];
            if length > 0.0 {
                stiffness[e as usize] += e2 * area / (length * length);
            }
        }
    }
    stiffness
}

/// Springs along the edges of a mesh at rest, each with its own stiffness [N/m].
///
/// # Errors
/// A stiffness that is not finite.
pub fn along_edges(
    mesh: &TriangleMesh,
    topology: &Topology,
    stiffness: &[f64],
) -> Result<Springs, PairError> {
    let rest = topology.edge_lengths(mesh);
    let laws = rest
        .into_iter()
        .zip(stiffness)
        .map(|(rest, &stiffness)| Hooke { rest, stiffness });
    Springs::new(
        mesh.vertices.len(),
        topology.edges.iter().copied().zip(laws),
    )
}
