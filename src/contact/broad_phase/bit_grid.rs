//! A grid of boxes that are either bone or free, one bit each.

use nalgebra::{Point3, Vector3};

use super::boxes::{Boxes, Place};
use crate::contact::faces::Faces;
use crate::contact::{Obstacle, Projection};
use crate::mesh::TriangleMesh;
use crate::mesh::inside::Inside;
use crate::mesh::measures::Aabb;
use crate::mesh::winding::WindingTree;

/// Rule for the boxes of bone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fill {
    /// Boxes whose centre is in bone: bone thinner than a box can have none.
    Centre,
    /// Boxes whose centre is in bone, and all boxes that the surface intersects: all bone is
    /// covered, but a gap narrower than a box is filled.
    Touch,
}

/// A part of a path, as shares of its length.
struct Stretch {
    from: f64,
    to: f64,
    bone: bool,
}

/// The bit grid of the first source: `k^3` boxes with one bit each \[cervenka2019\].
///
/// Contact acts on the boxes, not on the bone. Let `d` be the distance from a closed bone and `e`
/// that from the boxes. Where `e` is positive, `-diagonal <= d <= e + diagonal`. With
/// [`Fill::Touch`] also `e <= d`: a point outside the boxes is outside the bone. Inside the boxes,
/// `e` can be any value below `d` where a gap of the bone was filled; with [`Fill::Centre`], any
/// value above `d` where the bone is thin. A direction is that to a corner, an edge or a side of a
/// box.
/// corner, an edge or a side of a box.
#[derive(Clone, Debug)]
pub struct BitGrid {
    boxes: Boxes,
    bits: Vec<u64>,
    contact_samples: Vec<Point3<f64>>,
}

impl BitGrid {
    /// Fills `k` boxes along each axis, at least four: the surface begins in the middle of the
    /// second box, and the outermost boxes are free. For a mesh that is not closed and oriented the
    /// generalised winding number decides what is inside \[jacobson2013\].
    pub fn new(mesh: &TriangleMesh, k: usize, fill: Fill) -> Self {
        let k = k.max(4);
        let inner = Boxes::new(&mesh.bounding_box(), k - 3);
        let margin = 1.5 * inner.size;
        let around = Aabb {
            min: inner.bounds.min - margin,
            max: inner.bounds.max + margin,
        };
        let boxes = Boxes::new(&around, k);
        let faces = Faces::new(mesh);
        let mut this = Self {
            bits: vec![0; boxes.len().div_ceil(64)],
            boxes,
            contact_samples: faces.contact_samples.clone(),
        };
        if faces.is_sound() {
            let inside = Inside::new(&mesh.vertices, &mesh.triangles);
            this.fill(|p| inside.winding(p) != 0);
        } else {
            let tree = WindingTree::new(mesh);
            this.fill(|p| tree.number(p).abs() >= 0.5);
        }
        if fill == Fill::Touch {
            let (boxes, bits) = (&this.boxes, &mut this.bits);
            for t in 0..mesh.triangles.len() {
                boxes.meeting(&mesh.corners(t), |place| set(bits, boxes.index(place)));
            }
        }
        this
    }

    fn fill(&mut self, inside: impl Fn(&Point3<f64>) -> bool) {
        let k = self.boxes.count;
        for index in 0..self.boxes.len() {
            let place = [index / (k * k), index / k % k, index % k];
            if inside(&self.boxes.centre(place)) {
                set(&mut self.bits, index);
            }
        }
    }

    /// All boxes.
    pub(in crate::contact) fn boxes(&self) -> &Boxes {
        &self.boxes
    }

    /// Indices of the boxes of bone, ascending.
    pub(in crate::contact) fn bone(&self) -> Vec<usize> {
        let is_set = |index: &usize| self.bits[index / 64] >> (index % 64) & 1 == 1;
        (0..self.boxes.len()).filter(is_set).collect()
    }

    fn is_bone(&self, place: Place) -> bool {
        let index = self.boxes.index(place);
        self.bits[index / 64] >> (index % 64) & 1 == 1
    }

    /// True if a point lies in a box of bone; everything beyond the grid is free.
    pub fn holds(&self, point: &Point3<f64>) -> bool {
        self.boxes.bounds.contains(point) && self.is_bone(self.boxes.at(point))
    }

    /// Diagonal of a box [m], a bound on the distance of the surface beyond the boxes.
    pub fn diagonal(&self) -> f64 {
        self.boxes.size.norm()
    }

