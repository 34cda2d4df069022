//! Measures of one muscle in one frame.

use nalgebra::{Isometry3, Point3};
use serde::Serialize;

use super::audit::{self, Findings};
use super::body::{Body, Stepper};
use crate::constraints::Residual;
use crate::constraints::distance::Distance;
use crate::contact::Counts;
use crate::scene::Scene;
use crate::state::{DecodeError, Reader, Value, Writer};

/// Greatest relative volume error of a valid frame (tolerance T6).
pub const VOLUME_HELD: f64 = 1e-6;

/// Measures of one muscle in one frame; a row of `measures.csv`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Measures {
    /// Index of the frame.
    pub frame: usize,
    /// Time since the start [s].
    pub time_s: f64,
    /// Name of the muscle.
    pub muscle: String,
    /// Volume over its target, minus 1; 0 without a volume constraint.
    pub volume_error: f64,
    /// Volume relative to that at rest.
    pub volume_ratio: f64,
    /// Root mean square of the strain of edges.
    pub edge_stretch_rms: f64,
    /// Greatest absolute strain of an edge.
    pub edge_stretch_max: f64,
    /// Greatest depth of a free vertex in a bone [m], by the audit.
    pub penetration_m: f64,
    /// Free vertices deeper than 0.01 mm in a bone, by the audit.
    pub vertices_inside_bones: usize,
    /// Bone vertices inside the muscle, by the audit.
    pub bone_vertices_inside: usize,
    /// Number of vertices in contact with a bone.
    pub vertices_touching: usize,
    /// Number of vertices between bones closer together than twice the contact thickness.
    pub vertices_pinched: usize,
    /// Root mean square residual of the elastic constraints [m].
    pub residual_m: f64,
    /// Kinetic energy [J].
    pub kinetic_energy_j: f64,
    /// Root mean square distance of vertices from their start positions [m].
    pub distance_from_start_rms_m: f64,
    /// Estimated root mean square error [m], of a run with a requested accuracy; otherwise NaN.
    pub error_m: f64,
    /// True if residual, volume and depth are within their tolerances. With a requested accuracy: if the
    /// error is within it.
    pub converged: bool,
}

