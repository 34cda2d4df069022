//! `pliant springs --sweep`: steps to rest of lattices with many values of damping, mass and number of points.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use rayon::prelude::*;
use serde::Serialize;

use super::super::failure::Failure;
use super::super::progress::Bar;
use super::super::run::stop_on_interrupt;
use super::Arguments;
use crate::report::LinePlot;
use crate::report::Table;
use crate::report::folder::Folder;
use crate::report::output::{DataFile, Plot, RunOutput, Verdict, measures};
use pliant::format::number;
use pliant::springs::Neighbours;
use pliant::springs::lattice::{Lattice, LatticeRestSettings, LatticeSettings, LatticeShape};

/// Step [s] if none is given: that with which the tables of the VPHOP thesis are met best.
const STEP: f64 = 0.01;

/// Greatest move of a point in a step at rest, relative to the longest side; and for how many steps no move may be
/// greater. The same fit.
const THRESHOLD: f64 = 6.3e-7;
const QUIET: u64 = 700;

/// Dampings between which the best one is sought, relative to the estimate, and their distance [N s/m]: that of the
/// thesis.
const SOUGHT: (f64, f64) = (0.4, 1.6);
const GRID: f64 = 0.05;

/// Most values of a key, and most points of all lattices together.
const MOST_VALUES: usize = 200;
const MOST_POINTS: usize = 1_000_000;

/// A value that varies, with its values.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Varied {
    Damping(Vec<f64>),
    Mass(Vec<f64>),
    Points(Vec<usize>),
}

/// Reads "damping=1,2,3", "damping=1..15" or "points=5,10".
pub(super) fn varied(text: &str) -> Result<Varied, String> {
    let wrong = |what: &str| {
        format!(
            "{what}; give a list such as damping=1,2,4, damping=1..15, mass=8,4,2 or points=5,10"
        )
    };
    let (key, list) = text
        .split_once('=')
        .ok_or_else(|| wrong("there is no `=`"))?;
    let mut values = Vec::new();
    for part in list.split(',').map(str::trim) {
        let read = |text: &str| {
            let found = text.trim().parse::<f64>().ok();
            let found = found.filter(|n| n.is_finite() && *n > 0.0);
            found.ok_or_else(|| wrong(&format!("`{text}` is not a positive number")))
        };
        match part.split_once("..") {
            None => values.push(read(part)?),
            Some((first, last)) => {
                let (first, last) = (read(first)?, read(last)?);
                if !(first <= last && last - first <= MOST_VALUES as f64) {
                    return Err(wrong(&format!(
                        "`{part}` is no range of at most {MOST_VALUES} numbers"
                    )));
                }
                let count = (last - first).floor() as usize;
                values.extend((0..=count).map(|k| first + k as f64));
            }
        }
    }
    if values.len() > MOST_VALUES {
        return Err(wrong(&format!(
            "{} values are more than {MOST_VALUES}",
            values.len()
        )));
    }
    match key.trim() {
        "damping" => Ok(Varied::Damping(values)),
        "mass" => Ok(Varied::Mass(values)),
        "points" => {
            let whole = values.iter().map(|n| {
                let is_whole = n.fract() == 0.0 && (2.0..=100.0).contains(n);
                is_whole.then_some(*n as usize)
            });
            let whole: Option<Vec<usize>> = whole.collect();
            whole
                .map(Varied::Points)
                .ok_or_else(|| wrong("points along a side are whole numbers from 2 to 100"))
        }
        other => Err(wrong(&format!(
            "`{other}` is none of damping, mass and points"
        ))),
    }
}

/// A lattice that ran to rest, or not.
#[derive(Clone, Copy, Debug, Serialize)]
struct Cell {
    points: usize,
    mass_kg: f64,
    damping_ns_m: f64,
    /// Steps to rest; `None` if it is not at rest within `--steps`.
    steps: Option<u64>,
    /// Whether the step is below the stability limit.
    stable: bool,
}

