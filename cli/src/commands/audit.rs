//! `pliant audit`: crossings, vertices inside and volumes of written frames, without a simulation.

mod series;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Instant;

use super::failure::Failure;
use super::length_unit;
use super::options::{Printing, Threads};
use super::progress::Bar;
use super::run::stop_on_interrupt;
use crate::report::audit;
use crate::report::output::{RunOutput, measures};
use pliant::io::{self, ReadError, ReadProblem};
use pliant::mesh::TriangleMesh;
use pliant::simulation::{Audit, AuditSummary, AuditedSurface, LoadError, VOLUME_HELD};
use rayon::prelude::*;
use series::{Part, Series, keeps_volumes};

/// Count crossings, vertices inside and changes of volume in written frames, of this or another
/// program
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pliant audit pliant-out/right-hip
  pliant audit pliant-out/hip/hip.pvd --every 10 --json > audit.json
  pliant audit frames --rigid femur --rigid pelvis --unit mm

FRAMES is a folder of `pliant run`, a ParaView collection (.pvd), or a folder of surfaces: NAME_0001.vtp, NAME.0001.obj,
NAME-1.ply. A file without a number, or the only one of its name, is a surface at rest in all frames. The format of each
file is found from its content.

A crossing is a pair of triangles that share a point, by exact predicates. Triangles that share a corner or an edge cross
only if they also share another point. Of two rigid surfaces, only the growth of their depth in each other since the first
frame is judged. Vertices inside are found by exact winding numbers, which need closed surfaces. Files do not say which
vertices bones hold, so that vertices inside bones are held ones as well. Changes of volume are not judged in a folder of
`pliant run` whose scene lets volumes change. Surfaces are soft, except those of --rigid and those with a name that begins
with bone_ or obstacle_, as `pliant run` names them.

Exit codes: 0 nothing crosses, nothing is inside, volumes are held; 1 otherwise, or a coordinate is not finite; 2 a file
cannot be read, or the usage is wrong; 130 or 143 interrupted.")]
pub(super) struct Arguments {
    /// A folder of frames, or a .pvd file
    #[arg(value_name = "FRAMES")]
    frames: PathBuf,
    /// A surface that is rigid, such as a bone; may be given several times
    #[arg(long, value_name = "NAME")]
    rigid: Vec<String>,
    /// Audit every Kth frame and the last
    #[arg(long, value_name = "K", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    every: u32,
    /// Length unit of the files, such as mm
    #[arg(long, value_name = "UNIT", default_value = "m")]
    unit: String,
    /// Greatest relative change of an enclosed volume since the first frame
    #[arg(long, value_name = "SHARE", default_value_t = VOLUME_HELD)]
    volume_limit: f64,
    #[command(flatten)]
    threads: Threads,
    #[command(flatten)]
    printing: Printing,
}

/// Advice after a failed check.
const ADVICE: &str = "`audit.pairs` of --json names all pairs, with frame, triangles and point";

pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let begun = Instant::now();
    let unit = length_unit(&arguments.unit)?;
    let limit = arguments.volume_limit;
    if !(limit.is_finite() && limit >= 0.0) {
        return Err(Failure::usage(
            format!("--volume-limit {limit} is no share"),
            "give a number of at least zero, such as 1e-6 or 0.05",
        ));
    }
    arguments.threads.start();
    let stop = stop_on_interrupt("stopping after this frame");
    let series = Series::of(&arguments.frames, &arguments.rigid)?;
    let chosen = series.every(arguments.every as usize);
    let bar = Bar::of_parts(chosen.len());
    let mut frames = Frames {
        audit: Audit::in_unit(unit),
        summary: AuditSummary::new(),
        last: Vec::new(),
        lines: Vec::new(),
    };
    for (done, &frame) in chosen.iter().enumerate() {
        if stop.load(Ordering::Relaxed) {
            break;
        }
        frames.add(frame, &series.frames[frame])?;
        bar.reach(done + 1, chosen.len());
    }
    bar.end();
    let mut output = frames.output(arguments, &series, &chosen)?;
    output.interrupted = stop.load(Ordering::Relaxed);
    output.time_s = begun.elapsed().as_secs_f64();
    Ok(arguments.printing.finish(output))
}

/// A file of a frame: the same one in several frames is read once.
#[derive(Clone)]
struct Loaded {
    path: PathBuf,
    mesh: Arc<Result<TriangleMesh, usize>>,
}

/// The audited frames so far.
struct Frames {
    audit: Audit,
    summary: AuditSummary,
    last: Vec<Loaded>,
    /// Parts without triangles, such as fibres.
    lines: Vec<String>,
}

