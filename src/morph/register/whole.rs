//! The whole of a registration: starts, iterated closest points, and, where it is asked for, bending.

use std::time::Instant;

use nalgebra::{Isometry3, Matrix3, Point3, Similarity3, Translation3, UnitQuaternion, Vector3};

use super::ransac::Begun;
use super::{Bent, Icp, Motion, NonRigid, Ransac, RegisterError, Registered, Surface};
use crate::mesh::TriangleMesh;
use crate::mesh::measures::median;
use crate::morph::align::rotation_of;
use crate::morph::pose::axes;
use crate::progress::Progress;

/// What is asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Settings {
    /// Whether size may change.
    pub motion: Motion,
    /// How a start is found.
    pub ransac: Ransac,
    /// How it is refined.
    pub icp: Icp,
    /// How the surface is bent after that.
    pub bending: Option<NonRigid>,
}

/// Seconds that each part took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Times {
    /// Finding a start.
    pub start: f64,
    /// Iterated closest points.
    pub icp: f64,
    /// Bending.
    pub bend: f64,
}

/// A surface laid onto another.
#[derive(Clone, Debug, PartialEq)]
pub struct Laid {
    /// Where it began.
    pub begun: Begun,
    /// Where iterated closest points ended.
    pub registered: Registered,
    /// How it was bent.
    pub bent: Option<Bent>,
    /// Where its vertices are \[m\].
    pub points: Vec<Point3<f64>>,
    /// Distance of each vertex from the other surface \[m\].
    pub distances: Vec<f64>,
    /// Which vertices lie on it: near, facing the same way, and not at a rim.
    pub inliers: Vec<bool>,
    /// Seconds of each part.
    pub times: Times,
}

/// Distances over a set of vertices.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Residual {
    /// Root of the mean square \[m\].
    pub rms: f64,
    /// Median \[m\].
    pub median: f64,
    /// Greatest \[m\].
    pub max: f64,
}

impl Residual {
    /// Of distances; zero for none.
    pub fn of(distances: impl Iterator<Item = f64>) -> Self {
        let all: Vec<f64> = distances.collect();
        let squares: f64 = all.iter().map(|d| d * d).sum();
        Self {
            rms: (squares / all.len().max(1) as f64).sqrt(),
            max: crate::mesh::measures::greatest(all.iter().copied()),
            median: median(all).unwrap_or(0.0),
        }
    }
}

impl Laid {
    /// Distances of the vertices that lie on the other surface.
    pub fn residual(&self) -> Residual {
        Residual::of(
            self.distances
                .iter()
                .zip(&self.inliers)
                .filter(|(_, on)| **on)
                .map(|(d, _)| *d),
        )
    }

    /// Share of the vertices that lie on the other surface.
    pub fn share(&self) -> f64 {
        self.inliers.iter().filter(|on| **on).count() as f64 / self.inliers.len().max(1) as f64
    }
}

/// Lays `moving` onto `fixed`.
///
/// # Errors
/// No start at all, too few pairs on the way, a system that cannot be solved; `progress` ended it.
pub fn lay(
    moving: &Surface<'_>,
    fixed: &Surface<'_>,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Laid, RegisterError> {
    let mut times = Times::default();
    let begun = Instant::now();
    let ransac = Ransac {
        motion: settings.motion,
        ..settings.ransac
    };
    let start = ransac.best(
        moving,
        fixed,
        &others(moving.mesh(), fixed.mesh(), settings.motion),
        progress,
    )?;
    times.start = begun.elapsed().as_secs_f64();
    let begun = Instant::now();
    let registered = Icp {
        motion: settings.motion,
        ..settings.icp
    }
    .run(moving, fixed, &start.motion)?;
    times.icp = begun.elapsed().as_secs_f64();
    if progress.is_stopped() {
        return Err(RegisterError::Stopped);
    }
    let begun = Instant::now();
    let mut points: Vec<Point3<f64>> = moving
        .points()
        .iter()
        .map(|p| registered.motion * p)
        .collect();
    let bent = settings
        .bending
        .map(|how| how.run(moving, fixed, &points, progress))
        .transpose()?;
    times.bend = begun.elapsed().as_secs_f64();
    if let Some(bent) = &bent {
        points.clone_from(&bent.points);
    }
    let (distances, inliers) = judged(moving, fixed, &points, ransac.near);
    Ok(Laid {
        begun: start,
        registered,
        bent,
        points,
        distances,
        inliers,
        times,
    })
}

/// Starts without draws: as the surfaces are placed, middle on middle, and by their principal axes.
fn others(moving: &TriangleMesh, fixed: &TriangleMesh, motion: Motion) -> Vec<Similarity3<f64>> {
    let [a, b] = [moving, fixed].map(|m| m.surface_centroid().unwrap_or_default().coords);
    let ratio = (fixed.area() / moving.area()).sqrt();
    let scale = if motion == Motion::Similarity && ratio > 0.0 && ratio.is_finite() {
        ratio
    } else {
        1.0
    };
    let about = |by: UnitQuaternion<f64>| {
        let shift: Vector3<f64> = b - by * a * scale;
        Similarity3::from_isometry(Isometry3::from_parts(Translation3::from(shift), by), scale)
    };
    let [from, to] = [moving, fixed].map(axes);
    let signs = [
        [1.0, 1.0, 1.0],
        [1.0, -1.0, -1.0],
        [-1.0, 1.0, -1.0],
        [-1.0, -1.0, 1.0],
    ];
    let turns = signs
        .map(|s| rotation_of(&(to * Matrix3::from_diagonal(&Vector3::from(s)) * from.transpose())));
    let mut all = vec![Similarity3::identity(), about(UnitQuaternion::identity())];
    all.extend(turns.map(about));
    all
}

/// Distance of each vertex, and whether it lies on the other surface.
fn judged(
    moving: &Surface<'_>,
    fixed: &Surface<'_>,
    points: &[Point3<f64>],
    near: f64,
) -> (Vec<f64>, Vec<bool>) {
    let normals = TriangleMesh {
        vertices: points.to_vec(),
        triangles: moving.mesh().triangles.clone(),
    }
    .vertex_normals();
    let within = near * fixed.size();
    let judge = |(p, normal): (&Point3<f64>, &Vector3<f64>)| {
        let Some(found) = fixed.tree().closest(p, f64::INFINITY) else {
            return (f64::INFINITY, false);
        };
        let faces = normal.dot(&fixed.normal(found.triangle)) > 0.0;
        let on =
            found.distance <= within && faces && !fixed.is_on_rim(found.triangle, &found.point);
        (found.distance, on)
    };
    points.iter().zip(&normals).map(judge).unzip()
}
