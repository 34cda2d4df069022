//! Harmonic decomposition: fibres along the gradient of a field that is 0 at the origin and 1 at the insertion.
//!
//! The field is solved in cubes that cover the inside ([`cells`], [`field`]); the winding number
//! decides which points are inside. Fibres are streamlines of the field ([`trace`]). The flow maps
//! each cross-section of constant value one to one onto the next, so fibres do not cross, in
//! elongated muscles as in any other. Each further fibre goes through the point farthest from all
//! earlier fibres ([`seeds`]).

pub(crate) mod cells;
pub(crate) mod directions;
pub(crate) mod field;
pub(crate) mod jacobian;
mod reseed;
pub(crate) mod seeds;
pub(crate) mod trace;
pub(crate) use cells::Cells;
pub(crate) use field::{Field, FieldError, Flux};
pub(crate) use trace::HalfStreamline;

use nalgebra::Point3;
use rayon::prelude::*;

use super::attachment::Attachment;
use super::fibre_measures::{HOOK_DEG, median_tilt, turns_back};
use super::polyline::resample;
use super::solid::{Closed, Solid};
use crate::mesh::{TriangleMesh, measures};
use crate::progress::{Progress, Silent};
use crate::solvers::sparse::FactorError;
use seeds::Seeds;
use trace::Tracer;

/// Number of cells in the volume of the muscle: the least number, and the number per vertex.
const CELLS: f64 = 2_000.0;
const CELLS_PER_VERTEX: f64 = 0.4;
/// The next of [`TRIALS`] follows if a larger share of the volume stays uncovered, or if fibres turn back,
/// are out of order or end in hooks.
const BARE: f64 = 0.02;
/// Cell count as a multiple of the least number, flux, and the greatest tangent of the angle between a
/// streamline and the shortest line to its area, beside it. The flux is first even over each area,
/// the known property of attachments. If much of the volume stays uncovered, cells become finer, then
/// the flux denser far from the other area, then cells finer again. Fibres of the last trial turn towards
/// their area.
const TRIALS: [(f64, Flux, f64); 6] = [
    (1.0, Flux::Even, FLAT),
    (2.0, Flux::Even, FLAT),
    (2.0, Flux::Crowded(0.0), FLAT),
    (2.0, Flux::Crowded(8.0), FLAT),
    (4.0, Flux::Crowded(8.0), FLAT),
    (2.0, Flux::Crowded(8.0), STEEP),
];
/// Streamlines that run along their area end in a turn of 14 degrees at most, or go straight to the closest
/// point.
const FLAT: f64 = 4.0;
const STEEP: f64 = 0.0;
/// Gain of covered volume for which fibres may end in hooks or turn back.
const UNSOUND: f64 = 0.02;
/// After the first trial the next one follows at once if a larger share is uncovered at first.
const MAX_UNCOVERED: f64 = 0.12;
/// Greatest number of failed seeds per fibre.
const TRIES: usize = 4;
/// A trial stops and leaves the fibres to the next one if fewer than one seed in this number
/// succeeds. It first tries at least [`SOONEST`] seeds and one seed per fibre. The last trial does not stop.
const LOST: usize = 5;
const SOONEST: usize = 50;

/// Number of fibres and of their points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HarmonicOptions {
    /// Number of fibres.
    pub count: usize,
    /// Number of points per fibre, at least 2.
    pub points: usize,
}

impl Default for HarmonicOptions {
    fn default() -> Self {
        Self {
            count: 100,
            points: 15,
        }
    }
}

/// Error of [`decompose`].
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DecompositionError {
    /// The options ask for no fibre or for fibres of fewer than two points.
    #[error(
        "{count} fibres of {points} points make no decomposition; ask for at least 1 fibre of at least 2 points"
    )]
    TooFew {
        /// Requested number of fibres.
        count: usize,
        /// Requested number of points.
        points: usize,
    },
    /// The muscle encloses no volume.
    #[error(
        "the muscle encloses {volume:.3e} m3, which is too little to hold fibres; is its surface a flat sheet?"
    )]
    NoInside {
        /// Volume of the muscle [m3].
        volume: f64,
    },
    /// The two areas lie on parts that are not connected inside.
    #[error(
        "no streamline leads inside the muscle from the origin near ({}, {}, {}) to the insertion near ({}, {}, {}); are they on \
         separate pieces? `pliant check` lists the pieces",
        .origin.x, .origin.y, .origin.z, .insertion.x, .insertion.y, .insertion.z
    )]
    NotJoined {
        /// A vertex of the origin [m].
        origin: Point3<f64>,
        /// A vertex of the insertion [m].
        insertion: Point3<f64>,
    },
    /// The tracer found too few streamlines.
    #[error(
        "only {found} of {count} fibres reach the insertion from the origin; give a smaller count"
    )]
    Lost {
        /// Number of fibres found.
        found: usize,
        /// Requested number of fibres.
        count: usize,
    },
    /// The linear system of the field has no solution.
    #[error("the field could not be solved for: {0}")]
    Factor(#[from] FactorError),
    /// The caller stopped the decomposition.
    #[error("stopped before all fibres were found")]
    Stopped,
}

