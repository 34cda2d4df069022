//! Results of a spring system on its way to rest.

use serde::Serialize;

use super::Table;
use super::output::{RunOutput, Verdict, measures};
use pliant::format::number;
use pliant::simulation::{Scenario, SpringsRun};
use pliant::springs::integrators::by_name;
use pliant::springs::{Mode, RestEnd, Stiffest, limit};

/// Measures of a run, and its settings.
#[derive(Serialize)]
pub struct Summary {
    points: usize,
    points_held: usize,
    springs: usize,
    neighbours: u32,
    precision: &'static str,
    device: &'static str,
    /// Name of the graphics card, and bytes on it.
    card: Option<String>,
    card_bytes: Option<u64>,
    /// How the steps are computed: rows of a lattice, a list of springs, or a method of a graphics card.
    method: &'static str,
    integrator: String,
    pub(crate) adaptive: bool,
    mass_kg: f64,
    damping_ns_m: f64,
    damping_estimate_ns_m: Option<f64>,
    dt_s: f64,
    stability_limit_s: Option<f64>,
    stability_limit_of_row_sums_s: Option<f64>,
    stiffest_1_s2: f64,
    at_rest: bool,
    /// The end in words.
    pub end: String,
    /// Number of steps.
    pub steps: usize,
    /// Time of a step, in the mean over all [ms].
    ms_per_step: Option<f64>,
    /// Time from the start of the command to the end of the first step [s]; of the command `springs` alone.
    pub first_step_s: Option<f64>,
    /// Greatest memory of the process so far [bytes], where the system tells it.
    peak_bytes: Option<u64>,
    steps_wanted: usize,
    simulated_s: f64,
    residual_force_n: f64,
    /// Greatest force at rest [N].
    pub residual_force_allowed_n: f64,
    kinetic_energy_j: f64,
    kinetic_energy_allowed_j: f64,
    spring_energy_j: f64,
    /// Reason of the end.
    #[serde(skip)]
    pub end_of_run: RestEnd,
}

impl Summary {
    /// The results of a run that has ended.
    pub fn of(run: &SpringsRun) -> Self {
        let (last, rest) = (&run.last, &run.rest);
        let rows = Stiffest {
            mode: Mode {
                angular_frequency_squared: run.stiffest.bound,
                ..run.stiffest.mode
            },
            ..run.stiffest
        };
        let integrator = run.course.integrator;
        let of_rows = by_name(integrator).map(|by| limit(&*by, &rows));
        let end = run.end.unwrap_or(if run.is_finished() {
            RestEnd::Steps
        } else {
            RestEnd::Stopped
        });
        Self {
            points: run.count(),
            points_held: run.held().iter().filter(|p| **p).count(),
            springs: run.springs,
            neighbours: run.neighbours.count(),
            precision: run.course.precision(),
            device: run.course.device,
            card: run.card().map(|(name, _)| name.to_owned()),
            card_bytes: run.card().map(|(_, bytes)| bytes),
            method: match run.is_by_rows() {
                true if run.course.is_on_gpu() => run.course.method,
                true => "rows",
                false => "list",
            },
            integrator: integrator.to_owned(),
            adaptive: run.course.adaptive,
            mass_kg: run.mass(),
            damping_ns_m: run.damping(),
            damping_estimate_ns_m: run.damping_estimate,
            dt_s: run.time_step,
            stability_limit_s: run.longest,
            stability_limit_of_row_sums_s: of_rows.filter(|l| l.is_finite()),
            stiffest_1_s2: run.stiffest.mode.angular_frequency_squared,
            at_rest: end == RestEnd::Rest,
            end: in_words(end, run),
            steps: last.step,
            ms_per_step: run.step_s().map(|s| s * 1e3),
            first_step_s: None,
            peak_bytes: peak(),
            steps_wanted: run.frames(),
            simulated_s: run.time,
            residual_force_n: last.residual,
            residual_force_allowed_n: rest.force,
            kinetic_energy_j: last.energy.kinetic,
            kinetic_energy_allowed_j: rest.energy,
            spring_energy_j: last.energy.stored,
            end_of_run: end,
        }
    }

