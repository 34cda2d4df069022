//! Curves of several volumes, fillings on days, target areas, findings.

use std::fs;

use serde_json::Value;

use super::super::{Scratch, json, measures, run, shown, text};
use super::sheet;

#[test]
fn volumes_give_a_curve_and_a_target_area_its_volume() {
    let scratch = Scratch::folder();
    let (file, out) = (scratch.join("sheet.obj"), scratch.join("out"));
    fs::write(&file, sheet(32)).unwrap();
    let middle = (33 * 16 + 16).to_string();
    let common = [
        "implant",
        shown(&file),
        "--unit",
        "cm",
        "--near-vertex",
        &middle,
        "--edge",
        "6mm",
        "--out",
        shown(&out),
        "--json",
    ];
    let done = run(&[&common[..], &["--volumes", "40,60cc,80"]].concat());
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let result = measures(&serde_json::from_slice(&done.stdout).unwrap());
    let gains: Vec<f64> = result["curve"]
        .as_array()
        .unwrap()
        .iter()
        .map(|row| {
            row["area_deformed_m2"].as_f64().unwrap() - row["area_before_m2"].as_f64().unwrap()
        })
        .collect();
    assert!(
        gains.len() == 3 && gains[0] < gains[1] && gains[1] < gains[2],
        "{gains:?}"
    );
    assert_eq!(
        fs::read_to_string(out.join("curve.csv"))
            .unwrap()
            .lines()
            .count(),
        4
    );
    assert!(out.join("curve.svg").is_file());
    // The gain lies between the first two, so the volume must lie between theirs.
    let target = 0.5 * (gains[0] + gains[1]) * 1e4;
    let done = run(&[&common[..], &["--target-area", &format!("{target}cm2")]].concat());
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let result = measures(&serde_json::from_slice(&done.stdout).unwrap());
    let volume = result["implant_volume_m3"].as_f64().unwrap();
    assert!((40e-6..60e-6).contains(&volume), "{volume}");
    assert!(!out.join("curve.csv").exists(), "an earlier result is left");
    let refused = |option: &str, area: &str| {
        let done = run(&[&common[..], &[option, area]].concat());
        (done.status.code(), text(&done.stderr))
    };
    let (code, said) = refused("--wanted-area", "30cm2");
    assert!(code == Some(2) && said.contains("--target-area"), "{said}");
    // No volume gives such an area: the frame cannot be computed.
    let (code, said) = refused("--target-area", "900cm2");
    assert!(
        code == Some(1) && said.contains("no volume up to"),
        "{said}"
    );
}

#[test]
fn an_implant_is_filled_over_days() {
    let scratch = Scratch::folder();
    let (file, out) = (scratch.join("sheet.obj"), scratch.join("out"));
    fs::write(&file, sheet(32)).unwrap();
    let common = [
        "implant",
        shown(&file),
        "--unit",
        "cm",
        "--at",
        "0,0,0",
        "--edge",
        "6mm",
        "--out",
        shown(&out),
    ];
    let done = run(&[&common[..], &["--fill", "0:30cc,7:50cc,14:70cc", "--json"]].concat());
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let result = measures(&serde_json::from_slice(&done.stdout).unwrap());
    let curve = result["curve"].as_array().unwrap();
    let days: Vec<f64> = curve
        .iter()
        .map(|row| row["day"].as_f64().unwrap())
        .collect();
    let areas: Vec<f64> = curve
        .iter()
        .map(|row| row["area_deformed_m2"].as_f64().unwrap())
        .collect();
    assert_eq!(days, [0.0, 7.0, 14.0]);
    assert!(areas[0] < areas[1] && areas[1] < areas[2], "{areas:?}");
    // The output shows the last filling.
    assert_eq!(result["area_deformed_m2"], curve[2]["area_deformed_m2"]);
    assert!((result["implant_volume_m3"].as_f64().unwrap() / 70e-6 - 1.0).abs() <= 1e-9);
    let csv = fs::read_to_string(out.join("curve.csv")).unwrap();
    assert!(
        csv.lines()
            .nth(2)
            .is_some_and(|line| line.starts_with("1,7,")),
        "{csv}"
    );
    assert!(
        fs::read_to_string(out.join("curve.svg"))
            .unwrap()
            .contains("day")
    );
}

#[test]
fn one_volume_stands_in_the_table_and_not_plotted() {
    let scratch = Scratch::folder();
    let (file, out) = (scratch.join("sheet.obj"), scratch.join("out"));
    fs::write(&file, sheet(32)).unwrap();
    let common = [
        "implant",
        shown(&file),
        "--unit",
        "cm",
        "--at",
        "0,0,0",
        "--edge",
        "8mm",
        "--out",
        shown(&out),
    ];
    let done = run(&[&common[..], &["--volumes", "40"]].concat());
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    assert!(out.join("curve.csv").is_file() && !out.join("curve.svg").exists());
    let page = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(
        page.contains("Areas gained by volume") && page.contains("nothing is stretched beyond")
    );
    let over = measures(&json(&out.join("summary.json")))["area_over_limit_m2"].as_f64();
    assert!(over.is_some_and(|over| over == 0.0 && over.is_sign_positive()));
}

#[test]
fn far_stretched_skin_is_a_finding_and_every_check_is_in_the_exit_code() {
    let scratch = Scratch::folder();
    let (file, out) = (scratch.join("sheet.obj"), scratch.join("out"));
    fs::write(&file, sheet(24)).unwrap();
    let common = [
        "implant",
        shown(&file),
        "--unit",
        "cm",
        "--at",
        "0,0,0",
        "--edge",
        "8mm",
        "--out",
        shown(&out),
    ];
    let of = |more: &[&str]| {
        let done = run(&[&common[..], more, &["--json"]].concat());
        let result: Value = serde_json::from_slice(&done.stdout).unwrap_or_default();
        (
            done.status.code(),
            result,
            fs::read_to_string(out.join("report.html")).unwrap(),
        )
    };
    let (code, result, page) = of(&["--volumes", "60,80", "--stretch-limit", "1.01"]);
    let verdicts = result["verdicts"].as_array().unwrap();
    let all = verdicts.iter().all(|v| v["passed"] == true);
    assert!(
        verdicts[0]["name"] == "frames that are not at rest" && verdicts[0]["where"] == "implant",
        "{verdicts:?}"
    );
    assert_eq!(
        (code, result["converged"].as_bool()),
        (Some(i32::from(!all)), Some(all)),
        "{result}"
    );
    assert!(
        result["implant"]["area_over_limit_m2"].as_f64().unwrap() > 1e-4,
        "{result}"
    );
    assert!(
        result["findings"][0]
            .as_str()
            .unwrap()
            .contains("stretched beyond 1.01"),
        "{result}"
    );
    assert_eq!(
        page.contains("✗ fail"),
        !all,
        "the page does not agree with the exit code"
    );
    assert!(page.contains("→ found") && page.contains("stretched beyond 1.01"));
    let (_, result, page) = of(&["--volume", "60cc", "--stretch-limit", "9"]);
    assert_eq!(result["implant"]["area_over_limit_m2"].as_f64(), Some(0.0));
    assert!(page.contains("nothing is stretched beyond 9.00"));
}
