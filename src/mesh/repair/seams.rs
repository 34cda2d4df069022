//! Joins boundary loops with coincident or near vertices.

use std::collections::BTreeMap;

use nalgebra::Point3;

use super::working::Working;
use super::{RepairStep, topology};
use crate::format::counted;
use crate::mesh::measures::max_or_nan;

/// Merges each group of boundary vertices at most `within` apart into the lowest vertex; 0 merges
/// coincident vertices.
///
/// Inner vertices of a surface are skipped: where they coincide, surfaces touch and stay separate.
/// The ends of an edge of positive length also stay separate.
pub(super) fn merge(working: &mut Working, within: f64) {
    let target = targets(working, within);
    let merged: Vec<u32> = (0..target.len() as u32)
        .filter(|v| target[*v as usize] != *v)
        .collect();
    if merged.is_empty() {
        return;
    }
    let distance = |v: &u32| {
        (working.vertices[*v as usize] - working.vertices[target[*v as usize] as usize]).norm()
    };
    let moved = max_or_nan(merged.iter().map(distance));
    working.moved = max_or_nan([working.moved, moved]);
    for v in working.triangles.iter_mut().flatten() {
        *v = target[*v as usize];
    }
    for v in working.lines.iter_mut().flatten() {
        *v = target[*v as usize];
    }
    let triangles = &working.triangles;
    let whole: Vec<bool> = triangles
        .iter()
        .map(|[a, b, c]| a != b && b != c && c != a)
        .collect();
    working.retain(|t| whole[t]);
    let message = || {
        let many = counted(merged.len(), "vertex", "vertices");
        let far = if moved > 0.0 {
            format!(", moved by at most {moved:e}")
        } else {
            String::new()
        };
        let near = if moved > 0.0 {
            "near by"
        } else {
            "in the same place"
        };
        format!("merged {many} on rims with another {near}{far}")
    };
    working.note(
        RepairStep::MergedVertices,
        merged.len(),
        message,
        merged.clone(),
    );
}

/// The vertex that each vertex is merged into, which is the vertex itself if it stays.
fn targets(working: &Working, within: f64) -> Vec<u32> {
    let topology = topology(working);
    let mut on_rim: Vec<u32> = topology
        .boundary_edges()
        .iter()
        .flat_map(|e| topology.edges[*e as usize])
        .collect();
    on_rim.sort_unstable();
    on_rim.dedup();
    let points = &working.vertices;
    let mut grid = Grid {
        within,
        cells: BTreeMap::new(),
    };
    let mut target: Vec<u32> = (0..points.len() as u32).collect();
    for &v in &on_rim {
        // The grid contains only kept vertices, so no chain of merges exceeds `within`, and a cell
        // contains few vertices after any number of merges.
        let mut near = grid.near(points, v);
        near.retain(|w| {
            points[*w as usize] == points[v as usize] || topology.find_edge(v, *w).is_none()
        });
        match near.into_iter().min() {
            Some(lowest) => target[v as usize] = lowest,
            None => grid.insert(points, v),
        }
    }
    target
}

/// A greater cell number means cells smaller than the spacing of doubles.
const FINEST: f64 = 9e15;

/// Vertices in cells whose width is the merge distance.
struct Grid {
    within: f64,
    cells: BTreeMap<[i64; 3], Vec<u32>>,
}

impl Grid {
    fn cell(&self, p: &Point3<f64>) -> [i64; 3] {
        let cells = p.coords.map(|c| (c / self.within).floor());
        if cells.iter().all(|c| c.abs() < FINEST) {
            cells.map(|c| c as i64).into()
        } else {
            // Cells at the spacing of doubles, or no distance: only equal positions are near.
            // Adding 0 makes -0 into 0.
            p.coords.map(|c| (c + 0.0).to_bits() as i64).into()
        }
    }

    fn insert(&mut self, points: &[Point3<f64>], v: u32) {
        self.cells
            .entry(self.cell(&points[v as usize]))
            .or_default()
            .push(v);
    }

    fn near(&self, points: &[Point3<f64>], v: u32) -> Vec<u32> {
        let middle = self.cell(&points[v as usize]);
        let reach = if self.within > 0.0 { -1..=1 } else { 0..=0 };
        let mut found = Vec::new();
        for x in reach.clone() {
            for y in reach.clone() {
                for z in reach.clone() {
                    let cell = [
                        middle[0].saturating_add(x),
                        middle[1].saturating_add(y),
                        middle[2].saturating_add(z),
                    ];
                    found.extend(self.cells.get(&cell).into_iter().flatten());
                }
            }
        }
        found.retain(|w| (points[*w as usize] - points[v as usize]).norm() <= self.within);
        found
    }
}
