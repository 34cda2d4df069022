//! `pliant audit`: what must be found in frames, of this program and of others, and wrong input.

use super::check::{code, write};
use super::{Scratch, measures, run, run_into, shown, text};
use nalgebra::Vector3;
use pliant::mesh::{TriangleMesh, shapes};
use serde_json::Value;
use std::fs;
use std::path::Path;

/// Exit code and summary of an audit.
fn audit(folder: &Path, more: &[&str]) -> (Option<i32>, Value) {
    let mut command = vec!["audit", shown(folder), "--json"];
    command.extend(more);
    let done = run(&command);
    let summary = serde_json::from_slice(&done.stdout);
    (
        code(&done),
        summary.unwrap_or_else(|_| panic!("{}", text(&done.stderr))),
    )
}

fn ball(at: [f64; 3]) -> TriangleMesh {
    let mut ball = shapes::icosphere(0.05, 3);
    ball.vertices
        .iter_mut()
        .for_each(|p| *p += Vector3::from(at));
    ball
}

/// The vertex with the least x.
fn tip(mesh: &TriangleMesh) -> usize {
    let x = |v: &usize| mesh.vertices[*v].x;
    let all = 0..mesh.vertices.len();
    all.min_by(|a, b| x(a).total_cmp(&x(b))).expect("vertices")
}

/// Three frames of two muscles and a bone at rest that do not touch.
fn clean() -> Scratch {
    let scratch = Scratch::folder();
    for frame in 0..3 {
        let by = 0.001 * f64::from(frame);
        write(
            &scratch.join(format!("medius_{frame:04}.ply")),
            &ball([by, 0.0, 0.0]),
        );
        write(
            &scratch.join(format!("maximus.{frame:04}.obj")),
            &ball([0.12 + by, 0.0, 0.0]),
        );
    }
    let ilium = shapes::box_surface([0.3, 0.004, 0.3], 0.04);
    let below = ilium
        .vertices
        .iter()
        .map(|p| p - Vector3::new(0.0, 0.06, 0.0));
    let ilium = TriangleMesh {
        vertices: below.collect(),
        triangles: ilium.triangles,
    };
    write(&scratch.join("ilium.stl"), &ilium);
    scratch
}

#[test]
fn clean_frames_pass() {
    let scratch = clean();
    let (code, summary) = audit(&scratch, &["--rigid", "ilium"]);
    let found = measures(&summary);
    assert_eq!((code, &found["frames"]), (Some(0), &3.into()), "{summary}");
    assert_eq!(found["crossings_max"]["all"], 0);
    assert_eq!(found["pairs"], Value::Array(Vec::new()));
    let (_, summary) = audit(&scratch, &["--rigid", "ilium", "--every", "2"]);
    assert_eq!(measures(&summary)["frames"], 2);
    let said = |more: &[&str]| {
        let all = ["audit", shown(&scratch), "--rigid", "ilium"];
        text(&run(&[&all, more].concat()).stdout)
    };
    let whole = said(&[]);
    assert!(whole.contains("rigid: ilium"), "{whole}");
    // A part says that it is one.
    let note = "audited: one of every 2 of 3 frames, and the last";
    assert!(
        !whole.contains("audited:") && said(&["--every", "2"]).contains(note),
        "{whole}"
    );
}

