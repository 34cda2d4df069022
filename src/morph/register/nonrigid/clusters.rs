//! Representatives on a surface, and the clusters that each vertex follows.

use std::cmp::Reverse;
use std::collections::{BTreeSet, BinaryHeap};

use nalgebra::Point3;

/// Number of clusters that a vertex follows.
const FOLLOWED: usize = 4;

/// Clusters of a surface.
pub(super) struct Clusters {
    /// The vertex that represents each cluster.
    pub seeds: Vec<u32>,
    /// Clusters that each vertex follows with their weights, of sum 1, nearest first.
    pub labels: Vec<Vec<(u32, f64)>>,
    /// Pairs of clusters with an agreement term, each once.
    pub neighbours: Vec<[u32; 2]>,
    /// Pairs of clusters with a common vertex, a superset of `neighbours`.
    pub together: Vec<[u32; 2]>,
}

/// A distance with a total order.
#[derive(Clone, Copy, PartialEq)]
struct Distance(f64);

impl Eq for Distance {}

impl Ord for Distance {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0)
    }
}

impl PartialOrd for Distance {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

struct GeodesicDistances<'a> {
    points: &'a [Point3<f64>],
    rings: Vec<Vec<u32>>,
}

impl<'a> GeodesicDistances<'a> {
    fn new(points: &'a [Point3<f64>], triangles: &[[u32; 3]]) -> Self {
        let mut rings: Vec<Vec<u32>> = vec![Vec::new(); points.len()];
        for &[a, b, c] in triangles {
            for [v, w] in [[a, b], [b, c], [c, a]] {
                rings[v as usize].push(w);
                rings[w as usize].push(v);
            }
        }
        for ring in &mut rings {
            ring.sort_unstable();
            ring.dedup();
        }
        Self { points, rings }
    }

    fn length(&self, a: u32, b: u32) -> f64 {
        (self.points[a as usize] - self.points[b as usize]).norm()
    }

    /// Vertices far from each other along edges, starting with vertex 0; each component has at
    /// least one if the count permits.
    fn seeds(&self, count: usize) -> Vec<u32> {
        let used: Vec<u32> = (0..self.points.len() as u32)
            .filter(|&v| !self.rings[v as usize].is_empty())
            .collect();
        let mut distances = vec![f64::INFINITY; self.points.len()];
        let mut seeds = Vec::new();
        while seeds.len() < count.min(used.len()) {
            let far = |v: &&u32| Distance(distances[**v as usize]);
            // Of several equally far vertices the first.
            let Some(&next) = used.iter().rev().max_by_key(far) else {
                break;
            };
            if distances[next as usize] == 0.0 {
                break;
            }
            seeds.push(next);
            let mut open = BinaryHeap::from([(Reverse(Distance(0.0)), next)]);
            distances[next as usize] = 0.0;
            while let Some((Reverse(Distance(d)), v)) = open.pop() {
                if d > distances[v as usize] {
                    continue;
                }
                for &w in &self.rings[v as usize] {
                    let there = d + self.length(v, w);
                    if there < distances[w as usize] {
                        distances[w as usize] = there;
                        open.push((Reverse(Distance(there)), w));
                    }
                }
            }
        }
        seeds
    }

    /// The nearest seeds of each vertex along edges, at most `most`, with their distances.
    fn nearest(&self, seeds: &[u32], most: usize) -> Vec<Vec<(u32, f64)>> {
        let mut found: Vec<Vec<(u32, f64)>> = vec![Vec::new(); self.points.len()];
        let mut open: BinaryHeap<_> = seeds
            .iter()
            .enumerate()
            .map(|(c, &v)| (Reverse(Distance(0.0)), v, c as u32))
            .collect();
        while let Some((Reverse(Distance(d)), v, c)) = open.pop() {
            let own = &mut found[v as usize];
            if own.len() >= most || own.iter().any(|(other, _)| *other == c) {
                continue;
            }
            own.push((c, d));
            for &w in &self.rings[v as usize] {
                let theirs = &found[w as usize];
                if theirs.len() < most && theirs.iter().all(|(other, _)| *other != c) {
                    open.push((Reverse(Distance(d + self.length(v, w))), w, c));
                }
            }
        }
        found
    }
}