/// A muscle decomposed into fibres.
#[derive(Clone, Debug)]
pub struct Decomposition {
    /// Each fibre from origin to insertion [m], as points at equal distances.
    pub fibres: Vec<Vec<Point3<f64>>>,
    /// Streamline of each fibre: from the seed to the origin, and from the seed to the insertion.
    pub streamlines: Vec<[HalfStreamline; 2]>,
    /// The field.
    pub field: Field,
    /// The surface that bounds the inside.
    pub closed: std::sync::Arc<Closed>,
}

/// Decomposes a muscle into fibres.
///
/// # Errors
/// Too few fibres or points, no volume, areas that are not connected, lost streamlines, too little
/// memory.
pub fn decompose(
    muscle: &TriangleMesh,
    attachment: &Attachment,
    options: HarmonicOptions,
) -> Result<Decomposition, DecompositionError> {
    decompose_along(muscle, attachment, &[], options)
}

/// Decomposes a muscle along lines on its surface [m]; without lines the same as [`decompose`].
///
/// # Errors
/// As [`decompose`].
pub fn decompose_along(
    muscle: &TriangleMesh,
    attachment: &Attachment,
    lines: &[Vec<Point3<f64>>],
    options: HarmonicOptions,
) -> Result<Decomposition, DecompositionError> {
    decompose_with(muscle, attachment, lines, options, &Silent)
}

/// The same as [`decompose_along`]; stops when `going` returns `false`.
///
/// # Errors
/// Those of [`decompose`], or [`DecompositionError::Stopped`].
pub fn decompose_with(
    muscle: &TriangleMesh,
    attachment: &Attachment,
    lines: &[Vec<Point3<f64>>],
    options: HarmonicOptions,
    progress: &dyn Progress,
) -> Result<Decomposition, DecompositionError> {
    let HarmonicOptions { count, points } = options;
    if count == 0 || points < 2 {
        return Err(DecompositionError::TooFew { count, points });
    }
    let closed = std::sync::Arc::new(Closed::new(muscle));
    let volume = closed.mesh.volume().abs();
    let size = muscle.length();
    // A thinner muscle has no inner point that differs from the surface.
    if !(volume > 1e-9 * size * size * size) {
        return Err(DecompositionError::NoInside { volume });
    }
    let solid = closed.solid();
    let task = Task {
        muscle,
        attachment,
        lines: if lines.is_empty() {
            &attachment.guides
        } else {
            lines
        },
        options,
        solid: &solid,
        volume,
        progress,
    };
    let best = task.best()?;
    let Trial {
        fibres,
        streamlines,
        field,
        ..
    } = best;
    Ok(Decomposition {
        fibres,
        streamlines,
        field,
        closed,
    })
}

/// Input of a decomposition.
struct Task<'a> {
    muscle: &'a TriangleMesh,
    attachment: &'a Attachment,
    lines: &'a [Vec<Point3<f64>>],
    options: HarmonicOptions,
    solid: &'a Solid<'a>,
    /// Volume of the muscle [m3].
    volume: f64,
    progress: &'a dyn Progress,
}

