//! Waiting times of a user who looks at a running simulation: the start, the answer to a
//! slider, a snapshot; and the extra cost of a frame that is shown.
//!
//! The bench uses the built-in hip, paused while a slider moves. The bench asserts that the
//! measured work is done: answers are accepted and change the scene, and a shown run has the bits
//! of a run that is not shown.

#[path = "../../benches/measured/mod.rs"]
mod measured;

use std::sync::Arc;
use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use measured::{compare, in_turn, quartiles, quick, result, seconds};
use nalgebra::Vector3;
use pliant::simulation::Simulation;
use pliant_viewer::{Command, Pace, Recipe, Session, Snapshot};

/// A guard against a hang.
const LONG: Duration = Duration::from_secs(300);

fn recipe() -> Recipe {
    let coarse = [
        "muscle.0.edge_length=9 mm".to_owned(),
        "substeps=10".to_owned(),
    ];
    Recipe::find("hip", if quick() { &coarse } else { &[] }).expect("a built-in scene")
}

fn done(session: &Session, command: Command) -> Arc<Snapshot> {
    let number = session.send(command);
    let shot = session
        .wait(LONG, |shot| shot.answered >= number)
        .expect("an answer");
    assert_eq!(shot.refused, None);
    shot
}

fn set(path: &str, value: &str) -> Command {
    Command::Set {
        path: path.to_owned(),
        value: value.to_owned(),
    }
}

fn rounds(many: usize) -> usize {
    if quick() { 1 } else { many }
}

/// The median of some times.
fn time(name: &str, rounds: usize, mut deed: impl FnMut(usize)) {
    let times: Vec<f64> = (0..rounds).map(|k| seconds(|| deed(k))).collect();
    let [_, median, _] = quartiles(times.clone());
    result(&format!("viewer.{name}.median"), median * 1e3, "ms");
    result(
        &format!("viewer.{name}.greatest"),
        times.into_iter().fold(0.0, f64::max) * 1e3,
        "ms",
    );
}

/// From nothing to the first snapshot.
fn start(_: &mut Criterion) {
    time("start", rounds(7), |_| {
        let session = Session::start(recipe(), Pace::paused()).expect("a session");
        assert_eq!(session.latest().frame, 0);
        let count = session.latest().bodies[0].positions.len();
        assert!(quick() || count == 5354, "{count} vertices");
    });
}

/// From a command to the snapshot with its answer.
fn changes(_: &mut Criterion) {
    let session = Session::start(recipe(), Pace::paused()).expect("a session");
    (0..3).for_each(|_| drop(done(&session, Command::Step)));
    let sliders: [(&str, &str, &[&str]); 8] = [
        ("friction", "effects.contact.friction", &["0.3", "0.2"]),
        (
            "thickness",
            "effects.contact.thickness",
            &["0.4 mm", "0.7 mm"],
        ),
        (
            "stiffness",
            "muscle.0.material.stretch",
            &["250 N/m", "290 N/m"],
        ),
        ("anisotropy", "effects.anisotropy.strength", &["0.5", "0.4"]),
        ("iterations", "solver.xpbd.iterations", &["2", "3"]),
        ("order", "solver.xpbd.order", &["stored", "coloured"]),
        ("contact-off-and-on", "effects.contact", &["off", "on"]),
        (
            "solver",
            "solver",
            &["pbd", "quasi_static", "implicit_euler", "xpbd"],
        ),
    ];
    for (name, path, values) in sliders {
        let scenes = [
            session.latest().scene.clone(),
            done(&session, set(path, values[0])).scene.clone(),
        ];
        assert_ne!(scenes[0], scenes[1], "{name} is as it was");
        time(name, rounds(4 * values.len()), |k| {
            drop(done(&session, set(path, values[k % values.len()])))
        });
        done(
            &session,
            Command::Restore {
                path: path.to_owned(),
            },
        );
    }
    let stage = session.latest().stage.clone();
    let vertex = (0..)
        .find(|v| !stage.bodies[0].held.contains(v))
        .expect("a free vertex") as usize;
    time("fix-and-free", rounds(8), |k| {
        let command = if k % 2 == 0 {
            Command::Fix { body: 0, vertex }
        } else {
            Command::Free { body: 0, vertex }
        };
        done(&session, command);
    });
    // A command that needs only a snapshot.
    time("snapshot", rounds(20), |_| {
        drop(done(&session, Command::Pause))
    });
}

/// From a move of a handle to the snapshot with the handle there, for an implant that is a dome
/// over skin at rest.
fn handles(_: &mut Criterion) {
    for (name, scene) in [
        (
            "node",
            concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/biceps.toml"),
        ),
        ("implant", "flat-implant"),
    ] {
        let recipe = Recipe::find(scene, &[]).unwrap_or_else(|e| panic!("{}", e.terse()));
        let session = Session::start(recipe, Pace::paused()).expect("a session");
        let handle = session.latest().handles.len() / 2;
        let from = session.latest().handles[handle].at;
        time(name, rounds(20), |k| {
            // Further from the axis, over the sheet, at another place each time.
            let to = from + Vector3::new(0.0, 1e-4 * (k + 1) as f64, 0.0);
            let before = session.latest().handles[handle].at;
            let number = session.send(Command::Move { handle, to });
            let there =
                |shot: &Snapshot| shot.answered >= number && shot.handles[handle].at != before;
            let shot = session.wait(LONG, there).expect("it comes");
            assert_eq!(shot.refused, None);
        });
    }
}

/// Frames of a simulation with published snapshots, compared with frames of a simulation
/// without.
fn shown(_: &mut Criterion) {
    let session = Session::start(recipe(), Pace::paused()).expect("a session");
    let scene = recipe().scene().expect("a built-in scene");
    let mut alone = Simulation::new(scene).expect("a simulation");
    let times = in_turn(
        rounds(60),
        || drop(done(&session, Command::Step)),
        || alone.step_frame(),
    );
    let shot = session.latest();
    assert_eq!(shot.frame, alone.frame());
    assert!(
        shot.bodies[0].positions == alone.bodies[0].system.particles.position,
        "to be seen has changed bits"
    );
    compare("viewer.frame", ["shown", "alone"], &times);
}

criterion_group!(benches, start, changes, handles, shown);
criterion_main!(benches);
