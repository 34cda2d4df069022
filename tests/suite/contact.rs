//! Muscles stay outside bones and bones outside muscles (P31 to P34); friction; the audit that
//! reports this.

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use pliant::Particles;
use pliant::contact::{Contacts, Obstacle, PosedObstacle, Surface, untangle};
use pliant::mesh::measures::volume;
use pliant::mesh::shapes::{box_surface, icosphere};
use pliant::mesh::{Inside, TriangleMesh};
use pliant::solvers::System;
use pliant::testing::Draw;
use pliant::testing::internals::simulation::audit;

use crate::bodies::{elastic, finite, settings, still};
use crate::tolerances::{T6, T13, cases};

/// A free triangle of 1 kg corners at `x`, with contact.
fn lone(x: [Point3<f64>; 3], placed: &[PosedObstacle], thickness: f64, friction: f64) -> System {
    let mesh = TriangleMesh {
        vertices: x.to_vec(),
        triangles: vec![[0, 1, 2]],
    };
    let mut system = System::new(Particles::at_rest(x.to_vec(), vec![1.0; 3]), settings(1));
    let obstacles = (0..placed.len()).collect();
    system.contacts = Some(Contacts::new(
        &mesh,
        &system.particles,
        placed,
        obstacles,
        thickness,
        friction,
    ));
    system
}

/// Moves single vertices towards a bone, up to 1e4 thicknesses per step. Returns the number of
/// vertices that end a step on the wrong side.
fn shots(
    bone: &TriangleMesh,
    thickness: f64,
    guarded: bool,
    count: usize,
    wrong: impl Fn(&Point3<f64>, &Point3<f64>) -> bool,
) -> usize {
    let placed = [still(bone)];
    let mut draw = Draw::new(31);
    let mut crossed = 0;
    for _ in 0..count {
        // A vertex that begins inside may leave on either side. Another one is drawn, so the
        // count is unchanged.
        let outside = |p: &Vector3<f64>| {
            placed[0]
                .obstacle
                .closest(&Point3::from(*p))
                .is_some_and(|c| c.distance > 0.0)
        };
        let mut from = draw.direction() * draw.between(1.2, 2.0);
        while !outside(&from) {
            from = draw.direction() * draw.between(1.2, 2.0);
        }
        let mesh = TriangleMesh {
            vertices: vec![Point3::from(from)],
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
            thickness,
            0.0,
        ));
        if !guarded {
            system.contacts = None;
        }
        let aim = draw.direction() * draw.between(0.0, 0.9) - from;
        let speed = thickness * draw.decades(0.0, 4.0);
        system.particles.velocity.fill(aim.normalize() * speed);
        for _ in 0..6 {
            let before = system.particles.position[0];
            system.step(&placed, 1.0).expect("finite");
            if wrong(&before, &system.particles.position[0]) {
                if guarded {
                    println!(
                        "seed {}: {before:?} to {:?}",
                        draw.seed, system.particles.position[0]
                    );
                }
                crossed += 1;
                break;
            }
        }
    }
    crossed
}

#[test]
fn p31_nothing_tunnels_through_a_sphere() {
    let bone = icosphere(1.0, 2);
    let inside = Inside::new(&bone.vertices, &bone.triangles);
    let wrong = |_: &Point3<f64>, x: &Point3<f64>| inside.winding(x) != 0;
    let count = cases(3000);
    assert_eq!(shots(&bone, 2e-3, true, count, wrong), 0);
    assert!(
        shots(&bone, 2e-3, false, 300, wrong) > 10,
        "control: without contact some end inside"
    );
}

