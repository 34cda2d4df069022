//! The intervals of a result: tables, CSV, surfaces coloured by what is known of them, JSON and a page.

use serde_json::{Value, json};

use super::Table;
use super::output::{DataFile, OutputFile, Picture, RunOutput, Verdict};
use nalgebra::Vector3;
use pliant::format::number;
use pliant::io::file_name;
use pliant::io::vtp::{self, PolyData};
use pliant::mesh::TriangleMesh;
use pliant::mesh::measures::max_or_nan;
use pliant::morph::axes;
use pliant::scene::Uncertain;
use pliant::simulation::{Sensitivities, UncertainMeasure};
use pliant_render::{
    Camera, Canvas, ColourMap, Drawing, Frame, Legend, PictureError, Surface, TextStyle, View,
    render,
};

/// Width and height of a picture \[px\].
const SIZE: (u32, u32) = (520, 480);

/// A surface is open if the sum of its triangles' normals is above this share of that of their sizes,
/// and is seen this much from the side.
const FACING: f64 = 0.2;
const TILT: f64 = 0.6;

/// Measures by the end of their names: the unit in tables and the factor to it.
const UNITS: [(&str, &str, f64); 6] = [
    ("_m2", "cm2", 1e4),
    ("_m3", "cc", 1e6),
    ("_pa", "kPa", 1e-3),
    ("_n", "N", 1.0),
    ("_m", "mm", 1e3),
    ("", "", 1.0),
];

/// The words of a measure, its unit in tables and the factor to it.
pub(super) fn shown(name: &str) -> (String, &'static str, f64) {
    let unit = UNITS.iter().find(|(end, ..)| name.ends_with(end));
    let (end, unit, factor) = unit.copied().unwrap_or(("", "", 1.0));
    let words = name.strip_suffix(end).unwrap_or(name);
    (words.replace('_', " "), unit, factor)
}

/// Half of an interval relative to the value; NaN for a value of zero.
fn share(half: f64, value: f64) -> f64 {
    if value == 0.0 {
        f64::NAN
    } else {
        half / value.abs()
    }
}

/// Each measure with its interval.
fn intervals(found: &Sensitivities) -> Table {
    let heads = ["body", "measure", "unit", "value", "+-", "+- [%]"];
    let mut table = Table::new("Intervals (95 %)", heads);
    for measure in &found.measures {
        let (words, unit, factor) = shown(measure.name);
        let half = found.half(measure);
        table.row([
            measure.body.clone(),
            words,
            unit.to_owned(),
            number(measure.value * factor),
            number(half * factor),
            percent(share(half, measure.value)),
        ]);
    }
    table
}

fn percent(share: f64) -> String {
    if share.is_finite() {
        format!("{:.2}", share * 100.0)
    } else {
        "-".to_owned()
    }
}

/// What each value contributes to the square of each interval.
fn what_matters(found: &Sensitivities) -> Table {
    let mut heads = vec!["body".to_owned(), "measure".to_owned()];
    let keys = found.parameters.iter().map(|parameter| &parameter.key);
    heads.extend(keys.map(|key| format!("{key} [%]")));
    let mut table = Table::new("What matters: share of the interval's square", heads);
    for measure in &found.measures {
        let half = found.half(measure);
        let mut cells = vec![measure.body.clone(), shown(measure.name).0];
        let parts = found.parts(measure);
        cells.extend(parts.map(|part| percent((part / half).powi(2))));
        table.row(cells);
    }
    table
}

/// The values with an interval, and how each was followed.
fn parameters(found: &Sensitivities) -> Table {
    let mut table = Table::new("Values with an interval", ["key", "text", "followed by"]);
    for (parameter, by_runs) in found.parameters.iter().zip(&found.by_runs) {
        let by = if *by_runs {
            "two whole runs at the ends"
        } else {
            "the derivative of the equilibrium"
        };
        table.row([parameter.key.as_str(), &parameter.text, by]);
    }
    table
}

/// The elasticity: per cent of a measure for a per cent of a value.
fn elasticity(slope: f64, parameter: f64, measure: f64) -> f64 {
    slope * parameter / measure
}

