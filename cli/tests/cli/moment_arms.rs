//! `pliant moment-arms`: files, numbers, refusals.

use std::fs;

use super::{Scratch, json, measures, names_in, run, shown, text};

const SMALL: [&str; 12] = [
    "moment-arms",
    "hip",
    "--joint",
    "hip",
    "--from=-4deg",
    "--to",
    "8deg",
    "--step",
    "2deg",
    "--count",
    "10",
    "--smooth=0",
];

#[test]
fn the_built_in_hip() {
    let scratch = Scratch::folder();
    let out = scratch.join("out");
    let table = scratch.join("others.csv");
    fs::write(
        &table,
        "# mm moment arm\nangle_deg,gluteus1_mm,gluteus2_mm\n-10,-100,0\n60,-100,0\n",
    )
    .expect("written");
    let done = run(&[
        &SMALL[..],
        &["--json", "--compare", shown(&table), "--out", shown(&out)],
        &[
            "--opensim",
            "/jointset/hip_r/hip_flexion_r",
            "--forces",
            "gluteus=glmax1_r",
        ],
    ]
    .concat());
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let said: serde_json::Value = serde_json::from_slice(&done.stdout).expect("JSON");
    assert_eq!(said, json(&out.join("summary.json")));
    let said = measures(&said);
    let muscle = &said["muscles"][0];
    let number = |key: &str| muscle[key].as_f64().unwrap_or(f64::NAN);
    assert_eq!(
        (said["values"].as_u64(), muscle["fibres"].as_u64()),
        (Some(7), Some(10))
    );
    assert!(
        number("moment_arm_greatest_m") < 0.0 && number("moment_arm_least_m") > -0.1,
        "an extensor: {muscle}"
    );
    assert!(
        number("volume_error_max") <= 1e-9 && number("points_in_bone") == 0.0,
        "{muscle}"
    );
    let compared = &muscle["compared"][0];
    assert_eq!(
        (compared["reference"].as_str(), compared["overlap"].as_f64()),
        (Some("others"), Some(1.0)),
        "{compared}"
    );
    let names = names_in(&out);
    for name in [
        "fibres.csv",
        "fibres.pvd",
        "gluteus.svg",
        "moment_arms.csv",
        "picture_0.png",
        "report.html",
    ] {
        assert!(
            names.iter().any(|n| n == name),
            "{name} is not in {names:?}"
        );
    }
    let rows = |file: &str| {
        fs::read_to_string(out.join(file))
            .expect("a table")
            .lines()
            .count()
    };
    assert_eq!((rows("moment_arms.csv"), rows("fibres.csv")), (8, 71));
    // A polynomial for OpenSim is that of the tables beside it, up to the errors that it states.
    let path = &said["opensim"][0];
    assert_eq!(path["force"], "/forceset/glmax1_r");
    let coefficients: Vec<f64> =
        serde_json::from_value(path["coefficients"].clone()).expect("numbers");
    let table = |name: &str| -> Vec<Vec<f64>> {
        let text = fs::read_to_string(out.join(format!("hip_{name}.sto"))).expect("a table");
        let (head, body) = text.split_once("endheader\n").expect("a header");
        assert!(head.contains("inDegrees=no"));
        let rows = body.lines().skip(1);
        rows.map(|row| {
            row.split('\t')
                .map(|cell| cell.parse().expect("a number"))
                .collect()
        })
        .collect()
    };
    let (lengths, arms) = (table("path_lengths"), table("moment_arms"));
    // The normal equations of least squares over lengths and moment arms.
    let mut sums = vec![(0.0, 0.0); coefficients.len()];
    for (k, row) in table("coordinate_values").iter().enumerate() {
        let q = row[1];
        let power = |(i, c): (usize, &f64)| c * q.powi(i as i32);
        let length: f64 = coefficients.iter().enumerate().map(power).sum();
        let slope: f64 = (1..coefficients.len())
            .map(|i| i as f64 * coefficients[i] * q.powi(i as i32 - 1))
            .sum();
        assert!(
            (length - lengths[k][1]).abs() <= 1e-3,
            "{length} {}",
            lengths[k][1]
        );
        assert!(
            (-slope - arms[k][1]).abs() <= 5e-3,
            "{slope} {}",
            arms[k][1]
        );
        let (off, turn) = (length - lengths[k][1], -slope - arms[k][1]);
        for (i, (sum, size)) in sums.iter_mut().enumerate() {
            let by_length = off * q.powi(i as i32);
            let by_arm = turn * -(i as f64) * q.powi(i as i32 - 1);
            let by_arm = if i == 0 { 0.0 } else { by_arm };
            *sum += by_length + by_arm;
            *size += by_length.abs() + by_arm.abs();
        }
    }
    for (i, (sum, size)) in sums.iter().enumerate() {
        // Rounding of numbers of a tenth of a metre beside residuals of a hundredth of a millimetre.
        assert!(
            size > &0.0 && sum.abs() <= 1e-6 * size,
            "{i}: {sum} of {size}"
        );
    }
    let set = fs::read_to_string(out.join("hip_FunctionBasedPathSet.xml")).expect("a set");
    for text in [
        "<FunctionBasedPath name=\"/forceset/glmax1_r\">",
        "<coordinate_paths>/jointset/hip_r/hip_flexion_r</coordinate_paths>",
        &format!("<order>{}</order>", coefficients.len() - 1),
    ] {
        assert!(set.contains(text), "{text} is not in {set}");
    }
}

