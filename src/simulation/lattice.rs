//! Simulation of a lattice: the top layer of a box of points with springs is displaced and
//! released.

use std::time::Instant;

use nalgebra::{Point3, Vector3};

use super::fault::{Fault, LoadError};
use super::plan::Plan;
use super::scenario::Stepped;
use crate::mesh::TriangleMesh;
use crate::mesh::measures::max_or_nan;
use crate::scene::content::LatticeScene;
use crate::springs::lattice::{
    Lattice, LatticeError, LatticeSettings, LatticeShape, largest_stiffness, stability_limit,
};

/// Length of a step relative to the stability limit.
const STABLE: f64 = 0.5;

/// Greatest number of steps per frame.
const MOST_STEPS: f64 = 1e5;

/// Greatest motion of a point in a frame at rest, relative to the spacing.
const STILL: f64 = 1e-3;

/// Measures of one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LatticeMeasures {
    /// Index of the frame.
    pub frame: usize,
    /// Greatest distance of a point from its start position [m].
    pub distance: f64,
    /// Greatest motion of a point in the frame [m].
    pub moved: f64,
    /// Wall time [s].
    pub time_s: f64,
}

/// A lattice simulation.
pub struct LatticeRun {
    /// The scene.
    pub scene: LatticeScene,
    /// The effects that run.
    pub plan: Plan,
    /// The lattice.
    pub lattice: Lattice<f64>,
    /// Number of steps per frame.
    pub steps: u32,
    /// Surface at the start [m].
    pub surface: TriangleMesh,
    /// Measures of every frame after the start.
    pub frames: Vec<LatticeMeasures>,
    /// The lattice point of each vertex of the surface.
    points: Vec<[usize; 3]>,
    now: Vec<[f64; 3]>,
}

impl LatticeRun {
    /// Creates the lattice with stable steps.
    ///
    /// # Errors
    /// Numbers that give no valid lattice.
    pub fn new(scene: LatticeScene) -> Result<Self, LoadError> {
        let refused = |error| {
            LoadError::at(
                &scene.origin,
                "lattice",
                "lattice".to_owned(),
                Fault::Lattice(error),
            )
        };
        let most = scene.points.iter().max().copied().unwrap_or(2);
        let spacing = scene.side / (most - 1) as f64;
        let shape = LatticeShape {
            points: scene.points,
            origin: [0.0; 3],
            spacing: [spacing; 3],
        };
        let mut settings = LatticeSettings {
            stiffness: scene.stiffness,
            mass: scene.mass,
            ..LatticeSettings::new(scene.neighbours)
        };
        let damping = scene.damping.of(settings.damping_estimate(&shape));
        let limit = stability_limit(largest_stiffness(&shape, &settings), scene.mass, damping);
        let frame = 1.0 / scene.frame_rate;
        let steps = (frame / (STABLE * limit)).ceil().max(1.0);
        if !(steps <= MOST_STEPS) {
            let (time_step, mass, stiffness) =
                (frame / MOST_STEPS, scene.mass, scene.stiffness.of(spacing));
            return Err(refused(LatticeError::Unstable {
                time_step,
                limit,
                mass,
                damping,
                stiffness,
            }));
        }
        (settings.damping, settings.time_step) = (Some(damping), Some(frame / steps));
        let mut lattice = Lattice::new(shape, settings).map_err(refused)?;
        shape
            .each()
            .filter(|p| p[2] == 0)
            .for_each(|p| lattice.pin(p));
        let (points, surface) = surface(&shape);
        let plan = Plan::of_lattice(&scene, &shape, steps as u32);
        let now = lattice.positions();
        Ok(Self {
            scene,
            plan,
            lattice,
            steps: steps as u32,
            surface,
            frames: Vec::new(),
            points,
            now,
        })
    }

    /// The last computed frame; 0 is the start.
    pub fn frame(&self) -> usize {
        self.frames.len()
    }

    /// True if the lattice was at rest in the last frame.
    pub fn at_rest(&self) -> bool {
        let spacing = self.lattice.shape().spacing[0];
        self.frames
            .last()
            .is_some_and(|f| f.moved <= STILL * spacing)
    }

    /// True if the top layer is displaced in a frame.
    fn drags(&self, frame: usize) -> bool {
        frame <= self.scene.release && self.scene.drag.norm() > 0.0
    }

