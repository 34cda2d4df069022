//! A running scene of any kind in a session: the part of a subject that all kinds share. A kind adds
//! its controls, readings, handles and its own commands.

use std::sync::Arc;

use nalgebra::Point3;

use super::panel::Control;
use super::recipe::{Recipe, Refused, StartError, check_index};
use super::session::Command;
use super::snapshot::{
    BodyShot, BoneShot, Probe, Reading, Shot, Stage, StageBody, Steering, Tissue,
};
use super::subject::{Advanced, Subject, Watch};
use pliant::constraints::Distance;
use pliant::scene::Content;
use pliant::simulation::{
    LoadError, Scenario, ScenarioError, SceneDescription, Stepped, scenario, strain_at_vertices,
};

/// What a kind of scene adds to a running scenario.
pub(super) trait Kind: Default + Send + 'static {
    /// The scenario of this kind.
    type Run: Scenario + ?Sized;

    /// Whether bodies have a strain.
    const HAS_STRAIN: bool = true;

    /// The scenario of a scene; `None` for a scene of another kind.
    fn run_of(content: &Content) -> Result<Option<Box<Self::Run>>, LoadError>;

    /// Continues with the state of `before`, a run of the same scene with other numbers.
    fn continue_from(run: &mut Self::Run, before: &Self::Run) -> Result<(), ScenarioError>;

    /// Whether two runs have the same triangles.
    fn has_same_surface(_: &Self::Run, _: &Self::Run) -> bool {
        false
    }

    /// Whether no frame follows.
    fn is_finished(run: &Self::Run) -> bool {
        run.is_finished()
    }

    /// Material of a body, which decides on its colour.
    fn tissue(_body: usize) -> Tissue {
        Tissue::Plain
    }

    /// The controls; `start` is the run at the start of the session.
    fn controls(&self, _start: &Self::Run, _now: &Self::Run) -> Vec<Control> {
        Vec::new()
    }

    /// Forgets the changes by hand after a restart.
    fn restarted(&mut self) {}

    /// The values for plots.
    fn readings(&self, run: &Self::Run) -> Vec<Reading> {
        let measures = run.measures();
        let of = |name: &str| measures.iter().find(|(known, _)| *known == name);
        Content::all_measures()
            .filter_map(|(name, head, factor)| {
                let (_, value) = of(name)?;
                Some(reading(head, "", factor * value))
            })
            .collect()
    }

    /// Adds fields of bodies, handles and times.
    fn complete(&self, _run: &Self::Run, _shot: &mut Shot) {}

    /// Measures of a vertex besides stretch, speed and distance from rest.
    fn probe(&self, _at: &Point3<f64>) -> Vec<(&'static str, f64, &'static str)> {
        Vec::new()
    }

    /// Acts on the run before each frame.
    fn before_step(&mut self, _run: &mut Self::Run) {}

    /// The changed scene after [`Command::Set`], [`Command::Restore`] or [`Command::Move`].
    fn changed(
        &self,
        _run: &Self::Run,
        recipe: &Recipe,
        command: &Command,
    ) -> Result<Recipe, Refused> {
        changed(recipe, command)
    }

    /// Applies a command that drags, holds or releases a vertex.
    fn steer(&mut self, _run: &mut Self::Run, _command: &Command) -> Result<(), Refused> {
        Err(Refused::NotHere(
            "this kind of scene has no points to drag or to hold",
        ))
    }
}

/// The changed scene after a command, for a kind whose paths are those of its file.
pub(super) fn changed(recipe: &Recipe, command: &Command) -> Result<Recipe, Refused> {
    match command {
        Command::Set { path, value } => Ok(recipe.with(path, value)),
        Command::Restore { path } => Ok(recipe.without(path)),
        Command::Move { handle, .. } => {
            check_index("handle", *handle, 0)?;
            Ok(recipe.clone())
        }
        _ => Ok(recipe.clone()),
    }
}

/// A value of a run with a single body.
pub(super) fn reading(name: &'static str, unit: &'static str, value: f64) -> Reading {
    Reading {
        name,
        of: String::new(),
        unit,
        value,
    }
}

/// Scenes of kinds without controls of their own.
#[derive(Default)]
pub(super) struct Plain;