impl Clusters {
    pub(super) fn new(points: &[Point3<f64>], triangles: &[[u32; 3]], count: usize) -> Self {
        let geodesics = GeodesicDistances::new(points, triangles);
        let seeds = geodesics.seeds(count.max(1));
        let near = geodesics.nearest(&seeds, FOLLOWED + 1);
        let alone = |p: &Point3<f64>| {
            let square = |s: &u32| (points[*s as usize] - p).norm_squared();
            let nearest = seeds
                .iter()
                .enumerate()
                .min_by(|(_, a), (_, b)| square(a).total_cmp(&square(b)));
            vec![(nearest.map_or(0, |(c, _)| c as u32), 1.0)]
        };
        let labels: Vec<Vec<(u32, f64)>> = near
            .iter()
            .zip(points)
            .map(|(near, p)| {
                if near.is_empty() {
                    alone(p)
                } else {
                    weighted(near)
                }
            })
            .collect();
        let (mut neighbours, mut together) = (BTreeSet::new(), BTreeSet::new());
        for label in &labels {
            for (i, &(a, _)) in label.iter().enumerate() {
                for (k, &(b, _)) in label[..i].iter().enumerate() {
                    let pair = [a.min(b), a.max(b)];
                    together.insert(pair);
                    // The nearest cluster of a vertex is a neighbour of its other clusters.
                    if k == 0 {
                        neighbours.insert(pair);
                    }
                }
            }
        }
        let [neighbours, together] = [neighbours, together].map(|set| set.into_iter().collect());
        Self {
            seeds,
            labels,
            neighbours,
            together,
        }
    }
}

/// Weights (1 - d/d_max)^2 of the nearest seeds, where d_max is the distance of the next one.
fn weighted(near: &[(u32, f64)]) -> Vec<(u32, f64)> {
    let followed = &near[..near.len().min(FOLLOWED)];
    let beyond = near
        .get(FOLLOWED)
        .map_or_else(|| 2.0 * followed.last().map_or(0.0, |l| l.1), |next| next.1);
    let weight = |d: f64| {
        if beyond > 0.0 {
            (1.0 - d / beyond).max(0.0).powi(2)
        } else {
            1.0
        }
    };
    let sum: f64 = followed.iter().map(|(_, d)| weight(*d)).sum();
    if !(sum > 0.0) {
        return vec![(near[0].0, 1.0)];
    }
    followed
        .iter()
        .map(|&(c, d)| (c, weight(d) / sum))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes::icosphere;

    #[test]
    fn seeds_are_spread_and_weights_sum_to_one() {
        let ball = icosphere(1.0, 3);
        let clusters = Clusters::new(&ball.vertices, &ball.triangles, 30);
        assert_eq!(clusters.seeds.len(), 30);
        let at = |c: usize| ball.vertices[clusters.seeds[c] as usize];
        let apart = (0..30)
            .flat_map(|i| (0..i).map(move |j| (i, j)))
            .map(|(i, j)| (at(i) - at(j)).norm());
        assert!(
            apart.fold(f64::INFINITY, f64::min) > 0.4,
            "30 caps of a ball are about 0.7 apart"
        );
        for label in &clusters.labels {
            assert!(
                (label.iter().map(|(_, w)| w).sum::<f64>() - 1.0).abs() < 1e-14
                    && label.len() <= FOLLOWED
            );
        }
        assert!(
            clusters
                .neighbours
                .iter()
                .all(|pair| clusters.together.contains(pair))
        );
    }

    #[test]
    fn each_piece_and_each_loose_vertex_has_a_cluster() {
        let ball = icosphere(1.0, 1);
        let mut points = ball.vertices.clone();
        points.extend(
            ball.vertices
                .iter()
                .map(|p| Point3::new(p.x + 5.0, p.y, p.z)),
        );
        points.push(Point3::new(9.0, 0.0, 0.0));
        let triangles: Vec<[u32; 3]> = ball
            .triangles
            .iter()
            .flat_map(|t| [*t, t.map(|v| v + ball.vertices.len() as u32)])
            .collect();
        let clusters = Clusters::new(&points, &triangles, 2);
        assert!(clusters.seeds[0] < 42 && clusters.seeds[1] >= 42);
        assert_eq!(clusters.labels[84], [(1, 1.0)]);
        assert!(clusters.neighbours.is_empty());
    }
}
