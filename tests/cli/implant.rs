//! `pliant implant`: what a planner asks for and what is refused.

use std::fmt::Write as _;
use std::fs;

use pliant::mesh::shapes::icosphere;
use pliant::mesh::{Topology, TriangleMesh};
use pliant::skin::Order;
use pliant::skin::plan::{Place, Ready};
use serde_json::Value;

use super::{Scratch, json, run, shown, text};

/// A flat sheet of 20 cm in `n` by `n` cells as OBJ in centimetres; its middle vertex is `(n + 1) n / 2 + n / 2`.
fn sheet(n: u32) -> String {
    let mut obj = String::new();
    let at = |k: u32| 20.0 * f64::from(k) / f64::from(n) - 10.0;
    for (i, j) in (0..=n).flat_map(|i| (0..=n).map(move |j| (i, j))) {
        let _ = writeln!(obj, "v {} {} 0", at(i), at(j));
    }
    for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
        let a = i * (n + 1) + j + 1;
        let _ = writeln!(obj, "f {a} {} {}\nf {a} {} {}", a + n + 1, a + n + 2, a + n + 2, a + 1);
    }
    obj
}

#[test]
fn an_implant_gives_areas_with_their_sources_and_files() {
    let scratch = Scratch::new("implant");
    let (file, out) = (scratch.join("sheet.obj"), scratch.join("out"));
    fs::write(&file, sheet(40)).unwrap();
    let middle = (41 * 20 + 20).to_string();
    let common =
        ["implant", shown(&file), "--unit", "cm", "--near-vertex", &middle, "--edge", "5mm", "--out", shown(&out)];
    let done = run(&[&common[..], &["--volume", "100cc", "--json"]].concat());
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let result: Value = serde_json::from_slice(&done.stdout).unwrap();
    let number =
        |path: &str| result.pointer(path).and_then(Value::as_f64).unwrap_or_else(|| panic!("{path}: {result}"));
    assert_eq!(result["converged"], true);
    let gain = (number("/area_deformed_m2") - number("/area_before_m2")) * 1e4;
    assert!((14.5..=44.3).contains(&gain), "{gain} cm2");
    for span in ["retracted", "grown"] {
        let [low, high] = ["low", "high"].map(|end| number(&format!("/area_{span}_m2/{end}")));
        assert!(number("/area_before_m2") <= low && low < high && high <= number("/area_deformed_m2"), "{span}");
        assert!(result["sources"][format!("area_{span}_m2")].as_str().is_some_and(|s| s.contains('[')), "{span}");
    }
    assert!((number("/implant_volume_m3") / 1e-4 - 1.0).abs() <= 1e-9);
    assert!(number("/volume_difference_m3") >= 0.995e-4 && number("/stretch_max") > 1.0);
    assert!(number("/region/springs") > 4.0 * number("/region/vertices") && number("/steps") >= 1.0);
    assert!(number("/time_s") > 0.0);
    for name in ["report.html", "skin.vtp", "implant_1.vtp", "stretch.png", "side.png", "before.png", "summary.json"] {
        assert!(out.join(name).is_file(), "{name}");
    }
    let page = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(page.contains("area retracted [cm2]") && page.contains("vanrappard1988"));
    let skin = pliant::io::read(&out.join("skin.vtp")).unwrap().mesh;
    let highest = skin.vertices.iter().map(|p| p.z).fold(0.0, f64::max);
    assert!((0.02..0.08).contains(&highest), "{highest} m");
    let kept = json(&out.join("summary.json"));
    assert_eq!(kept["area_deformed_m2"], result["area_deformed_m2"]);
}

#[test]
fn volumes_give_a_curve_and_a_wanted_area_its_volume() {
    let scratch = Scratch::new("implant-curve");
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
    let result: Value = serde_json::from_slice(&done.stdout).unwrap();
    let gains: Vec<f64> = result["curve"]
        .as_array()
        .unwrap()
        .iter()
        .map(|row| row["area_deformed_m2"].as_f64().unwrap() - row["area_before_m2"].as_f64().unwrap())
        .collect();
    assert!(gains.len() == 3 && gains[0] < gains[1] && gains[1] < gains[2], "{gains:?}");
    assert_eq!(fs::read_to_string(out.join("curve.csv")).unwrap().lines().count(), 4);
    assert!(out.join("curve.svg").is_file());
    // Between the first two, so must the volume be.
    let wanted = 0.5 * (gains[0] + gains[1]) * 1e4;
    let done = run(&[&common[..], &["--wanted-area", &format!("{wanted}cm2")]].concat());
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let result: Value = serde_json::from_slice(&done.stdout).unwrap();
    let volume = result["implant_volume_m3"].as_f64().unwrap();
    assert!((40e-6..60e-6).contains(&volume), "{volume}");
    assert!(!out.join("curve.csv").exists(), "an earlier result is left");
}

