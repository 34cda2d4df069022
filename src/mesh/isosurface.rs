//! The zero set of a function as a closed mesh: surface nets, then projection of the vertices onto
//! the set.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::TriangleMesh;

const NONE: u32 = u32::MAX;
/// Newton steps per vertex; the first leaves an error of second order in the cell, the last leaves
/// rounding error.
const NEWTON_STEPS: usize = 4;

/// The surface where `distance` [m] is zero, negative inside, within the box from `lo` to `hi` [m], closed.
///
/// The mesh has one vertex for each cell of side `cell` [m] that the surface crosses. Newton steps
/// along the gradient move it onto the zero set. Four cells around a crossed grid edge give two
/// triangles. The surface is manifold where the cell resolves the shape: no sheet or gap is thinner
/// than two cells. A body that leaves the box is cut off at the box. The mesh is empty if nothing
/// is inside or `cell` is not positive.
pub fn isosurface(
    distance: impl Fn(Point3<f64>) -> f64 + Sync,
    lo: Point3<f64>,
    hi: Point3<f64>,
    cell: f64,
) -> TriangleMesh {
    if !(cell > 0.0 && lo < hi) {
        return TriangleMesh::default();
    }
    let grid = Grid::new(lo, hi, cell);
    let values = grid.sample(&distance);
    let (mut vertices, cells) = grid.vertices(&values);
    draw_onto_zero(&distance, &mut vertices, cell);
    let triangles = grid.triangles(&values, &cells, &vertices);
    TriangleMesh {
        vertices,
        triangles,
    }
}

/// Projects points near the zero set of `distance` [m] onto it; no point moves by more than `reach`
/// [m].
///
/// Newton steps use a gradient from differences. A point that would move farther stops after its
/// last allowed step.
pub fn draw_onto_zero(
    distance: &(impl Fn(Point3<f64>) -> f64 + Sync),
    points: &mut [Point3<f64>],
    reach: f64,
) {
    points
        .par_iter_mut()
        .for_each(|p| *p = drawn_onto_zero(distance, *p, reach));
}

/// Newton steps along the gradient, limited to the cell's size so that a kink does not move a
/// vertex far away.
fn drawn_onto_zero(
    distance: &impl Fn(Point3<f64>) -> f64,
    start: Point3<f64>,
    reach: f64,
) -> Point3<f64> {
    let step = 1e-4 * reach;
    let mut p = start;
    for _ in 0..NEWTON_STEPS {
        let value = distance(p);
        let slope = |axis: Vector3<f64>| {
            (distance(p + axis * step) - distance(p - axis * step)) / (2.0 * step)
        };
        let gradient = Vector3::new(
            slope(Vector3::x()),
            slope(Vector3::y()),
            slope(Vector3::z()),
        );
        let square = gradient.norm_squared();
        if square.is_nan() || square < 1e-6 {
            break;
        }
        let next = p - gradient * (value / square);
        if (next - start).norm() > reach {
            break;
        }
        p = next;
    }
    p
}

/// A grid of `counts` samples in each direction; cell `(i, j, k)` has sample `(i, j, k)` as its lowest corner.
struct Grid {
    lo: Point3<f64>,
    cell: f64,
    counts: [usize; 3],
}

impl Grid {
    fn new(lo: Point3<f64>, hi: Point3<f64>, cell: f64) -> Self {
        let size = hi - lo;
        Self {
            lo,
            cell,
            counts: [0, 1, 2].map(|k| (size[k] / cell).ceil() as usize + 1),
        }
    }

    fn index(&self, [i, j, k]: [usize; 3]) -> usize {
        (k * self.counts[1] + j) * self.counts[0] + i
    }

    fn position(&self, at: [usize; 3]) -> Point3<f64> {
        self.lo + Vector3::from(at.map(|n| n as f64)) * self.cell
    }

