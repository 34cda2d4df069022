//! A scene of any size: the scene scaled in length and mass gives the scaled result.
//!
//! Powers of two change no digit of a number, so that every bit of the result is the same. Other
//! factors change the last digits of each number.

use nalgebra::{Isometry3, Point3};
use pliant::scene::builtin::load;
use pliant::scene::{self, AreaSpec, Mass, Motion, Scene, Source};
use pliant::simulation::{Assets, Plan, Simulation};

use crate::tolerances::{T15, T24, worst};

/// Factors of length and mass.
#[derive(Clone, Copy)]
struct Units {
    length: f64,
    mass: f64,
}

impl Units {
    fn point(self, x: &mut Point3<f64>) {
        x.coords *= self.length;
    }

    fn pose(self, pose: &mut Isometry3<f64>) {
        pose.translation.vector *= self.length;
    }

    fn motion(self, motion: &mut Motion) {
        let Motion {
            keys,
            joint,
            linear: _,
        } = motion;
        keys.iter_mut().for_each(|key| self.pose(&mut key.pose));
        joint
            .iter_mut()
            .for_each(|joint| self.point(&mut joint.centre));
    }

    fn source(self, source: &mut Source) {
        match source {
            Source::File { scale, .. } | Source::Given { scale, .. } => *scale *= self.length,
            Source::Shape(_) => {}
        }
    }

    /// The scene in these units. Times and ratios remain.
    fn scene(self, scene: &Scene) -> Scene {
        let Self { length, mass } = self;
        let mut all = scene.clone();
        let Scene {
            bones,
            capsules,
            muscles,
            interfaces,
            effects,
            ..
        } = &mut all;
        for bone in bones {
            self.source(&mut bone.surface);
            self.motion(&mut bone.motion);
        }
        for capsule in capsules {
            capsule.segment.iter_mut().for_each(|end| self.point(end));
            capsule.radius *= length;
        }
        for muscle in muscles {
            let scene::Muscle {
                surface,
                edge_length,
                material,
                attachments,
                forces,
                displacements,
                ..
            } = muscle;
            self.source(surface);
            edge_length.iter_mut().for_each(|l| *l *= length);
            material.stretch *= mass;
            material.bending *= mass * length * length;
            material.bulk.iter_mut().for_each(|b| *b *= mass / length);
            match &mut material.mass {
                Mass::Density(density) => *density *= mass / length.powi(3),
                Mass::PerVertex(each) => *each *= mass,
            }
            for attachment in attachments {
                match &mut attachment.area {
                    AreaSpec::Near(within) | AreaSpec::Patch { within, .. } => *within *= length,
                    AreaSpec::Vertices(_) => {}
                }
            }
            forces.iter_mut().for_each(|f| f.vector *= mass * length);
            displacements.iter_mut().for_each(|d| d.vector *= length);
        }
        for bond in interfaces.iter_mut().filter_map(|i| i.bond.as_mut()) {
            bond.stiffness
                .iter_mut()
                .for_each(|k| *k *= mass / (length * length));
            bond.within.iter_mut().for_each(|l| *l *= length);
        }
        effects
            .contact
            .iter_mut()
            .for_each(|c| c.thickness *= length);
        effects.gravity.iter_mut().for_each(|g| *g *= length);
        effects.tone.iter_mut().for_each(|t| *t *= mass / length);
        all
    }

    /// The meshes in these units.
    fn assets(self, assets: &Assets) -> Assets {
        let mut all = assets.unprepared();
        let muscles = all.muscles.iter_mut().map(|m| &mut m.mesh);
        let patches = all.patches.iter_mut().flatten().flatten();
        let meshes = all.bones.iter_mut().chain(muscles).chain(patches);
        meshes
            .flat_map(|mesh| mesh.vertices.iter_mut())
            .for_each(|x| self.point(x));
        let fibres = all.muscles.iter_mut().flat_map(|m| m.fibres.iter_mut());
        fibres.flatten().for_each(|x| self.point(x));
        all
    }
}

