//! Boxes that are either bone or free, a bit each.

use nalgebra::{Point3, Vector3};

use super::boxes::{Boxes, Place};
use crate::contact::faces::Faces;
use crate::contact::{Obstacle, Projection};
use crate::mesh::TriangleMesh;
use crate::mesh::inside::Inside;
use crate::mesh::measures::Aabb;
use crate::mesh::winding::WindingTree;

/// Which boxes are bone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fill {
    /// Those whose middle is: bone thinner than a box may have none.
    Centre,
    /// Those whose middle is, and all that the surface meets: no bone is free, but a gap narrower than a box is bone.
    Touch,
}

/// A part of a way, as shares of it.
struct Stretch {
    from: f64,
    to: f64,
    bone: bool,
}

/// The grid of bits of the first source: `k^3` boxes, of which only is known whether they are bone \[cervenka2019\].
///
/// A muscle is kept out of the boxes and not out of the bone. Let `d` be the distance from a closed bone and `e` that from
/// the boxes. Where `e` is positive, `-diagonal <= d <= e + diagonal`; filled by touch also `e <= d`, so that what is kept
/// out of the boxes is kept out of the bone. Inside of the boxes `e` may be anything below `d` where a gap of the bone was
/// filled, and filled by their middles `e` may be anything above `d` where the bone is thin. A direction is that to a
/// corner, an edge or a side of a box.
#[derive(Clone, Debug)]
pub struct BitGrid {
    boxes: Boxes,
    bits: Vec<u64>,
    contact_samples: Vec<Point3<f64>>,
}

impl BitGrid {
    /// Fills `k` boxes along each axis, at least four: the surface begins amid the second, and the outermost are free. What is inside a mesh that is not closed
    /// and oriented is decided by the generalised winding number \[jacobson2013\].
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

    fn is_bone(&self, place: Place) -> bool {
        let index = self.boxes.index(place);
        self.bits[index / 64] >> (index % 64) & 1 == 1
    }

    /// Whether a point lies in a box that is bone; beyond the boxes all is free.
    pub fn holds(&self, point: &Point3<f64>) -> bool {
        self.boxes.bounds.contains(point) && self.is_bone(self.boxes.at(point))
    }

    /// Diagonal of a box [m], which bounds how far the surface is beyond the boxes.
    pub fn diagonal(&self) -> f64 {
        self.boxes.size.norm()
    }

    /// How many boxes are bone.
    pub fn filled(&self) -> usize {
        self.bits.iter().map(|b| b.count_ones() as usize).sum()
    }

    /// Memory of the bits alone [bytes].
    pub fn bit_bytes(&self) -> usize {
        self.bits.capacity() * 8
    }

    /// The rule of the first source as printed, for comparison: where a vertex that wanted to go from `x` to `p` [m] is
    /// put. It stays at a `p` that is free, whatever it passed (errata A17); else it is put into the first free box on
    /// the way back to `x`. `None` if there is none, as when a bone moved over both.
    pub fn walk_back(&self, x: &Point3<f64>, p: &Point3<f64>) -> Option<Point3<f64>> {
        if !self.holds(p) {
            return Some(*p);
        }
        let free = self.stretches(p, x).into_iter().find(|s| !s.bone)?;
        Some(p + (x - p) * (free.from + self.within(&free, (x - p).norm())))
    }

    /// What the rule should have been: the last place on the way from `x` to `p` [m] before the first box of bone; `p` if
    /// no box of the way is bone. `None` if `x` lies in bone: the way out is then that to [`Projection::point`].
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

    /// The parts of a way that lie in one box each, or beyond all.
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

    /// How far from its end a place in a stretch of a way of `length` [m] is chosen, as a share of the way: a quarter of a
    /// box, which is certainly within, or half of the stretch, which was looked at.
    fn within(&self, stretch: &Stretch, length: f64) -> f64 {
        (0.5 * (stretch.to - stretch.from)).min(0.25 * self.boxes.size.min() / length)
    }

    /// Unit vector by which one gets from the first box to the second.
    fn towards(&self, from: Place, to: Place) -> Vector3<f64> {
        let along = self.boxes.centre(to) - self.boxes.centre(from);
        along.try_normalize(0.0).unwrap_or_else(Vector3::z)
    }
}

fn set(bits: &mut [u64], index: usize) {
    bits[index / 64] |= 1 << (index % 64);
}

/// The surface is that between free boxes and those that are bone.
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
        // Nearer than this the direction is rounding.
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
