//! Lengthens a body by a tube at a cut end, as a tendon goes on from a muscle.

use std::f64::consts::TAU;

use nalgebra::{Complex, Point3, Unit, Vector3};

use super::TriangleMesh;
use super::boundary::rims;
use super::cut::cut;
use super::topology::Topology;

/// Fewest vertices around a tube.
const AROUND: f64 = 8.0;

/// The rim becomes round within this many of its mean radii, and within this part of the tube.
const ROUND: f64 = 2.0;
const PART: f64 = 0.7;

/// Latitudes of the rings of the round end [rad].
const LATITUDES: [f64; 2] = [TAU / 12.0, TAU / 6.0];

/// The part of a closed surface where `height`, a number at each vertex, is not negative, and its only rim:
/// vertices in order, counter-clockwise seen from the side that is cut off. `None` if the part has another
/// number of rims or of pieces.
pub fn stump(mesh: &TriangleMesh, height: &[f64]) -> Option<(TriangleMesh, Vec<u32>)> {
    let part = cut(mesh, &[], height).mesh;
    let topology = Topology::new(&part);
    let rims = rims(&topology);
    let [rim] = rims.as_slice() else { return None };
    if !rim.closed || topology.components().count != 1 {
        return None;
    }
    let mut rim = rim.vertices.clone();
    let edge = topology.find_edge(*rim.first()?, *rim.get(1)?)?;
    let [t] = *topology.triangles_of_edge(edge as usize) else {
        return None;
    };
    let [a, b, c] = part.triangles[t as usize];
    // A new triangle has an edge in the other direction than the one beside it.
    if [[a, b], [b, c], [c, a]].contains(&[rim[0], rim[1]]) {
        rim.reverse();
    }
    Some((part, rim))
}

/// The middle of a rim, and the direction out of the body.
pub fn rim_pose(stump: &TriangleMesh, rim: &[u32]) -> Option<(Point3<f64>, Unit<Vector3<f64>>)> {
    let at = |k: usize| stump.vertices[rim[k % rim.len()] as usize];
    let (mut middle, mut whole) = (Vector3::zeros(), 0.0);
    for k in 0..rim.len() {
        let length = (at(k + 1) - at(k)).norm();
        middle += (at(k).coords + at(k + 1).coords) * (0.5 * length);
        whole += length;
    }
    let middle = Point3::from(middle / whole);
    let area = |k: usize| (at(k) - middle).cross(&(at(k + 1) - middle));
    let out = Unit::try_new((0..rim.len()).map(area).sum(), 0.0)?;
    Some((middle, out))
}

