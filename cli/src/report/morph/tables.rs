//! Tables of a morph.

use super::{Side, Summary};
use crate::report::Table;
use pliant::format::number;

/// Surfaces, common surface, point data and times; tables without rows are left out.
pub(super) fn tables(summary: &Summary) -> Vec<Table> {
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
    [sides, common(summary), data(summary), times(summary)]
        .into_iter()
        .filter(|t| !t.rows.is_empty())
        .collect()
}

fn common(summary: &Summary) -> Table {
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
        &format!("{}{}", summary.aligned_by, summary.deformed()),
    ]);
    common
}

fn data(summary: &Summary) -> Table {
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
    data
}

fn times(summary: &Summary) -> Table {
    let mut times = Table::new("Time [s]", ["part", "seconds"]);
    let t = &summary.times;
    for (part, s) in [
        ("read", t.read_s),
        ("map of A", t.map_a_s),
        ("map of B", t.map_b_s),
        ("align", t.align_s),
        ("merge", t.merge_s),
        ("blend", t.blend_s),
    ] {
        times.row([part.to_owned(), format!("{s:.3}")]);
    }
    times
}
