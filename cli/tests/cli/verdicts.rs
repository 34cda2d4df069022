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
