//! The result of a run of muscles: measures and checks of each muscle.

mod error;
mod shown;

use serde::Serialize;
use serde_json::{Value, json};

pub(super) use error::ErrorEstimate;

use super::audit::{self, RunAudit};
use super::output::{Plot, RunOutput, SceneRun, Times, Verdict};
use super::plan::Prepared;
use super::quality::{self, Quality, RunQuality, Worst};
use super::record::{Record, effect_name};
use super::sensitivities::left_out;
use pliant::contact::{Certificate, PartedPair};
use pliant::mesh::measures::{max_or_nan, median};
use pliant::scene::{Solver, Source, likely_units};
use pliant::simulation::{Body, Measures, Simulation, VOLUME_HELD};

/// Greatest distance of a muscle from its start at the end of a motion that returns, relative to
/// its length.
const RETURN_DISTANCE: f64 = 0.02;
/// Greatest strain of its edges then.
const RETURN_STRETCH: f64 = 0.05;

/// Greatest RMS motion of a muscle by the parting of overlapping surfaces at the start [m].
const START_MOTION: f64 = 2e-3;
/// Greatest relative change of volume by it.
const START_VOLUME: f64 = 1e-6;

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
    /// Greatest absolute strain of an edge in any frame.
    pub edge_stretch_max: f64,
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
    /// Estimated error, RMS over the vertices of the worst frame.
    pub error_estimate: ErrorEstimate,
    /// Number of frames that did not converge.
    pub frames_not_converged: usize,
    /// Number of velocities that were clamped to the limit.
    pub speed_cuts: u64,
    /// Jitter, snaps, lift-off, thickness and folds.
    pub quality: Quality,
    /// Place of a stop by a number that is not finite, or by divergence.
    pub stopped: Option<Stopped>,
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

/// The result of a run, without the parts that all scenes have in common.
pub(super) fn output(
    simulation: &Simulation,
    record: Record,
    (audit, judged): (&RunAudit, &RunQuality),
) -> RunOutput<'static> {
    let mut muscles = summaries(simulation, &record);
    for (muscle, quality) in muscles.iter_mut().zip(judged.of_muscles()) {
        muscle.quality = quality;
    }
    let attained = simulation.attained();
    let mut verdicts: Vec<Verdict> = attained.map(error::verdict_of).into_iter().collect();
    verdicts.extend(simulation.mesh_error().map(error::verdict_of_mesh));
    for (m, summary) in muscles.iter().enumerate() {
        verdicts.extend(verdicts_of(simulation, m, summary, &judged.worst(m)));
    }
    let has_contact = simulation.scene.effects.contact.is_some();
    if has_contact {
        verdicts.extend(audit::crossing_verdicts(&audit.summary, SEE_AUDIT));
    }
    let crossings = audit.summary.crossings_max.all;
    let uncounted = (!has_contact && crossings > 0).then(|| {
        format!("without [effects.contact], {crossings} pairs of triangles cross in a frame")
    });
    verdicts.push(certified(&simulation.certificate()));
    verdicts.extend(start_checks(simulation));
    verdicts.extend(simulation.bodies.iter().filter_map(cut));
    verdicts.extend(muscles.iter().enumerate().flat_map(|(m, muscle)| {
        let limits = &simulation.scene.limits;
        let of = (&*muscle.name, muscle.length_m);
        quality::verdicts(&muscle.quality, &judged.worst(m), limits, of)
    }));
    let plot = |plot| Plot { file: None, plot };
    let mut how = solver(&simulation.scene.solver);
    if let Some(attained) = attained {
        how = error::steps(simulation, attained);
    }
    let mut tables = shown::tables(&muscles, &record, &how);
    tables.push(audit::table(&audit.summary));
    tables.extend(Prepared::new(simulation).tables());
    tables.retain(|t| !t.rows.is_empty());
    let plots = shown::plots(
        &muscles,
        &simulation.plan,
        &record,
        attained.map(|a| a.target_m),
    );
    RunOutput {
        kind: "muscles",
        measures: json!({
            "solver": how,
            "error_estimate": ErrorEstimate::of_all(simulation, &muscles),
            "accuracy": attained.map(error::accuracy),
            "muscles": muscles,
        }),
        scene: Some(SceneRun {
            converged: muscles
                .iter()
                .all(|m| m.frames_not_converged == 0 && m.stopped.is_none()),
            stopped: muscles.iter().find_map(MuscleSummary::stop),
            times: times(&record),
            ..SceneRun::default()
        }),
        verdicts,
        notes: (simulation.notes.iter().cloned())
            .chain(uncounted)
            .chain([audit.note()])
            .chain(left_out(simulation.scene.origin.uncertain()))
            .collect(),
        certificate: Some(certificate(&simulation.certificate())),
        start: Some(starts(simulation)),
        text: shown::text(&muscles),
        lead: vec![shown::error_table(&muscles)],
        tables,
        audit: Some(audit.measures()),
        plots: plots.into_iter().map(plot).collect(),
        data: record.into_data().into(),
        ..RunOutput::default()
    }
}

