//! `pliant sensitivities` and `pliant fit`: results, what a shape cannot tell, and wrong input.

use std::fs;

use super::check::code;
use super::schema::assert_valid;
use super::{Scratch, run, shown, text};
use serde_json::Value;

fn summary(arguments: &[&str]) -> (Option<i32>, Value) {
    let done = run(arguments);
    let summary = serde_json::from_slice(&done.stdout);
    let summary: Value = summary.unwrap_or_else(|_| panic!("{}", text(&done.stderr)));
    assert_valid(&summary);
    (code(&done), summary)
}

#[test]
fn an_implant_has_intervals_and_a_pressure_tells_its_modulus() {
    let out = Scratch::folder();
    let folder = out.join("intervals").display().to_string();
    let modulus = "skin.modulus=200 kPa +- 30 %";
    let (code, found) = summary(&[
        "sensitivities",
        "flat-implant",
        "--json",
        "--runs",
        "never",
        "--set",
        modulus,
        "--out",
        &folder,
    ]);
    assert_eq!(code, Some(0), "{found:#}");
    let measures = found["sensitivities"]["measures"]
        .as_array()
        .expect("measures");
    let of = |name: &str| {
        measures
            .iter()
            .find(|m| m["name"] == name)
            .expect("a measure")
    };
    let gain = of("area_gain_m2");
    assert!(gain["half"].as_f64() > Some(0.0) && gain["elasticities"][0].as_f64() < Some(0.0));
    // A run of the same scene says that it leaves the interval out.
    let plain = out.join("plain").display().to_string();
    let arguments = [
        "run",
        "flat-implant",
        "--json",
        "--set",
        modulus,
        "--out",
        &plain,
    ];
    let (code, plain) = summary(&arguments);
    let notes = plain["notes"].to_string();
    assert_eq!(code, Some(0), "{notes}");
    assert!(notes.contains("modulus has an interval"), "{notes}");
    for file in ["report.html", "sensitivities.csv", "summary.json"] {
        assert!(out.join("intervals").join(file).is_file(), "{file}");
    }
    // With half as much again of the modulus the pressure is about a third higher.
    let pressure = of("pressure_pa")["value"].as_f64().expect("a number");
    let measured = format!("pressure_pa={} +- 20 Pa", 1.1 * pressure);
    let folder = out.join("fit").display().to_string();
    let wide = "skin.modulus=200 kPa +- 90 %";
    let (code, fitted) = summary(&[
        "fit",
        "flat-implant",
        "--json",
        "--measured",
        &measured,
        "--set",
        wide,
        "--out",
        &folder,
    ]);
    assert_eq!(code, Some(0), "{fitted:#}");
    let value = fitted["fit"]["values"][0]["value"]
        .as_f64()
        .expect("a number");
    assert!(value > 2.1e5 && value < 2.5e5, "{value}");
}

#[test]
fn wrong_input_is_refused() {
    let modulus = "skin.modulus=200 kPa +- 30 %";
    for (arguments, message) in [
        (
            &["sensitivities", "flat-implant"][..],
            "no value of the scene has an interval",
        ),
        (
            &[
                "sensitivities",
                "flat-implant",
                "--set",
                "skin.modulus=200 kPa +- 0 %",
            ],
            "has no interval that is greater than zero",
        ),
        (
            &[
                "sensitivities",
                "flat-implant",
                "--set",
                "skin.modulus=200 kPa +- 5 mm",
            ],
            "`mm` is a unit of length, not of pressure",
        ),
        (
            &[
                "sensitivities",
                "flat-implant",
                "--at",
                "9",
                "--set",
                modulus,
            ],
            "--at 9 is after the last frame",
        ),
        (
            &["sensitivities", "lattice", "--set", "name=x"],
            "no value of the scene has an interval",
        ),
        (&["fit", "flat-implant", "--set", modulus], "--target"),
        (
            &[
                "fit",
                "flat-implant",
                "--set",
                modulus,
                "--measured",
                "pressure_pa=6 kPa",
            ],
            "it has no interval",
        ),
        (
            &[
                "fit",
                "flat-implant",
                "--set",
                modulus,
                "--measured",
                "weight_n=6 +- 1 N",
            ],
            "no measure `weight_n`; known: area_deformed_m2",
        ),
        (
            &[
                "fit",
                "flat-implant",
                "--set",
                modulus,
                "--target",
                "no-such.stl",
            ],
            "no-such.stl",
        ),
    ] {
        let out = Scratch::folder();
        let folder = out.join("out").display().to_string();
        let done = run(&[arguments, &["--out", &folder]].concat());
        let said = text(&done.stderr);
        assert_eq!(code(&done), Some(2), "{arguments:?}: {said}");
        assert!(said.contains(message), "{arguments:?}: {said}");
    }
}