/// The best damping of a mass and a size, and the estimate.
#[derive(Clone, Copy, Debug, Serialize)]
struct Best {
    points: usize,
    mass_kg: f64,
    best_ns_m: f64,
    best_steps: Option<u64>,
    estimate_ns_m: f64,
    estimate_steps: Option<u64>,
}

/// What all lattices have in common.
struct Sweep<'a> {
    neighbours: Neighbours,
    side: f64,
    shrink: f64,
    held: bool,
    dt: f64,
    limit: u64,
    stop: &'a AtomicBool,
}

impl Sweep<'_> {
    fn settings(&self, mass: f64, damping: Option<f64>) -> LatticeSettings {
        LatticeSettings {
            mass,
            damping,
            time_step: Some(self.dt),
            ..LatticeSettings::new(self.neighbours)
        }
    }

    /// A lattice whose surface is moved, to rest. `None` if interrupted.
    fn run(&self, points: usize, mass: f64, damping: f64) -> Option<Cell> {
        let cell = Cell {
            points,
            mass_kg: mass,
            damping_ns_m: damping,
            steps: None,
            stable: false,
        };
        if self.stop.load(Ordering::Relaxed) {
            return None;
        }
        let shape = self.shape(points);
        let Ok(mut lattice) = Lattice::<f64>::new(shape, self.settings(mass, Some(damping))) else {
            return Some(cell);
        };
        let centre = [0, 1, 2].map(|c| 0.5 * shape.spacing[c] * (shape.points[c] - 1) as f64);
        for point in shape.each().filter(|&point| shape.on_surface(point)) {
            let at = shape.at(point);
            let moved = [0, 1, 2].map(|c| centre[c] + (at[c] - centre[c]) * (1.0 - self.shrink));
            lattice.place(point, moved);
            if self.held {
                lattice.pin(point);
            }
        }
        let rest = LatticeRestSettings {
            threshold: THRESHOLD * self.side,
            quiet: QUIET,
            limit: self.limit,
        };
        // One that diverges although its step is below the limit is not at rest.
        let steps = lattice
            .until_rest(&rest)
            .ok()
            .filter(|settled| settled.at_rest);
        Some(Cell {
            steps: steps.map(|settled| settled.steps),
            stable: true,
            ..cell
        })
    }

    fn shape(&self, points: usize) -> LatticeShape {
        LatticeShape {
            points: [points; 3],
            origin: [0.0; 3],
            spacing: [self.side / (points - 1) as f64; 3],
        }
    }

    /// The damping with the fewest steps, among those of a grid around the estimate.
    fn best(&self, points: usize, mass: f64) -> Option<Best> {
        let shape = self.shape(points);
        let estimate = self.settings(mass, None).damping_estimate(&shape);
        let (first, last) = (SOUGHT.0 * estimate / GRID, SOUGHT.1 * estimate / GRID);
        let grid = (first.ceil() as u32..=last.floor() as u32).into_par_iter();
        let cells: Option<Vec<Cell>> = grid
            .map(|k| self.run(points, mass, GRID * f64::from(k)))
            .collect();
        let cells = cells?.into_iter();
        let at_rest = cells.filter_map(|cell| Some((cell.steps?, cell.damping_ns_m)));
        // Of equal ones the least damping.
        let best = at_rest.reduce(|a, b| if b.0 < a.0 { b } else { a });
        Some(Best {
            points,
            mass_kg: mass,
            best_ns_m: best.map_or(f64::NAN, |(_, damping)| damping),
            best_steps: best.map(|(steps, _)| steps),
            estimate_ns_m: estimate,
            estimate_steps: self.run(points, mass, estimate)?.steps,
        })
    }
}

/// The values of each key.
struct Values {
    dampings: Vec<f64>,
    masses: Vec<f64>,
    points: Vec<usize>,
}

