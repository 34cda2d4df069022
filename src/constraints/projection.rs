//! The one projection that all kinds of constraints share, for one constraint and for several in
//! lanes.

use std::marker::PhantomData;
use std::ops::Range;

use nalgebra::Point3;

use super::kernel::{MOST_NUMBERS, Mode};
use super::lanes::{self, InLanes, Lane, Several, SimdWidth, dot, scale, unrolled};
use super::{Constraint, LaneConstraint};
use crate::particles::Slot;

/// Greatest number of lanes.
const MOST: usize = 8;

/// The number of lanes, at most [`MOST`].
#[inline(always)]
fn array<T>(of: impl FnMut(usize) -> T) -> [T; MOST] {
    std::array::from_fn(of)
}

/// What one projection does.
#[derive(Clone, Copy, Debug)]
pub struct Correction<const K: usize> {
    value: f64,
    change: f64,
    move_by: [[f64; 3]; K],
}

/// Positions of a block whose constraints are projected one after the other or in lanes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Span {
    /// The positions, counted from the first of the block.
    pub range: Range<usize>,
    /// Whether each particle occurs at most once.
    pub independent: bool,
}

/// The data that a sweep reads and writes, all but `slots` in sweep order.
pub struct Sweep<'a, C, const K: usize> {
    pub constraints: &'a [C],
    /// The numbers of each constraint that its form in lanes reads; empty for a kind without. The branch here
    /// counts, not that of the constraint.
    pub numbers: [&'a mut [f64]; MOST_NUMBERS],
    /// Slots of the constraints' particles, counted from the first slot of their block.
    pub places: &'a [[u32; K]],
    pub compliance: &'a [f64],
    /// Empty where all are one.
    pub relaxation: &'a [f64],
    pub multipliers: &'a mut [f64],
    /// Whether all multipliers are zero, whatever they contain: this is the first sweep of a step.
    pub is_first: bool,
    pub slots: &'a mut [Slot],
    pub per_dt2: f64,
    /// Number of skipped projections.
    pub skipped: u64,
}

impl<C, const K: usize> Sweep<'_, C, K> {
    /// The first `constraints` with the first `slots`, and the others.
    pub fn split(&mut self, constraints: usize, slots: usize) -> [Sweep<'_, C, K>; 2] {
        let (a, b) = self.constraints.split_at(constraints);
        let (places_a, places_b) = self.places.split_at(constraints);
        let (compliance_a, compliance_b) = self.compliance.split_at(constraints);
        let classic = constraints.min(self.relaxation.len());
        let (relaxation_a, relaxation_b) = self.relaxation.split_at(classic);
        let (multipliers_a, multipliers_b) = self.multipliers.split_at_mut(constraints);
        let (slots_a, slots_b) = self.slots.split_at_mut(slots);
        let [first, second, third] = &mut self.numbers;
        let (first_a, first_b) = first.split_at_mut(constraints.min(first.len()));
        let (second_a, second_b) = second.split_at_mut(constraints.min(second.len()));
        let (third_a, third_b) = third.split_at_mut(constraints.min(third.len()));
        let (per_dt2, is_first) = (self.per_dt2, self.is_first);
        [
            Sweep {
                constraints: a,
                numbers: [first_a, second_a, third_a],
                places: places_a,
                compliance: compliance_a,
                relaxation: relaxation_a,
                multipliers: multipliers_a,
                is_first,
                slots: slots_a,
                per_dt2,
                skipped: 0,
            },
            Sweep {
                constraints: b,
                numbers: [first_b, second_b, third_b],
                places: places_b,
                compliance: compliance_b,
                relaxation: relaxation_b,
                multipliers: multipliers_b,
                is_first,
                slots: slots_b,
                per_dt2,
                skipped: 0,
            },
        ]
    }
}

/// Change of the multiplier and sum w |g|^2.
#[inline(always)]
fn change<C, M: Mode<C, K>, N: Lane, const K: usize>(
    machine: N::Machine,
    (value, gradient): (N, &[[N; 3]; K]),
    inverse_mass: &[N; K],
    (compliance, relaxation, multiplier): (N, N, N),
) -> (N, N) {
    let mut weight = N::splat(machine, 0.0);
    unrolled!(k in K => {
        let inverse_mass = inverse_mass[k];
        weight = weight + if M::UNIT { inverse_mass } else { inverse_mass * dot(gradient[k], gradient[k]) };
    });
    // For an infinite compliance, infinity times a multiplier of zero would be NaN.
    let largest = N::splat(machine, f64::MAX);
    let compliance = N::select(compliance.lt(largest), compliance, largest);
    // The quotient is computed first, because it does not depend on the value.
    (
        relaxation / (weight + compliance) * (-value - compliance * multiplier),
        weight,
    )
}