    /// Results of the checks, with advice for a system that is not at rest.
    pub fn verdicts(&self, hint: Option<String>) -> Vec<Verdict> {
        let rest = Verdict::new("the system is at rest", self.at_rest).at(self.end.as_str());
        let stable = self.stability_limit_s.is_none_or(|limit| self.dt_s < limit) || self.adaptive;
        let step = Verdict::new("the step is below the stability limit, or adapts", stable);
        let step = Verdict {
            limit: self.stability_limit_s,
            ..step.with_value(self.dt_s).in_unit("s")
        };
        let rest = match hint {
            Some(hint) => rest.else_do(hint),
            None => rest,
        };
        vec![rest, step]
    }
}

/// Greatest memory of the process [bytes].
fn peak() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kilobytes = line.split_whitespace().next()?.parse::<u64>().ok()?;
    kilobytes.checked_mul(1024)
}

fn in_words(end: RestEnd, run: &SpringsRun) -> String {
    let (last, rest) = (&run.last, &run.rest);
    let steps = last.step;
    let left = format!(
        "force {} N (allowed {}), motion {} J (allowed {})",
        number(last.residual),
        number(rest.force),
        number(last.energy.kinetic),
        number(rest.energy)
    );
    match end {
        RestEnd::Rest => format!("at rest after {steps} steps: {left}"),
        RestEnd::Steps => format!("not at rest after {steps} steps: {left}"),
        RestEnd::Stopped => format!("stopped after {steps} steps: {left}"),
        RestEnd::Failed(error) => format!("failed after {steps} steps: {error}"),
    }
}

/// The result of a scene, from the `measured` one of its frames.
pub(super) fn output<'a>(run: &SpringsRun, measured: RunOutput<'a>) -> RunOutput<'a> {
    let summary = Summary::of(run);
    RunOutput {
        measures: measures(&summary),
        verdicts: summary.verdicts(None),
        tables: vec![settings(&summary)],
        ..measured
    }
}

/// The system and its integration.
pub fn settings(s: &Summary) -> Table {
    let seconds = |limit: Option<f64>| {
        limit.map_or("none: every step is stable".to_owned(), |s| {
            format!("{} s", number(s))
        })
    };
    let estimate = s
        .damping_estimate_ns_m
        .map_or(String::new(), |c| format!(" (estimate {})", number(c)));
    let adaptive = if s.adaptive { ", adaptive step" } else { "" };
    let mut table = Table::new("Settings", ["name", "value"]);
    for (name, value) in [
        (
            "points",
            format!("{}, {} of them held", s.points, s.points_held),
        ),
        ("springs", s.springs.to_string()),
        (
            "computed by",
            match (s.method, &s.card) {
                (method, Some(card)) => {
                    format!(
                        "{card}, method {method}, {} bytes on it, {}",
                        s.card_bytes.unwrap_or(0),
                        s.precision
                    )
                }
                ("rows", None) => format!("rows of the lattice, {}", s.precision),
                (_, None) => format!("a list of springs, {}", s.precision),
            },
        ),
        ("integrator", format!("{}{adaptive}", s.integrator)),
        ("mass of a point", format!("{} kg", number(s.mass_kg))),
        (
            "damping",
            format!("{} N s/m{estimate}", number(s.damping_ns_m)),
        ),
        ("step", format!("{} s", number(s.dt_s))),
        ("stability limit", seconds(s.stability_limit_s)),
        (
            "stiffest motion",
            format!("{} 1/s2", number(s.stiffest_1_s2)),
        ),
        ("simulated time", format!("{} s", number(s.simulated_s))),
    ] {
        table.row([name.to_owned(), value]);
    }
    table
}
