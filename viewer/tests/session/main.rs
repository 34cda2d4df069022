//! A session shows the results of its simulation, obeys commands, and ends on command. No
//! window is needed.

mod biceps;
mod ends;
mod lattice;
mod panel;
mod replay;
mod retune;
mod skin;

use std::sync::Arc;
use std::time::{Duration, Instant};

use nalgebra::{Point3, Vector3};
use pliant::simulation::Simulation;
use pliant_viewer::{Command, MOST_TURN, Pace, Recipe, Session, Snapshot, Speed, Steering};

/// A guard against a hang, not a measured limit.
const LONG: Duration = Duration::from_secs(300);

/// The hip, coarse.
const HIP: [&str; 2] = ["muscle.0.edge_length=9 mm", "substeps=10"];

fn recipe(name: &str, overrides: &[&str]) -> Recipe {
    let overrides: Vec<String> = overrides.iter().map(|o| (*o).to_owned()).collect();
    Recipe::find(name, &overrides).unwrap_or_else(|e| panic!("{}", e.terse()))
}

fn session(name: &str, overrides: &[&str], pace: Pace) -> Session {
    Session::start(recipe(name, overrides), pace).unwrap_or_else(|e| panic!("{e}"))
}

fn simulation(name: &str, overrides: &[&str]) -> Simulation {
    let scene = recipe(name, overrides)
        .scene()
        .unwrap_or_else(|e| panic!("{}", e.terse()));
    Simulation::new(scene).unwrap_or_else(|e| panic!("{}", e.terse()))
}

fn answer_to(session: &Session, command: Command) -> Arc<Snapshot> {
    let number = session.send(command.clone());
    session
        .wait(LONG, |shot| shot.answered >= number)
        .unwrap_or_else(|| panic!("no answer to {command:?}"))
}

/// [`answer_to`] for a command that must be accepted.
fn done(session: &Session, command: Command) -> Arc<Snapshot> {
    let before = session.latest().refused.clone();
    let shot = answer_to(session, command.clone());
    assert_eq!(shot.refused, before, "{command:?}");
    shot
}

fn why_refused(session: &Session, command: Command) -> String {
    let number = session.send(command);
    let shot = session
        .wait(LONG, |shot| shot.answered >= number)
        .expect("an answer");
    let (refused, why) = shot.refused.clone().unwrap_or_default();
    assert_eq!(refused, number, "nothing was refused");
    why
}

fn assert_refused(session: &Session, command: &Command, says: &str) {
    let why = why_refused(session, command.clone());
    assert!(why.contains(says), "{command:?}: {why}");
}

fn set(path: &str, value: &str) -> Command {
    Command::Set {
        path: path.to_owned(),
        value: value.to_owned(),
    }
}

fn bits(positions: &[Point3<f64>]) -> Vec<u64> {
    positions
        .iter()
        .flat_map(|p| p.coords.iter().map(|c| c.to_bits()).collect::<Vec<_>>())
        .collect()
}

/// The scene with its changes.
fn scene_of(shot: &Snapshot) -> &pliant::scene::Scene {
    shot.scene.as_deref().expect("a scene of muscles")
}

/// Bits of all positions of a snapshot.
fn shown(shot: &Snapshot) -> Vec<Vec<u64>> {
    shot.bodies
        .iter()
        .map(|muscle| bits(&muscle.positions))
        .collect()
}

/// Bits of all positions of a simulation.
fn computed(simulation: &Simulation) -> Vec<Vec<u64>> {
    simulation
        .bodies
        .iter()
        .map(|body| bits(&body.system.particles.position))
        .collect()
}

