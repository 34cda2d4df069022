//! The geometric muscle in a session: animated as by `pliant run`, stretched by hand, with
//! moved nodes.

use std::sync::Arc;

use nalgebra::Point3;
use pliant::mesh::measures;
use pliant::progress::Silent;
use pliant::scene::{Content, builtin::load_content};
use pliant::simulation::{GeometricRun, Scenario};
use pliant_viewer::{Command, Pace, Session, Snapshot, Tissue};

use super::ends::at_both_ends;
use super::{assert_refused, bits, done, recipe, set, shown, why_refused};
use pliant::testing::tolerances::{T1, T18};

const FILE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/biceps.toml");

fn biceps(overrides: &[&str]) -> Session {
    super::session(FILE, overrides, Pace::paused())
}

fn reading(shot: &Snapshot, name: &str) -> f64 {
    shot.readings
        .iter()
        .find(|r| r.name == name)
        .unwrap_or_else(|| panic!("no {name}"))
        .value
}

fn off_axis(p: &Point3<f64>) -> f64 {
    p.y.hypot(p.z)
}

#[test]
fn an_animation_has_the_bits_of_the_command() {
    let Content::Geometric(scene) = load_content(FILE, &[]).expect("a scene") else {
        panic!("a geometric muscle")
    };
    let mut run = GeometricRun::new(*scene);
    let mut poses = vec![run.pose.clone()];
    for _ in 0..5 {
        run.step(&Silent);
        poses.push(run.pose.clone());
    }
    let session = biceps(&[]);
    let first = session.latest();
    let tissues: Vec<Tissue> = first.stage.bodies.iter().map(|b| b.tissue).collect();
    assert_eq!(tissues, [Tissue::Muscle, Tissue::Plain]);
    for pose in &poses[..5] {
        let shot = session.latest();
        assert_eq!(
            bits(&shot.bodies[0].positions),
            bits(&pose.mesh.vertices),
            "frame {}",
            shot.frame
        );
        assert_eq!(bits(&shot.bodies[1].positions), bits(&pose.bars));
        done(&session, Command::Step);
    }
    assert_ne!(
        shown(&session.latest()),
        shown(&first),
        "nothing moves: the test would show nothing"
    );
    let thicker = biceps(&["radii.4=3.5 cm"]);
    done(&thicker, Command::Step);
    assert_ne!(
        bits(&thicker.latest().bodies[0].positions),
        bits(&poses[1].mesh.vertices),
        "control"
    );
    (5..65).for_each(|_| drop(done(&session, Command::Step)));
    assert_eq!(
        bits(&session.latest().bodies[0].positions),
        bits(&poses[5].mesh.vertices),
        "round and round"
    );
}

#[test]
fn a_length_by_hand_stays_until_the_animation_has_it_again() {
    let session = biceps(&[]);
    let rest = reading(&session.latest(), "Length");
    let by_hand = done(&session, set("fixed_length", "21 cm"));
    assert!((reading(&by_hand, "Length") - 21.0).abs() <= T1 * 21.0 && by_hand.frame == 0);
    (0..3).for_each(|_| drop(done(&session, Command::Step)));
    assert_eq!(
        shown(&session.latest()),
        shown(&by_hand),
        "frames leave it where the hand put it"
    );
    assert!(
        reading(&by_hand, "Joint angle") < reading(&biceps(&[]).latest(), "Joint angle"),
        "shorter, it bends"
    );
    done(&session, set("animation", "on"));
    let shot = done(&session, Command::Step);
    let mut straight = biceps(&[]).latest();
    assert_ne!(shown(&shot), shown(&straight));
    let other = biceps(&[]);
    (0..4).for_each(|_| straight = done(&other, Command::Step));
    assert_eq!(
        shown(&shot),
        shown(&straight),
        "it goes on as if it had never been held"
    );
    done(&session, set("fixed_length", "21 cm"));
    let path = "fixed_length".to_owned();
    done(&session, Command::Restore { path });
    assert_eq!(reading(&done(&session, Command::Reset), "Length"), rest);
    assert_ne!(shown(&done(&session, Command::Step)), shown(&by_hand));
    let given = biceps(&["fixed_length=21 cm"]);
    assert_eq!(shown(&given.latest()), shown(&by_hand));
}

