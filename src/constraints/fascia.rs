//! Vertices that fascia holds to bones: C = n.(p - a) - h <= 0, a spring that acts on what lifts off.

use nalgebra::{Matrix3, Point3, Vector3};

use super::batch::{Project, Residual, Usage};
use super::potential::Potential;
use super::{Constraint, PlaneContact};
use crate::mesh::sum::NeumaierSum;
use crate::particles::{Packed, Particles};
use crate::state::{DecodeError, Reader, State, Writer};

/// Name of the effect.
pub const FASCIA: &str = "fascia";

/// Vertices each below a plane over a bone: [`PlaneContact`] from the other side, with a stiffness. The
/// normal may be shorter than one, where bones on different sides hold a vertex.
///
/// A vertex that is at most at its height is free. Above it the energy is k C^2 / 2, and a step projects
/// it as XPBD does \[macklin2016\], with a force that only pulls. Nothing acts along the plane, so
/// that a vertex slides. The planes stay where they are until [`Project::place`] or
/// [`Potential::place`] moves them.
#[derive(Clone, Debug)]
pub struct Fascia {
    ties: Vec<PlaneContact>,
    /// Stiffness of each [N/m].
    stiffness: Vec<f64>,
    /// Pull times the square of the step [N s^2].
    pulls: Vec<f64>,
}

impl Fascia {
    /// Ties with one stiffness [N/m] each; the thickness of a tie is the height at which it begins to
    /// act.
    pub fn new(ties: Vec<PlaneContact>, stiffness: Vec<f64>) -> Self {
        let pulls = vec![0.0; ties.len()];
        Self {
            ties,
            stiffness,
            pulls,
        }
    }

    /// The displacement of the vertex of tie `k` at `x` [m] with inverse mass `w` [1/kg].
    fn displacement(&mut self, k: usize, x: Point3<f64>, w: f64, dt: f64) -> Vector3<f64> {
        let (value, [normal]) = lift(&self.ties[k], x);
        let compliance = 1.0 / (self.stiffness[k] * dt * dt);
        let w_of_c = w * normal.norm_squared();
        if !(w > 0.0 && compliance.is_finite()) {
            return Vector3::zeros();
        }
        let before = self.pulls[k];
        let pull = before + (value - compliance * before) / (w_of_c + compliance);
        // Not `f64::max`, which would hide a NaN.
        let pull = if pull < 0.0 { 0.0 } else { pull };
        self.pulls[k] = pull;
        normal * ((before - pull) * w)
    }

    /// Each tie that acts, with its stiffness and its lift [m].
    fn acting<'a>(
        &'a self,
        x: &'a [Point3<f64>],
    ) -> impl Iterator<Item = (&'a PlaneContact, f64, f64)> {
        let each = self.ties.iter().zip(&self.stiffness);
        each.filter_map(|(tie, &k)| {
            let (value, _) = lift(tie, x[tie.points[0] as usize]);
            // NaN is no lift of zero.
            (!(value <= 0.0)).then_some((tie, k, value))
        })
    }

    fn move_planes(&mut self, planes: &[(Point3<f64>, Vector3<f64>)]) {
        for (tie, &(origin, normal)) in self.ties.iter_mut().zip(planes) {
            (tie.origin, tie.normal) = (origin, normal);
        }
    }
}

/// The height over that of the tie [m], with its gradient.
fn lift(tie: &PlaneContact, x: Point3<f64>) -> (f64, [Vector3<f64>; 1]) {
    tie.value_and_gradient(&[x])
        .unwrap_or((0.0, [Vector3::zeros()]))
}

/// Planes are those of the present step, and are set at its beginning.
impl State for Fascia {
    fn save(&self, _: &mut Writer) {}

    fn restore(&mut self, _: &mut Reader<'_>) -> Result<(), DecodeError> {
        Ok(())
    }
}

impl Project for Fascia {
    fn name(&self) -> &'static str {
        FASCIA
    }

    fn len(&self) -> usize {
        self.ties.len()
    }

    fn begin_step(&mut self) {
        self.pulls.fill(0.0);
    }

    fn project(&mut self, particles: &mut Particles, dt: f64) {
        for k in 0..self.ties.len() {
            let v = self.ties[k].points[0] as usize;
            let (x, w) = (particles.position[v], particles.inverse_mass[v]);
            particles.position[v] += self.displacement(k, x, w, dt);
        }
    }

    fn project_packed(&mut self, packed: &mut Packed, dt: f64) {
        for k in 0..self.ties.len() {
            let place = packed.place(self.ties[k].points[0]) as usize;
            let [x, y, z, w] = packed.slots[place].0;
            let by = self.displacement(k, Point3::new(x, y, z), w, dt);
            packed.slots[place].0 = [x + by.x, y + by.y, z + by.z, w];
        }
    }

    /// Of the ties that pull.
    fn residual(&self, particles: &Particles, dt: f64) -> Residual {
        let (mut squares, mut max, mut count) = (NeumaierSum::default(), 0.0_f64, 0);
        for k in 0..self.ties.len() {
            let Some(off) = self.off(k, particles, dt) else {
                continue;
            };
            squares.add(off * off);
            max = crate::mesh::measures::max_or_nan([max, off]);
            count += 1;
        }
        Residual {
            rms: (squares.total() / count.max(1) as f64).sqrt(),
            max,
            count,
        }
    }

    fn residual_at(&self, particles: &Particles, dt: f64, particle: u32) -> Option<f64> {
        let k = self.ties.iter().position(|tie| tie.points[0] == particle)?;
        self.off(k, particles, dt)
    }

    fn usage(&self) -> Usage {
        let each = size_of::<PlaneContact>() + 2 * size_of::<f64>();
        Usage {
            bytes: self.ties.capacity() * each,
            ..Usage::default()
        }
    }

    fn place(&mut self, planes: &[(Point3<f64>, Vector3<f64>)]) {
        self.move_planes(planes);
    }
}