impl Task<'_> {
    /// The first of [`TRIALS`] with a small uncovered share, or the best of all.
    fn best(&self) -> Result<Trial, DecompositionError> {
        let mut best: Option<Trial> = None;
        for k in 0..TRIALS.len() {
            match self.trial(k, k + 1 == TRIALS.len()) {
                Ok(trial) if trial.is_good() => return Ok(trial),
                Ok(trial) if best.as_ref().is_none_or(|best| trial.is_better(best)) => {
                    best = Some(trial);
                }
                Ok(_) | Err(DecompositionError::Lost { .. }) => {}
                Err(error) => return Err(error),
            }
        }
        // Coarse cells can succeed where finer ones fail.
        best.map_or_else(|| self.trial(0, true), Ok)
    }

    /// Decomposes by one of [`TRIALS`]; the `last` trial accepts any order.
    fn trial(&self, k: usize, last: bool) -> Result<Trial, DecompositionError> {
        let (finer, flux, flat) = TRIALS[k];
        let &Self {
            muscle,
            attachment,
            lines,
            options,
            solid,
            volume,
            progress,
        } = self;
        let cell_count = CELLS * finer + CELLS_PER_VERTEX * muscle.vertices.len() as f64;
        let cells = Cells::new(solid, (volume / cell_count).cbrt());
        let field = Field::new(cells, solid, muscle, attachment, lines, (flux, flat))
            .map_err(|e| no_field(e, muscle, attachment))?;
        let tracer = Tracer::new(&field, muscle, &attachment.origin, &attachment.insertion);
        let (mut streamlines, order) = streamlines(&tracer, options.count, last, progress)?;
        let max_uncovered = if k > 0 || last { 1.0 } else { MAX_UNCOVERED };
        let bare = reseed::reseed(
            &tracer,
            &mut streamlines,
            options.points,
            volume,
            (max_uncovered, order.kept()),
            progress,
        )?;
        let courses: Vec<_> = streamlines.iter().map(course).collect();
        let order = match order {
            Order::Any if streamlines.iter().any(|s| !ordered(&tracer, s)) => Order::Any,
            _ if courses.iter().any(|course| turns_back(course)) => Order::Kept,
            _ => Order::Forwards,
        };
        let has_hooks = !(median_tilt(&courses).to_degrees() <= HOOK_DEG);
        let fibres = streamlines
            .par_iter()
            .map(|w| fibre(w, options.points, solid))
            .collect();
        Ok(Trial {
            fibres,
            streamlines,
            field,
            order,
            bare,
            has_hooks,
        })
    }
}

/// Fibres from cells of one size.
struct Trial {
    fibres: Vec<Vec<Point3<f64>>>,
    streamlines: Vec<[HalfStreamline; 2]>,
    field: Field,
    /// The order that all fibres have.
    order: Order,
    /// Share of the cells' volume that no fibre covers.
    bare: f64,
    /// Whether the median end is a hook.
    has_hooks: bool,
}

impl Trial {
    /// True if no further trial is needed.
    fn is_good(&self) -> bool {
        self.order == Order::Forwards && !self.has_hooks && self.bare <= BARE
    }

