//! A lattice in a session: as computed by `pliant run`, dragged by hand, with other springs
//! during the run.

use nalgebra::{Point3, Vector3};
use pliant::scene::Content;
use pliant::scene::builtin::load_content;
use pliant::simulation::LatticeRun;
use pliant_viewer::{Command, Pace, Session, Snapshot, Tissue};

use super::ends::at_both_ends;
use super::{answer_to, assert_refused, bits, done, set, shown};
use pliant::testing::tolerances::{T9, worst};

const SMALL: &str = "lattice.points=[5,5,6]";
/// Only the hand moves the lattice.
const STILL: &str = "lattice.drag=['0 mm','0 mm','0 mm']";

fn lattice(overrides: &[&str]) -> Session {
    super::session("lattice", &[&[SMALL], overrides].concat(), Pace::paused())
}

fn straight(overrides: &[&str]) -> LatticeRun {
    let all: Vec<String> = [SMALL]
        .iter()
        .chain(overrides)
        .map(|o| (*o).to_owned())
        .collect();
    match load_content("lattice", &all).expect("a scene") {
        Content::Lattice(scene) => LatticeRun::new(*scene).expect("a lattice"),
        _ => panic!("a lattice"),
    }
}

fn apart(a: &[Point3<f64>], b: &[Point3<f64>]) -> f64 {
    worst(a.iter().zip(b).map(|(a, b)| (a - b).norm()))
}

/// A vertex in the middle of a side.
fn middle(shot: &Snapshot) -> usize {
    let at = Point3::new(0.08, 0.04, 0.06);
    let x = &shot.bodies[0].positions;
    (0..x.len())
        .min_by(|&a, &b| (x[a] - at).norm().total_cmp(&(x[b] - at).norm()))
        .expect("vertices")
}

#[test]
fn nobody_steers_and_it_has_the_bits_of_a_run() {
    let (session, mut run) = (lattice(&[]), straight(&[]));
    let first = session.latest();
    assert_eq!(first.stage.bodies[0].tissue, Tissue::Plain);
    assert_eq!(first.stage.bodies[0].held.len(), 25);
    for _ in 0..4 {
        done(&session, Command::Step);
        run.step();
    }
    let shot = session.latest();
    assert_eq!(
        (shot.frame, bits(&shot.bodies[0].positions)),
        (4, bits(&run.surface_at()))
    );
    assert_ne!(
        shown(&shot),
        shown(&first),
        "nothing moves: the test would show nothing"
    );
    let body = &shot.bodies[0];
    assert!(body.speed.iter().any(|s| *s > 1e-3) && body.stretch.iter().any(|s| *s > 1e-3));
    let value = |name: &str| {
        shot.readings
            .iter()
            .find(|r| r.name == name)
            .expect("a reading")
            .value
    };
    assert!((value("Distance from the start") / 1e3 - run.frames[3].distance).abs() <= T9);
    assert!(value("Kinetic energy") > 0.0 && value("Motion in a frame") > 0.0);
    let mut other = straight(&["lattice.stiffness=90 N/m"]);
    (0..4).for_each(|_| drop(other.step()));
    assert_ne!(
        bits(&shot.bodies[0].positions),
        bits(&other.surface_at()),
        "control"
    );
}

#[test]
fn a_dragged_point_comes_and_goes_back_when_let_go() {
    let away = |drags: bool| {
        let session = lattice(&[STILL]);
        let vertex = middle(&session.latest());
        let from = session.latest().bodies[0].positions[vertex];
        let to = from + Vector3::x() * 0.03;
        let away = |shot: &Snapshot| (shot.bodies[0].positions[vertex] - to).norm();
        if drags {
            let shot = done(
                &session,
                Command::Drag {
                    body: 0,
                    vertex,
                    to,
                    stiffness: None,
                },
            );
            assert_eq!(shot.bodies[0].dragged, Some((vertex as u32, to)));
            // At most half of a spacing of 20 mm.
            assert!((away(&done(&session, Command::Step)) - 0.02).abs() <= T9);
        }
        (0..10).for_each(|_| drop(done(&session, Command::Step)));
        let pulled = away(&session.latest());
        assert!(
            done(&session, Command::LetGo { body: 0 }).bodies[0]
                .dragged
                .is_none()
        );
        (0..120).for_each(|_| drop(done(&session, Command::Step)));
        (pulled, away(&session.latest()))
    };
    let (pulled, after) = away(true);
    assert!(
        pulled == 0.0 && (after - 0.03).abs() < 1e-3,
        "{pulled} m, let go {after} m"
    );
    let (never, _) = away(false);
    assert!(
        (never - 0.03).abs() < 1e-9,
        "control: it comes without being dragged"
    );
}

