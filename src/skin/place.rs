//! Placement of an implant: the region of the skin about it, its frame, its downward direction, and
//! tests whether it fits.

use nalgebra::{Isometry3, Point2, Point3, Vector3};

use super::SkinError;
use super::implant::Implant;
use super::layers::Layers;
use super::patch::{MARGIN, Patch, TakenOut, nearest_vertex, normal_of};
use super::plan::{ImplantPlace, ImplantSpec, Site};
use super::region::{REACH, Region, frame};
use super::whole::rim;
use crate::contact::Surface;
use crate::mesh::closest::SurfaceTree;
use crate::mesh::measures::max_or_nan;
use crate::mesh::{Topology, TriangleMesh};
use crate::progress::Silent;

/// Number of bases in the search for one that fits; each is the previous one times a constant
/// factor.
const TRIES: u32 = 10;
const SMALLER: f64 = 0.85;

/// The region ends where the skin normal is farther than this from the normal of the centre
/// [degrees]: the skin is then no longer over the implant.
const TURN: f64 = 70.0;

/// Least extent of the region, in outlines of the base.
const NEAR: f64 = 1.1;

/// Greatest share of the skin over the implant whose normals exceed that angle.
const FOLDED: f64 = 0.05;

/// Number of sample points on the outline of a base.
const OUTLINE: u32 = 72;

/// Greatest share of the room over an obstacle that the lower layer occupies.
const ROOM: f64 = 0.98;

/// Greatest depth of an obstacle under an implant below the skin, in bases.
const DEEPEST: f64 = 2.0;

/// Safety factor of a proposed smaller base.
const SURELY: f64 = 0.95;

/// The point of the skin and a vertex near it.
pub(super) fn middle(
    skin: &TriangleMesh,
    order: &ImplantSpec,
) -> Result<(Point3<f64>, u32), SkinError> {
    if skin.triangles.is_empty() {
        return Err(SkinError::Empty);
    }
    let count = skin.vertices.len();
    match order.place {
        ImplantPlace::Vertex(vertex) => {
            let used = vertex < count
                && skin
                    .triangles
                    .iter()
                    .flatten()
                    .any(|v| *v as usize == vertex);
            let at = skin
                .vertices
                .get(vertex)
                .filter(|_| used)
                .ok_or(SkinError::NoVertex { vertex, count })?;
            Ok((*at, vertex as u32))
        }
        ImplantPlace::Point(point) => {
            if !point.coords.iter().all(|c| c.is_finite()) {
                return Err(SkinError::NotPositive {
                    what: "the distance of the place to the skin",
                    value: f64::NAN,
                });
            }
            let tree = SurfaceTree::new(&skin.vertices, &skin.triangles);
            let closest = tree
                .closest(&point, f64::INFINITY)
                .ok_or(SkinError::Empty)?;
            if closest.distance > 0.5 * order.implant.base {
                return Err(SkinError::FarAway {
                    distance: closest.distance,
                });
            }
            let corners = skin.triangles[closest.triangle as usize];
            let far = |v: u32| (skin.vertices[v as usize] - closest.point).norm();
            let near = corners
                .into_iter()
                .min_by(|a, b| far(*a).total_cmp(&far(*b)));
            Ok((closest.point, near.unwrap_or(corners[0])))
        }
    }
}

/// The region of an implant in a patch, with its frame.
pub(super) fn placed(
    taken: &TakenOut,
    topology: &Topology,
    order: &ImplantSpec,
    centre: &Point3<f64>,
) -> Result<(Region, Isometry3<f64>), SkinError> {
    let patch = &taken.mesh;
    let seed = nearest_vertex(patch, centre);
    let normal = patch.vertex_normals()[seed as usize];
    let mut frame = frame(centre, &normal, order.long.as_ref());
    let mut region = around(patch, topology, seed, order, &frame);
    // A second pass with the mean normal of the region: the normal of one vertex is arbitrary.
    let normals = region
        .mesh
        .triangles
        .iter()
        .map(|t| normal_of(&region.mesh, t));
    let mean = normals.fold(Vector3::zeros(), |sum, n| sum + n);
    frame = self::frame(centre, &mean, order.long.as_ref());
    region = around(patch, topology, seed, order, &frame);
    check_region(&region, taken, topology, order, &frame)?;
    Ok((region, frame))
}

