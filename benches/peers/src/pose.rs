//! Time and error of pliant and rapier3d relative to one reference: a spindle fixed at both
//! ends. One end rotates and then rests.
//!
//! rapier3d takes a frequency f and pulls with the stiffness (2 pi f)^2 / sum w |grad C|^2.
//! Pliant uses these stiffnesses at rest, so both have the same energy. The reference is its
//! equilibrium by Newton's method. All solvers step the same frame alternately, on one thread.
//! Damping, which makes the motion not comparable, has no effect on the equilibrium.

#[path = "../../measured/lines.rs"]
mod lines;

use std::time::Instant;

use lines::{note, quartiles, quick, result};
use nalgebra::{Point3, Rotation3, Vector3};
use pliant::constraints::{Batch, Bending, Constraint, Distance, EnclosedVolume, Quadratic, SweepOrder, dihedral};
use pliant::mesh::{Topology, TriangleMesh};
use pliant::mesh::shapes::icosphere;
use pliant::Particles;
use pliant::solvers::{DescentSettings as Limits, Energy, Newton, QuasiStatic, StepSettings, System, NoContact, stiffness};
use rapier3d::prelude::{PhysicsWorld, SoftBodyBuilder, SoftBodyHandle, SoftBodyMaterial, SpringCoefficients, Vector};

/// Time of a frame [s].
const FRAME: f64 = 1.0 / 60.0;
/// Frames of the rotation, and the equal number of frames at rest.
const FRAMES: u32 = 30;
/// Frames in which XPBD reaches complete equilibrium.
const LONG: u32 = 10 * FRAMES;
/// The whole rotation [degrees].
const TURN: f64 = 6.0;
/// Mass of a particle [kg].
const MASS: f64 = 1e-3;
/// Frequencies of edges, hinges and volume [Hz]: the defaults of rapier3d.
const FREQUENCY: [f64; 3] = [30.0, 10.0, 30.0];
/// Damping of all velocities [1/s], the same for both.
const DAMPING: f64 = 10.0;

/// One body for all solvers.
struct Task {
    mesh: TriangleMesh,
    inverse_mass: Vec<f64>,
    held: Vec<u32>,
    edges: (Vec<Distance>, Vec<f64>),
    hinges: (Vec<Bending>, Vec<f64>),
    volume_stiffness: f64,
}

impl Task {
    fn new(level: u32) -> Self {
        let mut mesh = icosphere(1.0, level);
        mesh.vertices.iter_mut().for_each(|p| (p.y, p.z) = (0.4 * p.y, 0.4 * p.z));
        let is_held = |p: &Point3<f64>| p.x.abs() > 0.9;
        let inverse_mass: Vec<f64> = mesh.vertices.iter().map(|p| if is_held(p) { 0.0 } else { 1.0 / MASS }).collect();
        let held = (0..mesh.vertices.len() as u32).filter(|&v| is_held(&mesh.vertices[v as usize])).collect();
        let topology = Topology::new(&mesh);
        let x = &mesh.vertices;
        let edges = weighed(stiffness::edges(&mesh, &topology, 1.0).0, x, &inverse_mass, FREQUENCY[0]);
        let hinges = weighed(stiffness::hinges(&mesh, &topology, 1.0).0, x, &inverse_mass, FREQUENCY[1]);
        let closed = EnclosedVolume::new(&mesh.triangles, x.len(), 0.0, 0.0);
        let weight: f64 =
            closed.value_and_gradient(x).1.iter().zip(&inverse_mass).map(|(g, w)| w * g.norm_squared()).sum();
        let volume_stiffness = (std::f64::consts::TAU * FREQUENCY[2]).powi(2) / weight;
        Self { mesh, inverse_mass, held, edges, hinges, volume_stiffness }
    }

    fn volume(&self) -> EnclosedVolume {
        let count = self.mesh.vertices.len();
        EnclosedVolume::new(&self.mesh.triangles, count, self.mesh.volume(), 1.0 / self.volume_stiffness)
    }

    fn energy(&self) -> Energy {
        let (edges, hinges) = (self.edges.clone(), self.hinges.clone());
        Energy {
            elastic: vec![
                Box::new(Quadratic::<_, 2>::new(edges.0, edges.1)),
                Box::new(Quadratic::<_, 4>::new(hinges.0, hinges.1)),
            ],
            volumes: vec![self.volume()],
            ..Energy::default()
        }
    }

