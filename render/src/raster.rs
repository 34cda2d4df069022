//! Rasterisation of triangles: the covered samples, with the weights of the corners.
//!
//! Corners are rounded once to a grid of 1/256 sample; coverage is then exact integer arithmetic. A
//! sample on an edge belongs to the triangle for which the edge is a top or left one. Triangles
//! with a common edge therefore cover each sample on it exactly once.

use std::ops::Range;

/// Grid steps per sample.
pub(super) const GRID: i64 = 256;

/// Corners are clamped to this many samples from the picture's origin, so that products of their
/// differences fit.
pub(super) const FARTHEST: f64 = (1 << 20) as f64;

/// A triangle on the grid, in the order with a positive doubled area (x right, y down).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct GridTriangle {
    x: [i32; 3],
    y: [i32; 3],
}

/// The triangle, and whether two corners were swapped for a positive area.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Oriented {
    pub triangle: GridTriangle,
    pub swapped: bool,
}

impl GridTriangle {
    /// Rounds corners [sample] to the grid. `None` for a triangle without area on the grid, or with
    /// NaN.
    pub fn on_grid(corners: [[f64; 2]; 3]) -> Option<Oriented> {
        if corners.iter().flatten().any(|c| c.is_nan()) {
            return None;
        }
        let on_grid = |c: f64| (c.clamp(-FARTHEST, FARTHEST) * GRID as f64).round() as i32;
        let triangle = Self {
            x: corners.map(|c| on_grid(c[0])),
            y: corners.map(|c| on_grid(c[1])),
        };
        match triangle.doubled_area().signum() {
            1 => Some(Oriented {
                triangle,
                swapped: false,
            }),
            -1 => {
                let Self {
                    x: [xa, xb, xc],
                    y: [ya, yb, yc],
                } = triangle;
                Some(Oriented {
                    triangle: Self {
                        x: [xa, xc, xb],
                        y: [ya, yc, yb],
                    },
                    swapped: true,
                })
            }
            _ => None,
        }
    }

    fn doubled_area(&self) -> i64 {
        let [xa, xb, xc] = self.x.map(i64::from);
        let [ya, yb, yc] = self.y.map(i64::from);
        (xb - xa) * (yc - ya) - (yb - ya) * (xc - xa)
    }

    /// The rows whose centres the triangle can cover, signed.
    pub fn rows(&self) -> Range<i64> {
        covered(&self.y)
    }

    /// Calls `fill(column, row, weights of the corners)` for each covered sample inside both
    /// ranges. Clipping uses signed integers, and the weights follow from the position of the
    /// sample alone: a cut at the border shifts nothing along a row (errata G9, G10, G13).
    pub fn fill(
        &self,
        columns: Range<i64>,
        rows: Range<i64>,
        mut fill: impl FnMut(usize, usize, [f64; 3]),
    ) {
        let inverse = 1.0 / self.doubled_area() as f64;
        let edges = [self.edge(1, 2), self.edge(2, 0), self.edge(0, 1)];
        let across = covered(&self.x);
        let across = across.start.max(columns.start).max(0)..across.end.min(columns.end);
        let down = self.rows();
        for row in down.start.max(rows.start).max(0)..down.end.min(rows.end) {
            let starts = edges.map(|edge| edge.at_row(row));
            let span = edges
                .iter()
                .zip(starts)
                .fold(across.clone(), |span, (edge, start)| {
                    edge.narrow(span, start)
                });
            for column in span {
                let weights: [f64; 3] =
                    std::array::from_fn(|k| (starts[k] + edges[k].step * column) as f64 * inverse);
                fill(column as usize, row as usize, weights);
            }
        }
    }

    fn edge(&self, from: usize, to: usize) -> Edge {
        let [xa, ya, xb, yb] = [self.x[from], self.y[from], self.x[to], self.y[to]].map(i64::from);
        let (dx, dy) = (xb - xa, yb - ya);
        // With a positive area the inside is to the right of the edge: a rising edge is a left
        // edge.
        let owns_its_samples = dy < 0 || (dy == 0 && dx > 0);
        Edge {
            step: -dy * GRID,
            row_step: dx * GRID,
            origin: dx * (GRID / 2 - ya) - dy * (GRID / 2 - xa),
            least: if owns_its_samples { 0 } else { 1 },
        }
    }
}

