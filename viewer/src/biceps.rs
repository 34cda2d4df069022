//! The geometric muscle in a session: its length from an animation or by hand, changes of its nodes
//! at constant volume.
//!
//! Paths of changes: `length` is the present length and replaces the animation until
//! `animation=on`. All other paths change the muscle at rest, and with it the constant volume:
//! `radii.N`, `grow_mults.N`, `frame.N` (from 0), `insert`, `min_part`, `max_part`, `caps`. Numbers
//! without a unit are in the unit of the file.

use std::sync::Arc;

use nalgebra::Point3;
use toml::{Table, Value as Written};

use super::panel::{Control, Kind, List, Shown, Target, Value};
use super::recipe::{Recipe, Refused, StartError, check_index, check_number};
use super::session::Command;
use super::snapshot::{BodyShot, Handle, Probe, Reading, Shot, Stage, StageBody, Tissue};
use super::subject::{Advanced, Subject, Watch};
use pliant::fibres::BoundLines;
use pliant::geometric::file::{self, GeometricMuscle};
use pliant::geometric::pose::{Pose, length_at};
use pliant::geometric::{Chain, ChainError, ChainShape};
use pliant::mesh::Topology;
use pliant::scene::units::{Dimension, parse};

/// Frames per second.
const RATE: f64 = 30.0;

/// Number of frames from rest to the longest, to the shortest and back to rest.
const PERIOD: u32 = 60;

/// Greatest number of inserted nodes between each two.
const MOST_INSERTED: u32 = 20;

/// Bisections of a radius: to the last bit.
const HALVINGS: u32 = 200;

/// Relative tolerance of a length at an end of its range, for the rounding of another unit.
const ROUNDED: f64 = 1e-12;

/// Every path except those of nodes.
const PATHS: &str = "length, animation, radii.N and grow_mults.N of node N from 0, frame.N, insert, min_part, max_part, caps";

/// A file with changes, as a model.
struct Model {
    muscle: GeometricMuscle,
    /// The nodes of the file, without inserted ones.
    shape: ChainShape,
    insert: usize,
}

/// A geometric muscle in a session.
pub(super) struct Biceps {
    recipe: Recipe,
    model: Model,
    /// True if the length is set by hand.
    by_hand: bool,
    frame: usize,
    pose: Pose,
    stage: Arc<Stage>,
    controls: Arc<Vec<Control>>,
    /// Upper ends of the sliders of radii [m] and growth multipliers, from the start.
    most: (f64, f64),
    probe: Option<(usize, usize)>,
}

/// True if a text is the file of a geometric muscle.
pub(super) fn is_biceps(text: &str) -> bool {
    toml::from_str::<Table>(text).is_ok_and(|keys| keys.contains_key("radii"))
}

/// A length [m] from a text with a unit, or from a number in the unit of the file.
fn length(value: &str, unit: f64) -> Result<f64, Refused> {
    match value.trim().parse::<f64>() {
        Ok(number) => Ok(number * unit),
        Err(_) => parse(value, Dimension::Length).map_err(Refused::Unit),
    }
}

fn plain(path: &str, value: &str) -> Result<f64, Refused> {
    let wanted = || Refused::Value {
        path: path.to_owned(),
        value: value.to_owned(),
        wanted: "a number",
    };
    value.trim().parse().map_err(|_| wanted())
}

/// Sets a value at a path of the file.
fn put(keys: &mut Table, path: &str, value: &str, unit: f64) -> Result<(), Refused> {
    let unknown = || Refused::NoPath {
        path: path.to_owned(),
        known: PATHS,
    };
    let written = match path {
        "insert" => {
            let wanted = || Refused::Value {
                path: path.to_owned(),
                value: value.to_owned(),
                wanted: "a whole number",
            };
            Written::Integer(value.trim().parse::<u32>().map_err(|_| wanted())?.into())
        }
        "min_part" | "max_part" => Written::Float(plain(path, value)?),
        "caps" => Written::String(value.trim().to_owned()),
        _ => {
            let (list, index) = path.split_once('.').ok_or_else(unknown)?;
            let index: usize = index.parse().map_err(|_| unknown())?;
            let number = match list {
                "radii" | "frame" => length(value, unit)? / unit,
                "grow_mults" => plain(path, value)?,
                _ => return Err(unknown()),
            };
            let all = keys.get_mut(list).and_then(Written::as_array_mut);
            let count = all.as_ref().map_or(0, |all| all.len());
            let at = all.and_then(|all| all.get_mut(index));
            *at.ok_or(Refused::Nothing {
                what: "number in this list",
                index,
                count,
            })? = Written::Float(number);
            return Ok(());
        }
    };
    keys.insert(path.to_owned(), written);
    Ok(())
}

