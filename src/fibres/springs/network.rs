//! Equilibrium of springs between grid points with a fixed surface.
//!
//! A spring pulls with D (l - l0), where D = 1/l0 and l0 is its length in the template at rest. If
//! all springs are in tension, there is one equilibrium. The source integrates a damped motion
//! (7.2) to reach it; the result does not depend on the path.

use nalgebra::{Point3, Vector3};

use super::SpringsError;
use crate::constraints::Stencils;
use crate::constraints::spring::{Between, Linear, Spring, SpringLaw};
use crate::fibres::template::{Sampling, Template};
use crate::solvers::NoContact;
use crate::solvers::descent::DescentSettings;
use crate::solvers::energy::Energy;
use crate::solvers::newton::Newton;
use crate::solvers::sparse::FactorError;
use crate::solvers::unknowns::{Laplacian, Unknowns};
use crate::springs::lattice::LatticeShape;
use crate::springs::{Hooke, Neighbours, patterns};

/// Stopping criteria: Newton's method converges in a few steps, or springs are in compression. The
/// residual force is that of rounding.
const SETTINGS: DescentSettings = DescentSettings {
    tolerance: 4e-12,
    iterations: 60,
};

/// The ends and the rest length of each spring of a template to the six nearest neighbours of each
/// point. The rest length is that in a template whose cube has side 1; the stiffness is D = 1/rest.
pub fn springs(sampling: &Sampling, template: Template) -> Vec<([u32; 2], f64)> {
    let x = sampling.positions(template);
    let pairs = patterns::lattice(&sampling.shape(), Neighbours::Six);
    let rest = |ends: [u32; 2]| (x[ends[0] as usize] - x[ends[1] as usize]).norm();
    pairs.map(|ends| (ends, rest(ends))).collect()
}

/// Brings the inner points to equilibrium, for a template of side `side` \[m\]; points on the
/// surface are fixed.
///
/// # Errors
/// Newton's method does not converge because springs are in compression, or the system cannot be
/// factorised.
pub fn rest(
    sampling: &Sampling,
    template: Template,
    side: f64,
    positions: &mut [Point3<f64>],
) -> Result<(), SpringsError> {
    let held = sampling.on_surface();
    let springs = springs(sampling, template);
    without_rest_length(&springs, &held, positions)?;
    if side == 0.0 || held.iter().all(|held| *held) {
        return Ok(());
    }
    let cord = |(ends, rest): ([u32; 2], f64)| {
        let (rest, stiffness) = (side * rest, 1.0 / rest);
        (ends, Tense(Hooke { rest, stiffness }))
    };
    let energy = energy(springs.into_iter().map(cord));
    let mut newton = Newton::new(energy, positions, &inverse_mass(&held), SETTINGS)?;
    let end = newton.solve(positions, &mut NoContact, |_, _| true)?;
    if end.converged {
        Ok(())
    } else {
        Err(SpringsError::NotAtRest {
            steps: end.iterations as usize,
            force: end.residual,
        })
    }
}

/// Brings the points within one layer to equilibrium between springs to their four neighbours in
/// the layer; points on its sides are fixed.
///
/// # Errors
/// The system cannot be factorised.
pub fn face(
    sampling: &Sampling,
    layer: usize,
    positions: &mut [Point3<f64>],
) -> Result<(), SpringsError> {
    let [nr, ns, _] = sampling.points;
    let held: Vec<bool> = (0..ns)
        .flat_map(|j| (0..nr).map(move |i| i == 0 || j == 0 || i + 1 == nr || j + 1 == ns))
        .collect();
    let sheet = LatticeShape {
        points: [nr, ns, 1],
        origin: [0.0; 3],
        spacing: [1.0; 3],
    };
    let pairs = patterns::lattice(&sheet, Neighbours::Six);
    let springs: Vec<([u32; 2], f64)> = pairs.map(|ends| (ends, 1.0)).collect();
    let first = sampling.number([0, 0, layer]);
    without_rest_length(&springs, &held, &mut positions[first..first + nr * ns])?;
    Ok(())
}

/// The equilibrium of springs without rest length. Their second derivative is constant and equal in
/// all directions of space, so that one linear system gives it.
fn without_rest_length(
    springs: &[([u32; 2], f64)],
    held: &[bool],
    positions: &mut [Point3<f64>],
) -> Result<(), FactorError> {
    let unknowns = Unknowns::new(&inverse_mass(held));
    if unknowns.free.is_empty() {
        return Ok(());
    }
    let linear = |&(ends, rest): &([u32; 2], f64)| (ends, Linear::new(1.0 / rest));
    let energy = energy(springs.iter().map(linear));
    let mut x: Vec<Vector3<f64>> = positions.iter().map(|p| p.coords).collect();
    Laplacian::new(&energy, &unknowns, positions)?.extend(&unknowns, &mut x);
    for (position, x) in positions.iter_mut().zip(x) {
        position.coords = x;
    }
    Ok(())
}

fn inverse_mass(held: &[bool]) -> Vec<f64> {
    held.iter().map(|held| f64::from(u8::from(!held))).collect()
}

fn energy<L: SpringLaw>(springs: impl Iterator<Item = ([u32; 2], L)>) -> Energy {
    let spring = |(ends, law)| Spring {
        arm: Between(ends),
        law,
    };
    Energy {
        elastic: vec![Box::new(Stencils::new(
            "springs",
            springs.map(spring).collect(),
        ))],
        ..Energy::default()
    }
}

/// A spring whose second derivative leaves out the negative stiffness across a compressed spring.
/// Newton's method then always has a positive definite matrix.
#[derive(Clone, Copy, Debug)]
struct Tense(Hooke);

impl SpringLaw for Tense {
    fn energy(&self, length: f64) -> f64 {
        self.0.energy(length)
    }

    fn tension(&self, length: f64) -> f64 {
        self.0.tension(length)
    }

    fn slope(&self, length: f64) -> f64 {
        self.0.slope(length)
    }

    fn factors(&self, d: &Vector3<f64>, _: bool) -> (f64, f64, f64) {
        self.0.factors(d, true)
    }

    fn force_scale(&self, d: &Vector3<f64>) -> f64 {
        self.0.stiffness * d.norm()
    }
}
