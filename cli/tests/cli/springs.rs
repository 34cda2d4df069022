//! `pliant springs`: files and lattices at equilibrium, results, rejected input.

use std::fs;
use std::process::{Command, Stdio};

use pliant::springs::format;
use serde_json::Value;

use super::schema::assert_valid;
use super::{Scratch, json, measures, names_in, pliant, referenced, run, shown, text};

const FILE: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../examples/lattice-5x5x5.springs"
);

#[test]
fn the_shipped_file_comes_to_rest_and_leaves_its_results() {
    let scratch = Scratch::folder();
    let out = scratch.join("out");
    let arguments = [
        "springs",
        FILE,
        "--mass",
        "1",
        "--dt",
        "0.05",
        "--every",
        "100",
        "--out",
        shown(&out),
        "--json",
    ];
    let done = run(&arguments);
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let said: Value = serde_json::from_slice(&done.stdout).unwrap();
    assert_eq!(said, json(&out.join("summary.json")));
    let said = measures(&said);
    assert_eq!(
        (said["points"].as_u64(), said["springs"].as_u64()),
        (Some(125), Some(300))
    );
    assert_eq!(
        (said["points_held"].as_u64(), said["at_rest"].as_bool()),
        (Some(98), Some(true))
    );
    let number = |key: &str| said[key].as_f64().unwrap();
    // (7.2) for n = 5, m = 1; the limit 4/(d + sqrt(d^2 + 4 k)) with k = 14.47.
    assert!((number("damping_ns_m") - 4.9).abs() <= 5e-3);
    let d = number("damping_ns_m");
    assert!((number("stability_limit_s") - 4.0 / (d + (d * d + 4.0 * 14.47).sqrt())).abs() <= 1e-3);
    assert!(number("residual_force_n") <= number("residual_force_allowed_n"));
    let names = names_in(&out);
    for name in [
        "start.vtp",
        "end.vtp",
        "start.png",
        "end.png",
        "measures.csv",
        "report.html",
        "lattice-5x5x5.pvd",
        "frames",
    ] {
        assert!(
            names.iter().any(|n| n == name),
            "{name} is not among {names:?}"
        );
    }
    let listed = fs::read_to_string(out.join("pliant-files.txt")).unwrap();
    assert!(
        listed.lines().any(|line| line.ends_with("end.vtp")),
        "{listed}"
    );
    let steps = said["steps"].as_u64().unwrap();
    assert_eq!(
        referenced(&out, "lattice-5x5x5.pvd").len() as u64,
        1 + steps / 100
    );
    let rows = fs::read_to_string(out.join("measures.csv")).unwrap();
    assert!(
        rows.starts_with("step,time_s,dt_s,greatest_move_m,")
            && rows.lines().count() as u64 == steps + 1
    );
    let page = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(
        page.contains("at rest after")
            && page.contains("<svg")
            && page.matches("data:image/png").count() == 2
    );
    // The end state in the format of the file, with the springs as they were.
    let (before, after) = (
        format::read(FILE.as_ref()).unwrap(),
        format::read(&out.join("end.springs")).unwrap(),
    );
    assert_eq!(
        (&before.springs, &before.triangles, &before.surface),
        (&after.springs, &after.triangles, &after.surface)
    );
    assert_eq!(
        (&before.fibres, &before.origin, &before.insertion),
        (&after.fibres, &after.origin, &after.insertion)
    );
    let end = pliant::io::read(&out.join("end.vtp")).unwrap();
    assert_eq!(after.position, end.mesh.vertices);
    assert_ne!(before.position, after.position);
    let pictures = ["start.png", "end.png"].map(|name| fs::read(out.join(name)).unwrap());
    assert!(pictures.iter().all(|png| png.starts_with(b"\x89PNG")) && pictures[0] != pictures[1]);
}