#[test]
fn a_moved_node_gets_the_radius_of_the_hand_and_a_volume_that_is_kept() {
    for length in ["24 cm", "21 cm", "27 cm"] {
        let session = biceps(&[&format!("fixed_length={length}")]);
        let before = session.latest();
        let node = 6;
        let handle = &before.handles[node];
        assert_eq!(handle.name, "node 7");
        // A move to the current place changes nothing.
        let same = done(
            &session,
            Command::Move {
                handle: node,
                to: handle.at,
            },
        );
        let apart = |a: &Snapshot, b: &Snapshot| {
            let pairs = a.bodies[0].positions.iter().zip(&b.bodies[0].positions);
            pairs.map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
        };
        assert!(
            apart(&same, &before) <= T18,
            "{length}: moved by {} m",
            apart(&same, &before)
        );
        // A move outwards, to another side, and along the axis, which has no effect.
        let distance = 0.031;
        let to = Point3::new(handle.at.x + 0.01, 0.6 * distance, -0.8 * distance);
        let moved = done(&session, Command::Move { handle: node, to });
        assert!(
            (off_axis(&moved.handles[node].at) - distance).abs() <= T18,
            "{length}"
        );
        assert_eq!(reading(&moved, "Length"), reading(&before, "Length"));
        assert!(reading(&moved, "Volume error").abs() <= T18);
        // Circles of the mesh have the size of those of the chain, except at its round ends.
        let change = 1e-6 * (reading(&moved, "Volume") - reading(&before, "Volume"));
        let of_mesh = |shot: &Snapshot| {
            measures::volume(&shot.bodies[0].positions, &shot.stage.bodies[0].triangles)
        };
        let seen = of_mesh(&moved) - of_mesh(&before);
        assert!(
            change > 1e-6 && (seen / change - 1.0).abs() < 0.02,
            "{length}: {change} and {seen} m3"
        );
        // A fresh start with the radius at rest that the panel shows.
        let radius = moved
            .controls
            .iter()
            .find(|c| c.path() == Some("radii.6"))
            .expect("its radius");
        let pliant_viewer::panel::Value::Number(cm) = radius.value else {
            panic!("a number")
        };
        let fresh = biceps(&[
            &format!("fixed_length={length}"),
            &format!("radii.6={cm} cm"),
        ]);
        assert!(
            apart(&fresh.latest(), &moved) <= T18 && apart(&moved, &before) > 1e-3,
            "{length}"
        );
        let others = |shot: &Snapshot| -> Vec<_> {
            let others = shot
                .controls
                .iter()
                .filter(|c| c.group.starts_with("node ") && c.path() != Some("radii.6"));
            others.map(|c| c.value).collect()
        };
        assert_eq!(others(&moved), others(&before), "and nothing else");
        let back = done(
            &session,
            Command::Restore {
                path: "radii.6".to_owned(),
            },
        );
        assert_eq!(shown(&back), shown(&before));
    }
}

#[test]
fn every_control_at_both_ends_runs_or_says_why_not() {
    let session = biceps(&[]);
    let is_of_muscle = |path: &str| path != "animation" && path != "fixed_length";
    let refused = at_both_ends(
        &session,
        |control| control.path().is_some_and(is_of_muscle),
        |session, context| {
            for _ in 0..8 {
                let shot = done(session, Command::Step);
                assert!(shot.failed.is_none(), "{context}: {:?}", shot.failed);
                assert!(reading(&shot, "Volume error").abs() <= T18, "{context}");
            }
        },
    );
    assert_eq!(refused, [""; 0]);
    // At its greatest length, stretched by hand, it cannot get a node that is too thin for that
    // length.
    let long = biceps(&["fixed_length=28.8 cm", "max_part=1.2", "grow_mults.2=3"]);
    let why = why_refused(&long, set("radii.2", "0.1 cm"));
    assert!(
        why.contains("fixed_length") && why.contains("give a length from"),
        "{why}"
    );
}

