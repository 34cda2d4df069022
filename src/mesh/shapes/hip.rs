//! The built-in hip: a socket, a femur that turns in it, and a strap of muscle behind both.
//!
//! Frame of the real data: metres, y up, +z forward, x < 0 to the side (a right hip), the joint's centre at the
//! origin. Flexion by an angle turns the femur about the axis -x.

use nalgebra::{Point3, Vector3};

use super::GeneratedShape;
use super::field::{capsule, join, meet, mm, plate, sphere};
use crate::mesh::isosurface::draw_onto_zero;
use crate::mesh::{TriangleMesh, isosurface, refine};

/// Side of a cell of the bones [m].
const BONE_CELL: f64 = 0.003;
/// Target edge length of the muscle [m].
const MUSCLE_EDGE: f64 = 0.0031;
/// Number of interpolated cross-sections per given one.
const PARTS: usize = 10;
const HEAD_RADIUS: f64 = 0.0235;
/// Gap between head and cup [m].
const CLEARANCE: f64 = 0.003;

/// Distance of the muscle's ends from bone [m].
const END_GAP: f64 = 0.000_85;
/// Distance from bone between the ends, where the muscle touches it [m].
const MIDDLE_GAP: f64 = 0.001_8;
/// Shares of the strap at its ends that keep [`END_GAP`].
const END_SHARES: [f64; 2] = [0.14, 0.12];
/// Radius that rounds the strap's edges and ends [m].
const ROUNDING: f64 = 0.008;

/// Cup, wing, sacrum and ischium as one signed distance [m].
pub(super) fn socket_field(p: Point3<f64>) -> f64 {
    // The cup opens along the neck, sideways and down.
    let inward = Vector3::new(0.8, 0.6, 0.0);
    let inner = HEAD_RADIUS + CLEARANCE;
    let shell = (p.coords.norm() - (inner + 0.005)).abs() - 0.005;
    let cup = meet(shell, -inward.dot(&p.coords), 0.003);
    let wing = plate(
        &p,
        &[
            mm(22.0, 28.0, -8.0),
            mm(28.0, 135.0, -32.0),
            mm(38.0, 108.0, -97.0),
        ],
        0.009,
    );
    let sacrum = plate(
        &p,
        &[
            mm(38.0, 105.0, -95.0),
            mm(60.0, 110.0, -85.0),
            mm(65.0, 40.0, -105.0),
        ],
        0.011,
    );
    let ramus = capsule(
        &p,
        &[mm(25.0, -8.0, -18.0), mm(17.0, -52.0, -42.0)],
        [0.011, 0.013],
    );
    let bump = sphere(&p, &mm(16.0, -58.0, -45.0), 0.017);
    let bones = join(join(wing, sacrum, 0.01), join(ramus, bump, 0.01), 0.015);
    // Nothing extends into the cup.
    meet(join(cup, bones, 0.012), inner - p.coords.norm(), 0.001)
}

/// Head, neck, greater trochanter and shaft as one signed distance [m].
pub(super) fn femur_field(p: Point3<f64>) -> f64 {
    let head = sphere(&p, &Point3::origin(), HEAD_RADIUS);
    let neck = capsule(
        &p,
        &[mm(-10.0, -5.5, 0.0), mm(-48.0, -27.0, 0.0)],
        [0.0125, 0.0155],
    );
    let trochanter = capsule(
        &p,
        &[mm(-59.0, -8.0, -12.0), mm(-55.0, -30.0, -6.0)],
        [0.014, 0.016],
    );
    let shaft = capsule(
        &p,
        &[mm(-52.0, -35.0, -1.0), mm(-42.0, -347.0, 4.0)],
        [0.0145, 0.013],
    );
    join(
        head,
        join(join(neck, shaft, 0.012), trochanter, 0.01),
        0.006,
    )
}

pub(super) fn socket() -> TriangleMesh {
    isosurface(
        socket_field,
        mm(-40.0, -90.0, -130.0),
        mm(90.0, 155.0, 50.0),
        BONE_CELL,
    )
}

pub(super) fn femur() -> TriangleMesh {
    isosurface(
        femur_field,
        mm(-90.0, -370.0, -40.0),
        mm(35.0, 35.0, 35.0),
        BONE_CELL,
    )
}

