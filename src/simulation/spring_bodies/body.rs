//! Bodies of springs as a scene describes them, and the meshes of rigid ones.

use nalgebra::{Point3, Vector3};

use crate::mesh::measures::{Aabb, volume};
use crate::mesh::{Topology, TriangleMesh};
use crate::scene::content::{SpringBodiesScene, SpringBodySpec};
use crate::scene::{BoneSpec, Source};
use crate::simulation::assets::{mended, named_at, read_scaled};
use crate::simulation::fault::{Fault, LoadError};
use crate::springs::hooke::Springs;
use crate::springs::lattice::LatticeShape;
use crate::springs::volume::TrueVolume;
use crate::springs::{SpringSystem, mass, patterns};

/// Points are the lowest ones to this share of the size of a body.
const LOWEST: f64 = 1e-9;

/// A body of springs.
pub(super) struct SoftBody {
    pub name: String,
    pub system: SpringSystem,
    /// The points of the surface, and its triangles among them.
    pub points: Vec<u32>,
    pub triangles: Vec<[u32; 3]>,
    /// The surface at the start.
    pub start: TriangleMesh,
    /// The volume that it encloses at the start [m^3]; 0 for an open surface.
    volume: f64,
    pub springs: usize,
}

impl SoftBody {
    pub fn surface(&self) -> Vec<Point3<f64>> {
        let each = self.points.iter();
        each.map(|&p| self.system.position[p as usize]).collect()
    }

    pub fn velocities(&self) -> Vec<Vector3<f64>> {
        let each = self.points.iter();
        each.map(|&p| self.system.velocity[p as usize]).collect()
    }

    /// Change of its volume, relative to the start.
    pub fn volume_change(&self) -> f64 {
        match self.volume > 0.0 {
            true => volume(&self.surface(), &self.triangles) / self.volume - 1.0,
            false => 0.0,
        }
    }
}

/// The mesh of a rigid body.
pub(super) fn rigid(
    scene: &SpringBodiesScene,
    spec: &BoneSpec,
    key: &str,
) -> Result<TriangleMesh, LoadError> {
    let mesh = mesh_of(scene, &spec.surface, (key, &spec.name))?;
    Ok(mended(mesh, spec.repair.as_ref(), &mut Vec::new()))
}

/// A mesh that must have triangles.
fn mesh_of(
    scene: &SpringBodiesScene,
    source: &Source,
    (key, name): (&str, &str),
) -> Result<TriangleMesh, LoadError> {
    let mesh = read_scaled(source)?.mesh;
    if mesh.triangles.is_empty() {
        let fault = Fault::NoTriangles {
            file: name.to_owned(),
        };
        let key = named_at(source, key, "mesh");
        return Err(LoadError::at(&scene.origin, &key, name.to_owned(), fault));
    }
    Ok(mesh)
}

/// Points [m], triangles of the surface, and the ends of each spring.
type Points = (Vec<Point3<f64>>, Vec<[u32; 3]>, Vec<[u32; 2]>);

