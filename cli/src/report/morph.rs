//! Files of a morph between two surfaces: frames with all point data, series, pictures, table, summary, page.

mod pictures;

use std::io::{self, Write};

use nalgebra::Point3;
use serde::Serialize;

use super::folder::{Folder, FolderError};
use super::{LinePlot, Report, Table};
use pliant::format::number;
use pliant::io::PointData;
use pliant::io::names::file_name;
use pliant::io::pvd::{Collection, Entry};
use pliant::io::vtp::{self, PolyData};
use pliant::mesh::TriangleMesh;
use pliant::mesh::closest::SurfaceTree;
use pliant::mesh::measures::{area, greatest, volume};
use pliant::morph::sphere::flipped;
use pliant::morph::{Between, Distortion};

/// Greatest distance of the ends of a blend from both shapes, relative to their size.
const ENDS: f64 = 1e-12;

/// Volume or area of triangles over positions.
type Measure = fn(&[Point3<f64>], &[[u32; 3]]) -> f64;

/// An intermediate shape.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// 0 at the first surface, 1 at the second.
    pub t: f64,
    /// Positions of the common vertices, in the unit of the results.
    pub places: Vec<Point3<f64>>,
}

/// Numbers at the common vertices, from one surface or from both.
#[derive(Clone, Debug, PartialEq)]
pub struct Carried {
    /// The name of the array.
    pub name: String,
    /// Number of components per vertex.
    pub components: usize,
    /// Numbers of the first surface and of the second; at least one exists.
    pub ends: [Option<Vec<f64>>; 2],
}

impl Carried {
    /// Matches the arrays of two surfaces by name; arrays of both are blended.
    ///
    /// # Errors
    /// The name of an array with different numbers of components.
    pub fn of(between: &Between, data: [&[PointData]; 2]) -> Result<Vec<Self>, String> {
        let mut all: Vec<Self> = Vec::new();
        for (side, arrays) in data.into_iter().enumerate() {
            for array in arrays {
                let here = Some(between.carried(side, &array.values, array.components));
                match all.iter_mut().find(|c| c.name == array.name) {
                    Some(other) if other.components != array.components => {
                        return Err(array.name.clone());
                    }
                    Some(other) => other.ends[side] = here,
                    None => {
                        let ends = if side == 0 {
                            [here, None]
                        } else {
                            [None, here]
                        };
                        all.push(Self {
                            name: array.name.clone(),
                            components: array.components,
                            ends,
                        });
                    }
                }
            }
        }
        Ok(all)
    }

    /// The numbers at t: blended if both surfaces have them, otherwise unchanged.
    pub fn at(&self, t: f64) -> Vec<f64> {
        match &self.ends {
            [Some(a), Some(b)] => a.iter().zip(b).map(|(a, b)| blended(*a, *b, t)).collect(),
            [Some(one), None] | [None, Some(one)] => one.clone(),
            [None, None] => Vec::new(),
        }
    }

    fn sides(&self) -> &'static str {
        match &self.ends {
            [Some(_), Some(_)] => "both",
            [Some(_), None] => "a",
            _ => "b",
        }
    }
}

/// Exact at both ends, even if the other end is NaN.
fn blended(a: f64, b: f64, t: f64) -> f64 {
    if t <= 0.0 {
        a
    } else if t >= 1.0 {
        b
    } else {
        a * (1.0 - t) + b * t
    }
}

/// A morph with its results.
pub struct Morph<'a> {
    /// Name of the morph.
    pub name: String,
    /// The files of both surfaces, as given.
    pub files: [String; 2],
    /// Both surfaces.
    pub meshes: [&'a TriangleMesh; 2],
    /// Correspondence of the surfaces.
    pub between: &'a Between,
    /// Given pairs of vertices.
    pub pairs: &'a [[u32; 2]],
    /// Shapes from the first to the second.
    pub shapes: Vec<Shape>,
    /// Numbers at the vertices.
    pub data: Vec<Carried>,
    /// Method, blend and topology, as given.
    pub words: [&'static str; 3],
    /// Unit of all lengths; `None` for that of the files.
    pub unit: Option<&'static str>,
    /// Time of reading and of blending [s].
    pub seconds: [f64; 2],
}

/// Quality of a map to the sphere.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Spread {
    flipped: usize,
    conformal_median: f64,
    conformal_max: f64,
    area_median: f64,
    area_max: f64,
    triangles_without_area: usize,
}

/// A surface and its map.
#[derive(Clone, Debug, Serialize)]
pub struct Side {
    file: String,
    vertices: usize,
    triangles: usize,
    area: f64,
    volume: f64,
    map: Spread,
    relaxation: Option<Sweeps>,
    end_error: f64,
    end_miss: f64,
}

