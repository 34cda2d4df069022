//! Directions out of a bone at every place inside it \[cervenka2019\], for comparison.

use nalgebra::{Point3, Vector3};

use super::Surface;
use super::broad_phase::bit_grid::{BitGrid, Fill};
use super::broad_phase::boxes::Boxes;
use super::nearest::point_at;
use crate::mesh::TriangleMesh;

/// Greatest change of a box in the last sweep, relative to the source. Below one third the source
/// outweighs all errors, and the potential has no minimum inside.
const RESIDUAL: f64 = 0.1;
/// Greatest number of sweeps for each box along an axis.
const SWEEPS: usize = 100;
/// Greatest number of steps along the field for each box along an axis.
const STEPS: usize = 16;

/// A field of directions inside a bone: the negative gradient of a potential `u` with
/// `laplace u = -1` in the boxes that cover the bone and `u = 0` in all other boxes.
///
/// The potential has no minimum inside, so that its gradient ends at the surface from everywhere
/// except the points where it vanishes, such as the centre of a ball.
#[derive(Clone, Debug)]
pub struct EscapeField {
    boxes: Boxes,
    /// Potential at the centre of each box, in squares of the shortest side of a box.
    potential: Vec<f64>,
}

impl EscapeField {
    /// The field of a mesh on `k` boxes along each axis.
    pub fn new(mesh: &TriangleMesh, k: usize) -> Self {
        let grid = BitGrid::new(mesh, k, Fill::Touch);
        let boxes = grid.boxes().clone();
        let mut field = Self {
            potential: vec![0.0; boxes.len()],
            boxes,
        };
        field.solve(&grid.bone());
        field
    }

    /// Successive over-relaxation in the boxes with the indices `bone`; the outermost boxes are
    /// free.
    fn solve(&mut self, bone: &[usize]) {
        let k = self.boxes.count;
        let strides = [k * k, k, 1];
        let shortest = self.boxes.size.min();
        let weights = self.boxes.size.map(|side| (shortest / side).powi(2));
        let diagonal = 2.0 * weights.sum();
        let factor = 2.0 / (1.0 + libm::sin(std::f64::consts::PI / k as f64));
        for _ in 0..SWEEPS * k {
            let mut settled = true;
            for &index in bone {
                let mut sum = 1.0;
                for (weight, stride) in weights.iter().zip(strides) {
                    sum +=
                        weight * (self.potential[index - stride] + self.potential[index + stride]);
                }
                let change = sum - diagonal * self.potential[index];
                settled &= change.abs() <= RESIDUAL;
                self.potential[index] += factor * change / diagonal;
            }
            if settled {
                break;
            }
        }
    }

    /// Unit direction out of the bone at `point` [m]; `None` away from the bone and where the
    /// gradient vanishes. The potential is trilinear between the centres of eight boxes.
    pub fn direction(&self, point: &Point3<f64>) -> Option<Vector3<f64>> {
        let at = (point - self.boxes.centre([0; 3])).component_div(&self.boxes.size);
        if !(at.min() >= 0.0 && at.max() < (self.boxes.count - 1) as f64) {
            return None;
        }
        let low = at.map(f64::floor);
        let upper = at - low;
        let mut down = Vector3::zeros();
        for corner in 0..8_usize {
            let bits = [corner & 1, corner >> 1 & 1, corner >> 2 & 1];
            let place = std::array::from_fn(|k| low[k] as usize + bits[k]);
            let potential = self.potential[self.boxes.index(place)];
            let share = |k: usize| {
                if bits[k] == 1 {
                    upper[k]
                } else {
                    1.0 - upper[k]
                }
            };
            for k in 0..3 {
                let sign = if bits[k] == 1 { -1.0 } else { 1.0 };
                let others = share((k + 1) % 3) * share((k + 2) % 3);
                down[k] += sign * others * potential / self.boxes.size[k];
            }
        }
        down.try_normalize(0.0)
    }

    /// The place where the path from `point` [m] along the field leaves `surface`, the surface of
    /// the same mesh. A path that finds no way out ends inside.
    pub fn follow(&self, surface: &Surface, point: &Point3<f64>) -> Point3<f64> {
        let step = 0.5 * self.boxes.size.min();
        let mut at = *point;
        for _ in 0..STEPS * self.boxes.count {
            let Some(direction) = self.direction(&at) else {
                break;
            };
            if let Some((triangle, weights)) = surface.first_hit(&at, &direction) {
                let corners = surface.triangles()[triangle as usize];
                let exit = point_at(&corners.map(|v| surface.positions()[v as usize]), &weights);
                if (exit - at).norm() <= step {
                    return exit;
                }
            }
            at += direction * step;
        }
        at
    }

    /// A field of zeros on the same boxes, a negative control.
    #[cfg(test)]
    pub(super) fn without_source(mut self) -> Self {
        self.potential.fill(0.0);
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes::{box_surface, icosphere};
    use crate::testing::Draw;

    #[test]
    fn in_a_ball_the_direction_is_that_of_the_radius() {
        let field = EscapeField::new(&icosphere(1.0, 3), 32);
        let mut draw = Draw::new(91);
        for _ in 0..200 {
            let radius = draw.direction();
            let point = Point3::from(radius * draw.between(0.3, 0.8));
            let out = field.direction(&point).expect("a direction");
            assert!(out.dot(&radius) > 0.97, "{out} at {point}");
        }
        assert_eq!(field.direction(&Point3::new(5.0, 0.0, 0.0)), None);
    }

    #[test]
    fn no_box_inside_is_lower_than_all_its_neighbours() {
        let has_minimum = |field: &EscapeField| {
            let k = field.boxes.count;
            let u = &field.potential;
            let around =
                |i: usize| [i - k * k, i + k * k, i - k, i + k, i - 1, i + 1].map(|j| u[j]);
            (0..u.len()).any(|i| u[i] > 0.0 && around(i).iter().all(|other| *other >= u[i]))
        };
        let mut field = EscapeField::new(&box_surface([1.0, 0.2, 0.5], 0.2), 24);
        assert!(!has_minimum(&field));
        // Control: one box of the middle is lowered.
        let middle = field.boxes.index([12; 3]);
        assert!(field.potential[middle] > 1.0);
        field.potential[middle] = 0.1;
        assert!(has_minimum(&field));
    }
}
