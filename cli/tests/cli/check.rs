//! `pliant check` and `pliant convert`.

use super::*;
use pliant::io::{self, Encoding};
use pliant::mesh::TriangleMesh;
use pliant::springs::format;

/// A sphere of 50 mm in metres with a missing triangle, a reversed triangle and an extra
/// vertex.
fn sick() -> TriangleMesh {
    let mut mesh = shapes::icosphere(0.05, 2);
    mesh.triangles.pop();
    mesh.triangles[7].swap(0, 1);
    mesh.vertices.push(mesh.vertices[0] * 1.5);
    mesh
}

pub(super) fn write(path: &Path, mesh: &TriangleMesh) {
    io::write(path, mesh, &[], Encoding::Binary).unwrap();
}

pub(super) fn code(done: &Output) -> Option<i32> {
    done.status.code()
}

#[test]
fn check_says_what_is_wrong_and_whether_it_will_do() {
    let scratch = Scratch::folder();
    let (good, bad) = (scratch.join("good.ply"), scratch.join("bad.obj"));
    write(&good, &shapes::icosphere(0.05, 2));
    write(&bad, &sick());
    let done = run(&["check", shown(&good)]);
    let said = text(&done.stdout);
    assert_eq!(code(&done), Some(0), "{said}");
    assert!(
        said.contains("good.ply: PLY, fit for simulation")
            && said.contains("unit, as a guess    m"),
        "{said}"
    );
    let done = run(&["check", shown(&good), shown(&bad), "--unit", "m"]);
    let said = text(&done.stdout);
    assert_eq!(code(&done), Some(1), "{said}");
    for part in [
        "error[E031]: 3 edges",
        "error[E032]: 3 edges",
        "warning[W005]: 1 vertex",
        "--repair drops",
        "1 of 2 are fit",
    ] {
        assert!(said.contains(part), "{part}: {said}");
    }
    let done = run(&["check", shown(&good), shown(&bad), "--json"]);
    let found: Value = serde_json::from_slice(&done.stdout).unwrap();
    let all = &measures(&found)["meshes"];
    assert_eq!(
        (&all[0]["fit"], &all[1]["fit"]),
        (&Value::Bool(true), &Value::Bool(false))
    );
    assert_eq!(all[1]["findings"][0]["code"], "E031");
    assert_eq!(
        (&all[1]["boundary_loops"], &all[1]["unused_vertices"]),
        (&1.into(), &1.into())
    );
    assert!(
        all[1]["findings"][0]["place"]["triangles"]
            .as_array()
            .is_some_and(|t| t.len() == 2)
    );
}

#[test]
fn an_unreadable_file_does_not_hide_the_others() {
    let scratch = Scratch::folder();
    let (good, bad) = (scratch.join("good.ply"), scratch.join("bad.obj"));
    write(&good, &shapes::icosphere(0.05, 2));
    fs::write(&bad, "v 1 2\n").unwrap();
    let done = run(&[
        "check",
        shown(&bad),
        shown(&good),
        shown(&scratch.join("absent.stl")),
    ]);
    assert_eq!(code(&done), Some(2));
    assert!(
        text(&done.stdout).contains("1 of 1 are fit") || text(&done.stdout).contains("good.ply"),
        "{}",
        text(&done.stdout)
    );
    let errors = text(&done.stderr);
    assert!(
        errors.contains("bad.obj:1:")
            && errors.contains("error[E010]")
            && errors.contains("error[E060]"),
        "{errors}"
    );
    let done = run(&["check", shown(&bad), "--json"]);
    let found: Value = serde_json::from_slice(&done.stdout).unwrap();
    let all = &measures(&found)["meshes"];
    assert!(all[0]["error"].as_str().is_some_and(|e| e.contains("E010")) && code(&done) == Some(2));
    // Warnings of the reader stand beside the findings of the mesh.
    let misnamed = scratch.join("misnamed.stl");
    fs::copy(&good, &misnamed).unwrap();
    let said = |file: &Path| text(&run(&["check", shown(file)]).stdout);
    assert!(
        said(&misnamed).contains("W010") && !said(&good).contains("W010"),
        "{}",
        said(&misnamed)
    );
}

