//! How skin at equilibrium answers to a change of its material, its implants or its depth.

use nalgebra::Point3;

use super::SkinError;
use super::ball::Ball;
use super::detector::{BENDS, Detector, Lifts};
use super::plan::{Inserted, PreparedPatch};
use super::settle::SkinSystem;
use crate::solvers::{Energy, Tangent};

/// Radius of the surface under the skin at an equilibrium whose derivative is taken, relative to the
/// base: about that of the implant.
const CURVED: f64 = 0.5;

/// What presses from below.
#[derive(Clone, Debug, PartialEq)]
pub enum Pressing {
    /// Implants of these volumes [m^3].
    Implants(Vec<f64>),
    /// A ball.
    Ball(Ball),
}

/// An energy, and the positions [m] of its vertices.
pub type EnergyAt = (Energy, Vec<Point3<f64>>);

impl PreparedPatch {
    fn system(&self, pressing: &Pressing) -> Result<SkinSystem, SkinError> {
        match pressing {
            Pressing::Implants(volumes) => Ok(self.model(volumes)?.0),
            Pressing::Ball(ball) => Ok(self.model_over(ball)),
        }
    }

    /// The answer of the equilibrium `done`.
    ///
    /// # Errors
    /// As of [`Tangent::new`].
    pub fn tangent(&self, pressing: &Pressing, done: &Inserted) -> Result<Tangent, SkinError> {
        let system = self.system(pressing)?;
        let energy = system.energy_at(&done.lifts, &done.x);
        Tangent::new(energy, &done.x, &system.inverse_mass(), &[])
            .map_err(|error| SkinError::Solver(error.to_string()))
    }

    /// The energy of this skin where `done` is, the equilibrium of another one, with fixed vertices where
    /// this skin holds them; `None` if its vertices are others.
    ///
    /// # Errors
    /// An implant that does not fit.
    pub fn energy_where(
        &self,
        pressing: &Pressing,
        (other, done): (&Self, &Inserted),
    ) -> Result<Option<EnergyAt>, SkinError> {
        let system = self.system(pressing)?;
        let (own, n) = (&self.layers, self.layers.count());
        let is_same = system.count() == done.x.len()
            && own.triangles == other.layers.triangles
            && own.held == other.layers.held
            && own.rest[..n] == other.layers.rest[..n];
        if !is_same {
            return Ok(None);
        }
        let mut x = done.x.clone();
        for (v, _) in own.held.iter().enumerate().filter(|(_, held)| **held) {
            x[v] = own.rest[v];
        }
        Ok(Some((system.energy_at(&done.lifts, &x), x)))
    }
}

impl SkinSystem {
    /// The energy at an equilibrium `x` [m] whose contacts have the offsets `lifts`.
    fn energy_at(&self, lifts: &Lifts, x: &[Point3<f64>]) -> Energy {
        let mut detector = Detector::new(self);
        detector.lifts.clone_from(lifts);
        let mut touching = detector.touching(x);
        // Rounds take the surface for more curved than it is, so that none diverges.
        let touches = touching.touches.iter_mut();
        touches.for_each(|touch| touch.slide *= BENDS / CURVED);
        self.energy(&touching, &self.rest(), x)
    }
}
