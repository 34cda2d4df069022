//! Fibres: exact shapes, invalid areas, controls of the measures, real muscles.

mod aponeuroses;
mod beside;
mod real;
mod refused;
mod shapes;
mod slices;
mod springs;
mod template;

use nalgebra::{Point3, Vector3};
use pliant::fibres::harmonic::{Decomposition, HarmonicOptions, decompose};
use pliant::fibres::quality::{Quality, measure};
use pliant::fibres::{AreaSource, Attachment};
use pliant::mesh::TriangleMesh;
use pliant::mesh::shapes::{icosphere, tube};

/// Tolerance of fibre ends from their areas: 0.01 mm.
const AT_AREA: f64 = 1e-5;

/// Vertices of the flat ends of a tube along x, before it is bent.
fn ends(mesh: &TriangleMesh, length: f64) -> [Vec<u32>; 2] {
    [-0.5, 0.5].map(|end| {
        let at_end = |v: &Point3<f64>| (v.x - end * length).abs() <= 1e-9 * length;
        (0..mesh.vertices.len())
            .filter(|&v| at_end(&mesh.vertices[v]))
            .map(|v| v as u32)
            .collect()
    })
}

/// A tube of radius 0.02 and length 0.2 [m] moved by `place`, with areas at its ends.
fn made(place: impl Fn(&Point3<f64>) -> Point3<f64>) -> (TriangleMesh, Attachment) {
    let mut mesh = tube(0.02, 0.2, 24);
    let [origin, insertion] = ends(&mesh, 0.2);
    mesh.vertices.iter_mut().for_each(|v| *v = place(v));
    let areas = Attachment::new(
        &mesh,
        AreaSource::Vertices(&origin),
        AreaSource::Vertices(&insertion),
    );
    (mesh, areas.expect("areas"))
}

/// A star-shaped body, a ball of 50 mm with bumps of up to 35 % times `amount`, with areas at both
/// ends.
fn star(amount: f64) -> (TriangleMesh, Attachment) {
    let mut mesh = icosphere(1.0, 4);
    let radius = |d: &Vector3<f64>| {
        0.05 * (1.0 + amount * (0.2 * libm::sin(3.0 * d.x) + 0.15 * libm::cos(4.0 * d.y) * d.z))
    };
    let at = |sign: f64, mesh: &TriangleMesh| -> Vec<u32> {
        let near = |v: &u32| sign * mesh.vertices[*v as usize].x > 0.9;
        (0..mesh.vertices.len() as u32).filter(near).collect()
    };
    let (low, high) = (at(-1.0, &mesh), at(1.0, &mesh));
    mesh.vertices
        .iter_mut()
        .for_each(|p| *p = Point3::from(p.coords * radius(&p.coords)));
    let areas = Attachment::new(
        &mesh,
        AreaSource::Vertices(&low),
        AreaSource::Vertices(&high),
    )
    .expect("areas");
    (mesh, areas)
}

/// A ring of radii 30 and 10 mm in the plane of x and y, with areas at both ends of x.
fn ring_torus() -> (TriangleMesh, Attachment) {
    let (around, across) = (48u32, 16u32);
    let angle = |k: u32, n: u32| std::f64::consts::TAU * f64::from(k) / f64::from(n);
    let point = |i: u32, j: u32| {
        let ((s, c), (t, d)) = (
            libm::sincos(angle(i, around)),
            libm::sincos(angle(j, across)),
        );
        let r = 0.03 + 0.01 * d;
        Point3::new(r * c, r * s, 0.01 * t)
    };
    let vertices: Vec<_> = (0..around)
        .flat_map(|i| (0..across).map(move |j| point(i, j)))
        .collect();
    let at = |i: u32, j: u32| (i % around) * across + j % across;
    let square = |(i, j): (u32, u32)| {
        let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        [[a, b, c], [a, c, d]]
    };
    let triangles = (0..around)
        .flat_map(|i| (0..across).map(move |j| (i, j)))
        .flat_map(square)
        .collect();
    let mesh = TriangleMesh {
        vertices,
        triangles,
    };
    let pick = |sign: f64| -> Vec<u32> {
        (0..mesh.vertices.len() as u32)
            .filter(|&v| sign * mesh.vertices[v as usize].x > 0.035)
            .collect()
    };
    let areas = Attachment::new(
        &mesh,
        AreaSource::Vertices(&pick(-1.0)),
        AreaSource::Vertices(&pick(1.0)),
    );
    (mesh.clone(), areas.expect("areas"))
}

fn measured(mesh: &TriangleMesh, areas: &Attachment) -> (Decomposition, Quality) {
    let made = decompose(mesh, areas, HarmonicOptions::default()).expect("fibres");
    let jacobian = made.jacobian(mesh, areas);
    let quality = measure(mesh, &made.closed, areas, &made.fibres, jacobian);
    (made, quality)
}

/// Properties of every muscle.
fn assert_good(name: &str, q: &Quality) {
    assert_eq!((q.fibres, q.points), (100, 1500), "{name}");
    assert_eq!(q.outside, 0, "{name}: {q:?}");
    assert!(q.end_distance_max_m <= AT_AREA, "{name}: {q:?}");
    assert!(q.jacobian_min > 0.0, "{name}: {q:?}");
    assert!(q.spacing_min_m > 0.0, "{name}: {q:?}");
}
