//! One step of a plane of points, row by row, with each spring computed once.
//!
//! A row of points along x is stored as three runs of numbers: x, y and z. A row acts only on later
//! rows: the next one of its plane and one or three of the plane above. Their forces are stored in
//! one or two planes, which stay in the cache. When a row is processed, all earlier rows have acted
//! on it, and its points move. Positions are thus read once and written once.

mod six;
mod twenty_six;

use crate::simd::{FusedLane, Number};

/// Springs of one direction: force over the vector of a spring is `stiffness - tension / length`.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Spring<F> {
    /// D.
    pub stiffness: F,
    /// D l0.
    pub tension: F,
}

/// Springs of one direction with a component along x: zero at and after the last point of a row.
#[derive(Clone, Debug)]
pub(super) struct Sloped<F> {
    pub stiffness: Vec<F>,
    pub tension: Vec<F>,
}

/// Constant data of all steps.
#[derive(Clone, Debug)]
pub(super) struct Frame<F> {
    /// Number of rows per plane.
    pub rows: usize,
    /// Length of a run: points along x and padding.
    pub run: usize,
    /// True if springs go to more than the 6 nearest neighbours.
    pub diagonal: bool,
    /// Directions y, z, yz.
    pub straight: [Spring<F>; 3],
    /// Directions x, xy, xz, xyz.
    pub sloped: [Sloped<F>; 4],
    /// 1 - c dt / m.
    pub kept: F,
    /// dt^2 / m, or 0 for pinned points: one run for each pattern of pinned points that occurs.
    pub patterns: Vec<F>,
    /// The pattern of each row.
    pub pattern: Vec<u32>,
    /// External forces in the layout of positions, or empty.
    pub external: Vec<F>,
}

impl<F: Number> Frame<F> {
    /// Numbers of a row.
    pub fn row(&self) -> usize {
        3 * self.run
    }

    /// Length of a plane; the numbers after its last row are read with it, but not used.
    pub fn plane(&self) -> usize {
        self.rows * self.row() + F::ROW
    }

    /// Row `j` of a plane, and the number after it.
    fn row_of<'a>(&self, plane: &'a [F], j: usize) -> &'a [F] {
        &plane[j * self.row()..=(j + 1) * self.row()]
    }
}

/// Stored forces on later rows.
#[derive(Clone, Debug, Default)]
pub(super) struct Carried<F> {
    /// Forces on the present plane.
    now: Vec<F>,
    /// With 26 neighbours, forces on the next plane; with 6, on the next row.
    next: Vec<F>,
}

impl<F: Number> Carried<F> {
    /// Sets all forces to zero.
    pub fn clear(&mut self, frame: &Frame<F>) {
        let next = if frame.diagonal {
            frame.plane()
        } else {
            frame.row()
        };
        for (forces, length) in [(&mut self.now, frame.plane()), (&mut self.next, next)] {
            forces.clear();
            forces.resize(length, F::default());
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
        Self {
            largest: self.largest.max(other.largest),
            sum: self.sum + other.sum,
        }
    }
}

/// A plane of points, its index, and the plane above if any.
#[derive(Clone, Copy)]
pub(super) struct Plane<'a, F> {
    pub number: usize,
    pub here: &'a [F],
    pub above: Option<&'a [F]>,
}

/// One step of a plane after all planes below have acted on it: replaces previous positions by new
/// ones.
#[inline(always)]
pub(super) fn step_plane<F: Number, L: FusedLane<F>>(
    machine: L::Machine,
    frame: &Frame<F>,
    plane: Plane<F>,
    previous: &mut [F],
    carried: &mut Carried<F>,
) -> Moved {
    if frame.diagonal {
        twenty_six::step_plane::<F, L>(machine, frame, plane, previous, carried)
    } else {
        six::step_plane::<F, L>(machine, frame, plane, previous, carried)
    }
}

