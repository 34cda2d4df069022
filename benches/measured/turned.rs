//! A tube with one rotated end, for the equilibrium solver.

use nalgebra::{Point3, Rotation3, Vector3};
use pliant::constraints::{EnclosedVolume, Quadratic};
use pliant::mesh::{Topology, TriangleMesh};
use pliant::solvers::{DescentSettings, Energy, NoContact, QuasiStatic, stiffness};

use super::volume_error;

/// Iterations of a solve.
pub const ITERATIONS: u32 = 4;

/// A body of about 2 m along x with two fixed ends.
pub struct Turned<'a> {
    mesh: &'a TriangleMesh,
    inverse_mass: Vec<f64>,
    pose: Vec<(u32, Point3<f64>)>,
}

impl<'a> Turned<'a> {
    /// One end is rotated by 10 degrees.
    pub fn new(mesh: &'a TriangleMesh) -> Self {
        let held: Vec<u32> = (0..mesh.vertices.len() as u32)
            .filter(|&v| mesh.vertices[v as usize].x.abs() > 0.9)
            .collect();
        let mut inverse_mass = vec![1.0; mesh.vertices.len()];
        held.iter().for_each(|&v| inverse_mass[v as usize] = 0.0);
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), 10_f64.to_radians());
        let place = |p: Point3<f64>| if p.x > 0.0 { turn * p } else { p };
        let pose = held
            .iter()
            .map(|&v| (v, place(mesh.vertices[v as usize])))
            .collect();
        Self {
            mesh,
            inverse_mass,
            pose,
        }
    }

    /// The energy to minimise. Any solver needs it.
    pub fn energy(&self) -> Energy {
        let (mesh, topology) = (self.mesh, Topology::new(self.mesh));
        let (edges, k) = stiffness::edges(mesh, &topology, 300.0);
        let (hinges, b) = stiffness::hinges(mesh, &topology, 2e-4);
        let count = mesh.vertices.len();
        Energy {
            elastic: vec![
                Box::new(Quadratic::<_, 2>::new(edges, k)),
                Box::new(Quadratic::<_, 4>::new(hinges, b)),
            ],
            volumes: vec![EnclosedVolume::new(
                &mesh.triangles,
                count,
                mesh.volume(),
                0.0,
            )],
            ..Energy::default()
        }
    }

    /// Factors the constant matrix.
    pub fn factored(&self, energy: Energy) -> QuasiStatic {
        let settings = DescentSettings {
            tolerance: 0.0,
            iterations: ITERATIONS,
        };
        QuasiStatic::new(energy, &self.mesh.vertices, &self.inverse_mass, settings)
            .expect("both ends are held")
    }

    /// The first guess and some iterations. Afterwards the energy is lower and the volume is
    /// kept.
    pub fn solve(&self, solver: &mut QuasiStatic) {
        let mut x = self.mesh.vertices.clone();
        let (mut first, mut last) = (f64::NAN, f64::NAN);
        solver.follow(&mut x, &self.pose, &mut NoContact);
        let outcome = solver.solve(&mut x, &mut NoContact, |outcome, _| {
            if first.is_nan() {
                first = outcome.energy;
            }
            last = outcome.energy;
            true
        });
        assert_eq!(outcome.iterations, ITERATIONS);
        assert!(last < first, "the energy rose from {first:e} to {last:e} J");
        assert!(volume_error(self.mesh, &x).abs() <= 1e-9);
    }
}
