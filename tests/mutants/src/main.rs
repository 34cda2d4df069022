//! Puts small mistakes into Pliant, one at a time, and tells which of them its tests do not find.
//!
//! One build has all drawn mistakes. A number in the environment says which one is made. Each is judged
//! by the tests that reach it. `docs/verification.md` has the scores.

mod draw;
mod judge;
mod report;
mod sites;
mod tree;

use std::fs;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use draw::Mutant;
use judge::Verdict;

const USAGE: &str = "\
usage: cargo run --release --manifest-path tests/mutants/Cargo.toml -- [--all N] [--seed S] [--hours H]

Draws about N mistakes (300) by a seed (1), at least 10 of each folder, compiles them into a copy of the sources under
target/mutants, and judges one after another for at most H hours (2). Goes on where an earlier run ended. Writes
tests/mutants/results.tsv and prints the scores. A change of the sources does not disturb a run: remove target/mutants to
draw anew.";

struct Options {
    all: usize,
    seed: u64,
    hours: f64,
}

fn options() -> Option<Options> {
    let mut options = Options {
        all: 300,
        seed: 1,
        hours: 2.0,
    };
    let mut given = std::env::args().skip(1);
    while let Some(name) = given.next() {
        let value = given.next()?;
        match name.as_str() {
            "--all" => options.all = value.parse().ok()?,
            "--seed" => options.seed = value.parse().ok()?,
            "--hours" => options.hours = value.parse().ok()?,
            _ => return None,
        }
    }
    Some(options)
}

fn main() -> io::Result<()> {
    let Some(options) = options() else {
        eprintln!("{USAGE}");
        std::process::exit(2);
    };
    let root = fs::canonicalize(Path::new(env!("CARGO_MANIFEST_DIR")).join("../.."))?;
    let store = root.join("target/mutants");
    let ends = Instant::now() + Duration::from_secs_f64(options.hours * 3600.0);
    let [tree, build] = ["tree", "build"].map(|name| store.join(name));
    fs::create_dir_all(&tree)?;
    let drawn = drawn(&root, &store, &tree, &build, &options)?;
    let programs = tree::compile(&tree, &build)?;
    let units = judge::units(&tree, &programs)?;
    eprintln!("{} mistakes, {} units of tests", drawn.len(), units.len());
    let Some(units) = judge::reach(units, &store.join("units.tsv"), ends)? else {
        eprintln!("time is up: run the command again");
        return Ok(());
    };
    let judged = store.join("judged.tsv");
    let known = report::known(&judged);
    let mut file = fs::OpenOptions::new().create(true).append(true).open(&judged)?;
    for mutant in drawn.iter().filter(|m| !known.contains_key(&m.id)) {
        if Instant::now() > ends {
            eprintln!("time is up: run the command again");
            break;
        }
        let begun = Instant::now();
        let verdict = judge::judge(mutant, &units)?;
        writeln!(file, "{}\t{}", mutant.id, verdict.to_text())?;
        let Mutant { id, file, site, .. } = mutant;
        let seconds = begun.elapsed().as_secs_f64();
        eprintln!("{id}\t{file}:{}\t{}\t{seconds:.0} s", site.line, verdict.to_text());
    }
    report::write(&root, &drawn, &report::known(&judged))
}

/// The mistakes that compile: those of an earlier run, or new ones.
fn drawn(root: &Path, store: &Path, tree: &Path, build: &PathBuf, options: &Options) -> io::Result<Vec<Mutant>> {
    let refused = store.join("refused.txt");
    let sources = store.join("sources");
    if !refused.exists() {
        // The sources as they are now: a later run compiles these.
        for file in tree::tracked(root)?.iter().filter(|f| root.join(f).is_file()) {
            let path = sources.join(file);
            fs::create_dir_all(path.parent().expect("a folder"))?;
            fs::copy(root.join(file), path)?;
        }
        fs::write(store.join("commit.txt"), report::commit(root)?)?;
    }
    let files: Vec<String> = tree::tracked(root)?;
    let files: Vec<String> = files.into_iter().filter(|f| sources.join(f).is_file()).collect();
    let all = draw::draw(&sources, &files, options.all, options.seed)?;
    let mut not: Vec<u32> = fs::read_to_string(&refused).unwrap_or_default().lines().filter_map(|n| n.parse().ok()).collect();
    let compiling = |not: &[u32]| all.iter().filter(|m| !not.contains(&m.id)).cloned().collect::<Vec<_>>();
    while !refused.exists() {
        let places = tree::write(&sources, tree, &files, &compiling(&not))?;
        match tree::refused(tree, build, &places)? {
            Some(more) => {
                eprintln!("{} mistakes do not compile", more.len());
                not.extend(more);
            }
            None => {
                let text: String = not.iter().map(|n| format!("{n}\n")).collect();
                fs::write(&refused, text)?;
            }
        }
    }
    let mut kept = all.clone();
    draw::cut(&mut kept, &not);
    tree::write(&sources, tree, &files, &kept)?;
    Ok(kept)
}
