//! Real mesh files, from the folder in `PLIANT_DATA`, by default `../shared/data`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use nalgebra::Point3;
use pliant::io::Warning;
use pliant::io::obj;
use pliant::io::{Encoding, MeshFile, read, read_bytes, vtp};
use pliant::mesh::TriangleMesh;
use pliant::testing::internals::io::{ply, stl, vtk};

/// All files under folders of the data set; prints that the test is skipped if there are none.
fn data(folders: &[&str]) -> Vec<PathBuf> {
    let root = std::env::var_os("PLIANT_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"),
        PathBuf::from,
    );
    let mut files = Vec::new();
    let mut todo: Vec<PathBuf> = folders.iter().map(|folder| root.join(folder)).collect();
    while let Some(folder) = todo.pop() {
        for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
            let path = entry.path();
            if path.is_dir() {
                todo.push(path)
            } else {
                files.push(path)
            }
        }
    }
    files.sort();
    if files.is_empty() {
        println!("skipped: 1 test, because there is no {}", root.display());
    }
    files
}

fn file_name(path: &Path) -> String {
    path.file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}

/// The promise of each reader: a mesh that the mesh type accepts, and lines within it.
fn assert_valid(file: &MeshFile, path: &Path) {
    let mesh = file.mesh.clone();
    let count = mesh.vertices.len();
    assert!(
        count > 0 && mesh.triangles.len() + file.lines.len() > 0,
        "{}",
        path.display()
    );
    TriangleMesh::new(mesh.vertices, mesh.triangles)
        .unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    for line in &file.lines {
        assert!(
            line.len() >= 2 && line.iter().all(|&i| (i as usize) < count),
            "{}",
            path.display()
        );
    }
}

#[test]
fn every_file_gives_a_valid_mesh_or_one_line_of_error() {
    let mut outcomes: BTreeMap<String, [usize; 2]> = BTreeMap::new();
    for path in data(&["body", "skin", "hard", "vtk"]) {
        let extension = path
            .extension()
            .unwrap_or_default()
            .to_ascii_lowercase()
            .to_string_lossy()
            .into_owned();
        let outcome = outcomes.entry(extension).or_default();
        match read(&path) {
            Ok(file) => {
                assert_valid(&file, &path);
                outcome[0] += 1;
                file.warnings
                    .iter()
                    .for_each(|warned| println!("{}", warned.terse(&path.display().to_string())));
            }
            Err(error) => {
                let text = error.to_string();
                assert!(!text.chars().any(char::is_control), "{text:?}");
                assert!(text.starts_with(&path.display().to_string()), "{text}");
                outcome[1] += 1;
                println!("{text}");
            }
        }
    }
    println!("extension: [read, refused] {outcomes:?}");
}

#[test]
fn the_counts_of_the_body_are_those_of_the_text() {
    let paths = data(&["body", "skin"])
        .into_iter()
        .filter(|p| p.extension().is_some_and(|e| e == "obj"));
    for path in paths {
        let text = std::fs::read_to_string(&path).unwrap();
        let lines = |start: &str| text.lines().filter(|line| line.starts_with(start)).count();
        let corners = |line: &str| line.split_whitespace().count() - 1;
        let triangles: usize = text
            .lines()
            .filter(|l| l.starts_with("f "))
            .map(|l| corners(l) - 2)
            .sum();
        let file = read(&path).unwrap();
        assert_eq!(file.mesh.vertices.len(), lines("v "), "{}", path.display());
        assert_eq!(
            file.mesh.triangles.len() + file.warnings.count(Warning::RepeatedCorner),
            triangles,
            "{}",
            path.display()
        );
        assert!(triangles > 0);
    }
}

/// The triangles of a surface as positions, each starting with its smallest corner, in ascending
/// order.
///
/// Positions are rounded to 1 µm: the vertices of the sample are farther apart, and singles are within 0.1 µm.
fn as_positions(mesh: &TriangleMesh) -> Vec<[[i64; 3]; 3]> {
    let round = |p: Point3<f64>| [p.x, p.y, p.z].map(|c| (c * 1e6).round() as i64);
    let mut triangles: Vec<_> = (0..mesh.triangles.len())
        .map(|i| {
            let mut corners = mesh.corners(i).map(round);
            let first = (0..3).min_by_key(|&k| corners[k]).unwrap_or(0);
            corners.rotate_left(first);
            corners
        })
        .collect();
    triangles.sort_unstable();
    triangles
}

#[test]
fn one_mesh_in_many_encodings_is_one_surface() {
    let paths = data(&["vtk/one-mesh-many-encodings"]);
    let Some(reference) = paths.iter().find(|p| file_name(p) == "gmed.obj") else {
        return;
    };
    let reference = read(reference).unwrap().mesh;
    assert_eq!(
        (reference.vertices.len(), reference.triangles.len()),
        (327, 650)
    );
    let expected = as_positions(&reference);
    for path in &paths {
        let name = file_name(path);
        let file = read(path).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(file.mesh.vertices.len(), 327, "{name}");
        assert_eq!(as_positions(&file.mesh), expected, "{name}");
        assert!(
            file.lines.is_empty() && file.warnings.is_empty(),
            "{name}: {:?}",
            file.warnings
        );
    }
    println!("{} files are the same surface", paths.len());
    assert!(paths.len() >= 40);
}