impl Model {
    /// The file with all changes except that of the present length.
    fn of(recipe: &Recipe) -> Result<Self, Refused> {
        let before = file::parse(recipe.text()).map_err(Refused::Geometric)?;
        let mut keys: Table = toml::from_str(recipe.text()).unwrap_or_default();
        let changes = recipe.given().chain(recipe.changed());
        for (path, value) in changes.filter(|(path, _)| !is_of_length(path)) {
            put(&mut keys, path, value, before.unit)?;
        }
        let muscle =
            file::parse(&toml::to_string(&keys).unwrap_or_default()).map_err(Refused::Geometric)?;
        let insert = keys
            .get("insert")
            .and_then(Written::as_integer)
            .map_or(0, |n| n.max(0) as usize);
        let rest = muscle.chain.rest();
        let nodes = |all: &[f64]| all.iter().step_by(insert + 1).copied().collect();
        let shape = ChainShape {
            radii: nodes(&rest.radii),
            growth: nodes(&rest.growth),
            ..rest.clone()
        };
        let mut model = Self {
            muscle,
            shape,
            insert,
        };
        // Where a radius is 0 at the longest length, rounding can exceed that length.
        let [_, most] = model.muscle.range;
        if matches!(
            model.muscle.chain.clone().set_length(most),
            Err(ChainError::TooLong { .. })
        ) {
            model.muscle.range[1] = (most * (1.0 - ROUNDED)).max(model.shape.length);
        }
        // An animation uses both ends.
        model
            .muscle
            .range
            .iter()
            .try_for_each(|&end| model.muscle.chain.clone().set_length(end))
            .map_err(of_chain)?;
        Ok(model)
    }

    /// Sets a length between the shortest and the longest.
    fn set_length(&mut self, length: f64) -> Result<(), Refused> {
        let [least, most] = self.muscle.range;
        let slack = ROUNDED * most;
        // Not `<`, which is false for NaN.
        if !(least - slack <= length && length <= most + slack) {
            return Err(Refused::Outside {
                what: "the length".to_owned(),
                value: 1e2 * length,
                low: 1e2 * least,
                high: 1e2 * most,
                unit: "cm",
            });
        }
        self.muscle
            .chain
            .set_length(length.clamp(least, most))
            .map_err(of_chain)
    }

    /// The radius of a node at a length, for the radius `radius` at rest [m].
    fn radius_at(&self, length: f64, node: usize, radius: f64) -> Result<f64, ChainError> {
        let mut shape = self.shape.clone();
        shape.radii[node] = radius;
        let mut chain = Chain::new(shape.refined(self.insert))?;
        chain.set_length(length)?;
        Ok(chain.radii()[node * (self.insert + 1)])
    }

