//! Skin keeps its thickness: crossing diagonals alone are as long if the layers change sides.

use nalgebra::{Matrix3, Point3, Vector3};

use super::contact::law;
use super::layers::Layers;
use crate::mesh::sum::NeumaierSum;
use crate::solvers::potential::Potential;
use crate::state::{DecodeError, Reader, State, Writer};

/// It begins to resist where what lies between the layers has this share of its volume, and as a spring from as far below
/// [`MIDDLE`].
const FIRST: f64 = 0.8;

/// The parabola of forces ends as far below this share as it begins above.
const MIDDLE: f64 = 0.5;

/// What lies between two triangles.
#[derive(Clone, Copy, Debug)]
struct Prism {
    /// Three corners of the lower triangle, then those above them.
    corners: [u32; 6],
    /// Volume at rest [m^3].
    volume: f64,
}

/// A share of the volume at rest and its derivatives by the corners [1/m].
struct Share {
    value: f64,
    gradient: [Vector3<f64>; 6],
}

impl Prism {
    /// The mean area vector of both triangles times the way between their middles.
    fn measure(&self, x: &[Point3<f64>]) -> (f64, [Vector3<f64>; 6]) {
        let [a, b, c, d, e, f] = self.corners.map(|v| x[v as usize]);
        let area = ((b - a).cross(&(c - a)) + (e - d).cross(&(f - d))) / 4.0;
        let way = ((d - a) + (e - b) + (f - c)) / 3.0;
        let third = area / 3.0;
        // The area vector of a triangle changes with a corner as the cross product of the side opposite.
        let turned = |from: Point3<f64>, to: Point3<f64>| (from - to).cross(&way) / 4.0;
        let gradient = [
            turned(b, c) - third,
            turned(c, a) - third,
            turned(a, b) - third,
            turned(e, f) + third,
            turned(f, d) + third,
            turned(d, e) + third,
        ];
        (area.dot(&way), gradient)
    }

    fn share(&self, x: &[Point3<f64>]) -> Share {
        let (volume, gradient) = self.measure(x);
        Share {
            value: volume / self.volume,
            gradient: gradient.map(|g| g / self.volume),
        }
    }
}

/// The energy V K w(v/V) over all prisms with rest volume V and volume v; w grows below 0.8.
#[derive(Clone, Debug)]
pub struct Thickness {
    prisms: Vec<Prism>,
    /// K [Pa].
    stiffness: f64,
}

impl Thickness {
    /// Between both layers, which resist with `stiffness` [Pa].
    pub fn new(layers: &Layers, stiffness: f64) -> Self {
        let n = layers.count() as u32;
        let prism = |t: &[u32; 3]| {
            let corners = [t[0] + n, t[1] + n, t[2] + n, t[0], t[1], t[2]];
            let empty = Prism {
                corners,
                volume: 1.0,
            };
            Prism {
                volume: empty.measure(&layers.rest).0,
                ..empty
            }
        };
        // Without volume at rest there is none to keep.
        let prisms = layers
            .triangles
            .iter()
            .map(prism)
            .filter(|p| p.volume > 0.0)
            .collect();
        Self { prisms, stiffness }
    }

    /// Those that resist: stiffness [J], force and second derivative of w, the share.
    fn pressed(
        &self,
        x: &[Point3<f64>],
    ) -> impl Iterator<Item = (&Prism, f64, (f64, f64, f64), Share)> {
        self.prisms.iter().filter_map(move |prism| {
            let share = prism.share(x);
            let w = law(share.value - MIDDLE, FIRST - MIDDLE);
            (w.1 > 0.0).then_some((prism, prism.volume * self.stiffness, w, share))
        })
    }
}

impl State for Thickness {
    fn save(&self, _: &mut Writer) {}

    fn restore(&mut self, _: &mut Reader<'_>) -> Result<(), DecodeError> {
        Ok(())
    }
}

impl Potential for Thickness {
    fn name(&self) -> &'static str {
        "thickness of the skin"
    }

    fn energy(&self, x: &[Point3<f64>]) -> f64 {
        let mut sum = NeumaierSum::default();
        self.pressed(x).for_each(|(_, k, w, _)| sum.add(k * w.0));
        sum.total()
    }

    fn energy_and_gradient(&self, x: &[Point3<f64>], gradient: &mut [Vector3<f64>]) -> f64 {
        let mut sum = NeumaierSum::default();
        for (prism, k, w, share) in self.pressed(x) {
            sum.add(k * w.0);
            let each = prism.corners.iter().zip(&share.gradient);
            each.for_each(|(p, g)| gradient[*p as usize] -= g * (k * w.1));
        }
        sum.total()
    }

    fn pairs(&self, pair: &mut dyn FnMut(u32, u32)) {
        for prism in &self.prisms {
            for (i, p) in prism.corners.iter().enumerate() {
                prism.corners[..i].iter().for_each(|q| pair(*p, *q));
            }
        }
    }

    fn hessian(&self, x: &[Point3<f64>], _: bool, add: &mut dyn FnMut(u32, u32, &Matrix3<f64>)) {
        for (prism, k, w, share) in self.pressed(x) {
            // Without the volume's own second derivative: few prisms resist, and what is left is convex.
            for (p, g) in prism.corners.iter().zip(&share.gradient) {
                for (q, h) in prism.corners.iter().zip(&share.gradient) {
                    add(*p, *q, &(g * h.transpose() * (k * w.2)));
                }
            }
        }
    }

    fn scalar_hessian(&self, x: &[Point3<f64>], add: &mut dyn FnMut(u32, u32, f64)) {
        for (prism, k, w, share) in self.pressed(x) {
            for (p, g) in prism.corners.iter().zip(&share.gradient) {
                for (q, h) in prism.corners.iter().zip(&share.gradient) {
                    // A third: it holds in one direction of three.
                    add(*p, *q, k * w.2 / 3.0 * g.dot(h));
                }
            }
        }
    }

    fn force_scale(&self, _: &[Point3<f64>]) -> f64 {
        // Judged by what the springs exert.
        0.0
    }

    fn remember(&mut self, _: &[Point3<f64>]) {}

    fn bytes(&self) -> usize {
        self.prisms.capacity() * size_of::<Prism>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One prism, 1 wide and 0.2 high.
    fn prism() -> (Thickness, Vec<Point3<f64>>) {
        let flat = [[0.0, 0.0], [1.0, 0.0], [0.2, 0.9]];
        let at = |z: f64| flat.map(|[x, y]| Point3::new(x, y, z));
        let layers = Layers {
            triangles: vec![[0, 1, 2]],
            rest: [at(0.2), at(0.0)].concat(),
            ..Layers::none(1.0)
        };
        (Thickness::new(&layers, 3.0), layers.rest)
    }

    #[test]
    fn forces_are_the_slope_of_the_energy() {
        let (thickness, rest) = prism();
        // Half as thick, pressed askew, turned inside out.
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
                    // Truncation of the difference: the square of the step; rounding: 1e-16 of the energy over the step.
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
