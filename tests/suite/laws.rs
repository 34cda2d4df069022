//! Laws of physics for whole scenes, from their text to the positions of a frame, under every
//! solver that can obey them. The oracles compute masses, stiffness and areas on their own. Each law
//! has a wrong law as its control.

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use pliant::mesh::measures::{max_or_nan, volume};
use pliant::mesh::shapes::{box_surface, icosphere};
use pliant::scene::{Key, SceneBuilder};
use pliant::{Scene, Simulation, TriangleMesh};

use crate::tolerances::{T25, T26};

/// Frames a second [1/s].
const RATE: f64 = 60.0;
/// Density [kg/m^3].
const DENSITY: f64 = 1060.0;

fn started(scene: &SceneBuilder) -> Simulation {
    let scene = scene.build().unwrap_or_else(|e| panic!("{}", e.terse()));
    Simulation::new(scene).unwrap_or_else(|e| panic!("{}", e.terse()))
}

fn frame(simulation: &mut Simulation) {
    simulation.step_frame();
    assert_eq!(simulation.bodies[0].stopped, None);
}

fn positions(simulation: &Simulation) -> &[Point3<f64>] {
    &simulation.bodies[0].system.particles.position
}

/// A box that holds what lies on its upper side, at z = -0.5 mm.
fn slab() -> TriangleMesh {
    let mut slab = box_surface([0.3, 0.3, 0.02], 0.1);
    slab.vertices.iter_mut().for_each(|p| p.z -= 0.0105);
    slab
}

fn set_all(scene: SceneBuilder, keys: &[(&str, &str)]) -> SceneBuilder {
    keys.iter()
        .fold(scene, |scene, (key, value)| scene.set(key, value))
}

/// The areas of the triangles of a mesh [m^2].
fn areas(mesh: &TriangleMesh) -> Vec<f64> {
    let area = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| mesh.vertices[v as usize]);
        0.5 * (b - a).cross(&(c - a)).norm()
    };
    mesh.triangles.iter().map(area).collect()
}

/// The masses of the vertices [kg]: shares of the surface's area in the mass of what it encloses.
fn masses(mesh: &TriangleMesh) -> Vec<f64> {
    let areas = areas(mesh);
    let total: f64 = areas.iter().sum();
    let mass = DENSITY * volume(&mesh.vertices, &mesh.triangles);
    let mut masses = vec![0.0; mesh.vertices.len()];
    for (triangle, area) in mesh.triangles.iter().zip(&areas) {
        for &v in triangle {
            masses[v as usize] += mass * area / (3.0 * total);
        }
    }
    masses
}

/// An edge as a spring.
struct Spring {
    ends: [usize; 2],
    length: f64,
    /// Stiffness [N/m].
    stiffness: f64,
}

impl Spring {
    /// The force on the first end [N], and its derivative by that end's position [N/m].
    fn pull(&self, x: &[Point3<f64>]) -> (Vector3<f64>, Matrix3<f64>) {
        let [a, b] = self.ends;
        let d = x[b] - x[a];
        let now = d.norm();
        let u = d / now;
        let along = u * u.transpose();
        let ratio = 1.0 - self.length / now;
        let tangent = along + ratio * (Matrix3::identity() - along);
        (
            u * (self.stiffness * (now - self.length)),
            tangent * -self.stiffness,
        )
    }
}

/// The edges of a surface that resists stretch [N/m] in its plane: those at each vertex.
fn springs(mesh: &TriangleMesh, stretch: f64) -> Vec<Vec<Spring>> {
    let mut at = Vec::new();
    at.resize_with(mesh.vertices.len(), Vec::new);
    for (triangle, area) in mesh.triangles.iter().zip(areas(mesh)) {
        for k in 0..3 {
            let ends = [triangle[k], triangle[(k + 1) % 3]].map(|v| v as usize);
            let length = (mesh.vertices[ends[0]] - mesh.vertices[ends[1]]).norm();
            // Each of the two triangles of an edge adds its share.
            let stiffness = stretch * area / length.powi(2);
            for ends in [ends, [ends[1], ends[0]]] {
                let spring = Spring {
                    ends,
                    length,
                    stiffness,
                };
                let list: &mut Vec<Spring> = &mut at[ends[0]];
                list.push(spring);
            }
        }
    }
    at
}

