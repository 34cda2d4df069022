//! Resistance of each layer of skin to bending: without it, pressed skin folds at the length of an
//! edge, whatever that length is.

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{Point3, Vector3};

use super::layers::Layers;
use crate::constraints::stencil::{Blocks, at};
use crate::constraints::{Bending, Constraint, Stencil, Stencils};

/// Angle [rad] towards which the resistance of a hinge grows without bound: 110 degrees.
const STEEPEST: f64 = 110.0 * PI / 180.0;

/// Greatest angle [rad] of the law; beyond it the law goes on with its last stiffness, so that a
/// hinge that begins folded unfolds.
const FOLDED: f64 = 95.0 * PI / 180.0;

/// Height of a triangle over a hinge, relative to that at rest, below which the hinge is weaker.
const LEVER: f64 = 0.2;

/// A hinge of a layer: energy k (tan(p C)/p)^2 / 2 for the change C of its angle, where p C is a
/// right angle for C = [`STEEPEST`]. For small angles it is that of a plate, k C^2 / 2. Two
/// triangles cannot show how skin of some thickness bends sharply; the growth towards a limit
/// spreads a sharp bend over several edges.
#[derive(Clone, Copy, Debug)]
pub struct Hinge {
    bend: Bending,
    /// k [J].
    stiffness: f64,
    /// The corner beyond the hinge [m], if it is no vertex of the layers.
    beyond: Option<Point3<f64>>,
}

/// The hinges of both layers.
pub type Hinges = Stencils<Hinge, 4>;

/// The hinges of both layers, next to positions `x` [m]. A triangle that is pressed flat against an
/// edge gives its hinge no lever, and the hinge is as weak as the square of its height.
pub fn bending(layers: &Layers, x: &[Point3<f64>]) -> Hinges {
    let hinge = |hinge: &Hinge| {
        let lever = hinge.lever(x, &layers.rest);
        Hinge {
            stiffness: hinge.stiffness * lever * lever,
            ..*hinge
        }
    };
    let each = layers.hinges.iter().map(hinge);
    Stencils::new("bending of the skin", each.collect())
}

impl Hinge {
    /// A hinge with a stiffness [J].
    pub fn new(bend: Bending, stiffness: f64) -> Self {
        Self {
            bend,
            stiffness,
            beyond: None,
        }
    }

    /// The same with a fixed last corner [m]; the last of its points is then another one of them.
    pub fn beside(self, corner: Point3<f64>) -> Self {
        Self {
            beyond: Some(corner),
            ..self
        }
    }

    /// The smaller height of the two triangles at positions `x` [m] in shares of [`LEVER`] of that at
    /// rest, at most 1.
    fn lever(&self, x: &[Point3<f64>], rest: &[Point3<f64>]) -> f64 {
        let heights = |x| heights(self.corners(&at(self.points(), x)));
        let (now, rest) = (heights(x), heights(rest));
        (0..2).fold(1.0, |least, k| least.min(now[k] / (LEVER * rest[k])))
    }

    fn corners(&self, x: &[Point3<f64>; 4]) -> [Point3<f64>; 4] {
        [x[0], x[1], x[2], self.beyond.unwrap_or(x[3])]
    }

    /// The angle with its derivatives with respect to the points.
    fn bent(&self, x: &[Point3<f64>; 4]) -> Option<(f64, [Vector3<f64>; 4])> {
        let (angle, mut gradient) = self.bend.value_and_gradient(&self.corners(x))?;
        if self.beyond.is_some() {
            gradient[3] = Vector3::zeros();
        }
        Some((angle, gradient))
    }
}

/// Heights of the two triangles of a hinge over their common edge [m].
fn heights([a, b, c, d]: [Point3<f64>; 4]) -> [f64; 2] {
    let edge = b - a;
    [c, d].map(|tip| edge.cross(&(tip - a)).norm() / edge.norm())
}

/// Energy, moment and stiffness of a hinge of unit stiffness that is bent by `angle` [rad].
fn law(angle: f64) -> (f64, f64, f64) {
    let (inside, p) = (angle.clamp(-FOLDED, FOLDED), FRAC_PI_2 / STEEPEST);
    let tangent = libm::tan(p * inside);
    let square = 1.0 + tangent * tangent;
    let moment = tangent * square / p;
    let stiffness = square * (1.0 + 3.0 * tangent * tangent);
    let beyond = angle - inside;
    let energy = 0.5 * tangent * tangent / (p * p) + (moment + 0.5 * stiffness * beyond) * beyond;
    (energy, moment + stiffness * beyond, stiffness)
}

impl Stencil<4> for Hinge {
    fn points(&self) -> [u32; 4] {
        self.bend.points
    }

    fn energy_and_gradient(&self, x: &[Point3<f64>; 4]) -> Option<(f64, [Vector3<f64>; 4])> {
        let (angle, gradient) = self.bent(x)?;
        let (energy, moment, _) = law(angle);
        let force = self.stiffness * moment;
        Some((self.stiffness * energy, gradient.map(|g| g * force)))
    }

    /// Without the second derivative of the angle: bending is weak beside tension, and the
    /// remaining part is convex.
    fn hessian(&self, x: &[Point3<f64>; 4], _: bool) -> Option<Blocks<4>> {
        let (angle, gradient) = self.bent(x)?;
        let k = self.stiffness * law(angle).2;
        Some(gradient.map(|g| gradient.map(|h| g * h.transpose() * k)))
    }

    /// A third: it holds in one direction of three.
    fn scalar_hessian(&self, x: &[Point3<f64>; 4]) -> Option<[[f64; 4]; 4]> {
        let (angle, gradient) = self.bent(x)?;
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
            hinges: vec![Hinge::new(Bending::new([0, 1, 2, 3], 0.0), 3.0)],
            ..Layers::none(1.0)
        }
    }

    #[test]
    fn forces_are_the_slope_of_the_energy() {
        let layers = hinge();
        for angle in [0.0, 0.3, -1.2, 1.6, 2.9, -3.0] {
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
        assert!(energy(1.5) > 4.0 * 1.5 * 1.5 * 1.5 && energy(3.1) > 100.0 * 1.5 * 3.1 * 3.1);
        assert!((energy(0.7) - energy(-0.7)).abs() <= 1e-12);
    }

    #[test]
    fn a_corner_outside_of_the_layers_bends_the_same_and_has_no_force() {
        let (layers, x) = (hinge(), turned(0.8));
        let bend = Bending::new([0, 1, 2, 2], 0.0);
        let beside = Layers {
            rest: layers.rest[..3].to_vec(),
            hinges: vec![Hinge::new(bend, 3.0).beside(x[3])],
            ..Layers::none(1.0)
        };
        let mut forces = [vec![Vector3::zeros(); 4], vec![Vector3::zeros(); 3]];
        let energies = [
            bending(&layers, &x).energy_and_gradient(&x, &mut forces[0]),
            bending(&beside, &x[..3]).energy_and_gradient(&x[..3], &mut forces[1]),
        ];
        assert_eq!(energies[0], energies[1]);
        assert_eq!(forces[0][..3], forces[1][..]);
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
