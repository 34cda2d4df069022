//! Files of VTK as read by VTK itself, compared with our reader: points, triangles, lines.
//!
//! The interpreter is `python3`, or that of `PLIANT_PYTHON`; without PyPI's `vtk` or the measured
//! data the test is skipped.

use std::path::{Path, PathBuf};
use std::process::Command;

use pliant::io::Warning;
use pliant::io::{MeshFile, read};
use serde_json::Value;

/// True if a rejection of a file that VTK reads is right: a cell that fills a volume, or no surface
/// and no line.
fn rightly_refused(theirs: &Value, code: &str) -> bool {
    let empty = ["polys", "strips", "lines"]
        .iter()
        .all(|name| theirs[name].as_array().is_some_and(Vec::is_empty));
    let volumes = theirs["volumes"].as_u64() > Some(0);
    code == "E042" && volumes || ["E002", "E046"].contains(&code) && empty && !volumes
}

fn python() -> String {
    std::env::var("PLIANT_PYTHON").unwrap_or_else(|_| "python3".into())
}

/// The VTK files among the measured data.
fn files() -> Vec<PathBuf> {
    let root = std::env::var_os("PLIANT_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"),
        PathBuf::from,
    );
    let folders = ["vtk/collected", "vtk/one-mesh-many-encodings"].map(|folder| root.join(folder));
    let entries = folders
        .iter()
        .flat_map(|folder| std::fs::read_dir(folder).into_iter().flatten().flatten());
    let is_vtk = |path: &PathBuf| path.extension().is_some_and(|e| e == "vtk" || e == "vtp");
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.path()).filter(is_vtk).collect();
    files.sort();
    files
}

/// The content read by VTK, one value per file; `None` without VTK.
fn oracle(files: &[PathBuf]) -> Option<Vec<Value>> {
    let has_vtk = Command::new(python())
        .args(["-c", "import vtk"])
        .output()
        .is_ok_and(|o| o.status.success());
    if !has_vtk {
        return None;
    }
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/oracle/read_vtk.py");
    let output = Command::new(python())
        .arg(script)
        .args(files)
        .output()
        .expect("python runs");
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let text = String::from_utf8(output.stdout).expect("JSON");
    Some(
        text.lines()
            .map(|line| serde_json::from_str(line).expect("JSON"))
            .collect(),
    )
}

fn cells(value: &Value, name: &str) -> Vec<Vec<u32>> {
    let cells = value[name].as_array().expect("cells").iter();
    cells
        .map(|cell| {
            cell.as_array()
                .expect("a cell")
                .iter()
                .map(|i| i.as_u64().expect("an index") as u32)
                .collect()
        })
        .collect()
}

/// The triangles of VTK's cells by the rules of `docs/formats.md`, in ascending order, and the
/// number of those left out.
fn triangles(value: &Value) -> (Vec<[u32; 3]>, usize) {
    let fan = |c: &Vec<u32>| {
        (2..c.len())
            .map(|k| [c[0], c[k - 1], c[k]])
            .collect::<Vec<_>>()
    };
    let strip = |c: &Vec<u32>| {
        let turned = |k: usize| {
            if k.is_multiple_of(2) {
                [c[k], c[k + 1], c[k + 2]]
            } else {
                [c[k + 1], c[k], c[k + 2]]
            }
        };
        (0..c.len().saturating_sub(2))
            .map(turned)
            .collect::<Vec<_>>()
    };
    let (polys, strips) = (cells(value, "polys"), cells(value, "strips"));
    let all: Vec<[u32; 3]> = polys
        .iter()
        .flat_map(fan)
        .chain(strips.iter().flat_map(strip))
        .collect();
    let mut kept: Vec<_> = all
        .iter()
        .copied()
        .filter(|[a, b, c]| a != b && b != c && c != a)
        .collect();
    kept.sort_unstable();
    let left_out = all.len() - kept.len();
    (kept, left_out)
}

fn points(value: &Value) -> Vec<f64> {
    let text = value["points"].as_str().expect("hexadecimal");
    let byte = |k: usize| u8::from_str_radix(&text[2 * k..2 * k + 2], 16).expect("hexadecimal");
    (0..text.len() / 16)
        .map(|i| f64::from_le_bytes(std::array::from_fn(|k| byte(8 * i + k))))
        .collect()
}

