//! The one projection that all kinds of constraints share, for one constraint and for several in lanes alike.

use std::ops::Range;

use nalgebra::Point3;

use super::Constraint;
use super::lanes::{InLanes, Lane, Several, dot, scale, unrolled};
use crate::particles::Slot;

/// What one projection does.
#[derive(Clone, Copy, Debug)]
pub struct Correction<const K: usize> {
    value: f64,
    change: f64,
    move_by: [[f64; 3]; K],
}

/// Trios of a sweep that are done after one another, or side by side.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Span {
    /// The places.
    pub range: Range<usize>,
    /// Whether no particle occurs twice in it.
    pub independent: bool,
}

/// What a sweep reads and writes; all but `slots` in sweep order.
pub struct Sweep<'a, C, const K: usize> {
    pub constraints: &'a mut [C],
    pub compliance: &'a [f64],
    pub relaxation: &'a [f64],
    pub multipliers: &'a mut [f64],
    pub slots: &'a mut [Slot],
    pub per_dt2: f64,
    /// Projections left out.
    pub skipped: &'a mut u64,
}

/// Change of the multiplier, and sum w |g|^2.
#[inline(always)]
fn change<N: Lane, const K: usize>(
    machine: N::Machine,
    (value, gradient): (N, &[[N; 3]; K]),
    inverse_mass: &[N; K],
    (compliance, relaxation, multiplier): (N, N, N),
) -> (N, N) {
    let mut weight = N::splat(machine, 0.0);
    unrolled!(k in K => {
        weight = weight + inverse_mass[k] * dot(gradient[k], gradient[k]);
    });
    // Of an infinite compliance, infinity times a multiplier of zero would be NaN.
    let largest = N::splat(machine, f64::MAX);
    let compliance = N::select(compliance.lt(largest), compliance, largest);
    (relaxation * (-value - compliance * multiplier) / (weight + compliance), weight)
}

/// The change of the multiplier and of each point by one projection; `None` where nothing can or need be done.
#[inline(always)]
pub fn correction<C: Constraint<K>, const K: usize>(
    constraint: &C,
    slots: &[Slot],
    numbers: (f64, f64, f64),
) -> Option<Correction<K>> {
    let at = constraint.points().map(|p| slots[p as usize].0);
    let (value, gradient) = constraint.value_and_gradient(&at.map(|[x, y, z, _]| Point3::new(x, y, z)))?;
    let inverse_mass = at.map(|slot| slot[3]);
    let mut move_by = gradient.map(Into::into);
    let (change, weight) = change::<f64, K>((), (value, &move_by), &inverse_mass, numbers);
    // All points held, or a gradient of zero: nothing that moves could change C.
    if weight <= 0.0 {
        return None;
    }
    for k in 0..K {
        move_by[k] = scale(move_by[k], inverse_mass[k] * change);
    }
    Some(Correction { value, change, move_by })
}

impl<C: Constraint<K>, const K: usize> Sweep<'_, C, K> {
    /// What constraint `j` is projected with: compliance over dt^2, relaxation, multiplier.
    #[inline(always)]
    pub fn numbers(&self, j: usize) -> (f64, f64, f64) {
        (self.compliance[j] * self.per_dt2, self.relaxation[j], self.multipliers[j])
    }

    /// Applies what was computed for constraint `j`.
    #[inline(always)]
    pub fn apply(&mut self, j: usize, correction: Option<Correction<K>>) {
        let Some(Correction { value, change, move_by }) = correction else {
            *self.skipped += 1;
            return;
        };
        self.multipliers[j] += change;
        self.constraints[j].remember(value);
        for (p, by) in self.constraints[j].points().into_iter().zip(move_by) {
            let slot = &mut self.slots[p as usize].0;
            for k in 0..3 {
                slot[k] += by[k];
            }
        }
    }

    /// Projects the constraints of a range one by one.
    // A function of its own: inlined, it would stand in each loop over lanes again.
    #[inline(never)]
    pub fn serial(&mut self, range: Range<usize>, independent: bool) {
        for j in range {
            if C::LANES && independent {
                self.side_by_side::<f64>((), j);
            } else {
                self.alone(j);
            }
        }
    }

    /// Projects one constraint, whatever its numbers and particles are.
    #[inline(always)]
    fn alone(&mut self, j: usize) {
        let correction = correction(&self.constraints[j], self.slots, self.numbers(j));
        self.apply(j, correction);
    }

    /// Projects constraints for which the form in lanes does not hold.
    #[cold]
    fn unusual(&mut self, range: Range<usize>) {
        range.for_each(|j| self.alone(j));
    }

    /// Projects the constraints from `j` on, as many as there are lanes; no particle may occur twice.
    #[inline(always)]
    fn side_by_side<N: Lane>(&mut self, machine: N::Machine, j: usize) {
        let range = j..j + N::COUNT;
        let these = &self.constraints[range.clone()];
        let zero = N::splat(machine, 0.0);
        let (mut x, mut inverse_mass) = ([[zero; 3]; K], [zero; K]);
        unrolled!(k in K => {
            let [a, b, c, w] = N::gather(machine, self.slots, |l| these[l].points()[k]);
            (x[k], inverse_mass[k]) = ([a, b, c], w);
        });
        let Several { value, gradient, usual } = C::in_lanes::<N>(these, machine, &x);
        if !N::all(usual) {
            return self.unusual(range);
        }
        let multiplier = N::load(machine, &self.multipliers[range.clone()]);
        let compliance = N::load(machine, &self.compliance[range.clone()]) * N::splat(machine, self.per_dt2);
        let relaxation = N::load(machine, &self.relaxation[range.clone()]);
        let numbers = (compliance, relaxation, multiplier);
        let (change, weight) = change(machine, (value, &gradient), &inverse_mass, numbers);
        // All points held, or a gradient of zero: nothing that moves could change C.
        let still = weight.le(zero);
        *self.skipped += u64::from(N::bits(still).count_ones());
        if N::all(still) {
            return;
        }
        unrolled!(k in K => {
            let by = scale(gradient[k], inverse_mass[k] * change);
            let to = |i: usize| N::select(still, x[k][i], x[k][i] + by[i]);
            N::scatter([to(0), to(1), to(2), inverse_mass[k]], self.slots, |l| these[l].points()[k]);
        });
        N::select(still, multiplier, multiplier + change).store(&mut self.multipliers[range.clone()]);
        let mut values = [0.0; 8];
        value.store(&mut values);
        let still = N::bits(still);
        for (l, constraint) in self.constraints[range].iter_mut().enumerate() {
            if still & (1 << l) == 0 {
                constraint.remember(values[l]);
            }
        }
    }
}

/// A sweep over spans, in lanes where a span allows it.
pub struct Swept<'a, 'b, C, const K: usize>(pub Sweep<'a, C, K>, pub &'b [Span]);

impl<C: Constraint<K>, const K: usize> InLanes for Swept<'_, '_, C, K> {
    #[inline(always)]
    fn run<N: Lane>(mut self, machine: N::Machine) {
        for Span { range, independent } in self.1 {
            let mut rest = range.clone();
            if C::LANES && *independent && N::COUNT > 1 {
                while rest.len() >= N::COUNT {
                    self.0.side_by_side::<N>(machine, rest.start);
                    rest.start += N::COUNT;
                }
            }
            self.0.serial(rest, *independent);
        }
    }
}
