//! After a change, a simulation continues with the data prepared from the meshes before. No bit
//! differs from a simulation for which all data are prepared again.

use std::collections::BTreeSet;
use std::sync::Arc;

use pliant::scene::Scene;
use pliant::simulation::{Assets, Plan, Simulation};
use pliant_viewer::panel::{Control, Kind, Value, controls};
use pliant_viewer::{Command, Pace, Recipe, Session};

use super::{HIP, answer_to, computed, done, free_vertex, recipe, session, set, shown};

const SOLVERS: [&str; 4] = ["xpbd", "pbd", "quasi_static", "implicit_euler"];

/// Frames before and after each change: one with a fresh lookup, and one that uses its result.
const FRAMES: usize = 2;

/// A session, and simulations beside it for which all data are prepared again at each change.
struct Pair {
    session: Session,
    recipe: Recipe,
    assets: Assets,
    scene: Scene,
    anew: Simulation,
    fixed: Vec<u32>,
    /// Values to which paths return, where they differ from those at the start.
    base: Vec<(String, &'static str)>,
}

impl Pair {
    fn new(name: &str, overrides: &[&str]) -> Self {
        let (session, recipe) = (
            session(name, overrides, Pace::paused()),
            recipe(name, overrides),
        );
        let scene = recipe.scene().unwrap_or_else(|e| panic!("{}", e.terse()));
        let assets = Assets::load(&scene).unwrap_or_else(|e| panic!("{}", e.terse()));
        let anew = Simulation::new(scene.clone()).unwrap_or_else(|e| panic!("{}", e.terse()));
        Self {
            session,
            recipe,
            assets,
            scene,
            anew,
            fixed: Vec::new(),
            base: Vec::new(),
        }
    }

    fn frames(&mut self) {
        (0..FRAMES).for_each(|_| drop(done(&self.session, Command::Step)));
        (0..FRAMES).for_each(|_| self.anew.step_frame());
    }

    /// A simulation that continues with `scene` without earlier data; `None` where it cannot be
    /// created.
    fn going_on(&self, scene: &Scene) -> Option<Simulation> {
        let assets = self.assets.unprepared();
        let mut plan = Plan::new(scene, &assets);
        for (plan, body) in plan.muscles.iter_mut().zip(&self.anew.bodies) {
            plan.rest = Some(Arc::new(body.rest.clone()));
            plan.fixed.clone_from(&self.fixed);
        }
        let mut next = Simulation::with(scene.clone(), assets, plan).ok()?;
        next.continue_from(&self.anew);
        Some(next)
    }

    fn assert_same(&self, what: &str) {
        assert_eq!(
            shown(&self.session.latest()),
            computed(&self.anew),
            "{what}"
        );
    }

    /// Makes a change; `None` if it is rejected.
    fn turn(&mut self, command: Command, recipe: Recipe, what: &str) -> Option<()> {
        let before = self.session.latest().refused.clone();
        let is_refused = answer_to(&self.session, command).refused != before;
        let next = recipe
            .scene()
            .ok()
            .and_then(|scene| Some((self.going_on(&scene)?, scene)));
        assert_eq!(
            next.is_none(),
            is_refused,
            "{what}: {:?}",
            self.session.latest().refused
        );
        (self.anew, self.scene) = next?;
        self.recipe = recipe;
        self.assert_same(what);
        Some(())
    }

    /// Sets a path to a value and continues for some frames. Returns whether they differ from
    /// those without the change; `None` if the change is rejected.
    fn set(&mut self, path: &str, value: &str, what: &str) -> Option<bool> {
        let mut unchanged = self.going_on(&self.scene).expect("as it was");
        self.turn(set(path, value), self.recipe.with(path, value), what)?;
        self.frames();
        self.assert_same(what);
        (0..FRAMES).for_each(|_| unchanged.step_frame());
        Some(computed(&unchanged) != computed(&self.anew))
    }