#[test]
fn p31_nothing_tunnels_through_a_thin_plate() {
    let bone = box_surface([8.0, 8.0, 8e-4], 4.0);
    // The plate is wider than any path of three units from within 2, so a path through the
    // middle plane passes through the plate.
    let wrong = |before: &Point3<f64>, x: &Point3<f64>| {
        let within =
            x.x.abs() < 4.0 && x.y.abs() < 4.0 && before.x.abs() < 4.0 && before.y.abs() < 4.0;
        // An end inside is as wrong as a passage.
        within && (before.z.signum() != x.z.signum() || x.z.abs() < 4e-4)
    };
    let count = cases(3000);
    assert_eq!(shots(&bone, 2e-4, true, count, wrong), 0);
    assert!(
        shots(&bone, 2e-4, false, 300, wrong) > 10,
        "control: without contact some pass"
    );
}

/// A soft block over a wide box whose top is at z = 0.
fn resting(guarded: bool) -> (System, Vec<PosedObstacle>, TriangleMesh) {
    let mut bone = box_surface([4.0, 4.0, 1.0], 2.0);
    bone.vertices.iter_mut().for_each(|p| p.z -= 0.5);
    let mut mesh = box_surface([0.2, 0.2, 0.1], 0.05);
    mesh.vertices
        .iter_mut()
        .for_each(|p| *p += Vector3::new(0.3, 0.2, 0.055));
    let placed = vec![still(&bone)];
    let mut system = elastic(&mesh, 1e-3, [1e-2, 1e2, 0.0], 1);
    system.settings.gravity = Vector3::new(0.0, 0.0, -9.81);
    system.settings.velocity_factor = 0.98;
    if guarded {
        system.contacts = Some(Contacts::new(
            &mesh,
            &system.particles,
            &placed,
            vec![0],
            1e-3,
            0.5,
        ));
    }
    (system, placed, mesh)
}

#[test]
fn p32_a_resting_block_stays_on_its_plane() {
    let (mut system, placed, mesh) = resting(true);
    let centre = |s: &System| {
        s.particles
            .position
            .iter()
            .map(|p| p.coords)
            .sum::<Vector3<f64>>()
            / mesh.vertices.len() as f64
    };
    let mut settled = Vector3::zeros();
    for step in 0..900 {
        system.step(&placed, 1.0 / 300.0).expect("finite");
        let lowest = system
            .particles
            .position
            .iter()
            .map(|p| p.z)
            .fold(f64::MAX, f64::min);
        assert!(
            finite(&system.particles) && lowest >= -T13 * 0.2,
            "step {step}: {lowest:e}"
        );
        let kept = volume(&system.particles.position, &mesh.triangles) / mesh.volume() - 1.0;
        assert!(kept.abs() <= T6, "step {step}: volume off by {kept:e}");
        if step == 600 {
            settled = centre(&system);
        }
    }
    let drift = centre(&system) - settled;
    // A second at rest moves less than a millionth of the block.
    assert!(drift.norm() <= T13 * 0.2, "{drift:?}");
    let (mut falling, placed, _) = resting(false);
    (0..100).for_each(|_| falling.step(&placed, 1.0 / 300.0).expect("finite"));
    assert!(
        falling.particles.position.iter().any(|p| p.z < -T13),
        "control: without contact it falls through"
    );
}

#[test]
fn p33_a_deep_start_is_untangled() {
    let bone = icosphere(1.0, 3);
    let placed = [still(&bone)];
    let inside = Inside::new(&bone.vertices, &bone.triangles);
    let count = |mesh: &TriangleMesh| {
        mesh.vertices
            .iter()
            .filter(|p| inside.winding(p) != 0)
            .count()
    };
    for depth in [0.05, 0.2] {
        let mut mesh = icosphere(0.5, 2);
        mesh.vertices.iter_mut().for_each(|p| p.z += 1.5 - depth);
        assert!(count(&mesh) > 0, "control: the start overlaps");
        let report = untangle(&mut mesh, &placed, &[0], 0.01);
        assert!(
            report.overlap > 0.5 * depth && report.moved > 0.0 && report.moved <= 1.0,
            "{report:?}"
        );
        assert_eq!(count(&mesh), 0, "depth {depth}: {report:?}");
        assert!(
            mesh.vertices
                .iter()
                .all(|p| p.coords.iter().all(|c| c.is_finite()))
        );
        // A vertex that was moved out gets no velocity.
        let mut system = elastic(&mesh, 1e-3, [1e-3, 1e1, 0.0], 1);
        system.contacts = Some(Contacts::new(
            &mesh,
            &system.particles,
            &placed,
            vec![0],
            0.01,
            0.0,
        ));
        (0..50).for_each(|_| system.step(&placed, 1e-3).expect("finite"));
        let fastest = crate::tolerances::worst(system.particles.velocity.iter().map(|v| v.norm()));
        assert!(
            finite(&system.particles) && fastest <= 1.0,
            "depth {depth}: {fastest} m/s"
        );
    }
    let mut clear = icosphere(0.5, 1);
    clear.vertices.iter_mut().for_each(|p| p.z += 3.0);
    let before = clear.clone();
    untangle(&mut clear, &placed, &[0], 0.01);
    assert_eq!(clear, before, "a mesh that is clear is not touched");
}

