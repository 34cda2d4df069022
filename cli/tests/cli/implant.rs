//! `pliant implant`: results for a planner, and rejected input.

mod curves;
mod orders;
mod places;

use std::fmt::Write as _;
use std::fs;

use pliant::mesh::shapes::icosphere;
use pliant::mesh::{Topology, TriangleMesh};
use pliant::skin::{ImplantPlace, ImplantSpec, PreparedPatch};
use serde_json::Value;

use super::{Scratch, json, measures, run, shown, text};

/// A flat sheet of 20 cm in `n` by `n` cells as OBJ in centimetres. Its middle vertex is
/// `(n + 1) n / 2 + n / 2`.
fn sheet(n: u32) -> String {
    let mut obj = String::new();
    let at = |k: u32| 20.0 * f64::from(k) / f64::from(n) - 10.0;
    for (i, j) in (0..=n).flat_map(|i| (0..=n).map(move |j| (i, j))) {
        let _ = writeln!(obj, "v {} {} 0", at(i), at(j));
    }
    for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
        let a = i * (n + 1) + j + 1;
        let _ = writeln!(
            obj,
            "f {a} {} {}\nf {a} {} {}",
            a + n + 1,
            a + n + 2,
            a + n + 2,
            a + 1
        );
    }
    obj
}

/// A mesh as OBJ in metres.
fn obj(mesh: &TriangleMesh) -> String {
    let mut text = String::new();
    mesh.vertices
        .iter()
        .for_each(|p| writeln!(text, "v {} {} {}", p.x, p.y, p.z).unwrap());
    mesh.triangles
        .iter()
        .map(|t| t.map(|v| v + 1))
        .for_each(|[a, b, c]| writeln!(text, "f {a} {b} {c}").unwrap());
    text
}

#[test]
fn an_implant_gives_areas_with_their_sources_and_files() {
    let scratch = Scratch::folder();
    let (file, out) = (scratch.join("sheet.obj"), scratch.join("out"));
    fs::write(&file, sheet(40)).unwrap();
    let middle = (41 * 20 + 20).to_string();
    let common = [
        "implant",
        shown(&file),
        "--unit",
        "cm",
        "--near-vertex",
        &middle,
        "--edge",
        "5mm",
        "--out",
        shown(&out),
    ];
    let done = run(&[&common[..], &["--volume", "100cc", "--json"]].concat());
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let summary: Value = serde_json::from_slice(&done.stdout).unwrap();
    let result = measures(&summary);
    let number = |path: &str| {
        result
            .pointer(path)
            .and_then(Value::as_f64)
            .unwrap_or_else(|| panic!("{path}: {result}"))
    };
    assert_eq!(summary["converged"], true);
    let gain = (number("/area_deformed_m2") - number("/area_before_m2")) * 1e4;
    assert!((14.5..=44.3).contains(&gain), "{gain} cm2");
    for span in ["retracted", "grown"] {
        let [low, high] = ["low", "high"].map(|end| number(&format!("/area_{span}_m2/{end}")));
        assert!(
            number("/area_before_m2") <= low && low < high && high <= number("/area_deformed_m2"),
            "{span}"
        );
        assert!(
            result["sources"][span]
                .as_str()
                .is_some_and(|s| s.contains('[')),
            "{span}"
        );
    }
    assert!((number("/implant_volume_m3") / 1e-4 - 1.0).abs() <= 1e-9);
    assert!(number("/volume_difference_m3") >= 0.995e-4 && number("/stretch_max") > 1.0);
    assert!(
        number("/region/springs") > 4.0 * number("/region/vertices") && number("/steps") >= 1.0
    );
    assert!(summary["time_s"].as_f64().unwrap() > 0.0);
    for name in [
        "report.html",
        "skin.vtp",
        "implant_1.vtp",
        "stretch.png",
        "side.png",
        "before.png",
        "summary.json",
        "measures.csv",
        "sheet.pvd",
    ] {
        assert!(out.join(name).is_file(), "{name}");
    }
    let page = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(page.contains("area retracted [cm2]") && page.contains("vanrappard1988"));
    let skin = pliant::io::read(&out.join("skin.vtp")).unwrap().mesh;
    let highest = skin.vertices.iter().map(|p| p.z).fold(0.0, f64::max);
    assert!((0.02..0.08).contains(&highest), "{highest} m");
    let kept = measures(&json(&out.join("summary.json")));
    assert_eq!(kept["area_deformed_m2"], result["area_deformed_m2"]);
}