#[test]
fn an_implant_is_filled_over_days() {
    let scratch = Scratch::new("implant-fill");
    let (file, out) = (scratch.join("sheet.obj"), scratch.join("out"));
    fs::write(&file, sheet(32)).unwrap();
    let common = ["implant", shown(&file), "--unit", "cm", "--at", "0,0,0", "--edge", "6mm", "--out", shown(&out)];
    let done = run(&[&common[..], &["--fill", "0:30cc,7:50cc,14:70cc", "--json"]].concat());
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let result: Value = serde_json::from_slice(&done.stdout).unwrap();
    let curve = result["curve"].as_array().unwrap();
    let days: Vec<f64> = curve.iter().map(|row| row["day"].as_f64().unwrap()).collect();
    let areas: Vec<f64> = curve.iter().map(|row| row["area_deformed_m2"].as_f64().unwrap()).collect();
    assert_eq!(days, [0.0, 7.0, 14.0]);
    assert!(areas[0] < areas[1] && areas[1] < areas[2], "{areas:?}");
    // The last filling is what is shown.
    assert_eq!(result["area_deformed_m2"], curve[2]["area_deformed_m2"]);
    assert!((result["implant_volume_m3"].as_f64().unwrap() / 70e-6 - 1.0).abs() <= 1e-9);
    let csv = fs::read_to_string(out.join("curve.csv")).unwrap();
    assert!(csv.lines().nth(2).is_some_and(|line| line.starts_with("1,7,")), "{csv}");
    assert!(fs::read_to_string(out.join("curve.svg")).unwrap().contains("day"));
}

/// A mesh as OBJ in metres.
fn obj(mesh: &TriangleMesh) -> String {
    let mut text = String::new();
    mesh.vertices.iter().for_each(|p| writeln!(text, "v {} {} {}", p.x, p.y, p.z).unwrap());
    mesh.triangles.iter().map(|t| t.map(|v| v + 1)).for_each(|[a, b, c]| writeln!(text, "f {a} {b} {c}").unwrap());
    text
}

#[test]
fn a_closed_skin_stays_closed_and_each_implant_is_shown() {
    let scratch = Scratch::new("implant-closed");
    let (file, out, old) = (scratch.join("ball.obj"), scratch.join("out"), scratch.join("old.obj"));
    let ball = icosphere(0.1, 3);
    fs::write(&file, obj(&ball)).unwrap();
    let places = ["--implant", "at=0,0,0.1", "--implant", "at=0,0.02,-0.1"];
    let common = ["implant", shown(&file), "--unit", "m", "--base", "4cm", "--volume", "8cc", "--edge", "5mm"];
    let done = run(&[&common[..], &places, &["--out", shown(&out)]].concat());
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    assert!(text(&done.stdout).contains("implant 1  implant 2"), "{}", text(&done.stdout));
    for name in ["stretch", "side", "before"] {
        assert!(["", "_2"].iter().all(|k| out.join(format!("{name}{k}.png")).is_file()), "{name}");
    }
    let checked = |path: &std::path::Path| run(&["check", shown(path), "--unit", "m"]).status.code();
    assert_eq!(checked(&out.join("skin.vtp")), Some(0));
    let skin = pliant::io::read(&out.join("skin.vtp")).unwrap().mesh;
    let edges = Topology::new(&skin).edges.len();
    assert_eq!(skin.vertices.len() + skin.triangles.len() - edges, 2, "a handle");
    // Patches laid beside the rest instead, as it once was, are refused by the same check.
    let order = Order { edge: Some(5e-3), ..Order::round(Place::Point([0.0, 0.0, 0.1].into()), 0.04, 8e-6) };
    let ready = Ready::new(&ball, &order, &[]).unwrap();
    let first = ball.vertices.len() as u32;
    let outside = ready.outside.iter().map(|t| ball.triangles[*t as usize]);
    let triangles = outside.chain(ready.patch.triangles.iter().map(|t| t.map(|v| v + first))).collect();
    let vertices = ball.vertices.iter().chain(&ready.patch.vertices).copied().collect();
    fs::write(&old, obj(&TriangleMesh { vertices, triangles })).unwrap();
    assert_eq!(checked(&old), Some(1));
}