/// Whether every near pair was kept in order in every step. The audit looks at some frames only.
fn certified(counts: &Certificate) -> Verdict {
    Verdict::none(
        "pairs that were not kept in order, over all steps",
        counts.open as usize,
    )
    .at("all surfaces")
    .else_do("use more substeps, or less motion of bones that close on a muscle")
}

/// The counts that certify that nothing crossed.
fn certificate(counts: &Certificate) -> Value {
    json!({
        "pairs": counts.pairs,
        "truncated": counts.truncated,
        "held": counts.held,
        "open": counts.open,
        "least_gap_m": counts.least_gap.is_finite().then_some(counts.least_gap),
    })
}

/// The pairs of surfaces that were parted before the start.
pub(super) fn starts(simulation: &Simulation) -> Value {
    simulation.parted.iter().map(start).collect()
}

/// A pair of surfaces that was parted before the start.
fn start(parted: &PartedPair) -> Value {
    json!({
        "pair": parted.pair,
        "crossings": parted.crossings,
        "depth_m": parted.depth,
        "moved_rms_m": parted.moved.rms,
        "moved_max_m": parted.moved.max,
        "volume_change": parted.moved.volume_change,
    })
}

/// Whether the parting of a pair kept shape and volume.
fn start_verdicts(parted: &PartedPair) -> [Verdict; 2] {
    let pair = parted.pair.join(" and ");
    let name = "motion that parted overlapping surfaces at the start, RMS";
    let moved = Verdict::at_most(name, parted.moved.rms, START_MOTION).in_unit("m");
    let name = "relative change of volume by the parting at the start";
    let volume = Verdict::at_most(name, parted.moved.volume_change.abs(), START_VOLUME);
    let advice =
        "part the surfaces in a program for meshes; `pliant check A B` shows where they overlap";
    [moved, volume].map(|verdict| verdict.at(pair.as_str()).else_do(advice))
}

/// The times of the frames.
fn times(record: &Record) -> Times {
    let steps = record.times.iter().map(|t| t.step_ms * 1e-3);
    let audits = record.times.iter().map(|t| t.audit_ms * 1e-3);
    Times {
        frames_s: steps.clone().sum(),
        frame_median_s: median(steps.collect()).unwrap_or(0.0),
        audit_s: Some(audits.sum()),
        effects_s: record.effects_s().clone(),
        ..Times::default()
    }
}

/// Each muscle over a run.
pub fn summaries(simulation: &Simulation, record: &Record) -> Vec<MuscleSummary> {
    let bodies = 0..simulation.bodies.len();
    bodies.map(|m| muscle(simulation, m, record)).collect()
}

impl MuscleSummary {
    /// The place of its stop in words.
    pub fn stop(&self) -> Option<String> {
        let at = self.stopped.as_ref()?;
        let (effect, vertex, frame) = (&at.effect, at.particle, at.frame);
        Some(format!(
            "{effect} at vertex {vertex} of {} in frame {frame}",
            self.name
        ))
    }
}

/// The check that no velocity was limited: numbers stay finite, but the motion is not that of the scene.
fn cut(body: &Body) -> Option<Verdict> {
    let (cuts, limit) = (body.system.speed_cuts, body.system.settings.speed_limit);
    let name = format!("velocities that were cut to {limit:.0} m/s");
    let check = Verdict::none(name, cuts as usize).at(body.name.as_str());
    (cuts > 0)
        .then(|| check.else_do("forces, displacements, motions or the frame rate are too large"))
}

/// The solver and its settings in one line.
fn solver(solver: &Solver) -> String {
    let mut settings = Vec::new();
    for (key, value) in solver.settings() {
        settings.push(format!("{} {value}", key.key.replace('_', " ")));
    }
    format!("{}: {}", solver.spec().name, settings.join(", "))
}

