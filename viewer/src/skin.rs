//! Skin over implants, or over a ball, in a session: a dragged implant changes area and volume.
//!
//! Every change prepares the skin again, at frame 0 of the new place. The frames up to the previous
//! one are then computed even in a pause, so that the equilibrium appears without a command. A move
//! is displayed at once, with the skin at rest and the shell at its target; the preparation
//! follows. A newer command interrupts the computation.

mod controls;
mod shots;

use std::sync::Arc;

use nalgebra::{Point3, Vector3};

use super::panel::Control;
use super::recipe::{Recipe, Refused, StartError, check_index, check_number};
use super::session::Command;
use super::snapshot::{Shot, Stage};
use super::subject::{Advanced, Subject, Watch};
use pliant::mesh::{SurfaceTree, TriangleMesh};
use pliant::scene::{Content, ImplantFill, SkinScene, Support};
use pliant::simulation::{LoadError, SkinRun, Stepped};
use pliant::skin::{ImplantPlace, frame};
use shots::PickedPoint;

/// Equilibria have no frame rate; they follow one another at this rate [1/s].
const RATE: f64 = 4.0;

/// An implant during a move: displayed, but not prepared.
struct Moving {
    recipe: Recipe,
    scene: SkinScene,
    /// Position of its handle [m], and its shell [m].
    at: Point3<f64>,
    shell: Vec<Point3<f64>>,
    implant: usize,
}

/// Skin in a session.
pub(super) struct Skin {
    recipe: Recipe,
    run: SkinRun,
    /// The frame before the last change.
    reached: usize,
    moving: Option<Box<Moving>>,
    stage: Arc<Stage>,
    controls: Arc<Vec<Control>>,
    /// Ranges of the sliders.
    ranges: controls::Ranges,
    springs: Vec<pliant::constraints::Distance>,
    /// Position of each implant on the whole skin, and its undeformed shell [m].
    points: Vec<PickedPoint>,
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

fn implants(scene: &SkinScene) -> &[ImplantFill] {
    match &scene.under {
        Support::Implants(all) => all,
        Support::Ball(_) => &[],
    }
}

impl Skin {
    /// Reads the meshes of `scene` and prepares the skin.
    pub(super) fn new(recipe: Recipe, scene: SkinScene) -> Result<Self, StartError> {
        let ranges = controls::Ranges::of(&scene);
        let mut skin = Self {
            recipe,
            run: SkinRun::new(scene)?,
            reached: 0,
            moving: None,
            stage: Arc::default(),
            controls: Arc::default(),
            ranges,
            springs: Vec::new(),
            points: Vec::new(),
            domes: Vec::new(),
            probe: None,
        };
        skin.describe();
        Ok(skin)
    }

    /// Updates the displayed data of a new run.
    fn describe(&mut self) {
        (self.stage, self.springs) = shots::stage(&self.run);
        self.points = shots::points(&self.run);
        self.controls = Arc::new(self.ranges.controls(&self.run, &self.points));
        self.domes = shots::domes(&self.run, self.reached);
        let counts: Vec<usize> = self.seen().0.iter().map(Vec::len).collect();
        self.probe = self
            .probe
            .filter(|(body, v)| counts.get(*body).is_some_and(|count| v < count));
    }

    /// Replaces the run.
    fn take(&mut self, recipe: Recipe, run: SkinRun) {
        self.reached = self.reached.max(self.run.frame());
        (self.recipe, self.run, self.moving) = (recipe, run, None);
        self.describe();
    }

    /// The recipe with all pending changes.
    fn pending(&self) -> &Recipe {
        self.moving
            .as_ref()
            .map_or(&self.recipe, |moving| &moving.recipe)
    }

    /// Changes the skin; restarts it.
    fn change(&mut self, recipe: Recipe) -> Result<(), Refused> {
        let run = SkinRun::new(scene_of(&recipe)?).map_err(Refused::Load)?;
        self.take(recipe, run);
        Ok(())
    }

    fn set(&mut self, path: &str, value: &str) -> Result<(), Refused> {
        let Some(implant) = controls::turned(path) else {
            return self.change(self.pending().with(path, value));
        };
        check_index("implant", implant, self.points.len())?;
        let degrees = controls::degrees(path, value)?;
        let long = self.points[implant].along(degrees.to_radians());
        let parts = [long.x, long.y, long.z].map(|c| c.to_string()).join(", ");
        self.change(
            self.pending()
                .with(&format!("implant.{implant}.long"), &format!("[{parts}]")),
        )
    }

    fn restore(&mut self, path: &str) -> Result<(), Refused> {
        let recipe = match (controls::turned(path), path.strip_suffix(".at")) {
            (Some(implant), _) => self.pending().without(&format!("implant.{implant}.long")),
            // A move has also removed the key of the near vertex.
            (None, Some(implant)) => self
                .pending()
                .without(path)
                .without(&format!("{implant}.near_vertex")),
            _ => self.pending().without(path),
        };
        self.change(recipe)
    }

    fn reset(&mut self) -> Result<(), Refused> {
        self.change(self.pending().clone())?;
        self.reached = 0;
        self.describe();
        Ok(())
    }

    /// Displays an implant at the point of the skin nearest to `to`; [`Subject::advance`] prepares
    /// it.
    fn move_implant(&mut self, implant: usize, to: &Point3<f64>) -> Result<(), Refused> {
        check_index("implant", implant, self.points.len())?;
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
        // The point of the skin at rest at that position.
        let point = PickedPoint::new(&shown, &skin.triangles, found.triangle, &found.point);
        let at = point.at(&skin.vertices);
        let parts = [at.x, at.y, at.z].map(|c| format!("\"{c} m\"")).join(", ");
        let mut recipe = self.pending().clone();
        let order = &implants(&self.run.scene)[implant].order;
        if matches!(order.place, ImplantPlace::Vertex(_)) {
            recipe = recipe.with(&format!("implant.{implant}.near_vertex"), "none");
        }
        let recipe = recipe.with(&format!("implant.{implant}.at"), &format!("[{parts}]"));
        let scene = scene_of(&recipe)?;
        if self.run.frame() > self.reached {
            self.reached = self.run.frame();
            self.domes = shots::domes(&self.run, self.reached);
        }
        // The undeformed shape in the frame of the new place.
        let normal = point.normal(&skin.vertices);
        let turn = frame(&at, &normal, order.long.as_ref()) * self.points[implant].frame.inverse();
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

    /// Prepares a moved implant.
    fn arrive(&mut self, moving: Moving, watch: Watch<'_>) -> Advanced {
        match SkinRun::new_with(moving.scene.clone(), &watch) {
            Ok(run) => {
                self.take(moving.recipe, run);
                Advanced::Running
            }
            Err(_) if watch.is_ended() || watch.is_called() => {
                self.moving = Some(Box::new(moving));
                Advanced::Interrupted
            }
            // The implant stays at its previous place.
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
            return Advanced::Finished;
        }
        match self.run.step(&watch) {
            Stepped::Done if self.run.frame() >= last => Advanced::Finished,
            Stepped::Done => Advanced::Running,
            Stepped::Interrupted => Advanced::Interrupted,
            Stepped::Failed(why) => Advanced::Failed(why),
        }
    }

    fn apply(&mut self, command: &Command) -> Result<(), Refused> {
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

/// The direction at `angle` [rad] from x about z of a frame.
fn direction(frame: &nalgebra::Isometry3<f64>, angle: f64) -> Vector3<f64> {
    frame * Vector3::new(libm::cos(angle), libm::sin(angle), 0.0)
}
