//! A map from a square to a contour: corners of the contour map to the square by arc length; points
//! of the square have mean-value coordinates over the mapped corners.

use nalgebra::{Point2, Vector2};

/// Tolerance for points on a side of the square.
const ON_SIDE: f64 = 1e-12;

/// A contour and the positions of its corners on the unit square.
#[derive(Clone, Debug)]
pub struct Outline {
    /// Corners of the contour and the four images of the square's corners \[m\], in order from the
    /// square's corner (0, 0).
    contour: Vec<Point2<f64>>,
    /// Share of the perimeter of each, in ascending order from 0.
    shares: Vec<f64>,
    /// Positions on the square.
    square: Vec<Point2<f64>>,
}

/// The point of the unit square at a share of its perimeter, counter-clockwise from (0, 0).
pub fn on_square(share: f64) -> Point2<f64> {
    let position = 4.0 * share.clamp(0.0, 1.0);
    match position {
        w if w <= 1.0 => Point2::new(w, 0.0),
        w if w <= 2.0 => Point2::new(1.0, w - 1.0),
        w if w <= 3.0 => Point2::new(3.0 - w, 1.0),
        w => Point2::new(0.0, 4.0 - w),
    }
}

/// The share of the perimeter of a point on the square's boundary.
fn share_of(p: &Point2<f64>) -> Option<f64> {
    let on = |a: f64, b: f64| (a - b).abs() <= ON_SIDE;
    if on(p.y, 0.0) {
        Some(0.25 * p.x)
    } else if on(p.x, 1.0) {
        Some(0.25 * (1.0 + p.y))
    } else if on(p.y, 1.0) {
        Some(0.25 * (3.0 - p.x))
    } else if on(p.x, 0.0) {
        Some(0.25 * (4.0 - p.y))
    } else {
        None
    }
}

impl Outline {
    /// Creates the map for a counter-clockwise contour with at least one point.
    pub fn new(contour: &[Point2<f64>]) -> Self {
        let line = from_corner(contour);
        let mut arcs = vec![0.0];
        for (a, b) in line.iter().zip(line.iter().cycle().skip(1)) {
            arcs.push(arcs[arcs.len() - 1] + (b - a).norm());
        }
        let total = arcs[arcs.len() - 1];
        let share = |k: usize| {
            if total > 0.0 {
                arcs[k] / total
            } else {
                k as f64 / line.len() as f64
            }
        };
        let at = |k: usize| line[k % line.len()];
        let mut outline = Self {
            contour: Vec::new(),
            shares: Vec::new(),
            square: Vec::new(),
        };
        for k in 0..line.len() {
            outline.push(at(k), share(k));
            // Includes the square's corners, so that the mapped corners bound the whole square.
            for corner in [0.25, 0.5, 0.75] {
                if share(k) < corner && corner < share(k + 1) {
                    let within = (corner - share(k)) / (share(k + 1) - share(k));
                    outline.push(at(k) + (at(k + 1) - at(k)) * within, corner);
                }
            }
        }
        outline
    }

    fn push(&mut self, point: Point2<f64>, share: f64) {
        self.contour.push(point);
        self.shares.push(share);
        self.square.push(on_square(share));
    }

    /// The image of a point of the unit square.
    pub fn of(&self, p: &Point2<f64>) -> Point2<f64> {
        match share_of(p) {
            Some(share) => self.along(share),
            None => self.inner(p),
        }
    }

    /// The point of the contour at a share of the perimeter.
    fn along(&self, share: f64) -> Point2<f64> {
        let after = self.shares.partition_point(|s| *s <= share);
        let before = after.saturating_sub(1);
        let (next, end) = (
            after % self.contour.len(),
            if after < self.shares.len() {
                self.shares[after]
            } else {
                1.0
            },
        );
        let span = end - self.shares[before];
        let within = if span > 0.0 {
            (share - self.shares[before]) / span
        } else {
            0.0
        };
        self.contour[before] + (self.contour[next] - self.contour[before]) * within
    }

    /// Interpolates by mean-value coordinates: weights (tan(a/2) + tan(b/2)) / distance, where a
    /// and b are the angles to the neighbours.
    fn inner(&self, p: &Point2<f64>) -> Point2<f64> {
        let n = self.square.len();
        let to: Vec<Vector2<f64>> = self.square.iter().map(|q| q - p).collect();
        let half = |k: usize| {
            let (a, b) = (to[k], to[(k + 1) % n]);
            let cross = a.x * b.y - a.y * b.x;
            // tan(x/2) = sin x / (1 + cos x); the angle between neighbours is at most pi.
            cross / (a.norm() * b.norm() + a.dot(&b))
        };
        let tangents: Vec<f64> = (0..n).map(half).collect();
        let (mut sum, mut weights) = (Vector2::zeros(), 0.0);
        for k in 0..n {
            let weight = (tangents[(k + n - 1) % n] + tangents[k]) / to[k].norm();
            sum += self.contour[k].coords * weight;
            weights += weight;
        }
        Point2::from(sum / weights)
    }
}

/// The contour, starting nearest to the corner (0, 0) of its bounding box: where the ray from the
/// centre to that corner leaves it or, if the ray hits nothing, at the corner farthest in that
/// direction.
fn from_corner(contour: &[Point2<f64>]) -> Vec<Point2<f64>> {
    let low = contour
        .iter()
        .fold(Vector2::repeat(f64::INFINITY), |m, p| m.inf(&p.coords));
    let high = contour
        .iter()
        .fold(Vector2::repeat(f64::NEG_INFINITY), |m, p| m.sup(&p.coords));
    let (middle, towards) = ((low + high) * 0.5, low - high);
    let n = contour.len();
    let side = |p: &Point2<f64>| towards.x * (p.y - middle.y) - towards.y * (p.x - middle.x);
    let mut best: Option<(f64, usize, Point2<f64>)> = None;
    for k in 0..n {
        let (a, b) = (contour[k], contour[(k + 1) % n]);
        let (da, db) = (side(&a), side(&b));
        if (da < 0.0) == (db < 0.0) {
            continue;
        }
        let hit = a + (b - a) * (da / (da - db));
        let out = (hit.coords - middle).dot(&towards);
        if out > 0.0 && best.is_none_or(|(most, ..)| out > most) {
            best = Some((out, k, hit));
        }
    }
    match best {
        Some((_, k, hit)) => std::iter::once(hit)
            .chain((1..=n).map(|m| contour[(k + m) % n]).filter(|p| *p != hit))
            .collect(),
        None => {
            let out = |k: &usize| (contour[*k].coords - middle).dot(&towards);
            let start = (0..n).max_by(|a, b| out(a).total_cmp(&out(b))).unwrap_or(0);
            (0..n).map(|m| contour[(start + m) % n]).collect()
        }
    }
}
