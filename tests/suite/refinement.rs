//! Runs to a requested accuracy: the error is within it, and the stated error is near the real one.

use nalgebra::Point3;
use pliant::accuracy::FrameDistance;
use pliant::scene::{Accuracy, Scene, Solver, builtin};
use pliant::simulation::checkpoint::{Checkpoint, Fingerprint, save};
use pliant::simulation::{Attained, Scenario, Simulation};

type Frames = Vec<Vec<Point3<f64>>>;

/// A scene, and the number of steps of its reference.
struct Case {
    scene: Scene,
    reference: u32,
}

fn case(name: &str, changes: &[&str], reference: u32) -> Case {
    let changes: Vec<String> = changes.iter().map(|&c| c.to_owned()).collect();
    let scene = builtin::load(name, &changes).expect("a scene");
    Case { scene, reference }
}

/// The built-in hip with a coarse mesh, the way there and back in 40 frames, and a cube between plates.
fn cases() -> [Case; 2] {
    let hip = [
        "muscle.0.edge_length=14mm",
        "frames=45",
        "bone.1.motion.keys.1.frame=20",
        "bone.1.motion.keys.2.frame=40",
    ];
    [case("hip", &hip, 800), case("cube", &["frames=60"], 1600)]
}

/// The frames of a run, and what it says of its accuracy.
fn run(scene: &Scene) -> (Frames, Option<Attained>) {
    let mut run = Simulation::new(scene.clone()).expect("meshes");
    let frames = (0..scene.frames).map(|_| {
        run.step_frame();
        let bodies = run.bodies.iter();
        bodies
            .flat_map(|body| body.system.particles.position.iter().copied())
            .collect()
    });
    let frames = frames.collect();
    (frames, run.attained().cloned())
}

fn with_steps(scene: &Scene, steps: u32) -> Scene {
    let mut scene = scene.clone();
    scene.adapts_steps = false;
    if let Solver::Xpbd(xpbd) = &mut scene.solver {
        xpbd.substeps = steps;
    }
    scene
}

fn to(scene: &Scene, share: f64) -> Scene {
    Scene {
        accuracy: Some(Accuracy::Share(share)),
        ..scene.clone()
    }
}

#[test]
fn an_accuracy_is_kept_and_the_stated_error_is_near_the_real_one() {
    for Case { scene, reference } in cases() {
        let name = &scene.name;
        let (exact, _) = run(&with_steps(&scene, reference));
        let off = |frames: &Frames| FrameDistance::between(&exact, frames).rms;
        let mut before = 0;
        for share in [0.03, 0.01, 0.004] {
            let (frames, attained) = run(&to(&scene, share));
            let attained = attained.expect("an accuracy");
            let (error, target) = (off(&frames), attained.target_m);
            assert!(attained.is_reached(), "{name}, {share}: {attained:?}");
            assert!(error <= target, "{name}, {share}: {error} {target}");
            // Between half the real error and four times it, where it is not rounding.
            let told = attained.error_m / error;
            let is_small = error <= 2e-4 * target / share;
            assert!(
                (0.5..=4.0).contains(&told) || is_small,
                "{name}, {share}: {told}"
            );
            let steps = attained.steps[1];
            assert!(steps >= before, "{name}, {share}: {steps} {before}");
            before = steps;
        }
        // Control: with few steps the error is beyond the least target.
        let (rough, _) = run(&with_steps(&scene, 4));
        let length = scene_length(&scene);
        assert!(!(off(&rough) <= 0.004 * length), "{name}: {}", off(&rough));
    }
}

/// Length of the muscle [m].
fn scene_length(scene: &Scene) -> f64 {
    Simulation::new(scene.clone()).expect("meshes").bodies[0].length
}

