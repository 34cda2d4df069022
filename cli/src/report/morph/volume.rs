//! Files of a morph by distance fields: a surface for each t, with its volume, area, pieces and
//! handles.

use nalgebra::Point3;
use serde_json::json;

use crate::report::output::{DataFile, OutputFile, Picture, Plot, RunOutput, Verdict};
use crate::report::{LinePlot, Table};
use pliant::format::number;
use pliant::io::file_name;
use pliant::io::pvd::{Collection, Entry};
use pliant::io::vtp::{self, PolyData};
use pliant::mesh::measures::max_or_nan;
use pliant::mesh::{Aabb, SurfaceTree, Topology, TriangleMesh};
use pliant::morph::axes;
use pliant_render::{
    Camera, Canvas, Drawing, Frame, PictureError, Surface, TextStyle, View, colour, render, to_gif,
};

use super::on_the_way;

/// Size of a picture of the film and of the sheet [px].
const SIZE: (u32, u32) = (300, 420);
const SHOWN: usize = 5;
const RATE: f64 = 12.0;

/// A morph by distance fields, with its shapes.
pub struct VolumeMorph<'a> {
    /// Name of the morph.
    pub name: String,
    /// The files of both surfaces.
    pub files: [String; 2],
    /// Both surfaces.
    pub meshes: [&'a TriangleMesh; 2],
    /// t and the shape there.
    pub shapes: Vec<(f64, TriangleMesh)>,
    /// Number of cells along the longest side.
    pub cells: usize,
    /// What was mended.
    pub notes: Vec<String>,
    /// Unit of all lengths; `None` for that of the files.
    pub unit: Option<&'static str>,
    /// Wall time of all of it [s].
    pub time_s: f64,
}

/// Volume, area, pieces and handles of a shape.
struct Measured {
    t: f64,
    volume: f64,
    area: f64,
    pieces: usize,
    handles: i64,
    is_closed: bool,
}

impl Measured {
    fn of(t: f64, mesh: &TriangleMesh) -> Self {
        let topology = Topology::new(mesh);
        let pieces = topology.components().count;
        Self {
            t,
            volume: mesh.volume(),
            area: mesh.area(),
            pieces,
            handles: pieces as i64 - topology.euler_characteristic() / 2,
            is_closed: topology.is_closed() && topology.is_oriented(),
        }
    }
}

