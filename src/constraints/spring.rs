//! Springs: a law of tension along a vector between points.

use nalgebra::{Matrix3, Point3, Vector3};

use super::stencil::{Blocks, Stencil, Stencils};

/// Tension of a spring as a function of its length.
///
/// ```
/// use nalgebra::{Point3, Vector3};
/// use pliant::constraints::{Between, Spring, SpringLaw};
/// use pliant::constraints::{Potential, Stencils};
///
/// /// A spring without rest length whose tension grows with the cube of its length, 1 N at 1 m.
/// #[derive(Clone, Copy)]
/// struct Cubic;
///
/// impl SpringLaw for Cubic {
///     fn energy(&self, length: f64) -> f64 {
///         length.powi(4) / 4.0
///     }
///     fn tension(&self, length: f64) -> f64 {
///         length.powi(3)
///     }
///     fn slope(&self, length: f64) -> f64 {
///         3.0 * length.powi(2)
///     }
/// }
///
/// let spring = Spring { arm: Between([0, 1]), law: Cubic };
/// let part = Stencils::new("cubic springs", vec![spring]);
/// let x = [Point3::origin(), Point3::new(2.0, 0.0, 0.0)];
/// let mut gradient = [Vector3::zeros(); 2];
/// assert_eq!(part.energy_and_gradient(&x, &mut gradient), 4.0);
/// assert_eq!(gradient, [Vector3::x() * -8.0, Vector3::x() * 8.0]);
/// ```
pub trait SpringLaw: Copy + Send + Sync + 'static {
    /// Stored energy [J] at a length [m].
    fn energy(&self, length: f64) -> f64;

    /// Tension [N] at a length [m]; positive values pull.
    fn tension(&self, length: f64) -> f64;

    /// Derivative of the tension with respect to the length [N/m].
    fn slope(&self, length: f64) -> f64;

    /// Tension over length [N/m]; its limit, or 0, at length 0.
    #[inline]
    fn tension_per_length(&self, length: f64) -> f64 {
        if length > 0.0 {
            self.tension(length) / length
        } else {
            0.0
        }
    }

    /// Energy [J] and tension over length [N/m] along the vector `d` [m].
    #[inline]
    fn along(&self, d: &Vector3<f64>) -> (f64, f64) {
        let length = d.norm();
        (self.energy(length), self.tension_per_length(length))
    }

    /// Second derivative along `d` [N/m]: slope u u^T + tension/length (1 - u u^T), with u the
    /// direction of `d`. With `convex`, negative factors become 0.
    #[inline]
    fn block(&self, d: &Vector3<f64>, convex: bool) -> Matrix3<f64> {
        let (length, slope, across) = self.factors(d, convex);
        if length > 0.0 {
            let unit = d / length;
            Matrix3::identity() * across + unit * unit.transpose() * (slope - across)
        } else {
            Matrix3::from_diagonal_element(across)
        }
    }

    /// [`Self::block`] times the displacement `u` [m].
    #[inline]
    fn product(&self, d: &Vector3<f64>, u: Vector3<f64>, convex: bool) -> Vector3<f64> {
        let (length, slope, across) = self.factors(d, convex);
        if length > 0.0 {
            let unit = d / length;
            u * across + unit * ((slope - across) * unit.dot(&u))
        } else {
            u * across
        }
    }

    /// Length [m], slope [N/m] and tension over length [N/m]. With `convex`, negative factors
    /// become 0.
    #[inline]
    fn factors(&self, d: &Vector3<f64>, convex: bool) -> (f64, f64, f64) {
        let length = d.norm();
        let (slope, across) = (self.slope(length), self.tension_per_length(length));
        if convex {
            (length, slope.max(0.0), across.max(0.0))
        } else {
            (length, slope, across)
        }
    }

    /// Greatest absolute factor of the second derivative [N/m].
    #[inline]
    fn stiffest(&self, length: f64) -> f64 {
        self.slope(length)
            .abs()
            .max(self.tension_per_length(length).abs())
    }

    /// A stiffness [N/m] that approximates the second derivative, equally in all directions of
    /// space.
    #[inline]
    fn scalar(&self, length: f64) -> f64 {
        self.slope(length)
    }

    /// Force [N] at a strain of one, for a spring of the length of `d` [m]; 0 if other terms define
    /// the scale of forces.
    #[inline]
    fn force_scale(&self, _d: &Vector3<f64>) -> f64 {
        0.0
    }
}

