//! Files of a sweep of a joint: curves as tables and plots, fibres for ParaView, pictures, a page.

mod opensim;
mod poses;

use nalgebra::{Isometry3, Point3, Vector3};
use serde_json::{Value, json};

use super::folder::{Folder, FolderError};
use super::muscles::across_check;
use super::output::{DataFile, OutputFile, Picture, Plot, RunOutput, Verdict};
use super::{LinePlot, Series, Table};
use pliant::fibres::length;
use pliant::format::number;
use pliant::io::file_name;
use pliant::io::pvd::{Collection, Entry};
use pliant::io::vtp::{self, PolyData};
use pliant::mesh::TriangleMesh;
use pliant::moment_arms::{Arms, CrossingMuscle, MuscleStepper, SweepRun, extremes};
use pliant::opensim::paths::MOST_ORDER;
use pliant_render::{
    Camera, Canvas, Drawing, Frame, Lines, PictureError, Rgb, Surface, View, render,
};

/// Width and height of a picture \[px\].
const SIZE: (u32, u32) = (620, 620);
const BONE: Rgb = [0.86, 0.83, 0.76];
/// Colours of muscles, in order, distinguishable with any colour vision.
const MUSCLES: [Rgb; 5] = [
    [0.80, 0.33, 0.22],
    [0.17, 0.45, 0.75],
    [0.16, 0.55, 0.33],
    [0.60, 0.40, 0.60],
    [0.75, 0.58, 0.05],
];
/// Margin around the muscles in a picture, relative to their extent.
const AROUND: f64 = 0.15;

pub use opensim::OpenSimNames;
pub use poses::{Posed, output_of_poses};

/// Parameters of the sweep, for the report.
#[derive(Clone, Debug)]
pub struct Swept {
    /// Name of the scene.
    pub scene: String,
    /// Name of the joint.
    pub joint: String,
    /// Name of the angle in tables.
    pub coordinate: String,
    /// Method that moved the muscles.
    pub by: MuscleStepper,
    /// Time [s].
    pub time_s: f64,
    /// True if the user stopped the sweep.
    pub interrupted: bool,
    /// Names of a model of OpenSim, if paths for it are written.
    pub opensim: Option<OpenSimNames>,
}

/// Writes the fibres at the last angle, for ParaView, and adds them to the series.
///
/// # Errors
/// A file that cannot be written.
pub fn write_fibres(
    folder: &Folder,
    running: &SweepRun,
    (k, time): (usize, f64),
    series: &mut Collection,
) -> Result<(), FolderError> {
    let (mut points, mut lines) = (Vec::<Point3<f64>>::new(), Vec::<Vec<u32>>::new());
    let (mut of, mut stretch) = (Vec::new(), Vec::new());
    for (m, muscle) in running.muscles.iter().enumerate() {
        for (now, rest) in muscle.now().iter().zip(&muscle.fibres) {
            let first = points.len() as u32;
            lines.push((first..first + now.len() as u32).collect());
            points.extend(now);
            of.extend(now.iter().map(|_| m as f64));
            stretch.extend(now.iter().map(|_| length(now) / length(rest)));
        }
    }
    let file = format!("frames/fibres_{k:06}.vtp");
    let point_data = vec![("muscle", of), ("length over that at rest", stretch)];
    put(
        folder,
        &file,
        &PolyData {
            points: &points,
            lines: &lines,
            point_data,
            ..PolyData::default()
        },
    )?;
    series.push(Entry {
        time,
        part: 0,
        name: "fibres".to_owned(),
        file,
    });
    for (b, body) in running.simulation.bodies.iter().enumerate() {
        let file = format!("frames/{}_{k:06}.vtp", file_name(&body.name));
        let data = PolyData {
            points: &body.system.particles.position,
            triangles: &body.rest.triangles,
            ..PolyData::default()
        };
        put(folder, &file, &data)?;
        series.push(Entry {
            time,
            part: 1 + b,
            name: body.name.clone(),
            file,
        });
    }
    Ok(())
}

fn put(folder: &Folder, file: &str, data: &PolyData<'_>) -> Result<(), FolderError> {
    let path = folder.claim(file)?;
    vtp::write(&path, data).map_err(|source| FolderError::Io { path, source })
}

