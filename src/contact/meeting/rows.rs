//! Pairs that are pushed apart to their distance, with friction.

use nalgebra::{Point3, Vector3};

use super::super::gap::{Gap, Parts, difference, gap};
use super::super::rounded::leant;
use super::lists::{AHEAD, Pair};
use super::{Key, Meeting, StepMotions};

/// Greatest number of sweeps over all rows of a step, and the greatest correction of the last sweep
/// relative to the thickness.
const SWEEPS: usize = 12;
pub(super) const NEARLY: f64 = 0.02;

/// Two edges at a smaller sine of their angle are parallel: the direction between them is then one of many.
const PARALLEL: f64 = 1e-2;

/// Weights, inverse masses and velocities of the corners of a pair.
type Corners = ([f64; 4], [f64; 4], [Vector3<f64>; 4]);

/// A pair that is pushed apart in this step: C = n.(sum w x) + offset - distance >= 0.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row {
    pub parts: Parts,
    pub corners: [u32; 4],
    weights: [f64; 4],
    pub normal: Vector3<f64>,
    /// What the gap at the start of the step is greater than its height along the normal [m].
    offset: f64,
    distance: f64,
    /// Sum of the corrections in this step [m].
    push: f64,
}

impl Meeting {
    /// Pushes apart all pairs that are nearer than their distance, in a step to the given positions
    /// of each soft surface [m], with [`Self::motions`] of each if they are known.
    pub fn respond(
        &mut self,
        bodies: &mut [&mut [Point3<f64>]],
        motions: Option<Vec<StepMotions>>,
    ) {
        let is_cut = self.set_end(bodies, motions);
        self.find_rows();
        for _ in 0..SWEEPS {
            let mut largest = 0.0_f64;
            for row in &mut self.rows {
                let most = row.distance.max(NEARLY * self.settings.thickness);
                let by = row.push(&mut self.end, &self.mass, most, self.slack);
                largest = largest.max(by);
            }
            if largest <= NEARLY * self.settings.thickness {
                break;
            }
        }
        if is_cut || !self.rows.is_empty() {
            self.give_end(bodies);
        }
    }

    /// Looks at every pair that comes nearer than its distance. Its closest points are those at the
    /// start of the step, where no pair crosses, so that the normal cannot point the wrong way.
    fn find_rows(&mut self) {
        let slack = self.slack;
        let mut found = self.look(|bucket, moved, [start, end], found| {
            bucket.nearer((AHEAD * moved.step, true), moved, start, |pair, least| {
                let distance = pair.distance;
                if least >= distance + moved.step {
                    return least;
                }
                let Some(gap) = gap(pair.parts, &pair.of(start)) else {
                    return least;
                };
                pair.normal = gap.normal;
                let row = Row::new(pair, &gap);
                let is_near = gap.height < distance;
                // A vertex at the end of an edge has a pair of its own.
                let is_own = pair.parts.first() == 1 || gap.inner;
                let is_pushed = is_own && !(row.height(end) >= distance - slack);
                if is_near || is_pushed {
                    found.push((row, is_near, is_pushed));
                }
                0.999 * gap.height
            });
        });
        self.certificate.pairs += found.iter().filter(|(_, is_near, _)| *is_near).count() as u64;
        let before = &self.rows;
        found.retain(|(row, _, is_pushed)| {
            *is_pushed && before.binary_search_by_key(&row.key(), Row::key).is_err()
        });
        if !found.is_empty() {
            let found: Vec<Row> = found
                .into_iter()
                .map(|(row, ..)| self.turned(row))
                .collect();
            self.rows.extend(found);
            self.rows.sort_unstable_by_key(Row::key);
        }
    }

    /// Adds what the volume of soft surface `member` would have moved each of its vertices against
    /// [`Self::blocked`] [m] to the load of the pairs that block it, by their share in its corrections.
    pub fn bear(&mut self, member: usize, withheld: impl Fn(u32) -> Vector3<f64>) {
        // Nothing but friction needs the load.
        if !(self.settings.friction > 0.0) {
            return;
        }
        let mut blocked = Vec::new();
        for (at, row) in self.rows.iter().enumerate() {
            let by = row.correction(&self.mass);
            for (k, away) in row.blocked(&self.mass).filter(|_| row.is_pushed()) {
                if let Some(v) = self.members[member].local(row.corners[k]) {
                    blocked.push((v, by[k], away, at, row.weights[k].abs() * row.push));
                }
            }
        }
        let mut moved = vec![0.0; self.members[member].count];
        blocked
            .iter()
            .for_each(|(v, by, ..)| moved[*v as usize] += by);
        for (v, _, away, at, push) in blocked {
            let load = (-withheld(v).dot(&away)).max(0.0);
            if load > 0.0 {
                self.rows[at].push += load * push / moved[v as usize];
            }
        }
    }

