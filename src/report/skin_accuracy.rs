//! What accuracy costs for skin over implants, as a table, a CSV, a plot, JSON and a page.

use std::io::Write;

use serde_json::{Value, json};

use super::folder::{Folder, FolderError};
use super::{LinePlot, Report, Table};
use crate::accuracy::skin::{SkinRow, SkinStudy, name};
use crate::skin::settle::Method;

impl SkinStudy {
    /// As `--json` gives it.
    pub fn to_json(&self) -> Value {
        let recommended = self.recommended().into_iter().map(|(target, row)| {
            let row = row.map(|k| &self.rows[k]);
            json!({
                "target": target,
                "method": row.map(|r| name(r.method)),
                "edge_m": row.map(|r| r.edge),
                "time_s": row.map(|r| r.time_s),
            })
        });
        let left_out = self
            .left_out
            .iter()
            .map(|(edge, method)| json!({"edge_m": edge, "method": name(*method)}));
        json!({
            "scene": self.scene,
            "reference": self.row_json(&self.reference),
            "uncertainty_m2": self.uncertainty,
            "rows": self.rows.iter().map(|row| self.row_json(row)).collect::<Vec<_>>(),
            "recommended": recommended.collect::<Vec<_>>(),
            "left_out": left_out.collect::<Vec<_>>(),
            "interrupted": self.interrupted,
        })
    }

    fn row_json(&self, row: &SkinRow) -> Value {
        json!({
            "method": name(row.method),
            "edge_m": row.edge,
            "vertices": row.vertices,
            "springs": row.springs,
            "status": status(row),
            "area_gain_m2": row.gain,
            "area_deformed_m2": row.deformed,
            "volume_difference_m3": row.volume_difference,
            "error_m2": self.error(row),
            "error_share": self.share(row),
            "certain": self.is_certain(row),
            "steps": row.steps,
            "time_s": row.time_s,
        })
    }

    /// All rows and the reference.
    pub fn table(&self) -> Table {
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
            let mark = if self.is_certain(row) || state == "reference" {
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
                format!("{:+.3}", self.error(row) * 1e4),
                format!("{:.2}", self.share(row) * 100.0),
                format!("{:.2}", row.time_s),
                format!("{state}{mark}"),
            ]);
        };
        self.rows.iter().for_each(|row| add(row, status(row)));
        add(&self.reference, "reference");
        table
    }

    /// The fastest for each target.
    pub fn recommendation(&self) -> Table {
        let mut table = Table::new(
            "Recommended",
            ["error of the gain", "method", "edge_length", "time [s]"],
        );
        for (target, row) in self.recommended() {
            let target = format!("{} %", target * 100.0);
            match row.map(|k| &self.rows[k]) {
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

    /// What a reader should know.
    pub fn notes(&self) -> Vec<String> {
        let reference = &self.reference;
        let mut notes = vec![format!(
            "the reference has edges of {:.2} mm, by Newton's method; its gain of {:.3} cm2 may be off by {:.3} cm2",
            reference.edge * 1e3,
            reference.gain * 1e4,
            self.uncertainty * 1e4
        )];
        if !self.left_out.is_empty() {
            notes.push(format!(
                "there was no time for {} more; give it with --budget",
                self.left_out.len()
            ));
        }
        notes
    }

    fn plot(&self) -> LinePlot {
        let of = |method: Method| {
            let rows = self
                .rows
                .iter()
                .filter(move |r| r.method == method && r.converged);
            let mut points: Vec<(f64, f64)> =
                rows.map(|r| (r.time_s, self.share(r) * 100.0)).collect();
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            points
        };
        LinePlot::new("Error of the area gained [%]", "time [s]")
            .with("Newton's method", of(Method::Newton))
            .with("quasi-static", of(Method::QuasiStatic))
            .with_limit(
                "uncertainty",
                (self.uncertainty / self.reference.gain).abs() * 100.0,
            )
            .logarithmic_both()
    }

    fn csv(&self) -> String {
        let mut text =
            "method,edge_m,vertices,springs,status,area_gain_m2,area_deformed_m2,volume_difference_m3,error_m2,\
                        error_share,certain,steps,time_s\n"
                .to_owned();
        let reference = std::iter::once((&self.reference, "reference"));
        for (row, state) in self.rows.iter().map(|r| (r, status(r))).chain(reference) {
            let numbers = [
                row.gain,
                row.deformed,
                row.volume_difference,
                self.error(row),
                self.share(row),
            ];
            let numbers: Vec<String> = numbers.iter().map(f64::to_string).collect();
            let (method, certain) = (name(row.method), self.is_certain(row));
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

    /// Writes table, plot and page into the folder.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn write(&self, folder: &Folder) -> Result<(), FolderError> {
        let text = |name: &str, text: String| folder.write(name, |w| w.write_all(text.as_bytes()));
        text("work_precision.csv", self.csv())?;
        text("work_precision.svg", self.plot().to_svg())?;
        let page = Report {
            title: format!("{}: what accuracy costs", self.scene),
            subtitle: if self.interrupted {
                "interrupted".to_owned()
            } else {
                String::new()
            },
            plots_title: "Error against time".to_owned(),
            plots: vec![self.plot()],
            tables: vec![self.recommendation(), self.table()],
            notes: self.notes(),
            ..Report::default()
        };
        text("report.html", page.to_html())?;
        text(
            "summary.json",
            serde_json::to_string_pretty(&self.to_json()).unwrap_or_default(),
        )
    }
}

fn status(row: &SkinRow) -> &'static str {
    if row.converged {
        "converged"
    } else {
        "not converged"
    }
}
