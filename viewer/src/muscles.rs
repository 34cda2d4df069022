//! Muscles among bones in a session: interactive changes between frames.

mod shots;

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use nalgebra::{Isometry3, Point3};

use super::panel::{self, Control};
use super::recipe::{Recipe, Refused, StartError, check_index, check_number, words};
use super::session::Command;
use super::snapshot::{Shot, Stage, Steering};
use super::subject::{Advanced, Subject, Watch};
use pliant::scene::{Key, Motion, Scene};
use pliant::simulation::{Assets, Plan, Simulation};
use shots::seconds;

/// Greatest rotation of a bone by hand per frame [rad]: about three times the speed of the built-in
/// hip. Bones that jump tear muscles.
pub const MOST_TURN: f64 = 0.03;

/// Stiffness of the drag spring, relative to that of the muscle's surface.
const DRAG: f64 = 3.0;

/// A bone that is rotated by hand.
#[derive(Clone, Copy, Debug)]
struct Hand {
    /// The present angle and the target angle [rad].
    angle: f64,
    target: f64,
    /// The motion of the bone without this rotation: pose = turn(angle) offset.
    offset: Isometry3<f64>,
}

/// A scene of muscles in a session.
pub(super) struct Muscles {
    recipe: Recipe,
    /// The scene at the start and at present.
    start: Scene,
    scene: Arc<Scene>,
    stage: Arc<Stage>,
    controls: Arc<Vec<Control>>,
    assets: Assets,
    simulation: Simulation,
    step: fn(&mut Simulation),
    steering: Vec<Steering>,
    hands: Vec<Option<Hand>>,
    fixed: Vec<Vec<u32>>,
    drags: Vec<Option<(u32, Point3<f64>, f64)>>,
    probe: Option<(usize, usize)>,
    /// Time of each effect up to the last frame [s], and in that frame [ms].
    clock: BTreeMap<&'static str, f64>,
    effects: Vec<(&'static str, f64)>,
}

impl Muscles {
    /// Reads the meshes of `scene` and prepares it; `step` computes each frame.
    pub(super) fn new(
        recipe: Recipe,
        scene: Scene,
        step: fn(&mut Simulation),
    ) -> Result<Self, StartError> {
        let assets = Assets::load(&scene)?;
        let plan = Plan::new(&scene, &assets);
        let simulation = Simulation::with(scene.clone(), assets.clone(), plan)?;
        Ok(Self {
            steering: vec![Steering::Motion; scene.bones.len()],
            hands: vec![None; scene.bones.len()],
            fixed: vec![Vec::new(); scene.muscles.len()],
            drags: vec![None; scene.muscles.len()],
            probe: None,
            stage: Arc::new(shots::stage(&simulation)),
            controls: Arc::new(panel::controls(&scene, &scene)),
            start: scene.clone(),
            scene: Arc::new(scene),
            recipe,
            assets,
            simulation,
            step,
            clock: BTreeMap::new(),
            effects: Vec::new(),
        })
    }

    fn vertex(&self, muscle: usize, vertex: usize) -> Result<u32, Refused> {
        check_index("muscle", muscle, self.simulation.bodies.len())?;
        check_index(
            "vertex",
            vertex,
            self.simulation.bodies[muscle].system.particles.len(),
        )?;
        Ok(vertex as u32)
    }

    fn reset(&mut self) -> Result<(), Refused> {
        let none = vec![Vec::new(); self.fixed.len()];
        self.simulation = self.simulation_of(&self.scene, &none, false)?;
        self.fixed = none;
        self.drags.fill(None);
        self.hands.fill(None);
        self.steering.fill(Steering::Motion);
        self.forget_times();
        self.effects.clear();
        Ok(())
    }

    fn forget_times(&mut self) {
        self.clock = seconds(&self.simulation);
    }

    /// A simulation of a scene with the present meshes, at its start; with `keeps_rest` the muscles
    /// keep their rest shapes.
    fn simulation_of(
        &self,
        scene: &Scene,
        fixed: &[Vec<u32>],
        keeps_rest: bool,
    ) -> Result<Simulation, Refused> {
        let mut plan = Plan::new(scene, &self.assets);
        plan.muscles
            .iter_mut()
            .zip(fixed)
            .for_each(|(plan, fixed)| plan.fixed.clone_from(fixed));
        if keeps_rest {
            let rests = self
                .simulation
                .bodies
                .iter()
                .map(|body| Some(Arc::new(body.rest.clone())));
            plan.muscles
                .iter_mut()
                .zip(rests)
                .for_each(|(plan, rest)| plan.rest = rest);
        }
        Simulation::with(scene.clone(), self.assets.clone(), plan).map_err(Refused::Load)
    }

