//! Several bodies with contact, and their common time step.

use std::sync::Arc;

use nalgebra::Vector3;

use super::body::CollidingBody;
use super::finding::{Contact, find};
use super::impulse::{ContactPart, Response, impulse};
use crate::contact::Obstacle;
use crate::mesh::measures::max_or_nan;
use crate::springs::integrators::{SemiImplicitEuler, StepError};
use crate::springs::stability;

/// Several bodies with contact between them and with fixed obstacles.
///
/// A step computes forces, velocities, impulses, positions. An impulse acts in its own step,
/// because positions move with the new velocities (errata B05). Contacts are found at the beginning
/// of the step, so bodies overlap by their approach in one step; thinner bodies can be passed
/// through.
pub struct Bodies {
    /// The bodies.
    pub bodies: Vec<CollidingBody>,
    /// Fixed obstacles in space. Vertices of soft bodies stay out of them.
    pub obstacles: Vec<Arc<dyn Obstacle>>,
    /// Restitution and friction of all contacts.
    pub response: Response,
    /// The integrator of the two halves of the step.
    pub integrator: SemiImplicitEuler,
    /// Greatest number of rounds over all contacts in a step: each corrects the remainder of the
    /// others.
    pub sweeps: usize,
    /// Share of the depth by which a penetrating vertex is moved out in each step, without a
    /// velocity, 0 to 1. Impulses alone do not remove penetration.
    pub put_out: f64,
}

/// Contacts of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepContacts {
    /// Number of edges that cross triangles.
    pub crossings: usize,
    /// Number of vertices inside.
    pub inside: usize,
    /// Greatest depth [m].
    pub depth: f64,
    /// Number of impulses.
    pub impulses: usize,
    /// Greatest remaining speed of approach at a contact [m/s].
    pub approach: f64,
}

impl Bodies {
    /// Bodies without bounce or friction.
    pub fn new(bodies: Vec<CollidingBody>) -> Self {
        Self {
            bodies,
            obstacles: Vec::new(),
            response: Response::default(),
            integrator: SemiImplicitEuler::default(),
            sweeps: 8,
            put_out: 0.2,
        }
    }

    /// The longest stable step of all bodies [s], at their present shapes. Contact by impulses does
    /// not shorten it.
    pub fn limit(&self) -> f64 {
        let each =
            |b: &CollidingBody| stability::limit(&self.integrator, &stability::stiffest(&b.system));
        self.bodies.iter().map(each).fold(f64::INFINITY, f64::min)
    }

    /// Advances all bodies by `dt` [s].
    ///
    /// # Errors
    /// Numbers that are not finite; the bodies are then in the state of the failed step. Invalid
    /// numbers of one body do not reach the others.
    pub fn step(&mut self, dt: f64) -> Result<StepContacts, StepError> {
        self.check(dt)?;
        for body in &mut self.bodies {
            body.begin_step();
            self.integrator.velocities(&mut body.system, dt);
        }
        // This check comes first: a point without a finite position touches nothing.
        self.check(dt)?;
        self.bodies.iter_mut().for_each(CollidingBody::bound);
        let contacts = find(&mut self.bodies, &self.obstacles);
        let inside = contacts.iter().filter(|t| t.depth > 0.0).count();
        let summary = StepContacts {
            inside,
            crossings: contacts.len() - inside,
            depth: max_or_nan(contacts.iter().map(|t| t.depth)),
            impulses: self.respond(&contacts),
            approach: max_or_nan(
                contacts
                    .iter()
                    .map(|t| -self.approach(t))
                    .filter(|a| !(*a <= 0.0)),
            ),
        };
        for body in &mut self.bodies {
            self.integrator.positions(&mut body.system, dt)?;
            body.carry(dt);
        }
        if inside > 0 {
            self.put_out(&contacts);
        }
        self.check(dt)?;
        Ok(summary)
    }

    fn check(&self, dt: f64) -> Result<(), StepError> {
        let first = self.bodies.iter().find_map(|b| b.system.first_non_finite());
        first.map_or(Ok(()), |point| Err(StepError::NotFinite { point, dt }))
    }

