//! The displayed files of a run, read on demand and cached while there is memory.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::PathBuf;
use std::sync::Arc;

use nalgebra::{Isometry3, Point3};

use pliant::io::{MeshFile, PointData, ReadError, read_with_point_data};
use pliant::mesh::measures::Aabb;
use pliant::mesh::{Topology, TriangleMesh};
use pliant::morph::register::{FitMotion, fit};

/// Greatest distance of a bone's vertex from its position in the pose, relative to the size of the
/// bone.
const RIGID: f64 = 1e-6;

/// Prefixes of the file names of rigid bodies.
const RIGID_NAMES: [&str; 2] = ["bone_", "obstacle_"];

/// The name of a ball under skin.
const BALL: &str = "ball";

/// True if a file name is that of a rigid body.
pub(super) fn is_rigid(name: &str) -> bool {
    name == BALL || RIGID_NAMES.iter().any(|start| name.starts_with(start))
}

/// A name without the prefix of rigid bodies.
pub(super) fn plain_name(name: &str) -> &str {
    RIGID_NAMES
        .iter()
        .find_map(|start| name.strip_prefix(start))
        .unwrap_or(name)
}

/// Data that are constant from frame to frame while a surface keeps its triangles.
#[derive(Debug, PartialEq)]
pub(super) struct Shape {
    pub triangles: Vec<[u32; 3]>,
    lines: Vec<Vec<u32>>,
    /// Edges of triangles and lines.
    pub edges: Vec<[u32; 2]>,
    /// Fixed vertices.
    pub held: Vec<u32>,
    pub origin: Origin,
}

/// Writer of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Origin {
    /// A run of a scene: a muscle, skin, an implant, a lattice.
    Scene,
    /// A surface without fields: a geometric muscle.
    Bare,
    /// Lines without fields: fibres.
    Lines,
    /// Any other writer.
    Other,
}

/// A deformable body in one frame; a field missing in the file is empty.
#[derive(Debug)]
pub(super) struct Deformed {
    pub shape: Arc<Shape>,
    pub positions: Vec<Point3<f64>>,
    pub stretch: Vec<f64>,
    pub depth: Vec<f64>,
    pub speed: Vec<f64>,
}

/// Content of a file.
#[derive(Debug)]
pub(super) enum Shown {
    /// A bone with a pose.
    Bone {
        own: Arc<TriangleMesh>,
        pose: Isometry3<f64>,
    },
    /// A deformable body.
    Body(Deformed),
}

/// Data of a part from the files read so far.
#[derive(Debug, Default)]
struct Known {
    /// The bone in its first file.
    bone: Option<Arc<TriangleMesh>>,
    /// The last shape.
    shape: Option<Arc<Shape>>,
}

/// The files of a run.
#[derive(Debug)]
pub(super) struct Files {
    folder: PathBuf,
    known: Vec<Known>,
    cache: Cache,
}

impl Files {
    /// Files of `parts` parts in a folder; the cache contains up to `most` bytes.
    pub fn new(folder: PathBuf, parts: usize, most: usize) -> Self {
        let known = std::iter::repeat_with(Known::default).take(parts).collect();
        Self {
            folder,
            known,
            cache: Cache {
                most,
                ..Cache::default()
            },
        }
    }

    /// The content of a file for a part, both by index and name.
    pub fn get(
        &mut self,
        (part, name): (usize, &str),
        (file, path): (usize, &str),
    ) -> Result<Arc<Shown>, ReadError> {
        if let Some(shown) = self.cache.get((part, file)) {
            return Ok(shown);
        }
        let (mesh, data) = read_with_point_data(&self.folder.join(path))?;
        let (shown, bytes) = self.known[part].shown(is_rigid(name), mesh, &data);
        let shown = Arc::new(shown);
        self.cache.put((part, file), shown.clone(), bytes);
        Ok(shown)
    }
}

impl Known {
    /// The content of a file, with its approximate size in memory.
    fn shown(&mut self, is_rigid: bool, file: MeshFile, data: &[PointData]) -> (Shown, usize) {
        let MeshFile { mesh, lines, .. } = file;
        if is_rigid && data.is_empty() && lines.is_empty() {
            // The first file stays in memory during the whole session.
            let own = self
                .bone
                .get_or_insert_with(|| Arc::new(mesh.clone()))
                .clone();
            if let Some(pose) = pose_of(&own, &mesh) {
                return (Shown::Bone { own, pose }, size_of::<Shown>());
            }
        }
        let (shape, is_new) = self.shape_of(&mesh, lines, data);
        let field = |name: &str| values(data, name).map(<[f64]>::to_vec).unwrap_or_default();
        let body = Deformed {
            shape,
            positions: mesh.vertices,
            stretch: field("edge_stretch"),
            depth: field("depth_m"),
            speed: field("speed_m_s"),
        };
        let numbers =
            3 * body.positions.len() + body.stretch.len() + body.depth.len() + body.speed.len();
        let fresh = if is_new { body.shape.bytes() } else { 0 };
        (
            Shown::Body(body),
            size_of::<Shown>() + size_of::<f64>() * numbers + fresh,
        )
    }