/// The change of the multiplier and of each point by one projection; `None` where no change is
/// possible or needed.
#[inline(always)]
fn correction<C: Constraint<K>, M: Mode<C, K>, const K: usize>(
    constraint: &C,
    at: [[f64; 4]; K],
    factors: (f64, f64, f64),
) -> Option<Correction<K>> {
    let (value, gradient) =
        constraint.value_and_gradient(&at.map(|[x, y, z, _]| Point3::new(x, y, z)))?;
    let inverse_mass = at.map(|slot| slot[3]);
    let mut move_by = gradient.map(Into::into);
    let (change, weight) = change::<C, M, f64, K>((), (value, &move_by), &inverse_mass, factors);
    // All points are fixed or the gradient is zero: no displacement can change C.
    if weight <= 0.0 {
        return None;
    }
    for k in 0..K {
        move_by[k] = scale(move_by[k], inverse_mass[k] * change);
    }
    Some(Correction {
        value,
        change,
        move_by,
    })
}

impl<C: Constraint<K>, const K: usize> Sweep<'_, C, K> {
    #[inline(always)]
    fn relaxation_of(&self, j: usize) -> f64 {
        if self.relaxation.is_empty() {
            1.0
        } else {
            self.relaxation[j]
        }
    }

    /// Factors of the projection of constraint `j`: compliance / dt^2, relaxation, multiplier.
    #[inline(always)]
    fn factors(&self, j: usize) -> (f64, f64, f64) {
        (
            self.compliance[j] * self.per_dt2,
            self.relaxation_of(j),
            self.multipliers[j],
        )
    }

    /// Applies the computed changes to constraint `j`.
    #[inline(always)]
    fn apply<M: Mode<C, K>>(&mut self, j: usize, correction: Option<Correction<K>>) {
        let Some(Correction {
            value,
            change,
            move_by,
        }) = correction
        else {
            self.skipped += 1;
            return;
        };
        self.multipliers[j] += change;
        if M::PERIODIC {
            self.numbers[0][j] = M::branch(&self.constraints[j], value);
        }
        for (p, by) in self.places[j].into_iter().zip(move_by) {
            let slot = &mut self.slots[p as usize].0;
            for k in 0..3 {
                slot[k] += by[k];
            }
        }
    }

    /// Projects one constraint, for any numbers and particles.
    #[inline(always)]
    fn alone<M: Mode<C, K>>(&mut self, j: usize) {
        let at = self.places[j].map(|p| self.slots[p as usize].0);
        if self.is_first {
            self.multipliers[j] = 0.0;
        }
        let mut constraint = self.constraints[j];
        if M::PERIODIC {
            M::set(&mut constraint, self.numbers[0][j]);
        }
        let correction = correction::<C, M, K>(&constraint, at, self.factors(j));
        self.apply::<M>(j, correction);
    }
}

