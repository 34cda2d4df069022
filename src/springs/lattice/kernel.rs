//! One step over a slab of planes, row by row, each spring once.
//!
//! A row of points along x lies as three runs of numbers, x, y and z. A row acts with the rows after it: the next one of its
//! plane and one or three of the plane above. What it does to them waits in two planes of forces, which stay in the cache;
//! when a row's turn comes, all rows before it have acted on it, and its points move. So positions are read once
//! and written once.

use super::lanes::{InLanes, Lanes, Number};

/// Springs of one direction: force over the vector of a spring is `stiffness - tension / length`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Spring<F> {
    /// D.
    pub stiffness: F,
    /// D l0.
    pub tension: F,
}

/// Springs of one direction that also goes along x: none at the last point of a row and after it.
#[derive(Clone, Debug)]
pub(super) struct Sloped<F> {
    pub stiffness: Vec<F>,
    pub tension: Vec<F>,
}

/// What does not change from step to step.
#[derive(Clone, Debug)]
pub(super) struct Frame<F> {
    /// Rows a plane, and planes.
    pub rows: [usize; 2],
    /// Numbers of a run: points along x and what fills it up.
    pub run: usize,
    /// Whether springs go to all 26 neighbours.
    pub diagonal: bool,
    /// Directions y, z, yz.
    pub straight: [Spring<F>; 3],
    /// Directions x, xy, xz, xyz.
    pub sloped: [Sloped<F>; 4],
    /// 1 - c dt / m.
    pub kept: F,
    /// dt^2 / m, or 0 for what is pinned: a run for each pattern of pinned points that occurs.
    pub patterns: Vec<F>,
    /// The pattern of each row.
    pub pattern: Vec<u32>,
    /// External forces as positions lie, or nothing.
    pub external: Vec<F>,
}

impl<F> Frame<F> {
    /// Numbers of a row.
    pub fn row(&self) -> usize {
        3 * self.run
    }
    /// Numbers of a plane.
    pub fn plane(&self) -> usize {
        self.rows[0] * self.row()
    }
}

/// Forces on two planes: the one whose turn it is and the next one.
#[derive(Clone, Debug, Default)]
pub(super) struct Carried<F> {
    now: Vec<F>,
    next: Vec<F>,
}

impl<F: Number> Carried<F> {
    pub fn clear(&mut self, frame: &Frame<F>) {
        for plane in [&mut self.now, &mut self.next] {
            plane.clear();
            plane.resize(frame.plane(), F::default());
        }
    }
}

/// The largest squared move of a point, and a sum that is not finite if one move was not.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Moved {
    pub largest: f64,
    pub sum: f64,
}

impl Moved {
    pub fn and(self, other: Self) -> Self {
        Self { largest: self.largest.max(other.largest), sum: self.sum + other.sum }
    }
}

/// One step of the planes from `first` on, as many as `previous` holds. `current` is of all planes.
pub(super) struct Slab<'a, F> {
    pub frame: &'a Frame<F>,
    pub current: &'a [F],
    pub previous: &'a mut [F],
    pub first: usize,
    pub carried: &'a mut Carried<F>,
}

impl<F: Number> InLanes<F> for Slab<'_, F> {
    type Output = Moved;

    #[inline(always)]
    fn run<L: Lanes<F>>(self, machine: L::Machine) -> Moved {
        let Self { frame, current, previous, first, carried } = self;
        carried.clear(frame);
        let mut moved = Moved::default();
        if first > 0 {
            // What the plane below does to the first one, in the order in which it always does.
            act_upwards::<F, L>(machine, frame, current, first - 1, carried);
            carried.now.fill(F::default());
            std::mem::swap(&mut carried.now, &mut carried.next);
        }
        for (k, plane) in previous.chunks_exact_mut(frame.plane()).enumerate() {
            moved = moved.and(step_plane::<F, L>(machine, frame, current, plane, first + k, carried));
        }
        moved
    }
}

/// The row `j` of plane `k`, and the number after it.
#[inline(always)]
fn row<'a, F>(frame: &Frame<F>, current: &'a [F], j: usize, k: usize) -> &'a [F] {
    let begin = (k * frame.rows[0] + j) * frame.row();
    &current[begin..=begin + frame.row()]
}

