//! The files of each frame of a run.

use std::collections::HashMap;

use pliant::io::pvd::Collection;
use pliant::mesh::measures::median;

/// Frames per second if the times of the frames are unsuitable.
pub(super) const USUAL_RATE: f64 = 25.0;

/// Watchable frame rates [1/s].
const RATES: std::ops::RangeInclusive<f64> = 5.0..=1000.0;

/// A moment of the run.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Moment {
    /// Index of the frame in the run.
    pub frame: usize,
    /// Time [s].
    pub time: f64,
    /// Part and file of each object, by their indices.
    pub shows: Vec<(usize, usize)>,
}

/// The frames of a run in order, with their contents.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Timeline {
    /// Names of the parts.
    pub parts: Vec<String>,
    /// Files, relative to the collection.
    pub files: Vec<String>,
    /// Moments, sorted by frame.
    pub moments: Vec<Moment>,
}

/// The index of a key; a new key gets the next index.
fn index<K: std::hash::Hash + Eq>(of: &mut HashMap<K, usize>, key: K) -> (usize, bool) {
    let next = of.len();
    let index = *of.entry(key).or_insert(next);
    (index, index == next)
}

impl Timeline {
    /// Sorts the files of a collection into moments.
    pub fn of(collection: &Collection) -> Self {
        let mut all = Self::default();
        let (mut parts, mut files, mut times) = (HashMap::new(), HashMap::new(), HashMap::new());
        for entry in collection.entries() {
            let (part, is_new) = index(&mut parts, (entry.name.as_str(), entry.part));
            if is_new {
                let name = if entry.name.is_empty() {
                    format!("part {}", entry.part)
                } else {
                    entry.name.clone()
                };
                all.parts.push(name);
            }
            let (file, is_new) = index(&mut files, entry.file.as_str());
            if is_new {
                all.files.push(entry.file.clone());
            }
            // Both zeros are one moment.
            let (moment, is_new) = index(&mut times, (entry.time + 0.0).to_bits());
            if is_new {
                all.moments.push(Moment {
                    frame: moment,
                    time: entry.time,
                    shows: Vec::new(),
                });
            }
            all.moments[moment].shows.push((part, file));
        }
        all.number();
        all
    }

    /// Sets the frame numbers of moments from their file names if these increase: the file of an
    /// unchanged object is older.
    fn number(&mut self) {
        let latest = |moment: &Moment| {
            moment
                .shows
                .iter()
                .filter_map(|(_, file)| numbered(&self.files[*file]))
                .max()
        };
        let numbers: Option<Vec<usize>> = self.moments.iter().map(latest).collect();
        if let Some(numbers) = numbers.filter(|numbers| numbers.is_sorted_by(|a, b| a < b)) {
            self.moments
                .iter_mut()
                .zip(numbers)
                .for_each(|(moment, number)| moment.frame = number);
        }
    }

    /// Frames per second of the playback, and whether this is the frame rate of the run.
    pub fn rate(&self) -> (f64, bool) {
        let apart = self
            .moments
            .windows(2)
            .map(|pair| (pair[1].time - pair[0].time).abs());
        let rate = median(apart.filter(|seconds| *seconds > 0.0).collect()).map(f64::recip);
        rate.filter(|rate| RATES.contains(rate))
            .map_or((USUAL_RATE, false), |rate| (rate, true))
    }

    /// The moment with the nearest frame number, the earlier of two; `None` without moments.
    pub fn nearest(&self, frame: usize) -> Option<usize> {
        let behind = self.moments.partition_point(|moment| moment.frame < frame);
        let around = [
            behind.checked_sub(1),
            (behind < self.moments.len()).then_some(behind),
        ];
        around
            .into_iter()
            .flatten()
            .min_by_key(|k| self.moments[*k].frame.abs_diff(frame))
    }
}

/// The number at the end of a file name, as in `muscle_0012.vtp`.
fn numbered(file: &str) -> Option<usize> {
    let stem = file.rsplit_once('.').map_or(file, |(stem, _)| stem);
    stem.rsplit_once('_').and_then(|(_, digits)| {
        digits
            .bytes()
            .all(|b| b.is_ascii_digit())
            .then(|| digits.parse().ok())?
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use pliant::io::pvd::Entry;

    fn collection(entries: &[(f64, usize, &str, &str)]) -> Collection {
        let mut collection = Collection::new();
        for &(time, part, name, file) in entries {
            collection.push(Entry {
                time,
                part,
                name: name.to_owned(),
                file: file.to_owned(),
            });
        }
        collection
    }

    #[test]
    fn files_of_one_time_are_one_moment() {
        let timeline = Timeline::of(&collection(&[
            (0.0, 0, "a", "frames/a_0000.vtp"),
            (0.0, 1, "bone_b", "frames/bone_b_0000.vtp"),
            (0.1, 0, "a", "frames/a_0004.vtp"),
            (0.1, 1, "bone_b", "frames/bone_b_0000.vtp"),
            (0.2, 0, "a", "frames/a_0006.vtp"),
        ]));
        assert_eq!(
            (timeline.parts.as_slice(), timeline.files.len()),
            (&["a".to_owned(), "bone_b".to_owned()][..], 4)
        );
        let frames: Vec<usize> = timeline.moments.iter().map(|m| m.frame).collect();
        assert_eq!(frames, [0, 4, 6]);
        assert_eq!(timeline.moments[1].shows, [(0, 2), (1, 1)]);
        let (rate, is_own) = timeline.rate();
        assert!((rate - 10.0).abs() < 1e-9 && is_own, "{rate}");
        let nearest = [0, 1, 2, 3, 5, 6, 99].map(|frame| timeline.nearest(frame));
        assert_eq!(nearest, [0, 0, 0, 1, 1, 2, 2].map(Some));
        assert_eq!(Timeline::default().nearest(3), None);
    }

    #[test]
    fn files_without_numbers_are_counted() {
        for files in [
            ["x.vtp", "y.vtp"],
            ["a_2.vtp", "a_1.vtp"],
            ["a_1.vtp", "a_1.vtp"],
            ["a_1.vtp", "a_.vtp"],
        ] {
            let timeline = Timeline::of(&collection(&[
                (-0.0, 0, "", files[0]),
                (3.0, 0, "", files[1]),
            ]));
            let frames: Vec<usize> = timeline.moments.iter().map(|m| m.frame).collect();
            assert_eq!(
                (frames, timeline.parts),
                (vec![0, 1], vec!["part 0".to_owned()]),
                "{files:?}"
            );
        }
        assert_eq!(numbered("a_0012.vtp"), Some(12));
        for name in [
            "a.vtp",
            "a_b.vtp",
            "a_-1.vtp",
            "a_99999999999999999999.vtp",
            "a_.vtp",
        ] {
            assert_eq!(numbered(name), None, "{name}");
        }
    }

    #[test]
    fn times_that_make_no_film_are_not_followed() {
        let at = |times: &[f64]| {
            let entries: Vec<_> = times.iter().map(|t| (*t, 0, "a", "a.vtp")).collect();
            Timeline::of(&collection(&entries)).rate()
        };
        assert_eq!(at(&[0.0]), (USUAL_RATE, false));
        assert_eq!(at(&[0.0, 30.0, 60.0]), (USUAL_RATE, false));
        assert_eq!(at(&[0.0, 1e-300]), (USUAL_RATE, false));
        assert_eq!(at(&[1.0, 0.5, 0.25, 0.125, 0.0]), (1.0 / 0.1875, true));
    }
}
