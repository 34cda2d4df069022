//! The values of a fit: tables, CSV, distances from the measured shape, JSON and a page.

use serde_json::{Value, json};

use super::Table;
use super::output::{DataFile, RunOutput, Verdict};
use super::sensitivities::{rms, shown, surfaces};
use pliant::format::number;
use pliant::mesh::measures::max_or_nan;
use pliant::simulation::{Combination, Fitted};
use pliant_render::PictureError;

/// A shape is fitted if its distance is below this share of the body, and what is left below this multiple
/// of the noise.
const FITS: f64 = 0.02;
const ABOVE: f64 = 2.0;

/// Exponents below this share of the greatest one are not shown.
const SHOWN: f64 = 0.05;

fn values(found: &Fitted) -> Table {
    let heads = [
        "key",
        "in the scene",
        "fitted",
        "least",
        "most",
        "interval left [%]",
    ];
    let mut table = Table::new("Fitted values (SI units, 95 %)", heads);
    for value in &found.values {
        table.row([
            value.of.key.clone(),
            value.of.text.clone(),
            number(value.value),
            number(value.interval[0]),
            number(value.interval[1]),
            format!("{:.3}", value.share * 100.0),
        ]);
    }
    table
}

/// A combination as a product of powers.
fn product(found: &Fitted, combination: &Combination) -> String {
    let most = max_or_nan(combination.exponents.iter().map(|e| e.abs()));
    let each = combination.exponents.iter().zip(&found.values);
    let shown = each.filter(|(exponent, _)| exponent.abs() > SHOWN * most);
    let power = |(exponent, value): (&f64, &pliant::simulation::FittedValue)| {
        format!("{}^{:.2}", value.of.key, exponent)
    };
    shown.map(power).collect::<Vec<_>>().join(" * ")
}

fn combinations(found: &Fitted) -> Table {
    let heads = [
        "combination",
        "scene's interval over measured one",
        "told by",
    ];
    let mut table = Table::new("What the measurement tells", heads);
    for combination in &found.combinations {
        let by = if combination.known >= 1.0 {
            "the measurement"
        } else {
            "the scene's interval alone"
        };
        let known = number(combination.known);
        table.row([product(found, combination), known, by.to_owned()]);
    }
    table
}

fn numbers(found: &Fitted) -> Option<Table> {
    if found.numbers.is_empty() {
        return None;
    }
    let mut table = Table::new(
        "Measured numbers",
        ["body", "measure", "unit", "measured", "fitted"],
    );
    for (body, name, measured, fitted) in &found.numbers {
        let (words, unit, factor) = shown(name);
        table.row([
            body.clone(),
            words,
            unit.to_owned(),
            number(measured * factor),
            number(fitted * factor),
        ]);
    }
    Some(table)
}

fn distances(found: &Fitted) -> Option<Table> {
    if found.bodies.is_empty() {
        return None;
    }
    let mut table = Table::new(
        "Distance from the measured shape [mm]",
        ["body", "RMS", "greatest"],
    );
    for (name, _, distances) in &found.bodies {
        let most = max_or_nan(distances.iter().copied());
        table.row([
            name.clone(),
            number(rms(distances) * 1e3),
            number(most * 1e3),
        ]);
    }
    Some(table)
}

fn to_json(frame: usize, found: &Fitted) -> Value {
    let values = found.values.iter().map(|value| {
        json!({
            "key": value.of.key,
            "text": value.of.text,
            "value": value.value,
            "interval": value.interval,
            "share": value.share,
        })
    });
    let combinations = found
        .combinations
        .iter()
        .map(|c| json!({"known": c.known, "exponents": c.exponents}));
    let numbers = found.numbers.iter().map(|(body, name, measured, fitted)| {
        json!({"body": body, "name": name, "measured": measured, "fitted": fitted})
    });
    let bodies = found.bodies.iter().map(|(name, _, distances)| {
        json!({
            "body": name,
            "distance_rms_m": rms(distances),
            "distance_max_m": max_or_nan(distances.iter().copied()),
        })
    });
    json!({
        "frame": frame,
        "values": values.collect::<Vec<_>>(),
        "combinations": combinations.collect::<Vec<_>>(),
        "numbers": numbers.collect::<Vec<_>>(),
        "bodies": bodies.collect::<Vec<_>>(),
        "noise_m": found.noise,
        "misfits": found.rounds,
        "converged": found.converged,
    })
}

fn data(found: &Fitted) -> DataFile<'_> {
    let columns = ["key", "value", "least", "most", "share"];
    let rows = found.values.iter().map(|value| {
        let numbers = [
            value.value,
            value.interval[0],
            value.interval[1],
            value.share,
        ];
        let cells = numbers.iter().map(f64::to_string);
        [value.of.key.clone()].into_iter().chain(cells).collect()
    });
    DataFile::new("fit.csv", columns, rows)
}

/// The result.
///
/// # Errors
/// A picture that cannot be encoded.
pub fn output<'a>(
    name: &str,
    frame: usize,
    found: &'a Fitted,
) -> Result<RunOutput<'a>, PictureError> {
    let (pictures, files) = surfaces(
        &found.bodies,
        ("Distance", "distance from the measured shape"),
        "distance_m",
    )?;
    let mut fits = Vec::new();
    for (body, mesh, distances) in &found.bodies {
        let near = "distance from the measured shape (RMS)";
        let limit = FITS * mesh.length();
        fits.push(
            Verdict::at_most(near, rms(distances), limit)
                .in_unit("m")
                .at(body.as_str())
                .else_do("no value gives this shape: check --unit, and that both have the same place and pose"),
        );
        let left = "what is left of each coordinate, beside the noise";
        fits.push(
            Verdict::at_most(left, found.left, ABOVE * found.noise)
                .in_unit("m")
                .at(body.as_str())
                .else_do("the model cannot have this shape: give other values intervals, or a greater --noise"),
        );
    }
    let unknown: Vec<String> = found.unknown().map(|c| product(found, c)).collect();
    let mut tells = Verdict::new(
        "the measurement tells every combination",
        unknown.is_empty(),
    );
    if !unknown.is_empty() {
        tells = tells.at(unknown.join("; ")).else_do(
            "it is known from the scene's intervals only: with prescribed motion a shape tells ratios of stiffnesses; measure a force or a \
             pressure (--measured), or give the scene gravity",
        );
    }
    let note = (!found.bodies.is_empty()).then(|| {
        format!(
            "noise of each coordinate: {} mm; points beside each other share their errors, so that real intervals are wider",
            number(found.noise * 1e3)
        )
    });
    let tables = [
        Some(values(found)),
        Some(combinations(found)),
        numbers(found),
        distances(found),
    ];
    let tables: Vec<Table> = tables.into_iter().flatten().collect();
    Ok(RunOutput {
        kind: "fit",
        name: name.to_owned(),
        measures: to_json(frame, found),
        verdicts: vec![
            Verdict::new("the fit converged", found.converged)
                .else_do("begin nearer: give values with intervals around what is likely"),
            tells,
        ]
        .into_iter()
        .chain(fits)
        .collect(),
        notes: note.into_iter().collect(),
        title: format!("{name}: values from a measurement"),
        subtitle: format!("equilibrium of frame {frame}, {} rounds", found.rounds.len()),
        tables_of_text: tables.len(),
        tables,
        pictures,
        explanations: vec![
            "The values minimise the squared distances from the measurement, in units of its noise, and the squared distances of \
             their logarithms from the middle of the scene's intervals, unless these do not count."
                .to_owned(),
        ],
        data: vec![data(found)],
        files,
        ..RunOutput::default()
    })
}