/// One step of a plane, all planes below having acted on it.
#[inline(always)]
fn step_plane<F: Number, L: Lanes<F>>(
    machine: L::Machine,
    frame: &Frame<F>,
    current: &[F],
    previous: &mut [F],
    k: usize,
    carried: &mut Carried<F>,
) -> Moved {
    let length = frame.row();
    let [straight, _, _] = frame.straight;
    let mut moved = Moved::default();
    for j in 0..frame.rows[0] {
        let here = row(frame, current, j, k);
        if j + 1 < frame.rows[0] {
            let (a, b) = carried.now.split_at_mut((j + 1) * length);
            let (a, b) = (&mut a[j * length..], &mut b[..length]);
            let there = row(frame, current, j + 1, k);
            pair::<F, L>(machine, frame, [here, there], [a, b], straight, &frame.sloped[1]);
        }
        act_upwards_row::<F, L>(machine, frame, current, [j, k], carried);
        let now = &mut carried.now[j * length..][..length];
        let previous = &mut previous[j * length..][..length];
        moved = moved.and(finish::<F, L>(machine, frame, here, previous, now, k * frame.rows[0] + j));
    }
    std::mem::swap(&mut carried.now, &mut carried.next);
    moved
}

#[inline(always)]
fn act_upwards<F: Number, L: Lanes<F>>(
    machine: L::Machine,
    frame: &Frame<F>,
    current: &[F],
    k: usize,
    carried: &mut Carried<F>,
) {
    for j in 0..frame.rows[0] {
        act_upwards_row::<F, L>(machine, frame, current, [j, k], carried);
    }
}

/// What row `j` of plane `k` does with the rows above it.
#[inline(always)]
fn act_upwards_row<F: Number, L: Lanes<F>>(
    machine: L::Machine,
    frame: &Frame<F>,
    current: &[F],
    [j, k]: [usize; 2],
    carried: &mut Carried<F>,
) {
    if k + 1 == frame.rows[1] {
        return;
    }
    let length = frame.row();
    let here = row(frame, current, j, k);
    let a = &mut carried.now[j * length..][..length];
    let others = if frame.diagonal { j.saturating_sub(1)..(j + 2).min(frame.rows[0]) } else { j..j + 1 };
    for other in others {
        let kind = if other == j { 1 } else { 2 };
        let (straight, sloped) = (frame.straight[kind], &frame.sloped[kind + 1]);
        let b = &mut carried.next[other * length..][..length];
        let there = row(frame, current, other, k + 1);
        pair::<F, L>(machine, frame, [here, there], [a, b], straight, sloped);
    }
}

/// The springs between two rows: straight ones, and sloped ones where there are 26 neighbours.
#[inline(always)]
fn pair<F: Number, L: Lanes<F>>(
    machine: L::Machine,
    frame: &Frame<F>,
    at: [&[F]; 2],
    forces: [&mut [F]; 2],
    straight: Spring<F>,
    sloped: &Sloped<F>,
) {
    if frame.diagonal {
        three_springs::<F, L>(machine, frame.run, at, forces, straight, sloped);
    } else {
        one_spring::<F, L>(machine, frame.run, at, forces, straight);
    }
}

/// Chunks of the three runs of a row from `shift` on.
macro_rules! runs {
    ($lanes:ty, $row:expr, $run:expr, $shift:expr) => {{
        let (row, run) = ($row, $run);
        let x = <$lanes>::chunks(&row[$shift..$shift + run]);
        let y = <$lanes>::chunks(&row[run + $shift..$shift + 2 * run]);
        let z = <$lanes>::chunks(&row[2 * run + $shift..$shift + 3 * run]);
        // Known to be equal, so that no index is looked at in the loop.
        (x, &y[..x.len()], &z[..x.len()])
    }};
}

macro_rules! runs_mut {
    ($lanes:ty, $row:expr, $run:expr, $count:expr) => {{
        let (x, rest) = $row.split_at_mut($run);
        let (y, z) = rest.split_at_mut($run);
        let (x, y, z) = (<$lanes>::chunks_mut(x), <$lanes>::chunks_mut(y), <$lanes>::chunks_mut(z));
        (&mut x[..$count], &mut y[..$count], &mut z[..$count])
    }};
}

/// The force that a spring along `d` exerts on its first end, over `d`.
#[inline(always)]
fn pull<F: Number, L: Lanes<F>>(machine: L::Machine, d: [L; 3], stiffness: L, tension: L) -> L {
    let squared = d[2].mul_add(d[2], d[1].mul_add(d[1], d[0].mul(d[0])));
    tension.mul_sub_from(squared.reciprocal_root(machine), stiffness)
}