#[test]
fn what_cannot_be_is_refused() {
    let scratch = Scratch::folder();
    let out = scratch.join("out");
    let no_unit = scratch.join("no-unit.csv");
    fs::write(&no_unit, "angle_deg,gluteus\n0,1\n").expect("written");
    for (arguments, expected) in [
        (
            &["hip", "--joint", "knee"][..],
            "no joint `knee`; known: hip",
        ),
        (
            &["hip", "--joint", "hip", "--from", "20deg", "--to", "10deg"],
            "the first angle must be below the last; `pliant moment-arms --help`",
        ),
        (&["hip", "--joint", "hip", "--to", "60"], "no unit"),
        (
            &["hip", "--joint", "hip", "--to", "200deg"],
            "at most 180 degrees",
        ),
        (
            &["hip", "--joint", "hip", "--step", "0deg"],
            "no or too many values",
        ),
        (
            &["hip", "--joint", "hip", "--step", "20deg"],
            "too few to smooth over",
        ),
        (
            &["hip", "--joint", "hip", "--count", "100000"],
            "too many to carry",
        ),
        (
            &["hip", "--joint", "hip", "--opensim", "hip_flexion_r"],
            "expected an absolute path",
        ),
        (
            &[
                "hip",
                "--joint",
                "hip",
                "--opensim",
                "/j/q",
                "--forces",
                "a",
            ],
            "expected MUSCLE=FORCE",
        ),
        (
            &[
                "hip",
                "--joint",
                "hip",
                "--opensim",
                "/j/q",
                "--forces",
                "nobody=f",
            ],
            "no muscle `nobody` crosses the joint",
        ),
        (
            &["hip", "--joint", "hip", "--axis", "0,0"],
            "expected three numbers",
        ),
        (
            &["hip", "--joint", "hip", "--compare", "nothing.csv"],
            "cannot read `nothing.csv`",
        ),
        (&["lattice", "--joint", "hip"], "this scene has none"),
        (&["hip"], "--joint"),
    ] {
        let done = run(&[&["moment-arms"], arguments, &["--out", shown(&out)]].concat());
        assert_eq!(
            done.status.code(),
            Some(2),
            "{arguments:?}: {}",
            text(&done.stderr)
        );
        assert!(
            text(&done.stderr).contains(expected),
            "{arguments:?}: {}",
            text(&done.stderr)
        );
        assert!(!out.exists(), "{arguments:?}");
    }
    let done = run(&[
        &SMALL[..],
        &["--compare", shown(&no_unit), "--out", shown(&out)],
    ]
    .concat());
    assert_eq!(done.status.code(), Some(2));
    assert!(
        text(&done.stderr).contains("does not tell the unit of column `gluteus`"),
        "{}",
        text(&done.stderr)
    );
}
