//! Spring networks against membranes: a lattice under tension, a balloon.

use nalgebra::{Matrix2, Point3, Vector3};
use pliant::Particles;
use pliant::constraints::{Batch, Distance, EnclosedVolume, SweepOrder};
use pliant::mesh::shapes::icosphere;
use pliant::mesh::{Topology, TriangleMesh};
use pliant::solvers::{System, stiffness};

use super::rest::Body;
use super::{off_order, orders, powers};
use crate::bodies::settings;
use crate::tolerances::{T14, T16, T17, worst};

/// In-plane stiffness of the networks [N/m].
const MEMBRANE: f64 = 1.0;

/// Anchor stiffness [N/m] against drift: a millionth of the membrane's.
const ANCHOR: f64 = 1e-6 * MEMBRANE;

/// Greatest relative difference between a network's pressure, extrapolated in resolution, and that
/// of a uniform dilation: a sixth of its difference to the neo-Hookean balloon at the smallest
/// stretch.
const MODEL: f64 = 0.01;

/// Equilateral triangles with edges of 1 m, `n` along x and y.
fn lattice(n: u32) -> TriangleMesh {
    let high = 0.75_f64.sqrt();
    let at = |i: u32, j: u32| {
        Point3::new(
            f64::from(i) + 0.5 * f64::from(j % 2),
            high * f64::from(j),
            0.0,
        )
    };
    let vertices = (0..=n)
        .flat_map(|j| (0..=n).map(move |i| at(i, j)))
        .collect();
    let mut triangles = Vec::new();
    for (i, j) in (0..n).flat_map(|j| (0..n).map(move |i| (i, j))) {
        let v = |a: u32, b: u32| (j + b) * (n + 1) + i + a;
        let [a, b, c, d] = [v(0, 0), v(1, 0), v(1, 1), v(0, 1)];
        triangles.extend(if j % 2 == 0 {
            [[a, b, d], [b, c, d]]
        } else {
            [[a, b, c], [a, c, d]]
        });
    }
    TriangleMesh {
        vertices,
        triangles,
    }
}

/// A network at rest with a mass of 1 kg at each vertex, with coloured sweeps.
fn network(mesh: &TriangleMesh, iterations: u32) -> System {
    let (all, k) = stiffness::edges(mesh, &Topology::new(mesh), MEMBRANE);
    let count = mesh.vertices.len();
    let mut system = System::new(
        Particles::at_rest(mesh.vertices.clone(), vec![1.0; count]),
        settings(iterations),
    );
    let batch = Batch::<Distance, 2>::new(
        all,
        stiffness::compliance(&k),
        SweepOrder::Coloured,
        count,
        &[],
    );
    system.elastic.push(Box::new(batch));
    system
}

/// Boundary forces of the nominal tension (x, y) [N/m]: half of each edge's force at each of its
/// ends.
fn pulls(mesh: &TriangleMesh, tension: [f64; 2]) -> Vec<(u32, Vector3<f64>)> {
    let topology = Topology::new(mesh);
    let mut forces = Vec::new();
    for e in topology.boundary_edges() {
        let [a, b] = topology.edges[e as usize];
        let t = mesh.triangles[topology.triangles_of_edge(e as usize)[0] as usize];
        let forward = (0..3).any(|k| t[k] == a && t[(k + 1) % 3] == b);
        let (a, b) = if forward { (a, b) } else { (b, a) };
        // Outside is to the right of a counter-clockwise edge.
        let d = mesh.vertices[b as usize] - mesh.vertices[a as usize];
        let half = Vector3::new(tension[0] * d.y, -tension[1] * d.x, 0.0) / 2.0;
        forces.extend([(a, half), (b, half)]);
    }
    forces
}

/// Stretches along x and y of a lattice at `x`, and the deviation of the vertices from a uniform
/// stretch.
fn stretches(mesh: &TriangleMesh, x: &[Point3<f64>]) -> ([f64; 2], f64) {
    let centre =
        |x: &[Point3<f64>]| x.iter().map(|p| p.coords).sum::<Vector3<f64>>() / x.len() as f64;
    let (c, c0) = (centre(x), centre(&mesh.vertices));
    let pairs = || {
        x.iter()
            .zip(&mesh.vertices)
            .map(|(x, y)| ((x.coords - c).xy(), (y.coords - c0).xy()))
    };
    // The best linear map; its rotation is arbitrary.
    let spread: Matrix2<f64> = pairs().map(|(_, y)| y * y.transpose()).sum();
    let map = pairs()
        .map(|(x, y)| x * y.transpose())
        .sum::<Matrix2<f64>>()
        * spread.try_inverse().expect("a plane");
    let (sides, off) = (
        map.transpose() * map,
        pairs().map(|(x, y)| (x - map * y).norm()),
    );
    (
        [sides[(0, 0)].sqrt(), sides[(1, 1)].sqrt()],
        worst(off.chain([sides[(0, 1)].abs()])),
    )
}