/// The law of a linear spring without rest length: energy k d^2 / 2.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Linear {
    /// Stiffness k [N/m].
    pub stiffness: f64,
    /// Force at a strain of one [N]; 0 if other terms define the scale of forces.
    pub force_scale: f64,
}

impl SpringLaw for Linear {
    #[inline]
    fn energy(&self, length: f64) -> f64 {
        0.5 * self.stiffness * length * length
    }

    #[inline]
    fn tension(&self, length: f64) -> f64 {
        self.stiffness * length
    }

    #[inline]
    fn slope(&self, _: f64) -> f64 {
        self.stiffness
    }

    #[inline]
    fn tension_per_length(&self, _: f64) -> f64 {
        self.stiffness
    }

    // The square of the length needs no root.
    #[inline]
    fn along(&self, d: &Vector3<f64>) -> (f64, f64) {
        (0.5 * self.stiffness * d.norm_squared(), self.stiffness)
    }

    #[inline]
    fn force_scale(&self, _: &Vector3<f64>) -> f64 {
        self.force_scale
    }
}

impl Linear {
    /// A spring of `stiffness` [N/m] among other terms, which define the scale of forces.
    pub fn new(stiffness: f64) -> Self {
        Self {
            stiffness,
            force_scale: 0.0,
        }
    }
}

/// A vector that is a linear function of `K` points. A spring acts along it.
pub trait Arm<const K: usize>: Copy + Send + Sync + 'static {
    /// Derivative of the vector with respect to each point.
    const WEIGHTS: [f64; K];

    /// The points.
    fn points(&self) -> [u32; K];

    /// The vector [m].
    fn vector(&self, x: &[Point3<f64>; K]) -> Vector3<f64>;

    /// Change of the vector for given displacements of the points [m].
    fn change(p: &[Vector3<f64>; K]) -> Vector3<f64>;
}

/// From the second point to the first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Between(pub [u32; 2]);

impl Arm<2> for Between {
    const WEIGHTS: [f64; 2] = [1.0, -1.0];

    #[inline]
    fn points(&self) -> [u32; 2] {
        self.0
    }

    #[inline]
    fn vector(&self, x: &[Point3<f64>; 2]) -> Vector3<f64> {
        x[0] - x[1]
    }

    #[inline]
    fn change(p: &[Vector3<f64>; 2]) -> Vector3<f64> {
        p[0] - p[1]
    }
}

/// From a fixed position in space to a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FromPlace {
    /// The point.
    pub point: u32,
    /// The fixed position [m].
    pub place: Point3<f64>,
}

impl Arm<1> for FromPlace {
    const WEIGHTS: [f64; 1] = [1.0];

    #[inline]
    fn points(&self) -> [u32; 1] {
        [self.point]
    }

    #[inline]
    fn vector(&self, x: &[Point3<f64>; 1]) -> Vector3<f64> {
        x[0] - self.place
    }

    #[inline]
    fn change(p: &[Vector3<f64>; 1]) -> Vector3<f64> {
        p[0]
    }
}

/// The displacement of the first point from its target minus that of the second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Displacement {
    /// The points.
    pub points: [u32; 2],
    /// Their targets [m].
    pub targets: [Point3<f64>; 2],
}

impl Arm<2> for Displacement {
    const WEIGHTS: [f64; 2] = [1.0, -1.0];

    #[inline]
    fn points(&self) -> [u32; 2] {
        self.points
    }

    #[inline]
    fn vector(&self, x: &[Point3<f64>; 2]) -> Vector3<f64> {
        (x[0] - self.targets[0]) - (x[1] - self.targets[1])
    }

    #[inline]
    fn change(p: &[Vector3<f64>; 2]) -> Vector3<f64> {
        p[0] - p[1]
    }
}

/// From the first point to the midpoint of the other two.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ToMiddle(pub [u32; 3]);

