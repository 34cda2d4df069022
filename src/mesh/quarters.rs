//! Every triangle split in four at the midpoints of its edges.

use std::collections::BTreeMap;

/// Four triangles in place of each of `triangles`, and the ends of each edge with a new vertex in its middle. The
/// new vertices are numbered from `count` on, in the order of their edges; all others keep their numbers.
pub fn quarters(triangles: &[[u32; 3]], count: u32) -> (Vec<[u32; 3]>, Vec<[u32; 2]>) {
    let (mut known, mut edges) = (BTreeMap::new(), Vec::new());
    let mut middle = |a: u32, b: u32| {
        let edge = [a.min(b), a.max(b)];
        *known.entry(edge).or_insert_with(|| {
            edges.push(edge);
            count + edges.len() as u32 - 1
        })
    };
    let split = |&[a, b, c]: &[u32; 3]| {
        let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
        [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
    };
    let split = triangles.iter().flat_map(split).collect();
    (split, edges)
}
