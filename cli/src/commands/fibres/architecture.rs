//! Aponeuroses of a muscle, and tables of the architecture of muscles.

use std::path::Path;

use super::{Arguments, unusable};
use crate::commands::areas::read_mesh;
use crate::commands::failure::Failure;
use crate::draft::names;
use pliant::fibres::Attachment;
use pliant::mesh::TriangleMesh;
use pliant::simulation::component;

/// Kinds of architecture: name, share of the muscle's length that each plate covers, and whether
/// that of the origin lies in the middle. The shares are those of fibres of 0.6, 0.25 and 0.13 of
/// the belly's length, which dissections find for muscles of these kinds \\[ward2009\\].
const NAMED: [(&str, f64, bool); 4] = [
    ("parallel", 0.4, false),
    ("pennate", 0.75, false),
    ("bipennate", 0.75, true),
    ("multipennate", 0.87, false),
];
/// Column of a table of architecture.
const OPTIMAL: &str = "optimal_fiber_length_m";

fn named(name: &str) -> Option<&'static (&'static str, f64, bool)> {
    NAMED.iter().find(|(known, ..)| *known == name)
}

/// The areas with the plates that `--aponeurosis` asks for.
pub(super) fn plates(
    arguments: &Arguments,
    text: &str,
    unit: f64,
    muscle: &TriangleMesh,
    attachment: &Attachment,
    notes: &mut Vec<String>,
) -> Result<Attachment, Failure> {
    let known = if text == "auto" {
        let stem = arguments.muscle.file_stem().unwrap_or_default();
        let by_name = names::architecture(&stem.to_string_lossy());
        let name = by_name.unwrap_or("parallel");
        notes.push(match by_name {
            Some(name) => format!("--aponeurosis auto: {name}, by the name of the muscle"),
            None => format!(
                "--aponeurosis auto: {name}, as the name of the muscle tells no architecture"
            ),
        });
        named(name)
    } else {
        named(text)
    };
    let made = widened(text, known, unit, muscle, attachment)?;
    let far = [&made.origin, &made.insertion].map(|area| area.patch.is_some());
    if far.contains(&true) {
        notes.push(
            "straight tendons to areas off the muscle are left out: fibres end on aponeuroses"
                .to_owned(),
        );
    }
    Ok(made.without_tendons())
}

/// The areas with plates of a known kind, or of a share, or of a file.
fn widened(
    text: &str,
    known: Option<&(&str, f64, bool)>,
    unit: f64,
    muscle: &TriangleMesh,
    attachment: &Attachment,
) -> Result<Attachment, Failure> {
    if let Some(&(_, share, central)) = known {
        return Ok(attachment.with_aponeuroses(muscle, share, central));
    }
    if let Ok(share) = text.parse::<f64>() {
        if !(0.0..=0.95).contains(&share) {
            return Err(Failure::usage(
                format!("--aponeurosis: each plate covers a share from 0 to 0.95, not {text}"),
                "0.75 is usual for pennate muscles",
            ));
        }
        return Ok(attachment.with_aponeuroses(muscle, share, false));
    }
    let path = Path::new(text);
    if !path.exists() {
        let names = NAMED.map(|(name, ..)| name).join(", ");
        return Err(Failure::usage(
            format!("--aponeurosis: `{text}` is no file, no share and no kind of architecture"),
            format!("the kinds are {names} and auto"),
        ));
    }
    let whole = read_mesh(path, unit)?;
    let plates: Vec<TriangleMesh> = (0..)
        .map_while(|k| component(&whole, Some(k)))
        .collect();
    attachment
        .with_plates(muscle, &plates)
        .map_err(|error| unusable(&error))
}

/// Mean optimal length [m] of the rows of a table, from FILE#ROW,ROW.
pub(super) fn optimal_length(text: &str) -> Result<f64, Failure> {
    let wrong = |message: String, hint: &str| Failure::usage(format!("--architecture: {message}"), hint);
    let form = "write FILE#ROW, such as architecture.csv#recfem_r";
    let (path, rows) = text
        .rsplit_once('#')
        .filter(|(path, rows)| !path.is_empty() && !rows.is_empty())
        .ok_or_else(|| wrong(format!("`{text}` names no row"), form))?;
    let table = std::fs::read_to_string(path)
        .map_err(|error| wrong(format!("cannot read `{path}`: {error}"), "name a table (.csv)"))?;
    let cells = |line: &str| -> Vec<String> {
        line.split(',').map(|cell| cell.trim().trim_matches('"').to_owned()).collect()
    };
    let mut lines = table.lines().enumerate().filter(|(_, line)| {
        let line = line.trim();
        !line.is_empty() && !line.starts_with('#')
    });
    let head = lines.next().map(|(_, line)| cells(line)).unwrap_or_default();
    let column = head.iter().position(|name| name == OPTIMAL).ok_or_else(|| {
        wrong(
            format!("{path} has no column {OPTIMAL}; it has {}", head.join(", ")),
            "the first line names the columns",
        )
    })?;
    let rows: Vec<&str> = rows.split(',').map(str::trim).collect();
    let (mut sum, mut found) = (0.0, vec![false; rows.len()]);
    for (k, line) in lines {
        let cells = cells(line);
        let Some(row) = rows.iter().position(|row| cells.first().is_some_and(|name| name == row)) else {
            continue;
        };
        let cell = cells.get(column).map_or("", String::as_str);
        let length = cell.parse().ok().filter(|l: &f64| *l > 0.0 && l.is_finite());
        sum += length.ok_or_else(|| {
            wrong(
                format!("{path}, line {}: `{cell}` is no length in m", k + 1),
                "lengths are numbers above 0, in m",
            )
        })?;
        found[row] = true;
    }
    match found.iter().position(|found| !found) {
        Some(k) => Err(wrong(format!("{path} has no row {}", rows[k]), form)),
        None => Ok(sum / rows.len() as f64),
    }
}
