//! Stable time steps of a lattice.

use std::f64::consts::PI;

use nalgebra::{Matrix3, Vector3};

use super::{LatticeSettings, LatticeShape, Neighbours};
use crate::springs::integrators::{Integrator, Verlet};
use crate::springs::stability::Mode;

/// Larger lattices use the largest stiffness of the infinite lattice, a close bound.
const ITERATED: usize = 4096;
/// Greatest number of products with the stiffness matrix.
const PRODUCTS: usize = 2000;
/// Relative change of the largest eigenvalue at which the iteration ends.
const CHANGE: f64 = 1e-7;

/// A direction of springs: steps along x, y, z, and `D n n^T`.
pub(super) struct Direction {
    pub step: [i32; 3],
    pub rest: f64,
    pub stiffness: f64,
    unit: Vector3<f64>,
}

/// The 3, 9 or 13 directions of springs; each also represents its opposite.
pub(super) fn directions(shape: &LatticeShape, settings: &LatticeSettings) -> Vec<Direction> {
    let direction = |&step: &[i32; 3]| {
        let along = Vector3::from([0, 1, 2].map(|c| f64::from(step[c]) * shape.spacing[c]));
        let rest = along.norm();
        let sloped = step.iter().filter(|d| **d != 0).count() > 1;
        let stiffness = settings.stiffness.of(rest) * if sloped { settings.diagonal } else { 1.0 };
        Direction {
            step,
            rest,
            stiffness,
            unit: along / rest,
        }
    };
    settings.neighbours.half().iter().map(direction).collect()
}

/// Largest eigenvalue of the stiffness matrix of the free lattice at rest; pinned points only
/// reduce it.
///
/// Six neighbours: `4 D sin^2(pi (n - 1) / (2 n))`, exact. More neighbours: by power
/// iteration. For large lattices the value of the infinite lattice, which is a bound: missing
/// springs only remove energy.
pub fn largest_stiffness(shape: &LatticeShape, settings: &LatticeSettings) -> f64 {
    let all = directions(shape, settings);
    match settings.neighbours {
        Neighbours::Six => {
            let of = |d: &Direction| {
                let axis = d
                    .step
                    .iter()
                    .position(|s| *s != 0)
                    .expect("a direction goes somewhere");
                let n = shape.points[axis] as f64;
                4.0 * d.stiffness * (PI * (n - 1.0) / (2.0 * n)).sin().powi(2)
            };
            all.iter().map(of).fold(0.0, f64::max)
        }
        _ if shape.count() <= ITERATED => iterated(shape, &all),
        _ => endless(&all),
    }
}

/// The largest eigenvalue of a wave, over a grid of waves that contains the corners, where the
/// maximum lies.
fn endless(all: &[Direction]) -> f64 {
    let angle = |i: i32| PI * f64::from(i) / 8.0;
    let mut largest: f64 = 0.0;
    for x in 0..=8 {
        for y in -8..=8 {
            for z in -8..=8 {
                let mut sum = Matrix3::zeros();
                for d in all {
                    let [dx, dy, dz] = d.step.map(f64::from);
                    let phase = dx * angle(x) + dy * angle(y) + dz * angle(z);
                    sum += d.unit * d.unit.transpose() * (d.stiffness * (2.0 - 2.0 * phase.cos()));
                }
                largest = largest.max(sum.symmetric_eigenvalues().max());
            }
        }
    }
    largest
}

/// Power iteration from a fixed start.
fn iterated(shape: &LatticeShape, all: &[Direction]) -> f64 {
    let [nx, ny, nz] = shape.points;
    let count = shape.count();
    let mut seed = 1u64;
    let mut draw = || {
        seed = seed
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (seed >> 11) as f64 / (1u64 << 53) as f64 - 0.5
    };
    // The stiffest waves alternate in sign from point to point.
    let sign = |p: usize| {
        if (p % nx + p / nx % ny + p / (nx * ny)).is_multiple_of(2) {
            1.0
        } else {
            -1.0
        }
    };
    let mut u: Vec<Vector3<f64>> = (0..count)
        .map(|p| Vector3::new(draw(), draw(), sign(p) * 0.1))
        .collect();
    let mut value = 0.0;
    for _ in 0..PRODUCTS {
        let length = u.iter().map(Vector3::norm_squared).sum::<f64>().sqrt();
        if !(length > 0.0) {
            return 0.0;
        }
        u.iter_mut().for_each(|v| *v /= length);
        let mut product = vec![Vector3::zeros(); count];
        for d in all {
            for p in 0..count {
                let at = [p % nx, p / nx % ny, p / (nx * ny)];
                let to = [0, 1, 2].map(|c| at[c].checked_add_signed(d.step[c] as isize));
                let [Some(x), Some(y), Some(z)] = to else {
                    continue;
                };
                if x < nx && y < ny && z < nz {
                    let q = (z * ny + y) * nx + x;
                    let f = d.unit * (d.stiffness * d.unit.dot(&(u[p] - u[q])));
                    product[p] += f;
                    product[q] -= f;
                }
            }
        }
        let next = u.iter().zip(&product).map(|(a, b)| a.dot(b)).sum::<f64>();
        u = product;
        let done = (next - value).abs() <= CHANGE * next;
        value = next;
        if done {
            break;
        }
    }
    value
}

/// The greatest stable time step of Verlet with backward-difference damping:
/// `k dt^2 + 2 c dt < 4 m` \[s\].
pub fn stability_limit(stiffness: f64, mass: f64, damping: f64) -> f64 {
    Verlet::default().limit(Mode::of(stiffness, damping, mass))
}