impl Kind for Plain {
    type Run = dyn Scenario;

    fn run_of(content: &Content) -> Result<Option<Box<dyn Scenario>>, LoadError> {
        scenario(content).map(Some)
    }

    fn continue_from(
        run: &mut (dyn Scenario + 'static),
        before: &(dyn Scenario + 'static),
    ) -> Result<(), ScenarioError> {
        run.continue_from(before)
    }
}

/// A running scene.
pub(super) struct Running<K: Kind> {
    recipe: Recipe,
    /// The run at the start of the session, for the ranges of sliders.
    start: Box<K::Run>,
    run: Box<K::Run>,
    kind: K,
    stage: Arc<Stage>,
    controls: Arc<Vec<Control>>,
    /// Edges with rest lengths of each body.
    edges: Vec<Vec<Distance>>,
    /// Positions of each body at rest [m].
    rest: Vec<Vec<Point3<f64>>>,
    probe: Option<(usize, usize)>,
}

impl<K: Kind> Running<K> {
    /// Makes the scene of a recipe ready to run.
    ///
    /// # Errors
    /// A scene that cannot run.
    pub(super) fn start(recipe: Recipe, content: &Content) -> Result<Box<dyn Subject>, StartError> {
        let (Some(start), Some(run)) = (K::run_of(content)?, K::run_of(content)?) else {
            return Running::<Plain>::start(recipe, content);
        };
        let mut running = Self {
            recipe,
            start,
            run,
            kind: K::default(),
            stage: Arc::default(),
            controls: Arc::default(),
            edges: Vec::new(),
            rest: Vec::new(),
            probe: None,
        };
        running.describe();
        Ok(Box::new(running))
    }

    /// Updates the constant data of a new surface.
    fn describe(&mut self) {
        let SceneDescription { bodies, bones, .. } = self.run.description();
        let mut stage = Stage {
            bodies: Vec::new(),
            bones,
        };
        (self.edges, self.rest) = (Vec::new(), Vec::new());
        for (b, body) in bodies.into_iter().enumerate() {
            let is_held = |v: &u32| body.attached.get(*v as usize) == Some(&1.0);
            stage.bodies.push(StageBody {
                name: body.name,
                tissue: K::tissue(b),
                held: (0..body.attached.len() as u32).filter(is_held).collect(),
                triangles: body.rest.triangles,
                edges: body.edges.iter().map(|e| e.points).collect(),
                fibres: body.fibres,
            });
            self.edges.push(body.edges);
            self.rest.push(body.rest.vertices);
        }
        let counts: Vec<usize> = self.rest.iter().map(Vec::len).collect();
        self.probe = self
            .probe
            .filter(|(body, v)| counts.get(*body).is_some_and(|count| v < count));
        self.stage = Arc::new(stage);
        self.show_controls();
    }

    fn show_controls(&mut self) {
        self.controls = Arc::new(self.kind.controls(&self.start, &self.run));
    }

    fn run_of(recipe: &Recipe) -> Result<Box<K::Run>, Refused> {
        let content = recipe.content().map_err(Refused::Scene)?;
        K::run_of(&content)
            .map_err(Refused::Load)?
            .ok_or(Refused::NotHere("this would be a scene of another kind"))
    }

    /// Continues with another scene, or restarts if that is not possible.
    fn change(&mut self, recipe: Recipe) -> Result<(), Refused> {
        let mut run = Self::run_of(&recipe)?;
        let continues = K::continue_from(&mut run, &self.run).is_ok();
        let is_same = K::has_same_surface(&self.run, &run);
        (self.recipe, self.run) = (recipe, run);
        if !continues {
            self.kind.restarted();
        }
        if is_same {
            self.show_controls();
        } else {
            self.describe();
        }
        Ok(())
    }

    fn bodies(&self) -> Vec<BodyShot> {
        let mut shots = Vec::new();
        for (b, (positions, velocities)) in self.run.bodies().into_iter().enumerate() {
            let is_moving = velocities.iter().any(|v| v.norm_squared() > 0.0);
            let stretch = match K::HAS_STRAIN {
                true => strain_at_vertices(&self.edges[b], &positions),
                false => Vec::new(),
            };
            let speeds = velocities.iter().map(|v| v.norm());
            shots.push(BodyShot {
                stretch,
                speed: speeds.filter(|_| is_moving).collect(),
                positions,
                ..BodyShot::default()
            });
        }
        shots
    }

    fn bones(&self) -> Vec<BoneShot> {
        let poses = self.run.poses(self.run.frame()).into_iter();
        let shot = |pose| BoneShot {
            pose,
            angle: None,
            steering: Steering::Motion,
        };
        poses.map(shot).collect()
    }

    fn probed(&self, body: usize, vertex: usize, bodies: &[BodyShot]) -> Probe {
        let shot = &bodies[body];
        let at = shot.positions[vertex];
        let mut values = Vec::new();
        if let Some(stretch) = shot.stretch.get(vertex) {
            values.push(("stretch", 100.0 * stretch, "%"));
        }
        if let Some(speed) = shot.speed.get(vertex) {
            values.push(("speed", 1e3 * speed, "mm/s"));
        }
        let moved = (at - self.rest[body][vertex]).norm();
        values.push(("from the start", 1e3 * moved, "mm"));
        values.extend(self.kind.probe(&at));
        Probe {
            body,
            vertex,
            values,
        }
    }

    fn check_vertex(&self, body: usize, vertex: usize) -> Result<(), Refused> {
        check_index("body", body, self.rest.len())?;
        check_index("vertex", vertex, self.rest[body].len())
    }
}

impl<K: Kind> Subject for Running<K> {
    fn frame_rate(&self) -> f64 {
        self.run.frame_rate()
    }

    fn shot(&mut self) -> Shot {
        let mut shot = Shot {
            frame: self.run.frame(),
            last_frame: self.run.frames(),
            stage: self.stage.clone(),
            scene: None,
            controls: self.controls.clone(),
            bodies: self.bodies(),
            bones: self.bones(),
            handles: Vec::new(),
            readings: self.kind.readings(&self.run),
            probe: None,
            effects: Vec::new(),
            notes: Vec::new(),
        };
        self.kind.complete(&self.run, &mut shot);
        shot.probe = self
            .probe
            .map(|(body, vertex)| self.probed(body, vertex, &shot.bodies));
        shot
    }

    fn advance(&mut self, watch: Watch<'_>) -> Advanced {
        if K::is_finished(&self.run) {
            return Advanced::Finished;
        }
        self.kind.before_step(&mut self.run);
        match self.run.step(&watch) {
            Stepped::Done => self.show_controls(),
            Stepped::Interrupted => return Advanced::Interrupted,
            Stepped::Failed(why) => return Advanced::Failed(why),
        }
        if K::is_finished(&self.run) {
            return Advanced::Finished;
        }
        Advanced::Running
    }

    fn apply(&mut self, command: &Command) -> Result<(), Refused> {
        match command {
            Command::Reset => {
                self.run = Self::run_of(&self.recipe)?;
                self.kind.restarted();
                self.describe();
            }
            Command::Set { .. } | Command::Restore { .. } | Command::Move { .. } => {
                return self.change(self.kind.changed(&self.run, &self.recipe, command)?);
            }
            Command::Drag { body, vertex, .. }
            | Command::Fix { body, vertex }
            | Command::Free { body, vertex } => {
                self.check_vertex(*body, *vertex)?;
                return self.kind.steer(&mut self.run, command);
            }
            Command::LetGo { body } => {
                check_index("body", *body, self.rest.len())?;
                // Nothing is dragged where nothing can be.
                let _ = self.kind.steer(&mut self.run, command);
            }
            Command::Probe(None) => self.probe = None,
            Command::Probe(Some((body, vertex))) => {
                self.check_vertex(*body, *vertex)?;
                self.probe = Some((*body, *vertex));
            }
            Command::Turn { bone, .. } | Command::Hold { bone } | Command::ByMotion { bone } => {
                check_index("bone", *bone, self.stage.bones.len())?;
                return Err(Refused::NotHere("the bones of this scene do not turn"));
            }
            Command::Seek { .. } | Command::Backwards(_) => {
                return Err(Refused::NotHere(super::ONLY_REPLAYED));
            }
            // The session handles these commands itself.
            Command::Pause | Command::Run | Command::Step | Command::Speed(_) => {}
        }
        Ok(())
    }
}
