//! Skin in a session: as computed by `pliant run`, with moved and changed implants and
//! abandoned equilibria.

use std::sync::Arc;
use std::time::{Duration, Instant};

use nalgebra::{Point3, Vector3};
use pliant::mesh::measures;
use pliant::progress::Silent;
use pliant::scene::Content;
use pliant::scene::builtin::load_content;
use pliant::simulation::{SkinRun, Stepped};
use pliant_viewer::{Command, Pace, Session, Snapshot, Tissue};

use super::ends::at_both_ends;
use super::{LONG, answer_to, assert_refused, bits, done, session, set, shown};
use pliant::testing::tolerances::{T6, T9, worst};

/// Coarse, because the test compares the session and not the skin.
const FLAT: [&str; 2] = ["skin.0.edge_length=10 mm", "sheet.cells=24"];
const SCALP: [&str; 1] = ["skin.0.edge_length=9 mm"];

fn straight(name: &str, overrides: &[&str], frames: usize) -> SkinRun {
    let all: Vec<String> = overrides.iter().map(|o| (*o).to_owned()).collect();
    let Content::Skin(scene) = load_content(name, &all).expect("a scene") else {
        panic!("skin")
    };
    let mut run = SkinRun::new(*scene).expect("skin");
    (0..frames).for_each(|_| assert_eq!(run.step(&Silent), Stepped::Done));
    run
}

fn computed(run: &SkinRun) -> Vec<Vec<u64>> {
    let shells = run.parts.iter().flat_map(|part| part.shells_at());
    [bits(&run.skin_at())]
        .into_iter()
        .chain(shells.map(bits))
        .collect()
}

fn reading(shot: &Snapshot, name: &str) -> f64 {
    shot.readings
        .iter()
        .find(|r| r.name == name)
        .unwrap_or_else(|| panic!("no {name}"))
        .value
}

fn frame(session: &Session, frame: usize) -> Arc<Snapshot> {
    session
        .wait(LONG, |shot| shot.frame == frame || shot.failed.is_some())
        .expect("a frame")
}

/// The first snapshot of newly prepared skin.
fn arrived(session: &Session, before: &Snapshot) -> Arc<Snapshot> {
    session
        .wait(LONG, |shot| !Arc::ptr_eq(&shot.stage, &before.stage))
        .expect("skin made ready")
}

fn move_to(session: &Session, x: f64, y: f64) -> Arc<Snapshot> {
    // From above, because the skin may be lifted.
    answer_to(
        session,
        Command::Move {
            handle: 0,
            to: Point3::new(x, y, 0.05),
        },
    )
}

#[test]
fn nobody_steers_and_it_has_the_bits_of_a_run() {
    for (name, overrides, other) in [
        ("expander", &SCALP[..], "implant.fill.0.volume=9 cc"),
        ("flat-implant", &FLAT[..], "implant.volume=90 cc"),
        (
            "sheet",
            &["sheet.cells=16", "frames=2"][..],
            "ball.radius=2.4 mm",
        ),
    ] {
        let session = session(name, overrides, Pace::paused());
        let start = session.latest();
        assert_eq!(
            shown(&start),
            computed(&straight(name, overrides, 0)),
            "{name}"
        );
        let shot = done(&session, Command::Step);
        let run = straight(name, overrides, 1);
        assert_eq!((shot.frame, shown(&shot)), (1, computed(&run)), "{name}");
        assert_ne!(shown(&start), shown(&shot), "{name}: nothing moves");
        let control = straight(name, &[overrides, &[other]].concat(), 1);
        assert_ne!(
            shown(&shot),
            computed(&control),
            "{name}: other numbers must show"
        );
        let areas = run.parts[0].frames[0].areas;
        assert!((reading(&shot, "Area gained") / 1e4 - areas.gain()).abs() <= T9);
        assert!(
            (reading(&shot, "Area") / 1e4 - areas.deformed).abs() <= T9
                && reading(&start, "Area gained") == 0.0
        );
        assert!((reading(&shot, "Greatest stretch") / 100.0 + 1.0 - areas.stretch_max).abs() <= T9);
        assert!(
            shot.bodies[0].stretch.iter().any(|s| *s > 0.01)
                && shot.stage.bodies[0].tissue == Tissue::Skin
        );
        if name == "sheet" {
            assert!(
                shot.handles.is_empty() && shot.bones[0].pose != start.bones[0].pose,
                "the ball comes up"
            );
            continue;
        }
        let (volume, pressure) = run.parts[0].frames[0].shells[0];
        assert!((reading(&shot, "Volume") / 1e6 - volume).abs() <= T9);
        assert!(
            (reading(&shot, "Pressure") * 1e3 - pressure).abs() <= T6 * pressure && pressure > 0.0
        );
        assert_eq!(shot.stage.bodies[1].tissue, Tissue::Implant);
        assert!(shot.notes.iter().any(|note| note.contains("upper bound")));
        // The handle is over the middle of the implant.
        let [handle, shell] = [shot.handles[0].at, middle(&shot.bodies[1].positions)];
        assert!(
            (handle - shell).norm() < 0.03,
            "{name}: {handle} and {shell}"
        );
    }
}

