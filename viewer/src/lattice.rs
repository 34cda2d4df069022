//! A lattice in a session: displaced as in its scene and by hand.
//!
//! Other properties of springs and points keep its motion; another number of points restarts it.

use std::collections::BTreeSet;
use std::sync::Arc;

use nalgebra::{Point3, Vector3};

use super::panel::{Control, Kind, List, Shown, Target, Value};
use super::recipe::{Recipe, Refused, StartError, check_index, check_number};
use super::session::Command;
use super::snapshot::{BodyShot, Probe, Reading, Shot, Stage, StageBody, Tissue};
use super::subject::{Advanced, Subject, Watch};
use pliant::constraints::Distance;
use pliant::fibres::BoundLines;
use pliant::mesh::Topology;
use pliant::scene::{Content, LatticeScene};
use pliant::simulation::{LatticeRun, Stepped, strain_at_vertices};
use pliant::springs::Neighbours;

/// Greatest motion of a dragged point per frame, relative to the spacing: inverted springs do not
/// recover.
const MOST_DRAG: f64 = 0.5;

/// A lattice in a session.
pub(super) struct Lattice {
    recipe: Recipe,
    start: LatticeScene,
    run: LatticeRun,
    stage: Arc<Stage>,
    controls: Arc<Vec<Control>>,
    springs: Vec<Distance>,
    /// Fixed vertices of the surface.
    fixed: BTreeSet<usize>,
    /// The dragged vertex and its target [m].
    dragged: Option<(usize, Point3<f64>)>,
    probe: Option<usize>,
    frame_ms: f64,
}

fn scene_of(recipe: &Recipe) -> Result<LatticeScene, Refused> {
    match recipe.content().map_err(Refused::Scene)? {
        Content::Lattice(scene) => Ok(*scene),
        _ => Err(Refused::NotHere(
            "this would be no scene of a lattice any more",
        )),
    }
}

impl Lattice {
    /// Creates the lattice of `scene`.
    pub(super) fn new(recipe: Recipe, scene: LatticeScene) -> Result<Self, StartError> {
        let (start, run) = (scene.clone(), LatticeRun::new(scene)?);
        let mut lattice = Self {
            recipe,
            start,
            run,
            stage: Arc::default(),
            controls: Arc::default(),
            springs: Vec::new(),
            fixed: BTreeSet::new(),
            dragged: None,
            probe: None,
            frame_ms: 0.0,
        };
        lattice.look();
        Ok(lattice)
    }

    /// The displayed data of a new surface.
    fn look(&mut self) {
        let surface = &self.run.surface;
        let topology = Topology::new(surface);
        let lengths = topology.edge_lengths(surface);
        self.springs = topology
            .edges
            .iter()
            .zip(lengths)
            .map(|(&points, rest)| Distance { points, rest })
            .collect();
        let held = (0..surface.vertices.len())
            .filter(|v| self.run.point_of(*v)[2] == 0)
            .map(|v| v as u32);
        let body = StageBody {
            name: self.run.scene.name.clone(),
            tissue: Tissue::Plain,
            triangles: surface.triangles.clone(),
            held: held.collect(),
            edges: topology.edges,
            fibres: BoundLines::default(),
        };
        self.stage = Arc::new(Stage {
            bodies: vec![body],
            bones: Vec::new(),
        });
        self.controls = Arc::new(controls(&self.start, &self.run.scene));
        self.probe = self.probe.filter(|v| *v < self.run.surface.vertices.len());
    }

    fn change(&mut self, recipe: Recipe) -> Result<(), Refused> {
        let mut run = LatticeRun::new(scene_of(&recipe)?).map_err(Refused::Load)?;
        if run.lattice.shape() == self.run.lattice.shape() {
            run.continue_from(&self.run);
            self.controls = Arc::new(controls(&self.start, &run.scene));
            (self.recipe, self.run) = (recipe, run);
        } else {
            (self.recipe, self.run, self.dragged, self.frame_ms) = (recipe, run, None, 0.0);
            self.fixed.clear();
            self.look();
        }
        Ok(())
    }

