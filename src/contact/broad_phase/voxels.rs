//! Equal boxes, each with a list of the triangles that intersect it.

use nalgebra::Point3;

use super::boxes::Boxes;
use super::{Best, BroadPhase, NearestTriangle};
use crate::mesh::TriangleMesh;

/// Entry in the list of methods.
pub(super) const METHOD: BroadPhase = BroadPhase {
    name: "voxels",
    sizes: &[16, 24, 32, 64],
    usual: 32,
    sort: |mesh, k| Box::new(Voxels::new(mesh, k)),
};

/// `k^3` boxes over the bounds of a mesh \[cervenka2019\]. The nearest triangle is exact: the
/// search visits shells of boxes about the point until the next shell is farther away than the best
/// triangle.
///
/// A surface intersects only about `k^2` of the boxes (errata A03), so shells about a distant point
/// are mostly empty.
#[derive(Clone, Debug)]
pub struct Voxels {
    boxes: Boxes,
    /// Start of the list of each box, and the end of the last list.
    start: Vec<u32>,
    listed: Vec<u32>,
}

impl Voxels {
    /// Lists every triangle in the boxes that it intersects, `k` along each axis; fewer if the
    /// lists would have more than 2^32 entries.
    pub fn new(mesh: &TriangleMesh, k: usize) -> Self {
        let mut boxes = Boxes::new(&mesh.bounding_box(), k);
        let start = loop {
            let mut counts = vec![0_u32; boxes.len() + 1];
            let each = |t: usize| {
                boxes.meeting(&mesh.corners(t), |place| {
                    counts[boxes.index(place) + 1] += 1
                })
            };
            (0..mesh.triangles.len()).for_each(each);
            if counts.iter().map(|c| u64::from(*c)).sum::<u64>() <= u64::from(u32::MAX) {
                (0..boxes.len()).for_each(|b| counts[b + 1] += counts[b]);
                break counts;
            }
            boxes = Boxes::new(&mesh.bounding_box(), boxes.count / 2);
        };
        let mut listed = vec![0_u32; start[boxes.len()] as usize];
        let mut next = start.clone();
        for t in 0..mesh.triangles.len() {
            boxes.meeting(&mesh.corners(t), |place| {
                let at = &mut next[boxes.index(place)];
                listed[*at as usize] = t as u32;
                *at += 1;
            });
        }
        Self {
            boxes,
            start,
            listed,
        }
    }

    /// Number of boxes with triangles.
    pub fn filled(&self) -> usize {
        self.start
            .windows(2)
            .filter(|ends| ends[0] < ends[1])
            .count()
    }
}

impl NearestTriangle for Voxels {
    fn nearest(&self, mesh: &TriangleMesh, point: &Point3<f64>, reach: f64) -> Option<u32> {
        let mut best = Best::within(reach);
        self.boxes.search(point, reach, |place, _| {
            let index = self.boxes.index(place);
            let list = &self.listed[self.start[index] as usize..self.start[index + 1] as usize];
            let near = || {
                (self.boxes.nearest(place, point) - point).norm() - self.boxes.slack
                    <= best.distance
            };
            if !list.is_empty() && near() {
                list.iter().for_each(|&t| best.look_at(mesh, point, t));
            }
            best.distance
        });
        best.triangle
    }

    fn bytes(&self) -> usize {
        (self.start.capacity() + self.listed.capacity()) * 4
    }
}