/// Effort of the relaxation.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Sweeps {
    attempts: usize,
    first: usize,
    second: usize,
}

/// An array, with the surfaces that have it.
#[derive(Clone, Debug, Serialize)]
pub struct Told {
    name: String,
    components: usize,
    of: &'static str,
}

/// Time of each part [s].
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Seconds {
    read: f64,
    map_a: f64,
    map_b: f64,
    align: f64,
    merge: f64,
    blend: f64,
}

/// Content of `summary.json`.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// Name of the morph.
    pub name: String,
    length_unit: &'static str,
    method: &'static str,
    blend: &'static str,
    topology: &'static str,
    pairs: usize,
    aligned_by: &'static str,
    drawn_rad: f64,
    a: Side,
    b: Side,
    vertices: usize,
    triangles: usize,
    crossings: usize,
    euler: i64,
    turned_rad: f64,
    flipped_a: usize,
    flipped_b: usize,
    between: Spread,
    frames: usize,
    volume_0: f64,
    volume_1: f64,
    area_0: f64,
    area_1: f64,
    arrays: Vec<Told>,
    time_s: Seconds,
    verdicts: Vec<(String, bool)>,
}

impl Summary {
    /// Checks with their results.
    pub fn verdicts(&self) -> &[(String, bool)] {
        &self.verdicts
    }

    /// Displacement of the map of A towards similar places, if any.
    fn drawn(&self) -> String {
        if self.drawn_rad > 0.0 {
            format!(", the map of A drawn by {:.2} rad", self.drawn_rad)
        } else {
            String::new()
        }
    }

    /// A short text for a terminal.
    pub fn to_text(&self) -> String {
        let side = |name: &str, s: &Side| {
            format!(
                "{name}: {} ({} vertices, {} triangles), {} flipped on the sphere, area distortion {} (median), {} (greatest)\n",
                s.file,
                s.vertices,
                s.triangles,
                s.map.flipped,
                number(s.map.area_median),
                number(s.map.area_max)
            )
        };
        format!(
            "{}{}common: {} vertices, {} triangles, V - E + F = {}; aligned by {}{}\nvolume {} to {}, {} frames; ends are met to {:.1e} \
             and {:.1e} of the size\n",
            side("A", &self.a),
            side("B", &self.b),
            self.vertices,
            self.triangles,
            self.euler,
            self.aligned_by,
            self.drawn(),
            number(self.volume_0),
            number(self.volume_1),
            self.frames,
            self.a.end_error,
            self.b.end_error
        )
    }
}