fn muscle(simulation: &Simulation, m: usize, record: &Record) -> MuscleSummary {
    let body = &simulation.bodies[m];
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
        edge_stretch_max: max_or_nan(all.iter().map(|m| m.edge_stretch_max)),
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
        error_estimate: ErrorEstimate::of(simulation, m, residual_max_m),
        frames_not_converged: all.iter().filter(|m| m.frame > 0 && !m.converged).count(),
        speed_cuts: body.system.speed_cuts,
        quality: Quality::default(),
        stopped,
    }
}

/// Advice after crossings.
const SEE_AUDIT: &str = "`audit.pairs` in summary.json names all pairs";

/// Advice for a muscle whose steps are too long.
const MORE_SUBSTEPS: &str = "use more substeps, or `[solver.quasi_static]`";

/// What to do about an equilibrium that is not found.
const HOLD_IT: &str =
    "allow more iterations; each vertex needs an effect that holds it, such as `[effects.stretch]`";

/// Greatest length of an edge whose ends two bones hold, relative to that at rest: tissue that is
/// longer tears.
const APART: f64 = 2.0;
/// Greatest strain of an edge: the built-in press, which closes to a tenth, reaches 2.8.
pub const TORN: f64 = 4.0;
/// Greatest share of an attachment that is free, as the motion would carry it into another bone: what
/// remains of a smaller part is not the attachment that was asked for.
const FREED: f64 = 0.5;
/// Greatest distance of a fibre outside its muscle, relative to the muscle's length: a surface that is
/// remeshed and leaves its bones moves by less than 2 % of it.
const OUTSIDE: f64 = 0.05;
/// Greatest distance of an end from a bone that holds it across a joint, relative to the muscle's length: from
/// here on `pliant fibres` takes a tendon for missing.
const ACROSS: f64 = 0.02;
const ADD_THE_TENDON: &str = "add the tendon to the mesh, as `pliant init` does: this end turns with \
                              the bone about an axis that it lies beyond";
const TURN_RIGHT: &str = "look at the axis and the centre of the joint; if they are right, hold a place \
                          away from the other bone (a patch or `vertices`)";
const HOLD_FEWER: &str = "if two bones hold vertices near each other, hold fewer (`limit`, `near`, \
                          `within`), or by patches that do not meet";

/// The checks of a scene before its first frame.
pub(super) fn start_checks(simulation: &Simulation) -> Vec<Verdict> {
    let of_muscles = (0..simulation.bodies.len()).flat_map(|m| attachment_checks(simulation, m));
    let parted = simulation.parted.iter().flat_map(start_verdicts);
    let sizes = sizes(simulation);
    let fibres = fibre_checks(simulation);
    of_muscles
        .chain(parted)
        .chain(sizes)
        .chain(fibres)
        .collect()
}

/// The checks that surfaces from files have the size of a part of a body: their unit may be wrong.
fn sizes(simulation: &Simulation) -> Vec<Verdict> {
    let scene = &simulation.scene;
    let bones = scene.bones.iter().zip(&simulation.bones);
    let bones = bones.map(|(bone, mesh)| (&bone.name, &bone.surface, mesh.length()));
    let muscles = scene.muscles.iter().zip(&simulation.bodies);
    let muscles = muscles.map(|(muscle, body)| (&muscle.name, &muscle.surface, body.length));
    let all = bones.chain(muscles);
    all.filter(|(_, source, _)| matches!(source, Source::File { .. }))
        .filter_map(|(name, _, length)| size(name, length))
        .collect()
}

/// The check of the length [m] of a surface; `None` for a part of a body.
fn size(name: &str, length: f64) -> Option<Verdict> {
    let likely = likely_units(length);
    if likely.iter().any(|(unit, _)| *unit == "m") {
        return None;
    }
    let check = Verdict::new("its length is that of a part of a body", false)
        .with_value(length)
        .in_unit("m")
        .at(name);
    Some(check.else_do("correct `unit`; `pliant check FILE` says which units are likely"))
}

/// The checks that fibres from files lie in their muscles.
fn fibre_checks(simulation: &Simulation) -> impl Iterator<Item = Verdict> + '_ {
    let muscles = simulation.scene.muscles.iter().zip(&simulation.bodies);
    let read = muscles.filter(|(muscle, _)| {
        let source = muscle.fibres.as_ref();
        source.is_some_and(|source| !matches!(source, Source::Shape(_)))
    });
    read.map(|(muscle, body)| {
        let name = "distance of the fibres from the muscle, relative to its length";
        let outside = Verdict::at_most(name, body.fibres.outside / body.length, OUTSIDE);
        let cure = "take the fibres of this muscle (`fibres.lines`), and check their `unit`";
        outside.at(muscle.name.as_str()).else_do(cure)
    })
}

