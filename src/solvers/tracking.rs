//! The energy of a deviation from a prescribed shape. The prescribed shape follows from the motion
//! of the bones alone. This energy keeps a muscle as close to it as contact and volume permit.

use nalgebra::Point3;

use crate::constraints::Stencils;
use crate::constraints::spring::{Displacement, Linear, Spring};
use crate::constraints::stencil::at;

/// The energy `sum k |d_a - d_b|^2 / 2` over edges, with `d` the displacement from the target: a
/// membrane of corrections. The energy is quadratic. Without obstacles its minimum is therefore
/// unique and changes smoothly with the target.
pub type Tracking = Stencils<Spring<Displacement, Linear>, 2>;

/// Edges with a stiffness [N/m] each and a target position [m] for each vertex. The scale of forces
/// is the force of an edge of the target at a strain of one.
pub fn tracking(edges: &[[u32; 2]], stiffness: &[f64], target: &[Point3<f64>]) -> Tracking {
    let tie = |(&points, &stiffness): (&[u32; 2], &f64)| {
        let targets = at(points, target);
        let force_scale = stiffness * (targets[0] - targets[1]).norm();
        Spring {
            arm: Displacement { points, targets },
            law: Linear {
                stiffness,
                force_scale,
            },
        }
    };
    Stencils::new("tracking", edges.iter().zip(stiffness).map(tie).collect())
}

/// The same edges with another target [m].
pub fn toward(tracking: &Tracking, target: &[Point3<f64>]) -> Tracking {
    let drawn = |tie: &Spring<Displacement, Linear>| {
        let points = tie.arm.points;
        let targets = at(points, target);
        Spring {
            arm: Displacement { points, targets },
            ..*tie
        }
    };
    Stencils::new("tracking", tracking.terms().iter().map(drawn).collect())
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::constraints::Potential;
    use crate::mesh::measures::max_or_nan;
    use crate::testing::Draw;

    fn drawn() -> (Tracking, Vec<Point3<f64>>) {
        let mut draw = Draw::new(3);
        let edges = vec![[0, 1], [1, 2], [2, 3], [0, 3], [1, 3]];
        let stiffness: Vec<f64> = (0..5).map(|_| draw.between(10.0, 300.0)).collect();
        (tracking(&edges, &stiffness, &draw.shape(4)), draw.shape(4))
    }

    #[test]
    fn the_gradient_is_that_of_the_energy_and_the_hessian_that_of_the_gradient() {
        let (part, x) = drawn();
        let mut gradient = vec![Vector3::zeros(); 4];
        let energy = part.energy_and_gradient(&x, &mut gradient);
        let mut hessian = nalgebra::Matrix4::<f64>::zeros();
        part.scalar_hessian(&x, &mut |a, b, k| hessian[(a as usize, b as usize)] += k);
        // Differences of a quadratic are exact for any step, except for rounding.
        let h = 0.5;
        for v in 0..4 {
            for c in 0..3 {
                let (mut up, mut down) = (x.clone(), x.clone());
                up[v][c] += h;
                down[v][c] -= h;
                let slope = (part.energy(&up) - part.energy(&down)) / (2.0 * h);
                assert!(
                    (slope - gradient[v][c]).abs() <= 1e-13 * energy / h,
                    "{slope} {}",
                    gradient[v][c]
                );
                assert!(
                    (slope - 1.01 * gradient[v][c]).abs() > 1e-13 * energy / h,
                    "control"
                );
                let mut there = vec![Vector3::zeros(); 4];
                part.energy_and_gradient(&up, &mut there);
                for w in 0..4 {
                    let change = (there[w][c] - gradient[w][c]) / h;
                    assert!((change - hessian[(w, v)]).abs() <= 1e-13 * energy / (h * h));
                }
            }
        }
    }

    #[test]
    fn a_shifted_target_costs_nothing_and_is_where_it_rests() {
        let (part, x) = drawn();
        let shifted: Vec<Point3<f64>> = x
            .iter()
            .map(|p| p + Vector3::new(0.25, -0.5, 1.0))
            .collect();
        let part = toward(&part, &shifted);
        let size = max_or_nan(x.iter().map(|p| p.coords.norm())) + 1.25;
        assert!(part.energy(&x) <= 300.0 * 5.0 * (8.0 * f64::EPSILON * size).powi(2));
        assert!(drawn().0.energy(&x) > 1e-3, "control");
    }
}
