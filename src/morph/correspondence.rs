//! Correspondence of two closed surfaces: common vertices and triangles, with a position on either
//! surface for each vertex.

use std::time::Instant;

use nalgebra::{Point3, UnitQuaternion, Vector3};

use super::align::{AlignError, Moving, move_features_while, nearest_rotation};
use super::locate::{Located, Locator};
use super::overlay::{Overlay, OverlayError, OverlayOrigin};
use super::pose::{InitialPose, Start, by_shape};
use super::shape_similarity::ShapeSimilarity;
use super::sphere::relaxation::{Effort, Relaxation};
use super::sphere::{SphereError, SphereMap};
use super::warp::{Target, warped};
use crate::mesh::TriangleMesh;
use crate::progress::Progress;

/// Method of the map to the sphere.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum CorrespondenceMethod {
    /// The robust method, for bodies of any length.
    #[default]
    Robust,
    /// The method of the source, corrected.
    Relaxation(Relaxation),
}

/// Vertices and triangles of the intermediate shapes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Shared {
    /// Those of both surfaces, and crossings of their edges: both surfaces are reproduced exactly.
    #[default]
    Merged,
    /// Those of the first surface; the second is sampled at these vertices only.
    First,
}

/// Alignment of the maps without given pairs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Alike {
    /// The first map is rotated, then deformed so that similar parts of the bodies coincide.
    #[default]
    Drawn,
    /// The first map is rotated.
    Turned,
}

/// Settings of a correspondence.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CorrespondenceSettings {
    /// Method of the map to the sphere.
    pub method: CorrespondenceMethod,
    /// Vertices of the intermediate shapes.
    pub shared: Shared,
    /// Alignment of the maps without features.
    pub alike: Alike,
    /// Parameters of the motion of features.
    pub moving: Moving,
}

/// Error of [`Between::new`].
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CorrespondenceError {
    /// A surface has no map to the sphere.
    #[error("{error}")]
    Surface {
        /// 0 for the first, 1 for the second.
        side: usize,
        /// The cause.
        error: SphereError,
    },
    /// A surface is inside out; its map would be a mirror image.
    #[error("the surface is inside out: its volume is {volume}; turn its triangles")]
    InsideOut {
        /// 0 for the first, 1 for the second.
        side: usize,
        /// Volume of the surface, which is negative \[m^3\].
        volume: f64,
    },
    /// The features cannot be aligned.
    #[error(transparent)]
    Align(#[from] AlignError),
    /// The maps cannot be rotated without a fold.
    #[error("the map cannot be turned without folding one of its thin triangles: {0}")]
    Turn(SphereError),
    /// The maps have no overlay.
    #[error(transparent)]
    Overlay(#[from] OverlayError),
    /// The caller stopped the computation.
    #[error("stopped")]
    Stopped,
}

/// Time of each part [s].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CorrespondenceTimes {
    /// Time of each map; both are computed in parallel.
    pub maps: [f64; 2],
    /// Time of the rotation and of the motion of features.
    pub align: f64,
    /// Time of the overlay.
    pub merge: f64,
}

/// Position of a vertex on a surface: between three vertices, some of which can be equal.
#[derive(Clone, Copy, Debug, PartialEq)]
struct On {
    corners: [u32; 3],
    /// Weights of the second and third corner.
    weights: [f64; 2],
}

/// Two surfaces with common vertices and triangles.
///
/// ```
/// use pliant::mesh::measures::volume;
/// use pliant::mesh::shapes::{box_surface, icosphere};
/// use pliant::morph::blend::linear;
/// use pliant::morph::CorrespondenceSettings;
/// use pliant::{Correspondence, Silent};
///
/// let (ball, block) = (icosphere(0.5, 1), box_surface([2.0, 1.0, 1.0], 0.5));
/// let both = Correspondence::new([&ball, &block], &[], &CorrespondenceSettings::default(), &Silent)?;
/// let [first, second] = &both.places;
/// assert!((volume(first, &both.triangles) - ball.volume()).abs() <= 1e-12);
/// assert!((volume(second, &both.triangles) - block.volume()).abs() <= 1e-12);
/// let half = linear(first, second, 0.5)?;
/// assert!(volume(&half, &both.triangles) > ball.volume());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Correspondence {
    /// Both maps after the alignment.
    pub maps: [SphereMap; 2],
    /// Effort of the relaxation, if used.
    pub efforts: [Option<Effort>; 2],
    /// Source of the rotation of the first map.
    pub start: Start,
    /// Mean displacement of the first map's vertices after the rotation, weighted by their areas on
    /// the surface; 0 with pairs \[rad\].
    pub drawn: f64,
    /// Triangles of the common vertices.
    pub triangles: Vec<[u32; 3]>,
    /// Positions of the common vertices on either surface \[m\].
    pub places: [Vec<Point3<f64>>; 2],
    /// 0 for a vertex of the first surface, 1 for one of the second, 2 for a crossing of edges.
    pub kinds: Vec<u8>,
    /// Small rotation of the first map so that no vertex lies exactly on an edge \[rad\].
    pub turned: f64,
    /// Time of each part.
    pub times: CorrespondenceTimes,
    on: [Vec<On>; 2],
}