/// One cross-section of the strap.
#[derive(Clone, Copy, Debug)]
struct Station {
    center: Point3<f64>,
    /// Direction away from bone.
    out: Vector3<f64>,
    half_width: f64,
    half_thickness: f64,
}

/// Cross-sections of the strap from origin to insertion: centre and outward direction [mm], half
/// width and half thickness [mm].
const STATIONS: [([f64; 3], [f64; 3], f64, f64); 7] = [
    ([15.5, 100.0, -66.0], [-0.98, 0.05, -0.2], 31.0, 9.5),
    ([11.5, 72.0, -66.0], [-0.95, 0.0, -0.3], 32.0, 10.0),
    ([-12.0, 41.0, -62.0], [-0.8, 0.0, -0.6], 33.0, 10.5),
    ([-44.0, 14.0, -49.0], [-0.7, 0.0, -0.7], 33.0, 10.5),
    ([-70.0, -18.0, -28.0], [-0.68, 0.0, -0.73], 32.0, 10.0),
    ([-65.0, -70.0, -16.5], [-0.66, 0.0, -0.75], 30.0, 9.5),
    ([-60.0, -122.0, -12.5], [-0.66, 0.0, -0.75], 26.0, 10.0),
];

/// The strap that guides the fibres, as closely spaced cross-sections.
struct Strap {
    stations: Vec<Station>,
}

impl Strap {
    fn new() -> Self {
        let spans = STATIONS.len() - 1;
        let stations = (0..=spans * PARTS)
            .map(|i| station(i as f64 / PARTS as f64))
            .collect();
        Self { stations }
    }