    /// A vertex that is in no fixed layer of the scene.
    fn free(&self, body: usize, vertex: usize) -> Result<(), Refused> {
        check_index("body", body, 1)?;
        check_index("vertex", vertex, self.run.surface.vertices.len())?;
        let [.., layer] = self.run.point_of(vertex);
        let scene = &self.run.scene;
        if layer == 0 {
            return Err(Refused::NotHere(
                "the scene holds the lowest layer; choose a vertex above it",
            ));
        }
        if layer + 1 == scene.points[2]
            && scene.drag.norm() > 0.0
            && self.run.frame() < scene.release
        {
            return Err(Refused::NotHere(
                "the scene drags the highest layer and has not let it go yet; choose a vertex below",
            ));
        }
        Ok(())
    }

    fn drag(&mut self, vertex: usize, to: &Point3<f64>) -> Result<(), Refused> {
        to.iter()
            .try_for_each(|c| check_number("a coordinate of the place to drag to", *c, false))?;
        if self.dragged.is_none_or(|(known, _)| known != vertex) {
            self.let_go();
        }
        self.run.lattice.pin(self.run.point_of(vertex));
        self.dragged = Some((vertex, *to));
        Ok(())
    }

    fn let_go(&mut self) {
        if let Some((vertex, _)) = self
            .dragged
            .take()
            .filter(|(vertex, _)| !self.fixed.contains(vertex))
        {
            self.run.lattice.release(self.run.point_of(vertex));
        }
    }

    /// Moves dragged points and holds fixed ones: the scene's release of its top layer releases all
    /// of its points.
    fn steer(&mut self) {
        let most = MOST_DRAG * self.run.lattice.shape().spacing[0];
        if let Some((vertex, to)) = self.dragged {
            let point = self.run.point_of(vertex);
            let from = Point3::from(self.run.lattice.position(point));
            let way = to - from;
            let share = if way.norm() > most {
                most / way.norm()
            } else {
                1.0
            };
            self.run.lattice.place(point, (from + way * share).into());
        }
        for vertex in self
            .fixed
            .iter()
            .copied()
            .chain(self.dragged.map(|(vertex, _)| vertex))
        {
            self.run.lattice.pin(self.run.point_of(vertex));
        }
    }

    fn velocity(&self, point: [usize; 3]) -> Vector3<f64> {
        let lattice = &self.run.lattice;
        let moved = Vector3::from(lattice.position(point))
            - Vector3::from(lattice.previous_position(point));
        moved / lattice.time_step()
    }

    fn readings(&self) -> Vec<Reading> {
        let (lattice, last) = (&self.run.lattice, self.run.frames.last());
        let twice: f64 = lattice
            .shape()
            .each()
            .map(|p| self.velocity(p).norm_squared())
            .sum();
        let one = |name, unit, value| Reading {
            name,
            of: String::new(),
            unit,
            value,
        };
        vec![
            one(
                "Distance from the start",
                "mm",
                last.map_or(0.0, |f| 1e3 * f.distance),
            ),
            one(
                "Motion in a frame",
                "mm",
                last.map_or(0.0, |f| 1e3 * f.moved),
            ),
            one("Kinetic energy", "mJ", 0.5e3 * self.run.scene.mass * twice),
        ]
    }
}

/// Controls of springs and points; the start value is in the middle of the range.
fn controls(start: &LatticeScene, now: &LatticeScene) -> Vec<Control> {
    let mut list = List::default();
    let path = |key: &str| Target::Path(format!("lattice.{key}"));
    let shown = Shown::about("N/m", start.stiffness, 100.0, 1e3);
    list.slider(
        "lattice",
        "stiffness",
        path("stiffness"),
        now.stiffness,
        shown,
    );
    let shown = Shown::about("g", 1e3 * start.mass, 10.0, 10.0);
    list.slider(
        "lattice",
        "mass of a point",
        path("mass"),
        1e3 * now.mass,
        shown,
    );
    let most = (4.0 * start.damping).clamp(2.0, 10.0);
    list.slider(
        "lattice",
        "damping",
        path("damping"),
        now.damping,
        Shown::even("", 0.0, most),
    );
    let chosen = usize::from(now.neighbours == Neighbours::TwentySix);
    list.other(
        "lattice",
        "neighbours",
        path("neighbours"),
        Kind::Choice(vec!["6", "26"]),
        Value::Choice(chosen),
    );
    list.0
}

