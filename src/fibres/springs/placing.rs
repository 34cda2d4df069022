//! Positions of a template's surface points on a muscle.
//!
//! The surface of every template is that of a cube in r, s, t. The poles of the sphere are the
//! centres of the two areas. The faces t = 0 and t = 1 map to the areas, and their sides to the
//! boundaries. Each line of the other faces follows a meridian between the boundaries; rings around
//! the muscle are equalised ([`rings`](super::rings)). This replaces the source's motion of single
//! points of areas (6.2), whose steps can get stuck (errata M10): the order around and along the
//! muscle is kept, so the sides do not fold. Points within an area come to equilibrium between
//! springs on the area.
//!
//! In the muscle's map the two centres have any angle. A conformal map of the sphere to itself (a
//! Lorentz boost, as for a moving observer of the sky) makes them antipodal; its inverse maps back.

use std::f64::consts::PI;

use nalgebra::{Point3, Vector3};

use super::rings::Ring;
use super::{SpringsError, network};
use crate::fibres::attachment::{Area, Attachment, MuscleEnd};
use crate::fibres::polyline::equal_shares;
use crate::fibres::template::Sampling;
use crate::mesh::closest::SurfaceTree;
use crate::mesh::{Topology, TriangleMesh};
use crate::morph::locate::{Located, Locator};
use crate::morph::sphere::SphereMap;

/// Number of rotations about the poles that are tried.
const TURNS: usize = 12;
/// Number of samples along a meridian between two fibre points, for equal lengths.
const FINE: usize = 8;
/// Greatest angle of an area from its pole; two areas never overlap.
const WIDEST: f64 = 0.45 * PI;
/// Directions of the sphere nearer than this are equal.
const SAME: f64 = 1e-9;

/// Positions of all grid points on the muscle \[m\]; inner points are at the origin.
///
/// # Errors
/// A surface that is no topological sphere or inside out, an area without boundary, or two areas
/// with one centre.
pub fn place(
    muscle: &TriangleMesh,
    attachment: &Attachment,
    sampling: &Sampling,
) -> Result<Vec<Point3<f64>>, SpringsError> {
    let map = SphereMap::robust(muscle)?;
    let volume = muscle.volume();
    if !(volume > 0.0) {
        return Err(SpringsError::InsideOut { volume });
    }
    let seats = Seats::new(muscle, &map, attachment)?;
    // A grid with equal numbers of fibres along r and s has a symmetry of half a turn.
    let symmetry = if sampling.points[0] == sampling.points[1] {
        0.5 * PI
    } else {
        PI
    };
    let angle = |n: usize| symmetry * n as f64 / TURNS as f64;
    let mut best: Option<(f64, f64)> = None;
    for n in 0..TURNS {
        let energy = seats.energy(sampling, angle(n))?;
        if best.is_none_or(|(least, _)| energy < least) {
            best = Some((energy, angle(n)));
        }
    }
    seats.place(sampling, best.map_or(0.0, |b| b.1))
}

/// The muscle's map with its two areas at the poles.
struct Seats<'a> {
    muscle: &'a TriangleMesh,
    locator: Locator<'a>,
    /// Axis of the boost that takes the areas to the poles.
    axis: Vector3<f64>,
    /// Hyperbolic cosine and sine of the boost.
    boost: [f64; 2],
    /// Axes after the boost; the third is the pole of the origin.
    frame: [Vector3<f64>; 3],
    /// Sides of the boundaries after the boost, in coordinates of the frame at the area's own pole.
    rims: [Vec<[Vector3<f64>; 2]>; 2],
    /// Triangles of the areas, in ascending order.
    areas: [&'a [u32]; 2],
    trees: [SurfaceTree; 2],
}

