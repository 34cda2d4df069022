//! A lattice in a session: displaced as in its scene and by hand.
//!
//! Other properties of springs and points keep its motion; another number of points restarts it.

use std::collections::BTreeSet;

use nalgebra::{Point3, Vector3};

use super::panel::{self, Control, List, Shown, Target, Value};
use super::recipe::{Refused, check_number};
use super::running::{Kind, reading};
use super::session::Command;
use super::snapshot::{Reading, Shot};
use pliant::scene::{Content, LatticeScene, SpringsDamping};
use pliant::simulation::{LatticeRun, LoadError, Scenario, ScenarioError};
use pliant::springs::Neighbours;
use pliant::springs::lattice::Stiffness;

/// Greatest motion of a dragged point per frame, relative to the spacing: inverted springs do not
/// recover.
const MOST_DRAG: f64 = 0.5;

/// The changes of a lattice by hand.
#[derive(Default)]
pub(super) struct Lattice {
    /// Fixed vertices of the surface.
    fixed: BTreeSet<usize>,
    /// The dragged vertex and its target [m].
    dragged: Option<(usize, Point3<f64>)>,
}

impl Lattice {
    fn drag(
        &mut self,
        run: &mut LatticeRun,
        vertex: usize,
        to: &Point3<f64>,
    ) -> Result<(), Refused> {
        to.iter()
            .try_for_each(|c| check_number("a coordinate of the place to drag to", *c, false))?;
        if self.dragged.is_none_or(|(known, _)| known != vertex) {
            self.let_go(run);
        }
        run.lattice.pin(run.point_of(vertex));
        self.dragged = Some((vertex, *to));
        Ok(())
    }

    fn let_go(&mut self, run: &mut LatticeRun) {
        let dragged = self.dragged.take();
        if let Some((vertex, _)) = dragged.filter(|(vertex, _)| !self.fixed.contains(vertex)) {
            run.lattice.release(run.point_of(vertex));
        }
    }
}

/// Checks that a vertex is in no fixed layer of the scene.
fn check_free(run: &LatticeRun, vertex: usize) -> Result<(), Refused> {
    let [.., layer] = run.point_of(vertex);
    let scene = &run.scene;
    if layer == 0 {
        return Err(Refused::NotHere(
            "the scene holds the lowest layer; choose a vertex above it",
        ));
    }
    let drags = scene.drag.norm() > 0.0 && run.frame() < scene.release;
    if layer + 1 == scene.points[2] && drags {
        return Err(Refused::NotHere(
            "the scene drags the highest layer and has not let it go yet; choose a vertex below",
        ));
    }
    Ok(())
}

fn velocity(run: &LatticeRun, point: [usize; 3]) -> Vector3<f64> {
    let lattice = &run.lattice;
    let moved =
        Vector3::from(lattice.position(point)) - Vector3::from(lattice.previous_position(point));
    moved / lattice.time_step()
}

/// Controls of springs and points; the start value is in the middle of the range.
fn controls(start: &LatticeScene, now: &LatticeScene) -> Vec<Control> {
    let mut list = List::default();
    let path = |key: &str| Target::Path(format!("lattice.{key}"));
    if let (Stiffness::Uniform(start), Stiffness::Uniform(now)) = (start.stiffness, now.stiffness) {
        let shown = Shown::about("N/m", start, 100.0, 1e3);
        list.slider("lattice", "stiffness", path("stiffness"), now, shown);
    }
    let shown = Shown::about("g", 1e3 * start.mass, 10.0, 10.0);
    list.slider(
        "lattice",
        "mass of a point",
        path("mass"),
        1e3 * now.mass,
        shown,
    );
    if let (SpringsDamping::Share(start), SpringsDamping::Share(now)) = (start.damping, now.damping)
    {
        let shown = Shown::even("", 0.0, (4.0 * start).clamp(2.0, 10.0));
        list.slider("lattice", "damping", path("damping"), now, shown);
    }
    let kinds = Neighbours::ALL.into_iter();
    let chosen = kinds.take_while(|kind| *kind != now.neighbours).count();
    list.other(
        "lattice",
        "neighbours",
        path("neighbours"),
        panel::Kind::Choice(vec!["6", "18", "26"]),
        Value::Choice(chosen),
    );
    list.0
}

