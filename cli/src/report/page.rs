//! The report of a run: verdicts, pictures, plots, tables, from its summary and its record.

use std::collections::BTreeSet;

use super::pictures::Painter;
use super::record::Record;
use super::results::Shots;
use super::summary::{MuscleSummary, Summary};
use super::{LinePlot, Report, Table, Turntable};
use pliant::simulation::{FrameState, LeftOut, Measures, Planned, SceneDescription};
use pliant_render::PictureError;

/// Greatest number of points of a plotted line; a longer run shows the maximum of each few frames.
const MOST_POINTS: usize = 1000;

/// Creates the report of a run.
///
/// # Errors
/// A picture that cannot be encoded.
pub fn report(
    summary: &Summary,
    record: &Record,
    cast: &SceneDescription,
    shots: &Shots,
    settings: &[(String, String)],
) -> Result<Report, PictureError> {
    Ok(Report {
        findings: Vec::new(),
        title: summary.scene.clone(),
        subtitle: subtitle(summary),
        verdict: summary.verdicts.clone(),
        pictures: pictures(cast, shots, "greatest edge stretch rms")?,
        sheets: Vec::new(),
        turntable: turntable(cast, shots)?,
        plots_title: String::new(),
        plots: plots(summary, record),
        tables: tables(summary, settings),
        notes: summary.notes.clone(),
    })
}

fn subtitle(summary: &Summary) -> String {
    format!(
        "{} of {} frames in {:.1} s, {:.1} ms a frame (median){}",
        summary.frames,
        summary.frames_wanted,
        summary.time.total_s,
        summary.time.frame_ms_median,
        if summary.interrupted {
            "; interrupted"
        } else {
            ""
        }
    )
}

/// The turntable of a run; `None` for a single frame.
pub(super) fn turntable(
    cast: &SceneDescription,
    shots: &Shots,
) -> Result<Option<Turntable>, PictureError> {
    Painter::new(cast, shots).map_or(Ok(None), |painter| painter.turntable(shots))
}

pub(super) fn pictures(
    cast: &SceneDescription,
    shots: &Shots,
    stretch: &str,
) -> Result<Vec<(String, Vec<u8>)>, PictureError> {
    let Some(painter) = Painter::new(cast, shots) else {
        return Ok(Vec::new());
    };
    let worst = shots.worst.as_ref().map(|(_, shot)| shot);
    let wanted = [
        ("First frame", shots.first.as_ref()),
        ("Worst frame", worst),
        ("Last frame", shots.last.as_ref()),
    ];
    let mut pictures = Vec::new();
    let fibres = if cast.bodies.iter().any(|m| !m.fibres.is_empty()) {
        "; pale lines: fibres"
    } else {
        ""
    };
    for (caption, shot) in wanted {
        let Some(shot): Option<&std::sync::Arc<FrameState>> = shot else {
            continue;
        };
        let caption = match caption {
            "Worst frame" => format!("{caption} ({stretch}), {}{fibres}", shot.frame),
            _ => format!("{caption}, {}{fibres}", shot.frame),
        };
        pictures.push((caption, painter.picture(shot).to_png()?));
    }
    Ok(pictures)
}

/// Thins a line: keeps the point with the greatest value of each few.
fn thin(points: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
    let each = points.len().div_ceil(MOST_POINTS).max(1);
    let greatest = |some: &[(f64, f64)]| {
        some.iter()
            .copied()
            .reduce(|a, b| if b.1 > a.1 { b } else { a })
    };
    points.chunks(each).filter_map(greatest).collect()
}

fn plots(summary: &Summary, record: &Record) -> Vec<LinePlot> {
    let many = summary.muscles.len() > 1;
    let add = |mut plot: LinePlot, what: &str, value: &dyn Fn(&Measures) -> f64| {
        for m in &summary.muscles {
            let name = match (many, what) {
                (false, what) => what.to_owned(),
                (true, "") => m.name.clone(),
                (true, what) => format!("{}: {what}", m.name),
            };
            let points = record
                .of_muscle(&m.name)
                .map(|x| (x.frame as f64, value(x)))
                .collect();
            plot = plot.with(name, thin(points));
        }
        plot
    };
    let frame = |title: &str| LinePlot::new(title, "frame");
    let volume = add(frame("Volume error, relative").logarithmic(), "", &|m| {
        m.volume_error.abs()
    });
    let mut stretch = add(frame("Edge stretch [%]"), "rms", &|m| {
        m.edge_stretch_rms * 100.0
    });
    stretch = add(stretch, "greatest", &|m| m.edge_stretch_max * 100.0);
    let depth =
        add(frame("Depth in bone [mm]"), "", &|m| m.penetration_m * 1e3).with_limit("limit", 0.01);
    let mut counts = add(frame("Vertices"), "touching", &|m| {
        m.vertices_touching as f64
    });
    counts = add(counts, "inside bones", &|m| m.vertices_inside_bones as f64);
    counts = add(counts, "bone vertices inside", &|m| {
        m.bone_vertices_inside as f64
    });
    counts = add(counts, "pinched", &|m| m.vertices_pinched as f64);
    let distance = add(frame("Distance from the start, rms [mm]"), "", &|m| {
        m.distance_from_start_rms_m * 1e3
    });
    let runs = |effect: &str| {
        summary
            .effects
            .run
            .iter()
            .any(|p| p.effect.starts_with(effect))
    };
    let mut plots = Vec::new();
    if runs("volume") {
        plots.push(volume.with_limit("limit", pliant::simulation::VOLUME_HELD));
    }
    plots.push(stretch);
    if runs("contact") {
        plots.extend([depth, counts]);
    }
    plots.extend([distance, times(record)]);
    plots
}

