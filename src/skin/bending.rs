//! Resistance of each layer of skin to bending: without it, pressed skin folds at the length of an
//! edge, whatever that length is.

use nalgebra::{Point3, Vector3};

use super::layers::Layers;
use crate::constraints::stencil::Blocks;
use crate::constraints::{Bending, Constraint, Stencil, Stencils};

/// Greatest angle [rad] of the law; beyond it the law goes on with its last stiffness, so that a
/// hinge that begins folded through itself unfolds.
const FOLDED: f64 = 2.6;

/// Height of a triangle over a hinge, relative to that at rest, below which the hinge is weaker.
const LEVER: f64 = 0.2;

/// A hinge of a layer: energy k (2 tan(C/2))^2 / 2 for the change C of its angle. 2 tan(C/2) over
/// the length beside the hinge is the curvature of the circle that touches both triangles there; it
/// is C for small angles, and grows without bound towards a fold through itself.
#[derive(Clone, Copy, Debug)]
pub struct Hinge {
    bend: Bending,
    /// k [J].
    stiffness: f64,
}

/// The hinges of both layers.
pub type Hinges = Stencils<Hinge, 4>;

/// The hinges of both layers, next to positions `x` [m]. A triangle that is pressed flat against an
/// edge gives its hinge no lever, and the hinge is as weak as the square of its height.
pub fn bending(layers: &Layers, x: &[Point3<f64>]) -> Hinges {
    let hinge = |(&bend, &stiffness): (&Bending, &f64)| {
        let [now, rest] = [x, &layers.rest].map(|x| heights(bend.points.map(|v| x[v as usize])));
        let share = |k: usize| (now[k] / (LEVER * rest[k])).min(1.0);
        let least = share(0).min(share(1));
        Hinge {
            bend,
            stiffness: stiffness * least * least,
        }
    };
    let each = layers.hinges.iter().zip(&layers.bending);
    Stencils::new("bending of the skin", each.map(hinge).collect())
}

/// Heights of the two triangles of a hinge over their common edge [m].
fn heights([a, b, c, d]: [Point3<f64>; 4]) -> [f64; 2] {
    let edge = b - a;
    [c, d].map(|tip| edge.cross(&(tip - a)).norm() / edge.norm())
}

/// Energy, moment and stiffness of a hinge of unit stiffness that is bent by `angle` [rad].
fn law(angle: f64) -> (f64, f64, f64) {
    let inside = angle.clamp(-FOLDED, FOLDED);
    let tangent = libm::tan(0.5 * inside);
    let square = 1.0 + tangent * tangent;
    let moment = 2.0 * tangent * square;
    let stiffness = square * (1.0 + 3.0 * tangent * tangent);
    let beyond = angle - inside;
    let energy = 2.0 * tangent * tangent + (moment + 0.5 * stiffness * beyond) * beyond;
    (energy, moment + stiffness * beyond, stiffness)
}

impl Stencil<4> for Hinge {
    fn points(&self) -> [u32; 4] {
        self.bend.points
    }

    fn energy_and_gradient(&self, x: &[Point3<f64>; 4]) -> Option<(f64, [Vector3<f64>; 4])> {
        let (angle, gradient) = self.bend.value_and_gradient(x)?;
        let (energy, moment, _) = law(angle);
        let force = self.stiffness * moment;
        Some((self.stiffness * energy, gradient.map(|g| g * force)))
    }

    /// Without the second derivative of the angle: bending is weak beside tension, and the
    /// remaining part is convex.
    fn hessian(&self, x: &[Point3<f64>; 4], _: bool) -> Option<Blocks<4>> {
        let (angle, gradient) = self.bend.value_and_gradient(x)?;
        let k = self.stiffness * law(angle).2;
        Some(gradient.map(|g| gradient.map(|h| g * h.transpose() * k)))
    }

    /// A third: it holds in one direction of three.
    fn scalar_hessian(&self, x: &[Point3<f64>; 4]) -> Option<[[f64; 4]; 4]> {
        let (angle, gradient) = self.bend.value_and_gradient(x)?;
        let k = self.stiffness * law(angle).2 / 3.0;
        Some(gradient.map(|g| gradient.map(|h| k * g.dot(&h))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::constraints::Potential;
    use crate::skin::layers::Layers;

    /// Two triangles of 1 m, flat at rest, with the second one turned by an angle [rad].
    fn turned(angle: f64) -> Vec<Point3<f64>> {
        let (x, z) = (-libm::cos(angle), libm::sin(angle));
        [
            [0.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [1.0, 0.4, 0.0],
            [x, 0.6, z],
        ]
        .map(Point3::from)
        .to_vec()
    }

    fn hinge() -> Layers {
        Layers {
            rest: turned(0.0),
            hinges: vec![Bending::new([0, 1, 2, 3], 0.0)],
            bending: vec![3.0],
            ..Layers::none(1.0)
        }
    }

    #[test]
    fn forces_are_the_slope_of_the_energy() {
        let layers = hinge();
        for angle in [0.0, 0.3, -1.2, 2.2, 2.9, -3.0] {
            let x = turned(angle);
            let hinges = bending(&layers, &x);
            let mut gradient = vec![Vector3::zeros(); 4];
            let energy = hinges.energy_and_gradient(&x, &mut gradient);
            for v in 0..4 {
                for axis in 0..3 {
                    let step = 1e-6;
                    let moved = |by: f64| {
                        let mut x = x.clone();
                        x[v][axis] += by;
                        hinges.energy(&x)
                    };
                    let slope = (moved(step) - moved(-step)) / (2.0 * step);
                    // Truncation: the square of the step; rounding: 1e-16 of the energy over it.
                    let scale = gradient[v].norm().max(energy).max(1.0);
                    assert!(
                        (slope - gradient[v][axis]).abs() <= 1e-7 * scale,
                        "{angle} {v}"
                    );
                }
            }
        }
    }

    #[test]
    fn a_small_bend_costs_its_square_and_a_fold_through_itself_far_more() {
        let layers = hinge();
        let energy = |angle: f64| {
            let x = turned(angle);
            bending(&layers, &x).energy(&x)
        };
        // k C^2 / 2, but for the fourth power of C.
        assert!((energy(0.01) / (1.5 * 1e-4) - 1.0).abs() <= 1e-4);
        assert!(energy(3.1) > 10.0 * 1.5 * 3.1 * 3.1);
        assert!((energy(0.7) - energy(-0.7)).abs() <= 1e-12);
    }

    #[test]
    fn a_triangle_pressed_flat_exerts_no_large_force() {
        let layers = hinge();
        let mut x = turned(1.5);
        x[3] = Point3::new(-1e-9, 0.6, 2e-9);
        let mut gradient = vec![Vector3::zeros(); 4];
        bending(&layers, &x).energy_and_gradient(&x, &mut gradient);
        assert!(gradient.iter().all(|g| g.norm() <= 1e-3), "{gradient:?}");
    }
}