/// The force of springs on the end that they share [N], and its derivative.
fn pull(springs: &[Spring], x: &[Point3<f64>]) -> (Vector3<f64>, Matrix3<f64>) {
    let zero = (Vector3::zeros(), Matrix3::zeros());
    springs
        .iter()
        .map(|s| s.pull(x))
        .fold(zero, |all, one| (all.0 + one.0, all.1 + one.1))
}

/// A tetrahedron that stands on the slab; its highest vertex is free.
fn standing() -> TriangleMesh {
    TriangleMesh {
        vertices: vec![
            Point3::origin(),
            Point3::new(0.05, 0.0, 0.0),
            Point3::new(0.0, 0.04, 0.0),
            Point3::new(0.01, 0.012, 0.05),
        ],
        triangles: vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]],
    }
}

const APEX: usize = 3;
const SOFT: f64 = 30.0;
/// A weight that moves the apex by about a hundredth of an edge [m/s^2].
const AWAY: [f64; 3] = [0.6, -0.3, -0.9];

fn loaded(keys: &[(&str, &str)], [x, y, z]: [f64; 3]) -> Simulation {
    let scene = Scene::builder("apex", 600, RATE)
        .bone("slab", slab())
        .muscle("tetrahedron", standing())
        .attach("slab", 1e-3)
        .set("muscle.0.attachment.0.limit", "100 %")
        .set("muscle.0.material.density", &format!("{DENSITY} kg/m3"))
        .set("muscle.0.material.stretch", &format!("{SOFT} N/m"))
        .set("effects.stretch", "on")
        .set(
            "effects.gravity.acceleration",
            &format!("['{x} m/s2', '{y} m/s2', '{z} m/s2']"),
        );
    started(&set_all(scene, keys))
}

/// The solvers that come to rest, with their settings.
const TO_REST: [(&str, &[(&str, &str)]); 3] = [
    (
        "xpbd",
        &[
            ("solver.xpbd.substeps", "200"),
            ("effects.damping.rate", "20 1/s"),
        ],
    ),
    (
        "quasi_static",
        &[
            ("solver", "quasi_static"),
            ("solver.quasi_static.tolerance", "1e-8"),
        ],
    ),
    (
        "implicit_euler",
        &[
            ("solver", "implicit_euler"),
            ("solver.implicit_euler.tolerance", "1e-8"),
            ("effects.damping.rate", "20 1/s"),
        ],
    ),
];

#[test]
fn a_weight_is_carried() {
    let mesh = standing();
    let (springs, masses) = (springs(&mesh, SOFT), masses(&mesh));
    for (solver, keys) in TO_REST {
        let mut simulation = loaded(keys, AWAY);
        (0..150).for_each(|_| frame(&mut simulation));
        let (force, _) = pull(&springs[APEX], positions(&simulation));
        let off = |mass: f64| (force + Vector3::from(AWAY) * mass).norm() / (mass * 1.1);
        let found = off(masses[APEX]);
        assert!(found <= T25, "{solver}: {found:e}");
        // Control: a quarter of the mass for each vertex.
        let even = off(masses.iter().sum::<f64>() / 4.0);
        assert!(even > 10.0 * T25, "{solver}: {even:e}");
    }
}