impl VolumeMorph<'_> {
    /// The files besides the frames.
    pub fn files(name: &str) -> Vec<String> {
        let file = file_name(name);
        let mut all = vec![format!("{file}.pvd"), format!("{file}.gif")];
        let fixed = ["sheet.png", "measures.csv", "summary.json", "report.html"];
        all.extend(fixed.map(str::to_owned));
        all
    }

    /// Greatest distance of the vertices of a body from the shape at its end, in cells.
    fn miss(&self, side: usize) -> f64 {
        let shape = if side == 0 {
            self.shapes.first()
        } else {
            self.shapes.last()
        };
        let Some((_, shape)) = shape.filter(|(_, shape)| !shape.triangles.is_empty()) else {
            return f64::INFINITY;
        };
        let tree = SurfaceTree::new(&shape.vertices, &shape.triangles);
        let off = |p: &Point3<f64>| {
            tree.closest(p, f64::INFINITY)
                .map_or(f64::INFINITY, |found| found.distance)
        };
        max_or_nan(self.meshes[side].vertices.iter().map(off)) / self.cell()
    }

    /// Side of a cell.
    fn cell(&self) -> f64 {
        let longest = |mesh: &TriangleMesh| Aabb::of_points(&mesh.vertices).extents().max();
        max_or_nan(self.meshes.map(longest)) / self.cells as f64
    }

    /// The result.
    ///
    /// # Errors
    /// A picture that cannot be encoded.
    pub fn output(&self) -> Result<RunOutput<'_>, PictureError> {
        let measured: Vec<Measured> = self
            .shapes
            .iter()
            .map(|(t, mesh)| Measured::of(*t, mesh))
            .collect();
        let misses = [0, 1].map(|side| self.miss(side));
        let volumes: Vec<f64> = measured.iter().map(|m| m.volume).collect();
        let ends = [0, 1].map(|k| self.meshes[k].volume());
        let half = measured.iter().find(|m| (m.t - 0.5).abs() <= 1e-9);
        let size = 0.5 * (ends[0].cbrt() + ends[1].cbrt());
        let halfway = half.map(|m| m.volume / (size * size * size));
        let open = measured.iter().filter(|m| !m.is_closed).count();
        let mut verdicts = vec![
            Verdict::none("shapes that are not closed", open),
            Verdict::at_most(
                "distance of A and B from the shapes at their ends",
                max_or_nan(misses),
                1.0,
            )
            .in_unit("cells")
            .else_do("give more --cells: parts thinner than two cells are lost"),
        ];
        verdicts.extend(on_the_way(&volumes));
        let file = file_name(&self.name);
        let (film, sheet) = self.pictures()?;
        let picture = |file: String, caption: &str, bytes: Vec<u8>, wide: bool| Picture {
            file,
            caption: caption.to_owned(),
            bytes,
            wide,
        };
        let caption = "from A (t = 0) to B (t = 1), each about its own middle";
        let rows = measured.iter().map(|m| {
            let numbers = [m.t, m.volume, m.area].map(|n| n.to_string());
            let counts = [m.pieces.to_string(), m.handles.to_string()];
            numbers.into_iter().chain(counts).collect()
        });
        let rows: Vec<Vec<String>> = rows.collect();
        let list: Vec<_> = measured
            .iter()
            .map(|m| json!({"t": m.t, "volume": m.volume, "area": m.area, "pieces": m.pieces, "handles": m.handles}))
            .collect();
        Ok(RunOutput {
            kind: "morph_by_volume",
            name: self.name.clone(),
            measures: json!({
                "a": self.files[0],
                "b": self.files[1],
                "length_unit": self.unit.unwrap_or("that of the files"),
                "method": "volume",
                "cells": self.cells,
                "cell": self.cell(),
                "ends_missed_cells": misses,
                "volume_halfway_ratio": halfway,
                "shapes": list,
            }),
            verdicts,
            time_s: self.time_s,
            title: format!("{}: a morph by distance fields", self.name),
            subtitle: format!("{} to {}", self.files[0], self.files[1]),
            tables_of_text: 1,
            tables: vec![table(&measured)],
            plots_title: "Over t".to_owned(),
            plots: vec![Plot {
                file: None,
                plot: plot(&measured),
            }],
            pictures: vec![
                picture(format!("{file}.gif"), "over t", film, false),
                picture("sheet.png".to_owned(), caption, sheet, true),
            ],
            notes: self.notes.clone(),
            data: vec![DataFile::new(
                "measures.csv",
                ["t", "volume", "area", "pieces", "handles"],
                rows.into_iter(),
            )],
            files: self.frames(&file),
            ..RunOutput::default()
        })
    }

    fn frames(&self, file: &str) -> Vec<OutputFile<'_>> {
        let (mut files, mut series) = (Vec::new(), Collection::new());
        for (k, (t, mesh)) in self.shapes.iter().enumerate() {
            let path = format!("frames/{file}_{k:06}.vtp");
            files.push(OutputFile::new(path.clone(), move |path| {
                let data = PolyData {
                    points: &mesh.vertices,
                    triangles: &mesh.triangles,
                    ..PolyData::default()
                };
                vtp::write(path, &data)
            }));
            series.push(Entry {
                time: *t,
                part: 0,
                name: file.to_owned(),
                file: path,
            });
        }
        files.push(OutputFile::new(format!("{file}.pvd"), move |path| {
            series.write(path)
        }));
        files
    }

    /// The film and the sheet.
    fn pictures(&self) -> Result<(Vec<u8>, Vec<u8>), PictureError> {
        let frame = axes(self.meshes[0]);
        let [long, across] = [0, 2].map(|k| frame.column(k).into_owned());
        // Neither upside down nor from behind.
        let up = if long.y < 0.0 { -long } else { long };
        let from = if across.z < 0.0 { -across } else { across };
        let centred = |mesh: &TriangleMesh| {
            let middle = Aabb::of_points(&mesh.vertices).center();
            let at = |p: &Point3<f64>| Point3::from(p - middle);
            mesh.vertices.iter().map(at).collect::<Vec<_>>()
        };
        let shapes: Vec<Vec<Point3<f64>>> =
            self.shapes.iter().map(|(_, mesh)| centred(mesh)).collect();
        let canvas = Canvas::new(SIZE.0, SIZE.1).with_top(26.0);
        let all = shapes.iter().flatten().copied();
        let camera = Camera::fit(all, &View::orthographic(from, up), canvas);
        let mut film: Vec<Frame> = Vec::new();
        for ((t, mesh), places) in self.shapes.iter().zip(&shapes) {
            let surface = Surface::plain(places, &mesh.triangles, colour::BONE);
            let mut frame = render(&Drawing::of([surface]), &camera);
            frame.title(&format!("t = {t:.2}"), TextStyle::Small);
            film.push(frame);
        }
        let last = film.len().saturating_sub(1);
        let shown: Vec<Frame> = (0..SHOWN)
            .map(|k| film[k * last / (SHOWN - 1)].clone())
            .collect();
        let sheet = Frame::beside(&shown, 4, [1.0; 3]).to_png()?;
        let back: Vec<Frame> = film
            .iter()
            .rev()
            .skip(1)
            .take(last.saturating_sub(1))
            .cloned()
            .collect();
        film.extend(back);
        Ok((to_gif(&film, 1.0 / RATE)?, sheet))
    }
}

fn table(measured: &[Measured]) -> Table {
    let mut table = Table::new("Shapes", ["t", "volume", "area", "pieces", "handles"]);
    for m in measured {
        table.row([
            number(m.t),
            number(m.volume),
            number(m.area),
            m.pieces.to_string(),
            m.handles.to_string(),
        ]);
    }
    table
}

fn plot(measured: &[Measured]) -> LinePlot {
    let first = measured.first().map_or((1.0, 1.0), |m| (m.volume, m.area));
    let line = |of: fn(&Measured) -> f64, start: f64| -> Vec<(f64, f64)> {
        measured.iter().map(|m| (m.t, of(m) / start)).collect()
    };
    LinePlot::new("Volume and area over those of A", "t")
        .with("volume", line(|m| m.volume, first.0))
        .with("area", line(|m| m.area, first.1))
}
