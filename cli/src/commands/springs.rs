//! `pliant springs`: simulation of a mass-spring system to rest.

mod built;
mod nearing;
mod pictures;
mod run;
mod written;

use std::path::PathBuf;
use std::time::Instant;

use serde::Serialize;

use super::failure::Failure;
use super::note;
use super::options::Output;
use super::progress::{Bar, if_raised};
use super::run::stop_on_interrupt;
use crate::report::folder::Folder;
use crate::report::output::Verdict;
use built::Built;
use nearing::Nearing;
use pliant::format::number;
use pliant::springs::integrators::{Adaptive, INTEGRATORS, Integrator, Verlet, by_name};
use pliant::springs::{
    Mode, Neighbours, RestEnd, RestSettings, Settled, Stiffest, limit, stiffest,
};
use run::{Advance, SpringsRun, Watch};
use written::Record;

/// Default greatest number of steps; and the number without damping, which only shows oscillations.
const STEPS: u32 = 10_000;
const UNDAMPED_STEPS: u32 = 1000;

/// The reason why there is no rest without damping.
const NEVER: &str =
    "without damping it never comes to rest: give --damping, or leave it out for the estimate";

/// Run a mass-spring system to rest: one from a file, or a lattice
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pliant springs examples/lattice-5x5x5.springs
  pliant springs examples/lattice-5x5x5.springs --mass 8 --damping 9 --dt 0.01 --every 50
  pliant springs --lattice 10x10x10 --neighbours 26
  pliant springs --lattice 5x5x5 --integrator implicit --dt 0.5 --json > rest.json

A file holds points, surface triangles, springs with stiffness, fibres and attachment areas as text; docs/springs.md has the
format. Its springs are at rest as loaded, so the system is disturbed first: points of the surface are moved towards the
centre by --shrink and held there, the others follow. A lattice has stiffness 1/L [N/m] for springs of length L [m]. The
damping is, if not given, the thesis's estimate; the step half of the longest stable one, which is computed before the first
step: a longer one is refused. Numbers of files have no units and are read as m, kg, s.

