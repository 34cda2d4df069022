//! Harmonic decomposition: fibres along the gradient of a field that is 0 at the origin and 1 at the insertion.
//!
//! The field is solved in cubes that cover the inside ([`cells`], [`field`]); which points are inside is decided by the
//! winding number. Fibres are its streamlines ([`trace`]): the flow maps each cross-section of constant value one to one
//! onto the next, so that fibres do not cross, and it does so for elongated muscles as for any. Each next fibre goes
//! through the point farthest from all before ([`seeds`]).

pub mod cells;
mod exchange;
pub mod field;
pub mod jacobian;
pub mod seeds;
pub mod spread;
pub mod trace;

use nalgebra::Point3;
use rayon::prelude::*;

use super::attachment::Attachment;
use super::polyline::resample;
use super::solid::{Closed, Solid};
use crate::mesh::{TriangleMesh, measures};
use crate::progress::{Progress, Silent};
use crate::solvers::sparse::FactorError;
use cells::Cells;
use field::{Field, FieldError, Flux};
use seeds::Seeds;
use trace::{Tracer, Way};

/// Cells whose volume together is that of a muscle: at least, and for each vertex.
const CELLS: f64 = 2_000.0;
const CELLS_PER_VERTEX: f64 = 0.4;
/// Where a larger share stays bare, or the order of fibres is uncertain, the next of [`TRIALS`] is made.
const BARE: f64 = 0.03;
/// First flux is even over each area, which is what is known of attachments; where that leaves much bare it crowds far from the
/// other area, at last in so many times the least number of cells.
const TRIALS: [(f64, Flux); 3] = [
    (1.0, Flux::Even),
    (1.0, Flux::Crowded(0.0)),
    (2.0, Flux::Crowded(8.0)),
];
/// Where a larger share is bare at first, that is done at once.
const HOPELESS: f64 = 0.12;
/// Seeds that may fail, for each fibre.
const TRIES: usize = 4;
/// If only one seed of so many does not fail, of so many at least and as many as there are fibres, it is left to finer cells.
const LOST: usize = 5;
const SOONEST: usize = 50;

/// How many fibres of how many points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// Number of fibres.
    pub count: usize,
    /// Points of each, at least 2.
    pub points: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            count: 100,
            points: 15,
        }
    }
}

/// Why a muscle was not decomposed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DecompositionError {
    /// No fibre, or fibres of fewer than two points, asked for.
    #[error(
        "{count} fibres of {points} points make no decomposition; ask for at least 1 fibre of at least 2 points"
    )]
    TooFew {
        /// Fibres asked for.
        count: usize,
        /// Points asked for.
        points: usize,
    },
    /// The muscle encloses nothing.
    #[error(
        "the muscle encloses {volume:.3e} m3, which is too little to hold fibres; is its surface a flat sheet?"
    )]
    NoInside {
        /// Its volume [m3].
        volume: f64,
    },
    /// The two areas lie on parts that are not joined inside.
    #[error(
        "no way leads inside the muscle from the origin near ({}, {}, {}) to the insertion near ({}, {}, {}); are they on \
         separate pieces? `pliant check` lists the pieces",
        .origin.x, .origin.y, .origin.z, .insertion.x, .insertion.y, .insertion.z
    )]
    NotJoined {
        /// A vertex of the origin [m].
        origin: Point3<f64>,
        /// A vertex of the insertion [m].
        insertion: Point3<f64>,
    },
    /// Too few ways were found.
    #[error("only {found} of {count} fibres found a way from origin to insertion; ask for fewer")]
    Lost {
        /// Fibres found.
        found: usize,
        /// Fibres asked for.
        count: usize,
    },
    /// The field could not be solved for.
    #[error("the field could not be solved for: {0}")]
    Factor(#[from] FactorError),
    /// It was told to.
    #[error("stopped before all fibres were found")]
    Stopped,
}

/// A muscle decomposed into fibres.
#[derive(Clone, Debug)]
pub struct Decomposition {
    /// Each fibre from origin to insertion [m], points equally far apart along it.
    pub fibres: Vec<Vec<Point3<f64>>>,
    /// For each fibre its streamline: from the seed to the origin, and to the insertion.
    pub ways: Vec<[Way; 2]>,
    /// The field.
    pub field: Field,
    /// The surface that bounds the inside.
    pub closed: std::sync::Arc<Closed>,
}

/// Decomposes a muscle.
///
/// # Errors
/// Too few fibres or points, nothing inside, areas that are not joined, ways that are not found, no memory.
pub fn decompose(
    muscle: &TriangleMesh,
    attachment: &Attachment,
    options: Options,
) -> Result<Decomposition, DecompositionError> {
    decompose_along(muscle, attachment, &[], options)
}