#[test]
fn a_repair_tells_what_it_changed() {
    let scratch = Scratch::folder();
    let bad = scratch.join("bad.obj");
    write(&bad, &sick());
    let before = fs::read(&bad).unwrap();
    let folder = scratch.join("mended");
    let done = run(&[
        "check",
        shown(&bad),
        "--unit",
        "m",
        "--repair",
        shown(&folder),
        "--close-holes",
    ]);
    let said = text(&done.stdout);
    assert_eq!(code(&done), Some(0), "{said}");
    for part in [
        "closed 1 hole with 1 triangle",
        "turned 1 triangle round",
        "dropped 1 vertex",
        "moved by at most 0 mm",
    ] {
        assert!(said.contains(part), "{part}: {said}");
    }
    assert!(!said.contains("polylines are lost"), "it has none: {said}");
    assert_eq!(
        (names_in(&folder), fs::read(&bad).unwrap()),
        (vec!["bad.obj".into(), "changes.json".into()], before)
    );
    let changes = measures(&json(&folder.join("changes.json")));
    let steps: Vec<_> = changes["meshes"][0]["repair"]["changes"]
        .as_array()
        .unwrap()
        .iter()
        .map(|c| &c["step"])
        .collect();
    assert_eq!(
        steps,
        ["closed_holes", "turned_triangles", "dropped_vertices"]
    );
    assert_eq!(
        changes["meshes"][0]["repair"]["changes"][1]["elements"],
        serde_json::json!([7])
    );
    let done = run(&["check", shown(&folder.join("bad.obj"))]);
    assert_eq!(code(&done), Some(0), "{}", text(&done.stdout));
    // A second repair into the same folder is rejected, because the file exists.
    let done = run(&["check", shown(&bad), "--repair", shown(&folder)]);
    assert!(
        code(&done) == Some(2) && text(&done.stderr).contains("is there already"),
        "{}",
        text(&done.stderr)
    );
    let done = run(&["check", shown(&bad), "--repair", shown(&folder), "--force"]);
    assert_eq!(code(&done), Some(1), "{}", text(&done.stdout));
}

#[test]
fn wrong_uses_of_check_and_convert_are_refused() {
    let scratch = Scratch::folder();
    let mesh = scratch.join("a.obj");
    write(&mesh, &shapes::icosphere(0.05, 1));
    let here = shown(&scratch).to_owned();
    let cases: [(&[&str], &str); 10] = [
        (
            &["convert", shown(&mesh), shown(&mesh)],
            "is there already; name another file, or add --force",
        ),
        (&["check"], "MESH"),
        (
            &["check", shown(&mesh), "--unit", "parsec"],
            "no unit of length; known units: m, dm",
        ),
        (&["check", shown(&mesh), "--close-holes=4"], "--repair"),
        (
            &["check", shown(&mesh), "--repair", "x", "--close-holes=501"],
            "501",
        ),
        (
            &["check", shown(&mesh), "--repair", &here],
            "would be written over; name another folder",
        ),
        (
            &["check", shown(&mesh), shown(&mesh), "--repair", "x"],
            "would both become",
        ),
        (
            &[
                "check",
                shown(&mesh),
                "--unit",
                "m",
                "--repair",
                &here,
                "--merge-within",
                "3",
            ],
            "unit",
        ),
        (
            &["convert", shown(&mesh), "b.off"],
            "end the name in one of .obj, .ply, .stl, .vtk, .vtp",
        ),
        (
            &["convert", shown(&mesh), "no/folder/b.obj"],
            "cannot be written",
        ),
    ];
    for (arguments, expected) in cases {
        let done = run(arguments);
        let said = text(&done.stderr);
        assert!(
            code(&done) == Some(2) && said.contains(expected),
            "{arguments:?}: {said}"
        );
    }
    assert_eq!(names_in(&scratch), ["a.obj"]);
}

