//! The derivative of an equilibrium by its parameters: against differences of equilibria, the adjoint
//! against it, the law of scale, the order of a Taylor series, and the variance of random parameters.

use nalgebra::{Point3, Vector3};
use pliant::constraints::{EnclosedVolume, Quadratic};
use pliant::contact::ContactPlane;
use pliant::mesh::measures::max_or_nan;
use pliant::mesh::shapes::icosphere;
use pliant::mesh::{Topology, TriangleMesh};
use pliant::solvers::{
    Balance, ContactFilter, DescentSettings, Energy, Newton, NoContact, Shift, Tangent, stiffness,
};

use crate::equilibrium::Floor;
use crate::tolerances::{T4, T5, T27, worst};

/// Stiffness of edges [N/m] and hinges [N m], volume over that at rest, force on each vertex [N], and
/// motion of the fixed end [m].
type Parameters = [f64; 5];
const AT: Parameters = [300.0, 0.5, 1.1, -0.4, 0.05];
const NAMES: [&str; 5] = ["stretch", "bending", "volume", "weight", "motion"];

/// A ball with a diameter of 1 m that is fixed on two sides.
struct Ball {
    mesh: TriangleMesh,
    inverse_mass: Vec<f64>,
    has_volume: bool,
    compliance: f64,
}

impl Ball {
    fn new() -> Self {
        let mesh = icosphere(0.5, 2);
        let far = |p: &Point3<f64>| p.x.abs() > 0.35;
        let mass = |p: &Point3<f64>| if far(p) { 0.0 } else { 1.0 };
        let inverse_mass = mesh.vertices.iter().map(mass).collect();
        Self {
            mesh,
            inverse_mass,
            has_volume: true,
            compliance: 0.0,
        }
    }

    fn energy(&self, [stretch, bending, volume, weight, _]: Parameters) -> Energy {
        let topology = Topology::new(&self.mesh);
        let (edges, k) = stiffness::edges(&self.mesh, &topology, stretch);
        let (hinges, b) = stiffness::hinges(&self.mesh, &topology, bending);
        let count = self.mesh.vertices.len();
        let target = volume * self.mesh.volume();
        let volume = EnclosedVolume::new(&self.mesh.triangles, count, target, self.compliance);
        Energy {
            elastic: vec![
                Box::new(Quadratic::<_, 2>::new(edges, k)),
                Box::new(Quadratic::<_, 4>::new(hinges, b)),
            ],
            volumes: [volume].into_iter().filter(|_| self.has_volume).collect(),
            forces: vec![Vector3::y() * weight; count],
            ..Energy::default()
        }
    }

    /// Moves the fixed vertices of one end from where they are at rest.
    fn hold(&self, [.., motion]: Parameters, x: &mut [Point3<f64>]) {
        let each = x.iter_mut().zip(&self.mesh.vertices);
        for ((x, rest), _) in each.zip(&self.inverse_mass).filter(|(_, w)| **w == 0.0) {
            *x = *rest;
            if rest.x > 0.0 {
                *x += Vector3::new(0.3, 1.0, 0.2) * motion;
            }
        }
    }

    /// The equilibrium from a start near it.
    fn solve(
        &self,
        at: Parameters,
        start: &[Point3<f64>],
        contact: &mut impl ContactFilter,
    ) -> Vec<Point3<f64>> {
        let settings = DescentSettings {
            tolerance: 1e-13,
            iterations: 100,
        };
        let rest = &self.mesh.vertices;
        let mut newton =
            Newton::new(self.energy(at), rest, &self.inverse_mass, settings).expect("memory");
        let mut x = start.to_vec();
        self.hold(at, &mut x);
        let outcome = newton.solve(&mut x, contact, |_, _| true).expect("held");
        // The last digits are those of rounding, and of contact.
        assert!(outcome.residual <= 1e-8, "{outcome:?}");
        x
    }

    /// The change of the balance by a unit of a parameter, and the motion of fixed vertices.
    fn change(
        &self,
        tangent: &Tangent,
        k: usize,
        x: &[Point3<f64>],
    ) -> (Balance, Vec<Vector3<f64>>) {
        let step = 1e-4 * AT[k].abs();
        let at = |sign: f64| {
            let mut at = AT;
            at[k] += sign * step;
            let mut x = x.to_vec();
            self.hold(at, &mut x);
            (tangent.balance(&self.energy(at), &x), x)
        };
        let ((more, above), (less, below)) = (at(1.0), at(-1.0));
        let moved = above
            .iter()
            .zip(&below)
            .map(|(a, b)| (a - b) / (2.0 * step));
        (more.change_from(&less, 2.0 * step), moved.collect())
    }

