//! Frictionless contact as one-sided springs that begin to press slightly before bodies touch.
//! Where the springs alone would permit penetration, their offset increases, as the multipliers of
//! an augmented Lagrangian do.

use nalgebra::{Matrix3, Point3, Vector3};

use crate::constraints::stencil::{Blocks, at};
use crate::constraints::{Stencil, Stencils};
use crate::contact::difference;
use crate::mesh::measures::max_or_nan;

/// A contact of a place on a body with a plane, fixed or carried by another body, or with a sphere.
/// The place is a vertex, or a point of an edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touch {
    /// The body, and the vertex (twice) or the edge that touches it. For a vertex of a surface below,
    /// the vertex and the first vertex of the body that touches it.
    pub key: (On, [u32; 2]),
    /// The vertices that the contact moves; those with weight 0 are any.
    pub corners: [u32; 4],
    /// Weights of the corners in the place, less the place on the other body.
    pub weights: [f64; 4],
    /// The surface that the place must stay over.
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
    /// Vector from the surface point to the place where the contact was found [m].
    pub from: Vector3<f64>,
}

/// The surface that a place must stay over.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Over {
    /// A plane with this unit normal that the corners carry.
    Carried(Vector3<f64>),
    /// A fixed plane: a point and a unit normal.
    Plane(Point3<f64>, Vector3<f64>),
    /// A fixed sphere: centre and radius [m].
    Ball(Point3<f64>, f64),
}

/// The bodies that a vertex or an edge can touch.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum On {
    /// The sphere.
    Ball,
    /// One of the implants.
    Implant(u32),
    /// The lower layer of the skin.
    Skin,
    /// One of the surfaces below.
    Support(u32),
    /// A vertex of one of the surfaces below.
    VertexOf(u32),
}

/// A gap with its derivatives with respect to the corners.
struct Gap {
    value: f64,
    gradient: [Vector3<f64>; 4],
    /// Second derivative with respect to the first corner.
    curvature: Matrix3<f64>,
}

impl Touch {
    /// A contact of a vertex without load.
    pub fn of_vertex(vertex: u32, on: On, over: Over, stiffness: f64, soft: f64) -> Self {
        Self {
            key: (on, [vertex; 2]),
            corners: [vertex; 4],
            weights: [1.0, 0.0, 0.0, 0.0],
            over,
            stiffness,
            soft,
            lift: 0.0,
            slide: 0.0,
            from: Vector3::zeros(),
        }
    }

    /// The same with the point of a triangle with these barycentric weights.
    pub fn with_triangle(self, [a, b, c]: [u32; 3], w: [f64; 3]) -> Self {
        Self {
            corners: [self.corners[0], a, b, c],
            weights: [1.0, -w[0], -w[1], -w[2]],
            ..self
        }
    }

    /// The place of a triangle with these barycentric weights, over a fixed plane.
    pub fn of_triangle(self, [a, b, c]: [u32; 3], w: [f64; 3]) -> Self {
        Self {
            corners: [a, b, c, a],
            weights: [w[0], w[1], w[2], 0.0],
            ..self
        }
    }

    /// The gap [m], negative if the place is inside; `None` in the centre of a sphere.
    pub fn gap(&self, x: &[Point3<f64>]) -> Option<f64> {
        self.measure(&at(self.corners, x)).map(|gap| gap.value)
    }

    fn measure(&self, x: &[Point3<f64>; 4]) -> Option<Gap> {
        let away = self.slip_vector(x);
        let along = |n: Vector3<f64>| self.weights.map(|w| n * w);
        match self.over {
            Over::Plane(_, n) | Over::Carried(n) => Some(Gap {
                value: away.dot(&n),
                gradient: along(n),
                curvature: Matrix3::zeros(),
            }),
            Over::Ball(_, radius) => {
                let distance = away.norm();
                let n = away.try_normalize(0.0)?;
                Some(Gap {
                    value: distance - radius,
                    gradient: along(n),
                    curvature: (Matrix3::identity() - n * n.transpose()) / distance,
                })
            }
        }
    }

    /// The gap minus the lift, with the energy, force and stiffness of [`law`]; `None` without
    /// contact.
    fn pressed(&self, x: &[Point3<f64>; 4]) -> Option<(Gap, (f64, f64, f64))> {
        let gap = self.measure(x)?;
        let lifted = gap.value - self.lift;
        (lifted < self.soft).then(|| (gap, law(lifted, self.soft)))
    }

