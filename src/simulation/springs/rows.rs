//! The steps of a lattice without a list of springs.

mod gpu;

use nalgebra::{Point3, Vector3};

use super::{Moving, SpringsModelError, SpringsRun, StepRecord, absolute, shrink, time_step};
use crate::mesh::measures::max_or_nan;
use crate::scene::content::{LatticeScene, RestCourse};
use crate::simd::Number;
use crate::simulation::plan::Plan;
use crate::springs::integrators::{StepError, Verlet};
use crate::springs::lattice::{
    Lattice, LatticeError, LatticeMotion, LatticeSettings, LatticeShape, largest_stiffness,
};
use crate::springs::patterns;
use crate::springs::system::SpringEnergy;
use crate::springs::{Mode, Neighbours, RestSettings, Stiffest, limit};

/// Greatest number of springs of which each is a line of the results.
const LINES: usize = 1_000_000;

/// Number of points of a lattice for each step between two measures: the measures cost as much as several
/// steps.
const POINTS_PER_STEP: usize = 10_000;

/// Greatest product of points and of steps between two measures: an interruption waits for these steps.
const MOVED_AT_ONCE: usize = 50_000_000;

/// The steps between two measures are at most this part of all steps.
const PART: usize = 16;

/// Single precision cannot tell rest below this multiple of its rounding.
const ABOVE_ROUNDING: f64 = 8.0;

/// How many of `frames` steps are made before a lattice is measured again, after `done` of them: the first one
/// alone, then up to each multiple of one number.
pub(super) fn at_once(points: usize, frames: usize, done: usize) -> usize {
    let most = (MOVED_AT_ONCE / points).min(frames / PART);
    let several = points.div_ceil(POINTS_PER_STEP).min(most).max(1);
    match done {
        0 => 1,
        done => (several - done % several).min(frames.saturating_sub(done)),
    }
}

/// A lattice in double or single precision.
pub(super) trait Rows: Send {
    fn shape(&self) -> &LatticeShape;
    fn settings(&self) -> &LatticeSettings;
    fn damping(&self) -> f64;
    /// Makes some steps. Returns the greatest move of a point in the last one [m], or the error of a step and
    /// the number of steps so far.
    fn advance(&mut self, steps: u64) -> Result<f64, (StepError, u64)>;
    /// Measures of the last step, number `step`, in which a point moved by up to `moved` [m].
    fn record(&self, step: usize, moved: f64) -> StepRecord;
    fn held(&self) -> Vec<bool>;
    fn positions(&self) -> Vec<Point3<f64>>;
    fn velocities(&self) -> Vec<Vector3<f64>>;
    fn speeds(&self) -> Vec<f64>;
    /// Makes some steps, and reads all positions after each if `reads` is given: beside the next step if it is
    /// true.
    fn pace(&mut self, steps: u64, reads: Option<bool>) -> Result<(), (StepError, u64)> {
        let _ = reads;
        self.advance(steps).map(|_| ())
    }
    /// Name of the graphics card that computes, and bytes on it.
    fn card(&self) -> Option<(&str, u64)> {
        None
    }
}

/// The record of a step of this number and length [s], in which a point moved by up to `moved` [m].
fn record_of(motion: &LatticeMotion, (step, dt): (usize, f64), moved: f64) -> StepRecord {
    StepRecord {
        step,
        dt,
        greatest_move: moved,
        energy: SpringEnergy {
            kinetic: motion.kinetic,
            stored: motion.stored,
            loads: 0.0,
        },
        residual: motion.residual,
    }
}

impl<F: Number> Rows for Lattice<F> {
    fn shape(&self) -> &LatticeShape {
        Lattice::shape(self)
    }

    fn settings(&self) -> &LatticeSettings {
        Lattice::settings(self)
    }

    fn damping(&self) -> f64 {
        Lattice::damping(self)
    }

