//! The tests of the copy: what each takes and which mutants it reaches, and what they say of a mutant.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use serde_json::{Map, Value, json};

use crate::tree::Tree;

/// Programs that examine sources, not results.
const LEFT_OUT: [&str; 2] = ["house", "docs"];
/// A test that takes longer judges no mutant.
const LONGEST: Duration = Duration::from_secs(60);
/// Tests of one process: as many as take so long together.
const TOGETHER: Duration = Duration::from_secs(4);
/// A mutant hangs if its tests take this many times as long as without it.
const HANGS: u32 = 5;
/// Memory of a process [KiB].
const MEMORY: &str = "12000000";

/// One test.
struct Test {
    program: usize,
    name: String,
    time: Duration,
    reaches: BTreeSet<usize>,
}

pub struct Tests {
    programs: Vec<(PathBuf, PathBuf)>,
    /// The quickest first.
    all: Vec<Test>,
    folder: PathBuf,
}

/// What the tests say of a mutant.
pub struct Judged {
    pub verdict: &'static str,
    /// The test that notices it; without one, how many tests did not.
    pub by: String,
}

/// How a process ended.
enum End {
    Passed,
    /// With the output.
    Failed(String),
    TooLong,
}

/// Starts some tests with a variable of the environment; their output goes to a file.
fn start(
    program: &(PathBuf, PathBuf),
    names: &[&str],
    output: &Path,
    (variable, value): (&str, &str),
) -> Result<Child, String> {
    let file = fs::File::create(output).map_err(|e| format!("{}: {e}", output.display()))?;
    let limited = format!("ulimit -v {MEMORY}; exec \"$0\" \"$@\"");
    Command::new("sh")
        .args(["-c", &limited])
        .arg(&program.0)
        .args(["--exact", "--test-threads", "2"])
        .args(names)
        .current_dir(&program.1)
        .env("CARGO_MANIFEST_DIR", &program.1)
        .env(variable, value)
        .stdin(Stdio::null())
        .stderr(Stdio::null())
        .stdout(file)
        .spawn()
        .map_err(|e| format!("{}: {e}", program.0.display()))
}

/// Kills a test, and the programs that it has started.
fn kill(child: &mut Child) {
    let listed = Command::new("ps").args(["-eo", "pid=,ppid="]).output();
    let text = listed.map_or(String::new(), |o| {
        String::from_utf8_lossy(&o.stdout).into_owned()
    });
    let pairs: Vec<(u32, u32)> = text
        .lines()
        .filter_map(|line| {
            let mut numbers = line.split_whitespace().map(|n| n.parse().ok());
            Some((numbers.next()??, numbers.next()??))
        })
        .collect();
    let mut family = vec![child.id()];
    let mut at = 0;
    while let Some(&parent) = family.get(at) {
        family.extend(
            pairs
                .iter()
                .filter(|(_, of)| *of == parent)
                .map(|(pid, _)| *pid),
        );
        at += 1;
    }
    for pid in family.iter().skip(1) {
        let _ = Command::new("kill").args(["-9", &pid.to_string()]).status();
    }
    let _ = child.kill();
}