impl Morph<'_> {
    /// The files besides the frames.
    pub fn files(name: &str) -> Vec<String> {
        let file = file_name(name);
        let mut all = vec![format!("{file}.pvd"), format!("{file}.gif")];
        all.extend(
            [
                "sheet.png",
                "spheres.png",
                "measures.csv",
                "summary.json",
                "report.html",
            ]
            .map(str::to_owned),
        );
        all
    }

    /// Computes the summary.
    pub fn summary(&self) -> Summary {
        let between = self.between;
        let topology =
            pliant::mesh::Topology::of_triangles(between.kinds.len(), &between.triangles);
        let [a, b] = [0, 1].map(|side| self.side(side));
        let flipped = [a.map.flipped, b.map.flipped];
        let at = |k: usize, of: Measure| {
            self.shapes
                .get(k)
                .map_or(0.0, |s| of(&s.places, &between.triangles))
        };
        let (last, euler) = (
            self.shapes.len().saturating_sub(1),
            topology.euler_characteristic(),
        );
        let told = |c: &Carried| Told {
            name: c.name.clone(),
            components: c.components,
            of: c.sides(),
        };
        let worst = greatest([a.end_error, b.end_error]);
        let verdicts = vec![
            (
                format!(
                    "no triangle is turned over on the sphere: {} and {} are",
                    flipped[0], flipped[1]
                ),
                flipped == [0, 0],
            ),
            (
                format!("the common surface is a sphere: V - E + F = {euler}"),
                euler == 2,
            ),
            (
                format!("both ends are met to 1e-12 of the size: {worst:.1e}"),
                worst <= ENDS,
            ),
        ];
        Summary {
            name: self.name.clone(),
            length_unit: self.unit.unwrap_or("that of the files"),
            method: self.words[0],
            blend: self.words[1],
            topology: self.words[2],
            pairs: self.pairs.len(),
            aligned_by: between.start.name(),
            drawn_rad: between.drawn,
            vertices: between.kinds.len(),
            triangles: between.triangles.len(),
            crossings: between.kinds.iter().filter(|k| **k == 2).count(),
            euler,
            turned_rad: between.turned,
            flipped_a: flipped[0],
            flipped_b: flipped[1],
            between: spread(
                &between.places[0],
                &between.places[1],
                &between.triangles,
                0,
            ),
            frames: self.shapes.len(),
            volume_0: at(0, volume),
            volume_1: at(last, volume),
            area_0: at(0, area),
            area_1: at(last, area),
            arrays: self.data.iter().map(told).collect(),
            time_s: Seconds {
                read: self.seconds[0],
                map_a: between.times.maps[0],
                map_b: between.times.maps[1],
                align: between.times.align,
                merge: between.times.merge,
                blend: self.seconds[1],
            },
            verdicts,
            a,
            b,
        }
    }

    fn side(&self, side: usize) -> Side {
        let (mesh, map) = (self.meshes[side], &self.between.maps[side]);
        let shape = if side == 0 {
            self.shapes.first()
        } else {
            self.shapes.last()
        };
        let size = mesh.length();
        let (mut end_error, mut end_miss) = (f64::INFINITY, f64::INFINITY);
        if let Some(shape) = shape {
            let places = shape.places.iter().zip(&self.between.places[side]);
            end_error = greatest(places.map(|(p, q)| (p - q).norm())) / size;
            let tree = SurfaceTree::new(&shape.places, &self.between.triangles);
            let off = |p: &Point3<f64>| {
                tree.closest(p, f64::INFINITY)
                    .map_or(f64::INFINITY, |c| c.distance)
            };
            end_miss = greatest(mesh.vertices.iter().map(off)) / size;
        }
        let bad = flipped(map.points(), map.triangles()).len();
        Side {
            file: self.files[side].clone(),
            vertices: mesh.vertices.len(),
            triangles: mesh.triangles.len(),
            area: mesh.area(),
            volume: mesh.volume(),
            map: spread(&mesh.vertices, map.points(), &mesh.triangles, bad),
            relaxation: self.between.efforts[side].map(|e| Sweeps {
                attempts: e.attempts,
                first: e.first,
                second: e.second,
            }),
            end_error,
            end_miss,
        }
    }

    /// Writes all files.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn write(&self, folder: &Folder, summary: &Summary) -> Result<(), FolderError> {
        let file = file_name(&self.name);
        let mut series = Collection::new();
        for (k, shape) in self.shapes.iter().enumerate() {
            let path = format!("frames/{file}_{k:06}.vtp");
            self.put(folder, &path, shape)?;
            series.push(Entry {
                time: shape.t,
                part: 0,
                name: file.clone(),
                file: path,
            });
        }
        let path = folder.claim(&format!("{file}.pvd"))?;
        series
            .write(&path)
            .map_err(|source| FolderError::Io { path, source })?;
        let drawn = pictures::Drawn::new(self, summary.length_unit)?;
        for (name, bytes) in [
            (format!("{file}.gif"), &drawn.film),
            ("sheet.png".into(), &drawn.sheet),
            ("spheres.png".into(), &drawn.spheres),
        ] {
            folder.write(&name, |w| w.write_all(bytes))?;
        }
        folder.write("measures.csv", |w| self.write_measures(w))?;
        let json = serde_json::to_string_pretty(summary).unwrap_or_default();
        folder.write("summary.json", |w| w.write_all(json.as_bytes()))?;
        let page = self.page(summary, drawn);
        folder.write("report.html", |w| w.write_all(page.to_html().as_bytes()))
    }

    fn put(&self, folder: &Folder, file: &str, shape: &Shape) -> Result<(), FolderError> {
        let path = folder.claim(file)?;
        let mut point_data: Vec<(&str, Vec<f64>)> = self
            .data
            .iter()
            .map(|c| (c.name.as_str(), c.at(shape.t)))
            .collect();
        for (name, values) in [
            (
                "origin",
                self.between.kinds.iter().map(|k| f64::from(*k)).collect(),
            ),
            ("way", self.ways()),
        ] {
            if point_data.iter().all(|(other, _)| *other != name) {
                point_data.push((name, values));
            }
        }
        let data = PolyData {
            points: &shape.places,
            triangles: &self.between.triangles,
            lines: &[],
            point_data,
        };
        vtp::write(&path, &data).map_err(|source| FolderError::Io { path, source })
    }

    /// Distance between the positions of each vertex on the two surfaces.
    fn ways(&self) -> Vec<f64> {
        let [a, b] = &self.between.places;
        a.iter().zip(b).map(|(a, b)| (b - a).norm()).collect()
    }

    fn write_measures(&self, w: &mut impl Write) -> io::Result<()> {
        writeln!(w, "t,volume,area")?;
        for s in &self.shapes {
            let triangles = &self.between.triangles;
            writeln!(
                w,
                "{},{},{}",
                s.t,
                volume(&s.places, triangles),
                area(&s.places, triangles)
            )?;
        }
        Ok(())
    }

    fn page(&self, summary: &Summary, drawn: pictures::Drawn) -> Report {
        let triangles = &self.between.triangles;
        let line = |of: Measure| {
            let start = self
                .shapes
                .first()
                .map_or(1.0, |s| of(&s.places, triangles));
            self.shapes
                .iter()
                .map(|s| (s.t, of(&s.places, triangles) / start))
                .collect::<Vec<(f64, f64)>>()
        };
        let plot = LinePlot::new("Volume and area over those of A", "t")
            .with("volume", line(volume))
            .with("area", line(area));
        Report {
            title: format!("{}: a morph", self.name),
            subtitle: format!("{} to {}", self.files[0], self.files[1]),
            verdict: summary.verdicts.clone(),
            sheets: vec![
                ("from A (t = 0) to B (t = 1), each about its own middle, coloured by how far places go beside that".to_owned(), drawn.sheet),
                (
                    "images on the sphere from two sides, coloured by the share of the area that each place has there over that \
                     on the surface"
                        .to_owned(),
                    drawn.spheres,
                ),
            ],
            pictures: vec![("over t".to_owned(), drawn.film)],
            plots_title: "On the way".to_owned(),
            plots: vec![plot],
            tables: tables(summary),
            notes: vec![format!(
                "Lengths are in {}. Conformal distortion is the greater over the smaller stretch of a triangle, area distortion its \
                 share of the whole area after over that before, or the inverse.",
                if self.unit.is_some() { "metres" } else { "the unit of the files" }
            )],
            ..Report::default()
        }
    }
}

