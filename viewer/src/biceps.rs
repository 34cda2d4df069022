//! The geometric muscle in a session: its length follows the frames or is set by hand, its nodes
//! change at constant volume.
//!
//! Paths of changes are those of the file. Besides them, `animation=off` fixes the present length,
//! and `animation=on` lets the length follow the frames again.

use nalgebra::Point3;

use super::panel::{self, Control, List, Shown, Target, Value};
use super::recipe::{Recipe, Refused, check_index, check_number};
use super::running::{Kind, changed, reading};
use super::session::Command;
use super::snapshot::{Handle, Reading, Shot, Tissue};
use pliant::format::number;
use pliant::scene::Content;
use pliant::simulation::{GeometricRun, LoadError, Scenario, ScenarioError};

/// Greatest number of inserted nodes between each two.
const MOST_INSERTED: u32 = 20;

const ANIMATION: &str = "animation";
const FIXED_LENGTH: &str = "fixed_length";

/// The geometric muscle in a session.
#[derive(Default)]
pub(super) struct Biceps;

impl Kind for Biceps {
    type Run = GeometricRun;

    const HAS_STRAIN: bool = false;

    fn run_of(content: &Content) -> Result<Option<Box<GeometricRun>>, LoadError> {
        Ok(match content {
            Content::Geometric(scene) => Some(Box::new(GeometricRun::new((**scene).clone()))),
            _ => None,
        })
    }

    fn continue_from(run: &mut GeometricRun, before: &GeometricRun) -> Result<(), ScenarioError> {
        Scenario::continue_from(run, before)
    }

    fn has_same_surface(before: &GeometricRun, now: &GeometricRun) -> bool {
        before.pose.mesh.triangles == now.pose.mesh.triangles
            && before.pose.bars.len() == now.pose.bars.len()
    }

    fn is_finished(_: &GeometricRun) -> bool {
        // The range of lengths repeats.
        false
    }

    fn tissue(body: usize) -> Tissue {
        if body == 0 {
            Tissue::Muscle
        } else {
            Tissue::Plain
        }
    }

    fn controls(&self, start: &GeometricRun, now: &GeometricRun) -> Vec<Control> {
        let (scene, mut list) = (&now.scene, List::default());
        let path = |path: &str| Target::Path(path.to_owned());
        let is_animated = Value::On(scene.fixed_length.is_none());
        let switch = panel::Kind::Switch;
        list.other("length", "animation", path(ANIMATION), switch, is_animated);
        let [least, most] = now.muscle.range.map(|l| 1e2 * l);
        let shown = Shown::even("cm", least, most);
        let length = 1e2 * now.pose.length;
        list.slider("length", "length", path(FIXED_LENGTH), length, shown);
        let greatest = |all: &[f64]| all.iter().copied().fold(0.0, f64::max);
        let radius_max = 2e2 * greatest(&start.scene.shape.radii);
        let growth_max = (2.0 * greatest(&start.scene.shape.growth)).max(1.0);
        for (k, radius) in scene.shape.radii.iter().enumerate() {
            let group = format!("node {}", k + 1);
            let target = path(&format!("radii.{k}"));
            let shown = Shown::even("cm", 0.0, radius_max);
            list.slider(&group, "radius at rest", target, 1e2 * radius, shown);
            let target = path(&format!("grow_mults.{k}"));
            let shown = Shown::even("", 0.0, growth_max);
            list.slider(&group, "growth", target, scene.shape.growth[k], shown);
        }
        let insert = u32::try_from(scene.insert).unwrap_or(u32::MAX);
        let kind = panel::Kind::Whole {
            range: (0, MOST_INSERTED.max(insert)),
            scale: panel::Scale::Linear,
        };
        let value = Value::Whole(insert);
        list.other("nodes", "inserted between two", path("insert"), kind, value);
        list.0
    }

    fn readings(&self, run: &GeometricRun) -> Vec<Reading> {
        let pose = &run.pose;
        let mut all = vec![
            reading("Length", "cm", 1e2 * pose.length),
            reading("Volume", "cm3", 1e6 * run.muscle.chain.volume_now()),
            reading("Volume error", "", pose.volume_error),
            reading("Greatest radius", "cm", 1e2 * pose.radius),
        ];
        let angle = pose.joint_angle.map(f64::to_degrees);
        all.extend(angle.map(|angle| reading("Joint angle", "deg", angle)));
        all
    }

    /// Adds the handles of the nodes, at the top of their rings: the front view shows the axis there.
    fn complete(&self, run: &GeometricRun, shot: &mut Shot) {
        let (chain, parts) = (&run.muscle.chain, run.scene.insert + 1);
        for (k, radius) in chain.radii().iter().step_by(parts).enumerate() {
            shot.handles.push(Handle {
                name: format!("node {}", k + 1),
                at: Point3::new(chain.spacing() * (k * parts) as f64, *radius, 0.0),
            });
        }
    }

    fn probe(&self, at: &Point3<f64>) -> Vec<(&'static str, f64, &'static str)> {
        let distance = 1e2 * libm::hypot(at.y, at.z);
        vec![("distance from the axis", distance, "cm")]
    }

    fn changed(
        &self,
        run: &GeometricRun,
        recipe: &Recipe,
        command: &Command,
    ) -> Result<Recipe, Refused> {
        match command {
            Command::Set { path, value } if path == ANIMATION => match value.trim() {
                "on" => Ok(recipe.with(FIXED_LENGTH, "none")),
                "off" | "none" => Ok(recipe.with(FIXED_LENGTH, &format!("{} m", run.pose.length))),
                other => Err(Refused::Value {
                    path: path.clone(),
                    value: other.to_owned(),
                    expected: "`on` or `off`",
                }),
            },
            Command::Restore { path } if path == ANIMATION => Ok(recipe.without(FIXED_LENGTH)),
            Command::Move { handle, to } => move_node(run, recipe, *handle, to),
            _ => changed(recipe, command),
        }
    }

    fn steer(&mut self, _: &mut GeometricRun, _: &Command) -> Result<(), Refused> {
        Err(Refused::NotHere(
            "a geometric muscle has no points to drag or to hold; move its nodes",
        ))
    }
}

/// The scene in which a node has the distance of a position from the axis, at the present length.
fn move_node(
    run: &GeometricRun,
    recipe: &Recipe,
    node: usize,
    to: &Point3<f64>,
) -> Result<Recipe, Refused> {
    let (scene, length) = (&run.scene, run.pose.length);
    check_index("node", node, scene.shape.radii.len())?;
    to.iter()
        .try_for_each(|c| check_number("a coordinate of the place to move to", *c, false))?;
    let radius = libm::hypot(to.y, to.z);
    let found = scene
        .shape
        .radius_at_rest(scene.insert, node, length, radius);
    let at_rest = found.map_err(|[low, high]| Refused::Outside {
        what: format!(
            "at a length of {} cm the radius of node {}",
            number(1e2 * length),
            node + 1
        ),
        value: 1e2 * radius,
        low: 1e2 * low,
        high: 1e2 * high,
        unit: "cm",
    })?;
    Ok(recipe.with(&format!("radii.{node}"), &format!("{at_rest} m")))
}