/// A stump with a round tube of a `radius` [m] from its `rim` along a `path` [m], closed at its end, and the
/// triangles of its last radius and of its round end. The rim becomes round within a few of its radii. The path
/// begins at the middle of the rim. `None` for a path without length, or a radius that is not positive. Where a
/// path bends sharply, the surface crosses itself.
pub fn lengthened(
    stump: &TriangleMesh,
    rim: &[u32],
    path: &[Point3<f64>],
    radius: f64,
) -> Option<(TriangleMesh, Vec<u32>)> {
    if !(radius > 0.0 && radius.is_finite()) {
        return None;
    }
    let (middle, out) = rim_pose(stump, rim)?;
    let edge = stump.median_edge_length(&Topology::new(stump))?;
    let path = Polyline::new(path)?;
    let mut frame = carried(&least_axis(&out), &out)?;

    // Of each place on the rim, its share of the whole length, and its offset in the frame.
    let places = Loop::new(stump, rim);
    let count = (TAU * radius / edge)
        .clamp(AROUND, f64::from(u16::MAX))
        .round() as usize;
    let shares: Vec<f64> = (0..count).map(|j| j as f64 / count as f64).collect();
    let offsets: Vec<Vector3<f64>> = shares
        .iter()
        .map(|u| places.at(*u) - middle)
        .map(|o| Vector3::new(frame[0].dot(&o), frame[1].dot(&o), frame[2].dot(&o)))
        .collect();
    // The rotation of the circle that is nearest to the rim.
    let turned =
        |(u, o): (&f64, &Vector3<f64>)| Complex::new(o.x, o.y) * Complex::from_polar(1.0, -TAU * u);
    let first: Complex<f64> = shares.iter().zip(&offsets).map(turned).sum();
    let circle = |u: f64| {
        let (sine, cosine) = (TAU * u + first.arg()).sin_cos();
        Vector3::new(cosine, sine, 0.0)
    };
    let mean = offsets.iter().map(|o| o.xy().norm()).sum::<f64>() / count as f64;
    let taper = (ROUND * mean).min(PART * path.length());

    let mut built = Built {
        mesh: stump.clone(),
        ring: rim.to_vec(),
        shares: places.shares.clone(),
    };
    let steps = (path.length() / edge).ceil().max(2.0) as usize;
    let mut tip = None;
    for k in 1..=steps {
        let along = path.length() * k as f64 / steps as f64;
        let part = (along / taper).min(1.0);
        let round = part * part * (3.0 - 2.0 * part);
        // Wide rings that turn at once would cross.
        let width = mean + (radius - mean) * round;
        let ahead = path.direction(along, width.max(edge).min(taper));
        let direction = *out * (1.0 - round) + ahead * round;
        frame = carried(&frame[0], &direction)?;
        let ring = shares.iter().zip(&offsets).map(|(u, offset)| {
            let local = offset * (1.0 - round) + circle(*u) * (round * radius);
            path.at(along) + frame[0] * local.x + frame[1] * local.y + frame[2] * local.z
        });
        if tip.is_none() && path.length() - along <= radius {
            tip = Some(built.mesh.triangles.len());
        }
        built.add(ring.collect(), &shares);
    }
    let end = path.at(path.length());
    for latitude in LATITUDES {
        let (sine, cosine) = latitude.sin_cos();
        let ring = shares.iter().map(|u| {
            let local = circle(*u) * (cosine * radius);
            end + frame[0] * local.x + frame[1] * local.y + frame[2] * (sine * radius)
        });
        built.add(ring.collect(), &shares);
    }
    built.close(end + frame[2] * radius);
    let tip = tip.unwrap_or(stump.triangles.len())..built.mesh.triangles.len();
    Some((built.mesh, tip.map(|t| t as u32).collect()))
}

/// A frame whose third axis is a direction, and whose first one is as near to `first` as can be.
fn carried(first: &Vector3<f64>, direction: &Vector3<f64>) -> Option<[Vector3<f64>; 3]> {
    let out = Unit::try_new(*direction, 0.0)?;
    let across = Unit::try_new(first - out.scale(out.dot(first)), 0.0)?;
    Some([*across, out.cross(&across), *out])
}

/// The axis of the coordinates that is least along a direction.
fn least_axis(direction: &Vector3<f64>) -> Vector3<f64> {
    let mut axis = Vector3::zeros();
    axis[direction.iamin()] = 1.0;
    axis
}

/// A closed loop of vertices.
struct Loop {
    points: Vec<Point3<f64>>,
    /// The share of the whole length before each vertex.
    shares: Vec<f64>,
}

impl Loop {
    fn new(mesh: &TriangleMesh, vertices: &[u32]) -> Self {
        let points: Vec<Point3<f64>> = vertices
            .iter()
            .map(|&v| mesh.vertices[v as usize])
            .collect();
        let (mut before, mut shares) = (0.0, Vec::new());
        for (k, p) in points.iter().enumerate() {
            shares.push(before);
            before += (points[(k + 1) % points.len()] - p).norm();
        }
        shares.iter_mut().for_each(|s| *s /= before);
        Self { points, shares }
    }

    /// The point at a share of the whole length.
    fn at(&self, share: f64) -> Point3<f64> {
        let next = self.shares.partition_point(|s| *s <= share);
        let k = next.max(1) - 1;
        let after = self.shares.get(next).copied().unwrap_or(1.0);
        let part = (share - self.shares[k]) / (after - self.shares[k]);
        let [a, b] = [self.points[k], self.points[next % self.points.len()]];
        if part.is_finite() {
            a + (b - a) * part
        } else {
            a
        }
    }
}

