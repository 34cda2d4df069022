//! A cantilever of hinges compared with the elastica.

use nalgebra::Point3;
use pliant::mesh::{Topology, TriangleMesh};
use pliant::solvers::stiffness;

use super::rest::Body;
use super::{off_order, orders, powers};
use crate::tolerances::{T14, T15, T16};

/// Given stiffness B [N m].
const BENDING: f64 = 1.0;
/// Factor of B for a fold about one direction: the sum over the hinges of B 3|e|^2/A theta^2/2 is 3
/// B k^2/2 per area bent to the curvature k, for any triangles.
const FACTOR: f64 = 3.0;
/// In-plane stiffness [N/m], before the edges are made inextensible.
const MEMBRANE: f64 = 1e4;

/// Greatest residual strain.
const STRAIN: f64 = 1e-7;

/// P L^2/EI, and the displacement of the tip down and back over L, of the literature's digest.
const ELASTICA: [(f64, f64, f64); 6] = [
    (0.1, 0.033_295, 0.000_665),
    (0.5, 0.162_144, 0.015_919),
    (1.0, 0.301_721, 0.056_433),
    (2.0, 0.493_457, 0.160_642),
    (5.0, 0.713_792, 0.387_628),
    (10.0, 0.810_609, 0.554_996),
];

/// Length of a segment [m] of a strip of 1 m.
fn segment(n: usize) -> f64 {
    1.0 / (n as f64 + 0.5)
}

/// Columns of two points at -a/2, a/2, ..., 1 m, with the spacing of their width and all diagonals
/// from one side. The first two columns are fixed, so that the tangent is fixed at 0 and hinges are
/// in the middle of their lengths.
fn strip(n: usize, side: u32) -> TriangleMesh {
    let a = segment(n);
    let at = |i: usize, j: usize| Point3::new((i as f64 - 0.5) * a, a * (j as f64 - 0.5), 0.0);
    let vertices = (0..n + 2)
        .flat_map(|i| (0..2).map(move |j| at(i, j)))
        .collect();
    let quad = |i: u32| {
        let [a, b, c, d] = [2 * i, 2 * i + 2, 2 * i + 3, 2 * i + 1];
        if side == 0 {
            [[a, b, c], [a, c, d]]
        } else {
            [[a, b, d], [b, c, d]]
        }
    };
    TriangleMesh {
        vertices,
        triangles: (0..=n as u32).flat_map(quad).collect(),
    }
}

/// Two strips of half the stiffness on the same points, with diagonals from opposite sides: by
/// symmetry they do not twist, and columns of two points do not bend transversely, unlike a wider
/// strip of hinges. A force pulls the last column down.
fn body(n: usize, force: f64) -> Body {
    let count = 2 * (n + 2);
    let mut body = Body::new((Vec::new(), Vec::new()), count, force);
    for mesh in [0, 1].map(|side| strip(n, side)) {
        let topology = Topology::new(&mesh);
        let (edges, k) = stiffness::edges(&mesh, &topology, MEMBRANE / 2.0);
        let (hinges, b) = stiffness::hinges(&mesh, &topology, BENDING / 2.0);
        body.edges.0.extend(edges);
        body.edges.1.extend(k);
        body.hinges.0.extend(hinges);
        body.hinges.1.extend(b);
    }
    body.held = (0..4).collect();
    body.left = T15 * force;
    body.forces[count - 2..]
        .iter_mut()
        .for_each(|f| f.z = -force / 2.0);
    body
}

/// Displacement of the tip down and back for a strip of `n` segments at rest under `load` in P
/// L^2/EI, EI = `factor` B times width.
fn tip(n: usize, loads: f64, factor: f64) -> (f64, f64) {
    let mut x = strip(n, 0).vertices;
    let force = loads * factor * BENDING * segment(n);
    // Loads grow in steps, so that the strip bends like the elastica and does not fold.
    let steps = (2.0 * loads).ceil() as u32;
    (1..=steps).for_each(|s| body(n, force * f64::from(s) / f64::from(steps)).rest(&mut x));
    let strain = body(n, force).rest_without_stretch(&mut x);
    assert!(strain <= STRAIN, "the strip is stretched by {strain:e}");
    let end = x[x.len() - 1];
    (-end.z, 1.0 - end.x)
}

/// The elastica from its integrals, with the tip angle by bisection: sqrt(P L^2/EI) = int_0^a
/// dt/sqrt(2 (sin a - sin t)). The substitution t = a (1 - u^2) removes the singularity of the
/// root. Gauss's rule would need a table; the midpoint rule converges as 1/n^2, with one Richardson
/// step as 1/n^4.
fn elastica(loads: f64) -> (f64, f64) {
    let integral = |a: f64, f: &dyn Fn(f64) -> f64| {
        let rule = |n: usize| {
            let h = 1.0 / n as f64;
            let term = |i: usize| {
                let u = (i as f64 + 0.5) * h;
                let t = a * (1.0 - u * u);
                2.0 * a * u * f(t) / (2.0 * (a.sin() - t.sin())).sqrt()
            };
            h * (0..n).map(term).sum::<f64>()
        };
        (4.0 * rule(4000) - rule(2000)) / 3.0
    };
    let (mut low, mut high) = (1e-6, std::f64::consts::FRAC_PI_2 - 1e-9);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if integral(middle, &|_| 1.0).powi(2) < loads {
            low = middle
        } else {
            high = middle
        }
    }
    let scale = loads.sqrt();
    (
        integral(low, &|t| t.sin()) / scale,
        1.0 - integral(low, &|t| t.cos()) / scale,
    )
}

#[test]
fn the_elastica_has_its_printed_numbers() {
    for (loads, down, back) in ELASTICA {
        let (y, x) = elastica(loads);
        assert!(
            (y - down).abs() <= 2.0 * T14 && (x - back).abs() <= 2.0 * T14,
            "{loads}: {y} {x}"
        );
    }
}

#[test]
fn a_cantilever_of_hinges_converges_to_the_elastica() {
    for (loads, ..) in ELASTICA {
        let (down, back) = elastica(loads);
        let found = [8, 16, 32].map(|n| tip(n, loads, FACTOR));
        let errors = found.map(|(y, x)| (y - down).hypot(x - back));
        println!(
            "elastica {loads}: exact {down:.6} {back:.6}, 32 segments {:.6} {:.6}, errors {errors}, orders {:.4?}",
            found[2].0,
            found[2].1,
            orders(&errors),
            errors = powers(&errors)
        );
        assert!(off_order(&errors, 2.0) <= T16, "{loads}: {errors:?}");
    }
    // Control: B as the stiffness of the strip, which is three times greater.
    let (down, back) = elastica(1.0);
    let wrong = [8, 16, 32]
        .map(|n| tip(n, 1.0, 1.0))
        .map(|(y, x)| (y - down).hypot(x - back));
    assert!(
        !(off_order(&wrong, 2.0) <= T16),
        "control: another stiffness"
    );
}
