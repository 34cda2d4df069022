//! Areas of origin and insertion of fibres, projected onto the muscle's surface.

use nalgebra::{Point3, Vector3};

use crate::contact::{Obstacle, Surface};
use crate::mesh::TriangleMesh;
use crate::mesh::closest::SurfaceTree;
use crate::mesh::measures::median;

/// Tendons connect a patch whose median distance is greater than this share of the muscle's length.
pub const TENDON_FROM: f64 = 0.02;
/// A patch farther than this share of the muscle's length belongs to something else or has another
/// unit.
pub const FARTHEST: f64 = 0.5;
/// Greatest number of sample points over a patch, so that a fine patch costs no more than a coarse
/// one.
const SAMPLES: usize = 1_500;

/// One of the two areas.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MuscleEnd {
    /// Where fibres begin.
    Origin,
    /// Where fibres end.
    Insertion,
}

impl std::fmt::Display for MuscleEnd {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Origin => "origin",
            Self::Insertion => "insertion",
        })
    }
}

/// Definition of an area.
#[derive(Clone, Copy, Debug)]
pub enum AreaSource<'a> {
    /// An open surface on or near the muscle, such as the area on the bone.
    Patch(&'a TriangleMesh),
    /// Vertices of the muscle. A vertex that completes no triangle of the list stands for all its
    /// triangles.
    Vertices(&'a [u32]),
    /// All vertices of the muscle within this distance [m] of a bone; a vertex inside a closed bone
    /// has the distance 0.
    Near(&'a TriangleMesh, f64),
}

/// An area on the surface of a muscle.
#[derive(Clone, Debug, PartialEq)]
pub struct Area {
    /// Triangles of the muscle, in ascending order.
    pub triangles: Vec<u32>,
    /// Vertices of these triangles, in ascending order.
    pub vertices: Vec<u32>,
    /// Distance of each of these vertices to the given patch or bone [m]; 0 for a list.
    pub distances: Vec<f64>,
    /// The patch, if it is so far away that tendons connect it.
    pub patch: Option<TriangleMesh>,
    /// An aponeurosis inside the muscle, if there is one.
    pub sheet: Option<TriangleMesh>,
}

impl Area {
    /// Corners of each triangle [m], and the number of its sides that fibres reach: one on the
    /// surface, two of the sheet inside.
    pub(super) fn pieces<'a>(
        &'a self,
        muscle: &'a TriangleMesh,
    ) -> impl Iterator<Item = ([Point3<f64>; 3], f64)> + 'a {
        let on_surface = self.triangles.iter();
        let on_surface = on_surface.map(|&t| (muscle.corners(t as usize), 1.0));
        let inside = self.sheet.iter();
        on_surface.chain(
            inside.flat_map(|sheet| (0..sheet.triangles.len()).map(|t| (sheet.corners(t), 2.0))),
        )
    }

    /// Tree over the triangles and the sheet inside, for closest points.
    pub fn tree(&self, muscle: &TriangleMesh) -> SurfaceTree {
        let mut triangles: Vec<[u32; 3]> = self
            .triangles
            .iter()
            .map(|&t| muscle.triangles[t as usize])
            .collect();
        let Some(sheet) = &self.sheet else {
            return SurfaceTree::new(&muscle.vertices, &triangles);
        };
        let first = muscle.vertices.len() as u32;
        triangles.extend(sheet.triangles.iter().map(|t| t.map(|v| v + first)));
        SurfaceTree::new(
            &[&muscle.vertices[..], &sheet.vertices].concat(),
            &triangles,
        )
    }
}

/// Error of [`Attachment::new`].
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum AttachmentError {
    /// A patch has no triangles, or a list no vertices.
    #[error("the area of the {end} is empty; give a patch with triangles, or at least one vertex")]
    Empty {
        /// Which area.
        end: MuscleEnd,
    },
    /// No vertex is near the bone.
    #[error(
        "no vertex of the muscle is within {within} m of the bone given for the {end}; the nearest is vertex {vertex}, \
         {distance:.6} m away: give a greater distance, or another bone"
    )]
    NothingNear {
        /// Which area.
        end: MuscleEnd,
        /// The given distance [m].
        within: f64,
        /// The vertex nearest to the bone.
        vertex: u32,
        /// Distance of that vertex [m].
        distance: f64,
    },
    /// A listed vertex does not exist.
    #[error("the {end} names vertex {vertex}, but the muscle has {count} vertices, counted from 0")]
    NoSuchVertex {
        /// Which area.
        end: MuscleEnd,
        /// The listed vertex.
        vertex: u32,
        /// Number of vertices of the muscle.
        count: usize,
    },
    /// The patch is far from the muscle.
    #[error(
        "the area of the {end} lies off the muscle: its nearest point is {distance:.6} m away, at ({}, {}, {}), and the \
         muscle is {length:.6} m long; check that both files are of the same body, in the same unit",
        .at.x, .at.y, .at.z
    )]
    OffSurface {
        /// Which area.
        end: MuscleEnd,
        /// Distance of the nearest point of the patch [m].
        distance: f64,
        /// The nearest point of the patch [m].
        at: Point3<f64>,
        /// Length of the muscle's bounding box [m].
        length: f64,
    },
    /// The two areas share vertices.
    #[error(
        "origin and insertion overlap in {count} vertices of the muscle, the first is vertex {vertex} at ({}, {}, {}); \
         make one of the areas smaller, or give a smaller distance to its bone",
        .at.x, .at.y, .at.z
    )]
    Overlapping {
        /// Number of common vertices.
        count: usize,
        /// The first common vertex.
        vertex: u32,
        /// Position of that vertex [m].
        at: Point3<f64>,
    },
    /// The muscle has no triangles.
    #[error("the muscle has no triangles")]
    NoMuscle,
}