/// A path of straight pieces.
struct Polyline {
    points: Vec<Point3<f64>>,
    /// Length up to each point [m].
    along: Vec<f64>,
}

impl Polyline {
    fn new(points: &[Point3<f64>]) -> Option<Self> {
        let mut along = vec![0.0];
        for pair in points.windows(2) {
            along.push(along[along.len() - 1] + (pair[1] - pair[0]).norm());
        }
        let is_long = along.len() > 1 && along[along.len() - 1] > 0.0;
        let points = points.to_vec();
        is_long.then_some(Self { points, along })
    }

    fn length(&self) -> f64 {
        self.along[self.along.len() - 1]
    }

    fn at(&self, along: f64) -> Point3<f64> {
        let last = self.points.len() - 1;
        let k = self.along.partition_point(|a| *a <= along).clamp(1, last);
        let piece = self.along[k] - self.along[k - 1];
        let part = ((along - self.along[k - 1]) / piece).clamp(0.0, 1.0);
        let [a, b] = [self.points[k - 1], self.points[k]];
        if part.is_finite() {
            a + (b - a) * part
        } else {
            b
        }
    }

    /// The direction between two places, one a `step` before and one after [m].
    fn direction(&self, along: f64, step: f64) -> Vector3<f64> {
        let [before, after] = [(along - step).max(0.0), (along + step).min(self.length())];
        (self.at(after) - self.at(before)).normalize()
    }
}

/// A surface that grows ring by ring.
struct Built {
    mesh: TriangleMesh,
    /// The last ring, and the share of the whole length at each of its vertices.
    ring: Vec<u32>,
    shares: Vec<f64>,
}

impl Built {
    /// Joins a ring to the last one: each edge of both gets a triangle.
    fn add(&mut self, points: Vec<Point3<f64>>, shares: &[f64]) {
        let first = self.mesh.vertices.len() as u32;
        let next: Vec<u32> = (0..points.len() as u32).map(|j| first + j).collect();
        self.mesh.vertices.extend(points);
        let (m, n) = (self.ring.len(), next.len());
        let share = |of: &[f64], k: usize| of.get(k).copied().unwrap_or(1.0);
        let (mut i, mut j) = (0, 0);
        while i < m || j < n {
            let is_below = share(&self.shares, i + 1) <= share(shares, j + 1);
            let [a, b] = [self.ring[i % m], next[j % n]];
            if j == n || i < m && is_below {
                i += 1;
                self.mesh.triangles.push([a, self.ring[i % m], b]);
            } else {
                j += 1;
                self.mesh.triangles.push([a, next[j % n], b]);
            }
        }
        self.ring = next;
        self.shares = shares.to_vec();
    }