#[test]
fn p34_closing_plates_cross_nothing_silently() {
    // How a ball crumples depends on its last bits.
    (0..16).for_each(|k| between_plates(3e-3 * f64::from(k)));
}

/// Closes two plates on a ball that lies this far beside their middle [m].
fn between_plates(aside: f64) {
    let plate = box_surface([4.0, 4.0, 1.0], 2.0);
    let at = |gap: f64, side: f64| Isometry3::translation(0.0, 0.0, side * (0.5 + gap / 2.0));
    let placed = |before: f64, now: f64| -> Vec<PosedObstacle> {
        [1.0, -1.0]
            .map(|s| PosedObstacle {
                before: at(before, s),
                now: at(now, s),
                ..still(&plate)
            })
            .to_vec()
    };
    let mut mesh = icosphere(0.1, 2);
    mesh.vertices.iter_mut().for_each(|p| p.x += aside);
    let mut system = elastic(&mesh, 1e-3, [1e-1, 1e2, 0.0], 1);
    system.settings.velocity_factor = 0.9;
    system.contacts = Some(Contacts::new(
        &mesh,
        &system.particles,
        &placed(0.21, 0.21),
        vec![0, 1],
        1e-3,
        0.0,
    ));
    let mut gap = 0.21;
    let mut worst_pinched = 0;
    while gap > 1e-3 {
        let next = gap - 5e-4;
        system.step(&placed(gap, next), 2e-3).expect("finite");
        // As at the end of a frame.
        system.settle(&placed(gap, next), 1e-7);
        gap = next;
        assert!(finite(&system.particles), "gap {gap}");
        let counts = system
            .contacts
            .as_ref()
            .expect("contact")
            .counts(&system.particles.position);
        worst_pinched = worst_pinched.max(counts.pinched);
        let out = system
            .particles
            .position
            .iter()
            .filter(|p| p.z.abs() > gap / 2.0 + 2.0 * T13)
            .count();
        let depth = system
            .particles
            .position
            .iter()
            .map(|p| p.z.abs() - gap / 2.0)
            .fold(f64::MIN, f64::max);
        // No vertex is in a plate unless the pinched vertices are counted.
        assert!(
            out == 0 || counts.pinched > 0,
            "{aside} m aside, gap {gap}: {out} vertices in a plate by {depth:e}, none pinched"
        );
        if gap >= 0.021 {
            assert_eq!(out, 0, "gap {gap}: vertices in a plate");
        }
        assert!(volume(&system.particles.position, &mesh.triangles).is_finite());
    }
    assert!(
        worst_pinched > 0,
        "control: plates that nearly touch pinch something"
    );
}

