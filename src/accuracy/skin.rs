//! The cost of accuracy for skin over implants or over a ball: edge lengths and methods against the
//! finest affordable mesh.
//!
//! The error is that of the area gained in the last frame. Areas themselves are not compared,
//! because the region consists of whole triangles and so has another initial area on every mesh.

use std::time::{Duration, Instant};

use crate::progress::Progress;
use crate::scene::content::{FillCourse, SkinScene, SkinSurface, Support};
use crate::simulation::LoadError;
use crate::simulation::Stepped;
use crate::simulation::skin::SkinRun;
use crate::skin::settle::SettleMethod;

/// Measured edge lengths, relative to that of the scene, from coarse to fine.
const EDGES: [f64; 7] = [
    2.0 * std::f64::consts::SQRT_2,
    2.0,
    std::f64::consts::SQRT_2,
    1.0,
    std::f64::consts::FRAC_1_SQRT_2,
    0.5,
    0.5 * std::f64::consts::FRAC_1_SQRT_2,
];

/// Expected factor of the time for edges shorter by the square root of two.
const SLOWER: f64 = 3.0;

/// Share of the budget for Newton's method, which gives the reference.
const FOR_REFERENCE: f64 = 0.75;

/// Target errors of the recommendations, relative to the gain.
const TARGETS: [f64; 3] = [0.1, 0.01, 0.001];

/// One insertion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SkinRow {
    /// Median edge of the region [m].
    pub edge: f64,
    /// Method of the equilibrium.
    pub method: SettleMethod,
    /// Number of vertices of both layers of all regions.
    pub vertices: usize,
    /// Number of springs.
    pub springs: usize,
    /// True if all parts reached their equilibrium.
    pub converged: bool,
    /// Area gained in the last frame [m^2].
    pub gain: f64,
    /// Deformed area [m^2].
    pub deformed: f64,
    /// Volume difference [m^3].
    pub volume_difference: f64,
    /// Number of solver iterations.
    pub steps: u32,
    /// Wall time [s].
    pub time_s: f64,
}

/// Results of a study of skin.
#[derive(Clone, Debug, PartialEq)]
pub struct SkinStudy {
    /// Name of the scene.
    pub scene: String,
    /// All insertions except the reference: Newton's method from coarse to fine, then the other
    /// method.
    pub rows: Vec<SkinRow>,
    /// The finest insertion by Newton's method.
    pub reference: SkinRow,
    /// Uncertainty of the reference's gain [m^2].
    pub uncertainty: f64,
    /// Edge lengths [m] and methods that were not measured for lack of time.
    pub left_out: Vec<(f64, SettleMethod)>,
    /// True if the study was interrupted.
    pub interrupted: bool,
}

/// Error of a study of skin.
#[derive(Debug, thiserror::Error)]
pub enum SkinStudyError {
    /// The scene cannot run.
    #[error(transparent)]
    Load(#[from] LoadError),
    /// Fewer than two meshes reached an equilibrium.
    #[error("no reference: {0}")]
    NoReference(String),
}

impl SkinStudy {
    /// The error of a row: its gain minus the reference's [m^2].
    pub fn error(&self, row: &SkinRow) -> f64 {
        row.gain - self.reference.gain
    }

    /// The absolute error relative to the reference's gain.
    pub fn share(&self, row: &SkinRow) -> f64 {
        (self.error(row) / self.reference.gain).abs()
    }

    /// True if an error exceeds the reference's uncertainty.
    pub fn is_certain(&self, row: &SkinRow) -> bool {
        self.error(row).abs() >= self.uncertainty
    }

