//! Real mesh files, from the folder named by `PLIANT_DATA` or else from `../shared/data`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use nalgebra::Point3;
use pliant::io::{MeshFile, read, read_bytes};
use pliant::mesh::TriangleMesh;

/// All files under folders of the data set; says that the test is skipped where there are none.
fn data(folders: &[&str]) -> Vec<PathBuf> {
    let root = std::env::var_os("PLIANT_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"), PathBuf::from);
    let mut files = Vec::new();
    let mut todo: Vec<PathBuf> = folders.iter().map(|folder| root.join(folder)).collect();
    while let Some(folder) = todo.pop() {
        for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
            let path = entry.path();
            if path.is_dir() { todo.push(path) } else { files.push(path) }
        }
    }
    files.sort();
    if files.is_empty() {
        println!("skipped: 1 test, because there is no {}", root.display());
    }
    files
}

fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// What each reader promises: a mesh that the mesh type accepts, and lines within it.
fn assert_valid(file: &MeshFile, path: &Path) {
    let mesh = file.mesh.clone();
    let count = mesh.vertices.len();
    assert!(count > 0 && mesh.triangles.len() + file.lines.len() > 0, "{}", path.display());
    TriangleMesh::new(mesh.vertices, mesh.triangles).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    for line in &file.lines {
        assert!(line.len() >= 2 && line.iter().all(|&i| (i as usize) < count), "{}", path.display());
    }
}

#[test]
fn every_file_gives_a_valid_mesh_or_one_line_of_error() {
    let mut outcomes: BTreeMap<String, [usize; 2]> = BTreeMap::new();
    for path in data(&["body", "skin", "hard", "vtk"]) {
        let extension = path.extension().unwrap_or_default().to_ascii_lowercase().to_string_lossy().into_owned();
        let outcome = outcomes.entry(extension).or_default();
        match read(&path) {
            Ok(file) => {
                assert_valid(&file, &path);
                outcome[0] += 1;
                if file.degenerate > 0 {
                    println!("{}: {} degenerate triangles left out", path.display(), file.degenerate);
                }
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
    let paths = data(&["body", "skin"]).into_iter().filter(|p| p.extension().is_some_and(|e| e == "obj"));
    for path in paths {
        let text = std::fs::read_to_string(&path).unwrap();
        let lines = |start: &str| text.lines().filter(|line| line.starts_with(start)).count();
        let corners = |line: &str| line.split_whitespace().count() - 1;
        let triangles: usize = text.lines().filter(|l| l.starts_with("f ")).map(|l| corners(l) - 2).sum();
        let file = read(&path).unwrap();
        assert_eq!(file.mesh.vertices.len(), lines("v "), "{}", path.display());
        assert_eq!(file.mesh.triangles.len() + file.degenerate, triangles, "{}", path.display());
        assert!(triangles > 0);
    }
}

/// The triangles of a surface as positions, each turned to begin with its smallest corner, in ascending order.
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
    let Some(reference) = paths.iter().find(|p| file_name(p) == "gmed.obj") else { return };
    let reference = read(reference).unwrap().mesh;
    assert_eq!((reference.vertices.len(), reference.triangles.len()), (327, 650));
    let expected = as_positions(&reference);
    let mut same = 0;
    for path in &paths {
        let name = file_name(path);
        match read(path) {
            Ok(file) => {
                assert_eq!(file.mesh.vertices.len(), 327, "{name}");
                assert_eq!(as_positions(&file.mesh), expected, "{name}");
                assert_eq!((file.lines.len(), file.degenerate), (0, 0), "{name}");
                same += 1;
            }
            Err(error) => {
                let text = error.to_string();
                let not_yet = name.ends_with(".vtp") || name.ends_with(".off");
                assert!(
                    if not_yet {
                        text.contains("format not supported yet")
                    } else {
                        text.contains("expected POLYDATA")
                    },
                    "{text}"
                );
            }
        }
    }
    println!("{same} of {} files are the same surface, the others are of formats not read yet", paths.len());
    assert!(same >= 16);
}

/// A generator of reproducible changes (a linear congruence with the constants of Knuth's MMIX).
struct Changes(u64);

impl Changes {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
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