/// A lattice of `n` at rest under a nominal tension, by Newton's method; all stiffness times `by`.
fn pulled(n: u32, tension: [f64; 2], by: f64) -> ([f64; 2], f64) {
    let mesh = lattice(n);
    let edges = stiffness::edges(&mesh, &Topology::new(&mesh), MEMBRANE * by);
    let mut body = Body::new(edges, mesh.vertices.len(), MEMBRANE);
    pulls(&mesh, tension)
        .into_iter()
        .for_each(|(p, f)| body.forces[p as usize] += f);
    body.anchor = ANCHOR;
    // Stretched at the start: without tension a lattice is not stable in its plane.
    let mut x: Vec<Point3<f64>> = mesh.vertices.iter().map(|p| p * 1.05).collect();
    body.rest(&mut x);
    stretches(&mesh, &x)
}

/// The same by damped steps of `dt`.
fn stepped(n: u32, tension: [f64; 2], dt: f64) -> ([f64; 2], f64) {
    let mesh = lattice(n);
    let mut system = network(&mesh, 20);
    system.forces = pulls(&mesh, tension);
    system.settings.velocity_factor = 1.0 - 0.5 * dt;
    (0..(100.0 / dt) as usize).for_each(|_| system.step(&[], dt).expect("finite"));
    stretches(&mesh, &system.particles.position)
}

#[test]
fn a_lattice_is_the_membrane_of_poisson_one_third() {
    for n in [2, 4, 6] {
        // Under compression in a constant direction a free lattice turns over, so there is no such
        // case.
        for stretch in [1.0001, 1.1, 1.5_f64] {
            // One family of springs along x: P = E (l - 1); the others keep their length, so l^2 +
            // 3 w^2 = 4.
            let expected = [stretch, ((4.0 - stretch * stretch) / 3.0).sqrt()];
            let tension = [MEMBRANE * (stretch - 1.0), 0.0];
            let (found, off) = pulled(n, tension, 1.0);
            let error = worst([found[0] - expected[0], found[1] - expected[1], off].map(f64::abs));
            let linear = 1.0 - (stretch - 1.0) / 3.0;
            let rubber = pull_of_rubber(stretch, 2) / 3.0;
            println!(
                "lattice of {n}, uniaxial {stretch}: {error:.1e} from the network; width {:.6}, membrane {linear:.6}; \
                 tension/E {:.6}, neo-Hookean {rubber:.6}",
                found[1],
                stretch - 1.0
            );
            assert!(
                error <= T17,
                "{n}, {stretch}: {found:?} for {expected:?}, {off:e}"
            );
            let wrong = pulled(n, tension, 1.01).0[0];
            assert!(
                !((wrong - stretch).abs() <= T17),
                "control: another stiffness"
            );
        }
        for stretch in [1.0001, 1.1, 1.5] {
            // P = E (l - 1)/(1 - 1/3).
            let tension = MEMBRANE * (stretch - 1.0) / (1.0 - 1.0 / 3.0);
            let (found, off) = pulled(n, [tension; 2], 1.0);
            let error = worst([found[0] - stretch, found[1] - stretch, off].map(f64::abs));
            let rubber = pull_of_rubber(stretch, 5) / 3.0;
            println!(
                "lattice of {n}, equibiaxial {stretch}: {error:.1e} from the network; tension/E {tension:.6}, \
                 neo-Hookean {rubber:.6}"
            );
            assert!(error <= T17, "{n}, {stretch}: {found:?}, {off:e}");
        }
    }
}

#[test]
fn a_lattice_departs_from_the_linear_membrane_with_order_two() {
    // The width of a lattice under tension: sqrt((4 - l^2)/3) compared with 1 - (l - 1)/3.
    let errors = [0.2, 0.1, 0.05, 0.025].map(|strain| {
        let found = pulled(2, [MEMBRANE * strain, 0.0], 1.0).0[1];
        (found - (1.0 - strain / 3.0)).abs()
    });
    println!(
        "lattice: width less than linear by {errors}, orders in the strain {:.4?}",
        orders(&errors),
        errors = powers(&errors)
    );
    assert!(off_order(&errors, 2.0) <= T16);
    let wrong = [0.2, 0.1, 0.05, 0.025]
        .map(|s: f64| (((4.0 - (1.0 + s).powi(2)) / 3.0).sqrt() - (1.0 - s / 2.0)).abs());
    assert!(
        !(off_order(&wrong, 2.0) <= T16),
        "control: Poisson's ratio 1/2"
    );
}

/// p R/E of a network sphere of radius 1 m inflated to `stretch`^3 times its volume.
fn balloon(subdivisions: u32, stretch: f64) -> f64 {
    let mesh = icosphere(1.0, subdivisions);
    let edges = stiffness::edges(&mesh, &Topology::new(&mesh), MEMBRANE);
    let mut body = Body::new(edges, mesh.vertices.len(), MEMBRANE);
    body.anchor = ANCHOR;
    let volume = mesh.volume() * stretch.powi(3);
    let mut x: Vec<Point3<f64>> = mesh.vertices.iter().map(|p| p * stretch).collect();
    let volume = EnclosedVolume::new(&mesh.triangles, mesh.vertices.len(), volume, 0.0);
    body.inflate(&mut x, volume).pressure / MEMBRANE
}