fn to_json(found: &Sensitivities) -> Value {
    let parameters = found.parameters.iter().zip(&found.by_runs);
    let parameters = parameters.map(|(parameter, by_runs)| {
        json!({
            "key": parameter.key,
            "text": parameter.text,
            "value": parameter.value,
            "half": parameter.half,
            "by_runs": by_runs,
        })
    });
    let of_measure = |measure: &UncertainMeasure| {
        let each = found.parameters.iter().zip(&measure.slopes);
        let elasticities = each.map(|(p, slope)| elasticity(*slope, p.value, measure.value));
        json!({
            "body": measure.body,
            "name": measure.name,
            "value": measure.value,
            "half": found.half(measure),
            "slopes": measure.slopes,
            "changes": measure.changes,
            "elasticities": elasticities.collect::<Vec<_>>(),
            "contributions": found.parts(measure).collect::<Vec<_>>(),
        })
    };
    let bodies = found
        .bodies
        .iter()
        .map(|(name, _, halves)| json!({"body": name, "parameters_m": rms(halves)}));
    let all: Vec<f64> = found.bodies.iter().flat_map(|b| &b.2).copied().collect();
    json!({
        "frame": found.frame,
        "parameters": parameters.collect::<Vec<_>>(),
        "measures": found.measures.iter().map(of_measure).collect::<Vec<_>>(),
        "bodies": bodies.collect::<Vec<_>>(),
        "error_estimate": {
            "solver_m": null,
            "mesh_m": null,
            "parameters_m": rms(&all),
            "method": "derivative of the equilibrium by each value with an interval",
        },
        "residual": found.residual,
        "equilibrium_residual": found.left,
    })
}

pub(super) fn rms(values: &[f64]) -> f64 {
    let sum: f64 = values.iter().map(|v| v * v).sum();
    (sum / values.len().max(1) as f64).sqrt()
}

fn data(found: &Sensitivities) -> DataFile<'_> {
    let columns = [
        "body",
        "measure",
        "value",
        "half",
        "parameter",
        "parameter_value",
        "parameter_half",
        "slope",
        "elasticity",
        "change_of_run",
        "contribution",
    ];
    let rows = found.measures.iter().flat_map(move |measure| {
        let half = found.half(measure);
        let each = found.parameters.iter().zip(&measure.slopes);
        let row = move |(((p, slope), change), part): (((&Uncertain, &f64), &f64), f64)| {
            vec![
                measure.body.clone(),
                measure.name.to_owned(),
                measure.value.to_string(),
                half.to_string(),
                p.key.clone(),
                p.value.to_string(),
                p.half.to_string(),
                slope.to_string(),
                elasticity(*slope, p.value, measure.value).to_string(),
                change.to_string(),
                part.to_string(),
            ]
        };
        let each = each.zip(&measure.changes);
        each.zip(found.parts(measure)).map(row)
    });
    DataFile::new("sensitivities.csv", columns, rows)
}

/// A view across the longest extent of a closed surface, and from above on an open one.
fn view(mesh: &TriangleMesh) -> View {
    let normal = |t: usize| {
        let [a, b, c] = mesh.corners(t);
        (b - a).cross(&(c - a))
    };
    let facing: Vector3<f64> = (0..mesh.triangles.len()).map(normal).sum();
    let frame = axes(mesh);
    let [long, across] = [0, 2].map(|k| frame.column(k).into_owned());
    // Neither upside down nor from behind.
    let up = if long.y < 0.0 { -long } else { long };
    let from = if across.z < 0.0 { -across } else { across };
    match facing.norm() > FACING * mesh.area() {
        true => View::orthographic(facing.normalize() - up * TILT, up),
        false => View::orthographic(from, up),
    }
}

/// A surface coloured by lengths [m] at its vertices.
fn picture(name: &str, of: &str, mesh: &TriangleMesh, lengths: &[f64]) -> Frame {
    let of_mm: Vec<f64> = lengths.iter().map(|length| length * 1e3).collect();
    let most = max_or_nan(of_mm.iter().copied());
    let range = (0.0, if most > 0.0 { most } else { 1.0 });
    let map = ColourMap::Viridis;
    let legend = Legend::new(of, "mm", range, map);
    let room = legend.width();
    let canvas = Canvas::new(SIZE.0 + room as u32, SIZE.1);
    let canvas = canvas.with_right(room).with_top(26.0);
    let camera = Camera::fit(mesh.vertices.iter().copied(), &view(mesh), canvas);
    let surface = Surface::field(&mesh.vertices, &mesh.triangles, &of_mm, range, map);
    let mut drawn = render(&Drawing::of([surface]), &camera);
    legend.draw(&mut drawn);
    drawn.title(name, TextStyle::Small);
    drawn
}

