//! Where a result comes from: command, version, date, machine.

use std::ffi::OsString;
use std::sync::Mutex;

use serde::Serialize;

use super::Table;

/// The arguments of the command that runs, without the name of the program. A program such as Python has others of its own.
static ARGUMENTS: Mutex<Vec<OsString>> = Mutex::new(Vec::new());

/// Sets the arguments of the command that runs.
pub fn begin(arguments: &[OsString]) {
    if let Ok(mut all) = ARGUMENTS.lock() {
        *all = arguments.get(1..).unwrap_or_default().to_vec();
    }
}

/// Origin of a result.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Provenance {
    /// The command line as a shell reads it.
    pub command: String,
    /// Version of the program.
    pub version: &'static str,
    /// Digest of the library's sources ([`pliant::DIGEST`]): equal digests give equal bits.
    pub library: &'static str,
    /// End of the command in universal time.
    pub date: String,
    /// Operating system and architecture.
    pub system: String,
    /// Name of the processor; `None` where the system does not report it.
    pub processor: Option<String>,
    /// Number of cores.
    pub cores: usize,
    /// Number of threads of the computation.
    pub threads: usize,
}

impl Provenance {
    /// That of this process, now.
    pub fn now() -> Self {
        let arguments = ARGUMENTS.lock().map(|all| all.clone()).unwrap_or_default();
        let words = arguments.iter().map(|word| quoted(&word.to_string_lossy()));
        let command = std::iter::once("pliant".to_owned()).chain(words);
        let date = humantime::format_rfc3339_seconds(std::time::SystemTime::now());
        let (system, architecture) = (std::env::consts::OS, std::env::consts::ARCH);
        Self {
            command: command.collect::<Vec<_>>().join(" "),
            version: env!("CARGO_PKG_VERSION"),
            library: pliant::DIGEST,
            date: date.to_string(),
            system: format!("{system}, {architecture}"),
            processor: processor(),
            cores: std::thread::available_parallelism().map_or(1, Into::into),
            threads: rayon::current_num_threads(),
        }
    }

    /// The origin as a table.
    pub fn table(&self) -> Table {
        let mut table = Table::new("Provenance", ["what", "value"]);
        let cores = match &self.processor {
            Some(name) => format!("{name}, {} cores", self.cores),
            None => format!("{} cores", self.cores),
        };
        for (what, value) in [
            ("command", self.command.clone()),
            ("pliant", self.version.to_owned()),
            ("digest of the library", self.library.to_owned()),
            ("date", self.date.clone()),
            ("system", self.system.clone()),
            ("processor", cores),
            ("threads", self.threads.to_string()),
        ] {
            table.row([what.to_owned(), value]);
        }
        table
    }
}

/// A word as a shell reads it: in single quotes if it has more than letters, numbers and plain signs.
pub fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "-_./=,:+@%".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        return word.to_owned();
    }
    format!("'{}'", word.replace('\'', r"'\''"))
}

/// Name of the processor on Linux.
pub fn processor() -> Option<String> {
    let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = text.lines().find(|line| line.starts_with("model name"))?;
    line.split_once(':').map(|(_, name)| name.trim().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shell_reads_the_command_back() {
        assert_eq!(quoted("hip"), "hip");
        assert_eq!(quoted("--set"), "--set");
        assert_eq!(quoted("a=1 mm"), "'a=1 mm'");
        assert_eq!(quoted("it's"), r"'it'\''s'");
        assert_eq!(quoted(""), "''");
        assert_eq!(quoted("$HOME;rm"), "'$HOME;rm'");
    }

    #[test]
    fn the_date_is_a_time_in_utc() {
        begin(&["pliant", "run", "a b"].map(OsString::from));
        let now = Provenance::now();
        assert_eq!(now.command, "pliant run 'a b'");
        assert_eq!(now.date.len(), "2026-01-31T12:00:00Z".len(), "{}", now.date);
        assert!(now.date.ends_with('Z') && now.date.as_str() > "2026");
        assert_eq!(now.table().rows.len(), 7);
        assert!(now.threads >= 1 && now.cores >= 1);
    }
}