/// Decomposes a muscle along lines on its surface [m]; without any as [`decompose`].
///
/// # Errors
/// As [`decompose`].
pub fn decompose_along(
    muscle: &TriangleMesh,
    attachment: &Attachment,
    lines: &[Vec<Point3<f64>>],
    options: Options,
) -> Result<Decomposition, DecompositionError> {
    decompose_with(muscle, attachment, lines, options, &Silent)
}

/// As [`decompose_along`]; `progress` may end it.
///
/// # Errors
/// As [`decompose`], or it was stopped.
pub fn decompose_with(
    muscle: &TriangleMesh,
    attachment: &Attachment,
    lines: &[Vec<Point3<f64>>],
    options: Options,
    progress: &dyn Progress,
) -> Result<Decomposition, DecompositionError> {
    let Options { count, points } = options;
    if count == 0 || points < 2 {
        return Err(DecompositionError::TooFew { count, points });
    }
    let closed = std::sync::Arc::new(Closed::new(muscle));
    let volume = closed.mesh.volume().abs();
    let size = muscle.length();
    // Thinner than this the inside has no point that differs from the surface.
    if !(volume > 1e-9 * size * size * size) {
        return Err(DecompositionError::NoInside { volume });
    }
    let solid = closed.solid();
    let task = Task {
        muscle,
        attachment,
        lines,
        options,
        solid: &solid,
        volume,
        progress,
    };
    let best = task.best()?;
    let Trial {
        fibres,
        ways,
        field,
        ..
    } = best;
    Ok(Decomposition {
        fibres,
        ways,
        field,
        closed,
    })
}

/// What is to be decomposed, and how.
struct Task<'a> {
    muscle: &'a TriangleMesh,
    attachment: &'a Attachment,
    lines: &'a [Vec<Point3<f64>>],
    options: Options,
    solid: &'a Solid<'a>,
    /// Of the muscle [m3].
    volume: f64,
    progress: &'a dyn Progress,
}

impl Task<'_> {
    /// The first of [`TRIALS`] that leaves little bare, or the best of all.
    fn best(&self) -> Result<Trial, DecompositionError> {
        let mut best: Option<Trial> = None;
        for (k, (finer, flux)) in TRIALS.into_iter().enumerate() {
            match self.trial(finer, flux, k + 1 == TRIALS.len()) {
                Ok(trial) if trial.disordered == 0 && trial.bare <= BARE => return Ok(trial),
                Ok(trial) if best.as_ref().is_none_or(|best| trial.rank() < best.rank()) => {
                    best = Some(trial)
                }
                Ok(_) | Err(DecompositionError::Lost { .. }) => {}
                Err(error) => return Err(error),
            }
        }
        // What finer cells cannot do, coarse ones may.
        best.map_or_else(|| self.trial(1.0, Flux::Even, true), Ok)
    }

    /// Decomposes with so many times the least number of cells; the `last` trial takes what it gets.
    fn trial(&self, finer: f64, flux: Flux, last: bool) -> Result<Trial, DecompositionError> {
        let &Self {
            muscle,
            attachment,
            lines,
            options,
            solid,
            volume,
            progress,
        } = self;
        let wanted = CELLS * finer + CELLS_PER_VERTEX * muscle.vertices.len() as f64;
        let cells = Cells::new(solid, (volume / wanted).cbrt());
        let field = Field::new(cells, solid, muscle, attachment, lines, flux)
            .map_err(|e| no_field(e, muscle, attachment))?;
        let tracer = Tracer::new(&field, muscle, &attachment.origin, &attachment.insertion);
        let (mut ways, any) = ways(&tracer, options.count, last, progress)?;
        let hopeless = if last { 1.0 } else { HOPELESS };
        let bare = exchange::exchange(
            &tracer,
            &mut ways,
            options.points,
            volume,
            hopeless,
            progress,
        )?;
        let disordered = if any {
            ways.iter().filter(|way| !ordered(&tracer, way)).count()
        } else {
            0
        };
        let fibres = ways
            .par_iter()
            .map(|w| fibre(w, options.points, solid))
            .collect();
        Ok(Trial {
            fibres,
            ways,
            field,
            disordered,
            bare,
        })
    }
}

/// Fibres in cells of one size.
struct Trial {
    fibres: Vec<Vec<Point3<f64>>>,
    ways: Vec<[Way; 2]>,
    field: Field,
    /// Fibres whose order is reversed somewhere.
    disordered: usize,
    /// Share of the volume that no fibre covers, by cells.
    bare: f64,
}

impl Trial {
    /// Less is better.
    fn rank(&self) -> (usize, f64) {
        (self.disordered, self.bare)
    }
}

