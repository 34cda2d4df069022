//! The viewer in a window on a virtual screen (Xvfb): opened, controlled by mouse and keys,
//! closed.
//!
//! Where Xvfb or xdotool is missing the tests print that they are skipped. The window writes
//! the positions of its widgets to a file (`--trace`).

mod desk;

use std::process::Command;

use desk::{Desk, Picture, find, number, share};
use pliant::testing::Scratch;
use serde_json::Value;

/// The hip, coarse, and slow enough to be controlled.
const HIP: [&str; 6] = [
    "hip",
    "--set",
    "muscle.0.edge_length=14 mm",
    "--set",
    "substeps=4",
    "--paused",
];

fn frame(seen: &Value) -> f64 {
    number(&seen["frame"])
}

/// Pixels of the colour of bone, light and a little yellow, at any light.
fn is_bone([r, g, b]: [u8; 3]) -> bool {
    r > 110 && r >= g && g > b && r - b < 90 && r - g < 40
}

/// Pixels of the dark end of the colour map.
fn is_violet([r, g, b]: [u8; 3]) -> bool {
    b > 50 && b > g.saturating_add(25) && r > g
}

#[test]
fn it_opens_runs_pauses_resets_and_closes() {
    let Some(desk) = Desk::new() else { return };
    let mut viewer = desk.view(&HIP);
    viewer.focus();
    let seen = viewer.last().expect("a picture");
    assert_eq!((frame(&seen), &seen["running"]), (0.0, &Value::Bool(false)));
    let first = viewer.picture();
    assert_eq!(first.blank(), None);
    // A picture contains only the scene; the panel is beside it.
    let left = |widget: &Value| number(&widget["rect"][0]);
    let panel = seen["widgets"]
        .as_array()
        .expect("widgets")
        .iter()
        .map(left)
        .fold(f64::INFINITY, f64::min);
    assert!(
        f64::from(first.size.0) <= panel,
        "{} columns, the panel from {panel}",
        first.size.0
    );
    assert!(
        first.share(is_bone) > 0.02,
        "bone: {}",
        first.share(is_bone)
    );
    // A tenth of the width by a fiftieth of the height, minus the part covered by fibres.
    assert!(
        first.share(is_violet) > 0.001,
        "muscle without stretch: {}",
        first.share(is_violet)
    );
    viewer.press("Record");
    viewer.press("Run");
    viewer.wait("frames", |seen| frame(seen) > 20.0);
    viewer.key("space");
    let paused = viewer.wait("a pause", |seen| seen["running"] == false);
    viewer.press("Stop recording");
    viewer.wait_for_file("a film", |viewer| {
        viewer
            .pictures()
            .iter()
            .any(|p| p.extension().is_some_and(|e| e == "gif"))
    });
    viewer.press("Step");
    viewer.wait("a step", |seen| frame(seen) == frame(&paused) + 1.0);
    let later = viewer.picture();
    assert!(
        later.differs(&first) > 0.01,
        "the femur turned: {}",
        later.differs(&first)
    );
    assert!(
        viewer.picture().differs(&later) < 1e-3,
        "nothing moves in a pause"
    );
    viewer.key("r");
    viewer.wait("a reset", |seen| frame(seen) == 0.0);
    assert!(viewer.picture().differs(&first) < 1e-3, "as at the start");
    assert_eq!(viewer.close(), Some(0));
}