#[test]
fn a_swing_loses_what_implicit_euler_loses() {
    let mesh = standing();
    let (springs, masses) = (springs(&mesh, SOFT), masses(&mesh));
    let dt = 1.0 / RATE;
    // XPBD takes gradients at the start of a sweep: it obeys the law where directions change little.
    let pulled = AWAY.map(|a| 0.1 * a);
    for (solver, keys) in [
        (
            "xpbd",
            &[
                ("solver.xpbd.substeps", "1"),
                ("solver.xpbd.iterations", "400"),
            ][..],
        ),
        (
            "implicit_euler",
            &[
                ("solver", "implicit_euler"),
                ("solver.implicit_euler.substeps", "1"),
                ("solver.implicit_euler.tolerance", "1e-8"),
            ],
        ),
    ] {
        let mut simulation = loaded(keys, pulled);
        let mut x = mesh.vertices.clone();
        let mut v = Vector3::zeros();
        // Control: symplectic Euler, which loses nothing.
        let (mut y, mut w) = (mesh.vertices.clone(), Vector3::zeros());
        let (mut worst, mut control, mut widest) = (0.0, 0.0, 0.0);
        for _ in 0..60 {
            frame(&mut simulation);
            let from = x[APEX];
            let predicted = from + (v + Vector3::from(pulled) * dt) * dt;
            for _ in 0..20 {
                let (force, tangent) = pull(&springs[APEX], &x);
                let share = dt * dt / masses[APEX];
                let residual = x[APEX] - predicted - force * share;
                let matrix = Matrix3::identity() - tangent * share;
                x[APEX] -= matrix.try_inverse().expect("springs resist") * residual;
            }
            v = (x[APEX] - from) / dt;
            let (force, _) = pull(&springs[APEX], &y);
            w += (force / masses[APEX] + Vector3::from(pulled)) * dt;
            y[APEX] += w * dt;
            let now = positions(&simulation)[APEX];
            worst = max_or_nan([worst, (now - x[APEX]).norm()]);
            control = max_or_nan([control, (now - y[APEX]).norm()]);
            widest = max_or_nan([widest, (x[APEX] - mesh.vertices[APEX]).norm()]);
        }
        assert!(worst <= T25 * widest, "{solver}: {worst:e} of {widest:e}");
        assert!(control > 10.0 * T25 * widest, "{solver}: {control:e}");
    }
}

#[test]
fn a_fall_is_damped() {
    let (rate, pull): (f64, f64) = (5.0, 0.05);
    let damped = |t: f64| pull / rate * (t - (1.0 - (-rate * t).exp()) / rate);
    let per_frame = (-rate / RATE).exp();
    let factor = per_frame.to_string();
    for (solver, keys) in [
        (
            "xpbd",
            &[
                ("solver.xpbd.substeps", "100"),
                ("effects.damping.rate", "5 1/s"),
            ][..],
        ),
        (
            "implicit_euler",
            &[
                ("solver", "implicit_euler"),
                ("solver.implicit_euler.substeps", "100"),
                ("effects.damping.rate", "5 1/s"),
            ],
        ),
        (
            "pbd",
            &[
                ("solver", "pbd"),
                ("solver.pbd.substeps", "100"),
                ("solver.pbd.velocity_damping", &factor),
            ],
        ),
    ] {
        let scene = Scene::builder("fall", 60, RATE)
            .muscle("ball", icosphere(0.05, 1))
            .set("effects.stretch", "on")
            .set("effects.volume", "on")
            .set("muscle.0.material.stretch", "300 N/m")
            .set(
                "effects.gravity.acceleration",
                &format!("['0 m/s2', '0 m/s2', '-{pull} m/s2']"),
            );
        let mut simulation = started(&set_all(scene, keys));
        (0..60).for_each(|_| frame(&mut simulation));
        let rest = &simulation.bodies[0].rest.vertices;
        let fallen = rest
            .iter()
            .zip(positions(&simulation))
            .map(|(a, b)| a.z - b.z);
        let fallen: Vec<f64> = fallen.collect();
        let off = |law: f64| max_or_nan(fallen.iter().map(|z| (z / law - 1.0).abs()));
        let found = off(damped(1.0));
        assert!(found <= T25, "{solver}: {found:e}");
        // Control: without damping.
        assert!(off(0.5 * pull) > 10.0 * T25, "{solver}");
    }
}

