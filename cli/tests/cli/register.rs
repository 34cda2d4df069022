//! `pliant register`: files, the motion that is found, bending, refusals.

use std::fs;
use std::path::PathBuf;

use nalgebra::{Matrix4, Point3, Similarity3, Vector3};
use pliant::io::obj;
use pliant::io::vtp::{self, PolyData};
use pliant::io::{read, read_point_data};
use pliant::mesh::measures::max_or_nan;
use pliant::mesh::{TriangleMesh, shapes};
use serde_json::Value;

use super::{Scratch, json, measures, names_in, run, shown, text};

/// A body with bumps of different sizes, so that only one position fits. Its vertices are those
/// of a ball rotated by `turn`.
fn body(turn: Vector3<f64>) -> TriangleMesh {
    let mut mesh = shapes::icosphere(1.0, 3);
    let turn = nalgebra::UnitQuaternion::from_scaled_axis(turn);
    for v in &mut mesh.vertices {
        let p = turn * *v;
        let bump = |c: [f64; 3], high: f64, sharp: f64| {
            high * (-(p - Point3::from(c)).norm_squared() * sharp).exp()
        };
        let r = 1.0
            + bump([1.0, 0.0, 0.0], 0.8, 4.0)
            + bump([0.0, 0.8, 0.6], 0.5, 6.0)
            + bump([-0.6, -0.8, 0.0], 0.4, 8.0)
            - bump([0.0, -0.6, 0.8], 0.3, 5.0);
        *v = Point3::new(p.x * r * 1.6, p.y * r, p.z * r * 0.8);
    }
    mesh
}

fn put(scratch: &Scratch, name: &str, mesh: &TriangleMesh) -> PathBuf {
    let path = scratch.join(name);
    obj::write(&path, mesh, &[]).unwrap();
    path
}

fn moved(mesh: &TriangleMesh, by: &Similarity3<f64>) -> TriangleMesh {
    TriangleMesh {
        vertices: mesh.vertices.iter().map(|p| by * p).collect(),
        triangles: mesh.triangles.clone(),
    }
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or(f64::NAN)
}

#[test]
fn a_known_similarity_is_found_and_reported_as_a_matrix() {
    let scratch = Scratch::folder();
    let fixed = body(Vector3::zeros());
    let known = Similarity3::new(
        Vector3::new(4.0, -2.0, 1.0),
        Vector3::new(1.0, 2.0, -0.7),
        1.7,
    );
    // The same shape with other vertices.
    let moving = moved(&body(Vector3::new(0.3, 0.2, 0.5)), &known.inverse());
    let heat: Vec<f64> = (0..642).map(f64::from).collect();
    let a = scratch.join("a.vtp");
    let data = PolyData {
        points: &moving.vertices,
        triangles: &moving.triangles,
        lines: &[],
        point_data: vec![("heat", heat.clone())],
        ..PolyData::default()
    };
    vtp::write(&a, &data).unwrap();
    let (b, out) = (put(&scratch, "b.obj", &fixed), scratch.join("out"));
    let base = [
        "register",
        shown(&a),
        shown(&b),
        "--overlap",
        "0.8",
        "--json",
        "--out",
        shown(&out),
    ];
    let done = run(&[&base[..], &["--with", "similarity"]].concat());
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let summary = json(&out.join("summary.json"));
    assert_eq!(
        serde_json::from_slice::<Value>(&done.stdout).unwrap(),
        summary
    );
    assert_eq!(summary["findings"], serde_json::json!([]));
    let summary = measures(&summary);
    let matrix = Matrix4::from_fn(|i, k| number(&summary["matrix"][i][k]));
    let place = |p: &Point3<f64>| Point3::from_homogeneous(matrix * p.to_homogeneous()).unwrap();
    let size = number(&summary["size"]);
    let off = max_or_nan(
        moving
            .vertices
            .iter()
            .map(|p| (place(p) - known * p).norm()),
    ) / size;
    assert!(off <= 2e-3, "{off}");
    assert!((number(&summary["scale"]) / 1.7 - 1.0).abs() <= 2e-3);
    assert!(
        number(&summary["inlier_share"]) > 0.95
            && number(&summary["residual"]["rms"]) <= 3e-3 * size,
        "{summary}"
    );
    assert_eq!(
        (&summary["non_rigid"], &summary["converged"]),
        (&Value::Null, &true.into())
    );
    let names = names_in(&out);
    for name in [
        "after.png",
        "before.png",
        "moved.obj",
        "moved.vtp",
        "report.html",
        "summary.json",
    ] {
        assert!(
            names.iter().any(|n| n == name),
            "{name} is not in {names:?}"
        );
    }
    let there = read(&out.join("moved.vtp")).unwrap().mesh;
    assert_eq!(there.triangles, moving.triangles);
    assert!(
        max_or_nan(
            there
                .vertices
                .iter()
                .zip(&moving.vertices)
                .map(|(q, p)| (q - place(p)).norm())
        ) <= 1e-12 * size
    );
    let arrays = read_point_data(&out.join("moved.vtp")).unwrap();
    let named: Vec<&str> = arrays.iter().map(|d| d.name.as_str()).collect();
    assert_eq!(
        (named.as_slice(), &arrays[0].values),
        (&["heat", "distance", "inlier"][..], &heat)
    );
    // Control: without a scale it does not fit, and says so; into the same folder, whose files are our own.
    let done = run(&base);
    assert_eq!(done.status.code(), Some(1), "{}", text(&done.stdout));
    assert!(
        text(&done.stderr).contains("FAIL") || text(&done.stderr).contains("lower --overlap"),
        "{}",
        text(&done.stderr)
    );
}

