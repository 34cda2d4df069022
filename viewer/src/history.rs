//! The readings of the last frames, for plots.

use std::collections::VecDeque;

use super::snapshot::{Reading, Shot};
use pliant_render::Ticks;

/// Number of stored frames.
pub const KEPT: usize = 600;

/// One line of a plot.
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    /// Name of the plot.
    pub name: &'static str,
    /// Name of the body; empty for a single body.
    pub of: String,
    /// Unit of the values; empty for none.
    pub unit: &'static str,
    /// Frame and value, sorted by frame.
    pub points: VecDeque<(f64, f64)>,
    /// Index of the point of the last displayed frame.
    pub now: usize,
}

/// Lines of readings over frames.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct History {
    lines: Vec<Line>,
    last: Option<usize>,
    /// True for a finished run, where an earlier frame is no restart.
    is_finished: bool,
}

impl Line {
    /// Inserts a value; if there are too many, the farthest frames are removed.
    fn see(&mut self, frame: usize, value: f64) {
        let frame = frame as f64;
        self.now = self.points.partition_point(|(known, _)| *known < frame);
        match self.points.get_mut(self.now) {
            Some(point) if point.0 == frame => point.1 = value,
            _ => self.points.insert(self.now, (frame, value)),
        }
        if self.points.len() > KEPT {
            if 2 * self.now < self.points.len() {
                self.points.pop_back();
            } else {
                self.points.pop_front();
                self.now -= 1;
            }
        }
    }
}

impl History {
    /// The history of a run whose frames come in any order.
    #[must_use]
    pub fn of_finished_run() -> Self {
        Self {
            is_finished: true,
            ..Self::default()
        }
    }

    /// Stores the readings of a shot; a restart clears the history.
    pub fn see(&mut self, shot: &Shot) {
        let same =
            |(line, reading): (&Line, &Reading)| line.name == reading.name && line.of == reading.of;
        let fits = self.lines.len() == shot.readings.len()
            && self.lines.iter().zip(&shot.readings).all(same);
        let is_reset = !self.is_finished && self.last.is_some_and(|last| shot.frame < last);
        if !fits || is_reset {
            let points = VecDeque::new;
            let line = |r: &Reading| Line {
                name: r.name,
                of: r.of.clone(),
                unit: r.unit,
                points: points(),
                now: 0,
            };
            self.lines = shot.readings.iter().map(line).collect();
        }
        self.last = Some(shot.frame);
        for (line, reading) in self.lines.iter_mut().zip(&shot.readings) {
            line.see(shot.frame, reading.value);
        }
    }

    /// Lines by plot, in the order of the plots' first appearance.
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

/// Ranges of frames and of values, both with positive width; values start at 0 if they are near it.
pub fn ranges<'a>(
    points: impl Iterator<Item = &'a (f64, f64)>,
) -> Option<((f64, f64), (f64, f64))> {
    let around = |(low, high): (f64, f64), v: f64| (low.min(v), high.max(v));
    let none = (f64::INFINITY, f64::NEG_INFINITY);
    let (x, y) = points.fold((none, none), |(x, y), point| {
        (around(x, point.0), around(y, point.1))
    });
    if !(x.0.is_finite() && y.0.is_finite()) {
        return None;
    }
    let is_level = y.0 == y.1;
    let from = if y.0 > 0.0 && (y.0 < 0.5 * y.1 || is_level) {
        0.0
    } else {
        y.0
    };
    let until = if y.1 < 0.0 && is_level { 0.0 } else { y.1 };
    let ends = Ticks::linear((from, until), 2)
        .values
        .into_iter()
        .fold((from, until), around);
    let wide = |(low, high): (f64, f64), least: f64| {
        if high > low {
            (low, high)
        } else {
            (low, low + least)
        }
    };
    // Only a line of zeros still has no width.
    Some((wide(x, 1.0), wide(ends, 1.0)))
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
            history.see(&shot(
                frame,
                &[
                    ("depth", "a", value),
                    ("depth", "b", -value),
                    ("stretch", "a", 0.0),
                ],
            ));
        }
        assert_eq!(points(&history, 0), [(0.0, 1.0), (1.0, 2.5), (2.0, 3.0)]);
        assert_eq!(points(&history, 1)[1], (1.0, -2.5));
        let plots = history.plots();
        assert_eq!(
            plots
                .iter()
                .map(|(name, lines)| (*name, lines.len()))
                .collect::<Vec<_>>(),
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
        history.see(&shot(0, &[("speed", "", 2.0)]));
        assert_eq!(points(&history, 0), [(0.0, 2.0)]);
    }

    #[test]
    fn a_finished_run_keeps_what_was_seen_in_the_order_of_its_frames() {
        let mut history = History::of_finished_run();
        for frame in [4, 5, 6, 5, 4, 0, 2] {
            history.see(&shot(frame, &[("depth", "", frame as f64)]));
        }
        assert_eq!(
            points(&history, 0),
            [0.0, 2.0, 4.0, 5.0, 6.0].map(|k| (k, k))
        );
        assert_eq!(history.lines[0].now, 1, "where it is");
        // Backwards from far away: the farthest frames are removed, never the last displayed one.
        (0..2 * KEPT)
            .rev()
            .for_each(|k| history.see(&shot(k, &[("depth", "", 1.0)])));
        assert_eq!(points(&history, 0).len(), KEPT);
        assert_eq!(
            (history.lines[0].now, points(&history, 0)[KEPT - 1].0),
            (0, (KEPT - 1) as f64)
        );
    }

    #[test]
    fn ranges_hold_all_points_and_level_lines_are_measured_from_zero() {
        let of = |points: &[(f64, f64)]| ranges(points.iter());
        assert_eq!(of(&[]), None);
        assert_eq!(
            of(&[(3.0, 0.0), (4.0, 0.0)]),
            Some(((3.0, 4.0), (0.0, 1.0))),
            "zeros"
        );
        for level in [2e-7, -2e-7, 40.0, -40.0] {
            let Some((x, (low, high))) = of(&[(3.0, level), (4.0, level)]) else {
                panic!("no range")
            };
            assert_eq!(x, (3.0, 4.0));
            assert!(
                low.min(high) <= level.min(0.0) && high >= level.max(0.0),
                "{level}: {low} to {high}"
            );
            assert!(high - low <= 4.0 * level.abs(), "{level}: {low} to {high}");
        }
        let Some((_, (low, high))) = of(&[(0.0, 99.0), (1.0, 101.0)]) else {
            panic!("no range")
        };
        assert!(low > 0.0 && low <= 99.0 && high >= 101.0, "{low} to {high}");
        assert_eq!(
            of(&[(5.0, 1.0)]).map(|(x, _)| x),
            Some((5.0, 6.0)),
            "one frame"
        );
    }
}