#[test]
fn every_slider_moves_what_it_says() {
    let Some(desk) = Desk::new() else { return };
    let mut viewer = desk.view(&HIP);
    viewer.focus();
    let seen = viewer.last().expect("a picture");
    let widgets = seen["widgets"].as_array().expect("widgets").clone();
    let shares = widgets.iter().filter(|w| w["value"]["share"].is_number());
    let names: Vec<String> = shares
        .filter_map(|w| w["name"].as_str().map(str::to_owned))
        .collect();
    assert!(names.len() > 15, "{names:?}");
    for name in &names {
        let before = viewer.wait(name, |seen| find(seen, name).is_some());
        if is_slider(name) {
            let target = if share(&before, name) > 0.5 {
                0.25
            } else {
                0.75
            };
            viewer.slide(name, target);
            // A bone moves to its angle during the next frames.
            if name == "bone femur/angle" {
                continue;
            }
            // Neighbouring whole numbers near 1 are far apart on the slider.
            viewer.wait(name, |seen| (share(seen, name) - target).abs() < 0.13);
        } else if !name.starts_with("solver/") {
            viewer.press(name);
            let changed = |seen: &Value| (share(seen, name) - share(&before, name)).abs() == 1.0;
            viewer.wait(name, changed);
            viewer.press(name);
            viewer.wait(name, |seen| share(seen, name) == share(&before, name));
        }
    }
    let seen = viewer.last().expect("a picture");
    assert_eq!(
        (&seen["refused"], &seen["failed"]),
        (&Value::Null, &Value::Null)
    );
    viewer.press("Reset");
    viewer.press("Step");
    viewer.wait("a frame with all that", |seen| frame(seen) == 1.0);
    assert_eq!(viewer.close(), Some(0));
}

/// Controls that are drawn as sliders.
fn is_slider(name: &str) -> bool {
    let (group, label) = name.split_once('/').unwrap_or((name, ""));
    group != label && label != "by its motion" && !["solver", "order of a sweep"].contains(&label)
}

#[test]
fn the_mouse_turns_moves_picks_pulls_and_fixes() {
    let Some(desk) = Desk::new() else { return };
    let mut viewer = desk.view(&HIP);
    viewer.focus();
    let first = viewer.picture();
    let (from, to) = ([200.0, 700.0], [260.0, 640.0]);
    viewer.drag("1", from, to, |_| {});
    let turned = viewer.picture();
    assert!(
        turned.differs(&first) > 0.02,
        "turned: {}",
        turned.differs(&first)
    );
    viewer.key("h");
    assert!(
        viewer.picture().differs(&first) < 1e-3,
        "the first view again"
    );
    viewer.key("Left");
    assert!(
        viewer.picture().differs(&first) > 0.005,
        "an arrow key turns"
    );
    viewer.key("h");
    viewer.scroll([200.0, 700.0], 3);
    assert!(
        viewer.picture().differs(&first) > 0.02,
        "the wheel comes nearer"
    );
    (0..3).for_each(|_| viewer.key("Next"));
    assert!(
        viewer.picture().differs(&first) < 1e-3,
        "a notch is as much as a key"
    );
    let seen = viewer.next();
    let place = |seen: &Value| [number(&seen["places"][0][0]), number(&seen["places"][0][1])];
    let at = place(&seen);
    viewer.click(at);
    let seen = viewer.wait("a vertex", |seen| seen["probe"].is_array());
    let picked = number(&seen["probe"][1]);
    assert!(find(&seen, "Fix").is_some());
    viewer.drag("3", at, [at[0] - 40.0, at[1] - 60.0], |viewer| {
        viewer.wait("a pull", |seen| seen["dragged"][0].is_number());
        viewer.press_key("period");
        viewer.wait("a frame", |seen| frame(seen) == 1.0);
    });
    viewer.wait("to be let go", |seen| seen["dragged"][0].is_null());
    viewer.press("Fix");
    viewer.wait("it is fixed", |seen| {
        seen["fixed"][0]
            .as_array()
            .is_some_and(|all| all.len() == 1 && number(&all[0]) == picked)
    });
    viewer.press("Free");
    viewer.wait("it is free", |seen| {
        seen["fixed"][0] == serde_json::json!([])
    });
    viewer.key("Escape");
    viewer.wait("nothing is picked", |seen| seen["probe"].is_null());
    // A click beside all surfaces picks nothing.
    viewer.click([20.0, 20.0]);
    assert!(viewer.next()["probe"].is_null());
    assert_eq!(viewer.close(), Some(0));
}

