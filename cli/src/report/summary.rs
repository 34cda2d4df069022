//! The result of a run in numbers: `summary.json`, and the verdicts that a person reads.

use std::collections::BTreeMap;

use serde::Serialize;

use super::output::{FORMAT, Verdict};
use super::record::{Record, effect_name};
use pliant::accuracy::Chosen;
use pliant::mesh::measures::greatest;
use pliant::scene::Solver;
use pliant::simulation::measures::VOLUME_HELD;
use pliant::simulation::plan::{LeftOut, Planned};
use pliant::simulation::{Body, Measures, Simulation};

/// At the end of a motion that returns, a muscle is at most this share of its length from its start.
const RETURN_DISTANCE: f64 = 0.02;
/// And its edges are stretched by no more than this.
const RETURN_STRETCH: f64 = 0.05;

/// The result of a run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// Version of the form, [`FORMAT`].
    pub format: u32,
    /// The kind of scene, `muscles`.
    pub kind: &'static str,
    /// Name of the scene.
    pub scene: String,
    /// Frames computed after the start.
    pub frames: usize,
    /// Frames that the scene asks for.
    pub frames_wanted: usize,
    /// Whether the run was interrupted.
    pub interrupted: bool,
    /// Whether every muscle was converged in every frame.
    pub converged: bool,
    /// Estimated error of the solver, RMS over the vertices of the worst frame and muscle [m]: see
    /// [`MuscleSummary::error_estimate_m`].
    pub error_estimate_m: f64,
    /// What was chosen for the accuracy that the scene names.
    pub accuracy: Option<Delivered>,
    /// Muscles.
    pub muscles: Vec<MuscleSummary>,
    /// Where the time went.
    pub time: Time,
    /// What ran and what did not.
    pub effects: Effects,
    /// The solver and its settings.
    pub solver: String,
    /// Results of the checks.
    pub verdicts: Vec<Verdict>,
    /// Notes of reading and running.
    pub notes: Vec<String>,
}

/// One muscle over the run. Greatest values are over all frames, the start among them; a vertex of a bone is counted
/// as inside by exact winding numbers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MuscleSummary {
    /// Name.
    pub name: String,
    /// Number of vertices.
    pub vertices: usize,
    /// Number of triangles.
    pub triangles: usize,
    /// Vertices held by bones.
    pub vertices_attached: usize,
    /// Greatest absolute volume error after the start, relative to its target.
    pub volume_error_max: f64,
    /// Volume error at the end.
    pub volume_error_end: f64,
    /// Root mean square strain of edges at the end.
    pub edge_stretch_rms_end: f64,
    /// The same in the worst frame.
    pub edge_stretch_rms_worst: f64,
    /// The frame of it.
    pub worst_frame: usize,
    /// Greatest depth of a free vertex in a bone [m].
    pub penetration_max_m: f64,
    /// Most free vertices deeper than 0.01 mm in bones.
    pub vertices_inside_bones_max: usize,
    /// Most bone vertices inside the muscle.
    pub bone_vertices_inside_max: usize,
    /// Most vertices between bones closer than twice the contact thickness.
    pub vertices_pinched_max: usize,
    /// Most vertices that touch a bone.
    pub vertices_touching_max: usize,
    /// Deepest overlap with a bone before the start was untangled [m].
    pub start_overlap_m: f64,
    /// Root mean square distance of vertices to the start, at the end [m].
    pub distance_from_start_rms_m: f64,
    /// Greatest extent at rest [m].
    pub length_m: f64,
    /// Root mean square distance of elastic constraints from satisfaction, at the end [m].
    pub residual_end_m: f64,
    /// The same in the worst frame.
    pub residual_max_m: f64,
    /// Estimated error of the solver, RMS over the vertices of the worst frame [m]. By [`Body::error_estimate`],
    /// or where an accuracy was asked for by what the study that chose measured.
    pub error_estimate_m: f64,
    /// Frames that were not converged.
    pub frames_not_converged: usize,
    /// Velocities that were cut to the limit.
    pub speed_cuts: u64,
    /// Where it was stopped, by a number that is not finite or because it diverged.
    pub stopped: Option<Stopped>,
}

/// Solver and settings that were chosen for an accuracy.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Delivered {
    /// The error asked for, RMS [m].
    pub target_m: f64,
    /// The error expected in the worst frame [m].
    pub expected_m: f64,
    /// Whether the estimate for the whole run keeps what was asked for.
    pub reached: bool,
    /// The solver.
    pub solver: String,
    /// Its settings.
    pub settings: serde_json::Map<String, serde_json::Value>,
    /// Why it was chosen.
    pub why: String,
}

/// Where a muscle was stopped.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Stopped {
    /// The frame.
    pub frame: usize,
    /// The effect that gave the number.
    pub effect: String,
    /// The vertex.
    pub particle: usize,
}

