//! Soft bodies that meet each other at the minimum of their energies.

use nalgebra::{Point3, Rotation3};
use pliant::mesh::shapes::icosphere;
use pliant::simulation::checkpoint::{Checkpoint, Fingerprint, save};
use pliant::simulation::{Audit, AuditedSurface, Simulation};

use crate::soft::{Soft, bits, crossings, moved, positions, scene, simulation, text};
use crate::tolerances::worst;

const RADIUS: f64 = 0.03;
const FRAMES: usize = 6;
const EFFECTS: &str = "[effects.stretch]\n[effects.bending]\n[effects.volume]\n";
// Coarse balls touch along facets, where the last digits of a residual take most iterations.
const QUASI_STATIC: &str = "[solver.quasi_static]\ntolerance = 1e-3\n";
const IMPLICIT: &str = "[solver.implicit_euler]\ntolerance = 1e-3\n";

/// Two balls, mirror images of each other: a bone presses the upper one down by 12 mm, and the lower one
/// is held at its bottom. They are turned, so that no vertex lies over another one.
fn balls() -> [Soft; 2] {
    let turn = Rotation3::from_euler_angles(0.3, 0.5, 0.7);
    let mut ball = icosphere(RADIUS, 2);
    ball.vertices.iter_mut().for_each(|x| *x = turn * *x);
    let is_cap = |v: &u32| ball.vertices[*v as usize].z > 0.7 * RADIUS;
    let cap: Vec<u32> = (0..ball.vertices.len() as u32).filter(is_cap).collect();
    let away = RADIUS + 2e-3;
    let mut high = Soft::new("upper", moved(ball.clone(), [0.0, 0.0, away]));
    let mut low = Soft::new("lower", high.mesh.clone());
    low.mesh.vertices.iter_mut().for_each(|x| x.z = -x.z);
    low.mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    (low.held, high.held, high.bone) = (cap.clone(), cap, "press");
    [low, high]
}

fn pressed(between: &str, solver: &str) -> Simulation {
    let press = "[[bone]]\nname = 'press'\nshape = 'press-plate'\n[bone.motion]\nkeys = [\n\
         { frame = 0, translation = ['0 m', '9 m', '0 m'] },\n\
         { frame = 6, translation = ['0 m', '9 m', '-0.012 m'] }]\n";
    let contact =
        format!("[effects.contact]\nthickness = '2 mm'\nfriction = 0\nbetween = {between}\n");
    let damping = "[effects.damping]\nrate = '40 1/s'\n";
    let more = format!("{press}{EFFECTS}{contact}{damping}{solver}");
    simulation(&scene(&text(&balls(), 10 * FRAMES, &more)), &balls())
}

const ALL: &str = "['muscles', 'bones', 'self']";

#[test]
fn two_minima_meet_without_a_crossing() {
    // With inertia the residual of these coarse balls stands at 2e-3 in the third frame.
    for (solver, frames) in [(IMPLICIT, 2), (QUASI_STATIC, FRAMES)] {
        let mut run = pressed(ALL, solver);
        for frame in 1..=frames {
            run.step_frame();
            assert_eq!(crossings(&run).all, 0, "{solver} {frame}");
            for body in &run.bodies {
                let outcome = body.equilibrium().expect("a minimum").outcome;
                assert!(outcome.converged, "{solver} {frame}: {outcome:?}");
            }
        }
        if frames == FRAMES {
            let certificate = run.certificate();
            assert_eq!(certificate.open, 0, "{solver}");
            assert!(
                certificate.pairs > 100,
                "control: they meet, {certificate:?}"
            );
        }
    }
    let mut control = pressed("['bones']", QUASI_STATIC);
    (0..FRAMES).for_each(|_| control.step_frame());
    assert!(
        crossings(&control).all > 0,
        "control: without contact they cross"
    );
}

#[test]
fn two_equal_balls_at_rest_are_mirror_images() {
    let mut run = pressed(ALL, QUASI_STATIC);
    (0..FRAMES).for_each(|_| run.step_frame());
    // The bone went down by 12 mm, so that the mirror lies 6 mm below the origin.
    let mirrored = |x: &Point3<f64>| Point3::new(x.x, x.y, -0.012 - x.z);
    let pairs = positions(&run, 0).iter().zip(positions(&run, 1));
    let off = worst(pairs.map(|(low, high)| (low - mirrored(high)).norm()));
    // The pairs of two bodies share an order that no mirror keeps; 0.6 mm is a fifteenth of an edge.
    println!("off the mirror image by {off:e} m");
    assert!(off <= 0.02 * RADIUS, "{off}");
}

#[test]
fn a_minimum_is_where_sweeps_come_to_rest() {
    let mut minimum = pressed(ALL, QUASI_STATIC);
    let mut swept = pressed(ALL, "[solver.xpbd]\nsubsteps = 20\n");
    (0..FRAMES).for_each(|_| minimum.step_frame());
    (0..6 * FRAMES).for_each(|_| swept.step_frame());
    let off = |b: usize| {
        let pairs = positions(&minimum, b).iter().zip(positions(&swept, b));
        worst(pairs.map(|(x, y)| (x - y).norm()))
    };
    let off = worst([off(0), off(1)]);
    // Sweeps push to the whole distance, and minima leave pairs within 2 % of it; 0.9 mm is a tenth of
    // an edge.
    println!("sweeps at rest are off by {off:e} m");
    assert!(off <= 0.03 * RADIUS, "{off}");
}

