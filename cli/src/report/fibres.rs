//! Fibres of a muscle as numbers, files, pictures and a page.

mod pictures;

use std::io;
use std::path::Path;

use nalgebra::Point3;
use serde::Serialize;

use super::Table;
use super::output::{DataFile, OutputFile, RunOutput, Verdict, measures};
use crate::draft::names;
use pliant::fibres::quality::Quality;
use pliant::fibres::{Area, Attachment, FibreMeasures, HOOK_DEG, Tendon};
use pliant::format::number;
use pliant::io::vtp::{self, PolyData};
use pliant::mesh::TriangleMesh;
use pliant::mesh::measures::max_or_nan;
use pliant_render::PictureError;

/// Greatest permitted distance of a fibre end from its projected area [m].
pub const AT_AREA: f64 = 1e-5;
/// Least share of the volume within one mean spacing of a fibre.
pub const COVERED: f64 = 0.95;
/// Greatest relative difference from a table's optimal length that is no finding.
const OPTIMAL: f64 = 0.35;
/// Number of rows of the table of fibres in the report; fibres.csv has all.
const ROWS: usize = 100;

/// The written files.
pub const FILES: [&str; 9] = [
    "fibres.vtp",
    "muscle.vtp",
    "fibres.csv",
    "points.csv",
    "summary.json",
    "broad.png",
    "narrow.png",
    "sections.png",
    "report.html",
];

/// Results of a decomposition.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// Name of the method.
    pub method: String,
    /// Name of the template, if any.
    pub template: Option<String>,
    /// The aponeuroses, as given.
    pub aponeurosis: Option<String>,
    /// Median angle between the last 0.5 % of a fibre and its direction 6 to 10 % before its end,
    /// over both ends of all fibres [degrees].
    pub tilt_at_ends_deg_median: f64,
    /// Number of fibres that turn back.
    pub turns_back: usize,
    /// Median length of the fibres [m].
    pub length_median_m: f64,
    /// That over the optimal length of a table, if one is given.
    pub optimal_length_ratio: Option<f64>,
    /// Quality measures.
    #[serde(flatten)]
    pub quality: Quality,
    /// Time of the decomposition, without reading and projecting areas [s].
    pub decomposition_s: f64,
    /// Number of vertices of the muscle.
    pub vertices: usize,
    /// Enclosed volume, with closed holes [m3].
    pub volume_m3: f64,
    /// Physiological cross-section: volume over mean length of the fibres [m2].
    pub cross_section_m2: f64,
    /// Shortest fibre [m].
    pub length_min_m: f64,
    /// Longest fibre [m].
    pub length_max_m: f64,
    /// Area of the origin on the muscle [m2].
    pub origin_area_m2: f64,
    /// Area of the insertion on the muscle [m2].
    pub insertion_area_m2: f64,
    /// Greatest distance of a vertex of the origin to its given patch or bone [m].
    pub origin_distance_max_m: f64,
    /// Greatest distance of a vertex of the insertion to its given patch or bone [m].
    pub insertion_distance_max_m: f64,
    /// Number of lines on the surface.
    pub lines: usize,
    /// Greatest distance of a point of those lines to the surface before the registration [m].
    pub lines_distance_max_m: f64,
    /// Number of passes of smoothing.
    pub smooth_steps: u32,
    /// Share of the distance that a point moves in a pass.
    pub smooth_factor: f64,
}

/// Fibres of a muscle.
#[derive(Clone, Copy, Debug)]
pub struct Bundle<'a> {
    /// Name of the muscle.
    pub name: &'a str,
    /// The muscle [m].
    pub muscle: &'a TriangleMesh,
    /// Attachment areas.
    pub attachment: &'a Attachment,
    /// Each fibre from origin to insertion [m].
    pub fibres: &'a [Vec<Point3<f64>>],
    /// One tendon per fibre, or none, at the origin and at the insertion.
    pub tendons: &'a [Vec<Tendon>; 2],
    /// Registered lines on the surface [m].
    pub lines: &'a [Vec<Point3<f64>>],
    /// Measures of each fibre.
    pub each: &'a [FibreMeasures],
    /// Measures of all.
    pub summary: &'a Summary,
    /// Information that the reader needs.
    pub notes: &'a [String],
    /// Wall time of all of it [s].
    pub time_s: f64,
}

/// Greatest mean pennation [degrees]: dissections find at most half of it in human muscles.
const PENNATION: f64 = 60.0;
/// Greatest length of a fibre, relative to the distance of its ends: half a circle has 1.57.
const WINDING: f64 = 2.0;

