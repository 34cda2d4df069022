//! `pliant morph`: files, numbers, point data, refusals.

use std::fs;
use std::path::{Path, PathBuf};

use nalgebra::Point3;
use pliant::io::obj;
use pliant::io::vtp::{self, PolyData};
use pliant::io::{read, read_point_data};
use pliant::mesh::measures::max_or_nan;
use pliant::mesh::{TriangleMesh, shapes};
use serde_json::Value;

use super::{Scratch, json, measures, names_in, referenced, run, shown, text};

fn stretched(times: [f64; 3]) -> TriangleMesh {
    let mut mesh = shapes::icosphere(1.0, 2);
    mesh.vertices
        .iter_mut()
        .for_each(|v| *v = Point3::new(v.x * times[0], v.y * times[1], v.z * times[2]));
    mesh
}

fn put(scratch: &Scratch, name: &str, mesh: &TriangleMesh) -> PathBuf {
    let path = scratch.join(name);
    obj::write(&path, mesh, &[]).unwrap();
    path
}

fn put_with(
    scratch: &Scratch,
    name: &str,
    mesh: &TriangleMesh,
    point_data: Vec<(&str, Vec<f64>)>,
) -> PathBuf {
    let path = scratch.join(name);
    vtp::write(
        &path,
        &PolyData {
            points: &mesh.vertices,
            triangles: &mesh.triangles,
            lines: &[],
            point_data,
            ..PolyData::default()
        },
    )
    .unwrap();
    path
}

fn done(arguments: &[&str]) -> Value {
    let done = run(arguments);
    assert_eq!(
        done.status.code(),
        Some(0),
        "{arguments:?}: {}",
        text(&done.stderr)
    );
    serde_json::from_slice(&done.stdout).unwrap_or(Value::Null)
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or(f64::NAN)
}

#[test]
fn a_morph_writes_all_its_files_and_meets_both_ends() {
    let scratch = Scratch::folder();
    let (ball, long) = (
        stretched([1.0; 3]),
        shapes::box_surface([3.0, 1.0, 1.5], 0.5),
    );
    let heat: Vec<f64> = ball.vertices.iter().map(|p| p.x).collect();
    let other: Vec<f64> = long.vertices.iter().map(|p| 10.0 + p.y).collect();
    let flow: Vec<f64> = ball.vertices.iter().flat_map(|p| [p.z, p.y, p.x]).collect();
    let a = put_with(
        &scratch,
        "ball.vtp",
        &ball,
        vec![("heat", heat.clone()), ("flow", flow)],
    );
    let b = put_with(
        &scratch,
        "box.vtp",
        &long,
        vec![("heat", other.clone()), ("depth", other.clone())],
    );
    let out = scratch.join("out");
    for blend in ["linear", "hermite", "laplacian"] {
        let summary = done(&[
            "morph",
            shown(&a),
            shown(&b),
            "--unit",
            "cm",
            "--frames",
            "3",
            "--blend",
            blend,
            "--json",
            "--out",
            shown(&out),
        ]);
        assert_eq!(summary, json(&out.join("summary.json")));
        let summary = measures(&summary);
        assert_eq!(
            (
                &summary["flipped_a"],
                &summary["flipped_b"],
                &summary["euler"]
            ),
            (&0.into(), &0.into(), &2.into())
        );
        assert!(
            number(&summary["a"]["end_error"]) <= 1e-12
                && number(&summary["b"]["end_error"]) <= 1e-12,
            "{summary}"
        );
        assert!(
            number(&summary["a"]["end_miss"]) <= 1e-12
                && number(&summary["b"]["end_miss"]) <= 1e-12,
            "{summary}"
        );
        assert!(
            (number(&summary["volume_1"]) / (long.volume() * 1e-6) - 1.0).abs() <= 1e-12,
            "{summary}"
        );
        assert!(
            (number(&summary["volume_0"]) / (ball.volume() * 1e-6) - 1.0).abs() <= 1e-12,
            "{summary}"
        );
        assert!(number(&summary["a"]["map"]["conformal_median"]) >= 1.0);
        assert_eq!(summary["length_unit"], "m");
    }
    let arrays = measures(&json(&out.join("summary.json")))["arrays"].clone();
    let of = |k: usize| {
        (
            arrays[k]["name"].as_str().unwrap(),
            arrays[k]["of"].as_str().unwrap(),
        )
    };
    assert_eq!(
        (of(0), of(1), of(2)),
        (("heat", "both"), ("flow", "a"), ("depth", "b"))
    );
    let names = names_in(&out);
    for name in [
        "ball-box.gif",
        "ball-box.pvd",
        "frames",
        "measures.csv",
        "report.html",
        "sheet.png",
        "spheres.png",
        "summary.json",
    ] {
        assert!(
            names.iter().any(|n| n == name),
            "{name} is not in {names:?}"
        );
    }
    let frames = referenced(&out, "ball-box.pvd");
    assert_eq!(frames.len(), 3);
    assert_eq!(
        fs::read_to_string(out.join("measures.csv"))
            .unwrap()
            .lines()
            .count(),
        4
    );
    assert_frames(&out, &frames, [&ball, &long], [&heat, &other]);
}

