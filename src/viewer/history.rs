//! The readings of the last frames, for plots.

use std::collections::VecDeque;

use super::snapshot::{Reading, Shot};

/// Frames that are remembered.
pub const KEPT: usize = 600;

/// One line of a plot.
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    /// Which plot it belongs to.
    pub name: &'static str,
    /// Of which body; empty where there is but one.
    pub of: String,
    /// The unit of its numbers; empty for none.
    pub unit: &'static str,
    /// Frame and number, in the order in which they came.
    pub points: VecDeque<(f64, f64)>,
}

/// Lines of readings over frames.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct History {
    lines: Vec<Line>,
    last: Option<usize>,
}

impl History {
    /// Remembers the readings of a shot whose frame was not the last; what came before a reset is forgotten.
    pub fn see(&mut self, shot: &Shot) {
        if self.last == Some(shot.frame) {
            self.lines.iter_mut().zip(&shot.readings).for_each(|(line, reading)| {
                if let Some(point) = line.points.back_mut() {
                    point.1 = reading.value;
                }
            });
            return;
        }
        let same = |(line, reading): (&Line, &Reading)| line.name == reading.name && line.of == reading.of;
        let fits = self.lines.len() == shot.readings.len() && self.lines.iter().zip(&shot.readings).all(same);
        let is_reset = shot.frame == 0;
        if !fits || is_reset {
            let line = |r: &Reading| Line { name: r.name, of: r.of.clone(), unit: r.unit, points: VecDeque::new() };
            self.lines = shot.readings.iter().map(line).collect();
        }
        self.last = Some(shot.frame);
        for (line, reading) in self.lines.iter_mut().zip(&shot.readings) {
            line.points.push_back((shot.frame as f64, reading.value));
            if line.points.len() > KEPT {
                line.points.pop_front();
            }
        }
    }

    /// Lines by plot, in the order in which the plots first came.
    pub fn plots(&self) -> Vec<(&'static str, Vec<&Line>)> {
        let mut plots: Vec<(&'static str, Vec<&Line>)> = Vec::new();
        for line in &self.lines {
            match plots.iter_mut().find(|(name, _)| *name == line.name) {
                Some((_, lines)) => lines.push(line),
                None => plots.push((line.name, vec![line])),
            }
        }
        plots
    }
}