impl<'a> Bundle<'a> {
    /// Results of the checks.
    pub fn verdicts(&self) -> Vec<Verdict> {
        let q = &self.summary.quality;
        let mut all = vec![
            Verdict::none("points outside the muscle", q.outside),
            Verdict::at_most(
                "distance of an end from its area",
                q.end_distance_max_m,
                AT_AREA,
            )
            .in_unit("m"),
        ];
        let ratio = self.each.iter().map(|fibre| fibre.length_m / fibre.chord_m);
        let name = "length of a fibre, relative to the distance of its ends";
        let cure = "look for fibres that turn back, and for areas on the wrong end";
        all.push(Verdict::at_most(name, max_or_nan(ratio), WINDING).else_do(cure));
        if self.summary.template.as_deref() != Some("curved") {
            let name = "fibres that turn back by more than 120 degrees";
            let cure = "look for an area on the wrong bone, or for one that lies beside the other";
            all.push(Verdict::none(name, self.summary.turns_back).else_do(cure));
            let name = "mean angle between fibres and line of action";
            let pennation = q.pennation_mean_rad.to_degrees();
            let cure = "look for areas on the sides of the muscle in place of its ends";
            let verdict = Verdict::at_most(name, pennation, PENNATION);
            all.push(verdict.in_unit("degrees").else_do(cure));
            let name = "hooks at the ends of fibres: median turn of the last 0.5 %";
            let verdict = Verdict::at_most(name, self.summary.tilt_at_ends_deg_median, HOOK_DEG);
            all.push(verdict.in_unit("degrees"));
        }
        if !q.jacobian_min.is_nan() {
            let name = "fibres side by side stay so: least Jacobian of their map, above 0";
            let verdict = Verdict::new(name, q.jacobian_min > 0.0);
            all.push(verdict.with_value(q.jacobian_min).with_limit(0.0));
        }
        all
    }

    /// Findings that are neither right nor wrong.
    pub fn findings(&self) -> Vec<String> {
        let q = &self.summary.quality;
        let mut all = Vec::new();
        let ratio = self.summary.optimal_length_ratio;
        if let Some(ratio) = ratio.filter(|ratio| !((ratio - 1.0).abs() <= OPTIMAL)) {
            all.push(format!(
                "fibres are {ratio:.2} times as long as the table's optimal length: is the muscle pennate, with aponeuroses that \
                 are not given?"
            ));
        }
        let by_name = names::architecture(self.name).filter(|name| *name != "parallel");
        if let (Some(name), None) = (by_name, &self.summary.aponeurosis) {
            all.push(format!(
                "by its name the muscle is {name}: without aponeuroses (--aponeurosis auto) its fibres are as long as the muscle, and \
                 its cross-section is too small"
            ));
        }
        if !(q.coverage >= COVERED) {
            let bare = 100.0 * (1.0 - q.coverage);
            all.push(format!(
                "{bare:.1} % of the volume is farther than one mean spacing from any fibre; 5 % or less is aimed at"
            ));
        }
        for (name, area, tendons) in [
            ("origin", &self.attachment.origin, &self.tendons[0]),
            ("insertion", &self.attachment.insertion, &self.tendons[1]),
        ] {
            if area.patch.is_some() {
                let lengths = tendons.iter().map(|[a, b]| 1e3 * (b - a).norm());
                let (least, most) = lengths.fold((f64::INFINITY, 0.0), |(a, b): (f64, f64), l| {
                    (a.min(l), b.max(l))
                });
                all.push(format!(
                    "the area of the {name} lies off the muscle: straight tendons of {} to {} mm lead to it",
                    number(least),
                    number(most)
                ));
            }
        }
        all
    }

