//! Data derived from a scene's meshes alone: computed once, and shared by all simulations with the
//! same [`super::Assets`].
//!
//! Each part is a function of its arguments alone: a later simulation of the same meshes gets the
//! same bits as the first.

use std::sync::{Arc, Mutex, PoisonError};

use nalgebra::{Isometry3, Point3};
use rayon::prelude::*;

use super::attachments::Attached;
use super::fibres;
use crate::contact::apart::{self, Gaps, Inseparable, Moved, PartedPair, RigidBody, SoftBody};
use crate::contact::capsule::Capsule;
use crate::contact::untangle::{self, Untangled};
use crate::contact::{Obstacle, PosedObstacle, Projection, Surface};
use crate::fibres::anisotropy;
use crate::fibres::binding::BoundLines;
use crate::mesh::topology::Topology;
use crate::mesh::{TriangleMesh, order};
use crate::particles::Numbering;

/// Number of stored rest shapes of a muscle: one as read, others without overlap at other contact
/// thicknesses.
const SHAPES: usize = 4;

/// A cache of the last values of a function, each with its arguments.
struct Kept<T> {
    all: Mutex<Vec<Arc<T>>>,
    most: usize,
}

impl<T> Kept<T> {
    fn new(most: usize) -> Self {
        Self {
            all: Mutex::default(),
            most,
        }
    }

    /// The cached value for which `is` holds, otherwise the new value of `make`.
    fn get(&self, is: impl Fn(&T) -> bool, make: impl FnOnce() -> T) -> Arc<T> {
        if let Some(found) = self.find(&is) {
            return found;
        }
        // Without the lock: `make` can use the cache itself.
        let made = Arc::new(make());
        if let Some(found) = self.find(&is) {
            return found;
        }
        let mut all = self.lock();
        if all.len() >= self.most.max(1) {
            all.remove(0);
        }
        all.push(made.clone());
        made
    }