    /// The fastest row for each target relative to the gain; `None` where the target is below the
    /// uncertainty.
    pub fn recommended(&self) -> Vec<(f64, Option<usize>)> {
        let keeps = |target: f64, row: &SkinRow| {
            row.converged
                && self.share(row) + self.uncertainty / self.reference.gain.abs() <= target
        };
        let best = |target: f64| {
            let all = (0..self.rows.len()).filter(|&k| keeps(target, &self.rows[k]));
            all.min_by(|&a, &b| self.rows[a].time_s.total_cmp(&self.rows[b].time_s))
        };
        TARGETS.map(|target| (target, best(target))).to_vec()
    }
}

/// The scene with only its last frame, on a mesh with edges of `edge` [m].
fn variant(scene: &SkinScene, edge: f64, method: SettleMethod) -> SkinScene {
    let mut scene = scene.clone();
    let last = scene.frames;
    if let SkinSurface::Sheet { side, cells } = &mut scene.skin.surface {
        *cells = ((*side / edge).round() as u32).max(4);
    }
    scene.skin.method = Some(method);
    match &mut scene.under {
        Support::Implants(all) => {
            for filled in all {
                filled.order.edge = Some(edge);
                if !matches!(filled.course, FillCourse::Target(_)) {
                    filled.fill = vec![(1, filled.volume_at(last))];
                    filled.course = FillCourse::Evenly;
                }
            }
        }
        Support::Ball(ball) => ball.order.edge = Some(edge),
    }
    SkinScene {
        frames: 1,
        days: Vec::new(),
        ..scene
    }
}

/// Runs a variant; `None` if it was interrupted or has no solution.
fn insert(
    scene: SkinScene,
    method: SettleMethod,
    progress: &dyn Progress,
) -> Result<Option<SkinRow>, LoadError> {
    let begun = Instant::now();
    let mut run = SkinRun::new(scene)?;
    // Its rounds are not shown.
    if run.step(&|_: &str, _: usize, _: usize| progress.report("", 0, 0)) != Stepped::Done {
        return Ok(None);
    }
    let count =
        |of: &dyn Fn(&crate::simulation::skin::SkinPart) -> usize| run.parts.iter().map(of).sum();
    let sum = |of: &dyn Fn(&crate::skin::Areas) -> f64| -> f64 {
        run.parts
            .iter()
            .filter_map(|p| p.frames.last())
            .map(|f| of(&f.areas))
            .sum()
    };
    Ok(Some(SkinRow {
        edge: run.parts.first().map_or(0.0, |p| p.ready.layers.edge),
        method,
        vertices: count(&|p| 2 * p.ready.layers.count()),
        springs: count(&|p| p.ready.layers.springs.len()),
        converged: run.converged(),
        gain: sum(&crate::skin::Areas::gain),
        deformed: sum(&|a| a.deformed),
        volume_difference: sum(&|a| a.volume_difference),
        steps: run.parts.iter().map(|p| p.steps()).sum(),
        time_s: begun.elapsed().as_secs_f64(),
    }))
}

/// Measures a skin scene within about `budget`.
///
/// # Errors
/// A scene that cannot run, or fewer than two meshes with an equilibrium.
pub fn measure_skin(
    scene: &SkinScene,
    budget: Duration,
    progress: &dyn Progress,
) -> Result<SkinStudy, SkinStudyError> {
    let begun = Instant::now();
    let own = SkinRun::new(scene.clone())?
        .parts
        .first()
        .map_or(0.0, |p| p.ready.layers.edge);
    let budget = budget.as_secs_f64();
    let mut left_out = Vec::new();
    let mut rows: Vec<SkinRow> = Vec::new();
    for (method, share) in [
        (SettleMethod::Newton, FOR_REFERENCE),
        (SettleMethod::QuasiStatic, 1.0),
    ] {
        let mut last = None::<f64>;
        for edge in EDGES.map(|e| e * own) {
            // The first two are necessary at any cost.
            let needed = method == SettleMethod::Newton && rows.len() < 2;
            let late =
                begun.elapsed().as_secs_f64() + last.map_or(0.0, |t| SLOWER * t) > share * budget;
            if progress.is_stopped() || (late && !needed) {
                left_out.push((edge, method));
                continue;
            }
            progress.begin(&format!(
                "{}, edges of {:.2} mm",
                method_name(method),
                edge * 1e3
            ));
            // A mesh too coarse or too fine for its region is an error; the scene itself can be
            // prepared.
            let Ok(Some(row)) = insert(variant(scene, edge, method), method, progress) else {
                continue;
            };
            last = Some(row.time_s);
            // A mesh finer than the target is used as it is.
            if !rows.iter().any(|r| {
                r.method == method && (r.vertices, r.springs) == (row.vertices, row.springs)
            }) {
                rows.push(row);
            }
        }
    }
    let interrupted = progress.is_stopped();
    let (reference, uncertainty) = reference(&mut rows)?;
    Ok(SkinStudy {
        scene: scene.name.clone(),
        rows,
        reference,
        uncertainty,
        left_out,
        interrupted,
    })
}

/// Name of a method in scenes.
pub fn method_name(method: SettleMethod) -> &'static str {
    match method {
        SettleMethod::Newton => "newton",
        SettleMethod::QuasiStatic => "quasi_static",
    }
}

