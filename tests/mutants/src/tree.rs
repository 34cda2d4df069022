//! A copy of the repository that carries mutants.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use serde_json::Value;

use crate::Mutant;

/// The library and the program: what the mutants are in, and what is tested.
const PACKAGES: [&str; 4] = ["-p", "pliant", "-p", "pliant-cli"];

/// What is added to the library.
const SWITCH: &str = r#"
/// Whether this mutant runs. With a log it writes which mutants are reached.
#[doc(hidden)]
pub fn mutant(number: usize) -> bool {
    use std::io::Write as _;
    use std::sync::LazyLock;
    use std::sync::atomic::{AtomicBool, Ordering};
    static ASKED: LazyLock<Option<usize>> = LazyLock::new(|| std::env::var("PLIANT_MUTANT").ok()?.parse().ok());
    static LOG: LazyLock<Option<std::fs::File>> = LazyLock::new(|| {
        let path = std::env::var_os("PLIANT_MUTANT_LOG")?;
        std::fs::OpenOptions::new().create(true).append(true).open(path).ok()
    });
    static SEEN: [AtomicBool; 4096] = [const { AtomicBool::new(false) }; 4096];
    if let Some(mut log) = LOG.as_ref()
        && !SEEN[number].load(Ordering::Relaxed)
        && !SEEN[number].swap(true, Ordering::Relaxed)
    {
        let _ = log.write_all(format!("{number}\n").as_bytes());
    }
    *ASKED == Some(number)
}
"#;

pub struct Tree {
    original: PathBuf,
    /// The copy.
    pub root: PathBuf,
    target: PathBuf,
}

/// The files of the repository, relative to its root.
pub fn tracked(root: &Path) -> Result<Vec<String>, String> {
    let listed = Command::new("git")
        .current_dir(root)
        .args(["ls-files", "-z"])
        .output();
    let listed = listed.map_err(|e| format!("git: {e}"))?;
    let text = String::from_utf8_lossy(&listed.stdout);
    Ok(text
        .split('\0')
        .filter(|file| !file.is_empty())
        .map(str::to_owned)
        .collect())
}

/// Writes a file that has another content; one that stays keeps its time, and is not compiled again.
fn put(path: &Path, content: &[u8]) -> Result<(), String> {
    let failed = |e: std::io::Error| format!("{}: {e}", path.display());
    if fs::read(path).is_ok_and(|known| known == content) {
        return Ok(());
    }
    path.parent()
        .map_or(Ok(()), fs::create_dir_all)
        .map_err(failed)?;
    fs::write(path, content).map_err(failed)
}

impl Tree {
    pub fn new(original: &Path, folder: &Path) -> Result<Self, String> {
        let tree = Self {
            original: original.to_owned(),
            root: folder.join("tree"),
            target: folder.join("target"),
        };
        let files: BTreeSet<String> = tracked(original)?
            .into_iter()
            .filter(|f| original.join(f).is_file())
            .collect();
        for file in &files {
            // Sources are written with their mutants.
            if crate::folder(file).is_none() && file != "src/lib.rs" {
                let content = fs::read(original.join(file)).map_err(|e| format!("{file}: {e}"))?;
                put(&tree.root.join(file), &content)?;
            }
        }
        Ok(tree)
    }

    /// Where the copy keeps what it needs between two trials.
    pub fn folder(&self) -> &Path {
        self.target.parent().unwrap_or(&self.target)
    }

    /// Writes all sources with these mutants. Gives the bytes of each mutant in its file.
    fn write(&self, mutants: &[&Mutant]) -> Result<Vec<std::ops::Range<usize>>, String> {
        let mut places = vec![0..0; mutants.len()];
        let mut of_file: HashMap<&str, Vec<usize>> = HashMap::new();
        for (number, mutant) in mutants.iter().enumerate() {
            of_file.entry(&mutant.site.file).or_default().push(number);
        }
        for file in tracked(&self.original)? {
            if crate::folder(&file).is_none() && file != "src/lib.rs" {
                continue;
            }
            let text = fs::read_to_string(self.original.join(&file))
                .map_err(|e| format!("{file}: {e}"))?;
            let prefix = if file.starts_with("cli/") {
                "pliant"
            } else {
                "crate"
            };
            let mut numbers = of_file.remove(file.as_str()).unwrap_or_default();
            numbers.sort_by_key(|&number| mutants[number].site.range.start);
            let (mut new, mut done) = (String::new(), 0);
            for number in numbers {
                let site = &mutants[number].site;
                new.push_str(&text[done..site.range.start]);
                let begin = new.len();
                new.push_str(&site.switched(&text[site.range.clone()], number, prefix));
                (places[number], done) = (begin..new.len(), site.range.end);
            }
            new.push_str(&text[done..]);
            if file == "src/lib.rs" {
                new.push_str(SWITCH);
            }
            put(&self.root.join(&file), new.as_bytes())?;
        }
        Ok(places)
    }