/// Adds the base that fits to an error, where a smaller base can help.
pub(super) fn advised(
    error: SkinError,
    skin: &TriangleMesh,
    order: &ImplantSpec,
    obstacles: &[TriangleMesh],
) -> SkinError {
    match error {
        SkinError::WrapsAround { base, .. } => SkinError::WrapsAround {
            base,
            fits: fitting(skin, order, obstacles),
        },
        SkinError::TooCurved { degrees, .. } => SkinError::TooCurved {
            degrees,
            fits: fitting(skin, order, obstacles),
        },
        other => other,
    }
}

/// A smaller base of the same shape that fits [m], in whole millimetres if possible; `None` if the
/// search found none.
fn fitting(skin: &TriangleMesh, order: &ImplantSpec, obstacles: &[TriangleMesh]) -> Option<f64> {
    let mut base = order.implant.base;
    for _ in 0..TRIES {
        base *= SMALLER;
        let round = (base * 1e3).floor() * 1e-3;
        let implant = Implant {
            base: if round > 0.0 { round } else { base },
            ..order.implant
        };
        if goes(
            skin,
            &ImplantSpec {
                implant,
                ..order.clone()
            },
            obstacles,
        )
        .is_ok()
        {
            return Some(implant.base);
        }
    }
    None
}

/// True if an order has a region.
fn goes(
    skin: &TriangleMesh,
    order: &ImplantSpec,
    obstacles: &[TriangleMesh],
) -> Result<(), SkinError> {
    let (centre, seed) = middle(skin, order)?;
    let radius = REACH * 0.5 * order.implant.base * MARGIN;
    let taken = Patch {
        skin,
        places: vec![(seed, centre, radius)],
        edge: order.edge(),
        obstacles,
    }
    .taken_out(&Silent)?;
    placed(&taken, &Topology::new(&taken.mesh), order, &centre).map(|_| ())
}

/// The region of the rule: every triangle with a vertex within [`REACH`] times the base's outline;
/// beyond [`NEAR`] times only as far as the skin does not turn away.
fn around(
    mesh: &TriangleMesh,
    topology: &Topology,
    seed: u32,
    order: &ImplantSpec,
    frame: &Isometry3<f64>,
) -> Region {
    let (reach, turn) = (reaches(mesh, order, frame), turns(mesh, frame));
    // Rounding must not decide about vertices at the limit.
    let within = |v: usize| reach[v] <= REACH * (1.0 + 1e-9);
    let mut inside: Vec<bool> = (0..reach.len())
        .map(|v| within(v) && (turn[v] <= TURN || reach[v] <= NEAR))
        .collect();
    // A part that turns away without a connection to the outside is a fold within the region.
    let mut beyond: Vec<bool> = (0..reach.len()).map(|v| !within(v)).collect();
    let mut open: Vec<usize> = (0..reach.len()).filter(|v| beyond[*v]).collect();
    while let Some(v) = open.pop() {
        for w in topology
            .triangles_of_vertex(v)
            .iter()
            .flat_map(|t| mesh.triangles[*t as usize])
        {
            if !inside[w as usize] && !std::mem::replace(&mut beyond[w as usize], true) {
                open.push(w as usize);
            }
        }
    }
    inside
        .iter_mut()
        .zip(beyond)
        .for_each(|(inside, beyond)| *inside |= !beyond);
    Region::around(mesh, topology, seed, |v| inside[v as usize])
}

/// Distance of each vertex from the centre, 1 on the outline of the base.
fn reaches(mesh: &TriangleMesh, order: &ImplantSpec, frame: &Isometry3<f64>) -> Vec<f64> {
    let Implant { shape, base, .. } = order.implant;
    mesh.vertices
        .iter()
        .map(|p| shape.reach(frame.inverse_transform_point(p).xy(), base))
        .collect()
}

