//! `pliant stress`: strains a scene with parameters drawn at random.

use std::io::Write;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::environment;
use super::failure::Failure;
use super::options::Output;
use super::progress::Bar;
use super::run::stop_on_interrupt;
use super::warn;
use crate::report::Table;
use crate::report::folder::Folder;
use crate::report::output::{RunOutput, Verdict};
use crate::stress::{Case, Drawing, Ended, Examined, Trial, Worse, worsened};
use crate::study::key::{Contents, key_of};
use pliant::io::Encoding;
use pliant::mesh::TriangleMesh;
use pliant::scene::{Content, Scene, Source, builtin};
use pliant::simulation::{Assets, Simulation};

/// Strain a scene with parameters drawn at random: each case must end converged, not converged, or
/// refused
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pliant stress press
  pliant stress hip --set 'muscle.0.edge_length=16 mm' --cases 300 --seed 7
  pliant stress my-scene.toml --set 'muscle.0.edge_length=12 mm' --json > stress.json

Each case multiplies one to four numbers of the scene by factors on a logarithmic scale: numbers of
materials, effects and solvers, sizes of meshes, the width and the speed of motions. Every second case
stays within a decade around the scene and moves at most as far, the others within three. Some cases have
another solver, lack an effect, stand still, or have a mesh with needles, with flat triangles, or in other
units. A scene of muscles runs its whole motion in --frames frames, with as many steps as it needs. The
scene without changes runs first. A case whose --work is spent ends there, and counts as not converged.

