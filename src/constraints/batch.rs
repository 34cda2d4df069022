//! Many constraints of one kind, in sweep order, and the one projection that all kinds share.

use std::ops::Range;

use nalgebra::{Point3, Vector3};

use super::Constraint;
use super::blocks::Block;
use super::kernel::{MOST_NUMBERS, SweepBlock};
use super::lanes::SimdWidth;
use super::order::{SweepOrder, SweepSchedule, schedule};
use super::projection::{Span, Sweep};
use crate::mesh::measures::max_or_nan;
use crate::particles::{Numbering, Packed, Particles};
use crate::state::{DecodeError, Reader, State, Writer};

/// Least work that a sweep shares among threads. Below this bound, starting a second thread takes
/// longer than the time that it saves. The unit is constraints times squared points, about
/// proportional to the time of a projection.
const PARALLEL: usize = 262_144;

/// Distance of constraints from being satisfied, as a distance in space.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Residual {
    /// Root of the mean square of |C + alpha lambda| / |grad C| [m].
    pub rms: f64,
    /// Greatest value of |C + alpha lambda| / |grad C| [m].
    pub max: f64,
    /// Number of constraints.
    pub count: usize,
}

/// Work and memory of a set of constraints.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Usage {
    /// Number of sweeps so far.
    pub calls: u64,
    /// Number of projections skipped so far because the gradient was undefined.
    pub skipped: u64,
    /// Heap memory held [bytes].
    pub bytes: usize,
}

/// A set of constraints that a solver can sweep over, with one dynamic call per sweep. Checkpoints
/// contain its state.
pub trait Project: State + Send + Sync {
    /// The effect's name.
    fn name(&self) -> &'static str;
    /// Number of constraints.
    fn len(&self) -> usize;
    /// Whether the set has no constraints.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }
    /// Resets the multipliers at the beginning of a step.
    fn begin_step(&mut self);
    /// One sweep with time step `dt` [s].
    fn project(&mut self, particles: &mut Particles, dt: f64);
    /// One sweep as [`Self::project`] does it, over a packed copy of the particles. A solver that
    /// sweeps several sets packs only once.
    fn project_packed(&mut self, packed: &mut Packed, dt: f64);
    /// Distance from satisfaction after the last sweep; zero for a set without constraints to
    /// satisfy.
    fn residual(&self, _particles: &Particles, _dt: f64) -> Residual {
        Residual::default()
    }
    /// Greatest distance [m] from satisfaction among the constraints of one particle; `None` if the
    /// particle has none.
    fn residual_at(&self, _particles: &Particles, _dt: f64, _particle: u32) -> Option<f64> {
        None
    }
    /// Work and memory; zero for a set that does not count them.
    fn usage(&self) -> Usage {
        Usage::default()
    }
    /// Sets the greatest number of constraints computed at once, if the set supports it. The bits
    /// of a result do not depend on it.
    fn set_width(&mut self, _width: SimdWidth) {}
    /// Divides a classic stiffness among `steps` steps: see [`stiffness_of_part`].
    fn divide(&mut self, _steps: u32) {}
    /// Sets the shortening of fibres, relative to their length at rest.
    fn shorten(&mut self, _shortening: f64) {}
    /// Moves the planes over bones: a point [m] and the unit normal of each.
    fn place(&mut self, _planes: &[(Point3<f64>, Vector3<f64>)]) {}
    /// Sets the directions along which edges are kept, each as long as the root of its share in the
    /// stiffness. Without any, none of these constraints acts.
    fn turn(&mut self, _along: &[Vector3<f64>]) {}
}

/// The greatest classic stiffness that is divided among steps.
const MOST_DIVIDED: f64 = 0.95;

/// The classic stiffness of each of `steps` steps that correct together as much as one step of
/// stiffness `k` does, 1 - (1 - k)^(1/steps). A stiffness of 1 has no such parts: 0.95 is divided.
///
/// ```
/// use pliant::constraints::stiffness_of_part;
///
/// let part = stiffness_of_part(0.75, 2);
/// assert!((part - 0.5).abs() <= 1e-15);
/// assert_eq!(stiffness_of_part(1.0, 1), 1.0);
/// ```
pub fn stiffness_of_part(k: f64, steps: u32) -> f64 {
    if steps <= 1 {
        return k;
    }
    1.0 - libm::pow(1.0 - k.min(MOST_DIVIDED), 1.0 / f64::from(steps))
}

