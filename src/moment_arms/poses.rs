//! Poses over several coordinates of a model, and moment arms there by central differences.

use nalgebra::{Point3, Vector3};

use crate::mesh::measures::max_or_nan;
use crate::opensim::Model;
use crate::opensim::paths::PathSamples;
use crate::random::Random;

use super::arms::CLEAR;
use super::sweep::{CrossingMuscle, MOST_VALUES};

/// Change of an angle \[rad\] on each side of a pose for the central difference: three degrees. The
/// error of second order of a moment arm `r` is then `r'' 4.6e-4`: for the greatest curvatures of
/// hip muscles, 0.1 m, half of the tolerance of a path. A length is uncertain by 0.05 mm where a
/// muscle slides on a bone, and a smaller step makes more of that.
const STEP: f64 = std::f64::consts::PI / 60.0;
/// The same for a coordinate that is a length [m].
const SLIDE: f64 = 3e-3;

/// Poses of a model: samples over ranges of some coordinates, each with the neighbours that its
/// moment arms need.
#[derive(Clone, Debug, PartialEq)]
pub struct PoseSet {
    /// Indices of the coordinates in the model.
    pub coordinates: Vec<usize>,
    /// Values of these coordinates in each sample \[rad or m\].
    pub samples: Vec<Vec<f64>>,
    /// Values of all coordinates of the model in all poses: each sample, then its neighbours below
    /// and above along each coordinate.
    pub poses: Vec<Vec<f64>>,
    steps: Vec<f64>,
}

impl PoseSet {
    /// A Latin hypercube: along each coordinate one sample in each of `count` equal parts of its
    /// range. `rest` has the values of the other coordinates.
    pub fn hypercube(
        model: &Model,
        rest: &[f64],
        ranges: &[(usize, [f64; 2])],
        count: usize,
        seed: u64,
    ) -> Self {
        let mut random = Random::new(seed);
        let columns = ranges.iter().map(|(_, [low, high])| {
            let mut order: Vec<usize> = (0..count).collect();
            for k in (1..count).rev() {
                order.swap(k, random.index(k + 1));
            }
            let place = |part: usize, random: &mut Random| {
                low + (high - low) * (part as f64 + random.unit()) / count as f64
            };
            order
                .into_iter()
                .map(|part| place(part, &mut random))
                .collect()
        });
        let columns: Vec<Vec<f64>> = columns.collect();
        let samples = (0..count).map(|k| columns.iter().map(|c| c[k]).collect());
        Self::around(model, rest, ranges, samples.collect())
    }

    /// A grid with `count` values of each coordinate, at least two, from end to end of its range.
    pub fn grid(model: &Model, rest: &[f64], ranges: &[(usize, [f64; 2])], count: usize) -> Self {
        let count = count.max(2);
        let mut samples: Vec<Vec<f64>> = vec![Vec::new()];
        for (_, [low, high]) in ranges {
            let value = |k: usize| low + (high - low) * k as f64 / (count - 1) as f64;
            // There and back, so that neighbours in the list are neighbours in the grid.
            let longer = samples.iter().enumerate().flat_map(|(n, one)| {
                let turned = n % 2 == 1;
                (0..count).map(move |k| {
                    let k = if turned { count - 1 - k } else { k };
                    one.iter().copied().chain([value(k)]).collect()
                })
            });
            samples = longer.collect();
        }
        Self::around(model, rest, ranges, samples)
    }

    /// Greatest number of samples over some coordinates.
    pub fn most(coordinates: usize) -> usize {
        MOST_VALUES / (1 + 2 * coordinates)
    }

