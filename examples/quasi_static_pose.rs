//! The equilibrium of a body in a turned pose: a soft tube is bent by 30 degrees.
//!
//! The solver searches for the positions of least energy at a constant volume. Mass and time have no effect.

use std::error::Error;

use nalgebra::{Isometry3, Point3, Vector3};
use pliant::mesh::measures::volume;
use pliant::mesh::shapes::tube;
use pliant::solvers::{DescentSettings, NoContact, stiffness};
use pliant::{EnclosedVolume, Energy, Quadratic, QuasiStatic, Topology, TriangleMesh};

/// Runs the example.
pub fn main() -> Result<(), Box<dyn Error>> {
    // A tube of radius 2 cm and length 20 cm along x. Its last 3 cm at either end are held.
    let body = tube(0.02, 0.2, 16);
    let is_held = |p: &Point3<f64>| p.x.abs() > 0.07;
    let inverse_mass: Vec<f64> = body
        .vertices
        .iter()
        .map(|p| if is_held(p) { 0.0 } else { 1.0 })
        .collect();

    // The solver factorises one matrix of the body at rest; all poses use it.
    let settings = DescentSettings {
        tolerance: 1e-6,
        iterations: 2000,
    };
    let rest = &body.vertices;
    let mut solver = QuasiStatic::new(energy(&body), rest, &inverse_mass, settings)?;

    // The right end turns by 30 degrees about an axis along z through the middle of the tube.
    let turn = Isometry3::rotation(Vector3::z() * 30_f64.to_radians());
    let pose = |p: &Point3<f64>| if p.x > 0.0 { turn * p } else { *p };
    let held: Vec<(u32, Point3<f64>)> = (0u32..)
        .zip(rest)
        .filter(|(_, p)| is_held(p))
        .map(|(v, p)| (v, pose(p)))
        .collect();

    // `follow` moves the held vertices and carries the others along; `solve` brings these to equilibrium. The closure
    // sees every iteration, and ends the search where it returns false. `NoContact` means: no obstacles.
    let mut x = rest.clone();
    solver.follow(&mut x, &held, &mut NoContact);
    let outcome = solver.solve(&mut x, &mut NoContact, |_, _| true);

    // The forces on the free vertices vanish, up to the tolerance.
    assert!(outcome.converged, "{outcome:?}");
    assert!(outcome.residual <= settings.tolerance);

    // The volume is kept, and the held vertices are where the pose has them.
    let error = volume(&x, &body.triangles) / body.volume() - 1.0;
    assert!(error.abs() <= 1e-9, "the volume is off by {error:e}");
    assert!(held.iter().all(|&(v, to)| x[v as usize] == to));

    // The energy is less than that of a tube with a sharp bend in its middle.
    let sharp: Vec<Point3<f64>> = rest.iter().map(pose).collect();
    let parts = energy(&body);
    assert!(parts.value(&x) < 0.5 * parts.value(&sharp));

    // The pose back at rest has no energy.
    let held: Vec<(u32, Point3<f64>)> = held.iter().map(|&(v, _)| (v, rest[v as usize])).collect();
    solver.follow(&mut x, &held, &mut NoContact);
    let outcome = solver.solve(&mut x, &mut NoContact, |_, _| true);
    assert!(outcome.converged, "{outcome:?}");
    assert!(parts.value(&x) <= 1e-9 * parts.value(&sharp));
    Ok(())
}

/// Springs of 300 N/m along the edges, hinges of 3 mN m between the triangles, and an exact volume.
fn energy(body: &TriangleMesh) -> Energy {
    let topology = Topology::new(body);
    let (edges, k) = stiffness::edges(body, &topology, 300.0);
    let (hinges, b) = stiffness::hinges(body, &topology, 3e-3);
    let count = body.vertices.len();
    Energy {
        elastic: vec![
            Box::new(Quadratic::<_, 2>::new(edges, k)),
            Box::new(Quadratic::<_, 4>::new(hinges, b)),
        ],
        volumes: vec![EnclosedVolume::new(
            &body.triangles,
            count,
            body.volume(),
            0.0,
        )],
        ..Energy::default()
    }
}