    /// The position along the strap (0..1) nearest to `p`, its cross-section, and the direction
    /// along the strap.
    fn nearest(&self, p: &Point3<f64>) -> (f64, Station, Vector3<f64>) {
        // First the nearest of a few cross-sections, then the segments about it.
        let square = |i: usize| (p - self.stations[i].center).norm_squared();
        let coarse = (0..self.stations.len())
            .step_by(PARTS)
            .min_by(|&i, &j| square(i).total_cmp(&square(j)));
        let first = coarse.unwrap_or(0).saturating_sub(PARTS + 2);
        let mut best = (f64::INFINITY, 0, 0.0);
        for (i, pair) in self
            .stations
            .windows(2)
            .enumerate()
            .skip(first)
            .take(2 * PARTS + 4)
        {
            let along = pair[1].center - pair[0].center;
            let s = ((p - pair[0].center).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
            let square = (p - (pair[0].center + along * s)).norm_squared();
            if square < best.0 {
                best = (square, i, s);
            }
        }
        let (_, i, s) = best;
        let place = (i as f64 + s) / (self.stations.len() - 1) as f64;
        let (here, along) = self.at(place);
        (place, here, along)
    }

    /// The cross-section at a position along the strap (0..1), and the direction of the strap
    /// there.
    fn at(&self, place: f64) -> (Station, Vector3<f64>) {
        let last = self.stations.len() - 1;
        let x = place.clamp(0.0, 1.0) * last as f64;
        let i = (x as usize).min(last - 1);
        let (a, b, s) = (&self.stations[i], &self.stations[i + 1], x - i as f64);
        let mix = |from: f64, to: f64| from + (to - from) * s;
        // The direction changes from station to station, so that cross-sections do not jump at corners.
        let direction = |k: usize| {
            let (before, after) = (
                &self.stations[k.saturating_sub(1)],
                &self.stations[(k + 1).min(last)],
            );
            (after.center - before.center).normalize()
        };
        let along = direction(i).lerp(&direction(i + 1), s).normalize();
        let out = a.out.lerp(&b.out, s);
        let here = Station {
            center: a.center + (b.center - a.center) * s,
            out: (out - along * along.dot(&out)).normalize(),
            half_width: mix(a.half_width, b.half_width),
            half_thickness: mix(a.half_thickness, b.half_thickness),
        };
        (here, along)
    }

    /// Approximate signed distance [m] of the strap minus the bones.
    fn field(&self, p: Point3<f64>) -> f64 {
        let (place, here, along) = self.nearest(&p);
        let from = p - here.center;
        let across = along.cross(&here.out);
        let beyond = |along: f64, half: f64| (along.abs() - (half - ROUNDING)).max(0.0);
        let (y, z) = (from.dot(&here.out), from.dot(&across));
        let corner = Vector3::new(
            beyond(y, here.half_thickness),
            beyond(z, here.half_width),
            // Zero between the ends, except for the corners between stations.
            if place > 0.0 && place < 1.0 {
                0.0
            } else {
                from.dot(&along)
            },
        );
        let body = corner.norm() - ROUNDING;
        if body > 2.0 * MUSCLE_EDGE {
            // Far outside bones change nothing.
            return body;
        }
        let bone = socket_field(p).min(femur_field(p));
        meet(body, gap(place) - bone, 0.002)
    }

    /// The point of a fibre at a position along the strap; `thick` and `wide` are shares of the
    /// half sizes (-1..1).
    fn fibre_point(&self, place: f64, thick: f64, wide: f64) -> Point3<f64> {
        let (here, along) = self.at(place);
        let across = along.cross(&here.out);
        here.center + here.out * (thick * here.half_thickness) + across * (wide * here.half_width)
    }
}

/// An interpolated station: a cubic through the given ones (Catmull-Rom).
fn station(x: f64) -> Station {
    let last = STATIONS.len() - 1;
    let i = (x as usize).min(last - 1);
    let s = x - i as f64;
    let [k0, k1, k2, k3] = [i.saturating_sub(1), i, i + 1, (i + 2).min(last)];
    let cubic = |f: &dyn Fn(usize) -> f64| {
        let (a, b, c, d) = (f(k0), f(k1), f(k2), f(k3));
        b + 0.5 * s * (c - a + s * (2.0 * a - 5.0 * b + 4.0 * c - d + s * (3.0 * (b - c) + d - a)))
    };
    let vector =
        |f: &dyn Fn(usize) -> [f64; 3]| Vector3::from([0, 1, 2].map(|axis| cubic(&|k| f(k)[axis])));
    Station {
        center: Point3::from(1e-3 * vector(&|k| STATIONS[k].0)),
        out: vector(&|k| STATIONS[k].1).normalize(),
        half_width: 1e-3 * cubic(&|k| STATIONS[k].2),
        half_thickness: 1e-3 * cubic(&|k| STATIONS[k].3),
    }
}

/// Distance between the muscle and bone at a position along the strap [m].
fn gap(place: f64) -> f64 {
    let ramp = |x: f64| {
        let s = (x / 0.04).clamp(0.0, 1.0);
        s * s * (3.0 - 2.0 * s)
    };
    END_GAP
        + (MIDDLE_GAP - END_GAP) * ramp(place - END_SHARES[0]) * ramp(1.0 - END_SHARES[1] - place)
}

/// The strap from the back of the wing, over the trochanter, to the back of the shaft, with its fibres.
pub(super) fn gluteus() -> GeneratedShape {
    let strap = Strap::new();
    let field = |p: Point3<f64>| strap.field(p);
    let surface = isosurface(
        field,
        mm(-115.0, -145.0, -115.0),
        mm(45.0, 150.0, 25.0),
        1.25 * MUSCLE_EDGE,
    );
    // A surface made by isosurface is closed and oriented; the tests of this file verify it.
    let mut mesh = refine(&surface, MUSCLE_EDGE).map_or(surface, |refined| refined.mesh);
    draw_onto_zero(&field, &mut mesh.vertices, 0.1 * MUSCLE_EDGE);
    let mut fibres = Vec::new();
    // Bone cuts the inner side, so fibres stay in the middle and outside.
    for thick in [0.1, 0.4, 0.7] {
        for k in 0..15 {
            let wide = 0.8 * (f64::from(k) / 7.0 - 1.0);
            fibres.push(
                (0..=30)
                    .map(|i| strap.fibre_point(f64::from(i) / 30.0, thick, wide))
                    .collect(),
            );
        }
    }
    GeneratedShape {
        mesh,
        edges: Vec::new(),
        fibres,
    }
}

#[cfg(test)]
mod tests;