    fn around(
        model: &Model,
        rest: &[f64],
        ranges: &[(usize, [f64; 2])],
        samples: Vec<Vec<f64>>,
    ) -> Self {
        let coordinates: Vec<usize> = ranges.iter().map(|(c, _)| *c).collect();
        let step = |c: &usize| {
            if model.coordinates[*c].is_angle {
                STEP
            } else {
                SLIDE
            }
        };
        let steps: Vec<f64> = coordinates.iter().map(step).collect();
        let whole = |sample: &[f64]| {
            let mut values = rest.to_vec();
            coordinates
                .iter()
                .zip(sample)
                .for_each(|(c, v)| values[*c] = *v);
            model.couple(&mut values);
            values
        };
        let mut poses = Vec::new();
        for sample in &samples {
            poses.push(whole(sample));
            for (k, step) in steps.iter().enumerate() {
                for sign in [-1.0, 1.0] {
                    let mut beside = sample.clone();
                    beside[k] += sign * step;
                    poses.push(whole(&beside));
                }
            }
        }
        Self {
            coordinates,
            samples,
            poses,
            steps,
        }
    }

    /// Number of poses of a sample.
    pub fn each(&self) -> usize {
        1 + 2 * self.steps.len()
    }

    /// Number of samples of which all poses are among the first `done`.
    pub fn complete(&self, done: usize) -> usize {
        done / self.each()
    }

    /// Mean length [m] of some fibres of a muscle in a sample, and its moment arm about each
    /// coordinate [m].
    pub fn length_and_arms(
        &self,
        muscle: &CrossingMuscle,
        fibres: &[usize],
        sample: usize,
    ) -> (f64, Vec<f64>) {
        let mean = |pose: usize| {
            let lengths = fibres.iter().map(|f| muscle.lengths[pose][*f]);
            lengths.sum::<f64>() / fibres.len() as f64
        };
        (mean(sample * self.each()), self.differences(&mean, sample))
    }

    /// Central differences of a length [m] of each pose, with the sign of moment arms.
    fn differences(&self, length: &dyn Fn(usize) -> f64, sample: usize) -> Vec<f64> {
        let first = sample * self.each();
        let arm = |(k, step): (usize, &f64)| {
            let [below, above] = [first + 1 + 2 * k, first + 2 + 2 * k].map(length);
            (below - above) / (2.0 * step)
        };
        self.steps.iter().enumerate().map(arm).collect()
    }

    /// Greatest difference of the moment arms of a muscle from those of straight lines between the
    /// ends of its fibres, in samples where no bone blocks nine of ten of them, relative to the
    /// greatest moment arm of such lines. `None` where bones block them in each sample.
    pub fn off_straight(&self, muscle: &CrossingMuscle) -> Option<f64> {
        let all: Vec<usize> = (0..muscle.fibres.len()).collect();
        let clear = (0..self.complete(muscle.lengths.len()))
            .filter(|sample| muscle.clear[sample * self.each()] >= CLEAR);
        let (mut off, mut greatest) = (0.0, 0.0);
        for sample in clear {
            let (_, arms) = self.length_and_arms(muscle, &all, sample);
            let straight = self.differences(&|pose| muscle.chords[pose], sample);
            for (arm, straight) in arms.iter().zip(&straight) {
                off = max_or_nan([off, (arm - straight).abs()]);
                greatest = max_or_nan([greatest, straight.abs()]);
            }
        }
        // Not a number, unlike zero, has to fail.
        (greatest != 0.0).then_some(off / greatest)
    }

    /// Samples of the path of some fibres of a muscle, for a force of the model.
    pub fn path(
        &self,
        model: &Model,
        muscle: &CrossingMuscle,
        fibres: &[usize],
        force: &str,
    ) -> PathSamples {
        let complete = self.complete(muscle.lengths.len());
        let both = (0..complete).map(|k| self.length_and_arms(muscle, fibres, k));
        let (lengths, arms) = both.unzip();
        let path = |c: &usize| model.coordinates[*c].path.clone();
        PathSamples {
            force: force.to_owned(),
            coordinates: self.coordinates.iter().map(path).collect(),
            values: self.samples[..complete].to_vec(),
            lengths,
            arms,
        }
    }
}

/// Greatest number of rounds of [`bundles`].
const ROUNDS: usize = 100;

/// The nearest of some centres.
fn nearest(centres: &[Point3<f64>], p: &Point3<f64>) -> usize {
    let distances = centres.iter().map(|c| (c - p).norm_squared());
    let best = distances.enumerate().min_by(|a, b| a.1.total_cmp(&b.1));
    best.map_or(0, |(k, _)| k)
}

