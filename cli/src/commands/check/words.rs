//! The results as text: all details for one mesh, one line each for several.

use super::checked::{Checked, Mended, Observation, Outcome};
use crate::report::Table;
use pliant::mesh::Health;

/// The whole report.
pub(super) fn report(outcomes: &[Outcome], unit: Option<&str>) -> String {
    let all: Vec<&Checked> = outcomes.iter().filter_map(Outcome::checked).collect();
    let mut text = match all[..] {
        [] => return String::new(),
        [one] if outcomes.len() == 1 => single(one, unit),
        _ => table(&all, unit),
    };
    for checked in &all {
        for observation in &checked.findings {
            text.push_str(&finding(&checked.file, observation));
        }
        if let Some(mended) = &checked.repair {
            text.push_str(&changes(checked, mended, unit));
        }
    }
    if all.len() > 1 {
        let fit = all.iter().filter(|c| c.is_fit()).count();
        let after = if all.iter().any(|c| c.repair.is_some()) {
            "after repair "
        } else {
            ""
        };
        let unread = outcomes.len() - all.len();
        let rest = if unread > 0 {
            format!("; {unread} cannot be used")
        } else {
            String::new()
        };
        text.push_str(&format!(
            "\n{after}{fit} of {} are fit for simulation{rest}\n",
            all.len()
        ));
    }
    text
}

fn finding(file: &str, observation: &Observation) -> String {
    let kind = if observation.refuses() {
        "error"
    } else {
        "warning"
    };
    let line = match (observation.line, observation.offset) {
        (Some(line), _) => format!("{line}:"),
        (None, Some(offset)) => format!(" offset {offset:#x}:"),
        (None, None) => String::new(),
    };
    format!(
        "{file}:{line} {kind}[{}]: {}; {}\n",
        observation.code, observation.message, observation.repair
    )
}

/// Four digits in the most readable form.
fn short(number: f64) -> String {
    let size = number.abs();
    if size == 0.0 {
        "0".to_owned()
    } else if (1e-3..1e5).contains(&size) {
        let digits = (3 - size.log10().floor() as i32).clamp(0, 6) as usize;
        format!("{number:.digits$}")
    } else {
        format!("{number:.3e}")
    }
}

/// The unit of the file after a number, with a power.
fn in_unit(unit: Option<&str>, power: &str) -> String {
    unit.map_or_else(String::new, |u| format!(" {u}{power}"))
}

fn orientation(health: &Health) -> String {
    match (health.orientable, health.inconsistent_edges) {
        (false, _) => "one-sided".to_owned(),
        (true, 0) if health.boundary_edges > 0 || health.non_manifold_edges > 0 => {
            "agrees".to_owned()
        }
        (true, 0) if health.volume < 0.0 => "inward".to_owned(),
        (true, 0) => "outward".to_owned(),
        (true, edges) => format!("{edges} edges disagree"),
    }
}

fn genus(health: &Health) -> String {
    health
        .genus
        .map_or_else(|| "-".to_owned(), |g| g.to_string())
}

fn crossings(health: &Health) -> String {
    let more = if health.self_intersections_complete {
        ""
    } else {
        "+"
    };
    format!("{}{more}", health.self_intersections)
}

fn guess(checked: &Checked) -> String {
    match checked.likely_units[..] {
        [] => "none that a part of a body would have".to_owned(),
        [first] => first.to_owned(),
        [first, ref rest @ ..] => format!("{first}, or {}", rest.join(", ")),
    }
}

fn single(checked: &Checked, unit: Option<&str>) -> String {
    let health = &checked.health;
    let verdict = if checked.fit {
        "fit for simulation"
    } else {
        "a simulation would refuse it"
    };
    let mut text = format!("{}: {}, {verdict}\n\n", checked.file, checked.format);
    let sides: Vec<String> = (0..3)
        .map(|k| short(health.highest[k] - health.lowest[k]))
        .collect();
    let corner = |p: [f64; 3]| p.map(short).join(", ");
    let mut rows = vec![
        ("vertices", health.vertices.to_string()),
        ("triangles", health.triangles.to_string()),
        ("polylines", checked.lines.to_string()),
        ("pieces", health.components.to_string()),
        (
            "rims",
            format!(
                "{} of {} edges",
                health.boundary_loops, health.boundary_edges
            ),
        ),
        ("handles", genus(health)),
        ("orientation", orientation(health)),
        (
            "non-manifold",
            format!(
                "{} edges, {} vertices",
                health.non_manifold_edges, health.non_manifold_vertices
            ),
        ),
        ("slivers", health.slivers.to_string()),
        ("without area", health.zero_area.to_string()),
        (
            "duplicates",
            format!(
                "{} triangles, {} vertices",
                health.duplicate_triangles, health.duplicate_vertices
            ),
        ),
        ("unused vertices", health.unused_vertices.to_string()),
        ("self-intersections", crossings(health)),
        ("volume", short(health.volume) + &in_unit(unit, "3")),
        ("area", short(health.area) + &in_unit(unit, "2")),
        ("box", format!("{}{}", sides.join(" x "), in_unit(unit, ""))),
        (
            "from, to",
            format!("({}), ({})", corner(health.lowest), corner(health.highest)),
        ),
    ];
    if unit.is_none() {
        rows.push(("unit, as a guess", guess(checked)));
    }
    let mut table = Table::default();
    rows.into_iter()
        .for_each(|(name, value)| table.row([name.to_owned(), value]));
    text.push_str(&table.to_text());
    text.push('\n');
    text
}

