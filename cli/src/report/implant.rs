//! Skin over implants: tables, pictures, findings and files.

mod overview;
mod pictures;
mod section;
mod tables;

use std::io;
use std::path::Path;

use nalgebra::{Isometry3, Point3, Vector3};
use serde_json::{Value, json};

use super::output::{OutputFile, Picture, Plot};
use pliant::io::vtp;
use pliant::mesh::TriangleMesh;
use pliant::skin::{
    Areas, ImplantSpec, Inserted, PreparedPatch, SettleProgress, Shell, Whole, stretches,
};

/// Results for one of several volumes of an implant.
#[derive(Clone, Copy, Debug)]
pub struct Point {
    /// Index of the implant, from 1; the first of those that share skin.
    pub implant: usize,
    /// Day of the filling.
    pub day: Option<f64>,
    /// Volume [m^3]; for implants that share skin the total.
    pub volume: f64,
    /// Areas.
    pub areas: Areas,
    /// State of the solution.
    pub progress: SettleProgress,
}

/// The present state of skin over implants.
#[derive(Debug)]
pub struct Insertion<'a> {
    /// The skin as read [m].
    pub skin: &'a TriangleMesh,
    /// Implants, in groups that share skin.
    pub implants: Vec<(PreparedPatch, Inserted)>,
    /// Indices of these implants, from 0.
    pub numbers: Vec<Vec<usize>>,
    /// Meshes below the implants [m].
    pub obstacles: &'a [TriangleMesh],
    /// Results for several volumes of an implant.
    pub curve: Vec<Point>,
    /// Stretch above which skin counts as stretched too far.
    pub limit: f64,
    /// What lies under the skin, `implant` or `ball`, in captions.
    pub under: &'static str,
    /// Direction that is up in pictures, if given.
    pub up: Option<Vector3<f64>>,
}

pub use overview::preview;

/// One implant, with the skin that it can share with others.
struct Single<'a> {
    /// Index, from 0.
    number: usize,
    order: &'a ImplantSpec,
    frame: &'a Isometry3<f64>,
    ready: &'a PreparedPatch,
    done: &'a Inserted,
    /// Index of the region of its skin.
    region: usize,
    /// `None` for a ball.
    shell: Option<&'a Shell>,
}

pub(super) fn json_of(areas: &Areas) -> Value {
    json!({
        "area_before_m2": areas.before,
        "area_deformed_m2": areas.deformed,
        "area_retracted_m2": areas.retracted,
        "area_grown_m2": areas.grown,
        "volume_difference_m3": areas.volume_difference,
        "room_m3": areas.room,
        "stretch_max": areas.stretch_max,
    })
}

/// Adds the entries of one object to another.
pub(super) fn joined(mut first: Value, second: Value) -> Value {
    if let (Some(first), Value::Object(second)) = (first.as_object_mut(), second) {
        first.extend(second);
    }
    first
}

/// Skin for pictures.
#[derive(Debug)]
pub(super) struct Shown {
    /// The skin before, with its patches.
    pub whole: Whole,
    /// The skin at equilibrium.
    pub skin: TriangleMesh,
    /// The greatest stretch at each vertex.
    pub stretch: Vec<f64>,
    /// The number of the region at each vertex, from 1; 0 outside, and 0.5 less on its held rim.
    pub region: Vec<f64>,
    /// The lower layer at rest and now at each vertex; the upper one outside.
    pub lower: [Vec<Point3<f64>>; 2],
}

impl Single<'_> {
    /// Volume [m^3].
    fn volume(&self) -> f64 {
        self.shell.map_or(0.0, |shell| shell.volume)
    }

    /// Pressure [Pa].
    fn pressure(&self) -> f64 {
        self.shell
            .map_or(self.done.progress.pressure, |shell| shell.pressure)
    }

    /// The shell at equilibrium; empty for a ball.
    fn mesh(&self) -> TriangleMesh {
        self.shell
            .map_or_else(TriangleMesh::default, |shell| TriangleMesh {
                vertices: self.done.shell_at(shell).to_vec(),
                triangles: shell.triangles.clone(),
            })
    }
}

