//! Errata of the first source that no other file shows; `docs/errata.md` lists all of them.

use nalgebra::{Isometry3, Point3, Vector3};
use pliant::Particles;
use pliant::constraints::{Batch, Constraint, Distance, Project, Scalar, SweepOrder};
use pliant::contact::{Contacts, Obstacle, PosedObstacle, Surface};
use pliant::io::{Encoding, read_bytes};
use pliant::mesh::shapes::{box_surface, icosphere};
use pliant::mesh::{Inside, TriangleMesh};
use pliant::scene::builtin::load;
use pliant::scene::{Effects, Solver};
use pliant::simulation::Simulation;
use pliant::solvers::System;
use pliant::testing::internals::contact::broad_phase::{BitGrid, Fill, NearestTriangle, Voxels};
use pliant::testing::internals::io::vtk;

use crate::bodies::{batch, settings, still};
use crate::tolerances::{T1, T10};

/// An edge with a multiplied function, which is the stiffness of the source.
#[derive(Clone, Copy)]
struct Scaled {
    edge: Distance,
    by: f64,
}

impl Constraint<2> for Scaled {
    const NAME: &'static str = "scaled distance";
    fn points(&self) -> [u32; 2] {
        self.edge.points
    }
    fn value<S: Scalar>(&self, x: &[Point3<S>; 2]) -> S {
        self.edge.value(x) * S::of(self.by)
    }
    fn value_and_gradient(&self, x: &[Point3<f64>; 2]) -> Option<(f64, [Vector3<f64>; 2])> {
        self.edge
            .value_and_gradient(x)
            .map(|(c, g)| (self.by * c, g.map(|g| self.by * g)))
    }
}

/// Remaining share of an edge's error after some projections.
fn left<C: Constraint<2>>(batch: &mut Batch<C, 2>, projections: usize) -> f64 {
    let x = vec![Point3::origin(), Point3::new(1.5, 0.0, 0.0)];
    let mut particles = Particles::at_rest(x, vec![1.0, 3.0]);
    (0..projections).for_each(|_| batch.project(&mut particles, 1.0));
    ((particles.position[1] - particles.position[0]).norm() - 1.0) / 0.5
}

#[test]
fn a04_inverse_masses_stand_in_numerator_and_denominator() {
    // Free, ten times as light, and with one end held; the printed step removes (w1 + w2) / 2 of the error.
    for (masses, printed) in [([1.0, 3.0], -1.0), ([10.0, 10.0], -9.0), ([0.0, 1.0], 0.5)] {
        let x = [Point3::origin(), Point3::new(1.5, 0.0, 0.0)];
        let edge = Distance {
            points: [0, 1],
            rest: 1.0,
        };
        let mut particles = Particles::at_rest(x.to_vec(), masses.to_vec());
        batch(vec![edge], 0.0, SweepOrder::Stored, 2).project(&mut particles, 1.0);
        let error = |x: &[Point3<f64>]| ((x[1] - x[0]).norm() - 1.0) / 0.5;
        assert!(error(&particles.position).abs() <= T1, "{masses:?}");
        let (c, g) = edge.value_and_gradient(&x).expect("two places");
        let squares = g[0].norm_squared() + g[1].norm_squared();
        let moved = [0, 1].map(|i| x[i] - g[i] * (masses[i] * c / squares));
        let signed = (moved[1].x - moved[0].x - 1.0) / 0.5;
        assert!(
            (signed - printed).abs() <= T1 && !(signed.abs() <= T1),
            "control: {masses:?} leaves {signed}"
        );
    }
}

#[test]
fn a13_the_encodings_of_legacy_vtk_are_ascii_and_binary() {
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR"));
    let path = folder.join("a13.vtk");
    let mesh = box_surface([1.0, 2.0, 3.0], 1.0);
    vtk::write(&path, &mesh, &[], Encoding::Binary).expect("the folder of tests can be written");
    let bytes = std::fs::read(&path).expect("it was written");
    let text = String::from_utf8_lossy(&bytes);
    assert_eq!(text.lines().nth(2), Some("BINARY"));
    let first = mesh.vertices[0].x;
    let head = bytes
        .windows(8)
        .position(|w| w == b" double\n")
        .expect("a header of points")
        + 8;
    assert_eq!(bytes[head..head + 8], first.to_be_bytes());
    assert_ne!(
        bytes[head..head + 8],
        first.to_le_bytes(),
        "control: the order of bytes does not show"
    );
    assert_eq!(read_bytes(&bytes, "a13.vtk").expect("a mesh").mesh, mesh);
    let at = bytes
        .windows(6)
        .position(|w| w == b"BINARY")
        .expect("the encoding");
    let raw = [&bytes[..at], b"RAW", &bytes[at + 6..]].concat();
    let error = read_bytes(&raw, "a13.vtk")
        .expect_err("the word is in no file")
        .to_string();
    assert!(
        error.starts_with("a13.vtk:3: expected ASCII or BINARY"),
        "{error}"
    );
}