impl Fascia {
    /// Distance of a tie that pulls from satisfaction [m].
    fn off(&self, k: usize, particles: &Particles, dt: f64) -> Option<f64> {
        let v = self.ties[k].points[0] as usize;
        let (value, _) = lift(&self.ties[k], particles.position[v]);
        let off = (value - self.pulls[k] / (self.stiffness[k] * dt * dt)).abs();
        (particles.inverse_mass[v] > 0.0 && self.pulls[k] > 0.0).then_some(off)
    }
}

impl Potential for Fascia {
    fn name(&self) -> &'static str {
        FASCIA
    }

    fn energy(&self, x: &[Point3<f64>]) -> f64 {
        let mut sum = NeumaierSum::default();
        self.acting(x)
            .for_each(|(_, k, lift)| sum.add(0.5 * k * lift * lift));
        sum.total()
    }

    fn energy_and_gradient(&self, x: &[Point3<f64>], gradient: &mut [Vector3<f64>]) -> f64 {
        for (tie, k, lift) in self.acting(x) {
            gradient[tie.points[0] as usize] += tie.normal * (k * lift);
        }
        self.energy(x)
    }

    fn pairs(&self, _: &mut dyn FnMut(u32, u32)) {}

    fn hessian(&self, x: &[Point3<f64>], _: bool, add: &mut dyn FnMut(u32, u32, &Matrix3<f64>)) {
        for (tie, k, _) in self.acting(x) {
            let v = tie.points[0];
            add(v, v, &(tie.normal * tie.normal.transpose() * k));
        }
    }

    fn scalar_hessian(&self, x: &[Point3<f64>], add: &mut dyn FnMut(u32, u32, f64)) {
        for (tie, k, _) in self.acting(x) {
            add(tie.points[0], tie.points[0], k * tie.normal.norm_squared());
        }
    }

    fn place(&mut self, planes: &[(Point3<f64>, Vector3<f64>)]) {
        self.move_planes(planes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const K: f64 = 50.0;

    /// Three vertices with a tie each: at its height, below it, and above it.
    fn drawn() -> (Fascia, Vec<Point3<f64>>) {
        let normal = Vector3::new(1.0, -2.0, 2.0) / 3.0;
        let origin = Point3::new(0.1, 0.2, -0.3);
        let tie = |v: u32| PlaneContact {
            points: [v],
            origin,
            normal,
            thickness: 0.01,
        };
        let across = Vector3::new(2.0, 1.0, 0.0);
        let at = |height: f64| origin + normal * height + across * (0.3 + height);
        let x = vec![at(0.01), at(-0.2), at(0.05)];
        (Fascia::new((0..3).map(tie).collect(), vec![K; 3]), x)
    }

    #[test]
    fn the_derivatives_are_those_of_the_energy() {
        let (part, x) = drawn();
        let mut gradient = vec![Vector3::zeros(); 3];
        let energy = part.energy_and_gradient(&x, &mut gradient);
        assert!(
            (energy - 0.5 * K * 0.04_f64.powi(2)).abs() <= 1e-15,
            "{energy}"
        );
        // The energy is quadratic where one tie acts: differences are exact for any step.
        let h = 1e-3;
        for c in 0..3 {
            let slope = |v: usize| {
                let (mut up, mut down) = (x.clone(), x.clone());
                up[v][c] += h;
                down[v][c] -= h;
                (part.energy(&up) - part.energy(&down)) / (2.0 * h)
            };
            assert!((slope(2) - gradient[2][c]).abs() <= 1e-12, "{c}");
            assert_eq!(gradient[1][c], 0.0, "below its height a vertex is free");
        }
        let mut blocks = 0;
        part.hessian(&x, false, &mut |v, w, block| {
            blocks += 1;
            assert_eq!((v, w), (2, 2));
            let along = block * Vector3::new(2.0, 1.0, 0.0);
            assert!(along.norm() <= 1e-13, "no force along the plane");
            assert!((block.trace() - K).abs() <= 1e-13);
        });
        assert_eq!(blocks, 1);
    }

    #[test]
    fn a_step_is_that_of_implicit_euler_for_any_number_of_sweeps() {
        let (part, x) = drawn();
        for sweeps in [1, 2, 7] {
            let mut part = part.clone();
            let mut particles = Particles::at_rest(x.clone(), vec![2.0; 3]);
            part.begin_step();
            (0..sweeps).for_each(|_| part.project(&mut particles, 0.1));
            // m (z - 0.04) / dt^2 = -k z.
            let exact = 0.04 / (1.0 + K * 2.0 * 0.01);
            let (left, _) = lift(&part.ties[2], particles.position[2]);
            assert!((left - exact).abs() <= 1e-16, "{left} {exact}");
            // Control: what is not lifted stays to the last bit.
            assert_eq!(particles.position[1], x[1]);
            let residual = part.residual(&particles, 0.1);
            assert!(residual.count == 1 && residual.max <= 1e-16, "{residual:?}");
        }
    }

    #[test]
    fn what_is_held_stays() {
        let (mut part, x) = drawn();
        let mut particles = Particles::at_rest(x.clone(), vec![0.0; 3]);
        part.project(&mut particles, 0.1);
        assert_eq!(particles.position, x);
    }
}