    fn advance(&mut self, steps: u64) -> Result<f64, (StepError, u64)> {
        self.run(steps).map_err(|error| {
            // Of the points the one that is farthest away, or nowhere.
            let (mut point, mut farthest) = (0, 0.0);
            for (p, at) in Lattice::shape(self).each().enumerate() {
                let size = max_or_nan(self.position(at).map(f64::abs));
                if !(size <= farthest || f64::is_nan(farthest)) {
                    (point, farthest) = (p, size);
                }
            }
            let dt = self.time_step();
            let step = match error {
                LatticeError::Diverged { step } => step,
                _ => self.steps(),
            };
            (StepError::NotFinite { point, dt }, step)
        })
    }

    fn record(&self, step: usize, moved: f64) -> StepRecord {
        record_of(&self.motion(), (step, self.time_step()), moved)
    }

    fn held(&self) -> Vec<bool> {
        let each = Lattice::shape(self).each();
        each.map(|point| self.is_pinned(point)).collect()
    }

    fn positions(&self) -> Vec<Point3<f64>> {
        let shape = Lattice::shape(self);
        let mut all = Vec::with_capacity(shape.count());
        all.extend(shape.each().map(|point| Point3::from(self.position(point))));
        all
    }

    fn velocities(&self) -> Vec<Vector3<f64>> {
        self.of_velocities(Vector3::from)
    }

    fn speeds(&self) -> Vec<f64> {
        self.of_velocities(|v| Vector3::from(v).norm())
    }
}

/// The lattice of a scene with numbers of type `F`.
pub(super) fn run<F: Number>(
    scene: &LatticeScene,
    shape: &LatticeShape,
    course: &RestCourse,
) -> Result<SpringsRun, SpringsModelError> {
    let mut settings = LatticeSettings {
        stiffness: scene.stiffness,
        mass: scene.mass,
        ..LatticeSettings::new(scene.neighbours)
    };
    let estimate = Some(settings.damping_estimate(shape));
    let damping_estimate = estimate.filter(|c| c.is_finite() && *c > 0.0);
    let damping = absolute(scene.damping, damping_estimate)?;
    let row_sum = settings.row_sum(shape);
    let stiffest = Stiffest {
        mode: Mode::of(largest_stiffness(shape, &settings), damping, scene.mass),
        bound: row_sum / scene.mass,
        products: 0,
    };
    let longest = limit(&Verlet::default(), &stiffest);
    let dt = time_step(course, &Verlet::default(), &stiffest, longest)?;
    (settings.damping, settings.time_step) = (Some(damping), Some(dt));
    let size = Vector3::from([0, 1, 2].map(|c| shape.spacing[c] * (shape.points[c] - 1) as f64));
    let (least, most) = match course.is_single {
        true => (f64::from(f32::MIN_POSITIVE), f64::from(f32::MAX)),
        false => (f64::MIN_POSITIVE, f64::MAX),
    };
    let is_normal = shape.spacing[0] >= 10.0 * least.sqrt() && size.norm() <= 0.1 * most.sqrt();
    if !is_normal {
        return Err(SpringsModelError::NoSquares(course.is_single));
    }
    let rest = RestSettings::of(row_sum, size.norm(), shape.count(), course.tolerance);
    if course.is_single {
        // Coordinates are rounded as those of the far corner are.
        let spacing = size.norm() / (shape.count() as f64).cbrt();
        // What moves a point by less than its rounding in a step does not move it. On a graphics card numbers are
        // displacements from rest, and such steps add up, until damping holds them.
        let (greatest, still) = match course.is_on_gpu() {
            true => (0.5 * course.shrink.abs() * size.amax(), damping / dt),
            false => (size.amax(), scene.mass / (dt * dt)),
        };
        let still = still / row_sum;
        let rounds = ABOVE_ROUNDING * f64::from(f32::EPSILON) * greatest / spacing;
        let rounds = rounds * if still > 1.0 { still } else { 1.0 };
        if !(course.tolerance >= rounds) {
            let tolerance = course.tolerance;
            let on_card = course.is_on_gpu();
            return Err(SpringsModelError::TooCoarse {
                rounds,
                tolerance,
                on_card,
            });
        }
    }
    let mut lattice = Lattice::<F>::new(*shape, settings)?;
    let surface = shape.surface();
    disturb(&mut lattice, &surface, course);
    lattice.start_from_stillness();
    let springs = scene.neighbours.springs(shape.points);
    let (lines, triangles) = shown(scene.neighbours, shape, LINES);
    let rest_lengths = lines.iter().map(|ends| {
        let [a, b] = ends.map(|p| Point3::from(shape.at(shape.point(p))));
        (a - b).norm()
    });
    let mut run = SpringsRun {
        name: scene.name.clone(),
        rest_lengths: rest_lengths.collect(),
        lines,
        triangles,
        springs,
        neighbours: scene.neighbours,
        course: course.clone(),
        damping_estimate,
        stiffest,
        time_step: dt,
        longest: longest.is_finite().then_some(longest),
        rest,
        last: lattice.record(0, 0.0),
        end: None,
        time: 0.0,
        steps_s: 0.0,
        measured: 0,
        plan: Plan::default(),
        frames: scene.frames,
        frame_rate: scene.frame_rate,
        surface,
        skips: false,
        pause: usize::MAX,
        moving: Moving::Rows(moved_by(lattice, course)?),
    };
    // Nothing moves yet.
    (run.last.dt, run.last.energy.kinetic) = (0.0, 0.0);
    run.judge();
    Ok(run)
}

