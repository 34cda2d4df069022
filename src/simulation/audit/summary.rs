//! The audit of all frames in one.

use serde::Serialize;

use super::frame::{AuditedPair, CrossingCounts, FrameAudit};
use crate::mesh::measures::max_or_nan;
use crate::state::{DecodeError, Reader, Value, Writer};

/// Result of the audit of several frames.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct AuditSummary {
    /// Number of frames that were audited.
    pub frames: usize,
    /// Greatest number in one frame, of each kind by itself.
    pub crossings_max: CrossingCounts,
    /// Sum over the frames.
    pub crossings_total: CrossingCounts,
    /// Greatest number of crossings of a soft and a rigid surface at a triangle with a vertex that
    /// the rigid one holds; `None` if held vertices are not known.
    pub crossings_held_max: Option<usize>,
    /// Greatest number of vertices of soft surfaces deeper than 0.01 mm in rigid ones, free or held.
    pub vertices_inside_bones_max: usize,
    /// Greatest number of vertices of rigid surfaces inside soft ones.
    pub bone_vertices_inside_max: usize,
    /// Greatest number of vertices of soft surfaces inside other soft ones.
    pub vertices_inside_muscles_max: usize,
    /// Greatest shared volume of two soft surfaces [m3].
    pub shared_volume_max_m3: f64,
    /// Greatest change of an enclosed volume since the first frame, relative.
    pub volume_error_max: f64,
    /// The surface with this change, and its frame.
    pub volume_error_at: Option<(String, usize)>,
    /// Greatest growth of the depth of two rigid surfaces in each other since the first frame,
    /// relative to the longest side of the smaller one's box.
    pub rigid_depth_max: f64,
    /// The two rigid surfaces, and the frame.
    pub rigid_depth_at: Option<([String; 2], usize)>,
    /// True if all pairs of triangles were tested in every frame.
    pub complete: bool,
    /// The first coordinate that is not finite: surface, vertex and frame.
    pub not_finite: Option<(String, usize, usize)>,
    /// Surfaces that are not closed, which contain nothing and have no volume.
    pub open: Vec<String>,
    /// Greatest number of triangles without area, which are in no test of crossings.
    pub flat_triangles_max: usize,
    /// Pairs of surfaces with findings, those with the most crossings first.
    pub pairs: Vec<PairSummary>,
}

/// A pair of surfaces with findings, or one surface with itself.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct PairSummary {
    /// The frame with the most crossings, or if there are none with the most vertices inside.
    pub frame: usize,
    /// Number of frames with findings.
    pub frames: usize,
    /// Sum of crossings over the frames.
    pub crossings_total: usize,
    /// Greatest shared volume [m3].
    pub shared_volume_max_m3: f64,
    /// The findings of that frame.
    #[serde(flatten)]
    pub worst: AuditedPair,
}

impl AuditSummary {
    /// The summary of no frame.
    pub fn new() -> Self {
        Self {
            complete: true,
            crossings_held_max: Some(0),
            ..Self::default()
        }
    }

