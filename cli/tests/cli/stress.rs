//! `pliant stress`: its cases, those kept from an earlier call, and wrong input.

use super::check::code;
use super::schema::assert_valid;
use super::{Scratch, run, text};
use serde_json::Value;

const SMALL: [&str; 2] = ["--set", "lattice.points=[3,3,4]"];

/// Exit code and summary of a campaign on a lattice.
fn stress(folder: &std::path::Path, more: &[&str]) -> (Option<i32>, Value) {
    let out = folder.to_str().expect("a path");
    let given = ["stress", "lattice", "--json", "--out", out];
    let done = run(&[&given, &SMALL[..], more].concat());
    let summary = serde_json::from_slice(&done.stdout);
    (
        code(&done),
        summary.unwrap_or_else(|_| panic!("{}", text(&done.stderr))),
    )
}

#[test]
fn every_case_ends_in_a_permitted_way_and_is_kept() {
    let folder = Scratch::folder();
    let (exit, summary) = stress(&folder, &["--cases", "8"]);
    assert_eq!(exit, Some(0), "{summary:#}");
    assert_valid(&summary);
    let counts = &summary["stress"];
    let count = |key: &str| counts[key].as_u64().expect("a count");
    assert_eq!(count("cases"), 8);
    assert_eq!(
        count("converged") + count("not_converged") + count("refused"),
        8
    );
    assert_eq!(counts["usual"]["cases"], 4);
    // The cases of an earlier call are kept: with another seed there are others.
    let (_, again) = stress(&folder, &["--cases", "8"]);
    assert_eq!(again["stress"], summary["stress"]);
    let (_, other) = stress(&folder, &["--cases", "8", "--seed", "9"]);
    assert_eq!(other["stress"]["cases"], 8);
    let kept = std::fs::read_dir(folder.join("cases")).expect("a folder");
    assert_eq!(kept.count(), 16);
}

#[test]
fn cases_are_drawn_of_the_scene_as_it_is_changed() {
    let folder = Scratch::folder();
    let out = folder.to_str().expect("a path");
    let few = ["--cases", "16", "--frames", "6", "--work", "1"];
    let set = [
        "--set",
        "solver=quasi_static",
        "--set",
        "muscle.0.edge_length=40 mm",
    ];
    run(&[
        &["stress", "press", "--quiet", "--out", out][..],
        &set,
        &few,
    ]
    .concat());
    let cases = std::fs::read_dir(folder.join("cases")).expect("a folder");
    let ends: Vec<Value> = cases
        .map(|case| super::json(&case.expect("an entry").path()))
        .collect();
    assert_eq!(ends.len(), 16);
    // E056: numbers of the solver that the change takes away.
    for end in &ends {
        let why = end["why"].as_str().expect("a text");
        assert!(!why.starts_with("E056"), "{why}");
    }
    assert!(
        ends.iter().any(|end| end["ended"] != "refused"),
        "{ends:#?}"
    );
}

#[test]
fn a_case_that_does_not_end_is_a_finding() {
    let folder = Scratch::folder();
    let out = folder.to_str().expect("a path");
    let long = [
        "--set",
        "muscle.0.edge_length=20 mm",
        "--set",
        "solver.xpbd.iterations=1000000",
    ];
    let given = [
        "stress", "press", "--json", "--out", out, "--cases", "1", "--limit", "1", "--seed", "5",
    ];
    let done = run(&[&given, &long[..]].concat());
    assert_eq!(code(&done), Some(1), "{}", text(&done.stderr));
    let summary: Value = serde_json::from_slice(&done.stdout).expect("JSON");
    assert_valid(&summary);
    let found = &summary["stress"]["findings"][0];
    let what = found["what"].as_str().expect("a text");
    assert!(what.contains("not finished within 1 s"), "{what}");
    let command = found["command"].as_str().expect("a text");
    assert!(command.starts_with("pliant run press --set "), "{command}");
}

#[test]
fn another_mesh_of_a_case_is_a_file_of_the_result() {
    let folder = Scratch::folder();
    let out = folder.to_str().expect("a path");
    // Two frames are too few for the keys of the press, so that all cases are refused at once.
    let given = [
        "stress", "press", "--json", "--out", out, "--cases", "5", "--seed", "2", "--frames", "2",
    ];
    let summary: Value = serde_json::from_slice(&run(&given).stdout).expect("JSON");
    assert_valid(&summary);
    assert_eq!(summary["stress"]["refused"], 5, "{summary:#}");
    let files = summary["files"].as_array().expect("a list");
    let name = "meshes/2-4.obj";
    assert!(files.iter().any(|file| file == name), "{files:?}");
    let mesh = pliant::io::read(&folder.join(name)).expect("a mesh").mesh;
    assert!(mesh.triangles.len() > 1000, "{}", mesh.triangles.len());
}

#[test]
fn usual_cases_that_do_not_converge_are_red() {
    let folder = Scratch::folder();
    let out = folder.to_str().expect("a path");
    // The first case is a usual one, and its work is too little for a frame.
    let few = ["--cases", "1", "--work", "1", "--frames", "20"];
    let given = [&["stress", "hip", "--json", "--out", out][..], &few].concat();
    let done = run(&given);
    let summary: Value = serde_json::from_slice(&done.stdout).expect("JSON");
    assert_valid(&summary);
    let verdicts = summary["verdicts"].as_array().expect("a list");
    let share = |v: &&Value| {
        v["name"]
            .as_str()
            .is_some_and(|n| n.starts_with("usual cases"))
    };
    let share = verdicts.iter().find(share).expect("a verdict");
    assert_eq!(done.status.code(), Some(1), "{summary:#}");
    assert_eq!(
        (&share["passed"], &share["value"]),
        (&false.into(), &0.0.into())
    );
    assert_eq!(summary["stress"]["findings"], serde_json::json!([]));
}

#[test]
fn wrong_input_is_refused() {
    for (arguments, message) in [
        (&["stress", "press", "--work", "0"][..], "--work"),
        (&["stress", "no-such-scene"], "no-such-scene"),
        (&["stress"], "SCENE"),
        (&["stress", "press", "--cases", "0"], "--cases"),
        (&["stress", "press", "--set", "frames=-1"], "frames"),
    ] {
        let done = run(arguments);
        assert_eq!(code(&done), Some(2), "{arguments:?}");
        let said = text(&done.stderr);
        assert!(said.contains(message), "{said}");
    }
}