/// Bones at the last angle.
fn bones(running: &SweepRun) -> Vec<TriangleMesh> {
    let frame = running.simulation.frame() as f64;
    let posed = |(b, mesh): (usize, &TriangleMesh)| {
        let pose: Isometry3<f64> = running.simulation.pose(b, frame);
        TriangleMesh {
            vertices: mesh.vertices.iter().map(|v| pose * v).collect(),
            triangles: mesh.triangles.clone(),
        }
    };
    running
        .simulation
        .bones
        .iter()
        .enumerate()
        .map(posed)
        .collect()
}

/// A picture of the fibres among the bones at the last angle, along the joint's axis.
pub fn picture(running: &SweepRun) -> Frame {
    let axis = running.joint.axis.into_inner();
    // From the side of the joint relative to the bones' centre, so that the muscles are in front.
    let bones = bones(running);
    let middle = bones
        .iter()
        .flat_map(|b| &b.vertices)
        .map(|v| v.coords)
        .sum::<Vector3<f64>>()
        / bones.iter().map(|b| b.vertices.len()).sum::<usize>().max(1) as f64;
    let side = if axis.dot(&(running.joint.centre.coords - middle)) >= 0.0 {
        1.0
    } else {
        -1.0
    };
    let up = if axis.y.abs() < 0.9 {
        Vector3::y()
    } else {
        Vector3::z()
    };
    let view = View::orthographic(axis * side, up);
    let rest = running
        .muscles
        .iter()
        .flat_map(|m| m.fibres.iter().flatten().copied());
    let turned_by = [0, running.angles.len() - 1].map(|k| running.displacement(k));
    let turned: Vec<Point3<f64>> = rest.flat_map(|p| turned_by.map(|pose| pose * p)).collect();
    let bounds = pliant::mesh::measures::Aabb::of_points(&turned);
    let bounds = bounds.inflate(AROUND * bounds.extents().amax());
    let camera = Camera::fit(bounds.corners(), &view, Canvas::new(SIZE.0, SIZE.1));
    let surfaces = bones
        .iter()
        .map(|b| Surface::plain(&b.vertices, &b.triangles, BONE).with_opacity(0.45));
    let mut drawing = Drawing::of(surfaces);
    for (m, muscle) in running.muscles.iter().enumerate() {
        drawing = drawing.with_lines(Lines::new(muscle.now(), MUSCLES[m % MUSCLES.len()]));
    }
    render(&drawing, &camera)
}

/// Measures of the sweep.
fn to_json(swept: &Swept, running: &SweepRun, arms: &[Arms]) -> Value {
    let muscles: Vec<Value> = arms
        .iter()
        .zip(&running.muscles)
        .map(|(a, m)| of_muscle(a, m))
        .collect();
    json!({
        "joint": swept.joint,
        "coordinate": swept.coordinate,
        "motion": if swept.by == MuscleStepper::Spread { "spread" } else { "scene" },
        "from_deg": running.angles[0].to_degrees(),
        "to_deg": running.angles[running.angles.len() - 1].to_degrees(),
        "values": running.angles.len(),
        "values_done": running.done(),
        "left_out": running.left_out,
        "muscles": muscles,
    })
}

