//! A spring system on its way to rest: its surface is moved, and each step is a frame.

mod rows;

use std::borrow::Cow;
use std::time::Instant;

use nalgebra::{Point3, Vector3, center};

use rows::Rows;

use super::fault::{Fault, LoadError};
use super::plan::Plan;
use super::scenario::Stepped;
use crate::format::number;
use crate::mesh::measures::Aabb;
use crate::scene::content::{LatticeScene, RestCourse, SpringsDamping};
use crate::springs::damping::{self, DampedBody};
use crate::springs::integrators::{Adaptive, Integrator, StepError, Verlet, by_name};
use crate::springs::lattice::{LatticeError, LatticeSettings, LatticeShape};
use crate::springs::patterns::{self, at_rest};
use crate::springs::spring_set::PairError;
use crate::springs::{
    Neighbours, RestEnd, RestSettings, SpringSystem, Springs, StepRecord, Stiffest, SystemError,
    limit, stiffest,
};

/// The reason why a spring system cannot run to rest.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SpringsModelError {
    /// The springs have no length, so that no damping can be estimated.
    #[error("no damping can be estimated for such springs")]
    NoEstimate,
    /// The name belongs to no integrator.
    #[error("no integrator is called {0}")]
    NoIntegrator(&'static str),
    /// The longest stable step is zero in double precision.
    #[error("{0}: the longest stable step is too small for a number")]
    TooSmall(&'static str),
    /// The integrator is stable with damping only.
    #[error("{0}: no step is stable without damping")]
    NeverStable(&'static str),
    /// The step is not shorter than the longest stable one.
    #[error("a step of {} s is not stable: {integrator} needs less than {} s here", number(*.time_step), number(*.longest))]
    TooLong {
        /// Name of the integrator.
        integrator: &'static str,
        /// The step [s].
        time_step: f64,
        /// The longest stable step [s].
        longest: f64,
    },
    /// Only steps without a list of springs have single precision.
    #[error("{0}: only the integrator verlet with equal steps computes in single precision")]
    OnlyDouble(&'static str),
    /// Squares of lengths overflow or vanish.
    #[error("the square of a length is no number in {} precision", if *.0 { "single" } else { "double" })]
    NoSquares(bool),
    /// Rounding alone is more than the tolerance.
    #[error("single precision rounds forces by {} of the force at a strain of one, {} is asked for", number(*.rounds), number(*.tolerance))]
    TooCoarse {
        /// What rounding leaves, as a share.
        rounds: f64,
        /// The tolerance that is asked for.
        tolerance: f64,
        /// Whether a graphics card computes.
        on_card: bool,
    },
    /// Only steps without a list of springs run on a graphics card.
    #[error("{0}: only the integrator verlet with equal steps runs on a graphics card")]
    OnlyCpu(&'static str),
    /// There is no graphics card that takes the lattice.
    #[error("{0}")]
    NoGpu(String),
    /// The lattice is not valid.
    #[error(transparent)]
    Lattice(#[from] LatticeError),
    /// The springs are not valid.
    #[error(transparent)]
    Springs(#[from] PairError),
    /// The points are not valid.
    #[error(transparent)]
    System(#[from] SystemError),
}

impl SpringsModelError {
    /// The key of a scene that has the wrong value.
    pub fn key(&self) -> &'static str {
        match self {
            Self::NoEstimate => "lattice.damping",
            Self::TooLong { .. } => "lattice.rest.time_step",
            Self::OnlyDouble(_) => "lattice.rest.precision",
            Self::OnlyCpu(_) | Self::NoGpu(_) => "lattice.rest.device",
            Self::NoSquares(_) => "lattice.side",
            Self::TooCoarse { .. } => "lattice.rest.tolerance",
            Self::NoIntegrator(_) | Self::TooSmall(_) | Self::NeverStable(_) => {
                "lattice.rest.integrator"
            }
            Self::Lattice(_) | Self::Springs(_) | Self::System(_) => "lattice",
        }
    }

    /// Advice for the user.
    pub fn help(&self) -> &'static str {
        match self {
            Self::NoEstimate => "give `damping`",
            Self::NoIntegrator(_) => "take another `integrator`",
            Self::TooSmall(_) => "give a greater `mass`",
            Self::OnlyDouble(_) => "leave `precision` out, or take `integrator = \"verlet\"`",
            Self::OnlyCpu(_) => "take `device = \"cpu\"`, or `integrator = \"verlet\"`",
            Self::NoGpu(_) => "take `device = \"cpu\"`",
            Self::NoSquares(_) => "give another `side`",
            Self::TooCoarse { on_card: true, .. } => {
                "give a greater `tolerance`, or `device = \"cpu\"`"
            }
            Self::TooCoarse { .. } => "give a greater `tolerance`, or `precision = \"f64\"`",
            Self::NeverStable(_) => "give `damping`, or take another `integrator`",
            Self::TooLong { .. } => {
                "take a shorter `time_step`, `adaptive = true`, or `integrator = \"implicit\"`"
            }
            Self::Lattice(_) | Self::Springs(_) | Self::System(_) => {
                "change `points`, `side` or `mass`"
            }
        }
    }
}

/// A spring system at rest.
pub struct SpringsModel {
    /// Name, also of the folder of results.
    pub name: String,
    /// Points and springs.
    pub system: SpringSystem,
    /// Ends of each spring.
    pub lines: Vec<[u32; 2]>,
    /// Rest length of each spring [m].
    pub rest_lengths: Vec<f64>,
    /// Triangles of the surface; may be empty.
    pub triangles: Vec<[u32; 3]>,
    /// Points of the surface.
    pub surface: Vec<u32>,
    /// Neighbours of a point in a lattice; otherwise the most similar kind.
    pub neighbours: Neighbours,
    /// Input of the estimate of the damping; `None` for a single point.
    pub damped: Option<DampedBody>,
}

impl SpringsModel {
    /// Points at `x` [m] with equal masses [kg] and springs, without a surface.
    ///
    /// # Errors
    /// Points, masses or springs that are not valid.
    pub fn new(
        name: String,
        x: Vec<Point3<f64>>,
        mass: f64,
        springs: Springs,
    ) -> Result<Self, SpringsModelError> {
        let masses = vec![mass; x.len()];
        let mut system = SpringSystem::new(x, masses)?;
        let laws = springs.springs().iter();
        let (lines, rest_lengths) = laws.map(|(ends, law)| (*ends, law.rest)).unzip();
        system.add(springs)?;
        Ok(Self {
            name,
            system,
            lines,
            rest_lengths,
            triangles: Vec::new(),
            surface: Vec::new(),
            neighbours: Neighbours::Six,
            damped: None,
        })
    }

    /// The lattice of a scene.
    ///
    /// # Errors
    /// Numbers that give no valid lattice.
    pub fn of_lattice(scene: &LatticeScene) -> Result<Self, SpringsModelError> {
        let shape = LatticeShape::with_longest_side(scene.points, scene.side)?;
        let settings = LatticeSettings {
            stiffness: scene.stiffness,
            mass: scene.mass,
            ..LatticeSettings::new(scene.neighbours)
        };
        let x = shape.positions();
        let edges = patterns::lattice(&shape, scene.neighbours);
        let springs = at_rest(&x, edges, |length| settings.stiffness.of(length));
        let springs = Springs::new(x.len(), springs)?;
        Ok(Self {
            surface: shape.surface(),
            neighbours: scene.neighbours,
            damped: settings.body(&shape),
            ..Self::new(scene.name.clone(), x, scene.mass, springs)?
        })
    }

    /// The estimate (7.2) of the damping [N s/m]; `None` if the springs have no length.
    pub fn damping_estimate(&self) -> Option<f64> {
        let estimate = damping::estimate(self.neighbours, self.damped?);
        Some(estimate).filter(|c| c.is_finite() && *c > 0.0)
    }

    /// Moves the surface towards the centre by a share of the distance, and fixes it if `hold` is
    /// true.
    fn disturb(&mut self, share: f64, hold: bool) {
        shrink(&mut self.system.position, &self.surface, share);
        if hold {
            self.system.pin(self.surface.iter().copied());
        }
    }
}

/// A function that makes a step and returns its length [s].
type Advance = Box<dyn FnMut(&mut SpringSystem) -> Result<f64, StepError> + Send>;

/// What moves.
enum Moving {
    /// Points with a list of springs.
    List {
        system: SpringSystem,
        /// Positions at rest, before the surface was moved [m].
        rest: Vec<Point3<f64>>,
        advance: Advance,
    },
    /// A lattice, which needs no list.
    Rows(Box<dyn Rows>),
}

/// A spring system that runs to rest. Each step is a frame; those of a large lattice are made several at a
/// time.
pub struct SpringsRun {
    /// Name, also of the folder of results.
    pub name: String,
    /// Ends of each spring; of a lattice with very many springs those of a plane through the middle.
    pub lines: Vec<[u32; 2]>,
    /// Rest length of each of these [m].
    pub rest_lengths: Vec<f64>,
    /// Triangles of the surface; may be empty.
    pub triangles: Vec<[u32; 3]>,
    /// Number of springs.
    pub springs: usize,
    /// Neighbours of a point in a lattice; otherwise the most similar kind.
    pub neighbours: Neighbours,
    /// The course to rest.
    pub course: RestCourse,
    /// Estimate of the damping [N s/m].
    pub damping_estimate: Option<f64>,
    /// The stiffest mode at rest. The displacement of the surface softens the inner springs.
    pub stiffest: Stiffest,
    /// The first step [s].
    pub time_step: f64,
    /// Longest stable step [s]; `None` if every step is stable.
    pub longest: Option<f64>,
    /// Criterion of rest.
    pub rest: RestSettings,
    /// Measures of the last step.
    pub last: StepRecord,
    /// Reason of the end; `None` before it, and after the greatest number of steps.
    pub end: Option<RestEnd>,
    /// Simulated time [s].
    pub time: f64,
    pub(super) plan: Plan,
    pub(super) frames: usize,
    pub(super) frame_rate: f64,
    /// The time that steps took, without their measures [s], and how many these were.
    steps_s: f64,
    measured: usize,
    surface: Vec<u32>,
    /// Whether several steps of a large lattice are made at a time, up to a multiple of `pause`.
    skips: bool,
    pause: usize,
    moving: Moving,
}

impl SpringsRun {
    /// Moves the surface of a system, which makes at most `frames` steps. Pictures show
    /// `frame_rate` steps a second.
    ///
    /// # Errors
    /// No estimate of the damping, or no stable step.
    pub fn new(
        mut model: SpringsModel,
        damping: SpringsDamping,
        course: &RestCourse,
        frames: usize,
        frame_rate: f64,
    ) -> Result<Self, SpringsModelError> {
        let damping_estimate = model.damping_estimate();
        model.system.damping = absolute(damping, damping_estimate)?;
        let stiffest = stiffest(&model.system);
        let integrator =
            by_name(course.integrator).ok_or(SpringsModelError::NoIntegrator(course.integrator))?;
        let longest = limit(&*integrator, &stiffest);
        let time_step = time_step(course, &*integrator, &stiffest, longest)?;
        let rest = RestSettings::share_of(&model.system, course.tolerance);
        let rest_position = model.system.position.clone();
        model.disturb(course.shrink, course.held);
        let mut run = Self {
            last: StepRecord::of(&model.system, 0, 0.0, &model.system.position),
            name: model.name,
            springs: model.lines.len(),
            lines: model.lines,
            rest_lengths: model.rest_lengths,
            triangles: model.triangles,
            neighbours: model.neighbours,
            surface: model.surface,
            course: course.clone(),
            damping_estimate,
            stiffest,
            time_step,
            longest: longest.is_finite().then_some(longest),
            rest,
            end: None,
            time: 0.0,
            steps_s: 0.0,
            measured: 0,
            plan: Plan::default(),
            frames,
            frame_rate,
            skips: false,
            pause: usize::MAX,
            moving: Moving::List {
                system: model.system,
                rest: rest_position,
                advance: advance(course.adaptive, integrator, time_step),
            },
        };
        run.judge();
        Ok(run)
    }

    /// The lattice of a scene, in the scene's course to rest or in the default one. Steps of the default
    /// integrator need no list of springs.
    ///
    /// # Errors
    /// Numbers that give no valid lattice, and those of [`SpringsRun::new`].
    pub fn of_lattice(scene: &LatticeScene) -> Result<Self, LoadError> {
        let course = scene.rest.clone().unwrap_or_default();
        let refused = |error: SpringsModelError| {
            let key = error.key();
            LoadError::at(
                &scene.origin,
                key,
                "lattice".to_owned(),
                Fault::Springs(error),
            )
        };
        let shape = LatticeShape::with_longest_side(scene.points, scene.side)
            .map_err(|error| refused(error.into()))?;
        let (frames, frame_rate) = (scene.frames, scene.frame_rate);
        let made = match (course.is_by_rows(), course.is_single) {
            (false, _) if course.is_on_gpu() => Err(SpringsModelError::OnlyCpu(course.integrator)),
            // Its start is computed in double precision.
            (true, _) if course.is_on_gpu() => rows::run::<f64>(scene, &shape, &course),
            (true, false) => rows::run::<f64>(scene, &shape, &course),
            (true, true) => rows::run::<f32>(scene, &shape, &course),
            (false, true) => Err(SpringsModelError::OnlyDouble(course.integrator)),
            (false, false) => SpringsModel::of_lattice(scene)
                .and_then(|model| Self::new(model, scene.damping, &course, frames, frame_rate)),
        };
        let mut run = made.map_err(refused)?;
        run.plan = Plan::of_lattice(scene, &shape, 1);
        Ok(run)
    }

    /// Number of points.
    pub fn count(&self) -> usize {
        match &self.moving {
            Moving::List { system, .. } => system.len(),
            Moving::Rows(rows) => rows.shape().count(),
        }
    }

    /// Mass of the first point [kg].
    pub fn mass(&self) -> f64 {
        match &self.moving {
            Moving::List { system, .. } => system.mass()[0],
            Moving::Rows(rows) => rows.settings().mass,
        }
    }

    /// Damping of each point [N s/m].
    pub fn damping(&self) -> f64 {
        match &self.moving {
            Moving::List { system, .. } => system.damping,
            Moving::Rows(rows) => rows.damping(),
        }
    }

    /// Name of the graphics card that computes, and bytes on it; `None` on the processor.
    pub fn card(&self) -> Option<(&str, u64)> {
        match &self.moving {
            Moving::List { .. } => None,
            Moving::Rows(rows) => rows.card(),
        }
    }

    /// Whether the steps need no list of springs.
    pub fn is_by_rows(&self) -> bool {
        matches!(self.moving, Moving::Rows(_))
    }

    /// Which points are held, shape `[point_count]`.
    pub fn held(&self) -> Vec<bool> {
        match &self.moving {
            Moving::List { system, .. } => system.pinned().to_vec(),
            Moving::Rows(rows) => rows.held(),
        }
    }

    /// Positions now [m], shape `[point_count]`.
    pub fn positions(&self) -> Cow<'_, [Point3<f64>]> {
        match &self.moving {
            Moving::List { system, .. } => Cow::Borrowed(&system.position),
            Moving::Rows(rows) => Cow::Owned(rows.positions()),
        }
    }

    /// Velocities now [m/s], shape `[point_count]`.
    pub fn velocities(&self) -> Cow<'_, [Vector3<f64>]> {
        match &self.moving {
            _ if self.last.step == 0 => Cow::Owned(vec![Vector3::zeros(); self.count()]),
            Moving::List { system, .. } => Cow::Borrowed(&system.velocity),
            Moving::Rows(rows) => Cow::Owned(rows.velocities()),
        }
    }

    /// Speeds now [m/s], shape `[point_count]`.
    pub fn speeds(&self) -> Vec<f64> {
        match &self.moving {
            _ if self.last.step == 0 => vec![0.0; self.count()],
            Moving::List { system, .. } => system.velocity.iter().map(Vector3::norm).collect(),
            Moving::Rows(rows) => rows.speeds(),
        }
    }

    /// Positions at rest, before the surface was moved [m], shape `[point_count]`.
    pub fn rest_positions(&self) -> Cow<'_, [Point3<f64>]> {
        match &self.moving {
            Moving::List { rest, .. } => Cow::Borrowed(rest),
            Moving::Rows(rows) => Cow::Owned(rows.shape().positions()),
        }
    }

    /// Positions at the start, with the surface moved [m], shape `[point_count]`.
    pub fn start_positions(&self) -> Vec<Point3<f64>> {
        let mut x = self.rest_positions().into_owned();
        shrink(&mut x, &self.surface, self.course.shrink);
        x
    }

    /// Whether all positions are finite.
    pub fn is_finite(&self) -> bool {
        match &self.moving {
            Moving::List { system, .. } => system.first_non_finite().is_none(),
            Moving::Rows(_) => !matches!(self.end, Some(RestEnd::Failed(_))),
        }
    }

    /// Makes several steps of a large lattice at a time from now on, and shows at least each whose number is a
    /// multiple of `every`.
    pub fn skip_to(&mut self, every: Option<usize>) {
        (self.skips, self.pause) = (true, every.unwrap_or(usize::MAX));
    }

    /// Ends the run if the system is at rest.
    fn judge(&mut self) {
        if self.rest.allows(&self.last) {
            self.end = Some(RestEnd::Rest);
        }
    }

    /// Makes a step, or several of a large lattice.
    pub fn step(&mut self) -> Stepped {
        let (begin, step) = (Instant::now(), self.last.step);
        let made = match &mut self.moving {
            Moving::List {
                system, advance, ..
            } => {
                let before = system.position.clone();
                let made = advance(system);
                let took = begin.elapsed();
                made.map(|dt| {
                    (
                        self.time + dt,
                        took,
                        StepRecord::of(system, step + 1, dt, &before),
                    )
                })
            }
            Moving::Rows(rows) => {
                let count = match self.skips {
                    true => rows::at_once(rows.shape().count(), self.frames, step)
                        .min(self.pause - step % self.pause)
                        .max(1),
                    false => 1,
                };
                let moved = rows.advance(count as u64);
                let took = begin.elapsed();
                match moved {
                    Ok(moved) => {
                        let record = rows.record(step + count, moved);
                        // The same bits however many steps are made at once.
                        Ok((record.dt * record.step as f64, took, record))
                    }
                    Err((error, at)) => {
                        self.last.step = (at as usize).saturating_sub(1);
                        Err(error)
                    }
                }
            }
        };
        match made {
            Ok((time, took, record)) => {
                (self.time, self.last) = (time, record);
                self.steps_s += took.as_secs_f64();
                self.measured += record.step - step;
                self.judge();
                Stepped::Done
            }
            Err(error) => {
                self.end = Some(RestEnd::Failed(error));
                Stepped::Failed(error.to_string())
            }
        }
    }

    /// Makes some steps and returns the time that they take [s], with a reading of all positions after each if
    /// `reads` is given: beside the next step if it is true. On the processor there is nothing to read.
    ///
    /// # Errors
    /// A step failed.
    pub fn pace(&mut self, steps: u64, reads: Option<bool>) -> Result<f64, StepError> {
        let begin = Instant::now();
        match &mut self.moving {
            Moving::List {
                system, advance, ..
            } => {
                for _ in 0..steps {
                    advance(system)?;
                }
            }
            Moving::Rows(rows) => rows.pace(steps, reads).map_err(|(error, _)| error)?,
        }
        Ok(begin.elapsed().as_secs_f64())
    }

    /// Mean time of a step, without its measures [s]; `None` before the first.
    pub fn step_s(&self) -> Option<f64> {
        (self.measured > 0).then(|| self.steps_s / self.measured as f64)
    }
}

/// The damping [N s/m] that is asked for.
fn absolute(damping: SpringsDamping, estimate: Option<f64>) -> Result<f64, SpringsModelError> {
    match damping {
        SpringsDamping::Absolute(damping) => Ok(damping),
        share => Ok(share.of(estimate.ok_or(SpringsModelError::NoEstimate)?)),
    }
}

/// Moves points of the surface towards the centre of all by a share of the distance.
fn shrink(x: &mut [Point3<f64>], surface: &[u32], share: f64) {
    let bounds = Aabb::of_points(&*x);
    let centre = center(&bounds.min, &bounds.max);
    for &p in surface {
        let x = &mut x[p as usize];
        *x = centre + (*x - centre) * (1.0 - share);
    }
}

/// The first step [s]: the given one, or half of the longest stable one.
fn time_step(
    course: &RestCourse,
    integrator: &dyn Integrator,
    stiffest: &Stiffest,
    longest: f64,
) -> Result<f64, SpringsModelError> {
    let step = if longest.is_finite() {
        0.5 * longest
    } else {
        5.0 * limit(&Verlet::default(), stiffest)
    };
    // If nothing moves, any step is stable.
    let step = if step.is_finite() { step } else { 1.0 };
    let time_step = course.time_step.unwrap_or(step);
    if !(time_step > 0.0) {
        return Err(if stiffest.mode.damping_rate > 0.0 {
            SpringsModelError::TooSmall(integrator.name())
        } else {
            SpringsModelError::NeverStable(integrator.name())
        });
    }
    if time_step >= longest && !course.adaptive {
        return Err(SpringsModelError::TooLong {
            integrator: integrator.name(),
            time_step,
            longest,
        });
    }
    Ok(time_step)
}

/// The steps of a run.
fn advance(is_adaptive: bool, mut integrator: Box<dyn Integrator>, dt: f64) -> Advance {
    if is_adaptive {
        let mut adaptive = Adaptive::new(integrator, dt);
        return Box::new(move |system| adaptive.step(system).map(|a| a.dt));
    }
    Box::new(move |system| integrator.step(system, dt).map(|()| dt))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::builtin::load_content;
    use crate::scene::content::Content;
    use crate::springs::settle;

    fn scene(changes: &[&str]) -> LatticeScene {
        let mut all = [
            "lattice.points=[4,4,5]",
            "lattice.drag=none",
            "lattice.release=none",
        ]
        .map(str::to_owned)
        .to_vec();
        all.push("lattice.damping=1".to_owned());
        all.extend(changes.iter().map(|change| (*change).to_owned()));
        match load_content("lattice", &all).expect("a scene") {
            Content::Lattice(scene) => *scene,
            _ => panic!("a lattice"),
        }
    }

    #[test]
    fn a_scene_comes_to_rest_as_the_system_of_its_numbers_does() {
        let scene = scene(&["frames=2000", "lattice.rest.shrink=0.05"]);
        let mut run = SpringsRun::of_lattice(&scene).expect("a system");
        let mut model = SpringsModel::of_lattice(&scene).expect("a system");
        model.system.damping = model.damping_estimate().expect("an estimate");
        // What the rows know of the lattice is what the list has.
        let (rest, mode) = (
            RestSettings::share_of(&model.system, 1e-6),
            stiffest(&model.system),
        );
        let near = |a: f64, b: f64, share: f64| (a - b).abs() <= share * b;
        assert!(near(run.rest.force, rest.force, 1e-9) && near(run.rest.energy, rest.energy, 1e-9));
        assert!(near(run.stiffest.bound, mode.bound, 1e-9));
        let frequency = mode.mode.angular_frequency_squared;
        // The power iteration of a lattice ends where a product changes the value by 1e-7; what is left can be a
        // thousand times that.
        let own = run.stiffest.mode.angular_frequency_squared;
        assert!(near(own, frequency, 1e-4), "{own} {frequency}");
        assert_eq!(model.system.damping.to_bits(), run.damping().to_bits());
        model.disturb(0.05, true);
        let mut verlet = Verlet::default();
        let settled = settle(
            &mut model.system,
            &mut verlet,
            run.time_step,
            run.rest,
            scene.frames,
            |_, _| true,
        );
        while run.end.is_none() && run.last.step < scene.frames {
            assert_eq!(run.step(), Stepped::Done);
        }
        assert_eq!((run.end, settled.end), (Some(RestEnd::Rest), RestEnd::Rest));
        assert!(settled.steps > 10);
        // The reciprocal root of the rows is not rounded correctly.
        let off = |a: f64, b: f64| (a - b).abs() / run.rest.force;
        assert_eq!(run.last.step, settled.last.step);
        assert!(off(run.last.residual, settled.last.residual) <= 1e-6);
        let now = run.positions();
        let apart = now.iter().zip(&model.system.position);
        let apart = crate::mesh::measures::max_or_nan(apart.map(|(a, b)| (a - b).norm()));
        // Rounding of coordinates, and of a factor at each of the steps.
        let rounding = 64.0 * f64::EPSILON * scene.side;
        assert!(run.is_by_rows() && apart <= rounding, "{apart} {rounding}");
    }

    #[test]
    fn steps_that_are_made_at_once_lead_where_single_steps_do() {
        // 10,648 points: two steps at a time, for enough steps.
        let scene = scene(&["frames=64", "lattice.points=[22,22,22]"]);
        let [mut one, mut several, mut paused] =
            [0; 3].map(|_| SpringsRun::of_lattice(&scene).expect("a system"));
        several.skip_to(None);
        paused.skip_to(Some(5));
        let steps = |run: &mut SpringsRun| {
            let mut seen = Vec::new();
            while run.end.is_none() && run.last.step < 20 {
                assert_eq!(run.step(), Stepped::Done);
                seen.push(run.last.step);
            }
            seen
        };
        assert_eq!(steps(&mut one), (1..=20).collect::<Vec<_>>());
        assert_eq!(steps(&mut several)[..4], [1, 2, 4, 6]);
        let seen = steps(&mut paused);
        assert!(
            [5, 10, 15, 20].iter().all(|step| seen.contains(step)),
            "{seen:?}"
        );
        assert_eq!(one.last, several.last);
        assert_eq!(
            (one.time, one.positions()),
            (several.time, several.positions())
        );
        assert_eq!(
            (one.last, one.positions()),
            (paused.last, paused.positions())
        );
        assert!(several.velocities().iter().any(|v| v.norm() > 0.0));
        // Enough rows for a table, and an interruption is heard.
        for (points, frames) in [
            (1_000_000, 1000),
            (1_000_000, 100),
            (100_000_000, 10_000),
            (8, 100),
        ] {
            let at_once = rows::at_once(points, frames, 2 * frames / 3);
            assert!(
                at_once >= 1 && at_once <= 100.min(frames / 8),
                "{points} {frames}: {at_once}"
            );
            assert!(at_once * points <= 100_000_000 || at_once == 1);
        }
    }

    #[test]
    fn a_step_that_is_too_long_is_refused_unless_it_adapts() {
        let long = scene(&["lattice.rest.time_step=10 s"]);
        let Err(LoadError::Unfit(unfit)) = SpringsRun::of_lattice(&long) else {
            panic!("a step that is too long")
        };
        assert!(matches!(
            unfit.fault,
            Fault::Springs(SpringsModelError::TooLong { .. })
        ));
        assert_eq!(unfit.scene_error().key(), "lattice.rest.time_step");
        let adaptive = scene(&["lattice.rest.time_step=10 s", "lattice.rest.adaptive=true"]);
        assert!(SpringsRun::of_lattice(&adaptive).is_ok());
    }
}