/// The effect of a plane on the plane above, always in the same order.
#[inline(always)]
pub(super) fn act_upwards<F: Number, L: FusedLane<F>>(
    machine: L::Machine,
    frame: &Frame<F>,
    [here, above]: [&[F]; 2],
    carried: &mut Carried<F>,
) {
    carried.clear(frame);
    if frame.diagonal {
        twenty_six::act_upwards::<F, L>(machine, frame, [here, above], carried);
    } else {
        six::act_upwards::<F, L>(machine, frame, [here, above], carried);
    }
}

/// Chunks of the three runs of a row from offset `shift`.
macro_rules! runs {
    ($lanes:ty, $row:expr, $run:expr, $shift:expr) => {{
        let (row, run) = ($row, $run);
        let x = <$lanes>::chunks(&row[$shift..$shift + run]);
        let y = <$lanes>::chunks(&row[run + $shift..$shift + 2 * run]);
        let z = <$lanes>::chunks(&row[2 * run + $shift..$shift + 3 * run]);
        // Equal lengths, so that the loop needs no bounds checks.
        (x, &y[..x.len()], &z[..x.len()])
    }};
}

/// The same for a row with a constant number of chunks.
macro_rules! counted {
    ($lanes:ty, $row:expr, $run:expr, $shift:expr, $count:expr) => {{
        let (x, y, z) = runs!($lanes, $row, $run, $shift);
        (&x[..$count], &y[..$count], &z[..$count])
    }};
}

macro_rules! runs_mut {
    ($lanes:ty, $row:expr, $run:expr, $count:expr) => {{
        let (x, rest) = $row.split_at_mut($run);
        let (y, z) = rest.split_at_mut($run);
        let (x, y, z) = (
            <$lanes>::chunks_mut(x),
            <$lanes>::chunks_mut(y),
            <$lanes>::chunks_mut(z),
        );
        (&mut x[..$count], &mut y[..$count], &mut z[..$count])
    }};
}

macro_rules! load {
    ($machine:expr, $from:ident, $c:expr) => {
        [
            L::load($machine, &$from.0[$c]),
            L::load($machine, &$from.1[$c]),
            L::load($machine, &$from.2[$c]),
        ]
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
use {counted, load, runs, runs_mut, store};

/// The force of a spring along `d` on its first end, divided by `d`.
#[inline(always)]
fn pull<F: Number, L: FusedLane<F>>(machine: L::Machine, d: [L; 3], stiffness: L, tension: L) -> L {
    let squared = d[2].mul_add(d[2], d[1].mul_add(d[1], d[0].mul(d[0])));
    tension.mul_sub_from(squared.reciprocal_root(machine), stiffness)
}

#[inline(always)]
fn times<F: Number, L: FusedLane<F>>(d: [L; 3], by: L) -> [L; 3] {
    [d[0].mul(by), d[1].mul(by), d[2].mul(by)]
}

/// `plus + d * by`.
#[inline(always)]
fn plus<F: Number, L: FusedLane<F>>(plus: [L; 3], d: [L; 3], by: L) -> [L; 3] {
    [
        d[0].mul_add(by, plus[0]),
        d[1].mul_add(by, plus[1]),
        d[2].mul_add(by, plus[2]),
    ]
}

/// `from - d * by`.
#[inline(always)]
fn less<F: Number, L: FusedLane<F>>(from: [L; 3], d: [L; 3], by: L) -> [L; 3] {
    [
        d[0].mul_sub_from(by, from[0]),
        d[1].mul_sub_from(by, from[1]),
        d[2].mul_sub_from(by, from[2]),
    ]
}

#[inline(always)]
fn sub<F: Number, L: FusedLane<F>>(a: [L; 3], b: [L; 3]) -> [L; 3] {
    [a[0].sub(b[0]), a[1].sub(b[1]), a[2].sub(b[2])]
}

#[inline(always)]
fn add<F: Number, L: FusedLane<F>>(a: [L; 3], b: [L; 3]) -> [L; 3] {
    [a[0].add(b[0]), a[1].add(b[1]), a[2].add(b[2])]
}

#[inline(always)]
fn moved_up<F: Number, L: FusedLane<F>>(a: [L; 3], before: [L; 3]) -> [L; 3] {
    [
        a[0].moved_up(before[0]),
        a[1].moved_up(before[1]),
        a[2].moved_up(before[2]),
    ]
}

/// The chunks of the three runs of a row.
type Runs<'a, C> = (&'a [C], &'a [C], &'a [C]);
type RunsMut<'a, C> = (&'a mut [C], &'a mut [C], &'a mut [C]);