/// A body of springs at its place, with its velocity.
pub(super) fn soft(
    scene: &SpringBodiesScene,
    spec: &SpringBodySpec,
    key: &str,
) -> Result<SoftBody, LoadError> {
    let refused = |below: &str, fault: Fault| {
        let key = format!("{key}.{below}");
        LoadError::at(&scene.origin, &key, spec.name.clone(), fault)
    };
    let (x, triangles, pairs) = points_of(scene, spec, key)?;
    let masses = match spec.lattice {
        Some(_) => vec![spec.mass / x.len() as f64; x.len()],
        None => {
            let whole = TriangleMesh {
                vertices: x.clone(),
                triangles: triangles.clone(),
            };
            mass::by_area(&whole, spec.mass).map_err(|error| refused("mass", unfit(error)))?
        }
    };
    let springs = patterns::at_rest(&x, pairs, |_| spec.stiffness);
    let springs = Springs::new(x.len(), springs).map_err(|e| refused("stiffness", unfit(e)))?;
    let count = springs.springs().len();
    let mut system = SpringSystem::new(x, masses).map_err(|e| refused("mass", unfit(e)))?;
    system
        .add(springs)
        .map_err(|error| refused("stiffness", unfit(error)))?;
    if let Some(bulk) = spec.bulk_modulus {
        let held = TrueVolume::new(&system.position, &triangles, bulk, None, &[])
            .map_err(|error| refused("bulk_modulus", unfit(error)))?;
        system
            .add(held)
            .map_err(|error| refused("bulk_modulus", unfit(error)))?;
    }
    system.damping = spec.damping;
    if scene.gravity != Vector3::zeros() {
        system.load = system.mass().iter().map(|m| scene.gravity * *m).collect();
    }
    if let Some(&index) = spec.held.iter().find(|&&v| v as usize >= system.len()) {
        let fault = Fault::NoSuchVertex {
            index,
            count: system.len(),
            refined: false,
        };
        return Err(refused("held", fault));
    }
    system.velocity.fill(spec.velocity);
    if spec.holds_lowest {
        system.pin(lowest(&system.position));
    }
    system.pin(spec.held.iter().copied());
    Ok(SoftBody::new(spec.name.clone(), system, &triangles, count))
}

fn unfit(why: impl std::fmt::Display) -> Fault {
    Fault::SpringBodies {
        why: why.to_string(),
    }
}

/// The points of a body at its place.
fn points_of(
    scene: &SpringBodiesScene,
    spec: &SpringBodySpec,
    key: &str,
) -> Result<Points, LoadError> {
    let (mut x, triangles, pairs) = match (&spec.lattice, &spec.surface) {
        (Some((points, side, neighbours)), _) => {
            let shape = LatticeShape::with_longest_side(*points, *side).map_err(|error| {
                let key = format!("{key}.lattice");
                LoadError::at(&scene.origin, &key, spec.name.clone(), error.into())
            })?;
            let faces = shape.faces().map(|corners| corners.map(|p| shape.index(p)));
            let pairs = patterns::lattice(&shape, *neighbours);
            (shape.positions(), faces.collect(), pairs.collect())
        }
        (None, Some(source)) => {
            let mesh = mesh_of(scene, source, (key, &spec.name))?;
            let topology = Topology::new(&mesh);
            (mesh.vertices, mesh.triangles, topology.edges)
        }
        (None, None) => Points::default(),
    };
    x.iter_mut().for_each(|x| *x += spec.at);
    Ok((x, triangles, pairs))
}

/// The lowest points along y.
fn lowest(x: &[Point3<f64>]) -> Vec<u32> {
    let bounds = Aabb::of_points(x);
    let most = bounds.min.y + LOWEST * bounds.extents().amax();
    let each = (0u32..).zip(x);
    each.filter(|(_, x)| x.y <= most).map(|(p, _)| p).collect()
}

impl SoftBody {
    /// A body with the surface `triangles` among the points of a system.
    fn new(name: String, system: SpringSystem, triangles: &[[u32; 3]], springs: usize) -> Self {
        let mut points: Vec<u32> = triangles.iter().flatten().copied().collect();
        points.sort_unstable();
        points.dedup();
        let place = |p: u32| points.binary_search(&p).map_or(0, |k| k as u32);
        let triangles: Vec<[u32; 3]> = triangles.iter().map(|t| t.map(place)).collect();
        let each = points.iter().map(|&p| system.position[p as usize]);
        let start = TriangleMesh {
            vertices: each.collect(),
            triangles: triangles.clone(),
        };
        let is_closed = Topology::new(&start).is_closed();
        Self {
            name,
            volume: if is_closed { start.volume() } else { 0.0 },
            springs,
            system,
            points,
            triangles,
            start,
        }
    }
}
