//! Smoothing of fibres that does not shrink them: bends of few points are evened out, and bends of
//! the whole fibre stay; ends stay, and no point leaves the muscle.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::solid::Solid;

/// Parameters of the smoothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Smoothing {
    /// Number of passes over all points.
    pub steps: u32,
    /// Share of the sharpest zigzag that a pass removes, 0 to 1.
    pub factor: f64,
}

impl Default for Smoothing {
    fn default() -> Self {
        Self {
            steps: 0,
            factor: 0.5,
        }
    }
}

/// Moves all points but the ends. Each pass uses the positions before the pass: x_i -= factor/4
/// (d_i - (d_{i-1} + d_{i+1})/2), with d_i = x_i - (x_{i-1} + x_{i+1})/2, and 0 at the ends. A bend
/// of wave length n points loses the share factor/4 (1 - cos 2 pi/n)^2 in a pass: of 15 points, a
/// zigzag loses all with factor 1, and the bend of the whole fibre a six-thousandth. With
/// d alone in place of its difference the fibre shrinks: a fortieth of that bend goes in a pass.
/// A point does not move if the move leaves the muscle. The factor is clamped to 0..1.
pub fn smooth(fibres: &mut [Vec<Point3<f64>>], smoothing: Smoothing, solid: &Solid<'_>) {
    let factor = if smoothing.factor >= 0.0 {
        smoothing.factor.min(1.0)
    } else {
        0.0
    };
    fibres.par_iter_mut().for_each(|line| {
        // How far each point lies from the middle of its neighbours.
        let mut off = vec![Vector3::zeros(); line.len()];
        for _ in 0..smoothing.steps {
            for (i, three) in line.windows(3).enumerate() {
                off[i + 1] = three[1] - nalgebra::center(&three[0], &three[2]);
            }
            for (i, off) in off.windows(3).enumerate() {
                let moved = line[i + 1] - (off[1] - (off[0] + off[2]) * 0.5) * (0.25 * factor);
                // A point that a wall has positioned stays on that wall.
                if solid.contains_as_given(&moved) {
                    line[i + 1] = moved;
                }
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fibres::polyline::length;
    use crate::fibres::solid::Closed;
    use crate::mesh::shapes::{box_surface, tube};

    #[test]
    fn a_pass_is_the_formula_and_ends_stay() {
        let closed = Closed::new(&box_surface([2.0, 2.0, 2.0], 0.5));
        let p = |x: f64, y: f64| Point3::new(x, y, 0.0);
        let mut fibres = vec![vec![p(-0.8, 0.1), p(-0.2, 0.5), p(0.3, -0.5), p(0.8, 0.0)]];
        smooth(
            &mut fibres,
            Smoothing {
                steps: 1,
                factor: 0.25,
            },
            &closed.solid(),
        );
        // The points lie (0.05, 0.7) and (0, -0.75) from the middles of their neighbours.
        let expected = [
            p(-0.8, 0.1),
            p(-0.2 - 0.0625 * 0.05, 0.5 - 0.0625 * (0.7 + 0.375)),
            p(0.3 + 0.0625 * 0.025, -0.5 + 0.0625 * (0.75 + 0.35)),
            p(0.8, 0.0),
        ];
        for (found, expected) in fibres[0].iter().zip(&expected) {
            // A few roundings of a size of 1.
            assert!((found - expected).norm() <= 8.0 * f64::EPSILON, "{found}");
        }
        let before = fibres.clone();
        for none in [
            Smoothing {
                steps: 0,
                factor: 0.5,
            },
            Smoothing {
                steps: 9,
                factor: 0.0,
            },
        ] {
            smooth(&mut fibres, none, &closed.solid());
            assert_eq!(fibres, before);
        }
        smooth(
            &mut fibres,
            Smoothing {
                steps: 5_000,
                factor: 0.5,
            },
            &closed.solid(),
        );
        let straight = (before[0][3] - before[0][0]).norm();
        assert!(
            (length(&fibres[0]) - straight).abs() <= 1e-9 * straight,
            "{fibres:?}"
        );
    }

    #[test]
    fn no_point_leaves_a_bent_muscle() {
        let mut mesh = tube(0.02, 0.2, 16);
        mesh.vertices
            .iter_mut()
            .for_each(|v| v.y += 8.0 * v.x * v.x);
        let closed = Closed::new(&mesh);
        let solid = closed.solid();
        let line: Vec<Point3<f64>> = (-9..=9)
            .map(|k| 0.01 * f64::from(k))
            .map(|x| Point3::new(x, 8.0 * x * x, 0.0))
            .collect();
        let mut fibres = vec![line.clone()];
        smooth(
            &mut fibres,
            Smoothing {
                steps: 2_000,
                factor: 1.0,
            },
            &solid,
        );
        assert!(fibres[0].iter().all(|p| solid.contains_as_given(p)));
        assert!(length(&fibres[0]) < length(&line));
        // What twenty passes do to the bend of the whole fibre, and to a zigzag on it.
        let mut few = vec![line.clone()];
        few[0]
            .iter_mut()
            .skip(1)
            .step_by(2)
            .take(8)
            .for_each(|p| p.y += 0.001);
        let twenty = Smoothing {
            steps: 20,
            factor: 0.5,
        };
        smooth(&mut few, twenty, &solid);
        let middle = |line: &[Point3<f64>]| line[9].y - 0.5 * (line[0].y + line[18].y);
        assert!((middle(&few[0]) / middle(&line) - 1.0).abs() <= 0.02);
        let rough = |line: &[Point3<f64>]| {
            let third = |w: &[Point3<f64>]| (w[3].y - 3.0 * w[2].y + 3.0 * w[1].y - w[0].y).abs();
            crate::mesh::measures::max_or_nan(line.windows(4).map(third))
        };
        assert!(rough(&few[0]) <= 0.1 * 0.008, "{}", rough(&few[0]));
        // Control: nothing but the wall keeps the points from the chord, which runs outside.
        let chord = nalgebra::center(&line[0], &line[18]);
        assert!(!solid.contains_as_given(&chord));
    }
}
