//! Equalised rings around a muscle: points at equal distances on each ring, and no rotation of a
//! ring against the next.
//!
//! Maps to the sphere can twist about a long body; meridians then wind about the muscle. Each ring
//! gets new points at equal lengths. Each ring, from the middle one outwards, starts where the sum
//! of squared distances to the points of the previous ring is least. The order around and along is
//! unchanged, so no new fold appears.

use nalgebra::Point3;

/// Number of samples on a ring between two lines, for the lengths.
const FINE: usize = 4;

/// A closed ring over lines: `place(x)` for x from 0 to the number of lines.
pub struct Ring {
    /// Values of x at equal lengths, over one turn and its end.
    at: Vec<f64>,
    lines: f64,
    /// Position of the first point, as a share of the turn.
    pub start: f64,
}

impl Ring {
    /// Measures a ring over `lines` lines.
    pub fn new<E>(
        lines: usize,
        mut place: impl FnMut(f64) -> Result<Point3<f64>, E>,
    ) -> Result<Self, E> {
        let count = FINE * lines;
        let step = 1.0 / FINE as f64;
        let points: Vec<Point3<f64>> = (0..=count)
            .map(|n| place(n as f64 * step))
            .collect::<Result<_, _>>()?;
        let shares = crate::fibres::polyline::equal_shares(&points, count + 1);
        let at = shares.into_iter().map(|s| s * lines as f64).collect();
        Ok(Self {
            at,
            lines: lines as f64,
            start: 0.0,
        })
    }

    /// Value of x at a share of the turn from the start.
    pub fn line(&self, share: f64) -> f64 {
        let y = (self.start + share).rem_euclid(1.0) * (self.at.len() - 1) as f64;
        let k = (y as usize).min(self.at.len() - 2);
        (self.at[k] + (self.at[k + 1] - self.at[k]) * (y - k as f64)).min(self.lines)
    }

    /// Rotates the ring so that its points are nearest to those of a neighbour ring.
    pub fn turn_to<E>(
        &mut self,
        neighbour: &[Point3<f64>],
        mut place: impl FnMut(f64) -> Result<Point3<f64>, E>,
    ) -> Result<(), E> {
        let count = FINE * neighbour.len();
        self.start = 0.0;
        let points: Vec<Point3<f64>> = (0..count)
            .map(|n| place(self.line(n as f64 / count as f64)))
            .collect::<Result<_, _>>()?;
        let cost = |shift: usize| -> f64 {
            let other = |m: usize| points[(shift + FINE * m) % count];
            neighbour
                .iter()
                .enumerate()
                .map(|(m, p)| (p - other(m)).norm_squared())
                .sum()
        };
        let costs: Vec<f64> = (0..count).map(cost).collect();
        let best = (0..count)
            .min_by(|&a, &b| costs[a].total_cmp(&costs[b]))
            .unwrap_or(0);
        // Between the tried shifts: at the minimum of the parabola through the best three.
        let (before, after) = (costs[(best + count - 1) % count], costs[(best + 1) % count]);
        let bend = before - 2.0 * costs[best] + after;
        let shift = if bend > 0.0 {
            0.5 * (before - after) / bend
        } else {
            0.0
        };
        self.start = ((best as f64 + shift) / count as f64).rem_euclid(1.0);
        Ok(())
    }
}
