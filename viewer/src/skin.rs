//! Skin over implants, or over a ball, as a subject: an implant is dragged over the skin, area and volume follow.
//!
//! Every change makes the skin ready anew, at frame 0 of the new place; the frames up to the one that was reached are then
//! computed whether it runs or not, so that the equilibrium is there without being asked for. A move is shown at once, the
//! skin at rest and the shell where it will be, and made ready after that; a newer command gives up what is being computed.

mod controls;
mod shots;

use std::sync::Arc;

use nalgebra::{Point3, Vector3};

use super::panel::Control;
use super::recipe::{Recipe, Refused, StartError, check_index, check_number};
use super::session::Command;
use super::snapshot::{Shot, Stage};
use super::subject::{Advanced, Subject, Watch};
use pliant::mesh::TriangleMesh;
use pliant::mesh::closest::SurfaceTree;
use pliant::scene::content::{Content, Filled, SkinScene, Under};
use pliant::simulation::LoadError;
use pliant::simulation::Stepped;
use pliant::simulation::skin::SkinRun;
use pliant::skin::plan::Place;
use pliant::skin::region::frame;
use shots::Spot;

/// Frames of an equilibrium have no rate of their own; they follow one another at this one [1/s].
const RATE: f64 = 4.0;

/// An implant on its way to another place: shown, but not made ready.
struct Moving {
    recipe: Recipe,
    scene: SkinScene,
    /// Where its handle is [m], and its shell [m].
    at: Point3<f64>,
    shell: Vec<Point3<f64>>,
    implant: usize,
}

/// Skin that is looked at.
pub(super) struct Skin {
    recipe: Recipe,
    run: SkinRun,
    /// The frame that was reached before the last change.
    reached: usize,
    moving: Option<Box<Moving>>,
    stage: Arc<Stage>,
    controls: Arc<Vec<Control>>,
    /// What the sliders were made for.
    ranges: controls::Ranges,
    springs: Vec<pliant::constraints::distance::Distance>,
    /// Where on the whole skin each implant is, and its shell as it would be before anything gives way [m].
    spots: Vec<Spot>,
    domes: Vec<TriangleMesh>,
    probe: Option<(usize, usize)>,
}

/// The scene of a recipe.
fn scene_of(recipe: &Recipe) -> Result<SkinScene, Refused> {
    match recipe.content().map_err(Refused::Scene)? {
        Content::Skin(scene) => Ok(*scene),
        _ => Err(Refused::NotHere("this would be no scene of skin any more")),
    }
}

fn implants(scene: &SkinScene) -> &[Filled] {
    match &scene.under {
        Under::Implants(all) => all,
        Under::Ball(_) => &[],
    }
}

impl Skin {
    /// Reads the meshes of `scene` and makes the skin ready.
    pub(super) fn new(recipe: Recipe, scene: SkinScene) -> Result<Self, StartError> {
        let ranges = controls::Ranges::of(&recipe, &scene);
        let mut skin = Self {
            recipe,
            run: SkinRun::new(scene)?,
            reached: 0,
            moving: None,
            stage: Arc::default(),
            controls: Arc::default(),
            ranges,
            springs: Vec::new(),
            spots: Vec::new(),
            domes: Vec::new(),
            probe: None,
        };
        skin.look();
        Ok(skin)
    }

    /// Everything that a newly made run is seen by.
    fn look(&mut self) {
        (self.stage, self.springs) = shots::stage(&self.run);
        self.spots = shots::spots(&self.run);
        self.controls = Arc::new(self.ranges.controls(&self.run, &self.spots));
        self.domes = shots::domes(&self.run, self.reached);
        let counts: Vec<usize> = self.seen().0.iter().map(Vec::len).collect();
        self.probe = self
            .probe
            .filter(|(body, v)| counts.get(*body).is_some_and(|count| v < count));
    }

    /// Another run in place of this one.
    fn take(&mut self, recipe: Recipe, run: SkinRun) {
        self.reached = self.reached.max(self.run.frame());
        (self.recipe, self.run, self.moving) = (recipe, run, None);
        self.look();
    }

    /// The recipe with all that was asked for.
    fn wanted(&self) -> &Recipe {
        self.moving
            .as_ref()
            .map_or(&self.recipe, |moving| &moving.recipe)
    }

    /// Another skin at the start.
    fn change(&mut self, recipe: Recipe) -> Result<(), Refused> {
        let run = SkinRun::new(scene_of(&recipe)?).map_err(Refused::Load)?;
        self.take(recipe, run);
        Ok(())
    }

    fn set(&mut self, path: &str, value: &str) -> Result<(), Refused> {
        let Some(implant) = controls::turned(path) else {
            return self.change(self.wanted().with(path, value));
        };
        check_index("implant", implant, self.spots.len())?;
        let degrees = controls::degrees(path, value)?;
        let long = self.spots[implant].along(degrees.to_radians());
        let parts = [long.x, long.y, long.z].map(|c| c.to_string()).join(", ");
        self.change(
            self.wanted()
                .with(&format!("implant.{implant}.long"), &format!("[{parts}]")),
        )
    }

