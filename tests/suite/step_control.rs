//! Frames in which a surface jumps: they are undone and repeated with shorter steps.

use std::f64::consts::TAU;
use std::ops::ControlFlow;

use nalgebra::{Point3, Vector3};
use pliant::TriangleMesh;
use pliant::mesh::shapes::icosphere;
use pliant::progress::Silent;
use pliant::scene::builtin::load;
use pliant::simulation::checkpoint::{Checkpoint, Fingerprint, save};
use pliant::simulation::{Simulation, Stepped};

use crate::soft::{Soft, bits, positions, scene, simulation, text};

const AROUND: u32 = 24;

/// Number of vertices that each bone holds.
const HELD: u32 = 10;

/// Heights of the rings of the tube [mm]: most of its triangles are slivers.
const RINGS: [f64; 9] = [0.0, 1.0, 2.0, 30.0, 31.0, 60.0, 60.4, 99.0, 100.0];

/// A closed tube with a radius of 5 mm, of needles and slivers, as raw segmentations have them.
fn tube() -> TriangleMesh {
    let mut vertices = Vec::new();
    for (k, z) in RINGS.iter().enumerate() {
        let shift = 0.5 * (k % 2) as f64;
        vertices.extend((0..AROUND).map(|j| {
            let angle = TAU * (f64::from(j) + shift) / f64::from(AROUND);
            Point3::new(5.0 * libm::cos(angle), 5.0 * libm::sin(angle), *z) * 1e-3
        }));
    }
    let last = AROUND * (RINGS.len() as u32 - 1);
    let ends = [last + AROUND, last + AROUND + 1];
    vertices.extend([Point3::new(0.0, 0.0, 0.0), Point3::new(0.0, 0.0, 0.1)]);
    let mut triangles = Vec::new();
    for j in 0..AROUND {
        let next = (j + 1) % AROUND;
        for first in (0..last).step_by(AROUND as usize) {
            let [a, b] = [first + j, first + next];
            triangles.extend([[a, b, b + AROUND], [a, b + AROUND, a + AROUND]]);
        }
        triangles.push([ends[0], next, j]);
        triangles.push([ends[1], last + j, last + next]);
    }
    TriangleMesh {
        vertices,
        triangles,
    }
}

fn pulled(steps: u32) -> Simulation {
    tube_pulled(&format!("substeps = {steps}\n"))
}

/// The tube between a bone at rest and one that turns by 60 degrees in 30 frames.
fn tube_pulled(settings: &str) -> Simulation {
    let last = AROUND * (RINGS.len() as u32 - 1);
    let mut tube = Soft::new("tube", tube());
    // Only a part of each end is held.
    tube.held = (0..HELD).collect();
    let turned: Vec<u32> = (last..last + HELD).collect();
    let more = format!(
        "[[muscle.attachment]]\nbone = 'turning'\nlimit = '100 %'\nvertices = {turned:?}\n\
         [[bone]]\nname = 'turning'\nshape = 'press-plate'\n[bone.motion]\n\
         centre = ['40 mm', '0 mm', '100 mm']\naxis = [0, 1, 0]\n\
         keys = [{{ frame = 0, angle = '0 deg' }}, {{ frame = 30, angle = '60 deg' }}]\n\
         [effects.stretch]\n[effects.bending]\n[effects.damping]\nrate = '5 1/s'\n\
         [solver.xpbd]\n{settings}"
    );
    let bodies = [tube];
    simulation(&scene(&text(&bodies, 30, &more)), &bodies)
}

/// The greatest growth of an edge in a frame, relative to its length before and at rest.
fn growth(run: &Simulation, before: &[Point3<f64>]) -> f64 {
    let now = positions(run, 0);
    let length = |x: &[Point3<f64>], [a, b]: [u32; 2]| (x[a as usize] - x[b as usize]).norm();
    let each = run.bodies[0].edges.iter().map(|edge| {
        let most = length(before, edge.points).max(edge.rest);
        length(now, edge.points) / most
    });
    each.fold(0.0, |a, b| if b <= a { a } else { b })
}

