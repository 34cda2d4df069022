//! Lengths and points along polylines.

use nalgebra::{Point3, Vector3};

/// Length of a polyline [m].
pub fn length(line: &[Point3<f64>]) -> f64 {
    line.windows(2).map(|s| (s[1] - s[0]).norm()).sum()
}

/// `count` points at equal distances along a smooth curve through the points; both ends keep their
/// bits.
pub fn resample(line: &[Point3<f64>], count: usize) -> Vec<Point3<f64>> {
    let (Some(&first), Some(&last)) = (line.first(), line.last()) else {
        return Vec::new();
    };
    let mut arcs = vec![0.0];
    for s in line.windows(2) {
        arcs.push(arcs[arcs.len() - 1] + (s[1] - s[0]).norm());
    }
    let total = arcs[arcs.len() - 1];
    let mut out = Vec::with_capacity(count);
    let mut k = 0;
    for n in 0..count {
        let target = total * n as f64 / (count - 1).max(1) as f64;
        while k + 2 < arcs.len() && arcs[k + 1] < target {
            k += 1;
        }
        out.push(match n {
            0 => first,
            _ if n + 1 == count => last,
            _ => between(line, &arcs, k, target),
        });
    }
    out
}

/// Positions of `count` equidistant points on a line, in units of its segments.
pub fn equal_shares(line: &[Point3<f64>], count: usize) -> Vec<f64> {
    let lengths: Vec<f64> = line.windows(2).map(|s| (s[1] - s[0]).norm()).collect();
    let total: f64 = lengths.iter().sum();
    let (mut k, mut before) = (0, 0.0);
    let mut shares = Vec::with_capacity(count);
    for n in 0..count {
        let target = total * n as f64 / (count - 1).max(1) as f64;
        while k + 1 < lengths.len() && before + lengths[k] < target {
            before += lengths[k];
            k += 1;
        }
        let within = lengths.get(k).map_or(0.0, |l| {
            if *l > 0.0 {
                ((target - before) / l).clamp(0.0, 1.0)
            } else {
                0.0
            }
        });
        shares.push(if n + 1 == count {
            1.0
        } else {
            (k as f64 + within) / lengths.len().max(1) as f64
        });
    }
    shares
}

/// The point at arc length `target` on the cubic over segment `k`.
fn between(line: &[Point3<f64>], arcs: &[f64], k: usize, target: f64) -> Point3<f64> {
    let span = arcs[k + 1] - arcs[k];
    if !(span > 0.0) {
        return line[k];
    }
    // Slope with respect to arc length, from the neighbours on both sides.
    let slope = |i: usize| -> Vector3<f64> {
        let (a, b) = (i.saturating_sub(1), (i + 1).min(line.len() - 1));
        let width = arcs[b] - arcs[a];
        if width > 0.0 {
            (line[b] - line[a]) / width
        } else {
            Vector3::zeros()
        }
    };
    let t = ((target - arcs[k]) / span).clamp(0.0, 1.0);
    let (m, n) = (slope(k) * span, slope(k + 1) * span);
    let d = line[k + 1] - line[k];
    line[k] + m * t + (d * 3.0 - m * 2.0 - n) * (t * t) + (m + n - d * 2.0) * (t * t * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_equally_far_apart() {
        let at = |x: f64| Point3::new(x.cos(), x.sin(), 0.1 * x);
        let line: Vec<_> = (0..=100).map(|k| at(0.03 * f64::from(k))).collect();
        let points = resample(&line, 7);
        for (k, p) in points.iter().enumerate() {
            assert!((p - at(0.5 * k as f64)).norm() <= 1e-6, "{p}");
        }
        assert_eq!((points[0], points[6]), (line[0], line[100]));
        assert!((length(&line) - 3.0 * 1.01_f64.sqrt()).abs() <= 1e-3);
    }
}