    /// The last shape if it is still the same, otherwise a new one.
    fn shape_of(
        &mut self,
        mesh: &TriangleMesh,
        lines: Vec<Vec<u32>>,
        data: &[PointData],
    ) -> (Arc<Shape>, bool) {
        if let Some(last) = self
            .shape
            .as_ref()
            .filter(|s| s.triangles == mesh.triangles && s.lines == lines)
        {
            return (last.clone(), false);
        }
        let held = values(data, "attached")
            .or_else(|| values(data, "held"))
            .unwrap_or_default();
        let origin = match (data.is_empty(), mesh.triangles.is_empty()) {
            (true, true) => Origin::Lines,
            (true, false) => Origin::Bare,
            _ if values(data, "attached").is_some() => Origin::Scene,
            _ => Origin::Other,
        };
        let shape = Arc::new(Shape {
            edges: edges(mesh, &lines),
            triangles: mesh.triangles.clone(),
            lines,
            held: (0u32..)
                .zip(held)
                .filter(|(_, is)| **is > 0.0)
                .map(|(v, _)| v)
                .collect(),
            origin,
        });
        self.shape = Some(shape.clone());
        (shape, true)
    }
}

impl Shape {
    fn bytes(&self) -> usize {
        let corners: usize = self.lines.iter().map(|line| line.len() + 6).sum();
        size_of::<u32>()
            * (3 * self.triangles.len() + 2 * self.edges.len() + self.held.len() + corners)
    }
}

/// The field with a name, one number per vertex.
fn values<'a>(data: &'a [PointData], name: &str) -> Option<&'a [f64]> {
    data.iter()
        .find(|d| d.name == name && d.components == 1)
        .map(|d| d.values.as_slice())
}

/// Edges of triangles and segments of lines, each once.
fn edges(mesh: &TriangleMesh, lines: &[Vec<u32>]) -> Vec<[u32; 2]> {
    let mut edges = Topology::new(mesh).edges;
    let sorted = |[a, b]: [u32; 2]| [a.min(b), a.max(b)];
    let mut seen: HashSet<[u32; 2]> = if lines.is_empty() {
        HashSet::new()
    } else {
        edges.iter().copied().map(sorted).collect()
    };
    let pieces = lines
        .iter()
        .flat_map(|line| line.windows(2))
        .map(|pair| [pair[0], pair[1]]);
    edges.extend(
        pieces
            .filter(|[a, b]| a != b)
            .filter(|piece| seen.insert(sorted(*piece))),
    );
    edges
}

/// The pose of a bone from its vertices; `None` if it was deformed or is another bone.
fn pose_of(own: &TriangleMesh, seen: &TriangleMesh) -> Option<Isometry3<f64>> {
    if own == seen {
        return Some(Isometry3::identity());
    }
    if own.triangles != seen.triangles || own.vertices.len() != seen.vertices.len() {
        return None;
    }
    let pose = fit(
        &own.vertices,
        &seen.vertices,
        &vec![1.0; own.vertices.len()],
        FitMotion::Rigid,
    )?
    .isometry;
    let most = RIGID * Aabb::of_points(&own.vertices).extents().norm();
    let is_there = own
        .vertices
        .iter()
        .zip(&seen.vertices)
        .all(|(p, q)| (pose * p - q).norm() <= most);
    is_there.then_some(pose)
}

/// A cache of files; the least recently used is removed first.
#[derive(Debug, Default)]
struct Cache {
    most: usize,
    bytes: usize,
    clock: u64,
    kept: HashMap<(usize, usize), (Arc<Shown>, usize, u64)>,
    by_use: BTreeMap<u64, (usize, usize)>,
}

impl Cache {
    fn get(&mut self, key: (usize, usize)) -> Option<Arc<Shown>> {
        let (shown, _, used) = self.kept.get_mut(&key)?;
        self.clock += 1;
        self.by_use.remove(used);
        *used = self.clock;
        self.by_use.insert(self.clock, key);
        Some(shown.clone())
    }

