//! Steps of a lattice: slabs of planes on threads, and two steps in one pass through memory.
//!
//! A step reads the present and the previous position of each point and writes one; memory limits
//! its speed where no cache holds the lattice. A second step needs only planes of the first step
//! that are at most one plane away: it follows one plane behind, while these are still in the
//! cache. Positions exchange places: x(t + dt) replaces x(t - dt), and x(t + 2 dt) replaces x(t),
//! which is no longer read then.
//!
//! At the border of slabs a first step still needs x(t) of its neighbour: it is copied before. The
//! second steps of the planes on either side follow when all first steps are done. The effect of
//! the plane below is computed again for each slab, in the same order: no bit depends on the number
//! of slabs, or on single or paired steps.

use rayon::prelude::*;

use super::kernel::{Carried, Frame, Moved, Plane, act_upwards, step_plane};
use super::{Lattice, LatticeError};
use crate::constraints::SimdWidth;
use crate::simd::{FusedLane, FusedWork, Number};

/// Slabs of fewer points do not justify a thread.
const POINTS_PER_THREAD: usize = 4096;
/// Slabs of fewer planes repeat too much work of their neighbours for paired steps.
const PLANES_FOR_TWO: usize = 4;

/// One step of the planes from `first`, one for each plane of `previous`. `current` contains all
/// planes.
struct One<'a, F> {
    frame: &'a Frame<F>,
    current: &'a [F],
    previous: &'a mut [F],
    first: usize,
    carried: &'a mut Carried<F>,
}

impl<F: Number> FusedWork<F> for One<'_, F> {
    type Output = Moved;

    #[inline(always)]
    fn run<L: FusedLane<F>>(self, machine: L::Machine) -> Moved {
        let Self {
            frame,
            current,
            previous,
            first,
            carried,
        } = self;
        let plane = |k: usize| plane_of(frame, current, k);
        carried.clear(frame);
        if let Some((below, here)) = first.checked_sub(1).and_then(&plane).zip(plane(first)) {
            act_upwards::<F, L>(machine, frame, [below, here], carried);
        }
        let mut moved = Moved::default();
        for (k, previous) in (first..).zip(previous.chunks_exact_mut(frame.plane())) {
            let Some(here) = plane(k) else { break };
            let plane = Plane {
                number: k,
                here,
                above: plane(k + 1),
            };
            moved = moved.and(step_plane::<F, L>(machine, frame, plane, previous, carried));
        }
        moved
    }
}

/// Two steps of the planes from `first`: the first step of all, and the second step of those that
/// need nothing of other slabs.
struct Two<'a, F> {
    frame: &'a Frame<F>,
    /// x(t), and x(t + 2 dt) of the planes after their second step.
    current: &'a mut [F],
    /// x(t - dt), then x(t + dt).
    previous: &'a mut [F],
    /// x(t) of the planes below and above, if any.
    outside: [Option<&'a [F]>; 2],
    first: usize,
    carried: &'a mut [Carried<F>; 2],
}

impl<F: Number> FusedWork<F> for Two<'_, F> {
    type Output = [Moved; 2];

    #[inline(always)]
    fn run<L: FusedLane<F>>(self, machine: L::Machine) -> [Moved; 2] {
        let Self {
            frame,
            current,
            previous,
            outside: [below, above],
            first,
            carried: [one, two],
        } = self;
        let size = frame.plane();
        let planes = current.len() / size;
        let mut moved = [Moved::default(); 2];
        one.clear(frame);
        two.clear(frame);
        if let (Some(below), Some(here)) = (below, plane_of(frame, current, 0)) {
            act_upwards::<F, L>(machine, frame, [below, here], one);
        }
        for k in 0..=planes {
            if k < planes {
                let here = &current[k * size..][..size];
                let plane = Plane {
                    number: first + k,
                    here,
                    above: plane_of(frame, current, k + 1).or(above),
                };
                let step = step_plane::<F, L>(
                    machine,
                    frame,
                    plane,
                    &mut previous[k * size..][..size],
                    one,
                );
                moved[0] = moved[0].and(step);
            }
            let Some(trailing) = k.checked_sub(1) else {
                continue;
            };
            let Some(here) = plane_of(frame, previous, trailing) else {
                continue;
            };
            let next = plane_of(frame, previous, k);
            if next.is_none() && above.is_some() {
                // The step needs the plane above; the effect of the plane below is stored.
                break;
            }
            if trailing > 0 || below.is_none() {
                let plane = Plane {
                    number: first + trailing,
                    here,
                    above: next,
                };
                let step = step_plane::<F, L>(
                    machine,
                    frame,
                    plane,
                    &mut current[trailing * size..][..size],
                    two,
                );
                moved[1] = moved[1].and(step);
            } else if let Some(next) = next {
                act_upwards::<F, L>(machine, frame, [here, next], two);
            }
        }
        moved
    }
}

