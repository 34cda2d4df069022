//! The cost of accuracy for skin over implants, as a table, a CSV, a plot, JSON and a page.

use std::io::Write;

use serde_json::{Value, json};

use super::folder::{Folder, FolderError};
use super::{LinePlot, Report, Table};
use pliant::accuracy::skin::{SkinRow, SkinStudy, name};
use pliant::skin::settle::Method;

/// The JSON of `--json`.
pub fn to_json(study: &SkinStudy) -> Value {
    let recommended = study.recommended().into_iter().map(|(target, row)| {
        let row = row.map(|k| &study.rows[k]);
        json!({
            "target": target,
            "method": row.map(|r| name(r.method)),
            "edge_m": row.map(|r| r.edge),
            "time_s": row.map(|r| r.time_s),
        })
    });
    let left_out = study
        .left_out
        .iter()
        .map(|(edge, method)| json!({"edge_m": edge, "method": name(*method)}));
    json!({
        "scene": study.scene,
        "reference": row_json(study, &study.reference),
        "uncertainty_m2": study.uncertainty,
        "rows": study.rows.iter().map(|row| row_json(study, row)).collect::<Vec<_>>(),
        "recommended": recommended.collect::<Vec<_>>(),
        "left_out": left_out.collect::<Vec<_>>(),
        "interrupted": study.interrupted,
    })
}

fn row_json(study: &SkinStudy, row: &SkinRow) -> Value {
    json!({
        "method": name(row.method),
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
pub fn table(study: &SkinStudy) -> Table {
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
            name(row.method).to_owned(),
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
pub fn recommendation(study: &SkinStudy) -> Table {
    let mut table = Table::new(
        "Recommended",
        ["error of the gain", "method", "edge_length", "time [s]"],
    );
    for (target, row) in study.recommended() {
        let target = format!("{} %", target * 100.0);
        match row.map(|k| &study.rows[k]) {
            Some(r) => table.row([
                target,
                name(r.method).to_owned(),
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
pub fn notes(study: &SkinStudy) -> Vec<String> {
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
    let of = |method: Method| {
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
        .with("Newton's method", of(Method::Newton))
        .with("quasi-static", of(Method::QuasiStatic))
        .with_limit(
            "uncertainty",
            (study.uncertainty / study.reference.gain).abs() * 100.0,
        )
        .logarithmic_both()
}

fn csv(study: &SkinStudy) -> String {
    let mut text =
        "method,edge_m,vertices,springs,status,area_gain_m2,area_deformed_m2,volume_difference_m3,error_m2,\
                    error_share,certain,steps,time_s\n"
            .to_owned();
    let reference = std::iter::once((&study.reference, "reference"));
    for (row, state) in study.rows.iter().map(|r| (r, status(r))).chain(reference) {
        let numbers = [
            row.gain,
            row.deformed,
            row.volume_difference,
            study.error(row),
            study.share(row),
        ];
        let numbers: Vec<String> = numbers.iter().map(f64::to_string).collect();
        let (method, certain) = (name(row.method), study.is_certain(row));
        text.push_str(&format!(
            "{method},{},{},{},{state},",
            row.edge, row.vertices, row.springs
        ));
        text.push_str(&format!(
            "{},{certain},{},{}\n",
            numbers.join(","),
            row.steps,
            row.time_s
        ));
    }
    text
}

/// Writes table, plot and page to the folder.
///
/// # Errors
/// A file that cannot be written.
pub fn write(study: &SkinStudy, folder: &Folder) -> Result<(), FolderError> {
    let text = |name: &str, text: String| folder.write(name, |w| w.write_all(text.as_bytes()));
    text("work_precision.csv", csv(study))?;
    text("work_precision.svg", plot(study).to_svg())?;
    let page = Report {
        title: format!("{}: what accuracy costs", study.scene),
        subtitle: if study.interrupted {
            "interrupted".to_owned()
        } else {
            String::new()
        },
        plots_title: "Error against time".to_owned(),
        plots: vec![plot(study)],
        tables: vec![recommendation(study), table(study)],
        notes: notes(study),
        ..Report::default()
    };
    text("report.html", page.to_html())?;
    text(
        "summary.json",
        serde_json::to_string_pretty(&to_json(study)).unwrap_or_default(),
    )
}

fn status(row: &SkinRow) -> &'static str {
    if row.converged {
        "converged"
    } else {
        "not converged"
    }
}