    fn put(&mut self, key: (usize, usize), shown: Arc<Shown>, bytes: usize) {
        self.clock += 1;
        self.bytes += bytes;
        self.by_use.insert(self.clock, key);
        self.kept.insert(key, (shown, bytes, self.clock));
        // A file larger than the whole cache is kept only by its display.
        while self.bytes > self.most
            && let Some((_, oldest)) = self.by_use.pop_first()
        {
            self.bytes -= self.kept.remove(&oldest).map_or(0, |(_, bytes, _)| bytes);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;
    use pliant::mesh::shapes::icosphere;

    fn moved(mesh: &TriangleMesh, by: impl Fn(&Point3<f64>) -> Point3<f64>) -> TriangleMesh {
        TriangleMesh {
            vertices: mesh.vertices.iter().map(by).collect(),
            triangles: mesh.triangles.clone(),
        }
    }

    #[test]
    fn a_bone_has_a_pose_and_what_is_bent_has_none() {
        // A ball has no direction of its own, but its vertices have.
        let mesh = moved(&icosphere(0.02, 2), |p| p + Vector3::new(0.1, 1.0, -0.4));
        let turn = Isometry3::new(Vector3::new(0.02, -0.01, 0.3), Vector3::new(0.5, -2.0, 1.0));
        let there = moved(&mesh, |p| turn * p);
        let pose = pose_of(&mesh, &there).expect("it was only moved");
        let off = mesh
            .vertices
            .iter()
            .zip(&there.vertices)
            .map(|(p, q)| (pose * p - q).norm())
            .fold(0.0, f64::max);
        assert!(off <= 1e-14, "{off}");
        assert_eq!(pose_of(&mesh, &mesh), Some(Isometry3::identity()));
        let size = Aabb::of_points(&mesh.vertices).extents().norm();
        for (share, is_rigid) in [(0.5e-6, true), (2e-6, false)] {
            let mut bent = there.clone();
            bent.vertices[7].x += share * size;
            assert_eq!(pose_of(&mesh, &bent).is_some(), is_rigid, "{share}");
        }
        let mirrored = moved(&mesh, |p| Point3::new(-p.x, p.y, p.z));
        assert_eq!(pose_of(&mesh, &mirrored), None);
        let mut other = there.clone();
        other.triangles.swap(0, 1);
        assert_eq!(pose_of(&mesh, &other), None);
        // Coincident points have no size as the scale of an error.
        let point = |x: f64| moved(&mesh, |_| Point3::new(x, 0.0, 0.0));
        assert_eq!(pose_of(&point(0.0), &point(1.0)), None);
    }

    #[test]
    fn a_bone_that_is_bent_is_a_body() {
        let mesh = icosphere(0.02, 1);
        let mut known = Known::default();
        let file = |mesh: &TriangleMesh| MeshFile {
            mesh: mesh.clone(),
            ..MeshFile::default()
        };
        let (first, small) = known.shown(true, file(&mesh), &[]);
        assert!(matches!(first, Shown::Bone { .. }));
        let (bent, large) = known.shown(
            true,
            file(&moved(&mesh, |p| Point3::from(p.coords * 1.1))),
            &[],
        );
        assert!(matches!(bent, Shown::Body(_)) && large > small + 24 * mesh.vertices.len());
        assert!(matches!(
            known.shown(false, file(&mesh), &[]).0,
            Shown::Body(_)
        ));
    }

    #[test]
    fn shapes_are_shared_until_they_change() {
        let mesh = icosphere(0.02, 1);
        let mut known = Known::default();
        let data = |held: f64| {
            vec![PointData {
                name: "attached".into(),
                components: 1,
                values: vec![held; mesh.vertices.len()],
            }]
        };
        let (one, is_new) = known.shape_of(&mesh, Vec::new(), &data(1.0));
        assert!(is_new && one.held.len() == mesh.vertices.len() && one.origin == Origin::Scene);
        assert_eq!(one.edges.len(), 3 * mesh.triangles.len() / 2);
        let (two, is_new) = known.shape_of(&mesh, Vec::new(), &data(1.0));
        assert!(!is_new && Arc::ptr_eq(&one, &two));
        let (with, is_new) = known.shape_of(&mesh, vec![vec![0, 1, 11, 0]], &[]);
        assert!(is_new && with.origin == Origin::Bare && with.held.is_empty());
        let known_edges: HashSet<_> = one
            .edges
            .iter()
            .map(|e| [e[0].min(e[1]), e[0].max(e[1])])
            .collect();
        let fresh = [[0, 1], [1, 11], [0, 11]]
            .iter()
            .filter(|e| !known_edges.contains(*e))
            .count();
        assert_eq!(with.edges.len(), one.edges.len() + fresh);
    }

    #[test]
    fn what_was_used_longest_ago_goes_first() {
        let shown = |x: f64| {
            Arc::new(Shown::Bone {
                own: Arc::default(),
                pose: Isometry3::translation(x, 0.0, 0.0),
            })
        };
        let mut cache = Cache {
            most: 100,
            ..Cache::default()
        };
        for file in 0..4 {
            cache.put((0, file), shown(file as f64), 30);
        }
        assert!(cache.get((0, 0)).is_none() && cache.bytes == 90);
        assert!(cache.get((0, 1)).is_some());
        cache.put((0, 4), shown(4.0), 30);
        assert!(cache.get((0, 2)).is_none() && cache.get((0, 1)).is_some());
        cache.put((0, 5), shown(5.0), 1000);
        assert_eq!(
            (cache.bytes, cache.kept.len(), cache.by_use.len()),
            (0, 0, 0)
        );
    }
}
