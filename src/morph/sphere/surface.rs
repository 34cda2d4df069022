//! Topological sphere test for a surface, and orientation of triangles on the unit sphere.

use nalgebra::Point3;
use robust::{Coord3D, orient3d};

use super::SphereError;
use crate::mesh::{Topology, TriangleMesh};

/// Sign of det(a, b, c), exactly: positive where the triangle is seen counter-clockwise from outside.
#[inline]
pub fn turn(a: &Point3<f64>, b: &Point3<f64>, c: &Point3<f64>) -> f64 {
    let at = |p: &Point3<f64>| Coord3D {
        x: p.x,
        y: p.y,
        z: p.z,
    };
    orient3d(
        at(a),
        at(b),
        at(c),
        Coord3D {
            x: 0.0,
            y: 0.0,
            z: 0.0,
        },
    )
}

/// The triangles that are not oriented outward, seen from the origin; exact for the stored numbers.
pub fn flipped(points: &[Point3<f64>], triangles: &[[u32; 3]]) -> Vec<u32> {
    let bad = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| &points[v as usize]);
        !(turn(a, b, c) > 0.0)
    };
    (0..triangles.len() as u32)
        .filter(|&t| bad(&triangles[t as usize]))
        .collect()
}

/// Total solid angle of all triangles, seen from the origin \[sr\] \[vanoosterom1983\].
pub fn solid_angle(points: &[Point3<f64>], triangles: &[[u32; 3]]) -> f64 {
    crate::mesh::sum::tree_sum_by(triangles.len(), |t| {
        let [a, b, c] = triangles[t].map(|v| points[v as usize].coords);
        let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
        let below = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
        2.0 * libm::atan2(a.dot(&b.cross(&c)), below)
    })
}

/// Checks that a mesh is one closed, manifold, oriented surface without handles.
///
/// The orientation is not tested: a surface that is inside out is mapped in its orientation.
///
/// # Errors
/// The first defect, with its place.
pub fn check(mesh: &TriangleMesh) -> Result<Topology, SphereError> {
    TriangleMesh::new(mesh.vertices.clone(), mesh.triangles.clone())?;
    let (vertices, triangles) = (mesh.vertices.len(), mesh.triangles.len());
    if vertices < 4 || triangles < 4 {
        return Err(SphereError::TooFew {
            vertices,
            triangles,
        });
    }
    let topology = Topology::new(mesh);
    check_edges(&topology)?;
    let components = topology.components();
    let is_unused = |v: &usize| topology.triangles_of_vertex(*v).is_empty();
    if let Some(vertex) = (0..vertices).find(is_unused) {
        return Err(SphereError::Unused {
            vertex: vertex as u32,
            count: (0..vertices).filter(is_unused).count(),
        });
    }
    if let Some(vertex) = components.labels.iter().position(|&l| l != 0) {
        return Err(SphereError::Pieces {
            pieces: components.count,
            vertex: vertex as u32,
        });
    }
    if let Some(&vertex) = topology.non_manifold_vertices(mesh).first() {
        return Err(SphereError::Vertex { vertex });
    }
    let euler = topology.euler_characteristic();
    if euler != 2 {
        return Err(SphereError::Genus {
            genus: (2 - euler) / 2,
            euler,
        });
    }
    Ok(topology)
}

/// Checks that a mesh is closed, manifold and oriented; it may have handles and pieces.
///
/// # Errors
/// The first defect, with its place.
pub fn check_closed(mesh: &TriangleMesh) -> Result<(), SphereError> {
    TriangleMesh::new(mesh.vertices.clone(), mesh.triangles.clone())?;
    check_edges(&Topology::new(mesh))
}

fn check_edges(topology: &Topology) -> Result<(), SphereError> {
    let edge = |e: u32| topology.edges[e as usize];
    if let Some(&e) = topology.non_manifold_edges().first() {
        return Err(SphereError::Edge {
            edge: edge(e),
            triangles: topology.triangles_of_edge(e as usize).len(),
        });
    }
    let rim = topology.boundary_edges();
    if let Some(&first) = rim.first() {
        return Err(SphereError::Open {
            edges: rim.len(),
            first: edge(first),
        });
    }
    match topology.inconsistent_edges().first() {
        None => Ok(()),
        Some(&e) => {
            let found = topology.triangles_of_edge(e as usize);
            Err(SphereError::Turned {
                edge: edge(e),
                triangles: [found[0], found[1]],
            })
        }
    }
}