/// The vertices of both surfaces come first, at their end positions and with their numbers.
fn assert_frames(out: &Path, frames: &[String], meshes: [&TriangleMesh; 2], heat: [&[f64]; 2]) {
    let [first, middle, last] = [0, 1, 2].map(|k| out.join(&frames[k]));
    let of = |path: &Path, name: &str| {
        let all = read_point_data(path).unwrap();
        all.into_iter()
            .find(|d| d.name == name)
            .unwrap_or_else(|| panic!("{name} in {}", path.display()))
            .values
    };
    let (a, b) = (read(&first).unwrap().mesh, read(&last).unwrap().mesh);
    assert_eq!(
        (a.vertices.len(), &a.triangles),
        (b.vertices.len(), &b.triangles)
    );
    let count = [meshes[0].vertices.len(), meshes[1].vertices.len()];
    let off = |found: &[Point3<f64>], expected: &[Point3<f64>]| {
        max_or_nan(
            found
                .iter()
                .zip(expected)
                .map(|(p, q)| (p - q * 0.01).norm()),
        )
    };
    assert!(off(&a.vertices[..count[0]], &meshes[0].vertices) <= 1e-15);
    assert!(
        off(
            &b.vertices[count[0]..count[0] + count[1]],
            &meshes[1].vertices
        ) <= 1e-15
    );
    assert_eq!(of(&first, "heat")[..count[0]], *heat[0]);
    assert_eq!(of(&last, "heat")[count[0]..count[0] + count[1]], *heat[1]);
    let (start, half, end) = (of(&first, "heat"), of(&middle, "heat"), of(&last, "heat"));
    assert!((0..half.len()).all(|i| (half[i] - 0.5 * (start[i] + end[i])).abs() <= 1e-12));
    assert_eq!(
        of(&first, "flow"),
        of(&last, "flow"),
        "what one side has is carried"
    );
    assert_eq!(of(&middle, "flow").len(), 3 * half.len());
    assert!(max_or_nan(of(&first, "depth").iter().copied()) <= 10.75 + 1e-12);
    let kinds = of(&middle, "origin");
    assert!(
        kinds[..count[0]].iter().all(|k| *k == 0.0)
            && kinds[count[0]..count[0] + count[1]]
                .iter()
                .all(|k| *k == 1.0)
    );
}