    /// Continues with other numbers.
    fn change(&mut self, path: &str, recipe: Recipe) -> Result<(), Refused> {
        let scene = recipe.checked(path, &self.scene, &self.assets)?;
        self.continue_as(&scene, self.fixed.clone())?;
        self.controls = Arc::new(panel::controls(&self.start, &scene));
        (self.recipe, self.scene) = (recipe, Arc::new(scene));
        Ok(())
    }

    /// Continues with other fixed vertices.
    fn hold(&mut self, fixed: Vec<Vec<u32>>) -> Result<(), Refused> {
        let scene = self.scene.clone();
        self.continue_as(&scene, fixed)
    }

    fn continue_as(&mut self, scene: &Scene, fixed: Vec<Vec<u32>>) -> Result<(), Refused> {
        let mut simulation = self.simulation_of(scene, &fixed, true)?;
        for (bone, steering) in self.steering.iter().enumerate() {
            if *steering != Steering::Motion {
                let pose = self.simulation.pose(bone, self.simulation.frame() as f64);
                let joint = simulation.scene.bones[bone].motion.joint.take();
                let key = Key {
                    frame: self.simulation.frame() as f64,
                    pose,
                };
                simulation.scene.bones[bone].motion = Motion {
                    keys: vec![key],
                    joint,
                    linear: true,
                };
            }
        }
        // After the bones: contact state is only valid at their poses.
        simulation.continue_from(&self.simulation);
        for (muscle, drag) in self.drags.iter().enumerate() {
            if let Some((vertex, to, stiffness)) = *drag {
                simulation.drag(muscle, vertex, to, stiffness);
            }
        }
        self.simulation = simulation;
        self.fixed = fixed;
        self.forget_times();
        Ok(())
    }

    fn drag(
        &mut self,
        muscle: usize,
        vertex: usize,
        to: Point3<f64>,
        stiffness: Option<f64>,
    ) -> Result<(), Refused> {
        let v = self.vertex(muscle, vertex)?;
        let body = &self.simulation.bodies[muscle];
        if body.attached.iter().any(|(held, _)| *held == v) {
            return Err(Refused::Held { vertex });
        }
        to.iter()
            .try_for_each(|c| check_number("a coordinate of the place to drag to", *c, false))?;
        // A surface without stiffness is dragged by its weight in a second.
        let surface = match self.scene.muscles[muscle].material.stretch {
            stretch if stretch > 0.0 => DRAG * stretch,
            _ => DRAG / body.system.particles.inverse_mass[vertex].max(f64::MIN_POSITIVE),
        };
        let stiffness = stiffness.unwrap_or(surface);
        check_number("the stiffness of the spring", stiffness, true)?;
        self.drags[muscle] = Some((v, to, stiffness));
        self.simulation.drag(muscle, v, to, stiffness);
        Ok(())
    }

    fn fix(&mut self, muscle: usize, vertex: usize) -> Result<(), Refused> {
        let v = self.vertex(muscle, vertex)?;
        if self.simulation.bodies[muscle]
            .attached
            .iter()
            .any(|(held, _)| *held == v)
        {
            return Err(Refused::Held { vertex });
        }
        let mut fixed = self.fixed.clone();
        if !fixed[muscle].contains(&v) {
            fixed[muscle].push(v);
        }
        self.hold(fixed)
    }

    fn turn(&mut self, bone: usize, target: f64) -> Result<(), Refused> {
        check_index("bone", bone, self.hands.len())?;
        check_number("an angle", target, false)?;
        let frame = self.simulation.frame() as f64;
        let pose = self.simulation.pose(bone, frame);
        let scene = &self.scene.bones[bone];
        let Some(joint) = &scene.motion.joint else {
            return Err(Refused::NoJoint {
                bone: scene.name.clone(),
            });
        };
        match &mut self.hands[bone] {
            Some(hand) => hand.target = target,
            none => {
                let angle = joint.angle_of(&pose);
                *none = Some(Hand {
                    angle,
                    target,
                    offset: joint.pose(angle).inverse() * pose,
                });
                self.steering[bone] = Steering::Hand;
                self.simulation.move_bone(bone, pose);
            }
        }
        Ok(())
    }