#[inline(always)]
fn times<F: Number, L: Lanes<F>>(d: [L; 3], by: L) -> [L; 3] {
    [d[0].mul(by), d[1].mul(by), d[2].mul(by)]
}

/// `plus + d * by`.
#[inline(always)]
fn plus<F: Number, L: Lanes<F>>(plus: [L; 3], d: [L; 3], by: L) -> [L; 3] {
    [d[0].mul_add(by, plus[0]), d[1].mul_add(by, plus[1]), d[2].mul_add(by, plus[2])]
}

/// `from - d * by`.
#[inline(always)]
fn less<F: Number, L: Lanes<F>>(from: [L; 3], d: [L; 3], by: L) -> [L; 3] {
    [d[0].mul_sub_from(by, from[0]), d[1].mul_sub_from(by, from[1]), d[2].mul_sub_from(by, from[2])]
}

#[inline(always)]
fn sub<F: Number, L: Lanes<F>>(a: [L; 3], b: [L; 3]) -> [L; 3] {
    [a[0].sub(b[0]), a[1].sub(b[1]), a[2].sub(b[2])]
}

#[inline(always)]
fn add<F: Number, L: Lanes<F>>(a: [L; 3], b: [L; 3]) -> [L; 3] {
    [a[0].add(b[0]), a[1].add(b[1]), a[2].add(b[2])]
}

#[inline(always)]
fn moved_up<F: Number, L: Lanes<F>>(a: [L; 3], before: [L; 3]) -> [L; 3] {
    [a[0].moved_up(before[0]), a[1].moved_up(before[1]), a[2].moved_up(before[2])]
}

macro_rules! load {
    ($machine:expr, $from:ident, $c:expr) => {
        [L::load($machine, &$from.0[$c]), L::load($machine, &$from.1[$c]), L::load($machine, &$from.2[$c])]
    };
}

macro_rules! store {
    ($to:ident, $c:expr, $value:expr) => {{
        let [x, y, z] = $value;
        $to.0[$c] = x.store();
        $to.1[$c] = y.store();
        $to.2[$c] = z.store();
    }};
}

#[inline(always)]
fn one_spring<F: Number, L: Lanes<F>>(
    machine: L::Machine,
    run: usize,
    [a, b]: [&[F]; 2],
    [on_a, on_b]: [&mut [F]; 2],
    spring: Spring<F>,
) {
    let (a, b) = (runs!(L, a, run, 0), runs!(L, b, run, 0));
    let count = a.0.len();
    let (on_a, on_b) = (runs_mut!(L, on_a, run, count), runs_mut!(L, on_b, run, count));
    let (stiffness, tension) = (L::splat(machine, spring.stiffness), L::splat(machine, spring.tension));
    let b = (&b.0[..count], &b.1[..count], &b.2[..count]);
    for c in 0..count {
        let d = sub::<F, L>(load!(machine, b, c), load!(machine, a, c));
        let by = pull::<F, L>(machine, d, stiffness, tension);
        store!(on_a, c, plus::<F, L>(load!(machine, on_a, c), d, by));
        store!(on_b, c, less::<F, L>(load!(machine, on_b, c), d, by));
    }
}

