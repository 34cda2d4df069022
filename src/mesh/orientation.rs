//! The triangles to reverse so that neighbours have the same orientation.

use super::topology::{NONE, Topology};

/// Patches of triangles joined by edges with exactly two triangles, and the orientation within
/// each.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Orientation {
    /// The patch of each triangle, numbered by its lowest triangle.
    pub patches: Vec<u32>,
    /// Number of patches.
    pub count: usize,
    /// True for each triangle to reverse so that its patch is consistent. Of the two choices the
    /// one with fewer reversals; for equal numbers the one that keeps the lowest triangle.
    pub turn: Vec<bool>,
    /// The lowest edge where a patch cannot be consistent because it is one-sided (a Moebius
    /// strip).
    pub one_sided: Option<u32>,
}

impl Orientation {
    /// Traverses each patch from its lowest triangle.
    pub fn new(topology: &Topology, triangles: &[[u32; 3]]) -> Self {
        let mut this = Self {
            patches: vec![NONE; triangles.len()],
            ..Self::default()
        };
        this.turn = vec![false; triangles.len()];
        let mut members = Vec::new();
        for seed in 0..triangles.len() {
            if this.patches[seed] != NONE {
                continue;
            }
            members.clear();
            members.push(seed as u32);
            this.patches[seed] = this.count as u32;
            let mut next = 0;
            while let Some(&t) = members.get(next) {
                next += 1;
                this.spread(t as usize, topology, triangles, &mut members);
            }
            let turned = members.iter().filter(|&&t| this.turn[t as usize]).count();
            if 2 * turned > members.len() {
                members.iter().for_each(|&t| this.turn[t as usize] ^= true);
            }
            this.count += 1;
        }
        this
    }

    fn spread(
        &mut self,
        t: usize,
        topology: &Topology,
        triangles: &[[u32; 3]],
        members: &mut Vec<u32>,
    ) {
        for (side, other) in topology.neighbours_of_triangle(t).into_iter().enumerate() {
            let Some(other) = other else { continue };
            let edge = topology.triangle_edges[t][side];
            let disagree = runs(triangles[t], topology.edges[edge as usize])
                == runs(triangles[other as usize], topology.edges[edge as usize]);
            let turn = self.turn[t] ^ disagree;
            if self.patches[other as usize] == NONE {
                self.patches[other as usize] = self.patches[t];
                self.turn[other as usize] = turn;
                members.push(other);
            } else if self.turn[other as usize] != turn {
                self.one_sided = Some(self.one_sided.map_or(edge, |e| e.min(edge)));
            }
        }
    }
}

/// True if a triangle traverses one of its edges from the first to the second end.
fn runs(triangle: [u32; 3], [a, b]: [u32; 2]) -> bool {
    (0..3).any(|k| triangle[k] == a && triangle[(k + 1) % 3] == b)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes::icosphere;

    #[test]
    fn what_was_turned_is_found() {
        let mut mesh = icosphere(1.0, 2);
        let turned: Vec<bool> = (0..mesh.triangles.len()).map(|t| t % 7 == 3).collect();
        for (t, _) in turned.iter().enumerate().filter(|(_, turned)| **turned) {
            mesh.triangles[t].swap(0, 1);
        }
        let found = Orientation::new(&Topology::new(&mesh), &mesh.triangles);
        assert_eq!(
            (found.turn, found.count, found.one_sided),
            (turned, 1, None)
        );
    }

    #[test]
    fn a_moebius_strip_has_one_side() {
        let strip: Vec<[u32; 3]> = (0..5u32).map(|k| [k, (k + 1) % 5, (k + 2) % 5]).collect();
        let topology = Topology::of_triangles(5, &strip);
        assert!(Orientation::new(&topology, &strip).one_sided.is_some());
        let open = &strip[..4];
        let found = Orientation::new(&Topology::of_triangles(5, open), open);
        assert_eq!(
            (found.one_sided, found.turn.iter().filter(|t| **t).count()),
            (None, 2)
        );
    }

    #[test]
    fn an_edge_of_three_triangles_parts_patches() {
        let book = [[0, 1, 2], [1, 0, 3], [0, 1, 4]];
        let found = Orientation::new(&Topology::of_triangles(5, &book), &book);
        assert_eq!((found.count, found.patches), (3, vec![0, 1, 2]));
    }
}
