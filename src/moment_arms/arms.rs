//! What a sweep gives: lengths and moment arms of each fibre and of the muscle, and how they compare with others.

use super::curve::{Roughness, extremes, moment_arms, roughness};
use super::reference::{Comparison, Reference, ReferenceError, Table};
use super::sweep::{Crossing, Running};

/// Moment arms of a muscle.
#[derive(Clone, Debug)]
pub struct Arms {
    /// Its name.
    pub name: String,
    /// Values of the angle that were reached \[rad\].
    pub angles: Vec<f64>,
    /// For each fibre its length at each value [m].
    pub lengths: Vec<Vec<f64>>,
    /// For each fibre its moment arm at each value [m].
    pub fibres: Vec<Vec<f64>>,
    /// Mean over the fibres of their lengths at each value [m].
    pub length: Vec<f64>,
    /// Mean over the fibres of their moment arms at each value [m]: the muscle's.
    pub mean: Vec<f64>,
    /// Mean over the fibres of what straight lines between their ends would have at each value [m]: what is left of the
    /// difference to it is how the muscle is curved.
    pub straight: Vec<f64>,
    /// How rough the muscle's moment arm is without smoothing.
    pub roughness: Option<Roughness>,
    /// How rough the muscle's length is.
    pub length_roughness: Option<Roughness>,
    /// Tables that have the muscle, and how it compares; `None` where they have no angles in common.
    pub compared: Vec<(String, Reference, Option<Comparison>)>,
    /// The share of the angles at which straight lines would lie in the envelope of the same tables.
    pub straight_overlaps: Vec<Option<f64>>,
}

fn mean(of: &[Vec<f64>], k: usize) -> f64 {
    of.iter().map(|f| f[k]).sum::<f64>() / of.len() as f64
}

impl Arms {
    /// Of a muscle, from what a sweep recorded; `around` values on each side are smoothed over, see [`moment_arms`].
    pub fn new(muscle: &Crossing, running: &Running, around: usize) -> Self {
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
    /// A table that is of no use.
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

    /// Least and greatest moment arm of a fibre at a value [m].
    pub fn bounds(&self, k: usize) -> [f64; 2] {
        extremes(self.fibres.iter().map(|f| f[k])).unwrap_or([f64::NAN; 2])
    }
}
