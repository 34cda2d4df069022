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
    for (arguments, told) in [
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
        (&["biceps", "nothing.toml"], "cannot read"),
        (&["biceps"], "FILE"),
    ] {
        let done = run(&[arguments, &["--out", shown(&out)]].concat());
        assert_eq!(done.status.code(), Some(2), "{arguments:?}");
        assert!(
            text(&done.stderr).contains(told),
            "{arguments:?}: {}",
            text(&done.stderr)
        );
        assert!(!out.exists(), "{arguments:?}");
    }
}
