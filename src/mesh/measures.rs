//! Area, enclosed volume, centroid and bounding box of a surface.
//!
//! All sums are in difference form, about the centre of the bounding box: a translation that rounds
//! no coordinate changes no bit. They use the tree of [`tree_sum_by`]: the number of threads
//! changes no bit.

use nalgebra::{Isometry3, Point3, Vector3};

use super::TriangleMesh;
use super::sum::tree_sum_by;
use super::topology::Topology;

/// A box along the axes [m]; empty where `min > max` in any component.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aabb {
    /// Lowest corner [m].
    pub min: Point3<f64>,
    /// Highest corner [m].
    pub max: Point3<f64>,
}

impl Aabb {
    /// The empty box, the neutral element of [`Aabb::union`].
    pub const EMPTY: Self = Self {
        min: Point3::new(f64::INFINITY, f64::INFINITY, f64::INFINITY),
        max: Point3::new(f64::NEG_INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY),
    };

    /// Smallest box around `points` [m]; empty for none.
    pub fn of_points<'a>(points: impl IntoIterator<Item = &'a Point3<f64>>) -> Self {
        points.into_iter().fold(Self::EMPTY, |b, p| Self {
            min: b.min.inf(p),
            max: b.max.sup(p),
        })
    }

    /// The eight corners.
    pub fn corners(&self) -> [Point3<f64>; 8] {
        std::array::from_fn(|k| {
            let pick = |axis: usize| {
                if k >> axis & 1 == 0 {
                    self.min[axis]
                } else {
                    self.max[axis]
                }
            };
            Point3::new(pick(0), pick(1), pick(2))
        })
    }

    /// Distance to another box [m]; 0 for boxes that overlap.
    pub fn distance(&self, other: &Self) -> f64 {
        let between = (self.min - other.max).sup(&(other.min - self.max));
        between.sup(&Vector3::zeros()).norm()
    }

    /// True for a box without points.
    pub fn is_empty(&self) -> bool {
        (0..3).any(|k| self.min[k] > self.max[k])
    }

    /// Smallest box around both.
    #[must_use]
    pub fn union(&self, other: &Self) -> Self {
        Self {
            min: self.min.inf(&other.min),
            max: self.max.sup(&other.max),
        }
    }

    /// The common part of both; empty if they share no point.
    #[must_use]
    pub fn intersection(&self, other: &Self) -> Self {
        Self {
            min: self.min.sup(&other.min),
            max: self.max.inf(&other.max),
        }
    }

    /// The box extended by `margin` [m] on each side; a negative margin shrinks it, possibly to
    /// empty.
    #[must_use]
    pub fn inflate(&self, margin: f64) -> Self {
        let by = Vector3::repeat(margin);
        Self {
            min: self.min - by,
            max: self.max + by,
        }
    }

    /// True if the boxes share a point; touching boxes intersect, an empty box intersects none.
    pub fn intersects(&self, other: &Self) -> bool {
        (0..3).all(|k| self.min[k].max(other.min[k]) <= self.max[k].min(other.max[k]))
    }

    /// True if the point is inside or on the box.
    pub fn contains(&self, point: &Point3<f64>) -> bool {
        self.min <= *point && *point <= self.max
    }

    /// Centre [m]; undefined for an empty box.
    pub fn center(&self) -> Point3<f64> {
        self.min + 0.5 * (self.max - self.min)
    }

    /// Length of each side [m]; zero for an empty box.
    pub fn extents(&self) -> Vector3<f64> {
        if self.is_empty() {
            Vector3::zeros()
        } else {
            self.max - self.min
        }
    }

    /// A box around the moved box, up to rounding; inflate it where rounding matters.
    #[must_use]
    pub fn transformed(&self, pose: &Isometry3<f64>) -> Self {
        if self.is_empty() {
            return Self::EMPTY;
        }
        let half =
            pose.rotation.to_rotation_matrix().matrix().abs() * (0.5 * (self.max - self.min));
        let center = pose * self.center();
        Self {
            min: center - half,
            max: center + half,
        }
    }
}

