//! Cuts of surfaces at the zero set of a function: a plane, a sphere, or an isovalue of a field.

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};

use super::TriangleMesh;

/// The part of a surface where a function is not negative.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cut {
    /// The kept part; triangles keep their orientation.
    pub mesh: TriangleMesh,
    /// Value at each vertex of the part, interpolated linearly between the given values.
    pub values: Vec<f64>,
    /// Segments of the zero line, each with both ends [m].
    pub line: Vec<Vec<Point3<f64>>>,
}

/// Keeps the part of a surface where `height` is not negative. `height` is a number at each vertex
/// and linear between vertices. Triangles with a missing or NaN height or corner are left out.
pub fn cut(mesh: &TriangleMesh, values: &[f64], height: &[f64]) -> Cut {
    let mut cut = Cut::default();
    let mut kept: BTreeMap<[u32; 2], u32> = BTreeMap::new();
    let value = |v: u32| values.get(v as usize).copied().unwrap_or(f64::NAN);
    for t in &mesh.triangles {
        let known = t.map(|v| {
            mesh.vertices
                .get(v as usize)
                .and_then(|p| Some((*p, *height.get(v as usize)?)))
        });
        let [Some(a), Some(b), Some(c)] = known else {
            continue;
        };
        let corners = [a, b, c];
        if corners.iter().any(|(_, h)| h.is_nan()) {
            continue;
        }
        let mut polygon = Vec::new();
        let mut crossed = Vec::new();
        for k in 0..3 {
            let (i, j) = (k, (k + 1) % 3);
            if corners[i].1 >= 0.0 {
                polygon.push(*kept.entry([t[i], t[i]]).or_insert_with(|| {
                    cut.mesh.vertices.push(corners[i].0);
                    cut.values.push(value(t[i]));
                    cut.values.len() as u32 - 1
                }));
            }
            if (corners[i].1 >= 0.0) != (corners[j].1 >= 0.0) {
                // From the same end for both triangles at the edge, so that the cuts match.
                let (from, to) = if t[i] < t[j] { (i, j) } else { (j, i) };
                let share = corners[from].1 / (corners[from].1 - corners[to].1);
                let at = *kept.entry([t[from], t[to]]).or_insert_with(|| {
                    cut.mesh
                        .vertices
                        .push(corners[from].0 + (corners[to].0 - corners[from].0) * share);
                    cut.values
                        .push(value(t[from]) * (1.0 - share) + value(t[to]) * share);
                    cut.values.len() as u32 - 1
                });
                polygon.push(at);
                crossed.push(at);
            }
        }
        (2..polygon.len()).for_each(|k| {
            cut.mesh
                .triangles
                .push([polygon[0], polygon[k - 1], polygon[k]])
        });
        if let [from, to] = crossed[..] {
            cut.line
                .push([from, to].map(|v| cut.mesh.vertices[v as usize]).to_vec());
        }
    }
    cut
}

/// The ends of a segment with their heights, the lower end first.
type Segment = [(f64, Point3<f64>); 2];

