//! The result of a kind of scene without a report of its own: its measures over the frames.

use serde_json::{Map, Value};

use super::output::{DataFile, Plot, RunOutput, Verdict};
use super::{LinePlot, Table};
use pliant::format::number;
use pliant::scene::{Content, Measure};
use pliant::simulation::Scenario;

/// The measures of one frame.
pub type Frame = Vec<(&'static str, f64)>;

fn value_of(frame: &[(&'static str, f64)], name: &str) -> Option<f64> {
    let found = frame.iter().find(|(known, _)| *known == name);
    found.map(|(_, value)| *value)
}

/// The measures of a scenario with their headers, in the order of the scenario.
fn declared(scenario: &dyn Scenario) -> Vec<Measure> {
    let mut all = Vec::new();
    for (name, _) in scenario.measures() {
        let known = Content::all_measures().find(|(known, ..)| *known == name);
        all.push(known.copied().unwrap_or((name, name, 1.0)));
    }
    all
}

fn verdicts(scenario: &dyn Scenario, declared: &[Measure], last: &Frame) -> Vec<Verdict> {
    let mut all = Vec::new();
    for (name, limit) in scenario.limits() {
        let head = declared.iter().find(|(known, ..)| *known == name);
        let head = head.map_or(name, |(_, head, _)| head);
        let value = value_of(last, name).unwrap_or(f64::NAN);
        let verdict = Verdict::at_most(format!("{head} at most {limit:e}"), value, limit);
        all.push(verdict.at(scenario.name()));
    }
    all
}

/// The result of a run, without the parts that all scenes have in common; `series` has the measures
/// of each frame.
pub(super) fn output<'a>(scenario: &dyn Scenario, series: Vec<Frame>) -> RunOutput<'a> {
    let (last, declared) = (scenario.measures(), declared(scenario));
    let mut measures = Map::new();
    let mut table = Table::new("Measures", ["what", "value in the last frame"]);
    let mut plots = Vec::new();
    for (name, head, factor) in &declared {
        let value = value_of(&last, name).unwrap_or(f64::NAN);
        measures.insert((*name).to_owned(), value.into());
        table.row([(*head).to_owned(), number(factor * value)]);
        let mut points = Vec::new();
        for (frame, all) in series.iter().enumerate() {
            points.extend(value_of(all, name).map(|value| (frame as f64, factor * value)));
        }
        plots.push(Plot {
            file: None,
            plot: LinePlot::new(*head, "frame").with("", points),
        });
    }
    RunOutput {
        kind: scenario.kind().name(),
        measures: Value::Object(measures),
        verdicts: verdicts(scenario, &declared, &last),
        tables_of_text: 1,
        tables: vec![table],
        plots,
        data: vec![data(&declared, series)],
        ..RunOutput::default()
    }
}

fn data<'a>(declared: &[Measure], series: Vec<Frame>) -> DataFile<'a> {
    let names: Vec<&str> = declared.iter().map(|(name, ..)| *name).collect();
    let columns: Vec<&str> = ["frame"].into_iter().chain(names.iter().copied()).collect();
    let row = move |(frame, all): (usize, Frame)| {
        let mut row = vec![frame.to_string()];
        for name in &names {
            row.push(value_of(&all, name).map_or(String::new(), |v| v.to_string()));
        }
        row
    };
    DataFile::new(
        "measures.csv",
        columns,
        series.into_iter().enumerate().map(row),
    )
}
