//! The results of a run as numbers: `summary.json`, and the verdicts for the user.

use std::collections::BTreeMap;

use serde::Serialize;

use super::output::{FORMAT, Verdict};
use super::record::{Record, effect_name};
use pliant::accuracy::Chosen;
use pliant::mesh::measures::max_or_nan;
use pliant::scene::Solver;
use pliant::simulation::{Body, LeftOut, Measures, Planned, Simulation, VOLUME_HELD};

/// Greatest distance of a muscle from its start at the end of a motion that returns, relative to
/// its length.
const RETURN_DISTANCE: f64 = 0.02;
/// Greatest strain of its edges then.
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
    /// Number of frames computed after the start.
    pub frames: usize,
    /// Number of frames of the scene.
    pub frames_wanted: usize,
    /// True if the run was interrupted.
    pub interrupted: bool,
    /// True if every muscle converged in every frame.
    pub converged: bool,
    /// Estimated error of the solver, RMS over the vertices of the worst frame and muscle [m]: see
    /// [`MuscleSummary::error_estimate_m`].
    pub error_estimate_m: f64,
    /// The selection for the accuracy of the scene.
    pub accuracy: Option<Delivered>,
    /// Muscles.
    pub muscles: Vec<MuscleSummary>,
    /// Times.
    pub time: Time,
    /// Effects that ran and did not run.
    pub effects: Effects,
    /// The solver and its settings.
    pub solver: String,
    /// Results of the checks.
    pub verdicts: Vec<Verdict>,
    /// Notes from reading and from the run.
    pub notes: Vec<String>,
}

/// One muscle over the run. Greatest values are over all frames including the start; exact winding
/// numbers decide whether a vertex of a bone is inside.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MuscleSummary {
    /// Name.
    pub name: String,
    /// Number of vertices.
    pub vertices: usize,
    /// Number of triangles.
    pub triangles: usize,
    /// Number of attached vertices.
    pub vertices_attached: usize,
    /// Greatest absolute volume error after the start, relative to its target.
    pub volume_error_max: f64,
    /// Volume error at the end.
    pub volume_error_end: f64,
    /// Root mean square strain of edges at the end.
    pub edge_stretch_rms_end: f64,
    /// Root mean square strain of edges in the worst frame.
    pub edge_stretch_rms_worst: f64,
    /// The worst frame.
    pub worst_frame: usize,
    /// Greatest depth of a free vertex in a bone [m].
    pub penetration_max_m: f64,
    /// Greatest number of free vertices deeper than 0.01 mm in bones.
    pub vertices_inside_bones_max: usize,
    /// Greatest number of bone vertices inside the muscle.
    pub bone_vertices_inside_max: usize,
    /// Greatest number of vertices between bones closer together than twice the contact thickness.
    pub vertices_pinched_max: usize,
    /// Greatest number of vertices in contact with a bone.
    pub vertices_touching_max: usize,
    /// Greatest overlap with a bone before its removal at the start [m].
    pub start_overlap_m: f64,
    /// Root mean square distance of vertices from their start positions, at the end [m].
    pub distance_from_start_rms_m: f64,
    /// Greatest extent at rest [m].
    pub length_m: f64,
    /// Root mean square residual of the elastic constraints, at the end [m].
    pub residual_end_m: f64,
    /// Root mean square residual of the elastic constraints in the worst frame [m].
    pub residual_max_m: f64,
    /// Estimated error of the solver, RMS over the vertices of the worst frame [m]: from
    /// [`Body::error_estimate`], or for a requested accuracy from the measurements of its study.
    pub error_estimate_m: f64,
    /// Number of frames that did not converge.
    pub frames_not_converged: usize,
    /// Number of velocities that were clamped to the limit.
    pub speed_cuts: u64,
    /// Place of a stop by a number that is not finite, or by divergence.
    pub stopped: Option<Stopped>,
}

/// Solver and settings selected for an accuracy.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Delivered {
    /// Requested RMS error [m].
    pub target_m: f64,
    /// Expected error in the worst frame [m].
    pub expected_m: f64,
    /// True if the estimate for the whole run is within the requested error.
    pub reached: bool,
    /// The solver.
    pub solver: String,
    /// Settings of the solver.
    pub settings: serde_json::Map<String, serde_json::Value>,
    /// The reason of the selection.
    pub why: String,
}

/// Place of a stop.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Stopped {
    /// Index of the frame.
    pub frame: usize,
    /// The effect with the error.
    pub effect: String,
    /// Index of the vertex.
    pub particle: usize,
}

