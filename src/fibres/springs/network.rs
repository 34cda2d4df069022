//! Equilibrium of springs between grid points with a fixed surface.
//!
//! A spring pulls with D (l - l0), where D = 1/l0 and l0 is its length in the template at rest. If
//! all springs are in tension, there is one equilibrium. The source integrates a damped motion
//! (7.2) to reach it; the result does not depend on the path.

use nalgebra::{Matrix3, Point3, Vector3};

use super::SpringsError;
use crate::fibres::template::{Sampling, Template};
use crate::mesh::measures::max_or_nan;
use crate::rest::{End, Relax, all_within, relax};
use crate::solvers::sparse::{Factor, FactorError};
use crate::springs::Neighbours;
use crate::springs::lattice::LatticeShape;
use crate::springs::patterns;

/// Greatest number of steps of Newton's method.
const STEPS: usize = 60;
/// Greatest residual force on a point, relative to the sum of its spring forces.
const AT_REST: f64 = 1e-12;
/// Greatest number of halvings of a step.
const HALVINGS: usize = 30;

/// A spring between two points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spring {
    /// End points.
    pub ends: [u32; 2],
    /// Rest length in the template, whose cube has side 1; the stiffness is D = 1/rest.
    pub rest: f64,
}

/// The springs of a template to the six nearest neighbours of each point.
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
    let sheet = LatticeShape {
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
    /// Index of the unknown of each point; `u32::MAX` for a fixed point.
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

    /// Springs without rest length: the sum of D x over the springs is zero at each point, for each
    /// coordinate.
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

    /// D (1 - l0/l) of a spring, and its unit vector.
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

    /// Minimises by Newton's method. A compressed spring contributes no lateral stiffness, so that
    /// the system stays positive definite.
    fn newton(&self, x: &mut [Point3<f64>]) -> Result<(), SpringsError> {
        let mut descent = Descent {
            system: Factor::new(self.free.len(), &self.pairs())?,
            net: self,
            x,
            force: Vec::new(),
            left: f64::INFINITY,
            steps: 0,
        };
        match relax(&mut descent, STEPS, |_| true)? {
            End::Rest => Ok(()),
            End::Steps | End::Stopped | End::Stuck => Err(SpringsError::NotAtRest {
                steps: STEPS,
                force: descent.left,
            }),
        }
    }

    /// Forces on the unknowns, and the greatest sum of force magnitudes at one of them.
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

/// A network on its way to rest.
struct Descent<'a> {
    net: &'a Network,
    system: Factor<3>,
    x: &'a mut [Point3<f64>],
    /// Forces on the unknowns.
    force: Vec<f64>,
    /// The greatest of them over that of all springs of its point.
    left: f64,
    steps: usize,
}

impl Relax for Descent<'_> {
    type Error = FactorError;

    fn judge(&mut self) -> Result<bool, FactorError> {
        let (force, scale) = self.net.assemble(self.x, &mut self.system);
        let each = force.chunks(3);
        let sizes = each.map(|f| Vector3::new(f[0], f[1], f[2]).norm());
        self.left = max_or_nan(sizes) / scale;
        self.force = force;
        Ok(all_within([(self.left, AT_REST)]))
    }

    fn steps(&self) -> usize {
        self.steps
    }

    fn advance(&mut self) -> Result<bool, FactorError> {
        let (net, x) = (self.net, &mut *self.x);
        self.system.factorise()?;
        let mut step = self.force.clone();
        self.system.solve(&mut step, 1);
        let products = self.force.iter().zip(&step).map(|(a, b)| a * b);
        let fall: f64 = products.sum();
        let (before, start) = (net.energy(x), x.to_vec());
        let mut share = 1.0;
        for halving in 0..=HALVINGS {
            for (u, &p) in net.free.iter().enumerate() {
                let step = Vector3::new(step[3 * u], step[3 * u + 1], step[3 * u + 2]);
                x[p as usize] = start[p as usize] + step * share;
            }
            // Accepts the whole step if energies differ by rounding only.
            let enough = net.energy(x) <= before - 1e-4 * share * fall + 1e-14 * before;
            if enough || halving == HALVINGS {
                break;
            }
            share *= 0.5;
        }
        self.steps += 1;
        Ok(true)
    }
}
