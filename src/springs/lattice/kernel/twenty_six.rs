//! Rows of points with 26 neighbours: three springs from each point to each of four rows, and one along its own.

use super::{
    Carried, Frame, Motion, Moved, Plane, Sloped, Spring, add, counted, less, load, moved_up, plus,
    pull, runs, runs_mut, store, sub, times,
};
use crate::simd::{FusedLane, Number};

#[inline(always)]
pub(super) fn step_plane<F: Number, L: FusedLane<F>>(
    machine: L::Machine,
    frame: &Frame<F>,
    plane: Plane<F>,
    previous: &mut [F],
    carried: &mut Carried<F>,
) -> Moved {
    let length = frame.row();
    let mut moved = Moved::default();
    for j in 0..frame.rows {
        let here = frame.row_of(plane.here, j);
        if j + 1 < frame.rows {
            let (a, b) = carried.now.split_at_mut((j + 1) * length);
            let forces = [&mut a[j * length..], &mut b[..length]];
            let rows = [here, frame.row_of(plane.here, j + 1)];
            act::<F, L>(
                machine,
                frame.run,
                rows,
                forces,
                frame.straight[0],
                &frame.sloped[1],
            );
        }
        if let Some(above) = plane.above {
            act_upwards_row::<F, L>(machine, frame, [plane.here, above], j, carried);
        }
        let now = &mut carried.now[j * length..][..length];
        let motion = Motion::<F, L>::new(machine, frame, [j, plane.number], previous);
        moved = moved.and(finish::<F, L>(machine, frame, here, now, motion));
    }
    std::mem::swap(&mut carried.now, &mut carried.next);
    moved
}

#[inline(always)]
pub(super) fn act_upwards<F: Number, L: FusedLane<F>>(
    machine: L::Machine,
    frame: &Frame<F>,
    planes: [&[F]; 2],
    carried: &mut Carried<F>,
) {
    for j in 0..frame.rows {
        act_upwards_row::<F, L>(machine, frame, planes, j, carried);
    }
    // What it does to itself was counted when it was its turn.
    carried.now.fill(F::default());
    std::mem::swap(&mut carried.now, &mut carried.next);
}

/// What row `j` of a plane does with the rows above it.
#[inline(always)]
fn act_upwards_row<F: Number, L: FusedLane<F>>(
    machine: L::Machine,
    frame: &Frame<F>,
    [here, above]: [&[F]; 2],
    j: usize,
    carried: &mut Carried<F>,
) {
    let length = frame.row();
    for other in j.saturating_sub(1)..(j + 2).min(frame.rows) {
        let kind = if other == j { 1 } else { 2 };
        let (straight, sloped) = (frame.straight[kind], &frame.sloped[kind + 1]);
        let forces = [
            &mut carried.now[j * length..][..length],
            &mut carried.next[other * length..][..length],
        ];
        let rows = [frame.row_of(here, j), frame.row_of(above, other)];
        act::<F, L>(machine, frame.run, rows, forces, straight, sloped);
    }
}

/// The springs between two rows: from each point to the one opposite, to the one after that, and from the point after it to
/// the one opposite.
#[inline(always)]
fn act<F: Number, L: FusedLane<F>>(
    machine: L::Machine,
    run: usize,
    [a, b]: [&[F]; 2],
    [on_a, on_b]: [&mut [F]; 2],
    spring: Spring<F>,
    sloped: &Sloped<F>,
) {
    let a_next = runs!(L, a, run, 1);
    let count = a_next.0.len();
    let a = counted!(L, a, run, 0, count);
    let (b, b_next) = (counted!(L, b, run, 0, count), counted!(L, b, run, 1, count));
    let (on_a, on_b) = (
        runs_mut!(L, on_a, run, count),
        runs_mut!(L, on_b, run, count),
    );
    let (stiffness, tension) = (
        L::splat(machine, spring.stiffness),
        L::splat(machine, spring.tension),
    );
    let (sloped_stiffness, sloped_tension) = (
        &L::chunks(&sloped.stiffness)[..count],
        &L::chunks(&sloped.tension)[..count],
    );
    let zero = L::splat(machine, F::default());
    let mut before = [[zero; 3]; 2];
    for c in 0..count {
        let (at_a, at_b) = (load!(machine, a, c), load!(machine, b, c));
        let opposite = sub::<F, L>(at_b, at_a);
        let by = pull::<F, L>(machine, opposite, stiffness, tension);
        let (stiffness, tension) = (
            L::load(machine, &sloped_stiffness[c]),
            L::load(machine, &sloped_tension[c]),
        );
        let after = sub::<F, L>(load!(machine, b_next, c), at_a);
        let after = times::<F, L>(after, pull::<F, L>(machine, after, stiffness, tension));
        let back = sub::<F, L>(at_b, load!(machine, a_next, c));
        let back = times::<F, L>(back, pull::<F, L>(machine, back, stiffness, tension));
        let sum = add::<F, L>(after, moved_up::<F, L>(back, before[0]));
        store!(
            on_a,
            c,
            plus::<F, L>(add::<F, L>(load!(machine, on_a, c), sum), opposite, by)
        );
        let sum = add::<F, L>(back, moved_up::<F, L>(after, before[1]));
        store!(
            on_b,
            c,
            less::<F, L>(sub::<F, L>(load!(machine, on_b, c), sum), opposite, by)
        );
        before = [back, after];
    }
}

/// The springs along a row, and its points' move; forces are left at zero.
#[inline(always)]
fn finish<F: Number, L: FusedLane<F>>(
    machine: L::Machine,
    frame: &Frame<F>,
    here: &[F],
    forces: &mut [F],
    mut motion: Motion<F, L>,
) -> Moved {
    let run = frame.run;
    let here_next = runs!(L, here, run, 1);
    let count = here_next.0.len();
    let here = counted!(L, here, run, 0, count);
    let forces = runs_mut!(L, forces, run, count);
    let sloped = &frame.sloped[0];
    let (stiffness, tension) = (
        &L::chunks(&sloped.stiffness)[..count],
        &L::chunks(&sloped.tension)[..count],
    );
    let zero = L::splat(machine, F::default());
    let mut before = [zero; 3];
    for c in 0..count {
        let at = load!(machine, here, c);
        let d = sub::<F, L>(load!(machine, here_next, c), at);
        let along = pull::<F, L>(
            machine,
            d,
            L::load(machine, &stiffness[c]),
            L::load(machine, &tension[c]),
        );
        let along = times::<F, L>(d, along);
        let total = add::<F, L>(
            load!(machine, forces, c),
            sub::<F, L>(along, moved_up::<F, L>(along, before)),
        );
        before = along;
        store!(forces, c, [zero; 3]);
        motion.advance(c, at, total);
    }
    motion.moved()
}
