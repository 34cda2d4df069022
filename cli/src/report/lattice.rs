//! What is told of a lattice that is dragged and let go.

use std::collections::HashSet;

use nalgebra::{Isometry3, Vector3};
use serde_json::json;

use super::frames::{Cast, Snapshot};
use super::output::{Verdict, own_object};
use super::run::{Account, Run};
use super::skin::actor;
use super::{LinePlot, Table};
use pliant::format::number;
use pliant::mesh::measures::greatest;
use pliant::simulation::Plan;
use pliant::simulation::lattice::LatticeRun;
use pliant::simulation::skin::Stepped;
use pliant::springs::Neighbours;

/// A lattice that keeps its shape comes back to this share of its spacing.
const BACK: f64 = 0.01;

fn distance(run: &LatticeRun) -> f64 {
    run.frames.last().map_or(0.0, |f| f.distance)
}

/// Whether it was let go.
fn is_free(run: &LatticeRun) -> bool {
    run.frame() > run.scene.release
}

fn verdicts(run: &LatticeRun) -> Vec<Verdict> {
    let (step, longest) = (run.lattice.time_step(), run.lattice.stability_limit());
    let mut all = vec![
        Verdict::new("the step is stable", step < longest)
            .with_value(step)
            .with_limit(longest)
            .in_unit("s"),
    ];
    if is_free(run) && run.scene.neighbours == Neighbours::TwentySix {
        let share = distance(run) / run.lattice.shape().spacing[0];
        all.push(Verdict::at_most(
            "back to 1 % of the spacing from the start, as a share of the spacing",
            share,
            BACK,
        ));
    }
    all.into_iter()
        .map(|v| v.at(run.scene.name.as_str()))
        .collect()
}

fn csv(run: &LatticeRun) -> String {
    let mut text = "frame,time_s,distance_from_start_m,moved_m,wall_s\n".to_owned();
    for f in &run.frames {
        let time = f.frame as f64 / run.scene.frame_rate;
        text.push_str(&format!(
            "{},{time},{},{},{}\n",
            f.frame, f.distance, f.moved, f.time_s
        ));
    }
    text
}

impl Run for LatticeRun {
    fn name(&self) -> &str {
        &self.scene.name
    }

    fn frames(&self) -> usize {
        self.scene.frames
    }

    fn frame(&self) -> usize {
        LatticeRun::frame(self)
    }

    fn plan(&self) -> &Plan {
        &self.plan
    }

    fn cast(&self) -> Cast {
        let held = self
            .surface
            .vertices
            .iter()
            .map(|p| f64::from(u8::from(p.z == 0.0)))
            .collect();
        let muscles = vec![actor(
            &self.scene.name,
            self.surface.clone(),
            held,
            &mut HashSet::new(),
        )];
        Cast {
            muscles,
            bones: Vec::new(),
        }
    }

    fn snapshot(&self) -> Snapshot {
        let (x, frame) = (self.surface_at(), LatticeRun::frame(self));
        let count = x.len();
        let muscles = vec![(x, vec![Vector3::zeros(); count])];
        Snapshot {
            frame,
            time: frame as f64 / self.scene.frame_rate,
            muscles,
            bones: Vec::new(),
        }
    }

    fn poses(&self, _: usize) -> Vec<Isometry3<f64>> {
        Vec::new()
    }

    fn stretch(&self) -> f64 {
        distance(self)
    }

    fn worst(&self) -> &'static str {
        "furthest from the start"
    }

    fn step(&mut self, _: &mut dyn FnMut(&str) -> bool) -> Stepped {
        LatticeRun::step(self)
    }

    fn converged(&self) -> bool {
        // Only the end of a motion has to be at rest, and only where there is time for it.
        true
    }

    fn account(&self) -> Account {
        let (lattice, time_s) = (
            &self.lattice,
            self.frames.iter().map(|f| f.time_s).sum::<f64>(),
        );
        let farthest = greatest(self.frames.iter().map(|f| f.distance));
        let own = json!({
                "points": lattice.shape().count(),
                "springs": lattice.spring_count(),
                "neighbours": if self.scene.neighbours == Neighbours::Six { 6 } else { 26 },
                "steps": lattice.steps(),
                "steps_a_frame": self.steps,
                "time_step_s": lattice.time_step(),
                "stability_limit_s": lattice.stability_limit(),
                "damping_kg_s": lattice.damping(),
                "distance_from_start_max_m": farthest,
                "distance_from_start_end_m": distance(self),
                "at_rest": self.at_rest(),
                "time_s": time_s,
        });
        let mut table = Table::new("Lattice", ["what", "value"]);
        for (what, value) in [
            ("points", lattice.shape().count().to_string()),
            ("springs", lattice.spring_count().to_string()),
            ("time step [ms]", number(lattice.time_step() * 1e3)),
            (
                "longest stable step [ms]",
                number(lattice.stability_limit() * 1e3),
            ),
            ("steps a frame", self.steps.to_string()),
            ("damping of a point [kg/s]", number(lattice.damping())),
            (
                "distance from the start, greatest [mm]",
                number(farthest * 1e3),
            ),
            (
                "distance from the start, end [mm]",
                number(distance(self) * 1e3),
            ),
            (
                "at rest at the end",
                if self.at_rest() { "yes" } else { "no" }.to_owned(),
            ),
            ("time of all steps [s]", number(time_s)),
        ] {
            table.row([what.to_owned(), value]);
        }
        let points = |of: fn(&pliant::simulation::lattice::Measured) -> f64| {
            self.frames
                .iter()
                .map(|f| (f.frame as f64, of(f) * 1e3))
                .collect::<Vec<_>>()
        };
        Account {
            numbers: vec![
                ("time_s", time_s),
                ("distance_from_start_max_m", farthest),
                ("distance_from_start_end_m", distance(self)),
            ],
            summary: own_object("lattice", own),
            verdicts: verdicts(self),
            tables: vec![table],
            plots: vec![
                LinePlot::new("Distance from the start, greatest [mm]", "frame")
                    .with("", points(|f| f.distance)),
                LinePlot::new("Motion in a frame, greatest [mm]", "frame")
                    .with("", points(|f| f.moved)),
            ],
            measures: csv(self),
            notes: Vec::new(),
        }
    }
}