    /// Number of boxes of bone.
    pub fn filled(&self) -> usize {
        self.bits.iter().map(|b| b.count_ones() as usize).sum()
    }

    /// Memory of the bits alone [bytes].
    pub fn bit_bytes(&self) -> usize {
        self.bits.capacity() * 8
    }

    /// The rule of the first source as printed, for comparison: the new position of a vertex that
    /// would move from `x` to `p` [m]. The vertex goes to `p` if that is free, whatever the path
    /// crosses (errata A17); otherwise to the first free box on the path back to `x`. `None` if
    /// there is none, for example when a bone moved over both.
    pub fn walk_back(&self, x: &Point3<f64>, p: &Point3<f64>) -> Option<Point3<f64>> {
        if !self.holds(p) {
            return Some(*p);
        }
        let free = self.stretches(p, x).into_iter().find(|s| !s.bone)?;
        Some(p + (x - p) * (free.from + self.within(&free, (x - p).norm())))
    }

    /// The corrected rule: the last point on the path from `x` to `p` [m] before the first box of
    /// bone; `p` if no box on the path is bone. `None` if `x` lies in bone: the exit is then
    /// [`Closest::point`].
    pub fn walk(&self, x: &Point3<f64>, p: &Point3<f64>) -> Option<Point3<f64>> {
        if self.holds(x) {
            return None;
        }
        let stretches = self.stretches(x, p);
        let before = match stretches.iter().position(|s| s.bone) {
            Some(0) => return Some(*x),
            Some(first) => &stretches[first - 1],
            None if self.holds(p) => stretches.last()?,
            None => return Some(*p),
        };
        Some(x + (p - x) * (before.to - self.within(before, (p - x).norm())))
    }

    /// The parts of a path that lie in one box each, or beyond all boxes.
    fn stretches(&self, from: &Point3<f64>, to: &Point3<f64>) -> Vec<Stretch> {
        let along = to - from;
        let bone = |a: f64, b: f64| self.holds(&(from + along * (0.5 * (a + b))));
        self.boxes
            .cuts(from, to)
            .windows(2)
            .map(|c| Stretch {
                from: c[0],
                to: c[1],
                bone: bone(c[0], c[1]),
            })
            .collect()
    }

    /// Distance of the chosen point from the end of a part, as a share of a path of `length` [m]: a
    /// quarter of a box, which is certainly inside, or half of the part, which was tested.
    fn within(&self, stretch: &Stretch, length: f64) -> f64 {
        (0.5 * (stretch.to - stretch.from)).min(0.25 * self.boxes.size.min() / length)
    }

    /// Unit vector from the first box to the second.
    fn towards(&self, from: Place, to: Place) -> Vector3<f64> {
        let along = self.boxes.centre(to) - self.boxes.centre(from);
        along.try_normalize(0.0).unwrap_or_else(Vector3::z)
    }
}

fn set(bits: &mut [u64], index: usize) {
    bits[index / 64] |= 1 << (index % 64);
}

/// The surface between free boxes and boxes of bone.
impl Obstacle for BitGrid {
    fn closest(&self, point: &Point3<f64>) -> Option<Projection> {
        let inside = self.holds(point);
        let mut best: Option<(f64, Place, Point3<f64>)> = None;
        self.boxes.search(point, f64::INFINITY, |place, reach| {
            if self.is_bone(place) == inside {
                return reach;
            }
            let nearest = self.boxes.nearest(place, point);
            let distance = (point - nearest).norm();
            if distance < reach {
                best = Some((distance, place, nearest));
            }
            reach.min(distance)
        });
        let (distance, other, nearest) = best?;
        let sign = if inside { -1.0 } else { 1.0 };
        // At a smaller distance the direction is rounding error.
        let normal = if distance > 1e-9 * self.diagonal() {
            (point - nearest) * (sign / distance)
        } else {
            self.towards(other, self.boxes.at(point)) * sign
        };
        Some(Projection {
            distance: sign * distance,
            normal,
            point: nearest,
        })
    }

    fn bounding_box(&self) -> Aabb {
        self.boxes.bounds
    }

    fn contact_samples(&self) -> &[Point3<f64>] {
        &self.contact_samples
    }

    fn bytes(&self) -> usize {
        self.bit_bytes() + self.contact_samples.capacity() * 24
    }
}
