//! Which volume gives a wanted area, and what each of several volumes gives.

use super::SkinError;
use super::plan::{Inserted, PreparedPatch};
use super::settle::{Progress, STEADY};

/// A wanted area is met to this share of it, if areas are as sure as that.
const MET: f64 = 2e-3;

/// Insertions tried at most.
const TRIALS: u32 = 16;

/// A bracket as narrow as this, as a share of the volume, that does not give the wanted area has ends that do not belong together.
const NARROW: f64 = 0.01;

/// The next volume lies so far within a bracket, as a share of it, where the last two trials tell it and where they do not.
const NEXT: f64 = 1e-3;
const APART: f64 = 0.05;

/// A volume is changed by this factor until the wanted area lies between two.
const WIDER: f64 = 1.6;

impl PreparedPatch {
    /// The insertion of which the region gains `wanted` [m^2] while the implant is in: a bracket, narrowed by secants through the
    /// last two trials.
    ///
    /// # Errors
    /// A gain that no volume gives; see also [`PreparedPatch::insert`].
    pub fn solve_for_area(
        &self,
        wanted: f64,
        mut watch: impl FnMut(&Progress) -> bool,
    ) -> Result<Inserted, SkinError> {
        SkinError::positive("the wanted area", wanted)?;
        let most = self.largest();
        let base = self.order.implant.base;
        // A cap over the base gains pi h^2; skin gains less.
        let height = (wanted / std::f64::consts::PI).sqrt();
        let cap = std::f64::consts::PI * height * (0.75 * base * base + height * height) / 6.0;
        let mut volume = cap.min(most);
        let (mut low, mut high) = ((0.0, -wanted), None::<(f64, f64)>);
        let mut last: Option<(Inserted, (f64, f64))> = None;
        for _ in 0..TRIALS {
            let found =
                self.insert_after(last.as_ref().map(|(found, _)| found), &[volume], &mut watch)?;
            let over = found.areas.gain() - wanted;
            if over.abs() <= MET * wanted {
                return Ok(found);
            }
            if over > 0.0 {
                high = Some((volume, over))
            } else {
                low = (volume, over)
            }
            if high.is_some_and(|high| high.0 - low.0 <= NARROW * high.0) {
                // Areas at rest are no surer than that.
                if over.abs() <= STEADY * found.areas.deformed {
                    return Ok(found);
                }
                // The gain jumps there: the other end was found from elsewhere, and the skin lay otherwise.
                if over > 0.0 {
                    low = (0.0, -wanted)
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
                    let (wanted_cm2, reached_cm2) = (wanted * 1e4, (wanted + low.1) * 1e4);
                    return Err(SkinError::OutOfReach {
                        wanted_cm2,
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
        Err(SkinError::Solver(format!(
            "no volume gives {:.1} cm2 after {TRIALS} trials",
            wanted * 1e4
        )))
    }

    /// Skin over each of several volumes [m^3], in their order.
    ///
    /// # Errors
    /// See [`PreparedPatch::insert`].
    pub fn curve(
        &self,
        volumes: &[f64],
        mut watch: impl FnMut(&Progress) -> bool,
    ) -> Result<Vec<Inserted>, SkinError> {
        let mut done: Vec<Inserted> = Vec::new();
        for volume in volumes {
            let next = self.insert_after(done.last(), &[*volume], &mut watch)?;
            done.push(next);
        }
        Ok(done)
    }
}

/// A volume within a bracket: the one that is expected, else where a line through both ends is zero, not next to an end.
fn within(low: (f64, f64), high: (f64, f64), expected: Option<f64>) -> f64 {
    let width = high.0 - low.0;
    let line = low.0 - low.1 / (high.1 - low.1) * width;
    match expected.filter(|volume| low.0 < *volume && *volume < high.0) {
        Some(volume) => volume.clamp(low.0 + NEXT * width, high.0 - NEXT * width),
        None => line.clamp(low.0 + APART * width, high.0 - APART * width),
    }
}
