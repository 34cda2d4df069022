//! Two closed surfaces brought together: a common set of vertices and triangles, with a place on either surface for each vertex.

use std::time::Instant;

use nalgebra::{Point3, UnitQuaternion, Vector3};

use super::align::{AlignError, Moving, move_features, nearest_rotation};
use super::likeness::{Likeness, Match};
use super::locate::{Located, Locator};
use super::overlay::{Origin, Overlay, OverlayError};
use super::pose::{Posed, Start, by_shape};
use super::sphere::relaxation::{Effort, Relaxation};
use super::sphere::{SphereError, SphereMap};
use super::warp::{Wish, drawn};
use crate::mesh::TriangleMesh;
use crate::progress::Progress;

/// How surfaces are spread over the sphere.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Method {
    /// The one for bodies of any length.
    #[default]
    Robust,
    /// That of the source, corrected.
    Relaxation(Relaxation),
}

/// Which vertices and triangles the shapes in between have.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Shared {
    /// Those of both surfaces, and crossings of their edges: both are met exactly.
    #[default]
    Merged,
    /// Those of the first: the second is met at these vertices only.
    First,
}

/// How maps are brought over each other where no pairs are given.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Alike {
    /// The first is turned, and drawn to where like parts of the bodies are.
    #[default]
    Drawn,
    /// The first is turned.
    Turned,
}

/// What is asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Settings {
    /// How surfaces are spread.
    pub method: Method,
    /// What shapes in between are made of.
    pub shared: Shared,
    /// How maps are brought over each other without features.
    pub alike: Alike,
    /// How features are moved.
    pub moving: Moving,
}

/// Why surfaces cannot be brought together.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BetweenError {
    /// A surface has no map to the sphere.
    #[error("{error}")]
    Surface {
        /// 0 for the first, 1 for the second.
        side: usize,
        /// Why.
        error: SphereError,
    },
    /// A surface that is turned inside out: the map would be a mirror image.
    #[error("the surface is inside out: its volume is {volume}; turn its triangles")]
    InsideOut {
        /// 0 for the first, 1 for the second.
        side: usize,
        /// Its volume, which is negative \[m^3\].
        volume: f64,
    },
    /// Features that cannot be brought together.
    #[error(transparent)]
    Align(#[from] AlignError),
    /// The maps cannot be turned without a fold.
    #[error("the map cannot be turned without folding one of its thin triangles: {0}")]
    Turn(SphereError),
    /// The maps cannot be laid over each other.
    #[error(transparent)]
    Overlay(#[from] OverlayError),
    /// Somebody asked to stop.
    #[error("stopped")]
    Stopped,
}

/// Seconds that each part took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Times {
    /// Each of the two maps, which are made at the same time.
    pub maps: [f64; 2],
    /// Turning them, and moving features.
    pub align: f64,
    /// Laying them over each other.
    pub merge: f64,
}

/// Where a vertex is on a surface: between three of its vertices, of which some may be the same.
#[derive(Clone, Copy, Debug, PartialEq)]
struct On {
    corners: [u32; 3],
    /// Of the second and third corner.
    weights: [f64; 2],
}

/// Two surfaces with the same vertices and triangles.
#[derive(Clone, Debug, PartialEq)]
pub struct Between {
    /// Both maps as they lie over each other.
    pub maps: [SphereMap; 2],
    /// What relaxation took, where it was asked for.
    pub efforts: [Option<Effort>; 2],
    /// From what the first map was turned.
    pub start: Start,
    /// How far the places of the first map were drawn after that, mean of its vertices by their areas on the surface; 0 with
    /// pairs \[rad\].
    pub drawn: f64,
    /// Triangles over the common vertices.
    pub triangles: Vec<[u32; 3]>,
    /// Places of the common vertices on either surface \[m\].
    pub places: [Vec<Point3<f64>>; 2],
    /// 0 for a vertex of the first surface, 1 for one of the second, 2 for a crossing of edges.
    pub kinds: Vec<u8>,
    /// By how much the first map was turned so that no vertex lies exactly on an edge \[rad\].
    pub turned: f64,
    /// Seconds of each part.
    pub times: Times,
    on: [Vec<On>; 2],
}