    /// Adds the audit of a frame.
    pub fn add(&mut self, frame: usize, audit: &FrameAudit) {
        self.frames += 1;
        self.crossings_max = self.crossings_max.zip(&audit.crossings, usize::max);
        self.crossings_total = self.crossings_total.zip(&audit.crossings, |a, b| a + b);
        let held = self.crossings_held_max.zip(audit.crossings_held);
        self.crossings_held_max = held.map(|(a, b)| a.max(b));
        let most = |all: &mut usize, now: usize| *all = (*all).max(now);
        most(
            &mut self.vertices_inside_bones_max,
            audit.vertices_inside_bones,
        );
        most(
            &mut self.bone_vertices_inside_max,
            audit.bone_vertices_inside,
        );
        most(
            &mut self.vertices_inside_muscles_max,
            audit.vertices_inside_muscles,
        );
        most(&mut self.flat_triangles_max, audit.flat);
        let shared = [self.shared_volume_max_m3, audit.shared_volume_m3];
        self.shared_volume_max_m3 = max_or_nan(shared);
        if !(audit.volume_error <= self.volume_error_max) && !self.volume_error_max.is_nan() {
            self.volume_error_max = audit.volume_error;
            let of = audit.volume_error_of.clone();
            self.volume_error_at = of.map(|name| (name, frame));
        }
        if !(audit.rigid_depth <= self.rigid_depth_max) && !self.rigid_depth_max.is_nan() {
            self.rigid_depth_max = audit.rigid_depth;
            let of = audit.rigid_depth_of.clone();
            self.rigid_depth_at = of.map(|names| (names, frame));
        }
        self.complete &= audit.complete;
        if let (None, Some((name, vertex))) = (&self.not_finite, audit.not_finite.first()) {
            self.not_finite = Some((name.clone(), *vertex, frame));
        }
        for name in &audit.open {
            if !self.open.contains(name) {
                self.open.push(name.clone());
            }
        }
        for pair in &audit.pairs {
            self.add_pair(frame, pair);
        }
        // Stable, so that equal ones stay in the order of their first finding.
        self.pairs.sort_by_key(|p| std::cmp::Reverse(p.weight()));
    }

    fn add_pair(&mut self, frame: usize, pair: &AuditedPair) {
        let same = |p: &PairSummary| p.worst.surfaces == pair.surfaces;
        let place = self.pairs.iter().position(same);
        let place = place.unwrap_or_else(|| {
            self.pairs.push(PairSummary::default());
            self.pairs.len() - 1
        });
        let known = &mut self.pairs[place];
        known.frames += 1;
        known.crossings_total += pair.crossings;
        known.shared_volume_max_m3 =
            max_or_nan([known.shared_volume_max_m3, pair.shared_volume_m3]);
        let weight = |p: &AuditedPair| (p.crossings, p.vertices_inside[0] + p.vertices_inside[1]);
        if weight(pair) > weight(&known.worst) {
            (known.frame, known.worst) = (frame, pair.clone());
        }
    }

    /// The greatest findings of a kind of pairs, for a message of where.
    pub fn worst(&self, is_of: impl Fn(&PairSummary) -> bool) -> Option<&PairSummary> {
        self.pairs.iter().find(|p| is_of(p))
    }
}

impl PairSummary {
    fn weight(&self) -> (usize, usize) {
        let [one, other] = self.worst.vertices_inside;
        (self.worst.crossings, one + other)
    }

    /// The place in words: the surfaces, the frame, the triangles and the point in mm.
    pub fn place(&self) -> String {
        let AuditedPair {
            surfaces: [one, other],
            triangles,
            point_m,
            ..
        } = &self.worst;
        let mut text = if one == other {
            format!("{one} with itself")
        } else {
            format!("{one} and {other}")
        };
        text += &format!(", frame {}", self.frame);
        if let Some([s, t]) = triangles {
            text += &format!(", triangles {s} and {t}");
        }
        if let Some(point) = point_m {
            let [x, y, z] = point.map(|c| crate::format::number(c * 1e3));
            text += &format!(" at ({x}, {y}, {z}) mm");
        }
        text
    }
}

impl CrossingCounts {
    /// Combines the numbers of each kind.
    #[must_use]
    pub(super) fn zip(&self, other: &Self, with: impl Fn(usize, usize) -> usize) -> Self {
        Self {
            soft_soft: with(self.soft_soft, other.soft_soft),
            soft_rigid: with(self.soft_rigid, other.soft_rigid),
            self_: with(self.self_, other.self_),
            all: with(self.all, other.all),
        }
    }
}

/// For a run that goes on from a checkpoint.
impl Value for AuditSummary {
    const MIN_BYTES: usize = 16 * 8 + 4;

