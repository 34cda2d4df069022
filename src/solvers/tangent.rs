//! How an equilibrium moves when its energy, its volumes or its fixed vertices change a little: the
//! derivative of the equilibrium by a parameter.
//!
//! At equilibrium the gradient of the energy less the pressures times the gradients of the volumes is
//! zero, and the volumes are at their targets. The derivative of these equations by a parameter is a
//! linear system with the second derivative of the Lagrangian and the rows of the volumes. One factor
//! serves any number of parameters; it is symmetric, so the same solve is the adjoint of a measure.
//!
//! The factor can be that of a positive definite part of the second derivative. Conjugate gradients
//! with the rows of the volumes in the preconditioner \[gould2001\] then find the exact solution.
//!
//! *Limitations.* What touches stays in touch and what is apart stays apart: where a parameter changes
//! that, the derivative holds on one side only. Surfaces in contact are flat. Friction has no effect.

use nalgebra::{Point3, Vector3};

use super::descent::{DescentSettings, multipliers};
use super::energy::Energy;
use super::history::{Field, add_scaled, dot};
use super::newton::Newton;
use super::sparse::FactorError;
use super::unknowns::Unknowns;
use crate::constraints::stencil::Blocks;
use crate::constraints::{EnclosedVolume, Stencil, Stencils};
use crate::contact::ContactPlane;

/// Stiffness that holds what touches, relative to the mean stiffness of a vertex.
const HOLDING: f64 = 1e6;

/// Greatest residual of the linear system, relative to its right side.
const SOLVED: f64 = 1e-11;

/// Greatest number of conjugate gradients for a parameter.
const GRADIENTS: usize = 200;

/// The left sides of the equations of an equilibrium.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Balance {
    /// The gradient of the energy, less the pressures times those of the volumes [N], by vertex; zero at
    /// fixed vertices.
    pub gradient: Vec<Vector3<f64>>,
    /// Each volume above its target [m^3].
    pub volumes: Vec<f64>,
}

/// The motion of an equilibrium for a unit of a parameter.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Shift {
    /// Shift of each vertex [m]; zero at fixed vertices.
    pub x: Vec<Vector3<f64>>,
    /// Change of the pressure in each volume [Pa].
    pub pressures: Vec<f64>,
    /// What is left of the linear system, relative to its right side.
    pub residual: f64,
}

/// The tangent of an equilibrium: how it moves with a parameter.
///
/// ```
/// use nalgebra::{Point3, Vector3};
/// use pliant::solvers::Tangent;
/// use pliant::{Distance, Energy, Quadratic};
///
/// // A spring of k = 100 N/m and 1 m hangs from a held point, carries 10 N and is 1.1 m long.
/// let x = [Point3::origin(), Point3::new(0.0, 0.0, -1.1)];
/// let with = |k: f64| Energy {
///     elastic: vec![Box::new(Quadratic::<_, 2>::new(vec![Distance { points: [0, 1], rest: 1.0 }], vec![k]))],
///     forces: vec![Vector3::zeros(), Vector3::new(0.0, 0.0, -10.0)],
///     ..Energy::default()
/// };
/// let mut tangent = Tangent::new(with(100.0), &x, &[0.0, 1.0], &[])?;
/// let [more, less] = [101.0, 99.0].map(|k| tangent.balance(&with(k), &x));
/// let moved = tangent.shift(&more.change_from(&less, 2.0));
/// // It is 1 + 10 N / k long.
/// assert!((moved.x[1].z - 10.0 / 100.0_f64.powi(2)).abs() <= 1e-12);
/// # Ok::<(), pliant::solvers::FactorError>(())
/// ```
pub struct Tangent {
    newton: Newton,
    x: Vec<Point3<f64>>,
    areas: Vec<Field>,
    spreads: Vec<Field>,
    /// What touches and is pressed.
    held: Vec<ContactPlane>,
    /// The pressure in each volume [Pa].
    pub pressures: Vec<f64>,
}

impl Balance {
    /// The change from another balance, divided by that of the parameter.
    #[must_use]
    pub fn change_from(&self, other: &Self, step: f64) -> Self {
        let gradient = self.gradient.iter().zip(&other.gradient);
        let volumes = self.volumes.iter().zip(&other.volumes);
        Self {
            gradient: gradient.map(|(a, b)| (a - b) / step).collect(),
            volumes: volumes.map(|(a, b)| (a - b) / step).collect(),
        }
    }

    /// The dot product with a motion: the change of a measure whose adjoint the motion is.
    pub fn dot(&self, motion: &Shift) -> f64 {
        let volumes = self.volumes.iter().zip(&motion.pressures);
        dot(&self.gradient, &motion.x) - volumes.map(|(v, p)| v * p).sum::<f64>()
    }
}