impl Measures {
    /// Measures a body among bones at their poses.
    pub(super) fn of(
        body: &Body,
        frame: usize,
        scene: &Scene,
        bones: &[(&audit::AuditedBone<'_>, Isometry3<f64>)],
    ) -> Self {
        let x = &body.system.particles.position;
        let (edge_stretch_rms, edge_stretch_max) = stretch(body);
        let volume = if body.rest_volume > 0.0 {
            crate::mesh::measures::volume(x, &body.rest.triangles)
        } else {
            0.0
        };
        let volume_error = if body.target_volume > 0.0 {
            volume / body.target_volume - 1.0
        } else {
            0.0
        };
        // Only a closed surface has a volume at rest.
        let closed = body.rest_volume > 0.0;
        let findings = if closed {
            audit::examine(x, &body.rest.triangles, &|v| body.is_free(v), bones)
        } else {
            Findings::default()
        };
        let counts = body
            .system
            .contacts
            .as_ref()
            .map_or(Counts::default(), |c| c.counts(x));
        let residual_m = match &body.method {
            Stepper::Tracked(tracked) => tracked.outcome.residual * body.edge_length,
            Stepper::Minimum(equilibrium) => equilibrium.residual * body.edge_length,
            Stepper::Sweeps => elastic_residual(body),
        };
        let n = x.len().max(1) as f64;
        let apart = x
            .iter()
            .zip(&body.rest.vertices)
            .map(|(a, b)| (a - b).norm_squared())
            .sum::<f64>()
            / n;
        let tolerance = scene.solver.tolerance();
        let rigid = scene
            .muscles
            .iter()
            .any(|m| m.name == body.name && m.material.bulk.is_none());
        let converged = body.stopped.is_none()
            && residual_m <= tolerance * body.edge_length
            && (!rigid || volume_error.abs() <= VOLUME_HELD)
            && (scene.effects.contact.is_none() || findings.vertices_inside == 0);
        Self {
            frame,
            time_s: frame as f64 / scene.frame_rate,
            muscle: body.name.clone(),
            volume_error,
            volume_ratio: if body.rest_volume > 0.0 {
                volume / body.rest_volume
            } else {
                0.0
            },
            edge_stretch_rms,
            edge_stretch_max,
            penetration_m: findings.depth,
            vertices_inside_bones: findings.vertices_inside,
            bone_vertices_inside: findings.bone_vertices_inside,
            vertices_touching: counts.touching,
            vertices_pinched: counts.pinched,
            residual_m,
            kinetic_energy_j: kinetic_energy(body),
            distance_from_start_rms_m: apart.sqrt(),
            error_m: f64::NAN,
            converged,
        }
    }
}

impl Value for Measures {
    const MIN_BYTES: usize = 16 * 8 + 1;

    fn encode(&self, to: &mut Writer) {
        let Self {
            frame,
            time_s,
            muscle,
            volume_error,
            volume_ratio,
            edge_stretch_rms,
            edge_stretch_max,
            penetration_m,
            vertices_inside_bones,
            bone_vertices_inside,
            vertices_touching,
            vertices_pinched,
            residual_m,
            kinetic_energy_j,
            distance_from_start_rms_m,
            error_m,
            converged,
        } = self;
        to.put(frame);
        to.put(time_s);
        to.put(muscle);
        to.put(&[
            *volume_error,
            *volume_ratio,
            *edge_stretch_rms,
            *edge_stretch_max,
            *penetration_m,
        ]);
        to.put(&[
            *vertices_inside_bones,
            *bone_vertices_inside,
            *vertices_touching,
            *vertices_pinched,
        ]);
        to.put(&[*residual_m, *kinetic_energy_j]);
        to.put(&[*distance_from_start_rms_m, *error_m]);
        to.put(converged);
    }

    fn decode(from: &mut Reader<'_>) -> Result<Self, DecodeError> {
        let (frame, time_s, muscle) = (from.take()?, from.take()?, from.take()?);
        let [
            volume_error,
            volume_ratio,
            edge_stretch_rms,
            edge_stretch_max,
            penetration_m,
        ] = from.take()?;
        let [
            vertices_inside_bones,
            bone_vertices_inside,
            vertices_touching,
            vertices_pinched,
        ] = from.take()?;
        let [residual_m, kinetic_energy_j] = from.take()?;
        let [distance_from_start_rms_m, error_m] = from.take()?;
        Ok(Self {
            frame,
            time_s,
            muscle,
            volume_error,
            volume_ratio,
            edge_stretch_rms,
            edge_stretch_max,
            penetration_m,
            vertices_inside_bones,
            bone_vertices_inside,
            vertices_touching,
            vertices_pinched,
            residual_m,
            kinetic_energy_j,
            distance_from_start_rms_m,
            error_m,
            converged: from.take()?,
        })
    }
}

/// Mean absolute strain of the edges at each vertex, for positions `x` [m]; 0 without edges.
pub fn strain_at_vertices(edges: &[Distance], x: &[Point3<f64>]) -> Vec<f64> {
    let mut sums = vec![(0.0, 0u32); x.len()];
    for edge in edges {
        let [a, b] = edge.points.map(|p| p as usize);
        let strain = ((x[a] - x[b]).norm() / edge.rest - 1.0).abs();
        for v in [a, b] {
            sums[v].0 += strain;
            sums[v].1 += 1;
        }
    }
    sums.into_iter()
        .map(|(sum, count)| {
            if count == 0 {
                0.0
            } else {
                sum / f64::from(count)
            }
        })
        .collect()
}

fn stretch(body: &Body) -> (f64, f64) {
    let x = &body.system.particles.position;
    let (mut sum, mut max) = (0.0, 0.0_f64);
    for edge in &body.edges {
        let [a, b] = edge.points.map(|p| x[p as usize]);
        let strain = ((a - b).norm() / edge.rest - 1.0).abs();
        sum += strain * strain;
        // Not `f64::max`, which would hide a NaN; a NaN stays.
        if !max.is_nan() && !(strain <= max) {
            max = strain;
        }
    }
    ((sum / body.edges.len().max(1) as f64).sqrt(), max)
}

pub(super) fn elastic_residual(body: &Body) -> f64 {
    let all: Vec<Residual> = body
        .system
        .residuals()
        .into_iter()
        .filter(|(name, _)| *name != "volume")
        .map(|(_, r)| r)
        .collect();
    let count: usize = all.iter().map(|r| r.count).sum();
    (all.iter()
        .map(|r| r.rms * r.rms * r.count as f64)
        .sum::<f64>()
        / count.max(1) as f64)
        .sqrt()
}

fn kinetic_energy(body: &Body) -> f64 {
    let p = &body.system.particles;
    let each = p
        .velocity
        .iter()
        .zip(&p.inverse_mass)
        .filter(|(_, w)| **w > 0.0);
    each.map(|(v, w)| 0.5 * v.norm_squared() / w).sum()
}