A finding is a case that ends in another way: a panic, a number that is not finite, crossings although no
pair is open, a volume lost in a converged frame, other bits by other threads (of every eighth case),
energy that grows although nothing moves, a refusal without a key, or no end within --limit seconds. Its
changes are reduced to those that it needs. cases/*.json keep each case, meshes/*.obj the other meshes.
The same command runs the cases that are missing. The preparation of a case has no limit, and Ctrl-C waits
for its end.

Exit codes: 0 no finding; 1 a finding;
2 bad usage or input; 130 or 143 interrupted.")]
pub(super) struct Arguments {
    /// A scene file, or the name of a built-in scene
    scene: String,
    /// Number of cases
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    cases: u32,
    /// Seed of the random numbers
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,
    /// Greatest number of frames of a case of muscles
    #[arg(long, value_name = "N", default_value_t = 30, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    frames: u32,
    /// The greatest work of a case of muscles, in millions of steps of vertices [default: twice that of the
    /// scene without changes, at least 20]
    #[arg(long, value_name = "MILLIONS", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    work: Option<u32>,
    /// The longest time of a case [s]; without --work at least six times that of the scene without changes
    #[arg(long, value_name = "SECONDS", default_value_t = 120, value_parser = clap::value_parser!(u32).range(1..=86_400))]
    limit: u32,
    #[arg(long, value_name = "KEY=VALUE", help = "Change the scene of all cases; may be given several times", long_help = super::options::set_help())]
    set: Vec<String>,
    /// Run all cases again, including those of an earlier call
    #[arg(long)]
    fresh: bool,
    #[command(flatten)]
    output: Output,
}

/// A case with its end.
struct Row {
    case: Case,
    ended: Ended,
    /// The changes that a finding needs.
    needed: Vec<String>,
}

/// The folder of the cases, below that of the results.
const CASES: &str = "cases";

/// The folder of meshes that cases have in place of those of the scene.
const MESHES: &str = "meshes";

/// Least share of usual cases that converge.
const CONVERGE: f64 = 0.9;

/// Of this number of cases in a row other threads compute one as well.
const TWINS: usize = 8;

const MILLION: u64 = 1_000_000;

/// The least budget of work of a case, and its multiple of the work of the scene without changes, whose
/// end says whether it is known. A case with other numbers takes more steps than the scene.
const LEAST_WORK: u64 = 20 * MILLION;
const TIMES_ITS_WORK: u64 = 2;

/// The scene without changes may take this multiple of the time of a case, and a case this multiple of its.
const ALONE: u32 = 6;

/// Whether the work of a scene with this end is that of its whole run.
fn is_known(unchanged: &Ended) -> bool {
    *unchanged != Ended::Interrupted && !matches!(unchanged.defect(), Some("no end" | "panic"))
}

/// The budget of work of a case, from the end and the work of the scene without changes.
fn budget(unchanged: &Ended, work: u64) -> u64 {
    if !is_known(unchanged) {
        return LEAST_WORK;
    }
    (TIMES_ITS_WORK * work)
        .next_multiple_of(MILLION)
        .max(LEAST_WORK)
}

pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let begun = Instant::now();
    let stop = stop_on_interrupt("stopping after these cases");
    let name = &arguments.scene;
    let with = |changes: &[String]| {
        let all = [&arguments.set, changes].concat();
        environment::load_case(name, &all)
    };
    let scene = environment::load_content(name, &arguments.set)?;
    let text = builtin::find(name)?.text;
    let table = builtin::table(name, &arguments.set)?;
    let meshes = match &scene {
        Content::Muscles(scene) => meshes_of(scene),
        _ => Vec::new(),
    };
    let others = meshes.iter().map(|(muscle, _)| *muscle).collect();
    let drawing = Drawing::new(&table, arguments.seed, arguments.frames as usize, others);
    let path = arguments.output.folder(scene.name(), "stress");
    let keep = |file: &str| {
        !arguments.fresh
            && [CASES, MESHES]
                .iter()
                .any(|folder| file.starts_with(folder))
    };
    let folder = Folder::open_keeping(&path, &keep)?;
    let mut trial = Trial {
        load: &with,
        make: Simulation::new,
        most_work: arguments
            .work
            .map_or(u64::MAX, |work| u64::from(work) * MILLION),
        longest: Duration::from_secs(arguments.limit.into()),
        stop: &stop,
    };
    let longest = trial.longest;
    trial.longest = ALONE * longest;
    let started = Instant::now();
    let bar = Bar::of_parts(1);
    bar.part("the scene without changes");
    let (unchanged, work) = trial.measured(drawing.common(), Examined::default());
    bar.end();
    trial.longest = longest;
    if arguments.work.is_none() {
        trial.most_work = budget(&unchanged, work);
        if is_known(&unchanged) {
            // The budget ends a case, and not the time, also where several run at once.
            let took = Duration::from_secs(started.elapsed().as_secs() + 1);
            trial.longest = longest.max(ALONE * took);
        }
    }
    let campaign = Campaign {
        arguments,
        text: &text,
        drawing,
        meshes,
        of_muscles: matches!(scene, Content::Muscles(_)),
        unchanged,
        trial,
        folder: &folder,
        contents: Mutex::default(),
    };
    let mut rows = campaign.run(&stop)?;
    rows.sort_by_key(|row| row.case.number);
    let mut output = campaign.output(scene.name(), &rows);
    output.notes.extend(campaign.note());
    output.interrupted = rows.len() < arguments.cases as usize;
    output.time_s = begun.elapsed().as_secs_f64();
    arguments.output.finish(&folder, output)
}

struct Campaign<'a, 'b> {
    arguments: &'a Arguments,
    text: &'a str,
    drawing: Drawing,
    /// Meshes as read [m], of muscles by their numbers.
    meshes: Vec<(usize, TriangleMesh)>,
    /// Whether the scene is one of muscles, whose work is measured.
    of_muscles: bool,
    /// How the scene ends without changes.
    unchanged: Ended,
    trial: Trial<'b>,
    folder: &'a Folder,
    contents: Mutex<Contents>,
}

impl Campaign<'_, '_> {
    /// Runs all cases, several at once; those that ended in an earlier call are read.
    fn run(&self, stop: &AtomicBool) -> Result<Vec<Row>, Failure> {
        let cases = self.arguments.cases as usize;
        let bar = Bar::of_parts(cases);
        let (next, rows, failed) = (
            AtomicUsize::new(0),
            Mutex::new(Vec::new()),
            Mutex::new(None),
        );
        let workers = self.arguments.output.threads.count().clamp(1, cases);
        let work = || {
            loop {
                let number = next.fetch_add(1, Ordering::Relaxed);
                if number >= cases || stop.load(Ordering::Relaxed) {
                    return;
                }
                let row = match self.row(number) {
                    Ok(Some(row)) => row,
                    Ok(None) => return,
                    Err(error) => {
                        stop.store(true, Ordering::Relaxed);
                        *lock(&failed) = Some(error);
                        return;
                    }
                };
                if matches!(row.ended, Ended::Found(_)) {
                    warn(&format!("finding in case {number}: {}", row.ended.why()));
                }
                let mut rows = lock(&rows);
                rows.push(row);
                bar.reach(rows.len(), cases);
            }
        };
        std::thread::scope(|scope| {
            for _ in 0..workers {
                scope.spawn(work);
            }
        });
        bar.end();
        let failed = failed.into_inner().unwrap_or(None);
        let rows = rows.into_inner().unwrap_or_default();
        failed.map_or(Ok(rows), Err)
    }

    /// A case that ended in an earlier call, or ends now; `None` if it was stopped.
    fn row(&self, number: usize) -> Result<Option<Row>, Failure> {
        let mut case = self.drawing.case(number);
        if let Some((muscle, worse)) = case.mesh {
            let changes = self.other_mesh(number, muscle, worse)?;
            case.changes.extend(changes);
        }
        let examined = self.examined(&case);
        let file = format!("{CASES}/{}-{number}.json", self.arguments.seed);
        let key = json!([self.key(&case), self.arguments.limit, self.trial.most_work]);
        if let Some((ended, needed)) = read(&self.folder.path().join(&file), &key) {
            return Ok(Some(Row {
                case,
                ended,
                needed,
            }));
        }
        let ended = self.trial.run(&case.changes, examined);
        let needed = match &ended {
            Ended::Interrupted => return Ok(None),
            Ended::Found(_) => self.reduced(&case, &ended),
            _ => Vec::new(),
        };
        // A reduction that was stopped is not the end of the case.
        if self.trial.stop.load(Ordering::Relaxed) {
            return Ok(None);
        }
        let kept = json!({"key": key, "ended": ended.name(), "why": ended.why(), "needed": needed});
        let text = format!("{kept:#}\n");
        self.folder.write(&file, |w| w.write_all(text.as_bytes()))?;
        Ok(Some(Row {
            case,
            ended,
            needed,
        }))
    }

    /// What is to be known of the scene without changes: usual cases converge no better than it does.
    fn note(&self) -> Option<String> {
        let Self { unchanged, .. } = self;
        (!unchanged.why().is_empty()).then(|| {
            format!(
                "without changes the scene itself ends as {}: {}",
                unchanged.name(),
                unchanged.why()
            )
        })
    }

    fn said_budget(&self) -> String {
        let millions = self.trial.most_work / MILLION;
        if self.of_muscles && self.unchanged != Ended::Interrupted {
            format!("The work of a case is at most {millions} million steps of vertices.\n")
        } else {
            String::new()
        }
    }

    fn examined(&self, case: &Case) -> Examined {
        Examined {
            still: case.still,
            threads: case.number % TWINS == TWINS / 2,
        }
    }

    /// The files of a case in the folder: its end, and its mesh if it has another one.
    fn files_of(&self, case: &Case) -> Vec<String> {
        let (seed, number) = (self.arguments.seed, case.number);
        let mesh = case.mesh.map(|_| format!("{MESHES}/{seed}-{number}.obj"));
        let end = format!("{CASES}/{seed}-{number}.json");
        std::iter::once(end).chain(mesh).collect()
    }

    /// Writes another mesh for a case, and returns the changes that name it.
    fn other_mesh(
        &self,
        number: usize,
        muscle: usize,
        worse: Worse,
    ) -> Result<Vec<String>, Failure> {
        let found = self.meshes.iter().find(|(m, _)| *m == muscle);
        let Some((_, mesh)) = found else {
            return Ok(Vec::new());
        };
        let file = self
            .folder
            .claim(&format!("{MESHES}/{}-{number}.obj", self.arguments.seed))?;
        let mesh = worsened(mesh, worse, number as u64);
        pliant::io::write(&file, &mesh, &[], Encoding::Text)
            .map_err(|error| Failure::usage(error.to_string(), "use another folder"))?;
        let path = std::path::absolute(&file).unwrap_or(file);
        let (key, unit) = (format!("muscle.{muscle}"), worse.unit().0);
        Ok(vec![
            format!("{key}.shape=off"),
            format!("{key}.mesh={}", path.display()),
            format!("{key}.unit={unit}"),
        ])
    }

    /// All inputs of the end of a case but its limits: those of a run of a study, or the text of a scene
    /// that is refused.
    fn key(&self, case: &Case) -> String {
        let Ok(content) = (self.trial.load)(&case.changes) else {
            let all = json!([pliant::DIGEST, self.text, self.arguments.set, case.changes]);
            return all.to_string();
        };
        let key = key_of(&content, &[], &mut lock(&self.contents));
        // A file that cannot be read is refused again.
        key.unwrap_or_else(|error| error.to_string())
    }

    /// The changes that a finding needs: one after the other is left out, if the case still ends in
    /// the same way.
    fn reduced(&self, case: &Case, ended: &Ended) -> Vec<String> {
        let mut needed = case.changes.clone();
        // A case that does not end would take its whole time for each change.
        if ended.defect() == Some("no end") {
            return needed;
        }
        let mut k = case.common;
        while k < needed.len() {
            // A case that moves is not examined for its rest.
            if case.still && needed[k].contains(".motion.keys.") {
                k += 1;
                continue;
            }
            let mut fewer = needed.clone();
            fewer.remove(k);
            if self.trial.run(&fewer, self.examined(case)).defect() == ended.defect() {
                needed = fewer;
            } else {
                k += 1;
            }
        }
        needed
    }

    fn output(&self, scene: &str, rows: &[Row]) -> RunOutput<'static> {
        let name = &self.arguments.scene;
        let of = |ended: &str| rows.iter().filter(|row| row.ended.name() == ended).count();
        let usual = rows.iter().filter(|row| !row.case.beyond);
        let usual_converged = usual
            .clone()
            .filter(|row| row.ended == Ended::Converged)
            .count();
        let found: Vec<&Row> = rows
            .iter()
            .filter(|row| matches!(row.ended, Ended::Found(_)))
            .collect();
        let command = |row: &Row| {
            let changes = [self.arguments.set.as_slice(), &row.needed].concat();
            let changes: Vec<String> = changes
                .iter()
                .map(|c| format!(" --set {}", shell(c)))
                .collect();
            format!("pliant run {name}{}", changes.concat())
        };
        let findings: Vec<Value> = found
            .iter()
            .map(|row| {
                json!({"what": row.ended.why(), "scene": name, "seed": self.arguments.seed,
                    "case": row.case.number, "changes": row.needed, "command": command(row)})
            })
            .collect();
        let mut table = Table::new(
            "Cases that did not converge",
            ["case", "ended", "why", "changes"],
        );
        for row in rows.iter().filter(|row| row.ended != Ended::Converged) {
            let drawn = row.case.changes.get(row.case.common..).unwrap_or_default();
            table.row([
                row.case.number.to_string(),
                row.ended.name().to_owned(),
                row.ended.why().to_owned(),
                drawn.join(", "),
            ]);
        }
        let measures = json!({
            "cases": rows.len(),
            "converged": of("converged"),
            "not_converged": of("not converged"),
            "refused": of("refused"),
            "usual": {"cases": usual.clone().count(), "converged": usual_converged},
            "seed": self.arguments.seed,
            "frames": self.arguments.frames,
            "limit_s": self.trial.longest.as_secs(),
            "work": self.trial.most_work,
            "findings": findings,
        });
        let runs = usual
            .clone()
            .filter(|row| !matches!(row.ended, Ended::Refused(_)));
        // Where none runs there is nothing to judge.
        let share = match runs.count() {
            0 => None,
            cases => Some(usual_converged as f64 / cases as f64),
        };
        let found_none = Verdict::none("cases that end in no permitted way", found.len())
            .else_do("report the command of the finding, with the scene");
        let enough = share.map(|share| {
            let name = "usual cases that converge, share of those not refused";
            Verdict::at_least(name, share, CONVERGE).else_do(
                "look in the table why they did not converge; if the scene itself does not, change it first",
            )
        });
        let counts = format!(
            "{} cases: {} converged, {} not converged, {} refused, {} findings; {usual_converged} of {} usual cases converged",
            rows.len(),
            of("converged"),
            of("not converged"),
            of("refused"),
            found.len(),
            usual.count()
        );
        RunOutput {
            kind: "stress",
            name: scene.to_owned(),
            measures,
            verdicts: std::iter::once(found_none).chain(enough).collect(),
            findings: found.iter().map(|row| format!("{}: {}", row.ended.why(), command(row))).collect(),
            title: format!("{scene}: a campaign of {} cases", rows.len()),
            subtitle: counts.clone(),
            text: format!("{scene}: {counts}\n{}", self.said_budget()),
            tables: vec![table],
            explanations: vec![
                "Usual cases have the solver of the scene and stay within a decade around its numbers. \
                 The others stay within three, or have another solver."
                    .to_owned(),
            ],
            written: rows.iter().flat_map(|row| self.files_of(&row.case)).collect(),
            ..RunOutput::default()
        }
    }
}

/// The meshes of the muscles of a scene that can have others [m]: those that bring no fibres of their own.
fn meshes_of(scene: &Scene) -> Vec<(usize, TriangleMesh)> {
    let mut whole = scene.clone();
    for muscle in &mut whole.muscles {
        (muscle.edge_length, muscle.repair) = (None, None);
    }
    // What cannot be read is refused in each case, with its reason.
    let Ok(assets) = Assets::load(&whole) else {
        return Vec::new();
    };
    let each = assets.muscles.into_iter().enumerate().zip(&scene.muscles);
    let plain = each.filter(|((_, read), muscle)| {
        let is_file = !matches!(muscle.surface, Source::Shape(_));
        !read.mesh.triangles.is_empty() && (is_file || read.fibres.is_empty())
    });
    plain.map(|((m, read), _)| (m, read.mesh)).collect()
}

/// The end of a case with this key in a file of an earlier call.
fn read(path: &std::path::Path, key: &Value) -> Option<(Ended, Vec<String>)> {
    let all: Value = serde_json::from_str(&std::fs::read_to_string(path).ok()?).ok()?;
    if all["key"] != *key {
        return None;
    }
    let why = all["why"].as_str()?.to_owned();
    let ended = match all["ended"].as_str()? {
        "converged" => Ended::Converged,
        "not converged" => Ended::NotConverged(why),
        "refused" => Ended::Refused(why),
        "finding" => Ended::Found(why),
        _ => return None,
    };
    let needed = all["needed"]
        .as_array()?
        .iter()
        .map(|c| c.as_str().map(str::to_owned));
    Some((ended, needed.collect::<Option<_>>()?))
}

/// A word for a shell.
fn shell(word: &str) -> String {
    format!("'{}'", word.replace('\'', "'\\''"))
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex
        .lock()
        .unwrap_or_else(std::sync::PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_case_has_twice_the_work_of_the_scene() {
        assert_eq!(budget(&Ended::Converged, 45 * MILLION + 1), 91 * MILLION);
        assert_eq!(budget(&Ended::Converged, 1), LEAST_WORK);
        let ended = Ended::NotConverged("the last frame".to_owned());
        assert_eq!(budget(&ended, 100 * MILLION), 200 * MILLION);
        // What has no end has no known work.
        let found = |what: &str| Ended::Found(what.to_owned());
        assert_eq!(budget(&found("no end: 120 s"), 500 * MILLION), LEAST_WORK);
        assert_eq!(budget(&found("leap: an edge"), 50 * MILLION), 100 * MILLION);
    }
}