/// Constraints of one kind in the order in which they are swept.
///
/// With compliance `alpha` [unit of C squared per J] a projection is the XPBD update
/// \[macklin2016\] `dlambda = (-C - alpha/dt^2 lambda) / (sum w |g|^2 + alpha/dt^2)`, `dx_i = w_i
/// dlambda g_i`. With zero compliance and a relaxation k in 0..1 it is the classic update
/// \[mueller2007\] with stiffness k on the displacement (erratum A05).
///
/// ```
/// use nalgebra::Point3;
/// use pliant::{Batch, Distance, SweepOrder, Particles, Project};
///
/// // A spring of 100 N/m and 1 m between a held point and a mass of 1 kg, pulled to a length of 2 m.
/// let position = vec![Point3::origin(), Point3::new(2.0, 0.0, 0.0)];
/// let mut particles = Particles::at_rest(position, vec![0.0, 1.0]);
/// let spring = Distance { points: [0, 1], rest: 1.0 };
/// let mut batch = Batch::new(vec![spring], vec![1.0 / 100.0], SweepOrder::Stored, 2, &[]);
///
/// // One sweep is an implicit step of 0.1 s: the elongation falls to 1 m / (1 + k dt^2 / m).
/// batch.begin_step();
/// batch.project(&mut particles, 0.1);
/// assert!((particles.position[1].x - 1.5).abs() <= 1e-12);
/// assert!(batch.residual(&particles, 0.1).max <= 1e-12);
/// ```
#[derive(Clone, Debug)]
pub struct Batch<C, const K: usize> {
    constraints: Vec<C>,
    /// The numbers of the constraints that the kernel reads, each list in sweep order; empty where it reads
    /// none. The branches here count, not those of the constraints.
    numbers: [Vec<f64>; MOST_NUMBERS],
    compliance: Vec<f64>,
    /// Empty for constraints that are not classic.
    relaxation: Vec<f64>,
    /// The relaxation of an undivided step.
    classic: Vec<f64>,
    multipliers: Vec<f64>,
    /// Whether a step has begun and not swept: all multipliers are zero then, whatever the list contains.
    is_first: bool,
    schedule: SweepSchedule,
    /// Whether the constraints act in the present step.
    acts: bool,
    /// Positions of each constraint's particles in their block.
    places: Vec<[u32; K]>,
    spans: Vec<Span>,
    width: SimdWidth,
    packed: Packed,
    calls: u64,
    skipped: u64,
}

impl<C: Constraint<K>, const K: usize> Batch<C, K> {
    /// Constraints with one compliance each, to be swept in `order` over `count` particles.
    ///
    /// # Panics
    /// If the number of compliances differs from the number of constraints.
    pub fn new(
        constraints: Vec<C>,
        compliance: Vec<f64>,
        order: SweepOrder,
        count: usize,
        loaded: &[u32],
    ) -> Self {
        Self::numbered(
            constraints,
            compliance,
            order,
            (&Numbering::default(), count),
            loaded,
        )
    }

    /// The same as [`Self::new`], for particles stored in the order of `numbering`.
    /// [`Self::project_packed`] then needs a copy in that order.
    ///
    /// # Panics
    /// The same as [`Self::new`].
    pub fn numbered(
        constraints: Vec<C>,
        compliance: Vec<f64>,
        order: SweepOrder,
        (numbering, count): (&Numbering, usize),
        loaded: &[u32],
    ) -> Self {
        assert_eq!(
            constraints.len(),
            compliance.len(),
            "one compliance for each constraint"
        );
        let place = |p: u32| numbering.place(p);
        let points: Vec<[u32; K]> = constraints.iter().map(|c| c.points().map(place)).collect();
        let loaded: Vec<u32> = loaded.iter().map(|&p| place(p)).collect();
        let schedule = schedule(order, &points, count, &loaded);
        let sorted = |i: &u32| *i as usize;
        let mut new = Self {
            constraints: schedule
                .sequence
                .iter()
                .map(|i| constraints[sorted(i)])
                .collect(),
            numbers: [const { Vec::new() }; MOST_NUMBERS],
            compliance: schedule
                .sequence
                .iter()
                .map(|i| compliance[sorted(i)])
                .collect(),
            relaxation: Vec::new(),
            classic: Vec::new(),
            multipliers: vec![0.0; constraints.len()],
            is_first: true,
            acts: true,
            places: places(&schedule, &points),
            spans: spans(&schedule, &points),
            width: SimdWidth::best(),
            packed: Packed::new(numbering.clone()),
            schedule,
            calls: 0,
            skipped: 0,
        };
        new.read_numbers();
        new
    }