impl<'a> Seats<'a> {
    fn new(
        muscle: &'a TriangleMesh,
        map: &'a SphereMap,
        attachment: &'a Attachment,
    ) -> Result<Self, SpringsError> {
        let locator = Locator::new(map);
        let ends = [
            (MuscleEnd::Origin, &attachment.origin),
            (MuscleEnd::Insertion, &attachment.insertion),
        ];
        let mut centres = [Vector3::zeros(); 2];
        for (centre, (end, area)) in centres.iter_mut().zip(ends) {
            *centre = middle(muscle, map, area).ok_or(SpringsError::WholeSurface { end })?;
        }
        let [o, i] = centres;
        let one = |area: &Area| area.vertices.first().copied().unwrap_or(0);
        let vertices = [one(&attachment.origin), one(&attachment.insertion)];
        if (o - i).norm() <= SAME {
            return Err(SpringsError::OnePlace { vertices });
        }
        // Antipodal poles need no boost.
        let axis = (-(o + i))
            .try_normalize(SAME)
            .unwrap_or_else(|| any_across(&o));
        let cosine = (-o.dot(&axis)).clamp(0.0, 1.0);
        let sine = (1.0 - cosine * cosine).sqrt();
        let mut seats = Self {
            muscle,
            locator,
            axis,
            boost: [1.0 / sine, cosine / sine],
            frame: [Vector3::x(), Vector3::y(), Vector3::z()],
            rims: [Vec::new(), Vec::new()],
            areas: [
                &attachment.origin.triangles,
                &attachment.insertion.triangles,
            ],
            trees: [
                attachment.origin.tree(muscle),
                attachment.insertion.tree(muscle),
            ],
        };
        let pole = seats.boosted(&o, 1.0);
        let x = any_across(&pole);
        seats.frame = [x, pole.cross(&x), pole];
        for (k, (end, area)) in ends.into_iter().enumerate() {
            let rim = rim(muscle, area);
            if rim.is_empty() {
                return Err(SpringsError::WholeSurface { end });
            }
            let side =
                |&edge: &[u32; 2]| edge.map(|v| seats.seen(&map.points()[v as usize].coords, k));
            seats.rims[k] = rim.iter().map(side).collect();
        }
        Ok(seats)
    }

    /// The direction of the sphere after the boost along the axis; `sign` is its direction.
    fn boosted(&self, p: &Vector3<f64>, sign: f64) -> Vector3<f64> {
        let along = self.axis.dot(p);
        let [cosh, sinh] = [self.boost[0], sign * self.boost[1]];
        let moved = p + self.axis * ((cosh - 1.0) * along + sinh);
        moved.normalize()
    }

    /// A direction of the map in the frame at the pole of area `k`.
    fn seen(&self, p: &Vector3<f64>, k: usize) -> Vector3<f64> {
        let q = self.boosted(p, 1.0);
        let [x, y, z] = [0, 1, 2].map(|c| self.frame[c].dot(&q));
        Vector3::new(x, y, if k == 0 { z } else { -z })
    }

    /// The angle from the pole of area `k` at which a meridian first leaves the area.
    fn width(&self, k: usize, turn: f64) -> f64 {
        let (sin, cos) = libm::sincos(turn);
        let (along, across) = (Vector3::new(cos, sin, 0.0), Vector3::new(-sin, cos, 0.0));
        let mut least = WIDEST;
        for [a, b] in &self.rims[k] {
            let (da, db) = (a.dot(&across), b.dot(&across));
            // Half-open, so that a corner of the boundary counts once.
            if (da < 0.0) == (db < 0.0) {
                continue;
            }
            let hit = a + (b - a) * (da / (da - db));
            let out = hit.dot(&along);
            if out > 0.0 {
                least = least.min(libm::atan2(out, hit.z));
            }
        }
        least
    }

    /// The direction of the map on a meridian at an angle from the pole of the origin.
    fn direction(&self, angle: f64, turn: f64) -> Vector3<f64> {
        let ((sin, cos), (across, along)) = (libm::sincos(angle), libm::sincos(turn));
        let [x, y, z] = self.frame;
        self.boosted(&(x * (sin * along) + y * (sin * across) + z * cos), -1.0)
    }

    /// The point of the muscle \[m\] on a meridian at an angle from the pole of the origin.
    fn at(&self, angle: f64, turn: f64, point: usize) -> Result<Point3<f64>, SpringsError> {
        let found = self.locator.locate(&self.direction(angle, turn));
        let place = |l: Located| l.of(&self.muscle.triangles, &self.muscle.vertices);
        found.map(place).ok_or(SpringsError::NotFound { point })
    }

    /// The meridian of a point of a face or side of the cube; u and v in -1..1 replace r and s.
    fn meridian(u: f64, v: f64, turn: f64) -> f64 {
        // Seen from outside at the origin, the cube's s axis is reversed.
        libm::atan2(-v, u) + turn
    }

    /// Energy of springs around and along the sides, of stiffness n and no rest length, for a
    /// rotation about the poles.
    fn energy(&self, sampling: &Sampling, turn: f64) -> Result<f64, SpringsError> {
        let [_, _, nt] = sampling.points;
        let around = perimeter(sampling);
        let mut lines = Vec::with_capacity(around.len());
        for &[i, j] in &around {
            let meridian = self.of([i, j], sampling, turn);
            let (low, high) = (self.width(0, meridian), PI - self.width(1, meridian));
            let line: Result<Vec<_>, _> = (0..nt)
                .map(|k| {
                    let share = k as f64 / (nt - 1) as f64;
                    self.at(
                        low + (high - low) * share,
                        meridian,
                        sampling.number([i, j, k]),
                    )
                })
                .collect();
            lines.push(line?);
        }
        let mut sum = 0.0;
        for (n, line) in lines.iter().enumerate() {
            let next = &lines[(n + 1) % lines.len()];
            sum += line
                .iter()
                .zip(next)
                .map(|(a, b)| (a - b).norm_squared())
                .sum::<f64>()
                * lines.len() as f64
                / 4.0;
            sum += line
                .windows(2)
                .map(|s| (s[1] - s[0]).norm_squared())
                .sum::<f64>()
                * (nt - 1) as f64;
        }
        Ok(sum)
    }

