//! Shapes without extent, numbers that are not finite, extreme offsets and steps (P19 to P26).

use std::f64::consts::PI;

use nalgebra::{Point3, Vector3};
use pliant::Particles;
use pliant::constraints::{
    Bending, Constraint, Distance, EnclosedVolume, Project, SweepOrder, TetrahedronVolume,
};
use pliant::mesh::shapes::{icosphere, tetrahedron};
use pliant::scene::builtin::load;
use pliant::simulation::Simulation;
use pliant::solvers::Broken;
use pliant::testing::Draw;

use crate::bodies::{batch, bits, edges, elastic, finite};
use crate::tolerances::{T1, T7, T12, cases, worst};

/// A hinge with heights 0.7 and 0.4, folded so that its wings are at the signed angle with this
/// cosine and sine.
fn hinge(cos: f64, sin: f64) -> [Point3<f64>; 4] {
    let tip = Point3::new(0.6, -0.4 * cos, -0.4 * sin);
    [
        Point3::origin(),
        Point3::new(1.0, 0.0, 0.0),
        Point3::new(0.3, 0.7, 0.0),
        tip,
    ]
}

/// The angle by arc cosine, as printed (errata A08, A09).
fn printed_angle(x: &[Point3<f64>; 4]) -> f64 {
    let e = x[1] - x[0];
    let (n1, n2) = (
        e.cross(&(x[2] - x[0])).normalize(),
        (x[3] - x[0]).cross(&e).normalize(),
    );
    n1.dot(&n2).acos()
}

#[test]
fn p19_the_angle_is_good_at_flat_and_at_shut() {
    let flat = |fold: f64| (hinge(fold.cos(), fold.sin()), fold);
    let shut = |fold: f64| {
        (
            hinge(-fold.cos(), fold.sin()),
            if fold > 0.0 { PI - fold } else { -PI - fold },
        )
    };
    let mut printed = 0.0;
    for k in 0..=17 {
        for sign in [1.0, -1.0] {
            let fold = if k == 17 {
                0.0
            } else {
                sign * 10f64.powi(-k - 1).min(0.1)
            };
            for (x, angle) in [flat(fold), shut(fold)] {
                let (c, g) = Bending::new([0, 1, 2, 3], 0.0)
                    .value_and_gradient(&x)
                    .expect("areas");
                // Exactly shut, +pi and -pi are the same fold.
                let off = (c - angle)
                    .abs()
                    .min((c.abs() - PI).abs() + (angle.abs() - PI).abs());
                assert!(off <= T1, "fold {fold}: {c} for {angle}");
                let slopes = [g[2].norm() * 0.7, g[3].norm() * 0.4];
                assert!(
                    worst(slopes.map(|s| (s - 1.0).abs())) <= T12,
                    "fold {fold}: {slopes:?}"
                );
                printed = worst([printed, (printed_angle(&x) - angle.abs()).abs()]);
            }
        }
    }
    assert!(
        !(printed <= 1e-10),
        "control: the arc cosine is as good, {printed}"
    );
    let wrapped = Bending::new([0, 1, 2, 3], PI - 1e-9);
    let (c, _) = wrapped
        .value_and_gradient(&hinge(-1.0, -1e-9))
        .expect("areas");
    assert!((c - 2e-9).abs() <= T1, "across the seam {c}");
}

#[test]
fn p20_a_collapsed_edge_is_skipped_and_a_tiny_or_huge_one_is_not() {
    let edge = Distance {
        points: [0, 1],
        rest: 1.0,
    };
    let mut particles = Particles::at_rest(vec![Point3::new(0.1, 0.2, 0.3); 2], vec![1.0; 2]);
    let before = bits(&particles);
    let mut one = batch(vec![edge], 0.0, SweepOrder::Stored, 2);
    one.project(&mut particles, 0.01);
    assert_eq!((bits(&particles), one.usage().skipped), (before, 1));
    let mut draw = Draw::new(20);
    for exponent in [-300, -170, -100, 0, 100, 170, 300] {
        let d = draw.direction() * 10f64.powi(exponent);
        let (c, g) = edge
            .value_and_gradient(&[Point3::from(d), Point3::from(-d)])
            .expect("a direction");
        assert!(c.is_finite());
        let off = worst(g.map(|g| (g.norm() - 1.0).abs()));
        assert!(off <= 4.0 * f64::EPSILON, "1e{exponent}: {off}");
    }
    // Control: the plain length underflows.
    assert_eq!(Vector3::repeat(1e-170).norm_squared(), 0.0);
}