    /// Rotates bones by hand; other bones keep their motion to the bit.
    fn steer_bones(&mut self) {
        let frame = self.simulation.frame() as f64;
        for bone in 0..self.steering.len() {
            let motion = &self.scene.bones[bone].motion;
            match (self.steering[bone], &mut self.hands[bone], &motion.joint) {
                (Steering::Hand, Some(hand), Some(joint)) if hand.angle != hand.target => {
                    let left = hand.target - hand.angle;
                    hand.angle = if left.abs() <= MOST_TURN {
                        hand.target
                    } else {
                        hand.angle + MOST_TURN.copysign(left)
                    };
                    self.simulation
                        .move_bone(bone, joint.pose(hand.angle) * hand.offset);
                }
                (Steering::Return, ..) => {
                    let (now, there) =
                        (self.simulation.pose(bone, frame), motion.pose(frame + 1.0));
                    if now == motion.pose(frame) {
                        self.steering[bone] = Steering::Motion;
                        self.simulation.scene.bones[bone].motion = motion.clone();
                        continue;
                    }
                    let turn = (now.inverse() * there).rotation.angle();
                    let keys = vec![
                        Key {
                            frame: 0.0,
                            pose: now,
                        },
                        Key {
                            frame: 1.0,
                            pose: there,
                        },
                    ];
                    let share = if turn > MOST_TURN {
                        MOST_TURN / turn
                    } else {
                        1.0
                    };
                    let way = Motion {
                        keys,
                        joint: None,
                        linear: true,
                    };
                    self.simulation.move_bone(bone, way.pose(share));
                }
                _ => {}
            }
        }
    }
}

impl Subject for Muscles {
    fn frame_rate(&self) -> f64 {
        self.scene.frame_rate
    }

    fn shot(&mut self) -> Shot {
        self.seen()
    }

    fn advance(&mut self, _: Watch<'_>) -> Advanced {
        self.steer_bones();
        let (step, frame, simulation) =
            (self.step, self.simulation.frame() + 1, &mut self.simulation);
        if let Err(panic) = catch_unwind(AssertUnwindSafe(|| step(simulation))) {
            return Advanced::Failed(format!(
                "frame {frame}: the simulation panicked: {}",
                words(&*panic)
            ));
        }
        let now = seconds(&self.simulation);
        let spent = |(name, s): (&&'static str, &f64)| {
            (*name, (s - self.clock.get(name).unwrap_or(&0.0)) * 1e3)
        };
        self.effects = now.iter().map(spent).collect();
        self.clock = now;
        let all_stopped = self
            .simulation
            .bodies
            .iter()
            .all(|body| body.stopped.is_some());
        if all_stopped {
            Advanced::Finished
        } else {
            Advanced::Running
        }
    }

    fn apply(&mut self, command: &Command) -> Result<(), Refused> {
        match command {
            Command::Reset => return self.reset(),
            Command::Set { path, value } => {
                return self.change(path, self.recipe.with(path, value));
            }
            Command::Restore { path } => return self.change(path, self.recipe.without(path)),
            Command::Turn { bone, angle } => return self.turn(*bone, *angle),
            Command::Hold { bone } => {
                check_index("bone", *bone, self.hands.len())?;
                let pose = self.simulation.pose(*bone, self.simulation.frame() as f64);
                let now = self.scene.bones[*bone]
                    .motion
                    .joint
                    .as_ref()
                    .map_or(0.0, |joint| joint.angle_of(&pose));
                return self.turn(*bone, now);
            }
            Command::ByMotion { bone } => {
                check_index("bone", *bone, self.hands.len())?;
                if self.hands[*bone].take().is_some() {
                    self.steering[*bone] = Steering::Return;
                }
            }
            Command::Drag {
                body,
                vertex,
                to,
                stiffness,
            } => return self.drag(*body, *vertex, *to, *stiffness),
            Command::LetGo { body } => {
                check_index("muscle", *body, self.drags.len())?;
                self.drags[*body] = None;
                self.simulation.let_go(*body);
            }
            Command::Fix { body, vertex } => return self.fix(*body, *vertex),
            Command::Free { body, vertex } => {
                self.vertex(*body, *vertex)?;
                let mut fixed = self.fixed.clone();
                fixed[*body].retain(|v| *v as usize != *vertex);
                return self.hold(fixed);
            }
            Command::Probe(None) => self.probe = None,
            Command::Probe(Some((body, vertex))) => {
                self.vertex(*body, *vertex)?;
                self.probe = Some((*body, *vertex));
            }
            Command::Move { handle, .. } => check_index("handle", *handle, 0)?,
            Command::Seek { .. } | Command::Backwards(_) => {
                return Err(Refused::NotHere(super::ONLY_REPLAYED));
            }
            // The session handles these commands itself.
            Command::Pause | Command::Run | Command::Step | Command::Speed(_) => {}
        }
        Ok(())
    }
}
