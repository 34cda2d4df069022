//! Certified continuous collision detection of a vertex and a triangle, or of two edges, whose
//! corners move along straight ways.
//!
//! Conservative advancement along separating normals. At a time with a gap, the height along the
//! normal of the gap is a concave function of the remaining time, and each pair of corners bounds
//! it: it is the least of at most four linear functions. The parts are apart until the first of
//! these falls to a tenth of the height, and from there the next normal is sought. No equation is
//! solved, and no time is skipped without a normal.
//!
//! Rounding. Let L be the greatest coordinate at start and end. Corners at a time between are off
//! by at most 2.5 eps L in a component, heights by 9 eps L for that reason and by 14 eps L of their
//! own, approaches by 17 eps L, the next time by 8 eps L over the speed: less than 48 eps L in the
//! height. The height that is left after an advance is at least 64 eps L. So it is positive in real
//! numbers, and a way on which the parts touch is never called free.

use nalgebra::{Point3, Vector3};

use super::gap::{Gap, Parts, ROUNDING, gap_above, largest};

/// The share of a height that an advance leaves, unless it is below rounding.
const LEFT: f64 = 0.1;

/// Greatest number of advances.
const ADVANCES: usize = 1 << 14;

/// What happens to a pair in a step. Times are shares of the step, from 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Impact {
    /// The parts are apart at all times.
    Free,
    /// The parts are apart before this time, and nearer than the tolerance at it. They may touch at
    /// it or later, or may not.
    Near(f64),
    /// The parts are apart before this time. What follows was not found out in the allowed number
    /// of advances, or coordinates are not finite.
    Undecided(f64),
}

impl Impact {
    /// The time before which the parts are certainly apart.
    pub fn apart_before(self) -> f64 {
        match self {
            Self::Free => 1.0,
            Self::Near(time) | Self::Undecided(time) => time,
        }
    }
}

/// The first time at which the parts of a pair are nearer than `tolerance` \[m\], if corners move
/// along straight ways from `start` to `end` \[m\] in common time.
///
/// Certified: parts that touch or cross at any time, however briefly, are never called free, and
/// no time of contact is before the one returned. A tolerance below 1000 eps of the greatest
/// coordinate means that bound, because rounding hides smaller gaps. Parts may be degenerate: edges
/// without length, triangles without area.
///
/// ```
/// use nalgebra::{Point3, Vector3};
/// use pliant::contact::{Impact, Parts, time_of_impact};
///
/// // An edge falls by 1 m on another edge, half a metre below it.
/// let start = [[-1.0, 0.0, 0.5], [1.0, 0.0, 0.5], [0.0, -1.0, 0.0], [0.0, 1.0, 0.0]].map(Point3::from);
/// let mut end = start;
/// end[..2].iter_mut().for_each(|p| *p -= Vector3::z());
/// let Impact::Near(time) = time_of_impact(Parts::EdgeEdge, &start, &end, 1e-6) else {
///     panic!("they meet")
/// };
/// assert!(time <= 0.5 && time > 0.5 - 2e-6);
/// ```
pub fn time_of_impact(
    parts: Parts,
    start: &[Point3<f64>; 4],
    end: &[Point3<f64>; 4],
    tolerance: f64,
) -> Impact {
    advance(parts, start, end, tolerance, Advance::default()).0
}

/// The numbers on which the guarantee rests. Tests break them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Advance {
    /// Rounding of a difference of heights, relative to the greatest coordinate.
    pub rounding: f64,
    /// The share of a height that an advance leaves.
    pub left: f64,
}

impl Default for Advance {
    fn default() -> Self {
        Self {
            rounding: ROUNDING,
            left: LEFT,
        }
    }
}

/// [`time_of_impact`] by other numbers, and the number of gaps that were computed.
pub fn advance(
    parts: Parts,
    start: &[Point3<f64>; 4],
    end: &[Point3<f64>; 4],
    tolerance: f64,
    by: Advance,
) -> (Impact, usize) {
    let size = largest(start).max(largest(end));
    if start
        .iter()
        .chain(end)
        .any(|p| p.coords.iter().any(|c| !c.is_finite()))
    {
        return (Impact::Undecided(0.0), 0);
    }
    // Numbers near the smallest one have no relative rounding: they count as touching.
    let smallest = f64::MIN_POSITIVE / f64::EPSILON / f64::EPSILON;
    let least = (by.rounding * size).max(smallest);
    let near = (2.0 * least).max(tolerance);
    let motion: [Vector3<f64>; 4] = std::array::from_fn(|k| end[k] - start[k]);
    let (mut time, mut x) = (0.0, *start);
    for advances in 1..=ADVANCES {
        let Some(gap) = gap_above(parts, &x, near) else {
            return (Impact::Near(time), advances);
        };
        let left = (by.left * gap.height).max(by.left.signum() * least);
        match free_for(parts, &x, &motion, &gap, left) {
            Some(further) if time + further < 1.0 => time += further,
            _ => return (Impact::Free, advances),
        }
        x = std::array::from_fn(|k| start[k] + motion[k] * time);
    }
    (Impact::Undecided(time), ADVANCES)
}

/// The time until the height along the normal of the gap falls to `left` \[m\]; `None` if it never
/// does.
fn free_for(
    parts: Parts,
    x: &[Point3<f64>; 4],
    motion: &[Vector3<f64>; 4],
    gap: &Gap,
    left: f64,
) -> Option<f64> {
    let mut first: Option<f64> = None;
    for i in 0..parts.first() {
        for j in parts.first()..4 {
            let over = (x[i] - x[j]).dot(&gap.normal);
            let approach = (motion[j] - motion[i]).dot(&gap.normal);
            if approach > 0.0 {
                let time = (over - left) / approach;
                first = Some(first.map_or(time, |first| first.min(time)));
            }
        }
    }
    first
}