fn jumps(run: &Simulation) -> usize {
    run.notes.iter().filter(|n| n.contains("jumped")).count()
}

#[test]
fn no_surface_jumps_in_a_frame() {
    // With 20 steps, edges of the tube reach 150 times their length where no frame is repeated.
    let mut run = pulled(20);
    for _ in 0..30 {
        let before = positions(&run, 0).to_vec();
        run.step_frame();
        assert_eq!(run.bodies[0].stopped, None);
        let growth = growth(&run, &before);
        assert!(growth <= 2.0, "frame {}: {growth}", run.frame());
    }
    // Control: the steps of the scene are too long, and a frame was repeated.
    assert_eq!(jumps(&run), 1, "{:?}", run.notes);
    // With short steps none is.
    let mut run = pulled(320);
    (0..30).for_each(|_| run.step_frame());
    assert_eq!((jumps(&run), run.bodies[0].stopped.clone()), (0, None));
}

#[test]
fn a_surface_that_jumps_with_the_shortest_steps_stops_at_the_frame_before() {
    // One step of a frame, and sixteen at most.
    let mut run = pulled(1);
    let mut good = positions(&run, 0).to_vec();
    for _ in 0..30 {
        run.step_frame();
        if run.bodies[0].stopped.is_some() {
            break;
        }
        good = positions(&run, 0).to_vec();
    }
    let (frame, broken) = run.bodies[0].stopped.clone().expect("it stops");
    assert!(frame == run.frame() && broken.effect == "divergence");
    assert_eq!(positions(&run, 0), good);
}

#[test]
fn repeated_frames_are_the_same_bits_with_any_threads_and_after_a_resume() {
    let [first, last] = [12, 20];
    let mut checkpoint = Vec::new();
    let mut all = Vec::new();
    for threads in [1, 2, 8] {
        let mut run = pulled(20);
        run.set_threads(threads);
        for frame in 0..last {
            run.step_frame();
            if frame + 1 == first && threads == 1 {
                assert_eq!(jumps(&run), 1);
                checkpoint = save(&run, &Fingerprint::of(&run), b"");
            }
        }
        all.push(bits(&run));
    }
    let mut resumed = pulled(20);
    let print = Fingerprint::of(&resumed);
    let read = Checkpoint::open(&checkpoint).expect("a checkpoint");
    read.restore(&mut resumed, &print).expect("the same scene");
    (first..last).for_each(|_| resumed.step_frame());
    all.push(bits(&resumed));
    assert!(all.iter().all(|bits| *bits == all[0]));
}

#[test]
fn without_a_number_of_steps_every_frame_converges() {
    let unconverged = |run: &mut Simulation| {
        let frames = (0..30).map(|_| {
            run.step_frame();
            usize::from(!run.measure()[0].converged)
        });
        frames.sum::<usize>()
    };
    let mut run = tube_pulled("");
    assert_eq!(unconverged(&mut run), 0);
    for told in ["their number follows", "a residual is above the tolerance"] {
        let notes = run.notes.iter().filter(|n| n.contains(told));
        assert_eq!(notes.count(), 1, "{:?}", run.notes);
    }
    // Control: the same number of steps where it is given, and too loose a tolerance.
    assert!(unconverged(&mut pulled(20)) > 0);
    let mut loose = tube_pulled("tolerance = 0.5\n");
    assert_eq!(unconverged(&mut loose), 0);
    let is_repeated = |n: &String| n.contains("a residual is above the tolerance");
    assert!(!loose.notes.iter().any(is_repeated));
}

