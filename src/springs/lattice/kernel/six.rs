//! Rows of points with 6 neighbours: a row's springs and its move in one go, each force carried once.

use super::{
    Carried, Frame, Motion, Moved, Plane, Spring, add, counted, load, moved_up, pull, runs,
    runs_mut, store, sub, times,
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
    let [along_y, along_z, _] = frame.straight;
    let mut moved = Moved::default();
    carried.next.fill(F::default());
    for j in 0..frame.rows {
        let here = frame.row_of(plane.here, j);
        // Where there is no row, springs without stiffness go to this one.
        let last = j + 1 == frame.rows;
        let beside = if last {
            here
        } else {
            frame.row_of(plane.here, j + 1)
        };
        let above = plane.above.map_or(here, |above| frame.row_of(above, j));
        let along_y = if last { Spring::default() } else { along_y };
        let along_z = if plane.above.is_none() {
            Spring::default()
        } else {
            along_z
        };
        let motion = Motion::<F, L>::new(machine, frame, [j, plane.number], previous);
        let forces = [
            &mut carried.next[..],
            &mut carried.now[j * length..][..length],
        ];
        moved = moved.and(step_row::<F, L>(
            machine,
            frame,
            [here, beside, above],
            [along_y, along_z],
            forces,
            motion,
        ));
    }
    moved
}

#[inline(always)]
pub(super) fn act_upwards<F: Number, L: FusedLane<F>>(
    machine: L::Machine,
    frame: &Frame<F>,
    [here, above]: [&[F]; 2],
    carried: &mut Carried<F>,
) {
    let (run, length) = (frame.run, frame.row());
    let along_z = splat::<F, L>(machine, frame.straight[1]);
    for j in 0..frame.rows {
        let a = runs!(L, frame.row_of(here, j), run, 0);
        let count = a.0.len();
        let b = counted!(L, frame.row_of(above, j), run, 0, count);
        let forces = &mut carried.now[j * length..][..length];
        let forces = runs_mut!(L, forces, run, count);
        for c in 0..count {
            store!(
                forces,
                c,
                force::<F, L>(
                    machine,
                    [load!(machine, a, c), load!(machine, b, c)],
                    along_z
                )
            );
        }
    }
}

/// One step of a row. `forces` are those of the springs to the row before it and from below, on their first ends; they become those
/// to the row after it and to above.
#[inline(always)]
fn step_row<F: Number, L: FusedLane<F>>(
    machine: L::Machine,
    frame: &Frame<F>,
    [here, beside, above]: [&[F]; 3],
    [along_y, along_z]: [Spring<F>; 2],
    [from_beside, from_below]: [&mut [F]; 2],
    mut motion: Motion<F, L>,
) -> Moved {
    let run = frame.run;
    let here_next = runs!(L, here, run, 1);
    let count = here_next.0.len();
    let here = counted!(L, here, run, 0, count);
    let (beside, above) = (
        counted!(L, beside, run, 0, count),
        counted!(L, above, run, 0, count),
    );
    let from_beside = runs_mut!(L, from_beside, run, count);
    let from_below = runs_mut!(L, from_below, run, count);
    let sloped = &frame.sloped[0];
    let (stiffness, tension) = (
        &L::chunks(&sloped.stiffness)[..count],
        &L::chunks(&sloped.tension)[..count],
    );
    let [along_y, along_z] = [
        splat::<F, L>(machine, along_y),
        splat::<F, L>(machine, along_z),
    ];
    let mut before = [L::splat(machine, F::default()); 3];
    for c in 0..count {
        let at = load!(machine, here, c);
        let along_x = [
            L::load(machine, &stiffness[c]),
            L::load(machine, &tension[c]),
        ];
        let x = force::<F, L>(machine, [at, load!(machine, here_next, c)], along_x);
        let y = force::<F, L>(machine, [at, load!(machine, beside, c)], along_y);
        let z = force::<F, L>(machine, [at, load!(machine, above, c)], along_z);
        let on_x = sub::<F, L>(x, moved_up::<F, L>(x, before));
        let on_y = sub::<F, L>(y, load!(machine, from_beside, c));
        let on_z = sub::<F, L>(z, load!(machine, from_below, c));
        before = x;
        store!(from_beside, c, y);
        store!(from_below, c, z);
        motion.advance(c, at, add::<F, L>(add::<F, L>(on_x, on_y), on_z));
    }
    motion.moved()
}

/// Stiffness and tension in all lanes.
#[inline(always)]
fn splat<F: Number, L: FusedLane<F>>(machine: L::Machine, spring: Spring<F>) -> [L; 2] {
    [
        L::splat(machine, spring.stiffness),
        L::splat(machine, spring.tension),
    ]
}

/// The force of springs on their first ends.
#[inline(always)]
fn force<F: Number, L: FusedLane<F>>(
    machine: L::Machine,
    [a, b]: [[L; 3]; 2],
    [stiffness, tension]: [L; 2],
) -> [L; 3] {
    let d = sub::<F, L>(b, a);
    times::<F, L>(d, pull::<F, L>(machine, d, stiffness, tension))
}
