//! The methods of detection, asked for the same signed distances.

use std::time::{Duration, Instant};

use super::{Query, ROUNDING, size};
use crate::contact::broad_phase::{BitGrid, BroadPhase, Fill, METHODS, Searched};
use crate::contact::{Obstacle, Surface};
use crate::mesh::TriangleMesh;
use crate::mesh::measures::max_or_nan;

/// Boxes of the bit grid along each axis.
const BITS: usize = 64;
/// Number of queries between two looks at the clock.
const CHUNK: usize = 16;

/// A method, prepared for a bone.
pub enum Prepared {
    /// The hierarchy of the library.
    Own(Box<Surface>),
    /// A list of triangles in boxes or cells, or all triangles.
    Lists(Box<Searched>),
    /// Boxes that are bone or free; these have an error.
    Bits(BitGrid),
}

impl Prepared {
    /// The bone as an obstacle.
    pub fn obstacle(&self) -> &dyn Obstacle {
        match self {
            Self::Own(own) => &**own,
            Self::Lists(lists) => &**lists,
            Self::Bits(bits) => bits,
        }
    }

    /// Whether a vertex is nearer than `reach` [m]; for the bit grid, whether the walk back moves
    /// the vertex.
    pub fn is_near(&self, q: &Query, reach: f64) -> bool {
        match self {
            Self::Own(own) => own.nearest(&q.point, reach).is_some(),
            Self::Lists(lists) => lists.nearest(&q.point, reach).is_some(),
            Self::Bits(bits) => bits.walk_back(&q.before, &q.point) != Some(q.point),
        }
    }
}

/// A method: its name and how it prepares a bone.
pub type Method = (String, Box<dyn Fn(&TriangleMesh) -> Prepared>);

/// The hierarchy of the library, the methods with lists at the sizes that `sizes` returns, and the
/// bit grids.
pub fn methods(sizes: impl Fn(&BroadPhase) -> Vec<usize>) -> Vec<Method> {
    let mut all: Vec<Method> = vec![(
        "ours".into(),
        Box::new(|m| Prepared::Own(Box::new(Surface::new(m)))),
    )];
    for kind in METHODS {
        for size in sizes(kind) {
            let name = if size == 0 {
                kind.name.into()
            } else {
                format!("{} {size}", kind.name)
            };
            all.push((
                name,
                Box::new(move |m| {
                    Prepared::Lists(Box::new(Searched::new(m, (kind.sort)(m, size))))
                }),
            ));
        }
    }
    for (name, fill) in [("middles", Fill::Centre), ("touched", Fill::Touch)] {
        all.push((
            format!("bits {BITS}, {name}"),
            Box::new(move |m| Prepared::Bits(BitGrid::new(m, BITS, fill))),
        ));
    }
    all
}

/// Runs `ask` on the queries in turn until all are done or the time is up. Returns the time of a
/// query [s] and the number of queries.
pub fn timed(queries: &[Query], budget: Duration, mut ask: impl FnMut(&Query)) -> (f64, usize) {
    let begin = Instant::now();
    let mut asked = 0;
    for some in queries.chunks(CHUNK) {
        some.iter().for_each(&mut ask);
        asked += some.len();
        if begin.elapsed() > budget {
            break;
        }
    }
    (begin.elapsed().as_secs_f64() / asked.max(1) as f64, asked)
}

/// Errors in the answers of a method.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Errors {
    /// Vertices that are reported inside the bone and lie outside.
    pub kept: usize,
    /// Vertices that are reported outside the bone and lie inside.
    pub lost: usize,
    /// Greatest error of a distance outside [m]; NaN if a distance is.
    pub outside: f64,
    /// Greatest error of a depth inside [m]; NaN if a depth is.
    pub depth: f64,
}

impl Errors {
    /// Adds the signed distance [m] that a method found.
    pub fn add(&mut self, q: &Query, found: f64) {
        self.kept += usize::from(found < 0.0 && !q.inside);
        self.lost += usize::from((found >= 0.0 || found.is_nan()) && q.inside);
        let worst = if q.inside {
            &mut self.depth
        } else {
            &mut self.outside
        };
        *worst = max_or_nan([*worst, (found - q.distance).abs()]);
    }
}