    /// Number of pairs that were pushed apart in this step.
    pub fn pushed(&self) -> usize {
        self.rows.iter().filter(|row| row.is_pushed()).count()
    }

    /// Gives impulses to the pairs that were pushed apart in this step of `dt` [s], one after the other and in up to
    /// `rounds` rounds, as `impulse` says from the normal and the corners of a pair: weights of both parts, with
    /// signs, inverse masses and velocities. Pairs that do not face each other get one only if [`Self::hold`] has moved a
    /// corner of theirs, by its `changed` vertices of each surface: nothing else then stops them.
    pub fn collide(
        &self,
        bodies: &mut [&mut [Vector3<f64>]],
        (dt, rounds): (f64, usize),
        changed: &[Vec<u32>],
        impulse: impl Fn(&Vector3<f64>, Corners) -> Option<Vector3<f64>>,
    ) {
        let mut velocity: Vec<Vector3<f64>> = Vec::with_capacity(self.soft_count);
        bodies.iter().for_each(|v| velocity.extend_from_slice(v));
        let facing: Vec<&Row> = self
            .rows
            .iter()
            .filter(|row| row.is_pushed())
            .filter(|row| {
                let is_held = |v: u32| self.is_among(v, changed);
                row.corners.iter().any(|v| is_held(*v)) || row.is_facing(&self.start)
            })
            .collect();
        for _ in 0..rounds {
            let mut is_given = false;
            for row in &facing {
                let inverse_mass = row.corners.map(|v| self.mass[v as usize]);
                let of_bone = |v: usize| (self.end[v] - self.start[v]) / dt;
                let now = row.corners.map(|v| {
                    let v = v as usize;
                    velocity.get(v).copied().unwrap_or_else(|| of_bone(v))
                });
                let Some(j) = impulse(&row.normal, (row.weights, inverse_mass, now)) else {
                    continue;
                };
                is_given = true;
                for ((&v, w), weight) in row.corners.iter().zip(inverse_mass).zip(row.weights) {
                    if let Some(velocity) = velocity.get_mut(v as usize) {
                        *velocity += j * (w * weight);
                    }
                }
            }
            if !is_given {
                break;
            }
        }
        for (member, v) in self.members.iter().zip(bodies) {
            v.copy_from_slice(&velocity[member.first..member.first + member.count]);
        }
    }

    /// The row with the mean direction away from the bone, if it has one: a corner of a bone then slides
    /// along a surface and is not caught between two of its triangles. The vertices of a muscle near a
    /// bone have planes of their own. A bone that is open has no such direction on its inner side.
    fn turned(&self, row: Row) -> Row {
        if !(row.distance > 0.0) {
            return row;
        }
        let mut away = Vector3::zeros();
        for (&v, weight) in row.corners.iter().zip(&row.weights) {
            if v as usize >= self.soft_count
                && let Some((bone, mean)) = self.mean_normal(v)
            {
                away -= bone * mean * *weight;
            }
        }
        if !(away.dot(&row.normal) > 0.0) {
            return row;
        }
        let at = row.corners.map(|v| self.start[v as usize]);
        let normal = leant(&row.normal, &away);
        let offset = (row.normal - normal).dot(&difference(&at, &row.weights));
        Row {
            normal,
            offset,
            ..row
        }
    }

    /// Whether a vertex is among those of its surface, which are ascending.
    fn is_among(&self, vertex: u32, of: &[Vec<u32>]) -> bool {
        let mut each = self.members.iter().zip(of);
        each.any(|(member, of)| {
            let local = member.local(vertex);
            local.is_some_and(|v| of.binary_search(&v).is_ok())
        })
    }

    /// Velocities lose the motion of corrections along the normal, and friction slows sliding; both
    /// as impulses of equal size and opposite direction.
    pub fn end_step(&mut self, bodies: &mut [&mut [Vector3<f64>]], dt: f64) {
        if self.rows.iter().all(|row| !(row.push > 0.0)) {
            return;
        }
        let mut velocity: Vec<Vector3<f64>> = Vec::with_capacity(self.soft_count);
        bodies.iter().for_each(|v| velocity.extend_from_slice(v));
        for row in self.rows.iter().filter(|row| row.push > 0.0) {
            row.slow(&mut velocity, self, dt);
        }
        for (member, v) in self.members.iter().zip(bodies) {
            v.copy_from_slice(&velocity[member.first..member.first + member.count]);
        }
    }
}

impl Row {
    fn new(pair: &Pair, gap: &Gap) -> Self {
        Self {
            parts: pair.parts,
            corners: pair.corners,
            weights: gap.weights,
            normal: gap.normal,
            offset: 0.0,
            distance: pair.distance,
            push: 0.0,
        }
    }

    /// The height of the first part over the second one [m].
    pub fn height(&self, x: &[Point3<f64>]) -> f64 {
        let at = self.corners.map(|v| x[v as usize]);
        self.normal.dot(&difference(&at, &self.weights)) + self.offset
    }