#[test]
fn a_body_presses_with_its_bulk_modulus() {
    let ball = icosphere(0.05, 2);
    let rest = volume(&ball.vertices, &ball.triangles);
    let (modulus, growth) = (2e3, 1.2);
    let springs = springs(&ball, SOFT);
    for (solver, keys) in TO_REST {
        let mut hold = box_surface([0.02, 0.02, 0.01], 0.02);
        hold.vertices.iter_mut().for_each(|p| p.z -= 0.0555);
        let scene = Scene::builder("bulk", 300, RATE)
            .bone("hold", hold)
            .muscle("ball", ball.clone())
            .attach("hold", 2e-3)
            .set("effects.stretch", "on")
            .set("effects.volume.pressure", &growth.to_string())
            .set("muscle.0.material.stretch", &format!("{SOFT} N/m"))
            .set("muscle.0.material.bulk", &format!("{modulus} Pa"));
        let mut simulation = started(&set_all(scene, keys));
        (0..300).for_each(|_| frame(&mut simulation));
        let x = positions(&simulation);
        let pressure = modulus * (growth - volume(x, &ball.triangles) / rest);
        let mut outward = vec![Vector3::zeros(); x.len()];
        for &[a, b, c] in &ball.triangles {
            let [a, b, c] = [a, b, c].map(|v| v as usize);
            let third = (x[b] - x[a]).cross(&(x[c] - x[a])) / 6.0;
            [a, b, c].into_iter().for_each(|v| outward[v] += third);
        }
        let off = |pressure: f64| {
            let free = (0..x.len()).filter(|&v| simulation.bodies[0].is_free(v));
            max_or_nan(free.map(|v| {
                let (tension, _) = pull(&springs[v], x);
                (tension + outward[v] * pressure).norm() / (outward[v] * pressure).norm()
            }))
        };
        assert!(off(pressure) <= T25, "{solver}: {:e}", off(pressure));
        // Control: a modulus that is a twentieth larger.
        assert!(off(1.05 * pressure) > 10.0 * T25, "{solver}");
    }
}

#[test]
fn a_block_goes_along_with_a_plate_by_friction() {
    let (gravity, friction, speed) = (9.81, 0.3, 0.5);
    let gap = 5e-4;
    // On a bone, or on a muscle that the bone holds.
    let ridden = |soft: bool, keys: &[(&str, &str)], speed: f64| {
        let mut plate = box_surface([2.0, 0.4, 0.05], 0.2);
        let depth = 0.025 + 0.01 + gap + if soft { 0.03 } else { 0.0 };
        plate.vertices.iter_mut().for_each(|p| p.z -= depth);
        let mut layer = box_surface([0.5, 0.2, 0.03], 0.1);
        layer
            .vertices
            .iter_mut()
            .for_each(|p| p.z -= 0.015 + 0.01 + gap);
        let builder = Scene::builder("plate", 30, RATE)
            .bone("plate", plate)
            .muscle("block", box_surface([0.08, 0.08, 0.02], 0.02));
        let builder = match soft {
            true => builder
                .muscle("layer", layer)
                .attach("plate", 0.04)
                .set("muscle.1.attachment.0.limit", "100 %")
                .set("muscle.1.material.stretch", "3000 N/m")
                .set("effects.contact.between", "['bones', 'muscles']"),
            false => builder,
        };
        let builder = builder
            .set("effects.stretch", "on")
            .set("effects.bending", "on")
            .set("effects.volume", "on")
            .set("effects.contact.thickness", &format!("{gap} m"))
            .set("effects.contact.friction", &friction.to_string())
            .set(
                "effects.gravity.acceleration",
                &format!("['0 m/s2', '0 m/s2', '-{gravity} m/s2']"),
            )
            .set("muscle.0.material.stretch", "3000 N/m")
            .set("muscle.0.material.bending", "1e-2 N m");
        let mut scene = set_all(builder, keys)
            .build()
            .unwrap_or_else(|e| panic!("{}", e.terse()));
        let motion = &mut scene.bones[0].motion;
        motion.linear = true;
        motion.keys = [0.0, 30.0]
            .map(|frame| Key {
                frame,
                pose: Isometry3::translation(speed * frame / RATE, 0.0, 0.0),
            })
            .to_vec();
        let mut simulation = Simulation::new(scene).unwrap_or_else(|e| panic!("{}", e.terse()));
        let inverse = simulation.bodies[0].system.particles.inverse_mass.clone();
        let mass: f64 = inverse.iter().map(|w| 1.0 / w).sum();
        let mut way = Vec::new();
        for _ in 0..30 {
            frame(&mut simulation);
            let x = positions(&simulation).iter().zip(&inverse);
            way.push(x.map(|(p, w)| p.x / w).sum::<f64>() / mass);
        }
        way
    };
    // Constant force until it has the speed of the plate.
    let law = |t: f64, friction: f64| {
        let (pull, until) = (friction * gravity, speed / (friction * gravity));
        let sliding = t.min(until);
        0.5 * pull * sliding * sliding + speed * (t - sliding)
    };
    let steps = ("solver.xpbd.substeps", "100");
    let classic = [
        ("solver", "pbd"),
        ("solver.pbd.substeps", "100"),
        ("solver.pbd.velocity_damping", "1"),
    ];
    for (name, soft, keys) in [
        ("xpbd", false, &[steps][..]),
        ("sweeps", false, &[steps, ("solver.xpbd.iterations", "4")]),
        ("pbd", false, &classic),
        ("muscle", true, &[steps]),
        (
            "muscle, sweeps",
            true,
            &[steps, ("solver.xpbd.iterations", "4")],
        ),
        ("muscle, pbd", true, &classic),
    ] {
        let way = ridden(soft, keys, speed);
        let end = law(way.len() as f64 / RATE, friction);
        let off = |friction: f64| {
            let each = way.iter().zip(1..);
            max_or_nan(each.map(|(x, k)| (x - law(f64::from(k) / RATE, friction)).abs() / end))
        };
        let found = off(friction);
        assert!(found <= T25, "{name}: {found:e}");
        // Controls: friction without the load of the volume, and a plate at rest.
        assert!(off(2.0 / 3.0 * friction) > 10.0 * T25, "{name}");
        let still = ridden(soft, keys, 0.0)[29];
        assert!(still.abs() <= T25 * end, "{name}: {still}");
    }
}

