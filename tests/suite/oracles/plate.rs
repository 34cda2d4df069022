//! Flexural rigidity and Poisson's ratio of a lattice of hinges, as a plate.

use nalgebra::Point3;
use pliant::constraints::Constraint;
use pliant::mesh::{Topology, TriangleMesh};
use pliant::solvers::stiffness;

use super::{off_order, orders, powers};
use crate::tolerances::{T4, worst};

/// Given stiffness B [N m].
const BENDING: f64 = 1.0;

/// An equilateral triangle with edges of 1 m and its three neighbours, on the surface z = (k1 x^2 +
/// k2 y^2)/2 rotated by `turn` [rad].
fn patch(curvature: [f64; 2], turn: f64) -> TriangleMesh {
    let (inner, outer) = (1.0 / 3f64.sqrt(), 2.0 / 3f64.sqrt());
    let corner = |i: u32, r: f64, from: f64| {
        let angle = from + std::f64::consts::TAU * f64::from(i) / 3.0 + turn;
        let (x, y) = (r * angle.cos(), r * angle.sin());
        Point3::new(x, y, 0.5 * (curvature[0] * x * x + curvature[1] * y * y))
    };
    let opposite = std::f64::consts::FRAC_PI_3;
    let vertices = (0..3)
        .map(|i| corner(i, inner, 0.0))
        .chain((0..3).map(|i| corner(i, outer, opposite)))
        .collect();
    // Vertex 3 is across the edge from 0 to 1, and so on.
    TriangleMesh {
        vertices,
        triangles: vec![[0, 1, 2], [1, 0, 3], [2, 1, 4], [0, 2, 5]],
    }
}

/// Energy per area [J/m^2] of an initially flat lattice: its hinges have three directions, with one
/// hinge of each per two triangles.
fn energy(curvature: [f64; 2], turn: f64) -> f64 {
    let flat = patch([0.0; 2], turn);
    let (hinges, k) = stiffness::hinges(&flat, &Topology::new(&flat), BENDING);
    assert_eq!(hinges.len(), 3);
    let x = patch(curvature, turn).vertices;
    let of = |hinge: &pliant::constraints::Bending| {
        hinge.value(&hinge.points.map(|p| x[p as usize])).powi(2)
    };
    hinges
        .iter()
        .zip(&k)
        .map(|(hinge, k)| 0.5 * k * of(hinge))
        .sum::<f64>()
        / (2.0 * flat.area() / 4.0)
}

/// D/2 ((k1 + k2)^2 - 2 (1 - nu) k1 k2), for a plate of flexural rigidity `d` and Poisson's ratio
/// `nu`.
fn plate([a, b]: [f64; 2], d: f64, nu: f64) -> f64 {
    0.5 * d * ((a + b).powi(2) - 2.0 * (1.0 - nu) * a * b)
}

#[test]
fn a_lattice_of_hinges_is_a_plate_of_three_times_its_stiffness() {
    let errors = |d: f64, nu: f64| {
        [0.2, 0.1, 0.05, 0.025].map(|k: f64| {
            let shapes = [[k, 0.0], [0.0, k], [k, k], [k, -k], [k, 0.3 * k]];
            let turned = shapes
                .into_iter()
                .flat_map(|c| [0.0, 0.4, 1.0].map(|turn| (c, turn)));
            worst(turned.map(|(c, turn)| (energy(c, turn) / plate(c, d, nu) - 1.0).abs()))
        })
    };
    let found = errors(3.0 * BENDING, -1.0 / 3.0);
    println!(
        "plate: D = 3 B, nu = -1/3: errors {}, orders in curvature times edge {:.4?}; cylinder, sphere and saddle have \
         {:.4?} times the energy of D = B, nu = 0",
        powers(&found),
        orders(&found),
        [[1.0, 0.0], [1.0, 1.0], [1.0, -1.0]]
            .map(|c| energy(c.map(|k| 1e-3 * k), 0.0) / plate(c, 1e-6 * BENDING, 0.0))
    );
    assert!(off_order(&found, 2.0) <= T4);
    assert!(
        !(off_order(&errors(BENDING, -1.0 / 3.0), 2.0) <= T4),
        "control: B taken for the flexural rigidity"
    );
    assert!(
        !(off_order(&errors(3.0 * BENDING, 1.0 / 3.0), 2.0) <= T4),
        "control: a Poisson's ratio of 1/3"
    );
}
