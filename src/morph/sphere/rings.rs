//! A closed triangulation as the ring of neighbours of each vertex, with removal and reinsertion of
//! vertices.

/// Neighbours of each vertex, counter-clockwise seen from outside; empty for a removed vertex.
#[derive(Clone, Debug, PartialEq)]
pub struct Rings {
    rings: Vec<Vec<u32>>,
}

/// A vertex removed by contraction into a neighbour.
#[derive(Clone, Debug, PartialEq)]
pub struct Removed {
    /// The vertex.
    pub vertex: u32,
    /// Its neighbours at the removal, starting with the one of the contraction.
    pub ring: Vec<u32>,
}

impl Rings {
    /// The rings of a closed, oriented manifold; `None` where the triangles at a vertex form no
    /// single ring.
    pub fn new(vertices: usize, triangles: &[[u32; 3]]) -> Option<Self> {
        let mut pairs: Vec<Vec<[u32; 2]>> = vec![Vec::new(); vertices];
        for &[a, b, c] in triangles {
            for [v, from, to] in [[a, b, c], [b, c, a], [c, a, b]] {
                pairs[v as usize].push([from, to]);
            }
        }
        let rings: Option<Vec<_>> = pairs.iter().map(|pairs| chained(pairs)).collect();
        rings.map(|rings| Self { rings })
    }

    /// The neighbours of a vertex.
    #[inline]
    pub fn of(&self, vertex: u32) -> &[u32] {
        &self.rings[vertex as usize]
    }

    /// True if the contraction of `vertex` into its neighbour `into` leaves a closed triangulation
    /// of at least four vertices: they have exactly two common neighbours, and one of the two
    /// vertices has others.
    pub fn can_draw(&self, vertex: u32, into: u32) -> bool {
        let (ours, theirs) = (self.of(vertex), self.of(into));
        let shared = ours.iter().filter(|v| theirs.contains(v)).count();
        shared == 2 && ours.len() + theirs.len() > 6
    }

    /// Contracts a vertex into a neighbour: a fan about the neighbour replaces its triangles.
    pub fn draw(&mut self, vertex: u32, into: u32) -> Removed {
        let mut ring = std::mem::take(&mut self.rings[vertex as usize]);
        let start = ring.iter().position(|&v| v == into).unwrap_or(0);
        ring.rotate_left(start);
        let last = ring.len() - 1;
        let theirs = &mut self.rings[into as usize];
        if let Some(at) = theirs.iter().position(|&v| v == vertex) {
            theirs.splice(at..=at, ring[2..last.max(2)].iter().copied());
        }
        for end in [ring[1], ring[last]] {
            self.rings[end as usize].retain(|&v| v != vertex);
        }
        for &middle in &ring[2..last.max(2)] {
            self.rename(middle, vertex, into);
        }
        Removed { vertex, ring }
    }

    /// Reinserts the most recently removed vertex.
    pub fn restore(&mut self, removed: &Removed) {
        let Removed { vertex, ring } = removed;
        let (into, last) = (ring[0], ring.len() - 1);
        let theirs = &mut self.rings[into as usize];
        // The entries between the two ends are replaced; they can wrap around the end of the list.
        let start = theirs.iter().position(|&v| v == ring[1]).unwrap_or(0);
        theirs.rotate_left(start);
        theirs.splice(1..last - 1, [*vertex]);
        for &middle in &ring[2..last.max(2)] {
            self.rename(middle, into, *vertex);
        }
        for (end, after) in [(ring[1], 0), (ring[last], 1)] {
            let ring = &mut self.rings[end as usize];
            let at = ring.iter().position(|&v| v == into).unwrap_or(0);
            ring.insert(at + after, *vertex);
        }
        self.rings[*vertex as usize].clone_from(ring);
    }

    fn rename(&mut self, at: u32, from: u32, to: u32) {
        self.rings[at as usize]
            .iter_mut()
            .filter(|v| **v == from)
            .for_each(|v| *v = to);
    }
}

/// A ring from its pairs of successive neighbours.
fn chained(pairs: &[[u32; 2]]) -> Option<Vec<u32>> {
    let first = pairs.first()?[0];
    let mut ring = vec![first];
    let mut at = first;
    loop {
        at = pairs.iter().find(|p| p[0] == at)?[1];
        if at == first {
            return (ring.len() == pairs.len()).then_some(ring);
        }
        if ring.len() >= pairs.len() {
            return None;
        }
        ring.push(at);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes::icosphere;

    fn canonical(rings: &Rings) -> Vec<Vec<u32>> {
        let turned = |ring: &Vec<u32>| {
            let mut ring = ring.clone();
            let least = (0..ring.len()).min_by_key(|&i| ring[i]).unwrap_or(0);
            ring.rotate_left(least);
            ring
        };
        rings.rings.iter().map(turned).collect()
    }

    fn is_closed(rings: &Rings) -> bool {
        let pairs = |v: u32| {
            let ring = rings.of(v);
            (0..ring.len()).map(move |i| (ring[i], ring[(i + 1) % ring.len()]))
        };
        (0..rings.rings.len() as u32).all(|v| pairs(v).all(|(a, b)| pairs(a).any(|p| p == (b, v))))
    }

    #[test]
    fn what_is_taken_out_is_put_back() {
        let mesh = icosphere(1.0, 2);
        let start = Rings::new(mesh.vertices.len(), &mesh.triangles).expect("closed");
        let (mut rings, mut removed) = (start.clone(), Vec::new());
        for vertex in 0..mesh.vertices.len() as u32 {
            let into = rings
                .of(vertex)
                .iter()
                .copied()
                .find(|&v| rings.can_draw(vertex, v));
            let Some(into) = into else { continue };
            removed.push(rings.draw(vertex, into));
            assert!(is_closed(&rings), "after vertex {vertex}");
        }
        assert!(removed.len() > 100);
        while let Some(last) = removed.pop() {
            rings.restore(&last);
            assert!(is_closed(&rings));
        }
        assert_eq!(canonical(&rings), canonical(&start));
    }

    #[test]
    fn a_tetrahedron_stays() {
        let rings = Rings::new(4, &[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]).expect("closed");
        assert!((0..4).all(|a| (0..4).all(|b| a == b || !rings.can_draw(a, b))));
        assert_eq!(Rings::new(3, &[[0, 1, 2]]), None, "an open ring");
    }
}