#[test]
fn bending_comes_nearer_than_any_motion() {
    let scratch = Scratch::folder();
    let fixed = body(Vector3::zeros());
    let mut bent = body(Vector3::new(0.3, 0.2, 0.5));
    for v in &mut bent.vertices {
        v.y += 0.06 * v.x * v.x;
        v.z *= 1.0 + 0.05 * v.x;
    }
    let (a, b, out) = (
        put(&scratch, "a.obj", &bent),
        put(&scratch, "b.obj", &fixed),
        scratch.join("out"),
    );
    let base = [
        "register",
        shown(&a),
        shown(&b),
        "--overlap",
        "0.3",
        "--json",
        "--out",
        shown(&out),
    ];
    let rms = |arguments: &[&str]| {
        let done = run(arguments);
        assert!(done.status.code() < Some(2), "{}", text(&done.stderr));
        let summary = json(&out.join("summary.json"));
        // What lies off the other surface is named, in the words of a reader.
        let found = summary["findings"][0].as_str().unwrap_or_default();
        let share = number(&measures(&summary)["inlier_share"]);
        assert_eq!(
            found.contains("do not lie on B"),
            share < 0.9,
            "{share} {found}"
        );
        let summary = measures(&summary);
        (
            number(&summary["distance"]["rms"]) / number(&summary["size"]),
            summary,
        )
    };
    let (rigid, _) = rms(&base);
    let (soft, summary) = rms(&[&base[..], &["--non-rigid", "--clusters", "60"]].concat());
    println!("distance over the size: {rigid:e} by a motion, {soft:e} bent");
    assert!(rigid > 4e-3 && soft < 0.3 * rigid, "{rigid} {soft}");
    assert_eq!(summary["non_rigid"]["clusters"], 60);
    assert!(
        number(&summary["non_rigid"]["bend_max_deg"]) > 0.0
            && number(&summary["non_rigid"]["bend_max_deg"]).to_radians() < 1.0
    );
    let clusters = read_point_data(&out.join("moved.vtp")).unwrap();
    let cluster = clusters.iter().find(|d| d.name == "cluster").unwrap();
    assert_eq!(max_or_nan(cluster.values.iter().copied()), 59.0);
}

#[test]
fn what_cannot_be_registered_is_refused() {
    let scratch = Scratch::folder();
    let good = put(&scratch, "good.obj", &body(Vector3::zeros()));
    let out = scratch.join("out");
    let few = scratch.join("few.obj");
    fs::write(&few, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    let spot = scratch.join("spot.obj");
    fs::write(
        &spot,
        "v 1 1 1\nv 1 1 1\nv 1 1 1\nv 1 1 1\nf 1 2 3\nf 1 2 4\n",
    )
    .unwrap();
    let lines = scratch.join("lines.obj");
    fs::write(&lines, "v 0 0 0\nv 1 0 0\nl 1 2\n").unwrap();
    // As a bone in metres beside a scan in millimetres.
    let scan = moved(&body(Vector3::zeros()), &Similarity3::from_scaling(1000.0));
    let scan = put(&scratch, "scan.obj", &scan);
    let cases: [(&[&str], &[&str]); 9] = [
        (
            &[shown(&good), shown(&scan), "--with", "similarity"],
            &["scan.obj", "their units differ", "pliant convert"],
        ),
        (
            &[shown(&few), shown(&good)],
            &["few.obj: 3 vertices and 1 triangles; at least 4 and 1 are needed"],
        ),
        (
            &[shown(&good), shown(&spot)],
            &["spot.obj: all 4 vertices lie in one place"],
        ),
        (
            &[shown(&lines), shown(&good)],
            &["lines.obj: no triangles; give a surface"],
        ),
        (&["nowhere.obj", shown(&good)], &["nowhere.obj"]),
        (
            &[shown(&good), shown(&good), "--overlap", "2"],
            &["expected a share from 0.05 to 1"],
        ),
        (
            &[shown(&good), shown(&good), "--clusters", "20"],
            &["--non-rigid"],
        ),
        (
            &[shown(&good), shown(&good), "--with", "affine"],
            &["rigid, similarity"],
        ),
        (
            &[shown(&good), shown(&good), "--unit", "parsec"],
            &["`parsec` is no unit of length"],
        ),
    ];
    for (arguments, expected) in cases {
        let done = run(&[&["register"], arguments, &["--out", shown(&out)]].concat());
        let message = text(&done.stderr);
        assert_eq!(done.status.code(), Some(2), "{arguments:?}: {message}");
        for part in expected {
            assert!(
                message.contains(part),
                "{arguments:?}: `{part}` is not in: {message}"
            );
        }
        assert!(
            done.stdout.is_empty() && !out.exists() && !message.contains("panicked"),
            "{arguments:?}: {message}"
        );
    }
}
