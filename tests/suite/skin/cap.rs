//! A membrane clamped on a circle and inflated. As a soap film it is a cap of a sphere with an
//! area gain of pi h^2. An elastic membrane never gains less.

use std::f64::consts::PI;

use nalgebra::Point3;
use pliant::constraints::{Distance, EnclosedVolume, Quadratic};
use pliant::mesh::measures::area;
use pliant::mesh::{Topology, TriangleMesh};
use pliant::skin::{BaseShape, Implant, SILICONE};
use pliant::solvers::{DescentSettings, Energy, Newton, NoContact};
use pliant::testing::internals::skin::{springs_of, upper};

/// Rings of the membrane, and radius of the circle [m].
const RINGS: u32 = 20;
const RADIUS: f64 = 0.035;

/// Height of a cap over the circle with this volume [m]: V = pi h (3 a^2 + h^2) / 6.
fn height(volume: f64) -> f64 {
    let of = |h: f64| PI * h * (3.0 * RADIUS * RADIUS + h * h) / 6.0;
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if of(middle) < volume {
            low = middle
        } else {
            high = middle
        }
    }
    low
}

/// Vertices, triangles of the membrane, triangles of membrane and base.
type Closed = (Vec<Point3<f64>>, Vec<[u32; 3]>, Vec<[u32; 3]>);

/// A flat membrane closed by a flat base.
fn flat() -> Closed {
    let implant = Implant {
        shape: BaseShape::Round,
        base: 2.0 * RADIUS,
        volume: 1e-12,
        membrane: SILICONE,
    };
    let dome = implant.dome(RADIUS / f64::from(RINGS)).expect("a dome");
    let inside = upper(RINGS);
    let membrane = dome
        .triangles
        .iter()
        .filter(|t| t.iter().all(|v| *v < inside))
        .copied()
        .collect();
    let vertices = dome
        .vertices
        .iter()
        .map(|p| Point3::new(p.x, p.y, 0.0))
        .collect();
    (vertices, membrane, dome.triangles)
}

/// Equilibrium of springs over the membrane with a volume inside, starting from `x`.
fn inflate(
    x: &mut [Point3<f64>],
    springs: &[Distance],
    stiffness: &[f64],
    volume: f64,
    all: &[[u32; 3]],
) {
    let mut energy = Energy::default();
    energy.elastic.push(Box::new(Quadratic::new(
        springs.to_vec(),
        stiffness.to_vec(),
    )));
    energy.volumes = vec![EnclosedVolume::new(all, x.len(), volume, 0.0)];
    let movable = upper(RINGS - 1) as usize;
    let inverse_mass: Vec<f64> = (0..x.len())
        .map(|v| if v < movable { 1.0 } else { 0.0 })
        .collect();
    let lift = |x: &[Point3<f64>]| -> Vec<nalgebra::Vector3<f64>> {
        let up = |(v, p): (usize, &Point3<f64>)| {
            let share = p.coords.xy().norm_squared() / (RADIUS * RADIUS);
            nalgebra::Vector3::z()
                * if v < movable {
                    (1.0 - share).max(0.0)
                } else {
                    0.0
                }
        };
        x.iter().enumerate().map(up).collect()
    };
    let field = lift(x);
    energy.volumes[0]
        .retract(x, &field)
        .expect("a volume to reach");
    let settings = DescentSettings {
        tolerance: 1e-8,
        iterations: 100,
    };
    let mut newton = Newton::new(energy, x, &inverse_mass, settings).expect("a factor");
    let outcome = newton
        .solve(x, &mut NoContact, |_, _| true)
        .expect("a solution");
    assert!(outcome.converged, "{outcome:?}");
}

/// Half the sum of the cotangents across each edge of the membrane. At the current positions,
/// springs of rest length zero with these stiffnesses have the energy and the forces of a soap film
/// of tension one.
fn cotangents(
    x: &[Point3<f64>],
    mesh: &TriangleMesh,
    topology: &Topology,
) -> (Vec<Distance>, Vec<f64>) {
    let mut stiffness = vec![0.0; topology.edges.len()];
    for (t, edges) in topology.triangle_edges.iter().enumerate() {
        let corners = mesh.triangles[t];
        for e in edges {
            let [a, b] = topology.edges[*e as usize];
            let across = corners
                .into_iter()
                .find(|v| *v != a && *v != b)
                .expect("a corner across");
            let [u, v] = [a, b].map(|end| x[end as usize] - x[across as usize]);
            stiffness[*e as usize] += 0.5 * u.dot(&v) / u.cross(&v).norm();
        }
    }
    (
        topology
            .edges
            .iter()
            .map(|&points| Distance { points, rest: 0.0 })
            .collect(),
        stiffness,
    )
}

#[test]
fn an_inflated_film_gains_what_a_cap_gains() {
    for volume in [20e-6, 50e-6, 80e-6] {
        let (mut x, membrane, all) = flat();
        let mesh = TriangleMesh {
            vertices: x.clone(),
            triangles: membrane,
        };
        let topology = Topology::new(&mesh);
        let before = area(&x, &mesh.triangles);
        let mut last = f64::INFINITY;
        for _ in 0..60 {
            let (springs, stiffness) = cotangents(&x, &mesh, &topology);
            inflate(&mut x, &springs, &stiffness, volume, &all);
            let now = area(&x, &mesh.triangles);
            if (last - now).abs() <= 1e-7 * now {
                break;
            }
            last = now;
        }
        let film = area(&x, &mesh.triangles) - before;
        let expected = PI * height(volume).powi(2);
        assert!(
            (film / expected - 1.0).abs() <= 0.01,
            "{volume}: {film} m2, a cap {expected} m2"
        );
        // The same membrane with elastic springs, at rest when flat.
        let (springs, stiffness) = springs_of(&mesh, &topology, 400.0);
        let mut elastic = mesh.vertices.clone();
        inflate(&mut elastic, &springs, &stiffness, volume, &all);
        let gain = area(&elastic, &mesh.triangles) - before;
        // No surface on this mesh with this volume has less area than the film.
        assert!(
            gain >= film * (1.0 - 1e-4) && gain >= 0.99 * expected,
            "{volume}: {gain} m2, a cap {expected} m2"
        );
        assert!(
            gain <= 1.2 * expected,
            "{volume}: {gain} m2, a cap {expected} m2"
        );
    }
}
