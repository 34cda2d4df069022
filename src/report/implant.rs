//! Skin over implants as a table, JSON, pictures, files and a page.

mod pictures;

use serde_json::{Value, json};

use super::folder::{Folder, FolderError};
use super::html::Report;
use super::plot::LinePlot;
use super::table::Table;
use crate::io::vtp;
use crate::mesh::TriangleMesh;
use crate::render::PictureError;
use crate::skin::areas::{GROWN_SOURCE, RETRACTED_SOURCE, stretches};
use crate::skin::plan::{Inserted, Ready};
use crate::skin::settle::Progress;
use crate::skin::whole::Whole;
use crate::skin::{Areas, Interval};

/// Name, caption and bytes of a picture.
pub(super) type Picture = (String, String, Vec<u8>);

/// Why the results cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// The folder.
    #[error(transparent)]
    Folder(#[from] FolderError),
    /// A picture.
    #[error("a picture cannot be encoded: {0}")]
    Picture(#[from] PictureError),
}

/// What one of several volumes of an implant does.
#[derive(Clone, Copy, Debug)]
pub struct Point {
    /// The implant, from 1.
    pub implant: usize,
    /// The day of its filling.
    pub day: Option<f64>,
    /// Its volume [m^3].
    pub volume: f64,
    /// The areas.
    pub areas: Areas,
    /// How they were found.
    pub progress: Progress,
}

/// What was done.
#[derive(Debug)]
pub struct Insertion<'a> {
    /// Name of the skin.
    pub name: String,
    /// The skin as read [m].
    pub skin: &'a TriangleMesh,
    /// Each implant.
    pub implants: Vec<(Ready, Inserted)>,
    /// Meshes that the implants rest on [m].
    pub obstacles: &'a [TriangleMesh],
    /// What several volumes of an implant do.
    pub curve: Vec<Point>,
    /// Stretch above which skin counts as stretched too far.
    pub limit: f64,
    /// The gain that was asked for [m^2].
    pub wanted: Option<f64>,
    /// Time of all of it [s].
    pub time: f64,
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

/// Decimals of an area in cm2 that rests on a published span of a gain [m^2]: two digits of the gain at most.
fn decimals(gain: f64) -> usize {
    match (gain * 1e4).abs() {
        gain if gain >= 10.0 => 0,
        gain if gain >= 1.0 => 1,
        _ => 2,
    }
}

/// Adds the entries of one object to another.
pub(super) fn joined(mut first: Value, second: Value) -> Value {
    if let (Some(first), Value::Object(second)) = (first.as_object_mut(), second) {
        first.extend(second);
    }
    first
}

/// What the table tells of an implant.
type Told = fn(&Ready, &Inserted) -> String;

/// The rows of the table of implants, which has a column for each.
const ROWS: [(&str, Told); 11] = [
    ("shape", |ready, _| ready.order.implant.shape.name().to_owned()),
    ("base [cm]", |ready, _| format!("{:.1}", ready.order.implant.base * 1e2)),
    ("volume [cc]", |_, done| format!("{:.1}", done.implant_volume * 1e6)),
    ("vertices", |ready, _| (2 * ready.layers.count()).to_string()),
    ("triangles", |ready, _| (2 * ready.layers.triangles.len()).to_string()),
    ("springs", |ready, _| ready.layers.springs.len().to_string()),
    ("steps", |_, done| done.progress.iterations.to_string()),
    ("residual", |_, done| format!("{:.1e}", done.progress.residual)),
    ("depth in each other [mm]", |_, done| format!("{:.3}", done.progress.depth * 1e3)),
    ("pressure [kPa]", |_, done| format!("{:.2}", done.progress.pressure * 1e-3)),
    ("at rest", |_, done| if done.progress.converged { "yes" } else { "NO" }.to_owned()),
];

/// Skin that is shown.
#[derive(Debug)]
pub(super) struct Shown {
    /// Before, patches in it.
    pub whole: Whole,
    /// As it comes to lie.
    pub skin: TriangleMesh,
    /// The greatest stretch at each vertex.
    pub stretch: Vec<f64>,
}

impl Insertion<'_> {
    /// Areas of all implants together.
    pub fn areas(&self) -> Areas {
        self.implants.iter().map(|(_, done)| done.areas).sum()
    }

    /// Whether all came to rest.
    pub fn converged(&self) -> bool {
        self.implants.iter().all(|(_, done)| done.progress.converged)
            && self.curve.iter().all(|point| point.progress.converged)
    }

    fn count(&self, of: impl Fn(&Ready) -> usize) -> usize {
        self.implants.iter().map(|(ready, _)| of(ready)).sum()
    }

    /// As `--json` gives it.
    pub fn to_json(&self) -> Value {
        let each = self.implants.iter().map(|(ready, done)| {
            let own = json!({
                "shape": ready.order.implant.shape.name(),
                "base_m": ready.order.implant.base,
                "implant_volume_m3": done.implant_volume,
                "depth_m": ready.order.tissue.depth,
                "edge_m": ready.layers.edge,
                "centre_m": ready.frame.translation.vector.as_slice(),
                "pressure_pa": done.progress.pressure,
                "residual": done.progress.residual,
                "penetration_m": done.progress.depth,
                "rounds": done.progress.rounds,
                "steps": done.progress.iterations,
                "converged": done.progress.converged,
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
            "implant_volume_m3": self.implants.iter().map(|(_, done)| done.implant_volume).sum::<f64>(),
            "region": {
                "vertices": self.count(|r| 2 * r.layers.count()),
                "triangles": self.count(|r| 2 * r.layers.triangles.len()),
                "springs": self.count(|r| r.layers.springs.len()),
            },
            "steps": self.implants.iter().map(|(_, done)| done.progress.iterations).sum::<u32>(),
            "converged": self.converged(),
            "time_s": self.time,
            "wanted_area_m2": self.wanted,
            "stretch_limit": self.limit,
            "sources": {"area_retracted_m2": RETRACTED_SOURCE, "area_grown_m2": GROWN_SOURCE},
            "implants": each.collect::<Vec<_>>(),
            "curve": curve.collect::<Vec<_>>(),
        });
        joined(json_of(&self.areas()), all)
    }

    /// What a surgeon reads.
    pub fn table(&self) -> Table {
        let areas = self.areas();
        let mut table = Table::new("Areas and volumes", ["what", "value", "gain", "source"]);
        let few = decimals(areas.gain());
        let more = few + 1;
        let cm2 = |m2: f64| format!("{:.more$}", m2 * 1e4);
        let gained = |m2: f64| format!("{:+.more$}", (m2 - areas.before) * 1e4);
        let span = |i: Interval| format!("{:.few$} to {:.few$}", i.low * 1e4, i.high * 1e4);
        let span_gained = |i: Interval| {
            format!("{:+.few$} to {:+.few$}", (i.low - areas.before) * 1e4, (i.high - areas.before) * 1e4)
        };
        let mut row = |what: &str, value: String, gain: String, source: &str| {
            table.row([what.to_owned(), value, gain, source.to_owned()]);
        };
        row("area before [cm2]", cm2(areas.before), String::new(), "the mesh");
        row("area deformed [cm2]", cm2(areas.deformed), gained(areas.deformed), "equilibrium: an upper bound");
        row("area retracted [cm2]", span(areas.retracted), span_gained(areas.retracted), RETRACTED_SOURCE);
        row("area grown [cm2]", span(areas.grown), span_gained(areas.grown), GROWN_SOURCE);
        let cc = |m3: f64| format!("{:.1}", m3 * 1e6);
        let implants = self.implants.iter().map(|(_, done)| done.implant_volume).sum();
        row("volume of implants [cc]", cc(implants), String::new(), "kept exactly");
        row("volume difference of the region [cc]", cc(areas.volume_difference), String::new(), "closed at its rim");
        row("greatest stretch", format!("{:.2}", areas.stretch_max), String::new(), "of a triangle, any direction");
        // An empty sum is minus zero.
        let over = format!("{:.1}", self.over_limit() * 1e4 + 0.0);
        row(
            &format!("area stretched over {:.2} [cm2]", self.limit),
            over,
            String::new(),
            "the limit is --stretch-limit",
        );
        table
    }

    /// How it was found.
    pub fn run_table(&self) -> Table {
        let heads = (1..=self.implants.len()).map(|k| format!("implant {k}"));
        let mut table = Table::new("Implants", std::iter::once(String::new()).chain(heads));
        for (what, value) in ROWS {
            let values = self.implants.iter().map(|(ready, done)| value(ready, done));
            table.row(std::iter::once(what.to_owned()).chain(values));
        }
        table
    }

    /// Area before of what is stretched beyond the limit [m^2].
    pub(super) fn over_limit(&self) -> f64 {
        let of = |(ready, done): &(Ready, Inserted)| {
            let layers = &ready.layers;
            let n = layers.count();
            let stretch = stretches(&layers.rest[..n], &done.x[..n], &layers.triangles);
            let areas = crate::mesh::measures::triangle_areas(&layers.rest[..n], &layers.triangles);
            areas.iter().zip(stretch).filter(|(_, s)| *s > self.limit).map(|(a, _)| a).sum::<f64>()
        };
        self.implants.iter().map(of).sum()
    }

    /// The curve of areas over volumes, or over days, of the first implant that has one; of a single point the table tells all.
    pub fn plot(&self) -> Option<LinePlot> {
        let of = |implant: usize| self.curve.iter().filter(move |point| point.implant == implant);
        let first = self.curve.iter().find(|point| of(point.implant).count() > 1)?;
        let own: Vec<&Point> = of(first.implant).collect();
        let over = |point: &Point| point.day.unwrap_or(point.volume * 1e6);
        let points = |of: &dyn Fn(&Areas) -> f64| -> Vec<(f64, f64)> {
            own.iter().map(|point| (over(point), (of(&point.areas) - point.areas.before) * 1e4)).collect()
        };
        let axis = if first.day.is_some() { "day" } else { "volume [cc]" };
        Some(
            LinePlot::new("Area gained [cm2]", axis)
                .with("deformed", points(&|a| a.deformed))
                .with("retracted, least", points(&|a| a.retracted.low))
                .with("retracted, most", points(&|a| a.retracted.high))
                .with("grown, least", points(&|a| a.grown.low))
                .with("grown, most", points(&|a| a.grown.high)),
        )
    }

    /// What each volume does, as a surgeon reads it.
    fn curve_table(&self) -> Option<Table> {
        let head = ["implant", "day", "volume [cc]", "deformed [cm2]", "retracted [cm2]", "grown [cm2]"];
        let head = head.into_iter().chain(["greatest stretch", "at rest"]);
        let mut table = Table::new("Areas gained by volume", head);
        for point in &self.curve {
            let gained = |m2: f64| (m2 - point.areas.before) * 1e4;
            let few = decimals(point.areas.gain());
            let more = few + 1;
            let span = |i: Interval| format!("{:+.few$} to {:+.few$}", gained(i.low), gained(i.high));
            table.row([
                point.implant.to_string(),
                point.day.map_or("–".to_owned(), |day| day.to_string()),
                format!("{:.1}", point.volume * 1e6),
                format!("{:+.more$}", gained(point.areas.deformed)),
                span(point.areas.retracted),
                span(point.areas.grown),
                format!("{:.2}", point.areas.stretch_max),
                if point.progress.converged { "yes" } else { "NO" }.to_owned(),
            ]);
        }
        (!self.curve.is_empty()).then_some(table)
    }

    /// All tables.
    pub fn tables(&self) -> Vec<Table> {
        [self.table()].into_iter().chain(self.curve_table()).chain([self.run_table()]).collect()
    }

    /// The curve as CSV.
    pub fn csv(&self) -> String {
        let mut text = "implant,day,implant_volume_m3,area_before_m2,area_deformed_m2,area_retracted_low_m2,\
                        area_retracted_high_m2,area_grown_low_m2,area_grown_high_m2,volume_difference_m3,stretch_max,\
                        converged\n"
            .to_owned();
        for Point { implant, day, volume, areas: a, progress } in &self.curve {
            let numbers = [*volume, a.before, a.deformed, a.retracted.low, a.retracted.high, a.grown.low, a.grown.high];
            let numbers: Vec<String> =
                numbers.iter().chain(&[a.volume_difference, a.stretch_max]).map(f64::to_string).collect();
            let day = day.map_or(String::new(), |day| day.to_string());
            text.push_str(&format!("{implant},{day},{},{}\n", numbers.join(","), progress.converged));
        }
        text
    }

    /// Writes skins, implants, pictures, tables and the page.
    ///
    /// # Errors
    /// What the folder or an encoder says.
    pub fn write(&self, folder: &Folder) -> Result<(), ReportError> {
        let io = |path: std::path::PathBuf| move |source| FolderError::Io { path, source };
        let shown = self.shown();
        let Shown { skin, stretch, .. } = &shown;
        let path = folder.claim("skin.vtp")?;
        let over: Vec<f64> = stretch.iter().map(|s| f64::from(u8::from(*s > self.limit))).collect();
        let point_data = vec![("stretch", stretch.clone()), ("over_limit", over)];
        let data = vtp::PolyData { points: &skin.vertices, triangles: &skin.triangles, lines: &[], point_data };
        vtp::write(&path, &data).map_err(io(path))?;
        for (k, (ready, done)) in self.implants.iter().enumerate() {
            let path = folder.claim(&format!("implant_{}.vtp", k + 1))?;
            let points = &done.x[2 * ready.layers.count()..];
            let triangles = &done.implant_triangles;
            let data = vtp::PolyData { points, triangles, lines: &[], point_data: Vec::new() };
            vtp::write(&path, &data).map_err(io(path))?;
        }
        let pictures = self.pictures(&shown)?;
        for (name, _, png) in &pictures {
            folder.write(&format!("{name}.png"), |w| std::io::Write::write_all(w, png))?;
        }
        let text = |name: &str, text: String| folder.write(name, |w| std::io::Write::write_all(w, text.as_bytes()));
        text("summary.json", format!("{}\n", serde_json::to_string_pretty(&self.to_json()).unwrap_or_default()))?;
        if !self.curve.is_empty() {
            text("curve.csv", self.csv())?;
        }
        if let Some(plot) = self.plot() {
            text("curve.svg", plot.to_svg())?;
        }
        text("report.html", self.page(pictures).to_html())?;
        Ok(())
    }

    fn page(&self, pictures: Vec<Picture>) -> Report {
        let over = self.over_limit();
        let mut verdict = vec![("skin and implants are at rest".to_owned(), self.converged())];
        // An empty sum is minus zero.
        let found = format!("{:.1} cm2 are stretched beyond {:.2}", over * 1e4 + 0.0, self.limit);
        verdict.push((found, over == 0.0));
        Report {
            title: format!(
                "{}: {} implant{}",
                self.name,
                self.implants.len(),
                if self.implants.len() == 1 { "" } else { "s" }
            ),
            subtitle: format!("{:.1} s", self.time),
            verdict,
            pictures: pictures.into_iter().map(|(_, caption, png)| (caption, png)).collect(),
            plots_title: "Areas of several volumes".to_owned(),
            plots: self.plot().into_iter().collect(),
            tables: self.tables(),
            notes: notes(),
            ..Report::default()
        }
    }

    /// The whole skin before and as it comes to lie.
    pub(super) fn shown(&self) -> Shown {
        let ready: Vec<&Ready> = self.implants.iter().map(|(ready, _)| ready).collect();
        let whole = Whole::of(self.skin, &ready);
        let (mut x, mut stretch) = (whole.mesh.vertices.clone(), vec![1.0; whole.mesh.vertices.len()]);
        for ((ready, done), names) in self.implants.iter().zip(&whole.vertices) {
            let at = at_vertices(ready, done);
            for (v, part) in ready.region.vertices.iter().enumerate() {
                let name = names[*part as usize] as usize;
                (x[name], stretch[name]) = (done.x[v], at[v]);
            }
        }
        let skin = TriangleMesh { vertices: x, triangles: whole.mesh.triangles.clone() };
        Shown { whole, skin, stretch }
    }
}

/// Mean of the greatest stretches of a vertex's triangles.
fn at_vertices(ready: &Ready, done: &Inserted) -> Vec<f64> {
    let layers = &ready.layers;
    let n = layers.count();
    let mut sums = vec![(0.0, 0.0f64); n];
    let all = stretches(&layers.rest[..n], &done.x[..n], &layers.triangles);
    for (t, stretch) in layers.triangles.iter().zip(all) {
        t.iter().for_each(|v| sums[*v as usize] = (sums[*v as usize].0 + stretch, sums[*v as usize].1 + 1.0));
    }
    sums.iter().map(|(sum, count)| sum / count.max(1.0)).collect()
}

pub(super) fn notes() -> Vec<String> {
    [
        "The deformed area is elastic and an upper bound: in pigs about a third of the gain remained when the expander was taken out.",
        "The intervals are published ratios of a few animals, applied to the area found here; they are not predictions for a patient.",
        "The stiffness of the skin is assumed unless it was given; areas hardly depend on it, pressures do.",
        "The limit of the stretch is a setting, not a measured threshold of perfusion.",
    ]
    .map(str::to_owned)
    .to_vec()
}