#[test]
fn two_bodies_that_meet_keep_their_momentum() {
    let moved = |radius: f64, by: [f64; 3]| {
        let mut ball = icosphere(radius, 2);
        ball.vertices
            .iter_mut()
            .for_each(|p| *p += Vector3::from(by));
        ball
    };
    for (name, keys) in [
        ("without volume", &[("effects.volume", "off")][..]),
        ("volume", &[("effects.volume", "on")]),
        (
            "friction",
            &[
                ("effects.volume", "on"),
                ("effects.contact.friction", "0.3"),
            ],
        ),
    ] {
        // In the bone's reach, which they do not touch in that time.
        let scene = Scene::builder("meet", 15, RATE)
            .bone("bone", moved(0.05, [0.11, 0.0, 0.0]))
            .muscle("a", moved(0.05, [0.0; 3]))
            .muscle("b", moved(0.04, [0.01, 0.093, 0.02]))
            .set("effects.stretch", "on")
            .set("effects.contact.thickness", "0.5 mm")
            .set("effects.contact.between", "['bones', 'muscles']")
            .set("muscle.0.material.stretch", "300 N/m")
            .set("muscle.1.material.stretch", "600 N/m");
        let mut simulation = started(&set_all(scene, keys));
        let toward = Vector3::new(0.0, -0.3, 0.0);
        simulation.bodies[1].system.particles.velocity.fill(toward);
        let momenta = |simulation: &Simulation, equal: bool| {
            [0, 1].map(|k| {
                let body = &simulation.bodies[k];
                let masses = masses(&body.rest);
                let mean = masses.iter().sum::<f64>() / masses.len() as f64;
                let each = body.system.particles.velocity.iter().zip(&masses);
                each.map(|(v, m)| v * if equal { mean } else { *m })
                    .sum::<Vector3<f64>>()
            })
        };
        let before = momenta(&simulation, false);
        (0..15).for_each(|_| frame(&mut simulation));
        let off = |after: [Vector3<f64>; 2]| (after[0] + after[1] - before[1]).norm();
        let given = momenta(&simulation, false);
        let size = before[1].norm();
        assert!(given[0].norm() > 0.3 * size, "{name}: they do not meet");
        assert!(off(given) <= T26 * size, "{name}: {:e}", off(given) / size);
        // Control: equal masses of the vertices.
        let wrong = off(momenta(&simulation, true));
        assert!(wrong > 10.0 * T26 * size, "{name}: {:e}", wrong / size);
    }
}