#[test]
fn each_fault_turns_its_check_red() {
    /// A change of a frame of a muscle.
    type Change = fn(&mut TriangleMesh);
    let cases: [(&str, &str, Change); 5] = [
        (
            "one triangle through the other",
            "two soft surfaces, most",
            |m| {
                let tip = tip(m);
                m.vertices[tip].x = 0.04;
            },
        ),
        ("a vertex barely inside", "inside another", |m| {
            let tip = tip(m);
            m.vertices[tip].x = 0.0509;
        }),
        ("an edge through a plate", "soft and a rigid surface", |m| {
            *m = shapes::box_surface([0.02, 0.3, 0.02], 1.0);
            m.vertices
                .iter_mut()
                .for_each(|p| *p += Vector3::new(0.131, 0.0, 0.001));
        }),
        ("through itself", "a surface with itself", |m| {
            let tip = tip(m);
            m.vertices[tip].x = 0.19;
        }),
        ("another volume", "enclosed volume", |m| {
            m.vertices.iter_mut().for_each(|p| p.y *= 1.0 + 1e-5);
        }),
    ];
    for (what, check, change) in cases {
        let scratch = clean();
        let mut bad = ball([0.121, 0.0, 0.0]);
        change(&mut bad);
        write(&scratch.join("maximus.0001.obj"), &bad);
        let (code, summary) = audit(&scratch, &["--rigid", "ilium"]);
        assert_eq!(code, Some(1), "{what}");
        let verdicts = summary["verdicts"].as_array().expect("verdicts");
        let failed = verdicts.iter().filter(|v| v["passed"] == false);
        let mut named = failed.filter(|v| v["name"].as_str().is_some_and(|n| n.contains(check)));
        let verdict = named
            .next()
            .unwrap_or_else(|| panic!("{what}: {summary:#}"));
        let place = verdict["where"].as_str().expect("a place");
        assert!(
            place.contains("maximus") && place.contains("frame 1"),
            "{what}: {place}"
        );
    }
    let scratch = clean();
    let mut bad = ball([0.121, 0.0, 0.0]);
    bad.vertices[9].y = 7.25;
    let file = scratch.join("maximus.0001.obj");
    write(&file, &bad);
    let nan = fs::read_to_string(&file)
        .unwrap()
        .replacen("7.25", "nan", 1);
    fs::write(&file, nan).unwrap();
    let (code, summary) = audit(&scratch, &["--rigid", "ilium"]);
    assert_eq!(code, Some(1));
    assert_eq!(
        measures(&summary)["not_finite"],
        serde_json::json!(["maximus", 9, 1])
    );
}

#[test]
fn the_edge_through_the_plate_has_no_vertex_inside() {
    let scratch = clean();
    let mut bad = shapes::box_surface([0.02, 0.3, 0.02], 1.0);
    bad.vertices
        .iter_mut()
        .for_each(|p| *p += Vector3::new(0.131, 0.0, 0.001));
    for frame in 0..3 {
        write(&scratch.join(format!("maximus.{frame:04}.obj")), &bad);
    }
    let (_, summary) = audit(&scratch, &["--rigid", "ilium"]);
    let found = measures(&summary);
    assert!(
        found["crossings_max"]["soft_rigid"]
            .as_u64()
            .is_some_and(|n| n > 0)
    );
    assert_eq!(found["vertices_inside_bones_max"], 0);
    assert_eq!(found["bone_vertices_inside_max"], 0);
    let total = &found["crossings_total"]["all"];
    assert_eq!(
        total.as_u64(),
        found["crossings_max"]["all"].as_u64().map(|n| 3 * n)
    );
}

#[test]
fn a_unit_changes_lengths_and_nothing_else() {
    let scratch = Scratch::folder();
    for folder in ["m", "km"] {
        fs::create_dir(scratch.join(folder)).unwrap();
    }
    for (name, x) in [("a", 0.0), ("b", 0.09)] {
        let mut mesh = ball([x, 0.003, 0.0]);
        write(&scratch.join(format!("m/{name}.ply")), &mesh);
        mesh.vertices.iter_mut().for_each(|p| p.coords *= 1024.0);
        write(&scratch.join(format!("km/{name}.ply")), &mesh);
    }
    let (code, metres) = audit(&scratch.join("m"), &[]);
    assert_eq!(code, Some(1));
    let metres = measures(&metres);
    let (_, other) = audit(&scratch.join("km"), &["--unit", "mm"]);
    let other = measures(&other);
    assert_eq!(metres["crossings_max"], other["crossings_max"]);
    let volumes = [&metres, &other].map(|m| m["shared_volume_max_m3"].as_f64().unwrap());
    let factor = 1.024f64.powi(3);
    assert!(
        (volumes[1] / volumes[0] / factor - 1.0).abs() < 1e-9,
        "{volumes:?}"
    );
}

#[test]
fn the_summary_of_a_run_is_that_of_its_files() {
    let scratch = Scratch::folder();
    let out = scratch.join("hip");
    run_into(&out, &["hip", "--frames", "1", "--exact", "--quiet"]);
    let of_run = super::json(&out.join("summary.json"));
    let (code, of_files) = audit(&out, &["--threads", "1"]);
    assert_eq!(code, Some(0), "{of_files}");
    let mut of_run = of_run["audit"].clone();
    assert!(of_run["crossings_held_max"].is_u64(), "{of_run}");
    // Only a run knows held vertices.
    of_run["crossings_held_max"] = Value::Null;
    assert_eq!(of_run, measures(&of_files));
    let (_, again) = audit(&out.join("hip.pvd"), &["--threads", "3"]);
    assert_eq!(measures(&again), of_run);
}

