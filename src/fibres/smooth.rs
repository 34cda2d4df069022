//! Smoothing of fibres: points move towards the midpoint of their neighbours; ends stay, and no
//! point leaves the muscle.

use nalgebra::Point3;
use rayon::prelude::*;

use super::solid::Solid;

/// Parameters of the smoothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Smoothing {
    /// Number of passes over all points.
    pub steps: u32,
    /// Share of the distance to the midpoint of both neighbours that a point moves in a pass, 0 to
    /// 1.
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

/// Moves all points but the ends. Each pass uses the positions before the pass: x_i += factor
/// ((x_{i-1} + x_{i+1})/2 - x_i). A point does not move if the move leaves the muscle. The factor
/// is clamped to 0..1.
pub fn smooth(fibres: &mut [Vec<Point3<f64>>], smoothing: Smoothing, solid: &Solid<'_>) {
    let factor = if smoothing.factor >= 0.0 {
        smoothing.factor.min(1.0)
    } else {
        0.0
    };
    fibres.par_iter_mut().for_each(|line| {
        let mut before = line.clone();
        for _ in 0..smoothing.steps {
            before.copy_from_slice(line);
            for (i, three) in before.windows(3).enumerate() {
                let moved = three[1] + (nalgebra::center(&three[0], &three[2]) - three[1]) * factor;
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
        let expected = [
            p(-0.8, 0.1),
            p(-0.2125, 0.325),
            p(0.3, -0.3125),
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
                steps: 500,
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
        // Control: nothing but the wall keeps the points from the chord, which runs outside.
        let chord = nalgebra::center(&line[0], &line[18]);
        assert!(!solid.contains_as_given(&chord));
    }
}