#[test]
fn p21_a_triangle_without_area_is_skipped_by_a_relative_rule() {
    let wing = Point3::new(0.5, -0.7, 0.1);
    let at = |tip: Point3<f64>, s: f64| {
        let x = [Point3::origin(), Point3::new(1.0, 0.0, 0.0), tip, wing].map(|p| p * s);
        Bending::new([0, 1, 2, 3], 0.1).value_and_gradient(&x)
    };
    let threshold = 2f64.powi(-40);
    for k in [-100, -20, 0, 20, 100] {
        let s = 2f64.powi(k);
        for tip in [
            Point3::origin(),
            Point3::new(0.5, 0.0, 0.0),
            Point3::new(1.0, 0.0, 0.0),
        ] {
            assert!(at(tip, s).is_none(), "point or cap at scale 2^{k}");
        }
        // Twice the area is the height: the longest edge is 1.
        assert!(
            at(Point3::new(0.5, 1.99 * threshold, 0.0), s).is_none(),
            "2^{k}"
        );
        let (c, g) = at(Point3::new(0.5, 2.01 * threshold, 0.0), s).expect("just enough area");
        assert!(
            c.is_finite() && g.iter().all(|g| g.iter().all(|c| c.is_finite())),
            "2^{k}"
        );
    }
    let needle = [
        [0.0; 3],
        [1e-20, 0.0, 0.0],
        [1.0, 1.0, 0.0],
        [1.0, -1.0, 0.0],
    ]
    .map(Point3::from);
    let mut particles = Particles::at_rest(needle.to_vec(), vec![1.0; 4]);
    let mut one = batch(
        vec![Bending::new([0, 1, 2, 3], 0.1)],
        0.0,
        SweepOrder::Stored,
        4,
    );
    one.project(&mut particles, 0.01);
    assert_eq!(
        (particles.position.as_slice(), one.usage().skipped),
        (needle.as_slice(), 1)
    );
}

#[test]
fn p22_an_inverted_tetrahedron_comes_back() {
    let mut draw = Draw::new(22);
    for case in 0..cases(200) {
        let mut x = draw.shape(4);
        let kind = TetrahedronVolume {
            points: [0, 1, 2, 3],
            rest: 0.0,
        };
        let volume = |x: &[Point3<f64>]| kind.value(&std::array::from_fn(|k| x[k]));
        if volume(&x) > 0.0 {
            x.swap(0, 1);
        }
        let rest = -volume(&x);
        let mut particles = Particles::at_rest(x, vec![1.0; 4]);
        let mut one = batch(
            vec![TetrahedronVolume { rest, ..kind }],
            0.0,
            SweepOrder::Stored,
            4,
        );
        (0..50).for_each(|_| one.project(&mut particles, 0.01));
        assert!(finite(&particles), "case {case} of seed {}", draw.seed);
        let off = (volume(&particles.position) / rest - 1.0).abs();
        assert!(
            off <= 1e2 * T7,
            "case {case} of seed {}: off by {off:e}",
            draw.seed
        );
    }
    // The exact projection needs one step through zero.
    let mesh = tetrahedron();
    let mut particles =
        Particles::at_rest(mesh.vertices.iter().map(|p| -p).collect(), vec![1.0; 4]);
    EnclosedVolume::new(&mesh.triangles, 4, mesh.volume(), 0.0)
        .project(&mut particles, 1.0)
        .expect("a root");
    let after = pliant::mesh::measures::volume(&particles.position, &mesh.triangles);
    assert!((after / mesh.volume() - 1.0).abs() <= T7, "{after}");
}