    fn encode(&self, to: &mut Writer) {
        let Self {
            frames,
            crossings_max,
            crossings_total,
            crossings_held_max,
            vertices_inside_bones_max,
            bone_vertices_inside_max,
            vertices_inside_muscles_max,
            shared_volume_max_m3,
            volume_error_max,
            volume_error_at,
            rigid_depth_max,
            rigid_depth_at,
            complete,
            not_finite,
            open,
            flat_triangles_max,
            pairs,
        } = self;
        to.put(&[
            *frames,
            *vertices_inside_bones_max,
            *bone_vertices_inside_max,
            *vertices_inside_muscles_max,
            *flat_triangles_max,
        ]);
        to.put(&[crossings_max.numbers(), crossings_total.numbers()]);
        to.put(crossings_held_max);
        to.put(&[*shared_volume_max_m3, *volume_error_max, *rigid_depth_max]);
        to.put(volume_error_at);
        to.put(rigid_depth_at);
        to.put(complete);
        let not_finite = not_finite.clone();
        to.put(&not_finite.map(|(name, vertex, frame)| (name, (vertex, frame))));
        to.list(open);
        to.list(pairs);
    }

    fn decode(from: &mut Reader<'_>) -> Result<Self, DecodeError> {
        let [
            frames,
            vertices_inside_bones_max,
            bone_vertices_inside_max,
            vertices_inside_muscles_max,
            flat_triangles_max,
        ] = from.take()?;
        let [max, total] = from.take()?;
        let crossings_held_max = from.take()?;
        let [shared_volume_max_m3, volume_error_max, rigid_depth_max] = from.take()?;
        let volume_error_at = from.take()?;
        let rigid_depth_at = from.take()?;
        let complete = from.take()?;
        let not_finite: Option<(String, (usize, usize))> = from.take()?;
        Ok(Self {
            frames,
            crossings_max: CrossingCounts::of_numbers(max),
            crossings_total: CrossingCounts::of_numbers(total),
            crossings_held_max,
            vertices_inside_bones_max,
            bone_vertices_inside_max,
            vertices_inside_muscles_max,
            shared_volume_max_m3,
            volume_error_max,
            volume_error_at,
            rigid_depth_max,
            rigid_depth_at,
            complete,
            not_finite: not_finite.map(|(name, (vertex, frame))| (name, vertex, frame)),
            open: from.take()?,
            flat_triangles_max,
            pairs: from.take()?,
        })
    }
}

impl Value for PairSummary {
    const MIN_BYTES: usize = 11 * 8 + 3;

    fn encode(&self, to: &mut Writer) {
        let Self {
            frame,
            frames,
            crossings_total,
            shared_volume_max_m3,
            worst:
                AuditedPair {
                    surfaces,
                    with_rigid,
                    crossings,
                    vertices_inside: [inside, swallowed],
                    depth_m,
                    shared_volume_m3,
                    triangles,
                    point_m,
                },
        } = self;
        to.put(&[*frame, *frames, *crossings_total]);
        to.put(&[*crossings, *inside, *swallowed]);
        to.put(&[*shared_volume_max_m3, *depth_m, *shared_volume_m3]);
        to.put(surfaces);
        to.put(with_rigid);
        to.put(triangles);
        to.put(point_m);
    }

    fn decode(from: &mut Reader<'_>) -> Result<Self, DecodeError> {
        let [frame, frames, crossings_total] = from.take()?;
        let [crossings, inside, swallowed] = from.take()?;
        let [shared_volume_max_m3, depth_m, shared_volume_m3] = from.take()?;
        Ok(Self {
            frame,
            frames,
            crossings_total,
            shared_volume_max_m3,
            worst: AuditedPair {
                surfaces: from.take()?,
                with_rigid: from.take()?,
                crossings,
                vertices_inside: [inside, swallowed],
                depth_m,
                shared_volume_m3,
                triangles: from.take()?,
                point_m: from.take()?,
            },
        })
    }
}

impl CrossingCounts {
    fn numbers(&self) -> [usize; 4] {
        [self.soft_soft, self.soft_rigid, self.self_, self.all]
    }

    fn of_numbers([soft_soft, soft_rigid, self_, all]: [usize; 4]) -> Self {
        Self {
            soft_soft,
            soft_rigid,
            self_,
            all,
        }
    }
}