/// Nominal stress over mu of incompressible neo-Hookean rubber: l - 1/l^2 under uniaxial, l - 1/l^5 under equibiaxial
/// stretch.
fn pull_of_rubber(l: f64, power: i32) -> f64 {
    l - l.powi(-power)
}

/// 2 (1/l - 1/l^7): p R/(mu H) of an incompressible neo-Hookean balloon.
fn rubber(l: f64) -> f64 {
    2.0 * (1.0 / l - l.powi(-7))
}

#[test]
fn the_neo_hookean_balloon_has_its_printed_numbers() {
    let values = [
        (1.1, 0.791_866),
        (1.2, 1.108_503),
        (1.5, 1.216_278),
        (2.0, 0.984_375),
        (3.0, 0.665_752),
    ];
    for (l, printed) in values {
        assert!((rubber(l) - printed).abs() <= T14, "{l}: {}", rubber(l));
    }
    let peak = 7f64.powf(1.0 / 6.0);
    assert!((peak - 1.383_088).abs() <= T14 && (rubber(peak) - 1.239_463).abs() <= T14);
    assert!(rubber(peak) > rubber(peak * 0.999) && rubber(peak) > rubber(peak * 1.001));
}

#[test]
fn stretched_rubber_has_its_printed_numbers() {
    let uniaxial = [
        (1.1, 0.273_554),
        (1.2, 0.505_556),
        (1.5, 1.055_556),
        (2.0, 1.75),
        (0.8, -0.7625),
    ];
    let equibiaxial = [
        (1.1, 0.479_079),
        (1.2, 0.798_122),
        (1.5, 1.368_313),
        (2.0, 1.968_75),
    ];
    let off = |table: &[(f64, f64)], power: i32| {
        worst(
            table
                .iter()
                .map(|(l, printed)| (pull_of_rubber(*l, power) - printed).abs()),
        )
    };
    assert!(off(&uniaxial, 2) <= T14 && off(&equibiaxial, 5) <= T14);
    assert!(
        !(off(&uniaxial, 5) <= T14) && !(off(&equibiaxial, 2) <= T14),
        "control: the other's power"
    );
}

#[test]
fn a_network_balloon_has_its_own_peak() {
    // 3 E A0 (l - 1)^2/2 is the energy of any network under a uniform dilation, l^3 V0 its volume.
    let network = |l: f64| 3.0 * (l - 1.0) / (l * l);
    for l in [1.1, 1.2, 7f64.powf(1.0 / 6.0), 2.0] {
        let p = [1, 2, 3].map(|n| balloon(n, l));
        let order = ((p[0] - p[1]) / (p[1] - p[2])).log2();
        let limit = p[2] - (p[1] - p[2]) / 3.0;
        // E = 3 mu H for small strains.
        println!(
            "balloon {l:.6}: p R/E {p:.6?}, order {order:.4}, limit {limit:.6}, {:+.2e} from {:.6}; neo-Hookean {:.6}",
            limit / network(l) - 1.0,
            network(l),
            rubber(l) / 3.0
        );
        assert!((order - 2.0).abs() <= T16, "{l}: {p:?}");
        // Triangles of a sphere are not all equilateral, so a uniform dilation is not exactly an
        // equilibrium.
        assert!((limit / network(l) - 1.0).abs() <= MODEL, "{l}: {limit}");
        assert!(
            !((limit / (rubber(l) / 3.0) - 1.0).abs() <= MODEL),
            "control: the neo-Hookean balloon"
        );
    }
    let peak = [1.9, 2.0, 2.1].map(|l| balloon(1, l));
    assert!(
        peak[1] > peak[0] && peak[1] > peak[2],
        "the peak of the network is at 2: {peak:?}"
    );
    let neo = [1.28, 7f64.powf(1.0 / 6.0), 1.48].map(|l| balloon(1, l));
    assert!(
        !(neo[1] > neo[0] && neo[1] > neo[2]),
        "control: that of a neo-Hookean balloon is not its own"
    );
}

#[test]
fn a_lattice_by_steps_nears_its_rest_with_order_two_or_more() {
    let off = |tension: f64, dt: f64| {
        let (found, _) = stepped(2, [tension, 0.0], dt);
        (found[0] - 1.1).abs()
    };
    let errors = [0.4, 0.2, 0.1].map(|dt| off(0.1, dt));
    println!(
        "lattice by steps: errors {}, orders {:.4?}",
        powers(&errors),
        orders(&errors)
    );
    let least = |errors: &[f64]| orders(errors).into_iter().all(|o| o >= 2.0 - T16);
    assert!(least(&errors));
    assert!(
        !least(&[0.4, 0.2, 0.1].map(|dt| off(0.101, dt))),
        "control: another tension"
    );
}