/// From each point to the one opposite, to the one after that, and from the point after it to the one opposite.
#[inline(always)]
fn three_springs<F: Number, L: Lanes<F>>(
    machine: L::Machine,
    run: usize,
    [a, b]: [&[F]; 2],
    [on_a, on_b]: [&mut [F]; 2],
    spring: Spring<F>,
    sloped: &Sloped<F>,
) {
    let (a_next, b_next) = (runs!(L, a, run, 1), runs!(L, b, run, 1));
    let (a, b) = (runs!(L, a, run, 0), runs!(L, b, run, 0));
    let count = a.0.len();
    let (on_a, on_b) = (runs_mut!(L, on_a, run, count), runs_mut!(L, on_b, run, count));
    let (stiffness, tension) = (L::splat(machine, spring.stiffness), L::splat(machine, spring.tension));
    let (sloped_stiffness, sloped_tension) =
        (&L::chunks(&sloped.stiffness)[..count], &L::chunks(&sloped.tension)[..count]);
    let b = (&b.0[..count], &b.1[..count], &b.2[..count]);
    let a_next = (&a_next.0[..count], &a_next.1[..count], &a_next.2[..count]);
    let b_next = (&b_next.0[..count], &b_next.1[..count], &b_next.2[..count]);
    let zero = L::splat(machine, F::default());
    let mut before = [[zero; 3]; 2];
    for c in 0..count {
        let (at_a, at_b) = (load!(machine, a, c), load!(machine, b, c));
        let opposite = sub::<F, L>(at_b, at_a);
        let by = pull::<F, L>(machine, opposite, stiffness, tension);
        let (stiffness, tension) = (L::load(machine, &sloped_stiffness[c]), L::load(machine, &sloped_tension[c]));
        let after = sub::<F, L>(load!(machine, b_next, c), at_a);
        let after = times::<F, L>(after, pull::<F, L>(machine, after, stiffness, tension));
        let back = sub::<F, L>(at_b, load!(machine, a_next, c));
        let back = times::<F, L>(back, pull::<F, L>(machine, back, stiffness, tension));
        let sum = add::<F, L>(after, moved_up::<F, L>(back, before[0]));
        store!(on_a, c, plus::<F, L>(add::<F, L>(load!(machine, on_a, c), sum), opposite, by));
        let sum = add::<F, L>(back, moved_up::<F, L>(after, before[1]));
        store!(on_b, c, less::<F, L>(sub::<F, L>(load!(machine, on_b, c), sum), opposite, by));
        before = [back, after];
    }
}

/// The springs along a row, and its points' move; forces are left at zero.
#[inline(always)]
fn finish<F: Number, L: Lanes<F>>(
    machine: L::Machine,
    frame: &Frame<F>,
    here: &[F],
    previous: &mut [F],
    forces: &mut [F],
    index: usize,
) -> Moved {
    let run = frame.run;
    let (a_next, a) = (runs!(L, here, run, 1), runs!(L, here, run, 0));
    let count = a.0.len();
    let a_next = (&a_next.0[..count], &a_next.1[..count], &a_next.2[..count]);
    let (previous, forces) = (runs_mut!(L, previous, run, count), runs_mut!(L, forces, run, count));
    let pattern = frame.pattern[index] as usize;
    let gain = &L::chunks(&frame.patterns[pattern * run..][..run])[..count];
    let sloped = &frame.sloped[0];
    let (stiffness, tension) = (&L::chunks(&sloped.stiffness)[..count], &L::chunks(&sloped.tension)[..count]);
    let external = if frame.external.is_empty() { None } else { Some(&frame.external[3 * run * index..][..3 * run]) };
    let (zero, kept) = (L::splat(machine, F::default()), L::splat(machine, frame.kept));
    let (mut before, mut largest, mut sum) = ([zero; 3], zero, zero);
    for c in 0..count {
        let at = load!(machine, a, c);
        let d = sub::<F, L>(load!(machine, a_next, c), at);
        let along = pull::<F, L>(machine, d, L::load(machine, &stiffness[c]), L::load(machine, &tension[c]));
        let along = times::<F, L>(d, along);
        let mut total = add::<F, L>(load!(machine, forces, c), sub::<F, L>(along, moved_up::<F, L>(along, before)));
        before = along;
        store!(forces, c, [zero; 3]);
        if let Some(external) = external {
            let e = runs!(L, external, run, 0);
            total = add::<F, L>(total, load!(machine, e, c));
        }
        let gain = L::load(machine, &gain[c]);
        let v = sub::<F, L>(at, load!(machine, previous, c));
        let step = [
            total[0].mul_add(gain, v[0].mul(kept)),
            total[1].mul_add(gain, v[1].mul(kept)),
            total[2].mul_add(gain, v[2].mul(kept)),
        ];
        store!(previous, c, add::<F, L>(at, step));
        let squared = step[2].mul_add(step[2], step[1].mul_add(step[1], step[0].mul(step[0])));
        largest = squared.max(largest);
        sum = sum.add(squared);
    }
    Moved { largest: greatest::<F, L>(largest), sum: total::<F, L>(sum) }
}

#[inline(always)]
fn greatest<F: Number, L: Lanes<F>>(lanes: L) -> f64 {
    let chunk = [lanes.store()];
    let mut all = 0.0;
    for &value in L::numbers(&chunk) {
        let value = value.to_f64();
        all = if value > all { value } else { all };
    }
    all
}

#[inline(always)]
fn total<F: Number, L: Lanes<F>>(lanes: L) -> f64 {
    let chunk = [lanes.store()];
    let mut all = 0.0;
    for &value in L::numbers(&chunk) {
        all += value.to_f64();
    }
    all
}
