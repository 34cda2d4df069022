//! `pliant self-test`: what this machine can do, and whether the program computes on it what it should.

use std::time::Instant;

use rayon::ThreadPoolBuilder;
use serde_json::{Value, json};

use super::failure::Failure;
use super::options::Printing;
use crate::report::Table;
use crate::report::output::{RunOutput, Verdict, verdict_table};
use crate::report::provenance::{Provenance, processor};
use pliant::format::number;
use pliant::progress::Silent;
use pliant::scene::builtin::{BUILTIN, load_content};
use pliant::simulation::{Ended, FrameState, run as run_scene, scenario_with};
use pliant::state::Hash;

/// Test this installation: the built-in scenes for a frame or two, the same bits on one thread and on all
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pliant self-test
  pliant self-test --json > machine.json

It takes less than a minute and writes no files. It reports lanes, threads, graphics card and display. Exit code 1: a scene
does not run, its numbers are not finite, or the number of threads changes its bits.")]
pub(super) struct Arguments {
    #[command(flatten)]
    printing: Printing,
}

/// Frames of a scene.
const FRAMES: usize = 2;

/// A scene after its frames.
struct Tried {
    /// The last positions, or the reason why there are none.
    end: Result<FrameState, String>,
    seconds: f64,
}

pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let begun = Instant::now();
    let cores = std::thread::available_parallelism().map_or(1, Into::into);
    let mut table = Table::new(
        "Built-in scenes, two frames",
        [
            "scene",
            "one thread [s]",
            "all threads [s]",
            "digest of the positions",
        ],
    );
    let (mut verdicts, mut scenes) = (Vec::new(), Vec::new());
    for (name, ..) in BUILTIN {
        // On one core two threads still share the work in another order.
        let [one, all] = [1, cores.max(2)].map(|threads| with_threads(name, threads));
        let digests = [&one, &all].map(|tried| tried.end.as_ref().ok().map(digest));
        let runs = match (&one.end, &all.end) {
            (Err(why), _) | (_, Err(why)) => {
                Verdict::new("runs", false).else_do(format!("{why}; report it with this output"))
            }
            (Ok(end), _) => Verdict::new("runs, all numbers are finite", is_finite(end)),
        };
        verdicts.push(runs.at(*name));
        let same = Verdict::new(
            "same bits on one thread and on all",
            digests[0].is_some() && digests[0] == digests[1],
        );
        verdicts.push(same.at(*name).else_do("report it with this output"));
        let shown = digests[0].map_or("–".to_owned(), |digest| format!("{digest:032x}"));
        table.row([
            (*name).to_owned(),
            number(one.seconds),
            number(all.seconds),
            shown.clone(),
        ]);
        scenes.push(json!({
            "scene": name,
            "one_thread_s": one.seconds,
            "all_threads_s": all.seconds,
            "digest": digests[0].map(|_| shown),
        }));
    }
    let (gpu, gpu_verdict) = graphics_card();
    verdicts.extend(gpu_verdict);
    let origin = Provenance::now();
    let lanes = pliant::lanes();
    let what: Vec<(&str, String)> = vec![
        (
            "pliant",
            format!("{}, library {}", origin.version, origin.library),
        ),
        ("system", origin.system.clone()),
        (
            "processor",
            processor().unwrap_or_else(|| "unknown".to_owned()),
        ),
        ("cores", cores.to_string()),
        (
            "lanes",
            format!("{lanes} numbers of 64 bits in one instruction"),
        ),
        ("graphics card", gpu.clone()),
        ("display", display()),
    ];
    let mut machine = Table::new("This machine", ["what", "value"]);
    for (name, value) in &what {
        machine.row([(*name).to_owned(), value.clone()]);
    }
    let time_s = begun.elapsed().as_secs_f64();
    let output = RunOutput {
        kind: "self_test",
        name: "self-test".to_owned(),
        measures: json!({
            "cores": cores,
            "lanes": lanes,
            "processor": processor(),
            "graphics_card": gpu,
            "display": display(),
            "library": origin.library,
            "scenes": Value::from(scenes),
        }),
        text: format!("{}\n", verdict_table(&verdicts).to_text()),
        verdicts,
        tables_of_text: 2,
        tables: vec![machine, table],
        time_s,
        ..RunOutput::default()
    };
    Ok(arguments.printing.finish(output))
}

