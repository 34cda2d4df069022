//! The step of one pair, cut short so that its parts stay apart.
//!
//! The height of one part over the other along a fixed normal is a concave function of time if all
//! corners move along straight ways: a minimum of linear functions less a maximum of linear
//! functions. A normal that separates the parts at both ends of a step therefore separates them at
//! all times between.

use nalgebra::{Point3, Vector3};

use super::gap::{Gap, Parts, ROUNDING, gap, height, largest};

/// Share of the height at the start that a step may leave without being cut.
const LEFT: f64 = 0.1;

/// A division plane lies at least at this share of the height from both parts.
const SHARE: f64 = 0.05;

/// The ends that a pair may reach in a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Truncation {
    /// Where the corners end [m].
    pub ends: [Point3<f64>; 4],
    /// The certificate: a unit normal that separates the parts from start to end. `None` if the
    /// parts have no gap at the start, or if fixed corners of both parts move through each other.
    pub normal: Option<Vector3<f64>>,
    /// True if all corners end where they wanted to.
    pub kept: bool,
    /// Number of corners that stay at the start although they wanted to move.
    pub held: usize,
}

/// Cuts the step of a pair from `start` to `wanted` \[m\], so that its parts stay apart on the
/// straight ways of their corners (planar divide and truncate).
///
/// `fixed` corners end where they want to; the others give way. The step is kept if one normal
/// separates the parts at both ends by at least a tenth of the gap at the start: the normal of that
/// gap, that of the gap at the end, or their mean. Otherwise a division plane is placed between the parts, nearer to the part that approaches less,
/// and corners that end beyond it, or nearer to it than a tenth of their distance at the start, are
/// moved back along the normal. Motion along the plane is not cut.
///
/// A pair without a gap has no certificate. Its corners stay at the start, except fixed ones.
///
/// ```
/// use nalgebra::Point3;
/// use pliant::contact::{Parts, truncate};
///
/// // A vertex 1 mm over a fixed triangle wants to move 1 cm down and 2 cm along.
/// let start = [[0.2, 0.2, 1e-3], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]].map(Point3::from);
/// let mut wanted = start;
/// wanted[0] = Point3::new(0.22, 0.2, -9e-3);
/// let step = truncate(Parts::VertexTriangle, &start, &wanted, [false, true, true, true]);
/// assert!((step.ends[0].x - 0.22).abs() <= 1e-12 && step.ends[0].z > 0.0 && !step.kept);
/// ```
pub fn truncate(
    parts: Parts,
    start: &[Point3<f64>; 4],
    wanted: &[Point3<f64>; 4],
    fixed: [bool; 4],
) -> Truncation {
    let Some(gap) = gap(parts, start) else {
        return hold(start, wanted, fixed, None);
    };
    let least = ROUNDING * largest(start).max(largest(wanted));
    let normal = gap.normal;
    let kept = Truncation {
        ends: *wanted,
        normal: Some(normal),
        kept: true,
        held: 0,
    };
    let left = height(parts, wanted, &normal);
    if left >= LEFT * gap.height && left > least {
        return kept;
    }
    if let Some(normal) = common(parts, start, wanted, &gap, least) {
        return Truncation {
            normal: Some(normal),
            ..kept
        };
    }
    let ends = cut(parts, start, wanted, fixed, &normal);
    if height(parts, &ends, &normal) > least {
        return Truncation {
            ends,
            kept: ends == *wanted,
            ..kept
        };
    }
    hold(start, wanted, fixed, Some(normal)).certified(parts, least)
}

/// A normal that separates the parts at both ends of a step: that of the gap at the end, or between
/// those of both gaps.
fn common(
    parts: Parts,
    start: &[Point3<f64>; 4],
    wanted: &[Point3<f64>; 4],
    before: &Gap,
    least: f64,
) -> Option<Vector3<f64>> {
    let after = gap(parts, wanted)?;
    let middle = (before.normal + after.normal).try_normalize(0.5)?;
    [after.normal, middle].into_iter().find(|normal| {
        let heights = [start, wanted].map(|x| height(parts, x, normal));
        heights
            .iter()
            .all(|height| *height >= LEFT * before.height && *height > least)
    })
}

impl Truncation {
    /// Without the certificate if the normal does not separate the ends by more than `least` \[m\].
    fn certified(mut self, parts: Parts, least: f64) -> Self {
        self.normal = self
            .normal
            .filter(|normal| height(parts, &self.ends, normal) > least);
        self
    }
}

/// All corners but the fixed ones stay at the start.
fn hold(
    start: &[Point3<f64>; 4],
    wanted: &[Point3<f64>; 4],
    fixed: [bool; 4],
    normal: Option<Vector3<f64>>,
) -> Truncation {
    let mut held = 0;
    let ends = std::array::from_fn(|k| {
        if fixed[k] {
            return wanted[k];
        }
        held += usize::from(start[k] != wanted[k]);
        start[k]
    });
    Truncation {
        ends,
        normal,
        kept: held == 0,
        held,
    }
}

/// The ends of corners that stay on their side of a division plane.
fn cut(
    parts: Parts,
    start: &[Point3<f64>; 4],
    wanted: &[Point3<f64>; 4],
    fixed: [bool; 4],
    normal: &Vector3<f64>,
) -> [Point3<f64>; 4] {
    let mut ends = *wanted;
    // Heights over a corner; the lowest of the first part and the highest of the second one, at the
    // start and, of fixed corners, at the end; the greatest approach of each part.
    let (mut high, mut low) = (f64::INFINITY, f64::NEG_INFINITY);
    let mut approach = [0.0_f64; 2];
    let mut after = [0.0; 4];
    for k in 0..4 {
        let before = (start[k] - start[0]).dot(normal);
        after[k] = (wanted[k] - start[0]).dot(normal);
        let reached = if fixed[k] { after[k] } else { before };
        if k < parts.first() {
            high = high.min(before).min(reached);
            approach[0] = approach[0].max(before - after[k]);
        } else {
            low = low.max(before).max(reached);
            approach[1] = approach[1].max(after[k] - before);
        }
    }
    let sum = approach[0] + approach[1];
    let share = if sum > 0.0 { approach[1] / sum } else { 0.5 };
    let plane = low + share.clamp(SHARE, 1.0 - SHARE) * (high - low);
    let (floor, ceiling) = (plane + LEFT * (high - plane), plane - LEFT * (plane - low));
    for k in (0..4).filter(|k| !fixed[*k]) {
        let lift = if k < parts.first() {
            (floor - after[k]).max(0.0)
        } else {
            (ceiling - after[k]).min(0.0)
        };
        if lift != 0.0 {
            ends[k] += normal * lift;
        }
    }
    ends
}