/// Corners of a triangle relative to a frame in which the bounding box is centred at the origin [m].
struct Centred<'a> {
    vertices: &'a [Point3<f64>],
    triangles: &'a [[u32; 3]],
    corner: Point3<f64>,
    half: Vector3<f64>,
}

impl<'a> Centred<'a> {
    fn new(vertices: &'a [Point3<f64>], triangles: &'a [[u32; 3]]) -> Self {
        let bounds = Aabb::of_points(vertices);
        // The lowest corner moves with the mesh without rounding; the centre would not.
        Self {
            vertices,
            triangles,
            corner: bounds.min,
            half: 0.5 * bounds.extents(),
        }
    }

    fn corners(&self, triangle: usize) -> [Vector3<f64>; 3] {
        self.triangles[triangle].map(|i| self.vertices[i as usize] - self.corner - self.half)
    }

    fn six_volumes(&self, triangle: usize) -> f64 {
        let [a, b, c] = self.corners(triangle);
        a.dot(&b.cross(&c))
    }

    /// Sum of `weight(t) (a + b + c) / total`, in the frame of the mesh.
    fn mean_corner_sum(&self, total: f64, weight: impl Fn(usize) -> f64 + Sync) -> Point3<f64> {
        let component = |k: usize| {
            let part = |t| {
                weight(t)
                    * self
                        .corners(t)
                        .iter()
                        .map(|c: &Vector3<f64>| c[k])
                        .sum::<f64>()
            };
            tree_sum_by(self.triangles.len(), part) / total
        };
        self.corner + (self.half + Vector3::new(component(0), component(1), component(2)))
    }
}

fn triangle_area(vertices: &[Point3<f64>], [a, b, c]: [u32; 3]) -> f64 {
    let [a, b, c] = [a, b, c].map(|i| vertices[i as usize]);
    0.5 * (b - a).cross(&(c - a)).norm()
}

/// Enclosed volume [m^3] of a closed surface given as vertices [m] and triangles; positive for an
/// outward orientation.
///
/// `V = 1/6 sum a.(b x c)` over the triangles, with corners relative to the centre of the bounding
/// box. For an open surface this is the volume of the cones from that centre.
pub fn volume(vertices: &[Point3<f64>], triangles: &[[u32; 3]]) -> f64 {
    let centred = Centred::new(vertices, triangles);
    tree_sum_by(triangles.len(), |t| centred.six_volumes(t)) / 6.0
}

/// Area of each triangle [m^2].
pub fn triangle_areas(vertices: &[Point3<f64>], triangles: &[[u32; 3]]) -> Vec<f64> {
    triangles
        .iter()
        .map(|&t| triangle_area(vertices, t))
        .collect()
}

/// Area [m^2] of a surface given as vertices [m] and triangles.
pub fn area(vertices: &[Point3<f64>], triangles: &[[u32; 3]]) -> f64 {
    tree_sum_by(triangles.len(), |t| triangle_area(vertices, triangles[t]))
}

impl TriangleMesh {
    /// Smallest box around all vertices [m], including those without triangles.
    pub fn bounding_box(&self) -> Aabb {
        Aabb::of_points(&self.vertices)
    }

    /// Longest side of the bounding box [m]; the length scale for tolerances.
    pub fn length(&self) -> f64 {
        self.bounding_box().extents().max()
    }

    /// Area [m^2], see [`area`].
    pub fn area(&self) -> f64 {
        area(&self.vertices, &self.triangles)
    }

    /// Enclosed volume [m^3], see [`volume`].
    pub fn volume(&self) -> f64 {
        volume(&self.vertices, &self.triangles)
    }

    /// Centroid of the surface [m]; `None` where the area is zero.
    pub fn surface_centroid(&self) -> Option<Point3<f64>> {
        let total = self.area();
        let centred = Centred::new(&self.vertices, &self.triangles);
        (total > 0.0).then(|| {
            centred.mean_corner_sum(3.0 * total, |t| {
                triangle_area(&self.vertices, self.triangles[t])
            })
        })
    }