fn end(mut child: Child, output: &Path, within: Duration) -> Result<End, String> {
    let begin = Instant::now();
    loop {
        let status = child.try_wait().map_err(|e| e.to_string())?;
        if let Some(status) = status {
            return Ok(match status.success() {
                true => End::Passed,
                false => End::Failed(fs::read_to_string(output).unwrap_or_default()),
            });
        }
        if begin.elapsed() > within {
            kill(&mut child);
            let _ = child.wait();
            return Ok(End::TooLong);
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

impl Tests {
    /// All tests that pass without a mutant, with their times and what they reach. A test is measured once
    /// for each draw: one that is new since then, or another name, is measured now.
    pub fn of(tree: &Tree, programs: &[(PathBuf, PathBuf)], draw: &str) -> Result<Self, String> {
        let mut all = Vec::new();
        let programs: Vec<_> = programs
            .iter()
            .filter(|(path, _)| !LEFT_OUT.contains(&&*stem(path)))
            .cloned()
            .collect();
        for (program, (path, at)) in programs.iter().enumerate() {
            let listed = Command::new(path)
                .current_dir(at)
                .args(["--list", "--format", "terse"])
                .output();
            let listed = listed.map_err(|e| format!("{}: {e}", path.display()))?;
            let text = String::from_utf8_lossy(&listed.stdout).into_owned();
            all.extend(
                text.lines()
                    .filter_map(|l| Some((program, l.strip_suffix(": test")?.to_owned()))),
            );
        }
        let folder = tree.folder().to_owned();
        let known = folder.join(format!("tests-{draw}.json"));
        let read =
            fs::read_to_string(&known).map_or(Ok(Value::Null), |text| serde_json::from_str(&text));
        let mut read: Map<String, Value> =
            match read.map_err(|e| format!("{}: {e}", known.display()))? {
                Value::Object(rows) => rows,
                _ => Map::new(),
            };
        let new: Vec<_> = all
            .iter()
            .filter(|test| !read.contains_key(&key(&programs, test)))
            .cloned()
            .collect();
        read.extend(measure(&programs, &new, &folder)?);
        fs::write(&known, Value::Object(read.clone()).to_string()).map_err(|e| e.to_string())?;
        let test = |test: &(usize, String)| {
            let row = read.get(&key(&programs, test))?;
            Some(Test {
                program: test.0,
                name: test.1.clone(),
                time: Duration::from_secs_f64(row["seconds"].as_f64()?),
                reaches: row["reaches"]
                    .as_array()?
                    .iter()
                    .filter_map(|n| Some(n.as_u64()? as usize))
                    .collect(),
            })
        };
        let mut all: Vec<Test> = all.iter().filter_map(test).collect();
        all.sort_by_key(|test| test.time);
        Ok(Self {
            programs,
            all,
            folder,
        })
    }

    /// Runs the tests that reach a mutant until one fails.
    pub fn judge(&self, number: usize, folder: &str, budget: Duration) -> Result<Judged, String> {
        let own = format!("{}::", folder.trim_start_matches("cli/"));
        let reach = || {
            self.all
                .iter()
                .filter(|test| test.reaches.contains(&number))
        };
        let is_own = |test: &&Test| test.name.starts_with(&own);
        let order: Vec<&Test> = reach()
            .filter(is_own)
            .chain(reach().filter(|t| !is_own(t)))
            .collect();
        if order.is_empty() {
            return Ok(Judged {
                verdict: "survived",
                by: "no test reaches it".to_owned(),
            });
        }
        let (begin, mut done) = (Instant::now(), 0);
        let output = self.folder.join("judged.txt");
        while done < order.len() {
            let first = order[done];
            let mut time = Duration::ZERO;
            let batch = order[done..].iter().take_while(|test| {
                time += test.time;
                test.program == first.program && (time <= TOGETHER || test.name == first.name)
            });
            let names: Vec<&str> = batch.map(|test| test.name.as_str()).collect();
            let usual: Duration = order[done..done + names.len()]
                .iter()
                .map(|test| test.time)
                .sum();
            let left = budget.saturating_sub(begin.elapsed());
            if left < usual {
                break;
            }
            let limit = HANGS * usual + Duration::from_secs(10);
            let asked = ("PLIANT_MUTANT", &*number.to_string());
            let child = start(&self.programs[first.program], &names, &output, asked)?;
            match end(child, &output, limit)? {
                End::Passed => {}
                End::TooLong => {
                    return Ok(Judged {
                        verdict: "killed",
                        by: format!("{} (hangs)", names[0]),
                    });
                }
                End::Failed(text) => {
                    let failed = text
                        .lines()
                        .find_map(|line| line.strip_prefix("test ")?.strip_suffix(" ... FAILED"));
                    return Ok(Judged {
                        verdict: "killed",
                        by: failed.unwrap_or(names[0]).to_owned(),
                    });
                }
            }
            done += names.len();
        }
        let by = match done == order.len() {
            true => format!("none of {done} tests"),
            false => format!("none of {done} of {} tests", order.len()),
        };
        Ok(Judged {
            verdict: "survived",
            by,
        })
    }
}

/// The name of a program without the number that the build gives it.
fn stem(path: &Path) -> String {
    let name = path
        .file_stem()
        .map_or(String::new(), |n| n.to_string_lossy().into_owned());
    name.rsplit_once('-')
        .map_or(name.clone(), |(stem, _)| stem.to_owned())
}

/// The name of a test among those of all programs.
fn key(programs: &[(PathBuf, PathBuf)], (program, name): &(usize, String)) -> String {
    format!("{} {name}", stem(&programs[*program].0))
}

/// Runs these tests alone, two at a time. The row of one that fails has no time.
fn measure(
    programs: &[(PathBuf, PathBuf)],
    tests: &[(usize, String)],
    folder: &Path,
) -> Result<Vec<(String, Value)>, String> {
    let (next, found) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    let one = |worker: usize| -> Result<(), String> {
        loop {
            let Some(test) = tests.get(next.fetch_add(1, Ordering::Relaxed)) else {
                return Ok(());
            };
            let [output, log] =
                ["txt", "log"].map(|ending| folder.join(format!("measured-{worker}.{ending}")));
            let _ = fs::remove_file(&log);
            let begin = Instant::now();
            let reached = ("PLIANT_MUTANT_LOG", &*log.to_string_lossy());
            let child = start(&programs[test.0], &[&test.1], &output, reached)?;
            let row = match end(child, &output, LONGEST)? {
                End::Passed => {
                    let seconds = begin.elapsed().as_secs_f64();
                    let text = fs::read_to_string(&log).unwrap_or_default();
                    let reaches: BTreeSet<usize> =
                        text.lines().filter_map(|l| l.parse().ok()).collect();
                    json!({"seconds": seconds, "reaches": reaches})
                }
                End::Failed(_) | End::TooLong => {
                    eprintln!("judges nothing: {}", test.1);
                    json!({})
                }
            };
            found
                .lock()
                .map_err(|e| e.to_string())?
                .push((key(programs, test), row));
        }
    };
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..2)
            .map(|worker| scope.spawn(move || one(worker)))
            .collect();
        workers
            .into_iter()
            .try_for_each(|worker| worker.join().unwrap_or(Err("a worker panicked".to_owned())))
    })?;
    found.into_inner().map_err(|e| e.to_string())
}