#[test]
fn the_start_is_there_at_once_and_frames_follow() {
    for (name, overrides) in [("hip", &HIP[..]), ("distance", &[])] {
        let session = session(name, overrides, Pace::free());
        let first = session.latest();
        assert_eq!(first.bodies.len(), session.latest().stage.bodies.len());
        assert_eq!(first.bones.len(), session.latest().stage.bones.len());
        let shot = session.wait(LONG, |shot| shot.frame >= 3).expect("frames");
        assert!(shot.running && shot.serial > first.serial);
        assert!(shot.frame_ms > 0.0 && shot.frames_per_second > 0.0 && !shot.effects.is_empty());
        assert!(
            shot.effects.iter().all(|(_, ms)| *ms >= 0.0),
            "{:?}",
            shot.effects
        );
        let muscle = &shot.bodies[0];
        let counts = [muscle.stretch.len(), muscle.depth.len(), muscle.speed.len()];
        assert_eq!(counts, [muscle.positions.len(); 3]);
        assert!(muscle.speed.iter().any(|s| *s > 0.0) && muscle.stopped.is_none());
    }
}

#[test]
fn pause_holds_and_a_step_is_one_frame() {
    let session = session("distance", &[], Pace::free());
    session.wait(LONG, |shot| shot.frame >= 1).expect("frames");
    let paused = done(&session, Command::Pause);
    assert!(!paused.running);
    // Long enough for dozens of frames of this scene. The control below shows that frames come
    // when permitted.
    assert!(
        session
            .wait(Duration::from_millis(200), |shot| shot.frame > paused.frame)
            .is_none()
    );
    for k in 1..=3 {
        assert_eq!(done(&session, Command::Step).frame, paused.frame + k);
    }
    done(&session, Command::Run);
    assert!(
        session
            .wait(LONG, |shot| shot.frame > paused.frame + 10)
            .is_some(),
        "it goes on"
    );
    assert!(
        !done(&session, Command::Step).running,
        "a step ends in a pause"
    );
}

#[test]
fn a_run_that_nobody_steers_has_the_bits_of_a_simulation() {
    for (name, overrides, other) in [
        ("hip", &HIP[..], "muscle.0.material.stretch=290 N/m"),
        ("shape", &[], "pbd.bending=0.5"),
    ] {
        let shot = {
            let session = session(name, overrides, Pace::paused());
            (0..6).for_each(|_| drop(done(&session, Command::Step)));
            session.latest()
        };
        let mut straight = simulation(name, overrides);
        assert_ne!(
            shown(&shot),
            computed(&straight),
            "nothing moves: the test would show nothing"
        );
        (0..6).for_each(|_| straight.step_frame());
        assert_eq!(shown(&shot), computed(&straight), "{name}");
        assert_eq!(shot.frame, straight.frame());
        for (b, bone) in shot.bones.iter().enumerate() {
            assert_eq!(bone.pose, straight.pose(b, 6.0));
        }
        let mut another = simulation(name, &[overrides, &[other]].concat());
        (0..6).for_each(|_| another.step_frame());
        assert_ne!(
            shown(&shot),
            computed(&another),
            "{name}: other numbers must show"
        );
    }
}

#[test]
fn a_reset_is_a_fresh_start_with_the_changes() {
    let session = session("hip", &HIP, Pace::paused());
    let free = free_vertex(&session);
    done(&session, Command::Step);
    done(&session, set("muscle.0.material.stretch", "150 N/m"));
    done(
        &session,
        Command::Fix {
            body: 0,
            vertex: free,
        },
    );
    let to = session.latest().bodies[0].positions[free] + Vector3::new(0.0, 0.0, 0.02);
    done(
        &session,
        Command::Drag {
            body: 0,
            vertex: free,
            to,
            stiffness: None,
        },
    );
    done(
        &session,
        Command::Turn {
            bone: 1,
            angle: 0.5,
        },
    );
    (0..3).for_each(|_| drop(done(&session, Command::Step)));
    let steered = session.latest();
    let mut fresh = simulation(
        "hip",
        &[&HIP[..], &["muscle.0.material.stretch=150 N/m"]].concat(),
    );
    let reset = done(&session, Command::Reset);
    assert_eq!((reset.frame, shown(&reset)), (0, computed(&fresh)));
    for _ in 0..3 {
        done(&session, Command::Step);
        fresh.step_frame();
    }
    let shot = session.latest();
    assert_eq!(shown(&shot), computed(&fresh));
    assert!(shot.bodies[0].fixed.is_empty() && shot.bodies[0].dragged.is_none());
    assert_eq!(shot.bones[1].steering, Steering::Motion);
    assert_ne!(
        shown(&steered),
        shown(&shot),
        "what was reset had done nothing"
    );
}

