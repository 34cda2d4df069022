//! The cost of accuracy, as a table, a CSV, a plot, JSON and a page.

use serde_json::{Value, json};

use super::muscles::ErrorEstimate;
use super::output::{DataFile, Plot, RunOutput, Verdict};
use super::plot::{LinePlot, Series};
use super::table::Table;
use pliant::accuracy::{HIERARCHY, Status, Study, StudyRow};
use pliant::scene::SolverQuestion;
use pliant::scene::{SOLVERS, SolverSpec};

/// The solvers in the order of the key: those of a motion before those of an equilibrium.
fn solvers() -> Vec<&'static SolverSpec> {
    let mut solvers: Vec<&SolverSpec> = SOLVERS.iter().collect();
    solvers.sort_by_key(|spec| spec.question == Some(SolverQuestion::Equilibrium));
    solvers
}

/// Columns of `work_precision.csv`.
const COLUMNS: [&str; 30] = [
    "scene",
    "vertices",
    "frames",
    "moved_m",
    "solver",
    "substeps",
    "iterations",
    "order",
    "tolerance",
    "contact",
    "lanes",
    "threads",
    "status",
    "certain",
    "time_s",
    "time_min_s",
    "time_max_s",
    "repeats",
    "rms_error_m",
    "rms_error_share",
    "max_error_m",
    "worst_frame",
    "model_error_m",
    "volume_error",
    "penetration_m",
    "fibre_length_error_m",
    "residual_m",
    "error_estimate.solver_m",
    "solver_iterations",
    "on_front",
];

/// True if the error of a row exceeds the reference's uncertainty.
pub fn is_certain(row: &StudyRow) -> bool {
    row.error.rms >= row.uncertainty_m
}

/// The JSON of `--json`.
pub fn to_json(study: &Study) -> Value {
    let rows: Vec<Value> = study.rows.iter().map(|row| row_json(study, row)).collect();
    let recommended = study.recommended.iter().map(|r| {
        let row = r.row.map(|i| &study.rows[i]);
        json!({
            "target": r.target,
            "solver": row.map(|r| r.candidate.solver_key()),
            "settings": row.map(|r| r.candidate.settings()),
            "rms_error_m": row.map(|r| r.error.rms),
            "model_error_m": row.map(|r| r.model_error_m),
            "time_s": row.map(|r| r.time_s),
        })
    });
    let reference = |r: &pliant::accuracy::Reference| {
        json!({
            "question": question_name(r.question),
            "solver": r.candidate.solver_key(),
            "settings": r.candidate.settings(),
            "uncertainty_m": r.uncertainty.rms,
            "max_uncertainty_m": r.uncertainty.max,
            "steps_m": r.steps,
            "time_s": r.run.time_s,
        })
    };
    json!({
        "scene": study.scene,
        "frames": study.frames,
        "frames_in_scene": study.frames_of_scene,
        "vertices": study.vertices,
        "length_m": study.length,
        "reference": reference(&study.reference),
        "other_reference": study.other.as_ref().map(reference),
        "model_distance_m": study.model_distance_m,
        "rows": rows,
        "recommended": recommended.collect::<Vec<_>>(),
        "left_out": study.left_out.iter().map(|c| json!({"solver": c.solver_key(), "settings": c.settings()})).collect::<Vec<_>>(),
    })
}

fn row_json(study: &Study, row: &StudyRow) -> Value {
    json!({
        "solver": row.candidate.solver_key(),
        "settings": row.candidate.settings(),
        "rms_error_m": row.error.rms,
        "max_error_m": row.error.max,
        "rms_error_share": row.error.rms / study.length,
        "worst_frame": row.error.frame,
        "model_error_m": row.model_error_m,
        "volume_error": row.volume_error,
        "penetration_m": row.penetration_m,
        "fibre_length_error_m": row.fibre_error_m,
        "residual_m": row.residual_m,
        "error_estimate": ErrorEstimate::by(row.error_estimate_m, "the residual"),
        "solver_iterations": row.solver_iterations,
        "time_s": row.time_s,
        "time_range_s": row.time_range_s,
        "repeats": row.repeats,
        "certain": is_certain(row),
        "status": row.status.name(),
    })
}

/// `work_precision.csv`: a row for each run.
pub fn data(study: &Study) -> DataFile<'_> {
    let rows = study.rows.iter().enumerate();
    DataFile::new(
        "work_precision.csv",
        COLUMNS,
        rows.map(|(i, row)| cells(study, row, study.front.contains(&i))),
    )
}