    /// Reads the numbers of the constraints, after one of them changed.
    fn read_numbers(&mut self) {
        let Some(numbers) = C::kernel().numbers else {
            return;
        };
        let lists = self.numbers.iter_mut().enumerate().take(numbers.count);
        for (k, list) in lists {
            list.clear();
            list.extend(self.constraints.iter().map(|c| (numbers.of)(c)[k]));
        }
    }

    /// Constraint `j` in sweep order, on its present branch.
    fn constraint(&self, j: usize) -> C {
        let mut constraint = self.constraints[j];
        if let Some(branch) = C::kernel().branch {
            (branch.set)(&mut constraint, self.numbers[0][j]);
        }
        constraint
    }

    /// Classic stiffness: scales the displacement of each constraint by its factor, 0..1.
    ///
    /// # Panics
    /// If the number of factors differs from the number of constraints.
    #[must_use]
    pub fn with_relaxation(mut self, factor: &[f64]) -> Self {
        assert_eq!(
            factor.len(),
            self.constraints.len(),
            "one factor for each constraint"
        );
        self.relaxation = self
            .schedule
            .sequence
            .iter()
            .map(|&i| factor[i as usize])
            .collect();
        self.classic.clone_from(&self.relaxation);
        self
    }

    /// The constraints in sweep order, each on its present branch.
    pub fn constraints(&self) -> Vec<C> {
        (0..self.constraints.len())
            .map(|j| self.constraint(j))
            .collect()
    }

    /// Multipliers in sweep order.
    pub fn multipliers(&self) -> Vec<f64> {
        (0..self.multipliers.len())
            .map(|j| self.multiplier(j))
            .collect()
    }

    fn multiplier(&self, j: usize) -> f64 {
        if self.is_first {
            0.0
        } else {
            self.multipliers[j]
        }
    }

    /// The order and its colours.
    pub fn schedule(&self) -> &SweepSchedule {
        &self.schedule
    }

    /// Sets the SIMD width, where the processor has it, instead of the widest. Changes no bit of
    /// any result.
    #[must_use]
    pub fn with_width(mut self, width: SimdWidth) -> Self {
        self.width = width;
        self
    }

    /// Heap memory held [bytes].
    fn bytes(&self) -> usize {
        self.constraints.capacity() * size_of::<C>()
            + self
                .numbers
                .iter()
                .map(|of| of.capacity() * 8)
                .sum::<usize>()
            + (self.compliance.capacity()
                + self.relaxation.capacity()
                + self.classic.capacity()
                + self.multipliers.capacity())
                * 8
            + self.schedule.sequence.capacity() * 4
            + self.schedule.colours.capacity() * size_of::<Range<usize>>()
            + self
                .schedule
                .phases
                .iter()
                .map(|blocks| blocks.capacity() * size_of::<Block>())
                .sum::<usize>()
            + self.places.capacity() * size_of::<[u32; K]>()
            + self.spans.capacity() * size_of::<Span>()
            + self.packed.bytes()
    }

    /// |C + alpha lambda| / |grad C| of constraint `j` [m]; `None` where its gradient is undefined.
    fn distance(&self, j: usize, particles: &Particles, dt: f64) -> Option<f64> {
        let constraint = self.constraint(j);
        let points = constraint.points();
        let x = points.map(|p| particles.position[p as usize]);
        let (c, g) = constraint.value_and_gradient(&x)?;
        let is_held = points
            .iter()
            .all(|&p| particles.inverse_mass[p as usize] == 0.0);
        let steepness = g.iter().map(Vector3::norm_squared).sum::<f64>().sqrt();
        let per_dt2 = 1.0 / (dt * dt);
        let off = || (c + self.compliance[j] * per_dt2 * self.multiplier(j)).abs() / steepness;
        (!is_held && steepness != 0.0).then(off)
    }

