//! Where an implant will lie: the outlines of its base and of the region that moves, on the skin
//! before.

use nalgebra::{Point3, Vector3};
use serde_json::json;

use super::Picture;
use crate::report::Table;
use crate::report::output::RunOutput;
use pliant::contact::Surface as Rays;
use pliant::mesh::{Aabb, Topology, TriangleMesh};
use pliant::simulation::SkinRun;
use pliant::skin::{PreparedPatch, Whole};
use pliant_render::{
    Camera, Canvas, Drawing, Frame, Lines, PictureError, Rgb, Surface, TextStyle, View, colour,
    render,
};

/// Size of the picture [px].
const SIZE: (u32, u32) = (720, 720);
/// Colours of the outlines of bases and of the rims of regions.
pub(super) const BASE: Rgb = [0.80, 0.10, 0.12];
pub(super) const RIM: Rgb = [0.10, 0.35, 0.75];
const TEXT: Rgb = [0.25, 0.25, 0.25];
/// Number of points of the outline of a base.
const POINTS: u32 = 144;

/// Outlines of some implants on the skin before.
pub(super) struct Outlines {
    /// The base of each implant.
    pub(super) bases: Vec<Vec<Point3<f64>>>,
    /// Edges of the rim of each region.
    pub(super) rims: Vec<Vec<Point3<f64>>>,
}

impl Outlines {
    pub(super) fn of<'a>(all: impl IntoIterator<Item = &'a PreparedPatch>) -> Self {
        let (mut bases, mut rims) = (Vec::new(), Vec::new());
        for ready in all {
            let region = &ready.region.mesh;
            let topology = Topology::new(region);
            let edges = topology.boundary_edges().into_iter();
            rims.extend(edges.map(|e| {
                let ends = topology.edges[e as usize];
                ends.map(|v| region.vertices[v as usize]).to_vec()
            }));
            let rays = Rays::new(region);
            for (order, frame) in ready.sites() {
                let shape = order.implant.shape;
                let down = frame * -Vector3::z();
                let above = 4.0 * order.implant.base;
                let place = |k: u32| {
                    let angle = std::f64::consts::TAU * f64::from(k) / f64::from(POINTS);
                    let disc = nalgebra::Point2::new(angle.cos(), angle.sin());
                    let flat = shape.place(disc, order.implant.base);
                    let from = frame * Point3::new(flat.x, flat.y, above);
                    let (t, w) = rays.first_hit(&from, &down)?;
                    let corners =
                        rays.triangles()[t as usize].map(|v| rays.positions()[v as usize]);
                    let sum = (0..3)
                        .map(|k| corners[k].coords * w[k])
                        .sum::<Vector3<f64>>();
                    Some(Point3::from(sum))
                };
                // The outline is broken where it leaves the region.
                let points: Vec<_> = (0..=POINTS).map(place).collect();
                let runs = points.split(Option::is_none);
                let runs = runs.map(|run| run.iter().flatten().copied().collect::<Vec<_>>());
                bases.extend(runs.filter(|run| run.len() > 1));
            }
        }
        Self { bases, rims }
    }

    /// The lines for a drawing.
    pub(super) fn lines(&self) -> [Lines<'_>; 2] {
        [(&self.rims, RIM), (&self.bases, BASE)].map(|(lines, colour)| Lines {
            width: 2.2,
            lift: 3.0,
            ..Lines::new(lines, colour)
        })
    }
}

/// The direction in which a skin is upright: the given one, or the axis of its greatest extent.
pub(super) fn upright(skin: &TriangleMesh, up: Option<Vector3<f64>>) -> Vector3<f64> {
    up.unwrap_or_else(|| {
        let extents = Aabb::of_points(&skin.vertices).extents();
        Vector3::ith(extents.imax(), 1.0)
    })
}

/// The axis of the file to which a direction points most, as `+x`.
fn axis(direction: &Vector3<f64>) -> String {
    let k = direction.iamax();
    let sign = if direction[k] < 0.0 { '-' } else { '+' };
    format!("{sign}{}", ["x", "y", "z"][k])
}

