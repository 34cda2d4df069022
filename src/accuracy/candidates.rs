//! Solvers and settings of a study.

use serde_json::{Map, Value, json};

use crate::constraints::lanes::SimdWidth;
use crate::contact::broad_phase::{BroadPhase, METHODS};
pub use crate::scene::SolverQuestion;
use crate::scene::solvers::{self, ENOUGH_ITERATIONS};
use crate::scene::{Scene, Solver, SweepOrder};

/// A solver with its settings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Solver and settings.
    pub solver: Solver,
    /// SIMD width: greatest number of constraints computed at once.
    pub width: SimdWidth,
    /// Number of threads.
    pub threads: usize,
    /// Method of contact search: the name of one of [`METHODS`]; `None` for the default hierarchy.
    pub broad_phase: Option<&'static str>,
}

/// Name of the default method of contact search.
pub const HIERARCHY: &str = "hierarchy";

impl Candidate {
    /// A candidate with the best SIMD width, on `threads` threads.
    pub fn new(solver: Solver, threads: usize) -> Self {
        Self {
            solver,
            width: SimdWidth::best(),
            threads,
            broad_phase: None,
        }
    }

    /// Key of the solver in scenes.
    pub fn solver_key(&self) -> &'static str {
        self.solver.spec().key
    }

    /// Settings as named in scenes, with lanes and threads.
    pub fn settings(&self) -> Map<String, Value> {
        let mut all = Map::new();
        let mut note = |key: &str, value: Value| all.insert(key.to_owned(), value);
        note("substeps", json!(self.solver.substeps()));
        note("iterations", json!(self.solver.iterations()));
        match self.solver.minimisation() {
            None => note("order", json!(self.solver.order().name())),
            Some(s) => note("tolerance", json!(s.tolerance)),
        };
        note("contact", json!(self.broad_phase.unwrap_or(HIERARCHY)));
        note("lanes", json!(self.width.lanes()));
        note("threads", json!(self.threads));
        all
    }

    /// The settings as text: "substeps 8, sweeps 1, coloured".
    pub fn in_words(&self) -> String {
        let steps = self.solver.substeps();
        match self.solver.minimisation() {
            None => {
                format!(
                    "substeps {steps}, sweeps {}, {}",
                    self.solver.iterations(),
                    self.solver.order().name()
                )
            }
            Some(s) if s.iterations < ENOUGH_ITERATIONS => {
                format!("substeps {steps}, iterations at most {}", s.iterations)
            }
            Some(s) => {
                format!(
                    "substeps {steps}, tolerance {}",
                    crate::format::number(s.tolerance)
                )
            }
        }
    }

    /// The method of contact search, if it is not the default.
    pub fn broad_phase_method(&self) -> Option<&'static BroadPhase> {
        METHODS
            .iter()
            .find(|kind| Some(kind.name) == self.broad_phase)
    }

    /// Number of sweeps or, for minimisation, of steps per frame: the time is proportional to it.
    pub fn work(&self) -> f64 {
        match self.solver.minimisation() {
            None => f64::from(self.solver.substeps()) * f64::from(self.solver.iterations()),
            Some(s) => {
                // Smaller tolerances need more iterations.
                f64::from(s.substeps)
                    * (1.0 - libm::log10(s.tolerance.min(0.1)))
                    * f64::from(s.iterations.min(20))
                    / 20.0
            }
        }
    }
}

/// The same candidate with the other orders of a sweep; empty for a solver without sweeps.
pub fn in_other_orders(candidate: &Candidate) -> Vec<Candidate> {
    let mut others = Vec::new();
    for (_, order) in SweepOrder::NAMES {
        if let Some(solver) = candidate.solver.with_order(order)
            && solver != candidate.solver
        {
            others.push(Candidate {
                solver,
                ..*candidate
            });
        }
    }
    others
}

/// All candidates for a scene on `threads` threads, the cheap ones of each solver first.
pub fn all(scene: &Scene, threads: usize) -> Vec<Candidate> {
    let mut all: Vec<Candidate> = Vec::new();
    for solver in solvers::candidates(&scene.solver) {
        let candidate = Candidate::new(solver, threads);
        if !all.contains(&candidate) {
            all.push(candidate);
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::SOLVERS;

    #[test]
    fn a_candidate_has_one_other_for_each_other_order() {
        for spec in &SOLVERS {
            let candidate = Candidate {
                broad_phase: Some(METHODS[0].name),
                ..Candidate::new(spec.default, 3)
            };
            let others = in_other_orders(&candidate);
            if candidate.solver.minimisation().is_some() {
                assert_eq!(others, []);
                continue;
            }
            assert_eq!(others.len(), SweepOrder::NAMES.len() - 1);
            for (k, other) in others.iter().enumerate() {
                let order = other.solver.order();
                assert!(order != candidate.solver.order());
                assert!(others[..k].iter().all(|o| o.solver.order() != order));
                // Nothing else differs.
                let back = other.solver.with_order(candidate.solver.order());
                let back = back.map(|solver| Candidate { solver, ..*other });
                assert_eq!(back, Some(candidate));
            }
        }
    }
}
