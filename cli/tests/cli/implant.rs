//! `pliant implant`: results for a planner, and rejected input.

use std::fmt::Write as _;
use std::fs;

use pliant::mesh::shapes::icosphere;
use pliant::mesh::{Topology, TriangleMesh};
use pliant::skin::{ImplantPlace, ImplantSpec, PreparedPatch};
use pliant_cli::report::implant::Insertion;
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
    assert_eq!(result["converged"], true);
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
fn volumes_give_a_curve_and_a_wanted_area_its_volume() {
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
    let wanted = 0.5 * (gains[0] + gains[1]) * 1e4;
    let done = run(&[&common[..], &["--wanted-area", &format!("{wanted}cm2")]].concat());
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let result = measures(&serde_json::from_slice(&done.stdout).unwrap());
    let volume = result["implant_volume_m3"].as_f64().unwrap();
    assert!((40e-6..60e-6).contains(&volume), "{volume}");
    assert!(!out.join("curve.csv").exists(), "an earlier result is left");
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
fn a_base_that_goes_round_the_body_is_told_from_a_border() {
    let scratch = Scratch::folder();
    let (file, out) = (scratch.join("ball.obj"), scratch.join("out"));
    fs::write(&file, obj(&icosphere(0.1, 3))).unwrap();
    let with = |base: &str| {
        let common = [
            "implant",
            shown(&file),
            "--unit",
            "m",
            "--at",
            "0,0,0.1",
            "--volume",
            "100cc",
        ];
        let done = run(&[&common[..], &["--base", base, "--out", shown(&out)]].concat());
        (done.status.code(), text(&done.stderr))
    };
    // The one reaches round as far as skin was looked at, under the other all of the ball was.
    for (base, wanted) in [("18.5cm", "goes round the body"), ("25cm", "turns away by")] {
        let (code, said) = with(base);
        assert_eq!(code, Some(2), "{said}");
        assert!(said.contains(wanted) && !said.contains("border"), "{said}");
        let fits = said
            .split("a base of ")
            .last()
            .and_then(|rest| rest.split(" cm fits").next());
        let (code, said) = with(&format!("{}cm", fits.expect("a base that fits")));
        assert_eq!(code, Some(0), "{fits:?} cm: {said}");
    }
}

#[test]
fn one_volume_is_told_in_the_table_and_not_plotted() {
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
    assert!(page.contains("Areas gained by volume") && !page.contains("<svg"));
    assert!(
        page.contains("nothing is stretched beyond") && !page.contains("-0.0"),
        "minus nothing"
    );
}

#[test]
fn implants_that_share_skin_are_told_by_their_numbers_and_every_file_is_known_before() {
    let scratch = Scratch::folder();
    let (file, out) = (scratch.join("sheet.obj"), scratch.join("out"));
    fs::write(&file, sheet(32)).unwrap();
    let common = [
        "implant",
        shown(&file),
        "--unit",
        "cm",
        "--base",
        "3cm",
        "--edge",
        "4mm",
        "--out",
        shown(&out),
    ];
    let three = [
        "--implant",
        "at=-3,0,0 volume=4cc",
        "--implant",
        "at=6.5,6.5,0 volume=3cc",
        "--implant",
        "at=0.5,0,0 volume=5cc",
    ];
    let done = run(&[&common[..], &three[..], &["--json"]].concat());
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let result = measures(&serde_json::from_slice(&done.stdout).unwrap());
    let told: Vec<(u64, f64)> = result["implants"]
        .as_array()
        .unwrap()
        .iter()
        .map(|i| {
            (
                i["implant"].as_u64().unwrap(),
                (i["implant_volume_m3"].as_f64().unwrap() * 1e6).round(),
            )
        })
        .collect();
    assert_eq!(told, [(1, 4.0), (2, 3.0), (3, 5.0)]);
    assert_eq!(
        result["implants"][0]["shares_skin_with"],
        serde_json::json!([3])
    );
    let known = Insertion::files(3, false);
    for entry in fs::read_dir(&out).unwrap() {
        let name = entry.unwrap().file_name().to_string_lossy().into_owned();
        assert!(
            name == "pliant-files.txt" || known.contains(&name),
            "{name}"
        );
    }
    // The message names the rejected volume.
    let large = [
        "--implant",
        "at=-3,0,0 volume=4cc",
        "--implant",
        "at=1,0,0 volume=500cc",
    ];
    let done = run(&[&common[..], &large[..]].concat());
    assert_eq!(done.status.code(), Some(2));
    assert!(
        text(&done.stderr).contains("implant 2: "),
        "{}",
        text(&done.stderr)
    );
    for both in ["at=0,0,0 near-vertex=3", "at=0,0,0 volume=3cc fill=0:3cc"] {
        let done = run(&[&common[..], &["--implant", both]].concat());
        assert!(
            done.status.code() == Some(2) && text(&done.stderr).contains("exclude each other"),
            "{both}"
        );
    }
}

#[test]
fn bad_orders_say_what_to_change() {
    let scratch = Scratch::folder();
    let file = scratch.join("sheet.obj");
    fs::write(&file, sheet(16)).unwrap();
    let refused = |more: &[&str], wanted: &str| {
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
    refused(
        &["--unit", "cm", "--near-vertex", "99999"],
        "no vertex 99999",
    );
    refused(
        &with(&["--volume", "-100cc"]),
        "the volume must be more than 0",
    );
    refused(&with(&["--volume", "100"]), "a unit of cc");
    refused(&with(&["--volume", "nancc"]), "must be more than 0");
    refused(&with(&["--volume", "somecc"]), "cannot read `somecc`");
    refused(&with(&["--volume", "9l"]), "larger than the region");
    refused(
        &with(&["--thickness", "0mm"]),
        "thickness of the skin must be more than 0",
    );
    refused(&with(&["--shape", "star"]), "known: round");
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
    refused(&with(&["--stretch-limit", "0.5"]), "a ratio above 1");
    refused(&with(&["--stretch-limit", "nan"]), "a ratio above 1");
    refused(&with(&["--wanted-area", "900cm2"]), "no volume up to");
}

/// A box of twelve triangles as OBJ, its sides 40 long, its top at 20.
fn box_of_twelve() -> String {
    let mut obj = String::new();
    let mesh = pliant::mesh::shapes::box_surface([40.0; 3], 40.0);
    mesh.vertices.iter().for_each(|p| {
        let _ = writeln!(obj, "v {} {} {}", p.x, p.y, p.z);
    });
    mesh.triangles.iter().for_each(|t| {
        let _ = writeln!(obj, "f {} {} {}", t[0] + 1, t[1] + 1, t[2] + 1);
    });
    obj
}

#[test]
fn a_face_of_two_triangles_takes_a_small_implant_and_is_refined_beside_it_only() {
    let scratch = Scratch::folder();
    let (file, out) = (scratch.join("box.obj"), scratch.join("out"));
    fs::write(&file, box_of_twelve()).unwrap();
    let at = [
        "implant",
        shown(&file),
        "--unit",
        "cm",
        "--at",
        "3.1,1.7,20",
        "--base",
        "1cm",
        "--depth",
        "2mm",
    ];
    let done = run(&[
        &at[..],
        &["--volume", "0.2cc", "--json", "--out", shown(&out)],
    ]
    .concat());
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let result = measures(&serde_json::from_slice(&done.stdout).unwrap());
    // On a flat face the region is a disc of 1.5 bases, or some triangles more.
    let before = result["area_before_m2"].as_f64().unwrap() * 1e4;
    let disc = std::f64::consts::PI * 0.75 * 0.75;
    assert!((disc..1.3 * disc).contains(&before), "{before} cm2");
    let skin = pliant::io::read(&out.join("skin.vtp")).unwrap().mesh;
    assert!(
        skin.triangles.len() < 20_000,
        "{} triangles",
        skin.triangles.len()
    );
    // The whole box and the area added by the implant.
    let gained =
        result["area_deformed_m2"].as_f64().unwrap() - result["area_before_m2"].as_f64().unwrap();
    assert!(
        (skin.area() / (0.96 + gained) - 1.0).abs() <= 1e-6,
        "{} m2",
        skin.area()
    );
    assert!(
        text(&done.stderr).contains("skin 40.0 cm across, base 1.0 cm"),
        "{}",
        text(&done.stderr)
    );
}

#[test]
fn a_crumpled_place_is_refused_by_a_count_before_it_is_refined() {
    // A bellows of 4000 folds of 3 cm height in a sheet of 20 cm: coarse, and most of it near
    // the implant.
    let scratch = Scratch::folder();
    let file = scratch.join("bellows.obj");
    let mut obj = String::new();
    let folds = 4000;
    for i in 0..=folds {
        let (x, z) = (
            20.0 * f64::from(i) / f64::from(folds) - 10.0,
            if i % 2 == 0 { 0.0 } else { 3.0 },
        );
        let _ = writeln!(obj, "v {x} -10 {z}\nv {x} 10 {z}");
    }
    for i in 0..folds {
        let a = 2 * i + 1;
        let _ = writeln!(obj, "f {a} {} {}\nf {a} {} {}", a + 2, a + 3, a + 3, a + 1);
    }
    fs::write(&file, obj).unwrap();
    let begun = std::time::Instant::now();
    let done = run(&[
        "implant",
        shown(&file),
        "--unit",
        "cm",
        "--at",
        "0,0,0",
        "--base",
        "7cm",
        "--out",
        "never",
    ]);
    let said = text(&done.stderr);
    assert_eq!(done.status.code(), Some(2), "{said}");
    assert!(
        said.contains("vertices would be needed to refine the skin")
            && said.contains("--edge larger"),
        "{said}"
    );
    // Computing them would take minutes.
    assert!(begun.elapsed().as_secs() < 30, "{:?}", begun.elapsed());
}

#[test]
fn a_place_for_results_is_looked_at_before_anything_is_computed() {
    let scratch = Scratch::folder();
    let file = scratch.join("sheet.obj");
    fs::write(&file, sheet(16)).unwrap();
    let into = |out: &str| {
        // A missing skin would be reported if the command read it first.
        let done = run(&[
            "implant",
            "no-such-skin.obj",
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
        super::names_in(&foreign),
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
        said.contains("no-such-skin.obj") && !scratch.join("new").exists(),
        "{said}"
    );
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
    assert_eq!(verdicts.len(), 2, "{verdicts:?}");
    let all = verdicts.iter().all(|v| v["passed"] == true);
    assert!(
        verdicts[0]["name"] == "skin and implant are at rest"
            && verdicts[0]["where"].as_str().unwrap().contains("60.0 cc"),
        "{verdicts:?}"
    );
    assert_eq!(
        (code, result["implant"]["converged"].as_bool()),
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
        result["time_s"] = 0.into();
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
    use std::io::BufRead;
    use std::process::{Command, Stdio};
    let scratch = Scratch::folder();
    let (file, out) = (scratch.join("sheet.obj"), scratch.join("out"));
    fs::write(&file, sheet(40)).unwrap();
    let interrupted = |volumes: &str, after: &str| {
        let mut child = super::pliant()
            .args([
                "implant",
                shown(&file),
                "--unit",
                "cm",
                "--at",
                "0,0,0",
                "--edge",
                "3mm",
                "--json",
            ])
            .args(["--volumes", volumes, "--out", shown(&out)])
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut said = std::io::BufReader::new(child.stderr.take().unwrap())
            .lines()
            .map_while(Result::ok);
        let heard: Vec<String> = said
            .by_ref()
            .take_while(|line| !line.contains(after))
            .collect();
        assert!(
            Command::new("kill")
                .args(["-INT", &child.id().to_string()])
                .status()
                .unwrap()
                .success()
        );
        let rest: Vec<String> = said.collect();
        (
            child.wait().unwrap().code(),
            [heard, rest].concat().join("\n"),
        )
    };
    // The signal comes before any equilibrium: many volumes take far longer.
    let many = (0..60)
        .map(|k| (40 + k).to_string())
        .collect::<Vec<_>>()
        .join(",");
    let (code, said) = interrupted(&many, "skin 20.0 cm across");
    assert_eq!(code, Some(130), "{said}");
    assert!(
        said.contains("nothing is written") && !said.contains("frame") && !out.exists(),
        "{said}"
    );
    let (code, said) = interrupted(&many, "implant 1: 41.0 cc is at rest");
    assert_eq!(code, Some(130), "{said}");
    assert!(
        said.contains("at rest already will be written") && !said.contains("frame"),
        "{said}"
    );
    let summary = json(&out.join("summary.json"));
    let curve = summary["implant"]["curve"].as_array().unwrap();
    assert!((2..60).contains(&curve.len()), "{} volumes", curve.len());
    assert_eq!(
        (
            summary["interrupted"].as_bool(),
            summary["implant"]["converged"].as_bool()
        ),
        (Some(true), Some(false))
    );
    assert!(
        summary["verdicts"]
            .as_array()
            .unwrap()
            .iter()
            .any(|v| v["passed"] == false)
    );
    let rows = fs::read_to_string(out.join("curve.csv")).unwrap();
    assert_eq!(rows.lines().count(), 1 + curve.len());
    assert!(
        fs::read_to_string(out.join("report.html"))
            .unwrap()
            .contains("it was interrupted")
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
    let refused = |more: &[&str], wanted: &[&str]| {
        let done = run(&[&common[..], more].concat());
        let said = text(&done.stderr);
        assert_eq!(done.status.code(), Some(2), "{more:?}: {said}");
        wanted
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
        &["--volume: the volume must be more than 0", "`-100cc`"],
    );
    refused(
        &with(&["--volumes", "10,-5"]),
        &["--volumes: the volume must be more than 0", "`-5`"],
    );
    refused(
        &with(&["--implant", "volume=-3ml"]),
        &["--implant: volume", "`-3ml`"],
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
    // 4 cm from the border, so 5 cm across never fit.
    let base = number(
        &refused(&["--at", "6,0,0"], &["border"]),
        "a base of",
        "cm would fit",
    );
    assert!((2.5..5.0).contains(&base), "{base} cm");
    fits(&[
        "--at",
        "6,0,0",
        "--base",
        &format!("{base}cm"),
        "--volume",
        "8cc",
    ]);
}

#[test]
fn surfaces_that_touch_are_told_by_what_touches() {
    let scratch = Scratch::folder();
    let file = scratch.join("sheet.obj");
    // A second sheet that has one vertex in common with the first.
    let mut obj = sheet(16);
    let middle = 17 * 8 + 8 + 1;
    let _ = writeln!(obj, "v 1 0 3\nv 0 1 3\nf {middle} 290 291");
    fs::write(&file, obj).unwrap();
    let done = run(&[
        "implant",
        shown(&file),
        "--unit",
        "cm",
        "--at",
        "0,0,0",
        "--out",
        shown(&scratch.join("out")),
    ]);
    let said = text(&done.stderr);
    assert_eq!(done.status.code(), Some(2), "{said}");
    assert!(
        said.contains("1 vertex joins surfaces") && !said.contains("0 edges"),
        "{said}"
    );
}