/// The differences between VTK's reading and ours.
fn differences(theirs: &Value, ours: &MeshFile) -> Vec<String> {
    let mut found = Vec::new();
    // VTK stores the points of most files as singles, for any number of digits in a text.
    let held = |c: &f64| {
        if theirs["single"] == true {
            f64::from(*c as f32)
        } else {
            *c
        }
    };
    let numbers = ours
        .mesh
        .vertices
        .iter()
        .flat_map(|v| v.iter())
        .map(held)
        .map(f64::to_bits);
    let expected = points(theirs);
    if !numbers.clone().eq(expected.iter().map(|c| c.to_bits())) {
        let differing = numbers
            .zip(&expected)
            .filter(|(a, b)| *a != b.to_bits())
            .count();
        found.push(format!(
            "{} points against {}, {differing} numbers differ",
            ours.mesh.vertices.len(),
            expected.len() / 3
        ));
    }
    let mut mesh = ours.mesh.triangles.clone();
    mesh.sort_unstable();
    let (expected, left_out) = triangles(theirs);
    if mesh != expected || ours.warnings.count(Warning::RepeatedCorner) != left_out {
        found.push(format!(
            "{} triangles against {}",
            mesh.len(),
            expected.len()
        ));
    }
    // VTK's own triangulation of a polygon can leave out triangles without area; otherwise it has
    // as many as a fan.
    if let Some(count) = theirs["triangles"]
        .as_u64()
        .filter(|&count| count != (mesh.len() + left_out) as u64)
    {
        found.push(format!(
            "{} triangles, {count} by vtkTriangleFilter",
            mesh.len() + left_out
        ));
    }
    let (mut lines, mut expected) = (ours.lines.clone(), cells(theirs, "lines"));
    lines.sort();
    expected.sort();
    if lines != expected {
        found.push(format!("{} lines against {}", lines.len(), expected.len()));
    }
    found
}

#[test]
fn vtk_reads_the_same() {
    let files = files();
    if files.is_empty() {
        println!("skipped: 1 test, because the measured data are absent");
        return;
    }
    let Some(theirs) = oracle(&files) else {
        println!(
            "skipped: {} files, because {} has no vtk",
            files.len(),
            python()
        );
        return;
    };
    assert_eq!(theirs.len(), files.len());
    let (mut same, mut refused, mut by_both, mut different) = (0, 0, 0, Vec::new());
    for (path, theirs) in files.iter().zip(&theirs) {
        let name = path
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        match (theirs["error"].as_str(), read(path)) {
            (None, Ok(ours)) => {
                let found = differences(theirs, &ours);
                same += usize::from(found.is_empty());
                different.extend(found.into_iter().map(|what| format!("{name}: {what}")));
            }
            (None, Err(error)) if rightly_refused(theirs, error.code()) => {
                println!("{}", error.terse());
                refused += 1;
            }
            (None, Err(error)) => {
                different.push(format!("{name}: VTK reads it, we say {}", error.terse()))
            }
            (Some(what), Ok(_)) => different.push(format!("{name}: we read it, VTK: {what}")),
            (Some(what), Err(error)) => {
                println!("{name}: {what}; {}", error.terse());
                by_both += 1;
            }
        }
    }
    println!(
        "{same} files are the same, {refused} are refused by us alone for what they hold, {by_both} by both"
    );
    assert!(different.is_empty(), "{}", different.join("\n"));
    assert!(same > 40, "only {same} files were compared");
}

#[test]
fn control_a_difference_is_seen() {
    let numbers = [0.0f64, 0.5, -0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let points: String = numbers
        .iter()
        .flat_map(|c| c.to_le_bytes())
        .map(|b| format!("{b:02x}"))
        .collect();
    let theirs: Value = serde_json::json!({
        "points": points, "single": false, "polys": [[0, 1, 2], [0, 1, 1]], "strips": [], "lines": [[0, 1]], "triangles": 2
    });
    let text = "v 0 0.5 -0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 2 2\nl 1 2\n";
    let differ = |text: &str| {
        differences(
            &theirs,
            &pliant::io::read_bytes(text.as_bytes(), "a.obj").expect("a mesh"),
        )
    };
    assert_eq!(differ(text), Vec::<String>::new());
    assert!(!rightly_refused(&theirs, "E042") && !rightly_refused(&theirs, "E046"));
    for (from, to) in [
        ("-0", "0"),
        ("f 1 2 3", "f 2 1 3"),
        ("f 1 2 2\n", ""),
        ("l 1 2", "l 2 1"),
    ] {
        assert!(!differ(&text.replace(from, to)).is_empty(), "{from}");
    }
}
