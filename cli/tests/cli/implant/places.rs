//! Places on skin: borders, bodies, coarse and crumpled skin, several implants.

use std::fmt::Write as _;
use std::fs;

use pliant::mesh::shapes::icosphere;
use serde_json::Value;

use super::super::{Scratch, measures, run, shown, text};
use super::{obj, sheet};

#[test]
fn a_base_that_goes_round_the_body_is_distinguished_from_a_border() {
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
    for (base, expected) in [("18.5cm", "goes round the body"), ("25cm", "turns away by")] {
        let (code, said) = with(base);
        assert_eq!(code, Some(2), "{said}");
        assert!(
            said.contains(expected) && !said.contains("border"),
            "{said}"
        );
        let fits = said
            .split("a base of ")
            .last()
            .and_then(|rest| rest.split(" cm fits").next());
        let (code, said) = with(&format!("{}cm", fits.expect("a base that fits")));
        assert_eq!(code, Some(0), "{fits:?} cm: {said}");
    }
}

#[test]
fn implants_that_share_skin_are_named_by_their_numbers_and_every_file_is_known_before() {
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
    let summary: Value = serde_json::from_slice(&done.stdout).unwrap();
    let result = measures(&summary);
    let reported: Vec<(u64, f64)> = result["implants"]
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
    assert_eq!(reported, [(1, 4.0), (2, 3.0), (3, 5.0)]);
    assert_eq!(
        result["implants"][0]["shares_skin_with"],
        serde_json::json!([3])
    );
    let known = summary["files"].as_array().unwrap();
    for entry in fs::read_dir(&out).unwrap() {
        let name = entry.unwrap().file_name().to_string_lossy().into_owned();
        assert!(
            ["pliant-files.txt", "frames"].contains(&name.as_str())
                || known.contains(&name.as_str().into()),
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
    let summary: Value = serde_json::from_slice(&done.stdout).unwrap();
    let result = measures(&summary);
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
    assert_eq!(summary["notes"][0], "skin 40.0 cm across, base 1.0 cm");
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
fn surfaces_that_touch_are_named_by_what_touches() {
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