Results in pliant-out/NAME-springs: start.vtp, end.vtp and pictures of them (with --every frames/*.vtp and NAME.pvd),
measures.csv, summary.json, report.html. Exit codes: 0 at rest; 1 not at rest within the steps, or a step failed; 2 bad usage or input;
130 after Ctrl-C.")]
pub(super) struct Arguments {
    /// A file of a spring system
    #[arg(conflicts_with = "lattice")]
    file: Option<PathBuf>,
    /// A lattice of points instead of a file, such as 50x50x50
    #[arg(long, value_name = "NxNxN", value_parser = built::sides)]
    lattice: Option<[usize; 3]>,
    /// Number of neighbours of each point of a lattice: 6 or 26 [default: 6]
    #[arg(long, value_name = "N", requires = "lattice", conflicts_with = "file", value_parser = neighbours)]
    neighbours: Option<Neighbours>,
    /// Longest side of a lattice [m] [default: 1]
    #[arg(long, value_name = "LENGTH", requires = "lattice", conflicts_with = "file", allow_negative_numbers = true, value_parser = positive)]
    side: Option<f64>,
    /// Mass of each point [kg]
    #[arg(long, value_name = "M", default_value = "1", allow_negative_numbers = true, value_parser = positive)]
    mass: f64,
    /// Damping of each point: force over velocity [N s/m] [default: the estimate (7.2)]
    #[arg(long, value_name = "C", allow_negative_numbers = true, value_parser = not_negative)]
    damping: Option<f64>,
    /// Time step [s] [default: half of the longest stable one]
    #[arg(long, value_name = "DT", allow_negative_numbers = true, value_parser = positive)]
    dt: Option<f64>,
    /// Integrator
    #[arg(long, value_name = "NAME", default_value = "verlet", value_parser = INTEGRATORS)]
    integrator: String,
    /// Adaptive time step: it grows while it is stable; an unstable step is repeated with half the
    /// length
    #[arg(long)]
    adaptive: bool,
    /// Fixed points: those of the surface, or none
    #[arg(long, value_name = "WHICH", default_value = "surface", value_parser = ["surface", "none"])]
    pin: String,
    /// Displacement of the surface at the start, as a share of the distance to the centre
    #[arg(long, value_name = "SHARE", default_value = "0.02", allow_negative_numbers = true, value_parser = share)]
    shrink: f64,
    /// Tolerance of rest: largest force relative to the force at a strain of one; motion must be
    /// equally small
    #[arg(long, value_name = "SHARE", default_value = "1e-6", allow_negative_numbers = true, value_parser = tolerance)]
    tolerance: f64,
    /// Greatest number of steps [default: 10000; 1000 without damping]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    steps: Option<u32>,
    /// Also write a frame every N steps
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    every: Option<u32>,
    #[command(flatten)]
    output: Output,
}

fn neighbours(text: &str) -> Result<Neighbours, String> {
    match text {
        "6" => Ok(Neighbours::Six),
        "26" => Ok(Neighbours::TwentySix),
        _ => Err("a point has 6 or 26 neighbours".to_owned()),
    }
}

fn parsed(text: &str, fits: impl Fn(f64) -> bool, wanted: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|n: &f64| n.is_finite() && fits(*n))
        .ok_or_else(|| format!("expected {wanted}"))
}

fn positive(text: &str) -> Result<f64, String> {
    parsed(text, |n| n > 0.0, "a positive number")
}

fn not_negative(text: &str) -> Result<f64, String> {
    parsed(text, |n| n >= 0.0, "a number of at least 0")
}

fn share(text: &str) -> Result<f64, String> {
    parsed(
        text,
        |n| (-1.0..1.0).contains(&n),
        "a share from -1 to less than 1, such as 0.02",
    )
}

fn tolerance(text: &str) -> Result<f64, String> {
    parsed(
        text,
        |n| n > 0.0 && n < 1.0,
        "a share between 0 and 1, such as 1e-6",
    )
}

/// Results of a run.
#[derive(Default, Serialize)]
struct Summary {
    points: usize,
    points_held: usize,
    springs: usize,
    neighbours: u32,
    integrator: String,
    adaptive: bool,
    mass_kg: f64,
    damping_ns_m: f64,
    damping_estimate_ns_m: Option<f64>,
    dt_s: f64,
    stability_limit_s: Option<f64>,
    stability_limit_of_row_sums_s: Option<f64>,
    stiffest_1_s2: f64,
    at_rest: bool,
    end: String,
    steps: usize,
    steps_wanted: usize,
    simulated_s: f64,
    residual_force_n: f64,
    residual_force_allowed_n: f64,
    kinetic_energy_j: f64,
    kinetic_energy_allowed_j: f64,
    spring_energy_j: f64,
    #[serde(skip)]
    wall_s: f64,
    #[serde(skip)]
    interrupted: bool,
    #[serde(skip)]
    hint: Option<String>,
    #[serde(skip)]
    notes: Vec<String>,
}

impl Summary {
    /// Results of the checks.
    fn verdicts(&self) -> Vec<Verdict> {
        let rest = Verdict::new("the system is at rest", self.at_rest).at(self.end.as_str());
        let stable = self.stability_limit_s.is_none_or(|limit| self.dt_s < limit) || self.adaptive;
        let step = Verdict::new("the step is below the stability limit, or adapts", stable);
        let step = Verdict {
            limit: self.stability_limit_s,
            ..step.with_value(self.dt_s).in_unit("s")
        };
        vec![
            Verdict {
                what_to_do: self.hint.clone(),
                ..rest
            },
            step,
        ]
    }
}

/// The described system.
fn built(arguments: &Arguments) -> Result<Built, Failure> {
    match (&arguments.file, arguments.lattice) {
        (Some(file), _) => Built::of_file(file, arguments.mass),
        (None, Some(sides)) => {
            let neighbours = arguments.neighbours.unwrap_or(Neighbours::Six);
            Built::of_lattice(
                sides,
                neighbours,
                arguments.side.unwrap_or(1.0),
                arguments.mass,
            )
        }
        (None, None) => {
            let hint = "name a file, as examples/lattice-5x5x5.springs, or give --lattice 10x10x10";
            Err(Failure::usage("nothing to run", hint))
        }
    }
}

pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    arguments.output.threads.start();
    let stop = stop_on_interrupt("stopping after this step");
    let begun = Instant::now();
    let mut built = built(arguments)?;
    let estimate = built.estimate();
    built.system.damping = match arguments.damping.or(estimate) {
        Some(damping) => damping,
        None => {
            return Err(Failure::usage(
                "no damping can be estimated for such springs",
                "give it with --damping",
            ));
        }
    };
    // Computed for the shape at rest: the displacement of the surface softens the inner springs.
    let stiffest = stiffest(&built.system);
    let Chosen {
        integrator,
        dt,
        longest,
    } = chosen(arguments, &stiffest)?;
    let rest = RestSettings::share_of(&built.system, arguments.tolerance);
    built.disturb(arguments.shrink, arguments.pin == "surface");
    let path = arguments.output.folder(&built.name, "springs");
    let mut record = Record::begin(Folder::open(&path)?, &built, arguments.every)?;
    // These two have numerical damping.
    let damps = ["bdf2", "implicit"].contains(&integrator.name());
    let undamped = !damps && built.system.damping == 0.0;
    if undamped {
        note(
            "note: without damping nothing comes to rest, it swings for ever; give --damping, or leave it out for the estimate",
        );
    }
    let steps = arguments
        .steps
        .unwrap_or(if undamped { UNDAMPED_STEPS } else { STEPS }) as usize;
    let bar = Bar::of_steps(steps);
    let mut nearing = Nearing::new(steps, rest);
    let mut watch = Watch {
        record: &mut record,
        bar: &bar,
        nearing: &mut nearing,
    };
    let steps_of = advance(arguments.adaptive, integrator, dt);
    let until_raised = |_: &str, _: usize, _: usize| if_raised(&stop);
    let settled = SpringsRun::new(&built.name, &mut built.system, steps_of, rest, steps)
        .settle(&mut watch, &until_raised);
    bar.end();
    let mut summary = summary(arguments, &built, &stiffest, &settled, &rest);
    summary.steps_wanted = steps;
    if settled.end == RestEnd::Steps {
        let hint = if undamped {
            NEVER.to_owned()
        } else {
            nearing.hint()
        };
        summary.notes.push(hint.clone());
        summary.hint = Some(hint);
    }
    (
        summary.damping_estimate_ns_m,
        summary.dt_s,
        summary.stability_limit_s,
    ) = (estimate, dt, longest);
    (summary.simulated_s, summary.wall_s) = (record.time(), begun.elapsed().as_secs_f64());
    summary.interrupted = settled.end == RestEnd::Stopped;
    record.check()?;
    let output = record.output(&built, summary)?;
    arguments.output.finish(record.folder(), output)
}

/// Results of a run except times, step and estimates.
fn summary(
    arguments: &Arguments,
    built: &Built,
    stiffest: &Stiffest,
    settled: &Settled,
    rest: &RestSettings,
) -> Summary {
    let rows = Stiffest {
        mode: Mode {
            angular_frequency_squared: stiffest.bound,
            ..stiffest.mode
        },
        ..*stiffest
    };
    let of_rows = by_name(&arguments.integrator)
        .map(|by| limit(&*by, &rows))
        .filter(|l| l.is_finite());
    Summary {
        points: built.system.len(),
        points_held: built.system.pinned().iter().filter(|p| **p).count(),
        springs: built.lines.len(),
        neighbours: built.neighbours.count(),
        integrator: arguments.integrator.clone(),
        adaptive: arguments.adaptive,
        mass_kg: arguments.mass,
        damping_ns_m: built.system.damping,
        stability_limit_of_row_sums_s: of_rows,
        stiffest_1_s2: stiffest.mode.angular_frequency_squared,
        at_rest: settled.end == RestEnd::Rest,
        end: in_words(settled, rest),
        steps: settled.steps,
        residual_force_n: settled.last.residual,
        residual_force_allowed_n: rest.force,
        kinetic_energy_j: settled.last.energy.kinetic,
        kinetic_energy_allowed_j: rest.energy,
        spring_energy_j: settled.last.energy.stored,
        notes: built.notes.clone(),
        ..Summary::default()
    }
}

/// The integrator with its step.
struct Chosen {
    integrator: Box<dyn Integrator>,
    /// Step [s].
    dt: f64,
    /// Longest stable step [s].
    longest: Option<f64>,
}

/// The integrator with its step; rejects a step that is too long.
fn chosen(arguments: &Arguments, stiffest: &Stiffest) -> Result<Chosen, Failure> {
    let name = &arguments.integrator;
    let Some(integrator) = by_name(name) else {
        return Err(Failure::usage(
            format!("no integrator is called {name}"),
            INTEGRATORS.join(", "),
        ));
    };
    let longest = limit(&*integrator, stiffest);
    let step = if longest.is_finite() {
        0.5 * longest
    } else {
        5.0 * limit(&Verlet::default(), stiffest)
    };
    // If nothing moves, any step is stable.
    let step = if step.is_finite() { step } else { 1.0 };
    let dt = arguments.dt.unwrap_or(step);
    if !(dt > 0.0) {
        let (message, hint) = if stiffest.mode.damping_rate > 0.0 {
            (
                format!("{name}: the longest stable step is too small for a number"),
                "give a greater --mass",
            )
        } else {
            (
                format!("{name}: no step is stable without damping"),
                "give --damping, or take another integrator",
            )
        };
        return Err(Failure::usage(message, hint));
    }
    if dt >= longest && !arguments.adaptive {
        let message = format!(
            "a step of {} s is not stable: {name} needs less than {} s here",
            number(dt),
            number(longest)
        );
        return Err(Failure::usage(
            message,
            "take a shorter --dt, --adaptive, or --integrator implicit",
        ));
    }
    Ok(Chosen {
        integrator,
        dt,
        longest: longest.is_finite().then_some(longest),
    })
}

/// The steps of a run.
fn advance(is_adaptive: bool, mut integrator: Box<dyn Integrator>, dt: f64) -> Advance {
    if is_adaptive {
        let mut adaptive = Adaptive::new(integrator, dt);
        return Box::new(move |system| adaptive.step(system).map(|a| a.dt));
    }
    Box::new(move |system| integrator.step(system, dt).map(|()| dt))
}

fn in_words(settled: &Settled, rest: &RestSettings) -> String {
    let last = &settled.last;
    let left = format!(
        "force {} N (allowed {}), motion {} J (allowed {})",
        number(last.residual),
        number(rest.force),
        number(last.energy.kinetic),
        number(rest.energy)
    );
    match settled.end {
        RestEnd::Rest => format!("at rest after {} steps: {left}", settled.steps),
        RestEnd::Steps => format!("not at rest after {} steps: {left}", settled.steps),
        RestEnd::Stopped => format!("stopped after {} steps: {left}", settled.steps),
        RestEnd::Failed(error) => format!("failed after {} steps: {error}", settled.steps),
    }
}
