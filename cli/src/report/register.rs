//! Files of a registration: the moved surface with its distances, pictures before and after, summary, page.

use std::io;
use std::path::Path;

use nalgebra::{Matrix3, Point3};
use serde::Serialize;

use super::Table;
use super::output::{OutputFile, Picture, RunOutput, Verdict, measures};
use pliant::format::number;
use pliant::io::PointData;
use pliant::io::obj;
use pliant::io::vtp::{self, PolyData};
use pliant::mesh::TriangleMesh;
use pliant::mesh::measures::{Aabb, max_or_nan};
use pliant::morph::axes;
use pliant::morph::register::{FitMotion, RegistrationResidual, SurfaceRegistration};
use pliant_render::{
    Camera, Canvas, ColourMap, Drawing, Frame, Legend, PictureError, Rgb, Surface, TextStyle, View,
    colour, render,
};

/// Width and height of a picture \[px\].
const SIZE: (u32, u32) = (520, 480);
/// A whole body that fits has at least this share of its vertices on the other.
const FITS: f64 = 0.9;
/// A vertex of B farther from A than this share of B's size is bare.
const BARE: f64 = 0.01;
const MOVING: Rgb = [0.25, 0.45, 0.75];

/// Positions and triangles of a surface.
type Triangles<'a> = (&'a [Point3<f64>], &'a [[u32; 3]]);

/// A registration with its results.
pub struct Registration<'a> {
    /// Name of the registration.
    pub name: String,
    /// The files of both surfaces, as given.
    pub files: [String; 2],
    /// The moving surface, and the other.
    pub meshes: [&'a TriangleMesh; 2],
    /// Numbers at the vertices of the first surface.
    pub data: &'a [PointData],
    /// Result of the registration.
    pub registration: &'a SurfaceRegistration,
    /// Degrees of freedom.
    pub motion: FitMotion,
    /// Given share of the first surface that corresponds to the second.
    pub overlap: f64,
    /// Seed of the draws.
    pub seed: u64,
    /// Unit of all lengths; `None` for that of the files.
    pub unit: Option<&'static str>,
    /// Time of reading [s].
    pub read_s: f64,
    /// Wall time of all of it [s].
    pub time_s: f64,
}

/// Distances from B.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Distances {
    rms: f64,
    median: f64,
    max: f64,
}

/// Distances of all vertices of one surface from the other.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct FromAll {
    median: f64,
    p95: f64,
    max: f64,
}

impl FromAll {
    fn of(distances: &[f64]) -> Self {
        let RegistrationResidual {
            median, p95, max, ..
        } = RegistrationResidual::of(distances.iter().copied());
        Self { median, p95, max }
    }
}

/// Measures of the deformation of A.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Bending {
    clusters: usize,
    rounds: usize,
    converged: bool,
    pairs: usize,
    bend_max_deg: f64,
    moved_rms: f64,
    moved_max: f64,
}

/// Time of each part [s].
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Seconds {
    read_s: f64,
    start_s: f64,
    icp_s: f64,
    bend_s: f64,
}

/// Content of `summary.json`.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    a: String,
    b: String,
    vertices_a: usize,
    triangles_a: usize,
    vertices_b: usize,
    triangles_b: usize,
    length_unit: &'static str,
    with: &'static str,
    overlap: f64,
    seed: u64,
    matrix: [[f64; 4]; 4],
    scale: f64,
    turned_deg: f64,
    draws: usize,
    start_inliers: usize,
    start_tried: usize,
    rounds: usize,
    converged: bool,
    pairs: usize,
    size: f64,
    inlier_share: f64,
    residual: Distances,
    distance: Distances,
    distance_a_to_b_m: FromAll,
    distance_b_to_a_m: FromAll,
    bare_share: f64,
    non_rigid: Option<Bending>,
    times: Seconds,
    #[serde(skip)]
    verdicts: Vec<Verdict>,
}

impl Summary {
    /// A short text for a terminal.
    pub fn to_text(&self) -> String {
        let bent = self.non_rigid.map_or(String::new(), |b| {
            let (most, turn) = (number(b.moved_max), b.bend_max_deg);
            format!(
                "bent by {} clusters: up to {most} further, neighbours turned by up to {turn:.1} degrees\n",
                b.clusters
            )
        });
        format!(
            "{} onto {}\nturned by {:.2} degrees, scaled by {}, in {} rounds\n{bent}{:.1} % of the vertices lie on B: distance rms {}, \
             median {}, greatest {} (B is {} long)\n\
             from B to A: median {}, 95 % below {}, greatest {}\n",
            self.a,
            self.b,
            self.turned_deg,
            number(self.scale),
            self.rounds,
            self.inlier_share * 100.0,
            number(self.residual.rms),
            number(self.residual.median),
            number(self.residual.max),
            number(self.size),
            number(self.distance_b_to_a_m.median),
            number(self.distance_b_to_a_m.p95),
            number(self.distance_b_to_a_m.max)
        )
    }
}