#[test]
fn a_base_that_goes_round_the_body_is_told_from_a_border() {
    let scratch = Scratch::new("implant-round");
    let (file, out) = (scratch.join("ball.obj"), scratch.join("out"));
    fs::write(&file, obj(&icosphere(0.1, 3))).unwrap();
    let with = |base: &str| {
        let common = ["implant", shown(&file), "--unit", "m", "--at", "0,0,0.1", "--volume", "8cc"];
        let done = run(&[&common[..], &["--base", base, "--out", shown(&out)]].concat());
        (done.status.code(), text(&done.stderr))
    };
    // The one reaches round as far as skin was looked at, under the other all of the ball was.
    for (base, wanted) in [("18.5cm", "goes round the body"), ("25cm", "turns away by")] {
        let (code, said) = with(base);
        assert_eq!(code, Some(2), "{said}");
        assert!(said.contains(wanted) && !said.contains("border"), "{said}");
        let fits = said.split("a base of ").last().and_then(|rest| rest.split(" cm fits").next());
        let (code, said) = with(&format!("{}cm", fits.expect("a base that fits")));
        assert_eq!(code, Some(0), "{fits:?} cm: {said}");
    }
}

#[test]
fn one_volume_is_told_in_the_table_and_not_plotted() {
    let scratch = Scratch::new("implant-one");
    let (file, out) = (scratch.join("sheet.obj"), scratch.join("out"));
    fs::write(&file, sheet(32)).unwrap();
    let common = ["implant", shown(&file), "--unit", "cm", "--at", "0,0,0", "--edge", "8mm", "--out", shown(&out)];
    let done = run(&[&common[..], &["--volumes", "40"]].concat());
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    assert!(out.join("curve.csv").is_file() && !out.join("curve.svg").exists());
    let page = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(page.contains("Areas gained by volume") && !page.contains("<svg"));
    assert!(page.contains(">0.0 cm2 are stretched beyond"), "minus nothing");
}

#[test]
fn bad_orders_say_what_to_change() {
    let scratch = Scratch::new("implant-bad");
    let file = scratch.join("sheet.obj");
    fs::write(&file, sheet(16)).unwrap();
    let refused = |more: &[&str], wanted: &str| {
        let done = run(&[&["implant", shown(&file), "--out", shown(&scratch.join("out"))], more].concat());
        let said = text(&done.stderr);
        assert_eq!(done.status.code(), Some(2), "{more:?}: {said}");
        assert!(said.contains(wanted), "{more:?}: {said}");
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
    refused(&["--unit", "cm", "--near-vertex", "99999"], "no vertex 99999");
    refused(&with(&["--volume", "-100cc"]), "the volume must be more than 0");
    refused(&with(&["--volume", "100"]), "a unit of cc");
    refused(&with(&["--volume", "nancc"]), "must be more than 0");
    refused(&with(&["--volume", "somecc"]), "cannot read `somecc`");
    refused(&with(&["--volume", "9l"]), "larger than the region");
    refused(&with(&["--thickness", "0mm"]), "thickness of the skin must be more than 0");
    refused(&with(&["--shape", "star"]), "known: round");
    refused(&with(&["--edge", "1um"]), "make --edge larger");
    refused(&with(&["--implant", "at=0,0,0", "--implant", "at=1,0,0"]), "overlap");
    refused(&with(&["--implant", "colour=red"]), "unknown key");
    refused(&with(&["--fill", "0:30cc,7:20cc"]), "filling 2: its volume is less");
    refused(&with(&["--fill", "7:30cc,7:50cc"]), "filling 2: its day");
    refused(&with(&["--fill", "30cc"]), "as in 0:30cc");
    refused(&with(&["--fill", "0:30cc", "--volume", "50cc"]), "cannot be used with");
    refused(&with(&["--stretch-limit", "0.5"]), "a ratio above 1");
    refused(&with(&["--stretch-limit", "nan"]), "a ratio above 1");
    refused(&with(&["--wanted-area", "900cm2"]), "no volume up to");
}