#[test]
fn p22_a_tetrahedron_without_extent_is_left_alone() {
    let line: Vec<Point3<f64>> = (0..4)
        .map(|i| Point3::new(f64::from(i), 0.0, 0.0))
        .collect();
    for x in [line, vec![Point3::new(1.0, 2.0, 3.0); 4]] {
        let mut particles = Particles::at_rest(x, vec![1.0; 4]);
        let before = bits(&particles);
        let mut one = batch(
            vec![TetrahedronVolume {
                points: [0, 1, 2, 3],
                rest: 1.0,
            }],
            0.0,
            SweepOrder::Stored,
            4,
        );
        one.project(&mut particles, 0.01);
        assert_eq!((bits(&particles), one.usage().skipped), (before.clone(), 1));
        let mut closed = EnclosedVolume::new(&tetrahedron().triangles, 4, 1.0, 0.0);
        assert!(closed.project(&mut particles, 0.01).is_err());
        assert_eq!((bits(&particles), closed.unsolved()), (before, 1));
    }
}

#[test]
fn p23_coincident_particles_stay_finite() {
    for n in [2, 3, 8, 64_u32] {
        let all: Vec<Distance> = (0..n)
            .flat_map(|i| {
                (0..i).map(move |j| Distance {
                    points: [j, i],
                    rest: 0.1,
                })
            })
            .collect();
        let pairs = all.len() as u64;
        let run = |apart: f64| {
            let mut particles = Particles::at_rest(
                vec![Point3::new(0.3, 0.2, 0.1); n as usize],
                vec![1.0; n as usize],
            );
            particles.position[0].x += apart;
            let mut batch = batch(all.clone(), 0.0, SweepOrder::Coloured, n as usize);
            (0..20).for_each(|_| batch.project(&mut particles, 0.01));
            assert!(finite(&particles));
            (bits(&particles), batch.usage().skipped, particles)
        };
        // The documented rule: an edge without direction is skipped and counted.
        let (same, skipped, _) = run(0.0);
        assert_eq!((same, skipped), (run(0.0).0, 20 * pairs));
        // One particle at another place gives the others a direction, along the same line.
        let (_, skipped, after) = run(1e-6);
        assert!(skipped < 20 * pairs);
        let farthest = after
            .position
            .iter()
            .map(|p| (p - after.position[0]).norm())
            .fold(0.0, f64::max);
        assert!(farthest > 1e-3, "{n} particles stayed together");
    }
}

/// Runs some steps and spoils the state at one of them. Returns the result of the step and
/// whether it was undone.
fn spoil(draw: &mut Draw, how: usize) -> (Result<(), Broken>, usize, bool) {
    let mesh = icosphere(1.0, 1);
    let mut system = elastic(&mesh, 0.1, [1e-5, 1e-3, 0.0], 2);
    system.settings.gravity = Vector3::new(0.0, 0.0, -9.81);
    (0..draw.index(10)).for_each(|_| system.step(&[], 0.01).expect("finite"));
    let v = draw.index(mesh.vertices.len());
    let bad = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY][draw.index(3)];
    let axis = draw.index(3);
    match how {
        0 => system.particles.velocity[v][axis] = bad,
        1 => system.particles.position[v][axis] = bad,
        2 => system.forces.push((v as u32, Vector3::ith(axis, bad))),
        3 => {
            let all = edges(&mesh);
            let mut broken = all.clone();
            broken[0].rest = bad;
            system.elastic[0] =
                Box::new(batch(broken, 0.0, SweepOrder::Stored, mesh.vertices.len()));
        }
        _ => (),
    }
    let before = bits(&system.particles);
    let result = system.step(&[], 0.01);
    (result, v, bits(&system.particles) == before)
}

#[test]
fn p24_what_is_not_finite_is_named_and_undone() {
    let mut draw = Draw::new(24);
    for case in 0..cases(60) {
        let how = case % 4;
        let (result, particle, undone) = spoil(&mut draw, how);
        let broken = result.expect_err("a step with a number that is not finite");
        let seed = draw.seed;
        if how == 3 {
            assert_eq!(broken.effect, "distance", "case {case} of seed {seed}");
        } else {
            assert_eq!(
                broken,
                Broken {
                    effect: "motion",
                    particle
                },
                "case {case} of seed {seed}"
            );
        }
        assert!(undone, "case {case} of seed {seed} was not rolled back");
    }
    // Control: an unspoilt state is accepted, and a step changes the state.
    let (result, _, undone) = spoil(&mut draw, 9);
    assert!(result.is_ok() && !undone);
}