/// The second steps that [`Two`] leaves.
struct Seams<'a, F> {
    frame: &'a Frame<F>,
    /// x(t + dt) of all planes.
    all: &'a [F],
    /// The slab with x(t) of the remaining planes.
    current: &'a mut [F],
    first: usize,
    carried: &'a mut [Carried<F>; 2],
}

impl<F: Number> FusedWork<F> for Seams<'_, F> {
    type Output = Moved;

    #[inline(always)]
    fn run<L: FusedLane<F>>(self, machine: L::Machine) -> Moved {
        let Self {
            frame,
            all,
            current,
            first,
            carried: [one, two],
        } = self;
        let size = frame.plane();
        let planes = current.len() / size;
        let plane = |k: usize| plane_of(frame, all, k);
        let mut moved = Moved::default();
        if let (Some(below), Some(here)) = (first.checked_sub(1).and_then(&plane), plane(first)) {
            act_upwards::<F, L>(machine, frame, [below, here], one);
            let plane = Plane {
                number: first,
                here,
                above: plane(first + 1),
            };
            moved = step_plane::<F, L>(machine, frame, plane, &mut current[..size], one);
        }
        let last = first + planes - 1;
        let is_done = last == first && first > 0;
        if let (Some(here), Some(above), false) = (plane(last), plane(last + 1), is_done) {
            let plane = Plane {
                number: last,
                here,
                above: Some(above),
            };
            moved = moved.and(step_plane::<F, L>(
                machine,
                frame,
                plane,
                &mut current[(planes - 1) * size..],
                two,
            ));
        }
        moved
    }
}

/// A plane of a slice; `None` if it does not exist.
fn plane_of<'a, F: Number>(frame: &Frame<F>, planes: &'a [F], k: usize) -> Option<&'a [F]> {
    planes.get(k * frame.plane()..(k + 1) * frame.plane())
}

impl<F: Number> Lattice<F> {
    /// Makes one step, on the threads of the current `rayon` pool.
    ///
    /// # Errors
    /// [`LatticeError::Diverged`] if a position is not finite.
    pub fn step(&mut self) -> Result<(), LatticeError> {
        self.measured_step().map(|_| ())
    }

    /// Makes one step. Returns the largest move of a point \[m\].
    ///
    /// # Errors
    /// Those of [`Self::step`].
    pub fn measured_step(&mut self) -> Result<f64, LatticeError> {
        self.find_patterns();
        let moved = self.advance();
        std::mem::swap(&mut self.current, &mut self.previous);
        self.steps += 1;
        checked(moved, self.steps)
    }

    /// Makes two steps in one pass through memory. Returns the largest move of a point in each
    /// \[m\]. The result has the same bits as two single steps.
    ///
    /// # Errors
    /// Those of [`Self::step`]; both steps are made.
    pub fn measured_pair(&mut self) -> Result<[f64; 2], LatticeError> {
        if self.thickness() < PLANES_FOR_TWO.min(self.shape.points[2]) {
            return Ok([self.measured_step()?, self.measured_step()?]);
        }
        self.find_patterns();
        let [first, second] = self.advance_twice();
        self.steps += 2;
        Ok([
            checked(first, self.steps - 1)?,
            checked(second, self.steps)?,
        ])
    }

