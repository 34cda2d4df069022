//! The whole skin with its refined patches, joined without gaps: closed where the skin was closed.
//!
//! A refined patch has more boundary vertices than the skin around it. Adjacent triangles of the
//! skin are split there, so that no vertex lies inside an edge of another triangle. Triangles of a
//! region are unchanged, since a region never reaches the boundary of its patch.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::Point3;

use super::plan::PreparedPatch;
use crate::mesh::orientation::Orientation;
use crate::mesh::topology::NONE;
use crate::mesh::{Topology, TriangleMesh};

/// Relative distance on an edge below which two vertices are the same: patches on both sides bisect
/// it at the same points.
const SAME: f64 = 1e-9;

/// The whole skin at rest.
#[derive(Clone, Debug, PartialEq)]
pub struct Whole {
    /// The mesh: the parts outside all patches, then the patches. Neighbours have the same
    /// orientation. Components with a patch face outward, unless the skin is one-sided.
    pub mesh: TriangleMesh,
    /// For each patch the mesh vertex of each of its vertices.
    pub vertices: Vec<Vec<u32>>,
    /// The patch whose region contains a triangle; `u32::MAX` for none.
    pub owner: Vec<u32>,
}

/// The boundary vertices between two vertices of the skin, with both ends.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Chain {
    /// The edge of the skin.
    pub ends: [u32; 2],
    /// Vertices of the patch.
    pub vertices: Vec<u32>,
}

/// The boundary of a patch; its vertices are those of the skin where `origin` gives one.
pub(super) fn rim(patch: &TriangleMesh, topology: &Topology, origin: &[u32]) -> Vec<Chain> {
    let mut next: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for e in topology.boundary_edges() {
        let (edge, t) = (
            topology.edges[e as usize],
            topology.triangles_of_edge(e as usize)[0],
        );
        let corners = patch.triangles[t as usize];
        let forward = (0..3).any(|k| [corners[k], corners[(k + 1) % 3]] == edge);
        let [from, to] = if forward { edge } else { [edge[1], edge[0]] };
        next.entry(from).or_default().push(to);
    }
    let kept = |v: u32| origin[v as usize] != NONE;
    let mut chains = Vec::new();
    for (&from, successors) in next.iter().filter(|(from, _)| kept(**from)) {
        for &second in successors {
            let mut vertices = vec![from, second];
            let mut last = second;
            // Where the patch touches itself it is not refined, and every vertex is kept.
            while let Some(&[then]) = next.get(&last).filter(|_| !kept(last)).map(Vec::as_slice) {
                vertices.push(then);
                last = then;
                if vertices.len() > next.len() + 1 {
                    break;
                }
            }
            if kept(last) {
                chains.push(Chain {
                    ends: [from, last].map(|v| origin[v as usize]),
                    vertices,
                });
            }
        }
    }
    chains
}

/// A mesh under construction from patches.
struct Joining<'a> {
    skin: &'a TriangleMesh,
    /// The new vertex of each vertex of the skin.
    number: Vec<u32>,
    vertices: Vec<Point3<f64>>,
    /// Vertices inside an edge of the skin, from its lower end: position and vertex.
    split: BTreeMap<[u32; 2], Vec<(f64, u32)>>,
    /// Vertices inside an edge of the new mesh, from its first to its second end.
    within: BTreeMap<[u32; 2], Vec<u32>>,
}