    /// The two sides of a contact, with the velocities or moves that `of` returns for the points of
    /// a body.
    fn parts<'a>(
        &'a self,
        t: &Contact,
        of: impl Fn(usize) -> &'a [Vector3<f64>],
    ) -> (ContactPart<2>, ContactPart<3>) {
        let (one, zero) = (&self.bodies[t.first], Vector3::zeros());
        let first = ContactPart {
            weights: t.end_weights,
            inverse_mass: t.ends.map(|v| one.inverse_mass(v)),
            velocity: t.ends.map(|v| of(t.first)[v as usize]),
        };
        let mut second = ContactPart {
            weights: t.corner_weights,
            inverse_mass: [0.0; 3],
            velocity: [zero; 3],
        };
        if let Some(two) = t.second {
            second.inverse_mass = t.corners.map(|v| self.bodies[two].inverse_mass(v));
            second.velocity = t.corners.map(|v| of(two)[v as usize]);
        }
        (first, second)
    }

    fn moving(&self, t: &Contact) -> (ContactPart<2>, ContactPart<3>) {
        self.parts(t, |body| &self.bodies[body].system.velocity)
    }

    /// Separation speed of the two sides [m/s]; negative for an approach.
    fn approach(&self, t: &Contact) -> f64 {
        let (first, second) = self.moving(t);
        (second.at() - first.at()).dot(&t.normal)
    }

    /// Applies impulses in turn, until nothing approaches or the rounds end. Returns the number of
    /// impulses. Each is a separate collision that does not increase the energy.
    fn respond(&mut self, contacts: &[Contact]) -> usize {
        let mut given = 0;
        for _ in 0..self.sweeps {
            let before = given;
            for t in contacts {
                let (first, second) = self.moving(t);
                let Some(j) = impulse(&t.normal, &first, &second, self.response) else {
                    continue;
                };
                given += 1;
                add(
                    &mut self.bodies[t.first].system.velocity,
                    &t.ends,
                    &first,
                    -j,
                );
                if let Some(second_body) = t.second {
                    add(
                        &mut self.bodies[second_body].system.velocity,
                        &t.corners,
                        &second,
                        j,
                    );
                }
            }
            if given == before {
                break;
            }
        }
        given
    }

    /// Moves the two sides of a penetration apart by a share of the depth, the lighter one more;
    /// the centre of mass stays. Moves by earlier contacts count: a hundred vertices in one
    /// triangle move it as far as one does.
    fn put_out(&mut self, contacts: &[Contact]) {
        let mut moves: Vec<Vec<Vector3<f64>>> = self
            .bodies
            .iter()
            .map(|b| vec![Vector3::zeros(); b.system.len()])
            .collect();
        for t in contacts.iter().filter(|t| t.depth > 0.0) {
            let (first, second) = self.parts(t, |body| &moves[body]);
            let mobility = first.mobility() + second.mobility();
            let left = self.put_out * t.depth - (second.at() - first.at()).dot(&t.normal);
            if mobility > 0.0 && left > 0.0 {
                let by = t.normal * (left / mobility);
                add(&mut moves[t.first], &t.ends, &first, -by);
                t.second
                    .into_iter()
                    .for_each(|body| add(&mut moves[body], &t.corners, &second, by));
            }
        }
        for (body, moves) in self.bodies.iter_mut().zip(&moves) {
            body.system
                .position
                .iter_mut()
                .zip(moves)
                .for_each(|(x, by)| *x += by);
        }
    }
}

/// Adds the effect of an impulse to the points of a body. It adds, since a vertex represents both
/// ends of an edge.
fn add<const N: usize>(
    to: &mut [Vector3<f64>],
    points: &[u32; N],
    part: &ContactPart<N>,
    impulse: Vector3<f64>,
) {
    for ((&point, weight), inverse_mass) in points.iter().zip(&part.weights).zip(&part.inverse_mass)
    {
        to[point as usize] += impulse * (weight * inverse_mass);
    }
}