    /// Makes `steps` steps, two at a time. Returns the largest move of a point in the last one
    /// \[m\]; 0 for no step.
    ///
    /// # Errors
    /// Those of [`Self::step`]; one more step than the error names is possible.
    pub fn run(&mut self, steps: u64) -> Result<f64, LatticeError> {
        let mut last = 0.0;
        for _ in 0..steps / 2 {
            [_, last] = self.measured_pair()?;
        }
        if steps % 2 == 1 {
            self.measured_step()
        } else {
            Ok(last)
        }
    }

    /// Number of planes of a slab.
    fn thickness(&self) -> usize {
        let planes = self.shape.points[2];
        let most = (self.shape.count() / POINTS_PER_THREAD).clamp(1, planes);
        planes.div_ceil(rayon::current_num_threads().clamp(1, most))
    }

    /// Replaces previous positions by new ones.
    fn advance(&mut self) -> Moved {
        let (frame, thickness) = (&self.frame, self.thickness());
        let parts = self.previous.chunks_mut(thickness * frame.plane());
        self.carried
            .resize_with(self.carried.len().max(parts.len()), Default::default);
        let current = &self.current[..];
        let slabs =
            parts
                .zip(&mut self.carried)
                .enumerate()
                .map(|(slab, (previous, [carried, _]))| {
                    let first = slab * thickness;
                    One {
                        frame,
                        current,
                        previous,
                        first,
                        carried,
                    }
                });
        on_slabs(self.width, slabs.collect(), Moved::and)
    }

    /// Replaces previous positions by those after a step, and current positions by those after two.
    fn advance_twice(&mut self) -> [Moved; 2] {
        let (frame, thickness) = (&self.frame, self.thickness());
        let (plane, size) = (frame.plane(), thickness * frame.plane());
        let count = self.shape.points[2].div_ceil(thickness);
        self.carried
            .resize_with(self.carried.len().max(count), Default::default);
        // The planes below and above each border.
        self.seams.clear();
        for seam in 1..count {
            self.seams
                .extend_from_slice(&self.current[seam * size - plane..][..2 * plane]);
        }
        let seam = |side: Option<usize>| side.and_then(|k| plane_of(frame, &self.seams, k));
        let parts = self
            .current
            .chunks_mut(size)
            .zip(self.previous.chunks_mut(size))
            .zip(&mut self.carried);
        let slabs = parts
            .enumerate()
            .map(|(slab, ((current, previous), carried))| {
                let outside = [seam((2 * slab).checked_sub(2)), seam(Some(2 * slab + 1))];
                Two {
                    frame,
                    current,
                    previous,
                    outside,
                    first: slab * thickness,
                    carried,
                }
            });
        let both = |a: [Moved; 2], b: [Moved; 2]| [a[0].and(b[0]), a[1].and(b[1])];
        let [first, second] = on_slabs(self.width, slabs.collect(), both);
        if count == 1 {
            return [first, second];
        }
        let all = &self.previous[..];
        let parts = self
            .current
            .chunks_mut(size)
            .zip(&mut self.carried)
            .enumerate();
        let slabs = parts.map(|(slab, (current, carried))| {
            let first = slab * thickness;
            Seams {
                frame,
                all,
                current,
                first,
                carried,
            }
        });
        [
            first,
            second.and(on_slabs(self.width, slabs.collect(), Moved::and)),
        ]
    }
}

/// Runs the work of each slab, on threads if there are several.
fn on_slabs<F: Number, W: FusedWork<F, Output: Default + Send> + Send>(
    width: SimdWidth,
    slabs: Vec<W>,
    both: impl Fn(W::Output, W::Output) -> W::Output + Sync + Send,
) -> W::Output {
    let work = |slab: W| F::in_lanes(width, slab);
    if slabs.len() > 1 {
        return slabs
            .into_par_iter()
            .map(work)
            .reduce(W::Output::default, both);
    }
    // A thread pool would cost a small lattice more than its step.
    slabs.into_iter().map(work).fold(W::Output::default(), both)
}

/// The largest move [m].
fn checked(moved: Moved, step: u64) -> Result<f64, LatticeError> {
    if moved.sum.is_finite() {
        Ok(moved.largest.sqrt())
    } else {
        Err(LatticeError::Diverged { step })
    }
}
