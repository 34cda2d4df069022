//! The shell of an implant: it carries tension and no compression, like a thin sheet that wrinkles
//! instead.

use nalgebra::{Matrix3, Vector3};

use crate::constraints::Stencils;
use crate::constraints::distance::Distance;
use crate::constraints::spring::{Between, Spring, SpringLaw};

/// Share of its stiffness with which a spring pulls its ends together at any length. It determines
/// the positions of the vertices of a slack shell and costs as much as a strain of one percent.
const GATHER: f64 = 0.01;

/// The energy k (max(0, l - l0)^2 + l^2/100) / 2. It is convex, so that the shell has no folds with
/// several solutions.
#[derive(Clone, Copy, Debug)]
pub struct Membrane {
    rest: f64,
    /// k [N/m].
    stiffness: f64,
    /// True if this energy sets the scale of the forces.
    alone: bool,
}

/// The shell of an implant.
pub type Envelope = Stencils<Spring<Between, Membrane>, 2>;

/// A shell of springs with a stiffness each [N/m]. With `alone`, without skin above it, the shell
/// defines its own scale of forces.
pub fn envelope(springs: &[Distance], stiffness: &[f64], alone: bool) -> Envelope {
    let spring = |(spring, &stiffness): (&Distance, &f64)| Spring {
        arm: Between(spring.points),
        law: Membrane {
            rest: spring.rest,
            stiffness,
            alone,
        },
    };
    let springs = springs.iter().zip(stiffness).map(spring);
    Stencils::new("envelope", springs.collect())
}

impl SpringLaw for Membrane {
    fn energy(&self, length: f64) -> f64 {
        let over = (length - self.rest).max(0.0);
        0.5 * self.stiffness * (over * over + GATHER * length * length)
    }

    fn tension(&self, length: f64) -> f64 {
        self.stiffness * ((length - self.rest).max(0.0) + GATHER * length)
    }

    fn tension_per_length(&self, length: f64) -> f64 {
        let taut = if length > self.rest {
            1.0 - self.rest / length
        } else {
            0.0
        };
        self.stiffness * (taut + GATHER)
    }

    fn slope(&self, length: f64) -> f64 {
        let taut = if length > self.rest { 1.0 } else { 0.0 };
        self.stiffness * (taut + GATHER)
    }

    // The sum of both springs, each positive semi-definite.
    fn block(&self, d: &Vector3<f64>, _: bool) -> Matrix3<f64> {
        let length = d.norm();
        let mut block = Matrix3::from_diagonal_element(self.stiffness * GATHER);
        if length > self.rest {
            let unit = d / length;
            let along = unit * unit.transpose();
            let across = (Matrix3::identity() - along) * (1.0 - self.rest / length);
            block += (along + across) * self.stiffness;
        }
        block
    }

    fn scalar(&self, length: f64) -> f64 {
        self.stiffness * if length >= self.rest { 1.0 } else { GATHER }
    }

    fn force_scale(&self, _: &Vector3<f64>) -> f64 {
        // Under skin the springs of the skin set the scale of the forces.
        if self.alone {
            self.stiffness * self.rest
        } else {
            0.0
        }
    }
}
