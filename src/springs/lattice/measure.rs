//! Forces, energies and velocities of a lattice, in double precision whatever its numbers are.
//!
//! A step does not need them. They tell how near a lattice is to rest, and how it starts.

use rayon::prelude::*;

use super::kernel::Frame;
use super::stability::{Direction, directions};
use super::{Lattice, LatticeSettings, LatticeShape, Number};
use crate::mesh::measures::max_or_nan;
use crate::mesh::sum::tree_sum;

/// How near a lattice is to rest.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct LatticeMotion {
    /// Greatest force without damping on a free point \[N\].
    pub residual: f64,
    /// Kinetic energy \[J\].
    pub kinetic: f64,
    /// Energy of the springs \[J\].
    pub stored: f64,
}

/// Forces on the points of a row \[N\]: x, y and z.
type RowForces = [Vec<f64>; 3];

/// Present positions of a row \[m\].
type RowPlaces<'a, F> = [&'a [F]; 3];

/// What a plane contributes.
#[derive(Clone, Copy, Default)]
struct Plane {
    residual: f64,
    kinetic: f64,
    stored: f64,
}

/// The present positions, and all directions of springs, there and back.
struct Present<'a, F> {
    lattice: &'a LatticeShape,
    frame: &'a Frame<F>,
    current: &'a [F],
    directions: Vec<Direction>,
}

impl<'a, F: Number> Present<'a, F> {
    fn of(
        lattice: &'a LatticeShape,
        settings: &LatticeSettings,
        frame: &'a Frame<F>,
        current: &'a [F],
    ) -> Self {
        Self {
            lattice,
            frame,
            current,
            directions: both_ways(lattice, settings),
        }
    }

    fn row(&self, j: usize, k: usize) -> RowPlaces<'_, F> {
        let (run, count) = (self.frame.run, self.lattice.points[0]);
        let first = k * self.frame.plane() + j * self.frame.row();
        [0, 1, 2].map(|c| &self.current[first + c * run..first + c * run + count])
    }

    /// Calls `deed` for each row of a plane, with its forces and the energy of its ends of springs.
    fn each_row(&self, k: usize, mut deed: impl FnMut(usize, &RowForces, f64)) {
        let [nx, ny, nz] = self.lattice.points;
        let mut forces: RowForces = [(); 3].map(|()| vec![0.0; nx]);
        let mut energies = vec![0.0; nx];
        for j in 0..ny {
            forces.iter_mut().for_each(|f| f.fill(0.0));
            energies.fill(0.0);
            let own = self.row(j, k);
            for direction in &self.directions {
                let [_, dj, dk] = direction.step;
                let to = |at: usize, by: i32, most: usize| {
                    at.checked_add_signed(by as isize).filter(|n| *n < most)
                };
                if let (Some(j), Some(k)) = (to(j, dj, ny), to(k, dk, nz)) {
                    pull(&own, &self.row(j, k), direction, &mut forces, &mut energies);
                }
            }
            deed(j, &forces, energies.iter().sum());
        }
    }
}

impl<F: Number> Lattice<F> {
    /// Forces and energies now, on the threads of the current `rayon` pool.
    pub(crate) fn motion(&self) -> LatticeMotion {
        let present = self.present();
        let planes = (0..self.shape.points[2]).into_par_iter();
        let planes: Vec<Plane> = planes.map(|k| self.motion_of(k, &present)).collect();
        let sum = |of: fn(&Plane) -> f64| tree_sum(&planes.iter().map(of).collect::<Vec<_>>());
        LatticeMotion {
            residual: max_or_nan(planes.iter().map(|p| p.residual)),
            kinetic: sum(|p| p.kinetic),
            stored: sum(|p| p.stored),
        }
    }

    /// What `of` makes of the velocity of each point \[m/s\]: that of its last step, half a step later.
    pub(crate) fn of_velocities<T: Send>(&self, of: impl Fn([f64; 3]) -> T + Sync) -> Vec<T> {
        let present = self.present();
        let planes = (0..self.shape.points[2]).into_par_iter();
        let (nx, of) = (self.shape.points[0], &of);
        let of_plane = |k: usize| {
            let mut found = Vec::with_capacity(nx * self.shape.points[1]);
            present.each_row(k, |j, forces, _| {
                let first = found.len();
                found.extend((0..nx).map(|_| of([0.0; 3])));
                self.each_free(&present, (j, k), forces, |i, v| found[first + i] = of(v));
            });
            found
        };
        planes.flat_map_iter(of_plane).collect()
    }