    /// The results as a table.
    pub fn table(&self) -> Table {
        let (s, q) = (self.summary, &self.summary.quality);
        let mm = |length: f64| format!("{} mm", number(1e3 * length));
        let cm2 = |area: f64| format!("{} cm2", number(1e4 * area));
        let mut table = Table::new("Fibres", ["what", "value"]);
        table.row([
            "fibres, points of all".to_owned(),
            format!("{}, {}", q.fibres, q.points),
        ]);
        table.row([
            "mean fibre length, without tendons".to_owned(),
            mm(q.length_mean_m),
        ]);
        table.row([
            "shortest to longest".to_owned(),
            format!("{} to {}", mm(s.length_min_m), mm(s.length_max_m)),
        ]);
        table.row(["median fibre length".to_owned(), mm(s.length_median_m)]);
        if let Some(ratio) = s.optimal_length_ratio {
            table.row([
                "that over the table's optimal length".to_owned(),
                number(ratio),
            ]);
        }
        let turn = format!("{} degrees", number(s.tilt_at_ends_deg_median));
        table.row(["median turn in the last 0.5 % of a fibre".to_owned(), turn]);
        table.row(["fibres that turn back".to_owned(), s.turns_back.to_string()]);
        let degrees = number(q.pennation_mean_rad.to_degrees());
        table.row([
            "mean pennation (angle to the line of action)".to_owned(),
            format!("{degrees} degrees"),
        ]);
        table.row([
            "volume".to_owned(),
            format!("{} cm3", number(1e6 * s.volume_m3)),
        ]);
        table.row([
            "physiological cross-section (volume over mean length)".to_owned(),
            cm2(s.cross_section_m2),
        ]);
        table.row(["longest tendon".to_owned(), mm(q.tendon_length_max_m)]);
        let areas = format!("{}, {}", cm2(s.origin_area_m2), cm2(s.insertion_area_m2));
        table.row([
            "areas of origin and insertion on the muscle".to_owned(),
            areas,
        ]);
        table.row([
            "volume within one mean spacing of a fibre".to_owned(),
            format!("{:.1} %", 100.0 * q.coverage),
        ]);
        table.row([
            "points outside, farthest".to_owned(),
            format!("{}, {}", q.outside, mm(q.outside_max_m)),
        ]);
        table.row([
            "farthest end from its area".to_owned(),
            mm(q.end_distance_max_m),
        ]);
        table.row([
            "closest two fibres, but for their ends".to_owned(),
            mm(q.spacing_min_m),
        ]);
        let jacobian = if q.jacobian_min.is_nan() {
            "-".to_owned()
        } else {
            format!("{:.1e}", q.jacobian_min)
        };
        table.row(["least Jacobian of the fibre map".to_owned(), jacobian]);
        table.row([
            "time of the decomposition".to_owned(),
            format!("{:.0} ms", 1e3 * s.decomposition_s),
        ]);
        table
    }