    fn restore(&mut self, path: &str) -> Result<(), Refused> {
        let recipe = match (controls::turned(path), path.strip_suffix(".at")) {
            (Some(implant), _) => self.wanted().without(&format!("implant.{implant}.long")),
            // A move has also removed the vertex that it was near.
            (None, Some(implant)) => self
                .wanted()
                .without(path)
                .without(&format!("{implant}.near_vertex")),
            _ => self.wanted().without(path),
        };
        self.change(recipe)
    }

    fn reset(&mut self) -> Result<(), Refused> {
        self.change(self.wanted().clone())?;
        self.reached = 0;
        self.look();
        Ok(())
    }

    /// Shows an implant at the point of the skin nearest to `to`; [`Subject::advance`] makes it so.
    fn move_implant(&mut self, implant: usize, to: &Point3<f64>) -> Result<(), Refused> {
        check_index("implant", implant, self.spots.len())?;
        to.iter()
            .try_for_each(|c| check_number("a coordinate of the place to move to", *c, false))?;
        let shown = self.seen().0.swap_remove(0);
        let skin = &self.run.whole;
        let tree = SurfaceTree::new(&shown, &skin.triangles);
        let Some(found) = tree.closest(to, f64::INFINITY) else {
            return Err(Refused::NotHere(
                "the skin has no triangles to move an implant over",
            ));
        };
        // The place of the skin at rest that is there now.
        let spot = Spot::new(&shown, &skin.triangles, found.triangle, &found.point);
        let at = spot.at(&skin.vertices);
        let parts = [at.x, at.y, at.z].map(|c| format!("\"{c} m\"")).join(", ");
        let mut recipe = self.wanted().clone();
        let order = &implants(&self.run.scene)[implant].order;
        if matches!(order.place, Place::Vertex(_)) {
            recipe = recipe.with(&format!("implant.{implant}.near_vertex"), "none");
        }
        let recipe = recipe.with(&format!("implant.{implant}.at"), &format!("[{parts}]"));
        let scene = scene_of(&recipe)?;
        if self.run.frame() > self.reached {
            self.reached = self.run.frame();
            self.domes = shots::domes(&self.run, self.reached);
        }
        // As it would be here, but in the frame of the new place.
        let normal = spot.normal(&skin.vertices);
        let turn = frame(&at, &normal, order.long.as_ref()) * self.spots[implant].frame.inverse();
        let shell = self.domes[implant]
            .vertices
            .iter()
            .map(|p| turn * p)
            .collect();
        self.moving = Some(Box::new(Moving {
            recipe,
            scene,
            at,
            shell,
            implant,
        }));
        Ok(())
    }

    /// Makes ready what was moved.
    fn arrive(&mut self, moving: Moving, watch: Watch<'_>) -> Advanced {
        match SkinRun::new_with(moving.scene.clone(), &watch) {
            Ok(run) => {
                self.take(moving.recipe, run);
                Advanced::On
            }
            Err(_) if watch.is_ended() || watch.is_called() => {
                self.moving = Some(Box::new(moving));
                Advanced::GivenUp
            }
            // It stays where it was before.
            Err(error) => Advanced::Refused(LoadError::terse(&error)),
        }
    }
}

impl Subject for Skin {
    fn frame_rate(&self) -> f64 {
        RATE
    }

    fn shot(&mut self) -> Shot {
        self.shown()
    }

    fn wants_frames(&self) -> bool {
        self.moving.is_some() || self.run.frame() < self.reached
    }

    fn advance(&mut self, watch: Watch<'_>) -> Advanced {
        if let Some(moving) = self.moving.take() {
            return self.arrive(*moving, watch);
        }
        let last = self.run.scene.frames;
        if self.run.frame() >= last {
            return Advanced::Rests;
        }
        match self.run.step(&watch) {
            Stepped::Done if self.run.frame() >= last => Advanced::Rests,
            Stepped::Done => Advanced::On,
            Stepped::Interrupted => Advanced::GivenUp,
            Stepped::Failed(why) => Advanced::Failed(why),
        }
    }

    fn obey(&mut self, command: &Command) -> Result<(), Refused> {
        match command {
            Command::Reset => self.reset(),
            Command::Set { path, value } => self.set(path, value),
            Command::Restore { path } => self.restore(path),
            Command::Move { handle, to } => self.move_implant(*handle, to),
            Command::Probe(None) => {
                self.probe = None;
                Ok(())
            }
            Command::Probe(Some((body, vertex))) => {
                let bodies = self.seen().0;
                check_index("body", *body, bodies.len())?;
                check_index("vertex", *vertex, bodies[*body].len())?;
                self.probe = Some((*body, *vertex));
                Ok(())
            }
            Command::Turn { .. } | Command::Hold { .. } | Command::ByMotion { .. } => {
                Err(Refused::NotHere("what lies under skin does not turn"))
            }
            Command::Drag { .. } | Command::Fix { .. } | Command::Free { .. } => {
                Err(Refused::NotHere(
                    "skin at rest has no points to drag or to hold; move an implant by its handle",
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

/// The direction that `angle` [rad] is about z from x, of a frame.
fn direction(frame: &nalgebra::Isometry3<f64>, angle: f64) -> Vector3<f64> {
    frame * Vector3::new(libm::cos(angle), libm::sin(angle), 0.0)
}
