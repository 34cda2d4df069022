//! Shared code of the benches: bodies, alternating clocks, and the lines that
//! `benches/document.py` reads.
// Each bench uses a part of this module.
#![allow(dead_code, unused_imports)]

pub mod lines;
pub mod scene;
pub mod turned;

use std::hint::black_box;
use std::time::Instant;

pub use lines::{compare, key, note, quartiles, quick, result};
use nalgebra::{Point3, Vector3};
use pliant::Particles;
use pliant::constraints::{
    Batch, Bending, Constraint, Distance, EnclosedVolume, Project, SweepOrder,
};
use pliant::mesh::{Topology, TriangleMesh};
use pliant::solvers::stiffness;
use pliant::testing::internals::constraints::SimdWidth;
use pliant::testing::internals::particles::Packed;

/// Time step of sweeps [s].
pub const DT: f64 = 1e-3;

pub fn pool(threads: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .expect("a pool of threads")
}

pub fn with_threads<T: Send>(threads: usize, deed: impl FnOnce() -> T + Send) -> T {
    pool(threads).install(deed)
}

/// Duration of `deed` [s].
pub fn seconds(deed: impl FnOnce()) -> f64 {
    let begin = Instant::now();
    deed();
    begin.elapsed().as_secs_f64()
}

/// Times [s] of two alternating pieces of work, so that both suffer the same disturbances. Each
/// runs `rounds` times, after two more runs that do not count.
pub fn in_turn(rounds: usize, mut one: impl FnMut(), mut other: impl FnMut()) -> [Vec<f64>; 2] {
    let mut times = [Vec::new(), Vec::new()];
    for round in 0..rounds + 2 {
        let both = [seconds(&mut one), seconds(&mut other)];
        if round >= 2 {
            times
                .iter_mut()
                .zip(both)
                .for_each(|(all, time)| all.push(time));
        }
    }
    times
}

/// Exponent of growth: the slope of the least-squares line through the logarithms.
pub fn exponent(sizes: &[f64], times: &[f64]) -> f64 {
    let logs = |of: &[f64]| of.iter().map(|v| v.ln()).collect::<Vec<_>>();
    let (x, y) = (logs(sizes), logs(times));
    let mean = |of: &[f64]| of.iter().sum::<f64>() / of.len() as f64;
    let (mx, my) = (mean(&x), mean(&y));
    let along: f64 = x.iter().map(|x| (x - mx).powi(2)).sum();
    x.iter()
        .zip(&y)
        .map(|(x, y)| (x - mx) * (y - my))
        .sum::<f64>()
        / along
}

/// A closed surface with its edges, hinges and volume, fixed at one end, bent and stretched by
/// up to a twentieth.
pub struct Body {
    pub mesh: TriangleMesh,
    pub edges: (Vec<Distance>, Vec<f64>),
    pub hinges: (Vec<Bending>, Vec<f64>),
    pub start: Particles,
}

impl Body {
    /// A body of a mesh that is about 2 m long and begins at -1 m.
    pub fn of(mesh: TriangleMesh) -> Self {
        let topology = Topology::new(&mesh);
        let bent = |p: &Point3<f64>| {
            p + Vector3::new(0.05 * p.x, 0.05 * p.x * p.x, 0.01 * (9.0 * p.x).sin())
        };
        let position = mesh.vertices.iter().map(bent).collect();
        let inverse_mass = mesh
            .vertices
            .iter()
            .map(|p| if p.x < -0.98 { 0.0 } else { 1e3 })
            .collect();
        let (edges, edge_stiffness) = stiffness::edges(&mesh, &topology, 1e3);
        let (hinges, hinge_stiffness) = stiffness::hinges(&mesh, &topology, 1e-3);
        Self {
            edges: (edges, stiffness::compliance(&edge_stiffness)),
            hinges: (hinges, stiffness::compliance(&hinge_stiffness)),
            start: Particles::at_rest(position, inverse_mass),
            mesh,
        }
    }

    pub fn volume(&self, width: SimdWidth) -> EnclosedVolume {
        EnclosedVolume::new(
            &self.mesh.triangles,
            self.mesh.vertices.len(),
            self.mesh.volume(),
            0.0,
        )
        .with_width(width)
    }

    pub fn packed(&self) -> Packed {
        let mut packed = Packed::default();
        packed.read(&self.start);
        packed
    }

    pub fn sweep(&self, order: SweepOrder, width: SimdWidth) -> Swept {
        let count = self.start.len();
        Swept {
            edges: batch(&self.edges, order, width, count),
            hinges: batch(&self.hinges, order, width, count),
            volume: self.volume(width),
            packed: Packed::default(),
        }
    }
}

pub fn batch<C: Constraint<K>, const K: usize>(
    (all, compliance): &(Vec<C>, Vec<f64>),
    order: SweepOrder,
    width: SimdWidth,
    count: usize,
) -> Batch<C, K> {
    Batch::new(all.clone(), compliance.clone(), order, count, &[]).with_width(width)
}

/// All constraints of a sweep.
pub struct Swept {
    pub edges: Batch<Distance, 2>,
    pub hinges: Batch<Bending, 4>,
    pub volume: EnclosedVolume,
    packed: Packed,
}

impl Swept {
    /// One sweep over all constraints, as in a step: packed once.
    pub fn sweep(&mut self, particles: &mut Particles) {
        self.edges.begin_step();
        self.hinges.begin_step();
        self.volume.begin_step();
        self.again(particles);
    }

    /// One more sweep of the same step.
    pub fn again(&mut self, particles: &mut Particles) {
        self.packed.read(particles);
        self.edges.project_packed(&mut self.packed, DT);
        self.hinges.project_packed(&mut self.packed, DT);
        self.packed.write(particles);
        self.volume
            .project(black_box(particles), DT)
            .expect("a body that can be inflated");
    }

    /// Root mean square residuals of edges and hinges [m].
    pub fn residuals(&self, particles: &Particles) -> [f64; 2] {
        [
            self.edges.residual(particles, DT).rms,
            self.hinges.residual(particles, DT).rms,
        ]
    }
}

/// The volume divided by the volume of the mesh, minus one.
pub fn volume_error(mesh: &TriangleMesh, x: &[Point3<f64>]) -> f64 {
    pliant::mesh::measures::volume(x, &mesh.triangles) / mesh.volume() - 1.0
}