    /// The contact with the tangential stiffness of a surface of this radius [m], found at
    /// positions `x`.
    pub fn found(mut self, x: &[Point3<f64>], radius: f64) -> Self {
        let pressed = self
            .gap(x)
            .map_or(0.0, |gap| law(gap - self.lift, self.soft).1);
        self.slide = self.stiffness * pressed / radius;
        self.from = self.slip_vector(&at(self.corners, x));
        self
    }

    /// Vector from the surface point to the place [m].
    fn slip_vector(&self, x: &[Point3<f64>; 4]) -> Vector3<f64> {
        // Over the first corner: a translation changes less.
        let to_first = difference(x, &self.weights);
        match self.over {
            Over::Carried(_) => to_first,
            Over::Plane(origin, _) | Over::Ball(origin, _) => to_first + (x[0] - origin),
        }
    }

    /// Projection onto the plane.
    fn along(&self) -> Matrix3<f64> {
        match self.over {
            Over::Carried(n) | Over::Plane(_, n) => Matrix3::identity() - n * n.transpose(),
            Over::Ball(..) => Matrix3::zeros(),
        }
    }

    /// Tangential displacement since the contact was found [m].
    fn slid(&self, x: &[Point3<f64>; 4]) -> Vector3<f64> {
        self.along() * (self.slip_vector(x) - self.from)
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
    /// Greatest penetration [m].
    pub fn depth(&self, x: &[Point3<f64>]) -> f64 {
        let gaps = self.touches.iter().filter_map(|t| t.gap(x));
        max_or_nan(gaps.map(|gap| (-gap).max(0.0)))
    }

    /// Their energy: that of all gaps, then that of sliding.
    pub fn potential(&self) -> Stencils<Contact, 4> {
        let press = self.touches.iter().copied().map(Contact::Press);
        let sliding = self.touches.iter().filter(|t| t.slide > 0.0);
        let slide = sliding.copied().map(Contact::Slide);
        Stencils::new("contact of skin and implant", press.chain(slide).collect())
    }
}

/// A term of the energy of contact.
#[derive(Clone, Copy, Debug)]
pub enum Contact {
    /// The energy k g^2 / 2 of a gap g < 0, smoothed near its onset.
    Press(Touch),
    /// The energy of sliding along the plane.
    Slide(Touch),
}

impl Stencil<4> for Contact {
    fn points(&self) -> [u32; 4] {
        let (Self::Press(touch) | Self::Slide(touch)) = self;
        touch.corners
    }

    fn energy_and_gradient(&self, x: &[Point3<f64>; 4]) -> Option<(f64, [Vector3<f64>; 4])> {
        match self {
            Self::Press(t) => {
                let (gap, (energy, press, _)) = t.pressed(x)?;
                let force = -(t.stiffness * press);
                Some((t.stiffness * energy, gap.gradient.map(|g| g * force)))
            }
            Self::Slide(t) => {
                let slid = t.slid(x);
                let energy = 0.5 * t.slide * slid.norm_squared();
                Some((energy, t.weights.map(|w| slid * (t.slide * w))))
            }
        }
    }

    fn hessian(&self, x: &[Point3<f64>; 4], convex: bool) -> Option<Blocks<4>> {
        match self {
            Self::Press(t) => {
                let (gap, (_, press, stiff)) = t.pressed(x)?;
                let k = t.stiffness * stiff;
                let row = |g: Vector3<f64>| gap.gradient.map(|h| g * h.transpose() * k);
                let mut blocks = gap.gradient.map(row);
                if !convex {
                    blocks[0][0] -= gap.curvature * (t.stiffness * press);
                }
                Some(blocks)
            }
            Self::Slide(t) => {
                let (weights, along) = (t.weights, t.along());
                Some(weights.map(|v| weights.map(|w| along * (t.slide * v * w))))
            }
        }
    }

    fn scalar_hessian(&self, x: &[Point3<f64>; 4]) -> Option<[[f64; 4]; 4]> {
        match self {
            Self::Press(t) => {
                let (gap, (_, _, stiff)) = t.pressed(x)?;
                // A third: the springs act in one direction of three.
                let k = t.stiffness * stiff / 3.0;
                Some(gap.gradient.map(|g| gap.gradient.map(|h| k * g.dot(&h))))
            }
            Self::Slide(t) => {
                let weights = t.weights;
                Some(weights.map(|v| weights.map(|w| t.slide * v * w)))
            }
        }
    }
}
