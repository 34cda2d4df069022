//! Springs between points of a grid at rest, the surface held.
//!
//! A spring pulls with D (l - l0), D = 1/l0, l0 its length in the template at rest. Where all springs are pulled there is one
//! state of rest; the way there, which the source goes in time, damped by (7.2), does not matter for it.

use nalgebra::{Matrix3, Point3, Vector3};

use super::SpringsError;
use crate::fibres::template::{Sampling, Template};
use crate::mesh::measures::max_or_nan;
use crate::solvers::sparse::Factor;
use crate::springs::Neighbours;
use crate::springs::lattice::Shape;
use crate::springs::patterns;

/// Steps of Newton's method at most.
const STEPS: usize = 60;
/// Force left on a point over that of all its springs.
const AT_REST: f64 = 1e-12;
/// Times a step is halved at most.
const HALVINGS: usize = 30;

/// A spring between two points: its rest length in a template of side 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spring {
    /// Its ends.
    pub ends: [u32; 2],
    /// Rest length in the template, whose cube has side 1; D is 1 over it.
    pub rest: f64,
}

/// The springs of a template to the six nearest neighbours.
pub fn springs(sampling: &Sampling, template: Template) -> Vec<Spring> {
    let x = sampling.positions(template);
    let pairs = patterns::lattice(&sampling.shape(), Neighbours::Six);
    pairs
        .map(|ends| Spring {
            ends,
            rest: (x[ends[0] as usize] - x[ends[1] as usize]).norm(),
        })
        .collect()
}

/// Brings the inner points to rest, for a template of side `side` \[m\]; points on the surface stay.
///
/// # Errors
/// Newton's method does not come to rest, for springs are pressed, or the system cannot be factored.
pub fn rest(
    sampling: &Sampling,
    template: Template,
    side: f64,
    positions: &mut [Point3<f64>],
) -> Result<(), SpringsError> {
    let held = sampling.on_surface();
    let mut unknown = vec![u32::MAX; held.len()];
    let free: Vec<u32> = (0..held.len() as u32)
        .filter(|&p| !held[p as usize])
        .collect();
    free.iter()
        .enumerate()
        .for_each(|(u, &p)| unknown[p as usize] = u as u32);
    if free.is_empty() {
        return Ok(());
    }
    let net = Network {
        springs: springs(sampling, template),
        unknown,
        free,
        side,
    };
    net.linear(positions)?;
    if side > 0.0 {
        net.newton(positions)
    } else {
        Ok(())
    }
}

/// Brings the points within one layer to rest between springs to their four neighbours on it; those on its sides stay.
///
/// # Errors
/// The system cannot be factored.
pub fn face(
    sampling: &Sampling,
    layer: usize,
    positions: &mut [Point3<f64>],
) -> Result<(), SpringsError> {
    let [nr, ns, _] = sampling.points;
    let held: Vec<bool> = (0..ns)
        .flat_map(|j| (0..nr).map(move |i| i == 0 || j == 0 || i + 1 == nr || j + 1 == ns))
        .collect();
    let free: Vec<u32> = (0..held.len() as u32)
        .filter(|&p| !held[p as usize])
        .collect();
    if free.is_empty() {
        return Ok(());
    }
    let mut unknown = vec![u32::MAX; held.len()];
    free.iter()
        .enumerate()
        .for_each(|(u, &p)| unknown[p as usize] = u as u32);
    let sheet = Shape {
        points: [nr, ns, 1],
        origin: [0.0; 3],
        spacing: [1.0; 3],
    };
    let springs = patterns::lattice(&sheet, Neighbours::Six)
        .map(|ends| Spring { ends, rest: 1.0 })
        .collect();
    let first = sampling.number([0, 0, layer]);
    Network {
        springs,
        unknown,
        free,
        side: 0.0,
    }
    .linear(&mut positions[first..first + nr * ns])
}

struct Network {
    springs: Vec<Spring>,
    /// Of each point; `u32::MAX` where it is held.
    unknown: Vec<u32>,
    free: Vec<u32>,
    side: f64,
}

impl Network {
    /// Pairs of unknowns with a spring between them.
    fn pairs(&self) -> Vec<[u32; 2]> {
        let of = |s: &Spring| s.ends.map(|p| self.unknown[p as usize]);
        self.springs
            .iter()
            .map(of)
            .filter(|u| u.iter().all(|u| *u != u32::MAX))
            .collect()
    }