/// Angle between the normal of each vertex and that of the centre [degrees].
fn turns(mesh: &TriangleMesh, frame: &Isometry3<f64>) -> Vec<f64> {
    let z = frame * Vector3::z();
    let turn = |n: &Vector3<f64>| libm::atan2(n.cross(&z).norm(), n.dot(&z)).to_degrees();
    mesh.vertex_normals().iter().map(turn).collect()
}

/// The longest base with a margin of skin between it and the border, relative to the present one:
/// no triangle at the border has a vertex within [`NEAR`] outlines.
fn fits(patch: &TriangleMesh, topology: &Topology, reach: &[f64]) -> f64 {
    let at_border = topology.boundary_edges();
    let triangles = at_border
        .iter()
        .flat_map(|e| topology.triangles_of_edge(*e as usize));
    let nearest = triangles
        .flat_map(|t| patch.triangles[*t as usize])
        .map(|v| reach[v as usize]);
    // Finer triangles of a smaller base are nearer to the border; the remaining margin is for the
    // mean normal, which changes.
    SURELY * nearest.fold(f64::INFINITY, f64::min) / NEAR
}

fn check_region(
    region: &Region,
    TakenOut {
        mesh: patch,
        origin,
        border,
        ..
    }: &TakenOut,
    topology: &Topology,
    order: &ImplantSpec,
    frame: &Isometry3<f64>,
) -> Result<(), SkinError> {
    let mut sides = vec![false; topology.edges.len()];
    region.triangles.iter().for_each(|t| {
        topology.triangle_edges[*t as usize]
            .iter()
            .for_each(|e| sides[*e as usize] = true)
    });
    let (reach, turn) = (reaches(patch, order, frame), turns(patch, frame));
    let boundary = topology.boundary_edges().into_iter();
    let ends = boundary.filter(|e| sides[*e as usize]).count();
    if ends > 0 {
        let chains = rim(patch, topology, origin);
        let of_skin = chains
            .iter()
            .filter(|c| border.contains(&[c.ends[0].min(c.ends[1]), c.ends[0].max(c.ends[1])]));
        let reached = |pair: &[u32]| {
            topology
                .find_edge(pair[0], pair[1])
                .is_some_and(|e| sides[e as usize])
        };
        let pairs = of_skin
            .flat_map(|c| c.vertices.windows(2))
            .filter(|pair| reached(pair));
        let pairs: Vec<&[u32]> = pairs.collect();
        // Only skin that descends beside the implant reaches the boundary of the patch elsewhere.
        if pairs.len() < ends {
            return Err(SkinError::WrapsAround {
                base: order.implant.base,
                fits: None,
            });
        }
        // The skin is held at its border, so an implant needs skin around it.
        if pairs
            .iter()
            .any(|pair| pair.iter().any(|v| reach[*v as usize] <= NEAR))
        {
            return Err(SkinError::AtBorder {
                edges: pairs.len(),
                fits: fits(patch, topology, &reach) * order.implant.base,
            });
        }
    }
    // Under the implant the skin can have folds, but must not turn away as a whole.
    let mut areas = (0.0, 0.0, 0.0f64);
    for t in region
        .triangles
        .iter()
        .map(|t| patch.triangles[*t as usize])
        .filter(|t| t.iter().all(|v| reach[*v as usize] <= NEAR))
    {
        let area = normal_of(patch, &t).norm();
        let degrees = max_or_nan(t.iter().map(|v| turn[*v as usize]));
        areas = (
            areas.0 + area,
            areas.1 + if degrees > TURN { area } else { 0.0 },
            areas.2.max(degrees),
        );
    }
    if areas.1 > FOLDED * areas.0 {
        return Err(SkinError::TooCurved {
            degrees: areas.2,
            fits: None,
        });
    }
    Ok(())
}

