//! Files of a geometric muscle: mesh, picture, animation, table over its range of lengths.

use std::io;
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Duration;

use nalgebra::{Point3, Vector3};

use super::output::{DataFile, OutputFile, Picture, Plot, RunOutput, Verdict, measures};
use super::{LinePlot, Series, Table};
use pliant::format::number;
use pliant::geometric::GeometricMuscle;
use pliant::geometric::pose::{Pose, at};
use pliant::io::file_name;
use pliant::io::pvd::{Collection, Entry};
use pliant::io::vtp::{self, PolyData};
use pliant::simulation::{GeometricRun, Observer};
use pliant_render::{
    Camera, Canvas, Drawing, Frame, Lines, PictureError, Rgb, Surface, View, render, to_gif,
};
use serde::Serialize;

/// Number of lengths in the table.
const ROWS: u32 = 100;
/// Width and height of a picture \[px\].
const SIZE: (u32, u32) = (800, 560);
const FLESH: Rgb = [0.72, 0.25, 0.22];
const BONE: Rgb = [0.35, 0.33, 0.30];
/// The volume is kept to this share.
const VOLUME_HELD: f64 = 1e-9;

/// Measures of a geometric muscle.
#[derive(Serialize)]
struct Measures {
    nodes: usize,
    length_m: f64,
    length_at_rest_m: f64,
    shortest_m: f64,
    longest_m: f64,
    volume_m3: f64,
    volume_error: f64,
    radius_max_m: f64,
    radius_min_m: f64,
    joint_angle_deg: Option<f64>,
    poses: usize,
}

impl Measures {
    fn of(run: &GeometricRun, poses: usize) -> Self {
        let (muscle, pose, chain) = (&run.muscle, &run.pose, &run.muscle.chain);
        let radii = || chain.radii().iter().copied();
        Self {
            nodes: chain.radii().len(),
            length_m: chain.length(),
            length_at_rest_m: chain.rest().length,
            shortest_m: muscle.range[0],
            longest_m: muscle.range[1],
            volume_m3: chain.volume_now(),
            volume_error: chain.volume_now() / chain.volume() - 1.0,
            radius_max_m: radii().fold(0.0, f64::max),
            radius_min_m: radii().fold(f64::INFINITY, f64::min),
            joint_angle_deg: pose.joint_angle.map(f64::to_degrees),
            poses: poses.max(1),
        }
    }

    /// Lines for a terminal, lengths in the unit of the file.
    fn to_text(&self, name: &str, unit: f64) -> String {
        let length = |value: f64| number(value / unit);
        let joint = self.joint_angle_deg.map_or(String::new(), |angle| {
            format!("joint at {angle:.1} degrees\n")
        });
        format!(
            "{name}: {} nodes, length {} (from {} to {}), greatest radius {}, volume kept to {:.1e}\n{joint}",
            self.nodes,
            length(self.length_m),
            length(self.shortest_m),
            length(self.longest_m),
            length(self.radius_max_m),
            self.volume_error.abs()
        )
    }
}

/// Keeps the shapes of all frames of an animation except the last, which is the first again.
#[derive(Default)]
pub struct Animation(Vec<Pose>);

impl Observer<GeometricRun> for Animation {
    fn frame(&mut self, run: &GeometricRun, _: Duration) -> ControlFlow<()> {
        if self.0.len() < run.scene.frames {
            self.0.push(run.pose.clone());
        }
        ControlFlow::Continue(())
    }
}

/// The result: the muscle in the last frame of a run, and an animation if there is one.
///
/// # Errors
/// A picture that cannot be encoded.
pub fn output(
    run: &GeometricRun,
    animation: Option<Animation>,
) -> Result<RunOutput<'_>, PictureError> {
    let (muscle, pose, unit) = (&run.muscle, &run.pose, run.scene.unit);
    let (name, rate) = (run.scene.name.as_str(), run.scene.frame_rate);
    let poses = animation.unwrap_or_default().0;
    let camera = camera(poses.iter().chain([pose]));
    let mut pictures = vec![Picture {
        file: "muscle.png".to_owned(),
        caption: format!("at a length of {}", number(pose.length / unit)),
        bytes: draw(pose, &camera).to_png()?,
        wide: false,
    }];
    let file = file_name(name);
    if !poses.is_empty() {
        let drawn: Vec<Frame> = poses.iter().map(|pose| draw(pose, &camera)).collect();
        pictures.push(Picture {
            file: format!("{file}.gif"),
            caption: "over all lengths that it can take".to_owned(),
            bytes: to_gif(&drawn, 1.0 / rate)?,
            wide: false,
        });
    }
    let [least, most] = muscle.range;
    let share = |k: u32| least + (most - least) * f64::from(k) / f64::from(ROWS);
    let table = at(muscle, (0..=ROWS).map(share));
    let own = Measures::of(run, poses.len());
    let plot = |plot| Plot { file: None, plot };
    let volume = Verdict::at_most(
        "volume error at most 1e-9",
        own.volume_error.abs(),
        VOLUME_HELD,
    );
    Ok(RunOutput {
        kind: "biceps",
        name: name.to_owned(),
        measures: measures(&own),
        text: own.to_text(name, unit),
        verdicts: vec![volume],
        title: format!("{name}: a muscle of frusta"),
        plots_title: "Over all lengths".to_owned(),
        plots: plots(unit, &table).into_iter().map(plot).collect(),
        tables: vec![nodes(muscle, unit)],
        explanations: vec![facts(muscle, pose, unit)],
        pictures,
        data: vec![lengths(table)],
        files: files(&file, rate, pose, poses),
        ..RunOutput::default()
    })
}