/// Both areas of a muscle.
#[derive(Clone, Debug, PartialEq)]
pub struct Attachment {
    /// Where fibres begin.
    pub origin: Area,
    /// Where they end.
    pub insertion: Area,
    /// Line of action, a unit vector, where aponeuroses widen the areas; `None` for that of the
    /// fibres: from the mean of their origins to that of their insertions.
    pub action: Option<Vector3<f64>>,
    /// Lines inside along which fibres run from aponeurosis to aponeurosis [m]; none without.
    pub guides: Vec<Vec<Point3<f64>>>,
}

impl Attachment {
    /// Projects both areas onto the muscle's surface.
    ///
    /// # Errors
    /// An area is empty, off the surface, or shares vertices with the other.
    pub fn new(
        muscle: &TriangleMesh,
        origin: AreaSource<'_>,
        insertion: AreaSource<'_>,
    ) -> Result<Self, AttachmentError> {
        let tree = SurfaceTree::new(&muscle.vertices, &muscle.triangles);
        let origin = project(muscle, &tree, MuscleEnd::Origin, origin)?;
        let insertion = project(muscle, &tree, MuscleEnd::Insertion, insertion)?;
        let mut both = origin
            .vertices
            .iter()
            .filter(|v| insertion.vertices.binary_search(v).is_ok());
        if let Some(&vertex) = both.next() {
            let at = muscle.vertices[vertex as usize];
            return Err(AttachmentError::Overlapping {
                count: 1 + both.count(),
                vertex,
                at,
            });
        }
        Ok(Self {
            origin,
            insertion,
            action: None,
            guides: Vec::new(),
        })
    }

    /// The same areas without the patches that tendons lead to.
    pub fn without_tendons(mut self) -> Self {
        (self.origin.patch, self.insertion.patch) = (None, None);
        self
    }
}

fn project(
    muscle: &TriangleMesh,
    tree: &SurfaceTree,
    end: MuscleEnd,
    source: AreaSource<'_>,
) -> Result<Area, AttachmentError> {
    if muscle.triangles.is_empty() {
        return Err(AttachmentError::NoMuscle);
    }
    match source {
        AreaSource::Patch(patch) => from_patch(muscle, tree, end, patch),
        AreaSource::Vertices(list) => from_list(muscle, end, list),
        AreaSource::Near(bone, within) => {
            let list = near(muscle, end, bone, within)?;
            let mut area = from_list(muscle, end, &list)?;
            let surface = Surface::new(bone);
            let distance = |v: &u32| {
                surface
                    .closest(&muscle.vertices[*v as usize])
                    .map_or(0.0, |c| c.distance.max(0.0))
            };
            area.distances = area.vertices.iter().map(distance).collect();
            Ok(area)
        }
    }
}

pub(super) fn from_patch(
    muscle: &TriangleMesh,
    tree: &SurfaceTree,
    end: MuscleEnd,
    patch: &TriangleMesh,
) -> Result<Area, AttachmentError> {
    let length = muscle.length();
    let mut triangles = Vec::new();
    let mut distances = Vec::new();
    let mut nearest: Option<(f64, Point3<f64>)> = None;
    for p in samples(patch, muscle) {
        let Some(found) = tree.closest(&p, f64::INFINITY) else {
            continue;
        };
        triangles.push(found.triangle);
        distances.push(found.distance);
        if nearest.is_none_or(|(d, _)| found.distance < d) {
            nearest = Some((found.distance, p));
        }
    }
    let (Some((distance, at)), Some(middle)) = (nearest, median(distances)) else {
        return Err(AttachmentError::Empty { end });
    };
    if distance > FARTHEST * length {
        return Err(AttachmentError::OffSurface {
            end,
            distance,
            at,
            length,
        });
    }
    let mut area = of_triangles(muscle, triangles);
    let back = SurfaceTree::new(&patch.vertices, &patch.triangles);
    let gap = |v: &u32| {
        back.closest(&muscle.vertices[*v as usize], f64::INFINITY)
            .map_or(0.0, |c| c.distance)
    };
    area.distances = area.vertices.iter().map(gap).collect();
    area.patch = (middle > TENDON_FROM * length).then(|| patch.clone());
    Ok(area)
}