#[test]
fn friction_holds_below_its_angle_and_lets_go_above() {
    let mut bone = box_surface([40.0, 40.0, 1.0], 20.0);
    bone.vertices.iter_mut().for_each(|p| p.z -= 0.5);
    let placed = [still(&bone)];
    let slid = |friction: f64, slope: f64| {
        let x = [[0.3, 0.2, 2e-3], [0.4, 0.2, 2e-3], [0.3, 0.3, 2e-3]].map(Point3::from);
        let mut system = lone(x, &placed, 2e-3, friction);
        let angle = slope.atan();
        system.settings.gravity = Vector3::new(angle.sin(), 0.0, -angle.cos()) * 9.81;
        (0..500).for_each(|_| system.step(&placed, 2e-3).expect("finite"));
        system.particles.position[0].x - 0.3
    };
    // A second of sliding: g (sin - mu cos) / 2.
    let free = |friction: f64, slope: f64| {
        9.81 * (slope.atan().sin() - friction * slope.atan().cos()) / 2.0
    };
    for (friction, slope) in [(0.0, 0.5), (0.3, 0.5), (0.45, 0.5)] {
        let (found, expected) = (slid(friction, slope), free(friction, slope));
        // First order in the step of 1/500 of the time.
        assert!(
            (found - expected).abs() <= 0.02 * free(0.0, slope),
            "friction {friction}: {found} for {expected}"
        );
    }
    for friction in [0.55, 1.0] {
        let found = slid(friction, 0.5);
        // The block creeps by at most the sliding distance of one step.
        assert!(
            found.abs() <= 0.02 * free(0.0, 0.5),
            "friction {friction}: slid {found}"
        );
    }
}

/// A needle whose tip points down at a coarse triangle.
fn needle(tip: f64) -> (TriangleMesh, Isometry3<f64>) {
    let vertices = [
        [0.0, 0.0, 0.0],
        [0.02, 0.0, 1.0],
        [-0.01, 0.02, 1.0],
        [-0.01, -0.02, 1.0],
    ]
    .map(Point3::from)
    .to_vec();
    let mesh = TriangleMesh {
        vertices,
        triangles: vec![[0, 2, 1], [0, 3, 2], [0, 1, 3], [1, 2, 3]],
    };
    assert!(mesh.volume() > 0.0);
    (mesh, Isometry3::translation(0.05, 0.03, tip))
}

#[test]
fn a_needle_is_kept_out_of_a_coarse_muscle() {
    let run = |guarded: bool| {
        let mesh = box_surface([1.0, 1.0, 0.4], 0.5);
        let mut system = elastic(&mesh, 1e-2, [1e-4, 1e2, 0.0], 2);
        system.settings.velocity_factor = 0.95;
        let at = |tip: f64, before: f64| {
            let (bone, pose) = needle(tip);
            vec![PosedObstacle {
                before: needle(before).1,
                now: pose,
                ..still(&bone)
            }]
        };
        let mut tip = 0.25;
        if guarded {
            let placed = at(tip, tip);
            system.contacts = Some(Contacts::new(
                &mesh,
                &system.particles,
                &placed,
                vec![0],
                5e-3,
                0.0,
            ));
        }
        let mut deepest = 0;
        for _ in 0..100 {
            let next = tip - 1e-3;
            let placed = at(next, tip);
            system.step(&placed, 2e-3).expect("finite");
            tip = next;
            let (bone, pose) = needle(tip);
            let surface = Surface::new(&bone);
            let audited = audit::AuditedBone::new(&bone, &surface);
            let x = &system.particles.position;
            let found = audit::examine(x, &mesh.triangles, &|_| true, &[(&audited, pose)]);
            deepest = deepest.max(found.bone_vertices_inside);
        }
        deepest
    };
    assert_eq!(run(true), 0);
    assert!(run(false) > 0, "control: without contact the tip goes in");
}

