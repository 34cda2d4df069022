//! The plan of a scene without muscles.

use super::{LeftOut, Plan, Planned};
use crate::mesh::TriangleMesh;
use crate::scene::content::{LatticeScene, SkinScene, Support};
use crate::simulation::skin::SkinPart;
use crate::springs::lattice::LatticeShape;

/// Time of a skin spring in an equilibrium over an implant and over a ball [ms], all included, as
/// measured on the built-in scenes with two cores; for estimates only.
const MS_OF_SKIN: f64 = 0.1;
const MS_OVER_BALL: f64 = 0.012;

/// Time of a lattice point per step [ns].
const NS_OF_LATTICE: f64 = 100.0;

/// Size of a spring with its stiffness, and of a vertex with possible contact [bytes].
const SPRING: usize = 32;
const TOUCH: usize = 120;

impl Plan {
    /// The plan of a skin scene.
    pub fn of_skin(scene: &SkinScene, parts: &[SkinPart], obstacles: &[TriangleMesh]) -> Self {
        let mut plan = Self::default();
        for part in parts {
            plan.add_part(scene, part, obstacles);
        }
        for (effect, why) in [
            ("growth", "estimated from published ratios, not simulated"),
            (
                "bending",
                "two layers resist it; it has no stiffness of its own",
            ),
            ("friction", "contact of skin is without friction"),
            ("gravity", "nothing in a scene of skin has weight"),
            ("damping", "an equilibrium has no velocities"),
        ] {
            plan.leave("", effect, why);
        }
        plan
    }

    fn add_part(&mut self, scene: &SkinScene, part: &SkinPart, obstacles: &[TriangleMesh]) {
        let layers = &part.ready.layers;
        let free = layers.held.iter().filter(|held| !**held).count() / 2;
        let mut run = |effect: &str, elements: usize, bytes: usize, ms_per_frame: f64| {
            let (muscle, effect) = (part.name.clone(), effect.to_owned());
            self.run.push(Planned {
                muscle,
                effect,
                elements,
                bytes,
                ms_per_frame,
            });
        };
        let springs = layers.springs.len();
        let over_ball = matches!(scene.under, Support::Ball(_));
        let ms = springs as f64 * if over_ball { MS_OVER_BALL } else { MS_OF_SKIN };
        run("two layers of skin", springs, springs * SPRING, ms);
        if over_ball {
            run("contact with the ball", free, free * TOUCH, 0.0);
            return;
        }
        let vertices: usize = part.shells.iter().map(|shell| shell.vertices.len()).sum();
        let triangles: usize = part.shells.iter().map(|shell| shell.triangles.len()).sum();
        let (shell, volume, contact) = match part.shells.len() {
            1 => (
                "shell of the implant",
                "volume of the implant",
                "contact of skin and implant",
            ),
            _ => (
                "shells of implants",
                "volumes of implants",
                "contact of skin and implants",
            ),
        };
        run(shell, triangles, triangles * 2 * SPRING, 0.0);
        run(volume, vertices, vertices * 52 + triangles * 36, 0.0);
        run(contact, free + vertices, (free + vertices) * TOUCH, 0.0);
        if part.obstacles.is_empty() {
            run(
                "contact with what was under the skin",
                free + vertices,
                (free + vertices) * TOUCH,
                0.0,
            );
        }
        for &o in &part.obstacles {
            let elements = free + vertices + obstacles[o].vertices.len();
            let effect = format!("contact with {}", scene.obstacles[o].name);
            run(
                &effect,
                elements,
                (free + vertices) * TOUCH + obstacles[o].triangles.len() * 60,
                0.0,
            );
        }
        for o in (0..obstacles.len()).filter(|o| !part.obstacles.contains(o)) {
            let effect = format!("contact with {}", scene.obstacles[o].name);
            self.leave(
                &part.name,
                &effect,
                "it is further from the implant than two of its bases",
            );
        }
    }

    /// The plan of a lattice scene with `steps` steps per frame.
    pub fn of_lattice(scene: &LatticeScene, shape: &LatticeShape, steps: u32) -> Self {
        let (springs, points) = (scene.neighbours.springs(scene.points), shape.count());
        let top = scene.points[0] * scene.points[1];
        let mut plan = Self::default();
        let mut run = |effect: &str, elements: usize, bytes: usize, ms_per_frame: f64| {
            let (muscle, effect) = (scene.name.clone(), effect.to_owned());
            plan.run.push(Planned {
                muscle,
                effect,
                elements,
                bytes,
                ms_per_frame,
            });
        };
        run(
            "springs",
            springs,
            points * 48,
            points as f64 * NS_OF_LATTICE * f64::from(steps) * 1e-6,
        );
        if scene.drag.norm() > 0.0 {
            run("drag of the highest layer", top, 0, 0.0);
        }
        let mut leave = |effect: &str, why: &str| {
            plan.left_out.push(LeftOut {
                muscle: String::new(),
                effect: effect.to_owned(),
                why: why.to_owned(),
            });
        };
        if !(scene.drag.norm() > 0.0) {
            leave("drag", "the scene has no `drag`, or one of length zero");
        }
        for effect in ["bending", "volume", "contact", "gravity"] {
            leave(effect, "a lattice has springs and damping alone");
        }
        plan
    }
}
