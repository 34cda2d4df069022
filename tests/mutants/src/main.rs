//! Mistakes put into the library and the program one at a time: do the tests notice?
//!
//! One build carries all mutants; the variable `PLIANT_MUTANT` says which of them runs. Each is judged by
//! the tests that reach it, first those of its own folder, then the others, quickest first, for at most
//! [`BUDGET`]. Results are appended to `results.tsv`, so that a trial that was stopped goes on.

mod sites;
mod tests;
mod tree;

use std::collections::{BTreeMap, HashMap};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use tests::{Judged, Tests};
use tree::Tree;

/// For the tests of one mutant.
const BUDGET: Duration = Duration::from_secs(90);
/// Drawn from each folder, and candidates, as some do not compile.
const DRAWN: usize = 15;
const CANDIDATES: usize = 42;
/// The draw.
const SEED: &str = "pliant 2026-11";

/// A mutant of the trial.
pub struct Mutant {
    pub site: sites::Site,
    pub folder: String,
    /// A short name that stays the same as long as the site does.
    pub id: String,
}

/// FNV-1a: the draw must be the same with every version of the compiler.
fn hash(text: &str) -> u64 {
    text.bytes().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
    })
}

/// The folder of a source file: that of its module. `None` for files that are not tried.
fn folder(file: &str) -> Option<String> {
    let (before, inside) = match file.strip_prefix("cli/src/") {
        Some(inside) => ("cli/", inside),
        None => ("", file.strip_prefix("src/")?),
    };
    let is_of_tests = inside
        .split('/')
        .any(|part| matches!(part, "tests.rs" | "tests" | "testing" | "testing.rs"));
    if is_of_tests || !file.ends_with(".rs") {
        return None;
    }
    let top = inside.split('/').next()?;
    let top = top.strip_suffix(".rs").unwrap_or(top);
    let is_root = !inside.contains('/') && !Path::new(file).with_extension("").is_dir();
    Some(if is_root {
        format!("{before}root")
    } else {
        format!("{before}{top}")
    })
}

/// All mutants of the sources, in the order of the draw, by folder.
fn draw(root: &Path) -> Result<BTreeMap<String, Vec<Mutant>>, String> {
    let mut all: BTreeMap<String, Vec<Mutant>> = BTreeMap::new();
    for file in tree::tracked(root)? {
        let Some(folder) = folder(&file) else {
            continue;
        };
        let text = fs::read_to_string(root.join(&file)).map_err(|e| format!("{file}: {e}"))?;
        for site in sites::of(&file, &text).map_err(|e| format!("{file}: {e}"))? {
            let id = format!("{:016x}", hash(&format!("{SEED}|{}", site.key)));
            all.entry(folder.clone()).or_default().push(Mutant {
                site,
                folder: folder.clone(),
                id,
            });
        }
    }
    for mutants in all.values_mut() {
        mutants.sort_by(|a, b| a.id.cmp(&b.id));
        // Sites do not lie in each other.
        let mut kept: Vec<Mutant> = Vec::new();
        for mutant in mutants.drain(..) {
            let site = &mutant.site;
            let apart = |other: &Mutant| {
                let (a, b) = (&site.range, &other.site.range);
                other.site.file != site.file || a.end <= b.start || b.end <= a.start
            };
            if kept.len() < CANDIDATES && kept.iter().all(apart) {
                kept.push(mutant);
            }
        }
        *mutants = kept;
    }
    Ok(all)
}

/// Lines of a table with tabs, by their first column.
fn table(path: &Path) -> HashMap<String, Vec<String>> {
    let text = fs::read_to_string(path).unwrap_or_default();
    let rows = text
        .lines()
        .skip(1)
        .map(|line| line.split('\t').map(str::to_owned).collect::<Vec<_>>());
    rows.filter_map(|row| Some((row.first()?.clone(), row)))
        .collect()
}

/// The verdict of a row; a row that a stopped trial left in the middle has none.
fn verdict(row: &[String]) -> &str {
    row.get(4).map_or("", String::as_str)
}

fn append(path: &Path, row: &[&str]) -> Result<(), String> {
    use std::io::Write as _;
    let is_new = !path.exists();
    let file = fs::OpenOptions::new().create(true).append(true).open(path);
    let mut file = file.map_err(|e| format!("{}: {e}", path.display()))?;
    let head = if is_new {
        "id\tfolder\tplace\tchange\tverdict\tby\tcommit\tdate\n"
    } else {
        ""
    };
    writeln!(file, "{head}{}", row.join("\t")).map_err(|e| format!("{}: {e}", path.display()))
}

fn output(program: &str, arguments: &[&str]) -> Result<String, String> {
    let output = Command::new(program)
        .args(arguments)
        .output()
        .map_err(|e| format!("{program}: {e}"))?;
    Ok(String::from_utf8_lossy(&output.stdout).trim().to_owned())
}

