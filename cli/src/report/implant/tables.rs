//! Tables, the plot and the CSV file of skin over implants.

use super::{Insertion, Point, Single};
use crate::report::output::DataFile;
use crate::report::plot::LinePlot;
use crate::report::table::Table;
use pliant::skin::{Areas, GROWN_SOURCE, Interval, RETRACTED_SOURCE};

/// Decimals of an area in cm2 that depends on a published range of a gain [m^2]: at most two digits
/// of the gain.
fn decimals(gain: f64) -> usize {
    match (gain * 1e4).abs() {
        gain if gain >= 10.0 => 0,
        gain if gain >= 1.0 => 1,
        _ => 2,
    }
}

/// A cell of the table of implants.
type Cell = fn(&Single<'_>) -> String;

/// The rows of the table of implants, which has a column for each.
const ROWS: [(&str, Cell); 11] = [
    ("shape", |one| one.order.implant.shape.name().to_owned()),
    ("base [cm]", |one| {
        format!("{:.1}", one.order.implant.base * 1e2)
    }),
    ("volume [cc]", |one| format!("{:.1}", one.volume() * 1e6)),
    ("vertices", |one| (2 * one.ready.layers.count()).to_string()),
    ("triangles", |one| {
        (2 * one.ready.layers.triangles.len()).to_string()
    }),
    ("springs", |one| one.ready.layers.springs.len().to_string()),
    ("steps", |one| one.done.progress.iterations.to_string()),
    ("residual", |one| {
        format!("{:.1e}", one.done.progress.residual)
    }),
    ("depth in each other [mm]", |one| {
        format!("{:.3}", one.done.progress.depth * 1e3)
    }),
    ("pressure [kPa]", |one| {
        format!("{:.2}", one.pressure() * 1e-3)
    }),
    ("at rest", |one| one.done.progress.rest().to_owned()),
];

/// Areas [m^2] as text in cm2, with decimals that suit their gain.
struct AreaFormat {
    before: f64,
    /// Decimals of an area that depends on a published range; a computed one has one more.
    decimals: usize,
}

impl AreaFormat {
    fn new(areas: &Areas) -> Self {
        Self {
            before: areas.before,
            decimals: decimals(areas.gain()),
        }
    }

    fn area(&self, m2: f64) -> String {
        format!("{:.1$}", m2 * 1e4, self.decimals + 1)
    }

    fn gain(&self, m2: f64) -> String {
        format!("{:+.1$}", (m2 - self.before) * 1e4, self.decimals + 1)
    }

    fn range(&self, m2: Interval) -> String {
        let few = self.decimals;
        format!("{:.few$} to {:.few$}", m2.low * 1e4, m2.high * 1e4)
    }

    fn gain_range(&self, m2: Interval) -> String {
        let [low, high] = [m2.low, m2.high].map(|m2| (m2 - self.before) * 1e4);
        let few = self.decimals;
        format!("{low:+.few$} to {high:+.few$}")
    }
}

impl Insertion<'_> {
    /// The table for a surgeon.
    pub fn table(&self) -> Table {
        let mut table = Table::new("Areas and volumes", ["what", "value", "gain", "source"]);
        for (what, value, gain, source) in self.area_rows().into_iter().chain(self.volume_rows()) {
            table.row([what, value, gain, source.to_owned()]);
        }
        table
    }

    /// Name, value, gain and source of each area.
    fn area_rows(&self) -> Vec<(String, String, String, &'static str)> {
        let areas = self.areas();
        let cm2 = AreaFormat::new(&areas);
        let mut rows = vec![
            (
                "area before [cm2]".to_owned(),
                cm2.area(areas.before),
                String::new(),
                "the mesh",
            ),
            (
                "area deformed [cm2]".to_owned(),
                cm2.area(areas.deformed),
                cm2.gain(areas.deformed),
                "equilibrium: an upper bound",
            ),
        ];
        if let Some(error) = self.gain_uncertainty() {
            rows.push((
                "   uncertainty from the mesh [cm2]".to_owned(),
                String::new(),
                format!("±{}", cm2.area(error)),
                "its change from edges twice as long",
            ));
        }
        rows.push((
            "area retracted [cm2]".to_owned(),
            cm2.range(areas.retracted),
            cm2.gain_range(areas.retracted),
            RETRACTED_SOURCE,
        ));
        rows.push((
            "area grown [cm2]".to_owned(),
            cm2.range(areas.grown),
            cm2.gain_range(areas.grown),
            GROWN_SOURCE,
        ));
        rows
    }

    /// Name, value, no gain and source of the volumes and the stretch.
    fn volume_rows(&self) -> [(String, String, String, &'static str); 4] {
        let areas = self.areas();
        [
            (
                "volume of implants [cc]".to_owned(),
                format!("{:.1}", self.volume() * 1e6),
                String::new(),
                "kept exactly",
            ),
            (
                "volume difference of the region [cc]".to_owned(),
                format!("{:.1}", areas.volume_difference * 1e6),
                String::new(),
                "closed at its rim",
            ),
            (
                "greatest stretch".to_owned(),
                format!("{:.2}", areas.stretch_max),
                String::new(),
                "of a triangle, any direction",
            ),
            (
                format!("area stretched over {:.2} [cm2]", self.limit),
                format!("{:.1}", self.over_limit() * 1e4),
                String::new(),
                "the limit that was given",
            ),
        ]
    }

    /// How it was found.
    pub fn run_table(&self) -> Table {
        let each = self.each();
        let heads = each.iter().map(|one| format!("implant {}", one.number + 1));
        let mut table = Table::new("Implants", std::iter::once(String::new()).chain(heads));
        for (what, value) in ROWS {
            table.row(std::iter::once(what.to_owned()).chain(each.iter().map(value)));
        }
        table
    }

    /// The curve of areas over volumes, or over days, of the first implant that has one; `None` for
    /// a single point, which the table contains.
    pub fn plot(&self) -> Option<LinePlot> {
        let of = |implant: usize| {
            self.curve
                .iter()
                .filter(move |point| point.implant == implant)
        };
        let first = self
            .curve
            .iter()
            .find(|point| of(point.implant).count() > 1)?;
        let own: Vec<&Point> = of(first.implant).collect();
        let points = |of: &dyn Fn(&Areas) -> f64| -> Vec<(f64, f64)> {
            own.iter()
                .map(|point| {
                    let x = point.day.unwrap_or(point.volume * 1e6);
                    (x, (of(&point.areas) - point.areas.before) * 1e4)
                })
                .collect()
        };
        let axis = if first.day.is_some() {
            "day"
        } else {
            "volume [cc]"
        };
        Some(
            LinePlot::new("Area gained [cm2]", axis)
                .with("deformed", points(&|a| a.deformed))
                .with("retracted, least", points(&|a| a.retracted.low))
                .with("retracted, most", points(&|a| a.retracted.high))
                .with("grown, least", points(&|a| a.grown.low))
                .with("grown, most", points(&|a| a.grown.high)),
        )
    }

    /// The results for each volume, as a table for a surgeon.
    fn curve_table(&self) -> Option<Table> {
        let head = [
            "implant",
            "day",
            "volume [cc]",
            "deformed [cm2]",
            "retracted [cm2]",
            "grown [cm2]",
        ];
        let head = head.into_iter().chain(["greatest stretch", "at rest"]);
        let mut table = Table::new("Areas gained by volume", head);
        for point in &self.curve {
            let cm2 = AreaFormat::new(&point.areas);
            table.row([
                self.called(point.implant),
                point.day.map_or("–".to_owned(), |day| day.to_string()),
                format!("{:.1}", point.volume * 1e6),
                cm2.gain(point.areas.deformed),
                cm2.gain_range(point.areas.retracted),
                cm2.gain_range(point.areas.grown),
                format!("{:.2}", point.areas.stretch_max),
                point.progress.rest().to_owned(),
            ]);
        }
        (!self.curve.is_empty()).then_some(table)
    }

    /// All tables.
    pub fn tables(&self) -> Vec<Table> {
        [self.table()]
            .into_iter()
            .chain(self.curve_table())
            .chain([self.run_table()])
            .collect()
    }

    /// The curve: its columns, and a row for each volume.
    pub(in crate::report) fn csv(&self) -> DataFile<'static> {
        let columns = [
            "implant",
            "day",
            "implant_volume_m3",
            "area_before_m2",
            "area_deformed_m2",
            "area_retracted_low_m2",
            "area_retracted_high_m2",
            "area_grown_low_m2",
            "area_grown_high_m2",
            "volume_difference_m3",
            "stretch_max",
            "converged",
        ];
        let row = |point: &Point| {
            let a = &point.areas;
            let numbers = [
                point.volume,
                a.before,
                a.deformed,
                a.retracted.low,
                a.retracted.high,
                a.grown.low,
                a.grown.high,
                a.volume_difference,
                a.stretch_max,
            ];
            let day = point.day.map_or(String::new(), |day| day.to_string());
            let mut cells = vec![point.implant.to_string(), day];
            cells.extend(numbers.iter().map(f64::to_string));
            cells.push(point.progress.converged.to_string());
            cells
        };
        let rows: Vec<Vec<String>> = self.curve.iter().map(row).collect();
        DataFile::new("curve.csv", columns, rows)
    }
}