#[test]
fn a_finished_run_is_played_forward_and_back() {
    let Some(desk) = Desk::new() else { return };
    let scratch = Scratch::folder();
    let out = scratch.join("run");
    let run = Command::new(env!("CARGO_BIN_EXE_pliant"))
        .args([
            "run",
            "hip",
            "--set",
            "muscle.0.edge_length=14 mm",
            "--set",
            "substeps=4",
            "--frames",
            "30",
            "--out",
        ])
        .arg(&out)
        .output()
        .expect("runs");
    assert!(
        run.status.success(),
        "{}",
        String::from_utf8_lossy(&run.stderr)
    );
    let mut viewer = desk.view(&["--replay", out.to_str().expect("a name"), "--paused"]);
    viewer.focus();
    let first = viewer.picture();
    assert_eq!(first.blank(), None);
    viewer.slide("frame", 1.0);
    viewer.wait("the last frame", |seen| frame(seen) >= 29.0);
    let last = viewer.picture();
    assert!(last.differs(&first) > 0.01, "{}", last.differs(&first));
    viewer.press("Backward");
    viewer.wait("the first frame", |seen| {
        frame(seen) == 0.0 && seen["running"] == false
    });
    // The picture differs from the first, because the legend has covered more values since.
    let back = viewer.picture();
    viewer.press("Forward");
    viewer.wait("the last frame again", |seen| {
        frame(seen) == 30.0 && seen["running"] == false
    });
    assert!(viewer.picture().differs(&back) > 0.01, "it moved again");
    viewer.press("Reset");
    viewer.wait("the start", |seen| frame(seen) == 0.0);
    assert!(viewer.picture().differs(&back) < 1e-3, "back where it was");
    assert_eq!(viewer.close(), Some(0));
}

#[test]
fn a_missing_screen_or_scene_is_said_in_one_line() {
    let without = |arguments: &[&str]| {
        let done = Command::new(env!("CARGO_BIN_EXE_pliant"))
            .arg("view")
            .args(arguments)
            .env_remove("DISPLAY")
            .env_remove("WAYLAND_DISPLAY")
            .env_remove("WAYLAND_SOCKET")
            .output()
            .expect("runs");
        (
            done.status.code(),
            String::from_utf8_lossy(&done.stderr).into_owned(),
        )
    };
    let (code, said) = without(&["distance"]);
    assert_eq!((code, said.lines().count()), (Some(1), 1), "{said}");
    assert!(
        said.contains("no display") && said.contains("pliant run"),
        "{said}"
    );
    for (arguments, says) in [
        (&["no-such-scene"][..], "no-such-scene"),
        (
            &["hip", "--set", "muscle.0.material.stretch=-1 N/m"],
            "stretch",
        ),
        (&["--replay", "/nowhere"], "/nowhere"),
        (&["hip", "--replay", "x"], "cannot be used with"),
        (&["hip", "--size", "0x0"], "1280x800"),
    ] {
        let (code, said) = without(arguments);
        assert!(
            code == Some(2) && said.contains(says),
            "{arguments:?}: {code:?} {said}"
        );
    }
}

#[test]
fn a_scene_that_is_wrong_closes_the_window_with_its_message() {
    let Some(desk) = Desk::new() else { return };
    let mut viewer = desk.view(&["hip", "--set", "muscle.0.material.stretch=-1 N/m"]);
    viewer.wait_for_file("a message", |viewer| {
        viewer.errors().contains("is not allowed here")
    });
    assert!(!viewer.errors().contains("panicked"), "{}", viewer.errors());
    assert_eq!(viewer.ended(), Some(2));
}

#[test]
fn a_blank_picture_is_seen_to_be_blank() {
    let blank = Picture {
        size: (40, 40),
        pixels: vec![[30, 31, 32]; 1600],
    };
    assert!(blank.blank().is_some());
    assert_eq!((blank.share(is_bone), blank.share(is_violet)), (0.0, 0.0));
    let mut other = Picture {
        size: (40, 40),
        pixels: blank.pixels.clone(),
    };
    assert_eq!(blank.differs(&other), 0.0);
    other.pixels[7] = [35, 31, 32];
    assert!(blank.differs(&other) > 0.0);
}
