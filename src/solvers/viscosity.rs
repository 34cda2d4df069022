//! Dampers beside the springs of the edges: velocities of neighbours, relative to those with which bones
//! carry them along, even out.
//!
//! A damper of `time` times the stiffness of its edge makes a Kelvin-Voigt solid of that retardation
//! time (Rayleigh's damping in proportion to stiffness). A damping in proportion to mass slows the long
//! waves of a soft muscle most, which need no damping, and short ones least, which ring.

use nalgebra::Vector3;

use super::sparse::{Factor, FactorError};
use crate::constraints::Distance;
use crate::particles::Particles;

/// The dampers of a body.
pub(crate) struct Viscosity {
    /// Ends and damping [N s/m] of each edge.
    dampers: Vec<([u32; 2], f64)>,
    /// Factor of `m + h c`, and its `h` [s].
    factor: Factor<1>,
    time_step: f64,
    /// Right-hand sides: one column for each axis.
    rhs: Vec<f64>,
}

impl Viscosity {
    /// Dampers beside `edges` of this `stiffness` [N/m], with a retardation `time` [s].
    ///
    /// # Errors
    /// Too little memory for the factor.
    pub fn new(
        count: usize,
        edges: &[Distance],
        stiffness: &[f64],
        time: f64,
    ) -> Result<Self, FactorError> {
        let points: Vec<[u32; 2]> = edges.iter().map(|e| e.points).collect();
        let dampers = points.iter().zip(stiffness).map(|(&p, k)| (p, k * time));
        Ok(Self {
            dampers: dampers.collect(),
            factor: Factor::new(count, &points)?,
            time_step: 0.0,
            rhs: vec![0.0; 3 * count],
        })
    }

    /// Evens out the velocities of `particles` over `h` [s], by an implicit step, which is stable for any
    /// `h`. `carried` are the velocities [m/s] with which bones carry them. Particles without an inverse
    /// mass keep theirs, and neighbours even out with the bones at their places. Without a factor, as of
    /// masses that are not finite, nothing changes: the step itself then reports what is wrong.
    pub fn even_out(
        &mut self,
        particles: &mut Particles,
        carried: impl Fn(usize) -> Vector3<f64>,
        h: f64,
    ) {
        let Particles {
            velocity,
            inverse_mass,
            ..
        } = particles;
        if h != self.time_step {
            self.time_step = 0.0;
            if self.factorise(inverse_mass, h).is_err() {
                return;
            }
            self.time_step = h;
        }
        let count = velocity.len();
        for (i, (v, w)) in velocity.iter().zip(inverse_mass.iter()).enumerate() {
            let momentum = match *w > 0.0 {
                true => (v - carried(i)) / *w,
                false => Vector3::zeros(),
            };
            (0..3).for_each(|axis| self.rhs[axis * count + i] = momentum[axis]);
        }
        self.factor.solve(&mut self.rhs, 3);
        for (i, (v, w)) in velocity.iter_mut().zip(inverse_mass.iter()).enumerate() {
            if *w > 0.0 {
                let relative = [0, 1, 2].map(|axis| self.rhs[axis * count + i]);
                *v = carried(i) + Vector3::from(relative);
            }
        }
    }