/// Motion of the points of a row.
struct Motion<'a, F: Number, L: FusedLane<F>> {
    machine: L::Machine,
    /// dt^2 / m, or 0.
    gain: &'a [L::Chunk],
    external: Option<Runs<'a, L::Chunk>>,
    previous: RunsMut<'a, L::Chunk>,
    kept: L,
    /// Largest squared moves.
    largest: L,
    sum: L,
}

impl<'a, F: Number, L: FusedLane<F>> Motion<'a, F, L> {
    /// Motion of row `j` of plane `k`.
    #[inline(always)]
    fn new(
        machine: L::Machine,
        frame: &'a Frame<F>,
        [j, k]: [usize; 2],
        previous: &'a mut [F],
    ) -> Self {
        let (run, row) = (frame.run, frame.row());
        let pattern = frame.pattern[k * frame.rows + j] as usize;
        let gain = L::chunks(&frame.patterns[pattern * run..][..run]);
        let count = gain.len();
        let external = if frame.external.is_empty() {
            None
        } else {
            let external = &frame.external[k * frame.plane() + j * row..][..row];
            Some(counted!(L, external, run, 0, count))
        };
        let previous = &mut previous[j * row..][..row];
        let zero = L::splat(machine, F::default());
        let kept = L::splat(machine, frame.kept);
        Self {
            machine,
            gain,
            external,
            previous: runs_mut!(L, previous, run, count),
            kept,
            largest: zero,
            sum: zero,
        }
    }

    /// Moves the points of chunk `c` by their force.
    #[inline(always)]
    fn advance(&mut self, c: usize, at: [L; 3], mut force: [L; 3]) {
        let (machine, previous) = (self.machine, &mut self.previous);
        if let Some(external) = self.external {
            force = add::<F, L>(force, load!(machine, external, c));
        }
        let gain = L::load(machine, &self.gain[c]);
        let v = sub::<F, L>(at, load!(machine, previous, c));
        let step = [
            force[0].mul_add(gain, v[0].mul(self.kept)),
            force[1].mul_add(gain, v[1].mul(self.kept)),
            force[2].mul_add(gain, v[2].mul(self.kept)),
        ];
        store!(previous, c, add::<F, L>(at, step));
        let squared = step[2].mul_add(step[2], step[1].mul_add(step[1], step[0].mul(step[0])));
        self.largest = squared.max(self.largest);
        self.sum = self.sum.add(squared);
    }

    /// The result of the motion.
    #[inline(always)]
    fn moved(self) -> Moved {
        Moved {
            largest: greatest::<F, L>(self.largest),
            sum: total::<F, L>(self.sum),
        }
    }
}

#[inline(always)]
fn greatest<F: Number, L: FusedLane<F>>(lanes: L) -> f64 {
    let chunk = [lanes.store()];
    let mut all = 0.0;
    for &value in L::numbers(&chunk) {
        let value = value.to_f64();
        all = if value > all { value } else { all };
    }
    all
}

#[inline(always)]
fn total<F: Number, L: FusedLane<F>>(lanes: L) -> f64 {
    let chunk = [lanes.store()];
    let mut all = 0.0;
    for &value in L::numbers(&chunk) {
        all += value.to_f64();
    }
    all
}
