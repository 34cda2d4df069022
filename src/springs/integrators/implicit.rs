//! The equations of implicit steps, by Newton's method with matrix-free conjugate gradients.

use nalgebra::{Point3, Vector3};

use super::StepError;
use crate::mesh::measures::max_or_nan;
use crate::mesh::sum::tree_sum_by;
use crate::springs::system::SpringSystem;

/// Greatest number of Newton iterations.
const NEWTON: usize = 60;
/// A residual below this share of the forces in the equation is rounding error.
const SOLVED: f64 = 1e-11;
/// Relative displacements below this value are rounding error.
const ROUNDED: f64 = 4.0 * f64::EPSILON;
/// Relative residual of a linear solve.
const LINEAR: f64 = 1e-4;

/// The equation `m (v' - v_a) = h (f(x_a + h v') - c v')` of each free point, for v'.
pub(super) struct Equation<'a> {
    /// x_a [m].
    pub(super) x: &'a [Point3<f64>],
    /// v_a [m/s].
    pub(super) v: &'a [Vector3<f64>],
    /// h [s].
    pub(super) h: f64,
}

fn dot(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    tree_sum_by(a.len(), |i| a[i].dot(&b[i]))
}

impl Equation<'_> {
    /// Solves the equation and sets positions and velocities of the system; `dt` is for the error
    /// message.
    pub(super) fn solve(&self, system: &mut SpringSystem, dt: f64) -> Result<(), StepError> {
        let mut v = system.velocity.clone();
        let mut x = system.position.clone();
        let mut residual = vec![Vector3::zeros(); x.len()];
        let mut least = f64::INFINITY;
        for _ in 0..NEWTON {
            self.place(system, &v, &mut x);
            let scale = self.residual(system, &x, &v, &mut residual);
            let size = dot(&residual, &residual).sqrt();
            if !size.is_finite() {
                break;
            }
            if size <= SOLVED * scale || size == 0.0 {
                system.position = x;
                system.velocity = v;
                return Ok(());
            }
            // Far from the solution the residual can increase once; further increases mean
            // divergence.
            if size > 1e6 * least {
                break;
            }
            least = least.min(size);
            let step = self.linear(system, &x, &residual);
            v.iter_mut().zip(&step).for_each(|(v, step)| *v += step);
            // A stiff force has more rounding than the tolerance; the positions are then as
            // accurate as possible.
            let moves = max_or_nan(step.iter().map(|s| s.norm())) * self.h;
            let moved = max_or_nan(x.iter().zip(&system.position).map(|(x, b)| (x - b).norm()));
            let reach = max_or_nan(x.iter().map(|x| x.coords.norm()));
            if moves <= SOLVED * moved + ROUNDED * reach {
                self.place(system, &v, &mut x);
                system.position = x;
                system.velocity = v;
                return Ok(());
            }
        }
        Err(StepError::NotSolved {
            dt,
            iterations: NEWTON,
        })
    }

    /// The residual of the equation [N s], and the magnitude of its terms.
    fn residual(
        &self,
        system: &SpringSystem,
        x: &[Point3<f64>],
        v: &[Vector3<f64>],
        residual: &mut Vec<Vector3<f64>>,
    ) -> f64 {
        // The residual starts with the forces.
        system.static_force(x, residual);
        let mut scale = 0.0;
        for (i, residual) in residual
            .iter_mut()
            .enumerate()
            .filter(|(i, _)| !system.pinned()[*i])
        {
            let m = system.mass()[i];
            let (inertia, push) = (
                (v[i] - self.v[i]) * m,
                (*residual - v[i] * system.damping) * self.h,
            );
            *residual = push - inertia;
            // Momenta count too: differences of velocities are no more accurate than the
            // velocities.
            scale += push.norm_squared() + (v[i].norm_squared() + self.v[i].norm_squared()) * m * m;
        }
        scale.sqrt()
    }

    fn place(&self, system: &SpringSystem, v: &[Vector3<f64>], x: &mut [Point3<f64>]) {
        for i in 0..x.len() {
            x[i] = if system.pinned()[i] {
                system.position[i]
            } else {
                self.x[i] + v[i] * self.h
            };
        }
    }

    /// Solves `(m + h c + h^2 K) s = r` by conjugate gradients.
    fn linear(
        &self,
        system: &SpringSystem,
        x: &[Point3<f64>],
        r: &[Vector3<f64>],
    ) -> Vec<Vector3<f64>> {
        let h = self.h;
        let diagonal: Vec<f64> = system
            .mass()
            .iter()
            .map(|m| m + h * system.damping)
            .collect();
        let (mut free, mut product) = (Vec::new(), Vec::new());
        let mut s = vec![Vector3::zeros(); r.len()];
        let mut r = r.to_vec();
        let precondition = |r: &[Vector3<f64>]| -> Vec<Vector3<f64>> {
            r.iter().zip(&diagonal).map(|(r, d)| r / *d).collect()
        };
        let mut z = precondition(&r);
        let mut p = z.clone();
        let mut rz = dot(&r, &z);
        let stop = LINEAR * LINEAR * rz;
        for _ in 0..4 * r.len() + 20 {
            if !(rz > stop) {
                break;
            }
            system.product(x, &p, true, &mut free, &mut product);
            product
                .iter_mut()
                .zip(&p)
                .zip(&diagonal)
                .for_each(|((q, p), d)| *q = *q * (h * h) + p * *d);
            let curvature = dot(&p, &product);
            if !(curvature > 0.0) {
                break;
            }
            let step = rz / curvature;
            for i in 0..r.len() {
                s[i] += p[i] * step;
                r[i] -= product[i] * step;
            }
            z = precondition(&r);
            let next = dot(&r, &z);
            let share = next / rz;
            rz = next;
            p.iter_mut().zip(&z).for_each(|(p, z)| *p = z + *p * share);
        }
        s
    }
}