/// A mesh with numbers that are difficult to write.
fn sample() -> (TriangleMesh, Vec<Vec<u32>>) {
    let vertices = [
        [0.1, -0.0, 5e-324],
        [1.0 / 3.0, -1e300, 0.0],
        [0.0, 1.0, 1e-7],
        [1.0, 1e16, 123.456],
    ];
    let mesh = TriangleMesh {
        vertices: vertices.map(Point3::from).to_vec(),
        triangles: vec![[0, 1, 2], [1, 3, 2]],
    };
    (mesh, vec![vec![0, 1, 3], vec![2, 0]])
}

fn bits(mesh: &TriangleMesh) -> Vec<[u64; 3]> {
    mesh.vertices
        .iter()
        .map(|v| [v.x, v.y, v.z].map(f64::to_bits))
        .collect()
}

/// The output of each writer for a mesh and lines: a name, the bytes, and the expected content.
fn written(mesh: &TriangleMesh, lines: &[Vec<u32>]) -> Vec<(&'static str, Vec<u8>, MeshFile)> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let names = [
        "a.obj", "a.vtk", "b.vtk", "a.vtp", "a.ply", "l.ply", "b.ply", "a.stl", "b.stl",
    ];
    let mut all = Vec::new();
    for name in names {
        // A separate file for each thread: tests run in parallel.
        let path = folder.join(format!("{:?}-{name}", std::thread::current().id()));
        match name {
            "a.obj" => obj::write(&path, mesh, lines),
            "a.vtk" => vtk::write(&path, mesh, lines, Encoding::Text),
            "b.vtk" => vtk::write(&path, mesh, lines, Encoding::Binary),
            "a.ply" => ply::write(&path, mesh, lines, Encoding::Text),
            "l.ply" => ply::write(&path, mesh, lines, Encoding::Binary),
            "b.ply" => ply::write_ply(&path, mesh, lines, ply::PlyEncoding::Big),
            "a.stl" => stl::write(&path, mesh, Encoding::Text),
            "b.stl" => stl::write(&path, mesh, Encoding::Binary),
            _ => {
                let (points, triangles) = (&mesh.vertices, &mesh.triangles);
                vtp::write(
                    &path,
                    &vtp::PolyData {
                        points,
                        triangles,
                        lines,
                        ..Default::default()
                    },
                )
            }
        }
        .unwrap_or_else(|e| panic!("{name}: {e}"));
        let bytes = std::fs::read(&path).unwrap();
        let file = read_bytes(&bytes, name).unwrap_or_else(|e| panic!("{e}"));
        all.push((name, bytes, file));
    }
    all
}

#[test]
fn what_is_written_is_read_with_the_same_bits() {
    let (mut mesh, lines) = sample();
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("too-large.stl");
    let error = stl::write(&path, &mesh, Encoding::Binary)
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("vertex 1 has a coordinate that is too large for binary STL"),
        "{error}"
    );
    mesh.vertices[1].y = -1e30;
    for (name, _, file) in written(&mesh, &lines) {
        assert_eq!(file.mesh.triangles, mesh.triangles, "{name}");
        match name {
            "b.stl" => {
                let near = file.mesh.vertices.iter().zip(&mesh.vertices);
                assert!(
                    near.into_iter()
                        .all(|(a, b)| (0..3).all(|k| a[k] == f64::from(b[k] as f32))),
                    "{name}"
                );
            }
            "a.stl" => assert_eq!(file.mesh.vertices, mesh.vertices, "{name}"),
            _ => assert_eq!(bits(&file.mesh), bits(&mesh), "{name}"),
        }
        match name.rsplit('.').next() {
            Some("stl") => assert!(file.lines.is_empty(), "{name}"),
            Some("ply") => assert_eq!(file.lines, [[0, 1], [1, 3], [2, 0]], "{name}"),
            _ => assert_eq!(file.lines, lines, "{name}"),
        }
    }
    mesh.vertices[0].z = f64::NAN;
    assert!(
        obj::write(&path, &mesh, &[]).is_err()
            && ply::write(&path, &mesh, &[], Encoding::Text).is_err()
    );
    assert!(stl::write(&path, &mesh, Encoding::Text).is_err() && !path.exists());
}

