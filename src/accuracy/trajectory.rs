//! One run of a scene with one solver, and its measures.

use std::time::Instant;

use nalgebra::Point3;

use super::candidates::Candidate;
use super::distance::rise;
use crate::scene::Scene;
use crate::simulation::{Assets, LoadError, Plan, Simulation};

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
        if let Some(way) = candidate.kind_of_way() {
            simulation.set_contact_way(way);
        }
        let mut run = Self {
            converged: true,
            ..Self::default()
        };
        run.time_s = simulation
            .bodies
            .iter()
            .flat_map(|b| b.system.clock.effects.values())
            .map(|(s, _)| s)
            .sum();
        // Fails only if the system gives no threads: then the present ones are used.
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(candidate.threads)
            .build()
            .ok();
        for frame in 1..=frames {
            let begin = Instant::now();
            match &pool {
                Some(pool) => pool.install(|| simulation.step_frame()),
                None => simulation.step_frame(),
            }
            let took = begin.elapsed().as_secs_f64();
            run.time_s += took;
            run.note(&simulation);
            let goes_on = watch(frame, took);
            if run.stopped || !goes_on {
                run.cut_short = frame < frames;
                break;
            }
        }
        run.iterations = simulation
            .bodies
            .iter()
            .filter_map(|b| b.equilibrium.as_ref())
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