/// Where the time went.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Time {
    /// From reading the scene until all but the report and this summary are written [s].
    pub total_s: f64,
    /// Reading the scene and its meshes, and making them ready [s].
    pub prepare_s: f64,
    /// After the last frame: the frames that waited to be written, tables, animation [s].
    pub finish_s: f64,
    /// Median of a frame, without audit [ms].
    pub frame_ms_median: f64,
    /// Audit of all frames [s].
    pub audit_s: f64,
    /// Each effect, summed over muscles, frames, threads [s].
    pub effects_s: BTreeMap<&'static str, f64>,
}

/// What ran and what did not.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Effects {
    /// What ran.
    pub run: Vec<Planned>,
    /// What did not, and why.
    pub left_out: Vec<LeftOut>,
}

impl Time {
    /// The times of a record, within those of the whole.
    pub fn of(record: &Record, total_s: f64, prepare_s: f64, finish_s: f64) -> Self {
        Self {
            total_s,
            prepare_s,
            finish_s,
            frame_ms_median: record.median_ms(),
            audit_s: record.times.iter().map(|t| t.audit_ms).sum::<f64>() * 1e-3,
            effects_s: record.effects_s().clone(),
        }
    }
}

impl Summary {
    /// Sums a run up.
    pub fn of(
        simulation: &Simulation,
        record: &Record,
        interrupted: bool,
        time: Time,
        chosen: Option<&Chosen>,
    ) -> Self {
        let scene = &simulation.scene;
        let muscles: Vec<_> = simulation
            .bodies
            .iter()
            .map(|b| muscle(b, record, chosen))
            .collect();
        let error_estimate_m = greatest(muscles.iter().map(|m| m.error_estimate_m));
        let mut verdicts = Vec::new();
        verdicts.extend(chosen.map(verdict_of));
        for (m, summary) in muscles.iter().enumerate() {
            verdicts.extend(verdicts_of(simulation, m, summary));
        }
        Self {
            format: FORMAT,
            kind: "muscles",
            scene: scene.name.clone(),
            frames: simulation.frame(),
            frames_wanted: scene.frames,
            interrupted,
            converged: muscles
                .iter()
                .all(|m| m.frames_not_converged == 0 && m.stopped.is_none()),
            error_estimate_m,
            accuracy: chosen.map(|c| Delivered {
                target_m: c.target_m,
                expected_m: c.expected_m,
                reached: c.is_kept(),
                solver: c.candidate.name().to_owned(),
                settings: c.candidate.settings(),
                why: c.why.clone(),
            }),
            muscles,
            time,
            effects: Effects {
                run: simulation.plan.run.clone(),
                left_out: simulation.plan.left_out.clone(),
            },
            solver: solver(&scene.solver),
            verdicts,
            notes: simulation
                .notes
                .iter()
                .cloned()
                .chain(simulation.bodies.iter().filter_map(cut))
                .collect(),
        }
    }

    /// Whether a number went wrong and a muscle was stopped.
    pub fn stopped(&self) -> bool {
        self.muscles.iter().any(|m| m.stopped.is_some())
    }

    /// The summary as JSON, with `null` for a number that is not finite.
    pub fn to_json(&self) -> String {
        // A structure of texts, numbers and lists with text keys always has a JSON form.
        serde_json::to_string_pretty(self).unwrap_or_default()
    }
}

/// Tells of velocities that were cut, which keeps numbers finite but is no motion of the scene.
fn cut(body: &Body) -> Option<String> {
    let (cuts, limit) = (body.system.speed_cuts, body.system.settings.speed_limit);
    let too_much = "forces, displacements or motions are too large";
    (cuts > 0).then(|| {
        format!(
            "{}: velocities were cut to {limit:.0} m/s {cuts} times: {too_much}",
            body.name
        )
    })
}

/// The solver and its settings in one line.
fn solver(solver: &Solver) -> String {
    match solver {
        Solver::Xpbd(s) => format!(
            "small-step XPBD: substeps {}, iterations {}, order {:?}, tolerance {}",
            s.substeps, s.iterations, s.order, s.tolerance
        ),
        Solver::Pbd(s) => format!(
            "classic PBD: substeps {}, iterations {}, stretch {}, bending {}, volume {}, velocity damping {}, order {:?}, \
             tolerance {}",
            s.substeps,
            s.iterations,
            s.stretch,
            s.bending,
            s.volume,
            s.velocity_damping,
            s.order,
            s.tolerance
        ),
        Solver::QuasiStatic(s) | Solver::ImplicitEuler(s) => format!(
            "{}: substeps {}, iterations at most {}, tolerance {} of the force of a strain of one",
            if matches!(solver, Solver::QuasiStatic(_)) {
                "quasi-static"
            } else {
                "implicit Euler"
            },
            s.substeps,
            s.iterations,
            s.tolerance
        ),
    }
}

/// Whether the accuracy that was asked for is kept, as far as can be estimated.
fn verdict_of(chosen: &Chosen) -> Verdict {
    let name = "the error is at most that of the accuracy";
    let verdict = Verdict::at_most(name, chosen.expected_m, chosen.target_m).in_unit("m");
    Verdict {
        passed: chosen.is_kept(),
        ..verdict.at(format!("all muscles, estimated: {}", chosen.why))
    }
}

