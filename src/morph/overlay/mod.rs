//! Overlay of two maps: a surface with the vertices and edges of both, and a position on either for
//! each vertex.
//!
//! Exact predicates decide how edges cross. The construction from them (order of edges around a
//! vertex, order of crossings along an edge) is combinatorial: V - E + F = 2 for faces of any
//! thinness. Where a vertex lies exactly on an edge or vertex of the other map, one map is rotated
//! slightly, and the result contains the angle.

mod faces;
mod walk;

use nalgebra::{Point3, UnitQuaternion, Vector3};

pub use walk::arcs_cross;

use self::walk::{Exactly, Ground};
use super::locate::{Located, Locator};
use super::sphere::{SphereError, SphereMap, turn};

/// Origin of a vertex of the merged surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum OverlayOrigin {
    /// A vertex of the first surface, in a triangle of the second.
    First {
        /// The vertex.
        vertex: u32,
        /// Position on the second surface.
        on: Located,
    },
    /// A vertex of the second surface, in a triangle of the first.
    Second {
        /// The vertex.
        vertex: u32,
        /// Position on the first surface.
        on: Located,
    },
    /// A crossing of an edge of each surface.
    Crossing {
        /// Ends of the edge of the first surface.
        first: [u32; 2],
        /// Position along that edge, 0 to 1.
        along_first: f64,
        /// Ends of the edge of the second.
        second: [u32; 2],
        /// Position along that edge, 0 to 1.
        along_second: f64,
    },
}

/// A surface with the vertices and edges of two.
#[derive(Clone, Debug, PartialEq)]
pub struct Overlay {
    /// Origin of each vertex: those of the first surface, those of the second, crossings.
    pub origins: Vec<OverlayOrigin>,
    /// Triangles over these vertices, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Numbers of vertices of the first and of the second surface.
    pub counts: [usize; 2],
    /// Small rotation of the first map so that no vertex lies exactly on an edge \[rad\].
    pub turned: f64,
}

/// Error of an overlay.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum OverlayError {
    /// The small rotations did not help.
    #[error(
        "vertices of one map lie exactly on edges of the other, in {attempts} attempts to turn it by up to {angle} rad"
    )]
    Exact {
        /// Number of attempts.
        attempts: usize,
        /// The last angle \[rad\].
        angle: f64,
    },
    /// The number of positions does not match the map.
    #[error("{found} positions for a map of {expected} vertices")]
    Positions {
        /// Number given.
        found: usize,
        /// Number required.
        expected: usize,
    },
    /// A small rotation folded a thin triangle.
    #[error(transparent)]
    Sphere(#[from] SphereError),
}

/// Rotations of the first map that are tried \[rad\]: as small as possible, yet well above
/// rounding.
const ANGLES: [f64; 6] = [0.0, 1e-10, 1e-9, 1e-8, 1e-7, 1e-6];

impl Overlay {
    /// Creates the overlay of `first` and `second`.
    ///
    /// # Errors
    /// Maps without general position after all rotations.
    pub fn new(first: &SphereMap, second: &SphereMap) -> Result<Self, OverlayError> {
        let mut last = None;
        for angle in ANGLES {
            // This axis is unlikely to be an axis of symmetry of a generated mesh.
            let axis = Vector3::new(0.534_522, -0.267_261, 0.801_784).normalize();
            let turned = match angle > 0.0 {
                true => first.turned(&UnitQuaternion::from_scaled_axis(axis * angle)),
                false => Ok(first.clone()),
            };
            match turned {
                Ok(map) => match overlay_maps(&map, second) {
                    Ok((origins, triangles)) => {
                        let counts = [first.points().len(), second.points().len()];
                        return Ok(Self {
                            origins,
                            triangles,
                            counts,
                            turned: angle,
                        });
                    }
                    Err(Exactly) => last = None,
                },
                Err(error) => last = Some(error),
            }
        }
        let angle = ANGLES[ANGLES.len() - 1];
        Err(last.map_or(
            OverlayError::Exact {
                attempts: ANGLES.len(),
                angle,
            },
            OverlayError::Sphere,
        ))
    }

    /// Number of crossings.
    pub fn crossings(&self) -> usize {
        self.origins.len() - self.counts[0] - self.counts[1]
    }

    /// Positions on the first surface \[m\], from its vertices and triangles.
    ///
    /// # Errors
    /// Positions that do not match the first map.
    pub fn on_first(
        &self,
        places: &[Point3<f64>],
        triangles: &[[u32; 3]],
    ) -> Result<Vec<Point3<f64>>, OverlayError> {
        self.check(places, 0)?;
        let place = |origin: &OverlayOrigin| match *origin {
            OverlayOrigin::First { vertex, .. } => places[vertex as usize],
            OverlayOrigin::Second { on, .. } => on.of(triangles, places),
            OverlayOrigin::Crossing {
                first, along_first, ..
            } => between(places, first, along_first),
        };
        Ok(self.origins.iter().map(place).collect())
    }

