//! Frictionless contact as one-sided springs that begin to press slightly before bodies touch.
//! Where the springs alone would permit penetration, their offset increases, as the multipliers of
//! an augmented Lagrangian do.

use nalgebra::{Matrix3, Point3, Vector3};

use crate::constraints::Potential;
use crate::mesh::measures::greatest;
use crate::mesh::sum::Compensated;

/// A contact of a vertex with a plane, fixed or on a triangle, or with a sphere: n.(x - y) >= 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touch {
    /// The vertex.
    pub vertex: u32,
    /// The body that the vertex touches.
    pub on: On,
    /// The surface that the vertex must stay over.
    pub over: Over,
    /// Stiffness [N/m].
    pub stiffness: f64,
    /// Gap at which the spring begins to press [m].
    pub soft: f64,
    /// Offset of the surface for the spring [m]: compensates the penetration of a spring under
    /// load.
    pub lift: f64,
    /// Stiffness against sliding along the plane [N/m], from the position where the contact was
    /// found. A force F on a surface of radius R has the tangential stiffness F/R, which a plane
    /// lacks. A contact that is found again at rest exerts no such force.
    pub slide: f64,
    /// Vector from the surface point to the vertex where the contact was found [m].
    pub from: Vector3<f64>,
}

/// The surface that a vertex must stay over.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Over {
    /// A plane with this unit normal through the point of a triangle with these barycentric
    /// weights.
    Carried([u32; 3], [f64; 3], Vector3<f64>),
    /// A fixed plane: a point and a unit normal.
    Plane(Point3<f64>, Vector3<f64>),
    /// A fixed sphere: centre and radius [m].
    Ball(Point3<f64>, f64),
}

/// The bodies that a vertex can touch.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum On {
    /// The sphere.
    Ball,
    /// One of the implants.
    Implant(u32),
    /// The lower layer of the skin.
    Skin,
    /// One of the surfaces below.
    Bed(u32),
}

/// A gap with its derivatives with respect to the vertex and the corners.
struct Gap {
    value: f64,
    points: [u32; 4],
    gradient: [Vector3<f64>; 4],
    /// Number of points in use.
    count: usize,
    /// Second derivative with respect to the vertex.
    curvature: Matrix3<f64>,
}

impl Touch {
    /// The gap [m], negative if the vertex is inside; `None` in the centre of a sphere.
    pub fn gap(&self, x: &[Point3<f64>]) -> Option<f64> {
        self.measure(x).map(|gap| gap.value)
    }

    fn measure(&self, x: &[Point3<f64>]) -> Option<Gap> {
        let v = self.vertex;
        let at = x[v as usize];
        let fixed = |value: f64, n: Vector3<f64>, curvature| {
            let mut gradient = [Vector3::zeros(); 4];
            gradient[0] = n;
            Some(Gap {
                value,
                points: [v; 4],
                gradient,
                count: 1,
                curvature,
            })
        };
        match self.over {
            Over::Plane(origin, n) => fixed((at - origin).dot(&n), n, Matrix3::zeros()),
            Over::Ball(centre, radius) => {
                let away = at - centre;
                let distance = away.norm();
                let n = away.try_normalize(0.0)?;
                fixed(
                    distance - radius,
                    n,
                    (Matrix3::identity() - n * n.transpose()) / distance,
                )
            }
            Over::Carried(t, w, n) => {
                let [a, b, c] = t.map(|v| x[v as usize]);
                let value = (at - a - (b - a) * w[1] - (c - a) * w[2]).dot(&n);
                let gradient = [n, -n * w[0], -n * w[1], -n * w[2]];
                Some(Gap {
                    value,
                    points: [v, t[0], t[1], t[2]],
                    gradient,
                    count: 4,
                    curvature: Matrix3::zeros(),
                })
            }
        }
    }

    /// The contact with the tangential stiffness of a surface of this radius [m], found at
    /// positions `x`.
    pub fn found(mut self, x: &[Point3<f64>], radius: f64) -> Self {
        let pressed = self
            .gap(x)
            .map_or(0.0, |gap| law(gap - self.lift, self.soft).1);
        self.slide = self.stiffness * pressed / radius;
        self.from = self.way(x);
        self
    }

    /// Weights of the vertex and the corners in the vector from the surface.
    fn weights(&self) -> [f64; 4] {
        match self.over {
            Over::Carried(_, w, _) => [1.0, -w[0], -w[1], -w[2]],
            Over::Plane(..) | Over::Ball(..) => [1.0, 0.0, 0.0, 0.0],
        }
    }

    /// Vector from the surface point to the vertex [m].
    fn way(&self, x: &[Point3<f64>]) -> Vector3<f64> {
        let at = |v: u32| x[v as usize];
        match self.over {
            Over::Carried([a, b, c], w, _) => {
                at(self.vertex) - at(a) - (at(b) - at(a)) * w[1] - (at(c) - at(a)) * w[2]
            }
            Over::Plane(origin, _) => at(self.vertex) - origin,
            Over::Ball(centre, _) => at(self.vertex) - centre,
        }
    }

    /// Projection onto the plane.
    fn along(&self) -> Matrix3<f64> {
        match self.over {
            Over::Carried(_, _, n) | Over::Plane(_, n) => Matrix3::identity() - n * n.transpose(),
            Over::Ball(..) => Matrix3::zeros(),
        }
    }

    /// Tangential displacement since the contact was found [m].
    fn slid(&self, x: &[Point3<f64>]) -> Vector3<f64> {
        self.along() * (self.way(x) - self.from)
    }