fn of_muscle(arms: &Arms, muscle: &CrossingMuscle) -> Value {
    let compared = arms.compared.iter().zip(&arms.straight_overlaps).map(
        |((file, reference, found), straight)| {
            json!({
                "straight_overlap": straight,
                "reference": file,
                "curves": reference.names,
                "overlap": found.as_ref().and_then(|f| f.overlap),
                "difference_mean_m": found.as_ref().map(|f| f.difference_mean_m),
                "difference_max_m": found.as_ref().map(|f| f.difference_max_m),
                "range_deg": found.as_ref().map(|f| f.range_rad.map(f64::to_degrees)),
                "sign_turned": found.as_ref().is_some_and(|f| f.turned),
            })
        },
    );
    let [least, most] = extremes(arms.mean.iter().copied()).unwrap_or([f64::NAN; 2]);
    json!({
        "muscle": arms.name,
        "fibres": arms.fibres.len(),
        "coverage": muscle.quality.coverage,
        "length_mean_at_rest_m": muscle.quality.length_mean_m,
        "pennation_mean_deg": muscle.quality.pennation_mean_rad.to_degrees(),
        "cross_section_m2": muscle.physiological_area,
        "moment_arm_least_m": least,
        "moment_arm_greatest_m": most,
        "moment_arm_mean_m": arms.mean.iter().sum::<f64>() / arms.mean.len() as f64,
        "roughness_rms": arms.roughness.map(|r| r.rms),
        "roughness_max": arms.roughness.map(|r| r.max),
        "length_roughness_max": arms.length_roughness.map(|r| r.max),
        "points_in_bone": muscle.points_in_bone,
        "point_depth_max_m": muscle.depth,
        "vertex_depth_max_m": muscle.vertex_depth,
        "volume_error_max": muscle.volume_error,
        "values_not_converged": muscle.unconverged,
        "stopped_at_frame": muscle.stopped.as_ref().map(|s| s.0),
        "compared": compared.collect::<Vec<_>>(),
    })
}

/// Writes all files except the frames.
///
/// # Errors
/// A picture that cannot be encoded.
pub fn output<'a>(
    swept: &'a Swept,
    running: &SweepRun,
    arms: &'a [Arms],
    series: Collection,
    pictures: &[(String, Frame)],
) -> Result<RunOutput<'a>, PictureError> {
    let of_muscle = |a: &Arms| Plot {
        file: Some(format!("{}.svg", file_name(&a.name))),
        plot: plot(a),
    };
    let lengths = Plot {
        file: None,
        plot: lengths(arms),
    };
    let mut tables = vec![table(running, arms)];
    if arms.iter().any(|a| !a.compared.is_empty()) {
        tables.push(comparisons(arms));
    }
    let names = swept.opensim.as_ref();
    let samples = names.map_or(Vec::new(), |names| names.samples(arms));
    let (paths, findings) = opensim::fit(&samples, MOST_ORDER);
    let mut measures = to_json(swept, running, arms);
    if names.is_some() {
        tables.push(opensim::table(&paths));
        measures["opensim"] = opensim::to_json(&paths);
    }
    let mut files = vec![OutputFile::new("fibres.pvd", move |path| {
        series.write(path)
    })];
    if names.is_some() {
        files.extend(opensim::files(&swept.scene, paths, samples, None));
    }
    Ok(RunOutput {
        kind: "moment_arms",
        name: swept.scene.clone(),
        measures,
        findings,
        verdicts: verdicts(running, arms),
        notes: notes(running, arms),
        interrupted: swept.interrupted,
        time_s: swept.time_s,
        title: format!(
            "{}: moment arms about the joint {}",
            swept.scene, swept.joint
        ),
        text: format!(
            "{}: {} of {} angles about the joint {} in {:.1} s\n",
            swept.scene,
            running.done(),
            running.angles.len(),
            swept.joint,
            swept.time_s
        ),
        tables_of_text: tables.len(),
        tables,
        plots_title: "Over the angle".to_owned(),
        plots: arms.iter().map(of_muscle).chain([lengths]).collect(),
        pictures: encoded(pictures)?,
        explanations: explanations(swept.by),
        data: vec![means(arms), each(arms)],
        files,
        ..RunOutput::default()
    })
}

/// Pictures as files.
fn encoded(pictures: &[(String, Frame)]) -> Result<Vec<Picture>, PictureError> {
    let picture = |(k, (caption, frame)): (usize, &(String, Frame))| {
        Ok(Picture {
            file: format!("picture_{k}.png"),
            caption: caption.clone(),
            bytes: frame.to_png()?,
            wide: false,
        })
    };
    pictures.iter().enumerate().map(picture).collect()
}

/// Greatest difference of a moment arm from that of straight lines which no bone blocks, relative to the
/// greatest of theirs: beyond it the muscle bends away from nothing, or its ends are the wrong ones.
const OFF_STRAIGHT: f64 = 0.75;

