//! The mesh under repair, with the origin of its parts.

use nalgebra::Point3;

use super::{RepairChange, RepairStep, Repaired};
use crate::format::counted;
use crate::mesh::TriangleMesh;
use crate::mesh::coincident::{first_in_place, same_corners};
use crate::mesh::measures::{max_or_nan, triangle_areas};
use crate::mesh::topology::Topology;

/// Vertices, triangles and lines, each with its original index.
#[derive(Clone)]
pub(super) struct Working {
    pub vertices: Vec<Point3<f64>>,
    pub triangles: Vec<[u32; 3]>,
    pub lines: Vec<Vec<u32>>,
    /// The original vertex of each vertex or copy.
    pub vertex_origin: Vec<u32>,
    /// The original triangle of each triangle; `None` for one that closes a hole.
    pub triangle_origin: Vec<Option<u32>>,
    pub changes: Vec<RepairChange>,
    /// Greatest displacement of a vertex.
    pub moved: f64,
}

impl Working {
    pub fn new(mesh: &TriangleMesh, lines: &[Vec<u32>]) -> Self {
        Self {
            vertices: mesh.vertices.clone(),
            triangles: mesh.triangles.clone(),
            lines: lines.to_vec(),
            vertex_origin: (0..mesh.vertices.len() as u32).collect(),
            triangle_origin: (0..mesh.triangles.len() as u32).map(Some).collect(),
            changes: Vec::new(),
            moved: 0.0,
        }
    }

    /// Records a change if it affects any element.
    pub fn note(
        &mut self,
        step: RepairStep,
        count: usize,
        message: impl FnOnce() -> String,
        mut elements: Vec<u32>,
    ) {
        if count > 0 {
            elements.sort_unstable();
            elements.dedup();
            self.changes.push(RepairChange {
                step,
                count,
                message: message(),
                elements,
            });
        }
    }

    /// The corners of a triangle.
    pub fn corners(&self, t: usize) -> [Point3<f64>; 3] {
        self.triangles[t].map(|v| self.vertices[v as usize])
    }

    /// Keeps the triangles for which `keep` holds. Returns the original indices of the others.
    pub fn retain(&mut self, keep: impl Fn(usize) -> bool) -> Vec<u32> {
        let mut dropped = Vec::new();
        let mut next = 0;
        for t in 0..self.triangles.len() {
            if keep(t) {
                self.triangles[next] = self.triangles[t];
                self.triangle_origin[next] = self.triangle_origin[t];
                next += 1;
            } else {
                dropped.extend(self.triangle_origin[t]);
            }
        }
        self.triangles.truncate(next);
        self.triangle_origin.truncate(next);
        dropped
    }

    /// Keeps one of several triangles with the same corners, in the orientation of the majority;
    /// keeps none if both orientations are equally frequent, since they enclose nothing. In either
    /// case every edge has the same number of triangles, modulo 2, as the surface without
    /// duplicates. A loose triangle at the place of another one is dropped too.
    pub fn drop_duplicates(&mut self) {
        let mut keep = vec![true; self.triangles.len()];
        let first = first_in_place(&self.vertices);
        let placed: Vec<[u32; 3]> = self
            .triangles
            .iter()
            .map(|t| t.map(|v| first[v as usize]))
            .collect();
        let topology = Topology::of_triangles(self.vertices.len(), &self.triangles);
        for group in same_corners(&placed) {
            // One triangle must stay: the first if all are loose.
            let kept = group
                .iter()
                .find(|t| !is_loose(&topology, **t))
                .unwrap_or(&group[0]);
            group
                .iter()
                .filter(|t| *t != kept && is_loose(&topology, **t))
                .for_each(|t| keep[*t as usize] = false);
        }
        for group in same_corners(&self.triangles) {
            let turn = |t: &u32| is_even(self.triangles[*t as usize]);
            let even = group.iter().filter(|t| turn(t)).count();
            let odd = group.len() - even;
            let kept = if even == odd {
                None
            } else {
                group.iter().find(|t| turn(t) == (even > odd))
            };
            group
                .iter()
                .filter(|t| Some(*t) != kept)
                .for_each(|t| keep[*t as usize] = false);
        }
        let dropped = self.retain(|t| keep[t]);
        let message = || {
            format!(
                "dropped {} with the same corners as another",
                counted(dropped.len(), "triangle", "triangles")
            )
        };
        self.note(
            RepairStep::DroppedDuplicateTriangles,
            dropped.len(),
            message,
            dropped.clone(),
        );
    }