impl Between {
    /// Brings two surfaces together; vertex `pairs[i][0]` of the first goes to vertex `pairs[i][1]` of the second.
    ///
    /// # Errors
    /// A surface that is no sphere or inside out, pairs that make no sense or cannot be brought together without a fold, maps
    /// that cannot be laid over each other; `progress` ended it.
    pub fn new(
        meshes: [&TriangleMesh; 2],
        pairs: &[[u32; 2]],
        settings: &Settings,
        progress: &(dyn Progress + Sync),
    ) -> Result<Self, BetweenError> {
        let goes_on = || {
            if progress.is_stopped() {
                return Err(BetweenError::Stopped);
            }
            Ok(())
        };
        let (first, second) = rayon::join(
            || mapped(meshes[0], 0, settings),
            || mapped(meshes[1], 1, settings),
        );
        let ((first, second), begun) = ((first?, second?), Instant::now());
        let mut times = Times {
            maps: [first.2, second.2],
            ..Times::default()
        };
        let efforts = [first.1, second.1];
        goes_on()?;
        let Aligned { maps, start, drawn } = aligned([first.0, second.0], meshes, pairs, settings)?;
        times.align = begun.elapsed().as_secs_f64();
        goes_on()?;
        let begun = Instant::now();
        let shared = match settings.shared {
            Shared::Merged => merged(&maps)?,
            Shared::First => of_first(&maps),
        };
        times.merge = begun.elapsed().as_secs_f64();
        let Common {
            on,
            kinds,
            triangles,
            turned,
        } = shared;
        let places = [0, 1].map(|side| {
            on[side]
                .iter()
                .map(|at| at.place(&meshes[side].vertices))
                .collect()
        });
        Ok(Self {
            maps,
            efforts,
            start,
            drawn,
            triangles,
            places,
            kinds,
            turned,
            times,
            on,
        })
    }

    /// Numbers at the vertices of surface `side`, `components` each, at the common vertices.
    pub fn carried(&self, side: usize, values: &[f64], components: usize) -> Vec<f64> {
        let at = |v: u32, k: usize| {
            values
                .get(v as usize * components + k)
                .copied()
                .unwrap_or(f64::NAN)
        };
        let value = |on: &On, k: usize| {
            let [a, b, c] = on.corners.map(|v| at(v, k));
            // In difference form, so that a vertex keeps its number to the last bit; a number that is none stays where its
            // weight is.
            let part = |d: f64, w: f64| if w == 0.0 { 0.0 } else { d * w };
            a + part(b - a, on.weights[0]) + part(c - a, on.weights[1])
        };
        self.on[side]
            .iter()
            .flat_map(|on| (0..components).map(move |k| value(on, k)))
            .collect()
    }
}

impl On {
    fn vertex(v: u32) -> Self {
        Self {
            corners: [v; 3],
            weights: [0.0; 2],
        }
    }

    fn located(map: &SphereMap, at: &Located) -> Self {
        Self {
            corners: map.triangles()[at.triangle as usize],
            weights: [at.weights[1], at.weights[2]],
        }
    }

    fn between([a, b]: [u32; 2], along: f64) -> Self {
        Self {
            corners: [a, b, b],
            weights: [along, 0.0],
        }
    }

    fn place(&self, places: &[Point3<f64>]) -> Point3<f64> {
        let [a, b, c] = self.corners.map(|v| places[v as usize]);
        a + (b - a) * self.weights[0] + (c - a) * self.weights[1]
    }
}

type Mapped = (SphereMap, Option<Effort>, f64);

fn mapped(mesh: &TriangleMesh, side: usize, settings: &Settings) -> Result<Mapped, BetweenError> {
    let begun = Instant::now();
    let of_side = |error| BetweenError::Surface { side, error };
    let (map, effort) = match settings.method {
        Method::Robust => (SphereMap::robust(mesh).map_err(of_side)?, None),
        Method::Relaxation(how) => {
            let (map, effort) = how.map(mesh).map_err(of_side)?;
            (map, Some(effort))
        }
    };
    let volume = mesh.volume();
    if volume < 0.0 {
        return Err(BetweenError::InsideOut { side, volume });
    }
    Ok((map, effort, begun.elapsed().as_secs_f64()))
}

/// Maps that lie over each other, from what they were turned, and how far the first was drawn \[rad\].
struct Aligned {
    maps: [SphereMap; 2],
    start: Start,
    drawn: f64,
}

fn aligned(
    [first, second]: [SphereMap; 2],
    meshes: [&TriangleMesh; 2],
    pairs: &[[u32; 2]],
    settings: &Settings,
) -> Result<Aligned, BetweenError> {
    for pair in pairs {
        for (&vertex, map) in pair.iter().zip([&first, &second]) {
            let count = map.points().len();
            if vertex as usize >= count {
                return Err(AlignError::Vertex { vertex, count }.into());
            }
        }
    }
    let places = |side: usize, map: &SphereMap| -> Vec<Point3<f64>> {
        pairs
            .iter()
            .map(|pair| map.points()[pair[side] as usize])
            .collect()
    };
    let (from, to) = (places(0, &first), places(1, &second));
    let (by, start) = match pairs.len() {
        0 => return by_likeness([first, second], meshes, settings.alike),
        1 => {
            // One pair leaves a turn about it open, which the shapes fill in.
            let by = by_shape([&first, &second], &Likeness::new(meshes)).turn;
            let rest = UnitQuaternion::rotation_between(&(by * from[0]).coords, &to[0].coords);
            (
                rest.unwrap_or_else(UnitQuaternion::identity) * by,
                Start::Features,
            )
        }
        _ => (nearest_rotation(&from, &to)?, Start::Features),
    };
    let [first, second] = turned(first, second, &by)?;
    let features: Vec<u32> = pairs.iter().map(|pair| pair[0]).collect();
    let moved = move_features(&first, &features, &places(1, &second), &settings.moving)?;
    Ok(Aligned {
        maps: [moved, second],
        start,
        drawn: 0.0,
    })
}