/// Each body coloured by lengths [m] at its vertices: a picture, and a file with these as `field`. `of` has the
/// words of the legend and of the caption.
pub(super) fn surfaces<'a>(
    bodies: &'a [(String, TriangleMesh, Vec<f64>)],
    of: (&str, &str),
    field: &'a str,
) -> Result<(Vec<Picture>, Vec<OutputFile<'a>>), PictureError> {
    let (mut pictures, mut files) = (Vec::new(), Vec::new());
    for (body, mesh, lengths) in bodies {
        let file = file_name(body);
        pictures.push(Picture {
            file: format!("{file}.png"),
            caption: format!("{body}: {}", of.1),
            bytes: picture(body, of.0, mesh, lengths).to_png()?,
            wide: false,
        });
        files.push(OutputFile::new(format!("{file}.vtp"), move |path| {
            let data = PolyData {
                points: &mesh.vertices,
                triangles: &mesh.triangles,
                point_data: vec![(field, lengths.clone())],
                ..PolyData::default()
            };
            vtp::write(path, &data)
        }));
    }
    Ok((pictures, files))
}

/// The result.
///
/// # Errors
/// A picture that cannot be encoded.
pub fn output<'a>(name: &str, found: &'a Sensitivities) -> Result<RunOutput<'a>, PictureError> {
    let (pictures, files) = surfaces(
        &found.bodies,
        ("Interval +-", "interval of the position of each point"),
        "interval_m",
    )?;
    let mut findings = Vec::new();
    for (measure, parameter) in found.jumps() {
        let (words, unit, factor) = shown(measure.name);
        let k = found.parameters.iter().position(|p| p == parameter);
        let [linear, run] = k.map_or([f64::NAN; 2], |k| {
            [measure.slopes[k] * parameter.half, measure.changes[k]]
        });
        findings.push(format!(
            "{}{words}: with {} at the upper end of its interval a run changes it by {} {unit}, and the derivative says {} {unit}; \
             the interval takes the greater one",
            if measure.body.is_empty() { String::new() } else { format!("{}: ", measure.body) },
            parameter.key,
            number(run * factor),
            number(linear * factor),
        ));
    }
    let is_known = found.measures.iter().all(|m| found.half(m).is_finite());
    Ok(RunOutput {
        kind: "sensitivities",
        name: name.to_owned(),
        measures: to_json(found),
        verdicts: vec![
            Verdict::new("the equilibrium is reached", found.is_at_rest())
                .with_value(found.left)
                .else_do("its derivative is that of another state: choose a frame in which nothing slides, or other values"),
            Verdict::new("the linear system of each value is solved", found.is_solved())
                .with_value(found.residual)
                .else_do("tell the changes by runs: --runs instead"),
            Verdict::new("every interval is a number", is_known),
        ],
        findings,
        title: format!("{name}: intervals of the result"),
        subtitle: format!("equilibrium of frame {}", found.frame),
        tables_of_text: 3,
        tables: vec![parameters(found), intervals(found), what_matters(found)],
        pictures,
        explanations: vec![
            "Each value lies in its interval with a probability of 95 %, and so does each measure. The values are taken as \
             independent. A value contributes the greater one of two changes: that by the derivative, and that of a run with the \
             value at the upper end of its interval."
                .to_owned(),
        ],
        data: vec![data(found)],
        files,
        ..RunOutput::default()
    })
}

/// What a run leaves out of a scene whose values have intervals.
pub(super) fn left_out(uncertain: &[Uncertain]) -> Option<String> {
    let keys: Vec<&str> = uncertain.iter().map(|of| of.key.as_str()).collect();
    (!keys.is_empty()).then(|| {
        format!(
            "{} {} an interval, which a run leaves out: `pliant sensitivities` gives the intervals of results",
            keys.join(", "),
            if keys.len() == 1 { "has" } else { "have" }
        )
    })
}