    /// Removes all components except the one with the greatest area.
    pub fn keep_largest(&mut self) {
        let components = Topology::of_triangles(self.vertices.len(), &self.triangles).components();
        if components.count < 2 {
            return;
        }
        let label = |t: usize| components.labels[self.triangles[t][0] as usize] as usize;
        let mut areas = vec![0.0; components.count];
        let each = triangle_areas(&self.vertices, &self.triangles);
        each.iter()
            .enumerate()
            .for_each(|(t, area)| areas[label(t)] += area);
        let most = max_or_nan(areas.iter().copied());
        let largest = areas.iter().position(|a| *a == most).unwrap_or(0);
        let keep: Vec<bool> = (0..self.triangles.len())
            .map(|t| label(t) == largest)
            .collect();
        let share = 100.0 * (1.0 - most / areas.iter().sum::<f64>());
        let dropped = self.retain(|t| keep[t]);
        let pieces = counted(components.count - 1, "piece", "pieces");
        let message = || {
            let triangles = counted(dropped.len(), "triangle", "triangles");
            let area = if share.is_finite() {
                format!(", {share:.2} % of the area")
            } else {
                String::new()
            };
            format!("dropped {pieces} of {triangles}{area}")
        };
        self.note(
            RepairStep::DroppedPieces,
            dropped.len(),
            message,
            dropped.clone(),
        );
    }

    /// Drops vertices without a triangle or line. Returns the result.
    pub fn finish(mut self) -> Repaired {
        let mut used = vec![false; self.vertices.len()];
        let named = self
            .triangles
            .iter()
            .flatten()
            .chain(self.lines.iter().flatten());
        named.for_each(|v| used[*v as usize] = true);
        let mut index = vec![0u32; used.len()];
        let mut vertices = Vec::with_capacity(used.len());
        let mut dropped = Vec::new();
        for (v, used) in used.iter().enumerate() {
            index[v] = vertices.len() as u32;
            if *used {
                vertices.push(self.vertices[v])
            } else {
                dropped.push(self.vertex_origin[v])
            }
        }
        // A vertex with a surviving copy is not dropped.
        let mut lives = vec![false; used.len()];
        used.iter()
            .zip(&self.vertex_origin)
            .filter(|(used, _)| **used)
            .for_each(|(_, v)| lives[*v as usize] = true);
        dropped.retain(|v| !lives[*v as usize]);
        let renumber = |v: &mut u32| *v = index[*v as usize];
        self.triangles.iter_mut().flatten().for_each(renumber);
        self.lines.iter_mut().flatten().for_each(renumber);
        let message = || {
            format!(
                "dropped {} that nothing names",
                counted(dropped.len(), "vertex", "vertices")
            )
        };
        self.note(
            RepairStep::DroppedVertices,
            dropped.len(),
            message,
            dropped.clone(),
        );
        let mesh = TriangleMesh {
            vertices,
            triangles: self.triangles,
        };
        Repaired {
            mesh,
            lines: self.lines,
            changes: self.changes,
            moved: self.moved,
        }
    }
}

/// True if a triangle shares no edge.
fn is_loose(topology: &Topology, t: u32) -> bool {
    topology.triangle_edges[t as usize]
        .iter()
        .all(|e| topology.triangles_of_edge(*e as usize).len() == 1)
}

/// True if three corners are an even permutation of their ascending order.
fn is_even([a, b, c]: [u32; 3]) -> bool {
    (a < b) ^ (b < c) ^ (a < c)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_of_corners() {
        for t in [[1, 2, 3], [2, 3, 1], [3, 1, 2]] {
            assert!(is_even(t) && !is_even([t[1], t[0], t[2]]), "{t:?}");
        }
    }

    #[test]
    fn of_duplicates_the_majority_stays() {
        let vertices = [
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, 0.0, 1.0],
        ]
        .map(Point3::from)
        .to_vec();
        let triangles = vec![[0, 1, 2], [1, 0, 2], [2, 0, 1], [0, 1, 3], [0, 3, 1]];
        let mut working = Working::new(
            &TriangleMesh {
                vertices,
                triangles,
            },
            &[],
        );
        working.drop_duplicates();
        assert_eq!(working.triangles, [[0, 1, 2]]);
        assert_eq!(working.changes[0].elements, [1, 2, 3, 4]);
        let repaired = working.finish();
        assert_eq!(
            (
                repaired.mesh.vertices.len(),
                repaired.changes[1].elements.as_slice()
            ),
            (3, &[3][..])
        );
    }
}