/// Scores of the folders in Markdown, and the survivors that are not equivalent.
fn report(drawn: &[Mutant], here: &Path) {
    let (results, reasons) = (
        table(&here.join("results.tsv")),
        table(&here.join("reasons.tsv")),
    );
    let mut scores: BTreeMap<&str, [usize; 4]> = BTreeMap::new();
    let mut open = Vec::new();
    for mutant in drawn {
        let score = scores.entry(&mutant.folder).or_default();
        score[0] += 1;
        let Some(row) = results.get(&mutant.id) else {
            continue;
        };
        let is_equivalent = reasons
            .get(&mutant.id)
            .is_some_and(|r| r.get(1).is_some_and(|w| w == "equivalent"));
        match (verdict(row), is_equivalent) {
            ("killed", _) => score[1] += 1,
            (_, true) => score[2] += 1,
            _ => {
                score[3] += 1;
                let reason = reasons
                    .get(&mutant.id)
                    .and_then(|r| r.get(2))
                    .map_or("", String::as_str);
                let Mutant { site, id, .. } = mutant;
                open.push(format!(
                    "{id} {}:{} {} {reason}",
                    site.file, site.line, site.what
                ));
            }
        }
    }
    println!(
        "| folder | drawn | killed | equivalent | survived | killed of the rest |\n|---|---|---|---|---|---|"
    );
    let mut sum = [0; 4];
    for (name, score) in &scores {
        line(name, score);
        (0..4).for_each(|k| sum[k] += score[k]);
    }
    line("all", &sum);
    println!("\nSurvivors:");
    open.iter().for_each(|line| println!("{line}"));
}

fn line(name: &str, [drawn, killed, equivalent, survived]: &[usize; 4]) {
    let share = 100.0 * *killed as f64 / (killed + survived).max(1) as f64;
    println!("| {name} | {drawn} | {killed} | {equivalent} | {survived} | {share:.0} % |");
}

const USAGE: &str = "\
usage: mutants [--minutes N] [--folder NAME] [--again] [--table]
Runs from the root of the repository. --minutes ends the trial after so long (120), --folder tries one folder,
--again judges survivors once more, --table prints scores and survivors without a trial.";

fn run() -> Result<(), String> {
    let (mut minutes, mut only, mut again, mut shows) = (120, None::<String>, false, false);
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().ok_or(USAGE);
        match argument.as_str() {
            "--minutes" => minutes = value()?.parse().map_err(|_| USAGE)?,
            "--folder" => only = Some(value()?),
            "--again" => again = true,
            "--table" => shows = true,
            _ => return Err(USAGE.to_owned()),
        }
    }
    let begin = Instant::now();
    let root = std::env::current_dir().map_err(|e| e.to_string())?;
    let here = root.join("tests/mutants");
    if !here.is_dir() {
        return Err(USAGE.to_owned());
    }
    let target = std::env::var_os("CARGO_TARGET_DIR").map_or(root.join("target"), PathBuf::from);
    let tree = Tree::new(&root, &target.join("mutants"))?;
    let drawn = tree.compilable(draw(&root)?, DRAWN)?;
    if shows {
        report(&drawn, &here);
        return Ok(());
    }
    let ids: String = drawn
        .iter()
        .map(|mutant| format!("{}\n", mutant.id))
        .collect();
    let tests = Tests::of(&tree, &tree.build(&drawn)?, &format!("{:016x}", hash(&ids)))?;
    let results = here.join("results.tsv");
    let commit = output("git", &["rev-parse", "--short", "HEAD"])?;
    let (known, date) = (table(&results), output("date", &["+%F"])?);
    for (number, mutant) in drawn.iter().enumerate() {
        let is_known = known
            .get(&mutant.id)
            .is_some_and(|row| !(again && verdict(row) != "killed"));
        if is_known || only.as_ref().is_some_and(|only| *only != mutant.folder) {
            continue;
        }
        if begin.elapsed() > Duration::from_secs(60 * minutes) {
            println!("time is over; the same command goes on");
            return Ok(());
        }
        let Judged { verdict, by } = tests.judge(number, &mutant.folder, BUDGET)?;
        let site = &mutant.site;
        let place = format!("{}:{}", site.file, site.line);
        println!("{verdict}\t{place}\t{}\t{by}", site.what);
        append(
            &results,
            &[
                &mutant.id,
                &mutant.folder,
                &place,
                &site.what,
                verdict,
                &by,
                &commit,
                &date,
            ],
        )?;
    }
    report(&drawn, &here);
    Ok(())
}

fn main() {
    if let Err(error) = run() {
        eprintln!("{error}");
        std::process::exit(2);
    }
}