#[test]
fn pairs_meet_and_the_first_topology_is_kept() {
    let scratch = Scratch::folder();
    let (ball, long) = (stretched([1.0; 3]), stretched([1.0, 2.0, 1.0]));
    let (a, b) = (put(&scratch, "a.obj", &ball), put(&scratch, "b.obj", &long));
    let pairs = scratch.join("pairs.txt");
    // A quarter turn about z: the point at the right moves up. The last pair is given by
    // coordinates.
    let nearest = |mesh: &TriangleMesh, to: [f64; 3]| {
        let square = |v: &usize| (mesh.vertices[*v] - Point3::from(to)).norm_squared();
        (0..mesh.vertices.len())
            .min_by(|i, j| square(i).total_cmp(&square(j)))
            .unwrap()
    };
    let right = [
        nearest(&ball, [1.0, 0.0, 0.0]),
        nearest(&long, [0.0, 2.0, 0.0]),
    ];
    let top = [
        nearest(&ball, [0.0, 0.0, 1.0]),
        nearest(&long, [0.0, 0.0, 1.0]),
    ];
    fs::write(
        &pairs,
        format!(
            "# right to top\n{} {}\n\n0 1 0 -1 0 0 # left\n{} {}\n",
            right[0], right[1], top[0], top[1]
        ),
    )
    .unwrap();
    let out = scratch.join("out");
    let summary = done(&[
        "morph",
        shown(&a),
        shown(&b),
        "--pairs",
        shown(&pairs),
        "--topology",
        "first",
        "--frames",
        "2",
        "--json",
        "--out",
        shown(&out),
    ]);
    let summary = measures(&summary);
    assert_eq!(
        (&summary["pairs"], &summary["aligned_by"]),
        (&3.into(), &"pairs".into())
    );
    assert_eq!(
        (&summary["vertices"], &summary["triangles"]),
        (&ball.vertices.len().into(), &ball.triangles.len().into())
    );
    assert_eq!(summary["length_unit"], "that of the files");
    let frames = referenced(&out, "a-b.pvd");
    let last = read(&out.join(&frames[1])).unwrap().mesh;
    let off = (last.vertices[right[0]] - long.vertices[right[1]]).norm();
    assert!(off <= 1e-9, "{off}");
    // Control: without pairs the ball is not rotated.
    done(&[
        "morph",
        shown(&a),
        shown(&b),
        "--topology",
        "first",
        "--frames",
        "2",
        "--json",
        "--out",
        shown(&out),
    ]);
    let last = read(&out.join(&frames[1])).unwrap().mesh;
    assert!((last.vertices[right[0]] - long.vertices[right[1]]).norm() > 1.0);
}

#[test]
fn relaxation_tells_its_sweeps() {
    let scratch = Scratch::folder();
    let a = put(&scratch, "a.obj", &stretched([1.0; 3]));
    let b = put(&scratch, "b.obj", &stretched([3.0, 1.0, 1.0]));
    let out = scratch.join("out");
    let base = [
        "morph",
        shown(&a),
        shown(&b),
        "--frames",
        "2",
        "--json",
        "--out",
        shown(&out),
    ];
    let summary = measures(&done(&[&base[..], &["--method", "relaxation"]].concat()));
    assert!(
        number(&summary["b"]["relaxation"]["first"]) > 10.0,
        "{summary}"
    );
    assert_eq!(
        (&summary["flipped_b"], &summary["method"]),
        (&0.into(), &"relaxation".into())
    );
    assert_eq!(measures(&done(&base))["b"]["relaxation"], Value::Null);
}

