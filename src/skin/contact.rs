//! Contact without friction as one-sided springs that begin to press a little before bodies touch; where they alone would let
//! bodies sink into each other, they are lifted until they do not, as multipliers of an augmented Lagrangian.

use nalgebra::{Matrix3, Point3, Vector3};

use crate::mesh::measures::max_or_nan;
use crate::mesh::sum::NeumaierSum;
use crate::solvers::potential::Potential;
use crate::state::{DecodeError, Reader, State, Writer};

/// A plane, at rest or carried by a triangle, or a sphere, that a vertex must stay over: n.(x - y) >= 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touch {
    /// The vertex.
    pub vertex: u32,
    /// Which body it touches.
    pub on: On,
    /// What it must stay over.
    pub over: Over,
    /// Stiffness [N/m].
    pub stiffness: f64,
    /// It begins to press at this gap [m].
    pub soft: f64,
    /// It presses as if the surface were higher by this [m]: what a spring lacks to hold a body out that presses hard.
    pub lift: f64,
    /// Stiffness against sliding along the plane [N/m], from where it was found: what presses on a curved surface with a
    /// force F is turned back by F/R, which a plane knows nothing of. Found anew where it rests, it exerts no force.
    pub slide: f64,
    /// The way from the point of the surface to the vertex where it was found [m].
    pub from: Vector3<f64>,
}

/// What a vertex must stay over.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Over {
    /// A plane with this unit normal through the point of a triangle with these barycentric weights.
    Carried([u32; 3], [f64; 3], Vector3<f64>),
    /// A plane at rest: a point and a unit normal.
    Plane(Point3<f64>, Vector3<f64>),
    /// A sphere at rest: centre and radius [m].
    Ball(Point3<f64>, f64),
}

/// What a vertex may touch.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum On {
    /// The sphere.
    Ball,
    /// One of the implants.
    Implant(u32),
    /// The lower layer of the skin.
    Skin,
    /// One of the surfaces that lie below.
    Bed(u32),
}

/// A gap and its derivatives by the vertex and the corners.
struct Gap {
    value: f64,
    points: [u32; 4],
    gradient: [Vector3<f64>; 4],
    /// How many of the points count.
    count: usize,
    /// Second derivative by the vertex.
    curvature: Matrix3<f64>,
}

impl Touch {
    /// The gap [m], negative where the vertex is inside; `None` in the centre of a sphere.
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

    /// The same, held back along its plane as is due to a surface of this radius [m], found at positions `x`.
    pub fn found(mut self, x: &[Point3<f64>], radius: f64) -> Self {
        let pressed = self
            .gap(x)
            .map_or(0.0, |gap| law(gap - self.lift, self.soft).1);
        self.slide = self.stiffness * pressed / radius;
        self.from = self.way(x);
        self
    }

    /// Weights of the vertex and the corners in the way from the surface.
    fn weights(&self) -> [f64; 4] {
        match self.over {
            Over::Carried(_, w, _) => [1.0, -w[0], -w[1], -w[2]],
            Over::Plane(..) | Over::Ball(..) => [1.0, 0.0, 0.0, 0.0],
        }
    }

    /// From the point of the surface to the vertex [m].
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

    /// What of a vector lies along the plane.
    fn along(&self) -> Matrix3<f64> {
        match self.over {
            Over::Carried(_, _, n) | Over::Plane(_, n) => Matrix3::identity() - n * n.transpose(),
            Over::Ball(..) => Matrix3::zeros(),
        }
    }

    /// How far it slid [m].
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
    /// A contact that nothing has pressed yet.
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

/// Energy, force and stiffness of a contact of stiffness one at a gap [m]: none beyond `soft`, as of a spring below -`soft`,
/// and a parabola of forces between, so that second derivatives never jump.
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

/// The energy sum k g^2 / 2 over the gaps g < 0, and that of sliding.
#[derive(Clone, Debug, Default)]
pub struct Touching {
    /// All that may touch.
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

    /// How far the deepest is inside [m].
    pub fn depth(&self, x: &[Point3<f64>]) -> f64 {
        max_or_nan(
            self.touches
                .iter()
                .filter_map(|t| t.gap(x))
                .map(|gap| (-gap).max(0.0)),
        )
    }
}

impl State for Touching {
    // Found anew from positions whenever it is needed.
    fn save(&self, _: &mut Writer) {}

    fn restore(&mut self, _: &mut Reader<'_>) -> Result<(), DecodeError> {
        Ok(())
    }
}

impl Potential for Touching {
    fn name(&self) -> &'static str {
        "contact of skin and implant"
    }

    fn energy(&self, x: &[Point3<f64>]) -> f64 {
        let mut sum = NeumaierSum::default();
        self.pressed(x)
            .for_each(|(k, soft, gap)| sum.add(k * law(gap.value, soft).0));
        self.sliding()
            .for_each(|t| sum.add(0.5 * t.slide * t.slid(x).norm_squared()));
        sum.total()
    }

    fn energy_and_gradient(&self, x: &[Point3<f64>], gradient: &mut [Vector3<f64>]) -> f64 {
        let mut sum = NeumaierSum::default();
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
                    // A third: the springs hold in one direction of three.
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

    fn force_scale(&self, _: &[Point3<f64>]) -> f64 {
        // Judged by what the springs exert.
        0.0
    }

    fn remember(&mut self, _: &[Point3<f64>]) {}

    fn bytes(&self) -> usize {
        self.touches.capacity() * size_of::<Touch>()
    }
}

/// Springs of rest length zero that hold vertices near places [N/m].
#[derive(Clone, Debug, Default)]
pub struct Anchors {
    /// Vertex, place [m].
    pub places: Vec<(u32, Point3<f64>)>,
    /// Stiffness of each [N/m].
    pub stiffness: f64,
}

impl State for Anchors {
    fn save(&self, _: &mut Writer) {}

    fn restore(&mut self, _: &mut Reader<'_>) -> Result<(), DecodeError> {
        Ok(())
    }
}

impl Potential for Anchors {
    fn name(&self) -> &'static str {
        "anchors"
    }

    fn energy(&self, x: &[Point3<f64>]) -> f64 {
        let mut sum = NeumaierSum::default();
        let square = |(v, place): &(u32, Point3<f64>)| (x[*v as usize] - place).norm_squared();
        self.places
            .iter()
            .for_each(|p| sum.add(0.5 * self.stiffness * square(p)));
        sum.total()
    }

    fn energy_and_gradient(&self, x: &[Point3<f64>], gradient: &mut [Vector3<f64>]) -> f64 {
        self.places.iter().for_each(|(v, place)| {
            gradient[*v as usize] += (x[*v as usize] - place) * self.stiffness
        });
        self.energy(x)
    }

    fn pairs(&self, _: &mut dyn FnMut(u32, u32)) {}

    fn hessian(&self, _: &[Point3<f64>], _: bool, add: &mut dyn FnMut(u32, u32, &Matrix3<f64>)) {
        let block = Matrix3::from_diagonal_element(self.stiffness);
        self.places.iter().for_each(|(v, _)| add(*v, *v, &block));
    }

    fn scalar_hessian(&self, _: &[Point3<f64>], add: &mut dyn FnMut(u32, u32, f64)) {
        self.places
            .iter()
            .for_each(|(v, _)| add(*v, *v, self.stiffness));
    }

    fn force_scale(&self, _: &[Point3<f64>]) -> f64 {
        0.0
    }

    fn remember(&mut self, _: &[Point3<f64>]) {}

    fn bytes(&self) -> usize {
        self.places.capacity() * size_of::<(u32, Point3<f64>)>()
    }
}
