//! The estimated error of a run, and what a requested accuracy cost.

use serde::Serialize;
use serde_json::{Value, json};

use super::MuscleSummary;
use crate::report::output::Verdict;
use pliant::format::number;
use pliant::mesh::measures::max_or_nan;
use pliant::simulation::{Attained, Simulation};

/// An estimated error by its parts.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ErrorEstimate {
    /// Distance from the converged solution of the same model [m].
    pub solver_m: f64,
    /// Distance of that solution from one on an ever finer mesh [m].
    pub mesh_m: Option<f64>,
    /// Half of the interval that the parameters' intervals leave [m].
    pub parameters_m: Option<f64>,
    /// How the error of the solver was found.
    pub method: &'static str,
}

impl ErrorEstimate {
    /// That of a muscle with this greatest residual [m].
    pub(super) fn of(simulation: &Simulation, m: usize, residual_m: f64) -> Self {
        let body = &simulation.bodies[m];
        let of_solver = match simulation.attained() {
            Some(attained) => Self::by(attained.muscles_m[m], way(attained)),
            None => Self::by(body.error_estimate(residual_m), "the residual"),
        };
        Self {
            mesh_m: simulation.mesh_error_of(m),
            ..of_solver
        }
    }

    /// That of all muscles together: of all vertices, or of the worst muscle.
    pub(super) fn of_all(simulation: &Simulation, muscles: &[MuscleSummary]) -> Self {
        let of_solver = match simulation.attained() {
            Some(attained) => Self::by(attained.error_m, way(attained)),
            None => {
                let each = muscles.iter().map(|m| m.error_estimate.solver_m);
                Self::by(max_or_nan(each), "the residual")
            }
        };
        Self {
            mesh_m: simulation.mesh_error(),
            ..of_solver
        }
    }

    /// The estimate of a solver's error [m], and how it was found.
    pub(in crate::report) fn by(solver_m: f64, method: &'static str) -> Self {
        Self {
            solver_m,
            mesh_m: None,
            parameters_m: None,
            method,
        }
    }
}

/// How the error of an accuracy is found.
fn way(attained: &Attained) -> &'static str {
    match attained.tolerance > 0.0 {
        true => "a run with sixteen times the tolerance",
        false => "a run with half as many steps",
    }
}

/// What a requested accuracy cost.
pub(super) fn accuracy(attained: &Attained) -> Value {
    let frames = |run: usize| match attained.tolerance > 0.0 {
        true => json!({ "tolerance": attained.tolerance, "time_s": attained.times_s[run] }),
        false => json!({ "substeps": attained.steps[run], "time_s": attained.times_s[run] }),
    };
    let mut passes = [frames(0), frames(1)];
    passes[0]["difference_m"] = Value::Null;
    passes[1]["difference_m"] = json!(attained.difference_m);
    json!({
        "target_m": attained.target_m,
        "motion_m": (attained.motion_m != 0.0).then_some(attained.motion_m),
        "error_m": attained.error_m,
        "frame": attained.frame,
        "reached": attained.is_reached(),
        "choosing_s": attained.motion_s + attained.times_s[0] + attained.repeated_s,
        "run_s": attained.times_s[1],
        "frames_repeated": attained.repeated,
        "passes": passes,
    })
}

/// What the frames of an accuracy took, in one line.
pub(super) fn steps(simulation: &Simulation, attained: &Attained) -> String {
    let (name, tolerance) = (simulation.scene.solver.spec().name, attained.tolerance);
    match tolerance > 0.0 {
        true => format!(
            "{name}: tolerance at most {}, by the error",
            number(tolerance)
        ),
        false => {
            let mean = attained.steps[1] as f64 / simulation.frame().max(1) as f64;
            format!("{name}: substeps {mean:.1} in the mean, by the error of each frame")
        }
    }
}

/// The check of the second run, on a finer mesh.
pub(super) fn verdict_of_mesh(mesh_m: f64) -> Verdict {
    Verdict::new("the error of the mesh is known", mesh_m.is_finite())
        .else_do("a muscle stops on the finer mesh: a shorter `edge_length` shows where")
}

/// The check of the requested accuracy, by the estimate.
pub(super) fn verdict_of(attained: &Attained) -> Verdict {
    let name = "estimated error, RMS over the vertices of a frame";
    let verdict = Verdict::at_most(name, attained.error_m, attained.target_m).in_unit("m");
    let at = format!("all muscles, worst in frame {}", attained.frame);
    verdict
        .at(at)
        .else_do("ask for less accuracy, or make the motion slower or the material softer")
}
