//! A spring system on its way to rest as a scenario: each step is a frame.

use std::ops::ControlFlow;
use std::time::Duration;

use nalgebra::{Isometry3, Point3, Vector3};

use super::nearing::Nearing;
use super::written::Record;
use crate::commands::progress::Bar;
use pliant::progress::Progress;
use pliant::simulation::{Ended, Observer, Plan, Scenario, SceneDescription, Stepped, run};
use pliant::springs::integrators::StepError;
use pliant::springs::{RestEnd, RestSettings, Settled, SpringSystem, StepRecord};

/// A function that makes a step and returns its length [s].
pub(super) type Advance = Box<dyn FnMut(&mut SpringSystem) -> Result<f64, StepError> + Send>;

/// A spring system that runs to rest. The command writes its frames, so that it describes no body.
pub(super) struct SpringsRun<'a> {
    name: &'a str,
    system: &'a mut SpringSystem,
    advance: Advance,
    rest: RestSettings,
    last: StepRecord,
    /// Greatest number of steps.
    limit: usize,
    end: Option<RestEnd>,
    plan: Plan,
}

impl<'a> SpringsRun<'a> {
    pub(super) fn new(
        name: &'a str,
        system: &'a mut SpringSystem,
        advance: Advance,
        rest: RestSettings,
        limit: usize,
    ) -> Self {
        let mut run = Self {
            name,
            last: StepRecord::of(system, 0, 0.0, &system.position),
            system,
            advance,
            rest,
            limit,
            end: None,
            plan: Plan::default(),
        };
        run.judge();
        run
    }

    /// Ends the run if the system is at rest.
    fn judge(&mut self) {
        if self.rest.allows(&self.last) {
            self.end = Some(RestEnd::Rest);
        }
    }

    /// Runs to rest, to the greatest number of steps, or until the progress stops it.
    pub(super) fn settle(mut self, watch: &mut Watch<'_>, progress: &dyn Progress) -> Settled {
        let ended = run(&mut self, &mut [watch], progress);
        Settled {
            end: match (self.end, ended) {
                (Some(end), _) => end,
                (None, Ended::Interrupted) => RestEnd::Stopped,
                (None, _) => RestEnd::Steps,
            },
            steps: self.last.step,
            last: self.last,
        }
    }
}

impl Scenario for SpringsRun<'_> {
    fn name(&self) -> &str {
        self.name
    }

    fn frames(&self) -> usize {
        self.limit
    }

    fn frame(&self) -> usize {
        self.last.step
    }

    fn frame_rate(&self) -> f64 {
        1.0 / self.last.dt
    }

    fn plan(&self) -> &Plan {
        &self.plan
    }

    fn description(&self) -> SceneDescription {
        SceneDescription {
            bodies: Vec::new(),
            bones: Vec::new(),
        }
    }

    fn poses(&self, _: usize) -> Vec<Isometry3<f64>> {
        Vec::new()
    }

    fn bodies(&self) -> Vec<(Vec<Point3<f64>>, Vec<Vector3<f64>>)> {
        Vec::new()
    }

    fn step(&mut self, _: &dyn Progress) -> Stepped {
        let before = self.system.position.clone();
        match (self.advance)(self.system) {
            Ok(dt) => {
                self.last = StepRecord::of(self.system, self.last.step + 1, dt, &before);
                self.judge();
                Stepped::Done
            }
            Err(error) => {
                self.end = Some(RestEnd::Failed(error));
                Stepped::Failed(error.to_string())
            }
        }
    }

    fn is_finished(&self) -> bool {
        self.end.is_some() || self.frame() >= self.limit
    }

    fn converged(&self) -> bool {
        self.end == Some(RestEnd::Rest)
    }

    fn measures(&self) -> Vec<(&'static str, f64)> {
        vec![("residual_force_n", self.severity())]
    }

    fn severity(&self) -> f64 {
        self.last.residual
    }

    fn severity_name(&self) -> &'static str {
        "greatest force"
    }
}

/// Records and shows the steps of a run.
pub(super) struct Watch<'a> {
    pub(super) record: &'a mut Record,
    pub(super) bar: &'a Bar,
    pub(super) nearing: &'a mut Nearing,
}

impl<'a> Observer<SpringsRun<'a>> for Watch<'_> {
    fn start(&mut self, _: &SpringsRun<'a>) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    fn frame(&mut self, run: &SpringsRun<'a>, _: Duration) -> ControlFlow<()> {
        self.record.step(run.system, &run.last);
        self.bar.step(&run.last);
        self.nearing.step(&run.last);
        ControlFlow::Continue(())
    }
}