impl Joining<'_> {
    fn push(&mut self, p: Point3<f64>) -> u32 {
        self.vertices.push(p);
        self.vertices.len() as u32 - 1
    }

    /// The new vertex of a vertex of the skin.
    fn kept(&mut self, v: u32) -> u32 {
        if self.number[v as usize] == NONE {
            self.number[v as usize] = self.push(self.skin.vertices[v as usize]);
        }
        self.number[v as usize]
    }

    /// The new vertices of a patch.
    fn patch(&mut self, ready: &PreparedPatch, chains: &[Chain]) -> Vec<u32> {
        let mut names: Vec<u32> = ready
            .origin
            .iter()
            .map(|&v| if v == NONE { NONE } else { self.kept(v) })
            .collect();
        for chain in chains {
            let mut key = chain.ends;
            key.sort_unstable();
            let [a, b] = key.map(|v| self.skin.vertices[v as usize]);
            let length = (b - a).norm();
            for &v in &chain.vertices[1..chain.vertices.len() - 1] {
                let p = ready.patch.vertices[v as usize];
                let along = (p - a).norm();
                let there = self
                    .split
                    .get(&key)
                    .into_iter()
                    .flatten()
                    .find(|(at, _)| (at - along).abs() <= SAME * length);
                names[v as usize] = match there {
                    Some((_, known)) => *known,
                    None => {
                        let fresh = self.push(p);
                        self.split.entry(key).or_default().push((along, fresh));
                        fresh
                    }
                };
            }
        }
        for (v, name) in names
            .iter_mut()
            .enumerate()
            .filter(|(_, name)| **name == NONE)
        {
            *name = self.push(ready.patch.vertices[v]);
        }
        names
    }

    /// Finds vertices on edges of the skin, and on the edges into which the boundary of a patch has
    /// split them.
    fn find_within(&mut self, rims: &[(Vec<Chain>, Vec<u32>)]) {
        self.split
            .values_mut()
            .for_each(|all| all.sort_by(|x, y| x.0.total_cmp(&y.0)));
        for (key, all) in &self.split {
            let ends = key.map(|v| self.number[v as usize]);
            self.within
                .insert(ends, all.iter().map(|(_, v)| *v).collect());
        }
        for (chains, names) in rims {
            for chain in chains {
                let mut key = chain.ends;
                key.sort_unstable();
                let Some(all) = self.split.get(&key) else {
                    continue;
                };
                let ends = key.map(|v| self.number[v as usize]);
                let line: Vec<u32> = [ends[0]]
                    .into_iter()
                    .chain(all.iter().map(|(_, v)| *v))
                    .chain([ends[1]])
                    .collect();
                let at = |v: u32| line.iter().position(|w| *w == names[v as usize]);
                for pair in chain.vertices.windows(2) {
                    let (Some(i), Some(j)) = (at(pair[0]), at(pair[1])) else {
                        continue;
                    };
                    let (low, high) = (i.min(j), i.max(j));
                    if high > low + 1 {
                        self.within
                            .insert([line[low], line[high]], line[low + 1..high].to_vec());
                    }
                }
            }
        }
    }

    /// Vertices inside the edge from `a` to `b`, in this order.
    fn between(&self, a: u32, b: u32) -> Vec<u32> {
        if let Some(all) = self.within.get(&[a, b]) {
            return all.clone();
        }
        self.within
            .get(&[b, a])
            .map(|all| all.iter().rev().copied().collect())
            .unwrap_or_default()
    }

    /// Splits a triangle with vertices inside its sides into triangles without, bisecting at the
    /// middle of the longest such side.
    fn halved(&self, triangle: [u32; 3], within: [Vec<u32>; 3]) -> Vec<[u32; 3]> {
        let mut done = Vec::new();
        let mut open = vec![(triangle, within)];
        let far = |a: u32, b: u32| (self.vertices[a as usize] - self.vertices[b as usize]).norm();
        while let Some((corners, mut within)) = open.pop() {
            let length = |k: &usize| far(corners[*k], corners[(*k + 1) % 3]);
            let sides = (0..3).filter(|k| !within[*k].is_empty());
            let Some(k) = sides.max_by(|i, j| length(i).total_cmp(&length(j))) else {
                done.push(corners);
                continue;
            };
            let (a, b, c) = (corners[k], corners[(k + 1) % 3], corners[(k + 2) % 3]);
            let [side, on, back] =
                [k, (k + 1) % 3, (k + 2) % 3].map(|i| std::mem::take(&mut within[i]));
            let middle = side.len() / 2;
            let m = side[middle];
            open.push(([m, b, c], [side[middle + 1..].to_vec(), on, Vec::new()]));
            open.push(([a, m, c], [side[..middle].to_vec(), Vec::new(), back]));
        }
        done
    }
}