impl Correspondence {
    /// Creates the correspondence of two surfaces; vertex `pairs[i][0]` of the first maps to vertex
    /// `pairs[i][1]` of the second.
    ///
    /// # Errors
    /// A surface that is no topological sphere or inside out, invalid pairs or pairs that need a
    /// fold, maps without an overlay, or a stop by `go_on`.
    pub fn new(
        meshes: [&TriangleMesh; 2],
        pairs: &[[u32; 2]],
        settings: &CorrespondenceSettings,
        progress: &(dyn Progress + Sync),
    ) -> Result<Self, CorrespondenceError> {
        let goes_on = || {
            if progress.is_stopped() {
                return Err(CorrespondenceError::Stopped);
            }
            Ok(())
        };
        let (first, second) = rayon::join(
            || mapped(meshes[0], 0, settings),
            || mapped(meshes[1], 1, settings),
        );
        let ((first, second), begun) = ((first?, second?), Instant::now());
        let mut times = CorrespondenceTimes {
            maps: [first.2, second.2],
            ..CorrespondenceTimes::default()
        };
        let efforts = [first.1, second.1];
        goes_on()?;
        let Aligned { maps, start, drawn } =
            aligned([first.0, second.0], meshes, pairs, settings, progress)?;
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

    /// Interpolates numbers at the vertices of surface `side`, `components` per vertex, to the
    /// common vertices.
    pub fn carried(&self, side: usize, values: &[f64], components: usize) -> Vec<f64> {
        let at = |v: u32, k: usize| {
            values
                .get(v as usize * components + k)
                .copied()
                .unwrap_or(f64::NAN)
        };
        let mut carried = Vec::with_capacity(self.on[side].len() * components);
        for on in &self.on[side] {
            carried.extend((0..components).map(|k| on.interpolated(on.corners.map(|v| at(v, k)))));
        }
        carried
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

    /// The number at this place from those at the corners. The difference form keeps the number of
    /// a vertex to the last bit; a NaN stays where its weight is not zero.
    fn interpolated(&self, [a, b, c]: [f64; 3]) -> f64 {
        let part = |d: f64, w: f64| if w == 0.0 { 0.0 } else { d * w };
        a + part(b - a, self.weights[0]) + part(c - a, self.weights[1])
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

fn mapped(
    mesh: &TriangleMesh,
    side: usize,
    settings: &CorrespondenceSettings,
) -> Result<Mapped, CorrespondenceError> {
    let begun = Instant::now();
    let of_side = |error| CorrespondenceError::Surface { side, error };
    let (map, effort) = match settings.method {
        CorrespondenceMethod::Robust => (SphereMap::robust(mesh).map_err(of_side)?, None),
        CorrespondenceMethod::Relaxation(how) => {
            let (map, effort) = how.map(mesh).map_err(of_side)?;
            (map, Some(effort))
        }
    };
    let volume = mesh.volume();
    if volume < 0.0 {
        return Err(CorrespondenceError::InsideOut { side, volume });
    }
    Ok((map, effort, begun.elapsed().as_secs_f64()))
}

/// Aligned maps, the source of the rotation, and the displacement of the first map \[rad\].
struct Aligned {
    maps: [SphereMap; 2],
    start: Start,
    drawn: f64,
}

fn aligned(
    [first, second]: [SphereMap; 2],
    meshes: [&TriangleMesh; 2],
    pairs: &[[u32; 2]],
    settings: &CorrespondenceSettings,
    progress: &(dyn Progress + Sync),
) -> Result<Aligned, CorrespondenceError> {
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
        0 => return by_shape_similarity([first, second], meshes, settings.alike),
        1 => {
            // One pair leaves the rotation about it free; the shapes determine it.
            let by = by_shape([&first, &second], &ShapeSimilarity::new(meshes)).turn;
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
    let places = places(1, &second);
    let going = || !progress.is_stopped();
    let moved = moved(&first, &features, &places, &settings.moving, &going);
    if !going() {
        return Err(CorrespondenceError::Stopped);
    }
    let moved = moved?;
    Ok(Aligned {
        maps: [moved, second],
        start,
        drawn: 0.0,
    })
}

/// Moves features to their places: all together first, where a rotation does not bring them near,
/// and with smaller and smaller neighbourhoods where features are in each other's path.
fn moved(
    map: &SphereMap,
    features: &[u32],
    places: &[Point3<f64>],
    how: &Moving,
    going: &dyn Fn() -> bool,
) -> Result<SphereMap, AlignError> {
    let direct = move_features_while(map, features, places, how, going);
    if !matches!(direct, Err(AlignError::Stuck { .. })) || !going() {
        return direct;
    }
    let target = |(vertex, to): (&u32, &Point3<f64>)| Target {
        vertex: *vertex,
        to: *to,
        weight: 1.0,
    };
    let targets: Vec<Target> = features.iter().zip(places).map(target).collect();
    let nearer = warped(map, &targets);
    for halvings in 0..RADII {
        let how = Moving {
            radius: how.radius * libm::exp2(-f64::from(halvings)),
            ..*how
        };
        for start in nearer.iter().chain([map]) {
            let found = move_features_while(start, features, places, &how, going);
            if !matches!(found, Err(AlignError::Stuck { .. })) || !going() {
                return found;
            }
        }
    }
    direct
}

/// Rotates the first map so that similar parts of the bodies coincide, and deforms it if that
/// brings them nearer to each other.
fn by_shape_similarity(
    [first, second]: [SphereMap; 2],
    meshes: [&TriangleMesh; 2],
    alike: Alike,
) -> Result<Aligned, CorrespondenceError> {
    let shape_similarity = ShapeSimilarity::new(meshes);
    let InitialPose {
        turn,
        start,
        matches,
        pose,
    } = by_shape([&first, &second], &shape_similarity);
    let [first, second] = turned(first, second, &turn)?;
    if alike == Alike::Drawn {
        let targets: Vec<Target> = matches
            .iter()
            .map(|m| Target {
                vertex: m.vertices[0],
                to: second.points()[m.vertices[1] as usize],
                weight: m.weight,
            })
            .collect();
        let found = warped(&first, &targets);
        let nearer = |map: &SphereMap| {
            shape_similarity.apart([map, &second], &pose)
                < shape_similarity.apart([&first, &second], &pose)
        };
        if let Some(map) = found.filter(nearer) {
            let distance = |(p, q): (&Point3<f64>, &Point3<f64>)| {
                2.0 * libm::asin(0.5 * (p - q).norm().min(2.0))
            };
            let distances = first.points().iter().zip(map.points()).map(distance);
            let areas = meshes[0].vertex_areas();
            let drawn = distances
                .zip(&areas)
                .map(|(distance, area)| distance * area)
                .sum::<f64>()
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

/// Number of radii of the neighbourhood of a feature that are tried, each half of the one before.
const RADII: i32 = 4;
/// Small changes of a rotation where rounding folds a thin triangle \[rad\].
const ASIDE: [f64; 4] = [0.0, 1e-9, 1e-6, 1e-4];

/// The first map rotated onto the second, or the second rotated by the inverse if the first
/// rotation folds a thin triangle.
fn turned(
    first: SphereMap,
    second: SphereMap,
    by: &UnitQuaternion<f64>,
) -> Result<[SphereMap; 2], CorrespondenceError> {
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
    Err(last.map_or(CorrespondenceError::Stopped, CorrespondenceError::Turn))
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
            OverlayOrigin::First { vertex, on } => {
                (0, [On::vertex(*vertex), On::located(&maps[1], on)])
            }
            OverlayOrigin::Second { vertex, on } => {
                (1, [On::located(&maps[0], on), On::vertex(*vertex)])
            }
            OverlayOrigin::Crossing {
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