#[test]
fn a_share_of_the_motion_is_one_of_the_motion_that_the_result_has() {
    let [Case { scene, reference }, _] = cases();
    let (exact, _) = run(&with_steps(&scene, reference));
    let start: Vec<_> = Simulation::new(scene.clone()).expect("meshes").bodies[0]
        .system
        .particles
        .position
        .clone();
    let moved = FrameDistance::between(&vec![start; exact.len()], &exact).rms;
    let asked = Scene {
        accuracy: Some(Accuracy::OfMotion(0.03)),
        ..scene.clone()
    };
    let (frames, attained) = run(&asked);
    let attained = attained.expect("an accuracy");
    assert!(
        (attained.motion_m - moved).abs() <= 0.05 * moved,
        "{attained:?} {moved}"
    );
    let error = FrameDistance::between(&exact, &frames).rms;
    assert!(
        attained.is_reached() && error <= 0.03 * moved,
        "{error} {attained:?}"
    );
    assert!(attained.target_m <= 0.03 * moved);
    // Control: the muscle does not move by its length.
    assert!(moved <= 0.7 * scene_length(&scene), "{moved}");
    // Equilibria too. Frame 0 again, after some frames, is as at the start.
    let short = Scene {
        frames: 6,
        solver: pliant::scene::SolverQuestion::Equilibrium.minimised(1, 1e-4),
        ..asked
    };
    let mut again = Simulation::new(short).expect("meshes");
    let start = again.save_state().expect("a state");
    assert!(
        !again.attained().expect("an accuracy").is_reached(),
        "nothing is known"
    );
    let run = |run: &mut Simulation| {
        (0..3).for_each(|_| run.step_frame());
        let attained = run.attained().expect("an accuracy");
        (
            attained.target_m,
            attained.motion_m,
            run.bodies[0].system.particles.position.clone(),
        )
    };
    let first = run(&mut again);
    again.restore_state(&start).expect("its own state");
    assert_eq!(run(&mut again), first);
    assert!(first.0 > 0.0 && first.1 > first.0);
}

#[test]
fn equilibria_have_an_accuracy_by_their_tolerance() {
    let [Case { mut scene, .. }, _] = cases();
    // Half of the way there, without bones to slide on: a net of springs can fold in different ways.
    (scene.frames, scene.effects.contact) = (10, None);
    scene.solver = pliant::scene::SolverQuestion::Equilibrium.minimised(1, 1e-7);
    let (exact, _) = run(&scene);
    let (frames, attained) = run(&to(&scene, 0.01));
    let attained = attained.expect("an accuracy");
    let error = FrameDistance::between(&exact, &frames).rms;
    assert!(
        attained.is_reached() && error <= attained.target_m,
        "{error} {attained:?}"
    );
    assert!(attained.tolerance > 0.0);
    // Control: the greatest tolerance alone is farther off than the accuracy that is reached here.
    scene.solver = pliant::scene::SolverQuestion::Equilibrium.minimised(1, 0.3);
    let rough = FrameDistance::between(&exact, &run(&scene).0).rms;
    assert!(rough > error, "{rough} {error}");
}

#[test]
fn what_no_number_of_steps_reaches_is_said_to_be_missed() {
    let [_, Case { mut scene, .. }] = cases();
    scene.frames = 4;
    scene.accuracy = Some(Accuracy::Length(1e-13));
    let (_, attained) = run(&scene);
    let attained = attained.expect("an accuracy");
    assert!(!attained.is_reached(), "{attained:?}");
}

#[test]
fn threads_and_an_interruption_change_no_bit() {
    let [Case { scene, .. }, _] = cases();
    let scene = to(&scene, 0.01);
    let (whole, _) = run(&scene);
    for threads in [1, 2, 5] {
        let mut run = Simulation::new(scene.clone()).expect("meshes");
        run.set_threads(threads);
        (0..10).for_each(|_| run.step_frame());
        assert_eq!(
            run.bodies[0].system.particles.position, whole[9],
            "{threads} threads"
        );
    }
    let mut first = Simulation::new(scene.clone()).expect("meshes");
    (0..15).for_each(|_| first.step_frame());
    let mut second = Simulation::new(scene.clone()).expect("meshes");
    let state = first.save_state().expect("a state");
    second.restore_state(&state).expect("its own state");
    assert_eq!(second.frame(), 15);
    let bytes = save(&first, &Fingerprint::of(&first), &[]);
    let read = Checkpoint::open(&bytes).expect("a checkpoint");
    assert_eq!(read.frame(), Ok(15));
    (15..scene.frames).for_each(|_| second.step_frame());
    assert_eq!(
        Some(&second.bodies[0].system.particles.position),
        whole.last()
    );
}