#[test]
fn the_printed_scene_gives_the_same_areas() {
    let scratch = Scratch::folder();
    fs::write(scratch.join("sheet.obj"), sheet(40)).unwrap();
    fs::write(
        scratch.join("plate.obj"),
        "v -6 -6 -2\nv 6 -6 -2\nv 6 6 -2\nv -6 6 -2\nf 1 2 3\nf 1 3 4\n",
    )
    .unwrap();
    let in_folder = |arguments: &[&str]| {
        let done = super::pliant()
            .current_dir(scratch.join("."))
            .args(arguments)
            .output()
            .unwrap();
        assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
        text(&done.stdout)
    };
    let one = ["implant", "sheet.obj", "--unit", "cm"];
    let days = [
        "--base",
        "3cm",
        "--edge",
        "4mm",
        "--implant",
        "at=-3,0.25,0 fill=0:3cc,3:4cc",
        "--implant",
        "near-vertex=440 shape=oval long=0,1,0 volume=3cc",
        "--implant",
        "at=0.5,0,0 fill=3:4cc,9.5:6cc",
    ];
    let obstacle =
        "--edge 6mm --at 0,0,0 --base 5cm --volume 24cc --depth 3mm --obstacle plate.obj";
    let volumes = "--edge 6mm --at 0,0,0 --volumes 40,60.5cc,0.08l";
    let area = "--edge 6mm --near-vertex 840 --target-area 12cm2 --stretch-limit 1.1";
    let words = |text: &'static str| text.split(' ').collect::<Vec<_>>();
    let cases = [
        (days.to_vec(), "{ day = 9.5, volume = \"6cc\" }"),
        (words(obstacle), "mesh = \"plate.obj\""),
        (words(volumes), "{ frame = 2, volume = \"60.5cc\" }"),
        (words(area), "target_area = \"12cm2\""),
    ];
    for (more, said) in cases {
        let arguments = [&one[..], &more].concat();
        let scene = in_folder(&[&arguments[..], &["--print-scene"]].concat());
        let relative = scene.contains("mesh = \"sheet.obj\"");
        assert!(relative && scene.contains(said), "{scene}");
        fs::write(scratch.join("scene.toml"), &scene).unwrap();
        let of = |arguments: &[&str], kind: &str| -> Value {
            let printed = in_folder(&[arguments, &["--json", "--out", "out"]].concat());
            let mut all: Value = serde_json::from_str(&printed).unwrap();
            assert_eq!(all["kind"], kind);
            for implant in all[kind]["implants"].as_array_mut().unwrap() {
                implant["time_s"] = 0.into();
            }
            all[kind].take()
        };
        let made = of(&arguments, "implant");
        let read = of(&["run", "scene.toml"], "skin");
        assert_eq!(made, read, "{scene}");
        let area = |key: &str| made[key].as_f64().unwrap();
        assert!(area("area_deformed_m2") > area("area_before_m2"), "{made}");
    }
}

