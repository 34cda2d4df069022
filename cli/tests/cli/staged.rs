//! Scenes of skin over implants, of a ball under a sheet, of a soft cube, of a lattice: every
//! command that uses a scene.

use std::fs;

use serde_json::Value;

use super::{
    Scratch, json, measures, names_in, pliant, referenced, run, run_into, schema, shown,
    surfaces_in, text, turntable,
};

/// The flat implant on a mesh that needs a second.
const SMALL: [&str; 6] = [
    "flat-implant",
    "--set",
    "sheet.cells=32",
    "--set",
    "skin.edge_length=6.25 mm",
    "--set",
];

fn number(value: &Value, path: &str) -> f64 {
    value
        .pointer(path)
        .and_then(Value::as_f64)
        .unwrap_or_else(|| panic!("{path}: {value}"))
}

/// The summary of a run. The printed and the saved summary are equal.
fn summary(arguments: &[&str]) -> (Scratch, Value) {
    let scratch = Scratch::folder();
    let out = scratch.join("out");
    let done = run_into(&out, &[arguments, &["--json"]].concat());
    let printed: Value =
        serde_json::from_slice(&done.stdout).expect("nothing but JSON on standard output");
    assert_eq!(printed, json(&out.join("summary.json")));
    schema::assert_valid(&printed);
    assert_eq!(
        (&printed["interrupted"], &printed["converged"]),
        (&Value::Bool(false), &Value::Bool(true))
    );
    for key in ["run", "left_out"] {
        assert!(
            printed["effects"][key]
                .as_array()
                .is_some_and(|all| !all.is_empty()),
            "{key}"
        );
    }
    assert!(number(&printed, "/time_s") > 0.0);
    let verdicts = printed["verdicts"].as_array().unwrap();
    assert!(
        !verdicts.is_empty() && verdicts.iter().all(|v| v["passed"] == true),
        "{verdicts:?}"
    );
    (scratch, printed)
}

#[test]
fn a_flat_implant_has_areas_frames_and_pictures() {
    let arguments = [&SMALL[..], &["implant.volume=50cc"]].concat();
    let (scratch, found) = summary(&arguments);
    let implants = found["skin"]["implants"].as_array().unwrap();
    assert_eq!((implants.len(), found["frames"].as_u64()), (1, Some(1)));
    let of = |path: &str| number(&implants[0], path);
    let gain = (of("/area_deformed_m2") - of("/area_before_m2")) * 1e4;
    // The geometric limits, as in the digest of the source.
    assert!((4.0..=16.3).contains(&gain), "{gain} cm2");
    for span in ["retracted", "grown"] {
        let [low, high] = ["low", "high"].map(|end| of(&format!("/area_{span}_m2/{end}")));
        assert!(
            of("/area_before_m2") <= low && low < high && high <= of("/area_deformed_m2"),
            "{span}"
        );
    }
    assert!((of("/implant_volume_m3") / 50e-6 - 1.0).abs() <= 1e-6);
    assert!(of("/volume_difference_m3") >= 0.995 * 50e-6 && of("/stretch_max") > 1.0);
    for key in ["vertices", "triangles", "springs"] {
        assert!(of(&format!("/region/{key}")) > 100.0, "{key}");
    }
    assert!(of("/steps") >= 1.0 && of("/time_s") > 0.0 && implants[0]["converged"] == true);
    let out = scratch.join("out");
    // The skin and the implant, before and after.
    assert_eq!(referenced(&out, "flat-implant.pvd").len(), 4);
    assert_eq!(surfaces_in(&out.join("frames")).len(), 4);
    assert_eq!(
        fs::read_to_string(out.join("measures.csv"))
            .unwrap()
            .lines()
            .count(),
        3
    );
    let (table, page) = turntable(&fs::read_to_string(out.join("report.html")).unwrap());
    assert_eq!(page.matches("data:image/png;base64,").count(), 7);
    assert!(table.contains("data-frames=\"0 1\"") && table.matches("data-pictures").count() == 3);
    assert!(page.contains("area retracted [cm2]") && page.contains("Effects left out"));
    let skin = pliant::io::read(&out.join("frames/skin_0001.vtp"))
        .unwrap()
        .mesh;
    let highest = skin.vertices.iter().map(|p| p.z).fold(0.0, f64::max);
    assert!((0.01..0.06).contains(&highest), "{highest} m");
}

