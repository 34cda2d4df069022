//! Areas and volumes of spheres, caps and frusta.

use std::f64::consts::{PI, TAU};

use nalgebra::Point3;
use pliant::mesh::TriangleMesh;
use pliant::mesh::shapes::icosphere;

use super::{off_order, orders, powers};
use crate::tolerances::{T1, T4};

/// The surface of revolution about z of a polygon of (z, radius), whose first and last radius are zero.
fn revolved(profile: &[(f64, f64)], segments: u32) -> TriangleMesh {
    let rings = &profile[1..profile.len() - 1];
    let mut vertices = Vec::new();
    for &(z, r) in rings {
        let angles = (0..segments).map(|j| TAU * f64::from(j) / f64::from(segments));
        vertices.extend(angles.map(|a| Point3::new(r * a.cos(), r * a.sin(), z)));
    }
    let (low, high) = (vertices.len() as u32, vertices.len() as u32 + 1);
    vertices
        .extend([profile[0], profile[profile.len() - 1]].map(|(z, _)| Point3::new(0.0, 0.0, z)));
    let at = |i: usize, j: u32| i as u32 * segments + j % segments;
    let mut triangles = Vec::new();
    for j in 0..segments {
        triangles.push([low, at(0, j + 1), at(0, j)]);
        triangles.push([high, at(rings.len() - 1, j), at(rings.len() - 1, j + 1)]);
        for i in 1..rings.len() {
            triangles.push([at(i - 1, j), at(i - 1, j + 1), at(i, j + 1)]);
            triangles.push([at(i - 1, j), at(i, j + 1), at(i, j)]);
        }
    }
    TriangleMesh {
        vertices,
        triangles,
    }
}

/// The area of a regular polygon of circumradius `r`.
fn polygon(r: f64, segments: u32) -> f64 {
    0.5 * f64::from(segments) * r * r * (TAU / f64::from(segments)).sin()
}

#[test]
fn spheres_converge_with_order_two() {
    let meshes: Vec<TriangleMesh> = (2..6).map(|n| icosphere(1.0, n)).collect();
    let volumes: Vec<f64> = meshes
        .iter()
        .map(|m| 1.0 - m.volume() / (4.0 / 3.0 * PI))
        .collect();
    let areas: Vec<f64> = meshes.iter().map(|m| 1.0 - m.area() / (4.0 * PI)).collect();
    println!(
        "sphere volume: errors {volumes}, orders {:.4?}",
        orders(&volumes),
        volumes = powers(&volumes)
    );
    println!(
        "sphere area: errors {areas}, orders {:.4?}",
        orders(&areas),
        areas = powers(&areas)
    );
    assert!(off_order(&volumes, 2.0) <= T4 && off_order(&areas, 2.0) <= T4);
    // Control: there is no convergence to a sphere that is a thousandth too small.
    let wrong: Vec<f64> = volumes.iter().map(|e| (e - 1e-3).abs()).collect();
    assert!(!(off_order(&wrong, 2.0) <= T4));
}

/// A cap of `height` cut from a sphere of `radius`, with its flat base, from `n` rings.
fn cap(radius: f64, height: f64, n: u32) -> TriangleMesh {
    let widest = (1.0 - height / radius).acos();
    let ring = |i: u32| {
        let angle = widest * f64::from(i) / f64::from(n);
        (
            radius * (angle.cos() - widest.cos()),
            if i == 0 { 0.0 } else { radius * angle.sin() },
        )
    };
    let profile: Vec<(f64, f64)> = std::iter::once((0.0, 0.0))
        .chain((0..=n).rev().map(ring))
        .collect();
    revolved(&profile, 4 * n)
}