/// Positions of all vertices after `frames`, in units of the scene as it is [m], and whether all
/// frames converged.
fn run(scene: &Scene, assets: &Assets, units: Units, frames: usize) -> (Vec<Point3<f64>>, bool) {
    let (scene, assets) = (units.scene(scene), units.assets(assets));
    let plan = Plan::new(&scene, &assets);
    let mut simulation = Simulation::with(scene, assets, plan).expect("a scene that runs");
    let mut converged = true;
    for _ in 0..frames {
        simulation.step_frame();
        converged &= simulation.measure().iter().all(|m| m.converged);
    }
    let bodies = simulation.bodies.iter();
    let all = bodies.flat_map(|body| body.system.particles.position.iter());
    (all.map(|x| x / units.length).collect(), converged)
}

/// Greatest distance of two results, relative to the size of the scene.
fn apart(a: &[Point3<f64>], b: &[Point3<f64>]) -> f64 {
    let size = worst(a.iter().map(|x| x.coords.norm()));
    worst(a.iter().zip(b).map(|(a, b)| (a - b).norm() / size))
}

const AS_IT_IS: Units = Units {
    length: 1.0,
    mass: 1.0,
};

/// The built-in scenes of muscles, with a number of frames each.
const SCENES: [(&str, usize); 7] = [
    ("cube", 40),
    ("distance", 40),
    ("volume", 40),
    ("shape", 40),
    ("chain", 40),
    ("press", 20),
    ("hip", 3),
];

/// Minima that are known only to the tolerance of their solver.
const MINIMA: [(&str, &str); 2] = [("distance", "quasi_static"), ("volume", "implicit_euler")];

/// Runs whose frames do not converge: rounding grows without bound in them.
const UNCONVERGED: [(&str, &str); 3] = [
    ("cube", "pbd"),
    ("cube", "quasi_static"),
    ("cube", "implicit_euler"),
];

/// The scene and its meshes under a solver that can solve it.
fn solvable(name: &str, solver: &str) -> Option<(Scene, Assets)> {
    let mut sets = vec![format!("solver={solver}")];
    if MINIMA.contains(&(name, solver)) {
        // The forces of T15.
        sets.push(format!("solver.{solver}.tolerance=1e-9"));
    }
    let scene = load(name, &sets).expect("a scene");
    let assets = Assets::load(&scene).expect("meshes");
    let plan = Plan::new(&scene, &assets);
    let is_solvable = Simulation::with(scene.clone(), assets.clone(), plan).is_ok();
    is_solvable.then_some((scene, assets))
}

#[test]
fn a_scene_in_other_units_has_the_same_result() {
    let mut compared = 0;
    for (name, frames) in SCENES {
        for solver in ["xpbd", "pbd", "quasi_static", "implicit_euler"] {
            let Some((scene, assets)) = solvable(name, solver) else {
                continue;
            };
            let (before, converged) = run(&scene, &assets, AS_IT_IS, frames);
            let other = |length, mass| run(&scene, &assets, Units { length, mass }, frames).0;
            for [length, mass] in [[-20, 0], [10, 30]].map(|of| of.map(|k| 2f64.powi(k))) {
                let same = before == other(length, mass);
                assert!(same, "{name} by {solver}: {length:e}, {mass:e}");
                compared += 1;
            }
            if UNCONVERGED.contains(&(name, solver)) {
                assert!(!converged, "{name} by {solver} converges");
                continue;
            }
            let is_known = MINIMA.contains(&(name, solver));
            let most = if is_known { T15 } else { T24 };
            for (length, mass) in [(1e-3, 1e-3), (1e3, 1e3)] {
                let off = apart(&before, &other(length, mass));
                assert!(
                    off <= most,
                    "{name} by {solver}: {length:e}, {mass:e}: {off:e}"
                );
            }
        }
    }
    assert_eq!(compared, 2 * 25);
}

#[test]
fn a_length_that_is_not_scaled_changes_the_result() {
    let (scene, assets) = solvable("press", "xpbd").expect("a scene");
    let large = Units {
        length: 1024.0,
        mass: 1.0,
    };
    let (before, _) = run(&scene, &assets, AS_IT_IS, 20);
    let (scaled, _) = run(&scene, &assets, large, 20);
    let mut fixed = scene.clone();
    let contact = fixed.effects.contact.iter_mut();
    // It is as thick in the large scene as in the scene as it is.
    contact.for_each(|contact| contact.thickness /= large.length);
    let (other, _) = run(&fixed, &assets, large, 20);
    assert!(before == scaled && !(apart(&before, &other) <= T24));
}