fn cells(study: &Study, row: &StudyRow, on_front: bool) -> Vec<String> {
    let settings = row.candidate.settings();
    let setting = |key: &str| match settings.get(key) {
        Some(Value::String(text)) => text.clone(),
        Some(other) => other.to_string(),
        None => String::new(),
    };
    let mut cells = vec![
        study.scene.clone(),
        study.vertices.to_string(),
        study.frames.to_string(),
        study.moved_m.to_string(),
        row.candidate.solver_key().to_owned(),
    ];
    cells.extend(COLUMNS[5..12].iter().map(|key| setting(key)));
    cells.push(row.status.name().to_owned());
    cells.push(is_certain(row).to_string());
    cells.extend([row.time_s, row.time_range_s[0], row.time_range_s[1]].map(|v| v.to_string()));
    cells.push(row.repeats.to_string());
    let e = &row.error;
    cells.extend([e.rms, e.rms / study.length, e.max].map(|v| v.to_string()));
    cells.push(e.frame.to_string());
    let rest = [
        row.model_error_m,
        row.volume_error,
        row.penetration_m,
        row.fibre_error_m,
        row.residual_m,
        row.error_estimate_m,
    ];
    cells.extend(rest.map(|v| v.to_string()));
    cells.push(row.solver_iterations.to_string());
    cells.push(on_front.to_string());
    cells
}

/// Error over time, one colour per solver, with the Pareto front.
pub fn plot(study: &Study) -> LinePlot {
    let total = |row: &StudyRow| (row.error.rms + row.model_error_m) * 1e3;
    let fine = |row: &&StudyRow| row.status != Status::Diverged;
    let mut series = Vec::new();
    for SolverSpec { key, name, .. } in solvers() {
        let rows: Vec<&StudyRow> = study
            .rows
            .iter()
            .filter(|r| r.candidate.solver_key() == *key)
            .filter(fine)
            .collect();
        if !rows.is_empty() {
            let bars = rows.iter().filter(|r| r.repeats > 1);
            let bars = bars.map(|r| (total(r), r.time_range_s[0], r.time_range_s[1]));
            series.push(Series::new(*name, rows.iter().map(|r| (r.time_s, total(r)))).dotted(bars));
        }
    }
    let front = study
        .front
        .iter()
        .map(|i| &study.rows[*i])
        .map(|r| (r.time_s, total(r)));
    series.push(Series::new("none is better", front));
    let limits = study
        .recommended
        .iter()
        .map(|r| (String::new(), r.target * study.length * 1e3))
        .collect();
    let bound = study.reference.uncertainty.rms * 1e3;
    let title = format!(
        "RMS error [mm]; dashed: 10, 1, 0.1 % of {:.0} mm",
        study.length * 1e3
    );
    let x = format!("time of {} frames [s]", study.frames);
    let unknown_below = Some(("below the reference's own uncertainty".to_owned(), bound));
    LinePlot {
        series,
        limits,
        unknown_below,
        ..LinePlot::new(title, x).logarithmic_both()
    }
}

/// The recommended settings.
pub fn recommendation(study: &Study) -> Table {
    let header = [
        "accuracy",
        "solver",
        "settings",
        "threads",
        "RMS error [mm]",
        "model [mm]",
        "time [s]",
        "status",
    ];
    let mut table = Table::new("What to choose", header);
    for r in &study.recommended {
        let target = format!(
            "{} % = {:.2} mm",
            r.target * 100.0,
            r.target * study.length * 1e3
        );
        let Some(row) = r.row.map(|i| &study.rows[i]) else {
            let why = if study.reference.uncertainty.rms > r.target * study.length {
                "the reference is not certain to this"
            } else {
                "none of those measured reaches it"
            };
            table.row([target, "-".into(), why.to_owned()]);
            continue;
        };
        table.row([
            target,
            row.candidate.solver_key().to_owned(),
            row.candidate.in_words(),
            row.candidate.threads.to_string(),
            mm(row.error.rms),
            mm(row.model_error_m),
            format!("{:.3}", row.time_s),
            row.status.name().to_owned(),
        ]);
    }
    table
}

