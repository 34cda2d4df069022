//! Every command of README and book runs. `PLIANT_BOOK=full` runs them as they stand; without it they get few frames.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Stdio;

use super::{Scratch, pliant, text};

/// A line of a block of shell commands.
#[derive(Debug, PartialEq)]
struct Line {
    page: String,
    /// The words as a shell makes them.
    words: Vec<String>,
    /// File that takes the output.
    into: Option<String>,
    /// The reason in the comment `<!-- not run: REASON -->` before the block.
    skipped: Option<String>,
}

/// The root of the repository.
fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// The pages in the order of the book.
fn pages() -> Vec<String> {
    let summary = fs::read_to_string(root().join("docs/SUMMARY.md")).expect("the summary");
    let listed = summary
        .split("](")
        .skip(1)
        .filter_map(|tail| tail.split(')').next());
    let of_docs = listed.map(|page| format!("docs/{page}"));
    std::iter::once("README.md".to_owned())
        .chain(of_docs)
        .collect()
}

/// The words of a line: quotes are removed, a comment ends it.
fn words(line: &str) -> (Vec<String>, Option<String>) {
    let (mut all, mut now, mut begun) = (Vec::new(), String::new(), false);
    let mut quote = None;
    for c in line.chars() {
        match (quote, c) {
            (Some(open), c) if c == open => quote = None,
            (Some(_), c) => now.push(c),
            (None, '\'' | '"') => (quote, begun) = (Some(c), true),
            (None, '#') if !begun => break,
            (None, c) if c.is_whitespace() => {
                if begun {
                    all.push(std::mem::take(&mut now));
                }
                begun = false;
            }
            (None, c) => {
                begun = true;
                now.push(c);
            }
        }
    }
    if begun {
        all.push(now);
    }
    let into = all.iter().position(|word| word == ">").and_then(|at| {
        let file = all.get(at + 1).cloned();
        all.truncate(at);
        file
    });
    (all, into)
}

/// The commands of a page. A comment `<!-- first: COMMAND -->` is a command that the page does not show.
fn lines(page: &str, text: &str) -> Vec<Line> {
    let (mut all, mut in_block, mut skipped) = (Vec::new(), false, None);
    let mut joined = String::new();
    let line_of = |line: &str, skipped: Option<String>| {
        let (words, into) = words(line);
        Line {
            page: page.to_owned(),
            words,
            into,
            skipped,
        }
    };
    for line in text.lines() {
        let comment = line
            .trim()
            .strip_prefix("<!-- ")
            .and_then(|c| c.strip_suffix(" -->"));
        if let Some(command) = comment.and_then(|c| c.strip_prefix("first: ")) {
            all.push(line_of(command, None));
        } else if let Some(reason) = comment.and_then(|c| c.strip_prefix("not run: ")) {
            skipped = Some(reason.to_owned());
        } else if line.starts_with("```sh") {
            in_block = true;
        } else if line.starts_with("```") {
            // The comment is of this block, also of one that is no shell.
            skipped = None;
            in_block = false;
        } else if in_block && !line.trim().is_empty() {
            joined.push_str(line.trim_end_matches('\\'));
            if !line.ends_with('\\') {
                all.push(line_of(&std::mem::take(&mut joined), skipped.clone()));
            }
        }
    }
    all.retain(|line| !line.words.is_empty());
    all
}

/// The arguments of the program, if a line calls it.
fn arguments(line: &Line) -> Option<Vec<String>> {
    match line.words.first()?.as_str() {
        "pliant" => Some(line.words[1..].to_vec()),
        _ => None,
    }
}

/// Why a line is not run, or nothing. What is no command of the program, or opens a window, needs a reason beside its block.
fn reason(line: &Line) -> Option<String> {
    if line.skipped.is_some() {
        return line.skipped.clone();
    }
    let first = line.words.first().map_or("", String::as_str);
    match first {
        "pliant" if line.words.get(1).is_some_and(|word| word == "view") => {
            Some("opens a window".to_owned())
        }
        "pliant" => None,
        "cargo" | "pip" | "python3" | "git" | "cd" => Some(format!("is a command of {first}")),
        _ => panic!(
            "{}: `{first}` is no known command: write <!-- not run: REASON --> before its block",
            line.page
        ),
    }
}