    /// The derivative of all positions by a parameter.
    fn derivative(&self, tangent: &mut Tangent, k: usize, x: &[Point3<f64>]) -> Shift {
        let (change, held) = self.change(tangent, k, x);
        let mut motion = tangent.shift(&change);
        let each = motion.x.iter_mut().zip(held);
        each.for_each(|(x, held)| *x += held);
        motion
    }

    /// Central differences of equilibria.
    fn differences(
        &self,
        k: usize,
        x: &[Point3<f64>],
        contact: &mut impl ContactFilter,
    ) -> Vec<Vector3<f64>> {
        let step = 1e-3 * AT[k].abs();
        let mut at = |sign: f64| {
            let mut at = AT;
            at[k] += sign * step;
            self.solve(at, x, contact)
        };
        // Two steps: the error of the second order goes.
        let (above, below) = (at(1.0), at(-1.0));
        let (farther, nearer) = (at(2.0), at(-2.0));
        let of = |v: usize| {
            let (one, two) = (above[v] - below[v], farther[v] - nearer[v]);
            (one * 8.0 - two) / (12.0 * step)
        };
        (0..x.len()).map(of).collect()
    }
}

fn size(field: &[Vector3<f64>]) -> f64 {
    max_or_nan(field.iter().map(Vector3::norm))
}

fn apart(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    worst(a.iter().zip(b).map(|(a, b)| (a - b).norm()))
}

#[test]
fn derivatives_are_those_of_equilibria_and_of_their_adjoint() {
    let ball = Ball::new();
    let x = ball.solve(AT, &ball.mesh.vertices, &mut NoContact);
    let mut tangent = Tangent::new(ball.energy(AT), &x, &ball.inverse_mass, &[]).expect("held");
    // A measure: the height of a part of the vertices.
    let mut slope = vec![Vector3::zeros(); x.len()];
    (0..x.len())
        .step_by(7)
        .for_each(|v| slope[v] = Vector3::new(0.2, 1.0, -0.5));
    let adjoint = tangent.shift(&Balance {
        gradient: slope.clone(),
        volumes: vec![0.0],
    });
    assert!(adjoint.residual <= T27, "{}", adjoint.residual);
    for (k, name) in NAMES.iter().enumerate() {
        let motion = ball.derivative(&mut tangent, k, &x);
        let wanted = ball.differences(k, &x, &mut NoContact);
        let off = apart(&motion.x, &wanted) / size(&wanted);
        println!("{name}: off by {off:e}, residual {:e}", motion.residual);
        assert!(off <= T27 && motion.residual <= T27, "{name}: {off:e}");
        let (change, held) = ball.change(&tangent, k, &x);
        let along = |field: &[Vector3<f64>]| -> f64 {
            slope.iter().zip(field).map(|(s, f)| s.dot(f)).sum()
        };
        let forward = along(&motion.x);
        let backward = change.dot(&adjoint) + along(&held);
        let scale: f64 = slope
            .iter()
            .zip(&motion.x)
            .map(|(s, f)| s.norm() * f.norm())
            .sum();
        assert!(
            (forward - backward).abs() <= T27 * scale,
            "{name}: {forward} {backward}"
        );
    }
    // Control: without the row of the volume the derivative is another one.
    let open = Ball {
        has_volume: false,
        ..Ball::new()
    };
    let mut without = Tangent::new(open.energy(AT), &x, &ball.inverse_mass, &[]).expect("held");
    let motion = open.derivative(&mut without, 3, &x);
    let wanted = ball.differences(3, &x, &mut NoContact);
    assert!(
        !(apart(&motion.x, &wanted) <= T27 * size(&wanted)),
        "control"
    );
}

#[test]
fn the_rest_of_a_taylor_series_is_of_second_order() {
    let ball = Ball::new();
    let x = ball.solve(AT, &ball.mesh.vertices, &mut NoContact);
    let mut tangent = Tangent::new(ball.energy(AT), &x, &ball.inverse_mass, &[]).expect("held");
    for (k, name) in NAMES.iter().enumerate() {
        let motion = ball.derivative(&mut tangent, k, &x);
        let rest = |share: f64| {
            let step = share * AT[k].abs();
            let mut at = AT;
            at[k] += step;
            let end = ball.solve(at, &x, &mut NoContact);
            let each = end.iter().zip(&x).zip(&motion.x);
            worst(each.map(|((end, x), d)| (end - x - d * step).norm()))
        };
        let (coarse, fine) = (rest(4e-3), rest(2e-3));
        let order = (coarse / fine).log2();
        println!("{name}: order {order}");
        assert!((order - 2.0).abs() <= T5, "{name}: {order}");
    }
}

