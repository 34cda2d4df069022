//! A new kind of constraint in the code of a user: a triangle keeps its area.
//!
//! A constraint is a function C of a few points that is zero where the constraint holds. It needs three functions:
//! its points, its value, and its value with the gradient. The library projects it like its own kinds.

use nalgebra::{Point3, Vector3};
use pliant::{Batch, Constraint, Particles, Project, Scalar, SweepOrder};

/// Keeps the area of a triangle at `rest` [m^2]. A triangle without area has no gradient.
#[derive(Clone, Copy)]
struct TriangleArea {
    points: [u32; 3],
    rest: f64,
}

impl Constraint<3> for TriangleArea {
    // The name in messages and measures.
    const NAME: &'static str = "triangle area";

    fn points(&self) -> [u32; 3] {
        self.points
    }

    // In any number: `f64`, or a number with derivatives.
    fn value<S: Scalar>(&self, x: &[Point3<S>; 3]) -> S {
        let normal = (x[1] - x[0]).cross(&(x[2] - x[0]));
        normal.dot(&normal).sqrt() / S::of(2.0) - S::of(self.rest)
    }

    // The area grows fastest where a corner moves away from the opposite edge, in the plane of the triangle.
    fn value_and_gradient(&self, x: &[Point3<f64>; 3]) -> Option<(f64, [Vector3<f64>; 3])> {
        let (b, c) = (x[1] - x[0], x[2] - x[0]);
        let normal = b.cross(&c);
        let twice = normal.norm();
        // `None` where the gradient is undefined; the projection then leaves the points as they are.
        if twice == 0.0 {
            return None;
        }
        let unit = normal / twice;
        let (at_b, at_c) = (c.cross(&unit) / 2.0, unit.cross(&b) / 2.0);
        Some((twice / 2.0 - self.rest, [-(at_b + at_c), at_b, at_c]))
    }
}

/// Runs the example.
pub fn main() {
    // A square sheet of 1 m x 1 m from two triangles. Its right edge was pulled 0.2 m to the right.
    let corners = [[0.0, 0.0], [1.2, 0.0], [1.2, 1.0], [0.0, 1.0]];
    let position = corners.map(|[x, y]| Point3::new(x, y, 0.0)).to_vec();
    let triangles = [[0, 1, 2], [0, 2, 3]].map(|points| TriangleArea { points, rest: 0.5 });

    // A wrong gradient is the usual mistake in a new constraint. Central differences of the value find it.
    for triangle in &triangles {
        let x = triangle.points.map(|p| position[p as usize]);
        let error = gradient_error(triangle, &x);
        assert!(error <= 1e-9, "the gradient is off by {error:e}");
    }

    // The left edge is held: its inverse mass is 0. The right edge has 1 kg at each corner.
    let mut particles = Particles::at_rest(position.clone(), vec![0.0, 1.0, 1.0, 0.0]);

    // A batch sweeps constraints of one kind. A compliance of 0 makes them rigid.
    let compliance = vec![0.0; triangles.len()];
    let mut batch = Batch::new(
        triangles.to_vec(),
        compliance,
        SweepOrder::Stored,
        particles.len(),
        &[],
    );
    // In a `System`, the batch joins the others: `system.elastic.push(Box::new(batch))`.
    for _ in 0..100 {
        batch.begin_step();
        batch.project(&mut particles, 0.01);
    }

    // Both triangles have their area again, and the held corners did not move.
    for triangle in &triangles {
        let x = triangle.points.map(|p| particles.position[p as usize]);
        let error = triangle.value(&x);
        assert!(error.abs() <= 1e-12, "the area is off by {error:e} m2");
    }
    assert_eq!(particles.position[0], position[0]);
    assert_eq!(particles.position[3], position[3]);
    assert_eq!(batch.usage().skipped, 0);
}

/// The greatest difference between the gradient and central differences of the value.
fn gradient_error<C: Constraint<K>, const K: usize>(constraint: &C, x: &[Point3<f64>; K]) -> f64 {
    const STEP: f64 = 1e-5;
    let Some((_, gradient)) = constraint.value_and_gradient(x) else {
        return f64::INFINITY;
    };
    let mut greatest = 0.0_f64;
    for point in 0..K {
        for axis in 0..3 {
            let at = |by: f64| {
                let mut moved = *x;
                moved[point][axis] += by;
                constraint.value(&moved)
            };
            let difference = (at(STEP) - at(-STEP)) / (2.0 * STEP);
            greatest = greatest.max((difference - gradient[point][axis]).abs());
        }
    }
    greatest
}
