//! `pliant springs --speed`: the time of a step for sizes of lattices, devices and methods.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use serde::Serialize;

use super::super::failure::Failure;
use super::super::progress::Bar;
use super::super::run::stop_on_interrupt;
use super::{Arguments, memory};
use crate::report::LinePlot;
use crate::report::Table;
use crate::report::folder::Folder;
use crate::report::output::{DataFile, Plot, RunOutput, Verdict, measures};
use pliant::format::number;
use pliant::scene::{Content, LatticeScene, PRECISIONS};
use pliant::simulation::SpringsRun;
use pliant::springs::Neighbours;
use pliant::springs::lattice::{DEVICES, GPU_METHODS};

/// Time of a measurement [s], the fewest steps of one, and how many there are: the fastest counts.
const SECONDS: f64 = 0.15;
const FEWEST: u64 = 4;
const ROUNDS: usize = 3;

/// Points along a side.
#[derive(Clone, Debug)]
pub(super) struct Sizes(Vec<usize>);

/// Reads "10,20,50".
pub(super) fn sizes(text: &str) -> Result<Sizes, String> {
    let each = text.split(',').map(|part| {
        let size = part.trim().parse().ok();
        size.filter(|n| (2..=1000).contains(n))
    });
    let all: Option<Vec<usize>> = each.collect();
    all.map(Sizes)
        .ok_or_else(|| "expected points along a side, such as 10,20,50,100".to_owned())
}

/// A way to compute a lattice.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Way {
    device: &'static str,
    method: &'static str,
    precision: &'static str,
}

/// The times of a lattice by a way.
#[derive(Clone, Debug, Serialize)]
struct Row {
    points_a_side: usize,
    neighbours: u32,
    device: &'static str,
    method: &'static str,
    precision: &'static str,
    /// Time of a step [ms], without and with a reading of all positions after it; the last with the next step going on.
    ms_per_step: f64,
    ms_per_step_read: Option<f64>,
    ms_per_step_read_beside: Option<f64>,
    /// Bytes on the card.
    card_bytes: Option<u64>,
}

fn ways() -> Vec<Way> {
    let on_cpu = PRECISIONS.iter().rev().map(|precision| Way {
        device: DEVICES[0],
        method: "rows",
        precision,
    });
    let on_card = GPU_METHODS.iter().map(|method| Way {
        device: DEVICES[1],
        method,
        precision: PRECISIONS[0],
    });
    on_cpu.chain(on_card).collect()
}

/// A lattice of the options, of this size and kind, computed in a way.
fn lattice(
    arguments: &Arguments,
    size: usize,
    neighbours: Neighbours,
    way: Way,
) -> Result<LatticeScene, Failure> {
    let chosen = Arguments {
        neighbours: Some(neighbours),
        device: way.device.to_owned(),
        method: (way.device != DEVICES[0]).then(|| way.method.to_owned()),
        precision: Some(way.precision.to_owned()),
        // A greater tolerance: what is measured need not come to rest.
        tolerance: 0.5,
        ..arguments.clone()
    };
    let made = super::text::scene(&chosen, [size; 3], 1_000_000);
    match made.content()? {
        Content::Lattice(scene) => Ok(*scene),
        _ => Err(Failure::usage("no lattice", "give --speed 10,20")),
    }
}

/// The fastest of some measurements [ms].
fn pace(run: &mut SpringsRun, reads: Option<bool>, stop: &AtomicBool) -> Result<f64, String> {
    let mut steps = FEWEST;
    let mut fastest = f64::INFINITY;
    let mut round = 0;
    while round < ROUNDS && !stop.load(Ordering::Relaxed) {
        let seconds = run.pace(steps, reads).map_err(|error| error.to_string())?;
        if seconds < 0.5 * SECONDS && round == 0 && steps < 1 << 20 {
            // Too short to tell: the first step of a card also compiles its kernels.
            steps *= 4;
            continue;
        }
        let ms = 1e3 * seconds / steps as f64;
        if ms < fastest {
            fastest = ms;
        }
        round += 1;
    }
    Ok(fastest)
}

/// Measures all lattices and writes their table.
pub(super) fn run(arguments: &Arguments, Sizes(sizes): &Sizes) -> Result<u8, Failure> {
    let begun = Instant::now();
    let stop = stop_on_interrupt("stopping after this measurement");
    let kinds = match arguments.neighbours {
        Some(neighbours) => vec![neighbours],
        None => Neighbours::ALL.to_vec(),
    };
    let folder = Folder::open(&arguments.output.folder("speed", "springs"))?;
    let ways = ways();
    let all = kinds.len() * sizes.len() * ways.len();
    let bar = Bar::of_parts(all);
    let (mut rows, mut notes, mut card, mut done) = (Vec::new(), Vec::new(), None, 0);
    for &neighbours in &kinds {
        for &size in sizes {
            for &way in &ways {
                if stop.load(Ordering::Relaxed) {
                    break;
                }
                let scene = lattice(arguments, size, neighbours, way)?;
                memory::check(&scene)?;
                match measured(&scene, way, size, &stop) {
                    Ok((row, name)) => {
                        card = card.or(name);
                        rows.push(row);
                    }
                    Err(why) => {
                        let note = match way.device == DEVICES[0] {
                            true => format!("{size}^3, {}: {why}", way.precision),
                            false => format!("without times of a graphics card: {why}"),
                        };
                        if !notes.contains(&note) {
                            notes.push(note);
                        }
                    }
                }
                done += 1;
                bar.reach(done, all);
            }
        }
    }
    bar.end();
    let output = RunOutput {
        interrupted: stop.load(Ordering::Relaxed),
        time_s: begun.elapsed().as_secs_f64(),
        notes,
        ..output(rows, card)
    };
    arguments.output.finish(&folder, output)
}

