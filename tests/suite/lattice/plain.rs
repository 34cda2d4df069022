//! The source's own method: a list of springs and two passes (8.3 of its digest), in double
//! precision.

use nalgebra::Vector3;
use pliant::springs::Neighbours;
use pliant::springs::lattice::{Lattice, LatticeSettings, LatticeShape, Stiffness};
use pliant::testing::internals::simd::Number;

/// One spring of a list.
pub struct Spring {
    pub ends: [usize; 2],
    pub rest: f64,
    pub stiffness: f64,
}

/// Springs between all pairs of neighbours, found by a search of all offsets of all points.
pub fn springs(shape: &LatticeShape, settings: &LatticeSettings) -> Vec<Spring> {
    let [nx, ny, _] = shape.points;
    let number = |[i, j, k]: [usize; 3]| (k * ny + j) * nx + i;
    let farthest = match settings.neighbours {
        Neighbours::Six => 1,
        Neighbours::Eighteen => 2,
        Neighbours::TwentySix => 3,
    };
    let mut all = Vec::new();
    for point in shape.each() {
        for offset in 0..27 {
            let step = [offset % 3, offset / 3 % 3, offset / 9].map(|o| o - 1);
            let away: i32 = step.iter().map(|s: &i32| s.abs()).sum();
            let other = [0, 1, 2].map(|c| point[c] as i64 + i64::from(step[c]));
            let inside = (0..3).all(|c| (0..shape.points[c] as i64).contains(&other[c]));
            if !inside || away == 0 || away > farthest {
                continue;
            }
            let other = other.map(|o| o as usize);
            if number(other) < number(point) {
                continue;
            }
            let rest = (Vector3::from(shape.at(other)) - Vector3::from(shape.at(point))).norm();
            let stiffness = match settings.stiffness {
                Stiffness::Reciprocal => 1.0 / rest,
                Stiffness::Uniform(value) => value,
            };
            let stiffness = stiffness * if away > 1 { settings.diagonal } else { 1.0 };
            all.push(Spring {
                ends: [number(point), number(other)],
                rest,
                stiffness,
            });
        }
    }
    all
}

/// Points and springs in lists.
pub struct Plain {
    pub springs: Vec<Spring>,
    pub current: Vec<Vector3<f64>>,
    pub force: Vec<Vector3<f64>>,
    pub pinned: Vec<bool>,
    previous: Vec<Vector3<f64>>,
    mass: f64,
    damping: f64,
    time_step: f64,
}

impl Plain {
    /// The state of a lattice of the suite.
    pub fn of<F: Number>(lattice: &Lattice<F>) -> Self {
        let shape = lattice.shape();
        let vectors = |of: &dyn Fn([usize; 3]) -> [f64; 3]| {
            shape
                .each()
                .map(|p| Vector3::from(of(p)))
                .collect::<Vec<_>>()
        };
        Self {
            springs: springs(shape, lattice.settings()),
            current: vectors(&|p| lattice.position(p)),
            previous: vectors(&|p| lattice.previous_position(p)),
            force: vectors(&|p| lattice.force(p)),
            pinned: shape.each().map(|p| lattice.is_pinned(p)).collect(),
            mass: lattice.settings().mass,
            damping: lattice.damping(),
            time_step: lattice.time_step(),
        }
    }

    /// (3.8) as printed, with the required sign of l.
    pub fn step(&mut self) {
        let mut force = self.force.clone();
        for Spring {
            ends: [i, j],
            rest,
            stiffness,
        } in &self.springs
        {
            let l = self.current[*i] - self.current[*j];
            let f = l * (stiffness * (l.norm() - rest) / l.norm());
            force[*i] -= f;
            force[*j] += f;
        }
        for (p, f) in force
            .into_iter()
            .enumerate()
            .filter(|(p, _)| !self.pinned[*p])
            .collect::<Vec<_>>()
        {
            let (x, before) = (self.current[p], self.previous[p]);
            let total = f - (x - before) * (self.damping / self.time_step);
            self.previous[p] = total * (self.time_step.powi(2) / self.mass) + x * 2.0 - before;
        }
        std::mem::swap(&mut self.current, &mut self.previous);
        for p in (0..self.pinned.len()).filter(|p| self.pinned[*p]) {
            self.current[p] = self.previous[p];
        }
    }
}
