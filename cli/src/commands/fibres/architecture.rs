//! Aponeuroses of a muscle, and tables of the architecture of muscles.

use std::path::Path;

use super::{Arguments, unusable};
use crate::commands::areas::read_mesh;
use crate::commands::failure::Failure;
use crate::draft::names;
use pliant::fibres::{Area, Attachment};
use pliant::mesh::{Topology, TriangleMesh};
use pliant::scene::units::{Dimension, parse};
use pliant::simulation::component;

/// A kind of architecture.
struct Kind {
    name: &'static str,
    /// How far the plates reach.
    reach: Reach,
    /// True if the origin's plate lies in the middle, between two of the insertion.
    central: bool,
}

/// How far each plate reaches from its end.
#[derive(Clone, Copy)]
enum Reach {
    /// Over this share of the muscle's length.
    Share(f64),
    /// So far that fibres make this angle with the line of action [degrees].
    Pennation(f64),
}

/// The kinds. Dissections of 27 muscles of the leg \\[ward2009\\] find fibres of about 0.6 of the
/// belly's length in parallel muscles, and angles of about 15 degrees in pennate ones and 28 in
/// soleus.
const KINDS: [Kind; 4] = [
    Kind {
        name: "parallel",
        reach: Reach::Share(0.4),
        central: false,
    },
    Kind {
        name: "pennate",
        reach: Reach::Pennation(15.0),
        central: false,
    },
    Kind {
        name: "bipennate",
        reach: Reach::Pennation(15.0),
        central: true,
    },
    Kind {
        name: "multipennate",
        reach: Reach::Pennation(28.0),
        central: false,
    },
];
/// Least difference of the sides to which areas look that decides about the plates.
const ASIDE: f64 = 0.2;
/// Least and greatest share of the length that a plate covers.
const LEAST: f64 = 0.05;
const MOST: f64 = 0.95;
/// Greatest number of plates in a file.
const PLATES: usize = 64;
/// Column of a table of architecture.
const OPTIMAL: &str = "optimal_fiber_length_m";

fn named(name: &str) -> Option<&'static Kind> {
    KINDS.iter().find(|kind| kind.name == name)
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
    let made = widened(arguments, text, known, unit, muscle, attachment, notes)?;
    if attachment.looks_apart(muscle) < ASIDE && !Path::new(text).exists() {
        notes.push(
            "origin and insertion look along the muscle, so which face has which plate is a choice: give plates in a file if it matters"
                .to_owned(),
        );
    }
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
    arguments: &Arguments,
    text: &str,
    known: Option<&Kind>,
    unit: f64,
    muscle: &TriangleMesh,
    attachment: &Attachment,
    notes: &mut Vec<String>,
) -> Result<Attachment, Failure> {
    let number = text.parse::<f64>().ok().map(Reach::Share);
    let angle = parse(text, Dimension::Angle).ok().map(f64::to_degrees);
    let reach = known
        .map(|kind| kind.reach)
        .or(number)
        .or(angle.map(Reach::Pennation));
    if let Some(reach) = reach {
        let central = known.is_some_and(|kind| kind.central);
        let share = match reach {
            Reach::Share(share) if (0.0..=0.95).contains(&share) => share,
            Reach::Pennation(angle) if (1.0..=60.0).contains(&angle) => {
                attachment.share_of_pennation(muscle, angle.to_radians(), central)
            }
            _ => {
                return Err(Failure::usage(
                    format!(
                        "--aponeurosis: each plate covers a share from 0 to 0.95, or fibres make an angle from 1 to 60 degrees, \
                         not {text}"
                    ),
                    "0.75 or 15deg is usual for pennate muscles",
                ));
            }
        };
        let thick = "the muscle is too thick for plates with such an angle between them";
        if !(share >= LEAST) && known.is_none() && matches!(reach, Reach::Pennation(_)) {
            return Err(Failure::usage(
                format!("--aponeurosis {text}: {thick}"),
                "give a greater angle, or a share of the length",
            ));
        }
        let made = attachment.with_aponeuroses(muscle, share.min(MOST), central);
        let is_empty = |area: &Area| area.sheet.as_ref().is_some_and(|s| s.triangles.is_empty());
        if (!(share >= LEAST) && matches!(reach, Reach::Pennation(_))) || is_empty(&made.origin) {
            notes.push(format!("{thick}: its fibres have no aponeuroses"));
            return Ok(attachment.clone());
        }
        return Ok(made);
    }
    let path = Path::new(text);
    if !path.exists() {
        let names = KINDS.map(|kind| kind.name).join(", ");
        return Err(Failure::usage(
            format!(
                "--aponeurosis: `{text}` is no file, no share, no angle and no kind of architecture"
            ),
            format!("the kinds are {names} and auto"),
        ));
    }
    let whole = read_mesh(path, unit)?;
    let count = Topology::new(&whole).components().count;
    if count > PLATES {
        return Err(Failure::usage(
            format!(
                "--aponeurosis: {text} has {count} components; a file of plates has at most {PLATES}"
            ),
            "`pliant check FILE --repair DIR` merges vertices that lie in one place",
        ));
    }
    if arguments.rest.is_some() {
        return Err(Failure::usage(
            "--aponeurosis names a file, but plates of a file do not move with the muscle of --rest",
            "name a kind of architecture, or leave --rest out",
        ));
    }
    let plates: Vec<TriangleMesh> = (0..count)
        .filter_map(|k| component(&whole, Some(k)))
        .collect();
    attachment
        .with_plates(muscle, &plates)
        .map_err(|error| unusable(&error))
}

/// Mean optimal length [m] of the rows of a table, from FILE#ROW,ROW.
pub(super) fn optimal_length(text: &str) -> Result<f64, Failure> {
    let wrong =
        |message: String, hint: &str| Failure::usage(format!("--architecture: {message}"), hint);
    let form = "write FILE#ROW, such as architecture.csv#recfem_r";
    let (path, rows) = text
        .rsplit_once('#')
        .filter(|(path, rows)| !path.is_empty() && !rows.is_empty())
        .ok_or_else(|| wrong(format!("`{text}` names no row"), form))?;
    let table = std::fs::read_to_string(path).map_err(|error| {
        wrong(
            format!("cannot read `{path}`: {error}"),
            "name a table (.csv)",
        )
    })?;
    let cells = |line: &str| -> Vec<String> {
        line.split(',')
            .map(|cell| cell.trim().trim_matches('"').to_owned())
            .collect()
    };
    let mut lines = table.lines().enumerate().filter(|(_, line)| {
        let line = line.trim();
        !line.is_empty() && !line.starts_with('#')
    });
    let head = lines
        .next()
        .map(|(_, line)| cells(line))
        .unwrap_or_default();
    let column = head
        .iter()
        .position(|name| name == OPTIMAL)
        .ok_or_else(|| {
            wrong(
                format!("{path} has no column {OPTIMAL}; it has {}", head.join(", ")),
                "the first line names the columns",
            )
        })?;
    let rows: Vec<&str> = rows.split(',').map(str::trim).collect();
    let (mut sum, mut found) = (0.0, vec![false; rows.len()]);
    for (k, line) in lines {
        let cells = cells(line);
        let Some(row) = rows
            .iter()
            .position(|row| cells.first().is_some_and(|name| name == row))
        else {
            continue;
        };
        let cell = cells.get(column).map_or("", String::as_str);
        let length = cell
            .parse()
            .ok()
            .filter(|l: &f64| *l > 0.0 && l.is_finite());
        if found[row] {
            let text = format!("{path}, line {}: row {} is there twice", k + 1, rows[row]);
            return Err(wrong(text, "leave one of them"));
        }
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