/// Every run.
pub fn table(study: &Study) -> Table {
    let header = [
        "solver",
        "settings",
        "lanes, threads, contact",
        "time [s]",
        "RMS error [mm]",
        "% of length",
        "greatest [mm]",
        "model [mm]",
        "volume error",
        "depth [mm]",
        "fibres [mm]",
        "estimated [mm]",
        "status",
    ];
    let mut table = Table::new("Every run", header);
    for row in &study.rows {
        let known = if is_certain(row) { "" } else { " (uncertain)" };
        table.row([
            row.candidate.solver_key().to_owned(),
            row.candidate.in_words(),
            format!(
                "{}, {}, {}",
                row.candidate.width.lanes(),
                row.candidate.threads,
                row.candidate.broad_phase.unwrap_or(HIERARCHY)
            ),
            format!("{:.3}", row.time_s),
            mm(row.error.rms) + known,
            format!("{:.3}", row.error.rms / study.length * 100.0),
            mm(row.error.max),
            mm(row.model_error_m),
            format!("{:.1e}", row.volume_error),
            mm(row.penetration_m),
            mm(row.fibre_error_m),
            mm(row.error_estimate_m),
            row.status.name().to_owned(),
        ]);
    }
    table
}

/// Notes on the meaning of the numbers.
pub fn notes(study: &Study) -> Vec<String> {
    let r = &study.reference;
    let mut notes = vec![
        format!(
            "Reference of the {}: {} with {}; it is off by about {} mm RMS, as \
             its levels of refinement differed by {} mm.",
            question_name(r.question),
            r.candidate.solver_key(),
            r.candidate.in_words(),
            mm(r.uncertainty.rms),
            r.steps.iter().map(|s| mm(*s)).collect::<Vec<_>>().join(", ")
        ),
        "The error is that of the solver, against the solution of the same discrete energy; what another mesh or \
         material would change is not in it."
            .to_owned(),
    ];
    match &study.other {
        Some(other) => notes.push(format!(
            "Solvers that answer the other question ({}) are compared with its own reference ({} mm uncertain); both \
             references are {} mm RMS apart, their model error.",
            question_name(other.question),
            mm(other.uncertainty.rms),
            mm(study.model_distance_m)
        )),
        None => notes.push("There is no reference of the other question: its solvers were not run.".to_owned()),
    }
    if study.frames < study.frames_of_scene {
        let (first, last) = (
            study.reference.frames().iter().take(1),
            study.reference.frames().iter().rev().take(1),
        );
        let [first, last] = [first.cloned().collect::<Vec<_>>(), last.cloned().collect()];
        notes.push(format!(
            "Frames 1 to {} of {}, over which vertices move by {} mm RMS: more budget compares more.",
            study.frames,
            study.frames_of_scene,
            mm(pliant::accuracy::FrameDistance::between(&first, &last).rms)
        ));
    }
    if !study.left_out.is_empty() {
        // Variants of lanes, threads and methods of contact search appear once.
        let mut names: Vec<String> = Vec::new();
        for name in study
            .left_out
            .iter()
            .map(|c| format!("{} ({})", c.solver_key(), c.in_words()))
        {
            if !names.contains(&name) {
                names.push(name);
            }
        }
        notes.push(format!("No time was left for: {}.", names.join("; ")));
    }
    if study.interrupted {
        notes.push("Interrupted: what is shown was measured before.".to_owned());
    }
    notes
}

/// The result.
pub fn output(study: &Study) -> RunOutput<'_> {
    let threads = study.rows.iter().map(|r| r.candidate.threads).max();
    let reference = "a reference was computed: its uncertainty";
    RunOutput {
        kind: "accuracy",
        name: study.scene.clone(),
        measures: to_json(study),
        verdicts: vec![
            Verdict::new(reference, true)
                .with_value(study.reference.uncertainty.rms)
                .in_unit("m"),
        ],
        notes: notes(study),
        interrupted: study.interrupted,
        title: format!("{}: what accuracy costs", study.scene),
        subtitle: format!(
            "{} vertices, {:.0} mm long; frames 1 to {}; times on {} threads",
            study.vertices,
            study.length * 1e3,
            study.frames,
            threads.unwrap_or(1)
        ),
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

fn question_name(question: SolverQuestion) -> &'static str {
    match question {
        SolverQuestion::Motion => "motion",
        SolverQuestion::Equilibrium => "equilibrium",
    }
}

/// A length in millimetres with three digits.
fn mm(length: f64) -> String {
    pliant::format::number(length * 1e3)
}