impl Subject for Lattice {
    fn frame_rate(&self) -> f64 {
        self.run.scene.frame_rate
    }

    fn shot(&mut self) -> Shot {
        let positions = self.run.surface_at();
        let speeds = (0..positions.len()).map(|v| self.velocity(self.run.point_of(v)).norm());
        let body = BodyShot {
            stretch: strain_at_vertices(&self.springs, &positions),
            speed: speeds.collect(),
            fixed: self.fixed.iter().map(|v| *v as u32).collect(),
            dragged: self.dragged.map(|(vertex, to)| (vertex as u32, to)),
            positions,
            ..BodyShot::default()
        };
        let probe = |vertex: usize| Probe {
            body: 0,
            vertex,
            values: vec![
                ("stretch", 100.0 * body.stretch[vertex], "%"),
                ("speed", 1e3 * body.speed[vertex], "mm/s"),
                (
                    "from the start",
                    1e3 * (body.positions[vertex] - self.run.surface.vertices[vertex]).norm(),
                    "mm",
                ),
            ],
        };
        Shot {
            frame: self.run.frame(),
            last_frame: self.run.scene.frames,
            stage: self.stage.clone(),
            scene: None,
            controls: self.controls.clone(),
            probe: self.probe.map(probe),
            bodies: vec![body],
            bones: Vec::new(),
            handles: Vec::new(),
            readings: self.readings(),
            effects: vec![("springs", self.frame_ms)],
            notes: Vec::new(),
        }
    }

    fn advance(&mut self, _: Watch<'_>) -> Advanced {
        self.steer();
        match self.run.step() {
            Stepped::Done => {
                self.frame_ms = self.run.frames.last().map_or(0.0, |f| 1e3 * f.time_s);
                Advanced::On
            }
            Stepped::Interrupted => Advanced::GivenUp,
            Stepped::Failed(why) => Advanced::Failed(why),
        }
    }

    fn obey(&mut self, command: &Command) -> Result<(), Refused> {
        match command {
            Command::Reset => {
                self.run = LatticeRun::new(self.run.scene.clone()).map_err(Refused::Load)?;
                (self.dragged, self.frame_ms) = (None, 0.0);
                self.fixed.clear();
            }
            Command::Set { path, value } => return self.change(self.recipe.with(path, value)),
            Command::Restore { path } => return self.change(self.recipe.without(path)),
            Command::Drag {
                body, vertex, to, ..
            } => {
                self.free(*body, *vertex)?;
                return self.drag(*vertex, to);
            }
            Command::LetGo { body } => {
                check_index("body", *body, 1)?;
                self.let_go();
            }
            Command::Fix { body, vertex } => {
                self.free(*body, *vertex)?;
                self.fixed.insert(*vertex);
                self.run.lattice.pin(self.run.point_of(*vertex));
            }
            Command::Free { body, vertex } => {
                self.free(*body, *vertex)?;
                let is_dragged = self.dragged.is_some_and(|(dragged, _)| dragged == *vertex);
                if self.fixed.remove(vertex) && !is_dragged {
                    self.run.lattice.release(self.run.point_of(*vertex));
                }
            }
            Command::Probe(None) => self.probe = None,
            Command::Probe(Some((body, vertex))) => {
                check_index("body", *body, 1)?;
                check_index("vertex", *vertex, self.run.surface.vertices.len())?;
                self.probe = Some(*vertex);
            }
            Command::Turn { bone, .. } | Command::Hold { bone } | Command::ByMotion { bone } => {
                return check_index("bone", *bone, 0);
            }
            Command::Move { handle, .. } => return check_index("handle", *handle, 0),
            Command::Seek { .. } | Command::Backwards(_) => {
                return Err(Refused::NotHere(super::ONLY_REPLAYED));
            }
            Command::Pause | Command::Run | Command::Step | Command::Speed(_) => {}
        }
        Ok(())
    }
}
