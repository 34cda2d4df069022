//! The audit of frames: its measures, its checks and its table.

use nalgebra::Point3;
use serde_json::Value;

use super::Table;
use super::output::{Spot, Verdict, measures};
use pliant::format::number;
use pliant::simulation::{
    Audit, AuditSummary, AuditedSurface, Body, BodyDescription, CrossingCounts, FrameState,
    PairSummary, Scenario, Simulation,
};

/// A run audits every frame with a multiple of this number, because the audit of three muscles and
/// their bones takes as long as half a frame.
const EVERY: usize = 10;

/// Greatest number of pairs of surfaces in a table.
const MOST_ROWS: usize = 30;

/// Greatest growth of the depth of two rigid surfaces in each other, relative to the longest side of
/// the smaller one: 2 mm of a femur. About the axis of a measured joint the bones get at most
/// 0.8 mm deep (an elbow); about the reversed axis 2 to 14 mm after 30 to 60 degrees.
const RIGID_DEPTH: f64 = 5e-3;

/// The audit of a run of muscles.
#[derive(Debug)]
pub struct RunAudit {
    audit: Audit,
    /// Findings so far.
    pub summary: AuditSummary,
    /// The last audited frame.
    last: Option<usize>,
}

impl RunAudit {
    /// The audit of a run before its start.
    pub fn new() -> Self {
        Self {
            audit: Audit::new(),
            summary: AuditSummary::new(),
            last: None,
        }
    }

    /// The audit of a run that goes on: `first` is the start of `simulation`, `summary` are the
    /// findings so far.
    pub fn resume(simulation: &Simulation, first: &FrameState, summary: AuditSummary) -> Self {
        let mut audit = Self::new();
        audit.examine(simulation, first);
        // The start was audited, but the last audited frame is a later one.
        let last = simulation.frame() / EVERY * EVERY;
        Self {
            summary,
            last: Some(last),
            ..audit
        }
    }

    /// Audits the present frame if its turn has come: every [`EVERY`]th frame.
    pub fn frame(&mut self, simulation: &Simulation) {
        if simulation.frame().is_multiple_of(EVERY) {
            self.examine(simulation, &simulation.state());
        }
    }

    /// Audits the last frame of a run if it has not been.
    pub fn finish(&mut self, simulation: &Simulation) {
        if self.last != Some(simulation.frame()) {
            self.examine(simulation, &simulation.state());
        }
    }

    /// Number of audited frames up to a frame that is not the end.
    pub fn frames_at(frame: usize) -> usize {
        frame / EVERY + 1
    }

    /// Which frames were audited, for the notes of a run.
    pub fn note(&self) -> String {
        let frames = self.summary.frames;
        format!(
            "audited: every {EVERY}th frame and the last, {frames} in all; `pliant audit` audits all"
        )
    }

    /// Audits one frame of a simulation.
    fn examine(&mut self, simulation: &Simulation, state: &FrameState) {
        let names = simulation.description();
        let has_surface = |body: &&BodyDescription| !body.rest.triangles.is_empty();
        let muscles = names.bodies.iter().filter(has_surface).count();
        let mut posed: Vec<Vec<Point3<f64>>> = Vec::new();
        for ((_, mesh), pose) in names.bones.iter().zip(&state.bones) {
            posed.push(mesh.vertices.iter().map(|p| pose * p).collect());
        }
        let held: Vec<_> = simulation.bodies.iter().map(|b| held(b, muscles)).collect();
        let mut surfaces = Vec::new();
        for ((described, (x, _)), held) in names.bodies.iter().zip(&state.bodies).zip(&held) {
            // A body without triangles has no surface.
            if !described.rest.triangles.is_empty() {
                surfaces.push(AuditedSurface {
                    name: &described.file,
                    rigid: false,
                    vertices: x,
                    triangles: &described.rest.triangles,
                    held,
                });
            }
        }
        for ((name, mesh), vertices) in names.bones.iter().zip(&posed) {
            surfaces.push(AuditedSurface {
                name,
                rigid: true,
                vertices,
                triangles: &mesh.triangles,
                held: &[],
            });
        }
        let found = self.audit.frame(&surfaces);
        self.summary.add(state.frame, &found);
        self.last = Some(state.frame);
    }

    /// The findings as in summaries.
    pub fn measures(&self) -> Value {
        measures(&self.summary)
    }
}

impl Default for RunAudit {
    fn default() -> Self {
        Self::new()
    }
}

/// The place in the list of surfaces of the bone that holds each vertex of a muscle; the bones come
/// after this number of `muscles`.
fn held(body: &Body, muscles: usize) -> Vec<Option<usize>> {
    let mut held = vec![None; body.rest.vertices.len()];
    for &(vertex, bone) in &body.attached {
        held[vertex as usize] = Some(muscles + bone);
    }
    held
}

/// A verdict with the place of the worst pair of a kind, if it failed and there is one.
fn located(
    verdict: Verdict,
    summary: &AuditSummary,
    is_of: impl Fn(&PairSummary) -> bool,
    advice: &str,
) -> Verdict {
    let Some(pair) = summary.worst(is_of).filter(|_| !verdict.passed) else {
        return verdict.at("all surfaces");
    };
    let spot = |point_m| Spot {
        frame: pair.frame,
        point_m,
    };
    let verdict = verdict.at(pair.place()).else_do(advice);
    verdict.seen(pair.worst.point_m.map(spot))
}