#[test]
fn a_scan_under_gravity_is_unloaded() {
    let scratch = Scratch::folder();
    let out = scratch.join("out");
    let gravity = "effects.gravity.acceleration=['0 m/s2', '-20 m/s2', '0 m/s2']";
    let command = |more: &[&str]| {
        let mut arguments = vec![
            "unload",
            "cube",
            "--set",
            gravity,
            "--json",
            "--out",
            shown(&out),
        ];
        arguments.extend(more);
        run(&arguments)
    };
    let done = command(&[]);
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let summary: Value = serde_json::from_slice(&done.stdout).unwrap();
    assert_valid(&summary);
    let found = &summary["unload"];
    let rounds: Vec<f64> = found["rounds_m"]
        .as_array()
        .unwrap()
        .iter()
        .map(|r| r.as_f64().unwrap())
        .collect();
    assert!(
        rounds[0] > 2e-5 && rounds[rounds.len() - 1] <= 1e-5,
        "{rounds:?}"
    );
    let shape = pliant::io::read(&out.join("cube.obj")).unwrap().mesh;
    assert!(
        shape.vertices.len() > 300
            && out.join("cube.vtp").is_file()
            && out.join("unload.csv").is_file()
    );
    // Controls: a load under which a shape cannot stand is red or refused; wrong numbers are refused.
    let done = command(&[
        "--set",
        "effects.gravity.acceleration=['0 m/s2', '-1e5 m/s2', '0 m/s2']",
    ]);
    assert_eq!(done.status.code(), Some(1), "{}", text(&done.stderr));
    for (more, expected) in [
        (["--tolerance", "0 mm"], "not greater than zero"),
        (["--tolerance", "3"], "--tolerance 3"),
        (["--at", "1000"], "after the last frame"),
    ] {
        let done = command(&more);
        let said = text(&done.stderr);
        assert!(
            done.status.code() == Some(2) && said.contains(expected),
            "{said}"
        );
    }
    let done = run(&["unload", "flat-implant"]);
    assert_eq!(done.status.code(), Some(2));
}

#[test]
fn the_error_of_the_mesh_stands_in_the_summary_if_it_is_asked_for() {
    let scratch = Scratch::folder();
    let out = scratch.join("out");
    let common = ["run", "cube", "--frames", "2", "--json", "--lenient"];
    let of = |more: &[&str]| {
        let mut arguments = common.to_vec();
        arguments.extend(["--out", shown(&out)]);
        arguments.extend(more);
        let (code, summary) = summary(&arguments);
        assert_eq!(code, Some(0), "{summary:#}");
        summary["muscles"]["error_estimate"]["mesh_m"].clone()
    };
    let stated = of(&["--mesh-error"]).as_f64().expect("a length");
    assert!(stated > 1e-7 && stated < 1e-3, "{stated}");
    let page = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(
        page.contains("estimated error of the mesh")
            && page.contains("a second run with triangles")
    );
    assert_eq!(of(&["--set", "mesh_error=true"]).as_f64(), Some(stated));
    // Control: nothing is made up.
    assert!(of(&[]).is_null());
    let done = run(&["run", "cube", "--set", "mesh_error=3"]);
    assert_eq!(done.status.code(), Some(2), "{}", text(&done.stderr));
}