/// Time, memory and error of a method.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct DetectionRow {
    /// The method, with boxes along an axis or triangles in a cell.
    pub method: String,
    /// Time to prepare all bones [s].
    pub build_s: f64,
    /// Time of a signed distance [s].
    pub query_s: f64,
    /// This time relative to that of the fastest method.
    pub time_ratio: f64,
    /// Number of queries within the time limit.
    pub queries: usize,
    /// Memory with the mesh [bytes].
    pub bytes: usize,
    /// Number of vertices that are found on the wrong side of the surface.
    pub misjudged: usize,
    /// Greatest error of a distance [m].
    pub error_max_m: f64,
    /// Whether the method promises distances to rounding.
    pub exact: bool,
    /// Whether it keeps this promise; true for a method without it.
    pub kept: bool,
}

/// Asks each method at its usual size for signed distances, for at most `budget` each.
pub fn compare_detection(
    bones: &[TriangleMesh],
    queries: &[Query],
    budget: Duration,
) -> Vec<DetectionRow> {
    let all = methods(|kind| vec![kind.usual]);
    let mut rows: Vec<DetectionRow> = all
        .iter()
        .map(|method| row(method, bones, queries, budget))
        .collect();
    let fastest = rows
        .iter()
        .map(|row| row.query_s)
        .fold(f64::INFINITY, f64::min);
    for row in &mut rows {
        row.time_ratio = if fastest > 0.0 {
            row.query_s / fastest
        } else {
            1.0
        };
    }
    rows
}

fn row(
    (name, prepare): &Method,
    bones: &[TriangleMesh],
    queries: &[Query],
    budget: Duration,
) -> DetectionRow {
    let begin = Instant::now();
    let prepared: Vec<Prepared> = bones.iter().map(prepare).collect();
    let build_s = begin.elapsed().as_secs_f64();
    let mut errors = Errors::default();
    let (query_s, asked) = timed(queries, budget, |q| {
        let closest = prepared[q.bone].obstacle().closest(&q.point);
        errors.add(q, closest.map_or(f64::INFINITY, |c| c.distance));
    });
    let exact = !matches!(prepared.first(), Some(Prepared::Bits(_)));
    let error_max_m = max_or_nan([errors.outside, errors.depth]);
    let sizes = bones.iter().map(|bone| size(&bone.bounding_box()));
    let rounding = ROUNDING * max_or_nan(sizes);
    DetectionRow {
        method: name.clone(),
        build_s,
        query_s,
        time_ratio: 1.0,
        queries: asked,
        bytes: prepared.iter().map(|p| p.obstacle().bytes()).sum(),
        misjudged: errors.kept + errors.lost,
        error_max_m,
        exact,
        kept: !exact || (error_max_m <= rounding && errors.kept + errors.lost == 0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::comparison::queries;
    use crate::mesh::shapes::icosphere;
    use crate::testing::Draw;
    use nalgebra::Point3;

    #[test]
    fn exact_methods_agree_and_a_wrong_distance_is_seen() {
        let mesh = icosphere(0.1, 2);
        let mut draw = Draw::new(17);
        let points = (0..200).map(|_| Point3::from(draw.direction() * draw.between(0.0, 0.13)));
        let points: Vec<_> = points.map(|p| (p, p)).collect();
        let mut queries = queries(0, &mesh, &Surface::new(&mesh), points);
        assert!(queries.iter().any(|q| q.inside) && queries.iter().any(|q| !q.inside));
        let bones = [mesh];
        let compare =
            |queries: &[Query]| compare_detection(&bones, queries, Duration::from_secs(1));
        let rows = compare(&queries);
        assert_eq!(rows.len(), 6);
        for row in &rows {
            assert!(row.kept && row.bytes > 0 && row.queries > 0, "{row:?}");
            assert_eq!(
                row.exact,
                row.misjudged == 0 && row.error_max_m <= 1e-14,
                "{row:?}"
            );
        }
        // Controls: a wrong distance, one that is no number, a wrong side.
        queries[0].distance += 1e-9;
        assert!(compare(&queries).iter().all(|row| row.kept != row.exact));
        queries[0].distance = f64::NAN;
        assert!(compare(&queries).iter().all(|row| row.kept != row.exact));
        queries[0].distance = Surface::new(&bones[0])
            .closest(&queries[0].point)
            .unwrap()
            .distance;
        assert!(compare(&queries).iter().all(|row| row.kept));
        queries[0].inside = !queries[0].inside;
        assert!(compare(&queries).iter().all(|row| row.kept != row.exact));
    }
}