/// The same command with less to compute.
fn quick(mut words: Vec<String>) -> Vec<String> {
    let given = |words: &[String], option: &str| words.iter().position(|word| word == option);
    // Replaces the value of an option, or adds it.
    let with = |words: &mut Vec<String>, option: &str, value: &str| match given(words, option) {
        Some(at) => words[at + 1] = value.to_owned(),
        None => words.extend([option.to_owned(), value.to_owned()]),
    };
    let named = |name: &str| words.get(1).is_some_and(|scene| scene.starts_with(name));
    match words[0].as_str() {
        "run" if words.iter().any(|word| word == "--resume") => with(&mut words, "--frames", "4"),
        "run" if named("expander") => with(&mut words, "--frames", "1"),
        "run" if given(&words, "--checkpoint-every").is_some() => {
            with(&mut words, "--frames", "2");
            with(&mut words, "--checkpoint-every", "1");
        }
        "run" if !named("flat-implant") && !named("plan.toml") => with(&mut words, "--frames", "2"),
        "accuracy" => {
            // Skin is compared in its last frame.
            if !named("flat-implant") {
                with(&mut words, "--frames", "1");
            }
            with(&mut words, "--budget", "2s");
        }
        "study" if given(&words, "--dry-run").is_none() => words.push("--dry-run".to_owned()),
        "sensitivities" => with(&mut words, "--runs", "never"),
        "implant" if words.iter().any(|word| word.contains("sheet.obj")) => {
            with(&mut words, "--edge", "7mm")
        }
        "stress" => {
            with(&mut words, "--cases", "2");
            with(&mut words, "--frames", "1");
        }
        "morph" => with(&mut words, "--frames", "2"),
        "springs" => {
            for word in &mut words {
                if word.split('x').count() == 3
                    && word.chars().all(|c| c.is_ascii_digit() || c == 'x')
                {
                    *word = "5x5x5".to_owned();
                }
                match word.as_str() {
                    "10,20,50" | "10,20,50,100" => *word = "6".to_owned(),
                    "points=5,10,20" => *word = "points=5".to_owned(),
                    _ => {}
                }
            }
        }
        _ => {}
    }
    words
}

/// Runs the commands of a page, one after the other in one folder. Returns the numbers of run and skipped ones, and what failed.
fn run_page(page: &str, text_of_page: &str, is_full: bool) -> (usize, Vec<String>, Vec<String>) {
    let folder = Scratch::folder();
    std::os::unix::fs::symlink(
        root().join("examples").canonicalize().expect("examples"),
        folder.join("examples"),
    )
    .expect("a link");
    let (mut run, mut skipped, mut failed) = (0, Vec::new(), Vec::new());
    for line in lines(page, text_of_page) {
        let shown = line.words.join(" ");
        if let Some(why) = reason(&line) {
            skipped.push(format!("{page}: `{shown}`: {why}"));
            continue;
        }
        let words = arguments(&line).expect("a command of the program");
        let words = if is_full || words.is_empty() {
            words
        } else {
            quick(words)
        };
        let mut command = pliant();
        command
            .current_dir(&*folder)
            .args(&words)
            .stdin(Stdio::null());
        if let Some(file) = &line.into {
            command.stdout(fs::File::create(folder.join(file)).expect("a file"));
        }
        let begun = std::time::Instant::now();
        let done = command.output().expect("the program");
        run += 1;
        println!(
            "{:6.1} s  {page}: pliant {}",
            begun.elapsed().as_secs_f64(),
            words.join(" ")
        );
        // A red check is a result; the frames of a quick run are too few for a green one.
        if !matches!(done.status.code(), Some(0 | 1)) || text(&done.stderr).contains("panicked") {
            failed.push(format!(
                "{page}: `{shown}` ends with {}: {}",
                done.status,
                text(&done.stderr)
            ));
        }
    }
    (run, skipped, failed)
}

#[test]
fn every_command_of_the_book_runs() {
    let is_full = std::env::var_os("PLIANT_BOOK").is_some_and(|value| value == "full");
    let (mut run, mut skipped, mut failed) = (0, Vec::new(), Vec::new());
    let pages = pages();
    // Two at a time: most commands leave a core free.
    let halves: Vec<Vec<&String>> = (0..2)
        .map(|half| pages.iter().skip(half).step_by(2).collect())
        .collect();
    let done: Vec<_> = std::thread::scope(|scope| {
        let runs = halves.iter().map(|half| {
            scope.spawn(move || {
                half.iter()
                    .map(|page| {
                        let text = fs::read_to_string(root().join(page)).expect("a page");
                        run_page(page, &text, is_full)
                    })
                    .collect::<Vec<_>>()
            })
        });
        let runs: Vec<_> = runs.collect();
        runs.into_iter()
            .flat_map(|run| run.join().expect("a half of the book"))
            .collect()
    });
    for (count, without, wrong) in done {
        run += count;
        skipped.extend(without);
        failed.extend(wrong);
    }
    println!(
        "{run} commands run, {} skipped:\n{}",
        skipped.len(),
        skipped.join("\n")
    );
    assert!(
        failed.is_empty(),
        "{} of {run} commands fail:\n{}",
        failed.len(),
        failed.join("\n")
    );
    assert!(run >= 70, "only {run} commands seen");
}

#[test]
fn a_wrong_command_would_be_seen() {
    let wrong = "```sh\npliant scenes\npliant run no-such-scene.toml\n```\n";
    let (run, skipped, failed) = run_page("p", wrong, false);
    assert_eq!((run, skipped.len(), failed.len()), (2, 0, 1), "{failed:?}");
    assert!(failed[0].contains("no-such-scene"), "{failed:?}");
    let page = "a\n<!-- not run: needs a card -->\n```sh\npliant run x  # why\n```\n```sh\npliant a 'b c' \\\n  --d=\"e # f\" > g.toml\n```\n";
    let found = lines("p", page);
    assert_eq!(found.len(), 2);
    assert_eq!(found[0].skipped.as_deref(), Some("needs a card"));
    assert_eq!(found[0].words, ["pliant", "run", "x"]);
    assert_eq!(found[1].words, ["pliant", "a", "b c", "--d=e # f"]);
    assert_eq!(found[1].into.as_deref(), Some("g.toml"));
}