/// Removes the finest mesh of Newton's method from the rows. Returns also the uncertainty of its
/// gain: the sum of the geometric series of the last two differences, at least the last difference
/// itself.
fn reference(rows: &mut Vec<SkinRow>) -> Result<(SkinRow, f64), SkinStudyError> {
    let newton: Vec<usize> = (0..rows.len())
        .filter(|&k| rows[k].method == SettleMethod::Newton && rows[k].converged)
        .collect();
    let [.., second, finest] = newton[..] else {
        let why = "fewer than two meshes came to rest in the time; give more time".to_owned();
        return Err(SkinStudyError::NoReference(why));
    };
    let last = (rows[finest].gain - rows[second].gain).abs();
    let before = newton
        .len()
        .checked_sub(3)
        .map(|k| (rows[second].gain - rows[newton[k]].gain).abs());
    let ratio = before.map_or(0.0, |before| last / before);
    let rest = if ratio < 1.0 {
        last * ratio / (1.0 - ratio)
    } else {
        last
    };
    Ok((rows.remove(finest), rest.max(last)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(gain: f64, method: SettleMethod, time_s: f64) -> SkinRow {
        let (vertices, springs, steps) = (1, 1, 1);
        let (edge, deformed, volume_difference) = (1e-3, gain + 1.0, 0.0);
        SkinRow {
            edge,
            method,
            vertices,
            springs,
            converged: true,
            gain,
            deformed,
            volume_difference,
            steps,
            time_s,
        }
    }

    #[test]
    fn the_finest_is_the_reference_and_its_doubt_follows_from_the_differences() {
        let newton = |gain, time| row(gain, SettleMethod::Newton, time);
        let mut rows = vec![
            newton(1.4, 1.0),
            newton(1.1, 3.0),
            newton(1.0, 9.0),
            row(1.1, SettleMethod::QuasiStatic, 2.0),
        ];
        let (found, doubt) = reference(&mut rows).expect("a reference");
        // Differences of 0.3 and 0.1: the remaining sum is 0.1/3 + 0.1/9 + ... = 0.05, less than
        // the last difference.
        assert!(
            found.gain == 1.0 && (doubt - 0.1).abs() <= 1e-12 && rows.len() == 3,
            "{doubt}"
        );
        let study = SkinStudy {
            scene: String::new(),
            rows,
            reference: found,
            uncertainty: 0.0,
            left_out: Vec::new(),
            interrupted: false,
        };
        // Both differ by a tenth; rounding decides nothing.
        let near = SkinStudy {
            rows: study
                .rows
                .iter()
                .map(|r| SkinRow {
                    gain: r.gain - 0.01,
                    ..*r
                })
                .collect(),
            ..study
        };
        assert_eq!(
            near.recommended(),
            [(0.1, Some(2)), (0.01, None), (0.001, None)]
        );
        let doubtful = SkinStudy {
            uncertainty: 0.1,
            ..near
        };
        assert_eq!(
            doubtful.recommended()[0],
            (0.1, None),
            "control: a target below the uncertainty is granted"
        );
    }

    #[test]
    fn one_mesh_is_no_reference() {
        assert!(
            reference(&mut vec![
                row(1.0, SettleMethod::Newton, 1.0),
                row(1.0, SettleMethod::QuasiStatic, 1.0)
            ])
            .is_err()
        );
    }
}
