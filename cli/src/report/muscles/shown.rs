//! Plots, tables and text of a run of muscles.

use std::collections::BTreeSet;

use super::MuscleSummary;
use crate::report::record::{FrameTimes, Record};
use crate::report::{LinePlot, Table};
use pliant::format::number;
use pliant::simulation::{Measures, Plan};

/// Greatest number of points of a plotted line; a longer run shows the maximum of each few frames.
const MOST_POINTS: usize = 1000;

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

/// Plots over the frames; `target` is that of a requested accuracy [m].
pub(super) fn plots(
    muscles: &[MuscleSummary],
    plan: &Plan,
    record: &Record,
    target: Option<f64>,
) -> Vec<LinePlot> {
    let many = muscles.len() > 1;
    let add = |mut plot: LinePlot, what: &str, value: &dyn Fn(&Measures) -> f64| {
        for m in muscles {
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
    let mut stretch = add(frame("Stretch of all edges [%]"), "rms", &|m| {
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
    let error = target.map(|target| {
        let plot = frame("Estimated error, rms [mm]");
        add(plot, "", &|m| m.error_m * 1e3).with_limit("target", target * 1e3)
    });
    let mut plots = Vec::new();
    if runs(plan, "volume") {
        plots.push(volume.with_limit("limit", pliant::simulation::VOLUME_HELD));
    }
    plots.push(stretch);
    if runs(plan, "contact") {
        plots.extend([depth, counts]);
    }
    plots.extend(error);
    plots.extend([distance, times(record)]);
    plots
}

/// True if an effect whose name begins with `effect` runs.
fn runs(plan: &Plan, effect: &str) -> bool {
    plan.run.iter().any(|p| p.effect.starts_with(effect))
}

fn times(record: &Record) -> LinePlot {
    let mut plot = LinePlot::new("Time of each effect, summed over muscles [ms]", "frame");
    let effects: BTreeSet<&str> = record
        .times
        .iter()
        .flat_map(|t| t.effects_ms.keys().copied())
        .collect();
    for effect in effects {
        let ms = |t: &FrameTimes| t.effects_ms.get(effect).copied().unwrap_or(0.0);
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
const ROWS: [(&str, Shown); 24] = [
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
    ("estimated error of the solver, worst frame [mm]", |m| {
        number(m.error_estimate.solver_m * 1e3)
    }),
    ("estimated error of the mesh, worst frame [mm]", |m| {
        or_dash(m.error_estimate.mesh_m, 1e3)
    }),
    ("frames not converged", |m| {
        m.frames_not_converged.to_string()
    }),
    ("jitter while bones move steadily [mm]", |m| {
        or_dash(m.quality.jitter_m, 1e3)
    }),
    ("greatest speed over that of attachments", |m| {
        or_dash(m.quality.snap_ratio, 1.0)
    }),
    ("lift-off from bone [mm]", |m| {
        or_dash(m.quality.lift_off_m, 1e3)
    }),
    ("least thickness over that at rest", |m| {
        or_dash(m.quality.thickness_ratio_min, 1.0)
    }),
    ("greatest fold [deg]", |m| {
        or_dash(m.quality.hinge_max_deg, 1.0)
    }),
];

/// A number times `factor`; a dash for one that is not measured.
fn or_dash(value: Option<f64>, factor: f64) -> String {
    value.map_or("–".to_owned(), |value| number(value * factor))
}

/// Tables of the muscles, the times and the solver.
pub(super) fn tables(muscles: &[MuscleSummary], record: &Record, solver: &str) -> Vec<Table> {
    let heads = std::iter::once("").chain(muscles.iter().map(|m| m.name.as_str()));
    let mut of_muscles = Table::new("Muscles", heads);
    for (name, value) in ROWS {
        of_muscles.row(std::iter::once(name.to_owned()).chain(muscles.iter().map(value)));
    }
    let mut times = Table::new(
        "Time measured, all frames and muscles",
        ["effect", "seconds"],
    );
    for (effect, seconds) in record.effects_s() {
        times.row([(*effect).to_owned(), format!("{seconds:.3}")]);
    }
    let audit = record.times.iter().map(|t| t.audit_ms).sum::<f64>() * 1e-3;
    times.row(["audit of each frame".to_owned(), format!("{audit:.3}")]);
    let mut set = Table::new("Solver", ["what", "value"]);
    set.row(["solver", solver]);
    vec![of_muscles, times, set]
}

/// The estimated error of the positions by its parts. What is not estimated names the command that does it.
pub(super) fn error_table(muscles: &[MuscleSummary]) -> Table {
    let heads = std::iter::once("part").chain(muscles.iter().map(|m| m.name.as_str()));
    let mut table = Table::new("Estimated error of the positions, worst frame", heads);
    let or = |value: Option<f64>, command: &str| match value {
        Some(metres) => number(metres * 1e3),
        None => format!("not estimated: {command}"),
    };
    let mut row = |name: String, of: &dyn Fn(&MuscleSummary) -> String| {
        table.row(std::iter::once(name).chain(muscles.iter().map(of)));
    };
    row("solver [mm]".to_owned(), &|m| {
        number(m.error_estimate.solver_m * 1e3)
    });
    row("found by".to_owned(), &|m| {
        m.error_estimate.method.to_owned()
    });
    row(
        "solver, share of the muscle's length [%]".to_owned(),
        &|m| number(m.error_estimate.solver_m / m.length_m * 100.0),
    );
    row("mesh [mm]".to_owned(), &|m| {
        or(m.error_estimate.mesh_m, "run with --mesh-error")
    });
    row("values of the scene [mm]".to_owned(), &|m| {
        or(
            m.error_estimate.parameters_m,
            "see pliant sensitivities SCENE",
        )
    });
    table
}

/// One line for each muscle.
pub(super) fn text(muscles: &[MuscleSummary]) -> String {
    let mut text = String::from("\n");
    for m in muscles {
        let of_mesh = m.error_estimate.mesh_m.map_or(String::new(), |mesh_m| {
            format!(", {} mm by the mesh", number(mesh_m * 1e3))
        });
        text.push_str(&format!(
            "  {}: {} vertices, {} held; edge stretch rms {:.2} % at worst (frame {}), {:.2} % at the end; \
             estimated error {} mm (by {}){of_mesh}\n",
            m.name,
            m.vertices,
            m.vertices_attached,
            m.edge_stretch_rms_worst * 100.0,
            m.worst_frame,
            m.edge_stretch_rms_end * 100.0,
            number(m.error_estimate.solver_m * 1e3),
            m.error_estimate.method
        ));
    }
    text
}