/// Times of a run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Time {
    /// From reading the scene until all files except the report and this summary are written [s].
    pub total_s: f64,
    /// Reading and preparation of the scene and its meshes [s].
    pub prepare_s: f64,
    /// After the last frame: waiting frames, tables, animation [s].
    pub finish_s: f64,
    /// Median time of a frame, without audit [ms].
    pub frame_ms_median: f64,
    /// Audit of all frames [s].
    pub audit_s: f64,
    /// Time of each effect, summed over muscles, frames, threads [s].
    pub effects_s: BTreeMap<&'static str, f64>,
}

/// Effects that ran and did not run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Effects {
    /// Effects that ran.
    pub run: Vec<Planned>,
    /// Effects that did not run, with the reasons.
    pub left_out: Vec<LeftOut>,
}

impl Time {
    /// The times of a record, within the given total times.
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
    /// Creates the summary of a run.
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
        let error_estimate_m = max_or_nan(muscles.iter().map(|m| m.error_estimate_m));
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
                solver: c.candidate.solver_key().to_owned(),
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

    /// True if an invalid number stopped a muscle.
    pub fn stopped(&self) -> bool {
        self.muscles.iter().any(|m| m.stopped.is_some())
    }

    /// The summary as JSON, with `null` for a number that is not finite.
    pub fn to_json(&self) -> String {
        // A structure of texts, numbers and lists with text keys always has a JSON form.
        serde_json::to_string_pretty(self).unwrap_or_default()
    }
}

/// A note on clamped velocities: numbers stay finite, but the motion is not that of the scene.
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
    let mut settings = Vec::new();
    for (key, value) in solver.settings() {
        settings.push(format!("{} {value}", key.key.replace('_', " ")));
    }
    format!("{}: {}", solver.spec().name, settings.join(", "))
}

/// The check of the requested accuracy, by the estimate.
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
    let residual_max_m = max_or_nan(all.iter().filter(|m| m.frame > 0).map(|m| m.residual_m));
    MuscleSummary {
        name: body.name.clone(),
        vertices: body.rest.vertices.len(),
        triangles: body.rest.triangles.len(),
        vertices_attached: body.attached.len(),
        // At the start a muscle under pressure has not reached its target.
        volume_error_max: max_or_nan(
            all.iter()
                .filter(|m| m.frame > 0)
                .map(|m| m.volume_error.abs()),
        ),
        volume_error_end: end(|m| m.volume_error),
        edge_stretch_rms_end: end(|m| m.edge_stretch_rms),
        edge_stretch_rms_worst: worst.map_or(0.0, |m| m.edge_stretch_rms),
        worst_frame: worst.map_or(0, |m| m.frame),
        penetration_max_m: max_or_nan(all.iter().map(|m| m.penetration_m)),
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

/// Advice for a muscle whose steps are too long.
const MORE_SUBSTEPS: &str = "use more substeps, or `[solver.quasi_static]`";

/// The checks of a muscle of this scene.
fn verdicts_of(simulation: &Simulation, m: usize, s: &MuscleSummary) -> Vec<Verdict> {
    let (scene, plan) = (&simulation.scene, &simulation.plan.muscles[m]);
    let mut all = Vec::new();
    let place = s.stopped.as_ref().map_or(s.name.clone(), |at| {
        format!(
            "{}, stopped at frame {}: {} at vertex {}",
            s.name, at.frame, at.effect, at.particle
        )
    });
    let finite = Verdict::new("all numbers are finite", s.stopped.is_none()).at(place);
    all.push(finite.else_do(MORE_SUBSTEPS));
    let mut say = |verdict: Verdict| all.push(verdict.at(s.name.as_str()));
    let unconverged = Verdict::none("frames that did not converge", s.frames_not_converged);
    say(unconverged.else_do(MORE_SUBSTEPS));
    if plan.runs("volume")
        && scene.muscles[m].material.bulk.is_none()
        && scene.solver.share("volume").is_none()
    {
        let volume = Verdict::at_most("relative volume error", s.volume_error_max, VOLUME_HELD);
        say(volume.else_do(MORE_SUBSTEPS));
    }
    if !plan.obstacles.is_empty() {
        let deep = Verdict::none(
            "vertices deeper than 0.01 mm in a bone",
            s.vertices_inside_bones_max,
        );
        say(deep.else_do(MORE_SUBSTEPS));
        let inside = Verdict::none(
            "bone vertices inside the muscle",
            s.bone_vertices_inside_max,
        );
        say(inside.else_do("use more substeps, or a shorter `edge_length`"));
    }
    if simulation.frame() >= scene.frames && returns(simulation) {
        let share = s.distance_from_start_rms_m / s.length_m;
        let name = "distance from the start at the end, relative to the length";
        say(Verdict::at_most(name, share, RETURN_DISTANCE));
        let name = "edge stretch at the end, RMS";
        say(Verdict::at_most(
            name,
            s.edge_stretch_rms_end,
            RETURN_STRETCH,
        ));
    }
    all
}

/// True if some bone moves and all return to their start, so that a muscle should, too.
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
