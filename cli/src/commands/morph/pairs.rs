//! The file of pairs: corresponding vertices of two surfaces.

use std::collections::HashMap;
use std::path::Path;

use nalgebra::Point3;

use super::super::failure::Failure;
use pliant::mesh::TriangleMesh;

/// Reads lines `VERTEX VERTEX` or `X Y Z X Y Z`, the latter in the unit of the files; `scale`
/// converts it to that of the meshes.
pub(super) fn read(
    file: &Path,
    meshes: [&TriangleMesh; 2],
    paths: [&Path; 2],
    scale: f64,
) -> Result<Vec<[u32; 2]>, Failure> {
    let shown = file.display();
    let text = std::fs::read_to_string(file).map_err(|error| {
        Failure::usage(
            format!("cannot read `{shown}`: {error}"),
            "give a text file with a pair of vertices a line",
        )
    })?;
    let mut pairs: Vec<[u32; 2]> = Vec::new();
    let mut lines: [HashMap<u32, usize>; 2] = Default::default();
    for (number, line) in text.lines().enumerate().map(|(i, line)| (i + 1, line)) {
        let line = line.split('#').next().unwrap_or("").trim();
        if line.is_empty() {
            continue;
        }
        let wrong =
            |what: String, hint: &str| Failure::usage(format!("{shown}:{number}: {what}"), hint);
        let pair = pair(line, meshes, scale).ok_or_else(|| {
            wrong(
                format!("`{line}` is no pair"),
                "give two vertices, counted from 0, or six coordinates",
            )
        })?;
        for side in 0..2 {
            let count = meshes[side].vertices.len();
            let found = u32::try_from(pair[side])
                .ok()
                .filter(|v| (*v as usize) < count);
            let Some(vertex) = found else {
                let what = format!(
                    "there is no vertex {} in {}",
                    pair[side],
                    paths[side].display()
                );
                return Err(wrong(
                    what,
                    &format!("it has {count}, from 0 to {}", count - 1),
                ));
            };
            if let Some(first) = lines[side].insert(vertex, number) {
                let what = format!(
                    "vertex {vertex} of {} is in line {first} already",
                    paths[side].display()
                );
                return Err(wrong(
                    what,
                    "each vertex meets one other: drop one of the lines",
                ));
            }
        }
        pairs.push(pair.map(|v| v as u32));
    }
    if pairs.is_empty() {
        return Err(Failure::usage(
            format!("{shown}: no pairs"),
            "give a line for each, or leave --pairs out",
        ));
    }
    Ok(pairs)
}

/// Two vertices, with numbers that can be too large.
fn pair(line: &str, meshes: [&TriangleMesh; 2], scale: f64) -> Option<[u64; 2]> {
    let words: Vec<&str> = line
        .split([' ', '\t', ',', ';'])
        .filter(|w| !w.is_empty())
        .collect();
    match words[..] {
        [a, b] => Some([a.parse().ok()?, b.parse().ok()?]),
        [_, _, _, _, _, _] => {
            let numbers: Option<Vec<f64>> = words
                .iter()
                .map(|w| w.parse().ok().filter(|n: &f64| n.is_finite()))
                .collect();
            let numbers = numbers?;
            let at = |k: usize| Point3::new(numbers[k], numbers[k + 1], numbers[k + 2]) * scale;
            Some([nearest(meshes[0], &at(0))?, nearest(meshes[1], &at(3))?])
        }
        _ => None,
    }
}

fn nearest(mesh: &TriangleMesh, to: &Point3<f64>) -> Option<u64> {
    let square = |p: &Point3<f64>| (p - to).norm_squared();
    let all = mesh.vertices.iter().enumerate();
    all.min_by(|(_, p), (_, q)| square(p).total_cmp(&square(q)))
        .map(|(v, _)| v as u64)
}