fn values(arguments: &Arguments) -> Result<Values, Failure> {
    let mut values = Values {
        dampings: Vec::new(),
        masses: vec![arguments.mass],
        points: vec![5],
    };
    if let Some([n, ny, nz]) = arguments.lattice {
        if n != ny || n != nz {
            return Err(Failure::usage(
                "a sweep is over cubes",
                "give --lattice 5x5x5, or --sweep points=5,10",
            ));
        }
        values.points = vec![n];
    }
    for varied in &arguments.sweep {
        match varied {
            Varied::Damping(all) => values.dampings.clone_from(all),
            Varied::Mass(all) => values.masses.clone_from(all),
            Varied::Points(all) => values.points.clone_from(all),
        }
    }
    let lattices = values.dampings.len().max(1) * values.masses.len();
    let count: usize = values.points.iter().map(|n| n.pow(3)).sum();
    if count.saturating_mul(lattices) > MOST_POINTS {
        return Err(Failure::usage(
            format!(
                "{} points in all lattices are more than {MOST_POINTS}",
                count * lattices
            ),
            "give fewer values or smaller lattices",
        ));
    }
    Ok(values)
}

/// Runs all lattices and writes their table, and that of the best dampings.
pub(super) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let begun = Instant::now();
    let values = values(arguments)?;
    let stop = stop_on_interrupt("stopping after these lattices");
    let sweep = Sweep {
        neighbours: arguments.neighbours.unwrap_or(Neighbours::Six),
        side: arguments.side.unwrap_or(1.0),
        shrink: arguments.shrink,
        held: arguments.pin == "surface",
        dt: arguments.dt.unwrap_or(STEP),
        limit: u64::from(arguments.steps.unwrap_or(20_000)),
        stop: &stop,
    };
    let name = format!("sweep-{}", sweep.neighbours.count());
    let folder = Folder::open(&arguments.output.folder(&name, "springs"))?;
    let mut of_rows = Vec::new();
    for &points in &values.points {
        for &damping in &values.dampings {
            of_rows.push((points, damping));
        }
    }
    let sets = values.points.len() * values.masses.len();
    let bar = Bar::of_parts(of_rows.len() + sets);
    let mut cells = Vec::new();
    for (done, (points, damping)) in of_rows.iter().enumerate() {
        let row = values.masses.par_iter();
        let row: Option<Vec<Cell>> = row
            .map(|&mass| sweep.run(*points, mass, *damping))
            .collect();
        let Some(row) = row else { break };
        cells.extend(row);
        bar.reach(done + 1, of_rows.len() + sets);
    }
    let mut best = Vec::new();
    'all: for &points in &values.points {
        for &mass in &values.masses {
            let Some(found) = sweep.best(points, mass) else {
                break 'all;
            };
            best.push(found);
            bar.reach(of_rows.len() + best.len(), of_rows.len() + sets);
        }
    }
    bar.end();
    let output = RunOutput {
        interrupted: stop.load(Ordering::Relaxed),
        time_s: begun.elapsed().as_secs_f64(),
        ..output(&name, &sweep, &values, &cells, &best)
    };
    arguments.output.finish(&folder, output)
}

fn steps_text(steps: Option<u64>, stable: bool, limit: u64) -> String {
    match (steps, stable) {
        (_, false) => "not stable".to_owned(),
        (None, _) => format!("over {limit}"),
        (Some(steps), _) => steps.to_string(),
    }
}

