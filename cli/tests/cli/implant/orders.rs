//! Rejected orders, and folders of results.

use std::fs;

use super::super::{Scratch, names_in, run, shown, text};
use super::sheet;

#[test]
fn bad_orders_say_what_to_change() {
    let scratch = Scratch::folder();
    let file = scratch.join("sheet.obj");
    fs::write(&file, sheet(16)).unwrap();
    let refused = |more: &[&str], expected: &str| {
        let done = run(&[
            &[
                "implant",
                shown(&file),
                "--out",
                shown(&scratch.join("out")),
            ],
            more,
        ]
        .concat());
        let said = text(&done.stderr);
        assert_eq!(done.status.code(), Some(2), "{more:?}: {said}");
        assert!(said.contains(expected), "{more:?}: {said}");
    };
    let at = ["--unit", "cm", "--at", "0,0,0"];
    let with = |more: &[&'static str]| [&at[..], more].concat();
    refused(&["--at", "0,0,0"], "--unit");
    refused(&["--unit", "parsec", "--at", "0,0,0"], "known units");
    refused(&["--unit", "cm"], "--near-vertex");
    refused(&["--unit", "cm", "--at", "0,0"], "three numbers");
    refused(&["--unit", "cm", "--at", "0,0,nan"], "three numbers");
    refused(&["--unit", "cm", "--at", "0,0,90"], "check --at and --unit");
    refused(&["--unit", "cm", "--at", "8,0,0"], "border");
    refused(
        &["--unit", "cm", "--near-vertex", "99999"],
        "no vertex 99999",
    );
    refused(&with(&["--volume", "-100cc"]), "a volume greater than zero");
    refused(&with(&["--volume", "100"]), "`100` has no unit");
    refused(&with(&["--volume", "nancc"]), "not a finite number");
    refused(
        &with(&["--volume", "somecc"]),
        "`somecc` does not begin with a number",
    );
    refused(&with(&["--volume", "9l"]), "larger than the region");
    refused(
        &with(&["--thickness", "0mm"]),
        "--thickness 0mm: `0mm` is not allowed here",
    );
    refused(&with(&["--shape", "star"]), "there are: round");
    refused(&with(&["--edge", "1um"]), "make --edge larger");
    refused(
        &with(&["--implant", "at=0,0,0", "--implant", "at=1,0,0"]),
        "overlap",
    );
    refused(&with(&["--implant", "colour=red"]), "unknown key");
    refused(
        &with(&["--fill", "0:30cc,7:20cc"]),
        "filling 2: its volume is less",
    );
    refused(&with(&["--fill", "7:30cc,7:50cc"]), "filling 2: its day");
    refused(&with(&["--fill", "30cc"]), "as in 0:30cc");
    refused(
        &with(&["--fill", "0:30cc", "--volume", "50cc"]),
        "cannot be used with",
    );
    refused(&with(&["--stretch-limit", "0.5"]), "a number from 1 to 100");
    refused(&with(&["--stretch-limit", "nan"]), "a number from 1 to 100");
    refused(&with(&["--method", "guess"]), "there are: newton");
    refused(
        &with(&["--volumes", "10,somuch"]),
        "--volumes 10,somuch: `somuch` does not begin",
    );
}

#[test]
fn a_place_for_results_is_looked_at_before_anything_is_computed() {
    let scratch = Scratch::folder();
    let file = scratch.join("sheet.obj");
    fs::write(&file, sheet(16)).unwrap();
    let damaged = scratch.join("damaged.obj");
    fs::write(&damaged, "v 0 0").unwrap();
    let into = |out: &str| {
        // A damaged skin would be reported if the command read it first.
        let done = run(&[
            "implant",
            shown(&damaged),
            "--unit",
            "cm",
            "--at",
            "0,0,0",
            "--out",
            out,
        ]);
        (done.status.code(), text(&done.stderr))
    };
    let (code, said) = into(shown(&file));
    assert!(
        code == Some(2) && said.contains("is not a folder"),
        "{said}"
    );
    let foreign = scratch.join("foreign");
    fs::create_dir_all(&foreign).unwrap();
    fs::write(foreign.join("skin.vtp"), "mine").unwrap();
    let (code, said) = into(shown(&foreign));
    assert!(
        code == Some(2) && said.contains("was not written by pliant"),
        "{said}"
    );
    assert_eq!(
        names_in(&foreign),
        ["skin.vtp"],
        "something was left behind"
    );
    if cfg!(target_os = "linux") {
        let (code, said) = into("/proc/pliant");
        assert!(
            code == Some(2) && said.contains("cannot be written to"),
            "{said}"
        );
    }
    let (_, said) = into(shown(&scratch.join("new")));
    assert!(
        said.contains("damaged.obj") && !scratch.join("new").exists(),
        "{said}"
    );
}

#[test]
fn senseless_orders_are_refused_in_the_words_of_the_user() {
    let scratch = Scratch::folder();
    let file = scratch.join("sheet.obj");
    fs::write(&file, sheet(16)).unwrap();
    let out = scratch.join("out");
    let common = [
        "implant",
        shown(&file),
        "--unit",
        "cm",
        "--out",
        shown(&out),
    ];
    let refused = |more: &[&str], expected: &[&str]| {
        let done = run(&[&common[..], more].concat());
        let said = text(&done.stderr);
        assert_eq!(done.status.code(), Some(2), "{more:?}: {said}");
        expected
            .iter()
            .for_each(|word| assert!(said.contains(word), "{more:?}: no `{word}` in {said}"));
        said
    };
    fn with<'a>(more: &[&'a str]) -> Vec<&'a str> {
        [&["--at", "0,0,0"], more].concat()
    }
    refused(
        &with(&["--depth", "50cm"]),
        &["--depth 50cm", "half of the base of 7 cm", "at most 3.5 cm"],
    );
    refused(
        &with(&["--thickness", "30cm"]),
        &["--thickness 30cm", "at most 3.5 cm"],
    );
    refused(&with(&["--long", "0,0,0"]), &["--long", "direction"]);
    refused(
        &with(&["--edge", "50cm"]),
        &["--edge 50cm", "a quarter of it, 1.75 cm"],
    );
    refused(
        &with(&["--obstacle", shown(&file)]),
        &["obstacle 1", "the skin itself"],
    );
    refused(
        &with(&["--volume", "-100cc"]),
        &["--volume -100cc: `-100cc`", "a volume greater than zero"],
    );
    refused(
        &with(&["--volumes", "10,-5"]),
        &["--volumes 10,-5: `-5 cc`", "a volume greater than zero"],
    );
    refused(
        &with(&["--implant", "volume=-3ml"]),
        &["--implant: volume -3ml", "`-3ml`"],
    );
    refused(&["--near-vertex", "-3"], &["vertices count from 0"]);
    refused(&["--near-vertex", "half"], &["vertices count from 0"]);
    // What is said to fit does, and a little less or more does not.
    let number = |said: &str, before: &str, after: &str| -> f64 {
        let from = said
            .find(before)
            .unwrap_or_else(|| panic!("no `{before}` in {said}"))
            + before.len();
        let to = from
            + said[from..]
                .find(after)
                .unwrap_or_else(|| panic!("no `{after}` in {said}"));
        said[from..to]
            .trim()
            .parse()
            .unwrap_or_else(|e| panic!("{e}: {said}"))
    };
    let fits = |more: &[&str]| {
        let done = run(&[&common[..], more, &["--json"]].concat());
        assert!(
            matches!(done.status.code(), Some(0 | 1)),
            "{more:?}: {}",
            text(&done.stderr)
        );
    };
    let least = number(
        &refused(&with(&["--volume", "0.001cc"]), &["no implant"]),
        "at least",
        "cc",
    );
    assert!((0.5..3.0).contains(&least), "{least} cc");
    fits(&with(&["--volume", &format!("{least}cc")]));
    refused(
        &["--at", "0,0,0", "--volume", &format!("{}cc", 0.9 * least)],
        &["no implant"],
    );
    let most = number(
        &refused(&with(&["--volume", "9l"]), &["larger than the region"]),
        "at most",
        "cc",
    );
    assert!((150.0..1000.0).contains(&most), "{most} cc");
    refused(
        &["--at", "0,0,0", "--volume", &format!("{}cc", 1.2 * most)],
        &["larger than the region"],
    );
    // 3 cm from the border, so 6 cm across never fit.
    let base = number(
        &refused(&["--at", "7,0,0"], &["border"]),
        "a base of",
        "cm would fit",
    );
    assert!((2.5..6.0).contains(&base), "{base} cm");
    fits(&[
        "--at",
        "7,0,0",
        "--base",
        &format!("{base}cm"),
        "--volume",
        "8cc",
    ]);
}