#[test]
fn caps_converge_with_order_two() {
    for (radius, height) in [(1.0_f64, 0.5_f64), (1.0, 1.4), (0.07, 0.02)] {
        let base = (height * (2.0 * radius - height)).sqrt();
        // V = pi h (3 a^2 + h^2)/6 and A = pi (a^2 + h^2), where a is the radius of the base.
        let volume = PI * height * (3.0 * base * base + height * height) / 6.0;
        let area = PI * (base * base + height * height);
        let meshes = [8, 16, 32, 64].map(|n| (cap(radius, height, n), polygon(base, 4 * n)));
        let volumes = meshes.each_ref().map(|(m, _)| 1.0 - m.volume() / volume);
        let areas = meshes
            .each_ref()
            .map(|(m, flat)| 1.0 - (m.area() - flat) / area);
        println!(
            "cap {height} of {radius}: volume {volumes}, orders {:.4?}",
            orders(&volumes),
            volumes = powers(&volumes)
        );
        println!(
            "cap {height} of {radius}: area {areas}, orders {:.4?}",
            orders(&areas),
            areas = powers(&areas)
        );
        assert!(off_order(&volumes, 2.0) <= T4 && off_order(&areas, 2.0) <= T4);
        // Control: the radius of the sphere instead of that of the base.
        let wrong = PI * height * (3.0 * radius * radius + height * height) / 6.0;
        let wrong = meshes
            .each_ref()
            .map(|(m, _)| (1.0 - m.volume() / wrong).abs());
        assert!(!(off_order(&wrong, 2.0) <= T4));
    }
}

/// Heights and radii of a body of frusta.
const FRUSTA: [(f64, f64); 5] = [
    (0.0, 0.1),
    (0.5, 0.35),
    (0.9, 0.4),
    (1.6, 0.15),
    (2.0, 0.05),
];

/// Sum over the frusta of `volume(h, r1, r2)`.
fn sum_of_frusta(profile: &[(f64, f64)], volume: impl Fn(f64, f64, f64) -> f64) -> f64 {
    profile
        .windows(2)
        .map(|p| volume(p[1].0 - p[0].0, p[0].1, p[1].1))
        .sum()
}

/// The profile with flat ends.
fn lidded(profile: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let (first, last) = (profile[0].0, profile[profile.len() - 1].0);
    [&[(first, 0.0)], profile, &[(last, 0.0)]].concat()
}

#[test]
fn frusta_are_exact_and_converge_to_cones() {
    let cone = |h: f64, r: f64, s: f64| PI * h / 3.0 * (r * r + r * s + s * s);
    let exact = sum_of_frusta(&FRUSTA, cone);
    let counts = [8, 16, 32, 64];
    let errors = counts.map(|n| {
        let found = revolved(&lidded(&FRUSTA), n).volume();
        // A frustum of a regular polygon: h/3 (A1 + A2 + sqrt(A1 A2)), its sides are flat.
        let flat = sum_of_frusta(&FRUSTA, |h, r, s| {
            let (a, b) = (polygon(r, n), polygon(s, n));
            h / 3.0 * (a + b + (a * b).sqrt())
        });
        assert!(
            (found / flat - 1.0).abs() <= T1,
            "{n} segments: {found} for {flat}"
        );
        // Control: the mean of both ends times the height.
        let mean = sum_of_frusta(&FRUSTA, |h, r, s| h / 2.0 * (polygon(r, n) + polygon(s, n)));
        assert!(
            !((found / mean - 1.0).abs() <= T1),
            "control: the mean area"
        );
        1.0 - found / exact
    });
    println!(
        "frusta: exact {exact:.6}, errors {errors}, orders {:.4?}",
        orders(&errors),
        errors = powers(&errors)
    );
    assert!(off_order(&errors, 2.0) <= T4);
}

#[test]
fn a_spindle_of_frusta_converges_with_order_two() {
    // r = 1 - x^2 over -1..1: pi 16/15.
    let exact = PI * 16.0 / 15.0;
    let volume = |n: u32| {
        let points: Vec<(f64, f64)> = (0..=n)
            .map(|i| {
                let x = f64::from(2 * i) / f64::from(n) - 1.0;
                (x, 1.0 - x * x)
            })
            .collect();
        revolved(&points, 2 * n).volume()
    };
    let errors = [8, 16, 32, 64].map(|n| 1.0 - volume(n) / exact);
    println!(
        "spindle: exact {exact:.6}, errors {errors}, orders {:.4?}",
        orders(&errors),
        errors = powers(&errors)
    );
    assert!(off_order(&errors, 2.0) <= T4);
    let wrong = [8, 16, 32, 64].map(|n| (1.0 - volume(n) / (PI * 4.0 / 3.0)).abs());
    assert!(
        !(off_order(&wrong, 2.0) <= T4),
        "control: the volume of a sphere"
    );
}
