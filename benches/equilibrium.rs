//! Time and error of a pose change: a muscle of about 10,000 vertices whose far end is rotated
//! by 25 degrees from rest.
//!
//! Errors are relative to Newton's solution of the same energy. `PLIANT_DATA` adds the real
//! gluteus maximus.

mod measured;

use std::path::PathBuf;
use std::time::{Duration, Instant};

use measured::{key, quick, result};
use nalgebra::{Point3, Rotation3, Unit, Vector3};
use pliant::constraints::{EnclosedVolume, Quadratic};
use pliant::mesh::refine;
use pliant::mesh::shapes::make;
use pliant::mesh::{Topology, TriangleMesh};
use pliant::solvers::{DescentSettings, Energy, Newton, NoContact, QuasiStatic, stiffness};

/// Stiffness of the example scenes [N/m, N m].
const MATERIAL: (f64, f64) = (300.0, 2e-4);

/// Share of the length that is fixed at each end.
const HELD: f64 = 0.1;

/// Frames of the rotation that is tracked.
const FRAMES: u32 = 25;

struct Task {
    name: &'static str,
    mesh: TriangleMesh,
    inverse_mass: Vec<f64>,
    held: Vec<u32>,
    /// The rotated vertices and their centre of rotation.
    turned: Vec<bool>,
    pivot: Point3<f64>,
    axis: Unit<Vector3<f64>>,
}

impl Task {
    fn new(name: &'static str, mesh: TriangleMesh) -> Self {
        let bounds = mesh.bounding_box();
        let along = bounds.extents().imax();
        let place = |p: &Point3<f64>| (p[along] - bounds.min[along]) / bounds.extents()[along];
        let at: Vec<f64> = mesh.vertices.iter().map(place).collect();
        let is_held = |s: &f64| *s < HELD || *s > 1.0 - HELD;
        Self {
            name,
            inverse_mass: at
                .iter()
                .map(|s| if is_held(s) { 0.0 } else { 1.0 })
                .collect(),
            held: (0..at.len() as u32)
                .filter(|v| is_held(&at[*v as usize]))
                .collect(),
            turned: at.iter().map(|s| *s > 1.0 - HELD).collect(),
            pivot: bounds.center(),
            axis: if along == 1 {
                Vector3::x_axis()
            } else {
                Vector3::y_axis()
            },
            mesh,
        }
    }

    /// Fixed vertices after a rotation [rad].
    fn pose(&self, angle: f64) -> Vec<(u32, Point3<f64>)> {
        let turn = Rotation3::from_axis_angle(&self.axis, angle);
        let place = |v: u32| {
            let p = self.mesh.vertices[v as usize];
            (
                v,
                if self.turned[v as usize] {
                    self.pivot + turn * (p - self.pivot)
                } else {
                    p
                },
            )
        };
        self.held.iter().map(|&v| place(v)).collect()
    }

    fn energy(&self) -> Energy {
        let topology = Topology::new(&self.mesh);
        let (edges, k) = stiffness::edges(&self.mesh, &topology, MATERIAL.0);
        let (hinges, b) = stiffness::hinges(&self.mesh, &topology, MATERIAL.1);
        let count = self.mesh.vertices.len();
        Energy {
            elastic: vec![
                Box::new(Quadratic::<_, 2>::new(edges, k)),
                Box::new(Quadratic::<_, 4>::new(hinges, b)),
            ],
            volumes: vec![EnclosedVolume::new(
                &self.mesh.triangles,
                count,
                self.mesh.volume(),
                0.0,
            )],
            ..Energy::default()
        }
    }

    fn solver(&self, energy: Energy, tolerance: f64, iterations: u32) -> QuasiStatic {
        let settings = DescentSettings {
            tolerance,
            iterations,
        };
        QuasiStatic::new(energy, &self.mesh.vertices, &self.inverse_mass, settings)
            .expect("both ends are held")
    }

    /// Root mean square distance as a share of the length.
    fn error(&self, x: &[Point3<f64>], reference: &[Point3<f64>]) -> f64 {
        let sum: f64 = x
            .iter()
            .zip(reference)
            .map(|(a, b)| (a - b).norm_squared())
            .sum();
        (sum / x.len() as f64).sqrt() / self.mesh.length()
    }

    fn reference(&self, angle: f64) -> Vec<Point3<f64>> {
        let mut x = self.mesh.vertices.clone();
        let mut start = self.solver(self.energy(), 1e-5, 2000);
        start.follow(&mut x, &self.pose(angle), &mut NoContact);
        start.solve(&mut x, &mut NoContact, |_, _| true);
        let settings = DescentSettings {
            tolerance: 1e-10,
            iterations: 50,
        };
        let mut newton = Newton::new(
            self.energy(),
            &self.mesh.vertices,
            &self.inverse_mass,
            settings,
        )
        .expect("memory for the factor");
        let outcome = newton
            .solve(&mut x, &mut NoContact, |_, _| true)
            .expect("both ends are held");
        assert!(outcome.converged, "the reference is not: {outcome:?}");
        x
    }
}