    /// Factorises `m + h c`; the rows of particles without an inverse mass are those of the identity.
    fn factorise(&mut self, inverse_mass: &[f64], h: f64) -> Result<(), FactorError> {
        self.factor.clear();
        for (i, &w) in inverse_mass.iter().enumerate() {
            let mass = if w > 0.0 { 1.0 / w } else { 1.0 };
            self.factor.add_diagonal(i as u32, mass);
        }
        let is_free = |p: u32| inverse_mass[p as usize] > 0.0;
        for &([a, b], c) in &self.dampers {
            for p in [a, b].into_iter().filter(|&p| is_free(p)) {
                self.factor.add_diagonal(p, h * c);
            }
            if is_free(a) && is_free(b) {
                self.factor.add(a.max(b), a.min(b), &[[-h * c]]);
            }
        }
        self.factor.factorise()
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;
    use crate::mesh::shapes::tube;
    use crate::mesh::topology::Topology;
    use crate::solvers::stiffness;
    use crate::testing::tolerances::T2;

    /// A tube of 0.1 kg whose vertices have velocities of their own, and its dampers.
    fn body(time: f64) -> (Particles, Viscosity) {
        let mesh = tube(0.01, 0.1, 12);
        let count = mesh.vertices.len();
        let (edges, k) = stiffness::edges(&mesh, &Topology::new(&mesh), 300.0);
        let mut particles = Particles::at_rest(mesh.vertices, vec![count as f64 / 0.1; count]);
        for (i, v) in particles.velocity.iter_mut().enumerate() {
            let i = i as f64;
            *v = Vector3::new((0.7 * i).sin(), (1.3 * i).cos(), 0.2);
        }
        let viscosity = Viscosity::new(count, &edges, &k, time).expect("memory");
        (particles, viscosity)
    }

    fn momentum(particles: &Particles) -> Vector3<f64> {
        let each = particles.velocity.iter().zip(&particles.inverse_mass);
        each.map(|(v, w)| v / *w).sum()
    }

    fn energy(particles: &Particles) -> f64 {
        let each = particles.velocity.iter().zip(&particles.inverse_mass);
        each.map(|(v, w)| 0.5 * v.norm_squared() / w).sum()
    }

    /// Greatest sum of the dampers of a vertex [N s/m].
    fn most_damping(viscosity: &Viscosity) -> f64 {
        let ends = viscosity.dampers.iter().flat_map(|([a, b], _)| [*a, *b]);
        let last = ends.max().expect("a damper");
        let of = |v: u32| {
            let own = viscosity.dampers.iter().filter(|(p, _)| p.contains(&v));
            own.map(|(_, c)| c).sum::<f64>()
        };
        crate::mesh::measures::max_or_nan((0..=last).map(of))
    }

    #[test]
    fn without_a_factor_nothing_changes() {
        let (mut particles, mut viscosity) = body(0.02);
        // Its mass is not finite.
        particles.inverse_mass[4] = 1e-320;
        let before = particles.velocity.clone();
        viscosity.even_out(&mut particles, |_| Vector3::zeros(), 1e-3);
        assert_eq!(particles.velocity, before);
    }

    #[test]
    fn dampers_keep_momentum_and_only_take_energy() {
        for h in [1e-5, 1e-3, 1.0, 1e4] {
            let (mut particles, mut viscosity) = body(0.02);
            let (p, e) = (momentum(&particles), energy(&particles));
            viscosity.even_out(&mut particles, |_| Vector3::zeros(), h);
            let lost = (momentum(&particles) - p).norm();
            // The rounding grows with the condition of the system, 1 + h c / m.
            let condition = 1.0 + h * most_damping(&viscosity) * particles.inverse_mass[0];
            assert!(lost <= condition * T2 * p.norm(), "{h} {lost}");
            assert!(energy(&particles) < e, "{h}");
        }
        // Control: a damper to something at rest takes momentum.
        let (mut particles, mut viscosity) = body(0.02);
        let p = momentum(&particles);
        particles.inverse_mass[0] = 0.0;
        viscosity.even_out(&mut particles, |_| Vector3::zeros(), 1e-3);
        particles.inverse_mass[0] = particles.inverse_mass[1];
        assert!((momentum(&particles) - p).norm() > 1e-3 * p.norm());
    }

    #[test]
    fn what_goes_along_with_its_bones_is_not_damped() {
        let (mut particles, mut viscosity) = body(0.02);
        let along = particles.velocity.clone();
        viscosity.even_out(&mut particles, |i| along[i], 1e-3);
        let pairs = particles.velocity.iter().zip(&along);
        assert!(pairs.clone().all(|(v, a)| (v - a).norm() <= T2));
        // Control: relative to space they even out.
        viscosity.even_out(&mut particles, |_| Vector3::zeros(), 1e-3);
        assert!(
            particles
                .velocity
                .iter()
                .zip(&along)
                .any(|(v, a)| (v - a).norm() > 0.1)
        );
    }

    /// Amplitude of two masses on a spring after `t` [s], relative to that at the start.
    fn amplitude(time: f64, t: f64) -> f64 {
        let (k, m, dt) = (400.0, 2.0, 1e-4);
        let rest = 1.0;
        let position = vec![Point3::origin(), Point3::new(rest + 0.1, 0.0, 0.0)];
        let mut particles = Particles::at_rest(position, vec![1.0 / m; 2]);
        let spring = Distance {
            points: [0, 1],
            rest,
        };
        let mut viscosity = Viscosity::new(2, &[spring], &[k], time).expect("memory");
        let mut most = 0.0;
        for step in 0..(t / dt) as usize {
            let stretch = particles.position[1].x - particles.position[0].x - rest;
            let dv = Vector3::x() * (stretch * k / m * dt);
            particles.velocity[0] += dv;
            particles.velocity[1] -= dv;
            viscosity.even_out(&mut particles, |_| Vector3::zeros(), dt);
            for (x, v) in particles.position.iter_mut().zip(&particles.velocity) {
                *x += v * dt;
            }
            // The last period: 2 pi / 20 1/s.
            if (step as f64 * dt) > t - 0.32 && stretch.abs() > most {
                most = stretch.abs();
            }
        }
        most / 0.1
    }

    #[test]
    fn a_wave_decays_at_half_its_squared_frequency_times_the_time() {
        // Squared frequency of both masses against each other: 2 k / m = 400 1/s^2. The last period
        // begins after two whole ones, at the crest.
        let (time, t, periods) = (0.005, 0.94, 0.2 * std::f64::consts::PI);
        let found = amplitude(time, t) / amplitude(time, 0.32);
        let expected = libm::exp(-0.5 * time * 400.0 * periods);
        assert!((found / expected - 1.0).abs() <= 0.02, "{found} {expected}");
        // Control: without dampers it remains.
        let control = amplitude(0.0, t) / amplitude(0.0, 0.32);
        assert!((control - 1.0).abs() <= 0.02, "{control}");
    }
}
