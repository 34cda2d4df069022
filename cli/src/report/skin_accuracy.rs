//! The cost of accuracy for skin over implants, as a table, a CSV, a plot, JSON and a page.

use serde_json::{Value, json};

use super::output::{DataFile, Plot, RunOutput, Verdict};
use super::{LinePlot, Table};
use pliant::accuracy::{SkinRow, SkinStudy, method_name};
use pliant::skin::SettleMethod;

/// Measures of a study.
fn to_json(study: &SkinStudy) -> Value {
    let recommended = study.recommended().into_iter().map(|(target, row)| {
        let row = row.map(|k| &study.rows[k]);
        json!({
            "target": target,
            "method": row.map(|r| method_name(r.method)),
            "edge_m": row.map(|r| r.edge),
            "time_s": row.map(|r| r.time_s),
        })
    });
    let left_out = study
        .left_out
        .iter()
        .map(|(edge, method)| json!({"edge_m": edge, "method": method_name(*method)}));
    json!({
        "scene": study.scene,
        "reference": row_json(study, &study.reference),
        "uncertainty_m2": study.uncertainty,
        "rows": study.rows.iter().map(|row| row_json(study, row)).collect::<Vec<_>>(),
        "recommended": recommended.collect::<Vec<_>>(),
        "left_out": left_out.collect::<Vec<_>>(),
    })
}

fn row_json(study: &SkinStudy, row: &SkinRow) -> Value {
    json!({
        "method": method_name(row.method),
        "edge_m": row.edge,
        "vertices": row.vertices,
        "springs": row.springs,
        "status": status(row),
        "area_gain_m2": row.gain,
        "area_deformed_m2": row.deformed,
        "volume_difference_m3": row.volume_difference,
        "error_m2": study.error(row),
        "error_share": study.share(row),
        "certain": study.is_certain(row),
        "steps": row.steps,
        "time_s": row.time_s,
    })
}

/// All rows and the reference.
fn table(study: &SkinStudy) -> Table {
    let heads = [
        "method",
        "edge [mm]",
        "vertices",
        "springs",
        "gain [cm2]",
        "error [cm2]",
        "error [%]",
        "time [s]",
    ];
    let mut table = Table::new("Errors and times", heads.into_iter().chain(["status"]));
    let mut add = |row: &SkinRow, state: &str| {
        let mark = if study.is_certain(row) || state == "reference" {
            ""
        } else {
            ", below the uncertainty"
        };
        table.row([
            method_name(row.method).to_owned(),
            format!("{:.2}", row.edge * 1e3),
            row.vertices.to_string(),
            row.springs.to_string(),
            format!("{:.3}", row.gain * 1e4),
            format!("{:+.3}", study.error(row) * 1e4),
            format!("{:.2}", study.share(row) * 100.0),
            format!("{:.2}", row.time_s),
            format!("{state}{mark}"),
        ]);
    };
    study.rows.iter().for_each(|row| add(row, status(row)));
    add(&study.reference, "reference");
    table
}

/// The fastest row for each target.
fn recommendation(study: &SkinStudy) -> Table {
    let mut table = Table::new(
        "Recommended",
        ["error of the gain", "method", "edge_length", "time [s]"],
    );
    for (target, row) in study.recommended() {
        let target = format!("{} %", target * 100.0);
        match row.map(|k| &study.rows[k]) {
            Some(r) => table.row([
                target,
                method_name(r.method).to_owned(),
                format!("{:.2} mm", r.edge * 1e3),
                format!("{:.2}", r.time_s),
            ]),
            None => table.row([
                target,
                "none of those measured".to_owned(),
                String::new(),
                String::new(),
            ]),
        }
    }
    table
}

/// Notes for the reader.
fn notes(study: &SkinStudy) -> Vec<String> {
    let reference = &study.reference;
    let mut notes = vec![format!(
        "the reference has edges of {:.2} mm, by Newton's method; its gain of {:.3} cm2 may be off by {:.3} cm2",
        reference.edge * 1e3,
        reference.gain * 1e4,
        study.uncertainty * 1e4
    )];
    if !study.left_out.is_empty() {
        notes.push(format!(
            "there was no time for {} more; give it with --budget",
            study.left_out.len()
        ));
    }
    notes
}

fn plot(study: &SkinStudy) -> LinePlot {
    let of = |method: SettleMethod| {
        let rows = study
            .rows
            .iter()
            .filter(move |r| r.method == method && r.converged);
        let mut points: Vec<(f64, f64)> =
            rows.map(|r| (r.time_s, study.share(r) * 100.0)).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points
    };
    LinePlot::new("Error of the area gained [%]", "time [s]")
        .with("Newton's method", of(SettleMethod::Newton))
        .with("quasi-static", of(SettleMethod::QuasiStatic))
        .with_limit(
            "uncertainty",
            (study.uncertainty / study.reference.gain).abs() * 100.0,
        )
        .logarithmic_both()
}

fn data(study: &SkinStudy) -> DataFile<'_> {
    let columns = [
        "method",
        "edge_m",
        "vertices",
        "springs",
        "status",
        "area_gain_m2",
        "area_deformed_m2",
        "volume_difference_m3",
        "error_m2",
        "error_share",
        "certain",
        "steps",
        "time_s",
    ];
    let reference = std::iter::once((&study.reference, "reference"));
    let rows = study.rows.iter().map(|r| (r, status(r))).chain(reference);
    let cells = |(row, state): (&SkinRow, &str)| {
        vec![
            method_name(row.method).to_owned(),
            row.edge.to_string(),
            row.vertices.to_string(),
            row.springs.to_string(),
            state.to_owned(),
            row.gain.to_string(),
            row.deformed.to_string(),
            row.volume_difference.to_string(),
            study.error(row).to_string(),
            study.share(row).to_string(),
            study.is_certain(row).to_string(),
            row.steps.to_string(),
            row.time_s.to_string(),
        ]
    };
    DataFile::new("work_precision.csv", columns, rows.map(cells))
}

/// The result.
pub fn output(study: &SkinStudy) -> RunOutput<'_> {
    let reference = "a reference was computed: uncertainty of its area gained";
    RunOutput {
        kind: "accuracy",
        name: study.scene.clone(),
        measures: to_json(study),
        verdicts: vec![
            Verdict::new(reference, true)
                .with_value(study.uncertainty)
                .in_unit("m2"),
        ],
        notes: notes(study),
        interrupted: study.interrupted,
        title: format!("{}: what accuracy costs", study.scene),
        tables_of_text: 2,
        tables: vec![recommendation(study), table(study)],
        plots_title: "Error against time".to_owned(),
        plots: vec![Plot {
            file: Some("work_precision.svg".to_owned()),
            plot: plot(study),
        }],
        data: vec![data(study)],
        ..RunOutput::default()
    }
}

fn status(row: &SkinRow) -> &'static str {
    if row.converged {
        "converged"
    } else {
        "not converged"
    }
}