#[test]
fn a_closed_skin_stays_closed_and_each_implant_is_shown() {
    let scratch = Scratch::folder();
    let (file, out, old) = (
        scratch.join("ball.obj"),
        scratch.join("out"),
        scratch.join("old.obj"),
    );
    let ball = icosphere(0.1, 3);
    fs::write(&file, obj(&ball)).unwrap();
    let places = ["--implant", "at=0,0,0.1", "--implant", "at=0,0.02,-0.1"];
    let common = [
        "implant",
        shown(&file),
        "--unit",
        "m",
        "--base",
        "4cm",
        "--volume",
        "8cc",
        "--edge",
        "5mm",
    ];
    let done = run(&[&common[..], &places, &["--out", shown(&out)]].concat());
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    assert!(
        text(&done.stdout).contains("implant 1  implant 2"),
        "{}",
        text(&done.stdout)
    );
    for name in ["stretch", "side", "before"] {
        assert!(
            ["", "_2"]
                .iter()
                .all(|k| out.join(format!("{name}{k}.png")).is_file()),
            "{name}"
        );
    }
    let checked =
        |path: &std::path::Path| run(&["check", shown(path), "--unit", "m"]).status.code();
    assert_eq!(checked(&out.join("skin.vtp")), Some(0));
    let skin = pliant::io::read(&out.join("skin.vtp")).unwrap().mesh;
    let edges = Topology::new(&skin).edges.len();
    assert_eq!(
        skin.vertices.len() + skin.triangles.len() - edges,
        2,
        "a handle"
    );
    // The same check rejects patches that lie beside the rest, a defect of an earlier version.
    let order = ImplantSpec {
        edge: Some(5e-3),
        ..ImplantSpec::round(ImplantPlace::Point([0.0, 0.0, 0.1].into()), 0.04, 8e-6)
    };
    let ready = PreparedPatch::new(&ball, &order, &[]).unwrap();
    let first = ball.vertices.len() as u32;
    let outside = ready.outside.iter().map(|t| ball.triangles[*t as usize]);
    let triangles = outside
        .chain(ready.patch.triangles.iter().map(|t| t.map(|v| v + first)))
        .collect();
    let vertices = ball
        .vertices
        .iter()
        .chain(&ready.patch.vertices)
        .copied()
        .collect();
    fs::write(
        &old,
        obj(&TriangleMesh {
            vertices,
            triangles,
        }),
    )
    .unwrap();
    assert_eq!(checked(&old), Some(1));
}

#[test]
fn any_number_of_threads_gives_the_same() {
    let scratch = Scratch::folder();
    let (file, out) = (scratch.join("sheet.obj"), scratch.join("out"));
    fs::write(&file, sheet(24)).unwrap();
    let of = |threads: &str| {
        let common = [
            "implant",
            shown(&file),
            "--unit",
            "cm",
            "--at",
            "0,0,0",
            "--edge",
            "7mm",
            "--json",
            "--out",
        ];
        let done = run(&[&common[..], &[shown(&out), "--threads", threads]].concat());
        assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
        let mut result: Value = serde_json::from_slice(&done.stdout).unwrap();
        for of_time in ["time_s", "times", "provenance"] {
            result[of_time] = 0.into();
        }
        result["implant"]["implants"][0]["time_s"] = 0.into();
        (result, fs::read(out.join("skin.vtp")).unwrap())
    };
    let one = of("1");
    assert!(
        one.0["implant"]["area_deformed_m2"].as_f64().unwrap()
            > one.0["implant"]["area_before_m2"].as_f64().unwrap()
    );
    assert!(of("3") == one);
    assert_eq!(
        run(&["implant", shown(&file), "--unit", "cm", "--threads", "0"])
            .status
            .code(),
        Some(2)
    );
}