    /// Held vertices at a time [frames].
    fn pose(&self, time: f64) -> Vec<(u32, Point3<f64>)> {
        let turn = Rotation3::from_axis_angle(
            &Vector3::y_axis(),
            TURN.to_radians() * (time / f64::from(FRAMES)).clamp(0.0, 1.0),
        );
        let place = |p: Point3<f64>| if p.x > 0.0 { turn * p } else { p };
        self.held.iter().map(|&v| (v, place(self.mesh.vertices[v as usize]))).collect()
    }

    fn solver(&self, tolerance: f64, iterations: u32) -> QuasiStatic {
        let limits = Limits { tolerance, iterations };
        QuasiStatic::new(self.energy(), &self.mesh.vertices, &self.inverse_mass, limits).expect("both ends are held")
    }

    /// The equilibrium at the end of the rotation, tracked to that pose.
    fn reference(&self) -> Vec<Point3<f64>> {
        let mut x = self.mesh.vertices.clone();
        let mut start = self.solver(1e-5, 500);
        for frame in 1..=FRAMES {
            start.follow(&mut x, &self.pose(f64::from(frame)), &mut NoContact);
            start.solve(&mut x, &mut NoContact, |_, _| true);
        }
        let limits = Limits { tolerance: 1e-10, iterations: 50 };
        let mut newton = Newton::new(self.energy(), &self.mesh.vertices, &self.inverse_mass, limits).expect("memory");
        let outcome = newton.solve(&mut x, &mut NoContact, |_, _| true).expect("both ends are held");
        assert!(outcome.converged, "the reference is not: {outcome:?}");
        // An angle of rapier3d has no sign. A flat hinge would give another energy.
        let sign = |h: &&Bending| dihedral(&h.points.map(|p| x[p as usize])) * h.rest > 0.0;
        let kept = self.hinges.0.iter().filter(sign).count();
        assert_eq!(kept, self.hinges.0.len(), "hinges went through flat");
        x
    }

    /// Root mean square distance as a share of the length [%].
    fn error(&self, x: &[Point3<f64>], reference: &[Point3<f64>]) -> f64 {
        let sum: f64 = x.iter().zip(reference).map(|(a, b)| (a - b).norm_squared()).sum();
        (sum / x.len() as f64).sqrt() / self.mesh.length() * 100.0
    }
}

/// Constraints with a movable particle, with the stiffness at rest that a frequency [Hz] gives
/// for each.
fn weighed<C: Constraint<K>, const K: usize>(
    all: Vec<C>,
    x: &[Point3<f64>],
    inverse_mass: &[f64],
    frequency: f64,
) -> (Vec<C>, Vec<f64>) {
    let square = (std::f64::consts::TAU * frequency).powi(2);
    let stiffness = |c: &C| {
        let points = c.points();
        let (_, g) = c.value_and_gradient(&points.map(|p| x[p as usize]))?;
        let weight: f64 = points.iter().zip(&g).map(|(&p, g)| inverse_mass[p as usize] * g.norm_squared()).sum();
        (weight > 0.0).then_some(square / weight)
    };
    all.into_iter().filter_map(|c| Some((c, stiffness(&c)?))).unzip()
}

/// A solver that follows the pose frame by frame.
trait Follow {
    fn frame(&mut self, task: &Task, frame: u32);
    fn positions(&self) -> Vec<Point3<f64>>;
}

struct Steps {
    system: System,
    substeps: u32,
}

impl Steps {
    fn new(task: &Task, substeps: u32) -> Self {
        let count = task.mesh.vertices.len();
        let settings = StepSettings {
            iterations: 1,
            gravity: Vector3::zeros(),
            velocity_factor: 1.0 / (1.0 + FRAME / f64::from(substeps) * DAMPING),
            force_factor: 1.0,
            speed_limit: f64::INFINITY,
        };
        let particles = Particles::at_rest(task.mesh.vertices.clone(), task.inverse_mass.clone());
        let mut system = System::new(particles, settings);
        let (edges, k) = task.edges.clone();
        system.elastic.push(Box::new(Batch::new(edges, stiffness::compliance(&k), SweepOrder::Coloured, count, &[])));
        let (hinges, k) = task.hinges.clone();
        system.elastic.push(Box::new(Batch::new(hinges, stiffness::compliance(&k), SweepOrder::Coloured, count, &[])));
        system.volume = Some(task.volume());
        Self { system, substeps }
    }
}