#[test]
fn the_audit_finds_what_was_planted() {
    let bone = icosphere(1.0, 2);
    let surface = Surface::new(&bone);
    let audited = audit::AuditedBone::new(&bone, &surface);
    let pose = Isometry3::from_parts(
        Vector3::new(0.3, -0.2, 0.1).into(),
        UnitQuaternion::from_scaled_axis(Vector3::new(0.2, 0.5, 0.1)),
    );
    let mut mesh = icosphere(0.5, 2);
    mesh.vertices
        .iter_mut()
        .for_each(|p| *p = pose * (*p + Vector3::new(0.0, 0.0, 1.6)));
    let look = |x: &[Point3<f64>], free: bool| {
        audit::examine(x, &mesh.triangles, &|_| free, &[(&audited, pose)])
    };
    assert_eq!(look(&mesh.vertices, true), audit::Findings::default());
    let mut planted = mesh.vertices.clone();
    planted[7] = pose * Point3::new(0.0, 0.0, 0.9);
    let found = look(&planted, true);
    assert_eq!(found.vertices_inside, 1);
    assert!(found.depth > 0.05 && found.depth < 0.1, "{}", found.depth);
    assert_eq!(
        look(&planted, false).vertices_inside,
        0,
        "held vertices may be inside"
    );
    // The muscle contains one bone vertex, and none of its own vertices enter the bone.
    let tip = pose * bone.vertices[0];
    let around = icosphere(0.02, 1);
    let swallowed: Vec<Point3<f64>> = around.vertices.iter().map(|p| tip + p.coords).collect();
    let found = audit::examine(
        &swallowed,
        &around.triangles,
        &|_| true,
        &[(&audited, pose)],
    );
    assert_eq!(found.bone_vertices_inside, 1);
}

#[test]
fn clearance_is_a_bound_from_below_and_not_far_below() {
    let bone = icosphere(1.0, 3);
    let surface = Surface::new(&bone);
    let mut draw = Draw::new(310);
    let mut loose = 0;
    for _ in 0..2000 {
        let p = Point3::from(draw.direction() * draw.between(1.01, 4.0));
        let exact = surface.closest(&p).expect("a surface").distance;
        // Good and bad guesses give the same result: any point of the surface is an upper bound
        // of the distance.
        let known = bone.vertices[draw.index(bone.vertices.len())];
        let (lower, point) = surface.clearance(&p, &known);
        assert!(
            lower <= exact * (1.0 + 1e-12) && exact <= 1.2 * lower * (1.0 + 1e-12),
            "{lower} for {exact}"
        );
        // The remembered point is on the surface, so it is no nearer than the nearest point.
        assert!((point - p).norm() >= exact * (1.0 - 1e-12));
        loose += usize::from(lower < 0.95 * exact);
    }
    assert!(
        loose > 0,
        "control: a bound that is the distance itself saves nothing"
    );
}

/// Regression: contact knew of a vertex only by a tiny ball above the bone. The row of the
/// vertex lifted it out of this ball, and every later step put it back although nothing fixed it.
/// The real gluteus ended 9.5 mm from its start.
#[test]
fn a_vertex_hardly_over_a_bone_is_not_stuck_there() {
    let mut bone = box_surface([4.0, 4.0, 1.0], 2.0);
    bone.vertices.iter_mut().for_each(|p| p.z -= 0.5);
    let placed = [still(&bone)];
    let mut draw = Draw::new(77);
    for _ in 0..200 {
        let thickness = draw.decades(-4.0, -2.0);
        let height = thickness * draw.decades(-6.0, -3.0);
        let mesh = TriangleMesh {
            vertices: vec![Point3::new(0.3, 0.2, height)],
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
            thickness,
            0.0,
        ));
        system.step(&placed, 1.0).expect("finite");
        assert!(
            (system.particles.position[0].z - thickness).abs() <= 1e-9 * thickness,
            "its row lifts it"
        );
        let lift = Vector3::new(draw.between(-1.0, 1.0), draw.between(-1.0, 1.0), 1.0)
            * thickness
            * draw.decades(-2.0, 2.0);
        let before = system.particles.position[0];
        for _ in 0..3 {
            system.particles.velocity.fill(lift);
            system.step(&placed, 1.0).expect("finite");
        }
        let gone = (system.particles.position[0] - before).dot(&lift) / lift.norm_squared();
        assert!(
            (gone - 3.0).abs() <= 1e-9,
            "went {gone} of 3 lifts from {height:e} at thickness {thickness:e}"
        );
    }
}
