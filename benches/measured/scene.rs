//! A muscle that lies on a bone which moves back and forth.

use std::hint::black_box;
use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Vector3};
use pliant::Particles;
use pliant::constraints::{Batch, EnclosedVolume, SweepOrder};
use pliant::contact::{Contacts, Obstacle, PosedObstacle, Surface};
use pliant::mesh::shapes::tube;
use pliant::mesh::{Topology, TriangleMesh};
use pliant::solvers::{StepSettings, System, stiffness};
use pliant::testing::internals::constraints::SimdWidth;

use super::volume_error;

const MILLIMETRE: f64 = 1e-3;
/// Contact thickness [m].
const THICKNESS: f64 = 0.2 * MILLIMETRE;
/// Depth at which settling ends at the end of a frame, as in a simulation [m].
const SETTLED: f64 = 2e-4 * THICKNESS;
/// Frames in which the fixed ends move down by a tenth of a millimetre each, so that the muscle
/// touches the bone.
pub const PRESSED: usize = 8;
/// Time of a frame [s].
const FRAME: f64 = 1.0 / 60.0;
/// A muscle that lies on a bone which moves back and forth by 1 mm per frame.
pub struct Scene {
    pub system: System,
    pub mesh: TriangleMesh,
    pub frames: [[PosedObstacle; 1]; 2],
    frame: usize,
}

impl Scene {
    /// A muscle of tube size `muscle` and a bone of `bone`: 88 and 81 for 9,946 vertices and 42,000 triangles.
    pub fn new(muscle: u32, bone: u32) -> Self {
        let surface = tube(0.02, 0.4, bone);
        let triangles = surface.triangles.len();
        assert!(
            bone != 81 || (41_000..43_500).contains(&triangles),
            "{triangles} triangles"
        );
        let mut mesh = tube(0.03, 0.24, muscle);
        // A tube with this number of corners lies slightly inside its radius.
        mesh.vertices.iter_mut().for_each(|p| p.y += 0.05);
        let count = mesh.vertices.len();
        let end = mesh.vertices.iter().map(|p| p.x).fold(0.0, f64::max);
        // The upper half of both ends.
        let held = |p: &Point3<f64>| p.x.abs() > 0.95 * end && p.y > 0.05;
        let inverse_mass = mesh
            .vertices
            .iter()
            .map(|p| if held(p) { 0.0 } else { count as f64 / 0.7 })
            .collect();
        let settings = StepSettings {
            iterations: 3,
            // As the bone, which leads it, the muscle goes a millimetre a frame: nothing swings on.
            gravity: Vector3::zeros(),
            velocity_factor: 0.5,
            force_factor: 1.0,
            speed_limit: f64::INFINITY,
        };
        let particles = Particles::at_rest(mesh.vertices.clone(), inverse_mass);
        let mut system = System::new(particles, settings);
        let topology = Topology::new(&mesh);
        let (edges, k) = stiffness::edges(&mesh, &topology, 300.0);
        let (hinges, b) = stiffness::hinges(&mesh, &topology, 2e-4);
        let coloured = SweepOrder::Coloured;
        system.elastic.push(Box::new(Batch::new(
            edges,
            stiffness::compliance(&k),
            coloured,
            count,
            &[],
        )));
        system.elastic.push(Box::new(Batch::new(
            hinges,
            stiffness::compliance(&b),
            coloured,
            count,
            &[],
        )));
        system.volume = Some(EnclosedVolume::new(
            &mesh.triangles,
            count,
            mesh.volume(),
            0.0,
        ));
        let obstacle: Arc<dyn Obstacle> = Arc::new(Surface::new(&surface));
        let at =
            |k: usize| Isometry3::translation(if k % 2 == 1 { MILLIMETRE } else { 0.0 }, 0.0, 0.0);
        let placed = |k: usize| {
            [PosedObstacle {
                name: "bone".into(),
                obstacle: obstacle.clone(),
                before: at(k),
                now: at(k + 1),
            }]
        };
        let frames = [placed(0), placed(1)];
        system.contacts = Some(Contacts::new(
            &mesh,
            &system.particles,
            &frames[0],
            vec![0],
            THICKNESS,
            0.0,
        ));
        Self {
            system,
            mesh,
            frames,
            frame: 0,
        }
    }

    /// With the number of lanes that `width` gives.
    #[must_use]
    pub fn with_width(mut self, width: SimdWidth) -> Self {
        self.system
            .elastic
            .iter_mut()
            .for_each(|batch| batch.set_width(width));
        self.system.volume = self
            .system
            .volume
            .take()
            .map(|volume| volume.with_width(width));
        self
    }

    /// A step of three sweeps, in which the bone moves by 1 mm.
    pub fn step(&mut self) {
        if self.frame < PRESSED {
            let Particles {
                position,
                inverse_mass,
                ..
            } = &mut self.system.particles;
            let held = position
                .iter_mut()
                .zip(inverse_mass)
                .filter(|(_, w)| **w == 0.0);
            held.for_each(|(p, _)| p.y -= 0.1 * MILLIMETRE);
        }
        let placed = &self.frames[self.frame % 2];
        self.system.step(black_box(placed), FRAME).expect("finite");
        self.frame += 1;
    }

    /// What a run does at the end of a frame: contact and volume until both hold.
    pub fn settle(&mut self) {
        self.system
            .settle(&self.frames[(self.frame + 1) % 2], SETTLED);
    }

    /// No vertex is in the bone, some touch it, and the volume is kept.
    pub fn check(&self) {
        let [placed] = &self.frames[(self.frame + 1) % 2];
        let x = &self.system.particles.position;
        assert!(self.system.particles.first_non_finite().is_none());
        let free = x
            .iter()
            .zip(&self.system.particles.inverse_mass)
            .filter(|(_, w)| **w > 0.0);
        let distances: Vec<f64> = free
            .map(|(p, _)| {
                placed
                    .obstacle
                    .closest(&placed.now.inverse_transform_point(p))
                    .expect("a surface")
                    .distance
            })
            .collect();
        let least = distances.iter().copied().fold(f64::INFINITY, f64::min);
        let touching = distances.iter().filter(|d| **d <= 1.1 * THICKNESS).count();
        assert!(least >= 0.0, "a vertex is {least:e} m in the bone");
        assert!(
            touching > 0,
            "nothing touches: the nearest is {least:e} m away"
        );
        let off = volume_error(&self.mesh, x);
        assert!(off.abs() <= 1e-9, "the volume is off by {off:e}");
        println!("{touching} of {} vertices touch the bone", x.len());
    }
}
