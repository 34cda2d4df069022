//! The shape at rest of what was scanned under a load: gravity, forces, activation.
//!
//! A scan shows an equilibrium. The simulation of a scene takes it for the shape at rest, and lets it sag once more. The
//! shape X sought is that whose equilibrium x(X) is the scan. Each round moves it by what is left, `X + scan - x(X)`, and
//! mixes the last rounds so that least is left (Anderson). The reverse load on the scan is no answer: stiffness has the
//! direction of the deformed shape there (Whiteley 2005).

use nalgebra::{DMatrix, DVector, Point3, Vector3};

use super::muscles::{at_rest, step};
use super::{LoadError, SensitivityError};
use crate::mesh::TriangleMesh;
use crate::mesh::measures::max_or_nan;
use crate::progress::Progress;
use crate::scene::{Content, Scene};
use crate::simulation::{Assets, Plan, Simulation};

/// Greatest number of rounds, and of earlier ones that are mixed.
const ROUNDS: usize = 60;
const MIXED: usize = 3;

/// A round that leaves this many times as much as the best one is taken back, and the next steps are half as long.
const WORSE: f64 = 1.5;
const SHORTEST: f64 = 1.0 / 16.0;

/// After this number of rounds without this part of what was left before, no shape is nearer.
const PATIENCE: usize = 6;
const LESS: f64 = 0.7;

/// The shapes at rest of a scene's muscles.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Unloaded {
    /// Name, shape at rest, and the distance of each vertex of its equilibrium from the scan [m].
    pub bodies: Vec<(String, TriangleMesh, Vec<f64>)>,
    /// The greatest distance after each round whose shape could start [m].
    pub rounds: Vec<f64>,
    /// Whether the equilibrium of these shapes has converged.
    pub is_at_rest: bool,
    /// How far the start of a run moves a vertex of the scan that lies in a bone or in another muscle [m]. The scan
    /// without that overlap is what the equilibrium meets.
    pub parted: f64,
}

/// Finds the shapes whose equilibrium in a frame is that of the meshes of a scene, to `tolerance` [m] at every vertex.
/// It ends with the best shape where that is not reached.
///
/// # Errors
/// A scene without muscles, or one whose equilibrium cannot be computed.
pub fn unload(
    content: &Content,
    frame: usize,
    tolerance: f64,
    progress: &dyn Progress,
) -> Result<Unloaded, SensitivityError> {
    let Content::Muscles(scene) = content else {
        return Err(SensitivityError::NotSupported(content.kind()));
    };
    let scene = Scene {
        frames: scene.frames.max(frame),
        ..at_rest(scene)
    };
    let assets = Assets::load(&scene)?;
    let plan = Plan::new(&scene, &assets);
    let forward = Forward {
        scene: &scene,
        assets: &assets,
        plan: &plan,
        frame,
    };
    let scan: Vec<Point3<f64>> = assets
        .muscles
        .iter()
        .flat_map(|muscle| muscle.mesh.vertices.iter().copied())
        .collect();
    // A run parts what lies in a bone or in another muscle: that is then what sags.
    let as_read = scan;
    let scan = Forward::positions(&forward.start(&as_read)?);
    let parted = max_or_nan(as_read.iter().zip(&scan).map(|(a, b)| (a - b).norm()));
    let (mut shape, mut best) = (
        scan.clone(),
        (f64::INFINITY, scan.clone(), Vec::new(), false),
    );
    let (mut rounds, mut mixing, mut share) = (Vec::new(), Mixing::default(), 1.0);
    for round in 0..ROUNDS {
        let stage = match rounds.last() {
            None => "equilibrium of the scan".to_owned(),
            Some(left) => format!("round {round}, {left:.1e} m are left"),
        };
        if progress.report(&stage, round, ROUNDS).is_break() {
            return Err(SensitivityError::Interrupted);
        }
        let found = match forward.equilibrium(&shape, progress) {
            // A guess that cannot start, such as one that a bone cuts in two, went too far.
            Err(SensitivityError::Load(_)) if round > 0 => None,
            found => Some(found?),
        };
        let mut left = Vec::new();
        let mut most = f64::INFINITY;
        if let Some((found, is_at_rest)) = found {
            left = scan.iter().zip(&found).map(|(a, b)| a - b).collect();
            most = max_or_nan(left.iter().map(Vector3::norm));
            rounds.push(most);
            if most < best.0 {
                best = (most, shape.clone(), found, is_at_rest);
            }
            if !best.0.is_finite() {
                let message = "the equilibrium of the scan has no positions".to_owned();
                return Err(SensitivityError::Failed(message));
            }
            let earlier = rounds.len().saturating_sub(PATIENCE);
            let before = rounds[..earlier].iter();
            let before = before.fold(f64::INFINITY, |a, b| if *b < a { *b } else { a });
            if most <= tolerance || best.0 > LESS * before {
                break;
            }
        }
        if !(most <= WORSE * best.0) {
            share *= 0.5;
            if share < SHORTEST {
                break;
            }
            mixing = Mixing::default();
            shape.clone_from(&best.1);
            let back = scan.iter().zip(&best.2).map(|(a, b)| a - b);
            let moves: Vec<_> = back.map(|by| by * share).collect();
            shape.iter_mut().zip(moves).for_each(|(x, by)| *x += by);
            continue;
        }
        let moves = mixing.next(&shape, left);
        shape
            .iter_mut()
            .zip(moves)
            .for_each(|(x, by)| *x += by * share);
    }
    let (_, shape, found, is_at_rest) = best;
    let mut first = 0;
    let mut bodies = Vec::new();
    for (muscle, asset) in scene.muscles.iter().zip(&assets.muscles) {
        let own = first..first + asset.mesh.vertices.len();
        first = own.end;
        let mesh = TriangleMesh {
            vertices: shape[own.clone()].to_vec(),
            triangles: asset.mesh.triangles.clone(),
        };
        let apart = scan[own.clone()].iter().zip(&found[own]);
        let apart = apart.map(|(a, b)| (a - b).norm());
        bodies.push((muscle.name.clone(), mesh, apart.collect()));
    }
    Ok(Unloaded {
        bodies,
        rounds,
        parted,
        is_at_rest,
    })
}

