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
use crate::stress::{Case, Drawing, Ended, Trial};
use crate::study::key::{Contents, key_of};
use pliant::scene::builtin;

/// Strain a scene with parameters drawn at random: each case must end converged, not converged, or
/// refused
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pliant stress press
  pliant stress hip --cases 300 --seed 7
  pliant stress my-scene.toml --set 'muscle.0.edge_length=12 mm' --json > stress.json

Each case multiplies one to four numbers of the scene by factors on a logarithmic scale: numbers of
materials, effects and solvers, sizes of meshes, the width and the speed of motions. Every second case
stays within a decade around the scene, the others within three. Some cases have another solver or lack
an effect. A scene of muscles runs its whole motion in --frames frames, with as many steps as it needs.

A finding is a case that ends in another way: a panic, a number that is not finite, crossings although no
pair is open, a volume lost in a converged frame, a refusal without a key, or no end within --limit
seconds. Its changes are reduced to those that it needs. cases/*.json keep each case. The same command
runs the cases that are missing. The preparation of a case has no limit, and Ctrl-C waits for its end.

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
    /// The longest time of a case [s]
    #[arg(long, value_name = "SECONDS", default_value_t = 60, value_parser = clap::value_parser!(u32).range(1..=86_400))]
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
    let table: toml::Table = text.parse().map_err(|error| {
        Failure::usage(
            format!("{name}: {error}"),
            "check the file with `pliant plan`",
        )
    })?;
    let drawing = Drawing::new(&table, arguments.seed, arguments.frames as usize);
    let path = arguments.output.folder(scene.name(), "stress");
    let keep = |file: &str| !arguments.fresh && file.starts_with(CASES);
    let folder = Folder::open_keeping(&path, &keep)?;
    let trial = Trial {
        load: &with,
        longest: Duration::from_secs(arguments.limit.into()),
        stop: &stop,
    };
    let campaign = Campaign {
        arguments,
        text: &text,
        drawing,
        trial,
        folder: &folder,
        contents: Mutex::default(),
    };
    let mut rows = campaign.run(&stop)?;
    rows.sort_by_key(|row| row.case.number);
    let mut output = campaign.output(scene.name(), &rows);
    output.interrupted = rows.len() < arguments.cases as usize;
    output.time_s = begun.elapsed().as_secs_f64();
    arguments.output.finish(&folder, output)
}

struct Campaign<'a, 'b> {
    arguments: &'a Arguments,
    text: &'a str,
    drawing: Drawing,
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
        let case = self.drawing.case(number);
        let file = format!("{CASES}/{}-{number}.json", self.arguments.seed);
        let key = json!([self.key(&case), self.arguments.limit]);
        if let Some((ended, needed)) = read(&self.folder.path().join(&file), &key) {
            return Ok(Some(Row {
                case,
                ended,
                needed,
            }));
        }
        let ended = self.trial.run(&case.changes);
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

    /// All inputs of the end of a case but its limit: those of a run of a study, or the text of a scene
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
            let mut fewer = needed.clone();
            fewer.remove(k);
            if self.trial.run(&fewer).defect() == ended.defect() {
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
            "limit_s": self.arguments.limit,
            "findings": findings,
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
            verdicts: vec![Verdict::none("cases that end in no permitted way", found.len())
                .else_do("report the command of the finding, with the scene")],
            findings: found.iter().map(|row| format!("{}: {}", row.ended.why(), command(row))).collect(),
            title: format!("{scene}: a campaign of {} cases", rows.len()),
            subtitle: counts.clone(),
            text: format!("{scene}: {counts}\n"),
            tables: vec![table],
            explanations: vec![
                "Usual cases stay within a decade around the numbers of the scene, the others within three.".to_owned(),
            ],
            written: rows.iter().map(|row| format!("{CASES}/{}-{}.json", self.arguments.seed, row.case.number)).collect(),
            ..RunOutput::default()
        }
    }
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
