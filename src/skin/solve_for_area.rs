//! Search for the volume that gives a target area.

use super::SkinError;
use super::plan::{Inserted, PreparedPatch};
use super::settle::{STEADY, SettleProgress};

/// Relative tolerance of the requested area, limited by the accuracy of areas.
const REACHED: f64 = 2e-3;

/// Greatest number of insertions.
const TRIALS: u32 = 16;

/// A bracket narrower than this, relative to the volume, whose ends do not give the requested area
/// is inconsistent.
const NARROW: f64 = 0.01;

/// A bracket narrower than this, relative to the volume, ends the search within the accuracy of areas
/// at equilibrium.
const NARROWEST: f64 = 1e-3;

/// Least distance of the next volume from the ends of a bracket, relative to the bracket, with and
/// without a prediction from the last two trials.
const NEXT: f64 = 1e-3;
const APART: f64 = 0.05;

/// Factor between volumes until two of them bracket the requested area.
const WIDER: f64 = 1.6;

impl PreparedPatch {
    /// The insertion with a gain of `target` [m^2] while the implant is in place: a bracket,
    /// narrowed by secants through the last two trials.
    ///
    /// # Errors
    /// A gain that no volume gives; also those of [`Ready::insert`].
    pub fn solve_for_area(
        &self,
        target: f64,
        mut watch: impl FnMut(&SettleProgress) -> bool,
    ) -> Result<Inserted, SkinError> {
        SkinError::positive("the target area", target)?;
        let most = self.largest();
        let base = self.order.implant.base;
        // A cap over the base gains pi h^2; skin gains less.
        let height = (target / std::f64::consts::PI).sqrt();
        let cap = std::f64::consts::PI * height * (0.75 * base * base + height * height) / 6.0;
        let mut volume = cap.min(most);
        let (mut low, mut high) = ((0.0, -target), None::<(f64, f64)>);
        let mut last: Option<(Inserted, (f64, f64))> = None;
        for _ in 0..TRIALS {
            let found =
                self.insert_after(last.as_ref().map(|(found, _)| found), &[volume], &mut watch)?;
            let over = found.areas.gain() - target;
            if over.abs() <= REACHED * target {
                return Ok(found);
            }
            if over > 0.0 {
                high = Some((volume, over))
            } else {
                low = (volume, over)
            }
            // The accuracy of areas at equilibrium.
            let is_steady = over.abs() <= STEADY * found.areas.deformed;
            let is_within = |width: f64| high.is_some_and(|high| high.0 - low.0 <= width * high.0);
            if is_steady && is_within(NARROWEST) {
                return Ok(found);
            }
            if !is_steady && is_within(NARROW) {
                // The gain jumps there: the other end comes from another branch of solutions.
                if over > 0.0 {
                    low = (0.0, -target)
                } else {
                    high = None
                }
            }
            let slope = last
                .as_ref()
                .map(|(_, before)| (over - before.1) / (volume - before.0));
            let next = slope
                .filter(|slope| *slope > 0.0)
                .map(|slope| volume - over / slope);
            last = Some((found, (volume, over)));
            volume = match high {
                None if low.0 >= most => {
                    let (target_cm2, reached_cm2) = (target * 1e4, (target + low.1) * 1e4);
                    return Err(SkinError::OutOfReach {
                        target_cm2,
                        most_cc: most * 1e6,
                        reached_cm2,
                    });
                }
                None => next
                    .unwrap_or(f64::INFINITY)
                    .clamp(low.0, WIDER * low.0)
                    .min(most),
                Some(high) => within(low, high, next),
            };
        }
        if let Some((found, (_, over))) = last
            && over.abs() <= STEADY * found.areas.deformed
        {
            return Ok(found);
        }
        Err(SkinError::Solver(format!(
            "no volume gives {:.1} cm2 after {TRIALS} trials",
            target * 1e4
        )))
    }
}

/// A volume within a bracket: the predicted one, otherwise the zero of the line through both ends;
/// never next to an end.
fn within(low: (f64, f64), high: (f64, f64), expected: Option<f64>) -> f64 {
    let width = high.0 - low.0;
    let line = low.0 - low.1 / (high.1 - low.1) * width;
    match expected.filter(|volume| low.0 < *volume && *volume < high.0) {
        Some(volume) => volume.clamp(low.0 + NEXT * width, high.0 - NEXT * width),
        None => line.clamp(low.0 + APART * width, high.0 - APART * width),
    }
}