/// The region inside closed lines of one plane, as triangles that face `normal`; of nested lines
/// every other one is a hole. The method uses strips between neighbouring segment ends, so the
/// order of the segments does not matter.
pub fn filled(line: &[Vec<Point3<f64>>], normal: &Vector3<f64>) -> TriangleMesh {
    let mut mesh = TriangleMesh::default();
    let Some(normal) = normal.try_normalize(0.0) else {
        return mesh;
    };
    let axis = Vector3::ith(normal.map(f64::abs).imin(), 1.0);
    let across = normal.cross(&axis).normalize();
    let along = normal.cross(&across);
    // The lower end first, by transverse height.
    let mut segments: Vec<Segment> = Vec::new();
    for ends in line.iter().flat_map(|l| l.windows(2)) {
        let mut ends = [ends[0], ends[1]].map(|p| (p.coords.dot(&across), p));
        ends.sort_by(|a, b| a.0.total_cmp(&b.0));
        if ends[0].0 < ends[1].0 {
            segments.push(ends);
        }
    }
    segments.sort_by(|a, b| a[0].0.total_cmp(&b[0].0));
    let mut heights: Vec<f64> = segments.iter().flatten().map(|end| end.0).collect();
    heights.sort_by(f64::total_cmp);
    heights.dedup();
    let (mut next, mut open): (usize, Vec<Segment>) = (0, Vec::new());
    for pair in heights.windows(2) {
        open.retain(|s| s[1].0 >= pair[1]);
        while let Some(segment) = segments.get(next).filter(|s| s[0].0 <= pair[0]) {
            open.push(*segment);
            next += 1;
        }
        let at =
            |s: &Segment, h: f64| s[0].1 + (s[1].1 - s[0].1) * ((h - s[0].0) / (s[1].0 - s[0].0));
        let place = |s: &Segment| at(s, f64::midpoint(pair[0], pair[1])).coords.dot(&along);
        open.sort_by(|a, b| place(a).total_cmp(&place(b)));
        for sides in open.chunks_exact(2) {
            let first = mesh.vertices.len() as u32;
            mesh.vertices.extend(
                [0, 1]
                    .into_iter()
                    .flat_map(|k| pair.iter().map(move |h| (k, *h)))
                    .map(|(k, h)| at(&sides[k], h)),
            );
            mesh.triangles
                .extend([[first, first + 1, first + 3], [first, first + 3, first + 2]]);
        }
    }
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Topology;
    use crate::mesh::shapes::icosphere;

    #[test]
    fn half_a_sphere_has_half_its_area_and_a_round_rim() {
        let ball = icosphere(1.0, 4);
        // Through no vertex, so that triangles which only touch the plane leave nothing.
        let heights: Vec<f64> = ball
            .vertices
            .iter()
            .map(|p| p.z + 0.3 * p.x - 1e-3)
            .collect();
        let x: Vec<f64> = ball.vertices.iter().map(|p| p.x).collect();
        let half = cut(&ball, &x, &heights);
        let other = cut(&ball, &x, &heights.iter().map(|h| -h).collect::<Vec<_>>());
        assert!((half.mesh.area() + other.mesh.area() - ball.area()).abs() <= 1e-12);
        assert!((half.mesh.area() / ball.area() - 0.5).abs() <= 1e-3);
        let length: f64 = half.line.iter().map(|s| (s[1] - s[0]).norm()).sum();
        assert!(
            (length / std::f64::consts::TAU - 1.0).abs() <= 2e-3,
            "{length}"
        );
        let topology = Topology::new(&half.mesh);
        assert!(topology.is_oriented() && topology.boundary_edges().len() == half.line.len());
        for (p, value) in half.mesh.vertices.iter().zip(&half.values) {
            assert!((p.x - value).abs() <= 1e-12 && p.z + 0.3 * p.x - 1e-3 >= -1e-12);
        }
    }

    #[test]
    fn what_is_cut_is_filled_with_its_holes() {
        let (ball, small) = (icosphere(1.0, 4), icosphere(0.5, 4));
        let normal = Vector3::new(0.3, -0.2, 1.0).normalize();
        let at = |mesh: &TriangleMesh| {
            let heights: Vec<f64> = mesh
                .vertices
                .iter()
                .map(|p| p.coords.dot(&normal) - 0.1234)
                .collect();
            cut(mesh, &[], &heights).line
        };
        let line = [at(&ball), at(&small)].concat();
        let ring = filled(&line, &normal);
        let circle = |radius: f64| std::f64::consts::PI * (radius * radius - 0.1234 * 0.1234);
        assert!(
            (ring.area() / (circle(1.0) - circle(0.5)) - 1.0).abs() <= 5e-3,
            "{}",
            ring.area()
        );
        assert!((filled(&at(&ball), &normal).area() / circle(1.0) - 1.0).abs() <= 5e-3);
        let facing = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| ring.vertices[v as usize]);
            (b - a).cross(&(c - a)).dot(&normal)
        };
        assert!(ring.triangles.iter().all(|t| facing(t) >= -1e-15));
        assert!(
            ring.vertices
                .iter()
                .all(|p| (p.coords.dot(&normal) - 0.1234).abs() <= 1e-12)
        );
        assert!(
            filled(&[], &normal).triangles.is_empty()
                && filled(&line, &Vector3::zeros()).triangles.is_empty()
        );
    }

    #[test]
    fn all_nothing_and_what_is_no_number() {
        let ball = icosphere(1.0, 1);
        let of = |height: f64| cut(&ball, &[], &vec![height; ball.vertices.len()]);
        assert_eq!(of(0.0).mesh.triangles.len(), ball.triangles.len());
        assert!(
            of(0.0).line.is_empty()
                && of(-1.0).mesh.triangles.is_empty()
                && of(f64::NAN).mesh.triangles.is_empty()
        );
        assert!(cut(&ball, &[], &[1.0; 3]).mesh.triangles.len() < ball.triangles.len());
    }
}