#[test]
fn p24_other_bodies_are_not_touched() {
    let run = |spoilt: bool| {
        let mut scene = load("distance", &[]).expect("a built-in scene");
        let mut second = scene.muscles[0].clone();
        second.name = "other".into();
        scene.muscles.push(second);
        let mut sim = Simulation::new(scene).expect("a scene");
        (0..5).for_each(|_| sim.step_frame());
        if spoilt {
            sim.bodies[0].system.particles.velocity[3].y = f64::NAN;
        }
        (0..5).for_each(|_| sim.step_frame());
        sim
    };
    let (good, bad) = (run(false), run(true));
    assert_eq!(
        bad.bodies[0].stopped,
        Some((
            6,
            Broken {
                effect: "motion",
                particle: 3
            }
        ))
    );
    assert!(finite(&bad.bodies[0].system.particles) && good.bodies[0].stopped.is_none());
    assert_eq!(
        bits(&bad.bodies[1].system.particles),
        bits(&good.bodies[1].system.particles)
    );
    assert_ne!(
        bits(&bad.bodies[0].system.particles),
        bits(&good.bodies[0].system.particles)
    );
}

#[test]
fn p25_an_exact_offset_changes_no_bit_of_what_acts() {
    let grid = f64::from(1 << 20);
    let mut mesh = icosphere(1.0, 2);
    mesh.vertices
        .iter_mut()
        .for_each(|p| *p = p.map(|c| (c * grid).round() / grid));
    let mut moved = mesh.clone();
    let by = Vector3::new(f64::from(1 << 25), -f64::from(1 << 24), f64::from(1 << 23));
    moved.vertices.iter_mut().for_each(|p| *p += by);
    let count = mesh.vertices.len();
    let volume = EnclosedVolume::new(&mesh.triangles, count, 4.0, 0.0);
    assert_eq!(
        volume.value_and_gradient(&mesh.vertices),
        volume.value_and_gradient(&moved.vertices)
    );
    assert_eq!(edges(&mesh), edges(&moved));
    let residual = |at: &[Point3<f64>]| {
        let batch = batch(edges(&icosphere(1.1, 2)), 0.0, SweepOrder::Coloured, count);
        batch.residual(&Particles::at_rest(at.to_vec(), vec![1.0; count]), 0.1)
    };
    assert_eq!(residual(&mesh.vertices), residual(&moved.vertices));
    // Positions are stored with an error of an ulp of the offset, so runs differ by about this
    // value at each visit.
    let run = |mesh: &pliant::mesh::TriangleMesh| {
        let mut system = elastic(mesh, 0.1, [1e-4, 1e-2, 1e-4], 1);
        system.settings.gravity = Vector3::new(0.0, 0.0, -9.81);
        (0..10).for_each(|_| system.step(&[], 0.01).expect("finite"));
        system.particles.position
    };
    let off = worst(
        run(&mesh)
            .iter()
            .zip(run(&moved))
            .map(|(a, b)| (a + by - b).norm()),
    );
    // Ten steps with about 40 roundings of half an ulp each. v = dx/dt carries each into later
    // steps: 10^2 / 2 times.
    assert!(
        off <= 50.0 * 40.0 * by.x * f64::EPSILON,
        "deviation {off:e}"
    );
    assert!(off > 0.0);
}

#[test]
fn p26_steps_from_nothing_to_a_second() {
    let make = || {
        let mut system = elastic(&icosphere(1.0, 1), 0.1, [1e-5, 1e-3, 0.0], 2);
        system.settings.gravity = Vector3::new(0.0, 0.0, -9.81);
        system.particles.velocity[3] = Vector3::new(1.0, 2.0, 3.0);
        system
    };
    let mut still = make();
    let before = bits(&still.particles);
    still.step(&[], 0.0).expect("nothing happens");
    assert_eq!(bits(&still.particles), before);
    for dt in [1e-7, 1e-5, 1e-3, 0.1, 1.0] {
        let mut system = make();
        (0..20).for_each(|_| {
            system
                .step(&[], dt)
                .unwrap_or_else(|e| panic!("dt {dt}: {e}"))
        });
        assert!(
            finite(&system.particles) && bits(&system.particles) != before,
            "dt {dt}"
        );
    }
    for dt in [-1e-3, f64::NAN, f64::INFINITY] {
        let mut system = make();
        let refused =
            std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| system.step(&[], dt)));
        assert!(refused.is_err(), "a step of {dt} s was taken");
    }
}
