//! Skin over implants as a table, JSON, pictures, files and a page.

mod pictures;
mod tables;

use std::io;
use std::path::Path;

use nalgebra::Isometry3;
use serde_json::{Value, json};

use super::output::{OutputFile, Picture, Plot, RunOutput, Verdict};
use pliant::io::vtp;
use pliant::mesh::TriangleMesh;
use pliant::skin::{
    Areas, CAVEATS, GROWN_SOURCE, ImplantSpec, Inserted, PreparedPatch, RETRACTED_SOURCE,
    SettleProgress, Shell, Whole, stretches,
};
use pliant_render::PictureError;

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

/// Results of an insertion.
#[derive(Debug)]
pub struct Insertion<'a> {
    /// Name of the skin.
    pub name: String,
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
    /// True if an interruption left out requested implants or volumes.
    pub interrupted: bool,
    /// Requested gain [m^2].
    pub wanted: Option<f64>,
    /// Total time [s].
    pub time: f64,
    /// What lies under the skin, `implant` or `ball`, in captions.
    pub under: &'static str,
}

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
    /// Indices of the implants that share its skin, from 1.
    shares: Vec<usize>,
}

pub(super) fn json_of(areas: &Areas) -> Value {
    json!({
        "area_before_m2": areas.before,
        "area_deformed_m2": areas.deformed,
        "area_retracted_m2": areas.retracted,
        "area_grown_m2": areas.grown,
        "volume_difference_m3": areas.volume_difference,
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
                let shares = numbers
                    .iter()
                    .filter(|n| **n != number)
                    .map(|n| n + 1)
                    .collect();
                all.push(Single {
                    number,
                    order,
                    frame,
                    ready,
                    done,
                    region,
                    shell: done.shells.get(k),
                    shares,
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
        self.implants.iter().map(|(_, done)| done.volume()).sum()
    }

    /// Total areas of all implants.
    pub fn areas(&self) -> Areas {
        self.implants.iter().map(|(_, done)| done.areas).sum()
    }

    /// True if all parts reached their equilibrium.
    pub fn converged(&self) -> bool {
        self.implants
            .iter()
            .all(|(_, done)| done.progress.converged)
            && self.curve.iter().all(|point| point.progress.converged)
    }

    /// Results of the checks: whether everything shown, and every volume of a curve, is at rest.
    pub fn verdicts(&self) -> Vec<Verdict> {
        let at_rest = "skin and implant are at rest";
        let alone = |single: &Single| {
            self.curve
                .iter()
                .all(|point| point.implant != single.number + 1)
        };
        let shown = self.each().into_iter().filter(alone).map(|one| {
            let (number, cc) = (one.number + 1, one.volume() * 1e6);
            Verdict::new(at_rest, one.done.progress.converged)
                .at(format!("implant {number}, {cc:.1} cc"))
        });
        let curve = self.curve.iter().map(|point| {
            let day = point
                .day
                .map_or(String::new(), |day| format!(", day {day}"));
            let (called, cc) = (self.called(point.implant), point.volume * 1e6);
            Verdict::new(at_rest, point.progress.converged)
                .at(format!("implant {called}{day}, {cc:.1} cc"))
        });
        let complete = Verdict::new("the result is complete: it was interrupted", false);
        let cut = self.interrupted.then_some(complete);
        cut.into_iter().chain(shown).chain(curve).collect()
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

    /// The JSON of `--json`.
    pub fn to_json(&self) -> Value {
        let each = self.each().into_iter().map(|one| {
            let (volume, pressure) = (one.volume(), one.pressure());
            let Single {
                number,
                order,
                frame,
                ready,
                done,
                shares,
                ..
            } = one;
            let own = json!({
                "implant": number + 1,
                "shares_skin_with": shares,
                "shape": order.implant.shape.name(),
                "base_m": order.implant.base,
                "implant_volume_m3": volume,
                "depth_m": order.tissue.depth,
                "edge_m": ready.layers.edge,
                "centre_m": frame.translation.vector.as_slice(),
                "pressure_pa": pressure,
                "area_gain_uncertainty_m2": done.gain_uncertainty(),
                "residual": done.progress.residual,
                "penetration_m": done.progress.depth,
                "rounds": done.progress.rounds,
                "steps": done.progress.iterations,
                "converged": done.progress.converged,
                "rest_by": done.progress.rest_by(),
            });
            joined(own, json_of(&done.areas))
        });
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
        let all = json!({
            "skin": self.name,
            "implant_volume_m3": self.volume(),
            "region": {
                "vertices": self.count(|r| 2 * r.layers.count()),
                "triangles": self.count(|r| 2 * r.layers.triangles.len()),
                "springs": self.count(|r| r.layers.springs.len()),
            },
            "area_gain_uncertainty_m2": self.gain_uncertainty(),
            "steps": self.implants.iter().map(|(_, done)| done.progress.iterations).sum::<u32>(),
            "converged": self.converged() && !self.interrupted,
            // An empty sum is minus zero.
            "area_over_limit_m2": self.over_limit() + 0.0,
            "wanted_area_m2": self.wanted,
            "stretch_limit": self.limit,
            "sources": {"retracted": RETRACTED_SOURCE, "grown": GROWN_SOURCE},
            "implants": each.collect::<Vec<_>>(),
            "curve": curve.collect::<Vec<_>>(),
        });
        joined(json_of(&self.areas()), all)
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
        self.implants.iter().map(of).sum()
    }

    /// The files of results with this number of implants, with those of a curve.
    pub fn files(implants: usize, curve: bool) -> Vec<String> {
        let fixed = [
            "skin.vtp",
            "stretch.png",
            "side.png",
            "before.png",
            "summary.json",
            "report.html",
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

    /// The result.
    ///
    /// # Errors
    /// A picture that cannot be encoded.
    pub fn output(&self) -> Result<RunOutput<'_>, PictureError> {
        let (shown, each) = (self.shown(), self.each());
        let (count, tables) = (each.len(), self.tables());
        let pictures = self.pictures(&shown)?;
        let mut files = vec![OutputFile::new("skin.vtp", move |path| {
            self.write_skin(&shown, path)
        })];
        for one in each {
            let name = format!("implant_{}.vtp", one.number + 1);
            files.push(OutputFile::new(name, move |path| {
                let shell = one.mesh();
                let data = vtp::PolyData {
                    points: &shell.vertices,
                    triangles: &shell.triangles,
                    ..vtp::PolyData::default()
                };
                vtp::write(path, &data)
            }));
        }
        let plot = |plot| Plot {
            file: Some("curve.svg".to_owned()),
            plot,
        };
        Ok(RunOutput {
            kind: "implant",
            name: self.name.clone(),
            measures: self.to_json(),
            verdicts: self.verdicts(),
            findings: self.findings(),
            interrupted: self.interrupted,
            time_s: self.time,
            title: format!(
                "{}: {count} implant{}",
                self.name,
                if count == 1 { "" } else { "s" }
            ),
            subtitle: format!("{:.1} s", self.time),
            tables_of_text: tables.len(),
            tables,
            pictures,
            plots_title: "Areas of several volumes".to_owned(),
            plots: self.plot().into_iter().map(plot).collect(),
            explanations: CAVEATS.map(str::to_owned).to_vec(),
            data: Some(self.csv())
                .filter(|_| !self.curve.is_empty())
                .into_iter()
                .collect(),
            files,
            ..RunOutput::default()
        })
    }

    /// The whole skin with its stretch.
    fn write_skin(&self, shown: &Shown, path: &Path) -> io::Result<()> {
        let over: Vec<f64> = shown
            .stretch
            .iter()
            .map(|s| f64::from(u8::from(*s > self.limit)))
            .collect();
        let data = vtp::PolyData {
            points: &shown.skin.vertices,
            triangles: &shown.skin.triangles,
            lines: &[],
            point_data: vec![("stretch", shown.stretch.clone()), ("over_limit", over)],
        };
        vtp::write(path, &data)
    }

    /// The whole skin before and at equilibrium.
    pub(super) fn shown(&self) -> Shown {
        let ready: Vec<&PreparedPatch> = self.implants.iter().map(|(ready, _)| ready).collect();
        let whole = Whole::of(self.skin, &ready);
        let (mut x, mut stretch) = (
            whole.mesh.vertices.clone(),
            vec![1.0; whole.mesh.vertices.len()],
        );
        for ((ready, done), names) in self.implants.iter().zip(&whole.vertices) {
            let at = at_vertices(ready, done);
            for (v, part) in ready.region.vertices.iter().enumerate() {
                let name = names[*part as usize] as usize;
                (x[name], stretch[name]) = (done.x[v], at[v]);
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
        }
    }
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