#[test]
fn convert_changes_format_and_unit_and_nothing_else() {
    let scratch = Scratch::folder();
    let sphere = shapes::icosphere(50.0, 2);
    let first = scratch.join("a.obj");
    io::write(&first, &sphere, &[vec![0, 1, 2]], Encoding::Text).unwrap();
    for ending in ["ply", "vtk", "vtp", "obj"] {
        for ascii in [false, true] {
            let second = scratch.join(format!("b.{ending}"));
            let mut arguments = vec!["convert", shown(&first), shown(&second), "--force"];
            arguments.extend(ascii.then_some("--ascii"));
            let done = run(&arguments);
            assert_eq!(code(&done), Some(0), "{}", text(&done.stderr));
            assert_eq!(io::read(&second).unwrap().mesh, sphere, "{ending}");
        }
    }
    let second = scratch.join("b.stl");
    let done = run(&[
        "convert",
        shown(&first),
        shown(&second),
        "--unit",
        "mm",
        "--to-unit",
        "m",
    ]);
    assert!(
        text(&done.stdout).contains("1 polylines are lost"),
        "{}",
        text(&done.stdout)
    );
    let side = io::read(&second).unwrap().mesh.length();
    assert!((side - 0.1).abs() <= 1e-8, "{side}");
    let done = run(&[
        "convert",
        shown(&first),
        shown(&second),
        "--force",
        "--json",
    ]);
    let found: Value = serde_json::from_slice(&done.stdout).unwrap();
    assert_eq!(measures(&found)["lines_lost"], 1);
}

#[test]
fn files_of_springs_are_converted_both_ways() {
    let scratch = Scratch::folder();
    let sphere = shapes::icosphere(0.5, 1);
    let mesh = scratch.join("a.obj");
    io::write(&mesh, &sphere, &[vec![0, 1, 2]], Encoding::Text).unwrap();
    let at = |name: &str| scratch.join(name);
    let convert = |from: &str, to: &str, more: &[&str]| {
        let (from, to) = (at(from), at(to));
        let mut arguments = vec!["convert", shown(&from), shown(&to), "--json"];
        arguments.extend(more);
        let done = run(&arguments);
        assert_eq!(code(&done), Some(0), "{}", text(&done.stderr));
        serde_json::from_slice::<Value>(&done.stdout).unwrap()
    };
    convert("a.obj", "a.springs", &[]);
    let file = format::read(&at("a.springs")).unwrap();
    assert_eq!(
        (&file.position, &file.triangles),
        (&sphere.vertices, &sphere.triangles)
    );
    assert_eq!(file.springs.len(), 120, "edges of 80 triangles");
    for ([a, b], stiffness) in &file.springs {
        let length = (file.position[*a as usize] - file.position[*b as usize]).norm();
        assert!((stiffness * length - 1.0).abs() <= 1e-15);
    }
    assert_eq!(file.fibres, [[0, 1], [1, 2]]);
    // All of a file of springs comes back; of a mesh its springs are lost, and a note says so.
    let full = format::SpringFile {
        origin: vec![3, 5],
        insertion: vec![7],
        ..file
    };
    format::write(&at("b.springs"), &full).unwrap();
    convert(
        "b.springs",
        "c.springs",
        &["--unit", "mm", "--to-unit", "m"],
    );
    let small = format::read(&at("c.springs")).unwrap();
    assert_eq!(small.position[4], full.position[4] / 1000.0);
    let back = format::SpringFile {
        position: full.position.clone(),
        ..small
    };
    assert_eq!(back, full);
    let told = convert("b.springs", "d.obj", &[]);
    let notes = told["notes"].to_string();
    assert!(
        notes.contains("120 springs") && notes.contains("3 points of areas"),
        "{notes}"
    );
    let read = io::read(&at("d.obj")).unwrap();
    assert_eq!((read.mesh, read.lines), (sphere, vec![vec![0, 1, 2]]));
    // Control: what is no file of springs is refused with its place.
    let done = run(&["convert", shown(&mesh), shown(&at("e.springs")), "--force"]);
    assert_eq!(code(&done), Some(0));
    fs::write(at("f.springs"), "2 2\n0 0 0 m\n1 0 0 m\n0\n1\n0 2 1\n").unwrap();
    let done = run(&["convert", shown(&at("f.springs")), shown(&at("g.obj"))]);
    assert!(
        code(&done) == Some(2) && text(&done.stderr).contains("f.springs:6:3"),
        "{}",
        text(&done.stderr)
    );
}