fn muscle(body: &Body, record: &Record, chosen: Option<&Chosen>) -> MuscleSummary {
    let all: Vec<&Measures> = record.of_muscle(&body.name).collect();
    let end = |f: fn(&Measures) -> f64| all.last().map_or(0.0, |m| f(m));
    let most = |f: fn(&Measures) -> usize| all.iter().map(|m| f(m)).max().unwrap_or(0);
    let worst = all.iter().copied().reduce(|a, b| {
        if b.edge_stretch_rms > a.edge_stretch_rms {
            b
        } else {
            a
        }
    });
    let stopped = body.stopped.as_ref().map(|(frame, broken)| Stopped {
        frame: *frame,
        effect: effect_name(broken.effect).to_owned(),
        particle: broken.particle,
    });
    let residual_max_m = greatest(all.iter().filter(|m| m.frame > 0).map(|m| m.residual_m));
    MuscleSummary {
        name: body.name.clone(),
        vertices: body.rest.vertices.len(),
        triangles: body.rest.triangles.len(),
        vertices_attached: body.attached.len(),
        // At the start a muscle under pressure has not reached its target yet.
        volume_error_max: greatest(
            all.iter()
                .filter(|m| m.frame > 0)
                .map(|m| m.volume_error.abs()),
        ),
        volume_error_end: end(|m| m.volume_error),
        edge_stretch_rms_end: end(|m| m.edge_stretch_rms),
        edge_stretch_rms_worst: worst.map_or(0.0, |m| m.edge_stretch_rms),
        worst_frame: worst.map_or(0, |m| m.frame),
        penetration_max_m: greatest(all.iter().map(|m| m.penetration_m)),
        vertices_inside_bones_max: most(|m| m.vertices_inside_bones),
        bone_vertices_inside_max: most(|m| m.bone_vertices_inside),
        vertices_pinched_max: most(|m| m.vertices_pinched),
        vertices_touching_max: most(|m| m.vertices_touching),
        start_overlap_m: body.untangled.overlap,
        distance_from_start_rms_m: end(|m| m.distance_from_start_rms_m),
        length_m: body.length,
        residual_end_m: end(|m| m.residual_m),
        // There is no residual before the first step.
        residual_max_m,
        error_estimate_m: chosen
            .map_or_else(|| body.error_estimate(residual_max_m), |c| c.expected_m),
        frames_not_converged: all.iter().filter(|m| m.frame > 0 && !m.converged).count(),
        speed_cuts: body.system.speed_cuts,
        stopped,
    }
}

/// The promises that concern a muscle of this scene.
fn verdicts_of(simulation: &Simulation, m: usize, s: &MuscleSummary) -> Vec<Verdict> {
    let (scene, plan) = (&simulation.scene, &simulation.plan.muscles[m]);
    let mut all = Vec::new();
    let place = s.stopped.as_ref().map_or(s.name.clone(), |at| {
        format!(
            "{}, stopped at frame {}: {} at vertex {}",
            s.name, at.frame, at.effect, at.particle
        )
    });
    all.push(Verdict::new("all numbers stay finite", s.stopped.is_none()).at(place));
    let mut say = |verdict: Verdict| all.push(verdict.at(s.name.as_str()));
    let name = "every frame is converged: frames that are not";
    say(Verdict::none(name, s.frames_not_converged));
    if plan.volume
        && scene.muscles[m].material.bulk.is_none()
        && !matches!(scene.solver, Solver::Pbd(_))
    {
        let name = "volume error at most 1e-6";
        say(Verdict::at_most(name, s.volume_error_max, VOLUME_HELD));
    }
    if !plan.obstacles.is_empty() {
        let deepest = pliant::format::number(s.penetration_max_m * 1e3);
        let name = format!(
            "no vertex deeper than 0.01 mm in a bone (deepest {deepest} mm): vertices that are"
        );
        say(Verdict::none(name, s.vertices_inside_bones_max));
        let name = "no bone vertex inside the muscle: bone vertices that are";
        say(Verdict::none(name, s.bone_vertices_inside_max));
    }
    if simulation.frame() >= scene.frames && returns(simulation) {
        let share = s.distance_from_start_rms_m / s.length_m;
        let name = "back to 2 % of its length from the start, as a share of it";
        say(Verdict::at_most(name, share, RETURN_DISTANCE));
        let name = "edge stretch at the end at most 5 %, as a share";
        say(Verdict::at_most(
            name,
            s.edge_stretch_rms_end,
            RETURN_STRETCH,
        ));
    }
    all
}

/// Whether some bone moves and all are back where they began, so that a muscle should be, too.
fn returns(simulation: &Simulation) -> bool {
    let frames = simulation.scene.frames;
    let poses = |b: usize, f: usize| simulation.pose(b, f as f64);
    let bones = 0..simulation.bones.len();
    let moves = bones
        .clone()
        .any(|b| (0..=frames).any(|f| poses(b, f) != poses(b, 0)));
    let near = |b: usize| {
        let apart = poses(b, 0).inverse() * poses(b, frames);
        apart.translation.vector.norm() < 1e-9 && apart.rotation.angle() < 1e-9
    };
    moves && bones.clone().all(near)
}
