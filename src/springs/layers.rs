//! Two layers of a surface patch with springs in between: skin over a body.

use nalgebra::{Point3, Vector3};

use super::hooke::Hooke;
use super::stiffness::{EdgeStiffness, Negative, membrane};
use crate::mesh::TriangleMesh;
use crate::mesh::topology::Topology;

/// Material of the layers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LayerMaterial {
    /// Young's modulus times the total thickness of both layers, E2 [N/m].
    pub e2: f64,
    /// Poisson's ratio.
    pub nu: f64,
    /// Stiffness of each of the two crossing springs per edge between the layers, relative to that
    /// of the edge in one layer.
    pub diagonal: f64,
    /// Stiffness of the spring between a point and its copy [N/m]; 0 for none.
    pub upright: f64,
    /// Treatment of negative stiffness.
    pub negative: Negative,
}

/// A patch in two layers: point i of the patch is i in the first and `count + i` in the second.
#[derive(Clone, Debug)]
pub struct DoubleLayer {
    /// Positions [m], the first layer first.
    pub position: Vec<Point3<f64>>,
    /// Springs in and between the layers.
    pub springs: Vec<([u32; 2], Hooke)>,
    /// Boundary points of the patch in both layers, which the caller should fix.
    pub rim: Vec<u32>,
    /// Number of points in one layer.
    pub count: usize,
    /// Stiffness of the edges of one layer, with the negative values.
    pub edges: EdgeStiffness,
}

/// Doubles a patch; the second layer lies at `offset` [m] from the first.
///
/// Each layer has half of the thickness. Each edge with an inner point gets a spring in each layer
/// and two crossing springs between the layers, which resist shear and keep the layers apart: four
/// springs per edge (errata B11).
pub fn layers(
    patch: &TriangleMesh,
    topology: &Topology,
    offset: Vector3<f64>,
    material: LayerMaterial,
) -> DoubleLayer {
    let count = patch.vertices.len();
    let edges = membrane(
        patch,
        topology,
        0.5 * material.e2,
        material.nu,
        material.negative,
    );
    let mut on_rim = vec![false; count];
    for e in topology.boundary_edges() {
        topology.edges[e as usize]
            .iter()
            .for_each(|&v| on_rim[v as usize] = true);
    }
    let second = patch.vertices.iter().map(|p| p + offset);
    let position: Vec<Point3<f64>> = patch.vertices.iter().copied().chain(second).collect();
    let below = count as u32;
    let mut springs = Vec::new();
    let mut join = |ends: [u32; 2], stiffness: f64| {
        let rest = (position[ends[0] as usize] - position[ends[1] as usize]).norm();
        springs.push((ends, Hooke { rest, stiffness }));
    };
    for (&[a, b], &stiffness) in topology.edges.iter().zip(&edges.stiffness) {
        if on_rim[a as usize] && on_rim[b as usize] {
            continue;
        }
        join([a, b], stiffness);
        join([a + below, b + below], stiffness);
        join([a, b + below], stiffness * material.diagonal);
        join([b, a + below], stiffness * material.diagonal);
    }
    if material.upright > 0.0 {
        let used = (0..below).filter(|&v| {
            !on_rim[v as usize] && !topology.triangles_of_vertex(v as usize).is_empty()
        });
        used.for_each(|v| join([v, v + below], material.upright));
    }
    let rim = (0..below).filter(|&v| on_rim[v as usize]);
    let rim = rim.clone().chain(rim.map(|v| v + below)).collect();
    DoubleLayer {
        position,
        springs,
        rim,
        count,
        edges,
    }
}
