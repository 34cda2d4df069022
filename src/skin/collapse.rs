//! Resistance of the triangles of each layer to collapse: springs along edges alone let a corner pass
//! through the opposite edge, and a fold begins there.

use nalgebra::{Point3, Vector3};

use super::contact::law;
use super::layers::Layers;
use crate::constraints::stencil::Blocks;
use crate::constraints::{Stencil, Stencils};

/// Share of the area at rest at which the resistance begins: far below that of skin that is pressed
/// together beside an implant.
const FIRST: f64 = 0.4;

/// Centre of the quadratic part of the force, as a share of the area.
const MIDDLE: f64 = 0.2;

/// Stiffness relative to the in-plane stiffness of the skin.
const FIRM: f64 = 20.0;

/// A triangle of a layer: energy k w(a/A) with the area at rest A and the area a. The energy w is
/// zero above 0.4 of the area and increases below it.
#[derive(Clone, Copy, Debug)]
pub struct Facet {
    corners: [u32; 3],
    /// A [m^2].
    area: f64,
    /// k [J].
    stiffness: f64,
}

/// The triangles of both layers.
pub type Facets = Stencils<Facet, 3>;

/// The triangles of both layers of skin with an in-plane stiffness [N/m].
pub fn collapse(layers: &Layers, membrane: f64) -> Facets {
    let lower = layers.lower();
    let each = layers.triangles.iter().chain(&lower);
    let facet = |&corners: &[u32; 3]| {
        let [a, b, c] = corners.map(|v| layers.rest[v as usize]);
        let area = 0.5 * (b - a).cross(&(c - a)).norm();
        Facet {
            corners,
            area,
            stiffness: FIRM * membrane * area,
        }
    };
    // Without area at rest there is none to keep.
    let facets = each.map(facet).filter(|f| f.area > 0.0).collect();
    Stencils::new("area of the skin", facets)
}

/// Numbers of w, and derivatives of the share of the area.
type Pressed = ((f64, f64, f64), [Vector3<f64>; 3]);

impl Facet {
    /// Energy, force and second derivative of w, with the derivatives of the share of the area
    /// [1/m]; `None` if the triangle does not resist, or has no direction.
    fn pressed(&self, [a, b, c]: &[Point3<f64>; 3]) -> Option<Pressed> {
        let twice = (b - a).cross(&(c - a));
        let w = law(0.5 * twice.norm() / self.area - MIDDLE, FIRST - MIDDLE);
        if !(w.1 > 0.0) {
            return None;
        }
        let up = twice.try_normalize(0.0)? * (0.5 / self.area);
        let of = |from: &Point3<f64>, to: &Point3<f64>| up.cross(&(to - from));
        Some((w, [of(b, c), of(c, a), of(a, b)]))
    }
}

impl Stencil<3> for Facet {
    fn points(&self) -> [u32; 3] {
        self.corners
    }

    fn energy_and_gradient(&self, x: &[Point3<f64>; 3]) -> Option<(f64, [Vector3<f64>; 3])> {
        let (w, gradient) = self.pressed(x)?;
        let gradient = gradient.map(|g| g * -(self.stiffness * w.1));
        Some((self.stiffness * w.0, gradient))
    }

    /// Without the second derivative of the area: few triangles resist, and the remaining part is
    /// convex.
    fn hessian(&self, x: &[Point3<f64>; 3], _: bool) -> Option<Blocks<3>> {
        let (w, gradient) = self.pressed(x)?;
        let k = self.stiffness * w.2;
        Some(gradient.map(|g| gradient.map(|h| g * h.transpose() * k)))
    }

    /// A third: it holds in one direction of three.
    fn scalar_hessian(&self, x: &[Point3<f64>; 3]) -> Option<[[f64; 3]; 3]> {
        let (w, gradient) = self.pressed(x)?;
        let k = self.stiffness * w.2 / 3.0;
        Some(gradient.map(|g| gradient.map(|h| k * g.dot(&h))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::constraints::Potential;

    #[test]
    fn only_a_triangle_that_collapses_resists_with_the_slope_of_its_energy() {
        let at = |height: f64, z: f64| {
            [[0.0, 0.0], [1.0, 0.0], [0.3, height]]
                .map(|[x, y]| Point3::new(x, y, z))
                .to_vec()
        };
        let layers = Layers {
            triangles: vec![[0, 1, 2]],
            rest: [at(1.0, 0.2), at(1.0, 0.0)].concat(),
            ..Layers::none(1.0)
        };
        let facets = collapse(&layers, 2.0);
        assert_eq!(facets.energy(&layers.rest), 0.0);
        assert_eq!(facets.energy(&[at(0.41, 0.2), at(0.5, 0.0)].concat()), 0.0);
        for height in [0.35, 0.1, 0.02] {
            let x = [at(height, 0.2), at(1.0, 0.0)].concat();
            let mut gradient = vec![Vector3::zeros(); 6];
            let energy = facets.energy_and_gradient(&x, &mut gradient);
            assert!(energy > 0.0 && gradient[2].y < 0.0, "{height}");
            for v in 0..3 {
                for axis in 0..3 {
                    let step = 1e-6;
                    let moved = |by: f64| {
                        let mut x = x.clone();
                        x[v][axis] += by;
                        facets.energy(&x)
                    };
                    let slope = (moved(step) - moved(-step)) / (2.0 * step);
                    // Truncation of the difference, relative to the greatest force.
                    let scale = gradient[2].norm();
                    assert!(
                        (slope - gradient[v][axis]).abs() <= 1e-5 * scale,
                        "{height} {v}"
                    );
                }
            }
        }
    }
}