/// Sample points over a patch, with the spacing of the muscle's triangles.
fn samples(patch: &TriangleMesh, muscle: &TriangleMesh) -> Vec<Point3<f64>> {
    if patch.triangles.is_empty() || !(patch.area() > 0.0) {
        return Vec::new();
    }
    let spacing = (muscle.area() / muscle.triangles.len() as f64)
        .min(patch.area())
        .sqrt()
        / 3.0;
    let spacing = spacing.max((patch.area() / SAMPLES as f64).sqrt());
    (0..patch.triangles.len())
        .flat_map(|t| over_triangle(&patch.corners(t), spacing))
        .collect()
}

/// The centres of the parts of a triangle that lines about `spacing` [m] apart cut it into.
pub(super) fn over_triangle(corners: &[Point3<f64>; 3], spacing: f64) -> Vec<Point3<f64>> {
    let [a, b, c] = corners;
    let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
    let n = ((longest / spacing).ceil() as u32).clamp(1, 1000);
    let at = |i: f64, j: f64| a + (b - a) * (i / f64::from(n)) + (c - a) * (j / f64::from(n));
    let third = 1.0 / 3.0;
    let mut all = Vec::with_capacity((n * n) as usize);
    for i in 0..n {
        for j in 0..n - i {
            all.push(at(f64::from(i) + third, f64::from(j) + third));
            if i + j + 1 < n {
                all.push(at(f64::from(i) + 2.0 * third, f64::from(j) + 2.0 * third));
            }
        }
    }
    all
}

pub(super) fn of_triangles(muscle: &TriangleMesh, mut triangles: Vec<u32>) -> Area {
    triangles.sort_unstable();
    triangles.dedup();
    let mut vertices: Vec<u32> = triangles
        .iter()
        .flat_map(|&t| muscle.triangles[t as usize])
        .collect();
    vertices.sort_unstable();
    vertices.dedup();
    Area {
        distances: vec![0.0; vertices.len()],
        triangles,
        vertices,
        patch: None,
        sheet: None,
    }
}

fn from_list(muscle: &TriangleMesh, end: MuscleEnd, list: &[u32]) -> Result<Area, AttachmentError> {
    let count = muscle.vertices.len();
    if let Some(&vertex) = list.iter().find(|v| **v as usize >= count) {
        return Err(AttachmentError::NoSuchVertex { end, vertex, count });
    }
    let mut listed = vec![false; count];
    list.iter().for_each(|&v| listed[v as usize] = true);
    let mut spanned = vec![false; count];
    let whole = |t: &[u32; 3]| t.iter().all(|&v| listed[v as usize]);
    muscle
        .triangles
        .iter()
        .filter(|t| whole(t))
        .flatten()
        .for_each(|&v| spanned[v as usize] = true);
    // A vertex alone is a point, and a field cannot have a prescribed value at a point.
    let lone = |t: &[u32; 3]| {
        t.iter()
            .any(|&v| listed[v as usize] && !spanned[v as usize])
    };
    let triangles: Vec<u32> = (0..muscle.triangles.len() as u32)
        .filter(|t| {
            let corners = &muscle.triangles[*t as usize];
            whole(corners) || lone(corners)
        })
        .collect();
    if triangles.is_empty() {
        return Err(AttachmentError::Empty { end });
    }
    Ok(of_triangles(muscle, triangles))
}

fn near(
    muscle: &TriangleMesh,
    end: MuscleEnd,
    bone: &TriangleMesh,
    within: f64,
) -> Result<Vec<u32>, AttachmentError> {
    let surface = Surface::new(bone);
    let mut nearest: Option<(f64, u32)> = None;
    let mut list = Vec::new();
    let mut used = vec![false; muscle.vertices.len()];
    muscle
        .triangles
        .iter()
        .flatten()
        .for_each(|&v| used[v as usize] = true);
    for (v, p) in muscle.vertices.iter().enumerate().filter(|(v, _)| used[*v]) {
        let Some(found) = surface.closest(p) else {
            continue;
        };
        let distance = found.distance.max(0.0);
        if nearest.is_none_or(|(d, _)| distance < d) {
            nearest = Some((distance, v as u32));
        }
        if distance <= within {
            list.push(v as u32);
        }
    }
    match nearest {
        None => Err(AttachmentError::Empty { end }),
        Some((distance, vertex)) if list.is_empty() => Err(AttachmentError::NothingNear {
            end,
            within,
            vertex,
            distance,
        }),
        Some(_) => Ok(list),
    }
}
