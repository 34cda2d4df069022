//! A spring of rest length zero from a vertex to a position in space: the user drags a vertex with
//! it.
//!
//! In a step the grip is a constraint of three components, x - p = 0, with compliance 1/k. It is
//! therefore stable for any stiffness. In an equilibrium its energy is k |x - p|^2 / 2.

use nalgebra::{Point3, Vector3};

use crate::constraints::Project;
use crate::constraints::spring::{Anchors, Linear, anchors};
use crate::particles::{Packed, Particles};
use crate::state::{DecodeError, Reader, State, Writer};

/// A vertex that is dragged.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grip {
    /// The vertex.
    pub vertex: u32,
    /// The target position [m].
    pub to: Point3<f64>,
    /// Stiffness of the spring [N/m].
    pub stiffness: f64,
    /// Force times the square of the step [N s^2], like the multipliers of constraints.
    multiplier: Vector3<f64>,
}

/// Name of the grip as an effect.
pub const DRAG: &str = "drag";

impl Grip {
    /// A spring of `stiffness` [N/m] from `vertex` to a position [m].
    pub fn new(vertex: u32, to: Point3<f64>, stiffness: f64) -> Self {
        Self {
            vertex,
            to,
            stiffness,
            multiplier: Vector3::zeros(),
        }
    }

    /// The energy, for an equilibrium.
    pub fn potential(&self) -> Anchors<Linear> {
        anchors(DRAG, [(self.vertex, self.to, Linear::new(self.stiffness))])
    }

    /// The displacement [m] of a vertex at `x` with inverse mass `w` [1/kg] in one sweep: the
    /// update of \[macklin2016\] with the unit matrix as gradient.
    fn displacement(&mut self, x: &Point3<f64>, w: f64, dt: f64) -> Vector3<f64> {
        let compliance = 1.0 / (self.stiffness * dt * dt);
        // Nothing moves a fixed vertex, and a spring without stiffness moves no vertex.
        if !(w > 0.0 && compliance.is_finite()) {
            return Vector3::zeros();
        }
        let change = (self.to - x - self.multiplier * compliance) / (w + compliance);
        self.multiplier += change;
        change * w
    }
}

impl State for Grip {
    fn save(&self, _: &mut Writer) {}

    fn restore(&mut self, _: &mut Reader<'_>) -> Result<(), DecodeError> {
        Ok(())
    }
}

impl Project for Grip {
    fn name(&self) -> &'static str {
        DRAG
    }

    fn len(&self) -> usize {
        1
    }

    fn begin_step(&mut self) {
        self.multiplier = Vector3::zeros();
    }

    fn project(&mut self, particles: &mut Particles, dt: f64) {
        let v = self.vertex as usize;
        let moved = self.displacement(&particles.position[v], particles.inverse_mass[v], dt);
        particles.position[v] += moved;
    }

    fn project_packed(&mut self, packed: &mut Packed, dt: f64) {
        let place = packed.place(self.vertex) as usize;
        let [x, y, z, w] = packed.slots[place].0;
        let moved = self.displacement(&Point3::new(x, y, z), w, dt);
        packed.slots[place].0 = [x + moved.x, y + moved.y, z + moved.z, w];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::constraints::Potential;

    /// Position of a particle of 2 kg on a spring of 8 N/m, initially at rest 1 m from the spring's
    /// end, after one step of half a second by `displacement`.
    fn after(sweeps: usize, wrong: f64) -> f64 {
        let mut grip = Grip::new(0, Point3::origin(), 8.0 * wrong);
        let mut particles = Particles::at_rest(vec![Point3::new(1.0, 0.0, 0.0)], vec![0.5]);
        grip.begin_step();
        (0..sweeps).for_each(|_| grip.project(&mut particles, 0.5));
        particles.position[0].x
    }

    #[test]
    fn a_step_is_that_of_implicit_euler_for_any_number_of_sweeps() {
        // m (x - 1) / dt^2 = -k x.
        let exact = 1.0 / (1.0 + 8.0 * 0.25 / 2.0);
        for sweeps in [1, 2, 7] {
            assert!(
                (after(sweeps, 1.0) - exact).abs() < 4.0 * f64::EPSILON,
                "{}",
                after(sweeps, 1.0)
            );
        }
        assert!(
            (after(1, 2.0) - exact).abs() > 0.1,
            "twice the stiffness must not pass"
        );
    }

    #[test]
    fn what_is_held_stays_and_no_stiffness_moves_nothing() {
        let mut grip = Grip::new(0, Point3::origin(), 8.0);
        assert_eq!(
            grip.displacement(&Point3::new(1.0, 2.0, 3.0), 0.0, 0.5),
            Vector3::zeros()
        );
        let mut none = Grip::new(0, Point3::origin(), 0.0);
        assert_eq!(
            none.displacement(&Point3::new(1.0, 2.0, 3.0), 1.0, 0.5),
            Vector3::zeros()
        );
    }

    #[test]
    fn the_gradient_is_that_of_the_energy() {
        let grip = Grip::new(1, Point3::new(0.3, -0.2, 0.1), 8.0).potential();
        let x = vec![Point3::origin(), Point3::new(1.0, 2.0, 3.0)];
        let mut gradient = vec![Vector3::zeros(); 2];
        grip.energy_and_gradient(&x, &mut gradient);
        assert_eq!(gradient[0], Vector3::zeros());
        for k in 0..3 {
            let at = |h: f64| {
                let mut moved = x.clone();
                moved[1][k] += h;
                grip.energy(&moved)
            };
            // Central differences of a quadratic are exact except for rounding.
            let difference = (at(0.5) - at(-0.5)) / 1.0;
            assert!(
                (gradient[1][k] - difference).abs() < 1e-13 * grip.energy(&x),
                "{k}"
            );
            assert!(
                (2.0 * gradient[1][k] - difference).abs() > 1.0,
                "twice as much must not pass"
            );
        }
    }
}