#[test]
fn a05_stiffness_multiplies_the_displacement() {
    let edge = Distance {
        points: [0, 1],
        rest: 1.0,
    };
    for (k, projections, expected) in [(0.9, 1, 0.1), (0.9, 3, 0.001), (0.25, 2, 0.5625)] {
        let found = left(
            &mut batch(vec![edge], 0.0, SweepOrder::Stored, 2).with_relaxation(&[k]),
            projections,
        );
        assert!(
            (found - expected).abs() <= T1,
            "{k} {projections} times leaves {found}, not {expected}"
        );
        // The printed rule has no effect: a projection does not depend on the scale of its
        // function.
        let printed = left(
            &mut batch(vec![Scaled { edge, by: k }], 0.0, SweepOrder::Stored, 2),
            projections,
        );
        assert!(
            printed.abs() <= T1 && !((printed - expected).abs() <= T1),
            "control: {k} leaves {printed}"
        );
    }
}

/// Position after a step of one second of a vertex from the origin, with or without contact.
/// The vertex would move by `by` while a plate moves from one height to another.
fn after(by: f64, plate: (f64, f64), guarded: bool) -> f64 {
    let bone = box_surface([2.0, 2.0, 0.02], 1.0);
    let at = |z: f64| Isometry3::translation(0.0, 0.0, z);
    let placed = |before: f64, now: f64| {
        [PosedObstacle {
            before: at(before),
            now: at(now),
            ..still(&bone)
        }]
    };
    let mesh = TriangleMesh {
        vertices: vec![Point3::new(0.1, 0.2, 0.0)],
        triangles: Vec::new(),
    };
    let mut system = System::new(
        Particles::at_rest(mesh.vertices.clone(), vec![1.0]),
        settings(1),
    );
    if guarded {
        let begin = placed(plate.0, plate.0);
        system.contacts = Some(Contacts::new(
            &mesh,
            &system.particles,
            &begin,
            vec![0],
            1e-3,
            0.0,
        ));
    }
    system.particles.velocity[0].z = by;
    system.step(&placed(plate.0, plate.1), 1.0).expect("finite");
    // The target of the move is free, so a test of the target alone finds nothing.
    let target = at(plate.1).inverse() * Point3::new(0.1, 0.2, by);
    assert_eq!(
        Inside::new(&bone.vertices, &bone.triangles).winding(&target),
        0
    );
    system.particles.position[0].z
}

#[test]
fn a17_the_path_of_a_move_is_tested_and_not_its_target_alone() {
    // Through a plate at rest; a plate that passes over a vertex at rest; both towards each other.
    for (by, plate) in [
        (-1.0, (-0.5, -0.5)),
        (0.0, (-0.5, 0.5)),
        (-1.0, (-0.5, 0.5)),
    ] {
        let above = |z: f64| z > plate.1;
        let found = after(by, plate, true);
        assert!(above(found), "{by} {plate:?}: ends at {found}");
        assert!(
            !above(after(by, plate, false)),
            "control: without contact it stays above"
        );
    }
}

