//! `pliant view`: a window with a running scene or a finished run.

use std::path::PathBuf;

use super::failure::Failure;
#[cfg(feature = "viewer")]
use pliant_viewer::{Pace, Recipe, Replay, Session, StartError, window};

/// The default scene.
#[cfg(feature = "viewer")]
const FIRST_SCENE: &str = "hip";

/// Open a window on a running scene, and control it: every number, bones, vertices, implants, nodes
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pliant view
  pliant view examples/right-hip.toml --set muscle.0.edge_length='6 mm'
  pliant view flat-implant
  pliant view examples/biceps.toml
  pliant view --replay pliant-out/hip

Mouse: left drag turns, Shift moves, Ctrl rolls, the wheel comes nearer; a click looks at a vertex, right drag pulls it. Keys:
Space runs and pauses, . steps, R resets, H shows the first view, C changes the colouring, P saves a picture, G records; F1 lists
all of them.

The window needs a build with the feature: cargo run --release --features viewer -- view. Exit code 1: there is no display, no
graphics card or driver, or this build has no window; 2: wrong usage or input.")]
pub(super) struct Arguments {
    /// A scene file, a muscle of frusta, or the name of a built-in scene [default: hip]
    #[arg(conflicts_with = "replay")]
    scene: Option<String>,
    #[arg(long, value_name = "KEY=VALUE", help = "Change the scene; may be given several times", long_help = super::options::set_help(), conflicts_with = "replay")]
    set: Vec<String>,
    /// Play the finished run in this folder: any frame, forwards and backwards
    #[arg(long, value_name = "DIR")]
    replay: Option<PathBuf>,
    /// Start paused
    #[arg(long)]
    paused: bool,
    #[command(flatten)]
    out: super::options::Out,
    /// Width and height of the window in pixels
    #[arg(long, value_name = "WxH", default_value = "1280x800", value_parser = size)]
    size: (u32, u32),
    /// Write the content of the window to this file, a line of JSON per picture; for tests
    #[arg(long, value_name = "FILE", hide = true)]
    trace: Option<PathBuf>,
    #[command(flatten)]
    threads: super::options::Threads,
}

/// Parses a width and a height.
fn size(text: &str) -> Result<(u32, u32), String> {
    let parts = text.split_once(['x', 'X']);
    let parsed = parts.and_then(|(w, h)| Some((w.trim().parse().ok()?, h.trim().parse().ok()?)));
    let fits = |side: &u32| (200..=16_384).contains(side);
    parsed
        .filter(|(w, h)| fits(w) && fits(h))
        .ok_or_else(|| "give width and height of 200 to 16384 pixels, such as 1280x800".to_owned())
}

/// Reports that this build has no window.
#[cfg(not(feature = "viewer"))]
pub(super) fn run(_: &Arguments) -> Result<u8, Failure> {
    super::warn(
        "error: this build has no window; build it with `cargo build --release --features viewer`, or use `pliant run`, \
         which writes pictures",
    );
    Ok(super::FAILED)
}

/// Calls `open` without printing the message of a panic. If there is no display, the error that
/// follows explains it.
#[cfg(feature = "viewer")]
fn quietly(open: &mut dyn FnMut()) {
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| {}));
    open();
    std::panic::set_hook(hook);
}

/// Opens the window. Returns when it is closed.
#[cfg(feature = "viewer")]
pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    arguments.threads.start();
    let pace = if arguments.paused {
        Pace::paused()
    } else {
        Pace::real_time()
    };
    let name = match &arguments.replay {
        Some(folder) => folder.display().to_string(),
        None => arguments
            .scene
            .clone()
            .unwrap_or_else(|| FIRST_SCENE.to_owned()),
    };
    let stem = std::path::Path::new(&name)
        .file_stem()
        .map_or_else(|| name.clone(), |s| s.to_string_lossy().into_owned());
    let options = window::Options {
        folder: arguments.out.folder(&stem, "pictures"),
        name: name.clone(),
        stem,
        size: arguments.size,
        replayed: arguments.replay.is_some(),
        trace: arguments.trace.clone(),
    };
    let shown = match &arguments.replay {
        Some(folder) => {
            let replay =
                Replay::open(folder).map_err(|error| Failure::Message(error.to_string()))?;
            window::show(
                move || Session::of(Box::new(replay), pace),
                &options,
                quietly,
            )
        }
        None => {
            let recipe =
                Recipe::find(&name, &arguments.set)?.with_variables(super::environment::variable);
            window::show(move || Session::start(recipe, pace), &options, quietly)
        }
    };
    match shown {
        Ok(said) => {
            said.into_iter().for_each(|said| super::warn(&said));
            Ok(super::DONE)
        }
        Err(window::WindowError::Start(StartError::Scene(error))) => Err(error.into()),
        Err(window::WindowError::Start(StartError::Load(error))) => Err(error.into()),
        Err(error) => {
            super::warn(&format!("error: {error}; {}", error.help()));
            Ok(super::FAILED)
        }
    }
}
