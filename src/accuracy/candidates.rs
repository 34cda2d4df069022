//! Which solvers and settings are tried.

use serde_json::{Map, Value, json};

use crate::constraints::lanes::SimdWidth;
use crate::contact::broad_phase::{METHODS, Method};
use crate::scene::{Minimisation, Order, Scene, Solver, Xpbd};

/// What a solver answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Question {
    /// Where the muscles are at each time, mass and damping included.
    Motion,
    /// Where they come to rest at each pose of the bones.
    Equilibrium,
}

impl Question {
    /// What `solver` answers; `None` for classic PBD, which minimises no energy.
    pub fn of(solver: &Solver) -> Option<Self> {
        match solver {
            Solver::Xpbd(_) | Solver::ImplicitEuler(_) => Some(Self::Motion),
            Solver::QuasiStatic(_) => Some(Self::Equilibrium),
            Solver::Pbd(_) => None,
        }
    }
}

/// A solver with its settings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Solver and settings.
    pub solver: Solver,
    /// Constraints computed at once, at most.
    pub width: SimdWidth,
    /// Threads.
    pub threads: usize,
    /// How contact is looked for: the name of one of [`METHODS`]; `None` for the crate's own hierarchy, which is what runs
    /// have.
    pub way: Option<&'static str>,
}

/// Name of the crate's own way to look for contact.
pub const HIERARCHY: &str = "hierarchy";

/// Steps a frame of XPBD that are tried, one sweep each.
const SUBSTEPS: [u32; 8] = [2, 4, 8, 16, 32, 64, 128, 256];

impl Candidate {
    /// With as many lanes as there are, on `threads` threads.
    pub fn new(solver: Solver, threads: usize) -> Self {
        Self {
            solver,
            width: SimdWidth::best(),
            threads,
            way: None,
        }
    }

    /// The solver's name as scenes give it.
    pub fn name(&self) -> &'static str {
        match self.solver {
            Solver::Xpbd(_) => "xpbd",
            Solver::Pbd(_) => "pbd",
            Solver::QuasiStatic(_) => "quasi_static",
            Solver::ImplicitEuler(_) => "implicit_euler",
        }
    }

    /// Its settings, as scenes name them, with lanes and threads.
    pub fn settings(&self) -> Map<String, Value> {
        let mut all = Map::new();
        let mut note = |key: &str, value: Value| all.insert(key.to_owned(), value);
        note("substeps", json!(self.solver.substeps()));
        note("iterations", json!(self.solver.iterations()));
        match self.solver {
            Solver::Xpbd(_) | Solver::Pbd(_) => note("order", json!(self.solver.order().name())),
            Solver::QuasiStatic(s) | Solver::ImplicitEuler(s) => {
                note("tolerance", json!(s.tolerance))
            }
        };
        note("contact", json!(self.way.unwrap_or(HIERARCHY)));
        note("lanes", json!(self.width.lanes()));
        note("threads", json!(self.threads));
        all
    }

    /// The settings in a line: "substeps 8, sweeps 1, coloured".
    pub fn in_words(&self) -> String {
        let steps = self.solver.substeps();
        match self.solver {
            Solver::Xpbd(_) | Solver::Pbd(_) => {
                format!(
                    "substeps {steps}, sweeps {}, {}",
                    self.solver.iterations(),
                    self.solver.order().name()
                )
            }
            Solver::QuasiStatic(s) | Solver::ImplicitEuler(s) if s.iterations < MOST => {
                format!("substeps {steps}, iterations at most {}", s.iterations)
            }
            Solver::QuasiStatic(s) | Solver::ImplicitEuler(s) => {
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
        match self.solver {
            Solver::Xpbd(_) | Solver::Pbd(_) => {
                f64::from(self.solver.substeps()) * f64::from(self.solver.iterations())
            }
            Solver::QuasiStatic(s) | Solver::ImplicitEuler(s) => {
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
    let Solver::Xpbd(settings) = candidate.solver else {
        return Vec::new();
    };
    let orders = Order::NAMES
        .iter()
        .map(|(_, order)| *order)
        .filter(|order| *order != settings.order);
    orders
        .map(|order| Candidate {
            solver: Solver::Xpbd(Xpbd { order, ..settings }),
            ..*candidate
        })
        .collect()
}

/// Iterations that are enough for any tolerance.
pub(super) const MOST: u32 = 500;

/// A tolerance at which the limit of iterations ends a step first.
const TIGHT: f64 = 2e-4;

fn xpbd(scene: &Scene, substeps: u32, iterations: u32, order: Order) -> Solver {
    Solver::Xpbd(Xpbd {
        substeps,
        iterations,
        order,
        tolerance: converged_at(scene),
    })
}

/// Residual at which a frame of XPBD counts as converged, the scene's where it says so.
fn converged_at(scene: &Scene) -> f64 {
    if let Solver::Xpbd(s) = scene.solver {
        s.tolerance
    } else {
        0.01
    }
}

/// Equilibrium to a tolerance.
pub fn quasi_static(substeps: u32, tolerance: f64) -> Solver {
    Solver::QuasiStatic(Minimisation {
        substeps,
        iterations: MOST,
        tolerance,
    })
}

/// Implicit Euler to a tolerance.
pub fn implicit_euler(substeps: u32, tolerance: f64) -> Solver {
    Solver::ImplicitEuler(Minimisation {
        substeps,
        iterations: MOST,
        tolerance,
    })
}

/// All that is tried for a scene on `threads` threads, the cheap ones of each solver first.
pub fn all(scene: &Scene, threads: usize) -> Vec<Candidate> {
    let mut solvers: Vec<Solver> = SUBSTEPS
        .iter()
        .map(|n| xpbd(scene, *n, 1, Order::Coloured))
        .collect();
    solvers.extend([(8, 4), (16, 4), (32, 4)].map(|(n, k)| xpbd(scene, n, k, Order::Coloured)));
    solvers.push(xpbd(scene, 32, 1, Order::Stored));
    if let Solver::Xpbd(_) = scene.solver {
        solvers.push(scene.solver);
    }
    // Limited iterations follow a moving bone at a fixed price; a tolerance, at a fixed accuracy.
    solvers.extend([1, 2, 4, 8].map(|n| {
        Solver::QuasiStatic(Minimisation {
            substeps: 1,
            iterations: n,
            tolerance: TIGHT,
        })
    }));
    solvers.extend([1e-2, 3e-3, 1e-3, 3e-4, 1e-4].map(|t| quasi_static(1, t)));
    for n in [1, 2, 4] {
        solvers.extend([1e-2, 1e-3, 1e-4].map(|t| implicit_euler(n, t)));
    }
    let mut all: Vec<Candidate> = Vec::new();
    for solver in solvers {
        let candidate = Candidate::new(solver, threads);
        if !all.contains(&candidate) {
            all.push(candidate);
        }
    }
    all
}
