//! Fibres: exact shapes, wrong areas, controls of what is measured, real muscles.

mod real;
mod refused;
mod shapes;

use nalgebra::Point3;
use pliant::fibres::attachment::{AreaSource, Attachment};
use pliant::fibres::harmonic::{Decomposition, Options, decompose};
use pliant::fibres::quality::{Quality, measure};
use pliant::mesh::TriangleMesh;
use pliant::mesh::shapes::tube;

/// Ends within 0.01 mm of their areas.
const AT_AREA: f64 = 1e-5;

/// Vertices of the flat ends of a tube along x, before it is bent.
fn ends(mesh: &TriangleMesh, length: f64) -> [Vec<u32>; 2] {
    [-0.5, 0.5].map(|end| {
        let at_end = |v: &Point3<f64>| (v.x - end * length).abs() <= 1e-9 * length;
        (0..mesh.vertices.len()).filter(|&v| at_end(&mesh.vertices[v])).map(|v| v as u32).collect()
    })
}

/// A tube of radius 0.02 and length 0.2 [m] moved by `place`, with areas at its ends.
fn made(place: impl Fn(&Point3<f64>) -> Point3<f64>) -> (TriangleMesh, Attachment) {
    let mut mesh = tube(0.02, 0.2, 24);
    let [origin, insertion] = ends(&mesh, 0.2);
    mesh.vertices.iter_mut().for_each(|v| *v = place(v));
    let areas = Attachment::new(&mesh, AreaSource::Vertices(&origin), AreaSource::Vertices(&insertion));
    (mesh, areas.expect("areas"))
}

fn measured(mesh: &TriangleMesh, areas: &Attachment) -> (Decomposition, Quality) {
    let made = decompose(mesh, areas, Options::default()).expect("fibres");
    let jacobian = made.jacobian(mesh, areas);
    let quality = measure(mesh, &made.closed, areas, &made.fibres, jacobian);
    (made, quality)
}

/// What holds for every muscle.
fn assert_good(name: &str, q: &Quality) {
    assert_eq!((q.fibres, q.points), (100, 1500), "{name}");
    assert_eq!(q.outside, 0, "{name}: {q:?}");
    assert!(q.end_distance_max_m <= AT_AREA, "{name}: {q:?}");
    assert!(q.jacobian_min > 0.0, "{name}: {q:?}");
    assert!(q.spacing_min_m > 0.0, "{name}: {q:?}");
}