/// The mean of some points.
fn middle<'a>(points: impl Iterator<Item = &'a Point3<f64>> + Clone) -> Point3<f64> {
    let sum: Vector3<f64> = points.clone().map(|p| p.coords).sum();
    Point3::from(sum / points.count().max(1) as f64)
}

/// Centres of `count` clusters: the point farthest from the middle, then each time the point farthest
/// from all centres.
fn spread(points: &[Point3<f64>], count: usize) -> Vec<Point3<f64>> {
    let mut centres = Vec::new();
    let mut others = vec![middle(points.iter())];
    for _ in 0..count {
        let from = |p: &Point3<f64>| (others[nearest(&others, p)] - p).norm_squared();
        let farthest = points.iter().max_by(|a, b| from(a).total_cmp(&from(b)));
        centres.extend(farthest.copied());
        others.clone_from(&centres);
    }
    centres
}

/// Fibres in `count` bundles by their origins, by k-means; each bundle has at least one fibre. The
/// bundles are in order along the longest line between two of them, which begins at its end towards
/// `first`.
pub fn bundles(fibres: &[Vec<Point3<f64>>], count: usize, first: &Vector3<f64>) -> Vec<Vec<usize>> {
    let origins: Vec<Point3<f64>> = fibres.iter().map(|f| f[0]).collect();
    let mut centres = spread(&origins, count.clamp(1, origins.len().max(1)));
    let mut of: Vec<usize> = origins.iter().map(|p| nearest(&centres, p)).collect();
    for _ in 0..ROUNDS {
        for (k, centre) in centres.iter_mut().enumerate() {
            if of.contains(&k) {
                let own = origins.iter().zip(&of).filter(|(_, b)| **b == k);
                *centre = middle(own.map(|(p, _)| p));
            }
        }
        let next: Vec<usize> = origins.iter().map(|p| nearest(&centres, p)).collect();
        if next == of {
            break;
        }
        of = next;
    }
    let pairs = centres
        .iter()
        .flat_map(|a| centres.iter().map(move |b| b - a));
    let longest = pairs.max_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared()));
    let along = longest.unwrap_or_else(Vector3::zeros);
    let along = if along.dot(first) > 0.0 {
        -along
    } else {
        along
    };
    let place = |k: &usize| along.dot(&centres[*k].coords);
    let mut order: Vec<usize> = (0..centres.len()).collect();
    order.sort_by(|a, b| place(a).total_cmp(&place(b)));
    let bundle = |k: &usize| (0..of.len()).filter(|f| of[*f] == *k).collect::<Vec<_>>();
    order.iter().map(bundle).filter(|b| !b.is_empty()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fibres_of_three_heaps_are_three_bundles_in_order() {
        let at = |x: f64, k: usize| Point3::new(x + 0.01 * (k % 3) as f64, 0.01 * k as f64, 0.0);
        let fibres: Vec<Vec<Point3<f64>>> = (0..30)
            .map(|k| vec![at([0.0, 1.0, 3.0][k % 3], k / 3), Point3::origin()])
            .collect();
        let found = bundles(&fibres, 3, &-Vector3::x());
        assert_eq!(found.len(), 3);
        for bundle in &found {
            assert!(
                bundle.len() == 10 && bundle.iter().all(|f| f % 3 == bundle[0] % 3),
                "{found:?}"
            );
        }
        // From one end to the other.
        assert_eq!([0, 1, 2].map(|k: usize| found[k][0] % 3), [0, 1, 2]);
        let turned = bundles(&fibres, 3, &Vector3::x());
        assert_eq!([0, 1, 2].map(|k: usize| turned[k][0] % 3), [2, 1, 0]);
        assert_eq!(bundles(&fibres[..2], 5, &Vector3::x()).len(), 2);
        assert_eq!(bundles(&fibres, 1, &Vector3::x())[0].len(), 30);
    }
}
