//! Each control of a panel, moved to both ends, gives a scene that runs or a rejection with a
//! reason.

use pliant_viewer::panel::{Control, Kind, NoValue, Value, controls};
use pliant_viewer::{Command, Pace, Session};

use super::{HIP, answer_to, done, session, set, why_refused};

fn of(session: &Session, name: &str, overrides: &[&str]) -> Vec<Control> {
    let start = super::recipe(name, overrides)
        .scene()
        .unwrap_or_else(|e| panic!("{}", e.terse()));
    controls(&start, super::scene_of(&session.latest()))
}

fn names(all: &[Control]) -> Vec<String> {
    all.iter()
        .map(|control| format!("{}/{}", control.group, control.label))
        .collect()
}

#[test]
fn a_panel_has_what_its_scene_has_and_nothing_else() {
    let hip = session("hip", &HIP, Pace::paused());
    let expected = "stretch/stretch bending/bending bending/limit volume/volume volume/pressure anisotropy/anisotropy \
        anisotropy/strength anisotropy/power contact/contact contact/thickness contact/friction damping/damping damping/rate damping/retardation \
        muscle gluteus/stretch,muscle gluteus/bending,muscle gluteus/density solver/target accuracy solver/solver solver/substeps \
        solver/iterations solver/tolerance,solver/order of a sweep,bone femur/by its motion,bone femur/angle";
    let shown = names(&of(&hip, "hip", &HIP)).join(",");
    let plain = |text: &str| text.replace([' ', ','], "");
    assert_eq!(plain(&shown), plain(expected));
    let volume = session("volume", &[], Pace::paused());
    let expected = "volume/volume volume/pressure muscle muscle/mass of a vertex solver/solver solver/substeps \
        solver/iterations solver/tolerance solver/order of a sweep solver/volume solver/velocity damping";
    assert_eq!(
        plain(&names(&of(&volume, "volume", &[])).join(",")),
        plain(expected)
    );
    // A disabled effect keeps its switch and loses its numbers.
    done(&hip, set("effects.contact", "off"));
    let without = names(&of(&hip, "hip", &HIP));
    assert!(
        without.contains(&"contact/contact".to_owned())
            && !without.contains(&"contact/friction".to_owned())
    );
    done(&hip, set("solver", "quasi_static"));
    let resting = names(&of(&hip, "hip", &HIP));
    assert!(
        !resting
            .iter()
            .any(|name| name.ends_with("/density") || name.ends_with("of a sweep")),
        "{resting:?}"
    );
    let gravity = ["effects.gravity.acceleration=['0 m/s2','-3 m/s2','-4 m/s2']"];
    let heavy = session("distance", &gravity, Pace::paused());
    let all = of(&heavy, "distance", &gravity);
    let weight = all
        .iter()
        .find(|c| c.label == "acceleration")
        .expect("gravity");
    assert_eq!(weight.value, Value::Number(5.0));
    done(
        &heavy,
        weight.command(Value::Number(10.0)).expect("in its range"),
    );
    assert_eq!(
        super::scene_of(&heavy.latest()).effects.gravity,
        Some(nalgebra::Vector3::new(0.0, -6.0, -8.0))
    );
}

/// Moves every control to both ends and back. Returns the rejected moves.
fn moved(name: &str, overrides: &[&str]) -> Vec<String> {
    let session = session(name, overrides, Pace::paused());
    let mut refused = Vec::new();
    for control in of(&session, name, overrides) {
        for share in [0.0, 1.0] {
            let context = format!("{name}: {}/{} at {share}", control.group, control.label);
            let command = control
                .command(control.at(share))
                .unwrap_or_else(|e| panic!("{context}: {e}"));
            let before = session.latest().refused.clone();
            let shot = answer_to(&session, command.clone());
            if shot.refused != before {
                let (_, why) = shot.refused.clone().unwrap_or_default();
                assert!(why.len() > 20, "{context}: {why}");
                refused.push(format!("{context}: {why}"));
                continue;
            }
            let now = of(&session, name, overrides);
            if let Command::Set { .. } = command
                && let Some(moved) = now
                    .iter()
                    .find(|c| (&c.group, &c.label) == (&control.group, &control.label))
            {
                assert!(
                    (moved.share() - share).abs() < 1e-9,
                    "{context}: it shows {}",
                    moved.share()
                );
            }
            // The greatest number of steps in the range would take too long.
            if !matches!(control.kind, Kind::Whole { .. }) {
                let shot = done(&session, Command::Step);
                assert!(shot.failed.is_none(), "{context}: {:?}", shot.failed);
            }
        }
        if let Some(path) = control.path() {
            done(
                &session,
                Command::Restore {
                    path: path.to_owned(),
                },
            );
        }
        done(&session, Command::Reset);
    }
    refused
}

#[test]
fn every_control_at_both_ends_runs_or_says_why_not() {
    let coarse = ["muscle.0.edge_length=14 mm", "substeps=4"];
    assert_eq!(moved("hip", &coarse), [""; 0]);
    for solver in ["solver=pbd", "solver=quasi_static", "solver=implicit_euler"] {
        assert_eq!(
            moved("hip", &["muscle.0.edge_length=18 mm", solver]),
            [""; 0]
        );
    }
    // A tetrahedron with only a conserved volume has no equilibrium.
    let refused = moved("volume", &[]);
    assert!(
        refused
            .iter()
            .all(|why| why.starts_with("volume: solver/solver at 1")),
        "{refused:?}"
    );
    let session = session("volume", &[], Pace::paused());
    let why = why_refused(&session, set("solver", "quasi_static"));
    assert!(why.contains("muscle `muscle`"), "{why}");
}

#[test]
fn a_value_that_a_control_does_not_have_is_no_command() {
    let session = session("hip", &HIP, Pace::paused());
    let all = of(&session, "hip", &HIP);
    for control in &all {
        match &control.kind {
            Kind::Slider {
                range: (low, high), ..
            } => {
                for value in [f64::NAN, f64::INFINITY, low - 1.0, high + 1.0] {
                    let error = control.command(Value::Number(value)).expect_err("no value");
                    assert!(matches!(error, NoValue::Outside { .. }), "{error}");
                }
            }
            Kind::Whole {
                range: (_, high), ..
            } => {
                assert!(
                    control.command(Value::Whole(0)).is_err()
                        && control.command(Value::Whole(high + 1)).is_err()
                );
            }
            Kind::Choice(names) => assert!(control.command(Value::Choice(names.len())).is_err()),
            Kind::Switch => assert!(control.command(Value::Number(1.0)).is_err()),
        }
        assert!(
            (control.share() - share_of(control, control.share())).abs() < 0.02,
            "{}",
            control.label
        );
        assert!(
            control.command(control.value).is_ok(),
            "{}: its own value is one",
            control.label
        );
    }
}

/// The share of the value at a share.
fn share_of(control: &Control, share: f64) -> f64 {
    let mut moved = control.clone();
    moved.value = control.at(share);
    moved.share()
}