/// Runs a scene on a number of threads.
fn with_threads(name: &str, threads: usize) -> Tried {
    let begun = Instant::now();
    let pool = ThreadPoolBuilder::new().num_threads(threads).build();
    let end = match pool {
        Ok(pool) => pool.install(|| frames(name)),
        Err(error) => Err(format!("the system provides no {threads} threads: {error}")),
    };
    Tried {
        end,
        seconds: begun.elapsed().as_secs_f64(),
    }
}

/// Runs the first frames of a scene.
fn frames(name: &str) -> Result<FrameState, String> {
    let whole = load_content(name, &[]).map_err(|error| error.terse())?;
    let fewer = format!("frames={}", FRAMES.min(whole.frames()));
    // A scene whose frames are its schedule has no such key, and runs as a whole.
    let content = load_content(name, &[fewer]).unwrap_or(whole);
    let mut scenario = scenario_with(&content, &Silent).map_err(|error| error.terse())?;
    match run_scene(scenario.as_mut(), &mut [], &Silent) {
        Ended::Failed(why) => Err(why),
        Ended::Finished | Ended::Interrupted | Ended::ByObserver => Ok(scenario.state()),
    }
}

fn is_finite(state: &FrameState) -> bool {
    let points = state.bodies.iter().flat_map(|(x, _)| x);
    points
        .into_iter()
        .all(|p| p.coords.iter().all(|c| c.is_finite()))
}

/// A hash of the bits of all positions.
fn digest(state: &FrameState) -> u128 {
    let mut hash = Hash::default();
    for p in state.bodies.iter().flat_map(|(x, _)| x) {
        p.iter().for_each(|c| hash.add(&c.to_bits().to_le_bytes()));
    }
    hash.value()
}

/// The graphics card, and whether a lattice runs on it.
#[cfg(feature = "gpu")]
fn graphics_card() -> (String, Option<Verdict>) {
    use std::process::{Command, Stdio};

    // In a process of its own: a driver may end the process.
    let lattice = [
        "springs",
        "--lattice",
        "8x8x8",
        "--device",
        "gpu",
        "--precision",
        "f32",
        "--json",
    ];
    let folder = std::env::temp_dir().join(format!("pliant-self-test-{}", std::process::id()));
    let done = std::env::current_exe().and_then(|program| {
        Command::new(program)
            .args(lattice)
            .arg("--out")
            .arg(&folder)
            .stderr(Stdio::piped())
            .output()
    });
    let _ = std::fs::remove_dir_all(&folder);
    let output = match done {
        Ok(output) => output,
        Err(error) => return (format!("not tried: {error}"), None),
    };
    let summary: Value = serde_json::from_slice(&output.stdout).unwrap_or_default();
    let said = String::from_utf8_lossy(&output.stderr);
    match summary["springs"]["card"].as_str() {
        Some(name) => (
            name.to_owned(),
            Some(Verdict::new(
                "a lattice comes to rest on the graphics card",
                output.status.success(),
            )),
        ),
        None => (said.lines().next().unwrap_or("none").to_owned(), None),
    }
}

/// The graphics card of a program without one.
#[cfg(not(feature = "gpu"))]
fn graphics_card() -> (String, Option<Verdict>) {
    (
        "not used: this program is built without the feature gpu".to_owned(),
        None,
    )
}

/// Whether a window can open.
fn display() -> String {
    if !cfg!(feature = "viewer") {
        return "not used: this program is built without the feature viewer".to_owned();
    }
    let is_set = |name: &str| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    match cfg!(all(unix, not(target_os = "macos"))) {
        true if is_set("WAYLAND_DISPLAY") => "Wayland".to_owned(),
        true if is_set("DISPLAY") => "X11".to_owned(),
        true => "none: DISPLAY and WAYLAND_DISPLAY are not set".to_owned(),
        false => "that of the system".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;

    fn state(x: f64) -> FrameState {
        FrameState {
            frame: 0,
            time: 0.0,
            bodies: vec![(vec![Point3::new(1.0, x, 3.0)], Vec::new())],
            bones: Vec::new(),
        }
    }

    #[test]
    fn a_changed_bit_and_a_number_that_is_not_finite_are_seen() {
        assert_eq!(digest(&state(2.0)), digest(&state(2.0)));
        assert_ne!(digest(&state(2.0)), digest(&state(2.0f64.next_up())));
        assert!(is_finite(&state(2.0)));
        assert!(!is_finite(&state(f64::NAN)) && !is_finite(&state(f64::INFINITY)));
    }

    #[test]
    fn a_scene_that_does_not_exist_has_no_positions() {
        assert!(with_threads("no such scene", 1).end.is_err());
    }
}