impl Whole {
    /// Inserts the patches of implants, of which no two share a triangle, into their skin.
    pub fn of(skin: &TriangleMesh, parts: &[&PreparedPatch]) -> Self {
        let mut left = vec![0usize; skin.triangles.len()];
        parts
            .iter()
            .for_each(|ready| ready.outside.iter().for_each(|t| left[*t as usize] += 1));
        let number = vec![NONE; skin.vertices.len()];
        let mut joining = Joining {
            skin,
            number,
            vertices: Vec::new(),
            split: BTreeMap::new(),
            within: BTreeMap::new(),
        };
        let outside = (0..left.len())
            .filter(|t| left[*t] == parts.len())
            .map(|t| skin.triangles[t]);
        let outside: Vec<[u32; 3]> = outside.map(|t| t.map(|v| joining.kept(v))).collect();
        let rims: Vec<(Vec<Chain>, Vec<u32>)> = parts
            .iter()
            .map(|ready| {
                let chains = rim(&ready.patch, &Topology::new(&ready.patch), &ready.origin);
                let names = joining.patch(ready, &chains);
                (chains, names)
            })
            .collect();
        joining.find_within(&rims);
        let (mut triangles, mut owner) = (Vec::new(), Vec::new());
        for t in outside {
            triangles.extend(
                joining.halved(t, [0, 1, 2].map(|k| joining.between(t[k], t[(k + 1) % 3]))),
            );
        }
        let beyond = triangles.len();
        owner.resize(beyond, NONE);
        for (part, (ready, (chains, names))) in parts.iter().zip(&rims).enumerate() {
            // Only a side on the boundary is split: another side between the same two vertices
            // would be another edge.
            let on_rim: BTreeSet<[u32; 2]> = chains
                .iter()
                .flat_map(|c| c.vertices.windows(2).map(|w| [w[0], w[1]]))
                .collect();
            let mut of_region = vec![NONE; ready.patch.triangles.len()];
            ready
                .region
                .triangles
                .iter()
                .for_each(|t| of_region[*t as usize] = part as u32);
            for (t, region) in ready.patch.triangles.iter().zip(of_region) {
                let new = t.map(|v| names[v as usize]);
                let side = |k: usize| {
                    let rim = on_rim.contains(&[t[k], t[(k + 1) % 3]]);
                    if rim {
                        joining.between(new[k], new[(k + 1) % 3])
                    } else {
                        Vec::new()
                    }
                };
                triangles.extend(joining.halved(new, [0, 1, 2].map(side)));
                owner.resize(triangles.len(), region);
            }
        }
        let mut mesh = TriangleMesh {
            vertices: joining.vertices,
            triangles,
        };
        orient(&mut mesh, beyond);
        Self {
            mesh,
            vertices: rims.into_iter().map(|(_, names)| names).collect(),
            owner,
        }
    }
}

/// Gives neighbours the same orientation, and components with a triangle of a patch (from index
/// `first`) the orientation of the patch.
fn orient(mesh: &mut TriangleMesh, first: usize) {
    let orientation = Orientation::new(&Topology::new(mesh), &mesh.triangles);
    if orientation.one_sided.is_some() {
        return;
    }
    let mut turned = vec![0i64; mesh.triangles.len()];
    for t in first..mesh.triangles.len() {
        turned[orientation.patches[t] as usize] += if orientation.turn[t] { 1 } else { -1 };
    }
    for (t, corners) in mesh.triangles.iter_mut().enumerate() {
        if orientation.turn[t] != (turned[orientation.patches[t] as usize] > 0) {
            corners.swap(1, 2);
        }
    }
}

#[cfg(test)]
mod tests;