fn middle(x: &[Point3<f64>]) -> Point3<f64> {
    Point3::from(x.iter().map(|p| p.coords).sum::<Vector3<f64>>() / x.len() as f64)
}

#[test]
fn a_moved_implant_lies_where_a_fresh_start_puts_it() {
    let session = session("flat-implant", &FLAT, Pace::paused());
    // At the start, where the skin lies in its plane.
    assert_eq!(move_to(&session, 0.03, 0.02).frame, 0);
    let moved = done(&session, Command::Step);
    let at = "implant.at=['30 mm','20 mm','0 mm']";
    let fresh = straight("flat-implant", &[&FLAT[..], &[at]].concat(), 1);
    // The position of the hand is rounded; equilibria are accurate to a thousandth of their
    // area.
    let (found, expected) = (
        reading(&moved, "Area gained") / 1e4,
        fresh.parts[0].frames[0].areas.gain(),
    );
    assert!(
        (found / expected - 1.0).abs() <= 1e-3,
        "{found} and {expected} m2"
    );
    let volume = measures::volume(&moved.bodies[1].positions, &moved.stage.bodies[1].triangles);
    assert!((volume / 100e-6 - 1.0).abs() <= T6);
    let back = done(
        &session,
        Command::Restore {
            path: "implant.0.at".to_owned(),
        },
    );
    assert_ne!(shown(&back), shown(&moved));
    // Without a command.
    let before = frame(&session, 1);
    assert_eq!(
        shown(&before),
        computed(&straight("flat-implant", &FLAT, 1))
    );
    let displacement = middle(&moved.bodies[1].positions) - middle(&before.bodies[1].positions);
    // From 1.4 mm to 30 mm. The middle of its vertices follows the triangles above it, to a
    // tenth of an edge.
    assert!(
        (displacement.xy() - nalgebra::Vector2::new(0.0286, 0.02)).norm() <= 1e-3,
        "{displacement}"
    );
    let reset = done(&session, Command::Reset);
    assert_eq!(reset.frame, 0);
    assert!(
        session
            .wait(Duration::from_millis(300), |shot| shot.frame > 0)
            .is_none(),
        "a reset waits for nothing"
    );
}

#[test]
fn an_implant_near_a_vertex_moves_and_goes_back_to_it() {
    let near = [&FLAT[..], &["implant.at=none", "implant.near_vertex=311"]].concat();
    let session = session("flat-implant", &near, Pace::paused());
    let before = session.latest();
    let moved = move_to(&session, -0.01, 0.03);
    let there = arrived(&session, &before);
    for shot in [&moved, &there] {
        let at = shot.handles[0].at;
        assert!(
            (at - Point3::new(-0.01, 0.03, 0.0)).norm() <= T9 && shot.refused.is_none(),
            "{at}"
        );
    }
    let back = done(
        &session,
        Command::Restore {
            path: "implant.0.at".to_owned(),
        },
    );
    assert_eq!(back.handles, before.handles);
}

#[test]
fn a_move_is_seen_at_once_and_a_newer_one_or_the_end_gives_it_up() {
    // Long enough to be interrupted.
    let session = session("flat-implant", &["skin.0.edge_length=4 mm"], Pace::paused());
    let begun = Instant::now();
    assert_eq!(done(&session, Command::Step).frame, 1);
    let whole = begun.elapsed();
    let mut last_ready = None;
    for (x, y) in [(0.02, 0.0), (0.0, 0.025)] {
        let before = session.latest();
        let shot = move_to(&session, x, y);
        // The skin is at rest, and the shell over its new place has its final size.
        assert_eq!((shot.frame, reading(&shot, "Area gained")), (0, 0.0));
        let (handle, shell) = (shot.handles[0].at, &shot.bodies[1].positions);
        assert!(
            (handle.xy() - nalgebra::Point2::new(x, y)).norm() < 0.01 && handle.z.abs() <= T9,
            "{handle}"
        );
        assert!(
            (middle(shell).xy() - handle.xy()).norm() <= T9,
            "{} under {handle}",
            middle(shell)
        );
        let volume = measures::volume(shell, &shot.stage.bodies[1].triangles);
        assert!((volume / 100e-6 - 1.0).abs() < 0.01, "{volume}");
        assert!(worst(shot.bodies[0].positions.iter().map(|p| p.z.abs())) <= T9);
        // No frame has ended since the skin was prepared for the previous move.
        assert!(
            last_ready.is_none_or(|ms| ms == shot.frame_ms),
            "it was not given up"
        );
        last_ready = Some(arrived(&session, &before).frame_ms);
    }
    let ending = Instant::now();
    drop(session);
    assert!(
        ending.elapsed() < whole / 2,
        "{:?} to end, {whole:?} to come to rest",
        ending.elapsed()
    );
}