    /// Gives the points, which do not move yet, half of the acceleration of a step backwards: the first step is
    /// then of the same order as the others.
    pub(crate) fn start_from_stillness(&mut self) {
        let half = 0.5 * self.time_step * self.time_step / self.settings.mass;
        let present = Present::of(&self.shape, &self.settings, &self.frame, &self.current);
        let ([nx, ny, _], run) = (self.shape.points, self.frame.run);
        let pinned = &self.pinned;
        let planes = self.previous.par_chunks_mut(self.frame.plane()).enumerate();
        planes.for_each(|(k, previous)| {
            present.each_row(k, |j, forces, _| {
                let (own, first) = (present.row(j, k), j * present.frame.row());
                for i in (0..nx).filter(|i| !pinned[(k * ny + j) * nx + i]) {
                    for c in 0..3 {
                        let before = own[c][i].to_f64() + half * forces[c][i];
                        previous[first + c * run + i] = F::from_f64(before);
                    }
                }
            });
        });
    }

    fn present(&self) -> Present<'_, F> {
        Present::of(&self.shape, &self.settings, &self.frame, &self.current)
    }

    /// Calls `deed` with the velocity of each free point of a row, from the forces there.
    fn each_free(
        &self,
        present: &Present<'_, F>,
        (j, k): (usize, usize),
        forces: &RowForces,
        mut deed: impl FnMut(usize, [f64; 3]),
    ) {
        let ([nx, ny, _], run) = (self.shape.points, self.frame.run);
        let first = k * self.frame.plane() + j * self.frame.row();
        let now = present.row(j, k);
        let before = [0, 1, 2].map(|c| &self.previous[first + c * run..][..nx]);
        let forces = forces.each_ref().map(|of| &of[..nx]);
        let pinned = &self.pinned[(k * ny + j) * nx..][..nx];
        let dt = self.time_step;
        let (per_dt, gain) = (1.0 / dt, 0.5 * dt / self.settings.mass);
        for i in (0..nx).filter(|i| !pinned[*i]) {
            let velocity = [0, 1, 2].map(|c| {
                let half = (now[c][i].to_f64() - before[c][i].to_f64()) * per_dt;
                half + gain * (forces[c][i] - self.damping * half)
            });
            deed(i, velocity);
        }
    }

    fn motion_of(&self, k: usize, present: &Present<'_, F>) -> Plane {
        let squared = |of: [f64; 3]| of[0] * of[0] + of[1] * of[1] + of[2] * of[2];
        // Greatest square of a force; sum of those of velocities.
        let (mut most, mut speeds, mut stored) = (0.0, 0.0, 0.0);
        present.each_row(k, |j, forces, energy| {
            stored += energy;
            self.each_free(present, (j, k), forces, |i, velocity| {
                speeds += squared(velocity);
                let force = squared([forces[0][i], forces[1][i], forces[2][i]]);
                // No later number replaces a NaN.
                if !(force <= most || f64::is_nan(most)) {
                    most = force;
                }
            });
        });
        Plane {
            residual: most.sqrt(),
            kinetic: 0.5 * self.settings.mass * speeds,
            stored,
        }
    }
}

/// All directions of springs, there and back.
fn both_ways(shape: &LatticeShape, settings: &LatticeSettings) -> Vec<Direction> {
    let mut all = directions(shape, settings);
    let back = directions(shape, settings).into_iter();
    all.extend(back.map(|mut direction| {
        direction.step = direction.step.map(|s| -s);
        direction
    }));
    all
}