/// A lattice on the device of its course.
fn moved_by<F: Number>(
    lattice: Lattice<F>,
    course: &RestCourse,
) -> Result<Box<dyn Rows>, SpringsModelError> {
    match course.is_on_gpu() {
        true => gpu::of(&lattice, course.method).map_err(SpringsModelError::NoGpu),
        false => Ok(Box::new(lattice)),
    }
}

/// Moves and holds the surface.
fn disturb<F: Number>(lattice: &mut Lattice<F>, surface: &[u32], course: &RestCourse) {
    let shape = *Lattice::shape(lattice);
    let mut x = shape.positions();
    shrink(&mut x, surface, course.shrink);
    for &p in surface {
        let point = shape.point(p);
        lattice.place(point, x[p as usize].coords.into());
        if course.held {
            lattice.pin(point);
        }
    }
}

/// The springs that the results show as lines, and the triangles of the surface where these are not all.
fn shown(
    neighbours: Neighbours,
    shape: &LatticeShape,
    most: usize,
) -> (Vec<[u32; 2]>, Vec<[u32; 3]>) {
    if neighbours.springs(shape.points) <= most {
        let all = patterns::lattice(shape, neighbours);
        return (all.collect(), Vec::new());
    }
    let [nx, ny, nz] = shape.points;
    let plane = LatticeShape {
        points: [nx, 1, nz],
        ..*shape
    };
    let in_plane = patterns::lattice(&plane, neighbours);
    let lines = in_plane.map(|ends| {
        ends.map(|p| {
            let [i, _, k] = plane.point(p);
            shape.index([i, ny / 2, k])
        })
    });
    let faces = shape.faces();
    let triangles = faces.map(|corners| corners.map(|point| shape.index(point)));
    (lines.collect(), triangles.collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::TriangleMesh;

    #[test]
    fn of_very_many_springs_those_of_a_plane_are_shown_and_the_faces() {
        let shape = LatticeShape::with_longest_side([4, 5, 6], 1.0).expect("a shape");
        let (all, none) = shown(Neighbours::TwentySix, &shape, 10_000);
        assert_eq!(all.len(), Neighbours::TwentySix.springs(shape.points));
        assert!(none.is_empty());
        let (lines, triangles) = shown(Neighbours::TwentySix, &shape, 10);
        let within = |ends: &[u32; 2]| ends.iter().all(|&p| shape.point(p)[1] == 2);
        assert_eq!(lines.len(), all.iter().filter(|ends| within(ends)).count());
        assert!(lines.iter().all(|ends| within(ends) && all.contains(ends)));
        let vertices = shape.positions();
        let box_of = TriangleMesh {
            vertices,
            triangles,
        };
        let volume = 0.6 * 0.8 * 1.0;
        assert!((box_of.volume() - volume).abs() <= 1e-14);
    }
}