impl Tangent {
    /// Factorises the second derivative of the equilibrium of `energy` at `x` [m]. Vertices without
    /// inverse mass are fixed; the rows of `held` that forces press against stay at their heights.
    ///
    /// # Errors
    /// Too little memory for the factor, or a part that moves freely.
    pub fn new(
        energy: Energy,
        x: &[Point3<f64>],
        inverse_mass: &[f64],
        held: &[ContactPlane],
    ) -> Result<Self, FactorError> {
        let mut energy = energy;
        // Of a motion, no inertia is part.
        energy.inertia = None;
        let unknowns = Unknowns::new(inverse_mass);
        let (pressures, pressed) = pressed(&energy, &unknowns, x, held);
        if !pressed.is_empty() {
            let stiffness = HOLDING * mean_stiffness(&energy, x);
            let rows = pressed.iter().map(|&row| HeldRow {
                row,
                at: row.room(x),
                stiffness,
            });
            let rows = Stencils::new("held contact", rows.collect());
            energy.elastic.push(Box::new(rows));
        }
        let mut newton = Newton::new(energy, x, inverse_mass, DescentSettings::default())?;
        let state = newton.problem.state(x);
        newton.factorise(x, &pressures)?;
        let mut spreads = state.areas.clone();
        newton.invert(spreads.iter_mut());
        Ok(Self {
            newton,
            x: x.to_vec(),
            areas: state.areas,
            spreads,
            held: pressed,
            pressures,
        })
    }

    /// The left sides of the equations at `x` [m] for a similar energy, with the pressures of this
    /// equilibrium.
    pub fn balance(&self, energy: &Energy, x: &[Point3<f64>]) -> Balance {
        let mut gradient = vec![Vector3::zeros(); x.len()];
        energy.value_and_gradient(x, &mut gradient);
        let mut volumes = Vec::with_capacity(energy.volumes.len());
        for (volume, pressure) in energy.volumes.iter().zip(&self.pressures) {
            let (excess, area) = volume.value_and_gradient(x);
            add_scaled(&mut gradient, -pressure, &area);
            volumes.push(excess + volume.compliance() * pressure);
        }
        self.newton.problem.unknowns.release_held(&mut gradient);
        Balance { gradient, volumes }
    }

    /// The squared force that is left at `x` [m] [N^2], without what held contacts bear.
    pub fn unbalanced(&self, energy: &Energy, x: &[Point3<f64>]) -> f64 {
        let mut force = self.balance(energy, x).gradient;
        self.newton.problem.support_together(&self.held, &mut force);
        dot(&force, &force)
    }

    /// The motion that undoes the change of a balance by a unit of a parameter. The adjoint of a measure
    /// is the motion for its derivative by the positions as the gradient; the negative
    /// [`Balance::dot`] of it with the change of a balance is the change of the measure.
    #[must_use]
    pub fn shift(&mut self, change: &Balance) -> Shift {
        let mut left: Field = change.gradient.iter().map(|g| -g).collect();
        self.newton.problem.unknowns.release_held(&mut left);
        let volumes: Vec<f64> = change.volumes.iter().map(|v| -v).collect();
        let still = vec![0.0; volumes.len()];
        let (mut x, mut pressures) = self.preconditioned(&left, &volumes);
        // The right side alone is zero where only volumes change.
        let scale = self.pushed(&x, &still);
        let scale = dot(&left, &left).sqrt() + dot(&scale, &scale).sqrt();
        let mut residual = self.remaining(&left, &x, &pressures);
        let (mut along, mut pressing) = self.preconditioned(&residual, &still);
        let mut product = dot(&residual, &along);
        for _ in 0..GRADIENTS {
            if dot(&residual, &residual).sqrt() <= SOLVED * scale || !(product > 0.0) {
                break;
            }
            let pushed = self.pushed(&along, &pressing);
            let curved = dot(&along, &pushed);
            // Not a minimum along this direction.
            if !(curved > 0.0) {
                break;
            }
            let step = product / curved;
            add_scaled(&mut x, step, &along);
            let each = pressures.iter_mut().zip(&pressing);
            each.for_each(|(p, more)| *p += step * more);
            add_scaled(&mut residual, -step, &pushed);
            let (next, pressed) = self.preconditioned(&residual, &still);
            let before = std::mem::replace(&mut product, dot(&residual, &next));
            let share = product / before;
            let each = along.iter_mut().zip(next);
            each.for_each(|(along, next)| *along = next + *along * share);
            let each = pressing.iter_mut().zip(pressed);
            each.for_each(|(pressing, next)| *pressing = next + *pressing * share);
        }
        // What was carried along has rounding errors.
        let residual = self.remaining(&left, &x, &pressures);
        let residual = match scale > 0.0 {
            true => dot(&residual, &residual).sqrt() / scale,
            false => 0.0,
        };
        Shift {
            x,
            pressures,
            residual,
        }
    }

    /// The solution with the factor: a motion that changes the volumes as given, and their pressures.
    fn preconditioned(&mut self, force: &Field, volumes: &[f64]) -> (Field, Vec<f64>) {
        let mut x = force.clone();
        self.newton.invert([&mut x].into_iter());
        let energy = &self.newton.problem.energy;
        let compliance = |i: usize| energy.volumes[i].compliance();
        let found = multipliers(&self.areas, &self.spreads, compliance, |i| {
            volumes[i] - dot(&self.areas[i], &x)
        });
        let each = found.iter().zip(&self.spreads);
        each.for_each(|(pressure, spread)| add_scaled(&mut x, *pressure, spread));
        (x, found)
    }