    /// Centroid of the enclosed volume [m]; `None` where that volume is zero.
    pub fn centroid(&self) -> Option<Point3<f64>> {
        let centred = Centred::new(&self.vertices, &self.triangles);
        let total = tree_sum_by(self.triangles.len(), |t| centred.six_volumes(t));
        (total != 0.0).then(|| centred.mean_corner_sum(4.0 * total, |t| centred.six_volumes(t)))
    }

    /// Median length of the edges of `topology` [m]; `None` for a mesh without edges.
    pub fn median_edge_length(&self, topology: &Topology) -> Option<f64> {
        median(topology.edge_lengths(self))
    }

    /// Area of each vertex [m^2]: a third of its triangles, shape `[vertex_count]`.
    pub fn vertex_areas(&self) -> Vec<f64> {
        let mut areas = vec![0.0; self.vertices.len()];
        for &t in &self.triangles {
            let third = triangle_area(&self.vertices, t) / 3.0;
            for v in t {
                areas[v as usize] += third;
            }
        }
        areas
    }

    /// Unit normal of each vertex, weighted by area; zero for a vertex without triangles, shape `[vertex_count]`.
    pub fn vertex_normals(&self) -> Vec<Vector3<f64>> {
        let mut normals = vec![Vector3::zeros(); self.vertices.len()];
        for (t, corners) in self.triangles.iter().enumerate() {
            let [a, b, c] = self.corners(t);
            let normal = (b - a).cross(&(c - a));
            for &v in corners {
                normals[v as usize] += normal;
            }
        }
        normals
            .iter()
            .map(|n| n.try_normalize(0.0).unwrap_or_default())
            .collect()
    }

    /// Smallest angle of each triangle [rad]; zero for one without area, shape `[triangle_count]`.
    pub fn smallest_angles(&self) -> Vec<f64> {
        (0..self.triangles.len())
            .map(|t| smallest_angle(self.corners(t)))
            .collect()
    }
}

/// Smallest angle of a triangle [rad] from its corners [m]; zero for one without area.
pub fn smallest_angle([a, b, c]: [Point3<f64>; 3]) -> f64 {
    let double_area = (b - a).cross(&(c - a)).norm();
    let at = |p: Point3<f64>, q: Point3<f64>, r: Point3<f64>| {
        libm::atan2(double_area, (q - p).dot(&(r - p)))
    };
    if double_area > 0.0 {
        at(a, b, c).min(at(b, c, a)).min(at(c, a, b))
    } else {
        0.0
    }
}

/// The greatest of non-negative numbers; 0 for none. NaN if one of them is NaN, which `f64::max`
/// would hide.
pub fn max_or_nan(numbers: impl IntoIterator<Item = f64>) -> f64 {
    numbers.into_iter().fold(
        0.0,
        |most: f64, n| if n <= most || most.is_nan() { most } else { n },
    )
}

/// Median of positive lengths [m], the mean of the two middle ones for an even count; `None` for no
/// lengths.
pub fn median(mut lengths: Vec<f64>) -> Option<f64> {
    if lengths.is_empty() {
        return None;
    }
    let middle = lengths.len() / 2;
    let even = lengths.len().is_multiple_of(2);
    let (below, &mut upper, _) = lengths.select_nth_unstable_by(middle, f64::total_cmp);
    let lower = if even {
        below.iter().copied().max_by(f64::total_cmp)
    } else {
        None
    };
    Some(lower.map_or(upper, |lower| 0.5 * (lower + upper)))
}

