//! `pliant study`: all combinations of lists of values over a scene, in one table and on one sheet
//! of pictures.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Instant;

use serde_json::json;

use super::failure::Failure;
use super::options::Output;
use super::progress::{Bar, if_raised};
use super::run::stop_on_interrupt;
use super::{environment, note};
use crate::report::Table;
use crate::report::folder::Folder;
use crate::report::output::RunOutput;
use crate::study::combinations::in_words;
use crate::study::running::{Kept, missing};
use crate::study::{Combination, Combinations, Findings, Outcome, execute, findings};
use pliant::progress::Progress;
use pliant::scene::StudyFile;

/// Run all combinations of lists of values over a scene, and compare them in one table and on one
/// sheet of pictures
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pliant study examples/press-study.toml --dry-run
  pliant study examples/press-study.toml
  pliant study my-study.toml --set frames=50 --out short --json > short.json
  pliant study my-study.toml --shard 3/16 --out shared/study      then `pliant study my-study.toml --out shared/study`

A study file:
  scene = \"press\"                        # a built-in scene, or a file beside this one
  frames = [1, 50, 100]                  # columns of the sheet
  [set]                                  # optional: changes of all runs, as with --set
  \"solver\" = \"pbd\"
  [vary]                                 # every combination of these
  \"solver.pbd.iterations\" = [1, 3, 10]
  \"effects.gravity\" = [\"off\", \"on\"]
  [reference]                            # optional: each run is compared with itself so changed
  \"solver.pbd.iterations\" = 100
Also: name; combine = \"one at a time\"; measures = [\"time_s\", ...]. See docs/studies.md.