fn spread(
    before: &[Point3<f64>],
    after: &[Point3<f64>],
    triangles: &[[u32; 3]],
    flipped: usize,
) -> Spread {
    let d = Distortion::of(before, after, triangles);
    Spread {
        flipped,
        conformal_median: d.conformal_median,
        conformal_max: d.conformal_max,
        area_median: d.area_median,
        area_max: d.area_max,
        triangles_without_area: d.without_area,
    }
}

fn tables(summary: &Summary) -> Vec<Table> {
    let mut sides = Table::new("Surfaces", ["", "A", "B"]);
    let (a, b) = (&summary.a, &summary.b);
    sides.row(["file", &a.file, &b.file]);
    sides.row([
        "vertices".to_owned(),
        a.vertices.to_string(),
        b.vertices.to_string(),
    ]);
    sides.row([
        "triangles".to_owned(),
        a.triangles.to_string(),
        b.triangles.to_string(),
    ]);
    let mut both = |what: &str, of: &dyn Fn(&Side) -> f64| {
        sides.row([what.to_owned(), number(of(a)), number(of(b))])
    };
    both("area", &|s| s.area);
    both("volume", &|s| s.volume);
    both("triangles turned over on the sphere", &|s| {
        s.map.flipped as f64
    });
    both("conformal distortion, median", &|s| s.map.conformal_median);
    both("conformal distortion, greatest", &|s| s.map.conformal_max);
    both("area distortion, median", &|s| s.map.area_median);
    both("area distortion, greatest", &|s| s.map.area_max);
    both("end of the blend from it, over the size", &|s| s.end_error);
    both(
        "its vertices from the end of the blend, over the size",
        &|s| s.end_miss,
    );
    let mut common = Table::new("Common surface", ["what", "value"]);
    common.row(["vertices", &summary.vertices.to_string()]);
    common.row([
        "of these crossings of edges",
        &summary.crossings.to_string(),
    ]);
    common.row(["triangles", &summary.triangles.to_string()]);
    common.row([
        "conformal distortion from A to B, median",
        &number(summary.between.conformal_median),
    ]);
    common.row([
        "area distortion from A to B, median",
        &number(summary.between.area_median),
    ]);
    common.row([
        "aligned by",
        &format!("{}{}", summary.aligned_by, summary.drawn()),
    ]);
    let mut data = Table::new("Point data", ["array", "components", "of"]);
    for array in &summary.arrays {
        let of = if array.of == "both" {
            "A and B, blended"
        } else if array.of == "a" {
            "A"
        } else {
            "B"
        };
        data.row([
            array.name.clone(),
            array.components.to_string(),
            of.to_owned(),
        ]);
    }
    let mut times = Table::new("Time [s]", ["part", "seconds"]);
    let t = &summary.time_s;
    for (part, s) in [
        ("read", t.read),
        ("map of A", t.map_a),
        ("map of B", t.map_b),
        ("align", t.align),
        ("merge", t.merge),
        ("blend", t.blend),
    ] {
        times.row([part.to_owned(), format!("{s:.3}")]);
    }
    [sides, common, data, times]
        .into_iter()
        .filter(|t| !t.rows.is_empty())
        .collect()
}