    fn sweep_packed(&mut self, packed: &mut Packed, dt: f64) {
        let parallel =
            self.constraints.len() * K * K >= PARALLEL && rayon::current_num_threads() > 1;
        let mut all = Sweep {
            constraints: &self.constraints,
            numbers: self.numbers.each_mut().map(|of| &mut of[..]),
            places: &self.places,
            compliance: &self.compliance,
            relaxation: &self.relaxation,
            multipliers: &mut self.multipliers,
            is_first: self.is_first,
            slots: &mut packed.slots,
            per_dt2: 1.0 / (dt * dt),
            skipped: 0,
        };
        for phase in &self.schedule.phases {
            let Some(first) = phase.first() else { continue };
            let [_, rest] = all.split(first.places.start, first.particles.start);
            let origin = (first.places.start, first.particles.start);
            self.skipped += Phase {
                spans: &self.spans,
                width: self.width,
                parallel,
                sweep: C::kernel().sweep,
            }
            .run(phase, origin, rest);
        }
        self.is_first = false;
    }
}

/// How the blocks of a phase are swept.
#[derive(Clone, Copy)]
struct Phase<'a, C, const K: usize> {
    spans: &'a [Span],
    width: SimdWidth,
    parallel: bool,
    sweep: SweepBlock<C, K>,
}

impl<C: Constraint<K>, const K: usize> Phase<'_, C, K> {
    /// Sweeps `blocks`. The parts of `over` begin at constraint and particle `origin`. Returns the
    /// number of skipped projections.
    fn run(self, blocks: &[Block], origin: (usize, usize), mut over: Sweep<C, K>) -> u64 {
        if let [block] = blocks {
            let [mut own, _] = over.split(block.places.len(), block.particles.end - origin.1);
            own.slots = &mut own.slots[block.particles.start - origin.1..];
            (self.sweep)(&mut own, &self.spans[block.colours.clone()], self.width);
            return own.skipped;
        }
        let (left, right) = blocks.split_at(blocks.len() / 2);
        let middle = (right[0].places.start, right[0].particles.start);
        let [first, second] = over.split(middle.0 - origin.0, middle.1 - origin.1);
        let (a, b) = (
            || self.run(left, origin, first),
            || self.run(right, middle, second),
        );
        let (a, b) = if self.parallel {
            rayon::join(a, b)
        } else {
            (a(), b())
        };
        a + b
    }
}

/// Particles of each constraint, counted from the first particle of its block.
fn places<const K: usize>(schedule: &SweepSchedule, points: &[[u32; K]]) -> Vec<[u32; K]> {
    let blocks = schedule.phases.iter().flatten();
    let of = |block: &Block| {
        let base = block.particles.start as u32;
        schedule.sequence[block.places.clone()]
            .iter()
            .map(move |&c| points[c as usize].map(|p| p - base))
    };
    blocks.flat_map(of).collect()
}

/// The colours of all blocks, each with whether its constraints can fill the lanes of a register.
fn spans<const K: usize>(schedule: &SweepSchedule, points: &[[u32; K]]) -> Vec<Span> {
    // A constraint that contains a particle twice moves it twice.
    let repeats = |p: &[u32; K]| (1..K).any(|k| p[..k].contains(&p[k]));
    let mut spans = Vec::with_capacity(schedule.colours.len());
    for block in schedule.phases.iter().flatten() {
        for colour in &schedule.colours[block.colours.clone()] {
            let mut these = schedule.sequence[colour.clone()]
                .iter()
                .map(|&c| &points[c as usize]);
            let range = colour.start - block.places.start..colour.end - block.places.start;
            spans.push(Span {
                range,
                independent: schedule.independent && !these.any(repeats),
            });
        }
    }
    spans
}

/// Appends the branches of periodic constraints; appends nothing for other constraints.
pub(crate) fn save_branches<C: Constraint<K>, const K: usize>(constraints: &[C], to: &mut Writer) {
    if let Some(branch) = C::kernel().branch {
        to.put(&constraints.len());
        constraints.iter().for_each(|c| to.put(&(branch.get)(c)));
    }
}

/// Sets the shortening of fibres for constraints that have one.
pub(crate) fn shorten<C: Constraint<K>, const K: usize>(constraints: &mut [C], shortening: f64) {
    if let Some(shorten) = C::kernel().shorten {
        constraints.iter_mut().for_each(|c| shorten(c, shortening));
    }
}