impl Registration<'_> {
    /// The written files.
    pub fn files() -> Vec<String> {
        [
            "moved.vtp",
            "moved.obj",
            "fixed.vtp",
            "before.png",
            "after.png",
            "bare.png",
            "summary.json",
            "report.html",
        ]
        .map(str::to_owned)
        .to_vec()
    }

    /// Measures of the deformation after the rigid motion, if there was one.
    fn bending(&self) -> Option<Bending> {
        let registration = self.registration;
        let bent = registration.bent.as_ref()?;
        let motion = &registration.registered.motion;
        let rigid = self.meshes[0].vertices.iter().map(|p| motion * p);
        let moved =
            RegistrationResidual::of(rigid.zip(&registration.points).map(|(p, q)| (q - p).norm()));
        Some(Bending {
            clusters: bent.count,
            rounds: bent.rounds,
            converged: bent.converged,
            pairs: bent.pairs,
            bend_max_deg: bent.bend_max.to_degrees(),
            moved_rms: moved.rms,
            moved_max: moved.max,
        })
    }

    /// Computes the summary.
    pub fn summary(&self) -> Summary {
        let (registration, [a, b]) = (self.registration, self.meshes);
        let motion = &registration.registered.motion;
        let rows = motion.to_homogeneous();
        let share = registration.share();
        let bent = self.bending();
        let distances = |r: RegistrationResidual| Distances {
            rms: r.rms,
            median: r.median,
            max: r.max,
        };
        let enough = "share of the vertices that lie on B: two thirds of the overlap at least";
        let rest = "iterated closest points came to rest";
        Summary {
            a: self.files[0].clone(),
            b: self.files[1].clone(),
            vertices_a: a.vertices.len(),
            triangles_a: a.triangles.len(),
            vertices_b: b.vertices.len(),
            triangles_b: b.triangles.len(),
            length_unit: self.unit.unwrap_or("that of the files"),
            with: if self.motion == FitMotion::Rigid {
                "rigid"
            } else {
                "similarity"
            },
            overlap: self.overlap,
            seed: self.seed,
            matrix: std::array::from_fn(|i| std::array::from_fn(|k| rows[(i, k)])),
            scale: motion.scaling(),
            turned_deg: motion.isometry.rotation.angle().to_degrees(),
            draws: registration.begun.draws,
            start_inliers: registration.begun.inliers,
            start_tried: registration.begun.of,
            rounds: registration.registered.rounds,
            converged: registration.registered.converged,
            pairs: registration.registered.pairs,
            size: b.length(),
            inlier_share: share,
            residual: distances(registration.residual()),
            distance: distances(RegistrationResidual::of(
                registration.distances.iter().copied(),
            )),
            distance_a_to_b_m: FromAll::of(&registration.distances),
            distance_b_to_a_m: FromAll::of(&registration.distances_back),
            bare_share: self.bare(),
            non_rigid: bent,
            times: Seconds {
                read_s: self.read_s,
                start_s: registration.times.start,
                icp_s: registration.times.icp,
                bend_s: registration.times.bend,
            },
            verdicts: vec![
                Verdict::at_least(enough, share, self.overlap * 2.0 / 3.0)
                    .else_do("lower --overlap, or take --with similarity where sizes differ"),
                Verdict::new(rest, registration.registered.converged || bent.is_some()),
            ],
        }
    }

    /// Share of the vertices of B that are farther from A than [`BARE`] of B's size.
    fn bare(&self) -> f64 {
        let all = &self.registration.distances_back;
        let near = BARE * self.meshes[1].length();
        all.iter().filter(|d| !(**d <= near)).count() as f64 / all.len().max(1) as f64
    }

    /// What a reader is to judge: an overlap is what the user says, so little of it is no failed check.
    fn findings(&self) -> Vec<String> {
        let off = 1.0 - self.registration.share();
        let found = format!(
            "{:.0} % of the vertices of A do not lie on B: B has nothing there, or A is another subject, \
             the other side of the body, or another bone; after.png shows where",
            100.0 * off
        );
        let bare = self.bare();
        let open = format!(
            "{:.0} % of the vertices of B are farther from A than a hundredth of B's size, up to {}: A leaves them bare; bare.png shows \
             where",
            100.0 * bare,
            number(max_or_nan(self.registration.distances_back.iter().copied()))
        );
        [(off, found), (bare, open)]
            .into_iter()
            .filter(|(share, _)| !(*share <= 1.0 - FITS))
            .map(|(_, text)| text)
            .collect()
    }

    /// The result.
    ///
    /// # Errors
    /// A picture that cannot be encoded.
    pub fn output(&self) -> Result<RunOutput<'_>, PictureError> {
        let summary = self.summary();
        let picture = |name: &str, frame: Frame| -> Result<Picture, PictureError> {
            Ok(Picture {
                file: format!("{name}.png"),
                caption: name.to_owned(),
                bytes: frame.to_png()?,
                wide: false,
            })
        };
        Ok(RunOutput {
            kind: "register",
            name: self.name.clone(),
            measures: measures(&summary),
            text: summary.to_text(),
            tables: self.tables(&summary),
            findings: self.findings(),
            verdicts: summary.verdicts,
            time_s: self.time_s,
            title: format!("{}: registration", self.name),
            subtitle: format!("{} onto {}", self.files[0], self.files[1]),
            pictures: vec![
                picture("before", self.before())?,
                picture("after", self.after())?,
                picture("bare", self.bare_parts())?,
            ],
            explanations: vec![format!(
                "Lengths are in {}. A vertex lies on B if it is nearer than a hundredth of B's size, faces the same direction, and its nearest \
                 place is at no open rim.",
                if self.unit.is_some() {
                    "metres"
                } else {
                    "the unit of the files"
                }
            )],
            files: vec![
                OutputFile::new("moved.vtp", |path| self.write_moved(path)),
                OutputFile::new("fixed.vtp", |path| self.write_fixed(path)),
                OutputFile::new("moved.obj", |path| {
                    let moved = TriangleMesh {
                        vertices: self.registration.points.clone(),
                        triangles: self.meshes[0].triangles.clone(),
                    };
                    obj::write(path, &moved, &[])
                }),
            ],
            ..RunOutput::default()
        })
    }

    /// The moved surface with its distances from B.
    fn write_moved(&self, path: &Path) -> io::Result<()> {
        let (registration, mesh) = (self.registration, self.meshes[0]);
        let mut point_data: Vec<(&str, Vec<f64>)> = self
            .data
            .iter()
            .map(|d| (d.name.as_str(), d.values.clone()))
            .collect();
        let mut own = vec![
            ("distance", registration.distances.clone()),
            (
                "inlier",
                registration
                    .inliers
                    .iter()
                    .map(|on| f64::from(u8::from(*on)))
                    .collect(),
            ),
        ];
        own.extend(registration.bent.as_ref().map(|b| {
            (
                "cluster",
                b.clusters.iter().map(|c| f64::from(*c)).collect(),
            )
        }));
        for (name, values) in own {
            if point_data.iter().all(|(other, _)| *other != name) {
                point_data.push((name, values));
            }
        }
        let data = PolyData {
            points: &registration.points,
            triangles: &mesh.triangles,
            point_data,
            ..PolyData::default()
        };
        vtp::write(path, &data)
    }

    /// B with its distances from A.
    fn write_fixed(&self, path: &Path) -> io::Result<()> {
        let fixed = self.meshes[1];
        let distances = self.registration.distances_back.clone();
        let data = PolyData {
            points: &fixed.vertices,
            triangles: &fixed.triangles,
            point_data: vec![("distance", distances)],
            ..PolyData::default()
        };
        vtp::write(path, &data)
    }

    fn camera(&self, points: &[&[Point3<f64>]], canvas: Canvas) -> Camera {
        let frame: Matrix3<f64> = axes(self.meshes[1]);
        let [long, across] = [0, 2].map(|k| frame.column(k).into_owned());
        // Neither upside down nor from behind.
        let up = if long.y < 0.0 { -long } else { long };
        let from = if across.z < 0.0 { -across } else { across };
        let all = points.iter().flat_map(|x| x.iter().copied());
        Camera::fit(all, &View::orthographic(from, up), canvas)
    }

    /// A, blue, and B in their initial positions.
    fn before(&self) -> Frame {
        let [a, b] = self.meshes;
        let camera = self.camera(
            &[&a.vertices, &b.vertices],
            Canvas::new(SIZE.0, SIZE.1).with_top(26.0),
        );
        let moving = Surface::plain(&a.vertices, &a.triangles, MOVING);
        let fixed = Surface::plain(&b.vertices, &b.triangles, colour::BONE).with_opacity(0.55);
        let mut frame = render(&Drawing::of([moving, fixed]), &camera);
        frame.title("before: A blue, B pale", TextStyle::Small);
        frame
    }

    /// A coloured by its distance from B, and B around it.
    fn after(&self) -> Frame {
        let ([a, b], registration) = (self.meshes, self.registration);
        // Vertices without a place on B must not make the others pale.
        let on = registration
            .distances
            .iter()
            .zip(&registration.inliers)
            .filter(|(_, on)| **on)
            .map(|(d, _)| *d);
        let shown = (&registration.points[..], &a.triangles[..]);
        let around = (&b.vertices[..], &b.triangles[..]);
        let title = "after: A by its distance from B";
        self.by_distance(
            shown,
            &registration.distances,
            max_or_nan(on),
            around,
            title,
        )
    }

    /// B coloured by its distance from A, and A around it.
    fn bare_parts(&self) -> Frame {
        let ([a, b], registration) = (self.meshes, self.registration);
        let shown = (&b.vertices[..], &b.triangles[..]);
        let around = (&registration.points[..], &a.triangles[..]);
        let distances = &registration.distances_back;
        let most = max_or_nan(distances.iter().copied());
        self.by_distance(
            shown,
            distances,
            most,
            around,
            "after: B by its distance from A",
        )
    }

    fn by_distance(
        &self,
        shown: Triangles<'_>,
        distances: &[f64],
        most: f64,
        around: Triangles<'_>,
        title: &str,
    ) -> Frame {
        let range = (0.0, most);
        let unit = self.unit.unwrap_or("");
        let legend = Legend::new("Distance", unit, range, ColourMap::Viridis);
        let room = legend.width();
        let canvas = Canvas::new(SIZE.0 + room as u32, SIZE.1)
            .with_right(room)
            .with_top(26.0);
        let bounds = Aabb::of_points(&self.meshes[1].vertices);
        let camera = self.camera(&[&self.registration.points, &bounds.corners()], canvas);
        let field = Surface::field(shown.0, shown.1, distances, range, ColourMap::Viridis);
        let other = Surface::plain(around.0, around.1, colour::BONE).with_opacity(0.15);
        let mut frame = render(&Drawing::of([field, other]), &camera);
        legend.draw(&mut frame);
        frame.title(title, TextStyle::Small);
        frame
    }

    fn tables(&self, summary: &Summary) -> Vec<Table> {
        let mut found = Table::new("Motion", ["what", "value"]);
        found.row(["turned [degrees]", &format!("{:.3}", summary.turned_deg)]);
        found.row(["scaled by", &number(summary.scale)]);
        found.row([
            "points of the start that agree",
            &format!("{} of {}", summary.start_inliers, summary.start_tried),
        ]);
        found.row(["rounds of closest points", &summary.rounds.to_string()]);
        if let Some(bent) = &summary.non_rigid {
            found.row(["clusters that bend", &bent.clusters.to_string()]);
            found.row(["rounds of bending", &bent.rounds.to_string()]);
            found.row([
                "moved further by bending, greatest",
                &number(bent.moved_max),
            ]);
            found.row([
                "neighbours turned apart, greatest [degrees]",
                &format!("{:.2}", bent.bend_max_deg),
            ]);
        }
        let mut matrix = Table::new("Matrix, for columns of positions of A", ["", "", "", ""]);
        summary
            .matrix
            .iter()
            .for_each(|row| matrix.row(row.map(|v| format!("{v:.9}"))));
        let mut distances =
            Table::new("Distance from B", ["vertices", "rms", "median", "greatest"]);
        for (what, d) in [("on B", summary.residual), ("all", summary.distance)] {
            distances.row([
                what.to_owned(),
                number(d.rms),
                number(d.median),
                number(d.max),
            ]);
        }
        let columns = ["from all vertices of", "median", "95 % below", "greatest"];
        let mut both = Table::new("Distances in both directions", columns);
        for (what, d) in [
            ("A to B", summary.distance_a_to_b_m),
            ("B to A", summary.distance_b_to_a_m),
        ] {
            both.row([
                what.to_owned(),
                number(d.median),
                number(d.p95),
                number(d.max),
            ]);
        }
        vec![found, distances, both, matrix]
    }
}
