//! Which tests reach a mistake, and whether one of them fails.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Write as _;
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};
use std::{fs, io, thread};

use crate::draw::Mutant;
use crate::tree::Program;

/// Tests read the sources themselves in these programs, and would find the copy in disorder.
const OF_TEXT: [&str; 3] = ["house", "docs", "window"];
/// Time of the tests that judge one mistake [s].
const BUDGET: f64 = 90.0;

/// Some tests of one program, which run together.
#[derive(Clone, Debug)]
pub struct Unit {
    /// Program and module, such as `pliant contact::meeting`.
    pub name: String,
    program: PathBuf,
    folder: PathBuf,
    tests: Vec<String>,
    /// How long they take without a mistake [s].
    pub seconds: f64,
    /// The mistakes that they reach.
    reached: BTreeSet<u32>,
}

/// How the tests judge a mistake.
#[derive(Clone, Debug, PartialEq)]
pub enum Verdict {
    /// Some test fails or does not end, in this unit.
    Killed(String),
    /// All of these many units pass.
    Survived(usize),
    /// No test reaches it.
    Unreached,
}

impl Verdict {
    pub fn to_text(&self) -> String {
        match self {
            Self::Killed(by) => format!("killed\t{by}"),
            Self::Survived(units) => format!("survived\t{units} units"),
            Self::Unreached => "unreached\t".to_owned(),
        }
    }

    pub fn of_text(text: &str) -> Option<Self> {
        let (kind, by) = text.split_once('\t')?;
        Some(match kind {
            "killed" => Self::Killed(by.to_owned()),
            "survived" => Self::Survived(by.split(' ').next()?.parse().ok()?),
            "unreached" => Self::Unreached,
            _ => return None,
        })
    }
}

/// The module of a test: two parts of its path in a library, one in other programs.
fn module(program: &str, test: &str) -> String {
    let parts: Vec<&str> = test.split("::").collect();
    let depth = if program.contains("pliant") { 2 } else { 1 };
    parts[..parts.len().saturating_sub(1).min(depth)].join("::")
}

/// The units of all programs, which have not run yet.
///
/// # Errors
/// A program that does not list its tests.
pub fn units(tree: &Path, programs: &[Program]) -> io::Result<Vec<Unit>> {
    let mut units = Vec::new();
    for (package, name, path) in programs {
        if OF_TEXT.contains(&name.as_str()) {
            continue;
        }
        let listed = Command::new(path).args(["--list", "--format", "terse"]).output()?;
        let text = String::from_utf8_lossy(&listed.stdout).into_owned();
        let mut modules: BTreeMap<String, Vec<String>> = BTreeMap::new();
        for test in text.lines().filter_map(|line| line.strip_suffix(": test")) {
            modules.entry(module(name, test)).or_default().push(test.to_owned());
        }
        units.extend(modules.into_iter().map(|(module, tests)| Unit {
            name: format!("{package}:{name} {module}"),
            program: path.into(),
            folder: tree.join(package),
            tests,
            seconds: 0.0,
            reached: BTreeSet::new(),
        }));
    }
    Ok(units)
}

/// Whether all tests passed; `None` after a time without an end.
fn passes(unit: &Unit, variable: (&str, &str), limit: f64) -> io::Result<Option<bool>> {
    let mut child = Command::new(&unit.program)
        .arg("--exact")
        .args(&unit.tests)
        .current_dir(&unit.folder)
        .env(variable.0, variable.1)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .process_group(0)
        .spawn()?;
    let begun = Instant::now();
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(Some(status.success()));
        }
        if begun.elapsed().as_secs_f64() > limit {
            // The programs that tests have started end with them.
            let group = format!("-{}", child.id());
            Command::new("kill").args(["-KILL", "--", &group]).status()?;
            child.wait()?;
            return Ok(None);
        }
        thread::sleep(Duration::from_millis(20));
    }
}

/// Runs every unit without a mistake, and finds what it reaches and how long it takes. What is known
/// in `store` is not run again. Units that fail are left out.
///
/// # Errors
/// A file that cannot be read or written.
pub fn reach(units: Vec<Unit>, store: &Path, ends: Instant) -> io::Result<Option<Vec<Unit>>> {
    let log = store.with_extension("log");
    let known = fs::read_to_string(store).unwrap_or_default();
    let mut file = fs::OpenOptions::new().create(true).append(true).open(store)?;
    let mut all = Vec::new();
    for mut unit in units {
        let known = known.lines().find_map(|line| line.strip_prefix(&format!("{}\t", unit.name)));
        let line = match known {
            Some(line) => line.to_owned(),
            None if Instant::now() > ends => return Ok(None),
            None => {
                fs::write(&log, "")?;
                let begun = Instant::now();
                let path = log.to_string_lossy().into_owned();
                let passed = passes(&unit, ("PLIANT_MUTANT_LOG", &path), 600.0)?;
                let seconds = begun.elapsed().as_secs_f64();
                let reached = fs::read_to_string(&log)?.lines().collect::<BTreeSet<_>>().into_iter().collect::<Vec<_>>().join(" ");
                let line = format!("{}\t{seconds:.2}\t{reached}", passed == Some(true));
                writeln!(file, "{}\t{line}", unit.name)?;
                line
            }
        };
        let mut parts = line.split('\t');
        let passed = parts.next() == Some("true");
        unit.seconds = parts.next().and_then(|s| s.parse().ok()).unwrap_or(0.0);
        unit.reached = parts.next().unwrap_or("").split(' ').filter_map(|n| n.parse().ok()).collect();
        if passed {
            all.push(unit);
        } else {
            eprintln!("left out, since it fails without a mistake: {}", unit.name);
        }
    }
    Ok(Some(all))
}

/// Judges a mistake by the tests of its folder, then by the others, the shortest first.
///
/// # Errors
/// A program that does not start.
pub fn judge(mutant: &Mutant, units: &[Unit]) -> io::Result<Verdict> {
    let of_folder = |unit: &Unit| {
        let folder = mutant.folder.trim_start_matches("cli/");
        unit.name.contains(&format!(" {folder}"))
    };
    let mut reaching: Vec<&Unit> = units.iter().filter(|u| u.reached.contains(&mutant.id)).collect();
    reaching.sort_by(|a, b| (!of_folder(a), a.seconds).partial_cmp(&(!of_folder(b), b.seconds)).expect("times"));
    if reaching.is_empty() {
        return Ok(Verdict::Unreached);
    }
    let (mut spent, mut ran) = (0.0, 0);
    for unit in reaching {
        if ran > 0 && spent + unit.seconds > BUDGET {
            continue;
        }
        (spent, ran) = (spent + unit.seconds, ran + 1);
        let number = mutant.id.to_string();
        if passes(unit, ("PLIANT_MUTANT", &number), 3.0 * unit.seconds + 20.0)? != Some(true) {
            return Ok(Verdict::Killed(unit.name.clone()));
        }
    }
    Ok(Verdict::Survived(ran))
}