#[test]
fn a17_walking_back_from_the_target_passes_a_thin_bone_and_walking_to_it_does_not() {
    let bone = box_surface([2.0, 2.0, 0.02], 1.0);
    let p = |z: f64| Point3::new(0.1, 0.2, z);
    for fill in [Fill::Centre, Fill::Touch] {
        let grid = BitGrid::new(&bone, 64, fill);
        // A target in the bone is moved back within a box to the side of its start.
        let end = grid
            .walk_back(&p(0.5), &p(0.0))
            .expect("the way begins free");
        assert!(
            end.z > 0.01 && end.z <= 0.01 + 2.0 * grid.diagonal(),
            "{end}"
        );
        // A target behind the bone is free, so the printed rule leaves it there.
        assert_eq!(
            grid.walk_back(&p(0.5), &p(-0.5)),
            Some(p(-0.5)),
            "the printed rule tunnels"
        );
        let stopped = grid.walk(&p(0.5), &p(-0.5)).expect("the way begins free");
        assert!(
            stopped.z > 0.01 && stopped.z <= 0.01 + 2.0 * grid.diagonal(),
            "{stopped}"
        );
        assert_eq!(
            grid.walk(&p(0.5), &p(0.2)),
            Some(p(0.2)),
            "control: a free way is stopped"
        );
        // The moving bone contains the vertex: no box of its path is free, but the nearest free
        // box is known.
        assert_eq!(grid.walk_back(&p(0.002), &p(0.004)), None);
        assert_eq!(grid.walk(&p(0.002), &p(0.004)), None);
        let out = grid.closest(&p(0.004)).expect("a bone");
        assert!(
            out.distance < 0.0 && out.normal.z > 0.9 && out.point.z > 0.009,
            "{out:?}"
        );
        // Between boxes, free balls prevent tunnelling, as with any obstacle.
        let obstacle: std::sync::Arc<dyn Obstacle> = std::sync::Arc::new(grid);
        let placed = [PosedObstacle {
            obstacle,
            ..still(&bone)
        }];
        let mesh = TriangleMesh {
            vertices: vec![p(0.5)],
            triangles: Vec::new(),
        };
        let mut system = System::new(
            Particles::at_rest(mesh.vertices.clone(), vec![1.0]),
            settings(1),
        );
        system.contacts = Some(Contacts::new(
            &mesh,
            &system.particles,
            &placed,
            vec![0],
            1e-3,
            0.0,
        ));
        system.particles.velocity[0].z = -1.0;
        system.step(&placed, 1.0).expect("finite");
        assert!(
            system.particles.position[0].z > 0.01,
            "{}",
            system.particles.position[0]
        );
    }
}

#[test]
fn a03_a_surface_meets_about_k_squared_boxes() {
    let bone = icosphere(1.0, 5);
    for k in [16, 32, 64] {
        let filled = Voxels::new(&bone, k).filled() as f64;
        // About 3 pi / 2: the sphere marks each box where it passes one of its faces. With k^3
        // the share would grow fourfold.
        let share = filled / (k * k) as f64;
        assert!((4.0..6.0).contains(&share), "{k}: {share} k^2");
    }
}

#[test]
fn a16_a_bit_for_each_box_is_far_less_than_lists() {
    let bone = icosphere(1.0, 5);
    let grid = BitGrid::new(&bone, 64, Fill::Touch);
    assert_eq!(grid.bit_bytes(), 32_768);
    let lists = Voxels::new(&bone, 64).bytes();
    assert!(
        lists > 30 * grid.bit_bytes(),
        "control: lists take {lists} bytes"
    );
    // The cost: the surface is known only to within a box.
    let known = Surface::new(&bone);
    let error = |r: f64| {
        let p = Point3::from(Vector3::new(0.48, 0.6, 0.64) * r);
        (grid.closest(&p).expect("a bone").distance - known.closest(&p).expect("a bone").distance)
            .abs()
    };
    let worst = crate::tolerances::worst((0..100).map(|i| error(1.1 + 1e-3 * f64::from(i))));
    assert!(worst > 1e-3 && worst <= grid.diagonal(), "{worst}");
}

/// The remaining speed of 1 m/s after this number of frames of free flight, damped by 0.99.
fn speed(iterations: u32, substeps: u32, frames: usize) -> f64 {
    let mut scene = load("distance", &[]).expect("a built-in scene");
    scene.effects = Effects::default();
    scene.muscles[0].attachments.clear();
    scene.muscles[0].forces.clear();
    let Solver::Pbd(mut pbd) = scene.solver else {
        panic!("the scene is one of classic PBD")
    };
    (pbd.iterations, pbd.substeps, pbd.velocity_damping) = (iterations, substeps, 0.99);
    scene.solver = Solver::Pbd(pbd);
    let mut sim = Simulation::new(scene).expect("a scene that runs");
    sim.bodies[0].system.particles.velocity.fill(Vector3::x());
    (0..frames).for_each(|_| sim.step_frame());
    sim.bodies[0].system.particles.velocity[0].x
}

#[test]
fn a19_damping_acts_once_a_frame() {
    let expected = 0.99_f64.powi(100);
    for (iterations, substeps) in [(1, 1), (3, 1), (3, 4)] {
        let found = speed(iterations, substeps, 100);
        // Velocities are differences of positions up to about a metre, over steps of at least 4
        // ms.
        assert!(
            (found - expected).abs() <= 100.0 * T10,
            "{iterations}, {substeps}: {found} for {expected}"
        );
    }
    // With the printed rule, after each of three iterations, 5 % of the speed would remain
    // instead of 37 %.
    assert!(
        !((speed(3, 1, 300) - expected).abs() <= 100.0 * T10),
        "control: nothing is damped"
    );
}