#[test]
fn a_fixed_point_stays_until_it_is_freed() {
    let session = lattice(&[]);
    let vertex = middle(&session.latest());
    let fixed = done(&session, Command::Fix { body: 0, vertex });
    assert_eq!(fixed.bodies[0].fixed, [vertex as u32]);
    (0..20).for_each(|_| drop(done(&session, Command::Step)));
    let held = session.latest().bodies[0].positions[vertex];
    assert_eq!(held, fixed.bodies[0].positions[vertex]);
    assert!(
        done(&session, Command::Free { body: 0, vertex }).bodies[0]
            .fixed
            .is_empty()
    );
    assert!(
        (done(&session, Command::Step).bodies[0].positions[vertex] - held).norm() > 1e-4,
        "freed, it moves"
    );
    // A point of the highest layer becomes fixed once the scene has released it. It stays at the
    // place of its release.
    (0..10).for_each(|_| drop(done(&session, Command::Step)));
    let shot = session.latest();
    let top = (0..shot.bodies[0].positions.len())
        .max_by(|&a, &b| {
            shot.bodies[0].positions[a]
                .z
                .total_cmp(&shot.bodies[0].positions[b].z)
        })
        .expect("vertices");
    done(
        &session,
        Command::Fix {
            body: 0,
            vertex: top,
        },
    );
    let reset = done(&session, Command::Reset);
    assert!(reset.bodies[0].fixed.is_empty() && reset.frame == 0);
    assert_eq!(
        bits(&reset.bodies[0].positions),
        bits(&straight(&[]).surface_at())
    );
}

#[test]
fn other_springs_go_on_from_where_it_is_as_fast_as_it_is() {
    let after = |value: Option<&str>| {
        let session = lattice(&[]);
        (0..35).for_each(|_| drop(done(&session, Command::Step)));
        let before = session.latest();
        if let Some(value) = value {
            let changed = done(&session, set("lattice.stiffness", value));
            assert_eq!(
                (changed.frame, shown(&changed)),
                (35, shown(&before)),
                "a change alone moves nothing"
            );
            let speeds = changed.bodies[0].speed.iter().zip(&before.bodies[0].speed);
            assert!(worst(speeds.map(|(a, b)| (a - b).abs())) <= T9);
        }
        done(&session, Command::Step).bodies[0].positions.clone()
    };
    let mut run = straight(&[]);
    (0..36).for_each(|_| drop(run.step()));
    assert_eq!(bits(&after(None)), bits(&run.surface_at()));
    // The velocity is rounded once.
    let (same, other) = (
        apart(&after(Some("100 N/m")), &run.surface_at()),
        apart(&after(Some("30 N/m")), &run.surface_at()),
    );
    assert!(
        same <= T9 * 0.1 && other > 1e-4,
        "the same number moved by {same:e} m, another by {other:e} m"
    );
    let session = lattice(&[]);
    done(&session, Command::Step);
    let anew = done(&session, set("lattice.points", "[4,4,4]"));
    assert_eq!((anew.frame, anew.bodies[0].positions.len()), (0, 64 - 8));
}

#[test]
fn every_control_at_both_ends_runs() {
    let session = lattice(&[]);
    (0..31).for_each(|_| drop(done(&session, Command::Step)));
    let refused = at_both_ends(
        &session,
        |_| true,
        |session, context| {
            for _ in 0..3 {
                let shot = done(session, Command::Step);
                assert!(shot.failed.is_none(), "{context}: {:?}", shot.failed);
                let x = &shot.bodies[0].positions;
                assert!(
                    x.iter().all(|p| p.coords.norm() < 1.0),
                    "{context}: it exploded"
                );
            }
        },
    );
    assert_eq!(refused, [""; 0]);
}

#[test]
fn what_cannot_be_is_refused_with_its_reason_and_changes_nothing() {
    let session = lattice(&[]);
    done(&session, Command::Step);
    let before = session.latest();
    let x = &before.bodies[0].positions;
    let low = before.stage.bodies[0].held[0] as usize;
    let top = (0..x.len())
        .find(|v| x[*v].z > 0.099)
        .expect("the highest layer");
    let drag = |vertex, to| Command::Drag {
        body: 0,
        vertex,
        to,
        stiffness: None,
    };
    for (command, says) in [
        (set("lattice.stiffness", "-1 N/m"), "greater than zero"),
        (set("lattice.mass", "1e-12 g"), "step"),
        (set("lattice.points", "[5,5]"), "three whole numbers"),
        (set("lattice.colour", "red"), "colour"),
        (drag(low, Point3::origin()), "choose a vertex above it"),
        (drag(top, Point3::origin()), "has not let it go yet"),
        (drag(10_000, Point3::origin()), "there is no vertex 10000"),
        (
            drag(middle(&before), Point3::new(f64::NAN, 0.0, 0.0)),
            "cannot be NaN",
        ),
        (Command::Fix { body: 1, vertex: 0 }, "there is no body 1"),
        (
            Command::Move {
                handle: 0,
                to: Point3::origin(),
            },
            "there is no handle 0",
        ),
        (
            Command::Turn {
                bone: 0,
                angle: 0.1,
            },
            "there is no bone 0",
        ),
        (Command::Seek { frame: 1 }, "only a finished run"),
    ] {
        assert_refused(&session, &command, says);
    }
    assert_eq!(shown(&session.latest()), shown(&before));
    let mut run = straight(&[]);
    (0..2).for_each(|_| drop(run.step()));
    assert_eq!(
        bits(&answer_to(&session, Command::Step).bodies[0].positions),
        bits(&run.surface_at())
    );
}
