//! Files of a geometric muscle: mesh, picture, animation, table over its range of lengths.

use std::io::{self, Write};

use nalgebra::Vector3;

use super::folder::{Folder, FolderError};
use super::{LinePlot, Report, Series, Table};
use pliant::format::number;
use pliant::geometric::file::Muscle;
use pliant::geometric::pose::{Pose, at, cycle};
use pliant::io::names::file_name;
use pliant::io::pvd::{Collection, Entry};
use pliant::io::vtp::{self, PolyData};
use pliant_render::{Camera, Canvas, Drawing, Frame, Lines, Rgb, Surface, View, render, to_gif};

/// Number of lengths in the table.
const ROWS: u32 = 100;
/// Width and height of a picture \[px\].
const SIZE: (u32, u32) = (800, 560);
const FLESH: Rgb = [0.72, 0.25, 0.22];
const BONE: Rgb = [0.35, 0.33, 0.30];
/// Pictures per second of an animation.
const RATE: f64 = 24.0;

/// Writes all files, with `frames` pictures of an animation if requested.
///
/// # Errors
/// A file that cannot be written.
pub fn write(
    folder: &Folder,
    name: &str,
    muscle: &Muscle,
    frames: Option<u32>,
    summary: &serde_json::Value,
) -> Result<(), FolderError> {
    let pose = Pose::of(muscle);
    let poses = frames.map_or(Vec::new(), |count| cycle(muscle, count));
    put(folder, "muscle.vtp", &pose)?;
    let camera = camera(poses.iter().chain([&pose]));
    let mut pictures = Vec::new();
    let png = draw(&pose, &camera).to_png()?;
    folder.write("muscle.png", |w| w.write_all(&png))?;
    pictures.push((
        format!("at a length of {}", number(pose.length / muscle.unit)),
        png,
    ));
    if !poses.is_empty() {
        let file = file_name(name);
        let mut series = Collection::new();
        for (k, pose) in poses.iter().enumerate() {
            let path = format!("frames/{file}_{k:06}.vtp");
            put(folder, &path, pose)?;
            series.push(Entry {
                time: k as f64 / RATE,
                part: 0,
                name: file.clone(),
                file: path,
            });
        }
        let path = folder.claim(&format!("{file}.pvd"))?;
        series
            .write(&path)
            .map_err(|source| FolderError::Io { path, source })?;
        let drawn: Vec<Frame> = poses.iter().map(|pose| draw(pose, &camera)).collect();
        let gif = to_gif(&drawn, 1.0 / RATE)?;
        folder.write(&format!("{file}.gif"), |w| w.write_all(&gif))?;
        pictures.push(("over all lengths that it can take".to_owned(), gif));
    }
    let [least, most] = muscle.range;
    let table = at(
        muscle,
        (0..=ROWS).map(|k| least + (most - least) * f64::from(k) / f64::from(ROWS)),
    );
    folder.write("lengths.csv", |w| write_lengths(w, &table))?;
    let json = serde_json::to_string_pretty(summary).unwrap_or_default();
    folder.write("summary.json", |w| w.write_all(json.as_bytes()))?;
    let report = Report {
        pictures,
        ..report(name, muscle, &pose, &table)
    };
    folder.write("report.html", |w| w.write_all(report.to_html().as_bytes()))
}

fn put(folder: &Folder, file: &str, pose: &Pose) -> Result<(), FolderError> {
    let mut points = pose.mesh.vertices.clone();
    let mut lines = Vec::new();
    for bar in &pose.bars {
        let first = points.len() as u32;
        lines.push((first..first + bar.len() as u32).collect::<Vec<u32>>());
        points.extend(bar);
    }
    let path = folder.claim(file)?;
    let data = PolyData {
        points: &points,
        triangles: &pose.mesh.triangles,
        lines: &lines,
        point_data: Vec::new(),
    };
    vtp::write(&path, &data).map_err(|source| FolderError::Io { path, source })
}

fn camera<'a>(poses: impl Iterator<Item = &'a Pose>) -> Camera {
    let view = View::orthographic(Vector3::z(), Vector3::y());
    let all = poses.flat_map(|p| {
        p.mesh
            .vertices
            .iter()
            .chain(p.bars.iter().flatten())
            .copied()
    });
    Camera::fit(all, &view, Canvas::new(SIZE.0, SIZE.1))
}

fn draw(pose: &Pose, camera: &Camera) -> Frame {
    let surface = Surface::plain(&pose.mesh.vertices, &pose.mesh.triangles, FLESH);
    let mut bars = Lines::new(&pose.bars, BONE);
    bars.width = 7.0;
    render(&Drawing::of([surface]).with_lines(bars), camera)
}

fn write_lengths(w: &mut impl Write, poses: &[Pose]) -> io::Result<()> {
    writeln!(w, "length_m,radius_max_m,volume_error,joint_angle_rad")?;
    for p in poses {
        let angle = p.joint_angle.map_or(String::new(), |a| a.to_string());
        writeln!(w, "{},{},{},{angle}", p.length, p.radius, p.volume_error)?;
    }
    Ok(())
}

fn report(name: &str, muscle: &Muscle, pose: &Pose, poses: &[Pose]) -> Report {
    let unit = |value: f64| value / muscle.unit;
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
    let facts = format!(
        "Length {} of {} at rest, from {} to {}; lengths are in the unit of the file. The volume differs by {:.1e} of itself from that at rest.",
        number(unit(pose.length)),
        number(unit(rest.length)),
        number(unit(muscle.range[0])),
        number(unit(muscle.range[1])),
        pose.volume_error.abs()
    );
    Report {
        title: format!("{name}: a muscle of frusta"),
        plots_title: "Over all lengths".to_owned(),
        notes: vec![facts],
        tables: vec![nodes],
        plots,
        ..Report::default()
    }
}