#[test]
fn all_stiffness_times_a_number_changes_no_shape() {
    let ball = Ball::new();
    let mut free = AT;
    // With a known force the shape tells more than ratios of stiffness.
    free[3] = 0.0;
    let x = ball.solve(free, &ball.mesh.vertices, &mut NoContact);
    let mut tangent = Tangent::new(ball.energy(free), &x, &ball.inverse_mass, &[]).expect("held");
    let mut motion = |of: &[usize]| {
        let step = 1e-2;
        let at = |sign: f64| {
            let mut at = free;
            of.iter().for_each(|k| at[*k] *= 1.0 + sign * step);
            ball.energy(at)
        };
        let [more, less] = [1.0, -1.0].map(|sign| tangent.balance(&at(sign), &x));
        tangent.shift(&more.change_from(&less, 2.0 * step))
    };
    let (alone, both) = (motion(&[0]), motion(&[0, 1]));
    assert!(size(&alone.x) > 1e-3, "control: {}", size(&alone.x));
    // In proportion to the residual of the equilibrium.
    assert!(size(&both.x) <= 1e-10, "{:e}", size(&both.x));
}

#[test]
fn what_lies_on_a_floor_stays_there() {
    // With some compliance, so that nothing takes turns with the floor.
    let ball = Ball {
        compliance: 1e-6,
        ..Ball::new()
    };
    let mut floor = Floor {
        vertices: ball.inverse_mass.len() as u32,
        height: ball.mesh.bounding_box().min.y + 0.05,
        is_stopped: false,
    };
    let x = ball.solve(AT, &ball.mesh.vertices, &mut floor);
    let mut held = floor.planes();
    held.retain(|row| row.room(&x) <= 1e-9);
    assert!(held.len() > 2, "control: it touches");
    let on = |held: &[ContactPlane]| {
        let energy = ball.energy(AT);
        Tangent::new(energy, &x, &ball.inverse_mass, held).expect("held")
    };
    let (mut tangent, mut free) = (on(&held), on(&[]));
    for k in [0, 2, 3] {
        let motion = ball.derivative(&mut tangent, k, &x);
        let wanted = ball.differences(k, &x, &mut floor);
        let off = apart(&motion.x, &wanted) / size(&wanted);
        println!("{}: off by {off:e}", NAMES[k]);
        assert!(off <= T27, "{}: {off:e}", NAMES[k]);
        let off = apart(&ball.derivative(&mut free, k, &x).x, &wanted) / size(&wanted);
        assert!(off > 1e-2, "control: without the floor {off:e}");
    }
}

#[test]
fn random_parameters_have_the_predicted_variance() {
    let ball = Ball::new();
    let x = ball.solve(AT, &ball.mesh.vertices, &mut NoContact);
    let mut tangent = Tangent::new(ball.energy(AT), &x, &ball.inverse_mass, &[]).expect("held");
    let lowest = |x: &[Point3<f64>]| -> f64 { (0..x.len()).step_by(7).map(|v| x[v].y).sum() };
    let share = 0.02;
    let predicted: f64 = (0..AT.len())
        .map(|k| {
            let motion = ball.derivative(&mut tangent, k, &x);
            let slope: f64 = (0..x.len()).step_by(7).map(|v| motion.x[v].y).sum();
            (slope * share * AT[k]).powi(2) / 3.0
        })
        .sum();
    // A sequence that fills the cube evenly: 200 random draws know a variance to 10 % only.
    let golden = (0..60).fold(1.0_f64, |x, _| (1.0 + x).powf(1.0 / 6.0));
    let count = 200;
    let place = |n: usize, k: usize| (0.5 + n as f64 * golden.powi(-(k as i32 + 1))).fract();
    let measured: Vec<f64> = (0..count)
        .map(|n| {
            let mut at = AT;
            (0..at.len()).for_each(|k| at[k] *= 1.0 + share * (2.0 * place(n, k) - 1.0));
            lowest(&ball.solve(at, &x, &mut NoContact))
        })
        .collect();
    let mean = measured.iter().sum::<f64>() / count as f64;
    let variance = measured.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / (count - 1) as f64;
    let ratio = variance / predicted;
    println!("variance over the predicted one: {ratio}");
    assert!((ratio - 1.0).abs() <= 2.0 * T4, "{ratio}");
}
