//! Boundary loops of a surface: its edges with one triangle, in order.

use std::collections::BTreeMap;

use super::topology::Topology;

/// A walk along boundary edges.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Rim {
    /// Vertices in order, each once; the first one of an open walk that ends at itself appears
    /// twice.
    pub vertices: Vec<u32>,
    /// True if the last vertex is joined to the first; false only where edges with three triangles
    /// divide a boundary.
    pub closed: bool,
}

/// All boundary walks, sorted by their lowest edge; walks that touch in a vertex stay separate
/// there.
pub fn rims(topology: &Topology) -> Vec<Rim> {
    let boundary = topology.boundary_edges();
    let mut at: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    // The lowest edge is last; edges are taken from the end.
    for &e in boundary.iter().rev() {
        topology.edges[e as usize]
            .iter()
            .for_each(|&v| at.entry(v).or_default().push(e));
    }
    let mut used = vec![false; topology.edges.len()];
    let mut rims = Vec::new();
    for &seed in &boundary {
        if used[seed as usize] {
            continue;
        }
        used[seed as usize] = true;
        let [first, second] = topology.edges[seed as usize];
        walk(topology, &mut at, &mut used, vec![first, second], &mut rims);
    }
    rims
}

/// Continues from the last vertex of `path`; each return to a vertex of the path cuts off a closed
/// walk.
fn walk(
    topology: &Topology,
    at: &mut BTreeMap<u32, Vec<u32>>,
    used: &mut [bool],
    mut path: Vec<u32>,
    rims: &mut Vec<Rim>,
) {
    // Position of each vertex on the path.
    let mut place: BTreeMap<u32, usize> = path.iter().enumerate().map(|(k, v)| (*v, k)).collect();
    while let Some(&last) = path.last() {
        // Removes used edges, so that no edge is examined twice from one of its ends.
        let Some(edges) = at.get_mut(&last) else {
            break;
        };
        while edges.last().is_some_and(|e| used[*e as usize]) {
            edges.pop();
        }
        let Some(&edge) = edges.last() else { break };
        used[edge as usize] = true;
        let [a, b] = topology.edges[edge as usize];
        let next = if a == last { b } else { a };
        if let Some(&k) = place.get(&next) {
            let vertices = path.split_off(k);
            vertices.iter().for_each(|v| {
                place.remove(v);
            });
            rims.push(Rim {
                vertices,
                closed: true,
            });
        }
        place.insert(next, path.len());
        path.push(next);
    }
    if path.len() > 1 {
        rims.push(Rim {
            vertices: path,
            closed: false,
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes::icosphere;

    fn of(count: usize, triangles: &[[u32; 3]]) -> Vec<(usize, bool)> {
        let mut found: Vec<_> = rims(&Topology::of_triangles(count, triangles))
            .into_iter()
            .map(|rim| (rim.vertices.len(), rim.closed))
            .collect();
        found.sort_unstable();
        found
    }

    #[test]
    fn holes_are_rims() {
        let mut mesh = icosphere(1.0, 2);
        assert_eq!(of(mesh.vertices.len(), &mesh.triangles), []);
        mesh.triangles.remove(7);
        assert_eq!(of(mesh.vertices.len(), &mesh.triangles), [(3, true)]);
        mesh.triangles.retain(|t| !t.contains(&100));
        assert_eq!(of(mesh.vertices.len(), &mesh.triangles).len(), 2);
    }

    #[test]
    fn rims_that_touch_are_kept_apart() {
        let bow_tie = [[0, 1, 2], [0, 3, 4]];
        assert_eq!(of(5, &bow_tie), [(3, true), (3, true)]);
        // A strip with one vertex between two holes.
        let chain = [[0, 1, 2], [2, 3, 4], [4, 5, 6]];
        assert_eq!(of(7, &chain), [(3, true); 3]);
    }

    #[test]
    fn a_book_has_an_open_rim() {
        // Three triangles at one edge: three walks from one end of it to the other.
        assert!(
            of(5, &[[0, 1, 2], [1, 0, 3], [0, 1, 4]])
                .iter()
                .any(|(_, closed)| !closed)
        );
    }
}