    /// Restores the value at the start and returns to frame 0, because a change may have torn
    /// the muscle.
    fn restore(&mut self, path: &str, what: &str) {
        let (command, recipe) = match self.base.iter().find(|(known, _)| known == path) {
            Some((_, value)) => (set(path, value), self.recipe.with(path, value)),
            None => (
                Command::Restore {
                    path: path.to_owned(),
                },
                self.recipe.without(path),
            ),
        };
        self.turn(command, recipe, what)
            .unwrap_or_else(|| panic!("{what} was refused"));
        done(&self.session, Command::Reset);
        let assets = self.assets.unprepared();
        let plan = Plan::new(&self.scene, &assets);
        self.anew = Simulation::with(self.scene.clone(), assets, plan)
            .unwrap_or_else(|e| panic!("{}", e.terse()));
        self.assert_same(what);
        self.frames();
    }

    fn hold(&mut self, command: Command, fixed: Vec<u32>) {
        let what = format!("{command:?}");
        done(&self.session, command);
        self.fixed = fixed;
        self.anew = self.going_on(&self.scene.clone()).expect("as it was");
        self.frames();
        self.assert_same(&what);
    }
}

/// A value different from the current one, as text; `None` where the control is no value of the
/// scene.
fn another(control: &Control) -> Option<String> {
    let value = match &control.kind {
        Kind::Switch => Value::On(control.value == Value::On(false)),
        Kind::Choice(names) => Value::Choice(names.len() - 1 - usize::from(control.share() == 1.0)),
        // A small change, because otherwise muscles crumple and frames take seconds.
        _ if control.share() > 0.5 => control.at(control.share() - 0.2),
        _ => control.at(control.share() + 0.2),
    };
    match control.command(value).expect("in its range") {
        Command::Set { value, .. } => Some(value),
        _ => None,
    }
}

/// Moves every control and back, with each of the `solvers` that the scene can have. Returns
/// the names of the controls with an effect.
fn moved(name: &str, overrides: &[&str], solvers: &[&str]) -> BTreeSet<String> {
    let mut matters = BTreeSet::new();
    let mut pair = Pair::new(name, overrides);
    let start = pair.scene.clone();
    pair.frames();
    for solver in solvers {
        if pair.set("solver", solver, solver).is_none() {
            continue;
        }
        if solver.contains('_') {
            // Minimisations stop early, because their ends show nothing more.
            for (key, value) in [("iterations", "6"), ("substeps", "2")] {
                let path = format!("solver.{solver}.{key}");
                pair.set(&path, value, &path);
                pair.base.push((path, value));
            }
        }
        for control in controls(&start, &pair.scene.clone()) {
            let (Some(path), Some(value)) = (control.path(), another(&control)) else {
                continue;
            };
            // The loop sets the solver. An accuracy computes many frames before it shows one.
            if path == "solver" || path == "accuracy" {
                continue;
            }
            let what = format!(
                "{name}, {solver}: {}/{} to {value}",
                control.group, control.label
            );
            if let Some(matters_here) = pair.set(path, &value, &what) {
                pair.restore(path, &format!("{what} and back"));
                if matters_here {
                    matters.insert(control.label.clone());
                }
            }
        }
        let free = free_vertex(&pair.session);
        pair.hold(
            Command::Fix {
                body: 0,
                vertex: free,
            },
            vec![free as u32],
        );
        pair.hold(
            Command::Free {
                body: 0,
                vertex: free,
            },
            Vec::new(),
        );
    }
    let end = pair.session.latest();
    assert!(
        end.bodies.iter().all(|m| m.stopped.is_none()) && end.failed.is_none(),
        "{name}"
    );
    matters
}

fn assert_all(matters: &BTreeSet<String>, expected: &str) {
    let missing: Vec<&str> = expected
        .split(',')
        .map(str::trim)
        .filter(|label| !matters.contains(*label))
        .collect();
    assert!(
        missing.is_empty(),
        "these changed nothing, so that nothing was shown: {missing:?}; these did: {matters:?}"
    );
}

#[test]
fn a_change_has_the_bits_of_a_simulation_made_anew_in_a_press() {
    let closed = ["bone.0.motion.keys.0.translation=['0 mm','29 mm','0 mm']"];
    // Rough plates hold what touches them with any friction near theirs.
    let smooth = "effects.contact.friction=0.1";
    let coarse = ["muscle.0.edge_length=20 mm", "substeps=10", smooth];
    let coarse = [&closed[..], &coarse].concat();
    assert_all(
        &moved("press", &coarse, &SOLVERS[..2]),
        "stretch, thickness, friction, contact, pressure",
    );
}

#[test]
fn a_change_has_the_bits_of_a_simulation_made_anew_without_contact() {
    assert_all(
        &moved("distance", &[], &SOLVERS),
        "stretch, iterations, substeps",
    );
    assert_all(&moved("shape", &[], &SOLVERS), "bending");
    assert_all(&moved("volume", &[], &SOLVERS), "pressure");
}

#[test]
fn a_start_freed_of_overlap_keeps_its_shape_when_the_thickness_changes() {
    // The femur is turned into the muscle.
    let within = [&HIP[..], &["bone.1.motion.keys.0.angle=-0.1 rad"]].concat();
    let session = session("hip", &within, Pace::paused());
    let rest = |thickness: &str| {
        let scene = recipe("hip", &[&within[..], &[thickness]].concat())
            .scene()
            .unwrap_or_else(|e| panic!("{}", e.terse()));
        Simulation::new(scene)
            .unwrap_or_else(|e| panic!("{}", e.terse()))
            .bodies
            .remove(0)
            .rest
    };
    let [thin, thick] = [
        "effects.contact.thickness=0.5 mm",
        "effects.contact.thickness=2 mm",
    ]
    .map(rest);
    assert_ne!(thin, thick, "no overlap: the test would show nothing");
    done(&session, Command::Step);
    done(&session, set("effects.contact.thickness", "2 mm"));
    done(&session, Command::Reset);
    let start = session.latest();
    assert_eq!(
        start.bodies[0].positions, thick.vertices,
        "a reset starts anew"
    );
    done(&session, set("effects.contact.thickness", "0.5 mm"));
    assert_eq!(session.latest().bodies[0].positions, thick.vertices);
    done(&session, Command::Reset);
    assert_eq!(session.latest().bodies[0].positions, thin.vertices);
}

#[test]
fn what_is_known_of_contact_goes_on() {
    let overrides = [&HIP[..], &["effects.contact.friction=0.2"]].concat();
    let mut pair = Pair::new("hip", &overrides);
    pair.frames();
    let lookups = |simulation: &Simulation| {
        let body = &simulation.bodies[0];
        body.system
            .contacts
            .as_ref()
            .map_or(0, |c| c.counts(&body.system.particles.position).lookups)
    };
    let before = lookups(&pair.anew);
    let mut thicker = pair.scene.clone();
    let same = pair.going_on(&pair.scene).expect("as it was");
    assert_eq!(
        lookups(&same),
        before,
        "nothing changed, and something was looked up"
    );
    thicker
        .effects
        .contact
        .iter_mut()
        .for_each(|c| c.thickness *= 2.0);
    let thicker = pair.going_on(&thicker).expect("thicker");
    let fresh = lookups(&thicker) - before;
    let vertices = thicker.bodies[0].system.particles.len() as u64;
    assert!(
        fresh > 0 && fresh < vertices,
        "{fresh} of {vertices} vertices beside two bones were looked up"
    );
    // A replaced capsule or bone is looked up again.
    let mut moved = pair.scene.clone();
    moved.bones[1]
        .motion
        .keys
        .iter_mut()
        .for_each(|key| key.pose.translation.vector.x += 1e-4);
    assert!(
        lookups(&pair.going_on(&moved).expect("moved")) >= vertices,
        "the contacts of a bone that jumps are found again"
    );
}
