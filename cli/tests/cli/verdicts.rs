//! Failed verdicts: the exit code, `--lenient`, and what to do.

use super::{Scratch, json, run, shown, text};

#[test]
fn a_failed_check_ends_with_exit_code_1() {
    let scratch = Scratch::folder();
    let run_with = |name: &str, more: &[&str]| {
        let out = scratch.join(name);
        let first = ["run", "chain", "--out", shown(&out)];
        let done = run(&[&first, more].concat());
        (done.status.code(), text(&done.stderr), out)
    };
    let (code, said, _) = run_with("kept", &[]);
    assert_eq!(code, Some(0), "control: {said}");
    // One sweep leaves more than a hundredth of an edge.
    let strict = ["--set", "solver.pbd.tolerance=0.01"];
    let (code, said, out) = run_with("failed", &strict);
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("FAIL"), "{said}");
    assert_eq!(json(&out.join("summary.json"))["converged"], false);
    let (code, said, out) = run_with("lenient", &[&strict[..], &["--lenient"]].concat());
    assert_eq!(code, Some(0), "{said}");
    let summary = json(&out.join("summary.json"));
    assert_eq!(summary["passed"], false);
    let notes = summary["notes"].as_array().unwrap();
    assert!(
        notes
            .iter()
            .any(|n| n.as_str().unwrap().contains("--lenient"))
    );
    let (code, said, _) = run_with("gone", &["--strict"]);
    assert_eq!(code, Some(2), "{said}");
    assert!(said.contains("--lenient"), "{said}");
}

#[test]
fn an_infinite_stretch_is_no_finite_number() {
    let scratch = Scratch::folder();
    let out = scratch.join("out");
    // Only the angles are kept: under its load the tetrahedron has no equilibrium.
    let given = ["run", "shape", "--frames", "3", "--out", shown(&out)];
    let done = run(&[&given[..], &["--set", "solver=quasi_static"]].concat());
    let said = text(&done.stderr);
    assert_eq!(done.status.code(), Some(1), "{said}");
    assert!(
        said.contains("FAIL") && said.contains("all numbers are finite"),
        "{said}"
    );
    assert!(said.contains("effects.stretch"), "{said}");
    let done = run(&[&given[..], &["--set", "solver=pbd"]].concat());
    assert_eq!(
        done.status.code(),
        Some(0),
        "control: {}",
        text(&done.stderr)
    );
}

#[test]
fn an_attachment_of_which_the_motion_frees_most_is_red() {
    let scratch = Scratch::folder();
    let run_to = |closed: &str| {
        let out = scratch.join(closed);
        let attached = "muscle.0.attachment=[{bone='upper plate', near='9 mm', limit='8 %'}]";
        let to = format!("bone.0.motion.keys.1.translation=['0 mm', '{closed} mm', '0 mm']");
        let sets = ["muscle.0.edge_length=8 mm", attached, to.as_str()].map(|s| ["--set", s]);
        let given = ["run", "press", "--frames", "1", "--out", shown(&out)];
        let done = run(&[&given[..], sets.as_flattened()].concat());
        (done.status.code(), text(&done.stderr))
    };
    // The plates close on all but 21 of its 150 vertices.
    let (code, said) = run_to("14");
    assert_eq!(code, Some(1), "{said}");
    let name = "share of an attachment that the motion would carry into another bone: 0.86";
    assert!(
        said.contains(name) && said.contains("centre of the joint"),
        "{said}"
    );
    let (code, said) = run_to("26");
    assert_eq!(code, Some(0), "control: {said}");
}