impl Arm<3> for ToMiddle {
    const WEIGHTS: [f64; 3] = [-1.0, 0.5, 0.5];

    #[inline]
    fn points(&self) -> [u32; 3] {
        self.0
    }

    #[inline]
    fn vector(&self, x: &[Point3<f64>; 3]) -> Vector3<f64> {
        nalgebra::center(&x[1], &x[2]) - x[0]
    }

    #[inline]
    fn change(p: &[Vector3<f64>; 3]) -> Vector3<f64> {
        (p[1] + p[2]) * 0.5 - p[0]
    }
}

/// A spring: a law along a vector.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spring<A, L> {
    /// The vector.
    pub arm: A,
    /// The law.
    pub law: L,
}

impl<A: Arm<K>, L: SpringLaw, const K: usize> Stencil<K> for Spring<A, L> {
    #[inline]
    fn points(&self) -> [u32; K] {
        self.arm.points()
    }

    #[inline]
    fn energy_and_gradient(&self, x: &[Point3<f64>; K]) -> Option<(f64, [Vector3<f64>; K])> {
        let d = self.arm.vector(x);
        let (energy, per_length) = self.law.along(&d);
        let pull = d * per_length;
        Some((energy, A::WEIGHTS.map(|w| pull * w)))
    }

    #[inline]
    fn energy(&self, x: &[Point3<f64>; K]) -> Option<f64> {
        Some(self.law.along(&self.arm.vector(x)).0)
    }

    fn hessian(&self, x: &[Point3<f64>; K], convex: bool) -> Option<Blocks<K>> {
        let block = self.law.block(&self.arm.vector(x), convex);
        Some(A::WEIGHTS.map(|v| A::WEIGHTS.map(|w| block * (v * w))))
    }

    fn scalar_hessian(&self, x: &[Point3<f64>; K]) -> Option<[[f64; K]; K]> {
        let k = self.law.scalar(self.arm.vector(x).norm());
        Some(A::WEIGHTS.map(|v| A::WEIGHTS.map(|w| k * (v * w))))
    }

    fn force_scale(&self, x: &[Point3<f64>; K]) -> f64 {
        self.law.force_scale(&self.arm.vector(x))
    }

    #[inline]
    fn product(
        &self,
        x: &[Point3<f64>; K],
        p: &[Vector3<f64>; K],
        convex: bool,
    ) -> Option<[Vector3<f64>; K]> {
        let product = self.law.product(&self.arm.vector(x), A::change(p), convex);
        Some(A::WEIGHTS.map(|w| product * w))
    }

    fn row_sums(&self, x: &[Point3<f64>; K]) -> Option<[f64; K]> {
        let stiffest = self.law.stiffest(self.arm.vector(x).norm());
        let all: f64 = A::WEIGHTS.iter().map(|w| w.abs()).sum();
        Some(A::WEIGHTS.map(|w| all * w.abs() * stiffest))
    }
}

/// Springs between points and fixed positions; see [`anchors`].
pub type Anchors<L> = Stencils<Spring<FromPlace, L>, 1>;