#[test]
fn every_control_at_both_ends_runs_or_says_why_not() {
    let oval = [
        "sheet.cells=24",
        "implant.shape=oval",
        "implant.volume=50 cc",
        "skin.0.edge_length=14 mm",
    ]
    .to_vec();
    for (name, overrides) in [("flat-implant", oval), ("sheet", vec!["sheet.cells=16"])] {
        let session = session(name, &overrides, Pace::paused());
        let is_turn = |path: Option<&str>| path.is_some_and(|path| path.ends_with("turn"));
        let refused = at_both_ends(
            &session,
            |c| !is_turn(c.path()),
            |session, context| {
                let shot = done(session, Command::Step);
                assert!(
                    shot.failed.is_none(),
                    "{name}, {context}: {:?}",
                    shot.failed
                );
            },
        );
        // No volume, a base too small for its edges; skin as thick as the ball. The region of the
        // largest base ends at the border of the sheet.
        let expected = match name {
            "sheet" => &[
                "ball/radius at 0: ",
                "ball/radius at 1: ",
                "skin/thickness at 1: ",
            ][..],
            _ => &[
                "implant implant/volume at 0: ",
                "implant implant/base at 0: ",
            ],
        };
        let all_match = refused
            .iter()
            .zip(expected)
            .all(|(why, begins)| why.starts_with(begins));
        assert!(refused.len() == expected.len() && all_match, "{refused:?}");
        let Some(turn) = session
            .latest()
            .controls
            .iter()
            .find(|c| is_turn(c.path()))
            .cloned()
        else {
            continue;
        };
        // After a rotation by a right angle the length of an oval equals its former width.
        let extent = |shot: &Snapshot| {
            let x = shot.bodies[1].positions.iter().map(|p| p.x);
            x.clone().fold(f64::MIN, f64::max) - x.fold(f64::MAX, f64::min)
        };
        // At the start, where the shell lies in the surface that it is cut from.
        done(&session, Command::Reset);
        let across = |degrees| {
            done(
                &session,
                turn.command(pliant_viewer::panel::Value::Number(degrees))
                    .expect("in its range"),
            );
            extent(&session.latest())
        };
        let (along, turned) = (across(0.0), across(90.0));
        assert!(
            (turned / along - 0.65).abs() < 0.01,
            "{along} and {turned} m"
        );
    }
}

#[test]
fn what_cannot_be_is_refused_with_its_reason_and_changes_nothing() {
    let session = session("flat-implant", &FLAT, Pace::paused());
    let before = done(&session, Command::Step);
    for (command, says) in [
        (set("implant.0.volume", "-1 cc"), "volume"),
        (set("implant.0.volume", "2000 cc"), "takes at most"),
        (set("implant.0.base", "19 cm"), "border"),
        (set("implant.0.colour", "red"), "colour"),
        (set("implant.0.turn", "much"), "give an angle"),
        (
            set("implant.3.turn", "3 deg"),
            "there is no implant 3; the scene has 1",
        ),
        (set("skin.0.thickness", "0 mm"), "thickness"),
        (
            Command::Move {
                handle: 1,
                to: Point3::origin(),
            },
            "there is no implant 1",
        ),
        (
            Command::Move {
                handle: 0,
                to: Point3::new(f64::NAN, 0.0, 0.0),
            },
            "cannot be NaN",
        ),
        (
            Command::Drag {
                body: 0,
                vertex: 0,
                to: Point3::origin(),
                stiffness: None,
            },
            "move an implant",
        ),
        (
            Command::Turn {
                bone: 0,
                angle: 0.1,
            },
            "does not turn",
        ),
        (Command::Seek { frame: 1 }, "only a finished run"),
        (Command::Probe(Some((2, 0))), "there is no body 2"),
    ] {
        assert_refused(&session, &command, says);
    }
    assert_eq!(shown(&session.latest()), shown(&before));
    // The preparation shows that the implant does not fit there.
    let number = session.send(Command::Move {
        handle: 0,
        to: Point3::new(0.09, 0.0, 0.0),
    });
    let is_answered = |shot: &Snapshot| {
        shot.refused
            .as_ref()
            .is_some_and(|(refused, _)| *refused == number)
    };
    let shot = session.wait(LONG, is_answered).expect("a refusal");
    let (_, why) = shot.refused.clone().unwrap_or_default();
    assert!(
        why.contains("reaches the border") && why.contains("would fit there"),
        "{why}"
    );
    assert_eq!(
        shown(&frame(&session, 1)),
        shown(&before),
        "it is where it was"
    );
    assert!(shot.failed.is_none() && !shot.running);
}