#[test]
fn surfaces_that_are_no_spheres_are_refused_with_their_place() {
    let scratch = Scratch::folder();
    let ball = stretched([1.0; 3]);
    let good = put(&scratch, "good.obj", &ball);
    let out = scratch.join("out");
    let with = |name: &str, change: &dyn Fn(&mut TriangleMesh)| {
        let mut mesh = ball.clone();
        change(&mut mesh);
        put(&scratch, name, &mesh)
    };
    let open = with("open.obj", &|m| m.triangles.truncate(m.triangles.len() - 1));
    let two = with("two.obj", &|m| {
        let count = m.vertices.len() as u32;
        m.vertices.extend(
            ball.vertices
                .iter()
                .map(|p| Point3::new(p.x + 5.0, p.y, p.z)),
        );
        m.triangles
            .extend(ball.triangles.iter().map(|t| t.map(|v| v + count)));
    });
    let turned = with("turned.obj", &|m| m.triangles[7].swap(0, 1));
    let inside_out = with("inside_out.obj", &|m| {
        m.triangles.iter_mut().for_each(|t| t.swap(0, 1))
    });
    let fin = with("fin.obj", &|m| {
        m.vertices.push(Point3::new(3.0, 0.0, 0.0));
        m.triangles
            .push([m.triangles[0][0], m.triangles[0][1], 162]);
    });
    let few = with("few.obj", &|m| m.triangles.truncate(2));
    let ring = put(&scratch, "ring.obj", &torus());
    // What a repair closes without a loss is mended, on either side, and the notes say so.
    for (path, expected) in [
        (
            &open,
            "open.obj was mended first: closed 1 hole with 1 triangle",
        ),
        (&turned, "turned.obj was mended first: turned 1 triangle"),
        (
            &inside_out,
            "inside_out.obj was mended first: turned 320 triangles",
        ),
        (&fin, "fin.obj was mended first"),
    ] {
        for pair in [[shown(path), shown(&good)], [shown(&good), shown(path)]] {
            let few = ["--frames", "2", "--json", "--quiet", "--out", shown(&out)];
            let done = run(&[&["morph"], &pair[..], &few].concat());
            let summary: Value = serde_json::from_slice(&done.stdout).expect("a summary");
            let notes = summary["notes"].to_string();
            assert!(notes.contains(expected), "{pair:?}: {notes}");
            assert_eq!(summary["morph"]["handles_cut"], 0);
            fs::remove_dir_all(&out).unwrap();
        }
    }
    // What loses more than a fifth of its area is another body: a ring of few vertices, too.
    let cases: [(&Path, &[&str]); 3] = [
        (
            &ring,
            &[
                "ring.obj: the surface has 1 handle (V - E + F = 0)",
                "cut its handles",
            ],
        ),
        (
            &two,
            &[
                "two.obj: 2 separate surfaces",
                "(vertex 162 is at ",
                "--keep-largest`",
            ],
        ),
        (
            &few,
            &["few.obj: 162 vertices and 2 triangles; a closed surface needs at least 4 of each"],
        ),
    ];
    for (path, expected) in cases {
        // Frames on either surface.
        for arguments in [
            ["morph", shown(path), shown(&good)],
            ["morph", shown(&good), shown(path)],
        ] {
            refused(
                &[&arguments[..], &["--out", shown(&out)]].concat(),
                expected,
            );
            assert!(!out.exists(), "{arguments:?}");
        }
    }
    let nowhere = scratch.join("nowhere.obj");
    refused(&["morph", shown(&nowhere), shown(&good)], &["nowhere.obj"]);
    refused(
        &["morph", shown(&good), shown(&good), "--unit", "parsec"],
        &["`parsec` is no unit of length", "mm"],
    );
    refused(
        &["morph", shown(&good), shown(&good), "--blend", "cubic"],
        &["linear, hermite, laplacian"],
    );
    refused(
        &["morph", shown(&good), shown(&good), "--frames", "1"],
        &["2..=10000"],
    );
    let one = put_with(&scratch, "one.vtp", &ball, vec![("heat", vec![1.0; 162])]);
    let three = put_with(&scratch, "three.vtp", &ball, vec![("heat", vec![1.0; 486])]);
    refused(
        &["morph", shown(&one), shown(&three), "--out", shown(&out)],
        &["`heat` has another number of components in", "three.vtp"],
    );
}

#[test]
fn files_of_pairs_that_are_wrong_are_refused_with_their_line() {
    let scratch = Scratch::folder();
    let a = put(&scratch, "a.obj", &stretched([1.0; 3]));
    let b = put(&scratch, "b.obj", &stretched([1.0, 2.0, 1.0]));
    let pairs = scratch.join("p.txt");
    for (content, expected) in [
        (
            "0 1\n# x\n5 162\n",
            &[
                "p.txt:3: there is no vertex 162 in",
                "b.obj",
                "it has 162, from 0 to 161",
            ][..],
        ),
        (
            "0 1\n99999999999 2\n",
            &["p.txt:2: there is no vertex 99999999999 in", "a.obj"],
        ),
        (
            "0 1\n2 3\n0 4\n",
            &[
                "p.txt:3: vertex 0 of",
                "a.obj is in line 1 already",
                "drop one of the lines",
            ],
        ),
        (
            "0 1\n2 1\n",
            &["p.txt:2: vertex 1 of", "b.obj is in line 1 already"],
        ),
        (
            "0 1\n2\n",
            &["p.txt:2: `2` is no pair; give two vertices, counted from 0, or six coordinates"],
        ),
        ("0 -1\n", &["p.txt:1: `0 -1` is no pair"]),
        ("0 1.5\n", &["p.txt:1: `0 1.5` is no pair"]),
        ("0 0 0 1 nan 0\n", &["p.txt:1: `0 0 0 1 nan 0` is no pair"]),
        ("# nothing\n", &["p.txt: no pairs"]),
    ] {
        fs::write(&pairs, content).unwrap();
        refused(
            &["morph", shown(&a), shown(&b), "--pairs", shown(&pairs)],
            expected,
        );
    }
    refused(
        &["morph", shown(&a), shown(&b), "--pairs", "nowhere.txt"],
        &["cannot read `nowhere.txt`"],
    );
}

