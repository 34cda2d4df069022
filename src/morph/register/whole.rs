//! A complete registration: starts, iterated closest points, and an optional deformation.

use std::time::Instant;

use nalgebra::{Isometry3, Matrix3, Point3, Similarity3, Translation3, UnitQuaternion, Vector3};

use super::ransac::InitialAlignment;
use super::{
    Bent, FitMotion, Icp, NonRigid, Ransac, RegisterError, Registered, RegistrationSurface,
};
use crate::mesh::TriangleMesh;
use crate::mesh::closest::SurfaceTree;
use crate::mesh::measures::{median, quantile};
use crate::morph::align::rotation_of;
use crate::morph::pose::axes;
use crate::progress::Progress;

/// Settings of a registration.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RegistrationSettings {
    /// Degrees of freedom.
    pub motion: FitMotion,
    /// Settings of the search for a start.
    pub ransac: Ransac,
    /// Settings of the refinement.
    pub icp: Icp,
    /// Settings of the deformation after the refinement; `None` for none.
    pub bending: Option<NonRigid>,
}

/// Time of each part [s].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RegistrationTimes {
    /// Time of the search for a start.
    pub start: f64,
    /// Time of the iterated closest points.
    pub icp: f64,
    /// Time of the deformation.
    pub bend: f64,
}

/// A surface registered to another.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceRegistration {
    /// The start.
    pub begun: InitialAlignment,
    /// Result of the iterated closest points.
    pub registered: Registered,
    /// Result of the deformation.
    pub bent: Option<Bent>,
    /// Positions of the vertices \[m\].
    pub points: Vec<Point3<f64>>,
    /// Distance of each vertex from the other surface \[m\].
    pub distances: Vec<f64>,
    /// Distance of each vertex of the other surface from the moved one \[m\].
    pub distances_back: Vec<f64>,
    /// True for each vertex on the other surface: near, with a similar normal, and not at a
    /// boundary.
    pub inliers: Vec<bool>,
    /// Time of each part.
    pub times: RegistrationTimes,
}

/// Measures of distances over a set of vertices.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RegistrationResidual {
    /// Root mean square \[m\].
    pub rms: f64,
    /// Median \[m\].
    pub median: f64,
    /// 95th percentile \[m\].
    pub p95: f64,
    /// Greatest \[m\].
    pub max: f64,
}

impl RegistrationResidual {
    /// Measures of the given distances; zero for none.
    pub fn of(distances: impl Iterator<Item = f64>) -> Self {
        let all: Vec<f64> = distances.collect();
        let squares: f64 = all.iter().map(|d| d * d).sum();
        Self {
            rms: (squares / all.len().max(1) as f64).sqrt(),
            p95: quantile(all.clone(), 0.95).unwrap_or(0.0),
            max: crate::mesh::measures::max_or_nan(all.iter().copied()),
            median: median(all).unwrap_or(0.0),
        }
    }
}

impl SurfaceRegistration {
    /// Distances of the vertices that lie on the other surface.
    pub fn residual(&self) -> RegistrationResidual {
        RegistrationResidual::of(
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

/// Registers `moving` to `fixed`.
///
/// # Errors
/// No start, too few pairs during the refinement, a system without solution, or a stop by `progress`.
pub fn register_surfaces(
    moving: &RegistrationSurface<'_>,
    fixed: &RegistrationSurface<'_>,
    settings: &RegistrationSettings,
    progress: &dyn Progress,
) -> Result<SurfaceRegistration, RegisterError> {
    let mut times = RegistrationTimes::default();
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
    let tree = SurfaceTree::new(&points, &moving.mesh().triangles);
    let back = |p: &Point3<f64>| {
        tree.closest(p, f64::INFINITY)
            .map_or(f64::INFINITY, |found| found.distance)
    };
    let distances_back = fixed.points().iter().map(back).collect();
    Ok(SurfaceRegistration {
        begun: start,
        registered,
        bent,
        points,
        distances,
        distances_back,
        inliers,
        times,
    })
}

/// Starts without draws: the given placement, coincident centres, and principal axes.
fn others(moving: &TriangleMesh, fixed: &TriangleMesh, motion: FitMotion) -> Vec<Similarity3<f64>> {
    let [a, b] = [moving, fixed].map(|m| m.surface_centroid().unwrap_or_default().coords);
    let ratio = (fixed.area() / moving.area()).sqrt();
    let scale = if motion == FitMotion::Similarity && ratio > 0.0 && ratio.is_finite() {
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

/// Distance of each vertex, and whether the vertex lies on the other surface.
fn judged(
    moving: &RegistrationSurface<'_>,
    fixed: &RegistrationSurface<'_>,
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