/// Heads of the table.
const HEADS: [&str; 16] = [
    "file",
    "vertices",
    "triangles",
    "pieces",
    "rims",
    "genus",
    "orientation",
    "odd edges",
    "slivers",
    "flat",
    "twice",
    "crossings",
    "volume",
    "area",
    "side",
    "fit",
];

fn table(all: &[&Checked], unit: Option<&str>) -> String {
    let mut table = Table::new("", HEADS);
    if unit.is_none() {
        table.header.insert(15, "unit?".to_owned());
    }
    for checked in all {
        let health = &checked.health;
        let mut row = vec![
            checked.file.clone(),
            health.vertices.to_string(),
            health.triangles.to_string(),
            health.components.to_string(),
            health.boundary_loops.to_string(),
            genus(health),
            orientation(health),
            health.non_manifold_edges.to_string(),
            health.slivers.to_string(),
            health.zero_area.to_string(),
            (health.duplicate_triangles + health.duplicate_vertices).to_string(),
            crossings(health),
            short(health.volume),
            short(health.area),
            short(health.length()),
        ];
        if unit.is_none() {
            row.push(checked.likely_units.first().map_or("-", |u| u).to_owned());
        }
        row.push(if checked.fit { "yes" } else { "no" }.to_owned());
        table.rows.push(row);
    }
    let note = unit.map_or_else(
        || "volume, area and longest side in the unit of each file; unit? is a guess".to_owned(),
        |u| format!("volume in {u}3, area in {u}2, longest side in {u}"),
    );
    format!("{}{note}\n\n", table.to_text())
}

/// A distance in mm if the unit of the file is known, otherwise in the unit of the file.
fn length(distance: f64, unit_m: Option<f64>) -> String {
    match unit_m {
        Some(metres) => format!("{} mm", short(distance * metres * 1e3)),
        None => short(distance),
    }
}

fn changes(checked: &Checked, mended: &Mended, unit: Option<&str>) -> String {
    let verdict = if mended.fit {
        "fit for simulation"
    } else {
        "a simulation would still refuse it"
    };
    let mut text = format!("\n{}: {verdict}\n", mended.file);
    if mended.changes.is_empty() {
        text.push_str("  nothing needed repair\n");
    }
    for change in &mended.changes {
        text.push_str(&format!("  {}\n", change.message));
    }
    let unit_m = unit.and(checked.unit_m);
    let side = |distance: Option<f64>| {
        distance.map_or_else(|| "nothing to measure".to_owned(), |d| length(d, unit_m))
    };
    let Mended {
        distance, moved, ..
    } = mended;
    if let Some(distance) = distance {
        text.push_str(&format!(
            "  vertices moved by at most {}; the surface as read is at most {} from the repaired one, which is at most {} from it\n",
            length(*moved, unit_m),
            side(distance.lost),
            side(distance.added)
        ));
    }
    if mended.lines_lost > 0 {
        text.push_str(&format!(
            "  {} polylines are lost: this format has none\n",
            mended.lines_lost
        ));
    }
    // Messages about the original mesh are not repeated.
    let is_known =
        |new: &&Observation| !new.refuses() && checked.findings.iter().any(|f| f.code == new.code);
    for new in mended.findings.iter().filter(|new| !is_known(new)) {
        text.push_str(&finding(&mended.file, new));
    }
    let rest: Vec<String> = mended
        .findings
        .iter()
        .filter(is_known)
        .map(|t| format!("{} ({})", t.code, t.count))
        .collect();
    if !rest.is_empty() {
        text.push_str(&format!("  left as it is: {}\n", rest.join(", ")));
    }
    text
}
