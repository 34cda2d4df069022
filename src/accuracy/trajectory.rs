//! One run of a scene with one solver, and its measures.

use std::ops::ControlFlow;
use std::time::Duration;

use nalgebra::Point3;

use super::candidates::Candidate;
use super::distance::rise;
use crate::progress::Silent;
use crate::scene::Scene;
use crate::simulation::{self, Assets, LoadError, Observer, Plan, Simulation};

/// A run of a scene's first frames.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trajectory {
    /// Positions of all vertices of all muscles [m], `[frame][vertex]`, from frame 1.
    pub frames: Vec<Vec<Point3<f64>>>,
    /// Wall time of the steps and of their preparation [s], without files and audit.
    pub time_s: f64,
    /// Greatest relative departure of a volume from its target in any frame.
    pub volume_error: f64,
    /// Greatest depth of a free vertex in a bone [m] in any frame, by the audit.
    pub penetration_m: f64,
    /// Greatest residual of any frame [m].
    pub residual_m: f64,
    /// Greatest error estimate of the run itself [m].
    pub error_estimate_m: f64,
    /// Mean length of the fibres of all muscles at the last frame [m]; 0 without fibres.
    pub fibre_length_m: f64,
    /// Number of iterations of all steps and muscles; 0 for solvers with sweeps.
    pub iterations: u64,
    /// True if every frame of every muscle converged.
    pub converged: bool,
    /// True if a number that is not finite stopped a muscle.
    pub stopped: bool,
    /// True if the run ended before its last frame, by `watch` or by a stopped muscle.
    pub cut_short: bool,
}

impl Trajectory {
    /// Runs the first `frames` frames. `watch` receives every frame with its time [s] and stops the
    /// run by returning false.
    ///
    /// # Errors
    /// The solver cannot run the scene.
    pub fn of(
        scene: &Scene,
        assets: &Assets,
        candidate: &Candidate,
        frames: usize,
        watch: &mut dyn FnMut(usize, f64) -> bool,
    ) -> Result<Self, LoadError> {
        let scene = Scene {
            solver: candidate.solver,
            adapts_steps: false,
            accuracy: None,
            mesh_error: false,
            ..scene.clone()
        };
        let plan = Plan::new(&scene, assets);
        let mut simulation = Simulation::with(scene, assets.clone(), plan)?;
        for body in &mut simulation.bodies {
            body.system
                .elastic
                .iter_mut()
                .for_each(|batch| batch.set_width(candidate.width));
        }
        if let Some(method) = candidate.broad_phase_method() {
            simulation.set_broad_phase(method);
        }
        simulation.set_threads(candidate.threads);
        let prepared_s: f64 = simulation
            .bodies
            .iter()
            .flat_map(|b| b.system.clock.effects.values())
            .map(|(s, _)| s)
            .sum();
        let mut recorder = Recorder {
            trajectory: Self {
                converged: true,
                time_s: prepared_s,
                ..Self::default()
            },
            frames,
            watch,
        };
        simulation::run(&mut simulation, &mut [&mut recorder], &Silent);
        let mut run = recorder.trajectory;
        run.iterations = simulation
            .bodies
            .iter()
            .filter_map(|b| b.equilibrium())
            .map(|e| e.iterations)
            .sum();
        run.fibre_length_m = fibre_length(&simulation);
        Ok(run)
    }

    fn note(&mut self, simulation: &Simulation) {
        let bodies = &simulation.bodies;
        self.frames.push(
            bodies
                .iter()
                .flat_map(|b| b.system.particles.position.iter().copied())
                .collect(),
        );
        for (body, m) in bodies.iter().zip(simulation.measure()) {
            rise(
                &mut self.error_estimate_m,
                body.error_estimate(m.residual_m),
            );
            rise(&mut self.volume_error, m.volume_error.abs());
            rise(&mut self.penetration_m, m.penetration_m);
            rise(&mut self.residual_m, m.residual_m);
            self.converged &= m.converged;
        }
        self.stopped |= bodies.iter().any(|b| b.stopped.is_some());
    }
}

/// Records the first frames of a run, and ends it after them.
struct Recorder<'a> {
    trajectory: Trajectory,
    frames: usize,
    watch: &'a mut dyn FnMut(usize, f64) -> bool,
}

impl Observer<Simulation> for Recorder<'_> {
    fn start(&mut self, _: &Simulation) -> ControlFlow<()> {
        if self.frames == 0 {
            return ControlFlow::Break(());
        }
        ControlFlow::Continue(())
    }

    fn frame(&mut self, simulation: &Simulation, took: Duration) -> ControlFlow<()> {
        let (frame, took) = (simulation.frame(), took.as_secs_f64());
        self.trajectory.time_s += took;
        self.trajectory.note(simulation);
        let goes_on = (self.watch)(frame, took);
        if self.trajectory.stopped || !goes_on {
            self.trajectory.cut_short = frame < self.frames;
            return ControlFlow::Break(());
        }
        if frame >= self.frames {
            return ControlFlow::Break(());
        }
        ControlFlow::Continue(())
    }
}

/// Mean length of all fibres [m].
fn fibre_length(simulation: &Simulation) -> f64 {
    let mut lengths = Vec::new();
    for body in &simulation.bodies {
        for line in body.fibres.at(&body.system.particles.position) {
            lengths.push(line.windows(2).map(|p| (p[1] - p[0]).norm()).sum::<f64>());
        }
    }
    crate::mesh::sum::tree_sum(&lengths) / lengths.len().max(1) as f64
}