/// The simulation from a shape at rest to its equilibrium.
struct Forward<'a> {
    scene: &'a Scene,
    assets: &'a Assets,
    plan: &'a Plan,
    frame: usize,
}

impl Forward<'_> {
    /// A simulation whose muscles have these vertices at rest.
    fn start(&self, shape: &[Point3<f64>]) -> Result<Simulation, LoadError> {
        let mut assets = self.assets.unprepared();
        let mut rest = shape;
        for muscle in &mut assets.muscles {
            let (own, others) = rest.split_at(muscle.mesh.vertices.len());
            muscle.mesh.vertices.copy_from_slice(own);
            rest = others;
        }
        Simulation::with(self.scene.clone(), assets, self.plan.clone())
    }

    fn positions(run: &Simulation) -> Vec<Point3<f64>> {
        let each = run.bodies.iter().map(|body| {
            let count = body.rest.vertices.len();
            body.system.particles.position[..count].iter().copied()
        });
        each.flatten().collect()
    }

    /// The positions at the equilibrium of a shape, and whether it has converged.
    fn equilibrium(
        &self,
        shape: &[Point3<f64>],
        progress: &dyn Progress,
    ) -> Result<(Vec<Point3<f64>>, bool), SensitivityError> {
        let mut run = self.start(shape)?;
        while run.frame() < self.frame {
            step(&mut run, progress)?;
        }
        match run.bodies.iter().find(|body| body.stopped.is_some()) {
            Some(body) => Err(SensitivityError::Failed(format!(
                "{} has no equilibrium in frame {}: the load is too great for its material",
                body.name, self.frame
            ))),
            None => {
                let is_at_rest = run.measure().iter().all(|muscle| muscle.converged);
                Ok((Self::positions(&run), is_at_rest))
            }
        }
    }
}

/// A shape, and what was left of it.
type Round = (Vec<Point3<f64>>, Vec<Vector3<f64>>);

/// Anderson's mixing of the last rounds.
#[derive(Default)]
struct Mixing {
    /// Shape and what was left, of the last rounds.
    rounds: Vec<Round>,
}

impl Mixing {
    /// The move of a shape with this much left.
    fn next(&mut self, shape: &[Point3<f64>], left: Vec<Vector3<f64>>) -> Vec<Vector3<f64>> {
        let count = self.rounds.len();
        let mut moves = left.clone();
        let flat = |all: Vec<Vector3<f64>>| all.into_iter().flat_map(<[f64; 3]>::from);
        if count > 0 {
            let differences = self.rounds.iter().map(|(_, before)| {
                let each = left.iter().zip(before).map(|(a, b)| a - b);
                DVector::from_iterator(3 * left.len(), flat(each.collect()))
            });
            let columns: Vec<DVector<f64>> = differences.collect();
            let matrix = DMatrix::from_columns(&columns);
            let right = DVector::from_iterator(3 * left.len(), flat(left.clone()));
            // The normal equations are small; a weight of rounding keeps them solvable.
            let mut normal = matrix.transpose() * &matrix;
            let slight = 1e-14 * normal.trace();
            (0..count).for_each(|k| normal[(k, k)] += slight);
            if let Some(weights) = normal.lu().solve(&(matrix.transpose() * right))
                && weights.iter().all(|w| w.is_finite())
            {
                for ((before, was_left), weight) in self.rounds.iter().zip(weights.iter()) {
                    for (v, by) in moves.iter_mut().enumerate() {
                        let moved = (shape[v] - before[v]) + (left[v] - was_left[v]);
                        *by -= moved * *weight;
                    }
                }
            }
        }
        self.rounds.push((shape.to_vec(), left));
        if self.rounds.len() > MIXED {
            self.rounds.remove(0);
        }
        moves
    }
}