Results in pliant-out/NAME-study: report.html, sheet.png, study.csv, summary.json, and runs/*.json, which a second call
takes as they are where nothing that they depend on has changed. Exit code 130 or 143 where interrupted: finished runs are kept.")]
pub(super) struct Arguments {
    /// The study file
    file: String,
    #[command(flatten)]
    output: Output,
    #[arg(long, value_name = "KEY=VALUE", help = "Change the scene of all runs; may be given several times", long_help = super::options::set_help())]
    set: Vec<String>,
    /// Run all combinations again, including complete ones
    #[arg(long)]
    fresh: bool,
    /// Only list the runs and the expected time
    #[arg(long)]
    dry_run: bool,
    /// Run only part I of N parts, and keep the results: no table, no sheet. Several programs can
    /// write to one folder at once; a call without this option then makes the table
    #[arg(long, value_name = "I/N", value_parser = shard)]
    shard: Option<Shard>,
    /// Run only this combination, by its key in the list of --dry-run --json; may be given several
    /// times
    #[arg(long, value_name = "KEY", conflicts_with = "shard")]
    only: Vec<String>,
    /// Run only this row of the list, from 0, and read no other scene; may be given several times
    #[arg(long, value_name = "N", conflicts_with_all = ["shard", "only"])]
    row: Vec<usize>,
}

/// Part `index`, from 1, of `of` parts.
#[derive(Clone, Copy, Debug)]
struct Shard {
    index: usize,
    of: usize,
}

fn shard(text: &str) -> Result<Shard, String> {
    let parsed = text.split_once('/').and_then(|(index, of)| {
        Some(Shard {
            index: index.trim().parse().ok()?,
            of: of.trim().parse().ok()?,
        })
    });
    parsed
        .filter(|s| s.index >= 1 && s.index <= s.of)
        .ok_or_else(|| "expected I/N with I from 1 to N, such as 3/16".to_owned())
}

impl Arguments {
    /// The rows of `--shard` or `--row`; `None` for all.
    fn rows(&self, file: &StudyFile) -> Result<Option<Vec<usize>>, Failure> {
        let count = Combinations::count(file);
        if let Some(Shard { index, of }) = self.shard {
            return Ok(Some((index - 1..count).step_by(of).collect()));
        }
        if let Some(row) = self.row.iter().find(|row| **row >= count) {
            let message = format!("--row: no row {row} in a study of {count} combinations");
            return Err(Failure::usage(message, "rows count from 0"));
        }
        Ok((!self.row.is_empty()).then(|| self.row.clone()))
    }

    /// The combinations of `--only`; `None` for all.
    fn named(&self, study: &Combinations) -> Result<Option<Vec<usize>>, Failure> {
        if self.only.is_empty() {
            return Ok(None);
        }
        let find = |key: &String| {
            let found = study
                .all
                .iter()
                .find(|c| c.name() == *key || c.label == *key);
            // Of equal scenes, the first one stands for all.
            let found = found.and_then(|found| study.all.iter().position(|c| c.key == found.key));
            found.ok_or_else(|| {
                let message = format!("--only: no run `{key}` in the study");
                let hint = "`pliant study FILE --dry-run --json` lists the keys; a key changes with the scene, its files and the version \
                            of pliant";
                Failure::usage(message, hint)
            })
        };
        self.only
            .iter()
            .map(find)
            .collect::<Result<_, _>>()
            .map(Some)
    }
}

/// Runs a part of a study, and keeps the results for a later call.
fn part_of(
    study: &Combinations,
    part: &[usize],
    selected: &[usize],
    path: &std::path::Path,
    (threads, stop): (usize, Arc<AtomicBool>),
    output: &Output,
) -> Result<u8, Failure> {
    let begun = Instant::now();
    let said = Said::new(study, selected, stop.clone());
    let kept = Kept::Shared(path);
    execute(
        study,
        selected,
        kept,
        threads,
        &said,
        &|combination, outcome| {
            said.done(combination, outcome);
        },
    )?;
    said.end();
    let left = missing(study, Some(path));
    let undone = part.iter().filter(|k| left.contains(k)).count();
    let done = RunOutput {
        kind: "study_part",
        name: study.name.clone(),
        measures: json!({
            "runs": part.len(),
            "found": part.len() - selected.len(),
            "computed": selected.len().saturating_sub(undone),
            "left": left.len(),
            "keys": part.iter().map(|&k| study.all[k].name()).collect::<Vec<_>>(),
            "host": host(),
            "library": pliant::DIGEST,
        }),
        interrupted: undone > 0 && stop.load(Ordering::Relaxed),
        time_s: begun.elapsed().as_secs_f64(),
        text: format!(
            "{}: {} of {} runs of this part are finished\n",
            study.name,
            part.len() - undone,
            part.len()
        ),
        ..RunOutput::default()
    };
    Ok(output.printing.finish(done))
}

/// Name of the machine, if the system tells.
fn host() -> Option<String> {
    let name = std::fs::read_to_string("/proc/sys/kernel/hostname").ok();
    name.map(|n| n.trim().to_owned())
        .or_else(|| std::env::var("HOSTNAME").ok())
}

pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let begun = Instant::now();
    let stop = stop_on_interrupt("stopping after this frame");
    let threads = arguments.output.threads.count();
    arguments.output.threads.start();
    let file = StudyFile::read(
        &arguments.file,
        &arguments.set,
        &findings::names(),
        environment::variable,
    )?;
    let rows = arguments.rows(&file)?;
    let study = Combinations::of_rows(&file, rows.as_deref())?;
    let name = study.name.strip_suffix("-study").unwrap_or(&study.name);
    let path = arguments.output.folder(name, "study");
    let mut pending = missing(&study, (!arguments.fresh).then_some(path.as_path()));
    let part = match rows {
        Some(_) => Some((0..study.all.len()).collect()),
        None => arguments.named(&study)?,
    };
    if part.is_none() {
        study.check(&file, &study.covering())?;
    }
    if arguments.dry_run {
        let output = list(&study, &pending, threads);
        return Ok(arguments.output.printing.finish(output));
    }
    if let Some(part) = part {
        let part: Vec<usize> = part;
        let selected: Vec<usize> = pending.into_iter().filter(|k| part.contains(k)).collect();
        study.check(&file, &selected)?;
        return part_of(
            &study,
            &part,
            &selected,
            &path,
            (threads, stop),
            &arguments.output,
        );
    }
    let folder =
        Folder::open_keeping(&path, &|file| !arguments.fresh && file.starts_with("runs/"))?;
    // Other programs may have written runs, for which the list has no line.
    for combination in &study.all {
        let file = combination.file();
        if !arguments.fresh && Outcome::read(&path.join(&file), &combination.key).is_some() {
            folder.adopt(&file)?;
        }
    }
    // Longest first, so that none runs alone at the end.
    let expected: Vec<f64> = study.all.iter().map(Combination::expected_s).collect();
    pending.sort_by(|&a, &b| expected[b].total_cmp(&expected[a]).then(a.cmp(&b)));
    let said = Said::new(&study, &pending, stop.clone());
    let taken = study.all.len() - pending.len();
    if taken > 0 {
        note(&format!(
            "{taken} of {} runs are finished already",
            study.all.len()
        ));
    }
    execute(
        &study,
        &pending,
        Kept::Alone(&folder),
        threads,
        &said,
        &|combination, outcome| {
            said.done(combination, outcome);
        },
    )?;
    said.end();
    let found = Findings::of(&study, folder.path());
    let output = found.output(&folder, begun.elapsed().as_secs_f64())?;
    arguments.output.finish(&folder, output)
}

/// The runs without running them.
fn list(study: &Combinations, pending: &[usize], threads: usize) -> RunOutput<'static> {
    let expected: Vec<f64> = study.all.iter().map(Combination::expected_s).collect();
    let all: f64 = pending.iter().map(|&k| expected[k]).sum();
    let longest = pending
        .iter()
        .map(|&k| expected[k])
        .fold(0.0, |a: f64, b| if b > a { b } else { a });
    let wall = longest.max(all / threads.clamp(1, pending.len().max(1)) as f64);
    let left: std::collections::HashSet<usize> = pending.iter().copied().collect();
    let state = |k: usize| {
        if left.contains(&k) {
            "to run"
        } else {
            "finished"
        }
    };
    let row = |(k, c): (usize, &Combination)| {
        json!({
            "key": c.name(),
            "row": c.row,
            "label": c.label,
            "run": c.role.name(),
            "state": state(k),
            "frames": c.frames(),
            "expected_s": expected[k],
        })
    };
    let rows: Vec<_> = study.all.iter().enumerate().map(row).collect();
    let mut table = Table::new("Runs", ["run", "state", "frames", "expected [s]"]);
    for (k, c) in study.all.iter().enumerate() {
        table.row([
            c.label.clone(),
            state(k).to_owned(),
            c.frames().to_string(),
            format!("{:.1}", expected[k]),
        ]);
    }
    let (count, all, time) = (pending.len(), study.all.len(), in_words(wall));
    let plan = "by the plan, which does not know how much contact there will be";
    RunOutput {
        kind: "study",
        name: study.name.clone(),
        measures: json!({
            "scene": study.scene,
            "combine": study.combine.name(),
            "frames": study.frames,
            "expected_s": wall,
            "rows": rows,
        }),
        text: format!("{count} of {all} to run, about {time} on {threads} threads ({plan})\n"),
        tables_of_text: 1,
        tables: vec![table],
        ..RunOutput::default()
    }
}

/// Prints the progress of a study on standard error: a bar on a terminal, a line per finished run.
struct Said {
    stop: Arc<AtomicBool>,
    bar: Bar,
    begun: Instant,
    runs: usize,
    done: AtomicUsize,
    frames: usize,
    frames_done: AtomicUsize,
}

impl Said {
    fn new(study: &Combinations, pending: &[usize], stop: Arc<AtomicBool>) -> Self {
        let frames = pending.iter().map(|&k| study.all[k].frames()).sum();
        let bar = Bar::of_runs(frames);
        let (runs, done, frames_done) = (pending.len(), AtomicUsize::new(0), AtomicUsize::new(0));
        Self {
            stop,
            bar,
            begun: Instant::now(),
            runs,
            done,
            frames,
            frames_done,
        }
    }

    fn end(&self) {
        self.bar.end();
    }
}

impl Progress for Said {
    fn report(&self, stage: &str, done: usize, _: usize) -> ControlFlow<()> {
        // A run reports each frame with an empty stage; its start is no frame.
        if stage.is_empty() && done > 0 {
            self.frames_done.fetch_add(1, Ordering::Relaxed);
            self.bar.advance();
        }
        if_raised(&self.stop)
    }
}

impl Said {
    fn done(&self, combination: &Combination, outcome: &Outcome) {
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        let text = format!(
            "[{done}/{}] {}: {}, {}",
            self.runs,
            combination.label,
            outcome.status(),
            in_words(outcome.number("time_s"))
        );
        self.bar.say(&text, || {
            let frames = self.frames_done.load(Ordering::Relaxed);
            let elapsed = self.begun.elapsed().as_secs_f64();
            let left = elapsed * self.frames.saturating_sub(frames) as f64 / frames.max(1) as f64;
            format!("; about {} left", in_words(left))
        });
    }
}