    /// Positions on the second surface \[m\].
    ///
    /// # Errors
    /// Positions that do not match the second map.
    pub fn on_second(
        &self,
        places: &[Point3<f64>],
        triangles: &[[u32; 3]],
    ) -> Result<Vec<Point3<f64>>, OverlayError> {
        self.check(places, 1)?;
        let place = |origin: &OverlayOrigin| match *origin {
            OverlayOrigin::First { on, .. } => on.of(triangles, places),
            OverlayOrigin::Second { vertex, .. } => places[vertex as usize],
            OverlayOrigin::Crossing {
                second,
                along_second,
                ..
            } => between(places, second, along_second),
        };
        Ok(self.origins.iter().map(place).collect())
    }

    fn check(&self, places: &[Point3<f64>], side: usize) -> Result<(), OverlayError> {
        let (found, expected) = (places.len(), self.counts[side]);
        if found == expected {
            Ok(())
        } else {
            Err(OverlayError::Positions { found, expected })
        }
    }
}

fn between(places: &[Point3<f64>], ends: [u32; 2], along: f64) -> Point3<f64> {
    let [a, b] = ends.map(|v| places[v as usize]);
    a + (b - a) * along
}

/// One map's vertices and edges on the other: the triangle of each vertex, and the edges that each
/// edge crosses.
struct OverlaidMap {
    on: Vec<Located>,
    crossed: Vec<Vec<u32>>,
}

fn overlay_map(
    map: &SphereMap,
    edges: &[[u32; 2]],
    ground: &Ground<'_>,
) -> Result<OverlaidMap, Exactly> {
    let locator = Locator::new(ground.map);
    let locate = |p: &Point3<f64>| {
        let found = locator.locate_exactly(p).ok_or(Exactly)?;
        if locator.sides(found.triangle, p).contains(&0.0) {
            Err(Exactly)
        } else {
            Ok(found)
        }
    };
    let on: Vec<Located> = map.points().iter().map(locate).collect::<Result<_, _>>()?;
    let crossings_of_edge = |&[a, b]: &[u32; 2]| {
        let (from, to) = (a as usize, b as usize);
        ground.crossed(
            &map.points()[from],
            on[from].triangle,
            &map.points()[to],
            on[to].triangle,
        )
    };
    let crossed = edges
        .iter()
        .map(crossings_of_edge)
        .collect::<Result<_, _>>()?;
    Ok(OverlaidMap { on, crossed })
}

type Pieces = (Vec<OverlayOrigin>, Vec<[u32; 3]>);

fn overlay_maps(first: &SphereMap, second: &SphereMap) -> Result<Pieces, Exactly> {
    let grounds = [Ground::new(first), Ground::new(second)];
    let edges = [&grounds[0].topology.edges, &grounds[1].topology.edges];
    let overlaid = [
        overlay_map(first, edges[0], &grounds[1])?,
        overlay_map(second, edges[1], &grounds[0])?,
    ];
    let crossings = faces::Crossings::new(&overlaid)?;
    let mut origins: Vec<OverlayOrigin> =
        Vec::with_capacity(first.points().len() + second.points().len());
    origins.extend(
        overlaid[0]
            .on
            .iter()
            .enumerate()
            .map(|(v, &on)| OverlayOrigin::First {
                vertex: v as u32,
                on,
            }),
    );
    origins.extend(
        overlaid[1]
            .on
            .iter()
            .enumerate()
            .map(|(v, &on)| OverlayOrigin::Second {
                vertex: v as u32,
                on,
            }),
    );
    for &[e, f] in &crossings.pairs {
        let (ends, others) = (edges[0][e as usize], edges[1][f as usize]);
        let (p, q) = (
            ends.map(|v| &first.points()[v as usize]),
            others.map(|v| &second.points()[v as usize]),
        );
        let (along_first, along_second) = (part(p, q), part(q, p));
        origins.push(OverlayOrigin::Crossing {
            first: ends,
            along_first,
            second: others,
            along_second,
        });
    }
    let triangles = faces::triangles(&grounds, &overlaid, &crossings)?;
    Ok((origins, triangles))
}

/// Position along the chord of an arc where it crosses the plane of another arc; clamped to 0..1
/// against rounding.
fn part(p: [&Point3<f64>; 2], q: [&Point3<f64>; 2]) -> f64 {
    let (before, after) = (turn(p[0], q[0], q[1]), turn(p[1], q[0], q[1]));
    before / (before - after)
}