impl Follow for Steps {
    fn frame(&mut self, task: &Task, frame: u32) {
        for k in 1..=self.substeps {
            let time = f64::from(frame - 1) + f64::from(k) / f64::from(self.substeps);
            task.pose(time).into_iter().for_each(|(v, p)| self.system.particles.position[v as usize] = p);
            self.system.step(&[], FRAME / f64::from(self.substeps)).expect("finite");
        }
    }

    fn positions(&self) -> Vec<Point3<f64>> {
        self.system.particles.position.clone()
    }
}

struct Equilibria {
    solver: QuasiStatic,
    x: Vec<Point3<f64>>,
}

impl Follow for Equilibria {
    fn frame(&mut self, task: &Task, frame: u32) {
        self.solver.follow(&mut self.x, &task.pose(f64::from(frame)), &mut NoContact);
        self.solver.solve(&mut self.x, &mut NoContact, |_, _| true);
    }

    fn positions(&self) -> Vec<Point3<f64>> {
        self.x.clone()
    }
}

struct Rapier {
    world: PhysicsWorld,
    body: SoftBodyHandle,
}

fn single(p: &Point3<f64>) -> Vector {
    Vector::new(p.x as f32, p.y as f32, p.z as f32)
}

impl Rapier {
    fn new(task: &Task, substeps: u32) -> Self {
        let mut world = PhysicsWorld::new();
        world.gravity = Vector::new(0.0, 0.0, 0.0);
        world.integration_parameters.num_solver_iterations = substeps as usize;
        world.integration_parameters.dt = FRAME as f32;
        let softness = |k: usize| SpringCoefficients::new(FREQUENCY[k] as f32, 1.0);
        let material = SoftBodyMaterial {
            edge_softness: softness(0),
            bend_softness: softness(1),
            volume_softness: softness(2),
            ..SoftBodyMaterial::default()
        };
        let builder =
            SoftBodyBuilder::trimesh(task.mesh.vertices.iter().map(single).collect(), task.mesh.triangles.clone());
        let builder = builder
            .expect("a mesh")
            .material(material)
            .shape_matching(false)
            .volume_preservation(true)
            .self_contacts(false)
            .no_surface_collider()
            .can_sleep(false)
            .linear_damping(DAMPING as f32)
            .particle_mass(MASS as f32)
            .pinned_particles(task.held.clone());
        let PhysicsWorld { soft_bodies, bodies, colliders, .. } = &mut world;
        let body = soft_bodies.insert(builder, bodies, colliders);
        Self { world, body }
    }
}

impl Follow for Rapier {
    fn frame(&mut self, task: &Task, frame: u32) {
        let body = &mut self.world.soft_bodies[self.body];
        for (v, p) in task.pose(f64::from(frame)) {
            body.set_particle_kinematic_target(v as usize, single(&p));
        }
        self.world.step();
    }

    fn positions(&self) -> Vec<Point3<f64>> {
        let all = self.world.soft_bodies[self.body].particle_positions();
        all.map(|p| Point3::new(f64::from(p.x), f64::from(p.y), f64::from(p.z))).collect()
    }
}

/// A solver with settings, its times of the frames [ms], and its positions after the rotation
/// and after the rest.
struct Runner {
    who: &'static str,
    settings: String,
    solver: Box<dyn Follow>,
    times: Vec<f64>,
    turned: Vec<Point3<f64>>,
    rested: Vec<Point3<f64>>,
}

