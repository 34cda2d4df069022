//! The command `pliant`: one file per command.
//!
//! Exit codes: 0 done; 1 completed, but the result fails; 2 invalid usage or input; 130 after
//! Ctrl-C; 143 after SIGTERM.

mod accuracy;
mod areas;
mod audit;
mod biceps;
mod check;
mod contact;
mod convert;
mod data;
mod environment;
mod excerpt;
mod failure;
mod fibres;
mod fit;
mod from_meshes;
mod implant;
mod init;
mod morph;
mod moment_arms;
mod options;
mod osim;
mod plan;
mod progress;
mod register;
mod resume;
mod run;
mod scene_text;
mod scenes;
mod self_test;
mod sensitivities;
mod shell;
mod springs;
mod stress;
mod study;
mod unload;
mod view;

use std::ffi::OsString;
use std::io::{ErrorKind, Write};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};

use clap::{ArgMatches, CommandFactory, FromArgMatches, Parser, Subcommand};

/// Done.
const DONE: u8 = 0;
/// Completed, but the result fails.
const FAILED: u8 = 1;
/// Invalid usage or input.
const BAD_INPUT: u8 = 2;
/// Interrupted by Ctrl-C.
const BY_CTRL_C: u8 = 130;
/// Interrupted by SIGTERM: a machine shuts down, or the time of a job is over.
const BY_SIGTERM: u8 = 143;

/// The exit code of an interrupted command.
static INTERRUPTED: AtomicU8 = AtomicU8::new(BY_CTRL_C);

fn interrupted() -> u8 {
    INTERRUPTED.load(Ordering::Relaxed)
}

/// Verified deformation of soft tissue: muscles that slide around moving bones, with known accuracy
#[derive(Debug, Parser)]
#[command(
    name = "pliant",
    version,
    disable_help_subcommand = true,
    after_help = "\
Without a command: `pliant run hip`. Each command has an example in its --help.

Exit codes: 0 done; 1 ran, but the result fails; 2 bad usage or input; 130 after Ctrl-C; 143 after SIGTERM.

Example:
  pliant run hip
  pliant run examples/right-hip.toml --out results --set 'effects.contact.thickness=1 mm'"
)]
struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Run a scene and write frames, measures, a summary and a report
    Run(Box<run::Arguments>),
    /// Write a scene of muscles and bones from their meshes, and try its first frames
    Init(Box<init::Arguments>),
    /// Write a scene from a model of OpenSim and a folder of muscle meshes
    Osim(Box<osim::Arguments>),
    /// Write files to begin with, or show where measured meshes are
    Data(data::Arguments),
    /// Open a window on a running scene, and control it
    View(view::Arguments),
    /// Prepare a scene as a run does, and show its attachments, its overlaps and which effects it runs
    Plan(plan::Arguments),
    /// Measure the cost of accuracy in a scene: errors and times of many solvers and settings
    /// against a reference
    Accuracy(accuracy::Arguments),
    /// Run all combinations of lists of values over a scene, and compare them in one table and on
    /// one sheet of pictures
    Study(study::Arguments),
    /// Strain a scene with parameters drawn at random, and report what must not happen
    Stress(stress::Arguments),
    /// Compute the intervals of a result from those of the scene's values
    Sensitivities(sensitivities::Arguments),
    /// Find values of a scene with which its result has a measured shape
    Fit(Box<fit::Arguments>),
    Unload(unload::Arguments),
    /// Run a mass-spring system to rest: one from a file, or a lattice
    Springs(Box<springs::Arguments>),
    /// Change the length of a muscle of frusta that keeps its volume
    Biceps(biceps::Arguments),
    /// Fill a muscle with fibres from its origin to its insertion
    Fibres(Box<fibres::Arguments>),
    /// Compute lengths and moment arms of a muscle's fibres during the rotation of a joint
    MomentArms(moment_arms::Arguments),
    /// List the built-in scenes, show one, or explain the keys of a scene
    Scenes(scenes::Arguments),
    /// Show the defects of meshes and whether a simulation accepts them, and repair them
    Check(check::Arguments),
    /// Count crossings, vertices inside and changes of volume in written frames, of this or another
    /// program
    Audit(audit::Arguments),
    /// Compare the responses to vertices inside bones, and the methods that find them, on a scene
    Contact(contact::Arguments),
    /// Write a mesh in another format or unit
    Convert(convert::Arguments),
    /// Blend two closed surfaces: their correspondence, intermediate shapes and intermediate point
    /// data
    Morph(morph::Arguments),
    /// Register one surface to another: rigid, with scaling, or bent
    Register(register::Arguments),
    /// Simulate skin over implants: areas before, deformed, retracted and grown; the volume for a
    /// target area
    Implant(Box<implant::Arguments>),
    /// Test this installation, and show what the machine can do
    SelfTest(self_test::Arguments),
    /// Print a script with which a shell completes the names of commands and options
    Completions(shell::Completions),
    /// Write a man page for each command into a folder
    Man(shell::Man),
}

/// Runs the command line of the process. Returns its exit code.
pub fn main() -> ExitCode {
    ExitCode::from(main_with(std::env::args_os()))
}

