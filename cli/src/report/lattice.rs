//! Results of a lattice that is displaced and released.

use serde_json::{Value, json};

use super::output::{DataFile, Plot, RunOutput, Verdict};
use super::{LinePlot, Table};
use pliant::format::number;
use pliant::mesh::measures::max_or_nan;
use pliant::simulation::{LatticeMeasures, LatticeRun};
use pliant::springs::Neighbours;

/// Greatest distance from its start, relative to the spacing, of a lattice that keeps its shape.
const BACK: f64 = 0.01;

/// True if the lattice was released.
fn is_free(run: &LatticeRun) -> bool {
    run.frame() > run.scene.release
}

fn verdicts(run: &LatticeRun) -> Vec<Verdict> {
    let (step, longest) = (run.lattice.time_step(), run.lattice.stability_limit());
    let mut all = vec![
        Verdict::new("the step is stable", step < longest)
            .with_value(step)
            .with_limit(longest)
            .in_unit("s"),
    ];
    if is_free(run) && run.scene.neighbours != Neighbours::Six {
        let share = run.distance() / run.lattice.shape().spacing[0];
        all.push(Verdict::at_most(
            "back to 1 % of the spacing from the start, as a share of the spacing",
            share,
            BACK,
        ));
    }
    all.into_iter()
        .map(|v| v.at(run.scene.name.as_str()))
        .collect()
}

fn data(run: &LatticeRun) -> DataFile<'_> {
    let columns = [
        "frame",
        "time_s",
        "distance_from_start_m",
        "moved_m",
        "wall_s",
    ];
    let row = |f: &LatticeMeasures| {
        let time = f.frame as f64 / run.scene.frame_rate;
        let numbers = [time, f.distance, f.moved, f.time_s].map(|x| x.to_string());
        [f.frame.to_string()].into_iter().chain(numbers).collect()
    };
    DataFile::new("measures.csv", columns, run.frames.iter().map(row))
}

/// Greatest distance from the start over all frames [m].
fn farthest(run: &LatticeRun) -> f64 {
    max_or_nan(run.frames.iter().map(|f| f.distance))
}

fn measures(run: &LatticeRun) -> Value {
    let lattice = &run.lattice;
    json!({
        "points": lattice.shape().count(),
        "springs": lattice.spring_count(),
        "neighbours": run.scene.neighbours.count(),
        "steps": lattice.steps(),
        "steps_a_frame": run.steps,
        "time_step_s": lattice.time_step(),
        "stability_limit_s": lattice.stability_limit(),
        "damping_kg_s": lattice.damping(),
        "distance_from_start_max_m": farthest(run),
        "distance_from_start_end_m": run.distance(),
        "at_rest": run.at_rest(),
    })
}

fn table(run: &LatticeRun) -> Table {
    let lattice = &run.lattice;
    let mut table = Table::new("Lattice", ["what", "value"]);
    for (what, value) in [
        ("points", lattice.shape().count().to_string()),
        ("springs", lattice.spring_count().to_string()),
        ("time step [ms]", number(lattice.time_step() * 1e3)),
        (
            "longest stable step [ms]",
            number(lattice.stability_limit() * 1e3),
        ),
        ("steps a frame", run.steps.to_string()),
        ("damping of a point [kg/s]", number(lattice.damping())),
        (
            "distance from the start, greatest [mm]",
            number(farthest(run) * 1e3),
        ),
        (
            "distance from the start, end [mm]",
            number(run.distance() * 1e3),
        ),
        (
            "at rest at the end",
            if run.at_rest() { "yes" } else { "no" }.to_owned(),
        ),
    ] {
        table.row([what.to_owned(), value]);
    }
    table
}

/// The result of a run, without the parts that all scenes have in common.
pub(super) fn output(run: &LatticeRun) -> RunOutput<'_> {
    let plot = |title: &str, of: fn(&LatticeMeasures) -> f64| {
        let points = run.frames.iter().map(|f| (f.frame as f64, of(f) * 1e3));
        Plot {
            file: None,
            plot: LinePlot::new(title, "frame").with("", points),
        }
    };
    RunOutput {
        kind: "lattice",
        measures: measures(run),
        verdicts: verdicts(run),
        tables_of_text: 1,
        tables: vec![table(run)],
        plots: vec![
            plot("Distance from the start, greatest [mm]", |f| f.distance),
            plot("Motion in a frame, greatest [mm]", |f| f.moved),
        ],
        data: vec![data(run)],
        ..RunOutput::default()
    }
}
