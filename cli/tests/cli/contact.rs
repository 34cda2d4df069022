//! `pliant contact`: the table of responses and methods on a built-in scene, and wrong input.

use super::check::code;
use super::schema::assert_valid;
use super::{run, text};
use serde_json::Value;

/// Exit code and summary of a comparison on the built-in press.
fn contact(more: &[&str]) -> (Option<i32>, Value) {
    let done = run(&[&["contact", "press", "--json"], more].concat());
    let summary = serde_json::from_slice(&done.stdout);
    (
        code(&done),
        summary.unwrap_or_else(|_| panic!("{}", text(&done.stderr))),
    )
}

#[test]
fn plates_swallow_vertices_and_each_response_has_a_row() {
    let (code, summary) = contact(&[]);
    assert_eq!(code, Some(0), "{summary:#}");
    assert_valid(&summary);
    let measured = &summary["contact"];
    let inside = measured["inside"].as_u64().expect("a count");
    assert!(inside > 10, "{inside}");
    // The start has no vertex inside, so that every side is known.
    assert_eq!(measured["sides_known"], measured["inside"]);
    let rows = measured["responses"].as_array().expect("rows");
    let methods = measured["detection"].as_array().expect("rows");
    assert_eq!((rows.len(), methods.len()), (9, 6));
    let row = |name: &str| {
        let found = rows.iter().find(|row| row["response"] == name);
        found.unwrap_or_else(|| panic!("no {name}"))
    };
    for name in ["nearest vertex", "nearest point", "motion of the bone"] {
        assert_eq!(row(name)["inside"], 0, "{name}");
    }
    // Control: a millimetre is not enough for all.
    assert!(row("normal of a triangle, 1 mm")["inside"].as_u64() > Some(0));
    for method in methods {
        assert_eq!(method["kept"], true, "{method}");
    }
    assert!(
        rows.iter()
            .all(|row| row["time_ratio"].as_f64() >= Some(1.0))
    );
}

#[test]
fn bones_that_do_not_move_swallow_nothing_and_that_fails() {
    let (code, summary) = contact(&["--ahead", "0"]);
    assert_eq!((code, &summary["passed"]), (Some(1), &Value::Bool(false)));
    assert_valid(&summary);
    assert_eq!(summary["contact"]["inside"], 0);
}

#[test]
fn wrong_input_is_refused() {
    for (arguments, message) in [
        (&["contact", "no-such-scene"][..], "no-such-scene"),
        (&["contact", "expander"], "contact of muscles"),
        (&["contact", "hip", "--frame", "301"], "from 0 to 300"),
        (&["contact", "hip", "--frame", "x"], "--frame"),
    ] {
        let done = run(arguments);
        assert_eq!(code(&done), Some(2), "{arguments:?}");
        let said = text(&done.stderr);
        assert!(said.contains(message), "{arguments:?}: {said}");
    }
}

#[test]
fn the_text_has_both_tables() {
    let done = run(&["contact"]);
    let said = text(&done.stdout);
    for part in [
        "vector field",
        "octree",
        "RMS motion [mm]",
        "memory [MB]",
        "frame 0",
    ] {
        assert!(said.contains(part), "{part}: {said}");
    }
}