    /// Computes the next frame.
    pub fn step(&mut self) -> Stepped {
        let (begun, frame) = (Instant::now(), self.frame() + 1);
        let top: Vec<[usize; 3]> = self
            .lattice
            .shape()
            .each()
            .filter(|p| p[2] + 1 == self.scene.points[2])
            .collect();
        if self.drags(frame) && frame == 1 {
            top.iter().for_each(|&p| self.lattice.pin(p));
        }
        for s in 1..=self.steps {
            if self.drags(frame) {
                let share = (f64::from(s) / f64::from(self.steps) + (frame - 1) as f64)
                    / self.scene.release as f64;
                self.drag(&top, self.scene.drag * share);
            }
            if let Err(error) = self.lattice.step() {
                return Stepped::Failed(format!("frame {frame}: {error}"));
            }
        }
        if self.drags(frame) && frame == self.scene.release {
            top.iter().for_each(|&p| self.lattice.release(p));
        }
        let (shape, now) = (*self.lattice.shape(), self.lattice.positions());
        let apart = |a: &[f64; 3], b: &[f64; 3]| (Vector3::from(*a) - Vector3::from(*b)).norm();
        let distance = max_or_nan(shape.each().zip(&now).map(|(p, x)| apart(x, &shape.at(p))));
        let moved = max_or_nan(self.now.iter().zip(&now).map(|(a, b)| apart(a, b)));
        self.now = now;
        self.frames.push(LatticeMeasures {
            frame,
            distance,
            moved,
            time_s: begun.elapsed().as_secs_f64(),
        });
        Stepped::Done
    }

    fn drag(&mut self, top: &[[usize; 3]], by: Vector3<f64>) {
        for &point in top {
            let at = Vector3::from(self.lattice.shape().at(point)) + by;
            self.lattice.place(point, at.into());
        }
    }

    /// Continues from the state of another run with the same points: positions, velocities and
    /// fixed points.
    pub fn continue_from(&mut self, before: &Self) {
        let (from, to) = (&before.lattice, &mut self.lattice);
        for point in from.shape().each() {
            let [x, last] =
                [from.position(point), from.previous_position(point)].map(Vector3::from);
            to.launch(point, x.into(), ((x - last) / from.time_step()).into());
            if from.is_pinned(point) {
                to.pin(point)
            } else {
                to.release(point)
            }
        }
        self.now.clone_from(&before.now);
        self.frames.clone_from(&before.frames);
    }

    /// The lattice point of a vertex of the surface.
    pub fn point_of(&self, vertex: usize) -> [usize; 3] {
        self.points[vertex]
    }

    /// The surface in the last frame [m].
    pub fn surface_at(&self) -> Vec<Point3<f64>> {
        self.points
            .iter()
            .map(|&p| Point3::from(self.lattice.position(p)))
            .collect()
    }
}

/// The points on the surface of a box, and the outward triangles between them.
fn surface(shape: &LatticeShape) -> (Vec<[usize; 3]>, TriangleMesh) {
    let mut numbers = std::collections::HashMap::new();
    let mut points: Vec<[usize; 3]> = Vec::new();
    let mut number = |p: [usize; 3]| {
        *numbers.entry(p).or_insert_with(|| {
            points.push(p);
            points.len() as u32 - 1
        })
    };
    let triangles = shape.faces().map(|corners| corners.map(&mut number));
    let triangles = triangles.collect();
    let vertices = points.iter().map(|&p| Point3::from(shape.at(p))).collect();
    (
        points,
        TriangleMesh {
            vertices,
            triangles,
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Topology;
    use crate::scene::builtin::load_content;
    use crate::scene::content::Content;

    #[test]
    fn the_surface_of_a_box_is_closed_and_looks_outward() {
        let shape = LatticeShape {
            points: [3, 4, 5],
            origin: [0.0; 3],
            spacing: [0.1, 0.2, 0.3],
        };
        let (points, mesh) = surface(&shape);
        let topology = Topology::new(&mesh);
        assert!(topology.is_closed() && topology.is_oriented());
        assert_eq!(points.len(), 3 * 4 * 5 - 2 * 3);
        assert!((mesh.volume() - 0.2 * 0.6 * 1.2).abs() <= 1e-15);
    }

    #[test]
    fn what_was_dragged_comes_back_and_six_neighbours_keep_no_shape() {
        let far = |more: &str| {
            let changes = [
                "lattice.points=[5,5,5]".to_owned(),
                "frames=90".to_owned(),
                more.to_owned(),
            ];
            let found = load_content("lattice", &changes).expect("a scene");
            let Content::Lattice(scene) = found else {
                panic!("a lattice")
            };
            let mut run = LatticeRun::new(*scene).expect("a lattice");
            while run.frame() < 90 {
                assert_eq!(run.step(), Stepped::Done);
            }
            (
                run.frames[29].distance,
                run.frames[89].distance,
                run.at_rest(),
            )
        };
        let (dragged, end, rests) = far("lattice.neighbours=26");
        // 30 and 10 mm.
        assert!((dragged - 1e-3f64.sqrt()).abs() <= 1e-9, "{dragged}");
        assert!(rests && end <= 1e-4, "{end} m from the start");
        let (_, end, _) = far("lattice.neighbours=6");
        assert!(!(end <= 1e-4), "control: {end} m");
    }
}
