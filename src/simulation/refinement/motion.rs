//! An error that is a share of the motion: a first run with very few steps tells how far the muscles move.

use nalgebra::Point3;

use super::super::Simulation;
use super::super::frame::Stop;
use crate::mesh::measures::max_or_nan;

/// Number of steps of that run, relative to the usual one, and the least one.
const STEPS: f64 = 0.1;
const LEAST: f64 = 4.0;

/// Tolerance of its equilibria.
const TOLERANCE: f64 = 1e-2;

/// The target is this part of the share: the motion of so few steps is known to about a
/// twentieth.
const SAFE: f64 = 0.95;

/// Least target, relative to the length of the shortest muscle: what does not move has rounding alone.
const LEAST_TARGET: f64 = 1e-9;

/// The requested error.
pub(in crate::simulation) enum Target {
    /// RMS over the vertices of a frame [m].
    Error(f64),
    /// This share of the motion, which the run tells.
    ShareOfMotion(f64, Box<Simulation>),
}

/// A run that tells how far the muscles move.
pub(super) struct Pilot {
    /// `None` when it has told it.
    run: Option<Box<Simulation>>,
    share: f64,
    start: Vec<Vec<Point3<f64>>>,
    /// RMS distance of the vertices from the start in the worst frame so far [m].
    motion: f64,
    least: f64,
    note: Option<String>,
}

impl Pilot {
    pub fn new(mut run: Box<Simulation>, share: f64, usual: f64) -> Self {
        if run.scene.solver.has_inertia() {
            let steps = STEPS * usual;
            run.control
                .tell(if steps > LEAST { steps } else { LEAST } as u32);
        } else {
            run.set_tolerance(TOLERANCE);
        }
        let bodies = run.bodies.iter();
        let start = bodies.map(|body| body.system.particles.position.clone());
        let lengths = run.bodies.iter().map(|body| body.length);
        Self {
            start: start.collect(),
            least: LEAST_TARGET * lengths.fold(f64::INFINITY, f64::min),
            run: Some(run),
            share,
            motion: 0.0,
            note: None,
        }
    }

    /// Computes what is left of it. Returns false if it was stopped.
    pub fn runs_to_its_end(&mut self, stop: Stop<'_>) -> bool {
        let Some(run) = &mut self.run else {
            return true;
        };
        while run.frame() < run.scene.frames {
            if !run.compute_frame(stop) {
                return false;
            }
            let (mut sum, mut count) = (0.0, 0);
            for (body, start) in run.bodies.iter().zip(&self.start) {
                let now = body.system.particles.position.iter();
                let squares = now.zip(start).map(|(a, b)| (a - b).norm_squared());
                sum += squares.sum::<f64>();
                count += start.len();
            }
            let moved = (sum / count.max(1) as f64).sqrt();
            self.motion = max_or_nan([self.motion, moved]);
        }
        let stopped = run.bodies.iter().find(|body| body.stopped.is_some());
        self.note = stopped.map(|body| {
            format!(
                "{} stopped in the first run with few steps, which tells the motion: it can move farther",
                body.name
            )
        });
        self.run = None;
        true
    }

    /// RMS distance of the vertices from the start in the worst frame [m].
    pub fn motion(&self) -> f64 {
        self.motion
    }

    /// The requested error [m].
    pub fn target(&self) -> f64 {
        let target = SAFE * self.share * self.motion;
        // A NaN stays.
        if target < self.least {
            self.least
        } else {
            target
        }
    }

    /// What a reader must know of it.
    pub fn note(&self) -> Option<String> {
        self.note.clone()
    }
}
