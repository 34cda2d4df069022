//! The controls of skin and implants.

use super::implants;
use super::shots::PickedPoint;
use crate::panel::{Control, Kind, List, Shown, Target, Value};
use crate::recipe::Refused;
use pliant::scene::units::{Dimension, parse};
use pliant::scene::{FillCourse, ImplantFill, SkinScene, Support};
use pliant::simulation::SkinRun;
use pliant::skin::BaseShape;

/// Greatest number of fillings with a control each; beyond it only the last has one.
const FILLINGS: usize = 8;

/// Upper end of a volume slider relative to the largest volume, so that the end is valid.
const FULL: f64 = 0.999;

/// Ranges of sliders, from the scene at the start.
pub(super) struct Ranges {
    start: SkinScene,
}

/// The index of the implant of a path `implant.K.turn`.
pub(super) fn turned(path: &str) -> Option<usize> {
    path.strip_prefix("implant.")?
        .strip_suffix(".turn")?
        .parse()
        .ok()
}

/// The angle of a rotation as written [degrees].
pub(super) fn degrees(path: &str, value: &str) -> Result<f64, Refused> {
    let refused = || Refused::Value {
        path: path.to_owned(),
        value: value.to_owned(),
        expected: "an angle as in `30 deg`",
    };
    parse(value, Dimension::Angle)
        .map(f64::to_degrees)
        .map_err(|_| refused())
}

impl Ranges {
    pub fn of(scene: &SkinScene) -> Self {
        Self {
            start: scene.clone(),
        }
    }

    /// The controls of a run.
    pub fn controls(&self, run: &SkinRun, points: &[PickedPoint]) -> Vec<Control> {
        let mut list = List::default();
        for (k, filled) in implants(&run.scene).iter().enumerate() {
            let group = format!("implant {}", filled.name);
            let path = |key: &str| Target::Path(format!("implant.{k}.{key}"));
            let (implant, began) = (filled.order.implant, &implants(&self.start)[k].order);
            let edge = run
                .parts
                .iter()
                .find(|part| part.members.contains(&k))
                .map_or(0.0, |p| p.ready.layers.edge);
            let most = 1e6 * FULL * implant.largest(edge);
            volumes(&mut list, &group, k, (filled, &run.scene.days), most);
            let names = BaseShape::ALL.map(|(name, _)| name);
            let chosen = BaseShape::ALL
                .iter()
                .position(|(_, shape)| *shape == implant.shape)
                .unwrap_or(0);
            list.other(
                &group,
                "shape",
                path("shape"),
                Kind::Choice(names.to_vec()),
                Value::Choice(chosen),
            );
            let shown = Shown::about("cm", 1e2 * began.implant.base, 2.0, 20.0);
            list.slider(&group, "base", path("base"), 1e2 * implant.base, shown);
            if let Some(point) = points.get(k).filter(|_| implant.shape != BaseShape::Round) {
                let shown = Shown::even("deg", -180.0, 180.0);
                list.slider(
                    &group,
                    "turn",
                    path("turn"),
                    point.angle().to_degrees(),
                    shown,
                );
            }
            let shown = Shown::about("mm", 1e3 * began.tissue.depth, 3.0, 10.0);
            list.slider(
                &group,
                "depth",
                path("depth"),
                1e3 * filled.order.tissue.depth,
                shown,
            );
            let shown = Shown::about("N/m", began.implant.membrane, 10.0, 1e3);
            list.slider(&group, "shell", path("shell"), implant.membrane, shown);
        }
        if let (Support::Ball(ball), Support::Ball(began)) = (&run.scene.under, &self.start.under) {
            let path = |key: &str| Target::Path(format!("ball.{key}"));
            let shown = Shown::about("mm", 1e3 * began.radius, 2.0, 10.0);
            list.slider("ball", "radius", path("radius"), 1e3 * ball.radius, shown);
            let shown = Shown::about("mm", 1e3 * began.order.tissue.depth, 3.0, 10.0);
            list.slider(
                "ball",
                "depth",
                path("depth"),
                1e3 * ball.order.tissue.depth,
                shown,
            );
        }
        self.skin(&mut list, &run.scene);
        list.0
    }

    /// Controls of the material of all skin.
    fn skin(&self, list: &mut List, now: &SkinScene) {
        let order = |scene: &SkinScene| match &scene.under {
            Support::Implants(all) => all.first().map(|filled| filled.order.clone()),
            Support::Ball(ball) => Some(ball.order.clone()),
        };
        let (Some(began), Some(now)) = (order(&self.start), order(now)) else {
            return;
        };
        let path = |key: &str| Target::Path(format!("skin.0.{key}"));
        let shown = Shown::about("mm", 1e3 * began.tissue.thickness, 3.0, 10.0);
        list.slider(
            "skin",
            "thickness",
            path("thickness"),
            1e3 * now.tissue.thickness,
            shown,
        );
        let shown = Shown::about("kPa", 1e-3 * began.tissue.modulus, 10.0, 1e3);
        list.slider(
            "skin",
            "modulus",
            path("modulus"),
            1e-3 * now.tissue.modulus,
            shown,
        );
        if let (Some(began), Some(edge)) = (began.edge, now.edge) {
            let shown = Shown::about("mm", 1e3 * began, 2.0, 10.0);
            list.slider(
                "skin",
                "edge length",
                path("edge_length"),
                1e3 * edge,
                shown,
            );
        }
    }
}

/// The controls of an implant's volume, its fillings or its target area; `days` are those of the
/// frames.
fn volumes(
    list: &mut List,
    group: &str,
    k: usize,
    (filled, days): (&ImplantFill, &[f64]),
    most: f64,
) {
    let shown = || Shown::even("cc", 0.0, most);
    let path = |key: String| Target::Path(format!("implant.{k}.{key}"));
    match filled.course {
        FillCourse::Evenly => {
            let (volume, target) = (filled.order.implant.volume, path("volume".to_owned()));
            list.slider(group, "volume", target, 1e6 * volume, shown());
        }
        FillCourse::Target(area) => {
            let (target, shown) = (
                path("target_area".to_owned()),
                Shown::about("cm2", 1e4 * area, 10.0, 100.0),
            );
            list.slider(group, "target area", target, 1e4 * area, shown);
        }
        FillCourse::Frames | FillCourse::Days => {
            let first = if filled.fill.len() > FILLINGS {
                filled.fill.len() - 1
            } else {
                0
            };
            for (at, (frame, volume)) in filled.fill.iter().enumerate().skip(first) {
                let label = match frame.checked_sub(1).and_then(|at| days.get(at)) {
                    Some(day) => format!("volume on day {day}"),
                    None => format!("volume in frame {frame}"),
                };
                let target = path(format!("fill.{at}.volume"));
                list.slider(group, &label, target, 1e6 * volume, shown());
            }
        }
    }
}