    /// The rest radius of a node for another radius at the present length [m]. The former increases
    /// with the latter.
    fn at_rest(&self, node: usize, wanted: f64) -> Result<f64, Refused> {
        let (length, rest) = (self.muscle.chain.length(), self.shape.length);
        let outside = |low: f64, high: f64| Refused::Outside {
            what: format!(
                "at a length of {} cm the radius of node {}",
                pliant::format::number(1e2 * length),
                node + 1
            ),
            value: 1e2 * wanted,
            low: 1e2 * low,
            high: 1e2 * high,
            unit: "cm",
        };
        // A muscle twice as thick as long is an error of the user.
        if !(wanted <= rest) {
            return Err(outside(0.0, rest));
        }
        if length == rest {
            return Ok(wanted);
        }
        if let Ok(least) = self.radius_at(length, node, 0.0)
            && wanted < least
        {
            return Err(outside(least, rest));
        }
        let own = node * (self.insert + 1) + 1;
        let (mut low, mut high) = (0.0, 2.0 * rest);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if middle <= low || middle >= high {
                break;
            }
            let is_thinner = match self.radius_at(length, node, middle) {
                Ok(radius) => radius < wanted,
                Err(ChainError::TooLong { node, .. }) => node == own,
                Err(_) => false,
            };
            if is_thinner {
                low = middle
            } else {
                high = middle
            }
        }
        let found = self.radius_at(length, node, high).map_err(of_chain)?;
        if (found - wanted).abs() <= ROUNDED * rest {
            Ok(high)
        } else {
            Err(outside(0.0, found))
        }
    }
}

fn of_chain(error: ChainError) -> Refused {
    Refused::Geometric(error.into())
}

/// True for a path that changes the present length, not the muscle.
fn is_of_length(path: &str) -> bool {
    matches!(path, "length" | "animation")
}

impl Biceps {
    /// Reads a file.
    pub(super) fn new(recipe: Recipe) -> Result<Self, StartError> {
        let refused = |why| StartError::Muscle {
            name: recipe.name().to_owned(),
            why: Box::new(why),
        };
        let model = Model::of(&recipe).map_err(refused)?;
        let greatest = |all: &[f64]| all.iter().copied().fold(0.0, f64::max);
        let most = (
            2.0 * greatest(&model.shape.radii),
            (2.0 * greatest(&model.shape.growth)).max(1.0),
        );
        let pose = Pose::of(&model.muscle);
        let (stage, controls) = (Arc::new(stage(&pose)), Arc::default());
        let name = recipe.name().to_owned();
        let mut biceps = Self {
            recipe,
            model,
            by_hand: false,
            frame: 0,
            pose,
            stage,
            controls,
            most,
            probe: None,
        };
        biceps.begin().map_err(|why| StartError::Muscle {
            name,
            why: Box::new(why),
        })?;
        Ok(biceps)
    }

    /// Frame 0, at rest or at the given length.
    fn begin(&mut self) -> Result<(), Refused> {
        let (mut length_given, mut by_hand) = (None, false);
        for (path, value) in self.recipe.given() {
            match path {
                "length" => {
                    (length_given, by_hand) = (Some(length(value, self.model.muscle.unit)?), true)
                }
                "animation" => by_hand = !is_on(value)?,
                _ => {}
            }
        }
        self.model
            .set_length(length_given.unwrap_or(self.model.shape.length))?;
        (self.frame, self.by_hand) = (0, by_hand);
        self.look();
        Ok(())
    }

    /// Updates the displayed state.
    fn look(&mut self) {
        let before = std::mem::replace(&mut self.pose, Pose::of(&self.model.muscle));
        if self.pose.bars.is_empty() {
            self.pose.bars.clone_from(&before.bars);
        }
        if self.pose.mesh.triangles != before.mesh.triangles {
            self.stage = Arc::new(stage(&self.pose));
            self.probe = self
                .probe
                .filter(|(body, vertex)| *body > 0 || *vertex < self.pose.mesh.vertices.len());
        }
        self.controls = Arc::new(self.controls_now());
    }

