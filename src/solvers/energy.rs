//! The potential energy of a body: elastic parts, constant forces, and the inertia of an implicit
//! step.

use std::ops::Range;

use nalgebra::{Matrix3, Point3, Vector3};

use super::press::Press;
use crate::constraints::EnclosedVolume;
use crate::constraints::potential::{Potential, volume_hessian};
use crate::mesh::measures::max_or_nan;
use crate::mesh::sum::tree_sum_by;
use crate::state::{DecodeError, Reader, State, Writer};

/// The energy sum m |x - y|^2 / (2 dt^2); with it a minimum is an implicit Euler step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Inertia {
    /// m / dt^2 [kg/s^2], shape `[count]`.
    pub weight: Vec<f64>,
    /// Where the velocity of each vertex takes it [m], shape `[count]`.
    pub target: Vec<Point3<f64>>,
}

/// The energy of a body as a function of its positions; enclosed volumes are separate, as
/// constraints.
///
/// The multiplier `pressure` [Pa] of a volume adds -pressure dV/dx to the gradient. With a
/// compliance `a` it is (target - V) / a.
#[derive(Default)]
pub struct Energy {
    /// Elastic parts.
    pub elastic: Vec<Box<dyn Potential>>,
    /// Elastic parts of several bodies, each over vertices of its own.
    pub members: Vec<Member>,
    /// Constant forces [N], shape `[count]`; empty for none.
    pub forces: Vec<Vector3<f64>>,
    /// Inertia of an implicit step; `None` at rest.
    pub inertia: Option<Inertia>,
    /// Enclosed volumes.
    pub volumes: Vec<EnclosedVolume>,
    /// Compliant obstacles; `None` without obstacles, or with rigid ones.
    pub press: Option<Press>,
}

/// Elastic parts of one of several bodies.
pub struct Member {
    /// Its vertices among those of all bodies.
    pub range: Range<usize>,
    /// Its elastic parts, in numbers of its own.
    pub elastic: Vec<Box<dyn Potential>>,
}

impl Potential for Member {
    fn name(&self) -> &'static str {
        "member"
    }

    fn energy(&self, x: &[Point3<f64>]) -> f64 {
        let own = &x[self.range.clone()];
        self.elastic.iter().map(|part| part.energy(own)).sum()
    }

    fn energy_and_gradient(&self, x: &[Point3<f64>], gradient: &mut [Vector3<f64>]) -> f64 {
        let (own, slopes) = (&x[self.range.clone()], &mut gradient[self.range.clone()]);
        let parts = self.elastic.iter();
        parts
            .map(|part| part.energy_and_gradient(own, slopes))
            .sum()
    }

    fn pairs(&self, pair: &mut dyn FnMut(u32, u32)) {
        let first = self.range.start as u32;
        let shifted = &mut |a: u32, b: u32| pair(a + first, b + first);
        self.elastic.iter().for_each(|part| part.pairs(shifted));
    }

    fn hessian(
        &self,
        x: &[Point3<f64>],
        convex: bool,
        add: &mut dyn FnMut(u32, u32, &Matrix3<f64>),
    ) {
        let (own, first) = (&x[self.range.clone()], self.range.start as u32);
        let shifted = &mut |a: u32, b: u32, block: &Matrix3<f64>| add(a + first, b + first, block);
        let parts = self.elastic.iter();
        parts.for_each(|part| part.hessian(own, convex, shifted));
    }

    fn scalar_hessian(&self, x: &[Point3<f64>], add: &mut dyn FnMut(u32, u32, f64)) {
        let (own, first) = (&x[self.range.clone()], self.range.start as u32);
        let shifted = &mut |a: u32, b: u32, entry: f64| add(a + first, b + first, entry);
        let parts = self.elastic.iter();
        parts.for_each(|part| part.scalar_hessian(own, shifted));
    }

    fn force_scale(&self, x: &[Point3<f64>]) -> f64 {
        let own = &x[self.range.clone()];
        max_or_nan(self.elastic.iter().map(|part| part.force_scale(own)))
    }
}

impl Energy {
    /// The elastic parts, then compliant obstacles.
    fn parts(&self) -> impl Iterator<Item = &dyn Potential> {
        let elastic = self.elastic.iter().map(|part| &**part);
        let members = self.members.iter().map(|member| member as &dyn Potential);
        let press = self.press.iter().map(|press| press as &dyn Potential);
        elastic.chain(members).chain(press)
    }

    /// Energy [J] at positions `x` [m], without that of volumes.
    pub fn value(&self, x: &[Point3<f64>]) -> f64 {
        self.parts().map(|part| part.energy(x)).sum::<f64>() + self.of_loads(x)
    }