    fn find(&self, is: impl Fn(&T) -> bool) -> Option<Arc<T>> {
        let mut all = self.lock();
        let at = all.iter().position(|kept| is(kept))?;
        let found = all.remove(at);
        all.push(found.clone());
        Some(found)
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Vec<Arc<T>>> {
        // A list stays valid if a thread panics.
        self.all.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A value that is computed on first use.
///
/// Not a `OnceLock`: a thread that computes the value and waits for others can start another
/// simulation that needs the same value.
struct Once<T>(Mutex<Option<Arc<T>>>);

impl<T> Default for Once<T> {
    fn default() -> Self {
        Self(Mutex::new(None))
    }
}

impl<T> Once<T> {
    fn get(&self, make: impl FnOnce() -> T) -> Arc<T> {
        let lock = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let found = lock().clone();
        // Without the lock; a faster thread has computed the same value.
        found.unwrap_or_else(|| {
            let made = Arc::new(make());
            lock().get_or_insert(made).clone()
        })
    }
}

/// All derived data of a scene's meshes so far.
pub(super) struct Ready {
    surfaces: Kept<Surface>,
    capsules: Kept<Capsule>,
    rests: Kept<Rest>,
    clear: Kept<Clear>,
    parted: Kept<(Among, Result<Apart, Vec<Inseparable>>)>,
    obstacles: usize,
}

impl std::fmt::Debug for Ready {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Ready").finish_non_exhaustive()
    }
}

impl Ready {
    /// Creates empty caches for these numbers of muscles, capsules, and surfaces of bones and
    /// attachment areas.
    pub fn new(muscles: usize, capsules: usize, surfaces: usize) -> Self {
        Self {
            surfaces: Kept::new(surfaces),
            capsules: Kept::new(capsules),
            rests: Kept::new(SHAPES * muscles),
            clear: Kept::new(SHAPES * muscles),
            parted: Kept::new(SHAPES),
            obstacles: surfaces + capsules,
        }
    }

    /// Empty caches of the same sizes.
    pub fn emptied(&self) -> Self {
        Self {
            surfaces: Kept::new(self.surfaces.most),
            capsules: Kept::new(self.capsules.most),
            rests: Kept::new(self.rests.most),
            clear: Kept::new(self.clear.most),
            parted: Kept::new(self.parted.most),
            obstacles: self.obstacles,
        }
    }

    /// The search structure of a mesh.
    pub fn surface(&self, mesh: &TriangleMesh) -> Arc<Surface> {
        let is = |s: &Surface| s.triangles() == mesh.triangles && s.positions() == mesh.vertices;
        self.surfaces.get(is, || Surface::new(mesh))
    }

    /// A capsule of the given ends and radius [m].
    pub fn capsule(&self, ends: [Point3<f64>; 2], radius: f64) -> Arc<Capsule> {
        self.capsules.get(
            |c| c.ends == ends && c.radius == radius,
            || Capsule { ends, radius },
        )
    }

    /// A muscle's shape.
    pub fn rest(&self, mesh: &TriangleMesh) -> Arc<Rest> {
        self.rests.get(
            |rest| rest.mesh == *mesh,
            || Rest::new(mesh.clone(), self.obstacles),
        )
    }

    /// The muscles moved apart from each other, and to their sides of the bones.
    pub fn parted(&self, among: Among) -> Arc<(Among, Result<Apart, Vec<Inseparable>>)> {
        let is = |kept: &(Among, _)| kept.0.is(&among);
        let make = || {
            let parted = among.part(self);
            (among.clone(), parted)
        };
        self.parted.get(is, make)
    }

    /// A muscle's shape moved out of the obstacles to `thickness` [m], with the measures of
    /// [`untangle::untangle`].
    pub fn clear(
        &self,
        of: &Arc<Rest>,
        placed: &[PosedObstacle],
        obstacles: &[usize],
        thickness: f64,
    ) -> Arc<Clear> {
        let near: Vec<Arc<Near>> = obstacles
            .iter()
            .map(|&o| of.near(&placed[o].obstacle, &placed[o].now))
            .collect();
        let same = |kept: &[Arc<Near>]| {
            kept.len() == near.len() && kept.iter().zip(&near).all(|(a, b)| Arc::ptr_eq(a, b))
        };
        let is = |kept: &Clear| {
            Arc::ptr_eq(&kept.of, of) && kept.thickness == thickness && same(&kept.near)
        };
        self.clear.get(is, || {
            let closest = near.iter().flat_map(|near| &near.closest);
            let mut done = untangle::overlap(closest, thickness);
            let mut rest = of.clone();
            // A mesh without overlap is unchanged.
            if done.vertices > 0 || near.iter().any(|near| near.is_guard_inside(of)) {
                let mut mesh = of.mesh.clone();
                done = untangle::push_out(&mut mesh, done, placed, obstacles, thickness);
                rest = self.rest(&mesh);
            }
            Clear {
                of: of.clone(),
                near: near.clone(),
                thickness,
                rest,
                done,
            }
        })
    }
}

/// A muscle's shape without overlap.
pub(super) struct Clear {
    of: Arc<Rest>,
    near: Vec<Arc<Near>>,
    thickness: f64,
    /// The shape.
    pub rest: Arc<Rest>,
    /// Measures of the removal of overlap.
    pub done: Untangled,
}

/// The muscles and bones of a parting.
#[derive(Clone)]
pub(super) struct Among {
    /// Names of the muscles.
    pub names: Vec<String>,
    /// Their shapes as read.
    pub read: Vec<Arc<Rest>>,
    /// Their shapes without overlap with bones.
    pub clear: Vec<Arc<Rest>>,
    /// Their attached vertices.
    pub attached: Vec<Vec<Attached>>,
    /// Name, surface and pose of each bone.
    pub bones: Vec<(String, Arc<Surface>, Isometry3<f64>)>,
    /// Distances to keep.
    pub gaps: Gaps,
}

/// Muscles that were moved apart.
pub(super) struct Apart {
    /// Each muscle's shape, with its motion from the shape as read.
    pub muscles: Vec<(Arc<Rest>, Moved)>,
    /// The pairs that overlapped.
    pub pairs: Vec<PartedPair>,
}

impl Among {
    /// True if this is the same parting.
    fn is(&self, other: &Self) -> bool {
        let same = |a: &[Arc<Rest>], b: &[Arc<Rest>]| {
            a.len() == b.len() && a.iter().zip(b).all(|(a, b)| Arc::ptr_eq(a, b))
        };
        let bones = self.bones.iter().zip(&other.bones);
        same(&self.read, &other.read)
            && same(&self.clear, &other.clear)
            && self.names == other.names
            && self.attached == other.attached
            && self.gaps == other.gaps
            && self.bones.len() == other.bones.len()
            && bones
                .into_iter()
                .all(|((_, a, at), (_, b, there))| Arc::ptr_eq(a, b) && same_pose(at, there))
    }

    fn part(&self, ready: &Ready) -> Result<Apart, Vec<Inseparable>> {
        // Only a closed surface has an inside that others can leave.
        let closed: Vec<usize> = (0..self.clear.len())
            .filter(|&m| self.clear[m].topology().is_closed())
            .collect();
        let surfaces: Vec<Arc<Surface>> = closed.iter().map(|&m| self.clear[m].surface()).collect();
        let soft: Vec<SoftBody<'_>> = closed
            .iter()
            .zip(&surfaces)
            .map(|(&m, surface)| SoftBody {
                name: &self.names[m],
                mesh: &self.read[m].mesh,
                surface,
                held: self.attached[m].iter().map(|(v, _)| *v).collect(),
                fixed: false,
            })
            .collect();
        let rigid: Vec<RigidBody<'_>> = self
            .bones
            .iter()
            .map(|(name, surface, pose)| RigidBody {
                name,
                surface,
                pose: *pose,
            })
            .collect();
        let parted = apart::part(&soft, &rigid, self.gaps);
        if !parted.left.is_empty() {
            return Err(parted.left);
        }
        let mut muscles: Vec<(Arc<Rest>, Moved)> = self
            .clear
            .iter()
            .map(|rest| (rest.clone(), Moved::default()))
            .collect();
        for ((&m, position), moved) in closed.iter().zip(parted.positions).zip(parted.moved) {
            let Some(vertices) = position else { continue };
            let mesh = TriangleMesh {
                vertices,
                triangles: self.clear[m].mesh.triangles.clone(),
            };
            muscles[m] = (ready.rest(&mesh), moved);
        }
        Ok(Apart {
            muscles,
            pairs: parted.pairs,
        })
    }
}

/// A muscle's rest shape with its derived data so far.
pub(super) struct Rest {
    /// The shape.
    pub mesh: TriangleMesh,
    topology: Once<Topology>,
    numbering: Once<Numbering>,
    surface: Once<Surface>,
    near: Kept<Near>,
    fibres: Kept<Fibres>,
    computed: Kept<Computed>,
}

impl Rest {
    fn new(mesh: TriangleMesh, obstacles: usize) -> Self {
        Self {
            mesh,
            topology: Once::default(),
            numbering: Once::default(),
            surface: Once::default(),
            near: Kept::new(obstacles),
            fibres: Kept::new(1),
            computed: Kept::new(1),
        }
    }

    /// Topology of the shape.
    pub fn topology(&self) -> Arc<Topology> {
        self.topology.get(|| Topology::new(&self.mesh))
    }

    /// An order with neighbours near each other in memory, if the mesh has another one.
    pub fn numbering(&self) -> Arc<Numbering> {
        self.numbering.get(|| {
            let topology = self.topology();
            let better = Numbering::new(order::permutation(&topology));
            let reach = |&[a, b]: &[u32; 2]| better.place(a).abs_diff(better.place(b));
            let bandwidth = topology.edges.iter().map(reach).max().unwrap_or(0);
            if bandwidth < order::bandwidth(&topology) {
                better
            } else {
                Numbering::default()
            }
        })
    }

    /// Search structure of the shape.
    pub fn surface(&self) -> Arc<Surface> {
        self.surface.get(|| Surface::new(&self.mesh))
    }

    /// The nearest point of an obstacle in a pose to each vertex.
    pub fn near(&self, obstacle: &Arc<dyn Obstacle>, pose: &Isometry3<f64>) -> Arc<Near> {
        let is = |near: &Near| Arc::ptr_eq(&near.obstacle, obstacle) && same_pose(&near.pose, pose);
        self.near.get(is, || {
            let back = pose.inverse();
            let closest = self
                .mesh
                .vertices
                .par_iter()
                .map(|v| obstacle.closest(&(back * v)))
                .collect();
            Near {
                obstacle: obstacle.clone(),
                pose: *pose,
                closest,
                is_guard_inside: Once::default(),
            }
        })
    }

    /// Fibres computed from one area to the other.
    pub fn computed(&self, areas: [Vec<u32>; 2], count: usize) -> Arc<Computed> {
        let is = |kept: &Computed| kept.areas == areas && kept.count == count;
        self.computed.get(is, || {
            let lines = fibres::compute(&self.mesh, &areas, count);
            Computed {
                areas: areas.clone(),
                count,
                lines,
            }
        })
    }

    /// Polylines bound to the shape, and the edges `points` with their cosines to the fibres.
    pub fn fibres(&self, lines: &[Vec<Point3<f64>>], points: &[[u32; 2]]) -> Arc<Fibres> {
        self.fibres.get(
            |fibres| fibres.lines == lines && fibres.points == points,
            || {
                let empty = lines.is_empty() || self.mesh.triangles.is_empty();
                let bound = if empty {
                    BoundLines::default()
                } else {
                    BoundLines::new(&self.surface(), lines)
                };
                Fibres {
                    lines: lines.to_vec(),
                    points: points.to_vec(),
                    bound,
                    cosines: Once::default(),
                }
            },
        )
    }
}

/// The nearest points of an obstacle to each vertex of a shape.
pub(super) struct Near {
    obstacle: Arc<dyn Obstacle>,
    pose: Isometry3<f64>,
    /// Nearest points in the obstacle's frame.
    pub closest: Vec<Option<Projection>>,
    is_guard_inside: Once<bool>,
}

impl Near {
    /// True if a sample point of the obstacle is inside the shape of this entry.
    fn is_guard_inside(&self, of: &Rest) -> bool {
        *self
            .is_guard_inside
            .get(|| untangle::is_sample_inside(&of.surface(), &*self.obstacle, &self.pose))
    }
}

/// Computed fibres.
pub(super) struct Computed {
    areas: [Vec<u32>; 2],
    count: usize,
    /// The fibres [m], or the reason why there are none.
    pub lines: Result<Vec<Vec<Point3<f64>>>, String>,
}

/// A muscle's fibres.
pub(super) struct Fibres {
    lines: Vec<Vec<Point3<f64>>>,
    /// End points of the edges.
    pub points: Vec<[u32; 2]>,
    /// Fibres bound to the shape.
    pub bound: BoundLines,
    cosines: Once<Vec<Option<f64>>>,
}

impl Fibres {
    /// Cosine of each edge's angle to the nearest fibre: see [`anisotropy::cosines`].
    pub fn cosines(&self, of: &Rest) -> Arc<Vec<Option<f64>>> {
        let x = &of.mesh.vertices;
        self.cosines
            .get(|| anisotropy::cosines(x, &self.points, &self.bound.at(x)))
    }
}

/// True if two poses have the same numbers; a rotation has two quaternions.
pub(super) fn same_pose(a: &Isometry3<f64>, b: &Isometry3<f64>) -> bool {
    a.translation.vector == b.translation.vector && a.rotation.coords == b.rotation.coords
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_wanted_again_is_not_made_again_and_what_is_not_goes_first() {
        let kept = Kept::new(2);
        let made = std::cell::Cell::new(0);
        let square = |n: i32| {
            let make = || {
                made.set(made.get() + 1);
                (n, n * n)
            };
            kept.get(|kept: &(i32, i32)| kept.0 == n, make).1
        };
        assert_eq!([2, 3, 2, 4, 2].map(square), [4, 9, 4, 16, 4]);
        assert_eq!(made.get(), 3);
        // 3 was the least recently used value, so 4 replaced it.
        assert_eq!((square(3), made.get()), (9, 4));
    }

    #[test]
    fn a_shape_is_known_by_its_every_vertex() {
        let ready = Ready::new(1, 0, 1);
        let mesh = crate::mesh::shapes::icosphere(0.1, 1);
        let rest = ready.rest(&mesh);
        assert!(Arc::ptr_eq(&rest, &ready.rest(&mesh.clone())));
        let mut other = mesh.clone();
        other.vertices[7].x = other.vertices[7].x.next_up();
        assert!(!Arc::ptr_eq(&rest, &ready.rest(&other)));
        assert!(Arc::ptr_eq(&ready.surface(&mesh), &ready.surface(&mesh)));
        assert!(!Arc::ptr_eq(&ready.surface(&mesh), &ready.surface(&other)));
    }
}