    fn sample(&self, distance: &(impl Fn(Point3<f64>) -> f64 + Sync)) -> Vec<f64> {
        let [nx, ny, nz] = self.counts;
        let mut values = vec![0.0; nx * ny * nz];
        values
            .par_chunks_mut(nx)
            .enumerate()
            .for_each(|(row, line)| {
                let (j, k) = (row % ny, row / ny);
                for (i, value) in line.iter_mut().enumerate() {
                    *value = distance(self.position([i, j, k]));
                    let at_rim = [i, j, k]
                        .iter()
                        .zip(self.counts)
                        .any(|(&n, count)| n == 0 || n + 1 == count);
                    // All border samples are outside: the surface is closed even where the body
                    // leaves the box.
                    if at_rim && (*value <= 0.0 || value.is_nan()) {
                        *value = 0.5 * self.cell;
                    }
                }
            });
        values
    }

    /// A vertex in each crossed cell, at the mean of the crossings of its edges, and the vertex
    /// index of each cell.
    fn vertices(&self, values: &[f64]) -> (Vec<Point3<f64>>, Vec<u32>) {
        let mut cells = vec![NONE; values.len()];
        let mut vertices = Vec::new();
        let [nx, ny, nz] = self.counts;
        for k in 0..nz - 1 {
            for j in 0..ny - 1 {
                for i in 0..nx - 1 {
                    if let Some(middle) = self.middle_of_crossings(values, [i, j, k]) {
                        cells[self.index([i, j, k])] = vertices.len() as u32;
                        vertices.push(middle);
                    }
                }
            }
        }
        (vertices, cells)
    }

    fn middle_of_crossings(&self, values: &[f64], base: [usize; 3]) -> Option<Point3<f64>> {
        let corner = |c: usize| {
            [
                base[0] + (c & 1),
                base[1] + (c >> 1 & 1),
                base[2] + (c >> 2),
            ]
        };
        let at: [f64; 8] = std::array::from_fn(|c| values[self.index(corner(c))]);
        let inside = at.iter().filter(|&&v| v < 0.0).count();
        if inside == 0 || inside == 8 {
            return None;
        }
        let (mut sum, mut crossings) = (Vector3::zeros(), 0.0);
        for from in 0..8 {
            for to in [1, 2, 4]
                .map(|bit| from | bit)
                .into_iter()
                .filter(|&to| to != from)
            {
                let (a, b) = (at[from], at[to]);
                if (a < 0.0) != (b < 0.0) {
                    let (p, q) = (self.position(corner(from)), self.position(corner(to)));
                    sum += p.coords + (q - p) * (a / (a - b));
                    crossings += 1.0;
                }
            }
        }
        Some(Point3::from(sum / crossings))
    }

    fn triangles(&self, values: &[f64], cells: &[u32], vertices: &[Point3<f64>]) -> Vec<[u32; 3]> {
        let mut triangles = Vec::new();
        let [nx, ny, nz] = self.counts;
        for (k, j, i) in (1..nz - 1)
            .flat_map(|k| (1..ny - 1).flat_map(move |j| (1..nx - 1).map(move |i| (k, j, i))))
        {
            let low = values[self.index([i, j, k])] < 0.0;
            for axis in 0..3 {
                let mut next = [i, j, k];
                next[axis] += 1;
                if low == (values[self.index(next)] < 0.0) {
                    continue;
                }
                let around = |du: usize, dv: usize| {
                    let mut cell = [i, j, k];
                    cell[(axis + 1) % 3] -= du;
                    cell[(axis + 2) % 3] -= dv;
                    cells[self.index(cell)]
                };
                // Counter-clockwise seen from the upper end of the grid edge, which is outside if
                // the lower end is inside.
                let mut quad = [around(1, 1), around(0, 1), around(0, 0), around(1, 0)];
                if !low {
                    quad.reverse();
                }
                triangles.extend(split(quad, vertices));
            }
        }
        // The edges of the first border layer have their lower end on the border.
        self.rim_triangles(values, cells, vertices, &mut triangles);
        triangles
    }