/// Whether each muscle was moved through all angles, and as its ends say.
fn verdicts(running: &SweepRun, arms: &[Arms]) -> Vec<Verdict> {
    let mut all = Vec::new();
    for (body, (m, arms)) in running.muscles.iter().zip(arms).enumerate() {
        let at = match &m.stopped {
            None => m.name.clone(),
            Some((frame, why)) => format!("{}, frame {frame}: {why:?}", m.name),
        };
        let moved = "the muscle moves without being stopped";
        all.push(Verdict::new(moved, m.stopped.is_none()).at(at));
        all.extend(across_check(&running.simulation, body, &m.name));
        let unconverged = Verdict::none("angles that did not converge", m.unconverged);
        let cure = "forces, volume or depth are above their tolerances there; turn by smaller steps (`--step`)";
        all.push(unconverged.at(m.name.as_str()).else_do(cure));
        all.extend(straight_verdict(arms.off_straight(), &m.name));
    }
    all
}

/// Whether a muscle bends away from nothing.
fn straight_verdict(off: Option<f64>, muscle: &str) -> Option<Verdict> {
    let name =
        "difference from straight lines that no bone blocks, relative to their greatest moment arm";
    let cure = "look at the pictures: wrong ends, or a muscle that folds";
    let verdict = Verdict::at_most(name, off?, OFF_STRAIGHT);
    Some(verdict.at(muscle).else_do(cure))
}

/// A row for each muscle and angle.
fn means(arms: &[Arms]) -> DataFile<'_> {
    let columns = [
        "muscle",
        "angle_deg",
        "length_mean_m",
        "moment_arm_mean_m",
        "moment_arm_least_m",
        "moment_arm_greatest_m",
        "straight_m",
    ];
    let rows = arms.iter().flat_map(|a| {
        a.angles.iter().enumerate().map(move |(k, angle)| {
            let [least, most] = a.bounds(k);
            let angle = angle.to_degrees();
            let numbers = [angle, a.length[k], a.mean[k], least, most, a.straight[k]];
            let cells = numbers.iter().map(f64::to_string);
            std::iter::once(a.name.clone()).chain(cells).collect()
        })
    });
    DataFile::new("moment_arms.csv", columns, rows)
}

/// A row for each fibre and angle.
fn each(arms: &[Arms]) -> DataFile<'_> {
    let columns = ["muscle", "fibre", "angle_deg", "length_m", "moment_arm_m"];
    let rows = arms.iter().flat_map(|a| {
        let fibres = a.lengths.iter().zip(&a.fibres).enumerate();
        fibres.flat_map(move |(f, (lengths, arms))| {
            let values = a.angles.iter().zip(lengths.iter().zip(arms));
            values.map(move |(angle, (length, arm))| {
                let numbers = [angle.to_degrees(), *length, *arm].map(|n| n.to_string());
                [a.name.clone(), f.to_string()]
                    .into_iter()
                    .chain(numbers)
                    .collect()
            })
        })
    });
    DataFile::new("fibres.csv", columns, rows)
}

/// A plot of a muscle's moment arms with the published ones.
fn plot(a: &Arms) -> LinePlot {
    let over = |values: &dyn Fn(usize) -> f64| -> Vec<(f64, f64)> {
        a.angles
            .iter()
            .enumerate()
            .map(|(k, q)| (q.to_degrees(), 1e3 * values(k)))
            .collect()
    };
    let mut plot = LinePlot::new(format!("{}: moment arm [mm]", a.name), "angle [degrees]")
        .with("mean of the fibres", over(&|k| a.mean[k]))
        .with("least fibre", over(&|k| a.bounds(k)[0]))
        .with("greatest fibre", over(&|k| a.bounds(k)[1]))
        .with("straight lines", over(&|k| a.straight[k]));
    for (file, reference, compared) in &a.compared {
        let sign = if compared.as_ref().is_some_and(|c| c.turned) {
            -1.0
        } else {
            1.0
        };
        for (side, name) in ["least", "greatest"]
            .iter()
            .enumerate()
            .take(reference.count().min(2))
        {
            let points = a
                .angles
                .iter()
                .filter_map(|q| Some((q.to_degrees(), 1e3 * sign * reference.at(*q)?[side])));
            let name = if reference.count() > 1 {
                format!("{file}, {name}")
            } else {
                file.clone()
            };
            plot.series.push(Series::new(name, points));
        }
    }
    plot
}

