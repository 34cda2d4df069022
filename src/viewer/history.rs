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

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;

    fn shot(frame: usize, values: &[(&'static str, &str, f64)]) -> Shot {
        let reading = |(name, of, value): &(&'static str, &str, f64)| Reading {
            name,
            of: (*of).to_owned(),
            unit: "mm",
            value: *value,
        };
        Shot {
            frame,
            last_frame: 10,
            stage: Arc::default(),
            scene: None,
            controls: Arc::default(),
            bodies: Vec::new(),
            bones: Vec::new(),
            handles: Vec::new(),
            readings: values.iter().map(reading).collect(),
            probe: None,
            effects: Vec::new(),
            notes: Vec::new(),
        }
    }

    fn points(history: &History, line: usize) -> Vec<(f64, f64)> {
        history.lines[line].points.iter().copied().collect()
    }

    #[test]
    fn frames_follow_and_a_frame_that_changed_counts_once() {
        let mut history = History::default();
        for (frame, value) in [(0, 1.0), (1, 2.0), (1, 2.5), (2, 3.0)] {
            history.see(&shot(frame, &[("depth", "a", value), ("depth", "b", -value), ("stretch", "a", 0.0)]));
        }
        assert_eq!(points(&history, 0), [(0.0, 1.0), (1.0, 2.5), (2.0, 3.0)]);
        assert_eq!(points(&history, 1)[1], (1.0, -2.5));
        let plots = history.plots();
        assert_eq!(
            plots.iter().map(|(name, lines)| (*name, lines.len())).collect::<Vec<_>>(),
            [("depth", 2), ("stretch", 1)]
        );
    }

    #[test]
    fn a_reset_and_other_readings_begin_anew_and_length_is_bounded() {
        let mut history = History::default();
        (0..KEPT + 20).for_each(|k| history.see(&shot(k, &[("depth", "", k as f64)])));
        assert_eq!(points(&history, 0).len(), KEPT);
        assert_eq!(points(&history, 0)[0].0, 20.0);
        history.see(&shot(0, &[("depth", "", 7.0)]));
        assert_eq!(points(&history, 0), [(0.0, 7.0)]);
        history.see(&shot(1, &[("speed", "", 1.0)]));
        assert_eq!(history.plots().len(), 1);
        assert_eq!(points(&history, 0), [(1.0, 1.0)]);
        // A finished run that goes back keeps what was seen.
        history.see(&shot(0, &[("speed", "", 2.0)]));
        assert_eq!(history.plots()[0].0, "speed");
    }
}