/// Small files of all formats; those without a writer are given as text.
fn small_files() -> Vec<(&'static str, Vec<u8>)> {
    let (mut mesh, lines) = sample();
    mesh.vertices[1].y = 0.5;
    let mut all: Vec<_> = written(&mesh, &lines)
        .into_iter()
        .map(|(name, bytes, _)| (name, bytes))
        .collect();
    let points = "0 0 0\n1 0 0\n0 1 0\n";
    let texts = [
        ("a.off", format!("COFF # colours\n3 1 0\n{points}3 0 1 2 255 0 0\n")),
        (
            "a.x",
            "xof 0302txt 0064\nFrame f { FrameTransformMatrix { 1,0,0,0, 0,1,0,0, 0,0,1,0, 2,0,0,1;; }\n\
            Mesh { 3; 0;0;0;, 1;0;0;, 0;1;0;; 1; 3;0,1,2;; } }\n"
                .to_owned(),
        ),
        (
            "g.vtk",
            format!(
                "# vtk DataFile Version 5.1\nt\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 3 float\n{points}\
            CELLS 2 3\nOFFSETS vtktypeint64\n0 3\nCONNECTIVITY vtktypeint64\n0 1 2\nCELL_TYPES 1\n5\n"
            ),
        ),
        (
            "t.vtp",
            format!(
                "<VTKFile type=\"PolyData\" header_type=\"UInt64\"><PolyData><Piece NumberOfPoints=\"3\" NumberOfPolys=\"1\">\
            <Points><DataArray type=\"Float32\" NumberOfComponents=\"3\">{points}</DataArray></Points><Polys>\
            <DataArray type=\"UInt8\" Name=\"connectivity\" format=\"binary\">AwAAAAAAAAAAAQI=</DataArray>\
            <DataArray type=\"Int32\" Name=\"offsets\" format=\"ascii\">3</DataArray></Polys></Piece></PolyData></VTKFile>"
            ),
        ),
    ];
    all.extend(texts.map(|(name, text)| (name, text.into_bytes())));
    all
}

#[test]
fn every_prefix_and_every_flipped_bit_gives_a_mesh_or_an_error() {
    let (mut meshes, mut errors) = (0, 0);
    let mut check = |bytes: &[u8], name: &str| match read_bytes(bytes, name) {
        Ok(file) => {
            assert_valid(&file, Path::new(name));
            meshes += 1;
        }
        Err(error) => {
            let text = error.terse();
            assert!(
                text.contains("error[E") && !text.chars().any(char::is_control),
                "{text:?}"
            );
            errors += 1;
        }
    };
    let encoded = data(&["vtk/one-mesh-many-encodings"])
        .into_iter()
        .filter(|p| p.extension().is_some_and(|e| e == "vtp"));
    for (name, bytes) in small_files() {
        assert!(read_bytes(&bytes, name).is_ok(), "{name}");
        (0..bytes.len()).for_each(|length| check(&bytes[..length], name));
        let mut changed = bytes.clone();
        for bit in 0..8 * bytes.len().min(1500) {
            changed[bit / 8] ^= 1 << (bit % 8);
            check(&changed, name);
            changed[bit / 8] ^= 1 << (bit % 8);
        }
    }
    // Compressed arrays are too large to flip every bit: some bits in each file, most of them in
    // untrusted data.
    let mut changes = Changes(20_261_122);
    for path in encoded {
        let bytes = std::fs::read(&path).unwrap();
        for _ in 0..60 {
            let (at, bit) = (changes.below(bytes.len()), changes.below(8));
            let mut changed = bytes.clone();
            changed[at] ^= 1 << bit;
            check(&changed, "a.vtp");
            check(&bytes[..at], "a.vtp");
        }
    }
    println!("{meshes} meshes, {errors} errors");
    assert!(meshes > 100 && errors > 1000);
}

/// A generator of reproducible changes (a linear congruence with the constants of Knuth's MMIX).
struct Changes(u64);

impl Changes {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % n.max(1)
    }
}

#[test]
fn changed_files_never_panic() {
    let seed = 20_261_121;
    println!("seed {seed}");
    let mut changes = Changes(seed);
    let small = data(&["hard", "vtk"]).into_iter().filter_map(|path| {
        let bytes = std::fs::read(&path).ok()?;
        (!bytes.is_empty() && bytes.len() < 20_000).then_some((path, bytes))
    });
    for (path, bytes) in small {
        for _ in 0..40 {
            let mut changed = bytes.clone();
            for _ in 0..=changes.below(4) {
                let at = changes.below(changed.len());
                match changes.below(5) {
                    0 => changed[at] = changes.below(256) as u8,
                    1 => changed[at] ^= 1 << changes.below(8),
                    2 => changed.truncate(at + 1),
                    3 => changed[at] = b"0123456789-.e \n"[changes.below(15)],
                    _ => {
                        let end = (at + 8).min(changed.len());
                        let source = changes.below(changed.len() - (end - at) + 1);
                        changed.copy_within(source..source + (end - at), at);
                    }
                }
            }
            if let Ok(file) = read_bytes(&changed, &file_name(&path)) {
                assert_valid(&file, &path);
            }
        }
    }
}