impl Kind for Lattice {
    type Run = LatticeRun;

    fn run_of(content: &Content) -> Result<Option<Box<LatticeRun>>, LoadError> {
        match content {
            Content::Lattice(scene) if scene.rest.is_none() => {
                LatticeRun::new((**scene).clone()).map(|run| Some(Box::new(run)))
            }
            _ => Ok(None),
        }
    }

    fn continue_from(run: &mut LatticeRun, before: &LatticeRun) -> Result<(), ScenarioError> {
        Scenario::continue_from(run, before)
    }

    fn has_same_surface(before: &LatticeRun, now: &LatticeRun) -> bool {
        before.lattice.shape() == now.lattice.shape()
    }

    fn is_finished(_: &LatticeRun) -> bool {
        // A released lattice moves on after the last frame of its scene.
        false
    }

    fn controls(&self, start: &LatticeRun, now: &LatticeRun) -> Vec<Control> {
        controls(&start.scene, &now.scene)
    }

    fn restarted(&mut self) {
        *self = Self::default();
    }

    fn readings(&self, run: &LatticeRun) -> Vec<Reading> {
        let points = run.lattice.shape().each();
        let twice: f64 = points.map(|p| velocity(run, p).norm_squared()).sum();
        let last = run.frames.last();
        let distance = last.map_or(0.0, |f| 1e3 * f.distance);
        let moved = last.map_or(0.0, |f| 1e3 * f.moved);
        let energy = 0.5e3 * run.scene.mass * twice;
        vec![
            reading("Distance from the start", "mm", distance),
            reading("Motion in a frame", "mm", moved),
            reading("Kinetic energy", "mJ", energy),
        ]
    }

    fn complete(&self, run: &LatticeRun, shot: &mut Shot) {
        let body = &mut shot.bodies[0];
        let vertices = 0..body.positions.len();
        let speeds = vertices.map(|v| velocity(run, run.point_of(v)).norm());
        body.speed = speeds.collect();
        body.fixed = self.fixed.iter().map(|v| *v as u32).collect();
        body.dragged = self.dragged.map(|(vertex, to)| (vertex as u32, to));
        let ms = run.frames.last().map_or(0.0, |f| 1e3 * f.time_s);
        shot.effects.push(("springs", ms));
    }

    /// Moves dragged points and holds fixed ones: the scene's release of its top layer releases all
    /// of its points.
    fn before_step(&mut self, run: &mut LatticeRun) {
        let most = MOST_DRAG * run.lattice.shape().spacing[0];
        if let Some((vertex, to)) = self.dragged {
            let point = run.point_of(vertex);
            let from = Point3::from(run.lattice.position(point));
            let offset = to - from;
            let share = if offset.norm() > most {
                most / offset.norm()
            } else {
                1.0
            };
            run.lattice.place(point, (from + offset * share).into());
        }
        let dragged = self.dragged.map(|(vertex, _)| vertex);
        for vertex in self.fixed.iter().copied().chain(dragged) {
            run.lattice.pin(run.point_of(vertex));
        }
    }

    fn steer(&mut self, run: &mut LatticeRun, command: &Command) -> Result<(), Refused> {
        match command {
            Command::Drag { vertex, to, .. } => {
                check_free(run, *vertex)?;
                self.drag(run, *vertex, to)?;
            }
            Command::Fix { vertex, .. } => {
                check_free(run, *vertex)?;
                self.fixed.insert(*vertex);
                run.lattice.pin(run.point_of(*vertex));
            }
            Command::Free { vertex, .. } => {
                check_free(run, *vertex)?;
                let is_dragged = self.dragged.is_some_and(|(dragged, _)| dragged == *vertex);
                if self.fixed.remove(vertex) && !is_dragged {
                    run.lattice.release(run.point_of(*vertex));
                }
            }
            Command::LetGo { .. } => self.let_go(run),
            _ => {}
        }
        Ok(())
    }
}