fn output(
    name: &str,
    sweep: &Sweep<'_>,
    values: &Values,
    cells: &[Cell],
    best: &[Best],
) -> RunOutput<'static> {
    let neighbours = sweep.neighbours.count();
    let mut tables = Vec::new();
    let mut plots = Vec::new();
    for &points in &values.points {
        let of_size = |cell: &&Cell| cell.points == points;
        let title = format!("Steps to rest, {points}^3 points, {neighbours} neighbours");
        if !values.dampings.is_empty() {
            let masses = values
                .masses
                .iter()
                .map(|m| format!("mass {} kg", number(*m)));
            let heads = std::iter::once("damping [N s/m]".to_owned()).chain(masses);
            let mut table = Table::new(title.as_str(), heads);
            for damping in &values.dampings {
                let row = cells.iter().filter(of_size);
                let row = row.filter(|cell| cell.damping_ns_m == *damping);
                let row = row.map(|c| steps_text(c.steps, c.stable, sweep.limit));
                table.row(std::iter::once(number(*damping)).chain(row));
            }
            tables.push(table);
            let mut plot = LinePlot::new(title.as_str(), "damping [N s/m]").logarithmic();
            for mass in &values.masses {
                let line = cells.iter().filter(of_size).filter(|c| c.mass_kg == *mass);
                let line = line.map(|c| (c.damping_ns_m, c.steps.map_or(f64::NAN, |s| s as f64)));
                plot = plot.with(format!("{} kg", number(*mass)), line);
            }
            plots.push(Plot { file: None, plot });
        }
    }
    let heads = [
        "points",
        "mass [kg]",
        "best damping [N s/m]",
        "steps",
        "estimate [N s/m]",
        "steps with it",
    ];
    let mut table = Table::new("Best damping, and the estimate", heads);
    for b in best {
        table.row([
            format!("{}^3", b.points),
            number(b.mass_kg),
            number(b.best_ns_m),
            b.best_steps
                .map_or("none".to_owned(), |steps| steps.to_string()),
            number(b.estimate_ns_m),
            steps_text(b.estimate_steps, true, sweep.limit),
        ]);
    }
    tables.insert(0, table);
    let rule = format!(
        "rest: no point moves by more than {} of the longest side in a step, for {QUIET} steps; steps of {} s; the steps up to \
         the last greater move are counted",
        number(THRESHOLD),
        number(sweep.dt)
    );
    let at_rest = best.iter().filter(|b| b.best_steps.is_some()).count();
    let columns = ["points", "mass_kg", "damping_ns_m", "steps", "stable"];
    let rows: Vec<Vec<String>> = cells
        .iter()
        .map(|c| {
            let steps = c.steps.map_or(String::new(), |s| s.to_string());
            let numbers = [c.mass_kg, c.damping_ns_m].map(|n| n.to_string());
            let [mass, damping] = numbers;
            vec![
                c.points.to_string(),
                mass,
                damping,
                steps,
                c.stable.to_string(),
            ]
        })
        .collect();
    RunOutput {
        kind: "springs_sweep",
        name: name.to_owned(),
        title: format!("Lattices with {neighbours} neighbours: steps to rest"),
        subtitle: rule.clone(),
        verdicts: vec![
            Verdict::at_least(
                "lattices for which a best damping is found",
                at_rest as f64,
                best.len() as f64,
            )
            .else_do("give more --steps, or a shorter --dt"),
        ],
        notes: vec![rule],
        tables_of_text: tables.len(),
        tables,
        plots,
        measures: measures(&serde_json::json!({
            "neighbours": neighbours,
            "dt_s": sweep.dt,
            "threshold": THRESHOLD,
            "quiet_steps": QUIET,
            "lattices": cells,
            "best": best,
        })),
        data: vec![DataFile::new("sweep.csv", columns, rows.into_iter())],
        ..RunOutput::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_and_ranges_are_read() {
        assert_eq!(
            varied("damping=1..3,7"),
            Ok(Varied::Damping(vec![1.0, 2.0, 3.0, 7.0]))
        );
        assert_eq!(varied("points = 5, 10"), Ok(Varied::Points(vec![5, 10])));
        for wrong in [
            "damping",
            "damping=",
            "damping=-1",
            "damping=nan",
            "points=1",
            "points=2.5",
            "speed=1",
            "mass=3..1",
            "mass=1..1e9",
        ] {
            assert!(varied(wrong).is_err(), "{wrong}");
        }
    }
}