    fn key(&self) -> Key {
        (self.parts, self.corners)
    }

    /// Whether the parts face each other: a vertex over a triangle and not beside it, or two edges that are not
    /// parallel. What slides over a surface must not hit the sides of its triangles.
    fn is_facing(&self, x: &[Point3<f64>]) -> bool {
        if self.parts.first() == 1 {
            return !self.weights[1..].contains(&0.0);
        }
        let [a, b, c, d] = self.corners.map(|v| x[v as usize]);
        let (one, other) = (b - a, d - c);
        one.cross(&other).norm() > PARALLEL * one.norm() * other.norm()
    }

    pub fn is_pushed(&self) -> bool {
        self.push > 0.0
    }

    /// The impulse on each corner in this step, times the length of the step [kg m] at unit mobility.
    #[cfg(test)]
    pub fn impulses(&self) -> [(u32, Vector3<f64>); 4] {
        std::array::from_fn(|k| (self.corners[k], self.normal * (self.weights[k] * self.push)))
    }

    /// The indices of corners whose other part is fixed, without inverse `mass`; each with the
    /// direction away from that part.
    fn blocked(&self, mass: &[f64]) -> impl Iterator<Item = (usize, Vector3<f64>)> + use<> {
        let Self {
            normal, weights, ..
        } = *self;
        let free = self.corners.map(|v| mass[v as usize] > 0.0);
        let is_free = move |other: f64| (0..4).any(|k| weights[k] * other < 0.0 && free[k]);
        (0..4)
            .filter(move |&k| weights[k] != 0.0 && !is_free(weights[k]))
            .map(move |k| (k, normal * weights[k].signum()))
    }

    /// The corners that something fixed blocks, each with the direction in which it may go.
    pub fn directions(&self, mass: &[f64]) -> impl Iterator<Item = (u32, Vector3<f64>)> + use<> {
        let corners = self.corners;
        self.blocked(mass).map(move |(k, away)| (corners[k], away))
    }

    /// How far the pushes of this step have moved each corner [m].
    fn correction(&self, mass: &[f64]) -> [f64; 4] {
        let w = self.corners.map(|v| mass[v as usize]);
        let share = self.share(&w).unwrap_or(0.0);
        std::array::from_fn(|k| w[k] * self.weights[k].abs() * share * self.push)
    }

    /// Pushes the pair apart if it is nearer by more than `slack`, at most by `most` [m]. Returns the
    /// correction [m].
    fn push(&mut self, x: &mut [Point3<f64>], mass: &[f64], most: f64, slack: f64) -> f64 {
        let lack = self.distance - self.height(x);
        if !(lack > slack) {
            return 0.0;
        }
        let w = self.corners.map(|v| mass[v as usize]);
        let Some(share) = self.share(&w) else {
            return 0.0;
        };
        let lack = lack.min(most);
        for ((v, w), weight) in self.corners.into_iter().zip(w).zip(self.weights) {
            x[v as usize] += self.normal * (w * weight * share * lack);
        }
        self.push += lack;
        lack
    }

    /// The reciprocal of the sum of inverse masses times squared weights. Near a fixed corner the
    /// others have no lever: no corner moves farther than twice the correction.
    fn share(&self, w: &[f64; 4]) -> Option<f64> {
        let (mut sum, mut most) = (0.0, 0.0_f64);
        for (w, weight) in w.iter().zip(&self.weights) {
            sum += w * weight * weight;
            most = most.max(0.5 * w * weight.abs());
        }
        let weight = sum.max(most);
        (weight > 0.0).then(|| 1.0 / weight)
    }

    /// Takes the velocity of separation away, and of the sliding as much as friction can in a step of
    /// `dt` [s].
    fn slow(&self, velocity: &mut [Vector3<f64>], of: &Meeting, dt: f64) {
        let w = self.corners.map(|v| of.mass[v as usize]);
        let Some(share) = self.share(&w) else { return };
        let mut relative = Vector3::zeros();
        for (&v, weight) in self.corners.iter().zip(&self.weights) {
            let v = v as usize;
            let way = || (of.end[v] - of.start[v]) / dt;
            relative += velocity.get(v).copied().unwrap_or_else(way) * *weight;
        }
        let along = relative.dot(&self.normal);
        let sliding = relative - self.normal * along;
        let speed = sliding.norm();
        // A push is taken back at most as a whole, and what is taken back was no load.
        let back = along.max(0.0).min(self.push / dt);
        let mut change = self.normal * -back;
        let limit = of.settings.friction * (self.push / dt - back);
        if speed > 0.0 && limit > 0.0 {
            change -= sliding * (limit / speed).min(1.0);
        }
        for ((&v, w), weight) in self.corners.iter().zip(w).zip(&self.weights) {
            if let Some(velocity) = velocity.get_mut(v as usize) {
                *velocity += change * (w * weight * share);
            }
        }
    }
}