fn lengths(arms: &[Arms]) -> LinePlot {
    let mut plot = LinePlot::new("Mean length of the fibres [mm]", "angle [degrees]");
    for a in arms {
        let points = a
            .angles
            .iter()
            .zip(&a.length)
            .map(|(q, l)| (q.to_degrees(), 1e3 * l));
        plot.series.push(Series::new(a.name.clone(), points));
    }
    plot
}

/// The table of the curves.
fn table(running: &SweepRun, arms: &[Arms]) -> Table {
    let title = "Moment arms, mean of the fibres";
    let header = [
        "muscle",
        "least [mm]",
        "greatest [mm]",
        "rough (rms) [%]",
        "points in bone",
        "fibre [mm]",
        "area [cm2]",
    ];
    let mut table = Table::new(title, header);
    for (a, m) in arms.iter().zip(&running.muscles) {
        let ends = extremes(a.mean.iter().copied());
        let of = |k: usize| ends.map_or("-".into(), |ends| number(1e3 * ends[k]));
        table.row([
            a.name.clone(),
            of(0),
            of(1),
            a.roughness.map_or("-".to_owned(), |r| number(1e2 * r.rms)),
            m.points_in_bone.to_string(),
            number(1e3 * m.quality.length_mean_m),
            number(1e4 * m.physiological_area),
        ]);
    }
    table
}

/// The table of the comparisons with published values.
fn comparisons(arms: &[Arms]) -> Table {
    let header = [
        "muscle",
        "reference",
        "curves",
        "overlap [%]",
        "mean difference [mm]",
        "greatest [mm]",
        "from",
        "to",
    ];
    let mut table = Table::new("Beside others", header);
    for a in arms {
        for (file, reference, found) in &a.compared {
            let or_dash =
                |v: Option<f64>, scale: f64| v.map_or("-".to_owned(), |v| number(scale * v));
            let angle =
                |k: usize| or_dash(found.as_ref().map(|f| f.range_rad[k].to_degrees()), 1.0);
            table.row([
                a.name.clone(),
                file.clone(),
                reference.count().to_string(),
                or_dash(found.as_ref().and_then(|f| f.overlap), 1e2),
                or_dash(found.as_ref().map(|f| f.difference_mean_m), 1e3),
                or_dash(found.as_ref().map(|f| f.difference_max_m), 1e3),
                angle(0),
                angle(1),
            ]);
        }
    }
    table
}

/// Notes for the reader.
fn notes(running: &SweepRun, arms: &[Arms]) -> Vec<String> {
    let mut notes = running.simulation.notes.clone();
    if !running.left_out.is_empty() {
        notes.push(format!(
            "not over this joint, and left out: {}",
            running.left_out.join(", ")
        ));
    }
    for m in &running.muscles {
        if m.points_in_bone > 0 {
            notes.push(format!(
                "{}: {} points of fibres over all angles lie in a bone, the deepest {} mm; near where the muscle is held \
                 by a bone that it overlaps, its fibres do too",
                m.name,
                m.points_in_bone,
                number(1e3 * m.depth)
            ));
        }
    }
    let turned = arms
        .iter()
        .flat_map(|a| a.compared.iter().map(move |c| (&a.name, c)));
    for (name, (file, _, found)) in turned {
        if found.as_ref().is_some_and(|f| f.turned) {
            notes.push(format!(
                "{name}: {file} has the other sign throughout, and is compared with its sign turned"
            ));
        }
    }
    notes
}

fn explanations(by: MuscleStepper) -> Vec<String> {
    vec![
        "Moment arms are -dL/dq: positive where pulling turns the joint towards greater angles. L is the length of a fibre \
         inside the muscle, without tendons, which are as long at every angle."
            .to_owned(),
        match by {
            MuscleStepper::Spread => "Every vertex of a muscle turns about the joint by a share of its angle: what lies on a bone goes with it, \
                           between bones the turn spreads evenly. From there tone, bones and volume bring the muscle to rest."
                .to_owned(),
            MuscleStepper::Scene => "The scene's solver moves the muscles.".to_owned(),
        },
    ]
}
