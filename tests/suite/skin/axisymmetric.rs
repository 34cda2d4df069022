//! Independent solution for a round membrane over a sphere, fixed at its boundary: a profile of
//! points, by damped relaxation.
//!
//! The energy per rest area is 1.5 E t <(l - 1)^2>, where l is the stretch of a fibre, averaged
//! over all directions: an isotropic network of springs, which at small strains is plane stress
//! with Poisson's ratio 1/3.

use std::f64::consts::{PI, TAU};

/// Number of directions of the average.
const DIRECTIONS: usize = 16;

/// Number of points of the profile.
const POINTS: usize = 60;

/// The problem: radius of the membrane, and of the sphere, whose centre is `height` above the plane
/// of the boundary.
#[derive(Clone, Copy, Debug)]
pub struct Membrane {
    pub rim: f64,
    pub sphere: f64,
    pub height: f64,
}

/// Derivatives of the energy with respect to both stretches, E t = 1.
fn tensions(along: f64, around: f64) -> (f64, f64) {
    let mut sum = (0.0, 0.0);
    for k in 0..DIRECTIONS {
        let (s, c) = (PI * (k as f64 + 0.5) / DIRECTIONS as f64).sin_cos();
        let length = (along * along * c * c + around * around * s * s).sqrt();
        let pull = 3.0 * (length - 1.0) / length / DIRECTIONS as f64;
        sum = (sum.0 + pull * along * c * c, sum.1 + pull * around * s * s);
    }
    sum
}

/// Area of the membrane over the sphere [m^2], and the greatest residual force relative to the
/// greatest tension.
pub fn area(of: Membrane) -> (f64, f64) {
    let step = of.rim / POINTS as f64;
    let top = of.sphere + of.height;
    let mut p: Vec<[f64; 2]> = (0..=POINTS)
        .map(|i| {
            let share = i as f64 / POINTS as f64;
            [share * of.rim, 1.05 * top * (1.0 - share * share)]
        })
        .collect();
    let mut v = vec![[0.0; 2]; POINTS + 1];
    let mut left = f64::INFINITY;
    for _ in 0..30_000 {
        let force = forces(&p, step);
        left = 0.0;
        for i in 0..POINTS {
            let (mut f, mass) = (force[i], TAU * (i as f64 + 0.5) * 6.0);
            if i == 0 {
                f[0] = 0.0;
            }
            let away = [p[i][0], p[i][1] - of.height];
            let distance = away[0].hypot(away[1]);
            let n = [away[0] / distance, away[1] / distance];
            let inward = f[0] * n[0] + f[1] * n[1];
            if distance <= of.sphere * (1.0 + 1e-12) && inward < 0.0 {
                f = [f[0] - inward * n[0], f[1] - inward * n[1]];
            }
            left = f64::max(left, f[0].hypot(f[1]) / (mass * step));
            for c in 0..2 {
                v[i][c] = 0.98 * v[i][c] + f[c] / mass;
                p[i][c] += v[i][c];
            }
            let away = [p[i][0], p[i][1] - of.height];
            let distance = away[0].hypot(away[1]);
            if distance < of.sphere {
                let n = [away[0] / distance, away[1] / distance];
                p[i] = [n[0] * of.sphere, of.height + n[1] * of.sphere];
                let inward = v[i][0] * n[0] + v[i][1] * n[1];
                v[i] = [v[i][0] - inward * n[0], v[i][1] - inward * n[1]];
            }
        }
    }
    let cone =
        |w: &[[f64; 2]]| PI * (w[0][0] + w[1][0]) * (w[1][0] - w[0][0]).hypot(w[1][1] - w[0][1]);
    (p.windows(2).map(cone).sum(), left)
}

fn forces(p: &[[f64; 2]], step: f64) -> Vec<[f64; 2]> {
    let mut force = vec![[0.0; 2]; p.len()];
    for i in 0..p.len() - 1 {
        let d = [p[i + 1][0] - p[i][0], p[i + 1][1] - p[i][1]];
        let length = d[0].hypot(d[1]);
        let middle = (i as f64 + 0.5) * step;
        let (t1, t2) = tensions(length / step, 0.5 * (p[i][0] + p[i + 1][0]) / middle);
        let along = TAU * middle * t1;
        let around = TAU * step * t2 * 0.5;
        for c in 0..2 {
            force[i][c] += along * d[c] / length;
            force[i + 1][c] -= along * d[c] / length;
        }
        force[i][0] -= around;
        force[i + 1][0] -= around;
    }
    force
}