/// Adds the forces of the springs from a row to another one, and half of their energies \[J\]: the other half
/// is that of their other ends.
fn pull<F: Number>(
    from: &RowPlaces<'_, F>,
    to: &RowPlaces<'_, F>,
    direction: &Direction,
    forces: &mut RowForces,
    energies: &mut [f64],
) {
    let (stiffness, rest) = (direction.stiffness, direction.rest);
    let (count, by) = (from[0].len(), direction.step[0]);
    // Points whose neighbour exists.
    let (first, last) = (usize::from(by < 0), count - usize::from(by > 0));
    let there = first.saturating_add_signed(by as isize);
    let Some(several) = last.checked_sub(first) else {
        return;
    };
    // Each slice has its own length in the loop: one check in place of one for each number.
    let [ax, ay, az] = from.map(|of| &of[first..][..several]);
    let [bx, by, bz] = to.map(|of| &of[there..][..several]);
    let [x, y, z] = forces;
    let (x, y, z) = (
        &mut x[first..][..several],
        &mut y[first..][..several],
        &mut z[first..][..several],
    );
    let energies = &mut energies[first..][..several];
    for i in 0..several {
        let dx = bx[i].to_f64() - ax[i].to_f64();
        let dy = by[i].to_f64() - ay[i].to_f64();
        let dz = bz[i].to_f64() - az[i].to_f64();
        let length = (dx * dx + dy * dy + dz * dz).sqrt();
        let stretch = length - rest;
        // Points that coincide have no direction.
        let divisor = if length > 0.0 { length } else { f64::INFINITY };
        let factor = stiffness * stretch / divisor;
        x[i] += factor * dx;
        y[i] += factor * dy;
        z[i] += factor * dz;
        energies[i] += 0.25 * stiffness * stretch * stretch;
    }
}

#[cfg(test)]
mod tests {
    use super::super::Neighbours;
    use super::*;

    /// A stretched lattice: x by a fifth, the others as they are.
    fn stretched(neighbours: Neighbours) -> Lattice<f64> {
        let shape = LatticeShape {
            points: [4, 3, 3],
            origin: [0.0; 3],
            spacing: [0.5; 3],
        };
        let mut lattice = Lattice::new(shape, LatticeSettings::new(neighbours)).expect("a lattice");
        for point in shape.each() {
            let [x, y, z] = shape.at(point);
            lattice.place(point, [1.2 * x, y, z]);
        }
        lattice
    }

    #[test]
    fn a_stretch_along_one_axis_has_the_energy_of_its_springs() {
        let lattice = stretched(Neighbours::Six);
        let motion = lattice.motion();
        // 27 springs of 0.5 m and 2 N/m, each longer by 0.1 m; at an end one pulls.
        assert!((motion.stored - 27.0 * 0.5 * 2.0 * 0.01).abs() <= 1e-14);
        assert!((motion.residual - 0.2).abs() <= 1e-14);
        // The velocity after half a step of this acceleration.
        assert!(motion.kinetic > 0.0);
        let mut started = lattice.clone();
        started.start_from_stillness();
        // Half of what damping takes from the velocity that the half step backwards has.
        let share = 0.5 * lattice.damping() * lattice.time_step() / lattice.settings().mass;
        let still = started.motion().kinetic / motion.kinetic;
        assert!((still - share * share).abs() <= 1e-9, "{still} {share}");
    }

    #[test]
    fn forces_of_all_neighbours_are_the_slope_of_their_energy() {
        let lattice = stretched(Neighbours::TwentySix);
        let point = [0, 1, 2];
        let (step, at) = (1e-6, lattice.position(point));
        let energy = |c: usize, by: f64| {
            let mut moved = lattice.clone();
            let mut to = at;
            to[c] += by;
            moved.place(point, to);
            moved.motion().stored
        };
        let present = lattice.present();
        assert_eq!(present.directions.len(), 26);
        let mut own = [0.0; 3];
        present.each_row(point[2], |j, forces, _| {
            if j == point[1] {
                own = [0, 1, 2].map(|c| forces[c][point[0]]);
            }
        });
        for (c, own) in own.into_iter().enumerate() {
            let slope = (energy(c, step) - energy(c, -step)) / (2.0 * step);
            assert!((own + slope).abs() <= 1e-8, "{c}: {own} {slope}");
        }
        assert!(own[0] > 0.1, "control: it is pulled");
    }

    #[test]
    fn a_velocity_is_that_of_the_end_of_a_step() {
        // A free fall: no spring is stretched.
        let shape = LatticeShape::unit_cube(3);
        let settings = LatticeSettings {
            damping: Some(0.0),
            time_step: Some(0.01),
            ..LatticeSettings::new(Neighbours::Six)
        };
        let mut lattice = Lattice::<f64>::new(shape, settings).expect("a lattice");
        shape
            .each()
            .for_each(|point| lattice.launch(point, shape.at(point), [0.0, 0.0, 2.0]));
        lattice.run(3).expect("a step");
        let off = lattice.of_velocities(|v| v).into_iter();
        let off = max_or_nan(off.map(|[x, y, z]| x.abs() + y.abs() + (z - 2.0).abs()));
        assert!(off <= 1e-9, "{off}");
    }
}
