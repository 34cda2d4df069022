//! Which solvers and settings are tried.

use serde_json::{Map, Value, json};

use crate::constraints::lanes::Width;
use crate::contact::broad_phase::{METHODS, Method};
pub use crate::scene::Question;
use crate::scene::solvers::{self, ENOUGH_ITERATIONS};
use crate::scene::{Order, Scene, Solver};

/// A solver with its settings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Solver and settings.
    pub solver: Solver,
    /// Constraints computed at once, at most.
    pub width: Width,
    /// Threads.
    pub threads: usize,
    /// How contact is looked for: the name of one of [`METHODS`]; `None` for the crate's own hierarchy, which is what runs
    /// have.
    pub way: Option<&'static str>,
}

/// Name of the crate's own way to look for contact.
pub const HIERARCHY: &str = "hierarchy";

impl Candidate {
    /// With as many lanes as there are, on `threads` threads.
    pub fn new(solver: Solver, threads: usize) -> Self {
        Self {
            solver,
            width: Width::best(),
            threads,
            way: None,
        }
    }

    /// The solver's name as scenes give it.
    pub fn name(&self) -> &'static str {
        self.solver.spec().key
    }

    /// Its settings, as scenes name them, with lanes and threads.
    pub fn settings(&self) -> Map<String, Value> {
        let mut all = Map::new();
        let mut note = |key: &str, value: Value| all.insert(key.to_owned(), value);
        note("substeps", json!(self.solver.substeps()));
        note("iterations", json!(self.solver.iterations()));
        match self.solver.minimisation() {
            None => note("order", json!(self.solver.order().name())),
            Some(s) => note("tolerance", json!(s.tolerance)),
        };
        note("contact", json!(self.way.unwrap_or(HIERARCHY)));
        note("lanes", json!(self.width.lanes()));
        note("threads", json!(self.threads));
        all
    }

    /// The settings in a line: "substeps 8, sweeps 1, coloured".
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

    /// The kind of way in which contact is looked for, where it is not the crate's own.
    pub fn kind_of_way(&self) -> Option<&'static Method> {
        METHODS.iter().find(|kind| Some(kind.name) == self.way)
    }

    /// Sweeps or, where an energy is minimised, steps of a frame: what its time goes with.
    pub fn work(&self) -> f64 {
        match self.solver.minimisation() {
            None => f64::from(self.solver.substeps()) * f64::from(self.solver.iterations()),
            Some(s) => {
                // Tighter tolerances take more iterations.
                f64::from(s.substeps)
                    * (1.0 - libm::log10(s.tolerance.min(0.1)))
                    * f64::from(s.iterations.min(20))
                    / 20.0
            }
        }
    }
}

/// The same sweeps in the other orders; none where nothing is swept.
pub fn in_other_orders(candidate: &Candidate) -> Vec<Candidate> {
    let mut others = Vec::new();
    for (_, order) in Order::NAMES {
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

/// All that is tried for a scene on `threads` threads, the cheap ones of each solver first.
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