impl Frames {
    fn add(&mut self, frame: usize, parts: &[Part]) -> Result<(), Failure> {
        let known = |path: &PathBuf| {
            self.last
                .iter()
                .find(|loaded| loaded.path == *path)
                .cloned()
        };
        let load = |part: &Part| known(&part.file).map_or_else(|| load(&part.file), Ok);
        let loaded: Vec<Loaded> = parts.par_iter().map(load).collect::<Result<_, Failure>>()?;
        let mut surfaces = Vec::new();
        let mut not_finite = Vec::new();
        for (part, loaded) in parts.iter().zip(&loaded) {
            match &*loaded.mesh {
                Err(vertex) => not_finite.push((part.name.clone(), *vertex)),
                Ok(mesh) if mesh.triangles.is_empty() => {
                    if !self.lines.contains(&part.name) {
                        self.lines.push(part.name.clone());
                    }
                }
                Ok(mesh) => surfaces.push(AuditedSurface {
                    name: &part.name,
                    rigid: part.rigid,
                    vertices: &mesh.vertices,
                    triangles: &mesh.triangles,
                    held: &[],
                }),
            }
        }
        let mut found = self.audit.frame(&surfaces);
        // Files do not say who holds a vertex.
        found.crossings_held = None;
        found.not_finite.extend(not_finite);
        self.summary.add(frame, &found);
        self.last = loaded;
        Ok(())
    }

    fn output(
        self,
        arguments: &Arguments,
        series: &Series,
        chosen: &[usize],
    ) -> Result<RunOutput<'static>, Failure> {
        let Self { summary, lines, .. } = self;
        let name = arguments.frames.display().to_string();
        let is_soft = |part: &&Part| !part.rigid && !lines.contains(&part.name);
        let parts = series.frames.iter().flatten();
        let of = |rigid: bool| {
            let first = series.frames.first().into_iter().flatten();
            let named = first.filter(|p| p.rigid == rigid && !lines.contains(&p.name));
            named
                .map(|p| p.name.as_str())
                .collect::<Vec<_>>()
                .join(", ")
        };
        if !parts.clone().any(|part| is_soft(&part)) {
            return Err(Failure::usage(
                format!("{name}: no soft surface among {} files", parts.count()),
                "an audit needs a surface that deforms; leave a --rigid out",
            ));
        }
        let mut notes = vec![
            format!("soft: {}", of(false)),
            format!("rigid: {}", of(true)),
        ];
        notes.retain(|note| !note.ends_with(": "));
        if chosen.len() < series.frames.len() {
            let (every, all) = (arguments.every, series.frames.len());
            notes.push(format!(
                "audited: one of every {every} of {all} frames, and the last"
            ));
        }
        if !summary.open.is_empty() {
            let open = summary.open.join(", ");
            notes.push(format!(
                "not closed, so nothing is inside, and no volume: {open}"
            ));
        }
        if !lines.is_empty() {
            notes.push(format!(
                "without triangles, not audited: {}",
                lines.join(", ")
            ));
        }
        if summary.flat_triangles_max > 0 {
            let flat = summary.flat_triangles_max;
            notes.push(format!(
                "{flat} triangles without area are in no test of crossings"
            ));
        }
        let limit = if keeps_volumes(&arguments.frames) {
            Some(arguments.volume_limit)
        } else {
            notes.push(
                "changes of volumes are not judged: the scene of this run lets them change".into(),
            );
            None
        };
        let verdicts = audit::verdicts(&summary, limit, ADVICE);
        let table = audit::table(&summary);
        let checks = crate::report::output::verdict_table(&verdicts).to_text();
        Ok(RunOutput {
            kind: "audit",
            text: format!("{name}: {} frames audited\n\n{checks}", summary.frames),
            name,
            measures: measures(&summary),
            verdicts,
            notes,
            tables_of_text: usize::from(!table.rows.is_empty()),
            tables: vec![table],
            ..RunOutput::default()
        })
    }
}

/// Reads a surface; a coordinate that is not finite is a result, any other error a failure.
fn load(path: &Path) -> Result<Loaded, Failure> {
    let mesh = match io::read(path) {
        Ok(file) => Ok(file.mesh),
        Err(ReadError::Content {
            problem: ReadProblem::NotFinite { vertex } | ReadProblem::Overflow { vertex },
            ..
        }) => Err(vertex),
        Err(error) => return Err(LoadError::from(Box::new(error)).into()),
    };
    Ok(Loaded {
        path: path.to_path_buf(),
        mesh: Arc::new(mesh),
    })
}