/// Times and errors after each iteration of a pose change from rest, factorisation included.
/// Positions are compared outside the measured time.
fn from_rest(task: &Task, reference: &[Point3<f64>]) -> (Duration, Vec<(Duration, f64)>) {
    // Every solver needs edges, hinges and their stiffness. Only this solver needs the factor.
    let energy = task.energy();
    let begin = Instant::now();
    let mut solver = task.solver(energy, 1e-5, 400);
    let prepared = begin.elapsed();
    let mut x = task.mesh.vertices.clone();
    solver.follow(&mut x, &task.pose(25_f64.to_radians()), &mut NoContact);
    let (mut rows, mut off_the_clock) = (Vec::new(), Duration::ZERO);
    let outcome = solver.solve(&mut x, &mut NoContact, |_, x| {
        let pause = Instant::now();
        rows.push((begin.elapsed() - off_the_clock, task.error(x, reference)));
        off_the_clock += pause.elapsed();
        true
    });
    assert!(
        outcome.converged && task.error(&x, reference) <= 1e-3,
        "{outcome:?}"
    );
    (prepared, rows)
}

/// Time of the slowest frame and error at the end, where `iterations` follow each frame of the
/// rotation.
fn tracked(task: &Task, iterations: u32, reference: &[Point3<f64>]) -> (Duration, f64) {
    let mut solver = task.solver(task.energy(), 1e-12, iterations);
    let mut x = task.mesh.vertices.clone();
    let mut slowest = Duration::ZERO;
    for frame in 1..=FRAMES {
        let begin = Instant::now();
        solver.follow(
            &mut x,
            &task.pose(25_f64.to_radians() * f64::from(frame) / f64::from(FRAMES)),
            &mut NoContact,
        );
        solver.solve(&mut x, &mut NoContact, |_, _| true);
        slowest = slowest.max(begin.elapsed());
    }
    (slowest, task.error(&x, reference))
}

fn report(task: &Task, rounds: usize) {
    let name = format!("equilibrium.{}", key(task.name));
    let reference = task.reference(25_f64.to_radians());
    let runs: Vec<_> = (0..rounds).map(|_| from_rest(task, &reference)).collect();
    let prepared = runs.iter().map(|r| r.0).min().unwrap_or_default();
    result(
        &format!("{name}.vertices"),
        task.mesh.vertices.len() as f64,
        "1",
    );
    result(
        &format!("{name}.factored"),
        prepared.as_secs_f64() * 1e3,
        "ms",
    );
    for wanted in [0.02, 0.01, 0.004, 0.001] {
        // Every round makes the same iterations, so their least time is the least disturbed.
        let Some(at) = runs[0].1.iter().position(|(_, error)| *error <= wanted) else {
            continue;
        };
        let time = runs.iter().map(|r| r.1[at].0).min().unwrap_or_default();
        result(
            &format!("{name}.within-{}%.iterations", wanted * 100.0),
            at as f64,
            "1",
        );
        result(
            &format!("{name}.within-{}%.time", wanted * 100.0),
            time.as_secs_f64() * 1e3,
            "ms",
        );
    }
    for iterations in [1, 2, 4, 8] {
        let (slowest, error) = tracked(task, iterations, &reference);
        result(
            &format!("{name}.tracked-{iterations}.slowest"),
            slowest.as_secs_f64() * 1e3,
            "ms",
        );
        result(
            &format!("{name}.tracked-{iterations}.error"),
            error * 100.0,
            "%",
        );
    }
}

fn refined(mesh: &TriangleMesh, edge: f64) -> TriangleMesh {
    refine(mesh, edge).expect("a finer mesh").mesh
}

fn main() {
    let made = make("hip-gluteus").expect("a shape").mesh;
    if quick() {
        report(&Task::new("generated", made), 1);
        return;
    }
    report(&Task::new("generated", refined(&made, 0.0021)), 5);
    let Some(data) = std::env::var_os("PLIANT_DATA").map(PathBuf::from) else {
        println!("skipped the real gluteus maximus: PLIANT_DATA is not set");
        return;
    };
    let read = pliant::io::read(&data.join("body/muscles/Gluteus_maximus_muscle.r.obj"))
        .expect("a mesh")
        .mesh;
    report(&Task::new("gluteus maximus", refined(&read, 0.0028)), 5);
}