impl Insertion<'_> {
    /// Each implant in the order of its index.
    fn each(&self) -> Vec<Single<'_>> {
        let mut all = Vec::new();
        for (region, ((ready, done), numbers)) in
            self.implants.iter().zip(&self.numbers).enumerate()
        {
            for (k, ((order, frame), &number)) in ready.sites().zip(numbers).enumerate() {
                all.push(Single {
                    number,
                    order,
                    frame,
                    ready,
                    done,
                    region,
                    shell: done.shells.get(k),
                });
            }
        }
        all.sort_by_key(|single| single.number);
        all
    }

    /// The index of an implant, from 1, with those that share its skin.
    fn called(&self, implant: usize) -> String {
        let own = self
            .numbers
            .iter()
            .find(|numbers| numbers.first().map(|k| k + 1) == Some(implant));
        let numbers = own.map_or(vec![implant], |numbers| {
            numbers.iter().map(|k| k + 1).collect()
        });
        numbers
            .iter()
            .map(usize::to_string)
            .collect::<Vec<_>>()
            .join(" and ")
    }

    /// Uncertainty of the gain from the mesh [m^2]; `None` if unknown for one of them.
    pub fn gain_uncertainty(&self) -> Option<f64> {
        self.implants
            .iter()
            .map(|(_, done)| done.gain_uncertainty())
            .sum()
    }

    /// Volume of all implants [m^3].
    fn volume(&self) -> f64 {
        // An empty sum is minus zero.
        self.implants
            .iter()
            .map(|(_, done)| done.volume())
            .sum::<f64>()
            + 0.0
    }

    /// Volume between the lower layer, what lay below it and the implants [m^3]: a fluid would fill
    /// it. `None` over obstacles, between which and the skin there is more room.
    fn void_volume(&self) -> Option<f64> {
        let room: f64 = self.implants.iter().map(|(_, done)| done.areas.room).sum();
        self.obstacles.is_empty().then(|| room - self.volume())
    }

    /// Total areas of all implants.
    pub fn areas(&self) -> Areas {
        self.implants.iter().map(|(_, done)| done.areas).sum()
    }

    /// Findings that are neither right nor wrong: highly stretched skin.
    pub fn findings(&self) -> Vec<String> {
        let (area, limit) = (self.over_limit(), self.limit);
        vec![if area > 0.0 {
            let cm2 = pliant::format::number(area * 1e4);
            format!("{cm2} cm2 are stretched beyond {limit:.2}: too far, if that limit is right")
        } else {
            format!("nothing is stretched beyond {limit:.2}")
        }]
    }

    fn count(&self, of: impl Fn(&PreparedPatch) -> usize) -> usize {
        self.implants.iter().map(|(ready, _)| of(ready)).sum()
    }

    /// The measures of all implants together, and of the volumes of a curve.
    pub(super) fn to_json(&self) -> Value {
        let curve = self.curve.iter().map(|point| {
            let own = json!({
                "implant": point.implant,
                "day": point.day,
                "implant_volume_m3": point.volume,
                "converged": point.progress.converged,
                "steps": point.progress.iterations,
            });
            joined(own, json_of(&point.areas))
        });
        json!({
            "implant_volume_m3": self.volume(),
            "void_volume_m3": self.void_volume(),
            "bond_n_per_m3": self.implants.first().map(|(ready, _)| ready.order.tissue.bond),
            "pocket": self.implants.first().map(|(ready, _)| ready.order.tissue.pocket),
            "region": {
                "vertices": self.count(|r| 2 * r.layers.count()),
                "triangles": self.count(|r| 2 * r.layers.triangles.len()),
                "springs": self.count(|r| r.layers.springs.len()),
            },
            "area_gain_uncertainty_m2": self.gain_uncertainty(),
            "area_over_limit_m2": self.over_limit(),
            "curve": curve.collect::<Vec<_>>(),
        })
    }

    /// Initial area of the skin that is stretched beyond the limit [m^2].
    pub(super) fn over_limit(&self) -> f64 {
        let of = |(ready, done): &(PreparedPatch, Inserted)| {
            let layers = &ready.layers;
            let n = layers.count();
            let stretch = stretches(&layers.rest[..n], &done.x[..n], &layers.triangles);
            let areas =
                pliant::mesh::measures::triangle_areas(&layers.rest[..n], &layers.triangles);
            areas
                .iter()
                .zip(stretch)
                .filter(|(_, s)| *s > self.limit)
                .map(|(a, _)| a)
                .sum::<f64>()
        };
        // An empty sum is minus zero.
        self.implants.iter().map(of).sum::<f64>() + 0.0
    }

    /// The surfaces and pictures of this number of implants, with the files of a curve.
    pub fn files(implants: usize, curve: bool) -> Vec<String> {
        let fixed = [
            "skin.vtp",
            "stretch.png",
            "side.png",
            "before.png",
            "overview.png",
        ];
        let of_curve = ["curve.csv", "curve.svg"].into_iter().filter(|_| curve);
        let shells = (1..=implants).map(|k| format!("implant_{k}.vtp"));
        let more = |k: usize| ["stretch", "side", "before"].map(|what| format!("{what}_{k}.png"));
        let each = shells.chain((2..=implants).flat_map(more));
        fixed
            .into_iter()
            .chain(of_curve)
            .map(str::to_owned)
            .chain(each)
            .collect()
    }

    /// The surfaces at equilibrium: the whole skin with its stretch, and each implant if there are
    /// `implants` and no ball.
    pub(super) fn surfaces(&self, shown: Shown, implants: bool) -> Vec<OutputFile<'static>> {
        let limit = self.limit;
        let mut files = vec![OutputFile::new("skin.vtp", move |path| {
            write_skin(&shown, limit, path)
        })];
        for one in self.each().into_iter().filter(|_| implants) {
            let (name, shell) = (format!("implant_{}.vtp", one.number + 1), one.mesh());
            files.push(OutputFile::new(name, move |path| {
                let data = vtp::PolyData {
                    points: &shell.vertices,
                    triangles: &shell.triangles,
                    ..vtp::PolyData::default()
                };
                vtp::write(path, &data)
            }));
        }
        files
    }

    /// The plot of the curve with its file.
    pub(super) fn curve_plot(&self) -> Option<Plot> {
        self.plot().map(|plot| Plot {
            file: Some("curve.svg".to_owned()),
            plot,
        })
    }

    /// The whole skin before and at equilibrium.
    pub(super) fn shown(&self) -> Shown {
        let ready: Vec<&PreparedPatch> = self.implants.iter().map(|(ready, _)| ready).collect();
        let whole = Whole::of(self.skin, &ready);
        let (mut x, mut stretch) = (
            whole.mesh.vertices.clone(),
            vec![1.0; whole.mesh.vertices.len()],
        );
        let mut region = vec![0.0; x.len()];
        let mut lower = [x.clone(), x.clone()];
        for (k, ((ready, done), names)) in self.implants.iter().zip(&whole.vertices).enumerate() {
            let at = at_vertices(ready, done);
            let (layers, n) = (&ready.layers, ready.layers.count());
            for (v, part) in ready.region.vertices.iter().enumerate() {
                let name = names[*part as usize] as usize;
                (x[name], stretch[name]) = (done.x[v], at[v]);
                region[name] = k as f64 + if layers.held[v] { 0.5 } else { 1.0 };
                (lower[0][name], lower[1][name]) = (layers.rest[n + v], done.x[n + v]);
            }
        }
        let skin = TriangleMesh {
            vertices: x,
            triangles: whole.mesh.triangles.clone(),
        };
        Shown {
            whole,
            skin,
            stretch,
            region,
            lower,
        }
    }
}

