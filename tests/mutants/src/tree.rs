//! A copy of the sources in which all drawn mistakes stand, and none is made until a number is given.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;
use std::process::{Command, Stdio};
use std::{fs, io};

use serde_json::Value;

use crate::draw::Mutant;

/// What is asked at each mistake. `PLIANT_MUTANT` is the number of the one that is made; with
/// `PLIANT_MUTANT_LOG` none is made, and the file has the number of each that was asked for.
const ASKED: &str = r#"
/// Whether a mistake is made.
#[doc(hidden)]
pub fn mutant(number: u32) -> bool {
    use std::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};
    const UNREAD: u32 = u32::MAX;
    const LOG: u32 = u32::MAX - 1;
    const NONE: u32 = u32::MAX - 2;
    static CHOSEN: AtomicU32 = AtomicU32::new(UNREAD);
    static SEEN: [AtomicBool; 4096] = [const { AtomicBool::new(false) }; 4096];
    let mut chosen = CHOSEN.load(Relaxed);
    if chosen == UNREAD {
        let number = std::env::var("PLIANT_MUTANT").ok().and_then(|n| n.parse().ok());
        let log = std::env::var_os("PLIANT_MUTANT_LOG").is_some();
        chosen = if log { LOG } else { number.unwrap_or(NONE) };
        CHOSEN.store(chosen, Relaxed);
    }
    if chosen == LOG && !SEEN[number as usize].load(Relaxed) {
        SEEN[number as usize].store(true, Relaxed);
        let path = std::env::var_os("PLIANT_MUTANT_LOG").expect("a file");
        let file = std::fs::OpenOptions::new().create(true).append(true).open(path);
        let _ = std::io::Write::write_all(&mut file.expect("a log"), format!("{number}\n").as_bytes());
    }
    chosen == number
}
"#;

/// The files that git knows below `root`.
///
/// # Errors
/// Without git.
pub fn tracked(root: &Path) -> io::Result<Vec<String>> {
    let listed = Command::new("git").args(["ls-files", "-z"]).current_dir(root).output()?;
    let names = String::from_utf8(listed.stdout).map_err(io::Error::other)?;
    let names = names.split('\0').filter(|name| !name.is_empty());
    Ok(names.map(str::to_owned).collect())
}

/// Where each mistake stands in the copy: file, bytes, number.
pub type Places = Vec<(String, Range<usize>, u32)>;

/// Writes the copy. Files that have not changed are not touched.
///
/// # Errors
/// A file that cannot be read or written.
pub fn write(root: &Path, tree: &Path, files: &[String], drawn: &[Mutant]) -> io::Result<Places> {
    let mut of: BTreeMap<&str, Vec<&Mutant>> = BTreeMap::new();
    for mutant in drawn {
        of.entry(&mutant.file).or_default().push(mutant);
    }
    let mut places = Vec::new();
    for file in files.iter().filter(|file| root.join(file).is_file()) {
        let mut content = fs::read(root.join(file))?;
        if let Some(of) = of.get_mut(file.as_str()) {
            of.sort_by_key(|mutant| mutant.site.range.start);
            let text = String::from_utf8(content).map_err(io::Error::other)?;
            content = with(&text, file, of, &mut places).into_bytes();
        }
        if file == "src/lib.rs" {
            content.extend_from_slice(ASKED.as_bytes());
        }
        let path = tree.join(file);
        if fs::read(&path).ok().as_ref() != Some(&content) {
            fs::create_dir_all(path.parent().expect("a folder"))?;
            fs::write(path, content)?;
        }
    }
    Ok(places)
}

/// The text of a file with mistakes, which are in order and apart.
fn with(text: &str, file: &str, mutants: &[&Mutant], places: &mut Places) -> String {
    let library = if file.starts_with("cli/") { "pliant" } else { "crate" };
    let (mut result, mut done) = (String::new(), 0);
    for Mutant { id, site, right, .. } in mutants {
        result += &text[done..site.range.start];
        let begin = result.len();
        result += &if site.statement {
            format!("if !{library}::mutant({id}) {{ {right} }}")
        } else {
            format!("(if {library}::mutant({id}) {{ {} }} else {{ {right} }})", site.wrong)
        };
        places.push((file.to_owned(), begin..result.len(), *id));
        done = site.range.end;
    }
    result + &text[done..]
}

/// Runs cargo in the copy and returns its messages.
fn cargo(tree: &Path, build: &Path, arguments: &[&str]) -> io::Result<Vec<Value>> {
    let done = Command::new("cargo")
        .args(arguments)
        .args(["-p", "pliant", "-p", "pliant-cli", "--message-format=json"])
        .current_dir(tree)
        .env("CARGO_TARGET_DIR", build)
        .env("RUSTFLAGS", "--cap-lints=allow")
        .stderr(Stdio::inherit())
        .output()?;
    let text = String::from_utf8(done.stdout).map_err(io::Error::other)?;
    Ok(text.lines().filter_map(|line| serde_json::from_str(line).ok()).collect())
}

/// The numbers of mistakes that do not compile; `None` if all do.
///
/// # Errors
/// An error of the compiler outside every mistake.
pub fn refused(tree: &Path, build: &Path, places: &Places) -> io::Result<Option<Vec<u32>>> {
    let mut numbers = Vec::new();
    let mut strange = String::new();
    for message in cargo(tree, build, &["check", "--profile", "test"])? {
        let message = &message["message"];
        if message["level"] != "error" {
            continue;
        }
        let spans = message["spans"].as_array().cloned().unwrap_or_default();
        let inside = |span: &Value| -> Vec<u32> {
            let (file, start) = (span["file_name"].as_str(), span["byte_start"].as_u64());
            let within = |(f, range, _): &&(String, Range<usize>, u32)| {
                let here = start.is_some_and(|s| range.contains(&(s as usize)));
                file.is_some_and(|file| file == f || f.ends_with(&format!("/{file}"))) && here
            };
            places.iter().filter(within).map(|(_, _, id)| *id).collect()
        };
        let found: Vec<u32> = spans.iter().flat_map(inside).collect();
        if found.is_empty() && !spans.is_empty() {
            strange += message["rendered"].as_str().unwrap_or_default();
        }
        numbers.extend(found);
    }
    numbers.sort_unstable();
    numbers.dedup();
    match (numbers.is_empty(), strange.is_empty()) {
        (true, true) => Ok(None),
        (true, false) => Err(io::Error::other(strange)),
        (false, _) => Ok(Some(numbers)),
    }
}

/// A program of tests: its package's folder, its name, its path.
pub type Program = (String, String, String);

/// Compiles the tests and returns their programs.
///
/// # Errors
/// Cargo does not run.
pub fn compile(tree: &Path, build: &Path) -> io::Result<Vec<Program>> {
    let messages = cargo(tree, build, &["test", "--no-run"])?;
    let program = |message: &Value| {
        let path = message["executable"].as_str()?;
        let tests = message["profile"]["test"] == true;
        let package = Path::new(message["manifest_path"].as_str()?).parent()?;
        let name = message["target"]["name"].as_str()?;
        // The library and the tests beside it have one name in each package.
        let below = package.strip_prefix(tree).ok()?.to_str()?.to_owned();
        tests.then(|| (below, name.to_owned(), path.to_owned()))
    };
    Ok(messages.iter().filter_map(program).collect())
}
