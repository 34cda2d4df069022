//! Files of a morph between two surfaces: frames with all point data, series, pictures, table, summary, page.

mod pictures;
mod tables;
pub mod volume;

use std::io;
use std::path::Path;

use nalgebra::Point3;
use serde::Serialize;

use super::LinePlot;
use super::output::{DataFile, OutputFile, Plot, RunOutput, Verdict, measures};
use pliant::format::{counted, number};
use pliant::io::pvd::{Collection, Entry};
use pliant::io::vtp::{self, PolyData};
use pliant::io::{PointData, file_name};
use pliant::mesh::measures::{area, max_or_nan, volume};
use pliant::mesh::{SurfaceTree, TriangleMesh};
use pliant::moment_arms::extremes;
use pliant::morph::flipped;
use pliant::morph::{Correspondence, Distortion};
use pliant_render::PictureError;

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
    pub fn of(between: &Correspondence, data: [&[PointData]; 2]) -> Result<Vec<Self>, String> {
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
    pub between: &'a Correspondence,
    /// Given pairs of vertices.
    pub pairs: &'a [[u32; 2]],
    /// Shapes from the first to the second.
    pub shapes: Vec<Shape>,
    /// Numbers at the vertices.
    pub data: Vec<Carried>,
    /// Method, blend and topology, as given.
    pub words: [&'static str; 3],
    /// What was mended in the surfaces, and the number of handles that were cut.
    pub notes: Vec<String>,
    /// Number of handles that were cut.
    pub handles_cut: usize,
    /// Unit of all lengths; `None` for that of the files.
    pub unit: Option<&'static str>,
    /// Time of reading and of blending [s].
    pub seconds: [f64; 2],
    /// Wall time of all of it [s].
    pub time_s: f64,
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
pub struct CarriedArray {
    name: String,
    components: usize,
    of: &'static str,
}

/// Time of each part [s].
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Seconds {
    read_s: f64,
    map_a_s: f64,
    map_b_s: f64,
    align_s: f64,
    merge_s: f64,
    blend_s: f64,
}

/// Content of `summary.json`.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    length_unit: &'static str,
    method: &'static str,
    blend: &'static str,
    topology: &'static str,
    pairs: usize,
    aligned_by: &'static str,
    deformed_deg: f64,
    a: Side,
    b: Side,
    vertices: usize,
    triangles: usize,
    crossings: usize,
    euler: i64,
    turned_deg: f64,
    flipped_a: usize,
    flipped_b: usize,
    between: Spread,
    frames: usize,
    volume_0: f64,
    volume_1: f64,
    volume_halfway_ratio: Option<f64>,
    handles_cut: usize,
    area_0: f64,
    area_1: f64,
    arrays: Vec<CarriedArray>,
    times: Seconds,
    #[serde(skip)]
    verdicts: Vec<Verdict>,
}

/// Volume of the shape at half, relative to that of a body whose size is the mean of both; `None`
/// without such a shape.
fn halfway(shapes: &[Shape], volumes: &[f64]) -> Option<f64> {
    let k = shapes
        .iter()
        .position(|shape| (shape.t - 0.5).abs() <= 1e-9)?;
    let size = 0.5 * (volumes.first()?.cbrt() + volumes.last()?.cbrt());
    Some(volumes[k] / (size * size * size))
}

/// Least and greatest volume of a shape between two others, relative to the smaller and to the greater of
/// the two. A blend of a body with its mirror image turned half round passes through nothing.
const BETWEEN: [f64; 2] = [0.5, 1.5];

/// The checks that no shape in between loses or gains much volume.
fn on_the_way(volumes: &[f64]) -> Vec<Verdict> {
    let ends = volumes.first().into_iter().chain(volumes.last()).copied();
    let (Some([smaller, greater]), Some([least, most])) =
        (extremes(ends), extremes(volumes.iter().copied()))
    else {
        return Vec::new();
    };
    let (least, most) = (least / smaller, most / greater);
    let [low, high] = BETWEEN;
    let cure = "give pairs of features with --pairs; if one body is mirrored, mirror it back";
    [
        Verdict::at_least(
            "least volume on the way, relative to the smaller of A and B",
            least,
            low,
        ),
        Verdict::at_most(
            "greatest volume on the way, relative to the greater",
            most,
            high,
        ),
    ]
    .map(|check| check.else_do(cure))
    .into()
}

fn verdicts(a: &Side, b: &Side, euler: i64) -> Vec<Verdict> {
    let worst = max_or_nan([a.end_error, b.end_error]);
    vec![
        Verdict::none("triangles of A turned over on the sphere", a.map.flipped),
        Verdict::none("triangles of B turned over on the sphere", b.map.flipped),
        Verdict::new("the common surface is a sphere: V - E + F is 2", euler == 2)
            .with_value(euler as f64)
            .with_limit(2.0),
        Verdict::at_most(
            "distance of the ends from A and B over their size",
            worst,
            ENDS,
        ),
    ]
}

impl Summary {
    /// Displacement of the map of A towards similar places, if any.
    fn deformed(&self) -> String {
        if self.deformed_deg > 0.0 {
            format!(
                ", the map of A deformed by {:.1} degrees",
                self.deformed_deg
            )
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
            "{}{}common: {} vertices, {} triangles, V - E + F = {}; aligned by {}{}\nvolume {} to {}, {} frames; the ends are reproduced to {:.1e} \
             and {:.1e} of the size\n",
            side("A", &self.a),
            side("B", &self.b),
            self.vertices,
            self.triangles,
            self.euler,
            self.aligned_by,
            self.deformed(),
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
        let euler = topology.euler_characteristic();
        let at = |k: usize, of: Measure| {
            self.shapes
                .get(k)
                .map_or(0.0, |s| of(&s.places, &between.triangles))
        };
        let last = self.shapes.len().saturating_sub(1);
        let volumes: Vec<f64> = (0..self.shapes.len()).map(|k| at(k, volume)).collect();
        let array = |c: &Carried| CarriedArray {
            name: c.name.clone(),
            components: c.components,
            of: c.sides(),
        };
        Summary {
            length_unit: self.unit.unwrap_or("that of the files"),
            method: self.words[0],
            blend: self.words[1],
            topology: self.words[2],
            pairs: self.pairs.len(),
            aligned_by: between.start.name(),
            deformed_deg: between.drawn.to_degrees(),
            vertices: between.kinds.len(),
            triangles: between.triangles.len(),
            crossings: between.kinds.iter().filter(|k| **k == 2).count(),
            euler,
            turned_deg: between.turned.to_degrees(),
            flipped_a: a.map.flipped,
            flipped_b: b.map.flipped,
            between: spread(
                &between.places[0],
                &between.places[1],
                &between.triangles,
                0,
            ),
            frames: self.shapes.len(),
            volume_0: at(0, volume),
            volume_1: at(last, volume),
            volume_halfway_ratio: halfway(&self.shapes, &volumes),
            handles_cut: self.handles_cut,
            area_0: at(0, area),
            area_1: at(last, area),
            arrays: self.data.iter().map(array).collect(),
            times: Seconds {
                read_s: self.seconds[0],
                map_a_s: between.times.maps[0],
                map_b_s: between.times.maps[1],
                align_s: between.times.align,
                merge_s: between.times.merge,
                blend_s: self.seconds[1],
            },
            verdicts: [verdicts(&a, &b, euler), on_the_way(&volumes)].concat(),
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
            end_error = max_or_nan(places.map(|(p, q)| (p - q).norm())) / size;
            let tree = SurfaceTree::new(&shape.places, &self.between.triangles);
            let off = |p: &Point3<f64>| {
                tree.closest(p, f64::INFINITY)
                    .map_or(f64::INFINITY, |c| c.distance)
            };
            end_miss = max_or_nan(mesh.vertices.iter().map(off)) / size;
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

    /// The result.
    ///
    /// # Errors
    /// A picture that cannot be encoded.
    pub fn output(&self) -> Result<RunOutput<'_>, PictureError> {
        let (summary, file) = (self.summary(), file_name(&self.name));
        let drawn = pictures::Drawn::new(self, summary.length_unit)?;
        Ok(RunOutput {
            kind: "morph",
            name: self.name.clone(),
            measures: measures(&summary),
            text: summary.to_text(),
            tables: tables::tables(&summary),
            verdicts: summary.verdicts,
            time_s: self.time_s,
            title: format!("{}: a morph", self.name),
            subtitle: format!("{} to {}", self.files[0], self.files[1]),
            plots_title: "Over t".to_owned(),
            plots: vec![Plot {
                file: None,
                plot: self.plot(),
            }],
            pictures: drawn.pictures(&file),
            findings: self.findings(),
            notes: self.notes.clone(),
            explanations: vec![format!(
                "Lengths are in {}. Conformal distortion is the greater over the smaller stretch of a triangle, area distortion its \
                 share of the whole area after over that before, or the inverse.",
                if self.unit.is_some() {
                    "metres"
                } else {
                    "the unit of the files"
                }
            )],
            data: vec![DataFile::new(
                "measures.csv",
                ["t", "volume", "area"],
                self.rows(),
            )],
            files: self.frames(&file),
            ..RunOutput::default()
        })
    }

    /// A cut handle may be a real hole of the body, such as the foramen of a hip bone.
    fn findings(&self) -> Vec<String> {
        let cut = self.handles_cut;
        let text = format!(
            "{}: where a hole is a part of the body, as in a hip bone, the shapes do not have it; --method volume keeps holes",
            counted(cut, "handle is cut", "handles are cut")
        );
        (cut > 0).then_some(text).into_iter().collect()
    }

    /// A file for each shape, and one that lists them.
    fn frames(&self, file: &str) -> Vec<OutputFile<'_>> {
        let mut files = Vec::new();
        let mut series = Collection::new();
        for (k, shape) in self.shapes.iter().enumerate() {
            let path = format!("frames/{file}_{k:06}.vtp");
            files.push(OutputFile::new(path.clone(), move |path| {
                self.put(path, shape)
            }));
            series.push(Entry {
                time: shape.t,
                part: 0,
                name: file.to_owned(),
                file: path,
            });
        }
        let list = format!("{file}.pvd");
        files.push(OutputFile::new(list, move |path| series.write(path)));
        files
    }

    fn put(&self, path: &Path, shape: &Shape) -> io::Result<()> {
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
            ("displacement", self.displacements()),
        ] {
            if point_data.iter().all(|(other, _)| *other != name) {
                point_data.push((name, values));
            }
        }
        let data = PolyData {
            points: &shape.places,
            triangles: &self.between.triangles,
            point_data,
            ..PolyData::default()
        };
        vtp::write(path, &data)
    }

    /// Distance between the positions of each vertex on the two surfaces.
    fn displacements(&self) -> Vec<f64> {
        let [a, b] = &self.between.places;
        a.iter().zip(b).map(|(a, b)| (b - a).norm()).collect()
    }

    /// Volume and area of each shape.
    fn rows(&self) -> impl Iterator<Item = Vec<String>> + '_ {
        let triangles = &self.between.triangles;
        self.shapes.iter().map(|s| {
            let numbers = [
                s.t,
                volume(&s.places, triangles),
                area(&s.places, triangles),
            ];
            numbers.iter().map(f64::to_string).collect()
        })
    }

    fn plot(&self) -> LinePlot {
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
        LinePlot::new("Volume and area over those of A", "t")
            .with("volume", line(volume))
            .with("area", line(area))
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
