//! Resistance of skin to thinning: the length of crossing diagonals alone is the same if the layers
//! change sides.

use nalgebra::{Point3, Vector3};

use super::contact::law;
use super::layers::Layers;
use crate::constraints::stencil::Blocks;
use crate::constraints::{Stencil, Stencils};

/// Volume share between the layers at which the resistance begins; the resistance is that of a
/// spring as far below [`MIDDLE`].
const FIRST: f64 = 0.8;

/// Centre of the quadratic part of the force, as a volume share.
const MIDDLE: f64 = 0.5;

/// The material between two triangles: energy V K w(v/V) with rest volume V and volume v. The
/// energy w is zero above a volume share of 0.8 and increases below it.
#[derive(Clone, Copy, Debug)]
pub struct Prism {
    /// Three corners of the lower triangle, then those above them.
    corners: [u32; 6],
    /// Volume at rest V [m^3].
    volume: f64,
    /// V K [J].
    stiffness: f64,
}

/// A volume share with its derivatives with respect to the corners [1/m].
struct Share {
    value: f64,
    gradient: [Vector3<f64>; 6],
}

impl Prism {
    /// Volume and derivatives: the mean area vector of both triangles times the vector between
    /// their centroids.
    fn measure(&[a, b, c, d, e, f]: &[Point3<f64>; 6]) -> (f64, [Vector3<f64>; 6]) {
        let area = ((b - a).cross(&(c - a)) + (e - d).cross(&(f - d))) / 4.0;
        let axis = ((d - a) + (e - b) + (f - c)) / 3.0;
        let third = area / 3.0;
        // The derivative of a triangle's area vector with respect to a corner is the cross product
        // with the opposite side.
        let turned = |from: Point3<f64>, to: Point3<f64>| (from - to).cross(&axis) / 4.0;
        let gradient = [
            turned(b, c) - third,
            turned(c, a) - third,
            turned(a, b) - third,
            turned(e, f) + third,
            turned(f, d) + third,
            turned(d, e) + third,
        ];
        (area.dot(&axis), gradient)
    }

    fn share(&self, x: &[Point3<f64>; 6]) -> Share {
        let (volume, gradient) = Self::measure(x);
        Share {
            value: volume / self.volume,
            gradient: gradient.map(|g| g / self.volume),
        }
    }

    /// Energy, force and second derivative of w, and the share; `None` if the prism does not
    /// resist.
    fn pressed(&self, x: &[Point3<f64>; 6]) -> Option<((f64, f64, f64), Share)> {
        let share = self.share(x);
        let w = law(share.value - MIDDLE, FIRST - MIDDLE);
        (w.1 > 0.0).then_some((w, share))
    }
}

/// The prisms between both layers.
pub type Thickness = Stencils<Prism, 6>;

/// The prisms between both layers, which resist with `stiffness` K [Pa].
pub fn thickness(layers: &Layers, stiffness: f64) -> Thickness {
    let n = layers.count() as u32;
    let prism = |t: &[u32; 3]| {
        let corners = [t[0] + n, t[1] + n, t[2] + n, t[0], t[1], t[2]];
        let (volume, _) = Prism::measure(&corners.map(|v| layers.rest[v as usize]));
        Prism {
            corners,
            volume,
            stiffness: volume * stiffness,
        }
    };
    // Without volume at rest there is none to keep.
    let prisms = layers.triangles.iter().map(prism);
    let prisms = prisms.filter(|p| p.volume > 0.0).collect();
    Stencils::new("thickness of the skin", prisms)
}

impl Stencil<6> for Prism {
    fn points(&self) -> [u32; 6] {
        self.corners
    }

    fn energy_and_gradient(&self, x: &[Point3<f64>; 6]) -> Option<(f64, [Vector3<f64>; 6])> {
        let (w, share) = self.pressed(x)?;
        let gradient = share.gradient.map(|g| g * -(self.stiffness * w.1));
        Some((self.stiffness * w.0, gradient))
    }

    /// Without the second derivative of the volume: few prisms resist, and the remaining part is
    /// convex.
    fn hessian(&self, x: &[Point3<f64>; 6], _: bool) -> Option<Blocks<6>> {
        let (w, Share { gradient, .. }) = self.pressed(x)?;
        let k = self.stiffness * w.2;
        Some(gradient.map(|g| gradient.map(|h| g * h.transpose() * k)))
    }

    /// A third: it holds in one direction of three.
    fn scalar_hessian(&self, x: &[Point3<f64>; 6]) -> Option<[[f64; 6]; 6]> {
        let (w, Share { gradient, .. }) = self.pressed(x)?;
        let k = self.stiffness * w.2 / 3.0;
        Some(gradient.map(|g| gradient.map(|h| k * g.dot(&h))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::constraints::Potential;

    /// A prism of width 1 and height 0.2.
    fn prism() -> (Thickness, Vec<Point3<f64>>) {
        let flat = [[0.0, 0.0], [1.0, 0.0], [0.2, 0.9]];
        let at = |z: f64| flat.map(|[x, y]| Point3::new(x, y, z));
        let layers = Layers {
            triangles: vec![[0, 1, 2]],
            rest: [at(0.2), at(0.0)].concat(),
            ..Layers::none(1.0)
        };
        (thickness(&layers, 3.0), layers.rest)
    }

    #[test]
    fn forces_are_the_slope_of_the_energy() {
        let (thickness, rest) = prism();
        // Half as thick, sheared under compression, inverted.
        for (squeeze, lean) in [(0.5, 0.0), (0.3, 0.4), (-0.5, 0.2), (0.75, 1.3)] {
            let mut x = rest.clone();
            for (k, p) in x.iter_mut().enumerate() {
                let by = lean * p.z * (1.0 + 0.3 * k as f64);
                *p = Point3::new(p.x + by, p.y - 0.1 * by, p.z * squeeze + 0.02 * p.x);
            }
            let mut gradient = vec![Vector3::zeros(); 6];
            let energy = thickness.energy_and_gradient(&x, &mut gradient);
            assert!(energy > 0.0 && (energy - thickness.energy(&x)).abs() <= 1e-15 * energy);
            for v in 0..6 {
                for axis in 0..3 {
                    let step = 1e-6;
                    let moved = |by: f64| {
                        let mut x = x.clone();
                        x[v][axis] += by;
                        thickness.energy(&x)
                    };
                    let slope = (moved(step) - moved(-step)) / (2.0 * step);
                    // Truncation error of the difference: the square of the step; rounding: 1e-16
                    // of the energy over the step.
                    assert!(
                        (slope - gradient[v][axis]).abs() <= 1e-8 * gradient[v].norm().max(energy),
                        "{squeeze} {v}"
                    );
                }
            }
            let total: Vector3<f64> = gradient.iter().sum();
            assert!(total.norm() <= 1e-14 * gradient.iter().map(Vector3::norm).sum::<f64>());
        }
    }

    #[test]
    fn thick_skin_is_left_alone() {
        let (thickness, rest) = prism();
        assert_eq!(thickness.energy(&rest), 0.0);
        let squeezed = |by: f64| {
            thickness.energy(
                &rest
                    .iter()
                    .map(|p| Point3::new(p.x, p.y, p.z * by))
                    .collect::<Vec<_>>(),
            )
        };
        assert_eq!(squeezed(0.81), 0.0);
        assert!(squeezed(0.79) > 0.0 && squeezed(-0.79) > squeezed(0.1));
    }
}