/// The number that a share (0 to 1) of all numbers does not exceed; `None` for no numbers. NaN is
/// the greatest.
pub fn quantile(mut all: Vec<f64>, share: f64) -> Option<f64> {
    let last = all.len().checked_sub(1)?;
    let at = (share * last as f64).round() as usize;
    Some(*all.select_nth_unstable_by(at.min(last), f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes::{icosphere, tetrahedron};
    use nalgebra::UnitQuaternion;
    use proptest::prelude::*;

    fn rotated(mesh: &TriangleMesh, pose: &Isometry3<f64>) -> TriangleMesh {
        TriangleMesh {
            vertices: mesh.vertices.iter().map(|p| pose * p).collect(),
            ..mesh.clone()
        }
    }

    #[test]
    fn regular_tetrahedron() {
        let m = tetrahedron();
        let edge = (8.0f64 / 3.0).sqrt();
        assert!((m.volume() - edge.powi(3) / 72f64.sqrt()).abs() < 4e-16);
        assert!((m.volume() - 0.513_200).abs() < 5e-7);
        assert!(
            (m.median_edge_length(&Topology::new(&m)).expect("edges") - 1.632_993).abs() < 5e-7
        );
        for a in triangle_areas(&m.vertices, &m.triangles) {
            assert!((a - 1.154_701).abs() < 5e-7);
        }
        assert!(m.centroid().expect("volume").coords.norm() < 1e-15);
        assert!(m.surface_centroid().expect("area").coords.norm() < 1e-15);
        assert!((m.length() - edge).abs() < 1e-15);
        for angle in m.smallest_angles() {
            assert!((angle.to_degrees() - 60.0).abs() < 1e-12);
        }
        let inside_out = TriangleMesh {
            triangles: m.triangles.iter().map(|&[a, b, c]| [a, c, b]).collect(),
            ..m
        };
        assert!(inside_out.volume() < -0.5);
    }

    #[test]
    fn sphere_converges_with_order_two() {
        let (volume, area) = (4.0 / 3.0 * std::f64::consts::PI, 4.0 * std::f64::consts::PI);
        let errors: Vec<[f64; 2]> = (2..6)
            .map(|n| icosphere(1.0, n))
            .map(|m| [volume - m.volume(), area - m.area()])
            .collect();
        for pair in errors.windows(2) {
            for (coarse, fine) in pair[0].iter().zip(pair[1]) {
                let order = (coarse / fine).log2();
                assert!((order - 2.0).abs() < 0.06, "order {order}");
            }
        }
        let m = icosphere(2.0, 3);
        let total: f64 = m.vertex_areas().iter().sum();
        assert!((total - m.area()).abs() < 1e-12 * total);
        for (p, n) in m.vertices.iter().zip(m.vertex_normals()) {
            assert!(n.dot(&p.coords.normalize()) > 0.999);
        }
    }

    #[test]
    fn centroids_of_volume_and_of_surface_differ() {
        // A tetrahedron with one long corner: centroids of volume and of surface are both known.
        let vertices = [
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, 0.0, 3.0],
        ];
        let m = TriangleMesh {
            vertices: vertices.iter().map(|&v| Point3::from(v)).collect(),
            triangles: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
        };
        assert!((m.volume() - 0.5).abs() < 1e-15);
        assert!((m.centroid().expect("volume") - Point3::new(0.25, 0.25, 0.75)).norm() < 1e-15);
        let slanted = 0.5 * 19f64.sqrt();
        let third = 1.0 / 3.0;
        let x = (0.5 * third + 1.5 * third + slanted * third) / (3.5 + slanted);
        let z = (1.5 + 1.5 + slanted) / (3.5 + slanted);
        assert!((m.surface_centroid().expect("area") - Point3::new(x, x, z)).norm() < 1e-15);
    }

    #[test]
    fn medians() {
        assert_eq!(median(vec![]), None);
        assert_eq!(median(vec![3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median(vec![4.0, 1.0, 2.0, 8.0]), Some(3.0));
    }

    #[test]
    fn empty_boxes() {
        let unit = Aabb {
            min: Point3::origin(),
            max: Point3::new(1.0, 1.0, 1.0),
        };
        assert!(Aabb::EMPTY.is_empty() && !unit.is_empty());
        assert_eq!(Aabb::EMPTY.union(&unit), unit);
        assert!(!Aabb::EMPTY.intersects(&unit) && !unit.intersects(&Aabb::EMPTY));
        assert!(unit.inflate(-0.6).is_empty());
        assert!(unit.intersects(&Aabb {
            min: unit.max,
            max: unit.max
        }));
        assert_eq!(TriangleMesh::default().volume(), 0.0);
        assert_eq!(TriangleMesh::default().centroid(), None);
        assert_eq!(TriangleMesh::default().length(), 0.0);
    }

    fn vector(size: f64) -> impl Strategy<Value = Vector3<f64>> {
        prop::array::uniform3(-size..size).prop_map(Vector3::from)
    }

    proptest! {
        #[test]
        fn exact_translation_changes_no_bit(shift in prop::array::uniform3(-4096i32..4096)) {
            // Coordinates on a grid of 2^-20 m and whole-metre shifts: no coordinate is rounded by the move.
            let grid = f64::from(1 << 20);
            let mut m = icosphere(0.3, 3);
            m.vertices.iter_mut().for_each(|p| *p = p.map(|c| (c * grid).round() / grid));
            let by = Vector3::from(shift).map(f64::from);
            let moved = TriangleMesh { vertices: m.vertices.iter().map(|p| p + by).collect(), ..m.clone() };
            prop_assert_eq!(moved.volume().to_bits(), m.volume().to_bits());
            prop_assert_eq!(moved.area().to_bits(), m.area().to_bits());
            prop_assert_eq!(moved.length().to_bits(), m.length().to_bits());
        }

        #[test]
        fn pose_and_scale(axis in vector(3.0), by in vector(10.0), scale in prop::sample::select(vec![1e-3, 1.0, 1e3])) {
            let pose = Isometry3::from_parts((by * scale).into(), UnitQuaternion::from_scaled_axis(axis));
            let mut m = tetrahedron();
            m.vertices.iter_mut().for_each(|p| *p *= scale);
            let moved = rotated(&m, &pose);
            let s3 = scale * scale * scale;
            // Coordinates up to 18 times the size are rounded by the move.
            prop_assert!((moved.volume() - m.volume()).abs() < 1e-14 * s3);
            prop_assert!((moved.area() - m.area()).abs() < 1e-13 * scale * scale);
            let centroid = moved.centroid().expect("volume");
            prop_assert!((centroid - pose * Point3::origin()).norm() < 1e-13 * scale);
            let around = m.bounding_box().transformed(&pose).inflate(1e-13 * scale);
            prop_assert!(moved.vertices.iter().all(|p| around.contains(p)));
        }

        #[test]
        fn transformed_box_is_the_tight_one(axis in vector(3.0), low in vector(1.0), size in vector(1.0)) {
            let b = Aabb { min: low.into(), max: (low + size.abs()).into() };
            let pose = Isometry3::new(low, axis);
            let corner = |k: usize, bit: usize| if k >> bit & 1 == 0 { b.min[bit] } else { b.max[bit] };
            let corners: Vec<_> = (0..8).map(|k| pose * Point3::new(corner(k, 0), corner(k, 1), corner(k, 2))).collect();
            let tight = Aabb::of_points(&corners);
            let got = b.transformed(&pose);
            prop_assert!((got.min - tight.min).norm() < 1e-14 && (got.max - tight.max).norm() < 1e-14);
            prop_assert!(b.inflate(1e-14).contains(&b.center()));
            prop_assert!(b.union(&tight).intersects(&tight));
        }
    }

    #[test]
    fn the_greatest_does_not_hide_what_is_no_number() {
        assert_eq!(max_or_nan([]), 0.0);
        assert_eq!(max_or_nan([1.0, 3.0, 2.0]), 3.0);
        assert!(max_or_nan([1.0, f64::NAN, 2.0]).is_nan() && max_or_nan([f64::NAN, 5.0]).is_nan());
    }
}
