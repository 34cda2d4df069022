//! The steps of a lattice on a graphics card, for programs that are built with the feature `gpu`.

use super::Rows;
use crate::simd::Number;
use crate::springs::lattice::Lattice;

/// A lattice where another one is, on a graphics card. Errors are messages.
#[cfg(not(feature = "gpu"))]
pub(super) fn of<F: Number>(_: &Lattice<F>, _: &str) -> Result<Box<dyn Rows>, String> {
    Err("this program knows no graphics cards: it is built without the feature `gpu`".to_owned())
}

/// A lattice where another one is, on a graphics card. Errors are messages.
#[cfg(feature = "gpu")]
pub(super) fn of<F: Number>(
    lattice: &Lattice<F>,
    method: &'static str,
) -> Result<Box<dyn Rows>, String> {
    let made = on_card::GpuLattice::of(lattice, method);
    made.map(|lattice| Box::new(lattice) as Box<dyn Rows>)
        .map_err(|error| error.to_string())
}

#[cfg(feature = "gpu")]
mod on_card {
    use nalgebra::{Point3, Vector3};

    use super::super::super::StepRecord;
    use super::super::record_of;
    use super::Rows;
    use crate::springs::integrators::StepError;
    pub(super) use crate::springs::lattice::gpu::GpuLattice;
    use crate::springs::lattice::{LatticeSettings, LatticeShape};

    impl Rows for GpuLattice {
        fn shape(&self) -> &LatticeShape {
            GpuLattice::shape(self)
        }

        fn settings(&self) -> &LatticeSettings {
            GpuLattice::settings(self)
        }

        fn damping(&self) -> f64 {
            GpuLattice::damping(self)
        }

        fn advance(&mut self, steps: u64) -> Result<f64, (StepError, u64)> {
            let moved = GpuLattice::advance(self, steps);
            let moved = moved.map_err(|_| (StepError::DeviceLost, self.steps()))?;
            if moved.is_finite() {
                return Ok(moved);
            }
            let nowhere = |x: Point3<f64>| x.iter().any(|c| !c.is_finite());
            let all = Rows::positions(self).into_iter();
            let point = all
                .map(nowhere)
                .position(|is_nowhere| is_nowhere)
                .unwrap_or(0);
            let dt = self.time_step();
            Err((StepError::NotFinite { point, dt }, self.steps()))
        }

        fn record(&self, step: usize, moved: f64) -> StepRecord {
            record_of(&self.motion(), (step, self.time_step()), moved)
        }

        fn held(&self) -> Vec<bool> {
            self.pinned().to_vec()
        }

        /// Not numbers if the card no longer answers.
        fn positions(&self) -> Vec<Point3<f64>> {
            match GpuLattice::positions(self) {
                Ok(all) => all.into_iter().map(Point3::from).collect(),
                Err(_) => vec![Point3::from([f64::NAN; 3]); self.shape().count()],
            }
        }

        fn velocities(&self) -> Vec<Vector3<f64>> {
            match self.to_cpu() {
                Ok(lattice) => lattice.of_velocities(Vector3::from),
                Err(_) => vec![Vector3::from([f64::NAN; 3]); self.shape().count()],
            }
        }

        fn speeds(&self) -> Vec<f64> {
            Rows::velocities(self).iter().map(Vector3::norm).collect()
        }

        fn pace(&mut self, steps: u64, reads: Option<bool>) -> Result<(), (StepError, u64)> {
            let lost = |steps| (StepError::DeviceLost, steps);
            let Some(beside) = reads else {
                self.submit(steps);
                return self.wait().map_err(|_| lost(self.steps()));
            };
            let mut waiting = None;
            for _ in 0..steps {
                self.submit(1);
                let copy = match (&waiting, beside) {
                    // The copy of the step before, while this one goes on.
                    (Some(before), true) => {
                        self.read(before).map_err(|_| lost(self.steps()))?;
                        self.begin_to_read()
                    }
                    (None, true) => self.begin_to_read(),
                    (_, false) => {
                        let copy = self.begin_to_read();
                        self.read(&copy).map_err(|_| lost(self.steps()))?;
                        copy
                    }
                };
                waiting = Some(copy);
            }
            if let (Some(last), true) = (waiting, beside) {
                self.read(&last).map_err(|_| lost(self.steps()))?;
            }
            Ok(())
        }

        fn card(&self) -> Option<(&str, u64)> {
            Some((self.name(), self.bytes()))
        }
    }
}