    /// The result.
    ///
    /// # Errors
    /// A picture that cannot be encoded.
    pub fn output(self) -> Result<RunOutput<'a>, PictureError> {
        let (fibres, columns) = self.each_rows();
        let table = self.table();
        Ok(RunOutput {
            kind: "fibres",
            name: self.name.to_owned(),
            measures: measures(self.summary),
            verdicts: self.verdicts(),
            findings: self.findings(),
            notes: self.notes.to_vec(),
            time_s: self.time_s,
            title: format!("{}: fibres", self.name),
            subtitle: format!(
                "Method {}; {} fibres",
                self.summary.method,
                self.fibres.len()
            ),
            text: format!("{}:\n", self.name),
            tables_of_text: 1,
            tables: vec![table, self.rows()],
            pictures: self.pictures()?,
            explanations: self.explanations(),
            data: vec![
                DataFile::new("fibres.csv", columns, fibres),
                DataFile::new(
                    "points.csv",
                    ["fibre", "part", "x_m", "y_m", "z_m"],
                    self.point_rows(),
                ),
            ],
            files: vec![
                OutputFile::new("fibres.vtp", move |path| self.write_fibres(path)),
                OutputFile::new("muscle.vtp", move |path| self.write_muscle(path)),
            ],
            ..RunOutput::default()
        })
    }

    /// The first fibres, one by one.
    fn rows(&self) -> Table {
        let mut rows = Table::new(
            "Each fibre",
            [
                "fibre",
                "length [mm]",
                "chord [mm]",
                "pennation [degrees]",
                "tendons [mm]",
            ],
        );
        for (k, e) in self.each.iter().enumerate().take(ROWS) {
            let tendons = format!(
                "{} + {}",
                number(1e3 * e.tendon_origin_m),
                number(1e3 * e.tendon_insertion_m)
            );
            let degrees = number(e.pennation_rad.to_degrees());
            rows.row([
                k.to_string(),
                number(1e3 * e.length_m),
                number(1e3 * e.chord_m),
                degrees,
                tendons,
            ]);
        }
        rows
    }

    fn explanations(&self) -> Vec<String> {
        let mut notes = vec![
            "Pennation is the mean angle along a fibre to the line of action: from the mean of all origins to that of all \
             insertions, or with aponeuroses from the middle of one area to that of the other. The mean spacing of fibres is the root of the volume over the length of all of them."
                .to_owned(),
            "The Jacobian is the area, further along a fibre, of a unit of area across its middle: above 0 no two \
             fibres side by side change places. It is that of the flow, before smoothing."
                .to_owned(),
        ];
        if self.each.len() > ROWS {
            notes.push(format!(
                "The table shows {ROWS} of {} fibres; fibres.csv has all.",
                self.each.len()
            ));
        }
        notes
    }

    /// Writes fibres, then tendons, with their kind as cell data.
    fn write_fibres(&self, path: &Path) -> io::Result<()> {
        let mut put = Polylines::default();
        for (k, (fibre, each)) in self.fibres.iter().zip(self.each).enumerate() {
            put.add(fibre, [k as f64, 0.0, each.length_m, each.pennation_rad]);
        }
        for (end, tendons) in self.tendons.iter().enumerate() {
            for (k, tendon) in tendons.iter().enumerate() {
                let numbers = [
                    k as f64,
                    1.0 + end as f64,
                    (tendon[1] - tendon[0]).norm(),
                    f64::NAN,
                ];
                put.add(tendon, numbers);
            }
        }
        let [fibre, part, length, pennation] = put.numbers;
        let cells = [
            ("fibre", fibre),
            ("part", part),
            ("length_m", length),
            ("pennation_rad", pennation),
        ];
        let point_data = vec![("along", put.along)];
        let data = PolyData {
            points: &put.points,
            lines: &put.lines,
            point_data,
            ..PolyData::default()
        };
        vtp::write_with_cells(path, &data, &cells)
    }

    /// Writes the muscle with its areas: 1 at triangles of the origin, 2 at those of the insertion.
    fn write_muscle(&self, path: &Path) -> io::Result<()> {
        let mut area = vec![0.0; self.muscle.triangles.len()];
        self.attachment
            .origin
            .triangles
            .iter()
            .for_each(|&t| area[t as usize] = 1.0);
        self.attachment
            .insertion
            .triangles
            .iter()
            .for_each(|&t| area[t as usize] = 2.0);
        let (points, triangles) = (&self.muscle.vertices, &self.muscle.triangles);
        let data = PolyData {
            points,
            triangles,
            ..PolyData::default()
        };
        vtp::write_with_cells(path, &data, &[("area", area)])
    }

    /// A row for each fibre, and the names of its columns.
    fn each_rows(
        &self,
    ) -> (
        impl Iterator<Item = Vec<String>> + use<'a>,
        [&'static str; 7],
    ) {
        let columns = [
            "fibre",
            "length_m",
            "chord_m",
            "pennation_rad",
            "tendon_origin_m",
            "tendon_insertion_m",
            "whole_m",
        ];
        let row = |(k, e): (usize, &FibreMeasures)| {
            let numbers = [
                e.length_m,
                e.chord_m,
                e.pennation_rad,
                e.tendon_origin_m,
                e.tendon_insertion_m,
                e.tendon_origin_m + e.length_m + e.tendon_insertion_m,
            ];
            let cells = numbers.iter().map(f64::to_string);
            std::iter::once(k.to_string()).chain(cells).collect()
        };
        (self.each.iter().enumerate().map(row), columns)
    }

    /// A row for each point from origin to insertion, those of tendons on the bone, too.
    fn point_rows(&self) -> impl Iterator<Item = Vec<String>> + use<'a> {
        let (fibres, tendons) = (self.fibres, self.tendons);
        fibres.iter().enumerate().flat_map(move |(k, fibre)| {
            let tendon = |end: usize| tendons[end].get(k).map(|t: &Tendon| ("tendon", t[1]));
            let fibre = fibre.iter().map(|p| ("fibre", *p));
            let points = tendon(0).into_iter().chain(fibre).chain(tendon(1));
            points.map(move |(part, p)| {
                let place = [p.x, p.y, p.z].map(|c| c.to_string());
                [k.to_string(), part.to_owned()]
                    .into_iter()
                    .chain(place)
                    .collect()
            })
        })
    }
}

/// Polylines with numbers, to be written.
#[derive(Default)]
struct Polylines {
    points: Vec<Point3<f64>>,
    along: Vec<f64>,
    lines: Vec<Vec<u32>>,
    numbers: [Vec<f64>; 4],
}

impl Polylines {
    fn add(&mut self, line: &[Point3<f64>], numbers: [f64; 4]) {
        let first = self.points.len() as u32;
        self.lines
            .push((first..first + line.len() as u32).collect());
        self.points.extend_from_slice(line);
        let last = line.len().saturating_sub(1).max(1) as f64;
        self.along.extend((0..line.len()).map(|i| i as f64 / last));
        self.numbers
            .iter_mut()
            .zip(numbers)
            .for_each(|(all, n)| all.push(n));
    }
}

/// Area of an attachment area [m2].
pub fn size(muscle: &TriangleMesh, area: &Area) -> f64 {
    let triangles: Vec<[u32; 3]> = area
        .triangles
        .iter()
        .map(|&t| muscle.triangles[t as usize])
        .collect();
    pliant::mesh::measures::area(&muscle.vertices, &triangles)
}