    fn points(&self) -> ([u32; 4], usize) {
        match self.over {
            Over::Carried([a, b, c], ..) => ([self.vertex, a, b, c], 4),
            Over::Plane(..) | Over::Ball(..) => ([self.vertex; 4], 1),
        }
    }
}

impl Touch {
    /// A contact without load.
    pub fn new(vertex: u32, on: On, over: Over, stiffness: f64, soft: f64) -> Self {
        Self {
            vertex,
            on,
            over,
            stiffness,
            soft,
            lift: 0.0,
            slide: 0.0,
            from: Vector3::zeros(),
        }
    }
}

/// Energy, force and stiffness of a contact of unit stiffness at a gap [m]: zero above `soft`, a
/// spring below -`soft`, and a quadratic force in between, so that second derivatives are
/// continuous.
pub(super) fn law(gap: f64, soft: f64) -> (f64, f64, f64) {
    if gap >= soft {
        return (0.0, 0.0, 0.0);
    }
    if gap <= -soft {
        return (0.5 * gap * gap + soft * soft / 6.0, -gap, 1.0);
    }
    let in_it = soft - gap;
    (
        in_it * in_it * in_it / (12.0 * soft),
        in_it * in_it / (4.0 * soft),
        in_it / (2.0 * soft),
    )
}

/// The energy sum k g^2 / 2 over the gaps g < 0, plus the tangential energy.
#[derive(Clone, Debug, Default)]
pub struct Touching {
    /// All possible contacts.
    pub touches: Vec<Touch>,
}

impl Touching {
    fn pressed(&self, x: &[Point3<f64>]) -> impl Iterator<Item = (f64, f64, Gap)> {
        let lifted = |t: &Touch, gap: Gap| Gap {
            value: gap.value - t.lift,
            ..gap
        };
        let measured = self
            .touches
            .iter()
            .filter_map(move |t| Some((t.stiffness, t.soft, lifted(t, t.measure(x)?))));
        measured.filter(|(_, soft, gap)| gap.value < *soft)
    }

    fn sliding(&self) -> impl Iterator<Item = &Touch> {
        self.touches.iter().filter(|t| t.slide > 0.0)
    }

    /// Greatest penetration [m].
    pub fn depth(&self, x: &[Point3<f64>]) -> f64 {
        greatest(
            self.touches
                .iter()
                .filter_map(|t| t.gap(x))
                .map(|gap| (-gap).max(0.0)),
        )
    }
}

impl Potential for Touching {
    fn name(&self) -> &'static str {
        "contact of skin and implant"
    }

    fn energy(&self, x: &[Point3<f64>]) -> f64 {
        let mut sum = Compensated::default();
        self.pressed(x)
            .for_each(|(k, soft, gap)| sum.add(k * law(gap.value, soft).0));
        self.sliding()
            .for_each(|t| sum.add(0.5 * t.slide * t.slid(x).norm_squared()));
        sum.total()
    }

    fn energy_and_gradient(&self, x: &[Point3<f64>], gradient: &mut [Vector3<f64>]) -> f64 {
        let mut sum = Compensated::default();
        for (k, soft, gap) in self.pressed(x) {
            let (energy, press, _) = law(gap.value, soft);
            sum.add(k * energy);
            let each = gap.points.iter().zip(&gap.gradient).take(gap.count);
            each.for_each(|(p, g)| gradient[*p as usize] -= g * (k * press));
        }
        for t in self.sliding() {
            let (slid, (points, count)) = (t.slid(x), t.points());
            sum.add(0.5 * t.slide * slid.norm_squared());
            let each = points.iter().zip(t.weights()).take(count);
            each.for_each(|(p, w)| gradient[*p as usize] += slid * (t.slide * w));
        }
        sum.total()
    }

    fn pairs(&self, pair: &mut dyn FnMut(u32, u32)) {
        for (points, count) in self.touches.iter().map(Touch::points) {
            for i in 0..count {
                points[..i].iter().for_each(|&q| pair(points[i], q));
            }
        }
    }

    fn hessian(
        &self,
        x: &[Point3<f64>],
        convex: bool,
        add: &mut dyn FnMut(u32, u32, &Matrix3<f64>),
    ) {
        for (k, soft, gap) in self.pressed(x) {
            let (_, press, stiff) = law(gap.value, soft);
            for i in 0..gap.count {
                for j in 0..gap.count {
                    let mut block = gap.gradient[i] * gap.gradient[j].transpose() * (k * stiff);
                    if !convex {
                        block -= gap.curvature * (k * press);
                    }
                    add(gap.points[i], gap.points[j], &block);
                }
            }
        }
        for t in self.sliding() {
            let (weights, (points, count), along) = (t.weights(), t.points(), t.along());
            for i in 0..count {
                (0..count).for_each(|j| {
                    add(
                        points[i],
                        points[j],
                        &(along * (t.slide * weights[i] * weights[j])),
                    )
                });
            }
        }
    }

    fn scalar_hessian(&self, x: &[Point3<f64>], add: &mut dyn FnMut(u32, u32, f64)) {
        for (k, soft, gap) in self.pressed(x) {
            let k = k * law(gap.value, soft).2;
            for i in 0..gap.count {
                (0..gap.count).for_each(|j| {
                    // A third: the springs act in one direction of three.
                    add(
                        gap.points[i],
                        gap.points[j],
                        k / 3.0 * gap.gradient[i].dot(&gap.gradient[j]),
                    );
                });
            }
        }
        for t in self.sliding() {
            let (weights, (points, count)) = (t.weights(), t.points());
            for i in 0..count {
                (0..count)
                    .for_each(|j| add(points[i], points[j], t.slide * weights[i] * weights[j]));
            }
        }
    }
}