    /// The force that a motion and pressures need [N].
    fn pushed(&self, motion: &Field, pressures: &[f64]) -> Field {
        let mut force = vec![Vector3::zeros(); motion.len()];
        let energy = &self.newton.problem.energy;
        energy.hessian(&self.x, &self.pressures, false, &mut |a, b, block| {
            force[a as usize] += block * motion[b as usize];
        });
        let each = pressures.iter().zip(&self.areas);
        each.for_each(|(pressure, area)| add_scaled(&mut force, -pressure, area));
        self.newton.problem.unknowns.release_held(&mut force);
        force
    }

    /// What is left of a force [N].
    fn remaining(&self, force: &Field, motion: &Field, pressures: &[f64]) -> Field {
        let pushed = self.pushed(motion, pressures);
        force.iter().zip(&pushed).map(|(f, p)| f - p).collect()
    }
}

/// The pressure in each volume [Pa], and the rows among `held` that forces press against.
fn pressed(
    energy: &Energy,
    unknowns: &Unknowns,
    x: &[Point3<f64>],
    held: &[ContactPlane],
) -> (Vec<f64>, Vec<ContactPlane>) {
    let mut force = vec![Vector3::zeros(); x.len()];
    energy.value_and_gradient(x, &mut force);
    let volumes = energy.volumes.iter().map(|v| v.value_and_gradient(x));
    let (excess, mut areas): (Vec<f64>, Vec<Field>) = volumes.unzip();
    let fields = [&mut force].into_iter().chain(&mut areas);
    fields.for_each(|field| unknowns.release_held(field));
    // What touches is pressed by more than the volumes.
    let (mut alone, mut without) = (force.clone(), areas.clone());
    for (v, weight) in held.iter().flat_map(|row| row.terms) {
        let fields = [&mut alone].into_iter().chain(&mut without);
        fields
            .filter(|_| weight != 0.0)
            .for_each(|field| field[v as usize] = Vector3::zeros());
    }
    let free = multipliers(&without, &without, |_| 0.0, |i| dot(&alone, &without[i]));
    let each = energy.volumes.iter().zip(&excess).zip(free);
    let pressure = |((volume, excess), free): ((&EnclosedVolume, &f64), f64)| {
        let compliance = volume.compliance();
        if compliance > 0.0 {
            -excess / compliance
        } else {
            free
        }
    };
    let pressures: Vec<f64> = each.map(pressure).collect();
    for (pressure, area) in pressures.iter().zip(&areas) {
        add_scaled(&mut force, -pressure, area);
    }
    let rows = held.iter().filter(|row| row.along(&force) > 0.0);
    (pressures, rows.copied().collect())
}

/// The mean stiffness of a vertex against motion in one direction [N/m].
fn mean_stiffness(energy: &Energy, x: &[Point3<f64>]) -> f64 {
    let mut diagonal = vec![nalgebra::Matrix3::zeros(); x.len()];
    energy.hessian(x, &[], true, &mut |a, b, block| {
        if a == b {
            diagonal[a as usize] += block;
        }
    });
    let traces = diagonal.iter().map(|block| block.trace() / 3.0);
    traces.sum::<f64>() / x.len().max(1) as f64
}

/// A contact that stays at its height.
#[derive(Clone, Copy, Debug)]
struct HeldRow {
    row: ContactPlane,
    /// Height where it is held [m].
    at: f64,
    /// Stiffness [N/m].
    stiffness: f64,
}

impl HeldRow {
    fn weights(&self) -> [f64; 4] {
        self.row.terms.map(|(_, weight)| weight)
    }
}

impl Stencil<4> for HeldRow {
    fn points(&self) -> [u32; 4] {
        self.row.terms.map(|(vertex, _)| vertex)
    }

    fn energy_and_gradient(&self, x: &[Point3<f64>; 4]) -> Option<(f64, [Vector3<f64>; 4])> {
        let each = self.weights().into_iter().zip(x);
        let along = |(w, x): (f64, &Point3<f64>)| w * (x - self.row.origin).dot(&self.row.normal);
        let off = each.map(along).sum::<f64>() - self.row.distance - self.at;
        let force = self.row.normal * (self.stiffness * off);
        Some((
            0.5 * self.stiffness * off * off,
            self.weights().map(|w| force * w),
        ))
    }

    fn hessian(&self, _: &[Point3<f64>; 4], _: bool) -> Option<Blocks<4>> {
        let normal = self.row.normal;
        let across = normal * normal.transpose() * self.stiffness;
        let weights = self.weights();
        Some(weights.map(|a| weights.map(|b| across * (a * b))))
    }

    fn scalar_hessian(&self, _: &[Point3<f64>; 4]) -> Option<[[f64; 4]; 4]> {
        let weights = self.weights();
        Some(weights.map(|a| weights.map(|b| self.stiffness / 3.0 * a * b)))
    }
}