#[test]
fn lattices_and_threads_give_the_same_and_every_integrator_gets_there() {
    let scratch = Scratch::folder();
    let out = scratch.join("out");
    let of = |more: &[&str]| {
        let fixed = [
            "springs",
            "--lattice",
            "4x4x5",
            "--out",
            shown(&out),
            "--json",
        ];
        let done = pliant().args(fixed).args(more).output().unwrap();
        let mut said: Value = serde_json::from_slice(&done.stdout).unwrap_or_default();
        (said["time_s"], said["provenance"]) = (0.into(), 0.into());
        for measured in ["ms_per_step", "first_step_s", "peak_bytes"] {
            said["springs"][measured] = 0.into();
        }
        (done.status.code(), said)
    };
    let one = of(&["--threads", "1", "--neighbours", "26"]);
    assert_eq!(one.0, Some(0));
    assert_eq!(one.1["name"], "lattice-4x4x5-26");
    assert_eq!(of(&["--threads", "4", "--neighbours", "26"]), one);
    for name in ["semi-implicit", "explicit", "rk4", "bdf2", "implicit"] {
        let (code, said) = of(&["--integrator", name]);
        assert_eq!(code, Some(0), "{name}: {said}");
        assert_eq!(
            said["springs"]["stability_limit_s"].is_null(),
            name == "implicit" || name == "bdf2"
        );
    }
    assert_eq!(of(&["--adaptive", "--dt", "3"]).0, Some(0));
    // The same lattice in single precision, by rows, and in double precision by a list.
    let coarse = of(&["--precision", "f32", "--tolerance", "1e-4"]);
    let [fine, list] = [&[][..], &["--adaptive"]].map(of);
    for (told, precision, method) in [
        (&coarse, "f32", "rows"),
        (&fine, "f64", "rows"),
        (&list, "f64", "list"),
    ] {
        let said = &told.1["springs"];
        assert_eq!(
            (told.0, &said["precision"], &said["method"]),
            (Some(0), &precision.into(), &method.into())
        );
        let stored = |of: &Value| of["spring_energy_j"].as_f64().unwrap();
        let (energy, known) = (stored(said), stored(&list.1["springs"]));
        assert!(
            (energy - known).abs() <= 1e-3 * known,
            "{precision}: {energy} {known}"
        );
    }
    // Too few steps: the result fails.
    let (code, said) = of(&["--steps", "3"]);
    assert_eq!(
        (code, said["springs"]["at_rest"].as_bool()),
        (Some(1), Some(false))
    );
}