/// The mesh, and a mesh for each pose of an animation with a file that lists them.
fn files<'a>(file: &str, rate: f64, pose: &'a Pose, poses: Vec<Pose>) -> Vec<OutputFile<'a>> {
    let mut all = vec![OutputFile::new("muscle.vtp", move |path| put(path, pose))];
    let (mut series, is_animated) = (Collection::new(), !poses.is_empty());
    for (k, pose) in poses.into_iter().enumerate() {
        let name = format!("frames/{file}_{k:06}.vtp");
        series.push(Entry {
            time: k as f64 / rate,
            part: 0,
            name: file.to_owned(),
            file: name.clone(),
        });
        all.push(OutputFile::new(name, move |path| put(path, &pose)));
    }
    if is_animated {
        let name = format!("{file}.pvd");
        all.push(OutputFile::new(name, move |path| series.write(path)));
    }
    all
}

/// The two bars as lines; none without a frame.
fn bars(pose: &Pose) -> Vec<Vec<Point3<f64>>> {
    match pose.bars.as_slice() {
        [] => Vec::new(),
        points => vec![points[..3].to_vec(), points[2..].to_vec()],
    }
}

fn put(path: &Path, pose: &Pose) -> io::Result<()> {
    let mut points = pose.mesh.vertices.clone();
    let mut lines = Vec::new();
    for bar in bars(pose) {
        let first = points.len() as u32;
        lines.push((first..first + bar.len() as u32).collect::<Vec<u32>>());
        points.extend(bar);
    }
    let data = PolyData {
        points: &points,
        triangles: &pose.mesh.triangles,
        lines: &lines,
        ..PolyData::default()
    };
    vtp::write(path, &data)
}

fn camera<'a>(poses: impl Iterator<Item = &'a Pose>) -> Camera {
    let view = View::orthographic(Vector3::z(), Vector3::y());
    let all = poses.flat_map(|p| p.mesh.vertices.iter().chain(&p.bars).copied());
    Camera::fit(all, &view, Canvas::new(SIZE.0, SIZE.1))
}

fn draw(pose: &Pose, camera: &Camera) -> Frame {
    let surface = Surface::plain(&pose.mesh.vertices, &pose.mesh.triangles, FLESH);
    let bars = bars(pose);
    let mut bars = Lines::new(&bars, BONE);
    bars.width = 7.0;
    render(&Drawing::of([surface]).with_lines(bars), camera)
}

/// A row for each length that the muscle can take.
fn lengths<'a>(poses: Vec<Pose>) -> DataFile<'a> {
    let columns = [
        "length_m",
        "radius_max_m",
        "volume_error",
        "joint_angle_rad",
    ];
    let row = |p: Pose| {
        let angle = p.joint_angle.map_or(String::new(), |a| a.to_string());
        let numbers = [p.length, p.radius, p.volume_error];
        let cells = numbers.iter().map(f64::to_string);
        cells.chain([angle]).collect()
    };
    DataFile::new("lengths.csv", columns, poses.into_iter().map(row))
}

/// The nodes, lengths in the unit of the file.
fn nodes(muscle: &GeometricMuscle, unit: f64) -> Table {
    let unit = |value: f64| value / unit;
    let mut nodes = Table::new(
        "Nodes",
        ["node", "place", "radius at rest", "growth", "radius"],
    );
    let (chain, rest) = (&muscle.chain, muscle.chain.rest());
    for (i, r) in chain.radii().iter().enumerate().take(200) {
        nodes.row([
            (i + 1).to_string(),
            number(unit(chain.spacing() * i as f64)),
            number(unit(rest.radii[i])),
            number(rest.growth[i]),
            number(unit(*r)),
        ]);
    }
    nodes
}

/// Radius and angle over the length, in the unit of the file.
fn plots(unit: f64, poses: &[Pose]) -> Vec<LinePlot> {
    let unit = |value: f64| value / unit;
    let radius = Series::new(
        "greatest radius",
        poses.iter().map(|p| (unit(p.length), unit(p.radius))),
    );
    let mut plots = vec![LinePlot {
        series: vec![radius],
        ..LinePlot::new("Greatest radius", "length")
    }];
    let angles: Vec<(f64, f64)> = poses
        .iter()
        .filter_map(|p| Some((unit(p.length), p.joint_angle?.to_degrees())))
        .collect();
    if !angles.is_empty() {
        let series = vec![Series::new("joint", angles)];
        plots.push(LinePlot {
            series,
            ..LinePlot::new("Angle at the joint [degrees]", "length")
        });
    }
    plots
}

fn facts(muscle: &GeometricMuscle, pose: &Pose, unit: f64) -> String {
    let unit = |value: f64| value / unit;
    let rest = muscle.chain.rest();
    format!(
        "Length {} of {} at rest, from {} to {}; lengths are in the unit of the file. The volume differs by {:.1e} of itself from that at rest.",
        number(unit(pose.length)),
        number(unit(rest.length)),
        number(unit(muscle.range[0])),
        number(unit(muscle.range[1])),
        pose.volume_error.abs()
    )
}
