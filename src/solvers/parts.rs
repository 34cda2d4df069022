//! A step of classic PBD in parts: bones and predicted motion advance by a share in each, and
//! velocities are those of the whole step. So it damps as one step does.

use nalgebra::{Point3, Vector3};

use crate::particles::Particles;

/// The parts of a step.
#[derive(Clone, Debug)]
pub(super) struct Parts {
    /// Number of parts of a step, of those that are made, and of those before the present one.
    count: u32,
    done: u32,
    kept: u32,
    /// Positions at the beginning of the step, and the velocities that it predicted.
    begun: Vec<Point3<f64>>,
    predicted: Vec<Vector3<f64>>,
}

impl Default for Parts {
    /// A step in one part.
    fn default() -> Self {
        Self {
            count: 1,
            done: 0,
            kept: 0,
            begun: Vec::new(),
            predicted: Vec::new(),
        }
    }
}

impl Parts {
    /// Begins a step in `count` parts.
    pub fn divide(&mut self, count: u32) {
        (self.count, self.done) = (count.max(1), 0);
    }

    /// Keeps the place for [`Self::back`].
    pub fn keep(&mut self) {
        self.kept = self.done;
    }

    /// Goes back to the beginning of the part.
    pub fn back(&mut self) {
        self.done = self.kept;
    }

    /// True before the first part.
    pub fn begins(&self) -> bool {
        self.done == 0
    }

    /// Time of the step [s], of which a part takes `dt`.
    pub fn whole(&self, dt: f64) -> f64 {
        dt * f64::from(self.count)
    }

    /// Keeps what a whole step begins with, after the prediction of its velocities.
    pub fn begin(&mut self, particles: &Particles) {
        if self.count > 1 {
            self.begun.clone_from(&particles.position);
            self.predicted.clone_from(&particles.velocity);
        }
    }

    /// Sets the velocities that the step predicted.
    pub fn predict(&self, particles: &mut Particles) {
        particles.velocity.clone_from(&self.predicted);
    }

    /// Ends a part of `dt` [s] that began at `start`. Returns the positions and the time [s] from which
    /// velocities count.
    pub fn end<'a>(&'a mut self, start: &'a [Point3<f64>], dt: f64) -> (&'a [Point3<f64>], f64) {
        let made = self.done + 1;
        self.done = made % self.count;
        match self.count {
            1 => (start, dt),
            _ => (&self.begun, dt * f64::from(made)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::step::{StepSettings, System};
    use super::*;
    use crate::constraints::{Batch, Distance, SweepOrder};

    const DT: f64 = 0.02;

    /// A particle of 1 kg on a spring of classic stiffness to a held one, and a free one.
    fn system(gravity: Vector3<f64>) -> System {
        let position = vec![
            Point3::origin(),
            Point3::new(3.0, 0.0, 0.0),
            Point3::new(0.0, 1.0, 0.0),
        ];
        let mut particles = Particles::at_rest(position, vec![0.0, 1.0, 1.0]);
        particles.velocity[2] = Vector3::new(0.5, 0.0, -1.0);
        let settings = StepSettings {
            iterations: 2,
            gravity,
            velocity_factor: 0.9,
            force_factor: 0.9,
            speed_limit: f64::INFINITY,
        };
        let mut system = System::new(particles, settings);
        let spring = Distance {
            points: [0, 1],
            rest: 1.0,
        };
        let batch = Batch::new(vec![spring], vec![0.0], SweepOrder::Stored, 3, &[]);
        system.elastic.push(Box::new(batch.with_relaxation(&[0.3])));
        system
    }

    /// The particle after `steps` steps that are made in `parts` parts, and its velocity times a step.
    fn after(steps: u32, parts: u32, shorter: u32, of: (usize, Vector3<f64>)) -> [Vector3<f64>; 2] {
        let (particle, gravity) = of;
        let mut system = system(gravity);
        system.divide(parts);
        let calls = parts * shorter;
        for _ in 0..steps * calls {
            let done = system.step(&[], DT / f64::from(calls));
            done.expect("finite numbers");
        }
        let Particles {
            position, velocity, ..
        } = &system.particles;
        [position[particle].coords, velocity[particle] * DT]
    }

    #[test]
    fn a_step_in_parts_is_the_step() {
        let gravity = Vector3::new(0.0, -9.81, 0.0);
        // A free flight of three steps, and one step of a spring.
        for (steps, of) in [(3, (2, gravity)), (1, (1, Vector3::zeros()))] {
            let whole = after(steps, 1, 1, of);
            let apart = |other: [Vector3<f64>; 2]| {
                (other[0] - whole[0]).norm() + (other[1] - whole[1]).norm()
            };
            let parted = apart(after(steps, 8, 1, of));
            assert!(parted <= 1e-14, "{parted}");
            // Control: shorter steps are stiffer, and damp more often.
            let shorter = apart(after(steps, 1, 8, of));
            assert!(!(shorter <= 1e-3), "{shorter}");
        }
    }
}