#[test]
fn an_expander_is_filled_step_by_step_over_its_skull() {
    let arguments = [
        "expander",
        "--frames",
        "2",
        "--set",
        "skin.edge_length=6 mm",
        "--animate",
        "gif",
    ];
    let (scratch, found) = summary(&arguments);
    let frames = found["skin"]["implants"][0]["frames"].as_array().unwrap();
    let volumes: Vec<f64> = frames
        .iter()
        .map(|f| number(f, "/implant_volume_m3") * 1e6)
        .collect();
    assert!(
        volumes.len() == 2
            && (volumes[0] - 10.0).abs() <= 1e-4
            && (volumes[1] - 20.0).abs() <= 1e-4,
        "{volumes:?}"
    );
    let areas: Vec<f64> = frames
        .iter()
        .map(|f| number(f, "/area_deformed_m2"))
        .collect();
    assert!(
        number(&found, "/skin/area_before_m2") < areas[0] && areas[0] < areas[1],
        "{areas:?}"
    );
    // The skull ends at 84 mm; the shell may penetrate it by a thousandth of its base of 6 cm.
    let out = scratch.join("out");
    let shell = pliant::io::read(&out.join("frames/expander_0002.vtp"))
        .unwrap()
        .mesh;
    let lowest = shell
        .vertices
        .iter()
        .map(|p| p.coords.norm())
        .fold(f64::INFINITY, f64::min);
    assert!(lowest >= 0.084 - 2e-4, "{lowest} m");
    assert!(
        fs::read(out.join("expander.gif"))
            .unwrap()
            .starts_with(b"GIF8")
    );
    assert!(
        referenced(&out, "expander.pvd")
            .iter()
            .any(|f| f.contains("obstacle_skull"))
    );
}

#[test]
fn a_ball_lifts_a_sheet() {
    let arguments = [
        "sheet",
        "--frames",
        "3",
        "--set",
        "sheet.cells=24",
        "--set",
        "skin.edge_length=0.5 mm",
    ];
    let (scratch, found) = summary(&arguments);
    let of = |path: &str| number(&found, &format!("/skin/ball{path}"));
    // A cone from the boundary loop to the ball, with a cap of the ball, has 1.29 times the area
    // of the loop's circle of 3.82 mm. The coarse region is wider, and chords are shorter.
    let stretched = of("/area_deformed_m2") / of("/area_before_m2");
    assert!((1.15..1.29).contains(&stretched), "{stretched}");
    assert!(found["skin"]["implants"].as_array().unwrap().is_empty());
    let names = names_in(&scratch.join("out").join("frames"));
    assert_eq!(
        names.iter().filter(|n| n.starts_with("ball_")).count(),
        4,
        "{names:?}"
    );
}

#[test]
fn a_soft_cube_keeps_its_volume_under_a_ball() {
    let scratch = Scratch::folder();
    let out = scratch.join("out");
    run_into(&out, &["cube", "--frames", "60"]);
    let cube = &json(&out.join("summary.json"))["muscles"]["muscles"][0];
    // The source loses half of a percent.
    assert!(number(cube, "/volume_error_max") <= 1e-3);
    assert!(
        number(cube, "/edge_stretch_rms_end") >= 0.01,
        "control: nothing was pressed"
    );
    assert_eq!(cube["vertices"], 386);
}

#[test]
fn a_lattice_that_was_dragged_comes_back() {
    let set = [
        "--set",
        "lattice.points=[4,5,6]",
        "--set",
        "lattice.release=10",
        "--frames",
        "60",
    ];
    let (scratch, found) = summary(&[&["lattice"][..], &set].concat());
    let of = |path: &str| number(&found, &format!("/lattice/{path}"));
    assert_eq!((of("points"), of("neighbours")), (120.0, 26.0));
    assert!(of("distance_from_start_max_m") > 0.03 && of("distance_from_start_end_m") < 1e-3);
    assert!(of("time_step_s") < of("stability_limit_s"));
    assert_eq!(referenced(&scratch.join("out"), "lattice.pvd").len(), 61);
}