/// The vertex of the first muscle that is farthest from those fixed to bones.
fn free_vertex(session: &Session) -> usize {
    let shot = session.latest();
    let x = &shot.bodies[0].positions;
    let held = &shot.stage.bodies[0].held;
    let away = |v: usize| {
        held.iter()
            .map(|&h| (x[v] - x[h as usize]).norm())
            .fold(f64::INFINITY, f64::min)
    };
    (0..x.len())
        .max_by(|&a, &b| away(a).total_cmp(&away(b)))
        .unwrap_or(0)
}

#[test]
fn other_numbers_go_on_from_where_it_is() {
    let session = session("hip", &HIP, Pace::paused());
    (0..4).for_each(|_| drop(done(&session, Command::Step)));
    let before = session.latest();
    let after = done(&session, set("muscle.gluteus.material.stretch", "100 N/m"));
    assert_eq!(
        (after.frame, shown(&after)),
        (4, shown(&before)),
        "a change alone moves nothing"
    );
    assert_eq!(scene_of(&after).muscles[0].material.stretch, 100.0);
    let softer = done(&session, Command::Step);
    let mut straight = simulation("hip", &HIP);
    (0..5).for_each(|_| straight.step_frame());
    assert_ne!(
        shown(&softer),
        computed(&straight),
        "softer, it moves otherwise"
    );
    // The same number again changes nothing, except for a fresh lookup. The motion is unchanged
    // to a part of the motion of a frame.
    let restored = Command::Restore {
        path: "muscle.gluteus.material.stretch".to_owned(),
    };
    assert_eq!(
        scene_of(&done(&session, restored)).muscles[0]
            .material
            .stretch,
        300.0
    );
    for solver in ["quasi_static", "pbd", "implicit_euler", "xpbd"] {
        let changed = done(&session, set("solver", solver));
        assert_eq!(shown(&changed), shown(&softer), "{solver}");
    }
    assert_eq!(done(&session, Command::Step).frame, 6);
}

#[test]
fn a_change_of_nothing_changes_next_to_nothing() {
    let apart = |change: Option<&str>| {
        let session = session("hip", &HIP, Pace::paused());
        (0..4).for_each(|_| drop(done(&session, Command::Step)));
        change
            .into_iter()
            .for_each(|value| drop(done(&session, set("muscle.0.material.stretch", value))));
        let shot = done(&session, Command::Step);
        let mut straight = simulation("hip", &HIP);
        (0..5).for_each(|_| straight.step_frame());
        let x = &straight.bodies[0].system.particles.position;
        x.iter()
            .zip(&shot.bodies[0].positions)
            .map(|(a, b)| (a - b).norm())
            .fold(0.0, f64::max)
    };
    assert_eq!(apart(None), 0.0);
    let (same, other) = (apart(Some("300 N/m")), apart(Some("30 N/m")));
    assert!(
        same <= 0.05 * other && other > 0.0,
        "the same number moved by {same:e} m, another by {other:e} m"
    );
}