    /// True if its fibres keep their order and those of an earlier trial do not, or it leaves less bare.
    /// Hooks and fibres that turn back count as [`UNSOUND`].
    fn is_better(&self, before: &Self) -> bool {
        let lacks = |trial: &Self| {
            let is_sound = trial.order == Order::Forwards && !trial.has_hooks;
            trial.bare + if is_sound { 0.0 } else { UNSOUND }
        };
        let rank = |trial: &Self| (trial.order == Order::Any, lacks(trial));
        rank(self) < rank(before)
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

/// True if the neighbourhood of a fibre keeps its orientation along the whole fibre.
fn ordered(tracer: &Tracer<'_>, [back, on]: &[HalfStreamline; 2]) -> bool {
    jacobian::keeps_order(tracer, back, -1.0) && jacobian::keeps_order(tracer, on, 1.0)
}

/// Which streamlines are fibres.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Order {
    /// Those beside which the order is kept, and that do not turn back.
    Forwards,
    /// Those beside which the order is kept.
    Kept,
    /// All.
    Any,
}

impl Order {
    /// This order, or a stricter one of those beside which the order is kept.
    fn kept(self) -> Self {
        self.min(Self::Kept)
    }
}

/// Why a streamline is no fibre.
enum Rejected {
    /// The tracer lost it, after these points [m].
    Lost(Vec<Point3<f64>>),
    /// The order beside it is reversed.
    Reversed,
    /// It turns back.
    TurnsBack,
}

/// Fibres through points that are far from one another, with the order that all of them have. Those that
/// turn back are taken only if there are too few others. The `last` trial also takes those of reversed order.
fn streamlines(
    tracer: &Tracer<'_>,
    count: usize,
    last: bool,
    progress: &dyn Progress,
) -> Result<(Vec<[HalfStreamline; 2]>, Order), DecompositionError> {
    let mut streamlines: Vec<[HalfStreamline; 2]> = Vec::with_capacity(count);
    let mut has_turned = false;
    for order in [Order::Forwards, Order::Kept, Order::Any] {
        match order {
            Order::Forwards => {}
            // Seeds between fibres that do not turn back would leave much bare. The last trial has not tried all seeds.
            Order::Kept if has_turned || last => streamlines.clear(),
            Order::Any if last => {}
            _ => continue,
        }
        let mut seeds = Seeds::new(tracer.field);
        streamlines
            .iter()
            .flatten()
            .for_each(|half| seeds.note(&half.points));
        for n in 0..TRIES * count {
            let gives_up = !last || order == Order::Forwards;
            if gives_up && n >= count.max(SOONEST) && n > LOST * streamlines.len() {
                break;
            }
            let heard = progress.report("fibres found", streamlines.len(), count);
            if heard.is_break() {
                return Err(DecompositionError::Stopped);
            }
            let Some(seed) = seeds.farthest() else { break };
            seeds.give_up(&seed);
            match through(tracer, &seed.point, order) {
                Ok(streamline) => {
                    streamline.iter().for_each(|half| seeds.note(&half.points));
                    streamlines.push(streamline);
                }
                Err(Rejected::Lost(points)) => seeds.give_up_along(&points),
                Err(Rejected::Reversed) => {}
                Err(Rejected::TurnsBack) => has_turned = true,
            }
            if streamlines.len() == count {
                return Ok((streamlines, order));
            }
        }
    }
    Err(DecompositionError::Lost {
        found: streamlines.len(),
        count,
    })
}

/// The streamline through a point: from the point to the origin, and to the insertion.
fn through(
    tracer: &Tracer<'_>,
    seed: &Point3<f64>,
    order: Order,
) -> Result<[HalfStreamline; 2], Rejected> {
    let half = |sign: f64| {
        let streamline = tracer
            .half(seed, sign, order == Order::Any)
            .map_err(|streamline| Rejected::Lost(streamline.points))?;
        match order == Order::Any || jacobian::keeps_order(tracer, &streamline, sign) {
            true => Ok(streamline),
            false => Err(Rejected::Reversed),
        }
    };
    let (back, on) = rayon::join(|| half(-1.0), || half(1.0));
    let streamline = [back?, on?];
    if order == Order::Forwards && turns_back(&course(&streamline)) {
        return Err(Rejected::TurnsBack);
    }
    Ok(streamline)
}

/// All points of a streamline, from origin to insertion.
pub(super) fn course([back, on]: &[HalfStreamline; 2]) -> Vec<Point3<f64>> {
    back.points
        .iter()
        .rev()
        .chain(&on.points[1..])
        .copied()
        .collect()
}

/// A streamline from origin to insertion as `points` points at equal distances.
fn whole(streamline: &[HalfStreamline; 2], points: usize) -> Vec<Point3<f64>> {
    resample(&course(streamline), points)
}

/// The streamline as a fibre: all its points are inside.
fn fibre(streamline: &[HalfStreamline; 2], points: usize, solid: &Solid<'_>) -> Vec<Point3<f64>> {
    let mut line = whole(streamline, points);
    // A chord between two points of a streamline can leave a concave wall.
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
    /// Jacobian of the fibre map at every point of every streamline: the ratio of the area across
    /// the fibre to that at the seed. All values are positive where the order of fibres is kept.
    pub fn jacobian(&self, muscle: &TriangleMesh, attachment: &Attachment) -> Vec<f64> {
        let tracer = Tracer::new(
            &self.field,
            muscle,
            &attachment.origin,
            &attachment.insertion,
        );
        let halves = |[back, on]: &[HalfStreamline; 2]| {
            [
                jacobian::along(&tracer, back, -1.0),
                jacobian::along(&tracer, on, 1.0),
            ]
            .concat()
        };
        self.streamlines.iter().flat_map(halves).collect()
    }

    /// Mean spacing of the fibres [m]: the square root of the volume over the total fibre length.
    pub fn spacing(&self) -> f64 {
        let length: f64 = self.fibres.iter().map(|f| super::polyline::length(f)).sum();
        (measures::volume(&self.closed.mesh.vertices, &self.closed.mesh.triangles).abs() / length)
            .sqrt()
    }
}
