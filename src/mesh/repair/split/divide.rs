//! Separates surfaces along an edge whose ends they share further on, so that copies of the ends
//! cannot separate them.

use crate::mesh::repair::topology;
use crate::mesh::repair::working::Working;

/// Gives each group of triangles at an edge except the first its own midpoint, if the edge still
/// has more than two triangles. `edges` and `groups` are those before vertices were copied. Returns
/// for each new vertex an end of its edge, by its original index.
pub(super) fn divide(
    working: &mut Working,
    edges: &[[u32; 2]],
    groups: &[Vec<Vec<u32>>],
) -> Vec<u32> {
    let topology = topology(working);
    let crowded: Vec<[u32; 2]> = topology
        .non_manifold_edges()
        .iter()
        .map(|e| topology.edges[*e as usize])
        .collect();
    let mut new = Vec::new();
    if crowded.is_empty() {
        return new;
    }
    // The parts of each triangle, starting with the triangle itself.
    let mut parts: Vec<Vec<u32>> = (0..working.triangles.len() as u32)
        .map(|t| vec![t])
        .collect();
    for (edge, groups) in edges.iter().zip(groups) {
        let origins = edge.map(|v| working.vertex_origin[v as usize]);
        for group in &groups[1..] {
            let mut middle = None;
            for &whole in group {
                let Some((part, [a, b])) =
                    working.side_of(&parts[whole as usize], origins, &crowded)
                else {
                    continue;
                };
                let middle = *middle.get_or_insert_with(|| working.middle_of([a, b]));
                let half = working.halve(part, [a, b], middle);
                parts[whole as usize].push(half);
            }
            new.extend(middle.map(|m| working.vertex_origin[m as usize]));
        }
    }
    new
}

impl Working {
    /// The part of a triangle that has a copy of an edge among the `crowded` ones, and that copy.
    /// The edge is given by the origins of its ends.
    fn side_of(
        &self,
        parts: &[u32],
        origins: [u32; 2],
        crowded: &[[u32; 2]],
    ) -> Option<(u32, [u32; 2])> {
        let side = |t: u32, k: usize| {
            let corners = self.triangles[t as usize];
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            [a.min(b), a.max(b)]
        };
        let matches = |[a, b]: [u32; 2]| {
            let of = [a, b].map(|v| self.vertex_origin[v as usize]);
            of == origins || of == [origins[1], origins[0]]
        };
        let all = parts.iter().flat_map(|t| (0..3).map(|k| (*t, side(*t, k))));
        all.into_iter()
            .find(|(_, side)| matches(*side) && crowded.binary_search(side).is_ok())
    }

    /// A new vertex at the midpoint of an edge.
    fn middle_of(&mut self, [a, b]: [u32; 2]) -> u32 {
        let (p, q) = (self.vertices[a as usize], self.vertices[b as usize]);
        // Halved first: the sum of the largest doubles is infinite.
        self.vertices.push((p.coords * 0.5 + q.coords * 0.5).into());
        self.vertex_origin.push(self.vertex_origin[a as usize]);
        self.vertices.len() as u32 - 1
    }

    /// Divides a triangle at the vertex `middle` of a side. Returns the new half.
    fn halve(&mut self, t: u32, [a, b]: [u32; 2], middle: u32) -> u32 {
        let whole = self.triangles[t as usize];
        self.triangles[t as usize] = whole.map(|v| if v == b { middle } else { v });
        self.triangles
            .push(whole.map(|v| if v == a { middle } else { v }));
        self.triangle_origin.push(self.triangle_origin[t as usize]);
        self.triangles.len() as u32 - 1
    }
}
