//! The error of the mesh: the same scene runs beside the first run on triangles a quarter as large.
//!
//! Each triangle of a muscle is split in four at the midpoints of its edges. The shape at rest is the same, and
//! every vertex is one of the finer mesh as well. Bones stay as they are: they are the problem, not its
//! discretisation.

use nalgebra::Point3;

use super::frame::Stop;
use super::{Assets, Plan, Simulation};
use crate::mesh::TriangleMesh;
use crate::mesh::measures::max_or_nan;
use crate::mesh::quarters::quarters;
use crate::scene::{AreaSpec, Muscle, Scene};
use crate::simulation::LoadError;
use crate::state::{DecodeError, Reader, State, Writer};

/// The error of a mesh is this many times its distance from the finer one: that of first order, where the next
/// halvings add half of it, a quarter, and so on.
const OF_DISTANCE: f64 = 2.0;

/// The run on the finer mesh, and what it tells.
pub(super) struct FinerMesh {
    run: Box<Simulation>,
    /// RMS error of each muscle in its worst frame so far [m].
    muscles: Vec<f64>,
    /// RMS error of all vertices in the worst frame so far [m].
    all: f64,
}

impl FinerMesh {
    /// The run of a scene on the finer mesh.
    ///
    /// # Errors
    /// The scene cannot be prepared with this mesh.
    pub fn new(scene: &Scene, assets: &Assets) -> Result<Self, LoadError> {
        let (mut scene, mut assets) = (scene.clone(), assets.unprepared());
        for (muscle, asset) in scene.muscles.iter_mut().zip(&mut assets.muscles) {
            let edges = split(&mut asset.mesh);
            refine_lists(muscle, &edges, asset.mesh.vertices.len() - edges.len());
        }
        // An accuracy chooses its steps.
        if scene.accuracy.is_none() {
            scene.solver = scene.solver.with_twice_the_steps();
        }
        let plan = Plan::new(&scene, &assets);
        let run = Simulation::with(scene, assets, plan)?;
        Ok(Self {
            muscles: vec![0.0; run.bodies.len()],
            run: Box::new(run),
            all: 0.0,
        })
    }

    /// Number of vertices of all muscles.
    pub fn vertices(&self) -> usize {
        let counts = self.run.bodies.iter().map(|body| body.rest.vertices.len());
        counts.sum()
    }

    /// RMS error of all vertices in the worst frame so far [m]; NaN after a muscle stopped.
    pub fn all(&self) -> f64 {
        self.all
    }

    /// The same of a muscle.
    pub fn of_muscle(&self, muscle: usize) -> f64 {
        self.muscles[muscle]
    }

    /// Computes the frames up to `frame`. Returns false if it was stopped; the frames before stay.
    pub fn goes_to(&mut self, frame: usize, stop: Stop<'_>) -> bool {
        while self.run.frame() < frame {
            if !self.run.next_frame(stop) {
                return false;
            }
        }
        true
    }

    /// Compares a run at the same frame with it.
    pub fn compare(&mut self, with: &Simulation) {
        let (mut sum, mut count) = (0.0, 0);
        for ((body, finer), most) in with
            .bodies
            .iter()
            .zip(&self.run.bodies)
            .zip(&mut self.muscles)
        {
            let (vertices, has_stopped) = (body.rest.vertices.len(), finer.stopped.is_some());
            let square = match has_stopped {
                true => f64::NAN,
                false => squared_distance(
                    &body.system.particles.position[..vertices],
                    &finer.system.particles.position,
                ),
            };
            let rms = (square / vertices.max(1) as f64).sqrt();
            *most = max_or_nan([*most, OF_DISTANCE * rms]);
            sum += square;
            count += vertices;
        }
        let rms = (sum / count.max(1) as f64).sqrt();
        self.all = max_or_nan([self.all, OF_DISTANCE * rms]);
    }
}

fn squared_distance(coarse: &[Point3<f64>], finer: &[Point3<f64>]) -> f64 {
    let each = coarse.iter().zip(finer);
    each.map(|(a, b)| (a - b).norm_squared()).sum()
}

/// Splits each triangle in four. Returns the ends of each edge with a new vertex; the new vertices follow the others.
fn split(mesh: &mut TriangleMesh) -> Vec<[u32; 2]> {
    let (triangles, edges) = quarters(&mesh.triangles, mesh.vertices.len() as u32);
    let at = |v: u32| mesh.vertices[v as usize];
    let middles: Vec<_> = edges
        .iter()
        .map(|&[a, b]| nalgebra::center(&at(a), &at(b)))
        .collect();
    mesh.vertices.extend(middles);
    mesh.triangles = triangles;
    edges
}

/// A new vertex between two of a list belongs to the list too, except for forces: each vertex keeps its own.
fn refine_lists(muscle: &mut Muscle, edges: &[[u32; 2]], count: usize) {
    let refine = |list: &mut Vec<u32>| {
        let mut is_in = vec![false; count];
        for &v in &*list {
            // A wrong one is refused later, by its name.
            if let Some(is_in) = is_in.get_mut(v as usize) {
                *is_in = true;
            }
        }
        let both = |[a, b]: &[u32; 2]| is_in[*a as usize] && is_in[*b as usize];
        let new = edges.iter().enumerate().filter(|(_, edge)| both(edge));
        list.extend(new.map(|(k, _)| (count + k) as u32));
    };
    let areas = muscle.attachments.iter_mut().map(|held| &mut held.area);
    let lists = areas.filter_map(|area| match area {
        AreaSpec::Vertices(list) => Some(list),
        AreaSpec::Near(_) | AreaSpec::Patch { .. } => None,
    });
    let moved = muscle.displacements.iter_mut().map(|at| &mut at.vertices);
    lists.chain(moved).for_each(refine);
}

impl State for FinerMesh {
    fn save(&self, to: &mut Writer) {
        let Self { run, muscles, all } = self;
        run.save(to);
        to.list(muscles);
        to.put(all);
    }

    fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), DecodeError> {
        self.run.restore(from)?;
        let muscles: Vec<f64> = from.take()?;
        let is_right = muscles.len() == self.muscles.len();
        from.check(is_right, "another number of muscles")?;
        self.muscles = muscles;
        self.all = from.take()?;
        Ok(())
    }
}