    fn cargo(&self, arguments: &[&str]) -> Result<(bool, Vec<Value>), String> {
        let output = Command::new("cargo")
            .current_dir(&self.root)
            .args(arguments)
            .args(PACKAGES)
            .arg("--message-format=json")
            .env("CARGO_TARGET_DIR", &self.target)
            .env("RUSTFLAGS", "--cap-lints=allow")
            .env("CARGO_INCREMENTAL", "1")
            .stderr(Stdio::inherit())
            .output()
            .map_err(|e| format!("cargo: {e}"))?;
        let text = String::from_utf8_lossy(&output.stdout);
        let messages = text
            .lines()
            .filter_map(|line| serde_json::from_str(line).ok());
        Ok((output.status.success(), messages.collect()))
    }

    /// The first `count` mutants of each folder that compile.
    pub fn compilable(
        &self,
        drawn: BTreeMap<String, Vec<Mutant>>,
        count: usize,
    ) -> Result<Vec<Mutant>, String> {
        let ids: String = drawn
            .values()
            .flatten()
            .map(|mutant| format!("{}\n", mutant.id))
            .collect();
        let known = self
            .folder()
            .join(format!("compilable-{:016x}.txt", crate::hash(&ids)));
        let mut all: Vec<Mutant> = drawn.into_values().flatten().collect();
        if let Ok(text) = fs::read_to_string(&known) {
            let these: BTreeSet<&str> = text.lines().collect();
            all.retain(|mutant| these.contains(mutant.id.as_str()));
        } else {
            self.prune(&mut all)?;
            let text: String = all
                .iter()
                .map(|mutant| format!("{}\n", mutant.id))
                .collect();
            put(&known, text.as_bytes())?;
        }
        let mut taken: HashMap<String, usize> = HashMap::new();
        all.retain(|mutant| {
            let taken = taken.entry(mutant.folder.clone()).or_default();
            *taken += 1;
            *taken <= count
        });
        Ok(all)
    }

    /// Leaves out mutants that do not compile.
    fn prune(&self, all: &mut Vec<Mutant>) -> Result<(), String> {
        loop {
            let places = self.write(&all.iter().collect::<Vec<_>>())?;
            let (is_sound, messages) = self.cargo(&["check"])?;
            if is_sound {
                return Ok(());
            }
            let mut bad: BTreeSet<usize> = BTreeSet::new();
            for message in messages.iter().map(|m| &m["message"]) {
                if message["level"] != "error" {
                    continue;
                }
                let spans = message["spans"].as_array().map_or(&[][..], Vec::as_slice);
                let at = |span: &Value| {
                    let (file, byte) = (
                        span["file_name"].as_str()?,
                        span["byte_start"].as_u64()? as usize,
                    );
                    Some((file.to_owned(), byte))
                };
                let at: Vec<(String, usize)> = spans.iter().filter_map(at).collect();
                let hit = |number: &usize| {
                    let file = &all[*number].site.file;
                    at.iter()
                        .any(|(of, byte)| of == file && places[*number].contains(byte))
                };
                let mut found: Vec<usize> = (0..all.len()).filter(hit).collect();
                if found.is_empty() {
                    // The mistake shows elsewhere in the file.
                    let in_file =
                        |number: &usize| at.iter().any(|(of, _)| *of == all[*number].site.file);
                    found = (0..all.len()).filter(in_file).collect();
                    eprintln!(
                        "{} mutants left out for: {}",
                        found.len(),
                        message["message"]
                    );
                }
                bad.extend(found);
            }
            if bad.is_empty() {
                return Err("the copy does not compile, and no mutant is the cause".to_owned());
            }
            eprintln!("{} of {} mutants do not compile", bad.len(), all.len());
            let mut number = 0;
            all.retain(|_| {
                number += 1;
                !bad.contains(&(number - 1))
            });
        }
    }

    /// Builds the tests with these mutants. Gives the programs of tests, and the folders in which they run.
    pub fn build(&self, mutants: &[Mutant]) -> Result<Vec<(PathBuf, PathBuf)>, String> {
        self.write(&mutants.iter().collect::<Vec<_>>())?;
        let (is_sound, messages) = self.cargo(&["test", "--no-run"])?;
        if !is_sound {
            return Err("the tests do not compile".to_owned());
        }
        let program = |message: &Value| {
            let program = message["executable"]
                .as_str()
                .filter(|_| message["profile"]["test"] == true)?;
            let manifest = Path::new(message["manifest_path"].as_str()?);
            Some((PathBuf::from(program), manifest.parent()?.to_owned()))
        };
        Ok(messages.iter().filter_map(program).collect())
    }
}
