//! Public queries of continuous collision detection with their truth, in `ccd` below the folder of
//! measured data.

use std::path::{Path, PathBuf};

use nalgebra::Point3;
use pliant::contact::Parts;

use super::Corners;

/// A query: corners at the start and the end of a step, and whether the parts meet.
pub struct Query {
    pub parts: Parts,
    pub start: Corners,
    pub end: Corners,
    pub meets: bool,
}

/// A fraction that is a double.
fn fraction(above: &str, below: &str) -> f64 {
    let [above, below] = [above, below].map(|text| {
        let number: f64 = text.parse().expect("a whole number");
        assert_eq!(
            format!("{number:.0}").trim_start_matches("-0"),
            text.trim_start_matches("-0")
        );
        number
    });
    // Divisions by powers of two have no rounding.
    assert_eq!(below, 2_f64.powi(below.log2().round() as i32));
    above / below
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let mut found: Vec<PathBuf> = std::fs::read_dir(folder)
        .into_iter()
        .flatten()
        .filter_map(|entry| Some(entry.ok()?.path()))
        .collect();
    found.sort();
    found
}

/// All queries; `None` without the data.
pub fn load() -> Option<Vec<Query>> {
    let folder = Path::new(&crate::measured_data("PLIANT_DATA")?).join("ccd");
    let scenes = files(&folder);
    let mut queries = Vec::new();
    for (name, parts) in [
        ("vertex-face", Parts::VertexTriangle),
        ("edge-edge", Parts::EdgeEdge),
    ] {
        for file in scenes.iter().flat_map(|scene| files(&scene.join(name))) {
            let text = std::fs::read_to_string(&file).expect("queries");
            let rows: Vec<(Point3<f64>, bool)> = text.lines().map(row).collect();
            for query in rows.chunks_exact(8) {
                queries.push(Query {
                    parts,
                    start: std::array::from_fn(|k| query[k].0),
                    end: std::array::from_fn(|k| query[k + 4].0),
                    meets: query[0].1,
                });
            }
        }
    }
    (!queries.is_empty()).then_some(queries)
}

fn row(line: &str) -> (Point3<f64>, bool) {
    let columns: Vec<&str> = line.trim().split(',').collect();
    let at = |k: usize| fraction(columns[2 * k], columns[2 * k + 1]);
    (Point3::new(at(0), at(1), at(2)), columns[6] == "1")
}