    fn controls_now(&self) -> Vec<Control> {
        let (
            Model {
                muscle,
                shape,
                insert,
            },
            mut list,
        ) = (&self.model, List::default());
        let path = |path: &str| Target::Path(path.to_owned());
        list.other(
            "length",
            "animation",
            path("animation"),
            Kind::Switch,
            Value::On(!self.by_hand),
        );
        let [least, most] = muscle.range.map(|l| 1e2 * l);
        list.slider(
            "length",
            "length",
            path("length"),
            1e2 * muscle.chain.length(),
            Shown::even("cm", least, most),
        );
        for (k, (radius, growth)) in shape.radii.iter().zip(&shape.growth).enumerate() {
            let group = format!("node {}", k + 1);
            let shown = Shown::even("cm", 0.0, 1e2 * self.most.0);
            list.slider(
                &group,
                "radius at rest",
                path(&format!("radii.{k}")),
                1e2 * radius,
                shown,
            );
            list.slider(
                &group,
                "growth",
                path(&format!("grow_mults.{k}")),
                *growth,
                Shown::even("", 0.0, self.most.1),
            );
        }
        let insert = u32::try_from(*insert).unwrap_or(u32::MAX);
        let kind = Kind::Whole {
            range: (0, MOST_INSERTED.max(insert)),
            scale: super::panel::Scale::Linear,
        };
        list.other(
            "nodes",
            "inserted between two",
            path("insert"),
            kind,
            Value::Whole(insert),
        );
        list.0
    }

    /// Continues with another muscle, at the same length if possible. An animation would leave that
    /// length in any case.
    fn change(&mut self, recipe: Recipe) -> Result<(), Refused> {
        let (mut model, length) = (Model::of(&recipe)?, self.model.muscle.chain.length());
        let [least, most] = model.muscle.range;
        model.set_length(if self.by_hand {
            length
        } else {
            length.clamp(least, most)
        })?;
        (self.recipe, self.model) = (recipe, model);
        self.look();
        Ok(())
    }

    fn set(&mut self, path: &str, value: &str) -> Result<(), Refused> {
        match path {
            "animation" => self.by_hand = !is_on(value)?,
            "length" => {
                self.model
                    .set_length(length(value, self.model.muscle.unit)?)?;
                self.by_hand = true;
            }
            _ => return self.change(self.recipe.with(path, value)),
        }
        self.look();
        Ok(())
    }

    fn move_node(&mut self, node: usize, to: &Point3<f64>) -> Result<(), Refused> {
        check_index("node", node, self.model.shape.radii.len())?;
        to.iter()
            .try_for_each(|c| check_number("a coordinate of the place to move to", *c, false))?;
        let radius = self.model.at_rest(node, libm::hypot(to.y, to.z))?;
        self.change(
            self.recipe
                .with(&format!("radii.{node}"), &format!("{radius} m")),
        )
    }

    fn readings(&self) -> Vec<Reading> {
        let reading = |name, unit, value| Reading {
            name,
            of: String::new(),
            unit,
            value,
        };
        let (chain, pose) = (&self.model.muscle.chain, &self.pose);
        let mut all = vec![
            reading("Length", "cm", 1e2 * pose.length),
            reading("Volume", "cm3", 1e6 * chain.volume_now()),
            reading("Volume error", "", pose.volume_error),
            reading("Greatest radius", "cm", 1e2 * pose.radius),
        ];
        all.extend(
            pose.joint_angle
                .map(|angle| reading("Joint angle", "deg", angle.to_degrees())),
        );
        all
    }

    /// The surface, and the bars if any.
    fn bodies(&self) -> Vec<BodyShot> {
        let surface = BodyShot {
            positions: self.pose.mesh.vertices.clone(),
            volume_error: self.pose.volume_error,
            ..BodyShot::default()
        };
        let bars = BodyShot {
            positions: joints(&self.pose),
            ..BodyShot::default()
        };
        if bars.positions.is_empty() {
            vec![surface]
        } else {
            vec![surface, bars]
        }
    }

    fn probed(&self, (body, vertex): (usize, usize), bodies: &[BodyShot]) -> Probe {
        let at = bodies[body].positions[vertex];
        Probe {
            body,
            vertex,
            values: vec![(
                "distance from the axis",
                1e2 * libm::hypot(at.y, at.z),
                "cm",
            )],
        }
    }
}

fn is_on(value: &str) -> Result<bool, Refused> {
    match value.trim() {
        "on" => Ok(true),
        "off" | "none" => Ok(false),
        other => Err(Refused::Value {
            path: "animation".to_owned(),
            value: other.to_owned(),
            wanted: "`on` or `off`",
        }),
    }
}