#[cfg(unix)]
#[test]
fn ctrl_c_ends_a_long_run_with_what_there_is() {
    let scratch = Scratch::folder();
    let out = scratch.join("out");
    // The step is far too short for any progress.
    let mut child = pliant()
        .args([
            "springs",
            "--lattice",
            "12x12x12",
            "--dt",
            "1e-9",
            "--steps",
            "10000000",
            "--every",
            "5",
        ])
        .args(["--out", shown(&out)])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let tenth = out.join("frames/lattice-12x12x12-6_000010.vtp");
    let begun = std::time::Instant::now();
    while !tenth.exists() && begun.elapsed().as_secs() < 60 {
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    let sent = Command::new("kill")
        .args(["-INT", &child.id().to_string()])
        .status()
        .unwrap();
    assert!(sent.success());
    assert_eq!(child.wait().unwrap().code(), Some(130));
    let summary = measures(&json(&out.join("summary.json")));
    assert_eq!(summary["at_rest"], false);
    assert!(
        summary["end"]
            .as_str()
            .unwrap()
            .starts_with("stopped after"),
        "{}",
        summary["end"]
    );
    let steps = summary["steps"].as_u64().unwrap();
    assert!(steps >= 10 && out.join("end.vtp").exists() && out.join("report.html").exists());
    assert_eq!(
        referenced(&out, "lattice-12x12x12-6.pvd").len() as u64,
        1 + steps / 5
    );
    assert_eq!(
        fs::read_to_string(out.join("measures.csv"))
            .unwrap()
            .lines()
            .count() as u64,
        1 + steps.min(20_000)
    );
}

#[test]
fn what_cannot_be_run_is_refused_before_anything_is_written() {
    let scratch = Scratch::folder();
    let out = scratch.join("out");
    let file = scratch.join("bad.springs");
    fs::write(&file, "2 1\n0 0 0 m\n1 0 0 x\n").unwrap();
    let cases: [(&[&str], &str); 25] = [
        (
            &[shown(&file)],
            "bad.springs:3:7: error[E042]: expected m (surface point) or i",
        ),
        (&["no-such.springs"], "error[E060]"),
        (&[FILE, "--dt", "0.5"], "verlet needs less than 0."),
        (
            &[FILE, "--integrator", "explicit", "--damping", "0"],
            "no step is stable without damping",
        ),
        (&[FILE, "--mass", "-1"], "expected a positive number"),
        (&[FILE, "--shrink", "1"], "expected a share"),
        (&[FILE, "--integrator", "euler"], "possible values"),
        (&["--lattice", "5x5"], "expected three numbers of points"),
        (&["--lattice", "1x5x5"], "at least 2 points"),
        (
            &["--lattice", "99999x99999x99999"],
            "at most 1073741824 points in all",
        ),
        (
            &[
                "--lattice",
                "1020x1020x1020",
                "--neighbours",
                "26",
                "--adaptive",
            ],
            "GiB of memory",
        ),
        (&["--lattice", "5x5x5", "--neighbours", "7"], "6, 18 or 26"),
        (&[FILE, "--neighbours", "26"], "cannot be used with"),
        (
            &["--lattice", "5x5x5", "--mass", "1e-320"],
            "give a greater --mass",
        ),
        (
            &["--lattice", "5x5x5", "--precision", "f32"],
            "give a greater --tolerance, or --precision f64",
        ),
        (
            &[
                "--lattice",
                "5x5x5",
                "--precision",
                "f32",
                "--integrator",
                "rk4",
            ],
            "leave --precision out, or take --integrator verlet",
        ),
        (
            &[FILE, "--precision", "f32"],
            "single precision is for lattices",
        ),
        (
            &[FILE, "--device", "gpu"],
            "a graphics card is for lattices",
        ),
        (
            &[
                "--lattice",
                "5x5x5",
                "--device",
                "gpu",
                "--integrator",
                "rk4",
            ],
            "take --device cpu, or --integrator verlet",
        ),
        (
            &[
                "--lattice",
                "5x5x5",
                "--device",
                "gpu",
                "--precision",
                "f64",
            ],
            "a graphics card computes in single precision",
        ),
        (
            &["--lattice", "5x5x5", "--method", "edge"],
            "leave --method out, or take --device gpu",
        ),
        (
            &["--sweep", "speed=1,2"],
            "none of damping, mass and points",
        ),
        (
            &["--sweep", "damping=1..200", "--sweep", "points=30"],
            "points in all lattices",
        ),
        (&["--speed", "10,x"], "expected points along a side"),
        (
            &["--lattice", "5x5x5", "--side", "1e200"],
            "the square of a length is no number in double precision; give another --side",
        ),
    ];
    for (arguments, expected) in cases {
        let done = pliant()
            .arg("springs")
            .args(arguments)
            .args(["--out", shown(&out)])
            .output()
            .unwrap();
        let said = text(&done.stderr);
        assert_eq!(done.status.code(), Some(2), "{arguments:?}: {said}");
        assert!(
            said.contains(expected) && !said.contains("panicked"),
            "{arguments:?}: {said}"
        );
    }
    assert!(!out.exists());
    let done = run(&["springs"]);
    let said = text(&done.stderr);
    assert!(
        done.status.code() == Some(2) && said.contains("name a file") && said.contains("--lattice"),
        "{said}"
    );
}

#[test]
fn steps_that_are_not_enough_are_told_how_many_would_be() {
    let scratch = Scratch::folder();
    let out = scratch.join("out");
    let of = |more: &[&str]| {
        let done = pliant()
            .args(["springs", "--out", shown(&out), "--json"])
            .args(more)
            .output()
            .unwrap();
        let said: Value = serde_json::from_slice(&done.stdout).unwrap_or_default();
        (done.status.code(), said, text(&done.stderr))
    };
    let lattice = ["--lattice", "14x14x14", "--steps"];
    let (code, said, _) = of(&[&lattice[..], &["60"]].concat());
    assert_eq!(code, Some(1), "{said}");
    let hint = said["notes"]
        .as_array()
        .unwrap()
        .last()
        .unwrap()
        .as_str()
        .unwrap()
        .to_owned();
    let steps = hint
        .split("--steps ")
        .nth(1)
        .and_then(|rest| rest.split(' ').next())
        .unwrap()
        .to_owned();
    assert!(steps.parse::<u32>().unwrap() > 60, "{hint}");
    let (code, said, _) = of(&[&lattice[..], &[&steps]].concat());
    assert_eq!(code, Some(0), "{hint} {said}");
    // Missing damping is reported at once, after few steps.
    let (code, said, heard) = of(&["--lattice", "5x5x5", "--damping", "0"]);
    assert_eq!(
        (code, said["springs"]["steps"].as_u64()),
        (Some(1), Some(1000)),
        "{said}"
    );
    assert!(
        heard.starts_with("note: without damping nothing comes to rest"),
        "{heard}"
    );
    let (_, said, _) = of(&["--lattice", "5x5x5", "--damping", "0", "--steps", "30"]);
    assert_eq!(said["springs"]["steps"].as_u64(), Some(30));
    // An integrator with damping of its own reaches equilibrium.
    let (code, _, heard) = of(&[
        "--lattice",
        "4x4x4",
        "--damping",
        "0",
        "--integrator",
        "implicit",
    ]);
    assert!(
        code == Some(0) && !heard.contains("without damping"),
        "{heard}"
    );
}

#[test]
fn a_lattice_is_a_scene_that_comes_to_rest_after_the_same_steps() {
    let scratch = Scratch::folder();
    let (out, file) = (scratch.join("out"), scratch.join("rest.toml"));
    let options = [
        "springs",
        "--lattice",
        "4x4x5",
        "--neighbours",
        "26",
        "--integrator",
        "semi-implicit",
        "--damping",
        "6",
        "--dt",
        "0.05",
    ];
    let printed = pliant()
        .args(options)
        .arg("--print-scene")
        .output()
        .unwrap();
    assert_eq!(printed.status.code(), Some(0), "{}", text(&printed.stderr));
    fs::write(&file, &printed.stdout).unwrap();
    let of = |arguments: &[&str]| {
        let to = ["--out", shown(&out), "--json"];
        let done = pliant().args(arguments).args(to).output().unwrap();
        assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
        let said: Value = serde_json::from_slice(&done.stdout).unwrap();
        assert_eq!(
            (&said["kind"], &said["name"]),
            (&"springs".into(), &"lattice-4x4x5-26".into())
        );
        let keys = [
            "steps",
            "simulated_s",
            "residual_force_n",
            "kinetic_energy_j",
        ];
        keys.map(|key| said["springs"][key].as_f64().unwrap())
    };
    let command = of(&options);
    assert!(command[0] > 10.0, "{command:?}");
    assert_eq!(of(&["run", shown(&file)]), command);
    // Control: another damping takes other steps.
    let damped = ["run", shown(&file), "--set", "lattice.damping=0.3"];
    assert_ne!(of(&damped), command);
    // The system of a file is no scene.
    let done = run(&["springs", FILE, "--print-scene"]);
    assert_eq!(done.status.code(), Some(2), "{}", text(&done.stderr));
}

/// The summary of `pliant springs` with these arguments.
fn springs(arguments: &[&str]) -> Value {
    let scratch = Scratch::folder();
    let out = scratch.join("out");
    let done = pliant()
        .arg("springs")
        .args(arguments)
        .args(["--json", "--out", shown(&out)])
        .output()
        .unwrap();
    let said = text(&done.stderr);
    assert_eq!(done.status.code(), Some(0), "{arguments:?}: {said}");
    assert!(out.join("report.html").is_file());
    let summary: Value = serde_json::from_slice(&done.stdout).unwrap();
    assert_valid(&summary);
    summary
}

#[test]
fn a_sweep_has_the_steps_of_the_thesis_and_its_best_dampings() {
    // Table 7.4 of the VPHOP thesis, damping 5 and 6, masses 1 and 0.5.
    let summary = springs(&["--sweep", "damping=5..6", "--sweep", "mass=1,0.5"]);
    let of = &summary["springs_sweep"];
    let steps: Vec<f64> = of["lattices"]
        .as_array()
        .unwrap()
        .iter()
        .map(|cell| cell["steps"].as_f64().unwrap())
        .collect();
    let printed = [243.0, 298.0, 324.0, 361.0];
    assert_eq!(steps.len(), 4);
    for (ours, printed) in steps.iter().zip(printed) {
        assert!((ours / printed - 1.0).abs() <= 0.05, "{steps:?}");
    }
    for best in of["best"].as_array().unwrap() {
        let number = |key: &str| best[key].as_f64().unwrap();
        // Table 7.5 has 4.85 and 3.45.
        let printed = if number("mass_kg") == 1.0 { 4.85 } else { 3.45 };
        assert!(
            (number("best_ns_m") / printed - 1.0).abs() <= 0.05,
            "{best}"
        );
        assert!(number("best_steps") <= number("estimate_steps"));
    }
    // Control: a step that is too long for the smaller mass is named, and has no number of steps.
    let unstable = springs(&[
        "--sweep",
        "damping=5",
        "--sweep",
        "mass=1,1e-6",
        "--lenient",
    ]);
    let cell = &unstable["springs_sweep"]["lattices"][1];
    assert_eq!(
        (&cell["steps"], &cell["stable"]),
        (&Value::Null, &Value::Bool(false))
    );
    assert_eq!(unstable["passed"], Value::Bool(false));
}

#[test]
fn the_times_of_devices_are_measured() {
    let summary = springs(&["--speed", "4,6", "--neighbours", "18"]);
    let of = &summary["springs_speed"];
    let rows = of["lattices"].as_array().unwrap();
    let on = |device: &'static str| rows.iter().filter(move |row| row["device"] == device);
    assert_eq!(on("cpu").count(), 4);
    // Where there is no card a note says so, and nothing is made up.
    match of["card"].is_null() {
        true => {
            assert_eq!(on("gpu").count(), 0);
            assert!(
                summary["notes"].to_string().contains("graphics"),
                "{summary}"
            );
        }
        false => assert_eq!(on("gpu").count(), 6),
    }
    for row in rows {
        assert!(row["ms_per_step"].as_f64().unwrap() > 0.0, "{row}");
        assert_eq!(row["neighbours"], 18);
        assert_eq!(row["ms_per_step_read"].is_number(), row["device"] == "gpu");
    }
}

#[test]
fn a_graphics_card_comes_to_the_rest_of_the_processor_or_is_told_to_be_absent() {
    let lattice = [
        "--lattice",
        "6x5x7",
        "--neighbours",
        "26",
        "--tolerance",
        "1e-5",
    ];
    let of_processor = springs(&lattice);
    for method in ["single", "point", "edge"] {
        let scratch = Scratch::folder();
        let out = scratch.join("out");
        let done = pliant()
            .arg("springs")
            .args(lattice)
            .args([
                "--device",
                "gpu",
                "--method",
                method,
                "--json",
                "--out",
                shown(&out),
            ])
            .output()
            .unwrap();
        let said = text(&done.stderr);
        if done.status.code() == Some(2) {
            let expected = match cfg!(feature = "gpu") {
                true => "there is no graphics device",
                false => "built without the feature `gpu`",
            };
            assert!(
                said.contains(expected) && said.contains("--device cpu"),
                "{said}"
            );
            assert!(!out.exists());
            eprintln!("skipped: {said}");
            return;
        }
        assert_eq!(done.status.code(), Some(0), "{said}");
        let summary: Value = serde_json::from_slice(&done.stdout).unwrap();
        assert_valid(&summary);
        let (here, there) = (&of_processor["springs"], &summary["springs"]);
        assert_eq!(
            (&there["device"], &there["method"]),
            (&"gpu".into(), &method.into())
        );
        assert!(there["card"].is_string() && there["card_bytes"].as_u64().unwrap() > 0);
        let steps = [here, there].map(|of| of["steps"].as_f64().unwrap());
        assert!((steps[0] - steps[1]).abs() <= 2.0, "{steps:?}");
    }
}