#[test]
fn threads_and_a_resume_change_no_bit_of_minima_that_meet() {
    let mut one = pressed(ALL, QUASI_STATIC);
    one.set_threads(1);
    let mut other = pressed(ALL, QUASI_STATIC);
    other.set_threads(3);
    for frame in 0..FRAMES {
        one.step_frame();
        other.step_frame();
        if frame == FRAMES / 2 {
            let fingerprint = Fingerprint::of(&other);
            let kept = save(&other, &fingerprint, b"");
            let mut again = pressed(ALL, QUASI_STATIC);
            let checkpoint = Checkpoint::open(&kept).expect("a whole checkpoint");
            let restored = checkpoint.restore(&mut again, &fingerprint);
            restored.expect("a state of the same scene");
            other = again;
        }
        assert!(bits(&one) == bits(&other), "frame {frame}");
    }
}

/// A ball, held at its bottom, and a plate whose corner comes down on it by a `depth` [m]: its edge meets
/// those of the ball.
fn bladed(depth: f64) -> Simulation {
    let turn = Rotation3::from_euler_angles(0.3, 0.5, 0.7);
    let mut ball = Soft::new("ball", icosphere(RADIUS, 1));
    ball.mesh.vertices.iter_mut().for_each(|x| *x = turn * *x);
    let is_low = |v: &u32| ball.mesh.vertices[*v as usize].z < -0.7 * RADIUS;
    ball.held = (0..ball.mesh.vertices.len() as u32)
        .filter(is_low)
        .collect();
    // The corner of the plate, turned by 45 degrees, is this far from its centre.
    let corner = f64::hypot(0.2, 0.35);
    let (over, turned) = (corner + RADIUS + 1e-3, f64::atan2(0.35, 0.2).to_degrees());
    let blade = format!(
        "[[bone]]\nname = 'blade'\nshape = 'press-plate'\n[bone.motion]\n\
         centre = ['0 m', '0 m', '0 m']\naxis = [0, 1, 0]\nkeys = [\n\
         {{ frame = 0, angle = '{turned} deg', translation = ['4 mm', '3 mm', '{over} m'] }},\n\
         {{ frame = {FRAMES}, angle = '{turned} deg', translation = ['4 mm', '3 mm', '{} m'] }}]\n",
        over - depth
    );
    let contact =
        format!("[effects.contact]\nthickness = '0.2 mm'\nfriction = 0\nbetween = {ALL}\n");
    let more = format!("{blade}{EFFECTS}{contact}{QUASI_STATIC}");
    let all = [ball];
    simulation(&scene(&text(&all, FRAMES, &more)), &all)
}

/// Pairs of triangles of the ball and of a bone that cross.
fn crossed_bones(run: &Simulation) -> usize {
    let at = |b: usize| {
        run.bones[b]
            .vertices
            .iter()
            .map(move |x| run.placed()[b].now * x)
    };
    let bones: Vec<Vec<Point3<f64>>> = (0..run.bones.len()).map(|b| at(b).collect()).collect();
    let surface = |name, rigid, vertices, triangles| AuditedSurface {
        name,
        rigid,
        vertices,
        triangles,
        held: &[],
    };
    let body = &run.bodies[0];
    let x = &body.system.particles.position;
    let mut all = vec![surface("", false, x, &body.rest.triangles)];
    for (b, vertices) in bones.iter().enumerate() {
        let name = &run.placed()[b].name;
        all.push(surface(name, true, vertices, &run.bones[b].triangles));
    }
    Audit::new().frame(&all).crossings.soft_rigid
}

#[test]
fn a_lone_minimum_that_crosses_a_bone_is_kept_apart_by_pairs_from_there_on() {
    let mut run = bladed(8e-3);
    let mut resumed = None;
    for frame in 1..=FRAMES {
        run.step_frame();
        assert_eq!(crossed_bones(&run), 0, "{frame}");
        if let Some(again) = &mut resumed {
            Simulation::step_frame(again);
            assert!(bits(&run) == bits(again), "frame {frame}");
        }
        let is_told = run
            .notes
            .iter()
            .any(|note| note.contains("pairs of triangles"));
        if is_told && resumed.is_none() && frame < FRAMES {
            let fingerprint = Fingerprint::of(&run);
            let mut again = bladed(8e-3);
            let kept = save(&run, &fingerprint, b"");
            let checkpoint = Checkpoint::open(&kept).expect("a whole checkpoint");
            let restored = checkpoint.restore(&mut again, &fingerprint);
            restored.expect("a state of the same scene");
            resumed = Some(again);
        }
    }
    assert!(
        resumed.is_some(),
        "control: it crosses alone, {:?}",
        run.notes
    );
    assert!(run.certificate().pairs > 0 && run.certificate().open == 0);
    assert!(crossed_bones(&run) == 0 && run.bodies[0].stopped.is_none());
}

#[test]
fn a_minimum_that_cannot_be_kept_apart_says_so() {
    // The corner goes through the whole ball, which is held below.
    let mut run = bladed(0.1);
    let mut crossed = 0;
    for frame in 1..=FRAMES {
        run.step_frame();
        let (now, open) = (crossed_bones(&run), run.certificate().open);
        assert!(
            now == 0 || open > 0,
            "frame {frame}: {now} pairs cross, {open} are open"
        );
        crossed += now;
    }
    assert!(crossed > 0, "control: it cannot be kept apart");
}