/// Springs from fixed positions [m] to points, as the effect `name`.
pub fn anchors<L: SpringLaw>(
    name: &'static str,
    places: impl IntoIterator<Item = (u32, Point3<f64>, L)>,
) -> Anchors<L> {
    let anchor = |(point, place, law)| Spring {
        arm: FromPlace { point, place },
        law,
    };
    Stencils::new(name, places.into_iter().map(anchor).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::constraints::Potential;
    use crate::testing::Draw;

    /// A law with a rest length: the spring can be compressed and stretched.
    #[derive(Clone, Copy)]
    struct Cubic(f64);

    impl SpringLaw for Cubic {
        fn energy(&self, length: f64) -> f64 {
            (length - self.0).powi(4) / 4.0
        }
        fn tension(&self, length: f64) -> f64 {
            (length - self.0).powi(3)
        }
        fn slope(&self, length: f64) -> f64 {
            3.0 * (length - self.0).powi(2)
        }
    }

    #[test]
    fn the_tension_of_a_linear_spring_is_the_slope_of_its_energy() {
        let law = Linear {
            stiffness: 30.0,
            force_scale: 0.0,
        };
        for length in [-2.0, 0.0, 0.3, 5.0] {
            // The energy is quadratic: central differences are exact but for rounding.
            let slope = law.energy(length + 0.5) - law.energy(length - 0.5);
            assert!((slope - law.tension(length)).abs() <= 1e-12 * 200.0);
            let stiffer = law.tension(length + 1.0) - law.tension(length);
            assert!((stiffer - law.slope(length)).abs() <= 1e-12 * 200.0);
        }
    }

    /// Greatest errors of gradient, second derivative and product, from central differences.
    fn errors<A: Arm<K>, const K: usize>(arm: A, rest: f64, wrong: f64) -> [f64; 3] {
        let mut draw = Draw::new(21);
        let x: [Point3<f64>; K] = draw.shape(K).try_into().expect("as many points");
        let p: [Vector3<f64>; K] = std::array::from_fn(|_| draw.direction());
        let law = Cubic(rest);
        let spring = Spring { arm, law };
        let gradient = |x: &[Point3<f64>; K]| spring.energy_and_gradient(x).expect("a spring").1;
        let (here, blocks) = (gradient(&x), spring.hessian(&x, false).expect("a spring"));
        let mut worst = [0.0_f64; 3];
        let h = 1e-5;
        for j in 0..K {
            for c in 0..3 {
                let (mut up, mut down) = (x, x);
                up[j][c] += h;
                down[j][c] -= h;
                let energy = |x| spring.energy(x).expect("a spring");
                let slope = (energy(&up) - energy(&down)) / (2.0 * h);
                worst[0] = worst[0].max((slope - wrong * here[j][c]).abs());
                let (up, down) = (gradient(&up), gradient(&down));
                for i in 0..K {
                    let change: Vector3<f64> = (up[i] - down[i]) / (2.0 * h);
                    let column: Vector3<f64> = (blocks[i][j] * wrong).column(c).into();
                    worst[1] = worst[1].max((change - column).norm());
                }
            }
        }
        let product = spring.product(&x, &p, false).expect("a spring");
        for i in 0..K {
            let by_blocks: Vector3<f64> = (0..K).map(|j| blocks[i][j] * p[j]).sum();
            worst[2] = worst[2].max((product[i] * wrong - by_blocks).norm());
        }
        worst
    }

    #[test]
    fn derivatives_of_springs_on_every_arm_agree_with_differences() {
        let targets = [Point3::new(0.1, 0.2, 0.3), Point3::new(-0.4, 0.5, 0.2)];
        let place = Point3::new(3.0, 1.0, 2.0);
        let all = |rest: f64, wrong: f64| {
            [
                errors(Between([0, 1]), rest, wrong),
                errors(FromPlace { point: 0, place }, rest, wrong),
                errors(ToMiddle([0, 1, 2]), rest, wrong),
                errors(
                    Displacement {
                        points: [0, 1],
                        targets,
                    },
                    rest,
                    wrong,
                ),
            ]
        };
        for rest in [0.1, 6.0] {
            for [first, second, product] in all(rest, 1.0) {
                assert!(first <= 1e-7 && second <= 1e-6, "{first:e} {second:e}");
                assert!(
                    product <= 1e-12 * rest.max(1.0).powi(2) * 100.0,
                    "{product:e}"
                );
            }
            for [first, second, product] in all(rest, 1.01) {
                assert!(first > 1e-6 && second > 1e-5 && product > 1e-5, "control");
            }
        }
    }

    #[test]
    fn anchors_pull_toward_their_places() {
        let part = anchors(
            "anchors",
            [(1, Point3::new(0.3, -0.2, 0.1), Linear::new(8.0))],
        );
        let x = vec![Point3::origin(), Point3::new(1.0, 2.0, 3.0)];
        let mut gradient = vec![Vector3::zeros(); 2];
        let energy = part.energy_and_gradient(&x, &mut gradient);
        assert_eq!(energy, part.energy(&x));
        assert_eq!(
            gradient,
            [Vector3::zeros(), (x[1] - part.terms()[0].arm.place) * 8.0]
        );
    }
}
