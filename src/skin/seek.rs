//! Which volume gives a wanted area, and what each of several volumes gives.

use super::SkinError;
use super::plan::{Inserted, Ready};
use super::settle::Progress;

/// A wanted area is met to this share of it.
const MET: f64 = 2e-3;

/// Insertions tried at most.
const TRIALS: u32 = 16;

/// A volume is changed by this factor until the wanted area lies between two.
const WIDER: f64 = 1.6;

impl Ready {
    /// The insertion of which the region gains `wanted` [m^2] while the implant is in: a bracket, narrowed by secants.
    ///
    /// # Errors
    /// A gain that no volume gives; see also [`Ready::insert`].
    pub fn seek(&self, wanted: f64, mut watch: impl FnMut(&Progress) -> bool) -> Result<Inserted, SkinError> {
        SkinError::positive("the wanted area", wanted)?;
        let most = self.largest();
        let base = self.order.implant.base;
        // A cap over the base gains pi h^2; skin gains less.
        let height = (wanted / std::f64::consts::PI).sqrt();
        let cap = std::f64::consts::PI * height * (0.75 * base * base + height * height) / 6.0;
        let mut volume = cap.min(most);
        let (mut low, mut high) = ((0.0, -wanted), None::<(f64, f64)>);
        let mut last: Option<Inserted> = None;
        for _ in 0..TRIALS {
            let found = self.insert_after(last.as_ref(), &[volume], &mut watch)?;
            let over = found.areas.gain() - wanted;
            if over.abs() <= MET * wanted {
                return Ok(found);
            }
            if over > 0.0 {
                high = Some((volume, over))
            } else {
                low = (volume, over)
            }
            volume = match high {
                None if low.0 >= most => {
                    let (wanted_cm2, reached_cm2) = (wanted * 1e4, found.areas.gain() * 1e4);
                    return Err(SkinError::OutOfReach { wanted_cm2, most_cc: most * 1e6, reached_cm2 });
                }
                None => (WIDER * low.0).min(most),
                Some(high) => between(low, high),
            };
            last = Some(found);
        }
        Err(SkinError::Solver(format!("no volume gives {:.1} cm2 after {TRIALS} trials", wanted * 1e4)))
    }

    /// Skin over each of several volumes [m^3], in their order.
    ///
    /// # Errors
    /// See [`Ready::insert`].
    pub fn curve(&self, volumes: &[f64], mut watch: impl FnMut(&Progress) -> bool) -> Result<Vec<Inserted>, SkinError> {
        let mut done: Vec<Inserted> = Vec::new();
        for volume in volumes {
            let next = self.insert_after(done.last(), &[*volume], &mut watch)?;
            done.push(next);
        }
        Ok(done)
    }
}

/// Where a line through both ends is zero, away from the ends.
fn between(low: (f64, f64), high: (f64, f64)) -> f64 {
    let share = -low.1 / (high.1 - low.1);
    low.0 + share.clamp(0.05, 0.95) * (high.0 - low.0)
}