#[test]
fn what_cannot_be_is_refused_with_its_reason_and_changes_nothing() {
    let session = session("hip", &HIP, Pace::paused());
    done(&session, Command::Step);
    let before = session.latest();
    let held = session.latest().stage.bodies[0].held[0] as usize;
    let to = Point3::origin();
    let drag = |body, vertex, stiffness| Command::Drag {
        body,
        vertex,
        to,
        stiffness,
    };
    for (command, says) in [
        (set("effects.contact.friction", "-1"), "at least zero"),
        (set("effects.volume.pressure", "3"), "from 0.5 to 2"),
        (set("muscle.0.material.stretch", "100 mm"), "unit of length"),
        (
            set("muscle.0.material.strech", "100 N/m"),
            "did you mean `stretch`",
        ),
        (
            set("muscle.0.edge_length", "5 mm"),
            "start again with another `muscle.0.edge_length`",
        ),
        (
            set("muscle.0.attachment.0.near", "0.000001 mm"),
            "attachment of muscle `gluteus` to `socket`",
        ),
        (
            Command::Turn {
                bone: 0,
                angle: 0.1,
            },
            "bone `socket` has no joint",
        ),
        (
            Command::Turn {
                bone: 1,
                angle: f64::NAN,
            },
            "an angle cannot be NaN",
        ),
        (
            Command::Turn {
                bone: 7,
                angle: 0.1,
            },
            "there is no bone 7; the scene has 2",
        ),
        (
            Command::Fix {
                body: 0,
                vertex: held,
            },
            "held by a bone",
        ),
        (
            Command::Fix {
                body: 0,
                vertex: 1_000_000,
            },
            "there is no vertex 1000000",
        ),
        (drag(0, held, None), "held by a bone"),
        (drag(3, 0, None), "there is no muscle 3; the scene has 1"),
        (
            drag(0, free_vertex(&session), Some(-1.0)),
            "the stiffness of the spring cannot be -1",
        ),
        (Command::Speed(Speed::Share(0.0)), "the speed cannot be 0"),
    ] {
        assert_refused(&session, &command, says);
    }
    let after = session.latest();
    assert_eq!((after.frame, shown(&after)), (before.frame, shown(&before)));
    assert_eq!(after.scene, before.scene);
    let mut straight = simulation("hip", &HIP);
    (0..2).for_each(|_| straight.step_frame());
    assert_eq!(shown(&done(&session, Command::Step)), computed(&straight));
}

/// A vertex is dragged for some frames and released for the same number. Returns its distance
/// from the place before, during and after the drag.
fn dragged(name: &str, overrides: &[&str], frames: usize, drags: bool) -> [f64; 3] {
    let session = session(name, overrides, Pace::paused());
    let free = free_vertex(&session);
    let start = session.latest().bodies[0].positions.clone();
    let size = start
        .iter()
        .map(|p| (p - start[0]).norm())
        .fold(0.0, f64::max);
    let outward = (start[free].coords
        - start.iter().map(|p| p.coords).sum::<Vector3<f64>>() / start.len() as f64)
        .normalize();
    let to = start[free] + outward * (0.2 * size);
    let away = |shot: &Snapshot| (shot.bodies[0].positions[free] - to).norm();
    if drags {
        let shot = done(
            &session,
            Command::Drag {
                body: 0,
                vertex: free,
                to,
                stiffness: None,
            },
        );
        assert_eq!(shot.bodies[0].dragged, Some((free as u32, to)));
    }
    let before = away(&session.latest());
    (0..frames).for_each(|_| drop(done(&session, Command::Step)));
    let pulled = away(&session.latest());
    assert_eq!(
        done(&session, Command::LetGo { body: 0 }).bodies[0].dragged,
        None
    );
    (0..frames).for_each(|_| drop(done(&session, Command::Step)));
    let end = session.latest();
    assert!(end.failed.is_none() && end.bodies[0].stopped.is_none());
    [before, pulled, away(&end)]
}

#[test]
fn a_dragged_vertex_comes_and_goes_back_when_let_go() {
    let still = ["bone.femur.motion.keys=[{frame=0,angle='0 rad'}]"];
    for solver in [
        "solver=xpbd",
        "solver=pbd",
        "solver=quasi_static",
        "solver=implicit_euler",
    ] {
        let coarse = ["muscle.0.edge_length=9 mm", still[0], solver];
        let [before, pulled, after] = dragged("hip", &coarse, 20, true);
        assert!(pulled < 0.7 * before, "{solver}: {before} to {pulled} m");
        assert!(
            after > pulled + 0.5 * (before - pulled),
            "{solver}: let go at {pulled} m, then at {after} of {before} m"
        );
        let [before, pulled, _] = dragged("hip", &coarse, 20, false);
        assert!(
            !(pulled < 0.7 * before),
            "{solver}: it comes without being dragged"
        );
    }
}