    fn rim_triangles(
        &self,
        values: &[f64],
        cells: &[u32],
        vertices: &[Point3<f64>],
        out: &mut Vec<[u32; 3]>,
    ) {
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            for (a, b) in
                (1..self.counts[u] - 1).flat_map(|a| (1..self.counts[v] - 1).map(move |b| (a, b)))
            {
                let mut at = [0; 3];
                (at[axis], at[u], at[v]) = (1, a, b);
                if values[self.index(at)] >= 0.0 {
                    continue;
                }
                let around = |du: usize, dv: usize| {
                    let mut cell = [0; 3];
                    (cell[axis], cell[u], cell[v]) = (0, a - du, b - dv);
                    cells[self.index(cell)]
                };
                out.extend(split(
                    [around(1, 0), around(0, 0), around(0, 1), around(1, 1)],
                    vertices,
                ));
            }
        }
    }
}

/// Splits a quad along its shorter diagonal.
fn split([a, b, c, d]: [u32; 4], vertices: &[Point3<f64>]) -> [[u32; 3]; 2] {
    let square = |p: u32, q: u32| (vertices[p as usize] - vertices[q as usize]).norm_squared();
    if square(a, c) <= square(b, d) {
        [[a, b, c], [a, c, d]]
    } else {
        [[a, b, d], [b, c, d]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Topology;
    use proptest::prelude::*;

    fn sphere(center: Point3<f64>, radius: f64) -> impl Fn(Point3<f64>) -> f64 {
        move |p| (p - center).norm() - radius
    }

    fn assert_sound(m: &TriangleMesh, euler: i64) {
        let t = Topology::new(m);
        assert!(t.is_closed() && t.is_oriented());
        assert_eq!(t.euler_characteristic(), euler);
        assert!(t.non_manifold_vertices(m).is_empty());
        assert!(m.volume() > 0.0);
    }

    #[test]
    fn torus_has_genus_one() {
        let torus = |p: Point3<f64>| (p.x.hypot(p.z) - 1.0).hypot(p.y) - 0.4;
        let m = isosurface(
            torus,
            Point3::new(-1.6, -0.6, -1.6),
            Point3::new(1.6, 0.6, 1.6),
            0.1,
        );
        assert_sound(&m, 0);
        let volume = 2.0 * (std::f64::consts::PI * 0.4).powi(2);
        assert!((m.volume() / volume - 1.0).abs() < 0.02);
        assert!(m.vertices.iter().all(|&p| torus(p).abs() < 1e-9));
    }

    #[test]
    fn a_body_that_leaves_the_box_is_closed() {
        let m = isosurface(
            sphere(Point3::origin(), 1.0),
            Point3::new(-0.7, -2.0, -2.0),
            Point3::new(2.0, 0.5, 0.3),
            0.1,
        );
        assert_sound(&m, 2);
        let b = m.bounding_box();
        assert!(b.min.x > -0.75 && b.max.y < 0.55 && b.max.z < 0.35 && b.max.x > 0.99);
    }

    #[test]
    fn nothing_inside() {
        let corner = Point3::new(1.0, 1.0, 1.0);
        assert_eq!(
            isosurface(|_| 1.0, -corner, corner, 0.1),
            TriangleMesh::default()
        );
        assert_eq!(
            isosurface(|_| -1.0, -corner, corner, 0.0),
            TriangleMesh::default()
        );
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn spheres(center in prop::array::uniform3(-0.3f64..0.3), radius in 0.5f64..0.9, scale in prop::sample::select(vec![1e-3, 1.0, 1e3])) {
            let (center, radius) = (Point3::from(center) * scale, radius * scale);
            let corner = Point3::new(1.3, 1.3, 1.3) * scale;
            let m = isosurface(sphere(center, radius), -corner, corner, 0.1 * scale);
            assert_sound(&m, 2);
            prop_assert!(m.vertices.iter().all(|p| ((p - center).norm() - radius).abs() < 1e-12 * scale));
            let volume = 4.0 / 3.0 * std::f64::consts::PI * radius.powi(3);
            prop_assert!((m.volume() / volume - 1.0).abs() < 0.02);
            for (p, n) in m.vertices.iter().zip(m.vertex_normals()) {
                prop_assert!(n.dot(&(p - center).normalize()) > 0.95);
            }
        }
    }
}