impl<C: LaneConstraint<K>, const K: usize> Sweep<'_, C, K> {
    /// Projects the constraints of a range one by one, in one lane where the form in lanes is
    /// valid.
    // A separate function: inlined, it would be copied into each loop over lanes.
    #[inline(never)]
    fn serial<M: Mode<C, K>>(&mut self, range: Range<usize>, independent: bool) {
        for j in range {
            if !(independent && self.side_by_side::<M, f64>((), j, 1)) {
                self.alone::<M>(j);
            }
        }
    }

    /// Projects as many constraints as there are lanes, from `j` on.
    #[inline(always)]
    fn group<M: Mode<C, K>, N: Lane>(&mut self, machine: N::Machine, j: usize) {
        if !self.side_by_side::<M, N>(machine, j, N::COUNT) {
            self.unusual::<M>(j..j + N::COUNT);
        }
    }

    /// Projects constraints for which the form in lanes is not valid.
    #[cold]
    #[inline(never)]
    fn unusual<M: Mode<C, K>>(&mut self, range: Range<usize>) {
        self.serial::<M>(range, true);
    }

    /// Projects the constraints of a range with fewer constraints than lanes. The last constraint
    /// fills the remaining lanes. They compute and write the same numbers.
    #[inline(always)]
    fn rest<M: Mode<C, K>, N: Lane>(&mut self, machine: N::Machine, range: Range<usize>) {
        let Some(last) = range.clone().next_back() else {
            return;
        };
        let at = |l: usize| (range.start + l).min(last);
        let few = range.len();
        let mut numbers = [[0.0; MOST]; MOST_NUMBERS];
        unrolled!(k in MOST_NUMBERS => {
            if k < C::NUMBERS {
                numbers[k] = array(|l| self.numbers[k][at(l)]);
            }
        });
        let mut multipliers = array(|l| self.multipliers[at(l)]);
        let mut filled = Sweep {
            constraints: &[],
            numbers: numbers.each_mut().map(|of| &mut of[..]),
            places: &array(|l| self.places[at(l)]),
            compliance: &array(|l| self.compliance[at(l)]),
            relaxation: &array(|l| self.relaxation_of(at(l))),
            multipliers: &mut multipliers,
            is_first: self.is_first,
            slots: self.slots,
            per_dt2: self.per_dt2,
            skipped: 0,
        };
        if !filled.side_by_side::<M, N>(machine, 0, few) {
            return self.unusual::<M>(range);
        }
        self.skipped += filled.skipped;
        self.multipliers[range.clone()].copy_from_slice(&multipliers[..few]);
        if M::PERIODIC {
            self.numbers[0][range].copy_from_slice(&numbers[0][..few]);
        }
    }

    /// Projects the constraints from `j` on, as many as there are lanes. No particle may occur
    /// twice, except in repetitions of the last constraint; only the first `counted` count. Returns
    /// false and changes nothing if the form in lanes is not valid for all of them.
    #[inline(always)]
    fn side_by_side<M: Mode<C, K>, N: Lane>(
        &mut self,
        machine: N::Machine,
        j: usize,
        counted: usize,
    ) -> bool {
        let range = j..j + N::COUNT;
        let places = &self.places[range.clone()];
        let zero = N::splat(machine, 0.0);
        let (mut x, mut inverse_mass) = ([[zero; 3]; K], [zero; K]);
        unrolled!(k in K => {
            let [a, b, c, w] = N::gather(machine, self.slots, |l| places[l][k]);
            (x[k], inverse_mass[k]) = ([a, b, c], w);
        });
        let mut numbers = [zero; MOST_NUMBERS];
        unrolled!(k in MOST_NUMBERS => {
            if k < C::NUMBERS {
                numbers[k] = N::load(machine, &self.numbers[k][range.clone()]);
            }
        });
        let Several {
            value,
            gradient,
            branch,
            usual,
        } = C::in_lanes::<N>(machine, numbers, &x);
        if !N::all(usual) {
            return false;
        }
        let mut multiplier = zero;
        if !self.is_first {
            multiplier = N::load(machine, &self.multipliers[range.clone()]);
        }
        let compliance =
            N::load(machine, &self.compliance[range.clone()]) * N::splat(machine, self.per_dt2);
        let mut relaxation = N::splat(machine, 1.0);
        if !self.relaxation.is_empty() {
            relaxation = N::load(machine, &self.relaxation[range.clone()]);
        }
        let factors = (compliance, relaxation, multiplier);
        let (change, weight) =
            change::<C, M, N, K>(machine, (value, &gradient), &inverse_mass, factors);
        // All points are fixed or the gradient is zero: no displacement can change C.
        let still = weight.le(zero);
        let change = N::select(still, zero, change);
        self.skipped += u64::from((N::bits(still) & ((1 << counted) - 1)).count_ones());
        unrolled!(k in K => {
            let by = scale(gradient[k], inverse_mass[k] * change);
            let to = [x[k][0] + by[0], x[k][1] + by[1], x[k][2] + by[2], inverse_mass[k]];
            N::scatter(to, self.slots, |l| places[l][k]);
        });
        (multiplier + change).store(&mut self.multipliers[range.clone()]);
        if M::PERIODIC {
            branch.store(&mut self.numbers[0][range]);
        }
        true
    }
}

/// Projects the constraints of some spans one after the other.
pub fn one_by_one<C: Constraint<K>, M: Mode<C, K>, const K: usize>(
    sweep: &mut Sweep<'_, C, K>,
    spans: &[Span],
    _: SimdWidth,
) {
    for span in spans {
        for j in span.range.clone() {
            sweep.alone::<M>(j);
        }
    }
}

/// Projects the constraints of some spans, in lanes where a span allows it.
pub fn in_lanes<C: LaneConstraint<K>, M: Mode<C, K>, const K: usize>(
    sweep: &mut Sweep<'_, C, K>,
    spans: &[Span],
    width: SimdWidth,
) {
    let mode = PhantomData::<M>;
    lanes::run(width, Swept { sweep, spans, mode });
}

/// A sweep over the spans of a block, in lanes where a span allows it.
struct Swept<'a, 'b, C, M, const K: usize> {
    sweep: &'b mut Sweep<'a, C, K>,
    spans: &'b [Span],
    mode: PhantomData<M>,
}

impl<C: LaneConstraint<K>, M: Mode<C, K>, const K: usize> InLanes for Swept<'_, '_, C, M, K> {
    #[inline(always)]
    fn run<N: Lane>(self, machine: N::Machine) {
        for Span { range, independent } in self.spans {
            let mut rest = range.clone();
            if *independent && N::COUNT > 1 {
                while rest.len() >= N::COUNT {
                    self.sweep.group::<M, N>(machine, rest.start);
                    rest.start += N::COUNT;
                }
                self.sweep.rest::<M, N>(machine, rest);
                continue;
            }
            self.sweep.serial::<M>(rest, *independent);
        }
    }
}