    /// Energy [J] without that of volumes; writes its gradient [N].
    pub fn value_and_gradient(&self, x: &[Point3<f64>], gradient: &mut [Vector3<f64>]) -> f64 {
        gradient.fill(Vector3::zeros());
        let elastic = self.elastic.iter().map(|part| &**part);
        let members = self.members.iter().map(|member| member as &dyn Potential);
        let elastic: f64 = elastic
            .chain(members)
            .map(|part| part.energy_and_gradient(x, gradient))
            .sum();
        gradient
            .iter_mut()
            .zip(&self.forces)
            .for_each(|(g, f)| *g -= f);
        if let Some(inertia) = &self.inertia {
            let each = gradient
                .iter_mut()
                .zip(x)
                .zip(inertia.target.iter().zip(&inertia.weight));
            each.for_each(|((g, x), (target, weight))| *g += (x - target) * *weight);
        }
        let pressed = self
            .press
            .as_ref()
            .map_or(0.0, |press| press.energy_and_gradient(x, gradient));
        elastic + pressed + self.of_loads(x)
    }

    /// Absolute value of the sum of the negative terms of the energy [J]: the work of the constant
    /// forces.
    pub fn negative_terms(&self, x: &[Point3<f64>]) -> f64 {
        tree_sum_by(self.forces.len(), |i| {
            self.forces[i].dot(&x[i].coords).max(0.0)
        })
    }

    fn of_loads(&self, x: &[Point3<f64>]) -> f64 {
        let moving = self.inertia.as_ref().map_or(0.0, |inertia| {
            let square = |i: usize| inertia.weight[i] * (x[i] - inertia.target[i]).norm_squared();
            0.5 * tree_sum_by(inertia.weight.len(), square)
        });
        moving - tree_sum_by(self.forces.len(), |i| self.forces[i].dot(&x[i].coords))
    }

    /// Calls `pair` with every two vertices that the second derivative couples; for volumes, with
    /// the ends of their edges.
    pub fn pairs(&self, pair: &mut dyn FnMut(u32, u32)) {
        self.parts().for_each(|part| part.pairs(pair));
        for [a, b, c] in self.volumes.iter().flat_map(EnclosedVolume::triangles) {
            pair(*a, *b);
            pair(*b, *c);
            pair(*c, *a);
        }
    }

    /// Calls `pair` with every two vertices that an elastic part couples.
    pub fn elastic_pairs(&self, pair: &mut dyn FnMut(u32, u32)) {
        self.elastic.iter().for_each(|part| part.pairs(pair));
        self.members.iter().for_each(|member| member.pairs(pair));
    }

    /// Calls `add` with the blocks of the second derivative [N/m] of energy and -p V for each of
    /// `pressures` p. With `convex`, parts that can be indefinite are left out.
    pub fn hessian(
        &self,
        x: &[Point3<f64>],
        pressures: &[f64],
        convex: bool,
        add: &mut dyn FnMut(u32, u32, &Matrix3<f64>),
    ) {
        self.parts().for_each(|part| part.hessian(x, convex, add));
        if let Some(inertia) = &self.inertia {
            let each = inertia.weight.iter().enumerate();
            each.for_each(|(i, w)| add(i as u32, i as u32, &Matrix3::from_diagonal_element(*w)));
        }
        let each = self
            .volumes
            .iter()
            .zip(pressures)
            .filter(|(_, pressure)| !convex && **pressure != 0.0);
        each.for_each(|(volume, pressure)| volume_hessian(volume, x, -pressure, add));
    }

    /// Calls `add` with the entries [N/m] of a constant positive semi-definite matrix over
    /// vertices. The matrix approximates the second derivative near `x`, equally in all directions
    /// of space.
    pub fn scalar_hessian(&self, x: &[Point3<f64>], add: &mut dyn FnMut(u32, u32, f64)) {
        self.parts().for_each(|part| part.scalar_hessian(x, add));
        if let Some(inertia) = &self.inertia {
            inertia
                .weight
                .iter()
                .enumerate()
                .for_each(|(i, w)| add(i as u32, i as u32, *w));
        }
    }

    /// A force [N] to judge forces on a vertex by: that of a strain of one. Where nothing is elastic, the
    /// greatest constant force.
    pub fn force_scale(&self, x: &[Point3<f64>]) -> f64 {
        let strained = max_or_nan(self.parts().map(|part| part.force_scale(x)));
        match strained == 0.0 {
            true => max_or_nan(self.forces.iter().map(Vector3::norm)),
            false => strained,
        }
    }

    /// Lets constraints that are known up to a period take note of where they are.
    pub fn remember(&mut self, x: &[Point3<f64>]) {
        let memories = self.elastic.iter_mut().filter_map(|part| part.memory_mut());
        memories.for_each(|memory| memory.remember(x));
        for Member { range, elastic } in &mut self.members {
            let memories = elastic.iter_mut().filter_map(|part| part.memory_mut());
            memories.for_each(|memory| memory.remember(&x[range.clone()]));
        }
    }
}

impl State for Energy {
    fn save(&self, to: &mut Writer) {
        // Every step sets the target of the inertia and the contacts; multipliers of volumes are
        // not used here.
        let Self {
            elastic,
            // Their bodies save them.
            members: _,
            forces: _,
            inertia: _,
            volumes: _,
            press: _,
        } = self;
        let memories = elastic.iter().filter_map(|part| part.memory());
        memories.for_each(|memory| memory.save(to));
    }

    fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), DecodeError> {
        let mut memories = self.elastic.iter_mut().filter_map(|part| part.memory_mut());
        memories.try_for_each(|memory| memory.restore(from))
    }
}