/// Free end, muscle, joint, muscle, free end; empty without bars.
fn joints(pose: &Pose) -> Vec<Point3<f64>> {
    match pose.bars.as_slice() {
        [first, second] => first.iter().chain(&second[1..]).copied().collect(),
        _ => Vec::new(),
    }
}

fn stage(pose: &Pose) -> Stage {
    let body = |name: &str, tissue, triangles, edges| StageBody {
        name: name.to_owned(),
        tissue,
        triangles,
        edges,
        held: Vec::new(),
        fibres: BoundLines::default(),
    };
    let edges = Topology::new(&pose.mesh).edges;
    let mut bodies = vec![body(
        "muscle",
        Tissue::Muscle,
        pose.mesh.triangles.clone(),
        edges,
    )];
    let ends = joints(pose).len() as u32;
    if ends > 0 {
        bodies.push(body(
            "bars",
            Tissue::Plain,
            Vec::new(),
            (1..ends).map(|end| [end - 1, end]).collect(),
        ));
    }
    Stage {
        bodies,
        bones: Vec::new(),
    }
}

impl Subject for Biceps {
    fn frame_rate(&self) -> f64 {
        RATE
    }

    fn shot(&mut self) -> Shot {
        let bodies = self.bodies();
        let (chain, parts) = (&self.model.muscle.chain, self.model.insert + 1);
        let radii = chain.radii().iter().step_by(parts).enumerate();
        // At the top of its ring, where the front view shows the axis.
        let at =
            |k: usize, radius: f64| Point3::new(chain.spacing() * (k * parts) as f64, radius, 0.0);
        Shot {
            frame: self.frame,
            last_frame: PERIOD as usize,
            stage: self.stage.clone(),
            scene: None,
            controls: self.controls.clone(),
            bones: Vec::new(),
            handles: radii
                .map(|(k, r)| Handle {
                    name: format!("node {}", k + 1),
                    at: at(k, *r),
                })
                .collect(),
            readings: self.readings(),
            probe: self.probe.map(|probe| self.probed(probe, &bodies)),
            bodies,
            effects: Vec::new(),
            notes: Vec::new(),
        }
    }

    fn advance(&mut self, _: Watch<'_>) -> Advanced {
        let frame = self.frame + 1;
        if !self.by_hand {
            let length = length_at(&self.model.muscle, (frame % PERIOD as usize) as u32, PERIOD);
            if let Err(error) = self.model.set_length(length) {
                return Advanced::Failed(error.to_string());
            }
            self.look();
        }
        self.frame = frame;
        Advanced::On
    }

    fn obey(&mut self, command: &Command) -> Result<(), Refused> {
        match command {
            Command::Reset => self.begin(),
            Command::Set { path, value } => self.set(path, value),
            Command::Restore { path } if is_of_length(path) => {
                let frame = self.frame;
                self.begin()?;
                self.frame = frame;
                Ok(())
            }
            Command::Restore { path } => self.change(self.recipe.without(path)),
            Command::Move { handle, to } => self.move_node(*handle, to),
            Command::Probe(None) => {
                self.probe = None;
                Ok(())
            }
            Command::Probe(Some((body, vertex))) => {
                let bodies = self.bodies();
                check_index("body", *body, bodies.len())?;
                check_index("vertex", *vertex, bodies[*body].positions.len())?;
                self.probe = Some((*body, *vertex));
                Ok(())
            }
            Command::Turn { bone, .. } | Command::Hold { bone } | Command::ByMotion { bone } => {
                check_index("bone", *bone, 0)
            }
            Command::Drag { .. } | Command::Fix { .. } | Command::Free { .. } => {
                Err(Refused::NotHere(
                    "a geometric muscle has no points to drag or to hold; move its nodes",
                ))
            }
            Command::Seek { .. } | Command::Backwards(_) => {
                Err(Refused::NotHere(super::ONLY_REPLAYED))
            }
            Command::LetGo { .. }
            | Command::Pause
            | Command::Run
            | Command::Step
            | Command::Speed(_) => Ok(()),
        }
    }
}
