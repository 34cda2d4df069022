//! Rate of convergence to rest, and an estimate of the number of steps.

use pliant::springs::{RestSettings, StepRecord};

/// Factor on the extrapolated number of steps: the slowest part decreases last.
const SPARE: f64 = 2.5;

/// Residual force and motion relative to their tolerances: the greatest in two intervals of steps,
/// since they oscillate.
pub(super) struct Nearing {
    rest: RestSettings,
    steps: usize,
    /// At the middle and at the end.
    most: [f64; 2],
}

impl Nearing {
    pub(super) fn new(steps: usize, rest: RestSettings) -> Self {
        Self {
            rest,
            steps,
            most: [0.0; 2],
        }
    }

    /// Adds a step.
    pub(super) fn step(&mut self, step: &StepRecord) {
        let left =
            (step.residual / self.rest.force).max((step.energy.kinetic / self.rest.energy).sqrt());
        // An eighth of all steps before the middle, and before the end.
        let eighth = 8 * step.step / self.steps.max(1);
        let spans = [eighth == 3, eighth >= 7];
        let most = self
            .most
            .iter_mut()
            .zip(spans)
            .filter(|(_, within)| *within);
        most.for_each(|(most, _)| *most = most.max(left));
    }

    /// Advice if the steps were not sufficient.
    pub(super) fn hint(&self) -> String {
        let [half, end] = self.most;
        let fall = (half / end).ln() / (0.5 * self.steps as f64);
        if !(fall > 0.0 && fall.is_finite()) {
            return "give more --steps, or another --damping: what is left hardly falls".to_owned();
        }
        let needed = self.steps as f64 + SPARE * end.max(1.0).ln() / fall;
        let unit = 10f64.powf(needed.log10().floor() - 1.0);
        // More than the option allows.
        if !(needed <= 1e7) {
            return "give another --damping: what is left hardly falls, no number of --steps is enough".to_owned();
        }
        format!(
            "it comes nearer to rest: about --steps {} should be enough",
            (needed / unit).ceil() * unit
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hint(left: impl Fn(f64) -> f64) -> String {
        let mut nearing = Nearing::new(
            1000,
            RestSettings {
                force: 1e-3,
                energy: 4.0,
            },
        );
        (1..=1000).for_each(|step| {
            let left = left(step as f64);
            let mut record = StepRecord {
                step,
                ..StepRecord::default()
            };
            // What moves is as far from rest as what is pulled.
            match step % 2 {
                0 => record.residual = 1e-3 * left,
                _ => record.energy.kinetic = 4.0 * left * left,
            }
            nearing.step(&record);
        });
        nearing.hint()
    }

    #[test]
    fn what_falls_evenly_is_told_its_steps_and_what_does_not_fall_none() {
        let told = |hint: &str| {
            hint.split("--steps ")
                .nth(1)
                .and_then(|rest| rest.split(' ').next()?.parse().ok())
        };
        // At rest after 2000 steps; 2.5 times the 1125 that remain at the start of the last
        // interval.
        let even = hint(|step| ((2000.0 - step) / 100.0).exp());
        assert_eq!(told(&even), Some(3900.0), "{even}");
        // An oscillating decrease.
        let swung = hint(|step| ((2000.0 - step) / 100.0).exp() * (1.01 + (0.3 * step).cos()));
        assert!(
            told(&swung).is_some_and(|steps: f64| (3000.0..=5000.0).contains(&steps)),
            "{swung}"
        );
        assert!(hint(|_| 5.0).contains("hardly falls"));
        assert!(hint(|step| step).contains("hardly falls"));
        assert!(hint(|step| 1e9 - step).contains("no number of --steps"));
    }
}