    /// Closes the last ring with a point.
    fn close(&mut self, point: Point3<f64>) {
        let pole = self.mesh.vertices.len() as u32;
        self.mesh.vertices.push(point);
        for k in 0..self.ring.len() {
            let pair = [self.ring[k], self.ring[(k + 1) % self.ring.len()]];
            self.mesh.triangles.push([pair[0], pair[1], pole]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes::icosphere;
    use crate::mesh::{Finding, FindingKind, Health};

    /// A ball of 3 cm without what lies above 2 cm, and the rim.
    fn cut_ball() -> (TriangleMesh, Vec<u32>) {
        let ball = icosphere(0.03, 4);
        let height: Vec<f64> = ball.vertices.iter().map(|v| 0.02 - v.z).collect();
        stump(&ball, &height).expect("one rim")
    }

    /// Fit, and without crossings.
    fn is_sound(mesh: &TriangleMesh) -> bool {
        let health = Health::of(mesh);
        let crosses = |f: &Finding| f.kind == FindingKind::SelfIntersection;
        health.is_fit() && !health.findings.iter().any(crosses)
    }

    #[test]
    fn a_ball_with_a_tube_is_sound_and_has_the_volume_of_both() {
        let (part, rim) = cut_ball();
        let (middle, out) = rim_pose(&part, &rim).expect("a plane");
        assert!(
            (middle - Point3::new(0.0, 0.0, 0.02)).norm() <= 1e-5,
            "{middle}"
        );
        assert!(out.z >= 1.0 - 1e-9, "{out:?}");
        // Straight up: cone-like over 2 radii of the rim, then a cylinder with a round end.
        let (length, radius) = (0.2, 0.005);
        let path = [middle, middle + Vector3::z() * length];
        let (mesh, tip) = lengthened(&part, &rim, &path, radius).expect("a tube");
        assert!(is_sound(&mesh));
        let r0 = (0.03_f64.powi(2) - 0.02_f64.powi(2)).sqrt();
        let ball = TAU / 2.0 * (0.05_f64.powi(2) * (0.03 - 0.05 / 3.0));
        // The square of 1 - (1 - r/r0) s(t) with s = t^2 (3 - 2 t) over the taper: the mean of s is 1/2,
        // that of its square 13/35.
        let change = radius - r0;
        let taper = 2.0 * r0 * (r0 * r0 + r0 * change + 13.0 / 35.0 * change * change);
        let rest = (length - 2.0 * r0 + 2.0 / 3.0 * radius) * radius * radius;
        let expected = ball + TAU / 2.0 * (taper + rest);
        let error = mesh.volume() / expected - 1.0;
        // Chords of 8 to 12 sides around a thin tube enclose less.
        assert!((-0.03..=0.005).contains(&error), "{error}");
        // The tip is the last radius and the round end.
        let heights = tip
            .iter()
            .flat_map(|&t| mesh.corners(t as usize))
            .map(|p| p.z);
        let lowest = heights.fold(f64::INFINITY, f64::min);
        let edge = part
            .median_edge_length(&Topology::new(&part))
            .expect("edges");
        let from = 0.02 + length - radius;
        assert!(lowest >= from - edge && lowest <= from + edge, "{lowest}");
        // Control: nothing of the ball is moved.
        assert_eq!(mesh.vertices[..part.vertices.len()], part.vertices[..]);
    }

    #[test]
    fn a_tube_follows_a_bent_path() {
        let (part, rim) = cut_ball();
        let (middle, _) = rim_pose(&part, &rim).expect("a plane");
        let bend = |k: usize| {
            let angle = 0.25 * TAU * k as f64 / 20.0;
            middle + Vector3::new(0.1 * (1.0 - angle.cos()), 0.0, 0.1 * angle.sin())
        };
        let path: Vec<Point3<f64>> = (0..=20).map(bend).collect();
        let (mesh, _) = lengthened(&part, &rim, &path, 0.005).expect("a tube");
        assert!(is_sound(&mesh));
        let end = mesh.bounding_box().max;
        assert!(
            (end.x - 0.105).abs() <= 1e-3 && (end.z - 0.125).abs() <= 2e-3,
            "{end}"
        );
        // A tube that is shorter than an edge is one all the same.
        let (coarse, far) = (icosphere(0.03, 1), middle + Vector3::z() * 0.002);
        let height: Vec<f64> = coarse.vertices.iter().map(|v| 0.02 - v.z).collect();
        let (part, rim) = stump(&coarse, &height).expect("one rim");
        assert!(lengthened(&part, &rim, &[middle, far], 0.005).is_some());
        assert!(lengthened(&part, &rim, &[middle, far], f64::NAN).is_none());
        let (part, rim) = cut_ball();
        // Controls: a path that turns back crosses the body; no path; and a body that the plane does not cut.
        let back = [
            middle,
            middle + Vector3::z() * 0.02,
            middle - Vector3::z() * 0.1,
        ];
        let (mesh, _) = lengthened(&part, &rim, &back, 0.005).expect("a tube");
        assert!(!is_sound(&mesh));
        assert!(lengthened(&part, &rim, &[middle, middle], 0.005).is_none());
        let ball = icosphere(0.03, 2);
        assert!(stump(&ball, &vec![1.0; ball.vertices.len()]).is_none());
    }
}
