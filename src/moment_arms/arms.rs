//! Results of a sweep: lengths and moment arms of each fibre and of the muscle, and their
//! comparison with tables.

use super::curve::{Roughness, extremes, moment_arms, roughness};
use super::reference::{Comparison, ReferenceCurve, ReferenceError, Table};
use super::sweep::{CrossingMuscle, SweepRun};
use crate::mesh::measures::max_or_nan;

/// Straight lines are the path of a muscle where no bone blocks this share of them.
pub(super) const CLEAR: f64 = 0.9;

/// Moment arms of a muscle.
#[derive(Clone, Debug)]
pub struct Arms {
    /// Name of the muscle.
    pub name: String,
    /// Angles that the sweep reached \[rad\].
    pub angles: Vec<f64>,
    /// Length of each fibre at each angle [m], as `lengths[fibre][angle]`.
    pub lengths: Vec<Vec<f64>>,
    /// Moment arm of each fibre at each angle [m], as `fibres[fibre][angle]`.
    pub fibres: Vec<Vec<f64>>,
    /// Mean length of the fibres at each angle [m].
    pub length: Vec<f64>,
    /// Moment arm of the muscle at each angle [m]: the mean over the fibres.
    pub mean: Vec<f64>,
    /// Moment arm of straight lines between the ends of the fibres at each angle [m], mean over the
    /// fibres. The difference to `mean` is the effect of the muscle's curvature.
    pub straight: Vec<f64>,
    /// Share of these lines that no bone blocks, at each angle.
    pub clear: Vec<f64>,
    /// Roughness of the muscle's moment arm without smoothing.
    pub roughness: Option<Roughness>,
    /// Roughness of the muscle's length.
    pub length_roughness: Option<Roughness>,
    /// Tables that contain the muscle, with the comparison; `None` where the ranges of angles do
    /// not overlap.
    pub compared: Vec<(String, ReferenceCurve, Option<Comparison>)>,
    /// Share of the angles at which straight lines would lie in the envelope of the same tables.
    pub straight_overlaps: Vec<Option<f64>>,
}

fn mean(of: &[Vec<f64>], k: usize) -> f64 {
    of.iter().map(|f| f[k]).sum::<f64>() / of.len() as f64
}

impl Arms {
    /// Moment arms of a muscle from the record of a sweep. Smoothing uses `around` values on each
    /// side, see [`moment_arms`].
    pub fn new(muscle: &CrossingMuscle, running: &SweepRun, around: usize) -> Self {
        let values = muscle.lengths.len();
        let count = muscle.fibres.len();
        let lengths: Vec<Vec<f64>> = (0..count)
            .map(|f| muscle.lengths.iter().map(|all| all[f]).collect())
            .collect();
        let fibres: Vec<Vec<f64>> = lengths
            .iter()
            .map(|l| moment_arms(l, running.step, around))
            .collect();
        let length: Vec<f64> = (0..values).map(|k| mean(&lengths, k)).collect();
        let mean: Vec<f64> = (0..values).map(|k| mean(&fibres, k)).collect();
        Self {
            name: muscle.name.clone(),
            angles: running.angles[..values].to_vec(),
            roughness: roughness(&moment_arms(&length, running.step, 0)),
            length_roughness: roughness(&length),
            straight: moment_arms(&muscle.chords, running.step, around),
            clear: muscle.clear.clone(),
            straight_overlaps: Vec::new(),
            lengths,
            fibres,
            length,
            mean,
            compared: Vec::new(),
        }
    }

    /// Compares the muscle's moment arm with those of tables over a coordinate such as `hip_flexion`.
    ///
    /// # Errors
    /// A table that cannot be used.
    pub fn compare(&mut self, tables: &[Table], coordinate: &str) -> Result<(), ReferenceError> {
        for table in tables {
            if let Some(reference) = table.of(&self.name, coordinate)? {
                let compared = reference.compare(&self.angles, &self.mean);
                let straight = reference
                    .compare(&self.angles, &self.straight)
                    .and_then(|c| c.overlap);
                self.straight_overlaps.push(straight);
                self.compared.push((table.name(), reference, compared));
            }
        }
        Ok(())
    }

    /// Greatest difference of the moment arm from that of straight lines, at angles at which no bone
    /// blocks nine of ten of them, relative to the greatest moment arm of such lines. `None` where
    /// bones block them at each angle, or none has a moment arm.
    pub fn off_straight(&self) -> Option<f64> {
        let is_clear = |k: &usize| self.clear[*k] >= CLEAR;
        let at = (0..self.mean.len()).filter(is_clear);
        let [least, most] = extremes(at.clone().map(|k| self.straight[k]))?;
        let greatest = max_or_nan([-least, most]);
        let off = max_or_nan(at.map(|k| (self.mean[k] - self.straight[k]).abs()));
        // Not a number, unlike zero, has to fail.
        (greatest != 0.0).then_some(off / greatest)
    }

    /// Least and greatest moment arm of a fibre at angle `k` [m].
    pub fn bounds(&self, k: usize) -> [f64; 2] {
        extremes(self.fibres.iter().map(|f| f[k])).unwrap_or([f64::NAN; 2])
    }
}