/// Runs a command line, which begins with the name of the program. Returns the exit code.
pub fn main_with(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    let arguments: Vec<OsString> = arguments.into_iter().collect();
    crate::report::provenance::begin(&arguments);
    let given = Arguments::command().try_get_matches_from(arguments);
    let parsed = given.and_then(|given| {
        QUIET.store(is_quiet(&given), Ordering::Relaxed);
        Arguments::from_arg_matches(&given)
    });
    let arguments = match parsed {
        Ok(arguments) => arguments,
        Err(error) => {
            if error.use_stderr() {
                // If the output is closed, nobody can read an error.
                let _ = error.print();
                return BAD_INPUT;
            }
            note_loss(error.print());
            return unless_lost(DONE);
        }
    };
    let done = match arguments.command {
        None => run::run(&run::Arguments::default()),
        Some(Command::Run(arguments)) => run::run(&arguments),
        Some(Command::Init(arguments)) => init::run(&arguments),
        Some(Command::Osim(arguments)) => osim::run(&arguments),
        Some(Command::Data(arguments)) => data::run(&arguments),
        Some(Command::View(arguments)) => view::run(&arguments),
        Some(Command::Plan(arguments)) => plan::run(&arguments),
        Some(Command::Accuracy(arguments)) => accuracy::run(&arguments),
        Some(Command::Study(arguments)) => study::run(&arguments),
        Some(Command::Stress(arguments)) => stress::run(&arguments),
        Some(Command::Sensitivities(arguments)) => sensitivities::run(&arguments),
        Some(Command::Fit(arguments)) => fit::run(&arguments),
        Some(Command::Unload(arguments)) => unload::run(&arguments),
        Some(Command::Springs(arguments)) => springs::run(&arguments),
        Some(Command::Biceps(arguments)) => biceps::run(&arguments),
        Some(Command::Fibres(arguments)) => fibres::run(&arguments),
        Some(Command::MomentArms(arguments)) => moment_arms::run(&arguments),
        Some(Command::Scenes(arguments)) => scenes::run(&arguments),
        Some(Command::Check(arguments)) => check::run(&arguments),
        Some(Command::Audit(arguments)) => audit::run(&arguments),
        Some(Command::Contact(arguments)) => contact::run(&arguments),
        Some(Command::Convert(arguments)) => convert::run(&arguments),
        Some(Command::Implant(arguments)) => implant::run(&arguments),
        Some(Command::Morph(arguments)) => morph::run(&arguments),
        Some(Command::Register(arguments)) => register::run(&arguments),
        Some(Command::SelfTest(arguments)) => self_test::run(&arguments),
        Some(Command::Completions(arguments)) => Ok(shell::completions(&arguments)),
        Some(Command::Man(arguments)) => shell::man(&arguments),
    };
    let code = match done {
        Ok(code) => code,
        Err(failure) => {
            failure.show();
            failure.code()
        }
    };
    unless_lost(code)
}

/// The exit code, or a failure where standard output did not take what was printed.
fn unless_lost(code: u8) -> u8 {
    if code == DONE && LOST.load(Ordering::Relaxed) {
        return FAILED;
    }
    code
}

/// Whether a text was lost because standard output could not be written to.
static LOST: AtomicBool = AtomicBool::new(false);

/// Whether only errors and failed checks are written.
static QUIET: AtomicBool = AtomicBool::new(false);

/// Whether the command has the option --quiet. A command without results has no such option.
fn is_quiet(given: &ArgMatches) -> bool {
    let Some((_, of_command)) = given.subcommand() else {
        return false;
    };
    matches!(of_command.try_get_one::<bool>("quiet"), Ok(Some(true)))
}

/// Whether notes and progress are hidden.
fn quiet() -> bool {
    QUIET.load(Ordering::Relaxed)
}

/// Writes to standard output; a closed pipe (`| head`) is no error.
fn say(text: &str) {
    let mut out = std::io::stdout().lock();
    note_loss(out.write_all(text.as_bytes()).and_then(|()| out.flush()));
}

/// Reports the first text that standard output did not take.
fn note_loss(printed: std::io::Result<()>) {
    let lost = printed
        .err()
        .filter(|error| error.kind() != ErrorKind::BrokenPipe);
    if let Some(error) = lost
        && !LOST.swap(true, Ordering::Relaxed)
    {
        warn(&format!(
            "error: standard output cannot be written to ({error}); write it elsewhere"
        ));
    }
}

/// Writes a line to standard error, if possible.
fn warn(text: &str) {
    let _ = writeln!(std::io::stderr(), "{text}");
}

/// Writes a note or the progress to standard error, unless the command is quiet.
fn note(text: &str) {
    if !quiet() {
        warn(text);
    }
}

/// Prints a result as JSON on standard output.
fn say_json(value: &impl serde::Serialize) {
    say(&crate::report::output::json_text(value));
}

/// The length of a unit [m].
fn length_unit(name: &str) -> Result<f64, failure::Failure> {
    use pliant::scene::units::{Dimension, scale};
    scale(name, Dimension::Length).map_err(|_| {
        let known = Dimension::Length.known();
        failure::Failure::usage(
            format!("`{name}` is no unit of length"),
            format!("known units: {known}"),
        )
    })
}