fn refused(arguments: &[&str], expected: &[&str]) {
    let done = run(arguments);
    let message = text(&done.stderr);
    assert_eq!(done.status.code(), Some(2), "{arguments:?}: {message}");
    for part in expected {
        assert!(
            message.contains(part),
            "{arguments:?}: `{part}` is not in: {message}"
        );
    }
    assert!(
        done.stdout.is_empty() && !message.contains("panicked"),
        "{message}"
    );
}

fn torus() -> TriangleMesh {
    let (m, n) = (8, 6);
    let at = |i: u32, j: u32| (i % m) * n + j % n;
    let pair = |i: u32, j: u32| {
        [
            [at(i, j), at(i + 1, j), at(i + 1, j + 1)],
            [at(i, j), at(i + 1, j + 1), at(i, j + 1)],
        ]
    };
    let triangles = (0..m * n).flat_map(|k| pair(k / n, k % n)).collect();
    let place = |k: u32| {
        let [u, v] = [(k / n, m), (k % n, n)]
            .map(|(i, n)| std::f64::consts::TAU * f64::from(i) / f64::from(n));
        Point3::new(
            (3.0 + v.cos()) * u.cos(),
            (3.0 + v.cos()) * u.sin(),
            v.sin(),
        )
    };
    TriangleMesh {
        vertices: (0..m * n).map(place).collect(),
        triangles,
    }
}

/// A ring of radius 1 about z, 0.4 thick.
fn ring() -> TriangleMesh {
    let distance = |p: Point3<f64>| (p.xy().coords.norm() - 1.0).hypot(p.z) - 0.4;
    let corner = Point3::new(1.6, 1.6, 0.6);
    pliant::mesh::isosurface(distance, -corner, corner, 0.1)
}

#[test]
fn a_ring_is_cut_for_a_map_and_closes_by_volume() {
    let scratch = Scratch::folder();
    let a = put(&scratch, "ring.obj", &ring());
    let b = put(&scratch, "ball.obj", &stretched([1.2; 3]));
    let out = scratch.join("out");
    let common = [
        "morph",
        shown(&a),
        shown(&b),
        "--frames",
        "5",
        "--json",
        "--quiet",
        "--out",
        shown(&out),
    ];
    // A cut ring is a C, which opens to a ball far away from any middle: only its map is judged.
    let cut = run(&[&common[..], &["--lenient"]].concat());
    let cut: Value = serde_json::from_slice(&cut.stdout).expect("a summary");
    assert_eq!(cut["morph"]["handles_cut"], 1);
    assert_eq!(cut["morph"]["a"]["map"]["flipped"], 0);
    let notes = cut["notes"].as_array().expect("notes");
    assert!(
        notes
            .iter()
            .any(|note| note.as_str().is_some_and(|n| n.contains("cut 1 handle")))
    );
    let closed = done(&[&common[..], &["--method", "volume", "--cells", "32"]].concat());
    let shapes = closed["morph_by_volume"]["shapes"]
        .as_array()
        .expect("shapes");
    assert_eq!(
        (&shapes[0]["handles"], &shapes[4]["handles"]),
        (&1.into(), &0.into())
    );
    assert!(out.join("frames/ring-ball_000004.vtp").exists());
    for (more, expected) in [
        (&["--cells", "32"][..], "--cells is given"),
        (
            &["--method", "volume", "--cells", "3"],
            "3 is not in 8..=256",
        ),
        (
            &["--method", "volume", "--pairs", "none.txt"],
            "know no pairs",
        ),
    ] {
        let refused = run(&[&common[..], more].concat());
        assert_eq!(refused.status.code(), Some(2));
        assert!(
            text(&refused.stderr).contains(expected),
            "{}",
            text(&refused.stderr)
        );
    }
}