#[test]
fn a_volume_that_the_scene_changes_is_not_judged() {
    let scratch = Scratch::folder();
    let out = scratch.join("lattice");
    run_into(&out, &["lattice", "--frames", "2", "--quiet"]);
    let (code, of_run) = audit(&out, &[]);
    assert_eq!(code, Some(0), "{of_run}");
    assert!(measures(&of_run)["volume_error_max"].as_f64() > Some(1e-6));
    // The frames alone do not say what the scene lets change.
    fs::remove_file(out.join("summary.json")).expect("a summary");
    let (code, of_files) = audit(&out, &[]);
    assert_eq!(code, Some(1), "{of_files}");
    assert_eq!(measures(&of_run), measures(&of_files));
}

#[test]
fn wrong_input_is_refused() {
    let scratch = clean();
    let here = shown(&scratch).to_owned();
    let at = |name: &str| scratch.join(name).to_str().unwrap().to_owned();
    fs::create_dir(scratch.join("empty")).unwrap();
    fs::create_dir(scratch.join("two")).unwrap();
    for name in ["a.pvd", "b.pvd"] {
        fs::write(scratch.join("two").join(name), "").unwrap();
    }
    let pvd = |name: &str, sets: &str| {
        let text =
            format!("<VTKFile type=\"Collection\"><Collection>{sets}</Collection></VTKFile>");
        fs::write(scratch.join("empty").join(name), text).unwrap();
        scratch
            .join("empty")
            .join(name)
            .to_str()
            .unwrap()
            .to_owned()
    };
    let gone = pvd("gone.pvd", "<DataSet timestep='0' name='a' file='a.vtp'/>");
    let none = pvd("none.pvd", "");
    let twice = pvd(
        "twice.pvd",
        "<DataSet timestep='0' name='a' file='a.vtp'/><DataSet timestep='0' name='a' file='b.vtp'/>",
    );
    let lost = pvd(
        "lost.pvd",
        "<DataSet timestep='0' name='a' file='a.vtp'/><DataSet timestep='1' name='b' file='b.vtp'/>",
    );
    fs::create_dir(scratch.join("hole")).unwrap();
    for frame in [0, 2] {
        write(
            &scratch.join(format!("hole/a_{frame}.ply")),
            &ball([0.0; 3]),
        );
    }
    for frame in 0..3 {
        write(
            &scratch.join(format!("hole/b_{frame}.ply")),
            &ball([1.0; 3]),
        );
    }
    fs::create_dir(scratch.join("garbage")).unwrap();
    fs::write(scratch.join("garbage/a.obj"), "v 1 2\n").unwrap();
    let cases: [(&[&str], &str); 15] = [
        (&["audit"], "FRAMES"),
        (&["audit", &at("absent")], "does not exist"),
        (&["audit", &at("ilium.stl")], "not a .pvd"),
        (&["audit", &at("garbage")], "a.obj:1"),
        (&["audit", &at("two")], "has 2 collections"),
        (&["audit", &gone], "a.vtp"),
        (&["audit", &none], "has no surfaces"),
        (&["audit", &twice], "a is in frame 0 twice"),
        (&["audit", &lost], "is not in all frames"),
        (&["audit", &at("hole")], "a has no file of frame 1"),
        (
            &["audit", &here, "--rigid", "femur"],
            "has no surface `femur`; its surfaces are ilium, maximus, medius",
        ),
        (
            &[
                "audit", &here, "--rigid", "ilium", "--rigid", "maximus", "--rigid", "medius",
            ],
            "no soft surface",
        ),
        (&["audit", &here, "--every", "0"], "--every"),
        (&["audit", &here, "--unit", "furlong"], "no unit of length"),
        (&["audit", &here, "--volume-limit", "nan"], "no share"),
    ];
    for (command, says) in cases {
        let done = run(command);
        let error = text(&done.stderr);
        assert_eq!(code(&done), Some(2), "{command:?}: {error}");
        assert!(error.contains(says), "{command:?}: {error}");
        assert!(done.stdout.is_empty());
    }
}