fn measured(
    scene: &LatticeScene,
    way: Way,
    size: usize,
    stop: &AtomicBool,
) -> Result<(Row, Option<String>), String> {
    let mut run = SpringsRun::of_lattice(scene).map_err(|error| error.terse())?;
    let is_on_card = run.card().is_some();
    let ms_per_step = pace(&mut run, None, stop)?;
    let mut read = [None; 2];
    for (beside, read) in [false, true].into_iter().zip(&mut read) {
        if is_on_card {
            *read = Some(pace(&mut run, Some(beside), stop)?);
        }
    }
    let card = run.card().map(|(name, bytes)| (name.to_owned(), bytes));
    let row = Row {
        points_a_side: size,
        neighbours: scene.neighbours.count(),
        device: way.device,
        method: way.method,
        precision: way.precision,
        ms_per_step,
        ms_per_step_read: read[0],
        ms_per_step_read_beside: read[1],
        card_bytes: card.as_ref().map(|(_, bytes)| *bytes),
    };
    Ok((row, card.map(|(name, _)| name)))
}

fn output(rows: Vec<Row>, card: Option<String>) -> RunOutput<'static> {
    let heads = [
        "points",
        "neighbours",
        "device",
        "method",
        "numbers",
        "a step [ms]",
        "and read [ms]",
        "read beside the next [ms]",
        "on the card [MB]",
    ];
    let or_dash = |ms: Option<f64>| ms.map_or("–".to_owned(), number);
    let mut table = Table::new("Time of a step", heads);
    for row in &rows {
        table.row([
            format!("{}^3", row.points_a_side),
            row.neighbours.to_string(),
            row.device.to_owned(),
            row.method.to_owned(),
            row.precision.to_owned(),
            number(row.ms_per_step),
            or_dash(row.ms_per_step_read),
            or_dash(row.ms_per_step_read_beside),
            or_dash(row.card_bytes.map(|bytes| bytes as f64 * 1e-6)),
        ]);
    }
    let mut plots = Vec::new();
    for neighbours in Neighbours::ALL.map(Neighbours::count) {
        let of_kind = |row: &&Row| row.neighbours == neighbours;
        if !rows.iter().any(|row| of_kind(&row)) {
            continue;
        }
        let title = format!("Time of a step [ms], {neighbours} neighbours");
        let mut plot = LinePlot::new(title, "points along a side").logarithmic_both();
        for way in ways() {
            let line = rows.iter().filter(of_kind).filter(|row| {
                (row.device, row.method, row.precision) == (way.device, way.method, way.precision)
            });
            let line: Vec<_> = line
                .map(|row| (row.points_a_side as f64, row.ms_per_step))
                .collect();
            if !line.is_empty() {
                let name = format!("{} {} {}", way.device, way.method, way.precision);
                plot = plot.with(name, line);
            }
        }
        plots.push(Plot { file: None, plot });
    }
    let threads = rayon::current_num_threads();
    let device = card.as_deref().unwrap_or("no graphics card");
    let columns = [
        "points_a_side",
        "neighbours",
        "device",
        "method",
        "precision",
        "ms_per_step",
        "ms_per_step_read",
        "ms_per_step_read_beside",
        "card_bytes",
    ];
    let or_empty = |n: Option<f64>| n.map_or(String::new(), |n| n.to_string());
    let lines: Vec<Vec<String>> = rows
        .iter()
        .map(|row| {
            vec![
                row.points_a_side.to_string(),
                row.neighbours.to_string(),
                row.device.to_owned(),
                row.method.to_owned(),
                row.precision.to_owned(),
                row.ms_per_step.to_string(),
                or_empty(row.ms_per_step_read),
                or_empty(row.ms_per_step_read_beside),
                row.card_bytes
                    .map_or(String::new(), |bytes| bytes.to_string()),
            ]
        })
        .collect();
    RunOutput {
        kind: "springs_speed",
        name: "speed".to_owned(),
        title: "Lattices: time of a step".to_owned(),
        subtitle: format!("processor with {threads} threads; {device}"),
        verdicts: vec![Verdict::at_least(
            "lattices measured",
            rows.len() as f64,
            1.0,
        )],
        tables_of_text: 1,
        tables: vec![table],
        plots,
        measures: measures(&serde_json::json!({
            "threads": threads,
            "card": card,
            "lattices": rows,
        })),
        data: vec![DataFile::new("speed.csv", columns, lines.into_iter())],
        ..RunOutput::default()
    }
}