/// The samples whose centres lie between the least and the greatest coordinate, with at most one
/// more at each end.
fn covered(coordinates: &[i32; 3]) -> Range<i64> {
    let [a, b, c] = coordinates.map(i64::from);
    (a.min(b).min(c) - GRID / 2).div_euclid(GRID)..(a.max(b).max(c) - GRID / 2).div_euclid(GRID) + 1
}

/// An edge function over sample centres: `origin + step column + row_step row`, inside where at
/// least `least`.
#[derive(Clone, Copy)]
struct Edge {
    step: i64,
    row_step: i64,
    origin: i64,
    least: i64,
}

impl Edge {
    fn at_row(&self, row: i64) -> i64 {
        self.origin + self.row_step * row
    }

    /// The columns of `span` inside, where `start` is the value at column 0. Never divides by zero
    /// (erratum G11).
    fn narrow(&self, span: Range<i64>, start: i64) -> Range<i64> {
        let room = start - self.least;
        match self.step.signum() {
            1 => span.start.max(-room.div_euclid(self.step))..span.end,
            -1 => span.start..span.end.min(room.div_euclid(-self.step) + 1),
            _ if room >= 0 => span,
            _ => 0..0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeMap;

    fn samples(
        corners: [[f64; 2]; 3],
        width: i64,
        height: i64,
    ) -> BTreeMap<(usize, usize), [f64; 3]> {
        let mut found = BTreeMap::new();
        if let Some(oriented) = GridTriangle::on_grid(corners) {
            oriented
                .triangle
                .fill(0..width, 0..height, |x, y, weights| {
                    assert_eq!(found.insert((x, y), weights), None, "a sample filled twice");
                });
        }
        found
    }

    /// Interpolates values at the corners to a sample, in the order of the corners of [`samples`].
    fn value(corners: [[f64; 2]; 3], at: (usize, usize), values: [f64; 3]) -> f64 {
        let swapped = GridTriangle::on_grid(corners).expect("has an area").swapped;
        let [a, b, c] = samples(corners, 400, 400)[&at];
        let [va, vb, vc] = if swapped {
            [values[0], values[2], values[1]]
        } else {
            values
        };
        a * va + b * vb + c * vc
    }

    /// Erratum G9: a span from x = -100 to 100 with z from 0 to 200 was started at x = 0 with z = 0 and gradient 2,
    /// so that z(50) = 100. Right is 150.
    #[test]
    fn g9_negative_x_advances_depth_and_brightness() {
        let corners = [[-100.5, -100.0], [-100.5, 100.0], [99.5, 0.0]];
        let z = value(corners, (49, 0), [0.0, 0.0, 200.0]);
        assert!((z - 150.0).abs() < 1e-9, "{z}");
    }

    /// Erratum G10: sides in the other order underflowed or made the triangle vanish. Every order of the corners, and
    /// a triangle whose sides meet at the top, cover the same samples.
    #[test]
    fn g10_sides_in_any_order() {
        let [a, b, c] = [[20.0, 1.3], [3.7, 17.9], [33.1, 28.4]];
        let expected: Vec<_> = samples([a, b, c], 40, 40).into_keys().collect();
        assert!(expected.len() > 200);
        for order in [[a, c, b], [b, a, c], [b, c, a], [c, a, b], [c, b, a]] {
            assert_eq!(
                samples(order, 40, 40).into_keys().collect::<Vec<_>>(),
                expected
            );
        }
    }

    /// Erratum G11: zero-width spans and horizontal edges divided by zero.
    #[test]
    fn g11_no_width_no_area_no_division() {
        for corners in [
            [[5.0, 5.0]; 3],
            [[5.0, 1.0], [5.0, 9.0], [5.0, 4.0]],
            [[1.0, 5.0], [9.0, 5.0], [4.0, 5.0]],
            [[1.0, 1.0], [9.0, 9.0], [4.0, 4.0]],
        ] {
            assert!(samples(corners, 10, 10).is_empty());
        }
        for weights in samples([[0.0, 0.0], [10.0, 0.0], [0.0, 10.0]], 10, 10).values() {
            assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            assert!(weights.iter().all(|w| (0.0..=1.0).contains(w)));
        }
    }

    /// Erratum G13: y as i16 took 40,000 to 32,767, rows shared by two halves were drawn twice, and off-screen rows
    /// were walked one by one.
    #[test]
    fn g13_far_corners_and_rows_drawn_once() {
        let corners = [[5.0, -1e300], [-4e4, 4e4], [4e4, 4e4]];
        assert_eq!(samples(corners, 10, 10).len(), 100);
        assert!(samples([[0.0, f64::NAN], [1.0, 0.0], [0.0, 1.0]], 10, 10).is_empty());
        // A square of two triangles with a shared horizontal edge: each row once.
        let (upper, lower) = (
            [[0.0, 5.0], [5.0, 0.0], [10.0, 5.0]],
            [[0.0, 5.0], [10.0, 5.0], [5.0, 10.0]],
        );
        let (upper, lower) = (samples(upper, 10, 10), samples(lower, 10, 10));
        assert!(upper.keys().all(|k| !lower.contains_key(k)));
        assert_eq!(upper.len() + lower.len(), 50);
    }

    /// A square with corners on sample centres covers only the samples of its upper and left sides.
    #[test]
    fn top_and_left_edges_own_their_samples() {
        let [a, b, c, d] = [[1.5, 1.5], [3.5, 1.5], [3.5, 3.5], [1.5, 3.5]];
        let mut both: Vec<_> = [[a, b, c], [a, c, d]]
            .into_iter()
            .flat_map(|t| samples(t, 9, 9).into_keys())
            .collect();
        both.sort_unstable();
        assert_eq!(both, [(1, 1), (1, 2), (2, 1), (2, 2)]);
    }

    /// Corners often on the half-integer grid of sample centres, where the fill rule matters.
    fn coordinate() -> impl Strategy<Value = f64> {
        prop_oneof![-6.0..22.0f64, (-12..44i32).prop_map(|i| f64::from(i) / 2.0)]
    }

    fn corner() -> impl Strategy<Value = [f64; 2]> {
        prop::array::uniform2(coordinate())
    }

    fn side(a: [f64; 2], b: [f64; 2], p: [f64; 2]) -> f64 {
        (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])
    }

    proptest! {
        /// Two triangles on the two sides of an edge: they share no sample, and every sample centre
        /// strictly inside the quadrilateral is in one of them.
        #[test]
        fn a_shared_edge_is_drawn_exactly_once(a in corner(), b in corner(), c in corner(), d in corner()) {
            let on_grid = |p: [f64; 2]| p.map(|c| (c * GRID as f64).round() / GRID as f64);
            let [a, b, c, d] = [a, b, c, d].map(on_grid);
            prop_assume!(side(a, b, c) * side(a, b, d) < 0.0);
            let (one, two) = (samples([a, b, c], 16, 16), samples([b, a, d], 16, 16));
            prop_assert!(one.keys().all(|k| !two.contains_key(k)));
            for x in 0..16usize {
                for y in 0..16usize {
                    let p = [x as f64 + 0.5, y as f64 + 0.5];
                    let inside = |t: [[f64; 2]; 3]| {
                        let s = [side(t[0], t[1], p), side(t[1], t[2], p), side(t[2], t[0], p)];
                        (s.iter().all(|v| *v >= 0.0) || s.iter().all(|v| *v <= 0.0), s.contains(&0.0))
                    };
                    let (in_one, border_one) = inside([a, b, c]);
                    let (in_two, border_two) = inside([a, b, d]);
                    let drawn = one.contains_key(&(x, y)) || two.contains_key(&(x, y));
                    let on_shared_edge = in_one && in_two && side(c, d, p) != 0.0
                        && side(a, c, p) != 0.0 && side(b, c, p) != 0.0 && side(a, d, p) != 0.0 && side(b, d, p) != 0.0;
                    if (in_one && !border_one) || (in_two && !border_two) || on_shared_edge {
                        prop_assert!(drawn, "({}, {}) left out", x, y);
                    }
                    if !in_one && !in_two {
                        prop_assert!(!drawn, "({}, {}) too much", x, y);
                    }
                }
            }
        }

        /// Arbitrary numbers: no panic, and nothing outside the picture.
        #[test]
        fn any_coordinates(corners in prop::array::uniform3(prop::array::uniform2(any::<f64>()))) {
            prop_assert!(samples(corners, 16, 16).keys().all(|&(x, y)| x < 16 && y < 16));
        }
    }
}