/// Writes the whole skin with its stretch, region, displacement and lower layer.
fn write_skin(shown: &Shown, limit: f64, path: &Path) -> io::Result<()> {
    let over = |stretch: &f64| f64::from(u8::from(*stretch > limit));
    let data = vtp::PolyData {
        points: &shown.skin.vertices,
        triangles: &shown.skin.triangles,
        point_data: vec![
            ("stretch", shown.stretch.clone()),
            ("over_limit", shown.stretch.iter().map(over).collect()),
            ("region", shown.region.clone()),
            (
                "displacement",
                moved(&shown.whole.mesh.vertices, &shown.skin.vertices),
            ),
            ("lower_layer", moved(&shown.skin.vertices, &shown.lower[1])),
            (
                "lower_displacement",
                moved(&shown.lower[0], &shown.lower[1]),
            ),
        ],
        ..vtp::PolyData::default()
    };
    vtp::write(path, &data)
}

/// Vectors from one place of each vertex to another, their components together.
fn moved(from: &[Point3<f64>], to: &[Point3<f64>]) -> Vec<f64> {
    let vector = |(a, b): (&Point3<f64>, &Point3<f64>)| <[f64; 3]>::from(b - a);
    from.iter().zip(to).flat_map(vector).collect()
}

/// Mean of the greatest stretches of a vertex's triangles.
fn at_vertices(ready: &PreparedPatch, done: &Inserted) -> Vec<f64> {
    let layers = &ready.layers;
    let n = layers.count();
    let mut sums = vec![(0.0, 0.0f64); n];
    let all = stretches(&layers.rest[..n], &done.x[..n], &layers.triangles);
    for (t, stretch) in layers.triangles.iter().zip(all) {
        t.iter().for_each(|v| {
            sums[*v as usize] = (sums[*v as usize].0 + stretch, sums[*v as usize].1 + 1.0)
        });
    }
    sums.iter()
        .map(|(sum, count)| sum / count.max(1.0))
        .collect()
}