#[test]
fn what_cannot_be_is_refused_with_its_reason_and_changes_nothing() {
    let session = biceps(&["fixed_length=22 cm"]);
    let before = session.latest();
    let to = |y: f64| Point3::new(0.0, y, 0.0);
    let drag = Command::Drag {
        body: 0,
        vertex: 0,
        to: to(0.0),
        stiffness: None,
    };
    for (command, says) in [
        (
            Command::Move {
                handle: 4,
                to: to(f64::NAN),
            },
            "a coordinate of the place to move to cannot be NaN",
        ),
        (
            Command::Move {
                handle: 4,
                to: to(f64::INFINITY),
            },
            "cannot be inf",
        ),
        (
            Command::Move {
                handle: 4,
                to: to(0.0),
            },
            "at a length of 22 cm the radius of node 5 cannot be 0 cm; it can be",
        ),
        (
            Command::Move {
                handle: 4,
                to: to(7.0),
            },
            "cannot be 700 cm; it can be from 0 to 24 cm",
        ),
        (
            Command::Move {
                handle: 9,
                to: to(0.02),
            },
            "there is no node 9; the scene has 9",
        ),
        (
            set("fixed_length", "10 cm"),
            "give a length from 20.4 to 28.8 cm",
        ),
        (set("fixed_length", "nan"), "fixed_length"),
        (set("fixed_length", "20 kg"), "`kg` is a unit of mass"),
        (set("radii.4", "-1"), "radii.4: `-1` is not allowed here"),
        (set("radii.9", "1 cm"), "a number below 9"),
        (
            set("grow_mults.0", "much"),
            "grow_mults.0: expected a number",
        ),
        (set("insert", "-1"), "a whole number from 0"),
        (set("insert", "4000000"), "at most 1000000 nodes"),
        (set("caps", "round"), "give `out` or `in`"),
        (set("min_part", "2"), "min_part"),
        (set("colour", "red"), "unknown key `colour`"),
        (set("animation", "perhaps"), "give `on` or `off`"),
        (drag, "move its nodes"),
        (
            Command::Turn {
                bone: 0,
                angle: 0.1,
            },
            "there is no bone 0",
        ),
        (Command::Seek { frame: 3 }, "only a finished run"),
        (Command::Probe(Some((2, 0))), "there is no body 2"),
    ] {
        assert_refused(&session, &command, says);
    }
    assert_eq!(shown(&session.latest()), shown(&before));
    for (overrides, says) in [
        ("fixed_length=1 km", "is not allowed here"),
        ("radii.x=1", "there is no element `x`"),
    ] {
        let error = Session::start(recipe(FILE, &[overrides]), Pace::paused())
            .expect_err("wrong")
            .to_string();
        assert!(error.contains(says), "{error}");
    }
}

#[test]
fn other_nodes_between_are_another_stage_of_the_same_muscle() {
    let session = biceps(&["fixed_length=22 cm"]);
    let before = session.latest();
    done(
        &session,
        Command::Probe(Some((0, before.bodies[0].positions.len() - 1))),
    );
    let coarse = done(&session, set("insert", "0"));
    assert!(!Arc::ptr_eq(&coarse.stage, &before.stage) && coarse.probe.is_none());
    assert!(coarse.bodies[0].positions.len() < before.bodies[0].positions.len());
    assert_eq!(coarse.handles.len(), before.handles.len());
    // Straight between its nodes, the body at rest is unchanged; it differs slightly where
    // growth bends it.
    let (a, b) = (reading(&coarse, "Volume"), reading(&before, "Volume"));
    assert!((a / b - 1.0).abs() <= T18, "{a} and {b} cm3");
    let moved = done(&session, set("radii.3", "3 cm"));
    assert!(
        Arc::ptr_eq(&moved.stage, &coarse.stage),
        "as many triangles are the same stage"
    );
}