    fn of(&self, [i, j]: [usize; 2], sampling: &Sampling, turn: f64) -> f64 {
        let [u, v] = square([i, j], sampling);
        Self::meridian(u, v, turn)
    }

    /// The same angle, reduced to where the muscle's triangles end the area: a boosted boundary
    /// does not consist of great circles exactly.
    fn rim_at(&self, k: usize, turn: f64) -> f64 {
        let inside = |angle: f64| {
            let direction = self.direction(if k == 0 { angle } else { PI - angle }, turn);
            self.locator
                .locate(&direction)
                .is_some_and(|l| self.areas[k].binary_search(&l.triangle).is_ok())
        };
        let (mut low, mut high) = (0.0, self.width(k, turn));
        if inside(high) {
            return high;
        }
        // The exit is near: tests shares of the angle from above.
        for n in 1..=10 {
            let less = high * (1.0 - 0.02 * f64::from(n * n));
            if less > 0.0 && inside(less) {
                low = less;
                break;
            }
            high = less.max(0.0);
        }
        for _ in 0..50 {
            let middle = 0.5 * (low + high);
            if inside(middle) {
                low = middle
            } else {
                high = middle
            }
        }
        low
    }

    fn place(&self, sampling: &Sampling, turn: f64) -> Result<Vec<Point3<f64>>, SpringsError> {
        let [nr, ns, nt] = sampling.points;
        let around = perimeter(sampling);
        let lines = self.lines(sampling, &around, turn)?;
        let mut positions = vec![Point3::origin(); nr * ns * nt];
        let middle = nt / 2;
        for (k, neighbour) in std::iter::once((middle, None))
            .chain((0..middle).rev().map(|k| (k, Some(k + 1))))
            .chain((middle + 1..nt).map(|k| (k, Some(k - 1))))
        {
            let on_ring = |x: f64| {
                let (meridian, angle) = lines.at(x, k);
                let angle = self.of_level(angle, meridian, k, nt);
                self.at(angle, meridian, k)
            };
            let mut ring = Ring::new(around.len(), on_ring)?;
            if let Some(other) = neighbour {
                let known: Vec<_> = around
                    .iter()
                    .map(|&[i, j]| positions[sampling.number([i, j, other])])
                    .collect();
                ring.turn_to(&known, on_ring)?;
            }
            for (m, &[i, j]) in around.iter().enumerate() {
                positions[sampling.number([i, j, k])] =
                    on_ring(ring.line(m as f64 / around.len() as f64))?;
            }
        }
        for (area, layer) in [(0, 0), (1, nt - 1)] {
            network::face(sampling, layer, &mut positions)?;
            for point in inner(sampling, layer) {
                // On the area, which can be curved.
                let found = self.trees[area].closest(&positions[point], f64::INFINITY);
                positions[point] = found.map_or(positions[point], |found| found.point);
            }
        }
        Ok(positions)
    }

    /// The angle of a level: that of the boundary at both ends, otherwise as given.
    fn of_level(&self, angle: f64, meridian: f64, k: usize, nt: usize) -> f64 {
        if k == 0 {
            self.rim_at(0, meridian)
        } else if k + 1 == nt {
            PI - self.rim_at(1, meridian)
        } else {
            angle
        }
    }

    /// The lines along the sides: meridians, and on each the angles at equal lengths on the muscle.
    fn lines(
        &self,
        sampling: &Sampling,
        around: &[[usize; 2]],
        turn: f64,
    ) -> Result<Lines, SpringsError> {
        let nt = sampling.points[2];
        let mut lines = Lines {
            meridians: Vec::new(),
            angles: Vec::new(),
        };
        for &[i, j] in around {
            let meridian = self.of([i, j], sampling, turn);
            let (low, high) = (self.rim_at(0, meridian), PI - self.rim_at(1, meridian));
            let parts = FINE * (nt - 1);
            let angle = |share: f64| low + (high - low) * share;
            let line: Result<Vec<_>, _> = (0..=parts)
                .map(|n| {
                    self.at(
                        angle(n as f64 / parts as f64),
                        meridian,
                        sampling.number([i, j, n / FINE]),
                    )
                })
                .collect();
            // Around the template meridians decrease.
            let last = lines.meridians.last().copied().unwrap_or(f64::INFINITY);
            let turns = if last.is_finite() {
                ((meridian - last) / (2.0 * PI)).ceil().max(0.0)
            } else {
                0.0
            };
            lines.meridians.push(meridian - 2.0 * PI * turns);
            lines
                .angles
                .push(equal_shares(&line?, nt).into_iter().map(angle).collect());
        }
        Ok(lines)
    }
}

