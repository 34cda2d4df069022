//! `pliant biceps`: files, numbers, refusals.

use std::fs;

use super::{Scratch, json, measures, names_in, run, shown, text};

const EXAMPLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/biceps.toml");

#[test]
fn a_length_and_an_animation() {
    let scratch = Scratch::folder();
    let out = scratch.join("out");
    let done = run(&[
        "biceps",
        EXAMPLE,
        "--length",
        "21 cm",
        "--json",
        "--out",
        shown(&out),
    ]);
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let summary = measures(&json(&out.join("summary.json")));
    assert!(
        summary["volume_error"].as_f64().expect("a number").abs() <= 1e-12,
        "{summary}"
    );
    assert!(
        (summary["length_m"].as_f64().expect("a number") - 0.21).abs() <= 1e-12,
        "{summary}"
    );
    let done = run(&[
        "biceps",
        EXAMPLE,
        "--animate",
        "--frames",
        "4",
        "--out",
        shown(&out),
    ]);
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let names = names_in(&out);
    for name in [
        "biceps.gif",
        "biceps.pvd",
        "lengths.csv",
        "muscle.png",
        "muscle.vtp",
        "report.html",
        "summary.json",
    ] {
        assert!(
            names.iter().any(|n| n == name),
            "{name} is not in {names:?}"
        );
    }
    let lengths = fs::read_to_string(out.join("lengths.csv")).expect("a table");
    assert_eq!(lengths.lines().count(), 102);
}

#[test]
fn what_cannot_be_is_refused() {
    let scratch = Scratch::folder();
    let out = scratch.join("out");
    let wrong = scratch.join("wrong.toml");
    fs::write(
        &wrong,
        "radii = [1.0, 2.0]\ngrow_mults = [1.0]\nlength = 3\n",
    )
    .expect("written");
    let wrong = wrong.to_str().expect("a path");
    for (arguments, expected) in [
        (
            &["biceps", EXAMPLE, "--length", "40 cm"][..],
            "from 20.4 to 28.8",
        ),
        (&["biceps", EXAMPLE, "--length", "21"], "no unit"),
        (
            &["biceps", EXAMPLE, "--length", "21 cm", "--animate"],
            "cannot be used with",
        ),
        (&["biceps", wrong], "1 growth multipliers for 2 radii"),
        (&["biceps", "nothing.toml"], "no file"),
        (&["biceps", "hip"], "another kind"),
        (&["biceps"], "FILE"),
    ] {
        let done = run(&[arguments, &["--out", shown(&out)]].concat());
        assert_eq!(done.status.code(), Some(2), "{arguments:?}");
        assert!(
            text(&done.stderr).contains(expected),
            "{arguments:?}: {}",
            text(&done.stderr)
        );
        assert!(!out.exists(), "{arguments:?}");
    }
}

#[test]
fn every_command_takes_the_file_and_a_printed_scene_is_the_same_run() {
    let scratch = Scratch::folder();
    let (out, again) = (scratch.join("out"), scratch.join("again"));
    let printed = scratch.join("printed.toml");
    let options = ["--frames", "4", "--set", "insert=1", "--out"];
    let done = run(&[&["run", EXAMPLE][..], &options, &[shown(&out)]].concat());
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let summary = json(&out.join("summary.json"));
    super::schema::assert_valid(&summary);
    assert_eq!(summary["kind"], "geometric");
    assert!((summary["geometric"]["length_m"].as_f64().expect("a number") - 0.24).abs() <= 1e-15);
    assert!(summary["verdicts"][0]["passed"] == true, "{summary}");
    let measures = fs::read_to_string(out.join("measures.csv")).expect("a table");
    assert_eq!(measures.lines().count(), 6, "{measures}");
    let done = run(&[
        "biceps",
        EXAMPLE,
        "--animate",
        "--frames",
        "4",
        "--print-scene",
    ]);
    fs::write(
        &printed,
        text(&done.stdout).replace("insert = 3", "insert = 1"),
    )
    .expect("written");
    let done = run(&["run", shown(&printed), "--out", shown(&again)]);
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    for frame in 0..=4 {
        let name = format!("frames/muscle_{frame:04}.vtp");
        let frame = |folder: &std::path::Path| fs::read(folder.join(&name)).expect("a frame");
        assert!(frame(&out) == frame(&again), "{name}");
    }
    let plan = run(&["plan", EXAMPLE]);
    assert!(
        text(&plan.stdout).contains("constant volume of frusta"),
        "{}",
        text(&plan.stdout)
    );
    let study = scratch.join("study.toml");
    let scene = EXAMPLE;
    fs::write(
        &study,
        format!("scene = '{scene}'\nframes = [0, 2]\n[set]\nframes = 2\n[vary]\nlength = ['23 cm', '24 cm']\n"),
    )
    .expect("written");
    let done = run(&[
        "study",
        shown(&study),
        "--out",
        shown(&scratch.join("study")),
    ]);
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    assert!(
        text(&done.stdout).contains("joint angle"),
        "{}",
        text(&done.stdout)
    );
}