/// The whole skin before with all outlines, upright, its sides named by the axes of the file.
///
/// # Errors
/// A picture that cannot be encoded.
pub(super) fn overview(
    skin: &TriangleMesh,
    all: &[&PreparedPatch],
    up: Option<Vector3<f64>>,
) -> Result<Picture, PictureError> {
    let up = upright(skin, up);
    let sites = || all.iter().flat_map(|ready| ready.sites());
    let outwards: Vec<Vector3<f64>> = sites().map(|(_, frame)| frame * Vector3::z()).collect();
    let sum: Vector3<f64> = outwards.iter().sum();
    // Implants on both sides of a body: the side of the first.
    let out = match outwards.first() {
        Some(first) if !(sum.norm() > 0.5) => *first,
        _ => sum,
    };
    // From the side of the implants, level.
    let level = |v: Vector3<f64>| (v - up * v.dot(&up)).try_normalize(1e-3 * v.norm());
    let from = level(out).unwrap_or_else(|| out.try_normalize(0.0).unwrap_or(up));
    let view_up = if level(out).is_some() {
        up
    } else {
        let k = from.iamin();
        Vector3::ith(k, 1.0)
    };
    let whole = Whole::of(skin, all);
    let outlines = Outlines::of(all.iter().copied());
    let surface = Surface::plain(&whole.mesh.vertices, &whole.mesh.triangles, colour::BONE);
    let canvas = Canvas::new(SIZE.0, SIZE.1).with_top(30.0);
    let view = View::orthographic(from, view_up);
    let camera = Camera::fit(whole.mesh.vertices.iter().copied(), &view, canvas);
    let [rims, bases] = outlines.lines();
    let drawing = Drawing::of([surface]).with_lines(rims).with_lines(bases);
    let mut frame: Frame = render(&drawing, &camera);
    frame.title("where: base red, region blue", TextStyle::Title);
    let right = view_up.cross(&from);
    let (width, height) = (i64::from(SIZE.0), i64::from(SIZE.1));
    let (left, at_right) = (axis(&-right), axis(&right));
    let style = TextStyle::Small;
    frame.text(8, height / 2, &left, style, TEXT);
    frame.text(
        width - 8 - style.width(&at_right),
        height / 2,
        &at_right,
        style,
        TEXT,
    );
    frame.text(
        width / 2,
        height - 20,
        &format!("up: {}", axis(&view_up)),
        style,
        TEXT,
    );
    Ok(Picture {
        file: "overview.png".to_owned(),
        caption: format!(
            "Where the implant lies: outline of the base (red) and of the region that moves (blue). Upwards is {}, to the right {}",
            axis(&view_up),
            at_right
        ),
        bytes: frame.to_png()?,
        wide: false,
    })
}

/// Where implants will lie, without any equilibrium.
///
/// # Errors
/// A picture that cannot be encoded.
pub fn preview(run: &SkinRun, time_s: f64) -> Result<RunOutput<'_>, PictureError> {
    let ready: Vec<_> = run.parts.iter().map(|part| &part.ready).collect();
    let columns = [
        "implants",
        "centre [mm]",
        "base [mm]",
        "region [cm2]",
        "vertices",
        "largest volume [cc]",
    ];
    let mut table = Table::new("Where", columns);
    let mut all = Vec::new();
    for part in &run.parts {
        let areas = part.areas_at(0);
        for (order, frame) in part.ready.sites() {
            let centre = frame.translation.vector;
            let largest = order.implant.largest(part.ready.layers.edge);
            table.row([
                part.name.clone(),
                format!(
                    "{:.1}, {:.1}, {:.1}",
                    1e3 * centre.x,
                    1e3 * centre.y,
                    1e3 * centre.z
                ),
                format!("{:.1}", 1e3 * order.implant.base),
                format!("{:.1}", 1e4 * areas.before),
                part.ready.layers.count().to_string(),
                format!("{:.0}", 1e6 * largest),
            ]);
            all.push(json!({
                "centre_m": centre.as_slice(),
                "base_m": order.implant.base,
                "area_before_m2": areas.before,
                "vertices": part.ready.layers.count(),
                "border_edges": part.ready.at_border,
                "volume_most_m3": largest,
            }));
        }
    }
    Ok(RunOutput {
        kind: "implant_preview",
        name: run.scene.name.clone(),
        measures: json!({"name": run.scene.skin.name, "implants": all}),
        time_s,
        title: format!("{}: where implants will lie", run.scene.name),
        subtitle: "no equilibrium is computed".to_owned(),
        tables_of_text: 1,
        tables: vec![table],
        pictures: vec![overview(&run.skin, &ready, run.scene.skin.up)?],
        notes: run.notes.clone(),
        ..RunOutput::default()
    })
}