#[test]
fn the_plan_tells_what_runs_and_why_the_rest_does_not() {
    let done = run(&["plan", "expander"]);
    let said = text(&done.stdout);
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    for part in [
        "two layers of skin",
        "volume of the implant",
        "contact with skull",
        "Effects left out",
        "gravity",
        "friction",
    ] {
        assert!(said.contains(part), "`{part}` is not in: {said}");
    }
    let plan = |more: &[&str]| -> Value {
        let done = run(&[&["plan"], more, &["--json"]].concat());
        let plan: Value = serde_json::from_slice(&done.stdout)
            .unwrap_or_else(|_| panic!("{}", text(&done.stderr)));
        measures(&plan)["effects"].clone()
    };
    let has = |list: &Value, effect: &str| {
        list.as_array()
            .unwrap()
            .iter()
            .any(|row| row["effect"] == effect)
    };
    let flat = plan(&["flat-implant"]);
    assert!(
        has(&flat["run"], "contact with what was under the skin")
            && has(&flat["left_out"], "growth")
    );
    // The number in the source.
    let layers = flat["run"]
        .as_array()
        .unwrap()
        .iter()
        .find(|row| row["effect"] == "two layers of skin")
        .unwrap();
    assert_eq!(layers["elements"], 11140);
    let sheet = plan(&["sheet"]);
    let layers = sheet["run"]
        .as_array()
        .unwrap()
        .iter()
        .find(|row| row["effect"] == "two layers of skin")
        .unwrap();
    assert_eq!(layers["elements"], 22176);
    // An obstacle out of reach is omitted, unless all are: then their unit is suspect.
    let scratch = Scratch::folder();
    let scene = scratch.join("far.toml");
    let far = FLAT.to_owned() + "[[obstacle]]\nname = 'far'\nmesh = 'far.obj'\nunit = 'm'\n";
    fs::write(&scene, &far).unwrap();
    fs::write(
        scratch.join("far.obj"),
        "v 5 0 0\nv 6 0 0\nv 5 1 0\nv 5 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n",
    )
    .unwrap();
    let refused = run(&["plan", shown(&scene)]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(text(&refused.stderr).contains("no obstacle lies under the implant"));
    let near = "[[obstacle]]\nname = 'near'\nmesh = 'near.obj'\nunit = 'm'\n";
    fs::write(&scene, far + near).unwrap();
    fs::write(
        scratch.join("near.obj"),
        "v -0.2 -0.2 -0.03\nv 0.2 -0.2 -0.03\nv 0 0.3 -0.03\nv 0 0 -0.2\n\
         f 1 2 3\nf 1 4 2\nf 2 4 3\nf 3 4 1\n",
    )
    .unwrap();
    let found = plan(&[shown(&scene)]);
    assert!(has(&found["run"], "contact with near"), "{found}");
    assert!(has(&found["left_out"], "contact with far") && !has(&found["run"], "contact with far"));
    assert!(has(&plan(&["lattice"])["run"], "springs"));
}

#[test]
fn a_study_compares_volumes() {
    let scratch = Scratch::folder();
    let (file, out) = (scratch.join("volumes.toml"), scratch.join("out"));
    let study = "scene = 'flat-implant'\nmeasures = ['area_gain_m2', 'stretch_max']\n[set]\n\
                 'sheet.cells' = 32\n'skin.edge_length' = '6.25 mm'\n[vary]\n'implant.volume' = ['40 cc', '60cc', '80 cc']\n";
    fs::write(&file, study).unwrap();
    let done = pliant()
        .args(["study", shown(&file), "--out", shown(&out), "--json"])
        .output()
        .unwrap();
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let found: Value = serde_json::from_slice(&done.stdout).unwrap();
    let found = measures(&found);
    let rows = found["rows"].as_array().unwrap();
    let gains: Vec<f64> = rows
        .iter()
        .map(|row| number(row, "/area_gain_m2") * 1e4)
        .collect();
    assert!(
        gains.len() == 3 && gains[0] < gains[1] && gains[1] < gains[2],
        "{gains:?}"
    );
    assert!(
        rows.iter()
            .all(|row| row["status"] == "converged" && row.get("volume_error").is_none())
    );
    assert!(out.join("sheet.png").is_file());
    // No frame is left to run.
    let again = pliant()
        .args([
            "study",
            shown(&file),
            "--out",
            shown(&out),
            "--dry-run",
            "--json",
        ])
        .output()
        .unwrap();
    assert!(
        !text(&again.stdout).contains("to run"),
        "{}",
        text(&again.stdout)
    );
    fs::write(&file, study.replace("stretch_max", "residual_m")).unwrap();
    let refused = pliant()
        .args(["study", shown(&file), "--out", shown(&out)])
        .output()
        .unwrap();
    assert_eq!(refused.status.code(), Some(2));
    assert!(
        text(&refused.stderr).contains("it has no measure `residual_m`"),
        "{}",
        text(&refused.stderr)
    );
}

#[test]
fn accuracy_compares_meshes_and_methods() {
    let scratch = Scratch::folder();
    let out = scratch.join("out");
    let set = [
        "--set",
        "sheet.cells=20",
        "--set",
        "skin.edge_length=10 mm",
        "--budget",
        "4s",
    ];
    let done = run(&[
        &["accuracy", "flat-implant", "--json", "--out", shown(&out)],
        &set[..],
    ]
    .concat());
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let found: Value = serde_json::from_slice(&done.stdout).unwrap();
    assert_eq!(found, json(&out.join("summary.json")));
    let found = measures(&found);
    let rows = found["rows"].as_array().unwrap();
    let edge = number(&found, "/reference/edge_m");
    assert!(
        !rows.is_empty()
            && rows
                .iter()
                .all(|r| r["method"] != "newton" || number(r, "/edge_m") > edge)
    );
    assert!(number(&found, "/uncertainty_m2") > 0.0);
    for row in rows {
        let error = number(row, "/area_gain_m2") - number(&found, "/reference/area_gain_m2");
        assert!((error - number(row, "/error_m2")).abs() <= 1e-12, "{row}");
    }
    assert_eq!(found["recommended"].as_array().unwrap().len(), 3);
    for name in ["work_precision.csv", "work_precision.svg", "report.html"] {
        assert!(out.join(name).is_file(), "{name}");
    }
}

const FLAT: &str = "[[skin]]\nshape = 'sheet'\n[sheet]\nside = '20 cm'\ncells = 24\n[[implant]]\n\
                    at = ['0 mm', '0 mm', '0 mm']\nbase = '7 cm'\nvolume = '50 cc'\n";

#[test]
fn wrong_scenes_say_where_and_what_to_change() {
    let scratch = Scratch::folder();
    let scene = scratch.join("s.toml");
    let refused = |text_of: &str, expected: &[&str]| {
        fs::write(&scene, text_of).unwrap();
        let done = run(&["run", shown(&scene), "--out", shown(&scratch.join("out"))]);
        let said = text(&done.stderr);
        assert_eq!(done.status.code(), Some(2), "{text_of}: {said}");
        for part in expected {
            assert!(said.contains(part), "{text_of}: `{part}` is not in: {said}");
        }
        assert!(!scratch.join("out").exists());
    };
    let with = |from: &str, to: &str| {
        assert!(FLAT.contains(from), "{from}");
        FLAT.replacen(from, to, 1)
    };
    refused(
        &with("base", "bass"),
        &["s.toml:8:1: error[E052]: implant.0: unknown key `bass`, did you mean `base`?"],
    );
    let orphan = FLAT.split("[[implant]]").nth(1).unwrap();
    refused(
        &format!("[[implant]]{orphan}"),
        &["s.toml:1:1: error[E055]", "`skin` is missing", "[[skin]]"],
    );
    refused(
        &with("'50 cc'", "'-50 cc'"),
        &[
            "s.toml:9:10: error[E051]",
            "give a volume greater than zero",
        ],
    );
    refused(
        &with("'50 cc'", "'50 cm'"),
        &[
            "s.toml:9:10: error[E058]",
            "`cm` is a unit of length, not of volume",
        ],
    );
    refused(
        &with("'50 cc'", "'9 l'"),
        &[
            "s.toml:9:10: error[E076]",
            "larger than the region",
            "make the volume smaller",
        ],
    );
    let both = format!("{FLAT}[[muscle]]\nname = 'm'\nshape = 'tetrahedron'\n");
    refused(
        &both,
        &["error[E056]", "`muscle` and `skin` exclude each other"],
    );
    let missing = with(
        "shape = 'sheet'\n[sheet]\nside = '20 cm'\ncells = 24\n",
        "mesh = 'nowhere.obj'\nunit = 'm'\n",
    );
    refused(&missing, &["no file", "nowhere.obj"]);
    refused(
        &with("'0 mm', '0 mm', '0 mm'", "'9 cm', '0 mm', '0 mm'"),
        &["s.toml:7:6: error[E076]", "border"],
    );
    refused(
        &with("'0 mm', '0 mm', '0 mm'", "'0 m', '0 m', '1 m'"),
        &["error[E076]", "check `at` and `unit`"],
    );
    refused(
        &with("cells = 24", "cells = 2"),
        &["s.toml:5:9: error[E051]", "from 4 to 1024"],
    );
    refused(
        &format!("{FLAT}[effects.gravity]\n"),
        &["`skin` and `effects` exclude each other"],
    );
    let unsorted = with(
        "volume = '50 cc'",
        "fill = [{ frame = 2, volume = '9 cc' }, { frame = 2, volume = '8 cc' }]",
    );
    refused(
        &unsorted,
        &["error[E059]", "frame 2 does not come after frame 2"],
    );
    refused(
        "frames = 9\nframe_rate = '60 Hz'\n[lattice]\npoints = [4, 4]\nside = '1 cm'\n",
        &["s.toml:4:10", "x, y, z"],
    );
    let to_rest = |lattice: &str, rest: &str| {
        format!(
            "frames = 9\n[lattice]\npoints = [4, 4, 4]\nside = '1 cm'\n{lattice}[lattice.rest]\n{rest}\n"
        )
    };
    refused(
        &to_rest("", "integrator = 'euler'"),
        &["s.toml:6:14: error[E063]", "verlet"],
    );
    refused(
        &to_rest("release = 3\n", ""),
        &[
            "s.toml:5:11: error[E056]",
            "`rest` and `release` exclude each other",
        ],
    );
    refused(
        &to_rest("", "time_step = '1 h'"),
        &["s.toml:6:13: error[E05", "known units of time"],
    );
    refused(
        &to_rest("", "time_step = '1 s'"),
        &["s.toml:6:13: error[E079]", "take a shorter `time_step`"],
    );
    refused(
        &to_rest("damping = '1 N/m'\n", ""),
        &["s.toml:5:11: error[E05", "not of damping"],
    );
    refused(
        &to_rest("", "shrink = 1"),
        &["s.toml:6:10: error[E051]", "below 1"],
    );
    for (arguments, expected) in [
        (
            &["run", "flat-implant", "--checkpoint-every", "1"][..],
            "leave --checkpoint-every and --resume out",
        ),
        (
            &["run", "flat-implant", "--accuracy", "1 %"],
            "`pliant accuracy` tells which `edge_length`",
        ),
        (&["accuracy", "lattice"], "such as `lattice.points`"),
        (
            &["accuracy", "flat-implant", "--frames", "3"],
            "leave --frames out",
        ),
        (
            &["run", "sheet", "--set", "implant.volume=1cc"],
            "the scene has no `implant`",
        ),
        (
            &["run", "sheet", "--set", "skin.depth=1mm"],
            "unknown key `depth`",
        ),
    ] {
        let done = pliant()
            .args(arguments)
            .current_dir(&scratch)
            .output()
            .unwrap();
        assert_eq!(done.status.code(), Some(2), "{arguments:?}");
        assert!(
            text(&done.stderr).contains(expected),
            "{arguments:?}: {}",
            text(&done.stderr)
        );
    }
}

#[cfg(unix)]
#[test]
fn what_was_interrupted_has_not_converged() {
    let scratch = Scratch::folder();
    let out = scratch.join("out");
    let mut child = super::pliant()
        .args([
            "run",
            "expander",
            "--frames",
            "500",
            "--set",
            "skin.edge_length=6 mm",
            "--out",
            shown(&out),
        ])
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    let first = out.join("frames/expander_0001.vtp");
    let begun = std::time::Instant::now();
    while !first.exists() && begun.elapsed().as_secs() < 120 {
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    let sent = std::process::Command::new("kill")
        .args(["-INT", &child.id().to_string()])
        .status()
        .unwrap();
    assert!(sent.success());
    assert_eq!(child.wait().unwrap().code(), Some(130));
    let summary = json(&out.join("summary.json"));
    let frames = summary["frames"].as_u64().unwrap();
    assert!((1..500).contains(&frames), "{frames} frames");
    assert_eq!(
        (&summary["interrupted"], &summary["converged"]),
        (&Value::Bool(true), &Value::Bool(false))
    );
}