    /// Springs without rest length: D x summed over springs is zero at each point, coordinate by coordinate.
    fn linear(&self, x: &mut [Point3<f64>]) -> Result<(), SpringsError> {
        let count = self.free.len();
        let mut system = Factor::<1>::new(count, &self.pairs())?;
        let mut right = vec![0.0; 3 * count];
        for spring in &self.springs {
            let d = 1.0 / spring.rest;
            let [a, b] = spring.ends;
            let [i, j] = spring.ends.map(|p| self.unknown[p as usize]);
            for (own, other, end) in [(i, j, b), (j, i, a)] {
                if own == u32::MAX {
                    continue;
                }
                system.add_diagonal(own, d);
                if other == u32::MAX {
                    (0..3).for_each(|c| right[c * count + own as usize] += d * x[end as usize][c]);
                }
            }
            if i != u32::MAX && j != u32::MAX {
                system.add(i.max(j), i.min(j), &[[-d]]);
            }
        }
        system.factorise()?;
        system.solve(&mut right, 3);
        for (u, &p) in self.free.iter().enumerate() {
            x[p as usize] = Point3::new(right[u], right[count + u], right[2 * count + u]);
        }
        Ok(())
    }

    /// D (1 - l0/l) of a spring, and the unit vector along it.
    fn pull(&self, spring: &Spring, x: &[Point3<f64>]) -> (Vector3<f64>, f64, f64) {
        let way = x[spring.ends[1] as usize] - x[spring.ends[0] as usize];
        let length = way.norm();
        let along = way.try_normalize(0.0).unwrap_or_else(Vector3::zeros);
        let ratio = if length > 0.0 {
            self.side * spring.rest / length
        } else {
            0.0
        };
        (along, length, (1.0 - ratio) / spring.rest)
    }

    fn energy(&self, x: &[Point3<f64>]) -> f64 {
        let of = |s: &Spring| {
            let (_, length, _) = self.pull(s, x);
            0.5 / s.rest * (length - self.side * s.rest).powi(2)
        };
        self.springs.iter().map(of).sum()
    }

    /// Downhill by Newton's method; springs that are pressed count sideways as if they were not, so that the system stays
    /// positive definite.
    fn newton(&self, x: &mut [Point3<f64>]) -> Result<(), SpringsError> {
        let count = self.free.len();
        let mut system = Factor::<3>::new(count, &self.pairs())?;
        let mut left = f64::INFINITY;
        for _ in 0..STEPS {
            let (mut force, scale) = self.assemble(x, &mut system);
            left = max_or_nan(
                force
                    .chunks(3)
                    .map(|f| Vector3::new(f[0], f[1], f[2]).norm()),
            ) / scale;
            if left <= AT_REST {
                return Ok(());
            }
            system.factorise()?;
            let slope: Vec<f64> = force.clone();
            system.solve(&mut force, 1);
            let fall: f64 = slope.iter().zip(&force).map(|(a, b)| a * b).sum();
            let (before, start) = (self.energy(x), x.to_vec());
            let mut share = 1.0;
            for halving in 0..=HALVINGS {
                for (u, &p) in self.free.iter().enumerate() {
                    let step = Vector3::new(force[3 * u], force[3 * u + 1], force[3 * u + 2]);
                    x[p as usize] = start[p as usize] + step * share;
                }
                // Where energies differ by rounding only, the whole step is taken.
                let enough = self.energy(x) <= before - 1e-4 * share * fall + 1e-14 * before;
                if enough || halving == HALVINGS {
                    break;
                }
                share *= 0.5;
            }
        }
        Err(SpringsError::NotAtRest {
            steps: STEPS,
            force: left,
        })
    }

    /// Forces on the unknowns, and the greatest sum of sizes of forces at one of them.
    fn assemble(&self, x: &[Point3<f64>], system: &mut Factor<3>) -> (Vec<f64>, f64) {
        system.clear();
        let mut force = vec![0.0; 3 * self.free.len()];
        let mut sizes = vec![0.0; self.free.len()];
        for spring in &self.springs {
            let (along, length, pull) = self.pull(spring, x);
            let stiff = along * along.transpose();
            let block = stiff / spring.rest + (Matrix3::identity() - stiff) * pull.max(0.0);
            let columns: [[f64; 3]; 3] =
                std::array::from_fn(|c| std::array::from_fn(|r| block[(r, c)]));
            let [i, j] = spring.ends.map(|p| self.unknown[p as usize]);
            for (own, sign) in [(i, 1.0), (j, -1.0)] {
                if own == u32::MAX {
                    continue;
                }
                system.add(own, own, &columns);
                sizes[own as usize] += length / spring.rest;
                (0..3).for_each(|c| force[3 * own as usize + c] += sign * pull * length * along[c]);
            }
            if i != u32::MAX && j != u32::MAX {
                system.add(i.max(j), i.min(j), &columns.map(|c| c.map(|v| -v)));
            }
        }
        (force, max_or_nan(sizes))
    }
}