#[test]
fn the_hierarchy_of_a_mesh_is_drawn() {
    let scratch = Scratch::folder();
    let mesh = scratch.join("ball.obj");
    write(&mesh, &shapes::icosphere(0.1, 2));
    let out = scratch.join("pictures");
    let done = run(&["check", shown(&mesh), "--hierarchy", shown(&out)]);
    assert_eq!(code(&done), Some(0), "{}", text(&done.stderr));
    let png = fs::read(out.join("ball-hierarchy.png")).unwrap();
    assert!(png.starts_with(b"\x89PNG"));
    // Control: a file in the place of the folder is refused.
    let done = run(&["check", shown(&mesh), "--hierarchy", shown(&mesh)]);
    assert!(code(&done) == Some(2) && text(&done.stderr).contains("cannot be written"));
}

#[test]
fn a_scene_may_ask_for_a_repair() {
    let scratch = Scratch::folder();
    write(&scratch.join("sick.obj"), &sick());
    let scene = scratch.join("sick.toml");
    let toml = |more: &str| {
        format!(
            "frames = 1\nframe_rate = \"60 Hz\"\n[[muscle]]\nname = \"ball\"\nmesh = \"sick.obj\"\nunit = \"m\"\n{more}\n[effects.volume]\n"
        )
    };
    fs::write(&scene, toml("")).unwrap();
    let done = run(&["run", shown(&scene), "--out", shown(&scratch.join("out"))]);
    assert!(
        code(&done) == Some(2) && text(&done.stderr).contains("repair = true"),
        "{}",
        text(&done.stderr)
    );
    fs::write(&scene, toml("repair = true\nclose_holes = 3")).unwrap();
    let done = run_into(&scratch.join("out"), &[shown(&scene)]);
    assert!(
        text(&done.stdout).contains("note: ball: repair: closed 1 hole with 1 triangle"),
        "{}",
        text(&done.stdout)
    );
    let page = fs::read_to_string(scratch.join("out/report.html")).unwrap();
    assert!(page.contains("ball: repair: turned 1 triangle round"));
    let summary = json(&scratch.join("out/summary.json"));
    assert!(summary["notes"].as_array().unwrap().iter().any(|n| {
        n.as_str()
            .unwrap()
            .contains("vertices moved by at most 0.000 mm")
    }));
    for (more, expected) in [
        ("close_holes = 3", "error[E055]"),
        ("repair = 1", "error[E054]"),
        ("repair = true\nclose_holes = 501", "error[E051]"),
        (
            "repair = true\n[[muscle.displace]]\nvertices = [0]\nby = [\"1 mm\", \"0 mm\", \"0 mm\"]",
            "error[E056]",
        ),
    ] {
        fs::write(&scene, toml(more)).unwrap();
        let done = run(&["plan", shown(&scene)]);
        assert!(
            code(&done) == Some(2) && text(&done.stderr).contains(expected),
            "{more}: {}",
            text(&done.stderr)
        );
    }
}