fn runners(task: &Task) -> Vec<Runner> {
    let mut all: Vec<(&'static str, String, Box<dyn Follow>)> = Vec::new();
    let substeps: &[u32] = if quick() { &[1, 4] } else { &[1, 2, 4, 8, 16, 32] };
    for &n in substeps {
        all.push(("rapier3d", format!("substeps {n}"), Box::new(Rapier::new(task, n))));
    }
    for n in substeps.iter().copied().chain([64, 128].into_iter().filter(|_| !quick())) {
        all.push(("pliant, XPBD", format!("substeps {n}"), Box::new(Steps::new(task, n))));
    }
    for n in [1, 2, 4, 8] {
        let solver = Equilibria { solver: task.solver(1e-12, n), x: task.mesh.vertices.clone() };
        all.push(("pliant, quasi-static", format!("iterations {n}"), Box::new(solver)));
    }
    let of = |(who, settings, solver)| {
        let (times, turned, rested) = (Vec::new(), Vec::new(), Vec::new());
        Runner { who, settings, solver, times, turned, rested }
    };
    all.into_iter().map(of).collect()
}

/// All solvers run alternately, frame by frame.
fn run(task: &Task, all: &mut [Runner]) {
    for frame in 1..=2 * FRAMES {
        for runner in all.iter_mut() {
            let begin = Instant::now();
            runner.solver.frame(task, frame);
            runner.times.push(begin.elapsed().as_secs_f64() * 1e3);
            if frame == FRAMES {
                runner.turned = runner.solver.positions();
            }
        }
    }
    all.iter_mut().for_each(|runner| runner.rested = runner.solver.positions());
}

/// The equilibrium that rapier3d reaches by itself with many substeps.
fn limit(task: &Task) -> Vec<Point3<f64>> {
    let mut finest = Rapier::new(task, if quick() { 8 } else { 64 });
    let frames = if quick() { 2 * FRAMES } else { 6 * FRAMES };
    (1..=frames).for_each(|frame| finest.frame(task, frame));
    finest.positions()
}

fn report(task: &Task, all: &[Runner], reference: &[Point3<f64>], own: &[Point3<f64>]) {
    let (mut rows, mut own_errors) = (Vec::new(), Vec::new());
    for runner in all {
        let time = quartiles(runner.times.clone())[1];
        let [turned, rested] = [&runner.turned, &runner.rested].map(|x| task.error(x, reference));
        println!("ROW pose | {} | {} | {time:.2} | {turned:.3} | {rested:.3} |", runner.who, runner.settings);
        rows.push((runner.who, time, rested));
        if runner.who == "rapier3d" {
            own_errors.push(task.error(&runner.rested, own));
        }
    }
    for (name, wanted) in [("equal-time", "pliant"), ("equal-time.xpbd", "pliant, XPBD")] {
        let ratio = |&(_, time, error): &(&str, f64, f64)| {
            let ours = rows.iter().filter(|r| r.0.starts_with(wanted) && r.1 <= time).map(|r| r.2);
            error / ours.fold(f64::INFINITY, f64::min)
        };
        let ratios = quartiles(rows.iter().filter(|r| r.0 == "rapier3d").map(ratio).collect());
        let [least, most] = extremes(rows.iter().filter(|r| r.0 == "rapier3d").map(ratio));
        result(&format!("pose.{name}.least"), least, "1");
        result(&format!("pose.{name}.median"), ratios[1], "1");
        result(&format!("pose.{name}.most"), most, "1");
    }
    let [least, most] = extremes(own_errors);
    result("pose.own-limit.least", least, "%");
    result("pose.own-limit.most", most, "%");
}

fn extremes(numbers: impl IntoIterator<Item = f64>) -> [f64; 2] {
    numbers.into_iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], v| [a.min(v), b.max(v)])
}

fn measure() {
    let task = Task::new(if quick() { 3 } else { 4 });
    let reference = task.reference();
    let moved = task.error(&task.mesh.vertices, &reference);
    let mut all = runners(&task);
    run(&task, &mut all);
    let own = limit(&task);
    let apart = task.error(&own, &reference);
    // Otherwise the two energies would differ and the results would not be comparable.
    assert!(apart <= 0.1 * moved, "rapier3d rests {apart} % from the reference, which moved by {moved} %");
    let exact = all.iter().rfind(|r| r.who == "pliant, quasi-static").expect("a runner");
    assert!(task.error(&exact.rested, &reference) <= 0.01 * moved, "the equilibrium is not found");
    note("pose.vertices", task.mesh.vertices.len());
    result("pose.moved", moved, "%");
    result("pose.limit", apart, "%");
    report(&task, &all, &reference, &own);
    // The longer run shows whether the row of the table lacked only time.
    let steps = all.iter_mut().rfind(|r| r.who == "pliant, XPBD").expect("a runner");
    (0..LONG).for_each(|_| steps.solver.frame(&task, 2 * FRAMES));
    let off = task.error(&steps.solver.positions(), &reference);
    assert!(quick() || off <= 0.1 * moved, "XPBD rests {off} % away; all moved by {moved} %");
}

fn main() {
    rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool of one thread").install(measure);
}