#[cfg(unix)]
#[test]
fn ctrl_c_keeps_the_volumes_that_are_done() {
    use std::process::{Command, Stdio};
    let scratch = Scratch::folder();
    let (file, out) = (scratch.join("sheet.obj"), scratch.join("out"));
    fs::write(&file, sheet(40)).unwrap();
    // Sixty volumes take far longer than the signal needs.
    let many: Vec<String> = (40..100).map(|cc: u32| cc.to_string()).collect();
    let mut child = super::pliant()
        .args(["implant", shown(&file), "--unit", "cm", "--at", "0,0,0"])
        .args(["--edge", "3mm", "--volumes", &many.join(",")])
        .args(["--out", shown(&out)])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let second = out.join("frames/sheet_0002.vtp");
    let begun = std::time::Instant::now();
    while !second.exists() && begun.elapsed().as_secs() < 120 {
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    let sent = Command::new("kill")
        .args(["-INT", &child.id().to_string()])
        .status()
        .unwrap();
    assert!(sent.success());
    assert_eq!(child.wait().unwrap().code(), Some(130));
    let summary = json(&out.join("summary.json"));
    let curve = summary["implant"]["curve"].as_array().unwrap();
    assert!((2..60).contains(&curve.len()), "{} volumes", curve.len());
    assert_eq!(summary["interrupted"].as_bool(), Some(true));
    assert_eq!(summary["frames"].as_u64(), Some(curve.len() as u64));
    let rows = fs::read_to_string(out.join("curve.csv")).unwrap();
    assert_eq!(rows.lines().count(), 1 + curve.len());
    let page = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(page.contains("interrupted"));
}

#[test]
fn a_preview_shows_where_and_computes_nothing() {
    let scratch = Scratch::folder();
    let (file, out) = (scratch.join("sheet.obj"), scratch.join("out"));
    fs::write(&file, sheet(40)).unwrap();
    let common = [
        "implant",
        shown(&file),
        "--unit",
        "cm",
        "--base",
        "7cm",
        "--out",
        shown(&out),
    ];
    let done = run(&[
        &common[..],
        &["--at", "0,0,0", "--preview", "--up", "0,1,0", "--json"],
    ]
    .concat());
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let summary: Value = serde_json::from_slice(&done.stdout).unwrap();
    let one = &summary["implant_preview"]["implants"][0];
    assert_eq!(one["border_edges"], 0);
    assert!((one["base_m"].as_f64().unwrap() - 0.07).abs() <= 1e-12);
    assert!(out.join("overview.png").exists() && !out.join("skin.vtp").exists());
    // The region reaches the border of the sheet, 1.5 times as wide as the base, and is held there.
    let near = run(&[&common[..], &["--at", "5.5,0,0", "--preview", "--json"]].concat());
    let near: Value = serde_json::from_slice(&near.stdout).unwrap();
    assert!(
        near["implant_preview"]["implants"][0]["border_edges"]
            .as_u64()
            .unwrap()
            > 0
    );
    let notes = near["notes"].as_array().unwrap();
    assert!(
        notes
            .iter()
            .any(|n| n.as_str().unwrap().contains("ends at the border"))
    );
    let wrong = run(&[&common[..], &["--at", "0,0,0", "--preview", "--up", "0,1"]].concat());
    assert_eq!(wrong.status.code(), Some(2));
}

#[test]
fn a_bond_halves_the_void_beside_an_implant() {
    let scratch = Scratch::folder();
    let file = scratch.join("sheet.obj");
    fs::write(&file, sheet(40)).unwrap();
    let void = |bond: &str| {
        let out = scratch.join("out");
        let done = run(&[
            "implant",
            shown(&file),
            "--unit",
            "cm",
            "--base",
            "7cm",
            "--at",
            "0,0,0",
            "--volume",
            "100cc",
            "--edge",
            "6mm",
            "--bond",
            bond,
            "--json",
            "--quiet",
            "--out",
            shown(&out),
        ]);
        assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
        let summary: Value = serde_json::from_slice(&done.stdout).unwrap();
        summary["implant"]["void_volume_m3"].as_f64().unwrap()
    };
    let (free, bonded) = (void("0 N/m3"), void("2e6 N/m3"));
    assert!(free > 1e-5 && bonded < 0.65 * free, "{free} {bonded}");
}