/// Turns the first map to where like parts of the bodies are, and draws it there if that brings them nearer to each other.
fn by_likeness(
    [first, second]: [SphereMap; 2],
    meshes: [&TriangleMesh; 2],
    alike: Alike,
) -> Result<Aligned, BetweenError> {
    let likeness = Likeness::new(meshes);
    let Posed {
        turn,
        start,
        matches,
        pose,
    } = by_shape([&first, &second], &likeness);
    let [first, second] = turned(first, second, &turn)?;
    if alike == Alike::Drawn {
        let wish = |m: &Match| Wish {
            vertex: m.vertices[0],
            to: second.points()[m.vertices[1] as usize],
            weight: m.weight,
        };
        let wishes: Vec<Wish> = matches.iter().map(wish).collect();
        let found = drawn(&first, &wishes);
        let nearer = |map: &SphereMap| {
            likeness.apart([map, &second], &pose) < likeness.apart([&first, &second], &pose)
        };
        if let Some(map) = found.filter(nearer) {
            let way = |(p, q): (&Point3<f64>, &Point3<f64>)| {
                2.0 * libm::asin(0.5 * (p - q).norm().min(2.0))
            };
            let ways = first.points().iter().zip(map.points()).map(way);
            let areas = meshes[0].vertex_areas();
            let drawn = ways.zip(&areas).map(|(way, area)| way * area).sum::<f64>()
                / areas.iter().sum::<f64>();
            return Ok(Aligned {
                maps: [map, second],
                start,
                drawn,
            });
        }
    }
    Ok(Aligned {
        maps: [first, second],
        start,
        drawn: 0.0,
    })
}

/// Angles by which a turn is changed where rounding folds a thin triangle \[rad\].
const ASIDE: [f64; 4] = [0.0, 1e-9, 1e-6, 1e-4];

/// The first map turned onto the second, or, where that folds a thin triangle, the second the other way.
fn turned(
    first: SphereMap,
    second: SphereMap,
    by: &UnitQuaternion<f64>,
) -> Result<[SphereMap; 2], BetweenError> {
    let mut last = None;
    for angle in ASIDE {
        let by = by * UnitQuaternion::from_scaled_axis(Vector3::new(0.48, -0.6, 0.64) * angle);
        match (first.turned(&by), last.is_none()) {
            (Ok(map), _) => return Ok([map, second]),
            (Err(error), true) => last = Some(error),
            (Err(_), false) => {}
        }
        if let Ok(map) = second.turned(&by.inverse()) {
            return Ok([first, map]);
        }
    }
    Err(last.map_or(BetweenError::Stopped, BetweenError::Turn))
}

/// Common vertices and triangles.
struct Common {
    on: [Vec<On>; 2],
    kinds: Vec<u8>,
    triangles: Vec<[u32; 3]>,
    turned: f64,
}

fn merged(maps: &[SphereMap; 2]) -> Result<Common, OverlayError> {
    let Overlay {
        origins,
        triangles,
        turned,
        ..
    } = Overlay::new(&maps[0], &maps[1])?;
    let (mut on, mut kinds) = ([Vec::new(), Vec::new()], Vec::new());
    for origin in &origins {
        let (kind, both) = match origin {
            Origin::First { vertex, on } => (0, [On::vertex(*vertex), On::located(&maps[1], on)]),
            Origin::Second { vertex, on } => (1, [On::located(&maps[0], on), On::vertex(*vertex)]),
            Origin::Crossing {
                first,
                along_first,
                second,
                along_second,
            } => (
                2,
                [
                    On::between(*first, *along_first),
                    On::between(*second, *along_second),
                ],
            ),
        };
        kinds.push(kind);
        on[0].push(both[0]);
        on[1].push(both[1]);
    }
    Ok(Common {
        on,
        kinds,
        triangles,
        turned,
    })
}

fn of_first(maps: &[SphereMap; 2]) -> Common {
    let locator = Locator::new(&maps[1]);
    // Points of a map are directions, and every direction is in a triangle.
    let located = |p: &Point3<f64>| {
        locator
            .locate(&p.coords)
            .map_or(On::vertex(0), |at| On::located(&maps[1], &at))
    };
    let there = maps[0].points().iter().map(located).collect();
    let count = maps[0].points().len();
    let here = (0..count as u32).map(On::vertex).collect();
    Common {
        on: [here, there],
        kinds: vec![0; count],
        triangles: maps[0].triangles().to_vec(),
        turned: 0.0,
    }
}
