//! Disjoint sets of indices.

/// Sets of the indices below a count. The lowest index of a set identifies it.
#[derive(Clone, Debug)]
pub(crate) struct UnionFind {
    parents: Vec<u32>,
}

impl UnionFind {
    /// Creates one set for each index below `count`.
    pub fn new(count: usize) -> Self {
        Self {
            parents: (0..count as u32).collect(),
        }
    }

    /// The lowest index of the set of `i`.
    pub fn root(&mut self, mut i: u32) -> u32 {
        while self.parents[i as usize] != i {
            let above = self.parents[self.parents[i as usize] as usize];
            self.parents[i as usize] = above;
            i = above;
        }
        i
    }

    /// Joins the sets of `a` and `b`. Returns false if they are one set already.
    pub fn join(&mut self, a: u32, b: u32) -> bool {
        let (a, b) = (self.root(a), self.root(b));
        self.parents[a.max(b) as usize] = a.min(b);
        a != b
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lowest_index_identifies_a_set() {
        let mut sets = UnionFind::new(6);
        assert!(sets.join(5, 3) && sets.join(4, 2) && sets.join(3, 4) && !sets.join(5, 2));
        let roots: Vec<u32> = (0..6).map(|i| sets.root(i)).collect();
        assert_eq!(roots, [0, 1, 2, 2, 2, 2]);
    }
}