#[test]
fn a_fixed_vertex_stays_until_it_is_freed() {
    for solver in ["solver=xpbd", "solver=pbd", "solver=quasi_static"] {
        let session = session(
            "hip",
            &["muscle.0.edge_length=9 mm", solver],
            Pace::paused(),
        );
        let free = free_vertex(&session);
        done(&session, Command::Step);
        let fixed = done(
            &session,
            Command::Fix {
                body: 0,
                vertex: free,
            },
        );
        assert_eq!(fixed.bodies[0].fixed, [free as u32]);
        (0..10).for_each(|_| drop(done(&session, Command::Step)));
        let held = session.latest();
        assert_eq!(
            held.bodies[0].positions[free], fixed.bodies[0].positions[free],
            "{solver}"
        );
        done(
            &session,
            Command::Free {
                body: 0,
                vertex: free,
            },
        );
        (0..10).for_each(|_| drop(done(&session, Command::Step)));
        let freed = session.latest();
        assert_ne!(
            freed.bodies[0].positions[free], held.bodies[0].positions[free],
            "{solver}"
        );
    }
}

#[test]
fn a_bone_turns_by_hand_no_faster_than_it_may_and_goes_back_to_its_motion() {
    let session = session("hip", &HIP, Pace::paused());
    let angle = |shot: &Snapshot| shot.bones[1].angle.expect("a joint");
    assert!(session.latest().bones[0].angle.is_none());
    (0..3).for_each(|_| drop(done(&session, Command::Step)));
    let begin = angle(&session.latest());
    assert!((begin - 0.03).abs() < 1e-9, "{begin}");
    done(
        &session,
        Command::Turn {
            bone: 1,
            angle: 0.2,
        },
    );
    let mut last = begin;
    for _ in 0..8 {
        let now = angle(&done(&session, Command::Step));
        assert!(
            now - last <= MOST_TURN * (1.0 + 1e-9) && now >= last,
            "{last} {now}"
        );
        last = now;
    }
    let shot = session.latest();
    assert!(
        (last - 0.2).abs() < 1e-9 && shot.bones[1].steering == Steering::Hand,
        "{last}"
    );
    let changed = done(&session, set("contact.friction", "0.1"));
    assert!(
        (angle(&changed) - 0.2).abs() < 1e-9,
        "a change keeps it where the hand put it"
    );
    done(&session, Command::ByMotion { bone: 1 });
    assert_eq!(
        done(&session, Command::Step).bones[1].steering,
        Steering::Return
    );
    (0..20).for_each(|_| drop(done(&session, Command::Step)));
    let back = session.latest();
    assert_eq!(back.bones[1].steering, Steering::Motion);
    assert_eq!(
        back.bones[1].pose,
        simulation("hip", &HIP).pose(1, back.frame as f64)
    );
    assert!(back.bodies[0].stopped.is_none());
}

#[test]
fn a_reader_does_not_wait_for_a_slow_frame_and_dropping_ends_the_thread() {
    // A frame takes seconds, so the start is read meanwhile.
    let slow = session(
        "hip",
        &["muscle.0.edge_length=9 mm", "substeps=20000"],
        Pace::free(),
    );
    let begun = Instant::now();
    let serials: Vec<_> = (0..1000).map(|_| slow.latest().serial).collect();
    let reading = begun.elapsed();
    let latest = slow.latest();
    assert!(
        latest.frame == 0 && serials.iter().all(|serial| *serial == serials[0]),
        "20,000 steps took no time"
    );
    // The thread owns the scene while the thread exists.
    let scene = Arc::downgrade(latest.scene.as_ref().expect("a scene"));
    drop(latest);
    assert!(
        scene.upgrade().is_some(),
        "nobody has it: the test would show nothing"
    );
    drop(slow);
    assert!(scene.upgrade().is_none(), "the thread goes on");
    assert!(
        begun.elapsed() > reading * 2,
        "reading took as long as the frame"
    );
}