fn no_field(
    error: FieldError,
    muscle: &TriangleMesh,
    attachment: &Attachment,
) -> DecompositionError {
    match error {
        FieldError::Factor(e) => DecompositionError::Factor(e),
        FieldError::NotJoined => {
            let first = |vertices: &[u32]| {
                vertices
                    .first()
                    .map_or_else(Point3::origin, |&v| muscle.vertices[v as usize])
            };
            let (origin, insertion) = (
                first(&attachment.origin.vertices),
                first(&attachment.insertion.vertices),
            );
            DecompositionError::NotJoined { origin, insertion }
        }
    }
}

/// Whether what is beside a fibre keeps its order all along.
fn ordered(tracer: &Tracer<'_>, [back, on]: &[Way; 2]) -> bool {
    jacobian::keeps_order(tracer, back, -1.0) && jacobian::keeps_order(tracer, on, 1.0)
}

/// Fibres through points that are far from one another, and whether the order of some was not asked for: only if there are too
/// few others, and this is the `last` trial.
fn ways(
    tracer: &Tracer<'_>,
    count: usize,
    last: bool,
    progress: &dyn Progress,
) -> Result<(Vec<[Way; 2]>, bool), DecompositionError> {
    let mut ways: Vec<[Way; 2]> = Vec::with_capacity(count);
    for any in [false, true].into_iter().take(if last { 2 } else { 1 }) {
        let mut seeds = Seeds::new(tracer.field);
        ways.iter()
            .flatten()
            .for_each(|half| seeds.note(&half.points));
        for n in 0..TRIES * count {
            if !last && n >= count.max(SOONEST) && n > LOST * ways.len() {
                break;
            }
            let heard = progress.report("fibres found", ways.len(), count);
            if heard.is_break() {
                return Err(DecompositionError::Stopped);
            }
            let Some(seed) = seeds.farthest() else { break };
            seeds.give_up(&seed);
            match through(tracer, &seed.point, any) {
                Ok(way) => {
                    way.iter().for_each(|half| seeds.note(&half.points));
                    ways.push(way);
                }
                Err(lost) => seeds.give_up_along(&lost),
            }
            if ways.len() == count {
                return Ok((ways, any));
            }
        }
    }
    Err(DecompositionError::Lost {
        found: ways.len(),
        count,
    })
}

/// The streamline through a point, from it to the origin and to the insertion.
///
/// # Errors
/// It is lost, as far as it came; or what is beside it comes to lie the other way round, with no points, unless `any` will do.
fn through(
    tracer: &Tracer<'_>,
    seed: &Point3<f64>,
    any: bool,
) -> Result<[Way; 2], Vec<Point3<f64>>> {
    let half = |sign: f64| {
        let way = tracer.half(seed, sign, any).map_err(|way| way.points)?;
        let kept = any || jacobian::keeps_order(tracer, &way, sign);
        if kept { Ok(way) } else { Err(Vec::new()) }
    };
    let (back, on) = rayon::join(|| half(-1.0), || half(1.0));
    Ok([back?, on?])
}

/// A streamline from origin to insertion by so many points, equally far apart.
fn whole([back, on]: &[Way; 2], points: usize) -> Vec<Point3<f64>> {
    let whole: Vec<Point3<f64>> = back
        .points
        .iter()
        .rev()
        .chain(&on.points[1..])
        .copied()
        .collect();
    resample(&whole, points)
}

/// The same as a fibre: none of its points is outside.
fn fibre(way: &[Way; 2], points: usize, solid: &Solid<'_>) -> Vec<Point3<f64>> {
    let mut line = whole(way, points);
    // Between two points of a streamline a chord may cut through a hollow of the wall.
    for p in &mut line {
        if !solid.contains_as_given(p)
            && let Some(wall) = solid.wall(p, f64::INFINITY)
        {
            *p = wall.point;
        }
    }
    line
}

impl Decomposition {
    /// Jacobian of the fibre map at every point of every streamline, 1 at its seed: the area across the fibre of what was
    /// one unit of area there. All are positive where the order of fibres is kept.
    pub fn jacobian(&self, muscle: &TriangleMesh, attachment: &Attachment) -> Vec<f64> {
        let tracer = Tracer::new(
            &self.field,
            muscle,
            &attachment.origin,
            &attachment.insertion,
        );
        let halves = |[back, on]: &[Way; 2]| {
            [
                jacobian::along(&tracer, back, -1.0),
                jacobian::along(&tracer, on, 1.0),
            ]
            .concat()
        };
        self.ways.iter().flat_map(halves).collect()
    }

    /// Mean side of what a fibre has for itself [m]: the root of the volume over the length of all fibres.
    pub fn spacing(&self) -> f64 {
        let length: f64 = self.fibres.iter().map(|f| super::polyline::length(f)).sum();
        (measures::volume(&self.closed.mesh.vertices, &self.closed.mesh.triangles).abs() / length)
            .sqrt()
    }
}