/// Rejects implants that overlap: the outline of one base extends into another.
pub(super) fn apart(sites: &[Site]) -> Result<(), SkinError> {
    let into = |a: &Site, b: &Site| {
        let (own, other) = (a.order.implant, b.order.implant);
        (0..OUTLINE).any(|k| {
            let angle = std::f64::consts::TAU * f64::from(k) / f64::from(OUTLINE);
            let at = own
                .shape
                .place(Point2::new(libm::cos(angle), libm::sin(angle)), own.base);
            let at = b
                .frame
                .inverse_transform_point(&(a.frame * Point3::new(at.x, at.y, 0.0)));
            // An implant far below or above is on another side of the body.
            at.z.abs() <= 0.5 * other.base && other.shape.reach(at.xy(), other.base) < 1.0 - 1e-9
        })
    };
    for (k, b) in sites.iter().enumerate() {
        if let Some(j) = sites[..k].iter().position(|a| into(a, b) || into(b, a)) {
            return Err(SkinError::Overlap {
                first: j + 1,
                second: k + 1,
            });
        }
    }
    Ok(())
}

/// Downward direction at each point. One direction for all skin of an implant avoids folds; between
/// several implants the nearer one has the greater weight, by the fourth power of its nearness.
pub(super) fn downs(
    places: &[Point3<f64>],
    sites: &[(&ImplantSpec, &Isometry3<f64>)],
) -> Vec<Vector3<f64>> {
    let down = |frame: &Isometry3<f64>| frame * -Vector3::z();
    if let [(_, frame)] = sites {
        return vec![down(frame); places.len()];
    }
    let at = |p: &Point3<f64>| {
        let weighted = sites.iter().map(|(order, frame)| {
            let Implant { shape, base, .. } = order.implant;
            // Bounded in the centre.
            let reach = shape
                .reach(frame.inverse_transform_point(p).xy(), base)
                .max(0.1);
            down(frame) / reach.powi(4)
        });
        let sum = weighted.fold(Vector3::zeros(), |sum, d| sum + d);
        sum.try_normalize(0.0).unwrap_or_else(|| down(sites[0].1))
    };
    places.iter().map(at).collect()
}

/// The vector from each vertex to the one below it [m]: of length `depth`, but outside obstacles.
pub(super) fn inward(
    mesh: &TriangleMesh,
    downs: &[Vector3<f64>],
    depth: f64,
    obstacles: &[TriangleMesh],
) -> Vec<Vector3<f64>> {
    let surfaces: Vec<SurfaceTree> = obstacles
        .iter()
        .map(|o| SurfaceTree::new(&o.vertices, &o.triangles))
        .collect();
    let room = |p: &Point3<f64>| {
        let each = surfaces
            .iter()
            .filter_map(|s| s.closest(p, 2.0 * depth))
            .map(|c| c.distance);
        each.fold(f64::INFINITY, f64::min)
    };
    mesh.vertices
        .iter()
        .zip(downs)
        .map(|(p, down)| down * depth.min(ROOM * room(p)).max(0.02 * depth))
        .collect()
}

/// True if an obstacle is under the skin over the implant, within two bases: an obstacle elsewhere
/// would carry nothing, and the implant would sink into the body.
pub(super) fn lies_below(
    layers: &Layers,
    frame: &Isometry3<f64>,
    order: &ImplantSpec,
    obstacles: &[TriangleMesh],
) -> bool {
    let Implant { shape, base, .. } = order.implant;
    let down = frame * -Vector3::z();
    let skin = &layers.rest[..layers.count()];
    let over = |p: &&Point3<f64>| shape.reach(frame.inverse_transform_point(p).xy(), base) <= 1.0;
    obstacles.iter().map(Surface::new).any(|o| {
        let hit = |p: &Point3<f64>| {
            let (t, w) = o.first_hit(p, &down)?;
            let corners = o.triangles()[t as usize].map(|v| o.positions()[v as usize].coords);
            let place = corners[0] * w[0] + corners[1] * w[1] + corners[2] * w[2];
            Some((place - p.coords).norm())
        };
        skin.iter()
            .filter(over)
            .filter_map(hit)
            .any(|far| far <= DEEPEST * base)
    })
}