/// The checks of a muscle's attachments.
fn attachment_checks(simulation: &Simulation, m: usize) -> Vec<Verdict> {
    let scene = &simulation.scene;
    let name = &scene.muscles[m].name;
    let mut all = Vec::new();
    if let Some((edges, length, bones)) = simulation.held_apart(m) {
        let [one, other] = bones.map(|bone| scene.bones[bone].name.as_str());
        let what = "greatest length of an edge between attachments, relative to that at rest";
        let apart = Verdict::at_most(what, length, APART).else_do(HOLD_FEWER);
        all.push(apart.at(format!("{name}, {edges} edges, between {one} and {other}")));
    }
    if let Some((share, bones)) = simulation.most_freed(m) {
        let [held, other] = bones.map(|bone| scene.bones[bone].name.as_str());
        let what = "share of an attachment that the motion would carry into another bone";
        let freed = Verdict::at_most(what, share, FREED).else_do(TURN_RIGHT);
        all.push(freed.at(format!("{name}, on {held}, into {other}")));
    }
    all.extend(across_check(simulation, m, name));
    all
}

/// The check of a muscle that a bone holds across a joint.
pub(super) fn across_check(simulation: &Simulation, body: usize, name: &str) -> Option<Verdict> {
    let (share, bones) = simulation.held_across(body)?;
    let scene = &simulation.scene;
    let [holds, nearer] = bones.map(|bone| scene.bones[bone].name.as_str());
    let what =
        "distance of an end from the bone that holds it across a joint, relative to the length";
    let across = Verdict::at_most(what, share, ACROSS).else_do(ADD_THE_TENDON);
    Some(across.at(format!("{name}, on {holds}, nearer to {nearer}")))
}

/// The checks of a muscle of this scene.
fn verdicts_of(
    simulation: &Simulation,
    m: usize,
    s: &MuscleSummary,
    worst: &Worst,
) -> Vec<Verdict> {
    let (scene, plan) = (&simulation.scene, &simulation.plan.muscles[m]);
    let mut all = Vec::new();
    let place = s.stopped.as_ref().map_or(s.name.clone(), |at| {
        format!(
            "{}, stopped at frame {}: {} at vertex {}",
            s.name, at.frame, at.effect, at.particle
        )
    });
    let cure = if scene.solver.has_inertia() {
        MORE_SUBSTEPS
    } else {
        HOLD_IT
    };
    let is_finite = s.stopped.is_none() && s.edge_stretch_max.is_finite();
    all.push(
        Verdict::new("all numbers are finite", is_finite)
            .at(place)
            .else_do(cure),
    );
    let say = |all: &mut Vec<Verdict>, verdict: Verdict| all.push(verdict.at(s.name.as_str()));
    let unconverged = Verdict::none("frames that did not converge", s.frames_not_converged);
    say(&mut all, unconverged.else_do(cure));
    if plan.runs("volume")
        && scene.muscles[m].material.bulk.is_none()
        && scene.solver.share("volume").is_none()
    {
        let volume = Verdict::at_most("relative volume error", s.volume_error_max, VOLUME_HELD);
        say(&mut all, volume.else_do(MORE_SUBSTEPS));
    }
    if plan.runs("stretch") {
        let name = "greatest strain of an edge";
        let strain = Verdict::at_most(name, s.edge_stretch_max, TORN);
        all.push(worst.of_strain(strain.else_do(HOLD_FEWER), &s.name));
    }
    if !plan.obstacles.is_empty() {
        let deep = Verdict::none(
            "vertices deeper than 0.01 mm in a bone",
            s.vertices_inside_bones_max,
        );
        say(&mut all, deep.else_do(MORE_SUBSTEPS));
        let inside = Verdict::none(
            "bone vertices inside the muscle",
            s.bone_vertices_inside_max,
        );
        say(
            &mut all,
            inside.else_do("use more substeps, or a shorter `edge_length`"),
        );
    }
    if simulation.frame() >= scene.frames && returns(simulation) {
        let share = s.distance_from_start_rms_m / s.length_m;
        let name = "distance from the start at the end, relative to the length";
        say(&mut all, Verdict::at_most(name, share, RETURN_DISTANCE));
        let name = "edge stretch at the end, RMS";
        say(
            &mut all,
            Verdict::at_most(name, s.edge_stretch_rms_end, RETURN_STRETCH),
        );
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pair_out_of_order_fails_the_certificate() {
        let kept = Certificate::default();
        assert!(certified(&kept).passed);
        assert!(
            !certified(&Certificate { open: 1, ..kept }).passed,
            "control"
        );
    }
}