fn of_one(pair: &PairSummary) -> bool {
    let [one, other] = &pair.worst.surfaces;
    one == other
}

/// The checks of crossings and of finite numbers, of a run or of files.
pub fn crossing_verdicts(summary: &AuditSummary, advice: &str) -> Vec<Verdict> {
    let CrossingCounts {
        soft_soft,
        soft_rigid,
        self_,
        ..
    } = summary.crossings_max;
    let at = |verdict: Verdict, is_of: &dyn Fn(&PairSummary) -> bool| {
        located(verdict, summary, is_of, advice)
    };
    let crosses = |p: &PairSummary| p.worst.crossings > 0;
    let mut all = Vec::new();
    if let Some((surface, vertex, frame)) = &summary.not_finite {
        let place = format!("{surface}, frame {frame}, vertex {vertex}");
        all.push(Verdict::new("all coordinates are finite", false).at(place));
    }
    if !summary.complete {
        let tested = Verdict::new("all pairs of triangles were tested for crossings", false);
        all.push(tested.at("too many triangles lie in one place"));
    }
    let soft = Verdict::none("crossings of two soft surfaces, most in a frame", soft_soft);
    all.push(at(soft, &|p| {
        crosses(p) && !of_one(p) && !p.worst.with_rigid
    }));
    let rigid = Verdict::none(
        "crossings of a soft and a rigid surface, most in a frame",
        soft_rigid,
    );
    all.push(at(rigid, &|p| crosses(p) && p.worst.with_rigid));
    let own = Verdict::none("crossings of a surface with itself, most in a frame", self_);
    all.push(at(own, &|p| crosses(p) && of_one(p)));
    let inside = summary.vertices_inside_muscles_max;
    let inside = Verdict::none(
        "vertices of a soft surface inside another, most in a frame",
        inside,
    );
    all.push(at(inside, &|p| {
        p.worst.vertices_inside != [0, 0] && !p.worst.with_rigid
    }));
    let deep = Verdict::at_most(
        "growth of the depth of two rigid surfaces in each other, relative",
        summary.rigid_depth_max,
        RIGID_DEPTH,
    );
    all.push(match &summary.rigid_depth_at {
        Some(([one, other], frame)) if !deep.passed => deep
            .at(format!("{one} and {other}, frame {frame}"))
            .else_do("look at the motion: its axis, the sense of its angles, its centre"),
        _ => deep.at("all rigid surfaces"),
    });
    all
}

/// All checks of the audit of files; volumes may change by `volume_limit`, relative, and are not
/// judged without it.
pub fn verdicts(summary: &AuditSummary, volume_limit: Option<f64>, advice: &str) -> Vec<Verdict> {
    let mut all = crossing_verdicts(summary, advice);
    let is_of = |p: &PairSummary| p.worst.with_rigid && p.worst.vertices_inside != [0, 0];
    let at = |verdict: Verdict| located(verdict, summary, is_of, advice);
    all.push(at(Verdict::none(
        "vertices deeper than 0.01 mm in a rigid surface, most in a frame",
        summary.vertices_inside_bones_max,
    )));
    all.push(at(Verdict::none(
        "vertices of a rigid surface inside a soft one, most in a frame",
        summary.bone_vertices_inside_max,
    )));
    let shared = Verdict::at_most(
        "shared volume of two soft surfaces",
        summary.shared_volume_max_m3,
        0.0,
    );
    all.push(shared.in_unit("m3").at("all surfaces"));
    let Some(volume_limit) = volume_limit else {
        return all;
    };
    let volume = Verdict::at_most(
        "change of an enclosed volume since the first frame, relative",
        summary.volume_error_max,
        volume_limit,
    );
    let place = match &summary.volume_error_at {
        Some((surface, frame)) => format!("{surface}, frame {frame}"),
        None => "all surfaces".to_owned(),
    };
    all.push(volume.at(place));
    all
}

/// The pairs of surfaces with findings; empty if there are none.
pub fn table(summary: &AuditSummary) -> Table {
    let heads = [
        "surfaces",
        "frames",
        "crossings",
        "inside",
        "depth [mm]",
        "shared [cm3]",
        "worst at",
    ];
    let mut table = Table::new("Crossings and vertices inside, greatest in a frame", heads);
    for pair in summary.pairs.iter().take(MOST_ROWS) {
        let [one, other] = &pair.worst.surfaces;
        let [inside, swallowed] = pair.worst.vertices_inside;
        table.row([
            if of_one(pair) {
                format!("{one} with itself")
            } else {
                format!("{one}, {other}")
            },
            pair.frames.to_string(),
            pair.worst.crossings.to_string(),
            format!("{inside} + {swallowed}"),
            number(pair.worst.depth_m * 1e3),
            number(pair.shared_volume_max_m3 * 1e6),
            pair.place()
                .split_once(", frame")
                .map_or(String::new(), |(_, at)| format!("frame{at}")),
        ]);
    }
    table
}