#[test]
fn steps_that_do_not_lessen_a_residual_are_not_tried_for_ever() {
    // No number of steps reaches this tolerance.
    let mut run = tube_pulled("tolerance = 1e-12\n");
    (0..6).for_each(|_| run.step_frame());
    assert_eq!((run.frame(), run.bodies[0].stopped.clone()), (6, None));
    assert!(run.measure().iter().all(|measures| !measures.converged));
}

#[test]
fn a_stopped_frame_leaves_everything_as_before() {
    for settings in ["", "substeps = 1000\n"] {
        let mut run = tube_pulled(settings);
        (0..12).for_each(|_| run.step_frame());
        let (before, notes) = (bits(&run), run.notes.clone());
        let never = |_: &str, _: usize, _: usize| ControlFlow::Break(());
        // The progress is asked after some time: an early frame can be done before.
        let mut stopped = 0;
        for _ in 0..3 {
            match run.step_frame_with(&never) {
                Stepped::Interrupted => {
                    stopped += 1;
                    assert_eq!((run.frame(), bits(&run)), (12, before.clone()));
                    assert_eq!(run.notes, notes);
                }
                _ => break,
            }
        }
        let from = run.frame();
        (from..16).for_each(|_| {
            assert_eq!(run.step_frame_with(&Silent), Stepped::Done);
        });
        let mut straight = tube_pulled(settings);
        (0..16).for_each(|_| straight.step_frame());
        assert_eq!(bits(&run), bits(&straight));
        // Control: frames of a thousand steps are long enough for a stop.
        assert!(settings.is_empty() || stopped > 0);
    }
}

#[test]
fn an_edge_that_two_bones_hold_has_its_greatest_length() {
    let run = pulled(20);
    // The ends of the tube are ten centimetres apart.
    assert_eq!(run.held_apart(0), None);
    let ball = icosphere(0.05, 1);
    let edge = first_edge(&ball);
    let mut soft = Soft::new("ball", ball);
    soft.held = vec![edge[0]];
    let more = format!(
        "[[muscle.attachment]]\nbone = 'moving'\nlimit = '100 %'\nvertices = [{}]\n\
         [[bone]]\nname = 'moving'\nshape = 'press-plate'\n[bone.motion]\n\
         keys = [{{ frame = 0 }}, {{ frame = 30, translation = ['0 m', '-9 m', '0 m'] }}]\n\
         [effects.stretch]\n",
        edge[1]
    );
    let bodies = [soft];
    let run = simulation(&scene(&text(&bodies, 30, &more)), &bodies);
    let [a, b] = edge.map(|v| bodies[0].mesh.vertices[v as usize]);
    let expected = (a - b + Vector3::new(0.0, 9.0, 0.0)).norm() / (a - b).norm();
    let (edges, length, bones) = run.held_apart(0).expect("an edge");
    assert!(
        edges == 1 && (length / expected - 1.0).abs() <= 1e-12,
        "{length} {expected}"
    );
    assert_eq!(bones, if edge[0] < edge[1] { [0, 1] } else { [1, 0] });
}

/// The first edge of a mesh.
fn first_edge(mesh: &TriangleMesh) -> [u32; 2] {
    let [a, b, _] = mesh.triangles[0];
    [a, b]
}

#[test]
fn an_equilibrium_that_no_effect_holds_stops_as_diverged() {
    // Only the angles are kept: under its load the tetrahedron grows without end.
    let shape = |solver: &str| {
        let scene = load("shape", &[format!("solver={solver}")]).expect("a scene");
        let mut run = Simulation::new(scene).expect("a scene that runs");
        (0..20).for_each(|_| run.step_frame());
        run
    };
    let run = shape("quasi_static");
    let (frame, broken) = run.bodies[0].stopped.clone().expect("it stops");
    assert_eq!((frame, broken.effect), (1, "divergence"));
    assert!(run.measure()[0].edge_stretch_max.is_finite());
    assert_eq!(
        shape("pbd").bodies[0].stopped,
        None,
        "control: it grows with time"
    );
}