fn times(record: &Record) -> LinePlot {
    let mut plot = LinePlot::new("Time of each effect, summed over muscles [ms]", "frame");
    let effects: BTreeSet<&str> = record
        .times
        .iter()
        .flat_map(|t| t.effects_ms.keys().copied())
        .collect();
    for effect in effects {
        let ms = |t: &super::record::FrameTimes| t.effects_ms.get(effect).copied().unwrap_or(0.0);
        plot = plot.with(
            effect,
            thin(
                record
                    .times
                    .iter()
                    .map(|t| (t.frame as f64, ms(t)))
                    .collect(),
            ),
        );
    }
    plot
}

/// The text of a table cell for a muscle.
type Shown = fn(&MuscleSummary) -> String;

/// The rows of the table of muscles.
const ROWS: [(&str, Shown); 17] = [
    ("vertices", |m| m.vertices.to_string()),
    ("triangles", |m| m.triangles.to_string()),
    ("vertices held by bones", |m| {
        m.vertices_attached.to_string()
    }),
    ("length [mm]", |m| format!("{:.1}", m.length_m * 1e3)),
    ("volume error, greatest", |m| {
        format!("{:.1e}", m.volume_error_max)
    }),
    ("edge stretch rms, worst frame [%]", |m| {
        format!("{:.2}", m.edge_stretch_rms_worst * 100.0)
    }),
    ("worst frame", |m| m.worst_frame.to_string()),
    ("edge stretch rms, end [%]", |m| {
        format!("{:.2}", m.edge_stretch_rms_end * 100.0)
    }),
    ("depth in bones, greatest [mm]", |m| {
        format!("{:.4}", m.penetration_max_m * 1e3)
    }),
    ("vertices inside bones, most", |m| {
        m.vertices_inside_bones_max.to_string()
    }),
    ("bone vertices inside, most", |m| {
        m.bone_vertices_inside_max.to_string()
    }),
    ("vertices touching bone, most", |m| {
        m.vertices_touching_max.to_string()
    }),
    ("vertices pinched, most", |m| {
        m.vertices_pinched_max.to_string()
    }),
    ("overlap before the start [mm]", |m| {
        format!("{:.3}", m.start_overlap_m * 1e3)
    }),
    ("distance from the start, end, rms [mm]", |m| {
        format!("{:.3}", m.distance_from_start_rms_m * 1e3)
    }),
    ("residual, greatest [mm]", |m| {
        format!("{:.4}", m.residual_max_m * 1e3)
    }),
    ("frames not converged", |m| {
        m.frames_not_converged.to_string()
    }),
];

fn tables(summary: &Summary, settings: &[(String, String)]) -> Vec<Table> {
    let heads = std::iter::once("").chain(summary.muscles.iter().map(|m| m.name.as_str()));
    let mut muscles = Table::new("Muscles", heads);
    for (name, value) in ROWS {
        muscles.row(std::iter::once(name.to_owned()).chain(summary.muscles.iter().map(value)));
    }
    let [ran, out] = of_effects("muscle", &summary.effects.run, &summary.effects.left_out);
    let mut measured = Table::new(
        "Time measured, all frames and muscles",
        ["effect", "seconds"],
    );
    for (effect, seconds) in &summary.time.effects_s {
        measured.row([(*effect).to_owned(), format!("{seconds:.3}")]);
    }
    measured.row([
        "audit of each frame".to_owned(),
        format!("{:.3}", summary.time.audit_s),
    ]);
    measured.row([
        "reading and making ready".to_owned(),
        format!("{:.3}", summary.time.prepare_s),
    ]);
    measured.row([
        "files after the last frame".to_owned(),
        format!("{:.3}", summary.time.finish_s),
    ]);
    let mut set = Table::new("Settings", ["what", "value"]);
    set.row(["solver".to_owned(), summary.solver.clone()]);
    settings
        .iter()
        .for_each(|(what, value)| set.row([what.clone(), value.clone()]));
    [muscles, ran, measured, out, set]
        .into_iter()
        .filter(|t| !t.rows.is_empty())
        .collect()
}

/// The table of effects that ran and did not run; `of` is the header of the first column.
pub(super) fn of_effects(of: &str, run: &[Planned], left_out: &[LeftOut]) -> [Table; 2] {
    let all = |muscle: &str| {
        if muscle.is_empty() {
            "(all)".to_owned()
        } else {
            muscle.to_owned()
        }
    };
    let mut ran = Table::new(
        "Effects that ran",
        [of, "effect", "elements", "bytes", "estimated ms a frame"],
    );
    for p in run {
        let ms = format!("{:.2}", p.ms_per_frame);
        ran.row([
            all(&p.muscle),
            p.effect.clone(),
            p.elements.to_string(),
            p.bytes.to_string(),
            ms,
        ]);
    }
    let mut out = Table::new(
        "Effects left out: no memory, no time",
        [of, "effect", "why"],
    );
    for l in left_out {
        out.row([all(&l.muscle), l.effect.clone(), l.why.clone()]);
    }
    [ran, out]
}
