//! Options that commands share, and the end of every command that writes results.

use std::path::PathBuf;

use super::failure::Failure;
use super::{DONE, FAILED, interrupted, say, say_json, warn};
use crate::report::folder::Folder;
use crate::report::output::RunOutput;
use pliant::io::file_name;
use pliant::scene::SOLVERS;

/// The long help of `--set`.
pub(super) fn set_help() -> String {
    let solvers: Vec<&str> = SOLVERS.iter().map(|solver| solver.key).collect();
    format!("{SET_HELP}\nSolvers: {}.", solvers.join(", "))
}

const SET_HELP: &str = "\
Change the scene before it is checked: PATH=VALUE
  --set effects.contact.friction=0.3      a key by its path
  --set 'muscle.0.edge_length=3 mm'       an element of a list by number, name, or * for all
  --set implant.volume=100cc              the number may be left out where there is one element
  --set contact.friction=0.3              `effects.` and `solver.NAME.` may be left out
  --set effects.contact=off               remove a section, a key, or an element: muscle.psoas=off
  --set effects.stretch=on                add a section that needs no keys
  --set solver=NAME                       change the solver, with its default settings
Texts need no quotes. May be given several times; the last one wins.";

/// The output to the terminal.
#[derive(Clone, Copy, Debug, Default, clap::Args)]
pub(super) struct Printing {
    /// Write the summary as JSON to standard output, and no other text
    #[arg(long, global = true)]
    pub(super) json: bool,
    /// Write only errors and failed checks, and JSON with --json
    #[arg(long, global = true)]
    pub(super) quiet: bool,
    /// End with exit code 0 although a check failed; a note of the result says so
    #[arg(long, global = true)]
    lenient: bool,
}

impl Printing {
    /// Prints a text, unless standard output is for JSON or quiet.
    pub(super) fn say(&self, text: &str) {
        if !self.json && !self.quiet {
            say(text);
        }
    }

    /// Prints a result that has no folder, and returns the exit code.
    pub(super) fn finish(&self, mut output: RunOutput<'_>) -> u8 {
        let code = self.exit_code(&mut output);
        show_failures(&output);
        if self.json {
            say_json(&output.summary_without_folder());
        }
        self.say(&output.to_text());
        code
    }

    /// The exit code of a result. Leniency is noted in the result where it changes the code.
    fn exit_code(&self, output: &mut RunOutput<'_>) -> u8 {
        let run = output.scene.as_ref();
        let is_stopped = run.is_some_and(|run| run.stopped.is_some());
        let is_right = output.passed() && run.is_none_or(|run| run.converged);
        if !is_right && self.lenient {
            let note = "--lenient: failed checks do not change the exit code";
            output.notes.push(note.to_owned());
        }
        match (output.interrupted, is_stopped || !is_right && !self.lenient) {
            (true, _) => interrupted(),
            (false, true) => FAILED,
            (false, false) => DONE,
        }
    }
}

/// The threads of a computation.
#[derive(Clone, Copy, Debug, Default, clap::Args)]
pub(super) struct Threads {
    /// Number of threads [default: one per core]; the results do not depend on it
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

impl Threads {
    /// The number of threads.
    pub(super) fn count(self) -> usize {
        let cores = std::thread::available_parallelism().map_or(1, Into::into);
        self.threads.map_or(cores, usize::from)
    }

    /// Starts the threads.
    pub(super) fn start(self) {
        if let Some(threads) = self.threads {
            // Fails only if a pool exists already or the system provides no threads. Then the
            // default pool is used.
            let _ = rayon::ThreadPoolBuilder::new()
                .num_threads(threads.into())
                .build_global();
        }
    }
}

/// The folder of results.
#[derive(Clone, Debug, Default, clap::Args)]
pub(super) struct Out {
    /// Folder of the results [default: pliant-out/NAME, named after the job]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

impl Out {
    /// The folder: the given one, or `pliant-out/NAME-JOB`, without `-JOB` if `job` is empty.
    pub(super) fn folder(&self, name: &str, job: &str) -> PathBuf {
        let dash = if job.is_empty() { "" } else { "-" };
        let default =
            || PathBuf::from("pliant-out").join(format!("{}{dash}{job}", file_name(name)));
        self.out.clone().unwrap_or_else(default)
    }
}

/// The scene of a command that makes one.
#[derive(Clone, Copy, Debug, Default, clap::Args)]
pub(super) struct PrintScene {
    /// Print the scene of these options, which `pliant run` takes as a file, and stop
    #[arg(long)]
    print_scene: bool,
}

impl PrintScene {
    /// Prints the text of a scene if the option is given. Returns true if it is.
    pub(super) fn is_given(self, text: &str) -> bool {
        if self.print_scene {
            say(text);
        }
        self.print_scene
    }
}

/// Options of a command that writes a folder of results.
#[derive(Clone, Debug, Default, clap::Args)]
pub(super) struct Output {
    #[command(flatten)]
    out: Out,
    #[command(flatten)]
    pub(super) threads: Threads,
    #[command(flatten)]
    pub(super) printing: Printing,
}

impl Output {
    /// The folder of the results; see [`Out::folder`].
    pub(super) fn folder(&self, name: &str, job: &str) -> PathBuf {
        self.out.folder(name, job)
    }

    /// Writes a result into its folder, prints it, and returns the exit code.
    pub(super) fn finish(&self, folder: &Folder, mut output: RunOutput<'_>) -> Result<u8, Failure> {
        let code = self.printing.exit_code(&mut output);
        show_failures(&output);
        let shown = |name: &str| folder.path().join(name).display().to_string();
        let mut text = format!(
            "{}\nResults in {}\n  open {} in a browser\n",
            output.to_text(),
            folder.path().display(),
            shown("report.html")
        );
        let files = output.files.iter().map(|f| &f.name);
        let listed = |ending: &str| {
            let mut all = files.clone().chain(&output.written);
            all.find(|f| f.ends_with(ending))
        };
        // The one with names of blocks, if there is one.
        if let Some(series) = listed(".vtm.series").or_else(|| listed(".pvd")) {
            text += &format!("  open {} in ParaView\n", shown(series));
        }
        let summary = output.write(folder)?;
        if self.printing.json {
            say_json(&summary);
        }
        self.printing.say(&text);
        Ok(code)
    }
}

/// Prints the failed verdicts on standard error.
fn show_failures(output: &RunOutput<'_>) {
    for verdict in output.verdicts.iter().filter(|v| !v.passed) {
        warn(&format!("FAIL  {}", verdict.to_text()));
        if let Some(what) = &verdict.what_to_do {
            warn(&format!("      {what}"));
        }
    }
}