/// Restores the branches that [`save_branches`] appended.
pub(crate) fn restore_branches<C: Constraint<K>, const K: usize>(
    constraints: &mut [C],
    from: &mut Reader<'_>,
) -> Result<(), DecodeError> {
    if let Some(branch) = C::kernel().branch {
        let values = from.exactly::<f64>(constraints.len())?;
        constraints
            .iter_mut()
            .zip(values)
            .for_each(|(c, value)| (branch.set)(c, value));
    }
    Ok(())
}

impl<C: Constraint<K>, const K: usize> State for Batch<C, K> {
    fn save(&self, to: &mut Writer) {
        let Self {
            // Only their branches change.
            constraints: _,
            numbers: _,
            compliance: _,
            // Of the number of steps of a frame.
            relaxation: _,
            classic: _,
            // Written as zeros before the first sweep of a step.
            multipliers: _,
            is_first: _,
            // Set at the beginning of a step.
            acts: _,
            schedule: _,
            places: _,
            spans: _,
            width: _,
            packed: _,
            calls,
            skipped,
        } = self;
        save_branches(&self.constraints(), to);
        // A step resets the multipliers at its beginning, but the measures of a frame use those of
        // its last step.
        to.list(&self.multipliers());
        to.put(&(*calls, *skipped));
    }

    fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), DecodeError> {
        restore_branches(&mut self.constraints, from)?;
        self.read_numbers();
        from.fill(&mut self.multipliers)?;
        self.is_first = false;
        (self.calls, self.skipped) = from.take()?;
        Ok(())
    }
}

impl<C: Constraint<K>, const K: usize> Project for Batch<C, K> {
    fn name(&self) -> &'static str {
        C::NAME
    }

    fn len(&self) -> usize {
        self.constraints.len()
    }

    fn begin_step(&mut self) {
        self.is_first = true;
    }

    fn project(&mut self, particles: &mut Particles, dt: f64) {
        self.calls += 1;
        // A step of length zero moves nothing.
        if dt == 0.0 || !self.acts {
            return;
        }
        let mut packed = std::mem::take(&mut self.packed);
        packed.read(particles);
        self.sweep_packed(&mut packed, dt);
        packed.write(particles);
        self.packed = packed;
    }

    fn project_packed(&mut self, packed: &mut Packed, dt: f64) {
        self.calls += 1;
        if dt != 0.0 && self.acts {
            self.sweep_packed(packed, dt);
        }
    }

    fn residual(&self, particles: &Particles, dt: f64) -> Residual {
        if !self.acts {
            return Residual::default();
        }
        let (mut sum, mut max) = (0.0, 0.0_f64);
        for distance in (0..self.constraints.len()).filter_map(|j| self.distance(j, particles, dt))
        {
            sum += distance * distance;
            // `f64::max` would ignore a NaN, and no later number may replace a NaN.
            if !(distance <= max || max.is_nan()) {
                max = distance;
            }
        }
        let count = self.constraints.len();
        Residual {
            rms: (sum / count.max(1) as f64).sqrt(),
            max,
            count,
        }
    }

    fn residual_at(&self, particles: &Particles, dt: f64, particle: u32) -> Option<f64> {
        let acting = (0..self.constraints.len())
            .filter(|j| self.acts && self.constraints[*j].points().contains(&particle));
        let mut distances = acting
            .filter_map(|j| self.distance(j, particles, dt))
            .peekable();
        distances.peek().is_some().then(|| max_or_nan(distances))
    }

    fn usage(&self) -> Usage {
        Usage {
            calls: self.calls,
            skipped: self.skipped,
            bytes: self.bytes(),
        }
    }

    fn set_width(&mut self, width: SimdWidth) {
        self.width = width;
    }

    fn divide(&mut self, steps: u32) {
        let parts = self.relaxation.iter_mut().zip(&self.classic);
        parts.for_each(|(part, &k)| *part = stiffness_of_part(k, steps));
    }

    fn shorten(&mut self, shortening: f64) {
        if C::kernel().shorten.is_some() {
            self.constraints = self.constraints();
            shorten(&mut self.constraints, shortening);
            self.read_numbers();
        }
    }

    fn turn(&mut self, along: &[Vector3<f64>]) {
        if let Some(turn) = C::kernel().turn {
            self.acts = !along.is_empty();
            self.constraints = self.constraints();
            let each = self.constraints.iter_mut().zip(&self.schedule.sequence);
            each.filter_map(|(c, &i)| Some((c, along.get(i as usize)?)))
                .for_each(|(c, along)| turn(c, along));
            self.read_numbers();
        }
    }
}