/// Lines along the sides of a template, once around.
struct Lines {
    /// In descending order, over one turn.
    meridians: Vec<f64>,
    /// Angles of each line at its levels.
    angles: Vec<Vec<f64>>,
}

impl Lines {
    /// Meridian and angle of level k at x from 0 to the number of lines, with linear interpolation
    /// between lines.
    fn at(&self, x: f64, k: usize) -> (f64, f64) {
        let n = self.meridians.len();
        let line = (x as usize).min(n - 1);
        let share = x - line as f64;
        let next = if line + 1 == n {
            self.meridians[0] - 2.0 * PI
        } else {
            self.meridians[line + 1]
        };
        let (a, b) = (self.angles[line][k], self.angles[(line + 1) % n][k]);
        (
            self.meridians[line] + (next - self.meridians[line]) * share,
            a + (b - a) * share,
        )
    }
}

/// Coordinates u and v in -1..1 of fibre (i, j).
fn square([i, j]: [usize; 2], sampling: &Sampling) -> [f64; 2] {
    let [nr, ns, _] = sampling.points;
    [
        2.0 * i as f64 / (nr - 1) as f64 - 1.0,
        2.0 * j as f64 / (ns - 1) as f64 - 1.0,
    ]
}

/// The points of a layer that are not on its sides.
fn inner(sampling: &Sampling, k: usize) -> impl Iterator<Item = usize> + use<> {
    let ([nr, ns, _], sampling) = (sampling.points, *sampling);
    (1..ns - 1).flat_map(move |j| (1..nr - 1).map(move |i| sampling.number([i, j, k])))
}

/// The fibres on the sides, once around.
fn perimeter(sampling: &Sampling) -> Vec<[usize; 2]> {
    let [nr, ns, _] = sampling.points;
    let mut all: Vec<[usize; 2]> = (0..nr).map(|i| [i, 0]).collect();
    all.extend((1..ns).map(|j| [nr - 1, j]));
    all.extend((0..nr - 1).rev().map(|i| [i, ns - 1]));
    all.extend((1..ns - 1).rev().map(|j| [0, j]));
    all
}

fn any_across(p: &Vector3<f64>) -> Vector3<f64> {
    p.cross(&Vector3::ith(p.iamin(), 1.0)).normalize()
}

/// Edges with exactly one triangle of an area.
fn rim(muscle: &TriangleMesh, area: &Area) -> Vec<[u32; 2]> {
    let triangles: Vec<[u32; 3]> = area
        .triangles
        .iter()
        .map(|&t| muscle.triangles[t as usize])
        .collect();
    let topology = Topology::of_triangles(muscle.vertices.len(), &triangles);
    topology
        .boundary_edges()
        .iter()
        .map(|&e| topology.edges[e as usize])
        .collect()
}

/// The point of an area nearest to the area's centre on the muscle, as a direction of the sphere.
///
/// The mean of the vertices' directions can be outside the area or far from the area's centre on
/// the muscle.
fn middle(muscle: &TriangleMesh, map: &SphereMap, area: &Area) -> Option<Vector3<f64>> {
    let (mut sum, mut weight) = (Vector3::zeros(), 0.0);
    for &t in &area.triangles {
        let [a, b, c] = muscle.corners(t as usize).map(|p| p.coords);
        let size = (b - a).cross(&(c - a)).norm();
        sum += (a + b + c) * (size / 3.0);
        weight += size;
    }
    let found = area
        .tree(muscle)
        .closest(&Point3::from(sum / weight), f64::INFINITY)?;
    let triangle = *area.triangles.get(found.triangle as usize)? as usize;
    let [a, b, c] = muscle.corners(triangle);
    let normal = (b - a).cross(&(c - a));
    let part = |p: Point3<f64>, q: Point3<f64>| {
        (p - found.point)
            .cross(&(q - found.point))
            .dot(&normal)
            .max(0.0)
    };
    let weights = [part(b, c), part(c, a), part(a, b)];
    let corners = map.triangles()[triangle].map(|v| map.points()[v as usize].coords);
    corners
        .iter()
        .zip(weights)
        .map(|(p, w)| p * w)
        .sum::<Vector3<f64>>()
        .try_normalize(0.0)
}
