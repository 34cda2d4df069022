//! Filling of implants over weeks: volumes by day, and almost empty implants.

use super::SkinError;
use super::plan::PreparedPatch;
use crate::mesh::TriangleMesh;

/// A filling of an implant on a day.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Filling {
    /// Day of the filling.
    pub day: f64,
    /// Volume from that day on [m^3].
    pub volume: f64,
}

/// Fillings in the order of their days; volumes never decrease.
#[derive(Clone, Debug, PartialEq)]
pub struct Schedule(Vec<Filling>);

impl Schedule {
    /// Checks the fillings and creates the schedule.
    ///
    /// # Errors
    /// No filling, days that do not increase, or a volume that is not positive or decreases.
    pub fn new(fillings: Vec<Filling>) -> Result<Self, SkinError> {
        if fillings.is_empty() {
            return Err(SkinError::Schedule {
                step: 1,
                what: "there is none",
            });
        }
        for (k, filling) in fillings.iter().enumerate() {
            SkinError::positive("the volume", filling.volume)?;
            let wrong = |what| Err(SkinError::Schedule { step: k + 1, what });
            if !filling.day.is_finite() {
                return wrong("its day is no number");
            }
            match k.checked_sub(1).map(|before| fillings[before]) {
                Some(before) if filling.day <= before.day => {
                    return wrong("its day is not after the one before");
                }
                Some(before) if filling.volume < before.volume => {
                    return wrong("its volume is less than the one before");
                }
                _ => {}
            }
        }
        Ok(Self(fillings))
    }

    /// The fillings, at least one.
    pub fn fillings(&self) -> &[Filling] {
        &self.0
    }
}

/// Volume of a pocket relative to the cube of its base.
const EMPTY: f64 = 1e-5;

impl PreparedPatch {
    /// Checks that implants of these volumes [m^3] fit under this skin.
    ///
    /// # Errors
    /// A volume that is not positive or too large for the region.
    pub fn takes(&self, volumes: &[f64]) -> Result<(), SkinError> {
        self.model(volumes).map(|_| ())
    }

    /// The shells of almost empty implants [m].
    ///
    /// # Errors
    /// See [`PreparedPatch::insert`].
    pub fn pockets(&self) -> Result<Vec<TriangleMesh>, SkinError> {
        let empty: Vec<f64> = self
            .sites()
            .map(|(order, _)| EMPTY * order.implant.base.powi(3))
            .collect();
        self.domes(&empty)
    }

    /// The shells of implants of these volumes [m^3] before the deformation [m].
    ///
    /// # Errors
    /// See [`PreparedPatch::insert`].
    pub fn domes(&self, volumes: &[f64]) -> Result<Vec<TriangleMesh>, SkinError> {
        Ok(self
            .model(volumes)?
            .0
            .implants
            .into_iter()
            .map(|implant| implant.mesh)
            .collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn schedule(steps: &[(f64, f64)]) -> Result<Schedule, SkinError> {
        Schedule::new(
            steps
                .iter()
                .map(|&(day, volume)| Filling { day, volume })
                .collect(),
        )
    }

    #[test]
    fn what_is_no_schedule_is_refused() {
        assert!(schedule(&[(0.0, 2e-5), (7.0, 5e-5), (14.0, 5e-5)]).is_ok());
        for steps in [
            &[][..],
            &[(0.0, -1e-5)],
            &[(f64::NAN, 1e-5)],
            &[(1.0, 1e-5), (1.0, 2e-5)],
            &[(1.0, 2e-5), (2.0, 1e-5)],
        ] {
            assert!(schedule(steps).is_err(), "{steps:?}");
        }
    }
}
